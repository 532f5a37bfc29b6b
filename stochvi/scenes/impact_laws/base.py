"""The base classes of all impact laws, and of those of compliant stops."""

from __future__ import annotations

import math
from abc import abstractmethod
from typing import Any, ClassVar, Literal, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike

from stochvi.mathematics.arrays import Vector
from stochvi.mathematics.kelvin_voigt import ContactSolution
from stochvi.scenes.validation import Checked


class Form(NamedTuple):
    """The form in which the kernels of a simulation know an impact law, and its numbers.

    Parameters
    ----------
    name
        "rigid", with a restitution; "pieces", with a row (deflection, force, slope) for each linear
        piece of the force; "damped", with stiffness and damping; "hertz", with the coefficient.
    numbers
        Array (rows, columns) of the numbers, for forces per unit mass, SI units.
    """

    name: Literal["rigid", "pieces", "damped", "hertz"]
    numbers: Vector


class ImpactLaw(Checked):
    """Base class of every impact law: what happens when the mass meets a stop."""

    own: ClassVar[str] = (
        "a force of your own is a ForceTable, a restitution of your own a SpeedRestitution"
    )

    word: ClassVar[str]
    """Word for a stop with this law in the effects of a scene."""

    rigid: ClassVar[bool]
    """Whether the stop is rigid."""

    @abstractmethod
    def per_unit_mass(self, mass: float) -> Self:
        """The law for a force per unit mass, N/kg."""

    @abstractmethod
    def scaled(self, length: float, time: float) -> Self:
        """The law for forces per unit mass, with `length` (m) and `time` (s) as units."""

    @abstractmethod
    def strengths(self) -> tuple[float, ...]:
        """Those numbers of the law that have a unit."""

    @abstractmethod
    def phrase(self) -> str:
        """The law in words, with its numbers and their units, for a report."""

    @property
    @abstractmethod
    def conservative(self) -> bool:
        """Whether no impact loses energy."""

    @property
    @abstractmethod
    def restitution(self) -> float:
        """Restitution R that a free mass sees, v+ = -R v-."""

    def in_series(self, compliance: float) -> Self:
        """The law of the stop and of a spring in series with it, of a compliance in m/N; the law
        itself where the spring is left out."""
        return self

    def compiled(self) -> Any | None:
        """The law as compiled kernels know it, a class of `engine.laws` with its numbers, for a law
        for forces per unit mass; None if there is none."""
        return None

    def form(self) -> Form | None:
        """The form for simulations, for a law for forces per unit mass; None if there is none."""
        return None


class RigidLaw(ImpactLaw):
    """A rigid stop: an impact takes no time, and the law holds no force."""

    word: ClassVar[str] = "rigid"
    rigid: ClassVar[bool] = True

    def per_unit_mass(self, mass: float) -> Self:
        """The same law: it has no force."""
        return self

    def scaled(self, length: float, time: float) -> Self:
        """The same law: a restitution has no unit."""
        return self

    def strengths(self) -> tuple[float, ...]:
        """No number of the law has a unit."""
        return ()


class CompliantLaw(ImpactLaw):
    """A compliant stop: its force depends on the deflection y = x - stop and its rate.

    Forces and deflections are positive into the stop. The force is 0 while y < 0.
    """

    rigid: ClassVar[bool] = False

    @property
    def conservative(self) -> bool:
        """Whether the force has a potential, because there is no damper parallel to the spring."""
        return self.damping(1.0) == 0.0

    @property
    def restitution(self) -> float:
        """Restitution that a free mass of 1 kg sees; 1 without a damper, whatever the speed."""
        return self.impact(1.0, 1.0).restitution

    @abstractmethod
    def damping(self, mass: float) -> float:
        """Coefficient c of a linear damper beside the spring of the stop, N s/m; 0 without one.

        `mass` is the mass to which a damping ratio refers, kg: the reduced mass of the impact pair.
        """

    @abstractmethod
    def force_at(self, deflection: ArrayLike, rate: ArrayLike = 0.0, mass: float = 1.0) -> Vector:
        """Force on the stop, N, at deflections (m) and their rates (m/s).

        `mass` is the mass to which a damping ratio refers, kg, as for `damping`.
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
    def impact(self, speed: float, mass: float) -> ContactSolution:
        """The contact of a free mass (of a pair: its reduced mass, kg) that arrives at `speed`."""

    def knots(self) -> Vector:
        """Deflections (m), the first one 0, between which the force is smooth; a law with a kink
        must override this."""
        return np.zeros(1)

    @property
    def largest_force(self) -> float:
        """Upper bound of the force at rest, N; infinite by default. A law whose force has a bound
        must override this."""
        return math.inf

    @property
    def starts_as_root(self) -> bool:
        """Whether the slope of the force near 0 grows as the square root of the deflection."""
        return False


def inside(deflection: ArrayLike) -> Vector:
    """The deflection, 0 for a mass that does not touch the stop."""
    return np.asarray(np.maximum(np.asarray(deflection, dtype=float), 0.0))
