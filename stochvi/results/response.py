"""The stationary response of a scene: the one form in which every method answers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Self

from stochvi.results.base import Result
from stochvi.results.estimates import Cost, Estimate, format_with_error

if TYPE_CHECKING:
    import pandas as pd

QUANTITY_UNITS = {
    "displacement_mean": "m",
    "displacement_std": "m",
    "displacement_mean_square": "m^2",
    "velocity_std": "m/s",
    "velocity_mean_square": "m^2/s^2",
    "acceleration_std": "m/s^2",
    "upcrossing_rate": "1/s",
    "collision_rate": "1/s",
    "collision_rate_lower": "1/s",
    "collision_rate_upper": "1/s",
    "impact_speed_mean": "m/s",
    "impact_speed_rate": "m/s^2",
    "impact_speed_square_rate": "m^2/s^3",
    "peak_force": "N",
    "contact_probability": "1",
    "contact_force_lower": "N",
    "contact_force_upper": "N",
    "relative_displacement_mean": "m",
    "relative_displacement_std": "m",
    "relative_velocity_std": "m/s",
}
"""Units of every quantity: of a coordinate (accelerations are absolute, up-crossings are of the
mean), then of an impact pair (the rates of w and w^2 are F1 and F2; of stops that give way, the
mean over contacts of the largest force, the share of time in contact, the mean force; of a pair of
two coordinates, the motion of the first relative to the second)."""


@dataclass(frozen=True, kw_only=True, repr=False)
class Response(Result):
    """The stationary response of a scene by one method.

    `coordinates` and `impact_pairs` map a name to its quantities (`QUANTITY_UNITS`); a quantity
    that the method cannot give is None. `identities` holds the residuals of the energy, virial
    and force balances, which are zero for a right answer. `interrupted` says that it holds what was
    simulated until Ctrl-C.
    """

    method: str
    coordinates: Mapping[str, Mapping[str, Estimate | None]]
    impact_pairs: Mapping[str, Mapping[str, Estimate | float | None]]
    identities: Mapping[str, Estimate] = field(default_factory=dict)
    effects: Sequence[str] = ()
    assumptions: Sequence[str] = ()
    interrupted: bool = False

    def estimates(self) -> dict[tuple[str, str], Estimate]:
        """Every estimate that exists, keyed by (coordinate or pair, quantity)."""
        found: dict[tuple[str, str], Estimate] = {}
        for group in (self.coordinates, self.impact_pairs):
            for owner, quantities in group.items():
                for name, estimate in quantities.items():
                    if isinstance(estimate, Estimate):
                        found[owner, name] = estimate
        return found

    def to_frame(self) -> pd.DataFrame:
        """A tidy table, one row per quantity."""
        import pandas as pd

        rows = [
            {
                "method": self.method,
                "of": owner,
                "quantity": name,
                "unit": QUANTITY_UNITS[name],
                **estimate.to_dict(),
                "bias_error": estimate.bias_error,
            }
            for (owner, name), estimate in self.estimates().items()
        ]
        return pd.DataFrame(rows)

    @classmethod
    def from_dict(cls, document: Mapping[str, Any]) -> Self:
        """The response whose JSON document this is; a ValueError if it is not such a document."""

        def estimates(entries: Mapping[str, Any]) -> dict[str, Any]:
            return {
                name: Estimate(**item) if isinstance(item, dict) else item
                for name, item in entries.items()
            }

        parts = dict(document)
        try:
            for group in ("coordinates", "impact_pairs"):
                parts[group] = {owner: estimates(part) for owner, part in parts[group].items()}
            parts["identities"] = estimates(parts["identities"])
            return cls(**parts | {"cost": Cost(**parts["cost"])})
        except (AttributeError, KeyError, TypeError) as error:
            raise ValueError(f"the document of a response lacks or misnames {error}") from error

    def __repr__(self) -> str:
        lines = [
            f"  {owner}.{name} = {format_with_error(estimate.value, estimate.standard_error)} "
            f"{QUANTITY_UNITS[name]}"
            for (owner, name), estimate in self.estimates().items()
        ]
        return "\n".join([f"<{self.method}", *lines]) + ">"
