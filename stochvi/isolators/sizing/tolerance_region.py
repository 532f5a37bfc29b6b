"""The largest clearances over the whole region of tolerances, by linear theory.

The response over frequency is known, so that rms, rate of crossings and mean of every gap are cheap
at any point of the region. The clearance for the same risk is the one at which stops are crossed at
the same rate (Rice); the distance by which the mean has moved is added to it. Impacts are taken to
cluster as in the nominal scene. Inside the region a resonance may meet a peak of the excitation:
the ends of the tolerances do not suffice.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.optimize import brentq, minimize

from stochvi.isolators.sizing.changes import (
    CENTRE,
    WORST,
    Change,
    Tolerances,
    ends_of,
    moved_centre,
    worded,
)
from stochvi.mathematics.arrays import Matrix, Vector
from stochvi.mathematics.moving_means import MovingMean
from stochvi.mathematics.units import power_ratio
from stochvi.model.free_motion import free_motion
from stochvi.model.model import Model, model_of
from stochvi.results.deadline import NEVER, Deadline
from stochvi.scenes.scene import Scene
from stochvi.scenes.structures.rigid_body import AXES

if TYPE_CHECKING:
    import pandas as pd


Changes = tuple[Change, ...]

PER_RESONANCE = 4.0
"""Frequencies of the search in the half width of the narrowest resonance: the response to the
narrowest peak of an excitation is as wide as the resonance that meets it."""

MOST_FREQUENCIES = 401
"""Largest number of frequencies of the search. A resonance so narrow that this number does not
resolve it is met only by an excitation whose peak is as narrow."""

MOST_STARTS = 3
"""Number of maxima over the frequencies of the search from which the largest one is refined."""

STEP = 1e-6
"""Step of the differences in the refinement, in units of the tolerances."""

NEVER_CROSSED = 1e-300
"""Rate that takes the place of a rate of 0, of which a logarithm is taken, 1/s."""


class Gaps(NamedTuple):
    """rms (m), crossings of the mean per second and mean (m) of every gap, (pairs,) each.

    A scene without pairs has one gap, that of its only coordinate. `frequency` is the factor on
    the natural frequencies. `beside_sines` holds noise and sines of each, None without sines.
    """

    sigma: Vector
    rate: Vector
    mean: Vector
    frequency: float = 1.0
    beside_sines: tuple[MovingMean, ...] | None = None

    @classmethod
    def of(cls, model: Model, gain: float = 1.0, frequency: float = 1.0) -> Gaps:
        """The gaps of a structure whose noise and sines are larger by a factor."""
        directions = np.array([pair.direction for pair in model.pairs] or [np.ones(1)])
        motions = tuple(
            each.louder(gain)
            for each in free_motion(model, with_sines=True).moving_means(directions)
        )
        sigma, speed = np.array([each.deviations for each in motions]).T
        rate = np.divide(speed, 2.0 * math.pi * sigma, out=np.zeros_like(speed), where=sigma > 0.0)
        mean = directions @ model.modal.shapes @ model.modal.rest
        return cls(sigma, rate, mean, frequency, motions if model.sines else None)

    @property
    def speed(self) -> Vector:
        """rms velocity of every gap, m/s."""
        return 2.0 * math.pi * self.rate * self.sigma

    def crossings(self, distance: Vector, numbers: Sequence[int]) -> Vector:
        """Crossings per second of stops of some gaps, at distances from their means; infinite ones
        for none."""
        found = np.zeros(len(numbers))
        for place, (k, away) in enumerate(zip(numbers, distance.tolist(), strict=True)):
            if not math.isfinite(away):
                continue
            if self.beside_sines is not None:
                found[place] = self.beside_sines[k].rate(away)
            elif self.sigma[k] > 0.0:
                level = max(away, 0.0) / float(self.sigma[k])
                found[place] = float(self.rate[k]) * math.exp(-0.5 * level**2)
        return found


@dataclass(frozen=True, kw_only=True)
class SameRisk:
    """Clearances for the risk of stops at given places, with the gaps changed.

    Parameters
    ----------
    nominal
        The gaps as stated.
    stops
        (2, pairs): distances of the lower and the upper stops from the mean gaps, m; infinite for
        none.
    harm
        Where a limit is to be kept instead of impacts avoided, the share of the first impacts that
        exceed it: those faster than some speed w, a share of exp(-w^2 / (2 s_v^2)).
    common
        Numbers of the pairs that have one clearance in common.
    """

    nominal: Gaps
    stops: Matrix
    harm: float = 1.0
    common: Sequence[int] = ()

    def __call__(self, changed: Gaps) -> Vector:
        """(pairs,): clearances from the nominal mean gap. At this clearance a stop is crossed as
        often as the nearer stop of the pair in the nominal scene; the larger of the two stops
        counts. Pairs in common have the clearance at which all their stops together are crossed as
        often as in the nominal scene."""
        found = self._alone(changed)
        if self.common:
            found[self.common] = self._in_common(changed, float(found[self.common].max()))
        return found

    def _in_common(self, changed: Gaps, enough: float) -> float:
        """The clearance of the pairs in common; each of them alone needs no more than `enough`."""
        before, names = self.nominal, list(self.common)
        shift = (changed.mean - before.mean)[names]
        stated = np.isfinite(self.stops[:, names])
        speeds = np.maximum(changed.speed, NEVER_CROSSED) / np.maximum(before.speed, NEVER_CROSSED)
        harmful = self.harm ** (speeds[names] ** -2)

        def more_than_before(clearance: float) -> float:
            places = np.where(stated, [clearance + shift, clearance - shift], math.inf)
            again = sum(float(changed.crossings(each, names) @ harmful) for each in places)
            return math.log(max(again, NEVER_CROSSED) / wanted)

        wanted = self.harm * sum(
            float(before.crossings(each, names).sum()) for each in self.stops[:, names]
        )
        if wanted < NEVER_CROSSED or more_than_before(0.0) <= 0.0:
            return enough
        while more_than_before(enough) > 0.0:
            enough *= 1.1
        return float(brentq(more_than_before, 0.0, enough, rtol=1e-12))

    def _alone(self, changed: Gaps) -> Vector:
        """(pairs,): clearances of pairs that have each their own."""
        before, distance = self.nominal, self.stops.min(axis=0)
        shift = changed.mean - before.mean
        sides = np.where(np.isfinite(self.stops), [-shift, shift], -math.inf).max(axis=0)
        if before.beside_sines is not None and changed.beside_sines is not None:
            share = self.harm ** (1.0 - (before.speed / changed.speed) ** 2)
            again = [
                new.distance_of(old.rate(float(away)) * float(part))
                for old, new, away, part in zip(
                    before.beside_sines, changed.beside_sines, distance, share, strict=True
                )
            ]
            return np.asarray(np.maximum(np.array(again) + sides, 0.0))
        moved = np.where(before.sigma > 0.0, before.sigma, math.inf)
        rates, speeds = (
            np.maximum(new, NEVER_CROSSED) / np.maximum(old, NEVER_CROSSED)
            for new, old in ((changed.rate, before.rate), (changed.speed, before.speed))
        )
        square = (distance / moved) ** 2 + 2.0 * np.log(rates)
        square -= 2.0 * math.log(self.harm) * (1.0 - speeds**-2)
        found = changed.sigma * np.sqrt(np.maximum(square, 0.0)) + sides
        return np.asarray(np.maximum(found, 0.0))


@dataclass(frozen=True)
class Region:
    """All scenes within the tolerances of one, by their gaps."""

    scene: Scene
    tolerances: Tolerances
    models: dict[tuple[float, ...], Model] = field(default_factory=dict)

    @cached_property
    def nominal(self) -> Gaps:
        """The gaps as stated."""
        return self.gaps(())

    @cached_property
    def limits(self) -> dict[str, float]:
        """Quantities that may be off, and by how much either way."""
        return self.tolerances.limits()

    def gaps(self, changes: Sequence[Change]) -> Gaps:
        """The gaps with these changes of frequency, damping, level and centre of mass."""
        off = {each.quantity: each.amount for each in changes}
        model = self._model(tuple(off.get(f"{CENTRE}{axis}", 0.0) for axis in AXES))
        frequency, damping = 1.0 + off.get("frequency", 0.0), 1.0 + off.get("damping", 0.0)
        structure = replace(
            model,
            stiffness=model.stiffness * frequency**2,
            damping=model.damping * (frequency * damping),
            rates=None,
        )
        return Gaps.of(structure, math.sqrt(power_ratio(off.get("level", 0.0))), frequency)

    def _model(self, shift: tuple[float, ...]) -> Model:
        """The model with the centre of mass moved by `shift`, m along x, y, z; made once."""
        if shift not in self.models:
            scene = moved_centre(self.scene, shift) if any(shift) else self.scene
            self.models[shift] = model_of(scene)
        return self.models[shift]

    def worst(
        self, need: Callable[[Gaps], Vector], deadline: Deadline = NEVER
    ) -> list[tuple[float, Changes]]:
        """The largest value of each entry of `need` in the region, and where it is: the largest of
        a scan of all frequencies, refined by its gradient.

        Raises `NotConverged` where the deadline passes before the region is searched.
        """
        # `need` grows with the noise, so that the level is at its upper end
        level = (Change("level", self.limits["level"]),) if "level" in self.limits else ()
        names = [name for name in self.limits if name != "level"]

        def changes(place: Sequence[float]) -> Changes:
            moved = (Change(n, u * self.limits[n]) for n, u in zip(names, place, strict=True))
            return (*moved, *level)

        def value(place: Sequence[float]) -> Vector:
            if deadline.passed():
                raise deadline.fell_short("before the tolerances were searched", "raise budget")
            return need(self.gaps(changes(place)))

        frequencies = self._frequencies() if "frequency" in names else np.zeros(1)
        others = self._combinations([name for name in names if name != "frequency"])
        grid = [
            [((f, *rest) if "frequency" in names else rest) for rest in others] for f in frequencies
        ]
        scan = np.array([[value(place) for place in row] for row in grid])
        found = []
        for k in range(scan.shape[2]):
            starts = [
                grid[i][int(scan[i, :, k].argmax())] for i in _highest(scan[:, :, k].max(axis=1))
            ]
            known = max((float(value(start)[k]), start) for start in starts)
            climbed = [_climb(start, k, value) for start in starts]
            best = max(known, *((float(value(place)[k]), place) for place in climbed))
            found.append((best[0], changes(best[1])))
        return found

    def _frequencies(self) -> Vector:
        """Shares of the tolerance of the frequency, close enough to each other for the narrowest
        resonance of the region."""
        narrowest = self.narrowest() * (1.0 - self.limits.get("damping", 0.0))
        half = PER_RESONANCE * self.limits["frequency"] / max(narrowest, 1e-9)
        count = min(2 * math.ceil(half) + 1, MOST_FREQUENCIES)
        return np.linspace(-1.0, 1.0, max(count, 3))

    def narrowest(self) -> float:
        """The smallest damping ratio of a mode as stated: its relative half width."""
        modes = model_of(self.scene).modal
        held = modes.squares > 0.0
        return float(np.min(0.5 * np.diag(modes.damping)[held] / np.sqrt(modes.squares[held])))

    @staticmethod
    def _combinations(names: list[str]) -> list[tuple[float, ...]]:
        """Ends and middles of the other quantities; for the centre of mass the corners and the
        middle alone."""
        axes = [name for name in names if name.startswith(CENTRE)]
        plain = itertools.product((-1.0, 0.0, 1.0), repeat=len(names) - len(axes))
        corners = [*itertools.product((-1.0, 1.0), repeat=len(axes))] if axes else []
        centres = [(0.0,) * len(axes), *corners]
        return [(*one, *other) for one, other in itertools.product(plain, centres)]


def _highest(values: Vector) -> list[int]:
    """Indices of the largest local maxima of values, the largest first."""
    beside = np.pad(values, 1, constant_values=-math.inf)
    peaks = np.flatnonzero((values > beside[:-2]) & (values > beside[2:]))
    found = {*peaks.tolist(), int(values.argmax())}
    return sorted(found, key=lambda i: -values[i])[:MOST_STARTS]


def _climb(
    start: Sequence[float], k: int, value: Callable[[Sequence[float]], Vector]
) -> tuple[float, ...]:
    """Where the k-th value is largest near a place, in units of the tolerances."""
    scale = abs(float(value(start)[k]))
    if not start or scale == 0.0 or not math.isfinite(scale):
        return tuple(start)

    def fallen(place: Vector) -> float:
        return -float(value(place.tolist())[k]) / scale

    bounds = [(-1.0, 1.0)] * len(start)
    found = minimize(
        fallen, np.array(start), method="L-BFGS-B", bounds=bounds, options={"eps": STEP}
    )
    return tuple(map(float, found.x))


def tolerance_table(
    scene: Scene,
    tolerances: Tolerances,
    stops: Matrix,
    sized: Sequence[int],
    probability: float,
    harm: float = 1.0,
    common: Sequence[int] = (),
    deadline: Deadline = NEVER,
) -> tuple[pd.DataFrame, dict[str, str]]:
    """The table that `Sizing.tolerances` describes, and `Sizing.worst_at`.

    Parameters
    ----------
    stops, harm, common
        As in `SameRisk`.
    sized
        Numbers of the pairs whose clearances were searched for.
    probability
        Probability of any impact there.
    """
    import pandas as pd

    region = Region(scene, tolerances)
    names = [pair.name for pair in model_of(scene).pairs]
    same = SameRisk(nominal=region.nominal, stops=stops, harm=harm, common=common)

    def needs(gaps: Gaps) -> Vector:
        """The clearance of each pair, and the risk of any impact where the stops are."""
        return np.append(same(gaps), _hazard(region.nominal, gaps, stops, probability))

    def row(words: str, found: Vector) -> dict[str, str | float]:
        return {
            "change": words,
            **{names[k]: float(found[k]) for k in sized},
            "factor": max(float(found[k] / stops[:, k].min()) for k in sized),
            "probability": -math.expm1(-float(found[-1])),
        }

    ends = [((each,), needs(region.gaps([each]))) for each in ends_of(tolerances)]
    rows = [row("as stated", needs(region.nominal))]
    rows += [row(worded(changes), found) for changes, found in ends]
    places: dict[str, str] = {}
    if ends:
        # with one quantity alone the refinement may end a rounding error below its row
        known = [[(found[k], changes) for changes, found in ends] for k in range(len(names) + 1)]
        worst = [
            max(*each, searched, key=lambda one: one[0])
            for each, searched in zip(known, region.worst(needs, deadline), strict=True)
        ]
        places = {names[k]: worded(worst[k][1]) for k in sized}
        rows.append(row(WORST, np.array([each[0] for each in worst])))
    return pd.DataFrame(rows), places


def _hazard(nominal: Gaps, changed: Gaps, stops: Matrix, probability: float) -> float:
    """-ln(1 - P) of any impact with the stops where they are: it changes as Rice's rate of all
    crossings does."""
    shift = changed.mean - nominal.mean
    pairs = range(len(shift))
    before, after = (
        sum(gaps.crossings(each, pairs).sum() for each in places)
        for gaps, places in ((nominal, stops), (changed, (stops[0] + shift, stops[1] - shift)))
    )
    return float(-math.log1p(-probability) * after / before)
