"""The moment closure for several coordinates and pairs: every gap keeps its own balances.

Each pair's stops are replaced by m_F + k (y - E y) + beta y' on its gap y (B 17.3, 17.38), and the
linear structure that is left is solved exactly. As for one oscillator, the gap has the density
C exp(lambda y - kappa y^2 / 2) between its stops and a Gaussian speed; m_F, k and beta are the mean
force of the stops, its covariance with y over the variance of y, and the power that impacts take
over E y'^2; lambda, kappa and the speed are those with which the linear structure answers. With
them the balances of energy and virial of the whole hold, and of the force on every coordinate.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from stochvi.methods.linearisation import boxes
from stochvi.methods.linearisation.forms import Form, Trial, Unknowns, choose
from stochvi.methods.linearisation.scales import Frame
from stochvi.methods.linearisation.soft_closure import soft_closure
from stochvi.methods.linearisation.solver import NOWHERE, SAME, START_SPEEDS, root
from stochvi.methods.linearisation.told import answer_of
from stochvi.methods.linearisation.trial import soft_stops
from stochvi.model.assembly import Assembly, Contact, assemble, modes_of
from stochvi.model.balances import residuals
from stochvi.model.modal import LinearLaw, ModalForm, Substitute, Vector, linear_law
from stochvi.model.model import model_of
from stochvi.model.responses import Answer
from stochvi.model.scales import PairScale, scales_of
from stochvi.results.errors import NotApplicable, NotConverged
from stochvi.results.estimates import Cost, Estimate, provenance
from stochvi.results.response import Response
from stochvi.scenes.scene import Scene, System

METHOD = "linearise:closure"

MOST_FORMS = 3
"""Forms of a gap that are tried in turn: at most as many as `soft_closure` has."""


class _Gap(NamedTuple):
    """A pair on its own, as a mass that static springs and its stops hold, per unit mass.

    `alone` is in SI units, `system` in those of `frame`. `forms` are to be tried in turn.
    """

    contact: Contact
    alone: System
    frame: Frame
    system: System
    forms: tuple[Form, ...]

    def form(self, stage: int) -> Form:
        """The one to try at a stage, the last one from there on."""
        return self.forms[min(stage, len(self.forms) - 1)]

    def trial(self, unknowns: Unknowns, stage: int) -> Trial:
        """SI units, per unit mass."""
        return self.frame.grow(self.form(stage).trial(self.system, unknowns))

    def substitute(self, trial: Trial) -> Substitute:
        """Spring, centre and damper that stand for the stops of a trial law."""
        away = trial.stop_force / trial.stiffness if trial.stiffness else 0.0
        return Substitute(
            spring=self.contact.mass * trial.stiffness,
            centre=trial.mean - away,
            damper=self.contact.mass * trial.damping,
        )


class _Solution(NamedTuple):
    """The law of every gap, and the linear structure that answers with them."""

    gaps: Sequence[_Gap]
    trials: Sequence[Trial]
    law: LinearLaw


def closure(scene: Scene) -> tuple[Response, ...]:
    """Approximate stationary responses of several coordinates, pairs, or signals.

    White, filtered and tabulated noise, sines and loads; stops of any law. Exact without stops,
    and for one pair that loses nothing where noise matches damping. One loose mass in a box on one
    mode under white noise is linearised at every amplitude instead, see `boxes`.

    White noise has one response. In coloured noise and under sines all are returned that are found
    from starts at several speeds, the one next to the response without stops first.

    Raises
    ------
    NotApplicable, NotConverged
        With every condition that the scene does not meet; if no response was found that is its
        own linearisation.
    """
    started = time.perf_counter()
    assembly = assemble(scene)
    if not np.any(assembly.white) and not assembly.signals and not assembly.tables:
        raise NotApplicable(
            "linearise", ["excitation must contain noise or a sine, got a constant load alone"]
        )
    box = boxes.box_of(assembly)
    if box is not None:
        return (boxes.response(scene, assembly, box, METHOD),)
    modes = modes_of(assembly)
    found = solutions(assembly, modes)
    elastic = len(assembly.contacts) == 1 and assembly.elastic
    exact = not assembly.contacts or (elastic and assembly.temperature is not None)
    told = _Told(scene, assembly, modes, 0.0 if exact else None, started)
    warned = _several(found)
    return tuple(_response(told, one, warned) for one in found)


def solutions(assembly: Assembly, modes: ModalForm) -> list[_Solution]:
    """The laws of all gaps with which the linear structure answers, by Newton's method.

    Raises
    ------
    NotApplicable, NotConverged
        Where there is no stationary response; where no law was found.
    """
    rough = scales_of(assembly, modes, "linearise", giving_way=True)  # type: ignore[arg-type]
    if rough is None:
        raise NotApplicable(
            "linearise",
            ["every mode must be shaken, lose energy, and be held by stiffness or stops"],
        )
    law, scales = rough
    if not assembly.contacts:
        return [_Solution([], [], law)]
    coloured = bool(assembly.signals or assembly.tables)
    free = linear_law(modes) if coloured else None
    for stage in range(MOST_FORMS):
        found: list[_Solution] = []
        for speeds in _starts(modes, scales, free):
            gaps = _gaps(assembly, modes, scales, speeds)
            one = _from(modes, gaps, stage, patient=not found)
            if one is not None and not any(_same(one, other) for other in found):
                found.append(one)
            if found and not coloured:
                break
        if found:
            return sorted(found, key=lambda one: 0.0 if free is None else _apart(modes, one, free))
    raise NotConverged(
        f"{METHOD} found no response that is its own linearisation; simulate this scene."
    )


def _starts(
    modes: ModalForm, scales: Sequence[PairScale], free: LinearLaw | None
) -> Iterator[list[float]]:
    """Speeds of all gaps to start from: those without stops, and multiples of the rough ones."""
    if free is not None:
        yield [math.sqrt(free.variances(row, modes.size)) for row in modes.gaps]
    for factor in START_SPEEDS:
        yield [factor * scale.speed for scale in scales]


def _gaps(
    assembly: Assembly, modes: ModalForm, scales: Sequence[PairScale], speeds: Sequence[float]
) -> list[_Gap]:
    """Every pair on its own, in the frame of its speed."""
    white = len(assembly.coordinates) == 1 and not assembly.signals and not assembly.tables
    gaps = []
    for contact, row, scale, speed in zip(
        assembly.contacts, modes.gaps, scales, speeds, strict=True
    ):
        alone = _alone(contact, scale, contact.mass * float(row @ modes.damping @ row))
        frame = Frame.of(alone, speed)
        system = frame.shrink(alone)
        if soft_stops(system):
            form = soft_closure(system, coloured=not white)
        else:
            form = choose("closure", "consistent", system)
        gaps.append(_Gap(contact, alone, frame, system, (form, *form.others)))
    return gaps


def _alone(contact: Contact, scale: PairScale, damping_rate: float) -> System:
    laws = {side: law.per_unit_mass(contact.mass) for side, _, law in contact.stops}
    rigid = {side: law.restitution for side, _, law in contact.stops if law.rigid}
    return System(
        mass=contact.mass,
        omega=math.sqrt(scale.curvature) * scale.speed,
        damping_rate=damping_rate,
        moving_base=False,
        noise_on_mass=True,
        intensity=0.0,
        tables=(),
        load=scale.slope * scale.speed**2,
        lower=contact.lower,
        upper=contact.upper,
        restitution_lower=rigid.get("lower"),
        restitution_upper=rigid.get("upper"),
        law_lower=laws.get("lower"),
        law_upper=laws.get("upper"),
    )


def _from(modes: ModalForm, gaps: Sequence[_Gap], stage: int, *, patient: bool) -> _Solution | None:
    """The solution near the elastic laws of the gaps, or None."""
    start = np.concatenate([gap.form(stage).start(gap.system) for gap in gaps])
    unknowns = root(lambda found: _imbalance(modes, gaps, stage, found), start, patient=patient)
    if unknowns is None:
        return None
    trials = _trials(gaps, stage, unknowns)
    answer = _linearised(modes, gaps, trials)
    return None if answer is None else _Solution(gaps, trials, answer)


def _same(one: _Solution, two: _Solution) -> bool:
    return all(
        abs(math.log(a.variance / b.variance)) < SAME
        and abs(math.log(a.velocity_mean_square / b.velocity_mean_square)) < SAME
        for a, b in zip(one.trials, two.trials, strict=True)
    )


def _apart(modes: ModalForm, one: _Solution, free: LinearLaw) -> float:
    """Largest difference of the logarithms of the speeds of a gap, with stops and without."""
    squares = [free.variances(row, modes.size) for row in modes.gaps]
    return max(
        abs(math.log(trial.velocity_mean_square / square))
        for trial, square in zip(one.trials, squares, strict=True)
    )


def _trials(gaps: Sequence[_Gap], stage: int, unknowns: Unknowns) -> list[Trial]:
    parts = np.split(unknowns, len(gaps))
    return [gap.trial(part, stage) for gap, part in zip(gaps, parts, strict=True)]


def _linearised(
    modes: ModalForm, gaps: Sequence[_Gap], trials: Sequence[Trial]
) -> LinearLaw | None:
    return linear_law(
        modes, [gap.substitute(trial) for gap, trial in zip(gaps, trials, strict=True)]
    )


def _imbalance(modes: ModalForm, gaps: Sequence[_Gap], stage: int, unknowns: Unknowns) -> Unknowns:
    """Mean, log deviation and log speed of every gap: trial law less linear structure."""
    nowhere = np.full(len(unknowns), NOWHERE)
    try:
        with np.errstate(all="ignore"):
            trials = _trials(gaps, stage, unknowns)
            law = _linearised(modes, gaps, trials)
            if law is None:
                return nowhere
            found = []
            for trial, row in zip(trials, modes.gaps, strict=True):
                mean = float(row @ (modes.rest + law.mean))
                found += [
                    (trial.mean - mean) / math.sqrt(trial.variance),
                    math.log(trial.variance / law.variances(row, 0)) / 2.0,
                    math.log(trial.velocity_mean_square / law.variances(row, modes.size)) / 2.0,
                ]
    except (ValueError, ZeroDivisionError, OverflowError, np.linalg.LinAlgError):
        return nowhere
    return np.where(np.isfinite(found), found, NOWHERE)


class _Told(NamedTuple):
    """What all responses of a scene have in common."""

    scene: Scene
    assembly: Assembly
    modes: ModalForm
    bias: float | None
    started: float

    @property
    def how(self) -> str:
        return "moment closure" if self.assembly.contacts else "exact: linear and Gaussian"

    def estimate(self, value: float) -> Estimate:
        return Estimate(value=value, bias=self.bias, how=self.how)


def _response(told: _Told, one: _Solution, warned: Sequence[str]) -> Response:
    scene, assembly, modes = told.scene, told.assembly, told.modes
    mean: Vector = modes.shapes @ (modes.rest + one.law.mean)
    moments = _energies(modes, one.law)
    coordinates = {}
    for row, name in enumerate(assembly.coordinates):
        variance = one.law.variances(modes.shapes[row], 0)
        square = one.law.variances(modes.shapes[row], modes.size)
        moments |= {(name, "x"): mean[row], (name, "variance"): variance, (name, "vv"): square}
        coordinates[name] = _coordinate(told, float(mean[row]), variance, square)
    pairs: dict[str, dict[str, Estimate | float | None]] = {}
    for gap, trial, row in zip(one.gaps, one.trials, modes.gaps, strict=True):
        answer = answer_of(gap.alone, trial)
        moments |= _of_stops(gap.contact.name, answer)
        pairs[gap.contact.name] = answer.pair(gap.alone, told.how, told.bias)
        if np.count_nonzero(gap.contact.direction) > 1:
            pairs[gap.contact.name] |= {
                "relative_displacement_mean": told.estimate(
                    float(row @ (modes.rest + one.law.mean))
                ),
                "relative_displacement_std": told.estimate(math.sqrt(one.law.variances(row, 0))),
                "relative_velocity_std": told.estimate(
                    math.sqrt(one.law.variances(row, modes.size))
                ),
            }
    balances = residuals(model_of(scene), moments, mean.tolist())
    unknown = scene.absorber is not None and told.bias is None
    return Response(
        method=METHOD,
        coordinates=coordinates,
        impact_pairs=pairs,
        effects=scene.effects(),
        assumptions=[*scene.assumptions(), *_assumptions(assembly)],
        cost=Cost(wall_time=time.perf_counter() - told.started),
        warnings=[
            *warned,
            *_warnings(one.gaps, one.trials),
            *([boxes.NOT_IN_ATLAS] if unknown else []),
        ],
        provenance=provenance(scene.document()),
        identities={
            name: Estimate(value=float(value), how=told.how) for name, value in balances.items()
        },
    )


def _coordinate(
    told: _Told, mean: float, variance: float, square: float
) -> dict[str, Estimate | None]:
    values = {
        "displacement_mean": mean,
        "displacement_std": math.sqrt(variance),
        "displacement_mean_square": mean**2 + variance,
        "velocity_std": math.sqrt(square),
        "velocity_mean_square": square,
    }
    found: dict[str, Estimate | None] = {
        name: told.estimate(value) for name, value in values.items()
    }
    return found | {"acceleration_std": None, "upcrossing_rate": None}


def _of_stops(name: str, answer: Answer) -> dict[tuple[str, str], float]:
    """What the balances ask of the stops of a pair, per unit of its reduced mass."""
    found = {}
    for side, stop, contact in (
        ("lower", answer.lower, answer.contact_lower),
        ("upper", answer.upper, answer.contact_upper),
    ):
        assert stop.speed_rate is not None
        found[name, f"f1_{side}"] = stop.speed_rate
        found[name, f"f2_{side}"] = stop.speed_square_rate
        found[name, f"force_{side}"] = contact.force if contact else 0.0
        found[name, f"loss_{side}"] = contact.power if contact else 0.0
    return found


def _assumptions(assembly: Assembly) -> list[str]:
    laws = [law for contact in assembly.contacts for _, _, law in contact.stops]
    if not laws:
        return []
    found = [
        "every gap has the density C exp(lambda y - kappa y^2 / 2) between its stops; its speed "
        "is Gaussian and independent of it",
        "impact speeds are Rayleigh distributed, mean square 2 E y'^2",
    ]
    if not all(law.rigid for law in laws):
        found.append("within a stop that gives way the density falls off with the energy there")
    if not all(law.rigid or law.conservative for law in laws):
        found.append("a contact of a viscoelastic stop loses what that of a free mass does")
    return found


def _several(found: Sequence[_Solution]) -> list[str]:
    if len(found) == 1:
        return []
    gap = found[0].gaps[0].contact.name
    deviations = ", ".join(f"{math.sqrt(one.trials[0].variance):.4g}" for one in found)
    return [
        f"this form has {len(found)} solutions, in which the gap of {gap} has the deviations "
        f"{deviations} m: which one is seen depends on how the motion began (linearise_all gives "
        "all that were found)"
    ]


def _energies(modes: ModalForm, law: LinearLaw) -> dict[tuple[str, str], float]:
    """E v'M v, E (q - E q)'K (q - E q) and E v'C v."""
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


def _warnings(gaps: Sequence[_Gap], trials: Sequence[Trial]) -> list[str]:
    return [
        f"the gap of {gap.contact.name} leans on a stop more closely than a density "
        f"C exp(lambda y - kappa y^2 / 2) allows: raised {trial.rise:.3g}-fold at the stop"
        for gap, trial in zip(gaps, trials, strict=True)
        if trial.rise > 1.0
    ]
