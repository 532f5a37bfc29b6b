"""The true values by which a problem is judged, from the methods that know them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import replace

from stochvi.mathematics.rounding import CANCELLATION
from stochvi.methods.closed_form import exact
from stochvi.methods.fokker_planck import fokker_planck
from stochvi.methods.monte_carlo.choose_plan import make_plan
from stochvi.model.model import model_of
from stochvi.results.errors import NoExactSolution, NotApplicable, NotConverged
from stochvi.results.estimates import Estimate
from stochvi.results.response import Response
from stochvi.scenes.scene import Scene
from stochvi.verification.check_of_many import zoo
from stochvi.verification.testing.known_answers import known_answers
from stochvi.verification.testing.problems import Problem, problem_of
from stochvi.verification.testing.samples import QUANTITIES

PATHS = 1024
"""Number of paths that a problem asks of an integrator by default."""

RELAXATIONS = 20.0
"""Length of a path in relaxation times by default."""

RTOL = 1e-4
"""Relative error asked of the Fokker-Planck equation; the error that it reaches is the bias of a
true value."""


def known_problems(
    scenes: Mapping[str, Scene] | Iterable[str],
    *,
    paths: int = PATHS,
    relaxations: float = RELAXATIONS,
) -> list[tuple[Problem, Response]]:
    """The problem of each scene with the most certain answer to it.

    All problems are made before any is solved, so that a scene that is not allowed fails at once.
    """
    if isinstance(scenes, str):
        raise ValueError(f"scenes must be a list of names, got the one name {scenes!r}")
    named = dict(scenes) if isinstance(scenes, Mapping) else _of_the_zoo(tuple(scenes))
    problems = [
        problem_of(scene, name=name, paths=paths, relaxations=relaxations)
        for name, scene in named.items()
    ]
    if isinstance(scenes, Mapping):
        answers = {name: solved(scene) for name, scene in scenes.items()}
    else:
        answers = known_answers(*named) if named else {}
    return [
        (replace(each, speed_threshold=_threshold(answers[name])), answers[name])
        for name, each in zip(named, problems, strict=True)
    ]


def shipped_problems(
    *, paths: int = PATHS, relaxations: float = RELAXATIONS
) -> list[tuple[Problem, Response]]:
    """Every problem that ships with its answer: all scenes of the zoo whose answer is known and
    that are linear structures with rigid stops or none."""
    found = []
    for name in known_answers():
        try:
            found += known_problems([name], paths=paths, relaxations=relaxations)
        except NotApplicable:
            continue
    return found


def solved(scene: Scene, speed_threshold: float | None = None, *, rtol: float = RTOL) -> Response:
    """The exact answer to a scene, or else that of the Fokker-Planck equation.

    Parameters
    ----------
    speed_threshold
        `collision_rate` counts impacts faster than this, m/s; None for that of `simulate`. A closed
        form counts all impacts.
    rtol
        Relative error asked of the Fokker-Planck equation.

    Raises
    ------
    NotApplicable
        If neither knows the answer.
    """
    try:
        return exact(scene)
    except NoExactSolution as reason:
        unknown = reason
    if speed_threshold is None:
        thresholds = make_plan(model_of(scene)).layout.thresholds
        speed_threshold = next(iter(thresholds.values()), None)
    try:
        return fokker_planck(scene, rtol=rtol, speed_threshold=speed_threshold)
    except NotConverged as reason:
        if not isinstance(reason.partial, Response):
            raise
        return reason.partial
    except NotApplicable as reason:
        raise NotApplicable(
            "judge", [f"no exact answer is known ({unknown} {str(reason).rstrip('.')})"]
        ) from None


def truths_of(problem: Problem, response: Response) -> dict[str, Estimate]:
    """The known quantities of a problem whose error is stated, by the names under which integrators
    return them.

    A mean that is rounding error is 0.
    """
    found: dict[str, Estimate] = {}
    known = response.estimates()
    for quantity in QUANTITIES:
        for (owner, name), truth in known.items():
            if name != quantity or truth.bias is None:
                continue
            full = name if problem.unowned else f"{owner}.{name}"
            size = known.get((owner, "displacement_std"))
            if name == "displacement_mean" and size is not None:
                rounding = abs(truth.value) <= CANCELLATION * size.value
                found[full] = replace(truth, value=0.0) if rounding else truth
            else:
                found[full] = truth
    return found


def _of_the_zoo(names: tuple[str, ...]) -> dict[str, Scene]:
    """Scenes of the zoo by name; an empty dictionary where no name is given."""
    return zoo(*names) if names else {}


def _threshold(truth: Response) -> float:
    for pair in truth.impact_pairs.values():
        if isinstance(threshold := pair["speed_threshold"], float):
            return threshold
    return 0.0


def size_of(truths: Mapping[str, Estimate], name: str) -> float:
    """The size relative to which a difference of a quantity is stated: its true value, or of a mean
    displacement the standard deviation; 1 where that is 0."""
    deviation = truths.get(name.removesuffix("mean") + "std")
    if name.endswith("displacement_mean") and deviation is not None:
        return abs(deviation.value) or 1.0
    size = abs(truths[name].value)
    return size if size > 0.0 and math.isfinite(size) else 1.0
