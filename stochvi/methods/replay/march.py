"""Replay by power series. Chapters: the march of a model through sampled forces; drawn excitations
beside a record."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from stochvi.engine.calls import FIRST_DRAW, MOST_DRAWS, changes_of, functions_of, row_of_numbers
from stochvi.mathematics.numerics import Matrix, Vector
from stochvi.methods.replay import kernel
from stochvi.model.model import FunctionOfMotion, Model, Pair, Stop
from stochvi.results.deadline import NEVER, Deadline
from stochvi.results.errors import NotConverged
from stochvi.scenes.excitations import BASE
from stochvi.scenes.impact_laws import CompliantLaw
from stochvi.scenes.scene import Scene

KINDS = {
    "rigid": kernel.RIGID,
    "pieces": kernel.PIECES,
    "damped": kernel.DAMPED,
    "hertz": kernel.HERTZ,
}
"""Kinds of stops of the kernel, by the forms of impact laws."""

REST_ANGLE = 1e-6
"""A mass rests on a rigid stop once its chatter would end within this angle of the fastest motion
of the structure, rad. The chatter would still move it by 1e-12 of a displacement."""

MOST_IMPACTS = 10_000_000
"""Number of impacts at which a march is given up; their log takes 320 MB."""


STEPS_AT_ONCE, MOST_STEPS = 20_000, 1e10
"""Number of steps of one call of the kernel, between which the clock is looked at and Ctrl-C is
heard; and that from which on a march is not begun: it takes hours."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SampledExcitation:
    """The excitation of a structure, sampled evenly and linear between samples.

    Parameters
    ----------
    step
        Sampling interval, s.
    forces
        Forces on the coordinates (samples, coordinates), N, without constant loads. A base that
        accelerates with a brings -a times the masses.
    base
        Accelerations of the base (samples, axes), m/s^2, or (samples,) along its only axis; zeros
        where nothing moves it.
    """

    step: float
    forces: Matrix
    base: Vector | Matrix

    def refined(self, parts: int) -> SampledExcitation:
        """The same excitation with so many samples in the place of each."""
        coarse = np.arange(len(self.base), dtype=float)
        fine = np.arange((len(coarse) - 1) * parts + 1) / parts

        def between(columns: Matrix) -> Matrix:
            found = [np.interp(fine, coarse, each) for each in columns.T]
            return np.stack(found, axis=1) if found else np.empty((len(fine), 0))

        base = self.base.reshape(len(coarse), -1)
        return SampledExcitation(
            step=self.step / parts, forces=between(self.forces), base=between(base)
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Motion:
    """The motion of a structure from rest (SI units).

    Parameters
    ----------
    samples, duration
        Number of samples and their time, s.
    displacement, velocity, acceleration
        Motion at the samples (samples, coordinates), with absolute accelerations; empty unless
        kept.
    force
        Forces of the stops (samples, stops), N; empty unless kept.
    powers
        Sums over the samples of the displacements to the powers 1 to 4 (coordinates, 4).
    highest, lowest, largest_acceleration
        Largest and smallest displacement (m) and largest absolute acceleration (m/s^2) of each
        coordinate, between samples too.
    impacts
        (impacts, 4): time, number of the stop, speed, largest force of the contact (N; 0 for a
        rigid stop).
    contact_time, rests
        Seconds in which each stop pushes, and number of times that a mass came to rest on it (rigid
        stops).
    lost
        Energy that each compliant stop takes, J. That of rigid stops follows from the speeds of
        impacts.
    """

    samples: int
    duration: float
    displacement: Matrix
    velocity: Matrix
    acceleration: Matrix
    force: Matrix
    powers: Matrix
    highest: Vector
    lowest: Vector
    largest_acceleration: Vector
    impacts: Matrix
    contact_time: Vector
    rests: Vector
    lost: Vector


def integrate(
    model: Model, shaking: SampledExcitation, start: Vector, *, keep: bool = True, seed: int = 0,
    deadline: Deadline = NEVER,
) -> Motion:  # fmt: skip
    """Move a model from rest at `start` (m, of the coordinates) through what shakes it.

    Linear motion and contact are integrated by power series to rounding error, for forces that are
    linear between samples; impacts and changes of contact are located as roots of these series.
    Restitutions that scatter are drawn by `seed` and the number of the draw.

    Raises
    ------
    NotConverged
        Where more than `MOST_IMPACTS` impacts were met, where the motion is so fast that more than
        `MOST_STEPS` steps would be taken, or where the deadline passes.
    """
    modes = model.modal
    check_steps(model, shaking)
    forces = (shaking.forces + model.constant_force) @ modes.shapes
    stops = _stops(model)
    base = shaking.base.reshape(len(shaking.base), -1)
    tick = REST_ANGLE / (modes.fastest or 1.0 / shaking.step)
    samples = kernel.Samples(
        shaking.step, np.ascontiguousarray(forces),
        np.ascontiguousarray(base @ model.base_rows.T @ model.output_rows.T),
    )  # fmt: skip
    structure = kernel.Structure(
        modes.squares.astype(float), np.ascontiguousarray(modes.damping),
        np.ascontiguousarray(model.output_rows @ modes.shapes),
    )  # fmt: skip
    limits = kernel.Limits(tick, MOST_IMPACTS, STEPS_AT_ONCE)
    # displacements = shapes q with shapes' M shapes = 1
    moving = kernel.Moving(modes.shapes.T @ model.mass @ start, np.zeros(modes.size))
    touch, course = _at_start(stops, len(structure.shapes), len(forces) if keep else 0, seed)
    while True:
        status = kernel.march(samples, structure, stops, limits, moving, touch, course)
        if status not in (kernel.PAUSED, kernel.FULL):
            break
        if status == kernel.FULL:
            course = course._replace(log=np.concatenate([course.log, np.empty_like(course.log)]))
        if deadline.passed():
            done = shaking.step * course.counts[kernel.SAMPLE]
            raise deadline.fell_short(
                f"at {done:.3g} s of a record of {shaking.step * (len(forces) - 1):.3g} s",
                "raise budget",
            )
    if status == kernel.TOO_MANY:
        raise NotConverged(
            f"the replay has more than {MOST_IMPACTS} impacts, the largest number that is counted; "
            "give a larger clearance or a smaller restitution"
        )
    masses = np.array([pair.mass for pair in model.pairs for _ in pair.stops])
    log = course.log[: course.counts[kernel.LOGGED]].copy()
    log[:, kernel.PEAK] *= masses[log[:, kernel.STOP].astype(int)] if len(log) else 1.0
    return Motion(
        samples=len(forces),
        duration=shaking.step * (len(forces) - 1),
        displacement=course.x,
        velocity=course.v,
        acceleration=course.a,
        force=course.push * masses,
        powers=course.powers,
        highest=course.extremes[:, kernel.HIGHEST],
        lowest=course.extremes[:, kernel.LOWEST],
        largest_acceleration=course.extremes[:, kernel.ACCELERATION],
        impacts=log,
        contact_time=touch.tally[:, kernel.CONTACT],
        rests=touch.tally[:, kernel.RESTS],
        lost=masses * touch.tally[:, kernel.LOST],
    )


def check_steps(model: Model, shaking: SampledExcitation) -> None:
    """Refuse a march that would never end.

    Raises
    ------
    NotConverged
        Where it would take more than `MOST_STEPS` steps.
    """
    modes = model.modal
    rates = np.sqrt(np.maximum(modes.squares, 0.0)) + np.abs(modes.damping).sum(axis=1)
    rate = float(rates.max(initial=0.0))
    steps = rate * shaking.step * (len(shaking.base) - 1) / kernel.ANGLE
    if not steps <= MOST_STEPS:
        raise NotConverged(
            f"the structure must move slowly enough to be followed in {MOST_STEPS:.0g} steps, got "
            f"{steps:.3g} steps for motion at {rate:.3g} rad/s; give a lower frequency or damping, "
            "or a shorter record"
        )


def _at_start(
    stops: kernel.Stops, coordinates: int, kept: int, seed: int
) -> tuple[kernel.Touch, kernel.Course]:
    """How stops are touched before the start, and what is found up to there: nothing."""
    m, c = len(stops.sides), coordinates
    touch = kernel.Touch(
        state=np.full(m, kernel.FREE, np.int64), zeros=np.zeros((m, 2), np.int64),
        depth=np.zeros(m), entry=np.full(m, -1, np.int64), speed=np.zeros(m),
        tally=np.zeros((m, 3)), draws=np.array([seed, 0], np.uint64),
    )  # fmt: skip
    course = kernel.Course(
        counts=np.zeros(5, np.int64), passed=np.zeros(1), x=np.zeros((kept, c)),
        v=np.zeros((kept, c)), a=np.zeros((kept, c)), push=np.zeros((kept, m)),
        powers=np.zeros((c, 4)), extremes=np.zeros((c, 3)), log=np.empty((64, 4)),
    )  # fmt: skip
    return touch, course


@dataclass(frozen=True, eq=False)
class ExactReplay:
    """The motion of a model by power series, exact but for rounding."""

    model: Model
    keep: bool
    deadline: Deadline = NEVER
    runs = (1,)

    def move(self, shaking: SampledExcitation, seed: int, parts: int = 1) -> Motion:
        """The motion from rest under the constant loads."""
        return integrate(
            self.model, shaking, rest_of(self.model), keep=self.keep, seed=seed,
            deadline=self.deadline,
        )  # fmt: skip


def rest_of(model: Model) -> Vector:
    """Displacements (m) at which the structure is at rest under its constant loads. A single
    coordinate rests on a stop that is in its way."""
    rest = model.modal.shapes @ model.modal.rest
    if len(model.coordinates) > 1 or not model.pairs:
        return rest
    for stop in model.stops:
        if stop.deflection(rest[0]) <= 0.0:
            continue
        if stop.rigid:
            return np.array([stop.position])
        return np.array([_pressed(model, stop, float(rest[0]))])
    return rest


def _pressed(model: Model, stop: Stop, rest: float) -> float:
    """Displacement at which spring, load and a compliant stop balance, m."""
    law, stiffness = stop.law, float(model.stiffness[0, 0])
    assert isinstance(law, CompliantLaw)

    def unbalance(x: float) -> float:
        push = float(law.force_at(stop.deflection(x)))
        return stiffness * x - float(model.constant_force[0]) + stop.side * push

    return float(scipy.optimize.brentq(unbalance, stop.position, rest, xtol=1e-15))


def _stops(model: Model) -> kernel.Stops:
    """The stops of all pairs as the kernel reads them."""
    gaps = model.modal.gaps
    found: list[tuple[Pair, int, int]] = [
        (pair, number, side)
        for number, pair in enumerate(model.pairs)
        for side in range(len(pair.stops))
    ]
    unit = [pair.stops[side].law.per_unit_mass(pair.mass) for pair, _, side in found]
    forms = [law.form() for law in unit]
    # of these the restitution of each impact is asked; the number stands for it at rest
    stops = [pair.stops[side] for pair, _, side in found]
    asked = np.array([stop.rigid and stop.coefficient is None for stop in stops], dtype=np.bool_)
    numbers = [
        (KINDS[form.name], form.numbers)
        if form is not None
        else (kernel.RIGID, np.array([[law.restitution]]))
        if own
        else (kernel.FUNCTION, np.zeros((1, 1)))
        for law, form, own in zip(unit, forms, asked, strict=True)
    ]
    rows = max([len(each) for _, each in numbers], default=1)
    laws = np.zeros((len(found), rows, 3))
    laws[:, :, 0] = math.inf
    for row, (_, each) in zip(laws, numbers, strict=True):
        row[: len(each), : each.shape[1]] = each
    # laws without a form of their own are functions, or have a restitution that varies
    own = {s: law.compiled() for s, law in enumerate(unit) if forms[s] is None}
    width = max([len(row_of_numbers(law)) for law in own.values()], default=1)
    called = functions_of(list(own.values()))
    functions = np.zeros((len(found), called.shape[1]), called.dtype)
    functions[list(own)] = called
    table = np.zeros((len(found), width))
    for s, law in own.items():
        table[s, : len(row_of_numbers(law))] = row_of_numbers(law)
    directions = np.array([gaps[number] for _, number, _ in found]).reshape(-1, gaps.shape[1])
    return kernel.Stops(
        gaps=directions,
        levers=np.sum(directions**2, axis=1),
        sides=np.array([stop.side for stop in stops], dtype=float),
        places=np.array([stop.position for stop in stops], dtype=float),
        kinds=np.array([kind for kind, _ in numbers], dtype=np.int64),
        laws=laws,
        functions=functions,
        numbers=table,
        asked=asked,
    )


# ------------------------------------------------------------------------------
# Excitations whose values are drawn, beside a record: one realisation of them.
#
# A drive changes the momentum of what it acts on by p within a sampling interval h of the record.
# The force p / h at the sample, linear to 0 at both neighbours, has the same momentum. So an
# impulse lasts two intervals, and a force of one's own is linear between samples, as the record is.
# ------------------------------------------------------------------------------


def with_drives(
    scene: Scene, model: Model, segments: Sequence[SampledExcitation], seed: int
) -> list[SampledExcitation]:
    """The segments of a record with the forces of all drives; each segment has its own seed."""
    return [
        _with_forces(scene, model, each, np.uint64(seed + number))
        for number, each in enumerate(segments)
    ]


def _with_forces(
    scene: Scene, model: Model, segment: SampledExcitation, word: np.uint64
) -> SampledExcitation:
    forces, base = segment.forces.copy(), segment.base.copy()
    for number, part in enumerate(model.drives):
        assert part.drawn is not None
        values = _values(part, word, FIRST_DRAW + MOST_DRAWS * number, segment)
        forces += np.outer(values, part.direction)
        if scene.place(part.drawn) == BASE:  # type: ignore[arg-type]
            base[:, list(model.base).index(part.drawn.axis or "")] += values
    return SampledExcitation(step=segment.step, forces=forces, base=base)


def _values(
    part: FunctionOfMotion, word: np.uint64, event: int, segment: SampledExcitation
) -> np.ndarray:
    """Values of a drive at the samples, N, or m/s^2 of the base."""
    changes = np.empty(len(segment.forces))
    changes_of(part.law.compiled(part.mass), word, event, segment.step, changes)
    return part.mass / segment.step * changes
