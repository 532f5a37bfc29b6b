"""The answer of `replay`: the motion of a structure between its stops under a measured record."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple, Self

import numpy as np

from stochvi.mathematics.arrays import Matrix, Vector
from stochvi.mathematics.shown_units import LENGTH, SPEED, TIME
from stochvi.results.base import Result
from stochvi.results.estimates import Estimate
from stochvi.results.quantity_units import of_angle
from stochvi.results.response import Quantities
from stochvi.scenes.structures.rigid_body import AXES

if TYPE_CHECKING:
    import pandas as pd

SEGMENTS, FEWEST_SAMPLES = 100.0, 64
"""Number of segments in a record for its short-time spectra, and smallest number of samples in one:
32 frequencies tell an impact from the ringing of the mount."""


class _OfReplay(Quantities[Estimate | None]):
    """What a replay finds at one place."""

    def with_bias(self, coarse: Mapping[str, Estimate | None], step: float) -> Self:
        """The same numbers by a step, s, with their differences from those at twice the step as
        bias."""
        how = f"the record itself, steps of {TIME.text(step)}"

        def compared(name: str, own: Estimate) -> Estimate:
            other = coarse[name]
            bias = None if other is None else abs(own.value - other.value)
            return replace(own, bias=bias, how=how)

        found: dict[str, Any] = {
            name: compared(name, own) for name, own in self.items() if own is not None
        }
        return replace(self, **found)  # type: ignore[type-var]


@dataclass(frozen=True, kw_only=True)
class CoordinateReplay(_OfReplay):
    """The motion of one coordinate.

    Parameters
    ----------
    displacement_max, displacement_min
        Largest and smallest displacement, between samples too, m.
    displacement_mean, displacement_std
        Mean and standard deviation of the samples, m.
    displacement_kurtosis
        Fourth moment of the samples about their mean over the square of the second; 3 for a
        Gaussian process. None where nothing moves.
    acceleration_max
        Largest size of the absolute acceleration, m/s^2; with rigid stops, between the impacts.
    """

    displacement_max: Estimate
    displacement_min: Estimate
    displacement_mean: Estimate
    displacement_std: Estimate
    displacement_kurtosis: Estimate | None
    acceleration_max: Estimate

    def reach(self, name: str) -> str:
        """The smallest and the largest displacement, in words, of a coordinate of this name."""
        ends = float(self.displacement_min), float(self.displacement_max)
        return of_angle(name, LENGTH).span(*ends)


@dataclass(frozen=True, kw_only=True)
class PairReplay(_OfReplay):
    """The impacts of one impact pair.

    Parameters
    ----------
    hits, hits_lower, hits_upper
        Number of impacts; on compliant stops, number of contacts that began. Chatter on a rigid
        stop is counted until the mass rests: in steps, down to the speed that forces bring in one.
    impact_speed_max, impact_speed_mean
        Largest and mean impact speed, m/s; None without an impact.
    peak_force
        Largest force of a contact, N; None for rigid stops.
    contact_time
        Time in contact, or at rest on a rigid stop, s. Contact with a stop that loses energy ends
        when its force returns to zero, which is before the mass is back at the stop.
    rests
        Number of times that the mass came to rest on a rigid stop.
    """

    hits: Estimate
    hits_lower: Estimate | None
    hits_upper: Estimate | None
    impact_speed_max: Estimate | None
    impact_speed_mean: Estimate | None
    peak_force: Estimate | None
    contact_time: Estimate
    rests: Estimate

    def with_bias(self, coarse: Mapping[str, Estimate | None], step: float) -> Self:
        found = super().with_bias(coarse, step)
        # rests on rigid stops are timed by whole steps
        time, rests = found.contact_time, found.rests.value
        bias = None if time.bias is None else time.bias + step * rests
        return replace(found, contact_time=replace(time, bias=bias))


@dataclass(frozen=True, kw_only=True, eq=False)
class Histories:
    """Samples of a replay (SI units).

    Parameters
    ----------
    time
        Seconds from the start of the record.
    base_acceleration
        Acceleration of the base (samples,), m/s^2; (samples, 3) of a base that moves along x, y and
        z; zeros where the records are forces.
    displacement, velocity, acceleration
        Samples by the name of the coordinate; accelerations are absolute.
    force
        Force of each stop on the mass by "pair side", N, positive while it pushes. A rigid stop has
        one only while the mass rests on it, which a replay in steps leaves unknown (nan).
    """

    time: Vector
    base_acceleration: Vector
    displacement: Mapping[str, Vector]
    velocity: Mapping[str, Vector]
    acceleration: Mapping[str, Vector]
    force: Mapping[str, Vector]

    def to_frame(self) -> pd.DataFrame:
        """A table with a row per sample; names of coordinates stand in front where there are
        several."""
        import pandas as pd

        columns: dict[str, Vector] = {"time": self.time}
        if self.base_acceleration.ndim == 1:
            columns["base_acceleration"] = self.base_acceleration
        else:
            for axis, values in zip(AXES, self.base_acceleration.T, strict=True):
                columns[f"{axis}.base_acceleration"] = values
        several = len(self.displacement) > 1
        for name in self.displacement:
            before = f"{name}." if several else ""
            for quantity in ("displacement", "velocity", "acceleration"):
                columns[before + quantity] = getattr(self, quantity)[name]
        columns |= {f"force_{name.replace(' ', '_')}": each for name, each in self.force.items()}
        return pd.DataFrame(columns)

    def short_time_spectra(
        self, coordinate: str | None = None, segment: float | None = None
    ) -> ShortTimeSpectra:
        """Spectra of the absolute acceleration of a coordinate in short segments that overlap by
        half (Hann), as `scipy.signal.spectrogram` has them.

        Parameters
        ----------
        coordinate
            Its name, by default the first.
        segment
            Length of a segment, s; by default a hundredth of the record, 64 samples at least.
        """
        from scipy.signal import spectrogram  # which takes half a second to import

        name = next(iter(self.acceleration)) if coordinate is None else coordinate
        step = float(self.time[1] - self.time[0])
        wanted = self.time[-1] / SEGMENTS if segment is None else segment
        samples = min(max(round(wanted / step), FEWEST_SAMPLES), len(self.time))
        frequency, middles, density = spectrogram(
            self.acceleration[name], 1.0 / step, window="hann", nperseg=samples,
            noverlap=samples // 2, detrend="constant",
        )  # fmt: skip
        return ShortTimeSpectra(self.time[0] + middles, frequency[1:], np.asarray(density[1:]))


class ShortTimeSpectra(NamedTuple):
    """Spectra of segments of an acceleration: the waterfall of a record.

    Parameters
    ----------
    time
        Middles of the segments, s.
    frequency_hz
        Frequencies, Hz.
    density
        (frequencies, segments): one-sided spectral density, (m/s^2)^2/Hz.
    """

    time: Vector
    frequency_hz: Vector
    density: Matrix


@dataclass(frozen=True, kw_only=True, eq=False)
class ReplayAt:
    """The replay between stops at one clearance.

    Parameters
    ----------
    clearance
        Distance of the stops from the static equilibrium, m; None for the stops of the scene.
    stops
        Position of each stop by "pair side", m from the unloaded spring.
    coordinates, impact_pairs
        The quantities by the names of coordinates and of impact pairs.
    impacts
        One row per impact: `time` (s), `pair`, `side`, `speed` (m/s), `peak_force` (N, nan
        at rigid stops, whose impulses have none).
    histories
        The samples; None where they would not fit into memory.

    See Also
    --------
    stochvi.replay : The answer that holds it.
    """

    clearance: float | None
    stops: Mapping[str, float]
    coordinates: Mapping[str, CoordinateReplay]
    impact_pairs: Mapping[str, PairReplay]
    impacts: pd.DataFrame
    histories: Histories | None

    def to_dict(self) -> dict[str, Any]:
        """The JSON document; histories and the list of impacts are tables of their own."""
        from stochvi.results.base import plain

        return {
            "clearance": self.clearance,
            "coordinates": plain(self.coordinates),
            "impact_pairs": plain(self.impact_pairs),
        }

    def with_bias(self, coarse: ReplayAt, step: float) -> ReplayAt:
        """The same answer by a step, s, with the differences from that at twice the step as
        bias."""
        return replace(
            self,
            coordinates={
                name: each.with_bias(coarse.coordinates[name], step)
                for name, each in self.coordinates.items()
            },
            impact_pairs={
                name: each.with_bias(coarse.impact_pairs[name], step)
                for name, each in self.impact_pairs.items()
            },
        )

    def estimates(self) -> Iterator[tuple[str, str, Estimate]]:
        """Owner, name and number of every quantity that is known."""
        for group in (self.coordinates, self.impact_pairs):
            for owner, quantities in group.items():
                for name, each in quantities.items():
                    if each is not None:
                        yield owner, name, each

    def row(self) -> dict[str, float | None]:
        """The quantities as a row of a table."""
        found: dict[str, float | None] = {"clearance": self.clearance}
        for group in (self.coordinates, self.impact_pairs):
            for owner, quantities in group.items():
                before = f"{owner}." if len(group) > 1 else ""
                for name, each in quantities.items():
                    found[before + name] = None if each is None else float(each)
        return found


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Replay(Result):
    """The records of a scene, passed through its structure and stops.

    `replay.coordinates["x"].displacement_max` and `replay.impact_pairs["stops"].hits` are those of
    a single clearance, or of the stops of the scene; over several clearances these two are empty,
    and `clearances` holds the answer at each.

    Parameters
    ----------
    clearances
        The answers, in the order that was asked for.
    duration
        Time that was replayed, s.
    assumptions
        Assumptions, a sentence each.

    See Also
    --------
    stochvi.replay : The calculation.
    """

    clearances: tuple[ReplayAt, ...]
    duration: float
    assumptions: Sequence[str] = ()

    @property
    def only(self) -> ReplayAt | None:
        """The answer where there is only one."""
        return self.clearances[0] if len(self.clearances) == 1 else None

    @property
    def coordinates(self) -> Mapping[str, CoordinateReplay]:
        """Quantities of the coordinates at the only clearance."""
        return self.only.coordinates if self.only else {}

    @property
    def impact_pairs(self) -> Mapping[str, PairReplay]:
        """Quantities of the impact pairs at the only clearance."""
        return self.only.impact_pairs if self.only else {}

    @property
    def histories(self) -> Histories | None:
        """The samples at the only clearance."""
        return self.only.histories if self.only else None

    @property
    def impacts(self) -> pd.DataFrame:
        """The impacts one by one, with the clearance at which each happened."""
        import pandas as pd

        tables = [each.impacts.assign(clearance=each.clearance) for each in self.clearances]
        filled = [table for table in tables if len(table)]
        return pd.concat(filled, ignore_index=True) if filled else tables[0]

    def summary(self) -> str:
        """Displacement, impacts and speeds, in a sentence; over several clearances the impacts at
        each."""
        if self.only is None:
            hits = [
                f"{sum(float(pair.hits) for pair in each.impact_pairs.values()):.0f} at "
                f"{LENGTH.text(each.clearance or 0.0)}"
                for each in self.clearances
            ]
            return f"replay of {self.duration:.4g} s of record: impacts {', '.join(hits)} per side"
        moved = [f"{name} from {each.reach(name)}" for name, each in self.coordinates.items()]
        hit = [_impacts_in_words(name, each) for name, each in self.impact_pairs.items()]
        return f"replay of {self.duration:.4g} s of record: {'; '.join([*moved, *hit])}"

    def to_frame(self) -> pd.DataFrame:
        """One row per clearance, a column per quantity (SI units)."""
        import pandas as pd

        return pd.DataFrame([each.row() for each in self.clearances])

    def _document(self) -> dict[str, Any]:
        found = super()._document()
        only = self.only
        top = {} if only is None else only.to_dict()
        return {
            "method": "replay",
            "coordinates": top.get("coordinates", {}),
            "impact_pairs": top.get("impact_pairs", {}),
            **found,
        }


def _impacts_in_words(name: str, pair: PairReplay) -> str:
    """The number of impacts on a pair, and the fastest of them."""
    hits = round(float(pair.hits))
    number = "no impact" if not hits else "1 impact" if hits == 1 else f"{hits} impacts"
    fastest = pair.impact_speed_max
    speed = "" if fastest is None else f", {'up to ' * (hits > 1)}{SPEED.text(float(fastest))}"
    return f"{number} on {name}{speed}"
