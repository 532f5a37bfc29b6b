"""Averaging of the energy: a lightly damped mass keeps its orbit for many cycles."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from numpy.typing import ArrayLike

from stochvi.mathematics.numerics import Vector, gauss_panels
from stochvi.model.build_response import StationaryMoments, density_spans, with_bounds
from stochvi.model.coverage import beyond_one_oscillator, compliant, not_white, without_dissipation
from stochvi.model.energy_law import (
    CONTINUOUS,
    FINITE_JUMPS,
    UNFOLDED,
    VARIANTS,
    EnergyLaw,
    energy_law,
)
from stochvi.model.gap import Gap
from stochvi.model.model import Model, model_of
from stochvi.results.base import Response
from stochvi.results.errors import NotApplicable
from stochvi.sampling.calculations import calculation
from stochvi.scenes.scene import Scene

__all__ = ["VARIANTS", "AveragedDensity", "average", "average_density", "unmet"]


@calculation
def average(
    scene: Scene,
    *,
    variant: str = FINITE_JUMPS,
    budget: float | None = None,
) -> Response:
    """Stationary response by stochastic averaging of the energy, approximate.

    Noise, damping and impacts are spread over a cycle. With every loss small the energy diffuses
    (R. L. Stratonovich; W. Q. Zhu, Appl. Mech. Rev. 41 (1988) 189),

        p(E) = C T exp(-(1 / D) integral of (b + L / J) dE),   L = sum_i (1 - R_i^2)(E - E_i),

    with D = S0 / 2, the period T(E) and a constant C. J(E) is the integral of v dx over a cycle,
    E_i the energy that just reaches the stop i. This is the variant "continuous", exact at R = 1.
    The variant "finite jumps" lets an impact take the energy from E to E_i + R_i^2 (E - E_i) at
    once. The flux through E is balanced,

        D J G' + b J G + sum over E_i < E of integral of G from E to E_i + (E - E_i) / R_i^2 = 0,

    which goes over into the first for R near 1. A restitution that depends on the speed takes its
    value at sqrt(2 (E - E_i)); the last integral then goes over all energies from which an impact
    ends below E. The variant "unfolded" is that of V. F. Zhuravlev's
    transformation (Mech. Solids 11 (1976) 23): mirrored at its stops the motion is smooth but for a
    jump (1 - R) v at each passage of one. A damper (1 - R) v |v| delta(x - c) in place of the
    stop stands for the jump; then L = sum_i 2 (1 - R_i)(E - E_i), too much by the factor 2 / (1 +
    R). Within an orbit the probability is in proportion to the time spent, and each cycle hits each
    reached stop once.

    Parameters
    ----------
    scene
        The scene.
    variant
        "finite jumps" (on the command line `finite-jumps`), "continuous" or "unfolded".
    budget
        Seconds after which `NotConverged` is raised; None for no limit.

    Returns
    -------
    Response
        `bias` of "finite jumps" is a bound on the error that is read from an atlas of errors
        (`data/linearisation_atlas`), like that of `linearise`; None, with the reason in `how`,
        outside of the atlas and for other variants. The error falls with b / omega and 1 - R. The
        energy balance holds, those of virial and force only approximately.

    Raises
    ------
    NotApplicable
        With every condition that the scene does not meet.

    See Also
    --------
    stochvi.fokker_planck : The same from the Fokker-Planck equation.
    stochvi.simulate : The same by Monte Carlo.

    Examples
    --------
    >>> from stochvi.scenes.impact_laws import Restitution
    >>> from stochvi.scenes.excitations import WhiteNoise
    >>> from stochvi.scenes.scene import ImpactPair
    >>> from stochvi.scenes.structures import Oscillator
    >>> scene = Scene(
    ...     structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
    ...     impact_pairs=[ImpactPair(lower=-1.0, upper=1.0, law=Restitution(coefficient=0.8))],
    ...     excitations=[WhiteNoise(intensity=0.2)],
    ... )
    >>> print(f"{average(scene).coordinates['x']['displacement_std'].value:.3f} m")
    0.531 m
    """
    return _averaged(scene, variant).response


Spans = tuple[Vector, Vector]


@dataclass(frozen=True, kw_only=True, repr=False)
class AveragedDensity:
    """The density of an averaged energy over place and speed; made by `average_density`.

    Parameters
    ----------
    response
        The answer of `average`.
    law
        The distribution of the energy; a cycle spends dx / |v| at every place, twice.
    spans
        Where ln(density of the displacement / its true value) lies, at probabilities of a smaller
        displacement; a string says why that is not known.

    See Also
    --------
    stochvi.methods.averaging.average_density : The calculation.
    """

    response: Response
    law: EnergyLaw
    spans: Callable[[Vector], Spans | str]

    def __repr__(self) -> str:
        return f"<averaged density, E v^2 = {self.law.velocity_mean_square:.6g} m^2/s^2>"

    def density(self, x: ArrayLike, v: ArrayLike) -> Vector:
        """Joint density at displacements x (m) and velocities v (m/s), s/m^2; 0 beyond stops."""
        place, speed = np.broadcast_arrays(np.asarray(x, float), np.asarray(v, float))
        found = self.law.flux_at(self.law.well.energy(place) + 0.5 * speed**2)
        well = self.law.well
        return np.where((place < well.lower) | (place > well.upper), 0.0, found)

    def displacement_density(self, x: ArrayLike) -> Vector:
        """Density of the displacement, 1/m; 0 beyond stops."""
        place = np.asarray(x, float)
        return np.asarray(self.law.displacement_density(place.ravel()).reshape(place.shape))

    def velocity_density(self, v: ArrayLike) -> Vector:
        """Density of the velocity, s/m."""
        places, weights = self._places
        return np.asarray(self.density(places, np.asarray(v, float)[..., None]) @ weights)

    def impact_flux(self, side: str, w: ArrayLike) -> Vector:
        """Impacts on one stop per second and unit of incident speed, 1/m."""
        speed = np.asarray(w, float)
        return np.asarray(speed * self.law.flux_at(self.law.stops[side].energy + 0.5 * speed**2))

    def bands(self, x: ArrayLike) -> tuple[Vector, Vector]:
        """Lower and upper limits of the true density of the displacement, 1/m.

        They are read from an atlas of errors against the Fokker-Planck equation. They are NaN
        beyond the outermost half per cent of the motion, and where `how_bands` says why.
        """
        place = np.asarray(x, float)
        density = self.displacement_density(place)
        found = self.spans(self._levels(place))
        if isinstance(found, str):
            return np.full_like(density, np.nan), np.full_like(density, np.nan)
        low, high = found
        return density * np.exp(-high), density * np.exp(-low)

    @property
    def how_bands(self) -> str:
        """Where the bands come from, or why there are none."""
        found = self.spans(np.array([0.5]))
        return f"no band: {found}" if isinstance(found, str) else "band from the atlas of errors"

    @cached_property
    def _places(self) -> tuple[Vector, Vector]:
        """Nodes and weights over all displacements."""
        ends = self.law.well.ends(self.law.top)
        return gauss_panels(np.linspace(*ends, PLACES + 1), NODES_OF_PLACES)

    def quantiles(self, probability: ArrayLike) -> Vector:
        """Displacements that are not exceeded with these probabilities, m."""
        places, below = self._below
        return np.asarray(np.interp(np.asarray(probability, float), below, places))

    def _levels(self, x: Vector) -> Vector:
        """Probabilities of a displacement below each of some."""
        return np.asarray(np.interp(x, *self._below))

    @cached_property
    def _below(self) -> tuple[Vector, Vector]:
        """Displacements, and the probabilities of a smaller one."""
        places, weights = self._places
        each = weights * self.displacement_density(places)
        below = np.cumsum(each) - 0.5 * each
        return places, below / each.sum()


PLACES, NODES_OF_PLACES = 200, 4
"""Number of panels over all displacements, and of nodes in each."""


@calculation
def average_density(
    scene: Scene, *, variant: str = FINITE_JUMPS, budget: float | None = None
) -> AveragedDensity:
    """The density itself by stochastic averaging, with a band; arguments and limits of `average`.

    p(x, v) = G(E) with the energy E of x and v: a cycle passes every place twice.

    Parameters
    ----------
    scene
        The scene.
    variant
        As for `average`; only "finite jumps" has bands.
    budget
        Seconds after which `NotConverged` is raised; None for no limit.

    Returns
    -------
    AveragedDensity
        The joint density, its marginals and impact speeds.

    See Also
    --------
    stochvi.average : The averages alone.
    stochvi.methods.fokker_planck.fokker_planck_density : The same from its equation.

    Examples
    --------
    >>> from stochvi.scenes import shipped_scene
    >>> from stochvi.scenes.scene import load_scene
    >>> found = average_density(load_scene(shipped_scene("oscillator-lossy")))
    >>> low, high = found.bands(0.5)
    >>> print(f"{found.displacement_density(0.5):.3f} ({low:.3f} to {high:.3f})")
    0.520 (0.515 to 0.521)
    """
    return _averaged(scene, variant)


def _averaged(scene: Scene, variant: str) -> AveragedDensity:
    started = time.perf_counter()
    if variant not in VARIANTS:
        raise ValueError(f"variant must be one of {', '.join(VARIANTS)}, got {variant!r}")
    model = model_of(scene)
    conditions = unmet(model)
    if conditions:
        raise NotApplicable("average", conditions)
    law = energy_law(Gap.of(model), variant)
    if model.omega or model.load:
        away = law.moment(lambda orbits: orbits.first)
    else:
        away = law.centre - law.well.place
    mean = law.well.place + away
    response = StationaryMoments(
        mean=mean,
        variance=law.moment(lambda orbits: orbits.second) - away**2,
        velocity_mean_square=law.velocity_mean_square,
        upcrossing_rate=law.rate_of_cycles_above(float(law.well.energy(mean))),
        lower=law.stop("lower"),
        upper=law.stop("upper"),
    ).response(
        f"average:{variant}",
        scene,
        how="energy averaged over cycles",
        started=started,
        bias=0.0 if model.elastic else None,
        assumptions=["noise, damping and impacts change the energy little in one cycle"],
    )
    response = replace(response, warnings=[*response.warnings, *_warnings(model, law)])
    response = response if model.elastic else with_bounds(response, model)
    return AveragedDensity(response=response, law=law, spans=_spans(model, variant))


def _spans(model: Model, variant: str) -> Callable[[Vector], Spans | str]:
    """Where the logarithm of the error of a density lies, see `AveragedDensity`."""
    if model.elastic:
        return lambda levels: (np.zeros_like(levels), np.zeros_like(levels))
    if variant != FINITE_JUMPS:
        return lambda _: f"the variant {variant!r} has no atlas"
    return partial(density_spans, model)


MEASURED_RESTITUTIONS = (0.5, 0.8, 0.9, 0.98, 1.0)
"""Restitutions at which the factors below were measured."""

PRESSED_FACTORS = {
    FINITE_JUMPS: (3.90, 2.04, 1.46, 1.08, 1.0),
    CONTINUOUS: (1.72, 1.41, 1.21, 1.04, 1.0),
    UNFOLDED: (0.97, 1.14, 1.09, 1.02, 1.0),
}
"""Ratio of displacement_std of each variant to that of `fokker_planck`. It was measured for a mass
that a load alone presses onto one stop, under white noise, where it depends on R alone. With a
spring or a damper it was closer to 1, or within 5 % of it, in eight scenes of R = 0.5 to 0.8."""


MISLEADING = 0.05
"""Relative error of displacement_std from which the warning is given."""


def _warnings(model: Model, law: EnergyLaw) -> list[str]:
    """A warning for each inelastic stop on which the mass rests: it takes a fixed part of the
    energy in every cycle, however light the damping."""
    if model.omega == 0.0 and model.load == 0.0:
        return []
    found = []
    for name, stop in law.stops.items():
        factors = PRESSED_FACTORS[law.variant]
        factor = float(np.interp(math.sqrt(stop.mean_square), MEASURED_RESTITUTIONS, factors))
        if stop.energy == 0.0 and abs(factor - 1.0) > MISLEADING:
            found.append(
                f"the mass rests on the {name} stop, which takes "
                f"{100.0 * (1.0 - stop.mean_square):.0f} % of its energy in every cycle; averaging "
                "assumes a small loss. A stated error holds. Where none is stated, "
                f"displacement_std may be wrong by a factor of up to {factor:.2g}; use "
                "fokker-planck or linearise"
            )
    return found


def unmet(model: Model) -> list[str]:
    """The conditions of averaging that a model does not meet; empty where it meets all.

    Parameters
    ----------
    model
        The model of a scene.

    Returns
    -------
    list[str]
        Sentences, empty where everything is met.

    See Also
    --------
    stochvi.average : The method.
    stochvi.explain : What all methods say of a scene.

    Examples
    --------
    >>> from stochvi.model.model import model_of
    >>> from stochvi.scenes import shipped_scene
    >>> from stochvi.scenes.scene import load_scene
    >>> model = model_of(load_scene(shipped_scene("oscillator-lossy")))
    >>> unmet(model)
    []
    """
    found = beyond_one_oscillator(model, white_only=True, with_speeds=True)
    if found:
        return found
    found = [*compliant(model), *not_white(model), *without_dissipation(model)]
    if not model.held:
        found.append("stiffness must be positive where stops do not hold the mass, got 0")
    return found
