"""A record through what power series do not follow, in steps of a simulation.

The kernel of `simulate` follows springs and dampers that are functions, and stops that rub. The
exact response to the record stands in the place of noise. The record is linear between its samples,
so that shorter steps are the same excitation. What the step leaves as bias shows at twice the
step.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np
import scipy
from numpy.typing import NDArray

from stochvi.engine.arithmetic import Log
from stochvi.mathematics.numerics import Matrix, Vector
from stochvi.mathematics.spectra import damping_at, transition
from stochvi.methods.replay.kernel import PEAK, SPEED, STOP, TIME
from stochvi.methods.replay.march import STEPS_AT_ONCE, Motion, SampledExcitation, integrate
from stochvi.model.modal import LinearLaw
from stochvi.model.model import Model, Pair, Stop, with_dampers
from stochvi.model.scales import PairScale, fastest_rate, is_positive, motions_of, with_linear_part
from stochvi.motion.choose_plan import ImpactLog, logged_impacts
from stochvi.motion.modal import rate_of_contact
from stochvi.motion.modal_tables import ModalTablesPlan
from stochvi.motion.white import meeting_stops
from stochvi.results.deadline import NEVER, Deadline
from stochvi.results.errors import MOST_RECORDED, NotConverged
from stochvi.scenes.impact_laws import CompliantLaw

STEP_ANGLE = 0.05
"""Longest step of the coarser run times the fastest rate of the structure or of a contact, rad."""

FEWEST_PARTS = 8
"""Smallest number of steps of the coarser run in an interval of the record: a cubic then follows
what the record brings up to a quarter of its sampling rate to 1e-6."""

SETTLING, MOST_SETTLING = 40.0, 2.0**21
"""Time before the record, in relaxation times of the energy, in which constant loads bring a
structure to rest, and its largest number of steps."""

FAINT = 1e-6
"""Smallest deviation of a mode by which linear parts are chosen, in units of the largest one."""

MOST_PLANNED = 2**15
"""Largest number of samples of the record from which linear parts and steps are chosen."""

FEWEST_AT_REST = 4
"""Smallest number of successive steps that end slowly on a rigid stop, for a mass to rest there."""


class SteppedReplay:
    """The motion of a model under samples of what shakes it, in so many steps a sample.

    Parameters
    ----------
    model
        The model.
    shaking
        What shakes it. Its motion without stops gives the linear parts of functions and the step.
    deadline
        The moment at which the exact response to the record is given up.
    """

    def __init__(
        self, model: Model, shaking: SampledExcitation, deadline: Deadline = NEVER
    ) -> None:
        self.deadline = deadline
        rest = tuple(part for part in model.functions if part.drawn is None)
        model = with_dampers(replace(model, functions=rest))

        def law_of(linear: Model) -> LinearLaw:
            return _law_of_record(linear, shaking)

        self.model = _with_linear_part(model, law_of) if rest else model
        self.law = law_of(self.model)
        modes, n = self.model.modal, self.model.modal.size
        self.pairs = tuple(
            PairScale(
                speed=math.sqrt(self.law.variances(gap, n)),
                pressing=_pressing(self.model, pair, gap),
                slope=0.0,
                curvature=0.0,
                deviation=math.sqrt(self.law.variances(gap, 0)),
            )
            for pair, gap in zip(self.model.pairs, modes.gaps, strict=True)
        )
        parts = max(FEWEST_PARTS, math.ceil(shaking.step / self._longest_step))
        self.runs = 2 * parts, parts

    @property
    def _longest_step(self) -> float:
        """Longest step, s, that resolves the structure, its functions and its contacts."""
        damping = float(np.linalg.eigvalsh(self.model.modal.damping)[-1])
        rates = [self.model.modal.fastest, damping]
        for part, motion in zip(
            self.model.functions, motions_of(self.model, self.law), strict=True
        ):
            rates.append(fastest_rate(part, motion))
        for pair, scale in zip(self.model.pairs, self.pairs, strict=True):
            rates += [rate_of_contact(pair, stop, scale) for stop in pair.stops if not stop.rigid]
        fastest = max(rates)
        return STEP_ANGLE / fastest if fastest > 0.0 else math.inf

    def move(self, shaking: SampledExcitation, seed: int, parts: int) -> Motion:
        """The motion from rest under the constant loads, in `parts` steps a sample.

        Raises
        ------
        NotConverged
            Where the steps are too many to be kept.
        """
        samples, step = (len(shaking.forces) - 1) * parts + 1, shaking.step / parts
        settling = self._settling(step)
        plan = ModalTablesPlan(
            model=self.model, law=self.law, pairs=self.pairs, step=step, samples=samples,
            block_length=samples * step, blocks=1, duration=samples * step,
            burn_in=max(1, settling) * step, speed_threshold=0.0,
        )  # fmt: skip
        if (samples + settling) * plan.record_width > MOST_RECORDED:
            raise NotConverged(
                f"the replay takes {samples + settling:.2g} steps of {step:.2g} s, whose motion "
                "does not fit into memory; give a shorter record"
            )
        fine = shaking.refined(parts)
        free = np.zeros((samples + 1 + settling, plan.modes.size, 2))
        free[:samples] = _free_motion(self.model, fine, plan.scale, self.deadline)
        record = np.zeros((samples, 1, plan.record_width))

        def follow(log: Log) -> NDArray[np.float64]:
            return plan.follow(free, log, None, settling, record=record, seed=seed)

        sums, impacts = logged_impacts(follow, [pair.name for pair in self.model.pairs])
        moved = _Moved(self.model, fine, record[:, 0], list(impacts.values()))
        time, lost = (_of_stops(plan, sums[:, :, 0], what) for what in ("contact", "loss"))
        return moved.motion(time, lost, parts)

    def _settling(self, step: float) -> int:
        """Number of steps before the record; none where the linear structure rests as it is."""
        loaded = bool(np.any(self.model.constant_force))
        moves = self.model.functions or any(each.pressing > 0.0 for each in self.pairs)
        time = SETTLING * self.law.slowest if loaded and moves else 0.0
        return math.ceil(min(time / step, MOST_SETTLING))


def _free_motion(
    model: Model, shaking: SampledExcitation, scale: float, deadline: Deadline
) -> NDArray[np.float64]:
    """Modal displacements, and velocities over `scale`, of the linear structure without stops and
    loads (samples, modes, 2).

    The exact motion under forces that are linear between samples; with branches by the exponential
    of their states, s' = A s + B f, f' = g.
    """
    if model.branches:
        return _free_motion_of_branches(model, shaking, scale, deadline)
    free = replace(model, pairs=(), functions=(), constants=(), points={})
    moved = integrate(free, shaking, np.zeros(len(free.coordinates)), deadline=deadline)
    to_modes = model.mass @ model.modal.shapes
    return np.stack([moved.displacement @ to_modes, moved.velocity @ to_modes / scale], axis=2)


def _free_motion_of_branches(
    model: Model, shaking: SampledExcitation, scale: float, deadline: Deadline
) -> NDArray[np.float64]:
    modes, forces, h = model.modal, shaking.forces @ model.modal.shapes, shaking.step
    n, states = modes.size, modes.moving
    driven = np.zeros((states + 2 * n,) * 2)
    driven[:states, :states] = modes.generator(modes.damping, np.diag(modes.squares))[
        :states, :states
    ]
    driven[n : 2 * n, states : states + n] = driven[states : states + n, states + n :] = np.eye(n)
    step = transition(driven, h)[:states]
    slopes = np.diff(forces, axis=0) / h
    pushes = np.hstack([forces[:-1], slopes]) @ step[:, states:].T
    moved, state = np.zeros((len(forces), 2 * n)), np.zeros(states)
    for number, push in enumerate(pushes, 1):
        if number % STEPS_AT_ONCE == 0 and deadline.passed():
            raise deadline.fell_short(
                f"at {h * number:.3g} s of a record of {h * len(pushes):.3g} s", "raise budget"
            )
        state = step[:, :states] @ state + push
        moved[number] = state[: 2 * n]
    return np.stack([moved[:, :n], moved[:, n:] / scale], axis=2)


def _with_linear_part(model: Model, law_of: Callable[[Model], LinearLaw]) -> Model:
    """The model with linear parts of its functions that meet the forces of springs at stops. There
    kicks would change the speed of impacts. Where such a structure is not held, they are the usual
    ones."""
    usual = with_linear_part(model, "replay", law_of)
    meeting = meeting_stops(model, usual)
    return meeting if is_positive(meeting.stiffness) else usual


def _law_of_record(model: Model, shaking: SampledExcitation) -> LinearLaw:
    """Covariances of a linear structure under a record that repeats, in the place of stationary
    ones. Displacements are at most those of a motion between the stops."""
    modes, forces = model.modal, shaking.forces[:MOST_PLANNED]
    n, samples = modes.size, len(forces)
    bins = scipy.fft.rfft(forces @ modes.shapes, axis=0)[1:] / samples
    w = 2.0 * math.pi * scipy.fft.rfftfreq(samples, shaking.step)[1:, None, None]
    damping = damping_at(modes.dynamic, w[:, 0, 0].astype(float))
    stiffness = np.diag(modes.squares) - w**2 * np.eye(n) + 1j * w * damping
    q = np.linalg.solve(stiffness, bins[:, :, None])[:, :, 0]
    width = 1.0
    for pair, gap in zip(model.pairs, modes.gaps, strict=True):
        deviation = math.sqrt(2.0) * float(np.linalg.norm(q @ gap))
        if pair.play is not None and deviation > 0.0:
            width = min(width, pair.play / deviation)
    states = np.hstack([width * q, 1j * w[:, 0] * q])
    if modes.branches is not None:
        turns: Vector = w[:, 0, 0].astype(float)
        stretched = states[:, n:] @ modes.branches.rows.T
        states = np.hstack([states, modes.branches.forces(turns) * stretched])
    covariance = 2.0 * (states.T @ states.conj()).real
    # linear parts divide by deviations, also by that of a mode which nothing shakes
    for part in (slice(0, n), slice(n, 2 * n)):
        own = np.sqrt(np.diag(covariance)[part])
        covariance[part, part] += np.eye(n) * (FAINT * max(float(own.max()), FAINT)) ** 2
    rates = np.linalg.eigvals(modes.flow[: modes.moving, : modes.moving]).real
    slowest = max((-0.5 / rate for rate in rates if rate < 0.0), default=shaking.step)
    return LinearLaw(
        covariance=covariance, waves=(), mean=np.zeros(n),
        decay=np.asarray(np.linalg.eigvalsh(modes.damping)), slowest=slowest,
    )  # fmt: skip


def _pressing(model: Model, pair: Pair, gap: Vector) -> float:
    """Acceleration, m/s^2, with which loads press the mass of a pair onto a stop, or 0."""
    held = model.modal.squares > 0.0
    compliance = float(np.sum(gap[held] ** 2 / model.modal.squares[held]))
    rest = float(gap @ model.modal.rest)
    beyond = max((float(stop.deflection(rest)) for stop in pair.stops), default=0.0)
    return max(beyond, 0.0) / (compliance * pair.mass) if compliance > 0.0 else 0.0


def _of_stops(plan: ModalTablesPlan, sums: Matrix, what: str) -> Vector:
    """Time in contact with each stop, s, or what it takes per reduced mass, from the sums of the
    pairs; 0 for a rigid one."""
    names = plan.sums_of_pair
    return np.array(
        [
            0.0 if stop.rigid else sums[number, names.index(f"{what}_{stop.name}")]
            for number, pair in enumerate(plan.model.pairs)
            for stop in pair.stops
        ]
    )


class _Moved:
    """A motion by steps, and what happens at the stops.

    Parameters
    ----------
    model, shaking
        The model, and what shakes it, a sample for the end of each step.
    record
        (steps, record_width), the states at the ends of all steps.
    logs
        The impacts of each pair, a step late.
    """

    def __init__(
        self, model: Model, shaking: SampledExcitation, record: Matrix, logs: Sequence[ImpactLog]
    ) -> None:
        self.model, self.shaking, self.step = model, shaking, shaking.step
        modes, n = model.modal, model.modal.size
        rows = self.model.output_rows @ modes.shapes
        self.q, self.p, self.rows, self.logs = record[:, :n], record[:, n : 2 * n], rows, logs
        self.x = self.q @ rows.T + rows @ modes.rest
        self.v = self.p @ rows.T
        self.y = (self.q + modes.rest) @ modes.gaps.T
        self.rate = self.p @ modes.gaps.T
        self.stops = [
            (number, pair, stop)
            for number, pair in enumerate(self.model.pairs)
            for stop in pair.stops
        ]
        # a mass whose impacts are slower than what forces bring in a step is at rest
        pressing = (shaking.forces + self.model.constant_force) @ modes.shapes @ modes.gaps.T
        self.slow = self.step * np.abs(pressing).max(axis=0, initial=0.0)

    def motion(self, contact_time: Vector, lost: Vector, parts: int) -> Motion:
        """The motion at every so many ends of steps, the samples of the record; `contact_time` and
        `lost` (stops,) are those of compliant stops, see `_of_stops`."""
        rest = np.array([self._rests_on(*each) for each in self.stops], dtype=np.bool_)
        rest = rest.reshape(-1, len(self.x))
        force = np.array([self._force_of(*each) for each in self.stops]).reshape(-1, len(self.x)).T
        a, impacts = self._accelerations(force), self._impacts(force)
        kept = slice(None, None, parts)
        return Motion(
            samples=len(self.x[kept]), duration=self.step * (len(self.x) - 1),
            displacement=self.x[kept], velocity=self.v[kept], acceleration=a[kept],
            force=force[kept],
            powers=np.stack([np.sum(self.x[kept] ** k, axis=0) for k in range(1, 5)], axis=1),
            highest=self._highest(1.0), lowest=-self._highest(-1.0),
            largest_acceleration=self._largest(a), impacts=impacts,
            contact_time=contact_time + self.step * rest.sum(axis=1),
            rests=np.sum(rest[:, 1:] & ~rest[:, :-1], axis=1) + rest[:, 0].astype(float),
            lost=np.array([pair.mass for _, pair, _ in self.stops]) * lost,
        )  # fmt: skip

    def _rests_on(self, number: int, pair: Pair, stop: Stop) -> NDArray[np.bool_]:
        """Whether the gap of a pair rests on a rigid stop, at the ends of the steps."""
        if not stop.rigid:
            return np.zeros(len(self.x), dtype=np.bool_)
        slow = 2.0 * self.slow[number]
        near = np.abs(self.y[:, number] - stop.position) <= slow * self.step
        still = near & (np.abs(self.rate[:, number]) <= slow)
        return np.asarray(
            scipy.ndimage.binary_opening(still, np.ones(FEWEST_AT_REST, dtype=np.bool_))
        )

    def _force_of(self, number: int, pair: Pair, stop: Stop) -> Vector:
        """Force of a compliant stop, N; not known (nan) of a rigid one."""
        if not isinstance(stop.law, CompliantLaw):
            return np.full(len(self.x), math.nan)
        deflection = stop.deflection(self.y[:, number])
        force = stop.law.force_at(deflection, stop.side * self.rate[:, number], pair.mass)
        return np.where(deflection > 0.0, np.maximum(force, 0.0), 0.0)

    def _impacts(self, force: Matrix) -> Matrix:
        """The impacts as in `Motion`, in their order."""
        found = []
        for which, (number, _, stop) in enumerate(self.stops):
            log = self.logs[number]
            own = stop.side * log.speed > (self.slow[number] if stop.rigid else 0.0)
            time = np.maximum(log.time[own] - self.step, 0.0)
            rows = np.zeros((len(time), 4))
            rows[:, TIME], rows[:, STOP], rows[:, SPEED] = time, which, np.abs(log.speed[own])
            if len(time) and not stop.rigid:
                first = np.minimum((time / self.step).astype(int), len(force) - 1)
                rows[:, PEAK] = np.maximum.reduceat(_tops(force[:, which]), first)
            found.append(rows)
        rows = np.concatenate([np.zeros((0, 4)), *found])
        return rows[np.argsort(rows[:, TIME], kind="stable")]

    @cached_property
    def _struck(self) -> tuple[Vector, NDArray[np.int64]]:
        """Times of all impacts on rigid stops, s, in their order, and the number of their steps."""
        times = [
            self.logs[number].time[stop.side * self.logs[number].speed > 0.0] - self.step
            for number, _, stop in self.stops
            if stop.rigid
        ]
        struck = np.sort(np.concatenate([np.zeros(0), *times]))
        steps = np.floor(struck / self.step).astype(np.int64)
        inside = (steps >= 0) & (steps < len(self.x) - 1)
        return struck[inside], steps[inside]

    @cached_property
    def _smooth(self) -> NDArray[np.bool_]:
        """Whether no rigid stop is hit in each step between two ends."""
        found = np.ones(len(self.x) - 1, dtype=np.bool_)
        found[self._struck[1]] = False
        return found

    def _accelerations(self, force: Matrix) -> Matrix:
        """Absolute accelerations (steps, outputs), m/s^2.

        The motion gives the known forces. What friction, rigid stops and springs with a memory add
        follows from the change of the velocities over the steps beside an end. It is interpolated
        where they jump in both.
        """
        shaking, modes = self.shaking, self.model.modal
        known = shaking.forces @ modes.shapes - self.q * modes.squares - self.p @ modes.damping.T
        for which, (number, _, stop) in enumerate(self.stops):
            if not stop.rigid:
                known -= np.outer(stop.side * force[:, which], modes.gaps[number])
        for part in self.model.functions:
            if not part.law.remembers:
                row = part.direction @ modes.shapes
                own = part.force_left_out((self.q + modes.rest) @ row, self.p @ row)
                known -= np.outer(own, row)
        base = shaking.base @ self.model.base_rows.T @ self.model.output_rows.T
        return np.asarray((known + self._unknown(known)) @ self.rows.T + base)

    def _unknown(self, known: Matrix) -> Matrix:
        """Modal accelerations (steps, modes) beyond the `known` ones."""
        smooth = self._smooth[:, None]
        beyond = np.diff(self.p, axis=0) / self.step - 0.5 * (known[1:] + known[:-1])
        beside, count = np.zeros_like(known), np.zeros(len(known))
        for ends in (slice(None, -1), slice(1, None)):
            beside[ends] += smooth * beyond
            count[ends] += self._smooth
        at = np.flatnonzero(count)
        if not len(at):
            return np.zeros_like(known)
        every = np.arange(len(known))
        means = beside[at] / count[at, None]
        return np.stack([np.interp(every, at, each) for each in means.T], axis=1)

    @cached_property
    def _flights(self) -> list[tuple[NDArray[np.int64], Vector]]:
        """Ends of steps beside impacts on rigid stops, and the times from there to the impacts, s.

        The first ends precede the first impact of a step, and the second ones follow the last, at
        negative times. The motion does not jump in the step on the other side of an end.
        """
        found = []
        struck, steps = self._struck
        for way, beside in ((1, -1), (-1, 1)):
            _, which = np.unique(steps[::way], return_index=True)
            at, time = steps[::way][which], struck[::way][which]
            inside = (at + beside >= 0) & (at + beside < len(self._smooth))
            at, time = at[inside], time[inside]
            calm = self._smooth[at + beside]
            ends = at[calm] + (way < 0)
            found.append((ends, time[calm] - ends * self.step))
        return found

    def _at_impacts(self, values: Matrix) -> Matrix:
        """Values (impacts, outputs) before and after impacts on rigid stops, by the line through
        those at the last two ends of steps."""
        found = [np.zeros((0, values.shape[1]))]
        for (ends, time), before in zip(self._flights, (-1, 1), strict=True):
            slope = (values[ends] - values[ends + before]) / (-before * self.step)
            found.append(values[ends] + time[:, None] * slope)
        return np.concatenate(found)

    def _largest(self, a: Matrix) -> Vector:
        """Largest absolute accelerations of the outputs, m/s^2, also beside impacts."""
        tops = np.stack([_tops(each) for each in np.abs(a).T], axis=1)
        calm = np.ones(len(a), dtype=np.bool_)
        calm[1:] &= self._smooth
        calm[:-1] &= self._smooth
        sampled = np.where(calm[:, None], tops, np.abs(a)).max(axis=0)
        beside = np.abs(self._at_impacts(a)).max(axis=0, initial=0.0)
        return np.asarray(np.maximum(sampled, beside))

    def _highest(self, side: float) -> Vector:
        """Largest side * x of each output, m: at the ends of steps, between them, and at
        impacts."""
        x, v = side * self.x, side * self.v
        turns = (v[:-1] > 0.0) & (v[1:] < 0.0) & self._smooth[:, None]
        rise = 0.5 * self.step * v[:-1] ** 2 / np.where(turns, v[:-1] - v[1:], 1.0)
        between = np.max(x[:-1] + turns * rise, axis=0, initial=-math.inf)
        highest = np.maximum(x.max(axis=0), between)
        for (ends, time), before in zip(self._flights, (-1, 1), strict=True):
            bend = (v[ends] - v[ends + before]) / (-before * self.step)
            t = time[:, None]
            there = x[ends] + t * (v[ends] + 0.5 * t * bend)
            highest = np.maximum(highest, there.max(axis=0, initial=-math.inf))
        return np.asarray(highest)


def _tops(values: Vector) -> Vector:
    """Values with those at local maxima replaced by the tops of the parabolas through three."""
    found = values.copy()
    left, middle, right = values[:-2], values[1:-1], values[2:]
    bend = 2.0 * middle - left - right
    top = (middle >= left) & (middle >= right) & (bend > 0.0) & (np.minimum(left, right) > 0.0)
    found[1:-1] += np.where(top, (right - left) ** 2 / np.where(top, 8.0 * bend, 1.0), 0.0)
    return found
