"""Units. Chapters: checks of plain arguments against their annotations; conversion factors, and the
conventions of spectral densities; units in which quantities are shown."""

from __future__ import annotations

import contextlib
import difflib
import functools
import inspect
import itertools
import math
import numbers
import os
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextvars import ContextVar
from dataclasses import dataclass
from functools import cache
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, ParamSpec, TypeVar, get_origin

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stochvi.mathematics.numerics import ROUNDING

if TYPE_CHECKING:
    import pint


# ------------------------------------------------------------------------------
# Checks of plain arguments against their annotations: what is wrong is said in a sentence.
# ------------------------------------------------------------------------------


P = ParamSpec("P")
T = TypeVar("T")

MOST_SHOWN = 60
"""Largest number of characters of a wrong value that a message repeats."""

LARGEST_WHOLE = 2**63
"""Whole numbers below this one fit into the numbers of compiled code."""

LARGEST_NUMBER = 10**300
"""Whole numbers below this one can be converted to numbers of double precision."""


def shown(value: object) -> str:
    """A wrong value as a message repeats it: its beginning, whatever it is.

    >>> shown("x" * 100)[-8:], shown(10**5000)
    ('xxxxx...', 'something of type int')
    """
    try:
        text = "an array" if isinstance(value, np.ndarray) else " ".join(repr(value).split())
    except Exception:  # what cannot be shown is named
        text = f"something of type {type(value).__name__}"
    return text if len(text) <= MOST_SHOWN else text[: MOST_SHOWN - 3] + "..."


def _wrong(name: str, wanted: str, value: object) -> ValueError:
    return ValueError(f"{name} must be {wanted}, got {shown(value)}")


def number_to_write(value: object) -> str:
    """The remedy for a text such as "6mm" or "1 %" in the place of a number: which one to write.

    >>> number_to_write("6,5 mm"), number_to_write("1%")
    ('; write 0.0065 (m), without quotes', '; write 0.01, without quotes')
    """
    if not isinstance(value, str):
        return ""
    found = re.fullmatch(r"\s*([-+]?\d[\d.,]*)\s*(\D.*?)?\s*", value)
    if found is None:
        return ""
    try:
        plain = {None: Unit("", 1.0, ""), "%": Unit("", 0.01, "")}
        known = plain.get(found[2]) or unit(found[2])
        size = float(found[1].replace(",", ".")) * known.factor
    except ValueError:
        return "; write a plain number, without quotes and unit"
    if known.quantity not in OF_SI:
        return "; write a plain number in the unit of the key, without quotes"
    return f"; write {size:.12g}{OF_SI[known.quantity]}, without quotes"


OF_SI = {"": "", "length": " (m)", "time": " (s)"}
"""Quantities that arguments and keys have in SI units, with the unit."""


def outside_of_share(name: str, span: str, value: float) -> ValueError:
    """The error for a probability or another share out of its range; one in per cent is told as the
    number to write.

    >>> outside_of_share("confidence", "in (0, 1)", 95.0)
    ValueError('confidence must be in (0, 1), got 95; 95 % is 0.95')
    """
    percent = f"; {value:.12g} % is {value / 100.0:.12g}" if 1.0 <= value < 100.0 else ""
    return ValueError(f"{name} must be {span}, got {value:g}{percent}")


def _check_number(name: str, value: object) -> None:
    known = isinstance(value, numbers.Real) and not isinstance(value, bool)
    if not known or (isinstance(value, int) and abs(value) >= LARGEST_NUMBER):
        raise ValueError(f"{_wrong(name, 'a number', value)}{number_to_write(value)}")


def _check_whole(name: str, value: object) -> None:
    if not isinstance(value, numbers.Integral) or isinstance(value, bool):
        raise _wrong(name, "a whole number", value)
    if not -LARGEST_WHOLE <= int(value) < LARGEST_WHOLE:
        raise _wrong(name, "a whole number below 2^63", value)


def _check_numbers(name: str, value: object) -> None:
    try:
        array = np.asarray(value)
        known = array.dtype.kind in "biuf" or (array.dtype.kind == "O" and _all_real(array))
        if known:
            array.astype(float)
    except (TypeError, ValueError, OverflowError):  # ragged, or too large
        known = False
    if not known:
        raise _wrong(name, "numbers", value)


def _all_real(array: np.ndarray[Any, Any]) -> bool:
    return all(isinstance(each, numbers.Real) for each in array.ravel())


def _check_row(name: str, value: object) -> None:
    _check_numbers(name, value)
    if np.ndim(value) != 1:  # type: ignore[arg-type]
        raise _wrong(name, "a list of numbers", value)


def _check_rows(name: str, value: object) -> None:
    _check_numbers(name, value)
    if np.ndim(value) == 0:  # type: ignore[arg-type]
        raise _wrong(name, "a list of numbers", value)


def _check_texts(name: str, value: object) -> None:
    several = isinstance(value, Sequence) and not isinstance(value, str)
    if not several or not all(isinstance(each, str) for each in value):  # type: ignore[attr-defined]
        raise _wrong(name, "a list of texts", value)


def _is_a(kind: type | tuple[type, ...], wanted: str) -> Callable[[str, object], None]:
    def check(name: str, value: object) -> None:
        if not isinstance(value, kind):
            raise _wrong(name, wanted, value)

    return check


def _check_table(name: str, value: object) -> None:
    if not isinstance(value, Mapping):
        raise _wrong(name, "a table of names and values", value)
    for key, each in value.items():
        _check_row(f"{name} of {shown(key)}", each)


def _named(kind: str, said: str = "") -> Callable[[str, object], None]:
    """A check for a class that this room does not know, which messages may call otherwise."""
    said = said or kind
    wanted = f"an {said}" if said[0] in "AEIOU" else f"a {said}"

    def check(name: str, value: object) -> None:
        if kind not in [each.__name__ for each in type(value).__mro__]:
            raise _wrong(name, wanted, value)

    return check


def _check_callable(name: str, value: object) -> None:
    if not callable(value):
        raise _wrong(name, "a function", value)


CHECKS: dict[str, Callable[[str, Any], None]] = {
    "float": _check_number,
    "int": _check_whole,
    "str": _is_a(str, "a text"),
    "int | str": _is_a((int, str), "a name or a whole number"),
    "ArrayLike": _check_numbers,
    "Sequence[float]": _check_row,
    "Sequence[float] | Vector": _check_row,
    "Sequence[float] | Matrix": _check_rows,
    "Sequence[int]": _check_row,
    "bool": _is_a((bool, np.bool_), "True or False"),
    "Sequence[str]": _check_texts,
    "str | Path": _is_a((str, os.PathLike), "the name of a file"),
    "Progress": _check_callable,
    "Mapping[str, Sequence[float]]": _check_table,
    "Mapping[str, float]": _is_a(Mapping, "a table of names and numbers"),
    **{
        f"Mapping[str, {kind}]": _is_a(Mapping, f"a table of names and values of {kind}")
        for kind in ("Scene", "Spread", "Statistic")
    },
    **{kind: _named(kind) for kind in ("Sizing", "Problem", "Estimate", "Axes")},
    "Tolerances": _named(
        "Tolerances", "Tolerances, as stochvi.isolators.tolerances.Tolerances(frequency=0.1)"
    ),
    "Excitation": _named("BaseExcitation", "Excitation"),
}
"""Checks of arguments by their annotation, which may also allow None."""

TEXTS_OF_CHOICE = re.compile(r"""Literal\[(?:(?:"[^"]*"|'[^']*')(?:, )?)+\]""")
"""Annotation of an argument that is one of several texts."""

LEFT_OUT = " | None"
"""End of the annotation of an argument that may be left out."""


def _checks_of(function: Callable[..., Any]) -> dict[str, tuple[Callable[[str, Any], None], bool]]:
    """The check of each plain argument, and whether it may be None."""
    checks = {}
    for name, each in inspect.signature(function).parameters.items():
        kind = each.annotation
        kind = kind if isinstance(kind, str) else inspect.formatannotation(kind)
        plain = kind.removesuffix(LEFT_OUT)
        # an option of a decorated function is an alias where the function is written
        alias = get_origin(getattr(inspect.unwrap(function), "__globals__", {}).get(plain))
        if plain.startswith("Callable[") or alias is Callable:
            plain = "Progress"
        if TEXTS_OF_CHOICE.fullmatch(plain) or alias is Literal:
            plain = "str"
        if plain in CHECKS:
            checks[name] = CHECKS[plain], kind.endswith(LEFT_OUT)
    return checks


def argument_checker(function: Callable[..., Any]) -> Callable[..., inspect.BoundArguments]:
    """A function that checks the arguments of a call of `function`, and returns them.

    It raises ValueError, or TypeError where arguments are missing or unknown. Whole numbers too
    large for numpy are returned in double precision where any number is allowed.
    """
    signature, checks = inspect.signature(function), _checks_of(function)

    def check(*args: Any, **kwargs: Any) -> inspect.BoundArguments:
        bound = bound_to(signature, function.__name__, *args, **kwargs)
        given = bound.arguments
        for name, (raise_if_wrong, optional) in checks.items():
            if name in given and not (optional and given[name] is None):
                several = signature.parameters[name].kind is inspect.Parameter.VAR_POSITIONAL
                for each in given[name] if several else (given[name],):
                    raise_if_wrong(name, each)
                if isinstance(given[name], int) and abs(given[name]) >= LARGEST_WHOLE:
                    _check_number(name, given[name])
                    given[name] = float(given[name])
        return bound

    return check


def bound_to(
    signature: inspect.Signature, function: str, /, *args: Any, **kwargs: Any
) -> inspect.BoundArguments:
    """The arguments of a call, as `Signature.bind` finds them; its TypeError names the function."""
    try:
        return signature.bind(*args, **kwargs)
    except TypeError as reason:
        got = str(reason).replace("too many", "got too many")
        wrong = next((name for name in kwargs if repr(name) in got), "")
        near = difflib.get_close_matches(wrong, signature.parameters, 1)
        meant = f"; did you mean {near[0]}?" if near else ""
        raise TypeError(f"{function}() {got}{meant}") from None


def checked(function: Callable[P, T]) -> Callable[P, T]:
    """A function whose plain arguments are checked.

    >>> @checked
    ... def twice(number: float) -> float:
    ...     return 2.0 * number
    >>> twice("a")
    Traceback (most recent call last):
    ValueError: number must be a number, got 'a'
    """
    check = argument_checker(function)

    @functools.wraps(function)
    def run(*args: P.args, **kwargs: P.kwargs) -> T:
        bound = check(*args, **kwargs)
        return function(*bound.args, **bound.kwargs)

    return run


def check_methods(kind: type) -> None:
    """Let the public methods of a class check their plain arguments, as `checked` does.

    >>> class Scale:
    ...     def twice(self, number: float) -> float:
    ...         return 2.0 * number
    >>> check_methods(Scale)
    >>> Scale().twice([1.0])
    Traceback (most recent call last):
    ValueError: number must be a number, got [1.0]
    """
    for name, each in list(vars(kind).items()):
        if not name.startswith("_") and inspect.isfunction(each) and _checks_of(each):
            setattr(kind, name, checked(each))


def explain_methods(kind: type[T]) -> type[T]:
    """Let the public methods of a class name the wrong one of their plain arguments where Python
    fails in its own words.

    Arguments that a method can take are taken, whatever their annotation, and cost nothing.

    >>> @explain_methods
    ... class Scale:
    ...     def twice(self, number: float) -> float:
    ...         return 2.0 * number
    >>> Scale().twice("1")
    Traceback (most recent call last):
    ValueError: number must be a number, got '1'; write 1, without quotes
    """
    for name, each in list(vars(kind).items()):
        if not name.startswith(("_", "model_")) and inspect.isfunction(each):
            setattr(kind, name, _explained(each))
    return kind


def _explained(function: Callable[P, T]) -> Callable[P, T]:
    @functools.wraps(function)
    def run(*args: P.args, **kwargs: P.kwargs) -> T:
        try:
            return function(*args, **kwargs)
        except (AttributeError, TypeError, ValueError):
            check = argument_checker(function)
            try:
                check(*args, **kwargs)
            except ValueError as wrong:
                raise wrong from None
            raise

    return run


def with_checks(kind: type[T]) -> type[T]:
    """A class that users make objects of: its constructor and its methods check plain arguments.

    >>> @with_checks
    ... @dataclass(frozen=True)
    ... class Spring:
    ...     stiffness: float
    >>> Spring("a")
    Traceback (most recent call last):
    ValueError: stiffness must be a number, got 'a'
    """
    check_methods(kind)
    kind.__init__ = checked(kind.__init__)  # type: ignore[method-assign]
    return kind


# ------------------------------------------------------------------------------
# Conversion factors of units, and the conventions of spectral densities.
#
# Inside the package white noise is described by its intensity S0,
#
#     E f(t) f(t + tau) = S0 delta(tau),
#
# a two-sided density over angular frequency whose integral over omega / (2 pi) is the mean square.
# Engineers' tables, and everything that enters or leaves through a scene file, are one-sided
# densities per hertz, G(f) = 2 S(2 pi f).
#
# Displacements are relative displacements in the impact pair, in metres from the position of the
# unloaded spring; a clearance is per side. A base acceleration a acts on the relative motion as the
# acceleration -a.
# ------------------------------------------------------------------------------


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
    "energy": {"J": 1.0, "mJ": 1e-3},
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
) | {"per", "rms", "RMS"}
"""All words that the spelling of a unit may contain."""

DIMENSIONS = {
    "meter ** 2 / second ** 3": "acceleration density",
    "kilogram ** 2 * meter ** 2 / second ** 3": "force density",
    "meter / second ** 1.5": "root of an acceleration density",
    "kilogram * meter / second ** 1.5": "root of a force density",
    "meter / second ** 2": "acceleration",
    "kilogram * meter / second ** 2": "force",
    "meter": "length",
    "second": "time",
    "1 / second": "frequency",
    "meter / second": "speed",
    "kilogram * meter ** 2 / second ** 2": "energy",
}
"""Product of base units, as pint writes it -> quantity."""

PLAIN_SIGNS = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹\u2212·⋅\u00d7\u2044\u2215", "-0123456789-***//")
"""Superscripts and signs of typeset units -> the same in plain text."""

PREFIX_APART = re.compile(r"(?<![A-Za-z])(nano|micro|milli|centi|kilo|mega)[-_ ](?=[A-Za-z])", re.I)
"""A prefix that is written apart from its unit, as in "milli-g"."""

ROOT = re.compile(
    r"(?:√|(?<![A-Za-z])(?:sqrt|root|rt))[ _-]*(?:\(\s*([A-Za-z]+)\s*\)|([A-Za-z]+))", re.I
)
"""The square root of a unit: "√Hz", "sqrt(Hz)", "rtHz"."""

HALF = re.compile(r"\*\*(?:(-?)(?:1/2|0?\.5)(?!\d)|\(\s*(-?)\s*(?:1\s*/\s*2|0?\.5)\s*\))")
"""The power of a root: "Hz^(1/2)", "Hz^-.5"."""

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
    text = re.sub(r"\s*(?:\^|\*\*)\s*", "**", text.translate(PLAIN_SIGNS))
    text = HALF.sub(r"**\1\g<2>0.5", ROOT.sub(r"(\1\2)**0.5", text))
    text = PREFIX_APART.sub(lambda found: found[1].lower(), text)
    text = re.sub(r"g_?0(?!\d)", "g", text)
    text = re.sub(r"(?<![A-Za-zµμ])((?:m|u|µ|μ|milli|micro)?[gG])'?s(?![A-Za-z])", r"\1", text)
    if not SPELLINGS.issuperset(re.findall(r"[A-Za-zµμ_]+", text)):
        raise _unknown(given)
    text = re.sub(r"\bper\b", "/", text)
    # "m2s-3" and "ms-2" are written without a sign between their factors
    text = re.sub(r"\bms(?=(?:\*\*)?-[12]\b)", "m s", text)
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
    >>> measured_in("4", "km/h"), measured_in("0.5", ""), measured_in("12 %", "")
    (4.0, 0.5, 0.12)
    """
    try:
        return float(text)
    except ValueError:
        pass
    found = MEASURED.fullmatch(text)
    try:
        if found and not name and found[2] == "%":
            return float(found[1]) / 100.0
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
                raise OverflowError
            return seconds
        if not found:
            raise ValueError
        of = unit(found[2]) if found[2] else Unit("", plain, quantity)
        value = float(found[1]) * of.factor
        if math.isinf(value):
            raise OverflowError
        if of.quantity != quantity or of.decibels or not math.isfinite(value):
            raise ValueError
    except (ValueError, OverflowError) as reason:
        large = "; it is too large, write a finite one" * isinstance(reason, OverflowError)
        usual = listed_units(quantity)
        usual += "; 1h 5min; 1:30:00" if quantity == "time" else ""
        raise ValueError(
            f"must be a number with a unit of {quantity} ({usual}), got {text!r}{large}"
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


# ------------------------------------------------------------------------------
# The units in which quantities are shown: usual ones, or those that a reader has chosen.
#
# All numbers inside the package are in SI units. A table, a sentence or a picture asks a quantity
# for the number to show, and for the name of its unit:
#
# >>> f"{LENGTH(0.0045):.4g} {LENGTH}", LENGTH.text(0.0045)
# ('4.5 mm', '4.5 mm')
# >>> with shown_in(units_of("in")):
# ...     f"clearance ({LENGTH})", LENGTH.text(0.0045)
# ('clearance (in)', '0.1772 in')
# ------------------------------------------------------------------------------


class Size(NamedTuple):
    """The name of a unit, and its size in SI units."""

    name: str
    si: float


Choice = Mapping[str, Size]
"""Chosen units by quantity."""

CHOICES = {
    "length": ("mm", "µm", "cm", "m", "in", "mil", "ft"),
    "acceleration": ("g", "m/s²", "in/s²", "ft/s²"),
    "speed": ("m/s", "cm/s", "mm/s", "in/s", "ft/s"),
    "force": ("N", "kN", "lbf"),
    "stiffness": ("N/m", "N/mm", "lbf/in"),
    "energy": ("J", "mJ", "in lbf"),
    "time": ("s", "ms", "min", "h"),
    "rate": ("1/s", "1/min", "1/h"),
    "frequency": ("Hz",),
    "acceleration density": ("g²/Hz", "(m/s²)²/Hz"),
}
"""Units in which each quantity can be shown."""

SECONDS = {"1/s": "second", "1/min": "minute", "1/h": "hour"}
"""Times in words by the unit of a rate."""


def units_of(text: str) -> Choice:
    """The units of a list with commas, such as "mm, g".

    An acceleration brings its density: with m/s², densities are in (m/s²)²/Hz.

    Raises
    ------
    ValueError
        If a unit is not among `CHOICES`, or two are of the same quantity.

    Examples
    --------
    >>> units_of("in, per hour")["rate"].name, units_of("in/s^2")["acceleration density"].name
    ('1/h', '(in/s²)²/Hz')
    """
    found: dict[str, Size] = {}
    for word in filter(None, map(str.strip, text.split(","))):
        quantity, size = _chosen_by(word)
        if found.setdefault(quantity, size) != size:
            raise ValueError(
                f"must name one unit of {quantity}, got {found[quantity].name} and {size.name}"
            )
    if "acceleration" in found:
        found.setdefault("acceleration density", _power(found["acceleration"], 2, "/Hz"))
    return found


def _chosen_by(word: str) -> tuple[str, Size]:
    """The quantity and the unit of `CHOICES` that a word stands for."""
    with contextlib.suppress(ValueError):
        wanted = unit(re.sub(r"^(?:per |/)\s*", "1/", word))
        for quantity, names in CHOICES.items():
            for name in names:
                # 1/s and Hz are of one dimension: a rate of impacts is not a frequency
                if unit(name).same(wanted) and ("Hz" in name) == ("hz" in word.lower()):
                    return quantity, Size(name, unit(name).factor)
    known = ", ".join(name for names in CHOICES.values() for name in names)
    raise ValueError(f"must be of {known}, got {word!r}")


def _power(size: Size, power: int, per: str = "") -> Size:
    """A power of a unit, per hertz if `per` says so."""
    if power == 1:
        return Size(size.name + per, size.si)
    name = f"({size.name})" if "/" in size.name else size.name
    return Size(f"{name}²{per}", size.si**power)


USUAL: Choice = MappingProxyType({})
"""No choice: every quantity is shown in its usual unit."""

_choice: ContextVar[Choice] = ContextVar("shown_units", default=USUAL)

_passed_over: ContextVar[dict[str, None]] = ContextVar("units_passed_over", default={})  # noqa: B039
"""Units that were shown within `shown_in` as they are, as no quantity is known for them."""


@contextlib.contextmanager
def shown_in(units: Choice) -> Iterator[None]:
    """Within this context quantities are shown in these units; without any, in the usual ones."""
    before, passed = _choice.set(units), _passed_over.set({})
    try:
        yield
    finally:
        _choice.reset(before)
        _passed_over.reset(passed)


def units_passed_over() -> list[str]:
    """Units that kept their numbers since a reader chose others: no quantity is known for them.

    >>> with shown_in(units_of("in")):
    ...     str(shown_as("Pa")), str(shown_as("m")), units_passed_over()
    ('Pa', 'in', ['Pa'])
    """
    return list(_passed_over.get())


def units_are_chosen() -> bool:
    """Whether a reader has chosen units."""
    return bool(_choice.get())


@dataclass(frozen=True)
class ShownQuantity:
    """A quantity as it is shown: called with an SI number, it gives the number to show.

    Parameters
    ----------
    quantity
        Its name in `CHOICES`; a name that is not there keeps its unit.
    usual
        The unit in which it is shown unless another one is chosen.
    power, per
        The power of the quantity, and "/Hz" of a density over frequency.
    """

    quantity: str
    usual: Size
    power: int = 1
    per: str = ""

    @property
    def chosen(self) -> Size | None:
        """The chosen unit; None without a choice."""
        found = _choice.get().get(self.quantity)
        return None if found is None else _power(found, self.power, self.per)

    @property
    def shown(self) -> Size:
        """The unit that is shown."""
        return self.chosen or self.usual

    def __call__(self, value: Any) -> Any:
        """A number, an array, a column or an estimate in SI units in the unit that is shown; what
        is not known (None) stays so."""
        if isinstance(value, list | tuple):
            value = np.asarray(value)
        return None if value is None else value * (1.0 / self.shown.si)

    def __str__(self) -> str:
        return self.shown.name

    def text(self, value: float, form: str = ".4g") -> str:
        """A number with its unit."""
        return f"{self(value):{form}} {self}"

    def span(self, low: float, high: float, form: str = ".4g") -> str:
        """Two numbers with their unit: "4.8 to 5 mm"."""
        return f"{self(low):{form}} to {self.text(high, form)}"

    def rounded_up(self, value: float, step: float) -> str:
        """A number, rounded up to the power of ten of the unit that is at most `step` (SI).

        >>> LENGTH.rounded_up(0.0044999, 1e-4)
        '4.5 mm'
        """
        places = self._places(step)
        number = math.ceil(self(value) * 10.0**places * (1.0 - ROUNDING)) / 10.0**places
        return f"{number:.{places}f} {self}"

    def step_of(self, step: float) -> str:
        """The power of ten of the unit to which `rounded_up` rounds."""
        places = self._places(step)
        return f"{10.0**-places:.{places}f} {self}"

    def _places(self, step: float) -> int:
        return max(math.ceil(math.log10(self.shown.si / step) - ROUNDING), 0)

    def heading(self, words: str, more: str = "") -> str:
        """Words with the unit in brackets, and `more` behind it; a mere number has no unit."""
        return f"{words} ({self}{more})" if str(self) else words

    @property
    def inverse(self) -> str:
        """The unit of a density of its probability: s/m of a speed."""
        above, _, below = str(self).partition("/")
        return f"{below or 1}/{above}"

    @property
    def time(self) -> str:
        """The time of a rate in words: "impacts per hour"."""
        return SECONDS[str(self)]


LENGTH = ShownQuantity("length", Size("mm", 1e-3))
METRES = ShownQuantity("length", Size("m", 1.0))
"""A length where a table is in SI units."""

ACCELERATION = ShownQuantity("acceleration", Size("g", STANDARD_GRAVITY))
SI_ACCELERATION = ShownQuantity("acceleration", Size("m/s²", 1.0))
"""An acceleration where a table is in SI units."""

SPEED = ShownQuantity("speed", Size("m/s", 1.0))
FORCE = ShownQuantity("force", Size("N", 1.0))
STIFFNESS = ShownQuantity("stiffness", Size("N/m", 1.0))
ENERGY = ShownQuantity("energy", Size("J", 1.0))
TIME = ShownQuantity("time", Size("s", 1.0))
MILLISECONDS = ShownQuantity("time", Size("ms", 1e-3))
"""A time of contact."""

RATE = ShownQuantity("rate", Size("1/s", 1.0))
HOURLY = ShownQuantity("rate", Size("1/h", 1.0 / 3600.0))
"""A rate where impacts are rare."""

DENSITY = ShownQuantity("acceleration density", Size("g²/Hz", STANDARD_GRAVITY**2))
"""A density of acceleration over frequency."""

MILLIRADIANS = ShownQuantity("angle", Size("mrad", 1e-3))
NUMBER = ShownQuantity("number", Size("", 1.0))
PERCENT = ShownQuantity("share", Size("%", 0.01))

BY_SI_UNIT = {
    "m": ("length", 1, ""), "m^2": ("length", 2, ""),
    "m/s": ("speed", 1, ""), "m^2/s^2": ("speed", 2, ""), "(m/s)^2/Hz": ("speed", 2, "/Hz"),
    "m/s^2": ("acceleration", 1, ""), "m/s2": ("acceleration", 1, ""),
    "(m/s^2)^2/Hz": ("acceleration density", 1, ""), "N": ("force", 1, ""), "J": ("energy", 1, ""),
    "N/m": ("stiffness", 1, ""), "s": ("time", 1, ""), "1/s": ("rate", 1, ""),
}  # fmt: skip
"""Quantity and power by the SI unit of a table."""

PER = ("Hz", "h", "kg")
"""Units that stay below the bar whatever is chosen above it: J/h becomes mJ/h."""

WITHOUT_CHOICE = frozenset((
    "", "1", "%", "rad", "rad/s", "rad/s^2", "rad^2", "rad^2/s^2", "rad^2/Hz", "(rad/s)^2/Hz",
    "(rad/s^2)^2/Hz", "Hz", "kg", "dB", "km/h", "N s", "N s/m", "m^2/s^3", "rad^2/s^3", "(m/s)^b",
    "g", "mm",
))  # fmt: skip
"""Other units of answers, which `CHOICES` holds no others for."""


def shown_as(si_unit: str) -> ShownQuantity:
    """The quantity of an SI unit, shown in that unit unless another one is chosen; what has no
    choice, such as rad, keeps its unit.

    >>> with shown_in(units_of("mm, mJ")):
    ...     [str(shown_as(each)) for each in ("m^2", "rad", "J/h")], shown_as("m^2")(1.0)
    (['mm²', 'rad', 'mJ/h'], 1000000.0)
    """
    if units_are_chosen() and si_unit not in WITHOUT_CHOICE and _quantity_of(si_unit)[0] == si_unit:
        _passed_over.get()[si_unit] = None
    return ShownQuantity(*_quantity_of(si_unit))


def _quantity_of(si_unit: str) -> tuple[str, Size, int, str]:
    """The parts of a `ShownQuantity` by its SI unit; a quotient is read from its parts."""
    above, _, below = si_unit.rpartition("/")
    if si_unit not in BY_SI_UNIT and above and below in PER:
        quantity, _, power, per = _quantity_of(above)
        if quantity != above:
            return quantity, Size(si_unit, 1.0), power, f"{per}/{below}"
    quantity, power, per = BY_SI_UNIT.get(si_unit, (si_unit, 1, ""))
    return quantity, Size(si_unit, 1.0), power, per


def readable(si_unit: str) -> ShownQuantity:
    """The quantity of an SI unit, lengths in mm and accelerations in g unless others are chosen.

    >>> str(readable("m")), str(readable("1/s"))
    ('mm', '1/s')
    """
    return {"m": LENGTH, "m/s^2": ACCELERATION}.get(si_unit) or shown_as(si_unit)


def spoken_mission(seconds: float) -> str:
    """A mission in the unit that reads best.

    >>> spoken_mission(3600.0), spoken_mission(18.0), spoken_mission(5400.0), spoken_mission(7.2e5)
    ('1 h', '18 s', '1.5 h', '200 h')
    """
    for unit, name in ((3600.0, "h"), (60.0, "min")):
        if seconds >= unit:
            return f"{seconds / unit:.4g} {name}"
    return f"{seconds:.4g} s"
