"""Statistical linearisation of springs and dampers that are functions, and of hysteresis."""

from __future__ import annotations

import math
import time

import numpy as np

from stochvi.mathematics.arrays import Matrix, Vector
from stochvi.mathematics.state_space import stationary_covariance
from stochvi.methods.linearisation.structure_closure import closure_of, solutions
from stochvi.model.build_response import build_response
from stochvi.model.coverage import (
    functions_of_arrays,
    modulated,
    not_gaussian,
    speed_restitutions,
    without_noise,
)
from stochvi.model.linear_part import (
    Motion,
    between,
    form_of,
    motions_of,
    with_forms,
    with_linear_part,
)
from stochvi.model.modal import LinearLaw
from stochvi.model.model import FunctionOfMotion, Model, model_of
from stochvi.results.deadline import NEVER, Deadline
from stochvi.results.errors import NotApplicable, NotConverged
from stochvi.results.estimates import Cost, Estimate
from stochvi.results.response import CoordinateResponse, Response
from stochvi.scenes.characteristics import BoucWen
from stochvi.scenes.scene import Scene

METHOD = "linearise:closure"

HOW = "linearisation of functions, Gaussian motion"

ASSUMPTION = (
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
    return closure_of(scene, linear, started, deadline, (ASSUMPTION,))


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
    """The response with the memories z as further states, z' = C v + D z by Wen's coefficients."""
    plain = tuple(part for part in model.functions if not part.law.remembers)
    ropes = tuple(part for part in model.functions if part.law.remembers)
    modes, n = model.modal, model.modal.size
    rows = [np.array([part.direction @ modes.shapes for part in each]) for each in (plain, ropes)]
    motions = [Motion(0.0, 1e-3, 1e-3)] * len(plain)
    coefficients = [(1.0 / _law(part).yield_displacement, -1.0) for part in ropes]
    rest = modes.rest
    before = np.zeros(2 * n)
    size = np.ones(2 * n + len(modes.signals) + len(ropes))
    for _ in range(MOST_ROUNDS):
        generator, rest = _generator(model, plain, ropes, rows, motions, coefficients)
        fading = [*modes.fading, *range(len(size) - len(ropes), len(size))]
        inner = np.ix_(fading, fading)
        noise = np.zeros_like(generator)
        known = len(size) - len(ropes)
        noise[:known, :known] = modes.noise(modes.white)
        scaled = generator * size / size[:, None]
        if np.linalg.eigvals(scaled[inner]).real.max() >= 0.0:
            raise NotApplicable(
                "linearise",
                ["every mode must lose energy and be held by a spring beside that with hysteresis, "
                 "got one that drifts; add stiffness"],
            )  # fmt: skip
        covariance = np.zeros_like(generator)
        covariance[inner] = stationary_covariance(
            scaled[inner], noise[inner] / np.outer(size, size)[inner]
        )
        covariance *= np.outer(size, size)
        spread = np.sqrt(np.maximum(np.diag(covariance), 0.0))
        if np.allclose(spread[: 2 * n], before, rtol=SETTLED, atol=0.0):
            return _response(scene, model, covariance, generator, rest, started)
        before = spread[: 2 * n]
        size = np.where(spread > 0.0, spread, 1.0)
        motions = [
            _halfway(old, Motion(float(row @ rest), _spread(row, covariance, 0),
                                 _spread(row, covariance, n)))
            for old, row in zip(motions, rows[0], strict=True)
        ]  # fmt: skip
        coefficients = [
            _coefficients(part, row, covariance, n, known + k, old)
            for k, (part, row, old) in enumerate(zip(ropes, rows[1], coefficients, strict=True))
        ]
    raise NotConverged(
        "linearise did not converge: no linear structure is its own linearisation; simulate this "
        "scene"
    )


def _law(part: FunctionOfMotion) -> BoucWen:
    assert isinstance(part.law, BoucWen)
    return part.law


def _generator(
    model: Model, plain: tuple[FunctionOfMotion, ...], ropes: tuple[FunctionOfMotion, ...],
    rows: list[Matrix], motions: list[Motion], coefficients: list[tuple[float, float]],
) -> tuple[Matrix, Vector]:  # fmt: skip
    """Generator of modes, signals and memories, and the modal displacements at rest."""
    modes, n = model.modal, model.modal.size
    stiffness, damping = np.diag(modes.squares), modes.damping.copy()
    load = modes.squares * modes.rest
    for part, row, motion in zip(plain, rows[0], motions, strict=True):
        form = form_of(part, motion)
        stiffness = stiffness + form.stiffness * np.outer(row, row)
        damping += form.damping * np.outer(row, row)
        load = load - (form.force - form.stiffness * motion.mean) * row
    inner = modes.generator(damping, stiffness)
    first = len(inner)
    whole = np.zeros((first + len(ropes), first + len(ropes)))
    whole[:first, :first] = inner
    for k, (part, row, (with_v, with_z)) in enumerate(
        zip(ropes, rows[1], coefficients, strict=True)
    ):
        whole[n : 2 * n, first + k] = -part.count * _law(part).largest_force * row
        whole[first + k, n : 2 * n] = with_v * row
        whole[first + k, first + k] = with_z
    return whole, np.asarray(np.linalg.lstsq(stiffness, load, rcond=None)[0], float)


def _spread(row: Vector, covariance: Matrix, first: int) -> float:
    part = slice(first, first + len(row))
    return math.sqrt(float(row @ covariance[part, part] @ row))


def _halfway(one: Motion, other: Motion) -> Motion:
    return Motion(*(0.5 * (a + b) for a, b in zip(one, other, strict=True)))


def _coefficients(
    part: FunctionOfMotion, row: Vector, covariance: Matrix, n: int, memory: int,
    old: tuple[float, float],
) -> tuple[float, float]:  # fmt: skip
    """Wen's coefficients at a covariance, half way from the old ones."""
    speed = _spread(row, covariance, n)
    deviation = math.sqrt(float(covariance[memory, memory]))
    mixed = float(row @ covariance[n : 2 * n, memory]) / (speed * deviation)
    rope = _law(part)
    # a memory stays below 1; a start that is too wide would make C negative
    deviation = min(deviation, FULL ** (1.0 / rope.exponent) * rope.widest_memory)
    new = rope.wen_coefficients(speed, deviation, min(max(mixed, -1.0), 1.0))
    return 0.5 * (old[0] + new[0]), 0.5 * (old[1] + new[1])


def _response(
    scene: Scene, model: Model, covariance: Matrix, generator: Matrix, rest: Vector, started: float
) -> Response:
    modes, n = model.modal, model.modal.size

    def estimate(value: float) -> Estimate:
        return Estimate(value=value, bias=None, how=HOW)

    coordinates = {}
    for name, row in zip(model.outputs, model.output_rows @ modes.shapes, strict=True):
        mean, variance = float(row @ rest), _spread(row, covariance, 0) ** 2
        square = _spread(row, covariance, n) ** 2
        values = {
            "displacement_mean": mean,
            "displacement_std": math.sqrt(variance),
            "displacement_mean_square": mean**2 + variance,
            "velocity_std": math.sqrt(square),
            "velocity_mean_square": square,
        }
        if model.base_alone_moves:
            # what springs, dampers and memories pull, without the signals that shake the base
            pull = row @ generator[n : 2 * n]
            pull[2 * n : 2 * n + len(modes.signals)] = 0.0
            values["acceleration_std"] = math.sqrt(float(pull @ covariance @ pull))
        coordinates[name] = CoordinateResponse(
            **{key: estimate(value) for key, value in values.items()}
        )
    return build_response(
        scene, METHOD, coordinates=coordinates, impact_pairs={},
        assumptions=[ASSUMPTION, WEN], cost=Cost(wall_time=time.perf_counter() - started),
        warnings=[], identities={},
    )  # fmt: skip
