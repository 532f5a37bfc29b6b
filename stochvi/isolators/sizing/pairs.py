"""Sizing of several pairs: the clearances at which all take an equal share of the risk.

Each pair alone has its curve of risk against clearance. Pairs share the risk equally where each
alone would be hit with the same probability p. The probability that any of them is hit follows from
the first outcrossings of all gaps together (`statistics.pair_crossings`). So p is the one number
that is searched for. For a rate of impacts, or a limit of speed or acceleration, the impacts at one
p after the other are simulated with all stops (`statistics.structure_hits`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.interpolate import PchipInterpolator
from scipy.optimize import brentq

from stochvi.isolators.moved_stops import at_clearances
from stochvi.isolators.screening import screened
from stochvi.isolators.sizing.answer import Clearance, Target
from stochvi.isolators.sizing.box_overview import box_overview
from stochvi.isolators.sizing.changes import Tolerances
from stochvi.isolators.sizing.pairs_answer import PairsSizing, Probability
from stochvi.isolators.sizing.question import Question
from stochvi.isolators.sizing.risk_curve import KNOWN, RiskCurve, clearances_of_curve
from stochvi.isolators.sizing.tolerance_region import tolerance_table
from stochvi.mathematics.arrays import Matrix, Vector
from stochvi.model.cautions import scene_notes
from stochvi.model.model import model_of
from stochvi.results.deadline import partial_result
from stochvi.results.errors import Interrupted, NotApplicable, NotConverged
from stochvi.results.estimates import Estimate, provenance
from stochvi.sampling.run import Run
from stochvi.scenes.scene import Scene
from stochvi.statistics.crossing_ages import MISSED, largest_error
from stochvi.statistics.impact_counts import ImpactCounts, count_impacts
from stochvi.statistics.pair_crossings import (
    PairCrossings,
    PairMotion,
    own_distances,
    pressed_pairs,
    same_gaps,
)
from stochvi.statistics.structure_hits import (
    Limit,
    exceedance,
    overlap_of,
    without_stops,
)

if TYPE_CHECKING:
    import pandas as pd


REQUIRED = (0.1, 0.01, 0.001)
"""Probabilities of any impact in the mission whose clearances every answer lists."""

LOWEST_SIGMA = 1.0
"""Smallest clearance of the curve of a pair, in standard deviations."""

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

MOST_ERROR = 1.0
"""Relative error of the probability of an impact above which no clearance is given."""

SMALL_SHARE = 1e3
"""Risk of all pairs over the smallest risk that is looked at of a pair that is sized alone."""

STEEP = 1e-3
"""Smallest slope of the risk of all pairs over the risk of the sized ones, both logarithmic, by
which an error is divided: below it no clearance of the sized pairs changes the risk of all."""

UNSEEN, FARTHEST, MAX_TRIALS = -8.0, 4.0, 12
"""Three numbers of the search by impacts. The first is the logarithm of a rate over the wanted one
that is assumed where no impact was seen. The others are the largest change of the logarithm of the
risk from one place to the next, and the largest number of places."""

FIRST_LOOK = 3.0
"""Relative error of the first look at a risk, as a multiple of the error asked for."""

WIDEST_HALF = 50.0
"""Largest half width of the logarithm of a risk: it holds all risks that are looked at."""

ROUGHEST = 0.9
"""Largest relative error of a look at a risk; a simulation takes none of 1 or more."""

CLOSE = 0.05
"""Logarithm of a rate over the wanted one from which the risk is extrapolated."""

SHARE_OF_LOOK = 0.3
"""Share of the time still left that the impacts at one risk of a search may take."""

METHOD = (
    "first outcrossings of all gaps together, Gaussian and correlated as they are without stops "
    "(records around outcrossings); no impact law enters"
)


BY_HITS = (
    "impacts with all stops: clusters from first impacts on where these are rare, else windows of "
    "the whole motion; the same random numbers at all clearances"
)


def size_pairs(scene: Scene, limit: Limit | None, asked: Question) -> PairsSizing:
    """The clearances that keep a target; `limit` is what an impact must not exceed, None for a
    target without one; see `size`."""
    return _PairsJob(
        scene=scene, target=asked.target, limit=limit, mission=asked.mission, pair=asked.pair,
        run=asked.run, common=asked.common,
        # by linear theory, which knows no stop
        tolerances=(asked.tolerances or Tolerances.of(scene)).felt(scene, by_hits=False),
    ).sizing()  # fmt: skip


@dataclass(kw_only=True)
class _PairsJob:
    """One sizing: its target, run and tolerances, and the findings on the way."""

    scene: Scene
    target: Target
    limit: Limit | None
    mission: float
    pair: str | None
    run: Run
    tolerances: Tolerances
    common: Sequence[str] = ()

    def __post_init__(self) -> None:
        self.deadline, self.rel_error = self.run.deadline, self.run.accuracy
        self.model = model_of(self.scene)
        self.notes = same_gaps(self.model)
        self.short: list[str] = []
        self.names = [each.name for each in self.model.pairs]
        sized = self.names if self.pair is None else [self.pair]
        self.sized = [self.names.index(name) for name in sized]
        self.fixed = [k for k in range(len(self.names)) if k not in self.sized]
        self.own = np.array(own_distances(self.model))
        self.shared = [number for number, name in enumerate(sized) if name in self.common]
        others = np.isin(np.arange(len(self.names)), self.fixed)
        pressed = pressed_pairs(self.model, *np.where(others, self.own, math.inf))
        if pressed:
            raise NotApplicable("size", pressed)
        self.motion = PairMotion(self.model)
        self.sigma, self.speed = self.motion.displacement_std, self.motion.velocity_std
        still = [self.names[k] for k in self.sized if self.sigma[k] == 0.0]
        if still:
            raise NotApplicable(
                "size",
                [
                    "excitation must move the gap of every pair, got none that moves "
                    f"{', '.join(still)}; leave these pairs out of the scene"
                ],
            )

    def sizing(self) -> PairsSizing:
        """The risk of each pair alone, then that of all together, then the clearances."""
        self.curves = [self._curve(number, k) for number, k in enumerate(self.sized)]
        risks = self._risks()
        self._stage(0.4, 0.5, "all pairs together")
        places = [*map(self._stops_of_risk, risks), self._stops(3.0 * self.sigma)]
        together = self._crossings(np.array(places), SHARE_OF_ALL)
        *chances, three_sigma = together.probability(self.mission)
        as_given, fixed = self._as_given()
        total = _Total.of(risks, chances)
        by_hits = self.target.name != "probability"
        overlaps = np.array([overlap_of(together, level) for level in range(len(risks))])
        risk, half = self._by_hits(risks, overlaps) if by_hits else self._found(total, fixed)
        clearances = {
            self.names[k]: Clearance(
                value=self._clearance(number, risk),
                lower=self._clearance(number, min(risk * math.exp(half), risks[-1])),
                upper=self._clearance(number, max(risk * math.exp(-half), risks[0])),
            )
            for number, k in enumerate(self.sized)
        }
        answer = self._stops_of_risk(risk)
        alone = np.empty(len(self.names))
        alone[self.sized] = self._alone(risk)
        alone[self.fixed] = [each.value for each in fixed]
        chance = total.at(risk) if by_hits else total.probability(self.target.value)
        counts = self._hits_at(answer, _at(risks, overlaps, risk))
        table, worst_at = tolerance_table(
            self.scene, self.tolerances, answer, self.sized, min(chance.value, KNOWN),
            min((self.target.exceedance or 1.0) / chance.value, 1.0),
        )  # fmt: skip
        warnings = (*self.notes, *self._warnings(together))
        linear = screened(self.scene)
        return PairsSizing(
            scene=self.scene,
            target=self.target,
            mission=self.mission,
            pair=self.pair,
            common=tuple(self.common),
            clearances=clearances,
            probability=chance,
            expected_hits=None if counts is None else counts.rate * self.mission,
            pairs=self._pairs(
                answer, alone, _between(risks, risk, together.shares(self.mission)), counts
            ),
            curve=self._risk_curve(risks, chances, alone[self.fixed]),
            three_sigma=Probability.of(three_sigma),
            as_given=None if as_given is None else Probability.of(as_given),
            required=self._required(total),
            tolerances=table,
            worst_at=worst_at,
            screening=linear,
            record=linear.record,
            method=BY_HITS if by_hits else METHOD,
            box=box_overview(self.scene, self.mission),
            allowed=self.tolerances,
            warnings=warnings,
            fell_short=tuple(self.short),
            cost=self.run.cost(paths=together.ages.shape[3]),
            provenance=provenance(self.scene.document(), self.run.seed),
        )

    def _stage(self, low: float, high: float, words: str) -> None:
        """Begin a stage of the sizing, in which the fraction done goes from `low` to `high`."""
        self.stage = low, high, words
        self.run.tell(low, words)

    def _part(self, share: float, **changed: Any) -> Run:
        """The run of a calculation of this stage, in a share of the time that is left."""
        return self.run.part(*self.stage, self.deadline.share(share), **changed)

    def _hits_at(self, stops: Matrix, overlap: float) -> ImpactCounts | None:
        """Impacts at the clearances of the answer; None and a note where they are not found."""
        self._stage(0.9, 1.0, "impacts at the clearances found")
        try:
            if self.deadline.passed():
                raise NotConverged("the budget ended", None)
            found = count_impacts(at_clearances(self.scene, stops), overlap, self._part(1.0))
        except (NotApplicable, NotConverged, Interrupted) as reason:
            note = f"the impacts at these clearances are not known: {reason}"
            self.notes.append(note)
            self.short += [] if isinstance(reason, NotApplicable) else [note]
            return None
        if found.short:
            note = (
                "the impacts at these clearances are not known to a relative error of "
                f"{self.rel_error:g}: the budget ended, or hardly any was seen"
            )
            self.notes.append(note)
            self.short.append(note)
        return found

    def _by_hits(self, risks: Vector, overlaps: Vector) -> tuple[float, float]:
        """The risk of each sized pair at which impacts keep the target, and the 95 % half width of
        its logarithm: by secants of the logarithm of their rate over that of the risk."""
        self._check_without_stops()
        low, high = np.log(risks[[0, -1]])
        wanted = self.target.value * self.mission
        if self.target.exceedance is not None:
            wanted = -math.log1p(-self.target.exceedance)
        place = min(max(math.log(wanted / len(self.sized)), low), high)
        known: list[tuple[float, float]] = []
        slope, rough = 1.0, FIRST_LOOK
        for look in range(MAX_TRIALS):
            if look and self.deadline.passed():
                break
            step = 0.4 / MAX_TRIALS
            self._stage(0.5 + step * look, 0.5 + step * (look + 1), f"place {look + 1}")
            risk = math.exp(place)
            found = self._expected(
                risk, _at(risks, overlaps, risk), min(rough * self.rel_error, ROUGHEST)
            )
            excess = math.log(found.value / wanted) if found.value else UNSEEN
            known.append((place, excess))
            error = found.standard_error / found.value if found.value else math.inf
            if (place <= low and excess > CLOSE) or (place >= high and excess < -CLOSE):
                break
            if abs(excess) <= max(CLOSE, error if rough > 1.0 else 0.0):
                if rough == 1.0 or error <= self.rel_error:
                    half = found.half_width_95() / found.value / slope
                    if error > MISSED * self.rel_error:
                        note = (
                            f"the budget ended at a relative error of {error:.3g} of the "
                            f"{'rate' if self.limit is None else 'probability of the limit'}"
                        )
                        self.notes.append(note)
                        self.short.append(note)
                    return math.exp(min(max(place - excess / slope, low), high)), half
                rough = 1.0
            slope = _slope(known, slope)
            place += min(max(-excess / slope, -FARTHEST), FARTHEST)
            place = min(max(place, low), high)
        return self._without_a_place(known, low, high)

    def _check_without_stops(self) -> None:
        """Raise `NotApplicable` if springs and dampers alone exceed the limit of the target."""
        if self.limit is None or self.limit.event != "peak_acceleration":
            return
        alone = without_stops(self.model, self.limit, self.mission)
        if alone >= (self.target.exceedance or 1.0):
            raise NotApplicable(
                "size",
                [f"peak_acceleration of {self.target.limit} is exceeded without any stop, with a "
                 f"probability of {alone:.3g} at least: make the mounts softer, or raise the "
                 "limit"],
            )  # fmt: skip

    def _expected(self, risk: float, overlap: float, rel_error: float) -> Estimate:
        """Impacts, or -ln(1 - P) of an exceedance, of a mission, at one risk per pair."""
        scene = at_clearances(self.scene, self._stops_of_risk(risk))
        part = self._part(SHARE_OF_LOOK, rel_error=rel_error)
        if self.limit is None:
            return count_impacts(scene, overlap, part).rate * self.mission
        assert self.target.exceedance is not None
        rate = -math.log1p(-self.target.exceedance) / self.mission
        chance = exceedance(scene, self.limit, self.mission, overlap, part, rate).chance
        left = max(1.0 - chance.value, 1e-12)
        return replace(chance * (1.0 / left), value=-math.log(left))

    def _without_a_place(
        self, known: list[tuple[float, float]], low: float, high: float
    ) -> tuple[float, float]:
        """The answer of a search that found no place: the smallest clearance, if it keeps the
        target; raises otherwise."""
        place, excess = known[-1]
        sought = f"the clearances for {self.target.name} = {self.target.value:g}"
        if place >= high and excess < -CLOSE:
            self.notes.append(
                "smaller clearances may do as well: these are the smallest that are tried, and "
                "they keep the target with a margin"
            )
            return math.exp(high), 0.0
        if place <= low and excess > CLOSE:
            raise NotApplicable(
                "size",
                [f"no clearance that is tried keeps {self.target.kept(self.mission)}: at the "
                 f"largest ones it is missed by a factor of {math.exp(excess):.3g}; ask for less, "
                 "or move the other stops"],
            )  # fmt: skip
        if self.deadline.passed():
            raise self.deadline.fell_short(
                f"before {sought} were found (places tried: {len(known)})",
                "raise budget or rel_error",
            )
        raise NotConverged(
            f"{sought} were not found in {MAX_TRIALS} places; raise budget or lower rel_error", None
        )

    def _crossings(self, rows: Matrix, share: float) -> PairCrossings:
        """First crossings at rows of distances (levels, sides, pairs), in a share of the time that
        is left."""
        found: PairCrossings = partial_result(
            self.motion.crossings, rows[:, 0], rows[:, 1], self.mission, self._part(share)
        )
        return found

    def _curve(self, number: int, k: int) -> RiskCurve:
        """The probability that a pair is hit, if it alone had stops, against their distance."""
        step = 0.4 / len(self.sized)
        self._stage(step * number, step * (number + 1), self.names[k])
        motion = self.motion.motions[k]
        # rates of one stop of two at which the pair is crossed so often in a mission, or in a cycle
        exposed = 2.0 * max(self.mission, 1.0 / motion.rate(0.0))
        most, least = CLUSTERED * ROOM * float(self._hazards[-1]), 0.1 * self._least_risk
        lowest, highest = (motion.distance_of(each / exposed) for each in (most, least))
        levels = clearances_of_curve(motion, max(lowest, LOWEST_SIGMA * self.sigma[k]), highest)
        rows = np.full((len(levels), *self.own.shape), math.inf)
        for side in np.flatnonzero(np.isfinite(self.own[:, k])):
            rows[:, side, k] = levels
        if number and self.deadline.passed():
            raise self.deadline.fell_short(
                f"after {number} of {len(self.sized)} pairs were looked at alone", "raise budget"
            )
        share = SHARE_OF_CURVES / (len(self.sized) - SHARE_OF_CURVES * number)
        return RiskCurve.of(self._crossings(rows, share).of_one(k), self.mission)

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
            return np.asarray(-np.log1p(-np.sort([*REQUIRED, self.target.value])))
        wanted = self.target.exceedance or -math.expm1(-self.target.value * self.mission)
        least = min(-math.log1p(-min(wanted, 0.5)) / CLUSTERED**0.5, -math.log1p(-min(REQUIRED)))
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

    def _found(self, total: _Total, fixed: list[Estimate]) -> tuple[float, float]:
        """The risk of each sized pair that keeps the target, and the 95 % half width of its
        logarithm."""
        if self.target.value <= total.least:
            others = ", ".join(self.names[k] for k in self.fixed)
            most = max((each.value for each in fixed), default=0.0)
            raise NotApplicable(
                "size",
                [
                    f"no clearance of {self.pair} keeps the probability of any impact at "
                    f"{self.target.value:g}: the other stops ({others}) are hit with a probability "
                    f"of {total.least:.3g} (one of them alone with {most:.3g}); size all pairs "
                    "together, or move the others farther away"
                ],
            )
        return total.risk(self.target.value)

    def _pairs(
        self, answer: Matrix, alone: Vector, shares: Vector, counts: ImpactCounts | None
    ) -> pd.DataFrame:
        import pandas as pd

        rates = {} if counts is None else counts.rates
        speeds = {} if counts is None else counts.speeds

        return pd.DataFrame(
            {
                "pair": self.names,
                "sigma": self.sigma,
                "lower": np.where(np.isfinite(answer[0]), answer[0], math.nan),
                "upper": np.where(np.isfinite(answer[1]), answer[1], math.nan),
                "clearance_in_sigma": answer.min(axis=0)
                / np.where(self.sigma, self.sigma, math.nan),
                "probability_alone": alone,
                "share_of_first_hits": shares,
                "expected_hits": [_value(rates.get(name)) * self.mission for name in self.names],
                "impact_speed_mean": [_value(speeds.get(name)) for name in self.names],
            }
        )

    def _risk_curve(self, risks: Vector, chances: list[Estimate], fixed: Vector) -> pd.DataFrame:
        import pandas as pd

        known = [Probability.of(chance) for chance in chances]
        free = float(np.prod(1.0 - fixed))
        return pd.DataFrame(
            {
                "probability_alone": -np.expm1(-risks),
                **{
                    self.names[k]: [self._clearance(number, risk) for risk in risks]
                    for number, k in enumerate(self.sized)
                },
                "probability": [each.value for each in known],
                "probability_low": [each.lower for each in known],
                "probability_high": [each.upper for each in known],
                "independent": [1.0 - free * np.prod(1.0 - self._alone(risk)) for risk in risks],
            }
        )

    def _required(self, total: _Total) -> pd.DataFrame:
        import pandas as pd

        rows = []
        for chance in REQUIRED:
            known = total.least < chance < total.most
            risk = total.risk(chance)[0] if known else math.nan
            places = {
                self.names[k]: self._clearance(number, risk) if known else math.nan
                for number, k in enumerate(self.sized)
            }
            rows.append({"probability": chance, **places})
        return pd.DataFrame(rows)

    def _warnings(self, together: PairCrossings) -> tuple[str, ...]:
        """Warnings on the accuracy that the budget did not suffice for, and on the excitations."""
        reached = largest_error(together, self.mission)
        if reached > MOST_ERROR:
            raise self.deadline.fell_short(
                f"at a relative error of {reached:.3g} of the probability of an impact: hardly any "
                "first impact was seen",
                "raise budget",
            )
        late = []
        if reached > MISSED * self.rel_error:
            late = [
                f"the budget ended at a relative error of {reached:.3g} of the probability of "
                "an impact"
            ]
        self.short += late
        return (*late, *scene_notes(self.model))


@dataclass(frozen=True)
class _Total:
    """-ln(1 - P) of an impact of any pair against the risk of each, logarithmic, between the risks
    that were looked at (monotone cubic); with the 95 % half widths of the logarithm."""

    risks: Vector
    logs: Vector
    halves: Vector

    @classmethod
    def of(cls, risks: Vector, chances: Sequence[Estimate]) -> _Total:
        """The curve from the probabilities at these risks; probabilities of 0 or 1 are left out, as
        their logarithms are infinite."""
        values = np.array([each.value for each in chances])
        half = np.array([each.half_width_95() for each in chances])
        usable = (values > 0.0) & (values < KNOWN)
        hazard = -np.log1p(-values[usable])
        logs = np.maximum.accumulate(np.log(hazard))
        return cls(np.log(risks[usable]), logs, half[usable] / (np.exp(-hazard) * hazard))

    @property
    def least(self) -> float:
        """The smallest probability that was looked at."""
        return -math.expm1(-math.exp(self.logs[0]))

    @property
    def most(self) -> float:
        """The largest probability that was looked at."""
        return -math.expm1(-math.exp(self.logs[-1]))

    @cached_property
    def _curve(self) -> Callable[[float], float]:
        curve = PchipInterpolator(self.risks, self.logs)
        return lambda place: float(curve(place))

    def risk(self, probability: float) -> tuple[float, float]:
        """Risk of each pair at which the probability of any impact is `probability`, and the 95 %
        half width of its logarithm."""
        wanted = math.log(-math.log1p(-probability))
        if not self.logs[0] <= wanted <= self.logs[-1]:
            raise ValueError(
                f"probability must be in [{self.least:.3g}, {self.most:.3g}], as at the clearances "
                f"that are tried for this mission, got {probability:g}; ask for another "
                "probability or mission"
            )
        low, high = self.risks[[0, -1]]
        place = float(brentq(lambda x: self._curve(x) - wanted, low, high, xtol=1e-12))
        step = 0.01 * (high - low)
        inside = min(max(place, low + step), high - step)
        slope = (self._curve(inside + step) - self._curve(inside - step)) / (2.0 * step)
        half = float(np.interp(place, self.risks, self.halves)) / max(slope, STEEP)
        return math.exp(place), min(half, WIDEST_HALF)

    def at(self, risk: float) -> Probability:
        """The probability of any impact at a risk of each pair; 1 where it cannot be told from
        1."""
        place = math.log(risk)
        if place > self.risks[-1]:
            return Probability(value=1.0, lower=self.most, upper=1.0)
        place = max(place, self.risks[0])
        return self._with_interval(place, self._curve(place))

    def probability(self, value: float) -> Probability:
        """A probability between those looked at, with its interval."""
        return self._with_interval(math.log(self.risk(value)[0]), math.log(-math.log1p(-value)))

    def _with_interval(self, place: float, log: float) -> Probability:
        """The probability of which `log` is ln(-ln(1 - P)), at the logarithm of a risk."""
        hazard = math.exp(log)
        value = -math.expm1(-hazard)
        # next to 1 the half width of the logarithm tends to infinity, that of the probability to 0
        half = float(np.interp(place, self.risks, self.halves)) * math.exp(-hazard) * hazard
        return Probability(value=value, lower=max(value - half, 0.0), upper=min(value + half, 1.0))


def _value(estimate: Estimate | None) -> float:
    """A number, NaN where it is not known, or an upper limit alone."""
    return math.nan if estimate is None or estimate.upper_95 is not None else estimate.value


def _at(risks: Vector, overlaps: Vector, risk: float) -> float:
    """The overlap of clusters at a risk, logarithmic between those at the risks looked at."""
    logs = np.log(np.maximum(overlaps, np.finfo(float).tiny))
    return float(np.exp(np.interp(math.log(risk), np.log(risks), logs)))


def _slope(known: list[tuple[float, float]], before: float) -> float:
    """Slope of the logarithm of a rate over that of the risk, from the last two places."""
    if len(known) < 2:
        return before
    (x0, y0), (x1, y1) = known[-2:]
    return min(max((y1 - y0) / (x1 - x0), 0.25), 4.0) if abs(x1 - x0) > 1e-6 else before


def _between(risks: Vector, risk: float, shares: Matrix) -> Vector:
    """Shares of the first impacts (pairs,) at a risk, from those at the risks looked at."""
    logs = np.log(risks)
    return np.array([np.interp(math.log(risk), logs, column[: len(risks)]) for column in shares.T])
