"""Gaussian displacements beside sines or shocks: means that move, and how often a level is crossed.

Noise moves a displacement with the standard deviations s and s' of place and velocity. Sines of
random phases add m(t) = Re sum_k a_k exp(i (w_k t + theta_k)). At phases at which the mean is m
and its rate m', the level u is crossed upwards so many times a second (S. O. Rice 1944):

    nu = phi((u - m) / s) s' / s psi(m' / s'),    psi(r) = phi(r) + r Phi(r)

The slope p of such a crossing has a density in proportion to p exp(-(p - m')^2 / (2 s'^2)). A
level is crossed at phases with a probability in proportion to nu. Averages over phases are sums
over the points of a net of Sobol'. Shocks at random times are such means as well: their ages and
sizes (`random_shocks`) take the place of phases, with probabilities of their own.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq
from scipy.special import ndtr

from stochvi.mathematics.arrays import Matrix, Vector, Waves
from stochvi.mathematics.impact_rates import rice_rate
from stochvi.mathematics.random_shocks import Shocks

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

    @property
    def net(self) -> tuple[Matrix, Vector]:
        """Phases (points, sines), and their probabilities (points,)."""
        phases = even_phases(self.number)
        return phases, np.full(len(phases), 1.0 / len(phases))

    @property
    def coarse_net(self) -> tuple[Matrix, Vector]:
        """The same with half as many points."""
        phases = even_phases(self.number, PHASES // 2)
        return phases, np.full(len(phases), 1.0 / len(phases))

    @property
    def reach(self) -> Vector:
        """(displacements,): largest displacements."""
        return np.asarray(np.abs(self.waves).sum(axis=1))

    @property
    def symmetric(self) -> bool:
        """Whether the opposite motion is as likely."""
        return True

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
    """Upcrossings of a level: place and slope of the noise alone, and states of what is beside it,
    as phases (..., sines)."""

    place: Vector
    slope: Vector
    phases: Matrix


@dataclass(frozen=True, eq=False)
class MovingMean:
    """One displacement under Gaussian noise beside sines, or beside shocks.

    Parameters
    ----------
    place, speed
        Standard deviations of displacement and velocity under noise alone, m and m/s.
    sines
        The sines of this displacement alone, waves (1, sines).
    shocks
        Shocks of this displacement alone instead of sines; None for none.
    """

    place: float
    speed: float
    sines: Sines
    shocks: Shocks | None = None

    @classmethod
    def still(cls, place: float, speed: float) -> MovingMean:
        """A displacement under noise alone, of these standard deviations, m and m/s."""
        return cls(place, speed, Sines(np.zeros(0), np.zeros((1, 0), complex)))

    @property
    def beside(self) -> Sines | Shocks:
        """What moves the mean."""
        return self.shocks or self.sines

    def towards(self, side: float) -> MovingMean:
        """The displacement, positive towards a stop of this side; itself where either direction is
        as likely."""
        return self if side > 0.0 or self.beside.symmetric else self.louder(-1.0)

    def louder(self, gain: float) -> MovingMean:
        """The displacement under noise and all beside it that are larger by a factor."""
        sines, shocks = self.sines.of(np.array([[gain]])), self.shocks
        if shocks is not None:
            shocks = shocks.of(np.array([[gain]]))
        return MovingMean(abs(gain) * self.place, abs(gain) * self.speed, sines, shocks)

    @property
    def deviations(self) -> tuple[float, float]:
        """Standard deviations of displacement and velocity, sines or shocks
        included."""
        squares = [float(each[0]) for each in self.beside.mean_squares]
        return math.hypot(self.place, math.sqrt(squares[0])), math.hypot(
            self.speed, math.sqrt(squares[1])
        )

    @property
    def reach(self) -> float:
        """Largest displacement by the sines alone, or by one shock of size 1, m."""
        return float(self.beside.reach[0])

    def rates_at(self, distance: float, phases: Matrix) -> Vector:
        """Upcrossings of a level per second at given phases (..., sines), or states of shocks."""
        means, rates = (each[0] for each in self.beside.at(phases))
        return self._rates(distance, means, _upward(rates / self.speed))

    def _rates(self, distance: float, means: Vector, upward: Vector) -> Vector:
        """Upcrossings of a level per second about means; `upward` is psi of their rates."""
        density = np.exp(-0.5 * ((distance - means) / self.place) ** 2) / ROOT_2_PI
        return np.asarray(density * self.speed / self.place * upward)

    @cached_property
    def _net(self) -> tuple[Matrix, Vector, Vector, Vector]:
        """States of the net, their probabilities, means, and psi of the rates of these."""
        return self._known(*self.beside.net)

    def _known(self, states: Matrix, weights: Vector) -> tuple[Matrix, Vector, Vector, Vector]:
        means, rates = (each[0] for each in self.beside.at(states))
        return states, weights, means, _upward(rates / self.speed)

    def rate(self, distance: float, *, coarse: bool = False) -> float:
        """Upcrossings of a level per second, averaged over phases; `coarse` by half as many points
        of their net.

        >>> round(MovingMean.still(1.0, 1.0).rate(3.0), 7)
        0.0017681
        """
        if math.isinf(distance):
            return 0.0
        if not self.beside.number:
            return rice_rate(distance, self.place, self.speed)
        net = self._known(*self.beside.coarse_net) if coarse else self._net
        _, weights, means, upward = net
        return float(weights @ self._rates(distance, means, upward))

    def distance_of(self, rate: float) -> float:
        """The level above the mean, m, that is crossed so many times a second; 0 where none is."""
        zero = rice_rate(0.0, self.place, self.speed)
        if not self.beside.number:
            return self.place * math.sqrt(2.0 * max(math.log(zero / rate), 0.0))
        if self.rate(0.0) <= rate:
            return 0.0
        highest = self.reach + self.place
        while self.rate(highest) > rate:
            highest += self.place
        return float(brentq(lambda c: math.log(max(self.rate(c), 1e-320) / rate), 0.0, highest))

    def beyond(self, distance: float) -> float:
        """Probability that the displacement is beyond a level."""
        _, weights, means, _ = self._net
        return float(weights @ ndtr(-(distance - means) / self.place))

    def crossings(self, distance: float, units: Vector, shares: Vector | None) -> Crossings:
        """Upcrossings of a level, from random numbers of the unit Rayleigh distribution (...) and,
        beside sines or shocks, from random numbers between 0 and 1 (...) that choose the states of
        these."""
        if shares is None or math.isinf(distance):
            flat = np.zeros((*units.shape, self.beside.number))
            return Crossings(np.full(units.shape, distance), self.speed * units, flat)
        net, weights, *known = self._net
        likely = np.cumsum(weights * self._rates(distance, *known))
        chosen = np.searchsorted(likely, shares * likely[-1], side="right")
        phases = net[np.minimum(chosen, len(net) - 1)]
        means, rates = (each[0] for each in self.beside.at(phases))
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
