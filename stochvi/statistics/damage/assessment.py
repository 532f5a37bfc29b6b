"""`damage`: equipment that a scene shakes, with its stops and without. Chapters: equipment on a
replayed record; the spectra of damage, extremes and shocks."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from types import MappingProxyType
from typing import Any, Literal, NamedTuple, Unpack

import numpy as np
from numpy.typing import NDArray

from stochvi.mathematics.numerics import Matrix, Vector
from stochvi.mathematics.units import shown
from stochvi.methods.replay.kernel import SPEED, STOP, TIME
from stochvi.methods.replay.march import Motion, integrate, rest_of
from stochvi.methods.replay.recorded_motion import (
    assumptions_of,
    doubts_of,
    records_of,
    shaking_of,
    unmet,
)
from stochvi.model.coverage import free_motion, modulated, nonlinear, rubbing
from stochvi.model.model import Model, Pair, Stop, model_of
from stochvi.motion.choose_plan import HistoryPlan, check_price, plan_histories
from stochvi.motion.kernels.crossings_and_cycles import BEFORE, NODES
from stochvi.results.base import ROTATIONS
from stochvi.results.errors import Interrupted, NotApplicable, NotConverged, check_size
from stochvi.results.estimates import (
    Estimate,
    events_suffice,
    mean_and_error,
    provenance,
    student_factor,
)
from stochvi.sampling.calculations import AccuracyOptions, calculation
from stochvi.sampling.run import Run, Taken, sampled
from stochvi.scenes.scene import Scene
from stochvi.statistics.clusters import UNFINISHED, ClusterPaths
from stochvi.statistics.damage.equipment import (
    ENOUGH_WINDOWS,
    SAMPLES_PER_PERIOD,
    Damage,
    Equipment,
    EquipmentSpectra,
    GaussianAcceleration,
    GaussianEquipment,
    Shocks,
    SpectrumValues,
    largest_of_mission,
    ratio_of,
)
from stochvi.statistics.damage.missions import (
    check_test,
    equivalent_values,
    of_phases,
    tailored_test,
)
from stochvi.statistics.damage.simulated import (
    CONTACT_SAMPLES,
    HOUR,
    MOST_SAMPLES,
    RARE,
    ClusterPart,
    Clusters,
    ClusterSampler,
    DamageHits,
    DamageSampler,
    RecordPiece,
    Records,
    contact_time,
    contacts_above,
    damage_hits,
    hits_of_clusters,
    joined,
    sampled_for,
    squares_below,
)
from stochvi.statistics.histories import places_shaken, why_no_acceleration

# ------------------------------------------------------------------------------
# Equipment on the motion of a measured record itself, with the stops and without.
#
# The record is replayed in exact steps, as `stochvi.replay` does, on a grid that resolves equipment
# and contacts. Accelerations are linear between samples of the record, so that a finer grid is the
# same excitation. Nothing is random: spectra are those of this record, repeated as often as the
# mission takes.
# ------------------------------------------------------------------------------


HOW = "this record"
"""Source of numbers that have no statistical error."""


class RecordOfPlace(NamedTuple):
    """The motion of a place in one segment of a record.

    Parameters
    ----------
    acceleration, jumps
        (samples,): absolute acceleration, m/s^2, and sudden changes of velocity, m/s.
    forces
        (samples, stops): forces of the stops, N.
    impacts
        (impacts, 4): the log of `Motion`.
    lost
        (stops,): what each compliant stop takes, J.
    """

    acceleration: Vector
    jumps: Vector
    forces: Matrix
    impacts: Matrix
    lost: Vector


class Replayed:
    """The place of equipment under the records of a scene."""

    def __init__(self, scene: Scene, model: Model, place: str, equipment: Equipment) -> None:
        missing = dict.fromkeys(unmet(scene, model) + nonlinear(model) + rubbing(model))
        if missing:
            raise NotApplicable("damage by the record itself", list(missing))
        self.model, self.place, self.equipment = model, place, equipment
        segments = shaking_of(records_of(scene, model), model)
        self.duration = float(sum(each.step * (len(each.base) - 1) for each in segments))
        speeds = [0.0]
        if not model.rigid:  # faster contacts of Hertz's law and of tables are shorter
            coarse = [integrate(model, each, rest_of(model), keep=False) for each in segments]
            speeds += [float(each.impacts[:, SPEED].max(initial=0.0)) for each in coarse]
        longest = min(equipment.longest_step, contact_time(model, max(speeds)) / CONTACT_SAMPLES)
        self.half_rate = 0.5 / segments[0].step
        self.parts = math.ceil(segments[0].step / longest)
        self.step = segments[0].step / self.parts
        if self.duration / self.step > MOST_SAMPLES:
            raise NotApplicable(
                "damage by the record itself",
                f"a record of {self.duration:.3g} s at steps of {self.step:.2g} s needs "
                f"{self.duration / self.step:.2g} samples, at most {MOST_SAMPLES} are made; "
                "ask for equipment in a narrower band (equipment), or for a part of the record",
            )
        self.segments = [each.refined(self.parts) for each in segments]

    @property
    def stops(self) -> list[tuple[Pair, Stop]]:
        """The stops in the order of the log of impacts, each with its pair."""
        return [(pair, stop) for pair in self.model.pairs for stop in pair.stops]

    @property
    def window(self) -> int:
        """Samples of a window, the memory of the equipment."""
        return math.ceil(self.equipment.memory / self.step)

    def records(self) -> list[RecordOfPlace]:
        """The motion of the place in each segment."""
        found = []
        for each in self.segments:
            motion = integrate(self.model, each, rest_of(self.model))
            number = self.model.outputs.index(self.place)
            jumps = self._jumps(motion)
            found.append(
                RecordOfPlace(
                    motion.acceleration[:, number],
                    jumps,
                    motion.force,
                    motion.impacts,
                    motion.lost,
                )
            )
        return found

    def _jumps(self, motion: Motion) -> Vector:
        """Sudden changes of the velocity of the place by impacts on rigid stops, at the samples
        before them, m/s."""
        model, jumps = self.model, np.zeros(motion.samples)
        row = np.asarray(model.output_rows[model.outputs.index(self.place)])
        moved = row @ np.linalg.inv(model.mass)
        for number, (pair, stop) in enumerate(self.stops):
            if not stop.rigid:
                continue
            own = motion.impacts[motion.impacts[:, STOP] == number]
            impulse = pair.mass * own[:, SPEED] * (1.0 + stop.restitution_at(own[:, SPEED]))
            place = np.minimum((own[:, TIME] / self.step).astype(int), motion.samples - 1)
            np.add.at(jumps, place, -stop.side * impulse * float(moved @ pair.direction))
        return jumps

    def spectra(
        self, records: Sequence[RecordOfPlace], mission: float, resolved: Vector
    ) -> tuple[EquipmentSpectra, Shocks | None]:
        """Spectra of a mission in which the record is repeated, and shocks of its impacts.

        Parameters
        ----------
        resolved
            Relative error that the sampling leaves in amplitudes, by frequency.
        """
        found = [self._respond(each) for each in records]
        times = mission / self.duration
        share = np.array([len(each.acceleration) for each in records], dtype=float)
        share /= share.sum()
        peaks = np.concatenate([each.peaks for each in found])
        struck = np.concatenate([each.struck for each in found])
        wear = times * np.sum([each.damage for each in found], axis=0)
        rms = np.sqrt(share @ np.array([each.squares for each in found]))
        below = np.sqrt(share @ np.array([each.below for each in found]))
        largest = peaks.max(axis=0)

        def known(value: Vector, power: float = 1.0) -> SpectrumValues:
            return SpectrumValues.of(value, bias=power * resolved * value)

        spectra = EquipmentSpectra(
            response_rms=known(rms), extreme_response=known(largest), extreme_lower=largest,
            extreme_upper=largest, fatigue_damage=known(wear, self.equipment.exponent),
            cumulative_rms=known(below),
        )  # fmt: skip
        shocks = None
        if struck.any():
            shocks = Shocks(
                typical=np.median(peaks[struck], axis=0),
                worst=np.quantile(peaks[struck], 1.0 - RARE, axis=0),
                window=self.window * self.step, windows=int(struck.sum()),
            )  # fmt: skip
        return spectra, shocks

    def _respond(self, record: RecordOfPlace) -> _Responses:
        """Responses to a segment, and their ringing after its end."""
        samples, window = len(record.acceleration), self.window
        windows = math.ceil(samples / window) + 1
        pads = (BEFORE, windows * window + NODES - samples)
        padded, jumps = (np.pad(each, pads)[None] for each in (record.acceleration, record.jumps))
        answer = self.equipment.respond(padded, self.step, BEFORE, window, windows, jumps)
        struck = np.zeros(windows, bool)
        struck[(record.impacts[:, TIME] / self.step).astype(int) // window] = True
        whole = (record.acceleration + record.jumps / self.step)[None]
        return _Responses(
            damage=(answer.damage + answer.closing)[0],
            squares=answer.squares[0] * (windows * window / samples),
            below=squares_below(whole, self.equipment.frequency_hz, self.step)[0],
            peaks=answer.peaks[0], struck=struck,
        )  # fmt: skip

    def hits(
        self, records: Sequence[RecordOfPlace], levels: Sequence[float], shocks: Shocks | None
    ) -> DamageHits:
        """Impacts of the record, their energy and accelerations."""
        count, work, loss, above = 0, 0.0, 0.0, np.zeros(len(levels))
        for record in records:
            count += len(record.impacts)
            for number, (pair, stop) in enumerate(self.stops):
                speed = record.impacts[record.impacts[:, STOP] == number, SPEED]
                energy = 0.5 * pair.mass * speed**2
                work += float(energy.sum())
                if stop.rigid:
                    loss += float(energy @ (1.0 - stop.restitution_square_at(speed)))
                else:
                    loss += float(record.lost[number])
                if levels and not stop.rigid:
                    above += contacts_above(record.forces[:, number], record.acceleration, levels)

        def hourly(value: Any, events: bool = True) -> Estimate:
            return Estimate(value=float(value) * HOUR / self.duration, bias=0.0, how=HOW)

        soft = () if self.model.rigid else levels
        return damage_hits(hourly, shocks, soft, count, work, loss, above)


class _Responses(NamedTuple):
    damage: Vector
    squares: Vector
    below: Vector
    peaks: Matrix
    struck: NDArray[np.bool_]


# ------------------------------------------------------------------------------
# Damage, extremes and shocks of equipment that a scene shakes, with its stops and without.
# ------------------------------------------------------------------------------


PER_OCTAVE = 6.0
"""Number of frequencies of the equipment in an octave, where its ends alone are given."""

MOST_FREQUENCIES = 1000
"""Largest number of frequencies of the equipment."""

Way = Literal["simulation", "clusters", "record"]

FEWEST_CLUSTER_PATHS = 16
"""Smallest number of paths of clusters, each with some ten of them."""

FEWEST_PATHS = 16
"""Smallest number of paths from which a standard error is taken."""

MOST_UNSEEN = 1024
"""Number of paths after which a simulation ends that has seen too few impacts for an error."""

HOLD_ERROR = 1.5e-3
"""Relative error of the amplitude of equipment at `SAMPLES_PER_PERIOD` samples per period, by the
polynomial between samples and by that of peaks; it falls with the fourth power of the step."""

WHOLE = 0.95
"""Share of missions whose largest response lies in the range that is stated."""

MOST_QUALITY, MOST_EXPONENT = 1e4, 30.0
"""Largest quality and exponent of the equipment."""


@calculation
@sampled(rel_error=0.2)
def damage(
    scene: Scene,
    *,
    mission: float | None = None,
    equipment: Sequence[float] | Vector = (20.0, 2000.0),
    q: float = 10.0,
    exponent: float = 6.0,
    at: str | None = None,
    levels: Sequence[float] = (),
    way: Way | None = None,
    test_duration: float | None = None,
    breakpoints: int = 12,
    **options: Unpack[AccuracyOptions],
) -> Damage:
    """Response, fatigue and shock spectra of equipment on a place, with stops and without.

    Equipment stands on a coordinate or point with the absolute acceleration a, so that
    z'' + (w / Q) z' + w^2 z = -a. Its natural frequency is f_n = w / (2 pi). Its response is the
    absolute acceleration a + z''; its stress is proportional to the pseudo-velocity w z. The
    damage of the mission is Miner's sum of S^b over the rainflow cycles of w z with the amplitudes
    S. An impact on a rigid stop is a sudden change of velocity, to which equipment responds
    exactly.

    Parameters
    ----------
    scene
        Any scene that `simulate` covers whose acceleration is known: shaken by its base, or by
        tables of force.
    mission
        Duration, s; left out where the scene has phases, whose damage adds up. By the record
        itself, which the mission repeats, it is the length of the record if left out.
    equipment
        Lowest and highest natural frequency, Hz, with six frequencies per octave between them; or
        one frequency, or three and more in rising order; or an array of any number, which holds
        all of them.
    q, exponent
        Quality Q = 1 / (2 zeta) of the equipment, and exponent b of its fatigue.
    at
        The coordinate or point on which it stands; by default the first coordinate.
    levels
        Accelerations, m/s^2: contacts with compliant stops above each of them are counted.
    way
        "simulation" of everything, or "clusters" of impacts, simulated from their first one on and
        added to the Gaussian motion. By default clusters, where impacts are rare. "record" follows
        a measured record itself, sample by sample, and takes it for no noise.
    test_duration, breakpoints
        Duration, s, of a random test that does the same damage to the equipment, and the largest
        number of breakpoints of its profile, from 2 to 100.
    **options
        `AccuracyOptions`: `rel_error` is the median relative standard error of the damage, by
        default 0.2, which is 3 % of the stress at b = 6; `seed`, `threads`, `executor`, `budget`,
        `progress`, `checkpoint`, `resume`.

    Returns
    -------
    Damage
        Spectra with their errors, and the impacts.

    Raises
    ------
    NotApplicable
        If `simulate` does not cover the scene, or records hold no acceleration.
    NotConverged
        If time ends first; it carries the answer so far.
    ValueError
        If an argument is out of range.

    See Also
    --------
    stochvi.spectrum : Densities of the motion.
    stochvi.impacts : Statistics of the impacts.

    Examples
    --------
    >>> from stochvi import Isolator, TabulatedNoise
    >>> truck = TabulatedNoise(profile="mil-std-810h-truck-vertical-5hz")
    >>> mount = Scene(structure=Isolator(frequency_hz=12.0, zeta=0.1), excitations=[truck])
    >>> found = damage(mount, mission=3600.0, equipment=[50.0, 100.0, 200.0])
    >>> found.with_stops.response_rms.value.round(1).tolist()
    [12.5, 11.7, 11.6]
    """
    asked = Equipment(_frequencies(equipment), float(q), float(exponent))
    _check(q, exponent, levels)
    check_test(test_duration, breakpoints)
    run = Run.of(options)
    if scene.phases and mission is not None:
        raise ValueError(f"mission must be left out where the scene has phases, got {mission}")
    known = mission is not None and 0.0 < mission < math.inf
    if not (scene.phases or known or (mission is None and way == "record")):
        raise ValueError(
            f"mission must be a positive number of seconds, got {mission}; an hour is 3600 in "
            "Python, --mission 1h on the command line"
        )

    def of_part(part: Scene, duration: float, its_run: Run) -> Damage:
        model = model_of(part)
        place, driven = _place(model, at), _driven(part, model)
        question = _Question(part, model, place, asked, duration, driven, tuple(levels), its_run)
        return question.solved(way)

    try:
        if scene.phases:
            found = of_phases(scene, of_part, run)
        else:
            found = of_part(scene, float(mission or 0.0), run)
    except (NotConverged, Interrupted) as reason:
        if reason.partial is not None and test_duration is not None:
            test = tailored_test(reason.partial, test_duration, breakpoints)
            reason.partial = replace(reason.partial, test=test)
        raise
    if test_duration is None:
        return found
    return replace(found, test=tailored_test(found, test_duration, breakpoints))


@dataclass(frozen=True)
class _Question:
    """The question, and the ways to its answer."""

    scene: Scene
    model: Model
    place: str
    equipment: Equipment
    mission: float
    driven: bool
    levels: tuple[float, ...]
    run: Run

    @property
    def row(self) -> Vector:
        """The place as row . q."""
        model = self.model
        return np.asarray(model.output_rows[model.outputs.index(self.place)])

    def by_record(self) -> Damage:
        """The answer of the record itself, which the mission repeats."""
        with_stops = Replayed(self.scene, self.model, self.place, self.equipment)
        resolved = self._amplitude_error_at(with_stops.step)
        records = with_stops.records()
        question = replace(self, mission=self.mission or with_stops.duration)
        spectra, shocks = with_stops.spectra(records, question.mission, resolved)
        hits, without = None, spectra
        if self.model.pairs:
            hits = with_stops.hits(records, self.levels, shocks)
            free = self.scene.replace(impact_pairs=())
            alone = Replayed(free, model_of(free), self.place, self.equipment)
            error = self._amplitude_error_at(alone.step)
            without, _ = alone.spectra(alone.records(), question.mission, error)
        work = {
            "paths": 1,
            "steps": sum(len(each.acceleration) for each in records),
            "impacts": sum(len(each.impacts) for each in records),
        }
        found = question.answer(spectra, without, ("record", "record"), hits, work)
        known = assumptions_of(self.scene, self.model, len(records), 0)
        half_rate = with_stops.half_rate
        return replace(
            found,
            warnings=doubts_of(self.scene) + ([
                f"the record says nothing above {half_rate:.4g} Hz, half its sampling rate: faster "
                "equipment answers to the straight lines between its samples"
            ] if self.equipment.frequency_hz[-1] > half_rate else []),
            assumptions=(
                "the mission repeats this record: another one of the same road differs",
                *(each[0].lower() + each[1:].rstrip(".") for each in known),
            ),
        )  # fmt: skip

    def solved(self, way: Way | None) -> Damage:
        """The answer, by the record, by the density, by clusters, or by simulation."""
        if way == "record":
            return self.by_record()
        gaussian = self.gaussian()
        if gaussian is not None and not self.model.pairs:
            spectra = self.by_density(gaussian)
            return self.answer(spectra, spectra, ("density", "density"))
        without, way_without = None, None
        if gaussian is not None:
            without, way_without = self.by_density(gaussian), "density"
        elif self.model.pairs:
            without = self.without_stops()
            way_without = None if without is None else "simulation"
        if (found := self.by_clusters(gaussian, without, way)) is not None:
            return found
        sampler, taken = self.simulated(self.scene, self.model)
        records = Records(sampler, joined(taken.sample))
        spectra = self.of_records(*records)
        if not self.model.pairs:
            without, way_without = spectra, "simulation"
        hits = records.hits(self.levels) if self.model.pairs else None
        return self.told(
            self.answer(spectra, without, ("simulation", way_without), hits, records.work), taken
        )

    def gaussian(self) -> GaussianEquipment | None:
        """Equipment on the Gaussian motion without stops; None where there is none."""
        steady = replace(self.model, level=None)
        try:
            density = GaussianAcceleration(steady, tuple(self.row.tolist()))
        except NotApplicable:
            return None
        memory = 1.0 / float(np.min(np.diag(steady.modal.damping)))
        return GaussianEquipment(
            density, density.edges, self.equipment, self.model.level, memory
        )  # fmt: skip

    def without_stops(self) -> EquipmentSpectra | None:
        """Spectra by simulation of the scene without its stops; None where it does not stay."""
        free = self.scene.replace(impact_pairs=())
        try:
            sampler, taken = self.simulated(free, model_of(free))
        except NotApplicable:
            return None
        return self.of_records(sampler, joined(taken.sample))

    def simulated(
        self, scene: Scene, model: Model
    ) -> tuple[DamageSampler, Taken[list[RecordPiece]]]:
        """Records until the damage is accurate enough."""
        plan = sampled_for(plan_histories(scene, self.run.deadline), self.equipment)
        if self.driven and plan.plan.drive(self.run.seed, 0, 2, 0) is None:
            raise _unknown(why_no_acceleration(model, False))
        sampler = DamageSampler(
            plan, self.equipment, tuple(self.row.tolist()), self.driven, self.levels, self.run.seed
        )
        plan.plan.shortest().histories(self.run.seed, 0, 2, samples=2)
        check_price([plan.plan], self.run.seed, self.run.deadline)
        scatter = scatter_of_impacts(self.equipment.exponent)
        error = partial(_median_error, scatter) if model.pairs else _error_of_damage

        def error_with_tail(pieces: list[RecordPiece]) -> float:
            seen = sum(len(piece.hits) for piece in pieces) * sampler.windows
            return max(error(pieces), self.run.accuracy * math.sqrt(ENOUGH_WINDOWS / seen))

        taken = self.run.to_accuracy(
            sampler, FEWEST_PATHS, error_with_tail, self.run.accuracy, MOST_UNSEEN, needed=2
        )
        # time that ends before there are enough windows leaves a wider interval, no refusal
        enough = sampler.paths(taken.sample) >= FEWEST_PATHS and (
            error(taken.sample) <= self.run.accuracy
        )
        return sampler, replace(taken, enough=taken.enough or enough)

    def of_records(self, sampler: DamageSampler, sample: RecordPiece) -> EquipmentSpectra:
        """Spectra by records."""
        paths, resolved = len(sample.hits), self._amplitude_error(sampler.plan)
        factor = student_factor(paths) / math.sqrt(paths)

        def averaged(rows: Matrix) -> tuple[Vector, Vector]:
            return rows.mean(axis=0), factor * rows.std(axis=0, ddof=1)

        times = self.mission / sampler.seconds
        wear, wear_error = averaged(times * sample.damage)
        ends = np.abs(times * sample.halving.mean(axis=0))
        squares, square_errors = averaged(sample.squares)
        below, below_errors = averaged(sample.below)
        rms, own = np.sqrt(squares), np.sqrt(below)
        tail = (1.0 - WHOLE) / 2.0
        windows = self.mission / (sampler.window * sampler.plan.step)
        largest = largest_of_mission(sample.peaks, windows, (tail, 1.0 - tail))
        return EquipmentSpectra(
            response_rms=SpectrumValues.of(rms, square_errors / (2.0 * rms), resolved * rms),
            extreme_response=SpectrumValues.of(
                largest.value, largest.standard_error, largest.bias + resolved * largest.value
            ),
            extreme_lower=largest.levels[0], extreme_upper=largest.levels[1],
            fatigue_damage=SpectrumValues.of(
                wear, wear_error, ends + self.equipment.exponent * resolved * wear
            ),
            cumulative_rms=SpectrumValues.of(
                own, below_errors / (2.0 * np.maximum(own, np.finfo(float).tiny)), resolved * own
            ),
        )  # fmt: skip

    def _amplitude_error(self, plan: HistoryPlan) -> Vector:
        """Relative error that the sampling leaves in amplitudes, by frequency."""
        found = self._amplitude_error_at(plan.step)
        if plan.plan.kicked:
            found += (self.equipment.omega * plan.step) ** 2 / 12.0
        return found

    def _amplitude_error_at(self, step: float) -> Vector:
        """The same of a sampling interval without kicks."""
        f = np.array(self.equipment.frequency_hz)
        return np.asarray(HOLD_ERROR * (SAMPLES_PER_PERIOD * f * step) ** 4)

    def by_density(self, gaussian: GaussianEquipment) -> EquipmentSpectra:
        """Spectra of the Gaussian motion without stops."""
        wear, error = gaussian.damage_rates()
        tail = (1.0 - WHOLE) / 2.0
        largest, bias, levels = gaussian.extremes(self.mission, (tail, 1.0 - tail))

        return EquipmentSpectra(
            response_rms=SpectrumValues.of(gaussian.rms),
            extreme_response=SpectrumValues.of(largest, bias=bias),
            extreme_lower=levels[0], extreme_upper=levels[1],
            fatigue_damage=SpectrumValues.of(self.mission * wear, bias=self.mission * error),
            cumulative_rms=SpectrumValues.of(np.sqrt(gaussian.cumulative_square())),
        )  # fmt: skip

    def by_clusters(
        self, gaussian: GaussianEquipment | None, without: EquipmentSpectra | None, way: Way | None
    ) -> Damage | None:
        """The answer by clusters of impacts; None where these are not rare, or not known."""
        varies = self.model.level is not None
        if gaussian is None or without is None or self.driven or varies or way == "simulation":
            if way == "clusters":
                raise NotApplicable("damage", "clusters need Gaussian noise of the base alone")
            return None
        sampler = self._cluster_sampler(way)
        if sampler is None:
            return None

        def error_of(parts: list[ClusterPart]) -> float:
            extra, error = Clusters.of(sampler, parts).rates(
                np.concatenate([part.damage for part in parts])
            )
            total = without.fatigue_damage.value / self.mission + extra
            return float(np.median(error / np.abs(total)))

        taken = self.run.to_accuracy(
            sampler, FEWEST_CLUSTER_PATHS, error_of, self.run.accuracy, needed=max(sampler.block, 2)
        )
        found = Clusters.of(sampler, taken.sample)
        if not found.apart and way is None:
            return None
        work = {"paths": taken.paths, "impacts": int(found.part.hits.sum())}
        work["steps"] = taken.paths * sampler.clusters.motion.response.samples
        answer = self.answer(
            self._of_clusters(found, gaussian, without), without, ("clusters", "density"),
            hits_of_clusters(found, self.levels), work,
        )  # fmt: skip
        return self.told(answer, taken)

    def _cluster_sampler(self, way: Way | None) -> ClusterSampler | None:
        """Clusters of the scene; None where they cannot be apart."""
        try:
            speed = float(np.max(free_motion(self.model).deviations(
                np.array([pair.direction for pair in self.model.pairs])
            )[1]))  # fmt: skip
            step = min(
                self.equipment.longest_step, contact_time(self.model, speed) / CONTACT_SAMPLES
            )
            clusters = ClusterPaths(self.model, self.run.seed, longest_step=step)
            sampler = ClusterSampler(
                clusters, self.equipment, tuple(self.row.tolist()), self.levels
            )
            expected = sampler.seconds * float(clusters.records.rice_rates.sum())
            if expected == 0.0:
                unmet = "stops must be within reach, got none that is ever met; leave way out"
                raise NotApplicable("damage", unmet)
            if way is None and (expected > UNFINISHED or not sampler.fits):
                return None
        except NotApplicable:
            if way is None:
                return None
            raise
        return sampler

    def _of_clusters(
        self, found: Clusters, gaussian: GaussianEquipment, without: EquipmentSpectra
    ) -> EquipmentSpectra:
        """The spectra without stops, and what clusters add to them."""
        part, resolved = found.part, self._amplitude_error_at(found.sampler.step)
        tail = (1.0 - WHOLE) / 2.0
        extra, error = found.rates(part.damage)
        wear = without.fatigue_damage.value + self.mission * extra
        largest, largest_error, largest_bias, levels = found.extremes(
            gaussian, self.mission, (tail, 1.0 - tail)
        )

        def root(quantity: SpectrumValues, squares: Matrix) -> SpectrumValues:
            more, its_error = found.rates(squares)
            value = np.sqrt(np.maximum(quantity.value**2 + more, 0.0))
            return SpectrumValues.of(
                value, its_error / (2.0 * value), found.overlap * np.abs(more) / (2.0 * value)
            )

        return EquipmentSpectra(
            response_rms=root(without.response_rms, part.squares),
            extreme_response=SpectrumValues.of(
                largest, largest_error, largest_bias + resolved * largest
            ),
            extreme_lower=levels[0], extreme_upper=levels[1],
            fatigue_damage=SpectrumValues.of(
                wear, self.mission * error,
                without.fatigue_damage.bias + self.mission * np.abs(extra) * (
                    found.overlap + self.equipment.exponent * resolved
                ),
            ),
            cumulative_rms=root(without.cumulative_rms, part.below),
        )  # fmt: skip

    def told(self, found: Damage, taken: Taken[Any]) -> Damage:
        """The answer; `NotConverged` with it where it is not as accurate as asked for."""
        if taken.enough:
            return found
        warnings = [*found.warnings, "the accuracy asked for was not reached"]
        found = replace(found, warnings=warnings)
        asked, error = self.run.accuracy, found.relative_error
        if error <= asked:  # that of the motion between impacts
            where, remedy = "before enough impacts were seen for their damage", "raise budget"
        else:
            where = f"at a median relative standard error of {error:.2g}, asked for {asked:g}"
            remedy = "raise budget or rel_error"
        raise self.run.deadline.fell_short(where, remedy, found)

    def answer(
        self, spectra: EquipmentSpectra, without: EquipmentSpectra | None,
        ways: tuple[str, str | None], hits: DamageHits | None = None,
        work: Mapping[str, int] = MappingProxyType({}),
    ) -> Damage:  # fmt: skip
        """The answer, with all that follows from the spectra."""
        warnings = [*self.model.cautions]
        return Damage(
            equipment_frequency_hz=np.array(self.equipment.frequency_hz),
            quality=self.equipment.quality, exponent=self.equipment.exponent,
            mission=self.mission, at=self.place, with_stops=spectra, without_stops=without,
            damage_ratio=None if without is None else ratio_of(
                spectra.fatigue_damage, without.fatigue_damage
            ),
            equivalent_density=equivalent_values(
                self.equipment, spectra.fatigue_damage, self.mission
            ),
            shocks=hits and hits.shocks,
            impacts_per_hour=hits and hits.impacts_per_hour,
            contacts_above={} if hits is None else hits.contacts_above,
            impact_work_per_hour=hits and hits.work_per_hour,
            impact_loss_per_hour=hits and hits.loss_per_hour,
            way=ways[0], way_without=ways[1],
            scene_without_mass=not self.scene.expanded.structure.knows_mass,
            assumptions=self.scene.assumptions(), warnings=warnings,
            cost=self.run.cost(**work),
            provenance=provenance(self.scene.document(), self.run.seed),
        )  # fmt: skip


def _frequencies(equipment: Sequence[float] | Vector) -> tuple[float, ...]:
    """The frequencies of the equipment, Hz."""
    given = np.asarray(equipment, dtype=float).ravel()
    rising = len(given) > 0 and bool(np.all(np.diff(given) > 0.0))
    if not rising or given[0] <= 0.0 or not math.isfinite(given[-1]):
        raise ValueError(
            f"equipment must be rising frequencies (Hz), as (20, 2000), got {shown(equipment)}"
        )
    if len(given) == 2 and not isinstance(equipment, np.ndarray):
        number = round(PER_OCTAVE * math.log2(given[1] / given[0]))
        given = np.geomspace(given[0], given[1], min(max(number, 2), MOST_FREQUENCIES + 1))
    check_size(
        "the number of frequencies of equipment", len(given), MOST_FREQUENCIES, "ask for fewer"
    )
    return tuple(float(f) for f in given)


def _check(q: float, exponent: float, levels: Sequence[float]) -> None:
    if not 0.5 < q <= MOST_QUALITY:
        raise ValueError(f"q must be in (0.5, {MOST_QUALITY:g}], got {q}")
    if not 1.0 <= exponent <= MOST_EXPONENT:
        raise ValueError(f"exponent must be in [1, {MOST_EXPONENT:g}], got {exponent}")
    for level in levels:
        if not 0.0 < level < math.inf:
            raise ValueError(f"levels must be positive accelerations (m/s^2), got {level}")


def _place(model: Model, at: str | None) -> str:
    """The name of the coordinate or point."""
    lengths = [name for name in model.outputs if name not in ROTATIONS]
    if at is None:
        return lengths[0]
    if at not in lengths:
        known = ", ".join(repr(name) for name in lengths)
        raise ValueError(f"at must be a coordinate or point of the scene ({known}), got {at!r}")
    return at


def _driven(scene: Scene, model: Model) -> bool:
    """Whether tables shake masses, so that their force is a part of the acceleration."""
    if model.scattered:
        remedy = "restitution must not scatter, as impulses are not recorded; give its mean alone"
        raise NotApplicable("damage", remedy)
    if conditions := modulated(model) + rubbing(model):
        raise NotApplicable("damage", conditions)
    on_base, on_masses = places_shaken(scene)
    if model.remembers:
        why = f"{why_no_acceleration(model, on_base)}; give a spring without memory"
        raise NotApplicable("damage", why)
    if on_masses and (on_base or model.whites):
        raise _unknown(why_no_acceleration(model, on_base))
    return on_masses


def _unknown(why: str) -> NotApplicable:
    return NotApplicable("damage", f"the acceleration must be known: {why}; shake the base")


def scatter_of_impacts(exponent: float) -> float:
    """Mean square of w^b over its squared mean, for impact speeds w of Rayleigh's distribution:
    gamma(1 + b) / gamma(1 + b / 2)^2.

    >>> round(scatter_of_impacts(6.0), 9)
    20.0
    """
    return math.exp(math.lgamma(1.0 + exponent) - 2.0 * math.lgamma(1.0 + 0.5 * exponent))


def _median_error(scatter: float, pieces: list[RecordPiece]) -> float:
    """Median relative standard error of the damage; infinite before enough impacts were seen.

    The damage is that of the few hardest impacts, and records in which none was hard show neither
    it nor its scatter. The damage of n impacts has at least the error (scatter / n)^(1/2).
    """
    hits, error = mean_and_error(np.concatenate([piece.hits for piece in pieces]))
    paths = sum(len(piece.hits) for piece in pieces)
    if not hits or not events_suffice(hits, error, paths):
        return math.inf
    return max(_error_of_damage(pieces), math.sqrt(scatter / (hits * paths)))


def _error_of_damage(pieces: list[RecordPiece]) -> float:
    """Median relative standard error of the damage."""
    wear = np.concatenate([piece.damage for piece in pieces])
    error = wear.std(axis=0, ddof=1) / math.sqrt(len(wear))
    return float(np.median(error / wear.mean(axis=0)))
