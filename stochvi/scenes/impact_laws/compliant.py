"""Compliant stops. Chapters: base classes of all laws; a force of one's own; tables; Hertz; the
power law with loss; numbers of rubber from hardness, loss factor or restitution; the linear spring
with or without damper."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import pairwise
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, NamedTuple, Self

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray
from pydantic import (
    Field,
    ModelWrapValidatorHandler,
    PrivateAttr,
    SerializationInfo,
    SerializerFunctionWrapHandler,
    field_serializer,
    model_serializer,
    model_validator,
)

from stochvi.mathematics.kelvin_voigt import (
    ContactSolution,
    damping_ratio_of,
    half_contact,
    kelvin_voigt,
)
from stochvi.mathematics.numerics import Matrix, Vector
from stochvi.results.errors import SceneError
from stochvi.scenes.frames import Values, source_of
from stochvi.scenes.readers import si_columns, table_of
from stochvi.scenes.text_tables import all_columns
from stochvi.scenes.validation import (
    Checked,
    Function,
    NonNegative,
    NonNegatives,
    Number,
    Positive,
    VariedPositive,
    _name_of,
    arguments_fault,
    sentences_of,
)

# ------------------------------------------------------------------------------
# The base classes of all impact laws, and of those of compliant stops.
# ------------------------------------------------------------------------------


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
        "SpeedRestitution; a law with keys of its own is derived from CompliantLaw or RigidLaw, "
        "with a kind of its own"
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
        """The law as compiled kernels know it, a class of `engine.impact_laws` with its numbers,
        for a law for forces per unit mass; None if there is none."""
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
        if force <= 0.0:
            return 0.0
        high = SMALLEST_DEFLECTION
        while self.force_at(high) < force:
            high *= 4.0
            if high > LARGEST_DEFLECTION:
                return math.inf
        return float(
            scipy.optimize.brentq(lambda y: float(self.force_at(y)) - force, 0.0, high, xtol=1e-300)
        )

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

        def force(y: float, v: float) -> float:
            return float(self.force_at(max(y, 0.0), v, mass))

        # the deflection at which the force at rest would have taken up the energy
        deep = SMALLEST_DEFLECTION
        while force(deep, 0.0) * deep < 0.5 * mass * speed**2 and deep < LARGEST_DEFLECTION:
            deep *= 1.5
        leaves: Any = lambda _, state: state[0]  # noqa: E731
        leaves.terminal, leaves.direction = True, -1.0
        solved: Any = scipy.integrate.solve_ivp(
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


# ------------------------------------------------------------------------------
# A force that is a function of the deflection of a stop and of its speed.
# ------------------------------------------------------------------------------


SAMPLES = np.geomspace(1e-9, 1e-3, 25), np.array([-1.0, -0.1, 0.0, 0.1, 1.0])
"""Deflections (m) and speeds (m/s) at which a force is checked."""


class ForceFunction(CompliantLaw):
    """A force of one's own, any function of the deflection of the stop and of its speed.

    A function cannot be written in a scene file: this law is for Python only. `simulate` and
    `replay` compile the function, and the stop only pushes: where the function is negative, it has
    no force. Answers, provenance and documents name the function, with a digest of its instructions
    and of the values that it uses. A checkpoint of another function is not gone on with. Another
    process finds the function by its name, in a module that it can import.

    Parameters
    ----------
    force
        Force on the stop, N, a function (deflection, speed) of two numbers in m and m/s: plain
        Python with `math`, or compiled by numba. The speed is positive into the stop.
    energy
        Energy stored at a deflection, J, a function of one number. Methods that need it say so by
        name: exact laws, linearisation, Fokker-Planck.
    at_speed
        Speed of impact, m/s, whose restitution stands for that of all speeds where one number is
        needed, for steps and starts; 1 by default. Give the usual speed of the impacts.

    Raises
    ------
    SceneError
        If the function does not give a number, or if the stop pulls at rest.

    See Also
    --------
    stochvi.ForceTable : A measured force over the deflection.
    stochvi.SpeedRestitution : A rigid stop whose restitution is a function.

    Examples
    --------
    >>> rubber = ForceFunction(force=lambda y, v: 1e6 * y**1.5 * (1.0 + 0.3 * v))
    >>> rubber.force_at(0.01, [-1.0, 0.0, 1.0]).round(9).tolist()
    [700.0, 1000.0, 1300.0]
    >>> round(rubber.impact(speed=1.0, mass=2.0).restitution, 4)
    0.8329
    """

    word: ClassVar[str] = "function"

    kind: Literal["function"] = "function"
    force: Function
    energy: Function | None = None
    at_speed: Positive = 1.0
    _units: tuple[float, float, float] = PrivateAttr(default=(1.0, 1.0, 1.0))
    """Factors of the force, of the deflection and of its rate: of another unit of each."""
    _contents: str = PrivateAttr(default="")
    """Digest of the instructions of the functions and of the values that they use."""

    @model_validator(mode="after")
    def _pushes(self) -> Self:
        from stochvi.engine.impact_laws import contents_of

        if fault := arguments_fault(self.force):
            raise ValueError(
                f"needs force that takes a deflection (m) and a speed (m/s), got {fault}"
            )
        deflections, speeds = (axis.ravel() for axis in np.meshgrid(*SAMPLES))
        try:
            values = np.array(
                [float(self.force(y, v)) for y, v in zip(deflections, speeds, strict=True)]
            )
        except Exception as error:
            raise ValueError(
                "needs force that takes a deflection (m) and a speed (m/s) and returns a number, "
                f"got {type(error).__name__}: {error}"
            ) from None
        wrong = ~np.isfinite(values) | ((values < 0.0) & (speeds == 0.0))
        if wrong.any():
            raise ValueError(
                f"needs force that is a finite number, and not negative at rest, got "
                f"{values[wrong][0]:g} at {deflections[wrong][0]:g} m and {speeds[wrong][0]:g} m/s"
            )
        functions = [each for each in (self.force, self.energy) if each is not None]
        self._contents = contents_of(functions)
        return self

    @field_serializer("force")
    def _named(self, function: Any) -> str:
        return f"{_name_of(function)} ({self._contents[:16]})"

    @cached_property
    def conservative(self) -> bool:
        """Whether the force does not depend on the speed, at all speeds that are checked."""
        y, v = np.meshgrid(np.geomspace(1e-9, 1e-1, 17), SAMPLES[1])
        return bool(np.array_equal(self.force_at(y, v), self.force_at(y)))

    @property
    def restitution(self) -> float:
        """Restitution that a free mass of 1 kg sees at the speed `at_speed`."""
        return self.impact(self.at_speed / self._units[2], 1.0).restitution

    @property
    def slow_restitution(self) -> float:
        """R of impacts that are a thousand times slower than `at_speed`."""
        return self.impact(SLOW_SHARE * self.at_speed / self._units[2], 1.0).restitution

    @property
    def has_linear_damper(self) -> bool:
        """Whether the force does not depend on the speed."""
        return self.conservative

    def damping(self, mass: float) -> float:
        """0 of a force that does not depend on the speed; ValueError for others."""
        if not self.conservative:
            raise ValueError("a force that is a function of the speed has no linear damper")
        return 0.0

    def force_at(self, deflection: ArrayLike, rate: ArrayLike = 0.0, mass: float = 1.0) -> Vector:
        factor, length, speed = self._units
        y, v = np.broadcast_arrays(inside(deflection), np.asarray(rate, float))
        found = [
            factor * max(float(self.force(length * one, speed * two)), 0.0) if one > 0.0 else 0.0
            for one, two in zip(y.ravel().tolist(), v.ravel().tolist(), strict=True)
        ]
        return np.array(found).reshape(y.shape)

    def potential_at(self, deflection: ArrayLike) -> Vector:
        """Energy stored at a deflection, J; ValueError without `energy`."""
        energy, y = self.energy, inside(deflection)
        if energy is None:
            raise ValueError("law.energy must be given for this, a function of the deflection")
        factor, length, _ = self._units
        stored = [float(energy(length * each)) - float(energy(0.0)) for each in y.ravel().tolist()]
        return factor / length * np.array(stored).reshape(y.shape)

    @property
    def has_energy(self) -> bool:
        """Whether the stored energy is given."""
        return self.energy is not None

    def impact(self, speed: float, mass: float) -> ContactSolution:
        if (speed, mass) not in self._contacts:
            self._contacts[speed, mass] = super().impact(speed, mass)
        return self._contacts[speed, mass]

    def per_unit_mass(self, mass: float) -> Self:
        return self._in_units(1.0 / mass, 1.0, 1.0)

    def scaled(self, length: float, time: float) -> Self:
        return self._in_units(time**2 / length, length, length / time)

    def _in_units(self, force: float, length: float, speed: float) -> Self:
        other = self.model_copy()
        factor, unit, rate = self._units
        other._units = (factor * force, unit * length, rate * speed)
        return other

    @cached_property
    def _contacts(self) -> dict[tuple[float, float], ContactSolution]:
        """Contacts that were integrated, by speed and mass."""
        return {}

    def strengths(self) -> tuple[float, ...]:
        return (self._units[0],)

    def in_words(self) -> str:
        return f"{self.word}, force {_name_of(self.force)}"

    def compiled(self) -> NamedTuple:
        from stochvi.engine.impact_laws import NotCompiled, law_of

        try:
            kind = law_of(self.force, not self.conservative)
        except NotCompiled as error:
            raise SceneError(
                f"law.force must be a function that numba compiles, got {_name_of(self.force)}: "
                f"{error}; write it with numbers, `if` and `math`, or compile it with numba.njit"
            ) from None
        found: NamedTuple = kind(*self._units)
        return found


# ------------------------------------------------------------------------------
# A measured force over the deflection of a stop.
# ------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Pieces:
    """A table as linear pieces: deflection (m), force (N) and potential (J) at the start of each
    piece, and its slope (N/m)."""

    starts: Vector
    forces: Vector
    slopes: Vector
    potentials: Vector


class ForceTable(CompliantLaw):
    """A measured force over deflection, linear between its points.

    Beyond the last point the force continues with the slope of the last piece. The point (0, 0) is
    added in front if it is not given.

    Parameters
    ----------
    deflection
        Increasing, m, from 0 on; beyond the last one the last slope goes on.
    force
        Never decreasing, N, 0 at the deflection 0.
    file, values, unit
        Instead of the two: a file of two columns, or in Python a Series, frame or array of them,
        and their units, "m,N" or "mm,N". The units may also stand in the headings of the columns,
        in any spelling.
    source
        Where the numbers come from; by default the name of the file from which they were read.

    See Also
    --------
    stochvi.Elastic : A straight line.
    stochvi.ImpactPair : Where the stop is.

    Examples
    --------
    >>> law = ForceTable(deflection=[0.01, 0.02], force=[1.0, 4.0])
    >>> law.force_at([0.005, 0.015, 0.03]).round(12).tolist()
    [0.5, 2.5, 7.0]
    >>> round(float(law.potential_at(0.01)), 12)
    0.005
    """

    word: ClassVar[str] = "tabulated"

    kind: Literal["table"] = "table"
    deflection: NonNegatives
    force: NonNegatives
    file: str | None = None
    values: Values | None = None
    unit: Literal["m,N", "mm,N"] | None = None
    source: str | None = None

    @model_validator(mode="before")
    @classmethod
    def _from_file(cls, keys: Any) -> Any:
        return with_columns(keys)

    @model_validator(mode="after")
    def _grows(self) -> Self:
        check_columns(self.unit, self.deflection, self.force)
        if not self.deflection or self.deflection[-1] == 0.0:
            raise ValueError("needs at least one point with a deflection above 0")
        if self.deflection[0] == 0.0 and self.force[0] > 0.0:
            raise ValueError(f"needs force 0 at the deflection 0, got {self.force[0]:g}")
        return self

    @cached_property
    def arrays(self) -> Pieces:
        """The table as pieces, made once because a closure asks for it some 100,000 times."""
        y, f = np.array(self.deflection), np.array(self.force)
        if y[0] > 0.0:
            y, f = np.insert(y, 0, 0.0), np.insert(f, 0, 0.0)
        starts, forces, slopes = y[:-1], f[:-1], np.diff(f) / np.diff(y)
        lengths = np.diff(starts)
        areas = lengths * (forces[:-1] + 0.5 * slopes[:-1] * lengths)
        return Pieces(starts, forces, slopes, np.concatenate([[0.0], np.cumsum(areas)]))

    @property
    def pieces(self) -> Vector:
        """Array (3, pieces): deflection and force at the start of each piece, and its slope. The
        last piece has no end."""
        return np.stack([self.arrays.starts, self.arrays.forces, self.arrays.slopes])

    def _piece(self, deflection: ArrayLike) -> tuple[NDArray[np.intp], Vector, Vector, Vector]:
        """For each deflection: number of the piece, force at its start, its slope, and the distance
        from its start."""
        table, y = self.arrays, inside(deflection)
        number = np.searchsorted(table.starts, y, side="right") - 1
        return number, table.forces[number], table.slopes[number], y - table.starts[number]

    def damping(self, mass: float) -> float:
        return 0.0

    def force_at(self, deflection: ArrayLike, rate: ArrayLike = 0.0, mass: float = 1.0) -> Vector:
        _, force, slope, into = self._piece(deflection)
        return np.asarray(force + slope * into)

    def potential_at(self, deflection: ArrayLike) -> Vector:
        number, force, slope, into = self._piece(deflection)
        before = self.arrays.potentials[number]
        return np.asarray(before + into * (force + 0.5 * slope * into))

    def slope_at(self, deflection: ArrayLike) -> Vector:
        _, _, slope, _ = self._piece(deflection)
        return np.where(np.asarray(deflection) > 0.0, slope, 0.0)

    def deflection_at(self, force: ArrayLike) -> Vector:
        forces, slopes, starts = self.arrays.forces, self.arrays.slopes, self.arrays.starts
        given = inside(force)
        number = np.searchsorted(forces, given, side="right") - 1
        with np.errstate(divide="ignore", invalid="ignore"):
            into = np.where(
                slopes[number] > 0.0, (given - forces[number]) / slopes[number], math.inf
            )
        return np.asarray(starts[number] + into)

    def impact(self, speed: float, mass: float) -> ContactSolution:
        """The contact of a free mass, whose motion within each piece is part of a harmonic one.

        From the speed v_0 to v_1 over the distance d it takes the time
        (2 / W) arctan(W d / (v_0 + v_1)), W^2 = slope / mass.
        """
        starts, forces, slopes = self.pieces / np.array([[1.0], [mass], [mass]])
        ends = np.append(starts[1:], math.inf)
        time, left = 0.0, speed**2
        for start, end, force, slope in zip(starts, ends, forces, slopes, strict=True):
            # root of left - 2 force d - slope d^2 = 0, written so that force or slope may be 0
            push = force + math.sqrt(force**2 + slope * left)
            turn = left / push if push else math.inf
            distance = min(end - start, turn)
            y = start + distance
            rest = left - distance * (2.0 * force + slope * distance) if turn > distance else 0.0
            speeds, root = math.sqrt(left) + math.sqrt(rest), math.sqrt(slope)
            time += 2.0 * (
                math.atan(root * distance / speeds) / root if root else distance / speeds
            )
            left = rest
            if left == 0.0:
                break
        return ContactSolution(2.0 * time, time, 1.0, y, float(self.force_at(y)))

    def per_unit_mass(self, mass: float) -> Self:
        return self.model_copy(update={"force": tuple(force / mass for force in self.force)})

    def strengths(self) -> tuple[float, ...]:
        return (*self.deflection, *self.force)

    def scaled(self, length: float, time: float) -> Self:
        deflection = tuple(y / length for y in self.deflection)
        force = tuple(push * time**2 / length for push in self.force)
        return self.model_copy(update={"deflection": deflection, "force": force})

    def in_series(self, compliance: float) -> Self:
        deeper = tuple(
            y + compliance * push for y, push in zip(self.deflection, self.force, strict=True)
        )
        return self.model_copy(update={"deflection": deeper})

    def in_words(self) -> str:
        tail = f" (source: {self.source})" if self.source else ""
        deepest, most = f"{1e3 * self.deflection[-1]:#.4g}".rstrip("."), self.force[-1]
        return f"force over deflection, {most:.4g} N at {deepest} mm{tail}"

    def compiled(self) -> NamedTuple:
        from stochvi.engine.impact_laws import ForceTable as Compiled

        return Compiled.of(self.pieces.T)

    def form(self) -> Form:
        return Form("pieces", np.ascontiguousarray(self.pieces.T))

    def knots(self) -> Vector:
        return np.asarray(self.pieces[0])

    @property
    def largest_force(self) -> float:
        return self.force[-1] if self.pieces[2, -1] == 0.0 else math.inf


def check_columns(unit: str | None, deflection: Sequence[float], force: Sequence[float]) -> None:
    """Raise `ValueError` where a table of deflection and force is none, or its force falls."""
    if unit is not None:
        raise ValueError("takes unit with a file only: deflection is in m, force in N")
    if len(deflection) != len(force):
        raise ValueError(
            f"needs as many entries in force as in deflection, got {len(force)} and "
            f"{len(deflection)}"
        )
    for one, two in pairwise(deflection):
        if one >= two:
            raise ValueError(f"needs increasing deflection, got {two:g} after {one:g}")
    for one, two in pairwise(force):
        if one > two:
            raise ValueError(f"needs force that never decreases, got {two:g} after {one:g}")


def with_columns(keys: Any) -> Any:
    """The keys with the numbers of the file or the values in their place, if these are given."""
    found = source_of(keys)
    if found is None:
        return keys
    key, source = found
    given = [name for name in ("deflection", "force") if keys.get(name) is not None]
    if given:
        raise ValueError(f"takes {key}, or deflection and force, got {key} and {given[0]}")
    given_unit = keys.get("unit")
    if given_unit is not None and given_unit not in tuple(COLUMN_UNITS):
        raise SceneError("unit", f"must be {CHOICES}, got {given_unit!r}")
    names = ("deflection", "force")
    with sentences_of(key):
        table = table_of(source, names)
        columns = all_columns(table, names)
    units = COLUMN_UNITS[given_unit] if given_unit else None
    deflection, force = si_columns(table, columns, ("length", "force"), units, CHOICES)
    kept = {name: value for name, value in keys.items() if name not in (key, "unit")}
    return (
        {"source": source.name}
        | kept
        | {
            "deflection": deflection.tolist(),
            "force": force.tolist(),
        }
    )


COLUMN_UNITS = {"m,N": ("m", "N"), "mm,N": ("mm", "N")}
"""Units of the columns of deflection and force by the text that names both in the key `unit`."""

CHOICES = " or ".join(repr(name) for name in COLUMN_UNITS)


# ------------------------------------------------------------------------------
# The contact of two round bodies.
# ------------------------------------------------------------------------------


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
        from stochvi.engine.impact_laws import Hertz as Compiled

        return Compiled(self.coefficient)

    def form(self) -> Form:
        return Form("hertz", np.array([[self.coefficient]]))

    @property
    def starts_as_root(self) -> bool:
        return True


# ------------------------------------------------------------------------------
# A force that grows as a power of the deflection, with a loss that does so too.
# ------------------------------------------------------------------------------


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
        from stochvi.engine.impact_laws import Power

        return Power(self.coefficient, self.exponent, self.loss, self._power)

    @property
    def starts_as_root(self) -> bool:
        """Whether the slope grows as a root; nearly so for powers from 1 to 2."""
        return math.modf(self.exponent)[0] != 0.0 and self.exponent < 2.0


# ------------------------------------------------------------------------------
# Numbers of a linear stop from what is known of its rubber: hardness, loss factor, restitution.
#
# The laws themselves follow below.
# ------------------------------------------------------------------------------


SOFTEST, HARDEST = 20.0, 80.0
"""Range of Shore A hardness in which Gent's relation is used; durometers resolve little outside."""

PAD = ("shore_a", "area", "thickness")
"""Keys of a rubber pad, from which its stiffness follows."""

DAMPING = ("damping_ratio", "loss_factor", "restitution")
"""Keys that state the energy loss of a stop; exactly one of them must be given."""

OF_RUBBER = ("elastic", "viscoelastic")
"""Kinds of laws whose numbers may follow from data of the rubber."""

AS_WRITTEN = {"as_written": True}
"""Context for pydantic's dump with which a law of rubber keeps the keys by which it was given."""


class RubberLaw(CompliantLaw):
    """A linear law whose numbers may be calculated from data of its rubber.

    It has the calculated numbers, and keeps the keys from which they were calculated.
    """

    _written: dict[str, Any] | None = PrivateAttr(default=None)

    @classmethod
    @abstractmethod
    def converted(cls, keys: Mapping[str, Any]) -> dict[str, Any]:
        """The keys of the law with its own numbers in place of the data of the rubber."""

    @model_validator(mode="wrap")
    @classmethod
    def _from_rubber(cls, keys: Any, handler: ModelWrapValidatorHandler[Self]) -> Self:
        if not isinstance(keys, dict):
            return handler(keys)
        numbers = cls.converted(keys)
        law = handler(numbers)
        if numbers != keys:
            law._written = {name: value for name, value in keys.items() if value is not None}
        return law

    @model_serializer(mode="wrap")
    def _keys(
        self, handler: SerializerFunctionWrapHandler, info: SerializationInfo
    ) -> dict[str, Any]:
        found: dict[str, Any] = handler(self)
        # the keys as written no longer hold for a copy with another stiffness
        if info.context == AS_WRITTEN and self._written and type(self)(**self._written) == self:
            return {"kind": found["kind"]} | self._written
        return found

    def __eq__(self, other: object) -> bool:
        """Two laws with the same numbers are equal, whatever keys they were given by."""
        return type(other) is type(self) and other.__dict__ == self.__dict__


def youngs_modulus(shore_a: float) -> float:
    """Young's modulus of rubber, Pa, from its Shore A hardness S,

        E = 0.0981 MPa (56 + 7.62336 S) / (0.137505 (254 - 2.54 S))

    (A. N. Gent, Rubber Chemistry and Technology 31 (1958) 896-906), for a spherical-ended indenter
    on an incompressible half-space. It is accurate to some 20 %.

    Examples
    --------
    >>> round(youngs_modulus(60.0) / 1e6, 2)
    3.61
    """
    if not SOFTEST <= shore_a <= HARDEST:
        raise ValueError(f"must be from {SOFTEST:g} to {HARDEST:g} Shore A, got {shore_a:g}")
    return 0.0981e6 * (56.0 + 7.62336 * shore_a) / (0.137505 * (254.0 - 2.54 * shore_a))


def with_stiffness(keys: Mapping[str, Any]) -> dict[str, Any]:
    """The keys of a law with the stiffness E area / thickness of a pad instead of the pad."""
    given = [name for name in PAD if name in keys]
    if not given:
        return dict(keys)
    if len(given) < len(PAD) or keys.get("stiffness") is not None:
        raise ValueError(
            "takes stiffness, or shore_a with area (m^2) and thickness (m), got "
            f"{', '.join([*given, *(['stiffness'] if keys.get('stiffness') is not None else [])])}"
        )
    hardness, area, thickness = (_positive(keys, name) for name in PAD)
    try:
        modulus = youngs_modulus(hardness)
    except ValueError as error:
        raise SceneError("shore_a", str(error)) from None
    stiffness = modulus * area / thickness
    conversion = (
        f"stiffness {stiffness:.4g} N/m of a pad of {1e4 * area:.4g} cm² and {1e3 * thickness:.4g} "
        f"mm, free to bulge, with E = {modulus / 1e6:.3g} MPa at {hardness:g} Shore A (Gent 1958, "
        "good to some 20 %)"
    )
    return _converted(keys, PAD, conversion) | {"stiffness": stiffness}


def with_damping_ratio(keys: Mapping[str, Any]) -> dict[str, Any]:
    """The keys of a law with the damping ratio that follows from a loss factor or restitution."""
    given = [name for name in DAMPING if keys.get(name) is not None]
    speed = keys.get("at_speed")
    if not given and speed is None:
        return dict(keys)  # the check of the law refuses a missing damping_ratio
    if len(given) != 1 or (speed is not None and given != ["restitution"]):
        also = ["at_speed"] if speed is not None else []
        raise ValueError(
            "needs exactly one of damping_ratio, loss_factor and restitution (which may say "
            f"at_speed, m/s), got {', '.join(given + also) or 'none'}"
        )
    if given == ["damping_ratio"]:
        return dict(keys)
    (name,) = given
    value = _positive(keys, name)
    if name == "loss_factor":
        ratio = value / 2.0
        conversion = (
            f"damping ratio {ratio:.4g}, half the loss factor {value:g} at the frequency of the "
            "contact, sqrt(stiffness / mass)"
        )
    else:
        try:
            ratio = damping_ratio_of(value)
        except ValueError as error:
            raise SceneError(name, str(error)) from None
        at = "" if speed is None else f", measured at {_positive(keys, 'at_speed'):g} m/s"
        conversion = (
            f"damping ratio {ratio:.4g}, at which a free mass has the restitution {value:g}{at}; "
            "this law has it at every speed"
        )
    return _converted(keys, (name, "at_speed"), conversion) | {"damping_ratio": ratio}


def _converted(
    keys: Mapping[str, Any], replaced: tuple[str, ...], conversion: str
) -> dict[str, Any]:
    """The keys without the replaced ones, and with the conversion added to `source`."""
    kept = {name: value for name, value in keys.items() if name not in replaced}
    before = f"{kept['source']}; " if kept.get("source") else ""
    return kept | {"source": before + conversion}


def _positive(keys: Mapping[str, Any], name: str) -> float:
    value = keys[name]
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise SceneError(name, f"must be a finite number, got {value!r}")
    if value <= 0.0:
        raise SceneError(name, f"must be greater than 0, got {value!r}")
    return float(value)


# ------------------------------------------------------------------------------
# Stops of rubber and steel: a linear spring, alone or with a parallel damper.
#
# The chapter before makes their numbers from hardness, loss factor or restitution.
# ------------------------------------------------------------------------------


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
        from stochvi.engine.impact_laws import Viscoelastic as Compiled

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
        from stochvi.engine.impact_laws import Viscoelastic as Compiled

        return Compiled(self.stiffness, self.damping(1.0))

    def form(self) -> Form:
        if self.conservative:
            return Form("pieces", np.array([[0.0, 0.0, self.stiffness]]))
        return Form("damped", np.array([[self.stiffness, self.damping(1.0)]]))
