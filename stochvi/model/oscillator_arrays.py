"""Arrays of oscillators between rigid stops under white noise, for methods that solve many at once.

Every oscillator obeys, per unit mass,

    x'' + damping_rate x' + omega^2 x = white noise of the intensity S0 + load,

and leaves a stop that it meets at the speed w with the speed R w.
"""

from __future__ import annotations

import math
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stochvi.mathematics.arrays import Booleans, Vector
from stochvi.model.model import UPPER, Model


class OscillatorArrays(NamedTuple):
    """Oscillators per unit mass as arrays of one length, SI units.

    Parameters
    ----------
    omega, damping_rate, intensity, load
        Natural frequency (rad/s), b (1/s), S0 (m^2/s^3) and constant load (m/s^2).
    positions
        Positions of the lower and the upper stops (2, oscillators), m from the unloaded spring;
        infinite for no stop.
    restitutions
        R of the lower and the upper stops (2, oscillators); it has no meaning where there is no
        stop.

    Examples
    --------
    >>> found = OscillatorArrays.broadcast(omega=[1.0, 2.0], damping_rate=0.1, intensity=0.2)
    >>> found.omega, found.upper
    (array([1., 2.]), array([inf, inf]))
    """

    omega: Vector
    damping_rate: Vector
    intensity: Vector
    load: Vector
    positions: Vector
    restitutions: Vector

    @property
    def lower(self) -> Vector:
        """Positions of the lower stops, m; -inf for no stop."""
        return np.asarray(self.positions[0])

    @property
    def upper(self) -> Vector:
        """Positions of the upper stops, m; inf for no stop."""
        return np.asarray(self.positions[1])

    @classmethod
    def broadcast(
        cls,
        *,
        omega: ArrayLike,
        damping_rate: ArrayLike,
        intensity: ArrayLike,
        load: ArrayLike = 0.0,
        lower: ArrayLike = -math.inf,
        upper: ArrayLike = math.inf,
        restitution_lower: ArrayLike = 1.0,
        restitution_upper: ArrayLike = 1.0,
    ) -> Self:
        """Columns of one shape from numbers and arrays that are broadcast against each other."""
        stops = (lower, upper, restitution_lower, restitution_upper)
        columns = (omega, damping_rate, intensity, load, *stops)
        full = np.broadcast_arrays(*(np.asarray(column, dtype=float) for column in columns))
        positions, restitutions = np.stack(full[4:6]), np.stack(full[6:])
        return cls._make([*full[:4], positions, restitutions])

    @classmethod
    def of(cls, model: Model) -> Self:
        """The one oscillator of a model with rigid stops, as arrays of the length 1."""
        positions, restitutions = np.array([[-math.inf], [math.inf]]), np.ones((2, 1))
        for stop in model.stops_per_unit_mass:
            row = int(stop.side == UPPER)
            positions[row] = stop.position
            if stop.coefficient is not None:
                restitutions[row] = stop.coefficient
            elif stop.scattered:  # the one that takes the same energy
                restitutions[row] = math.sqrt(stop.law.restitution_mean_square)
        return cls(
            omega=np.array([model.omega]),
            damping_rate=np.array([model.damping_rate]),
            intensity=np.array([model.intensity]),
            load=np.array([model.load]),
            positions=positions,
            restitutions=restitutions,
        )

    def flat(self) -> OscillatorArrays:
        """The same oscillators as arrays of one dimension."""
        axes = self.omega.ndim
        return OscillatorArrays._make(
            column.reshape(*column.shape[: column.ndim - axes], -1) for column in self
        )

    def take(self, places: Booleans | NDArray[np.intp] | slice) -> OscillatorArrays:
        """Some of the oscillators, by index, by mask or by slice."""
        return OscillatorArrays._make(column[..., places] for column in self)

    @property
    def elastic(self) -> Booleans:
        """Whether no stop loses energy."""
        lossless = (self.restitutions == 1.0) | np.isinf(self.positions)
        return np.asarray(lossless.all(axis=0), dtype=np.bool_)

    @property
    def held(self) -> Booleans:
        """Whether spring, or stops and load, keep the oscillator from being lost on either side."""
        kept = np.isfinite(self.positions) | np.stack([self.load > 0.0, self.load < 0.0])
        return np.asarray((self.omega > 0.0) | kept.all(axis=0), dtype=np.bool_)

    def force(self, x: Vector) -> Vector:
        """Force of spring and load per unit mass at the displacements x, m/s^2."""
        return np.asarray(self.load - self.omega**2 * x)

    def lowest(self) -> Vector:
        """Displacement between the stops at which the potential energy is lowest, m.

        Without spring and load, where all places are alike, it is the one nearest to 0.
        """
        with np.errstate(divide="ignore", invalid="ignore"):
            rest = self.load / self.omega**2
        rest = np.where(np.isnan(rest), 0.0, rest)
        return np.asarray(np.clip(rest, *self.positions))

    def climb(self, energy: Vector) -> Vector:
        """Distance from the lowest place over which the potential energy rises by `energy`, m.

        Parameters
        ----------
        energy
            Energy per unit mass, m^2/s^2. The distance is infinite where no spring and no load
            raises the potential.
        """
        slope = np.abs(self.force(self.lowest()))
        with np.errstate(divide="ignore", invalid="ignore"):
            # at a position of rest between the stops the slope is 0, but for rounding
            inside = self.load / self.omega**2 == self.lowest()
            slope = np.where(inside, 0.0, slope)
            distance = 2.0 * energy / (slope + np.sqrt(slope**2 + 2.0 * self.omega**2 * energy))
        return np.asarray(distance)

    def check(self) -> None:
        """Refuse numbers that are out of range.

        Raises
        ------
        ValueError
            The message names the first column that holds such a number.
        """
        (lower, upper), (r_lower, r_upper) = self.positions, self.restitutions
        columns = {
            "omega": self.omega, "damping_rate": self.damping_rate, "intensity": self.intensity,
            "load": self.load, "lower": lower, "upper": upper,
            "restitution_lower": r_lower, "restitution_upper": r_upper,
        }  # fmt: skip
        for name, column in columns.items():
            if np.isnan(column).any():
                raise ValueError(f"{name} must be numbers, got nan")
            if name not in ("lower", "upper") and np.isinf(column).any():
                raise ValueError(f"{name} must be finite, got inf")
            if name in ("omega", "damping_rate", "intensity") and (column < 0.0).any():
                raise ValueError(f"{name} must be at least 0, got {column.min():g}")
            outside = (column < 0.0) | (column > 1.0)
            if name.startswith("restitution") and outside.any():
                raise ValueError(f"{name} must be in [0, 1], got {column[outside][0]:g}")
        crossed = np.flatnonzero(~(lower < upper))
        if crossed.size:
            index = crossed[0]
            raise ValueError(
                f"lower must be below upper, got {lower.flat[index]:g} and {upper.flat[index]:g} "
                f"at index {index}"
            )

    def unmet(self) -> list[str]:
        """The conditions of a stationary state that not all of the oscillators meet."""
        unmet = []
        if (self.intensity == 0.0).any():
            unmet.append("intensity must be positive in every scene, got 0")
        if (self.elastic & (self.damping_rate == 0.0)).any():
            unmet.append("damping_rate must be positive where no stop takes energy, got 0")
        if not self.held.all():
            unmet.append("omega must be positive where stops do not hold the mass, got 0")
        return unmet
