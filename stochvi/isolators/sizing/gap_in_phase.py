"""One gap in the phases of a mission: its hazard against the clearance, alone and of all phases."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Protocol

import numpy as np
from scipy.optimize import brentq

from stochvi.isolators.sizing.answer import Clearance, Target
from stochvi.isolators.sizing.one_curve import curve_of_gap
from stochvi.isolators.sizing.risk_curve import KNOWN, RiskCurve
from stochvi.mathematics.arrays import Matrix, Vector
from stochvi.mathematics.random_level import RandomLevel
from stochvi.model.model import Model
from stochvi.results.errors import NotApplicable
from stochvi.sampling.run import Run
from stochvi.scenes.phases import bias_of_steps
from stochvi.statistics.free_windows import windows_over
from stochvi.statistics.hazard_curves import HazardCurve, hazard_curve
from stochvi.statistics.pair_crossings import PairMotion
from stochvi.statistics.reliability.phases import lag_of
from stochvi.statistics.reliability.random_levels import felt_by

if TYPE_CHECKING:
    import pandas as pd


POINTS, AROUND = 41, 0.35
"""Number of clearances of the curve of an answer, and how far it reaches from the clearance that
was found, as a share of it."""

FARTHEST = 100.0
"""Largest clearance of a curve under noise with fast peaks, in rms displacements of the gap."""

LEAST = 1e-300
"""Smallest hazard, of which a logarithm is taken."""


@dataclass(frozen=True, kw_only=True, eq=False)
class GapInPhase:
    """The gap of one pair in a phase, as if it alone had stops. Distances in m.

    Parameters
    ----------
    model
        The model of the phase.
    together
        The motion of all gaps in the phase.
    number
        The number of the gap among them.
    shift
        How much farther up the gap hangs than in the mount as stated.
    sides
        The sides that have a stop.
    peaked
        The model of all gaps under noise with fast peaks; None under Gaussian noise, shocks and
        sines.
    curve
        Its risk against clearance; None where crossings count by Rice's formula.
    """

    model: Model
    together: PairMotion
    number: int
    duration: float
    shift: float
    sides: tuple[float, ...]
    sweep_rate: float = 0.0
    peaked: Model | None = None
    curve: RiskCurve | HazardCurve | None = None

    @property
    def sigma(self) -> float:
        """rms displacement, sines included."""
        return self.together.motions[self.number].deviations[0]

    def expected(self, clearance: float) -> float:
        """Rice's number of crossings; where the level varies, the hazard that follows from it."""
        motion = self.together.motions[self.number]
        if not motion.place:
            return 0.0

        def crossings(gain: float) -> float:
            return sum(
                motion.towards(side).rate(max(clearance - side * self.shift, 0.0) / gain)
                for side in self.sides
            )

        level = self.model.level
        if level is None:
            return self.duration * crossings(1.0)
        return self._varying(np.array([crossings(gain) for gain in level.gains]), level)

    def _varying(self, rates: Vector, level: RandomLevel) -> float:
        """-ln(1 - P) of a hazard with these rates at the gains of a level."""
        chance = level.probability(rates, self.duration)
        return -math.log1p(-min(chance, KNOWN))

    def lag(self, clearance: float) -> float:
        """By how much, as a share, the hazard of what moves may be too large at a clearance."""
        return lag_of_hazard(self.expected, clearance, self.model, self.sweep_rate)

    def simulated(self, target: Target, run: Run) -> GapInPhase:
        """The gap with its curve of risk, where the level varies that of the level 0 dB in the
        time of the level."""
        if self.peaked is not None:
            return replace(self, curve=self._curve_under_peaks(self.peaked, target.value, run))
        level = self.model.level
        time = self.duration if level is None else min(self.duration, level.time)
        curve = curve_of_gap(
            self.together, target, time, run, number=self.number, shift=self.shift,
            sides=self.sides,
        )  # fmt: skip
        return replace(self, curve=curve)

    def _curve_under_peaks(self, peaked: Model, probability: float, run: Run) -> HazardCurve:
        """The curve of the hazard against the clearance under noise with fast peaks."""
        places = np.array([0.0, FARTHEST * self.sigma])
        rows = np.full((2, 2, len(self.together.motions)), math.inf)
        rows[:, :, self.number] = self.distances(places)
        kind = windows_over(peaked, places, rows, self.duration, run.seed)
        return hazard_curve(kind, -math.log1p(-probability), self.duration, run)

    def distances(self, clearances: Vector) -> Matrix:
        """(places, 2) distances of the lower and the upper stop from the mean gap; infinite for
        none."""
        found = np.full((len(clearances), 2), math.inf)
        for side in self.sides:
            found[:, int(side > 0.0)] = clearances - side * self.shift
        return found

    def hazard(self, clearance: float) -> tuple[float, float]:
        """-ln(1 - P) at a clearance, and half its 95 % interval."""
        if self.curve is None:
            return self.expected(clearance), 0.0
        if isinstance(self.curve, HazardCurve):
            return self.curve.hazard(clearance)
        nearest = min(clearance - side * self.shift for side in self.sides)
        level = self.model.level
        if level is None:
            return self.curve.hazard(nearest)
        value, upper = self._of_level(self.curve, nearest, level)
        felt, _ = self._of_level(self.curve, nearest, felt_by(self.model))
        return value, upper - value + abs(felt - value)

    def _of_level(
        self, curve: RiskCurve, nearest: float, level: RandomLevel
    ) -> tuple[float, float]:
        """The hazard at a clearance while the level varies, and the upper end of its interval."""
        places = nearest / level.gains
        motion = self.together.motions[self.number]
        known = [curve.hazard(c) if motion.rate(c) else (0.0, 0.0) for c in places]
        values, halves = np.array(known).T / curve.mission
        return self._varying(values, level), self._varying(values + halves, level)

    @property
    def reached(self) -> float:
        """Largest relative standard error of the probabilities of the curve; 0 without one."""
        return 0.0 if self.curve is None else self.curve.reached


def lag_of_hazard(
    expected: Callable[[float], float], clearance: float, model: Model, sweep_rate: float
) -> float:
    """By how much, as a share, the hazard of what moves may be too large at a clearance."""
    known = expected(clearance) if sweep_rate else 0.0
    if not known:
        return 0.0
    return expected(clearance / (1.0 + lag_of(model, sweep_rate))) / known - 1.0


class KnownRisk(Protocol):
    """What is known of the risk of a phase against a clearance."""

    def hazard(self, clearance: float) -> tuple[float, float]:
        """-ln(1 - P) at a clearance, and half its 95 % interval."""

    def lag(self, clearance: float) -> float:
        """By how much, as a share, the hazard of what moves may be too large."""

    @property
    def reached(self) -> float:
        """Largest relative standard error of its probabilities."""


@dataclass(frozen=True)
class Joint:
    """The risk of several phases together."""

    phases: Mapping[str, KnownRisk]
    steps: Sequence[Sequence[str]] = ()

    def hazard(self, clearance: float) -> tuple[float, float]:
        """The sum of the hazards, and half its 95 % interval, with the bias of the steps of moving
        bands."""
        values, halves = zip(
            *(each.hazard(clearance) for each in self.phases.values()), strict=True
        )
        lags = {name: each.lag(clearance) for name, each in self.phases.items()}
        stepped = bias_of_steps(self.steps, dict(zip(self.phases, values, strict=True)), lags)
        return sum(values), math.hypot(*halves) + stepped

    def clearance(self, hazard: float, guess: float) -> Clearance:
        """The clearance at which the hazard is this one."""

        def excess(place: float) -> float:
            return math.log(max(self.hazard(place)[0], LEAST) / hazard)

        low, high = guess, guess
        step = 0.1 * guess
        while excess(low) < 0.0:
            low -= step
            if low <= 0.0:
                raise NotApplicable(
                    "size", ["probability must be smaller: any clearance keeps it"],
                )  # fmt: skip
        while excess(high) > 0.0:
            high += step
        value = float(brentq(excess, low, high, xtol=1e-12 * guess, rtol=1e-12))
        width = 1e-3 * guess
        slope = (excess(value + width) - excess(value - width)) / (2.0 * width)
        total, half = self.hazard(value)
        reach = half / total / abs(slope)
        return Clearance(value=value, lower=value - reach, upper=value + reach)

    def curve(self, place: float) -> pd.DataFrame:
        """The table of `MissionSizing.curve`."""
        import pandas as pd

        places = place * np.linspace(1.0 - AROUND, 1.0 + AROUND, POINTS)
        found = np.array([self.hazard(each) for each in places])
        low, high = found[:, 0] - found[:, 1], found[:, 0] + found[:, 1]
        return pd.DataFrame(
            {"clearance": places, "probability": -np.expm1(-found[:, 0]),
             "probability_low": -np.expm1(-np.maximum(low, 0.0)),
             "probability_high": -np.expm1(-high)}
        )  # fmt: skip

    def short(self, accuracy: float) -> list[str]:
        """Sentences on the phases whose risk is not known as accurately as asked for."""
        found = []
        for name, phase in self.phases.items():
            if (reached := phase.reached) > 1.3 * accuracy:
                found.append(
                    f"the budget ended at a relative error of {reached:.3g} of the probability of "
                    f"an impact in phase {name}"
                )
        return found
