"""All pairs in a phase of a mission: the hazard that any of them is hit, at an equal risk of each.

The clearances of several pairs are those at which each alone would be hit in the whole mission with
the same probability. They are known by that of the widest gap.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.interpolate import PchipInterpolator

from stochvi.isolators.sizing.answer import Target
from stochvi.isolators.sizing.gap_in_phase import GapInPhase, Joint, KnownRisk, lag_of_hazard
from stochvi.isolators.sizing.missions_answer import as_stated
from stochvi.isolators.sizing.nominal import has_one_gap
from stochvi.isolators.sizing.one_curve import SIDES
from stochvi.isolators.sizing.risk_curve import KNOWN
from stochvi.isolators.sizing.shared_risk import RISK_STEP, TotalRisk
from stochvi.mathematics.arrays import Matrix, Vector
from stochvi.model.coverage import modulated
from stochvi.model.model import Model, model_of
from stochvi.results.deadline import partial_result
from stochvi.results.errors import NotApplicable
from stochvi.sampling.run import Run
from stochvi.scenes.phases import Phase
from stochvi.scenes.scene import Scene
from stochvi.statistics.crossing_ages import largest_error
from stochvi.statistics.first_crossings import one_gap
from stochvi.statistics.free_windows import has_fast_peaks, windows_over, without_peaks
from stochvi.statistics.hazard_curves import HazardCurve, hazard_curve
from stochvi.statistics.mission_parts import parts_of_mission
from stochvi.statistics.pair_crossings import FirstCrossings, PairMotion
from stochvi.statistics.reliability.random_levels import felt_by

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
        alone = has_one_gap(model)
        steady = replace(model, level=None)
        free = one_gap(steady) if alone else steady
        peaked = free if has_fast_peaks(free) else None
        motion = PairMotion.under_shocks(without_peaks(free))
        pairs = model.pairs or motion.model.pairs
        stated = model_of(as_stated(whole))
        shifts = np.subtract(*(_mean_gaps(each) for each in (model, stated)))
        gaps = tuple(
            GapInPhase(
                model=model, together=motion, number=number, duration=phase.duration,
                shift=float(shift), sweep_rate=phase.sweep_rate, peaked=peaked,
                sides=tuple(float(stop.side) for stop in pair.stops) or SIDES,
            )
            for number, (pair, shift) in enumerate(zip(pairs, shifts, strict=True))
        )  # fmt: skip
        if model.level is not None:
            _check_level(model, shifts)
        return cls(scene=scene, duration=phase.duration, gaps=gaps)

    @property
    def has_fast_peaks(self) -> bool:
        """Whether noise has fast peaks, so that no formula tells its crossings."""
        return any(gap.peaked is not None for gap in self.gaps)

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
    if len(shifts) > 1 or model.sines or np.any(shifts) or has_fast_peaks(model):
        several = "several pairs" if len(shifts) > 1 else "a mount that hangs lower in a phase"
        beside = "fast peaks" if has_fast_peaks(model) else several
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
    def _clearances(self) -> PchipInterpolator:
        return PchipInterpolator(self.places[:, self.widest], self.places)

    @cached_property
    def _logarithms(self) -> PchipInterpolator:
        return PchipInterpolator(self.places[:, self.widest], np.log(self.hazards))

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
        if self.phase.has_fast_peaks:
            curve = self._under_peaks(run)
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

    def _under_peaks(self, run: Run) -> HazardCurve:
        """The hazard under noise with fast peaks."""
        gaps, duration = self.phase.gaps, self.phase.duration
        peaked = gaps[0].peaked
        assert peaked is not None
        places = np.linspace(0.0, FARTHEST_PLACE * self.shared.places.max(), PLACES)[1:]
        clearances = np.array([self.shared.at(each) for each in places])
        rows = np.stack([gap.distances(clearances[:, gap.number]) for gap in gaps], axis=2)
        kind = windows_over(peaked, places, rows, duration, run.seed)
        most, least = (float(each) for each in self.shared.hazards[[0, -1]])
        return hazard_curve(kind, most / RANGE, duration, run, most / least)

    def hazard(self, clearance: float) -> tuple[float, float]:
        """-ln(1 - P) at a clearance, and half its 95 % interval; beyond those that were looked at,
        the ratio to Rice's number is held constant."""
        if self.curve is not None:
            return self.curve.hazard(clearance)
        if self.total is None:
            return self.expected(clearance), 0.0
        held = self.shared.held(clearance)
        known = self.total.at(self.shared.hazard(held))
        value, upper = (-math.log1p(-min(each, KNOWN)) for each in (known.value, known.upper))
        ratio = 1.0 if held == clearance else self.expected(clearance) / self.expected(held)
        return ratio * value, ratio * (upper - value)


def any_pair(
    phases: Mapping[str, PhaseOfPairs], busy: Mapping[str, float], shared: EqualRisk, run: Run
) -> dict[str, KnownRisk]:
    """The hazard that any pair is hit, of each phase."""
    found: dict[str, KnownRisk] = {}
    known = {name: AnyPair(phase, shared) for name, phase in phases.items()}
    found.update(known)
    for name, part in parts_of_mission(run, busy):
        found[name] = known[name].simulated(part)
    return found
