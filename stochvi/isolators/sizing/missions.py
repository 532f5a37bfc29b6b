"""The clearance of a mission of several phases: one for all of them, at the risk of them together.

Phases are independent and each starts in its own stationary motion, so that their hazards
-ln(1 - P) add up. The hazard of each follows from its own curve of risk. A phase whose crossings by
Rice's formula do not matter has none. Stops stay where they are while the mount of a phase is
softer or carries another load: a phase that hangs lower has uneven distances.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import brentq

from stochvi.isolators.record_verdict import record_verdict
from stochvi.isolators.sizing.answer import (
    Clearance,
    Target,
)
from stochvi.isolators.sizing.missions_answer import MissionSizing, as_stated
from stochvi.isolators.sizing.nominal import risk_curve
from stochvi.isolators.sizing.risk_curve import KNOWN, RiskCurve
from stochvi.mathematics.arrays import Vector
from stochvi.mathematics.moving_means import MovingMean
from stochvi.mathematics.random_level import RandomLevel
from stochvi.model.cautions import scene_notes
from stochvi.model.coverage import beyond_one_oscillator
from stochvi.model.model import model_of
from stochvi.results.errors import NotApplicable
from stochvi.results.estimates import provenance
from stochvi.sampling.run import Run
from stochvi.scenes.between_units import varied
from stochvi.scenes.phases import Phase, bias_of_steps, steps_of_bands
from stochvi.scenes.scene import Scene
from stochvi.statistics.first_crossings import one_gap
from stochvi.statistics.mission_parts import INDEPENDENT, parts_of_mission
from stochvi.statistics.pair_crossings import PairMotion
from stochvi.statistics.reliability.phases import (
    NEGLIGIBLE,
    lag_of,
    spoken_lags,
)
from stochvi.statistics.reliability.random_levels import FOLLOWED, felt_by

if TYPE_CHECKING:
    import pandas as pd


POINTS, AROUND = 41, 0.35
"""Number of clearances of the curve of an answer, and how far it reaches from the clearance that
was found, as a share of it."""

LEAST = 1e-300
"""Smallest hazard, of which a logarithm is taken."""

FARTHEST = 20.0
"""Largest clearance that is tried, in the largest rms displacement of a phase."""


def size_mission(scene: Scene, target: Target, run: Run) -> MissionSizing:
    """The clearance of a scene with phases, see `size`."""
    import pandas as pd

    if target.name != "probability":
        raise NotApplicable(
            "size",
            [f"the target must be a probability where the scene has phases, shocks or noise of "
             f"varying level, got {target.name}; size one phase, named as FILE.toml#PHASE; "
             "reliability then judges the mission"],
        )  # fmt: skip
    if differing := [key for key, _ in varied(scene)]:
        raise NotApplicable(
            "size",
            ["nothing may differ between units where the scene has phases, got "
             f"{differing[0]}; size one phase, named as FILE.toml#PHASE"],
        )  # fmt: skip
    phases = {phase.name: _Phase.of(phase, scene) for phase in scene.phases}
    hazard = -math.log1p(-target.value)
    sigma = max(phase.sigma for phase in phases.values())
    guess = brentq(
        lambda c: sum(phase.expected(c) for phase in phases.values()) - hazard,
        max(abs(phase.shift) for phase in phases.values()), FARTHEST * sigma,
    )  # fmt: skip
    most = max(phase.expected(guess) for phase in phases.values())
    busy = {
        name: phase.duration
        for name, phase in phases.items()
        if phase.expected(guess) > NEGLIGIBLE * most
    }
    for name, part in parts_of_mission(run, busy):
        phases[name] = phases[name].simulated(target, part)
    joint = _Joint(phases, steps_of_bands(scene.phases))
    clearance = joint.clearance(hazard, guess)
    rows = []
    total, _ = joint.hazard(clearance.value)
    for name, phase in phases.items():
        own, _ = phase.hazard(clearance.value)
        alone = math.nan
        if phase.curve is not None:
            alone = _Joint({name: phase}).clearance(hazard, guess).value
        rows.append(
            {"phase": name, "duration": phase.duration, "displacement_std": phase.sigma,
             "shift": phase.shift, "probability": -math.expm1(-own), "share": own / total,
             "clearance": alone}
        )  # fmt: skip
    idle = [name for name in phases if name not in busy]
    return MissionSizing(
        scene=scene, target=target, mission=sum(phase.duration for phase in phases.values()),
        clearance=clearance, phases=pd.DataFrame(rows), curve=joint.curve(clearance.value),
        assumptions=(
            *([INDEPENDENT] if len(phases) > 1 else []),
            *spoken_lags({name: each.scene for name, each in phases.items()}, scene.phases),
            *([FOLLOWED] if any(each.scene.random_level for each in phases.values()) else []),
            *(f"phase {name} hardly matters, and counts by Rice's crossings" for name in idle),
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


@dataclass(frozen=True, kw_only=True)
class _Phase:
    """A phase: its scene, and what is known of its risk. Distances in m."""

    scene: Scene
    duration: float
    motion: MovingMean
    shift: float
    sides: tuple[float, ...]
    sweep_rate: float = 0.0
    curve: RiskCurve | None = None

    @classmethod
    def of(cls, phase: Phase, whole: Scene) -> _Phase:
        scene = phase.of(whole)
        model = model_of(scene)
        if conditions := beyond_one_oscillator(model, with_filters=True, with_sines=True):
            raise NotApplicable("size", [f"{each} (in phases)" for each in conditions])
        (motion,) = PairMotion.under_shocks(one_gap(replace(model, level=None))).motions
        sides = tuple(float(stop.side) for stop in model.stops) or (-1.0, 1.0)
        shift = model.rest - model_of(as_stated(whole)).rest
        if model.level is not None:
            felt_by(model)
            if model.sines or shift:
                got = "a sine beside it" if model.sines else "a mount that hangs lower in a phase"
                sentence = (
                    f"noise of varying level must be alone on a mount that hangs evenly, got {got}"
                )
                raise NotApplicable(
                    "size", [f"{sentence}; reliability gives the risk of a clearance"]
                )
        return cls(
            scene=scene, duration=phase.duration, motion=motion, shift=shift, sides=sides,
            sweep_rate=phase.sweep_rate,
        )  # fmt: skip

    @property
    def sigma(self) -> float:
        """rms displacement, sines included."""
        return self.motion.deviations[0]

    def expected(self, clearance: float) -> float:
        """Rice's number of crossings; where the level varies, the hazard that follows from it."""

        def crossings(gain: float) -> float:
            return sum(
                self.motion.towards(side).rate(max(clearance - side * self.shift, 0.0) / gain)
                for side in self.sides
            )

        level = model_of(self.scene).level
        if level is None:
            return self.duration * crossings(1.0)
        return self._varying(np.array([crossings(gain) for gain in level.gains]), level)

    def _varying(self, rates: Vector, level: RandomLevel) -> float:
        """-ln(1 - P) of a hazard with these rates at the gains of a level."""
        chance = level.probability(rates, self.duration)
        return -math.log1p(-min(chance, KNOWN))

    def lag(self, clearance: float) -> float:
        """By how much, as a share, the hazard of what moves may be too large at a clearance."""
        known = self.expected(clearance) if self.sweep_rate else 0.0
        if not known:
            return 0.0
        less = clearance / (1.0 + lag_of(model_of(self.scene), self.sweep_rate))
        return self.expected(less) / known - 1.0

    def simulated(self, target: Target, run: Run) -> _Phase:
        """The phase with its curve of risk, where the level varies that of the level 0 dB in the
        time of the level."""
        level = self.scene.random_level
        if level is None:
            curve = risk_curve(self.scene, target, self.duration, run, self.shift)
        else:
            time = min(self.duration, level.time)
            curve = risk_curve(self.scene.at_steady_level(0.0), target, time, run)
        return replace(self, curve=curve)

    def hazard(self, clearance: float) -> tuple[float, float]:
        """-ln(1 - P) at a clearance, and half its 95 % interval."""
        if self.curve is None:
            return self.expected(clearance), 0.0
        nearest = min(clearance - side * self.shift for side in self.sides)
        level = model_of(self.scene).level
        if level is None:
            return self.curve.hazard(nearest)
        value, upper = self._of_level(self.curve, nearest, level)
        felt, _ = self._of_level(self.curve, nearest, felt_by(model_of(self.scene)))
        return value, upper - value + abs(felt - value)

    def _of_level(
        self, curve: RiskCurve, nearest: float, level: RandomLevel
    ) -> tuple[float, float]:
        """The hazard at a clearance while the level varies, and the upper end of its interval."""
        places = nearest / level.gains
        known = [curve.hazard(c) if self.motion.rate(c) else (0.0, 0.0) for c in places]
        values, halves = np.array(known).T / curve.mission
        return self._varying(values, level), self._varying(values + halves, level)


@dataclass(frozen=True)
class _Joint:
    """The risk of several phases together."""

    phases: Mapping[str, _Phase]
    steps: Sequence[Sequence[str]] = ()

    def hazard(self, clearance: float) -> tuple[float, float]:
        """The sum of the hazards, and half its 95 % interval, with the bias of the steps of moving
        bands."""
        values, halves = zip(
            *(each.hazard(clearance) for each in self.phases.values()), strict=True
        )
        lags = {name: each.lag(clearance) for name, each in self.phases.items()}
        stepped = bias_of_steps(self.steps, dict(zip(self.phases, values, strict=True)), lags)
        return sum(values), math.hypot(*halves) + stepped

    def clearance(self, hazard: float, guess: float) -> Clearance:
        """The clearance at which the hazard is this one."""

        def excess(place: float) -> float:
            return math.log(max(self.hazard(place)[0], LEAST) / hazard)

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
        value = float(brentq(excess, low, high, xtol=1e-12 * guess, rtol=1e-12))
        width = 1e-3 * guess
        slope = (excess(value + width) - excess(value - width)) / (2.0 * width)
        total, half = self.hazard(value)
        reach = half / total / abs(slope)
        return Clearance(value=value, lower=value - reach, upper=value + reach)

    def curve(self, place: float) -> pd.DataFrame:
        """The table of `MissionSizing.curve`."""
        import pandas as pd

        places = place * np.linspace(1.0 - AROUND, 1.0 + AROUND, POINTS)
        found = np.array([self.hazard(each) for each in places])
        low, high = found[:, 0] - found[:, 1], found[:, 0] + found[:, 1]
        return pd.DataFrame(
            {"clearance": places, "probability": -np.expm1(-found[:, 0]),
             "probability_low": -np.expm1(-np.maximum(low, 0.0)),
             "probability_high": -np.expm1(-high)}
        )  # fmt: skip

    def short(self, accuracy: float) -> list[str]:
        """Sentences on the phases whose risk is not known as accurately as asked for."""
        found = []
        for name, phase in self.phases.items():
            if phase.curve is None:
                continue
            reached = phase.curve.reached
            if reached > 1.3 * accuracy:
                found.append(
                    f"the budget ended at a relative error of {reached:.3g} of the probability of "
                    f"an impact in phase {name}"
                )
        return found
