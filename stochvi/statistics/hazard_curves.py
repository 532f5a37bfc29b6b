"""The hazard of reaching a place in a mission, against the place, from one splitting of trials.

The levels of a splitting are places that trials reach ever more seldom. So it tells the probability
at all of them on its way to the last one. -ln(1 - P) changes by a factor of some four from one
level to the next, and its logarithm is interpolated (monotone cubic).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import PchipInterpolator

from stochvi.mathematics.arrays import Matrix, Vector
from stochvi.results.deadline import Deadline
from stochvi.results.intervals import GAUSSIAN_95, jackknife_error, student_factor
from stochvi.sampling.run import Run
from stochvi.sampling.sampler import TrialSampler
from stochvi.statistics.free_windows import FreeWindows
from stochvi.statistics.trial_splitting import (
    FEWEST_REPETITIONS,
    FOR_ANSWER,
    MOST_LEVELS,
    MOST_REPETITIONS,
    PILOT,
    SHARE,
    Levels,
    Repetition,
    at_limits,
    draw_of,
    pilot,
)

FREQUENT = (0.95, 0.75, 0.5)
"""Probabilities of a trial at the places before the first level."""

DEPTH = 50.0
"""Factor by which the smallest hazard of a curve lies below the one that is wanted."""

CERTAIN = 1.0 - 1e-12
"""Largest probability whose hazard still has four digits after rounding."""


@dataclass(frozen=True)
class HazardCurve:
    """-ln(1 - P) of a mission against a place, between places at which it is known.

    Parameters
    ----------
    places
        The places, increasing.
    logs
        Logarithms of the hazards there, falling.
    halves
        Half widths of their 95 % intervals, bias included, as shares of the hazards.
    mission
        Duration, s.
    reached
        Relative standard error of the hazard that is wanted.
    """

    places: Vector
    logs: Vector
    halves: Vector
    mission: float
    reached: float

    @cached_property
    def _curve(self) -> PchipInterpolator:
        return PchipInterpolator(self.places, self.logs)

    def hazard(self, place: float) -> tuple[float, float]:
        """-ln(1 - P) at a place, and half its 95 % interval. Beyond the places that are known its
        logarithm goes on as a straight line, and the interval reaches to the nearest known one."""
        inside = min(max(place, self.places[0]), self.places[-1])
        log, slope = (float(self._curve(inside, order)) for order in (0, 1))
        nearest = math.exp(log)
        value = nearest * math.exp(slope * (place - inside))
        known = nearest * float(np.interp(inside, self.places, self.halves))
        return value, abs(value - nearest) + known * max(1.0, value / nearest)


@dataclass(frozen=True, eq=False)
class CurveSampler(TrialSampler):
    """Repetitions of a splitting with fixed levels, which tell its probabilities at limits."""

    kind: FreeWindows
    levels: Levels
    limits: tuple[tuple[float, ...], ...]

    @property
    def block(self) -> int:
        """One repetition is a block."""
        return 1

    def trial(self, first_path: int, paths: int, deadline: Deadline) -> list[Repetition]:
        """One repetition."""
        return at_limits(self.kind, self.levels, self.limits, first_path, deadline)


def hazard_curve(
    kind: FreeWindows, wanted: float, mission: float, run: Run, depth: float = DEPTH
) -> HazardCurve:
    """The hazard of a mission, s, against the place that pieces of the motion reach, around a
    hazard that is wanted.

    Raises
    ------
    NotConverged
        If the budget ended before the pilot, or before two repetitions of the splitting.
    """
    windows = max(mission / kind.window, 1.0)
    least = -math.expm1(-wanted / (depth * windows))
    count = min(max(math.ceil(math.log(least) / math.log(SHARE)) + 1, 2), MOST_LEVELS)
    levels = pilot(kind, math.inf, run.deadline.sooner(FOR_ANSWER), count)
    if len(levels.levels) < count:
        raise run.deadline.fell_short("before pieces reached the stops", "raise budget")
    first = kind.drawn(draw_of(PILOT, 0, 0)).score
    frequent = np.quantile(first, 1.0 - np.array(FREQUENT), method="lower")
    limits = [(*map(float, frequent), levels.levels[0]), *((each,) for each in levels.levels[1:])]
    places = np.concatenate(limits)

    def found(done: Sequence[Sequence[Repetition]]) -> HazardCurve:
        return _curve_of(kind, places, np.array(done), wanted, mission)

    def error(done: Sequence[Sequence[Repetition]]) -> float:
        return 0.0 if len(done) >= MOST_REPETITIONS else found(done).reached

    taken = run.to_accuracy(
        CurveSampler(kind, levels, tuple(limits)), FEWEST_REPETITIONS, error, run.accuracy, needed=2
    )
    return found(taken.sample)


def _curve_of(
    kind: FreeWindows, places: Vector, done: Matrix, wanted: float, mission: float
) -> HazardCurve:
    """The curve from repetitions (repetitions, places, 4)."""
    count = len(done)
    parts = done.transpose(2, 1, 0)

    def risk(exceeded: Vector, late: Vector, scored: Vector) -> Vector:
        return kind.risk(exceeded, late, scored, mission)

    exceeded, coarse, late, scored = parts.mean(axis=2)
    chance, at_twice = risk(exceeded, late, scored), risk(coarse, late, scored)
    left_out = (parts.sum(axis=2, keepdims=True) - parts) / (count - 1)
    errors = jackknife_error(risk(left_out[0], left_out[2], left_out[3]))
    bias = [kind.step_bias(abs(each)) or 0.0 for each in at_twice - chance]
    usable = (chance > 0.0) & (chance < CERTAIN)
    hazard = -np.log1p(-chance[usable])
    # of the hazard, as a share
    scale = 1.0 / (np.exp(-hazard) * hazard)
    errors = student_factor(count) * errors[usable] * scale
    logs = np.minimum.accumulate(np.log(hazard))
    return HazardCurve(
        places=places[usable], logs=logs,
        halves=GAUSSIAN_95 * errors + np.array(bias)[usable] * scale, mission=mission,
        reached=float(errors[np.argmin(np.abs(logs - math.log(wanted)))]),
    )  # fmt: skip
