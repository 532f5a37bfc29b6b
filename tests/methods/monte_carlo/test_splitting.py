"""Missions and splitting against a plain twin, a deterministic solver, and crude counting."""

import math

import numpy as np
import pytest
from statsmodels.stats.proportion import proportion_confint

from stochvi import Elastic, ImpactPair, Oscillator, Scene, WhiteNoise, exact
from stochvi.methods.monte_carlo.kernels.missions import HAPPENED
from stochvi.methods.monte_carlo.kernels.random_numbers import normal_pair
from stochvi.methods.monte_carlo.missions import (
    Fleet,
    MissionPlan,
    acceleration_plan,
    impact_plan,
    passage_plan,
)
from stochvi.methods.monte_carlo.splitting import (
    Sample,
    Trial,
    crude,
    of_missions,
    of_repetitions,
    pilot_levels,
    repetition,
)
from stochvi.model.model import model_of
from stochvi.results.errors import NotConverged
from stochvi.results.estimates import Estimate
from stochvi.testing import assert_agrees
from support.accuracies import quick_cases
from support.known import P_AT_3, P_AT_4, RARE, TEN_PERIODS, oscillator


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
    x, v, left = fleet.x[path], fleet.v[path], int(fleet.left[path])
    state = fleet.streams[0, path], fleet.streams[1, path]
    barrier = plan.stops.laws[1][0]
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
            assert flown.x[path] == pytest.approx(x, abs=1e-9)
            assert flown.v[path] == pytest.approx(v, abs=1e-9)
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
        with pytest.raises(AssertionError, match="standard errors"):
            assert_agrees(estimate(of_repetitions(bad)), P_AT_4)


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
