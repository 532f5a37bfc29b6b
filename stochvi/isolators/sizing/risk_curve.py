"""Probability of any impact against clearance, between the levels of one run of first crossings."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator
from scipy.optimize import brentq

from stochvi.isolators.sizing.answer import Clearance
from stochvi.mathematics.arrays import Matrix, Vector
from stochvi.mathematics.moving_means import MovingMean
from stochvi.model.model import model_of
from stochvi.results.deadline import partial_result
from stochvi.results.estimates import Estimate
from stochvi.sampling.run import Run
from stochvi.scenes.scene import Scene
from stochvi.statistics.crossing_ages import CrossingAges, largest_error
from stochvi.statistics.first_crossings import one_gap
from stochvi.statistics.pair_crossings import FirstCrossings, PairMotion

if TYPE_CHECKING:
    import pandas as pd


CERTAIN = 0.999
"""Largest probability of an impact that a target may have."""

KNOWN = 1.0 - 1e-12
"""Largest probability of an impact whose ln(1 - P) still has four digits after rounding."""

RARE_ENOUGH = 10.0
"""Number of first impacts in a mission up to which a clearance is read from the curve of
probabilities; for more, it is read from the rate of first impacts."""

LIKELY = 0.5
"""Probability of an impact above which the rate of first impacts may give its error, if that is
smaller."""


SIGMA_STEP, MOST_LEVELS = 0.25, 64
"""Distance from one clearance of a curve to the next, in standard deviations of the noise, and the
largest number of clearances; the distance grows where sines are much larger than the noise."""


def clearances_of_curve(motion: MovingMean, lowest: float, highest: float) -> Vector:
    """The clearances of a curve of risk, m, from the lowest one to beyond the highest one."""
    step = max(SIGMA_STEP * motion.place, (highest - lowest) / MOST_LEVELS)
    return np.arange(lowest / step, highest / step + 2.0) * step


def chance_of_stops(scene: Scene, stops: Matrix, mission: float, run: Run) -> Estimate:
    """Probability of any impact with stops at distances (2, pairs) from the mean gaps, m, infinite
    for none; 1 where one of them presses. A mass without a pair has one gap."""
    if stops.min() <= 0.0:
        return Estimate(value=1.0, how="a stop presses on the mass")
    model = model_of(scene)
    motion = PairMotion.under_shocks(model if model.pairs else one_gap(model))
    found: FirstCrossings = partial_result(motion.crossings, *stops, mission, run)
    return found.probability(mission)[0]


@dataclass(frozen=True, kw_only=True)
class RiskCurve:
    """Probability of any impact in a mission against clearance, between the levels of one run.

    -ln(1 - P), over what Rice's rate gives for it, changes slowly with the clearance: it is
    interpolated (monotone cubic, logarithmic) and P follows. Clearances in m per side.
    """

    crossings: CrossingAges
    motion: MovingMean
    mission: float
    clearances: Vector
    probabilities: Sequence[Estimate]
    first_rates: Sequence[Estimate]

    @classmethod
    def of(
        cls, crossings: CrossingAges, motion: MovingMean, clearances: Vector, mission: float
    ) -> RiskCurve:
        """The curve of a gap from first crossings of its stops at equal, increasing distances."""
        return cls(
            crossings=crossings,
            motion=motion,
            mission=mission,
            clearances=clearances,
            probabilities=_falling(crossings.probability(mission)),
            first_rates=_falling(crossings.first_rate()),
        )

    @classmethod
    def of_gap(
        cls, together: PairMotion, number: int, stops: Mapping[float, Vector], mission: float,
        run: Run,
    ) -> RiskCurve:  # fmt: skip
        """The curve of one of some gaps that alone has stops, at distances by their sides."""
        rows = np.full((2, len(next(iter(stops.values()))), len(together.motions)), math.inf)
        for side, distances in stops.items():
            rows[int(side > 0.0), :, number] = distances
        found: FirstCrossings = partial_result(together.crossings, *rows, mission, run)
        nearest = rows[:, :, number].min(axis=0)
        return cls.of(found, together.motions[number], nearest, mission)

    @property
    def sigma(self) -> float:
        """Standard deviation of the gap, m."""
        return self.motion.deviations[0]

    @property
    def largest_hazard(self) -> float:
        """-ln(1 - P) at the smallest clearance whose probability of an impact is below 1."""
        return math.exp(self._logarithms()[1][0])

    @property
    def most_first_hits(self) -> float:
        """First impacts of a mission at the smallest clearance, by their limiting rate."""
        return 0.99 * self.first_rate(float(self.clearances[0])) * self.mission

    def clearance(self, probability: float) -> Clearance:
        """The clearance at which the probability of any impact is `probability`, with its 95 %
        interval."""
        wanted = math.log(-math.log1p(-probability))
        usable, logs, errors = self._logarithms()
        curve = self._interpolated(usable, logs)
        low, high = self.clearances[usable][[0, -1]]
        if wanted > curve(low):
            raise ValueError(
                f"probability must be at most {self.probability(low):.3g} for a mission of "
                f"{self.mission:g} s, as at {1e3 * low:.4g} mm, the smallest clearance that is "
                f"tried ({low / self.sigma:.3g} sigma), got {probability:g}; "
                "ask for a smaller probability or a longer mission"
            )
        if wanted < curve(high):
            raise ValueError(
                f"probability must be at least {self.probability(high):.3g} for a mission of "
                f"{self.mission:g} s, as at {1e3 * high:.4g} mm, the largest clearance that is "
                f"tried, got {probability:g}; ask for a larger probability"
            )
        value = float(brentq(lambda c: curve(c) - wanted, low, high, xtol=1e-12 * low, rtol=1e-12))
        step = 1e-3 * self.sigma
        inside = min(max(value, low + step), high - step)
        slope = (curve(inside + step) - curve(inside - step)) / (2.0 * step)
        half = float(np.interp(value, self.clearances[usable], errors)) / abs(slope)
        return Clearance(value=value, lower=value - half, upper=value + half)

    def place(self, hazard: float) -> float:
        """The clearance (m) at which -ln(1 - P) is `hazard`, however close to 1 the probability P
        is."""
        if hazard <= RARE_ENOUGH:
            return self.clearance(-math.expm1(-hazard)).value
        # in a mission with many first impacts the probability of none follows from their limiting
        # rate alone
        wanted = hazard / self.mission
        low, high = self.clearances[[0, -1]]
        if wanted > self.first_rate(low):
            raise ValueError(
                f"first impacts {wanted:.3g} times a second belong to a clearance below "
                f"{1e3 * low:.4g} mm, the smallest that is tried"
            )
        return float(brentq(lambda c: self.first_rate(c) - wanted, low, high))

    def probability(self, clearance: float) -> float:
        """Probability of any impact at a clearance; beyond the levels, the ratio to Rice's rate is
        held constant."""
        usable, logs, _ = self._logarithms()
        if clearance < self.clearances[usable][0]:
            return 1.0
        return -math.expm1(-math.exp(self._interpolated(usable, logs)(clearance)))

    def hazard(self, clearance: float) -> tuple[float, float]:
        """-ln(1 - P) at a clearance, and half its 95 % interval; beyond the levels, the ratio to
        Rice's rate is held constant."""
        usable, logs, errors = self._logarithms()
        first = float(self.clearances[usable][0])
        value = math.exp(self._interpolated(usable, logs)(max(clearance, first)))
        if clearance < first:
            value *= self.rice_rate(clearance) / self.rice_rate(first)
        return value, value * float(np.interp(clearance, self.clearances[usable], errors))

    @property
    def reached(self) -> float:
        """Largest relative standard error of the probabilities."""
        return largest_error(self.crossings, self.mission)

    def first_rate(self, clearance: float) -> float:
        """Limiting rate of first impacts, 1/s."""
        rates = np.array([rate.value for rate in self.first_rates])
        share = np.log(np.maximum(rates, 1e-300) / self.crossings.rice_rate)
        return float(
            np.exp(np.interp(clearance, self.clearances, share)) * self.rice_rate(clearance)
        )

    def rice_rate(self, clearance: float) -> float:
        """Rice's rate of crossings of all stops, 1/s."""
        first = self.motion.rate(float(self.clearances[0]))
        ratio = self.motion.rate(clearance) / first
        return float(self.crossings.rice_rate[0]) * ratio

    def place_of_rice(self, rate: float) -> float:
        """The clearance at which Rice's rate of all stops is so many times a second."""
        first = self.motion.rate(float(self.clearances[0]))
        return self.motion.distance_of(rate * first / float(self.crossings.rice_rate[0]))

    def slope(self, clearance: float) -> float:
        """Slope of the logarithm of Rice's rate over the square of the clearance, 1/m^2; it is the
        same at all clearances where there is noise alone."""
        near, far = clearance, clearance * (1.0 + 1e-3)
        change = math.log(self.motion.rate(far) / self.motion.rate(near))
        return change / (far**2 - near**2)

    def _logarithms(self) -> tuple[NDArray[np.bool_], Vector, Vector]:
        """Levels with a probability between 0 and 1, ln(-ln(1 - P)) there, and its 95 % half
        width."""
        chance = np.array([estimate.value for estimate in self.probabilities])
        usable = (chance > 0.0) & (chance < KNOWN)
        if usable.sum() < 2:
            raise ValueError(
                f"the probability of an impact in {self.mission:g} s is 0 or 1 at all clearances "
                "that were tried; change the mission"
            )
        half = _half_widths(self.probabilities)[usable]
        rates = np.array(self.first_rates, dtype=float)
        of_rates = (_half_widths(self.first_rates) / rates)[usable]
        chance = chance[usable]
        hazard = -np.log1p(-chance)
        errors = half / ((1.0 - chance) * hazard)
        # near 1 the paths show hardly any survivor, but the rate of first impacts is known there
        errors = np.where(chance > LIKELY, np.minimum(errors, of_rates), errors)
        return usable, np.log(hazard), errors

    def _interpolated(self, usable: NDArray[np.bool_], logs: Vector) -> Callable[[float], float]:
        expected = np.log([self.rice_rate(c) * self.mission for c in self.clearances[usable]])
        ratio = PchipInterpolator(self.clearances[usable], logs - expected)
        last = float(self.clearances[usable][-1])

        def interpolated(clearance: float) -> float:
            # at some 38 deviations Rice's rate is below the smallest number
            crossings = self.rice_rate(clearance) * self.mission
            if crossings == 0.0:
                return -math.inf
            return float(ratio(min(clearance, last))) + math.log(crossings)

        return interpolated

    def to_frame(self) -> pd.DataFrame:
        """The table that `Sizing.curve` describes."""
        import pandas as pd

        limits = {"first_hit_rate": self.first_rates, "probability": self.probabilities}
        columns: dict[str, Sequence[float] | Vector] = {
            "clearance": self.clearances,
            "clearance_in_sigma": self.clearances / self.sigma,
            "rice_rate": self.crossings.rice_rate,
        }
        for name, estimates in limits.items():
            most = 1.0 if name == "probability" else math.inf
            values, half = np.array(estimates, dtype=float), _half_widths(estimates)
            columns[name] = values
            columns[f"{name}_low"] = np.maximum(values - half, 0.0)
            columns[f"{name}_high"] = np.minimum(values + half, most)
        return pd.DataFrame(columns)


def _half_widths(estimates: Sequence[Estimate]) -> Vector:
    """Half widths of the 95 % intervals, each with the bias of its estimate."""
    return np.array([estimate.half_width_95() for estimate in estimates])


def _falling(estimates: Sequence[Estimate]) -> list[Estimate]:
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
