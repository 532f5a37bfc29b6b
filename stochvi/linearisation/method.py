"""The method: what it covers, what it says about its answer."""

from __future__ import annotations

import math
import time
from dataclasses import replace

from stochvi.answers import Answer, linear_acceleration
from stochvi.collisions import NO_STOP
from stochvi.errors import NotApplicable
from stochvi.estimates import Response
from stochvi.linearisation.atlas import with_bounds
from stochvi.linearisation.clumps import clumped
from stochvi.linearisation.forms import ROOT_TWO_PI, Trial, choose, restitutions
from stochvi.linearisation.scales import linear_moments
from stochvi.linearisation.several import closure
from stochvi.linearisation.solver import solve
from stochvi.scenes import Scene, System

FORMS = ("closure", "motion", "force", "clumps")
VARIANTS = ("consistent", "book")


def linearise(scene: Scene, form: str = "closure", variant: str = "consistent") -> Response:
    """Approximate stationary response by statistical linearisation (B section 8, 13).

    Parameters
    ----------
    scene
        White and tabulated noise, any constant load, no stop or one or two rigid ones; by the
        closure also several coordinates, pairs, filtered noise and sines (without tables).
    form
        "closure", "motion" or "force", as `stochvi.linearisation` says; "clumps", the closure
        corrected by the law of the energy, the best of them for one oscillator in white noise.
    variant
        "consistent", or "book": the factors of m_F as in (B 13.12) for "motion", and of beta as
        in (B 8.54) for "force". The closure is not in the book.

    Returns
    -------
    Response
        SI units. `bias` is a bound on the error that is read from an atlas of errors
        (`stochvi.linearisation.atlas`; more than 99 % of the bounds hold) for one oscillator in
        white noise; None, with the reason in `how`, outside of the atlas; 0 where the answer is
        exact, that is without stops, and for the closure with elastic stops in white noise.

    Raises
    ------
    ValueError, NotApplicable, NotConverged
        If there is no such form or variant; with every condition that the scene does not meet;
        if no response was found that is its own linearisation.

    Examples
    --------
    >>> from stochvi.contacts import Restitution
    >>> from stochvi.excitations import WhiteNoise
    >>> from stochvi.scenes import ImpactPair
    >>> from stochvi.structures import Oscillator
    >>> scene = Scene(
    ...     structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
    ...     impact_pairs=[ImpactPair(lower=-1.0, upper=1.0, law=Restitution(coefficient=0.8))],
    ...     excitations=[WhiteNoise(intensity=0.2)],
    ... )
    >>> response = linearise(scene)
    >>> print(f"{response.coordinates['x']['displacement_std'].value:.4f} m")
    0.5231 m
    """
    started = time.perf_counter()
    _check_words(form, variant)
    if form == "closure" and scene.beyond_one_oscillator() and not scene.beyond_numbers():
        return closure(scene)
    unmet = scene.beyond_one_oscillator() or _unmet_conditions(scene.system(), form)
    if unmet:
        raise NotApplicable("linearise", unmet)
    system = scene.system()
    method = f"linearise:{form}" + (":book" if variant == "book" else "")
    if system.lower is None and system.upper is None:
        return _answer(system, _without_stops(system)).response(
            method, scene, how="exact: linear and Gaussian", started=started
        )
    clumps = form == "clumps"
    trial = solve(system, choose("closure" if clumps else form, variant, system), method)
    if clumps:
        trial = clumped(system, trial)
    elastic = restitutions(system) == (1.0, 1.0)
    exact = form in ("closure", "clumps") and elastic and not system.tables
    response = _answer(system, trial).response(
        method,
        scene,
        how=_HOW[form],
        started=started,
        bias=0.0 if exact else None,
        assumptions=_ASSUMPTIONS[form, variant],
    )
    response = replace(response, warnings=[*response.warnings, *_warnings(system, trial)])
    return response if exact else with_bounds(response, system)


_HOW = {
    "closure": "moment closure",
    "clumps": "moment closure and law of the energy",
    "motion": "linearisation, cut normal law of the motion",
    "force": "linearisation, Gaussian law of the force",
}

_RAYLEIGH = "impact speeds are Rayleigh distributed, mean square 2 E v^2"
_CLUMPS = (
    "hits come in clumps as a slowly varying energy has them, in the measure of "
    "gap / (gap + 50 zeta), gap in deviations without stops"
)
_ASSUMPTIONS = {
    ("closure", "consistent"): (
        "x has the density C exp(lambda x - kappa x^2 / 2) between the stops; v is Gaussian and "
        "independent of x",
        _RAYLEIGH,
    ),
    ("clumps", "consistent"): (
        "x has the density C exp(lambda x - kappa x^2 / 2) between the stops; v is Gaussian and "
        "independent of x; impact speeds are Rayleigh distributed",
        _CLUMPS,
    ),
    ("motion", "consistent"): (
        "x has a normal law cut at the stops, whose mean and deviation before the cut are taken "
        "for those of x; v is Gaussian and independent of x",
        _RAYLEIGH,
    ),
    ("motion", "book"): (
        "x has a normal law cut at the stops, whose mean and deviation before the cut are taken "
        "for those of x; v is Gaussian and independent of x",
        "the mean stop force is (1 + R^2) / 4 E v^2 times the density at the stop (B 13.12)",
        _RAYLEIGH,
    ),
    ("force", "consistent"): (
        "the force of spring and stops together is Gaussian",
        _RAYLEIGH,
    ),
    ("force", "book"): (
        "the force of spring and stops together is Gaussian",
        "the mean square impact speed is E v^2 (B 8.52)",
    ),
}


def _check_words(form: str, variant: str) -> None:
    if form not in FORMS:
        raise ValueError(f"form must be one of {', '.join(FORMS)}, got {form!r}")
    if variant not in VARIANTS:
        raise ValueError(f"variant must be one of {', '.join(VARIANTS)}, got {variant!r}")
    if form in ("closure", "clumps") and variant == "book":
        raise ValueError("variant must be 'consistent' for the closure, which is not in the book")


def _unmet_conditions(system: System, form: str) -> list[str]:
    """What keeps a scene from being linearised in this form; empty where nothing does."""
    unmet = system.not_rigid()
    if system.intensity == 0.0 and not system.tables:
        unmet.append("excitation must contain noise, got a constant load alone")
    if form == "clumps" and system.tables:
        unmet.append("excitation must be white noise for form 'clumps', got a tabulated density")
    if system.damping_rate == 0.0 and restitutions(system) == (1.0, 1.0):
        unmet.append("damping must be positive where no stop takes energy, got 0")
    if system.omega == 0.0:
        if not system.held:
            unmet.append("stiffness must be positive where stops do not hold the mass, got 0")
        elif form == "motion":
            unmet.append("stiffness must be positive for form 'motion', got 0")
        elif form == "force" and (system.lower is None or system.upper is None):
            unmet.append("stiffness must be positive for form 'force' with one stop, got 0")
    return unmet


def _warnings(system: System, trial: Trial) -> list[str]:
    found = []
    if trial.rise > 1.0:
        found.append(
            "the mass leans on a stop more closely than a density C exp(lambda x - kappa x^2 / 2) "
            f"allows: this is kept at its limit, and raised {trial.rise:.3g}-fold at the stop"
        )
    for side, sign in (("lower", -1.0), ("upper", 1.0)):
        stop = getattr(system, side)
        if stop is not None and sign * (trial.mean - stop) > 0.0:
            found.append(f"the mean that this form gives lies beyond the {side} stop")
    return found


def _answer(system: System, trial: Trial) -> Answer:
    return Answer(
        mean=trial.mean,
        variance=trial.variance,
        velocity_mean_square=trial.velocity_mean_square,
        upcrossing_rate=trial.density_at_mean * math.sqrt(trial.velocity_mean_square) / ROOT_TWO_PI,
        lower=trial.lower,
        upper=trial.upper,
        acceleration_mean_square=linear_acceleration(system),
    )


def _without_stops(system: System) -> Trial:
    variance, velocity = linear_moments(system, 0.0, 0.0)
    return Trial(
        mean=system.load / system.omega**2,
        variance=variance,
        velocity_mean_square=velocity,
        density_at_mean=1.0 / (ROOT_TWO_PI * math.sqrt(variance)),
        stop_force=0.0,
        stiffness=0.0,
        damping=0.0,
        lower=NO_STOP,
        upper=NO_STOP,
    )
