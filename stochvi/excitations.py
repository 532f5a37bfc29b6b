"""What shakes the system: noise (white, filtered, tabulated), a sine, a constant load."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Literal, Self

import numpy as np
from pydantic import PrivateAttr, model_validator

from stochvi.checked import Checked, Column, Number, Positive, given
from stochvi.conventions import (
    ACCELERATION_DENSITY_UNITS,
    DENSITY_UNITS,
    FORCE_DENSITY_UNITS,
    intensity_from_density,
    power_ratio,
)
from stochvi.datasets import profiles, read_table
from stochvi.errors import SceneError
from stochvi.spectra import Table

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


class TabulatedNoise(Checked):
    """Gaussian noise with a tabulated one-sided density per hertz, zero outside the table.

    Between breakpoints log density is linear in log frequency. Give one of `profile` (a name
    that ships, in g^2/Hz), `file` (two columns) and `frequency_hz` with `density`; the last two
    need `unit`. `level_db` raises or lowers the whole table.

    Examples
    --------
    >>> truck = TabulatedNoise(on="base", profile="mil-std-810h-truck-vertical-5hz")
    >>> round(truck.table.mean_square() ** 0.5 / 9.80665, 4)
    1.0783
    """

    kind: Literal["psd"] = "psd"
    on: str | None = None
    profile: str | None = None
    file: str | None = None
    frequency_hz: Column | None = None
    density: Column | None = None
    unit: Unit | None = None
    level_db: Number = 0.0
    _table: Table = PrivateAttr()

    @model_validator(mode="after")
    def _read(self) -> Self:
        inline = self.frequency_hz is not None or self.density is not None
        if (self.profile is not None) + (self.file is not None) + inline != 1:
            raise ValueError(
                "needs exactly one of profile, file, and frequency_hz with density, "
                f"got {given(self, 'profile', 'file', 'frequency_hz', 'density')}"
            )
        if self.profile is None and self.unit is None:
            raise ValueError(f"needs unit, one of {', '.join(DENSITY_UNITS)}, got none")
        if self.profile is not None and self.unit not in (None, "g2/Hz"):
            raise ValueError(f"has unit {self.unit!r}, but shipped profiles are in 'g2/Hz'")
        if abs(self.level_db) > 200.0:
            raise ValueError(f"has level_db outside -200..200, got {self.level_db:g}")
        frequency, density = self._columns()
        factor = DENSITY_UNITS[self.unit or "g2/Hz"] * power_ratio(self.level_db)
        try:
            self._table = Table(frequency_hz=frequency, density=density).scaled(factor)
        except ValueError as error:
            where = "" if self.file is None else f"{self.file} "
            raise SceneError([("" if self.file is None else "file", f"{where}{error}")]) from None
        return self

    def _columns(self) -> tuple[np.ndarray, np.ndarray]:
        if self.profile is not None:
            if self.profile not in profiles():
                raise ValueError(
                    f"has the unknown profile {self.profile!r}; known: {', '.join(profiles())}"
                )
            shipped = profiles()[self.profile]
            return np.array(shipped.frequency_hz), np.array(shipped.density)
        if self.file is not None:
            try:
                return read_table(Path(self.file))
            except SceneError as error:
                raise SceneError([("file", str(error))]) from None
        if self.frequency_hz is None or self.density is None:
            raise ValueError(
                "needs frequency_hz and density together, "
                f"got {given(self, 'frequency_hz', 'density')}"
            )
        return np.array(self.frequency_hz), np.array(self.density)

    @property
    def table(self) -> Table:
        """Breakpoints in hertz and SI units, level included."""
        return self._table


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


Excitation = WhiteNoise | FilteredNoise | TabulatedNoise | Sine | ConstantLoad
"""Every excitation that a scene may hold."""
