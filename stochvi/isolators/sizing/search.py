"""The search of a sizing. Chapters: impacts with the stops at a place; the search by impacts, and
the answer."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from stochvi.isolators.screening import at_clearances, screened
from stochvi.isolators.sizing.answer import SIDES, Question, Sizing
from stochvi.isolators.tolerances import Tolerances
from stochvi.mathematics.numerics import Matrix, Vector
from stochvi.mathematics.unsteady_noise import MovingMean
from stochvi.model.coverage import scene_notes
from stochvi.model.model import model_of
from stochvi.results.deadline import Overdue
from stochvi.results.errors import Interrupted, NotApplicable, NotConverged
from stochvi.results.estimates import TOO_FEW, Estimate, provenance, spoken_percent
from stochvi.sampling.run import Run
from stochvi.scenes.scene import Scene
from stochvi.statistics.clusters import FAR, ImpactCounts, chance_of, count_impacts, is_far
from stochvi.statistics.crossings import MISSED, CrossingAges, largest_error, rice_rate
from stochvi.statistics.rare_hits import rare_hits

if TYPE_CHECKING:
    from stochvi.isolators.sizing.pairs import OneCurve, SharedRisk

# ------------------------------------------------------------------------------
# Impacts with the stops at a place: by clusters where first impacts are rare, else by simulating
# the whole motion.
# ------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class PlaceTrial:
    """Impacts at one place, by clusters or by simulating the whole motion.

    `hits_per_burst` is the number of impacts of a cluster; None where it is not known. `unknown`
    names, in words, the accuracy that the budget did not suffice for.
    """

    rel_error: float
    counts: ImpactCounts
    hits_per_burst: float | None = None
    unknown: str = ""

    @property
    def speed(self) -> Estimate | None:
        """Mean impact speed of the only pair, m/s; None where there are several."""
        return None if len(self.counts.speeds) > 1 else next(iter(self.counts.speeds.values()))


@dataclass(kw_only=True)
class Hits:
    """Impacts of a scene at one place after the other, from the same random numbers.

    `scene_at` gives the scene at a place, and `words` says where the stops are. `first_rate` gives
    the limiting rate of first impacts (1/s), and the time for which a cluster is followed (s).
    """

    scene_at: Callable[[float], Scene]
    first_rate: Callable[[float], tuple[float, float]]
    words: Callable[[float], str]
    tried: dict[float, PlaceTrial] = field(default_factory=dict)

    def at(self, place: float, run: Run) -> PlaceTrial:
        """The impacts at a place: simulated unless they are known at least as accurately."""
        wanted = run.accuracy
        if place not in self.tried or self.tried[place].rel_error > wanted:
            first, window = self.first_rate(place)
            counts = count_impacts(self.scene_at(place), first * window, run)
            found = self._trial(place, wanted, counts, first)
            known = self.tried.get(place, found)
            # a finer look that the budget ended may know less than the rough one before it
            rougher = _relative(known.counts.rate) < _relative(found.counts.rate)
            self.tried[place] = (
                replace(known, rel_error=wanted, unknown=found.unknown) if rougher else found
            )
        return self.tried[place]

    def _trial(
        self, place: float, rel_error: float, found: ImpactCounts, first: float
    ) -> PlaceTrial:
        hits = found.hits_per_burst
        per_burst = None if hits is None else hits.value
        if hits is None and first and not found.rate.upper_95:
            per_burst = found.rate.value / first
        unknown = ""
        if found.short:
            unknown = (
                f"the budget ended before the impacts at {self.words(place)} were known to a "
                f"relative error of {rel_error:g}"
            )
        return PlaceTrial(
            rel_error=rel_error, counts=found, hits_per_burst=per_burst, unknown=unknown
        )


# ------------------------------------------------------------------------------
# One sizing as it goes on, of any number of pairs: the search by impacts, and the answer.
#
# A place is one number that says where the stops of all sized pairs go; farther stops have a larger
# one. One pair has its clearance as its place. Several pairs share the risk equally: their place is
# -ln of the risk that each has alone. The logarithm of a rate of impacts is nearly straight in a
# coordinate of the place: the square of a clearance, or that logarithm itself.
# ------------------------------------------------------------------------------


Point = tuple[float, float]
"""A coordinate, and the logarithm of the rate there over the wanted one."""


@dataclass(frozen=True, kw_only=True)
class SearchSettings:
    """Settings of the search for a clearance. Where no source is named, the number was chosen by
    trial.

    Parameters
    ----------
    lowest_sigma
        The first clearance of the curve of one pair, in standard deviations of its gap.
    required
        Probabilities of any impact in the mission whose clearances every answer lists.
    most_places
        Largest number of places that are tried for a target that needs impacts.
    rough_looks
        Number of places that are tried roughly before each is tried accurately.
    least_sigma
        The smallest clearance that is tried for a rate of impacts, in standard deviations.
    most_overlap
        Two clusters count as separate up to this number of first impacts in the time for which a
        cluster is followed.
    closer
        Ratio of a clearance to the one before it, below the clearances at which clusters are
        separate.
    near_enough
        That ratio from which on no closer one is tried.
    rough_error, share_of_limit
        Relative error, and share of the remaining time, of the probability that a limit is exceeded
        where no cluster exceeds it.
    share_of_counting
        Share of the time of the last place for counted clusters; splitting has the rest.
    share_of_windows
        Share of the remaining time for windows of the whole motion at one clearance.
    share_of_tolerances
        Share of the budget for the worst case, where tolerances were asked for.
    rough_factor
        Relative error of a rough look at a place, as a multiple of the error asked for.
    roughest
        Largest relative error of a rough look; a simulation takes none of 1 or more.
    close
        Relative difference between a rate and the wanted one below which the answer is
        extrapolated from the place that was tried.
    grace
        Share of the budget by which the search for a clearance may outlast its time, because an
        answer is mostly near then.
    least_seconds
        Seconds that every calculation gets, even where the budget is spent.
    share_of_hits
        Share of the budget that is kept for simulating the impacts.
    most_error
        Relative error of the probability of an impact above which no clearance is given.
    reach
        Logarithm of a rate over the wanted one, in magnitude, up to which the answer is
        extrapolated from the place of that rate.
    steepest
        Largest logarithm of a rate over the wanted one, in magnitude, that a step of the search
        follows.
    divisor_on_the_way, divisor_of_last
        Divisors of the remaining time: the first gives the time of a place that is tried on the
        way, the second that of the place that the answer rests on.
    many
        Expected impacts of a mission above which a warning says that a limit of speed or
        acceleration lets them happen.
    pumped, more_than_rice
        Impacts per first impact, and impacts over their number by Rice's rate. Above both limits a
        warning says that the stops pump the mount.
    """

    lowest_sigma: float = 1.0
    required: tuple[float, ...] = (0.1, 0.01, 0.001)
    most_places: int = 24
    rough_looks: int = 6
    least_sigma: float = 0.2
    most_overlap: float = 0.5
    closer: float = 0.5
    near_enough: float = 0.95
    rough_error: float = 0.5
    share_of_limit: float = 0.4
    share_of_counting: float = 0.3
    share_of_windows: float = 0.7
    share_of_tolerances: float = 0.4
    rough_factor: float = 3.0
    roughest: float = 0.9
    close: float = 0.02
    grace: float = 0.05
    least_seconds: float = 0.2
    share_of_hits: float = 0.4
    most_error: float = 1.0
    reach: float = math.log(FAR)
    steepest: float = 8.0
    divisor_on_the_way: float = 4.0
    divisor_of_last: float = 1.25
    many: float = 1.0
    pumped: float = 3.0
    more_than_rice: float = 1.5


SEARCH = SearchSettings()

SIMULATED = (
    "clearance_in_sigma", "hit_rate", "hit_rate_low", "hit_rate_high", "hits_per_first_hit",
    "impact_speed_mean", "by",
)  # fmt: skip
"""Columns of `Sizing.simulated` beside the clearances."""


@dataclass(frozen=True)
class Reached:
    """A place, and the 95 % interval of the calculation."""

    place: float
    lower: float
    upper: float


@dataclass
class TriedPlaces:
    """What a search for a place has seen.

    Parameters
    ----------
    slope
        Change of the logarithm of the rate per unit of the coordinate.
    above, below
        The last places with too high a rate, and with one that is shown to be low enough.
    unknown
        The last place at which hardly anything was seen, without showing that it keeps the target.
    kept
        The nearest place that is shown to keep the target.
    closest
        The place whose rate is closest to the wanted one, that rate, and its logarithm over it.
    looked_near
        Whether the nearest place of all was unknown.
    """

    slope: float
    above: Point | None = None
    below: Point | None = None
    unknown: Point | None = None
    kept: float | None = None
    closest: tuple[float, Estimate, float] | None = None
    looked_near: bool = False

    def add(self, point: Point, most: float, nearest: bool) -> None:
        """Add a place; `most` is the most that its rate may be, over the wanted one."""
        if point[1] > 0.0:
            self.above = point
        elif most <= 1.0:
            self.below = point
        else:
            self.unknown = point[0], math.log(most)
            self.looked_near = self.looked_near or nearest
        above, below = self.above, self.below
        if above and below and above[0] < below[0] and math.isfinite(below[1]):
            self.slope = (below[1] - above[1]) / (below[0] - above[0])

    @property
    def edge(self) -> Point | None:
        """The farthest place that is not known to keep the target: one of too high a rate, or an
        unknown one. The answer lies beyond that, if none does before it."""
        above, below, unknown = self.above, self.below, self.unknown
        if unknown is None or (below is not None and unknown[0] >= below[0]):
            return above
        before = unknown[0] > above[0] if above else self.looked_near
        return unknown if before else above


class Family:
    """Stops that go farther as one number, the place, rises, and how the risk of their gaps is
    known: by the curve of one gap (`OneCurve`), or shared between the gaps of a structure
    (`SharedRisk`). A family answers as these two do; here is what they have in common."""

    three_sigma_place: float | None = None
    """The place of the rule of three sigma, where it is one."""
    late_hits: bool = True
    """Whether impacts are simulated for information where the budget has ended."""
    searched: tuple[float, float] = (0.1, 0.65)
    """Fraction done at the beginning of the search, and at its end."""
    outputs: tuple[str, ...] | None = None
    """Names of the outputs whose accelerations are limited; None for all."""
    scene: Scene
    motions: Sequence[MovingMean]
    """How the gaps move."""

    def stops(self, place: float) -> Matrix:
        """(2, pairs): distances of the stops from the mean gaps at a place, m; infinite for
        none."""
        raise NotImplementedError

    def columns(self, place: float) -> dict[str, float]:
        """The clearances at a place, m, by their columns in tables."""
        raise NotImplementedError

    def scene_at(self, place: float) -> Scene:
        """The scene with its stops at a place."""
        return at_clearances(self.scene, self.stops(place))

    def words(self, place: float) -> str:
        """The smallest and the largest of the clearances, in words."""
        found = self.columns(place).values()
        ends = dict.fromkeys(f"{1e3 * each:.4g}" for each in (min(found), max(found)))
        return f"{' to '.join(ends)} mm"

    def length(self, place: float) -> float:
        """The first of the clearances at a place, m."""
        return next(iter(self.columns(place).values()))

    def rice_rate(self, place: float) -> float:
        """Rice's rate of crossings of all stops at a place, 1/s."""
        return rice_rate(self.motions, self.stops(place))

    def within_ends(self, place: float) -> float:
        """The place itself, or the nearest one whose risk is known."""
        return place

    def coordinate(self, place: float) -> float:
        """A coordinate of a place, in which the logarithm of a rate is nearly straight."""
        return place

    def place_at(self, coordinate: float) -> float:
        """The place of a coordinate."""
        return coordinate

    def slope(self, place: float) -> float:
        """Slope of the logarithm of a rate over the coordinate, as far as it is known before."""
        return -1.0

    def steepness(self, place: float) -> float:
        """Slope of the coordinate over the place."""
        return 1.0


@dataclass(kw_only=True)
class SizingJob:
    """One sizing: its question, and the findings on the way.

    `by` makes the family from the job, whose run and warnings it uses. It is `patient` until it was
    ended long after its budget.
    """

    scene: Scene
    asked: Question
    allowed: Tolerances
    by: Callable[[SizingJob], OneCurve | SharedRisk]
    warnings: list[str] = field(default_factory=list)
    fell_short: list[str] = field(default_factory=list)
    unfinished: dict[float, str] = field(default_factory=dict)
    exceeded: dict[float, Estimate] = field(default_factory=dict)
    kept_with: Estimate | None = None
    patient: bool = True

    def __post_init__(self) -> None:
        self.target, self.mission, self.run = self.asked.target, self.asked.mission, self.asked.run
        self.deadline, self.rel_error = self.run.deadline, self.run.accuracy
        self.impacts = bool(self.scene.impact_pairs) and self.asked.impacts
        # an answer is mostly near when the time of a search ends
        self.late = self.deadline.sooner_by(-SEARCH.grace * self.deadline.left)
        self.method = by = self.by(self)
        self.hits = Hits(scene_at=by.scene_at, first_rate=by.first_rate, words=by.words)

    def reach(self) -> Reached:
        """Find the place that keeps the target."""
        if self.target.name == "probability":
            return self.method.keeping(self.target.value)
        if self.target.exceedance is None:
            return self.search(self.target.value)
        self.method.check_free_motion(self.target.exceedance)
        return self.search(self.accepted_rate)

    @property
    def accepted_rate(self) -> float:
        """Rate of exceedances of the limit at which a mission has the accepted probability of any,
        1/s."""
        assert self.target.exceedance is not None
        return -math.log1p(-self.target.exceedance) / self.mission

    def sizing(self) -> Sizing:
        """Find the place, then the other numbers of the answer."""
        short: NotConverged | Interrupted | None = None
        try:
            reached = self.reach()
        except (NotConverged, Interrupted) as reason:
            if not isinstance(reason.partial, Reached):
                raise
            reached, short = reason.partial, reason
            self.warnings.insert(0, str(reason))
        found = self.answer(reached)
        if self.deadline.interrupted:
            raise self.deadline.fell_short("before the answer was whole", "", found)
        if short is not None:
            raise NotConverged(str(short), found)
        return found

    def answer(self, found: Reached) -> Sizing:
        """The answer at a place, with the other numbers that belong to it."""
        method, place = self.method, self.method.within_ends(found.place)
        own = method.own_fields(place)  # before the impacts, which may take all the time
        three, marked = method.three_sigma(), {"recommended": place}
        if method.three_sigma_place is not None:
            marked = {"three_sigma": method.three_sigma_place, **marked}
        trial = None
        if self.impacts:
            self.stage(0.9, 1.0, f"impacts at {method.words(place)}")
            trial = self.hits_or_warning(place)
        self.warn(trial, marked)
        counts, linear = None if trial is None else trial.counts, screened(self.scene)
        return Sizing(
            scene=self.scene, target=self.target, mission=self.mission, screening=linear,
            record=linear.record, allowed=self.allowed, kept_with=self.kept_with,
            clearances=method.clearances(found),
            pairs=self._pairs_table(place, counts),
            curve=method.curve_table(),
            three_sigma=three,
            required=method.required(),
            expected_hits=None if counts is None else counts.rate * self.mission,
            simulated=self._simulated(),
            evidence={
                name: response
                for name, at in marked.items()
                if at in self.hits.tried and (response := self.hits.tried[at].counts.response)
            },
            exceeding=None if self.target.exceedance is None else self._exceeding(),
            fell_short=tuple(dict.fromkeys(self.fell_short)),
            warnings=tuple(dict.fromkeys(self.warnings)),
            cost=self.run.cost(paths=method.paths),
            provenance=provenance(self.scene.document(), self.run.seed),
            **own,
        )  # fmt: skip

    def _pairs_table(self, place: float, counts: ImpactCounts | None) -> Any:
        """The table that `Sizing.pairs` describes."""
        method = self.method
        rates = {} if counts is None else counts.rates
        speeds = {} if counts is None else counts.speeds
        stops = method.stops(place)
        known = np.where(np.isfinite(stops), stops, math.nan)
        return {
            "pair": method.names,
            "sigma": method.sigma,
            **dict(zip(SIDES, known, strict=True)),
            "clearance_in_sigma": self._in_sigma(stops),
            "probability_alone": method.alone(place),
            "share_of_first_hits": method.shares(place),
            "expected_hits": [_value(rates.get(name)) * self.mission for name in method.names],
            "impact_speed_mean": [_value(speeds.get(name)) for name in method.names],
        }

    def _in_sigma(self, stops: Matrix) -> Vector:
        """(pairs,): distances of the nearer stops, over the rms of the gaps; NaN of one at rest."""
        sigma = self.method.sigma
        return np.asarray(stops.min(axis=0) / np.where(sigma, sigma, math.nan))

    def _simulated(self) -> Any:
        """The table that `Sizing.simulated` describes."""
        rows: list[dict[str, float | str | None]] = []
        for place, tried in sorted(self.hits.tried.items()):
            rate, speed = tried.counts.rate, tried.speed
            half = rate.half_width_95()
            unseen = rate.upper_95 is not None
            rows.append(
                {
                    **self.method.columns(place),
                    "clearance_in_sigma": float(
                        np.nanmin(self._in_sigma(self.method.stops(place)))
                    ),
                    "hit_rate": rate.value,
                    "hit_rate_low": max(rate.value - half, 0.0),
                    "hit_rate_high": rate.upper_95 if unseen else rate.value + half,
                    "hits_per_first_hit": tried.hits_per_burst,
                    "impact_speed_mean": math.nan if speed is None else speed.value,
                    "by": tried.counts.way,
                }
            )
        return rows or dict.fromkeys([*self.method.columns(1.0), *SIMULATED], ())

    def _exceeding(self) -> Any:
        """The table that `Sizing.exceeding` describes."""
        rows = []
        for place, chance in sorted(self.exceeded.items()):
            half = 0.0 if chance.upper_95 else chance.half_width_95()
            rows.append(
                {
                    **self.method.columns(place),
                    "probability": math.nan if chance.upper_95 else chance.value,
                    "probability_low": max(chance.value - half, 0.0),
                    "probability_high": chance.upper_95 or min(chance.value + half, 1.0),
                }
            )
        return rows

    def short(self, warning: str) -> None:
        """Add a warning of an accuracy for which the budget did not suffice."""
        self.warnings.append(warning)
        self.fell_short.append(warning)

    def stage(self, low: float, high: float, words: str) -> None:
        """Begin a stage of the sizing, in which the fraction done goes from `low` to `high`."""
        self.staged = low, high, words
        self.run.tell(low, words)

    def part(self, share: float = 1.0, rel_error: float | None = None) -> Run:
        """The run of a calculation of this stage, in a share of the time that is left; never less
        than `SEARCH.least_seconds`, in which a calculation can end."""
        left = self.deadline.in_no_less_than(SEARCH.least_seconds)
        return self.run.part(*self.staged, left.share(share), rel_error=rel_error or self.rel_error)

    def check_crossings(self, found: CrossingAges) -> None:
        """Warn where the probability of an impact is not as accurate as asked for; raise where
        hardly anything is known of it."""
        reached = largest_error(found, self.mission)
        if reached > SEARCH.most_error:
            raise self.deadline.fell_short(
                f"at a relative error of {reached:.3g} of the probability of an impact: hardly any "
                "first impact was seen",
                "raise budget",
            )
        if reached > MISSED * self.rel_error:
            self.short(
                f"the budget ended at a relative error of {reached:.3g} of the probability of "
                "an impact"
            )

    def search(self, wanted: float) -> Reached:
        """The place at which a rate takes the wanted value: roughly first, then accurately.

        The search follows the slope that is known before until two places have the wanted rate
        between them. Where few clusters decide, the rate jumps from one place to the next: after
        some rough looks each is accurate, and the answer is extrapolated from farther away.
        """
        place = self.method.first_guess(wanted)
        known = TriedPlaces(self.method.slope(place))
        (begin, end), (near, far) = self.method.searched, self.method.ends
        for attempt in range(SEARCH.most_places):
            if attempt and self.late.passed():
                break
            done = min(begin + 0.05 * attempt, end)
            self.stage(done, done + 0.05, self.method.words(place))
            nearest = place <= near + SEARCH.close * abs(near)
            rough = attempt < SEARCH.rough_looks
            found, decided = self._look(place, wanted, rough, nearest, known)
            excess, _ = _excess(found, wanted)
            if abs(excess) <= SEARCH.reach:
                if decided:
                    return self.extrapolated(place, found, excess, known.slope)
                if known.closest is None or abs(excess) < abs(known.closest[2]):
                    known.closest = place, found, excess
            shown = most_of(found) <= wanted
            if excess < 0.0 and nearest and (shown or known.kept is None):
                return self.method.already_kept(place, found)
            if shown and (known.kept is None or place < known.kept):
                known.kept = place
            point = (self.method.coordinate(place), excess)
            known.add(point, most_of(found) / wanted, nearest)
            if excess > 0.0 and place >= far:
                raise self.never_kept(excess)
            edge = known.edge
            if known.kept is not None and edge and edge is known.unknown:
                least, most = map(self.method.length, (self.method.place_at(edge[0]), known.kept))
                if SEARCH.near_enough * most <= least < most:
                    return self.enough(known.kept, known)
            place = self.method.place_at(self._next(edge, known.below, point))
        return self._without_decision(known, attempt)

    def _look(
        self, place: float, wanted: float, rough: bool, nearest: bool, known: TriedPlaces
    ) -> tuple[Estimate, bool]:
        """The rate at a place, and whether it is accurate and near the wanted one.

        A rough look that saw nothing, and does not show that the place keeps the target, goes on
        to what can be found without impacts.
        """
        roughest = min(SEARCH.rough_factor * self.rel_error, SEARCH.roughest)
        asked = roughest if rough else self.rel_error
        found = self.rate(place, asked, known.unknown is not None)
        hidden = most_of(found) > wanted and not found.value
        if hidden and rough and known.unknown is None and (known.above or nearest):
            found = self.rate(place, asked, unseen=True)
        excess, tolerance = _excess(found, wanted)
        if abs(excess) > (max(tolerance, SEARCH.close) if rough else SEARCH.reach):
            return found, False
        return self.rate(place, self.rel_error) if rough else found, True

    def _without_decision(self, known: TriedPlaces, tried: int) -> Reached:
        """The answer from the closest place, where no place had the wanted rate; else raise."""
        if known.closest is not None:
            return self.extrapolated(*known.closest, known.slope)
        answer = None if known.kept is None else self.enough(known.kept, known)
        sought = f"the clearance for {self.target.name} = {self.target.value:g}"
        between = ""
        if known.unknown:
            seen = self.method.words(self.method.place_at(known.unknown[0]))
            between = f": hardly an impact beyond the limit was seen at {seen}"
        if self.deadline.passed():
            raise self.deadline.fell_short(
                f"before {sought} was found (places tried: {tried}){between}",
                "raise budget or rel_error",
                answer,
            )
        raise NotConverged(
            f"{sought} was not found in {SEARCH.most_places} places"
            f"{between or ': the rate jumps between them'}; lower rel_error or raise budget",
            answer,
        )

    def _next(self, above: Point | None, below: Point | None, last: Point) -> float:
        """The next coordinate to try, from those where the rate is too high and too low."""
        if above and below:
            middle = 0.5 * (above[0] + below[0])
            if not math.isfinite(below[1]):
                return middle
            share = above[1] / (above[1] - below[1])
            # not too near an end, which would move the other one too slowly
            return above[0] + min(max(share, 0.1), 0.9) * (below[0] - above[0])
        if above:
            last = above[0], max(above[1], SEARCH.reach)
        most = SEARCH.steepest
        step = -max(min(last[1], most), -most) / self.method.slope(self.method.place_at(last[0]))
        near, far = map(self.method.coordinate, self.method.ends)
        return min(max(last[0] + step, near), far)

    def never_kept(self, excess: float) -> NotApplicable:
        """The refusal of a target that the farthest place misses."""
        return NotApplicable(
            "size",
            f"no clearance that is tried keeps the target ({self.target.kept(self.mission)}): at "
            f"the largest ones it is missed by a factor of {math.exp(excess):.3g}; ask for less, "
            "or move the other stops",
        )

    def extrapolated(self, place: float, found: Estimate, excess: float, slope: float) -> Reached:
        """The answer, extrapolated from a place near it that was tried.

        A rate of impacts is a mean, and a standard error that is larger than asked for widens the
        interval. A rate of exceedances may rest on so few clusters that its standard error is too
        small as well: then no interval can be given, and `NotConverged` carries the place.
        """
        steep = self.method.steepness(place) * slope
        half = found.half_width_95() / found.value / abs(steep)
        value = place - excess / steep
        answer = Reached(value, value - half, value + half)
        if place in self.unfinished:
            raise NotConverged(
                f"{self.unfinished[place]}; size for a probability or a rate of impacts instead",
                answer,
            )
        error = found.standard_error / found.value
        if error <= MISSED * self.rel_error:
            return answer
        beyond = "" if self.target.exceedance is None else " beyond the limit"
        reached = (
            f"the budget ended at a relative error of {error:.3g} of the rate of impacts{beyond} "
            f"at {self.method.words(place)}"
        )
        if self.target.exceedance is not None:
            raise NotConverged(
                f"{reached}; {self.rel_error:g} was asked for: raise budget or rel_error", answer
            )
        self.short(reached)
        return answer

    def rate(self, place: float, rel_error: float, unseen: bool = False) -> Estimate:
        """The rate that decides at a place: of impacts or, for a limit, of what exceeds it, 1/s;
        by splitting as well where counting has seen hardly anything before (`unseen`)."""
        rough = rel_error > self.rel_error
        divisor = SEARCH.divisor_on_the_way if rough else SEARCH.divisor_of_last
        if self.target.exceedance is not None:
            run = self.part(1.0 / divisor, rel_error)
            counted = rough and not unseen
            rate = self.method.exceedance_rate if counted else self._accurate_rate
            return rate(place, run)
        found = self.hits.at(place, self.part(rel_error=rel_error)).counts.rate
        if TOO_FEW in found.how:
            where = f"when impacts at {self.method.words(place)} had been seen {TOO_FEW}"
            raise self.deadline.fell_short(where, "raise budget")
        return found

    def _accurate_rate(self, place: float, run: Run) -> Estimate:
        """Rate of exceedances, by counting and, where it sees too few, by splitting."""
        first = run.part(deadline=run.deadline.share(SEARCH.share_of_counting))
        counted = self.method.exceedance_rate(place, first)
        known = bool(counted.value) and _relative(counted) <= MISSED * run.accuracy
        if known or is_far(counted, self.accepted_rate) or run.deadline.passed():
            return counted
        chance = self.by_splitting(place, run)
        split = None if chance is None else rate_of(chance, self.mission)
        if split is None or (counted.value and _relative(split) > _relative(counted)):
            return counted
        self.unfinished.pop(place, None)
        found = more_telling(counted, split)
        self.exceeded[place] = chance_of(found, self.mission)
        return found

    def by_splitting(self, place: float, run: Run | None = None) -> Estimate | None:
        """The probability that the limit is exceeded at a place, by the splitting of
        `reliability`, roughly by default; None where that does not apply."""
        run = run or self.part(SEARCH.share_of_limit, SEARCH.rough_error)
        try:
            return rare_hits(
                self.method.scene_at(place), self.target.name, self.target.value,
                mission=self.mission, outputs=self.method.outputs,
                **run.options(rel_error=run.accuracy),
            ).chance  # fmt: skip
        except (NotApplicable, NotConverged, Interrupted):
            return None

    def enough(self, kept: float, known: TriedPlaces) -> Reached:
        """The nearest place that is shown to keep the target, where too few impacts beyond the
        limit are seen at nearer ones; the interval begins where the limit is seen to be
        exceeded."""
        self.kept_with = self.exceeded.get(kept)
        above = known.above
        why = (
            "too few impacts beyond the limit were seen there"
            if above or known.unknown
            else "the budget ended before less was tried"
        )
        self.warnings.append(f"less than {self.method.words(kept)} may do as well: {why}")
        return Reached(
            kept, min(self.method.place_at(above[0]), kept) if above else -math.inf, kept
        )

    def shown_to_keep(self, chance: Estimate, answer: Reached) -> Reached:
        """The smallest place that is tried, with the probability that the limit is exceeded there;
        `NotConverged` carries it where that is not shown to be an accepted one."""
        self.kept_with = chance
        accepted = self.target.exceedance
        assert accepted is not None
        if within(chance, accepted):
            return answer
        raise self.deadline.fell_short(
            f"before it was shown that {self.target.limit} is exceeded at "
            f"{self.method.words(answer.place)} with a probability below "
            f"{spoken_percent(accepted)}: hardly any cluster exceeds it",
            "raise budget",
            answer,
        )

    def hits_or_warning(self, place: float) -> PlaceTrial | None:
        """Impacts for information alone; None and a warning where they are not found."""
        where = self.method.words(place)
        if self.deadline.interrupted:
            self.warnings.append(f"the impacts at {where} were not simulated")
            return None
        if self.deadline.passed() and not (self.method.late_hits and self.patient):
            self.short(f"the impacts at {where} are not known: the budget ended")
            return None
        try:
            return self.hits.at(place, self.part())
        except (NotApplicable, NotConverged, Interrupted) as reason:
            known = isinstance(reason, NotApplicable)
            (self.warnings.append if known else self.short)(
                f"the impacts at {where} are not known: {reason}"
            )
            return None
        except Overdue:  # the answer without them is known
            self.patient = False
            self.short(f"the impacts at {where} are not known: the budget ended")
            return None

    def warn(self, trial: PlaceTrial | None, marked: Mapping[str, float]) -> None:
        """Add the warnings that concern the scene and the impacts at the marked places."""
        model = model_of(self.method.scene_at(marked["recommended"]))
        self.warnings += scene_notes(model)
        if not self.scene.impact_pairs:
            self.warnings.append(
                "the scene has no stops, so the impacts and their speeds are not known"
            )
        impacts = 0.0 if trial is None else trial.counts.rate.value * self.mission
        if self.target.exceedance is not None and impacts > SEARCH.many:
            self.warnings.append(
                f"the target limits how hard an impact is, not how many there are: {impacts:.3g} "
                "are expected in the mission; give probability for a clearance that avoids them"
            )
        for place in marked.values():
            tried = self.hits.tried.get(place)
            if tried and tried.unknown:
                self.short(tried.unknown)
            if not tried or not tried.hits_per_burst:
                continue
            over_rice = tried.counts.rate.value / self.method.rice_rate(place)
            if tried.hits_per_burst > SEARCH.pumped and over_rice > SEARCH.more_than_rice:
                self.warnings.append(
                    f"stops pump this mount: at {self.method.words(place)} a first impact leads to "
                    f"{tried.hits_per_burst:.3g} impacts on average, {over_rice:.3g} times what "
                    "Rice's rate says; the probability of any impact is right all the same"
                )


def within(chance: Estimate, accepted: float) -> bool:
    """Whether a probability, or its upper limit where it has one, is at most the accepted one."""
    return most_of(chance) <= accepted


def most_of(found: Estimate) -> float:
    """A value, or its upper limit where that alone is known."""
    return found.value if found.upper_95 is None else found.upper_95


def more_telling(known: Estimate, found: Estimate | None) -> Estimate:
    """The better of a known probability and one found in another way. The latter may be an upper
    limit that says less, such as 1 without time for a single window."""
    if found is None or found.upper_95 is None:
        return found or known
    most = known.value + known.half_width_95() if known.upper_95 is None else known.upper_95
    return found if found.upper_95 < most else known


def _value(estimate: Estimate | None) -> float:
    """A number, NaN where it is not known, or an upper limit alone."""
    return math.nan if estimate is None or estimate.upper_95 is not None else estimate.value


def rate_of(chance: Estimate, mission: float) -> Estimate:
    """Rate of events of which any happens in a mission with a probability, 1/s."""
    left = max(1.0 - chance.value, 1e-12)
    most = chance.upper_95
    upper = None if most is None else -math.log(max(1.0 - most, 1e-12)) / mission
    rate = -math.log(left) / mission
    return replace(chance * (1.0 / left / mission), value=rate, upper_95=upper)


def _relative(found: Estimate) -> float:
    """Relative standard error; infinite where nothing was seen."""
    return found.standard_error / found.value if found.value else math.inf


def _excess(found: Estimate, wanted: float) -> Point:
    """Logarithm of a rate over the one that is wanted, and its standard error."""
    if not found.value:
        return -math.inf, 0.0
    return math.log(found.value / wanted), found.standard_error / found.value
