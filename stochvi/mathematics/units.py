"""Conversion factors of units, and the conventions of spectral densities.

Inside the package white noise is described by its intensity S0,

    E f(t) f(t + tau) = S0 delta(tau),

a two-sided density over angular frequency whose integral over omega / (2 pi) is the mean
square. Engineers' tables, and everything that enters or leaves through a scene file, are
one-sided densities per hertz, G(f) = 2 S(2 pi f).

Displacements are relative displacements in the impact pair, in metres from the position of
the unloaded spring; a clearance is per side. A base acceleration a acts on the relative
motion as the acceleration -a.
"""

from __future__ import annotations

import itertools
import math
import re
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stochvi.mathematics.arguments import shown

if TYPE_CHECKING:
    import pint

STANDARD_GRAVITY = 9.80665
"""Standard acceleration of gravity, m/s^2: exact by definition (CGPM 1901)."""

ACCELERATION_DENSITY_UNITS = {"g2/Hz": STANDARD_GRAVITY**2, "(m/s2)2/Hz": 1.0}
"""One-sided acceleration densities: unit -> factor to (m/s^2)^2/Hz."""

FORCE_DENSITY_UNITS = {"N2/Hz": 1.0}
"""One-sided force densities: unit -> factor to N^2/Hz."""

DENSITY_UNITS = ACCELERATION_DENSITY_UNITS | FORCE_DENSITY_UNITS

UNITS: dict[str, dict[str, float]] = {
    "acceleration density": ACCELERATION_DENSITY_UNITS,
    "force density": FORCE_DENSITY_UNITS,
    "acceleration": {"g": STANDARD_GRAVITY, "m/s2": 1.0},
    "force": {"N": 1.0},
    "length": {"m": 1.0, "mm": 1e-3},
    "time": {"s": 1.0, "ms": 1e-3, "min": 60.0, "h": 3600.0},
    "frequency": {"Hz": 1.0, "kHz": 1e3},
    "speed": {"m/s": 1.0, "mm/s": 1e-3},
}
"""Quantity -> units in their usual spelling -> factor to SI units."""

DENSITIES = ("acceleration density", "force density")
"""Quantities in `UNITS` that are one-sided densities per hertz."""

PREFIXES = (
    "nano- = 1e-9 = n-",
    "micro- = 1e-6 = u- = µ- = μ-",
    "milli- = 1e-3 = m-",
    "centi- = 1e-2 = c-",
    "kilo- = 1e3 = k-",
    "mega- = 1e6 = M-",
)
"""Prefixes of units, as pint defines them."""

WORDS = (
    "meter = [length] = m = metre",
    "second = [time] = s = sec = seconds",
    "kilogram = [mass] = kg",
    "newton = kilogram * meter / second ** 2 = N",
    f"standard_gravity = {STANDARD_GRAVITY!r} * meter / second ** 2 = g = G = gn = g_n = g0 = grms"
    " = gRMS = Grms",
    "hertz = 1 / second = Hz = hz = HZ = Hertz = cps",
    "cycles_per_minute = 1 / 60 * hertz = cpm = CPM",
    f"radian = {1.0 / math.tau!r} = rad",
    f"degree = {1.0 / 360.0!r} = deg",
    "cycle = 1.0 = cycles",
    "minute = 60 * second = min = minutes",
    "hour = 3600 * second = h = hours = hr",
    "day = 86400 * second = d = days",
    "inch = 0.0254 * meter = in",
    "foot = 0.3048 * meter = ft",
    "galileo = 0.01 * meter / second ** 2 = Gal = gal",
    "mil = 0.001 * inch",
    "pound_force = 4.4482216152605 * newton = lbf = lb",
    "joule = newton * meter = J",
)
"""Units from which spellings are made: g is gravity, not gram, and an angle counts in cycles, so
that a density per rad/s becomes one per hertz. Inch, foot and pound-force are exact by definition
(international yard and pound agreement, 1959). A galileo is one cm/s^2."""


def _names(definition: str) -> list[str]:
    """The names in a definition "name = value = other name"."""
    first, _, *others = (part.strip().rstrip("-") for part in definition.split(" = "))
    return [first, *others]


SPELLINGS = frozenset(
    prefix + name
    for name in itertools.chain(*map(_names, WORDS))
    for prefix in ("", *itertools.chain(*map(_names, PREFIXES)))
) | {"sqrt", "per", "rms", "RMS"}
"""All words that the spelling of a unit may contain."""

DIMENSIONS = {
    "meter ** 2 / second ** 3": "acceleration density",
    "kilogram ** 2 * meter ** 2 / second ** 3": "force density",
    "meter / second ** 2": "acceleration",
    "kilogram * meter / second ** 2": "force",
    "meter": "length",
    "second": "time",
    "1 / second": "frequency",
    "meter / second": "speed",
}
"""Product of base units, as pint writes it -> quantity."""

PLAIN_SIGNS = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹\u2212·⋅\u00d7\u2044\u2215", "-0123456789-***//")
"""Superscripts and signs of typeset units -> the same in plain text."""

LONGEST_SPELLING = 60
"""Largest number of characters of the spelling of a unit; a longer text is not read as a unit."""


@dataclass(frozen=True)
class Unit:
    """A unit of a quantity: `name` as written in scene files, `factor` to SI units.

    For a level in decibels, `decibels` is true and `factor` is that of the reference.
    """

    name: str
    factor: float
    quantity: str
    decibels: bool = False

    def to_si(self, values: ArrayLike) -> NDArray[np.float64]:
        """Values in this unit as values in SI units.

        >>> float(unit("dB re 1 g2/Hz").to_si(-20.0)) == 0.01 * STANDARD_GRAVITY**2
        True
        """
        found = np.asarray(values, dtype=float)
        with np.errstate(over="ignore"):
            return np.asarray((10.0 ** (found / 10.0) if self.decibels else found) * self.factor)

    def same(self, other: Unit) -> bool:
        """Whether both are the same unit, whatever their names."""
        alike = (self.quantity, self.decibels) == (other.quantity, other.decibels)
        return alike and math.isclose(self.factor, other.factor, rel_tol=1e-9)


@cache
def unit(spelling: str) -> Unit:
    """The unit that a spelling stands for: "g^2/Hz", "(m/s²)²/Hz", "dB re 1 g2/Hz", "mm/s^2".

    Spellings that are not in `UNITS` are parsed by pint with the units of `WORDS`. A unit that
    equals one in `UNITS` gets its name.

    Raises
    ------
    ValueError
        If the spelling is not known. The message lists the usual units.

    Examples
    --------
    >>> unit("(m/s^2)^2 / Hz").name, unit("G²/Hz").name, unit("m2/s4/Hz").name
    ('(m/s2)2/Hz', 'g2/Hz', '(m/s2)2/Hz')
    >>> unit("mm/s^2").factor, unit("rad/s").quantity, round(unit("rad/s").factor, 4)
    (0.001, 'frequency', 0.1592)
    """
    text = spelling.strip()
    if len(text) > LONGEST_SPELLING:
        raise _unknown(spelling)
    usual = re.sub(r"\s*/\s*", "/", re.sub(r"\^|\*\*", "", text.replace("²", "2")))
    usual = re.sub(r"\bhz\b", "Hz", usual, flags=re.I)
    for quantity, known in UNITS.items():
        if usual in known:
            return Unit(usual, known[usual], quantity)
    if level := re.fullmatch(r"dB\b\s*(?:re\b\.?|ref\b\.?|rel\b\.?|//)?\s*:?\s*(.*)", text, re.I):
        return _level(text, level[1])
    factor, quantity = _parsed(text)
    for name, size in UNITS.get(quantity, {}).items():
        if math.isclose(size, factor, rel_tol=1e-12):
            return Unit(name, size, quantity)
    return Unit(text, factor, quantity)


def listed_units(*quantities: str) -> str:
    """The usual spellings of the units of some quantities, of all by default."""
    return ", ".join(name for each in quantities or tuple(UNITS) for name in UNITS[each])


def _unknown(spelling: str) -> ValueError:
    return ValueError(
        f"{shown(spelling)} is not a known unit; expected one of {listed_units()}, "
        "dB re 1 g2/Hz, or products and powers of these"
    )


def _level(text: str, reference: str) -> Unit:
    """The unit of a level in decibels relative to a reference density."""
    if reference.startswith("(") and reference.endswith(")") and "(" not in reference[1:-1]:
        reference = reference[1:-1]
    found = re.fullmatch(r"(\d[\d.]*(?:[eE][-+]?\d+)?)?\s*\*?\s*(.*)", reference)
    try:
        if not found or not found[2]:
            raise ValueError
        of = unit(found[2])
        factor = float(found[1] or 1.0) * of.factor
        if of.quantity not in DENSITIES or of.decibels or not 0.0 < factor < math.inf:
            raise ValueError
    except ValueError:
        raise ValueError(
            f"{text!r} needs the density that 0 dB stands for, as in 'dB re 1 g2/Hz'"
        ) from None
    return Unit(f"dB re {found[1] or 1} {of.name}", factor, of.quantity, decibels=True)


def _parsed(text: str) -> tuple[float, str]:
    """Factor to SI units and quantity of a spelling, by pint."""
    given, text = text, re.sub(r"(?<=[A-Za-z0-9²)])[ _]rms(?![A-Za-z])", "", text, flags=re.I)
    text = text.translate(PLAIN_SIGNS).replace("^", "**")
    if not SPELLINGS.issuperset(re.findall(r"[A-Za-zµμ_]+", text)):
        raise _unknown(given)
    text = re.sub(r"\bper\b", "/", text)
    text = re.sub(r"√\s*\(?(\w+)\)?|sqrt\((\w+)\)", r"(\1\2)**0.5", text)
    # "m2s-3" and "ms-2" are written without a sign between their factors
    text = re.sub(r"\bms(?=(?:\*\*)?-[12]\b)", "m s", text.replace("g0", "g"))
    text = re.sub(r"(?<=[A-Za-z)])(?:\*\*)?(-?\d)(?=[A-Za-z(])", r"**\1 ", text)
    text = re.sub(r"(?<=[A-Za-z)])(-?\d)(?!\d)", r"**\1", text)
    if not re.fullmatch(r"(?:[A-Za-zµμ_]+|\*\*-?\d(?:\.5)?|[\s()/*]|\b1\b)+", text):
        raise _unknown(given)
    # m**9**9**9 and its like in brackets would never end
    if re.search(r"\*\*-?\d(?:\.5)?\s*\*\*", text) or len(re.findall(r"\)\s*\*\*", text)) > 2:
        raise _unknown(given)
    try:
        registry = _registry()
        factor, base = registry.get_base_units(registry.parse_units(text))
        size = float(str(factor))
    except Exception:  # pint raises errors of many kinds when it parses
        raise _unknown(given) from None
    return size, DIMENSIONS.get(str(base), str(base))


@cache
def _registry() -> pint.UnitRegistry[float]:
    """The registry of pint, made at its first use because the import of pint takes 0.4 s."""
    import pint

    registry: pint.UnitRegistry[float] = pint.UnitRegistry(None)
    for word in (*PREFIXES, *WORDS):
        registry.define(word)
    return registry


MEASURED = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(\S.*)?")
"""Pattern of a number and the text that follows it."""


def measured_in(text: str, name: str) -> float:
    """A number in the unit `name`, from a text that states a unit of its own or none.

    `name` is the name of a unit, "dB" for a level, or empty for a number without a unit.

    Raises
    ------
    ValueError
        If the text is not a number, or states a unit of another quantity.

    Examples
    --------
    >>> measured_in("4mm", "m"), measured_in("10 m/s", "km/h"), measured_in("3 dB", "dB")
    (0.004, 36.0, 3.0)
    >>> measured_in("4", "km/h"), measured_in("0.5", "")
    (4.0, 0.5)
    """
    try:
        return float(text)
    except ValueError:
        pass
    found = MEASURED.fullmatch(text)
    try:
        if not found or not found[2] or not name:
            raise ValueError
        number, spelling = float(found[1]), found[2].strip()
        if spelling == name:
            return number
        of, wanted = unit(spelling), unit(name)
        if (of.quantity, of.decibels) != (wanted.quantity, False) or wanted.decibels:
            raise ValueError
    except ValueError:
        with_unit = f", plain or with a unit such as {name}" if name else " without a unit"
        raise ValueError(f"must be a number{with_unit}, got {text!r}") from None
    # rounded to 15 digits, so that 36 km/h stays 36 after two conversions
    return float(f"{number * of.factor / wanted.factor:.15g}")


CLOCK = re.compile(r"\s*(\d+):([0-5]\d):([0-5]\d(?:\.\d*)?)\s*")
"""Pattern of a duration as hours, minutes and seconds: 1:30:00."""

PARTS = re.compile(r"(?:\s*(?:\d+\.?\d*|\.\d+)\s*(?![eE]\d)[A-Za-zµμ]+){2,}\s*")
"""Pattern of a duration of several parts, each with its unit: 1h 5min, but not the number 1e9 s."""


def _seconds(text: str) -> float | None:
    """Seconds of a duration of several parts with decreasing units; None for any other text."""
    if clock := CLOCK.fullmatch(text):
        hours, minutes, seconds = map(float, clock.groups())
        return 3600.0 * hours + 60.0 * minutes + seconds
    if not PARTS.fullmatch(text):
        return None
    parts = [(float(number), unit(word)) for number, word in re.findall(r"([\d.]+)\s*(\D+)", text)]
    units = [of for _, of in parts]
    falling = all(one.factor > two.factor for one, two in itertools.pairwise(units))
    if any(of.quantity != "time" or of.decibels for of in units) or not falling:
        raise ValueError
    return sum(number * of.factor for number, of in parts)


def measured(text: str, quantity: str, plain: float = 1.0) -> float:
    """A number with its unit, converted to SI units; without a unit, the number times `plain`.

    A time may have several parts: "1h 5min", or "1:30:00" for hours, minutes and seconds.

    Raises
    ------
    ValueError
        If the text is not a finite number with a unit of that quantity.

    Examples
    --------
    >>> measured("30 min", "time"), measured("4mm", "length"), measured("2", "acceleration")
    (1800.0, 0.004, 2.0)
    >>> measured("1h 5min", "time"), measured("1:30:00", "time")
    (3900.0, 5400.0)
    """
    found = MEASURED.fullmatch(text)
    try:
        if quantity == "time" and (seconds := _seconds(text)) is not None:
            if not math.isfinite(seconds):
                raise ValueError
            return seconds
        if not found:
            raise ValueError
        of = unit(found[2]) if found[2] else Unit("", plain, quantity)
        value = float(found[1]) * of.factor
        if of.quantity != quantity or of.decibels or not math.isfinite(value):
            raise ValueError
    except ValueError:
        usual = listed_units(quantity)
        usual += "; 1h 5min; 1:30:00" if quantity == "time" else ""
        raise ValueError(
            f"must be a number with a unit of {quantity} ({usual}), got {text!r}"
        ) from None
    return value


def intensity_from_density(density: float) -> float:
    """Intensity S0 of white noise whose one-sided density per hertz is `density`.

    S0 = G / 2, because G(f) = 2 S(2 pi f).

    >>> intensity_from_density(0.4)
    0.2
    """
    return density / 2.0


def density_from_intensity(intensity: float) -> float:
    """One-sided density per hertz of white noise of intensity S0: G = 2 S0.

    >>> density_from_intensity(0.2)
    0.4
    """
    return 2.0 * intensity


def power_ratio(level_db: float) -> float:
    """Factor by which a change of level in decibels multiplies a density, 10^(dB/10).

    >>> round(power_ratio(3.0), 4)
    1.9953
    """
    return math.pow(10.0, level_db / 10.0)


def plain_number(value: Any) -> Any:
    """A number of NumPy as a number of Python, which JSON can hold; any other value unchanged.

    Examples
    --------
    >>> import numpy as np
    >>> plain_number(np.int64(64)), plain_number("a")
    (64, 'a')
    """
    return value.item() if isinstance(value, np.generic) else value
