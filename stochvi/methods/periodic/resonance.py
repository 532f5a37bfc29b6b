"""Vibro-impact resonance and drives. Chapters: resonance of any structure, and how long noise
maintains it; one mass under a harmonic or random force; a motor of limited power; restitution that
scatters; a relay; a striker whose drive switches."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, Self

import numpy as np
import scipy
from numpy.typing import ArrayLike
from scipy.special import ndtri

from stochvi.mathematics.numerics import Matrix, Vector, gauss_panels
from stochvi.mathematics.spectra import InputMatrix, Table, transition
from stochvi.mathematics.units import outside_of_share, shown, with_checks
from stochvi.methods.periodic.continuation import even_regimes, widest
from stochvi.methods.periodic.family import (
    Numbers,
    first_harmonics,
    numbers_of,
    parts_of,
    unmet,
)
from stochvi.methods.periodic.sine_response import (
    Branch,
    Harmonic,
    HarmonicResponse,
    at_frequency,
)
from stochvi.model.coverage import nonlinear
from stochvi.model.model import Model, Pair, model_of
from stochvi.results.base import DataFrame, frame_of
from stochvi.results.errors import NotApplicable
from stochvi.sampling.calculations import calculation
from stochvi.scenes.scene import Scene

RANGES: dict[str, Callable[[float], bool]] = {
    "greater than 0": lambda value: 0.0 < value < math.inf,
    "0 or more": lambda value: 0.0 <= value < math.inf,
    "in [0, 1]": lambda value: 0.0 <= value <= 1.0,
    "in [0, 1)": lambda value: 0.0 <= value < 1.0,
}
"""Ranges of numbers, as messages name them."""


def _check(numbers: object, wanted: str, *names: str) -> None:
    """Raise ValueError for the first of some numbers that is outside a range; None is inside."""
    for name in names:
        value = getattr(numbers, name)
        if value is not None and not RANGES[wanted](value):
            raise ValueError(f"{name} must be {wanted}, got {value:g}")


# ------------------------------------------------------------------------------
# Vibro-impact resonance of any structure, and how long noise can maintain it.
#
# Resonant regimes are close to free motions between impacts without loss. Such a motion of a pair
# is its periodic response to its own impulses, y0 = -J chi(t). The response chi follows from the
# compliance at the pair, here mode by mode (Babitsky, section 14).
# ------------------------------------------------------------------------------


Strength = float | Table | Callable[[Vector], Vector]
"""A noise: its white intensity, or its density."""

HARMONICS = 255
"""Number of harmonics of a regime whose power noise of a table may supply. Those beyond have 0.2 %
of the power of a jump of velocity, whose harmonics fall like 1/m."""

NEARLY_EVEN = 1e-9
"""Relative difference of the distances of two stops up to which they count as equal."""

NEARLY_SINGULAR = 1e-12
"""Cosine or sine below which a mode counts as one that the regime excites without limit."""

TOUCHING = 1e-9
"""Depth to which a regime may pass a stop between impacts, relative to the clearance: rounding."""


@with_checks
@dataclass(frozen=True, kw_only=True, eq=False)
class StructureResonance:
    """A regime of a structure whose impacts lose nothing, once a period (B 14.70, 14.84).

    Several pairs may meet their stops at the same moments, in a cooperative regime. Their impulses
    J balance the clearances, with one column for each pair:

        D_i = sum over pairs and modes of phi_ik phi_jk cot(omega_k T / 2) / (-2 omega_k) J_j

    for one stop of each pair; for two stops the cotangent is -tan(omega_k T / 4).

    Parameters
    ----------
    omega
        Natural frequencies of the modes (n,), rad/s, above 0 where pairs have one stop.
    damping
        Damping matrix in coordinates of the modes, whose masses are 1 (n, n), 1/s.
    gaps
        Rows (pairs, n): the gap of a pair is y = row . q, positive towards the stop that it meets
        at the start of a period.
    clearance
        Distance of the stops of each pair from rest (pairs,), m; below 0 for a preload.
    restitution
        R of each pair (pairs,).
    frequency
        Frequency w of the regime, rad/s.
    both_sides
        Whether each pair meets two stops, half a period apart.
    noises
        White intensities, one-sided densities, or two-sided ones as functions of rad/s, each with
        the forces on the modes per unit of it. They alone would have to maintain the regime
        (B 14.88-14.101). A mass of 1 kg on its spring is the only mode of its structure.

    Raises
    ------
    ValueError
        If no such regime exists at this frequency.

    See Also
    --------
    stochvi.harmonic_response : The regimes that a sine maintains.

    Examples
    --------
    A mass between two stops, by the numbers of its only mode:

    >>> rattle = StructureResonance(
    ...     omega=[1.0], damping=[[0.01]], gaps=[[1.0]], clearance=[1.0], restitution=[0.8],
    ...     frequency=2.0, both_sides=True, noises=[(0.01, [1.0])],
    ... )
    >>> round(rattle.power_loss, 4), round(rattle.longest(), 2), rattle.admissible
    (0.1578, 2.77, True)
    """

    omega: ArrayLike
    damping: ArrayLike
    gaps: ArrayLike
    clearance: ArrayLike
    restitution: ArrayLike
    frequency: float
    both_sides: bool
    noises: Sequence[tuple[Strength, ArrayLike]] = ()

    def __post_init__(self) -> None:
        for name in ("omega", "damping", "gaps", "clearance", "restitution"):
            object.__setattr__(self, name, np.asarray(getattr(self, name), dtype=float))
        _check(self, "greater than 0", "frequency")
        if not np.all((self._restitution >= 0.0) & (self._restitution <= 1.0)):
            raise ValueError(f"restitution must be in [0, 1], got {self._restitution.tolist()}")
        if not self.both_sides and not np.all(self._omega > 0.0):
            raise ValueError(
                "omega must be above 0 where pairs have one stop, got 0; give a spring"
            )
        if np.abs(self._divisor).min() < NEARLY_SINGULAR:
            raise ValueError(
                "frequency must not be that of a mode, of which impacts at this frequency excite "
                f"vibration without limit, got {self.frequency:g}; change it a little"
            )
        speeds = self.impact_speed
        if not (np.all(self.impulse > 0.0) and np.all(speeds > 0.0)):
            raise ValueError(
                f"no free motion meets the stops at {self.frequency / math.tau:.4g} Hz; choose a "
                "frequency just above a natural one of the structure, or below it with a preload"
            )

    @classmethod
    def of(
        cls, scene: Scene, frequency_hz: float, *, pairs: Sequence[str] | None = None,
        opposed: Sequence[str] = (),
    ) -> Self:  # fmt: skip
        """The regime of a scene whose pairs meet their stops together.

        Parameters
        ----------
        scene
            A linear structure with white or tabulated noise. Impacts take no time, so that a
            compliant stop counts by its restitution.
        frequency_hz
            Frequency of the regime, Hz.
        pairs
            Names of the pairs that take part; by default all of them.
        opposed
            Pairs that meet their lower stop while the others meet their upper one.

        Raises
        ------
        NotApplicable
            If the scene is not of that kind.
        ValueError
            If there is no such regime at this frequency.

        Examples
        --------
        >>> from stochvi import load_scene
        >>> from stochvi.scenes import shipped_scene
        >>> reed = load_scene(shipped_scene("beam"))
        >>> found = StructureResonance.of(reed, 42.0)
        >>> found.impact_speed.round(3).tolist(), round(found.longest(), 2)
        ([0.079], 0.02)
        """
        model = model_of(scene)
        taking = [each for each in model.pairs if pairs is None or each.name in pairs]
        unmet = _unmet(model, taking)
        known = [each.name for each in model.pairs]
        unmet += [
            f"opposed must name pairs with two stops, got {each.name!r}"
            for each in taking
            if each.name in opposed and len(each.stops) < 2
        ]
        unmet += [
            f"pairs must be among {', '.join(known)}, got {name!r}"
            for name in (*(pairs or ()), *opposed)
            if name not in known
        ]
        if unmet:
            raise NotApplicable("resonance", unmet)
        modes = model.modal
        rows, places, losses = [], [], []
        for pair in taking:
            number = known.index(pair.name)
            stop = pair.upper or pair.stops[0]
            side = stop.side * (-1 if pair.name in opposed else 1)
            rows.append(side * modes.gaps[number])
            places.append(stop.distance - stop.side * float(modes.gaps[number] @ modes.rest))
            losses.append(stop.law.restitution)
        noises: list[tuple[Strength, ArrayLike]] = [
            (intensity, modes.shapes.T @ row) for intensity, row in model.whites
        ]
        for table, row in model.tables:
            assert not isinstance(row, InputMatrix)
            noises.append((table, modes.shapes.T @ row))
        return cls(
            omega=np.sqrt(modes.squares),
            damping=modes.damping,
            gaps=np.array(rows),
            clearance=np.array(places),
            restitution=np.array(losses),
            frequency=math.tau * frequency_hz,
            both_sides=len(taking[0].stops) == 2,
            noises=noises,
        )

    @property
    def _omega(self) -> Vector:
        return np.asarray(self.omega)

    @property
    def _gaps(self) -> Matrix:
        return np.asarray(self.gaps)

    @property
    def _restitution(self) -> Vector:
        return np.asarray(self.restitution)

    @property
    def period(self) -> float:
        """Period T of the regime, s."""
        return math.tau / self.frequency

    @property
    def _half(self) -> float:
        """Half of the time between two successive impacts of a pair, s."""
        return self.period * (0.25 if self.both_sides else 0.5)

    @cached_property
    def _divisor(self) -> Vector:
        """sin(omega T / 2) for one stop, cos(omega T / 4) for two (n,)."""
        angle = self._omega * self._half
        return np.asarray(np.cos(angle) if self.both_sides else np.sin(angle))

    def response(self, time: ArrayLike) -> tuple[Matrix, Matrix]:
        """Displacement and velocity of the modes (n, times) between two successive impacts, per
        unit impulse on each (B 6.67, 6.68).

        Parameters
        ----------
        time
            Seconds after an impact, up to the next one.
        """
        omega, late = self._omega[:, None], np.asarray(time, dtype=float)[None] - self._half
        scale = 0.5 / self._divisor[:, None]
        if self.both_sides:
            shape = late * np.sinc(omega * late / math.pi)
            return scale * shape, scale * np.cos(omega * late)
        return scale * np.cos(omega * late) / omega, -scale * np.sin(omega * late)

    @cached_property
    def impulse(self) -> Vector:
        """Impulse of each pair on its stop (pairs,), kg m/s."""
        at_impact = self.response(0.0)[0][:, 0]
        compliance = -(self._gaps * at_impact) @ self._gaps.T
        return np.asarray(np.linalg.solve(compliance, np.asarray(self.clearance)))

    @cached_property
    def impact_speed(self) -> Vector:
        """Impact speed of each pair (pairs,), m/s: half of the change by its impulses."""
        return np.asarray(0.5 * self._gaps @ self._gaps.T @ self.impulse)

    @cached_property
    def _force(self) -> Vector:
        """Impulse on each mode (n,)."""
        return np.asarray(-self._gaps.T @ self.impulse)

    @cached_property
    def _motion(self) -> tuple[Matrix, Matrix, Vector]:
        """Displacements and velocities of the modes (n, nodes) between two impacts, and weights of
        their average over that time."""
        span = 2.0 * self._half
        panels = 2 + int(2.0 * self._omega.max() * span / math.pi)
        nodes, weights = gauss_panels(np.linspace(0.0, span, panels + 1), 16)
        q, v = self.response(nodes.ravel())
        scale = self._force[:, None]
        return scale * q, scale * v, np.ravel(weights) / span

    @property
    def admissible(self) -> bool:
        """Whether no pair of the regime passes its stops between impacts."""
        y = self._gaps @ self._motion[0]
        reach = np.asarray(self.clearance)[:, None]
        beyond = np.abs(y) - reach if self.both_sides else y - reach
        return bool(np.all(beyond <= TOUCHING * np.abs(reach)))

    @cached_property
    def velocity_products(self) -> Matrix:
        """Averages of q' q'' over the regime (n, n), with unit modal masses."""
        _, v, weights = self._motion
        return np.asarray((v * weights) @ v.T)

    def harmonics(self, forces: ArrayLike) -> Vector:
        """Amplitudes at w, 2 w, ... of forces . q', the power per unit of an excitation."""
        order = np.arange(1, HARMONICS + 1)
        w = order * self.frequency
        times = 4.0 * (order % 2) if self.both_sides else np.full(HARMONICS, 2.0)
        dynamic = w / (self._omega[:, None] ** 2 - w**2)
        each = np.asarray(forces, dtype=float) * self._force
        return np.asarray(np.abs(times / self.period * (each @ dynamic)))

    @cached_property
    def energy(self) -> float:
        """Energy of the regime, of its springs and its motion, J."""
        q, v = (part[:, 0] * self._force for part in self.response(np.zeros(1)))
        return 0.5 * float(np.sum(v**2) + np.sum((self._omega * q) ** 2))

    @cached_property
    def power_loss(self) -> float:
        """N_d = mean of q' C q' + (1 - R) J^2 / (2 (1 + R) M) per impact, W (B 14.71).

        M is the reduced mass of a pair. Where pairs share motion, J^2 / M is the energy 2 J v of
        the impulse on its own pair.
        """
        impacts = 0.5 / self._half
        share = (1.0 - self._restitution) / (1.0 + self._restitution)
        lost = float(np.sum(share * self.impulse * self.impact_speed)) * impacts
        found = float(np.sum(np.asarray(self.damping) * self.velocity_products)) + lost
        if found == 0.0:
            raise ValueError(
                "damping must be above 0 or restitution below 1, got 0 and 1; give one"
            )
        return found

    def random_power(self, duration: float) -> float:
        """Standard deviation of the power that the noises supply, averaged over a time (s), W.

        The variance under white noise is S0 / T times the mean of (g . q')^2 (B 14.88). Under noise
        of a table it is the sum of a_m^2 S(m w) / 2 T over the harmonics a_m of g . q'. The table
        must change little over 1 / T.
        """
        total = 0.0
        for strength, forces in self.noises:
            if callable(strength):
                omega = self.frequency * np.arange(1.0, HARMONICS + 1)
                tabulated = isinstance(strength, Table)
                density = 0.5 * strength(omega / math.tau) if tabulated else strength(omega)
                total += float(np.sum(0.5 * self.harmonics(forces) ** 2 * density))
            else:
                g = np.asarray(forces, dtype=float)
                total += strength * float(g @ self.velocity_products @ g)
        return math.sqrt(total / duration)

    def longest(self, probability: float = 0.98) -> float:
        """Time (s) over which noise cannot maintain the regime with this probability (B 14.93).

        T0 = z^2 T s^2 / N_d^2, s the deviation of the supply averaged over T: a longer time asks
        more of the noise than z deviations. The energy that the regime starts with lasts beside
        that: see `ended_by`.
        """
        z = quantile(probability)
        return (z * self.random_power(1.0) / self.power_loss) ** 2

    def ended_by(self, probability: float = 0.98) -> float:
        """Time (s) after which a regime has ended with this probability, once it was started.

        N_d T - E = z s sqrt(T), where E is its `energy`. The left side is what it would lose at
        full speed beyond its energy; noise supplies an energy of the deviation s sqrt(T). So T
        exceeds both E / N_d and T0.
        """
        swing = quantile(probability) * self.random_power(1.0)
        root = math.sqrt(swing**2 + 4.0 * self.power_loss * self.energy)
        return ((swing + root) / (2.0 * self.power_loss)) ** 2

    def smallest_narrow_band(self, forces: ArrayLike, probability: float = 0.98) -> float:
        """Rms below which an excitation at w alone cannot maintain the regime (B 14.100, 14.101).

        Parameters
        ----------
        forces
            Forces on the modes (n,) per unit of the excitation, as in `noises`.
        probability
            Probability that it cannot.
        """
        return self.power_loss / (quantile(probability) * float(self.harmonics(forces)[0]) / 2.0)


def quantile(probability: float) -> float:
    """Quantile z of the normal distribution of a probability above a half."""
    if not 0.5 < probability < 1.0:
        raise outside_of_share("probability", "above 0.5 and below 1", probability)
    return float(ndtri(probability))


def _unmet(model: Model, pairs: Sequence[Pair]) -> list[str]:
    """The conditions that a scene does not meet, in sentences."""
    found = nonlinear(model)
    if not pairs:
        return [*found, "the scene needs an impact_pair that takes part, got none"]
    if any(signal.intensity or signal.amplitude for signal in model.signals) or any(
        isinstance(force, InputMatrix) for _, force in model.tables
    ):
        found.append("excitation must be white or tabulated noise of one axis")
    if len({len(pair.stops) for pair in pairs}) > 1:
        found.append("pairs must all have one stop or all have two, got both; name some by pairs")
    for pair in pairs:
        if any(stop.coefficient is None and stop.law.rigid for stop in pair.stops):
            found.append(f"restitution must be one number, got another law at {pair.name}")
        if pair.lower is None or pair.upper is None:
            continue
        number = [each.name for each in model.pairs].index(pair.name)
        low, high = (stop.distance for stop in (pair.lower, pair.upper))
        if abs(high - low - 2.0 * model.mean_gaps[number]) > NEARLY_EVEN * abs(high + low):
            found.append(
                f"the stops of {pair.name} must lie evenly about its mean position, got distances "
                f"of {high - model.mean_gaps[number]:g} and {low + model.mean_gaps[number]:g} m"
            )
        if pair.lower.law.restitution != pair.upper.law.restitution:
            found.append(
                f"restitution must be the same at both stops of {pair.name}, got "
                f"{pair.lower.law.restitution:g} and {pair.upper.law.restitution:g}"
            )
    return found


# ------------------------------------------------------------------------------
# Vibro-impact resonance: how it is kept up by a harmonic force, and how long by a random one.
#
# Between stops a mass has regimes in which it hits them once a period, besides rest or motion
# without impacts. A harmonic force keeps one up as long as the gap is below an energy boundary;
# random thrust supplies on average no power to it, and by chance enough only for a while.
# ------------------------------------------------------------------------------


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


@with_checks
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
    stochvi.isolators.perturbations : Which perturbation leads to clatter.

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
        _check(self, "0 or more", "omega", "damping_rate")
        _check(self, "greater than 0", "amplitude", "frequency")
        _check(self, "in [0, 1]", "restitution")
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


# ------------------------------------------------------------------------------
# A motor of limited power that shakes a structure against its stops (B 12.37, 12.42).
#
# The structure takes from the motor what its damping and its impacts lose, and the speed of the
# motor settles where it can give that. So the frequency of the sine is no longer given.
# ------------------------------------------------------------------------------


COLUMNS = (
    "branch", "frequency_hz", "torque", "power", "displacement_max", "impact_speed_max", "stable",
)  # fmt: skip
"""Columns of the table of regimes of a motor."""


@with_checks
@dataclass(frozen=True, kw_only=True)
class Motor:
    """A motor whose torque falls with its speed, slope (w0 - w), and which makes a sine.

    The sine may be a crank on the spring or a rotor with an unbalance: by the balance of power the
    load of the motor is in the mean

        L(w) = P(w) / w,

    with P the power that the sine brings into the structure. Where the inertia of the motor is
    large, its speed settles where slope (w0 - w) = L(w) (B 12.37, 12.42). A regime is stable where
    the structure alone is, and the load rises faster than the torque along its branch. On the far
    side of a resonance it may fall faster: then speeds are left out (Sommerfeld's effect).

    A torque may follow the speed with a time constant T, as that of an electric motor does. The
    regimes stay where they are. A deviation s of the speed then obeys

        J T s'' + (J + T L') s' + (slope + L') s = 0,

    with the inertia J. So a load that falls along its branch, L' < 0, may also let the speed swing
    up: it does where T > -J / L'.

    Parameters
    ----------
    idle_hz
        Speed w0 without load, turns per second.
    slope
        Fall of the torque with the speed, N m s.
    lag
        Time constant T, s, with which the torque follows the speed; 0 by default.
    inertia
        Inertia J of motor and crank, kg m^2, for a torque with a lag.

    Raises
    ------
    ValueError
        If a number is not positive, or a lag has no inertia.

    See Also
    --------
    stochvi.harmonic_response : Regimes at a given frequency.

    Examples
    --------
    A crank of 2 mm on the spring of a mass with a stop:

    >>> import numpy as np
    >>> import stochvi
    >>> scene = stochvi.Scene(
    ...     structure=stochvi.Oscillator(mass=1.0, damping=0.4, stiffness=100.0),
    ...     impact_pairs=[
    ...         stochvi.ImpactPair(upper=0.02, law=stochvi.Restitution(coefficient=0.6))
    ...     ],
    ...     excitations=[stochvi.Sine(amplitude=0.2, frequency_hz=1.6)],
    ... )
    >>> response = stochvi.harmonic_response(scene, np.linspace(1.3, 2.6, 53))
    >>> table = Motor(idle_hz=1.9, slope=0.004).regimes(scene, response)
    >>> bool((table["frequency_hz"] < 1.9).all())
    True
    """

    idle_hz: float
    slope: float
    lag: float = 0.0
    inertia: float | None = None

    def __post_init__(self) -> None:
        _check(self, "greater than 0", "idle_hz", "slope", "inertia")
        _check(self, "0 or more", "lag")
        if self.lag and self.inertia is None:
            raise ValueError(f"inertia must be given with a lag, got none with {self.lag:g} s")

    def torque(self, frequency_hz: Vector) -> Vector:
        """Torque at speeds in turns per second, N m.

        Parameters
        ----------
        frequency_hz
            The speeds.
        """
        return np.asarray(self.slope * 2.0 * math.pi * (self.idle_hz - np.asarray(frequency_hz)))

    def regimes(self, scene: Scene, response: HarmonicResponse) -> DataFrame:
        """Where the motor settles.

        Parameters
        ----------
        scene
            The scene, with one sine and rigid stops.
        response
            Its regimes over a range of frequencies, by `harmonic_response`. Between two of these
            the answer is interpolated: their distance decides how exact it is.

        Returns
        -------
        DataFrame
            A row for each regime: `branch` of the response, `frequency_hz`, `torque` (N m), `power`
            (W), `displacement_max` (m), `impact_speed_max` (m/s) and whether it is `stable`.

        Raises
        ------
        NotApplicable
            If the scene has several sines, or stops that are not rigid, or the response is not one
            over the frequency.
        """
        if response.key != "frequency_hz":
            raise NotApplicable(
                "motor", f"the response must be one over frequency_hz, got {response.key}"
            )
        rows = [
            (number, *row)
            for number, branch in enumerate(response.branches)
            for row in self._settles(scene, branch)
        ]
        return frame_of(rows, columns=list(COLUMNS))

    def _settles(self, scene: Scene, branch: Branch) -> Iterator[tuple[float | bool, ...]]:
        """The regimes on one branch: where torque and load are equal."""
        power = sine_power(scene, branch)
        load = power / (2.0 * math.pi * branch.frequency_hz)
        excess = self.torque(branch.frequency_hz) - load
        fastest = branch.impact_speed.max(axis=1, initial=0.0)
        columns = (branch.frequency_hz, load, power, branch.displacement_max, fastest)
        lasting = branch.admissible & np.isfinite(excess)
        for i in np.flatnonzero(lasting[:-1] & lasting[1:] & (excess[:-1] * excess[1:] < 0.0)):
            share = excess[i] / (excess[i] - excess[i + 1])
            values = [float(each[i] + share * (each[i + 1] - each[i])) for each in columns]
            way = 2.0 * math.pi * (branch.frequency_hz[i + 1] - branch.frequency_hz[i])
            steepness = float(load[i + 1] - load[i]) / way
            held = self.slope + steepness > 0.0
            if self.inertia is not None:
                held = held and self.inertia + self.lag * steepness > 0.0
            yield (*values, bool(branch.stable[i] & branch.stable[i + 1]) and held)


@calculation
def sine_power(scene: Scene, branch: Branch) -> Vector:
    """Mean power that the sine brings into a structure in each regime of a branch, W.

    Only the first harmonic of the motion takes power from a sine. It follows from that of the
    impulses J = (1 + R) m w of the impacts, at the phases theta, in P periods:

        q = (K - w^2 M + i w C)^-1 (A - w / (pi P) sum of J row e^(-i theta)),
        power = Re(conj(A) i w q) / 2.

    Parameters
    ----------
    scene
        A scene with one sine and rigid stops.
    branch
        A branch of its `harmonic_response`.

    Returns
    -------
    NDArray
        (points,), W; NaN where phases are not known, as with rests on a stop.

    Raises
    ------
    NotApplicable, ValueError
        If the scene has several sines, or stops that are not rigid; if `branch` is no branch.

    See Also
    --------
    Motor : A motor that gives this power.

    Examples
    --------
    Without impacts the power is that of the damper, c w^2 a^2 / 2:

    >>> import math
    >>> import stochvi
    >>> scene = stochvi.Scene(
    ...     structure=stochvi.Oscillator(mass=1.0, damping=0.4, stiffness=100.0),
    ...     excitations=[stochvi.Sine(amplitude=0.2, frequency_hz=1.6)],
    ... )
    >>> (branch,) = stochvi.harmonic_response(scene, [1.6]).branches
    >>> (point,) = branch.at(1.6)
    >>> power = float(sine_power(scene, branch)[point])
    >>> by_damper = 0.2 * (2.0 * math.pi * 1.6 * float(branch.amplitude[point])) ** 2
    >>> round(power / by_damper, 9)
    1.0
    """
    if not isinstance(branch, Branch):
        raise ValueError(f"branch must be one of harmonic_response, got {shown(branch)}")
    model = model_of(scene)
    conditions = unmet(model)
    if len(model.sines) > 1:
        conditions.append(f"excitation must be one sine, got {len(model.sines)}")
    if conditions:
        raise NotApplicable("sine_power", conditions)
    factors = branch.frequency_hz / (model.sines[0].omega / math.tau)
    numbers = [numbers_of(model_of(at_frequency(scene, float(each))), 0) for each in factors]
    flat, sizes = np.array([each.flat for each in numbers]), numbers[0].sizes
    known = [f"{pair.name} {stop.name}" for pair in model.pairs for stop in pair.stops]
    stops = [known.index(each) for each in branch.stops]
    moved = first_harmonics(
        flat, sizes, stops, branch.periods, branch.phase, branch.impact_speed
    )  # fmt: skip
    parts = parts_of(flat, sizes)
    force, omega = parts["forces"][:, :, 0] - 1j * parts["forces"][:, :, 1], parts["omega"][:, None]
    return np.asarray(np.sum(np.conj(force) * 1j * omega * moved, axis=1).real / 2.0)


# ------------------------------------------------------------------------------
# Scatter of impact speeds where the restitution scatters from impact to impact.
# ------------------------------------------------------------------------------


STEP = 1e-3
"""Relative step of the second derivative of the next speed."""

MOST_TURNS, SETTLED = 200, 1e-12
"""Largest number of turns of the iteration for the variance, and the change at which it ends."""


def speed_scatter(
    next_speed: Callable[[float], float], kept: float, speed: float, restitution: float, std: float
) -> float:
    """Standard deviation of the impact speeds w in the long run, m/s, to second order.

    A restitution acts by the rebound u = R w alone, whose variance is
    R^2 V + std^2 (w^2 + V), V that of w. The next speed w'(u) has the variance

        (dw' / du)^2 var u + (d^2 w' / du^2)^2 (var u)^2 / 2

    for a Gaussian u. The first term alone is the first order, which fails where dw' / du is near 0.

    Parameters
    ----------
    next_speed, kept
        The speed of the next impact, of that of one, and its derivative in the long run.
    """
    if not restitution > 0.0 or not std > 0.0:
        return 0.0
    step = STEP * speed
    bend = (next_speed(speed + step) - 2.0 * speed + next_speed(speed - step)) / step**2
    slope, curve = kept / restitution, bend / restitution**2
    variance = 0.0
    for _ in range(MOST_TURNS):
        of_rebound = restitution**2 * variance + std**2 * (speed**2 + variance)
        following = slope**2 * of_rebound + 0.5 * (curve * of_rebound) ** 2
        if abs(following - variance) <= SETTLED * following:
            break
        variance = following
    return math.sqrt(following)


# ------------------------------------------------------------------------------
# A mass that a relay drives from stop to stop (B 12.3, 12.20, 12.21, 12.22, 12.23).
# ------------------------------------------------------------------------------


PARTS = 0.05
"""Longest part of a flight in which its end is searched for: as a share of a flight without spring
and damper, and in radians of the free motion."""

MOST_PARTS = 100_000
"""Most parts of a flight."""

FASTEST = 1e12
"""Largest impact speed that is searched for, in units of that of one flight from rest."""


@with_checks
@dataclass(frozen=True, kw_only=True)
class RelayBetweenStops:
    """A force of constant size along the motion of a mass between two rigid stops.

    Per unit mass x'' + b x' + w0^2 x = U sign(x'), with stops of the restitution R at -c and c. The
    motion from one stop to the other is linear, and known in closed form.

    Parameters
    ----------
    force
        U, m/s^2.
    clearance
        c, m.
    restitution
        R of both stops, from 0 to 1.
    damping_rate
        b, 1/s; above 0 if R is 1.
    frequency
        Natural frequency w0, rad/s; 0 without a spring.

    Raises
    ------
    ValueError
        If a number is out of its range, or the force is below `least_force`.

    See Also
    --------
    SwitchedDrive : A striker that is thrown off one stop.
    stochvi.scenes.Relay : The drive in a scene, with noise, delay and compliant stops.

    Examples
    --------
    Without spring and damper the work of the force replaces what impacts take, (1 - R^2) w^2 / 2 =
    2 U c:

    >>> drive = RelayBetweenStops(force=2.0, clearance=0.5, restitution=0.6)
    >>> round(drive.impact_speed, 9), round(2.0 * (2.0 * 0.5 / (1.0 - 0.6**2)) ** 0.5, 9)
    (2.5, 2.5)

    A spring makes the motion faster; the book's frequency is that of the first harmonic:

    >>> drive = RelayBetweenStops(
    ...     force=2.0, clearance=0.5, restitution=0.6, damping_rate=0.1, frequency=2.0
    ... )
    >>> round(2.0 * math.pi / drive.period, 2), round(drive.harmonic_frequency, 2)
    (6.47, 4.76)
    """

    force: float
    clearance: float
    restitution: float
    damping_rate: float = 0.0
    frequency: float = 0.0

    def __post_init__(self) -> None:
        _check(self, "greater than 0", "force", "clearance")
        _check(self, "0 or more", "damping_rate", "frequency")
        _check(self, "in [0, 1]", "restitution")
        if self.restitution == 1.0 and self.damping_rate == 0.0:
            raise ValueError("damping_rate must be greater than 0 with a restitution of 1, got 0")
        if self.force <= self.least_force:
            raise ValueError(
                f"force must be greater than {self.least_force:.4g}, got {self.force:g}: the mass "
                "does not reach its stops"
            )

    @property
    def least_force(self) -> float:
        """Force, m/s^2, above which the mass reaches its stops.

        Without them it swings to U (1 + q) / ((1 - q) w0^2), with q the decay of half a free swing;
        the force is that of the amplitude c, w0^2 c tanh(pi b / (4 wd)), wd^2 = w0^2 - b^2 / 4. It
        is w0^2 c where the motion is overdamped.
        """
        square = self.frequency**2
        rest = square - self.damping_rate**2 / 4.0
        if rest <= 0.0:
            return square * self.clearance
        angle = math.pi * self.damping_rate / (4.0 * math.sqrt(rest))
        return square * self.clearance * math.tanh(angle)

    @property
    def harmonic_least_force(self) -> float:
        """The same by the first harmonic, pi c w0 (b + p w0) / 4 with p = (1 - R^2) / pi
        (B 12.23). It counts impacts that take energy at the boundary, where they are slow: the
        mass reaches its stops by less."""
        loss = self.damping_rate + self._impact_loss * self.frequency
        return math.pi / 4.0 * self.clearance * self.frequency * loss

    @property
    def harmonic_frequency(self) -> float:
        """Frequency by the first harmonic, rad/s, b (sqrt(1 + 16 p U / (pi b^2 c)) - 1) / (2 p)
        (B 12.20, 12.21, 12.22); valid from `harmonic_least_force` on."""
        p, b = self._impact_loss, self.damping_rate
        scaled = 4.0 * self.force / (math.pi * self.clearance)  # = p w^2 + b w
        return 2.0 * scaled / (b + math.sqrt(b**2 + 4.0 * p * scaled))

    @property
    def _impact_loss(self) -> float:
        """p, damping by impacts over the frequency (B 7.62)."""
        return (1.0 - self.restitution**2) / math.pi

    @cached_property
    def _generator(self) -> Matrix:
        """Matrix of (x, x', 1)' on the way up."""
        return np.array(
            [
                [0.0, 1.0, 0.0],
                [-(self.frequency**2), -self.damping_rate, self.force],
                [0.0, 0.0, 0.0],
            ]
        )

    def flight(self, speed: float) -> tuple[float, float]:
        """Duration, s, of the motion from stop to stop after an impact at a speed, m/s, and the
        speed with which it ends.

        Parameters
        ----------
        speed
            Speed of the impact before, m/s.

        Raises
        ------
        ValueError
            If the mass turns before it has reached the other stop.
        """
        state = np.array([-self.clearance, self.restitution * speed, 1.0])
        last = math.sqrt(state[1] ** 2 + 4.0 * self.force * self.clearance)
        free = (last - state[1]) / self.force
        part = PARTS * min(free, 1.0 / self.frequency if self.frequency else math.inf)
        step, passed = transition(self._generator, part), 0.0
        for _ in range(MOST_PARTS):
            following = step @ state
            if following[0] >= self.clearance:
                break
            if following[1] <= 0.0:
                raise ValueError(
                    f"speed must let the mass reach the other stop, got {speed:.4g} m/s"
                )
            state, passed = following, passed + part

        def ahead(time: float) -> float:
            return float((transition(self._generator, time) @ state)[0]) - self.clearance

        end = float(scipy.optimize.brentq(ahead, 0.0, part, xtol=1e-15 * part, rtol=1e-14))
        return passed + end, float((transition(self._generator, end) @ state)[1])

    def next_speed(self, speed: float) -> float:
        """Speed of the impact after one of a speed, m/s.

        Parameters
        ----------
        speed
            Speed of the impact before, m/s.
        """
        return self.flight(speed)[1]

    @cached_property
    def impact_speed(self) -> float:
        """Speed of the impacts in the long run, m/s: the one that leads back to itself. Without a
        damper it is 2 sqrt(U c / (1 - R^2)), whatever the spring."""
        high = unit = self.next_speed(0.0)
        while self.next_speed(high) > high and high < FASTEST * unit:
            high *= 2.0
        if high == unit:
            return unit
        return float(
            scipy.optimize.brentq(lambda w: self.next_speed(w) - w, unit, high, rtol=1e-13)
        )

    @property
    def period(self) -> float:
        """Time between two impacts on the same stop in the long run, s."""
        return 2.0 * self.flight(self.impact_speed)[0]

    @property
    def forgotten(self) -> float:
        """Share of a small difference of impact speeds that the next impact keeps, dw' / dw.

        With phi(t) the free motion from (0, 1), it is R (phi' - a phi / w), a the acceleration just
        before the impact: R^2 without a damper and a spring.
        """
        duration, speed = self.flight(self.impact_speed)
        moved, changed = transition(self._generator, duration)[:2, 1]
        last = self.force - self.damping_rate * speed - self.frequency**2 * self.clearance
        return float(self.restitution * (changed - last * moved / speed))

    def speed_std(self, restitution_std: float) -> float:
        """Standard deviation of the impact speeds in the long run, m/s, where the restitution
        scatters a little from impact to impact.

        To second order, see `speed_scatter`.

        Parameters
        ----------
        restitution_std
            Standard deviation of the restitution, much smaller than R.
        """
        return speed_scatter(
            self.next_speed, self.forgotten, self.impact_speed, self.restitution, restitution_std
        )


# ------------------------------------------------------------------------------
# A striker whose drive switches by its position and the direction of its motion.
#
# A drive with a delay switches later: its force is that of the motion a time t0 ago (B 20.3). After
# an impact it then still acts towards the stop for t0, and away from it for t0 beyond x*.
# ------------------------------------------------------------------------------


class Throw(NamedTuple):
    """A throw of the striker, from one impact to the next.

    Parameters
    ----------
    thrown
        Distance from the stop at which the force away from it begins, m.
    rising
        Speed there, m/s.
    passing
        Speed at the switching distance, m/s.
    reversed_at, fastest
        Distance from the stop, m, and speed, m/s, where the force reverses.
    speed
        Speed of the next impact, m/s.
    """

    thrown: float
    rising: float
    passing: float
    reversed_at: float
    fastest: float
    speed: float


@with_checks
@dataclass(frozen=True, kw_only=True)
class SwitchedDrive:
    """A striker that a force of constant size throws off its stop and back.

    Per unit mass, the force is `force` away from the stop while the striker rises below
    `switching`, and `force` towards the stop otherwise (B 19.11). A `load` acts towards the stop.

    Parameters
    ----------
    restitution
        R of the stop, from 0 to below 1.
    force
        Size U of the force per unit mass, m/s^2.
    switching
        Distance x* from the stop at which the force reverses, m.
    load
        Constant load g per unit mass, m/s^2, below `force`.
    delay
        Time t0 by which the drive switches late, s.

    Raises
    ------
    ValueError
        If a number is out of its range.

    See Also
    --------
    stochvi.harmonic_response : Strikers that a sine drives.

    Examples
    --------
    The strongest impact once a second, with R = 0.5 and a force of 10 m/s^2, and the first impacts
    from rest:

    >>> striker = SwitchedDrive.strongest(restitution=0.5, force=10.0, period=1.0)
    >>> round(striker.switching, 4), round(striker.impact_speed, 3)
    (0.4329, 4.805)
    >>> striker.start_up(0.0, 3).round(2).tolist()
    [4.16, 4.65, 4.77]

    A delay of 20 ms, and a restitution that scatters by 0.1 from impact to impact:

    >>> late = SwitchedDrive(restitution=0.5, force=10.0, switching=0.4329, delay=0.02)
    >>> round(late.impact_speed, 3), round(late.speed_std(0.1), 3)
    (4.949, 0.24)
    """

    restitution: float
    force: float
    switching: float
    load: float = 0.0
    delay: float = 0.0

    def __post_init__(self) -> None:
        _check(self, "in [0, 1)", "restitution")
        _check(self, "greater than 0", "switching")
        if not 0.0 <= self.load < self.force:
            raise ValueError(
                f"load must be in [0, force), got {self.load:g} with force {self.force:g}; a "
                "larger load holds the striker on its stop"
            )
        _check(self, "0 or more", "delay")

    @classmethod
    def strongest(
        cls, *, restitution: float, force: float, period: float, load: float = 0.0
    ) -> Self:
        """The drive with the fastest impacts of a period among all forces of at most this size.

        The force reverses after the time t of each period T,

            t / T = (2 - sqrt(2 (1 + R^2) - 2 y (1 - R^2))) / (2 (1 + R)),    y = g / U,

        and the impact speed is (1 + y - 2 t / T) U T / (1 + R) (B 18.31, 18.34, 18.35).

        Parameters
        ----------
        restitution, force, load
            As for the class.
        period
            Period T, s.

        Returns
        -------
        SwitchedDrive
            The drive, with its switching distance.
        """
        if not period > 0.0:
            raise ValueError(f"period must be greater than 0 s, got {period:g}")
        r, y = restitution, load / force
        root = math.sqrt(2.0 * (1.0 + r**2) - 2.0 * y * (1.0 - r**2))
        t = period * (2.0 - root) / (2.0 * (1.0 + r))
        speed = (1.0 + y - 2.0 * t / period) * force * period / (1.0 + r)
        switching = r * speed * t + (force - load) * t**2 / 2.0
        return cls(restitution=r, force=force, switching=switching, load=load)

    def throw(self, speed: float) -> Throw:
        """The throw after an impact of a speed w, m/s.

        With u = R w the striker rises by x1 = u t0 - (U + g) t0^2 / 2 against the force. That then
        takes it to x*, where it has the speed v, v^2 = (u - (U + g) t0)^2 + 2 (U - g) (x* - x1),
        and to x2 = x* + v t0 + (U - g) t0^2 / 2. The work of the force gives the next speed,

            w'^2 = R^2 w^2 + 4 U (x2 - x1),

        which without a delay is R^2 w^2 + 4 U x* (B 19.17). From rest, w = 0, nothing is late but
        the reversal.

        Parameters
        ----------
        speed
            Speed of the impact, m/s.

        Returns
        -------
        Throw
            The throw to the next impact.

        Raises
        ------
        ValueError
            If the force comes so late that the striker falls back onto its stop, or passes x*.
        """
        up, down, late = self.force - self.load, self.force + self.load, self.delay
        after = self.restitution * speed
        wait = late if speed else 0.0
        thrown, rising = after * wait - down * wait**2 / 2.0, after - down * wait
        lowest = thrown - min(rising, 0.0) ** 2 / (2.0 * up)
        if lowest < 0.0 or thrown > self.switching:
            raise ValueError(
                f"delay must be so short that the striker neither falls back onto its stop nor "
                f"passes switching before it is thrown, got {late:g} s after an impact at "
                f"{speed:.4g} m/s"
            )
        passing = math.sqrt(rising**2 + 2.0 * up * (self.switching - thrown))
        reversed_at = self.switching + passing * late + up * late**2 / 2.0
        work = 4.0 * self.force * (reversed_at - thrown)
        return Throw(
            thrown, rising, passing, reversed_at, passing + up * late,
            math.sqrt(after**2 + work),
        )  # fmt: skip

    @cached_property
    def impact_speed(self) -> float:
        """Speed of the impacts in the long run, m/s: the speed that its own `throw` leads back to.
        Without a delay it is 2 sqrt(U x* / (1 - R^2)) (B 19.18)."""
        speed = 2.0 * math.sqrt(self.force * self.switching / (1.0 - self.restitution**2))
        for _ in range(MOST_THROWS if self.delay else 0):
            following = self.next_speed(speed)
            if abs(following - speed) <= DRIVE_SETTLED * speed:
                return following
            speed = following
        return speed

    @property
    def highest(self) -> float:
        """Largest distance from the stop in the long run, m: from there the striker falls to its
        speed, w^2 / (2 (U + g)). Without a delay it is 2 x* / ((1 + g / U) (1 - R^2)); the book
        prints 1 - g / U (B 19.21)."""
        return self.impact_speed**2 / (2.0 * (self.force + self.load))

    @property
    def period(self) -> float:
        """Time between two impacts in the long run, s (B 19.20)."""
        up, down = self.force - self.load, self.force + self.load
        found = self.throw(self.impact_speed)
        rise = (found.passing - found.rising) / up
        return 2.0 * self.delay + rise + (found.fastest + found.speed) / down

    @property
    def forgotten(self) -> float:
        """Share of a small difference of impact speeds that the next impact keeps, dw' / dw.

        It is (R^2 w + 2 U R t0 ((R w - 2 U t0) / v - 1)) / w', with v the speed at x*: without a
        delay R^2, so that the motion is always stable.
        """
        r, late = self.restitution, self.delay
        speed = self.impact_speed
        passing = self.throw(speed).passing
        turned = (r * speed - 2.0 * self.force * late) / passing - 1.0
        return (r**2 * speed + 2.0 * self.force * r * late * turned) / speed

    def speed_std(self, restitution_std: float) -> float:
        """Standard deviation of the impact speeds in the long run, m/s, where the restitution
        scatters a little from impact to impact.

        See `speed_scatter`: to second order in the scatter of the rebounds. The first order is
        abs(q) w std / (R sqrt(1 - q^2)) with q = `forgotten`; it is up to two times
        too small where a delay makes q small.

        Parameters
        ----------
        restitution_std
            Standard deviation of the restitution, much smaller than R.
        """
        return speed_scatter(
            self.next_speed, self.forgotten, self.impact_speed, self.restitution, restitution_std
        )

    def next_speed(self, speed: float) -> float:
        """Speed of the impact after one of a speed, m/s; see `throw`."""
        return self.throw(speed).speed

    def start_up(self, speed: float, impacts: int) -> Vector:
        """Speeds of the impacts that follow one of a speed, m/s; 0 for a striker at rest (B 19.23).

        Parameters
        ----------
        speed
            Speed of the impact before, m/s.
        impacts
            Number of impacts.
        """
        found = []
        for _ in range(impacts):
            speed = self.next_speed(speed)
            found.append(speed)
        return np.array(found)


DRIVE_SETTLED, MOST_THROWS = 1e-15, 10_000
"""Relative change of the speed at which throws have settled, and most throws until then."""
