"""A family of scenes over one key, as kernels take it. Chapters: springs and dampers that are
functions; the numbers of a scene; states by names of coordinates."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stochvi.engine.calls import Characteristics, row_of_numbers
from stochvi.engine.parts import Affine
from stochvi.mathematics.numerics import Matrix, Vector, Waves
from stochvi.methods.periodic.kernels import flow, solver
from stochvi.model.coverage import (
    functions,
    functions_of_arrays,
    modulated,
    rubbing,
    scattered,
    speed_restitutions,
)
from stochvi.model.model import FunctionOfMotion, Model, Pair, Stop
from stochvi.results.errors import NotApplicable

# ------------------------------------------------------------------------------
# Springs and dampers that are functions, over a family of scenes, as kernels take them.
# ------------------------------------------------------------------------------


STEADY = 1e-12
"""Relative change over the range up to which a number is the same everywhere: kernels read counts
from numbers, which the rounding of a series must not change."""


def not_followed(model: Model) -> list[str]:
    """The sentences of functions that regimes under a sine do not follow."""
    found = functions_of_arrays(model) + modulated(model)
    found += [
        f"structure.damper must not drive the structure, got kind {part.law.kind!r} ({part.name}), "
        "whose motion has a frequency of its own; simulate follows it"
        for part in model.functions
        if part.law.drives
    ]
    held = [part.name for part in model.functions if part.law.sticks and not part.law.drives]
    if len(held) > 1:
        found.append(
            "structure.damper must be one that sticks, at most, as which of several slip together "
            f"is not decided, got {', '.join(held)}; simulate follows them"
        )
    return found


def numbers_of_functions(
    model: Model, whitening: Matrix, unit: float, time: float, widths: tuple[int, int]
) -> Vector:
    """Numbers of all functions, one after another: displacement and acceleration per unit of each
    coordinate of the kernels and of its force, the numbers of the part, and its knots.

    Parameters
    ----------
    model
        The model.
    whitening
        Matrix to coordinates with unit masses.
    unit, time
        Unit of these coordinates in the kernels, and unit of time, s.
    widths
        Numbers of the longest part, and of knots.
    """
    found = list[Vector]()
    for part in model.functions:
        row = whitening @ part.direction
        own, knots = np.zeros(widths[0]), np.full(widths[1], flow.FAR)
        numbers, kinks = row_of_numbers(compiled(part)), part.law.knots()
        own[: len(numbers)], knots[: len(kinks)] = numbers, kinks
        found += [unit * row, row / (row @ row) * time**2 / unit, own, knots]
    return np.concatenate([np.zeros(0), *found])


def compiled(part: FunctionOfMotion) -> Any:
    """The part as kernels know it, for forces per unit of its reduced mass."""
    return part.law.compiled(part.mass / part.count)


def widths_of(model: Model) -> tuple[int, int]:
    """Numbers of the longest part, and of knots."""
    return (
        max((len(row_of_numbers(compiled(part))) for part in model.functions), default=0),
        max((len(part.law.knots()) for part in model.functions), default=0),
    )


def _kind(part: FunctionOfMotion) -> int:
    if part.law.sticks:
        return flow.STICKS
    turns = part.law.remembers or part.law.is_damper
    return flow.TURNS if turns else flow.SMOOTH


@dataclass(frozen=True, eq=False)
class FunctionsOfFamily:
    """The functions of the scenes of a family.

    Parameters
    ----------
    parts
        Those of one model, of which kernels read the classes.
    kinds, memories
        What each does where its rate passes 0, and the number of its memory, below 0 for none.
    numbers, series
        Numbers of one model, and Chebyshev coefficients (terms, numbers) over the range.
    sizes
        Numbers of coordinates, numbers of the longest part, and knots.
    pace
        1/s, the unit of rates.
    """

    parts: tuple[Any, ...]
    kinds: tuple[int, ...]
    memories: tuple[int, ...]
    numbers: Vector
    series: Matrix
    sizes: tuple[int, int, int]
    pace: float

    @classmethod
    def of(
        cls, model: Model, numbers: Vector, series: Matrix, widths: tuple[int, int], time: float
    ) -> FunctionsOfFamily:
        """The functions of a family, from one of its models, the numbers of that model and those
        over the range."""
        remembers = np.array([part.law.remembers for part in model.functions], bool)
        memories = np.where(remembers, np.cumsum(remembers) - 1, -1)
        return cls(
            parts=tuple(compiled(part) for part in model.functions),
            kinds=tuple(_kind(part) for part in model.functions),
            memories=tuple(memories.tolist()),
            numbers=numbers,
            series=series,
            sizes=(len(model.mass), *widths),
            pace=1.0 / time,
        )

    @property
    def remembering(self) -> int:
        """Number of memories."""
        return max(self.memories, default=-1) + 1

    def at(self, sigma: float) -> flow.Functions:
        """The functions at a place of the range."""
        found = np.polynomial.chebyshev.chebval(2.0 * sigma - 1.0, self.series)
        change = np.abs(self.series[1:]).sum(axis=0)
        numbers = np.where(change <= STEADY * np.abs(self.numbers), self.numbers, found)
        n, width, most = self.sizes
        rows = np.reshape(numbers, (len(self.parts), 2 * n + width + most))
        moved, changes = rows[:, :n].copy(), rows[:, n : 2 * n].copy()
        calls = Characteristics.of(
            list(self.parts), [Affine(0.0, 0.0, 0.0)] * len(self.parts), moved, changes,
            np.zeros(len(self.parts)), list(self.memories),
        )._replace(numbers=rows[:, 2 * n : 2 * n + width].copy())  # fmt: skip
        knots = rows[:, 2 * n + width :].copy()
        return flow.Functions(
            calls, self.pace, np.linalg.norm(moved, axis=1), knots, np.array(self.kinds, np.int64)
        )


# ------------------------------------------------------------------------------
# The numbers of a scene as functions of one of its keys, as the kernels take them.
# ------------------------------------------------------------------------------


MOST_HARMONICS = 32
"""Highest multiple of the lowest common frequency that a sum of sines may hold."""

COMMON = 1e-9
"""Relative difference up to which a frequency counts as a multiple of another one (rounding)."""

TERMS = (3, 5, 9, 17, 33, 65, 129, 257)
"""Numbers of Chebyshev terms that are tried: each uses the values of the one before."""

SERIES_END = 1e-13
"""Size of the last terms of a series, relative to the largest, that counts as rounding."""


@dataclass(frozen=True, eq=False)
class Numbers:
    """The numbers of one model that the motion between impacts needs, in SI units.

    Coordinates are scaled to unit masses: q = L' x with the mass matrix M = L L'. `forces`
    (n, 2 h + 1) are those of cos t, sin t, cos 2 t, ... and of a constant, t the phase, and x =
    shapes q. The kernels read all but the shapes.
    """

    stiffness: Matrix
    damping: Matrix
    forces: Matrix
    rows: Matrix
    distances: Vector
    restitutions: Vector
    omega: float
    output: Vector
    base: Vector
    shapes: Matrix

    @property
    def flat(self) -> Vector:
        """All numbers one after another, as one array."""
        return np.concatenate([np.ravel(getattr(self, field.name)) for field in fields(self)])

    @property
    def sizes(self) -> tuple[int, int, int]:
        """(n, m, h): coordinates, stops, harmonics."""
        return *self.rows.shape[::-1], (self.forces.shape[1] - 1) // 2

    def motion(self, units: Numbers) -> solver.Motion:
        """The numbers in these units, as the kernels take them."""
        series = (self.flat / units.flat)[None]
        motion: solver.Motion = solver.motion_at(solver.Expansion(series, *self.sizes), 0.5)
        return motion

    def units(self) -> tuple[Numbers, float, float]:
        """Units that make all numbers of order one, and those of length and time."""
        reach = float(np.max(np.linalg.norm(self.rows, axis=1), initial=0.0)) or 1.0
        rate = max(self.omega, math.sqrt(max(float(np.linalg.eigvalsh(self.stiffness)[-1]), 0.0)))
        pushed = reach * float(np.max(np.abs(self.forces))) / rate**2
        length = max(pushed, float(np.max(np.abs(self.distances), initial=0.0)))
        scales = {
            "stiffness": rate**2, "damping": rate, "forces": rate**2 * (length / reach),
            "rows": reach, "distances": length, "restitutions": 1.0, "omega": rate,
            "output": reach, "base": rate**2 * length, "shapes": reach,
        }  # fmt: skip
        units: dict[str, Any] = {
            name: np.full(np.shape(getattr(self, name)), unit) for name, unit in scales.items()
        }
        return Numbers(**units), length, 1.0 / rate


def parts_of(flat: Matrix, sizes: tuple[int, int, int]) -> dict[str, NDArray[np.float64]]:
    """The numbers by their names, each with a first axis of points, from (points, numbers)."""
    n, m, h = sizes
    w = 2 * h + 1
    shapes = {
        "stiffness": (n, n), "damping": (n, n), "forces": (n, w), "rows": (m, n),
        "distances": (m,), "restitutions": (m,), "omega": (), "output": (n,), "base": (w,),
        "shapes": (n, n),
    }  # fmt: skip
    ends = np.cumsum([math.prod(shape) for shape in shapes.values()])
    parts = np.split(flat, ends[:-1], axis=1)
    return {
        name: part.reshape(len(flat), *shape)
        for (name, shape), part in zip(shapes.items(), parts, strict=True)
    }


def amplitudes(
    flat: Matrix, sizes: tuple[int, int, int], stops: Sequence[int], periods: int, theta: Matrix,
    speeds: Matrix,
) -> Vector:  # fmt: skip
    """Amplitude of the first harmonic of the output of regimes, as of `first_harmonics`.

    Returns
    -------
    Vector
        (points,), in the unit of length of the numbers; NaN at resonance without damping.
    """  # fmt: skip
    moved = first_harmonics(flat, sizes, stops, periods, theta, speeds)
    output = parts_of(flat, sizes)["output"]
    return np.asarray(np.abs(np.einsum("pi,pi->p", output, moved)))


def first_harmonics(
    flat: Matrix, sizes: tuple[int, int, int], stops: Sequence[int], periods: int, theta: Matrix,
    speeds: Matrix,
) -> Waves:  # fmt: skip
    """First harmonics (points, n) of the coordinates of regimes, from their impulses.

    They are `q = (K - w^2 + i w C)^-1 (B_cos - i B_sin + w / (pi P) sum of J_k e^(-i theta_k))`. P
    is the number of periods, and J_k = -(1 + R) v_k row / (row . row) the change of q' by an
    impact.

    Parameters
    ----------
    flat, sizes
        Numbers (points, numbers), and (n, m, h).
    stops, periods, theta, speeds
        The regimes: stops that they hit, periods, and phases and speeds of the impacts (points,
        impacts).
    """
    parts = parts_of(flat, sizes)
    omega, word = parts["omega"][:, None], list(stops)
    pushed = parts["forces"][:, :, 0] - 1j * parts["forces"][:, :, 1]
    if word:
        rows, squares = parts["rows"], np.sum(parts["rows"] ** 2, axis=2)
        sizes_of_jumps = (1.0 + parts["restitutions"][:, word]) * speeds / squares[:, word]
        waves = -omega / (math.pi * periods) * sizes_of_jumps * np.exp(-1j * theta)
        pushed = pushed + np.einsum("pk,pki->pi", waves, rows[:, word])
    return forced(parts, omega[:, 0], pushed)


def forced(parts: Mapping[str, Matrix], omega: Vector, force: Waves) -> Waves:
    """Amplitudes (points, n) under forces of a frequency, without impacts: (K - w^2 + i w C)^-1 B;
    NaN at resonance without damping."""
    w, size = omega[:, None, None], parts["output"].shape[1]
    matrix = parts["stiffness"] - w**2 * np.eye(size) + 1j * w * parts["damping"]
    matrix[np.abs(np.linalg.det(matrix)) == 0.0] = np.nan * np.eye(size)
    return np.asarray(np.linalg.solve(matrix, force[:, :, None])[:, :, 0])


def unmet(model: Model, *, any_force: bool = False) -> list[str]:
    """The conditions of periodic regimes that a model does not meet, in sentences; `any_force` says
    that stops need not be rigid, and that springs and dampers may be functions."""
    if any_force:
        found = not_followed(model) + speed_restitutions(model) + rubbing(model)
    else:
        found = functions(model)
    found = [*found, *scattered(model)]
    kinds = "one whose force a simulation follows" if any_force else "'restitution'"
    found += [
        f"law.kind must be {kinds}, got {stop.law.kind!r} at the {stop.name} stop of {pair.name}"
        for pair in model.pairs
        for stop in pair.stops
        if not stop.rigid and not (any_force and stop.law.form() is not None)
    ]
    if not model.sines:
        found.append("the scene needs an excitation of kind = 'sine', got none")
    elif multiples(model) is None:
        sines = ", ".join(f"{sine.omega / (2.0 * math.pi):g}" for sine in model.sines)
        found.append(
            "the frequencies of the sines must be multiples of one, at most "
            f"{MOST_HARMONICS} times it, got {sines} Hz"
        )
    return found


def multiples(model: Model) -> tuple[int, ...] | None:
    """The frequency of each sine over the largest one that divides all; None without one."""
    omegas = np.array([sine.omega for sine in model.sines])
    for divisor in range(1, MOST_HARMONICS + 1):
        shares = omegas * divisor / omegas.min()
        whole = np.round(shares)
        if np.all(np.abs(shares - whole) <= COMMON * shares) and whole.max() <= MOST_HARMONICS:
            return tuple(int(each) for each in whole)
    return None


def whitening_of(model: Model) -> Matrix:
    """Matrix to coordinates with unit masses."""
    return np.asarray(np.linalg.inv(np.linalg.cholesky(model.mass)))


def numbers_of(model: Model, output: int) -> Numbers:
    """The numbers of a model; the output is one of its coordinates or points."""
    orders = multiples(model)
    assert orders is not None
    whitening = whitening_of(model)
    row, columns = model.output_rows[output], 2 * max(orders) + 1
    forces, base = np.zeros((len(whitening), columns)), np.zeros(columns)
    for sine, order in zip(model.sines, orders, strict=True):
        # amplitude cos(order t + phase)
        wave = sine.amplitude * np.array([math.cos(sine.phase), -math.sin(sine.phase)])
        part = slice(2 * order - 2, 2 * order)
        forces[:, part] += np.outer(whitening @ sine.direction, wave)
        if sine.on_base:
            # under a rigid body the base moves along one of the coordinates
            base[part] -= wave * (row @ np.linalg.solve(model.mass, sine.direction))
    forces[:, -1] = whitening @ model.constant_force
    stops = [(pair, stop) for pair in model.pairs for stop in pair.stops]
    rows = [stop.side * (whitening @ pair.direction) for pair, stop in stops]
    return Numbers(
        stiffness=whitening @ model.stiffness @ whitening.T,
        damping=whitening @ model.damping @ whitening.T,
        forces=forces,
        rows=np.array(rows).reshape(-1, len(whitening)),
        distances=np.array([stop.distance for _, stop in stops]),
        restitutions=np.array([stop.coefficient or 0.0 for _, stop in stops]),
        omega=model.sines[0].omega / orders[0],
        output=whitening @ row,
        base=base,
        shapes=whitening.T,
    )


@dataclass(frozen=True, eq=False)
class Family:
    """Scenes that differ in one number, from `low` to `high`: their numbers as Chebyshev series.

    Parameters
    ----------
    low, high
        The range. The parameter of the kernels, sigma, goes from 0 to 1 over it: in even ratios of
        the value where that is above 0, so that resolution is a share of the value, else evenly.
    series
        Chebyshev coefficients (terms, numbers) over the range, scaled.
    sizes
        (n, m, h): coordinates, stops, harmonics.
    laws
        Coefficients (terms, numbers) of the numbers of `_laws`, scaled.
    pieces
        Number of straight pieces of the force of each stop, 0 for a rigid one.
    stops
        "pair side" of each stop.
    length, time
        The units of the kernels, m and s.
    functions
        Springs and dampers that are functions.
    """

    low: float
    high: float
    series: Matrix
    laws: Matrix
    pieces: tuple[int, ...]
    sizes: tuple[int, int, int]
    stops: tuple[str, ...]
    length: float
    time: float
    functions: FunctionsOfFamily

    @classmethod
    def of(
        cls,
        model_at: Callable[[float], Model],
        low: float,
        high: float,
        coordinate: str | None,
    ) -> Family:
        """The family of the models at the values of a range.

        Raises
        ------
        NotApplicable
            If a model is not covered.
        """
        middle = model_at(_value(low, high, 0.5))
        if conditions := unmet(middle, any_force=True):
            raise NotApplicable("sine", conditions)
        number = 0 if coordinate is None else _place(middle, coordinate)
        numbers = numbers_of(middle, number)
        units, length, time = numbers.units()
        scale = units.flat
        reach = float(units.rows.flat[0]) if units.rows.size else 1.0
        forces = _forces(middle, length, time)
        most = max((len(force.pieces) for force in forces), default=0)
        widths, unit = widths_of(middle), length / reach

        def parts_at(model: Model) -> Vector:
            return numbers_of_functions(model, whitening_of(model), unit, time, widths)

        def at(x: float) -> Vector:
            model = model_at(_value(low, high, 0.5 * (1.0 + x)))
            laws = _laws(_forces(model, length, time), reach, most)
            flat = numbers_of(model, number).flat / scale
            return np.concatenate([flat, laws.ravel(), parts_at(model)])

        series = _series(at)
        ends = np.cumsum([len(scale), len(forces) * (2 + 3 * most)])
        return cls(
            low=low,
            high=high,
            series=np.ascontiguousarray(series[:, : ends[0]]),
            laws=series[:, ends[0] : ends[1]],
            pieces=tuple(len(force.pieces) for force in forces),
            sizes=numbers.sizes,
            stops=tuple(f"{pair.name} {stop.name}" for pair in middle.pairs for stop in pair.stops),
            length=length,
            time=time,
            functions=FunctionsOfFamily.of(
                middle, parts_at(middle), series[:, ends[1] :], widths, time
            ),
        )

    @property
    def speed(self) -> float:
        """The unit of speed of the kernels, m/s."""
        return self.length / self.time

    @property
    def expansion(self) -> solver.Expansion:
        """The numbers over the range, as the kernels take them."""
        return solver.Expansion(self.series, *self.sizes)

    def laws_at(self, sigma: float) -> flow.Laws:
        """The forces of the stops at a place of the range."""
        numbers = np.polynomial.chebyshev.chebval(2.0 * sigma - 1.0, self.laws)
        # damper, Hertz's coefficient and pieces of each stop; there may be none
        rows = np.reshape(numbers, (len(self.pieces), -1)) if self.pieces else np.zeros((0, 2))
        pieces = np.ascontiguousarray(rows[:, 2:]).reshape(len(rows), (rows.shape[1] - 2) // 3, 3)
        return flow.Laws(np.array(self.pieces), pieces, rows[:, 0].copy(), rows[:, 1].copy())

    def value(self, sigma: Vector | float) -> Vector:
        """The number that is varied."""
        return np.asarray(_value(self.low, self.high, np.asarray(sigma)))

    def sigma(self, value: Vector | float) -> Vector:
        """The parameter of the kernels at a value."""
        value = np.asarray(value, dtype=float)
        if self.low > 0.0:
            return np.asarray(np.log(value / self.low) / self.span)
        return np.asarray((value - self.low) / (self.high - self.low))

    @property
    def span(self) -> float:
        """Relative change of the value over the range."""
        if self.low > 0.0:
            return math.log(self.high / self.low)
        return (self.high - self.low) / max(abs(self.low), abs(self.high))

    def states(self, starts: Matrix, sigma: Vector) -> dict[str, Matrix]:
        """Displacements (m) and velocities (m/s) of the coordinates, from states of the kernels."""
        n, shapes = self.sizes[0], parts_of(self.flat(sigma), self.sizes)["shapes"]
        moved, moving = starts[:, :n], starts[:, n : 2 * n]
        return {
            "displacement": self.length * np.einsum("kij,kj->ki", shapes, moved),
            "velocity": self.speed * np.einsum("kij,kj->ki", shapes, moving),
        }

    def frequency_hz(self, sigma: Vector | float) -> Vector:
        """Frequency of the force."""
        omega = parts_of(self.flat(sigma), self.sizes)["omega"].reshape(np.shape(sigma))
        return np.asarray(omega / self.time / (2.0 * math.pi))

    def flat(self, sigma: Vector | float) -> Matrix:
        """The scaled numbers (points, numbers) at places of the range."""
        at = 2.0 * np.atleast_1d(sigma) - 1.0
        return np.asarray(np.polynomial.chebyshev.chebval(at, self.series).T)


def _value(low: float, high: float, sigma: Any) -> Any:
    """The value at a place of a range."""
    if low > 0.0:
        return low * (high / low) ** sigma
    return low + sigma * (high - low)


class Force(NamedTuple):
    """Force of a stop: of each straight piece the depth and the force at which it begins and its
    slope (pieces, 3), none of a rigid one; coefficients of a damper and of Hertz's law."""

    pieces: Matrix
    damper: float = 0.0
    hertz: float = 0.0


def _force(pair: Pair, stop: Stop, length: float, time: float) -> Force:
    """The force of a stop in the units of the kernels, where a unit force gives a unit mass a unit
    acceleration."""
    form = stop.law.per_unit_mass(pair.mass).scaled(length, time).form()
    assert form is not None, "other laws are refused"
    numbers = pair.mass * form.numbers
    if form.name == "rigid":
        return Force(np.empty((0, 3)))
    if form.name == "pieces":
        return Force(np.column_stack([form.numbers[:, 0], numbers[:, 1:]]))
    if form.name == "damped":
        ((stiffness, damper),) = numbers
        return Force(np.array([[0.0, 0.0, stiffness]]), damper=damper)
    return Force(np.zeros((1, 3)), hertz=float(numbers[0, 0]))


def _forces(model: Model, length: float, time: float) -> list[Force]:
    return [_force(pair, stop, length, time) for pair in model.pairs for stop in pair.stops]


def _laws(forces: Sequence[Force], reach: float, most: int) -> Matrix:
    """Numbers of the forces for rows of a length: damper, Hertz's coefficient and the pieces, up to
    the largest number of them, of each stop in turn."""
    found = np.zeros((len(forces), 2 + 3 * most))
    for row, force in zip(found, forces, strict=True):
        row[:2] = reach**2 * force.damper, reach**2 * force.hertz
        row[2 : 2 + force.pieces.size] = np.ravel(force.pieces * [1.0, reach**2, reach**2])
    return found


def _place(model: Model, coordinate: str) -> int:
    if coordinate not in model.outputs:
        known = ", ".join(model.outputs)
        raise ValueError(f"coordinate must be one of {known}, got {coordinate!r}")
    return model.outputs.index(coordinate)


def _series(at: Callable[[float], Vector]) -> Matrix:
    """Chebyshev coefficients of a function on [-1, 1], as many as rounding leaves."""
    known: dict[float, Vector] = {}
    for terms in TERMS:
        places = np.cos(np.pi * np.arange(terms) / (terms - 1))
        for place in places:
            key = round(float(place), 14)
            if key not in known:
                known[key] = at(float(place))
        values = np.array([known[round(float(place), 14)] for place in places])
        coefficients = _transformed(values)
        size = np.max(np.abs(values), axis=0)
        if np.all(np.abs(coefficients[-2:]) <= SERIES_END * np.maximum(size, 1e-300) * terms):
            break
    else:
        raise NotApplicable(
            "sine",
            "vary must name a key on which the scene depends smoothly, got one with a jump or "
            "a kink in its range; vary a shorter range",
        )
    last = np.flatnonzero(np.any(np.abs(coefficients) > SERIES_END * size, axis=1)).max(initial=0)
    return np.ascontiguousarray(coefficients[: last + 1])


def _transformed(values: Matrix) -> Matrix:
    """Chebyshev coefficients from values at cos(pi k / N)."""
    last = len(values) - 1
    k = np.arange(last + 1)
    weights = np.where((k == 0) | (k == last), 0.5, 1.0)
    cosines = np.cos(np.pi * np.outer(k, k) / last)
    return np.asarray(2.0 / last * weights[:, None] * (cosines @ (weights[:, None] * values)))


# ------------------------------------------------------------------------------
# States of a scene by the names of its coordinates, and as the kernels take them.
# ------------------------------------------------------------------------------


class States:
    """States of a model at one place of its family, in m and m/s and in the units of the kernels.

    A state is a row of 2 n numbers: the displacements of the coordinates and then their velocities.
    """

    def __init__(self, model: Model, family: Family, sigma: float) -> None:
        self.model, self.time = model, family.time
        n = len(model.mass)
        # displacements (m) of the coordinates per unit of those of the kernels
        known = family.states(np.eye(n, 2 * n), np.full(n, sigma))
        self._shapes = known["displacement"].T

    @property
    def names(self) -> list[str]:
        """Names of the numbers of a state, in their order."""
        return [
            f"{what}.{name}"
            for what in ("displacement", "velocity")
            for name in self.model.coordinates
        ]

    def physical(self, states: Matrix) -> Matrix:
        """States (number, 2 n), m and m/s, from those of the kernels."""
        return self._turned(states, self._shapes, 1.0 / self.time)

    def scaled(self, states: Matrix) -> Matrix:
        """States of the kernels from those in m and m/s."""
        return self._turned(states, np.asarray(np.linalg.inv(self._shapes)), self.time)

    @staticmethod
    def _turned(states: Matrix, shapes: Matrix, rate: float) -> Matrix:
        n = len(shapes)
        return np.hstack([states[:, :n] @ shapes.T, rate * states[:, n:] @ shapes.T])

    def starts(self, given: Mapping[str, ArrayLike]) -> Matrix:
        """States of the kernels with some numbers given by name (number,), m or m/s; all others are
        those at rest under the constant loads, where a free mass is at 0.

        Raises
        ------
        ValueError
            If a name is not one of the scene.
        """
        model, n = self.model, len(self.model.mass)
        if unknown := set(given) - set(self.names):
            raise ValueError(
                f"start must name some of {', '.join(self.names)}, got {', '.join(sorted(unknown))}"
            )
        number = max((np.size(values) for values in given.values()), default=1)
        states = np.zeros((number, 2 * n))
        states[:, :n] = np.linalg.pinv(model.stiffness, hermitian=True) @ model.constant_force
        for name, values in given.items():
            states[:, self.names.index(name)] = values
        return self.scaled(states)
