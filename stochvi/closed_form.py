"""Exact stationary solutions of the Fokker-Planck equation, where they exist in closed form.

For white noise and elastic stops the joint density is a Gibbs density,

    p(x, v) = C exp(-(v^2 / 2 + U(x)) / theta),   theta = S0 / (2 b),          (B 13.38)

with U the potential of spring, load and of stops that give way, infinite beyond rigid ones.
Without stops the response of a linear oscillator to any Gaussian noise is Gaussian, and its
moments are integrals over frequency.
"""

from __future__ import annotations

import math
import time

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stochvi.answers import Answer, linear_acceleration
from stochvi.collisions import gaussian_stop
from stochvi.cut_normal import CutNormal
from stochvi.errors import NoExactSolution
from stochvi.estimates import Response
from stochvi.gibbs_law import GibbsLaw
from stochvi.scenes import Scene, System
from stochvi.spectra import LinearMoments, response_moments


def exact(scene: Scene) -> Response:
    """Exact stationary response (B 13.38-13.44, for any two stops and a constant load).

    Returns every moment, the rate of hitting each stop nu = p_x(stop) sqrt(theta / 2 pi), and
    F1, F2 of the Rayleigh law of impact speeds. Of stops that give way (elastic, Hertz, tabulated)
    also the share of time in contact, the mean force, and the mean of the largest force of a
    contact, in which noise and damping are neglected (`bias` bounds what that leaves).

    Raises
    ------
    NoExactSolution
        With every condition that the scene does not meet.

    Examples
    --------
    >>> from stochvi.contacts import Restitution
    >>> from stochvi.excitations import WhiteNoise
    >>> from stochvi.scenes import ImpactPair
    >>> from stochvi.structures import Oscillator
    >>> scene = Scene(
    ...     structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
    ...     impact_pairs=[ImpactPair(lower=-1.0, upper=1.0, law=Restitution(coefficient=1.0))],
    ...     excitations=[WhiteNoise(intensity=0.2)],
    ... )
    >>> exact(scene).coordinates["x"]["displacement_std"]
    0.539560094 [closed form]
    """
    start = time.perf_counter()
    unmet = unmet_conditions(scene)
    if unmet:
        raise NoExactSolution(unmet)
    system = scene.system()
    law = _displacement_law(system)
    velocity = _velocity_mean_square(system)
    return Answer(
        mean=law.mean,
        variance=law.variance,
        velocity_mean_square=velocity,
        upcrossing_rate=law.density_at(law.mean) * math.sqrt(velocity / (2.0 * math.pi)),
        lower=gaussian_stop(law.density_at(system.lower), velocity),
        upper=gaussian_stop(law.density_at(system.upper), velocity),
        contact_lower=law.contact("lower") if isinstance(law, GibbsLaw) else None,
        contact_upper=law.contact("upper") if isinstance(law, GibbsLaw) else None,
        acceleration_mean_square=linear_acceleration(system),
    ).response("exact", scene, how="closed form", started=start)


def displacement_density(scene: Scene, x: ArrayLike) -> NDArray[np.float64]:
    """Exact probability density of the displacement, 1/m; conditions as for `exact`."""
    unmet = unmet_conditions(scene)
    if unmet:
        raise NoExactSolution(unmet)
    return _displacement_law(scene.system()).density(x)


def unmet_conditions(scene: Scene) -> list[str]:
    """What keeps this scene from having a closed form here; empty where it has one."""
    unmet = scene.beyond_one_oscillator()
    if unmet:
        return unmet
    system = scene.system()
    for side in ("lower", "upper"):
        restitution = getattr(system, f"restitution_{side}")
        if restitution is not None and restitution < 1.0:
            unmet.append(
                f"restitution must be 1 (an elastic stop), got {restitution:g} at the {side} stop"
            )
        law = getattr(system, f"law_{side}")
        if law is not None and not law.rigid and not law.conservative:
            unmet.append(f"law must lose no energy, got {law.kind!r} at the {side} stop")
    has_stops = bool(scene.impact_pairs)
    if system.tables and has_stops:
        unmet.append(
            "excitation must be white noise where there are stops, got a tabulated density"
        )
    if system.damping_rate == 0.0:
        unmet.append("damping must be positive, got 0 (there would be no stationary state)")
    if system.intensity == 0.0 and not system.tables:
        unmet.append("excitation must contain noise, got a constant load alone")
    if system.omega == 0.0 and not _held_by_stops(system):
        unmet.append("stiffness must be positive where stops do not hold the mass, got 0")
    return unmet


def _held_by_stops(system: System) -> bool:
    try:
        _gibbs_law(system, theta=1.0)
    except ValueError:
        return False
    return True


def _gibbs_law(system: System, theta: float) -> GibbsLaw:
    return GibbsLaw(
        theta=theta,
        omega=system.omega,
        load=system.load,
        stop_lower=system.lower,
        stop_upper=system.upper,
        law_lower=system.law_lower,
        law_upper=system.law_upper,
    )


def _velocity_mean_square(system: System) -> float:
    """theta = E v^2 = S0 / (2 b) for white noise, plus the linear response to tables."""
    white = system.intensity / (2.0 * system.damping_rate)
    return white + _table_moments(system).velocity


def _table_moments(system: System) -> LinearMoments:
    return response_moments(system.tables, system.omega, system.damping_rate)


def _displacement_law(system: System) -> CutNormal | GibbsLaw:
    """exp(-U / theta) with the stops; without stops the Gaussian law for any noise."""
    theta = system.intensity / (2.0 * system.damping_rate)
    if system.not_rigid():
        return _gibbs_law(system, theta)
    if not system.tables:
        return CutNormal(
            slope=system.load / theta,
            curvature=system.omega**2 / theta,
            lower=system.lower,
            upper=system.upper,
        )
    variance = theta / system.omega**2 + _table_moments(system).displacement
    return CutNormal(slope=system.load / system.omega**2 / variance, curvature=1.0 / variance)
