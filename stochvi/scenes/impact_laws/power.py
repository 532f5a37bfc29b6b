"""A force that grows as a power of the deflection, with a loss that does so too."""

from __future__ import annotations

import math
from typing import Annotated, Any, ClassVar, Literal, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field, model_validator

from stochvi.mathematics.arrays import Vector
from stochvi.scenes.impact_laws.base import SLOW_SHARE, CompliantLaw, inside
from stochvi.scenes.validation import NonNegative, Number, Positive


class PowerLaw(CompliantLaw):
    """A spring and a damper that both stiffen, force = max(k y^n + c y^m y', 0).

    With n = 3/2 the bodies are round (Hertz). Then m = 3/2 is the damping of Hunt and Crossley
    (1975), and m = 1/2 that of a viscoelastic material (Kuwabara and Kono 1987). There slow
    impacts have 1 - R proportional to w^(1/5). The stop only pushes.

    Parameters
    ----------
    coefficient
        k, force at a deflection of 1 m, N/m^n.
    exponent
        n, at least 1; 1.5 by default.
    loss
        c, N s/m^(m + 1); 0 by default, for a stop that takes no energy.
    loss_exponent
        m, at least 0; n by default.
    at_speed
        Speed of impact, m/s, whose restitution stands for that of all speeds where one number is
        needed, for steps and starts; 1 by default. Give the usual speed of the impacts.
    source
        Where the numbers come from.

    See Also
    --------
    stochvi.scenes.Hertz : The force of round bodies without a loss, for more methods.
    stochvi.identify : The numbers of a law from a test.

    Examples
    --------
    >>> law = PowerLaw(coefficient=1e6, loss=3e5)
    >>> law.force_at(0.01, [-1.0, 0.0, 1.0]).round(9).tolist()
    [700.0, 1000.0, 1300.0]
    >>> round(law.impact(speed=1.0, mass=2.0).restitution, 4)
    0.8329
    """

    word: ClassVar[str] = "power law"

    kind: Literal["power"] = "power"
    coefficient: Positive
    exponent: Annotated[Number, Field(ge=1)] = 1.5
    loss: NonNegative = 0.0
    loss_exponent: NonNegative | None = None
    at_speed: Positive = 1.0
    source: str | None = None

    @model_validator(mode="after")
    def _known_loss(self) -> Self:
        if self.loss_exponent is None:
            self.__dict__["loss_exponent"] = self.exponent
        return self

    @property
    def _power(self) -> float:
        assert self.loss_exponent is not None
        return self.loss_exponent

    @property
    def conservative(self) -> bool:
        """Whether the stop takes no energy."""
        return self.loss == 0.0

    @property
    def restitution(self) -> float:
        """Restitution that a free mass of 1 kg sees at the speed `at_speed`."""
        return self.impact(self.at_speed, 1.0).restitution

    @property
    def slow_restitution(self) -> float:
        """R of impacts that are a thousand times slower than `at_speed`."""
        return self.impact(SLOW_SHARE * self.at_speed, 1.0).restitution

    @property
    def has_linear_damper(self) -> bool:
        """Whether there is no loss."""
        return self.conservative

    def damping(self, mass: float) -> float:
        """0 without a loss; ValueError with one, which is no linear damper."""
        if not self.conservative:
            raise ValueError("the loss of a power law is no linear damper")
        return 0.0

    def force_at(self, deflection: ArrayLike, rate: ArrayLike = 0.0, mass: float = 1.0) -> Vector:
        y = inside(deflection)
        push = self.coefficient * y**self.exponent
        push = push + self.loss * y**self._power * np.asarray(rate, dtype=float)
        return np.where(y > 0.0, np.maximum(push, 0.0), 0.0)

    def potential_at(self, deflection: ArrayLike) -> Vector:
        """Energy in the spring alone, J."""
        power = self.exponent + 1.0
        return np.asarray(self.coefficient / power * inside(deflection) ** power)

    def slope_at(self, deflection: ArrayLike) -> Vector:
        """d force / d deflection of the spring alone, N/m."""
        y = inside(deflection)
        slope = self.exponent * self.coefficient * y ** (self.exponent - 1.0)
        return np.where(y > 0.0, slope, 0.0)

    def deflection_at(self, force: ArrayLike) -> Vector:
        return np.asarray((inside(force) / self.coefficient) ** (1.0 / self.exponent))

    def per_unit_mass(self, mass: float) -> Self:
        return self._times(1.0 / mass, 1.0 / mass, 1.0)

    def scaled(self, length: float, time: float) -> Self:
        return self._times(
            time**2 * length ** (self.exponent - 1.0), time * length**self._power, length / time
        )

    def _times(self, force: float, loss: float, speed: float) -> Self:
        changes: dict[str, Any] = {
            "coefficient": self.coefficient * force,
            "loss": self.loss * loss,
            "at_speed": self.at_speed / speed,
        }
        return self.model_copy(update=changes)

    def strengths(self) -> tuple[float, ...]:
        return (self.coefficient, self.loss)

    def in_words(self) -> str:
        lost = f", loss {self.loss:.4g} N s/m^{self._power + 1.0:g}" if self.loss else ""
        return f"{self.word}, coefficient {self.coefficient:.4g} N/m^{self.exponent:g}{lost}"

    def compiled(self) -> NamedTuple:
        from stochvi.engine.laws.power import Power

        return Power(self.coefficient, self.exponent, self.loss, self._power)

    @property
    def starts_as_root(self) -> bool:
        """Whether the slope grows as a root; nearly so for powers from 1 to 2."""
        return math.modf(self.exponent)[0] != 0.0 and self.exponent < 2.0
