"""First crossings of Gaussian responses, against a deterministic solver and crude counting."""

import math
from contextlib import nullcontext
from dataclasses import replace
from itertools import count
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import chi2

from stochvi import (
    Elastic,
    FilteredNoise,
    ImpactPair,
    Isolator,
    NotApplicable,
    Oscillator,
    Scene,
    Sine,
    TabulatedNoise,
    WhiteNoise,
    first_passage,
)
from stochvi.mathematics.spectra import squared_gain
from stochvi.methods.monte_carlo.tabulated import plan_tabulated
from stochvi.model.model import model_of
from stochvi.results.estimates import Estimate
from stochvi.statistics.crossing_ages import FEWEST_PATHS, PILOT, CrossingAges, largest_error
from stochvi.statistics.first_crossings import first_crossings, one_gap
from stochvi.statistics.pair_crossings import FirstCrossings, GapRecords, PairMotion
from stochvi.testing import assert_agrees

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


def test_digits_depend_on_the_seed_alone() -> None:
    one, two, other = (
        first_crossings(UNIT, [3.0], rel_error=0.2, seed=seed, threads=threads)
        for seed, threads in ((1, 1), (1, 3), (2, 1))
    )
    np.testing.assert_array_equal(one.ages, two.ages)
    assert not np.array_equal(one.ages, other.ages)


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
    short = plan_tabulated(model_of(scene), None, None)
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
    monkeypatch.setattr("stochvi.statistics.pair_crossings.MOST_SAMPLES", 2**14)
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
    monkeypatch.setattr("stochvi.model.calculations.ended_by", lambda _: nullcontext())
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
