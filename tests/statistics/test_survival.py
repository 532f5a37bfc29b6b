"""Mean lives of paths that are not all watched to their ends, against lives that are known."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from stochvi.results.intervals import poisson_interval
from stochvi.statistics.survival import Survival

MEAN, FORGOTTEN = 40.0, 12
"""Mean life beyond the start, and the look after which it is forgotten."""


def lives(seed: int, paths: int, mean: float = MEAN) -> NDArray[np.float64]:
    """Lives in looks; nothing leaves in the first six, and a quarter as much up to the twelfth."""
    random = np.random.default_rng(seed)
    slow = random.exponential(4.0 * mean, paths)
    return 6.0 + np.where(slow < 6.0, slow, 6.0 + random.exponential(mean, paths))


def true_mean(mean: float = MEAN) -> float:
    slow = 4.0 * mean
    return 6.0 + slow * -math.expm1(-6.0 / slow) + math.exp(-6.0 / slow) * mean


def watched(life: NDArray[np.float64], looks: NDArray[np.int64]) -> Survival:
    """Paths that are watched for so many looks each."""
    noted = np.ceil(life).astype(np.int64)
    return Survival.of(np.minimum(noted, looks), noted <= looks)


def test_the_known_mean_is_that_of_lives() -> None:
    many = lives(0, 10**6)
    assert abs(many.mean() - true_mean()) < 4.0 * many.std() / 1e3


@pytest.mark.parametrize(
    ("mean", "paths", "shortest", "longest"),
    [(MEAN, 300, 16, 30), (MEAN, 60, 13, 100), (3.0, 100, 40, 60), (400.0, 2000, 16, 20)],
)
def test_intervals_hold_as_often_as_they_say(
    mean: float, paths: int, shortest: int, longest: int
) -> None:
    """Of paths watched for a part of their lives, of others, and to their ends; the negative
    control takes seconds per departure."""
    truth, held, plain, runs = true_mean(mean), 0, 0, 400
    for seed in range(runs):
        random = np.random.default_rng(seed + 10**6)
        seen = watched(lives(seed, paths, mean), random.integers(shortest, longest, paths))
        found = seen.mean_life(FORGOTTEN)
        held += found.lower <= truth <= found.upper
        slow, fast = poisson_interval(int(seen.departures.sum()), seen.watched)
        plain += 1.0 / fast <= truth <= 1.0 / slow
    spread = math.sqrt(0.05 * 0.95 / runs)
    assert 0.95 - 4.0 * spread < held / runs < 0.99
    if paths >= 300:
        assert plain / runs < 0.95 - 8.0 * spread


def test_lives_that_all_end_have_the_mean_and_error_of_their_ends() -> None:
    life = np.ceil(lives(1, 200, 3.0))
    found = watched(life, np.full(200, 10**4)).mean_life(FORGOTTEN)
    early = watched(life, np.full(200, 10**4)).mean_life(10**4)
    assert early.value == pytest.approx(life.mean() - 0.5, rel=1e-12)
    assert early.error == pytest.approx(life.std() / math.sqrt(200), rel=1e-9)
    assert abs(found.value - early.value) < early.error


def test_where_none_leaves_late_there_is_a_lower_limit_alone() -> None:
    ends = np.full(50, 30)
    none = Survival.of(ends, np.zeros(50, bool)).mean_life(FORGOTTEN)
    assert math.isnan(none.value) and none.upper == math.inf
    fast = poisson_interval(0, 50.0 * 18.0)[1]
    assert none.lower == pytest.approx(FORGOTTEN + 1.0 / fast)
    brief = Survival.of(np.full(50, 7), np.arange(50) < 5).mean_life(FORGOTTEN)
    assert math.isnan(brief.value) and 6.0 < brief.lower < 7.0
    assert Survival.of(np.zeros(3, int), np.zeros(3, bool)).mean_life(5).lower == 0.0
