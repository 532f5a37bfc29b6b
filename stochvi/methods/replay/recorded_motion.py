"""A measured record itself, passed through a structure and its stops. Chapters: the answer;
`replay`."""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import MISSING, dataclass, replace
from dataclasses import replace as changed
from typing import Any, ClassVar, NamedTuple, Protocol, Self

import numpy as np
import scipy
from numpy.typing import NDArray

from stochvi.mathematics.numerics import Matrix, Vector
from stochvi.mathematics.spectra import Force, Table
from stochvi.mathematics.units import LENGTH, SPEED, TIME
from stochvi.mathematics.unsteady_noise import FastPeaks
from stochvi.methods.replay.march import (
    ExactReplay,
    Motion,
    SampledExcitation,
    check_steps,
    with_drives,
)
from stochvi.model.coverage import (
    functions_of_arrays,
    moving_stops,
    nonlinear,
    not_compiled,
    rubbing,
)
from stochvi.model.model import Model, Pair, Stop, inertia_of, model_of
from stochvi.results.base import (
    DataFrame,
    Named,
    Quantities,
    Result,
    frame_of,
    kept_table,
    of_angle,
    rows_of,
    stacked,
    stated,
)
from stochvi.results.deadline import Deadline
from stochvi.results.errors import MOST_NUMBERS, Interrupted, NotApplicable, NotConverged
from stochvi.results.estimates import Cost, Estimate, provenance
from stochvi.sampling.calculations import Random, calculation
from stochvi.scenes.excitations import BASE, ConstantLoad, DensityNoise, RecordedNoise
from stochvi.scenes.scene import Scene
from stochvi.scenes.structures.rigid_body import AXES

# ------------------------------------------------------------------------------
# The answer of `replay`: the motion of a structure between its stops under a measured record.
# ------------------------------------------------------------------------------


STILL = 1e-9
"""Motion over the largest one of all coordinates, m or rad, below which it is rounding."""

SEGMENTS, FEWEST_SAMPLES = 100.0, 64
"""Number of segments in a record for its short-time spectra, and smallest number of samples in one:
32 frequencies tell an impact from the ringing of the mount."""


class _OfReplay(Quantities[Estimate | None]):
    """What a replay finds at one place."""

    def with_bias(self, coarse: Mapping[str, Estimate | None], step: float) -> Self:
        """The same numbers by a step, s, with their differences from those at twice the step as
        bias."""
        how = f"the record itself, steps of {TIME.text(step)}"

        def compared(name: str, own: Estimate) -> Estimate:
            other = coarse[name]
            bias = None if other is None else abs(own.value - other.value)
            return replace(own, bias=bias, how=how)

        found: dict[str, Any] = {
            name: compared(name, own) for name, own in self.items() if own is not None
        }
        return replace(self, **found)  # type: ignore[type-var]


@dataclass(frozen=True, kw_only=True)
class CoordinateReplay(_OfReplay):
    """The motion of one coordinate.

    Parameters
    ----------
    displacement_max, displacement_min
        Largest and smallest displacement, between samples too, m.
    displacement_mean, displacement_std
        Mean and standard deviation of the samples, m.
    displacement_kurtosis
        Fourth moment of the samples about their mean over the square of the second; 3 for a
        Gaussian process. None of a coordinate that does not move.
    acceleration_max
        Largest size of the absolute acceleration, m/s^2; with rigid stops, between the impacts.
    """

    displacement_max: Estimate = stated("largest displacement", "m", MISSING)
    displacement_min: Estimate = stated("smallest displacement", "m", MISSING)
    displacement_mean: Estimate
    displacement_std: Estimate = stated("standard deviation of displacement", "m", MISSING)
    displacement_kurtosis: Estimate | None = stated("kurtosis of the displacement", "", MISSING)
    acceleration_max: Estimate = stated("largest absolute acceleration", "m/s^2", MISSING)

    def reach(self, name: str) -> str:
        """The smallest and the largest displacement, in words, of a coordinate of this name."""
        ends = float(self.displacement_min), float(self.displacement_max)
        return of_angle(name, LENGTH).span(*ends)


@dataclass(frozen=True, kw_only=True)
class PairReplay(_OfReplay):
    """The impacts of one impact pair.

    Parameters
    ----------
    hits, hits_lower, hits_upper
        Number of impacts; on compliant stops, number of contacts that began. Chatter on a rigid
        stop is counted until the mass rests: in steps, down to the speed that forces bring in one.
    impact_speed_max, impact_speed_mean
        Largest and mean impact speed, m/s; None without an impact.
    peak_force
        Largest force of a contact, N; None for rigid stops.
    contact_time
        Time in contact, or at rest on a rigid stop, s. Contact with a stop that loses energy ends
        when its force returns to zero, which is before the mass is back at the stop.
    rests
        Number of times that the mass came to rest on a rigid stop.
    """

    hits: Estimate = stated("impacts", "", MISSING)
    hits_lower: Estimate | None
    hits_upper: Estimate | None
    impact_speed_max: Estimate | None = stated("largest impact speed", "m/s", MISSING)
    impact_speed_mean: Estimate | None
    peak_force: Estimate | None = stated("largest force of a stop", "N", MISSING)
    contact_time: Estimate = stated("time in contact", "s", MISSING)
    rests: Estimate = stated("times at rest on a stop", "", MISSING)

    def with_bias(self, coarse: Mapping[str, Estimate | None], step: float) -> Self:
        found = super().with_bias(coarse, step)
        # rests on rigid stops are timed by whole steps
        time, rests = found.contact_time, found.rests.value
        bias = None if time.bias is None else time.bias + step * rests
        return replace(found, contact_time=replace(time, bias=bias))


@dataclass(frozen=True, kw_only=True, eq=False)
class Histories:
    """Samples of a replay (SI units).

    Parameters
    ----------
    time
        Seconds from the start of the record.
    base_acceleration
        Acceleration of the base (samples,), m/s^2; (samples, 3) of a base that moves along x, y and
        z; zeros where the records are forces.
    displacement, velocity, acceleration
        Samples by the name of the coordinate; accelerations are absolute.
    force
        Force of each stop on the mass by "pair side", N, positive while it pushes. A rigid stop has
        one only while the mass rests on it, which a replay in steps leaves unknown (nan).
    """

    time: Vector
    base_acceleration: Vector
    displacement: Mapping[str, Vector]
    velocity: Mapping[str, Vector]
    acceleration: Mapping[str, Vector]
    force: Mapping[str, Vector]

    def to_frame(self) -> DataFrame:
        """A table with a row per sample; names of coordinates stand in front where there are
        several."""
        columns: dict[str, Vector] = {"time": self.time}
        if self.base_acceleration.ndim == 1:
            columns["base_acceleration"] = self.base_acceleration
        else:
            for axis, values in zip(AXES, self.base_acceleration.T, strict=True):
                columns[f"{axis}.base_acceleration"] = values
        several = len(self.displacement) > 1
        for name in self.displacement:
            before = f"{name}." if several else ""
            for quantity in ("displacement", "velocity", "acceleration"):
                columns[before + quantity] = getattr(self, quantity)[name]
        columns |= {f"force_{name.replace(' ', '_')}": each for name, each in self.force.items()}
        return frame_of(columns)

    def short_time_spectra(
        self, coordinate: str | None = None, segment: float | None = None
    ) -> ShortTimeSpectra:
        """Spectra of the absolute acceleration of a coordinate in short segments that overlap by
        half (Hann), as `scipy.signal.spectrogram` has them.

        Parameters
        ----------
        coordinate
            Its name, by default the first.
        segment
            Length of a segment, s; by default a hundredth of the record, 64 samples at least.
        """
        name = next(iter(self.acceleration)) if coordinate is None else coordinate
        step = float(self.time[1] - self.time[0])
        wanted = self.time[-1] / SEGMENTS if segment is None else segment
        samples = min(max(round(wanted / step), FEWEST_SAMPLES), len(self.time))
        frequency, middles, density = scipy.signal.spectrogram(
            self.acceleration[name], 1.0 / step, window="hann", nperseg=samples,
            noverlap=samples // 2, detrend="constant",
        )  # fmt: skip
        return ShortTimeSpectra(self.time[0] + middles, frequency[1:], np.asarray(density[1:]))


class ShortTimeSpectra(NamedTuple):
    """Spectra of segments of an acceleration: the waterfall of a record.

    Parameters
    ----------
    time
        Middles of the segments, s.
    frequency_hz
        Frequencies, Hz.
    density
        (frequencies, segments): one-sided spectral density, (m/s^2)^2/Hz.
    """

    time: Vector
    frequency_hz: Vector
    density: Matrix


@dataclass(frozen=True, kw_only=True, eq=False)
class ReplayAt:
    """The replay between stops at one clearance.

    Parameters
    ----------
    clearance
        Distance of the stops from the static equilibrium, m; None for the stops of the scene.
    stops
        Position of each stop by "pair side", m from the unloaded spring.
    coordinates, impact_pairs
        The quantities by the names of coordinates and of impact pairs.
    impacts
        One row per impact: `time` (s), `pair`, `side`, `speed` (m/s), `peak_force` (N, nan
        at rigid stops, whose impulses have none).
    histories
        The samples; None where they would not fit into memory.

    See Also
    --------
    stochvi.replay : The answer that holds it.
    """

    not_in_document: ClassVar = ("stops", "impacts", "histories")  # which are tables of their own

    clearance: float | None
    stops: Mapping[str, float]
    coordinates: Mapping[str, CoordinateReplay]
    impact_pairs: Mapping[str, PairReplay]
    impacts: DataFrame = kept_table()
    histories: Histories | None

    @property
    def still(self) -> Sequence[str]:
        """The coordinates that do not move, but for rounding."""
        sizes = {
            name: max(abs(each.displacement_min.value), abs(each.displacement_max.value))
            for name, each in self.coordinates.items()
        }
        least = STILL * max(sizes.values(), default=0.0)
        return [name for name, size in sizes.items() if size <= least]

    @property
    def unhit(self) -> Sequence[str]:
        """The impact pairs without an impact."""
        return [name for name, each in self.impact_pairs.items() if not each.hits.value]

    def with_bias(self, coarse: ReplayAt, step: float) -> ReplayAt:
        """The same answer by a step, s, with the differences from that at twice the step as
        bias."""
        return replace(
            self,
            coordinates={
                name: each.with_bias(coarse.coordinates[name], step)
                for name, each in self.coordinates.items()
            },
            impact_pairs={
                name: each.with_bias(coarse.impact_pairs[name], step)
                for name, each in self.impact_pairs.items()
            },
        )

    def estimates(self) -> Iterator[tuple[str, str, Estimate]]:
        """Owner, name and number of every quantity that is known."""
        for group in (self.coordinates, self.impact_pairs):
            for owner, quantities in group.items():
                for name, each in quantities.items():
                    if each is not None:
                        yield owner, name, each

    def row(self) -> dict[str, float | None]:
        """The quantities as a row of a table."""
        found: dict[str, float | None] = {"clearance": self.clearance}
        for group in (self.coordinates, self.impact_pairs):
            for owner, quantities in group.items():
                before = f"{owner}." if len(group) > 1 else ""
                for name, each in quantities.items():
                    found[before + name] = None if each is None else float(each)
        return found


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Replay(Result):
    """The records of a scene, passed through its structure and stops.

    `replay.coordinates["x"].displacement_max` and `replay.impact_pairs["stops"].hits` are those of
    a single clearance, or of the stops of the scene; over several clearances these two are empty,
    and `clearances` holds the answer at each.

    Parameters
    ----------
    clearances
        The answers, in the order that was asked for.
    duration
        Time that was replayed, s.
    assumptions
        Assumptions, a sentence each.

    See Also
    --------
    stochvi.replay : The calculation.
    """

    kind = "replay"
    in_document: ClassVar = {name: name for name in ("coordinates", "impact_pairs")}

    clearances: tuple[ReplayAt, ...]
    duration: float
    assumptions: Sequence[str] = ()

    @property
    def only(self) -> ReplayAt | None:
        """The answer where there is only one."""
        return self.clearances[0] if len(self.clearances) == 1 else None

    @property
    def coordinates(self) -> Mapping[str, CoordinateReplay]:
        """Quantities of the coordinates at the only clearance."""
        return Named(self.only.coordinates if self.only else {})

    @property
    def impact_pairs(self) -> Mapping[str, PairReplay]:
        """Quantities of the impact pairs at the only clearance."""
        return Named(self.only.impact_pairs if self.only else {})

    @property
    def histories(self) -> Histories | None:
        """The samples at the only clearance."""
        return self.only.histories if self.only else None

    @property
    def impacts(self) -> DataFrame:
        """The impacts one by one, with the clearance at which each happened."""
        tables = [each.impacts.assign(clearance=each.clearance) for each in self.clearances]
        filled = [table for table in tables if len(table)]
        return stacked(filled) if filled else tables[0]

    def summary(self) -> str:
        """Displacement, impacts and speeds, in a sentence; over several clearances the impacts at
        each."""
        if self.only is None:
            hits = [
                f"{sum(float(pair.hits) for pair in each.impact_pairs.values()):.0f} at "
                f"{LENGTH.text(each.clearance or 0.0)}"
                for each in self.clearances
            ]
            return (
                f"replay of {self.duration:.4g} s of record: impacts {', '.join(hits)} on each side"
            )
        still, unhit, pairs = self.only.still, self.only.unhit, self.impact_pairs
        said = [
            f"{name} from {each.reach(name)}"
            for name, each in self.coordinates.items()
            if name not in still
        ]
        if still:
            said.append(f"{', '.join(still)} {'do' if len(still) > 1 else 'does'} not move")
        said += [_impacts_in_words(name, pairs[name]) for name in pairs if name not in unhit]
        if unhit:
            number = f"{len(unhit)} {'other ' * (len(unhit) < len(pairs))}pairs"
            said.append(f"no impact on {unhit[0] if len(unhit) == 1 else number}")
        return f"replay of {self.duration:.4g} s of record: {'; '.join(said)}"

    def to_frame(self) -> DataFrame:
        """One row per clearance, a column per quantity (SI units)."""
        return frame_of(each.row() for each in self.clearances)


def _impacts_in_words(name: str, pair: PairReplay) -> str:
    """The number of impacts on a pair, and the fastest of them."""
    hits = round(float(pair.hits))
    number = "1 impact" if hits == 1 else f"{hits} impacts"
    fastest = pair.impact_speed_max
    speed = "" if fastest is None else f", {'up to ' * (hits > 1)}{SPEED.text(float(fastest))}"
    return f"{number} on {name}{speed}"


# ------------------------------------------------------------------------------
# A measured record itself, passed through a structure and its stops.
#
# What is linear between stops without friction is followed by power series (`march`), all else in
# steps of a simulation (`steps`).
# ------------------------------------------------------------------------------


class Way(Protocol):
    """A way to the motion of a model: by power series, or in steps."""

    @property
    def model(self) -> Model:
        """The model that is followed."""

    @property
    def runs(self) -> tuple[int, ...]:
        """Steps in an interval of the record, of each run: that of the answer, and one at twice the
        step where there is a bias."""

    def move(self, shaking: SampledExcitation, seed: int, parts: int) -> Motion:
        """The motion from rest under the constant loads."""


EXACT = "the record itself, exact steps"
"""Words in every estimate of a replay by power series on how it was found."""

LARGEST = (
    "displacement_max", "displacement_min", "acceleration_max", "impact_speed_max", "peak_force",
)  # fmt: skip
"""Numbers by which a replay in steps says how far it depends on them."""

NOTICED_MEAN = 0.01
"""Smallest displacement by the mean of a record that is told, as a share of the largest one."""


@calculation
def replay(
    scene: Scene,
    clearances: Sequence[float] | None = None,
    *,
    seed: int = 0,
    rng: Random = None,
    threads: int | None = None,
    budget: float | None = None,
) -> Replay:
    """Pass the measured records of a scene through its structure and stops.

    The motion starts from rest in the position of rest under the constant loads, at the start of
    each segment of a record. Accelerations are linear between samples, and the mean of a record is
    taken off, as it is for its density. The motion follows in exact steps; impacts are located
    within a step as roots of its power series; contact with compliant stops is integrated.
    Springs and dampers that are functions, and stops that rub, are followed in steps instead, with
    what the step leaves as bias.
    Nothing is random but a restitution that scatters, impulses and a `DriveFunction`, of which
    this is one realisation: the same record and `seed` give the same answer.

    Parameters
    ----------
    scene
        A structure whose excitations are records (`kind = "record"`) and constant loads, and
        beside these impulses (`Pulses` without a shape) and functions (`DriveFunction`).
    clearances
        Metres per side from the static equilibrium, at each of which the stops of the one impact
        pair are put, with their laws; by default the stops are where the scene has them. A scene
        without stops is replayed without.
    seed, rng
        Seed of what is drawn, a whole number from 0; without effect where nothing is. Or what draws
        one, a Generator of numpy.
    threads
        Number of clearances that are replayed at a time, by default all cores.
    budget
        Seconds after which `NotConverged` is raised; None for no limit.

    Returns
    -------
    Replay
        Motion and impacts at each clearance.

    Raises
    ------
    NotApplicable
        If the scene has no record, other noise besides records, or records of different lengths; if
        the whole spring is a function of arrays.

    See Also
    --------
    stochvi.screen : The linear answer.
    stochvi.size : The clearance that is needed.

    Examples
    --------
    >>> import numpy as np, tempfile
    >>> from pathlib import Path
    >>> from stochvi import ImpactPair, Isolator, RecordedNoise, Restitution
    >>> time = np.arange(4000) / 1000.0
    >>> file = Path(tempfile.mkdtemp()) / "sine.txt"
    >>> np.savetxt(file, 0.3 * np.sin(2.0 * np.pi * 10.0 * time))
    >>> scene = Scene(
    ...     structure=Isolator(frequency_hz=10.0, zeta=0.05),
    ...     impact_pairs=[
    ...         ImpactPair(lower=-0.004, upper=0.004, law=Restitution(coefficient=0.5))
    ...     ],
    ...     excitations=[RecordedNoise(file=str(file), unit="g", fs=1000.0)],
    ... )
    >>> found = replay(scene)
    >>> float(found.coordinates["x"].displacement_max)
    0.004
    >>> free = replay(scene, [0.008])
    >>> round(1e3 * float(free.coordinates["x"].displacement_max), 2)
    7.45
    """
    begin, deadline = time.perf_counter(), Deadline.after(budget)
    if not 0 <= seed < 2**63:
        raise ValueError(f"seed must be in [0, 2^63), got {seed}")
    model = model_of(scene)
    missing = unmet(scene, model)
    springs = any(not part.law.is_damper for part in _without_drives(model).functions)
    places = [None] if clearances is None else [float(each) for each in clearances]
    if clearances is not None:
        if not places or any(not 0.0 < each < math.inf for each in places if each is not None):
            raise ValueError(
                f"clearances must be positive lengths in metres, got {list(clearances)}; give "
                "distances from the static equilibrium, such as [0.002, 0.003]"
            )
        if len(model.pairs) != 1:
            missing.append(
                "the scene must have one impact pair, whose law is kept while its stops move, got "
                f"{len(model.pairs)}"
            )
        if springs and np.any(_force_at_zero(model)):
            missing.append(
                "clearances count from the static equilibrium, which is not sought where loads act "
                "on a spring that is a function; give the stops in the scene"
            )
    if missing:
        raise NotApplicable("replay", missing)
    segments = with_drives(scene, model, shaking_of(records_of(scene, model), model), seed)
    numbers = sum(each.forces.size for each in segments) * len(places)
    stepped = in_steps(model)
    keep = stepped or numbers <= MOST_NUMBERS

    def way_at(clearance: float | None) -> Way:
        placed = model
        if clearance is not None:
            placed = with_clearance(model, clearance, 0.0 if springs else model.mean_gaps[0])
        return _way(placed, segments[0], keep, deadline)

    def at(way: Way, clearance: float | None) -> ReplayAt:
        own, *coarse = (_answer_at(way, clearance, segments, seed, parts) for parts in way.runs)
        return own.with_bias(coarse[0], segments[0].step / way.runs[0]) if coarse else own

    ways = [way_at(each) for each in places]
    compile_time = _compiled(ways[0], segments[0])
    with ThreadPoolExecutor(threads) as pool:
        found = tuple(pool.map(at, ways, places))
    return Replay(
        clearances=found,
        duration=float(sum(each.step * len(each.base) for each in segments)),
        assumptions=(
            *assumptions_of(scene, model, len(segments), seed),
            *([_of_drives(seed)] if model.drives else []),
            *([_of_steps(found)] if stepped else []),
        ),
        warnings=(
            *_without_samples(numbers, keep),
            *doubts_of(scene),
            *_without_mean(scene, model, found[-1]),
        ),
        cost=Cost(
            wall_time=time.perf_counter() - begin - compile_time,
            compile_time=compile_time,
            steps=sum(len(each.base) for each in segments) * sum(sum(way.runs) for way in ways),
            impacts=sum(len(rows_of(each, "impacts")) for each in found),
            paths=len(places),
        ),
        provenance=provenance(scene.document(), seed if model.scattered or model.drives else None),
    )


def in_steps(model: Model) -> bool:
    """Whether a model is followed in steps: it has functions besides its drives, springs that
    relax, or friction."""
    return bool(nonlinear(_without_drives(model))) or bool(rubbing(model))


def _force_at_zero(model: Model) -> Vector:
    """Forces on the coordinates where nothing is displaced, N."""
    total = model.constant_force.copy()
    for part in _without_drives(model).functions:
        if not part.law.remembers:
            total -= part.direction * float(part.force_left_out(0.0, 0.0))
    return total


def _without_drives(model: Model) -> Model:
    """The model without the forces that are drawn, which a replay has beside its record."""
    return changed(model, functions=tuple(each for each in model.functions if not each.drawn))


def _way(model: Model, shaking: SampledExcitation, keep: bool, deadline: Deadline) -> Way:
    """How a model is followed; `keep` says whether its samples are kept."""
    if not in_steps(model):
        check_steps(model, shaking)
        return ExactReplay(_without_drives(model), keep, deadline)
    from stochvi.methods.replay.steps import SteppedReplay

    return SteppedReplay(model, shaking, deadline)


def _compiled(way: Way, shaking: SampledExcitation) -> float:
    """Seconds in which the kernel was compiled, or loaded: it moves the model for two samples."""
    begin = time.perf_counter()
    with contextlib.suppress(NotConverged, Interrupted):  # said again, of the whole record
        way.move(changed(shaking, forces=shaking.forces[:2], base=shaking.base[:2]), 0, way.runs[0])
    return time.perf_counter() - begin


def unmet(scene: Scene, model: Model) -> list[str]:
    """The conditions of a replay that a scene does not meet."""
    drives = [part.drawn for part in model.drives]
    functions = functions_of_arrays(model, with_branches=True)
    found = [*functions, *moving_stops(model), *not_compiled(model)]
    records = [each for each in scene.excitations if isinstance(each, RecordedNoise)]
    if not records:
        found.append('excitation must hold a measured record (kind = "record"), got none')
    others = {
        each.kind
        for each in scene.excitations
        if not isinstance(each, RecordedNoise | ConstantLoad) and each not in drives
    }
    found += [
        f"excitation must be record, constant, impulses or a DriveFunction, got {kind}: random "
        "noise cannot be replayed, and a sine or a shock belongs in the record"
        for kind in sorted(others)
    ]
    if len({each.record.sampling for each in records}) > 1:
        found.append("all records must have the same sampling rate, length and gaps")
    if len(model.coordinates) > 1 and not in_steps(model):
        found += [
            f"impact_pair {pair.name}: the position of rest must lie between the stops"
            for pair, place in zip(model.pairs, model.mean_gaps, strict=True)
            if any(stop.deflection(place) > 0.0 for stop in pair.stops)
        ]
    return found


class RecordOnStructure(NamedTuple):
    """A record of a scene on its structure.

    Parameters
    ----------
    noise
        The record.
    force
        (n,), force on the coordinates per unit of its values.
    axis
        Number of the axis of the base that it moves; None for a force.
    table, direction
        Its density, and the force per unit of that.
    """

    noise: RecordedNoise
    force: Vector
    axis: int | None
    table: Table
    direction: Force


def records_of(scene: Scene, model: Model) -> list[RecordOnStructure]:
    """The records of a scene, in their order; a kurtosis that is stated does not change them."""
    found = []
    tables = iter(model.tables)
    peaks = ((drawn.table, d) for drawn, d in model.drawn if isinstance(drawn, FastPeaks))
    noises = [each for each in scene.excitations if isinstance(each, DensityNoise)]
    for each in noises:
        table, direction = next(peaks if each.has_fast_peaks else tables)
        if not isinstance(each, RecordedNoise):
            continue
        axis = None
        force = direction
        if scene.place(each) == BASE:
            axis = list(model.base).index(each.axis or "")
            force = inertia_of(model.mass, model.base_rows[:, axis])
        found.append(RecordOnStructure(each, np.asarray(force), axis, table, direction))
    return found


def shaking_of(records: Sequence[RecordOnStructure], model: Model) -> list[SampledExcitation]:
    """Records of one length and rate as forces on the coordinates, a part for each segment."""
    first = records[0].noise.record
    forces = np.zeros((len(first.values), len(model.coordinates)))
    base = np.zeros((len(first.values), len(model.base)))
    for noise, weights, axis, *_ in records:
        forces += np.outer(noise.record.values, weights)
        if axis is not None:
            base[:, axis] += noise.record.values
    cuts = np.cumsum(first.lengths)[:-1]
    return [
        SampledExcitation(step=1.0 / first.fs, forces=force, base=acceleration)
        for force, acceleration in zip(np.split(forces, cuts), np.split(base, cuts), strict=True)
    ]


def with_clearance(model: Model, clearance: float, rest: float) -> Model:
    """The model with the stops of its one pair at a distance (m) from the static equilibrium, which
    is at `rest`."""
    (pair,) = model.pairs
    stops = tuple(Stop(stop.side, rest + stop.side * clearance, stop.law) for stop in pair.stops)
    return changed(model, pairs=(changed(pair, stops=stops),))


def _answer_at(
    way: Way,
    clearance: float | None,
    segments: Sequence[SampledExcitation],
    seed: int,
    parts: int,
) -> ReplayAt:
    """The answer at one clearance, of all segments together."""
    model = way.model
    motions = [way.move(each, seed + number, parts) for number, each in enumerate(segments)]
    starts = np.cumsum([0.0, *(each.step * len(each.base) for each in segments)])
    for motion, begin in zip(motions, starts, strict=False):
        motion.impacts[:, 0] += begin
    impacts = np.concatenate([motion.impacts for motion in motions])
    owners = [(pair, stop) for pair in model.pairs for stop in pair.stops]
    hit = [owners[int(number)] for number in impacts[:, 1]]
    table: Any = {
        "time": impacts[:, 0],
        "pair": [pair.name for pair, _ in hit],
        "side": [stop.name for _, stop in hit],
        "speed": impacts[:, 2],
        "peak_force": [
            math.nan if stop.rigid else force
            for (_, stop), force in zip(hit, impacts[:, 3], strict=True)
        ],
    }
    found = ReplayAt(
        clearance=clearance,
        stops={f"{pair.name} {stop.name}": stop.position for pair, stop in owners},
        coordinates={
            name: _coordinate(motions, number) for number, name in enumerate(model.outputs)
        },
        impact_pairs={pair.name: _pair(model, pair, motions, impacts) for pair in model.pairs},
        impacts=table,
        histories=_histories(model, motions, segments, starts)
        if len(motions[0].displacement)
        else None,
    )
    still = {
        name: replace(found.coordinates[name], displacement_kurtosis=None) for name in found.still
    }
    return replace(found, coordinates={**found.coordinates, **still})


def _estimate(value: float) -> Estimate:
    return Estimate(value=float(value), how=EXACT)


def _coordinate(motions: Sequence[Motion], number: int) -> CoordinateReplay:
    samples = sum(motion.samples for motion in motions)
    one, two, three, four = sum(motion.powers[number] for motion in motions) / samples
    variance = max(two - one**2, 0.0)
    fourth = four - 4.0 * one * three + 6.0 * one**2 * two - 3.0 * one**4
    return CoordinateReplay(
        displacement_max=_estimate(max(motion.highest[number] for motion in motions)),
        displacement_min=_estimate(min(motion.lowest[number] for motion in motions)),
        displacement_mean=_estimate(one),
        displacement_std=_estimate(math.sqrt(variance)),
        displacement_kurtosis=_estimate(fourth / variance**2) if variance > 0.0 else None,
        acceleration_max=_estimate(max(motion.largest_acceleration[number] for motion in motions)),
    )


def _pair(
    model: Model, pair: Pair, motions: Sequence[Motion], impacts: NDArray[np.float64]
) -> PairReplay:
    owners = [(each, stop) for each in model.pairs for stop in each.stops]
    own = [number for number, (each, _) in enumerate(owners) if each is pair]
    mine = impacts[np.isin(impacts[:, 1], own)]
    by_side = {owners[number][1].name: _estimate(np.sum(mine[:, 1] == number)) for number in own}
    return PairReplay(
        hits=_estimate(len(mine)),
        hits_lower=by_side.get("lower"),
        hits_upper=by_side.get("upper"),
        impact_speed_max=_estimate(mine[:, 2].max()) if len(mine) else None,
        impact_speed_mean=_estimate(mine[:, 2].mean()) if len(mine) else None,
        peak_force=_estimate(mine[:, 3].max()) if len(mine) and not pair.rigid else None,
        contact_time=_estimate(sum(motion.contact_time[own].sum() for motion in motions)),
        rests=_estimate(sum(motion.rests[own].sum() for motion in motions)),
    )


def _histories(
    model: Model, motions: Sequence[Motion], segments: Sequence[SampledExcitation], starts: Vector
) -> Histories:
    times = [
        begin + each.step * np.arange(len(each.base))
        for each, begin in zip(segments, starts, strict=False)
    ]
    owners = [f"{pair.name} {stop.name}" for pair in model.pairs for stop in pair.stops]

    def columns(quantity: str, names: Sequence[str]) -> dict[str, Vector]:
        together = np.concatenate([getattr(motion, quantity) for motion in motions])
        return {name: together[:, number] for number, name in enumerate(names)}

    return Histories(
        time=np.concatenate(times),
        base_acceleration=np.concatenate([each.base for each in segments]).squeeze(axis=1)
        if len(model.base) == 1
        else np.concatenate([each.base for each in segments]),
        displacement=columns("displacement", model.outputs),
        velocity=columns("velocity", model.outputs),
        acceleration=columns("acceleration", model.outputs),
        force=columns("force", owners),
    )


def doubts_of(scene: Scene) -> list[str]:
    """Sentences on what makes the records of a scene doubtful themselves, such as a cut-off."""
    records = (each for each in scene.excitations if isinstance(each, RecordedNoise))
    return list(dict.fromkeys(doubt for each in records for doubt in each.doubts()))


def _without_samples(numbers: int, keep: bool) -> list[str]:
    """A sentence where the samples of x(t) are too many to be kept."""
    if keep:
        return []
    return [
        f"The samples of x(t) are not kept: {numbers:.2g} of them would not fit into memory. "
        "Ask for fewer clearances."
    ]


def _without_mean(scene: Scene, model: Model, answer: ReplayAt) -> list[str]:
    """A sentence where the mean of the record, which is taken off, would move the structure
    noticeably: that of a shock is part of it."""
    remedy = (
        "If the record is a shock, append zeros; an offset of the sensor or gravity needs nothing."
    )
    records = [each.noise.record for each in records_of(scene, model)]
    if nonlinear(_without_drives(model)):
        share = max(abs(each.mean) / (np.abs(each.values).max() or 1.0) for each in records)
        told = f"The mean of a record, {100.0 * share:.2g} % of its largest value, is taken off. "
        return [told + remedy] if share > NOTICED_MEAN else []
    force = sum(each.noise.record.mean * each.force for each in records_of(scene, model))
    moved = np.abs(np.linalg.lstsq(model.stiffness, force, rcond=None)[0])
    found = []
    for name, each in zip(model.coordinates, moved.tolist(), strict=True):
        largest = answer.coordinates[name].displacement_max.value
        if each > NOTICED_MEAN * largest:
            found.append(
                f"The mean of the record is taken off. It alone would move {name} by "
                f"{1e3 * each:.3g} mm, {100.0 * each / largest:.2g} % of its largest displacement. "
                + remedy
            )
    return found


def _of_drives(seed: int) -> str:
    return (
        f"Pulses and random forces are drawn (seed {seed}): another seed is another realisation "
        "beside the same record. An impulse lasts two of its sampling intervals."
    )


def _of_steps(found: Sequence[ReplayAt]) -> str:
    """How far the numbers of a replay in steps depend on them."""
    worst, which, how = 0.0, "", ""
    for each in found:
        for owner, name, own in each.estimates():
            how = own.how
            share = (own.bias or 0.0) / abs(own.value) if own.value else 0.0
            if name in LARGEST and share > worst:
                worst, which = share, f" ({name} of {owner})"
    return (
        f"Functions of the motion and friction at stops are followed in steps ({how}). At twice "
        f"the step the largest motions, forces and speeds differ by {100.0 * worst:.2g} % at most"
        f"{which}."
    )


def assumptions_of(scene: Scene, model: Model, segments: int, seed: int) -> tuple[str, ...]:
    """What a replay takes for granted, in sentences."""
    found = [
        "The record is linear between its samples, and its mean is taken off.",
        "The motion starts from rest"
        + (", anew in each segment of the record." if segments > 1 else "."),
    ]
    if any(isinstance(each, RecordedNoise) and each.band_hz for each in scene.excitations):
        found.append(
            "A straight line, and frequencies outside band_hz, are taken off the record, as for "
            "its density."
        )
    if model.scattered:
        found.append(
            f"Restitutions that scatter are drawn at each impact (seed {seed}): another seed is "
            "another realisation of the same record."
        )
    if any(stop.rigid for stop in model.stops):
        found.append(
            "Rigid stops: the largest acceleration is that between impacts; an impact takes no "
            "time, and only a stop with a stiffness has a peak acceleration."
        )
    return (*found, *scene.at_means())
