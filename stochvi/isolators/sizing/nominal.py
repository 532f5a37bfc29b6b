"""The clearances that a scene needs as it is stated, without its tolerances; those of one pair.

The probability of any impact needs no impact (`first_crossings`). What an impact leads to needs the
stop law: where first impacts are rare, clusters are simulated from the first impact on (`bursts`),
else everything (`simulate`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from stochvi.isolators.moved_stops import at_clearances
from stochvi.isolators.sizing.answer import (
    NO_PAIR,
    Clearance,
    Sizing,
    Target,
    ThreeSigma,
)
from stochvi.isolators.sizing.chance_at_stops import are_uneven, distances_of_stops
from stochvi.isolators.sizing.changes import Tolerances
from stochvi.isolators.sizing.exceedances import chance_in_windows
from stochvi.isolators.sizing.job import SEARCH, Reached, SizingJob, more_telling, within
from stochvi.isolators.sizing.pairs import SeveralPairs
from stochvi.isolators.sizing.question import Question
from stochvi.isolators.sizing.risk_curve import (
    RiskCurve,
    chance_of_stops,
    clearances_of_curve,
)
from stochvi.isolators.sizing.targets import check_at, check_laws, widening
from stochvi.mathematics.arrays import Matrix
from stochvi.model.cautions import scene_notes
from stochvi.model.coverage import beyond_one_oscillator, modulated
from stochvi.model.model import Model, model_of
from stochvi.results.deadline import partial_result
from stochvi.results.errors import Interrupted, NotApplicable, NotConverged
from stochvi.results.estimates import Estimate
from stochvi.results.intervals import GAUSSIAN_95
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

SIMULATED = (
    "clearance", "clearance_in_sigma", "hit_rate", "hit_rate_low", "hit_rate_high",
    "hits_per_first_hit", "impact_speed_mean", "by",
)  # fmt: skip
"""Columns of `Sizing.simulated`."""


def has_one_gap(model: Model) -> bool:
    """Whether a model is one mass with one gap, whose curve of risk says all."""
    return model.single


def nominal_sizing(scene: Scene, asked: Question) -> Sizing:
    """The sizing of a scene as it is stated, without the worst case within its tolerances."""
    allowed = asked.tolerances or Tolerances.of(scene)
    try:
        model = model_of(scene)
        if conditions := modulated(model):
            raise NotApplicable("size", conditions)
        check_at(scene, asked.target, asked.at)
        if has_one_gap(model):
            felt = allowed.felt(scene, by_hits=asked.target.name != "probability")
            return OnePair(scene=scene, asked=asked, allowed=felt).sizing()
        # by linear theory, which knows no stop
        felt = allowed.felt(scene, by_hits=False)
        return SeveralPairs(scene=scene, asked=asked, allowed=felt).sizing()
    except NotApplicable as reason:
        # the user called `size`, so that the refusal has its name, whatever function it came from
        raise NotApplicable("size", reason.conditions) from reason


def risk_curve(scene: Scene, target: Target, mission: float, run: Run) -> RiskCurve:
    """The curve of risk of one mass, see `curve_of_gap`."""
    model = model_of(scene)
    sides = [float(stop.side) for stop in model.stops] or SIDES
    motion = PairMotion.under_shocks(one_gap(model))
    return curve_of_gap(motion, target, mission, run, sides=sides)


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
    farther = levels + 2.0 * abs(shift)
    places = {-1.0: farther if shift > 0.0 else levels, 1.0: levels if shift >= 0.0 else farther}
    stops = {side: places[side] for side in sides}
    return RiskCurve.of_gap(together, number, stops, mission, run)


@dataclass(kw_only=True)
class OnePair(SizingJob):
    """The sizing of one pair, or of one mass that has none yet: its place is the clearance, and its
    curve of risk says all of the probability of any impact."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.target.name != "probability":
            check_laws(self.scene, self.target)
        self.stage(0.0, 0.1, "first crossings")
        self.impacts = bool(self.scene.impact_pairs) and self.asked.impacts
        share = 1.0 - SEARCH.share_of_hits if self.impacts else 1.0
        self.curve = risk_curve(self.scene, self.target, self.mission, self.part(share))
        self.sigma = self.curve.crossings.displacement_std
        self.check_crossings(self.curve.crossings)

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

    def answer(self, found: Reached) -> Sizing:
        """The numbers of the answer besides its clearance."""
        clearance = Clearance(value=found.place, lower=max(found.lower, 0.0), upper=found.upper)
        beside = BESIDE[min(len(model_of(self.scene).sines), 2)]
        three = self._three_sigma()
        if self.impacts:
            self.stage(0.9, 1.0, "recommended clearance")
            self.hits_or_warning(clearance.value)
        self._warn(clearance.value)
        stops = self._probability_of_stops()
        pairs = model_of(self.scene).pairs
        name = pairs[0].name if pairs else NO_PAIR
        tried = self.hits.tried.get(clearance.value)
        simulated = self._simulated()
        return Sizing(
            **self.stated(self.curve.crossings.ages.shape[3]),
            clearances={name: clearance},
            pairs=self.pairs_table(
                [name],
                np.array([self.sigma]),
                self._distances(clearance.value),
                [self.curve.probability(clearance.value)],
                [1.0],
                None if tried is None else tried.counts,
            ),
            curve=self.curve.to_frame(),
            three_sigma=three,
            required=self._required(),
            expected_hits=expected_hits(simulated, clearance.value, self.mission),
            simulated=simulated,
            evidence={
                name: response
                for name, at in (("three_sigma", three.clearance), ("recommended", clearance.value))
                if at in self.hits.tried and (response := self.hits.tried[at].counts.response)
            },
            method=METHODS.get(self.target.name, BY_BURSTS).format(beside=beside),
            probability_of_stops=stops,
            exceeding=self._exceeding() if self.target.exceedance is not None else None,
        )

    def _distances(self, clearance: float) -> Matrix:
        """(2, 1): distances of the stops at a clearance, m; infinite for none."""
        sides = [float(stop.side) for stop in model_of(self.scene).stops] or SIDES
        return np.array([[clearance if side in sides else math.inf] for side in SIDES])

    def keeping(self, probability: float) -> Reached:
        """The clearance that keeps a probability of any impact."""
        found = self.curve.clearance(probability)
        return Reached(found.value, found.lower, found.upper)

    def check_free_motion(self, exceedance: float) -> None:
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
        self.warnings += [self.unfinished[place]] if place in self.unfinished else []
        if target.exceedance is None:
            raise NotApplicable(
                "size",
                [f"the {target.name} stays below {target.value:g} {target.unit} at any clearance"],
            )
        chance = chance_of(rate, self.mission)
        if not within(chance, target.exceedance):
            chance = more_telling(chance, self._by_windows(place))
        if not within(chance, target.exceedance):
            chance = more_telling(chance, self.by_splitting(place))
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
            if there is None or self.deadline.passed():
                break
            if within(there, target.exceedance):
                place, chance = closer, there
            elif there.upper_95 is None:
                too_near = closer
            else:
                break
        self.warnings.append(
            f"a clearance below {1e3 * place:.4g} mm may do as well: it was not shown to keep the "
            "target"
        )
        return self.shown_to_keep(chance, Reached(place, 0.0, place))

    @property
    def _closest(self) -> float:
        """The smallest clearance that is tried at all, m."""
        return SEARCH.least_sigma * self.sigma

    def _by_windows(self, place: float) -> Estimate | None:
        """The probability that the limit is exceeded at a clearance, by windows of the whole
        motion."""
        assert self.target.exceedance is not None
        found = chance_in_windows(
            at_clearances(self.scene, place), self.target.name, self.target.value, self.mission,
            accepted=self.target.exceedance, **self.part(SEARCH.share_of_windows).options(),
        )  # fmt: skip
        if found is not None:
            self.exceeded[place] = found
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
            far_from=self.accepted_rate,
            wanted=lambda some: some.exceedance_rate(name, limit),
            widening=widening(scene, self.target, self.curve.crossings.velocity_std, place),
            **run.options(rel_error=run.rel_error),
        )
        if found.unfinished > UNFINISHED:
            self.unfinished[place] = (
                f"clusters of impacts at {self.words(place)} had not ended after "
                f"{found.window:.3g} s: the probability of exceeding {name} is larger than "
                "calculated"
            )
        else:
            self.unfinished.pop(place, None)
        rate = found.exceedance_rate(name, limit)
        self.exceeded[place] = chance_of(rate, self.mission)
        return rate

    def _three_sigma(self) -> ThreeSigma:
        self.stage(0.7, 0.9, "three sigma")
        clearance = 3.0 * self.sigma
        index = int(np.argmin(np.abs(self.curve.clearances - clearance)))
        tried = self.hits_or_warning(clearance) if self.impacts else None
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
        stops = np.array(own_distances(model_of(self.scene)))
        try:
            return chance_of_stops(self.scene, stops, self.mission, self.part())
        except (NotConverged, Interrupted) as reason:
            self.short(f"the probability of an impact on the stops of the scene: {reason}")
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
            rate, speed = tried.counts.rate, tried.speed
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
                    "by": tried.counts.way,
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
        self.warn_of_impacts(self.hits.tried.get(clearance))
        for place in (3.0 * self.sigma, clearance):
            tried = self.hits.tried.get(place)
            if tried and tried.unknown:
                self.short(tried.unknown)
            if not tried or not tried.hits_per_burst:
                continue
            over_rice = tried.counts.rate.value / self.curve.rice_rate(place)
            if tried.hits_per_burst > SEARCH.pumped and over_rice > SEARCH.more_than_rice:
                self.warnings.append(
                    f"stops pump this mount: at {1e3 * place:.4g} mm ({place / self.sigma:.3g} "
                    f"sigma) a first impact leads to {tried.hits_per_burst:.3g} impacts on "
                    f"average, {over_rice:.3g} times what Rice's rate says; the probability of any "
                    "impact is right all the same"
                )


def expected_hits(simulated: pd.DataFrame, clearance: float, mission: float) -> Estimate | None:
    """Expected impacts in the mission at a clearance that was simulated; None where they are
    unknown."""
    near = simulated[np.isclose(simulated["clearance"], clearance)] if len(simulated) else simulated
    if not len(near) or not math.isfinite(near["hit_rate"].iloc[0]):
        return None
    rate, high = near["hit_rate"].iloc[0], near["hit_rate_high"].iloc[0]
    error = (high - rate) / GAUSSIAN_95  # the stated bias is in the limit
    return Estimate(value=mission * rate, standard_error=mission * error, bias=None)
