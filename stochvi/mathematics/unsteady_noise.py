"""Excitation that is not steady Gaussian noise. Chapters: noise of randomly varying level; shapes
of pulses; shocks at random times; Gaussian displacements beside sines or shocks; noise with fast
peaks."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import numpy as np
import scipy
from numpy.fft import irfft, rfft
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri

from stochvi.mathematics.impact_rates import rice_rate
from stochvi.mathematics.numerics import Matrix, Vector, Waves
from stochvi.mathematics.spectra import Table, bin_variances

# ------------------------------------------------------------------------------
# The random level of noise of varying level: its distribution, what a mount feels of it, and the
# probability that a hazard which follows it strikes.
#
# The noise is A(t) g(t), with a stationary Gaussian g and an independent level A of mean square 1.
# The level in decibels is normal: A = exp(s (u - s)) with a standard normal Ornstein-Uhlenbeck
# process u of the correlation exp(-t / tau). The kurtosis of the noise is 3 E A^4 = 3 exp(4 s^2).
#
# Conditioned on the level the noise is Gaussian. A mount of the bandwidth b (1/s) averages the
# squared level over its memory, V(t) = b int_0^inf exp(-b r) A^2(t - r) dr, so that its response
# has the kurtosis
#
#     3 E V^2 = 3 sum_n (4 s^2)^n / n! b / (b + n / tau)
#
# which is that of the noise where the level is slow. A hazard lambda(u) strikes within T with the
# probability 1 - <1, exp(T (L - lambda)) 1> (M. Kac 1949), with the generator L of u. Its
# eigenfunctions are Hermite polynomials, with the rates -n / tau.
# ------------------------------------------------------------------------------


NODES = 96
"""Number of levels at which a hazard is known: Gauss-Hermite nodes, which reach to 13 standard
deviations."""

AT_ONCE, SURE = 300.0, 50.0
"""Hazard times the correlation time of the level, and times the mission, above both of which a
hazard counts as the larger bound: a visit of such a level is struck at once. Without a bound
rounding errors would grow with the hazard."""

TERMS = 60
"""Terms of the series of a kurtosis: the next one is below 1e-16 up to a kurtosis of 100."""


@dataclass(frozen=True)
class RandomLevel:
    """Noise whose level in decibels is a normal Ornstein-Uhlenbeck process.

    Parameters
    ----------
    kurtosis
        Kurtosis of the noise, above 3.
    time
        Correlation time of its level in decibels, s.

    Examples
    --------
    >>> level = RandomLevel(kurtosis=5.0, time=10.0)
    >>> round(level.spread_db, 2), round(3.0 * level.moment(4.0), 12)
    (3.1, 5.0)
    """

    kurtosis: float
    time: float

    @property
    def spread(self) -> float:
        """Standard deviation of the logarithm of the level."""
        return 0.5 * math.sqrt(math.log(self.kurtosis / 3.0))

    @property
    def spread_db(self) -> float:
        """Standard deviation of the level, dB."""
        return 20.0 / math.log(10.0) * self.spread

    def gain(self, normal: Vector) -> Vector:
        """The level at values of the standard normal process."""
        return np.asarray(np.exp(self.spread * (normal - self.spread)))

    def moment(self, power: float) -> float:
        """E A^power."""
        return math.exp(power * self.spread**2 * (0.5 * power - 1.0))

    @property
    def normals(self) -> Vector:
        """(NODES,): values of the normal process at which a hazard is known."""
        return _hermite()[0]

    @property
    def weights(self) -> Vector:
        """(NODES,): their probabilities."""
        return _hermite()[1]

    @cached_property
    def gains(self) -> Vector:
        """(NODES,): the levels there."""
        return self.gain(self.normals)

    def felt(self, bandwidth: float) -> RandomLevel:
        """What the response of a mount feels of the level: its kurtosis, and the time of its level.

        Parameters
        ----------
        bandwidth
            The rate b, 1/s, at which the energy of the mount decays, 2 zeta omega.
        """
        terms = np.arange(1, TERMS + 1)
        logs = terms * math.log(4.0 * self.spread**2) - np.cumsum(np.log(terms))
        excess = float(np.sum(np.exp(logs) * bandwidth / (bandwidth + terms / self.time)))
        # averaging leaves the integral of the correlation of the squared level as it is
        return RandomLevel(3.0 + 3.0 * excess, self.time * (self.kurtosis / 3.0 - 1.0) / excess)

    def mean(self, values: Vector) -> float:
        """The average over the level of values at `gains`."""
        return float(self.weights @ values)

    def probability(self, rates: Vector, mission: float) -> float:
        """The probability that a hazard strikes in a mission.

        Parameters
        ----------
        rates
            Its rates at `gains`, 1/s.
        mission
            Duration, s, from the stationary state on.
        """
        basis = _hermite()[2]
        held = np.minimum(rates, max(AT_ONCE / self.time, SURE / mission))
        generator = (basis * held) @ basis.T
        generator[np.diag_indices(NODES)] += np.arange(NODES) / self.time
        values, vectors = np.linalg.eigh(generator)
        return float(np.sum(vectors[0] ** 2 * -np.expm1(-np.maximum(values, 0.0) * mission)))


@lru_cache(maxsize=1)
def _hermite() -> tuple[Vector, Vector, Matrix]:
    """Nodes and weights of the standard normal distribution, and the orthonormal polynomials times
    the roots of the weights (degrees, nodes): an orthogonal matrix, from the Jacobi matrix."""
    off = np.sqrt(np.arange(1.0, NODES))
    nodes, vectors = np.linalg.eigh(np.diag(off, 1) + np.diag(off, -1))
    basis = vectors * np.where(vectors[0] < 0.0, -1.0, 1.0)
    return nodes, basis[0] ** 2, basis


# ------------------------------------------------------------------------------
# Shapes of pulses of finite length, straight between points that lie evenly.
#
# A pulse is a s(t / D) with the peak a, the length D and a shape s that is 0 at both ends. With the
# values s_k at the points t_k, a distance d apart, its Fourier transform is exactly
#
#     S(w) = d sinc^2(w d / 2) sum_k s_k exp(-i w t_k).
# ------------------------------------------------------------------------------


POINTS = 401
"""Points of a shape that has a formula. Half a sine that is straight between them has 5e-6 less
area; a tooth falls within a 400th of its length."""

RAMP = 0.1
"""Share of a trapezoid's length in which it rises, and in which it falls (MIL-STD-810H 516.8)."""

PULSES_AT_ONCE = 2**22
"""Largest number of terms of Fourier transforms that are made together, 64 MB."""


@dataclass(frozen=True, eq=False)
class PulseShape:
    """Values at even points from the start to the end of a pulse, and its length, s.

    Examples
    --------
    >>> shape = PulseShape(SHAPES["half-sine"], 0.011)
    >>> round(shape.area / 0.011 * math.pi / 2.0, 4)
    1.0
    """

    values: Vector
    duration: float

    @property
    def interval(self) -> float:
        """Distance of two points, s."""
        return self.duration / (len(self.values) - 1)

    @property
    def area(self) -> float:
        """Integral over time, s."""
        return float(np.trapezoid(self.values)) * self.interval

    @property
    def peak(self) -> float:
        """Largest absolute value."""
        return float(np.max(np.abs(self.values)))

    def transform(self, omega: Vector) -> Waves:
        """The Fourier transform at angular frequencies (n,), s."""
        times = self.interval * np.arange(len(self.values))
        found: Waves = np.empty(len(omega), complex)
        part = max(1, PULSES_AT_ONCE // len(times))
        for first in range(0, len(omega), part):
            w = omega[first : first + part]
            found[first : first + part] = np.exp(-1j * w[:, None] * times) @ self.values
        return self._straight(omega) * found

    def transform_evenly(self, step: float, number: int) -> Waves:
        """The Fourier transform at a number of angular frequencies from 0 on, a step apart, s: each
        wave is the product of one of few frequencies that lie far and of one near by."""
        times = self.interval * np.arange(len(self.values))
        few = math.isqrt(number - 1) + 1
        near = self.values * np.exp(-1j * step * np.arange(few)[:, None] * times)
        far = np.exp(-1j * step * few * np.arange(-(-number // few))[:, None] * times)
        found: Waves = np.ravel(far @ near.T)[:number]
        return self._straight(step * np.arange(float(number))) * found

    def _straight(self, omega: Vector) -> Vector:
        """What the straight lines between points have more than their sum, s."""
        return np.asarray(self.interval * np.sinc(omega * self.interval / (2.0 * math.pi)) ** 2)


def _half_sine(time: Vector) -> Vector:
    return np.asarray(np.sin(math.pi * time))


def _saw_tooth(time: Vector) -> Vector:
    return np.where(time < 1.0, time / time[-2], 0.0)


def _trapezoid(time: Vector) -> Vector:
    return np.asarray(np.minimum(np.minimum(time, 1.0 - time) / RAMP, 1.0))


SHAPES = {
    name: shape(np.linspace(0.0, 1.0, POINTS))
    for name, shape in (
        ("half-sine", _half_sine), ("saw-tooth", _saw_tooth), ("trapezoid", _trapezoid),
    )
}  # fmt: skip
"""Values of the shapes of shock tests: half a sine, a tooth that ends at its peak, a trapezoid."""


# ------------------------------------------------------------------------------
# Shocks at random times beside noise: how they have moved displacements, and how probably.
#
# Shocks come at the times of a Poisson process of the rate lambda. Each moves a displacement by a
# r(t), with its size a and the response r to a shock of size 1. It has died out after a window. The
# mean about which noise moves the displacement is then the sum over the shocks in the window. It
# holds n of them with the probability of Poisson, at independent uniform times. Averages over
# shocks are sums over n, and for each n over the points of a net of Sobol' in their ages and sizes.
# Half of the ages are those at which a shock moves most.
# ------------------------------------------------------------------------------


ONE_SHOCK, SEVERAL_SHOCKS = 2**15, 2**13
"""Points of the net for one shock in the window, and for each larger number."""

LEFT_OUT = 1e-8
"""Probability of more shocks in the window than are looked at: what they may bring is a bias."""

MOST_IN_WINDOW = 2.0
"""Mean number of shocks in the window above which they are not apart."""

SIZES: dict[str, Callable[[Vector], Vector]] = {
    "equal": np.ones_like,
    "normal": lambda share: np.asarray(ndtri(0.5 + 0.5 * share)),
    "exponential": lambda share: np.asarray(-np.log1p(-share)),
}
"""Sizes of shocks at quantiles, by the names of their distributions."""


STILL = 1e-9
"""Share of the largest motion after a shock up to which a displacement counts as one that shocks do
not move: rounding leaves some 1e-16."""


@dataclass(frozen=True, eq=False)
class Shocks:
    """Shocks that move displacements. A state of them is the ages (s) and sizes of the shocks in
    the window, in turn, (..., 2 most); a size of 0 stands for none.

    Parameters
    ----------
    rate
        Mean number of shocks per second.
    step
        Interval of the responses, s.
    responses
        (displacements, samples, 2): displacement and velocity after a shock of size 1, from its
        start on; none is left after the last sample.
    window
        Time for which shocks are remembered, s, at least the length of the responses.
    sizes, two_sided
        Distribution of the sizes, and whether each has either direction with equal probability.
    """

    rate: float
    step: float
    responses: Vector
    window: float
    sizes: str
    two_sided: bool

    @property
    def expected(self) -> float:
        """Mean number of shocks in the window."""
        return self.rate * self.window

    @cached_property
    def most(self) -> int:
        """Largest number of shocks in the window that is looked at."""
        return max(1, int(scipy.stats.poisson.isf(LEFT_OUT, self.expected)))

    @property
    def number(self) -> int:
        """Numbers of a state."""
        return 2 * self.most

    @property
    def left_out(self) -> float:
        """Probability of more shocks in the window."""
        return float(scipy.stats.poisson.sf(self.most, self.expected))

    @property
    def missed_rate(self) -> float:
        """Rate at which more shocks than are looked at come together, 1/s."""
        return self.left_out / self.window

    @property
    def symmetric(self) -> bool:
        """Whether the opposite motion is as likely."""
        return self.two_sided

    @cached_property
    def net(self) -> tuple[Matrix, Vector]:
        """States (points, 2 most) and their probabilities (points,)."""
        return self._net(1)

    @cached_property
    def coarse_net(self) -> tuple[Matrix, Vector]:
        """The same with half as many points."""
        return self._net(2)

    def _net(self, fewer: int) -> tuple[Matrix, Vector]:
        states, weights = [np.zeros((1, self.number))], [np.array([math.exp(-self.expected)])]
        for count in range(1, self.most + 1):
            points = (ONE_SHOCK if count == 1 else SEVERAL_SHOCKS) // fewer
            net = scipy.stats.qmc.Sobol(3 * count, scramble=False).random_base2(
                round(math.log2(points))
            )
            shares = np.asarray(net + 0.5 / points).reshape(points, count, 3)
            found = np.zeros((points, self.most, 2))
            found[:, :count, 0], rarity = self._ages(shares[..., 0])
            found[:, :count, 1] = SIZES[self.sizes](shares[..., 1])
            if self.two_sided:
                found[:, :count, 1] *= np.where(shares[..., 2] < 0.5, -1.0, 1.0)
            states.append(found.reshape(points, self.number))
            weights.append(
                scipy.stats.poisson.pmf(count, self.expected) / points * rarity.prod(axis=1)
            )
        return np.concatenate(states), np.concatenate(weights)

    def _ages(self, shares: Vector) -> tuple[Vector, Vector]:
        """Ages of shocks at quantiles of a density; and the even density over it. The density is
        half even, and half in proportion to the squared motion at that age."""
        ends = np.append(self.step * np.arange(self.responses.shape[1]), self.window)
        reach = self.reach
        moved = reach > STILL * reach.max()
        squares = np.sum((self.responses[moved, :, 0] / reach[moved, None]) ** 2, axis=0)
        squares = np.append(0.5 * (squares[1:] + squares[:-1]), 0.0)
        widths = np.diff(ends)
        parts = widths / self.window
        if moved.any():
            parts = 0.5 * parts + 0.5 * squares * widths / (squares @ widths)
        ages = np.interp(shares, np.append(0.0, np.cumsum(parts)) / parts.sum(), ends)
        part = np.clip(np.searchsorted(ends, ages, side="right") - 1, 0, len(parts) - 1)
        return ages, (widths / self.window / parts)[part]

    def at(self, states: Matrix) -> tuple[Matrix, Matrix]:
        """Displacements and velocities (displacements, ...) in states (..., 2 most)."""
        shape = states.shape[:-1]
        flat = states.reshape(-1, self.most, 2)
        moved = np.zeros((2, len(self.responses), len(flat)))
        for shock in range(self.most):
            (struck,) = np.nonzero(flat[:, shock, 1])
            age, size = flat[struck, shock].T
            moved[:, :, struck] += size * self.response_at(age)
        place, speed = moved.reshape(2, len(self.responses), *shape)
        return place, speed

    def response_at(self, age: Vector) -> Vector:
        """(2, displacements, ages): displacements and velocities, by cubics between samples."""
        place = age / self.step
        first = np.clip(np.floor(place).astype(int), 0, self.responses.shape[1] - 2)
        s = place - first
        (x0, v0), (x1, v1) = (self.responses[:, first + k].transpose(2, 0, 1) for k in (0, 1))
        v0, v1 = self.step * v0, self.step * v1
        bent, turned = 3.0 * (x1 - x0) - 2.0 * v0 - v1, 2.0 * (x0 - x1) + v0 + v1
        found = np.stack(
            [x0 + s * (v0 + s * (bent + s * turned)),
             (v0 + s * (2.0 * bent + 3.0 * s * turned)) / self.step]
        )  # fmt: skip
        return np.asarray(np.where((s >= 0.0) & (s <= 1.0), found, 0.0))

    def of(self, rows: Matrix) -> Shocks:
        """The shocks of combinations (rows, displacements) of these displacements."""
        return replace(self, responses=np.tensordot(rows, self.responses, 1))

    @property
    def mean_squares(self) -> tuple[Vector, Vector]:
        """Variances (displacements,) of displacement and velocity (N. R. Campbell 1909)."""
        shares = (np.arange(SEVERAL_SHOCKS) + 0.5) / SEVERAL_SHOCKS
        square = self.rate * float(np.mean(SIZES[self.sizes](shares) ** 2)) * self.step
        place, speed = (square * np.sum(self.responses**2, axis=1)).T
        return place, speed

    @property
    def reach(self) -> Vector:
        """(displacements,): largest displacement after a shock of size 1, m."""
        return np.asarray(np.abs(self.responses[..., 0]).max(axis=1))


# ------------------------------------------------------------------------------
# Gaussian displacements beside sines or shocks: means that move, and how often a level is crossed.
#
# Noise moves a displacement with the standard deviations s and s' of place and velocity. Sines of
# random phases add m(t) = Re sum_k a_k exp(i (w_k t + theta_k)). At phases at which the mean is m
# and its rate m', the level u is crossed upwards so many times a second (S. O. Rice 1944):
#
#     nu = phi((u - m) / s) s' / s psi(m' / s'),    psi(r) = phi(r) + r Phi(r)
#
# The slope p of such a crossing has a density in proportion to p exp(-(p - m')^2 / (2 s'^2)). A
# level is crossed at phases with a probability in proportion to nu. Averages over phases are sums
# over the points of a net of Sobol'. Shocks at random times are such means as well: their ages and
# sizes (above) take the place of phases, with probabilities of their own.
# ------------------------------------------------------------------------------


PHASES = 2**13
"""Number of phases over which rates are averaged. For one sine they are evenly spaced."""

MOST_STEPS, SAME_SLOPE = 60, 1e-8
"""Largest number of steps by which a slope is found, as many as halvings alone would take. The
relative change after which the next step has all digits."""

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
    net = scipy.stats.qmc.Sobol(sines, scramble=False).random_base2(round(math.log2(count)))
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
        return self if side > 0.0 or self.beside.symmetric else self._turned

    @cached_property
    def _turned(self) -> MovingMean:
        """The opposite displacement, with its net of states."""
        return self.louder(-1.0)

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
        return float(
            scipy.optimize.brentq(
                lambda c: math.log(max(self.rate(c), 1e-320) / rate), 0.0, highest
            )
        )

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
    found, low, high = units, np.zeros_like(units), units + np.maximum(turn, 0.0)
    for _ in range(MOST_STEPS):
        density = np.exp(-0.5 * (found - turn) ** 2) / ROOT_2_PI
        share = density + turn * ndtr(turn - found)
        low, high = np.where(share > wanted, (found, high), (low, found))
        # the logarithm of the share is nearly straight in the square of the slope: Newton's step
        with np.errstate(all="ignore"):
            slope = np.sqrt(found**2 + 2.0 * np.log(share / wanted) * share / density)
        slope = np.where((low <= slope) & (slope <= high), slope, 0.5 * (low + high))
        found, changed = slope, np.abs(slope - found)
        if np.all(changed <= SAME_SLOPE * slope):
            break
    return np.asarray(found)


# ------------------------------------------------------------------------------
# Noise with fast peaks: a steady kurtosis above 3 at a given density.
#
# A Gaussian signal u of unit variance is made peaked by a monotone cubic without memory (S. R.
# Winterstein, J. Eng. Mech. 114 (1988) 1772), and a linear filter L gives it its density back:
#
#     x = L [u + h He_3(u)],    He_3(u) = u^3 - 3 u
#
# With the correlation rho of u that of He_3(u) is 6 rho^3 (Mehler's formula). So the filter that
# leaves the density exactly as it was is known: |L|^2 = S / (S + 6 h^2 S_3), where rho^3 has the
# density S_3. No signal of a bounded band comes from a cubic alone, as rho^3 reaches to three times
# the band. The filter takes off a part of the kurtosis, so that h is found by samples of x.
# ------------------------------------------------------------------------------


MOST_KURTOSIS = 20.0
"""Largest kurtosis of noise with fast peaks."""

MOST_CUBIC = 1.0 / 3.0
"""Largest h, at which the cubic is still monotone."""

PILOT_BINS, PILOT_RECORDS, PILOT_SEED = 2**14, 32, 20
"""Bins and number of the records from which h is found, and their seed: they leave the kurtosis
uncertain by 0.3 % at 5 and 1 % at 8."""

PARTS = 32
"""Parts of a record whose averages tell the weight of the control variate."""

SAMPLES_PER_PERIOD = 4.0
"""Samples in the shortest period: at fewer, frequencies of the cube would be folded into the
band."""

ENOUGH = 1e-3
"""Error of h at which its search ends."""


class Hermite(NamedTuple):
    """Monotone cubic of a Gaussian variable of unit variance that has a chosen kurtosis,

        x = k (g + h (g^3 - 3 g)),    k = 1 / sqrt(1 + 6 h^2)

    (S. R. Winterstein, J. Eng. Mech. 114 (1988) 1772; h solved exactly for the kurtosis).

    Examples
    --------
    >>> law = Hermite.of(5.0)
    >>> round(law.inverse(law(4.0)), 9), Hermite.of(3.0)(4.0)
    (4.0, 4.0)
    """

    h: float

    @classmethod
    def of(cls, kurtosis: float) -> Hermite:
        """The cubic for a kurtosis of 3 to 20 or so."""

        if kurtosis <= 3.0:
            return cls(0.0)
        return cls(
            float(scipy.optimize.brentq(lambda h: cls(h).kurtosis - kurtosis, 0.0, MOST_CUBIC))
        )

    @property
    def kurtosis(self) -> float:
        """Kurtosis of x: E x^4 of H1 + h H3 is 3 + 24 h + 252 h^2 + 1296 h^3 + 3348 h^4."""
        h = self.h
        fourth = 3.0 + 24.0 * h + 252.0 * h**2 + 1296.0 * h**3 + 3348.0 * h**4
        return fourth / (1.0 + 6.0 * h**2) ** 2

    def __call__(self, g: Any) -> Any:
        """x for a Gaussian g."""
        return (g + self.h * (g**3 - 3.0 * g)) / math.sqrt(1.0 + 6.0 * self.h**2)

    def inverse(self, x: float) -> float:
        """g for x >= 0."""

        return float(scipy.optimize.brentq(lambda g: self(g) - x, 0.0, 3.0 + 2.0 * x))


class UnreachableKurtosis(ValueError):
    """A density does not let noise have the kurtosis that is asked for."""


@dataclass(frozen=True, eq=False)
class FastPeaks:
    """Noise of a density with a steady kurtosis, by fast peaks.

    Parameters
    ----------
    table
        Its density.
    kurtosis
        Its kurtosis, above 3.

    Examples
    --------
    >>> flat = Table(frequency_hz=np.array([10.0, 100.0]), density=np.ones(2))
    >>> peaks = FastPeaks(flat, 5.0)
    >>> bins = peaks.over(20.0).bins(np.random.default_rng(1), 50)
    >>> bins.shape
    (2001, 50)
    >>> record = irfft(bins, 8004, axis=0)
    >>> bool(abs(np.mean(record**4) / np.mean(record**2) ** 2 - 5.0) < 0.3)
    True
    """

    table: Table
    kurtosis: float

    mean = 0.0
    """Mean of the noise."""

    @property
    def cubic(self) -> float:
        """The weight h of the cubic.

        Raises
        ------
        UnreachableKurtosis
            If no monotone cubic gives noise of this density the kurtosis.
        """
        table = self.table
        return _cubic(table.frequency_hz.tobytes(), table.density.tobytes(), self.kurtosis)

    def over(self, length: float) -> PeakedRecords:
        """Records of a length, s, that repeat."""
        return PeakedRecords(self.table, length, self.cubic)


@dataclass(frozen=True, eq=False)
class PeakedRecords:
    """Records of noise with fast peaks that repeat after a length, s.

    Parameters
    ----------
    cubic
        The weight h of the cubic; 0 for Gaussian noise.
    """

    table: Table
    length: float
    cubic: float

    @cached_property
    def count(self) -> int:
        """Number of bins, up to the end of the density."""
        return math.ceil(float(self.table.frequency_hz[-1]) * self.length) + 1

    @cached_property
    def samples(self) -> int:
        """Number of samples at which the cubic is taken."""
        return 2 * int(
            scipy.fft.next_fast_len(math.ceil(SAMPLES_PER_PERIOD * self.count / 2.0) + 1)
        )

    @cached_property
    def variances(self) -> Vector:
        """(count,) variance of each bin from the second on; the mean has none."""
        found = np.zeros(self.count)
        found[1:] = bin_variances(self.table, self.length, self.count)
        return found

    @cached_property
    def filter(self) -> Vector:
        """(count,) what the transform of u + h He_3(u) is multiplied by."""
        return self.filter_of(self.cubic)

    def filter_of(self, cubic: float) -> Vector:
        """`filter` for another weight h."""
        grown = self._shares + cubic**2 * self._shares_of_cube
        kept = np.divide(self.variances, grown, out=np.zeros(self.count), where=self._shares > 0.0)
        return np.asarray(np.sqrt(kept))

    @cached_property
    def _shares(self) -> Vector:
        """(count,) variance of u in each bin."""
        return np.asarray(self.variances / self.variances.sum())

    @cached_property
    def _shares_of_cube(self) -> Vector:
        """(count,) variance of He_3(u) in each bin."""
        correlation = irfft(0.5 * self.samples * self._shares, self.samples)
        cubes = 2.0 / self.samples * rfft(6.0 * correlation**3)[: self.count].real
        return np.asarray(np.maximum(cubes, 0.0))

    def gaussian(self, random: np.random.Generator, records: int) -> Matrix:
        """Gaussian records u (samples, records)."""
        return self._gaussian_of(random.standard_normal((2, self.count, records)))

    def bins(self, random: np.random.Generator, records: int) -> Waves:
        """Records x by their transforms (count, records), as `rfft` of `samples` samples has."""
        return self.bins_of(random.standard_normal((2, self.count, records)))

    def bins_of(self, normals: NDArray[np.float64]) -> Waves:
        """The same records from standard normal numbers (2, count, records)."""
        u = self._gaussian_of(normals)
        raw = rfft(u + self.cubic * (u**3 - 3.0 * u), axis=0)[: self.count]
        return np.asarray(self.filter[:, None] * raw)

    def _gaussian_of(self, normals: NDArray[np.float64]) -> Matrix:
        real, imaginary = normals
        size = 0.5 * self.samples * np.sqrt(self._shares)
        return np.asarray(irfft(size[:, None] * (real - 1j * imaginary), self.samples, axis=0))


class _Pilot:
    """Kurtosis of noise of a density over the weight h of its cubic, from one set of records."""

    def __init__(self, table: Table) -> None:
        length = PILOT_BINS / float(table.frequency_hz[-1])
        self.records = PeakedRecords(table, length, 0.0)
        self.u = self.records.gaussian(np.random.default_rng(PILOT_SEED), PILOT_RECORDS)
        self.cube = self.u**3 - 3.0 * self.u
        self.bins = [rfft(each, axis=0)[: self.records.count] for each in (self.u, self.cube)]

    def kurtosis(self, h: float) -> float:
        """The kurtosis, by the known one before the filter as a control variate."""
        kept = self.records.filter_of(h)[:, None]
        after = irfft(kept * (self.bins[0] + h * self.bins[1]), self.records.samples, axis=0)
        before = self.u + h * self.cube
        scales = 1.0 + 6.0 * h**2, float(self.records.variances.sum())
        known, found = (
            np.concatenate([part.mean(axis=0) for part in np.array_split((each**2) ** 2, PARTS)])
            / scale**2
            for each, scale in zip((before, after), scales, strict=True)
        )
        spread = np.cov(known, found)
        weight = spread[0, 1] / spread[0, 0]
        return float(found.mean() - weight * (known.mean() - Hermite(h).kurtosis))


@lru_cache(maxsize=64)
def _cubic(frequency: bytes, density: bytes, kurtosis: float) -> float:
    """The weight h that gives noise of a density the kurtosis."""

    table = Table(frequency_hz=np.frombuffer(frequency), density=np.frombuffer(density))
    pilot = _Pilot(table)
    most = pilot.kurtosis(MOST_CUBIC)
    if most < kurtosis:
        raise UnreachableKurtosis(
            f"kurtosis must be at most {most:.3g} for noise of this density, got {kurtosis:g}; "
            "give a wider band, or level_time for noise of varying level"
        )
    tolerance = ENOUGH * Hermite.of(kurtosis).h
    return float(
        scipy.optimize.brentq(
            lambda h: pilot.kurtosis(h) - kurtosis, 0.0, MOST_CUBIC, xtol=tolerance
        )
    )
