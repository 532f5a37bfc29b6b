"""The answer of a sizing. Chapters: a rigid box on its page; where stops lie, and their risk; the
clearance in words and numbers (`Sizing.summary`, `Sizing.verdict`, `RoundedClearance`); the
question; answers by damage and by phases."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from stochvi.isolators.record_verdict import RecordVerdict, most_alarming
from stochvi.isolators.screening import SceneAtRest, Screening, at_clearances, scene_at_rest
from stochvi.isolators.tolerances import Tolerances
from stochvi.mathematics.numerics import ROUNDING, Matrix, Vector
from stochvi.mathematics.units import LENGTH, RATE, readable, spoken_mission
from stochvi.mathematics.unsteady_noise import MovingMean
from stochvi.model.coverage import NaturalMode, free_motion, natural_modes
from stochvi.model.model import Model, model_of
from stochvi.results.base import (
    DataFrame,
    Named,
    Response,
    Result,
    frame_of,
    in_readable_units,
    kept_table,
    rows_of,
)
from stochvi.results.estimates import (
    GAUSSIAN_95,
    Estimate,
    WithValue,
    capital,
    count_of,
    spoken_percent,
)
from stochvi.sampling.run import Run
from stochvi.scenes.scene import Scene
from stochvi.scenes.structures.rigid_body import AXES, RigidBody
from stochvi.scenes.validation import in_toml, moved
from stochvi.statistics.crossings import own_distances, rice_rate
from stochvi.statistics.hardness import hardness_of
from stochvi.statistics.trial_splitting import without_peaks

if TYPE_CHECKING:
    from stochvi.isolators.production_risk import Production
    from stochvi.mathematics.spectra import Table
    from stochvi.scenes.scene import ImpactPair
    from stochvi.statistics.damage import Damage


# ------------------------------------------------------------------------------
# A rigid box for its page: its modes, and what sizing each axis as one oscillator would buy.
# ------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class BoxOverview:
    """The numbers that the page of a box states besides its clearances.

    Parameters
    ----------
    modes
        Natural modes without stops.
    pairs
        One row per pair: its name `pair`, `one_axis_three_sigma`, `chance_at_one_axis` and
        `chance_as_given`. The second is three times the rms of the gap (m) if nothing turned: the
        centre of mass then moves along each axis as an oscillator of its own, on all mounts
        together. The others are probabilities of an impact of this pair alone in the mission. Its
        stops are at that distance from the mean gap, or as in the scene. Both use Rice's rate of
        crossings of the gap as it really moves.
    """

    modes: Sequence[NaturalMode]
    pairs: DataFrame = kept_table()


def box_overview(scene: Scene, mission: float) -> BoxOverview | None:
    """The overview of a scene with a rigid body; None for any other.

    Parameters
    ----------
    mission
        Seconds of exposure.
    """
    if not isinstance(scene.structure, RigidBody):
        return None
    model = model_of(scene)
    rows = np.array([pair.direction for pair in model.pairs])
    moved = free_motion(model, with_sines=True).moving_means(rows)
    alone = replace(
        model,
        mass=np.diag(np.diag(model.mass)),
        damping=np.diag(np.diag(model.damping)),
        stiffness=np.diag(np.diag(model.stiffness)),
    )
    straight = rows * (np.arange(rows.shape[1]) < len(AXES))
    apart = free_motion(alone, with_sines=True).moving_means(straight)
    three = np.array([3.0 * each.deviations[0] for each in apart])
    stops = np.array(own_distances(model))
    there = np.where(np.isfinite(stops), three, math.inf)
    pairs: Any = {
        "pair": [pair.name for pair in model.pairs],
        "one_axis_three_sigma": three,
        "chance_at_one_axis": _chances(moved, there, mission),
        "chance_as_given": _chances(moved, stops, mission),
    }
    return BoxOverview(
        modes=natural_modes(model),
        pairs=pairs,
    )


def _chances(moved: Sequence[MovingMean], stops: Matrix, mission: float) -> Vector:
    """Probability that each pair is hit in the mission, stops (2, pairs) at distances from the
    mean, m: 1 where one of them lies beyond it."""
    crossings = [
        mission * rice_rate([motion], own[:, None])
        for motion, own in zip(moved, stops.T, strict=True)
    ]
    return np.where(np.any(stops < 0.0, axis=0), 1.0, -np.expm1(-np.array(crossings)))


# ------------------------------------------------------------------------------
# Where the stops of a sizing lie, and the probability of any impact there.
#
# This chapter reads the probability of even stops off the curve of risk against clearance, which
# `risk_curve` makes. That of uneven stops is in the sizing, as their first crossings have it.
# ------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class StopPositions:
    """Where stops lie, m from the unloaded spring unless stated otherwise.

    Parameters
    ----------
    mean_position
        The static equilibrium: where the mass hangs under gravity and constant loads.
    recommended
        Place of the stop on each side, by "lower" and "upper", at the clearance to make (`made`);
        empty where that is not known.
    distances
        Clearance of each stop of the scene: its distance from the static equilibrium.
    probability
        Probability of any impact in the mission with the stops of the scene; None where it is not
        known, or the scene has no stops.
    """

    mean_position: float
    recommended: Mapping[str, float]
    distances: Mapping[str, float]
    probability: float | None


def gap_of(sizing: Sizing) -> StopPositions:
    """The stops of a sizing: at the clearance to make, and as the scene has them."""
    model = model_of(sizing.scene)
    rest, made = model.rest, sizing.made
    sides = [stop.name for stop in model.stops] or SIDES
    return StopPositions(
        mean_position=rest,
        recommended={side: made.position(rest, side) for side in sides if made},
        distances={name: abs(each) for name, each in distances_of_stops(sizing.scene).items()},
        probability=probability_of_stops(sizing),
    )


def probability_at(sizing: Sizing, clearance: float) -> float | None:
    """Probability of any impact in the mission at a clearance of the curve; None before its
    start."""
    if sizing.target.name == "probability" and clearance == sizing.clearance.value:
        return sizing.target.value
    found = _bursts_at(sizing, clearance)
    return None if found is None else -math.expm1(-found)


def probability_of_stops(sizing: Sizing) -> float | None:
    """Probability of any impact with the stops where the scene has them; None where it is
    not known, or a stop presses on the mass."""
    if sizing.probability_of_stops is not None:
        return sizing.probability_of_stops.value
    distances = distances_of_stops(sizing.scene)
    if not distances or min(distances.values()) <= 0.0 or are_uneven(distances.values()):
        return None
    return probability_at(sizing, min(distances.values()))


def distances_of_stops(scene: Scene) -> dict[str, float]:
    """Distance of each stop from the static equilibrium by "lower" and "upper", m; negative where
    it presses on the mass there."""
    model = model_of(scene)
    return {
        stop.name: model.rest - stop.position
        if stop.name == "lower"
        else stop.position - model.rest
        for stop in model.stops
    }


def mean_gaps(model: Model) -> Vector:
    """Means of all gaps, m; the static equilibrium of a mass that has no pair."""
    return model.mean_gaps if model.pairs else np.array([model.rest])


def are_uneven(distances: Collection[float]) -> bool:
    """Whether there are two stops at different distances.

    Their probability is not on the curve of even ones: a cluster may touch both stops, so that
    either has more than half of the clusters.
    """
    return len(distances) == 2 and not math.isclose(*distances)


def _bursts_at(sizing: Sizing, clearance: float) -> float | None:
    """-log(1 - P) at a clearance; None before the curve, whose end is followed beyond it.

    It falls nearly as a Gaussian: its logarithm over the square of the clearance is straight.
    """
    known = [(row["clearance"], row["probability"]) for row in rows_of(sizing, "curve")]
    squares, p = np.array(known).T
    squares = squares**2
    if clearance**2 < squares.min():
        return None
    logarithms = np.log(-np.log1p(-np.clip(p, LEAST, CERTAIN)))
    if clearance**2 <= squares.max():
        return math.exp(float(np.interp(clearance**2, squares, logarithms)))
    slope = float((logarithms[-1] - logarithms[-2]) / (squares[-1] - squares[-2]))
    end = float(logarithms[-1]) + slope * (clearance**2 - float(squares[-1]))
    return math.exp(max(end, math.log(LEAST)))


LEAST, CERTAIN = 1e-300, 1.0 - 1e-15
"""Smallest and largest probability of which a logarithm is taken; others are moved to these
limits."""


def two_sided(scene: Scene) -> bool:
    """Whether both sides are sized: the scene has two stops, or none yet."""
    return not scene.impact_pairs or len(scene.impact_pairs[0].stops()) == 2


# ------------------------------------------------------------------------------
# The clearance that an isolator needs, with a stated risk.
# ------------------------------------------------------------------------------


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
        "probability" (of any impact in the mission), "rate" (impacts per second), or a kind of
        hardness (not exceeded in the mission but with the probability `exceedance`).
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
        """The value with its unit, in words; an acceleration in g, unless a unit is chosen."""
        return readable(self.unit).text(self.value)

    @property
    def accepted(self) -> str:
        """What the target accepts, in words: a probability, or a rate."""
        if self.name == "rate":
            return f"{RATE(self.value):.3g} per {RATE.time}"
        return spoken_percent(self.exceedance or self.value)

    @property
    def event(self) -> str:
        """What the target limits, in words."""
        if self.exceedance is not None:
            return hardness_of(self.name).beyond(self.value)
        return {"rate": "impacts", "probability": "an impact"}[self.name]

    def kept(self, mission: float) -> str:
        """The target in a mission (s) as it is kept, in words."""
        if self.name == "rate":
            return f"impacts: fewer than {self.accepted}"
        return f"{self.event} in {spoken_mission(mission)}: less than {self.accepted} likely"


FINEST_SHARE = 0.05
"""Largest share of a clearance that rounding it up may add."""

COARSEST = 1e-4
"""Largest step to which a clearance is rounded up, m: 0.1 mm, to which gaps are usually made. It is
divided by 10 until it is at most `FINEST_SHARE` of the clearance."""


@dataclass(frozen=True, kw_only=True)
class RoundedClearance(WithValue):
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
class Clearance(WithValue):
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

    @property
    def quantities(self) -> Mapping[str, Any]:
        """The clearances of several pairs, or that of the only one as the "size"."""
        by_pair = self._by_pair()
        return by_pair if self.several else {"size": by_pair.popitem()[1]}

    @property
    def _parts(self) -> Mapping[str, Any]:
        """Clearances by pair, and what sweeps have."""
        return {**self._by_pair(), **self.quantities}

    def _by_pair(self) -> dict[str, Named]:
        return {name: Named(clearance=self._estimate(c)) for name, c in self.clearances.items()}

    def _estimate(self, c: Clearance) -> Estimate:
        """A clearance with the error of its interval, taken for Gaussian; an upper limit where
        smaller ones may keep the target too."""
        if not c.lower:
            return Estimate(value=0.0, upper_95=c.value, how="the nearest stops judged")
        error = (c.upper - c.lower) / (2.0 * GAUSSIAN_95)
        bias = 0.0 if self.scene.phases else c.value * model_of(self.scene).rms_bias
        return Estimate(value=c.value, standard_error=error, bias=bias, how=self.how)

    @property
    def how(self) -> str:
        """How the clearances were found, in words."""
        return "the damage of equipment at clearances that were tried"

    def extremes(self) -> tuple[str, str]:
        """Names of the pairs with the smallest and with the largest clearance."""
        names = _by_size(self.rounded, self.clearances)
        return names[0], names[-1]

    @property
    def to_make(self) -> str:
        """The clearances to make, in words."""
        places = f"{self._places()}," if self.several else str(self.widest)
        return f"Make {places} {sides_in_words(self.hanging, self.clearances)}{self._beside()}"

    def _kept(self, kept: str, accepted: str, as_stated: str = "") -> str:
        """The clearances to make, what they keep, and the calculated one, where the risk is just
        what is accepted; with its interval where that changes a printed digit."""
        c = self.clearances[self.extremes()[1]]
        low, place, high = (_in_three(each) for each in (c.lower, c.value, c.upper))
        place = LENGTH.text(c.value) if place == str(self.widest) else place
        just = f"{accepted} at {place}{self.of_widest}{as_stated}"
        if c.upper - c.lower > THIRD_DIGIT * c.value:
            just += f", from {low.removesuffix(f' {LENGTH}')} to {high}"
        return f"{self.to_make}. {capital(kept)} ({just})."

    def _places(self) -> str:
        """The clearances of several pairs to make, in words."""
        return places_in_words(self.rounded, self.clearances)

    def _beside(self) -> str:
        """What stays as it is, in words."""
        return ""

    @property
    def hanging(self) -> Scene:
        """The scene in whose static equilibrium the mass hangs."""
        return self.scene

    @property
    def resting(self) -> SceneAtRest:
        """The numbers of that scene without noise."""
        return scene_at_rest(self.hanging)

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
        return None if self.record is None or self.record.agrees else self.record

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
        """The stops at the clearances to make, as lines of a scene file have them (m from the
        unloaded spring). Several pairs stand behind their names; it is empty where there are none
        to make."""
        rests, pairs = self.rests, {each.name: each for each in self.scene.expanded.impact_pairs}

        def lines(name: str, made: RoundedClearance) -> str:
            stated = dict(pairs[name]) if name in pairs else dict.fromkeys(SIDES, 0.0)
            places = {
                side: moved(stated[side], made.position(rests.get(name, self.rest), side))
                for side in SIDES
                if stated[side] is not None
            }
            return ", ".join(f"{side} = {in_toml(place)}" for side, place in places.items())

        found = [(name, lines(name, made)) for name, made in self.each_made.items()]
        return "; ".join(f"{name}: {text}" if self.several else text for name, text in found)

    def placed(self) -> DataFrame:
        """Where the stops of the sized pairs go, for Gaussian noise: one row per pair.

        `pair`, its `mean_gap` in the static equilibrium, the `clearance` from there, and
        `lower` and `upper` as a scene file has them, from the unloaded mounts; all in m, NaN where
        the scene has no stop.
        """
        return frame_of(self.rows_of_places(), ["pair", "mean_gap", "clearance", *SIDES])

    def rows_of_places(self) -> list[dict[str, Any]]:
        """The rows of that table."""
        rows, rests = [], self.rests
        for pair in self.scene.expanded.impact_pairs:
            if (made := self.rounded.get(pair.name)) is not None:
                stated = {side for side, _ in pair.stops()}
                mean = rests[pair.name]
                places = {s: made.position(mean, s) if s in stated else math.nan for s in SIDES}
                here = {"pair": pair.name, "mean_gap": mean, "clearance": made.value}
                rows.append(here | places)
        return rows

    def verdict(self) -> str:
        """The clearance to make and what it keeps, in words; where a record does not agree with the
        noise of the sizing, that is said instead."""
        found, record = self.doubtful, self.record
        if not found or record is None:
            return self.for_noise()
        judged = [record.headline()]
        if isinstance(found, Mapping) and self.scene.phases:
            judged = [each.headline(f"the record of phase {name}") for name, each in found.items()]
        return f"Do not size by the spectrum: {'; '.join(judged)}."

    def for_noise(self) -> str:
        """The clearance to make for Gaussian noise and what it keeps, in words."""
        raise NotImplementedError(f"{type(self).__name__} has no verdict")

    def calculated(self) -> str:
        """The clearance before rounding."""
        return f"calculated: {self.clearances[self.extremes()[1]]}{self.of_widest}"

    def decides(self) -> str:
        """What decides the clearance, in words; empty where that is not a part of the mission."""
        return ""

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
        return {"method": self.kind, "verdict": self.verdict(), "made": made, **found}


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
OF_PHASES = ("phases", "records", "assumptions")
OF_NO_PHASES = (
    "by", "three_sigma", "required", "screening", "production", "fell_short", "kept_with",
)  # fmt: skip
"""JSON keys that only a sizing by the curve of one gap has; only one of several gaps; only one of
phases; and those that one of phases does not have."""

NOT_OF_PHASES: Any = None
"""What a sizing of phases does not have."""


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Sizing(ClearanceAnswer):
    """The clearances that keep a target, and the evidence for them.

    One mass with one pair, or without stops yet, is sized by the curve of risk of its gap. Gaps of
    a structure are sized together, and so are the phases of a mission. Their evidence differs: what
    a way does not have is None or empty.

    Parameters
    ----------
    scene
        The scene that was sized, as it was given.
    allowed
        The tolerances that were asked for, within all of which the clearances to make keep the
        target.
    tolerances
        For a structure and for phases, a row per end of the tolerances. The last row is the largest
        of each column over their whole region. Columns: `change`; under its name the clearance of
        each sized pair for the same risk (m, from the nominal mean gap); `factor`, the largest of
        them over the nominal one; and `probability` of any impact at the nominal clearances.
        Without tolerances, or where the largest were not found, there is at most the first row, "as
        stated".
    target, mission
        The target of the sizing, and seconds of exposure: of all phases together.
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
    phases
        By phase its `duration` (s), `displacement_std` of the widest gap and `shift` of its static
        equilibrium (m). `probability` is that of any impact at the clearances, and `share` the
        part of the phase in the hazard. `clearance` of that gap is what the phase alone needs for
        the target (NaN where it does not matter).
    curve
        For one mass, a row per clearance, from one run: `clearance` (m), `clearance_in_sigma`,
        `rice_rate` (1/s, both sides), `first_hit_rate` (1/s, the limit that the rate of first
        impacts tends to), `probability` (of any impact in the mission); the two last ones with
        their 95 % limits under the same names and `_low`, `_high`.

        For a structure, a row per risk: `probability_alone` of each sized pair; the clearance of
        each sized pair under its name (m); `probability` with its limits; and `independent`, the
        same if impacts of the pairs were independent.

        For phases, `probability` with its limits over the `clearance` of the widest gap.
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
        need; of phases the one to know first; None without a record.
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
    box
        Modes of a rigid body, and the clearances of one oscillator along each axis; None for any
        other structure.
    worst_at
        By sized pair of a structure, where within the tolerances its clearance is largest, in
        words.
    records
        Verdicts on the measured records, by the phases that have one.
    assumptions
        Assumptions of a mission of phases, in words.

    See Also
    --------
    stochvi.size : The calculation.
    """

    kind = "size"
    in_document: ClassVar = {"by": "method"}
    sometimes = (*OF_ONE, *OF_SEVERAL, *OF_PHASES, *OF_NO_PHASES)

    @property
    def omitted(self) -> Sequence[str]:
        """What the document leaves out: the evidence of other ways to size."""
        if not self.scene.phases:
            return *OF_PHASES, *(OF_ONE if self.several else OF_SEVERAL)
        found = {*OF_ONE, *OF_SEVERAL, *OF_NO_PHASES}
        return [*(found - {"tolerances"} if len(rows_of(self, "tolerances")) else found)]

    allowed: Tolerances = field(default_factory=Tolerances)
    tolerances: DataFrame = kept_table(())
    target: Target
    mission: float
    pairs: DataFrame = kept_table(())
    phases: DataFrame = kept_table(())
    curve: DataFrame = kept_table()
    three_sigma: ThreeSigma = NOT_OF_PHASES
    required: DataFrame = kept_table(())
    screening: Screening = NOT_OF_PHASES
    method: str = "all phases together"
    expected_hits: Estimate | None = None
    record: RecordVerdict | None = None
    production: Production | None = None
    fell_short: tuple[str, ...] = ()
    simulated: DataFrame = kept_table(())
    evidence: Mapping[str, Response] = field(default_factory=dict)
    kept_with: Estimate | None = None
    exceeding: DataFrame | None = kept_table(None)
    probability_of_stops: Estimate | None = None
    worst_case: DataFrame | None = None
    pair: str | None = None
    common: tuple[str, ...] = ()
    probability: Probability | None = None
    as_given: Probability | None = None
    box: BoxOverview | None = None
    worst_at: Mapping[str, str] = field(default_factory=dict)
    records: Mapping[str, RecordVerdict] = field(default_factory=dict)
    assumptions: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.record is None and (name := most_alarming(self.records)) is not None:
            object.__setattr__(self, "record", self.records[name])

    @property
    def several(self) -> bool:
        """Whether gaps of a structure were sized together, be it one of several that was asked for;
        else the curve of risk of one gap says all."""
        return super().several or "probability_alone" in vars(self)["curve"]

    @property
    def how(self) -> str:
        """The method."""
        return self.method

    @property
    def quantities(self) -> Mapping[str, Any]:
        """The clearances, and as parts of the "size" three sigma and the impacts."""
        three, found = self.three_sigma, super().quantities
        if self.scene.phases:
            return found
        of_one = {
            "three_sigma": Estimate(value=three.clearance),
            "rms_displacement": Estimate(value=self.sigma),
        }
        own = {} if self.several else found["size"] | of_one
        own |= {"probability_at_three_sigma": three.probability}
        own |= {"expected_hits": self.expected_hits}
        return {"size": Named(own), **(found if self.several else {})}

    def _estimate(self, c: Clearance) -> Estimate:
        return super()._estimate(c if self.kept_with is None else replace(c, lower=0.0))

    @property
    def named(self) -> Mapping[str, Clearance]:
        """The calculated clearances by their columns in tables of changed scenes."""
        return self.clearances if self.several else {"clearance": self.clearance}

    @property
    def sigma(self) -> float:
        """Linear rms of the widest sized gap without stops, m."""
        rows = rows_of(self, "pairs")
        return float(max(rows[number]["sigma"] for number in self.sized_pairs))

    @property
    def sized_pairs(self) -> list[int]:
        """Numbers of the pairs that were sized, in the order of `clearances`."""
        names = [row["pair"] for row in rows_of(self, "pairs")]
        return [names.index(name) for name in self.clearances]

    @property
    def stops(self) -> Matrix:
        """(2, pairs): distances of the lower and upper stops from the mean gaps at the calculated
        clearances, m; infinite for none."""
        known = np.array([[row[side] for row in rows_of(self, "pairs")] for side in SIDES], float)
        return np.where(np.isnan(known), math.inf, known)

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
        return f" within {self.allowed.in_words()}" if self.allowed != Tolerances() else ""

    @property
    def seed(self) -> int:
        """The seed of the simulations."""
        seed = self.provenance.get("seed")
        return seed if isinstance(seed, int) else 0

    @property
    def needed(self) -> Mapping[str, float]:
        """The clearance of each sized pair for the target, m: the largest within the tolerances or,
        for a production, what its mean risk needs. Empty where that was not found."""
        if self.production is not None:
            return {name: each.value for name, each in self.production.clearances.items()}
        if rows := rows_of(self, "tolerances")[1:]:
            return {name: float(rows[-1][name]) for name in self.clearances}
        if self.allowed == Tolerances():
            return {name: each.value for name, each in self.clearances.items()}
        worst = math.nan if self.worst_case is None else self.worst_case["clearance"].iloc[-1]
        return {} if math.isnan(worst) else dict.fromkeys(self.clearances, float(worst))

    @property
    def rounded(self) -> Mapping[str, RoundedClearance]:
        """Those clearances, rounded up."""
        return {name: RoundedClearance.of(each) for name, each in self.needed.items()}

    @property
    def doubtful(self) -> Mapping[str, RecordVerdict] | RecordVerdict | None:
        """The verdicts on records that do not agree with the Gaussian noise of the sizing; by their
        phases, where there are any."""
        if not self.scene.phases:
            return super().doubtful
        return {name: each for name, each in self.records.items() if not each.agrees}

    @property
    def hanging(self) -> Scene:
        """The scene with the mount as stated, in no phase warm or cold."""
        return as_stated(self.scene) if self.scene.phases else self.scene

    def densities(self) -> dict[str, list[Table]]:
        """The densities of the accelerations in each phase, level included."""
        return {
            phase.name: [table for table, _ in without_peaks(model_of(phase.of(self.scene))).tables]
            for phase in self.scene.phases
        }

    @property
    def gap(self) -> StopPositions:
        """Where the stops of one mass lie, and the probability of an impact on those of the
        scene."""
        return gap_of(self)

    def for_noise(self) -> str:
        """The clearances to make and the risk that they keep, in words."""
        if self.production is not None:
            return self.production.summary()
        target, mission, within = self.target, self.mission, self.within
        if self.widest is None:
            return f"No clearance was found that keeps the target{within}; raise budget."
        over = f" over {len(self.phases)} phases" if len(rows_of(self, "phases")) > 1 else ""
        kept = f"{target.kept(mission)}{over}{within}"
        if self.worst_case is not None and self.worst_case["note"].iloc[-1]:
            return (
                f"{self.to_make}, which was not shown as accurately as asked for; raise budget. "
                f"{capital(kept)}."
            )
        if self.kept_with is None:
            return self._kept(kept, target.accepted, " as stated" * self.varies)
        if self.shown_to_keep:
            return f"{self.to_make}; less may be enough. {capital(kept)}."
        places = self._places() if self.several else self.widest
        return (
            f"No clearance was shown to keep the target{within}; raise budget. How likely "
            f"{target.event} in {spoken_mission(mission)} is at {places} is not known well enough."
        )

    def _places(self) -> str:
        """The clearances, rounded up; one number where all sized pairs have it in common."""
        made = self.rounded
        in_common = (
            set(made) == set(self.common) and len({str(each) for each in made.values()}) == 1
        )
        if in_common and len(made) > 1:
            return f"{next(iter(made.values()))} at all {len(made)} pairs in common"
        return places_in_words(made, self.clearances)

    def _beside(self) -> str:
        """What stays as it is, in words."""
        return "" if self.pair is None else ", with the other stops as they are"

    def calculated(self) -> str:
        """Evidence for the clearances to make: those calculated for the scene as stated, and the
        impacts to expect there."""
        if self.scene.phases:
            return super().calculated()
        low, high = min(self.clearances.values(), key=lambda each: each.value), self.clearance
        text = f"calculated{' as stated' * self.varies}: {LENGTH.text(low.value)}"
        if self.several:
            text += f" to {LENGTH.text(high.value)}" if high.value > low.value else ""
        elif self.kept_with is None:
            interval = f"{LENGTH.span(low.lower, low.upper)}, 95 %"
            text += f" ({interval}), {low.value / self.sigma:.3g} sigma"
        else:
            most = self.kept_with.upper_95
            limit = "95 % limit of the probability:" if most else "a probability of"
            chance = spoken_percent(most or self.kept_with.value)
            text += f", {low.value / self.sigma:.3g} sigma, {limit} {chance}"
        if self.expected_hits is None or (self.several and self.target.name == "rate"):
            return text
        mission = spoken_mission(self.mission)
        return f"{text}; {self.expected_in_words()} impacts expected there in {mission}"

    def expected_in_words(self) -> str:
        """The number of expected impacts; where too few were seen, the limits that are known: each
        first impact is one."""
        found = self.expected_hits
        if found is None:
            return "an unknown number of"
        if found.upper_95 is None:
            return count_of(found.value)
        # the number of first impacts, which those that follow add to
        first = -math.log1p(-min(self.any_hit or 0.0, NEARLY_CERTAIN))
        return f"{first:.2g} to {found.upper_95:.2g}"

    def decides(self) -> str:
        """The phase that decides; empty of one phase, and without phases."""
        if len(rows_of(self, "phases")) < 2:
            return ""
        most = self.phases.iloc[int(np.argmax(self.phases["share"]))]
        share = spoken_percent(most["share"])
        return (
            f"Phase {most['phase']} of {spoken_mission(most['duration'])} has {share} of the risk"
        )

    @property
    def shown_to_keep(self) -> bool:
        """Whether the target was shown to be kept at the clearance: not where too few samples speak
        for the smallest clearance that can be judged."""
        if self.kept_with is None:
            return True
        most = self.kept_with.upper_95
        most = self.kept_with.value if most is None else most
        return most <= (self.target.exceedance or 0.0)

    def to_frame(self) -> DataFrame:
        """The curve of risk against clearance, or the phases."""
        return self.phases if self.scene.phases else self.curve

    def _shown(self) -> DataFrame:
        own = self.pairs if self.several else self.required
        return in_readable_units(self.phases if self.scene.phases else own)

    def _document(self) -> dict[str, Any]:
        found = super()._document()
        if self.scene.phases:
            return found
        own: dict[str, Any] = {"three_sigma": Probability.of(self.three_sigma.probability)}
        if not self.several:
            own = {"clearance_in_sigma": self.clearance.value / self.sigma, "gap": self.gap}
            own |= {"sigma": self.sigma}
        if self.production is not None and self.doubtful is not None:
            own["production"] = self.production.to_dict() | {"made": {}}
        return found | own


PairsSizing = MissionSizing = Sizing
"""The names that sizings of several pairs and of phases had."""


def _in_three(length: float) -> str:
    """A length with three digits, trailing zeros included; four above 999."""
    form = "#.3g" if LENGTH(length) < 1000.0 else "#.4g"
    return LENGTH.text(length, form).replace(". ", " ")


THIRD_DIGIT = 5e-3
"""Length of an interval over its value from which on it changes the third digit."""

MOST_NAMED = 3
"""Most pairs whose clearances a sentence lists; beyond that it names the smallest and the
largest."""


def widest_of(made: Mapping[str, RoundedClearance]) -> RoundedClearance | None:
    """The largest of several clearances; None of none."""
    return max(made.values(), key=lambda each: each.value, default=None)


def _by_size(
    made: Mapping[str, RoundedClearance], calculated: Mapping[str, Clearance]
) -> list[str]:
    """Names of pairs by the clearance to make; those that round to the same by that calculated."""
    return sorted(
        calculated,
        key=lambda name: (made[name].value if name in made else 0.0, calculated[name].value),
    )


def places_in_words(
    made: Mapping[str, RoundedClearance], calculated: Mapping[str, Clearance]
) -> str:
    """The clearances of several pairs; of many pairs the smallest and the largest."""
    if len(made) <= MOST_NAMED:
        return ", ".join(f"{place} at {name}" for name, place in made.items())
    low, *_, high = (name for name in _by_size(made, calculated) if name in made)
    first = f"from {made[low]} at {low} to {made[high]} at {high}"
    return f"{first}, each of {len(made)} pairs its own"


def sides_in_words(scene: Scene, names: Collection[str]) -> str:
    """On which sides of pairs with these names clearances are made, and from where where that is
    not the unloaded spring."""
    pairs = [pair for pair in scene.expanded.impact_pairs if pair.name in names]
    sides = {tuple(side for side, _ in pair.stops()) for pair in pairs} or {SIDES}
    words, datum = "on each side", " of the static equilibrium"
    if sides != {SIDES}:
        ((side, *_),) = sides if len(sides) == 1 else [("",)]
        words, datum = f"to {f'the {side}' if side else 'each'} stop", datum.replace("of", "from")
    return words + datum * bool(np.any(np.abs(mean_gaps(model_of(scene))) > UNFELT))


UNFELT = 1e-9
"""Largest distance of a static equilibrium from the unloaded spring, m, that no sentence names."""


# ------------------------------------------------------------------------------
# The question of a sizing.
# ------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class Question:
    """The target of a sizing, and the run in which it is searched for, which has the relative error
    of the risk; see `size`. The tolerances are by default those that the scene states. Without
    `impacts` none is simulated for a probability, and the answer says nothing of them."""

    target: Target
    mission: float
    run: Run
    at: str | None = None
    pair: str | None = None
    common: Sequence[str] = ()
    tolerances: Tolerances | None = None
    impacts: bool = True


# ------------------------------------------------------------------------------
# What a sizing by the damage of equipment returns.
# ------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class DamageSizing(ClearanceAnswer):
    """The clearances at which stops keep the damage of equipment below a ratio.

    Parameters
    ----------
    scene
        The scene; its stops are where it states them.
    ratio
        Largest accepted damage of equipment with stops over that without, at all its frequencies.
    mission
        Duration, s.
    clearances
        By pair, metres per side from the static equilibrium, with the 95 % interval. All are
        equally far in rms motions of their gaps.
    sigma
        Rms motion of that gap without stops, m.
    tried
        The clearances of that gap that were tried, m, each with the largest `damage_ratio`, its
        `standard_error`, the `frequency_hz` where it is, and `by`, "clusters" or "simulation".
    damage
        The answer of `damage` at the clearance nearest to the one that was found.
    record
        Whether a measured record moves the gaps as Gaussian noise would; None without a record.

    See Also
    --------
    stochvi.isolators.size_by_damage : The calculation.
    """

    kind = "size:damage"

    ratio: float
    mission: float
    sigma: float
    tried: DataFrame
    damage: Damage
    record: RecordVerdict | None = None

    def to_frame(self) -> DataFrame:
        """The clearances that were tried."""
        return self.tried

    def for_noise(self) -> str:
        """The clearance to make and the damage that it keeps, in words."""
        f = self.damage.equipment_frequency_hz
        band = f"{f[0]:.4g} Hz" if len(f) == 1 else f"{f[0]:.4g} to {f[-1]:.4g} Hz"
        times = f"{self.ratio:.4g} times"
        return self._kept(
            f"damage of equipment at {band}: less than {times} that without stops", times
        )

    def decides(self) -> str:
        """The equipment that decides."""
        apart = np.abs(self.tried["clearance"] - self.clearance.value)
        near = self.tried.iloc[int(np.argmin(apart))]
        return f"Equipment of {near['frequency_hz']:.3g} Hz decides"


def as_stated(scene: Scene) -> Scene:
    """The first phase with the mount as the scene states it, neither warm nor cold."""
    factors = {"stiffness_factor": 1.0, "damping_factor": 1.0}
    return scene.phases[0].model_copy(update=factors).of(scene)
