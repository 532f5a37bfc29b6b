"""What a sizing by the damage of equipment returns."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from stochvi.isolators.record_verdict import RecordVerdict
from stochvi.isolators.sizing.answer import (
    ClearanceAnswer,
    spoken_mission,
)
from stochvi.statistics.damage import Damage

if TYPE_CHECKING:
    import pandas as pd


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

    ratio: float
    mission: float
    sigma: float
    tried: pd.DataFrame
    damage: Damage
    record: RecordVerdict | None = None

    @property
    def doubtful(self) -> RecordVerdict | None:
        """The verdict on the record, if it does not agree with the Gaussian noise of the sizing."""
        return None if self.record is None or self.record.agrees else self.record

    def to_frame(self) -> pd.DataFrame:
        """The clearances that were tried."""
        return self.tried

    def verdict(self) -> str:
        """The clearance to make and what it keeps, in one sentence."""
        f = self.damage.equipment_frequency_hz
        band = f"{f[0]:.4g} Hz" if len(f) == 1 else f"{f[0]:.4g} to {f[-1]:.4g} Hz"
        return self._after_record() + (
            f"{self.to_make} the damage of equipment at {band} within {self.ratio:.4g} times that "
            "without stops"
        )

    def calculated(self) -> str:
        """The clearance before rounding, and the equipment that decides."""
        place = self.clearance.value
        near = self.tried.iloc[int(np.argmin(np.abs(self.tried["clearance"] - place)))]
        return (
            f"calculated: {self.clearance}, {place / self.sigma:.3g} sigma; equipment of "
            f"{near['frequency_hz']:.4g} Hz decides, in a mission of {spoken_mission(self.mission)}"
        )

    def _document(self) -> dict[str, Any]:
        return {"method": "size:damage", **super()._document()}
