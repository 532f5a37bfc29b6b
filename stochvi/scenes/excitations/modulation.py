"""A stiffness, a damping or a clearance that changes in time."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np
from pydantic import Discriminator, PrivateAttr, Tag, model_validator

from stochvi.mathematics.spectra import Filter, Table
from stochvi.results.errors import SceneError
from stochvi.scenes.excitations.base import BaseExcitation
from stochvi.scenes.excitations.tabulated import cleaned
from stochvi.scenes.readers import read_columns
from stochvi.scenes.validation import Column, Positive, given, sentences_of

WIDEST = 0.2
"""Largest standard deviation of the relative change of a clearance, which stays above 0."""


def _form(value: Any) -> str:
    return "[]" if np.ndim(value) else ""


FrequencyOrColumn = Annotated[
    Annotated[Positive, Tag("")] | Annotated[Column, Tag("[]")], Discriminator(_form)
]
"""One frequency, or those of a table, Hz."""


class Modulation(BaseExcitation):
    """A relative change xi(t) of a stiffness, damping or clearance, as k (1 + xi(t)).

    It is a sine of `amplitude` and `frequency_hz`; white noise of `intensity`; with `frequency_hz`
    and `zeta` as well, that noise after a resonance, as `FilteredNoise` has it; or Gaussian noise
    of a tabulated density, as `TabulatedNoise` has it.

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
        or the two between which they act. Mounts of a box are "mount 1", "mount 2" and so on, in
        their order. For a clearance `on` is the name of the impact pair, where there are several.
    axis
        Axis of the mount of a box along which its spring or damper changes.
    amplitude
        Peak of xi of a sine, whose phase is random in each path.
    frequency_hz
        Frequency of the sine, or of the resonance, Hz; or the breakpoints of a table.
    intensity
        S of E xi(t) xi(t + tau) = S delta(tau), s; half of a one-sided density in 1/Hz.
    zeta
        Damping ratio of the resonance.
    density
        One-sided density of xi at each breakpoint, 1/Hz; straight between them on logarithmic axes,
        and zero outside the table.
    file
        Instead of `frequency_hz` and `density`: a file with these two columns.

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
    frequency_hz: FrequencyOrColumn | None = None
    intensity: Positive | None = None
    zeta: Positive | None = None
    density: Column | None = None
    file: str | None = None
    _table: Table | None = PrivateAttr(default=None)

    @model_validator(mode="after")
    def _one_source(self) -> Self:
        keys = given(self, *KEYS)
        if keys not in SOURCES or isinstance(self.frequency_hz, tuple) != (
            self.density is not None
        ):
            raise ValueError(
                "needs amplitude and frequency_hz (a sine), intensity (white noise), lists of "
                "frequency_hz and density or a file (a table), or intensity, frequency_hz and zeta "
                f"(filtered noise), got {keys}"
            )
        self._table = self._read()
        if given(self, "weights", "name") != "none":
            raise ValueError(f"takes no {given(self, 'weights', 'name')}")
        if self.of == "clearance" and given(self, "between", "axis") != "none":
            got = given(self, "between", "axis")
            raise ValueError(f"takes the name of the pair in on for a clearance, got {got}")
        if self.of == "clearance" and not self.size <= WIDEST:
            raise ValueError(
                "needs frequency_hz and a standard deviation of at most "
                f"{WIDEST:g} for a clearance, got {self.source} of {self.size:.3g}"
            )
        return self

    def _read(self) -> Table | None:
        """The table of the density; None without one."""
        if self.file is None:
            if self.density is None:
                return None
            try:
                return Table(
                    frequency_hz=np.array(self.frequency_hz), density=np.array(self.density)
                )
            except ValueError as error:
                raise SceneError([("", str(error))]) from None
        path = Path(self.file)
        with sentences_of("file"):
            columns, _ = cleaned(read_columns(path, ("frequency_hz", "density")), path, False)
            if columns.unit is not None:
                raise SceneError(
                    f"{path} must hold the density of a relative change (1/Hz), got "
                    f"{columns.unit.name}; leave the unit out of its heading if it is none"
                )
        assert columns.x is not None
        return Table(frequency_hz=columns.x, density=columns.y)

    @property
    def table(self) -> Table | None:
        """One-sided density of the relative change, 1/Hz; None if it is no table."""
        return self._table

    @property
    def source(self) -> str:
        """What the relative change is, in words."""
        return SOURCES[given(self, *KEYS)]

    @property
    def effect_word(self) -> str:  # type: ignore[override]
        """Name of the modulation in the effects of a scene."""
        return f"modulation of {self.of} by {self.source}"

    @property
    def omega(self) -> float:
        """Frequency of the sine or of the resonance, rad/s; 0 of white noise and of a table."""
        return 2.0 * math.pi * (self.frequency_hz if isinstance(self.frequency_hz, float) else 0.0)

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
        if self.table is not None:
            return math.sqrt(self.table.mean_square())
        if self.zeta is None or self.intensity is None:
            return math.inf
        return math.sqrt(self.omega * self.intensity / (4.0 * self.zeta))

    def louder(self, level_db: float) -> Self:
        """The same modulation, which belongs to the structure and not to what shakes it."""
        return self

    def facts(self, where: str, numbers: Mapping[str, float]) -> list[tuple[str, ...]]:
        keys = ("amplitude", "intensity", "frequency_hz", "zeta")
        numbers_of = {key: value for key in keys if isinstance(value := getattr(self, key), float)}
        stated = [f"{key} {value:g}" for key, value in numbers_of.items()]
        if self.table is not None:
            low, high = self.table.frequency_hz[[0, -1]]
            stated = [f"{low:g} to {high:g} Hz, standard deviation {self.size:.4g}"]
        name = self.effect_word
        return [(f"{name[0].upper()}{name[1:]} on {where}", ", ".join(stated), "relative change")]


KEYS = ("amplitude", "frequency_hz", "intensity", "zeta", "density", "file")
"""Keys that say what a relative change is."""

SOURCES = {
    "amplitude, frequency_hz": "a sine",
    "intensity": "white noise",
    "frequency_hz, intensity, zeta": "filtered noise",
    "frequency_hz, density": "tabulated noise",
    "file": "tabulated noise",
}
"""Words for what a relative change is, by the keys that are given."""
