"""Dry friction of Coulomb."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike

from stochvi.mathematics.arrays import Vector
from stochvi.scenes.characteristics.base import DamperForce, LinearForm
from stochvi.scenes.validation import Positive


class Coulomb(DamperForce):
    """Dry friction: a force against the motion whose size does not depend on the velocity.

    Parameters
    ----------
    force
        Size of the force, N: the coefficient of friction times the normal force.
    on, between, axis
        Where it acts: on a coordinate or point, between two, or along an axis of the mounts of a
        box.

    See Also
    --------
    stochvi.scenes.BoucWen : Friction whose parts yield before they slip.

    Examples
    --------
    >>> Coulomb(force=0.3).force_at(0.0, [-2.0, 0.0, 0.1]).tolist()
    [-0.3, 0.0, 0.3]
    """

    word: ClassVar[str] = "Coulomb"
    sticks: ClassVar[bool] = True

    kind: Literal["coulomb"] = "coulomb"
    force: Positive

    def force_at(self, displacement: ArrayLike, velocity: ArrayLike = 0.0) -> Vector:
        _, v = np.broadcast_arrays(displacement, np.asarray(velocity, float))
        return np.asarray(self.force * np.sign(v))

    def linear_form(self, mean: float, deviation: float, speed: float) -> LinearForm:
        return LinearForm(0.0, 0.0, math.sqrt(2.0 / math.pi) * self.force / speed)

    def most_damping(self, mean: float, speed: float) -> float:
        return 0.0

    @property
    def strengths(self) -> Sequence[float]:
        return (self.force,)

    def compiled(self, mass: float) -> Any:
        from stochvi.engine.characteristics.coulomb import Coulomb as Compiled

        return Compiled(self.force / mass)
