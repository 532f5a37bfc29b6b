"""Rows of the tables of sums that the kernels fill, for one oscillator and for pairs of stops.

Kernels use the numbers of the rows; `Sums` and `Extremes` read the tables by name. All quantities
are per unit mass.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stochvi.engine.sums import (
    EXTREMES,
    FASTEST,
    FORCE_SQUARE,
    LOSS,
    POSITION_FORCE,
    ROWS_OF_STOP,
    SHARPEST,
)

Vector = NDArray[np.float64]

X, XX, VV, N_LOWER, F1_LOWER, F2_LOWER, N_UPPER, F1_UPPER, F2_UPPER = range(9)
SUMS = 9
"""Rows of one oscillator with rigid stops: x, x^2, v^2, and for each stop its impacts (N), their
speeds (F1, m/s) and the squares of their speeds (F2, m^2/s^2)."""

CONTACT_LOWER = SUMS
CONTACT_UPPER = SUMS + ROWS_OF_STOP
CONTACT_SUMS = SUMS + 2 * ROWS_OF_STOP
"""Rows of one oscillator with compliant stops: those of rigid stops, then those of the contacts
with the lower stop, and with the upper stop."""

NO_EXTREMES = np.empty((0, EXTREMES))
"""The extremes of a kernel whose extremes nobody asks for."""


class Sums(NamedTuple):
    """A table (rows, paths) of sums or averages of one oscillator, read by name."""

    table: NDArray[np.float64]

    @classmethod
    def zeros(cls, paths: int, contacts: bool) -> Sums:
        """Sums of that number of paths before the first step."""
        return cls(np.zeros((CONTACT_SUMS if contacts else SUMS, paths)))

    @property
    def displacement_square(self) -> Vector:
        """x^2, m^2."""
        return self.table[XX]

    @property
    def velocity_square(self) -> Vector:
        """v^2, m^2/s^2."""
        return self.table[VV]

    @property
    def impacts(self) -> Vector:
        """Number of impacts on both stops that are at least as fast as the threshold."""
        return self.table[N_LOWER] + self.table[N_UPPER]

    @property
    def impact_speeds(self) -> Vector:
        """Sum of the speeds of all impacts on both stops, m/s."""
        return self.table[F1_LOWER] + self.table[F1_UPPER]

    @property
    def contact_loss(self) -> Vector:
        """Energy dissipated by contacts with both stops, J/kg."""
        return self.table[CONTACT_LOWER + LOSS] + self.table[CONTACT_UPPER + LOSS]


class Extremes(NamedTuple):
    """A table (paths, EXTREMES) of the extremes of paths, read by name."""

    table: NDArray[np.float64]

    @classmethod
    def zeros(cls, paths: int) -> Extremes:
        """Extremes of that number of paths before the first step."""
        return cls(np.zeros((paths, EXTREMES)))

    @property
    def impact_speed(self) -> Vector:
        """Largest impact speed, m/s."""
        return self.table[:, FASTEST]

    @property
    def acceleration(self) -> Vector:
        """Largest absolute acceleration, m/s^2."""
        return self.table[:, SHARPEST]

    @property
    def force_square(self) -> Vector:
        """Integral of the square of the force of the stops per unit mass, m^2/s^3."""
        return self.table[:, FORCE_SQUARE]

    @property
    def position_force(self) -> Vector:
        """Integral of displacement times force of the stops per unit mass, m^2/s."""
        return self.table[:, POSITION_FORCE]
