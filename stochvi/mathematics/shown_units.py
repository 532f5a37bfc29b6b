"""The units in which quantities are shown: usual ones, or those that a reader has chosen.

All numbers inside the package are in SI units. A table, a sentence or a picture asks a quantity
for the number to show, and for the name of its unit:

>>> f"{LENGTH(0.0045):.4g} {LENGTH}", LENGTH.text(0.0045)
('4.5 mm', '4.5 mm')
>>> with shown_in(units_of("in")):
...     f"clearance ({LENGTH})", LENGTH.text(0.0045)
('clearance (in)', '0.1772 in')
"""

from __future__ import annotations

import contextlib
import math
import re
from collections.abc import Iterator, Mapping
from contextvars import ContextVar
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from stochvi.mathematics.rounding import ROUNDING
from stochvi.mathematics.units import STANDARD_GRAVITY, unit


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


@contextlib.contextmanager
def shown_in(units: Choice) -> Iterator[None]:
    """Within this context quantities are shown in these units; without any, in the usual ones."""
    before = _choice.set(units)
    try:
        yield
    finally:
        _choice.reset(before)


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
    "m": ("length", 1, ""), "m^2": ("length", 2, ""), "m^2/Hz": ("length", 2, "/Hz"),
    "m/s": ("speed", 1, ""), "m^2/s^2": ("speed", 2, ""), "(m/s)^2/Hz": ("speed", 2, "/Hz"),
    "m/s^2": ("acceleration", 1, ""), "m/s2": ("acceleration", 1, ""),
    "(m/s^2)^2/Hz": ("acceleration density", 1, ""), "N": ("force", 1, ""), "J": ("energy", 1, ""),
    "N/m": ("stiffness", 1, ""), "s": ("time", 1, ""), "1/s": ("rate", 1, ""),
}  # fmt: skip
"""Quantity and power by the SI unit of a table."""


def shown_as(si_unit: str) -> ShownQuantity:
    """The quantity of an SI unit, shown in that unit unless another one is chosen; what has no
    choice, such as rad, keeps its unit.

    >>> with shown_in(units_of("mm")):
    ...     [str(shown_as(each)) for each in ("m^2", "rad")], shown_as("m^2")(1.0)
    (['mm²', 'rad'], 1000000.0)
    """
    quantity, power, per = BY_SI_UNIT.get(si_unit, (si_unit, 1, ""))
    return ShownQuantity(quantity, Size(si_unit, 1.0), power, per)


def readable(si_unit: str) -> ShownQuantity:
    """The quantity of an SI unit, lengths in mm and accelerations in g unless others are chosen.

    >>> str(readable("m")), str(readable("1/s"))
    ('mm', '1/s')
    """
    return {"m": LENGTH, "m/s^2": ACCELERATION}.get(si_unit) or shown_as(si_unit)
