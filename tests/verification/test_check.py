"""`check`: methods that agree pass, a wrong one is caught, approximations are only shown."""

import importlib
import io
import json
import math
import os
import re
import signal
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pytest
from rich.console import Console
from scipy.linalg import eigh
from scipy.optimize import brentq
from scipy.stats import norm, t, truncnorm

from stochvi import (
    ConstantLoad,
    Estimate,
    FilteredNoise,
    ImpactPair,
    Isolator,
    Matrices,
    NonlinearOscillator,
    NotApplicable,
    Oscillator,
    PowerLaw,
    Response,
    Restitution,
    Scene,
    Sine,
    TabulatedNoise,
    Viscoelastic,
    WhiteNoise,
    average,
    check,
    exact,
    explain,
    first_passage,
    fokker_planck,
    load_scene,
    simulate,
    transient,
)
from stochvi.cli import main
from stochvi.model.coverage import natural_modes
from stochvi.model.model import model_of
from stochvi.motion.choose_plan import make_plan, plan_several
from stochvi.motion.plan import lossiest
from stochvi.results import Interrupted
from stochvi.results.base import CoordinateResponse
from stochvi.results.deadline import Deadline, asked_for
from stochvi.results.estimates import Cost, normal_score, student_quantile
from stochvi.sampling.run import Run
from stochvi.sampling.workers import pool_of
from stochvi.scenes.datasets import data_folder, shipped_scene, zoo_files
from stochvi.scenes.scene import scene_from
from stochvi.testing import known_answers
from stochvi.verification import check_many, zoo
from stochvi.verification.check import (
    AGREES,
    APPROXIMATE,
    BALANCE,
    BIAS_UNKNOWN,
    DISAGREES,
    FAMILY_ALARM_RATE,
    OTHER_THRESHOLD,
    TOO_RARE,
    ZERO,
    MethodResponses,
    compare,
    compare_many,
    degrees_of_freedom,
    seeds_of,
    single_alarm_rate,
)
from stochvi.views.pages import print_told
from stochvi.views.verification import explanation_told
from support.known import oscillator


def test_methods_count_the_same_impacts_where_a_law_has_a_power() -> None:
    """The closed form counts impacts of all speeds, and so do the others beside it."""
    scene = Scene(
        structure=Oscillator(mass=10.0, damping=5.0, stiffness=1000.0),
        impact_pairs=[ImpactPair(clearance=0.05, law=PowerLaw(coefficient=1e6, exponent=1.7))],
        excitations=[WhiteNoise(intensity=5.0)],
    )
    found = check(scene, rel_error=0.1, seed=1)
    assert not [each for each in found.comparisons if each.verdict == DISAGREES]
    assert {each.impact_pairs["stops"]["speed_threshold"] for each in found.responses} == {0.0}


@pytest.mark.parametrize("name", ["oscillator-elastic", "oscillator-lossy", "isolator-truck"])
def test_shipped_scenes_pass(name: str) -> None:
    verdict = check(load_scene(shipped_scene(name)), rel_error=0.005, seed=3)
    assert verdict.passed
    assert verdict.z > 2.9
    assert any(row.verdict == APPROXIMATE for row in verdict.comparisons)
    assert verdict.to_dict()["passed"] is True


def tampered(response: Response, quantity: str, factor: float) -> Response:
    def change(group: dict) -> dict:
        return {
            owner: {
                name: replace(item, value=item.value * factor)
                if name == quantity and isinstance(item, Estimate)
                else item
                for name, item in entries.items()
            }
            for owner, entries in group.items()
        }

    return replace(
        response,
        coordinates=change(dict(response.coordinates)),
        impact_pairs=change(dict(response.impact_pairs)),
    )


@pytest.mark.parametrize(
    "quantity", ["displacement_std", "velocity_std", "collision_rate", "impact_speed_square_rate"]
)
def test_a_tampered_quantity_is_the_only_one_that_disagrees(quantity: str) -> None:
    scene = oscillator(-1.0, 1.0, 1.0)
    truth, found = exact(scene), simulate(scene, rel_error=0.002, seed=5)
    assert compare([truth, found]).passed
    verdict = compare([truth, tampered(found, quantity, 1.02)])
    wrong = {row.quantity for row in verdict.comparisons if row.verdict == DISAGREES}
    assert wrong == {quantity}
    assert not verdict.passed


def test_a_lossy_scene_has_two_judges_and_a_tampered_one_is_caught() -> None:
    scene = oscillator(-1.0, 1.0, 0.8)
    verdict = check(scene, rel_error=0.002, seed=2)
    assert verdict.passed
    assert {row.method for row in verdict.comparisons} >= {"fokker-planck", "simulate"}
    solved, simulated = (
        next(response for response in verdict.responses if response.method == method)
        for method in ("fokker-planck", "simulate")
    )
    for quantity in ("displacement_std", "impact_speed_rate"):
        wrong = compare([tampered(solved, quantity, 1.02), simulated])
        found = {row.quantity for row in wrong.comparisons if row.verdict == DISAGREES}
        assert found == {quantity}


def test_the_picture_shows_how_much_of_what_is_granted_a_difference_takes() -> None:
    """Where biases are stated, scores are 0, and say nothing."""
    solved = fokker_planck(oscillator(-1.0, 1.0, 0.8))
    verdict = compare([solved, tampered(solved, "velocity_std", 1.0 + 1e-7)])
    judged = [row for row in verdict.comparisons if row.tolerance]
    assert all(not row.score for row in judged)
    (ax,) = verdict.plot().figure.axes
    drawn = {line.get_xdata()[0] for line in ax.lines if line.get_marker() == "o"}
    assert drawn == {row.difference / row.tolerance for row in judged} and len(drawn) > 1
    plt.close(ax.figure)


def test_an_estimate_of_unknown_bias_is_not_judged() -> None:
    solved = fokker_planck(oscillator(-1.0, 1.0, 0.8))
    other = tampered(solved, "velocity_std", 2.0)
    speed = other.coordinates["x"]["velocity_std"]
    assert isinstance(speed, Estimate)
    untold = {**other.coordinates["x"], "velocity_std": replace(speed, bias=None)}
    verdict = compare([solved, replace(other, coordinates={"x": untold})])
    assert verdict.passed
    found = {row.quantity for row in verdict.comparisons if row.verdict == BIAS_UNKNOWN}
    assert found == {"velocity_std"}


def test_a_broken_balance_disagrees() -> None:
    found = simulate(oscillator(-1.0, 1.0, 0.8), rel_error=0.005, seed=6)
    energy = replace(found.identities["energy"], value=0.05)
    verdict = compare([replace(found, identities={**found.identities, "energy": energy})])
    assert [row.quantity for row in verdict.comparisons if row.verdict == DISAGREES] == ["energy"]


def test_an_approximation_is_shown_and_not_failed() -> None:
    scene = oscillator(-1.0, 1.0, 1.0)
    verdict = compare([exact(scene)], [tampered(exact(scene), "velocity_std", 2.0)])
    assert verdict.passed
    errors = {row.quantity: row.relative for row in verdict.comparisons if row.of != "balance"}
    assert errors["velocity_std"] == pytest.approx(1.0)


def test_reasons_for_methods_left_out_are_listed() -> None:
    verdict = check(oscillator(-1.0, 1.0, 0.8), rel_error=0.02)
    assert any("restitution must be 1" in reason for reason in verdict.left_out)


def test_impacts_too_rare_to_judge_by_raise_no_alarm() -> None:
    verdict = check(oscillator(-6.0, 6.0, 1.0), rel_error=0.02)
    assert verdict.passed
    rates = [row for row in verdict.comparisons if row.quantity.startswith("collision")]
    assert {row.verdict for row in rates if row.method == "simulate"} == {TOO_RARE}


def test_a_scene_without_hits_names_what_finds_rare_ones() -> None:
    mount = Scene(
        structure=Isolator(mass=2.0, frequency_hz=12.0, zeta=0.1),
        impact_pairs=[ImpactPair(clearance=0.1, law=Viscoelastic(stiffness=1e5, loss_factor=0.3))],
        excitations=[TabulatedNoise(profile="mil-std-810h-truck-vertical-5hz")],
    )
    free = mount.replace(impact_pairs=[])
    found = [
        replace(simulate(each, paths=8, duration=2.0, threads=1), identities={})
        for each in (mount, free)
    ]
    assert ["no impact was seen" in compare([each]).summary() for each in found] == [True, False]


def test_nothing_to_judge_is_no_pass() -> None:
    verdict = check(oscillator(-1.0, 1.0, 1.0, damping=0.0), rel_error=0.02)
    assert not verdict.passed
    assert "nothing could be judged" in verdict.summary()


@pytest.mark.usefixtures("early_end")
def test_an_unfinished_simulation_is_no_pass_and_says_why() -> None:
    found = check(oscillator(-1.0, 1.0, 1.0), rel_error=1e-5)
    assert not found.passed
    assert found.summary().startswith("simulate stopped early")
    assert "raise budget" in found.summary()


@pytest.mark.parametrize("gap", [None, 1.0])
def test_a_number_that_is_zero_on_every_path_was_not_compared(gap: float | None) -> None:
    """The synthesis of a table has no mean, whatever the method does: no evidence for it."""
    pairs = [] if gap is None else [ImpactPair(upper=gap, law=Restitution(coefficient=0.8))]
    scene = Scene(
        structure=Isolator(frequency_hz=12.0, zeta=0.1),
        impact_pairs=pairs,
        excitations=[TabulatedNoise(profile="mil-std-810h-truck-vertical-5hz")],
    )
    verdict = check(scene, rel_error=0.1)
    rows = [row for row in verdict.comparisons if row.method == "simulate"]
    (force,) = (row for row in rows if (row.of, row.quantity) == ("balance", "force"))
    assert abs(force.value) < 1e-15
    assert (force.verdict, force.tolerance, force.score) == (ZERO, None, None)
    for row in rows:
        assert (row.verdict == ZERO) == (row.quantity in ("force", "displacement_mean"))


def test_a_mean_that_hits_push_away_is_compared() -> None:
    verdict = check(oscillator(-1.0, 1.0, 1.0), rel_error=0.05)
    assert ZERO not in {row.verdict for row in verdict.comparisons}


def test_rates_above_another_speed_are_not_compared() -> None:
    """Averaging counts all impacts, the reference those above a threshold; F1 counts all."""
    scene = oscillator(-1.0, 1.0, 0.8)
    verdict = compare([fokker_planck(scene)], [average(scene)])
    found = {
        row.quantity: row.verdict for row in verdict.comparisons if row.method[:7] == "average"
    }
    assert found["collision_rate"] == found["impact_speed_mean"] == OTHER_THRESHOLD
    assert found["impact_speed_rate"] == found["velocity_std"] == APPROXIMATE
    elastic = oscillator(-1.0, 1.0, 1.0)
    alike = compare([exact(elastic)], [average(elastic)])
    assert OTHER_THRESHOLD not in {row.verdict for row in alike.comparisons}


def test_a_coordinate_at_rest_agrees_whatever_rounding_leaves() -> None:
    """Rounding errors of one coordinate beside the motion of another are not compared; a motion
    that is small, but larger than that, is."""

    def answer(method: str, y: float) -> Response:
        coordinates = {
            name: CoordinateResponse(displacement_std=Estimate(value=value, how=method))
            for name, value in (("x", 1e-3), ("y", y))
        }
        return Response(
            method=method, coordinates=coordinates, impact_pairs={}, identities={}, effects=[],
            assumptions=[], warnings=[], cost=Cost(), provenance={},
        )  # fmt: skip

    for one, other, agrees in ((1e-19, 2e-19, True), (1e-9, 2e-9, False)):
        found = compare([answer("one", one), answer("other", other)])
        assert found.passed == agrees


# ------------------------------------------------------------------------------
# The zoo: what ships, and one verdict over many scenes.
# ------------------------------------------------------------------------------


SHARE = ("linear", "elastic-unequal-gaps", "lossy-0.95", "spring-stops")


# What ships --------------------------------------------------------------------------------


def test_the_zoo_holds_every_kind_of_structure_law_and_excitation() -> None:
    scenes = list(zoo().values())
    assert len(scenes) >= 60
    assert {scene.structure.kind for scene in scenes} == {"oscillator", "isolator", "matrices"}
    pairs = [pair for scene in scenes for pair in scene.impact_pairs]
    laws = {law.kind for pair in pairs for _, law in pair.stops()}
    assert laws == {"restitution", "elastic", "viscoelastic", "hertz", "table"}
    kinds = {excitation.kind for scene in scenes for excitation in scene.excitations}
    assert kinds == {"white", "psd", "filtered", "sine", "constant", "road", "record"}
    assert {len(pair.stops()) for pair in pairs} == {1, 2}


@pytest.mark.parametrize("name", zoo_files())
def test_a_scene_of_the_zoo_says_what_it_is_for_and_is_its_own_document(name: str) -> None:
    text = zoo_files()[name].read_text(encoding="utf-8")
    assert re.match(r'title = ".+"\n# .+\n\n\[structure\]', text)
    scene = zoo(name)[name]
    assert scene_from(scene.document()) == scene


def test_the_readme_lists_every_scene_and_who_knows_it() -> None:
    text = (data_folder() / "scenes" / "zoo" / "README.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\|.*\| ([^|]+) \| (`.*`) \|$", text, re.M)
    known = [(name, by) for by, names in rows for name in re.findall(r"`(\S+)`", names)]
    assert sorted(name for name, _ in known) == sorted(zoo_files())
    assert {name for name, by in known if by != "Monte Carlo alone"} == set(known_answers())


def test_a_name_that_is_not_in_the_zoo_is_answered_with_those_that_are() -> None:
    with pytest.raises(ValueError, match=r"'lossy'; known: .*lossy-0\.5"):
        zoo("lossy")


# One verdict over many ----------------------------------------------------------------------


def test_a_share_of_the_zoo_passes_under_one_alarm_rate() -> None:
    found = check_many(zoo(*SHARE), rel_error=0.03, seed=4, threads=1)
    assert found.passed, found
    rows = [row for verdict in found.checks.values() for row in verdict.comparisons]
    judged = [row for row in rows if row.tolerance is not None]
    assert found.judged == len(judged)
    single = 2.0 * norm.sf(found.z)
    assert 1.0 - (1.0 - single) ** found.judged == pytest.approx(FAMILY_ALARM_RATE)
    alone = check(zoo("linear")["linear"], rel_error=0.03)
    assert found.z > alone.z
    document = json.loads(json.dumps(found.to_dict(), allow_nan=False))
    assert sum(len(scene["comparisons"]) for scene in document["scenes"].values()) == len(rows)
    assert set(found.overview()["verdict"]) == {"passed"}
    assert len(set(found.seeds.values())) == len(SHARE)


def test_a_scene_of_balances_alone_is_not_said_to_be_compared() -> None:
    found = check_many(zoo("lossy-0.5"), rel_error=0.05, threads=1)
    (verdict,) = found.checks.values()
    rows = [row for row in verdict.comparisons if row.of == BALANCE]
    alone = replace(found, checks={"alone": replace(verdict, comparisons=rows)})
    assert set(found.overview()["verdict"]) == {"passed"} and alone.passed
    assert set(alone.overview()["verdict"]) == {"balances hold"}


def wrong_by(response: Response, quantity: str, factor: float) -> Response:
    known = dict(response.coordinates["x"])
    estimate = known[quantity]
    assert isinstance(estimate, Estimate)
    known[quantity] = replace(estimate, value=factor * estimate.value)
    return replace(response, coordinates={"x": known})


def test_scenes_share_a_budget_and_those_left_out_are_not_passed() -> None:
    scenes = zoo("linear", "lossy-0.95")
    found = check_many(scenes, rel_error=0.0005, budget=1e-3)
    assert list(found.checks) == list(scenes)
    assert not found.passed
    assert found.checks["linear"].comparisons  # judged by what was reached
    assert not found.checks["lossy-0.95"].comparisons
    assert "no time was left" in found.checks["lossy-0.95"].summary()


@pytest.mark.parametrize("several", [False, True])
def test_ctrl_c_leaves_the_verdict_on_what_there_is(several: bool) -> None:
    scenes = zoo("linear", "lossy-0.95")
    heard: list[str] = []

    def once(_share: float, sentence: str) -> None:
        if "compiling" not in sentence and not heard:
            heard.append(sentence)
            os.kill(os.getpid(), signal.SIGINT)

    ask: Any = partial(check_many, scenes) if several else partial(check, scenes["linear"])
    with pytest.raises(Interrupted) as stopped:
        ask(rel_error=0.0005, progress=once)
    assert heard
    assert stopped.value.partial.interrupted
    assert not stopped.value.partial.passed


def test_one_wrong_number_in_one_scene_is_found_and_named() -> None:
    scenes = zoo(*SHARE[:2])
    found = {
        name: MethodResponses(responses=[exact(scene), simulate(scene, rel_error=0.01, seed=8)])
        for name, scene in scenes.items()
    }
    assert compare_many(found).passed
    first, second = found["linear"].responses
    found["linear"] = MethodResponses(responses=[first, wrong_by(second, "velocity_std", 1.05)])
    verdict = compare_many(found)
    assert [(name, row.quantity) for name, row in verdict.alarms] == [("linear", "velocity_std")]
    assert verdict.summary().endswith("DISAGREE: velocity_std of linear")
    assert not verdict.passed


def test_nothing_to_check_is_no_pass() -> None:
    assert not check_many({}).passed


# Student's distribution ------------------------------------------------------------


@pytest.mark.parametrize("degrees", [5.0, 63.0, math.inf])
def test_quantiles_and_scores_are_those_of_student(degrees: float) -> None:
    rate = single_alarm_rate(200)
    law = norm if math.isinf(degrees) else t(degrees)
    quantile = student_quantile(rate, degrees)
    assert 2.0 * law.sf(quantile) == pytest.approx(rate)
    score = normal_score(-0.1 * quantile, 0.1, degrees)
    assert score == pytest.approx(-norm.isf(rate / 2.0))


def test_degrees_of_freedom_of_one_sample_and_of_two() -> None:
    few, many, none = (Response(
        method="", coordinates={}, impact_pairs={}, cost=Cost(paths=paths)
    ) for paths in (11, 41, 0))  # fmt: skip
    assert degrees_of_freedom(few, none, (0.1, 0.0)) == pytest.approx(10.0)
    assert degrees_of_freedom(few, many, (0.1, 0.1)) == pytest.approx(4.0 / (1 / 10 + 1 / 40))
    assert math.isinf(degrees_of_freedom(none, none, (0.0, 0.0)))


def test_fewer_paths_are_granted_more() -> None:
    scene = zoo("linear")["linear"]
    truth, found = exact(scene), simulate(scene, paths=64, duration=50.0, seed=1)
    few, many = (
        compare_many(
            {"linear": MethodResponses(responses=[truth, replace(found, cost=Cost(paths=paths))])}
        ).to_frame()["tolerance"]
        for paths in (16, 16_000)
    )
    assert (few[many > 1e-6] > 1.05 * many[many > 1e-6]).any()
    assert (few >= many).all()


def test_the_error_of_a_sampled_bias_counts() -> None:
    truth = exact(zoo("linear")["linear"])
    value = replace(truth.coordinates["x"]["velocity_std"], value=1.02, standard_error=0.001)

    def verdict(bias_error: float) -> str:
        own = replace(value, bias=0.01, bias_error=bias_error)
        response = replace(truth, method="mine", coordinates={"x": {"velocity_std": own}})
        rows = (
            compare_many({"": MethodResponses(responses=[truth, response])}).checks[""].comparisons
        )
        return next(row.verdict for row in rows if row.method == "mine" and row.of == "x")

    assert verdict(0.0) == DISAGREES
    assert verdict(0.005) == AGREES


def test_seeds_differ_from_scene_to_scene_and_do_not_depend_on_their_number() -> None:
    assert list(seeds_of(3, 5))[:2] == list(seeds_of(3, 2))
    assert len({*seeds_of(0, 50), *seeds_of(1, 50)}) == 100


def test_the_command_judges_several_files_together(tmp_path, capsys) -> None:
    files = [str(zoo_files()[name]) for name in SHARE[:2]]
    options = ["--rel-error", "0.03", "--threads", "1", "--out", str(tmp_path), "--json", "-"]
    main(["check", *files, *options], standalone_mode=False)
    printed = capsys.readouterr()
    document = json.loads(printed.out)
    assert document["passed"] and set(document["scenes"]) == set(files)
    assert "2 scenes" in " ".join(printed.err.split())
    assert {path.name for path in tmp_path.iterdir()} == {"check.csv", "scores.png"}


def test_the_command_refuses_a_scene_named_twice(capsys) -> None:
    name = str(zoo_files()["linear"])
    with pytest.raises(SystemExit) as stop:
        main(["check", name, name])
    assert stop.value.code == 2
    assert f"needs each scene once, got {name} twice" in capsys.readouterr().err


def test_the_command_without_a_scene_says_what_it_takes(capsys) -> None:
    with pytest.raises(SystemExit) as failure:
        main(["check"], standalone_mode=False)
    assert failure.value.code == 2
    assert "a scene file, several, or --zoo" in capsys.readouterr().err


# ------------------------------------------------------------------------------
# `explain`: effects present and absent, methods, and a price that comes true.
# ------------------------------------------------------------------------------


simulation = importlib.import_module("stochvi.methods.monte_carlo")
stationary = importlib.import_module("stochvi.methods.fokker_planck.stationary")


def test_what_is_absent_is_told() -> None:
    told = explain(oscillator(None, 1.0, 0.8, load=0.5))
    assert told.effects == ("white noise on x", "constant load on x", "rigid stop upper")
    excitations = ("filtered noise", "tabulated noise", "sine", "modulation", "pulses")
    assert told.absent == (*excitations, "stop lower")
    for method in ("average", "fokker-planck", "linearise", "simulate"):
        assert told.methods[method] == "applies"
    assert "restitution must be 1" in told.methods["exact"]


class PricedInSteps(simulation.PricedRounds):
    """The price where each step takes a second, and nothing else any time."""

    _of_worker, _before_round = 1.0, 0.0


@pytest.mark.parametrize(
    ("scene", "rel_error"),
    [
        (oscillator(-1.0, 1.0, 1.0), 0.001),
        (oscillator(-1.0, 1.0, 1.0), 0.01),  # which takes less than the first round
        (oscillator(-2.0, 2.0, 0.8), 0.01),  # whose step a pilot chooses
        (oscillator(-1.0, 1.0, 0.1), 0.01),  # and may halve: it took a sixteenth of the price
        (oscillator(-2.0, 2.0, 0.1), 0.01),  # or 2.5 times the price
    ],
    ids=["many rounds", "one round", "with a pilot", "lossy", "lossy and far"],
)
def test_the_predicted_price_is_that_of_the_run(
    monkeypatch: pytest.MonkeyPatch, scene: Scene, rel_error: float
) -> None:
    """Times on a shared machine wander: the steps behind them are compared, which do not."""
    with pool_of(None, 1) as pool:
        run = simulation.Simulation(
            scene, make_plan(model_of(scene)), Run(pool, Deadline.after(None)), 0.0, 0
        )
        pilot = PricedInSteps(run)
        run.add_paths(pilot.first, pilot.more)
    error = max(simulation.relative_standard_errors(run).values())
    made, add_paths = [], simulation.Simulation.add_paths

    def counted(self: Any, *how: Any) -> bool:
        enough = add_paths(self, *how)
        made.append(self.steps)
        return enough

    monkeypatch.setattr(simulation.Simulation, "add_paths", counted)
    simulate(scene, rel_error=rel_error, seed=1, threads=1)
    price = pilot.seconds_to(rel_error, error)
    least, most = pilot.seconds_between(rel_error, error)
    assert least <= price <= most
    assert 0.5 * least < sum(made) < 2.0 * most
    if lossiest(run.model) > 0.5:  # the pilot decides how often the step is halved
        assert 0.5 < price / sum(made) < 2.0
    if run.plan.elastic:
        assert least == price == most


def test_a_command_has_its_start_beside_the_price() -> None:
    told = explain(oscillator(-1.0, 1.0, 1.0), threads=1)
    before, after = told.simulation, told.with_start(2.0).simulation
    assert before is not None and after is not None and after.seconds == before.seconds
    assert before.start_seconds > 0.0 and after.start_seconds == before.start_seconds + 2.0
    printed = io.StringIO()
    print_told(Console(file=printed, width=200), explanation_told(told.with_start(2.0)))
    assert "to start: about 2 s, in every run" in printed.getvalue()


def balanced_speed(restitution: float) -> float:
    """Speed s at which b s^2 + (1 - R^2) p s^3 / sqrt(2 pi) is the power of the noise, with p the
    normal density between both stops: of the oscillator of these tests, with stops at -1 and 1."""

    def missing(s: float) -> float:
        law = truncnorm(-1.0 / s, 1.0 / s, scale=s)
        hits = 2.0 * law.pdf(1.0) * s**3 / math.sqrt(2.0 * math.pi)
        return float(0.1 * s**2 + (1.0 - restitution**2) * hits - 0.1)

    return float(brentq(missing, 0.1, 2.0))


def test_all_methods_count_impacts_above_one_speed() -> None:
    """It is that of the balance of energy where it has a closed form, and one number anywhere."""
    lossy = oscillator(-1.0, 1.0, 0.8)
    unit = {"mass": 1.0, "damping": 0.1, "stiffness": 1.0}
    noise = [WhiteNoise(intensity=0.2)]
    duffing = Scene(
        structure=Oscillator(**unit, spring={"kind": "duffing", "cubic_stiffness": 2.0}),
        impact_pairs=lossy.impact_pairs, excitations=noise,
    )  # fmt: skip
    soft = Scene(
        structure=Oscillator(**unit), excitations=noise,
        impact_pairs=[ImpactPair(upper=1.0, law=Viscoelastic(stiffness=5.0, damping_ratio=0.2))],
    )  # fmt: skip
    truck = load_scene(shipped_scene("isolator-truck"))
    for scene in (lossy, duffing, soft, truck):
        model = model_of(scene)
        plans = [make_plan(model)]
        plans += [] if model.functions else [plan_several(model, None, None)]
        counted = {plan.layout.thresholds["stops"] for plan in plans}
        if scene is not truck:
            counted.add(stationary._asked(scene, 0.1, None)[1])
        assert len(counted) == 1 and counted.pop() > 0.0
    plan = make_plan(model_of(lossy))
    assert plan.layout.thresholds["stops"] == pytest.approx(0.05 * balanced_speed(0.8), rel=1e-6)


SOME = (
    "linear",
    "lossy-unequal-gaps",
    "elastic-preload",
    "filtered-lossy",
    "psd-own-table",
    "sine-on-random",
    "spring-stops",
    "absorber-lossy",
    "two-storeys-linear",
)
"""Of the zoo, one of each kind; all of them take more than half a minute."""


@pytest.mark.parametrize("name", SOME)
def test_every_kind_of_scene_is_explained(name: str) -> None:
    told = explain(zoo(name)[name], threads=1)
    json.loads(json.dumps(told.to_dict(), allow_nan=False))
    assert told.methods["simulate"] == "applies" and told.simulation is not None
    assert set(told.effects) == set(zoo(name)[name].effects())


def test_a_cost_that_cannot_be_told_is_unknown() -> None:
    plan = explain(oscillator(-9.0, 9.0, 1.0)).simulation
    assert plan is not None
    assert set(plan.seconds.values()) == {None}
    assert plan.governed_by == "no impact was seen"


def test_a_scene_that_is_not_simulated_says_why() -> None:
    undamped = Scene(
        structure=Isolator(frequency_hz=12.0, zeta=0.0),
        excitations=[TabulatedNoise(profile="navmat-p-9492")],
    )
    told = explain(undamped)
    assert told.simulation is None
    assert "give a spring its damper" in told.methods["simulate"]
    assert json.loads(json.dumps(told.to_dict(), allow_nan=False))["method"] == "explain"


def test_white_noise_beside_a_table_reaches_the_resonance() -> None:
    mixed = Scene(
        structure=Isolator(frequency_hz=12.0, zeta=0.1),
        excitations=[TabulatedNoise(profile="navmat-p-9492"), WhiteNoise(intensity=1.0)],
    )
    assert "outside the table" not in " ".join(explain(mixed).notes)


def test_how_much_of_a_table_was_taken_is_said(tmp_path: Path) -> None:
    (tmp_path / "floor.csv").write_text("0 0\n10 0.02\n60 0.02\n")
    table = TabulatedNoise(file=str(tmp_path / "floor.csv"), unit="g2/Hz", level_db=6.0)
    mount = Isolator(frequency_hz=12.0, zeta=0.1)
    # 0.02 g^2/Hz over 50 Hz and half of that over 10 Hz, raised by 6 dB; 100 points stand for the
    # straight line from 0 Hz
    assert explain(Scene(structure=mount, excitations=[table])).assumptions[0] == (
        "tabulated noise on base: floor.csv, at +6 dB, 102 points in g2/Hz, 0.01 to 60 Hz, "
        "2.093 g rms"
    )
    force = TabulatedNoise(frequency_hz=[1.0, 3.0], density=[8.0, 8.0], unit="N2/Hz", on="x")
    fixed = Oscillator(mass=1.0, damping=0.5, stiffness=99.0)
    assert "4 N rms" in explain(Scene(structure=fixed, excitations=[force])).assumptions[0]


@pytest.mark.parametrize("lower", [-1.0, None])
def test_steps_of_a_path_are_those_of_the_plan(lower: float | None) -> None:
    plan = explain(oscillator(lower, 1.0, 1.0)).simulation
    assert plan is not None
    assert plan.steps_per_path == pytest.approx((plan.burn_in + plan.duration) / plan.step, abs=2)


def test_a_linearisation_that_takes_long_leaves_time_for_the_rest(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Of 40 masses, or a table of 20,000 lines, it takes seconds."""
    turns = [0]

    def endless(scene: Scene) -> None:
        for turns[0] in range(10**9):
            pass

    monkeypatch.setattr("stochvi.verification.check.linearise", endless)
    # what is left of 0.3 s may be nothing on a machine that is busy
    found = explain(oscillator(-1.0, 1.0, 0.8), threads=1, budget=2.0)
    assert 0 < turns[0] < 10**9 - 1 and found.methods["linearise"] == "applies"
    assert found.simulation is not None and found.simulation.nanoseconds_per_step > 0.0


def test_modes_of_many_masses_are_described() -> None:
    """In a mode of 50 masses none has much of the kinetic energy."""
    chain = 2.0 * np.eye(50) - np.eye(50, k=1) - np.eye(50, k=-1)
    structure = Matrices(
        coordinates=[f"m{number}" for number in range(50)],
        mass=np.eye(50).tolist(), damping=chain.tolist(), stiffness=(1e3 * chain).tolist(),
    )  # fmt: skip
    scene = Scene(structure=structure, excitations=[WhiteNoise(intensity=1.0, on="m0")])
    assert all(mode.motion for mode in natural_modes(model_of(scene)))


def test_a_plan_that_takes_minutes_is_not_made(monkeypatch: pytest.MonkeyPatch) -> None:
    """A table of 99,000 lines on 20 masses used to take minutes, and 4 GB, for a limit of 3 s. Here
    it has an eighth of the lines, for a tenth of the time."""
    monkeypatch.setattr(
        "stochvi.verification.check.prospect", lambda *_, **__: pytest.fail("not in time")
    )
    # the guard of budgets goes by the clock of a machine that may be busy
    monkeypatch.setattr("stochvi.sampling.calculations.ended_by", lambda _: nullcontext())
    frequency = np.linspace(5.0, 2000.0, 12_000)
    masses = 20
    chain = 2.0 * np.eye(masses) - np.eye(masses, k=1) - np.eye(masses, k=-1)
    scene = Scene(
        structure=Matrices(
            coordinates=[f"m{number}" for number in range(masses)],
            mass=np.eye(masses).tolist(),
            damping=(20.0 * chain).tolist(),
            stiffness=(1e5 * chain).tolist(),
        ),
        excitations=[
            TabulatedNoise(
                on="base",
                frequency_hz=frequency.tolist(),
                density=[0.01] * len(frequency),
                unit="g2/Hz",
            )
        ],
    )
    with asked_for(0.5):  # the start of a command has taken a part of it
        found = explain(scene, budget=0.3)
    assert found.simulation is None and found.methods["simulate"] == "applies"
    (told,) = (note for note in found.notes if "price of a simulation was not measured" in note)
    assert told.endswith("more than is left of the budget of 0.5 s; raise budget")


@pytest.mark.parametrize(("share", "pilot"), [(0.8, False), (0.2, True)])
def test_two_paths_that_take_all_the_time_of_a_pilot_are_not_begun(
    monkeypatch: pytest.MonkeyPatch, share: float, pilot: bool
) -> None:
    """They ended after the limit of 3 s, and said nothing of errors."""
    begun: list[int] = []
    price = share * simulation.LEAST_PILOT_SECONDS
    monkeypatch.setattr(simulation, "seconds_of_first_paths", lambda *_: price)
    monkeypatch.setattr(
        simulation.Simulation, "add_paths", lambda _, first, more: begun.append(first)
    )
    found = explain(oscillator(-1.0, 1.0, 0.8), threads=1, budget=1e-3).simulation
    assert found is not None and bool(begun) is pilot
    steps = simulation.FEWEST_AT_ONCE * found.steps_per_path
    assert found.nanoseconds_per_step == pytest.approx(1e9 * price / steps)


def test_a_scene_that_simulate_refuses_is_not_called_simulated() -> None:
    """A spring that is a function: the equation covers it, a simulation does not."""
    spring = NonlinearOscillator(mass=1.0, damping=0.1, restoring_force=lambda x: x + x**3)
    told = explain(Scene(structure=spring, excitations=[WhiteNoise(intensity=0.2)]))
    assert told.methods["fokker-planck"] == "applies"
    assert told.summary().startswith("not simulated: structure.kind must not be 'nonlinear'")
    printed = io.StringIO()
    print_told(Console(file=printed, width=200), explanation_told(told))
    assert printed.getvalue().startswith("in the scene:     white noise on x\nnot in the scene: ")
    told = explain(oscillator(-1.0, 1.0, 0.8), threads=1)
    assert told.summary().startswith("simulated: white noise on x")


@pytest.mark.parametrize("method", [fokker_planck, average, first_passage, transient])
def test_methods_for_white_noise_say_so_of_every_other_noise(method: Callable[..., Any]) -> None:
    """A sentence that lists a kind as covered must not be followed by one that refuses it."""
    unit = {"structure": Oscillator(mass=1.0, damping=0.1, stiffness=1.0)}
    times = {"times": [1.0]} if method in (first_passage, transient) else {}
    for noise, word in {
        FilteredNoise(intensity=0.2, frequency_hz=1.0, zeta=0.1): "filtered noise",
        TabulatedNoise(frequency_hz=[1.0, 9.0], density=[1.0, 1.0], unit="N2/Hz"): "a tabulated",
        Sine(amplitude=1.0, frequency_hz=1.0): "a sine",
    }.items():
        with pytest.raises(NotApplicable) as refused:
            method(Scene(**unit, excitations=[noise]), **times)
        got = f"excitation must be white noise, got {word}"
        assert any(each.startswith(got) for each in refused.value.conditions), refused.value


def test_modes_and_rest_are_those_of_the_matrices() -> None:
    """Against general solvers of eigenvalues and of equations, on three masses under a load."""
    m = np.diag([1.0, 0.5, 2.0])
    k = np.array([[30.0, -10.0, 0.0], [-10.0, 25.0, -15.0], [0.0, -15.0, 40.0]])
    scene = Scene(
        structure=Matrices(
            coordinates=["a", "b", "c"], mass=m.tolist(), damping=(0.01 * k).tolist(),
            stiffness=k.tolist(),
        ),
        impact_pairs=[
            ImpactPair(between=("a", "b"), lower=-0.3, upper=0.5, law=Restitution(coefficient=0.5))
        ],
        excitations=[WhiteNoise(intensity=0.2, on="b"), ConstantLoad(force=3.0, on="c")],
    )  # fmt: skip
    told = explain(scene, threads=1)
    squares, shapes = eigh(k, m)
    hertz = np.sqrt(squares) / (2.0 * math.pi)
    assert list(told.natural_frequency_hz) == pytest.approx(hertz, rel=1e-9)
    for mode, frequency, square in zip(told.modes, hertz, squares, strict=True):
        assert mode.frequency_hz == pytest.approx(frequency, rel=1e-9)
        assert mode.damping_ratio == pytest.approx(0.005 * math.sqrt(square), rel=1e-9)
    moved = (shapes.T @ m @ np.ones(3)) ** 2  # shapes of unit modal mass
    found = [mode.effective_mass[""] for mode in told.modes]
    assert found == pytest.approx(moved, rel=1e-9) and sum(found) == pytest.approx(3.5)
    rest = np.linalg.solve(k, [0.0, 0.0, 3.0])
    assert list(told.rest.values()) == pytest.approx(rest, rel=1e-9)
    gap = told.rest_of_gaps["stops"]
    place = rest[0] - rest[1]
    assert (gap.position, gap.to_lower, gap.to_upper) == pytest.approx(
        (place, place + 0.3, 0.5 - place), rel=1e-9
    )


def test_states_are_those_of_masses_and_filters() -> None:
    """Two states for each mass, and two for each noise with a memory of its own."""
    noise = FilteredNoise(intensity=0.2, frequency_hz=1.0, zeta=0.1, on="x")
    unit = Oscillator(mass=1.0, damping=0.1, stiffness=1.0)
    two = Matrices(
        coordinates=["x", "y"], mass=[[1.0, 0.0], [0.0, 1.0]], damping=[[0.2, 0.0], [0.0, 0.3]],
        stiffness=[[2.0, -1.0], [-1.0, 2.0]],
    )  # fmt: skip
    for structure, excitation, states in (
        (unit, WhiteNoise(intensity=0.2), 2), (unit, noise, 4), (two, noise, 6)
    ):  # fmt: skip
        found = explain(Scene(structure=structure, excitations=[excitation]), threads=1).simulation
        assert found is not None and found.states == states
