"""`size`: the clearance that an isolator needs. Chapters: one gap in the phases of a mission; all
pairs in a phase; a mission of several phases; a limit on the damage of equipment; `size` itself,
with tolerances."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, Unpack

import numpy as np
import scipy

from stochvi.isolators.record_verdict import record_verdict
from stochvi.isolators.screening import at_clearances
from stochvi.isolators.sizing.answer import (
    Clearance,
    DamageSizing,
    MissionSizing,
    Question,
    Sizing,
    Target,
    as_stated,
)
from stochvi.isolators.sizing.pairs import (
    RISK_STEP,
    SHARE_OF_CURVES,
    SIDES,
    TotalRisk,
    curve_of_gap,
    has_one_gap,
    nominal_sizing,
)
from stochvi.isolators.sizing.risk_curve import KNOWN, RiskCurve, place_of, slope_of, target_of
from stochvi.isolators.sizing.search import ACCEPTED, SEARCH
from stochvi.isolators.sizing.sensitivity import LEAST_SECONDS, worst_case
from stochvi.isolators.tolerances import Tolerances
from stochvi.mathematics.numerics import Matrix, Vector
from stochvi.mathematics.unsteady_noise import RandomLevel
from stochvi.model.coverage import free_motion, modulated, nonlinear, scene_notes, unshaken
from stochvi.model.model import Model, model_of
from stochvi.results.base import DataFrame, frame_of, rows_of
from stochvi.results.deadline import partial_result
from stochvi.results.errors import Interrupted, NotApplicable, NotConverged
from stochvi.results.estimates import provenance, spoken_percent
from stochvi.sampling.calculations import AccuracyOptions, calculation
from stochvi.sampling.run import Run, sampled
from stochvi.scenes.phases import Phase, steps_of_bands
from stochvi.scenes.scene import Scene
from stochvi.scenes.validation import varied
from stochvi.statistics.crossings import FirstCrossings, PairMotion, largest_error, one_gap
from stochvi.statistics.damage import Damage, damage
from stochvi.statistics.free_flights import is_followed, linearised, windows_over
from stochvi.statistics.hardness import limits_in
from stochvi.statistics.mission_parts import INDEPENDENT, Hazard, joined, parts_of_mission
from stochvi.statistics.reliability.missions import (
    FOLLOWED,
    NEGLIGIBLE,
    RiskOptions,
    felt_by,
    lag_of,
    spoken_lags,
)
from stochvi.statistics.trial_splitting import (
    HazardCurve,
    has_fast_peaks,
    hazard_curve,
)

if TYPE_CHECKING:
    from stochvi.isolators.tolerances import Spread


# ------------------------------------------------------------------------------
# One gap in the phases of a mission: its hazard against the clearance, alone and of all phases.
# ------------------------------------------------------------------------------


POINTS, AROUND = 41, 0.35
"""Number of clearances of the curve of an answer, and how far it reaches from the clearance that
was found, as a share of it."""

FARTHEST = 100.0
"""Largest clearance of a curve under noise with fast peaks, in rms displacements of the gap."""

LEAST = 1e-300
"""Smallest hazard, of which a logarithm is taken."""


@dataclass(frozen=True, kw_only=True, eq=False)
class GapInPhase:
    """The gap of one pair in a phase, as if it alone had stops. Distances in m.

    Parameters
    ----------
    model
        The model of the phase.
    together
        The motion of all gaps in the phase.
    number
        The number of the gap among them.
    shift
        How much farther up the gap hangs than in the mount as stated.
    sides
        The sides that have a stop.
    pieces
        The model of all gaps where pieces of its motion are followed (`is_followed`), else None.
    curve
        Its risk against clearance; None where crossings count by Rice's formula.
    """

    model: Model
    together: PairMotion
    number: int
    duration: float
    shift: float
    sides: tuple[float, ...]
    sweep_rate: float = 0.0
    pieces: Model | None = None
    curve: RiskCurve | HazardCurve | None = None

    @property
    def sigma(self) -> float:
        """rms displacement, sines included."""
        return self.together.motions[self.number].deviations[0]

    def expected(self, clearance: float) -> float:
        """Rice's number of crossings; where the level varies, the hazard that follows from it."""
        motion = self.together.motions[self.number]
        if not motion.place:
            return 0.0

        def crossings(gain: float) -> float:
            return sum(
                motion.towards(side).rate(max(clearance - side * self.shift, 0.0) / gain)
                for side in self.sides
            )

        level = self.model.level
        if level is None:
            return self.duration * crossings(1.0)
        return self._varying(np.array([crossings(gain) for gain in level.gains]), level)

    def _varying(self, rates: Vector, level: RandomLevel) -> float:
        """-ln(1 - P) of a hazard with these rates at the gains of a level."""
        chance = level.probability(rates, self.duration)
        return -math.log1p(-min(chance, KNOWN))

    def lag(self, clearance: float) -> float:
        """By how much, as a share, the hazard of what moves may be too large at a clearance."""
        return lag_of_hazard(self.expected, clearance, self.model, self.sweep_rate)

    def simulated(self, target: Target, run: Run) -> GapInPhase:
        """The gap with its curve of risk, where the level varies that of the level 0 dB in the
        time of the level."""
        if self.pieces is not None:
            return replace(self, curve=self._curve_of_pieces(self.pieces, target.value, run))
        level = self.model.level
        time = self.duration if level is None else min(self.duration, level.time)
        curve = curve_of_gap(
            self.together, target, time, run, number=self.number, shift=self.shift,
            sides=self.sides,
        )  # fmt: skip
        return replace(self, curve=curve)

    def _curve_of_pieces(self, pieces: Model, probability: float, run: Run) -> HazardCurve:
        """The curve of the hazard against the clearance, by pieces of the motion."""
        places = np.array([0.0, FARTHEST * self.sigma])
        rows = np.full((2, 2, len(self.together.motions)), math.inf)
        rows[:, :, self.number] = self.distances(places)
        kind = windows_over(pieces, places, rows, self.duration, run.seed)
        return hazard_curve(kind, -math.log1p(-probability), self.duration, run)

    def distances(self, clearances: Vector) -> Matrix:
        """(places, 2) distances of the lower and the upper stop from the mean gap; infinite for
        none."""
        found = np.full((len(clearances), 2), math.inf)
        for side in self.sides:
            found[:, int(side > 0.0)] = clearances - side * self.shift
        return found

    def hazard(self, clearance: float) -> Hazard:
        """-ln(1 - P) at a clearance, and half its 95 % interval."""
        if self.curve is None:
            return Hazard(self.expected(clearance))
        if isinstance(self.curve, HazardCurve):
            return self.curve.hazard(clearance)
        nearest = min(clearance - side * self.shift for side in self.sides)
        level = self.model.level
        if level is None:
            return self.curve.hazard(nearest)
        value, upper = self._of_level(self.curve, nearest, level)
        felt, _ = self._of_level(self.curve, nearest, felt_by(self.model))
        return Hazard.within(value, upper - value + abs(felt - value))

    def _of_level(
        self, curve: RiskCurve, nearest: float, level: RandomLevel
    ) -> tuple[float, float]:
        """The hazard at a clearance while the level varies, and the upper end of its interval."""
        places = nearest / level.gains
        motion = self.together.motions[self.number]
        known = [curve.hazard(c) if motion.rate(c) else Hazard(0.0) for c in places]
        values, upper = np.array([(h.value, h.value + h.half) for h in known]).T / curve.mission
        return self._varying(values, level), self._varying(upper, level)

    @property
    def reached(self) -> float:
        """Largest relative standard error of the probabilities of the curve; 0 without one."""
        return 0.0 if self.curve is None else self.curve.reached


def lag_of_hazard(
    expected: Callable[[float], float], clearance: float, model: Model, sweep_rate: float
) -> float:
    """By how much, as a share, the hazard of what moves may be too large at a clearance."""
    known = expected(clearance) if sweep_rate else 0.0
    if not known:
        return 0.0
    return expected(clearance / (1.0 + lag_of(model, sweep_rate))) / known - 1.0


class HazardOfStops(Protocol):
    """The hazard of a part of a mission where stops are at a clearance."""

    def hazard(self, clearance: float) -> Hazard:
        """-ln(1 - P) with its interval."""

    def lag(self, clearance: float) -> float:
        """By how much, as a share, the hazard of what moves may be too large."""

    @property
    def reached(self) -> float:
        """Largest relative standard error of its probabilities."""


@dataclass(frozen=True)
class Joint:
    """The hazard of several phases together."""

    phases: Mapping[str, HazardOfStops]
    steps: Sequence[Sequence[str]] = ()

    def hazard(self, clearance: float) -> Hazard:
        """The sum of the hazards, with the bias of the steps of moving bands."""
        parts = {name: each.hazard(clearance) for name, each in self.phases.items()}
        lags = {name: each.lag(clearance) for name, each in self.phases.items()}
        return joined(parts, self.steps, lags)

    def clearance(self, hazard: float, guess: float) -> Clearance:
        """The clearance at which the hazard is this one."""

        def excess(place: float) -> float:
            return math.log(max(self.hazard(place).value, LEAST) / hazard)

        low, high = guess, guess
        step = 0.1 * guess
        while excess(low) < 0.0:
            low -= step
            if low <= 0.0:
                raise NotApplicable(
                    "size", ["probability must be smaller: any clearance keeps it"],
                )  # fmt: skip
        while excess(high) > 0.0:
            high += step
        value = place_of(excess, 0.0, low, high)
        there = self.hazard(value)
        reach = there.half / there.value / abs(slope_of(excess, value, 1e-3 * guess))
        return Clearance(value=value, lower=value - reach, upper=value + reach)

    def curve(self, place: float) -> DataFrame:
        """The table of `MissionSizing.curve`."""
        places = place * np.linspace(1.0 - AROUND, 1.0 + AROUND, POINTS)
        found = [self.hazard(each) for each in places]
        value, half = np.array([(each.value, each.half) for each in found]).T
        return frame_of(
            {"clearance": places, "probability": -np.expm1(-value),
             "probability_low": -np.expm1(-np.maximum(value - half, 0.0)),
             "probability_high": -np.expm1(-(value + half))}
        )  # fmt: skip

    def short(self, accuracy: float) -> list[str]:
        """Sentences on the phases whose risk is not known as accurately as asked for."""
        found = []
        for name, phase in self.phases.items():
            if (reached := phase.reached) > 1.3 * accuracy:
                found.append(
                    f"the budget ended at a relative error of {reached:.3g} of the probability of "
                    f"an impact in phase {name}"
                )
        return found


# ------------------------------------------------------------------------------
# All pairs in a phase of a mission: the hazard that any of them is hit, at an equal risk of each.
#
# The clearances of several pairs are those at which each alone would be hit in the whole mission
# with the same probability. They are known by that of the widest gap.
# ------------------------------------------------------------------------------


RANGE = 20.0
"""Factor by which the risks that are looked at reach beyond those of possible answers."""

FARTHEST_PLACE, PLACES = 4.0, 401
"""Largest clearance that pieces of the motion under noise with fast peaks tell, over the largest
that is looked at. All clearances are linear between so many up to it."""

FAR = 30.0
"""Distance of a stop, in rms motions of its gap, beyond which it is left out: it is crossed with a
probability of 1e-195."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PhaseOfPairs:
    """A phase: its scene, and the gap of each pair."""

    scene: Scene
    duration: float
    gaps: tuple[GapInPhase, ...]

    @classmethod
    def of(cls, phase: Phase, whole: Scene) -> PhaseOfPairs:
        """A phase of a scene; `NotApplicable` where its motion without stops is not covered."""
        scene = phase.of(whole)
        model = model_of(scene)
        if conditions := modulated(model):
            raise NotApplicable("size", [f"{each} (in phases)" for each in conditions])
        if model.functions and np.any(model.constant_force):
            raise NotApplicable("size", [HANGING])
        alone = has_one_gap(model)
        steady = replace(model, level=None)
        linear = linearised(steady)
        free = one_gap(linear) if alone else linear
        pieces = replace(steady, pairs=free.pairs) if is_followed(steady) else None
        motion = PairMotion.under_shocks(free)
        pairs = model.pairs or motion.model.pairs
        stated = model_of(as_stated(whole))
        shifts = np.subtract(*(_mean_gaps(each) for each in (model, stated)))
        gaps = tuple(
            GapInPhase(
                model=model, together=motion, number=number, duration=phase.duration,
                shift=float(shift), sweep_rate=phase.sweep_rate, pieces=pieces,
                sides=tuple(float(stop.side) for stop in pair.stops) or SIDES,
            )
            for number, (pair, shift) in enumerate(zip(pairs, shifts, strict=True))
        )  # fmt: skip
        if model.level is not None:
            _check_level(model, shifts)
        return cls(scene=scene, duration=phase.duration, gaps=gaps)

    @property
    def in_pieces(self) -> bool:
        """Whether no formula tells its crossings, see `is_followed`."""
        return any(gap.pieces is not None for gap in self.gaps)

    def expected(self, clearances: Sequence[float]) -> float:
        """Rice's number of crossings of all stops at the clearances of the pairs."""
        return sum(gap.expected(c) for gap, c in zip(self.gaps, clearances, strict=True))

    def simulated(self, target: Target, run: Run, felt: Sequence[bool]) -> PhaseOfPairs:
        """The phase with the curves of those gaps whose crossings are felt."""
        gaps = list(self.gaps)
        asked = [number for number, each in enumerate(felt) if each]
        for done, number in enumerate(asked):
            low, high = done / len(asked), (done + 1.0) / len(asked)
            share = run.deadline.share(1.0 / (len(asked) - done))
            gaps[number] = gaps[number].simulated(target, run.part(low, high, deadline=share))
        return replace(self, gaps=tuple(gaps))


def _mean_gaps(model: Model) -> Vector:
    """Mean gap of each pair under the constant loads, m; without pairs, that of the only mass."""
    return model.mean_gaps if model.pairs else model.modal.shapes @ model.modal.rest


def _check_level(model: Model, shifts: Vector) -> None:
    """Raise `NotApplicable` where noise of varying level does not move one gap alone."""
    felt_by(model)
    if len(shifts) > 1 or model.sines or np.any(shifts) or is_followed(model):
        several = "several pairs" if len(shifts) > 1 else "a mount that hangs lower in a phase"
        beside = "fast peaks" if has_fast_peaks(model) else several
        beside = "a spring or damper that is a function" if model.functions else beside
        got = "a sine beside it" if model.sines else beside
        raise NotApplicable(
            "size",
            ["noise of varying level must be alone on one pair that hangs evenly, got "
             f"{got}; reliability gives the risk of a clearance"],
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class EqualRisk:
    """Clearances (places, pairs) at which each pair alone has the same of the `hazards` in the
    whole mission, the largest hazard first."""

    hazards: Vector
    places: Matrix

    @classmethod
    def around(
        cls, hazard: float, alone: Sequence[Joint], guesses: Sequence[float], shared: Sequence[int]
    ) -> EqualRisk:
        """Around the hazard of any impact that is wanted. That of each pair is at most the same,
        and at least its equal share. The pairs that are `shared` have the largest clearance of
        theirs in common."""
        most, least = RANGE * hazard, hazard / len(alone) / RANGE
        steps = math.ceil(math.log(most / least) / math.log(RISK_STEP))
        hazards = np.geomspace(most, least, steps + 1)
        places = np.array(
            [
                [joint.clearance(float(each), guess).value for each in hazards]
                for joint, guess in zip(alone, guesses, strict=True)
            ]
        )
        if shared:
            places[[*shared]] = places[[*shared]].max(axis=0)
        return cls(hazards, places.T)

    @property
    def widest(self) -> int:
        """Number of the pair with the largest clearance."""
        return int(np.argmax(self.places[len(self.places) // 2]))

    @cached_property
    def _clearances(self) -> scipy.interpolate.PchipInterpolator:
        return scipy.interpolate.PchipInterpolator(self.places[:, self.widest], self.places)

    @cached_property
    def _logarithms(self) -> scipy.interpolate.PchipInterpolator:
        return scipy.interpolate.PchipInterpolator(
            self.places[:, self.widest], np.log(self.hazards)
        )

    def held(self, place: float) -> float:
        """A clearance of the widest gap, or the nearest that is looked at."""
        low, high = self.places[[0, -1], self.widest]
        return float(min(max(place, low), high))

    def at(self, place: float) -> Vector:
        """The clearances of all pairs by that of the widest gap; beyond those that are looked at,
        in the same proportions."""
        held = self.held(place)
        return np.asarray(self._clearances(held) * place / held)

    def hazard(self, place: float) -> float:
        """The hazard of each pair alone by the clearance of the widest gap."""
        return math.exp(float(self._logarithms(self.held(place))))


@dataclass(frozen=True, eq=False)
class AnyPair:
    """The hazard that any pair is hit in a phase, against the clearance of the widest gap."""

    phase: PhaseOfPairs
    shared: EqualRisk
    total: TotalRisk | None = None
    curve: HazardCurve | None = None
    reached: float = 0.0

    def expected(self, clearance: float) -> float:
        """Rice's number of crossings."""
        return self.phase.expected(self.shared.at(clearance).tolist())

    def lag(self, clearance: float) -> float:
        """By how much, as a share, the hazard of what moves may be too large at a clearance."""
        gap = self.phase.gaps[0]
        return lag_of_hazard(self.expected, clearance, gap.model, gap.sweep_rate)

    def simulated(self, run: Run) -> AnyPair:
        """The same from first crossings of all gaps together, or pieces of their motion."""
        if self.phase.in_pieces:
            curve = self._of_pieces(run)
            return replace(self, curve=curve, reached=curve.reached)
        together = self.phase.gaps[0].together
        rows = np.full((2, *self.shared.places.shape), math.inf)
        for gap in self.phase.gaps:
            far = FAR * gap.sigma
            for side in gap.sides:
                distances = self.shared.places[:, gap.number] - side * gap.shift
                rows[int(side > 0.0), :, gap.number] = np.where(
                    distances < far, distances, math.inf
                )
        found: FirstCrossings = partial_result(together.crossings, *rows, self.phase.duration, run)
        chances = found.probability(self.phase.duration)
        return replace(
            self, total=TotalRisk.of(self.shared.hazards[::-1], chances[::-1]),
            reached=largest_error(found, self.phase.duration),
        )  # fmt: skip

    def _of_pieces(self, run: Run) -> HazardCurve:
        """The hazard by pieces of the motion."""
        gaps, duration = self.phase.gaps, self.phase.duration
        pieces = gaps[0].pieces
        assert pieces is not None
        places = np.linspace(0.0, FARTHEST_PLACE * self.shared.places.max(), PLACES)[1:]
        clearances = np.array([self.shared.at(each) for each in places])
        rows = np.stack([gap.distances(clearances[:, gap.number]) for gap in gaps], axis=2)
        kind = windows_over(pieces, places, rows, duration, run.seed)
        most, least = (float(each) for each in self.shared.hazards[[0, -1]])
        return hazard_curve(kind, most / RANGE, duration, run, most / least)

    def hazard(self, clearance: float) -> Hazard:
        """-ln(1 - P) at a clearance, and half its 95 % interval; beyond those that were looked at,
        the ratio to Rice's number is held constant."""
        if self.curve is not None:
            return self.curve.hazard(clearance)
        if self.total is None:
            return Hazard(self.expected(clearance))
        held = self.shared.held(clearance)
        known = self.total.at(self.shared.hazard(held))
        value, upper = (-math.log1p(-min(each, KNOWN)) for each in (known.value, known.upper))
        ratio = 1.0 if held == clearance else self.expected(clearance) / self.expected(held)
        return Hazard.within(ratio * value, ratio * (upper - value))


def any_pair(
    phases: Mapping[str, PhaseOfPairs], busy: Mapping[str, float], shared: EqualRisk, run: Run
) -> dict[str, HazardOfStops]:
    """The hazard that any pair is hit, of each phase."""
    found: dict[str, HazardOfStops] = {}
    known = {name: AnyPair(phase, shared) for name, phase in phases.items()}
    found.update(known)
    for name, part in parts_of_mission(run, busy):
        found[name] = known[name].simulated(part)
    return found


# ------------------------------------------------------------------------------
# The clearances of a mission of several phases: for all of them, at the risk of them together.
#
# Phases are independent and each starts in its own stationary motion, so that their hazards -ln(1 -
# P) add up. The hazard of a pair in a phase follows from its own curve of risk. Several pairs share
# the risk equally, and first crossings of all gaps together give the hazard that any is hit
# (`PhaseOfPairs`). A phase whose crossings by Rice's formula do not matter has no curve. Stops stay
# where they are while the mount of a phase is softer or carries another load: a phase that hangs
# lower has uneven distances.
# ------------------------------------------------------------------------------


IN_PIECES = (
    "pieces of the motion without stops are followed as they come, and a splitting finds how far "
    "they reach"
)
"""How the risk is found under a steady kurtosis, and on springs and dampers that are functions."""

HANGING = (
    "loads must be left out where a spring or damper is a function: it is not known where the "
    "mass hangs; let reliability judge the stops of the scene"
)
"""Why a clearance has no place to be measured from."""

FARTHEST_SIZED = 20.0
"""Clearance in the largest rms displacement of a phase beyond which Gaussian noise is never sized;
noise of varying level may be, by steps of as much."""


def size_mission(
    scene: Scene, target: Target, run: Run, common: Sequence[str] = ()
) -> MissionSizing:
    """The clearance of a scene with phases, see `size`."""
    if target.name != "probability":
        raise NotApplicable(
            "size",
            [f"the target must be a probability where the scene has phases, shocks, noise of "
             f"varying level, or springs that are functions, got {target.name}; size one phase, "
             "named as FILE.toml#PHASE; reliability then judges the mission; clearance counts the "
             "impacts on any mount"],
        )  # fmt: skip
    if differing := [key for key, _ in varied(scene)]:
        raise NotApplicable(
            "size",
            ["nothing may differ between units where the scene has phases, got "
             f"{differing[0]}; size one phase, named as FILE.toml#PHASE"],
        )  # fmt: skip
    phases = {phase.name: PhaseOfPairs.of(phase, scene) for phase in scene.phases}
    hazard = -math.log1p(-target.value)
    names = [each.name for each in model_of(as_stated(scene)).pairs] or ["stops"]
    gaps = [[phase.gaps[number] for phase in phases.values()] for number in range(len(names))]
    loudest = [max(gap.sigma for gap in each) for each in gaps]
    if still := unshaken(dict(zip(names, loudest, strict=True))):
        raise NotApplicable("size", still)
    guesses = [_guess(each, hazard) for each in gaps]
    felt = _felt(phases, {name: phase.expected(guesses) for name, phase in phases.items()})
    busy = {name: phases[name].duration for name in felt}
    several, steps = len(names) > 1, steps_of_bands(scene.phases)
    late = run.deadline.share(SHARE_OF_CURVES) if several else run.deadline
    first = run.part(0.0, SHARE_OF_CURVES if several else 1.0, deadline=late)
    for name, part in parts_of_mission(first, busy):
        phases[name] = phases[name].simulated(target, part, _gaps_felt(phases, name, guesses))
    alone = [
        Joint({name: phase.gaps[k] for name, phase in phases.items()}, steps)
        for k in range(len(names))
    ]
    joint, guess, widest = alone[0], guesses[0], 0
    at: Callable[[float], Vector] = np.atleast_1d
    if several:
        shared = EqualRisk.around(hazard, alone, guesses, [names.index(each) for each in common])
        widest, at = shared.widest, shared.at
        joint = Joint(any_pair(phases, busy, shared, run.part(SHARE_OF_CURVES, 1.0)), steps)
        guess = float(np.median(shared.places[:, widest]))
    clearance = joint.clearance(hazard, guess)
    ends = np.transpose([at(each) for each in (clearance.value, clearance.lower, clearance.upper)])
    needed = {
        name: Joint({name: joint.phases[name]}).clearance(hazard, guess).value for name in busy
    }
    table = _table(phases, joint, clearance.value, widest, needed)
    idle = {row["phase"]: row["share"] for row in rows_of(table) if row["phase"] not in busy}
    return MissionSizing(
        scene=scene, target=target, mission=sum(phase.duration for phase in phases.values()),
        clearances={
            name: Clearance(value=value, lower=lower, upper=upper)
            for name, (value, lower, upper) in zip(names, ends.tolist(), strict=True)
        },
        phases=table,
        curve=joint.curve(clearance.value),
        assumptions=(
            *([INDEPENDENT] if len(phases) > 1 else []),
            *spoken_lags({name: each.scene for name, each in phases.items()}, scene.phases),
            *([FOLLOWED] if any(each.scene.random_level for each in phases.values()) else []),
            *([IN_PIECES] if any(each.in_pieces for each in phases.values()) else []),
            *(f"phase {name} adds less than {_limit(share)} to the risk; Rice's formula bounds it"
              for name, share in idle.items()),
            *(
                f"phase {name}: {note}"
                for name in busy
                for note in scene_notes(model_of(phases[name].scene))
            ),
        ),
        records={
            name: verdict
            for name, phase in phases.items()
            if (verdict := record_verdict(phase.scene)) is not None
        },
        warnings=joint.short(run.accuracy), cost=run.cost(),
        provenance=provenance(scene.document(), run.seed),
    )  # fmt: skip


def _limit(share: float) -> str:
    """A limit of a small share with one digit, in per cent."""
    digit = 10.0 ** math.floor(math.log10(max(share, TINY)))
    return spoken_percent((math.floor(share / digit) + 1.0) * digit)


TINY = 1e-12
"""Smallest share of a risk that is told, as no noise is Gaussian as far as that."""


def _table(
    phases: Mapping[str, PhaseOfPairs], joint: Joint, place: float, widest: int,
    needed: Mapping[str, float],
) -> DataFrame:  # fmt: skip
    """The table of `MissionSizing.phases` at a clearance of the widest gap, with the one that a
    phase alone needs where it is known."""
    total = joint.hazard(place).value
    rows = []
    for name, phase in phases.items():
        own = joint.phases[name].hazard(place).value
        gap = phase.gaps[widest]
        rows.append(
            {"phase": name, "duration": phase.duration, "displacement_std": gap.sigma,
             "shift": gap.shift, "probability": -math.expm1(-own), "share": own / total,
             "clearance": needed.get(name, math.nan)}
        )  # fmt: skip
    return frame_of(rows)


def _guess(gaps: Sequence[GapInPhase], hazard: float) -> float:
    """The clearance of a pair with these gaps in the phases that is crossed so often in the
    mission, by Rice's formula."""
    nearest = max(abs(gap.shift) for gap in gaps)
    step = FARTHEST_SIZED * max(gap.sigma for gap in gaps)

    def excess(place: float) -> float:
        return sum(gap.expected(place) for gap in gaps) - hazard

    farthest = nearest + step
    while excess(farthest) > 0.0:
        farthest += step
    return float(scipy.optimize.brentq(excess, nearest, farthest))


def _felt(phases: Mapping[str, PhaseOfPairs], expected: Mapping[str, float]) -> list[str]:
    """The phases whose expected crossings matter; they are not known under fast peaks."""
    most = max(expected.values())
    return [
        name
        for name, each in expected.items()
        if each > NEGLIGIBLE * most or phases[name].in_pieces
    ]


def _gaps_felt(
    phases: Mapping[str, PhaseOfPairs], phase: str, guesses: Sequence[float]
) -> list[bool]:
    """Whether the crossings of each gap in a phase matter beside those in the other phases."""
    return [
        phase
        in _felt(phases, {name: each.gaps[number].expected(guess) for name, each in phases.items()})
        for number, guess in enumerate(guesses)
    ]


# ------------------------------------------------------------------------------
# The smallest clearances at which stops multiply the damage of equipment by no more than a ratio.
#
# Stops of several pairs are equally far in rms motions of their gaps. What stops add to the damage
# falls with the clearance as their impacts do: the logarithm of the ratio less 1 is nearly straight
# in the square of the clearance. Every clearance that is tried has the same random numbers.
# ------------------------------------------------------------------------------


FIRST_SIGMA, LEAST_SIGMA = 3.5, 0.5
"""The first clearance that is tried and the smallest one, in rms displacements."""

MOST_TRIALS = 12
"""Largest number of clearances that are tried."""

NEAR = 0.2
"""Logarithm of the added damage over the accepted one from which the clearance is extrapolated."""

MOST_UNKNOWN = 0.35
"""Largest relative standard error of a damage ratio from which a clearance is told: it is that of
the mean of eight records of which one brings nearly all."""

LEAST_ADDED = 1e-6
"""Added damage that counts as none, over that without stops."""

LONGEST_STEP = 3.0
"""Largest change of the logarithm of the added damage that a step of the search aims at."""


class _Trial(NamedTuple):
    """Damage at a clearance, of several pairs that of the widest gap.

    `excess` is the logarithm of what stops add over what they may, `half` half its 95 % interval.
    It is `reached` where it is as accurate as asked for. It is `known` also where it is not, if its
    impacts were seen often enough: a few fast ones bring nearly all of the damage."""

    clearance: float
    found: Damage
    excess: float
    half: float
    reached: bool
    known: bool

    @property
    def worst(self) -> int:
        """Number of the frequency with the largest ratio."""
        assert self.found.damage_ratio is not None
        return int(np.argmax(self.found.damage_ratio.value))


@calculation
@sampled(rel_error=0.1)
def size_by_damage(
    scene: Scene,
    *,
    ratio: float = 2.0,
    mission: float = 3600.0,
    equipment: Sequence[float] | Vector = (20.0, 2000.0),
    q: float = 10.0,
    exponent: float = 6.0,
    at: str | None = None,
    **options: Unpack[AccuracyOptions],
) -> DamageSizing:
    """The smallest clearance at which stops keep the damage of equipment below a ratio.

    Parameters
    ----------
    scene
        A linear structure under stationary Gaussian noise between stops, whose laws are kept; their
        places are not. Several pairs get equal clearances in rms motions of their gaps.
    ratio
        Largest accepted damage with stops over that without, at all frequencies of the equipment.
    mission
        Duration, s.
    equipment, q, exponent, at
        As for `damage`.
    **options
        `AccuracyOptions`: `rel_error` is the median relative standard error of the damage at every
        clearance, by default 0.1.

    Returns
    -------
    DamageSizing
        The clearance of each pair, its interval, and the clearances that were tried.

    Raises
    ------
    NotApplicable
        If the scene is not covered, or any clearance keeps the ratio.
    NotConverged
        If time ends first.

    See Also
    --------
    stochvi.damage : The damage of a scene as it stands.
    stochvi.size : The clearance for a risk.

    Examples
    --------
    >>> from stochvi import ImpactPair, Isolator, TabulatedNoise, Viscoelastic
    >>> law = Viscoelastic(stiffness=2e5, damping_ratio=0.2)
    >>> truck = TabulatedNoise(profile="mil-std-810h-truck-vertical-5hz")
    >>> mount = Isolator(frequency_hz=12.0, zeta=0.1, mass=1.0)
    >>> stops = ImpactPair(lower=-4e-3, upper=4e-3, law=law)
    >>> scene = Scene(structure=mount, impact_pairs=[stops], excitations=[truck])
    >>> found = size_by_damage(scene, ratio=2.0, equipment=[100.0], rel_error=0.3)
    >>> bool(3.0 < found.clearance.value / found.sigma < 6.0)
    True
    """
    if not 1.0 < ratio < math.inf:
        raise ValueError(f"ratio must be above 1, got {ratio}; stops add to the damage")
    model, run = model_of(scene), Run.of(options)
    unmet = modulated(model) + nonlinear(model)
    if model.signals:
        got = "a sine" if model.sines else "filtered noise"
        unmet.append(f"excitation must be white noise, a density or constant, got {got}")
    if not unmet and not model.pairs:
        unmet = ["damage_ratio needs an impact_pair, for its law"]
    if unmet:
        raise NotApplicable("size", unmet)
    names = [pair.name for pair in model.pairs]
    sigmas, _ = free_motion(model).deviations(np.array([pair.direction for pair in model.pairs]))
    if still := unshaken(dict(zip(names, sigmas.tolist(), strict=True))):
        raise NotApplicable("size", still)
    sigma = float(sigmas.max())
    shares = sigmas / sigma

    def tried_at(place: float, number: int) -> _Trial:
        done = number / MOST_TRIALS
        share = run.deadline.share(1.0 / max(MOST_TRIALS // 2 - number, 2))
        part = run.part(done, done + 1.0 / MOST_TRIALS, f"{1e3 * place:.4g} mm", share)
        try:
            found = damage(
                at_clearances(scene, place * shares), mission=mission, equipment=equipment, q=q,
                exponent=exponent, at=at, **part.options(rel_error=run.accuracy),
            )  # fmt: skip
        except (NotConverged, Interrupted) as reason:
            if reason.partial is None:
                raise
            return _trial(place, reason.partial, ratio, False)
        return _trial(place, found, ratio, True)

    trials, slope = _search(tried_at, sigma, run)
    nearest = min(trials, key=lambda trial: (not trial.known, abs(trial.excess)))
    least = LEAST_SIGMA * sigma
    value = math.sqrt(max(nearest.clearance**2 - nearest.excess / slope, least**2))
    half = nearest.half / abs(2.0 * nearest.clearance * slope)
    if abs(nearest.excess) > NEAR:  # as far as nothing was seen
        half += abs(value - nearest.clearance)
    rows = [
        {"clearance": each.clearance, "damage_ratio": ratios.value[each.worst],
         "standard_error": ratios.standard_error[each.worst],
         "frequency_hz": each.found.equipment_frequency_hz[each.worst], "by": each.found.way}
        for each in sorted(trials, key=lambda trial: trial.clearance)
        if (ratios := each.found.damage_ratio) is not None
    ]  # fmt: skip
    ends = np.outer(shares, [value, max(value - half, 0.0), value + half]).tolist()
    clearances = {
        name: Clearance(value=place, lower=low, upper=high)
        for name, (place, low, high) in zip(names, ends, strict=True)
    }
    answer = DamageSizing(
        scene=scene, ratio=ratio, mission=mission, sigma=sigma, clearances=clearances,
        tried=frame_of(rows), damage=nearest.found, record=record_verdict(scene),
        warnings=[*nearest.found.warnings, *scene.at_means()],
        cost=run.cost(), provenance=provenance(scene.document(), run.seed),
    )  # fmt: skip
    if abs(nearest.excess) > NEAR or not nearest.reached:
        raise run.deadline.fell_short(
            f"before a ratio near {ratio:g} was known ({len(trials)} clearances tried)",
            "raise budget", answer if nearest.known else None,
        )  # fmt: skip
    return answer


def _trial(place: float, found: Damage, ratio: float, reached: bool) -> _Trial:
    ratios = found.damage_ratio
    if ratios is None:
        raise NotApplicable(
            "size", ["the motion without stops must be stationary, to compare the damage with"]
        )
    worst = max(ratios.estimates(), key=lambda each: each.value)
    added = max(worst.value - 1.0, LEAST_ADDED)
    excess = math.log(added / (ratio - 1.0))
    hits = found.impacts_per_hour
    seen = hits is None or hits.upper_95 is None
    known = reached or (seen and worst.standard_error <= MOST_UNKNOWN * worst.value)
    return _Trial(place, found, excess, worst.half_width_95() / added, reached, known)


def _search(tried_at: Any, sigma: float, run: Run) -> tuple[list[_Trial], float]:
    """The clearances that were tried, and the slope of the excess over the square of the
    clearance."""
    place, slope = FIRST_SIGMA * sigma, -1.0 / (2.0 * sigma**2)
    trials: list[_Trial] = []
    for number in range(MOST_TRIALS):
        if trials and run.deadline.passed():
            break
        trial = tried_at(place, number)
        trials.append(trial)
        above = [each for each in trials if each.excess > 0.0]
        below = [each for each in trials if each.excess <= 0.0]
        if above and below:
            low = max(above, key=lambda each: each.clearance)
            high = min(below, key=lambda each: each.clearance)
            if high.clearance > low.clearance and high.excess > math.log(LEAST_ADDED):
                slope = (high.excess - low.excess) / (high.clearance**2 - low.clearance**2)
        if abs(trial.excess) <= NEAR:
            break
        step = max(min(trial.excess, LONGEST_STEP), -LONGEST_STEP)
        square = max(place**2 - step / slope, (LEAST_SIGMA * sigma) ** 2)
        if above and below:
            ends = low.clearance**2, high.clearance**2
            square = min(max(square, 0.9 * ends[0] + 0.1 * ends[1]), 0.1 * ends[0] + 0.9 * ends[1])
        elif trial.excess < 0.0 and place <= LEAST_SIGMA * sigma * 1.01:
            raise NotApplicable(
                "size", [f"ratio must be smaller: {LEAST_SIGMA:g} rms displacements keep it"]
            )
        place = math.sqrt(square)
    return trials, slope


# ------------------------------------------------------------------------------
# `size`: the clearance that an isolator needs, with a stated risk and within its tolerances.
# ------------------------------------------------------------------------------


HOUR = 3600.0
"""The mission where none is given, s."""

MISSION = "mission"
"""Name of the only phase of a mission whose noise is not Gaussian, or beside shocks."""


@calculation
@sampled(rel_error=0.05)
def size(
    scene: Scene,
    *,
    probability: float | None = None,
    rate: float | None = None,
    exceedance: float = ACCEPTED,
    at: str | None = None,
    pair: str | None = None,
    common: Sequence[str] = (),
    tolerances: Tolerances | None = None,
    spreads: Mapping[str, Spread] | None = None,
    mission: float | None = None,
    **options: Unpack[RiskOptions],
) -> Sizing | MissionSizing:
    """The clearance per side that an isolator, or each of several pairs, needs for one target.

    Parameters
    ----------
    scene
        One oscillator under stationary Gaussian noise, or a linear structure with any number of
        pairs. For a probability the noise on one oscillator may vary in level, and noise may have
        fast peaks. Shocks of a shape may come at random times beside noise. The laws of the stops
        are kept, their places are not: they go to equal distances from the static equilibrium,
        where the mass hangs.
    probability
        Probability of any impact in the mission. Needs no stops.
    rate
        Impacts per second on both stops.
    exceedance
        Accepted probability that the hardest impact of a mission exceeds the limit.
    at
        The coordinate, or the named point, whose acceleration is limited; by default every
        coordinate that is a length.
    pair
        The one of several pairs whose clearance is searched for; the stops of the others stay where
        they are. By default all pairs share the risk equally: each alone would be hit with the same
        probability.
    common
        Names of pairs that are made with one clearance in common, which is found for all of them.
    tolerances
        Tolerances within all of which the clearance to make keeps the target; by default those
        that the scene states (`Tolerances.of`), which may be none.
    spreads
        Distributions of tolerances between the units of a production, as `production` takes them:
        the clearance to make then keeps the probability for the mean over the units. By default
        what the scene states (`stochvi.BetweenUnits`).
    mission
        Seconds of exposure, from a stationary start, by default an hour; left out where the scene
        has phases, which are sized for a probability.
    **options
        `RiskOptions`: a limit of the hardest impact of the mission as the target, which is to be
        exceeded with the probability `exceedance` alone; `rel_error` is that of the risk
        (probability, rate) at the clearance, by default 0.05. Where the `budget` ends first, the
        interval of a probability or of a rate is wider, and a warning says so.

    Returns
    -------
    Sizing | MissionSizing
        The clearance, its interval and its evidence; with several pairs, for each of them; with
        phases, for all of them together.

    Raises
    ------
    NotApplicable
        If the scene is not covered, or no clearance keeps the target.
    NotConverged
        If the rate of impacts beyond a limit does not reach `rel_error` in the
        budget, or if impact clusters do not end. After Ctrl-C it is `Interrupted`. `partial` holds
        the `Sizing` with the clearance reached by then.

    See Also
    --------
    stochvi.screen : The linear answer.
    stochvi.reliability : The probability that a mission goes wrong.

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
    target = target_of(probability, rate, limits_in(options), exceedance)
    run = Run.of(options)
    if not scene.phases and is_one_phase(scene):
        whole = Phase(name=MISSION, duration=HOUR if mission is None else mission)
        scene, mission = scene.replace(phases=[whole]), None
    if scene.phases:
        return _of_phases(
            scene, target, mission, run, at=at, pair=pair, tolerances=tolerances,
            spreads=spreads or None, common=common,
        )  # fmt: skip
    if spreads is None and any(varied(scene)):
        from stochvi.isolators.tolerances import spreads_of

        spreads = spreads_of(scene)
    mission = HOUR if mission is None else mission
    if not 0.0 < mission < math.inf:
        raise ValueError(f"mission must be a positive number of seconds, got {mission}")
    model = model_of(scene)
    _check_names(scene, "pair", [pair] if pair is not None else [])
    _check_names(scene, "common", common)
    if common and pair is not None:
        raise ValueError(f"common must be left out where one pair is sized, got pair = {pair!r}")
    if spreads:
        shape = Question(target=target, mission=mission, pair=pair, common=common, run=run)
        return _of_production(scene, shape, spreads, tolerances)
    allowed = tolerances or Tolerances.of(scene)
    by_hits = target.name != "probability"
    worst = has_one_gap(model) and allowed.felt(scene, by_hits=by_hits) != Tolerances()
    nominal = run
    if worst:
        share = 1.0 - SEARCH.share_of_tolerances
        nominal = run.part(0.0, share, deadline=run.deadline.share(share))
    asked = Question(
        target=target, mission=mission, run=nominal, at=at, pair=pair, common=common,
        tolerances=allowed,
    )  # fmt: skip
    found = nominal_sizing(scene, asked)
    return _within_tolerances(found, run) if worst else found


def is_one_phase(scene: Scene) -> bool:
    """Whether a scene without phases is sized as a mission of one phase. Its noise varies in level
    or has fast peaks, shocks come beside it, or a spring or damper is a function."""
    level, shocks = scene.random_level, scene.has_shocks
    return level is not None or shocks or is_followed(model_of(scene))


def _check_names(scene: Scene, name: str, given: Sequence[str]) -> None:
    """Raise `ValueError` where an argument names what is no impact pair of a scene."""
    names = [each.name for each in scene.expanded.impact_pairs]
    if not {*given} <= {*names}:
        known = ", ".join(names) or "none"
        raise ValueError(f"{name} must name impact pairs ({known}), got {', '.join(given)}")


def _of_production(
    scene: Scene, asked: Question, spreads: Mapping[str, Spread], tolerances: Tolerances | None
) -> Sizing:
    """A sizing of the scene as stated, with the clearance that its production needs."""
    from stochvi.isolators.production_risk import SHARE_OF_NOMINAL, Start, about
    from stochvi.isolators.tolerances import bands_beside, check_spreads

    check_spreads(scene, spreads)
    run, name = asked.run, asked.target.name
    if name != "probability":
        raise NotApplicable(
            "size",
            [f"the target must be a probability of any impact where tolerances have a "
             f"distribution, got {name}; give them as limits, as frequency=5%, or leave out what "
             "differs between units in the scene"],
        )  # fmt: skip
    share = SHARE_OF_NOMINAL
    first = run.part(0.0, share, deadline=run.deadline.share(share))
    found = nominal_sizing(scene, replace(asked, run=first, tolerances=Tolerances()))
    allowed = tolerances or bands_beside(scene, spreads)
    production = about(Start.of_sizing(found), spreads, allowed, run.part(share, 1.0))
    return replace(
        found,
        production=production,
        fell_short=(*found.fell_short, *production.warnings),
        warnings=(*found.warnings, *production.warnings),
        cost=replace(found.cost, wall_time=run.cost().wall_time),
    )


def _of_phases(
    scene: Scene, target: Target, mission: float | None, run: Run, common: Sequence[str],
    **others: object,
) -> MissionSizing:  # fmt: skip
    """The sizing of a scene with phases; refuses arguments that are not for phases."""
    for name, value in {"mission": mission, **others}.items():
        if value is not None:
            raise ValueError(
                f"{name} must be left out where the scene has phases, shocks, noise of varying "
                f"level, or springs that are functions, got {value}"
            )
    _check_names(scene, "common", common)
    try:
        found = size_mission(scene, target, run, common)
    except NotApplicable as reason:
        # the user called `size`, whatever function it came from
        raise NotApplicable("size", reason.conditions) from reason
    if found.warnings:
        raise run.deadline.fell_short(found.warnings[0], "raise budget or rel_error", found)
    return found


def _within_tolerances(found: Sizing, run: Run) -> Sizing:
    """A sizing with the worst case within its tolerances."""
    late = run.part(
        1.0 - SEARCH.share_of_tolerances, deadline=run.deadline.in_no_less_than(LEAST_SECONDS)
    )
    table = worst_case(found, found.allowed, **late.work())
    worst = table.iloc[-1]
    short = []
    if worst["note"]:
        lack = "was not found" if math.isnan(worst["clearance"]) else "is rough"
        short = [f"the largest clearance within the tolerances {lack}: {worst['note']}"]
    return replace(
        found,
        worst_case=table,
        fell_short=(*found.fell_short, *short),
        warnings=(*found.warnings, *short),
        cost=replace(found.cost, wall_time=run.cost().wall_time),
    )
