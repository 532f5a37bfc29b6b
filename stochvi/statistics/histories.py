"""Records of the motion. Chapters: absolute accelerations from forces; one realisation, sample by
sample, with its impacts."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import MISSING, dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from stochvi.mathematics.numerics import ROUNDING, Matrix, Vector
from stochvi.mathematics.spectra import Table
from stochvi.mathematics.units import LENGTH, MILLIRADIANS
from stochvi.model.model import Model, Pair
from stochvi.motion.choose_plan import (
    HistoryPlan,
    ImpactLog,
    logged_impacts,
    plan_histories,
    with_losses,
)
from stochvi.motion.plan import Histories, Plan
from stochvi.motion.white import WhitePlan
from stochvi.results.base import ROTATIONS, DataFrame, Quantities, Result, frame_of, stacked, stated
from stochvi.results.errors import MOST_NUMBERS, NotApplicable
from stochvi.results.estimates import Cost, provenance
from stochvi.sampling.calculations import Random, calculation, check_options
from stochvi.scenes.excitations import BASE
from stochvi.scenes.impact_laws import CompliantLaw
from stochvi.scenes.scene import Scene

# ------------------------------------------------------------------------------
# Absolute accelerations of simulated records, from the forces that act.
#
#     M a = loads - C v - K x - contacts
#
# Impacts on rigid stops are impulses: sudden changes of velocity, which are kept apart.
# ------------------------------------------------------------------------------


Records = NDArray[np.float64]


class Accelerations(NamedTuple):
    """Records of one coordinate or point of a block of paths.

    Parameters
    ----------
    smooth
        (paths, samples): acceleration by springs, dampers and compliant stops, m/s^2.
    jumps
        (paths, samples): sudden changes of velocity by rigid stops, m/s, each at the sample next to
        it; None without rigid stops.
    impacts
        Impacts by pair with the energies that they take, slow ones on compliant stops too; their
        times are those of the samples, which begin at 0.
    forces
        Forces (paths, samples) of each pair with a compliant stop, N, positive on the upper one.
    """

    smooth: Records
    jumps: Records | None
    impacts: Mapping[str, ImpactLog]
    forces: Mapping[str, Records]


def places_shaken(scene: Scene) -> tuple[bool, bool]:
    """Whether something that varies in time acts on the base, and whether on a mass."""
    whole = scene.expanded
    places = [whole.place(each) for each in whole.excitations if each.shakes]
    return BASE in places, any(place != BASE for place in places)


def why_no_acceleration(model: Model, on_base: bool) -> str:
    """Why records hold no acceleration, where they do not."""
    if model.modulations:
        return "the force of a modulation is not kept by the simulation"
    if model.drives:
        return "the force of pulses, or of random numbers, is not kept by the simulation"
    if model.remembers:
        return "the force of a spring with hysteresis is not kept by the simulation"
    if model.whites:
        return "white noise on a mass has no finite acceleration"
    if on_base:
        return "forces on masses and the motion of the base cannot be told apart"
    return "the force of filtered noise on a mass is not kept by the simulation"


def pair_forces(model: Model, x: Records, v: Records) -> dict[str, Records]:
    """Forces of the pairs that have a compliant stop, N, from displacements and velocities
    (coordinates, ...)."""
    return {
        pair.name: pair.force(
            np.tensordot(pair.direction, x, axes=1), np.tensordot(pair.direction, v, axes=1)
        )
        for pair in model.pairs
        if not all(stop.rigid for stop in pair.stops)
    }


def carried_forces(
    model: Model, x: Records, v: Records, pushed: Mapping[str, Records], row: Vector | None = None
) -> Records:
    """Forces (coordinates, ...) of springs, dampers, loads and compliant stops, N; or the sum of
    them with the weights `row` (n,)."""
    weights = np.eye(len(model.mass)) if row is None else row
    constant = np.asarray(weights @ model.constant_force)
    total = constant[(..., *([None] * (x.ndim - 1)))] - np.tensordot(
        weights @ model.stiffness, x, axes=1
    )
    total -= np.tensordot(weights @ model.damping, v, axes=1)
    for pair in model.pairs:
        if pair.name in pushed:
            total -= np.multiply.outer(weights @ pair.direction, pushed[pair.name])
    for part in model.functions:
        gap, rate = (np.tensordot(part.direction, each, axes=1) for each in (x, v))
        total -= np.multiply.outer(weights @ part.direction, part.force_left_out(gap, rate))
    return np.asarray(total)


def accelerations(
    plan: HistoryPlan, row: Vector, seed: int, first_path: int, paths: int, driven: bool
) -> Accelerations:
    """Records of the displacement row . q of the paths first_path, first_path + 1, ...

    `driven` says whether tables shake masses, so that their force is a part of the acceleration.
    """
    model, samples = plan.model, plan.samples
    found, logged = logged_impacts(
        lambda log: plan.plan.histories(seed, first_path, paths, samples, log),
        [pair.name for pair in model.pairs],
        energies=True,
    )
    start = (plan.plan.settling + 1) * plan.step  # where the first sample stands in the logs
    impacts = {}
    for pair, lost in zip(model.pairs, found.lost, strict=True):
        log = with_losses(pair, logged[pair.name], lost)
        impacts[pair.name] = replace(log, time=log.time - start)
    weights: Vector = np.linalg.solve(model.mass, row).astype(
        float
    )  # row . M^-1, as M is symmetric
    forces = pair_forces(model, found.displacement, found.velocity)
    smooth = carried_forces(model, found.displacement, found.velocity, forces, weights)
    if driven:
        for path in range(paths):
            drive = plan.plan.drive(seed, first_path + path, samples, 0)
            assert drive is not None
            smooth[path] += weights @ drive
    jumps = None
    if any(stop.rigid for stop in model.stops):
        jumps = velocity_jumps(model, weights, impacts, found.impact_speed, plan.step)
    return Accelerations(smooth, jumps, impacts, forces)


def velocity_jumps(
    model: Model, weights: Vector, impacts: Mapping[str, ImpactLog], sums: Records, step: float
) -> Records:
    """Sudden changes of velocity (paths, samples) by rigid stops, m/s, each at the nearest sample.

    Parameters
    ----------
    weights
        Acceleration of the place per unit of force on each coordinate (n,), 1/kg.
    impacts
        Impacts by pair, whose times are those of the samples.
    sums
        (pairs, paths, samples): sum of the speeds of impacts in the step that ends at a sample.
    """
    jumps = np.zeros(sums.shape[1:])
    for pair, own in zip(model.pairs, sums, strict=True):
        change = -float(weights @ pair.direction) * pair.mass
        for lane, place, speed in _rigid_impacts(pair, impacts[pair.name], own, step):
            np.add.at(jumps, (lane, place), change * speed)
    return jumps


def _rigid_impacts(
    pair: Pair, log: ImpactLog, sums: Records, step: float
) -> Iterator[tuple[NDArray[np.int64], NDArray[np.int64], Vector]]:
    """Path, nearest sample, and change (1 + R) w of the speed of the gap by impacts on rigid stops.

    `sums` (paths, samples) are the speeds of all impacts within the step that ends at a sample.
    Slow ones that the log leaves out happen at the end of their step.
    """
    samples = sums.shape[1]
    place = np.rint(log.time / step).astype(int)
    inside = (place >= 0) & (place < samples)
    path, place, speed = log.path[inside], place[inside], log.speed[inside]
    left = sums.copy()
    for near in (-1, 0, 1):
        left[path, np.clip(place + near, 0, samples - 1)] = 0.0
    slow_path, slow_place = np.nonzero(left)
    path, place = np.concatenate([path, slow_path]), np.concatenate([place, slow_place])
    speed = np.concatenate([speed, left[slow_path, slow_place]])
    for stop in pair.stops:
        met = np.sign(speed) == stop.side
        if stop.rigid and np.any(met):
            kept = 1.0 + stop.restitution_at(np.abs(speed[met]))
            yield path[met], place[met], kept * speed[met]


# ------------------------------------------------------------------------------
# One realisation of what Monte Carlo simulates, sample by sample, with its impacts.
#
#     M a = loads - C v - K x - contacts        a relative to the ground, x and v to a moving base
#
# Positions and velocities come from the kernels of `simulate`; accelerations follow from the forces
# that this equation names, and need no difference of samples. Impacts on rigid stops are impulses
# and stand in a table of their own.
# ------------------------------------------------------------------------------


COLUMNS = 4.0
"""Numbers that the table of a history and its making take for each number of the record."""

CONTACT_SAMPLES = 8.0
"""Samples in a contact with a compliant stop, below which its force is not resolved."""

MOST_PATHS = 2**40
"""Number of different paths of one seed."""


@dataclass(frozen=True, kw_only=True)
class Numbers(Quantities[float]):
    """Numbers of one path; as a mapping and in JSON, those alone that are known."""

    def _names(self) -> Sequence[str]:
        return [name for name in super()._names() if getattr(self, name) is not None]


@dataclass(frozen=True, kw_only=True)
class CoordinateHistory(Numbers):
    """The motion of one coordinate over the path, SI units.

    Parameters
    ----------
    displacement_mean, displacement_std, displacement_min, displacement_max
        Mean, standard deviation and extremes of the displacement, m.
    velocity_std
        Standard deviation of the velocity, m/s.
    acceleration_std, acceleration_max
        Standard deviation and largest size of the absolute acceleration, m/s^2; None where the
        samples have no acceleration.
    """

    displacement_mean: float = stated("mean displacement", "m", MISSING)
    displacement_std: float = stated("standard deviation of displacement", "m", MISSING)
    displacement_min: float = stated("smallest displacement", "m", MISSING)
    displacement_max: float = stated("largest displacement", "m", MISSING)
    velocity_std: float = stated("standard deviation of velocity", "m/s", MISSING)
    acceleration_std: float | None = stated("standard deviation of acceleration", "m/s^2")
    acceleration_max: float | None = stated("largest size of the acceleration", "m/s^2")


@dataclass(frozen=True, kw_only=True)
class PairHistory(Numbers):
    """The impacts of one impact pair over the path.

    Parameters
    ----------
    hits, hits_lower, hits_upper
        Number of impacts, and of those on the lower and the upper stop; None for a stop that the
        pair does not have.
    impact_speed_max
        Largest impact speed, m/s; None without an impact.
    """

    hits: float = stated("impacts", "", MISSING)
    hits_lower: float | None = stated("impacts on the lower stop", "")
    hits_upper: float | None = stated("impacts on the upper stop", "")
    impact_speed_max: float | None = stated("largest impact speed", "m/s")


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class History(Result):
    """One path of a scene, settled, from the time 0 on.

    Parameters
    ----------
    samples
        A row per sample, with `time_s`. Each coordinate has `displacement_m` and `velocity_m_s`,
        relative to a moving base, and `acceleration_m_s2`, absolute. A moving base has
        `base_acceleration_m_s2`, `base_velocity_m_s` and `base_displacement_m`. An impact pair with
        a compliant stop has `contact_force_N`, the force on its stops, positive on the upper one. A
        pair of two coordinates has `gap_m`, the first less the second. Where there are several
        coordinates or pairs, their names stand in front: `body.displacement_m`.
    impacts
        A row per impact, in the order of time: `time_s`, `pair`, `side`, the incident speed
        `speed_m_s` and the impulse `impulse_N_s` on the stop, both positive: m (1 + R) times the
        speed, m the reduced mass, on a rigid stop. On a compliant stop the time is that of the
        first touch. The impulse and the largest force `peak_force_N` are those of the contact, from
        the steps of the simulation; they are empty where the steps do not resolve it.
    coordinates, impact_pairs
        Means, deviations, extremes and counts of these tables, by name, as in
        `history.coordinates["x"].displacement_max` and `history.impact_pairs["stops"].hits`.
    scheme
        How the path was simulated.
    duration, step, seed, path
        Length, s; time between two rows, s; which realisation it is.
    meanings
        Meaning of each column in this scene, and reasons why others are left out.

    See Also
    --------
    stochvi.history : The calculation.
    """

    not_in_document = ("samples", "impacts")

    samples: DataFrame
    impacts: DataFrame
    coordinates: Mapping[str, CoordinateHistory]
    impact_pairs: Mapping[str, PairHistory]
    scheme: str
    duration: float
    step: float
    seed: int
    path: int
    meanings: Mapping[str, str]
    assumptions: Sequence[str] = ()

    def to_frame(self) -> DataFrame:
        """The table of samples."""
        return self.samples

    def summary(self) -> str:
        """The length of the path, how far it moved, and the number of its impacts, in a
        sentence."""
        moved = ", ".join(
            f"{name} {quantity.span(found.displacement_min, found.displacement_max)}"
            for name, found in self.coordinates.items()
            for quantity in [MILLIRADIANS if name in ROTATIONS else LENGTH]
        )
        return (
            f"{self.duration:.6g} s of path {self.path} of seed {self.seed}, {len(self.samples)} "
            f"samples {self.step:.4g} s apart: {moved}; {len(self.impacts)} impacts"
        )

    def _document(self) -> dict[str, Any]:
        head = {"method": f"history:{self.scheme}", "columns": list(self.samples)}
        return head | {"samples": len(self.samples)} | super()._document()


@calculation
def history(
    scene: Scene,
    *,
    duration: float,
    seed: int = 0,
    rng: Random = None,
    path: int = 0,
    rate: float | None = None,
    budget: float | None = None,
) -> History:
    """One realisation of what `simulate` samples: motion, base, contact forces and impacts.

    It is the path of this seed and number of `simulate`, after its burn-in, by the same kernels
    and random numbers. Exceptions are noted in the answer: under tabulated noise a duration beyond
    a block of `simulate` is synthesised as one longer block; a `rate` above that of the step
    refines the step; and slow impacts on one mass under white noise are resolved, as by
    `simulate(slow_impacts=True)`, where stops take more than half of the speed.

    Parameters
    ----------
    scene
        Any scene that `simulate` covers.
    duration
        Length, s.
    seed, path
        Which realisation is wanted: the same two numbers give the same digits.
    rng
        What draws the seed in its place, a Generator of numpy.
    rate
        Samples per second. The step of the simulation if not given; every k-th step where it is
        lower, k the largest that keeps the rate; a finer simulation where it is higher.
    budget
        Seconds after which `NotConverged` is raised; None for no limit.

    Returns
    -------
    History
        Samples and impacts.

    Raises
    ------
    NotApplicable
        If `simulate` does not cover the scene, or the path would be too long to keep.
    ValueError
        If an argument is out of range.

    See Also
    --------
    stochvi.simulate : The same by Monte Carlo.
    stochvi.replay : What the record itself does.

    Examples
    --------
    >>> from stochvi.scenes.excitations import WhiteNoise
    >>> from stochvi.scenes.structures import Oscillator
    >>> scene = Scene(
    ...     structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
    ...     excitations=[WhiteNoise(intensity=0.2)],
    ... )
    >>> list(history(scene, duration=10.0).samples)
    ['time_s', 'displacement_m', 'velocity_m_s']
    """
    check_options({"duration": duration, "seed": seed})
    if (
        isinstance(path, bool)
        or not isinstance(path, int | np.integer)
        or not 0 <= path < MOST_PATHS
    ):
        raise ValueError(f"path must be a whole number in [0, 2^40), got {path!r}")
    if rate is not None and not 0.0 < rate < math.inf:
        raise ValueError(f"rate must be a positive number of samples per second, got {rate}")
    if rate is not None and rate * duration < 1.0:
        raise ValueError(
            f"rate must be at least {1.0 / duration:.3g} Hz, 1 / duration, got {rate:g}"
        )
    started = time.perf_counter()
    planned = plan_histories(scene)
    model, usual = planned.model, _resolving(planned.plan)
    steps_per_sample = 1.0 if rate is None else 1.0 / (rate * usual.step) * (1.0 + ROUNDING)
    stride = max(1, math.floor(steps_per_sample))
    finer = steps_per_sample < 1.0
    step = usual.step * min(1.0, steps_per_sample)
    if duration <= step:
        raise ValueError(f"duration must be above {step:.3g} s, a step here, got {duration:g} s")
    _check_fits(usual, step, duration)
    source = usual.sampled(step, duration)
    count = source.history_samples(duration)
    found, logged = logged_impacts(
        lambda log: source.histories(seed, path, 1, count, log), [pair.name for pair in model.pairs]
    )
    kept = slice(0, count, stride)
    columns, meanings = _columns(scene, model, source, found, seed, path, kept)
    impacts = _impacts(planned, source, found, logged, duration)
    made = {"time_s": source.step * np.arange(count)[kept]} | columns
    samples = frame_of(made)
    interval = stride * source.step
    return History(
        samples=samples,
        impacts=impacts,
        coordinates=_motions(model, samples),
        impact_pairs=_hits(model, impacts),
        scheme=source.method,
        duration=duration,
        step=interval,
        seed=int(seed),
        path=int(path),
        meanings=meanings,
        assumptions=scene.assumptions(),
        warnings=[
            *model.cautions,
            *_departures(usual, source, duration, finer),
            *_slow_impacts(planned.plan, source),
            *_cut(model, columns, source.step),
            *_unresolved(planned, interval),
        ],
        cost=Cost(
            wall_time=time.perf_counter() - started,
            steps=count + source.settling, paths=1, impacts=len(impacts),
        ),
        provenance=provenance(scene.document(), seed),
    )  # fmt: skip


def _check_fits(plan: Plan, step: float, duration: float) -> None:
    """NotApplicable if the record, and the table made of it, would not fit into the memory."""
    samples = min(duration / step, sys.maxsize)  # it may be infinite
    if (size := COLUMNS * plan.record_size(math.ceil(samples))) > MOST_NUMBERS:
        longest = duration * MOST_NUMBERS / size
        raise NotApplicable(
            "history",
            f"duration = {duration:g} s takes {size:.2g} numbers, at most {MOST_NUMBERS:.2g} are "
            f"kept; ask for about {longest:.2g} s or less, or for several paths",
        )


def _columns(
    scene: Scene, model: Model, plan: Plan, found: Histories, seed: int, path: int, kept: slice
) -> tuple[dict[str, Vector], dict[str, str]]:
    """All columns but the time, and what they mean."""
    x, v = found.displacement[:, 0, kept], found.velocity[:, 0, kept]
    count = found.displacement.shape[2]
    gaps = {pair.name: pair.direction @ x for pair in model.pairs}
    pushed = pair_forces(model, x, v)
    on_base, on_masses = places_shaken(scene)
    integrals = range(len(BASE_COLUMNS)) if on_base and not on_masses else range(1)
    drives = [plan.drive(seed, path, count, order) for order in integrals]
    driven = [None if drive is None else drive[:, kept] for drive in drives]
    meanings = dict(MEANINGS)
    if not model.moving_base:
        meanings["displacement_m"] = "from the position of the unloaded springs"
        meanings["velocity_m_s"] = "of the mass"
    acceleration = None
    known = not on_masses or (driven[0] is not None and not model.whites and not on_base)
    if known and not model.remembers:
        forces = carried_forces(model, x, v, pushed)
        if on_masses and driven[0] is not None:
            forces = forces + driven[0]
        acceleration = np.linalg.solve(model.mass, forces)
        if any(pair.rigid for pair in model.pairs):
            meanings["acceleration_m_s2"] += (
                ", between impacts: without the impulses of rigid stops"
            )
    else:
        meanings["acceleration_m_s2"] = "left out: " + why_no_acceleration(model, on_base)
    if turning := [name for name in model.outputs if name in ROTATIONS]:
        for name, unit in (("displacement_m", "rad"), ("velocity_m_s", "rad/s")):
            meanings[name] += f"; {', '.join(turning)} in {unit}"
        if acceleration is not None:
            meanings["acceleration_m_s2"] += f"; {', '.join(turning)} in rad/s^2"
    columns: dict[str, Vector] = {}
    for name, row in zip(model.outputs, model.output_rows, strict=True):
        before = _before(name, model.outputs)
        columns[before + "displacement_m"] = row @ x
        columns[before + "velocity_m_s"] = row @ v
        if acceleration is not None:
            columns[before + "acceleration_m_s2"] = row @ acceleration
    if on_base:
        columns |= _base(model, driven, on_masses, meanings)
    names = [pair.name for pair in model.pairs]
    for pair in model.pairs:
        if pair.relative:
            columns[_before(pair.name, names) + "gap_m"] = gaps[pair.name]
        if pair.name in pushed:
            columns[_before(pair.name, names) + "contact_force_N"] = pushed[pair.name]
    present = {name.rpartition(".")[2] for name in columns}
    return columns, {
        name: words
        for name, words in meanings.items()
        if name in present or words.startswith("left out")
    }


BASE_COLUMNS = ("base_acceleration_m_s2", "base_velocity_m_s", "base_displacement_m")
"""Columns of a moving base, each the integral of the one before."""

MEANINGS = {
    "displacement_m": "relative to the base, from the position of the unloaded springs",
    "velocity_m_s": "relative to the base",
    "acceleration_m_s2": "absolute, less that of a constant load of the base and of gravity",
    "contact_force_N": "on the compliant stops, positive on the upper one",
    "gap_m": "displacement of the first coordinate of the pair less that of the second; at a place "
    "of a rigid body, the displacement along the direction of the pair",
}
"""Meanings of columns where nothing else is stated."""


def _before(name: str, names: Sequence[str]) -> str:
    """The prefix of the column names of one of several coordinates or pairs."""
    return f"{name}." if len(names) > 1 else ""


def _base(
    model: Model, driven: Sequence[Matrix | None], on_masses: bool, meanings: dict[str, str]
) -> dict[str, Vector]:
    """The columns of a moving base that are known, from its inertia forces."""
    if on_masses or driven[0] is None:
        meanings[BASE_COLUMNS[0]] = "left out: " + (
            "forces on masses and the motion of the base cannot be told apart"
            if on_masses
            else "the simulation keeps white noise on one oscillator, tables and sines alone"
        )
        return {}
    meanings[BASE_COLUMNS[0]] = "absolute" + (
        "; white noise is the mean over the step that follows" if model.whites else ""
    )
    inertia = -model.mass @ model.base_rows
    found = {}
    for name, drive in zip(BASE_COLUMNS, driven, strict=True):
        if drive is None:
            meanings[name] = (
                "left out: white and filtered noise leave it without a stationary distribution"
            )
        else:
            moved = np.linalg.lstsq(inertia, drive, rcond=None)[0]
            for axis, values in zip(model.base, moved, strict=True):
                found[f"{axis}.{name}" if axis else name] = values
            meanings.setdefault(name, "absolute, about a mean of 0")
    return found


IMPACT_COLUMNS = ("time_s", "pair", "side", "speed_m_s", "impulse_N_s", "peak_force_N")
"""Columns of the table of impacts."""


def _impacts(
    planned: HistoryPlan,
    plan: Plan,
    found: Histories,
    logged: Mapping[str, ImpactLog],
    duration: float,
) -> DataFrame:
    """A row for each impact within the history."""
    start = (plan.settling + 1) * plan.step  # where the first sample stands in the logs
    rows = [frame_of({name: [] for name in IMPACT_COLUMNS})]
    for pair, contact in zip(plan.model.pairs, _contact_times(planned), strict=True):
        log = logged[pair.name]
        when = log.time - start
        inside = (when >= 0.0) & (when <= duration)
        when, speed = when[inside], log.speed[inside]
        impulse, peak = np.full((2, len(when)), np.nan)
        if contact >= CONTACT_SAMPLES * plan.step and contact < math.inf:
            gap, rate = (
                pair.direction @ each[:, 0] for each in (found.displacement, found.velocity)
            )
            impulse, peak = _contacts(when, plan.step, np.abs(pair.force(gap, rate)))
        for stop in pair.stops:
            if stop.rigid:
                met = np.sign(speed) == stop.side
                size = np.abs(speed[met])
                if not stop.scattered:
                    impulse[met] = pair.mass * (1.0 + stop.restitution_at(size)) * size
                peak[met] = np.nan
        sides = np.where(speed > 0.0, "upper", "lower")
        columns = (when, pair.name, sides, np.abs(speed), impulse, peak)
        rows.append(frame_of(dict(zip(IMPACT_COLUMNS, columns, strict=True))))
    filled = [table for table in rows if len(table)] or rows[:1]
    return stacked(filled).sort_values("time_s")


def _contacts(when: Vector, step: float, force: Vector) -> tuple[Vector, Vector]:
    """Impulse (N s) and largest force (N) of each contact, from its touch until the next touch, of
    a force sampled at equal steps."""
    owner = np.searchsorted(when, step * np.arange(len(force)), side="right") - 1
    known = owner >= 0
    impulse, peak = np.zeros((2, len(when)))
    np.add.at(impulse, owner[known], step * force[known])
    np.maximum.at(peak, owner[known], force[known])
    return impulse, peak


def _contact_times(planned: HistoryPlan) -> list[float]:
    """Duration of a contact of each pair at its rms speed, s; infinite between rigid stops."""
    return [
        min(
            (
                stop.law.impact(speed, pair.mass).contact_time
                for stop in pair.stops
                if isinstance(stop.law, CompliantLaw) and speed > 0.0
            ),
            default=math.inf,
        )
        for pair, speed in zip(planned.model.pairs, planned.plan.speeds, strict=False)
    ]


def _motions(model: Model, samples: DataFrame) -> dict[str, CoordinateHistory]:
    found = {}
    for name in model.outputs:
        before = _before(name, model.outputs)
        x, v = samples[before + "displacement_m"], samples[before + "velocity_m_s"]
        a = samples.get(before + "acceleration_m_s2")
        found[name] = CoordinateHistory(
            displacement_mean=float(x.mean()),
            displacement_std=float(x.std(ddof=0)),
            displacement_min=float(x.min()),
            displacement_max=float(x.max()),
            velocity_std=float(v.std(ddof=0)),
            acceleration_std=None if a is None else float(a.std(ddof=0)),
            acceleration_max=None if a is None else float(a.abs().max()),
        )
    return found


def _hits(model: Model, impacts: DataFrame) -> dict[str, PairHistory]:
    found = {}
    for pair in model.pairs:
        own = impacts[impacts["pair"] == pair.name]
        on_side = {stop.name: float((own["side"] == stop.name).sum()) for stop in pair.stops}
        found[pair.name] = PairHistory(
            hits=float(len(own)),
            hits_lower=on_side.get("lower"),
            hits_upper=on_side.get("upper"),
            impact_speed_max=float(own["speed_m_s"].max()) if len(own) else None,
        )
    return found


def _resolving(plan: Plan) -> Plan:
    """The plan that resolves slow impacts at the same step. The given plan stays where it resolves
    them itself, where no finer one has its step, or where the motion of a base is kept: a finer
    plan draws that only as it needs it."""
    if _resolved(plan) or plan.model.moving_base:
        return plan
    finer = plan.finer()
    return finer if finer.step == plan.step and not finer.excitation_known else plan


def _resolved(plan: Plan) -> bool:
    """Whether the step leaves a known bias in the rate of impacts, or none."""
    return not plan.model.pairs or plan.elastic or plan.step_bias("collision_rate", 0.0) is not None


def _slow_impacts(usual: Plan, source: Plan) -> list[str]:
    """A sentence on slow impacts, where `simulate` would warn of them: that they are resolved, or
    the rate that resolves them."""
    if _resolved(usual):
        return []
    if source.method != usual.method:
        return [
            "slow impacts are resolved by refined steps, as by simulate(slow_impacts=True): the "
            "path is another realisation than that of the usual step of `simulate`"
        ]
    remedy = "a higher rate resolves more of them"
    if isinstance(usual, WhitePlan):
        # noise brings the speed of the slowest counted impact in twice this time
        enough = 2.0 * usual.model.intensity / max(usual.threshold, 1e-3 * usual.speed) ** 2
        if source.step * enough <= 1.0:
            return []
        remedy = f"rate = {1.001 * enough:.2g} or more resolves those that `simulate` counts"
    return [
        f"slow impacts at these stops are not resolved by steps of {source.step:.3g} s: too few "
        f"are found, and speeds near the stops are biased; {remedy}"
    ]


def _departures(usual: Plan, source: Plan, duration: float, finer: bool) -> list[str]:
    """Why the path is not that of `simulate`, where it is not."""
    if finer:
        return [
            f"the rate asked for is above that of the step of `simulate`, {1.0 / usual.step:.4g} "
            "samples per second: the step is finer, and the path is another realisation"
            + ("" if usual.kicked else " above the frequencies that both resolve")
        ]
    if source.model.tables and duration > usual.duration * (1.0 + ROUNDING):
        return [
            f"paths of `simulate` repeat blocks of {usual.duration:.4g} s: this longer one is "
            "synthesised as a whole, another realisation of the same law"
        ]
    return []


def _cut(model: Model, columns: Mapping[str, Vector], step: float) -> list[str]:
    """Sentences on the motion of the base above the frequencies that are synthesised."""
    highest = 0.5 / step
    ends = [float(table.frequency_hz[-1]) for table, _ in model.tables]
    known = any(name.endswith(BASE_COLUMNS[0]) for name in columns)
    if not known or max(ends, default=0.0) <= highest:
        return []
    whole = sum(table.mean_square() for table, _ in model.tables)
    left = sum(_mean_square_above(table, highest) for table, _ in model.tables)
    return [
        f"the table reaches to {max(ends):.4g} Hz and is followed up to {highest:.4g} Hz, which is "
        f"enough for the response: {100.0 * left / whole:.2g} % of the mean square of "
        f"{BASE_COLUMNS[0]} lie above; rate = {2.2 * max(ends):.2g} holds them"
    ]


def _mean_square_above(table: Table, frequency: float) -> float:
    """Area under a table above a frequency, Hz."""
    kept = table.frequency_hz > frequency
    if kept.all() or not kept.any():
        return table.mean_square() if kept.all() else 0.0
    return Table(
        frequency_hz=np.append(frequency, table.frequency_hz[kept]),
        density=np.append(table(frequency), table.density[kept]),
    ).mean_square()


def _unresolved(planned: HistoryPlan, interval: float) -> list[str]:
    """Stops whose contacts are too short for the samples to show their force."""
    return [
        f"a contact with {pair.name} takes about {contact:.2g} s, and samples are {interval:.2g} s "
        "apart: contact_force_N and accelerations miss its peak, and a step of that length leaves "
        f"impulse_N_s empty; rate = {1.05 * CONTACT_SAMPLES / contact:.2g} shows them"
        for pair, contact in zip(planned.model.pairs, _contact_times(planned), strict=True)
        if interval * CONTACT_SAMPLES > contact
    ]
