"""Springs and dampers whose forces are polynomials."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar, Literal, Self

import numpy as np
from numpy.typing import ArrayLike
from pydantic import model_validator

from stochvi.mathematics.arrays import Vector
from stochvi.scenes.characteristics.base import DamperForce, SpringForce
from stochvi.scenes.validation import Numbers


class PolynomialSpring(SpringForce):
    """A spring of the force F = a_1 x + a_2 x^2 + ... + a_n x^n.

    Parameters
    ----------
    coefficients
        a_1, ..., a_n, N/m, N/m^2 and so on. The last one belongs to an odd power and is positive,
        so that the spring holds the mass on both sides.
    on, between, axis
        Where it acts: on a coordinate or point, between two, or along an axis of the mounts of a
        box.

    See Also
    --------
    stochvi.scenes.Duffing : With a cubic term alone.

    Examples
    --------
    >>> PolynomialSpring(coefficients=[1.0, -0.5, 0.25]).force_at(2.0).item()
    2.0
    """

    word: ClassVar[str] = "polynomial"

    kind: Literal["polynomial"] = "polynomial"
    coefficients: Numbers

    @model_validator(mode="after")
    def _holds(self) -> Self:
        if len(self.coefficients) % 2 == 0 or not self.coefficients[-1] > 0.0:
            raise ValueError(
                "needs coefficients that end with an odd power whose coefficient is positive, so "
                f"that the spring holds the mass, got {list(self.coefficients)}; append a small one"
            )
        return self

    def force_at(self, displacement: ArrayLike, velocity: ArrayLike = 0.0) -> Vector:
        return np.asarray(
            np.polyval([*self.coefficients[::-1], 0.0], np.asarray(displacement, float))
        )

    def potential_at(self, displacement: ArrayLike) -> Vector:
        terms = [a / (k + 2) for k, a in enumerate(self.coefficients)]
        return np.asarray(np.polyval([*terms[::-1], 0.0, 0.0], np.asarray(displacement, float)))

    @property
    def strengths(self) -> Sequence[float]:
        return self.coefficients

    def compiled(self, mass: float) -> Any:
        from stochvi.engine.characteristics.polynomials import PolynomialSpring as Compiled

        return Compiled.of(np.array(self.coefficients) / mass)


class PolynomialDamper(DamperForce):
    """A damper of the force F = (c_1 + c_2 abs(v) + ... + c_n abs(v)^(n-1)) v.

    Parameters
    ----------
    coefficients
        c_1, ..., c_n, N s/m, N s^2/m^2 and so on; the last one is positive. The second one is the
        drag of a fluid.
    on, between, axis
        Where it acts: on a coordinate or point, between two, or along an axis of the mounts of a
        box.

    See Also
    --------
    stochvi.scenes.Rayleigh : With a cubic term, and negative damping at small speeds.

    Examples
    --------
    >>> PolynomialDamper(coefficients=[0.1, 2.0]).force_at(0.0, [-1.0, 2.0]).tolist()
    [-2.1, 8.2]
    """

    word: ClassVar[str] = "polynomial"

    kind: Literal["polynomial"] = "polynomial"
    coefficients: Numbers

    @model_validator(mode="after")
    def _brakes(self) -> Self:
        if not self.coefficients[-1] > 0.0:
            raise ValueError(
                "needs coefficients whose last one is positive, so that the damper takes energy, "
                f"got {list(self.coefficients)}"
            )
        return self

    def force_at(self, displacement: ArrayLike, velocity: ArrayLike = 0.0) -> Vector:
        _, v = np.broadcast_arrays(displacement, np.asarray(velocity, float))
        return np.asarray(np.polyval(self.coefficients[::-1], np.abs(v)) * v)

    @property
    def strengths(self) -> Sequence[float]:
        return self.coefficients

    def compiled(self, mass: float) -> Any:
        from stochvi.engine.characteristics.polynomials import PolynomialDamper as Compiled

        return Compiled.of(np.array(self.coefficients) / mass)
