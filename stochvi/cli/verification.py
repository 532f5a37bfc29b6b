"""Commands that compare methods, measure the cost of accuracy, and explain a scene."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

import click

from stochvi.cli.declared import Question, command, declare
from stochvi.cli.options import BUDGET, Common, shown
from stochvi.cli.program import FAILED, stop

if TYPE_CHECKING:
    from stochvi.verification.check import Check, Checks

ONE_SCENE = 0.003
"""Default relative error of the Monte Carlo where one scene is checked."""

MANY_SCENES = 0.01
"""Default relative error of the Monte Carlo of each of several scenes that are checked together."""


@command("seed, threads, json, out, quiet", reads="")
@click.argument("scenes", metavar="SCENE...", nargs=-1)
def check(
    options: Common, scenes: tuple[str, ...], zoo: bool, rel_error: float | None,
    budget: float | None,
) -> None:  # fmt: skip
    """Compare all methods that apply; exit 1 if they disagree.

    Several scenes, or the zoo, are judged under one alarm rate for all their comparisons.

    --zoo  Also check every scene of the zoo that ships.
    --rel-error (float)  Relative standard error of each simulation [0.003; with several scenes
        0.01].
    --budget TIME (time)  Time for the simulations of all scenes together [60 for each].
    """
    from stochvi.scenes.scene import load_scene
    from stochvi.verification.check import check as compare
    from stochvi.verification.check import check_many
    from stochvi.verification.check import zoo as shipped

    if not scenes and not zoo:
        raise ValueError("check needs a scene file, several, or --zoo, got none")
    twice = [name for number, name in enumerate(scenes) if name in scenes[:number]]
    if twice:
        raise ValueError(f"check needs each scene once, got {twice[0]} twice; leave one out")
    loaded = {name: load_scene(name) for name in scenes} | (shipped() if zoo else {})
    seconds = BUDGET * len(loaded) if budget is None else budget
    several = len(loaded) > 1
    error = (MANY_SCENES if several else ONE_SCENE) if rel_error is None else rel_error
    asked = options.sampling | {"budget": options.until(seconds).rest, "rel_error": error}
    failed: list[str] = []

    def judged() -> Check | Checks:
        with options.progress("checking") as report:
            if several:
                return check_many(loaded, progress=report, **asked)
            return compare(next(iter(loaded.values())), progress=report, **asked)

    def show(verdict: Check | Checks) -> None:
        options.show(verdict)
        failed.extend([] if verdict.passed else [verdict.summary()])

    with options.within(seconds):
        shown(judged, show)
    if failed:
        stop(f"check failed: {failed[0]}", FAILED)


PANELS_SECONDS = 3.5
"""Time that the errors of `cost` and the many panels of its picture take, s (measured on a busy
machine)."""


@declare("verification.cost:cost", "seed, threads, json, out, quiet", progress="cost")
def cost(question: Question) -> None:
    """Measure what accuracy costs in time.

    --budget TIME (time) = 20.0  Time to spend on measuring.
    """
    budget = question.asked["budget"]
    question.asked["budget"] = question.options.until(budget, PANELS_SECONDS).rest or budget


@command("threads, json, out, quiet")
def explain(options: Common, scene: str, budget: float) -> None:
    """Say what is simulated, by which methods, at what price.

    With --out it draws the scene with its lengths as scene.svg.

    --budget TIME (time) = 10.0  Largest time, without compiling; the trial simulation gets what is
        left of it.
    """
    from stochvi.scenes.scene import load_scene
    from stochvi.verification.check import explain as explain_scene
    from stochvi.verification.check import explain_phases
    from stochvi.views.verification import phases_told

    loaded = load_scene(scene)
    before = time.process_time()  # a command that starts does nothing else
    asked: dict[str, Any] = {"threads": options.threads}
    asked["budget"] = options.until(budget).rest or budget
    if loaded.phases:
        answers = explain_phases(loaded, **asked).items()
        phases = {name: each.with_start(before) for name, each in answers}
        each = {name: answer.to_dict() for name, answer in phases.items()}
        document = {"method": "explain", "phases": each}
        options.tell(document, lambda: phases_told(phases))
        found, loaded = next(iter(phases.values())), loaded.in_phase(loaded.phases[0].name)
    else:
        phases = {}
        found = explain_scene(loaded, **asked).with_start(before)
        options.show(found)
    if options.out is not None:
        from stochvi.results.base import stacked
        from stochvi.views.files import write_table
        from stochvi.views.schematic import write_problem

        if phases:
            tables = [each.to_frame().assign(phase=name) for name, each in phases.items()]
            write_table(stacked(tables), options.out / "methods.csv")
        rests = {name: gap.position for name, gap in found.rest_of_gaps.items()}
        write_problem(loaded, rests, options.out)


FILE_PATHS = 4096
"""Default number of paths of a problem for other programs: enough to show the bias of an integrator
that includes the transient from the start in its averages."""


@command("out, quiet", reads="")
def problems(options: Common, paths: int, relaxations: float) -> None:
    """List known-answer problems for other integrators.

    They are listed; with --out each is written as plain numbers in JSON, with its answer, an index
    and a README.

    --paths (int) = 4096  Paths of each problem.
    --relaxations (float) = 20.0  Length of a path, in relaxation times.
    """
    from stochvi.results.base import frame_of
    from stochvi.verification.testing.documents import (
        in_a_sentence,
        index_row,
        problem_document,
        readme,
    )
    from stochvi.verification.testing.problems import shipped_problems
    from stochvi.views.files import write_json, write_table, write_text
    from stochvi.views.verification import problems_told

    found = shipped_problems(paths=paths, relaxations=relaxations)
    options.say(problems_told({each[0].name: in_a_sentence(*each) for each in found}))
    if options.out is None:
        return
    for problem, answer in found:
        write_json(problem_document(problem, answer), str(options.out / f"{problem.name}.json"))
    write_table(frame_of(index_row(*each) for each in found), options.out / "index.csv")
    write_text(readme(), options.out / "README.txt")


@command("json, out, quiet", reads="file")
def judge(
    options: Common, file: str, problem: str, form: str | None, allowed: float, finds: float | None
) -> None:
    """Judge what another program wrote; exit 1 if it is wrong.

    FILE is CSV: statistics (quantity,value,standard_error), averages of each path, or records
    (path,time,x,v).

    --problem NAME|FILE.json (needed)  A problem that `problems` lists, or a file that it wrote.
    --format statistics|averages|records as form  Format of FILE; default: recognised by its header.
    --allowed PERCENT (float) = 0.0  Largest bias that is accepted, per cent.
    --finds PERCENT (float)  Error that must be found: too few paths for it are no pass, per cent.
    """
    from stochvi.verification.testing.documents import judge_file

    if not 0.0 <= allowed < 100.0:
        raise ValueError(f"--allowed must be at least 0 and below 100 per cent, got {allowed:g}")
    if finds is not None and not finds > allowed:
        raise ValueError(f"--finds must be above --allowed, {allowed:g} per cent, got {finds:g}")
    verdict = judge_file(
        file, problem, format=form, paths=FILE_PATHS, allowed_percent=allowed, finds_percent=finds
    )
    options.show(verdict)
    if not verdict.passed:
        stop(f"judge failed: {verdict.summary()}", FAILED)
