"""Motions by simulation from impact to impact, and the regimes that they settle to."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from stochvi.mathematics.arrays import Matrix, Vector
from stochvi.methods.periodic.kernels import solver

SETTLING = 300
"""Number of periods that a simulation runs before its motion counts as settled."""

LONGEST = 8
"""Largest number of periods in which a simulated motion is looked at for repeating itself."""

REPEATS = 1e-3
"""Difference of states a period apart, relative to the motion, from which Newton's iteration
finds the regime that a simulation approaches."""

MOST_KEPT = 4096
"""Number of last impacts that a simulation keeps: more than it follows in a period."""

MOST_SIMULATED = 24
"""Largest number of impacts of a regime that Newton's iteration takes from a simulation."""


@dataclass(frozen=True, eq=False)
class FinalMotion:
    """The end of a simulated motion: `ends`, the states after its periods, and the phase of the
    force at which it started. `log` holds its last impacts and releases: phase, stop or -1 less the
    stop, speed. Then come the largest displacement and acceleration of the last period, and the
    stop that is rested on, or FREE.
    """

    ends: Matrix
    phase: float
    log: Matrix
    displacement: float
    acceleration: float = 0.0
    resting: int = solver.FREE

    @property
    def state(self) -> Vector:
        """The last state."""
        return np.asarray(self.ends[-1])

    def period(self, tolerance: float) -> int:
        """Number of periods after which the motion repeats itself; 0 where it does not."""
        last = self.ends[-1]
        # all states of a motion that rests on a stop at this phase may be 0
        size = max(np.abs(self.ends[-LONGEST - 1 :]).max(), self.displacement) or 1.0
        for periods in range(1, min(LONGEST, len(self.ends) - 1) + 1):
            if np.all(np.abs(self.ends[-1 - periods] - last) < tolerance * size):
                return periods
        return 0

    def _last(self, periods: int) -> Matrix:
        end = self.phase + 2.0 * math.pi * (len(self.ends) - 1)
        return self.log[self.log[:, 0] > end - 2.0 * math.pi * periods]

    def impacts(self, periods: int) -> Matrix:
        """The impacts of the last periods."""
        last = self._last(periods)
        return last[last[:, 1] >= 0.0]

    def rests(self, periods: int) -> tuple[int, ...]:
        """The stops that are rested on in the last periods."""
        last = self._last(periods)[:, 1]
        found = {int(-1 - stop) for stop in last[last < 0.0]}
        return tuple(sorted(found | ({self.resting} - {solver.FREE})))


def simulate(
    motion: solver.Motion, start: Vector, periods: int, phase: float = 0.0
) -> FinalMotion | None:
    """A motion from a state at a phase of the force, from impact to impact; None where impacts come
    too fast to be followed."""
    ends, log = np.empty((periods + 1, len(start))), np.zeros((MOST_KEPT, 3))
    hits, displacement, acceleration, resting = solver.march(
        motion, start, periods, phase, ends, log
    )
    if hits < 0:
        return None
    kept = log[: min(hits, MOST_KEPT)]
    kept = kept[np.argsort(kept[:, 0], kind="stable")]
    return FinalMotion(ends, phase, kept, displacement, acceleration, resting)
