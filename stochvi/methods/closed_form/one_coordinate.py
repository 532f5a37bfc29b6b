"""One oscillator: p(x, v) = C exp(-(v^2 / 2 + U(x)) / theta), theta = S0 / 2 b (B 13.38).

Without stops the response of a linear oscillator to a tabulated density is Gaussian, and its
moments are integrals over frequency.
"""

from __future__ import annotations

import math

import numpy as np

from stochvi.mathematics.impact_rates import gaussian_stop
from stochvi.mathematics.spectra import LinearMoments, response_moments
from stochvi.model.build_response import StationaryMoments, linear_acceleration
from stochvi.model.coverage import not_gaussian, without_energy, without_noise
from stochvi.model.gap import Gap
from stochvi.model.gibbs_law import GibbsLaw, Spring
from stochvi.model.model import Model, model_of
from stochvi.results.errors import SceneError
from stochvi.results.response import Response
from stochvi.scenes.impact_laws import Law, Restitution
from stochvi.scenes.scene import Scene
from stochvi.scenes.structures import NonlinearOscillator

HEAVIEST = 3.0
"""A density that falls as |x|^-n far out has a finite variance only for n above this number."""


def response(scene: Scene, started: float) -> Response:
    """The answer for a scene without unmet conditions."""
    model = model_of(scene)
    law = displacement_law(scene)
    velocity = law.theta
    lower, upper = Gap.of(model).ends
    return StationaryMoments(
        mean=law.mean,
        variance=law.variance,
        velocity_mean_square=velocity,
        upcrossing_rate=law.density_at(law.mean) * math.sqrt(velocity / (2.0 * math.pi)),
        lower=gaussian_stop(law.density_at(lower), velocity),
        upper=gaussian_stop(law.density_at(upper), velocity),
        contact_lower=law.contact("lower"),
        contact_upper=law.contact("upper"),
        acceleration_mean_square=linear_acceleration(model),
    ).response("exact", scene, how="closed form", started=started)


def unmet(model: Model) -> list[str]:
    """The conditions of the closed form that a model of one oscillator does not meet."""
    found = [f"{loss} at the {stop.name} stop" for stop in model.stops if (loss := lossy(stop.law))]
    found += without_energy(model) if not found else []
    found += not_gaussian(model)
    if model.drag is not None:
        found.append("damping must be linear, got a function of velocity")
    if model.tables and model.stops:
        found.append(
            "excitation must be white noise where there are stops, got a tabulated density"
        )
    if model.tables and model.restoring is not None:
        found.append(
            "excitation must be white noise where the spring is a function, got a tabulated density"
        )
    if model.damping_rate == 0.0 and model.drag is None:
        found.append("damping must be positive, got 0 (there would be no stationary state)")
    found.extend(without_noise(model))
    if model.restoring is not None:
        if not found and not _held(model, _white_theta(model)):
            found.append("restoring_force must hold the mass where stops do not")
        elif not found:
            heaviest = _gibbs_law(model, _white_theta(model)).heaviest
            if heaviest <= HEAVIEST:
                found.append(
                    "restoring_force must leave a finite variance, got a density that falls as "
                    f"x^-{heaviest:.3g} far out, no faster than x^-3"
                )
    elif model.omega == 0.0 and not _held(model, theta=1.0):
        found.append("stiffness must be positive where stops do not hold the mass, got 0")
    return found


def lossy(law: Law) -> str:
    """The condition that a stop without loss meets, and what this one has; empty if it meets it."""
    if law.conservative:
        return ""
    if not law.rigid:
        return f"law must lose no energy, got {law.kind!r}"
    got = "a function of speed"
    if isinstance(law, Restitution):
        plain = isinstance(law.coefficient, int | float)
        got = f"{law.coefficient:g}" if plain else str(law.coefficient)
    return f"restitution must be 1 (an elastic stop), got {got}"


def displacement_law(scene: Scene) -> GibbsLaw:
    """Law exp(-U / theta) between the stops; under tabulated noise the Gaussian distribution.

    Raises
    ------
    SceneError
        If the potential that a spring was given is not that of its force.
    """
    model = model_of(scene)
    theta = _white_theta(model)
    if model.tables:
        tables = _table_moments(model)
        velocity, variance = theta + tables.velocity, tables.displacement
        variance += theta / model.omega**2
        omega = math.sqrt(velocity / variance)
        load = model.rest * omega**2
        return GibbsLaw(theta=velocity, omega=omega, load=load)
    law = _gibbs_law(model, theta)
    if isinstance(scene.structure, NonlinearOscillator):
        _check_potential(scene.structure, law)
    return law


def _held(model: Model, theta: float) -> bool:
    try:
        _gibbs_law(model, theta)
    except ValueError:
        return False
    return True


def _gibbs_law(model: Model, theta: float) -> GibbsLaw:
    spring = None
    if model.restoring is not None and model.potential is not None:
        spring = Spring(model.restoring, model.potential)
    return GibbsLaw.of(Gap.of(model), theta, spring)


def _white_theta(model: Model) -> float:
    """Mean square velocity theta = S0 / (2 b) under white noise, m^2/s^2."""
    return model.intensity / (2.0 * model.damping_rate)


def _table_moments(model: Model) -> LinearMoments:
    return response_moments(model.acceleration_tables, model.omega, model.damping_rate)


POTENTIAL_ERROR = 1e-6
"""Largest difference between a given potential and the integral of its force, relative to the
energies there and to theta."""


def _check_potential(structure: NonlinearOscillator, law: GibbsLaw) -> None:
    """Compare a given potential with the integral of the force, where the mass is found."""
    if structure.potential is None:
        return
    places = np.linspace(law.mean - law.deviation, law.mean + law.deviation, 5)
    bare = structure.model_copy(update={"potential": None})
    by_force, own = bare.potential_at(places), structure.potential_at(places)
    allowed = POTENTIAL_ERROR * (np.abs(by_force).max() + structure.mass * law.theta)
    wrong = np.abs(own - by_force) > allowed
    if np.any(wrong):
        raise SceneError(
            [
                (
                    "structure",
                    "needs a potential whose derivative is restoring_force, got the energy "
                    f"{own[wrong][0]:g} J at {places[wrong][0]:g} m where the integral of the "
                    f"force is {by_force[wrong][0]:g} J",
                )
            ]
        )
