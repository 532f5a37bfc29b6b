"""Clatter: what compliant stops do to the acceleration of what they protect.

With stops the rms hides the trouble: impacts are short. A restitution gives impacts and their
speeds but no acceleration; that needs a stiffness.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Unpack

import numpy as np

from stochvi.isolators.moved_stops import at_clearances
from stochvi.mathematics.arrays import Vector
from stochvi.methods.monte_carlo.kernels.rows import Extremes, Sums
from stochvi.methods.monte_carlo.tabulated import TabulatedPlan, plan_tabulated
from stochvi.model.calculations import calculation
from stochvi.model.coverage import beyond_one_oscillator
from stochvi.model.model import model_of
from stochvi.results.errors import NotApplicable
from stochvi.results.estimates import Estimate, of_events
from stochvi.results.intervals import jackknife_ratio, mean_and_error, student_factor
from stochvi.sampling.options import AccuracyOptions
from stochvi.sampling.run import Run, sampled
from stochvi.sampling.sampler import Sampler
from stochvi.scenes.impact_laws import Elastic, Viscoelastic
from stochvi.scenes.scene import Scene

if TYPE_CHECKING:
    import pandas as pd


SAMPLES_PER_PERIOD = 40.0
"""Samples per natural period: a free crest between two of them is missed by at most 0.3 %."""

FIRST_PATHS = 128
"""Number of windows in the first round: enough for a trustworthy standard error."""


@calculation
@sampled(rel_error=0.02)
def clatter(
    scene: Scene,
    clearances: Sequence[float],
    *,
    stiffness_ratios: Sequence[float] | None = None,
    window: float = 18.0,
    **options: Unpack[AccuracyOptions],
) -> pd.DataFrame:
    """Rms and peak of the absolute acceleration against clearance and stiffness of the stops.

    The absolute acceleration is -(b x' + omega^2 x) less the force of the stop per unit mass. Its
    mean square follows from time averages, the part of the contacts integrated within them,

        E a^2 = b^2 E x'^2 + omega^4 E x^2 + E F^2 + 2 omega^2 E x F + 2 b E x' F

    its largest value in a window from every contact and every sample.

    Parameters
    ----------
    scene
        An isolator on a noisy base between compliant stops, whose laws are kept.
    clearances
        Metres per side from the static equilibrium.
    stiffness_ratios
        Stiffness of elastic or viscoelastic stops over that of the mount, each with each
        clearance; by default that of the scene.
    window
        Length in seconds of the windows whose largest acceleration is taken.
    **options
        `AccuracyOptions`: `rel_error` is that of the mean largest acceleration, by default 0.02.
        The rows share the `budget` evenly, at the end of which they have larger errors.

    Returns
    -------
    pandas.DataFrame
        A row per clearance and stiffness, SI units, standard errors in columns with `_error`:
        `clearance`, `clearance_in_sigma`, `stiffness_ratio` (NaN for the scene's own),
        `hit_rate` (all contacts), `acceleration_rms`, `largest_acceleration` (mean over windows),
        `rms_amplification` and `peak_amplification`. The last two are ratios to the same without
        stops, from the same random numbers. `hit_rate_upper_95` is given where contacts were seen
        in too few windows for an interval, else it is NaN. `largest_acceleration_bias` is a third
        of the change with half as many samples.

    Raises
    ------
    NotApplicable
        Without stops, or with a rigid one: a restitution has no stiffness.

    See Also
    --------
    stochvi.isolators.jolts : Which jolt leads to clatter.
    stochvi.harmonic_response : The regimes without noise.

    Examples
    --------
    >>> from stochvi.scenes.excitations import TabulatedNoise
    >>> from stochvi.scenes.scene import ImpactPair
    >>> from stochvi.scenes.structures import Isolator
    >>> stops = ImpactPair(lower=-6e-3, upper=6e-3, law=Elastic(stiffness=5.7e5))
    >>> truck = TabulatedNoise(profile="mil-std-810h-truck-vertical-5hz")
    >>> mount = Isolator(frequency_hz=12.0, zeta=0.1, mass=1.0)
    >>> scene = Scene(structure=mount, impact_pairs=[stops], excitations=[truck])
    >>> row = clatter(scene, [6e-3], rel_error=0.1).iloc[0]
    >>> bool(1.0 < row["rms_amplification"] < 1.1 and 4.0 < row["peak_amplification"] < 6.0)
    True
    """
    import pandas as pd

    _check(scene, clearances, stiffness_ratios)
    free = scene.model_copy(update={"impact_pairs": ()})
    rows: list[dict[str, float]] = []
    wanted = [
        (ratio, stopped, clearance)
        for ratio, stopped in _variants(scene, stiffness_ratios)
        for clearance in clearances
    ]
    run = Run.of(options)
    for ratio, stopped, clearance in wanted:
        if run.deadline.interrupted:
            break
        done, number = len(rows), len(wanted)
        row = run.part(
            done / number, (done + 1) / number, f"row {done + 1} of {number}",
            run.deadline.share(1.0 / (number - done)),
        )  # fmt: skip
        plan = plan_windows(at_clearances(stopped, clearance), window)
        windows = _Windows(plan, plan_windows(free, window), row)
        rows.append(
            {
                "clearance": clearance,
                "clearance_in_sigma": clearance / windows.sigma,
                "stiffness_ratio": math.nan if ratio is None else ratio,
                **windows.columns(),
            }
        )
    if run.deadline.interrupted:
        where = f"after {len(rows)} of {len(wanted)} rows"
        raise run.deadline.fell_short(where, "", pd.DataFrame(rows))
    return pd.DataFrame(rows)


def _check(
    scene: Scene, clearances: Sequence[float], stiffness_ratios: Sequence[float] | None
) -> None:
    model = model_of(scene)
    unmet = beyond_one_oscillator(model, with_filters=True)
    if unmet:
        raise NotApplicable("clatter", unmet)
    if not scene.impact_pairs:
        raise NotApplicable("clatter", ["the scene needs an impact_pair, for its law"])
    if any(stop.rigid for stop in model.stops):
        unmet.append(
            "a stop with a restitution alone has no stiffness, so impacts have no acceleration; "
            "give an elastic, viscoelastic, hertz or table law"
        )
    if stiffness_ratios is not None and not all(
        isinstance(stop.law, Elastic | Viscoelastic) for stop in model.stops
    ):
        unmet.append(
            "law must be elastic or viscoelastic at every stop for stiffness_ratios, got "
            + ", ".join(sorted({repr(stop.law.kind) for stop in model.stops}))
        )
    if not model.moving_base or model.noise_on_mass:
        unmet.append("structure.kind must be 'isolator' with noise on its base only")
    if unmet:
        raise NotApplicable("clatter", unmet)
    for name, values in (("clearances", clearances), ("stiffness_ratios", stiffness_ratios or ())):
        if any(not 0.0 < value < math.inf for value in values):
            raise ValueError(f"{name} must be positive, got {list(values)}")


def _variants(
    scene: Scene, stiffness_ratios: Sequence[float] | None
) -> Iterator[tuple[float | None, Scene]]:
    """The scene with its own stops, or with stops of other stiffness."""
    if stiffness_ratios is None:
        yield None, scene
        return
    pair, model = scene.impact_pairs[0], model_of(scene)
    for ratio in stiffness_ratios:
        stiffness = ratio * model.unit_mass * model.omega**2
        laws = {
            name: law.model_copy(update={"stiffness": stiffness})
            for name in ("law", "lower_law", "upper_law")
            if (law := getattr(pair, name)) is not None
        }
        yield ratio, scene.model_copy(update={"impact_pairs": (pair.model_copy(update=laws),)})


def plan_windows(scene: Scene, window: float) -> TabulatedPlan:
    """Paths of the length of a window, sampled finely enough for free crests."""
    # the threshold speed is 0: every contact counts, however slow
    plan = plan_tabulated(model_of(scene), 0.0, window)
    period = 2.0 * math.pi / plan.model.omega
    return plan.with_step(min(plan.step, period / SAMPLES_PER_PERIOD))


@dataclass(frozen=True)
class _Averages:
    """Averages of windows: impacts per second, mean square and largest absolute acceleration."""

    hits: Vector
    mean_square: Vector
    largest: Vector

    def __add__(self, other: _Averages) -> _Averages:
        pairs = zip(vars(self).values(), vars(other).values(), strict=True)
        return _Averages(*(np.concatenate(pair) for pair in pairs))


def _averages(plan: TabulatedPlan, seed: int, first_path: int, paths: int) -> _Averages:
    extremes = Extremes.zeros(paths)
    means = Sums(plan.averages(seed, first_path, paths, None, extremes.table))
    b, stiff = plan.model.damping_rate, plan.model.omega**2
    square = b**2 * means.velocity_square + stiff**2 * means.displacement_square
    if plan.contacts:
        within = extremes.force_square + 2.0 * stiff * extremes.position_force
        square = square + 2.0 * b * means.contact_loss + within / plan.duration
    return _Averages(means.impacts, square, extremes.acceleration)


@dataclass(frozen=True, eq=False)
class WindowSampler(Sampler[list[_Averages], list[_Averages]]):
    """Windows by several plans, all from the same random numbers."""

    plans: tuple[TabulatedPlan, ...]
    seed: int

    @property
    def block(self) -> int:
        """Number of windows that are simulated together."""
        return min(plan.block for plan in self.plans)

    def simulate(self, first_path: int, paths: int) -> list[_Averages]:
        """Averages of some windows by each plan."""
        return [_averages(plan, self.seed, first_path, paths) for plan in self.plans]

    def add_up(self, pieces: list[list[_Averages]]) -> list[_Averages]:
        """Averages of a block."""
        found = pieces[0]
        for piece in pieces[1:]:
            found = self.merge(found, piece)
        return found

    def merge(self, sample: list[_Averages], more: list[_Averages]) -> list[_Averages]:
        """Averages of both groups of windows."""
        return [old + new for old, new in zip(sample, more, strict=True)]

    def paths(self, sample: list[_Averages]) -> int:
        """Number of windows."""
        return len(sample[0].largest)


class _Windows:
    """Windows with stops, with stops at half as many samples, and without stops, all from the same
    random numbers."""

    def __init__(self, plan: TabulatedPlan, free: TabulatedPlan, run: Run) -> None:
        sampler = WindowSampler((plan, plan.coarser(), free), run.seed)

        def error(found: list[_Averages]) -> float:
            mean, error = mean_and_error(found[0].largest)
            return error / mean if mean else 0.0

        self.found = run.to_accuracy(sampler, FIRST_PATHS, error, run.accuracy).sample
        variance = np.sum(free.amplitudes**2)
        self.sigma = math.sqrt(float(variance))

    def columns(self) -> dict[str, float]:
        """Columns of one row."""
        stopped, coarse, free = self.found
        hits, hits_error = mean_and_error(stopped.hits)
        square, square_error = mean_and_error(stopped.mean_square)
        rms = math.sqrt(square)
        largest, largest_error = mean_and_error(stopped.largest)
        hit_rate = of_events(Estimate(value=hits, standard_error=hits_error), len(stopped.hits))
        # the windows with stops and without them have their random numbers in common
        rms_ratio, rms_ratio_error = jackknife_ratio(stopped.mean_square, free.mean_square, np.sqrt)
        peak_ratio, peak_ratio_error = jackknife_ratio(stopped.largest, free.largest)
        few = student_factor(len(stopped.hits))
        return {
            "hit_rate": hit_rate.value,
            "hit_rate_error": hit_rate.standard_error,
            "hit_rate_upper_95": math.nan if hit_rate.upper_95 is None else hit_rate.upper_95,
            "acceleration_rms": rms,
            "acceleration_rms_error": few * 0.5 * square_error / rms,
            "largest_acceleration": largest,
            "largest_acceleration_error": few * largest_error,
            "largest_acceleration_bias": abs(float(coarse.largest.mean()) - largest) / 3.0,
            "rms_amplification": rms_ratio,
            "rms_amplification_error": few * rms_ratio_error,
            "peak_amplification": peak_ratio,
            "peak_amplification_error": few * peak_ratio_error,
            "windows": float(len(stopped.largest)),
        }
