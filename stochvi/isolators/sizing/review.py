"""The review of a sizing: what a design review needs besides the clearance. Chapters: the motion
between stops at 3 sigma; clatter of compliant stops; the review."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import TYPE_CHECKING, Any, Unpack

import numpy as np

from stochvi.isolators.bumpers import hardest_contact
from stochvi.isolators.screening import (
    Environment,
    Screening,
    at_clearances,
    environment,
    frequencies,
    input_density,
    noise_on_base_alone,
    predicted_rates,
    transmissibility,
)
from stochvi.isolators.sizing.answer import RoundedClearance, Sizing, probability_at, two_sided
from stochvi.isolators.sizing.risk_curve import exceedances
from stochvi.isolators.tolerances import Tolerances
from stochvi.mathematics.numerics import ROUNDING, Vector
from stochvi.mathematics.spectra import welch
from stochvi.methods.monte_carlo import record_path
from stochvi.model.coverage import beyond_one_oscillator
from stochvi.model.model import model_of
from stochvi.motion.choose_plan import with_tables
from stochvi.motion.modal_tables import ModalTablesPlan, plan_modal_tables
from stochvi.results.base import DataFrame, Response, frame_of, plain, stacked
from stochvi.results.deadline import NEVER, Deadline
from stochvi.results.errors import NotApplicable, NotConverged
from stochvi.results.estimates import (
    Estimate,
    jackknife_ratio,
    mean_and_error,
    of_events,
    student_factor,
)
from stochvi.sampling.calculations import AccuracyOptions, Sampler, calculation
from stochvi.sampling.run import Run, sampled
from stochvi.scenes.impact_laws import CompliantLaw, Elastic, Viscoelastic
from stochvi.scenes.scene import UNLOADED, Scene
from stochvi.scenes.structures import Oscillator
from stochvi.statistics.densities import SampledDensity

if TYPE_CHECKING:
    from stochvi.model.model import Model


# ------------------------------------------------------------------------------
# The motion of an isolator between its stops at 3 sigma, from one long simulated path.
# ------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class PathSettings:
    """Length of the path, and how its statistics are taken.

    Parameters
    ----------
    periods
        Length of the path in natural periods: it takes seconds to simulate, and has some hundred
        impacts on stops at 3 sigma of a light mount.
    burn_in_share
        Share of the path that is left out at its start, where it is not stationary.
    fewest_hits
        Number of impacts from which on percentiles of their speeds are given.
    percentiles
        Percentiles of the impact speed.
    bins, reach
        Number of bins of the histogram, and its half width in linear standard deviations, unless
        the path itself reaches further.
    segment_periods
        Natural periods in a segment of Welch's method: they resolve a damping ratio of 2 %.
    synthesised_share
        Share of half the sampling rate up to which the density of a path is taken: above it, a
        synthesised path carries power that is folded from higher frequencies.
    exact_ranks, rank_ratio
        Number of the fastest impacts that the table of exceedances holds one by one. In the rows
        that follow the number of impacts grows by the ratio: few rows show the same curve.
    """

    periods: float = 20_000.0
    burn_in_share: float = 0.02
    fewest_hits: int = 20
    percentiles: tuple[float, ...] = (50.0, 95.0, 99.0)
    bins: int = 120
    reach: float = 4.5
    segment_periods: float = 60.0
    synthesised_share: float = 0.7
    exact_ranks: int = 200
    rank_ratio: float = 1.01


@dataclass(frozen=True, kw_only=True)
class MotionBetweenStops:
    """Statistics of a long path between stops at 3 sigma (SI units).

    Parameters
    ----------
    scene
        The scene that was simulated, its stops at 3 sigma from the static equilibrium.
    duration, hits
        Seconds of the path and number of its impacts.
    kurtosis
        E x^4 / (E x^2)^2 of the displacement about its mean; 3 for a Gaussian motion.
    mean_position
        Mean position without stops, m.
    displacement
        Histogram of the displacement.
    faster_hits
        `impact_speed` (m/s) and the `rate` (1/s) of impacts at least so fast; None for few impacts.
    impacts
        One row per percentile of the impact speed: `percentile`, `impact_speed` and, for stops
        that are compliant, `peak_acceleration` (m/s^2), `deflection` (m) and `contact_time` (s) of
        the harder side, the base at rest meanwhile. None for few impacts.
    transmissibility
        `frequency_hz` and the apparent `transmissibility`: root of the density of
        -(b v + omega^2 x), the part of the acceleration that spring and damper cause, over that of
        the base. None unless noise moves the base and nothing else shakes the mass.
    transmissibility_change
        Largest relative difference of the apparent transmissibility from the one without stops,
        over bands of a third of an octave.
    """

    not_in_document = ("scene",)
    as_columns = ("faster_hits", "impacts", "transmissibility")

    scene: Scene
    duration: float
    hits: int
    kurtosis: float
    mean_position: float
    displacement: SampledDensity
    faster_hits: DataFrame | None
    impacts: DataFrame | None
    transmissibility: DataFrame | None
    transmissibility_change: float | None


def motion_between_stops(
    sizing: Sizing, settings: PathSettings | None = None
) -> MotionBetweenStops:
    """Simulate one long path of a sized isolator, with its stops at 3 sigma and their laws."""
    settings = settings or PathSettings()
    scene = at_clearances(sizing.scene, sizing.three_sigma.clearance)
    model = model_of(scene)
    period = 2.0 * math.pi / model.omega
    fine = bool(model.whites) and noise_on_base_alone(model)
    path = record_path(
        scene,
        duration=settings.periods * period,
        seed=sizing.seed,
        step=period / WHITE_SAMPLES if fine else None,
    )
    # filtered noise makes the structure one of several oscillators, whose columns have names
    path = path.rename(columns=lambda name: name.partition(" of ")[0])
    path = path.iloc[round(settings.burn_in_share * len(path)) :]
    duration = float(path["time"].iloc[-1] - path["time"].iloc[0])
    speeds = path["impact_speed"].abs().to_numpy()
    speeds = np.sort(speeds[speeds > 0.0])
    rest = model.rest
    samples = path["displacement"].to_numpy()
    apparent = (
        _apparent_transmissibility(model, path, settings) if noise_on_base_alone(model) else None
    )
    reach = 1.05 * max(float(abs(samples - rest).max()), settings.reach * sizing.sigma)
    many = len(speeds) >= settings.fewest_hits
    return MotionBetweenStops(
        scene=scene,
        duration=duration,
        hits=len(speeds),
        kurtosis=_kurtosis(samples),
        mean_position=rest,
        displacement=SampledDensity.of(
            samples, settings.bins, *_ends(model, rest - reach, rest + reach)
        ),
        faster_hits=_faster_hits(speeds, duration, settings) if many else None,
        impacts=_impacts(scene, speeds, settings) if many else None,
        transmissibility=apparent,
        transmissibility_change=_largest_change(model, apparent),
    )


def _ends(model: Model, low: float, high: float) -> tuple[float, float]:
    """Ends of a histogram: a rigid stop, since no displacement lies beyond it, else the given
    end."""
    for stop in model.stops:
        if stop.rigid and stop.position < model.rest:
            low = stop.position
        elif stop.rigid:
            high = stop.position
    return low, high


def _kurtosis(samples: Vector) -> float:
    x = samples - samples.mean()
    return float(np.mean(x**4) / np.mean(x**2) ** 2)


def _faster_hits(speeds: Vector, duration: float, settings: PathSettings) -> DataFrame:
    """Rate of impacts at least as fast as each of the sorted speeds, thinned where they are
    many."""
    fastest = min(settings.exact_ranks, len(speeds))
    steps = math.log(len(speeds) / fastest) / math.log(settings.rank_ratio)
    more = np.geomspace(fastest, len(speeds), math.ceil(steps) + 1).round().astype(int)
    ranks = np.unique(np.concatenate([np.arange(1, fastest + 1), more]))[::-1]
    return frame_of({"impact_speed": speeds[-ranks], "rate": ranks / duration})


def _impacts(scene: Scene, speeds: Vector, settings: PathSettings) -> DataFrame:
    """Percentiles of impact speed and, of compliant stops, what the mass then feels."""
    model = model_of(scene)
    stops = [
        (stop.law, abs(stop.position - model.rest))
        for stop in model.stops_per_unit_mass
        if isinstance(stop.law, CompliantLaw)
    ]
    met = np.percentile(speeds, settings.percentiles)
    found = frame_of({"percentile": settings.percentiles, "impact_speed": met})
    if stops:
        hit = hardest_contact(model, stops, met)
        found["peak_acceleration"], found["deflection"] = hit.peak_acceleration, hit.deflection
        found["contact_time"] = hit.contact_time
    return found


WHITE_SAMPLES = 40
"""Samples in a natural period where white noise shakes the base and a density is taken: at the long
steps that suffice for averages, the density is that of the kicks, not of the noise."""

MOST_FOLDED = 0.03
"""Largest share of the transmissibility at a frequency that may come from another one, folded to it
by the sampling."""


def _apparent_transmissibility(model: Model, path: DataFrame, settings: PathSettings) -> DataFrame:
    step = float(path["time"].iloc[1] - path["time"].iloc[0])
    period = 2.0 * math.pi / model.omega
    length = min(round(settings.segment_periods * period / step), len(path))
    acceleration = model.damping_rate * path["velocity"] + model.omega**2 * (
        path["displacement"] - model.rest
    )
    frequency, density = welch(acceleration.to_numpy(), 1.0 / step, length)
    base = input_density(model, frequency)
    highest = settings.synthesised_share / (2.0 * step)
    seen = (frequency > 0.0) & (frequency < highest) & (base > 0.0)
    seen &= frequency >= frequencies(model)[0]
    if model.whites:  # the kicks of a step shake at all of the frequencies that it folds to one
        folded = transmissibility(model, np.abs(1.0 / step - frequency))
        seen &= folded < MOST_FOLDED * transmissibility(model, frequency)
    return frame_of(
        {
            "frequency_hz": frequency[seen],
            "transmissibility": np.sqrt(density[seen] / base[seen]),
        }
    )


FEWEST_IN_BAND = 4
"""Number of frequencies that a band must hold to be compared."""


def _largest_change(model: Model, apparent: DataFrame | None) -> float | None:
    """Largest relative difference of bands from the transmissibility without stops."""
    if apparent is None or not len(apparent):
        return None
    frequency = apparent["frequency_hz"].to_numpy()
    power = apparent["transmissibility"].to_numpy() ** 2
    known = transmissibility(model, frequency) ** 2
    band = np.floor(3.0 * np.log2(frequency) + ROUNDING).astype(int)
    changes = [
        math.sqrt(float(power[band == each].sum() / known[band == each].sum())) - 1.0
        for each in np.unique(band)
        if np.count_nonzero(band == each) >= FEWEST_IN_BAND
    ]
    return max(map(abs, changes), default=None)


# ------------------------------------------------------------------------------
# Clatter: what compliant stops do to the acceleration of what they protect.
#
# With stops the rms hides the trouble: impacts are short. A restitution gives impacts and their
# speeds but no acceleration; that needs a stiffness.
# ------------------------------------------------------------------------------


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
) -> DataFrame:
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
    stochvi.isolators.perturbations : Which perturbation leads to clatter.
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
        raise run.deadline.fell_short(where, "", frame_of(rows))
    return frame_of(rows)


def _check(
    scene: Scene, clearances: Sequence[float], stiffness_ratios: Sequence[float] | None
) -> None:
    model = model_of(scene)
    unmet = beyond_one_oscillator(model, with_filters=True)
    if unmet:
        raise NotApplicable("clatter", unmet)
    if not scene.impact_pairs:
        raise NotApplicable("clatter", "the scene needs an impact_pair, for its law")
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


def plan_windows(scene: Scene, window: float) -> ModalTablesPlan:
    """Paths of the length of a window, sampled finely enough for free crests."""
    # the threshold speed is 0: every contact counts, however slow
    plan = plan_modal_tables(with_tables(model_of(scene)), 0.0, window)
    period = 2.0 * math.pi / plan.model.omega
    return plan.unbroken(window).with_step(min(plan.step, period / SAMPLES_PER_PERIOD))


@dataclass(frozen=True)
class _Averages:
    """Averages of windows: impacts per second, mean square and largest absolute acceleration."""

    hits: Vector
    mean_square: Vector
    largest: Vector

    def __add__(self, other: _Averages) -> _Averages:
        pairs = zip(vars(self).values(), vars(other).values(), strict=True)
        return _Averages(*(np.concatenate(pair) for pair in pairs))


def _averages(plan: ModalTablesPlan, seed: int, first_path: int, paths: int) -> _Averages:
    """Averages of windows. The mean square is that at the samples, which fall on every phase of a
    contact alike; the largest value is that of all samples and of all sub-steps of contacts."""
    model, ((shape,),) = plan.model, plan.modes.shapes
    record, sharpest = np.zeros((plan.steps, paths, plan.record_width)), np.zeros((paths, 1))
    means = plan.averages(seed, first_path, paths, record, accelerations=sharpest)
    x, v = shape * record[:, :, 0], shape * record[:, :, 1]
    acceleration = model.damping_rate * v + model.omega**2 * x
    hits = np.zeros(paths)
    for pair in model.pairs:
        acceleration += pair.force(x + model.rest, v) / model.unit_mass
        hits += sum(
            means[plan.layout.rows.index((pair.name, f"n_{stop.name}"))] for stop in pair.stops
        )
    largest = np.maximum(np.abs(acceleration).max(axis=0), sharpest[:, 0])
    return _Averages(hits, np.mean(acceleration**2, axis=0), largest)


@dataclass(frozen=True, eq=False)
class WindowSampler(Sampler[list[_Averages], list[_Averages]]):
    """Windows by several plans, all from the same random numbers."""

    plans: tuple[ModalTablesPlan, ...]
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

    def __init__(self, plan: ModalTablesPlan, free: ModalTablesPlan, run: Run) -> None:
        sampler = WindowSampler((plan, plan.coarser(), free), run.seed)

        def error(found: list[_Averages]) -> float:
            mean, error = mean_and_error(found[0].largest)
            return error / mean if mean else 0.0

        self.found = run.to_accuracy(sampler, FIRST_PATHS, error, run.accuracy).sample
        (variance, *_) = np.diag(free.law.covariance)
        self.sigma = abs(float(free.modes.shapes[0, 0])) * math.sqrt(float(variance))

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


# ------------------------------------------------------------------------------
# The review of a sizing: every number that a design review needs besides the clearance.
# ------------------------------------------------------------------------------


PLACES = ("three_sigma", "recommended")
"""Keys of `Sizing.evidence`: the clearances at which a review gives every number."""


@dataclass(frozen=True, kw_only=True)
class PeakSettings:
    """The windows, stops and clearances for which peak accelerations are simulated.

    Parameters
    ----------
    window
        Length in seconds of the windows whose largest acceleration is taken: some hundred cycles of
        a usual mount.
    stiffness_ratios
        Stiffness of the stops over that of the mount: soft rubber, hard rubber, metal.
    multiples
        Clearances for those stops, in linear standard deviations.
    rel_error, seconds
        Relative standard error of a peak, and the seconds that each may take.
    """

    window: float = 18.0
    stiffness_ratios: tuple[float, ...] = (10.0, 100.0, 1000.0)
    multiples: tuple[float, ...] = (2.0, 2.5, 3.0, 3.5, 4.0, 5.0)
    rel_error: float = 0.05
    seconds: float = 3.0


@dataclass(frozen=True, kw_only=True)
class ReviewSettings:
    """Settings of the simulations of a review.

    Parameters
    ----------
    closure_points
        Number of clearances on the curve of the closure.
    clearances
        Number of clearances, from 3 sigma on, at which probabilities of hard impacts are found;
        where the budget has ended before, these are 3 sigma, the recommended one and a larger one.
    budget
        Seconds for all simulations together, without the long path; where they do not suffice,
        probabilities of hard impacts have wider intervals.
    periods_when_late
        Natural periods of the long path where the budget has ended before it.
    exceedance_share
        Share of that time for the probabilities of hard impacts; the rest is for the peak
        accelerations.
    """

    path: PathSettings = field(default_factory=PathSettings)
    peaks: PeakSettings = field(default_factory=PeakSettings)
    closure_points: int = 41
    clearances: int = 5
    budget: float = 60.0
    periods_when_late: float = 2_000.0
    exceedance_share: float = 0.6


@dataclass(frozen=True, kw_only=True)
class Balance:
    """A balance of a simulation, which an exact answer keeps: its residual and its judgement.

    `passed` says whether the residual is within so many standard `errors` and its bias.
    """

    name: str
    place: str
    residual: Estimate
    errors: float
    passed: bool

    @classmethod
    def of(cls, name: str, place: str, residual: Estimate) -> Balance:
        """The balance, judged."""
        most = BALANCE_ERRORS * residual.standard_error + (residual.bias or 0.0)
        return cls(
            name=name,
            place=place,
            residual=residual,
            errors=BALANCE_ERRORS,
            passed=abs(residual.value) <= most + TINY,
        )


BALANCE_ERRORS = 4.0
"""Standard errors of a balance from which on it fails: one right balance in 16,000 does."""

TINY = 1e-12
"""Residual of a balance up to which it is ascribed to rounding, where nothing was sampled."""


@dataclass(frozen=True, kw_only=True)
class Exceeding:
    """Probability in the mission that an impact exceeds a limit, at one clearance; None where it is
    not known."""

    clearance: float
    probability: float | None
    low: float | None = None
    high: float | None = None


@dataclass(frozen=True, kw_only=True)
class Mount:
    """An isolator's natural frequency, damping and, in m, sag under 1 g (None for an oscillator).

    `quality_factor` is None without damping.
    """

    natural_frequency_hz: float
    damping_ratio: float
    quality_factor: float | None
    static_sag: float | None


@dataclass(frozen=True, kw_only=True)
class Chance:
    """Probability of any impact in the mission, and of no impact; None where they are not known."""

    any_hit: float | None
    no_hit: float | None

    @classmethod
    def of(cls, any_hit: float | None) -> Chance:
        """Both probabilities, from the probability of any impact."""
        return cls(any_hit=any_hit, no_hit=None if any_hit is None else 1.0 - any_hit)


@dataclass(frozen=True, kw_only=True)
class LinearMotion:
    """Numbers of linear theory for the mission, in addition to `Screening`.

    Parameters
    ----------
    miles_error
        Miles' equation over the integral of the response, less 1; None where it is not valid.
    rice_rate_at_three_sigma
        Impacts per second at 3 sigma by Rice, as if impacts changed nothing.
    largest_displacement, largest_in_sigma
        Expected largest distance from the static equilibrium in the mission, m and standard
        deviations (Davenport 1964).
    """

    miles_error: float | None
    rice_rate_at_three_sigma: float
    largest_displacement: float
    largest_in_sigma: float


@dataclass(frozen=True, kw_only=True)
class HitsAt:
    """Simulated impacts at one clearance, on all stops; None where a number is not known, because
    no impact was seen for one.

    `rate` is in 1/s and `expected` the number in the mission, each with its 95 % limits. `by` says
    whether clusters or the whole motion was simulated.
    """

    rate: float | None
    rate_low: float
    rate_high: float
    expected: float | None
    expected_low: float
    expected_high: float
    hits_per_first_hit: float | None
    impact_speed_mean: float | None
    by: str


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """A quantity without stops by linear theory, and with stops at 3 sigma and as recommended.

    SI units; None where a value is not known. `quantity` is a name as in `Response`,
    "stop_acceleration" (mean of the peak forces over the mass, m/s^2) or "lost_power" (W/kg, taken
    by the stops).
    """

    quantity: str
    without_stops: float | None
    three_sigma: Estimate | None
    recommended: Estimate | None


@dataclass(frozen=True, kw_only=True)
class Review:
    """A sizing with everything that its report shows.

    Parameters
    ----------
    sizing
        The sizing under review.
    environment, mount
        The excitation of the mount, and the mount itself.
    linear
        Numbers of linear theory for the mission.
    closure
        Impact rates by the moment closure, as `predicted_rates`; None unless both stops are rigid.
    chances
        Probability of any impact, and of none, in the mission at each of `PLACES`.
    hits
        Impacts at each of `PLACES`; None where they were not simulated.
    comparisons
        Quantities with and without stops.
    motion
        A long path between stops at 3 sigma; None for a scene without stops.
    recommended, worst
        The clearance as stated, and the largest within the tolerances, rounded up; the latter is
        None where none were asked for, or it was not found.
    tolerances, worst_case
        The tolerances that were asked for, and the table of `worst_case`; None without.
    exceedances
        The table of `exceedances`; None where it does not apply.
    exceeding
        Probability of exceeding the limit of the target at each of `PLACES`; empty where it has
        none.
    balances
        Balances of the simulations, judged.
    peaks
        The table of `clatter`, at 3 sigma and as recommended, then for other stiffnesses; None
        where the stops have no stiffness. `peak_window` is its window, s.
    sensitivity
        The table of `sensitivity`; None unless it was asked for.
    warnings, assumptions
        In words: warnings to read before any number is believed, and assumptions.
    """

    sizing: Sizing
    environment: Environment
    mount: Mount
    linear: LinearMotion
    closure: DataFrame | None
    chances: Mapping[str, Chance]
    hits: Mapping[str, HitsAt | None]
    comparisons: tuple[Comparison, ...]
    motion: MotionBetweenStops | None
    recommended: RoundedClearance | None
    worst: RoundedClearance | None
    tolerances: Tolerances
    worst_case: DataFrame | None
    exceedances: DataFrame | None
    exceeding: Mapping[str, Exceeding]
    balances: tuple[Balance, ...]
    peaks: DataFrame | None
    peak_window: float
    sensitivity: DataFrame | None
    warnings: tuple[str, ...]
    assumptions: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """The JSON document of the sizing, and under "review" what the review adds to it."""
        added = {each.name: plain(getattr(self, each.name)) for each in fields(self)}
        return {**added.pop("sizing"), "review": added}


def review(
    sizing: Sizing,
    sensitivity: DataFrame | None = None,
    settings: ReviewSettings | None = None,
    *,
    threads: int | None = None,
) -> Review:
    """Calculate and simulate everything that the report of a sizing shows.

    Parameters
    ----------
    sizing
        The answer of `size`.
    sensitivity
        The answer of `sensitivity`, if that was asked for.
    settings
        Lengths of simulations, and their budget.
    """
    settings = settings or ReviewSettings()
    deadline = Deadline.after(settings.budget)
    stopped = bool(sizing.scene.impact_pairs)
    between = 0 if deadline.passed() else settings.clearances
    hard = _exceedances(sizing, between, threads, deadline.part(settings.exceedance_share))
    sizing = _with_limits(sizing, hard)
    path = settings.path
    if deadline.passed():
        path = replace(path, periods=min(path.periods, settings.periods_when_late))
    closure = _closure(sizing, settings.closure_points, deadline)
    left_out = closure is not None and deadline.passed() and closure["closure"].isna().any()
    motion = motion_between_stops(sizing, path) if stopped else None
    peaks = peak_accelerations(sizing, settings.peaks, deadline, threads)
    no_peaks = peaks is not None and not peaks["windows"].any()
    return Review(
        sizing=sizing,
        environment=environment(sizing.scene),
        mount=_mount(sizing),
        linear=_linear(sizing),
        closure=closure,
        chances=_chances(sizing),
        hits=_hits(sizing),
        comparisons=_comparisons(sizing),
        motion=motion,
        recommended=None if sizing.doubtful else RoundedClearance.of(sizing.clearance.value),
        worst=None if sizing.allowed == Tolerances() else sizing.made,
        tolerances=sizing.allowed,
        worst_case=sizing.worst_case,
        exceedances=hard,
        exceeding=_exceeding(sizing, hard),
        balances=tuple(
            Balance.of(name, place, residual)
            for place, answer in sizing.evidence.items()
            for name, residual in answer.identities.items()
        ),
        peaks=None if no_peaks else peaks,
        peak_window=settings.peaks.window,
        sensitivity=sensitivity,
        warnings=(
            *_warnings(sizing),
            *([NO_CLOSURE] if left_out else []),
            *([NO_PEAKS] if no_peaks else []),
        ),
        assumptions=_assumptions(sizing),
    )


MORE = 1.15
"""Ratio of the largest clearance at which probabilities of hard impacts are found to the
recommended one."""

MARK_RATIOS = (1.0, 0.5, 2.0)
"""Limits whose probabilities are drawn against clearance, as multiples of the limit of the
target."""


def _exceedances(
    sizing: Sizing, number: int, threads: int | None, budget: float | None
) -> DataFrame | None:
    """Probabilities of hard impacts from 3 sigma on; None where they do not apply."""
    target, nominal = sizing.target, sizing.clearance.value
    if not sizing.scene.impact_pairs:
        return None
    fixed = sorted({sizing.three_sigma.clearance, nominal, MORE * nominal})
    more = np.linspace(fixed[0], fixed[-1], max(number - len(fixed), 0) + 2)[1:-1]
    limited = target.exceedance is not None
    try:
        return exceedances(
            sizing.scene,
            sorted({*fixed, *map(float, more)}),
            sizing.mission,
            event=target.name if limited else None,
            marks=[ratio * target.value for ratio in MARK_RATIOS] if limited else (),
            seed=sizing.seed,
            threads=threads,
            budget=budget,
        )
    except NotApplicable:
        return None


def _with_limits(sizing: Sizing, hard: DataFrame | None) -> Sizing:
    """The sizing with the probabilities of its limit at the clearances of `exceedances`, too."""
    table = sizing.exceeding
    if hard is None or table is None:
        return sizing
    more = hard[np.isclose(hard["limit"], sizing.target.value)][list(table.columns)]
    known = stacked([table, more]).drop_duplicates("clearance").sort_values("clearance")
    return replace(sizing, exceeding=known.reset_index(drop=True))


def _exceeding(sizing: Sizing, hard: DataFrame | None) -> dict[str, Exceeding]:
    """Probability of exceeding the limit of the target at 3 sigma and as recommended, by one
    method."""
    if sizing.target.exceedance is None or hard is None:
        return {}
    places = (sizing.three_sigma.clearance, sizing.clearance.value)
    return {
        name: _exceeding_at(hard, place, sizing.target.value)
        for name, place in zip(PLACES, places, strict=True)
    }


def _exceeding_at(hard: DataFrame, clearance: float, limit: float) -> Exceeding:
    row = hard[np.isclose(hard["clearance"], clearance) & np.isclose(hard["limit"], limit)]
    if not len(row):
        return Exceeding(clearance=clearance, probability=None)
    (found,) = row.to_dict("records")
    return Exceeding(
        clearance=clearance,
        probability=found["probability"],
        low=found["probability_low"],
        high=found["probability_high"],
    )


def peak_accelerations(
    sizing: Sizing,
    settings: PeakSettings,
    deadline: Deadline = NEVER,
    threads: int | None = None,
) -> DataFrame | None:
    """`clatter` at 3 sigma and as recommended, then for other stiffnesses where that means
    something; None where it does not apply, as for stops with a restitution alone. A row for which
    no time is left has no windows, and no numbers (NaN) either."""
    common: dict[str, Any] = {
        "window": settings.window,
        "rel_error": settings.rel_error,
        "seed": sizing.seed,
        "threads": threads,
    }
    own = [(place, None) for place in (sizing.three_sigma.clearance, sizing.clearance.value)]
    others = [
        (multiple * sizing.sigma, (ratio,))
        for ratio in settings.stiffness_ratios
        for multiple in settings.multiples
    ]
    rows: list[DataFrame] = []
    asked = [*own, *others]
    for number, (clearance, ratios) in enumerate(asked):
        if ratios is not None and deadline.passed():
            rows.append(_not_simulated(clearance, clearance / sizing.sigma, *ratios))
            continue
        share = deadline.part(1.0 / (len(asked) - number)) or math.inf
        try:
            found = clatter(
                sizing.scene, [clearance], stiffness_ratios=ratios,
                budget=min(settings.seconds, share), **common,
            )  # fmt: skip
        except NotApplicable:
            break
        except NotConverged:
            # a window may take longer than all the time that is left
            found = _not_simulated(clearance, clearance / sizing.sigma, *(ratios or (math.nan,)))
        rows.append(found)
    return stacked(rows) if rows else None


def _not_simulated(clearance: float, in_sigma: float, ratio: float) -> DataFrame:
    """A row of `clatter` for which no time was left."""
    row = {"clearance": clearance, "clearance_in_sigma": in_sigma, "stiffness_ratio": ratio}
    return frame_of([row | {"windows": 0.0}])


def _mount(sizing: Sizing) -> Mount:
    structure = sizing.scene.structure
    assert isinstance(structure, Oscillator)
    ratio = structure.damping_rate / (2.0 * structure.omega)
    return Mount(
        natural_frequency_hz=structure.omega / (2.0 * math.pi),
        damping_ratio=ratio,
        quality_factor=0.5 / ratio if ratio else None,
        static_sag=getattr(structure, "sag", None),
    )


def _linear(sizing: Sizing) -> LinearMotion:
    screening = sizing.screening
    largest = largest_peak(2.0 * (screening.zero_crossing_rate or 0.0) * sizing.mission)
    return LinearMotion(
        miles_error=_miles_error(screening),
        rice_rate_at_three_sigma=sizing.three_sigma.rice_hits / sizing.mission,
        largest_displacement=largest * sizing.sigma,
        largest_in_sigma=largest,
    )


def _miles_error(screening: Screening) -> float | None:
    miles, integral = screening.miles, screening.acceleration_std
    return None if miles is None or integral is None else miles / integral - 1.0


def largest_peak(count: float) -> float:
    """Mean of the largest of `count` peaks in standard deviations (Davenport 1964).

    >>> round(largest_peak(600.0), 6)
    3.738226
    """
    root = math.sqrt(2.0 * math.log(max(count, math.e)))
    return root + float(np.euler_gamma) / root


NO_PEAKS = "peak accelerations were not simulated: no time was left; raise the budget"
"""Warning where the deadline passed before the first window."""

NO_CLOSURE = (
    "the moment closure was not solved at every clearance of the curve of impact rates: no time "
    "was left; raise the budget"
)
"""Warning where the deadline passed before the curve of the closure was solved."""


def _closure(sizing: Sizing, points: int, deadline: Deadline) -> DataFrame | None:
    """Impact rates by the moment closure, where both stops are rigid and it applies."""
    scene, clearances = sizing.scene, sizing.curve["clearance"]
    pairs = scene.impact_pairs
    if not pairs or not two_sided(scene):
        return None
    if not all(law.rigid for _, law in pairs[0].stops()):
        return None
    try:
        places = np.linspace(clearances.min(), clearances.max(), points)
        return predicted_rates(scene, places.tolist(), deadline)
    except NotApplicable:
        return None


def _chances(sizing: Sizing) -> dict[str, Chance]:
    return {
        "three_sigma": Chance.of(sizing.three_sigma.probability.value),
        "recommended": Chance.of(probability_at(sizing, sizing.clearance.value)),
    }


def _hits(sizing: Sizing) -> dict[str, HitsAt | None]:
    places = (sizing.three_sigma.clearance, sizing.clearance.value)
    return {name: _hits_at(sizing, place) for name, place in zip(PLACES, places, strict=True)}


def _hits_at(sizing: Sizing, clearance: float) -> HitsAt | None:
    table = sizing.simulated
    near = table[np.isclose(table["clearance"], clearance)] if len(table) else table
    if not len(near):
        return None
    (row, *_) = plain(near)
    rate, mission = row["hit_rate"], sizing.mission
    return HitsAt(
        rate=rate,
        rate_low=row["hit_rate_low"],
        rate_high=row["hit_rate_high"],
        expected=None if rate is None else mission * rate,
        expected_low=mission * row["hit_rate_low"],
        expected_high=mission * row["hit_rate_high"],
        hits_per_first_hit=row["hits_per_first_hit"],
        impact_speed_mean=row["impact_speed_mean"],
        by=row["by"],
    )


def _comparisons(sizing: Sizing) -> tuple[Comparison, ...]:
    """The quantities that at least one simulation has found, each with its values."""
    scene = sizing.scene
    wanted = [
        ("displacement_std", "displacement_std", 1.0),
        ("velocity_std", "velocity_std", 1.0),
        ("acceleration_std", "acceleration_std", 1.0),
        ("peak_force", "peak_force", 1.0),
        ("stop_acceleration", "peak_force", 1.0 / model_of(scene).unit_mass),
        ("contact_probability", "contact_probability", 1.0),
    ]
    kept = {law.restitution_mean_square for pair in scene.impact_pairs for _, law in pair.stops()}
    if len(kept) == 1:  # F2 is that of both sides together
        lost = (1.0 - kept.pop()) / 2.0
        wanted.append(("lost_power", "impact_speed_square_rate", lost))
    rows = []
    for quantity, source, factor in wanted:
        found = [
            _estimate(sizing.evidence[place], source, factor) if place in sizing.evidence else None
            for place in PLACES
        ]
        if any(estimate is not None for estimate in found):
            rows.append(
                Comparison(
                    quantity=quantity,
                    without_stops=getattr(sizing.screening, quantity, None),
                    three_sigma=found[0],
                    recommended=found[1],
                )
            )
    return tuple(rows)


def _estimate(answer: Response, quantity: str, factor: float) -> Estimate | None:
    """An estimate of the mass, or of its one impact pair, times a factor."""
    for (_, name), estimate in answer.estimates().items():
        if name == quantity:
            return estimate * factor
    return None


def _warnings(sizing: Sizing) -> tuple[str, ...]:
    """Warnings of the sizing and of the screening, each once."""
    return tuple(dict.fromkeys([*sizing.warnings, *sizing.screening.notes]))


def _assumptions(sizing: Sizing) -> tuple[str, ...]:
    """Assumptions of the scene, then assumptions and warnings of the simulations, without those
    that are warnings of the review already."""
    above = (*_warnings(sizing), UNLOADED)  # the report measures from the position of rest
    texts = list(sizing.scene.assumptions())
    for answer in sizing.evidence.values():
        texts += [*answer.assumptions, *answer.warnings]
    return tuple(dict.fromkeys(text for text in texts if text not in above))
