"""Probabilities of rare impacts by splitting of Gaussian records, against counting and each
other."""

import math

import numpy as np
import pytest

from stochvi import (
    Elastic,
    ImpactPair,
    Isolator,
    NotApplicable,
    Restitution,
    Scene,
    TabulatedNoise,
    Viscoelastic,
    screen,
)
from stochvi.results.deadline import NEVER
from stochvi.results.estimates import Estimate
from stochvi.scenes.impact_laws import Law
from stochvi.statistics.rare_hits import (
    AfterCrossings,
    ImpactTrials,
    Windows,
    kinds_of,
    rare_hits,
)
from stochvi.statistics.trial_splitting import Levels, moved, pilot, repetition
from stochvi.testing import assert_agrees
from support.accuracies import rel_errors
from support.pairs import pair, uncoupled

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


@pytest.mark.verify
def test_a_seed_gives_the_same_digits_on_any_threads() -> None:
    scene = truck(4.0, 4.0, RUBBER)
    one, two = (
        rare_hits(scene, "impact_speed", 0.35, mission=600.0, rel_error=0.5, threads=n, budget=None)
        for n in (1, 2)
    )
    assert one.chance == two.chance and isinstance(one.kind, AfterCrossings)
    assert one.lower < one.chance.value < one.upper


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
