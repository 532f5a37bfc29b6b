"""Hazards. Chapters: those of the parts of a mission together; against the place of stops."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
import scipy

from stochvi.mathematics.numerics import Vector
from stochvi.results.estimates import Estimate
from stochvi.scenes.phases import bias_of_steps

# ------------------------------------------------------------------------------
# Hazards of parts of a mission together.
#
# The hazard of an event is -ln(1 - P): the probability at the start, and the integrated rate of
# first events. Those of independent parts add up, and so do expected numbers of events. Half widths
# of intervals are added as roots of sums of squares, each side for itself (G. Y. Zou and A. Donner,
# Construction of confidence limits about effect measures: a general approach, Statistics in
# Medicine 27, 2008, 1693).
# ------------------------------------------------------------------------------


CERTAIN = 1.0 - 1e-15
"""A larger probability counts as this one, so that its hazard is finite."""


class Hazard(NamedTuple):
    """The hazard of an event, or an expected number of events, in a part of a mission.

    Parameters
    ----------
    value
        -ln(1 - P), or the number.
    below, above
        How far its interval reaches either way.
    bias
        What the steps of moving bands leave in it.
    bounded
        Whether a bound alone is known, and may hold in all such parts together.
    """

    value: float
    below: float = 0.0
    above: float = 0.0
    bias: float = 0.0
    bounded: bool = False

    @classmethod
    def of(cls, chance: float, lower: float, upper: float, *, bounded: bool = False) -> Hazard:
        """That of a probability with its interval.

        >>> round(Hazard.of(0.5, 0.25, 0.5).value, 3)
        0.693
        """
        value, low, high = -np.log1p(-np.minimum([chance, lower, upper], CERTAIN))
        return cls(float(value), float(value - low), float(high - value), bounded=bounded)

    @classmethod
    def within(cls, value: float, half: float) -> Hazard:
        """A hazard with half of its interval, bias included."""
        return cls(value, half, half)

    @property
    def chances(self) -> tuple[float, float, float]:
        """The probability with the ends of its interval, bias left out.

        >>> [round(each, 3) for each in Hazard.of(0.5, 0.25, 0.75).chances]
        [0.5, 0.25, 0.75]
        """
        ends = self.value, max(self.value - self.below, 0.0), self.value + self.above
        chance, lower, upper = (-math.expm1(-each) for each in ends)
        return chance, lower, upper

    @property
    def half(self) -> float:
        """Half of the interval, upwards, with the bias."""
        return self.above + self.bias


def joined(
    parts: Mapping[str, Hazard], steps: Sequence[Sequence[str]] = (),
    lags: Mapping[str, float] | None = None,
) -> Hazard:  # fmt: skip
    """The hazard of independent parts together. Some of them are the `steps` of a moving band, with
    the `lags` of their hazards.

    >>> joined({"road": Hazard(1.0, 0.3, 0.3), "air": Hazard(2.0, 0.4, 0.4)})[:3]
    (3.0, 0.5, 0.5)
    """
    each, values = parts.values(), {name: one.value for name, one in parts.items()}
    return Hazard(
        sum(values.values()),
        math.hypot(*(one.below for one in each if not one.bounded))
        + sum(one.below for one in each if one.bounded),
        math.hypot(*(one.above for one in each if not one.bounded))
        + sum(one.above for one in each if one.bounded),
        bias_of_steps(steps, values, lags),
    )


# ------------------------------------------------------------------------------
# The hazard against the place of stops, a number that rises as they go farther: a clearance, or
# that of the widest of several gaps.
#
# It falls by many orders of magnitude, but over the expected crossings of the stops it changes
# slowly. The logarithm of that ratio, or of the hazard itself, is interpolated between the places
# at which the hazard is known (monotone cubic).
# ------------------------------------------------------------------------------


KNOWN = 1.0 - 1e-12
"""Largest probability of an impact whose ln(1 - P) still has four digits after rounding."""

LIKELY = 0.5
"""Probability of an impact above which the rate of first impacts may give its error, if that is
smaller."""


class OutOfReach(ValueError):
    """A target that no clearance meets of those that are tried for a scene."""


@dataclass(frozen=True, eq=False)
class HazardCurve:
    """-ln(1 - P) of a mission against the place of stops.

    Parameters
    ----------
    places
        Places at which it is known, increasing.
    logs
        Logarithms of the hazards there, falling.
    halves
        Half widths of their 95 % intervals, bias included, as shares of the hazards.
    mission
        Duration, s.
    reached
        Relative standard error of the hazard.
    expected
        Expected crossings at any place; None where they are not known.
    """

    places: Vector
    logs: Vector
    halves: Vector
    mission: float
    reached: float = 0.0
    expected: Callable[[float], float] | None = None

    @classmethod
    def of(
        cls, places: Vector, chances: Sequence[Estimate], mission: float, reached: float = 0.0, *,
        first_rates: Sequence[Estimate] | None = None,
        expected: Callable[[float], float] | None = None,
    ) -> HazardCurve:  # fmt: skip
        """The curve from the probabilities at these places; those of 0 and 1 are left out, as their
        hazards have no logarithm. Near 1 paths show hardly any survivor: `first_rates` of impacts
        may be known better there."""
        falling = falling_chances(chances)
        value = np.array([each.value for each in falling])
        usable = (value > 0.0) & (value < KNOWN)
        value = value[usable]
        hazard = -np.log1p(-value)
        halves = half_widths(falling)[usable] / ((1.0 - value) * hazard)
        if first_rates is not None:
            rates = np.array(falling := falling_chances(first_rates), dtype=float)[usable]
            known = (value > LIKELY) & (rates > 0.0)
            of_rates = half_widths(falling)[usable][known] / rates[known]
            halves[known] = np.minimum(halves[known], of_rates)
        return cls(places[usable], np.log(hazard), halves, mission, reached, expected)

    @property
    def ends(self) -> tuple[float, float]:
        """The nearest and the farthest place at which the hazard is known."""
        if len(self.places) < 2:
            raise OutOfReach(
                f"the probability of an impact in {self.mission:g} s is 0 or 1 at all clearances "
                "that were tried; change the mission"
            )
        return float(self.places[0]), float(self.places[-1])

    @property
    def most(self) -> float:
        """The largest probability that is known."""
        return -math.expm1(-math.exp(self.logs[0])) if len(self.logs) else 1.0

    @property
    def least(self) -> float:
        """The smallest probability that is known; 1 where none can be told from 1."""
        return -math.expm1(-math.exp(self.logs[-1])) if len(self.logs) else 1.0

    @cached_property
    def _ratio(self) -> scipy.interpolate.PchipInterpolator:
        known = 0.0 if self.expected is None else np.log([*map(self.expected, self.places)])
        return scipy.interpolate.PchipInterpolator(self.places, self.logs - known)

    def log(self, place: float) -> float:
        """The logarithm of the hazard at a place. Beyond those that are known the ratio to the
        expected crossings is held constant; without these the logarithm is a straight line."""
        inside = self._held(place)
        log = float(self._ratio(inside))
        if self.expected is None:
            return log + float(self._ratio(inside, 1)) * (place - inside)
        # at some 38 deviations the expected crossings are below the smallest number
        crossings = self.expected(place)
        return log + math.log(crossings) if crossings else -math.inf

    def hazard(self, place: float) -> Hazard:
        """-ln(1 - P) at a place, and half its 95 % interval. That of a straight line reaches to the
        nearest value that is known."""
        inside, value = self._held(place), math.exp(self.log(place))
        nearest = math.exp(self.log(inside)) if self.expected is None else value
        share = float(np.interp(inside, self.places, self.halves))
        return Hazard.within(value, abs(value - nearest) + share * max(value, nearest))

    def place(self, hazard: float, step: float, flattest: float = 0.0) -> tuple[float, float]:
        """The place at which -ln(1 - P) has a value of those that are known, and the half width of
        its 95 % interval: by the slope over a step to either side, which is no smaller than the
        `flattest`."""
        place = place_of(self.log, math.log(hazard), *self.ends)
        slope = abs(slope_of(self.log, place, step, *self.ends))
        half = float(np.interp(place, self.places, self.halves))
        return place, half / max(slope, flattest)

    def _held(self, place: float) -> float:
        low, high = self.ends
        return min(max(place, low), high)


def half_widths(estimates: Sequence[Estimate]) -> Vector:
    """Half widths of the 95 % intervals, each with the bias of its estimate."""
    return np.array([estimate.half_width_95() for estimate in estimates])


def falling_chances(estimates: Sequence[Estimate]) -> list[Estimate]:
    """Rates, or probabilities, raised so that none is below that of a farther stop: where hardly
    any motion outlasts the memory, the estimate is mostly noise. A raised value has the larger
    error of the two."""
    found: list[Estimate] = []
    for own in reversed(estimates):
        farther = found[-1] if found else own
        if farther.value > own.value:
            own = replace(
                own,
                value=farther.value,
                standard_error=max(own.standard_error, farther.standard_error),
                bias=max(own.bias or 0.0, farther.bias or 0.0),
            )
        found.append(own)
    return found[::-1]


def place_of(curve: Callable[[float], float], wanted: float, low: float, high: float) -> float:
    """The place at which a curve, such as the logarithm of a hazard, takes a value."""
    size = max(abs(low), abs(high))
    return float(
        scipy.optimize.brentq(
            lambda place: curve(place) - wanted, low, high, xtol=1e-12 * size, rtol=1e-12
        )
    )


def slope_of(
    curve: Callable[[float], float], place: float, step: float,
    low: float = -math.inf, high: float = math.inf,
) -> float:  # fmt: skip
    """Its slope there, by a step to either side between the ends of what is known."""
    inside = min(max(place, low + step), high - step)
    return (curve(inside + step) - curve(inside - step)) / (2.0 * step)
