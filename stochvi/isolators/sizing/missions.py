"""The clearances of a mission of several phases: for all of them, at the risk of them together.

Phases are independent and each starts in its own stationary motion, so that their hazards
-ln(1 - P) add up. The hazard of a pair in a phase follows from its own curve of risk. Several pairs
share the risk equally, and first crossings of all gaps together give the hazard that any is hit
(`pairs_in_phase`). A phase whose crossings by Rice's formula do not matter has no curve. Stops stay
where they are while the mount of a phase is softer or carries another load: a phase that hangs
lower has uneven distances.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import brentq

from stochvi.isolators.record_verdict import record_verdict
from stochvi.isolators.sizing.answer import Clearance, Target
from stochvi.isolators.sizing.gap_in_phase import Joint
from stochvi.isolators.sizing.missions_answer import MissionSizing, as_stated
from stochvi.isolators.sizing.pairs_in_phase import EqualRisk, PhaseOfPairs, any_pair
from stochvi.isolators.sizing.shared_risk import SHARE_OF_CURVES
from stochvi.mathematics.arrays import Vector
from stochvi.model.cautions import scene_notes
from stochvi.model.model import model_of
from stochvi.results.errors import NotApplicable
from stochvi.results.estimates import provenance
from stochvi.sampling.run import Run
from stochvi.scenes.between_units import varied
from stochvi.scenes.phases import steps_of_bands
from stochvi.scenes.scene import Scene
from stochvi.statistics.mission_parts import INDEPENDENT, parts_of_mission
from stochvi.statistics.reliability.phases import NEGLIGIBLE, spoken_lags
from stochvi.statistics.reliability.random_levels import FOLLOWED

if TYPE_CHECKING:
    import pandas as pd

IN_PIECES = (
    "noise with fast peaks moves pieces of the motion as it comes; a splitting finds how far they "
    "reach"
)
"""How the risk under a steady kurtosis is found."""

FARTHEST = 20.0
"""Clearance in the largest rms displacement of a phase beyond which Gaussian noise is never sized;
noise of varying level may be, by steps of as much."""


def size_mission(
    scene: Scene, target: Target, run: Run, common: Sequence[str] = ()
) -> MissionSizing:
    """The clearance of a scene with phases, see `size`."""
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
    phases = {phase.name: PhaseOfPairs.of(phase, scene) for phase in scene.phases}
    hazard = -math.log1p(-target.value)
    names = [each.name for each in model_of(as_stated(scene)).pairs] or ["stops"]
    guesses = [_guess(phases, number, name, hazard) for number, name in enumerate(names)]
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
    idle = [name for name in phases if name not in busy]
    return MissionSizing(
        scene=scene, target=target, mission=sum(phase.duration for phase in phases.values()),
        clearances={
            name: Clearance(value=value, lower=lower, upper=upper)
            for name, (value, lower, upper) in zip(names, ends.tolist(), strict=True)
        },
        phases=_table(phases, joint, clearance.value, widest, needed),
        curve=joint.curve(clearance.value),
        assumptions=(
            *([INDEPENDENT] if len(phases) > 1 else []),
            *spoken_lags({name: each.scene for name, each in phases.items()}, scene.phases),
            *([FOLLOWED] if any(each.scene.random_level for each in phases.values()) else []),
            *([IN_PIECES] if any(each.has_fast_peaks for each in phases.values()) else []),
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


def _table(
    phases: Mapping[str, PhaseOfPairs], joint: Joint, place: float, widest: int,
    needed: Mapping[str, float],
) -> pd.DataFrame:  # fmt: skip
    """The table of `MissionSizing.phases` at a clearance of the widest gap, with the one that a
    phase alone needs where it is known."""
    import pandas as pd

    total, _ = joint.hazard(place)
    rows = []
    for name, phase in phases.items():
        own, _ = joint.phases[name].hazard(place)
        gap = phase.gaps[widest]
        rows.append(
            {"phase": name, "duration": phase.duration, "displacement_std": gap.sigma,
             "shift": gap.shift, "probability": -math.expm1(-own), "share": own / total,
             "clearance": needed.get(name, math.nan)}
        )  # fmt: skip
    return pd.DataFrame(rows)


def _guess(phases: Mapping[str, PhaseOfPairs], number: int, name: str, hazard: float) -> float:
    """The clearance of a pair that is crossed so often in the mission, by Rice's formula."""
    gaps = [phase.gaps[number] for phase in phases.values()]
    sigma = max(gap.sigma for gap in gaps)
    if not sigma:
        raise NotApplicable(
            "size",
            [f"excitation must move the gap of every pair, got none that moves {name} in any "
             "phase; leave this pair out of the scene"],
        )  # fmt: skip
    nearest = max(abs(gap.shift) for gap in gaps)
    step = FARTHEST * sigma

    def excess(place: float) -> float:
        return sum(gap.expected(place) for gap in gaps) - hazard

    farthest = nearest + step
    while excess(farthest) > 0.0:
        farthest += step
    return float(brentq(excess, nearest, farthest))


def _felt(phases: Mapping[str, PhaseOfPairs], expected: Mapping[str, float]) -> list[str]:
    """The phases whose expected crossings matter; they are not known under fast peaks."""
    most = max(expected.values())
    return [
        name
        for name, each in expected.items()
        if each > NEGLIGIBLE * most or phases[name].has_fast_peaks
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
