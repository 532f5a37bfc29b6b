"""What every impact law says of itself, and what a stop that gives way says besides."""

from __future__ import annotations

import math
from abc import abstractmethod
from typing import ClassVar, Literal, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stochvi.mathematics.kelvin_voigt import Impact
from stochvi.scenes.validation import Checked

Vector = NDArray[np.float64]


class Form(NamedTuple):
    """How a simulation moves a mass that meets the stop, and the numbers that it does so with.

    Parameters
    ----------
    name
        "rigid", with a restitution; "pieces", with a row (deflection, force, slope) for each linear
        piece of the force; "damped", with stiffness and damping; "hertz", with the coefficient.
    numbers
        (rows, columns), for forces per unit mass, SI units.
    """

    name: Literal["rigid", "pieces", "damped", "hertz"]
    numbers: Vector


class ImpactLaw(Checked):
    """What happens when the mass meets a stop; the base of every law.

    A law that leaves out an abstract method cannot be made.
    """

    word: ClassVar[str]
    """The word for its stop in the effects of a scene."""

    rigid: ClassVar[bool]
    """Whether the stop does not give way."""

    @abstractmethod
    def per_unit_mass(self, mass: float) -> Self:
        """The law for a force per unit mass, N/kg."""

    @abstractmethod
    def scaled(self, length: float, time: float) -> Self:
        """The law, for forces per unit mass, in units of `length` (m) and `time` (s)."""

    @abstractmethod
    def strengths(self) -> tuple[float, ...]:
        """Numbers with a unit that the law holds."""

    @abstractmethod
    def phrase(self) -> str:
        """The law with its numbers and their units, for a report."""

    @property
    @abstractmethod
    def conservative(self) -> bool:
        """Whether no impact loses energy."""

    @property
    @abstractmethod
    def restitution(self) -> float:
        """Restitution R that a free mass sees, v+ = -R v-."""

    def form(self) -> Form | None:
        """How a simulation follows the law for forces per unit mass; None where none can."""
        return None


class RigidLaw(ImpactLaw):
    """A stop that does not give way: an impact takes no time, and the law holds no force."""

    word: ClassVar[str] = "rigid"
    rigid: ClassVar[bool] = True

    def per_unit_mass(self, mass: float) -> Self:
        """The same law: it knows no force."""
        return self

    def scaled(self, length: float, time: float) -> Self:
        """The same law: a restitution has no unit."""
        return self

    def strengths(self) -> tuple[float, ...]:
        """Numbers with a unit that the law holds: none."""
        return ()


class CompliantLaw(ImpactLaw):
    """A stop that gives way: its force depends on the deflection y = x - stop and its rate.

    Forces and deflections are positive inwards the stop; there is none while y < 0.
    """

    rigid: ClassVar[bool] = False

    @property
    def conservative(self) -> bool:
        """Whether the force has a potential: there is no damper beside the spring."""
        return self.damping(1.0) == 0.0

    @property
    def restitution(self) -> float:
        """Restitution that a free mass of 1 kg sees; 1 without a damper, whatever the speed."""
        return self.impact(1.0, 1.0).restitution

    @abstractmethod
    def damping(self, mass: float) -> float:
        """Coefficient c of a linear damper beside the spring of the stop, N s/m; 0 without one.

        `mass` is the one that a damping ratio refers to, kg: of a pair, the reduced mass.
        """

    @abstractmethod
    def force_at(self, deflection: ArrayLike, rate: ArrayLike = 0.0, mass: float = 1.0) -> Vector:
        """Force on the stop, N, at deflections (m) and their rates (m/s).

        `mass` is the one that a damping ratio refers to, kg, as for `damping`.
        """

    @abstractmethod
    def potential_at(self, deflection: ArrayLike) -> Vector:
        """Energy stored at a deflection, J."""

    @abstractmethod
    def slope_at(self, deflection: ArrayLike) -> Vector:
        """d force / d deflection, N/m."""

    @abstractmethod
    def deflection_at(self, force: ArrayLike) -> Vector:
        """Largest deflection (m) at which the force at rest does not exceed the one given (N);
        infinite where no deflection makes it larger."""

    @abstractmethod
    def impact(self, speed: float, mass: float) -> Impact:
        """The contact of a free mass (of a pair: its reduced mass, kg) that arrives at `speed`."""

    def knots(self) -> Vector:
        """Deflections (m), from 0 on, between which the force is smooth; a law with a kink must
        override this."""
        return np.zeros(1)

    @property
    def largest_force(self) -> float:
        """What the force at rest comes to and never exceeds, N; infinite where it grows without a
        bound. A law whose force has a bound must override this."""
        return math.inf

    @property
    def starts_as_root(self) -> bool:
        """Whether the slope of the force grows from the touch on as the root of the deflection."""
        return False


def inside(deflection: ArrayLike) -> Vector:
    """The deflection, 0 for a mass that does not touch the stop."""
    return np.asarray(np.maximum(np.asarray(deflection, dtype=float), 0.0))
