"""The damper of van der Pol, which excites small displacements."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike

from stochvi.mathematics.arrays import Vector
from stochvi.scenes.characteristics.base import DamperForce
from stochvi.scenes.validation import Positive


class VanDerPol(DamperForce):
    """A damper of the force F = damping ((x / amplitude)^2 - 1) v.

    Parameters
    ----------
    damping
        Size of the negative damping at x = 0, N s/m.
    amplitude
        Displacement beyond which it takes energy, m. A lightly damped mass moves by itself with
        twice this amplitude.
    on, between, axis
        Where it acts: on a coordinate or point, between two, or along an axis of the mounts of a
        box.

    See Also
    --------
    stochvi.scenes.Rayleigh : Damping that depends on the velocity.

    Examples
    --------
    >>> VanDerPol(damping=0.2, amplitude=1.0).force_at([0.0, 2.0], 1.0).round(12).tolist()
    [-0.2, 0.6]
    """

    word: ClassVar[str] = "van der Pol"

    kind: Literal["van-der-pol"] = "van-der-pol"
    damping: Positive
    amplitude: Positive

    @property
    def needs(self) -> str:
        return "both"

    def force_at(self, displacement: ArrayLike, velocity: ArrayLike = 0.0) -> Vector:
        x, v = np.asarray(displacement, float), np.asarray(velocity, float)
        return np.asarray(self.damping * ((x / self.amplitude) ** 2 - 1.0) * v)

    def most_damping(self, mean: float, speed: float) -> float:
        return 0.0

    @property
    def strengths(self) -> Sequence[float]:
        return self.damping, self.amplitude

    def compiled(self, mass: float) -> Any:
        from stochvi.engine.characteristics.self_excited import VanDerPol as Compiled

        return Compiled(self.damping / mass, self.amplitude)
