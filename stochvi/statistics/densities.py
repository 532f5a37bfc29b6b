"""Densities of displacements by Monte Carlo, with 95 % bands, where someone asks for them.

Every path gives the share of its time in each bin, and paths are independent. The density of a bin
is the mean of these shares over the width of the bin, and its standard error follows from their
scatter.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Unpack

import numpy as np

from stochvi.mathematics.arrays import Matrix, Vector
from stochvi.methods.averaging import AveragedDensity, average_density
from stochvi.methods.monte_carlo.history_plans import HistoryPlan, plan_histories
from stochvi.model.model import Model, Pair, model_of
from stochvi.results.deadline import partial_result
from stochvi.results.errors import NotApplicable, SceneError
from stochvi.results.estimates import Estimate
from stochvi.results.intervals import GAUSSIAN_95
from stochvi.results.response import Response
from stochvi.sampling.options import RunOptions
from stochvi.sampling.run import Run, sampled
from stochvi.sampling.sampler import ListSampler
from stochvi.scenes.scene import Scene, scene_from

BINS, REACH = 64, 5.0
"""Number of bins of a density, and how far it reaches from the mean, in standard deviations."""

PATHS, FEWEST_PATHS = 256, 64
"""Number of paths, and that which is simulated even where time ends before."""

RELAXATIONS, MOST_SAMPLES = 60.0, 2**17
"""Length of a path in relaxation times of the structure, and its largest number of samples."""

SAMPLES_PER_PERIOD = 16.0
"""Samples in a period of the fastest motion."""

FEWEST_SEEN = 10
"""Number of paths that must have been in a bin for its density to be given: its relative standard
error is then at most one over the root of this number."""

SECONDS = 5.0
"""Budget of the densities of a picture, s."""


@dataclass(frozen=True, kw_only=True, eq=False)
class BandedDensity:
    """The density of a displacement in bins, with its error.

    Parameters
    ----------
    edges
        Edges of the bins, m from the unloaded springs. Bins that hardly any path was in are left
        out, so that the area may be a little below 1.
    density
        Probability over the width of the bin, 1/m; one value fewer than `edges`.
    standard_error
        Standard error of each, 1/m.
    """

    edges: Vector
    density: Vector
    standard_error: Vector

    def bands(self) -> tuple[Vector, Vector]:
        """The lower and the upper 95 % limits, 1/m."""
        half = GAUSSIAN_95 * self.standard_error
        return np.maximum(self.density - half, 0.0), self.density + half

    @classmethod
    def of(cls, shares: Matrix, low: float, high: float) -> BandedDensity:
        """The density from the shares of time (paths, bins) that paths spend in equal bins from
        `low` to `high`."""
        paths, bins = shares.shape
        edges = np.linspace(low, high, bins + 1)
        seen = np.count_nonzero(shares, axis=0)
        (known,) = np.nonzero(seen >= min(FEWEST_SEEN, paths))
        first, last = (known[0], known[-1] + 1) if len(known) else (0, 0)
        kept = slice(first, last)
        mean = shares.mean(axis=0)[kept]
        error = shares.std(axis=0, ddof=1)[kept] / math.sqrt(paths)
        # the scatter of few visits says too little: their number has its binomial error
        missed = (1.0 - seen[kept] / paths) / np.maximum(seen[kept], 1)
        error = np.maximum(error, mean * np.sqrt(missed))
        width = (high - low) / bins
        return cls(
            edges=edges[first : last + 1], density=mean / width, standard_error=error / width
        )


@dataclass(frozen=True, eq=False)
class DensitySampler(ListSampler):
    """Shares of time (paths, motions, BINS) that paths spend in the bins of some motions.

    Each motion is a row of the coordinates, with its span in m.
    """

    plan: HistoryPlan
    rows: tuple[tuple[float, ...], ...]
    spans: tuple[tuple[float, float], ...]
    seed: int

    @property
    def block(self) -> int:
        """Number of paths that are recorded together."""
        return self.plan.block

    def add_up(self, pieces: list[Matrix]) -> list[Matrix]:
        """The shares of a block."""
        return [np.concatenate(pieces)]

    def paths(self, sample: list[Matrix]) -> int:
        """Number of paths."""
        return sum(len(each) for each in sample)

    def simulate(self, first_path: int, paths: int) -> Matrix:
        """The shares of some paths."""
        moved = self.plan.histories(self.seed, first_path, paths).displacement
        found = np.empty((paths, len(self.rows), BINS))
        for motion, (row, span) in enumerate(zip(self.rows, self.spans, strict=True)):
            for path, places in enumerate(np.tensordot(np.array(row), moved, axes=1)):
                found[path, motion] = np.histogram(places, BINS, span)[0] / len(places)
        return found


@sampled
def densities(
    scene: Scene,
    motions: Mapping[str, tuple[Vector, float, float]],
    **options: Unpack[RunOptions],
) -> dict[str, BandedDensity]:
    """Simulate the densities of some motions of a scene.

    Parameters
    ----------
    scene
        Any scene that `simulate` covers.
    motions
        By name, the motion as a row (n,) of the coordinates, and the ends of its bins, m.
    **options
        `RunOptions`.

    Returns
    -------
    dict[str, BandedDensity]
        The density of each.

    Raises
    ------
    NotApplicable
        If `simulate` does not cover the scene.

    Examples
    --------
    >>> from stochvi.scenes.excitations import WhiteNoise
    >>> from stochvi.scenes.structures import Oscillator
    >>> scene = Scene(
    ...     structure=Oscillator(mass=1.0, damping=0.2, stiffness=1.0),
    ...     excitations=[WhiteNoise(intensity=0.4)],
    ... )
    >>> found = densities(scene, {"x": (np.ones(1), -5.0, 5.0)}, seed=1)["x"]
    >>> low, high = found.bands()
    >>> middle = int(np.argmin(np.abs(found.edges)))
    >>> bool(low[middle] < 1.05 / math.sqrt(2.0 * math.pi) and high[middle] > 0.37)
    True
    """
    run = Run.of(options)
    plan = plan_histories(scene, run.deadline)
    step = 2.0 * math.pi / (SAMPLES_PER_PERIOD * plan.fastest)
    plan = plan.sampled(step, min(RELAXATIONS * plan.slowest, MOST_SAMPLES * step))
    sampler = DensitySampler(
        plan, tuple(tuple(row.tolist()) for row, _, _ in motions.values()),
        tuple((low, high) for _, low, high in motions.values()), run.seed,
    )  # fmt: skip
    shares = np.concatenate(run.until(sampler, PATHS, needed=FEWEST_PATHS).sample)
    found = {
        name: BandedDensity.of(shares[:, number], low, high)
        for number, (name, (_, low, high)) in enumerate(motions.items())
    }
    if run.deadline.interrupted:
        raise run.deadline.fell_short(f"after {len(shares)} paths", "", found)
    return found


@dataclass(frozen=True, eq=False)
class AveragedBins:
    """The averaged density of a displacement in bins, m from the unloaded spring, 1/m."""

    edges: Vector
    averaged: AveragedDensity

    @property
    def density(self) -> Vector:
        """The density in the middle of each bin."""
        return self.averaged.displacement_density(self._middles)

    def bands(self) -> tuple[Vector, Vector]:
        """The limits of the atlas of errors; NaN where it has none."""
        return self.averaged.bands(self._middles)

    @property
    def _middles(self) -> Vector:
        return np.asarray((self.edges[1:] + self.edges[:-1]) / 2.0)


def densities_of(found: Response) -> Mapping[str, BandedDensity | AveragedBins]:
    """The densities that the picture of a simulation or of averaging shows: of the only coordinate,
    or of every gap.

    Raises
    ------
    NotApplicable
        Where the scene cannot be made again from the answer.
    """
    scene = _scene_of(found.provenance.get("scene", {}))
    motions = motions_of(found, model_of(scene))
    method, _, variant = found.method.partition(":")
    if method == "average":
        averaged = average_density(scene, variant=variant)
        return {
            name: AveragedBins(np.linspace(low, high, BINS + 1), averaged)
            for name, (_, low, high) in motions.items()
        }
    seed = found.provenance.get("seed") or 0
    return partial_result(densities, scene, motions, seed=seed, budget=SECONDS)


def _scene_of(document: Mapping[str, Any]) -> Scene:
    """The scene of an answer: the one that it was asked for, or one by its keys."""
    known = getattr(document, "made_from", None)
    if known is not None and known.document() == document:
        return known  # type: ignore[no-any-return]
    try:
        return scene_from(document)
    except SceneError as error:
        raise NotApplicable(
            "densities",
            [f"the answer must know its scene, whose document cannot be read: {error}; ask for it "
             "again, by simulate or average, in this process"],
        ) from None  # fmt: skip


def motions_of(found: Response, model: Model) -> dict[str, tuple[Vector, float, float]]:
    """The motions of an answer that have stops, or its only coordinate, with the ends of their
    bins: some standard deviations, within rigid stops."""
    if len(model.coordinates) == 1 and len(model.pairs) <= 1:
        (name,) = model.coordinates
        return _motion(name, np.ones(1), found, name, model.pairs[0] if model.pairs else None)
    motions: dict[str, tuple[Vector, float, float]] = {}
    for pair in model.pairs:
        owner = pair.name if pair.relative else model.coordinates[int(np.argmax(pair.direction))]
        motions |= _motion(pair.name, pair.direction, found, owner, pair)
    return motions


def _motion(
    name: str, row: Vector, found: Response, owner: str, pair: Pair | None
) -> dict[str, tuple[Vector, float, float]]:
    """One motion with the ends of its bins; nothing where its deviation is not known."""
    known = found.impact_pairs[owner] if owner not in found.coordinates else None
    mean, std = (
        (known.relative_displacement_mean, known.relative_displacement_std)
        if known is not None
        else (found.coordinates[owner].displacement_mean, found.coordinates[owner].displacement_std)
    )
    if not isinstance(std, Estimate) or not std.value:
        return {}
    centre = 0.0 if mean is None else float(mean)
    low, high = centre - REACH * std.value, centre + REACH * std.value
    for stop in () if pair is None else pair.stops:
        if stop.rigid and stop.side < 0:
            low = max(low, stop.position)
        elif stop.rigid:
            high = min(high, stop.position)
    return {name: (np.asarray(row), low, high)} if high > low else {}
