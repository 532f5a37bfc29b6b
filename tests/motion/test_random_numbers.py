"""The generator against plain integers and NumPy, and the normals against their law."""

import math

import numpy as np
import pytest
from scipy import stats

from stochvi.motion.kernels.random_numbers import (
    log_unit,
    normal_rows,
    seed_streams,
)
from support.naive import normals, stream_words


def draw(seed: int, paths: int, rows: int) -> np.ndarray:
    """(2 rows, paths) normals."""
    streams = np.empty((2, paths), np.uint64)
    seed_streams(np.uint64(seed), 0, streams)
    first, second = np.empty((2, rows, paths))
    normal_rows(streams[0], streams[1], first, second)
    return np.concatenate([first, second])


@pytest.mark.parametrize(("seed", "path"), [(0, 0), (1, 7), (2**62, 123456)])
def test_normals_are_box_muller_of_xoroshiro(seed: int, path: int) -> None:
    words = stream_words(seed, path, 200)
    uniform = np.array([(word >> 12) / 2.0**52 for word in words])
    radius = np.sqrt(-2.0 * np.log(1.0 - uniform[::2]))
    angle = (uniform[1::2] - 0.5) * math.pi / 2.0
    odd = np.array([word & 1 for word in words[1::2]], bool)
    sign = np.where([bool(word & 2) for word in words[1::2]], 1.0, -1.0)
    x = np.where(odd, np.sin(angle), np.cos(angle)) * radius * sign
    y = np.where(odd, np.cos(angle), np.sin(angle)) * radius * sign
    expected = np.stack([x, y], axis=1).ravel()
    # both sides round a handful of times, at most some units in the last place of the radius
    np.testing.assert_allclose(normals(seed, path, 200), expected, rtol=0, atol=8.5 * 1e-14)


def test_logarithm_keeps_its_digits_up_to_the_smallest_uniform() -> None:
    u = np.concatenate([2.0 ** -np.arange(0.0, 53.0), np.random.default_rng(1).random(10_000)])
    u = u[u >= 2.0**-52]
    mine = np.array([log_unit(np.float64(value)) for value in u])
    np.testing.assert_allclose(mine, np.log(u), rtol=4e-15, atol=4e-16)


def test_moments_up_to_the_eighth() -> None:
    z = draw(3, 256, 5_000).ravel()
    for power in range(1, 9):
        values = z**power
        truth = stats.norm.moment(power)
        error = math.sqrt((stats.norm.moment(2 * power) - truth**2) / len(z))
        assert abs(values.mean() - truth) < 4.5 * error, power


def test_distribution_and_tails() -> None:
    z = draw(4, 256, 40_000).ravel()
    assert stats.kstest(z[::50], "norm").pvalue > 1e-5
    for limit in (3.0, 4.0, 5.0, 5.5):
        expected = 2.0 * stats.norm.sf(limit) * len(z)
        seen = np.count_nonzero(np.abs(z) > limit)
        # exact Poisson limits at 4.5 standard deviations of a normal law
        low, high = stats.poisson.ppf(stats.norm.cdf([-4.5, 4.5]), expected)
        assert low <= seen <= high, limit


def test_paths_and_successive_draws_are_uncorrelated() -> None:
    z = draw(5, 64, 20_000)
    across = np.corrcoef(z.T)[np.triu_indices(64, 1)]
    assert np.abs(across).max() < stats.norm.isf(1e-6 / len(across)) / math.sqrt(len(z))
    first, second = z[:20_000].ravel(), z[20_000:].ravel()
    bound = 4.5 / math.sqrt(len(first))
    for a, b in ((first, second), (first**2 - 1, second**2 - 1)):
        assert abs(np.corrcoef(a, b)[0, 1]) < bound
    lagged = [np.corrcoef(z[:-lag].ravel(), z[lag:].ravel())[0, 1] for lag in (1, 2, 3)]
    assert np.abs(lagged).max() < bound


def test_a_stream_belongs_to_its_path_not_to_its_block() -> None:
    together = draw(6, 5, 10)
    np.testing.assert_array_equal(together[::10, 3], normals(6, 3, 2))
    assert not np.any(normals(6, 3, 100) == normals(7, 3, 100))
