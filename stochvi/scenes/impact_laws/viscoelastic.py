"""Stops of rubber and steel: a linear spring, alone or with a parallel damper.

`rubber_data.py` makes their numbers from hardness, loss factor or restitution.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, ClassVar, Literal, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike

from stochvi.mathematics.arrays import Vector
from stochvi.mathematics.kelvin_voigt import ContactSolution, half_contact, kelvin_voigt
from stochvi.scenes.between_units import VariedPositive
from stochvi.scenes.impact_laws.base import Form, inside
from stochvi.scenes.impact_laws.rubber_data import RubberLaw, with_damping_ratio, with_stiffness
from stochvi.scenes.validation import NonNegative, Positive


class LinearLaw(RubberLaw):
    """A stop whose force at rest is that of a linear spring, stiffness * y."""

    kind: Literal["elastic", "viscoelastic"]
    stiffness: VariedPositive

    def potential_at(self, deflection: ArrayLike) -> Vector:
        """Energy in the spring alone, J."""
        return 0.5 * self.stiffness * inside(deflection) ** 2

    def slope_at(self, deflection: ArrayLike) -> Vector:
        """Stiffness of the spring alone, N/m."""
        return np.where(inside(deflection) > 0.0, self.stiffness, 0.0)

    def deflection_at(self, force: ArrayLike) -> Vector:
        return inside(force) / self.stiffness

    def per_unit_mass(self, mass: float) -> Self:
        return self.model_copy(update={"stiffness": self.stiffness / mass})

    def scaled(self, length: float, time: float) -> Self:
        return self.model_copy(update={"stiffness": self.stiffness * time**2})

    def in_series(self, compliance: float) -> Self:
        softer = 1.0 + compliance * self.stiffness
        return self.model_copy(update={"stiffness": self.stiffness / softer})

    def strengths(self) -> tuple[float, ...]:
        return (self.stiffness,)


class Elastic(LinearLaw):
    """A linear spring, force = stiffness * y.

    Parameters
    ----------
    stiffness
        K, N/m; or `shore_a`, `area` (m^2) and `thickness` (m) of a rubber pad, from which it comes
        by Gent's relation.
    source
        Where the numbers come from; what was converted is added.

    See Also
    --------
    stochvi.Viscoelastic : A stop that takes energy.
    stochvi.ImpactPair : Where the stop is.

    Examples
    --------
    >>> law = Elastic(stiffness=100.0)
    >>> float(law.force_at(0.1)), law.potential_at([0.0, 0.1]).tolist()
    (10.0, [0.0, 0.5000000000000001])
    >>> law.impact(speed=1.0, mass=1.0).peak_force
    10.0
    """

    word: ClassVar[str] = "elastic"

    kind: Literal["elastic"] = "elastic"
    source: str | None = None

    @classmethod
    def converted(cls, keys: Mapping[str, Any]) -> dict[str, Any]:
        return with_stiffness(keys)

    def damping(self, mass: float) -> float:
        return 0.0

    def force_at(self, deflection: ArrayLike, rate: ArrayLike = 0.0, mass: float = 1.0) -> Vector:
        return self.stiffness * inside(deflection)

    def impact(self, speed: float, mass: float) -> ContactSolution:
        return kelvin_voigt(self.stiffness, 0.0, speed, mass)

    def in_words(self) -> str:
        return f"{self.word}, stiffness {self.stiffness:.4g} N/m"

    def compiled(self) -> NamedTuple:
        from stochvi.engine.laws.viscoelastic import Viscoelastic as Compiled

        return Compiled(self.stiffness, 0.0)

    def form(self) -> Form:
        return Form("pieces", np.array([[0.0, 0.0, self.stiffness]]))


class Viscoelastic(LinearLaw):
    """A spring and a parallel damper, which can only push (Kelvin-Voigt, B App. I).

    The force is max(K y + c y', 0) with c = 2 z sqrt(K M), z the damping ratio. M is the mass, or
    the reduced mass of an impact pair. A contact ends when the force returns to zero, which is
    before the deflection does. The stop has no mass and recovers at once: it follows the mass
    without a force, and pushes again when K y + c y' becomes positive.

    Parameters
    ----------
    stiffness
        K, N/m; or `shore_a`, `area` and `thickness`, as for `Elastic`.
    damping_ratio
        z, of any size. The restitution that a free mass sees is exp(-2 z arccos z / sqrt(1 - z^2)).
        Or `loss_factor` = 2 z, that of the rubber at the frequency sqrt(K / M) of the contact; or
        `restitution`, that of a free mass, measured `at_speed` (m/s).
    mass
        M of a test, kg, to which the damping ratio refers: the damper c is then that of the test,
        whatever hits the stop. Without it M is the mass that hits the stop; at a corner of a box
        this is the force over the acceleration that it gives the corner.
    source
        Where the numbers come from; what was converted is added.

    See Also
    --------
    stochvi.Elastic : A stop that takes no energy.
    stochvi.ImpactPair : Where the stop is.

    Examples
    --------
    >>> law = Viscoelastic(stiffness=1.0, damping_ratio=0.2)
    >>> round(law.restitution, 12), round(law.impact(speed=1.0, mass=1.0).contact_time, 10)
    (0.571740027585, 2.7953544407)
    >>> dropped = Viscoelastic(stiffness=1.0, damping_ratio=0.2, mass=4.0)
    >>> dropped.damping(1.0), dropped.damping(100.0), dropped.on_mass(1.0).damping_ratio
    (0.8, 0.8, 0.4)
    """

    word: ClassVar[str] = "viscoelastic"

    kind: Literal["viscoelastic"] = "viscoelastic"
    damping_ratio: NonNegative
    mass: Positive | None = None
    source: str | None = None

    @classmethod
    def converted(cls, keys: Mapping[str, Any]) -> dict[str, Any]:
        return with_damping_ratio(with_stiffness(keys))

    @property
    def restitution(self) -> float:
        """Restitution of a free mass, R = exp(-2 z arccos z / sqrt(1 - z^2)) (B App. I)."""
        return math.exp(-2.0 * self.damping_ratio * half_contact(self.damping_ratio))

    def on_mass(self, mass: float) -> Self:
        if self.mass is None:
            return self
        ratio = self.damping_ratio * math.sqrt(self.mass / mass)
        return self.model_copy(update={"damping_ratio": ratio, "mass": None})

    def damping(self, mass: float) -> float:
        """c = 2 z sqrt(K M), N s/m."""
        return 2.0 * self.damping_ratio * math.sqrt(self.stiffness * (self.mass or mass))

    def per_unit_mass(self, mass: float) -> Self:
        found = self.on_mass(mass)
        return found.model_copy(update={"stiffness": found.stiffness / mass})

    def force_at(self, deflection: ArrayLike, rate: ArrayLike = 0.0, mass: float = 1.0) -> Vector:
        """Force on the stop, N; the mass that the damping ratio refers to, kg, by default 1."""
        y = np.asarray(deflection, dtype=float)
        push = self.stiffness * y + self.damping(mass) * np.asarray(rate, dtype=float)
        return np.where(y > 0.0, np.maximum(push, 0.0), 0.0)

    def in_series(self, compliance: float) -> Self:
        """The stop and a spring in series, for contacts that last longer than the damper takes to
        relax: the force is that of K / (1 + K s) and c / (1 + K s)^2, s the compliance."""
        softer = 1.0 + compliance * self.stiffness
        return self.model_copy(
            update={
                "stiffness": self.stiffness / softer,
                "damping_ratio": self.damping_ratio / softer**1.5,
            }
        )

    def impact(self, speed: float, mass: float) -> ContactSolution:
        return kelvin_voigt(self.stiffness, self.on_mass(mass).damping_ratio, speed, mass)

    def in_words(self) -> str:
        numbers = f"stiffness {self.stiffness:.4g} N/m, damping ratio {self.damping_ratio:.4g}"
        return f"{self.word}, {numbers}" + (f" of {self.mass:g} kg" if self.mass else "")

    def compiled(self) -> NamedTuple:
        from stochvi.engine.laws.viscoelastic import Viscoelastic as Compiled

        return Compiled(self.stiffness, self.damping(1.0))

    def form(self) -> Form:
        if self.conservative:
            return Form("pieces", np.array([[0.0, 0.0, self.stiffness]]))
        return Form("damped", np.array([[self.stiffness, self.damping(1.0)]]))
