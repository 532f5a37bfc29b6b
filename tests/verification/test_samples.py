"""`stochvi.testing.samples`: right samplers fail as rarely as stated, wrong ones are found."""

import math
import subprocess
import sys
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy import stats
from scipy.signal import lfilter

from stochvi.testing import samples
from stochvi.testing.samples import Suite, assert_mean, assert_proportion, assert_rate
from support.refusals import refusals

Sampler = Callable[[np.random.Generator, int], np.ndarray]


def alarms_of(runs: int, compare: Callable[..., None], *arguments: Any, **options: Any) -> int:
    """How many of so many seeds fail."""
    found = 0
    for seed in range(runs):
        try:
            compare(*arguments, seed=seed, **options)
        except AssertionError:
            found += 1
    return found


def normal(rng: np.random.Generator, number: int) -> np.ndarray:
    return rng.normal(size=number)


def exponential(rng: np.random.Generator, number: int) -> np.ndarray:
    return rng.exponential(size=number)


def lognormal(rng: np.random.Generator, number: int) -> np.ndarray:
    return rng.lognormal(size=number)


def rare(rng: np.random.Generator, number: int) -> np.ndarray:
    return rng.random(number) < 0.01


def clusters(rng: np.random.Generator, number: int) -> np.ndarray:
    return 10 * rng.poisson(0.3, number)


def paths(rng: np.random.Generator, number: int) -> np.ndarray:
    """Rows of 20 times that hang together."""
    return lfilter([math.sqrt(1.0 - 0.9**2)], [1.0, -0.9], rng.normal(size=(number, 20)))


SEEDS = pytest.mark.parametrize("runs", [100, pytest.param(1000, marks=pytest.mark.verify)])
RIGHT = {
    "normal": (assert_mean, normal, 0.0, {}),
    "exponential": (assert_mean, exponential, 1.0, {}),
    "lognormal": (assert_mean, lognormal, math.exp(0.5), {}),
    "zero-or-one": (assert_mean, lambda rng, n: rng.random(n) < 0.3, 0.3, {}),
    "rows": (assert_mean, paths, 0.0, {}),
    "any-unit": (assert_mean, lambda rng, n: 1e-200 * rng.normal(size=n), 0.0, {}),
    "array": (assert_mean, None, 0.0, {}),
    "proportion": (assert_proportion, lambda rng, n: rng.random(n) < 0.3, 0.3, {}),
    "poisson": (assert_rate, lambda rng, n: rng.poisson(3.0, n), 1.5, {"exposure": 2.0}),
    "clusters": (assert_rate, clusters, 1.5, {"exposure": 2.0}),
}  # fmt: skip
"""Right samplers, for which a rate of alarms is reached and not only kept."""


@SEEDS
@pytest.mark.parametrize("name", RIGHT)
def test_a_right_sampler_fails_as_often_as_stated(name: str, runs: int) -> None:
    compare, sampler, truth, options = RIGHT[name]
    if sampler is None:
        found = sum(
            alarms_of(
                1, compare, np.random.default_rng([seed, 1]).normal(size=100), truth, alarms=0.1
            )
            for seed in range(runs)
        )
    else:
        found = alarms_of(runs, compare, sampler, truth, alarms=0.1, size=100, **options)
    assert stats.binomtest(found, runs, 0.1).pvalue > 1e-4


@pytest.mark.parametrize(
    ("compare", "sampler", "truth"),
    [
        (assert_mean, normal, 0.0), (assert_mean, lognormal, math.exp(0.5)),
        (assert_mean, lambda rng, n: rng.standard_t(3.0, n), 0.0),
        (assert_proportion, rare, 0.01),
        (assert_proportion, lambda rng, n: rng.random(n) < 0.0, 0.0),
        (assert_rate, lambda rng, n: rng.poisson(1e-3, n), 1e-3),
        (assert_rate, lambda rng, n: 10 * rng.poisson(1e-2, n), 0.1),
    ],
)  # fmt: skip
@SEEDS
def test_a_right_sampler_passes_at_the_level_of_a_suite(
    compare: Callable[..., None], sampler: Sampler, truth: float, runs: int
) -> None:
    assert alarms_of(runs, compare, sampler, truth) == 0


WRONG = {
    "mean": (assert_mean, lambda rng, n: rng.normal(0.1, size=n), 0.0, 0.1, {}),
    "too-small-a-mean": (assert_mean, exponential, 1.1, 0.1, {}),
    "too-large-a-mean": (assert_mean, exponential, 0.9, 0.1, {}),
    "beyond-its-bias": (
        assert_mean, lambda rng, n: rng.normal(0.2, size=n), 0.0, 0.2, {"bias": 0.1},
    ),
    "half-as-often": (assert_proportion, rare, 0.02, 0.01, {}),
    "twice-as-often": (assert_proportion, rare, 0.005, 0.005, {}),
    "rate": (assert_rate, clusters, 2.0, 0.5, {"exposure": 2.0}),
}  # fmt: skip
"""Samplers with a fault, and the error of that size which must be found."""


@SEEDS
@pytest.mark.parametrize("name", WRONG)
def test_an_error_is_found_as_often_as_stated(name: str, runs: int) -> None:
    compare, sampler, truth, error, options = WRONG[name]
    found = alarms_of(runs, compare, sampler, truth, finds=error, **options)
    assert stats.binomtest(found, runs, samples.POWER, alternative="less").pvalue > 1e-4


def test_a_named_error_is_missed_with_a_tenth_of_the_samples() -> None:
    sampler = WRONG["mean"][1]
    size = samples._Mean(0.0).needed(
        normal(np.random.default_rng(0), 1000), 0.1, 1e-5 ** (1.0 / 3.0)
    )
    assert alarms_of(100, assert_mean, sampler, 0.0, size=size) >= 90
    assert alarms_of(100, assert_mean, sampler, 0.0, size=size // 10) <= 75


def test_a_right_sampler_is_asked_for_few_samples_more() -> None:
    """size (1 + 4 m + 16 m^2) on average."""
    asked = []

    def counted(rng: np.random.Generator, number: int) -> np.ndarray:
        asked.append(number)
        return normal(rng, number)

    runs, mild = 400, 0.1
    alarms_of(runs, assert_mean, counted, 0.0, size=100, alarms=mild**3)
    asked_on_average = 100.0 * (1.0 + 4.0 * mild + 16.0 * mild**2)
    second, third = asked.count(400), asked.count(1600)
    assert asked.count(100) == runs and sum(asked) == 100 * runs + 400 * second + 1600 * third
    assert abs(sum(asked) / runs - asked_on_average) < 4.5 * 100.0 * math.sqrt(
        (16.0 * mild + 256.0 * mild**2) / runs
    )


def test_tails_are_those_of_scipy() -> None:
    rng = np.random.default_rng(3)
    for _ in range(300):
        trials, chance = int(10 ** rng.uniform(1.3, 6.0)), 10 ** rng.uniform(-5.0, 0.0)
        events = int(rng.binomial(trials, chance))
        law = stats.binom(trials, chance)
        tail = law.cdf(events) if events < trials * chance else law.sf(events - 1)
        assert samples._binomial(events, trials, chance) == pytest.approx(
            min(1.0, 2.0 * tail), 1e-6
        )
        expected = 10 ** rng.uniform(-3.0, 5.0)
        events = int(rng.poisson(expected))
        law = stats.poisson(expected)
        tail = law.cdf(events) if events < expected else law.sf(events - 1)
        assert samples._poisson(events, expected) == pytest.approx(min(1.0, 2.0 * tail), 1e-6)
    for degrees in (15, 50, 1000):
        for chance in (0.5, 0.02, 1e-3, 1e-5):
            found = samples._student(float(stats.t.isf(chance / 2.0, degrees)), degrees)
            assert 0.999 * chance < found < 1.04 * chance


# ------------------------------------------------------------------------------
# Samples that cannot be judged
# ------------------------------------------------------------------------------


def correlated(rng: np.random.Generator, number: int) -> np.ndarray:
    return lfilter([math.sqrt(0.75)], [1.0, -0.5], rng.normal(size=number))


test_samples_without_a_verdict_are_refused = refusals(
    assert_mean,
    (correlated, 0.0, "a row for each independent path"),
    (lambda rng, n: np.sort(rng.random(n)), 0.5, "independent"),
    (lambda rng, n: np.ones(n), 2.0, "samples must differ, got 16000 times 1 and not 2"),
    (lambda rng, n: normal(np.random.default_rng(0), n), 0.2, "must be fresh"),
    (lambda rng, n: normal(rng, n + 1), 0.0, "must be the 1000 that are asked for, got 1001"),
    (lambda rng, n: 1.0, 1.0, "at least 16, got 1"),
    (lambda rng, n: normal(rng, n) * np.nan, 0.0, "finite, got 1000 of 1000"),
    ([math.inf] * 30, 0.0, "finite, got 30 of 30"),
    (np.ones(100), 2.0, "samples must differ, got 100 times"),
    (normal, math.nan, "truth must be finite"),
    error=ValueError,
)


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"alarms": 0.0}, "alarms must be between 0 and 1"),
        ({"finds": 0.1, "bias": 0.1}, "finds must be above the bias of 0.1, got 0.1"),
        ({"finds": 1e-9}, "finds must need at most 10000000 samples"),
        ({"bias": -1.0}, "bias must not be negative"),
        ({"size": 3}, "at least 16, got 3"),
    ],
)
def test_options_out_of_range_are_refused(options: dict[str, Any], sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        assert_mean(normal, 0.0, **options)


def test_counts_and_chances_are_what_they_are_called() -> None:
    with pytest.raises(ValueError, match="0 or 1 each"):
        assert_proportion(normal, 0.5)
    with pytest.raises(ValueError, match="whole numbers of events"):
        assert_rate(normal, 0.5)
    with pytest.raises(ValueError, match="a probability from 0 to 1"):
        assert_proportion(rare, 1.5)
    with pytest.raises(ValueError, match="exposure must be positive"):
        assert_rate(clusters, 1.0, exposure=0.0)
    with pytest.raises(ValueError, match="finds must need at most 100 samples"):
        assert_mean(normal(np.random.default_rng(0), 100), 0.0, finds=0.1)


def test_constants_are_right_or_refused_and_rare_events_no_correlation() -> None:
    assert_mean(lambda rng, n: np.full(n, 0.1), 0.1)
    two = np.zeros(100)
    two[50:52] = 1.0
    assert_proportion(two, 0.02)


def test_an_alarm_says_what_was_seen() -> None:
    said = r"mean of 16000 samples is -?0\.\d+ ± 0\.0079, not 1 \(p = \S+, p = \S+, p = \S+\)"
    with pytest.raises(AssertionError, match=said):
        assert_mean(normal, 1.0)
    with pytest.raises(AssertionError, match="of the scatter: is the variance finite"):
        assert_mean(lambda rng, n: rng.standard_cauchy(n) ** 2, -1e9, size=16)


# ------------------------------------------------------------------------------
# Suites, and what is imported
# ------------------------------------------------------------------------------


@SEEDS
def test_a_suite_of_right_samplers_fails_as_rarely_as_stated(runs: int) -> None:
    """Ten comparisons with a rate of 0.2 for any: independent ones fail a little more rarely."""

    def suite(seed: int) -> None:
        own = Suite(alarms=0.2, comparisons=10, seed=seed)
        for number in range(10):
            own.name = str(number)
            own.assert_mean(normal, 0.0, size=20 * (1 + number % 3))

    assert stats.binomtest(alarms_of(runs, suite), runs, 1.0 - 0.98**10).pvalue > 1e-4


TESTS = """
def test_right(stochvi_samples):
    assert stochvi_samples.alarms == 0.01
    stochvi_samples.assert_mean(lambda rng, n: rng.normal(size=n), 0.0)

def test_samples_of_its_own(stochvi_samples):
    def draw(rng, n):
        assert abs(rng.normal() - FIRST) > 1e-9
        return rng.normal(size=n)
    stochvi_samples.assert_mean(draw, 0.0)

def test_wrong(stochvi_samples):
    stochvi_samples.assert_proportion(lambda rng, n: rng.random(n) < 0.4, 0.5, finds=0.1)

def test_one_too_many(stochvi_samples):
    stochvi_samples.assert_mean(lambda rng, n: rng.normal(size=n), 0.0)
"""


def test_the_fixture_shares_a_rate_among_the_tests(
    pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PYTEST_DISABLE_PLUGIN_AUTOLOAD", "1")
    pytester.makeini("[pytest]\nstochvi_alarms = 0.01\nstochvi_comparisons = 3")
    pytester.makepyfile(f"FIRST = {np.random.default_rng([0, 0]).normal()}\n{TESTS}")
    found = pytester.runpytest_inprocess("-p", "stochvi.verification.testing.plugin")
    found.assert_outcomes(passed=2, failed=2)
    found.stdout.fnmatch_lines(
        ["*the proportion of * samples is 0.*not 0.5*", "*got 3; state more*"]
    )


ALONE = """
import sys

class Missing:
    def find_spec(self, name, *_):
        package = name.partition(".")[0]
        if package not in {"numpy", "stochvi", "lazy_loader", *sys.stdlib_module_names}:
            raise ImportError(name)

sys.meta_path.insert(0, Missing())
from stochvi.testing.samples import *

assert_mean(lambda rng, n: rng.normal(size=n), 0.0, finds=0.1)
assert_proportion(lambda rng, n: rng.random(n) < 0.1, 0.1)
assert_rate(lambda rng, n: rng.poisson(2.0, n), 2.0)
print(*(each for each in sys.modules if each.startswith("stochvi.")))
"""


def test_the_kit_imports_numpy_alone() -> None:
    """lazy_loader is what the package itself is imported by."""
    found = subprocess.run(
        [sys.executable, "-c", ALONE], capture_output=True, text=True, check=True
    ).stdout
    assert set(found.split()) == {
        "stochvi.results", "stochvi.results.errors", "stochvi.results.plots", "stochvi.testing",
        "stochvi.testing.samples", "stochvi.verification", "stochvi.verification.testing",
    }  # fmt: skip
