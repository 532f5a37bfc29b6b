"""The clearance that an isolator needs, with a stated risk."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from stochvi.isolators.moved_stops import at_clearances
from stochvi.isolators.record_verdict import RecordVerdict
from stochvi.isolators.screening import Screening
from stochvi.isolators.sizing.chance_at_stops import (
    StopPositions,
    gap_of,
    mean_gaps,
    probability_at,
)
from stochvi.isolators.sizing.changes import Tolerances
from stochvi.mathematics.arrays import Matrix
from stochvi.mathematics.rounding import ROUNDING
from stochvi.mathematics.shown_units import ACCELERATION, LENGTH, RATE, shown_as
from stochvi.model.model import model_of
from stochvi.results.base import Result
from stochvi.results.estimates import Estimate
from stochvi.results.intervals import GAUSSIAN_95
from stochvi.results.response import Response
from stochvi.scenes.between_units import in_toml, moved
from stochvi.scenes.scene import Scene

if TYPE_CHECKING:
    import pandas as pd

    from stochvi.isolators.production_risk.answer import Production


SIDES = ("lower", "upper")
"""Sides of a stop, in the order of the rows of its distances."""

HITS_PER_FIRST_HIT = (
    "impacts per cluster: mean number of impacts that a first one leads to, itself included; only "
    "impacts above the speed threshold count"
)
"""Definition of the column of impacts per cluster, in words."""


@dataclass(frozen=True, kw_only=True)
class Target:
    """Target of a sizing.

    Parameters
    ----------
    name
        "probability" (of any impact in the mission), "rate" (impacts per second), "impact_speed" or
        "peak_acceleration" (not exceeded in the mission but with the probability `exceedance`).
    value, unit
        The limit, in SI units.
    exceedance
        Accepted probability that an impact of the mission exceeds the limit; None for "probability"
        and "rate", of which `value` says all.
    """

    name: str
    value: float
    unit: str
    exceedance: float | None = None

    @property
    def limit(self) -> str:
        """The value with its unit, in words; an acceleration in g as well, unless one is chosen."""
        quantity = shown_as(self.unit)
        both = self.name == "peak_acceleration" and quantity.chosen is None
        return quantity.text(self.value) + (f" ({self.in_g})" if both else "")

    @property
    def in_g(self) -> str:
        """An acceleration in g, or in a chosen unit, in words."""
        return ACCELERATION.text(self.value)

    def kept(self, mission: float) -> str:
        """The target in a mission (s), in words."""
        spoken = spoken_mission(mission)
        if self.name == "probability":
            return f"the probability of any impact in {spoken} at {spoken_percent(self.value)}"
        if self.name == "rate":
            return f"the impacts at {RATE(self.value):.3g} per {RATE.time}"
        assert self.exceedance is not None
        return (
            f"every {self.name.replace('_', ' ')} of {spoken} below {self.limit} but "
            f"for a probability of {spoken_percent(self.exceedance)}"
        )


FINEST_SHARE = 0.05
"""Largest share of a clearance that rounding it up may add."""

COARSEST = 1e-4
"""Largest step to which a clearance is rounded up, m: 0.1 mm, to which gaps are usually made. It is
divided by 10 until it is at most `FINEST_SHARE` of the clearance."""


@dataclass(frozen=True, kw_only=True)
class RoundedClearance:
    """A clearance rounded up to what can be made, and the step, both in m and in mm."""

    value: float
    step: float

    @classmethod
    def of(cls, clearance: float) -> RoundedClearance:
        """The clearance rounded up to 0.1 mm, or finer where it is small.

        >>> found = RoundedClearance.of(3.088e-3)
        >>> round(found.value, 9), found.step
        (0.0031, 0.0001)
        >>> [round(RoundedClearance.of(each).value, 9) for each in (0.31234e-3, 4.9e-3)]
        [0.00032, 0.0049]
        """
        digits = max(math.ceil(-math.log10(FINEST_SHARE * clearance)), -round(math.log10(COARSEST)))
        step = 10.0**-digits
        steps = math.ceil(clearance / step * (1.0 - ROUNDING))
        return cls(value=round(steps * step, digits), step=step)

    def __str__(self) -> str:
        """The clearance with the digits that its step calls for; in other units rounded up.

        >>> str(RoundedClearance(value=4.5e-3, step=1e-4))
        '4.5 mm'
        """
        return LENGTH.rounded_up(self.value, self.step)

    @property
    def step_in_words(self) -> str:
        """The step to which the clearance is rounded up."""
        return LENGTH.step_of(self.step)

    def position(self, equilibrium: float, side: str) -> float:
        """Where a stop at this clearance from the static equilibrium (m) lies, in m from the
        unloaded spring as in a scene file; rounded outwards to a hundredth of the step.

        >>> found = RoundedClearance.of(3.32e-3)
        >>> found.position(0.0, "lower"), found.position(-1.70799e-3, "lower")
        (-0.0034, -0.005108)
        """
        sign = -1.0 if side == "lower" else 1.0
        digits = round(-math.log10(self.step)) + 2
        outwards = sign * (equilibrium + sign * self.value) * 10.0**digits
        return sign * math.ceil(outwards - 1e-6) / 10.0**digits


@dataclass(frozen=True, kw_only=True)
class Clearance:
    """Metres per side from the static equilibrium, and the 95 % interval of the calculation.

    The interval reaches from 0 to the value where a smaller clearance may do as well
    (`Sizing.kept_with`).
    """

    value: float
    lower: float
    upper: float

    def __str__(self) -> str:
        """The clearance and its interval.

        >>> str(Clearance(value=4.9e-3, lower=4.8e-3, upper=5e-3))
        '4.9 mm (4.8 to 5 mm, 95 %)'
        """
        return f"{LENGTH.text(self.value)} ({LENGTH.span(self.lower, self.upper)}, 95 %)"


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class ClearanceAnswer(Result):
    """One clearance for the stops of one oscillator, or of each pair: what such answers have in
    common.

    Parameters
    ----------
    scene
        The scene; its stops are where it states them.
    clearance
        Metres per side from the static equilibrium, with the 95 % interval; that of the widest
        gap, where there are several.
    clearances
        The clearance of each pair by its name.

    See Also
    --------
    stochvi.size : The calculation.
    """

    not_in_document = ("scene",)  # it is in the provenance

    scene: Scene
    clearance: Clearance
    clearances: Mapping[str, Clearance]

    @property
    def made(self) -> RoundedClearance:
        """The clearance to make, rounded up; that of the widest gap, where there are several."""
        return RoundedClearance.of(self.clearance.value)

    @property
    def each_made(self) -> dict[str, RoundedClearance]:
        """The clearance to make of each pair, rounded up."""
        return {name: RoundedClearance.of(c.value) for name, c in self.clearances.items()}

    @property
    def several(self) -> bool:
        """Whether there are several pairs."""
        return len(self.clearances) > 1

    @property
    def of_widest(self) -> str:
        """The name of the widest gap in words, empty where there is one pair."""
        if not self.several:
            return ""
        return f" for {max(self.clearances, key=lambda name: self.clearances[name].value)}"

    @property
    def to_make(self) -> str:
        """The clearances to make in words, with the verb that follows."""
        places = places_in_words(self.each_made) if self.several else str(self.made)
        first = "clearances" if self.several else "clearance"
        keep = "keep" if self.several else "keeps"
        return f"{first}: {places} per side from the static equilibrium {keep}"

    @property
    def hanging(self) -> Scene:
        """The scene in whose static equilibrium the mass hangs."""
        return self.scene

    @property
    def rest(self) -> float:
        """The static equilibrium, m from the unloaded spring."""
        return model_of(self.hanging).rest

    @property
    def rests(self) -> dict[str, float]:
        """Where each gap rests, m from the unloaded springs, by its pair."""
        model = model_of(self.hanging)
        names = [pair.name for pair in model.pairs] or ["stops"]
        return dict(zip(names, mean_gaps(model).tolist(), strict=True))

    @property
    def doubtful(self) -> Mapping[str, RecordVerdict]:
        """The verdicts on records that do not agree with the Gaussian noise of the sizing, by their
        phases."""
        return {}

    def sized(self, clearance: float | None = None) -> Scene:
        """The scene with the stops of the widest gap at a clearance (m), by default the calculated
        one; those of the others are in the same proportions."""
        place = self.clearance.value if clearance is None else clearance
        return self._at([place * c.value / self.clearance.value for c in self.clearances.values()])

    def as_made(self) -> Scene:
        """The scene with its stops at the clearances to make."""
        return self._at([each.value for each in self.each_made.values()])

    def _at(self, clearances: Sequence[float]) -> Scene:
        """The scene with its stops at the clearances of its pairs."""
        if not self.scene.impact_pairs:
            return self.scene
        moved = at_clearances(self.hanging, clearances).impact_pairs
        return self.scene.replace(impact_pairs=moved)

    def stops_to_copy(self) -> str:
        """The stops at the clearance to make, as keys of a scene file; empty without a pair or with
        several, and where a record contradicts the noise for which they hold."""
        if self.doubtful or self.several:
            return ""
        sides = [side for pair in self.scene.impact_pairs for side, _ in pair.stops()]
        return _stops_in_toml(
            self.scene, {side: self.made.position(self.rest, side) for side in sides}
        )

    def verdict(self) -> str:
        """The clearance to make and what it keeps, in one sentence."""
        raise NotImplementedError(f"{type(self).__name__} has no verdict")

    def calculated(self) -> str:
        """The clearance before rounding, and what decides."""
        raise NotImplementedError(f"{type(self).__name__} does not say what decides")

    def summary(self) -> str:
        """The same as `verdict`."""
        return self.verdict()

    def _document(self) -> dict[str, Any]:
        found = super()._document()
        del found["clearance" if self.several else "clearances"]
        made = self.each_made if self.several else self.made
        return {"verdict": self.verdict(), "made": made, **found}


@dataclass(frozen=True, kw_only=True)
class ThreeSigma:
    """Risk and impacts in the mission at the clearance of the rule "three times the linear rms".

    Parameters
    ----------
    clearance
        3 sigma, m per side.
    probability
        Probability of any impact in the mission.
    first_hits
        Expected impact clusters in the mission: the rate of first impacts times the mission.
    rice_hits
        Expected impacts in the mission by Rice, as if impacts changed nothing.
    hits
        Expected impacts in the mission, simulated with the stop law; None without a law.
    impact_speed_mean
        Mean impact speed, m/s, simulated; None without a law.
    """

    clearance: float
    probability: Estimate
    first_hits: Estimate
    rice_hits: float
    hits: Estimate | None
    impact_speed_mean: Estimate | None


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class GaussianSizing(Result):
    """A sizing for Gaussian noise, beside the verdict on the records of the scene: what the
    answers for one pair and for several have in common.

    Parameters
    ----------
    scene
        The scene that was sized, as it was given.
    target, mission
        The target of the sizing, and seconds of exposure.
    curve
        Risk against clearance.
    required
        Clearances for other probabilities of any impact.
    screening
        Linear screening.
    method
        How the clearance was found, in words.
    record
        The verdict on measured records; None without a record.
    allowed
        The tolerances that were asked for, within all of which the clearances to make keep the
        target.
    production
        The risk of the production whose units differ; None without distributions of tolerances.
    fell_short
        Those of the warnings that name an accuracy for which the budget did not suffice.

    See Also
    --------
    stochvi.size : The calculation.
    """

    not_in_document = ("scene",)  # it is in the provenance

    scene: Scene
    target: Target
    mission: float
    curve: pd.DataFrame
    required: pd.DataFrame
    screening: Screening
    method: str
    record: RecordVerdict | None = None
    allowed: Tolerances = field(default_factory=Tolerances)
    production: Production | None = None
    fell_short: tuple[str, ...] = ()

    @property
    def named(self) -> Mapping[str, Clearance]:
        """The calculated clearances by their columns in tables of changed scenes."""
        raise NotImplementedError(f"{type(self).__name__} does not say its clearances")

    @property
    def sized_pairs(self) -> list[int]:
        """Numbers of the pairs that were sized, in the order of `named`; 0 of one mass."""
        raise NotImplementedError(f"{type(self).__name__} does not say what was sized")

    @property
    def stops(self) -> Matrix:
        """(2, pairs): distances of the lower and upper stops from the mean gaps at the calculated
        clearances, m; infinite for none."""
        raise NotImplementedError(f"{type(self).__name__} does not say where its stops are")

    @property
    def any_hit(self) -> float | None:
        """Probability of any impact in the mission there; None where it is not known."""
        raise NotImplementedError(f"{type(self).__name__} has no probability of an impact")

    @property
    def varies(self) -> bool:
        """Whether the clearances to make are for more than the scene as stated."""
        return self.production is not None or self.allowed != Tolerances()

    @property
    def within(self) -> str:
        """The tolerances of the clearances to make, in words; empty without."""
        if self.allowed == Tolerances():
            return ""
        return f" within all tolerances ({self.allowed.in_words()})"

    @property
    def seed(self) -> int:
        """The seed of the simulations."""
        seed = self.provenance.get("seed")
        return seed if isinstance(seed, int) else 0

    @property
    def doubtful(self) -> RecordVerdict | None:
        """The verdict on the record, if it does not agree with the Gaussian noise of the sizing."""
        return None if self.record is None or self.record.agrees else self.record

    def verdict(self) -> str:
        """The clearance to make and the risk that it keeps, in one sentence, after a record that
        does not agree with Gaussian noise."""
        record = self.doubtful
        first = f"{record.sentence()}. For Gaussian noise of its spectrum: " if record else ""
        return first + self._to_make()

    def _to_make(self) -> str:
        """The clearance to make and the risk that it keeps, in words."""
        raise NotImplementedError(f"{type(self).__name__} does not say what to make")

    def summary(self) -> str:
        """The clearance to make and the risk that it keeps, in one sentence: the same as
        `verdict`."""
        return self.verdict()

    def to_frame(self) -> pd.DataFrame:
        """The curve of risk against clearance."""
        return self.curve

    def __repr__(self) -> str:
        return f"<size: {self.verdict()}>"


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Sizing(GaussianSizing):
    """The clearance that keeps a target, and the evidence for it.

    Parameters
    ----------
    scene
        The scene that was sized, as it was given.
    target, mission
        The target of the sizing, and seconds of exposure.
    clearance
        The calculated clearance for the scene as stated, m per side from the static equilibrium;
        `made` is the one to make.
    sigma
        Linear rms displacement without stops, m.
    curve
        One row per clearance, from one run: `clearance` (m), `clearance_in_sigma`, `rice_rate`
        (1/s, both sides), `first_hit_rate`, `first_hit_rate_low`, `first_hit_rate_high` (1/s, the
        limit that the rate of first impacts tends to), `probability`, `probability_low`,
        `probability_high` (of any impact in the mission, 95 % limits).
    three_sigma
        Risk and impacts at the clearance of the rule "three times the linear rms".
    required
        One row per accepted probability of any impact in the mission (10, 1, 0.1 %): `probability`,
        `clearance`, `clearance_low`, `clearance_high` (m), `clearance_in_sigma`.
    simulated
        One row per clearance simulated with the stop law: `clearance` (m), `clearance_in_sigma`,
        `hit_rate`, `hit_rate_low`, `hit_rate_high` (1/s), `impact_speed_mean` (m/s).
    exceeding
        For a target with a limit, one row per clearance that was tried: `clearance` (m), and the
        `probability` that any impact of the mission exceeds the limit, with `probability_low` and
        `probability_high` (95 %; NaN, 0 and the upper limit where hardly any impact did).
    evidence
        Responses simulated with the stop law, by "three_sigma" and "recommended".
    screening
        Linear screening.
    method
        How the clearance was found, in words.
    record
        Whether a measured record that shakes the isolator moves it as Gaussian noise would, and the
        clearance that the record itself needs; None without a record.
    kept_with
        Probability that the limit of the target is exceeded in the mission. Given where the
        clearance is the smallest that can be judged and keeps the target with a margin; else None.
    allowed
        The tolerances that were asked for, within all of which `made` keeps the target.
    probability_of_stops
        Probability of any impact in the mission, with the two stops of the scene unevenly far
        from the static equilibrium; None elsewhere, as `curve` holds it.
    worst_case
        The table of `worst_case`; None without tolerances, or where the calculation ended before.
    production
        The risk of the production whose units differ, and the clearance that it needs, which `made`
        then has; None without distributions of tolerances.
    fell_short
        Those of the warnings that name an accuracy for which the budget did not suffice.

    See Also
    --------
    stochvi.size : The calculation.
    """

    clearance: Clearance
    sigma: float
    three_sigma: ThreeSigma
    simulated: pd.DataFrame
    evidence: Mapping[str, Response]
    kept_with: Estimate | None = None
    exceeding: pd.DataFrame | None = None
    probability_of_stops: Estimate | None = None
    worst_case: pd.DataFrame | None = None

    @property
    def named(self) -> Mapping[str, Clearance]:
        """The calculated clearance."""
        return {"clearance": self.clearance}

    @property
    def sized_pairs(self) -> list[int]:
        """The only pair."""
        return [0]

    @property
    def stops(self) -> Matrix:
        """(2, 1): distances of the stops from the mean gap, m."""
        place = self.clearance.value
        return np.array([[place if side in self.sides else math.inf] for side in SIDES])

    @property
    def any_hit(self) -> float | None:
        """Probability of any impact in the mission at the calculated clearance."""
        return probability_at(self, self.clearance.value)

    @property
    def made(self) -> RoundedClearance | None:
        """The clearance to make: the calculated one or, where tolerances were asked for, the
        largest within them, rounded up; for a production the one that its mean risk needs. None
        where the largest was not found."""
        if self.production is not None:
            return next(iter(self.production.made.values()))
        needed = self.clearance.value
        if self.allowed != Tolerances():
            needed = math.nan
            if self.worst_case is not None:
                needed = float(self.worst_case["clearance"].iloc[-1])
        return RoundedClearance.of(needed) if math.isfinite(needed) else None

    @property
    def gap(self) -> StopPositions:
        """Where the stops lie, and the probability of an impact on the stops of the scene."""
        return gap_of(self)

    def _to_make(self) -> str:
        """The clearance to make and the risk that it keeps, in words."""
        if self.production is not None:
            return self.production.summary()
        made, target, mission, within = self.made, self.target, self.mission, self.within
        if made is None:
            return f"the clearance that keeps the target{within} was not found; raise budget"
        if self.worst_case is not None and self.worst_case["note"].iloc[-1]:
            return (
                f"clearance: {made} from the static equilibrium{within}, which was not shown "
                f"to keep {target.kept(mission)} as accurately as asked for; raise budget"
            )
        if self.kept_with is not None and target.exceedance is not None:
            kept = (
                f"the probability that any {target.name.replace('_', ' ')} of "
                f"{spoken_mission(mission)} exceeds {target.limit} is {self.kept_chance()} there"
            )
            if not self.shown_to_keep:
                return (
                    f"no clearance was shown to keep the target{within}: {made} from the static "
                    f"equilibrium were tried, and {kept}; raise budget"
                )
            return (
                f"clearance: {made} from the static equilibrium{within} is enough, and less may "
                f"be; {kept}"
            )
        sides = "" if len(self.sides) == 1 else "per side "
        return (
            f"clearance: {made} {sides}from the static equilibrium keeps {target.kept(mission)}"
            f"{within}"
        )

    def stops_to_copy(self) -> str:
        """The stops at the clearance to make, as lines of a scene file have them (m from the
        unloaded spring); empty where that is not known or not shown to keep the target, and
        where a record contradicts the noise for which it holds."""
        if self.doubtful or not self.shown_to_keep:
            return ""
        return _stops_in_toml(self.scene, self.gap.recommended)

    @property
    def sides(self) -> tuple[str, ...]:
        """Sides on which a stop is sized: those of the scene, both where it has none yet."""
        pairs = self.scene.impact_pairs
        return tuple(side for side, _ in pairs[0].stops()) if pairs else SIDES

    def calculated(self) -> str:
        """Evidence for the clearance to make: the calculated one for the scene as stated, the
        impacts to expect there, and what three sigma would do to the same quantity."""
        three, hits = self.three_sigma, self.expected_hits()
        place = f"3 sigma = {LENGTH.text(three.clearance)}"
        mission = spoken_mission(self.mission)
        there = [] if hits is None else [f"{hits.value:.3g} impacts expected there in {mission}"]
        if self.target.name == "probability":
            chance = spoken_percent(three.probability.value)
            rule = [f"{place} is hit with a probability of {chance} in {mission}"]
        else:
            rule = [] if three.hits is None else [f"{three.hits.value:.3g} at {place}"]
        joint = "; " if self.target.name == "probability" else ", "
        return "; ".join(filter(None, [self._answer(), joint.join([*there, *rule])]))

    def expected_hits(self) -> Estimate | None:
        """Expected impacts in the mission at the clearance, simulated; None where they are
        unknown."""
        table = self.simulated
        near = table[np.isclose(table["clearance"], self.clearance.value)] if len(table) else table
        if not len(near) or not math.isfinite(near["hit_rate"].iloc[0]):
            return None
        rate, high = near["hit_rate"].iloc[0], near["hit_rate_high"].iloc[0]
        error = (high - rate) / GAUSSIAN_95  # the stated bias is in the limit
        return Estimate(value=self.mission * rate, standard_error=self.mission * error, bias=None)

    def _answer(self) -> str:
        """The calculated clearance with its interval, in words."""
        c = self.clearance
        stated = " as stated" if self.varies else ""
        first = f"calculated{stated}: {LENGTH.text(c.value)}"
        in_sigma = f"{c.value / self.sigma:.3g} sigma"
        if self.kept_with is None:
            interval = f"{LENGTH.span(c.lower, c.upper)}, 95 %"
            return f"{first} ({interval}), {in_sigma}"
        shown = f"a probability of {spoken_percent(self.kept_with.value)}"
        if self.kept_with.upper_95 is not None:
            shown = f"95 % limit of the probability: {spoken_percent(self.kept_with.upper_95)}"
        return f"{first}, {in_sigma}, {shown}"

    def kept_chance(self) -> str:
        """The probability with which the limit of the target may be exceeded at the clearance, in
        words: that which was accepted, below it, or none that is known well enough."""
        accepted = spoken_percent(self.target.exceedance or 0.0)
        if self.kept_with is None:
            return accepted
        return f"below {accepted}" if self.shown_to_keep else "not known well enough"

    @property
    def shown_to_keep(self) -> bool:
        """Whether the target was shown to be kept at the clearance: not where too few samples speak
        for the smallest clearance that can be judged."""
        if self.kept_with is None:
            return True
        most = self.kept_with.upper_95
        most = self.kept_with.value if most is None else most
        return most <= (self.target.exceedance or 0.0)

    def _shown(self) -> pd.DataFrame:
        return self.required

    def _document(self) -> dict[str, Any]:
        found = super()._document()
        return {
            "method": "size",
            "verdict": self.verdict(),
            "made": self.made,
            "clearance_in_sigma": self.clearance.value / self.sigma,
            "gap": self.gap,
            "by": found.pop("method"),
            **found,
        }


def _stops_in_toml(scene: Scene, places: Mapping[str, float]) -> str:
    """Positions of stops for a scene file, with the distributions that the scene states for
    them."""
    stated = dict(scene.impact_pairs[0]) if scene.impact_pairs else {}
    return ", ".join(
        f"{side} = {in_toml(moved(stated.get(side, 0.0), place))}" for side, place in places.items()
    )


def spoken_percent(probability: float) -> str:
    """A probability in per cent, never rounded to 0 or 100.

    >>> spoken_percent(0.01), spoken_percent(2.5e-6), spoken_percent(0.99999999)
    ('1 %', '0.00025 %', 'over 99.9 %')
    """
    if probability > 0.999:
        return "over 99.9 %"
    return f"{100.0 * probability:.3g} %" if probability > 1e-6 else f"{100.0 * probability:.1e} %"


def spoken_mission(seconds: float) -> str:
    """A mission in the unit that reads best.

    >>> spoken_mission(3600.0), spoken_mission(18.0), spoken_mission(5400.0), spoken_mission(7.2e5)
    ('1 h', '18 s', '1.5 h', '200 h')
    """
    for unit, name in ((3600.0, "h"), (60.0, "min")):
        if seconds >= unit:
            return f"{seconds / unit:.4g} {name}"
    return f"{seconds:.4g} s"


MOST_NAMED = 3
"""Most pairs whose clearances a sentence lists; beyond that it names the smallest and the
largest."""


def places_in_words(made: Mapping[str, RoundedClearance]) -> str:
    """The clearances of several pairs; of many pairs the smallest and the largest."""
    if len(made) <= MOST_NAMED:
        return ", ".join(f"{name} {place}" for name, place in made.items())
    low, *_, high = sorted(made, key=lambda name: made[name].value)
    first = f"{len(made)} pairs, each with its own (see the table)"
    return f"{first}, from {low} {made[low]} to {high} {made[high]}"
