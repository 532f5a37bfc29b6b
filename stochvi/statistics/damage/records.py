"""Damage by plain simulation: records of acceleration, and the equipment that stands on them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.fft import next_fast_len, rfft

from stochvi.mathematics.arrays import Matrix, Vector
from stochvi.methods.monte_carlo.history_plans import HistoryPlan
from stochvi.methods.monte_carlo.kernels.equipment import BEFORE, NODES
from stochvi.model.model import Model
from stochvi.results.errors import NotApplicable
from stochvi.sampling.sampler import ListSampler
from stochvi.scenes.impact_laws import CompliantLaw
from stochvi.statistics.accelerations import Accelerations, accelerations
from stochvi.statistics.damage.equipment import Equipment

CONTACT_SAMPLES = 8.0
"""Number of samples in a contact with a compliant stop."""

KICKS_PER_SAMPLE = 2.0
"""Steps of white noise, which acts in kicks, in the longest step of the equipment."""

LEAST_SECONDS, MEMORIES, RELAXATIONS = 10.0, 10.0, 20.0
"""Smallest length of a record: seconds, memories of the equipment and relaxation times."""

MOST_SAMPLES = 2**22
"""Largest number of samples of a record."""


class RecordPiece(NamedTuple):
    """What records of some paths give; rows are paths.

    Parameters
    ----------
    damage, halving, squares
        (paths, equipment): damage of records that repeat themselves, and the others of
        `EquipmentRecords`. A record is a piece of a long one, in which later cycles close its own.
    below
        (paths, equipment): mean square of the acceleration below each frequency, (m/s^2)^2.
    peaks
        (paths, windows, equipment): largest responses, m/s^2.
    struck
        (paths, windows): whether an impact begins in the window.
    hits, work, loss
        (paths,): number of impacts, energy with which they arrive, and what they lose of it, J.
    above
        (paths, levels): contacts with a larger acceleration than each level.
    """

    damage: Matrix
    halving: Matrix
    squares: Matrix
    below: Matrix
    peaks: NDArray[np.float64]
    struck: NDArray[np.bool_]
    hits: Vector
    work: Vector
    loss: Vector
    above: Matrix


@dataclass(frozen=True, eq=False)
class DamageSampler(ListSampler):
    """Records of one coordinate or point, `row` . q, and the equipment on them."""

    plan: HistoryPlan
    equipment: Equipment
    row: tuple[float, ...]
    driven: bool
    levels: tuple[float, ...]
    seed: int

    @property
    def block(self) -> int:
        """Number of paths that are recorded together."""
        return self.plan.block

    @property
    def first(self) -> int:
        """Sample from which on the equipment counts."""
        return BEFORE + math.ceil(self.equipment.memory / self.plan.step)

    @property
    def window(self) -> int:
        """Samples of a window, the memory of the equipment."""
        return math.ceil(self.equipment.memory / self.plan.step)

    @property
    def windows(self) -> int:
        """Number of windows of a record."""
        return max(1, (self.plan.samples - self.first - NODES) // self.window)

    @property
    def seconds(self) -> float:
        """Counted length of a record, s."""
        return self.windows * self.window * self.plan.step

    @cached_property
    def _counted(self) -> slice:
        return slice(self.first, self.first + self.windows * self.window)

    def simulate(self, first_path: int, paths: int) -> RecordPiece:
        """What these paths give."""
        row = np.array(self.row)
        found = accelerations(self.plan, row, self.seed, first_path, paths, self.driven)
        step = self.plan.step
        answer = self.equipment.respond(
            found.smooth, step, self.first, self.window, self.windows, found.jumps
        )
        struck, hits, work, loss = self._impacts(found, paths)
        return RecordPiece(
            damage=answer.damage + answer.closing, halving=answer.halving, squares=answer.squares,
            below=self._below(found), peaks=answer.peaks, struck=struck, hits=hits, work=work,
            loss=loss, above=self._above(found),
        )  # fmt: skip

    def add_up(self, pieces: list[RecordPiece]) -> list[RecordPiece]:
        """The pieces."""
        return pieces

    def paths(self, sample: list[RecordPiece]) -> int:
        """Number of paths."""
        return sum(len(piece.hits) for piece in sample)

    def _below(self, found: Accelerations) -> Matrix:
        """Mean squares below the frequencies of the equipment, by Hann's window over the record;
        impulses of rigid stops count as those of one sample."""
        records = found.smooth[:, self._counted]
        if found.jumps is not None:
            records = records + found.jumps[:, self._counted] / self.plan.step
        return squares_below(records, self.equipment.frequency_hz, self.plan.step)

    def _impacts(
        self, found: Accelerations, paths: int
    ) -> tuple[NDArray[np.bool_], Vector, Vector, Vector]:
        """Struck windows, and numbers and energies of impacts by path."""
        struck = np.zeros((paths, self.windows), bool)
        hits, work, loss = np.zeros((3, paths))
        for pair in self.plan.model.pairs:
            log = found.impacts[pair.name]
            place = np.floor(log.time / self.plan.step).astype(int) - self.first
            inside = (place >= 0) & (place < self.windows * self.window)
            assert log.lost is not None
            np.add.at(loss, log.path[inside], log.lost[inside])
            inside &= np.abs(log.speed) >= self.plan.plan.layout.thresholds[pair.name]
            path, speed = log.path[inside], log.speed[inside]
            struck[path, place[inside] // self.window] = True
            np.add.at(hits, path, 1.0)
            np.add.at(work, path, 0.5 * pair.mass * speed**2)
        return struck, hits, work, loss

    def _above(self, found: Accelerations) -> Matrix:
        """Contacts with a larger acceleration than each level, by path."""
        above = np.zeros((len(found.smooth), len(self.levels)))
        if not self.levels:
            return above
        for force in found.forces.values():
            for path, (pushed, moved) in enumerate(zip(force, found.smooth, strict=True)):
                above[path] += contacts_above(
                    pushed[self._counted], moved[self._counted], self.levels
                )
        return above


def squares_below(records: Matrix, frequency_hz: Sequence[float], step: float) -> Matrix:
    """Mean squares of records (paths, samples) below frequencies, by Hann's window."""
    count = records.shape[1]
    taper = np.sqrt(2.0 / 3.0) * (1.0 - np.cos(2.0 * math.pi * np.arange(count) / count))
    size = next_fast_len(count, real=True)
    powers = np.abs(rfft(records * taper, size, axis=1)) ** 2 * (2.0 / (size * count))
    powers[:, 0] *= 0.5
    total = np.cumsum(powers, axis=1)
    bins = np.array(frequency_hz) * size * step
    return np.array([np.interp(bins, np.arange(powers.shape[1]), each) for each in total])


def contacts_above(force: Vector, acceleration: Vector, levels: Sequence[float]) -> Vector:
    """Number of contacts, in which the force is not 0, with a larger acceleration than each
    level."""
    touching = np.flatnonzero(force)
    if not len(touching):
        return np.zeros(len(levels))
    starts = np.flatnonzero(np.diff(touching, prepend=-2) > 1)
    largest = np.maximum.reduceat(np.abs(acceleration[touching]), starts)
    return np.array([np.sum(largest > level) for level in levels], dtype=float)


def joined(pieces: list[RecordPiece]) -> RecordPiece:
    """All paths together."""
    return RecordPiece(*(np.concatenate(part) for part in zip(*pieces, strict=True)))


def sampled_for(plan: HistoryPlan, equipment: Equipment) -> HistoryPlan:
    """The plan of records that resolve the equipment and the contacts."""
    contact = contact_time(plan.model, plan.speed)
    step = min(plan.step, equipment.longest_step, contact / CONTACT_SAMPLES)
    if plan.plan.kicked:
        step = min(step, equipment.longest_step / KICKS_PER_SAMPLE)
    counted = max(LEAST_SECONDS, MEMORIES * equipment.memory, RELAXATIONS * plan.slowest)
    duration = counted + equipment.memory + 2.0 * NODES * step
    if duration / step > MOST_SAMPLES:
        raise NotApplicable(
            "damage",
            [
                f"a record of {duration:.3g} s at steps of {step:.2g} s needs "
                f"{duration / step:.2g} samples, at most {MOST_SAMPLES} are made; ask for "
                "equipment in a narrower band (equipment), or replace a stop whose contacts are "
                "short by a rigid one with its restitution"
            ],
        )
    return plan.sampled(step, duration)


def contact_time(model: Model, speed: float) -> float:
    """Shortest contact of a compliant stop at an rms speed (m/s), s; infinite without one."""
    times = [
        stop.law.impact(speed, pair.mass).contact_time
        for pair in model.pairs
        for stop in pair.stops
        if isinstance(stop.law, CompliantLaw) and speed > 0.0
    ]
    return min(times, default=math.inf)
