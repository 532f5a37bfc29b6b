"""Units of a production: how each moves and where its stops are, and its risk by linear theory.

A unit is a row of amounts, one for each quantity that varies. Its gaps are Gaussian, with the rms,
the rate and the mean that `Region.gaps` finds on a grid of mounts; level and clearances need no new
solution. The risk of a unit is that of the scene as stated, times the ratio of Rice's rates of all
of their stops.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import RegularGridInterpolator

from stochvi.isolators.production_risk.spreads import Spread, quantity_of
from stochvi.isolators.sizing.changes import CENTRE, Change, Tolerances, all_applied
from stochvi.isolators.sizing.tolerance_region import PER_RESONANCE, Region
from stochvi.mathematics.arrays import Matrix, Vector
from stochvi.model.model import model_of
from stochvi.results.deadline import Deadline
from stochvi.scenes.between_units import mean_unit
from stochvi.scenes.scene import Scene
from stochvi.scenes.structures.rigid_body import AXES

CENTRES = tuple(f"{CENTRE}{axis}" for axis in AXES)
"""Names of the amounts by which a centre of mass is off."""

NODES, MOST_NODES = 7, 121
"""Smallest and largest number of amounts of a quantity at which the linear motion is solved."""

RARE = 1e-6
"""Share of the units at either end whose motion is taken from the end of the grid, at most."""

MOVING = ("frequency", "damping", *CENTRES)
"""Names of the amounts that change how the gaps of a unit move, beyond their size."""

LEAST_DAMPING = 1e-3
"""Damping over that stated below which the motion of a unit is taken from there."""

LOG_STEP = 0.4
"""Largest step of the logarithm of a damping ratio from one node to the next."""

STILL = 1e-300
"""rms and rate that take the place of 0, of which a logarithm is taken."""

NEPERS_PER_DB = math.log(10.0) / 20.0
"""Logarithm of the factor on an rms by one decibel."""

FARTHEST = 1e3
"""Largest distance of a stop in standard deviations; none farther is ever crossed."""


class UnitGaps(NamedTuple):
    """The gaps of many units.

    rms (m) and crossings per second of the mean are (units, pairs) each. `farther` is how much
    farther each stop is from the mean gap than stated, (units, 2, pairs), m.
    """

    sigma: Matrix
    rate: Matrix
    farther: Vector

    def rice(self, stops: Vector) -> Vector:
        """(units,): crossings per second of all stops (Rice), at distances from the stated mean gap
        of (2, pairs), or of (units, 2, pairs), m. A stop that presses is crossed as the mean is."""
        distance = np.maximum(stops + self.farther, 0.0)
        level = np.minimum(distance, FARTHEST * self.sigma[:, None, :]) / self.sigma[:, None, :]
        return np.asarray(np.sum(self.rate[:, None, :] * np.exp(-0.5 * level**2), axis=(1, 2)))

    def nearest(self, stops: Vector) -> NDArray[np.int64]:
        """(units,): number of the stop that is nearest in standard deviations."""
        level = (stops + self.farther) / self.sigma[:, None, :]
        return np.asarray(np.argmin(level.reshape(len(level), -1), axis=1))


@dataclass(frozen=True, kw_only=True)
class Units:
    """The units of a production.

    Parameters
    ----------
    scene
        The scene about which the units vary.
    spreads
        The distribution of each quantity.
    mean
        (pairs,): the mean gaps from which the distances of the stops are measured, m.
    stops
        (2, pairs): distances of the stops as stated, m, infinite for none.
    rare
        Share of the units at either end whose motion is taken from the end of the grid.
    """

    scene: Scene
    spreads: Mapping[str, Spread]
    mean: Vector
    stops: Matrix
    rare: float = RARE
    surfaces: list[tuple[list[str], RegularGridInterpolator]] = field(default_factory=list)

    @cached_property
    def columns(self) -> list[tuple[str, str]]:
        """The tolerance and the name of each amount of a unit. The clearance of each stop and the
        centre of mass along each axis are amounts of their own."""
        found = []
        for name in self.spreads:
            match name:
                case "centre":
                    own = list(CENTRES)
                case "clearance":
                    own = [each for each in self.places if each not in self.spreads]
                case _:
                    own = [name]
            found += [(name, each) for each in own]
        return found

    @cached_property
    def places(self) -> dict[str, tuple[int, int]]:
        """Row and column of the stop to which each amount of a clearance belongs, by its name."""
        model = model_of(self.scene)
        names = [pair.name for pair in model.pairs] or list(model.coordinates)
        return {
            f"clearance {side} {name}": (row, column)
            for column, name in enumerate(names)
            for row, side in enumerate(("lower", "upper"))
            if math.isfinite(self.stops[row, column])
        }

    def drawn(self, points: Matrix) -> Matrix:
        """Amounts (units, columns) at points of the unit cube."""
        return np.stack(
            [
                self.spreads[tolerance].distribution(tolerance).ppf(points[:, k])
                for k, (tolerance, _) in enumerate(self.columns)
            ],
            axis=1,
        )

    def changes(self, amounts: Vector) -> list[Change]:
        """The changes of mount, level and laws of one unit."""
        return [
            Change(name, float(amount))
            for (tolerance, name), amount in zip(self.columns, amounts, strict=True)
            if quantity_of(tolerance) != "clearance"
        ]

    def unit(self, amounts: Vector) -> Scene:
        """The scene of one unit, its stops not moved; nothing in it differs between units."""
        return all_applied(self.changes(amounts), mean_unit(self.scene))

    def built(self, amounts: Vector) -> Scene:
        """The scene of one unit with its stops where they are, each off by its own amount."""
        off = np.zeros(self.stops.shape)
        for (tolerance, name), amount in zip(self.columns, amounts, strict=True):
            if quantity_of(tolerance) == "clearance":
                off[self.places[name]] = amount
        whole = self.unit(amounts).expanded
        pairs = [
            pair.model_copy(
                update={
                    "lower": None if pair.lower is None else pair.lower - float(below),
                    "upper": None if pair.upper is None else pair.upper + float(above),
                }
            )
            for pair, below, above in zip(whole.impact_pairs, off[0], off[1], strict=True)
        ]
        return whole.model_copy(update={"impact_pairs": tuple(pairs)})

    def gaps(self, amounts: Matrix) -> UnitGaps:
        """The gaps of units, from their amounts (units, columns)."""
        names = [name for _, name in self.columns]
        motion = np.broadcast_to(self._stated, (len(amounts), self._stated.size))
        for group, surface in self.surfaces:
            places = np.column_stack(
                [_place(name, amounts[:, names.index(name)]) for name in group]
            )
            ends = [(grid[0], grid[-1]) for grid in surface.grid]
            motion = motion + surface(np.clip(places, *np.transpose(ends))) - self._stated
        log_sigma, log_rate, mean = np.split(motion, 3, axis=1)
        farther = np.stack([mean - self.mean, self.mean - mean], axis=1)
        for k, (tolerance, name) in enumerate(self.columns):
            if tolerance == "level":
                log_sigma = log_sigma + amounts[:, k, None] * NEPERS_PER_DB
            elif quantity_of(tolerance) == "clearance":
                side, pair = self.places[name]
                farther[:, side, pair] += amounts[:, k]
        return UnitGaps(np.exp(log_sigma), np.exp(log_rate), farther)

    @cached_property
    def _region(self) -> Region:
        return Region(self.scene, Tolerances())

    @cached_property
    def _stated(self) -> Vector:
        return self._motion(())

    def _motion(self, changes: Sequence[Change]) -> Vector:
        """Logarithms of rms and rate, and mean, of all gaps in a row."""
        gaps = self._region.gaps(changes)
        self._region.models.clear()  # of centres of mass, which are many
        logs = [np.log(np.maximum(each, STILL)) for each in (gaps.sigma, gaps.rate)]
        return np.concatenate([*logs, gaps.mean])

    def solve(self, deadline: Deadline) -> None:
        """Solve the linear motion on a grid of mounts, and on one of centres of mass. Between their
        places it is interpolated; the logarithms of both effects add up."""
        for group in (("frequency", "damping"), CENTRES):
            own = [name for _, name in self.columns if name in group]
            if not own:
                continue
            grids = [self._grid(name) for name in own]
            values = list[Vector]()
            for place in itertools.product(*grids):
                if deadline.passed():
                    raise deadline.fell_short(
                        f"after the motion of {len(values)} mounts was solved", "raise budget"
                    )
                values.append(self._motion(list(map(Change, own, place))))
            shape = (*map(len, grids), self._stated.size)
            places = [_place(name, grid) for name, grid in zip(own, grids, strict=True)]
            surface = RegularGridInterpolator(places, np.reshape(values, shape), method="cubic")
            self.surfaces.append((own, surface))

    def _grid(self, name: str) -> Vector:
        """Amounts of a quantity at which the motion is solved."""
        tolerance = "centre" if name in CENTRES else name
        low, high = (
            self.spreads[tolerance].distribution(tolerance).ppf([self.rare, 1.0 - self.rare])
        )
        nodes = NODES
        if name == "frequency":
            half_width = self._region.narrowest()
            nodes = math.ceil(PER_RESONANCE * (high - low) / half_width)
        nodes = min(max(nodes, NODES), MOST_NODES)
        if name == "damping":  # sigma^2 of a mount without much damping is as its inverse
            first, last = math.log(max(1.0 + low, LEAST_DAMPING)), math.log1p(high)
            nodes = max(nodes, math.ceil((last - first) / LOG_STEP) + 1)
            return np.asarray(np.expm1(np.linspace(first, last, nodes)))
        return np.linspace(low, high, nodes)


def _place(name: str, amounts: Vector) -> Vector:
    """Amounts as the coordinate in which the motion is interpolated."""
    return np.log(np.maximum(1.0 + amounts, LEAST_DAMPING)) if name == "damping" else amounts
