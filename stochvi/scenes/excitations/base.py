"""Base classes of excitations, and the plainest ones. Chapters: base classes and checks of their
units; white noise; a constant load; a sine."""

from __future__ import annotations

import math
import re
from abc import abstractmethod
from collections.abc import Callable, Mapping
from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import AfterValidator, PrivateAttr, field_validator, model_validator

from stochvi.mathematics.spectra import Table
from stochvi.mathematics.units import (
    DENSITIES,
    UNITS,
    Unit,
    intensity_from_density,
    listed_units,
    power_ratio,
    shown,
    unit,
)
from stochvi.mathematics.unsteady_noise import MOST_KURTOSIS, RandomLevel
from stochvi.results.errors import SceneError
from stochvi.scenes.readers import Columns
from stochvi.scenes.text_tables import may_be_unit
from stochvi.scenes.validation import Checked, Number, Positive, Seconds, Weights, given

BASE = "base"
"""The place of an excitation that moves the base; every other place is a coordinate."""

OF_PLACES = frozenset({"on", "between", "weights", "axis", "name"})
"""The keys of an excitation that say what it acts on, and its name."""

Density = Callable[[ArrayLike], NDArray[np.float64]]
"""A one-sided density per hertz, in SI units, as a function of the frequency in hertz."""


def unit_name(spelling: str, *quantities: str, decibels: bool = False) -> str:
    """The usual name of a unit, which must be of one of `quantities`; otherwise a ValueError."""
    known = listed_units(*quantities)
    try:
        found = unit(spelling)
    except ValueError:
        found = None
    if found is None or found.quantity not in quantities or (found.decibels and not decibels):
        level = ", or dB re 1 g2/Hz" if decibels else ""
        other = "is not a known unit" if found is None else "is a unit of another quantity"
        raise ValueError(f"{spelling!r} {other}; expected {known}{level}, or a spelling of these")
    return found.name


def _density_name(spelling: str) -> str:
    return unit_name(spelling, *DENSITIES)


def _density_or_level_name(spelling: str) -> str:
    return unit_name(spelling, *DENSITIES, decibels=True)


DensityUnit = Annotated[str, AfterValidator(_density_name)]
"""A unit of a one-sided density, in any spelling; kept by its usual name."""

DensityOrLevelUnit = Annotated[str, AfterValidator(_density_or_level_name)]
"""A unit of a one-sided density, or of its level in decibels; kept by its usual name."""


def check_unit(name: str, on: str) -> None:
    """Raise a ValueError unless a unit is a force density on a mass or an acceleration density on
    the base."""
    fitting = "acceleration density" if on == BASE else "force density"
    if unit(name).quantity != fitting:
        choices = " or ".join(UNITS[fitting])
        raise ValueError(
            f"is a density in {name!r}, but on = {on!r} takes a density in {choices}: an "
            'acceleration moves the base of a structure (on = "base"), a force acts on a coordinate'
        )


class BaseExcitation(Checked):
    """Base class of every excitation.

    Parameters
    ----------
    on
        What it acts on: a coordinate, as a force, or "base", as an acceleration of the base. May be
        left out where only one place is possible: the base of an isolator, x of an oscillator.
    between
        Instead: two coordinates or points; the force acts on the first, and its reaction on the
        second.
    weights
        Instead: the weights of several coordinates or points, as { tip = 1.0, middle = 0.5 }; the
        force acts on each of them, times its weight.
    axis
        Axis along which it moves the base of a rigid body, "x", "y" or "z".
    name
        Name of its own, by which a cross density refers to it.
    """

    own: ClassVar[str] = "a density of your own is a TabulatedNoise"

    between: tuple[str, str] | None = None
    weights: Weights | None = None
    axis: Literal["x", "y", "z"] | None = None
    name: str | None = None

    shakes: ClassVar[bool] = True
    """Whether it shakes the structure."""

    effect_word: ClassVar[str]
    """Name of the excitation in the effects of a scene."""

    family: ClassVar[str]
    """Effect to which the excitation belongs. The absent effects of a scene are those to which none
    of its excitations belongs."""

    @field_validator("between", mode="before")
    @classmethod
    def _two_names(cls, names: object) -> object:
        return tuple(names) if isinstance(names, list) else names

    @property
    def density_unit(self) -> str | None:
        """Unit of the density as it was given; None where none was given."""
        return None

    @abstractmethod
    def louder(self, level_db: float) -> Self:
        """The excitation raised by a level in dB; a constant load stays as it is."""

    def density_for(self, omega: float, damping_rate: float) -> Density | None:
        """The density that shakes an oscillator with omega (rad/s) and damping rate b (1/s); None
        for excitations that are no noise."""
        return None

    def numbers(self) -> dict[str, float]:
        """Numbers, in SI units, that a report states and that are not in the scene file."""
        return {}

    @abstractmethod
    def facts(self, where: str, numbers: Mapping[str, float]) -> list[tuple[str, ...]]:
        """Rows of a report: name, value with its unit, and a remark.

        Parameters
        ----------
        where
            What the excitation acts on, `BASE` or a coordinate.
        numbers
            Numbers that the method `numbers` returned.
        """


class StrengthNoise(BaseExcitation):
    """Base of noise that is made from white noise, whose strength is given by `intensity` S0, or by
    a one-sided `density` with its `unit`.

    Parameters
    ----------
    intensity
        S0, two-sided, N^2 s on a mass, (m/s^2)^2 s on the base.
    density
        Instead of the intensity: the one-sided density per hertz, 2 S0, in `unit`.
    unit
        Unit of the density: "g2/Hz" or "(m/s2)2/Hz" on the base, "N2/Hz" on a mass, in any
        spelling.
    """

    on: str | None = None
    intensity: Positive | None = None
    density: Positive | None = None
    unit: DensityUnit | None = None

    @property
    def density_unit(self) -> str | None:
        """Unit of the density; None for an intensity, which is in SI units."""
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
        return intensity_from_density(self.density * unit(self.unit).factor)

    def louder(self, level_db: float) -> Self:
        power = power_ratio(level_db)
        return self.model_copy(
            update={
                name: power * strength
                for name, strength in (("intensity", self.intensity), ("density", self.density))
                if strength is not None
            }
        )

    def numbers(self) -> dict[str, float]:
        return {"density": 2.0 * self.si_intensity}

    def facts(self, where: str, numbers: Mapping[str, float]) -> list[tuple[str, ...]]:
        unit = "(m/s²)²/Hz" if where == BASE else "N²/Hz"
        name = f"{self.effect_word.capitalize()} on {where}"
        return [(name, f"{numbers['density']:.4g} {unit}", self._remark())]

    def _remark(self) -> str:
        return "one-sided; intensity S0 is half of it"


class DensityNoise(BaseExcitation):
    """Base of Gaussian noise with a one-sided density per hertz, zero outside its band.

    Parameters
    ----------
    level_db
        Decibels by which the whole density is raised, -200 to 200: +3 dB doubles it, -20 dB is
        a tenth of the rms value.
    kurtosis
        Kurtosis of the noise, above 3; by default it is Gaussian, with 3. With `level_time` its
        level in decibels varies slowly, as a normal process. Without, fast peaks of a steady noise
        make it, up to 20; a narrow mount averages them out.
    level_time
        Correlation time of the level, s, or a text with a unit, "10 s".
    """

    family: ClassVar[str] = "tabulated noise"

    on: str | None = None
    level_db: Number = 0.0
    kurtosis: Number | None = None
    level_time: Seconds | None = None
    _table: Table = PrivateAttr()

    @model_validator(mode="after")
    def _level(self) -> Self:
        if abs(self.level_db) > LARGEST_LEVEL:
            raise ValueError(f"has level_db outside -200..200, got {self.level_db:g}")
        if self.kurtosis is None and self.level_time is not None:
            raise ValueError("needs kurtosis with level_time, got level_time alone")
        most = MOST_KURTOSIS if self.level_time is None else MOST_KURTOSIS_OF_LEVEL
        if self.kurtosis is not None and not 3.0 < self.kurtosis <= most:
            problem = f"must be above 3 and at most {most:g}, got {self.kurtosis:g}"
            raise SceneError("kurtosis", problem)
        return self

    @property
    def has_fast_peaks(self) -> bool:
        """Whether fast peaks of a steady noise make its kurtosis."""
        return self.kurtosis is not None and self.level_time is None

    @property
    def random_level(self) -> RandomLevel | None:
        """How its level varies; None where it is steady."""
        if self.kurtosis is None or self.level_time is None:
            return None
        return RandomLevel(self.kurtosis, self.level_time)

    @property
    def table(self) -> Table:
        """Breakpoints in hertz and SI units, level included."""
        return self._table

    def table_for(self, omega: float, damping_rate: float) -> Table:
        """The table that excites an oscillator with omega (rad/s) and damping rate b (1/s)."""
        return self._table

    def density_for(self, omega: float, damping_rate: float) -> Density:
        return self.table_for(omega, damping_rate)

    @property
    @abstractmethod
    def density_unit(self) -> str | None:
        """Unit of the density as it was given."""

    def assumptions(self, omega: float = 0.0, damping_rate: float = 0.0) -> tuple[str, ...]:
        """Assumptions about the noise, in words, for an oscillator if its numbers are given."""
        return ()

    def cautions(self, omega: float, damping_rate: float, *, alone: bool = True) -> tuple[str, ...]:
        """Sentences on what makes the response of an oscillator with this omega (rad/s) and damping
        rate (1/s) doubtful. It is `alone`, or the slowest mode of a structure of several."""
        return ()

    def model_copy(self, *, update: Mapping[str, Any] | None = None, deep: bool = False) -> Self:
        """A copy with other values; where they may change the density, checked as a new noise."""
        changed = dict(update or {})
        if not set(changed) <= OF_PLACES:
            return self.replace(**changed)
        return super().model_copy(update=changed, deep=deep)

    def louder(self, level_db: float) -> Self:
        return self.replace(level_db=self.level_db + level_db)

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
        return f", at {self.level_db:+g} dB" if self.level_db else ""

    @property
    def of_its_kurtosis(self) -> tuple[str, ...]:
        """A sentence on what makes its kurtosis; none where it is Gaussian."""
        level = self.random_level
        if self.has_fast_peaks:
            return (
                "the noise has fast peaks: it is a monotone cubic of Gaussian noise without memory "
                f"(Winterstein), filtered to its density; its kurtosis is {self.kurtosis:g}",
            )
        if level is None:
            return ()
        return (
            f"the level of the noise has a normal distribution in dB, with the standard deviation "
            f"{level.spread_db:.3g} dB about {-level.spread * level.spread_db:.3g} dB and the "
            f"correlation time {level.time:g} s: kurtosis {level.kurtosis:g}",
        )


MOST_KURTOSIS_OF_LEVEL = 100.0
"""Largest kurtosis of noise of varying level: its level then varies by 8 dB, and hardly
anything but the highest levels counts."""

LARGEST_LEVEL = 200.0
"""Largest size of a change of level, dB; a larger one is probably a mistake."""


def band_of(numbers: Mapping[str, float]) -> str:
    """The band of a density, from `DensityNoise.numbers`."""
    return f"{numbers['lowest_frequency_hz']:.4g} to {numbers['highest_frequency_hz']:.4g} Hz"


def agreed_unit(name: str | None, columns: Columns, quantities: tuple[str, ...]) -> Unit:
    """The unit that the scene or the file of the columns states.

    Raises
    ------
    SceneError
        If both state a unit and these differ, if the file holds another quantity, or if neither
        states a unit.
    """
    stated = columns.unit
    if stated is None:
        _check_heading(columns.heading, unit(name) if name else None)
    if quantities == DENSITIES:
        _check_sides(columns)
    if stated is not None and name is not None and not stated.same(unit(name)):
        raise SceneError(
            "unit",
            f"is {name!r}, but {columns.stated_in} says {stated.name!r}; take out the "
            "one that is wrong",
        )
    if stated is not None and stated.quantity not in quantities:
        squares = "; square its values" * stated.quantity.startswith("root of ")
        raise SceneError(
            "file",
            f"{columns.stated_in} says {stated.name!r}, expected the unit of an "
            f"{' or a '.join(quantities)} ({listed_units(*quantities)}){squares}",
        )
    if stated is None and name is None and columns.unread and columns.lines is None:
        raise SceneError(
            "unit",
            f"must be one of {listed_units(*quantities)}, but {columns.stated_in} says "
            f"{shown(columns.unread)}; choose another one, or give unit if that text is wrong",
        )
    if stated is None and name is None:
        wanted = f"needs unit, one of {listed_units(*quantities)}, got none"
        raise ValueError(wanted + _unread_heading(columns, quantities))
    return stated or unit(name or "")


def unread_unit(columns: Columns, taken: Unit) -> tuple[str, ...]:
    """A sentence on a text above the values that looks like a unit but is unknown. Such a text is
    not compared with the unit of the scene."""
    if not columns.unread or (columns.lines is not None and not may_be_unit(columns.unread)):
        return ()
    where = "above the values" if columns.lines is not None else f"in {columns.stated_in}"
    return (
        f"the text {shown(columns.unread)} {where} is not a known unit; the values were taken to "
        f"be in {taken.name}, as the scene states",
    )


def _unread_heading(columns: Columns, quantities: tuple[str, ...]) -> str:
    """The text above the values of a file without a known unit, and how to write decibels.

    It is empty if there is no such text. For a density, a line that names hertz is used if the
    heading of the column does not.
    """
    heading = columns.heading
    if quantities == DENSITIES and "hz" not in heading.casefold():
        of_hertz = [text.strip() for _, text in columns.remarks if "hz" in text.casefold()]
        heading = of_hertz[-1] if of_hertz else heading
    if not heading:
        return ""
    decibels = '; decibels are written as unit = "dB re 1 g2/Hz"' if "dB" in heading else ""
    return f"; above the values stands {shown(heading)}{decibels}"


def _check_sides(columns: Columns) -> None:
    """Refuse a density if a heading or a comment states that it is two-sided."""
    for place, text in (("above its values", columns.heading), *columns.remarks):
        if re.search(TWO_SIDED, text, re.I) and not re.search(ONE_SIDED, text, re.I):
            raise SceneError(
                "file",
                f"says {text.strip()[:80]!r} ({place}), expected a one-sided density; "
                "leave out negative frequencies, double the values at positive ones, and say "
                "one-sided there",
            )


def _check_heading(heading: str, named: Unit | None) -> None:
    """Refuse a heading that contradicts the unit of the scene by decibels."""
    if re.search(r"\bdB\b", heading, re.I) and not (named and named.decibels):
        raise SceneError(
            "unit",
            f"must say what 0 dB stands for, as in 'dB re 1 g2/Hz': above the values "
            f"stands {heading!r}",
        )


TWO_SIDED = r"(?:two|double|2)[-_ ]?sided|zweiseitig|bilat[eé]ral"
"""Pattern of words for a density that is given for negative frequencies as well."""

ONE_SIDED = r"(?:one|single|1)[-_ ]?sided|einseitig|unilat[eé]ral"
"""Pattern of words for a density of positive frequencies only, as all densities here are."""


# ------------------------------------------------------------------------------
# White noise.
# ------------------------------------------------------------------------------


class WhiteNoise(StrengthNoise):
    """White noise, E f(t) f(t + tau) = S0 delta(tau), as a force or a base acceleration.

    Give `intensity`, or `density` with its `unit`; S0 = density / 2.

    See Also
    --------
    stochvi.FilteredNoise : White noise through a resonance.
    stochvi.TabulatedNoise : Noise by its density.

    Examples
    --------
    >>> WhiteNoise(intensity=0.2).si_intensity
    0.2
    >>> round(WhiteNoise(on="base", density=0.01, unit="g2/Hz").si_intensity, 6)
    0.480852
    """

    effect_word: ClassVar[str] = "white noise"
    family: ClassVar[str] = "white noise"

    kind: Literal["white"] = "white"

    def density_for(self, omega: float, damping_rate: float) -> Density:
        return lambda frequency_hz: np.full(np.shape(frequency_hz), 2.0 * self.si_intensity)


# ------------------------------------------------------------------------------
# A constant load.
# ------------------------------------------------------------------------------


class ConstantLoad(BaseExcitation):
    """A constant force on the mass (N), or a constant acceleration of the base (m/s^2).

    Gravity that pulls towards negative x is `force = -m g`, or `acceleration = 9.80665` of the
    base. If clearances are measured from where the mass hangs, leave gravity out.

    Parameters
    ----------
    force
        Force on a mass, N.
    acceleration
        Acceleration of the base, m/s^2.

    See Also
    --------
    stochvi.Scene : The scene that holds it.

    Examples
    --------
    >>> ConstantLoad(force=-9.80665).magnitude
    -9.80665
    """

    effect_word: ClassVar[str] = "constant load"
    family: ClassVar[str] = "constant load"
    shakes: ClassVar[bool] = False

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

    def louder(self, level_db: float) -> Self:
        return self

    def facts(self, where: str, numbers: Mapping[str, float]) -> list[tuple[str, ...]]:
        unit = "m/s²" if where == BASE else "N"
        return [(f"Constant load on {where}", f"{self.magnitude:.4g} {unit}")]


# ------------------------------------------------------------------------------
# A sine.
# ------------------------------------------------------------------------------


STRENGTHS = ("amplitude", "displacement", "velocity", "unbalance")
"""Keys for the strength of a sine; a sine takes one of them."""


class Sine(BaseExcitation):
    """A sine, a cos(2 pi frequency_hz t + phase), with a random phase in each path.

    Parameters
    ----------
    amplitude
        Peak (not rms) of the force on a mass, N, or of the acceleration of the base, m/s^2 or in
        `unit`.
    unit
        Unit of the amplitude of a base, as "g"; by default SI units.
    displacement, velocity
        Instead: peak displacement (m) or velocity (m/s) of the base, so that the acceleration grows
        with the frequency. A displacement `between` two coordinates is that of a crank on one of
        them. It moves the end of the spring and damper that lead to the other.
    unbalance
        Instead: the unbalance of a rotor on the mass, kg m, whose force is unbalance * omega^2.
    frequency_hz
        Frequency, Hz.
    phase_deg
        Phase of the sine, degrees, where several sines make one periodic force. Periodic regimes
        use it; every other method draws phases at random.

    See Also
    --------
    stochvi.harmonic_response : All regimes under a sine.

    Examples
    --------
    >>> Sine(on="base", amplitude=9.80665, frequency_hz=50.0).peak
    9.80665
    >>> Sine(on="base", amplitude=0.5, unit="g", frequency_hz=17.0).peak
    4.903325
    >>> round(Sine(on="base", displacement=1e-4, frequency_hz=50.0).peak, 3)
    9.87
    """

    effect_word: ClassVar[str] = "sine"
    family: ClassVar[str] = "sine"

    kind: Literal["sine"] = "sine"
    on: str | None = None
    amplitude: Positive | None = None
    unit: str | None = None
    displacement: Positive | None = None
    velocity: Positive | None = None
    unbalance: Positive | None = None
    frequency_hz: Positive
    phase_deg: Number = 0.0

    @model_validator(mode="after")
    def _one_strength(self) -> Self:
        if len(self._strengths()) != 1:
            raise ValueError(
                "needs exactly one of amplitude (N; m/s^2 of a base), displacement (m of the "
                "base), velocity (m/s of the base) and unbalance (kg m), got "
                f"{given(self, *STRENGTHS)}"
            )
        if self.unit is not None and self.amplitude is None:
            raise SceneError("unit", "is that of amplitude, got none; leave unit out")
        self._factor  # noqa: B018  a unit that is none is refused here
        return self

    @property
    def _factor(self) -> float:
        """The amplitude in SI units over the number that is given."""
        if self.unit is None:
            return 1.0
        found = unit(self.unit)
        if found.quantity not in ("acceleration", "force"):
            raise SceneError(
                "unit", f"must be one of {listed_units('acceleration', 'force')}, got {self.unit!r}"
            )
        return found.factor

    def _strengths(self) -> dict[str, float]:
        values = {name: getattr(self, name) for name in STRENGTHS}
        return {name: value for name, value in values.items() if value is not None}

    @property
    def strength(self) -> tuple[str, float]:
        """The key that gives the strength, and its number."""
        ((name, value),) = self._strengths().items()
        return name, value

    @property
    def crank(self) -> float | None:
        """Radius (m) of a crank between two coordinates; None for a force, or on a base."""
        return None if self.between is None else self.displacement

    @property
    def peak(self) -> float:
        """Peak force on a mass, N, or peak acceleration of the base or of a crank, m/s^2."""
        name, value = self.strength
        power = {"amplitude": 0, "velocity": 1}.get(name, 2)
        factor = self._factor * (2.0 * math.pi * self.frequency_hz) ** power
        return float(value * factor)

    def misplaced(self, where: str) -> str:
        """Fault of the key of the strength for a sine that acts on `where`; empty if nothing is."""
        name, _ = self.strength
        if name in ("displacement", "velocity") and where != BASE and not self.crank:
            return f"has {name}, which is that of the base, got on = {where!r}; give amplitude (N)"
        quantity = "acceleration" if where == BASE or self.crank else "force"
        if self.unit is not None and unit(self.unit).quantity != quantity:
            fitting = listed_units(quantity)
            return f"has unit = {self.unit!r} on {where!r}; expected one of {fitting}"
        if name == "unbalance" and where == BASE:
            return "has unbalance, which acts on a mass, got on = 'base'; give amplitude (m/s^2)"
        return ""

    def louder(self, level_db: float) -> Self:
        name, value = self.strength
        return self.model_copy(update={name: math.sqrt(power_ratio(level_db)) * value})

    def facts(self, where: str, numbers: Mapping[str, float]) -> list[tuple[str, ...]]:
        unit = "m/s² peak" if where == BASE else "N peak"
        strength = f"{self.crank:.4g} m crank" if self.crank else f"{self.peak:.4g} {unit}"
        return [(f"Sine on {where}", strength, f"at {self.frequency_hz:g} Hz")]
