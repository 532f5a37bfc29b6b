"""The contact of two round bodies."""

from __future__ import annotations

import math
from typing import ClassVar, Literal, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike

from stochvi.mathematics.arrays import Vector
from stochvi.mathematics.kelvin_voigt import ContactSolution
from stochvi.scenes.impact_laws.base import CompliantLaw, Form, inside
from stochvi.scenes.validation import Positive


class Hertz(CompliantLaw):
    """Contact of two round bodies, force = coefficient * y^(3/2).

    A mass M that arrives at the speed w is stopped at y_m = (5 M w^2 / (4 k))^(2/5). It leaves
    after (4/5) (y_m / w) Gamma(2/5) Gamma(1/2) / Gamma(9/10) = 2.943 y_m / w.

    Parameters
    ----------
    coefficient
        Force at a deflection of 1 m, N/m^1.5.

    See Also
    --------
    stochvi.Elastic : A force that is linear.
    stochvi.ImpactPair : Where the stop is.

    Examples
    --------
    >>> contact = Hertz(coefficient=1.25).impact(speed=1.0, mass=1.0)
    >>> contact.peak_deflection, round(contact.contact_time, 6)
    (1.0, 2.943275)
    """

    word: ClassVar[str] = "Hertz"

    kind: Literal["hertz"] = "hertz"
    coefficient: Positive

    def damping(self, mass: float) -> float:
        return 0.0

    def force_at(self, deflection: ArrayLike, rate: ArrayLike = 0.0, mass: float = 1.0) -> Vector:
        return self.coefficient * inside(deflection) ** 1.5

    def potential_at(self, deflection: ArrayLike) -> Vector:
        return 0.4 * self.coefficient * inside(deflection) ** 2.5

    def slope_at(self, deflection: ArrayLike) -> Vector:
        return 1.5 * self.coefficient * np.sqrt(inside(deflection))

    def deflection_at(self, force: ArrayLike) -> Vector:
        return np.asarray((inside(force) / self.coefficient) ** (2.0 / 3.0))

    def impact(self, speed: float, mass: float) -> ContactSolution:
        deepest = (1.25 * mass * speed**2 / self.coefficient) ** 0.4
        time = 0.8 * deepest / speed * math.gamma(0.4) * math.gamma(0.5) / math.gamma(0.9)
        return ContactSolution(time, time / 2.0, 1.0, deepest, self.coefficient * deepest**1.5)

    def per_unit_mass(self, mass: float) -> Self:
        return self.model_copy(update={"coefficient": self.coefficient / mass})

    def strengths(self) -> tuple[float, ...]:
        return (self.coefficient,)

    def scaled(self, length: float, time: float) -> Self:
        coefficient = self.coefficient * time**2 * math.sqrt(length)
        return self.model_copy(update={"coefficient": coefficient})

    def in_words(self) -> str:
        return f"{self.word}, coefficient {self.coefficient:.4g} N/m^1.5"

    def compiled(self) -> NamedTuple:
        from stochvi.engine.laws.hertz import Hertz as Compiled

        return Compiled(self.coefficient)

    def form(self) -> Form:
        return Form("hertz", np.array([[self.coefficient]]))

    @property
    def starts_as_root(self) -> bool:
        return True
