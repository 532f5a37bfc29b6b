"""Flights of one oscillator from first impacts on: a block of records, and the clusters in it.

A flight begins just before an outcrossing that is a first impact. The motion without stops is known
around the crossing, and the engine simulates what the stops change in it.
"""

from __future__ import annotations

import math
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from stochvi.mathematics.arrays import Vector
from stochvi.methods.monte_carlo.kernels.rows import Extremes, Sums
from stochvi.results.errors import NotApplicable
from stochvi.scenes.scene import Scene
from stochvi.statistics.crossing_ages import CrossingAges
from stochvi.statistics.first_crossings import MEMORY_RELAXATIONS, Records, crossing_plan

TOUCH = 1e-9
"""Share of the clearance by which a crossing is put beyond the stop, so that the engine finds a
hit."""

WINDOW_RELAXATIONS = 15.0
"""Time that is simulated after a first impact, in time constants of the structure."""

WINDOWS = WINDOW_RELAXATIONS / MEMORY_RELAXATIONS
"""The same time in horizons, the time for which records look back from a crossing."""

FLOWN_TOGETHER = 128
"""Number of clusters that one call of the engine simulates."""


class Part(NamedTuple):
    """What one block of paths gives: the ages of its crossings, (strides, sides, 1, paths, starts),
    and its clusters, (rows, clusters). The rows are path, weight, impacts in the first half of the
    window; impacts, sum of speeds and largest speed of each pair; largest acceleration of each
    output (see `bursts.Bursts`)."""

    ages: NDArray[np.float32]
    bursts: Vector


class Flights(Protocol):
    """Records with crossings put into them; from those that are first impacts the motion is
    simulated on."""

    @property
    def pairs(self) -> tuple[str, ...]:
        """Names of the pairs."""

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of the outputs, coordinates and points, whose accelerations are followed."""

    @property
    def together(self) -> int:
        """Number of paths that are made together."""

    def part(self, widening: float, first_path: int) -> Part:
        """The work on one block of paths."""

    def found(self, ages: NDArray[np.float32]) -> CrossingAges:
        """The answer from the ages of all crossings so far."""


class OscillatorFlights:
    """Flights of one oscillator.

    Raises `NotApplicable` as `first_crossings` does, or where the mean position does not lie
    between the stops.
    """

    def __init__(self, scene: Scene, seed: int) -> None:
        plan = crossing_plan(scene, WINDOWS)
        model = plan.model
        lower = model.rest - model.lower_position
        upper = model.upper_position - model.rest
        if not model.stops or min(lower, upper) <= 0.0:
            raise NotApplicable("bursts", ["needs a stop, and none beyond the mean position"])
        self.records = Records(plan, seed, np.array([lower]), np.array([upper]))
        self.pairs, self.outputs = (model.pairs[0].name,), model.coordinates
        self.together, self.found = plan.block, self.records.found

    def part(self, widening: float, first_path: int) -> Part:
        """Crossings of one block of paths, and the clusters after first impacts."""
        records = self.records
        free, unit = records.block(first_path)
        ages = records.ages_in(free, unit)
        slopes, weights = widened(unit, widening)
        columns = []
        for side, rate in enumerate(records.rice_rates[:, 0]):
            age = records.look_back(free, records.velocity_std * slopes, side)[0]
            path, start = np.nonzero(age >= records.horizon)
            for first in range(0, max(len(path), 1), FLOWN_TOGETHER):
                chosen = slice(first, first + FLOWN_TOGETHER)
                p, s = path[chosen], start[chosen]
                flown = _fly(records, free, side, p, s, records.velocity_std * slopes[p, s])
                columns.append(np.vstack([first_path + p, rate * weights[p, s], flown]))
        return Part(ages, np.concatenate(columns, axis=1))


def _fly(
    records: Records,
    free: Vector,
    side: int,
    path: NDArray[np.int64],
    start: NDArray[np.int64],
    slopes: Vector,
) -> Vector:
    """Rows of clusters, simulated from just before the first impact: impacts in the first half of
    the window, impacts, sum of speeds, largest speed and largest acceleration."""
    plan = records.plan
    sign = _sides_hit(records, side, path + start)
    near = np.full(len(path), records.sides[side][0][0])
    samples = math.ceil(WINDOWS * records.count)
    sample = np.arange(-1, min(samples, len(records.shape) - 1))
    record = free[path[:, None], (records.starts[start, None] + sample) % plan.samples]
    here = free[path, records.starts[start]]
    rows = after_crossings(records, record, here, sample, slopes, near, sign)
    # the engine takes its first state from the last row
    rows = np.ascontiguousarray(np.roll(rows, -1, axis=0))
    whole, extremes = _sums(records, rows, len(sample) - 1)
    early, _ = _sums(records, rows, (len(sample) - 1) // 2)
    return np.vstack(
        [
            early.impacts,
            whole.impacts,
            whole.impact_speeds,
            extremes.impact_speed,
            extremes.acceleration,
        ]
    )


def _sides_hit(records: Records, side: int, numbers: NDArray[np.int64]) -> Vector:
    """(clusters,): 1 where the first impact is on the upper stop, -1 where the crossing is turned
    over to the lower one. Stops that are equally far share their crossings; every other one is
    turned over if they differ in their laws."""
    if not records.crosses_upper[side]:
        return np.full(len(numbers), -1.0)
    laws = [stop.law for stop in records.plan.model.stops]
    shared = len(records.sides) < len(laws)
    if not shared or laws[0] == laws[1]:
        return np.ones(len(numbers))
    return np.where(numbers % 2, -1.0, 1.0)


def after_crossings(
    records: Records,
    record: Vector,
    here: Vector,
    sample: NDArray[np.int64],
    slopes: Vector,
    near: Vector,
    sign: Vector,
) -> Vector:
    """Records around crossings (see `kernels.crossings`), in rows for the engine.

    Parameters
    ----------
    record, here
        (clusters, samples, 2) and (clusters, 2): x and x' of stationary records at the samples, and
        at the one that is made a crossing.
    sample
        (samples,): numbers of the samples, from the crossing.
    slopes, near, sign
        (clusters,): speed of the crossing (m/s), distance of the stop (m), and 1 for an upper stop,
        -1 for a lower one.
    """
    rho, rho_rate, eta, eta_rate = records.shape[np.abs(sample)].T
    back = np.where(sample < 0, -1.0, 1.0)
    away = (1.0 + TOUCH) * near - here[:, 0]
    change = slopes - here[:, 1]
    y = record[:, :, 0] + away[:, None] * rho + change[:, None] * back * eta
    rate = record[:, :, 1] + away[:, None] * back * rho_rate + change[:, None] * eta_rate
    rows = np.empty((len(sample), 2 * len(record)))
    rows[:, 0::2] = (sign[:, None] * y).T
    rows[:, 1::2] = (sign[:, None] * rate).T / records.plan.model.omega
    return rows


def _sums(records: Records, rows: Vector, counted: int) -> tuple[Sums, Extremes]:
    """Sums and extremes of whole clusters, and sums of their first `counted` samples alone."""
    bursts = rows.shape[1] // 2
    sums, extremes = Sums.zeros(bursts, records.plan.contacts), Extremes.zeros(bursts)
    records.plan.add_impacts(rows, 0, counted, sums.table, None, extremes.table)
    return sums, extremes


def widened(unit: Vector, widening: float) -> tuple[Vector, Vector]:
    """The slopes (..., starts), every second one made larger, and the weight of each: the density
    of the unit law over that of the mixture."""
    slopes = unit.copy()
    slopes[..., 1::2] *= widening
    wide = np.exp(0.5 * slopes**2 * (1.0 - widening**-2)) / widening**2
    share = slopes[..., 1::2].size / slopes.size
    return slopes, 1.0 / (1.0 - share + share * wide)
