"""A base that follows a road."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar, Literal, Self

from pydantic import PrivateAttr, model_validator

from stochvi.mathematics.spectra import Table
from stochvi.mathematics.units import STANDARD_GRAVITY, power_ratio
from stochvi.scenes.excitations.base import BASE, DensityNoise, band_of
from stochvi.scenes.road_density import ROUGHNESS, WAVENUMBERS, road_table
from stochvi.scenes.validation import Band, Positive, given
from stochvi.scenes.vehicles import QuarterCar


class RoadNoise(DensityNoise):
    """A base that follows a road of ISO 8608 at a constant speed (see `road_density`).

    Within `band_hz` the density of its vertical velocity is constant, and that of its acceleration
    rises as f^2. The mount stands on the road itself, or on the vehicle of the scene.

    Parameters
    ----------
    road, roughness
        Exactly one: a class, "A" (smooth) to "H", by its geometric mean, or Gd(n0) in m^3.
    speed, speed_kmh
        Exactly one: m/s or km/h.
    band_hz
        Lowest and highest frequency, Hz; by default 0.01 and 10 cycles per metre times the speed.

    See Also
    --------
    stochvi.scenes.QuarterCar : A vehicle between the road and the mount.

    Examples
    --------
    >>> road = RoadNoise(road="C", speed_kmh=72.0, band_hz=[0.5, 50.0])
    >>> round(float(road.table(10.0)), 3), road.table.frequency_hz.tolist()
    (7.98, [0.5, 50.0])
    """

    effect_word: ClassVar[str] = "tabulated noise of a road"

    kind: Literal["road"] = "road"
    on: str | None = BASE
    road: Literal["A", "B", "C", "D", "E", "F", "G", "H"] | None = None
    roughness: Positive | None = None
    speed: Positive | None = None
    speed_kmh: Positive | None = None
    band_hz: Band | None = None
    _road: Table = PrivateAttr()
    _vehicle: QuarterCar | None = PrivateAttr(default=None)

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
        self._road = table.scaled(power_ratio(self.level_db))
        self._reach_the_base()  # a scene that takes a road of another one checks it again
        return self

    def _reach_the_base(self) -> None:
        through = self._vehicle
        self._table = self._road if through is None else through.passed(self._road)

    @property
    def metres_per_second(self) -> float:
        """Speed, m/s."""
        if self.speed is not None:
            return self.speed
        assert self.speed_kmh is not None
        return self.speed_kmh / KMH_PER_METRE_PER_SECOND

    def behind(self, vehicle: QuarterCar | None) -> Self:
        """The same road with a vehicle between it and the base; None for no vehicle."""
        found = self.model_copy()
        found._vehicle = vehicle
        found._reach_the_base()
        return found

    def louder(self, level_db: float) -> Self:
        return super().louder(level_db).behind(self._vehicle)

    @property
    def density_unit(self) -> str | None:
        return "(m/s2)2/Hz"

    def assumptions(self, omega: float = 0.0, damping_rate: float = 0.0) -> tuple[str, ...]:
        low, high = self._table.frequency_hz[[0, -1]]
        which = f"class {self.road}" if self.road else f"Gd(n0) = {self.roughness:g} m^3"
        subject = "the base follows" if self._vehicle is None else "the vehicle drives on"
        suspension = ", without a suspension" if self._vehicle is None else ""
        return (
            f"{subject} a road of ISO 8608, {which}, at {self.metres_per_second:.4g} m/s, "
            f"from {low:.3g} to {high:.3g} Hz{suspension}; class table from secondary sources",
            *(() if self._vehicle is None else self._vehicle.assumptions()),
        )

    def cautions(self, omega: float, damping_rate: float, *, alone: bool = True) -> tuple[str, ...]:
        """A warning if the mount stands on the road itself, which shakes it more than any vehicle
        would."""
        if not omega or self.band_hz is not None or self._vehicle is not None:
            return ()
        if not alone and omega < 2.0 * math.pi * SLOWEST_MOUNT:
            return ()
        rms = math.sqrt(self._table.mean_square()) / STANDARD_GRAVITY
        return (
            f"the mount stands on the road itself, with no vehicle between them: {rms:.3g} g rms "
            f"up to {self._table.frequency_hz[-1]:.3g} Hz; tyres and springs pass on little above "
            'some 20 Hz: put a [vehicle] between them (preset = "golden-car", or parameters of its '
            "own), or band_hz around what reaches the mount",
        )

    def facts(self, where: str, numbers: Mapping[str, float]) -> list[tuple[str, ...]]:
        which = f"class {self.road}" if self.road else f"Gd(n0) = {self.roughness:g} m³"
        remark = f"at {self.metres_per_second:.4g} m/s, {band_of(numbers)}"
        if self._vehicle is None:
            remark += "; no vehicle between road and mount"
            return [("Road of ISO 8608", which + self.raised, remark)]
        body, wheel = self._vehicle.modes
        return [
            ("Road of ISO 8608", which + self.raised, remark),
            (
                f"Vehicle, mount on its {self._vehicle.mounted_on}",
                f"quarter car, {self._vehicle.preset or 'parameters of its own'}",
                f"body {body.frequency_hz:.3g} Hz, damping ratio {body.damping_ratio:.2g}; wheel "
                f"hop {wheel.frequency_hz:.3g} Hz, damping ratio {wheel.damping_ratio:.2g}",
            ),
        ]


KMH_PER_METRE_PER_SECOND = 3.6
"""Speed of 1 m/s in km/h."""


SLOWEST_MOUNT = 4.0
"""Lowest natural frequency from which on a structure holds no vehicle, Hz: bodies of vehicles move
on their springs at 1 to 2 Hz."""
