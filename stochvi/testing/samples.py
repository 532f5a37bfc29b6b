"""Assertions for the tests of any Monte Carlo, with a stated rate of false alarms.

The tolerance comes from the samples, and nobody picks it. Samples are an array, or a function of a
generator of numpy and a number that returns as many fresh independent samples:

    def test_mine():
        assert_mean(lambda rng, n: my_path_averages(rng, n), 1.0)

How often a right sampler fails. A function is asked for `size` samples. A test of the level
m = alarms^(1/3) that does not reject ends it: the sampler passes. One that rejects asks for 4 size
fresh samples, and a second one for 16 size. Only a third rejection is an alarm. The samples of the
stages are independent, so that a right sampler fails with probability m * m * m = alarms. It is
asked for size (1 + 4 m + 16 m^2) samples on average, 1.1 size at alarms = 1e-5. Of k comparisons
any fails with probability 1 - (1 - alarms)^k if they are independent, and k alarms at most if not.

How often a wrong one passes. An error of d standard deviations of a sample is d sqrt(size)
standard errors in the first stage. It is 2 and 4 times as many in the others. The first stage finds
d = (z(1 - m/2) + z(0.95)) / sqrt(size) with probability 0.95, where z are quantiles of the normal
distribution. Each of the others misses it with less than 1e-4. `finds` names an error: `size` is
then made as large as it needs. A single stage of the level 1e-5 would need 2.4 times as many.

A. Gandy and J. Scott, "Unit testing for MCMC and other Monte Carlo methods", arXiv:2001.06465
(2020), have such stages, each of which can also alarm by itself. That ends a gross error sooner. It
needs the far tails of a mean, which skewed samples do not have right: no stage here goes beyond m,
but for samples in an array, which are judged in one stage of the level `alarms`.

Samples must meet three conditions:

* They are independent. Refused are samples whose neighbours correlate by more than 0.2, and beyond
  doubt; a correlation of 0.2 makes 2e-4 of a rate of 1e-5. Several numbers in a row are one sample,
  their mean: return a row for each path, however its times hang together.
* Their variance is finite. Skewness is allowed for by their third moment (P. Hall, "On the removal
  of skewness by transformation", J. R. Statist. Soc. B 54, 1992); Student's test must reject as
  well. With 20 samples the rate holds for exponential ones, with 100 for lognormal ones of a sigma
  up to 1.5. Without a finite variance there are some 100 times as many alarms at 1e-5.
* They differ. A stage in which all are equal, but not to `truth`, spends none of the levels and
  asks for the next; if all stages are so, the samples are refused.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from statistics import NormalDist
from typing import Any, ClassVar, TypedDict, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["Options", "Suite", "assert_mean", "assert_proportion", "assert_rate"]

Samples = ArrayLike | Callable[[np.random.Generator, int], ArrayLike]
Array = NDArray[np.float64]

ALARMS = 1e-5
"""Probability that a comparison of a right sampler fails, as in the package of Gandy and Scott."""

GROWTH = (1, 4, 16)
"""Samples of the stages, in units of those of the first."""

POWER = 0.95
"""Probability with which an error of `finds` is found."""

RESERVE = 1.25
"""Samples for it, in units of those of a normal distribution with a known scatter: enough for an
exponential one whose scatter 1000 samples tell."""

FEWEST = 16
"""Smallest number of samples that show a scatter, and a skewness."""

MOST = 10_000
"""Samples that `finds` may ask for, in units of `size`."""

CORRELATED = 0.2
"""Largest correlation of neighbours that is let pass."""

DOUBT = 6.0
"""Standard errors that a correlation must lie above 0, by the products of neighbours themselves: as
rare events beside each other are few, they never do."""

DOMINANT = 0.25
"""Part of the squared scatter from one sample above which an alarm says so."""


class Options(TypedDict, total=False):
    """What the assertions take by name.

    Parameters
    ----------
    bias
        Bound of a bias that the sampler may have, that of its time step for instance; 0 where it is
        not given.
    finds
        An error that must be found with a probability of 95 %. `size` samples tell the scatter, and
        fresh ones are drawn in the number that this needs. An array that is too short is refused.
    size
        Number of samples of the first stage, 1000.
    alarms
        Probability that a right sampler fails, 1e-5.
    seed
        Seed of the generator, 0: the same samples again.

    See Also
    --------
    stochvi.testing.samples.assert_mean : An assertion that takes them.
    """

    bias: float
    finds: float
    size: int
    alarms: float
    seed: int | Sequence[int]


def assert_mean(samples: Samples, truth: float, **options: Unpack[Options]) -> None:
    """Fail if the mean of samples is not `truth`; a right sampler fails with probability `alarms`.

    Parameters
    ----------
    samples
        An array, or a function of a `numpy.random.Generator` and a number that returns so many
        independent samples. What has several dimensions is averaged over all but the first.
    truth
        The true mean.
    **options
        Keys of `Options`: bias, finds, size, alarms and seed.

    Raises
    ------
    AssertionError
        With the mean, its standard error, and the probability of such samples in each stage.
    ValueError
        If no verdict is possible: samples that are not finite, not independent or all equal.

    See Also
    --------
    stochvi.testing.samples.assert_proportion : Exact, of what happens or does not.
    stochvi.testing.samples.Suite : Shares a rate of false alarms among comparisons.

    Examples
    --------
    >>> assert_mean(lambda rng, n: rng.exponential(2.0, n), 2.0, finds=0.05)
    >>> assert_mean(
    ...     lambda rng, n: rng.exponential(2.1, n), 2.0, finds=0.05
    ... )  # doctest: +ELLIPSIS
    Traceback (most recent call last):
    ...
    AssertionError: the mean of 550976 samples is 2.101 ± 0.0028, not 2 ...
    """
    __tracebackhide__ = True
    _judge(_Mean(truth), samples, **options)


def assert_proportion(samples: Samples, truth: float, **options: Unpack[Options]) -> None:
    """Fail if samples of 0 and 1 are not 1 with probability `truth`, by the binomial distribution.

    The test is exact for any number and any probability, 0 and 1 included: a right sampler fails
    with probability `alarms` at most, with few events less often.

    Parameters
    ----------
    samples
        As for `assert_mean`, each 0 or 1, or false or true.
    truth
        The true probability.
    **options
        Keys of `Options`; `finds` is a difference of probabilities.

    Raises
    ------
    AssertionError
        With the proportion, its standard error, and the probability of such samples in each stage.
    ValueError
        If no verdict is possible: samples that are not 0 or 1, or not independent.

    See Also
    --------
    stochvi.testing.samples.assert_mean : Of any other numbers.

    Examples
    --------
    >>> assert_proportion(lambda rng, n: rng.random(n) < 0.01, 0.01)
    """
    __tracebackhide__ = True
    _judge(_Proportion(truth), samples, **options)


def assert_rate(
    samples: Samples,
    truth: float,
    exposure: float = 1.0,
    **options: Unpack[Options],
) -> None:
    """Fail if events do not come at the rate `truth`.

    Both Poisson's distribution of their total and the scatter of the counts must reject: few
    events are judged rightly, and so are events that come in clusters.

    Parameters
    ----------
    samples
        As for `assert_mean`, each the number of events in a window of time of its own.
    truth
        The true rate, events per unit of `exposure`.
    exposure
        Length of each window.
    **options
        Keys of `Options`; `finds` is a difference of rates.

    Raises
    ------
    AssertionError
        With the rate, its standard error, and the probability of such samples in each stage.
    ValueError
        If no verdict is possible: samples that are no counts, or not independent.

    See Also
    --------
    stochvi.testing.samples.assert_mean : Of numbers that are no counts.

    Examples
    --------
    >>> assert_rate(lambda rng, n: rng.poisson(3.0, n), 1.5, exposure=2.0)
    """
    __tracebackhide__ = True
    _judge(_Rate(truth, exposure=exposure), samples, **options)


@dataclass
class Suite:
    """Comparisons of right samplers, any of which fails with probability `alarms` at most.

    Each has the level alarms / comparisons, whose sum bounds the probability of any (Bonferroni),
    independent or not. The fixture `stochvi_samples` of pytest is one.

    Parameters
    ----------
    alarms
        Probability that any comparison fails.
    comparisons
        How many are made at most; one more is an error. Workers of pytest count their own.
    seed
        Seed of all samples, together with `name`.
    name
        What to call the next comparisons: the fixture sets the name of the test.

    See Also
    --------
    stochvi.testing.samples.assert_mean : What its methods take.

    Examples
    --------
    >>> suite = Suite(alarms=0.001, comparisons=2)
    >>> suite.assert_mean(lambda rng, n: rng.normal(size=n), 0.0)
    >>> suite.assert_proportion(lambda rng, n: rng.random(n) < 0.5, 0.5)
    >>> suite.assert_rate(lambda rng, n: rng.poisson(1.0, n), 1.0)
    Traceback (most recent call last):
    ...
    ValueError: comparisons must be at least the number that are made, got 2; state more
    """

    alarms: float = 1e-3
    comparisons: int = 100
    seed: int = 0
    name: str = ""
    made: int = field(default=0, init=False)

    def assert_mean(self, samples: Samples, truth: float, **options: Any) -> None:
        """`assert_mean` with the level and the seed of the suite."""
        __tracebackhide__ = True
        assert_mean(samples, truth, **options, **self._share())

    def assert_proportion(self, samples: Samples, truth: float, **options: Any) -> None:
        """`assert_proportion` with the level and the seed of the suite."""
        __tracebackhide__ = True
        assert_proportion(samples, truth, **options, **self._share())

    def assert_rate(self, samples: Samples, truth: float, **options: Any) -> None:
        """`assert_rate` with the level and the seed of the suite."""
        __tracebackhide__ = True
        assert_rate(samples, truth, **options, **self._share())

    def _share(self) -> Options:
        if self.made == self.comparisons:
            raise ValueError(
                "comparisons must be at least the number that are made, "
                f"got {self.comparisons}; state more"
            )
        self.made += 1
        seed = [self.seed, zlib.crc32(self.name.encode())]
        return {"alarms": self.alarms / self.comparisons, "seed": seed}


# ------------------------------------------------------------------------------
# The stages
# ------------------------------------------------------------------------------


def _judge(
    claim: _Mean,
    samples: Samples,
    bias: float = 0.0,
    finds: float | None = None,
    size: int = 1000,
    alarms: float = ALARMS,
    seed: int | Sequence[int] = 0,
) -> None:
    __tracebackhide__ = True
    claim = replace(claim, bias=bias)
    if not 0.0 < alarms < 1.0:
        raise ValueError(f"alarms must be between 0 and 1, got {alarms:g}")
    if not (math.isfinite(claim.truth) and bias >= 0.0):
        raise ValueError(
            f"truth must be finite, and bias must not be negative, got {claim.truth:g} and {bias:g}"
        )
    if finds is not None and not finds > bias:
        raise ValueError(f"finds must be above the bias of {bias:g}, got {finds:g}")
    growth = GROWTH if callable(samples) else (1,)
    mild = alarms ** (1.0 / len(growth))
    draw = _Fresh(claim, samples, np.random.default_rng(seed))
    if finds is not None:
        needed = claim.needed(draw(size), finds, mild)
        most = MOST * size if callable(samples) else np.size(samples, 0)
        if needed > most:
            raise ValueError(f"finds must need at most {most} samples, {finds:g} needs {needed}")
        size = max(size, needed)
    left, seen = alarms, list[str]()
    for times in growth:
        array = draw(times * size)
        p = claim.p_value(array)
        seen.append("no scatter" if p is None else f"p = {p:.1g}")
        if p is not None:
            if p > (left if times == growth[-1] else mild):
                return
            left /= mild
    if p is None:
        raise ValueError(
            f"samples must differ, got {len(array)} times {array[0]:.9g} and not "
            f"{claim.truth:.9g}; use assert_proportion, or more samples"
        )
    raise AssertionError(
        f"{claim.told(array)} ({', '.join(seen)}). A right sampler fails so with probability "
        f"{alarms:.1g}"
    )


@dataclass
class _Fresh:
    """Samples of a function, new ones at every call; or those of an array."""

    claim: _Mean
    samples: Samples
    rng: np.random.Generator
    before: Array | None = None

    def __call__(self, number: int) -> Array:
        if not callable(self.samples):
            return self.claim.read(self.samples)
        found = self.claim.read(self.samples(self.rng, number))
        if len(found) != number:
            raise ValueError(f"samples must be the {number} that are asked for, got {len(found)}")
        old, self.before = self.before, found
        if old is not None and np.ptp(old) > 0.0 and np.array_equal(found[: len(old)], old):
            raise ValueError("samples must be fresh, got those before; draw them by the generator")
        return found


# ------------------------------------------------------------------------------
# What is claimed of samples, and how probable they are if it is true
# ------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Mean:
    truth: float
    bias: float = 0.0
    word: ClassVar[str] = "mean"

    def read(self, samples: ArrayLike) -> Array:
        """One number for each sample, if they can be judged."""
        found: Array = np.atleast_1d(np.asarray(samples, dtype=float))
        found = found.reshape(len(found), -1).mean(axis=1)
        if len(found) < FEWEST:
            raise ValueError(f"samples must be at least {FEWEST}, got {len(found)}")
        if wrong := int(np.sum(~np.isfinite(found))):
            raise ValueError(f"samples must be finite, got {wrong} of {len(found)} that are not")
        if np.ptp(found) > 0.0:
            off = found - found.mean()
            off /= np.abs(off).max()
            products = off[1:] * off[:-1]
            correlation = float(products.sum() / (off @ off))
            beyond = float(products.sum()) > DOUBT * math.sqrt(products @ products)
            if beyond and correlation > CORRELATED:
                raise ValueError(
                    f"samples must be independent, got a correlation of {correlation:.2g} between "
                    "neighbours; return a row for each independent path"
                )
        return found

    def nearest(self, samples: Array) -> float:
        """The number nearest to the samples that the truth, and the bias, allow."""
        return float(np.clip(samples.mean(), self.truth - self.bias, self.truth + self.bias))

    def p_value(self, samples: Array) -> float | None:
        """By Student's test and by that of Hall, whichever rejects less; None without a scatter."""
        if np.ptp(samples) == 0.0:
            return 1.0 if abs(samples[0] - self.truth) <= self.bias else None
        off = samples - samples.mean()
        unit = float(np.abs(off).max())  # third powers of any unit are numbers
        off /= unit
        number, variance = len(off), float(off @ off) / len(off)
        t = (float(samples.mean()) - self.nearest(samples)) / unit
        t /= math.sqrt(variance / (number - 1))
        skewness = float(off * off @ off) / number / variance**1.5 / math.sqrt(number)
        hall = t + skewness * t**2 / 3.0 + skewness**2 * t**3 / 27.0 + skewness / 6.0
        return _student(min(abs(t), abs(hall)), number - 1)

    def scatter(self, samples: Array, error: float) -> float:
        """Standard deviation of a sample, where there is such an error."""
        return float(samples.std(ddof=1))

    def needed(self, samples: Array, error: float, level: float) -> int:
        """Samples of which a test at that level finds an error, with the probability `POWER`."""
        reach = NormalDist().inv_cdf(1.0 - level / 2.0) + NormalDist().inv_cdf(POWER)
        spread = self.scatter(samples, error) / (error - self.bias)
        return math.ceil(RESERVE * (reach * spread) ** 2)

    def told(self, samples: Array) -> str:
        """What was found, and what was expected."""
        number, squares = len(samples), (samples - samples.mean()) ** 2
        error = float(samples.std(ddof=1)) / math.sqrt(number)
        text = f"the {self.word} of {number} samples is {samples.mean():.6g} ± {error:.2g}, "
        text += f"not {self.truth:.6g}" + (f" ± {self.bias:.2g}" if self.bias else "")
        if squares.max() > DOMINANT * squares.sum():
            text += f"; one sample holds {squares.max() / squares.sum():.0%} of the scatter: "
            text += "is the variance finite?"
        return text


@dataclass(frozen=True)
class _Proportion(_Mean):
    word: ClassVar[str] = "proportion"

    def __post_init__(self) -> None:
        if not 0.0 <= self.truth <= 1.0:
            raise ValueError(f"truth must be a probability from 0 to 1, got {self.truth:g}")

    def read(self, samples: ArrayLike) -> Array:
        if not np.isin(samples, (0, 1)).all() or np.ndim(samples) != 1:
            raise ValueError("samples must be 0 or 1 each, in one row; assert_mean takes others")
        return super().read(samples)

    def p_value(self, samples: Array) -> float:
        near = float(np.clip(self.nearest(samples), 0.0, 1.0))
        return _binomial(int(samples.sum()), len(samples), near)

    def scatter(self, samples: Array, error: float) -> float:
        ends = np.clip([self.truth - error, self.truth + error], 0.0, 1.0)
        return float(np.sqrt(ends * (1.0 - ends)).max())


@dataclass(frozen=True)
class _Rate(_Mean):
    exposure: float = 1.0
    word: ClassVar[str] = "rate"

    def __post_init__(self) -> None:
        if not (self.truth >= 0.0 and self.exposure > 0.0):
            raise ValueError(
                "truth must not be negative, and exposure must be positive, "
                f"got {self.truth:g} and {self.exposure:g}"
            )

    def read(self, samples: ArrayLike) -> Array:
        counts = np.asarray(samples, dtype=float)
        if np.ndim(counts) != 1 or not (counts >= 0.0).all() or (counts % 1.0).any():
            raise ValueError("samples must be whole numbers of events, in one row")
        return super().read(counts / self.exposure)

    def p_value(self, samples: Array) -> float:
        whole = self.exposure * len(samples)
        near = max(self.nearest(samples), 0.0)
        few = _poisson(round(float(samples.mean()) * whole), near * whole)
        return max(few, super().p_value(samples) or 0.0)

    def scatter(self, samples: Array, error: float) -> float:
        return max(super().scatter(samples, error), math.sqrt((self.truth + error) / self.exposure))


# ------------------------------------------------------------------------------
# Probabilities of both tails
# ------------------------------------------------------------------------------


def _student(t: float, degrees: int) -> float:
    """Of Student's distribution, to 4 % at 1e-5 and 15 degrees of freedom, and never too small: the
    normal approximation of D. L. Wallace, Ann. Math. Statist. 30 (1959)."""
    normal = math.sqrt(degrees * math.log1p(t * t / degrees))
    return math.erfc((8 * degrees + 1) / (8 * degrees + 3) * normal / math.sqrt(2.0))


def _binomial(events: int, trials: int, chance: float) -> float:
    if chance in (0.0, 1.0):
        return float(events == chance * trials)
    if events < chance * trials:  # the upper tail of what did not happen
        return _binomial(trials - events, trials, 1.0 - chance)
    none = trials - events
    first = math.lgamma(trials + 1) - math.lgamma(events + 1) - math.lgamma(none + 1)
    first += events * math.log(chance) + none * math.log1p(-chance)
    further = np.arange(min(none, _far(trials)))
    return _doubled(first, (none - further) / (events + 1 + further) * chance / (1.0 - chance))


def _poisson(events: int, expected: float) -> float:
    if expected == 0.0:
        return float(events == 0)
    first = events * math.log(expected) - expected - math.lgamma(events + 1)
    if events < expected:
        return _doubled(first, np.arange(events, 0, -1) / expected)
    further = np.arange(_far(expected))
    return _doubled(first, expected / (events + 1 + further))


def _far(variance: float) -> int:
    """How far from its mean a number of events can be."""
    return 100 + math.ceil(40.0 * math.sqrt(variance))


def _doubled(first: float, ratios: Array) -> float:
    """Twice a sum of probabilities, by the logarithm of the first and the ratios of neighbours."""
    return min(1.0, 2.0 * math.exp(first) * (1.0 + float(np.cumprod(ratios).sum())))
