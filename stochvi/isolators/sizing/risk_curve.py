"""Risk against clearance. Chapters: probability of any impact, from one run of first crossings;
targets of a sizing, and the laws that they need; probabilities that the hardest impact exceeds a
limit."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import ClassVar, Unpack

import numpy as np

from stochvi.isolators.screening import at_clearances
from stochvi.isolators.sizing.answer import Clearance, Target
from stochvi.mathematics.numerics import Matrix, Vector
from stochvi.mathematics.units import outside_of_share
from stochvi.mathematics.unsteady_noise import MovingMean
from stochvi.model.model import model_of
from stochvi.motion.choose_plan import shaken_by_tables
from stochvi.motion.modal_tables import plan_modal_tables
from stochvi.results.base import DataFrame, frame_of
from stochvi.results.deadline import partial_result
from stochvi.results.errors import NotApplicable
from stochvi.results.estimates import GAUSSIAN_95, Estimate, binomial_interval
from stochvi.sampling.calculations import RunOptions
from stochvi.sampling.run import Run, sampled
from stochvi.scenes.scene import LARGEST_NUMBER, Scene
from stochvi.statistics.clusters import Bursts, bursts
from stochvi.statistics.crossings import (
    CrossingAges,
    FirstCrossings,
    PairMotion,
    one_gap,
)
from stochvi.statistics.hardness import HARDNESS, ImpactSpeed, Limit, PeakAcceleration, hardness_of
from stochvi.statistics.hazards import (
    HazardCurve,
    OutOfReach,
    falling_chances,
    half_widths,
    place_of,
)
from stochvi.statistics.rare_hits import WindowSampler

CERTAIN = 0.999
"""Largest probability of an impact that a target may have."""

RARE_ENOUGH = 10.0
"""Number of first impacts in a mission up to which a clearance is read from the curve of
probabilities; for more, it is read from the rate of first impacts."""

SIGMA_STEP, MOST_LEVELS = 0.25, 64
"""Distance from one clearance of a curve to the next, in standard deviations of the noise, and the
largest number of clearances; the distance grows where sines are much larger than the noise."""


def clearances_of_curve(motion: MovingMean, lowest: float, highest: float) -> Vector:
    """The clearances of a curve of risk, m, from the lowest one to beyond the highest one."""
    step = max(SIGMA_STEP * motion.place, (highest - lowest) / MOST_LEVELS)
    return np.arange(lowest / step, highest / step + 2.0) * step


def chance_of_stops(scene: Scene, stops: Matrix, mission: float, run: Run) -> Estimate:
    """Probability of any impact with stops at distances (2, pairs) from the mean gaps, m, infinite
    for none; 1 where one of them presses. A mass without a pair has one gap."""
    if stops.min() <= 0.0:
        return Estimate(value=1.0, how="a stop presses on the mass")
    model = model_of(scene)
    motion = PairMotion.under_shocks(model if model.pairs else one_gap(model))
    found: FirstCrossings = partial_result(motion.crossings, *stops, mission, run)
    return found.probability(mission)[0]


@dataclass(frozen=True, kw_only=True)
class RiskCurve:
    """Probability of any impact of one gap in a mission against clearance, m per side, between the
    levels of one run: see `HazardCurve`."""

    crossings: CrossingAges
    motion: MovingMean
    mission: float
    clearances: Vector
    probabilities: Sequence[Estimate]
    first_rates: Sequence[Estimate]

    @classmethod
    def of_gap(
        cls, together: PairMotion, number: int, stops: Mapping[float, Vector], mission: float,
        run: Run,
    ) -> RiskCurve:  # fmt: skip
        """The curve of one of some gaps that alone has stops, at distances by their sides."""
        rows = np.full((2, len(next(iter(stops.values()))), len(together.motions)), math.inf)
        for side, distances in stops.items():
            rows[int(side > 0.0), :, number] = distances
        found: FirstCrossings = partial_result(together.crossings, *rows, mission, run)
        return cls(
            crossings=found, motion=together.motions[number], mission=mission,
            clearances=rows[:, :, number].min(axis=0),
            probabilities=falling_chances(found.probability(mission)),
            first_rates=falling_chances(found.first_rate()),
        )  # fmt: skip

    @cached_property
    def hazards(self) -> HazardCurve:
        """-ln(1 - P) against the clearance."""
        return HazardCurve.of(
            self.clearances, self.probabilities, self.mission, first_rates=self.first_rates,
            expected=lambda clearance: self.rice_rate(clearance) * self.mission,
        )  # fmt: skip

    @property
    def sigma(self) -> float:
        """Standard deviation of the gap, m."""
        return self.motion.deviations[0]

    @property
    def largest_hazard(self) -> float:
        """-ln(1 - P) at the smallest clearance whose probability of an impact is below 1."""
        return math.exp(self.hazards.log(self.hazards.ends[0]))

    @property
    def most_first_hits(self) -> float:
        """First impacts of a mission at the smallest clearance, by their limiting rate."""
        return 0.99 * self.first_rate(float(self.clearances[0])) * self.mission

    def clearance(self, probability: float) -> Clearance:
        """The clearance at which the probability of any impact is `probability`, with its 95 %
        interval."""
        wanted, (low, high) = -math.log1p(-probability), self.hazards.ends
        if math.log(wanted) > self.hazards.log(low):
            raise OutOfReach(
                f"probability must be at most {self.probability(low):.3g} for a mission of "
                f"{self.mission:g} s, as at {1e3 * low:.4g} mm, the smallest clearance that is "
                f"tried ({low / self.sigma:.3g} sigma), got {probability:g}; "
                "ask for a smaller probability or a longer mission"
            )
        if math.log(wanted) < self.hazards.log(high):
            raise OutOfReach(
                f"probability must be at least {self.probability(high):.3g} for a mission of "
                f"{self.mission:g} s, as at {1e3 * high:.4g} mm, the largest clearance that is "
                f"tried, got {probability:g}; ask for a larger probability"
            )
        value, half = self.hazards.place(wanted, 1e-3 * self.sigma)
        return Clearance(value=value, lower=value - half, upper=value + half)

    def place(self, hazard: float) -> float:
        """The clearance (m) at which -ln(1 - P) is `hazard`, however close to 1 the probability P
        is."""
        if hazard <= RARE_ENOUGH:
            return self.clearance(-math.expm1(-hazard)).value
        # in a mission with many first impacts the probability of none follows from their limiting
        # rate alone
        wanted = hazard / self.mission
        low, high = self.clearances[[0, -1]]
        if wanted > self.first_rate(low):
            raise OutOfReach(
                f"first impacts {wanted:.3g} times a second belong to a clearance below "
                f"{1e3 * low:.4g} mm, the smallest that is tried"
            )
        return place_of(self.first_rate, wanted, low, high)

    def probability(self, clearance: float) -> float:
        """Probability of any impact at a clearance; beyond the levels, the ratio to Rice's rate is
        held constant."""
        if clearance < self.hazards.ends[0]:
            return 1.0
        return -math.expm1(-math.exp(self.hazards.log(clearance)))

    def first_rate(self, clearance: float) -> float:
        """Limiting rate of first impacts, 1/s."""
        rates = np.array([rate.value for rate in self.first_rates])
        share = np.log(np.maximum(rates, 1e-300) / self.crossings.rice_rate)
        return float(
            np.exp(np.interp(clearance, self.clearances, share)) * self.rice_rate(clearance)
        )

    def rice_rate(self, clearance: float) -> float:
        """Rice's rate of crossings of all stops, 1/s."""
        first = self.motion.rate(float(self.clearances[0]))
        ratio = self.motion.rate(clearance) / first
        return float(self.crossings.rice_rate[0]) * ratio

    def place_of_rice(self, rate: float) -> float:
        """The clearance at which Rice's rate of all stops is so many times a second."""
        first = self.motion.rate(float(self.clearances[0]))
        return self.motion.distance_of(rate * first / float(self.crossings.rice_rate[0]))

    def slope(self, clearance: float) -> float:
        """Slope of the logarithm of Rice's rate over the square of the clearance, 1/m^2; it is the
        same at all clearances where there is noise alone."""
        near, far = clearance, clearance * (1.0 + 1e-3)
        change = math.log(self.motion.rate(far) / self.motion.rate(near))
        return change / (far**2 - near**2)

    def columns(self) -> dict[str, Sequence[float] | Vector]:
        """The table that `Sizing.curve` describes."""
        limits = {"first_hit_rate": self.first_rates, "probability": self.probabilities}
        columns: dict[str, Sequence[float] | Vector] = {
            "clearance": self.clearances,
            "clearance_in_sigma": self.clearances / self.sigma,
            "rice_rate": self.crossings.rice_rate,
        }
        for name, estimates in limits.items():
            most = 1.0 if name == "probability" else math.inf
            values, half = np.array(estimates, dtype=float), half_widths(estimates)
            columns[name] = values
            columns[f"{name}_low"] = np.maximum(values - half, 0.0)
            columns[f"{name}_high"] = np.minimum(values + half, most)
        return columns


# ------------------------------------------------------------------------------
# Targets of a sizing, and the impact laws that they need.
# ------------------------------------------------------------------------------


ACCEPTED = 0.01
"""Default probability that a limit of the hardest impact is exceeded in the mission."""


def target_of(
    probability: float | None, rate: float | None, limits: Mapping[str, float], exceedance: float
) -> Target:
    """The target of a sizing; `ValueError` unless exactly one is given, in its range."""
    known = {"probability": (probability, "1"), "rate": (rate, "1/s")}
    known |= {name: (limits.get(name), kind.unit) for name, kind in HARDNESS.items()}
    given = [name for name, (value, _) in known.items() if value is not None]
    if len(given) != 1:
        raise ValueError(
            f"give exactly one of {', '.join(known)}, got {' and '.join(given) or 'none'}"
        )
    name = given[0]
    value, unit = known[name]
    assert value is not None
    if not 0.0 < value <= (CERTAIN if name == "probability" else LARGEST_NUMBER):
        if name == "probability":
            raise outside_of_share(name, f"in (0, {CERTAIN:g}]", value)
        raise ValueError(f"{name} must be positive, got {value:g}")
    if not 0.0 < exceedance < 1.0:
        raise outside_of_share("exceedance", "in (0, 1)", exceedance)
    limited = name in HARDNESS
    if not limited and exceedance != ACCEPTED:
        raise ValueError(f"exceedance belongs to a limit of the hardest impact, not to a {name}")
    return Target(name=name, value=value, unit=unit, exceedance=exceedance if limited else None)


def limit_of_target(scene: Scene, target: Target, at: str | None) -> Limit | None:
    """The limit that impacts of the target must not exceed; None for a target that has none.

    Raises `NotApplicable` where the scene has no pairs, or their laws do not determine the target.
    """
    if not scene.impact_pairs:
        raise NotApplicable("size", "the scene needs an impact_pair, with its law, for every gap")
    if target.exceedance is None:
        return None
    return hardness_of(target.name).limit(scene, target.value, at)


# ------------------------------------------------------------------------------
# Probabilities that the hardest impact of a mission exceeds a limit, over limits and clearances.
#
# Where first impacts are rare, clusters are simulated from first impacts on, and fast first impacts
# are drawn more often and weighted. Where clusters follow without a pause, windows of the whole
# motion are simulated.
# ------------------------------------------------------------------------------


LIMITS = 16
"""Number of limits on a curve of probabilities; each is the same multiple of the one before."""

WIDENING = 2.5
"""Factor on the speeds of every second first impact, so that rare hard impacts are seen as well."""

MARKS = 3
"""Number of limits that are followed over all clearances where the caller gives none."""

FEWEST = 5
"""Smallest number of clusters, or windows, with an impact as hard as a limit for which its
probability is given."""

REL_ERROR = 0.1
"""Relative standard error to which the rate of impacts, or of impacts beyond the first mark, is
simulated."""

MOST_ERROR = 0.5
"""Relative standard error above which a probability is left out."""

WINDOW, MOST_WINDOWS = 18.0, 4096
"""Length (s) and largest number of the windows of the whole motion that are simulated where impacts
come without a pause."""


def event_of(scene: Scene) -> str:
    """The quantity by which the hardest impact is judged: its peak acceleration or, where a stop is
    rigid and has no stiffness, its speed."""
    rigid = any(stop.rigid for stop in model_of(scene).stops)
    return (ImpactSpeed if rigid else PeakAcceleration).name


@sampled
def exceedances(
    scene: Scene,
    clearances: Sequence[float],
    mission: float,
    *,
    event: str | None = None,
    marks: Sequence[float] = (),
    **options: Unpack[RunOptions],
) -> DataFrame:
    """Probability that any impact of a mission exceeds a limit: over limits, at each clearance.

    Parameters
    ----------
    scene
        One oscillator under Gaussian noise between stops, whose laws are kept.
    clearances
        Metres per side from the static equilibrium.
    event
        "peak_acceleration" (absolute, m/s^2, while a stop is touched) or "impact_speed" (m/s); by
        default `event_of`.
    marks
        Limits for which every clearance has a row where their probability is known; that of the
        first one is found to `REL_ERROR` if the budget allows it. By default, and where no
        clearance exceeds any of them often enough, limits that most clearances have in common.
    **options
        `RunOptions`: `budget` is that of all clearances together.

    Returns
    -------
    pandas.DataFrame
        `clearance` (m), `event`, `limit` (SI), `mark` (whether the limit is one of the
        marks), `probability` with its 95 % limits
        `probability_low`, `probability_high`, and `by`, "bursts" or "windows". Limits that are
        exceeded too seldom for a standard error are left out; so is a clearance at which no limit
        is left.
    """
    event, run = event or event_of(scene), Run.of(options)
    hardness_of(event).check(model_of(scene))  # before any work
    seen: list[TrialExtremes] = []
    for number, clearance in enumerate(clearances):
        stopped = at_clearances(scene, clearance)
        one = replace(run, deadline=run.deadline.share(1.0 / (len(clearances) - number)))
        seen.append(
            _by_bursts(stopped, event, mission, marks, one)
            or _by_windows(stopped, event, mission, one)
        )
    marks = [mark for mark in marks if any(each.chance(mark) for each in seen)] or _common(seen)
    rows = [
        {"clearance": clearance, "event": event, "limit": limit, "mark": limit in marks,
         "probability": value, "probability_low": low, "probability_high": high, "by": each.by}
        for clearance, each in zip(clearances, seen, strict=True)
        for limit in sorted({*each.limits(), *marks})
        if (found := each.chance(limit)) is not None
        for value, low, high in (found,)
    ]  # fmt: skip
    names = ["clearance", "event", "limit", "mark"]
    more = ["probability", "probability_low", "probability_high", "by"]
    return frame_of(rows, columns=[*names, *more])


Chance = tuple[float, float, float]
"""A probability and its 95 % limits."""


@dataclass(frozen=True, eq=False)
class TrialExtremes(ABC):
    """Largest speeds, or accelerations, of trials at one clearance."""

    largest: Vector
    mission: float

    by: ClassVar[str]

    @abstractmethod
    def chance(self, limit: float) -> Chance | None:
        """Probability that the limit is exceeded in the mission; None where that is not known."""

    def ends(self) -> tuple[float, float] | None:
        """A limit that nearly every trial exceeds, and one that few do."""
        ordered = np.sort(self.largest[self.largest > 0.0])
        if len(ordered) <= FEWEST:
            return None
        return float(ordered[len(ordered) // 50]), float(ordered[-FEWEST])

    def limits(self) -> list[float]:
        """Limits of a curve."""
        ends = self.ends()
        return [] if ends is None else [float(f"{x:.4g}") for x in np.geomspace(*ends, LIMITS)]


@dataclass(frozen=True, eq=False)
class _Bursts(TrialExtremes):
    """Clusters from first impacts on, each with a weight."""

    event: str
    bursts: Bursts

    by = "bursts"

    def chance(self, limit: float) -> Chance | None:
        rate = self.bursts.exceedance_rate(self.event, limit)
        if not rate.value or rate.standard_error > MOST_ERROR * rate.value:
            return None
        half = rate.half_width_95()
        rates = (rate.value, max(rate.value - half, 0.0), rate.value + half)
        value, low, high = (-math.expm1(-each * self.mission) for each in rates)
        return value, low, high


@dataclass(frozen=True, eq=False)
class _TrialWindows(TrialExtremes):
    """Windows of the whole motion, of this length in s, taken for independent."""

    window: float

    by = "windows"

    def chance(self, limit: float) -> Chance | None:
        return None if self.exceeding(limit) < FEWEST else self.interval(limit)

    def exceeding(self, limit: float) -> int:
        """Number of windows in which the limit is exceeded."""
        return int((self.largest > limit).sum())

    def estimate(self, limit: float) -> Estimate:
        """The probability in the mission, or its upper limit where few windows exceed the limit."""
        value, low, high = self.interval(limit)
        how = f"{self.exceeding(limit)} of {len(self.largest)} windows"
        if self.exceeding(limit) < FEWEST:
            return Estimate(value=0.0, upper_95=high, how=how)
        return Estimate(value=value, standard_error=(high - low) / (2.0 * GAUSSIAN_95), how=how)

    def interval(self, limit: float) -> Chance:
        """The probability in the mission and its 95 % limits, however few windows exceed the
        limit."""
        count, trials = self.exceeding(limit), len(self.largest)
        windows = self.mission / self.window
        value, low, high = (
            1.0 if chance >= 1.0 else -math.expm1(windows * math.log1p(-chance))
            for chance in (count / trials, *binomial_interval(count, trials))
        )
        return value, low, high


def _common(seen: Sequence[TrialExtremes]) -> tuple[float, ...]:
    """Limits of two digits whose probability is known at as many clearances as possible."""
    ends = [each for each in (one.ends() for one in seen) if each is not None]
    if not ends:
        return ()
    low = max(each[0] for each in ends)
    high = min(each[1] for each in ends)
    if not high > low:
        low, high = min(each[0] for each in ends), max(each[1] for each in ends)
    spaced = np.geomspace(low, high, MARKS + 2)[1:-1]
    return tuple(dict.fromkeys(float(f"{limit:.2g}") for limit in spaced))


def _by_bursts(
    scene: Scene, event: str, mission: float, marks: Sequence[float], run: Run
) -> _Bursts | None:
    """Trials by clusters; None where clusters do not end, or overlap."""
    wanted: Callable[[Bursts], Estimate] = Bursts.hit_rate
    if marks:
        wanted = partial(Bursts.exceedance_rate, name=event, limit=marks[0])
    try:
        found: Bursts = partial_result(
            bursts, scene, wanted=wanted, widening=WIDENING, **run.options(rel_error=REL_ERROR)
        )
    except NotApplicable:
        return None
    return _Bursts(found.largest(event), mission, event, found) if found.apart else None


def _by_windows(scene: Scene, event: str, mission: float, run: Run) -> _TrialWindows:
    """Trials by windows of the whole motion, as many as the time allows."""
    window = min(WINDOW, mission)
    parts = run.until(window_sampler(scene, event, window, run.seed), MOST_WINDOWS).sample
    return _TrialWindows(_largest(parts), mission, window)


def window_sampler(scene: Scene, event: str, window: float, seed: int) -> WindowSampler:
    """Windows of one oscillator, s, in which every contact counts, however slow."""
    model = shaken_by_tables(model_of(scene))
    return WindowSampler(plan_modal_tables(model, 0.0, window), event, model.outputs, seed)


def _largest(sample: list[Vector]) -> Vector:
    """(windows,): how hard the hardest impact of each window is."""
    return np.concatenate([part[0].max(axis=0) for part in sample])


@sampled
def chance_in_windows(
    scene: Scene, event: str, limit: float, mission: float, *, accepted: float,
    **options: Unpack[RunOptions],
) -> Estimate | None:  # fmt: skip
    """Probability that any impact of a mission exceeds a limit, by windows of the whole motion,
    however closely impacts follow each other: sampled until its interval lies on one side of an
    `accepted` probability, or the budget ends. None where windows are not simulated.
    """
    window, run = min(WINDOW, mission), Run.of(options)
    try:
        sampler = window_sampler(scene, event, window, run.seed)
    except NotApplicable:
        return None

    def more(parts: list[Vector]) -> int:
        seen = _TrialWindows(_largest(parts), mission, window)
        _, low, high = seen.interval(limit)
        known = high <= accepted or low > accepted
        return 0 if known else len(seen.largest)  # few looks: each may err once in 40

    parts = run.until(sampler, LEAST_WINDOWS, more).sample
    return _TrialWindows(_largest(parts), mission, window).estimate(limit)


LEAST_WINDOWS = 1024
"""Number of windows at the first look at a probability."""
