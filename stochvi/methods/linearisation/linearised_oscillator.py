"""The linearised oscillator itself: its stiffness and damping, and the spectra of its response."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import minimize_scalar

from stochvi.mathematics.arrays import Vector
from stochvi.mathematics.spectra import squared_gain
from stochvi.methods.linearisation.candidate import Candidate
from stochvi.methods.linearisation.method import linear_oscillators
from stochvi.model.calculations import calculation
from stochvi.scenes.excitations.base import BASE, Density
from stochvi.scenes.scene import Scene

PLACES = 2001
"""Number of frequencies at which a spectrum is evaluated in the search for its peak, before
refinement."""

DECADES = 4.0
"""Number of decades below and above the linearised resonance within which a spectral peak is looked
for."""


@dataclass(frozen=True, kw_only=True)
class LinearisedOscillator:
    """x'' + (b + beta) x' + (omega^2 + k) (x - m) = f, which stands for a scene (B 13.5-13.7).

    Densities are one-sided per hertz, at frequencies f in hertz, and exact for this oscillator:

        G_x = |H|^2 G_f,     |H|^-2 = (omega^2 + k - w^2)^2 + (b + beta)^2 w^2,     w = 2 pi f.

    Parameters
    ----------
    mean
        Mean displacement m = E x, m.
    displacement_std, velocity_std
        Standard deviations, m and m/s: square roots of the areas under the densities.
    stiffness, damping
        k (1/s^2) and beta (1/s) of the stops, per unit mass.
    stop_force
        Mean force of the stops per unit mass, m_F, m/s^2; it pushes x down where positive.
    total_stiffness, total_damping
        omega^2 + k (1/s^2) and b + beta (1/s).
    dominant_frequency_hz
        Rate at which x crosses its mean upwards in the law of the form: omega_0 / (2 pi) of
        (B 13.20) for "motion" and (B 13.32) for "force".
    forces, base
        One-sided densities of the excitation, (m/s^2)^2/Hz: of forces per unit mass, and of the
        base.

    See Also
    --------
    stochvi.methods.linearisation.linearised_oscillators : The calculation.
    """

    mean: float
    displacement_std: float
    velocity_std: float
    stiffness: float
    damping: float
    stop_force: float
    total_stiffness: float
    total_damping: float
    dominant_frequency_hz: float
    forces: tuple[Density, ...]
    base: tuple[Density, ...]

    @property
    def resonance_hz(self) -> float:
        """Natural frequency of the linearised oscillator."""
        return math.sqrt(self.total_stiffness) / (2.0 * math.pi)

    @property
    def damping_ratio(self) -> float:
        """Share of the critical damping, (b + beta) / (2 sqrt(omega^2 + k))."""
        return self.total_damping / (2.0 * math.sqrt(self.total_stiffness))

    def displacement_density(self, frequency_hz: ArrayLike) -> Vector:
        """One-sided density of the displacement, m^2/Hz."""
        return self._gain(frequency_hz) * self._sum((*self.forces, *self.base), frequency_hz)

    def velocity_density(self, frequency_hz: ArrayLike) -> Vector:
        """One-sided density of the velocity, (m/s)^2/Hz."""
        w = 2.0 * np.pi * np.asarray(frequency_hz, dtype=float)
        return w**2 * self.displacement_density(frequency_hz)

    def acceleration_density(self, frequency_hz: ArrayLike) -> Vector:
        """One-sided density of the absolute acceleration of the mass, (m/s^2)^2/Hz.

        w^4 |H|^2 G of what pushes the mass, and ((omega^2 + k)^2 + (b + beta)^2 w^2) |H|^2 G of
        the base. The impacts of stops are in it only as the spring and damper that stand for them.
        """
        w = 2.0 * np.pi * np.asarray(frequency_hz, dtype=float)
        carried = self.total_stiffness**2 + (self.total_damping * w) ** 2
        pushed = w**4 * self._sum(self.forces, frequency_hz)
        return self._gain(frequency_hz) * (pushed + carried * self._sum(self.base, frequency_hz))

    def spectral_peak_hz(self) -> float:
        """Frequency of the largest displacement density, Hz, four decades around the resonance."""
        logs = math.log(self.resonance_hz) + math.log(10.0) * DECADES * np.linspace(-1, 1, PLACES)

        def density(log_frequency: ArrayLike) -> Vector:
            return self.displacement_density(np.exp(np.asarray(log_frequency)))

        best = int(np.argmax(density(logs)))
        ends = float(logs[max(best - 1, 0)]), float(logs[min(best + 1, PLACES - 1)])
        found = minimize_scalar(
            lambda log: -float(density(log)), bounds=ends, method="bounded", options={"xatol": 1e-9}
        )
        return math.exp(found.x)

    def _gain(self, frequency_hz: ArrayLike) -> Vector:
        return squared_gain(frequency_hz, math.sqrt(self.total_stiffness), self.total_damping)

    def _sum(self, densities: tuple[Density, ...], frequency_hz: ArrayLike) -> Vector:
        nothing = np.zeros(np.shape(frequency_hz))
        return np.asarray(sum((density(frequency_hz) for density in densities), nothing))


@calculation
def linearised_oscillators(
    scene: Scene, form: str = "closure", variant: str = "consistent"
) -> tuple[LinearisedOscillator, ...]:
    """The linear oscillators that stand for a scene of one oscillator in `linearise`.

    Parameters
    ----------
    scene, form, variant
        As for `linearise`; white, filtered and tabulated noise.

    Returns
    -------
    tuple of LinearisedOscillator
        One for every solution. In coloured noise there may be several, as in the resonance of a
        hardening spring: which of them is seen then depends on how the motion began. The first
        is the one that `linearise` reports, next to the response without stops.

    Raises
    ------
    ValueError, NotApplicable, NotConverged
        As `linearise`.

    See Also
    --------
    stochvi.linearise : The response.
    stochvi.methods.linearisation.linearised_structures : The same for several masses.

    Examples
    --------
    >>> from stochvi.scenes.excitations import WhiteNoise
    >>> from stochvi.scenes.impact_laws import Restitution
    >>> from stochvi.scenes.scene import ImpactPair
    >>> from stochvi.scenes.structures import Oscillator
    >>> scene = Scene(
    ...     structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
    ...     impact_pairs=[ImpactPair(lower=-1.0, upper=1.0, law=Restitution(coefficient=0.8))],
    ...     excitations=[WhiteNoise(intensity=0.2)],
    ... )
    >>> (found,) = linearised_oscillators(scene)
    >>> f = np.linspace(0.0, 50.0, 200_001)
    >>> area = np.trapezoid(found.displacement_density(f), f)
    >>> print(f"{found.resonance_hz:.4f} Hz, {area**0.5:.4f} m, {found.displacement_std:.4f} m")
    0.2354 Hz, 0.5231 m, 0.5231 m
    """
    model, candidates = linear_oscillators(scene, form, variant)
    forces: list[Density] = []
    base: list[Density] = []
    for excitation in scene.excitations:
        density = scene.density_of(excitation)
        if density is None:
            continue
        if scene.place(excitation) == BASE:
            base.append(density)
        else:
            forces.append(_per_unit_mass(density, model.unit_mass))
    return tuple(
        _oscillator(each, model.omega**2, model.damping_rate, tuple(forces), tuple(base))
        for each in candidates
    )


def _per_unit_mass(density: Density, mass: float) -> Density:
    return lambda frequency_hz: density(frequency_hz) / mass**2


def _oscillator(
    candidate: Candidate,
    own_stiffness: float,
    own_damping: float,
    forces: tuple[Density, ...],
    base: tuple[Density, ...],
) -> LinearisedOscillator:
    speed = math.sqrt(candidate.velocity_mean_square)
    return LinearisedOscillator(
        mean=candidate.mean,
        displacement_std=math.sqrt(candidate.variance),
        velocity_std=speed,
        stiffness=candidate.stiffness,
        damping=candidate.damping,
        stop_force=candidate.stop_force,
        total_stiffness=own_stiffness + candidate.stiffness,
        total_damping=own_damping + candidate.damping,
        dominant_frequency_hz=candidate.density_at_mean * speed / math.sqrt(2.0 * math.pi),
        forces=forces,
        base=base,
    )
