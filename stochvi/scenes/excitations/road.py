"""A base that follows a road."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar, Literal, Self

from pydantic import model_validator

from stochvi.mathematics.units import STANDARD_GRAVITY, power_ratio
from stochvi.scenes.excitations.base import BASE, DensityNoise, band_of
from stochvi.scenes.roads import ROUGHNESS, WAVENUMBERS, road_table
from stochvi.scenes.validation import Band, Positive, given


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

    effect_word: ClassVar[str] = "tabulated noise of a road"

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

    def cautions(self, omega: float, damping_rate: float) -> tuple[str, ...]:
        """A mount that is bolted to a road feels more than any vehicle would pass on."""
        if not omega or self.band_hz is not None:
            return ()
        rms = math.sqrt(self._table.mean_square()) / STANDARD_GRAVITY
        return (
            f"the mount stands on the road itself, with no vehicle between them: {rms:.3g} g rms "
            f"up to {self._table.frequency_hz[-1]:.3g} Hz; tyres and springs pass on little above "
            'some 20 Hz: put the masses of the vehicle into the scene (kind = "matrices"), or '
            "band_hz around what reaches the mount",
        )

    def facts(self, where: str, numbers: Mapping[str, float]) -> list[tuple[str, ...]]:
        which = f"class {self.road}" if self.road else f"Gd(n0) = {self.roughness:g} m³"
        remark = (
            f"at {self.metres_per_second:.4g} m/s, {band_of(numbers)}; no vehicle between road and "
            "mount"
        )
        return [("Road of ISO 8608", which + self.raised, remark)]


KMH_PER_METRE_PER_SECOND = 3.6
"""Kilometres per hour in a metre per second."""
