"""The spring of Duffing, whose force has a cubic term."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike

from stochvi.mathematics.arrays import Vector
from stochvi.scenes.characteristics.base import SpringForce
from stochvi.scenes.validation import Number, Positive


class Duffing(SpringForce):
    """A spring of the force F = linear_stiffness x + cubic_stiffness x^3.

    Parameters
    ----------
    cubic_stiffness
        Stiffness of the cubic term, N/m^3.
    linear_stiffness
        Stiffness at x = 0 beside that of the structure, N/m; by default 0. One below 0 makes two
        wells where it outweighs that of the structure.
    on, between, axis
        Where it acts: on a coordinate or point, between two, or along an axis of the mounts of a
        box.

    See Also
    --------
    stochvi.scenes.PolynomialSpring : Any other power.
    stochvi.scenes.SpringTable : A measured force.

    Examples
    --------
    >>> Duffing(cubic_stiffness=2.0).force_at([-1.0, 0.5]).tolist()
    [-2.0, 0.25]
    """

    word: ClassVar[str] = "Duffing"

    kind: Literal["duffing"] = "duffing"
    cubic_stiffness: Positive
    linear_stiffness: Number = 0.0

    def force_at(self, displacement: ArrayLike, velocity: ArrayLike = 0.0) -> Vector:
        x = np.asarray(displacement, float)
        return np.asarray((self.linear_stiffness + self.cubic_stiffness * x**2) * x)

    def potential_at(self, displacement: ArrayLike) -> Vector:
        square = np.asarray(displacement, float) ** 2
        return np.asarray(
            (self.linear_stiffness / 2.0 + self.cubic_stiffness / 4.0 * square) * square
        )

    @property
    def strengths(self) -> Sequence[float]:
        return self.linear_stiffness, self.cubic_stiffness

    def compiled(self, mass: float) -> Any:
        from stochvi.engine.characteristics.polynomials import PolynomialSpring

        terms = np.array([self.linear_stiffness, 0.0, self.cubic_stiffness])
        return PolynomialSpring.of(terms / mass)
