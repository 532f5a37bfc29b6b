"""The stationary response of a scene: the one form in which every method answers."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cache
from typing import TYPE_CHECKING, Any, Self, TypeVar, cast

from stochvi.results.base import Result
from stochvi.results.estimates import Cost, Estimate, format_with_error
from stochvi.results.plots import densities_of
from stochvi.results.quantity_units import unit_of

if TYPE_CHECKING:
    import pandas as pd

Quantity = TypeVar("Quantity", covariant=True)


class Quantities(Mapping[str, Quantity]):
    """Quantities by name, as attributes and as a mapping; None if a method does not give one."""

    def __getitem__(self, name: str) -> Quantity:
        if name not in self._names():
            raise KeyError(f"{name}; known: {', '.join(self._names())}")
        return cast(Quantity, getattr(self, name))

    def __iter__(self) -> Iterator[str]:
        return iter(self._names())

    def __len__(self) -> int:
        return len(self._names())

    def _names(self) -> Sequence[str]:
        return _names_of(type(self))


@cache
def _names_of(kind: Any) -> tuple[str, ...]:
    """Names of the fields of a class."""
    return tuple(each.name for each in fields(kind))


@dataclass(frozen=True, kw_only=True)
class CoordinateResponse(Quantities[Estimate | None]):
    """The stationary motion of one coordinate.

    `response.coordinates["x"].displacement_std` and `response.coordinates["x"]["displacement_std"]`
    are the same.

    Parameters
    ----------
    displacement_mean, displacement_std, displacement_mean_square
        Moments of the displacement, m, m and m^2; positions are measured from the unloaded spring.
    velocity_std, velocity_mean_square
        Moments of the velocity, m/s and m^2/s^2.
    acceleration_std
        Standard deviation of the absolute acceleration, m/s^2; with rigid stops, of the motion
        between impacts. None where it is infinite or not known.
    upcrossing_rate
        Rate of upcrossings of the mean, 1/s.

    See Also
    --------
    stochvi.Response : The answer that holds it.
    """

    displacement_mean: Estimate | None = None
    displacement_std: Estimate | None = None
    displacement_mean_square: Estimate | None = None
    velocity_std: Estimate | None = None
    velocity_mean_square: Estimate | None = None
    acceleration_std: Estimate | None = None
    upcrossing_rate: Estimate | None = None


NEVER_ZERO = (
    "collision_rate", "collision_rate_lower", "collision_rate_upper", "impact_speed_rate",
    "impact_speed_square_rate", "contact_probability", "contact_force_lower", "contact_force_upper",
)  # fmt: skip
"""Quantities of a stop that are above 0 however far it is: where a formula gives 0, they are less
than the smallest number of double precision, which then is their bias."""


def _has_error(found: Estimate) -> bool:
    """Whether a number has an error or an upper limit, or one that is not known."""
    return bool(found.standard_error or found.bias is None or found.bias or found.upper_95)


@dataclass(frozen=True, kw_only=True)
class PairResponse(Quantities[Estimate | float | None]):
    """The impacts of one impact pair.

    Parameters
    ----------
    collision_rate, collision_rate_lower, collision_rate_upper
        Rates of impacts faster than `speed_threshold`, 1/s: of all impacts, and of those on the
        lower and the upper stop. For compliant stops, the rates at which contacts begin.
    impact_speed_mean
        F1 over the rate, m/s. F1 sums all impacts, the rate only those above `speed_threshold`: at
        the default threshold this exceeds the mean speed of the counted ones by less than 0.1 % at
        R >= 0.5. Where the mass rests at a stop of R = 0.1 it is 3 %.
    impact_speed_rate, impact_speed_square_rate
        Sums per second of the impact speeds, F1 in m/s^2, and of their squares, F2 in m^2/s^3.
    peak_force
        Mean over contacts of the largest force, N; for compliant stops only.
    contact_probability, contact_force_lower, contact_force_upper
        For compliant stops only: the share of time in contact, and the mean forces on the lower and
        the upper stop, N. A mass is in contact while it is beyond the stop, even if the stop does
        not push yet; contact with a stop that loses energy ends when its force returns to zero.
    relative_displacement_mean, relative_displacement_std, relative_velocity_std
        Motion of the gap, m and m/s. A pair of two coordinates has the motion of the first relative
        to the second; a place of a rigid body has its motion along the direction of the pair.
    speed_threshold
        The slowest impact that the rates count, m/s.

    See Also
    --------
    stochvi.Response : The answer that holds it.
    """

    collision_rate: Estimate | None = None
    collision_rate_lower: Estimate | None = None
    collision_rate_upper: Estimate | None = None
    impact_speed_mean: Estimate | None = None
    impact_speed_rate: Estimate | None = None
    impact_speed_square_rate: Estimate | None = None
    peak_force: Estimate | None = None
    contact_probability: Estimate | None = None
    contact_force_lower: Estimate | None = None
    contact_force_upper: Estimate | None = None
    relative_displacement_mean: Estimate | None = None
    relative_displacement_std: Estimate | None = None
    relative_velocity_std: Estimate | None = None
    speed_threshold: float = 0.0

    def __post_init__(self) -> None:
        for name in NEVER_ZERO:
            found = getattr(self, name)
            if found is not None and found.value == 0.0 and not _has_error(found):
                # the attributes of a frozen class
                object.__setattr__(self, name, replace(found, bias=sys.float_info.min))

    def _names(self) -> Sequence[str]:
        """Names of the quantities, without the relative motion where the gap is a coordinate."""
        return [
            name
            for name in super()._names()
            if not (name.startswith("relative_") and getattr(self, name) is None)
        ]


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Response(Result):
    """The stationary response of a scene by one method.

    `coordinates` and `impact_pairs` map the name of a coordinate or pair to its quantities, which
    may be given as any mapping from their names. `identities` holds the residuals of the energy,
    virial and force balances, which are zero for a correct answer. `statistics` holds the means of
    functions of one's own (`stochvi.Statistic`), in the units of the functions.

    See Also
    --------
    stochvi.simulate : The response by Monte Carlo.
    stochvi.check : Responses by several methods, compared.

    Examples
    --------
    >>> import stochvi
    >>> scene = stochvi.load_scene(stochvi.scenes.shipped_scene("oscillator-elastic"))
    >>> response = stochvi.exact(scene)
    >>> round(response.coordinates["x"]["velocity_std"].value, 3)
    1.0
    >>> response.to_frame().columns[:4].tolist()
    ['method', 'of', 'quantity', 'unit']
    """

    method: str
    coordinates: Mapping[str, CoordinateResponse]
    impact_pairs: Mapping[str, PairResponse]
    identities: Mapping[str, Estimate] = field(default_factory=dict)
    statistics: Mapping[str, Estimate] = field(default_factory=dict)
    effects: Sequence[str] = ()
    assumptions: Sequence[str] = ()

    def __post_init__(self) -> None:
        for name, record in (("coordinates", CoordinateResponse), ("impact_pairs", PairResponse)):
            group = {
                owner: each if isinstance(each, record) else record(**each)
                for owner, each in getattr(self, name).items()
            }
            object.__setattr__(self, name, group)

    def _document(self) -> dict[str, Any]:
        """The fields by name, without statistics where none was asked for."""
        left_out = () if self.statistics else ("statistics",)
        return {name: each for name, each in super()._document().items() if name not in left_out}

    def estimates(self) -> dict[tuple[str, str], Estimate]:
        """Every estimate that exists, keyed by (coordinate or pair, quantity)."""
        found: dict[tuple[str, str], Estimate] = {}
        owners: list[tuple[str, Mapping[str, Any]]] = [
            *self.coordinates.items(),
            *self.impact_pairs.items(),
        ]
        for owner, quantities in owners:
            for name, estimate in quantities.items():
                if isinstance(estimate, Estimate):
                    found[owner, name] = estimate
        found.update({("statistics", name): each for name, each in self.statistics.items()})
        return found

    def densities(self) -> Mapping[str, Any]:
        """Densities of the coordinate, or of every gap, of a simulation or of averaging, by name.

        They are calculated when this is called. Those of a simulation take some seconds at most,
        with the seed of the answer, and have 95 % bands. Those of averaging have bands from the
        atlas of its errors. There are none of other methods.

        Returns
        -------
        Mapping[str, BandedDensity or AveragedBins]
            Each with its `edges`, `density` and `bands()`; simulated ones with `standard_error`.

        Raises
        ------
        NotApplicable
            Where the answer comes from a file and its scene has a Python function, or a file that
            is not there any more.

        See Also
        --------
        stochvi.simulate : The simulation whose densities they are; its `plot` draws them.
        """
        known = self.method.partition(":")[0] in ("simulate", "average")
        return densities_of(self) if known else {}

    def changed(self, change: Callable[[str, Estimate], Estimate]) -> Self:
        """The response with every estimate replaced by `change(quantity, estimate)`."""

        def record(known: Any) -> Any:
            found = {
                name: change(name, each)
                for name, each in known.items()
                if isinstance(each, Estimate)
            }
            return replace(known, **found)

        return replace(
            self,
            coordinates={owner: record(each) for owner, each in self.coordinates.items()},
            impact_pairs={owner: record(each) for owner, each in self.impact_pairs.items()},
        )

    def to_frame(self) -> pd.DataFrame:
        """A tidy table, one row per quantity."""
        import pandas as pd

        rows = [
            {
                "method": self.method,
                "of": owner,
                "quantity": name,
                "unit": unit_of(owner, name),
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
            parts["statistics"] = estimates(parts.get("statistics", {}))
            return cls(**parts | {"cost": Cost(**parts["cost"])})
        except (AttributeError, KeyError, TypeError) as error:
            raise ValueError(
                "expected the document of a response, as Response.to_dict makes it; a part of this "
                f"one is missing or has another name: {error}"
            ) from error

    def __repr__(self) -> str:
        lines = [f"<{self.method}"]
        for (owner, name), estimate in self.estimates().items():
            value = format_with_error(estimate.value, estimate.standard_error)
            unit = f" {known}" if (known := unit_of(owner, name)) else ""
            lines.append(f"  {owner}.{name} = {value}{unit}{estimate.bias_in_words}")
        return "\n".join(lines) + ">"
