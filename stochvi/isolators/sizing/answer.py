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
from stochvi.isolators.sizing.box_overview import BoxOverview
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
from stochvi.results.response import Response
from stochvi.scenes.between_units import in_toml, moved
from stochvi.scenes.scene import Scene

if TYPE_CHECKING:
    import pandas as pd

    from stochvi.isolators.production_risk.answer import Production
    from stochvi.scenes.scene import ImpactPair


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
            chance = spoken_percent(self.value)
            return f"the probability of any impact in {spoken} at or below {chance}"
        if self.name == "rate":
            return f"the impacts at or below {RATE(self.value):.3g} per {RATE.time}"
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
    clearances
        By pair, m per side from the static equilibrium, each with the 95 % interval of the
        calculation; under `NO_PAIR` where the scene has no stops yet.
    """

    not_in_document = ("scene",)  # it is in the provenance

    scene: Scene
    clearances: Mapping[str, Clearance]

    @property
    def clearance(self) -> Clearance:
        """The clearance of the only pair; that of the widest gap, where there are several."""
        return max(self.clearances.values(), key=lambda each: each.value)

    @property
    def made(self) -> RoundedClearance | None:
        """The clearance to make, rounded up; that of the widest gap, where there are several.

        None where it was not found or not shown to keep the target. It is also None where a record
        does not agree with the Gaussian noise for which it was found.
        """
        return widest_of(self.each_made)

    @property
    def each_made(self) -> Mapping[str, RoundedClearance]:
        """The clearance to make of each pair, rounded up; empty where `made` is None."""
        return {} if self.doubtful or not self.shown_to_keep else self.rounded

    @property
    def rounded(self) -> Mapping[str, RoundedClearance]:
        """The clearance of each pair for Gaussian noise, rounded up; empty where they were not
        found."""
        return {name: RoundedClearance.of(c.value) for name, c in self.clearances.items()}

    @property
    def several(self) -> bool:
        """Whether there are several pairs."""
        return len(self.clearances) > 1

    @property
    def of_widest(self) -> str:
        """The name of the widest gap in words, empty where there is one pair."""
        return f" for {self.extremes()[1]}" if self.several else ""

    def extremes(self) -> tuple[str, str]:
        """Names of the pairs with the smallest and with the largest clearance."""
        values = {name: each.value for name, each in self.clearances.items()}
        return min(values, key=lambda name: values[name]), max(values, key=lambda n: values[n])

    @property
    def to_make(self) -> str:
        """The clearances to make in words, with the verb that follows."""
        first, keep = ("clearances", "keep") if self.several else ("clearance", "keeps")
        places = self._places() if self.several else str(self.widest)
        sides = "" if not self.several and len(self.sides) == 1 else " per side"
        return f"{first}: {places}{sides} from the static equilibrium{self._beside()} {keep}"

    def _places(self) -> str:
        """The clearances of several pairs to make, in words."""
        return places_in_words(self.rounded)

    def _beside(self) -> str:
        """What stays as it is, in words."""
        return ""

    @property
    def sides(self) -> tuple[str, ...]:
        """Sides on which a stop of the first pair is sized: those of the scene, both where it has
        none yet."""
        pairs = self.scene.impact_pairs
        return tuple(side for side, _ in pairs[0].stops()) if pairs else SIDES

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
        names = [pair.name for pair in model.pairs] or [NO_PAIR]
        return dict(zip(names, mean_gaps(model).tolist(), strict=True))

    @property
    def doubtful(self) -> Mapping[str, RecordVerdict] | RecordVerdict | None:
        """The verdicts on records that do not agree with the Gaussian noise of the sizing."""
        return None

    @property
    def record(self) -> RecordVerdict | None:
        """The verdict on the record that a reader must know first; None without records."""
        return None

    @property
    def shown_to_keep(self) -> bool:
        """Whether the target was shown to be kept at the clearance."""
        return True

    @property
    def widest(self) -> RoundedClearance | None:
        """The clearance of the widest gap for Gaussian noise, rounded up; None where it was not
        found."""
        return widest_of(self.rounded)

    def sized(self, clearance: float | None = None) -> Scene:
        """The scene with the stops of the widest gap at a clearance (m), by default the calculated
        one; those of the others are in the same proportions."""
        place = self.clearance.value if clearance is None else clearance
        return self._at([place * c.value / self.clearance.value for c in self.clearances.values()])

    def as_made(self) -> Scene:
        """The scene with its stops at the clearances to make; as it is where there are none."""
        made, rests = self.each_made, self.rests

        def placed(pair: ImpactPair) -> ImpactPair:
            if pair.name not in made:
                return pair
            stated, own, rest = dict(pair), made[pair.name], rests[pair.name]
            sides = [side for side, _ in pair.stops()]
            places = {side: moved(stated[side], own.position(rest, side)) for side in sides}
            return pair.model_copy(update=places)

        pairs = [placed(pair) for pair in self.scene.expanded.impact_pairs]
        return self.scene.replace(impact_pairs=pairs) if made else self.scene

    def _at(self, clearances: Sequence[float]) -> Scene:
        """The scene with its stops at the clearances of its pairs."""
        if not self.scene.impact_pairs:
            return self.scene
        moved = at_clearances(self.hanging, clearances).impact_pairs
        return self.scene.replace(impact_pairs=moved)

    def stops_to_copy(self) -> str:
        """The stops at the clearance to make, as lines of a scene file have them (m from the
        unloaded spring).

        It is empty with several pairs, and where a record contradicts the noise. It is also empty
        where that clearance is not known, or not shown to keep the target.
        """
        made = self.made
        if self.several or made is None:
            return ""
        return _stops_in_toml(
            self.scene, {side: made.position(self.rest, side) for side in self.sides}
        )

    def _after_record(self) -> str:
        """The verdicts on records that do not agree with the noise of the sizing, in front of what
        was found for that noise; empty without any."""
        found = self.doubtful
        if not found:
            return ""
        if isinstance(found, RecordVerdict):
            return f"{found.sentence()}. For Gaussian noise of its spectrum: "
        judged = ". ".join(f"phase {name}: {each.sentence()}" for name, each in found.items())
        return f"{judged}. For Gaussian noise of their spectra: "

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
        made: object = self.each_made or None
        if not self.several:
            made = self.made
            del found["clearances"]
            found = {"clearance": self.clearance, **found}
        return {"verdict": self.verdict(), "made": made, **found}


NO_PAIR = "stops"
"""Name of the stops to come of a mass that has none yet."""


@dataclass(frozen=True, kw_only=True)
class ThreeSigma:
    """Risk and impacts in the mission at the clearance of the rule "three times the linear rms".

    Parameters
    ----------
    clearance
        3 sigma, m per side; that of the widest gap, where there are several.
    probability
        Probability of any impact in the mission.
    first_hits
        Expected impact clusters in the mission: the rate of first impacts times the mission.
    rice_hits
        Expected impacts in the mission by Rice, as if impacts changed nothing.
    hits
        Expected impacts in the mission, simulated with the stop law; None without a law, and for
        several pairs.
    impact_speed_mean
        Mean impact speed, m/s, simulated; None as `hits` is.
    """

    clearance: float
    probability: Estimate
    first_hits: Estimate
    rice_hits: float
    hits: Estimate | None = None
    impact_speed_mean: Estimate | None = None


@dataclass(frozen=True, kw_only=True)
class Probability:
    """A probability and the 95 % interval of its calculation."""

    value: float
    lower: float
    upper: float

    @classmethod
    def of(cls, estimate: Estimate) -> Probability:
        """A probability with its statistical error and its stated bias."""
        half = estimate.half_width_95()
        value = estimate.value
        return cls(value=value, lower=max(value - half, 0.0), upper=min(value + half, 1.0))


NEARLY_CERTAIN = 0.999
"""Largest probability of any impact from which the number of first impacts is read."""

OF_ONE = ("simulated", "evidence", "exceeding", "probability_of_stops", "worst_case")
OF_SEVERAL = (
    "pair", "common", "probability", "expected_hits", "pairs", "as_given", "tolerances", "box",
    "worst_at",
)  # fmt: skip
"""JSON keys that only a sizing by the curve of one gap has, and that only one of several gaps
has."""


def no_rows() -> pd.DataFrame:
    """An empty table."""
    import pandas as pd

    return pd.DataFrame()


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Sizing(ClearanceAnswer):
    """The clearances that keep a target, and the evidence for them.

    One mass with one pair, or without stops yet, is sized by the curve of risk of its gap. Gaps of
    a structure are sized together. Their evidence differs: what the other way does not have is None
    or empty.

    Parameters
    ----------
    scene
        The scene that was sized, as it was given.
    target, mission
        The target of the sizing, and seconds of exposure.
    clearances
        By sized pair, m per side from the static equilibrium, with the 95 % interval, for the scene
        as stated; `made` and `each_made` are those to make. `clearance` is that of the only pair,
        or of the widest gap.
    pairs
        One row per pair: `pair`; `sigma` (rms of the gap without stops, m); `lower` and `upper`
        (distances of its stops from the mean gap in the answer, m); `clearance_in_sigma` (of the
        nearer one); `probability_alone` (of an impact if this pair alone had stops);
        `share_of_first_hits`; and the `expected_hits` on it in the mission with their
        `impact_speed_mean` (m/s; NaN where unknown).
    curve
        For one mass, a row per clearance, from one run: `clearance` (m), `clearance_in_sigma`,
        `rice_rate` (1/s, both sides), `first_hit_rate`, `first_hit_rate_low`, `first_hit_rate_high`
        (1/s, the limit that the rate of first impacts tends to), `probability`, `probability_low`,
        `probability_high` (of any impact in the mission, 95 % limits).

        For a structure, a row per risk: `probability_alone` of each sized pair; the clearance of
        each sized pair under its name (m); `probability` with its limits; and `independent`, the
        same if impacts of the pairs were independent.
    three_sigma
        Risk and impacts at the clearance of the rule "three times the linear rms".
    required
        One row per accepted probability of any impact in the mission (10, 1, 0.1 %). Columns:
        `probability`; for one mass `clearance`, `clearance_low`, `clearance_high` (m) and
        `clearance_in_sigma`; else the clearance of each sized pair under its name (NaN where none
        keeps it).
    screening
        Linear screening.
    method
        How the clearances were found, in words.
    expected_hits
        Expected impacts in the mission at the calculated clearances, simulated with all stops; None
        where they are unknown.
    record
        Whether measured records move the gaps as Gaussian noise would, and the clearances that they
        need; None without a record.
    allowed
        The tolerances that were asked for, within all of which the clearances to make keep the
        target.
    production
        The risk of the production whose units differ, and the clearances that it needs, which
        `made` then has; None without distributions of tolerances.
    fell_short
        Those of the warnings that name an accuracy for which the budget did not suffice.
    simulated
        A row per place simulated with the stop laws: `clearance` (m; for a structure that of each
        sized pair under its name), `clearance_in_sigma` (of the nearest stop), `hit_rate`,
        `hit_rate_low`, `hit_rate_high` (1/s, of all stops), `hits_per_first_hit`,
        `impact_speed_mean` (m/s; NaN for several pairs), and `by` which simulation.
    evidence
        Responses simulated with the stop laws, by "three_sigma" (of one mass) and "recommended".
    kept_with
        Probability that the limit of the target is exceeded in the mission. Given where the
        clearances are the smallest that can be judged and keep the target with a margin; else None.
    exceeding
        For a target with a limit, a row per place that was tried: its clearances as in `simulated`,
        and the `probability` that any impact of the mission exceeds the limit, with
        `probability_low` and `probability_high` (95 %; NaN, 0 and the upper limit where hardly any
        impact did).
    probability_of_stops
        For one mass, the probability of any impact with the two stops of the scene unevenly far
        from the static equilibrium; None elsewhere, as `curve` holds it.
    worst_case
        For one mass, the table of `worst_case`; None without tolerances, or where the calculation
        ended before.
    pair
        The one pair of several that was sized, the stops of the others fixed as in the scene; None
        where all pairs share the risk equally.
    common
        Pairs that were given one clearance in common: the largest that any of them needs.
    probability
        For a structure, the probability that any pair is hit in the mission at these clearances.
    as_given
        For a structure, the probability of any impact between the stops of the scene; None where a
        mean gap lies beyond a stop.
    tolerances
        For a structure, by linear theory, a row per end of the tolerances. The last row is the
        largest of each column over their whole region, each for itself. Columns: `change`; under
        its name the clearance of each sized pair for the same risk (m, from the nominal mean gap);
        `factor`, the largest of them over the nominal one; and `probability` of any impact at the
        nominal clearances. Without tolerances the first row, "as stated", is the only one.
    box
        Modes of a rigid body, and the clearances of one oscillator along each axis; None for any
        other structure.
    worst_at
        By sized pair of a structure, where within the tolerances its clearance is largest, in
        words.

    See Also
    --------
    stochvi.size : The calculation.
    """

    target: Target
    mission: float
    pairs: pd.DataFrame
    curve: pd.DataFrame
    three_sigma: ThreeSigma
    required: pd.DataFrame
    screening: Screening
    method: str
    expected_hits: Estimate | None = None
    record: RecordVerdict | None = None
    allowed: Tolerances = field(default_factory=Tolerances)
    production: Production | None = None
    fell_short: tuple[str, ...] = ()
    simulated: pd.DataFrame = field(default_factory=no_rows)
    evidence: Mapping[str, Response] = field(default_factory=dict)
    kept_with: Estimate | None = None
    exceeding: pd.DataFrame | None = None
    probability_of_stops: Estimate | None = None
    worst_case: pd.DataFrame | None = None
    pair: str | None = None
    common: tuple[str, ...] = ()
    probability: Probability | None = None
    as_given: Probability | None = None
    tolerances: pd.DataFrame = field(default_factory=no_rows)
    box: BoxOverview | None = None
    worst_at: Mapping[str, str] = field(default_factory=dict)

    @property
    def several(self) -> bool:
        """Whether gaps of a structure were sized together, be it one of several that was asked for;
        else the curve of risk of one gap says all."""
        return "probability_alone" in self.curve

    @property
    def named(self) -> Mapping[str, Clearance]:
        """The calculated clearances by their columns in tables of changed scenes."""
        return self.clearances if self.several else {"clearance": self.clearance}

    @property
    def sigma(self) -> float:
        """Linear rms of the widest sized gap without stops, m."""
        return float(self.pairs["sigma"].iloc[self.sized_pairs].max())

    @property
    def sized_pairs(self) -> list[int]:
        """Numbers of the pairs that were sized, in the order of `clearances`."""
        names = self.pairs["pair"].tolist()
        return [names.index(name) for name in self.clearances]

    @property
    def stops(self) -> Matrix:
        """(2, pairs): distances of the lower and upper stops from the mean gaps at the calculated
        clearances, m; infinite for none."""
        return np.asarray(self.pairs[[*SIDES]].fillna(math.inf).to_numpy().T)

    @property
    def any_hit(self) -> float | None:
        """Probability of any impact in the mission at the calculated clearances; None where it is
        not known."""
        if self.probability is not None:
            return self.probability.value
        return probability_at(self, self.clearance.value)

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

    @property
    def rounded(self) -> Mapping[str, RoundedClearance]:
        """The clearance of each sized pair: the calculated one or, where tolerances were asked for,
        the largest within them, rounded up; for a production the one that its mean risk needs.
        Empty where the largest were not found."""
        if self.production is not None:
            return self.production.made
        needed = {name: each.value for name, each in self.clearances.items()}
        if len(self.tolerances) > 1:
            needed = {name: float(self.tolerances[name].iloc[-1]) for name in needed}
        elif self.allowed != Tolerances() and not self.several:
            worst = self.worst_case
            largest = math.nan if worst is None else float(worst["clearance"].iloc[-1])
            needed = dict.fromkeys(needed, largest)
        return {n: RoundedClearance.of(each) for n, each in needed.items() if math.isfinite(each)}

    @property
    def gap(self) -> StopPositions:
        """Where the stops of one mass lie, and the probability of an impact on those of the
        scene."""
        return gap_of(self)

    def placed(self) -> pd.DataFrame:
        """Where the stops of the sized pairs go, for Gaussian noise: one row per pair.

        `pair`, its `mean_gap` in the static equilibrium, the `clearance` from there, and
        `lower` and `upper` as a scene file has them, from the unloaded mounts; all in m, NaN where
        the scene has no stop.
        """
        import pandas as pd

        rows, rests = [], self.rests
        for pair in self.scene.impact_pairs:
            if (made := self.rounded.get(pair.name)) is not None:
                stated = {side for side, _ in pair.stops()}
                mean = rests[pair.name]
                places = [made.position(mean, s) if s in stated else math.nan for s in SIDES]
                rows.append([pair.name, mean, made.value, *places])
        return pd.DataFrame(rows, columns=["pair", "mean_gap", "clearance", *SIDES])

    def verdict(self) -> str:
        """The clearances to make and the risk that they keep, in one sentence, after a record that
        does not agree with Gaussian noise."""
        return self._after_record() + self._to_make()

    def _to_make(self) -> str:
        """The clearances to make and the risk that they keep, in words."""
        if self.production is not None:
            return self.production.summary()
        made, target, mission, within = self.widest, self.target, self.mission, self.within
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
            places = self._places() if self.several else str(made)
            if not self.shown_to_keep:
                return (
                    f"no clearance was shown to keep the target{within}: {places} from the static "
                    f"equilibrium were tried, and {kept}; raise budget"
                )
            first, are = ("clearances", "are") if self.several else ("clearance", "is")
            return (
                f"{first}: {places} from the static equilibrium{within} {are} enough, and less may "
                f"be; {kept}"
            )
        return f"{self.to_make} {target.kept(mission)}{within}"

    def _places(self) -> str:
        """The clearances, rounded up; one number where all sized pairs have it in common."""
        made = self.rounded
        in_common = (
            set(made) == set(self.common) and len({str(each) for each in made.values()}) == 1
        )
        if in_common and len(made) > 1:
            return f"{next(iter(made.values()))} for all {len(made)} pairs in common,"
        return places_in_words(made)

    def _beside(self) -> str:
        """What stays as it is, in words."""
        return "" if self.pair is None else ", with the other stops as they are,"

    def calculated(self) -> str:
        """Evidence for the clearances to make: those calculated for the scene as stated, the
        impacts to expect there, and what three sigma would do."""
        return self._of_pairs() if self.several else self._of_one_gap()

    def _of_one_gap(self) -> str:
        """That of one mass; three sigma is judged by the quantity of the target."""
        three, hits = self.three_sigma, self.expected_hits
        place = f"3 sigma = {LENGTH.text(three.clearance)}"
        mission = spoken_mission(self.mission)
        expected = f"{self.expected_in_words()} impacts expected there in {mission}"
        there = [] if hits is None else [expected]
        if self.target.name == "probability":
            chance = spoken_percent(three.probability.value)
            rule = [f"{place} is hit with a probability of {chance} in {mission}"]
        else:
            rule = [] if three.hits is None else [f"{three.hits.value:.3g} at {place}"]
        joint = "; " if self.target.name == "probability" else ", "
        return "; ".join(filter(None, [self._answer(), joint.join([*there, *rule])]))

    def _of_pairs(self) -> str:
        """That of several gaps."""
        mission = spoken_mission(self.mission)
        low, high = (self.clearances[name] for name in self.extremes())
        text = f"{self._first_word}: {LENGTH.text(low.value)}"
        text += f" to {LENGTH.text(high.value)}" if high.value > low.value else ""
        if self.expected_hits is not None and self.target.name != "rate":
            text += f", where {self.expected_in_words()} impacts are expected in {mission}"
        return (
            f"{text}; at 3 sigma of every gap any is hit in {mission} with a probability of "
            f"{spoken_percent(self.three_sigma.probability.value)}"
        )

    @property
    def _first_word(self) -> str:
        return "calculated as stated" if self.varies else "calculated"

    def _answer(self) -> str:
        """The calculated clearance with its interval, in words."""
        c = self.clearance
        first = f"{self._first_word}: {LENGTH.text(c.value)}"
        in_sigma = f"{c.value / self.sigma:.3g} sigma"
        if self.kept_with is None:
            interval = f"{LENGTH.span(c.lower, c.upper)}, 95 %"
            return f"{first} ({interval}), {in_sigma}"
        shown = f"a probability of {spoken_percent(self.kept_with.value)}"
        if self.kept_with.upper_95 is not None:
            shown = f"95 % limit of the probability: {spoken_percent(self.kept_with.upper_95)}"
        return f"{first}, {in_sigma}, {shown}"

    def expected_in_words(self) -> str:
        """The number of expected impacts; where too few were seen, the limits that are known: each
        first impact is one."""
        found = self.expected_hits
        if found is None:
            return "an unknown number of"
        if found.upper_95 is None:
            return f"{found.value:.3g}"
        # the number of first impacts, which those that follow add to
        first = -math.log1p(-min(self.any_hit or 0.0, NEARLY_CERTAIN))
        return f"{first:.2g} to {found.upper_95:.2g}"

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

    def to_frame(self) -> pd.DataFrame:
        """The curve of risk against clearance."""
        return self.curve

    def __repr__(self) -> str:
        return f"<size: {self.verdict()}>"

    def _shown(self) -> pd.DataFrame:
        return self.pairs if self.several else self.required

    def _document(self) -> dict[str, Any]:
        found = super()._document()
        for name in OF_ONE if self.several else OF_SEVERAL:
            del found[name]
        own: dict[str, Any] = {"three_sigma": Probability.of(self.three_sigma.probability)}
        if not self.several:
            own = {"clearance_in_sigma": self.clearance.value / self.sigma, "gap": self.gap}
            own |= {"sigma": self.sigma}
        by = found.pop("method")
        if self.production is not None and self.doubtful is not None:
            own["production"] = self.production.to_dict() | {"made": {}}
        return {"method": "size", "by": by, **found, **own}


PairsSizing = Sizing
"""The name that sizings of several pairs had."""


def _stops_in_toml(scene: Scene, places: Mapping[str, float]) -> str:
    """Positions of stops for a scene file, with the distributions that the scene states for
    them."""
    stated = dict(scene.impact_pairs[0]) if scene.impact_pairs else {}
    return ", ".join(
        f"{side} = {in_toml(moved(stated.get(side, 0.0), place))}" for side, place in places.items()
    )


NEAR_ONE = 0.999
"""Probability above which the number that it exceeds is shown: its own digits would all be 9."""


def spoken_percent(probability: float) -> str:
    """A probability in per cent, never rounded to 0 or 100.

    >>> spoken_percent(0.01), spoken_percent(2.5e-6), spoken_percent(0.99999999)
    ('1 %', '0.00025 %', 'over 99.9 %')
    """
    if probability > NEAR_ONE:
        return over_percent(probability)
    return f"{100.0 * probability:.3g} %" if probability > 1e-6 else f"{100.0 * probability:.1e} %"


def over_percent(probability: float) -> str:
    """A probability near 1 by the tenths of a per cent that it exceeds, 99.9 at most.

    >>> over_percent(0.99999999), over_percent(0.99819)
    ('over 99.9 %', 'over 99.8 %')
    """
    return f"over {min(math.floor(1000.0 * probability), 999) / 10.0:g} %"


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


def widest_of(made: Mapping[str, RoundedClearance]) -> RoundedClearance | None:
    """The largest of several clearances; None of none."""
    return max(made.values(), key=lambda each: each.value, default=None)


def places_in_words(made: Mapping[str, RoundedClearance]) -> str:
    """The clearances of several pairs; of many pairs the smallest and the largest."""
    if len(made) <= MOST_NAMED:
        return ", ".join(f"{name} {place}" for name, place in made.items())
    low, *_, high = sorted(made, key=lambda name: made[name].value)
    first = f"{len(made)} pairs, each with its own (see the table)"
    return f"{first}, from {low} {made[low]} to {high} {made[high]}"
