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

from stochvi.mathematics.arrays import Vector
from stochvi.methods.periodic.even import even_regimes, widest
from stochvi.methods.periodic.family import Numbers
from stochvi.methods.periodic.linearised import Harmonic
from stochvi.methods.periodic.structure_resonance import HARMONICS, StructureResonance, quantile

BOTH = (0, 1)
"""Impacts of a regime between two stops, in their order: on the upper one and on the lower one."""

BELOW = 1e-6
"""Relative distance below a fold at which the impact speeds of its regimes are looked at."""


@dataclass(frozen=True, kw_only=True)
class ResonantRegime:
    """A periodic motion with one impact on each of two stops in `periods` of the force.

    `impact_speed` is the incident one, m/s; `phase` that of the motion without stops at the impact
    on the upper stop, rad. `multiplier` is the largest factor, in modulus, by which a small
    perturbation changes from one impact to the next; the regime is stable below 1. One that would
    pass through a stop between its impacts is not `admissible`.
    """

    impact_speed: float
    phase: float
    multiplier: float
    admissible: bool

    @property
    def stable(self) -> bool:
        """Whether small perturbations of the regime die away."""
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

    See Also
    --------
    stochvi.harmonic_response : The regimes themselves.
    stochvi.isolators.jolts : Which jolt leads to clatter.

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

    def _between(self, clearance: float) -> Numbers:
        """The oscillator between stops at -clearance and clearance."""
        return Numbers(
            stiffness=np.array([[self.omega**2]]),
            damping=np.array([[self.damping_rate]]),
            forces=np.array([[self.amplitude, 0.0, 0.0]]),
            rows=np.array([[1.0], [-1.0]]),
            distances=np.array([clearance, clearance]),
            restitutions=np.array([self.restitution, self.restitution]),
            omega=self.frequency,
            output=np.ones(1),
            base=np.zeros(3),
            shapes=np.eye(1),
        )

    @property
    def energy_boundary(self) -> float:
        """Largest clearance with a regime, m (B 3.17).

        Beyond it the force cannot supply what impacts and damper take at any phase. Where
        the impact speed of B 3.17 is negative, as just below resonance, regimes end at the
        amplitude without stops, at which the speed falls to 0.
        """
        free = self.free_amplitude
        clearance = free * widest(self._between(free), BOTH, self.periods)
        if clearance == math.inf or self.regimes((1.0 - BELOW) * clearance):
            return clearance
        return free

    @property
    def harmonic_boundary(self) -> float:
        """The largest clearance by harmonic linearisation, a_p / ((b + (1 - R^2) w / pi) w), m (B
        9.15)."""
        return Harmonic(
            omega=self.omega, damping_rate=self.damping_rate, peak=self.amplitude,
            frequency=self.frequency, gap=0.0, restitution=self.restitution, both_sides=True,
        ).boundary  # fmt: skip

    def regimes(self, clearance: float) -> tuple[ResonantRegime, ...]:
        """Regimes between stops at -clearance and clearance (m), fastest first.

        Up to the energy boundary there are two of them where the clearance is above the amplitude
        without stops, of which the slower is unstable.

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
        w = self.frequency
        lag = math.atan2(self.damping_rate * w, self.omega**2 - w**2)
        return tuple(
            ResonantRegime(
                impact_speed=float(each.impact_speed[0]),
                phase=math.remainder(float(each.phase[0]) - lag, 2.0 * math.pi),
                # half of the period, after which the motion is its own mirror image
                multiplier=math.sqrt(each.multiplier),
                admissible=each.admissible,
            )
            for each in even_regimes(self._between(clearance), BOTH, self.periods)
        )


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

    See Also
    --------
    stochvi.methods.periodic.HarmonicResonance : The same regime under a sine.
    stochvi.methods.periodic.StructureResonance : The same of any structure.

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
            raise ValueError(
                "frequency must be above 0, and omega and damping_rate at least 0, got "
                f"{self.frequency:g}, {self.omega:g} and {self.damping_rate:g}"
            )
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
        if self.damping_rate == 0.0 and self.restitution == 1.0:
            raise ValueError(
                "damping_rate must be above 0 or restitution below 1, got 0 and 1; give one"
            )

    @cached_property
    def _regime(self) -> StructureResonance:
        """The regime as that of a structure of one mode."""
        return StructureResonance(
            omega=[self.omega], damping=[[self.damping_rate]], gaps=[[1.0]],
            clearance=[self.clearance], restitution=[self.restitution], frequency=self.frequency,
            both_sides=self.both_sides,
        )  # fmt: skip

    @property
    def impact_speed(self) -> float:
        """Impact speed of the regime, m/s: omega D cot(omega t) for two stops, -omega D tan(omega
        t) for one, t half the time between impacts."""
        return float(self._regime.impact_speed[0])

    @property
    def velocity_mean_square(self) -> float:
        """Mean square velocity of the regime, <y0'^2>, m^2/s^2."""
        return float(self._regime.velocity_products[0, 0])

    @cached_property
    def harmonics(self) -> Vector:
        """Amplitudes of y0' at w, 2 w, ... (m/s); two stops leave the odd ones only."""
        return self._regime.harmonics([1.0])

    @property
    def power_loss(self) -> float:
        """N_d = b <y0'^2> + (1 - R) J^2 / (2 (1 + R)) per impact, m^2/s^3 (B 14.71).

        The impulse per unit mass J = 2 v is that of the regime without loss, so that an impact
        takes 2 (1 - R) v^2 / (1 + R): what it takes from a speed of 2 v / (1 + R).
        """
        return self._regime.power_loss

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
        z = quantile(probability)
        return (z * self.random_power(intensity, 1.0) / self.power_loss) ** 2

    def smallest_narrow_band(self, probability: float = 0.98) -> float:
        """Rms (m/s^2) below which noise at w alone cannot maintain the regime (B 14.100, 14.101).

        A narrow band keeps its phase: its power over any time has the deviation a_1 / 2 times its
        rms, a_1 the first harmonic of y0', so that N_d / (z a_1 / 2) is needed.
        """
        return self.power_loss / (quantile(probability) * float(self.harmonics[0]) / 2.0)
