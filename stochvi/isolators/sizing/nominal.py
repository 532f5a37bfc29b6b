"""The clearance that a scene needs as it is stated, without its tolerances.

The probability of any impact needs no impact (`first_crossings`). What an impact leads to needs the
stop law: where first impacts are rare, clusters are simulated from the first impact on (`bursts`),
else everything (`simulate`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from stochvi.isolators.moved_stops import at_clearances
from stochvi.isolators.screening import screened
from stochvi.isolators.sizing.answer import (
    Clearance,
    Sizing,
    Target,
    ThreeSigma,
    spoken_percent,
)
from stochvi.isolators.sizing.chance_at_stops import are_uneven, distances_of_stops
from stochvi.isolators.sizing.changes import Tolerances
from stochvi.isolators.sizing.exceedances import chance_in_windows
from stochvi.isolators.sizing.hits_at_clearance import ClearanceTrial, Hits
from stochvi.isolators.sizing.pairs import size_pairs
from stochvi.isolators.sizing.pairs_answer import PairsSizing
from stochvi.isolators.sizing.question import Question
from stochvi.isolators.sizing.risk_curve import RiskCurve, clearances_of_curve
from stochvi.isolators.sizing.targets import check_laws, limit_of_pairs, widening
from stochvi.model.cautions import scene_notes
from stochvi.model.coverage import beyond_one_oscillator, modulated
from stochvi.model.model import model_of
from stochvi.results.deadline import partial_result
from stochvi.results.errors import Interrupted, NotApplicable, NotConverged
from stochvi.results.estimates import TOO_FEW, Estimate, provenance
from stochvi.sampling.run import Run
from stochvi.scenes.scene import Scene
from stochvi.statistics.bursts import FAR, UNFINISHED, bursts, chance_of
from stochvi.statistics.crossing_ages import largest_error
from stochvi.statistics.first_crossings import first_crossings, one_gap
from stochvi.statistics.pair_crossings import PairMotion
from stochvi.statistics.reliability import reliability

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, kw_only=True)
class SearchSettings:
    """Settings of the search for a clearance. Where no source is named, the number was chosen by
    trial.

    Parameters
    ----------
    lowest_sigma
        The first clearance of the curve, in standard deviations of the linear displacement.
    required
        Probabilities of any impact in the mission whose clearances every answer lists.
    most_clearances
        Largest number of clearances that are tried for a target that needs impacts.
    rough_looks
        Number of clearances that are tried roughly before each is tried accurately.
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
    share_of_windows
        Share of the remaining time for windows of the whole motion at one clearance.
    share_of_tolerances
        Share of the budget for the worst case, where tolerances were asked for.
    rough_factor
        Relative error of the first look at a clearance, as a multiple of the error asked for.
    roughest
        Largest relative error of a first look; a simulation takes none of 1 or more.
    close
        Relative difference between a rate and the wanted one below which the clearance is
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
        Logarithm of a rate over the wanted one, in magnitude, up to which a clearance is
        extrapolated from the place of that rate.
    divisor_on_the_way, divisor_of_last
        Divisors of the remaining time: the first gives the time of a clearance that is tried on the
        way, the second that of the clearance that the answer rests on.
    many
        Expected impacts of a mission above which a warning says that a limit of speed or
        acceleration lets them happen.
    pumped, more_than_rice
        Impacts per first impact, and impacts over their number by Rice's rate. Above both limits a
        warning says that the stops pump the mount.
    """

    lowest_sigma: float = 1.0
    required: tuple[float, ...] = (0.1, 0.01, 0.001)
    most_clearances: int = 24
    rough_looks: int = 6
    least_sigma: float = 0.2
    most_overlap: float = 0.5
    closer: float = 0.5
    near_enough: float = 0.95
    rough_error: float = 0.5
    share_of_limit: float = 0.4
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
    divisor_on_the_way: float = 4.0
    divisor_of_last: float = 1.25
    many: float = 1.0
    pumped: float = 3.0
    more_than_rice: float = 1.5


SEARCH = SearchSettings()

ACCEPTED = 0.01
"""Default probability that a limit of speed or acceleration is exceeded in the mission."""

BY_FIRST_CROSSINGS = (
    "first crossings of the Gaussian response{beside} without stops (records around outcrossings); "
    "no impact law enters"
)
BESIDE = {0: "", 1: " beside the sine,", 2: " beside the sines,"}
"""Words on the mean of that response, by the number of sines, at most 2."""

BY_HITS = (
    "impacts with the stop law: clusters simulated from first impacts on where these are rare, "
    "else the whole motion; the same random numbers at every clearance"
)
BY_BURSTS = (
    "clusters of impacts simulated with the stop law from first impacts on; fast first impacts "
    "drawn more often, and weighted"
)

METHODS = {"probability": BY_FIRST_CROSSINGS, "rate": BY_HITS}
"""How the clearance is found, by the name of the target; for a target that is not here, by
clusters."""

SIMULATED = (
    "clearance", "clearance_in_sigma", "hit_rate", "hit_rate_low", "hit_rate_high",
    "hits_per_first_hit", "impact_speed_mean", "by",
)  # fmt: skip
"""Columns of `Sizing.simulated`."""


def nominal_sizing(scene: Scene, asked: Question) -> Sizing | PairsSizing:
    """The sizing of a scene as it is stated, without the worst case within its tolerances."""
    allowed = asked.tolerances or Tolerances.of(scene)
    try:
        if conditions := modulated(model_of(scene)):
            raise NotApplicable("size", conditions)
        if not model_of(scene).single:
            return size_pairs(scene, limit_of_pairs(scene, asked.target, asked.at), asked)
        if asked.at is not None:
            raise ValueError(
                f"at is for several coordinates or pairs, got {asked.at!r} for one oscillator"
            )
        allowed = allowed.felt(scene, by_hits=asked.target.name != "probability")
        return _Job(
            scene=scene, target=asked.target, mission=asked.mission, run=asked.run, allowed=allowed
        ).sizing()
    except NotApplicable as reason:
        # the user called `size`, so that the refusal has its name, whatever function it came from
        raise NotApplicable("size", reason.conditions) from reason


def risk_curve(
    scene: Scene, target: Target, mission: float, run: Run, shift: float = 0.0
) -> RiskCurve:
    """Probability of any impact against clearance, from 1 sigma to a clearance that is more than
    the target needs; the stops lie uneven where the static equilibrium is shifted, m, and the
    clearance is that of the nearer one."""
    (motion,) = PairMotion.under_shocks(one_gap(model_of(scene))).motions
    chances = [*SEARCH.required, target.exceedance or 1.0]
    if target.name == "probability":
        chances.append(target.value)
    # the clearance at which both stops are crossed so seldom in a mission, or in a cycle
    exposed = max(mission, 1.0 / motion.rate(0.0))
    wanted = min(chances) / (20.0 * exposed)
    highest = max(motion.towards(side).distance_of(wanted) for side in (-1.0, 1.0))
    levels = clearances_of_curve(motion, SEARCH.lowest_sigma * motion.deviations[0], highest)
    pair = scene.impact_pairs[0] if scene.impact_pairs else None
    farther = levels + 2.0 * abs(shift)
    lower, upper = farther if shift > 0.0 else levels, levels if shift >= 0.0 else farther
    found = partial_result(
        first_crossings,
        scene,
        lower=None if pair is not None and pair.lower is None else lower,
        upper=None if pair is not None and pair.upper is None else upper,
        mission=mission,
        **run.options(rel_error=run.rel_error),
    )
    return RiskCurve.of(found, mission)


def chance_between(
    scene: Scene, distances: Mapping[str, float], mission: float, run: Run
) -> Estimate:
    """Probability of any impact with stops at these distances from the static equilibrium, by
    "lower" and "upper", m; 1 where one of them presses on the mass."""
    if min(distances.values()) <= 0.0:
        return Estimate(value=1.0, how="a stop presses on the mass")
    found = partial_result(
        first_crossings, scene, mission=mission, **distances, **run.options(rel_error=run.rel_error)
    )
    return found.probability(mission)[0]


@dataclass(kw_only=True)
class _Job:
    """One sizing: its target, run and tolerances, and the findings on the way."""

    scene: Scene
    target: Target
    mission: float
    run: Run
    allowed: Tolerances
    warnings: list[str] = field(default_factory=list)
    fell_short: list[str] = field(default_factory=list)
    unfinished: dict[float, str] = field(default_factory=dict)
    kept_with: Estimate | None = None
    exceeded: dict[float, Estimate] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.target.name != "probability":
            check_laws(self.scene, self.target)
        self.deadline, self.rel_error = self.run.deadline, self.run.accuracy
        # an answer is mostly near when the time of a search ends
        self.late = self.deadline.sooner_by(-SEARCH.grace * self.deadline.left)
        self._stage(0.0, 0.1, "first crossings")
        share = 1.0 - SEARCH.share_of_hits if self.scene.impact_pairs else 1.0
        self.curve = risk_curve(self.scene, self.target, self.mission, self._part(share))
        self.sigma = self.curve.crossings.displacement_std
        reached = largest_error(self.curve.crossings, self.mission)
        if reached > SEARCH.most_error:
            raise self.deadline.fell_short(
                f"at a relative error of {reached:.3g} of the probability of an impact: hardly any "
                "first impact was seen",
                "raise budget",
            )
        if reached > self.rel_error:
            self._short(
                f"the budget ended at a relative error of {reached:.3g} of the probability of "
                "an impact"
            )
        self.hits = Hits(
            scene=self.scene, curve=self.curve, rel_error=self.rel_error,
            part=lambda rel_error: self._part(rel_error=rel_error),
        )  # fmt: skip

    def _short(self, warning: str) -> None:
        """Add a warning of an accuracy for which the budget did not suffice."""
        self.warnings.append(warning)
        self.fell_short.append(warning)

    def _stage(self, low: float, high: float, words: str) -> None:
        """Begin a stage of the sizing, in which the fraction done goes from `low` to `high`."""
        self.stage = low, high, words
        self.run.tell(low, words)

    def _part(self, share: float = 1.0, rel_error: float | None = None) -> Run:
        """The run of a calculation of this stage, in a share of the time that is left; never less
        than `SEARCH.least_seconds`, in which a calculation can end."""
        left = self.deadline.in_no_less_than(SEARCH.least_seconds)
        return self.run.part(*self.stage, left.share(share), rel_error=rel_error or self.rel_error)

    def sizing(self) -> Sizing:
        """Find the clearance, then the other numbers of the answer."""
        beside = BESIDE[min(len(model_of(self.scene).sines), 2)]
        method = METHODS.get(self.target.name, BY_BURSTS).format(beside=beside)
        short: NotConverged | Interrupted | None = None
        try:
            clearance = self._clearance()
        except (NotConverged, Interrupted) as reason:
            if reason.partial is None:
                raise
            clearance, short = reason.partial, reason
            self.warnings.insert(0, str(reason))
        three = self._three_sigma()
        if self.scene.impact_pairs:
            self._stage(0.9, 1.0, "recommended clearance")
            self._hits_or_warning(clearance.value)
        self._warn(clearance.value)
        crossings, linear = self.curve.crossings, screened(self.scene)
        found = Sizing(
            scene=self.scene,
            target=self.target,
            mission=self.mission,
            clearance=clearance,
            sigma=self.sigma,
            curve=self.curve.to_frame(),
            three_sigma=three,
            required=self._required(),
            simulated=self._simulated(),
            evidence={
                name: response
                for name, at in (("three_sigma", three.clearance), ("recommended", clearance.value))
                if at in self.hits.tried and (response := self.hits.tried[at].response)
            },
            screening=linear,
            method=method,
            record=linear.record,
            kept_with=self.kept_with,
            probability_of_stops=self._probability_of_stops(),
            exceeding=self._exceeding() if self.target.exceedance is not None else None,
            allowed=self.allowed,
            fell_short=tuple(dict.fromkeys(self.fell_short)),
            warnings=tuple(dict.fromkeys(self.warnings)),
            cost=self.run.cost(paths=crossings.ages.shape[3]),
            provenance=provenance(self.scene.document(), self.run.seed),
        )
        if self.deadline.interrupted:
            raise self.deadline.fell_short("before the answer was whole", "", found)
        if short is not None:
            raise NotConverged(str(short), found)
        return found

    def _clearance(self) -> Clearance:
        """The clearance that keeps the target."""
        if self.target.name == "probability":
            return self.curve.clearance(self.target.value)
        if self.target.name == "rate":
            return self._search(self._hit_rate, self.target.value)
        assert self.target.exceedance is not None
        self._check_free_motion(self.target.exceedance)
        wanted = -math.log1p(-self.target.exceedance) / self.mission
        return self._search(self._exceedance_rate, wanted)

    def _check_free_motion(self, exceedance: float) -> None:
        """Raise `NotApplicable` if the spring of the mount alone exceeds the target."""
        spring = model_of(self.scene).omega ** 2
        needed = self.curve.clearance(exceedance).value
        if self.target.name != "peak_acceleration":
            return
        if self.target.value <= spring * needed:
            raise NotApplicable(
                "size",
                [
                    f"peak_acceleration of {self.target.value:.4g} m/s^2 is exceeded without any "
                    f"stop: the spring alone brings {spring * needed:.4g} m/s^2 with a "
                    f"probability of {exceedance:g}"
                ],
            )

    def _search(self, risk: Callable[[float, float], Estimate], wanted: float) -> Clearance:
        """The clearance at which a rate takes the wanted value: roughly first, then accurately.

        The logarithm of the rate is nearly straight in the square of the clearance. The search
        follows the slope of Rice's rate until two clearances have the wanted rate between them.
        Where few clusters decide, the rate jumps from one clearance to the next: after some rough
        looks each is accurate, and the answer is extrapolated from farther away.
        """
        place = self._first_guess(wanted)
        above: tuple[float, float] | None = None
        below: tuple[float, float] | None = None
        slope = self.curve.slope(place)
        nearest: tuple[float, Estimate, float] | None = None
        for attempt in range(SEARCH.most_clearances):
            if attempt and self.late.passed():
                break
            done = min(0.1 + 0.05 * attempt, 0.65)
            self._stage(done, done + 0.05, f"{1e3 * place:.4g} mm")
            rough = attempt < SEARCH.rough_looks
            roughest = min(SEARCH.rough_factor * self.rel_error, SEARCH.roughest)
            roughly = risk(place, roughest if rough else self.rel_error)
            excess, tolerance = _excess(roughly, wanted)
            if abs(excess) <= (max(tolerance, SEARCH.close) if rough else SEARCH.reach):
                found = risk(place, self.rel_error) if rough else roughly
                excess, _ = _excess(found, wanted)
                if abs(excess) <= SEARCH.reach:
                    return self._answer(place, found, excess, slope)
            if abs(excess) <= SEARCH.reach and (nearest is None or abs(excess) < abs(nearest[2])):
                nearest = place, roughly, excess
            point = (place**2, excess)
            above, below = (point, below) if excess > 0.0 else (above, point)
            if above and below and above[0] < below[0] and math.isfinite(below[1]):
                slope = (below[1] - above[1]) / (below[0] - above[0])
            if excess < 0.0 and place <= self._least * (1.0 + SEARCH.close):
                return self._already_kept(place, roughly)
            place = math.sqrt(self._next(above, below, point))
        if nearest is not None:
            return self._answer(*nearest, slope)
        answer = None
        if above and below:
            ends = math.sqrt(above[0]), math.sqrt(below[0])
            answer = Clearance(value=place, lower=min(ends), upper=max(ends))
        sought = f"the clearance for {self.target.name} = {self.target.value:g}"
        if self.deadline.passed():
            raise self.deadline.fell_short(
                f"before {sought} was found (places tried: {attempt})",
                "raise budget or rel_error",
                answer,
            )
        raise NotConverged(
            f"{sought} was not found in {SEARCH.most_clearances} places: the rate jumps between "
            "them; lower rel_error or raise budget",
            answer,
        )

    def _answer(self, place: float, found: Estimate, excess: float, slope: float) -> Clearance:
        """The clearance, extrapolated from a place near it that was tried.

        A rate of impacts is a mean, and a standard error that is larger than asked for widens the
        interval. A rate of exceedances may rest on so few clusters that its standard error is too
        small as well: then no interval can be given, and `NotConverged` carries the clearance.
        """
        per_metre = 2.0 * place * slope
        half = found.half_width_95() / found.value / abs(per_metre)
        value = place - excess / per_metre
        answer = Clearance(value=value, lower=max(value - half, 0.0), upper=value + half)
        if place in self.unfinished:
            raise NotConverged(
                f"{self.unfinished[place]}; size for a probability or a rate of impacts instead",
                answer,
            )
        error = found.standard_error / found.value
        if error <= self.rel_error:
            return answer
        beyond = "" if self.target.exceedance is None else " beyond the limit"
        reached = (
            f"the budget ended at a relative error of {error:.3g} of the rate of impacts{beyond} "
            f"at {1e3 * place:.4g} mm"
        )
        if self.target.exceedance is not None:
            raise NotConverged(
                f"{reached}; {self.rel_error:g} was asked for: raise budget or rel_error", answer
            )
        self._short(reached)
        return answer

    def _next(
        self,
        above: tuple[float, float] | None,
        below: tuple[float, float] | None,
        last: tuple[float, float],
    ) -> float:
        """The next square of a clearance to try, from those where the rate is too high and too
        low."""
        if above and below:
            middle = 0.5 * (above[0] + below[0])
            if not math.isfinite(below[1]):
                return middle
            share = above[1] / (above[1] - below[1])
            # not too near an end, which would move the other one too slowly
            return above[0] + min(max(share, 0.1), 0.9) * (below[0] - above[0])
        step = -max(min(last[1], 8.0), -8.0) / self.curve.slope(math.sqrt(last[0]))
        return max(last[0] + step, self._least**2)

    @cached_property
    def _least(self) -> float:
        """The smallest clearance that is tried, m; for a limit, one at which clusters do not
        overlap yet."""
        if self.target.exceedance is None:
            return self.nearest
        clearances = self.curve.clearances
        meet = [
            self.curve.first_rate(c) * self.hits.window > SEARCH.most_overlap for c in clearances
        ]
        return float(clearances[int(np.flatnonzero(meet)[-1]) + 1] if any(meet) else clearances[0])

    def _already_kept(self, place: float, rate: Estimate) -> Clearance:
        """The answer where even the smallest clearance that is tried keeps the target."""
        target = self.target
        self.warnings += [self.unfinished[place]] if place in self.unfinished else []
        if target.exceedance is None:
            raise NotApplicable(
                "size",
                [f"the {target.name} stays below {target.value:g} {target.unit} at any clearance"],
            )
        chance = chance_of(rate, self.mission)
        if not _within(chance, target.exceedance):
            chance = _more_telling(chance, self._by_windows(place))
        if not _within(chance, target.exceedance):
            chance = _more_telling(chance, self._by_splitting(place))
        # closer stops, where impacts come without the pauses that separate one cluster from the
        # next
        too_near = 0.0
        while _within(chance, target.exceedance) and place > self.nearest:
            closer = max(SEARCH.closer * place, self.nearest)
            if too_near:
                closer = math.sqrt(place * too_near)
            if closer > SEARCH.near_enough * place:
                break
            there = self._by_windows(closer)
            if there is None or self.deadline.passed():
                break
            if _within(there, target.exceedance):
                place, chance = closer, there
            elif there.upper_95 is None:
                too_near = closer
            else:
                break
        self.warnings.append(
            f"a clearance below {1e3 * place:.4g} mm may do as well: it was not shown to keep the "
            "target"
        )
        self.kept_with = chance
        answer = Clearance(value=place, lower=0.0, upper=place)
        if not _within(chance, target.exceedance):
            raise self.deadline.fell_short(
                f"before it was shown that {target.limit} is exceeded at {1e3 * place:.4g} mm with "
                f"a probability below {spoken_percent(target.exceedance)}: "
                "hardly any cluster exceeds it",
                "raise budget",
                answer,
            )
        return answer

    @property
    def nearest(self) -> float:
        """The smallest clearance that is tried, m."""
        return SEARCH.least_sigma * self.sigma

    def _by_windows(self, place: float) -> Estimate | None:
        """The probability that the limit is exceeded at a clearance, by windows of the whole
        motion."""
        assert self.target.exceedance is not None
        found = chance_in_windows(
            at_clearances(self.scene, place), self.target.name, self.target.value, self.mission,
            accepted=self.target.exceedance, **self._part(SEARCH.share_of_windows).options(),
        )  # fmt: skip
        if found is not None:
            self.exceeded[place] = found
        return found

    def _by_splitting(self, place: float) -> Estimate | None:
        """The probability that the limit is exceeded at a clearance where counted clusters show
        nothing, by the splitting of `reliability`; None where that finds no better limit."""
        limits = {self.target.name: self.target.value}
        try:
            found = reliability(
                at_clearances(self.scene, place), mission=self.mission,
                impact_speed=limits.get("impact_speed"),
                peak_acceleration=limits.get("peak_acceleration"),
                **self._part(SEARCH.share_of_limit).options(rel_error=SEARCH.rough_error),
            )  # fmt: skip
        except NotApplicable:
            return None
        except (NotConverged, Interrupted) as reason:
            found = reason.partial
        chance = found.chances.get(self.target.name) if found else None
        return None if chance is None else chance.estimate

    def _first_guess(self, wanted: float) -> float:
        """The first clearance to try: where Rice's rate is the wanted one or, for a limit, a little
        below the clearance at which any impact has the accepted probability."""
        if self.target.exceedance is not None:
            return max(0.9 * self.curve.clearance(self.target.exceedance).value, self._least)
        return self.curve.place_of_rice(min(wanted, self.curve.rice_rate(0.0) / 1.2))

    def _hit_rate(self, clearance: float, rel_error: float) -> Estimate:
        found = self.hits.at(clearance, rel_error).hit_rate
        if TOO_FEW in found.how:
            where = f"when impacts at {1e3 * clearance:.4g} mm had been seen {TOO_FEW}"
            raise self.deadline.fell_short(where, "raise budget")
        return found

    def _exceedance_rate(self, clearance: float, rel_error: float) -> Estimate:
        """Rate of clusters with an impact beyond the limit of the target."""
        name, limit = self.target.name, self.target.value
        scene = at_clearances(self.scene, clearance)
        assert self.target.exceedance is not None
        rough = rel_error > self.rel_error
        divisor = SEARCH.divisor_on_the_way if rough else SEARCH.divisor_of_last
        found = partial_result(
            bursts,
            scene,
            far_from=-math.log1p(-self.target.exceedance) / self.mission,
            wanted=lambda some: some.exceedance_rate(name, limit),
            widening=widening(scene, self.target, self.curve.crossings.velocity_std, clearance),
            **self._part(1.0 / divisor).options(rel_error=rel_error),
        )
        if found.unfinished > UNFINISHED:
            self.unfinished[clearance] = (
                f"clusters of impacts at {1e3 * clearance:.4g} mm had not ended after "
                f"{found.window:.3g} s: the probability of exceeding {name} is larger than "
                "calculated"
            )
        else:
            self.unfinished.pop(clearance, None)
        rate = found.exceedance_rate(name, limit)
        self.exceeded[clearance] = chance_of(rate, self.mission)
        return rate

    def _hits_or_warning(self, clearance: float) -> ClearanceTrial | None:
        """Impacts for information alone; None and a warning where they are not found."""
        if self.deadline.interrupted:
            self.warnings.append(f"the impacts at {1e3 * clearance:.4g} mm were not simulated")
            return None
        try:
            return self.hits.at(clearance)
        except (NotApplicable, NotConverged, Interrupted) as reason:
            known = isinstance(reason, NotApplicable)
            (self.warnings.append if known else self._short)(
                f"the impacts at {1e3 * clearance:.4g} mm are not known: {reason}"
            )
            return None

    def _three_sigma(self) -> ThreeSigma:
        self._stage(0.7, 0.9, "three sigma")
        clearance = 3.0 * self.sigma
        index = int(np.argmin(np.abs(self.curve.clearances - clearance)))
        tried = self._hits_or_warning(clearance) if self.scene.impact_pairs else None
        return ThreeSigma(
            clearance=clearance,
            probability=self.curve.probabilities[index],
            first_hits=self.curve.first_rates[index] * self.mission,
            rice_hits=float(self.curve.crossings.rice_rate[index]) * self.mission,
            hits=None if tried is None else tried.hit_rate * self.mission,
            impact_speed_mean=None if tried is None else tried.impact_speed_mean,
        )

    def _probability_of_stops(self) -> Estimate | None:
        """Probability of any impact with the stops of the scene, where these are unevenly far."""
        distances = distances_of_stops(self.scene)
        if not are_uneven(distances) or min(distances.values()) <= 0.0:
            return None
        try:
            return chance_between(self.scene, distances, self.mission, self._part())
        except (NotConverged, Interrupted) as reason:
            self._short(f"the probability of an impact on the stops of the scene: {reason}")
            return None

    def _required(self) -> pd.DataFrame:
        import pandas as pd

        rows = []
        for chance in SEARCH.required:
            found = self.curve.clearance(chance)
            rows.append(
                {
                    "probability": chance,
                    "clearance": found.value,
                    "clearance_low": found.lower,
                    "clearance_high": found.upper,
                    "clearance_in_sigma": found.value / self.sigma,
                }
            )
        return pd.DataFrame(rows)

    def _exceeding(self) -> pd.DataFrame:
        import pandas as pd

        found = sorted(self.exceeded.items())
        halves = [0.0 if c.upper_95 else c.half_width_95() for _, c in found]
        return pd.DataFrame(
            {
                "clearance": [place for place, _ in found],
                "probability": [math.nan if c.upper_95 else c.value for _, c in found],
                "probability_low": [
                    max(c.value - half, 0.0) for (_, c), half in zip(found, halves, strict=True)
                ],
                "probability_high": [
                    c.upper_95 or min(c.value + half, 1.0)
                    for (_, c), half in zip(found, halves, strict=True)
                ],
            }
        )

    def _simulated(self) -> pd.DataFrame:
        import pandas as pd

        rows: list[dict[str, float | str | None]] = []
        for clearance, tried in sorted(self.hits.tried.items()):
            rate, speed = tried.hit_rate, tried.impact_speed_mean
            half = rate.half_width_95()
            unseen = rate.upper_95 is not None
            rows.append(
                {
                    "clearance": clearance,
                    "clearance_in_sigma": clearance / self.sigma,
                    "hit_rate": rate.value,
                    "hit_rate_low": max(rate.value - half, 0.0),
                    "hit_rate_high": rate.upper_95 if unseen else rate.value + half,
                    "hits_per_first_hit": tried.hits_per_burst,
                    "impact_speed_mean": math.nan if speed is None else speed.value,
                    "by": "simulation" if tried.response else "bursts",
                }
            )
        return pd.DataFrame(rows, columns=list(SIMULATED))

    def _warn(self, clearance: float) -> None:
        """Add the warnings that concern the scene and the impacts at both clearances."""
        scene = self.scene
        if scene.impact_pairs:
            scene = at_clearances(scene, clearance)
        model = model_of(scene)
        if not beyond_one_oscillator(model):
            self.warnings += scene_notes(model)
        if not self.scene.impact_pairs:
            self.warnings.append(
                "the scene has no stops, so the impacts and their speeds are not known"
            )
        there = self.hits.tried.get(clearance)
        impacts = 0.0 if there is None else there.hit_rate.value * self.mission
        if self.target.exceedance is not None and impacts > SEARCH.many:
            self.warnings.append(
                f"the target limits how hard an impact is, not how many there are: {impacts:.3g} "
                "are expected in the mission; give probability for a clearance that avoids them"
            )
        for place in (3.0 * self.sigma, clearance):
            tried = self.hits.tried.get(place)
            if tried and tried.unknown:
                self._short(tried.unknown)
            if not tried or not tried.hits_per_burst:
                continue
            over_rice = tried.hit_rate.value / self.curve.rice_rate(place)
            if tried.hits_per_burst > SEARCH.pumped and over_rice > SEARCH.more_than_rice:
                self.warnings.append(
                    f"stops pump this mount: at {1e3 * place:.4g} mm ({place / self.sigma:.3g} "
                    f"sigma) a first impact leads to {tried.hits_per_burst:.3g} impacts on "
                    f"average, {over_rice:.3g} times what Rice's rate says; the probability of any "
                    "impact is right all the same"
                )


def _excess(found: Estimate, wanted: float) -> tuple[float, float]:
    """Logarithm of a rate over the one that is wanted, and its standard error."""
    if not found.value:
        return -math.inf, 0.0
    return math.log(found.value / wanted), found.standard_error / found.value


def _within(chance: Estimate, accepted: float) -> bool:
    """Whether a probability, or its upper limit where it has one, is at most the accepted one."""
    return (chance.value if chance.upper_95 is None else chance.upper_95) <= accepted


def _more_telling(known: Estimate, found: Estimate | None) -> Estimate:
    """The better of a known probability and one found in another way. The latter may be an upper
    limit that says less, such as 1 without time for a single window."""
    if found is None or found.upper_95 is None:
        return found or known
    most = known.value + known.half_width_95() if known.upper_95 is None else known.upper_95
    return found if found.upper_95 < most else known
