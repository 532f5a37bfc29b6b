"""The clearances that a scene needs as it is stated, without its tolerances. Chapters: one pair, by
the curve of risk of its gap; several pairs at an equal share of the risk; the choice between them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property, partial
from typing import Any

import numpy as np

from stochvi.isolators.sizing.answer import (
    NO_PAIR,
    Clearance,
    Probability,
    Question,
    Sizing,
    Target,
    ThreeSigma,
    are_uneven,
    box_overview,
    distances_of_stops,
)
from stochvi.isolators.sizing.risk_curve import (
    RiskCurve,
    chance_in_windows,
    chance_of_stops,
    clearances_of_curve,
    limit_of_target,
)
from stochvi.isolators.sizing.search import (
    SEARCH,
    Family,
    Reached,
    SizingJob,
    more_telling,
    rate_of,
    within,
)
from stochvi.isolators.tolerances import Tolerances, tolerance_table
from stochvi.mathematics.numerics import Matrix, Vector
from stochvi.mathematics.unsteady_noise import MovingMean
from stochvi.model.coverage import modulated, unshaken
from stochvi.model.model import Model, model_of
from stochvi.results.deadline import partial_result
from stochvi.results.errors import Interrupted, NotApplicable, NotConverged
from stochvi.results.estimates import Estimate
from stochvi.sampling.run import Run
from stochvi.scenes.scene import Scene
from stochvi.statistics.clusters import UNFINISHED, WINDOWS, bursts, chance_of
from stochvi.statistics.crossings import (
    FirstCrossings,
    PairMotion,
    one_gap,
    own_distances,
    pressed_pairs,
    rice_rate,
    same_gaps,
    turn_between,
)
from stochvi.statistics.hardness import Limit, check_place
from stochvi.statistics.hazards import KNOWN, HazardCurve, OutOfReach
from stochvi.statistics.rare_hits import exceedance, widening_of

# ------------------------------------------------------------------------------
# The clearance of one pair, by the curve of risk of its gap.
#
# The probability of any impact needs no impact (`first_crossings`). What an impact leads to needs
# the stop law: where first impacts are rare, clusters are simulated from the first impact on
# (`clusters`), else everything (`simulate`).
# ------------------------------------------------------------------------------


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

SIDES = (-1.0, 1.0)
"""Sides of the stops of a mass that has none yet."""


def curve_of_gap(scene: Scene, target: Target, mission: float, run: Run) -> RiskCurve:
    """The curve of risk of one mass."""
    model = model_of(scene)
    motion = PairMotion.under_shocks(one_gap(model))
    levels = levels_of_gap(motion.motions[0], target, mission)
    stops = {float(stop.side): levels for stop in model.stops} or dict.fromkeys(SIDES, levels)
    return RiskCurve.of_gap(motion, 0, stops, mission, run)


LEAST_OF_LIMIT = 0.1
"""Smallest share of a limit that is taken for that of the stops, beside the spring."""

SAME = 1e-6
"""Relative distance of two clearances below which they are one."""


def levels_of_gap(motion: MovingMean, target: Target, mission: float) -> Vector:
    """Distances of stops from the mean gap, m, at which the risk of a gap alone is looked at: from
    1 sigma to one that is more than the target needs."""
    chances = [*SEARCH.required, target.exceedance or 1.0]
    if target.name == "probability":
        chances.append(target.value)
    # the clearance at which both stops are crossed so seldom in a mission, or in a cycle
    exposed = max(mission, 1.0 / motion.rate(0.0))
    wanted = min(chances) / (20.0 * exposed)
    highest = max(motion.towards(side).distance_of(wanted) for side in (-1.0, 1.0))
    levels = clearances_of_curve(motion, SEARCH.lowest_sigma * motion.deviations[0], highest)
    # the answer tells the risk at three sigma, which is no level beside sines or shocks
    three = 3.0 * motion.deviations[0]
    if np.abs(levels / three - 1.0).min() > SAME:
        levels = np.sort(np.append(levels, three))
    return levels


class OneCurve(Family):
    """The family of one pair, or of one mass that has none yet: its place is the clearance, and its
    curve of risk says all of the probability of any impact."""

    def __init__(self, job: SizingJob) -> None:
        self.job, self.scene, self.model = job, job.scene, model_of(job.scene)
        self.target, self.mission = job.target, job.mission
        if job.target.name != "probability":
            self.limit = limit_of_target(job.scene, job.target, None)
        job.stage(0.0, 0.1, "first crossings")
        share = 1.0 - SEARCH.share_of_hits if job.impacts else 1.0
        self.curve = curve_of_gap(job.scene, job.target, job.mission, job.part(share))
        job.check_crossings(self.curve.crossings)
        self.paths, self.motions = self.curve.crossings.ages.shape[3], [self.curve.motion]
        self.names = [pair.name for pair in self.model.pairs] or [NO_PAIR]
        self.deviation = self.curve.sigma
        self.sigma = np.array([self.deviation])
        self.three_sigma_place = 3.0 * self.deviation

    def first_rate(self, place: float) -> tuple[float, float]:
        """Limiting rate of first impacts, and the time for which a cluster is followed."""
        return self.curve.first_rate(place), WINDOWS * self.curve.crossings.horizon

    def coordinate(self, place: float) -> float:
        """The square of a clearance."""
        return place**2

    def place_at(self, coordinate: float) -> float:
        """The clearance of a square."""
        return math.sqrt(coordinate)

    def slope(self, place: float) -> float:
        """That of Rice's rate."""
        return self.curve.slope(place)

    def steepness(self, place: float) -> float:
        """Slope of the square of the clearance."""
        return 2.0 * place

    def stops(self, place: float) -> Matrix:
        """(2, 1): distances of the stops at a clearance, m; infinite for none."""
        sides = [float(stop.side) for stop in self.model.stops] or SIDES
        return np.array([[place if side in sides else math.inf] for side in SIDES])

    def columns(self, place: float) -> dict[str, float]:
        """The clearance."""
        return {"clearance": place}

    def clearances(self, found: Reached) -> dict[str, Clearance]:
        """The clearance, under the name of its pair."""
        lower = max(found.lower, 0.0)
        return {self.names[0]: Clearance(value=found.place, lower=lower, upper=found.upper)}

    def alone(self, place: float) -> Vector:
        """The probability of the curve."""
        return np.array([self.curve.probability(place)])

    def shares(self, place: float) -> Vector:
        """All of them."""
        return np.ones(1)

    def keeping(self, probability: float) -> Reached:
        """The clearance that keeps a probability of any impact."""
        found = self.curve.clearance(probability)
        return Reached(found.value, found.lower, found.upper)

    def check_free_motion(self, exceedance: float) -> None:
        """Raise `NotApplicable` if the spring of the mount alone exceeds the target."""
        assert self.limit is not None
        alone = self.limit.kind.by_spring(self.model, self.curve.clearance(exceedance).value)
        if self.limit.value <= alone:
            name, unit = self.target.name, self.target.unit
            raise NotApplicable(
                "size",
                f"{name} of {self.target.value:.4g} {unit} is exceeded without any stop: the "
                f"spring alone brings {alone:.4g} {unit} with a probability of {exceedance:g}",
            )

    @property
    def ends(self) -> tuple[float, float]:
        """The smallest clearance that is tried; none is the largest."""
        return self._nearest, math.inf

    @cached_property
    def _nearest(self) -> float:
        """The smallest clearance that is tried, m; for a limit, one at which clusters do not
        overlap yet."""
        if self.target.exceedance is None:
            return self._closest
        clearances = self.curve.clearances
        meet = [math.prod(self.first_rate(c)) > SEARCH.most_overlap for c in clearances]
        return float(clearances[int(np.flatnonzero(meet)[-1]) + 1] if any(meet) else clearances[0])

    def already_kept(self, place: float, rate: Estimate) -> Reached:
        """The answer where even the smallest clearance that is tried keeps the target."""
        target = self.target
        self.job.warnings += [self.job.unfinished[place]] if place in self.job.unfinished else []
        if target.exceedance is None:
            raise NotApplicable(
                "size",
                f"the {target.name} stays below {target.value:g} {target.unit} at any clearance",
            )
        chance = chance_of(rate, self.mission)
        if not within(chance, target.exceedance):
            chance = more_telling(chance, self._by_windows(place))
        if not within(chance, target.exceedance):
            chance = more_telling(chance, self.job.by_splitting(place))
        # closer stops, where impacts come without the pauses that separate one cluster from the
        # next
        too_near = 0.0
        while within(chance, target.exceedance) and place > self._closest:
            closer = max(SEARCH.closer * place, self._closest)
            if too_near:
                closer = math.sqrt(place * too_near)
            if closer > SEARCH.near_enough * place:
                break
            there = self._by_windows(closer)
            if there is None or self.job.deadline.passed():
                break
            if within(there, target.exceedance):
                place, chance = closer, there
            elif there.upper_95 is None:
                too_near = closer
            else:
                break
        self.job.warnings.append(
            f"a clearance below {1e3 * place:.4g} mm may do as well: it was not shown to keep the "
            "target"
        )
        return self.job.shown_to_keep(chance, Reached(place, 0.0, place))

    @property
    def _closest(self) -> float:
        """The smallest clearance that is tried at all, m."""
        return SEARCH.least_sigma * self.deviation

    def _by_windows(self, place: float) -> Estimate | None:
        """The probability that the limit is exceeded at a clearance, by windows of the whole
        motion."""
        assert self.target.exceedance is not None
        found = chance_in_windows(
            self.scene_at(place), self.target.name, self.target.value, self.mission,
            accepted=self.target.exceedance, **self.job.part(SEARCH.share_of_windows).options(),
        )  # fmt: skip
        if found is not None:
            self.job.exceeded[place] = found
        return found

    def first_guess(self, wanted: float) -> float:
        """The first clearance to try: where Rice's rate is the wanted one or, for a limit, a little
        below the clearance at which any impact has the accepted probability."""
        if self.target.exceedance is not None:
            return max(0.9 * self.curve.clearance(self.target.exceedance).value, self._nearest)
        return self.curve.place_of_rice(min(wanted, self.curve.rice_rate(0.0) / 1.2))

    def exceedance_rate(self, place: float, run: Run) -> Estimate:
        """Rate of clusters with an impact beyond the limit of the target."""
        name, limit = self.target.name, self.target.value
        scene = self.scene_at(place)
        found = partial_result(
            bursts,
            scene,
            far_from=self.job.accepted_rate,
            wanted=lambda some: some.exceedance_rate(name, limit),
            widening=widening_of(model_of(scene), self._beside_the_spring(place)),
            **run.options(rel_error=run.rel_error),
        )
        if found.unfinished > UNFINISHED:
            self.job.unfinished[place] = (
                f"clusters of impacts at {self.words(place)} had not ended after "
                f"{found.window:.3g} s: the probability of exceeding {name} is larger than "
                "calculated"
            )
        else:
            self.job.unfinished.pop(place, None)
        rate, accepted = found.exceedance_rate(name, limit), self.job.accepted_rate
        if rate.value < accepted * math.exp(-SEARCH.reach) and not within(
            limited := found.limited(rate), accepted
        ):
            rate = limited  # few clusters do not show that the limit is kept
        self.job.exceeded[place] = chance_of(rate, self.mission)
        return rate

    def _beside_the_spring(self, place: float) -> Limit:
        """What the stops at a clearance bring of the limit."""
        assert self.limit is not None
        left = self.limit.value - self.limit.kind.by_spring(self.model, place)
        return self.limit._replace(value=max(left, LEAST_OF_LIMIT * self.limit.value))

    def three_sigma(self) -> ThreeSigma:
        """Risk at three standard deviations, and simulated impacts."""
        self.job.stage(0.7, 0.9, "three sigma")
        clearance = 3.0 * self.deviation
        index = int(np.argmin(np.abs(self.curve.clearances - clearance)))
        tried = self.job.hits_or_warning(clearance) if self.job.impacts else None
        return ThreeSigma(
            clearance=clearance,
            probability=self.curve.probabilities[index],
            first_hits=self.curve.first_rates[index] * self.mission,
            rice_hits=float(self.curve.crossings.rice_rate[index]) * self.mission,
            hits=None if tried is None else tried.counts.rate * self.mission,
            impact_speed_mean=None if tried is None else tried.speed,
        )

    def _probability_of_stops(self) -> Estimate | None:
        """Probability of any impact with the stops of the scene, where these are unevenly far."""
        distances = distances_of_stops(self.scene)
        if not are_uneven(distances.values()) or min(distances.values()) <= 0.0:
            return None
        stops = np.array(own_distances(self.model))
        try:
            return chance_of_stops(self.scene, stops, self.mission, self.job.part())
        except (NotConverged, Interrupted) as reason:
            self.job.short(f"the probability of an impact on the stops of the scene: {reason}")
            return None

    def required(self) -> Any:
        """A row per accepted probability, with the interval of its clearance."""
        rows = []
        for chance in SEARCH.required:
            found = self.curve.clearance(chance)
            rows.append(
                {
                    "probability": chance,
                    "clearance": found.value,
                    "clearance_low": found.lower,
                    "clearance_high": found.upper,
                    "clearance_in_sigma": found.value / self.deviation,
                }
            )
        return rows

    def curve_table(self) -> Any:
        """Probabilities against clearance."""
        return self.curve.columns()

    def own_fields(self, place: float) -> dict[str, Any]:
        """The probability of an impact on uneven stops."""
        beside = BESIDE[min(len(self.model.sines), 2)]
        return {
            "method": METHODS.get(self.target.name, BY_BURSTS).format(beside=beside),
            "probability_of_stops": self._probability_of_stops(),
        }


# ------------------------------------------------------------------------------
# Sizing of several pairs: the clearances at which all take an equal share of the risk.
#
# Each pair alone has its curve of risk against clearance. Pairs share the risk equally where each
# alone would be hit with the same probability p. The probability that any of them is hit follows
# from the first outcrossings of all gaps together (`crossings.first_crossings`). So p is the one
# number that is searched for. For a rate of impacts, or a limit of the hardest one, the
# impacts at one p after the other are simulated with all stops (`statistics.rare_hits`).
# ------------------------------------------------------------------------------


CLUSTERED = 1e3
"""Largest number of crossings per first impact for which the curve of a pair leaves room."""

RISK_STEP, HITS_STEP = 2.5, 6.0
"""Largest factor from one risk per pair to the next. The first is for a target of the probability
of any impact; the second is for targets that impacts decide, where that probability is only
reported. The probability over the risk changes slowly, and is interpolated between them."""

ROOM = 1.25
"""Factor by which the risks that are tried reach beyond those of possible answers."""

SHARE_OF_CURVES, SHARE_OF_ALL = 0.4, 0.8
"""Share of the budget for the curves of the single pairs, and share of the time that is then left
for all pairs together."""

SMALL_SHARE = 1e3
"""Risk of all pairs over the smallest risk that is looked at of a pair that is sized alone."""

STEEP = 1e-3
"""Smallest slope of the risk of all pairs over the risk of the sized ones, both logarithmic, by
which an error is divided: below it no clearance of the sized pairs changes the risk of all."""

WIDEST_HALF = 50.0
"""Largest half width of the logarithm of a risk: it holds all risks that are looked at."""

METHOD = (
    "first outcrossings of all gaps together, Gaussian and correlated as they are without stops "
    "(records around outcrossings); no impact law enters"
)


BY_ALL_HITS = (
    "impacts with all stops: clusters from first impacts on where these are rare, else windows of "
    "the whole motion; the same random numbers at all clearances"
)


class SharedRisk(Family):
    """The family of the gaps of a structure, or of one of them: their place is -ln of the risk
    -ln(1 - p) that each sized pair has alone."""

    searched = (0.5, 0.9)
    late_hits = False  # those of many coordinates take too long for no time

    def __init__(self, job: SizingJob) -> None:
        self.job, self.scene, self.model = job, job.scene, model_of(job.scene)
        self.target, self.mission = job.target, job.mission
        self.limit = limit_of_target(job.scene, job.target, job.asked.at)
        self.outputs = self.limit.outputs or None if self.limit else None
        self.pair = job.asked.pair
        job.warnings += same_gaps(self.model)
        self.names = [each.name for each in self.model.pairs]
        sized = self.names if self.pair is None else [self.pair]
        self.sized = [self.names.index(name) for name in sized]
        self.fixed = [k for k in range(len(self.names)) if k not in self.sized]
        self.own = np.array(own_distances(self.model))
        self.shared = [number for number, name in enumerate(sized) if name in job.asked.common]
        others = np.isin(np.arange(len(self.names)), self.fixed)
        pressed = pressed_pairs(self.model, *np.where(others, self.own, math.inf))
        if pressed:
            raise NotApplicable("size", pressed)
        self.motion = PairMotion(self.model)
        self.motions = self.motion.motions
        self.sigma, self.speed = self.motion.displacement_std, self.motion.velocity_std
        if still := unshaken({self.names[k]: self.sigma[k] for k in self.sized}):
            raise NotApplicable("size", still)
        self.curves: list[RiskCurve] = []
        for number, k in enumerate(self.sized):
            self.curves.append(self._known_curve(k) or self._curve(number, k))
        self.risks = self._risks()
        job.stage(0.4, 0.5, "all pairs together")
        places = [*map(self._stops_of_risk, self.risks), self._stops(3.0 * self.sigma)]
        self.together = self._crossings(np.array(places), SHARE_OF_ALL)
        self.paths = self.together.ages.shape[3]
        job.check_crossings(self.together)
        *self.chances, self.at_three_sigma = self.together.probability(job.mission)
        self.given, self.alone_of_fixed = self._as_given()
        self.total = HazardCurve.of(-np.log(self.risks[::-1]), self.chances[::-1], self.mission)

    def first_rate(self, place: float) -> tuple[float, float]:
        """Limiting rate of first impacts, logarithmic between the risks looked at, and the time for
        which a cluster is followed."""
        found = math.exp(np.interp(-place, np.log(self.risks), self._first_rates))
        return found, WINDOWS * self.together.horizon

    @cached_property
    def _first_rates(self) -> Vector:
        """Logarithms of the limiting rates of first impacts at the risks looked at."""
        rates = [each.value for each in self.together.first_rate()[: len(self.risks)]]
        return np.asarray(np.log(np.maximum(rates, np.finfo(float).tiny)))

    def keeping(self, probability: float) -> Reached:
        """The place of the risk that keeps a probability of any impact."""
        least, most = self.total.least, self.total.most
        if probability <= least:
            others = ", ".join(self.names[k] for k in self.fixed)
            alone = max((each.value for each in self.alone_of_fixed), default=0.0)
            raise NotApplicable(
                "size",
                f"no clearance of {self.pair} keeps the probability of any impact at "
                f"{probability:g}: the other stops ({others}) are hit with a probability "
                f"of {least:.3g} (one of them alone with {alone:.3g}); size all "
                "pairs together, or move the others farther away",
            )
        if probability > most:
            raise OutOfReach(
                f"probability must be in [{least:.3g}, {most:.3g}], as at the clearances "
                f"that are tried for this mission, got {probability:g}; ask for another "
                "probability or mission"
            )
        place, half = self._place(probability)
        return Reached(place, place - half, place + half)

    def _place(self, probability: float) -> tuple[float, float]:
        """The place with this probability of any impact, and the half width of its interval."""
        low, high = self.total.ends
        step = 0.01 * (high - low)
        place, half = self.total.place(-math.log1p(-probability), step, STEEP)
        return place, min(half, WIDEST_HALF)

    def chance(self, place: float) -> Probability:
        """The probability of any impact at a place; 1 where it cannot be told from 1."""
        nearest, farthest = self.total.ends
        if place < nearest:
            return Probability(value=1.0, lower=self.total.most, upper=1.0)
        found = self.total.hazard(min(place, farthest))
        # next to 1 the half width of the hazard tends to infinity, that of the probability to 0
        value, half = -math.expm1(-found.value), found.half * math.exp(-found.value)
        return Probability(value=value, lower=max(value - half, 0.0), upper=min(value + half, 1.0))

    def first_guess(self, wanted: float) -> float:
        """The place where the pairs together have as many first impacts as are wanted."""
        return self.within_ends(-math.log(wanted * self.mission / len(self.sized)))

    @property
    def ends(self) -> tuple[float, float]:
        """Those of the largest and of the smallest risk that is looked at."""
        return -math.log(self.risks[-1]), -math.log(self.risks[0])

    def exceedance_rate(self, place: float, run: Run) -> Estimate:
        """Rate that the probability of the limit in the mission gives."""
        assert self.limit is not None
        overlap = math.prod(self.first_rate(place))
        chance = partial_result(
            exceedance, self.scene_at(place), self.limit, self.mission, overlap, run,
            self.job.accepted_rate,
        ).chance  # fmt: skip
        self.job.exceeded[place] = chance
        return rate_of(chance, self.mission)

    def already_kept(self, place: float, rate: Estimate) -> Reached:
        """The smallest clearances that are tried."""
        self.job.warnings.append(
            "smaller clearances may do as well: these are the smallest that are tried, and they "
            "keep the target with a margin"
        )
        answer, chance = Reached(place, -math.inf, place), self.job.exceeded.get(place)
        if chance is None or self.target.exceedance is None:
            return answer
        if not within(chance, self.target.exceedance):
            self.exceedance_rate(place, self.job.part(SEARCH.share_of_windows))
            chance = more_telling(chance, self.job.exceeded[place])
        if not within(chance, self.target.exceedance):
            chance = more_telling(chance, self.job.by_splitting(place))
        return self.job.shown_to_keep(chance, answer)

    def within_ends(self, place: float) -> float:
        """The place itself, or that of the nearest risk that is looked at."""
        return min(max(place, self.ends[0]), self.ends[1])

    def stops(self, place: float) -> Matrix:
        """Distances of all stops where each sized pair alone has a risk."""
        return self._stops_of_risk(math.exp(-place))

    def columns(self, place: float) -> dict[str, float]:
        """The clearance of each sized pair under its name, m."""
        risk = math.exp(-place)
        return {self.names[k]: self._clearance(number, risk) for number, k in enumerate(self.sized)}

    def clearances(self, found: Reached) -> dict[str, Clearance]:
        """The clearances of the risk, and of the ends of its interval."""
        middle, low, high = (
            self.columns(self.within_ends(place))
            for place in (found.place, found.lower, found.upper)
        )
        if math.isinf(found.lower):  # nothing is known below the smallest ones that are tried
            low = dict.fromkeys(low, 0.0)
        return {
            name: Clearance(value=value, lower=low[name], upper=high[name])
            for name, value in middle.items()
        }

    def alone(self, place: float) -> Vector:
        """The risk of the place; that of the stops of the scene for pairs that are not sized."""
        found = np.empty(len(self.names))
        found[self.sized], found[self.fixed] = self._alone(math.exp(-place)), self._alone_of_fixed
        return found

    def shares(self, place: float) -> Vector:
        """Those of the first impacts at the risks looked at, interpolated."""
        logs, shares = np.log(self.risks), self.together.shares(self.mission)
        return np.array([np.interp(-place, logs, column[: len(logs)]) for column in shares.T])

    def own_fields(self, place: float) -> dict[str, Any]:
        """The probabilities of all gaps together, and what tolerances change at them."""
        target, by_hits = self.target, self.target.name != "probability"
        chance = self.chance(place)
        if not by_hits:
            chance = replace(chance, value=target.value)
        known = partial(
            tolerance_table, self.scene, stops=self.stops(place), sized=self.sized,
            probability=min(chance.value, KNOWN),
            harm=min((target.exceedance or 1.0) / chance.value, 1.0),
            common=[self.sized[number] for number in self.shared],
            deadline=self.job.deadline.in_no_less_than(SEARCH.least_seconds),
        )  # fmt: skip
        try:
            table, worst_at = known(self.job.allowed)
        except (NotConverged, Interrupted) as reason:
            self.job.short(f"the largest clearances within the tolerances were not found: {reason}")
            table, worst_at = known(Tolerances())
        return {
            "pair": self.pair, "common": tuple(self.job.asked.common), "probability": chance,
            "as_given": None if self.given is None else Probability.of(self.given),
            "tolerances": table, "worst_at": worst_at, "method": BY_ALL_HITS if by_hits else METHOD,
            "box": box_overview(self.scene, self.mission),
        }  # fmt: skip

    def check_free_motion(self, exceedance: float) -> None:
        """Raise `NotApplicable` if springs and dampers alone exceed the limit of the target."""
        if self.limit is None:
            return
        alone = self.limit.kind.without_stops(self.model, self.limit, self.mission)
        if alone >= exceedance:
            raise NotApplicable(
                "size",
                f"{self.target.name} of {self.target.limit} is exceeded without any stop, with a "
                f"probability of {alone:.3g} at least: make the mounts softer, or raise the "
                "limit",
            )

    def _crossings(self, rows: Matrix, share: float) -> FirstCrossings:
        """First crossings at rows of distances (levels, sides, pairs), in a share of the time that
        is left."""
        found: FirstCrossings = partial_result(
            self.motion.crossings, rows[:, 0], rows[:, 1], self.mission, self.job.part(share)
        )
        return found

    def _known_curve(self, k: int) -> RiskCurve | None:
        """The curve of an earlier pair with the same gap, and stops on the same sides; None for
        none."""
        stopped = np.isfinite(self.own)
        for earlier, curve in zip(self.sized, self.curves, strict=False):
            pairs = self.model.pairs
            turn = turn_between(pairs[earlier].direction, pairs[k].direction)
            if turn and np.array_equal(stopped[:, earlier], stopped[::turn, k]):
                return curve
        return None

    def _curve(self, number: int, k: int) -> RiskCurve:
        """The probability that a pair is hit, if it alone had stops, against their distance."""
        step = 0.4 / len(self.sized)
        self.job.stage(step * number, step * (number + 1), self.names[k])
        motion = self.motions[k]
        # rates of one stop of two at which the pair is crossed so often in a mission, or in a cycle
        exposed = 2.0 * max(self.mission, 1.0 / motion.rate(0.0))
        most, least = CLUSTERED * ROOM * float(self._hazards[-1]), 0.1 * self._least_risk
        lowest, highest = (motion.distance_of(each / exposed) for each in (most, least))
        levels = clearances_of_curve(
            motion, max(lowest, SEARCH.lowest_sigma * self.sigma[k]), highest
        )
        stops = {
            side: levels
            for side, own in zip((-1.0, 1.0), self.own[:, k], strict=True)
            if math.isfinite(own)
        }
        if number and self.job.deadline.passed():
            raise self.job.deadline.fell_short(
                f"after {number} of {len(self.sized)} pairs were looked at alone", "raise budget"
            )
        share = SHARE_OF_CURVES / (len(self.sized) - SHARE_OF_CURVES * number)
        return RiskCurve.of_gap(self.motion, k, stops, self.mission, self.job.part(share))

    def _as_given(self) -> tuple[Estimate | None, list[Estimate]]:
        """Probability of an impact between the stops of the scene, None where a mean gap lies
        beyond one; and that of each pair that is not sized, alone."""
        given = bool(np.all(self.own > 0.0))
        rows = [*([self.own] if given else []), *map(self._only, self.fixed)]
        if not rows:
            return None, []
        found = self._crossings(np.array(rows), 1.0).probability(self.mission)
        return (found[0], found[1:]) if given else (None, found)

    @cached_property
    def _hazards(self) -> Vector:
        """-ln(1 - P) of all probabilities whose clearances are wanted, the smallest first. Where
        impacts decide, two numbers of first impacts in the mission: one so small that the target is
        kept even if each leads to many impacts, and the largest that there can be."""
        if self.target.name == "probability":
            return np.asarray(-np.log1p(-np.sort([*SEARCH.required, self.target.value])))
        wanted = self.target.exceedance or -math.expm1(-self.target.value * self.mission)
        least = min(
            -math.log1p(-min(wanted, 0.5)) / CLUSTERED**0.5, -math.log1p(-min(SEARCH.required))
        )
        many = self.mission * float(np.max(self.speed[self.sized] / self.sigma[self.sized]))
        return np.array([least, max(many, 1.0)])

    @property
    def _least_risk(self) -> float:
        """The smallest risk of a pair that is looked at; where one pair alone is sized, its risk
        may have to be much smaller than that of all pairs."""
        share = ROOM * len(self.names) if self.pair is None else SMALL_SHARE
        return float(self._hazards[0]) / share

    def _risks(self) -> Vector:
        """Risks per pair, -ln(1 - p), among which those of all wanted probabilities are."""
        most, step = float(self._hazards[-1]) * ROOM, RISK_STEP
        if self.target.name == "probability":
            most = min(most, *(curve.largest_hazard for curve in self.curves))
        else:
            most, step = min(most, *(curve.most_first_hits for curve in self.curves)), HITS_STEP
        steps = math.ceil(math.log(most / self._least_risk) / math.log(step))
        return np.geomspace(self._least_risk, most, max(steps, 2) + 1)

    def _clearance(self, number: int, risk: float) -> float:
        """The clearance at which a sized pair alone has a risk, m; of pairs with one clearance in
        common, the largest of theirs."""
        shared = self.shared if number in self.shared else [number]
        return max(self.curves[each].place(risk) for each in shared)

    def _alone(self, risk: float) -> Vector:
        """Probability that each sized pair alone is hit, at the clearances of a risk."""
        found = np.full(len(self.sized), -math.expm1(-risk))
        for each in self.shared:
            found[each] = self.curves[each].probability(self._clearance(each, risk))
        return found

    def _stops_of_risk(self, risk: float) -> Matrix:
        """Distances of all stops (2, pairs) where each sized pair alone has this risk."""
        places = np.full(len(self.names), math.inf)
        places[self.sized] = [self._clearance(n, risk) for n in range(len(self.sized))]
        found = self._stops(places)
        found[:, self.fixed] = self.own[:, self.fixed]
        return found

    def _stops(self, places: Vector) -> Matrix:
        """Every stop of the scene (2, pairs), moved to these distances."""
        return np.where(np.isfinite(self.own), places, math.inf)

    def _only(self, k: int) -> Matrix:
        """The stops of one pair alone, at their places in the scene."""
        kept = np.arange(len(self.names)) == k
        return np.where(kept, self.own, math.inf)

    def three_sigma(self) -> ThreeSigma:
        """Risk and impacts where every stop is at three times the rms of its gap."""
        return ThreeSigma(
            clearance=3.0 * float(self.sigma[self.sized].max()),
            probability=self.at_three_sigma,
            first_hits=self.together.first_rate()[-1] * self.mission,
            rice_hits=rice_rate(self.motions, self._stops(3.0 * self.sigma)) * self.mission,
        )

    @property
    def _alone_of_fixed(self) -> Vector:
        """Probability that each pair that is not sized is hit, alone."""
        return np.array([each.value for each in self.alone_of_fixed])

    def curve_table(self) -> Any:
        """Probabilities against the risk of each pair."""
        risks, known = self.risks, [Probability.of(chance) for chance in self.chances]
        free = float(np.prod(1.0 - self._alone_of_fixed))
        places = [self.columns(-math.log(risk)) for risk in risks]
        return {
            "probability_alone": -np.expm1(-risks),
            **{name: [each[name] for each in places] for name in places[0]},
            "probability": [each.value for each in known],
            "probability_low": [each.lower for each in known],
            "probability_high": [each.upper for each in known],
            "independent": [1.0 - free * np.prod(1.0 - self._alone(risk)) for risk in risks],
        }

    def required(self) -> Any:
        """A row per accepted probability."""
        rows, total = [], self.total
        for chance in SEARCH.required:
            known = total.least < chance < total.most
            places = self.columns(self._place(chance)[0] if known else self.ends[1])
            rows.append(
                {"probability": chance, **(places if known else dict.fromkeys(places, math.nan))}
            )
        return rows


# ------------------------------------------------------------------------------
# The clearances that a scene needs as it is stated, without its tolerances.
# ------------------------------------------------------------------------------


def has_one_gap(model: Model) -> bool:
    """Whether a model is one mass with one gap, whose curve of risk says all."""
    return model.single and not model.branches


def check_names(scene: Scene, name: str, given: Sequence[str]) -> None:
    """Raise `ValueError` where an argument names what is no impact pair of a scene."""
    names = [each.name for each in scene.expanded.impact_pairs]
    if not {*given} <= {*names}:
        known = ", ".join(names) or "none"
        raise ValueError(f"{name} must name impact pairs ({known}), got {', '.join(given)}")


def nominal_sizing(scene: Scene, asked: Question) -> Sizing:
    """The sizing of a scene as it is stated, without the worst case within its tolerances."""
    allowed = asked.tolerances or Tolerances.of(scene)
    try:
        model = model_of(scene)
        if conditions := modulated(model, with_branches=True):
            raise NotApplicable("size", conditions)
        check_place(model, asked.at, [asked.target.name])
        alone = has_one_gap(model)
        # linear theory knows no stop
        felt = allowed.felt(scene, by_hits=alone and asked.target.name != "probability")
        by = OneCurve if alone else SharedRisk
        return SizingJob(scene=scene, asked=asked, allowed=felt, by=by).sizing()
    except NotApplicable as reason:
        # the user called `size`, so that the refusal has its name, whatever function it came from
        raise NotApplicable("size", reason.conditions) from reason
