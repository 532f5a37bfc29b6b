"""`size`: the clearance that an isolator needs. Chapters: the hazard against the place of stops,
for a phase and for several together; a mission of several phases; a limit on the damage of
equipment; `size` itself, with tolerances."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple, Unpack

import numpy as np
import scipy

from stochvi.isolators.record_verdict import record_verdict
from stochvi.isolators.screening import at_clearances, check_movable
from stochvi.isolators.sizing.answer import (
    Clearance,
    DamageSizing,
    Question,
    Sizing,
    Target,
    as_stated,
)
from stochvi.isolators.sizing.pairs import (
    RISK_STEP,
    SHARE_OF_CURVES,
    SIDES,
    check_names,
    has_one_gap,
    levels_of_gap,
    nominal_sizing,
)
from stochvi.isolators.sizing.risk_curve import ACCEPTED, target_of
from stochvi.isolators.sizing.search import SEARCH
from stochvi.isolators.sizing.sensitivity import LEAST_SECONDS, worst_case
from stochvi.isolators.tolerances import (
    WORST,
    Changes,
    Region,
    Tolerances,
    all_applied,
    ends_of,
    worded,
    worst_within,
)
from stochvi.mathematics.numerics import Matrix, Vector
from stochvi.mathematics.units import LENGTH, power_ratio
from stochvi.mathematics.unsteady_noise import RandomLevel
from stochvi.model.coverage import free_motion, modulated, nonlinear, scene_notes, unshaken
from stochvi.model.model import Model, model_of
from stochvi.results.base import DataFrame, frame_of, rows_of
from stochvi.results.deadline import decisions_of_the_clock, partial_result
from stochvi.results.errors import Interrupted, NotApplicable, NotConverged
from stochvi.results.estimates import provenance, spoken_percent
from stochvi.sampling.calculations import AccuracyOptions, calculation
from stochvi.sampling.run import Run, sampled
from stochvi.scenes.excitations.drawn import Pulses
from stochvi.scenes.phases import Phase, steps_of_bands
from stochvi.scenes.scene import Scene
from stochvi.scenes.validation import varied
from stochvi.statistics.crossings import FirstCrossings, PairMotion, one_gap, rice_rate
from stochvi.statistics.free_flights import is_followed, linearised, windows_over
from stochvi.statistics.hardness import limits_in
from stochvi.statistics.hazards import KNOWN, Hazard, HazardCurve, joined, place_of, slope_of
from stochvi.statistics.mission_parts import INDEPENDENT, parts_of_mission
from stochvi.statistics.reliability.missions import (
    FOLLOWED,
    NEGLIGIBLE,
    RiskOptions,
    felt_by,
    lag_of,
    spoken_lags,
)
from stochvi.statistics.trial_splitting import DEPTH, has_fast_peaks, hazard_curve

if TYPE_CHECKING:
    from stochvi.isolators.tolerances import Spread
    from stochvi.statistics.damage import Damage


# ------------------------------------------------------------------------------
# The hazard of a phase of a mission against the place of stops.
#
# The stops of all gaps go farther as one number rises: the clearance of a gap whose pair alone has
# stops, or that of the widest gap, where pairs share the risk equally. Their clearances are then
# those at which each alone would be hit in the whole mission with the same probability.
# ------------------------------------------------------------------------------


FARTHEST = 100.0
"""Largest clearance of a curve under noise with fast peaks, in rms displacements of the gap."""

RANGE = 20.0
"""Factor by which the risks that are looked at reach beyond those of possible answers."""

FARTHEST_PLACE, PLACES = 4.0, 401
"""Largest clearance that pieces of the motion under noise with fast peaks tell, over the largest
that is looked at. All clearances are linear between so many up to it."""

NEAREST = 0.2
"""The nearest place that a changed mount may have over the nearest one that was simulated."""

LEAST = 1e-300
"""Smallest hazard, of which a logarithm is taken."""

FAR = 30.0
"""Distance of a stop, in rms motions of its gap, beyond which it is left out: noise crosses it with
a probability of 1e-195."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PhaseMotion:
    """A phase, and the motion of all gaps in it without stops. Lengths in m.

    Parameters
    ----------
    scene, model
        Those of the phase.
    motion
        The motion of all gaps.
    shifts
        (pairs,): how much farther up each gap hangs than in the mount as stated.
    sides
        The sides on which each pair has a stop.
    pieces
        The model of all gaps where pieces of its motion are followed (`is_followed`), else None.
    gain
        By how much all that shakes is larger than in the model.
    """

    scene: Scene
    model: Model
    motion: PairMotion
    duration: float
    shifts: Vector
    sides: tuple[tuple[float, ...], ...]
    sweep_rate: float
    pieces: Model | None
    gain: float = 1.0

    @classmethod
    def of(cls, phase: Phase, whole: Scene, made_for: Scene | None = None) -> PhaseMotion:
        """A phase of a scene; `NotApplicable` where its motion without stops is not covered. Stops
        are where they are made for, by default this scene."""
        scene = phase.of(whole)
        model = model_of(scene)
        if conditions := modulated(model):
            raise NotApplicable("size", [f"{each} (in phases)" for each in conditions])
        if model.functions and np.any(model.constant_force):
            raise NotApplicable("size", HANGING)
        motion = _motion_of(model)
        stated = model_of(as_stated(made_for or whole))
        shifts = np.subtract(*(_mean_gaps(each) for each in (model, stated)))
        if model.level is not None:
            _check_level(model, shifts)
        return cls(
            scene=scene, model=model, motion=motion, duration=phase.duration, shifts=shifts,
            sweep_rate=phase.sweep_rate,
            pieces=replace(model, level=None, pairs=motion.model.pairs)
            if is_followed(replace(model, level=None)) else None,
            sides=tuple(
                tuple(float(stop.side) for stop in pair.stops) or SIDES
                for pair in model.pairs or motion.model.pairs
            ),
        )  # fmt: skip

    def changed(self, model: Model, motion: PairMotion, gain: float) -> PhaseMotion:
        """The phase on a changed mount, with its motion, and all that shakes larger by a gain; the
        stops stay where they are."""
        shifts = self.shifts + _mean_gaps(model) - _mean_gaps(self.model)
        return replace(self, model=model, motion=motion, shifts=shifts, gain=gain)

    @property
    def sigma(self) -> Vector:
        """(pairs,): rms of each gap, sines included."""
        return self.gain * np.asarray(self.motion.displacement_std)

    @property
    def level_time(self) -> float:
        """Time for which a varying level is taken to stay; the duration where none varies."""
        level = self.model.level
        return self.duration if level is None else min(self.duration, level.time)

    def distances(self, clearances: Matrix) -> Vector:
        """(2, places, pairs): distances of the lower and the upper stops from the mean gaps, at
        clearances (places, pairs); infinite for none."""
        found = np.full((2, *clearances.shape), math.inf)
        for pair, (shift, sides) in enumerate(zip(self.shifts, self.sides, strict=True)):
            for side in sides:
                found[int(side > 0.0), :, pair] = clearances[:, pair] - side * shift
        return found

    def crossings(self, clearances: Vector, gain: float = 1.0) -> float:
        """Rice's rate of crossings of all stops, 1/s, under noise that is louder by a gain."""
        stops = self.distances(clearances[None])[:, 0]
        return rice_rate(self.motion.motions, stops, gain * self.gain)

    def expected(self, clearances: Vector) -> float:
        """Rice's number of crossings; where the level varies, the hazard that follows from it."""
        level = self.model.level
        if level is None:
            return self.duration * self.crossings(clearances)
        rates = np.array([self.crossings(clearances, gain) for gain in level.gains])
        return self.varying(rates, level)

    def varying(self, rates: Vector, level: RandomLevel) -> float:
        """-ln(1 - P) of a hazard with these rates at the gains of a level."""
        chance = level.probability(rates, self.duration)
        return -math.log1p(-min(chance, KNOWN))


def _motion_of(model: Model) -> PairMotion:
    """The motion of all gaps of a model at a steady level."""
    linear = linearised(replace(model, level=None))
    return PairMotion.under_shocks(one_gap(linear) if has_one_gap(model) else linear)


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
            "noise of varying level must be alone on one pair that hangs evenly, got "
            f"{got}; reliability gives the risk of a clearance",
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class HazardInPhase:
    """The hazard of any impact in a phase, against the place of the stops.

    Parameters
    ----------
    clearances
        (pairs,): the clearances at a place, infinite for pairs without stops.
    curve
        What was simulated, where the level varies at the level 0 dB in the time of the level; None
        where crossings count by Rice's formula.
    like
        Of a changed mount, the hazard on the mount as stated, which it has where its stops are
        crossed as often; None where nothing is changed.
    """

    phase: PhaseMotion
    clearances: Callable[[float], Vector]
    curve: HazardCurve | None = None
    like: HazardInPhase | None = None

    @classmethod
    def alone(cls, phase: PhaseMotion, pair: int) -> HazardInPhase:
        """That of one pair, as if it alone had stops: its place is its clearance."""
        own = np.arange(len(phase.sides)) == pair
        return cls(phase=phase, clearances=lambda place: np.where(own, place, math.inf))

    def expected(self, place: float) -> float:
        """Rice's number of crossings at a place."""
        return self.phase.expected(self.clearances(place))

    def lag(self, place: float) -> float:
        """By how much, as a share, the hazard of what moves may be too large at a place."""
        rate = self.phase.sweep_rate
        known = self.expected(place) if rate else 0.0
        if not known:
            return 0.0
        return self.expected(place / (1.0 + lag_of(self.phase.model, rate))) / known - 1.0

    def simulated(self, places: Vector, run: Run) -> HazardInPhase:
        """The same from first crossings of all gaps together at some places."""
        phase, time = self.phase, self.phase.level_time
        rows = self._rows(places)
        if phase.motion.shocks is None:
            rows = np.where(rows < FAR * phase.sigma, rows, math.inf)
        found: FirstCrossings = partial_result(phase.motion.crossings, *rows, time, run)

        def expected(place: float) -> float:
            return time * phase.crossings(self.clearances(place))

        return replace(self, curve=found.hazards(places, time, expected))

    def in_pieces(
        self, places: Vector, hazard: float, run: Run, depth: float = DEPTH
    ) -> HazardInPhase:
        """The same around a hazard, from pieces of the motion that reach places."""
        phase, rows = self.phase, self._rows(places).transpose(1, 0, 2)
        assert phase.pieces is not None
        kind = windows_over(phase.pieces, places, rows, phase.duration, run.seed)
        return replace(self, curve=hazard_curve(kind, hazard, phase.duration, run, depth))

    def _rows(self, places: Vector) -> Vector:
        return self.phase.distances(np.array([self.clearances(float(each)) for each in places]))

    @cached_property
    def _place_crossed(self) -> scipy.interpolate.PchipInterpolator:
        """The square of the place over the logarithm of the crossings that are expected there."""
        assert self.curve is not None
        nearest, farthest = self.curve.ends
        least = max(np.abs(self.phase.shifts).max(), NEAREST * nearest)
        places = np.linspace(least, FARTHEST_PLACE * farthest, PLACES)[1:]
        logs = np.log(np.maximum([self.expected(each) for each in places], LEAST))
        # sums over a net of shocks may rise a little: only what falls below all before is taken
        falling = logs < np.minimum.accumulate(np.append(math.inf, logs[:-1]))
        return scipy.interpolate.PchipInterpolator(-logs[falling], places[falling] ** 2)

    def crossed(self, expected: float) -> Hazard:
        """The hazard at the place where so many crossings are expected."""
        square = self._place_crossed
        log = -math.log(max(expected, LEAST))
        return self.hazard(math.sqrt(square(min(max(log, square.x[0]), square.x[-1]))))

    def hazard(self, place: float) -> Hazard:
        """-ln(1 - P) at a place, and half its 95 % interval."""
        if self.curve is None:
            return Hazard(self.expected(place))
        if self.like is not None:
            return self.like.crossed(self.expected(place))
        level = self.phase.model.level
        if level is None:
            return self.curve.hazard(place)
        value, upper = self._of_level(self.curve, place, level)
        felt, _ = self._of_level(self.curve, place, felt_by(self.phase.model))
        return Hazard.within(value, upper - value + abs(felt - value))

    def _of_level(
        self, curve: HazardCurve, place: float, level: RandomLevel
    ) -> tuple[float, float]:
        """The hazard at a place while the level varies, and the upper end of its interval."""
        known = [curve.hazard(each) for each in place / level.gains]
        ends = np.array([(each.value, each.value + each.half) for each in known]).T / curve.mission
        value, upper = (self.phase.varying(each, level) for each in ends)
        return value, upper

    @property
    def reached(self) -> float:
        """Largest relative standard error of the probabilities of the curve; 0 without one."""
        return 0.0 if self.curve is None else self.curve.reached


# ------------------------------------------------------------------------------
# The hazard of several phases together, and where it has a value.
# ------------------------------------------------------------------------------


BUDGET_ENDED = "the budget ended "
"""Beginning of sentences on what the budget ended."""

POINTS, AROUND = 41, 0.35
"""Number of clearances of the curve of an answer, and how far it reaches from the clearance that
was found, as a share of it."""


@dataclass(frozen=True)
class Joint:
    """The hazard of several phases together."""

    phases: Mapping[str, HazardInPhase]
    steps: Sequence[Sequence[str]] = ()

    def hazard(self, place: float) -> Hazard:
        """The sum of the hazards, with the bias of the steps of moving bands."""
        parts = {name: each.hazard(place) for name, each in self.phases.items()}
        lags = {name: each.lag(place) for name, each in self.phases.items()}
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
                raise NotApplicable("size", "probability must be smaller: any clearance keeps it")
        while excess(high) > 0.0:
            high += step
        value = place_of(excess, 0.0, low, high)
        there = self.hazard(value)
        reach = there.half / there.value / abs(slope_of(excess, value, 1e-3 * guess))
        return Clearance(value=value, lower=value - reach, upper=value + reach)

    def curve(self, place: float) -> DataFrame:
        """The table of `Sizing.curve`."""
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
                    f"{BUDGET_ENDED}at a relative error of {reached:.3g} of the probability of an "
                    f"impact in phase {name}"
                )
        return found


@dataclass(frozen=True, eq=False)
class EqualRisk:
    """Clearances (places, pairs) at which each pair alone has the same of some hazards in the whole
    mission, the largest hazard first; `depth` is that over the smallest."""

    places: Matrix
    depth: float

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
        return cls(places.T, most / least)

    @property
    def widest(self) -> int:
        """Number of the pair with the largest clearance."""
        return int(np.argmax(self.places[len(self.places) // 2]))

    @property
    def of_widest(self) -> Vector:
        """The clearances of the widest gap, rising."""
        return self.places[:, self.widest]

    @cached_property
    def _clearances(self) -> scipy.interpolate.PchipInterpolator:
        return scipy.interpolate.PchipInterpolator(self.of_widest, self.places)

    def at(self, place: float) -> Vector:
        """The clearances of all pairs by that of the widest gap; beyond those that are looked at,
        in the same proportions."""
        low, high = self.of_widest[[0, -1]]
        held = min(max(place, low), high)
        return np.asarray(self._clearances(held) * place / held)


# ------------------------------------------------------------------------------
# The clearances of a mission of several phases: for all of them, at the risk of them together.
#
# Phases are independent and each starts in its own stationary motion, so that their hazards -ln(1 -
# P) add up. The hazard of a pair in a phase follows from its own curve of risk. Several pairs share
# the risk equally, and first crossings of all gaps together give the hazard that any is hit
# (`EqualRisk`). A phase whose crossings by Rice's formula do not matter has no curve. Stops stay
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
    scene: Scene, target: Target, run: Run, common: Sequence[str] = (),
    tolerances: Tolerances | None = None,
) -> Sizing:  # fmt: skip
    """The clearance of a scene with phases, see `size`."""
    if target.name != "probability":
        raise NotApplicable(
            "size",
            f"the target must be a probability where the scene has phases, shocks, noise of "
            f"varying level, or springs that are functions, got {target.name}; size one phase, "
            "named as FILE.toml#PHASE; reliability then judges the mission; clearance counts the "
            "impacts on any mount",
        )
    if differing := [key for key, _ in varied(scene)]:
        raise NotApplicable(
            "size",
            "nothing may differ between units where the scene has phases, got "
            f"{differing[0]}; size one phase, named as FILE.toml#PHASE",
        )
    allowed = (tolerances or Tolerances.of(scene)).felt(scene, by_hits=False)
    _check_changes(scene, allowed)
    end = 1.0 if allowed == Tolerances() else 1.0 - SEARCH.share_of_tolerances
    whole, run = run, run.part(0.0, end, deadline=run.deadline.share(end))
    phases = {phase.name: PhaseMotion.of(phase, scene) for phase in scene.phases}
    hazard = -math.log1p(-target.value)
    names = [each.name for each in model_of(as_stated(scene)).pairs] or ["stops"]
    loudest = np.max([phase.sigma for phase in phases.values()], axis=0)
    if still := unshaken(dict(zip(names, loudest.tolist(), strict=True))):
        raise NotApplicable("size", still)
    gaps = [
        {name: HazardInPhase.alone(phase, pair) for name, phase in phases.items()}
        for pair in range(len(names))
    ]
    guesses = [_guess(pair, each, hazard) for pair, each in enumerate(gaps)]
    felt = _felt(
        {name: phase.expected(np.array(guesses)) for name, phase in phases.items()}, phases
    )
    felt_by_pair = [
        _felt({name: gap.expected(guess) for name, gap in each.items()}, phases)
        for each, guess in zip(gaps, guesses, strict=True)
    ]
    busy = {name: phases[name].duration for name in felt}
    several, steps = len(names) > 1, steps_of_bands(scene.phases)
    late = run.deadline.share(SHARE_OF_CURVES) if several else run.deadline
    first = run.part(0.0, SHARE_OF_CURVES if several else 1.0, deadline=late)
    for name, part in parts_of_mission(first, busy):
        asked = [pair for pair, each in enumerate(felt_by_pair) if name in each]
        for done, pair in enumerate(asked):
            share = part.deadline.share(1.0 / (len(asked) - done))
            own = part.part(done / len(asked), (done + 1.0) / len(asked), deadline=share)
            gaps[pair][name] = _simulated(gaps[pair][name], pair, target, own)
    alone = [Joint(each, steps) for each in gaps]
    joint, guess, widest, shared = alone[0], guesses[0], 0, None
    at: Callable[[float], Vector] = np.atleast_1d
    if several:
        shared = EqualRisk.around(hazard, alone, guesses, [names.index(each) for each in common])
        widest, at = shared.widest, shared.at
        together = {
            name: HazardInPhase(phase=phase, clearances=at) for name, phase in phases.items()
        }
        for name, part in parts_of_mission(run.part(SHARE_OF_CURVES, 1.0), busy):
            together[name] = _together(together[name], shared, hazard, part)
        joint, guess = Joint(together, steps), float(np.median(shared.of_widest))
    clearance = joint.clearance(hazard, guess)
    ends = np.transpose([at(each) for each in (clearance.value, clearance.lower, clearance.upper)])
    needed = {
        name: Joint({name: joint.phases[name]}).clearance(hazard, guess).value for name in busy
    }
    table = _table(phases, joint, clearance.value, widest, needed)
    idle = {row["phase"]: row["share"] for row in rows_of(table) if row["phase"] not in busy}
    rest = whole.part(end, deadline=whole.deadline.in_no_less_than(LEAST_SECONDS))
    within, short = ChangedMissions(
        scene=scene, target=target, allowed=allowed, phases=phases, joint=joint, shared=shared,
        names=names, at=at, place=clearance.value,
    ).table(rest)  # fmt: skip
    short = [*joint.short(run.accuracy), *short]
    return Sizing(
        scene=scene, target=target, mission=sum(phase.duration for phase in phases.values()),
        clearances={
            name: Clearance(value=value, lower=lower, upper=upper)
            for name, (value, lower, upper) in zip(names, ends.tolist(), strict=True)
        },
        phases=table,
        curve=joint.curve(clearance.value),
        allowed=allowed,
        tolerances=within,
        assumptions=(
            *([INDEPENDENT] if len(phases) > 1 else []),
            *spoken_lags({name: each.scene for name, each in phases.items()}, scene.phases),
            *spoken_shocks(phases, ends[:, 0]),
            *([FOLLOWED] if any(each.scene.random_level for each in phases.values()) else []),
            *([IN_PIECES] if any(each.pieces is not None for each in phases.values()) else []),
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
        warnings=short, fell_short=tuple(short), cost=whole.cost(),
        provenance=provenance(scene.document(), run.seed),
    )  # fmt: skip


def _simulated(own: HazardInPhase, pair: int, target: Target, run: Run) -> HazardInPhase:
    """The hazard of a pair in a phase, as if it alone had stops."""
    phase, motion = own.phase, own.phase.motion.motions[pair]
    if phase.pieces is not None:
        places = np.array([0.0, FARTHEST * motion.deviations[0]])
        return own.in_pieces(places, -math.log1p(-target.value), run)
    levels = levels_of_gap(motion, target, phase.level_time)
    return own.simulated(levels + abs(phase.shifts[pair]), run)


def _together(
    whole: HazardInPhase, shared: EqualRisk, hazard: float, run: Run, farther: float = 1.0
) -> HazardInPhase:
    """The hazard of any pair in a phase, around clearances that are larger by a factor."""
    if whole.phase.pieces is None:
        return whole.simulated(farther * shared.of_widest, run)
    places = np.linspace(0.0, FARTHEST_PLACE * shared.places.max(), PLACES)[1:]
    return whole.in_pieces(places, hazard, run, shared.depth)


def spoken_shocks(phases: Mapping[str, PhaseMotion], clearances: Vector) -> list[str]:
    """Sentences on the rate of shocks, and on clearances that one shock alone does not reach."""
    found = list[str]()
    for name, phase in phases.items():
        shocks = phase.motion.shocks
        if shocks is None:
            continue
        found += (each.of_its_rate for each in phase.scene.excitations if isinstance(each, Pulses))
        widest = int(np.argmax(clearances))
        alone = float(shocks.reach[widest])
        if shocks.sizes == "equal" and clearances[widest] > alone + OVERLAP * phase.sigma[widest]:
            found.append(
                f"one shock of phase {name} moves the mass by {LENGTH.text(alone, '.3g')}: shocks "
                "that overlap decide on the clearance"
            )
    return list(dict.fromkeys(found))


OVERLAP = 6.0
"""Distance from where one shock brings a gap, in its rms motions, beyond which overlapping shocks
decide: noise alone adds it once in 1e8 crossings."""


def _limit(share: float) -> str:
    """A limit of a small share with one digit, in per cent."""
    digit = 10.0 ** math.floor(math.log10(max(share, TINY)))
    return spoken_percent((math.floor(share / digit) + 1.0) * digit)


TINY = 1e-12
"""Smallest share of a risk that is told, as no noise is Gaussian as far as that."""


def _table(
    phases: Mapping[str, PhaseMotion], joint: Joint, place: float, widest: int,
    needed: Mapping[str, float],
) -> DataFrame:  # fmt: skip
    """The table of `Sizing.phases` at a clearance of the widest gap, with the one that a
    phase alone needs where it is known."""
    total = joint.hazard(place).value
    rows = []
    for name, phase in phases.items():
        own = joint.phases[name].hazard(place).value
        rows.append(
            {"phase": name, "duration": phase.duration,
             "displacement_std": float(phase.sigma[widest]),
             "shift": float(phase.shifts[widest]),
             "probability": -math.expm1(-own), "share": own / total,
             "clearance": needed.get(name, math.nan)}
        )  # fmt: skip
    return frame_of(rows)


def _guess(pair: int, gaps: Mapping[str, HazardInPhase], hazard: float) -> float:
    """The clearance of a pair that is crossed so often in the mission, by Rice's formula."""
    nearest = max(abs(float(gap.phase.shifts[pair])) for gap in gaps.values())
    step = FARTHEST_SIZED * max(float(gap.phase.sigma[pair]) for gap in gaps.values())

    def excess(place: float) -> float:
        return sum(gap.expected(place) for gap in gaps.values()) - hazard

    farthest = nearest + step
    while excess(farthest) > 0.0:
        farthest += step
    return float(scipy.optimize.brentq(excess, nearest, farthest))


def _felt(expected: Mapping[str, float], phases: Mapping[str, PhaseMotion]) -> list[str]:
    """The phases whose expected crossings matter; they are not known under fast peaks."""
    most = max(expected.values())
    return [
        name
        for name, each in expected.items()
        if each > NEGLIGIBLE * most or phases[name].pieces is not None
    ]


# ------------------------------------------------------------------------------
# The clearances that keep the probability of a mission within tolerances of mount and level.
#
# Each phase of a changed mission has the hazard of the phase as stated where its stops are crossed
# as often, by Rice's formula: so the hazard of the mission is known within the whole region of the
# tolerances, and is inverted along the same family of stops. The mission that asks for most is
# simulated as the stated one is.
# ------------------------------------------------------------------------------


WORST_ERROR = 0.2
"""Relative error of the risk of the worst mission within tolerances: that of its clearance c is
0.2 sigma^2 / c^2, some 1 %."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ChangedMissions:
    """A mission within its tolerances.

    Parameters
    ----------
    scene, target, allowed
        The scene with its phases, the target, and the tolerances.
    phases, joint
        The phases as stated, and their hazard.
    names, shared, at
        The pairs; those of several at equal risks; and their clearances at a place.
    place
        That of the stops that keep the target as stated.
    """

    scene: Scene
    target: Target
    allowed: Tolerances
    phases: Mapping[str, PhaseMotion]
    joint: Joint
    names: Sequence[str]
    shared: EqualRisk | None
    at: Callable[[float], Vector]
    place: float

    @property
    def hazard(self) -> float:
        """The hazard that is accepted."""
        return -math.log1p(-self.target.value)

    @cached_property
    def _regions(self) -> dict[str, Region]:
        return {name: Region(each.scene, self.allowed) for name, each in self.phases.items()}

    @cached_property
    def _known(self) -> dict[tuple[str, Changes], tuple[Model, PairMotion]]:
        return {}

    def changed(self, changes: Changes) -> Joint:
        """The hazard of the mission with changes of mount and level, by linear theory."""
        mount = tuple(each for each in changes if each.quantity != "level")
        levels = [each.amount for each in changes if each.quantity == "level"]
        gain = math.sqrt(power_ratio(sum(levels)))
        found = {}
        for name, phase in self.phases.items():
            if mount and (name, mount) not in self._known:
                model = self._regions[name].changed(mount)
                self._known[name, mount] = model, _motion_of(model)
            model, motion = self._known.get((name, mount), (phase.model, phase.motion))
            own = self.joint.phases[name]
            found[name] = replace(own, phase=phase.changed(model, motion, gain), like=own)
        return Joint(found, self.joint.steps)

    def needs(self, changes: Changes) -> Vector:
        """The place that keeps the target with these changes, and the hazard where the stops keep
        it as stated."""
        joint = self.changed(changes)
        place = joint.clearance(self.hazard, self.place).value
        return np.array([place, joint.hazard(self.place).value])

    def simulated(self, changes: Changes, guess: float, run: Run) -> float:
        """The place that keeps the target with changes that bring it near a guess."""
        changed = all_applied(changes, self.scene)
        phases = {
            phase.name: PhaseMotion.of(phase, changed, self.scene) for phase in changed.phases
        }
        hazards = {
            name: HazardInPhase(phase=phase, clearances=self.at) for name, phase in phases.items()
        }
        expected = {name: each.expected(guess) for name, each in hazards.items()}
        busy = {name: phases[name].duration for name in _felt(expected, phases)}
        for name, part in parts_of_mission(run, busy):
            if self.shared is None:
                hazards[name] = _simulated(hazards[name], 0, self.target, part)
            else:
                farther = guess / float(np.median(self.shared.of_widest))
                hazards[name] = _together(hazards[name], self.shared, self.hazard, part, farther)
        return Joint(hazards, self.joint.steps).clearance(self.hazard, guess).value

    def table(self, run: Run) -> tuple[DataFrame, list[str]]:
        """The table of `Sizing.tolerances`, and a sentence where the worst is not in it."""
        if self.allowed == Tolerances():
            return frame_of(), []
        found = [("as stated", np.array([self.place, self.hazard]))]
        ends = [(each,) for each in ends_of(self.allowed)]
        found += [(worded(each), self.needs(each)) for each in ends]
        narrowest = min(each.narrowest() for each in self._regions.values())
        run.tell(0.0, "the worst place within the tolerances")
        try:
            worst, riskiest = worst_within(
                self.allowed.limits(), self.needs, narrowest, run.deadline
            )
            again = replace(run, rel_error=WORST_ERROR)
            place = self.simulated(worst[1], worst[0], again)
        except (NotConverged, Interrupted) as reason:
            sought = "the largest clearance within the tolerances was"
            late = f"{BUDGET_ENDED}before {sought} found"
            lacks = late if run.deadline.passed() else f"{sought} not found: {reason}"
            return frame_of([self._row(found[0])]), [lacks]
        # with one quantity alone the search ends where its row is
        place, risk = np.max([each for _, each in found] + [[place, riskiest[0]]], axis=0)
        found.append((f"{WORST}: {worded(worst[1])}", np.array([place, risk])))
        return frame_of([self._row(each) for each in found]), []

    def _row(self, found: tuple[str, Vector]) -> dict[str, str | float]:
        words, (place, hazard) = found
        return {
            "change": words,
            **dict(zip(self.names, self.at(float(place)).tolist(), strict=True)),
            "factor": float(place) / self.place,
            "probability": -math.expm1(-float(hazard)),
        }


def _check_changes(scene: Scene, allowed: Tolerances) -> None:
    """Raise `NotApplicable` for tolerances of springs and dampers that are functions."""
    if scene.structure.functions and any(name != "level" for name in allowed.limits()):
        raise NotApplicable(
            "size",
            "tolerances must be of the level alone where a spring or damper is a function, got "
            f"{allowed.in_words()}; write a scene for each state of the mount",
        )


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
    check_movable(scene)
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
    from stochvi.statistics.damage import damage

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
            "size", "the motion without stops must be stationary, to compare the damage with"
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
                "size", f"ratio must be smaller: {LEAST_SIGMA:g} rms displacements keep it"
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
) -> Sizing:
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
        Tolerances within all of which the clearance to make keeps the target, of a mission that of
        all its phases; by default those that the scene states (`Tolerances.of`), which may be none.
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
    Sizing
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
    stochvi.isolators.risk_curve : The same for a probability, without simulated impacts.
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
    asked = Question(
        target=target_of(probability, rate, limits_in(options), exceedance),
        mission=HOUR if mission is None else mission, run=Run.of(options), at=at, pair=pair,
        common=common, tolerances=tolerances,
    )  # fmt: skip
    return _sized(scene, asked, mission, spreads)


@calculation
@sampled(rel_error=0.05)
def risk_curve(
    scene: Scene,
    *,
    probability: float,
    tolerances: Tolerances | None = None,
    mission: float | None = None,
    **options: Unpack[AccuracyOptions],
) -> Sizing:
    """The risk of any impact over clearance, and the clearance that an accepted risk needs.

    The curve, the clearance and their intervals are those of `size`. Impacts at the clearance and
    at three sigma are not simulated: a probability of any impact needs none, and they cost most.

    Parameters
    ----------
    scene
        As `size` takes it; the laws of its stops do not matter.
    probability
        Accepted probability of any impact in the mission.
    tolerances, mission
        As `size` takes them.
    **options
        `AccuracyOptions`: `rel_error` is that of the risk at the clearance, by default 0.05. Where
        the `budget` ends first, the interval is wider, and a warning says so.

    Returns
    -------
    Sizing
        The answer of `size`; what is simulated with the stops is None in it, or empty.

    Raises
    ------
    NotApplicable
        If the scene is not covered, or no clearance keeps the risk.

    See Also
    --------
    stochvi.size : The same with the impacts at the clearance.

    Examples
    --------
    >>> import stochvi
    >>> scene = stochvi.load_scene(stochvi.scenes.shipped_scene("isolator-truck"))
    >>> found = risk_curve(scene, probability=0.01)
    >>> print(found.clearance, found.expected_hits)
    11.21 mm (11.2 to 11.21 mm, 95 %) None
    """
    asked = Question(
        target=target_of(probability, None, {}, ACCEPTED), impacts=False,
        mission=HOUR if mission is None else mission, run=Run.of(options), tolerances=tolerances,
    )  # fmt: skip
    return _sized(scene, asked, mission, None)


def _sized(
    scene: Scene, asked: Question, mission: float | None, spreads: Mapping[str, Spread] | None
) -> Sizing:
    """The answer of a question, and whether the clock decided on a part of it; the mission is that
    of the caller, None where none was given."""
    before = decisions_of_the_clock()
    found = _answered(scene, asked, mission, spreads)
    if decisions_of_the_clock() == before or found.fell_short:
        return found
    return replace(
        found,
        warnings=(
            *found.warnings,
            "the budget ended a part of the calculation: another run may give other last digits; "
            "with a larger budget the seed gives the same ones",
        ),
    )


def _answered(
    scene: Scene, asked: Question, mission: float | None, spreads: Mapping[str, Spread] | None
) -> Sizing:
    check_movable(scene)
    run = asked.run
    if not scene.phases and is_one_phase(scene):
        whole = Phase(name=MISSION, duration=asked.mission)
        scene, mission = scene.replace(phases=[whole]), None
    if scene.phases:
        return _of_phases(
            scene, asked.target, mission, run, at=asked.at, pair=asked.pair,
            tolerances=asked.tolerances, spreads=spreads or None, common=asked.common,
        )  # fmt: skip
    if spreads is None and any(varied(scene)):
        from stochvi.isolators.tolerances import spreads_of

        spreads = spreads_of(scene)
    if not 0.0 < asked.mission < math.inf:
        raise ValueError(f"mission must be a positive number of seconds, got {asked.mission}")
    model, pair, common = model_of(scene), asked.pair, asked.common
    check_names(scene, "pair", [pair] if pair is not None else [])
    check_names(scene, "common", common)
    if common and pair is not None:
        raise ValueError(f"common must be left out where one pair is sized, got pair = {pair!r}")
    if spreads:
        return _of_production(scene, asked, spreads)
    allowed = asked.tolerances or Tolerances.of(scene)
    by_hits = asked.target.name != "probability"
    worst = has_one_gap(model) and allowed.felt(scene, by_hits=by_hits) != Tolerances()
    nominal = run
    if worst:
        share = 1.0 - SEARCH.share_of_tolerances
        nominal = run.part(0.0, share, deadline=run.deadline.share(share))
    found = nominal_sizing(scene, replace(asked, run=nominal, tolerances=allowed))
    return _within_tolerances(found, run) if worst else found


def is_one_phase(scene: Scene) -> bool:
    """Whether a scene without phases is sized as a mission of one phase. Its noise varies in level
    or has fast peaks, shocks come beside it, or a spring or damper is a function."""
    level, shocks = scene.random_level, scene.has_shocks
    return level is not None or shocks or is_followed(model_of(scene))


def _of_production(scene: Scene, asked: Question, spreads: Mapping[str, Spread]) -> Sizing:
    """A sizing of the scene as stated, with the clearance that its production needs."""
    from stochvi.isolators.production_risk import SHARE_OF_NOMINAL, Start, about
    from stochvi.isolators.tolerances import bands_beside, check_spreads

    check_spreads(scene, spreads)
    run, name = asked.run, asked.target.name
    if name != "probability":
        raise NotApplicable(
            "size",
            f"the target must be a probability of any impact where tolerances have a "
            f"distribution, got {name}; give them as limits, as frequency=5%, or leave out what "
            "differs between units in the scene",
        )
    share = SHARE_OF_NOMINAL
    first = run.part(0.0, share, deadline=run.deadline.share(share))
    found = nominal_sizing(scene, replace(asked, run=first, tolerances=Tolerances()))
    allowed = asked.tolerances or bands_beside(scene, spreads)
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
    tolerances: Tolerances | None, **others: object,
) -> Sizing:  # fmt: skip
    """The sizing of a scene with phases; refuses arguments that are not for phases."""
    if mission is not None:
        raise ValueError(
            f"mission must be left out where the scene has phases, which last so long together, "
            f"got {mission}"
        )
    for name, value in others.items():
        if value is not None:
            raise ValueError(
                f"{name} must be left out where the scene has phases, shocks, noise of varying "
                f"level, or springs that are functions, got {value}"
            )
    check_names(scene, "common", common)
    try:
        found = size_mission(scene, target, run, common, tolerances)
    except NotApplicable as reason:
        # the user called `size`, whatever function it came from
        raise NotApplicable("size", reason.conditions) from reason
    if not found.warnings:
        return found
    where = found.warnings[0].removeprefix(BUDGET_ENDED)
    if where == found.warnings[0]:  # something else than the clock
        raise NotConverged(where, found)
    raise run.deadline.fell_short(where, "raise budget or rel_error", found)


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
