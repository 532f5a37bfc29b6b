"""Mean life of paths that are looked at now and then, of which some outlive the last look.

Paths that start in one motion leave it rarely at first, as noise has not spread them yet. Once they
have forgotten their start they leave at a constant rate. Seconds per departure are wrong where
paths are watched for a part of their lives: too many of these seconds are early ones. So the share
of paths that are still there is counted up to the look at which the start is forgotten (E. Kaplan
and P. Meier 1958), and falls exponentially only beyond it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from stochvi.mathematics.arrays import Booleans, Vector, Whole
from stochvi.results.intervals import GAUSSIAN_95, poisson_interval


class MeanLife(NamedTuple):
    """A mean life with its 95 % interval and standard error, all in looks.

    Where no path left at the constant rate, the value is NaN, and `upper` and `error` are infinite.
    """

    value: float
    lower: float
    upper: float
    error: float


class Beginning(NamedTuple):
    """The looks before the start is forgotten: after each look the share of paths still there, and
    the squared relative error that the look adds to the shares of all later looks."""

    alive: Vector
    squared_error: Vector

    def mean_life(self, beyond: float) -> tuple[float, float]:
        """The mean life, and its standard error (M. Greenwood 1926), where the paths still there at
        the end live on for so many looks."""
        before = np.concatenate([[1.0], self.alive])
        # departures are noted half an interval late
        spent = np.append(0.5 * (before[1:] + before[:-1]), before[-1] * beyond)
        rest = spent[::-1].cumsum()[::-1]
        later = rest[1:] + 0.5 * self.alive
        return float(rest[0]), math.sqrt(float(self.squared_error @ later**2))


class Survival(NamedTuple):
    """Numbers of paths by look: how many might have left at it, and how many did."""

    at_risk: Whole
    departures: Whole

    @classmethod
    def of(cls, ends: Whole, left: Booleans) -> Survival:
        """The numbers of paths that were watched up to the looks `ends`, at which some `left`."""
        looks = int(ends.max(initial=0))
        ended, gone = (np.bincount(each, minlength=looks + 1) for each in (ends, ends[left]))
        return cls(ended[::-1].cumsum()[::-1][1:], gone[1:])

    @property
    def watched(self) -> float:
        """Number of looks that paths lived through, all together."""
        return float(self.at_risk.sum() - 0.5 * self.departures.sum())

    def mean_life(self, forgotten: int) -> MeanLife:
        """The mean life of paths that leave at a constant rate after the look `forgotten`.

        The interval joins the errors of the looks before it with the exact interval of the rate.
        """
        beginning = self._beginning(forgotten)
        last = float(beginning.alive[-1]) if len(beginning.alive) else 1.0
        later = Survival(self.at_risk[forgotten:], self.departures[forgotten:])
        left, watched = int(later.departures.sum()), later.watched
        slow, fast = poisson_interval(left, watched) if watched else (0.0, math.inf)
        if last > 0.0 and left == 0:
            value, error = beginning.mean_life(1.0 / fast)
            return MeanLife(math.nan, max(value - GAUSSIAN_95 * error, 0.0), math.inf, math.inf)
        short, beyond, long = (1.0 / fast, watched / left, 1.0 / slow) if left else (0.0, 0.0, 0.0)
        value, error = beginning.mean_life(beyond)
        lower = value - math.hypot(GAUSSIAN_95 * error, last * (beyond - short))
        upper = value + math.hypot(GAUSSIAN_95 * error, last * (long - beyond))
        error = math.hypot(error, last * beyond / math.sqrt(max(left, 1)))
        return MeanLife(value, max(lower, 0.0), upper, error)

    def _beginning(self, forgotten: int) -> Beginning:
        at_risk, departures = (each[:forgotten].astype(float) for each in self)
        stayed = at_risk - departures
        # none is left to count where all have gone
        squared = departures / (at_risk * np.maximum(stayed, 1.0))
        return Beginning(np.cumprod(stayed / at_risk), np.where(stayed > 0.0, squared, 0.0))
