"""`size`: the clearance that an isolator needs, with a stated risk.

The chance of any hit needs no impact (`first_crossings`). What a hit leads to needs the stop law:
where first hits are rare, bursts are simulated from the first hit on (`bursts`), else everything
(`simulate`).
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from stochvi.isolators.screening import Screening, screen
from stochvi.isolators.sizing.answer import Clearance, Sizing, Target, ThreeSigma
from stochvi.isolators.sizing.hits import Hits, Tried, at_clearance, compile_kernels
from stochvi.isolators.sizing.risk_curve import RiskCurve
from stochvi.isolators.sizing.targets import check_laws, target_of, widening
from stochvi.methods.monte_carlo.runs import Progress
from stochvi.model.cautions import scene_notes
from stochvi.model.model import model_of
from stochvi.results.errors import NotApplicable, NotConverged
from stochvi.results.estimates import Cost, Estimate, provenance
from stochvi.results.machine import usable_cores
from stochvi.scenes.scene import Scene
from stochvi.statistics.bursts import FAR, UNFINISHED, bursts
from stochvi.statistics.first_crossings import deviations, first_crossings, largest_error

if TYPE_CHECKING:
    import pandas as pd

LOWEST_SIGMA, SIGMA_STEP = 1.0, 0.25
"""First clearance of the curve, in sigma, and the distance of the next."""

REQUIRED = (0.1, 0.01, 0.001)
"""Chances of any hit in the mission whose clearances are always told."""

ACCEPTED = 0.01
"""Chance that a limit of speed or acceleration is exceeded in the mission, unless told."""

MOST_CLEARANCES = 12
"""Tried for a target that needs impacts."""

LEAST_SIGMA = 0.2
"""The smallest clearance that is tried for a rate, in sigma."""

MOST_OVERLAP = 0.5
"""First hits in the time of a burst up to which bursts are told apart."""

ROUGHLY = 3.0
"""Times the accuracy asked for, until the clearance is nearly found."""

CLOSE = 0.02
"""A rate this near to the one that is wanted, relatively, is extrapolated to it."""

LEAST_SECONDS = 0.3
"""What any calculation gets, even when the budget is over."""

SHARE_OF_HITS = 0.4
"""Of the budget, kept for what hits are like."""

UNKNOWN = 1.0
"""A relative error of the chance of a hit beyond which no clearance can be told."""

NEAR = math.log(FAR)
"""Of a logarithm of a rate over the wanted one: from there the answer is extrapolated at most."""

SHARE_ON_THE_WAY, SHARE_OF_LAST = 4.0, 1.5
"""A clearance that is tried on the way gets this part of the time that is left, and the one that
the answer rests on gets this."""

BY_FIRST_CROSSINGS = (
    "first crossings of the Gaussian response without stops (records around outcrossings); no "
    "impact law enters"
)
BY_HITS = (
    "hits with the stop law: bursts simulated from first hits on where these are rare, else the "
    "whole motion; the same random numbers at every clearance"
)
BY_BURSTS = (
    "bursts of hits simulated with the stop law from first hits on; fast first hits drawn more "
    "often, and weighted"
)

SIMULATED = (
    "clearance", "clearance_in_sigma", "hit_rate", "hit_rate_low", "hit_rate_high",
    "hits_per_first_hit", "impact_speed_mean", "by",
)  # fmt: skip
"""Columns of `Sizing.simulated`."""

PUMPED, MORE_THAN_RICE = 3.0, 1.5
"""Hits that a first hit leads to, and hits over those by Rice, from which a warning is due."""


def size(
    scene: Scene,
    *,
    probability: float | None = None,
    rate: float | None = None,
    impact_speed: float | None = None,
    peak_acceleration: float | None = None,
    exceedance: float = ACCEPTED,
    mission: float = 3600.0,
    rel_error: float = 0.05,
    seed: int = 0,
    threads: int | None = None,
    budget: float = 60.0,
    progress: Progress | None = None,
) -> Sizing:
    """The clearance per side that an isolator needs, for exactly one target.

    Parameters
    ----------
    scene
        One oscillator under stationary Gaussian noise. The laws of its stops are kept, their
        places are not: they go to equal distances from the mean position, static sag counted.
    probability
        Chance of any hit in the mission. Needs no stops.
    rate
        Hits per second on both stops.
    impact_speed, peak_acceleration
        The largest of all hits of the mission (m/s; m/s^2, of the mass, absolute), which is to be
        exceeded with the chance `exceedance` alone. An acceleration needs stops with a stiffness.
    mission
        Seconds of exposure, from a stationary start.
    rel_error
        Relative standard error of the risk (chance, rate) at the clearance.
    budget
        Seconds of wall time; where it ends first, the interval of a probability or of a rate is
        wider, and a warning says so.

    Raises
    ------
    NotApplicable
        If the scene is not covered, or no clearance keeps the target.
    NotConverged
        If the rate at which a speed or an acceleration is exceeded was not known to `rel_error` in
        the budget, or bursts of hits do not end; `response` holds the `Clearance` it got to.

    Examples
    --------
    >>> from stochvi.scenes.excitations import WhiteNoise
    >>> from stochvi.scenes.structures import Isolator
    >>> scene = Scene(
    ...     structure=Isolator(frequency_hz=10.0, zeta=0.05),
    ...     excitations=[WhiteNoise(density=0.01, unit="g2/Hz")],
    ... )
    >>> sizing = size(scene, probability=0.01)
    >>> round(sizing.clearance.value / sizing.sigma, 1)
    5.6
    """
    target = target_of(probability, rate, impact_speed, peak_acceleration, exceedance)
    for name, seconds in (("mission", mission), ("budget", budget)):
        if not 0.0 < seconds < math.inf:
            raise ValueError(f"{name} must be a positive number of seconds, got {seconds}")
    if not 1e-4 <= rel_error < 1.0:
        raise ValueError(f"rel_error must be in [1e-4, 1), got {rel_error}")
    try:
        job = _Job(scene, target, mission, rel_error, seed, threads, budget, progress)
        return job.sizing()
    except NotApplicable as reason:
        # what was asked for is a size, by whatever means
        raise NotApplicable("size", reason.conditions) from reason


def risk_curve(
    scene: Scene,
    target: Target,
    mission: float,
    *,
    rel_error: float = 0.05,
    seed: int = 0,
    threads: int | None = None,
    budget: float | None = 60.0,
) -> RiskCurve:
    """Chance of any hit from 1 sigma on to where it matters for no target."""
    free = scene.model_copy(update={"impact_pairs": ()})
    s_x, s_v = deviations(free)
    chances = [*REQUIRED, target.exceedance or 1.0]
    if target.name == "probability":
        chances.append(target.value)
    crossings = s_v / s_x / math.pi * max(mission, 2.0 * math.pi * s_x / s_v)
    highest = math.sqrt(2.0 * math.log(10.0 * crossings / min(chances)))
    levels = s_x * np.arange(LOWEST_SIGMA, highest + 2.0 * SIGMA_STEP, SIGMA_STEP)
    pair = scene.impact_pairs[0] if scene.impact_pairs else None
    one_sided = pair is not None and (pair.lower is None or pair.upper is None)
    found = first_crossings(
        free,
        None if one_sided else levels,
        upper=levels if one_sided else None,
        mission=mission,
        rel_error=rel_error,
        seed=seed,
        threads=threads,
        budget=budget,
    )
    return RiskCurve.of(found, mission)


class _Job:
    """One sizing: what was asked for, and what was found on the way."""

    def __init__(
        self,
        scene: Scene,
        target: Target,
        mission: float,
        rel_error: float,
        seed: int,
        threads: int | None,
        budget: float,
        progress: Progress | None,
    ) -> None:
        self.scene, self.target, self.mission = scene, target, mission
        self.rel_error, self.seed, self.threads = rel_error, seed, threads
        self.report = progress or (lambda done, text: None)
        self.budget = budget
        self.warnings: list[str] = []
        self.unfinished: dict[float, str] = {}
        self.kept_with: Estimate | None = None
        if target.name != "probability":
            check_laws(scene, target)
        compile_kernels(scene)
        self.started = time.perf_counter()
        self.report(0.0, "first crossings")
        self.curve = risk_curve(
            scene,
            target,
            mission,
            rel_error=rel_error,
            seed=seed,
            threads=threads,
            budget=budget * (1.0 - SHARE_OF_HITS if scene.impact_pairs else 1.0),
        )
        self.sigma = self.curve.crossings.displacement_std
        reached = largest_error(self.curve.crossings, mission)
        if reached > UNKNOWN:
            raise NotConverged(
                f"the budget of {budget:g} s ended at a relative error of {reached:.2g} of the "
                "chance of a hit: hardly any first hit was seen; raise budget"
            )
        if reached > rel_error:
            self.warnings.append(
                f"the budget ended at a relative error of {reached:.2g} of the chance of a hit"
            )
        self.hits = Hits(
            scene=scene,
            curve=self.curve,
            rel_error=rel_error,
            seed=seed,
            threads=threads,
            left=lambda: self.left,
        )

    @property
    def left(self) -> float:
        """Seconds of the budget that are left, at least some to come to an end."""
        return max(self.budget - (time.perf_counter() - self.started), LEAST_SECONDS)

    def sizing(self) -> Sizing:
        """Find the clearance, then what stands beside it."""
        if self.target.name == "probability":
            clearance, method = self.curve.clearance(self.target.value), BY_FIRST_CROSSINGS
        elif self.target.name == "rate":
            clearance, method = self._search(self._hit_rate, self.target.value), BY_HITS
        else:
            assert self.target.exceedance is not None
            self._check_free_motion(self.target.exceedance)
            wanted = -math.log1p(-self.target.exceedance) / self.mission
            clearance, method = self._search(self._exceedance_rate, wanted), BY_BURSTS
        three = self._three_sigma()
        if self.scene.impact_pairs:
            self.report(0.9, "recommended clearance")
            self._hits_beside(clearance.value)
        self._warn(clearance.value)
        crossings = self.curve.crossings
        return Sizing(
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
            screening=_screening(self.scene),
            method=method,
            kept_with=self.kept_with,
            warnings=tuple(dict.fromkeys(self.warnings)),
            cost=Cost(
                wall_time=time.perf_counter() - self.started,
                paths=crossings.ages.shape[3],
                threads=self.threads or usable_cores(),
            ),
            provenance=provenance(self.scene.document(), self.seed),
        )

    def _check_free_motion(self, exceedance: float) -> None:
        """Refuse an acceleration that the mount's own spring brings about, stops or not."""
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
                    f"chance of {exceedance:g}"
                ],
            )

    def _search(self, risk: Callable[[float, float], Estimate], wanted: float) -> Clearance:
        """Where a rate that falls with the clearance is as wanted: first roughly, then once more.

        Its logarithm is followed in the square of the clearance, by the slope of Rice's rate until
        two tries have the root between them.
        """
        place = self._first_guess(wanted)
        above: tuple[float, float] | None = None
        below: tuple[float, float] | None = None
        slope = -1.0 / (2.0 * self.sigma**2)
        for attempt in range(MOST_CLEARANCES):
            self.report(0.1 + 0.05 * attempt, f"{1e3 * place:.4g} mm")
            roughly = risk(place, ROUGHLY * self.rel_error)
            excess, tolerance = _excess(roughly, wanted)
            if abs(excess) <= max(tolerance, CLOSE):
                found = risk(place, self.rel_error)
                excess, _ = _excess(found, wanted)
                if abs(excess) <= NEAR:
                    return self._answer(place, found, excess, slope)
            point = (place**2, excess)
            above, below = (point, below) if excess > 0.0 else (above, point)
            if above and below and above[0] < below[0] and math.isfinite(below[1]):
                slope = (below[1] - above[1]) / (below[0] - above[0])
            if excess < 0.0 and place <= self._least * (1.0 + CLOSE):
                return self._already_kept(place, roughly)
            place = math.sqrt(self._next(above, below, point))
        raise NotConverged(
            f"no clearance was found in {MOST_CLEARANCES} tries for {self.target.name} = "
            f"{self.target.value:g}; raise budget or rel_error"
        )

    def _answer(self, place: float, found: Estimate, excess: float, slope: float) -> Clearance:
        """From a place next to it; refused where what is known there does not carry an answer.

        A rate of hits is a mean, and a standard error that is larger than asked for widens the
        interval. A rate of exceedances may rest on so few bursts that its standard error is too
        small as well: then there is no interval to tell.
        """
        per_metre = 2.0 * place * slope
        half = found.half_width_95(with_bias=True) / found.value / abs(per_metre)
        value = place - excess / per_metre
        answer = Clearance(value=value, lower=max(value - half, 0.0), upper=value + half)
        if place in self.unfinished:
            raise NotConverged(
                f"{self.unfinished[place]}; size for a probability or a rate of hits instead",
                answer,
            )
        error = found.standard_error / found.value
        if error <= self.rel_error:
            return answer
        beyond = "" if self.target.exceedance is None else " beyond the limit"
        reached = (
            f"the budget ended at a relative error of {error:.2g} of the rate of hits{beyond} at "
            f"{1e3 * place:.4g} mm"
        )
        if self.target.exceedance is not None:
            raise NotConverged(
                f"{reached}; {self.rel_error:g} was asked for: raise budget or rel_error", answer
            )
        self.warnings.append(reached)
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
        step = 2.0 * self.sigma**2 * max(min(last[1], 8.0), -8.0)
        return max(last[0] + step, self._least**2)

    @cached_property
    def _least(self) -> float:
        """The smallest clearance that is tried: where bursts are needed, they must not meet."""
        if self.target.exceedance is None:
            return LEAST_SIGMA * self.sigma
        clearances = self.curve.clearances
        meet = [self.curve.first_rate(c) * self.hits.window > MOST_OVERLAP for c in clearances]
        return float(clearances[int(np.flatnonzero(meet)[-1]) + 1] if any(meet) else clearances[0])

    def _already_kept(self, place: float, rate: Estimate) -> Clearance:
        """Where the smallest clearance that is tried keeps the target with a margin."""
        target = self.target
        self.warnings += [self.unfinished[place]] if place in self.unfinished else []
        if target.exceedance is None:
            raise NotApplicable(
                "size",
                [f"the {target.name} stays below {target.value:g} {target.unit} at any clearance"],
            )
        self.warnings.append(
            f"a clearance below {1e3 * place:.4g} mm may do as well: there hits come without the "
            "pauses by which bursts are told apart, and no chance can be calculated"
        )
        self.kept_with = _chance(rate, self.mission)
        if self.kept_with.upper_95 is not None:
            self.warnings.append(
                f"{self.kept_with.how} exceeds the limit at {1e3 * place:.4g} mm, though fast "
                "first hits were drawn more often; their number alone says, at 95 %, that the "
                f"chance is below {100.0 * self.kept_with.upper_95:.2g} %"
            )
        return Clearance(value=place, lower=0.0, upper=place)

    def _first_guess(self, wanted: float) -> float:
        """By Rice's rate; for a limit on hits, from where hits are as rare as it is to be."""
        if self.target.exceedance is not None:
            return max(0.9 * self.curve.clearance(self.target.exceedance).value, self._least)
        crossings = self.curve.crossings
        zero = crossings.rice_rate[0] * math.exp(0.5 * (self.curve.clearances[0] / self.sigma) ** 2)
        return self.sigma * math.sqrt(2.0 * math.log(max(zero / wanted, 1.2)))

    def _hit_rate(self, clearance: float, rel_error: float) -> Estimate:
        return self.hits.at(clearance, rel_error).hit_rate

    def _exceedance_rate(self, clearance: float, rel_error: float) -> Estimate:
        """Rate of bursts with a hit beyond the limit of the target."""
        name, limit = self.target.name, self.target.value
        scene = at_clearance(self.scene, clearance)
        assert self.target.exceedance is not None
        found = bursts(
            scene,
            rel_error=rel_error,
            far_from=-math.log1p(-self.target.exceedance) / self.mission,
            wanted=lambda some: some.exceedance_rate(name, limit),
            widening=widening(scene, self.target, self.curve.crossings.velocity_std, clearance),
            seed=self.seed,
            threads=self.threads,
            budget=self.left / (SHARE_ON_THE_WAY if rel_error > self.rel_error else SHARE_OF_LAST),
        )
        if found.unfinished > UNFINISHED:
            self.unfinished[clearance] = (
                f"bursts of hits at {1e3 * clearance:.4g} mm had not ended after "
                f"{found.window:.3g} s: the chance of exceeding {name} is larger than calculated"
            )
        else:
            self.unfinished.pop(clearance, None)
        return found.exceedance_rate(name, limit)

    def _hits_beside(self, clearance: float) -> Tried | None:
        """Hits that the answer does not rest on: None, and a warning, where they are not found."""
        try:
            return self.hits.at(clearance)
        except (NotApplicable, NotConverged) as reason:
            self.warnings.append(
                f"what hits are like at {1e3 * clearance:.4g} mm is not known: {reason}"
            )
            return None

    def _three_sigma(self) -> ThreeSigma:
        self.report(0.7, "three sigma")
        clearance = 3.0 * self.sigma
        index = int(np.argmin(np.abs(self.curve.clearances - clearance)))
        tried = self._hits_beside(clearance) if self.scene.impact_pairs else None
        return ThreeSigma(
            clearance=clearance,
            probability=self.curve.probabilities[index],
            first_hits=self.curve.first_rates[index] * self.mission,
            rice_hits=float(self.curve.crossings.rice_rate[index]) * self.mission,
            hits=None if tried is None else tried.hit_rate * self.mission,
            impact_speed_mean=None if tried is None else tried.impact_speed_mean,
        )

    def _required(self) -> pd.DataFrame:
        import pandas as pd

        rows = []
        for chance in REQUIRED:
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

    def _simulated(self) -> pd.DataFrame:
        import pandas as pd

        rows: list[dict[str, float | str | None]] = []
        for clearance, tried in sorted(self.hits.tried.items()):
            rate, speed = tried.hit_rate, tried.impact_speed_mean
            half = rate.half_width_95(with_bias=True)
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
        """What a reader must know before believing the numbers."""
        scene = self.scene
        if scene.impact_pairs:
            scene = at_clearance(scene, clearance)
        if not scene.beyond_one_oscillator():
            self.warnings += scene_notes(model_of(scene))
        if not self.scene.impact_pairs:
            self.warnings.append("the scene has no stops, so what a hit leads to is not known")
        for place in (3.0 * self.sigma, clearance):
            tried = self.hits.tried.get(place)
            self.warnings += [tried.unknown] if tried and tried.unknown else []
            if not tried or not tried.hits_per_burst:
                continue
            over_rice = tried.hit_rate.value / self.curve.rice_rate(place)
            if tried.hits_per_burst > PUMPED and over_rice > MORE_THAN_RICE:
                self.warnings.append(
                    f"stops pump this mount: at {1e3 * place:.4g} mm ({place / self.sigma:.3g} "
                    f"sigma) a first hit leads to {tried.hits_per_burst:.3g} hits on average, "
                    f"{over_rice:.3g} times what Rice's rate says; the chance of any hit is right "
                    "all the same"
                )


def _excess(found: Estimate, wanted: float) -> tuple[float, float]:
    """Logarithm of a rate over the one that is wanted, and its standard error."""
    if not found.value:
        return -math.inf, 0.0
    return math.log(found.value / wanted), found.standard_error / found.value


def _chance(rate: Estimate, mission: float) -> Estimate:
    """That something of this rate happens in a mission, 1 - exp(-rate mission)."""
    value = -math.expm1(-rate.value * mission)
    upper = None if rate.upper_95 is None else -math.expm1(-rate.upper_95 * mission)
    return replace(rate * (mission * (1.0 - value)), value=value, upper_95=upper)


def _screening(scene: Scene) -> Screening | None:
    try:
        return screen(scene)
    except NotApplicable:
        return None
