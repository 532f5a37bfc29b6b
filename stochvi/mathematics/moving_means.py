"""Gaussian displacements beside sines: means that move, and how often a level is crossed.

Noise moves a displacement with the standard deviations s and s' of place and velocity. Sines of
random phases add m(t) = Re sum_k a_k exp(i (w_k t + theta_k)). At phases at which the mean is m
and its rate m', the level u is crossed upwards so many times a second (S. O. Rice 1944):

    nu = phi((u - m) / s) s' / s psi(m' / s'),    psi(r) = phi(r) + r Phi(r)

The slope p of such a crossing has a density in proportion to p exp(-(p - m')^2 / (2 s'^2)). A
level is crossed at phases with a probability in proportion to nu. Averages over phases are sums
over the points of a net of Sobol'.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq
from scipy.special import ndtr

from stochvi.mathematics.arrays import Matrix, Vector, Waves
from stochvi.mathematics.impact_rates import rice_rate

PHASES = 2**13
"""Number of phases over which rates are averaged. For one sine they are evenly spaced."""

HALVINGS = 60
"""Number of halvings by which a slope is found: all digits."""

ROOT_2_PI = math.sqrt(2.0 * math.pi)


class Sines(NamedTuple):
    """Sines with random phases that move displacements: frequencies (rad/s), and the complex
    amplitudes (displacements, sines) of each."""

    omega: Vector
    waves: Waves

    @property
    def number(self) -> int:
        """Number of sines."""
        return len(self.omega)

    def at(self, phases: Vector) -> tuple[Matrix, Matrix]:
        """Displacements and velocities (displacements, ...) at phases (..., sines)."""
        shape = (len(self.waves), *phases.shape[:-1])
        turns = np.exp(1j * phases.reshape(math.prod(shape[1:]), self.number).T)
        turning, rates = self.waves @ turns, (1j * self.omega * self.waves) @ turns
        return turning.real.reshape(shape), rates.real.reshape(shape)

    def of(self, rows: Matrix) -> Sines:
        """The sines of combinations (rows, displacements) of these displacements."""
        return Sines(self.omega, rows @ self.waves)

    @property
    def mean_squares(self) -> tuple[Vector, Vector]:
        """Mean squares (displacements,) of displacement and velocity."""
        squares = 0.5 * np.abs(self.waves) ** 2
        return squares.sum(axis=1), squares @ self.omega**2


@lru_cache(maxsize=8)
def even_phases(sines: int, count: int = PHASES) -> Matrix:
    """(count, sines): phases that fill the torus evenly, the first sine's rising."""
    if not sines:
        return np.zeros((1, 0))
    from scipy.stats import qmc

    net = qmc.Sobol(sines, scramble=False).random_base2(round(math.log2(count)))
    return np.asarray(2.0 * math.pi * net[np.argsort(net[:, 0], kind="stable")])


class Crossings(NamedTuple):
    """Upcrossings of a level: place and slope of the noise alone, and phases (..., sines)."""

    place: Vector
    slope: Vector
    phases: Matrix


@dataclass(frozen=True, eq=False)
class MovingMean:
    """One displacement under Gaussian noise beside sines.

    Parameters
    ----------
    place, speed
        Standard deviations of displacement and velocity under noise alone, m and m/s.
    sines
        The sines of this displacement alone, waves (1, sines).
    """

    place: float
    speed: float
    sines: Sines

    @classmethod
    def still(cls, place: float, speed: float) -> MovingMean:
        """A displacement under noise alone, of these standard deviations, m and m/s."""
        return cls(place, speed, Sines(np.zeros(0), np.zeros((1, 0), complex)))

    def louder(self, gain: float) -> MovingMean:
        """The displacement under noise and sines that are larger by a factor."""
        sines = Sines(self.sines.omega, gain * self.sines.waves)
        return MovingMean(gain * self.place, gain * self.speed, sines)

    @property
    def deviations(self) -> tuple[float, float]:
        """Standard deviations of displacement and velocity, sines included."""
        squares = [float(each[0]) for each in self.sines.mean_squares]
        return math.hypot(self.place, math.sqrt(squares[0])), math.hypot(
            self.speed, math.sqrt(squares[1])
        )

    @property
    def reach(self) -> float:
        """Largest displacement by the sines alone, m."""
        return float(np.abs(self.sines.waves).sum())

    def rates_at(self, distance: float, phases: Matrix) -> Vector:
        """Upcrossings of a level per second at given phases (..., sines)."""
        means, rates = (each[0] for each in self.sines.at(phases))
        height, turn = (distance - means) / self.place, rates / self.speed
        density = np.exp(-0.5 * height**2) / ROOT_2_PI
        return np.asarray(density * self.speed / self.place * _upward(turn))

    def rate(self, distance: float) -> float:
        """Upcrossings of a level per second, averaged over phases.

        >>> round(MovingMean.still(1.0, 1.0).rate(3.0), 7)
        0.0017681
        """
        if math.isinf(distance):
            return 0.0
        if not self.sines.number:
            return rice_rate(distance, self.place, self.speed)
        return float(self.rates_at(distance, even_phases(self.sines.number)).mean())

    def distance_of(self, rate: float) -> float:
        """The level above the mean, m, that is crossed so many times a second; 0 where none is."""
        zero = rice_rate(0.0, self.place, self.speed)
        if not self.sines.number:
            return self.place * math.sqrt(2.0 * max(math.log(zero / rate), 0.0))
        if self.rate(0.0) <= rate:
            return 0.0
        highest = self.reach + self.place
        while self.rate(highest) > rate:
            highest += self.place
        return float(brentq(lambda c: math.log(max(self.rate(c), 1e-320) / rate), 0.0, highest))

    def beyond(self, distance: float) -> float:
        """Probability that the displacement is beyond a level."""
        means = self.sines.at(even_phases(self.sines.number))[0][0]
        return float(ndtr(-(distance - means) / self.place).mean())

    def crossings(self, distance: float, units: Vector, shares: Vector | None) -> Crossings:
        """Upcrossings of a level, from random numbers of the unit Rayleigh distribution (...) and,
        beside sines, from random numbers between 0 and 1 (...) that choose the phases."""
        if shares is None or math.isinf(distance):
            flat = np.zeros((*units.shape, self.sines.number))
            return Crossings(np.full(units.shape, distance), self.speed * units, flat)
        net = even_phases(self.sines.number)
        likely = np.cumsum(self.rates_at(distance, net))
        chosen = np.searchsorted(likely, shares * likely[-1], side="right")
        phases = net[np.minimum(chosen, len(net) - 1)]
        means, rates = (each[0] for each in self.sines.at(phases))
        slope = self.speed * slopes(units, rates / self.speed) - rates
        return Crossings(distance - means, slope, phases)


def _upward(turn: Vector) -> Vector:
    """psi(r), the mean of the positive part of a normal number of mean r."""
    return np.asarray(np.exp(-0.5 * turn**2) / ROOT_2_PI + turn * ndtr(turn))


def slopes(units: Vector, turn: Vector) -> Vector:
    """Slopes p > 0 over s' with the density p exp(-(p - r)^2 / 2), from numbers of the unit
    Rayleigh distribution: at equal quantiles. Where r is 0 they are those numbers.

    The slopes above p have the share (phi(p - r) + r Phi(r - p)) / psi(r).

    >>> slopes(np.array([1.3]), np.array([0.0])).round(12).tolist()
    [1.3]
    """
    wanted = np.exp(-0.5 * units**2) * _upward(turn)
    low, high = np.zeros_like(units), units + np.maximum(turn, 0.0)
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        past = middle - turn
        more = np.exp(-0.5 * past**2) / ROOT_2_PI + turn * ndtr(-past) > wanted
        low, high = np.where(more, middle, low), np.where(more, high, middle)
    return np.asarray(0.5 * (low + high))
