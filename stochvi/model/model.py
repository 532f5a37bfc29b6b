"""The model of a scene: the numbers that every method reads, in SI units, lowered once. Chapters:
the model; why a structure has no stationary state, and the remedy."""

from __future__ import annotations

import cmath
import math
import shlex
import weakref
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple, TypeGuard, assert_never

import numpy as np
import scipy
from numpy.typing import ArrayLike

from stochvi.mathematics.numerics import Matrix, Vector
from stochvi.mathematics.spectra import Filter, Force, InputMatrix, Table
from stochvi.mathematics.unsteady_noise import FastPeaks, RandomLevel
from stochvi.model.modal import Branch, ModalForm, bias_of_stiffness, modal_form
from stochvi.results.errors import SceneError
from stochvi.scenes.characteristics import Characteristic, RelaxationSpring
from stochvi.scenes.excitations import (
    BASE,
    ConstantLoad,
    DensityNoise,
    DrawnExcitation,
    Excitation,
    FilteredNoise,
    Modulation,
    Pulses,
    RecordedNoise,
    Sine,
    WhiteNoise,
)
from stochvi.scenes.forces import (
    DrawnForce,
    ModulatedForce,
    changed_by,
    independent_sources,
    white_correlations,
)
from stochvi.scenes.impact_laws import (
    CompliantLaw,
    Law,
    Restitution,
    RigidLaw,
)
from stochvi.scenes.scene import ImpactPair, Scene, without_drift
from stochvi.scenes.structures import NonlinearOscillator
from stochvi.scenes.structures.oscillators import Placed
from stochvi.scenes.structures.rigid_body import rows_at

PerUnitMass = Callable[[ArrayLike], Vector]
"""A force per unit mass (m/s^2), or an energy (m^2/s^2), as a function of x (m) or v (m/s)."""

LOWER, UPPER = -1, 1
"""The side of a stop: the direction in which the gap moves towards it."""


@dataclass(frozen=True)
class Stop:
    """A stop that a gap can meet.

    Parameters
    ----------
    side
        `UPPER` (+1) or `LOWER` (-1). `side * y` grows towards the stop, so that a lower stop is an
        upper one seen from the other side.
    position
        Where the gap y meets the stop, m from the position of the unloaded springs.
    law
        Impact law of the stop, for forces in newtons; of `Model.lower` and `Model.upper`, for
        forces per unit mass.

    Examples
    --------
    >>> from stochvi.scenes.impact_laws import Restitution
    >>> stop = Stop(LOWER, -2.0, Restitution(coefficient=0.8))
    >>> stop.name, stop.distance, float(stop.deflection(-2.5))
    ('lower', 2.0, 0.5)
    """

    side: int
    position: float
    law: Law

    @property
    def name(self) -> str:
        """Name of the side of the stop, "lower" or "upper"."""
        return "upper" if self.side > 0 else "lower"

    @property
    def distance(self) -> float:
        """Distance of the stop from y = 0 towards its own side, m; below 0 for a preload."""
        return self.side * self.position

    @property
    def rigid(self) -> bool:
        """Whether the stop is rigid."""
        return self.law.rigid

    @property
    def coefficient(self) -> float | None:
        """R of a rigid stop whose restitution is one number; None for any other stop."""
        constant = isinstance(self.law, Restitution) and not self.scattered
        return self.law.restitution if constant else None

    @property
    def summed(self) -> bool:
        """Whether impulses and losses of impacts are summed one by one; those of a restitution that
        does not depend on the speed follow from F1 and F2."""
        return not isinstance(self.law, Restitution)

    @property
    def scattered(self) -> bool:
        """Whether the restitution is drawn at each impact."""
        return isinstance(self.law, Restitution) and self.law.scatter is not None

    def deflection(self, y: ArrayLike) -> Vector:
        """How far the gap y (m) lies beyond the stop, m; below 0 where it is clear of it."""
        return np.asarray(self.side * (np.asarray(y, dtype=float) - self.position))

    def restitution_at(self, speed: ArrayLike) -> Vector:
        """Restitution of impacts at incident speeds (m/s); its mean where it scatters."""
        if isinstance(self.law, RigidLaw):
            return self.law.restitution_at(speed)
        return np.full(np.shape(speed), self.law.restitution)

    @property
    def slow_impacts_see(self) -> str:
        """The restitution of slow impacts, in words."""
        words = f"restitution {self.law.slow_restitution:.4g}"
        return f"{words} (of slow impacts, as it scatters)" if self.scattered else words

    def restitution_square_at(self, speed: ArrayLike) -> Vector:
        """Mean square restitution of impacts at incident speeds (m/s)."""
        if self.scattered:
            return np.full(np.shape(speed), self.law.restitution_mean_square)
        return np.asarray(self.restitution_at(speed) ** 2)

    def per_unit_mass(self, mass: float) -> Stop:
        """The same stop with its forces divided by a mass, kg."""
        return Stop(self.side, self.position, self.law.per_unit_mass(mass))


class Movement(NamedTuple):
    """How a relative change moves the stops of a pair: by `way`, m, per unit of it.

    The change is the signal of that number of the model, or the one of `sampled_modulations`.
    """

    way: float
    signal: int | None
    sample: int | None


@dataclass(frozen=True, eq=False)
class Pair:
    """An impact pair: the gap y = direction . q (m), and the one or two stops that it can meet.

    `mass` is the reduced mass 1 / (direction . M^-1 direction), kg. `relative` says whether the gap
    is a combination of coordinates: the difference of two, or the motion of a place of a body.
    `moved` holds what moves its stops.
    `tangent` (n,) is the row of the motion along its stops, where they rub, else None.
    """

    name: str
    direction: Vector
    mass: float
    relative: bool
    stops: tuple[Stop, ...]
    moved: tuple[Movement, ...] = ()
    tangent: Vector | None = None

    @property
    def lower(self) -> Stop | None:
        """The lower stop, if there is one."""
        return next((stop for stop in self.stops if stop.side == LOWER), None)

    @property
    def upper(self) -> Stop | None:
        """The upper stop, if there is one."""
        return next((stop for stop in self.stops if stop.side == UPPER), None)

    @property
    def play(self) -> float | None:
        """Distance between the two stops, m; None for a pair with one stop."""
        if self.lower is None or self.upper is None:
            return None
        return self.upper.position - self.lower.position

    @property
    def rigid(self) -> bool:
        """Whether no stop is compliant."""
        return all(stop.rigid for stop in self.stops)

    def force(self, gap: ArrayLike, rate: ArrayLike) -> Vector:
        """Force on the compliant stops, N, positive on the upper one; 0 on rigid ones.

        Parameters
        ----------
        gap, rate
            The gap y, m, and its rate, m/s, of one shape.
        """
        total = np.zeros(np.shape(gap))
        for stop in self.stops:
            if isinstance(stop.law, CompliantLaw):
                rates = stop.side * np.asarray(rate)
                force = stop.law.force_at(stop.deflection(gap), rates, self.mass)
                total += stop.side * force
        return total


@dataclass(frozen=True, eq=False)
class FunctionOfMotion:
    """A spring or damper that is a function of the displacement y = direction . q (m) and its rate.

    Its force, N, is `count` times that of the `law`. `mass` is the reduced mass
    1 / (direction . M^-1 direction), kg. A part k y + c y' + f of the force may be in the matrices
    and constant forces of the model; `affine` holds k, c and f per unit of the reduced mass.
    A modulation follows the `signal` of that number of the model, or the `sample` of its
    `sampled_modulations`.
    """

    name: str
    direction: Vector
    mass: float
    law: Characteristic
    count: int = 1
    affine: tuple[float, float, float] = (0.0, 0.0, 0.0)
    signal: int | None = None
    sample: int | None = None

    @property
    def modulation(self) -> Modulation | None:
        """What modulates a spring or a damper; None for a function of the motion."""
        return self.law.modulation if isinstance(self.law, ModulatedForce) else None

    @property
    def drawn(self) -> DrawnExcitation | None:
        """The excitation whose values a simulation draws; None for any other function."""
        return self.law.drawn if isinstance(self.law, DrawnForce) else None

    @property
    def white_modulation(self) -> float:
        """Intensity of the white noise of a modulation, s; 0 for any other function."""
        known = self.modulation
        white = known is not None and self.signal is None
        return (known.intensity or 0.0) if white and known is not None else 0.0

    def force_left_out(self, displacement: ArrayLike, rate: ArrayLike) -> Vector:
        """Force, N, less that which matrices and constants hold, of a law without a memory.

        Parameters
        ----------
        displacement, rate
            y, m, and its rate, m/s, of one shape.
        """
        y, v = np.asarray(displacement, float), np.asarray(rate, float)
        stiffness, damping, force = self.affine
        linear = self.mass * (stiffness * y + damping * v + force)
        return np.asarray(self.count * self.law.force_at(y, v) - linear)


ALIKE = 1e-9
"""Largest relative difference of the directions of two pairs whose gaps are one motion; the same
for the distances of two stops that are hit at once."""


def sharing_of(directions: Matrix, lower: Vector, upper: Vector) -> Matrix | None:
    """Shares of the impacts of stops that are hit at once: equal, as none of them is the first.

    Parameters
    ----------
    directions
        (pairs, n), see `Pair`.
    lower, upper
        (pairs,): distances of the stops, m; infinite for none.

    Returns
    -------
    NDArray or None
        (stops, stops), by which counts of impacts on all lower stops, then on all upper ones, are
        multiplied; None where no two stops end one motion at one distance.

    Examples
    --------
    The lower stop of the second pair is the upper one of the first.

    >>> sharing_of(np.array([[1.0], [-1.0]]), np.full(2, 2.0), np.array([2.0, 3.0]))
    array([[1. , 0. , 0. , 0. ],
           [0. , 0.5, 0.5, 0. ],
           [0. , 0.5, 0.5, 0. ],
           [0. , 0. , 0. , 1. ]])
    """
    if len(directions) < 2:
        return None
    outwards, distances = np.concatenate([-directions, directions]), np.concatenate([lower, upper])
    size = np.linalg.norm(outwards, axis=1)
    apart = np.linalg.norm(outwards[:, None] - outwards, axis=2)
    together = apart <= ALIKE * np.maximum.outer(size, size)
    together &= np.isclose(distances[:, None], distances, rtol=ALIKE, atol=0.0)
    together &= np.isfinite(distances)
    np.fill_diagonal(together, True)
    if together.sum() == len(distances):
        return None
    return np.asarray(together / together.sum(axis=1, keepdims=True))


@dataclass(frozen=True, eq=False)
class Signal:
    """A force with a memory of its own, f'' + b f' + w^2 f = w^2 (white noise of `intensity`).

    A sine is the undamped signal without noise that starts with `amplitude`. `direction` (n,) holds
    the forces on the coordinates per unit of f, N; `on_base` says whether f is an acceleration of
    the base.
    """

    omega: float
    damping_rate: float
    intensity: float
    amplitude: float
    direction: Vector
    phase: float = 0.0
    on_base: bool = False


@dataclass(frozen=True, eq=False, kw_only=True)
class Model:
    """M q'' + C q' + K q = forces, the gaps that can be hit, and the excitations, in SI units.

    One oscillator is the case of one coordinate; its numbers per unit mass
    (x'' + b x' + omega^2 x = f(t) + load) have properties of their own. Every excitation is a
    strength with a direction: the forces (n,) on the coordinates per unit of it.

    Parameters
    ----------
    coordinates
        Names of the displacements, n of them.
    mass, damping, stiffness
        Matrices (n, n), kg, N s/m, N/m, of what is linear.
    whites, constants, tables
        Pairs (strength, direction) of white noises (intensity S0), of constant loads (N, or m/s^2
        of the base) and of noises given by one-sided densities.
    signals
        Filtered noises and sines.
    pairs
        The impact pairs.
    moving_base
        Whether displacements are relative to a base that moves.
    base
        Accelerations of the coordinates (n,) per unit of that of the base if they follow it, by
        axis of the base; the axis is "" where the base has only one.
    points
        Rows (n,) by name: displacements row . q that are reported besides the coordinates.
    rates
        omega (rad/s) and b (1/s) of one oscillator, 0 where `restoring` or `drag` holds the force;
        None for several coordinates, or branches.
    followers
        Displacements of other points per unit of that of the only coordinate, by name, where one
        mode is described by its gap.
    cautions
        Warnings about excitations, in words, for example a record that is too short.
    restoring, potential, drag
        Spring force, its energy, and damper force of one oscillator per unit mass, where they are
        functions of the displacement alone or the velocity alone. They include the linear parts.
    functions
        Springs and dampers that are functions; `stiffness` and `damping` leave them out.
    branches, rms_bias
        Branches of springs that relax; `stiffness` holds the rest of these springs. And the
        relative bias that they leave in rms motions: by their fit, or as dampers.
    sampled_modulations
        Densities of the relative changes that are tabulated noise, 1/Hz.
    level
        How the level of all tables varies together; None where it is steady.
    drawn
        Excitations that are not Gaussian and are drawn for a whole record, with the forces per
        unit of each: shocks at random times, and noise with fast peaks.
    knows_mass
        Whether the mass is stated; else `mass` is that of 1 kg, and energies are not known.

    Examples
    --------
    >>> from stochvi import ImpactPair, Oscillator, Restitution, Scene, WhiteNoise
    >>> model = model_of(
    ...     Scene(
    ...         structure=Oscillator(mass=2.0, damping=0.1, stiffness=1.0),
    ...         impact_pairs=[ImpactPair(upper=1.0, law=Restitution(coefficient=0.8))],
    ...         excitations=[WhiteNoise(intensity=0.2)],
    ...     )
    ... )
    >>> model.white, model.temperature, model.intensity, model.upper.position, model.lower
    (array([[0.2]]), 1.0, 0.05, 1.0, None)
    """

    coordinates: tuple[str, ...]
    mass: Matrix
    damping: Matrix
    stiffness: Matrix
    whites: tuple[tuple[float, Vector], ...]
    constants: tuple[tuple[float, Vector], ...]
    signals: tuple[Signal, ...]
    tables: tuple[tuple[Table, Force], ...]
    pairs: tuple[Pair, ...]
    moving_base: bool = False
    base: Mapping[str, Vector] = field(default_factory=dict)
    points: Mapping[str, Vector] = field(default_factory=dict)
    rates: tuple[float, float] | None = None
    followers: Mapping[str, float] = field(default_factory=dict)
    cautions: tuple[str, ...] = ()
    restoring: PerUnitMass | None = None
    potential: PerUnitMass | None = None
    drag: PerUnitMass | None = None
    functions: tuple[FunctionOfMotion, ...] = ()
    branches: tuple[Branch, ...] = ()
    rms_bias: float = 0.0
    sampled_modulations: tuple[Table, ...] = ()
    level: RandomLevel | None = None
    drawn: tuple[tuple[Pulses | FastPeaks, Vector], ...] = ()
    knows_mass: bool = True

    @cached_property
    def modal(self) -> ModalForm:
        """The model in modal coordinates."""
        return modal_form(self)

    @cached_property
    def mean_gaps(self) -> Vector:
        """Mean gaps (pairs,) under the constant loads where nothing is hit, m."""
        return self.modal.gaps @ self.modal.rest

    @cached_property
    def sharing(self) -> Matrix | None:
        """What each rigid stop gets of the impacts that are counted on each, see `sharing_of`; None
        where none are hit at once. Compliant ones count their own contacts."""
        places = np.full((2, len(self.pairs)), math.inf)
        for number, pair in enumerate(self.pairs):
            for stop in pair.stops:
                if stop.rigid:
                    places[int(stop.side > 0), number] = stop.distance
        return sharing_of(np.array([pair.direction for pair in self.pairs]), *places)

    @cached_property
    def white(self) -> Matrix:
        """Intensity matrix (n, n) of the white forces, N^2 s."""
        total = np.zeros_like(self.mass)
        for intensity, direction in self.whites:
            total += intensity * np.outer(direction, direction)
        return total

    @cached_property
    def constant_force(self) -> Vector:
        """Constant forces on the coordinates (n,), N."""
        total = np.zeros(len(self.coordinates))
        for magnitude, direction in self.constants:
            total += magnitude * direction
        return total

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of all reported displacements: the coordinates, then the points."""
        return (*self.coordinates, *self.points)

    @cached_property
    def output_rows(self) -> Matrix:
        """Rows (outputs, n): the reported displacements are output_rows q."""
        rows = [*np.eye(len(self.coordinates)), *self.points.values()]
        return np.array(rows).reshape(-1, len(self.coordinates))

    @cached_property
    def base_rows(self) -> Matrix:
        """Accelerations in `base` as a matrix (coordinates, axes)."""
        return np.array(list(self.base.values())).T

    @property
    def single(self) -> bool:
        """Whether this is one oscillator, with one impact pair or none."""
        return len(self.coordinates) == 1 and len(self.pairs) <= 1

    @property
    def stops(self) -> tuple[Stop, ...]:
        """All stops of all pairs."""
        return tuple(stop for pair in self.pairs for stop in pair.stops)

    @property
    def masses_of_pairs(self) -> Vector:
        """(pairs,): reduced masses, kg."""
        return np.array([pair.mass for pair in self.pairs])

    @property
    def rigid(self) -> bool:
        """Whether every stop is rigid, as where there is none."""
        return all(stop.rigid for stop in self.stops)

    @property
    def elastic(self) -> bool:
        """Whether no stop loses energy."""
        laws = [stop.law for stop in self.stops]
        return all(law.conservative and not law.friction_coefficient for law in laws)

    @property
    def remembers(self) -> bool:
        """Whether a spring has hysteresis or is modulated, so that its force does not follow from
        the motion."""
        return any(part.law.remembers and part.drawn is None for part in self.functions)

    @property
    def modulations(self) -> tuple[FunctionOfMotion, ...]:
        """The forces by which springs and dampers are modulated."""
        return tuple(part for part in self.functions if part.modulation is not None)

    @property
    def drives(self) -> tuple[FunctionOfMotion, ...]:
        """The forces of excitations whose values a simulation draws."""
        return tuple(part for part in self.functions if part.drawn is not None)

    @property
    def with_noise_of_drives(self) -> Model:
        """The model with white noise and a constant load, of equal mean and intensity, in the place
        of the excitations that are drawn; the model itself without any."""
        if not self.drives:
            return self
        whites, constants = list(self.whites), list(self.constants)
        for part in self.drives:
            assert part.drawn is not None
            whites.append((part.drawn.si_intensity, part.direction))
            held = part.affine[2] * part.mass  # the linear part of a force against the motion
            if load := part.drawn.mean + held:
                constants.append((load, part.direction))
        rest = tuple(part for part in self.functions if part.drawn is None)
        return replace(
            self, whites=tuple(whites), constants=tuple(constants), functions=rest
        )  # fmt: skip

    @cached_property
    def with_tables_of_drawn(self) -> Model:
        """The model with Gaussian noise and a constant load in the place of what is drawn for a
        whole record. Density and mean are the same; without any it is the model itself."""
        if not self.drawn:
            return self
        tables = [(each.table, direction) for each, direction in self.drawn]
        loads = [(each.mean, direction) for each, direction in self.drawn if each.mean]
        return replace(
            self, tables=(*self.tables, *tables), constants=(*self.constants, *loads), drawn=()
        )  # fmt: skip

    @property
    def moves_stops(self) -> bool:
        """Whether any stop moves."""
        return any(pair.moved for pair in self.pairs)

    @property
    def shaken(self) -> bool:
        """Whether noise or a sine forces the structure: with modulations alone it may rest."""
        return bool(
            self.tables
            or self.drives
            or self.drawn
            or any(intensity for intensity, _ in self.whites)
            or any(np.any(signal.direction) for signal in self.signals)
        )

    @property
    def summed(self) -> bool:
        """Whether impulses and losses of the impacts on any stop are summed one by one."""
        return any(stop.summed for pair in self.pairs for stop in pair.stops)

    @property
    def scattered(self) -> bool:
        """Whether the restitution of any stop is drawn at each impact."""
        return any(stop.scattered for stop in self.stops)

    @property
    def sines(self) -> tuple[Signal, ...]:
        """The signals that are sines."""
        return tuple(signal for signal in self.signals if signal.amplitude)

    def without_sines(self) -> Model:
        """The model under its noise and loads alone."""
        kept = tuple(signal for signal in self.signals if not signal.amplitude)
        return replace(self, signals=kept)

    @property
    def _shaking(self) -> list[Force]:
        """The forces per unit of everything that shakes the structure: all but constant loads."""
        return [
            *(direction for _, direction in (*self.whites, *self.tables, *self.drawn)),
            *(signal.direction for signal in self.signals if np.any(signal.direction)),
            *(part.direction for part in self.drives),
        ]

    @cached_property
    def base_alone_moves(self) -> bool:
        """Whether all excitations but constant loads move the base.

        Apart from constant loads, springs, dampers and stops then cause all of the absolute
        acceleration: M a = -C q' - K q - contact forces.
        """
        inertia = [inertia_of(self.mass, each) for each in self.base.values()]
        known = not any(
            part.white_modulation or (part.drawn is not None and part.drawn.mean)
            for part in self.functions
        )
        return (
            known
            and self.moving_base
            and all(
                isinstance(direction, InputMatrix)
                or any(np.array_equal(direction, each) for each in inertia)
                for direction in self._shaking
            )
        )

    def shaken_by_base(self) -> Model:
        """One oscillator that moves alike on a base that tables alone shake, in place of all noise.

        Its absolute acceleration is what spring, damper and stops give the mass.
        """
        base = np.ones(1)
        force = inertia_of(self.mass, base)
        tables = tuple((table, force) for table in self.acceleration_tables)
        return replace(self, tables=tables, moving_base=True, base={"": base})

    @property
    def noisy(self) -> bool:
        """Whether any noise shakes the structure."""
        return bool(
            self.tables
            or self.drives
            or self.drawn
            or any(intensity for intensity, _ in self.whites)
            or any(signal.intensity for signal in self.signals)
        )

    @cached_property
    def temperature(self) -> float | None:
        """theta (J) for which white = 2 theta damping; None if there is no such number.

        There is one for a linear structure whose only excitation is white noise with a matrix that
        is proportional to the damping. With elastic stops the stationary distribution is then the
        Gibbs distribution exp(-H / theta).
        """
        coloured = self.signals or self.tables or self.drawn
        if self.functions or self.branches or coloured or not np.any(self.damping):
            return None
        theta = float(np.trace(self.white) / np.trace(self.damping) / 2.0)
        wanted = 2.0 * theta * self.damping
        # each entry relative to its own coordinates: light ones have little noise and damping
        size = np.sqrt(np.maximum(np.diag(self.white), np.diag(wanted)))
        matched = np.all(np.abs(self.white - wanted) <= MATCHED * np.outer(size, size))
        return theta if matched and theta > 0.0 else None

    # One oscillator, per unit mass.

    @property
    def unit_mass(self) -> float:
        """Mass of one oscillator, kg."""
        return float(self.mass[0, 0])

    @property
    def omega(self) -> float:
        """Natural frequency of one oscillator, rad/s; 0 without a spring, or with a function."""
        return self._rates[0]

    @property
    def damping_rate(self) -> float:
        """Damping rate b = c / m of one oscillator, 1/s; 0 where the damper is a function."""
        return self._rates[1]

    @property
    def _rates(self) -> tuple[float, float]:
        if self.rates is None:
            raise ValueError(
                f"only one oscillator has a natural frequency, got {len(self.coordinates)} "
                "coordinates"
            )
        return self.rates

    @cached_property
    def intensity(self) -> float:
        """Intensity S0 of the white noise on one oscillator, per unit mass squared, m^2/s^3."""
        return float(sum(s0 / self._scale(d) ** 2 for s0, d in self.whites))

    @cached_property
    def load(self) -> float:
        """Constant load on one oscillator per unit mass, m/s^2."""
        return sum(
            (math.copysign(1.0, d[0]) * a / self._scale(d) for a, d in self.constants), start=0.0
        )

    @cached_property
    def acceleration_tables(self) -> tuple[Table, ...]:
        """One-sided densities of the noises on one oscillator per unit mass, (m/s^2)^2/Hz."""
        return tuple(table.scaled(self._scale(d) ** -2) for table, d in self.tables)

    @cached_property
    def filters(self) -> tuple[Filter, ...]:
        """Filtered noises on one oscillator, with intensities per unit mass squared."""
        return tuple(
            Filter(s.omega, s.damping_rate, s.intensity / self._scale(s.direction) ** 2)
            for s in self.signals
            if not s.amplitude
        )

    def _scale(self, direction: Force) -> float:
        """The mass that turns a force into an acceleration; 1 for an acceleration of the base."""
        if isinstance(direction, InputMatrix):
            return 1.0
        return self.unit_mass / abs(direction[0]) if direction[0] else math.inf

    @property
    def noise_on_mass(self) -> bool:
        """Whether a noise or a sine acts on the mass of one oscillator itself, not on its base."""
        own = [each for each in self._shaking if not isinstance(each, InputMatrix)]
        return any(direction[0] > 0.0 or not self.moving_base for direction in own)

    @cached_property
    def lower(self) -> Stop | None:
        """The lower stop of one oscillator, with its law per unit mass; None without one."""
        return self._only_stop(LOWER)

    @cached_property
    def upper(self) -> Stop | None:
        """The upper stop of one oscillator, with its law per unit mass; None without one."""
        return self._only_stop(UPPER)

    def _only_stop(self, side: int) -> Stop | None:
        stops = self.pairs[0].stops if self.pairs else ()
        found = next((stop for stop in stops if stop.side == side), None)
        return None if found is None else found.per_unit_mass(self.unit_mass)

    @property
    def stops_per_unit_mass(self) -> tuple[Stop, ...]:
        """The stops of one oscillator, the lower one first, with their laws per unit mass."""
        return tuple(stop for stop in (self.lower, self.upper) if stop is not None)

    @property
    def lower_position(self) -> float:
        """Position of the lower stop of one oscillator, m; minus infinity without one."""
        return -math.inf if self.lower is None else self.lower.position

    @property
    def upper_position(self) -> float:
        """Position of the upper stop of one oscillator, m; infinity without one."""
        return math.inf if self.upper is None else self.upper.position

    @property
    def rest(self) -> float:
        """Rest position of one oscillator under its load, m, if no stop is met.

        Without a spring it is 0 for a load of 0, otherwise infinity in the direction of the load.
        """
        if self.load == 0.0:
            return 0.0
        return self.load / self.omega**2 if self.omega else math.copysign(math.inf, self.load)

    @property
    def held(self) -> bool:
        """Whether spring, stops and load keep one oscillator from drifting away on either side."""
        left = self.lower is not None or self.load > 0.0
        right = self.upper is not None or self.load < 0.0
        return self.omega > 0.0 or (left and right)


MATCHED = 1e-12
"""Relative difference up to which the matrices of white noise and damping count as proportional: a
rounding error."""


_LOWERED: dict[int, tuple[weakref.ref[Scene], Model]] = {}
"""The models of all scenes that are alive, by the identity of the scene."""


def model_of(scene: Scene) -> Model:
    """The model of a scene, which is made once and kept as long as the scene lives."""
    known = _LOWERED.get(id(scene))
    if known is not None and known[0]() is scene:
        return known[1]
    if scene.phases:
        names = [phase.name for phase in scene.phases]
        one = shlex.quote(f"FILE.toml#{names[0]}")
        sentence = (
            f"must be one here, got {len(names)} ({', '.join(names)}); name it, as in {one} (in "
            f"Python scene.in_phase({names[0]!r})), or ask reliability, size or damage for all of "
            "them"
        )
        raise SceneError("phase", sentence)
    model = _build_model(scene.expanded)
    key = id(scene)
    _LOWERED[key] = weakref.ref(scene, lambda _: _LOWERED.pop(key, None)), model
    return model


def _build_model(scene: Scene) -> Model:
    structure = scene.structure
    mass = structure.matrices[0]
    damping, stiffness = np.zeros_like(mass), np.zeros_like(mass)
    restoring: PerUnitMass | None = None
    potential: PerUnitMass | None = None
    drag: PerUnitMass | None = None
    if isinstance(structure, NonlinearOscillator):
        m = structure.mass
        restoring, potential = (
            lambda x: structure.force_at(x) / m,
            lambda x: structure.potential_at(x) / m,
        )
        if structure.damping_force is not None:
            drag = lambda v: structure.damping_at(v) / m  # noqa: E731
    else:
        mass, damping, stiffness = structure.matrices
    rates = structure.rates
    acting = [each for each in scene.excitations if not isinstance(each, Modulation)]
    directions = [_direction(scene, excitation, mass) for excitation in acting]
    shaken = list(zip(acting, directions, strict=True))
    model = Model(
        coordinates=structure.coordinates,
        mass=mass,
        damping=damping,
        stiffness=stiffness,
        whites=tuple(_whites(scene, shaken)),
        constants=tuple(_constants(scene, shaken)),
        signals=tuple(_signals(scene, shaken)),
        tables=tuple(_tables(scene, shaken)),
        pairs=tuple(_pair(scene, pair, mass) for pair in scene.impact_pairs),
        moving_base=structure.on_mount
        or any(scene.place(excitation) == BASE for excitation in scene.excitations),
        base=structure.carried,
        points=structure.reported,
        rates=rates,
        restoring=restoring,
        potential=potential,
        drag=drag,
        level=scene.random_level,
        drawn=tuple(_drawn(scene, shaken)),
        knows_mass=structure.knows_mass,
    )
    placed: dict[bool, list[Placed]] = {True: [], False: []}
    for each in structure.functions:
        placed[isinstance(each.law, RelaxationSpring)].append(each)
    if placed[True]:
        model = _with_branches(model, placed[True])
    if placed[False]:
        model = _with_functions(model, placed[False])
    if scene.modulations:
        model = _with_modulations(model, scene)
    model = _with_drives(model, shaken)
    model = replace(model, cautions=_cautions(scene, model))
    references, motions = scene.drifts
    if references:
        return _seen_from(model, references, motions)
    return _at_its_gap(scene, model) if len(mass) == 1 and model.points else model


def rates_of(
    mass: Matrix, damping: Matrix, stiffness: Matrix, branches: Sequence[Branch] = ()
) -> tuple[float, float] | None:
    """`Model.rates` of matrices; a stiffness below 0 counts as none."""
    if len(mass) > 1 or branches:
        return None
    own = float(mass[0, 0])
    return math.sqrt(max(float(stiffness[0, 0]), 0.0) / own), float(damping[0, 0]) / own


def _with_branches(model: Model, placed: Sequence[Placed]) -> Model:
    """A model with the static stiffnesses and the branches of springs that relax."""
    stiffness, branches = model.stiffness.copy(), list[Branch]()
    for part in placed:
        assert isinstance(part.law, RelaxationSpring)
        stiffness += part.count * part.law.stiffness * np.outer(part.row, part.row)
        for strength, time in part.law.branches:
            if strength:
                branches.append(Branch(part.name, part.count * strength, time, part.row))
    rates = rates_of(model.mass, model.damping, stiffness, branches)
    found = replace(model, stiffness=stiffness, branches=tuple(branches), rates=rates)
    wrong = [part for part in placed if isinstance(part.law, RelaxationSpring) and part.law.error]
    return replace(found, rms_bias=_bias_of_fit(found, wrong)) if wrong else found


def _bias_of_fit(model: Model, placed: Sequence[Placed]) -> float:
    """Relative bias of rms motions by the errors of springs, of accelerations too."""
    laws = [part.law for part in placed if isinstance(part.law, RelaxationSpring)]
    counts = np.array([part.count for part in placed])

    def sizes(frequency_hz: Vector) -> Vector:
        found = [each.error * np.abs(each.dynamic_stiffness(frequency_hz)) for each in laws]
        return np.asarray(counts * np.array(found).T)

    rows = np.array([part.row for part in placed])
    forces = [direction for _, direction in model.whites]
    forces += [signal.direction for signal in model.signals]
    shaken = [model.modal.shapes.T @ force for force in forces if np.any(force)]
    known = bias_of_stiffness(model.modal, rows, sizes, shaken)
    return known + max(each.error for each in laws)


SLOW, LIGHT = 1e-2, 1e-4
"""A branch is taken as a damper in steps. Its time is at most SLOW of a radian of the fastest mode.
All such branches together, k tau^2, are at most LIGHT of the mass that they move."""


def with_dampers(model: Model) -> Model:
    """A model with dampers k tau in the place of its fastest branches, which would ask for short
    steps. Up to (w tau)^2, i w k tau / (1 + i w tau) is that damper and a mass -k tau^2."""
    kept, damping, left = list[Branch](), model.damping.copy(), LIGHT
    fastest = math.sqrt(float(np.max(model.modal.squares)))
    longest = SLOW / fastest if fastest > 0.0 else 0.0
    for each in sorted(model.branches, key=lambda branch: branch.time):
        row = each.direction
        share = each.stiffness * each.time**2 * float(row @ np.linalg.solve(model.mass, row))
        if each.time <= longest and share <= left:
            damping += each.stiffness * each.time * np.outer(row, row)
            left -= share
        else:
            kept.append(each)
    if len(kept) == len(model.branches):
        return model
    bias = model.rms_bias + (LIGHT - left) + SLOW**2
    rates = rates_of(model.mass, damping, model.stiffness, kept)
    return replace(model, damping=damping, branches=tuple(kept), rms_bias=bias, rates=rates)


def _with_functions(model: Model, placed: Sequence[Placed]) -> Model:
    """A model with springs and dampers that are functions; for one oscillator also by their
    sums, where displacement and velocity are apart."""
    functions = tuple(
        FunctionOfMotion(
            name=part.name,
            direction=part.row,
            mass=float(1.0 / (part.row @ np.linalg.solve(model.mass, part.row))),
            law=part.law,
            count=part.count,
        )
        for part in placed
    )
    model = replace(model, functions=functions)
    apart = all(part.law.needs != "both" for part in functions)
    if len(model.coordinates) > 1 or not apart or model.branches:
        return model
    mass, (omega, b) = model.unit_mass, model._rates
    springs = [part for part in functions if part.law.needs == "displacement"]
    dampers = [part for part in functions if part.law.needs == "velocity"]

    def restoring(x: ArrayLike) -> Vector:
        place = np.asarray(x, float)
        forces = (part.count / mass * part.law.force_at(place) for part in springs)
        return np.asarray(sum(forces, omega**2 * place))

    def potential(x: ArrayLike) -> Vector:
        place = np.asarray(x, float)
        energies = (part.count / mass * part.law.potential_at(place) for part in springs)
        return np.asarray(sum(energies, omega**2 / 2.0 * place**2))

    def drag(v: ArrayLike) -> Vector:
        speed = np.asarray(v, float)
        forces = (part.count / mass * part.law.force_at(0.0, speed) for part in dampers)
        return np.asarray(sum(forces, b * speed))

    return replace(
        model,
        restoring=restoring if springs else None,
        potential=potential if springs else None,
        drag=drag if dampers else None,
        rates=(0.0 if springs else omega, 0.0 if dampers else b),
    )


def _with_modulations(model: Model, scene: Scene) -> Model:
    """A model with the forces by which springs and dampers are modulated, and with stops that move.
    The relative change is a signal that forces nothing by itself; white noise and samples of a
    table have no state."""
    signals, functions, pairs = list(model.signals), list(model.functions), list(model.pairs)
    tables = list[Table]()
    still = np.zeros(len(model.coordinates))
    words = [each.effect_word for each in scene.modulations]
    for number, each in enumerate(scene.modulations):
        signal = sample = None
        if each.table is not None:
            sample = len(tables)
            tables.append(each.table)
        elif each.source != "white noise":
            signal, made = len(signals), each.filter
            if made is None:
                signals.append(Signal(each.omega, 0.0, 0.0, each.amplitude or 0.0, still))
            else:
                signals.append(Signal(*made, 0.0, still))
        if each.of == "clearance":
            for k, pair in enumerate(scene.impact_pairs):
                if each in scene.moved_by(pair):
                    way = Movement(pairs[k].stops[0].position, signal, sample)
                    pairs[k] = replace(pairs[k], moved=(*pairs[k].moved, way))
            continue
        row, strength = changed_by(each, scene.structure)
        mass = float(1.0 / (row @ np.linalg.solve(model.mass, row)))
        rates = (strength, 0.0) if each.of == "stiffness" else (0.0, strength)
        name = each.effect_word
        if words.count(name) > 1:
            name += f" {words[: number + 1].count(name)}"
        law = ModulatedForce(
            kind=each.kind, stiffness=rates[0], damping=rates[1], mass=mass, modulation=each
        )
        functions.append(FunctionOfMotion(name, row, mass, law, signal=signal, sample=sample))
    return replace(
        model, signals=tuple(signals), functions=tuple(functions), pairs=tuple(pairs),
        sampled_modulations=tuple(tables),
    )  # fmt: skip


def _with_drives(model: Model, shaken: Sequence[tuple[Excitation, Vector]]) -> Model:
    """A model with the forces of excitations that are drawn."""
    functions = list(model.functions)
    drives = [
        (each, d)
        for each, d in shaken
        if isinstance(each, DrawnExcitation) and np.any(d) and not _is_shock(each)
    ]
    for number, (each, force) in enumerate(drives, 1):
        mass = float(1.0 / (force @ np.linalg.solve(model.mass, force)))
        name = each.effect_word + (f" {number}" if len(drives) > 1 else "")
        law = DrawnForce(kind=each.kind, mass=mass, drawn=each)
        functions.append(FunctionOfMotion(name, force, mass, law))
    return replace(model, functions=tuple(functions)) if drives else model


def _is_shock(excitation: Excitation) -> TypeGuard[Pulses]:
    """Whether an excitation is a shock of a shape at random times."""
    return isinstance(excitation, Pulses) and excitation.shock is not None


def _drawn(
    scene: Scene, shaken: Sequence[tuple[Excitation, Vector]]
) -> Iterator[tuple[Pulses | FastPeaks, Vector]]:
    """What is drawn for a whole record, with the forces per unit of each."""
    for excitation, direction in shaken:
        if _is_shock(excitation):
            yield excitation, direction
        elif isinstance(excitation, DensityNoise) and excitation.has_fast_peaks:
            assert excitation.kurtosis is not None
            yield FastPeaks(scene.table_of(excitation), excitation.kurtosis), direction


def _cautions(scene: Scene, model: Model) -> tuple[str, ...]:
    """Warnings of the excitations, which judge them by the only mode or the slowest one that a
    spring holds; and on the motion of that mode that the density of a record leaves out."""
    alone = len(model.coordinates) == 1
    linear = scene.structure.linear and not model.functions
    own = model.rates or (0.0, 0.0)
    slowest = _slowest_mode(model) if linear else None
    numbers = own if alone or slowest is None else slowest
    found = scene.slipped_units() + [
        sentence
        for each in scene.excitations
        if isinstance(each, DensityNoise)
        for sentence in each.cautions(*numbers, alone=alone)
    ]
    if slowest is not None:
        records = [each for each in scene.excitations if isinstance(each, RecordedNoise)]
        lost = (each.lost_below(*slowest, alone=alone) for each in records)
        found += [each[1] for each in lost if each is not None]
    return tuple(found)


def _slowest_mode(model: Model) -> tuple[float, float] | None:
    """omega (rad/s) and damping rate (1/s) of the slowest mode that a spring holds; None where
    there is none, or nothing damps it."""
    held = np.flatnonzero(model.modal.squares > 0.0)
    if not len(held):
        return None
    mode = held[0]
    rate = float(model.modal.damping[mode, mode])
    return (math.sqrt(float(model.modal.squares[mode])), rate) if rate > 0.0 else None


def _at_its_gap(scene: Scene, model: Model) -> Model:
    """The model of one mode by the displacement of the gap, or of the first point that moves.

    It is one oscillator: all of its points move in proportion to that one.
    """
    if len(model.pairs) > 1:
        return model
    moving = [each for each in model.points.items() if each[1][0]]
    name, row = next(iter(moving or model.points.items()))
    if scene.impact_pairs:
        name, row = scene.words_of(scene.impact_pairs[0]), model.pairs[0].direction
    if not row[0]:
        return model
    share = float(row[0])
    scale = np.array([[share]])
    others = {point: float(its[0]) / share for point, its in model.points.items() if point != name}
    return replace(
        _in_coordinates(model, 1.0 / scale, 1.0 / scale, scale),
        coordinates=(name,),
        mass=model.mass / share**2,
        damping=model.damping / share**2,
        stiffness=model.stiffness / share**2,
        points={},
        followers=others,
    )


def _in_coordinates(model: Model, forces: Matrix, rows: Matrix, moved: Matrix) -> Model:
    """What acts on a model in other coordinates: all but its matrices.

    Parameters
    ----------
    forces
        Forces on the coordinates per unit of those on the old ones.
    rows
        The old displacements per unit of the coordinates.
    moved
        Displacements of the coordinates per unit of the old ones.
    """

    def turned(row: Vector | None) -> Any:
        return None if row is None else row @ rows

    return replace(
        model,
        whites=tuple((strength, forces @ force) for strength, force in model.whites),
        constants=tuple((strength, forces @ force) for strength, force in model.constants),
        signals=tuple(replace(each, direction=forces @ each.direction) for each in model.signals),
        tables=tuple((table, forces @ force) for table, force in model.tables),
        drawn=tuple((each, forces @ force) for each, force in model.drawn),
        pairs=tuple(
            replace(each, direction=turned(each.direction), tangent=turned(each.tangent))
            for each in model.pairs
        ),
        functions=tuple(
            replace(
                part,
                direction=forces @ part.direction if part.drawn else turned(part.direction),
            )
            for part in model.functions
        ),
        branches=tuple(each._replace(direction=turned(each.direction)) for each in model.branches),
        base={axis: moved @ its for axis, its in model.base.items()},
    )


def _seen_from(model: Model, references: list[int], motions: Matrix) -> Model:
    """The model of the motion relative to reference coordinates, if the whole structure drifts.

    `references` and `motions` are those that `drifts` returns.
    """
    forces = without_drift(model.mass, references, motions)
    kept = np.delete(np.arange(len(model.mass)), references)
    inner = np.ix_(kept, kept)
    mass, damping, stiffness = (
        (forces @ model.mass)[:, kept],
        model.damping[inner],
        model.stiffness[inner],
    )
    chosen = np.eye(len(model.mass))[kept]
    return replace(
        _in_coordinates(model, forces, chosen.T, chosen),
        coordinates=tuple(model.coordinates[place] for place in kept),
        mass=mass, damping=damping, stiffness=stiffness,
        rates=rates_of(mass, damping, stiffness, model.branches),
    )  # fmt: skip


def _signals(scene: Scene, shaken: Sequence[tuple[Excitation, Vector]]) -> Iterator[Signal]:
    for excitation, direction in shaken:
        match excitation:
            case FilteredNoise():
                decay = 2.0 * excitation.zeta * excitation.omega
                yield Signal(excitation.omega, decay, excitation.si_intensity, 0.0, direction)
            case Sine():
                omega = 2.0 * math.pi * excitation.frequency_hz
                on_base = scene.place(excitation) == BASE
                wave = cmath.rect(1.0, math.radians(excitation.phase_deg))
                wave *= _crank_force(scene, excitation, direction) or excitation.peak
                yield Signal(omega, 0.0, 0.0, abs(wave), direction, cmath.phase(wave), on_base)
            case WhiteNoise() | ConstantLoad() | DensityNoise() | Modulation() | DrawnExcitation():
                pass  # `Model` has other fields for these
            case _:
                assert_never(excitation)


def _crank_force(scene: Scene, sine: Sine, direction: Vector) -> complex:
    """Complex peak of the force on the first coordinate, N, of a crank between two coordinates.

    The crank moves the end of the spring and damper between them. 0 for any other sine.
    """
    if not sine.crank:
        return 0.0
    _, damping, stiffness = scene.structure.matrices
    first, second = np.argmax(direction), np.argmin(direction)
    rate = 2j * math.pi * sine.frequency_hz
    return complex(-sine.crank * (stiffness[first, second] + rate * damping[first, second]))


def _whites(
    scene: Scene, shaken: Sequence[tuple[Excitation, Vector]]
) -> Iterator[tuple[float, Vector]]:
    """Intensities of independent white noises, with the forces per unit of each.

    Correlated ones of the covariance L L' are those of unit intensity that act by the columns of L.
    """
    together = scene.correlated_whites()
    own = {id(each) for each in together.values()}
    for excitation, direction in shaken:
        if isinstance(excitation, WhiteNoise) and id(excitation) not in own:
            yield excitation.si_intensity, direction
    if not together:
        return
    directions = {id(excitation): direction for excitation, direction in shaken}
    rows = np.array([directions[id(each)] for each in together.values()])
    sizes = np.sqrt([each.si_intensity for each in together.values()])
    correlations = white_correlations(scene.white_crosses, tuple(together))
    values, vectors = np.linalg.eigh(sizes[:, None] * correlations * sizes)
    for value, vector in zip(values, vectors.T, strict=True):
        if value > MATCHED * values[-1]:
            yield float(value), vector @ rows


def _tables(
    scene: Scene, shaken: Sequence[tuple[Excitation, Vector]]
) -> Iterator[tuple[Table, Force]]:
    """Densities with the forces per unit of each; correlated noises are expressed by independent
    sources."""
    together = scene.correlated()
    tables = {name: scene.table_of(each) for name, each in together.items()}
    sources = independent_sources(scene.coloured, tables)
    directions = {id(excitation): direction for excitation, direction in shaken}
    rows = np.array([directions[id(each)] for each in together.values()]).T
    breaks = [
        *(table.frequency_hz for table in tables.values()),
        *(cross.places for cross in scene.coloured),
    ]
    names = {id(each): name for name, each in together.items()}
    for excitation, direction in shaken:
        if isinstance(excitation, DensityNoise) and not excitation.has_fast_peaks:
            force: Force = direction
            if id(excitation) in names:
                places = np.unique(np.concatenate(breaks))
                force = InputMatrix(rows, sources[names[id(excitation)]], places)
            yield scene.table_of(excitation), force


def _constants(
    scene: Scene, shaken: Sequence[tuple[Excitation, Vector]]
) -> Iterator[tuple[float, Vector]]:
    """Size and direction of every constant load, those of gravity first."""
    yield from scene.structure.constant_forces()
    for excitation, direction in shaken:
        if isinstance(excitation, ConstantLoad):
            yield excitation.magnitude, direction


def _direction(scene: Scene, excitation: Excitation, mass: Matrix) -> Vector:
    """Forces (n,) on the coordinates per newton of an excitation, or per m/s^2 of the base."""
    place = scene.place(excitation)
    if place == BASE:
        return inertia_of(mass, scene.structure.carried[excitation.axis or ""])
    if not scene.words_of(excitation):
        return np.asarray(scene.structure.places[place])
    return scene.row_of(excitation)


def inertia_of(mass: Matrix, influence: Vector) -> Vector:
    """Forces (n,) on the coordinates per m/s^2 of a base; `influence` (n,) are the accelerations of
    the coordinates that follow it."""
    return np.asarray(-(mass * influence).sum(axis=1))


def _pair(scene: Scene, pair: ImpactPair, mass: Matrix) -> Pair:
    if pair.at is not None and pair.direction is not None:
        along, compliance = np.array(pair.direction), 0.0
        direction = along @ rows_at(pair.at) / float(np.linalg.norm(along))
    else:
        direction = scene.row_of(pair)
        compliance = scene.structure.compliance(scene.weights_of(pair))
    places = {"lower": (LOWER, pair.lower), "upper": (UPPER, pair.upper)}
    reduced = float(1.0 / (direction @ np.linalg.solve(mass, direction)))
    return Pair(
        name=pair.name,
        direction=direction,
        mass=reduced,
        relative=bool(np.count_nonzero(direction) > 1) or pair.at is not None,
        tangent=scene.tangent_of(pair),
        stops=tuple(
            Stop(side, position, pair.law_of(name).on_mass(reduced).in_series(compliance))
            for name, (side, position) in places.items()
            if position is not None
        ),
    )


# ------------------------------------------------------------------------------
# Why a structure under noise or sines has no stationary state, in sentences with a remedy.
# ------------------------------------------------------------------------------


RESTRAINT_TOLERANCE = 1e-9
"""Largest size of a free motion, dimensionless and at most 1, at which stops and loads are taken to
hold it; what remains is the tolerance of the linear programme that searches for the motion."""


def not_stationary(model: Model) -> list[str]:
    """Sentences on what keeps a model from a stationary state; empty if nothing does.

    Examples
    --------
    >>> from stochvi import Matrices, Scene, WhiteNoise
    >>> from stochvi.model.model import model_of
    >>> free = Matrices(coordinates=["a"], mass=[[1.0]], damping=[[1.0]], stiffness=[[0.0]])
    >>> scene = Scene(structure=free, excitations=[WhiteNoise(intensity=1.0, on="a")])
    >>> not_stationary(model_of(scene))[0].split(":")[0]
    'nothing brings a back'
    """
    found = []
    lossless = not np.any(model.damping) and model.drag is None and not model.functions
    if lossless and model.elastic:
        found.append(
            "nothing takes the energy that the excitation brings: give a spring its damper, or a "
            "stop a restitution below 1"
        )
    lost = _lost(model)
    if np.any(lost):
        name = model.coordinates[int(np.argmax(np.abs(lost)))]
        found.append(
            f"nothing brings {name} back: press it towards a stop by a constant load "
            "(kind = 'constant'), or hold it by a spring or a second stop"
        )
    return found


def _lost(model: Model) -> np.ndarray:
    """A motion (n,) that no spring, stop or constant load opposes; zeros if there is none."""
    modes = model.modal
    free = np.flatnonzero(modes.squares == 0.0)
    if not len(free) or model.restoring is not None or model.functions:
        return np.zeros(len(model.coordinates))
    sides = np.array([stop.side for pair in model.pairs for stop in pair.stops])
    rows = np.repeat(modes.gaps, [len(pair.stops) for pair in model.pairs], axis=0)[:, free]
    limits = np.vstack([sides[:, None] * rows, -modes.falling[free][None]])
    size = np.linalg.norm(limits, axis=1, keepdims=True)
    limits = np.divide(limits, size, out=np.zeros_like(limits), where=size > 0.0)
    for cost in (*np.eye(len(free)), *-np.eye(len(free))):
        way = scipy.optimize.linprog(
            -cost, A_ub=limits, b_ub=np.zeros(len(limits)), bounds=(-1.0, 1.0)
        )
        if way.x is not None and float(cost @ way.x) > RESTRAINT_TOLERANCE:
            return np.asarray(modes.shapes[:, free] @ way.x)
    return np.zeros(len(model.coordinates))
