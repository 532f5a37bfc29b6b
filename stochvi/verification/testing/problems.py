"""A scene as plain numbers, for integrators that know nothing of this package."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from stochvi.model.coverage import beyond_one_oscillator
from stochvi.model.model import Model, Stop, model_of
from stochvi.results.errors import NotApplicable
from stochvi.scenes.scene import Scene

SETTLED = 6.0
"""Relaxation times of burn-in: e^-6 of the start is left after them, and e^-12 of its energy."""


@dataclass(frozen=True, kw_only=True)
class Problem:
    """One oscillator under white noise between rigid stops, per unit mass:

        x'' + damping_rate x' + omega^2 x = load + w(t),   E w(t) w(t + tau) = intensity delta(tau),

    where a velocity v at a stop becomes -R v. In a time step h the noise adds a normal number of
    variance `intensity * h` to the velocity.

    Parameters
    ----------
    omega, damping_rate
        Natural frequency, rad/s, and damping rate c / m, 1/s.
    intensity, load
        (m/s^2)^2 s and m/s^2.
    lower, upper
        Stops, m; infinite where there is none.
    restitution_lower, restitution_upper
        R of each.
    speed_threshold
        A collision rate counts impacts faster than this, m/s.
    burn_in, duration
        Seconds to leave out at the start of a path, and to count after that.
    paths
        How many independent paths are asked for.
    scene
        The whole scene, for integrators that read scenes.
    """

    name: str
    omega: float
    damping_rate: float
    intensity: float
    load: float
    lower: float
    upper: float
    restitution_lower: float
    restitution_upper: float
    speed_threshold: float
    burn_in: float
    duration: float
    paths: int
    scene: Scene

    @property
    def relaxation_time(self) -> float:
        """Time in which the memory of a start falls to 1/e, without stops, s."""
        return self.burn_in / SETTLED

    @property
    def speed_scale(self) -> float:
        """Standard deviation of the velocity without stops, sqrt(intensity / (2 b)), m/s."""
        return math.sqrt(self.intensity / (2.0 * self.damping_rate))

    @property
    def restitution(self) -> float | None:
        """R of the stops; None without stops, or where two stops have different R."""
        found = {
            r
            for stop, r in (
                (self.lower, self.restitution_lower),
                (self.upper, self.restitution_upper),
            )
            if math.isfinite(stop)
        }
        return found.pop() if len(found) == 1 else None


def problem_of(
    scene: Scene,
    *,
    name: str = "",
    paths: int = 1024,
    relaxations: float = 20.0,
    speed_threshold: float = 0.0,
) -> Problem:
    """The numbers of a scene, for `paths` paths that last `relaxations` relaxation times each.

    Raises
    ------
    NotApplicable
        Unless the scene is one oscillator under white noise, with rigid stops or none.
    ValueError
        If `paths` or `relaxations` is not positive.

    Examples
    --------
    >>> from stochvi.verification.checks import zoo
    >>> problem = problem_of(zoo("elastic-upper-stop")["elastic-upper-stop"])
    >>> problem.lower, problem.upper, problem.intensity, problem.duration
    (-inf, 1.0, 0.2, 400.0)
    """
    if isinstance(paths, bool) or not isinstance(paths, (int, np.integer)) or paths < 1:
        raise ValueError(f"paths must be a whole number of at least 1, got {paths!r}")
    if not 0.0 < relaxations < math.inf:
        raise ValueError(f"relaxations must be a positive number, got {relaxations}")
    model = model_of(scene)
    unmet = beyond_one_oscillator(model)
    if not unmet:
        unmet = model.not_rigid()
        if model.tables or model.intensity == 0.0:
            unmet.append("excitation must be white noise")
        if model.damping_rate == 0.0:
            unmet.append("structure.damping must be above 0")
    if unmet:
        raise NotApplicable("judge", unmet)
    relaxation = _relaxation_time(model)
    return Problem(
        name=name or scene.title,
        omega=model.omega,
        damping_rate=model.damping_rate,
        intensity=model.intensity,
        load=model.load,
        lower=model.lower_position,
        upper=model.upper_position,
        restitution_lower=_restitution(model.lower),
        restitution_upper=_restitution(model.upper),
        speed_threshold=speed_threshold,
        burn_in=SETTLED * relaxation,
        duration=relaxations * relaxation,
        paths=paths,
        scene=scene,
    )


def _restitution(stop: Stop | None) -> float:
    """R of a rigid stop; 1 where there is none."""
    return 1.0 if stop is None else stop.law.restitution


def _relaxation_time(model: Model) -> float:
    """One over the real part of the slowest eigenvalue, s; without a spring, of the velocity."""
    half = 0.5 * model.damping_rate
    if model.omega == 0.0:
        return 1.0 / model.damping_rate
    return 1.0 / (half - math.sqrt(max(half**2 - model.omega**2, 0.0)))
