"""The base classes of all impact laws, and of those of compliant stops."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable
from functools import lru_cache
from typing import TYPE_CHECKING, Any, ClassVar, Literal, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike

from stochvi.mathematics.arrays import Matrix, Vector
from stochvi.mathematics.kelvin_voigt import ContactSolution
from stochvi.scenes.validation import Checked, NonNegative

SLOW_SHARE = 1e-3
"""Share of the usual speed of impact at which slow impacts are looked at, where R changes with it.
"""


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


class ContactMotion(NamedTuple):
    """The motion of a mass in a contact.

    Parameters
    ----------
    duration
        Time from the first touch to where the mass leaves, s, or to where it was given up.
    left
        Whether the mass has left.
    states
        Function of times (s) that returns deflections (m) and their rates (m/s), (2, times).
    """

    duration: float
    left: bool
    states: Callable[[Vector], Matrix]


RELATIVE_STEP = 1e-6
"""Step of a difference, relative to the deflection."""

SMALLEST_DEFLECTION, LARGEST_DEFLECTION = 1e-9, 1e12
"""Deflections, m, between which a force is searched for."""

MOST_HALVINGS = 60
"""Number of halvings of the time in which a force ends: as many as double precision needs."""


class ImpactLaw(Checked):
    """Base class of every impact law: what happens when the mass meets a stop.

    Parameters
    ----------
    friction
        Coefficient of friction of the stop, 0 or more, against the motion `tangent` of its pair.
    """

    own: ClassVar[str] = (
        "a force of your own is a ForceFunction or a ForceTable, a restitution of your own a "
        "SpeedRestitution"
    )

    if TYPE_CHECKING:
        kind: Any
        """Name of the class of laws in a scene file, a literal text."""

    word: ClassVar[str]
    """Word for a stop with this law in the effects of a scene."""

    rigid: ClassVar[bool]
    """Whether the stop is rigid."""

    unknown: ClassVar[str] = ""
    """What a report says of what the law does not tell."""

    friction: NonNegative | None = None

    @property
    def remark(self) -> str:
        """What the effects of a scene say of the law besides its word: that the stop rubs."""
        return f", friction {self.friction:g}" if self.friction else ""

    @property
    def friction_coefficient(self) -> float:
        """Coefficient of friction along the stop; 0 where nothing rubs."""
        return self.friction or 0.0

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
    def in_words(self) -> str:
        """The law in words, with its numbers and their units, without its friction."""

    def phrase(self) -> str:
        """The law in words, with all its numbers and their units, for a report."""
        rubs = f", friction {self.friction:g}" if self.friction else ""
        return f"{self.in_words()}{rubs}{self.unknown}"

    @property
    @abstractmethod
    def conservative(self) -> bool:
        """Whether no impact loses energy."""

    @property
    @abstractmethod
    def restitution(self) -> float:
        """Restitution R that a free mass sees, v+ = -R v-; its mean where R scatters."""

    @property
    def restitution_mean_square(self) -> float:
        """E R^2 of impacts, which is R^2 unless R scatters."""
        return self.restitution**2

    @property
    def slow_restitution(self) -> float:
        """The constant restitution at which slow impacts under white noise are the same."""
        return self.restitution

    def on_mass(self, mass: float) -> Self:
        """The law for a pair of this reduced mass, kg, with numbers that refer to it."""
        return self

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
    unknown: ClassVar[str] = ": speeds of impact but no peak acceleration"

    def per_unit_mass(self, mass: float) -> Self:
        """The same law: it has no force."""
        return self

    def scaled(self, length: float, time: float) -> Self:
        """The same law: a restitution has no unit."""
        return self

    def strengths(self) -> tuple[float, ...]:
        """No number of the law has a unit."""
        return ()

    @abstractmethod
    def restitution_at(self, speed: ArrayLike) -> Vector:
        """Restitution of impacts at the given speeds, m/s."""


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

    @property
    def has_linear_damper(self) -> bool:
        """Whether the force depends on the speed by a linear damper alone, if at all."""
        return True

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

    def potential_at(self, deflection: ArrayLike) -> Vector:
        """Energy stored at a deflection, J; a ValueError by default.

        Methods that need the energy ask `has_energy` first.
        """
        raise ValueError(f"the energy of a stop of the kind {self.kind!r} is not known")

    @property
    def has_energy(self) -> bool:
        """Whether `potential_at` gives the stored energy."""
        return type(self).potential_at is not CompliantLaw.potential_at

    def slope_at(self, deflection: ArrayLike) -> Vector:
        """d force / d deflection at rest, N/m; by central differences unless a law knows it."""
        y = inside(deflection)
        step = RELATIVE_STEP * y
        with np.errstate(invalid="ignore"):
            slope = (self.force_at(y + step) - self.force_at(y - step)) / (2.0 * step)
        return np.where(y > 0.0, slope, 0.0)

    def deflection_at(self, force: ArrayLike) -> Vector:
        """Largest deflection (m) at which the force at rest does not exceed the one given (N).

        It is infinite where no deflection makes the force larger. It is searched for unless a law
        knows it.
        """
        return np.asarray(np.vectorize(self._deflection_at, otypes=[float])(force))

    def _deflection_at(self, force: float) -> float:
        from scipy.optimize import brentq

        if force <= 0.0:
            return 0.0
        high = SMALLEST_DEFLECTION
        while self.force_at(high) < force:
            high *= 4.0
            if high > LARGEST_DEFLECTION:
                return math.inf
        return float(brentq(lambda y: float(self.force_at(y)) - force, 0.0, high, xtol=1e-300))

    def impact(self, speed: float, mass: float) -> ContactSolution:
        """The contact of a free mass (of a pair: its reduced mass, kg) that arrives at `speed`.

        It is integrated from the first touch to where the mass leaves, unless a law knows it.
        """
        try:
            return _impact(self, speed, mass)
        except TypeError:  # a law whose numbers have no hash
            return _impact.__wrapped__(self, speed, mass)

    def contact(
        self, speed: float, mass: float, pressing: float = 0.0, longest: float = math.inf
    ) -> ContactMotion:
        """The motion of a mass that arrives at `speed`, from its first touch to where it leaves, or
        over the time `longest`, s.

        `pressing` is an acceleration towards the stop, m/s^2, such as that of gravity in a drop.
        """
        from scipy.integrate import solve_ivp

        def force(y: float, v: float) -> float:
            return float(self.force_at(max(y, 0.0), v, mass))

        # the deflection at which the force at rest would have taken up the energy
        deep = SMALLEST_DEFLECTION
        while force(deep, 0.0) * deep < 0.5 * mass * speed**2 and deep < LARGEST_DEFLECTION:
            deep *= 1.5
        leaves: Any = lambda _, state: state[0]  # noqa: E731
        leaves.terminal, leaves.direction = True, -1.0
        solved: Any = solve_ivp(
            lambda _, state: (state[1], pressing - force(*state) / mass),
            (0.0, min(100.0 * deep / speed, longest)), (0.0, speed), events=leaves, rtol=1e-9,
            atol=1e-12 * deep, dense_output=True, max_step=deep / speed,
        )  # fmt: skip
        left = len(solved.t_events[0]) > 0
        end = float(solved.t_events[0][0] if left else solved.t[-1])
        return ContactMotion(duration=end, left=left, states=solved.sol)

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


@lru_cache(maxsize=256)
def _impact(law: CompliantLaw, speed: float, mass: float) -> ContactSolution:
    """`CompliantLaw.impact`; an answer asks for the same impacts a thousand times."""
    found = law.contact(speed, mass)
    times = np.linspace(0.0, found.duration, 2001)
    y, v = found.states(times)
    forces = law.force_at(y, v, mass)
    return ContactSolution(
        contact_time=_end_of_push(law, found, mass, times[forces > 0.0], float(times[1])),
        time_to_peak=float(times[int(np.argmax(forces))]),
        restitution=max(-float(v[-1]) / speed, 0.0) if found.left else 0.0,
        peak_deflection=float(y.max()),
        peak_force=float(forces.max()),
    )


def _end_of_push(
    law: CompliantLaw, found: ContactMotion, mass: float, pushed: Vector, step: float
) -> float:
    """When a contact ceases to push, from the times at which it does, `step` apart."""
    low = float(pushed[-1])
    high = min(low + step, found.duration)
    for _ in range(MOST_HALVINGS):
        middle = 0.5 * (low + high)
        y, v = found.states(np.array([middle]))
        if law.force_at(y, v, mass)[0] > 0.0:
            low = middle
        else:
            high = middle
    return high


def inside(deflection: ArrayLike) -> Vector:
    """The deflection, 0 for a mass that does not touch the stop."""
    return np.asarray(np.maximum(np.asarray(deflection, dtype=float), 0.0))
