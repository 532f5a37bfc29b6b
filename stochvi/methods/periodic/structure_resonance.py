"""Vibro-impact resonance of any structure, and how long noise can maintain it.

Resonant regimes are close to free motions between impacts without loss. Such a motion of a pair is
its periodic response to its own impulses, y0 = -J chi(t). The response chi follows from the
compliance at the pair, here mode by mode (Babitsky, section 14).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import ndtri

from stochvi.mathematics.arrays import Matrix, Vector
from stochvi.mathematics.frequency_response import InputMatrix
from stochvi.mathematics.quadrature import gauss_panels
from stochvi.mathematics.spectra import Table
from stochvi.model.coverage import nonlinear
from stochvi.model.model import Model, Pair, model_of
from stochvi.results.errors import NotApplicable
from stochvi.scenes.scene import Scene

HARMONICS = 255
"""Number of harmonics of a regime whose power noise of a table may supply. Those beyond have 0.2 %
of the power of a jump of velocity, whose harmonics fall like 1/m."""

NEARLY_EVEN = 1e-9
"""Relative difference of the distances of two stops up to which they count as equal."""

NEARLY_SINGULAR = 1e-12
"""Cosine or sine below which a mode counts as one that the regime excites without limit."""

TOUCHING = 1e-9
"""Depth to which a regime may pass a stop between impacts, relative to the clearance: rounding."""


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
        White intensities, or one-sided densities, each with the forces on the modes per unit of it.

    Raises
    ------
    ValueError
        If no such regime exists at this frequency.

    See Also
    --------
    stochvi.methods.periodic.RandomResonance : The same of one mass.
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
    noises: Sequence[tuple[float | Table, ArrayLike]] = ()

    def __post_init__(self) -> None:
        for name in ("omega", "damping", "gaps", "clearance", "restitution"):
            object.__setattr__(self, name, np.asarray(getattr(self, name), dtype=float))
        if not 0.0 < self.frequency < math.inf:
            raise ValueError(f"frequency must be greater than 0, got {self.frequency:g}")
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
        noises: list[tuple[float | Table, ArrayLike]] = [
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
            if isinstance(strength, Table):
                hertz = self.frequency / math.tau * np.arange(1, HARMONICS + 1)
                density = 0.5 * strength(hertz)
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
        """Rms of an excitation at w alone below which it cannot maintain the regime (B 14.100).

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
        raise ValueError(f"probability must be above 0.5 and below 1, got {probability:g}")
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
