"""Estimates, numbers with their errors, and the cost and provenance of an answer."""

from __future__ import annotations

import importlib.metadata
import math
import platform
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from functools import cache
from numbers import Real
from typing import Any, ClassVar

from stochvi.results.intervals import (
    CONFIDENCE,
    GAUSSIAN_95,
    events_suffice,
    most_events,
    normal_quantile,
    reach,
    student_factor,
)

ERROR, BIAS, BIAS_ERROR, LIMIT = "standard_error", "bias", "bias_error", "upper_95"
"""Fields of an `Estimate`, behind whose value tables name their columns so."""


NEGLIGIBLE_BIAS = 0.2
"""Bias, in standard errors, that widens the 95 % interval by a tenth; a smaller one is not told."""


@dataclass(frozen=True, kw_only=True)
class Estimate:
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

    `float(estimate)` is its value. An estimate may be multiplied or divided by a plain number, or
    have a plain number added; its errors change accordingly. Two estimates cannot be combined by an
    operator, because the correlation of their errors is not known.

    Examples
    --------
    >>> rate = Estimate(value=0.2828, standard_error=0.0004, bias=0.0, how="256 paths")
    >>> rate
    0.28280(40) [256 paths]
    >>> rate * 3600.0
    1018.1(1.4) [256 paths]
    >>> float(rate)
    0.2828
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

    def __post_init__(self) -> None:
        for name in ("value", "standard_error", "bias", "upper_95", "bias_error"):
            number = getattr(self, name)
            if number is None and name in ("bias", "upper_95"):
                continue
            if not math.isfinite(number):
                raise ValueError(f"{name} must be finite, got {number}")
            if number < 0.0 and name != "value":
                raise ValueError(f"{name} must be at least 0, got {number}")

    def __float__(self) -> float:
        return float(self.value)

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
            raise ValueError(f"confidence must be in (0, 1), got {confidence:g}; 95 % is 0.95")
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


TOO_FEW = "in too few independent samples for an interval"
"""Where events were seen of which an upper limit alone is stated."""


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
            f"an Estimate can be combined with plain numbers only, got {type(number).__name__}"
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
