"""reliability: the way that a pilot chooses, what it answers, and what it refuses."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.stats import beta

from stochvi import (
    Elastic,
    FilteredNoise,
    ImpactPair,
    Isolator,
    Matrices,
    NotApplicable,
    NotConverged,
    Oscillator,
    Restitution,
    Scene,
    SceneError,
    Sine,
    TabulatedNoise,
    Viscoelastic,
    WhiteNoise,
    exact,
    impacts,
    load_scene,
    reliability,
    screen,
    simulate,
)
from stochvi.results.base import Result
from stochvi.results.deadline import NEVER, Deadline
from stochvi.results.estimates import Cost, Estimate, logarithmic_interval, spoken_percent
from stochvi.sampling.calculations import DEFAULTS
from stochvi.sampling.run import Run as SampledRun
from stochvi.scenes.datasets import shipped_scene
from stochvi.scenes.impact_laws import Law
from stochvi.statistics.clusters import bursts
from stochvi.statistics.hardness import Limit
from stochvi.statistics.rare_hits import AfterCrossings, ImpactTrials, Windows, kinds_of, rare_hits
from stochvi.statistics.reliability import choice
from stochvi.statistics.reliability.choice import Jobs
from stochvi.statistics.reliability.missions import (
    NEGLIGIBLE,
    Chance,
    Reliability,
    _together,
    joint_chance,
    of_phases,
)
from stochvi.statistics.trial_splitting import Levels, moved, pilot, repetition
from stochvi.testing import assert_agrees
from stochvi.views.files import to_json
from support.accuracies import rel_errors, run_of
from support.commands import Run, one_document
from support.known import DOCUMENT, P_AT_3, RARE, TEN_PERIODS, oscillator, to_toml
from support.pairs import pair, uncoupled
from support.refusals import refusals

FREE, BOX, FAR = oscillator(), oscillator(-1.0, 1.0), oscillator(-4.5, 4.5)
PRELOADED = oscillator(None, -0.5)


def test_likely_events_are_counted_and_rare_ones_split() -> None:
    near = reliability(
        FREE, mission=TEN_PERIODS, barrier=2.0, start="rest", seed=1, threads=1, rel_error=0.1
    )
    assert near.chances["passage"].way == "crude"
    assert "missions suffice" in near.chances["passage"].why
    barrier, _, truth = RARE[0]
    rare = reliability(FREE, mission=TEN_PERIODS, barrier=barrier, start="rest", seed=1, threads=1)
    chance = rare.chances["passage"]
    assert chance.way == "splitting" and chance.levels > 5
    assert "crude simulation takes" in chance.why
    assert chance.estimate.standard_error < 0.07 * chance.estimate.value
    assert_agrees(chance.estimate, truth)
    assert chance.lower < chance.estimate.value < chance.upper
    assert chance.crude_seconds is not None and chance.crude_seconds > 100.0 * chance.seconds
    no_hit = rare.no_hit
    assert no_hit is not None and 1.0 - no_hit.value == pytest.approx(chance.estimate.value)
    assert rare.hits is None


def test_every_way_agrees() -> None:
    asked: dict[str, Any] = {"mission": TEN_PERIODS, "barrier": 3.0, "rel_error": 0.03}
    for way in ("crude", "splitting"):
        found = reliability(FREE, start="rest", way=way, seed=2, threads=1, **asked)  # type: ignore[arg-type]
        chance = found.chances["passage"]
        assert chance.way == way
        assert_agrees(chance.estimate, P_AT_3)
        assert (chance.wilson is None) == (way == "splitting")


def test_the_seed_does_not_choose_the_way() -> None:
    asked: dict[str, Any] = {"mission": TEN_PERIODS, "barrier": 3.0, "rel_error": 0.2}
    found = [
        reliability(FREE, start="rest", seed=seed, threads=1, **asked).chances["passage"]
        for seed in (1, 2)
    ]
    assert found[0].why == found[1].why
    assert found[0].estimate.value != found[1].estimate.value  # negative control


def test_a_stationary_start_is_a_matter_of_first_crossings() -> None:
    barrier, _, truth = RARE[2]
    found = reliability(FREE, mission=TEN_PERIODS, barrier=barrier, seed=1, threads=1)
    chance = found.chances["passage"]
    assert chance.way == "first crossings" and "none is waited for" in chance.why
    assert_agrees(chance.estimate, truth)
    ends = logarithmic_interval(
        chance.estimate.value, chance.estimate.standard_error, chance.trials - 1.0
    )
    assert (chance.lower, chance.upper) == pytest.approx(ends, rel=1e-12)


@pytest.mark.slow
def test_missions_shorter_than_what_settles_them() -> None:
    """Fast impacts of 5 s meet a bound, and 12 times their probability is about that of a
    minute."""
    box, asked = oscillator(-2.0, 2.0), {"impact_speed": 5.0, "seed": 1, "rel_error": 0.2}
    short, minute = (
        reliability(box, mission=mission, threads=1, **asked)  # type: ignore[arg-type]
        for mission in (5.0, 60.0)
    )
    rate = exact(box).impact_pairs["stops"]["collision_rate"]
    assert isinstance(rate, Estimate) and short.hits is not None
    assert_agrees(replace(short.hits, bias=0.0), 5.0 * rate.value)
    one, many = (each.chances["impact_speed"].estimate for each in (short, minute))
    assert one.value - 4.5 * one.standard_error < 5.0 * rate.value * math.exp(-12.5)
    # P(A or B) is at most P(A) + P(B), and clusters belong to both
    assert many.value - 12.0 * one.value < 4.5 * math.hypot(
        12.0 * one.standard_error, many.standard_error
    )
    assert many.value > 4.0 * one.value
    moment = reliability(oscillator(-2.5, 2.5, 0.8), mission=0.01, threads=1, rel_error=0.1)
    assert moment.hits is not None
    assert moment.chances["hit"].estimate.value > 10.0 * moment.hits.value
    (note,) = moment.warnings
    outside = math.erfc(2.5 / math.sqrt(2.0))
    assert f"{outside:.3g} of it is the probability" in note


def test_what_was_found_is_told_with_what_is_missing() -> None:
    with pytest.raises(NotConverged, match="impact speed: the budget") as caught:
        reliability(oscillator(-2.5, 2.5), mission=30.0, impact_speed=8.0, threads=1, budget=0.02)
    found = caught.value.partial
    assert "hit" in found.chances and "impact_speed" not in found.chances
    assert "impact_speed" in found.missing and "impact_speed" in found.to_dict()["missing"]
    assert "Impact speed: not found" in repr(found)


def test_what_the_spring_alone_brings_is_said() -> None:
    soft = FAR.model_copy(
        update={"impact_pairs": (ImpactPair(upper=2.0, law=Elastic(stiffness=100.0)),)}
    )
    asked: dict[str, Any] = {"mission": 5.0, "start": "rest", "threads": 1, "rel_error": 0.5}
    found = reliability(soft, peak_acceleration=1.9, **asked)
    assert any("the spring alone brings 2 m/s^2" in each for each in found.warnings)
    found = reliability(soft, peak_acceleration=2.1, **asked)
    assert not any("spring alone" in each for each in found.warnings)


def test_expected_hits_are_the_rate_times_the_mission() -> None:
    found = reliability(
        BOX, mission=TEN_PERIODS, impact_speed=4.0, seed=3, threads=1, rel_error=0.1
    )
    rate = exact(BOX).impact_pairs["stops"]["collision_rate"]
    assert isinstance(rate, Estimate) and found.hits is not None
    assert_agrees(replace(found.hits, bias=0.0), TEN_PERIODS * rate.value)
    speed = found.chances["impact_speed"].estimate
    assert (
        0.0 < speed.value < TEN_PERIODS * rate.value * math.exp(-8.0) + 4.5 * speed.standard_error
    )
    assert found.chances["hit"].estimate.value > 0.99
    # a mission of crude simulation at least 64 steps long, 100 of them at least for 10 %
    assert found.cost.steps - sum(chance.steps for chance in found.chances.values()) > 6400
    document = to_json(found.to_dict())
    assert "expected_hits" in document
    assert list(found.to_frame()["event"]) == ["hit", "impact_speed"]
    assert "Expected impacts in" in repr(found)


def test_accelerations_need_stops_that_give_way() -> None:
    soft = FAR.model_copy(
        update={"impact_pairs": (ImpactPair(upper=2.0, law=Elastic(stiffness=100.0)),)}
    )
    found = reliability(
        soft, mission=30.0, peak_acceleration=25.0, start="rest", seed=1, threads=1, rel_error=0.2
    )
    sharp = found.chances["peak_acceleration"].estimate.value
    assert 0.0 < sharp < found.chances["hit"].estimate.value
    with pytest.raises(NotApplicable, match="restitution alone"):
        reliability(FAR, mission=30.0, peak_acceleration=25.0)


WITH_A_MEMORY = Scene(
    structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
    impact_pairs=oscillator(-5.0, 5.0, 0.8).impact_pairs,
    excitations=[FilteredNoise(intensity=0.2, frequency_hz=0.2, zeta=0.5)],
)


def test_noise_with_a_memory_goes_by_what_is_given() -> None:
    scene = WITH_A_MEMORY
    found = reliability(scene, mission=600.0, impact_speed=0.5, seed=1, threads=1, rel_error=0.3)
    hit, fast = found.chances["hit"], found.chances["impact_speed"]
    assert (hit.way, fast.way) == ("first crossings", "bursts")
    assert 0.0 < fast.estimate.value < hit.estimate.value + 4.5 * hit.estimate.standard_error
    rate = bursts(scene, rel_error=0.3, seed=1, threads=1).hit_rate()
    assert found.hits is not None and found.hits.value == pytest.approx(600.0 * rate.value)


def test_what_is_never_seen_has_an_upper_limit_and_is_not_an_answer() -> None:
    with pytest.raises(NotConverged, match=r"at most .* \(95 %\); raise budget") as caught:
        reliability(
            WITH_A_MEMORY, mission=600.0, impact_speed=80.0, threads=1, rel_error=0.5, budget=1.0
        )
    found = caught.value.partial
    never = found.chances["impact_speed"]
    assert never.estimate.value == 0.0 == never.lower and 0.0 < never.upper < 1.0
    assert "An impact faster than 80 m/s in 10 min: below" in repr(found)
    assert found.hits is not None


test_arguments_out_of_range_are_named = refusals(
    lambda scene, arguments: reliability(scene, **({"mission": 10.0} | arguments)),
    (FREE, {"mission": 0.0, "barrier": 3.0}, "mission must be a positive number of seconds"),
    (FREE, {}, "barrier must be given where the scene has no impact_pair"),
    (BOX, {"barrier": 3.0}, "barrier must be left out where the scene has stops"),
    (FREE, {"barrier": (1.0, -1.0)}, "with lower < upper"),
    (FREE, {"barrier": 0.0}, "with lower < upper"),
    (FREE, {"barrier": (2.0, 2.0)}, "with lower < upper"),
    (FREE, {"barrier": (1.0, 2.0), "start": "rest"}, r"not between the barriers \(1 m, 2 m\)"),
    (FREE, {"barrier": (3.0, None), "start": "rest"}, r"balance at 0 m, .*\(3 m, none\)"),
    (PRELOADED, {"start": "rest"}, r"not between the stops \(none, -0.5 m\)"),
    (FREE, {"barrier": 3.0, "seed": -1}, r"seed must be in \[0, 2\^63\)"),
    (FREE, {"barrier": 3.0, "seed": 1.5}, "seed must be a whole number"),
    (FREE, {"barrier": 3.0, "seed": 2**80}, r"seed must be a whole number below 2\^63"),
    (FREE, {"barrier": 3.0, "threads": 0}, "threads must be at least 1"),
    (FREE, {"barrier": 3.0, "threads": -3}, "threads must be at least 1"),
    (FREE, {"barrier": 3.0, "budget": 0.0}, "budget must be a positive number of seconds"),
    (BOX, {"impact_speed": -1.0}, "impact_speed must be a positive number of m/s"),
    (BOX, {"start": "asleep"}, "start must be 'rest' or 'stationary'"),
    (BOX, {"way": "luck"}, "way must be 'crude', 'splitting'"),
    (BOX, {"way": "first crossings", "start": "rest"}, "needs start = 'stationary'"),
    (BOX, {"rel_error": 0.0}, "rel_error must be in"),
    (BOX, {"confidence": 95}, "confidence must be between 0 and 1, got 95; 95 % is 0.95"),
    (BOX, {"confidence": "95 %"}, "confidence must be a number, got '95 %'; write 0.95, without"),
    error=ValueError,
    pattern=True,
)


def test_a_start_beyond_the_barriers_is_a_mission_that_fails_at_once_and_is_said() -> None:
    found = reliability(FREE, mission=10.0, barrier=(3.0, None), threads=1, seed=1)
    assert found.chances["passage"].estimate.value > 0.95
    assert "not between the barriers (3 m, none)" in found.warnings[0]
    about = reliability(FREE, mission=10.0, barrier=(-0.5, 0.5), threads=1, seed=1)
    assert not any("not between" in each for each in about.warnings)


def test_what_does_not_apply_is_said() -> None:
    sine = BOX.model_copy(update={"excitations": (Sine(amplitude=1.0, frequency_hz=0.1),)})
    with pytest.raises(NotApplicable, match="got a sine alone"):
        reliability(sine, mission=10.0)
    filtered = BOX.model_copy(
        update={"excitations": (FilteredNoise(intensity=0.2, frequency_hz=0.2, zeta=0.5),)}
    )
    with pytest.raises(NotApplicable, match="stiffness must be positive"):
        reliability(oscillator(-1.0, 1.0, omega=0.0), mission=10.0)
    with pytest.raises(NotApplicable, match="start = 'rest' needs white noise"):
        reliability(filtered, mission=10.0, start="rest")
    with pytest.raises(NotApplicable, match="needs white noise; leave way out"):
        reliability(filtered, mission=10.0, way="crude")
    with pytest.raises(NotApplicable, match="without impact_pair"):
        reliability(FREE, mission=10.0, barrier=3.0, impact_speed=1.0, start="rest")
    with pytest.raises(NotApplicable, match="ask for a shorter mission"):
        reliability(FREE, mission=1e9, barrier=5.0, start="rest")
    with pytest.raises(NotConverged, match="raise budget or rel_error"):
        reliability(FREE, mission=1e5, barrier=5.0, start="rest", way="crude", budget=1e-3)


def test_chances_near_one_are_told_by_their_lower_end() -> None:
    found = Chance(
        event="hit", limit=None, estimate=Estimate(value=1.0), lower=0.99812, upper=1.0,
        confidence=0.95, rule="", way="", why="",
    )  # fmt: skip
    assert found.likely == "over 99.8 %"
    assert replace(found, lower=1.0).likely == spoken_percent(1.0)  # as size has it
    assert replace(found, lower=0.2).likely == "hardly known"
    assert replace(found, estimate=Estimate(value=0.9)).likely == "90 %"
    # such an end is the interval: it is not told twice
    said = SimpleNamespace(mission=60.0, chances={"hit": found}, missing={})
    assert Reliability.verdict(said) == "An impact in 1 min: over 99.8 % likely."  # type: ignore[arg-type]
    said.chances = {"hit": replace(found, estimate=Estimate(value=0.9), lower=0.88, upper=0.92)}
    assert "90 % likely (88 % to 92 %" in Reliability.verdict(said)  # type: ignore[arg-type]


def test_the_command(stochvi: Run, tmp_path: Any) -> None:
    scene = str(shipped_scene("oscillator-lossy"))
    done = stochvi(
        "reliability", scene, "--mission", "30", "--impact-speed", "2", "--start", "rest",
        "--rel-error", "0.3", "--threads", "1", "--json", "-", "--out", tmp_path,
    )  # fmt: skip
    assert done.code == 0
    document = one_document(done.out)
    assert document["method"] == "reliability" and document["mission"] == 30.0
    fast = document["chances"]["impact_speed"]
    assert 0.0 < fast["lower"] < fast["estimate"]["value"] < fast["upper"] < 1.0
    assert document["expected_hits"]["value"] > fast["estimate"]["value"]
    told = " ".join(done.err.split())
    assert "An impact faster than 2 m/s in 30 s: " in told and "Expected impacts" in told
    assert (tmp_path / "reliability.csv").exists()
    done = stochvi(
        "reliability", scene, "--mission", "30", "--impact-speed", "9", "--budget", "0.02",
        "--threads", "1", "--json", "-",
    )  # fmt: skip
    assert done.code == 1 and "not found" in done.err
    assert "impact_speed" in one_document(done.out)["missing"]
    done = stochvi("reliability", scene, "--mission", "30", "--barrier", "3")
    assert done.code == 2 and "barrier must be left out where the scene has stops" in done.err


@pytest.mark.parametrize(
    ("barrier", "code", "said"),
    [
        ("0", 2, "--barrier must be positive, or LO,HI"),
        ("2,1", 2, "with lower < upper, got (2.0, 1.0)"),
        ("1,2", 2, "not between the barriers (1 m, 2 m)"),
        ("3,", 2, "not between the barriers (3 m, none)"),
        (",3", 0, "passage"),
    ],
)
def test_a_barrier_on_the_command_line(
    stochvi: Run, tmp_path: Any, barrier: str, code: int, said: str
) -> None:  # fmt: skip
    path = tmp_path / "free.toml"
    free = {key: value for key, value in DOCUMENT.items() if key != "impact_pair"}
    path.write_text(to_toml(free), encoding="utf-8")
    options = ("--mission", "10", "--start", "rest", "--rel-error", "0.5", "--threads", "1")
    done = stochvi("reliability", path, f"--barrier={barrier}", *options)
    assert done.code == code and said in done.out + done.err


@pytest.mark.parametrize("gap", [30.0, 60.0])
def test_stops_that_are_out_of_reach_have_a_chance_that_is_known(gap: float) -> None:
    stops = {"lower": -gap, "upper": gap, "law": Restitution(coefficient=0.5)}
    scene = Scene(
        structure=Matrices(
            coordinates=("x", "z"), mass=[[1, 0], [0, 1]],
            damping=[[0.1, 0], [0, 0.1]], stiffness=[[1, 0], [0, 1]],
        ),
        impact_pairs=[ImpactPair(name=name, on=name, **stops) for name in ("x", "z")],
        excitations=[WhiteNoise(intensity=0.2, on="x"), WhiteNoise(intensity=0.2, on="z")],
    )  # fmt: skip
    # unit variance: crossings of one stop of four in a second, exp(-gap^2 / 2) / (2 pi)
    rice = 100.0 * 4.0 * math.exp(-(gap**2) / 2.0) / (2.0 * math.pi)
    chance = reliability(scene, mission=100.0, threads=1, seed=1).chances["hit"]
    assert chance.estimate.value == pytest.approx(rice, rel=0.05)
    assert chance.upper < 1e-100


def test_the_interval_of_expected_impacts_holds_their_bias() -> None:
    jobs = Jobs(run=SampledRun.of(DEFAULTS), confidence=0.95, deadline=NEVER)
    known = Estimate(value=24.0, standard_error=0.3, bias=0.0)
    low, high = jobs.interval(known, 100)
    wide = jobs.interval(replace(known, bias=19.0), 100)
    assert wide == pytest.approx((low - 19.0, high + 19.0))
    assert jobs.interval(replace(known, bias=40.0), 100)[0] == 0.0


def test_the_time_that_expected_impacts_leave_is_for_the_limits(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """They are found first, in an equal share; the last limit has all that is left."""
    now, asked = [0.0], list[tuple[str, float]]()
    monkeypatch.setattr("stochvi.results.deadline.time", SimpleNamespace(time=lambda: now[0]))

    def taking(name: str, seconds: float) -> Callable[..., Any]:
        def calculate(*arguments: Any, **_: Any) -> Any:
            asked.append((name, arguments[-1].deadline.left))
            now[0] += seconds
            return SimpleNamespace(event=name)

        return calculate

    monkeypatch.setattr(choice, "first_hit", taking("hit", 0.0))
    monkeypatch.setattr(choice, "_hits", taking("impacts", 3.0))
    monkeypatch.setattr(choice, "exceedance", taking("limit", 10.0))
    limits = [Limit("impact_speed", 1.0), Limit("peak_acceleration", 9.0)]
    with run_of(rel_error=0.1, seed=1) as run:
        jobs = Jobs(run=run, confidence=0.95, deadline=Deadline.after(60.0))
        choice.by_conditioning(BOX, (-1.0, 1.0), limits, 10.0, jobs)
    assert asked[1:] == [("impacts", 20.0), ("limit", 28.5), ("limit", 47.0)]


# ------------------------------------------------------------------------------
# Probabilities of rare impacts by splitting of Gaussian records, against counting and each
# other.
# ------------------------------------------------------------------------------


NATURAL = 24.0 * math.pi
RUBBER = Viscoelastic(stiffness=100.0 * NATURAL**2, damping_ratio=0.2)


def truck(lower: float, upper: float, law: Law, upper_law: Law | None = None) -> Scene:
    """A 12 Hz mount on a truck, stops at so many standard deviations."""
    mount = Isolator(mass=1.0, damping=0.2 * NATURAL, stiffness=NATURAL**2)
    noise = TabulatedNoise(profile="mil-std-810h-truck-vertical-5hz")
    scene = Scene(structure=mount, excitations=[noise])
    std = screen(scene).displacement_std
    pair = ImpactPair(
        lower=-lower * std, upper=upper * std, lower_law=law, upper_law=upper_law or law
    )
    return scene.model_copy(update={"impact_pairs": (pair,)})


def estimate(kind: ImpactTrials, rows: np.ndarray, mission: float) -> Estimate:
    """The probability in a mission that repetitions show, with the error of their scatter."""
    count, mean = len(rows), rows.mean(axis=0)
    left_out = ((rows.sum(axis=0) - rows) / (count - 1)).T
    risks = kind.risk(left_out[0], left_out[2], left_out[3], mission)
    value = float(kind.risk(mean[0], mean[2], mean[3], mission))
    bias = value * kind.bias(float(mean[3]), mission)
    error = math.sqrt((count - 1) * float(np.var(risks)))
    return Estimate(value=value, standard_error=error, bias=bias)


def by_splitting(
    kind: ImpactTrials, limit: float, mission: float, count: int
) -> tuple[Levels, Estimate]:
    levels = pilot(kind, limit, NEVER)
    rows = np.array([repetition(kind, levels, i, NEVER) for i in range(count)])
    return levels, estimate(kind, rows, mission)


def difference(first: Estimate, second: Estimate, factor: float = 1.0) -> Estimate:
    return Estimate(
        value=first.value - factor * second.value,
        standard_error=math.hypot(first.standard_error, factor * second.standard_error),
        bias=(first.bias or 0.0) + factor * (second.bias or 0.0),
    )


@pytest.mark.slow
@rel_errors(0.5, 0.15)
def test_splitting_agrees_with_counting_and_bursts_with_the_whole_motion(rel_error: float) -> None:
    """Stops at two distances with two laws, so that one side cannot stand for the other."""
    scene = truck(3.8, 4.2, Elastic(stiffness=3.0 * NATURAL**2), RUBBER)
    limit, mission, count = 100.0, 30.0, math.ceil(2.0 / rel_error**2)
    bursts, windows = kinds_of(scene, "peak_acceleration", mission, rel_error, 2, None)
    assert bursts.rare()
    _, split = by_splitting(bursts, limit, mission, count)
    levels, whole = by_splitting(windows, limit, mission, count)
    assert len(levels.levels) > 2
    at_once = Levels((limit,), (), True)
    rows = np.array([repetition(windows, at_once, i, NEVER) for i in range(3 * count)])
    counted = estimate(windows, rows, mission)
    for one, other in ((split, whole), (split, counted), (whole, counted)):
        assert_agrees(difference(one, other), 0.0)
    with pytest.raises(AssertionError):
        assert_agrees(difference(whole, split, 3.0), 0.0)


def test_moves_leave_the_law_of_the_records_as_it_is() -> None:
    bursts, _ = kinds_of(truck(4.0, 4.0, RUBBER), "impact_speed", 60.0, 0.05, 1, None)
    random = np.random.default_rng(3)
    trials = bursts.fresh(0)
    fresh = bursts.fresh(1).records
    for draw in range(2, 4):
        trials, kept = moved(bursts, trials, -math.inf, 0.7, draw, random)
    assert kept > 0.5  # minus infinity itself is not above the level
    middle = trials.records.shape[1] // 2

    def variance(records: np.ndarray) -> Estimate:
        squares = (records[:, middle, 0] / bursts.paths.motion.displacement_std[0]) ** 2
        error = float(squares.std(ddof=1)) / math.sqrt(len(squares))
        return Estimate(value=float(squares.mean()), standard_error=error)

    assert_agrees(variance(trials.records), 1.0)
    with pytest.raises(AssertionError):
        assert_agrees(variance(trials.records + fresh), 1.0)


@pytest.mark.slow
def test_where_hits_hardly_pause_the_whole_motion_is_looked_at() -> None:
    scene = truck(1.5, 1.5, Restitution(coefficient=0.6))
    found = rare_hits(scene, "impact_speed", 0.45, mission=60.0, rel_error=0.5, threads=1)
    assert isinstance(found.kind, Windows)
    assert 0.0 < found.lower < found.chance.value < found.upper <= 1.0


def test_a_chance_is_as_uncertain_as_its_rate_makes_it() -> None:
    """1 - exp(-rate T): the error follows the scatter of the repetitions to first order."""
    kind, _ = kinds_of(truck(4.5, 4.5, RUBBER), "impact_speed", 600.0, 0.5, 1, None)
    shares = np.linspace(0.9, 1.1, 16) * 0.7 / (kind.rate * 600.0)
    rows = np.array([[share, share, 0.0, 0.5] for share in shares])
    found = estimate(kind, rows, 600.0)
    rate = kind.rate * shares / (1.0 + 0.5 * kind.rate * (kind.window - kind.records.horizon))
    error = float(rate.std(ddof=1)) / math.sqrt(len(rate)) * 600.0
    assert found.value == pytest.approx(-math.expm1(-600.0 * float(rate.mean())), rel=1e-9)
    assert found.standard_error == pytest.approx(error * (1.0 - found.value), rel=1e-3)


def test_accelerations_of_rigid_stops_are_refused() -> None:
    scene = truck(4.0, 4.0, Restitution(coefficient=0.6))
    with pytest.raises(NotApplicable, match="a restitution alone does not give a force"):
        rare_hits(scene, "peak_acceleration", 100.0, mission=60.0)


FAST_AND_RARE = uncoupled(pair("x", "x", 4.2), pair("z", "z", 5.0))
"""Of two pairs that know nothing of each other one is hit twenty times as often, and the other one
at twice the speed."""


@pytest.mark.verify
@pytest.mark.parametrize("rel_error", [0.1])
def test_of_two_pairs_the_one_that_is_hit_seldom_and_hard_is_found(rel_error: float) -> None:
    """Beyond a limit that the often hit pair hardly reaches, the risk is that of the other one
    alone, which is one oscillator."""
    mission, limit = 1e4, 5.0
    rare = FAST_AND_RARE.replace(impact_pairs=FAST_AND_RARE.impact_pairs[1:])
    together, alone = (
        rare_hits(
            scene, "impact_speed", limit, mission=mission, rel_error=error, seed=seed, budget=None
        )
        for scene, error, seed in ((FAST_AND_RARE, rel_error, 3), (rare, 0.5 * rel_error, 4))
    )
    assert isinstance(together.kind, AfterCrossings)
    sides = together.kind.sides
    assert sides[0] > 10.0 * sides[-1]  # hardly a trial begins with the pair that decides
    assert_agrees(difference(together.chance, alone.chance), 0.0)
    with pytest.raises(AssertionError):
        assert_agrees(difference(together.chance, alone.chance, 4.0), 0.0)


def test_an_acceleration_counts_where_it_is_asked_for() -> None:
    """The score of all outputs is the larger one of those of either, now of one, now the other."""
    near = uncoupled(pair("x", "x", 1.0), pair("z", "z", 0.3))
    soft = [each.replace(law=Elastic(stiffness=20.0)) for each in near.impact_pairs]
    scene = near.replace(impact_pairs=soft, excitations=[near.excitations[0].replace(on="base")])

    def scores(*outputs: str) -> np.ndarray:
        kinds = kinds_of(scene, "peak_acceleration", 1e3, 0.5, 1, None, outputs or None)
        found = kinds[1].drawn(0).score
        return found[found > 0.0]

    both, x, z = scores(), scores("x"), scores("z")
    assert np.array_equal(both, np.maximum(x, z))
    assert np.any(x < z) and np.any(z < x)


# ------------------------------------------------------------------------------
# Missions of several phases: their scenes, and their joint risk.
# ------------------------------------------------------------------------------


PROFILE = "mil-std-810h-truck-vertical-5hz"


def mission(phases: list[dict[str, Any]], clearance: float = 0.0135) -> Scene:
    return Scene(
        structure=Isolator(frequency_hz=12.0, zeta=0.1),
        impact_pairs=[ImpactPair(clearance=clearance, law=Restitution(coefficient=0.7))],
        excitations=[{"kind": "psd", "profile": PROFILE}],
        phase=phases,
    )


ROAD = {"name": "road", "duration": 7200.0}
ROUGH = {"name": "rough", "duration": "10 min", "level_db": 2.0}
COLD = {"name": "cold", "duration": 600.0, "level_db": 2.0, "stiffness_factor": 0.9}


def test_the_risk_of_a_mission_is_that_of_its_phases_together() -> None:
    scene = mission([ROAD, ROUGH, COLD])
    found = reliability(scene, rel_error=0.2, seed=4)
    assert list(found.phases) == ["road", "rough", "cold"] and found.mission == 8400.0
    alone = [
        reliability(scene.in_phase(each.name), mission=each.duration, rel_error=0.2, seed=4 + k)
        for k, each in enumerate(scene.phases)
    ]
    survived = math.prod(1.0 - each.chances["hit"].estimate.value for each in alone)
    assert found.chances["hit"].estimate.value == pytest.approx(1.0 - survived, rel=1e-12)
    assert found.hits is not None
    assert found.hits.value == pytest.approx(sum(float(each.hits or 0) for each in alone), rel=1e-9)
    assert found.chances["hit"].why.startswith("phase cold has ")


def test_a_mission_without_stops_has_the_risk_of_its_barrier() -> None:
    """That of its phases, each alone."""
    scene = mission([ROAD, ROUGH]).replace(impact_pairs=())
    asked: dict[str, Any] = {"barrier": 0.012, "rel_error": 0.3, "threads": 1}
    found = reliability(scene, **asked, seed=1)
    alone = [
        reliability(scene.in_phase(each.name), mission=each.duration, **asked, seed=1 + k)
        for k, each in enumerate(scene.phases)
    ]
    survived = math.prod(1.0 - each.chances["passage"].estimate.value for each in alone)
    assert found.chances["passage"].estimate.value == pytest.approx(1.0 - survived, rel=1e-12)


def test_impacts_that_were_not_seen_in_a_phase_do_not_count_as_none() -> None:
    """A phase is hit in one mission of three, but no impact was simulated in it: the mean of the
    mission is at least a third, or it is not told."""
    scene = mission([ROAD, ROUGH])
    one = reliability(scene.in_phase("rough"), mission=600.0, rel_error=0.5, seed=1)
    run = SimpleNamespace(cost=lambda **_: Cost(wall_time=0.0), seed=0)

    def together(limit: float) -> tuple[Reliability, dict[str, str]]:
        hit = one.chances["hit"]
        likely = replace(hit, estimate=Estimate(value=0.3), lower=0.3, upper=0.3)
        unseen = Estimate(value=0.0, bias=None, upper_95=limit)
        seen = Estimate(value=0.03, standard_error=0.001, bias=0.0)
        phases = {
            "road": replace(one, chances={"hit": likely}, hits=unseen, hits_interval=(0.0, limit)),
            "rough": replace(one, hits=seen, hits_interval=(0.028, 0.032)),
        }
        missing: dict[str, str] = {}
        return _together(scene, phases, missing, {}, run), missing

    found, missing = together(5.0)
    assert found.hits is None and found.hits_interval is None
    assert missing == {"road, expected_hits": "no impact was seen; raise budget"}
    # few impacts that were not seen are a bias
    found, missing = together(0.002)
    assert found.hits is not None and not missing
    assert found.hits.value == 0.03 and found.hits.bias == pytest.approx(0.002)
    assert found.hits_interval is not None and found.hits_interval[1] > 0.0325


def test_a_phase_without_an_answer_leaves_what_is_known_of_the_others() -> None:
    """The probability is at least that of the phases that have one, and at most what Rice's number
    of crossings of the other allows; the impacts of a mission are not told without it."""
    scene = mission([ROAD, ROUGH])
    one = reliability(scene.in_phase("rough"), mission=600.0, rel_error=0.5, seed=1)
    began: list[str] = []

    def ask(phase: Scene, duration: float, run: SampledRun) -> Reliability:
        began.append(str(duration))
        if len(began) > 1:
            raise NotConverged("the budget ended before two paths were simulated; raise budget")
        return one

    with run_of(0.5) as run, pytest.raises(NotConverged) as short:
        of_phases(scene, ask, run)
    found = short.value.partial
    assert isinstance(found, Reliability) and len(began) == 2
    hit, alone = found.chances["hit"], one.chances["hit"]
    assert hit.estimate.value == pytest.approx(alone.estimate.value)
    assert hit.lower == pytest.approx(alone.lower) and hit.upper >= alone.upper
    assert found.hits is None and found.hits_interval is None
    assert list(found.missing) == ["rough, answer"] and "raise budget" in str(short.value)
    # where no phase has one there is none
    with run_of(0.5) as run, pytest.raises(NotConverged, match="two paths") as none:
        of_phases(scene, ask, run)
    assert none.value.partial is None


def test_two_halves_are_one_mission() -> None:
    whole = reliability(mission([]), mission=7200.0, rel_error=0.05, seed=1).chances["hit"]
    half = {"duration": 3600.0}
    halves = reliability(
        mission([half | {"name": "first"}, half | {"name": "second"}]), rel_error=0.05, seed=2
    ).chances["hit"]
    one, other = whole.estimate, halves.estimate
    assert abs(one.value - other.value) < math.hypot(one.reach(4.5), other.reach(4.5))
    # a mission of one half is told apart
    first = halves.estimate.value / 2.0
    assert abs(one.value - first) > math.hypot(one.reach(4.5), other.reach(4.5) / 2.0)


def test_a_phase_without_hits_is_bounded_and_not_simulated() -> None:
    quiet = {"name": "air", "duration": 3600.0, "level_db": -3.0}
    found = reliability(mission([ROUGH, quiet]), impact_speed=0.1, rel_error=0.3, seed=1)
    hit = found.phases["air"].chances["hit"]
    assert hit.estimate.value == 0.0 and hit.way == "Rice"
    known = reliability(mission([]).at_level(-3.0), mission=3600.0, rel_error=0.3, seed=1)
    seen = known.chances["hit"].estimate
    assert 0.3 * hit.upper < seen.value < hit.upper + seen.reach(4.5)
    assert hit.upper < NEGLIGIBLE
    assert found.chances["impact_speed"].estimate.value > 0.0
    assert any("phase air are not counted" in each for each in found.assumptions)
    document = json.loads(json.dumps(found.to_dict(), allow_nan=False))
    assert document["phases"]["air"]["chances"]["hit"]["estimate"]["value"] == 0.0


def test_intervals_hold_the_joint_probability_as_often_as_they_say() -> None:
    """Binomial phases with intervals of Clopper and Pearson, which hold a little more often."""
    random, trials, truth, inside = np.random.default_rng(5), 400, (0.02, 0.1, 0.005), 0
    joint, repetitions = 1.0 - math.prod(1.0 - p for p in truth), 2000
    narrow = 0
    for _ in range(repetitions):
        chances = {}
        for name, p in zip("abc", truth, strict=True):
            k = int(random.binomial(trials, p))
            low = float(beta.ppf(0.025, k, trials - k + 1)) if k else 0.0
            high = float(beta.ppf(0.975, k + 1, trials - k))
            seen = Estimate(value=k / trials, standard_error=math.sqrt(k) / trials, bias=0.0)
            chances[name] = Chance(
                event="hit", limit=None, estimate=seen, lower=low, upper=high, confidence=0.95,
                rule="", way="", why="",
            )  # fmt: skip
        found = joint_chance(chances)
        inside += found.lower < joint < found.upper
        half = 0.5 * (found.upper - found.lower)
        narrow += abs(found.estimate.value - joint) < 0.5 * half
    error = math.sqrt(0.95 * 0.05 / repetitions)
    assert inside / repetitions > 0.95 - 4.5 * error
    assert inside / repetitions < 0.985
    assert narrow / repetitions < 0.95 - 4.5 * error  # half as wide would not


def test_a_warm_mount_is_softer_and_a_phase_has_its_own_noise() -> None:
    scene = mission(
        [
            ROAD | {"stiffness_factor": 1.44, "damping_factor": 1.2},
            {"name": "test", "duration": 60.0, "profile": "navmat-p-9492", "level_db": 3.0},
            {"name": "bench", "duration": 60.0, "excitation": [{"kind": "white", "density": 1e-3,
             "unit": "g2/Hz"}]},
        ]
    )  # fmt: skip
    warm = scene.in_phase("road").structure
    assert isinstance(warm, Isolator)
    assert warm.frequency_hz == pytest.approx(12.0 * 1.2)
    assert warm.zeta == pytest.approx(0.1)  # c = 2 zeta omega m
    tables = [each.in_phase("test").excitations[0].table for each in (scene, scene)]  # type: ignore[union-attr]
    plain = mission([]).replace(excitations=[{"kind": "psd", "profile": "navmat-p-9492"}])
    assert tables[0](100.0) == pytest.approx(10.0**0.3 * plain.excitations[0].table(100.0))  # type: ignore[union-attr]
    assert isinstance(scene.in_phase("bench").excitations[0], WhiteNoise)
    assert Scene.model_validate(json.loads(json.dumps(scene.document()))) == scene


def test_a_file_names_a_phase(tmp_path: Path) -> None:
    file = tmp_path / "scene.toml"
    file.write_text(
        '[structure]\nkind = "isolator"\nfrequency_hz = 12.0\nzeta = 0.1\n'
        '[[impact_pair]]\nclearance = 0.01\nlaw = { kind = "restitution", coefficient = 0.7 }\n'
        f'[[phase]]\nname = "road"\nduration = "2 h"\nprofile = "{PROFILE}"\n'
        '[[phase]]\nname = "own"\nduration = 60\n'
        '[[phase.excitation]]\nkind = "psd"\nfile = "own.csv"\nunit = "g2/Hz"\n',
        encoding="utf-8",
    )
    (tmp_path / "own.csv").write_text("5, 0.01\n500, 0.01\n", encoding="utf-8")
    scene = load_scene(file)
    assert scene.phases[0].duration == 7200.0 and not scene.excitations
    assert load_scene(f"{file}#own") == scene.in_phase("own")
    with pytest.raises(ValueError, match="phase must be one of road, own, got 'air'"):
        load_scene(f"{file}#air")
    with pytest.raises(SceneError, match=r"got 2 \(road, own\)"):
        simulate(scene, rel_error=0.1)


test_what_is_no_phase_is_refused = refusals(
    mission,
    ([ROAD, ROAD], "phase.1 needs a name of its own"),
    ([ROAD | {"duration": "2 m"}], "duration"),
    ([ROAD | {"axis": "z"}], "without a profile"),
    ([ROAD | {"profile": "moon"}], "moon"),
    ([ROAD | {"excitation": [{"kind": "white"}]}], "phase.0.excitation.0 needs exactly one"),
    ([ROAD | {"stiffness_factor": -1.0}], "phase.0.stiffness_factor"),
)


def test_a_spring_that_is_a_function_has_no_factor_of_stiffness() -> None:
    mount = {"kind": "isolator", "mass": 1.0, "frequency_hz": 12.0, "zeta": 0.1}
    duffing = mount | {"spring": {"kind": "duffing", "cubic_stiffness": 1e6}}
    for structure in (mount, duffing):
        keys = {"structure": structure, "phase": [ROAD | {"stiffness_factor": 1.2}],
                "excitation": [{"kind": "psd", "profile": PROFILE}]}  # fmt: skip
        if structure is mount:
            assert Scene(**keys).in_phase("road").structure != Scene(**keys).structure
            continue
        with pytest.raises(SceneError, match=r"phase.0.structure must have linear springs"):
            Scene(**keys)


def test_a_mission_is_given_once() -> None:
    with pytest.raises(ValueError, match=r"mission must be left out .* of 7200 s together"):
        reliability(mission([ROAD]), mission=60.0)
    with pytest.raises(ValueError, match="mission must be given"):
        reliability(mission([]))


# ------------------------------------------------------------------------------
# Where no impact was seen an answer states an upper limit, never 0 with an error of 0.
# ------------------------------------------------------------------------------


def far(law: Any, clearance: float) -> Scene:
    return Scene(
        structure=Oscillator(mass=1.0, damping=0.5, stiffness=1.0),
        impact_pairs=[ImpactPair(lower=-clearance, upper=clearance, law=law)],
        excitations=[WhiteNoise(intensity=0.2)],
    )


def certain_zeros(document: Any, place: str = "") -> Iterator[str]:
    """Places of estimates that say 0 +- 0 of what was sampled."""
    if isinstance(document, dict):
        if {"value", "standard_error"} <= set(document):
            seen = document["value"] != 0.0 or document["standard_error"] != 0.0
            if not seen and document.get("upper_95") is None:
                yield place
            return
        for key, each in document.items():
            yield from certain_zeros(each, f"{place}.{key}")


def of_missions(scene: Scene) -> Result:
    with pytest.raises(NotConverged) as found:
        reliability(scene, mission=50.0, budget=2.0)
    assert found.value.partial is not None
    return found.value.partial


ASKED: dict[str, Callable[[Scene], Result]] = {
    "simulate": lambda scene: simulate(scene, paths=128, duration=100.0),
    "impacts": lambda scene: impacts(scene, paths=128, duration=100.0),
    "reliability": of_missions,
}
LAWS = {
    "rigid": Restitution(coefficient=0.5),
    "giving way": Viscoelastic(stiffness=100.0, damping_ratio=0.2),
}


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("name", ASKED)
def test_no_answer_is_certain_of_what_it_did_not_see(name: str, law: str) -> None:
    assert list(certain_zeros(ASKED[name](far(LAWS[law], 12.0)).to_dict())) == []


def test_limits_of_the_sums_of_speeds_hold() -> None:
    """Four paths that see nothing of 1.1 expected impacts."""
    scene = far(Restitution(coefficient=1.0), 1.75)
    known = exact(scene).impact_pairs["stops"]
    found = simulate(scene, paths=4, duration=0.28 / known.collision_rate.value, seed=3)
    stops = found.impact_pairs["stops"]
    assert stops.collision_rate.value == 0.0
    for name in ("collision_rate", "impact_speed_rate", "impact_speed_square_rate"):
        limit, truth = stops[name].upper_95, known[name].value
        assert limit is not None and truth < limit < 50.0 * truth


def test_damage_without_an_impact_names_no_ratio(stochvi: Run, tmp_path: Path) -> None:
    """What was not seen is not in the damage: no sentence compares it; the exit code is 1."""
    file = tmp_path / "far.toml"
    file.write_text(
        """
        [structure]
        kind = "isolator"
        frequency_hz = 12.0
        zeta = 0.1
        mass = 1.0
        [[impact_pair]]
        clearance = 0.1
        law = { kind = "viscoelastic", stiffness = 2e5, damping_ratio = 0.11 }
        [[excitation]]
        kind = "psd"
        profile = "mil-std-810h-truck-vertical-5hz"
        """
    )
    asked = ("--mission", "60", "--equipment", "40:80:2", "--rel-error", "0.5")
    ended = stochvi("damage", file, *asked, "--way", "simulation", "--out", tmp_path / "out")
    assert ended.code == 1 and "no impact was seen" in ended.err and "ask reliability" in ended.err
    assert "No artists" not in ended.err
    assert "multiply the damage" not in ended.out and "Impacts bring" not in ended.out
    assert "Impacts: at most" in ended.out and "times the damage" not in ended.out
