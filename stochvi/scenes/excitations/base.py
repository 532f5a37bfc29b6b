"""What every excitation says of itself, and what noise of a density says besides."""

from __future__ import annotations

import contextlib
from abc import abstractmethod
from collections.abc import Iterator, Mapping
from typing import ClassVar, Literal, Self

from pydantic import PrivateAttr, model_validator

from stochvi.mathematics.spectra import Table
from stochvi.mathematics.units import ACCELERATION_DENSITY_UNITS, FORCE_DENSITY_UNITS
from stochvi.results.errors import SceneError
from stochvi.scenes.validation import Checked, Number

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


class Disturbance(Checked):
    """Something that shakes; the base of every excitation.

    An excitation that leaves out an abstract method cannot be made.
    """

    effect_word: ClassVar[str]
    """Its name in the effects of a scene."""

    family: ClassVar[str]
    """The effect of which it is one kind; an effect that no excitation of a scene has is absent."""

    @abstractmethod
    def louder(self, level_db: float) -> Self:
        """The excitation raised by a level in dB; a constant load stays as it is."""

    def numbers(self) -> dict[str, float]:
        """Numbers that a report states and the scene file does not, SI units."""
        return {}

    @abstractmethod
    def facts(self, where: str, numbers: Mapping[str, float]) -> list[tuple[str, ...]]:
        """Name, value with its unit, and a remark, for a report.

        Parameters
        ----------
        where
            What it acts on, `BASE` or a coordinate.
        numbers
            Those of `numbers`.
        """


class DensityNoise(Disturbance):
    """Base of Gaussian noise with a one-sided density per hertz, zero outside its band.

    `level_db` raises or lowers the whole density.
    """

    family: ClassVar[str] = "tabulated noise"

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
    @abstractmethod
    def density_unit(self) -> str | None:
        """Unit of the density as it was given."""

    def said(self, omega: float = 0.0, damping_rate: float = 0.0) -> tuple[str, ...]:
        """What is taken for granted about it, in words, for an oscillator if one is given."""
        return ()

    def cautions(self, omega: float, damping_rate: float) -> tuple[str, ...]:
        """What of it should be known before a response of that oscillator is believed."""
        return ()

    def louder(self, level_db: float) -> Self:
        keys = self.model_dump(exclude_none=True)
        return type(self)(**(keys | {"level_db": self.level_db + level_db}))

    def numbers(self) -> dict[str, float]:
        frequency = self.table.frequency_hz
        return {
            "points": len(frequency),
            "lowest_frequency_hz": float(frequency[0]),
            "highest_frequency_hz": float(frequency[-1]),
        }

    def facts(self, where: str, numbers: Mapping[str, float]) -> list[tuple[str, ...]]:
        name = f"{self.effect_word.capitalize()} on {where}"
        return [(name, f"one-sided density{self.raised}", band_of(numbers))]

    @property
    def raised(self) -> str:
        """The level, in words that follow a name; empty for none."""
        return f", raised by {self.level_db:+g} dB" if self.level_db else ""


LARGEST_LEVEL = 200.0
"""Decibels; more is a slip."""


def band_of(numbers: Mapping[str, float]) -> str:
    """The band of a density, from `DensityNoise.numbers`."""
    return f"{numbers['lowest_frequency_hz']:.4g} to {numbers['highest_frequency_hz']:.4g} Hz"


def agreed_unit(unit: str | None, stated: str | None, choices: Mapping[str, float]) -> str:
    """The unit that the scene says, or else its source; never two."""
    stated = stated if stated in choices else None
    if unit is None and stated is None:
        raise ValueError(f"needs unit, one of {', '.join(choices)}, got none")
    if unit is not None and stated is not None and unit != stated:
        raise SceneError([("unit", f"is {unit!r}, but the file states {stated!r}")])
    return unit or stated or ""


@contextlib.contextmanager
def sentences_of(key: str) -> Iterator[None]:
    """Sentences that name no key are about this one."""
    try:
        yield
    except SceneError as error:
        raise SceneError([(name or key, text) for name, text in error.problems]) from None
