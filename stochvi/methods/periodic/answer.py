"""The answer on a structure between stops under a sine: branches of regimes, and jumps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from stochvi.mathematics.arrays import Vector
from stochvi.results.base import Result, plain

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, kw_only=True, eq=False)
class Branch:
    """Periodic regimes that follow from each other as a number is varied.

    Parameters
    ----------
    form
        Method by which the regimes were found: "exact", or harmonic linearisation by "motion" or by
        "force", which gives neither phases nor multipliers (NaN).
    stops
        "pair side" of each impact of a regime, in their order; none of motion without impacts.
        Successive impacts on one stop count as one where the motion rests on a stop.
    sticking
        "pair side" of the stops on which the motion rests for a part of the period.
    periods
        Periods of the force after which the motion repeats itself.
    value, frequency_hz
        The number that is varied, and the frequency of the force, at each point.
    displacement_max, acceleration_max
        Largest displacement from the unloaded position (m), and largest absolute acceleration
        between impacts (m/s^2), of the coordinate that was asked for.
    amplitude
        Amplitude of the first harmonic of that displacement, m.
    phase
        Phases of the force at the impacts (points, impacts), rad.
    displacement, velocity
        The coordinates (points, coordinates) just before the first impact, or at the phase 0 of
        motion without impacts or with rests, m and m/s.
    impact_speed
        Incident speeds (points, impacts), m/s; the largest of successive impacts that count as one.
    multiplier
        Largest modulus of the factors by which small perturbations change over the regime; infinite
        where an impact of speed 0 leaves none (null in JSON).
    stable, admissible
        Whether perturbations die away; whether the motion meets no stop besides these impacts.
    names
        "fold", "grazing", "period doubling", "symmetry breaking", "torus" or "sticking", where
        rests on a stop begin or end, at a special point, else empty.

    See Also
    --------
    stochvi.harmonic_response : The calculation.
    """

    form: str
    stops: tuple[str, ...]
    sticking: tuple[str, ...]
    periods: int
    value: Vector
    frequency_hz: Vector
    displacement_max: Vector
    amplitude: Vector
    acceleration_max: Vector
    phase: Vector
    displacement: Vector
    velocity: Vector
    impact_speed: Vector
    multiplier: Vector
    stable: NDArray[np.bool_]
    admissible: NDArray[np.bool_]
    names: tuple[str, ...]

    @property
    def impacts_per_period(self) -> float:
        """Number of impacts over the number of periods of the force."""
        share = len(self.stops) / self.periods
        return int(share) if share.is_integer() else share

    def at(self, value: float) -> list[int]:
        """The admissible points at a value that was asked for."""
        near = np.abs(self.value - value) <= 1e-9 * max(abs(value), 1e-300)
        return [int(i) for i in np.flatnonzero(near & self.admissible) if not self.names[i]]

    def to_dict(self) -> dict[str, Any]:
        """The JSON document of the branch."""
        found = {name: getattr(self, name) for name in BRANCH_KEYS}
        if not np.allclose(self.value, self.frequency_hz, rtol=1e-9, atol=0.0):
            found["value"] = self.value
        return {name: plain(value) for name, value in found.items()}


BRANCH_KEYS = (
    "form", "impacts_per_period", "sticking", "periods", "frequency_hz", "displacement_max",
    "impact_speed", "multiplier", "stable", "admissible",
)  # fmt: skip
"""Keys of a branch in a JSON document."""


COLUMNS = (
    "branch", "form", "impacts", "sticking", "impacts_per_period", "periods", "value",
    "frequency_hz", "displacement_max", "acceleration_max", "impact_speed_max", "multiplier",
    "stable", "admissible", "name",
)  # fmt: skip
"""Columns of a table of regimes."""


@dataclass(frozen=True, kw_only=True)
class SpecialPoint:
    """A place where regimes appear, vanish or change their stability.

    Parameters
    ----------
    name
        As in `Branch.names`.
    branch
        Number of the branch.
    value, frequency_hz
        Value of the number that is varied, and frequency of the force.

    See Also
    --------
    stochvi.harmonic_response : The answer that holds it.
    """

    name: str
    branch: int
    value: float
    frequency_hz: float


@dataclass(frozen=True, kw_only=True)
class Jump:
    """A sudden change of a slow sweep.

    Parameters
    ----------
    upwards
        Whether the sweep goes up.
    value, frequency_hz
        Value and frequency at which the regime ends from which the motion jumps.
    displacement_max, impact_speed
        Largest displacement (m) and impact speed (m/s, 0 without impacts), before and after.

    See Also
    --------
    stochvi.harmonic_response : The answer that holds it.
    """

    upwards: bool
    value: float
    frequency_hz: float
    displacement_max: tuple[float, float]
    impact_speed: tuple[float, float]

    @property
    def changes(self) -> tuple[float, float]:
        """Changes of the largest displacement (m) and of the impact speed (m/s)."""
        lengths, speeds = self.displacement_max, self.impact_speed
        return abs(lengths[1] - lengths[0]), abs(speeds[1] - speeds[0])


@dataclass(frozen=True, kw_only=True)
class RandomStarts:
    """Ends of motions from random starts.

    Parameters
    ----------
    number, listed
        Number of random starts, spread over the range. `listed` of them ended in a regime of a
        branch.
    elsewhere
        Smallest and largest value at which a start or a slow sweep ended in none: in motion that
        does not repeat itself within 8 periods, or has more than 24 impacts in its period; None
        where there is none.

    See Also
    --------
    stochvi.harmonic_response : The answer that holds it.
    """

    number: int
    listed: int
    elsewhere: tuple[float, float] | None

    @property
    def all_listed(self) -> bool:
        """Whether every start, and every slow sweep at every value, ended on a branch."""
        return self.listed == self.number and self.elsewhere is None

    @property
    def sentence(self) -> str:
        """The share of starts that ended on a branch."""
        return f"{self.listed} of {self.number} random starts ended in a listed regime"

    @property
    def warning(self) -> str:
        """Where starts or sweeps ended on no branch; empty if none did."""
        if self.elsewhere is None:
            return ""
        low, high = (f"{value:.4g}" for value in self.elsewhere)
        where = f"at {low}" if low == high else f"from {low} to {high}"
        return (
            f"possibly chaotic motion {where}: some random starts or slow sweeps end in no listed "
            "regime there"
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class SimulatedSweep:
    """A slow sweep by simulation from impact to impact, from each value to the next.

    Parameters
    ----------
    upwards
        Whether the sweep goes up.
    value
        The values of the varied number, in the order of the sweep.
    displacement_max, impact_speed_max
        Largest displacement (m) and impact speed (m/s; 0 without impacts) over the period of the
        motion, or over 100 periods of the force where it does not repeat itself.
    periods
        Periods of the force after which the motion repeats itself; 0 where it does not.

    See Also
    --------
    stochvi.harmonic_response : The answer that holds it.
    """

    upwards: bool
    value: Vector
    displacement_max: Vector
    impact_speed_max: Vector
    periods: NDArray[np.int64]


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class HarmonicResponse(Result):
    """Regimes of a structure under a sine or a sum of sines.

    `response.at(20.0)` holds the regimes at a frequency; `branches` all of them.

    Parameters
    ----------
    key
        The number that is varied: "frequency_hz", or a key of the scene.
    coordinate
        The coordinate or point whose displacement and acceleration are given.
    branches
        The branches; the first is the motion without impacts, where there is one.
    special_points
        Folds, grazings and changes of stability, in the order of their values.
    jumps
        Jumps of a slow sweep up and one down where the regime that they follow ends. Each sweep
        starts at an end of the range, at rest under the constant loads.
    starts
        Ends of random starts; None for harmonic linearisation.
    model_error
        Errors of harmonic linearisation: "median" and "largest" relative difference of its impact
        speeds from those of the fastest exact stable regime of a period; "without_exact", the share
        of its stable regimes without such an exact one. None for exact regimes.
    simulated
        Sweeps by simulation that were asked for.
    assumptions
        Assumptions, a sentence each.

    See Also
    --------
    stochvi.harmonic_response : The calculation.
    """

    key: str
    coordinate: str
    branches: tuple[Branch, ...]
    special_points: tuple[SpecialPoint, ...] = ()
    jumps: tuple[Jump, ...] = ()
    starts: RandomStarts | None = None
    simulated: tuple[SimulatedSweep, ...] = ()
    assumptions: Sequence[str] = ()
    model_error: Mapping[str, float | None] | None = None

    def at(self, value: float) -> pd.DataFrame:
        """The regimes at one of the values that were asked for, the most stable first."""
        table = self.to_frame()
        near = np.abs(table["value"] - value) <= 1e-9 * max(abs(value), 1e-300)
        chosen: pd.DataFrame = table[near & table["admissible"] & (table["name"] == "")]
        return chosen.sort_values("multiplier").reset_index(drop=True)

    def to_frame(self) -> pd.DataFrame:
        """One row for each point of each branch, SI units."""
        import pandas as pd

        tables = []
        for number, branch in enumerate(self.branches):
            speeds = branch.impact_speed
            columns = {
                "branch": number,
                "form": branch.form,
                "impacts": " ".join(stop.replace(" ", "-") for stop in branch.stops),
                "sticking": " ".join(stop.replace(" ", "-") for stop in branch.sticking),
                "impacts_per_period": branch.impacts_per_period,
                "periods": branch.periods,
                "value": branch.value,
                "frequency_hz": branch.frequency_hz,
                "displacement_max": branch.displacement_max,
                "amplitude": branch.amplitude,
                "acceleration_max": branch.acceleration_max,
                "impact_speed_max": speeds.max(axis=1, initial=0.0),
                "multiplier": branch.multiplier,
                "stable": branch.stable,
                "admissible": branch.admissible,
                "name": list(branch.names),
            }
            tables.append(pd.DataFrame(columns))
        empty = pd.DataFrame(columns=list(COLUMNS))
        return pd.concat(tables, ignore_index=True) if tables else empty

    def jump_at(self, *, upwards: bool) -> float | None:
        """Frequency (hertz) of the largest jump of a slow sweep; None where there is none.

        It is the one that changes displacement or impact speed the most, each relative to the
        largest change of all jumps: where impacts set in, the speed grows from zero, yet little.
        """
        largest = np.max([jump.changes for jump in self.jumps], axis=0, initial=0.0)
        scale = np.where(largest > 0.0, largest, 1.0)
        found = [jump for jump in self.jumps if jump.upwards == upwards]
        most = max(found, key=lambda jump: max(jump.changes / scale), default=None)
        return None if most is None else most.frequency_hz

    def _document(self) -> dict[str, Any]:
        found = super()._document()
        jumps: Mapping[str, float | None] = {
            "up_hz": self.jump_at(upwards=True), "down_hz": self.jump_at(upwards=False)
        }  # fmt: skip
        return {"method": "sine", **found, "jumps": jumps, "all_jumps": self.jumps}

    def summary(self) -> str:
        """The numbers of branches, stable ones and jumps that were found, in a sentence."""
        stable = sum(bool((each.stable & each.admissible).any()) for each in self.branches)
        found = (
            f"{len(self.branches)} branches of periodic regimes, {stable} of them stable somewhere"
        )
        for upwards, word in ((True, "up"), (False, "down")):
            frequency = self.jump_at(upwards=upwards)
            number = sum(jump.upwards == upwards for jump in self.jumps)
            if frequency is not None:
                places = "at" if number == 1 else f"at {number} places, most at"
                found += f"; a slow sweep {word} jumps {places} {frequency:.5g} Hz"
        if self.model_error is not None and (median := self.model_error["median"]) is not None:
            found += (
                f"; impact speeds are off by {100.0 * median:.2g} % from the exact regimes "
                f"(median; up to {100.0 * (self.model_error['largest'] or 0.0):.2g} %)"
            )
        if self.starts is not None:
            found += f"; {self.starts.sentence}"
        return found
