"""Linearisation of a scene: the conditions, the answers, and their assumptions and warnings."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from stochvi.methods.linearisation.candidate import ROOT_TWO_PI, Candidate
from stochvi.methods.linearisation.clump_correction import UNSEEN, clumped, energy_weight
from stochvi.methods.linearisation.forms import form_of
from stochvi.methods.linearisation.functions import linearised_functions
from stochvi.methods.linearisation.outputs import answer_of
from stochvi.methods.linearisation.scales import gibbs_law, linear_moments
from stochvi.methods.linearisation.solver import solve
from stochvi.methods.linearisation.structure_closure import closure
from stochvi.model.build_response import linear_acceleration
from stochvi.model.calculations import calculation
from stochvi.model.coverage import (
    beyond_one_oscillator,
    compliant,
    functions,
    not_gaussian,
    unknown_dampers,
    without_dissipation,
    without_energy,
    without_noise,
)
from stochvi.model.error_atlas import with_bounds
from stochvi.model.gap import Gap
from stochvi.model.model import Model, Stop, model_of
from stochvi.results.deadline import Deadline
from stochvi.results.errors import NotApplicable
from stochvi.results.response import Response
from stochvi.scenes.impact_laws import Viscoelastic
from stochvi.scenes.scene import Scene

FORMS = ("closure", "motion", "force", "clumps")
"""Forms of `linearise`."""

VARIANTS = ("consistent", "book", "box")
"""Variants of the forms."""


@calculation
def linearise(
    scene: Scene,
    form: str = "closure",
    variant: str = "consistent",
    *,
    budget: float | None = None,
) -> Response:
    """Approximate stationary response by statistical linearisation (B section 8, 13).

    Parameters
    ----------
    scene
        White, filtered and tabulated noise, any constant load, no stop or one or two of any
        law; by the closure also several coordinates, several pairs, and sines.
    form
        "closure", "motion" or "force" (see `stochvi.methods.linearisation`); "clumps", the
        closure (between two stops its variant "box") corrected by the distribution of the energy,
        for one oscillator between rigid stops in white noise; the best at light damping or in wide
        gaps.
    variant
        "consistent"; "book": the factors of m_F and k as in (B 13.12) for "motion", and of beta
        as in (B 8.54) for "force"; "box" for the closure between two rigid stops: impacts as those
        of a free mass in a box as far as impacts take the energy, nearly everywhere better.
    budget
        Seconds after which `NotConverged` is raised; None for no limit.

    Returns
    -------
    Response
        SI units. `bias` is a bound on the error that is read from an atlas of errors
        (`data/linearisation_atlas`; 99 % of the bounds hold, 98.3 % of the worst quantity) for one
        oscillator between rigid stops in white noise, and for a loose mass in a box. For structures
        in white noise it is calibrated on simulations. None, with the reason in `how`, elsewhere;
        0 where the answer is exact, that is without stops, and for the closure with elastic stops
        in white noise (with several coordinates: one pair, and noise that matches the damping).

    Raises
    ------
    ValueError, NotApplicable, NotConverged
        If there is no such form or variant; with every condition that the scene does not meet;
        if the iteration converges from none of its starts.

    See Also
    --------
    stochvi.simulate : The same by Monte Carlo.
    stochvi.check : Whether all methods agree.

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
    >>> response = linearise(scene)
    >>> print(f"{response.coordinates['x']['displacement_std'].value:.4f} m")
    0.5231 m
    """
    return linearise_all(scene, form, variant, budget=budget)[0]


@calculation
def linearise_all(
    scene: Scene,
    form: str = "closure",
    variant: str = "consistent",
    *,
    budget: float | None = None,
) -> tuple[Response, ...]:
    """All responses that are their own linearisation; the first is that of `linearise`.

    White noise has one. In coloured noise the linearised resonance may pass a peak or an edge of
    the density more than once. A hardening spring under a sine does the same. Which solution is
    seen then depends on how the motion began, and each warns of the others. The one next to the
    response without stops comes first. With several coordinates the answers are those that starts
    at several speeds lead to. Parameters and exceptions are those of `linearise`.

    Parameters
    ----------
    scene
        The scene.
    form
        Form of the linearisation, as for `linearise`.
    variant
        Variant of the form, as for `linearise`.
    budget
        Seconds after which `NotConverged` is raised; None for no limit.

    Returns
    -------
    tuple[Response, ...]
        Every solution that was found, SI units.

    See Also
    --------
    stochvi.linearise : One form, of one scene.

    Examples
    --------
    >>> from stochvi.scenes.impact_laws import Restitution
    >>> from stochvi.scenes.excitations import TabulatedNoise
    >>> from stochvi.scenes.scene import ImpactPair
    >>> from stochvi.scenes.structures import Oscillator
    >>> band = TabulatedNoise(on="x", frequency_hz=[0.5, 5.0], density=[0.4, 0.4], unit="N2/Hz")
    >>> scene = Scene(
    ...     structure=Oscillator(mass=1.0, damping=0.02, stiffness=1.0),
    ...     impact_pairs=[ImpactPair(lower=-0.2, upper=0.2, law=Restitution(coefficient=0.9))],
    ...     excitations=[band],
    ... )
    >>> [f"{one.coordinates['x']['velocity_std'].value:.3f}" for one in linearise_all(scene)]
    ['0.141', '0.379', '0.622']
    """
    started = time.perf_counter()
    _check_words(form, variant)
    model = model_of(scene)
    if form == "closure" and variant == "consistent" and model.functions:
        return linearised_functions(scene, Deadline.after(budget))
    if form == "closure" and variant == "consistent" and _is_structure(model):
        return closure(scene, Deadline.after(budget))
    model, candidates = linear_oscillators(scene, form, variant)
    gap, free = Gap.of(model), not model.stops
    exact = free or (form in ("closure", "clumps") and model.elastic and not gap.coloured)
    acceleration = linear_acceleration(model)
    found = [
        answer_of(gap, candidate, acceleration).response(
            method_name(form, variant),
            scene,
            how="exact: linear and Gaussian" if free else _HOW[form],
            started=started,
            bias=0.0 if exact else None,
            assumptions=() if free else _assumptions(form, variant, model),
        )
        for candidate in candidates
    ]
    several = _several(candidates)
    warned = [
        replace(one, warnings=[*one.warnings, *several, *_warnings(model, candidate, form)])
        for one, candidate in zip(found, candidates, strict=True)
    ]
    return tuple(warned if exact else [with_bounds(one, model) for one in warned])


def method_name(form: str, variant: str) -> str:
    """The name of a form and a variant in a response."""
    return f"linearise:{form}" + ("" if variant == "consistent" else f":{variant}")


def linear_oscillators(scene: Scene, form: str, variant: str) -> tuple[Model, list[Candidate]]:
    """The model of a scene of one oscillator, and its solutions per unit mass."""
    _check_words(form, variant)
    model = model_of(scene)
    if conditions := unmet(model, form, variant):
        raise NotApplicable("linearise", conditions)
    if not model.stops:
        return model, [_without_stops(model)]
    gap, name = Gap.of(model), method_name(form, variant)
    if form == "clumps":
        # the better closure of the two, where it applies
        better = form_of("closure", "box" if len(gap.stops) == 2 else variant, gap)
        return model, [clumped(model, one) for one in solve(gap, better, name)]
    return model, solve(gap, form_of(form, variant, gap), name)


_HOW = {
    "closure": "moment closure",
    "clumps": "moment closure and law of the energy",
    "motion": "linearisation, cut normal law of the motion",
    "force": "linearisation, Gaussian law of the force",
}

_RAYLEIGH = "impact speeds are Rayleigh distributed, mean square 2 E v^2"
_ASSUMPTIONS = {
    ("closure", "consistent"): (
        "x has the density C exp(lambda x - kappa x^2 / 2) between the stops; v is Gaussian and "
        "independent of x",
        _RAYLEIGH,
    ),
    ("closure", "box"): (
        "x has the density C exp(lambda x - kappa x^2 / 2) between the stops",
        "as far as impacts take the energy, they have the strength and speeds of those of a free "
        "mass in a box",
    ),
    ("clumps", "consistent"): (
        "x has the density C exp(lambda x - kappa x^2 / 2) between the stops; v is Gaussian and "
        "independent of x; impact speeds are Rayleigh distributed at a single stop; between two, "
        "as far as impacts take the energy, they are those of a free mass in a box",
    ),
    ("motion", "consistent"): (
        "x has a normal distribution truncated at the stops; its mean and deviation before the cut "
        "are taken for those of x; v is Gaussian and independent of x",
        _RAYLEIGH,
    ),
    ("motion", "book"): (
        "x has a normal distribution truncated at the stops; its mean and deviation before the cut "
        "are taken for those of x; v is Gaussian and independent of x",
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


def _is_structure(model: Model) -> bool:
    """Whether the closure for several coordinates, pairs or signals is the one to use.

    One oscillator under filtered noise counts among these as long as no stop is compliant.
    """
    if functions(model) or not beyond_one_oscillator(model):
        return False
    rigid = all(stop.rigid for stop in model.stops)
    return bool(beyond_one_oscillator(model, with_filters=True)) or rigid


_WITHIN = {
    "closure": "within a compliant stop the density falls off with the energy stored there",
    "motion": "the normal distribution goes on within a compliant stop",
    "force": "spring and stop together have one inverse characteristic",
}


def _assumptions(form: str, variant: str, model: Model) -> tuple[str, ...]:
    soft = [stop.law for stop in model.stops if not stop.rigid]
    found = _ASSUMPTIONS[form, variant]
    if form == "clumps":
        found = (*found, _of_clusters(energy_weight(model)))
    if soft:
        found = (*found, _WITHIN[form])
    if any(not law.conservative for law in soft):
        found = (*found, "a contact of a viscoelastic stop loses what that of a free mass does")
    return found


def _of_clusters(weight: float) -> str:
    if weight < UNSEEN:
        return (
            "impacts in clusters are left out, as nothing measures the gap by the motion without "
            "stops: the answer is that of the closure"
        )
    return (
        f"impacts come in clusters, as under a slowly varying energy, with the weight {weight:.2g} "
        "(gap / (gap + 50 zeta), gap in deviations without stops)"
    )


def _check_words(form: str, variant: str) -> None:
    if form not in FORMS:
        raise ValueError(f"form must be one of {', '.join(FORMS)}, got {form!r}")
    if variant not in VARIANTS:
        raise ValueError(f"variant must be one of {', '.join(VARIANTS)}, got {variant!r}")
    if form in ("closure", "clumps") and variant == "book":
        others = "'consistent' or 'box'" if form == "closure" else "'consistent'"
        raise ValueError(
            f"variant must be {others} for form {form!r}, which is not in the book; 'book' is of "
            "the forms 'motion' and 'force'"
        )
    if form != "closure" and variant == "box":
        only = "'consistent'" if form == "clumps" else "'consistent' or 'book'"
        raise ValueError(f"variant must be {only} for form {form!r}, got 'box'")


def unmet(model: Model, form: str = "closure", variant: str = "consistent") -> list[str]:
    """The conditions of a form for one oscillator that a model does not meet."""
    found = beyond_one_oscillator(model, with_filters=True) + not_gaussian(model)
    if found:
        return found
    found = [*without_noise(model), *unknown_dampers(model), *without_energy(model)]
    if form == "clumps":
        if model.tables or model.filters:
            found.append("excitation must be white noise for form 'clumps', got a coloured one")
        found.extend(compliant(model))
    found.extend(without_dissipation(model))
    if model.omega == 0.0:
        if not _held(model):
            found.append("stiffness must be positive where stops do not hold the mass, got 0")
        elif form == "motion":
            found.append("stiffness must be positive for form 'motion', got 0")
        elif form == "force" and len(model.stops) < 2:
            found.append("stiffness must be positive for form 'force' with one stop, got 0")
    if variant == "box" and not found:
        found.extend(compliant(model))
        if len(model.stops) == 1:
            found.append("variant 'box' needs stops on both sides, got one")
    return found


def _held(model: Model) -> bool:
    """Whether spring or stops keep the mass, also a table whose force no longer grows."""
    if not model.held:
        return False
    if all(stop.rigid for stop in model.stops):
        return True
    try:
        gibbs_law(Gap.of(model), 1.0)
    except ValueError:
        return False
    return True


def _several(candidates: Sequence[Candidate]) -> list[str]:
    if len(candidates) == 1:
        return []
    deviations = ", ".join(f"{math.sqrt(one.variance):.4g}" for one in candidates)
    return [
        f"this form has {len(candidates)} solutions, of displacement_std {deviations} m: which one "
        "is seen depends on how the motion began (linearise_all gives all of them)"
    ]


def _warnings(model: Model, candidate: Candidate, form: str) -> list[str]:
    found = []
    if candidate.rise > 1.0:
        found.append(
            "the mass lies closer to a stop than a density C exp(lambda x - kappa x^2 / 2) allows: "
            f"the density is kept at its limit, and raised {candidate.rise:.3g}-fold at the stop"
        )
    for stop in model.stops_per_unit_mass:
        law = stop.law
        if not law.rigid:
            if form == "closure" and isinstance(law, Viscoelastic) and law.damping_ratio >= LOSSY:
                found.extend(_warnings_of_losses(model, stop, law))
        elif stop.deflection(candidate.mean) > 0.0:
            found.append(f"the mean that this form gives lies beyond the {stop.name} stop")
    return found


LOSSY = 0.15
"""Damping ratio of a stop from which the error of the closure is known to be large."""

MEASURED_RATIOS = (0.2, 0.4, 0.6, 1.0)
"""Damping ratios at which the two errors below were measured against `fokker_planck`: single stops
of 3 to 300 times the stiffness of the spring, zeta 0.01 to 0.2."""

PRESSED_ERROR = (0.18, 0.40, 0.54, 0.74)
"""Largest relative error of sigma_x seen where the rest position of the spring lies within a stop,
by 0.3 to 2 deviations without stops."""

CONTACT_ERROR = (0.30, 0.55, 0.73, 0.96)
"""Largest relative error of P(contact) seen with stops at rest to 2 deviations away. It is always
too high; less for stiffer stops, where contacts are short."""

LONG_CONTACT = 300.0
"""Stiffness of a stop, relative to that of the spring, up to which the warning about P(contact) is
given."""


def _warnings_of_losses(model: Model, stop: Stop, law: Viscoelastic) -> list[str]:
    """Warnings with the known errors where a stop dissipates much energy in its contacts."""
    ratio, side = law.damping_ratio, stop.name
    # would a load alone, without noise, hold the mass on the stop?
    if stop.side * (model.load - model.omega**2 * stop.position) > 0.0:
        off = 100.0 * float(np.interp(ratio, MEASURED_RATIOS, PRESSED_ERROR))
        return [
            f"a load presses the mass onto the {side} stop, whose damping_ratio is {ratio:g}: "
            f"displacement_std may be off by {off:.0f} %, and statistics of impacts by far more; "
            "simulate this scene"
        ]
    if law.stiffness <= LONG_CONTACT * model.omega**2:
        off = 100.0 * float(np.interp(ratio, MEASURED_RATIOS, CONTACT_ERROR))
        return [
            f"contacts with the {side} stop, whose damping_ratio is {ratio:g}, are long: "
            f"contact_probability may be {off:.0f} % too high"
        ]
    return []


def _without_stops(model: Model) -> Candidate:
    variance, velocity = linear_moments(Gap.of(model), 0.0, 0.0)
    return Candidate(
        mean=model.rest,
        variance=variance,
        velocity_mean_square=velocity,
        density_at_mean=1.0 / (ROOT_TWO_PI * math.sqrt(variance)),
        stop_force=0.0,
        stiffness=0.0,
        damping=0.0,
        hits={},
        contacts={},
    )
