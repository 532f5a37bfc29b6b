"""Estimates with their errors. Chapters: confidence intervals and propagation of statistical
errors; the classes of estimates, and the cost and provenance of an answer."""

from __future__ import annotations

import importlib.metadata
import math
import platform
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cache
from numbers import Real
from typing import Any, ClassVar, Literal, Self, TypeVar

import numpy as np
from scipy.special import betaincinv, gammaincinv, ndtri, stdtr, stdtrit

from stochvi.mathematics.numerics import Array
from stochvi.mathematics.units import NUMBER, ShownQuantity, explain_methods, outside_of_share

# ------------------------------------------------------------------------------
# Confidence intervals and the propagation of statistical errors, in one place.
#
# Everything that states an error of sampled numbers takes it from here. The module has quantiles of
# the normal and of Student's distribution, and intervals of means, counts and probabilities. It has
# the jackknife, and the delta method for functions of means over independent paths.
# ------------------------------------------------------------------------------


CONFIDENCE = 0.95
"""Confidence level of the intervals that the package reports, unless the user names another."""

GAUSSIAN_95 = 1.959963984540054
"""Half width of the central 95 % interval of a normal distribution, in standard deviations."""

GRADIENT_STEP = 1e-3
"""Step of the central differences of the delta method, in standard errors of each mean. With a step
of a whole standard error, a rate would reach 0 where a single path has all impacts."""

LARGEST_SCORE = 37.0
"""Distance from the mean, in standard errors, beyond which the probability of a normal variable is
0 in double precision."""


FEWEST_SAMPLES = 8
"""Smallest number of independent samples whose scatter gives an interval: Student's quantile is
then 2.36."""

FEWEST_CLUSTERS = 5
"""Smallest number of independent clusters from which the rate of events gets an interval. That of
the logarithm then covers the rate, of clusters with one event or with an exponential number, 94 to
98 times in 100 for any number of samples from `FEWEST_SAMPLES` on."""

ENOUGH_SAMPLES = 64
"""Number of independent samples from which a standard error passes for known: Student's quantile is
then 2 % above the normal one."""


# Quantiles ---------------------------------------------------------------------------------


def normal_quantile(outside: float) -> float:
    """Distance from the mean, in standard deviations, that a normal variable exceeds on either side
    with the probability `outside`.

    >>> round(normal_quantile(0.0027), 3)
    3.0
    """
    return -float(ndtri(outside / 2.0))


def student_quantile(outside: float, degrees: float) -> float:
    """Quantile of Student's distribution: the `normal_quantile` for a standard error that was
    estimated.

    The standard error has `degrees` degrees of freedom; with infinitely many the law is normal.

    >>> round(student_quantile(0.0027, 63.0), 3), round(student_quantile(0.0027, math.inf), 3)
    (3.123, 3.0)
    """
    if math.isinf(degrees):
        return normal_quantile(outside)
    return -float(stdtrit(degrees, outside / 2.0))


def normal_score(difference: float, standard_error: float, degrees: float) -> float | None:
    """The normal score with the same probability as a difference in estimated standard errors.

    `degrees` are the degrees of freedom of the standard error. None where nothing was sampled.

    >>> round(normal_score(3.122, 1.0, 63.0), 2)
    3.0
    """
    if standard_error <= 0.0:
        return None
    away = abs(difference) / standard_error
    if not math.isinf(degrees):
        tail = float(stdtr(degrees, -away))
        away = -float(ndtri(tail)) if tail > 0.0 else math.inf
        away = min(away, LARGEST_SCORE)
    return math.copysign(away, difference)


def student_factor(samples: int) -> float:
    """Factor on a standard error from so many independent samples that makes the normal 95 %
    interval Student's; 1 from `ENOUGH_SAMPLES` on, and infinite for a single sample.

    >>> round(student_factor(8), 3), student_factor(64)
    (1.206, 1.0)
    """
    if samples < 2 or samples >= ENOUGH_SAMPLES:
        return 1.0 if samples > 1 else math.inf
    return student_quantile(1.0 - CONFIDENCE, samples - 1.0) / GAUSSIAN_95


def satterthwaite_degrees(errors: Sequence[float], counts: Sequence[int]) -> float:
    """Degrees of freedom of the standard error of a sum or difference (F. E. Satterthwaite 1946)

        (s1^2 + s2^2)^2 / (s1^4 / (n1 - 1) + s2^4 / (n2 - 1)),

    with s the standard errors of independent terms, from n samples each; infinite where nothing was
    sampled.

    >>> satterthwaite_degrees([0.1, 0.1], [11, 41])
    32.0
    """
    sampled = [(e, n - 1) for e, n in zip(errors, counts, strict=True) if e > 0.0 and n > 1]
    largest = max((error for error, _ in sampled), default=0.0)
    shares = [((error / largest) ** 2, degrees) for error, degrees in sampled]
    if not shares:
        return math.inf
    return sum(share for share, _ in shares) ** 2 / sum(
        share**2 / degrees for share, degrees in shares
    )


# Intervals ---------------------------------------------------------------------------------


def reach(quantile: float, errors: Iterable[float], biases: Iterable[float]) -> float:
    """Distance from a number, or a difference of numbers, to the end of its interval,

        quantile * sqrt(sum of errors^2) + sum of biases.

    `errors` are independent standard errors: that of each value, and where its bias was sampled as
    well that of the bias. `biases` are bounds on, or estimates of, systematic errors. They add up,
    because their signs are not known. Whatever makes an interval, or judges a difference, by all
    errors of an `Estimate` takes it from here.

    >>> round(reach(2.0, [0.3, 0.4], [0.1, 0.2]), 12)
    1.3
    """
    return quantile * math.hypot(*errors) + sum(biases)


def logarithmic_interval(
    value: float, error: float, degrees: float, confidence: float = CONFIDENCE, bias: float = 0.0
) -> tuple[float, float]:
    """Student's interval of the logarithm of a positive number, value exp(-+ t error / value).

    A bias moves both ends outwards. The lower end is never below 0. For a value of 0 the interval
    is (0, infinity).

    >>> [round(end, 3) for end in logarithmic_interval(1.0, 0.1, 19)]
    [0.811, 1.233]
    """
    if value <= 0.0:
        return 0.0, math.inf
    reach = student_quantile(1.0 - confidence, degrees) * error / value
    return max(value * math.exp(-reach) - bias, 0.0), value * math.exp(reach) + bias


def poisson_interval(
    events: int, exposure: float, confidence: float = CONFIDENCE
) -> tuple[float, float]:
    """Exact interval of the rate of a Poisson process, 1/s, from the number of events in `exposure`
    seconds (F. Garwood 1936).

    >>> [round(end, 4) for end in poisson_interval(0, 1.0)]
    [0.0, 3.6889]
    """
    tail = 0.5 * (1.0 - confidence)
    low = float(gammaincinv(events, tail)) if events else 0.0
    return low / exposure, float(gammaincinv(events + 1.0, 1.0 - tail)) / exposure


def binomial_interval(
    events: int, trials: int, confidence: float = CONFIDENCE,
    rule: Literal["clopper-pearson", "wilson"] = "clopper-pearson",
) -> tuple[float, float]:  # fmt: skip
    """Interval of a probability from the number of events in independent trials.

    The interval of C. J. Clopper and E. S. Pearson (1934) covers the probability at least as often
    as its confidence level states, that of E. B. Wilson (1927) about as often.

    >>> [round(end, 4) for end in binomial_interval(0, 10)]
    [0.0, 0.3085]
    """
    tail, missed = 0.5 * (1.0 - confidence), trials - events
    if rule == "wilson":
        share, weight = events / trials, normal_quantile(2.0 * tail) ** 2 / trials
        half = math.sqrt(weight * (share * (1.0 - share) + 0.25 * weight))
        middle = share + 0.5 * weight
        return (middle - half) / (1.0 + weight), (middle + half) / (1.0 + weight)
    low = float(betaincinv(events, missed + 1.0, tail)) if events else 0.0
    return low, float(betaincinv(events + 1.0, missed, 1.0 - tail)) if missed else 1.0


def upper_limit_unseen(exposure: float, confidence: float = CONFIDENCE) -> float:
    """Upper confidence limit of a Poisson rate after no event in `exposure` seconds, 1/s.

    It is the rate at which no event is seen with the probability 1 - confidence.

    >>> round(upper_limit_unseen(1.0), 4)
    2.9957
    """
    return -math.log1p(-confidence) / exposure


def clusters(value: float, error: float, samples: int) -> float:
    """Number of independent clusters that a sum of events over independent samples is worth.

    It is 1 / e^2, e the relative standard error: the number of clusters if all are of one size,
    fewer if some clusters hold most of the events (L. Kish 1965). It is no more than a quarter of
    `FEWEST_CLUSTERS` for each sample, as the scatter of few samples may be small by chance.

    >>> clusters(6.0, 2.0, 100), clusters(6.0, 0.0, 2)
    (9.0, 2.5)
    """
    most = 0.25 * FEWEST_CLUSTERS * samples
    return min((value / error) ** 2, most) if error > 0.0 else most


def events_suffice(value: float, error: float, samples: int) -> bool:
    """Whether events were seen in enough independent samples and clusters for an interval of their
    rate; else an upper limit alone can be stated (`most_events`)."""
    return samples >= FEWEST_SAMPLES and clusters(value, error, samples) >= FEWEST_CLUSTERS


def most_events(value: float, error: float, samples: int, confidence: float = CONFIDENCE) -> float:
    """Upper limit of a mean number of events, seen in few clusters of unknown size.

    Upper limit of the number of k clusters (Poisson), times the upper limit of the mean size where
    sizes have an exponential distribution: the limit holds at least as often as its confidence
    level states, as both seldom err to the same side.

    >>> most_events(1.0, 1.0, 100) > 20.0
    True
    """
    known, tail = clusters(value, error, samples), 1.0 - confidence
    return value * float(gammaincinv(known + 1.0, confidence) / gammaincinv(known, tail))


# Standard errors ---------------------------------------------------------------------------


def mean_and_error(samples: Array) -> tuple[float, float]:
    """Mean of independent samples with its standard error."""
    return float(samples.mean()), float(samples.std(ddof=1)) / math.sqrt(len(samples))


def jackknife_error(left_out: Array) -> Any:
    """Standard error of a statistic by the jackknife.

    `left_out` holds, along its last axis, the values f_i of the statistic without sample i of n
    independent samples: s^2 = (n - 1) / n sum (f_i - mean f)^2 (B. Efron and C. Stein, Ann.
    Statist. 9 (1981) 586). It holds for any smooth function of means. The result is a number for
    one row of values, else an array.
    """
    count = left_out.shape[-1]
    away = left_out - left_out.mean(axis=-1, keepdims=True)
    errors = np.sqrt((count - 1) / count * np.sum(away**2, axis=-1))
    return float(errors) if left_out.ndim == 1 else errors


def jackknife_ratio(
    above: Array, below: Array, function: Callable[[Any], Any] = lambda ratio: ratio
) -> tuple[float, float]:
    """A function of the ratio of two sums over independent samples, and its standard error.

    The error comes from the jackknife. The samples of `above` and `below` are pairs, which may be
    correlated.

    >>> jackknife_ratio(np.array([2.0, 4.0]), np.array([1.0, 2.0]))
    (2.0, 0.0)
    """
    left_out = (above.sum() - above) / (below.sum() - below)
    error = jackknife_error(np.asarray(function(left_out)))
    return float(function(above.sum() / below.sum())), error


def ratio_and_error(above: Array, below: Array) -> tuple[float, float]:
    """The ratio of two sums over independent samples, and its standard error to first order, which
    is Student's where samples are few."""
    count, total = len(above), float(below.sum())
    value = float(above.sum()) / total
    scatter = float(np.sum((above - value * below) ** 2)) * count / (count - 1)
    return value, student_factor(count) * math.sqrt(scatter) / total


def neighbours(mean: Array, covariance: Array) -> Iterator[tuple[int, Any, Array, Array]]:
    """For every row of the means that has an error: its number, the step of its central difference,
    and the means with this row raised and lowered by the step."""
    for row in range(len(mean)):
        # where other rows explain this one wholly, its variance is 0 up to rounding
        step = GRADIENT_STEP * np.sqrt(np.maximum(covariance[row, row], 0.0))
        if np.any(step):
            offset = np.zeros_like(mean)
            offset[row] = step
            yield row, step, mean + offset, mean - offset


def delta_method(
    function: Callable[[Array], Any], mean: Array, covariance: Array
) -> tuple[Any, Any]:
    """A smooth function of means, and its standard error to first order.

    Parameters
    ----------
    function
        Function of means of the shape (rows, ...) that returns values of the shape (...).
    mean, covariance
        (rows, ...) and (rows, rows, ...): the means, and the covariance of their errors.

    Returns
    -------
    value, error
        Of the shape (...).
    """
    gradient = np.zeros_like(mean)
    for row, step, above, below in neighbours(mean, covariance):
        change = np.asarray(function(above) - function(below))
        gradient[row] = np.divide(change, 2.0 * step, out=np.zeros_like(step), where=step > 0.0)
    if mean.ndim == 1:
        variance = gradient @ covariance @ gradient
        return function(mean), math.sqrt(max(float(variance), 0.0))
    variance = np.einsum("r...,rs...,s...->...", gradient, covariance, gradient)
    return function(mean), np.sqrt(np.maximum(variance, 0.0))


@dataclass(frozen=True, kw_only=True, eq=False)
class PathMoments:
    """Count, means and scatter of quantities that are computed for each of many independent paths.

    Parameters
    ----------
    count
        Number of independent paths.
    mean
        (rows, ...) means over the paths.
    scatter
        (rows, rows, ...) sums over the paths of products of deviations from the means.
    """

    count: int
    mean: Array
    scatter: Array

    def merge(self, other: Self) -> Self:
        """Moments of both groups of paths together, exact up to rounding errors.

        They do not depend on how paths were grouped, as long as the groups are merged in the same
        order (T. F. Chan, G. H. Golub and R. J. LeVeque 1983).
        """
        count = self.count + other.count
        shift = other.mean - self.mean
        between = shift[:, None] * shift * (self.count * other.count / count)
        return replace(
            self,
            count=count,
            mean=self.mean + shift * (other.count / count),
            scatter=self.scatter + other.scatter + between,
        )

    @property
    def covariance(self) -> Array:
        """Covariance of the errors of the means."""
        return np.asarray(self.scatter / (self.count * max(self.count - 1, 1)))


# ------------------------------------------------------------------------------
# Estimates, numbers with their errors, and the cost and provenance of an answer.
# ------------------------------------------------------------------------------


ERROR, BIAS, BIAS_ERROR, LIMIT = "standard_error", "bias", "bias_error", "upper_95"
"""Fields of an `Estimate`, behind whose value tables name their columns so."""


NEGLIGIBLE_BIAS = 0.2
"""Bias, in standard errors, that widens the 95 % interval by a tenth; a smaller one is not told."""


class WithValue:
    """What has a value and its errors, and is its value where Python converts, rounds, formats or
    orders numbers."""

    value: float

    def __float__(self) -> float:
        return float(self.value)

    def __round__(self, digits: int | None = None) -> float:
        return round(float(self.value), digits)

    def __format__(self, form: str) -> str:
        return format(float(self.value), form) if form else str(self)

    def __lt__(self, number: float) -> bool:
        return self.value < _plain_number(number)

    def __le__(self, number: float) -> bool:
        return self.value <= _plain_number(number)

    def __gt__(self, number: float) -> bool:
        return self.value > _plain_number(number)

    def __ge__(self, number: float) -> bool:
        return self.value >= _plain_number(number)


@explain_methods
@dataclass(frozen=True, kw_only=True)
class Estimate(WithValue):
    """A number with its errors.

    Parameters
    ----------
    value
        The number, in SI units.
    standard_error
        One standard deviation of the statistical error; 0 where nothing was sampled.
    bias
        Bound on, or estimate of, the systematic error that the time step or the model leaves;
        None where it is not known.
    how
        Source of the two errors, in words.
    upper_95
        Upper 95 % confidence limit of the rate of an event that was never seen, or in too few
        independent samples for an interval (`of_events`); the value is then 0.
    bias_error
        Standard error of `bias`, if the bias was estimated from samples.

    See Also
    --------
    stochvi.Response : What holds most of them.

    Notes
    -----
    All errors together make one interval, `interval(confidence)`,

        value -+ (z sqrt(standard_error^2 + bias_error^2) + bias),

    with the normal quantile z of the confidence, 1.96 of 95 %. The two standard errors are
    independent. The bias is added whole, as its sign is not known. `check`, `assert_agrees` and all
    intervals of tables, pages and pictures follow this rule. A bias of None leaves no interval.

    `float(estimate)` is its value, and so is what is rounded, formatted (`f"{rate:.3f}"`) or
    compared with a plain number. An estimate may be multiplied or divided by a plain number, or
    have a plain number added; its errors change accordingly. Two estimates cannot be combined or
    ordered by an operator, because the correlation of their errors is not known.

    Examples
    --------
    >>> rate = Estimate(value=0.2828, standard_error=0.0004, bias=0.0, how="256 paths")
    >>> rate
    0.28280(40) [256 paths]
    >>> rate * 3600.0
    1018.1(1.4) [256 paths]
    >>> float(rate), round(rate, 2), f"{rate:.3f}", rate < 0.3
    (0.2828, 0.28, '0.283', True)
    >>> Estimate(value=0.28, standard_error=0.003, bias=0.002, bias_error=0.004, how="64 paths")
    0.2800(30), bias up to 0.0059 [64 paths]
    >>> [round(end, 4) for end in rate.interval()]
    [0.282, 0.2836]
    >>> [round(end, 4) for end in rate.interval(0.99)]
    [0.2818, 0.2838]
    """

    value: float
    standard_error: float = 0.0
    bias: float | None = 0.0
    how: str = ""
    upper_95: float | None = None
    bias_error: float = 0.0

    # numpy leaves an operator between one of its numbers and an estimate to the estimate
    __array_ufunc__: ClassVar[None] = None

    # its document has them where they say something
    sometimes: ClassVar[tuple[str, ...]] = (LIMIT, BIAS_ERROR)

    def __post_init__(self) -> None:
        for name in ("value", "standard_error", "bias", "upper_95", "bias_error"):
            number = getattr(self, name)
            if number is None and name in ("bias", "upper_95"):
                continue
            try:
                finite = math.isfinite(number)
            except TypeError:
                raise ValueError(f"{name} must be a number, got {number!r}") from None
            if not finite:
                raise ValueError(f"{name} must be finite, got {number}")
            if number < 0.0 and name != "value":
                raise ValueError(f"{name} must be at least 0, got {number}")

    def __mul__(self, factor: float) -> Estimate:
        factor = _plain_number(factor)
        return self._changed(factor * self.value, lambda error: abs(factor) * error, factor)

    __rmul__ = __mul__

    def __truediv__(self, divisor: float) -> Estimate:
        divisor = _plain_number(divisor)
        return self._changed(self.value / divisor, lambda error: error / abs(divisor), divisor)

    def __add__(self, shift: float) -> Estimate:
        shift = _plain_number(shift)
        upper = None if self.upper_95 is None else self.upper_95 + shift
        return replace(self, value=self.value + shift, upper_95=upper)

    __radd__ = __add__

    def __sub__(self, shift: float) -> Estimate:
        return self + -_plain_number(shift)

    def __rsub__(self, number: float) -> Estimate:
        return -self + number

    def __neg__(self) -> Estimate:
        return self * -1.0

    def __pos__(self) -> Estimate:
        return self

    def _changed(self, value: float, scaled: Callable[[float], float], factor: float) -> Estimate:
        """The estimate with another value, all errors scaled by the same factor."""
        if self.upper_95 is not None and factor <= 0.0:
            raise ValueError(
                "an estimate with upper_95 is of an event that was never seen, or hardly, and has "
                f"no lower limit: it can be scaled by positive numbers only, got {factor}"
            )
        return replace(
            self,
            value=value,
            standard_error=scaled(self.standard_error),
            bias=None if self.bias is None else scaled(self.bias),
            upper_95=None if self.upper_95 is None else scaled(self.upper_95),
            bias_error=scaled(self.bias_error),
        )

    def __repr__(self) -> str:
        number = f"{format_with_error(self.value, self.standard_error)}{self.bias_in_words}"
        if self.upper_95 is not None:
            number = f"at most {self.upper_95:.3g}"
        return f"{number} [{self.how}]"

    @property
    def printed_bias(self) -> float | None:
        """What the bias, and its own error, add to the half width of the 95 % interval; None where
        the bias is not known.

        Tables print it behind the value: 1.96 standard errors and this number are the half width.

        Examples
        --------
        >>> found = Estimate(value=1.0, standard_error=0.3, bias=0.1, bias_error=0.4)
        >>> round(found.printed_bias, 3), round(found.half_width_95(), 3)
        (0.492, 1.08)
        """
        if self.bias is None:
            return None
        return self.half_width_95() - GAUSSIAN_95 * self.standard_error

    @property
    def bias_matters(self) -> bool:
        """Whether the bias is not known, or widens the 95 % interval by more than a tenth."""
        added = self.printed_bias
        return added is None or added > NEGLIGIBLE_BIAS * self.standard_error

    @property
    def bias_in_words(self) -> str:
        """The bias, to follow the value; empty where it does not matter."""
        if not self.bias_matters:
            return ""
        added = self.printed_bias
        return ", bias not known" if added is None else f", bias up to {added:.2g}"

    def reach(self, quantile: float) -> float:
        """Distance from the value to the end of its interval, with all errors that are known;
        `quantile` is that of the confidence, in standard errors (see the notes)."""
        errors = (self.standard_error, self.bias_error)
        return reach(quantile, errors, (self.bias or 0.0,))

    def half_width_95(self) -> float:
        """Half the width of the 95 % interval, with all errors that are known."""
        return self.reach(GAUSSIAN_95)

    def interval(self, confidence: float = CONFIDENCE) -> tuple[float, float]:
        """The confidence interval with all errors (see the notes). For an event that was never seen
        it reaches from 0 to the upper limit.

        Parameters
        ----------
        confidence
            The probability with which such intervals hold the truth.

        Raises
        ------
        ValueError
            If the bias is not known; for an event that was never seen, unless confidence is 0.95.
        """
        if not 0.0 < confidence < 1.0:
            raise outside_of_share("confidence", "in (0, 1)", confidence)
        if self.upper_95 is not None:
            if confidence != CONFIDENCE:
                raise ValueError(
                    f"confidence must be {CONFIDENCE:g} for an event that was never seen, or "
                    f"hardly, got {confidence:g}: its upper limit is known for that alone"
                )
            return 0.0, self.upper_95
        if self.bias is None:
            raise ValueError(f"{self} has no interval; compare with a method that states its bias")
        half = self.reach(normal_quantile(1.0 - confidence))
        return self.value - half, self.value + half

    def to_dict(self) -> dict[str, Any]:
        """The JSON form; `upper_95` and `bias_error` appear only where they mean something."""
        document = asdict(self)
        if self.upper_95 is None:
            del document["upper_95"]
        if self.bias_error == 0.0:
            del document["bias_error"]
        return document


Known = TypeVar("Known", bound=Any)
"""What has a value, a standard error and a bias: of a number, or of an array."""


def combined(value: Any, slopes: Any, parts: Sequence[Known], **more: Any) -> Known:
    """A value that changes by `slopes` with independent parts, of numbers or of arrays.

    Their standard errors add in squares. The sizes of their biases add, as their signs are not
    known; one that is not known leaves that of the value unknown.

    Examples
    --------
    >>> parts = [Estimate(value=2.0, standard_error=0.3, bias=0.1), Estimate(value=1.0, bias=0.2)]
    >>> combined(4.0, [1.0, 2.0], parts)
    4.00(30), bias up to 0.5 []
    """
    slopes, biases = np.abs(slopes), [each.bias for each in parts]
    error = np.linalg.norm(slopes * np.array([each.standard_error for each in parts]), axis=0)
    known = all(bias is not None for bias in biases)
    bias = np.sum(slopes * np.abs(np.array(biases)), axis=0) if known else None
    if np.ndim(value) == 0:
        value, error, bias = float(value), float(error), None if bias is None else float(bias)
    found: Known = type(parts[0])(value=value, standard_error=error, bias=bias, **more)
    return found


def total(parts: Sequence[Estimate], shares: Any = 1.0, how: str = "") -> Estimate:
    """The sum of independent numbers or rates of events, each times its share.

    What was not seen in a part is at most its limit: a bias beside events of other parts. Where
    these are fewer than the limits, which add in squares, the sum is an upper limit, too. A bias
    of theirs that is not known leaves that of the sum unknown.

    Examples
    --------
    >>> unseen = Estimate(value=0.0, bias=None, upper_95=0.3)
    >>> total([Estimate(value=2.0, standard_error=0.3, bias=0.1), unseen])
    2.00(30), bias up to 0.4 []
    >>> round(total([unseen, unseen]).upper_95, 3)
    0.424
    >>> round(total([Estimate(value=0.1, standard_error=0.01), unseen]).upper_95, 3)
    0.42
    """
    factors = np.broadcast_to(shares, len(parts))
    value = float(factors @ [each.value for each in parts])
    limits = factors * [each.upper_95 or 0.0 for each in parts]
    known = [each if each.upper_95 is None else replace(each, bias=0.0) for each in parts]
    seen, unseen = combined(value, factors, known, how=how), math.hypot(*limits)
    if seen.bias is None or not unseen:
        return seen
    if value > unseen:
        return replace(seen, bias=seen.bias + float(limits.sum()))
    return Estimate(value=0.0, bias=None, how=how, upper_95=seen.interval()[1] + unseen)


def correlated_total(parts: Sequence[Estimate]) -> Estimate:
    """The sum of numbers or rates of one simulation, with an error that holds for any correlation.

    What was not seen in a part is at most its limit: a bias beside what was seen in others, else a
    limit of the sum. A bias that is not known leaves that of the sum unknown.

    Examples
    --------
    >>> unseen = Estimate(value=0.0, bias=None, upper_95=0.3)
    >>> seen = Estimate(value=2.0, standard_error=0.3, bias=0.1)
    >>> correlated_total([seen, seen]), correlated_total([seen, unseen])
    (4.00(60), bias up to 0.2 [], 2.00(30), bias up to 0.4 [])
    >>> correlated_total([unseen, unseen]).upper_95
    0.6
    """
    known = [each for each in parts if each.upper_95 is None]
    limits = math.fsum(each.upper_95 or 0.0 for each in parts)
    if parts and not known:
        return replace(parts[0], upper_95=limits)
    biases = [each.bias for each in known if each.bias is not None]
    return Estimate(
        value=math.fsum(each.value for each in known),
        standard_error=math.fsum(each.standard_error for each in known),
        bias=math.fsum(biases) + limits if len(biases) == len(known) else None,
        how=known[0].how if known else "",
        bias_error=math.fsum(each.bias_error for each in known),
    )


TOO_FEW = "in too few independent samples for an interval"
"""Where events were seen of which an upper limit alone is stated."""


LIMIT_ALONE = (
    "has an upper limit only, rel_error does not govern it; more paths or a longer duration look "
    "further"
)
"""What notes say of the rate of impacts of which hardly any, or none, were seen."""


def without_impact(stops: Iterable[tuple[str, str]], exposure: float) -> list[str]:
    """One note on all stops, side and pair of each, that saw no impact in so many seconds.

    >>> without_impact([("upper", "a"), ("upper", "b"), ("lower", "a")], 3.0)[0][:65]
    'no impact on the upper stops of a, b and the lower stop of a in 3'
    """
    named: dict[str, list[str]] = {}
    for side, pair in stops:
        named.setdefault(side, []).append(pair)
    listed = [
        f"the {side} {'stops' if len(pairs) > 1 else 'stop'} of {', '.join(pairs)}"
        for side, pairs in named.items()
    ]
    return listed and [
        f"no impact on {' and '.join(listed)} in {exposure:.3g} s of motion: a rate there "
        f"{LIMIT_ALONE}"
    ]


def of_events(found: Estimate, samples: int) -> Estimate:
    """Estimate of a mean number or rate of events over so many independent samples.

    Where samples and clusters of events suffice, it is the estimate, whose standard error is
    Student's where samples are few. Else it is an upper limit, and the value is 0. This one rule is
    that of everything that samples, whether a budget ended it or not.

    Examples
    --------
    >>> of_events(Estimate(value=24.0, standard_error=24.0, how="2 paths"), 2).value
    0.0
    >>> of_events(Estimate(value=24.0, standard_error=2.0, how="256 paths"), 256)
    24.0(2.0) [256 paths]
    """
    if found.value <= 0.0:
        return found
    if events_suffice(found.value, found.standard_error, samples):
        return replace(found, standard_error=found.standard_error * student_factor(samples))
    return Estimate(
        value=0.0,
        bias=None,
        how=f"seen {TOO_FEW}: {found.how}",
        upper_95=most_events(found.value, found.standard_error, samples) + (found.bias or 0.0),
    )


def _plain_number(number: object) -> float:
    """A number that an estimate may be combined with."""
    if isinstance(number, Estimate):
        raise TypeError(
            "the errors of two estimates may be correlated, so they cannot be combined by an "
            "operator: combine their values (float(estimate)) and work out the error yourself"
        )
    if isinstance(number, bool) or not isinstance(number, Real):
        raise TypeError(
            f"a value with errors takes plain numbers only, got {type(number).__name__}"
        )
    return float(number)


def format_with_error(value: float, error: float) -> str:
    """The physicist's notation: two digits of the standard error in brackets.

    >>> format_with_error(0.28281234, 0.00041)
    '0.28281(41)'
    >>> format_with_error(0.5395600937, 0.0)
    '0.539560094'
    >>> format_with_error(1234.5, 210.0)
    '1230(210)'
    >>> format_with_error(3.21e-07, 4.5e-09)
    '3.210(45)e-07'
    """
    if error <= 0.0 or not math.isfinite(error):
        return f"{value:.9g}"
    size = max(abs(value), error)
    exponent = math.floor(math.log10(size))
    if -4 <= exponent < 6:
        exponent = 0
    scaled, scaled_error = value / 10.0**exponent, error / 10.0**exponent
    digits = 1 - math.floor(math.log10(scaled_error))
    if digits >= 2 or scaled_error < 1.0:
        bracket = f"{round(scaled_error * 10.0**digits)}"
    else:
        bracket = f"{round(scaled_error, digits):.{max(digits, 0)}f}"
    text = f"{round(scaled, digits):.{max(digits, 0)}f}({bracket})"
    return text if exponent == 0 else f"{text}e{exponent:+03d}"


NO_VALUE = "-"
"""Cell of a table where no number is known."""


MOST_PLACES = 5
"""Largest number of digits after the point; a number that needs more is written with a power of
ten."""


HARDLY = 1e-4
"""Half of an interval over the value below which four digits are right without it."""


def plus_minus(estimate: Estimate | None, quantity: ShownQuantity = NUMBER, digits: int = 4) -> str:
    """A value with half of its 95 % interval; an upper limit where nothing was seen. Without an
    interval it has four digits, or up to so many `digits` where its bias lets these be known.

    >>> plus_minus(Estimate(value=0.23744159, bias=2e-7), digits=7)
    '0.237442'
    >>> plus_minus(Estimate(value=0.2498, standard_error=0.0096)), plus_minus(None)
    ('0.250 ± 0.019', '-')
    >>> plus_minus(Estimate(value=0.1832, bias=2.9e-5))
    '0.1832'
    >>> plus_minus(Estimate(value=927.3, standard_error=55.9))
    '927 ± 110'
    """
    if estimate is None:
        return NO_VALUE
    if estimate.upper_95 is not None:
        return f"at most {quantity(estimate.upper_95):.2g}"
    value, half = quantity(estimate.value), quantity(estimate.half_width_95())
    if half < HARDLY * abs(value) or half == 0.0:
        known = digits if half == 0.0 else int(math.log10(abs(value) / half))
        known = 0 if estimate.bias is None else known
        return f"{value:.{max(min(digits, known), 4)}g}"
    places = 1 - math.floor(math.log10(half))
    if value:
        places = min(places, 3 - math.floor(math.log10(abs(value))))
    if places > MOST_PLACES or half >= 1e6:
        return f"{value:.4g} ± {half:.2g}"
    places, half = max(places, 0), float(f"{half:.2g}")
    if 2.0 * half < 10.0**-places:
        return f"{value:.4g}"
    return f"{value:.{places}f} ± {half:.{places}f}"


@dataclass(frozen=True, kw_only=True)
class Cost:
    """Time that an answer took, s, and the work that was done in it.

    `wall_time` is without the `compile_time` of kernels. `tenfold_wall_time` is the time, s, that
    standard errors ten times smaller would take with the same step; None where nothing was sampled.

    See Also
    --------
    stochvi.cost : Error against time, measured.
    """

    wall_time: float = 0.0
    compile_time: float = 0.0
    steps: int = 0
    impacts: int = 0
    paths: int = 0
    threads: int = 1
    tenfold_wall_time: float | None = None


@cache
def version_of(package: str) -> str:
    """Version of an installed package, read from its metadata once."""
    return importlib.metadata.version(package)


def provenance(scene: Mapping[str, Any], seed: int | None = None) -> dict[str, Any]:
    """Data to compute an answer again: versions, processor, seed and the scene."""
    return {
        "version": version_of("stochvi"),
        "libraries": {name: version_of(name) for name in ("numpy", "scipy", "numba")},
        "processor": platform.machine(),
        "seed": seed,
        "scene": scene,
    }


def spoken_percent(probability: float) -> str:
    """A probability in per cent, never rounded to 0 or 100.

    >>> spoken_percent(0.01), spoken_percent(2.5e-6), spoken_percent(0.99999999)
    ('1 %', '0.00025 %', 'over 99.9 %')
    """
    if probability > NEAR_ONE:
        return over_percent(probability)
    return f"{100.0 * probability:.3g} %" if probability > 1e-6 else f"{100.0 * probability:.1e} %"


NEAR_ONE = 0.999
"""Probability above which the number that it exceeds is shown: its own digits would all be 9."""


def count_of(number: float) -> str:
    """A number of things, to three digits.

    >>> count_of(0.25), count_of(12.34), count_of(976.4), count_of(88623.0), count_of(2.5e7)
    ('0.25', '12.3', '976', '88 600', '2.5e+07')
    """
    if not 100.0 <= number < 1e6:
        return f"{number:.3g}"
    return f"{float(f'{number:.3g}'):,.0f}".replace(",", " ")


def capital(text: str) -> str:
    """A text with a capital letter in front.

    >>> capital("clearances that were tried")
    'Clearances that were tried'
    """
    return f"{text[:1].upper()}{text[1:]}"


def over_percent(probability: float) -> str:
    """A probability near 1 by the tenths of a per cent that it exceeds, 99.9 at most.

    >>> over_percent(0.99999999), over_percent(0.99819)
    ('over 99.9 %', 'over 99.8 %')
    """
    return f"over {min(math.floor(1000.0 * probability), 999) / 10.0:g} %"


def chance_of(found: Estimate) -> str:
    """A probability, or its upper limit where there is one; unknown where that is nearly 1."""
    limit = found.upper_95
    if limit is None:
        return spoken_percent(found.value)
    return "not known" if limit > NEAR_ONE else f"below {spoken_percent(limit)}"
