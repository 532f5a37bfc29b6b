"""The damper of Rayleigh, which may excite small motions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike

from stochvi.mathematics.arrays import Vector
from stochvi.scenes.characteristics.base import DamperForce
from stochvi.scenes.validation import Number, Positive


class Rayleigh(DamperForce):
    """A damper of the force F = linear_damping v + cubic_damping v^3.

    Parameters
    ----------
    cubic_damping
        Damping of the cubic term, N s^3/m^3.
    linear_damping
        Damping at v = 0 beside that of the structure, N s/m. Below 0 it excites the mass, which
        then moves by itself at velocities of about sqrt(-4 / 3 linear_damping / cubic_damping).
    on, between, axis
        Where it acts: on a coordinate or point, between two, or along an axis of the mounts of a
        box.

    See Also
    --------
    stochvi.scenes.VanDerPol : Damping that depends on the displacement.

    Examples
    --------
    >>> Rayleigh(linear_damping=-0.1, cubic_damping=0.2).force_at(0.0, [0.5, 1.0]).round(3).tolist()
    [-0.025, 0.1]
    """

    word: ClassVar[str] = "Rayleigh"

    kind: Literal["rayleigh"] = "rayleigh"
    cubic_damping: Positive
    linear_damping: Number = 0.0

    def force_at(self, displacement: ArrayLike, velocity: ArrayLike = 0.0) -> Vector:
        _, v = np.broadcast_arrays(displacement, np.asarray(velocity, float))
        return np.asarray((self.linear_damping + self.cubic_damping * v**2) * v)

    def most_damping(self, mean: float, speed: float) -> float:
        return 0.0

    @property
    def strengths(self) -> Sequence[float]:
        return self.linear_damping, self.cubic_damping

    def compiled(self, mass: float) -> Any:
        from stochvi.engine.characteristics.self_excited import Rayleigh as Compiled

        return Compiled(self.linear_damping / mass, self.cubic_damping / mass)
