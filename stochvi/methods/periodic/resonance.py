"""Vibro-impact resonance: how it is kept up by a harmonic force, and how long by a random one.

Between stops a mass has regimes in which it hits them once a period, besides rest or motion without
impacts. A harmonic force keeps one up as long as the gap is below an energy boundary; random
thrust supplies on average no power to it, and by chance enough only for a while.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm
from scipy.special import ndtri

from stochvi.mathematics.quadrature import gauss_legendre

Vector = NDArray[np.float64]

SAMPLES = 400
"""Number of places in half a period at which a regime is checked for passing through a stop."""

HARMONICS = 63
"""Number of harmonics of the velocity of a regime. Those beyond have 0.6 % of the power of a jump,
whose harmonics fall like 1/m."""


@dataclass(frozen=True, kw_only=True)
class Regime:
    """A periodic motion with one impact on each of two stops in `periods` of the force.

    `impact_speed` is the incident one, m/s; `phase` that of the motion without stops at the impact
    on the upper stop, rad. `multiplier` is the largest factor, in modulus, by which a small
    disturbance changes from one impact to the next; the regime is stable below 1. One that would
    pass through a stop between its impacts is not `admissible`.
    """

    impact_speed: float
    phase: float
    multiplier: float
    admissible: bool

    @property
    def stable(self) -> bool:
        """Whether small disturbances of the regime die away."""
        return self.multiplier < 1.0


@dataclass(frozen=True, kw_only=True)
class HarmonicResonance:
    """x'' + b x' + omega^2 x = a_p cos(w t) between stops at -D and D (B 3.17, 9.15).

    Parameters
    ----------
    omega, damping_rate
        Natural frequency, rad/s, and b, 1/s.
    amplitude, frequency
        a_p, m/s^2 (of a base of amplitude A: A w^2), and w, rad/s.
    restitution
        R of both stops.
    periods
        l, odd: a regime hits each stop once in l periods of the force.

    Raises
    ------
    ValueError
        If a number is out of range.

    Examples
    --------
    An isolator on a base that moves by 0.1 mm:

    >>> mount = HarmonicResonance(
    ...     omega=62.8, damping_rate=12.5, amplitude=1e-4 * 628.0**2, frequency=628.0,
    ...     restitution=0.5,
    ... )
    >>> f"{mount.free_amplitude:.3e} {mount.energy_boundary:.4e} {mount.harmonic_boundary:.2e}"
    '1.010e-04 4.4944e-04 3.87e-04'
    """

    omega: float
    damping_rate: float
    amplitude: float
    frequency: float
    restitution: float
    periods: int = 1

    def __post_init__(self) -> None:
        for name in ("omega", "damping_rate"):
            if not 0.0 <= getattr(self, name) < math.inf:
                raise ValueError(f"{name} must be at least 0, got {getattr(self, name):g}")
        for name in ("amplitude", "frequency"):
            if not 0.0 < getattr(self, name) < math.inf:
                raise ValueError(f"{name} must be greater than 0, got {getattr(self, name):g}")
        if not 0.0 <= self.restitution <= 1.0:
            raise ValueError(f"restitution must be in [0, 1], got {self.restitution:g}")
        if self.periods < 1 or self.periods % 2 == 0:
            raise ValueError(f"periods must be odd and at least 1, got {self.periods}")
        if self.damping_rate == 0.0 and self.omega == self.frequency:
            raise ValueError("damping_rate must be greater than 0 at resonance, got 0")

    @property
    def free_amplitude(self) -> float:
        """Amplitude without stops, a = a_p / sqrt((omega^2 - w^2)^2 + b^2 w^2), m."""
        w = self.frequency
        return self.amplitude / math.hypot(self.omega**2 - w**2, self.damping_rate * w)

    @cached_property
    def _flight(self) -> NDArray[np.float64]:
        """Matrix F of the free motion over half of a regime, h = pi l / w."""
        generator = np.array([[0.0, 1.0], [-(self.omega**2), -self.damping_rate]])
        return np.asarray(expm(generator * math.pi * self.periods / self.frequency))

    @cached_property
    def _response(self) -> tuple[float, float]:
        """(P, Q) = (F + I)^-1 (R F_12, R F_22 - 1): at an impact of the speed v the motion that the
        impacts add to the one without stops is v P, its velocity v (1 + Q)."""
        flight, r = self._flight, self.restitution
        right = np.array([r * flight[0, 1], r * flight[1, 1] - 1.0])
        p, q = np.linalg.solve(flight + np.eye(2), right)
        return float(p), float(q)

    @property
    def energy_boundary(self) -> float:
        """Largest clearance with a regime, D = a sqrt(1 + (P w / Q)^2), m (B 3.17).

        Beyond it the force cannot supply what impacts and damper take at any phase.
        """
        p, q = self._response
        return self.free_amplitude * math.hypot(1.0, p * self.frequency / q) if q else math.inf

    @property
    def harmonic_boundary(self) -> float:
        """The same by harmonic linearisation, a_p / ((b + (1 - R^2) w / pi) w), m (B 9.15)."""
        w = self.frequency
        loss = (1.0 - self.restitution**2) * w / math.pi
        total = (self.damping_rate + loss) * w
        return self.amplitude / total if total else math.inf

    def regimes(self, clearance: float) -> tuple[Regime, ...]:
        """Regimes between stops at -clearance and clearance (m), fastest first.

        The speed solves (D - v P)^2 + (v Q / w)^2 = a^2: up to the energy boundary there are two
        of them where D is above the amplitude without stops, of which the slower is unstable.

        Examples
        --------
        >>> mount = HarmonicResonance(
        ...     omega=62.8, damping_rate=12.5, amplitude=1e-4 * 628.0**2, frequency=628.0,
        ...     restitution=0.5,
        ... )
        >>> [(round(found.impact_speed, 4), found.stable) for found in mount.regimes(4e-4)]
        [(0.2246, True), (0.1771, False)]
        >>> mount.regimes(4.6e-4)
        ()
        """
        p, q = self._response
        w, a = self.frequency, self.free_amplitude
        square = p**2 + (q / w) ** 2
        root = (clearance * p) ** 2 - square * (clearance**2 - a**2)
        if root < 0.0 or square == 0.0:
            return ()
        speeds = [(clearance * p + sign * math.sqrt(root)) / square for sign in (1.0, -1.0)]
        return tuple(self._regime(clearance, v) for v in sorted(speeds, reverse=True) if v > 0.0)

    def _regime(self, clearance: float, v: float) -> Regime:
        p, q = self._response
        phase = math.atan2(v * q / self.frequency, clearance - v * p)
        return Regime(
            impact_speed=v,
            phase=phase,
            multiplier=self._multiplier(clearance, v, phase),
            admissible=self._stays_inside(clearance, v, phase),
        )

    def _multiplier(self, clearance: float, v: float, phase: float) -> float:
        """Largest eigenvalue of flight after impact for a small disturbance.

        An impact turns a disturbance (dx, dv) into (-R dx, -R dv + (g+ + R g-) dx / v), g the
        acceleration before and after it.
        """
        r, w, b = self.restitution, self.frequency, self.damping_rate
        a = self.free_amplitude
        force = a * ((self.omega**2 - w**2) * math.cos(phase) - b * w * math.sin(phase))
        spring = force - self.omega**2 * clearance
        before, after = spring - b * v, spring + b * r * v
        impact = np.array([[-r, 0.0], [(after + r * before) / v, -r]])
        return float(np.abs(np.linalg.eigvals(self._flight @ impact)).max())

    def _stays_inside(self, clearance: float, v: float, phase: float) -> bool:
        p, q = self._response
        w, a = self.frequency, self.free_amplitude
        times = np.linspace(0.0, math.pi * self.periods / w, SAMPLES + 1)[1:-1]
        added = np.array([v * p, v * (1.0 + q) - (1.0 + self.restitution) * v])
        generator = np.array([[0.0, 1.0], [-(self.omega**2), -self.damping_rate]])
        step = np.asarray(expm(generator * times[0]))
        places = []
        for time in times:
            added = step @ added
            places.append(a * math.cos(w * time + phase) + float(added[0]))
        return bool(np.max(np.abs(places)) <= clearance * (1.0 + 1e-9))


@dataclass(frozen=True, kw_only=True)
class RandomResonance:
    """A resonant regime that random thrust would have to maintain (B 14.88-14.101).

    The regime y0(t) is the free motion of frequency w that hits its stops without loss; N_d is the
    power per unit mass that damper and impacts would take from it.

    Parameters
    ----------
    omega, damping_rate
        Natural frequency, rad/s, and b, 1/s, of the motion between the impacting bodies.
    clearance
        Clearance, m: of two stops at +-clearance, or of one, which may be negative (preload).
    restitution
        R of the stops.
    frequency
        w of the regime, rad/s: above omega for two stops, between omega and 2 omega for one (up
        to any where it is preloaded).
    both_sides
        Whether there are two stops.

    Raises
    ------
    ValueError
        If there is no such motion.

    Examples
    --------
    >>> rattle = RandomResonance(
    ...     omega=1.0, damping_rate=0.01, clearance=1.0, restitution=0.8, frequency=2.0
    ... )
    >>> round(rattle.power_loss, 4), round(rattle.longest(intensity=0.01), 2)
    (0.1578, 2.77)
    """

    omega: float
    damping_rate: float
    clearance: float
    restitution: float
    frequency: float
    both_sides: bool = True

    def __post_init__(self) -> None:
        if not 0.0 <= self.restitution <= 1.0:
            raise ValueError(f"restitution must be in [0, 1], got {self.restitution:g}")
        if not (self.frequency > 0.0 and self.omega >= 0.0 and self.damping_rate >= 0.0):
            raise ValueError("frequency must be above 0, omega and damping_rate at least 0")
        if self.both_sides and not (self.clearance > 0.0 and self.frequency > self.omega):
            raise ValueError("two stops need a clearance above 0 and a frequency above omega")
        swing = math.pi * self.omega / self.frequency
        inside = math.pi / 2.0 < swing < math.pi
        preloaded = 0.0 < swing < math.pi / 2.0
        if not self.both_sides and not (inside if self.clearance > 0.0 else preloaded):
            raise ValueError(
                "one stop needs a frequency between omega and 2 omega, above 2 omega where it is "
                "preloaded"
            )
        if self.power_loss == 0.0:
            raise ValueError("damping_rate or 1 - restitution must be above 0: nothing is lost")

    @property
    def _half(self) -> float:
        """Half of the time between two successive impacts, s."""
        return math.pi / self.frequency * (0.5 if self.both_sides else 1.0)

    @property
    def impact_speed(self) -> float:
        """Of the regime: omega D cot(omega t) for two stops, -omega D tan(omega t) for one, t half
        the time between impacts, m/s."""
        angle = self.omega * self._half
        if not self.both_sides:
            return -self.omega * self.clearance * math.tan(angle)
        if self.omega == 0.0:
            return self.clearance / self._half
        return self.omega * self.clearance / math.tan(angle)

    @cached_property
    def _velocity(self) -> tuple[Vector, Vector]:
        """Times from -t to t by Gauss's rule, and y0' there."""
        nodes, _ = _RULE
        times = self._half * nodes
        angle = self.omega * self._half
        if not self.both_sides:
            scale = -self.omega * self.clearance / math.cos(angle)
            return times, np.asarray(scale * np.sin(self.omega * times))
        scale = self.clearance / (self._half * float(np.sinc(angle / math.pi)))
        return times, np.asarray(scale * np.cos(self.omega * times))

    @cached_property
    def velocity_mean_square(self) -> float:
        """Mean square velocity of the regime, <y0'^2>, m^2/s^2."""
        return float(self._velocity[1] ** 2 @ _RULE[1]) / 2.0

    @cached_property
    def harmonics(self) -> Vector:
        """Amplitudes of y0' at w, 2 w, ... (m/s); two stops leave the odd ones only."""
        times, velocity = self._velocity
        number = np.arange(1, HARMONICS + 1)[:, None]
        angle = number * self.frequency * times
        odd = np.where(number % 2 == 1, np.cos(angle), 0.0)
        shape = odd if self.both_sides else np.sin(angle)
        return np.asarray(np.abs(shape @ (velocity * _RULE[1])))

    @cached_property
    def power_loss(self) -> float:
        """N_d = b <y0'^2> + (1 - R) J^2 / (2 (1 + R)) per impact, m^2/s^3 (B 14.71).

        The impulse per unit mass J = 2 v is that of the regime without loss, so that an impact
        takes 2 (1 - R) v^2 / (1 + R): what it takes from a speed of 2 v / (1 + R).
        """
        impacts = 1.0 / (2.0 * self._half)
        lost = 2.0 * (1.0 - self.restitution) / (1.0 + self.restitution) * self.impact_speed**2
        lost *= impacts
        return self.damping_rate * self.velocity_mean_square + lost

    def random_power(self, intensity: float | Callable[[Vector], Vector], duration: float) -> float:
        """Standard deviation of the power that noise supplies, averaged over `duration`, m^2/s^3.

        White noise of intensity S0 (m^2/s^3): sqrt(S0 <y0'^2> / T) (B 14.88). Noise of the
        two-sided density S(omega), a function of rad/s that changes little over 1 / T: sqrt(sum
        of a_m^2 S(m w) / 2 T), a_m the harmonics of y0'.
        """
        if callable(intensity):
            at = self.frequency * np.arange(1, HARMONICS + 1)
            supply = float(np.sum(self.harmonics**2 / 2.0 * intensity(at.astype(float))))
        else:
            supply = intensity * self.velocity_mean_square
        return math.sqrt(supply / duration)

    def longest(
        self, intensity: float | Callable[[Vector], Vector], probability: float = 0.98
    ) -> float:
        """T0 = z^2 S0 <y0'^2> / N_d^2, s: with this probability noise cannot maintain the regime
        over any longer time (B 14.93), z the normal quantile.

        The supply averaged over T is normal with mean 0, and the regime needs it to be N_d.
        """
        z = _quantile(probability)
        return (z * self.random_power(intensity, 1.0) / self.power_loss) ** 2

    def smallest_narrow_band(self, probability: float = 0.98) -> float:
        """Rms (m/s^2) below which noise at w alone cannot maintain the regime (B 14.100, 14.101).

        A narrow band keeps its phase: its power over any time has the deviation a_1 / 2 times its
        rms, a_1 the first harmonic of y0', so that N_d / (z a_1 / 2) is needed.
        """
        return self.power_loss / (_quantile(probability) * float(self.harmonics[0]) / 2.0)


_RULE = gauss_legendre(256)
"""Gauss-Legendre rule, exact for the harmonics of the velocity up to `HARMONICS`."""


def _quantile(probability: float) -> float:
    if not 0.5 < probability < 1.0:
        raise ValueError(f"probability must be above 0.5 and below 1, got {probability:g}")
    return float(ndtri(probability))
