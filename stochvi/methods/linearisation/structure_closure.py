"""The moment closure for several coordinates and pairs: every gap keeps its own balances.

The stops of each pair are replaced by m_F + k (y - E y) + beta y' on its gap y (B 17.3, 17.38). The
linear structure that remains is solved exactly. As for one oscillator, the gap has the density C
exp(lambda y - kappa y^2 / 2) between its stops and a Gaussian speed. m_F is the mean force of the
stops; k is its covariance with y over the variance of y; beta is the power that impacts take over E
y'^2; lambda, kappa and the speed are those with which the linear structure answers. With them the
balances of energy and virial of the whole hold, and of the force on every coordinate. Under white
noise impacts also scatter energy among the modes, see `scattering`.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np
from scipy.linalg import expm

from stochvi.mathematics.arrays import Vector
from stochvi.methods.linearisation import loose_mass, scattering, structure_bounds
from stochvi.methods.linearisation.candidate import Candidate, Form, Unknowns
from stochvi.methods.linearisation.forms import form_of
from stochvi.methods.linearisation.outputs import answer_of
from stochvi.methods.linearisation.scales import Frame
from stochvi.methods.linearisation.soft_closure import soft_closure
from stochvi.methods.linearisation.solver import INFEASIBLE, SAME, START_SPEEDS, Problem, root
from stochvi.model.balances import residuals
from stochvi.model.build_response import BETWEEN_IMPACTS, StationaryMoments, build_response
from stochvi.model.coverage import unknown_dampers, without_energy, without_noise
from stochvi.model.gap import Gap
from stochvi.model.modal import EquivalentLinear, LinearLaw, ModalForm, linear_law
from stochvi.model.model import Model, Pair, model_of
from stochvi.model.scales import UNSHAKEN, PairScale, scales_of
from stochvi.results.deadline import NEVER, Deadline
from stochvi.results.errors import NotApplicable, NotConverged
from stochvi.results.estimates import Cost, Estimate
from stochvi.results.response import CoordinateResponse, PairResponse, Response
from stochvi.scenes.scene import Scene

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
    return structure_bounds.with_bounds(response, plain, outline.model, one.candidates)


def solutions(model: Model, deadline: Deadline = NEVER) -> list[_Solution]:
    """The laws of all gaps with which the linear structure answers, by Newton's method.

    Raises
    ------
    NotApplicable, NotConverged
        Where there is no stationary response; where no law was found before the deadline.
    """
    modes = model.modal
    rough = scales_of(model, modes, "linearise", compliant=True)
    if rough is None:
        raise NotApplicable(
            "linearise",
            ["every mode must be shaken, lose energy, and be held by stiffness or stops"],
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
            one = _from(modes, gaps, stage, deadline, patient=not found)
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
    modes: ModalForm, gaps: Sequence[_PairGap], stage: int, deadline: Deadline, *, patient: bool
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
    plain = root(problem(False), start, patient=patient)
    if plain is None:
        return None
    found = _solution(gaps, _Trial.of(modes, gaps, stage, plain, scatters=False))
    if not scattering.acts(modes):
        return found
    mixed = root(problem(True), np.concatenate([plain, np.zeros(len(gaps))]), patient=False)
    if mixed is None:
        return found
    return _solution(gaps, _Trial.of(modes, gaps, stage, mixed, scatters=True), found)


def _solution(
    gaps: Sequence[_PairGap], trial: _Trial, without: _Solution | None = None
) -> _Solution | None:
    law = trial.law
    return None if law is None else _Solution(gaps, trial.candidates, trial.modes, law, without)


def _same(one: _Solution, two: _Solution) -> bool:
    return all(
        abs(math.log(a.variance / b.variance)) < SAME
        and abs(math.log(a.velocity_mean_square / b.velocity_mean_square)) < SAME
        for a, b in zip(one.candidates, two.candidates, strict=True)
    )


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
    noises: list[scattering.Scattering]
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
            noise = scattering.scattering(candidate, gap.gap.stops, gap.pair.mass, row, omega)
            share = float(noise.row @ noise.row) / float(row @ row)
            noises.append(noise)
            squares.append(candidate.velocity_mean_square * share * math.exp(2.0 * more))
        shaken = scattering.scattered(modes, noises, squares)
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
        coordinates[name] = _coordinate(outline, place, variance, square, acceleration)
    pairs: dict[str, PairResponse] = {}
    for gap, candidate, row in zip(one.gaps, one.candidates, modes.gaps, strict=True):
        answer, name = answer_of(gap.gap, candidate), gap.pair.name
        moments |= _of_stops(gap.pair, answer)
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
    left_out = bool(model.pairs) and scattering.acts(modes) and not one.without
    return build_response(
        scene,
        METHOD,
        coordinates=coordinates,
        impact_pairs=pairs,
        assumptions=[
            *outline.rests_on,
            *_assumptions(model),
            *([scattering.ASSUMPTION] if one.without else []),
            *_on_accelerations(model, accelerations),
        ],
        cost=Cost(wall_time=time.perf_counter() - outline.started),
        warnings=[
            *warned,
            *_warnings(one.gaps, one.candidates),
            *([scattering.LEFT_OUT] if left_out else []),
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
            damping = damping + substitute.damper * np.outer(row, row)
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


def _coordinate(
    outline: _Outline, mean: float, variance: float, square: float, acceleration: float | None
) -> CoordinateResponse:
    values = {
        "displacement_mean": mean,
        "displacement_std": math.sqrt(variance),
        "displacement_mean_square": mean**2 + variance,
        "velocity_std": math.sqrt(square),
        "velocity_mean_square": square,
    }
    if acceleration is not None:
        values["acceleration_std"] = math.sqrt(acceleration)
    return CoordinateResponse(**{name: outline.estimate(value) for name, value in values.items()})


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
    flow = np.zeros((2 * n, 2 * n))
    flow[:n, n:], flow[n:, :n], flow[n:, n:] = np.eye(n), -np.diag(modes.squares), -modes.damping
    seen = np.zeros((2, 2 * n))
    seen[0, :n], seen[1, n:] = row, row
    moved = seen[0] @ expm(flow * duration)
    given = law.covariance @ seen.T @ np.linalg.inv(seen @ law.covariance @ seen.T)
    left = law.covariance - given @ seen @ law.covariance
    speed = math.sqrt(math.pi / 2.0 * candidate.velocity_mean_square)
    by_push = moved[n:] @ row / (row @ row)
    alone = math.cos(omega * duration), float(np.sinc(omega * duration / math.pi)) * duration
    unlike = moved @ given - np.array(alone)
    farthest = max(abs(stop.position - candidate.mean) for stop in gap.pair.stops)
    way = abs(unlike[0]) * farthest + abs(unlike[1]) * speed
    way += abs(by_push - alone[1]) * speed + math.sqrt(max(float(moved @ left @ moved), 0.0))
    return float(way / (speed * duration))


def _of_stops(pair: Pair, answer: StationaryMoments) -> dict[tuple[str, str], float]:
    """The moments of a pair from which the balances are calculated, per unit of its reduced
    mass."""
    found = {}
    for stop in pair.stops:
        hits, contact = answer.at(stop)
        found[pair.name, f"f1_{stop.name}"] = hits.speed_rate
        found[pair.name, f"f2_{stop.name}"] = hits.speed_square_rate
        if contact is not None:
            found[pair.name, f"force_{stop.name}"] = contact.force
            found[pair.name, f"loss_{stop.name}"] = contact.power
    return found


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
