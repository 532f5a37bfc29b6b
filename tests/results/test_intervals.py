"""Intervals and standard errors: how often they cover, and what they are for known laws."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

from stochvi.results.intervals import (
    GAUSSIAN_95,
    PathMoments,
    binomial_interval,
    delta_method,
    events_suffice,
    jackknife_error,
    jackknife_ratio,
    logarithmic_interval,
    mean_and_error,
    most_events,
    normal_quantile,
    poisson_interval,
    ratio_and_error,
    satterthwaite_degrees,
    student_factor,
    student_quantile,
    upper_limit_unseen,
)

REPEATS = 4000


def covers_95(held: np.ndarray) -> bool:
    """Whether intervals that held so often may be 95 % ones: three standard errors of the count."""
    return abs(held.mean() - 0.95) < 3.0 * math.sqrt(0.95 * 0.05 / len(held))


def test_quantiles_of_95_percent() -> None:
    assert normal_quantile(0.05) == pytest.approx(GAUSSIAN_95, rel=1e-12)
    assert student_quantile(0.05, 4.0) == pytest.approx(stats.t.ppf(0.975, 4.0), rel=1e-12)


def test_a_logarithmic_interval_of_nothing_is_everything() -> None:
    assert logarithmic_interval(0.0, 0.0, 5, 0.95) == (0.0, math.inf)


@pytest.mark.parametrize("events", [0, 1, 7])
def test_the_ends_of_an_interval_of_a_rate_are_seen_with_the_chance_of_its_tails(
    events: int,
) -> None:
    low, high = poisson_interval(events, 2.0)
    assert stats.poisson.cdf(events, 2.0 * high) == pytest.approx(0.025)
    if events:
        assert stats.poisson.sf(events - 1, 2.0 * low) == pytest.approx(0.025)
    else:
        assert low == 0.0


@pytest.mark.parametrize(("events", "trials"), [(0, 9), (3, 9), (9, 9)])
def test_clopper_and_pearsons_ends_are_seen_with_the_chance_of_their_tails(
    events: int, trials: int
) -> None:
    low, high = binomial_interval(events, trials)
    assert high == 1.0 or stats.binom.cdf(events, trials, high) == pytest.approx(0.025)
    assert low == 0.0 or stats.binom.sf(events - 1, trials, low) == pytest.approx(0.025)


def test_wilsons_ends_lie_at_the_normal_quantile() -> None:
    for end in binomial_interval(3, 40, rule="wilson"):
        score = (3 / 40 - end) / math.sqrt(end * (1.0 - end) / 40)
        assert abs(score) == pytest.approx(GAUSSIAN_95)


def test_nothing_is_seen_at_the_upper_limit_with_a_chance_of_5_percent() -> None:
    assert stats.poisson.pmf(0, 3.0 * upper_limit_unseen(3.0)) == pytest.approx(0.05)


def test_the_jackknife_of_a_mean_is_its_standard_error() -> None:
    samples = np.random.default_rng(2).standard_normal((3, 20))
    left_out = (samples.sum(axis=1, keepdims=True) - samples) / 19
    expected = [mean_and_error(row)[1] for row in samples]
    assert jackknife_error(left_out) == pytest.approx(expected)
    assert jackknife_error(left_out[0]) == pytest.approx(expected[0])


def test_errors_of_a_ratio_cover_what_it_scatters_by() -> None:
    """Ratios of correlated sums; by the jackknife and to first order."""
    random = np.random.default_rng(3)
    below = 1.0 + 0.3 * random.standard_normal((REPEATS, 200))
    above = 2.0 * below + 0.2 * random.standard_normal(below.shape)
    quantile = student_quantile(0.05, 199.0)
    for method in (jackknife_ratio, ratio_and_error):
        found = np.array([method(*pair) for pair in zip(above, below, strict=True)])
        assert covers_95(np.abs(found[:, 0] - 2.0) < quantile * found[:, 1])


def test_the_delta_method_and_the_jackknife_agree_to_first_order() -> None:
    samples = 1.0 + 0.01 * np.random.default_rng(4).standard_normal((2, 100))
    covariance = np.cov(samples) / samples.shape[1]
    value, error = delta_method(lambda m: m[0] / m[1], samples.mean(axis=1), covariance)
    other, other_error = jackknife_ratio(*samples)
    assert value == pytest.approx(other)
    # to first order in the scatter of the samples: what is left is smaller by that factor
    assert error == pytest.approx(other_error, rel=0.01)


def test_a_variance_that_is_negative_by_rounding_adds_no_error() -> None:
    covariance = np.array([[4e-4, 0.0], [0.0, -1e-24]])
    value, error = delta_method(lambda m: m[0] * m[1], np.array([2.0, 3.0]), covariance)
    assert (value, error) == (6.0, pytest.approx(3.0 * 0.02, rel=1e-6))


def test_the_delta_method_takes_functions_at_many_places_at_once() -> None:
    random = np.random.default_rng(5)
    products = 1.0 + 0.1 * random.standard_normal((50, 2, 3))
    away = products - products.mean(axis=0)
    moments = PathMoments(
        count=50, mean=products.mean(axis=0), scatter=np.einsum("prf,psf->rsf", away, away)
    )
    together = delta_method(lambda m: m[0] * m[1], moments.mean, moments.covariance)
    for place in range(3):
        alone = delta_method(
            lambda m: m[0] * m[1], moments.mean[:, place], moments.covariance[:, :, place]
        )
        assert [each[place] for each in together] == pytest.approx(list(alone))


def test_merged_moments_are_those_of_all_paths() -> None:
    samples = np.random.default_rng(6).standard_normal((30, 2))

    def moments(part: np.ndarray) -> PathMoments:
        away = part - part.mean(axis=0)
        return PathMoments(count=len(part), mean=part.mean(axis=0), scatter=away.T @ away)

    merged = moments(samples[:7]).merge(moments(samples[7:]))
    assert merged.count == 30
    assert merged.mean == pytest.approx(moments(samples).mean)
    assert merged.scatter == pytest.approx(moments(samples).scatter)


def test_degrees_of_freedom_of_a_sum_are_those_of_satterthwaite() -> None:
    """Never fewer than those of the least known term, and fewer than of all samples together."""
    found = satterthwaite_degrees([0.1, 0.3], [11, 41])
    assert found == pytest.approx((0.01 + 0.09) ** 2 / (0.01**2 / 10.0 + 0.09**2 / 40.0))
    assert satterthwaite_degrees([1e-9, 0.3], [11, 41]) == pytest.approx(40.0)
    assert satterthwaite_degrees([0.0, 0.3], [11, 41]) == 40.0


@pytest.mark.parametrize("samples", [2, 4, 8, 64])
@pytest.mark.parametrize("single", [True, False])
def test_a_rate_of_clusters_is_within_its_interval_or_limit(samples: int, single: bool) -> None:
    """Clusters of one event, or of an exponential number, from one of them to hundreds."""
    random = np.random.default_rng(4)
    for mean in (1.0, 6.0, 20.0, 300.0):
        counts = random.poisson(mean / samples, (1000, samples)).astype(float)
        if not single:
            counts = np.where(counts > 0.0, random.gamma(np.maximum(counts, 1.0)), 0.0)
        held, plain = [], []
        for row in counts[counts.any(axis=1)]:
            value, error = mean_and_error(row)
            low, high = 0.0, most_events(value, error, samples)
            if events_suffice(value, error, samples):
                low, high = logarithmic_interval(value, error, samples - 1)
            held.append(low <= mean / samples <= high)
            plain.append(abs(value - mean / samples) <= GAUSSIAN_95 * error)
        assert np.mean(held) > 0.95 - 4.5 * math.sqrt(0.05 * 0.95 / len(held))
        # the negative control: two standard errors, of few samples or clusters
        if samples == 2 or (mean == 1.0 and not single):
            assert np.mean(plain) < 0.87


def test_few_samples_widen_a_standard_error_to_students() -> None:
    assert student_factor(5) == pytest.approx(stats.t.ppf(0.975, 4) / GAUSSIAN_95)
    assert student_factor(1) == math.inf and student_factor(10**6) == 1.0
