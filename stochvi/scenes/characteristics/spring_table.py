"""A measured force over the displacement of a spring."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar, Literal, Self

import numpy as np
from numpy.typing import ArrayLike
from pydantic import model_validator

from stochvi.mathematics.arrays import Vector
from stochvi.scenes.characteristics.base import SpringForce
from stochvi.scenes.impact_laws.force_table import check_columns, with_columns
from stochvi.scenes.validation import Numbers


class SpringTable(SpringForce):
    """A measured force over the displacement, linear between its points.

    Beyond the first and the last point the force continues with the slope of the piece there. A
    table that begins at the displacement 0 holds for both directions.

    Parameters
    ----------
    deflection
        Displacements of the spring, rising, m.
    force
        Never falling, N, and rising in the first and the last piece.
    file, unit
        Instead of the two: a file of two columns, and their units, "m,N" or "mm,N". The units may
        also stand in the headings of the columns, in any spelling.
    source
        Where the numbers come from; by default the name of the file from which they were read.
    on, between, axis
        Where it acts: on a coordinate or point, between two, or along an axis of the mounts of a
        box.

    See Also
    --------
    stochvi.scenes.Duffing : A spring with a cubic term.
    stochvi.ForceTable : The force of a stop.

    Examples
    --------
    >>> spring = SpringTable(deflection=[0.0, 0.01, 0.02], force=[0.0, 1.0, 4.0])
    >>> spring.force_at([-0.015, 0.005, 0.03]).round(12).tolist()
    [-2.5, 0.5, 7.0]
    """

    word: ClassVar[str] = "tabulated"

    kind: Literal["table"] = "table"
    deflection: Numbers
    force: Numbers
    file: str | None = None
    unit: Literal["m,N", "mm,N"] | None = None
    source: str | None = None

    @model_validator(mode="before")
    @classmethod
    def _from_file(cls, keys: Any) -> Any:
        return with_columns(keys)

    @model_validator(mode="after")
    def _rises(self) -> Self:
        x, force = self.deflection, self.force
        check_columns(self.unit, x, force)
        if len(x) < 2:
            raise ValueError(f"needs at least two points, got {len(x)}")
        if force[0] == force[1] or force[-1] == force[-2]:
            raise ValueError(
                "needs force that rises in the first and the last piece, so that the spring holds "
                f"the mass, got {force[0]:g} to {force[1]:g} and {force[-2]:g} to {force[-1]:g}"
            )
        if x[0] == 0.0 and force[0] != 0.0:
            raise ValueError(
                f"needs force 0 at the deflection 0 where it begins there, got {force[0]:g}"
            )
        return self

    @property
    def points(self) -> tuple[Vector, Vector]:
        """Displacements (m) and forces (N) in both directions."""
        x, force = np.array(self.deflection), np.array(self.force)
        if x[0] == 0.0:
            x, force = np.concatenate([-x[:0:-1], x]), np.concatenate([-force[:0:-1], force])
        return x, force

    def _piece(self, displacement: ArrayLike) -> tuple[Any, Vector, Vector, Vector, Vector]:
        """Displacements and forces of the table, slopes of its pieces, the piece of each
        displacement, and the way into it."""
        x, force = self.points
        slopes = np.diff(force) / np.diff(x)
        place = np.asarray(displacement, float)
        piece = np.clip(np.searchsorted(x, place, side="right") - 1, 0, len(slopes) - 1)
        return piece, x, force, slopes, place - x[piece]

    def force_at(self, displacement: ArrayLike, velocity: ArrayLike = 0.0) -> Vector:
        piece, _, force, slopes, into = self._piece(displacement)
        return np.asarray(force[piece] + slopes[piece] * into)

    def potential_at(self, displacement: ArrayLike) -> Vector:
        piece, x, force, slopes, into = self._piece(np.append(np.ravel(displacement), 0.0))
        starts = np.concatenate([[0.0], np.cumsum(np.diff(x) * (force[1:] + force[:-1]) / 2.0)])
        energy = starts[piece] + into * (force[piece] + 0.5 * slopes[piece] * into)
        return np.asarray((energy[:-1] - energy[-1]).reshape(np.shape(displacement)))

    def knots(self) -> Vector:
        return self.points[0]

    @property
    def strengths(self) -> Sequence[float]:
        return *self.deflection, *self.force

    def compiled(self, mass: float) -> Any:
        from stochvi.engine.characteristics.spring_table import SpringTable as Compiled

        x, force = self.points
        return Compiled.of(x, force / mass)
