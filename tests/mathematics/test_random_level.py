"""The level of noise of varying level against sums over its own paths."""

import math

import numpy as np
import pytest

from stochvi.mathematics.random_level import RandomLevel

PATHS, STEP = 4000, 0.02


def walk(level: RandomLevel, duration: float, seed: int = 3) -> np.ndarray:
    """(steps, paths): the normal process at equal steps."""
    random = np.random.default_rng(seed)
    decay = math.exp(-STEP / level.time)
    found = random.standard_normal((math.ceil(duration / STEP), PATHS))
    for row in range(1, len(found)):
        found[row] = decay * found[row - 1] + math.sqrt(1.0 - decay**2) * found[row]
    return found


@pytest.mark.parametrize("kurtosis", [3.2, 5.0, 12.0])
def test_moments_are_those_of_the_lognormal_level(kurtosis: float) -> None:
    level = RandomLevel(kurtosis, 10.0)
    assert level.mean(level.gains**2) == pytest.approx(1.0, rel=1e-9)
    assert 3.0 * level.mean(level.gains**4) == pytest.approx(kurtosis, rel=1e-9)
    assert level.moment(6.0) == pytest.approx(level.mean(level.gains**6), rel=1e-6)


def test_a_hazard_that_follows_the_level_strikes_as_often_as_in_its_paths() -> None:
    level, mission, threshold = RandomLevel(5.0, 5.0), 40.0, 4.5

    def rate(gains: np.ndarray) -> np.ndarray:
        return 2.0 * np.exp(-0.5 * (threshold / gains) ** 2)

    hazard = rate(level.gain(walk(level, mission))).sum(axis=0) * STEP
    struck = -np.expm1(-hazard)
    error = struck.std() / math.sqrt(PATHS)
    exact = level.probability(rate(level.gains), mission)
    assert abs(struck.mean() - exact) < 4.5 * error
    # impacts as if they did not come together are too probable
    alone = -math.expm1(-mission * level.mean(rate(level.gains)))
    assert abs(struck.mean() - alone) > 4.5 * error


def test_limits_of_a_fast_and_of_a_slow_level() -> None:
    rates = np.exp(-8.0 / RandomLevel(5.0, 1.0).gains ** 2)
    fast, slow = RandomLevel(5.0, 1e-3), RandomLevel(5.0, 1e4)
    assert fast.probability(rates, 10.0) == pytest.approx(
        -math.expm1(-10.0 * fast.mean(rates)), rel=1e-4
    )
    assert slow.probability(rates, 10.0) == pytest.approx(
        slow.mean(-np.expm1(-10.0 * rates)), rel=2e-3
    )
    assert slow.probability(rates, 10.0) < 0.9 * fast.probability(rates, 10.0)


@pytest.mark.parametrize("bandwidth", [1.0, 15.0])
def test_a_mount_feels_the_squared_level_averaged_over_its_memory(bandwidth: float) -> None:
    level = RandomLevel(5.0, 1.0)
    squares = level.gain(walk(level, 60.0)) ** 2
    kept, felt = math.exp(-bandwidth * STEP), squares.copy()
    share = (1.0 - kept) / (bandwidth * STEP)  # a filter that is straight between the samples
    for row in range(1, len(felt)):
        felt[row] = kept * felt[row - 1] + (1.0 - share) * squares[row]
        felt[row] += (share - kept) * squares[row - 1]
    late = felt[len(felt) // 2 :]
    each = 3.0 * (late**2).mean(axis=0)
    error = each.std() / math.sqrt(PATHS)
    assert abs(each.mean() - level.felt(bandwidth).kurtosis) < 4.5 * error
    if bandwidth == 1.0:  # the error of a fast mount is too large to tell it from one at once
        assert abs(each.mean() - level.kurtosis) > 4.5 * error
