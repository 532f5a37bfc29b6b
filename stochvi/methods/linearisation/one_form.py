"""Linearisation of a scene. Chapters: the closure corrected for clusters of impacts; conditions,
answers and warnings; rms along a bar, a beam or a plate; the linearised oscillator; the linear
structure and its spectra."""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from stochvi.mathematics.impact_rates import StopStatistics
from stochvi.mathematics.numerics import Matrix, Vector
from stochvi.mathematics.spectra import Filter, Force, gains, squared_gain
from stochvi.mathematics.units import explain_methods
from stochvi.methods.linearisation.forms import form_of
from stochvi.methods.linearisation.linear_system import (
    ROOT_TWO_PI,
    Candidate,
    answer_of,
    gibbs_law,
    linear_moments,
    solve,
)
from stochvi.methods.linearisation.structure_closure import closure, linearised_functions, solutions
from stochvi.model.build_response import linear_acceleration, with_bounds
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
from stochvi.model.energy_law import energy_law
from stochvi.model.gap import Gap
from stochvi.model.modal import EquivalentLinear, ModalForm
from stochvi.model.model import Model, Stop, model_of
from stochvi.results.base import DataFrame, Response, frame_of
from stochvi.results.deadline import Deadline
from stochvi.results.errors import NotApplicable, NotConverged
from stochvi.sampling.calculations import calculation
from stochvi.scenes.excitations.base import BASE
from stochvi.scenes.excitations.base import Density as ExcitationDensity
from stochvi.scenes.impact_laws import Viscoelastic
from stochvi.scenes.scene import Scene
from stochvi.scenes.structures.modes import Span

if TYPE_CHECKING:
    from stochvi.results.base import CoordinateResponse


# ------------------------------------------------------------------------------
# The closure corrected for impacts that come in clusters.
#
# A lightly damped mass keeps its energy for some 1 / zeta cycles: once it reaches stops that are
# far away it hits them again and again, at speeds that no Gaussian velocity has. The closure does
# not describe such clusters; the distribution of the slowly varying energy (`energy_law`, with
# finite jumps) describes nothing but them. This form takes the weighted mean of both,
#
#     E = (1 - w) E_closure + w E_energy,      w = gap / (gap + CLUMPING zeta),
#
# for mean forces, losses and moments alike. gap is the distance of the nearest stop from the
# position of rest, in standard deviations of the motion without stops. Between two stops the
# closure is that of the variant "box". The balance of energy is linear in these numbers and holds
# for both laws, so that it holds for their mean; the linear model with the m_F, k and beta that
# follow from the mean obeys it, too.
# ------------------------------------------------------------------------------


CLUMPING = 50.0
"""A gap of one deviation is described half by the closure and half by the energy at zeta = 1 /
CLUMPING. Chosen on the grid of the atlas. There it lowers the mean error of F1 between two stops
from 11 to 3 %; at zeta up to 0.05 with gaps from 2 deviations, from 36 to 3 %. With 25 or 100 the
error of sigma_v or of F1 grows by half (studies/13_linearisation_atlas)."""

UNSEEN = 1e-6
"""Weight of the distribution of the energy below which it is not computed."""


def energy_weight(model: Model) -> float:
    """Weight of the distribution of the energy: 0 for the closure alone, as for a preload, up to 1.

    A mass without a spring or a damper has no deviation to measure by: its w is 0.
    """
    if model.omega == 0.0 or model.damping_rate == 0.0:
        return 0.0
    deviation = math.sqrt(model.intensity / (2.0 * model.damping_rate)) / model.omega
    distances = [stop.side * (stop.position - model.rest) for stop in model.stops]
    gap = max(min(distances), 0.0) / deviation
    zeta = model.damping_rate / (2.0 * model.omega)
    return gap / (gap + CLUMPING * zeta)


def clumped(model: Model, closure: Candidate) -> Candidate:
    """The answer of the closure corrected by the distribution of the energy, in SI units."""
    weight = energy_weight(model)
    if weight < UNSEEN:
        return closure
    # measured from the rest position, so that a large load causes no loss of digits
    rest = model.rest
    law = energy_law(Gap.of(model).from_rest(rest))
    first, second = law.moment(lambda o: o.first), law.moment(lambda o: o.second)

    def mixed(closed: float, energetic: float) -> float:
        return (1.0 - weight) * closed + weight * energetic

    away = mixed(closure.mean - rest, first)
    variance = mixed(closure.variance + (closure.mean - rest) ** 2, second) - away**2
    velocity = mixed(closure.velocity_mean_square, law.velocity_mean_square)
    crossings = mixed(
        closure.density_at_mean * math.sqrt(closure.velocity_mean_square) / ROOT_TWO_PI,
        law.rate_of_cycles_above(float(law.well.energy(first))),
    )
    return closure._replace(
        mean=rest + away,
        variance=variance,
        velocity_mean_square=velocity,
        density_at_mean=crossings * ROOT_TWO_PI / math.sqrt(velocity),
        stop_force=-(model.omega**2) * away,
        stiffness=velocity / variance - model.omega**2,
        damping=model.intensity / (2.0 * velocity) - model.damping_rate,
        hits={
            stop.side: _mixed_stop(closure.hits[stop.side], law.stop(stop.name), weight)
            for stop in model.stops
        },
    )


def _mixed_stop(closed: StopStatistics, energetic: StopStatistics, weight: float) -> StopStatistics:
    return StopStatistics(
        *((1.0 - weight) * a + weight * b for a, b in zip(closed, energetic, strict=True))
    )


# ------------------------------------------------------------------------------
# Linearisation of a scene: the conditions, the answers, and their assumptions and warnings.
# ------------------------------------------------------------------------------


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


# ------------------------------------------------------------------------------
# The rms displacement along a bar or a beam, or over a plate, with its stops and without.
# ------------------------------------------------------------------------------


PLACES = {1: 101, 2: 21}
"""Number of places along each side, of a structure with a length alone and of one with an area."""


def rms_along(scene: Scene) -> DataFrame:
    """Find the rms displacement at places over a structure, by statistical linearisation.

    Parameters
    ----------
    scene
        Scene with a bar, a beam or a plate.

    Returns
    -------
    pandas.DataFrame
        A row for each place: its distance from the first end (m), or `x_m` and `y_m` on a plate,
        row after row along y; the rms about the mean without stops (m), which is exact; and that
        with stops, which is approximate. The latter is missing where `linearise` has no answer.

    Examples
    --------
    >>> from stochvi.scenes import load_scene, shipped_scene
    >>> rms_along(load_scene(shipped_scene("beam"))).iloc[[50, 100]].round(5).values.tolist()
    [[0.1, 0.00045, 0.00029], [0.2, 0.00133, 0.00083]]
    """
    span = scene.structure
    if not isinstance(span, Span):
        raise NotApplicable(
            "map", f"structure.kind must be 'bar', 'beam' or 'plate', got {span.kind!r}"
        )
    count = PLACES[len(span.sides)]
    fine = scene.replace(structure=span.with_places(count))
    share = np.linspace(0.0, 1.0, count)
    sides = np.meshgrid(*(share * side for side in span.sides), indexing="ij")
    names = ("distance_m",) if len(sides) == 1 else ("x_m", "y_m")
    table = {name: place.ravel() for name, place in zip(names, sides, strict=True)}
    table["rms_without_stops_m"] = _rms(fine.replace(impact_pairs=[]))
    if scene.impact_pairs:
        with contextlib.suppress(NotApplicable, NotConverged):
            table["rms_with_stops_m"] = _rms(fine)
    return frame_of(table)


def _rms(fine: Scene) -> np.ndarray:
    """Standard deviations of the displacement at all places, m."""
    found = linearise(fine).coordinates
    places = [name for name in fine.structure.places if name.startswith("place ")]
    return np.array([_std(found[name]) for name in places])


def _std(motion: CoordinateResponse) -> float:
    """Standard deviation of a displacement, m; nan where it is not known."""
    return np.nan if motion.displacement_std is None else motion.displacement_std.value


# ------------------------------------------------------------------------------
# The linearised oscillator itself: its stiffness and damping, and the spectra of its response.
# ------------------------------------------------------------------------------


PLACES_BETWEEN_STOPS = 2001
"""Number of frequencies at which a spectrum is evaluated in the search for its peak, before
refinement."""

DECADES = 4.0
"""Number of decades below and above the linearised resonance within which a spectral peak is looked
for."""


@explain_methods
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
    forces: tuple[ExcitationDensity, ...]
    base: tuple[ExcitationDensity, ...]

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
        logs = math.log(self.resonance_hz) + math.log(10.0) * DECADES * np.linspace(
            -1, 1, PLACES_BETWEEN_STOPS
        )

        def density(log_frequency: ArrayLike) -> Vector:
            return self.displacement_density(np.exp(np.asarray(log_frequency)))

        best = int(np.argmax(density(logs)))
        ends = float(logs[max(best - 1, 0)]), float(logs[min(best + 1, PLACES_BETWEEN_STOPS - 1)])
        found = scipy.optimize.minimize_scalar(
            lambda log: -float(density(log)), bounds=ends, method="bounded", options={"xatol": 1e-9}
        )
        return math.exp(found.x)

    def _gain(self, frequency_hz: ArrayLike) -> Vector:
        return squared_gain(frequency_hz, math.sqrt(self.total_stiffness), self.total_damping)

    def _sum(self, densities: tuple[ExcitationDensity, ...], frequency_hz: ArrayLike) -> Vector:
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
    forces: list[ExcitationDensity] = []
    base: list[ExcitationDensity] = []
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


def _per_unit_mass(density: ExcitationDensity, mass: float) -> ExcitationDensity:
    return lambda frequency_hz: density(frequency_hz) / mass**2


def _oscillator(
    candidate: Candidate,
    own_stiffness: float,
    own_damping: float,
    forces: tuple[ExcitationDensity, ...],
    base: tuple[ExcitationDensity, ...],
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


# ------------------------------------------------------------------------------
# The linear structure that stands for several coordinates and pairs, and its spectra.
# ------------------------------------------------------------------------------


Density = Callable[[ArrayLike], NDArray[np.float64]]


@explain_methods
@dataclass(frozen=True, kw_only=True)
class LinearisedStructure:
    """M q'' + C q' + K q + sum over pairs d (k (y - centre) + beta y') = forces, y = d . q.

    It stands for a scene in `linearise` (B 17.3, 17.38). Densities are one-sided per hertz, at
    frequencies in hertz, and exact for this structure; sines are lines and are left out.

    Parameters
    ----------
    coordinates
        Names of q.
    stops
        Spring k (N/m), its centre (m) and damper beta (N s/m), by the name of the pair.
    shapes
        Phi (n, n), q = Phi times modal displacements.
    stiffness, damping
        Modal matrices (n, n), stops included, and the dampers of impacts that scatter energy.
    shaken
        (one-sided density, modal forces (n,) per unit of it) of all noise, that of impacts that
        scatter energy included.

    See Also
    --------
    stochvi.methods.linearisation.linearised_structures : The calculation.
    """

    coordinates: tuple[str, ...]
    stops: Mapping[str, EquivalentLinear]
    shapes: Matrix
    stiffness: Matrix
    damping: Matrix
    shaken: tuple[tuple[Density, Force], ...]

    def displacement_density(self, coordinate: str, frequency_hz: ArrayLike) -> Vector:
        """One-sided density of the displacement of a coordinate, m^2/Hz.

        Raises
        ------
        KeyError
            If there is no such coordinate.
        """
        if coordinate not in self.coordinates:
            raise KeyError(
                f"coordinate must be one of {', '.join(self.coordinates)}, got {coordinate!r}"
            )
        row = self.shapes[self.coordinates.index(coordinate)]
        f = np.asarray(frequency_hz, dtype=float)
        total = np.zeros(f.size)
        for density, force in self.shaken:
            gain = gains(f.ravel(), self.stiffness, self.damping, force) @ row
            total += density(f.ravel()) * np.abs(gain) ** 2
        return total.reshape(f.shape)

    def velocity_density(self, coordinate: str, frequency_hz: ArrayLike) -> Vector:
        """One-sided density of the velocity of a coordinate, (m/s)^2/Hz."""
        w = 2.0 * np.pi * np.asarray(frequency_hz, dtype=float)
        return np.asarray(w**2 * self.displacement_density(coordinate, frequency_hz))


@calculation
def linearised_structures(
    scene: Scene, *, budget: float | None = None
) -> tuple[LinearisedStructure, ...]:
    """The linear structures that stand for a scene in `linearise`, one for every solution.

    Parameters
    ----------
    scene
        Any scene that `linearise` covers by the closure. A loose mass in a box, too, gets the
        springs and dampers of the closure.
    budget
        Seconds after which `NotConverged` is raised; None for no limit.

    Returns
    -------
    tuple[LinearisedStructure, ...]
        Every linear structure that was found.

    Raises
    ------
    NotApplicable, NotConverged
        As `linearise`.

    See Also
    --------
    stochvi.linearise : The response.
    stochvi.methods.linearisation.linearised_oscillators : The same for one oscillator.

    Examples
    --------
    >>> from stochvi.scenes.impact_laws import Viscoelastic
    >>> from stochvi.scenes.excitations import WhiteNoise
    >>> from stochvi.scenes.scene import ImpactPair
    >>> from stochvi.scenes.structures import Matrices
    >>> scene = Scene(
    ...     structure=Matrices(
    ...         coordinates=["a", "b"], mass=[[1.0, 0.0], [0.0, 0.5]],
    ...         damping=[[0.3, -0.1], [-0.1, 0.1]], stiffness=[[2.0, -1.0], [-1.0, 1.0]],
    ...     ),
    ...     impact_pairs=[
    ...         ImpactPair(on="a", upper=0.5, law=Viscoelastic(stiffness=50.0, damping_ratio=0.2))
    ...     ],
    ...     excitations=[WhiteNoise(on="a", intensity=0.3)],
    ... )
    >>> (found,) = linearised_structures(scene)
    >>> f = np.linspace(0.0, 20.0, 100_001)
    >>> area = np.trapezoid(found.displacement_density("a", f), f)
    >>> from stochvi.methods.linearisation import linearise
    >>> rms = linearise(scene).coordinates["a"]["displacement_std"].value
    >>> print(f"{area**0.5 / rms:.4f}")
    1.0000
    """
    model = model_of(scene)
    if conditions := functions(model) + not_gaussian(model):
        raise NotApplicable("linearise", conditions)
    modes = model.modal
    found = []
    for one in solutions(model, Deadline.after(budget)):
        stops = {
            gap.pair.name: gap.substitute(candidate)
            for gap, candidate in zip(one.gaps, one.candidates, strict=True)
        }
        springs = np.array([each.spring for each in stops.values()])
        dampers = np.array([each.damper for each in stops.values()])
        found.append(
            LinearisedStructure(
                coordinates=model.coordinates,
                stops=stops,
                shapes=modes.shapes,
                stiffness=np.diag(modes.squares) + (modes.gaps.T * springs) @ modes.gaps,
                damping=one.modes.damping + (modes.gaps.T * dampers) @ modes.gaps,
                shaken=_shaken(model, one.modes),
            )
        )
    return tuple(found)


def _shaken(model: Model, modes: ModalForm) -> tuple[tuple[Density, Force], ...]:
    """All noise as densities and modal forces; white noise in independent parts of density 2."""
    found: list[tuple[Density, Force]] = [(table, force) for table, force in modes.tables]
    for signal in model.signals:
        if signal.intensity:
            noise = Filter(signal.omega, signal.damping_rate, signal.intensity)
            found.append((noise.__call__, modes.shapes.T @ signal.direction))
    intensities, directions = np.linalg.eigh(modes.white)
    # the error of an eigenvalue of a matrix of low rank is the rounding error of the largest one
    kept = intensities > np.finfo(float).eps * len(intensities) * max(intensities[-1], 0.0)
    for intensity, direction in zip(intensities[kept], directions.T[kept], strict=True):
        found.append((_flat, np.sqrt(intensity) * direction))
    return tuple(found)


def _flat(frequency_hz: ArrayLike) -> Vector:
    """One-sided density of white noise of intensity 1."""
    return np.full(np.shape(frequency_hz), 2.0)
