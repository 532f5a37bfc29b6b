"""Densities by Monte Carlo. Chapters: histograms; an overview of one oscillator, with a short
record of impacts; densities of displacements with 95 % bands."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Unpack

import numpy as np
from numpy.typing import ArrayLike

from stochvi.mathematics.numerics import Matrix, Vector
from stochvi.methods.averaging import AveragedDensity, average_density
from stochvi.methods.closed_form import displacement_density, exact, unmet
from stochvi.methods.monte_carlo import record_path
from stochvi.model.model import Model, Pair, model_of
from stochvi.motion.choose_plan import HistoryPlan, plan_histories
from stochvi.results.base import DataFrame, Response, frame_of
from stochvi.results.deadline import partial_result
from stochvi.results.errors import NotApplicable, SceneError
from stochvi.results.estimates import GAUSSIAN_95, Estimate
from stochvi.sampling.calculations import ListSampler, RunOptions
from stochvi.sampling.run import Run, sampled
from stochvi.scenes.scene import Scene, scene_from

# ------------------------------------------------------------------------------
# Histograms of samples, normalised to a probability density.
# ------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class SampledDensity:
    """A histogram whose area is 1.

    Parameters
    ----------
    edges
        Edges of the bins, in the unit of the samples.
    density
        Probability density in each bin, one value fewer than `edges`.
    """

    edges: Vector
    density: Vector

    @classmethod
    def of(cls, samples: ArrayLike, bins: int, low: float, high: float) -> SampledDensity:
        """The histogram of the samples between `low` and `high`.

        The caller chooses the number of bins; `OverviewSettings` has that of an overview.

        Examples
        --------
        >>> SampledDensity.of([0.5, 0.6, 1.5, 9.0], 2, 0.0, 2.0).density.round(3).tolist()
        [0.667, 0.333]
        """
        density, edges = np.histogram(samples, bins=bins, range=(low, high), density=True)
        return cls(edges=edges.astype(float), density=density.astype(float))


# ------------------------------------------------------------------------------
# An overview of one oscillator: densities of its motion and a short record with impacts.
# ------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class OverviewSettings:
    """How long the paths are, and how finely their densities are shown.

    Parameters
    ----------
    density_periods
        Natural periods of the path behind the histograms: smooth for a damping ratio of 1 %.
    searched_periods
        Natural periods that are searched for an impact to show.
    record_periods
        Natural periods of the record that is shown.
    steps_per_period
        Samples of that record in a natural period.
    settling_share
        Share of the searched path that is left out at its start, where it is not stationary.
    displacement_bins, velocity_bins
        Numbers of bins of the histograms.
    velocity_reach
        Half width of the histogram of the velocity, in rms velocities.
    curve_points
        Points of the exact density of the displacement.
    """

    density_periods: float = 60_000.0
    searched_periods: float = 400.0
    record_periods: float = 25.0
    steps_per_period: float = 80.0
    settling_share: float = 0.1
    displacement_bins: int = 60
    velocity_bins: int = 70
    velocity_reach: float = 4.2
    curve_points: int = 801


DEFAULTS = OverviewSettings()


@dataclass(frozen=True, kw_only=True)
class Overview:
    """The numbers that a picture of an oscillator between its stops shows (SI units).

    Parameters
    ----------
    scene
        The scene that was simulated.
    displacement, velocity
        Histograms of a long path.
    velocity_rms
        Rms velocity of that path about 0.
    exact_displacement
        The exact density of the displacement: columns `displacement` and `density`. None where no
        exact answer is known.
    exact_velocity_std
        The exact standard deviation of the velocity, whose law is then normal; None as above.
    mean_without_stops, std_without_stops
        Mean and standard deviation of the displacement without stops, whose law is normal; the
        standard deviation is None where no exact answer without stops is known.
    record
        A short record, as from `record_path`, that begins shortly before an impact if there is one.
    """

    scene: Scene
    displacement: SampledDensity
    velocity: SampledDensity
    velocity_rms: float
    exact_displacement: DataFrame | None
    exact_velocity_std: float | None
    mean_without_stops: float
    std_without_stops: float | None
    record: DataFrame


def overview(scene: Scene, settings: OverviewSettings = DEFAULTS) -> Overview:
    """Simulate what a picture of one oscillator shows, beside its exact densities.

    Parameters
    ----------
    scene
        One oscillator with a positive natural frequency.
    settings
        Lengths of the paths and numbers of bins.

    Examples
    --------
    >>> from stochvi.scenes.excitations import WhiteNoise
    >>> from stochvi.scenes.structures import Oscillator
    >>> scene = Scene(
    ...     structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
    ...     excitations=[WhiteNoise(intensity=0.2)],
    ... )
    >>> found = overview(scene, OverviewSettings(density_periods=50.0, searched_periods=50.0))
    >>> round(found.std_without_stops, 6), round(found.exact_velocity_std, 6)
    (1.0, 1.0)
    """
    model = model_of(scene)
    period = 2.0 * math.pi / model.omega
    path = record_path(scene, duration=settings.density_periods * period, seed=1)
    x, v = path["displacement"].to_numpy(), path["velocity"].to_numpy()
    rms = float(np.sqrt(np.mean(v**2)))
    without_stops = scene.model_copy(update={"impact_pairs": ()})
    density, velocity_std = None, None
    if not unmet(model_of(scene)):
        grid = np.linspace(x.min(), x.max(), settings.curve_points)
        values = displacement_density(scene, grid)
        density = frame_of({"displacement": grid, "density": values})
        velocity_std = exact(scene).estimates()["x", "velocity_std"].value
    linear = None
    if not unmet(model_of(without_stops)):
        linear = exact(without_stops).estimates()["x", "displacement_std"].value
    reach = settings.velocity_reach * rms
    return Overview(
        scene=scene,
        displacement=SampledDensity.of(x, settings.displacement_bins, x.min(), x.max()),
        velocity=SampledDensity.of(v, settings.velocity_bins, -reach, reach),
        velocity_rms=rms,
        exact_displacement=density,
        exact_velocity_std=velocity_std,
        mean_without_stops=model.rest,
        std_without_stops=linear,
        record=_stretch_with_impacts(scene, period, settings),
    )


def _stretch_with_impacts(scene: Scene, period: float, settings: OverviewSettings) -> DataFrame:
    """Some periods of a finely stepped record, from shortly before an impact if there is one."""
    searched = settings.searched_periods * period
    shown = settings.record_periods * period
    record = record_path(scene, duration=searched, seed=2, step=period / settings.steps_per_period)
    settled = record[record["time"] > settings.settling_share * searched]
    hits = settled.loc[settled["impact_speed"] != 0.0, "time"]
    last = settled["time"].iloc[-1] - shown
    start = min(hits.iloc[0] - 2.0 * period if len(hits) else settled["time"].iloc[0], last)
    short = settled[settled["time"].between(start, start + shown)]
    return short.assign(time=short["time"] - short["time"].iloc[0])


# ------------------------------------------------------------------------------
# Densities of displacements by Monte Carlo, with 95 % bands, where someone asks for them.
#
# Every path gives the share of its time in each bin, and paths are independent. The density of a
# bin is the mean of these shares over the width of the bin, and its standard error follows from
# their scatter.
# ------------------------------------------------------------------------------


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

    def to_frame(self) -> DataFrame:
        """A row for each bin: the displacement in its middle, m, and the density there, 1/m."""
        lower, upper = self.bands()
        middles = 0.5 * (self.edges[1:] + self.edges[:-1])
        return frame_of(
            {
                "displacement": middles, "value": self.density,
                "standard_error": self.standard_error, "lower": lower, "upper": upper,
                "unit": "1/m",
            }
        )  # fmt: skip

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
            f"the answer must know its scene, whose document cannot be read: {error}; ask for it "
            "again, by simulate or average, in this process",
        ) from None


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
