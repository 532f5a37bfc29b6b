"""Noise of a tabulated density."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import ClassVar, Literal, Self

import numpy as np
from pydantic import PrivateAttr, model_validator

from stochvi.mathematics.arrays import Vector
from stochvi.mathematics.spectra import Table
from stochvi.mathematics.units import DENSITIES, Unit, power_ratio, unit
from stochvi.results.errors import SceneError
from stochvi.scenes.datasets import profiles
from stochvi.scenes.excitations.base import (
    DensityNoise,
    DensityOrLevelUnit,
    agreed_unit,
    band_of,
    unread_unit,
)
from stochvi.scenes.readers import Columns, read_columns
from stochvi.scenes.response_spectra import is_response_spectrum, read_response_spectrum
from stochvi.scenes.validation import Column, ColumnName, Count, Names, Numbers, given, sentences_of


class TabulatedNoise(DensityNoise):
    """Gaussian noise with a tabulated one-sided density per hertz, zero outside the table.

    Between breakpoints log density is linear in log frequency; a frequency that stands twice is a
    step. Give one of `profile`, `file` and `frequency_hz` with `density`.

    Parameters
    ----------
    profile
        Name of a table that ships (`stochvi profiles`), in g^2/Hz.
    file
        A text file, a UFF file with a dataset 58, or a MATLAB or NumPy file. It may also be the
        `spectrum.csv` that `stochvi spectrum --out` wrote for another scene.
    column
        Name of the column of densities in a text file, or its number from 1, if there are more than
        two columns.
    of
        For a `spectrum.csv`: the coordinate of the other scene whose absolute acceleration is used.
    variables
        Names of the two vectors of a MATLAB or NumPy file, or of its matrix of two columns, if
        several fit.
    dataset
        Number of the dataset of a UFF file, from 1, if several fit.
    frequency_hz
        Breakpoints, increasing, Hz.
    density
        One-sided density at each breakpoint, in `unit`; straight between them on logarithmic axes,
        and zero outside the table.
    unit
        Unit of the densities: "g2/Hz" or "(m/s2)2/Hz" on the base, "N2/Hz" on a mass, in any
        spelling, or decibels, as "dB re 1 g2/Hz". It may be left out if the file states the unit;
        if both are given, they must agree.

    Raises
    ------
    SceneError
        If the table cannot be read, its unit is missing or contradicted, or a density is negative.

    See Also
    --------
    stochvi.scenes.profiles : The densities that ship.
    stochvi.RecordedNoise : Noise of a measured record.

    Examples
    --------
    >>> truck = TabulatedNoise(on="base", profile="mil-std-810h-truck-vertical-5hz")
    >>> round(truck.table.mean_square() ** 0.5 / 9.80665, 4)
    1.0783
    """

    effect_word: ClassVar[str] = "tabulated noise"

    kind: Literal["psd"] = "psd"
    profile: str | None = None
    file: str | None = None
    column: ColumnName | None = None
    of: str | None = None
    variables: Names | None = None
    dataset: Count | None = None
    frequency_hz: Column | None = None
    density: Numbers | None = None
    unit: DensityOrLevelUnit | None = None
    _unit: Unit = PrivateAttr()
    _notes: tuple[str, ...] = PrivateAttr(default=())
    _doubts: tuple[str, ...] = PrivateAttr(default=())

    @model_validator(mode="after")
    def _read(self) -> Self:
        inline = self.frequency_hz is not None or self.density is not None
        if (self.profile is not None) + (self.file is not None) + inline != 1:
            raise ValueError(
                "needs exactly one of profile, file, and frequency_hz with density, "
                f"got {given(self, 'profile', 'file', 'frequency_hz', 'density')}"
            )
        choices = given(self, "column", "of", "variables", "dataset")
        if self.file is None and choices != "none":
            raise ValueError(f"has {choices} without a file")
        if self.profile is not None and self.unit not in (None, "g2/Hz"):
            raise ValueError(f"has unit {self.unit!r}, but shipped profiles are in 'g2/Hz'")
        columns = self._columns()
        self._unit = agreed_unit(self.unit, columns, DENSITIES)
        self._doubts += unread_unit(columns, self._unit)
        if self.file is not None:
            with sentences_of("file"):
                columns, notes = cleaned(columns, Path(self.file), self._unit.decibels)
            stated = f"its unit, {self._unit.name}, is the one that {columns.stated_in} states"
            self._notes = ((stated,) if columns.unit and not self.unit else ()) + notes
        elif not self._unit.decibels and self.density is not None:
            for row, value in enumerate(self.density):
                if value <= 0.0:
                    sentence = f"must be greater than 0, got {value!r}"
                    raise SceneError([(f"density.{row}", sentence)])
        assert columns.x is not None
        try:
            density = self._unit.to_si(columns.y) * power_ratio(self.level_db)
            self._table = Table(frequency_hz=columns.x, density=density)
        except ValueError as error:
            where = "" if self.file is None else f"{self.file} "
            raise SceneError([("" if self.file is None else "file", f"{where}{error}")]) from None
        return self

    def _columns(self) -> Columns:
        """Frequencies, densities, and the unit that their source states."""
        if self.profile is not None:
            if self.profile not in profiles():
                raise ValueError(
                    f"has the unknown profile {self.profile!r}; known: {', '.join(profiles())}"
                )
            shipped = profiles()[self.profile]
            return Columns(
                x=np.array(shipped.frequency_hz), y=np.array(shipped.density), unit=unit("g2/Hz")
            )
        if self.file is not None:
            with sentences_of("file"):
                if self.of is not None or is_response_spectrum(Path(self.file)):
                    found = read_response_spectrum(Path(self.file), self.of)
                    self._doubts = (found.error,)
                    return found.columns
                return read_columns(
                    Path(self.file), ("frequency_hz", "density"), column=self.column,
                    variables=self.variables, dataset=self.dataset,
                )  # fmt: skip
        if self.frequency_hz is None or self.density is None:
            raise ValueError(
                "needs frequency_hz and density together, got "
                f"{given(self, 'frequency_hz', 'density')}"
            )
        return Columns(x=np.array(self.frequency_hz), y=np.array(self.density))

    @property
    def density_unit(self) -> str | None:
        return self._unit.name

    def assumptions(self, omega: float = 0.0, damping_rate: float = 0.0) -> tuple[str, ...]:
        """Notes on what was read from the file besides the numbers, and on rows left out."""
        name = Path(self.file or "").name
        return tuple(f"table {name}: {note}" for note in self._notes)

    def cautions(self, omega: float, damping_rate: float, *, alone: bool = True) -> tuple[str, ...]:
        """Warnings on the error of a density that was estimated by simulation, and on a text that
        looks like a unit but is unknown."""
        return tuple(f"table {Path(self.file or '').name}: {note}" for note in self._doubts)

    def numbers(self) -> dict[str, float]:
        stated = {}
        if self.profile is not None:
            stated["stated_g_rms"] = profiles()[self.profile].stated_g_rms
        return stated | super().numbers()

    def facts(self, where: str, numbers: Mapping[str, float]) -> list[tuple[str, ...]]:
        name = f"Tabulated noise on {where}"
        if self.profile is not None:
            source = f"source: {profiles()[self.profile].source}"
            return [
                (name, self.profile + self.raised, source),
                ("Stated by its source", f"{numbers['stated_g_rms']:.4g} g rms", "at 0 dB"),
            ]
        source = "breakpoints in the scene" if self.file is None else self.file
        points = f"{numbers['points']:g} points in {self.density_unit}, {band_of(numbers)}"
        return [(name, Path(source).name + self.raised, points)]


def cleaned(columns: Columns, path: Path, decibels: bool) -> tuple[Columns, tuple[str, ...]]:
    """Rows of a file as a table needs them, and notes on what was changed.

    Rows in descending order are reversed. Rows with the density 0 at either end are left out. From
    a row at 0 Hz a straight line leads to the next one. Where that row is so high that it is the
    offset of a sensor, it is left out. One of two equal rows is dropped.

    Raises
    ------
    SceneError
        If a value is missing, negative or out of order, or a density between others is 0. The
        message names the line.
    """
    assert columns.x is not None
    frequency, density, order = columns.x, columns.y, np.arange(len(columns.y))
    notes = []

    def refuse(row: int, sentence: str) -> SceneError:
        return SceneError(f"{path}, {columns.place(int(order[row]))}: {sentence}")

    for name, values in (("frequency_hz", frequency), ("density", density)):
        if not np.all(np.isfinite(values)):
            row = int(np.argmin(np.isfinite(values)))
            raise refuse(
                row, f"needs positive finite values of {name}, got nan; fill it in or take it out"
            )
    if np.all(np.diff(frequency) <= 0.0) and frequency[0] > frequency[-1]:
        order = order[::-1]
        notes.append("its rows are in descending order and were reversed")
    frequency, density = frequency[order], density[order]
    falls = np.diff(frequency) < 0.0
    if falls.any():
        row = int(np.argmax(falls)) + 1
        anew = falls.sum() == 1 and 1 < row < len(falls) and frequency[row] <= frequency[1]
        raise refuse(
            row,
            "needs increasing frequency_hz (twice the same for a step), got "
            f"{frequency[row - 1]:g} before {frequency[row]:g}; "
            + ("keep one table, as a second one seems to begin there" if anew else "sort the rows"),
        )
    for name, values, remedy in (
        ("frequency_hz", frequency, "take out the line"),
        ("density", density, "say unit = 'dB re 1 g2/Hz', with their reference, if it is a level"),
    ):
        wrong = (values < 0.0) & (name == "frequency_hz" or not decibels)
        if wrong.any():
            row = int(np.argmax(wrong))
            got = f"needs positive finite values of {name}, got {values[row]:g}"
            raise refuse(row, f"{got}; {remedy}")
    if line := _from_zero(frequency, density, decibels):
        notes.append(
            f"between 0 and {frequency[1]:g} Hz its density is a straight line on linear axes"
        )
        places, heights = line
        frequency = np.concatenate([places, frequency[1:]])
        density = np.concatenate([heights, density[1:]])
        order = np.concatenate([np.full(len(places), order[0]), order[1:]])
    held = (frequency > 0.0) & (decibels | (density > 0.0))
    if not held.any():
        raise SceneError(f"{path} needs positive finite values of density, got none")
    first, last = int(np.argmax(held)), len(held) - 1 - int(np.argmax(held[::-1]))
    if not held[first : last + 1].all():
        row = first + int(np.argmin(held[first : last + 1]))
        raise refuse(
            row,
            f"the density is 0 at {frequency[row]:g} Hz, between others above 0: a table is "
            "interpolated in logarithms, which never reach 0; give the parts as two excitations",
        )
    if left := len(held) - (last + 1 - first):
        notes.append(
            f"{left} {'row' if left == 1 else 'rows'} without density or frequency at its ends "
            f"{'was' if left == 1 else 'were'} left out: it reaches from {frequency[first]:g} to "
            f"{frequency[last]:g} Hz"
        )
    kept = np.arange(first, last + 1)
    same = (np.diff(frequency[kept]) == 0.0) & (np.diff(density[kept]) == 0.0)
    kept = kept[np.append(True, ~same)]
    thrice = frequency[kept[2:]] == frequency[kept[:-2]]
    if thrice.any():
        row = int(kept[2:][np.argmax(thrice)])
        raise refuse(
            row,
            f"{frequency[row]:g} Hz appears three times, expected at most twice, for the densities "
            "below and above a step; take out the row between",
        )
    steps = frequency[kept[1:]][np.diff(frequency[kept]) == 0.0]
    if len(steps):
        notes.append(f"it has a step at {', '.join(f'{step:g}' for step in steps)} Hz")
    found = Columns(
        x=frequency[kept], y=density[kept], unit=columns.unit, stated_in=columns.stated_in
    )
    return found, tuple(notes)


def _from_zero(frequency: Vector, density: Vector, decibels: bool) -> tuple[Vector, Vector] | None:
    """Breakpoints of a straight line from a row at 0 Hz to the next one, which a table on
    logarithmic axes cannot begin with; None where there is no such row, or it is an offset."""
    if len(frequency) < 3 or frequency[0] != 0.0 or frequency[1] == 0.0:
        return None
    first, following = 10.0 ** (density[:2] / 10.0) if decibels else density[:2]
    if not 0.0 < first <= OFFSET * following:
        return None
    share = np.geomspace(NEAR_ZERO, 1.0, POINTS_FROM_ZERO)[:-1]
    heights = first + share * (following - first)
    return share * frequency[1], 10.0 * np.log10(heights) if decibels else heights


NEAR_ZERO, POINTS_FROM_ZERO = 1e-3, 101
"""Where the line from 0 Hz begins, by the next frequency, and number of points on it: a thousandth
of its area is left out, and pieces on logarithmic axes follow it to 2e-4 between the points."""

OFFSET = 10.0
"""Ratio of the density at 0 Hz to the next one from which it is the square of an offset, and not
motion."""
