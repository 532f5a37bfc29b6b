"""What follows a first hit: bursts of hits, simulated from the hit on.

Hits of an isolator whose stops are far come in bursts: a first hit, which finds the mass in the
motion that it has without stops, and those that the first one leads to. Crude simulation waits for
them; here every record is one. First hits are outcrossings of the free response without another one
in the memory of the process before (`first_crossings`); from there the engine flies on with the
stops. With lambda the limiting rate of first hits, and bursts far apart, whatever has the mean q
in a burst happens lambda q times a second, however rare that is.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stochvi.methods.monte_carlo.blocks import blocks_between, crew_of
from stochvi.methods.monte_carlo.kernels.rows import Extremes, Sums
from stochvi.results.deadline import Deadline
from stochvi.results.errors import NotApplicable
from stochvi.results.estimates import Estimate
from stochvi.results.intervals import jackknife_ratio, upper_limit_unseen
from stochvi.results.progress import Progress
from stochvi.scenes.scene import Scene
from stochvi.statistics.crossing_ages import FEWEST_PATHS, LEAST_PATHS
from stochvi.statistics.first_crossings import MEMORY_RELAXATIONS, Records, crossing_plan

Vector = NDArray[np.float64]

TOUCH = 1e-9
"""Share of the clearance by which a crossing is put beyond the stop, so that it is surely met."""

WINDOW_RELAXATIONS = 15.0
"""Flown after a first hit, in time constants of the structure."""

UNFINISHED = 0.05
"""Share of the hits in the second half of the window from which a burst does not seem to end."""

LOOK = 4
"""Times FEWEST_PATHS: where nothing was seen in so many paths, nothing more is tried."""

FAR, DOUBT = 2.0, 4.0
"""A value needs no more accuracy once it lies this factor away from the value that is searched for,
by more than so many standard errors of its logarithm."""

FEWEST_WITH_BURSTS = 8
"""Paths of which some crossing must be a first hit, for a standard error."""

FLOWN_TOGETHER = 128
"""Bursts in one call of the engine."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Bursts:
    """Bursts that first hits led to, each with its weight.

    Parameters
    ----------
    first_rate
        Limiting rate of first hits, 1/s.
    window, horizon
        How long each was flown, and how long there was no hit before it, s.
    path
        (bursts,) number of the path that each comes from: paths are independent.
    weight
        (bursts,): chance of its slope, over the chance with which it was drawn, times Rice's rate
        of crossings of the stop that it begins at.
    hits, early_hits, speeds
        (bursts,): hits above the speed threshold, those in the first half of the window, and the
        sum of all impact speeds (m/s).
    fastest, sharpest
        (bursts,): largest impact speed (m/s), and absolute acceleration (m/s^2; without the rigid
        impacts, which have none).

    See Also
    --------
    stochvi.size : What is answered by bursts where hits are rare.
    """

    first_rate: Estimate
    window: float
    horizon: float
    path: NDArray[np.int64]
    weight: Vector
    hits: Vector
    early_hits: Vector
    speeds: Vector
    fastest: Vector
    sharpest: Vector

    @property
    def overlap(self) -> float:
        """Expected first hits in the window that is flown; small for what follows to hold."""
        return self.first_rate.value * self.window

    @property
    def unfinished(self) -> float:
        """Share of the hits in the second half of the window, beyond those of new bursts."""
        total = float(np.sum(self.weight * self.hits))
        if total == 0.0:
            return 0.0
        late = 1.0 - float(np.sum(self.weight * self.early_hits)) / total
        return max(late - 0.5 * self.first_rate.value * self.window, 0.0)

    @property
    def apart(self) -> bool:
        """Whether bursts end, and seldom meet."""
        return self.overlap < UNFINISHED and self.unfinished < UNFINISHED

    def hits_per_burst(self) -> Estimate:
        """Mean number of hits in a burst."""
        return self._mean(self.hits)

    def hit_rate(self) -> Estimate:
        """Hits per second on both stops."""
        return self._rate(self.hits)

    def impact_speed_mean(self) -> Estimate:
        """Mean impact speed of all hits, m/s."""
        return self._ratio(self.speeds, self.hits)

    def exceedance_rate(self, name: str, limit: float) -> Estimate:
        """Bursts per second with an "impact_speed" or a "peak_acceleration" above a limit."""
        largest = {"impact_speed": self.fastest, "peak_acceleration": self.sharpest}[name]
        return self._rate((largest > limit).astype(float))

    def _rate(self, what: Vector) -> Estimate:
        """first_rate times the mean of `what`, less what new bursts brought into the window.

        With h the horizon, d the time from a first hit until h has passed without one, and m the
        mean of `what` in that time, such times begin once in 1 / lambda + d seconds (renewal), and
        the rate is lambda m / (1 + lambda d). The window w holds m (1 + lambda (w - d)) of it, to
        first order in lambda: together lambda mean / (1 + lambda w). The bias states all of that.
        What no burst has, has each of them as if it were the one of the largest weight.
        """
        mean = self._mean(what)
        rate = self.first_rate.value / (1.0 + self.overlap)
        value = rate * mean.value
        relative = math.hypot(
            self.first_rate.standard_error / self.first_rate.value,
            mean.standard_error / mean.value if mean.value else 0.0,
        )
        if not value:
            most = upper_limit_unseen(1.0) * float(self.weight.max() / self.weight.sum())
            how = f"none of {len(self.path)} bursts"
            return Estimate(value=0.0, bias=None, how=how, upper_95=self.first_rate.value * most)
        known = (self.first_rate.bias or 0.0) / self.first_rate.value
        return Estimate(
            value=value,
            standard_error=relative * value,
            bias=(known + self.overlap) * value,
            how=f"{len(self.path)} bursts; bias: bursts that meet",
        )

    def _mean(self, what: Vector) -> Estimate:
        return self._ratio(what, np.ones_like(what))

    def _ratio(self, above: Vector, below: Vector) -> Estimate:
        """Ratio of weighted sums, jackknife over paths."""
        count = int(self.path.max()) + 1
        top, bottom = (
            np.bincount(self.path, self.weight * each, count).astype(float)
            for each in (above, below)
        )
        value, error = jackknife_ratio(top, bottom)
        return Estimate(value=value, standard_error=error, how=f"{len(self.path)} bursts")


def bursts(
    scene: Scene,
    *,
    rel_error: float = 0.05,
    wanted: Callable[[Bursts], Estimate] = Bursts.hit_rate,
    widening: float = 1.0,
    far_from: float | None = None,
    seed: int = 0,
    threads: int | None = None,
    executor: Executor | None = None,
    budget: float | None = 60.0,
    progress: Progress | None = None,
) -> Bursts:
    """Simulate bursts at the stops of a scene until `wanted` is known to `rel_error`.

    Ends before that where the budget does, or where nothing `wanted` is seen.

    Parameters
    ----------
    widening
        Half of the first hits are drawn this many times faster, and weighted with what that makes
        of their chance: for exceedances of speeds that few hits reach.
    far_from
        A value of `wanted` that is searched for: where what is found lies beyond doubt more than a
        factor FAR away from it, no more accuracy is needed.
    threads, executor, progress
        The same arguments as those of `simulate`.

    Raises
    ------
    NotApplicable
        As for `first_crossings`, or without stops on both sides of the mean position.
    """
    plan = crossing_plan(scene, WINDOW_RELAXATIONS / MEMORY_RELAXATIONS)
    model = plan.model
    lower = model.rest - model.lower_position
    upper = model.upper_position - model.rest
    if not model.stops or min(lower, upper) <= 0.0:
        raise NotApplicable("bursts", ["needs a stop, and none beyond the mean position"])
    records = Records(plan, seed, np.array([lower]), np.array([upper]))
    work = partial(_part, records, widening)
    parts: list[_Part] = []
    blocks = math.ceil(FEWEST_PATHS / plan.block)

    with crew_of(executor, threads) as crew:
        parts += crew.results(work, [(0, plan.block)])
        deadline = Deadline.after(budget)  # compilation is over

        def late() -> bool:
            return deadline.passed() and len(parts) * plan.block >= 2 * LEAST_PATHS

        while True:
            new = blocks_between(len(parts) * plan.block, blocks * plan.block, plan.block)
            for part in crew.results(work, [*new], deadline, late):
                parts.append(part)
            found = _join(records, parts)
            estimate = wanted(found)
            error = estimate.standard_error / estimate.value if estimate.value else math.inf
            if progress:
                paths = len(parts) * plan.block
                progress((rel_error / max(error, rel_error)) ** 2, f"{paths} paths")
            unseen = estimate.value == 0.0 and len(parts) * plan.block >= LOOK * FEWEST_PATHS
            if error <= rel_error or deadline.passed() or unseen or _far(estimate, far_from):
                break
            blocks = math.ceil(len(parts) * min(max(1.1 * (error / rel_error) ** 2, 1.25), 4.0))
    if deadline.interrupted:
        raise deadline.fell_short(f"after {len(parts) * plan.block} paths", "", found)
    return found


def _far(estimate: Estimate, place: float | None) -> bool:
    """Whether an estimate lies beyond doubt more than a factor FAR from a place."""
    if place is None or not estimate.value:
        return False
    # of the logarithm: one burst beyond a limit has a standard error of its own size, but says no
    # more than the order of magnitude
    doubt = math.exp(DOUBT * min(estimate.standard_error / estimate.value, DOUBT))
    return estimate.value * doubt < place / FAR or estimate.value / doubt > place * FAR


class _Part(NamedTuple):
    """Of one block of paths: the ages of its crossings, and its bursts, (COLUMNS, bursts)."""

    ages: NDArray[np.float32]
    bursts: Vector


COLUMNS = ("path", "weight", "hits", "speeds", "early_hits", "fastest", "sharpest")


def _part(
    records: Records, widening: float, first_path: int, _paths: int, _deadline: Deadline
) -> _Part:
    """Crossings of one block of paths; those that are first hits are flown on."""
    free, unit = records.block(first_path)
    ages = records.ages_in(free, unit)
    slopes, weights = _widened(unit, widening)
    columns = [np.empty((len(COLUMNS), 0))]
    for side, rate in enumerate(records.rice_rates[:, 0]):
        age = records.look_back(free, records.velocity_std * slopes, side)[0]
        path, start = np.nonzero(age >= records.horizon)
        for first in range(0, len(path), FLOWN_TOGETHER):
            chosen = slice(first, first + FLOWN_TOGETHER)
            p, s = path[chosen], start[chosen]
            flown = _fly(records, free, side, p, s, records.velocity_std * slopes[p, s])
            columns.append(np.vstack([first_path + p, rate * weights[p, s], flown]))
    return _Part(ages, np.concatenate(columns, axis=1))


def _fly(
    records: Records,
    free: Vector,
    side: int,
    path: NDArray[np.int64],
    start: NDArray[np.int64],
    slopes: Vector,
) -> Vector:
    """Hits, speeds, early hits, fastest and sharpest of bursts, from just before the first hit."""
    plan = records.plan
    sign = _sides_hit(records, side, path + start)
    near = np.full(len(path), records.sides[side][0][0])
    samples = math.ceil(WINDOW_RELAXATIONS / MEMORY_RELAXATIONS * records.count)
    sample = np.arange(-1, min(samples, len(records.shape) - 1))
    record = free[path[:, None], (records.starts[start, None] + sample) % plan.samples]
    here = free[path, records.starts[start]]
    rows = after_crossings(records, record, here, sample, slopes, near, sign)
    # the engine begins at the last row
    rows = np.ascontiguousarray(np.roll(rows, -1, axis=0))
    whole, extremes = _sums(records, rows, len(sample) - 1)
    early, _ = _sums(records, rows, (len(sample) - 1) // 2)
    return np.vstack(
        [
            whole.impacts,
            whole.impact_speeds,
            early.impacts,
            extremes.impact_speed,
            extremes.acceleration,
        ]
    )


def _sides_hit(records: Records, side: int, numbers: NDArray[np.int64]) -> Vector:
    """(bursts,): 1 where the first hit is on the upper stop, -1 where the crossing is turned over
    to the lower one. Stops that are equally far share their crossings; every other one is turned
    over if they differ in their laws."""
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
        (bursts, samples, 2) and (bursts, 2): x and x' of stationary records at the samples, and at
        the one that is made a crossing.
    sample
        (samples,): numbers of the samples, from the crossing.
    slopes, near, sign
        (bursts,): speed of the crossing (m/s), distance of the stop (m), and 1 for an upper stop,
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
    bursts = rows.shape[1] // 2
    sums, extremes = Sums.zeros(bursts, records.plan.contacts), Extremes.zeros(bursts)
    records.plan.add_impacts(rows, 0, counted, sums.table, None, extremes.table)
    return sums, extremes


def _join(records: Records, parts: list[_Part]) -> Bursts:
    """All bursts so far."""
    found = records.found(np.concatenate([part.ages for part in parts], axis=3))
    columns = np.concatenate([part.bursts for part in parts], axis=1)
    if len(np.unique(columns[0])) < FEWEST_WITH_BURSTS:
        raise NotApplicable("bursts", ["stops as near as these are hit without a pause"])
    named = dict(zip(COLUMNS, columns, strict=True))
    return Bursts(
        first_rate=found.first_rate()[0],
        window=WINDOW_RELAXATIONS / MEMORY_RELAXATIONS * found.horizon,
        horizon=found.horizon,
        path=named.pop("path").astype(np.int64),
        **named,
    )


def _widened(unit: Vector, widening: float) -> tuple[Vector, Vector]:
    """Every second slope made larger; the density of the unit law over that of the mixture."""
    slopes = unit.copy()
    slopes[:, 1::2] *= widening
    wide = np.exp(0.5 * slopes**2 * (1.0 - widening**-2)) / widening**2
    share = slopes[:, 1::2].size / slopes.size
    return slopes, 1.0 / (1.0 - share + share * wide)
