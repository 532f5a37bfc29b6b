"""The force of an excitation whose values a simulation draws."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from pydantic import SkipValidation

from stochvi.mathematics.arrays import Vector
from stochvi.scenes.characteristics.base import LinearForm
from stochvi.scenes.excitations.drawn import DrawnExcitation
from stochvi.scenes.modulated_force import ForceOfExcitation


class DrawnForce(ForceOfExcitation):
    """The force of a drawn excitation against a displacement; only its mean is known beforehand.

    Parameters
    ----------
    mass
        Reduced mass of the displacement, kg.
    drawn
        The excitation.
    """

    mass: float
    drawn: SkipValidation[DrawnExcitation]

    @property
    def effect(self) -> str:
        return self.drawn.effect_word

    def refusal(self, name: str) -> str:
        return f"excitation must be Gaussian noise, a sine or constant, got {self.effect}"

    @property
    def strengths(self) -> Sequence[float]:
        return [each for each in (self.drawn.mean, self.drawn.si_intensity) if each]

    def force_at(self, displacement: ArrayLike, velocity: ArrayLike = 0.0) -> Vector:
        """Nothing, as the structure does not carry this force."""
        return np.zeros(np.broadcast(displacement, velocity).shape)

    def linear_form(self, mean: float, deviation: float, speed: float) -> LinearForm:
        """The mean force."""
        return LinearForm(-self.drawn.mean, 0.0, 0.0)

    def stiffest(self, mean: float, deviation: float) -> float:
        return 0.0

    def most_damping(self, mean: float, speed: float) -> float:
        return 0.0

    @property
    def fastest(self) -> float:
        return self.drawn.fastest

    def compiled(self, mass: float) -> Any:
        return self.drawn.compiled(mass)
