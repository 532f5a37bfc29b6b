"""Linearisation of several coordinates and pairs. Chapters: energy that impacts scatter among
modes; the stated error; the moment closure; springs and dampers that are functions."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import scipy

from stochvi.mathematics.numerics import Vector
from stochvi.methods.linearisation import loose_mass
from stochvi.methods.linearisation.forms import form_of, soft_closure
from stochvi.methods.linearisation.linear_system import (
    INFEASIBLE,
    ROOT_TWO_PI,
    START_SPEEDS,
    Candidate,
    Form,
    Frame,
    Problem,
    Unknowns,
    answer_of,
    root,
    same,
)
from stochvi.model.build_response import (
    BETWEEN_IMPACTS,
    build_response,
    coordinate_of,
    residuals,
)
from stochvi.model.coverage import (
    functions_of_arrays,
    modulated,
    not_gaussian,
    speed_restitutions,
    unknown_dampers,
    without_energy,
    without_noise,
)
from stochvi.model.gap import Gap
from stochvi.model.modal import (
    Branch,
    EquivalentLinear,
    LinearLaw,
    ModalForm,
    absolute_accelerations,
    linear_law,
)
from stochvi.model.model import FunctionOfMotion, Model, Pair, Stop, model_of
from stochvi.model.scales import (
    UNSHAKEN,
    Motion,
    PairScale,
    between,
    motions_of,
    scales_by,
    with_forms,
    with_linear_part,
)
from stochvi.results.base import PairResponse, Response
from stochvi.results.deadline import NEVER, Deadline
from stochvi.results.errors import NotApplicable, NotConverged
from stochvi.results.estimates import Cost, Estimate
from stochvi.scenes.characteristics import BoucWen
from stochvi.scenes.impact_laws import Elastic, Viscoelastic
from stochvi.scenes.scene import Scene

# ------------------------------------------------------------------------------
# Energy that impacts scatter among the modes of a structure.
#
# A spring and a damper in place of the stops push in step with their gap. The impulses of real
# impacts come at times that the other modes do not know: they shake all modes. A part of them,
# `SCATTERED`, acts here as white noise on the gap, of intensity rate times E P^2, with P the
# impulse of an impact; less where contacts are long and the force is that of the spring. At
# Rayleigh speeds E P^2 = 4 / pi (E P)^2, and rate times E P is the mean force of the stop. A damper
# in parallel takes the power of this noise again, since impacts make none: the balance of energy
# stays as it was. Noise and damper of one temperature leave a Gibbs distribution as it is, so that
# the closure stays exact where it was.
#
# A contact of the duration T hardly moves a mode whose period is shorter. Noise and damper act on
# each mode by the spectrum of a half sine, cos(pi x / 2) / (1 - x^2) with x = omega T / pi.
# ------------------------------------------------------------------------------


SCATTERED = 0.7
"""Share of the impulses that acts as white noise. Of 0, 0.35, 0.5, 0.7 and 1 it has the least
errors in 200 random structures of 2 to 10 modes, compared with simulations."""


ASSUMPTION = (
    f"impacts scatter energy among modes: {SCATTERED:g} of their impulses act as white noise, "
    "whose power a damper takes; their spectrum is that of a half sine as long as a contact"
)

LEFT_OUT = (
    "no response was found with the energy that impacts scatter among modes: it is left out, and "
    "rates may be several times too high; simulate this scene"
)


class Scattering(NamedTuple):
    """White noise on a pair by its impacts: its intensity, N^2 s, and the modal forces (n,) per
    unit of it."""

    intensity: float
    row: Vector


def acts(modes: ModalForm) -> bool:
    """Whether impacts scatter energy: among several modes, under white noise alone, for which it
    was compared with simulations."""
    return modes.size > 1 and not len(modes.signals) and not modes.tables


def scattering(
    candidate: Candidate, stops: Sequence[Stop], mass: float, gap: Vector, omega: Vector
) -> Scattering:
    """The noise of the impacts of a candidate on a gap of modes of these frequencies, rad/s."""
    parts = [_of_stop(candidate, stop, omega) for stop in stops]
    whole = sum(intensity for intensity, _ in parts)
    if not whole > 0.0:
        return Scattering(0.0, gap)
    squares = sum(intensity * shape**2 for intensity, shape in parts) / whole
    share = SCATTERED * _share_of_no_spring(candidate)
    return Scattering(share * mass**2 * whole, gap * np.sqrt(squares))


def _share_of_no_spring(candidate: Candidate) -> float:
    """Part of the variance of the force of the stops that their spring leaves, by half sines: 1 for
    brief contacts, 0 for a stop that is never left and so is a spring."""
    contacts = [contact for contact in candidate.contacts.values() if contact.probability > 0.0]
    if len(contacts) < len(candidate.hits):
        return 1.0
    square = math.pi / 2.0 * sum(each.force**2 / each.probability for each in contacts)
    variance = square - candidate.stop_force**2
    spring = candidate.stiffness**2 * candidate.variance
    return max(1.0 - spring / variance, 0.0) if variance > 0.0 else 0.0


def _of_stop(candidate: Candidate, stop: Stop, omega: Vector) -> tuple[float, Vector]:
    """Rate times E P^2 of one stop, per unit mass, and the spectrum of its contacts at omega."""
    hits, contact = candidate.hits[stop.side], candidate.contacts.get(stop.side)
    if not hits.rate > 0.0:
        return 0.0, np.ones_like(omega)
    push, duration = (1.0 + stop.law.restitution) * hits.speed_rate, 0.0
    if contact is not None:
        push, duration = contact.force, contact.probability / hits.rate
    return 4.0 / math.pi * push**2 / hits.rate, half_sine(omega * duration / math.pi)


def half_sine(x: Vector) -> Vector:
    """Spectrum of a half sine over that at 0; x is omega over the frequency of the sine.

    >>> half_sine(np.array([0.0, 1.0, 2.0])).round(4).tolist()
    [1.0, 0.7854, 0.3333]
    """
    # cos(pi x / 2) / (1 - x^2) without a zero divided by zero at x = 1
    return math.pi / 2.0 * np.sinc((x - 1.0) / 2.0) / (1.0 + x)


def scattered(
    modes: ModalForm, noises: Sequence[Scattering], squares: Sequence[float]
) -> ModalForm:
    """The structure with the noise of impacts, and with dampers that take its power at the mean
    squares of row . q'."""
    white, damping = modes.white.copy(), modes.damping.copy()
    for (intensity, row), square in zip(noises, squares, strict=True):
        shape = intensity * np.outer(row, row)
        white += shape
        damping += float(row @ row) / (2.0 * square) * shape
    return modes._replace(white=white, damping=damping)


# ------------------------------------------------------------------------------
# Stated error of the closure of a structure, calibrated on random structures.
#
# Errors of ln(closure / simulation) were measured on 191 random structures of 2 to 10 modes. They
# grow with the part that impacts scatter: with h, the difference of the logarithms of an answer and
# of that without scattering. They also grow with the crossings of the mean per impact, n: tails err
# most. The bound on the error of a logarithm is
#
#     factor (0.1 + h) (1 + ln n)^(1/2),
#
# without the last term for deviations. Factors are such that 99 % of the errors of these structures
# are within. On 182 other structures 99.8 % were (`data/linearisation_atlas/structures.csv`).
# ------------------------------------------------------------------------------


FLOOR = 0.1
"""Error of a logarithm that the bound includes where impacts scatter nothing, over its factor."""

FACTORS = {
    "displacement_std": 1.0,
    "velocity_std": 1.2,
    "collision_rate": 1.5,
    "impact_speed_rate": 1.3,
    "impact_speed_square_rate": 1.9,
}
"""Factors of the bounds, by quantity."""

LARGEST = 2.0
"""Largest bound on a logarithm, a factor of 7, that is stated: a larger one would be useless."""

MODES, PAIRS, DAMPING_RATIO, DISTANCE = (2, 10), 2, (0.003, 0.17), (0.4, 3.0)
"""Ranges of the random structures: number of modes, most pairs, damping ratio of every mode, and
places of the stops in deviations of their gap without stops."""

LEAST_RESTITUTION, MOST_DAMPED, SOFTEST = 0.4, 0.3, 3.0
"""Ranges of their stops: restitution, damping ratio, and stiffness over that of the structure."""

TOGETHER = 0.95
"""Correlation of two gaps without stops up to which a bound is stated. The closure cuts each gap at
its own stops alone: above this, rates were up to 48 times too high."""

ROUNDING = 1e-9
"""Share by which a place may lie outside of a range, for rounding."""


def with_bounds(
    response: Response, plain: Response, model: Model, candidates: Sequence[Candidate]
) -> Response:
    """The response with its bounds as `bias`, from that without scattering, or the reason for none
    in `how`."""
    reason = outside(model)
    before = {key: entry.value for key, entry in plain.estimates().items()}
    tails = {
        pair.name: _log_crossings(candidate)
        for pair, candidate in zip(model.pairs, candidates, strict=True)
    }

    def explained(owner: str, name: str, entry: Estimate) -> Estimate:
        if entry.bias is not None:
            return entry
        if reason:
            return replace(entry, how=f"{entry.how}; no error bound: {reason}")
        quantity = name.removeprefix("relative_")
        size = _log_bound(quantity, entry.value, before.get((owner, name)), tails.get(owner, 0.0))
        if size is None:
            return replace(entry, how=f"{entry.how}; no error bound: not calibrated")
        bound = math.expm1(size) * abs(entry.value)
        return replace(entry, bias=bound, how=f"{entry.how}; error bound from random structures")

    def record(owner: str, known: Any) -> Any:
        found = {
            name: explained(owner, name, each)
            for name, each in known.items()
            if isinstance(each, Estimate)
        }
        return replace(known, **found)

    return replace(
        response,
        coordinates={name: record(name, each) for name, each in response.coordinates.items()},
        impact_pairs={name: record(name, each) for name, each in response.impact_pairs.items()},
    )


def _log_bound(name: str, value: float, before: float | None, tail: float) -> float | None:
    """Bound on the error of the logarithm of a quantity; None where none is known."""
    if name not in FACTORS or before is None or not (value > 0.0 and before > 0.0):
        return None
    far = 1.0 if name.endswith("_std") else math.sqrt(1.0 + tail)
    size = FACTORS[name] * (FLOOR + abs(math.log(value / before))) * far
    return size if size <= LARGEST else None


def _log_crossings(candidate: Candidate) -> float:
    """Logarithm of the crossings of the mean per impact, by a normal distribution; at least 0."""
    impacts = sum(hits.rate for hits in candidate.hits.values())
    speed = math.sqrt(candidate.velocity_mean_square / candidate.variance)
    crossings = len(candidate.hits) * speed / ROOT_TWO_PI**2
    return max(math.log(crossings / impacts), 0.0) if impacts > 0.0 else math.inf


def outside(model: Model) -> str:
    """Why a structure is none of those on which the bounds were calibrated; empty if it is one."""
    modes = model.modal
    free = linear_law(modes)
    if free is None or np.any(model.constant_force) or model.functions:
        return "structures that drift, with loads or with functions were not compared"
    if not MODES[0] <= modes.size <= MODES[1] or len(model.pairs) > PAIRS:
        return f"structures of {MODES[0]} to {MODES[1]} modes with 1 or {PAIRS} pairs were compared"
    ratios = np.diag(modes.damping) / (2.0 * np.sqrt(modes.squares))
    if not all(_within(float(ratio), DAMPING_RATIO) for ratio in ratios):
        low, high = DAMPING_RATIO
        return f"modes of damping ratios {low:g} to {high:g} were compared"
    for pair, row in zip(model.pairs, modes.gaps, strict=True):
        if reason := _outside_of_pairs(pair, row, modes, free):
            return reason
    if len(model.pairs) == PAIRS and _correlation(modes, free) > TOGETHER:
        return "the two gaps move together, and the closure cuts each at its own stops alone"
    return ""


def _outside_of_pairs(pair: Pair, row: Vector, modes: ModalForm, free: LinearLaw) -> str:
    deviation = math.sqrt(free.variances(row, 0))
    stiffness = 1.0 / float(row @ (row / modes.squares))
    for stop in pair.stops:
        if not _within(stop.distance / deviation, DISTANCE):
            return "stops at {:g} to {:g} deviations of their gap were compared".format(*DISTANCE)
        if not _compared(stop, stiffness):
            return (
                f"rigid stops of R from {LEAST_RESTITUTION:g} were compared, and linear ones of "
                f"damping ratios up to {MOST_DAMPED:g}, at least {SOFTEST:g} times as stiff as the "
                "structure at their place"
            )
    return ""


def _compared(stop: Stop, stiffness: float) -> bool:
    """Whether the law of a stop at a place of this static stiffness is one of those compared."""
    law = stop.law
    if law.friction_coefficient:
        return False
    if law.rigid:
        return stop.coefficient is not None and stop.coefficient >= LEAST_RESTITUTION
    ratio = law.damping_ratio if isinstance(law, Viscoelastic) else 0.0
    hard = isinstance(law, Elastic | Viscoelastic) and law.stiffness >= SOFTEST * stiffness
    return hard and ratio <= MOST_DAMPED


def _within(value: float, limits: tuple[float, float]) -> bool:
    return limits[0] * (1.0 - ROUNDING) <= value <= limits[1] * (1.0 + ROUNDING)


def _correlation(modes: ModalForm, free: LinearLaw) -> float:
    """Size of the correlation of the first two gaps without stops."""
    part = slice(0, modes.size)
    shared = modes.gaps[:2] @ free.covariance[part, part] @ modes.gaps[:2].T
    return float(abs(shared[0, 1]) / math.sqrt(shared[0, 0] * shared[1, 1]))


# ------------------------------------------------------------------------------
# The moment closure for several coordinates and pairs: every gap keeps its own balances.
#
# The stops of each pair are replaced by m_F + k (y - E y) + beta y' on its gap y (B 17.3, 17.38).
# The linear structure that remains is solved exactly. As for one oscillator, the gap has the
# density C exp(lambda y - kappa y^2 / 2) between its stops and a Gaussian speed. m_F is the mean
# force of the stops; k is its covariance with y over the variance of y; beta is the power that
# impacts take over E y'^2; lambda, kappa and the speed are those with which the linear structure
# answers. With them the balances of energy and virial of the whole hold, and of the force on every
# coordinate. Under white noise impacts also scatter energy among the modes, as above.
# ------------------------------------------------------------------------------


METHOD = "linearise:closure"

MOST_FORMS = 3
"""Largest number of forms of a gap that are tried in turn: as many as `soft_closure` has."""


class _PairGap(NamedTuple):
    """The gap of one pair as a mass with the static springs of the structure and the stops, per
    unit mass.

    `gap` is in SI units, `scaled` in those of `frame`. `forms` are to be tried in turn.
    """

    pair: Pair
    gap: Gap
    frame: Frame
    scaled: Gap
    forms: tuple[Form, ...]

    def form(self, stage: int) -> Form:
        """Form to try at a stage; after the last form this one is kept."""
        return self.forms[min(stage, len(self.forms) - 1)]

    def candidate(self, unknowns: Unknowns, stage: int) -> Candidate:
        """The candidate of these unknowns, in SI units, per unit mass."""
        return self.frame.grow(self.form(stage).candidate(self.scaled, unknowns))

    def substitute(self, candidate: Candidate) -> EquivalentLinear:
        """Spring, centre and damper that stand for the stops of a candidate."""
        away = candidate.stop_force / candidate.stiffness if candidate.stiffness else 0.0
        return EquivalentLinear(
            spring=self.pair.mass * candidate.stiffness,
            centre=candidate.mean - away,
            damper=self.pair.mass * candidate.damping,
        )


class _Solution(NamedTuple):
    """The law of every gap, and the linear structure that answers with them.

    Where impacts scatter energy its `modes` are shaken and damped by them, too, and `without` is
    the solution that leaves this out.
    """

    gaps: Sequence[_PairGap]
    candidates: Sequence[Candidate]
    modes: ModalForm
    law: LinearLaw
    without: _Solution | None = None


def closure(scene: Scene, deadline: Deadline = NEVER) -> tuple[Response, ...]:
    """Approximate stationary responses of several coordinates, pairs, or signals.

    White, filtered and tabulated noise, sines and loads; stops of any law. Exact without stops, and
    for one elastic pair where noise matches damping. One loose mass in a box on one mode under
    white noise is linearised at every amplitude instead, see `loose_mass`.

    White noise has one response. In coloured noise and under sines there may be several. Those
    found from starts at several speeds are returned, the one next to the response without stops
    first.

    Raises
    ------
    NotApplicable, NotConverged
        With every condition that the scene does not meet; if the iteration converges from none
        of its starts, or the deadline passes before it has.
    """
    started = time.perf_counter()
    return closure_of(scene, model_of(scene), started, deadline)


def closure_of(
    scene: Scene, model: Model, started: float, deadline: Deadline,
    assumptions: Sequence[str] = (), exact_by: str = "",
) -> tuple[Response, ...]:  # fmt: skip
    """`closure` for a model of the scene, which is approximate if that rests on assumptions, unless
    there are words for how the answer is exact."""
    if conditions := [
        *without_noise(model, with_sines=True), *unknown_dampers(model), *without_energy(model)
    ]:  # fmt: skip
        raise NotApplicable("linearise", conditions)
    box = loose_mass.box_of(model)
    if box is not None:
        return (loose_mass.response(scene, model, box, METHOD),)
    found = solutions(model, deadline)
    elastic = len(model.pairs) == 1 and model.elastic
    exact = not model.pairs or (elastic and model.temperature is not None)
    exact &= bool(exact_by) or not assumptions
    outline = _Outline(scene, model, 0.0 if exact else None, started, tuple(assumptions), exact_by)
    warned = _several(found)
    return tuple(_bounded(outline, one, _response(outline, one, warned)) for one in found)


def _bounded(outline: _Outline, one: _Solution, response: Response) -> Response:
    """The response with its stated error where the closure is approximate and has one."""
    if outline.bias is not None or one.without is None or outline.rests_on:
        return response
    plain = _response(outline, one.without, ())
    return with_bounds(response, plain, outline.model, one.candidates)


def solutions(model: Model, deadline: Deadline = NEVER) -> list[_Solution]:
    """The laws of all gaps with which the linear structure answers, by Newton's method.

    Raises
    ------
    NotApplicable, NotConverged
        Where there is no stationary response; where no law was found before the deadline.
    """
    modes = model.modal
    rough = scales_by(model, modes, "linearise", compliant=True)
    if rough is None:
        raise NotApplicable(
            "linearise", "every mode must be shaken, lose energy, and be held by stiffness or stops"
        )
    law, scales = rough
    if not model.pairs:
        return [_Solution([], [], modes, law)]
    coloured = bool(model.signals or model.tables)
    free = linear_law(modes) if coloured else None
    for stage in range(MOST_FORMS):
        found: list[_Solution] = []
        for speeds in _starts(modes, scales, free):
            gaps = _gaps(model, scales, speeds)
            one = _from(modes, gaps, stage, deadline)
            if one is not None and not any(_same(one, other) for other in found):
                found.append(one)
            if found and not coloured:
                break
        if found:
            return sorted(found, key=lambda one: 0.0 if free is None else _apart(modes, one, free))
    raise NotConverged(
        f"{METHOD} did not converge: from none of its starts did the iteration reach the response "
        "of the linearised structure; simulate this scene."
    )


def _starts(
    modes: ModalForm, scales: Sequence[PairScale], free: LinearLaw | None
) -> Iterator[list[float]]:
    """Speeds of all gaps to start from: those without stops, and multiples of the rough ones."""
    if free is not None:
        speeds = _free_speeds(modes, free)
        if all(speeds):
            yield speeds
    for factor in START_SPEEDS:
        yield [factor * scale.speed for scale in scales]


def _free_speeds(modes: ModalForm, free: LinearLaw) -> list[float]:
    """Rms speeds of the gaps without stops, m/s; 0 where impacts alone would move a gap."""
    still = UNSHAKEN * free.largest_variance(modes.size)
    squares = [free.variances(row, modes.size) for row in modes.gaps]
    return [math.sqrt(square) if square > still else 0.0 for square in squares]


def _gaps(model: Model, scales: Sequence[PairScale], speeds: Sequence[float]) -> list[_PairGap]:
    """Gaps of all pairs, each on its own in the frame of its speed."""
    white = len(model.coordinates) == 1 and not model.signals and not model.tables
    modes, gaps = model.modal, []
    for pair, row, scale, speed in zip(model.pairs, modes.gaps, scales, speeds, strict=True):
        gap = Gap.of_pair(
            pair,
            omega=math.sqrt(scale.curvature) * scale.speed,
            damping_rate=pair.mass * float(row @ modes.damping @ row),
            load=scale.slope * scale.speed**2,
        )
        frame = Frame.of(gap, speed)
        scaled = frame.shrink(gap)
        if gap.soft:
            form = soft_closure(scaled, coloured=not white)
        else:
            form = form_of("closure", "consistent", scaled)
        gaps.append(_PairGap(pair, gap, frame, scaled, (form, *form.others)))
    return gaps


def _from(
    modes: ModalForm, gaps: Sequence[_PairGap], stage: int, deadline: Deadline
) -> _Solution | None:
    """The solution near the elastic laws of the gaps, or None.

    Impacts that scatter energy are added to the solution without; where that leads nowhere, it is
    kept.
    """

    def problem(scatters: bool) -> Problem:
        def imbalance(unknowns: Unknowns) -> Unknowns:
            if deadline.passed():
                raise deadline.fell_short(f"before {METHOD} has converged", "raise budget")
            return _imbalance(modes, gaps, stage, unknowns, scatters)

        return imbalance

    start = np.concatenate([gap.form(stage).start(gap.scaled) for gap in gaps])
    plain = root(problem(False), start)
    if plain is None:
        return None
    found = _solution(gaps, _Trial.of(modes, gaps, stage, plain, scatters=False))
    if not acts(modes):
        return found
    mixed = root(problem(True), np.concatenate([plain, np.zeros(len(gaps))]))
    if mixed is None:
        return found
    return _solution(gaps, _Trial.of(modes, gaps, stage, mixed, scatters=True), found)


def _solution(
    gaps: Sequence[_PairGap], trial: _Trial, without: _Solution | None = None
) -> _Solution | None:
    law = trial.law
    return None if law is None else _Solution(gaps, trial.candidates, trial.modes, law, without)


def _same(one: _Solution, two: _Solution) -> bool:
    return all(same(*each) for each in zip(one.candidates, two.candidates, strict=True))


def _apart(modes: ModalForm, one: _Solution, free: LinearLaw) -> float:
    """Largest difference of the logarithms of the speeds of a gap, with stops and without, of the
    gaps that move without."""
    return max(
        (
            abs(math.log(candidate.velocity_mean_square / speed**2))
            for candidate, speed in zip(one.candidates, _free_speeds(modes, free), strict=True)
            if speed > 0.0
        ),
        default=0.0,
    )


class _Trial(NamedTuple):
    """The laws of all gaps at some unknowns, and the structure that they call for.

    Where impacts scatter energy each pair has one more unknown: half the log of E (row . q')^2 of
    its `noises` over what the speed of its gap makes of it.
    """

    candidates: list[Candidate]
    modes: ModalForm
    substitutes: list[EquivalentLinear]
    noises: list[Scattering]
    squares: list[float]

    @classmethod
    def of(
        cls, modes: ModalForm, gaps: Sequence[_PairGap], stage: int, unknowns: Unknowns,
        scatters: bool,
    ) -> _Trial:  # fmt: skip
        """The trial of these unknowns."""
        own = unknowns[: len(unknowns) - len(gaps)] if scatters else unknowns
        candidates = [
            gap.candidate(part, stage)
            for gap, part in zip(gaps, np.split(own, len(gaps)), strict=True)
        ]
        substitutes = [
            gap.substitute(candidate) for gap, candidate in zip(gaps, candidates, strict=True)
        ]
        if not scatters:
            return cls(candidates, modes, substitutes, [], [])
        omega, noises, squares = np.sqrt(modes.squares), [], []
        for gap, row, candidate, more in zip(
            gaps, modes.gaps, candidates, unknowns[len(own) :], strict=True
        ):
            noise = scattering(candidate, gap.gap.stops, gap.pair.mass, row, omega)
            share = float(noise.row @ noise.row) / float(row @ row)
            noises.append(noise)
            squares.append(candidate.velocity_mean_square * share * math.exp(2.0 * more))
        shaken = scattered(modes, noises, squares)
        return cls(candidates, shaken, substitutes, noises, squares)

    @property
    def law(self) -> LinearLaw | None:
        """The law of the structure; None where it has no stationary one."""
        return linear_law(self.modes, self.substitutes)


def _imbalance(
    modes: ModalForm, gaps: Sequence[_PairGap], stage: int, unknowns: Unknowns, scatters: bool
) -> Unknowns:
    """Mean, log deviation and log speed of every gap: candidate law less linear structure; then
    half the logs of the mean squares at which impacts scatter."""
    nowhere = np.full(len(unknowns), INFEASIBLE)
    try:
        with np.errstate(all="ignore"):
            trial = _Trial.of(modes, gaps, stage, unknowns, scatters)
            law, found = trial.law, []
            if law is None:
                return nowhere
            for candidate, row in zip(trial.candidates, modes.gaps, strict=True):
                mean = float(row @ (modes.rest + law.mean))
                found += [
                    (candidate.mean - mean) / math.sqrt(candidate.variance),
                    math.log(candidate.variance / law.variances(row, 0)) / 2.0,
                    math.log(candidate.velocity_mean_square / law.variances(row, modes.size)) / 2.0,
                ]
            for noise, square in zip(trial.noises, trial.squares, strict=True):
                found.append(math.log(square / law.variances(noise.row, modes.size)) / 2.0)
    except (ValueError, ZeroDivisionError, OverflowError, np.linalg.LinAlgError):
        return nowhere
    return np.where(np.isfinite(found), found, INFEASIBLE)


class _Outline(NamedTuple):
    """Parts that all responses of a scene have in common."""

    scene: Scene
    model: Model
    bias: float | None
    started: float
    rests_on: tuple[str, ...] = ()
    exact_by: str = ""

    @property
    def how(self) -> str:
        if self.exact_by:
            return self.exact_by
        if self.rests_on and not self.model.pairs:
            return "linearisation of functions, Gaussian motion"
        return "moment closure" if self.model.pairs else "exact: linear and Gaussian"

    def estimate(self, value: float) -> Estimate:
        return Estimate(value=value, bias=self.bias, how=self.how)


def _response(outline: _Outline, one: _Solution, warned: Sequence[str]) -> Response:
    scene, model, modes = outline.scene, outline.model, outline.model.modal
    mean: Vector = modes.shapes @ (modes.rest + one.law.mean)
    moments = _energies(modes, one.law)
    coordinates = {}
    accelerations = _accelerations(model, one)
    shapes = model.output_rows @ modes.shapes
    for name, shape, acceleration in zip(model.outputs, shapes, accelerations, strict=True):
        place = float(shape @ (modes.rest + one.law.mean))
        variance = one.law.variances(shape, 0)
        square = one.law.variances(shape, modes.size)
        moments |= {(name, "x"): place, (name, "variance"): variance, (name, "vv"): square}
        coordinates[name] = coordinate_of(
            lambda _, value: outline.estimate(value), place, variance, square, acceleration
        )
    pairs: dict[str, PairResponse] = {}
    for gap, candidate, row in zip(one.gaps, one.candidates, modes.gaps, strict=True):
        answer, name = answer_of(gap.gap, candidate), gap.pair.name
        moments |= answer.of_stops(gap.pair)
        pairs[name] = answer.pair(
            gap.pair, gap.gap.damping_rate, outline.how, outline.bias,
            others=partial(_unlike_one_mode, modes, one.law, row, gap, candidate),
        )  # fmt: skip
        if gap.pair.relative:
            pairs[name] = replace(
                pairs[name],
                relative_displacement_mean=outline.estimate(
                    float(row @ (modes.rest + one.law.mean))
                ),
                relative_displacement_std=outline.estimate(math.sqrt(one.law.variances(row, 0))),
                relative_velocity_std=outline.estimate(
                    math.sqrt(one.law.variances(row, modes.size))
                ),
            )
    # functions have their linear forms in the matrices
    balances = residuals(replace(model, functions=()), moments, mean.tolist())
    unknown = scene.absorber is not None and outline.bias is None
    left_out = bool(model.pairs) and acts(modes) and not one.without
    return build_response(
        scene,
        METHOD,
        coordinates=coordinates,
        impact_pairs=pairs,
        assumptions=[
            *outline.rests_on,
            *_assumptions(model),
            *([ASSUMPTION] if one.without else []),
            *_on_accelerations(model, accelerations),
        ],
        cost=Cost(wall_time=time.perf_counter() - outline.started),
        warnings=[
            *warned,
            *_warnings(one.gaps, one.candidates),
            *([LEFT_OUT] if left_out else []),
            *([loose_mass.NOT_IN_ATLAS] if unknown else []),
        ],
        identities={
            name: Estimate(value=float(value), how=outline.how) for name, value in balances.items()
        },
    )


def _accelerations(model: Model, one: _Solution) -> Sequence[float | None]:
    """Mean squares of the absolute accelerations of all outputs, contacts of compliant stops by
    their linear substitutes; None where they are not known."""
    rigid = [all(stop.rigid for stop in pair.stops) for pair in model.pairs]
    mixed = any(
        not own and any(stop.rigid for stop in pair.stops)
        for own, pair in zip(rigid, model.pairs, strict=True)
    )
    if mixed or not model.base_alone_moves:
        return [None] * len(model.outputs)
    modes = model.modal
    stiffness, damping = np.diag(modes.squares), modes.damping.copy()
    for gap, candidate, row, hard in zip(one.gaps, one.candidates, modes.gaps, rigid, strict=True):
        if not hard:
            substitute = gap.substitute(candidate)
            stiffness = stiffness + substitute.spring * np.outer(row, row)
            damping += substitute.damper * np.outer(row, row)
    pulls = model.output_rows @ modes.shapes @ np.hstack([stiffness, damping])
    return [one.law.variances(pull, 0) for pull in pulls]


def _on_accelerations(model: Model, found: Sequence[float | None]) -> list[str]:
    """A sentence on the part of the contact forces that the accelerations of an answer contain."""
    if None in found or not model.pairs:
        return []
    rigid = any(stop.rigid for stop in model.stops)
    soft = not all(stop.rigid for stop in model.stops)
    words = "acceleration_std holds contact forces by the spring and damper in their place"
    return [*([words] if soft else []), *([BETWEEN_IMPACTS] if rigid else [])]


def _unlike_one_mode(
    modes: ModalForm, law: LinearLaw, row: Vector, gap: _PairGap, candidate: Candidate,
    duration: float,
) -> float:  # fmt: skip
    """How far the gap moves within a contact, without its stops, beside the one oscillator of its
    closure; over the way of a free mass at the mean impact speed.

    A push moves the gap by all modes. At a touch these have the mean that position and speed of the
    gap give them, and scatter about it. It is 0 for a single mode.
    """
    n, omega = modes.size, gap.gap.omega
    if n == 1:
        return 0.0
    flow = np.zeros((2 * n, 2 * n))
    flow[:n, n:], flow[n:, :n], flow[n:, n:] = np.eye(n), -np.diag(modes.squares), -modes.damping
    seen = np.zeros((2, 2 * n))
    seen[0, :n], seen[1, n:] = row, row
    moved = seen[0] @ scipy.linalg.expm(flow * duration)
    covariance = law.covariance[: 2 * n, : 2 * n]  # without the states of signals
    given = covariance @ seen.T @ np.linalg.pinv(seen @ covariance @ seen.T)
    left = covariance - given @ seen @ covariance
    speed = math.sqrt(math.pi / 2.0 * candidate.velocity_mean_square)
    by_push = moved[n:] @ row / (row @ row)
    alone = math.cos(omega * duration), float(np.sinc(omega * duration / math.pi)) * duration
    unlike = moved @ given - np.array(alone)
    farthest = max(abs(stop.position - candidate.mean) for stop in gap.pair.stops)
    way = abs(unlike[0]) * farthest + abs(unlike[1]) * speed
    way += abs(by_push - alone[1]) * speed + math.sqrt(max(float(moved @ left @ moved), 0.0))
    return float(way / (speed * duration))


def _assumptions(model: Model) -> list[str]:
    laws = [stop.law for stop in model.stops]
    if not laws:
        return []
    found = [
        "every gap has the density C exp(lambda y - kappa y^2 / 2) between its stops; its speed "
        "is Gaussian and independent of it",
        "impact speeds are Rayleigh distributed, mean square 2 E y'^2",
    ]
    if not all(law.rigid for law in laws):
        found.append("within a compliant stop the density falls off with the energy there")
    if not all(law.rigid or law.conservative for law in laws):
        found.append("a contact of a viscoelastic stop loses what that of a free mass does")
    return found


def _several(found: Sequence[_Solution]) -> list[str]:
    if len(found) == 1:
        return []
    gap = found[0].gaps[0].pair.name
    deviations = ", ".join(f"{math.sqrt(one.candidates[0].variance):.4g}" for one in found)
    return [
        f"this form has {len(found)} solutions, in which the gap of {gap} has the deviations "
        f"{deviations} m: which one is seen depends on how the motion began (linearise_all gives "
        "all that were found)"
    ]


def _energies(modes: ModalForm, law: LinearLaw) -> dict[tuple[str, str], float]:
    """Averages E v'M v, E (q - E q)'K (q - E q) and E v'C v."""
    n = modes.size
    displacement, velocity = (
        law.covariance[part, part]
        + sum(np.real(np.outer(wave[part], wave[part].conj())) / 2.0 for wave in law.waves)
        for part in (slice(0, n), slice(n, 2 * n))
    )
    return {
        ("", "kinetic"): float(np.trace(velocity)),
        ("", "potential"): float(modes.squares @ np.diag(displacement)),
        ("", "dissipation"): float(np.sum(modes.damping * velocity)),
    }


def _warnings(gaps: Sequence[_PairGap], candidates: Sequence[Candidate]) -> list[str]:
    return [
        f"the gap of {gap.pair.name} lies closer to a stop than a density "
        f"C exp(lambda y - kappa y^2 / 2) allows: raised {candidate.rise:.3g}-fold at the stop"
        for gap, candidate in zip(gaps, candidates, strict=True)
        if candidate.rise > 1.0
    ]


# ------------------------------------------------------------------------------
# Statistical linearisation of springs and dampers that are functions, and of hysteresis.
# ------------------------------------------------------------------------------


HOW = "linearisation of functions, Gaussian motion"

FUNCTION_ASSUMPTION = (
    "each spring or damper that is a function has the affine force of the least mean square error "
    "under a Gaussian motion"
)

SECOND_ORDER = (
    "means and mean squares under pulses are those under white noise of equal mean and intensity; "
    "the motion is not Gaussian"
)

EXACT = "exact: linear, moments of the second order"

WEN = "the memory of a spring with hysteresis is Gaussian, and linearised by Wen's coefficients"

SETTLED = 1e-10
"""Relative change of deviations at which an iteration ends."""

ROUNDS = 6
"""Number of linearisations between stops, after those under a rough law: each halves what is left,
which falls below 1e-3 of a deviation."""

FULL = 0.999
"""Largest mean of abs(z)^exponent that an iteration with hysteresis takes, below its limit 1."""

MOST_ROUNDS = 2000
"""Largest number of rounds of the iteration with hysteresis."""


def linearised_functions(scene: Scene, deadline: Deadline = NEVER) -> tuple[Response, ...]:
    """Approximate stationary responses of a structure with springs or dampers that are functions.

    Raises
    ------
    NotApplicable, NotConverged
        With every condition that the scene does not meet; if no linear structure is its own
        linearisation.
    """
    started = time.perf_counter()
    model = model_of(scene)
    drawn = [part.drawn for part in model.functions]
    if not model.pairs and all(each is not None and each.white for each in drawn):
        white = model.with_noise_of_drives
        return closure_of(scene, white, started, deadline, (SECOND_ORDER,), EXACT)
    conditions = [
        *functions_of_arrays(model), *speed_restitutions(model), *modulated(model),
        *not_gaussian(model), *_late(model),
        *without_noise(model, with_sines=not model.remembers),
    ]  # fmt: skip
    if model.remembers and not modulated(model):
        conditions += _beyond_hysteresis(model)
    if conditions:
        raise NotApplicable("linearise", conditions)
    if model.remembers:
        return (_with_hysteresis(scene, model, started),)

    def law_of(linear: Model) -> LinearLaw | None:
        try:
            return solutions(linear, deadline)[0].law
        except NotApplicable:
            return None

    if model.pairs:  # a closure of stops takes long: the iteration starts from a rough law
        linear, motions = with_linear_part(model, "linearise"), None
        for _ in range(ROUNDS):
            found = motions_of(linear, solutions(linear, deadline)[0].law)
            pairs = zip(motions or found, found, strict=True)
            motions = [between(*each) for each in pairs]
            linear = with_forms(model, motions)
    else:
        linear = with_linear_part(model, "linearise", law_of, SETTLED)
    return closure_of(scene, linear, started, deadline, (FUNCTION_ASSUMPTION,))


def _late(model: Model) -> list[str]:
    """A sentence for each drive that does not follow the velocity alone."""
    return [
        f"structure.damper must switch by the velocity, got a {part.law.kind} that is late or "
        f"reverses ({part.name})"
        for part in model.functions
        if part.law.drives and part.law.needs == "both"
    ]


def _beyond_hysteresis(model: Model) -> list[str]:
    """What a linearisation with hysteresis does not cover."""
    found = []
    if model.pairs:
        found.append("impact_pair must be left out where a spring has hysteresis, got one")
    if model.tables or model.sines:
        got = "a tabulated density" if model.tables else "a sine"
        found.append(
            f"excitation must be white, filtered or constant where a spring has hysteresis, got "
            f"{got}"
        )
    return found


def _with_hysteresis(scene: Scene, model: Model, started: float) -> Response:
    """The response with each memory z, z' = C v + D z by Wen's coefficients, as the force of a
    branch that relaxes: that of a spring F C behind a damper, of the time -1 / D."""
    ropes = tuple(part for part in model.functions if part.law.remembers)
    rest = replace(model, functions=tuple(p for p in model.functions if not p.law.remembers))
    motions = [Motion(0.0, 1e-3, 1e-3)] * len(rest.functions)
    coefficients = [(1.0 / _law(part).yield_displacement, -1.0) for part in ropes]
    before = np.zeros(2 * len(model.coordinates))
    for _ in range(MOST_ROUNDS):
        linear = _with_memories(with_forms(rest, motions), ropes, coefficients)
        modes, law = linear.modal, linear_law(linear.modal)
        if law is None:
            raise NotApplicable(
                "linearise",
                "every mode must lose energy and be held by a spring beside that with hysteresis, "
                "got one that drifts; add stiffness",
            )
        found = [law.variances(row, first) for first in (0, modes.size) for row in modes.shapes]
        spread = np.sqrt(np.maximum(found, 0.0))
        if np.allclose(spread, before, rtol=SETTLED, atol=0.0):
            return _response_with_functions(scene, linear, law, started)
        before = spread
        motions = [
            _halfway(*each) for each in zip(motions, motions_of(linear, law), strict=True)
        ]  # fmt: skip
        coefficients = [
            _coefficients(part, number, linear.modal, law, old)
            for number, (part, old) in enumerate(zip(ropes, coefficients, strict=True))
        ]
    raise NotConverged(
        "linearise did not converge: no linear structure is its own linearisation; simulate this "
        "scene"
    )


def _law(part: FunctionOfMotion) -> BoucWen:
    assert isinstance(part.law, BoucWen)
    return part.law


def _with_memories(
    model: Model, ropes: Sequence[FunctionOfMotion], coefficients: Sequence[tuple[float, float]]
) -> Model:
    branches = [
        Branch(part.name, part.count * _law(part).largest_force * with_v, -1.0 / with_z,
               part.direction)
        for part, (with_v, with_z) in zip(ropes, coefficients, strict=True)
    ]  # fmt: skip
    return replace(model, branches=tuple(branches), rates=None)


def _halfway(one: Motion, other: Motion) -> Motion:
    return Motion(*(0.5 * (a + b) for a, b in zip(one, other, strict=True)))


def _coefficients(
    part: FunctionOfMotion, number: int, modes: ModalForm, law: LinearLaw, old: tuple[float, float]
) -> tuple[float, float]:
    """Wen's coefficients under a law in which the memory has a number, half way from the old
    ones."""
    n, row, rope = modes.size, part.direction @ modes.shapes, _law(part)
    force, memory = part.count * rope.largest_force, 2 * n + number
    speed = math.sqrt(law.variances(row, n))
    deviation = math.sqrt(float(law.covariance[memory, memory])) / force
    mixed = float(row @ law.covariance[n : 2 * n, memory]) / force / (speed * deviation)
    # a memory stays below 1; a start that is too wide would make C negative
    deviation = min(deviation, FULL ** (1.0 / rope.exponent) * rope.widest_memory)
    new = rope.wen_coefficients(speed, deviation, min(max(mixed, -1.0), 1.0))
    return 0.5 * (old[0] + new[0]), 0.5 * (old[1] + new[1])


def _response_with_functions(
    scene: Scene, model: Model, law: LinearLaw, started: float
) -> Response:
    modes = model.modal
    accelerations: Sequence[float | None] = [None] * len(model.outputs)
    if model.base_alone_moves:
        accelerations = absolute_accelerations(modes, law, model.output_rows).tolist()
    coordinates = {
        name: coordinate_of(
            lambda _, value: Estimate(value=value, bias=None, how=HOW),
            float(row @ (modes.rest + law.mean)), law.variances(row, 0),
            law.variances(row, modes.size), acceleration,
        )
        for name, row, acceleration in zip(
            model.outputs, model.output_rows @ modes.shapes, accelerations, strict=True
        )
    }  # fmt: skip
    return build_response(
        scene, METHOD, coordinates=coordinates, impact_pairs={},
        assumptions=[FUNCTION_ASSUMPTION, WEN], cost=Cost(wall_time=time.perf_counter() - started),
        warnings=[], identities={},
    )  # fmt: skip
