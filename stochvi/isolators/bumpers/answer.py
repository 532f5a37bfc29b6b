"""The answer of `bumper_map`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from stochvi.isolators.sizing.answer import spoken_mission, spoken_percent
from stochvi.mathematics.arrays import Vector
from stochvi.mathematics.shown_units import ACCELERATION, LENGTH, STIFFNESS
from stochvi.results.base import Result
from stochvi.statistics.damage import SpectrumValues

if TYPE_CHECKING:
    import pandas as pd

QUANTITIES = (
    "peak_acceleration", "pad_force", "rattle_space", "impact_speed", "energy_per_hit",
    "impacts_per_hour",
)  # fmt: skip
"""The quantities of a map, each with its errors."""


class MapPoint(NamedTuple):
    """A point of a map: clearance (m), factor of the stiffness, and both numbers in the map."""

    clearance: float
    stiffness_factor: float
    row: int
    column: int


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class BumperMap(Result):
    """What impacts do to a mass over clearance and stiffness of its stops.

    Quantities are arrays (clearances, stiffnesses) of values with their errors. The first four are
    exceeded in the mission with the probability `exceedance`. Where no stop is touched at that
    probability, they are those of the motion without stops: force and speed are then 0.

    Parameters
    ----------
    clearance
        Metres per side from the static equilibrium, (clearances,).
    stiffness_factor
        Stiffness of the stops over that of the scene, (stiffnesses,).
    stiffness
        The same in N/m, where the law of the stops is a linear spring; else None.
    mission, exceedance
        Duration, s, and accepted probability.
    sigma
        Rms displacement without stops, m.
    peak_acceleration
        Largest absolute acceleration of the mass in a contact, m/s^2.
    pad_force
        Largest force on a stop, N; per kg where the scene has no mass.
    rattle_space
        Travel: largest distance of the mass from its static equilibrium, m. It is the clearance and
        the deflection; where the stops are not reached, it is below the clearance.
    impact_speed
        Largest speed of an impact, m/s.
    energy_per_hit
        Mean energy m w^2 / 2 with which impacts arrive, J; per kg where the scene has no mass.
    impacts_per_hour
        Impacts on all stops, 1/h.
    limits
        Largest accepted values by name of the quantity.
    ways
        Way in which each row was found: "clusters" or "records".
    scene_without_mass
        Whether the scene gives no mass.

    See Also
    --------
    stochvi.isolators.bumper_map : The calculation.
    """

    clearance: Vector
    stiffness_factor: Vector
    stiffness: Vector | None
    mission: float
    exceedance: float
    sigma: float
    peak_acceleration: SpectrumValues
    pad_force: SpectrumValues
    rattle_space: SpectrumValues
    impact_speed: SpectrumValues
    energy_per_hit: SpectrumValues
    impacts_per_hour: SpectrumValues
    limits: Mapping[str, float]
    ways: Sequence[str]
    scene_without_mass: bool = False
    assumptions: Sequence[str] = ()

    @property
    def feasible(self) -> NDArray[np.bool_]:
        """(clearances, stiffnesses): whether all limits are shown to be kept: their quantities lie
        below them with their 95 % intervals."""
        found = np.ones(self.peak_acceleration.value.shape, bool)
        for name, most in self.limits.items():
            values = getattr(self, name)
            found &= values.value + values.half_width_95() <= most
        return found

    @property
    def exceeded(self) -> NDArray[np.bool_]:
        """(clearances, stiffnesses): whether any limit is shown to be exceeded. Points that neither
        keep all limits nor exceed one are not known well enough."""
        found = np.zeros(self.peak_acceleration.value.shape, bool)
        for name, most in self.limits.items():
            values = getattr(self, name)
            found |= values.value - values.half_width_95() > most
        return found

    @property
    def best(self) -> MapPoint | None:
        """The point with the least travel among those shown to keep all limits; None where
        there is none, or no limit was given."""
        if not self.limits or not self.feasible.any():
            return None
        rattle = np.where(self.feasible, self.rattle_space.value, np.inf)
        row, column = np.unravel_index(int(np.argmin(rattle)), rattle.shape)
        return MapPoint(
            float(self.clearance[row]), float(self.stiffness_factor[column]), int(row), int(column)
        )

    @property
    def relative_error(self) -> float:
        """Median relative standard error of the peak acceleration, where a stop is touched."""
        peak = self.peak_acceleration
        touched = self.impact_speed.value > 0.0
        if not touched.any():
            return 0.0
        return float(np.median(peak.standard_error[touched] / peak.value[touched]))

    def to_frame(self) -> pd.DataFrame:
        """A row for each point of the map, with the standard error and the bias of each
        quantity."""
        import pandas as pd

        shape = self.peak_acceleration.value.shape
        columns: dict[str, Any] = {
            "clearance": np.repeat(self.clearance, shape[1]),
            "stiffness_factor": np.tile(self.stiffness_factor, shape[0]),
        }
        if self.stiffness is not None:
            columns["stiffness"] = np.tile(self.stiffness, shape[0])
        for name in QUANTITIES:
            values = getattr(self, name)
            columns |= {
                name: values.value.ravel(), f"{name}_standard_error": values.standard_error.ravel(),
                f"{name}_bias": values.bias.ravel(),
            }  # fmt: skip
        judged = {"feasible": self.feasible.ravel(), "exceeded": self.exceeded.ravel()}
        return pd.DataFrame(columns | judged)

    def _document(self) -> dict[str, Any]:
        found = super()._document()
        judged = {"feasible": self.feasible, "exceeded": self.exceeded, "best": self.best}
        return {"method": "size:map", **judged, **found}

    def stop_in_words(self, column: int) -> str:
        """The stiffness of a column, in words."""
        if self.stiffness is not None:
            return STIFFNESS.text(self.stiffness[column], ".3g")
        return f"{self.stiffness_factor[column]:.3g} times the stiffness of the scene's stops"

    def summary(self) -> str:
        """The best design that keeps the limits, in a sentence."""
        points = self.feasible.size
        mission = spoken_mission(self.mission)
        chance = f"but for {spoken_percent(self.exceedance)} of missions of {mission}"
        if not self.limits:
            return f"{points} designs of stops; limits would mark those that keep them"
        best, unknown = self.best, int(np.count_nonzero(~(self.feasible | self.exceeded)))
        more = f" ({unknown} not known well enough)" if unknown else ""
        if best is None:
            return f"none of {points} designs of stops is shown to keep all limits {chance}{more}"
        at = best.row, best.column
        return (
            f"{np.count_nonzero(self.feasible)} of {points} designs keep all limits {chance}"
            f"{more}; the least travel is {LENGTH.text(self.rattle_space.value[at], '.3g')}, at a "
            f"clearance of {LENGTH.text(best.clearance, '.3g')} with "
            f"{self.stop_in_words(best.column)}: "
            f"{ACCELERATION.text(self.peak_acceleration.value[at], '.3g')}"
        )
