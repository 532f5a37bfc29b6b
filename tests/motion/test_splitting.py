"""Missions and splitting against a plain twin, a deterministic solver, and crude counting."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest
from scipy.stats import binom
from statsmodels.stats.proportion import proportion_confint

from stochvi import (
    ConstantLoad,
    Elastic,
    ImpactPair,
    Matrices,
    Oscillator,
    Response,
    Restitution,
    Scene,
    TabulatedNoise,
    WhiteNoise,
    exact,
    fokker_planck,
    load_scene,
    simulate,
)
from stochvi.engine.arithmetic import COLUMNS, Log
from stochvi.engine.impact_laws import CELLS, ScatteredRestitution
from stochvi.mathematics.impact_rates import BetaDistribution
from stochvi.methods.fokker_planck import motion as rules
from stochvi.model.model import model_of
from stochvi.motion.choose_plan import make_plan
from stochvi.motion.kernels.random_numbers import normal_pair, seed_streams
from stochvi.motion.missions import (
    HAPPENED,
    RARE_BIAS,
    Fleet,
    MissionPlan,
    Sample,
    Trial,
    acceleration_plan,
    crude,
    impact_plan,
    of_missions,
    of_repetitions,
    passage_plan,
    pilot_levels,
    repetition,
)
from stochvi.motion.plan import (
    Layout,
    PathStatistics,
    StepPairs,
    bias_of_refined_step,
    bias_of_smooth_motion,
    extrapolated,
)
from stochvi.results.errors import NotConverged
from stochvi.results.estimates import Estimate, logarithmic_interval
from stochvi.scenes.datasets import zoo_files
from stochvi.scenes.impact_laws import Law
from stochvi.testing import assert_agrees
from support.accuracies import assert_differs, quick_cases, rel_errors
from support.known import P_AT_3, P_AT_4, RARE, TEN_PERIODS, oscillator, values
from support.naive import kick_flow_kick, normals, uniform, words_of_pairs


def passage(barrier: float, start: str = "rest") -> MissionPlan:
    return passage_plan(model_of(oscillator()), -barrier, barrier, TEN_PERIODS, start)  # type: ignore[arg-type]


def estimate(sample: Sample) -> Estimate:
    return Estimate(value=sample.chance, standard_error=sample.error)


def repeated(
    plan: MissionPlan, levels: tuple[float, ...], count: int, particles: int, seed: int = 1
) -> list[Trial]:
    return [
        repetition(plan, levels, seed, False, index * particles, particles)
        for index in range(count)
    ]


def plain_flight(plan: MissionPlan, fleet: Fleet, path: int, level: float) -> tuple[float, ...]:
    """One path of a passage, step by step: x, v, steps left, whether it passed."""
    h, b = plan.step, plan.base.model.damping_rate
    intensity = plan.base.model.intensity
    decay = math.exp(-b * h)
    spread = math.sqrt(intensity * (1.0 - math.exp(-2.0 * b * h)) / (2.0 * b))
    (x, v), left = fleet.state[:, path], int(fleet.left[path])
    state = fleet.streams[0, path], fleet.streams[1, path]
    barrier = plan.base.model.upper_position
    spare: list[float] = []
    while left > 0:
        if not spare:
            *words, first, second = normal_pair(*state)
            state = np.uint64(words[0]), np.uint64(words[1])
            spare = [second, first]
        v = decay * v + spread * spare.pop()
        # the highest and the lowest point of the rotation, looked at closely
        angles = np.linspace(0.0, h, 401)
        way = x * np.cos(angles) + v * np.sin(angles)
        x, v = way[-1], v * math.cos(h) - x * math.sin(h)
        left -= 1
        passed = np.abs(way).max() >= barrier
        if passed or x**2 + v**2 >= level:
            return x, v, left, passed
    return x, v, 0, False


def test_a_flight_is_that_of_its_plain_twin() -> None:
    plan = passage(2.0)
    for level in (3.0, math.inf):
        start, flown = plan.fleet(4, 0, 12), plan.fleet(4, 0, 12)
        plan.advance(flown, level)
        for path in range(12):
            x, v, left, passed = plain_flight(plan, start, path, level)
            if not passed:  # it is turned back at a barrier, and nobody asks
                assert flown.state[:, path] == pytest.approx([x, v], abs=1e-9)
            assert flown.left[path] == left
            assert (flown.how[path] == HAPPENED) == passed


def test_digits_do_not_depend_on_how_paths_fly_together() -> None:
    plan = impact_plan(model_of(oscillator(-1.0, 1.0, 0.8)), 20.0, "stationary", 1.5)
    together, apart = plan.fleet(2, 0, 700), plan.fleet(2, 0, 700)
    plan.advance(together, 4.0)
    for first in range(0, 700, 175):
        part = apart.chosen(np.arange(first, first + 175))
        plan.advance(part, 4.0)
        for whole, some in zip(together, part, strict=True):
            np.testing.assert_array_equal(whole[..., first : first + 175], some)


def test_crude_missions_meet_the_deterministic_solver() -> None:
    for plan, truth in ((passage(3.0), P_AT_3), (passage(3.0).coarser(), P_AT_3)):
        assert_agrees(estimate(of_missions([crude(plan, 1, False, 0, 60_000)])), truth)


def test_splitting_is_unbiased_and_its_levels_count() -> None:
    plan = passage(4.0)
    levels = pilot_levels(plan, 9, 0, 256).levels
    assert len(levels) >= 2
    trials = repeated(plan, levels, 300, 256)
    assert_agrees(estimate(of_repetitions(trials)), P_AT_4)
    # the negative controls: the copies of a level for as many paths, one level more or less
    wrong = [trial._replace(chance=trial.chance * 1.25) for trial in trials]
    for bad in (wrong, [trial._replace(chance=trial.chance / 0.2) for trial in trials]):
        assert_differs(estimate(of_repetitions(bad)), P_AT_4)


@quick_cases(("barrier", "start", "truth"), RARE, keep=(1, 2))
def test_splitting_meets_the_deterministic_solver_where_it_is_rare(
    barrier: float, start: str, truth: float
) -> None:
    plan = passage(barrier, start)
    levels = pilot_levels(plan, 3).levels
    found = of_repetitions(repeated(plan, levels, 24, 1024))
    assert found.relative_error < 0.2
    assert_agrees(estimate(found), truth)


@pytest.mark.slow
def test_intervals_cover_and_a_count_of_the_last_level_does_not() -> None:
    plan = passage(3.0)
    levels = pilot_levels(plan, 5, 0, 64).levels
    particles, count, answers = 64, 20, 200
    trials = repeated(plan, levels, count * answers, particles)
    covered, naive = 0, 0
    for first in range(0, len(trials), count):
        sample = of_repetitions(trials[first : first + count])
        interval = sample.interval(0.95)
        covered += interval.lower <= P_AT_3 <= interval.upper
        # as if the share of the first level were known, and the paths after it independent
        failed = round(sample.chance / 0.2 * count * particles)
        lower, upper = proportion_confint(failed, count * particles, method="beta")
        naive += 0.2 * lower <= P_AT_3 <= 0.2 * upper
    spread = math.sqrt(0.95 * 0.05 / answers)
    assert abs(covered / answers - 0.95) < 4.5 * spread
    assert naive / answers < 0.95 - 4.5 * spread


def test_expected_hits_of_a_rare_hit_are_the_exact_rate() -> None:
    scene = oscillator(-4.0, 4.0)
    plan = impact_plan(model_of(scene), TEN_PERIODS, "stationary")
    levels = pilot_levels(plan, 1).levels
    found = of_repetitions([repetition(plan, levels, 2, True, 1024 * i, 1024) for i in range(24)])
    rate = exact(scene).impact_pairs["stops"]["collision_rate"]
    assert isinstance(rate, Estimate)
    hits = Estimate(value=found.hits, standard_error=found.hits_error)
    assert found.hits_error < 0.1 * found.hits
    assert_agrees(hits, TEN_PERIODS * rate.value)
    assert found.hits > 1.2 * found.chance  # they come in bursts


@pytest.mark.parametrize(("restitution", "speed"), [(1.0, 3.5), (0.8, 2.5)])
def test_fast_impacts_by_splitting_and_by_counting(restitution: float, speed: float) -> None:
    plan = impact_plan(model_of(oscillator(-1.0, 1.0, restitution)), 30.0, "rest", speed)
    levels = pilot_levels(plan, 1).levels
    split = of_repetitions(repeated(plan, levels, 24, 512))
    counted = of_missions([crude(plan, 2, False, 0, 30_000)])
    assert counted.failed > 20 and levels
    assert_agrees(
        Estimate(value=split.chance, standard_error=math.hypot(split.error, counted.error)),
        counted.chance,
    )


def test_fast_impacts_between_elastic_stops_are_no_more_than_expected() -> None:
    """Impact speeds are Rayleigh: nu exp(-w^2 / (2 theta)) a second are faster than w (B 13.38),
    which bounds the chance of any, and is some clumps times it."""
    speed, scene = 5.0, oscillator(-1.0, 1.0)
    plan = impact_plan(model_of(scene), TEN_PERIODS, "stationary", speed)
    found = of_repetitions(repeated(plan, pilot_levels(plan, 1).levels, 20, 512))
    rate = exact(scene).impact_pairs["stops"]["collision_rate"]
    assert isinstance(rate, Estimate)
    expected = TEN_PERIODS * rate.value * math.exp(-(speed**2) / 2.0)
    assert found.chance + 4.5 * found.error < expected
    assert found.chance - 4.5 * found.error > expected / 100.0


def test_peak_accelerations_are_those_of_the_speeds_that_bring_them() -> None:
    """Of an elastic stop at c: a = k y + c + y, w^2 = k y^2 + (c + y)^2 - c^2 (omega = 1)."""
    stiffness, position, deflection = 400.0, 1.0, 0.15
    scene = Scene(
        structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
        impact_pairs=[ImpactPair(lower=-1.0, upper=1.0, law=Elastic(stiffness=stiffness))],
        excitations=[WhiteNoise(intensity=0.2)],
    )
    sharpest = stiffness * deflection + position + deflection
    speed = math.sqrt(stiffness * deflection**2 + (position + deflection) ** 2 - position**2)
    chances = [
        of_missions([crude(plan, seed, False, 0, 8000)])
        for seed, plan in (
            (1, acceleration_plan(model_of(scene), 30.0, "rest", sharpest)),
            (2, impact_plan(model_of(scene), 30.0, "rest", speed)),
        )
    ]
    first, second = chances
    assert min(first.failed, second.failed) > 100
    assert_agrees(
        Estimate(value=first.chance, standard_error=math.hypot(first.error, second.error)),
        second.chance,
    )


def test_an_event_out_of_reach_is_said_to_be() -> None:
    plan = passage(60.0)
    with pytest.raises(NotConverged, match="levels of energy"):
        pilot_levels(plan, 1, 0, 64)


# ------------------------------------------------------------------------------
# A restitution that is drawn at each impact: simulation beside a plain twin and Fokker-Planck.
# ------------------------------------------------------------------------------


WIDE = {"mean": 0.5, "std": 0.25}
"""A restitution whose E R^2 is 1.25 times (E R)^2."""

JUDGED = ("displacement_std", "velocity_std", "impact_speed_rate", "impact_speed_square_rate")


def scene_of(
    lower: float | None = -1.0,
    upper: float | None = 1.0,
    coefficient: Any = WIDE,
    upper_law: Law | None = None,
    damping: float = 0.1,
    load: float = 0.0,
) -> Scene:
    """x'' + b x' + x = f(t) + load, with E f f = 0.2."""
    excitations: list[Any] = [WhiteNoise(intensity=0.2)]
    if load:
        excitations.append(ConstantLoad(force=load))
    return Scene(
        structure=Oscillator(mass=1.0, damping=damping, stiffness=1.0),
        impact_pairs=[
            ImpactPair(
                lower=lower,
                upper=upper,
                law=Restitution(coefficient=coefficient),
                upper_law=upper_law,
            )
        ],
        excitations=excitations,
    )


def of_two_masses(pair: ImpactPair) -> Scene:
    """The same oscillator beside another one, which it does not know, as a structure."""
    return Scene(
        structure=Matrices(
            coordinates=["x", "z"],
            mass=[[1.0, 0.0], [0.0, 1.0]],
            damping=[[0.1, 0.0], [0.0, 0.1]],
            stiffness=[[1.0, 0.0], [0.0, 2.0]],
        ),
        impact_pairs=[pair.replace(on="x")],
        excitations=[WhiteNoise(intensity=0.2, on=name) for name in ("x", "z")],
    )


def assert_same(simulated: Response, known: Response, z: float = 4.5) -> None:
    (pair,), truth = simulated.impact_pairs.values(), values(known)
    judged = 0
    for name in JUDGED:
        found = getattr(pair if name.startswith("impact") else simulated.coordinates["x"], name)
        if found.bias is not None:  # F2 has none where a load holds the mass on a stop
            assert_agrees(found, truth[name], z=z)
            judged += 1
    assert judged >= 3


# ---- path by path ------------------------------------------------------------------------------


@pytest.mark.parametrize("lower", [-0.3, None])
@pytest.mark.parametrize("step", [0.25, 1.2], ids=["short steps", "several impacts in a step"])
def test_paths_are_those_of_a_plain_twin(lower: float | None, step: float) -> None:
    """The twin draws from the words of its stream, and from the numbers of its impacts."""
    upper, path, steps = 0.4, 5, 200
    scene = scene_of(lower, upper)
    plan = make_plan(model_of(scene), 0.0, step * steps).with_step(step)
    record = np.zeros((steps, 1, 3))
    log = Log(np.empty((10**5, COLUMNS)), np.zeros(1, np.int64), 0.0)
    plan.averages(9, path, 1, record, log=log)
    streams = np.empty((2, 1), np.uint64)
    seed_streams(np.uint64(9), path, streams)
    (x,), (v,) = plan._start(streams)
    law = scene.impact_pairs[0].law
    assert isinstance(law, Restitution) and law.scatter is not None
    middles, widths = law.scatter.cells(CELLS)
    words, z = words_of_pairs(9, path, steps + 2), normals(9, path, steps + 2)[2:]
    hits: list[tuple[float, float, float]] = []
    struck = 0

    def draw() -> float:
        nonlocal struck
        place = uniform(words[1 + number // 2], struck) * CELLS
        struck += 1
        cell = int(place)
        return float(np.clip(middles[cell] + widths[cell] * (place - cell - 0.5), 0.0, 1.0))

    stops = [(at, draw, side) for at, side in ((lower, -1.0), (upper, 1.0)) if at is not None]
    for number in range(steps):
        struck = 0 if number % 2 == 0 else struck
        (x,), (v,), found = kick_flow_kick(x, v, z[[number]], step, 1.0, 0.1, 0.2, stops)
        hits += [(side, w, number * step + when) for side, w, when in found]
        assert record[number, 0, 0] == pytest.approx(x, rel=0, abs=1e-8)
        assert record[number, 0, 1] == pytest.approx(v, rel=0, abs=1e-7)
    assert len(hits) > 10
    timed = np.array([(when, side * w) for side, w, when in hits])
    np.testing.assert_allclose(log.events[: log.count[0], 2:], timed, rtol=0, atol=1e-6)


def test_without_scatter_every_bit_is_that_of_the_plain_law() -> None:
    plain, still = (
        simulate(scene_of(coefficient=each), paths=256, duration=40.0, seed=4).to_frame()
        for each in (0.5, {"mean": 0.5, "std": 0.0})
    )
    assert plain.equals(still)


# ---- beside Fokker-Planck ------------------------------------------------------------------------


def random_scene(number: int) -> Scene:
    """One or two stops, also preloaded, any mean and scatter, gaps, dampings and loads."""
    random = np.random.default_rng(1000 + number)
    gaps = random.uniform(0.3, 2.0, 2)
    both = random.uniform() < 0.6

    def coefficient() -> dict[str, float]:
        mean = float(random.uniform(0.2, 0.95))
        return {"mean": mean, "std": random.uniform(0.05, 0.9) * math.sqrt(mean * (1.0 - mean))}

    lower_law, upper_law = (Restitution(coefficient=coefficient()) for _ in range(2))
    if not both and random.uniform() < 0.3:
        gaps[1] = -random.uniform(0.0, 0.5)
    pair = ImpactPair(
        lower=-gaps[0] if both else None,
        upper=gaps[1],
        lower_law=lower_law if both else None,
        upper_law=upper_law,
    )
    own = scene_of(
        damping=float(10.0 ** random.uniform(-1.5, -0.3)),
        load=float(random.choice([0.0, random.uniform(-0.5, 0.5)])),
    )
    return own.replace(impact_pairs=[pair])


@quick_cases("number", range(50), keep={0, 7})
def test_simulation_agrees_with_fokker_planck(number: int) -> None:
    scene = random_scene(number)
    simulated = simulate(scene, rel_error=4e-3, seed=number)
    assert_same(simulated, fokker_planck(scene, rtol=1e-4))


@rel_errors(4e-3, 2e-3)
def test_the_scatter_counts(rel_error: float) -> None:
    """The same scene without its scatter is another one: both methods see that."""
    scene, constant = scene_of(), scene_of(coefficient=0.5)
    simulated, known = simulate(scene, rel_error=rel_error, seed=2), fokker_planck(scene)
    assert_same(simulated, known)
    with pytest.raises(AssertionError):
        assert_same(simulated, fokker_planck(constant))
    with pytest.raises(AssertionError):
        assert_same(simulate(constant, rel_error=rel_error, seed=2), known)


def mean_alone(law: BetaDistribution, count: int = 1) -> tuple[Any, Any]:
    return np.full(count, law.mean), np.full(count, 1.0 / count)


@pytest.mark.slow
@pytest.mark.parametrize("fault", ["simulate", "fokker-planck", "balance"])
def test_scatter_that_is_left_out_is_noticed(fault: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """E R in the place of R: in the kernel, in the condition at the stop, and in the balance."""
    scene = scene_of(coefficient={"mean": 0.45, "std": 0.26})
    match fault:
        case "simulate":
            monkeypatch.setattr(
                ScatteredRestitution,
                "of",
                classmethod(
                    lambda cls, law: cls(
                        np.array([[law.mean, *np.full(CELLS, law.mean), *np.zeros(CELLS)]])
                    )
                ),
            )
        case "fokker-planck":
            monkeypatch.setattr("stochvi.methods.fokker_planck.motion.restitution_rule", mean_alone)
        case "balance":
            monkeypatch.setattr(
                Restitution, "restitution_mean_square", property(lambda law: law.restitution**2)
            )
    simulated, known = simulate(scene, rel_error=4e-3, seed=2), fokker_planck(scene)
    if fault == "balance":
        assert simulated.identities is not None
        assert_agrees(simulated.identities["virial"], 0.0)
        assert_differs(simulated.identities["energy"], 0.0)
    else:
        with pytest.raises(AssertionError):
            assert_same(simulated, known)


@pytest.mark.slow
@pytest.mark.parametrize("law", [WIDE, {"mean": 0.9, "std": 0.25}, {"mean": 0.2, "std": 0.15}])
def test_the_rule_of_fokker_planck_is_fine_enough(
    law: dict[str, float], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Beside one of 96 restitutions; one of two, exact for E R and E R^2, is not enough."""
    scene = scene_of(coefficient=law)
    found = values(fokker_planck(scene, rtol=1e-6))
    place = "stochvi.methods.fokker_planck.motion.restitution_rule"
    monkeypatch.setattr(place, lambda known: known.rule(96))
    finest = values(fokker_planck(scene, rtol=1e-6))
    monkeypatch.setattr(place, lambda known: known.rule(2))
    rough = values(fokker_planck(scene, rtol=1e-6))
    for name in JUDGED:
        assert found[name] == pytest.approx(finest[name], rel=3e-6)
    worst = max(abs(rough[name] / finest[name] - 1.0) for name in JUDGED)
    assert worst > 1e-4
    assert rules.COUNTS[-1] < 96


# ---- structures, mixed stops, tables -------------------------------------------------------------


@rel_errors(1e-2, 2e-3)
def test_a_structure_draws_the_same_distribution(rel_error: float) -> None:
    scene = scene_of()
    simulated = simulate(of_two_masses(scene.impact_pairs[0]), rel_error=rel_error, seed=2)
    assert_same(simulated, fokker_planck(scene, rtol=1e-4))


@rel_errors(1e-2, 3e-3)
@pytest.mark.parametrize("several", [False, True], ids=["one mass", "structure"])
def test_a_compliant_stop_may_lie_opposite(several: bool, rel_error: float) -> None:
    scene = scene_of(upper_law=Elastic(stiffness=100.0))
    known = fokker_planck(scene, rtol=1e-4)
    simulated = of_two_masses(scene.impact_pairs[0]) if several else scene
    assert_same(simulate(simulated, rel_error=rel_error, seed=2), known)


@pytest.mark.slow
@rel_errors(4e-2, 1e-2)
def test_a_mass_that_is_pressed_on_a_stop_comes_to_rest(rel_error: float) -> None:
    """Chatter ends at rest, however the restitutions fall; E R gives what the rest adds to F1."""
    scene = scene_of(None, -0.5)
    known = fokker_planck(scene, rtol=1e-4)
    assert_same(simulate(scene, rel_error=rel_error, seed=2), known)
    assert_same(simulate(of_two_masses(scene.impact_pairs[0]), rel_error=rel_error, seed=2), known)


@rel_errors(2e-2, 5e-3)
def test_tables_take_it_as_white_noise_does(rel_error: float) -> None:
    """A density that is flat far beyond the resonance."""
    flat = TabulatedNoise(frequency_hz=[1e-3, 8.0], density=[0.4, 0.4], unit="N2/Hz")
    simulated = simulate(scene_of().replace(excitations=[flat]), rel_error=rel_error, seed=2)
    known = values(fokker_planck(scene_of(), rtol=1e-4))
    # the density ends at 8 Hz: a part 2 / (pi 2 pi 8) of E v^2 is missing, also where stops act
    for name in ("displacement_std", "impact_speed_rate"):
        (pair,) = simulated.impact_pairs.values()
        own = pair if name.startswith("impact") else simulated.coordinates["x"]
        found = getattr(own, name)
        assert found.value == pytest.approx(
            known[name], abs=4.5 * found.standard_error + (found.bias or 0.0) + 0.02 * known[name]
        )


# ------------------------------------------------------------------------------
# Some paths are simulated at twice the step with the same noise: what that says of the bias.
# ------------------------------------------------------------------------------


LAYOUT = Layout(rows=(("a", "x"), ("a", "xx")), origins={}, thresholds={})
TRIALS, PATHS, PAIRED = 400, 256, 64


def trials(correlation: float, bias: float) -> tuple[np.ndarray, np.ndarray]:
    """Differences and their stated errors of a quantity of many independent runs."""
    random = np.random.default_rng(4)
    found = []
    for _ in range(TRIALS):
        fine = random.normal(2.0, 1.0, (2, PATHS))
        own = random.normal(0.0, 1.0, (2, PAIRED))
        same = fine[:, :PAIRED] - 2.0
        coarse = 2.0 + bias + correlation * same + np.sqrt(1.0 - correlation**2) * own
        pairs = StepPairs.of(np.concatenate([fine[:, :PAIRED], coarse]), LAYOUT)
        whole = PathStatistics.of(fine, LAYOUT)
        found += pairs.differences(lambda means: (means["a", "x"] * means["a", "xx"],), whole)
    values, errors = np.array(found).T
    return values, errors


@pytest.mark.parametrize("correlation", [0.0, 0.6, 0.99])
def test_the_difference_has_no_bias_and_the_error_that_is_stated(correlation: float) -> None:
    values, errors = trials(correlation, 0.1)
    # the product of the means is (2.1)^2 at twice the step, 2^2 at the step
    spread = values.std(ddof=1)
    assert_agrees(Estimate(value=values.mean(), standard_error=spread / TRIALS**0.5), 2.1**2 - 4.0)
    relative = 1.0 / np.sqrt(2.0 * TRIALS)  # standard error of a standard deviation
    mean_error = np.sqrt(np.mean(errors**2))
    assert_agrees(Estimate(value=spread / mean_error, standard_error=relative), 1.0)


@pytest.mark.parametrize("correlation", [-0.5, 0.6, 0.99])
def test_the_error_of_a_difference_is_that_of_a_sum_over_all_paths(correlation: float) -> None:
    """c - beta f over n paths less (1 - beta) f over N: those n paths are in both means."""
    random = np.random.default_rng(6)
    fine = random.normal(2.0, 1.0, PATHS)
    same, own = fine[:PAIRED] - 2.0, random.normal(0.0, 1.0, PAIRED)
    coarse = 2.1 + correlation * same + np.sqrt(1.0 - correlation**2) * own
    layout = Layout(rows=(("a", "x"),), origins={}, thresholds={})
    pairs = StepPairs.of(np.vstack([fine[:PAIRED], coarse]), layout)
    whole = PathStatistics.of(fine[None], layout)
    ((value, error),) = pairs.differences(lambda means: (means["a", "x"],), whole)
    covariance = np.cov(fine[:PAIRED], coarse)
    beta = min(max(covariance[0, 1] / covariance[0, 0], 0.0), 1.0)
    paired = np.array([-beta / PAIRED - (1.0 - beta) / PATHS, 1.0 / PAIRED])
    alone = (1.0 - beta) / PATHS
    variance = PAIRED * paired @ covariance @ paired
    variance += (PATHS - PAIRED) * alone**2 * covariance[0, 0]
    assert error == pytest.approx(np.sqrt(variance), rel=1e-6)
    ahead = coarse.mean() - beta * fine[:PAIRED].mean() - (1.0 - beta) * fine.mean()
    assert value == pytest.approx(ahead, abs=1e-9)


def test_shared_noise_and_the_other_paths_make_the_error_smaller() -> None:
    """Less than that of the pairs alone, and than that of independent runs."""
    errors = {rho: np.sqrt(np.mean(trials(rho, 0.0)[1] ** 2)) for rho in (0.0, 0.6, 0.99)}
    one = 4.0 / np.sqrt(2.0)  # of the product over one path, from either factor

    def independent(rho: float) -> float:
        return 2.0 * one * np.sqrt(1.0 / PAIRED + 1.0 / PATHS)

    def pairs_alone(rho: float) -> float:
        return 2.0 * one * np.sqrt((2.0 - 2.0 * rho) / PAIRED)

    assert errors[0.0] < 0.85 * pairs_alone(0.0)
    assert errors[0.6] < 0.9 * min(independent(0.6), pairs_alone(0.6))
    assert errors[0.99] < 0.3 * independent(0.99)


@pytest.mark.parametrize(
    ("bias", "order"),
    [
        (bias_of_smooth_motion, 2.0),
        (partial(bias_of_refined_step, "collision_rate", restitution=0.8), 0.5),
        (partial(bias_of_refined_step, "impact_speed_rate", restitution=0.8), 2.0),
        (partial(bias_of_refined_step, "impact_speed_rate", restitution=0.3), 1.0),
        (partial(bias_of_refined_step, "impact_speed_rate", restitution=0.1), 0.5),
        # at R = 1/2 the exponent beta of slow impacts is 1: order (2 + m - beta) / 2
        (partial(extrapolated, "collision_rate", restitution=0.5), 0.5),
        (partial(extrapolated, "impact_speed_rate", restitution=0.5), 1.0),
        (partial(extrapolated, "impact_speed_square_rate", restitution=0.5), 1.5),
    ],
)  # fmt: skip
def test_the_bias_extrapolates_an_error_of_the_order_of_the_scheme(
    bias: Callable[..., float], order: float
) -> None:
    step, size = 0.01, 0.3
    at_the_step, at_twice = size * step**order, size * (2.0 * step) ** order
    assert bias(difference=at_twice - at_the_step) == pytest.approx(at_the_step, rel=1e-9)


SCENES = {
    "one oscillator": oscillator(-1.0, 1.0, 0.5),
    "three masses": load_scene(zoo_files()["chain-lossy-pairs"]),
    "filtered noise": load_scene(zoo_files()["filtered-lossy"]),
}


@pytest.mark.parametrize("scene", SCENES.values(), ids=SCENES.keys())
def test_a_step_of_twice_the_length_has_the_noise_of_both(scene: Scene) -> None:
    """Without stops the paths then differ by what the step does alone, which shrinks with it."""
    free = scene.replace(impact_pairs=[])
    plan = make_plan(model_of(free), None, None)

    def off(merged: bool, step: float) -> float:
        fine = plan.with_step(step)
        coarse = replace(fine.coarser(), merged=merged)
        row = next(row for row, key in enumerate(plan.layout.rows) if key[1] == "xx")
        square = fine.averages(5, 0, 64)[row]
        return float(np.std(coarse.averages(5, 0, 64)[row] - square) / square.std())

    ratio = off(True, 0.125 * plan.step) / off(True, 0.25 * plan.step)
    assert ratio < 0.75
    # negative control: the noise of each step for itself
    assert off(False, 0.125 * plan.step) > 0.5


def fast_impacts(plan: MissionPlan, seed: int) -> Estimate:
    """Expected impacts of a mission at the limit and faster, from twenty repetitions."""
    levels = pilot_levels(plan, 5).levels
    trials = [repetition(plan, levels, seed, True, 1024 * i, 1024) for i in range(20)]
    found = of_repetitions(trials)
    return Estimate(
        value=found.hits, standard_error=found.hits_error, bias=RARE_BIAS * found.hits, how="test"
    )


@pytest.mark.slow
def test_intervals_of_rare_fast_impacts_hold_the_rate_of_fokker_and_planck() -> None:
    """They are 4.5 times as fast as the rms speed: two in ten million missions. Steps of half a
    flight, which are short enough for ordinary impacts, made them 40 % too many."""
    speed, mission = 3.5, 20.0
    scene = oscillator(-1.0, 1.0, 0.8)
    rate = fokker_planck(scene, speed_threshold=speed).impact_pairs["stops"]["collision_rate"]
    truth, doubt = mission * rate.value, mission * (rate.bias or 0.0)
    plan = impact_plan(model_of(scene), mission, "stationary", speed)
    found = [fast_impacts(plan, seed) for seed in range(6)]
    held = 0
    for each in found:
        lower, upper = logarithmic_interval(
            each.value, each.standard_error, 19, bias=(each.bias or 0.0) + doubt
        )
        held += lower <= truth <= upper
    assert held >= binom.ppf(0.005, len(found), 0.95)
    values = np.array([each.value for each in found])
    error = math.hypot(*(each.standard_error for each in found)) / len(found)
    mean = Estimate(
        value=float(values.mean()), standard_error=error, how="test",
        bias=RARE_BIAS * float(values.mean()) + doubt,
    )  # fmt: skip
    assert_agrees(mean, truth)
    # the negative control
    assert_differs(mean, 1.4 * truth)
