"""What shakes the system: noise (white, filtered, of a density), a sine, a constant load."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Literal, Self

import numpy as np
from pydantic import PrivateAttr, model_validator

from stochvi.mathematics.spectra import Table
from stochvi.mathematics.units import (
    ACCELERATION_DENSITY_UNITS,
    DENSITY_UNITS,
    FORCE_DENSITY_UNITS,
    STANDARD_GRAVITY,
    intensity_from_density,
    power_ratio,
)
from stochvi.results.errors import SceneError
from stochvi.scenes.datasets import profiles
from stochvi.scenes.readers import read_columns
from stochvi.scenes.records import (
    FEWEST_SEGMENT_LENGTHS,
    Record,
    read_record,
    response_error,
    wanted_resolution,
)
from stochvi.scenes.roads import ROUGHNESS, WAVENUMBERS, road_table
from stochvi.scenes.validation import Band, Checked, Column, Count, Names, Number, Positive, given

BASE = "base"
"""The place of an excitation that moves the base; every other place is a coordinate."""

Unit = Literal["g2/Hz", "(m/s2)2/Hz", "N2/Hz"]


def check_unit(unit: str, on: str) -> None:
    """A force density belongs on a mass, an acceleration density on the base."""
    fitting = ACCELERATION_DENSITY_UNITS if on == BASE else FORCE_DENSITY_UNITS
    if unit not in fitting:
        raise ValueError(
            f"has unit {unit!r}, but on = {on!r} takes a density in {' or '.join(fitting)}"
        )


class _Strength(Checked):
    """White noise of a strength: `intensity` S0, or a one-sided `density` with its `unit`."""

    on: str | None = None
    intensity: Positive | None = None
    density: Positive | None = None
    unit: Unit | None = None

    @property
    def density_unit(self) -> str | None:
        """Unit of its density; None for an intensity, which is in SI units."""
        return self.unit

    @model_validator(mode="after")
    def _one_strength(self) -> Self:
        if (self.intensity is None) == (self.density is None):
            raise ValueError(
                "needs exactly one of intensity and density, "
                f"got {given(self, 'intensity', 'density')}"
            )
        if (self.density is None) != (self.unit is None):
            raise ValueError(
                "needs density and unit together (intensity is in SI units), "
                f"got {given(self, 'intensity', 'density', 'unit')}"
            )
        return self

    @property
    def si_intensity(self) -> float:
        """S0 in N^2 s or (m/s^2)^2 s."""
        if self.intensity is not None:
            return self.intensity
        assert self.density is not None and self.unit is not None
        return intensity_from_density(self.density * DENSITY_UNITS[self.unit])


class WhiteNoise(_Strength):
    """White noise, E f(t) f(t + tau) = S0 delta(tau), as a force or a base acceleration.

    Give `intensity` = S0 (N^2 s on the mass, (m/s^2)^2 s on the base), or `density`, one-sided
    per hertz, with its `unit`; S0 = density / 2.

    Examples
    --------
    >>> WhiteNoise(intensity=0.2).si_intensity
    0.2
    >>> round(WhiteNoise(on="base", density=0.01, unit="g2/Hz").si_intensity, 6)
    0.480852
    """

    kind: Literal["white"] = "white"


class FilteredNoise(_Strength):
    """White noise w of intensity S0 passed through a resonance,

        f'' + 2 zeta w_f f' + w_f^2 f = w_f^2 w(t),    w_f = 2 pi frequency_hz,

    so that far below the resonance its density is that of w, and E f^2 = w_f S0 / (4 zeta).
    Narrow-band for a small `zeta`. The strength is given as for `WhiteNoise`.

    Examples
    --------
    >>> sea = FilteredNoise(intensity=2.0, frequency_hz=0.1, zeta=0.05)
    >>> round(sea.variance, 4)
    6.2832
    """

    kind: Literal["filtered"] = "filtered"
    frequency_hz: Positive
    zeta: Positive

    @property
    def omega(self) -> float:
        """Resonance w_f of the filter, rad/s."""
        return 2.0 * math.pi * self.frequency_hz

    @property
    def variance(self) -> float:
        """E f^2, in N^2 or (m/s^2)^2."""
        return self.omega * self.si_intensity / (4.0 * self.zeta)


class Sine(Checked):
    """A sine, amplitude * cos(2 pi frequency_hz t + phase), the phase of each path random.

    `amplitude` is a force (N) on a mass or an acceleration (m/s^2) of the base.

    Examples
    --------
    >>> Sine(on="base", amplitude=9.80665, frequency_hz=50.0).amplitude
    9.80665
    """

    kind: Literal["sine"] = "sine"
    on: str | None = None
    amplitude: Positive
    frequency_hz: Positive


class DensityNoise(Checked):
    """Base of Gaussian noise with a one-sided density per hertz, zero outside its band.

    `level_db` raises or lowers the whole density.
    """

    on: str | None = None
    level_db: Number = 0.0
    _table: Table = PrivateAttr()

    @model_validator(mode="after")
    def _level(self) -> Self:
        if abs(self.level_db) > LARGEST_LEVEL:
            raise ValueError(f"has level_db outside -200..200, got {self.level_db:g}")
        return self

    @property
    def table(self) -> Table:
        """Breakpoints in hertz and SI units, level included."""
        return self._table

    def table_for(self, omega: float, damping_rate: float) -> Table:
        """The table with which an oscillator of omega (rad/s) and b (1/s) is shaken."""
        return self._table

    @property
    def density_unit(self) -> str | None:
        """Unit of the density as it was given."""
        raise NotImplementedError

    def said(self, omega: float = 0.0, damping_rate: float = 0.0) -> tuple[str, ...]:
        """What is taken for granted about it, in words, for an oscillator if one is given."""
        return ()

    def cautions(self, omega: float, damping_rate: float) -> tuple[str, ...]:
        """What of it should be known before a response of that oscillator is believed."""
        return ()


LARGEST_LEVEL = 200.0
"""Decibels; more is a slip."""


class TabulatedNoise(DensityNoise):
    """Gaussian noise with a tabulated one-sided density per hertz, zero outside the table.

    Between breakpoints log density is linear in log frequency. Give one of `profile` (a name
    that ships, in g^2/Hz), `file` and `frequency_hz` with `density`; the last two need `unit`.
    `file` is text of two columns, a UFF file with a dataset 58 (`dataset` says which, if several
    fit; its unit is taken if it states one) or a MATLAB file (`variables` names the two vectors,
    or the matrix of two columns, if several fit).

    Examples
    --------
    >>> truck = TabulatedNoise(on="base", profile="mil-std-810h-truck-vertical-5hz")
    >>> round(truck.table.mean_square() ** 0.5 / 9.80665, 4)
    1.0783
    """

    kind: Literal["psd"] = "psd"
    profile: str | None = None
    file: str | None = None
    variables: Names | None = None
    dataset: Count | None = None
    frequency_hz: Column | None = None
    density: Column | None = None
    unit: Unit | None = None
    _unit: str = PrivateAttr()

    @model_validator(mode="after")
    def _read(self) -> Self:
        inline = self.frequency_hz is not None or self.density is not None
        if (self.profile is not None) + (self.file is not None) + inline != 1:
            raise ValueError(
                "needs exactly one of profile, file, and frequency_hz with density, "
                f"got {given(self, 'profile', 'file', 'frequency_hz', 'density')}"
            )
        if self.file is None and given(self, "variables", "dataset") != "none":
            raise ValueError(f"has {given(self, 'variables', 'dataset')} without a file")
        if self.profile is not None and self.unit not in (None, "g2/Hz"):
            raise ValueError(f"has unit {self.unit!r}, but shipped profiles are in 'g2/Hz'")
        frequency, density, stated = self._columns()
        self._unit = _agreed_unit(self.unit, stated, DENSITY_UNITS)
        factor = DENSITY_UNITS[self._unit] * power_ratio(self.level_db)
        try:
            self._table = Table(frequency_hz=frequency, density=density).scaled(factor)
        except ValueError as error:
            where = "" if self.file is None else f"{self.file} "
            raise SceneError([("" if self.file is None else "file", f"{where}{error}")]) from None
        return self

    def _columns(self) -> tuple[np.ndarray, np.ndarray, str | None]:
        """Frequencies, densities, and the unit that their source states."""
        if self.profile is not None:
            if self.profile not in profiles():
                raise ValueError(
                    f"has the unknown profile {self.profile!r}; known: {', '.join(profiles())}"
                )
            shipped = profiles()[self.profile]
            return np.array(shipped.frequency_hz), np.array(shipped.density), "g2/Hz"
        if self.file is not None:
            names = ("frequency_hz", "density")
            with _sentences_of("file"):
                columns = read_columns(
                    Path(self.file), names, variables=self.variables, dataset=self.dataset
                )
            assert columns.x is not None
            return columns.x, columns.y, columns.unit
        if self.frequency_hz is None or self.density is None:
            raise ValueError(
                "needs frequency_hz and density together, "
                f"got {given(self, 'frequency_hz', 'density')}"
            )
        return np.array(self.frequency_hz), np.array(self.density), None

    @property
    def density_unit(self) -> str | None:
        return self._unit


class RoadNoise(DensityNoise):
    """A base that follows a road of ISO 8608 at a constant speed (see `roads`).

    Its vertical velocity is white, its acceleration rises as f^2, over `band_hz`. There is no
    vehicle between road and mount: a suspension in between belongs into the scene.

    Parameters
    ----------
    road, roughness
        Exactly one: a class, "A" (smooth) to "H", by its geometric mean, or Gd(n0) in m^3.
    speed, speed_kmh
        Exactly one: m/s or km/h.
    band_hz
        Lowest and highest frequency, Hz; by default 0.01 and 10 cycles per metre times the speed.

    Examples
    --------
    >>> road = RoadNoise(road="C", speed_kmh=72.0, band_hz=[0.5, 50.0])
    >>> round(float(road.table(10.0)), 3), road.table.frequency_hz.tolist()
    (7.98, [0.5, 50.0])
    """

    kind: Literal["road"] = "road"
    on: str | None = BASE
    road: Literal["A", "B", "C", "D", "E", "F", "G", "H"] | None = None
    roughness: Positive | None = None
    speed: Positive | None = None
    speed_kmh: Positive | None = None
    band_hz: Band | None = None

    @model_validator(mode="after")
    def _drive(self) -> Self:
        for names in (("road", "roughness"), ("speed", "speed_kmh")):
            if given(self, *names) not in names:
                raise ValueError(
                    f"needs exactly one of {names[0]} and {names[1]}, got {given(self, *names)}"
                )
        if self.on != BASE:
            raise ValueError(f"moves the base, on = 'base', got on = {self.on!r}")
        low, high = self.band_hz or tuple(n * self.metres_per_second for n in WAVENUMBERS)
        roughness = ROUGHNESS[self.road] if self.road is not None else self.roughness
        assert roughness is not None
        table = road_table(roughness, self.metres_per_second, (low, high))
        self._table = table.scaled(power_ratio(self.level_db))
        return self

    @property
    def metres_per_second(self) -> float:
        """Speed, m/s."""
        if self.speed is not None:
            return self.speed
        assert self.speed_kmh is not None
        return self.speed_kmh / KMH_PER_METRE_PER_SECOND

    @property
    def density_unit(self) -> str | None:
        return "(m/s2)2/Hz"

    def said(self, omega: float = 0.0, damping_rate: float = 0.0) -> tuple[str, ...]:
        low, high = self._table.frequency_hz
        which = f"class {self.road}" if self.road else f"Gd(n0) = {self.roughness:g} m^3"
        return (
            f"the base follows a road of ISO 8608, {which}, at {self.metres_per_second:.4g} m/s, "
            f"from {low:.3g} to {high:.3g} Hz, without a suspension; class table from secondary "
            "sources",
        )


KMH_PER_METRE_PER_SECOND = 3.6
"""Kilometres per hour in a metre per second."""


class RecordedNoise(DensityNoise):
    """Gaussian noise with the density of a measured record, estimated by Welch's method.

    The record itself is not replayed. Its segments are chosen from its length and from the
    oscillator that it shakes (`Record.resolution`), unless `resolution_hz` says.

    Parameters
    ----------
    file
        Text with a time (s) and a value in each line, or with a value alone and `fs` given; a UFF
        file with a dataset 58 (`dataset` says which), or a MATLAB file (`variables`).
    unit
        Of the values: "g", "m/s2" or "N"; may be left out where a UFF file states it.
    fs
        Sampling rate, Hz, of a file without times.
    band_hz
        Lowest and highest frequency of the density that is kept, Hz.
    """

    kind: Literal["record"] = "record"
    file: str
    unit: Literal["g", "m/s2", "N"] | None = None
    fs: Positive | None = None
    variables: Names | None = None
    dataset: Count | None = None
    band_hz: Band | None = None
    resolution_hz: Positive | None = None
    _unit: str = PrivateAttr()
    _record: Record = PrivateAttr()

    @model_validator(mode="after")
    def _read(self) -> Self:
        with _sentences_of("file"):
            record, stated = read_record(
                Path(self.file), fs=self.fs, variables=self.variables, dataset=self.dataset
            )
        self._unit = _agreed_unit(self.unit, stated, VALUE_UNITS)
        scale = VALUE_UNITS[self._unit] * math.sqrt(power_ratio(self.level_db))
        self._record = Record(values=record.values * scale, fs=record.fs)
        if self.resolution_hz is not None and not (
            1.0 / record.duration <= self.resolution_hz <= record.fs / FEWEST_BINS
        ):
            raise ValueError(
                f"has resolution_hz = {self.resolution_hz:g}, expected "
                f"{1.0 / record.duration:.3g} to {record.fs / FEWEST_BINS:.3g} Hz for this record"
            )
        self._table = self._within_band(self._record.resolution())
        return self

    def _within_band(self, resolution: float) -> Table:
        table = self._record.density(self.resolution_hz or resolution).table
        if self.band_hz is None:
            return table
        low, high = self.band_hz
        kept = (table.frequency_hz >= low) & (table.frequency_hz <= high)
        if kept.sum() < 2:
            raise ValueError(
                f"has band_hz = [{low:g}, {high:g}], but the record reaches from "
                f"{table.frequency_hz[0]:.3g} to {table.frequency_hz[-1]:.3g} Hz"
            )
        return Table(frequency_hz=table.frequency_hz[kept], density=table.density[kept])

    @property
    def record(self) -> Record:
        """The record in SI units, level included."""
        return self._record

    @property
    def density_unit(self) -> str | None:
        return {"g": "g2/Hz", "m/s2": "(m/s2)2/Hz", "N": "N2/Hz"}[self._unit]

    def table_for(self, omega: float, damping_rate: float) -> Table:
        return self._within_band(self._record.resolution(omega, damping_rate))

    def said(self, omega: float = 0.0, damping_rate: float = 0.0) -> tuple[str, ...]:
        """Length, rate, kurtosis, how its density was estimated, and what it is not good for."""
        record = self._record
        kurtosis, doubt = record.kurtosis()
        estimate = record.density(self._bins(omega, damping_rate))
        return (
            f"record {Path(self.file).name}: {record.duration:.4g} s at {record.fs:.4g} Hz, "
            f"kurtosis {kurtosis:.2f} +- {doubt:.2f} (Gaussian: 3); simulated is Gaussian noise of "
            "its density, not the record",
            f"its density: Welch, {estimate.segments} segments, bins of "
            f"{estimate.resolution_hz:.3g} Hz, {100.0 * estimate.relative_error:.2g} % each",
            *self.cautions(omega, damping_rate),
        )

    def cautions(self, omega: float, damping_rate: float) -> tuple[str, ...]:
        """What a record leaves uncertain of the response of an oscillator (zeros: of none)."""
        record, found = self._record, []
        kurtosis, doubt = record.kurtosis()
        if kurtosis - 3.0 > SEEN * doubt:
            found.append(
                "the record has larger peaks than Gaussian noise of the same rms: hits and "
                "clearances from its density are too favourable"
            )
        if not omega or not damping_rate:
            return tuple(found)
        bins, wanted = self._bins(omega, damping_rate), wanted_resolution(omega, damping_rate)
        error, bias = response_error(record, bins, omega, damping_rate)
        found.append(
            f"the record tells the rms response, and with it every clearance, to "
            f"{50.0 * error:.2g} % (standard error; {50.0 * bias:+.1g} % bias of its window): that "
            "is not in the intervals of what is computed from it"
        )
        if record.density(bins).resolution_hz > COARSE * wanted:
            found.append(
                f"the record is short for this mount: bins of {wanted:.3g} Hz want "
                f"{FEWEST_SEGMENT_LENGTHS / wanted:.3g} s"
            )
        return tuple(found)

    def _bins(self, omega: float, damping_rate: float) -> float:
        return self.resolution_hz or self._record.resolution(omega, damping_rate)


VALUE_UNITS = {"g": STANDARD_GRAVITY, "m/s2": 1.0, "N": 1.0}
"""Units of a record: unit -> factor to m/s^2 or N."""

FEWEST_BINS = 16
"""Samples in the shortest segment."""

SEEN = 3.0
"""Standard errors from which a kurtosis is said to be above that of Gaussian noise."""

COARSE = 1.1
"""Ratio of bins to those wanted from which this is said: segments are whole samples long."""


def _agreed_unit(unit: str | None, stated: str | None, choices: Mapping[str, float]) -> str:
    """The unit that the scene says, or else its source; never two."""
    stated = stated if stated in choices else None
    if unit is None and stated is None:
        raise ValueError(f"needs unit, one of {', '.join(choices)}, got none")
    if unit is not None and stated is not None and unit != stated:
        raise SceneError([("unit", f"is {unit!r}, but the file states {stated!r}")])
    return unit or stated or ""


@contextlib.contextmanager
def _sentences_of(key: str) -> Iterator[None]:
    """Sentences that name no key are about this one."""
    try:
        yield
    except SceneError as error:
        raise SceneError([(name or key, text) for name, text in error.problems]) from None


class ConstantLoad(Checked):
    """A constant force on the mass (N), or a constant acceleration of the base (m/s^2).

    Gravity that pulls towards negative x is `force = -m g`, or `acceleration = 9.80665` of the
    base. If clearances are measured from where the mass hangs, leave gravity out.

    Examples
    --------
    >>> ConstantLoad(force=-9.80665).magnitude
    -9.80665
    """

    kind: Literal["constant"] = "constant"
    on: str | None = None
    force: Number | None = None
    acceleration: Number | None = None

    @model_validator(mode="after")
    def _one_load(self) -> Self:
        if (self.force is None) == (self.acceleration is None):
            raise ValueError(
                "needs exactly one of force (N) and acceleration (m/s^2 of the base), "
                f"got {given(self, 'force', 'acceleration')}"
            )
        if self.on is not None and (self.on == BASE) != (self.acceleration is not None):
            raise ValueError(
                "takes force on a coordinate and acceleration with on = 'base', "
                f"got on = {self.on!r}"
            )
        return self

    @property
    def magnitude(self) -> float:
        """Newtons on a mass, or m/s^2 of the base."""
        value = self.force if self.force is not None else self.acceleration
        assert value is not None and math.isfinite(value)
        return value


Excitation = (
    WhiteNoise | FilteredNoise | TabulatedNoise | RoadNoise | RecordedNoise | Sine | ConstantLoad
)
"""Every excitation that a scene may hold."""


def louder(excitation: Excitation, level_db: float) -> Excitation:
    """The excitation raised by a level in dB; a constant load stays as it is.

    >>> louder(WhiteNoise(intensity=0.2), 10.0).intensity
    2.0
    """
    if isinstance(excitation, ConstantLoad):
        return excitation
    if isinstance(excitation, DensityNoise):
        keys = excitation.model_dump(exclude_none=True)
        return type(excitation)(**(keys | {"level_db": excitation.level_db + level_db}))
    power = power_ratio(level_db)
    factor = math.sqrt(power) if isinstance(excitation, Sine) else power
    raised = {
        name: factor * getattr(excitation, name)
        for name in ("amplitude", "intensity", "density")
        if getattr(excitation, name, None) is not None
    }
    return excitation.model_copy(update=raised)
