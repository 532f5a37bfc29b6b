"""What a sizing of a mission of several phases returns."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from stochvi.isolators.record_verdict import RecordVerdict, most_alarming
from stochvi.isolators.sizing.answer import (
    ClearanceAnswer,
    Target,
    spoken_mission,
    spoken_percent,
)
from stochvi.model.model import model_of
from stochvi.scenes.scene import Scene
from stochvi.statistics.free_windows import without_peaks

if TYPE_CHECKING:
    import pandas as pd

    from stochvi.mathematics.spectra import Table


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class MissionSizing(ClearanceAnswer):
    """The clearance of a mission of several phases.

    Parameters
    ----------
    scene
        The scene with its phases; stops are at the places that the scene states.
    target
        Probability of any impact in the whole mission.
    mission
        Duration of all phases, s.
    clearances
        By pair, metres per side from the static equilibrium of the mount as stated, with the 95 %
        interval. Each pair alone would be hit in the mission with the same probability.
    phases
        By phase its `duration` (s), `displacement_std` of the widest gap and `shift` of its static
        equilibrium (m). `probability` is that of any impact at the clearances, and `share` the
        part of the phase in the hazard. `clearance` of that gap is what the phase alone needs for
        the target (NaN where it does not matter).
    curve
        `probability` of an impact in the mission over `clearance`, with its 95 % limits
        `probability_low` and `probability_high`.
    records
        Verdicts on the measured records, by the phases that have one.

    See Also
    --------
    stochvi.size : The calculation.
    """

    target: Target
    mission: float
    phases: pd.DataFrame
    curve: pd.DataFrame
    records: Mapping[str, RecordVerdict] = field(default_factory=dict)
    assumptions: tuple[str, ...] = ()

    @property
    def doubtful(self) -> Mapping[str, RecordVerdict]:
        """The verdicts on records that do not agree with the Gaussian noise of the sizing."""
        return {name: each for name, each in self.records.items() if not each.agrees}

    @property
    def record(self) -> RecordVerdict | None:
        """The verdict on the record that a reader must know first; None without records."""
        name = most_alarming(self.records)
        return None if name is None else self.records[name]

    def densities(self) -> dict[str, list[Table]]:
        """The densities of the accelerations in each phase, level included."""
        return {
            phase.name: [table for table, _ in without_peaks(model_of(phase.of(self.scene))).tables]
            for phase in self.scene.phases
        }

    @property
    def fell_short(self) -> tuple[str, ...]:
        """Warnings of an accuracy that was not reached."""
        return tuple(self.warnings)

    @property
    def hanging(self) -> Scene:
        """The scene with the mount as stated, neither warm nor cold."""
        return as_stated(self.scene)

    def to_frame(self) -> pd.DataFrame:
        """The phases."""
        return self.phases

    def verdict(self) -> str:
        """The clearance to make and the risk that it keeps, in one sentence."""
        over = f", over {len(self.phases)} phases" if len(self.phases) > 1 else ""
        return f"{self._after_record()}{self.to_make} {self.target.kept(self.mission)}{over}"

    def calculated(self) -> str:
        """The clearance before rounding, and the phase that decides."""
        place = f"calculated: {self.clearance}{self.of_widest}"
        if len(self.phases) == 1:
            return place
        most = self.phases.iloc[int(np.argmax(self.phases["share"]))]
        return (
            f"{place}; phase {most['phase']} of "
            f"{spoken_mission(most['duration'])} has {spoken_percent(most['share'])} of the risk"
        )

    def _document(self) -> dict[str, Any]:
        return {"method": "size", **super()._document(), "record": self.record}


def as_stated(scene: Scene) -> Scene:
    """The first phase with the mount as the scene states it, neither warm nor cold."""
    factors = {"stiffness_factor": 1.0, "damping_factor": 1.0}
    return scene.phases[0].model_copy(update=factors).of(scene)
