"""The probability of any impact with shocks beside noise: missions of an integrator of its own
judge."""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import replace
from itertools import count, pairwise
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import expm, solve_continuous_lyapunov
from scipy.stats import chi2

from stochvi import (
    Elastic,
    FilteredNoise,
    ImpactPair,
    Isolator,
    Matrices,
    NotApplicable,
    Oscillator,
    Restitution,
    Scene,
    Sine,
    TabulatedNoise,
    WhiteNoise,
    exact,
    first_passage,
    impacts,
    reliability,
    screen,
    simulate,
    size,
)
from stochvi.isolators.screening import at_clearances
from stochvi.mathematics.spectra import squared_gain
from stochvi.mathematics.unsteady_noise import Shocks
from stochvi.model.coverage import free_motion
from stochvi.model.model import model_of
from stochvi.motion.choose_plan import plan_histories
from stochvi.motion.modal_tables import plan_modal_tables
from stochvi.results.deadline import NEVER
from stochvi.results.estimates import Estimate, jackknife_error
from stochvi.scenes import Pulses
from stochvi.scenes.phases import Phase
from stochvi.statistics.clusters import count_impacts
from stochvi.statistics.crossings import (
    FEWEST_PATHS,
    PILOT,
    CrossingAges,
    FirstCrossings,
    GapRecords,
    PairMotion,
    first_crossings,
    largest_error,
    listed_under_first,
    one_gap,
    own_distances,
    same_gaps,
)
from stochvi.statistics.free_flights import windows_of
from stochvi.statistics.trial_splitting import pilot, repetition
from stochvi.testing import assert_agrees
from support.accuracies import quick_cases, rel_errors, run_of
from support.pairs import LAW, diagonal, pair, uncoupled
from support.records import shock_shape

# ------------------------------------------------------------------------------
# First crossings of Gaussian responses, against a deterministic solver and crude counting.
# ------------------------------------------------------------------------------


UNIT = Scene(
    structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
    excitations=[WhiteNoise(intensity=0.2)],
)
"""omega = sigma_x = sigma_v = 1, zeta = 0.05."""

LIMITING_RATES = {2.0: 0.017595300, 3.0: 0.0018091405}
"""Of |x| < B, by a discontinuous Galerkin solution of the Fokker-Planck equation."""

TRUCK = Scene(
    structure=Isolator(frequency_hz=12.0, zeta=0.1),
    excitations=[TabulatedNoise(profile="mil-std-810h-truck-vertical-5hz")],
)
MISSION, HOUR = 10.0, 3600.0


def motion_of(scene: Scene) -> PairMotion:
    """Displacement and velocity of an oscillator."""
    return PairMotion(one_gap(model_of(scene)))


def deviations(scene: Scene) -> tuple[float, float]:
    """Standard deviations of displacement and velocity, m and m/s."""
    motion = motion_of(scene)
    return float(motion.displacement_std[0]), float(motion.velocity_std[0])


def records_of(scene: Scene, seed: int, level: float) -> GapRecords:
    """Records with crossings of two stops at one distance."""
    return GapRecords(motion_of(scene), seed, np.array([[level]]), np.array([[level]]))


@pytest.fixture(scope="module")
def unit() -> FirstCrossings:
    return first_crossings(UNIT, [2.0, 3.0], mission=200.0, rel_error=0.006, seed=3)


@pytest.mark.parametrize("outside", [0.0, 0.2])
def test_a_constant_hazard_is_found_again_in_the_ages_of_its_crossings(outside: float) -> None:
    """With a share P0 beyond a stop at the start and the hazard h after it, first impacts have the
    density h (1 - P0) e^(-h t), which is nu P(age > t), nu the rate of crossings.

    Ages at evenly spaced quantiles leave errors of at most nu horizon / number = 4e-4 in the sums,
    which are 4e-3 of the rate and 2e-2 of the smallest probability to survive.
    """
    hazard, nu, horizon, number = 0.3, 1.0, 6.0, 128 * 128
    left = 1.0 - (np.arange(number) + 0.5) / number
    share = hazard * (1.0 - outside) / nu
    ages = np.where(left < share, -np.log(np.minimum(left / share, 1.0)) / hazard, 0.0)
    ages = np.tile(np.minimum(ages, horizon).reshape(128, 128).T, (2, 1, 1, 1, 1))
    found = CrossingAges(
        outside=np.array([outside]), horizon=horizon, interval=0.01,
        rice_rates=np.array([[nu]]), ages=ages.astype(np.float32),
    )  # fmt: skip
    assert found.first_rate()[0].value == pytest.approx(hazard, rel=4e-3)
    for mission in (1.0, 4.0, 20.0):
        survival = (1.0 - outside) * math.exp(-hazard * mission)
        assert 1.0 - found.probability(mission)[0].value == pytest.approx(survival, rel=2e-2)


def test_limiting_rates_of_an_oscillator_in_white_noise(unit: FirstCrossings) -> None:
    for estimate, level in zip(unit.first_rate(), LIMITING_RATES, strict=True):
        assert_agrees(estimate, LIMITING_RATES[level])
    third = unit.first_rate()[1]
    assert third.standard_error < 0.01 * third.value


@pytest.mark.verify
def test_limiting_rates_to_half_a_per_cent() -> None:
    for level, mission, rel_error in ((2.0, 25.0, 0.0005), (3.0, 300.0, 0.0025)):
        found = first_crossings(
            UNIT, [level], mission=mission, rel_error=rel_error, seed=8, budget=None
        )
        (rate,) = found.first_rate()
        print(level, rate, rate.bias)
        assert_agrees(rate, LIMITING_RATES[level])
        assert rate.standard_error < 0.005 * rate.value


def test_neither_rice_nor_the_first_half_of_a_horizon_passes_for_it(unit: FirstCrossings) -> None:
    rice = Estimate(value=float(unit.rice_rate[1]), standard_error=1e-5)
    with pytest.raises(AssertionError):
        assert_agrees(rice, LIMITING_RATES[3.0])
    # survivors of a tenth of the memory have not settled yet
    tenth = unit.horizon / 40.0
    young = replace(unit, horizon=tenth, ages=np.minimum(unit.ages, tenth))
    with pytest.raises(AssertionError):
        assert_agrees(young.first_rate()[1], LIMITING_RATES[3.0])


def test_half_the_horizon_gives_the_same_rate(unit: FirstCrossings) -> None:
    memory = unit.horizon / 2.0
    half = replace(unit, horizon=memory, ages=np.minimum(unit.ages, memory))
    for estimate, level in zip(half.first_rate(), LIMITING_RATES, strict=True):
        assert_agrees(estimate, LIMITING_RATES[level])


@pytest.fixture(scope="module")
def extremes() -> tuple[NDArray[np.float64], float]:
    """Lowest and highest place of 2048 stationary records of MISSION seconds, and their step."""
    plan = motion_of(TRUCK).response
    plan = plan.with_step(plan.step / 1.5)
    found = []
    for first in range(0, 2048, 32):
        x = plan.records(11, first, 32, np.arange(1))[:, : round(MISSION / plan.step) + 1, 0]
        found.append([x.min(axis=1), x.max(axis=1)])
    return np.concatenate(found, axis=1), plan.step


@pytest.mark.parametrize(("lower", "upper"), [(3.2, 3.2), (2.8, 3.6), (math.inf, 2.8)])
def test_a_short_mission_on_a_truck_against_counting(
    extremes: tuple[NDArray[np.float64], float], lower: float, upper: float
) -> None:
    (lowest, highest), step = extremes
    s_x, s_v = deviations(TRUCK)
    counted = float(np.mean((highest >= upper * s_x) | (lowest <= -lower * s_x)))
    sides = {"lower": [lower * s_x]} if math.isfinite(lower) else {}
    (chance,) = first_crossings(
        TRUCK, **sides, upper=[upper * s_x], mission=MISSION, rel_error=0.01, seed=5
    ).probability(MISSION)
    # between samples a peak is higher by (s_v step)^2 u / 24 s_x^2 on average, and the probability
    # is as much larger as exp(-u^2 / 2) is
    missed = (min(lower, upper) * step * s_v / s_x) ** 2 / 24.0
    both = Estimate(
        value=chance.value,
        standard_error=math.hypot(
            chance.standard_error, math.sqrt(counted * (1.0 - counted) / len(highest))
        ),
        bias=(chance.bias or 0.0) + missed * counted,
    )
    assert_agrees(both, counted)
    if lower == upper:
        crossings = s_v / s_x / math.pi * math.exp(-0.5 * upper**2) * MISSION
        with pytest.raises(AssertionError):
            assert_agrees(both, -math.expm1(-crossings))


def test_a_mission_shorter_than_the_horizon_is_counted_directly() -> None:
    found = first_crossings(UNIT, [2.0], mission=20.0, rel_error=0.02, seed=2)
    assert found.horizon > 20.0
    (start,) = found.probability(1e-9)
    assert start.value == pytest.approx(math.erfc(2.0 / math.sqrt(2.0)), rel=1e-4)
    chances = [found.probability(t)[0].value for t in (1.0, 20.0, found.horizon, 1e4)]
    assert chances == sorted(chances)
    # the limiting rate takes over without a jump
    below, above = (found.probability(found.horizon * f)[0].value for f in (0.999999, 1.000001))
    assert above == pytest.approx(below, rel=1e-5)


def test_rare_levels_tend_to_rice_and_keep_their_digits() -> None:
    found = first_crossings(UNIT, [7.0, 8.0], mission=3600.0, rel_error=0.02, seed=4)
    for rate, rice, chance in zip(
        found.first_rate(), found.rice_rate, found.probability(3600.0), strict=True
    ):
        assert 0.9 < rate.value / rice < 1.0
        assert chance.value == pytest.approx(3600.0 * rate.value, rel=0.02)
    assert found.probability(3600.0)[1].value < 2e-11


def test_correlation_is_that_of_an_oscillator_in_white_noise() -> None:
    records = records_of(UNIT, 0, 3.0)
    t = records.plan.step * np.arange(records.count)
    r, _, bend = records.correlations[:, : records.count, 0, 0]
    damped = math.sqrt(1.0 - 0.05**2)
    expected = np.exp(-0.05 * t) * (np.cos(damped * t) + 0.05 / damped * np.sin(damped * t))
    # a bin of the synthesis has one frequency: sinc(t / block); and what is folded from beyond
    folded = 4.0 * abs(r[0] - 1.0)
    allowed = np.exp(-0.05 * t) * (np.pi * t / records.plan.block_length) ** 2 / 6.0 + folded
    assert (np.abs(r / r[0] - expected) < allowed).all()
    slope = np.exp(-0.05 * t) * (np.cos(damped * t) - 0.05 / damped * np.sin(damped * t))
    np.testing.assert_allclose(bend[:20] / bend[0], slope[:20], atol=2e-2)


def test_stops_of_the_scene_do_not_matter() -> None:
    stops = ImpactPair(lower=-0.5, law=Elastic(stiffness=5.0))
    stopped = UNIT.model_copy(update={"impact_pairs": (stops,)})
    one, other = (
        first_crossings(scene, upper=[3.0], rel_error=0.2, seed=1) for scene in (UNIT, stopped)
    )
    np.testing.assert_array_equal(one.ages, other.ages)
    assert one.first_rate() == other.first_rate() and np.isinf(other.lower[0])


def test_filtered_noise_is_one_of_them() -> None:
    scene = UNIT.model_copy(
        update={"excitations": (FilteredNoise(intensity=0.2, frequency_hz=0.1, zeta=0.3),)}
    )
    found = first_crossings(scene, 3.0 * deviations(scene)[0], mission=60.0, seed=1)
    assert 0.0 < found.probability(60.0)[0].value < 1.0


def test_what_is_not_covered_says_why() -> None:
    sine = Sine(amplitude=1.0, frequency_hz=1.0)
    with pytest.raises(NotApplicable, match="got a sine alone"):
        first_crossings(UNIT.model_copy(update={"excitations": (sine,)}), [3.0])
    with pytest.raises(ValueError, match="not both"):
        first_crossings(UNIT, [3.0], upper=[2.0])
    with pytest.raises(ValueError, match="as many lower as upper"):
        first_crossings(UNIT, lower=[3.0, 4.0], upper=[2.0])
    with pytest.raises(ValueError, match="must be positive"):
        first_crossings(UNIT, [-3.0])
    with pytest.raises(ValueError, match="mission must be"):
        first_crossings(UNIT, [3.0], mission=math.inf)


def test_a_budget_that_ends_leaves_larger_errors() -> None:
    found = first_crossings(UNIT, [2.0], mission=10.0, rel_error=1e-5, budget=1e-3)
    assert 1e-5 < largest_error(found, 10.0) < 0.1


def narrow(half_width: float) -> Scene:
    """A mount of 1 Hz that forgets in a third of a second, on an input that does not."""
    table = TabulatedNoise(
        frequency_hz=[1.0 - half_width, 1.0 + half_width],
        density=[0.01, 0.01],
        unit="g2/Hz",
        on="base",
    )
    return Scene(structure=Isolator(frequency_hz=1.0, zeta=0.5), excitations=[table])


def envelope_rate(scene: Scene, level: float) -> float:
    """Upcrossings of `level` standard deviations by the envelope, s_w u exp(-u^2 / 2) / sqrt(2 pi)
    with s_w the standard deviation of the angular frequency in the response density."""
    model = model_of(scene)
    frequency = np.linspace(*model.acceleration_tables[0].frequency_hz, 2001)
    weight = squared_gain(frequency, model.omega, model.damping_rate)
    weight /= weight.sum()
    omega = 2.0 * np.pi * frequency
    spread = math.sqrt(np.sum(weight * (omega - np.sum(weight * omega)) ** 2))
    return spread / math.sqrt(2.0 * math.pi) * level * math.exp(-0.5 * level**2)


def test_an_input_narrower_than_the_mount_is_remembered_for_as_long_as_it_lasts() -> None:
    """Clusters are then excursions of the envelope, of some 14 crossings at 5 sigma each."""
    scene = narrow(0.02)
    short = plan_modal_tables(model_of(scene), None, None)
    assert short.block_length * 0.04 < 4.0  # bins
    sigma = deviations(scene)[0]
    found = first_crossings(scene, [5.0 * sigma], mission=HOUR, rel_error=0.05, seed=6)
    # the squared correlation of a flat band is sinc^2 at its carrier: 1 / 4 over the bandwidth
    assert found.horizon == pytest.approx(24.0 / (4.0 * 0.04), rel=0.05)
    (rate,) = found.first_rate()
    assert rate.standard_error < 0.1 * rate.value
    assert_agrees(rate, envelope_rate(scene, 5.0))
    for wrong in (0.05, 0.01):
        with pytest.raises(AssertionError):
            assert_agrees(rate, envelope_rate(narrow(wrong), 5.0))
    with pytest.raises(AssertionError):
        assert_agrees(rate, float(found.rice_rate[0]))


def test_an_input_too_narrow_for_any_block_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("stochvi.statistics.crossings.MOST_SAMPLES", 2**14)
    assert motion_of(narrow(0.02)).response.samples <= 2**14
    with pytest.raises(NotApplicable, match="too narrow to be resolved: its memory of"):
        first_crossings(narrow(0.001), [1.0])


def test_where_no_crossing_was_a_first_one_the_chance_is_not_called_known(
    unit: FirstCrossings,
) -> None:
    few = unit.ages[:, :, :, :32, :1]
    none = replace(unit, ages=np.minimum(few, 2.0 * math.pi))
    rate, chance = none.first_rate()[1], none.probability(HOUR)[1]
    assert rate.value == 0.0
    assert rate.standard_error == pytest.approx(none.rice_rate[1] / 32.0, rel=0.1)
    assert chance.standard_error > chance.value
    assert largest_error(none, HOUR) > 1.0 > largest_error(replace(unit, ages=few), HOUR)


def test_a_long_block_is_timed_before_more_are_begun(monkeypatch: pytest.MonkeyPatch) -> None:
    seconds = count()
    clock = SimpleNamespace(time=lambda: float(next(seconds)))
    monkeypatch.setattr("stochvi.results.deadline.time", clock)
    # the guard of budgets reads the same clock
    monkeypatch.setattr("stochvi.sampling.calculations.ended_by", lambda _: nullcontext())
    found = first_crossings(UNIT, [2.0], mission=10.0, rel_error=1e-5, budget=0.5, threads=1)
    assert found.ages.shape[3] == records_of(UNIT, 0, 2.0).together < FEWEST_PATHS


def test_an_answer_is_not_ended_by_its_own_error() -> None:
    """A pilot that is no part of it tells how many paths it takes."""
    found = first_crossings(UNIT, [3.0], mission=200.0, rel_error=0.5, seed=7, threads=1)
    records = records_of(UNIT, 7, 3.0)
    first, pilot = records.ages(0), records.ages(PILOT)
    np.testing.assert_array_equal(found.ages[:, :, :, : records.together], first)
    assert not np.array_equal(first, pilot)


def test_where_hardly_any_motion_outlasts_the_memory_errors_do_not_vanish() -> None:
    """12 % outlast the memory and 15 % the mission, which 64 paths hardly tell from none."""
    mission = 100.0
    (known,) = first_passage(
        UNIT, -2.0, 2.0, times=[mission], start="stationary"
    ).probability  # fmt: skip
    scores = []
    for seed in range(1000, 1024):
        records = records_of(UNIT, seed, 2.0)
        found = records.found(np.concatenate([records.ages(0), records.ages(32)], axis=3))
        (chance,) = found.probability(mission)
        scores.append((chance.value - known.value) / chance.standard_error)
    # of normal scores the mean square is chi square over their number
    assert np.mean(np.square(scores)) < chi2.ppf(1.0 - 1e-5, 24) / 24.0


# ------------------------------------------------------------------------------
# First impacts of any of several pairs, against independent simulation and against one
# oscillator.
# ------------------------------------------------------------------------------


Matrix = NDArray[np.float64]

MISSION_OF_PAIR_CROSSINGS = 100.0


def chance(scene: Scene, rel_error: float = 0.06, seed: int = 1) -> Estimate:
    return first_crossings(
        scene, mission=MISSION_OF_PAIR_CROSSINGS, rel_error=rel_error, seed=seed
    ).probability(MISSION_OF_PAIR_CROSSINGS)[0]


def both(first: Estimate, second: float, error: float) -> Estimate:
    """An estimate with the standard error of what it is compared with as well."""
    return Estimate(
        value=first.value, standard_error=math.hypot(first.standard_error, error), bias=first.bias
    )


def test_pairs_that_are_hit_at_once_share_their_hits() -> None:
    """Two equal snubbers at one place: the numbers of each are half of those of one alone."""
    twins = uncoupled(pair("left", "x", 2.0), pair("z", "z", 3.0), pair("right", "x", 2.0))
    alone = uncoupled(pair("left", "x", 2.0), pair("z", "z", 3.0))
    found, one = (simulate(each, paths=64, duration=200.0, seed=1) for each in (twins, alone))
    left, right, whole = (
        answer.impact_pairs[name]
        for answer, name in ((found, "left"), (found, "right"), (one, "left"))
    )
    for name in ("collision_rate", "collision_rate_lower", "impact_speed_rate"):
        assert float(getattr(left, name)) == float(getattr(right, name)) > 0.0
        assert_agrees(2.0 * getattr(left, name), float(getattr(whole, name)))
    assert float(left.impact_speed_mean) == pytest.approx(float(whole.impact_speed_mean), rel=0.1)
    shares = first_crossings(twins, mission=MISSION_OF_PAIR_CROSSINGS, rel_error=0.2).shares(
        MISSION_OF_PAIR_CROSSINGS
    )[0]
    assert shares.sum() == pytest.approx(1.0)
    assert shares[0] == pytest.approx(shares[2], rel=1e-9)
    with run_of(rel_error=0.2, seed=2) as run:
        counts = count_impacts(at_clearances(twins, [4.0, 4.5, 4.0]), 0.0, run)
    assert counts.way == "bursts"
    assert counts.rates["left"].value == counts.rates["right"].value > 0.0
    # stops that are not equally far are not hit at once: the farther ones are never hit
    farther = uncoupled(pair("left", "x", 2.0), pair("right", "x", 2.1))
    crossings = first_crossings(farther, mission=MISSION_OF_PAIR_CROSSINGS, rel_error=0.2)
    assert crossings.shares(MISSION_OF_PAIR_CROSSINGS)[0] == pytest.approx([1.0, 0.0])


def test_stops_that_are_hit_at_once_share_their_hits_side_by_side() -> None:
    """The lower stops of two pairs coincide, or the upper one of a pair that is turned over."""
    plain = {"between": ("x", "z"), "lower": -2.0, "law": LAW}
    turned = ImpactPair(name="b", between=("z", "x"), lower=-4.0, upper=2.0, law=LAW)
    alike = ImpactPair(name="b", upper=4.0, **plain)
    first = ImpactPair(name="a", upper=3.0, **plain)
    (alone,) = simulate(uncoupled(first), paths=64, duration=200.0, seed=1).impact_pairs.values()
    lower, upper = alone.collision_rate_lower, alone.collision_rate_upper
    assert lower is not None and upper is not None and upper.value > 0.0
    for second in (alike, turned):
        scene = uncoupled(first, second)
        found = simulate(scene, paths=64, duration=200.0, seed=1).impact_pairs
        shared = both(found["b"].collision_rate * 2.0, lower.value, lower.standard_error)
        assert_agrees(shared, lower.value)
        lone = found["a"].collision_rate_lower
        assert lone is not None and lone.value == pytest.approx(found["b"].collision_rate.value)
        # the other stop of the first pair is its own
        rate = found["a"].collision_rate_upper
        assert_agrees(both(rate, upper.value, upper.standard_error), upper.value)
        shares = first_crossings(
            scene, mission=MISSION_OF_PAIR_CROSSINGS, rel_error=0.2, seed=1
        ).shares(MISSION_OF_PAIR_CROSSINGS)[0]
        assert 0.0 < shares[1] < 0.5 < shares[0]
        assert len(same_gaps(model_of(scene))) == 1
        (told,) = listed_under_first(model_of(scene))
        assert told.endswith("such impacts stand under a alone")
        assert told in impacts(scene, paths=64, duration=5.0, seed=1).warnings
    assert not listed_under_first(model_of(uncoupled(first)))


def test_compliant_stops_at_one_place_count_their_own_forces() -> None:
    """Both are touched at once, and push by their own stiffness."""
    stiff, soft = (
        ImpactPair(name=name, on="x", upper=2.0, law=Elastic(stiffness=stiffness))
        for name, stiffness in (("stiff", 40.0), ("soft", 10.0))
    )
    found = simulate(uncoupled(stiff, soft), paths=128, duration=50.0, seed=1).impact_pairs
    forces = [float(found[name].contact_force_upper) for name in ("stiff", "soft")]
    assert forces[0] == pytest.approx(4.0 * forces[1], rel=1e-9)
    assert float(found["stiff"].collision_rate) == float(found["soft"].collision_rate) > 0.0


def test_one_pair_is_one_oscillator() -> None:
    unit = Scene(
        structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
        excitations=[WhiteNoise(intensity=0.2)],
    )
    (known,) = first_crossings(
        unit, [3.0], mission=MISSION_OF_PAIR_CROSSINGS, rel_error=0.03, seed=2
    ).probability(MISSION_OF_PAIR_CROSSINGS)
    found = chance(uncoupled(pair("wall", "x", 3.0)))
    assert_agrees(both(found, known.value, known.standard_error), known.value)


def test_uncoupled_pairs_are_independent_and_equal_ones_count_once() -> None:
    x, z = pair("x", "x", 3.0), pair("z", "z", 3.1)
    alone = [chance(uncoupled(each)) for each in (x, z)]
    none = math.prod(1.0 - each.value for each in alone)
    error = none * math.hypot(*(each.standard_error / (1.0 - each.value) for each in alone))
    found = chance(uncoupled(x, z), seed=3)
    assert_agrees(both(found, 1.0 - none, error), 1.0 - none)
    twice = chance(uncoupled(x, pair("again", "x", 3.0)), seed=4)
    assert_agrees(both(twice, alone[0].value, alone[0].standard_error), alone[0].value)
    # the same motion under the opposite sign is no other motion either
    mirrored = ImpactPair(name="mirrored", between=("z", "x"), lower=-3.0, upper=3.0, law=LAW)
    plain = ImpactPair(name="plain", between=("x", "z"), lower=-3.0, upper=3.0, law=LAW)
    one, two = chance(uncoupled(plain), seed=5), chance(uncoupled(plain, mirrored), seed=6)
    assert_agrees(both(two, one.value, one.standard_error), one.value)
    # counted twice they would be hit as independent ones are
    wrong = 1.0 - (1.0 - alone[0].value) ** 2
    with pytest.raises(AssertionError):
        assert_agrees(both(twice, wrong, 2.0 * alone[0].standard_error), wrong)


def random_scene(number: int, coordinates: int, stops: int, rarity: float) -> Scene:
    """Masses in a row between springs of random sizes, shaken at two places, with random stops."""
    random = np.random.default_rng([77, number])
    names = tuple(f"q{i}" for i in range(coordinates))
    springs = random.uniform(0.5, 3.0, coordinates + 1)
    stiffness = np.diag(springs[:-1] + springs[1:])
    for i in range(coordinates - 1):
        stiffness[i, i + 1] = stiffness[i + 1, i] = -springs[i + 1]
    mass = np.diag(random.uniform(0.5, 2.0, coordinates))
    damping = 0.08 * stiffness + 0.06 * mass
    places = [(name, None) for name in names] + [(None, each) for each in pairwise(names)]
    chosen = random.permutation(len(places))[:stops]
    scene = Scene(
        structure=Matrices(
            coordinates=names, mass=mass.tolist(), damping=damping.tolist(),
            stiffness=stiffness.tolist(),
        ),
        impact_pairs=[
            pair(f"p{i}", places[k][0], 1.0, places[k][1]) for i, k in enumerate(chosen)
        ],
        excitations=[
            WhiteNoise(intensity=random.uniform(0.1, 0.3), on=names[0]),
            WhiteNoise(intensity=random.uniform(0.1, 0.3), on=names[-1]),
        ],
    )  # fmt: skip
    model = model_of(scene)
    std, _ = free_motion(model).deviations(np.array([each.direction for each in model.pairs]))
    reach = rarity * std * random.uniform(0.95, 1.05, stops)
    moved = [
        each.model_copy(update={"lower": -(r if i else 0.97 * r), "upper": r})
        for i, (each, r) in enumerate(zip(scene.impact_pairs, reach, strict=True))
    ]
    return scene.model_copy(update={"impact_pairs": tuple(moved)})


def hits(scene: Scene, missions: int, seed: int) -> Matrix:
    """(missions, pairs) whether a pair is hit, from exact steps of the linear motion under white
    noise, drawn at its stationary distribution; gaps are cubics between samples."""
    structure = scene.structure
    assert isinstance(structure, Matrices)
    m, c, k = structure.matrices
    n, inverse = len(m), np.linalg.inv(m)
    flow = np.block([[np.zeros((n, n)), np.eye(n)], [-inverse @ k, -inverse @ c]])
    noise = np.zeros((2 * n, 2 * n))
    for each in scene.excitations:
        assert isinstance(each, WhiteNoise) and each.intensity is not None
        place = inverse[:, structure.coordinates.index(str(each.on))]
        noise[n:, n:] += each.intensity * np.outer(place, place)
    law = solve_continuous_lyapunov(flow, -noise)
    fastest = math.sqrt(np.linalg.eigvals(inverse @ k).real.max())
    h = 2.0 * math.pi / fastest / 32.0
    step = expm(h * flow)
    random = np.random.default_rng(seed)
    state = random.standard_normal((missions, 2 * n)) @ np.linalg.cholesky(law).T
    root = np.linalg.cholesky(law - step @ law @ step.T)
    rows = np.zeros((len(scene.impact_pairs), n))
    for row, each in zip(rows, scene.impact_pairs, strict=True):
        if each.between is not None:
            row[[structure.coordinates.index(name) for name in each.between]] = 1.0, -1.0
        else:
            row[structure.coordinates.index(str(each.on))] = 1.0
    upper = np.array([each.upper for each in scene.impact_pairs], float)
    lower = np.array([each.lower for each in scene.impact_pairs], float)
    y, v = state[:, :n] @ rows.T, state[:, n:] @ rows.T
    hit = (y >= upper) | (y <= lower)
    for _ in range(round(MISSION_OF_PAIR_CROSSINGS / h)):
        state = state @ step.T + random.standard_normal(state.shape) @ root.T
        y1, v1 = state[:, :n] @ rows.T, state[:, n:] @ rows.T
        # the middle of the cubic, and the parabola through the ends and the middle
        middle = 0.5 * (y + y1) + h * (v - v1) / 8.0
        bend, slope = 2.0 * (y + y1) - 4.0 * middle, 4.0 * middle - 3.0 * y - y1
        place = np.clip(-slope / np.where(bend == 0.0, 1.0, 2.0 * bend), 0.0, 1.0)
        peak = y + place * (slope + place * bend)
        for each in (y1, peak):
            hit |= (each >= upper) | (each <= lower)
        y, v = y1, v1
    return hit


def assert_counts_agree(scene: Scene, missions: int, seed: int, rel_error: float) -> None:
    found = first_crossings(
        scene, mission=MISSION_OF_PAIR_CROSSINGS, rel_error=rel_error, seed=seed
    )
    (estimate,) = found.probability(MISSION_OF_PAIR_CROSSINGS)
    struck = hits(scene, missions, seed)
    counted = float(np.mean(struck.any(axis=1)))
    error = math.sqrt(counted * (1.0 - counted) / missions)
    print(estimate, counted, error)
    assert_agrees(both(estimate, counted, error), counted)


@pytest.mark.parametrize(("number", "coordinates", "stops", "rarity"), [
    (1, 2, 3, 3.7),
    pytest.param(2, 3, 4, 4.4, marks=pytest.mark.verify),
])  # fmt: skip
def test_random_structures_against_counting(
    number: int, coordinates: int, stops: int, rarity: float
) -> None:
    scene = random_scene(number, coordinates, stops, rarity)
    assert_counts_agree(scene, 2000, number, 0.03)


@pytest.mark.verify
@pytest.mark.parametrize("rarity", [3.6, 4.2, 4.8])
@pytest.mark.parametrize("number", range(6))
def test_random_structures_against_much_counting(number: int, rarity: float) -> None:
    coordinates = 2 + number % 3
    scene = random_scene(10 + number, coordinates, min(2 + number, 2 * coordinates - 1), rarity)
    assert_counts_agree(scene, 20_000, number, 0.01)


@pytest.mark.slow
def test_independence_fails_where_pairs_move_together() -> None:
    """Two places of one stiff beam: the middle between them hardly moves on its own."""
    scene = Scene(
        structure=Matrices(
            coordinates=("left", "right"), mass=diagonal(1, 1), damping=[[0.2, -0.1], [-0.1, 0.2]],
            stiffness=[[26.0, -25.0], [-25.0, 26.0]],
        ),
        impact_pairs=[pair("left", "left", 2.5), pair("right", "right", 2.5)],
        excitations=[WhiteNoise(intensity=0.2, on="left"), WhiteNoise(intensity=0.2, on="right")],
    )  # fmt: skip
    found = first_crossings(
        scene,
        lower=[[2.5, 2.5], [2.5, math.inf], [math.inf, 2.5]],
        upper=[[2.5, 2.5], [2.5, math.inf], [math.inf, 2.5]],
        mission=MISSION_OF_PAIR_CROSSINGS, rel_error=0.04, seed=1,
    ).probability(MISSION_OF_PAIR_CROSSINGS)  # fmt: skip
    struck = hits(scene, 1000, 9)
    counted = float(np.mean(struck.any(axis=1)))
    error = math.sqrt(counted * (1.0 - counted) / len(struck))
    assert_agrees(both(found[0], counted, error), counted)
    apart = 1.0 - (1.0 - found[1].value) * (1.0 - found[2].value)
    wrong = Estimate(value=apart, standard_error=math.hypot(error, 2.0 * found[1].standard_error))
    with pytest.raises(AssertionError):
        assert_agrees(wrong, counted)


def test_stops_on_one_side_and_gaps_off_the_middle() -> None:
    scene = random_scene(3, 2, 2, 3.6)
    first, second = scene.impact_pairs
    scene = scene.model_copy(
        update={"impact_pairs": (first.model_copy(update={"lower": None}), second)}
    )
    found = first_crossings(scene, mission=MISSION_OF_PAIR_CROSSINGS, rel_error=0.03, seed=1)
    assert len(found.crossing) == 3
    struck = hits_one_sided(scene, 2000)
    error = math.sqrt(struck * (1.0 - struck) / 2000)
    assert_agrees(both(found.probability(MISSION_OF_PAIR_CROSSINGS)[0], struck, error), struck)


def hits_one_sided(scene: Scene, missions: int) -> float:
    wide = scene.impact_pairs[0].model_copy(update={"lower": -1e9})
    both_sides = scene.model_copy(update={"impact_pairs": (wide, scene.impact_pairs[1])})
    return float(np.mean(hits(both_sides, missions, 4).any(axis=1)))


def test_a_start_beyond_several_stops_counts_once() -> None:
    found = first_crossings(
        uncoupled(pair("x", "x", 1.0), pair("again", "x", 1.0), pair("z", "z", 1.5)), rel_error=0.5
    )
    inside = math.erf(1.0 / math.sqrt(2.0)) * math.erf(1.5 / math.sqrt(2.0))
    assert abs(found.outside[0] - (1.0 - inside)) < 4.0 * found.outside_error[0] + 1e-4


def test_records_have_the_deviations_of_the_structure_under_every_noise() -> None:
    """White, filtered and tabulated noise together, at two places and on the base."""
    scene = random_scene(5, 3, 3, 4.0).model_copy(
        update={
            "excitations": (
                WhiteNoise(intensity=0.1, on="q0"),
                FilteredNoise(intensity=0.3, frequency_hz=0.2, zeta=0.2, on="q1"),
                TabulatedNoise(
                    frequency_hz=[0.02, 0.2, 2.0], density=[0.5, 1.0, 0.1], unit="(m/s2)2/Hz",
                    on="base",
                ),
            )
        }
    )  # fmt: skip
    model = model_of(scene)
    motion = PairMotion(model)
    variance = np.diag(motion.correlations[0, 0])
    speeds = -np.diag(motion.correlations[2, 0])
    # Rice's rate at 5 sigma changes by 25 times the relative error of sigma
    np.testing.assert_allclose(np.sqrt(variance), motion.displacement_std, rtol=2e-4)
    np.testing.assert_allclose(np.sqrt(speeds), motion.velocity_std, rtol=2e-4)
    sample = motion.response.records(3, 0, 32, np.arange(3))[:, ::40, 0::2].reshape(-1, 3)
    spread = np.cov(sample.T) / np.outer(motion.displacement_std, motion.displacement_std)
    wanted = motion.correlations[0, 0] / np.sqrt(np.outer(variance, variance))
    # some 4000 independent samples
    np.testing.assert_allclose(spread, wanted, atol=5.0 * math.sqrt(2.0 / 4000.0))


def no_hits(*_: object, **__: object) -> None:
    """In place of the simulation of impacts, which has tests of its own."""
    raise NotApplicable("hits", ["they are left out here"])


def test_reliability_of_any_pair_and_of_one(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("stochvi.statistics.reliability.risk.hits_of_pairs", no_hits)
    scene = uncoupled(pair("x", "x", 3.3), pair("z", "z", 3.6))
    found = reliability(scene, mission=MISSION_OF_PAIR_CROSSINGS, seed=1)
    parts = [each.probability for each in found.pairs.values()]
    none = math.prod(1.0 - each.value for each in parts)
    error = none * math.hypot(*(each.standard_error for each in parts))
    chance = found.chances["hit"]
    assert_agrees(both(chance.estimate, 1.0 - none, error), 1.0 - none)
    assert chance.lower < 1.0 - none < chance.upper
    assert sum(each.share_of_first_hits for each in found.pairs.values()) == pytest.approx(1.0)
    (alone,) = reliability(
        scene, mission=MISSION_OF_PAIR_CROSSINGS, seed=2, pair="z"
    ).chances.values()
    known = parts[1]
    assert_agrees(both(alone.estimate, known.value, known.standard_error), known.value)


def test_hits_of_pairs_that_lose_nothing_are_those_of_the_exact_law() -> None:
    """Pair by pair of two oscillators that know nothing of each other."""
    elastic = Restitution(coefficient=1.0)
    walls = [each.replace(law=elastic) for each in (pair("x", "x", 3.0), pair("z", "z", 3.2))]
    found = reliability(uncoupled(*walls), mission=MISSION_OF_PAIR_CROSSINGS, rel_error=0.1, seed=1)
    hazards = {}
    for wall, damping, stiffness, intensity in zip(
        walls, (0.1, 0.2), (1.0, 4.0), (0.2, 1.6), strict=True
    ):
        alone = Scene(
            structure=Oscillator(mass=1.0, damping=damping, stiffness=stiffness),
            impact_pairs=[ImpactPair(lower=wall.lower, upper=wall.upper, law=elastic)],
            excitations=[WhiteNoise(intensity=intensity)],
        )
        known, risk = exact(alone).impact_pairs["stops"], found.pairs[wall.name]
        assert risk.expected_hits is not None and risk.impact_speed_mean is not None
        for estimate, truth in (
            (risk.expected_hits, MISSION_OF_PAIR_CROSSINGS * float(known.collision_rate or 0.0)),
            (risk.impact_speed_mean, float(known.impact_speed_mean or 0.0)),
        ):
            plain = Estimate(value=estimate.value, standard_error=estimate.standard_error)
            assert_agrees(plain, truth)
            with pytest.raises(AssertionError):
                assert_agrees(plain, 1.2 * truth)
        hazards[wall.name] = -math.log1p(-risk.probability.value)
    for name, hazard in hazards.items():  # of independent pairs each comes first by its hazard
        share = hazard / sum(hazards.values())
        assert found.pairs[name].share_of_first_hits == pytest.approx(share, abs=0.03)


@pytest.mark.slow
def test_expected_hits_and_hard_hits_of_pairs() -> None:
    scene = uncoupled(pair("x", "x", 5.0), pair("z", "z", 5.0))
    found = reliability(
        scene, mission=MISSION_OF_PAIR_CROSSINGS, impact_speed=2.0, rel_error=0.4, seed=1
    )
    speed, hit = found.chances["impact_speed"], found.chances["hit"]
    assert speed.way == "bursts" and 0.0 < speed.estimate.value < hit.estimate.value
    assert found.hits is not None and found.hits_interval is not None
    by_pair = [each.expected_hits for each in found.pairs.values()]
    assert found.hits.value == pytest.approx(sum(each.value for each in by_pair if each))
    assert found.hits.value > -math.log1p(-hit.estimate.value)


@pytest.mark.parametrize(("change", "words"), [
    ({"pair": "y"}, "pair must be one of x"),
    ({"peak_acceleration": 1.0}, "a restitution alone does not give a force"),
    ({"at": "x"}, "belongs to peak_acceleration"),
    ({"start": "rest"}, "start must be 'stationary'"),
    ({"way": "crude"}, "way must be 'first crossings'"),
])  # fmt: skip
def test_what_reliability_of_pairs_does_not_cover(change: dict[str, object], words: str) -> None:
    scene = uncoupled(pair("x", "x", 3.3))
    with pytest.raises((NotApplicable, ValueError), match=words):
        reliability(scene, mission=MISSION_OF_PAIR_CROSSINGS, **change)  # type: ignore[arg-type]


@pytest.mark.parametrize(("pairs", "excitations", "words"), [
    ([pair("x", "x", 3.0)], [Sine(amplitude=1.0, frequency_hz=1.0, on="x")], "got a sine alone"),
    ([pair("z", "z", 3.0)], [WhiteNoise(intensity=0.2, on="x")], "must move at least one gap"),
    ([ImpactPair(name="x", on="x", lower=1.0, law=LAW)], [WhiteNoise(intensity=0.2, on="x")],
     "mean gap of x must lie between"),
])  # fmt: skip
def test_what_has_no_first_crossings(
    pairs: Sequence[ImpactPair], excitations: Sequence[WhiteNoise | Sine], words: str
) -> None:
    scene = uncoupled(*pairs).model_copy(update={"excitations": tuple(excitations)})
    with pytest.raises(NotApplicable, match=words):
        first_crossings(scene)


# ------------------------------------------------------------------------------
# The probability of any impact under noise with fast peaks, against counted missions of the engine
# and, where the noise is Gaussian, against first crossings.
# ------------------------------------------------------------------------------


BAND = TabulatedNoise(frequency_hz=[5.0, 100.0], density=[0.01, 0.01], unit="g2/Hz")
PEAKED = BAND.replace(kurtosis=8.0)
STIFF, SOFT = Isolator(frequency_hz=60.0, zeta=0.4), Isolator(frequency_hz=12.0, zeta=0.05)


def between(mount: Isolator, sigmas: float, *noises: object, upper_alone: bool = False) -> Scene:
    """A mount with stops at so many standard deviations of its motion by the band."""
    free = Scene(structure=mount, excitations=[BAND])
    clearance = sigmas * screen(free).displacement_std
    sides = {"upper": clearance} if upper_alone else {"clearance": clearance}
    pair = ImpactPair(**sides, law=Restitution(coefficient=0.7))
    return Scene(structure=mount, impact_pairs=[pair], excitations=list(noises) or [PEAKED])


def counted(scene: Scene, mission: float, missions: int, together: int = 64) -> Estimate:
    """Share of the missions without stops, as the engine flies them, that go beyond a stop."""
    plan = plan_histories(scene.replace(impact_pairs=())).plan.sampled(1e9, mission)
    samples = plan.history_samples(mission)
    below, above = own_distances(model_of(scene))
    hit = 0
    for first in range(0, missions, together):
        motion = plan.histories(11, first, together, samples).displacement[0]
        hit += int(np.sum((motion.max(axis=1) > above[0]) | (motion.min(axis=1) < -below[0])))
    share = hit / missions
    return Estimate(value=share, standard_error=math.sqrt(share * (1.0 - share) / missions))


def found_for(scene: Scene, mission: float, rel_error: float) -> Estimate:
    answer = reliability(scene, mission=mission, rel_error=rel_error, seed=2, budget=None)
    return answer.chances["hit"].estimate


def both_of_free_windows(own: Estimate, judge: Estimate) -> Estimate:
    """An estimate with the errors of its judge, too."""
    error = math.hypot(own.standard_error or 0.0, judge.standard_error or 0.0)
    return Estimate(value=own.value, standard_error=error, bias=own.bias)


@pytest.mark.slow
@pytest.mark.parametrize("upper_alone", [False, True])
@rel_errors(0.1, 0.03)
def test_the_chance_of_a_hit_is_that_of_counted_missions(
    upper_alone: bool, rel_error: float
) -> None:
    scene = between(STIFF, 8.0, upper_alone=upper_alone)
    mission, missions = 10.0, int(64 * round(0.1 / rel_error) ** 2) * 8
    judge, own = counted(scene, mission, missions), found_for(scene, mission, rel_error)
    assert 0.05 < judge.value < 0.95
    assert_agrees(both_of_free_windows(own, judge), judge.value)
    # the control: Gaussian noise of the same density never gets there
    gaussian = between(STIFF, 8.0, BAND, upper_alone=upper_alone)
    assert found_for(gaussian, mission, 0.1).value < 1e-6 < judge.value


@pytest.mark.verify
def test_a_narrow_mount_is_hit_a_little_more_than_by_gaussian_noise() -> None:
    scene = between(SOFT, 4.0)
    mission = 60.0
    judge, own = counted(scene, mission, 1024), found_for(scene, mission, 0.1)
    assert_agrees(both_of_free_windows(own, judge), judge.value)


@pytest.mark.slow
@pytest.mark.parametrize(
    "scene",
    [
        pytest.param(between(STIFF, 5.0, BAND), id="stiff"),
        pytest.param(
            between(SOFT, 4.5, BAND, WhiteNoise(density=1e-3, unit="g2/Hz")),
            id="soft, with white noise", marks=pytest.mark.verify,
        ),
    ],
)  # fmt: skip
def test_gaussian_pieces_have_the_chance_of_first_crossings(scene: Scene) -> None:
    """A mission of an hour, whose chance is found from pieces of seconds."""
    model, mission = model_of(scene), 3600.0
    below, above = own_distances(model)
    (judge,) = first_crossings(
        scene, lower=below, upper=above, mission=mission, rel_error=0.02
    ).probability(mission)
    kind = windows_of(model, below.tolist(), above.tolist(), mission, 3)
    levels = pilot(kind, 1.0, NEVER)
    assert levels.reached
    rows = np.array([repetition(kind, levels, number, NEVER) for number in range(24)])
    left_out = (rows.sum(axis=0) - rows) / (len(rows) - 1)

    def risk(each: np.ndarray) -> np.ndarray:
        return kind.risk(each[..., 0], each[..., 2], each[..., 3], mission)

    own = Estimate(
        value=float(risk(rows.mean(axis=0))), standard_error=jackknife_error(risk(left_out)),
        bias=judge.bias,
    )  # fmt: skip
    assert own.standard_error < 0.25 * own.value
    assert_agrees(both_of_free_windows(own, judge), judge.value)
    # the control: a third of the probability is told apart
    with pytest.raises(AssertionError):
        assert_agrees(both_of_free_windows(own, judge), 0.3 * judge.value)


@pytest.mark.slow
def test_answers_say_what_they_leave_out() -> None:
    answer = reliability(between(STIFF, 9.0), mission=10.0, rel_error=0.5, seed=1, budget=None)
    chance = answer.chances["hit"]
    assert chance.way == "splitting" and "noise with fast peaks" in chance.why
    assert answer.hits is None
    assert any("impacts counts all" in each for each in answer.assumptions)


def test_what_is_not_followed_is_refused_in_a_sentence() -> None:
    scene = between(STIFF, 5.0)
    for limit in ({"impact_speed": 0.1}, {"start": "rest"}):
        with pytest.raises(NotApplicable, match="noise with fast peaks"):
            reliability(scene, mission=10.0, **limit)
    beside = between(STIFF, 5.0, PEAKED, Sine(amplitude=1.0, frequency_hz=20.0))
    with pytest.raises(NotApplicable, match="sines must be left out beside noise with fast peaks"):
        reliability(beside, mission=10.0)


# ------------------------------------------------------------------------------
# The probability of any impact with shocks beside noise:
# ------------------------------------------------------------------------------


Array = NDArray[np.float64]

M, F, ZETA, MISSION_OF_SHOCKS = 2.0, 10.0, 0.06, 40.0
W = 2.0 * math.pi * F
DENSITY, BAND_OF_SHOCKS = 40.0, (4.0, 60.0)
FS = 40.0 * F
SIGMA = math.sqrt(DENSITY * math.pi * F / (4.0 * ZETA)) / (M * W**2)

NOISE = TabulatedNoise(
    frequency_hz=list(BAND_OF_SHOCKS), density=[DENSITY] * 2, unit="N2/Hz", on="x"
)


def responded(shape: str, duration: float, length: float, step: float) -> Array:
    """Displacement of the mass after a shock of 1 N, by Duhamel's integral at a fine step."""
    fine = step / 50.0
    time = fine * np.arange(round(length / fine))
    wave = W * math.sqrt(1.0 - ZETA**2)
    kick = np.exp(-ZETA * W * time) * np.sin(wave * time) / (M * wave)
    size_ = 2 * len(time)
    force = shock_shape(shape, time / duration)
    moved = np.fft.irfft(np.fft.rfft(force, size_) * np.fft.rfft(kick, size_))[: len(time)]
    return np.asarray(fine * moved[::50])


def extremes_of_shocks(pulses: Pulses, missions: int, seed: int, *, shaken: bool = True) -> Array:
    """(missions, 2): smallest and largest displacement of missions from the stationary motion."""
    random, step, before = np.random.default_rng(seed), 1.0 / FS, 3.0
    samples = round((MISSION_OF_SHOCKS + before) / step)
    length = 2 * samples
    bins = np.arange(length // 2 + 1) * FS / length
    w = 2.0 * math.pi * bins
    gain = 1.0 / (M * (W**2 - w**2 + 2j * ZETA * W * w))
    gain[(bins < BAND_OF_SHOCKS[0]) | (bins > BAND_OF_SHOCKS[1])] = 0.0
    grid = step / 4.0
    moved = responded(str(pulses.shape), float(pulses.duration or 0.0), 3.0, grid)
    found = np.empty((missions, 2))
    for mission in range(missions):
        normal = random.standard_normal((2, len(bins)))
        spectrum = gain * (normal[0] + 1j * normal[1]) * math.sqrt(DENSITY * FS * length) / 2.0
        x = np.fft.irfft(spectrum, length)[:samples] if shaken else np.zeros(samples)
        for _ in range(random.poisson(pulses.rate * (MISSION_OF_SHOCKS + before))):
            at = random.uniform(0.0, MISSION_OF_SHOCKS + before)
            size_ = {"equal": 1.0, "normal": abs(random.standard_normal()),
                     "exponential": random.exponential()}[pulses.sizes]  # fmt: skip
            if pulses.two_sided and random.random() < 0.5:
                size_ = -size_
            first = math.ceil(at / step)
            ages = step * np.arange(first, samples) - at
            near = ages < 2.9
            x[first:][near] += (
                (pulses.amplitude or 0.0)
                * size_
                * np.interp(ages[near], grid * np.arange(len(moved)), moved)
            )
        kept = x[round(before / step) :]
        # the peak between two samples, by a parabola
        found[mission] = -peak(-kept), peak(kept)
    return found


def peak(x: Array) -> float:
    k = int(np.clip(np.argmax(x), 1, len(x) - 2))
    bend, slope = x[k - 1] - 2.0 * x[k] + x[k + 1], 0.5 * (x[k + 1] - x[k - 1])
    return float(x[k] - 0.5 * slope**2 / bend) if bend < 0.0 else float(x[k])


def scene(lower: float, upper: float, *shocks: Any) -> Scene:
    """Stops at these distances, in standard deviations of the noise."""
    mass = Oscillator(mass=M, frequency_hz=F, zeta=ZETA)
    stops = ImpactPair(lower=-lower * SIGMA, upper=upper * SIGMA, law=Restitution(coefficient=0.6))
    return Scene(structure=mass, impact_pairs=[stops], excitations=[NOISE, *shocks])


def shock(share: float, **keys: Any) -> Pulses:
    """A shock that moves the mass by about so many standard deviations."""
    shape, duration = keys.get("shape", "half-sine"), keys.get("duration", 0.03)
    moved = float(np.abs(responded(shape, duration, 1.0, 0.25 / FS)).max())
    given = {"shape": "half-sine", "duration": 0.03, "rate": 0.05} | keys
    return Pulses(amplitude=share * SIGMA / moved, on="x", **given)


CASES = [
    # lower and upper stop, size of the shocks, all in sigma; keys of the shocks
    (4.5, 4.5, 3.0, {}),
    (4.5, 4.5, 6.0, {}),
    (5.5, 5.5, 3.0, {"rate": 0.3}),
    (4.5, 5.5, 3.0, {"two_sided": False}),
    (5.5, 4.2, 4.0, {"two_sided": False}),
    (5.0, 5.0, 2.0, {"sizes": "exponential"}),
    (5.0, 6.5, 2.5, {"sizes": "exponential", "two_sided": False}),
    (5.0, 5.0, 3.0, {"sizes": "normal"}),
    (6.0, 6.0, 3.5, {"sizes": "normal", "rate": 0.1}),
    (4.5, 4.5, 3.0, {"shape": "saw-tooth", "duration": 0.05}),
    (5.0, 5.0, 4.0, {"shape": "saw-tooth", "duration": 0.01}),
    (5.0, 5.0, 3.0, {"shape": "trapezoid", "duration": 0.04}),
    (5.0, 4.4, 3.0, {"shape": "trapezoid", "duration": 0.2, "two_sided": False}),
    (4.5, 4.5, 2.5, {"duration": 0.004}),
    (4.5, 4.5, 2.5, {"duration": 0.12}),
    (5.5, 5.5, 3.0, {"rate": 0.4}),
    (6.5, 6.5, 4.0, {"rate": 0.35, "two_sided": False}),
    (4.0, 4.0, 1.0, {}),
    (7.0, 7.0, 6.0, {"rate": 0.02}),
    (5.2, 5.2, 3.0, {"sizes": "exponential", "shape": "saw-tooth", "rate": 0.2}),
]
KEPT = (1, 4, 8, 15)


@quick_cases(("lower", "upper", "share", "keys"), CASES, keep=KEPT)
def test_any_impact_is_as_probable_as_in_counted_missions(
    lower: float, upper: float, share: float, keys: dict[str, Any]
) -> None:
    """Left out, or taken for noise of the same density, shocks give another answer."""
    pulses, missions = shock(share, **keys), 800
    found = reliability(
        scene(lower, upper, pulses), mission=MISSION_OF_SHOCKS, seed=1, rel_error=0.05
    )
    own = found.chances["hit"].estimate
    ends = extremes_of_shocks(pulses, missions, seed=4)
    counted = float(np.mean((ends[:, 0] < -lower * SIGMA) | (ends[:, 1] > upper * SIGMA)))
    error = math.sqrt(max(counted * (1.0 - counted), 1.0 / missions) / missions)
    assert own.bias is not None and own.bias < 0.05 * own.value + 1e-3
    assert abs(own.value - counted) < 4.0 * math.hypot(error, own.standard_error) + own.bias
    if own.value > 0.05 and share > 1.0:  # the control
        alone = reliability(scene(lower, upper), mission=MISSION_OF_SHOCKS, seed=1, rel_error=0.1)
        assert abs(alone.chances["hit"].estimate.value - counted) > 4.0 * error


def test_without_shocks_the_probability_is_that_of_noise() -> None:
    rare = reliability(scene(4.0, 4.0, shock(3.0, rate=1e-7)), mission=60.0, seed=1)
    alone = reliability(scene(4.0, 4.0), mission=60.0, seed=2)
    (value, known) = (each.chances["hit"].estimate for each in (rare, alone))
    error = math.hypot(value.standard_error, known.standard_error)
    assert abs(value.value - known.value) < 4.5 * error + 0.01 * known.value


def test_shocks_without_chance_are_a_poisson_process() -> None:
    """Where every shock brings an impact and noise none, P = 1 - exp(-rate T)."""
    sure = scene(9.0, 9.0, shock(30.0, rate=2e-3))
    found = reliability(sure, mission=300.0, seed=1, rel_error=0.02).chances["hit"].estimate
    margin = 4.5 * found.standard_error + (found.bias or 0.0)
    assert margin < 0.1
    assert abs(found.value + math.expm1(-2e-3 * 300.0)) < margin
    seldom = scene(9.0, 9.0, shock(12.0, rate="1e-4/h"))
    found = reliability(seldom, mission=3600.0, seed=1).chances["hit"].estimate
    assert abs(found.value - 1e-4) < 4.5 * found.standard_error + (found.bias or 0.0) < 2e-5


def test_the_motion_after_a_shock_is_duhamels_integral() -> None:
    pulses = shock(3.0, shape="saw-tooth", duration=0.05, two_sided=False)
    shocks = PairMotion.under_shocks(model_of(scene(5.0, 5.0, pulses))).shocks
    assert isinstance(shocks, Shocks)
    grid = 0.25 / FS
    exact = (pulses.amplitude or 0.0) * responded("saw-tooth", 0.05, 1.0, grid)
    ages = grid * np.arange(len(exact))
    found = shocks.response_at(ages)[0, 0]
    # the tooth falls within a 400th of its length
    assert np.abs(found - exact).max() < 5e-3 * np.abs(exact).max()
    states, weights = shocks.net
    assert weights.sum() == pytest.approx(1.0, abs=1e-3)
    spread = float(weights @ shocks.at(states)[0][0] ** 2)
    mean = float(weights @ shocks.at(states)[0][0])
    (square,), _ = shocks.mean_squares
    assert spread - mean**2 == pytest.approx(float(square), rel=0.02)


def test_a_size_keeps_its_probability() -> None:
    """At the clearance that `size` finds, `reliability` and counted missions agree with it."""
    pulses = shock(3.0, rate=0.05)
    free = scene(4.5, 4.5, pulses)
    found = size(free, probability=0.2, mission=MISSION_OF_SHOCKS, seed=1, rel_error=0.05)
    c = found.clearance.value / SIGMA
    back = reliability(scene(c, c, pulses), mission=MISSION_OF_SHOCKS, seed=3, rel_error=0.05)
    own = back.chances["hit"].estimate
    assert abs(own.value - 0.2) < 4.5 * own.standard_error + (own.bias or 0.0) + 0.02
    ends = extremes_of_shocks(pulses, 800, seed=6)
    counted = float(np.mean(np.abs(ends).max(axis=1) > c * SIGMA))
    assert abs(counted - 0.2) < 4.0 * math.sqrt(0.16 / 800) + 0.01
    # the control: the clearance of noise alone is hit far more often
    alone = size(
        scene(4.5, 4.5), probability=0.2, mission=MISSION_OF_SHOCKS, seed=1, rel_error=0.05
    )
    less = float(np.mean(np.abs(ends).max(axis=1) > alone.clearance.value))
    assert less - 0.2 > 4.0 * math.sqrt(0.16 / 800)


def test_shocks_in_a_phase_of_a_mission() -> None:
    pulses = shock(4.0, rate=0.05)
    phases = [
        Phase(name="road", duration=100.0, excitation=[NOISE]),
        Phase(name="handling", duration=MISSION_OF_SHOCKS, excitation=[NOISE, pulses]),
    ]
    whole = scene(5.0, 5.0).replace(excitations=(), phases=phases)
    found = reliability(whole, seed=1)
    parts = [each.chances["hit"].estimate.value for each in found.phases.values()]
    joint = found.chances["hit"].estimate.value
    assert joint == pytest.approx(1.0 - (1.0 - parts[0]) * (1.0 - parts[1]), rel=1e-9)
    assert parts[1] > 5.0 * parts[0]
    sized = size(whole, probability=0.01, seed=1, rel_error=0.1)
    assert sized.clearance.value > 5.0 * SIGMA


def test_two_masses_whose_gaps_shocks_close() -> None:
    """The pair between two masses, of which a shock strikes one: against histories."""
    from stochvi.motion.choose_plan import plan_histories

    structure = Matrices(
        coordinates=["a", "b"], mass=[[2.0, 0.0], [0.0, 1.0]],
        damping=[[16.0, -4.0], [-4.0, 6.0]], stiffness=[[9000.0, -1500.0], [-1500.0, 4000.0]],
    )  # fmt: skip
    noises = [
        TabulatedNoise(frequency_hz=[2.0, 50.0], density=[d, d], unit="N2/Hz", on=on)
        for on, d in (("a", 20.0), ("b", 6.0))
    ]
    pulses = Pulses(rate=0.08, shape="half-sine", duration=0.04, amplitude=150.0, on="a")
    pair = ImpactPair(between=("b", "a"), lower=-0.033, upper=0.03,
                      law=Restitution(coefficient=0.5))  # fmt: skip
    wall = ImpactPair(name="wall", on="b", upper=0.045, law=Restitution(coefficient=0.5))
    struck = Scene(structure=structure, impact_pairs=[pair, wall], excitations=[*noises, pulses])
    found = reliability(struck, mission=20.0, seed=1, rel_error=0.05)
    own = found.chances["hit"].estimate
    plan = plan_histories(struck.replace(impact_pairs=())).plan.sampled(2e-3, 20.0)
    samples = plan.history_samples(20.0)
    hits = []
    for first in range(0, 1024, 32):
        a, b = plan.histories(9, first, 32, samples).displacement
        gap = b - a
        hits += list(
            (gap.max(axis=1) > 0.03) | (gap.min(axis=1) < -0.033) | (b.max(axis=1) > 0.045)
        )
    counted = float(np.mean(hits))
    error = math.sqrt(counted * (1.0 - counted) / len(hits))
    assert 0.05 < counted < 0.95
    assert abs(own.value - counted) < 4.5 * math.hypot(error, own.standard_error) + (own.bias or 0)


def test_a_gap_that_no_shock_moves_is_hit_by_its_noise_alone() -> None:
    """Two masses that are not coupled, one of them struck by shocks: chances are independent."""
    structure = Matrices(
        coordinates=["a", "b"], mass=[[2.0, 0.0], [0.0, 1.0]],
        damping=[[16.0, 0.0], [0.0, 6.0]], stiffness=[[9000.0, 0.0], [0.0, 4000.0]],
    )  # fmt: skip
    noises = [
        TabulatedNoise(frequency_hz=[2.0, 50.0], density=[d, d], unit="N2/Hz", on=on)
        for on, d in (("a", 20.0), ("b", 6.0))
    ]
    pulses = Pulses(rate=0.08, shape="half-sine", duration=0.04, amplitude=150.0, on="a")
    law = Restitution(coefficient=0.5)
    pairs = [
        ImpactPair(name="a", on="a", upper=0.03, law=law),
        ImpactPair(name="b", on="b", upper=0.03, law=law),
    ]
    both = Scene(structure=structure, impact_pairs=pairs, excitations=[*noises, pulses])
    scenes = both, *(both.replace(impact_pairs=[each]) for each in pairs)
    found = [reliability(each, mission=20.0, seed=1, rel_error=0.03) for each in scenes]
    together, *alone = (each.chances["hit"].estimate for each in found)
    assert all(0.01 < each.value < 0.9 for each in alone), alone
    left = [1.0 - each.value for each in alone]
    spread = [one.standard_error * other for one, other in zip(alone, reversed(left), strict=True)]
    error = math.hypot(together.standard_error, *spread)
    bias = sum(each.bias or 0.0 for each in (together, *alone))
    assert abs(1.0 - math.prod(left) - together.value) < 4.5 * error + bias


@pytest.mark.slow
def test_shocks_that_meet_are_counted_in_missions() -> None:
    """Three shocks a second on a mount of 15 Hz: each comes while the last one still moves it.
    Against missions of this test: noise and half-sines in time, and the mount by its transform."""
    rate, size_, width, mission, level = 3.0, 60.0, 0.011, 10.0, 0.5
    struck = Scene(
        structure=Isolator(frequency_hz=15.0, zeta=0.3),
        impact_pairs=[ImpactPair(lower=-0.006, upper=0.007, law=Restitution(coefficient=0.6))],
        excitations=[
            TabulatedNoise(
                frequency_hz=[5.0, 60.0], density=[level, level], unit="(m/s2)2/Hz", on="base"
            ),
            Pulses(
                rate=rate, shape="half-sine", duration=width, amplitude=size_, sizes="normal",
                on="base",
            ),
        ],
    )  # fmt: skip
    found = reliability(struck, mission=mission, seed=1, rel_error=0.05, budget=None).chances["hit"]
    assert found.way == "missions" and found.lower < found.estimate.value < found.upper

    random, step, before = np.random.default_rng(4), 1e-3, 2.0
    count = int((mission + before) / step)
    f, t = np.fft.rfftfreq(count, step), np.arange(count) * step
    omega, natural = 2.0 * np.pi * f, 30.0 * np.pi
    moved = -1.0 / (natural**2 - omega**2 + 0.6j * natural * omega)
    hits = []
    for _ in range(400):
        waves = random.standard_normal(len(f)) + 1j * random.standard_normal(len(f))
        force = waves * np.sqrt(0.25 * level * count / step) * ((f >= 5.0) & (f <= 60.0))
        shocks = np.zeros(count)
        for begun in random.uniform(0.0, count * step, random.poisson(rate * count * step)):
            here = (t >= begun) & (t <= begun + width)
            shocks[here] += (
                size_ * random.standard_normal() * np.sin(np.pi * (t[here] - begun) / width)
            )
        z = np.fft.irfft(moved * (force + np.fft.rfft(shocks)), count)[int(before / step) :]
        hits.append(z.max() > 0.007 or z.min() < -0.006)
    share = float(np.mean(hits))
    error = math.sqrt(share * (1.0 - share) / len(hits))
    assert 0.1 < share < 0.9
    own = found.estimate
    both = Estimate(
        value=own.value, standard_error=math.hypot(own.standard_error, error), bias=own.bias
    )
    assert_agrees(both, share)
    with pytest.raises(AssertionError):  # the control: half of it
        assert_agrees(both, 0.5 * share)


def test_what_is_refused() -> None:
    with pytest.raises(NotApplicable, match=r"shocks must be apart.*reliability counts missions"):
        size(scene(5.0, 5.0, shock(1.0, rate=20.0)), probability=0.1, mission=10.0)
    with pytest.raises(NotApplicable, match="shocks must be of one kind"):
        reliability(scene(5.0, 5.0, shock(1.0), shock(2.0)), mission=10.0)
    wave = Sine(amplitude=1.0, frequency_hz=7.0, on="x")
    with pytest.raises(NotApplicable, match="sines must be left out beside shocks"):
        reliability(scene(5.0, 5.0, shock(1.0), wave), mission=10.0)
    with pytest.raises(NotApplicable, match="impact_speed must be left out with shocks"):
        reliability(scene(5.0, 5.0, shock(1.0)), mission=10.0, impact_speed=1.0)
    peaked = scene(5.0, 5.0).replace(excitations=[NOISE.replace(kurtosis=5.0), shock(1.0)])
    beside = "pulses must be left out beside noise with fast peaks"
    with pytest.raises(NotApplicable, match=beside):
        reliability(peaked, mission=10.0)
    with pytest.raises(NotApplicable, match=beside) as refused:
        size(peaked, probability=0.01, mission=10.0)
    assert "of one kind" not in str(refused.value)  # there is one kind of shocks
