"""Noise with the density of a measured record."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, ClassVar, Literal, Self

from pydantic import AfterValidator, PrivateAttr, model_validator

from stochvi.mathematics import numerics
from stochvi.mathematics.numerics import within
from stochvi.mathematics.spectra import Table, response_moments
from stochvi.mathematics.units import STANDARD_GRAVITY, Unit, power_ratio
from stochvi.scenes.excitations.base import (
    BASE,
    BaseExcitation,
    DensityNoise,
    agreed_unit,
    unit_name,
    unread_unit,
)
from stochvi.scenes.frames import Values
from stochvi.scenes.records import (
    CUT_OFF,
    FEWEST_BINS,
    FEWEST_SEGMENT_LENGTHS,
    LONGEST_WINDOW,
    Record,
    cut_off,
    listed_gaps,
    read_record,
    response_error,
    wanted_resolution,
)
from stochvi.scenes.validation import (
    Band,
    ColumnName,
    Count,
    Names,
    Positive,
    given,
    sentences_of,
)

VALUES = ("acceleration", "force")
"""Quantities that a record may hold."""


def _value_unit(spelling: str) -> str:
    return unit_name(spelling, *VALUES)


class RecordedNoise(DensityNoise):
    """Gaussian noise with the density of a measured record, estimated by Welch's method.

    `stochvi.replay` alone takes the record itself. The length of the segments follows from the
    length of the record and from the oscillator that it excites (`Record.resolution`), unless
    `resolution_hz` is given.

    Parameters
    ----------
    file
        Text or a spreadsheet with a time (s, or ISO 8601 stamps) and a value in each row, or with a
        value alone and `fs` given; a UFF file with a dataset 58 (`dataset` says which), a MATLAB or
        NumPy file (`variables`), or channels (`column`) of .tdms, .mf4, .ide or .wav files.
    values
        Instead of a file, in Python: an array, a dictionary of columns, or a Series or frame with
        times as its index. Units of names and attributes are read.
    unit
        Unit of the values: "g", "m/s2" or "N"; may be left out where the file states it.
    fs
        Sampling rate, Hz; needed where there are no times, and compared with them where there are.
    column
        Name or number, from 1, of the column or channel of values, where a file has several.
    gaps
        What to do with missing values and missing samples: "refuse" them, or "split" the record
        there into segments, whose statistics are pooled and never bridge a gap.
    variables
        Names of the vectors of a MATLAB or NumPy file, if several fit.
    dataset
        Number of the dataset of a UFF file, from 1, if several fit.
    full_scale
        Largest value that a sound file (.wav) can hold, in the unit of the values.
    band_hz
        Lowest and highest frequency that are kept, Hz, of the record and of its density; a line
        within 1e-9 of its frequency from an end counts as on it.
    resolution_hz
        Width of a bin of the density, Hz.

    See Also
    --------
    stochvi.replay : What the record itself does.
    stochvi.TabulatedNoise : Noise by its density.

    Examples
    --------
    >>> import tempfile
    >>> import numpy as np
    >>> file = Path(tempfile.mkdtemp()) / "run.txt"
    >>> values = np.random.default_rng(1).normal(size=4000)
    >>> np.savetxt(file, values)
    >>> noise = RecordedNoise(file=str(file), unit="g", fs=400.0)
    >>> noise.record.fs, noise.density_unit
    (400.0, 'g2/Hz')
    >>> RecordedNoise(values=values, unit="g", fs=400.0).record == noise.record
    True
    """

    effect_word: ClassVar[str] = "measured record"

    kind: Literal["record"] = "record"
    file: str | None = None
    values: Values | None = None
    unit: Annotated[str, AfterValidator(_value_unit)] | None = None
    fs: Positive | None = None
    column: ColumnName | None = None
    gaps: Literal["refuse", "split"] = "refuse"
    variables: Names | None = None
    dataset: Count | None = None
    full_scale: Positive | None = None
    band_hz: Band | None = None
    resolution_hz: Positive | None = None
    _unit: Unit = PrivateAttr()
    _notes: tuple[str, ...] = PrivateAttr(default=())
    _doubts: tuple[str, ...] = PrivateAttr(default=())
    _as_read: Record = PrivateAttr()
    _record: Record = PrivateAttr()

    @model_validator(mode="after")
    def _read(self) -> Self:
        if (self.file is None) == (self.values is None):
            raise ValueError(
                f"needs exactly one of file and values, got {given(self, 'file', 'values')}"
            )
        with sentences_of("file" if self.values is None else "values"):
            record, columns = read_record(
                self.values or Path(str(self.file)), fs=self.fs, column=self.column,
                variables=self.variables, dataset=self.dataset, full_scale=self.full_scale,
                gaps=self.gaps,
            )  # fmt: skip
        self._unit = agreed_unit(self.unit, columns, VALUES)
        self._doubts = unread_unit(columns, self._unit)
        if columns.unit is not None and self.unit is None:
            self._notes = (
                f"its unit, {self._unit.name}, is the one that {columns.stated_in} states",
            )
        self._as_read = record
        finest = max(1.0 / record.duration, record.fs / LONGEST_WINDOW)
        if self.resolution_hz is not None and not within(
            self.resolution_hz, finest, record.fs / FEWEST_BINS
        ):
            raise ValueError(
                f"has resolution_hz = {self.resolution_hz:g}, expected "
                f"{finest:.3g} to {record.fs / FEWEST_BINS:.3g} Hz for this record"
            )
        self._set_level()
        return self

    def _set_level(self) -> None:
        scale = self._unit.factor * math.sqrt(power_ratio(self.level_db))
        record = self._as_read
        if self.band_hz is not None:
            record = record.filtered(*self.band_hz)
            if not record.values.any():
                low, high = self.band_hz
                raise ValueError(
                    f"has band_hz = [{low:g}, {high:g}], but the record reaches from "
                    f"{1.0 / record.duration:.3g} to {0.5 * record.fs:.3g} Hz"
                )
        self._record = record.scaled(scale)
        self._table = self._within_band(self._record.resolution())

    def louder(self, level_db: float) -> Self:
        """The record at a level raised by `level_db`; the file is not read again."""
        louder = BaseExcitation.model_copy(self, update={"level_db": self.level_db + level_db})
        louder._set_level()
        return louder

    def _within_band(self, resolution: float) -> Table:
        table = self._record.density(self.resolution_hz or resolution).table
        if self.band_hz is None:
            return table
        low, high = self.band_hz
        kept = within(table.frequency_hz, low, high)
        if kept.sum() < 2:
            raise ValueError(
                f"has band_hz = [{low:g}, {high:g}], but the record reaches from "
                f"{table.frequency_hz[0]:.3g} to {table.frequency_hz[-1]:.3g} Hz"
            )
        return Table(frequency_hz=table.frequency_hz[kept], density=table.density[kept])

    @property
    def record_name(self) -> str:
        """The name of its file, or of its values."""
        return Path(str(self.file)).name if self.values is None else self.values.name

    @property
    def record(self) -> Record:
        """The record in SI units, level included."""
        return self._record

    @property
    def as_read(self) -> Record:
        """The record in the unit of its file, without level and band."""
        return self._as_read

    @property
    def density_unit(self) -> str | None:
        return {"g": "g2/Hz", "N": "N2/Hz"}.get(self._unit.name, DENSITY_OF[self._unit.quantity])

    def table_for(self, omega: float, damping_rate: float) -> Table:
        return self._within_band(self._record.resolution(omega, damping_rate))

    def assumptions(self, omega: float = 0.0, damping_rate: float = 0.0) -> tuple[str, ...]:
        """Length, rate and kurtosis, and how its density was estimated."""
        record = self._record
        kurtosis, doubt = record.kurtosis()
        estimate = record.density(self._bins(omega, damping_rate))
        return (
            f"record {self.record_name}: {record.duration:.4g} s at {record.fs:.4g} Hz, "
            f"kurtosis of the input {kurtosis:.2f} ± {doubt:.2f} (Gaussian: 3, which says "
            "little of the response); Gaussian noise of its density is simulated, not the record "
            "itself",
            *(f"record {self.record_name}: {note}" for note in self._notes + record.notes),
            *(
                (f"record {self.record_name}: split at {listed_gaps(record.gaps)}",)
                if record.gaps
                else ()
            ),
            f"its density: Welch, {estimate.segments} segments, bins of "
            f"{estimate.resolution_hz:.3g} Hz, {100.0 * estimate.relative_error:.2g} % each",
        )

    def doubts(self) -> tuple[str, ...]:
        """Sentences on what makes the record itself doubtful: a text that may be a unit, its clock,
        and whether it is cut off."""
        record = self._as_read
        clock = (record.interpolated,) if record.interpolated else ()
        cut = (CUT_OFF,) if cut_off(record.values) else ()
        return tuple(f"record {self.record_name}: {note}" for note in (*self._doubts, *clock, *cut))

    def cautions(self, omega: float, damping_rate: float, *, alone: bool = True) -> tuple[str, ...]:
        """Sentences on how uncertain the record leaves the response of an oscillator with this
        omega (rad/s) and damping rate (1/s); if one of these is 0, only on the record itself. The
        oscillator is `alone`, or the slowest mode of a structure of several."""
        record, found = self._record, [*self.doubts()]
        kurtosis, doubt = record.kurtosis()
        if kurtosis - 3.0 > SEEN * doubt:
            found.append(
                "the record has larger peaks than Gaussian noise of the same rms; impact rates and "
                "clearances from its density are too favourable, unless the structure averages "
                "the peaks out, as its motion under the record itself shows"
            )
        if not omega or not damping_rate:
            return tuple(found)
        bins = self._bins(*(omega, damping_rate) if alone else (0.0, 0.0))
        wanted = wanted_resolution(omega, damping_rate)
        error, _ = response_error(record, bins, omega, damping_rate)
        found.append(
            f"the record's length adds a standard error of {50.0 * error:.2g} % to rms and "
            "clearances; intervals omit it"
        )
        natural = omega / (2.0 * math.pi)
        if 0.5 * record.fs < natural:
            found.append(
                f"the record is sampled at {record.fs:.4g} Hz and holds nothing at the natural "
                f"frequency, {natural:.4g} Hz: what shakes the mount there is left out"
            )
        elif record.density(bins).resolution_hz > COARSE * wanted:
            found.append(
                f"the record is short for this mount: bins of {wanted:.3g} Hz need a record of "
                f"{FEWEST_SEGMENT_LENGTHS / wanted:.3g} s"
            )
        return tuple(found)

    def lost_below(
        self, omega: float, damping_rate: float, *, alone: bool = True
    ) -> tuple[float, str] | None:
        """Mean square displacement of an oscillator below the first line of the density, over that
        which the density holds, and a sentence; None up to `LOST`.

        The oscillator is `alone`, or a mode of a structure of several.
        """
        table = self.table_for(omega, damping_rate) if alone else self.table
        first = float(table.frequency_hz[0])
        kept = response_moments([table], omega, damping_rate).displacement
        share = self._record.slow_displacement(first, omega, damping_rate) / kept
        if share <= LOST:
            return None
        highest = self.band_hz[1] if self.band_hz is not None else 0.5 * self._record.fs
        remedy = "take a longer record"
        digit = 10.0 ** (numerics.floor(math.log10(first)) - 2)
        low = numerics.floor(first / digit) * digit  # rounded down, to keep the first line
        if 4.0 * math.pi * first < omega:
            remedy = (
                f"give band_hz = [{low:.3g}, {highest:.6g}] if it is drift of the sensor, or "
                "take a longer record if the structure moves so"
            )
        return share, (
            f"motion slower than {first:.3g} Hz, which the density of the record leaves out, has "
            f"{100.0 * math.sqrt(share):.3g} % of the rms displacement of the rest; {remedy}"
        )

    def _bins(self, omega: float, damping_rate: float) -> float:
        return self.resolution_hz or self._record.resolution(omega, damping_rate)

    def numbers(self) -> dict[str, float]:
        record = self._record
        kurtosis, error = record.kurtosis()
        return super().numbers() | {
            "duration": float(record.duration),
            "sampling_rate_hz": float(record.fs),
            "rms": float(record.rms),
            "peak": float(record.peak),
            "kurtosis": kurtosis,
            "kurtosis_error": error,
        }

    def facts(self, where: str, numbers: Mapping[str, float]) -> list[tuple[str, ...]]:
        scale, unit = (1.0 / STANDARD_GRAVITY, "g") if where == BASE else (1.0, "N")
        return [
            (
                f"Measured record on {where}",
                self.record_name + self.raised,
                f"{numbers['duration']:.4g} s at {numbers['sampling_rate_hz']:.4g} Hz; density by "
                "Welch's method",
            ),
            (
                "Rms of the record",
                f"{scale * numbers['rms']:.4g} {unit}",
                f"largest value {scale * numbers['peak']:.4g} {unit} peak",
            ),
            (
                "Kurtosis of the record",
                f"{numbers['kurtosis']:.2f} ± {numbers['kurtosis_error']:.2f}",
                "of the input: 3 for Gaussian noise; it says little of the response",
            ),
        ]


DENSITY_OF = {"acceleration": "(m/s2)2/Hz", "force": "N2/Hz"}
"""Quantity of a record -> SI unit of its density."""

LOST = 0.05
"""Largest share of a mean square displacement that a density may leave out without a word: it
changes a clearance by 2.5 %, about what the length of a record leaves uncertain."""

SEEN = 3.0
"""Excess of a kurtosis over 3, in standard errors, above which it counts as not Gaussian."""

COARSE = 1.1
"""Width of the bins over the width that the mount needs, above which a warning says that the record
is short. It is above 1 because segments have a whole number of samples."""
