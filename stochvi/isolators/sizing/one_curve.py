"""The clearance of one pair, by the curve of risk of its gap.

The probability of any impact needs no impact (`first_crossings`). What an impact leads to needs the
stop law: where first impacts are rare, clusters are simulated from the first impact on (`bursts`),
else everything (`simulate`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from stochvi.isolators.moved_stops import at_clearances
from stochvi.isolators.sizing.answer import (
    NO_PAIR,
    Clearance,
    Target,
    ThreeSigma,
)
from stochvi.isolators.sizing.chance_at_stops import are_uneven, distances_of_stops
from stochvi.isolators.sizing.exceedances import chance_in_windows
from stochvi.isolators.sizing.job import (
    SEARCH,
    Reached,
    SizingJob,
    SizingMethod,
    more_telling,
    within,
)
from stochvi.isolators.sizing.risk_curve import (
    RiskCurve,
    chance_of_stops,
    clearances_of_curve,
)
from stochvi.isolators.sizing.targets import check_laws, widening
from stochvi.mathematics.arrays import Matrix, Vector
from stochvi.model.model import model_of
from stochvi.results.deadline import partial_result
from stochvi.results.errors import Interrupted, NotApplicable, NotConverged
from stochvi.results.estimates import Estimate
from stochvi.sampling.run import Run
from stochvi.scenes.scene import Scene
from stochvi.statistics.bursts import UNFINISHED, bursts, chance_of
from stochvi.statistics.cluster_paths import WINDOWS
from stochvi.statistics.first_crossings import one_gap
from stochvi.statistics.pair_crossings import PairMotion, own_distances

if TYPE_CHECKING:
    import pandas as pd


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


def risk_curve(scene: Scene, target: Target, mission: float, run: Run) -> RiskCurve:
    """The curve of risk of one mass, see `curve_of_gap`."""
    model = model_of(scene)
    sides = [float(stop.side) for stop in model.stops] or SIDES
    motion = PairMotion.under_shocks(one_gap(model))
    return curve_of_gap(motion, target, mission, run, sides=sides)


SAME = 1e-6
"""Relative distance of two clearances below which they are one."""


def curve_of_gap(
    together: PairMotion, target: Target, mission: float, run: Run, *, number: int = 0,
    shift: float = 0.0, sides: Sequence[float] = SIDES,
) -> RiskCurve:  # fmt: skip
    """Probability of an impact against clearance of one of some gaps, alone, from 1 sigma to a
    clearance that is more than the target needs; the stops lie uneven where the static equilibrium
    is shifted, m, and the clearance is that of the nearer one."""
    motion = together.motions[number]
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
    farther = levels + 2.0 * abs(shift)
    places = {-1.0: farther if shift > 0.0 else levels, 1.0: levels if shift >= 0.0 else farther}
    stops = {side: places[side] for side in sides}
    return RiskCurve.of_gap(together, number, stops, mission, run)


class OneCurve(SizingMethod):
    """The method of one pair, or of one mass that has none yet: its place is the clearance, and its
    curve of risk says all of the probability of any impact."""

    def __init__(self, job: SizingJob) -> None:
        self.job, self.scene, self.model = job, job.scene, model_of(job.scene)
        self.target, self.mission = job.target, job.mission
        if job.target.name != "probability":
            check_laws(job.scene, job.target)
        job.stage(0.0, 0.1, "first crossings")
        share = 1.0 - SEARCH.share_of_hits if job.impacts else 1.0
        self.curve = risk_curve(job.scene, job.target, job.mission, job.part(share))
        job.check_crossings(self.curve.crossings)
        self.paths = self.curve.crossings.ages.shape[3]
        self.names = [pair.name for pair in self.model.pairs] or [NO_PAIR]
        self.deviation = self.curve.sigma
        self.sigma = np.array([self.deviation])
        self.three_sigma_place = 3.0 * self.deviation

    def scene_at(self, place: float) -> Scene:
        """The scene with its stops at a clearance."""
        return at_clearances(self.scene, place)

    def first_rate(self, place: float) -> tuple[float, float]:
        """Limiting rate of first impacts, and the time for which a cluster is followed."""
        return self.curve.first_rate(place), WINDOWS * self.curve.crossings.horizon

    def words(self, place: float) -> str:
        """A clearance in words."""
        return f"{1e3 * place:.4g} mm"

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

    def rice_rate(self, place: float) -> float:
        """Rice's rate of both stops."""
        return self.curve.rice_rate(place)

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
        spring = self.model.omega**2
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
                [f"the {target.name} stays below {target.value:g} {target.unit} at any clearance"],
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
            at_clearances(self.scene, place), self.target.name, self.target.value, self.mission,
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
            widening=widening(scene, self.target, self.curve.motion.deviations[1], place),
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

    def required(self) -> pd.DataFrame:
        """A row per accepted probability, with the interval of its clearance."""
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
                    "clearance_in_sigma": found.value / self.deviation,
                }
            )
        return pd.DataFrame(rows)

    def curve_table(self) -> pd.DataFrame:
        """Probabilities against clearance."""
        return self.curve.to_frame()

    def own_fields(self, place: float) -> dict[str, Any]:
        """The probability of an impact on uneven stops."""
        beside = BESIDE[min(len(self.model.sines), 2)]
        return {
            "method": METHODS.get(self.target.name, BY_BURSTS).format(beside=beside),
            "probability_of_stops": self._probability_of_stops(),
        }
