"""Equipment on the motion of a measured record itself, with the stops and without.

The record is replayed in exact steps, as `stochvi.replay` does, on a grid that resolves equipment
and contacts. Accelerations are linear between samples of the record, so that a finer grid is the
same excitation. Nothing is random: spectra are those of this record, repeated as often as the
mission takes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stochvi.mathematics.arrays import Matrix, Vector
from stochvi.methods.monte_carlo.kernels.equipment import BEFORE, NODES
from stochvi.methods.replay.kernel import SPEED, STOP, TIME
from stochvi.methods.replay.march import Motion, integrate, rest_of
from stochvi.methods.replay.method import records_of, shaking_of, unmet
from stochvi.model.coverage import nonlinear, rubbing
from stochvi.model.model import Model, Pair, Stop
from stochvi.results.errors import NotApplicable
from stochvi.results.estimates import Estimate
from stochvi.scenes.scene import Scene
from stochvi.statistics.damage.answer import EquipmentSpectra, Shocks, SpectrumValues
from stochvi.statistics.damage.equipment import Equipment
from stochvi.statistics.damage.hits import HOUR, RARE, DamageHits
from stochvi.statistics.damage.records import (
    CONTACT_SAMPLES,
    MOST_SAMPLES,
    contact_time,
    contacts_above,
    squares_below,
)

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
                [
                    f"a record of {self.duration:.3g} s at steps of {self.step:.2g} s needs "
                    f"{self.duration / self.step:.2g} samples, at most {MOST_SAMPLES} are made; "
                    "ask for equipment in a narrower band (equipment), or for a part of the record"
                ],
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
        times, count = mission / self.duration, len(self.equipment.frequency_hz)
        share = np.array([len(each.acceleration) for each in records], dtype=float)
        share /= share.sum()
        peaks = np.concatenate([each.peaks for each in found])
        struck = np.concatenate([each.struck for each in found])
        wear = times * np.sum([each.damage for each in found], axis=0)
        rms = np.sqrt(share @ np.array([each.squares for each in found]))
        below = np.sqrt(share @ np.array([each.below for each in found]))
        largest = peaks.max(axis=0)

        def known(value: Vector, power: float = 1.0) -> SpectrumValues:
            return SpectrumValues(
                value=value, standard_error=np.zeros(count), bias=power * resolved * value
            )

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

        def hourly(value: float) -> Estimate:
            return Estimate(value=value * HOUR / self.duration, bias=0.0, how=HOW)

        return DamageHits(
            shocks=shocks, impacts_per_hour=hourly(float(count)),
            contacts_above={
                f"{level:g}": hourly(float(number))
                for level, number in zip(levels, above, strict=True)
                if not self.model.rigid
            },
            work_per_hour=hourly(work), loss_per_hour=hourly(loss),
        )  # fmt: skip


class _Responses(NamedTuple):
    damage: Vector
    squares: Vector
    below: Vector
    peaks: Matrix
    struck: NDArray[np.bool_]
