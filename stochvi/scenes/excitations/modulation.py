"""A stiffness, a damping or a clearance that changes in time."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar, Literal, Self

from pydantic import model_validator

from stochvi.mathematics.spectra import Filter
from stochvi.scenes.excitations.base import BaseExcitation
from stochvi.scenes.validation import Positive, given

WIDEST = 0.2
"""Largest standard deviation of the relative change of a clearance, which stays above 0."""


class Modulation(BaseExcitation):
    """A relative change xi(t) of a stiffness, damping or clearance, as k (1 + xi(t)).

    It is a sine of `amplitude` and `frequency_hz`; white noise of `intensity`; or, with
    `frequency_hz` and `zeta` as well, that noise after a resonance, as `FilteredNoise` has it.

    White noise is meant in the sense of Stratonovich: it is the limit of noise of a wide band. For
    a stiffness, Ito means the same. For a damping c he has c + c^2 intensity / (2 m) in the mean,
    where Stratonovich has c.

    Parameters
    ----------
    of
        What changes: "stiffness" or "damping" of the linear structure, or "clearance": the stops
        move, and their distance from the unloaded spring changes.
    on, between
        Where there are several coordinates: the one whose spring and damper to the ground change,
        or the two between which they act. For a clearance `on` is the name of the impact pair,
        where there are several.
    amplitude
        Peak of xi of a sine, whose phase is random in each path.
    frequency_hz
        Frequency of the sine, or of the resonance, Hz.
    intensity
        S of E xi(t) xi(t + tau) = S delta(tau), s; half of a one-sided density in 1/Hz.
    zeta
        Damping ratio of the resonance.

    See Also
    --------
    stochvi.stability : Whether the motion without stops grows.

    Examples
    --------
    >>> Modulation(of="stiffness", amplitude=0.3, frequency_hz=2.0).source
    'a sine'
    >>> slow = Modulation(of="stiffness", intensity=0.01, frequency_hz=2.0, zeta=0.5)
    >>> slow.source, round(slow.size, 3)
    ('filtered noise', 0.251)
    """

    family: ClassVar[str] = "modulation"
    shakes: ClassVar[bool] = False

    kind: Literal["modulation"] = "modulation"
    of: Literal["stiffness", "damping", "clearance"]
    on: str | None = None
    amplitude: Positive | None = None
    frequency_hz: Positive | None = None
    intensity: Positive | None = None
    zeta: Positive | None = None

    @model_validator(mode="after")
    def _one_source(self) -> Self:
        keys = given(self, "amplitude", "frequency_hz", "intensity", "zeta")
        if keys not in SOURCES:
            raise ValueError(
                "needs amplitude and frequency_hz (a sine), intensity (white noise), or intensity, "
                f"frequency_hz and zeta (filtered noise), got {keys}"
            )
        if given(self, "weights", "axis", "name") != "none":
            raise ValueError(f"takes no {given(self, 'weights', 'axis', 'name')}")
        if self.of == "clearance" and self.between is not None:
            raise ValueError("takes the name of the pair in on for a clearance, got between")
        if self.of == "clearance" and not self.size <= WIDEST:
            raise ValueError(
                "needs frequency_hz and a standard deviation of at most "
                f"{WIDEST:g} for a clearance, got {self.source} of {self.size:.3g}"
            )
        return self

    @property
    def source(self) -> str:
        """What the relative change is, in words."""
        return SOURCES[given(self, "amplitude", "frequency_hz", "intensity", "zeta")]

    @property
    def effect_word(self) -> str:  # type: ignore[override]
        """Name of the modulation in the effects of a scene."""
        return f"modulation of {self.of} by {self.source}"

    @property
    def omega(self) -> float:
        """Frequency of the sine or of the resonance, rad/s; 0 of white noise."""
        return 2.0 * math.pi * (self.frequency_hz or 0.0)

    @property
    def filter(self) -> Filter | None:
        """The resonance; None of a sine, and of white noise."""
        if self.zeta is None or self.intensity is None:
            return None
        return Filter(self.omega, 2.0 * self.zeta * self.omega, self.intensity)

    @property
    def size(self) -> float:
        """Standard deviation of the relative change; infinite of white noise."""
        if self.amplitude is not None:
            return self.amplitude / math.sqrt(2.0)
        if self.zeta is None or self.intensity is None:
            return math.inf
        return math.sqrt(self.omega * self.intensity / (4.0 * self.zeta))

    def louder(self, level_db: float) -> Self:
        """The same modulation, which belongs to the structure and not to what shakes it."""
        return self

    def facts(self, where: str, numbers: Mapping[str, float]) -> list[tuple[str, ...]]:
        keys = ("amplitude", "intensity", "frequency_hz", "zeta")
        stated = [f"{key} {getattr(self, key):g}" for key in keys if getattr(self, key) is not None]
        name = self.effect_word
        return [(f"{name[0].upper()}{name[1:]} on {where}", ", ".join(stated), "relative change")]


SOURCES = {
    "amplitude, frequency_hz": "a sine",
    "intensity": "white noise",
    "frequency_hz, intensity, zeta": "filtered noise",
}
"""Words for what a relative change is, by the keys that are given."""
