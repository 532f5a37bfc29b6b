"""The review of a sizing: every number that a design review needs besides the clearance."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from stochvi.isolators.clearance import predicted_rates
from stochvi.isolators.environment import Environment, environment
from stochvi.isolators.screening import Screening
from stochvi.isolators.sizing.answer import RoundedClearance, Sizing
from stochvi.isolators.sizing.chance_at_stops import probability_at, two_sided
from stochvi.isolators.sizing.changes import Tolerances
from stochvi.isolators.sizing.clatter import clatter
from stochvi.isolators.sizing.exceedances import exceedances
from stochvi.isolators.sizing.motion import MotionBetweenStops, PathSettings, motion_between_stops
from stochvi.model.model import model_of
from stochvi.results.base import plain
from stochvi.results.deadline import NEVER, Deadline
from stochvi.results.errors import NotApplicable, NotConverged
from stochvi.results.estimates import Estimate
from stochvi.results.response import Response
from stochvi.scenes.scene import UNLOADED
from stochvi.scenes.structures import Oscillator

if TYPE_CHECKING:
    import pandas as pd

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
    closure: pd.DataFrame | None
    chances: Mapping[str, Chance]
    hits: Mapping[str, HitsAt | None]
    comparisons: tuple[Comparison, ...]
    motion: MotionBetweenStops | None
    recommended: RoundedClearance | None
    worst: RoundedClearance | None
    tolerances: Tolerances
    worst_case: pd.DataFrame | None
    exceedances: pd.DataFrame | None
    exceeding: Mapping[str, Exceeding]
    balances: tuple[Balance, ...]
    peaks: pd.DataFrame | None
    peak_window: float
    sensitivity: pd.DataFrame | None
    warnings: tuple[str, ...]
    assumptions: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """The JSON document of the sizing, and under "review" what the review adds to it."""
        added = {each.name: plain(getattr(self, each.name)) for each in fields(self)}
        return {**added.pop("sizing"), "review": added}


def review(
    sizing: Sizing,
    sensitivity: pd.DataFrame | None = None,
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
) -> pd.DataFrame | None:
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


def _with_limits(sizing: Sizing, hard: pd.DataFrame | None) -> Sizing:
    """The sizing with the probabilities of its limit at the clearances of `exceedances`, too."""
    import pandas as pd

    table = sizing.exceeding
    if hard is None or table is None:
        return sizing
    more = hard[np.isclose(hard["limit"], sizing.target.value)][list(table.columns)]
    known = pd.concat([table, more]).drop_duplicates("clearance").sort_values("clearance")
    return replace(sizing, exceeding=known.reset_index(drop=True))


def _exceeding(sizing: Sizing, hard: pd.DataFrame | None) -> dict[str, Exceeding]:
    """Probability of exceeding the limit of the target at 3 sigma and as recommended, by one
    method."""
    if sizing.target.exceedance is None or hard is None:
        return {}
    places = (sizing.three_sigma.clearance, sizing.clearance.value)
    return {
        name: _exceeding_at(hard, place, sizing.target.value)
        for name, place in zip(PLACES, places, strict=True)
    }


def _exceeding_at(hard: pd.DataFrame, clearance: float, limit: float) -> Exceeding:
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
) -> pd.DataFrame | None:
    """`clatter` at 3 sigma and as recommended, then for other stiffnesses where that means
    something; None where it does not apply, as for stops with a restitution alone. A row for which
    no time is left has no windows, and no numbers (NaN) either."""
    import pandas as pd

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
    rows: list[pd.DataFrame] = []
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
    return pd.concat(rows, ignore_index=True) if rows else None


def _not_simulated(clearance: float, in_sigma: float, ratio: float) -> pd.DataFrame:
    """A row of `clatter` for which no time was left."""
    import pandas as pd

    row = {"clearance": clearance, "clearance_in_sigma": in_sigma, "stiffness_ratio": ratio}
    return pd.DataFrame([row | {"windows": 0.0}])


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


def _closure(sizing: Sizing, points: int, deadline: Deadline) -> pd.DataFrame | None:
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
    """Warnings of the sizing, of the screening and of measured records, each once."""
    record = sizing.record
    found = [record.sentence()] if record is not None and not record.agrees else []
    found += sizing.warnings
    found += sizing.screening.notes
    return tuple(dict.fromkeys(found))


def _assumptions(sizing: Sizing) -> tuple[str, ...]:
    """Assumptions of the scene, then assumptions and warnings of the simulations, without those
    that are warnings of the review already."""
    above = (*_warnings(sizing), UNLOADED)  # the report measures from the position of rest
    texts = list(sizing.scene.assumptions())
    for answer in sizing.evidence.values():
        texts += [*answer.assumptions, *answer.warnings]
    return tuple(dict.fromkeys(text for text in texts if text not in above))
