"""The numbers of a scene as functions of one of its keys, as the kernels take them."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stochvi.model.coverage import functions
from stochvi.model.model import Model
from stochvi.results.errors import NotApplicable

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]

MOST_HARMONICS = 32
"""Highest multiple of the lowest common frequency that a sum of sines may hold."""

COMMON = 1e-9
"""Relative difference up to which a frequency counts as a multiple of another one (rounding)."""

TERMS = (3, 5, 9, 17, 33, 65, 129, 257)
"""Numbers of Chebyshev terms that are tried: each uses the values of the one before."""

ROUNDING = 1e-13
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
        """All of them one after another."""
        parts = (
            self.stiffness, self.damping, self.forces, self.rows, self.distances,
            self.restitutions, [self.omega], self.output, self.base,
            self.shapes,
        )  # fmt: skip
        return np.concatenate([np.ravel(part) for part in parts])

    def units(self) -> tuple[Numbers, float, float]:
        """The units in which all numbers are of order one, and of these the length and the time."""
        reach = float(np.max(np.linalg.norm(self.rows, axis=1), initial=0.0)) or 1.0
        rate = max(self.omega, math.sqrt(max(float(np.linalg.eigvalsh(self.stiffness)[-1]), 0.0)))
        pushed = reach * float(np.max(np.abs(self.forces))) / rate**2
        length = max(pushed, float(np.max(np.abs(self.distances), initial=0.0)))
        q = length / reach
        shapes = [np.ones_like(part) for part in (self.stiffness, self.forces, self.rows)]
        return (
            Numbers(
                stiffness=shapes[0] * rate**2,
                damping=shapes[0] * rate,
                forces=shapes[1] * rate**2 * q,
                rows=shapes[2] * reach,
                distances=np.full_like(self.distances, length),
                restitutions=np.ones_like(self.restitutions),
                omega=rate,
                output=np.full_like(self.output, reach),
                base=np.full_like(self.base, rate**2 * length),
                shapes=shapes[0] * reach,
            ),
            length,
            1.0 / rate,
        )


def unmet(model: Model) -> list[str]:
    """What keeps the periodic regimes of a model from being found, in sentences."""
    found = functions(model)
    found += [
        f"law.kind must be 'restitution', got {stop.law.kind!r} at the {stop.name} stop of "
        f"{pair.name}"
        for pair in model.pairs
        for stop in pair.stops
        if not stop.rigid
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


def numbers_of(model: Model, coordinate: int) -> Numbers:
    """The numbers of a model; the output is one of its coordinates."""
    orders = multiples(model)
    assert orders is not None
    whitening = np.linalg.inv(np.linalg.cholesky(model.mass))
    columns = 2 * max(orders) + 1
    forces, base = np.zeros((len(whitening), columns)), np.zeros(columns)
    for sine, order in zip(model.sines, orders, strict=True):
        # amplitude cos(order t + phase)
        wave = sine.amplitude * np.array([math.cos(sine.phase), -math.sin(sine.phase)])
        part = slice(2 * order - 2, 2 * order)
        forces[:, part] += np.outer(whitening @ sine.direction, wave)
        if sine.on_base:
            # of a rigid body, the base moves along one of the coordinates
            base[part] -= wave * np.linalg.solve(model.mass, sine.direction)[coordinate]
    forces[:, -1] = whitening @ model.constant_force
    stops = [(pair, stop) for pair in model.pairs for stop in pair.stops]
    rows = [stop.side * (whitening @ pair.direction) for pair, stop in stops]
    return Numbers(
        stiffness=whitening @ model.stiffness @ whitening.T,
        damping=whitening @ model.damping @ whitening.T,
        forces=forces,
        rows=np.array(rows).reshape(-1, len(whitening)),
        distances=np.array([stop.distance for _, stop in stops]),
        restitutions=np.array([stop.coefficient for _, stop in stops], dtype=float),
        omega=model.sines[0].omega / orders[0],
        output=whitening[:, coordinate],
        base=base,
        shapes=whitening.T,
    )


@dataclass(frozen=True, eq=False)
class Family:
    """Scenes that differ in one number, from `low` to `high`: their numbers as Chebyshev series.

    Parameters
    ----------
    low, high
        The range; sigma = (value - low) / (high - low) is the parameter of the kernels.
    series
        Chebyshev coefficients (terms, numbers) over the range, scaled.
    sizes
        (n, m, h): coordinates, stops, harmonics.
    stops
        "pair side" of each stop.
    length, time
        The units of the kernels, m and s.
    """

    low: float
    high: float
    series: Matrix
    sizes: tuple[int, int, int]
    stops: tuple[str, ...]
    length: float
    time: float

    @classmethod
    def of(
        cls, model_at: Callable[[float], Model], low: float, high: float, coordinate: str | None
    ) -> Family:
        """The family of the models at the values of a range.

        Raises
        ------
        NotApplicable
            If a model is not covered.
        """
        middle = model_at(0.5 * (low + high))
        if conditions := unmet(middle):
            raise NotApplicable("sine", conditions)
        number = 0 if coordinate is None else _place(middle, coordinate)
        numbers = numbers_of(middle, number)
        units, length, time = numbers.units()
        scale = units.flat

        def at(x: float) -> Vector:
            model = model_at(low + 0.5 * (1.0 + x) * (high - low))
            return np.asarray(numbers_of(model, number).flat / scale)

        pairs = [(pair, stop) for pair in middle.pairs for stop in pair.stops]
        return cls(
            low=low,
            high=high,
            series=_series(at),
            sizes=(len(middle.mass), len(pairs), (numbers.forces.shape[1] - 1) // 2),
            stops=tuple(f"{pair.name} {stop.name}" for pair, stop in pairs),
            length=length,
            time=time,
        )

    @property
    def speed(self) -> float:
        """The unit of speed of the kernels, m/s."""
        return self.length / self.time

    def value(self, sigma: Vector | float) -> Vector:
        """The number that is varied."""
        return np.asarray(self.low + np.asarray(sigma) * (self.high - self.low))

    def sigma(self, value: Vector | float) -> Vector:
        """The parameter of the kernels at a value."""
        return np.asarray((np.asarray(value, dtype=float) - self.low) / (self.high - self.low))

    def states(self, starts: Matrix, sigma: Vector) -> dict[str, Matrix]:
        """Displacements (m) and velocities (m/s) of the coordinates, from states of the kernels."""
        n = self.sizes[0]
        at = 2.0 * np.asarray(sigma) - 1.0
        flat = np.polynomial.chebyshev.chebval(at, self.series[:, -n * n :])
        shapes = flat.T.reshape(-1, n, n)
        moved, moving = starts[:, :n], starts[:, n:]
        return {
            "displacement": self.length * np.einsum("kij,kj->ki", shapes, moved),
            "velocity": self.speed * np.einsum("kij,kj->ki", shapes, moving),
        }

    def frequency_hz(self, sigma: Vector | float) -> Vector:
        """Frequency of the force."""
        n, m, h = self.sizes
        place = 2 * n * n + n * (2 * h + 1) + m * n + 2 * m
        at = 2.0 * np.asarray(sigma) - 1.0
        omega = np.polynomial.chebyshev.chebval(at, self.series[:, place])
        return np.asarray(omega / self.time / (2.0 * math.pi))


def _place(model: Model, coordinate: str) -> int:
    if coordinate not in model.coordinates:
        known = ", ".join(model.coordinates)
        raise ValueError(f"coordinate must be one of {known}, got {coordinate!r}")
    return model.coordinates.index(coordinate)


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
        if np.all(np.abs(coefficients[-2:]) <= ROUNDING * np.maximum(size, 1e-300) * terms):
            break
    else:
        raise NotApplicable(
            "sine", ["the numbers of the scene must be smooth functions of the key that is varied"]
        )
    last = np.flatnonzero(np.any(np.abs(coefficients) > ROUNDING * size, axis=1)).max(initial=0)
    return np.ascontiguousarray(coefficients[: last + 1])


def _transformed(values: Matrix) -> Matrix:
    """Chebyshev coefficients from values at cos(pi k / N)."""
    last = len(values) - 1
    k = np.arange(last + 1)
    weights = np.where((k == 0) | (k == last), 0.5, 1.0)
    cosines = np.cos(np.pi * np.outer(k, k) / last)
    return np.asarray(2.0 / last * weights[:, None] * (cosines @ (weights[:, None] * values)))
