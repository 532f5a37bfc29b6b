"""Noise of a tabulated density."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import ClassVar, Literal, Self

import numpy as np
from pydantic import PrivateAttr, model_validator

from stochvi.mathematics.spectra import Table
from stochvi.mathematics.units import DENSITY_UNITS, power_ratio
from stochvi.results.errors import SceneError
from stochvi.scenes.datasets import profiles
from stochvi.scenes.excitations.base import DensityNoise, Unit, agreed_unit, band_of, sentences_of
from stochvi.scenes.readers import read_columns
from stochvi.scenes.validation import Column, Count, Names, given


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

    effect_word: ClassVar[str] = "tabulated noise"

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
        self._unit = agreed_unit(self.unit, stated, DENSITY_UNITS)
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
            with sentences_of("file"):
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
