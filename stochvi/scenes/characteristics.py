"""Springs and dampers that are functions, and switched drives, as a user writes them. Chapters:
base classes; Bouc-Wen hysteresis; Coulomb friction; Duffing; polynomials; Rayleigh; relaxation; the
switched drive; a force of one's own; tables; van der Pol; the types `Spring` and `Damper`."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Iterator, Sequence
from functools import cached_property
from typing import Annotated, Any, ClassVar, Literal, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike
from pydantic import BeforeValidator, Field, PrivateAttr, field_serializer, model_validator

from stochvi.mathematics.numerics import Vector, Waves, gauss_panels
from stochvi.results.errors import SceneError
from stochvi.scenes.frames import Values
from stochvi.scenes.impact_laws.compliant import check_columns, with_columns
from stochvi.scenes.relaxation import with_branches_of_file
from stochvi.scenes.validation import (
    Checked,
    Function,
    Matrix,
    NonNegative,
    Number,
    Numbers,
    OneOf,
    Positive,
    Tolerance,
    _name_of,
    arguments_fault,
    evaluated,
    integral_of,
    kind_of,
)

# ------------------------------------------------------------------------------
# Base classes of springs and dampers that are functions.
# ------------------------------------------------------------------------------


NODES, WEIGHTS = np.polynomial.hermite_e.hermegauss(64)
"""Nodes and weights of the rule of Gauss for a normal distribution of unit width."""

WEIGHTS = WEIGHTS / WEIGHTS.sum()

SLOPE_STEP = 1e-6
"""Step of the differences that give a slope, relative to the width over which it is sought."""

WIDEST = 4.0
"""Largest displacement, in standard deviations from the mean, whose stiffness limits the step."""


class LinearForm(NamedTuple):
    """The affine force f + k (x - mean) + c v in the place of a function.

    Parameters
    ----------
    force, stiffness, damping : f, N, k, N/m, and c, N s/m.
    """

    force: float
    stiffness: float
    damping: float


class Characteristic(Checked):
    """A spring or damper of a structure that is a function of its displacement and velocity.

    Its force adds to those of the linear stiffness and damping of the structure.

    Parameters
    ----------
    on
        Coordinate on which it acts, from the ground or the base; needed where there are several.
    between
        Two coordinates, instead: the displacement is that of the first less that of the second.
    axis
        Axis along which a mount of a box acts: "x", "y" or "z".
    """

    own: ClassVar[str] = "a force of your own is a SpringFunction"
    word: ClassVar[str] = "nonlinear"
    """Adjective of the kind in the effects of a scene."""
    is_damper: ClassVar[bool] = False
    sticks: ClassVar[bool] = False
    """Whether the force holds what is at rest, so that it jumps with the velocity."""
    remembers: ClassVar[bool] = False
    """Whether the force depends on the past."""
    drives: ClassVar[bool] = False
    """Whether the force keeps the structure in motion, which then settles by its own damping."""

    kind: Any
    on: str | None = None
    between: tuple[str, str] | None = None
    axis: Literal["x", "y", "z"] | None = None

    @abstractmethod
    def force_at(self, displacement: ArrayLike, velocity: ArrayLike = 0.0) -> Vector:
        """Force against displacements (m) and velocities (m/s), N."""

    @abstractmethod
    def compiled(self, mass: float) -> Any:
        """The part of kernels, a class of `engine.characteristics`, for forces per unit of a mass,
        kg."""

    @property
    @abstractmethod
    def strengths(self) -> Sequence[float]:
        """The numbers of the force, whose size is checked."""

    @property
    def needs(self) -> str:
        """What the force depends on: "displacement", "velocity" or "both"."""
        return "velocity" if self.is_damper else "displacement"

    @property
    def fastest(self) -> float:
        """Largest rate, 1/s, that the steps of a simulation must resolve whatever the motion."""
        return 0.0

    @property
    def effect(self) -> str:
        """What `explain` says of it."""
        return f"{self.word} {'damper' if self.is_damper else 'spring'}"

    def refusal(self, name: str) -> str:
        """What a method for linear structures says of it, of the name that it has there."""
        part = "damper" if self.is_damper else "spring"
        return (
            f"structure.{part} must be linear, got kind {self.kind!r} ({name}); simulate follows "
            "it, and sweep counts its impacts over clearances"
        )

    def potential_at(self, displacement: ArrayLike) -> Vector:
        """Energy at displacements, less that at 0, J; ValueError where there is none."""
        raise ValueError(f"a {self.effect} has no potential energy")

    def knots(self) -> Vector:
        """Displacements, m, between which the force is smooth; a spring with kinks must override
        this."""
        return np.zeros(0)

    def linear_form(self, mean: float, deviation: float, speed: float) -> LinearForm:
        """Statistical linearisation for independent normal displacement and velocity.

        f = E F, k = E F (x - mean) / deviation^2 and c = E F v / speed^2, by quadrature.

        Parameters
        ----------
        mean, deviation
            Of the displacement, m.
        speed
            Standard deviation of the velocity, m/s.
        """
        u, w = NODES, WEIGHTS
        x, v = mean + deviation * u, speed * u
        if self.needs == "displacement":
            force = self.force_at(x)
            return LinearForm(float(w @ force), float(w @ (force * u)) / deviation, 0.0)
        if self.needs == "velocity":
            force = self.force_at(np.full_like(v, mean), v)
            return LinearForm(float(w @ force), 0.0, float(w @ (force * u)) / speed)
        force = self.force_at(x[:, None], v[None, :])
        return LinearForm(
            float(w @ force @ w), float((w * u) @ force @ w) / deviation,
            float(w @ force @ (w * u)) / speed,
        )  # fmt: skip

    def time_of_throw(self, mass: float, distance: float) -> float:
        """Time, s, in which a force that drives moves a mass, kg, over a distance, m, or to where
        it reverses; infinite for all others."""
        return math.inf

    def moved_exactly(self, mean: float, deviation: float, speed: float) -> LinearForm:
        """The part of the force that a simulation moves exactly, as in `linear_form`; kicks do the
        rest."""
        return self.linear_form(mean, deviation, speed)

    def stiffest(self, mean: float, deviation: float) -> float:
        """Largest slope of the force over the displacement, N/m, within `WIDEST` deviations."""
        x = mean + WIDEST * deviation * np.linspace(-1.0, 1.0, 81)
        step = SLOPE_STEP * deviation
        slopes = (self.force_at(x + step) - self.force_at(x - step)) / (2.0 * step)
        return float(max(np.max(slopes), 0.0))

    def most_damping(self, mean: float, speed: float) -> float:
        """Largest slope of the force over the velocity, N s/m, within `WIDEST` deviations, where
        kicks of a simulation must resolve it; 0 where they are exact."""
        if self.needs == "displacement":
            return 0.0
        v, step = WIDEST * speed * np.linspace(-1.0, 1.0, 81), SLOPE_STEP * speed
        slopes = (self.force_at(mean, v + step) - self.force_at(mean, v - step)) / (2.0 * step)
        return float(np.max(np.abs(slopes)))


class SpringForce(Characteristic):
    """A spring whose force is a function of the displacement."""


class DamperForce(Characteristic):
    """A damper whose force is a function of the velocity."""

    is_damper: ClassVar[bool] = True

    def stiffest(self, mean: float, deviation: float) -> float:
        return 0.0


# ------------------------------------------------------------------------------
# Hysteresis of Bouc and Wen: wire rope, joints that slip, metal that yields.
# ------------------------------------------------------------------------------


class BoucWen(SpringForce):
    """A spring with hysteresis, F = stiffness length z, with the length the yield displacement.

    The memory z follows the displacement x,

        length dz/dx = 1 - (gamma + beta sign(z dx)) abs(z)^exponent,    gamma = 1 - beta,

    so that abs(z) stays below 1. The loop turns where the motion turns, whatever its speed. Beside
    a linear spring it is a wire-rope mount: stiff in small motions, soft in large ones.

    Parameters
    ----------
    stiffness
        Stiffness in small motions, N/m, which adds to that of the structure.
    yield_displacement
        Displacement at which the force of a straight line would reach its largest value, m.
    exponent
        How sharply the force bends; by default 1. A large one yields like metal.
    beta
        Share of the hysteresis, from above 0 to 1; by default 0.5. With 0.5 unloading begins with
        the full stiffness.
    on, between, axis
        Where it acts: on a coordinate or point, between two, or along an axis of the mounts of a
        box.

    See Also
    --------
    stochvi.scenes.Coulomb : Friction alone.

    Examples
    --------
    >>> rope = BoucWen(stiffness=1e4, yield_displacement=1e-3)
    >>> rope.largest_force
    10.0
    >>> [round(1e3 * rope.loop_loss(amplitude), 2) for amplitude in (1e-4, 1e-2)]
    [0.17, 349.9]
    """

    word: ClassVar[str] = "Bouc-Wen"
    remembers: ClassVar[bool] = True

    kind: Literal["bouc-wen"] = "bouc-wen"
    stiffness: Positive
    yield_displacement: Positive
    exponent: Annotated[Number, Field(ge=1, le=20)] = 1.0
    beta: Annotated[Number, Field(gt=0, le=1)] = 0.5

    @property
    def needs(self) -> str:
        return "both"

    @property
    def largest_force(self) -> float:
        """Largest force, N."""
        return self.stiffness * self.yield_displacement

    def force_at(self, displacement: ArrayLike, velocity: ArrayLike = 0.0) -> Vector:
        """Force on the first loading from rest, N; the force of later times depends on the past."""
        x = np.asarray(displacement, float)
        ways, branch = self.virgin_curve(float(np.max(np.abs(x), initial=0.0)))
        return np.asarray(self.largest_force * np.sign(x) * np.interp(np.abs(x), ways, branch))

    def virgin_curve(self, largest: float) -> tuple[Vector, Vector]:
        """Displacements from 0 to `largest`, m, and the memory z on the first loading."""
        ways = np.linspace(0.0, largest, LOOP_POINTS)
        return ways, self._along(0.0, ways)

    def _along(self, z: float, ways: Vector) -> Vector:
        """The memory along a way in the positive direction, m, by the method of Runge and Kutta."""
        n, beta, found = self.exponent, self.beta, [z]

        def slope(z: float) -> float:
            share = 1.0 if z > 0.0 else 1.0 - 2.0 * beta
            return float(1.0 - share * abs(z) ** n)

        for way in (np.diff(ways) / self.yield_displacement).tolist():
            count = math.ceil(way / LONGEST_WAY)
            step = way / max(count, 1)
            for _ in range(count):
                a = slope(z)
                b = slope(z + 0.5 * step * a)
                c = slope(z + 0.5 * step * b)
                z += step * (a + 2.0 * (b + c) + slope(z + step * c)) / 6.0
            found.append(z)
        return np.array(found)

    def loop_loss(self, amplitude: float) -> float:
        """Energy, J, that a cycle between -amplitude and amplitude (m) takes."""
        ways = np.linspace(-amplitude, amplitude, LOOP_POINTS)
        z = 0.0
        for _ in range(LOOPS):  # up and down are the same loop with the opposite sign
            z = -float(self._along(z, ways)[-1])
        branch = self._along(z, ways)
        area = float(np.sum((branch[1:] + branch[:-1]) / 2.0 * np.diff(ways)))
        return 2.0 * self.largest_force * area

    def linear_form(self, mean: float, deviation: float, speed: float) -> LinearForm:
        """The secant stiffness and the damper that take as much from a Gaussian motion, roughly:
        those of the loop of a cycle with the amplitude sqrt(2) deviation."""
        amplitude = math.sqrt(2.0) * deviation
        ways = np.linspace(-amplitude, amplitude, LOOP_POINTS)
        z = 0.0
        for _ in range(LOOPS):
            z = -float(self._along(z, ways)[-1])
        branch = self._along(z, ways)
        loss = float(np.sum((branch[1:] + branch[:-1]) / 2.0 * np.diff(ways)))
        # first harmonic of z over x = -a cos(t): in phase, and with the velocity
        phase = np.arccos(np.clip(-ways / amplitude, -1.0, 1.0))
        inner = branch * -np.cos(phase)
        secant = 2.0 / math.pi * float(np.sum((inner[1:] + inner[:-1]) / 2.0 * np.diff(phase)))
        frequency = speed / deviation
        stiffness = self.largest_force * secant / amplitude
        return LinearForm(
            0.0, stiffness, 2.0 * self.largest_force * loss / (math.pi * frequency * amplitude**2)
        )

    @property
    def widest_memory(self) -> float:
        """Standard deviation of a Gaussian memory whose mean of abs(z)^exponent is 1."""
        n = self.exponent
        moment = 2.0 ** (n / 2.0) * math.gamma((n + 1.0) / 2.0) / math.sqrt(math.pi)
        return float(moment ** (-1.0 / n))

    def wen_coefficients(
        self, speed: float, deviation: float, correlation: float
    ) -> tuple[float, float]:
        """Coefficients C, 1/m, and D, 1/s, of z' = C v + D z, statistically linearised in closed
        form (Wen, J. Appl. Mech. 47, 150, 1980).

        Parameters
        ----------
        speed, deviation, correlation
            Standard deviations of v, m/s, and of z, and their correlation.
        """
        n, length = self.exponent, self.yield_displacement
        lag = math.sqrt(1.0 - correlation**2)
        angles, weights = gauss_panels(np.array([math.atan2(lag, correlation), math.pi / 2.0]), 32)
        inner = 2.0 * float(weights @ np.sin(angles) ** n)
        odd = math.gamma(n / 2.0 + 1.0) * 2.0 ** (n / 2.0) / math.pi
        even = math.gamma((n + 1.0) / 2.0) * 2.0 ** (n / 2.0) / math.sqrt(math.pi)
        rate = n * speed / length * deviation ** (n - 1.0)
        gamma = 1.0 - self.beta
        with_v = 1.0 - deviation**n * (self.beta * odd * inner + gamma * even)
        with_z = self.beta * odd * (2.0 * lag ** (n + 1.0) / n + correlation * inner)
        return with_v / length, -rate * (with_z + gamma * even * correlation)

    def stiffest(self, mean: float, deviation: float) -> float:
        return self.stiffness

    def most_damping(self, mean: float, speed: float) -> float:
        return 0.0

    @property
    def strengths(self) -> Sequence[float]:
        return self.stiffness, self.yield_displacement

    def compiled(self, mass: float) -> Any:
        from stochvi.engine.characteristics import BoucWen as Compiled

        return Compiled(
            self.largest_force / mass, self.yield_displacement, self.exponent, self.beta
        )


LOOP_POINTS, LOOPS = 81, 8
"""Points of half a loop, and half loops after which it closes."""

LONGEST_WAY = 0.5
"""Longest step along a loop, in yield displacements."""


# ------------------------------------------------------------------------------
# Dry friction of Coulomb.
# ------------------------------------------------------------------------------


class Coulomb(DamperForce):
    """Dry friction: a force against the motion whose size does not depend on the velocity.

    Parameters
    ----------
    force
        Size of the force, N: the coefficient of friction times the normal force.
    on, between, axis
        Where it acts: on a coordinate or point, between two, or along an axis of the mounts of a
        box.

    See Also
    --------
    stochvi.scenes.BoucWen : Friction whose parts yield before they slip.

    Examples
    --------
    >>> Coulomb(force=0.3).force_at(0.0, [-2.0, 0.0, 0.1]).tolist()
    [-0.3, 0.0, 0.3]
    """

    word: ClassVar[str] = "Coulomb"
    sticks: ClassVar[bool] = True

    kind: Literal["coulomb"] = "coulomb"
    force: Positive

    def force_at(self, displacement: ArrayLike, velocity: ArrayLike = 0.0) -> Vector:
        _, v = np.broadcast_arrays(displacement, np.asarray(velocity, float))
        return np.asarray(self.force * np.sign(v))

    def linear_form(self, mean: float, deviation: float, speed: float) -> LinearForm:
        return LinearForm(0.0, 0.0, math.sqrt(2.0 / math.pi) * self.force / speed)

    def most_damping(self, mean: float, speed: float) -> float:
        return 0.0

    @property
    def strengths(self) -> Sequence[float]:
        return (self.force,)

    def compiled(self, mass: float) -> Any:
        from stochvi.engine.characteristics import Coulomb as Compiled

        return Compiled(self.force / mass)


# ------------------------------------------------------------------------------
# The spring of Duffing, whose force has a cubic term.
# ------------------------------------------------------------------------------


class Duffing(SpringForce):
    """A spring of the force F = linear_stiffness x + cubic_stiffness x^3.

    Parameters
    ----------
    cubic_stiffness
        Stiffness of the cubic term, N/m^3.
    linear_stiffness
        Stiffness at x = 0 beside that of the structure, N/m; by default 0. One below 0 makes two
        wells where it outweighs that of the structure.
    on, between, axis
        Where it acts: on a coordinate or point, between two, or along an axis of the mounts of a
        box.

    See Also
    --------
    stochvi.scenes.PolynomialSpring : Any other power.
    stochvi.scenes.SpringTable : A measured force.

    Examples
    --------
    >>> Duffing(cubic_stiffness=2.0).force_at([-1.0, 0.5]).tolist()
    [-2.0, 0.25]
    """

    word: ClassVar[str] = "Duffing"

    kind: Literal["duffing"] = "duffing"
    cubic_stiffness: Positive
    linear_stiffness: Number = 0.0

    def force_at(self, displacement: ArrayLike, velocity: ArrayLike = 0.0) -> Vector:
        x = np.asarray(displacement, float)
        return np.asarray((self.linear_stiffness + self.cubic_stiffness * x**2) * x)

    def potential_at(self, displacement: ArrayLike) -> Vector:
        square = np.asarray(displacement, float) ** 2
        return np.asarray(
            (self.linear_stiffness / 2.0 + self.cubic_stiffness / 4.0 * square) * square
        )

    @property
    def strengths(self) -> Sequence[float]:
        return self.linear_stiffness, self.cubic_stiffness

    def compiled(self, mass: float) -> Any:
        from stochvi.engine.characteristics import PolynomialSpring

        terms = np.array([self.linear_stiffness, 0.0, self.cubic_stiffness])
        return PolynomialSpring.of(terms / mass)


# ------------------------------------------------------------------------------
# Springs and dampers whose forces are polynomials.
# ------------------------------------------------------------------------------


class PolynomialSpring(SpringForce):
    """A spring of the force F = a_1 x + a_2 x^2 + ... + a_n x^n.

    Parameters
    ----------
    coefficients
        a_1, ..., a_n, N/m, N/m^2 and so on. The last one belongs to an odd power and is positive,
        so that the spring holds the mass on both sides.
    on, between, axis
        Where it acts: on a coordinate or point, between two, or along an axis of the mounts of a
        box.

    See Also
    --------
    stochvi.scenes.Duffing : With a cubic term alone.

    Examples
    --------
    >>> PolynomialSpring(coefficients=[1.0, -0.5, 0.25]).force_at(2.0).item()
    2.0
    """

    word: ClassVar[str] = "polynomial"

    kind: Literal["polynomial"] = "polynomial"
    coefficients: Numbers

    @model_validator(mode="after")
    def _holds(self) -> Self:
        if len(self.coefficients) % 2 == 0 or not self.coefficients[-1] > 0.0:
            raise ValueError(
                "needs coefficients that end with an odd power whose coefficient is positive, so "
                f"that the spring holds the mass, got {list(self.coefficients)}; append a small one"
            )
        return self

    def force_at(self, displacement: ArrayLike, velocity: ArrayLike = 0.0) -> Vector:
        return np.asarray(
            np.polyval([*self.coefficients[::-1], 0.0], np.asarray(displacement, float))
        )

    def potential_at(self, displacement: ArrayLike) -> Vector:
        terms = [a / (k + 2) for k, a in enumerate(self.coefficients)]
        return np.asarray(np.polyval([*terms[::-1], 0.0, 0.0], np.asarray(displacement, float)))

    @property
    def strengths(self) -> Sequence[float]:
        return self.coefficients

    def compiled(self, mass: float) -> Any:
        from stochvi.engine.characteristics import PolynomialSpring as Compiled

        return Compiled.of(np.array(self.coefficients) / mass)


class PolynomialDamper(DamperForce):
    """A damper of the force F = (c_1 + c_2 abs(v) + ... + c_n abs(v)^(n-1)) v.

    Parameters
    ----------
    coefficients
        c_1, ..., c_n, N s/m, N s^2/m^2 and so on; the last one is positive. The second one is the
        drag of a fluid.
    on, between, axis
        Where it acts: on a coordinate or point, between two, or along an axis of the mounts of a
        box.

    See Also
    --------
    stochvi.scenes.Rayleigh : With a cubic term, and negative damping at small speeds.

    Examples
    --------
    >>> PolynomialDamper(coefficients=[0.1, 2.0]).force_at(0.0, [-1.0, 2.0]).tolist()
    [-2.1, 8.2]
    """

    word: ClassVar[str] = "polynomial"

    kind: Literal["polynomial"] = "polynomial"
    coefficients: Numbers

    @model_validator(mode="after")
    def _brakes(self) -> Self:
        if not self.coefficients or not self.coefficients[-1] > 0.0:
            raise ValueError(
                "needs coefficients whose last one is positive, so that the damper takes energy, "
                f"got {list(self.coefficients)}"
            )
        return self

    def force_at(self, displacement: ArrayLike, velocity: ArrayLike = 0.0) -> Vector:
        _, v = np.broadcast_arrays(displacement, np.asarray(velocity, float))
        return np.asarray(np.polyval(self.coefficients[::-1], np.abs(v)) * v)

    @property
    def strengths(self) -> Sequence[float]:
        return self.coefficients

    def compiled(self, mass: float) -> Any:
        from stochvi.engine.characteristics import PolynomialDamper as Compiled

        return Compiled.of(np.array(self.coefficients) / mass)


# ------------------------------------------------------------------------------
# The damper of Rayleigh, which may excite small motions.
# ------------------------------------------------------------------------------


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
        from stochvi.engine.characteristics import Rayleigh as Compiled

        return Compiled(self.linear_damping / mass, self.cubic_damping / mass)


# ------------------------------------------------------------------------------
# Rubber: a spring whose stiffness and loss depend on the frequency.
# ------------------------------------------------------------------------------


class RelaxationSpring(SpringForce):
    """A linear spring beside branches that relax, as of rubber (Maxwell, Zener, Prony).

    Each branch is a spring of stiffness k_i behind a damper k_i tau_i. At the rate v of the
    displacement x

        F = stiffness x + sum r_i,    r_i' = k_i v - r_i / tau_i,

    so that the dynamic stiffness is stiffness + sum k_i i w tau_i / (1 + i w tau_i).

    Parameters
    ----------
    stiffness
        Static stiffness, N/m, which adds to that of the structure.
    branches
        Stiffness k_i, N/m, and relaxation time tau_i, s, of each branch.
    file, values
        Instead of the two: a file of the columns frequency_hz, dynamic_stiffness and loss_factor,
        or in Python a frame of them. The dynamic stiffness, N/m, is the size of the complex one.
        Branches follow it by non-negative least squares.
    error
        Relative error of the dynamic stiffness, which the stated bias of answers contains; with a
        file the error to which it is followed, by default 0.01.
    source
        Where the numbers come from; by default the name of the file from which they were read.
    on, between, axis
        Where it acts: on a coordinate or point, between two, or along an axis of the mounts of a
        box.

    See Also
    --------
    stochvi.scenes.BoucWen : Hysteresis, which depends on the amplitude.

    Examples
    --------
    >>> rubber = RelaxationSpring(stiffness=2e5, branches=[[5e4, 0.01]])
    >>> [f"{abs(each):.0f}" for each in rubber.dynamic_stiffness([0.0, 15.915494, 1e6])]
    ['200000', '226385', '250000']
    """

    word: ClassVar[str] = "relaxing"

    kind: Literal["relaxation"] = "relaxation"
    stiffness: NonNegative
    branches: Matrix = ()
    file: str | None = None
    values: Values | None = None
    error: Tolerance = 0.0
    source: str | None = None

    @model_validator(mode="before")
    @classmethod
    def _from_file(cls, keys: Any) -> Any:
        return with_branches_of_file(keys)

    @model_validator(mode="after")
    def _relaxes(self) -> Self:
        for number, branch in enumerate(self.branches, 1):
            if len(branch) != 2 or branch[0] < 0.0 or branch[1] <= 0.0:
                raise ValueError(
                    "needs branches of a stiffness of at least 0 (N/m) and a relaxation time above "
                    f"0 (s), got {list(branch)} as branch {number}"
                )
        return self

    def dynamic_stiffness(self, frequency_hz: ArrayLike) -> Waves:
        """Complex dynamic stiffness at frequencies, N/m."""
        turns = 2j * math.pi * np.asarray(frequency_hz, float)
        relaxing = (k * turns * time / (1.0 + turns * time) for k, time in self.branches)
        return np.asarray(sum(relaxing, self.stiffness + 0.0 * turns))

    def force_at(self, displacement: ArrayLike, velocity: ArrayLike = 0.0) -> Vector:
        """Static force, N; that of the branches depends on the past."""
        return self.stiffness * np.asarray(displacement, float)

    def potential_at(self, displacement: ArrayLike) -> Vector:
        return np.asarray(0.5 * self.stiffness * np.asarray(displacement, float) ** 2)

    @property
    def strengths(self) -> Sequence[float]:
        return self.stiffness, *(number for branch in self.branches for number in branch)

    def compiled(self, mass: float) -> Any:
        """The static spring; branches are states of the flow, and no function of kernels."""
        from stochvi.engine.characteristics import PolynomialSpring

        return PolynomialSpring.of(np.array([self.stiffness / mass]))


# ------------------------------------------------------------------------------
# A drive that switches by the motion.
# ------------------------------------------------------------------------------


class Relay(DamperForce):
    """A drive of constant size that pushes along the motion, F = -force sign(v) (B 12.3).

    It takes a mass from stop to stop. With `reverses_above` it pushes back where the mass has
    passed that displacement on its way up, and until it turns: a striker is then thrown off a stop
    below and back onto it (B 19.11). `reverses_below` is the same on the way down.

    Parameters
    ----------
    force
        Size of the force, N.
    reverses_above, reverses_below
        Displacements, m, beyond which the force is against the motion that goes on.
    delay
        Time, s, for which another direction has to be wanted until the relay switches (B 20.3).
    on, between, axis
        Where it acts: on a coordinate or point, between two, or along an axis of the mounts of a
        box.

    See Also
    --------
    stochvi.methods.periodic.RelayBetweenStops : Its motion between two stops.
    stochvi.methods.periodic.SwitchedDrive : The striker that reverses.

    Examples
    --------
    >>> Relay(force=0.3, reverses_above=0.5).force_at([0.0, 1.0], 0.2).tolist()
    [-0.3, 0.3]
    """

    word: ClassVar[str] = "relay"
    sticks: ClassVar[bool] = True
    drives: ClassVar[bool] = True

    kind: Literal["relay"] = "relay"
    force: Positive
    reverses_above: Number | None = None
    reverses_below: Number | None = None
    delay: NonNegative = 0.0

    @model_validator(mode="after")
    def _apart(self) -> Self:
        below, above = self._places
        if not below < above:
            raise ValueError(
                f"needs reverses_below under reverses_above, got {below:g} and {above:g}"
            )
        return self

    @property
    def _places(self) -> tuple[float, float]:
        """Displacements below and above which the force is against the motion, m."""
        low, high = self.reverses_below, self.reverses_above
        return -math.inf if low is None else low, math.inf if high is None else high

    @property
    def remembers(self) -> bool:  # type: ignore[override]
        """Whether it switches with a delay."""
        return self.delay > 0.0

    @property
    def needs(self) -> str:
        reverses = self.reverses_above is not None or self.reverses_below is not None
        return "both" if reverses or self.remembers else "velocity"

    @property
    def effect(self) -> str:
        return f"drive by a relay{' with a delay' if self.remembers else ''}"

    @property
    def fastest(self) -> float:
        return 1.0 / self.delay if self.delay else 0.0

    def force_at(self, displacement: ArrayLike, velocity: ArrayLike = 0.0) -> Vector:
        """Force against displacements (m) and velocities (m/s), N, without the delay."""
        x, v = np.broadcast_arrays(np.asarray(displacement, float), np.asarray(velocity, float))
        low, high = self._places
        up = np.where(x < high, -self.force, self.force)
        return np.asarray(np.where(v >= 0.0, up, np.where(x > low, self.force, -self.force)))

    def linear_form(self, mean: float, deviation: float, speed: float) -> LinearForm:
        from scipy.special import ndtr

        low, high = ((place - mean) / deviation for place in self._places)
        beyond = float(ndtr(-high)), float(ndtr(low))
        densities = sum(math.exp(-(u**2) / 2.0) for u in (low, high)) / math.sqrt(2.0 * math.pi)
        return LinearForm(
            self.force * (beyond[0] - beyond[1]), self.force * densities / deviation,
            -math.sqrt(2.0 / math.pi) * self.force * (1.0 - sum(beyond)) / speed,
        )  # fmt: skip

    def moved_exactly(self, mean: float, deviation: float, speed: float) -> LinearForm:
        # where it reverses, the motion is as wide as the drive makes it, whatever the noise
        if reach := self._reach(mean):
            wide = self.linear_form(mean, max(deviation, reach), speed)
            return LinearForm(0.0, wide.stiffness, 0.0)
        return self.linear_form(mean, deviation, speed)

    def _reach(self, mean: float) -> float:
        """Distance from a displacement to the nearest place where it reverses, m; 0 for none."""
        distances = [abs(place - mean) for place in self._places if math.isfinite(place)]
        return min(distances, default=0.0)

    def stiffest(self, mean: float, deviation: float) -> float:
        return 0.0

    def most_damping(self, mean: float, speed: float) -> float:
        return 0.0

    def time_of_throw(self, mass: float, distance: float) -> float:
        places = [abs(place) for place in self._places if math.isfinite(place) and place]
        return math.sqrt(2.0 * mass * min([distance, *places]) / self.force)

    @property
    def strengths(self) -> Sequence[float]:
        return (self.force,)

    def compiled(self, mass: float) -> Any:
        from stochvi.engine.characteristics import LateRelay
        from stochvi.engine.characteristics import Relay as Compiled

        low, high = self._places
        if self.remembers:
            return LateRelay(self.force / mass, high, low, self.delay)
        return Compiled(self.force / mass, high, low)


# ------------------------------------------------------------------------------
# A spring, with or without damping, whose force is a function of one's own.
# ------------------------------------------------------------------------------


SAMPLES = np.concatenate([-np.geomspace(1e-6, 1e-2, 9)[::-1], [0.0], np.geomspace(1e-6, 1e-2, 9)])
"""Displacements (m) and velocities (m/s) at which a force is checked."""


class SpringFunction(SpringForce):
    """A force of one's own, any function of the displacement and of the velocity.

    A function cannot be written in a scene file: this spring is for Python only. `simulate`
    compiles it. Answers, provenance and documents name the function, with a digest of its
    instructions and of the values that it uses. A checkpoint of another function is not gone on
    with. Another process finds the function by its name, in a module that it can import.

    Parameters
    ----------
    force
        Force against the displacement, N, a function (displacement, velocity) of two numbers in m
        and m/s: plain Python with `math`, or compiled by numba.
    energy
        Energy at a displacement, J, a function of one number, for a force that does not depend on
        the velocity; by quadrature of the force where it is not given.
    on, between, axis
        Where it acts: on a coordinate or point, between two, or along an axis of the mounts of a
        box.

    Raises
    ------
    SceneError
        If the function does not give a finite number.

    See Also
    --------
    stochvi.scenes.SpringTable : A measured force over the displacement.
    stochvi.ForceFunction : The same at a stop.

    Examples
    --------
    >>> rubber = SpringFunction(force=lambda x, v: 1e4 * x + 1e8 * x**3 + 20.0 * v)
    >>> rubber.force_at([0.0, 0.01], 0.1).tolist()
    [2.0, 202.0]
    """

    word: ClassVar[str] = "function"

    kind: Literal["function"] = "function"
    force: Function
    energy: Function | None = None
    _contents: str = PrivateAttr(default="")
    """Digest of the instructions of the functions and of the values that they use."""

    @model_validator(mode="after")
    def _gives_numbers(self) -> Self:
        from stochvi.engine.impact_laws import contents_of

        if fault := arguments_fault(self.force):
            raise ValueError(
                f"needs force that takes a displacement (m) and a velocity (m/s), got {fault}"
            )
        try:
            values = self.force_at(SAMPLES, SAMPLES[::-1])
        except Exception as error:
            raise ValueError(
                "needs force that takes a displacement (m) and a velocity (m/s) and returns a "
                f"number, got {type(error).__name__}: {error}"
            ) from None
        if not np.isfinite(values).all():
            place = float(SAMPLES[~np.isfinite(values)][0])
            raise ValueError(f"needs force that is a finite number, got none at {place:g} m")
        functions = [each for each in (self.force, self.energy) if each is not None]
        self._contents = contents_of(functions)
        return self

    @field_serializer("force")
    def _named(self, function: Any) -> str:
        return f"{_name_of(function)} ({self._contents[:16]})"

    @cached_property
    def needs(self) -> str:
        """Whether the force depends on the velocity, at all that are checked."""
        x, v = np.meshgrid(SAMPLES, SAMPLES)
        same = np.array_equal(self.force_at(x, v), self.force_at(x))
        return "displacement" if same else "both"

    def force_at(self, displacement: ArrayLike, velocity: ArrayLike = 0.0) -> Vector:
        x, v = np.broadcast_arrays(displacement, np.asarray(velocity, float))
        places = zip(x.ravel().tolist(), v.ravel().tolist(), strict=True)
        found = [float(self.force(float(one), float(two))) for one, two in places]
        return np.array(found, float).reshape(x.shape)

    def potential_at(self, displacement: ArrayLike) -> Vector:
        if self.needs != "displacement":
            return super().potential_at(displacement)
        x = np.asarray(displacement, float)
        if self.energy is None:
            return integral_of(self.force_at, x)
        energy = self.energy
        found = evaluated(np.vectorize(lambda one: float(energy(one)), otypes=[float]), x.ravel())
        return np.asarray(found - float(energy(0.0))).reshape(x.shape)

    @property
    def strengths(self) -> Sequence[float]:
        return ()

    def compiled(self, mass: float) -> Any:
        from stochvi.engine.characteristics import part_of
        from stochvi.engine.impact_laws import NotCompiled

        try:
            kind = part_of(self.force, self.needs == "both")
        except NotCompiled as error:
            raise SceneError(
                f"spring.force must be a function that numba compiles, got {_name_of(self.force)}: "
                f"{error}; write it with numbers, `if` and `math`, or compile it with numba.njit"
            ) from None
        return kind(1.0 / mass)


# ------------------------------------------------------------------------------
# A measured force over the displacement of a spring.
# ------------------------------------------------------------------------------


class SpringTable(SpringForce):
    """A measured force over the displacement, linear between its points.

    Beyond the first and the last point the force continues with the slope of the piece there. A
    table that begins at the displacement 0 holds for both directions.

    Parameters
    ----------
    deflection
        Displacements of the spring, rising, m.
    force
        Never falling, N, and rising in the first and the last piece.
    file, values, unit
        Instead of the two: a file of two columns, or in Python a Series, frame or array of them,
        and their units, "m,N" or "mm,N". The units may also stand in the headings of the columns,
        in any spelling.
    source
        Where the numbers come from; by default the name of the file from which they were read.
    on, between, axis
        Where it acts: on a coordinate or point, between two, or along an axis of the mounts of a
        box.

    See Also
    --------
    stochvi.scenes.Duffing : A spring with a cubic term.
    stochvi.ForceTable : The force of a stop.

    Examples
    --------
    >>> spring = SpringTable(deflection=[0.0, 0.01, 0.02], force=[0.0, 1.0, 4.0])
    >>> spring.force_at([-0.015, 0.005, 0.03]).round(12).tolist()
    [-2.5, 0.5, 7.0]
    """

    word: ClassVar[str] = "tabulated"

    kind: Literal["table"] = "table"
    deflection: Numbers
    force: Numbers
    file: str | None = None
    values: Values | None = None
    unit: Literal["m,N", "mm,N"] | None = None
    source: str | None = None

    @model_validator(mode="before")
    @classmethod
    def _from_file(cls, keys: Any) -> Any:
        return with_columns(keys)

    @model_validator(mode="after")
    def _rises(self) -> Self:
        x, force = self.deflection, self.force
        check_columns(self.unit, x, force)
        if len(x) < 2:
            raise ValueError(f"needs at least two points, got {len(x)}")
        if force[0] == force[1] or force[-1] == force[-2]:
            raise ValueError(
                "needs force that rises in the first and the last piece, so that the spring holds "
                f"the mass, got {force[0]:g} to {force[1]:g} and {force[-2]:g} to {force[-1]:g}"
            )
        if x[0] == 0.0 and force[0] != 0.0:
            raise ValueError(
                f"needs force 0 at the deflection 0 where it begins there, got {force[0]:g}"
            )
        return self

    @property
    def points(self) -> tuple[Vector, Vector]:
        """Displacements (m) and forces (N) in both directions."""
        x, force = np.array(self.deflection), np.array(self.force)
        if x[0] == 0.0:
            x, force = np.concatenate([-x[:0:-1], x]), np.concatenate([-force[:0:-1], force])
        return x, force

    def _piece(self, displacement: ArrayLike) -> tuple[Any, Vector, Vector, Vector, Vector]:
        """Displacements and forces of the table, slopes of its pieces, the piece of each
        displacement, and the way into it."""
        x, force = self.points
        slopes = np.diff(force) / np.diff(x)
        place = np.asarray(displacement, float)
        piece = np.clip(np.searchsorted(x, place, side="right") - 1, 0, len(slopes) - 1)
        return piece, x, force, slopes, place - x[piece]

    def force_at(self, displacement: ArrayLike, velocity: ArrayLike = 0.0) -> Vector:
        piece, _, force, slopes, into = self._piece(displacement)
        return np.asarray(force[piece] + slopes[piece] * into)

    def potential_at(self, displacement: ArrayLike) -> Vector:
        piece, x, force, slopes, into = self._piece(np.append(np.ravel(displacement), 0.0))
        starts = np.concatenate([[0.0], np.cumsum(np.diff(x) * (force[1:] + force[:-1]) / 2.0)])
        energy = starts[piece] + into * (force[piece] + 0.5 * slopes[piece] * into)
        return np.asarray((energy[:-1] - energy[-1]).reshape(np.shape(displacement)))

    def knots(self) -> Vector:
        return self.points[0]

    @property
    def strengths(self) -> Sequence[float]:
        return *self.deflection, *self.force

    def compiled(self, mass: float) -> Any:
        from stochvi.engine.characteristics import SpringTable as Compiled

        x, force = self.points
        return Compiled.of(x, force / mass)


# ------------------------------------------------------------------------------
# The damper of van der Pol, which excites small displacements.
# ------------------------------------------------------------------------------


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
        from stochvi.engine.characteristics import VanDerPol as Compiled

        return Compiled(self.damping / mass, self.amplitude)


# ------------------------------------------------------------------------------
# Springs and dampers that are functions. Each kind is a class, which `Spring` and `Damper` find
# there.
# ------------------------------------------------------------------------------


__all__ = [
    "BoucWen",
    "Characteristic",
    "Coulomb",
    "Damper",
    "Duffing",
    "PolynomialDamper",
    "PolynomialSpring",
    "Rayleigh",
    "RelaxationSpring",
    "Relay",
    "Spring",
    "SpringFunction",
    "SpringTable",
    "VanDerPol",
]


def _kinds(base: type[Characteristic]) -> Iterator[type[Characteristic]]:
    """Every class that says its kind."""
    for each in base.__subclasses__():
        yield from _kinds(each)
        if kind_of(each) is not None:
            yield each


def _listed(value: Any) -> Any:
    """One part as a list of one; a plain function as a `SpringFunction`."""
    values = value if isinstance(value, list | tuple) else [value]
    return tuple(SpringFunction(force=each) if callable(each) else each for each in values)


Spring = Annotated[
    tuple[Annotated[SpringForce, OneOf(_kinds(SpringForce), "laws", (SpringForce,))], ...],
    BeforeValidator(_listed), Field(min_length=1),
]  # fmt: skip
"""Springs that are functions: one of them, or a list."""

Damper = Annotated[
    tuple[Annotated[DamperForce, OneOf(_kinds(DamperForce), "laws", (DamperForce,))], ...],
    BeforeValidator(_listed), Field(min_length=1),
]  # fmt: skip
"""Dampers that are functions: one of them, or a list."""
