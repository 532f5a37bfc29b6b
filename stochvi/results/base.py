"""The base of every answer, and the stationary response. Chapters: described fields; quantities
of the hardest impact; units in column names; the class `Result`, with JSON document, table and
notebook page; the class `Response`."""

from __future__ import annotations

import copy
import difflib
import html
import math
import re
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import MISSING, dataclass, field, fields, is_dataclass, replace
from functools import cache
from operator import attrgetter
from typing import TYPE_CHECKING, Any, ClassVar, Literal, NamedTuple, Self, TypeVar, cast

import numpy as np

from stochvi.mathematics.units import (
    ACCELERATION,
    LENGTH,
    MILLIRADIANS,
    SPEED,
    USUAL,
    ShownQuantity,
    check_methods,
    readable,
    shown_as,
    shown_in,
    units_are_chosen,
    units_of,
)
from stochvi.results.estimates import (
    BIAS,
    BIAS_ERROR,
    ERROR,
    LIMIT,
    NO_VALUE,
    Cost,
    Estimate,
    format_with_error,
    plus_minus,
)
from stochvi.results.plots import densities_of, drawn

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from pandas import DataFrame as DataFrame
else:

    class DataFrame:
        """`pandas.DataFrame`, in annotations: the first table that is made imports pandas."""


# ------------------------------------------------------------------------------
# Fields that carry their words and unit: the one description of a quantity of an answer.
# ------------------------------------------------------------------------------


class Stated(NamedTuple):
    """What a field of an answer holds: its words in tables, and its SI unit."""

    words: str
    unit: str


def stated(words: str, unit: str = "1", default: Any = None) -> Any:
    """A field for a number of an answer with its words and SI unit; by default None, where it is
    not known, and with `MISSING` always given.

    Tables, files and pages take both from here.
    """
    return field(default=default, metadata={"stated": Stated(words, unit)})


@cache
def quantities_of(kind: Any) -> Mapping[str, Stated]:
    """The stated fields of a class, by name.

    >>> quantities_of(CoordinateResponse)["displacement_std"]
    Stated(words='std. dev. of displ.', unit='m')
    """
    named = ((each.name, each.metadata.get("stated")) for each in fields(kind))
    return {name: known for name, known in named if known is not None}


def unit_of(owner: str, name: str) -> str:
    """The unit of a quantity of a response; none of a statistic, whose function has its own."""
    return in_angles(owner, RESPONSE_QUANTITIES[name].unit) if name in RESPONSE_QUANTITIES else ""


ROTATIONS = ("rx", "ry", "rz")
"""Coordinates of a rigid body that are angles, rad."""


def in_angles(owner: str, unit: str) -> str:
    """The unit of a quantity of a coordinate: radians stand for metres where it is an angle.

    >>> in_angles("z", "m/s"), in_angles("ry", "m^2/s^2")
    ('m/s', 'rad^2/s^2')
    """
    return unit.replace("m", "rad", 1) if owner in ROTATIONS else unit


ANGULAR = {
    LENGTH: MILLIRADIANS, SPEED: shown_as("rad/s"), ACCELERATION: shown_as("rad/s^2")
}  # fmt: skip
"""Quantities of an angle by those of a displacement."""


def of_angle(owner: str, quantity: ShownQuantity) -> ShownQuantity:
    """A quantity of a coordinate as it is shown: that of an angle where the coordinate is one.

    >>> of_angle("rx", LENGTH).text(0.0036), of_angle("x", LENGTH).text(0.0036)
    ('3.6 mrad', '3.6 mm')
    """
    return ANGULAR.get(quantity, quantity) if owner in ROTATIONS else quantity


# ------------------------------------------------------------------------------
# Units in the names of the columns of CSV files, `clearance_m` and `impact_speed_m_s`, and tables
# in the units that a reader has chosen.
# ------------------------------------------------------------------------------


SUFFIXES = {
    "m": "m", "m^2": "m2", "m/s": "m_s", "m/s^2": "m_s2", "m^2/s^2": "m2_s2", "m^2/s^3": "m2_s3",
    "1/s": "per_s", "s": "s", "N": "N", "Hz": "Hz", "kg": "kg", "dB": "dB", "km/h": "km_h",
    "N s/m": "N_s_m", "N/m": "N_m", "g": "g", "mm": "mm",
}  # fmt: skip
"""Spelling of units in the names of columns; a unit that is not listed, such as 1, is left out of
the name."""

COLUMN_UNITS = {
    "clearance": "m", "sigma": "m", "play": "m", "shift": "m", "rattle_space": "m",
    "displacement": "m", "displacement_min": "m", "displacement_max": "m",
    "velocity": "m/s", "speed": "m/s", "impact_speed": "m/s", "impact_speed_max": "m/s",
    "jolt": "m/s", "acceleration": "m/s^2", "base_acceleration": "m/s^2",
    "acceleration_rms": "m/s^2", "acceleration_max": "m/s^2", "largest_acceleration": "m/s^2",
    "wall_acceleration_largest": "m/s^2", "response_rms": "m/s^2", "extreme_response": "m/s^2",
    "cumulative_rms": "m/s^2", "extreme_lower": "m/s^2", "extreme_upper": "m/s^2",
    "shock_typical": "m/s^2", "shock_worst": "m/s^2",
    "wall_force": "N", "wall_force_peak": "N", "wall_force_largest": "N",
    "stiffness": "N/m", "time": "s", "duration": "s", "contact_time": "s", "life_time": "s",
    "rice": "1/s", "closure": "1/s", "simulated": "1/s", "rice_rate": "1/s",
    "first_hit_rate": "1/s", "hit_rate": "1/s", "exceedance_rate": "1/s", "lyapunov": "1/s",
    # no file states these in the names of its columns, as no answer has them in one
    "equivalent_density": "(m/s^2)^2/Hz", "fatigue_damage": "(m/s)^b",
    "clearance_cost": "m", "amplitude": "m", "without": "m", "mean": "m", "variance": "m^2",
    "velocity_mean": "m/s", "peak_acceleration": "m/s^2", "pad_force": "N", "impulse": "N s",
    "energy_per_hit": "J", "rate_lower": "1/s", "rate_upper": "1/s", "speed_rate_lower": "m/s^2",
    "speed_rate_upper": "m/s^2", "speed_square_rate_lower": "m^2/s^3",
    "speed_square_rate_upper": "m^2/s^3",
}  # fmt: skip
"""Units of the columns of tables by their names, beside those of `RESPONSE_QUANTITIES`."""

ENDING = re.compile(
    r"(?:_(?:low|high|error|standard_error|bias|without_stops|without))*"
    rf"(?:\.(?:{ERROR}|{BIAS}|{BIAS_ERROR}|{LIMIT}))?$"
)
"""Pattern of the end of a column that holds a bound or an error of another column; it stands behind
its name and unit."""


def in_three_columns(table: DataFrame) -> list[dict[str, str]]:
    """A row for each quantity of a tidy table: its name, the value with half of its 95 % interval
    and its unit, and a note.

    The note has limits, what is known of the bias, and how the number was found if that differs.

    >>> row = {"of": "x", "quantity": "rate", "value": 2.0, "standard_error": 0.1, "unit": "1/s"}
    >>> in_three_columns(frame_of([row]))
    [{'quantity': 'x.rate', 'value': '2.00 ± 0.20 1/s', 'note': ''}]
    """
    rows = rows_of(in_chosen_units(table))
    remarks = [name for name in ("by", "how") if len({row.get(name) for row in rows}) > 1]
    found = []
    for row in rows:
        known = {name: each for name, each in row.items() if each is not None and each == each}
        note = [f"{known['lower']:.4g} to {known['upper']:.4g}"] if "lower" in known else []
        note += [known[name] for name in remarks if name in known]
        value = NO_VALUE
        if estimate := estimate_of(row):
            note += filter(None, [estimate.bias_in_words.removeprefix(", ")])
            value = f"{plus_minus(estimate)} {row['unit'] if row['unit'] != '1' else ''}".strip()
        names = [row[name] for name in ("of", "law", "quantity", "number") if name in row]
        name = ("." if all(map(str.isidentifier, names)) else ": ").join(names)
        found.append({"quantity": name, "value": value, "note": "; ".join(note)})
    return found


def estimate_of(row: Mapping[str, Any], name: str = "", between: str = ".") -> Estimate | None:
    """The number of a row of a tidy table, or under a `name` in one of many numbers.

    Errors that are not there are 0, and a bias that is not known (NaN) is None. The answer is None
    where the number itself is not known.

    >>> estimate_of({"value": 2.0, "standard_error": 0.5, "bias": math.nan})
    2.00(50), bias not known []
    >>> estimate_of({"ratio": 0.5, "ratio_error": 0.01}, "ratio", "_")
    0.500(10) []
    """
    before = f"{name}{between}" if name else ""
    errors = {each: row.get(before + each) for each in (ERROR, BIAS, BIAS_ERROR, LIMIT)}
    errors[ERROR] = row.get(f"{before}error", errors[ERROR])
    known = {each: float(x) for each, x in errors.items() if x is not None and x == x}
    value = row[name or "value"]
    if not math.isfinite(value):
        return None
    unknown: dict[str, Any] = {BIAS: None} if before + BIAS in row else {}
    return Estimate(value=float(value), **unknown | known)


OF_A_VALUE = ("value", ERROR, BIAS, BIAS_ERROR, LIMIT, "lower", "upper", "95 % from", "to")
"""Columns of the unit that a row states."""


def with_unit(name: str, unit: str) -> str:
    """The name of a column with its unit.

    >>> with_unit("stops.impact_speed_mean", "m/s"), with_unit("hits", "1")
    ('stops.impact_speed_mean_m_s', 'hits')
    """
    suffix = SUFFIXES.get(unit)
    return f"{name}_{suffix}" if suffix else name


def named_with_units(table: DataFrame) -> DataFrame:
    """A table in SI units with the units of its columns in their names.

    >>> list(named_with_units(frame_of([], ["clearance", "hit_rate_low", "note"])))
    ['clearance_m', 'hit_rate_per_s_low', 'note']
    """
    return table.rename(columns={str(name): _named(str(name)) for name in table})


def unit_of_column(column: str) -> str | None:
    """The SI unit of a column whose name does not state it; None where it is not known.

    >>> unit_of_column("extreme_response_bias_without_stops"), unit_of_column("equivalent_density")
    ('m/s^2', '(m/s^2)^2/Hz')
    """
    name, _ = _parts(column)
    return _unit_of_name(name)


def stated_unit(column: str) -> tuple[str, str | None]:
    """The name of a column without its ending and without the unit that it states; and that unit,
    or None.

    >>> stated_unit("base_velocity_m_s"), stated_unit("clearance")
    (('base_velocity', 'm/s'), ('clearance', None))
    """
    name, _ = _parts(column)
    for unit, suffix in sorted(SUFFIXES.items(), key=lambda each: -len(each[1])):
        if name.endswith(f"_{suffix}"):
            return name.removesuffix(f"_{suffix}"), unit
    return name, None


def _unit_of_name(name: str) -> str | None:
    return RESPONSE_QUANTITIES[name].unit if name in RESPONSE_QUANTITIES else COLUMN_UNITS.get(name)


def _parts(column: str) -> tuple[str, str]:
    """The name of a column, and its ending."""
    ending = ENDING.search(column)
    assert ending is not None
    return column[: ending.start()], ending[0]


def _named(column: str) -> str:
    name, ending = _parts(column)
    unit = _unit_of_name(name)
    return column if unit is None else with_unit(name, unit) + ending


def in_chosen_units(table: DataFrame, units: Mapping[str, str] = {}) -> DataFrame:
    """A table of SI numbers in the units that a reader has chosen; without a choice, as it is.

    `units` are SI units of columns whose name does not tell.

    A column is converted if its unit is known, by its name or by its row, and a unit of its
    quantity is chosen. Its name, or the `unit` of the row, then states that unit. All others stay
    in SI units.

    >>> from stochvi.mathematics.units import shown_in, units_of
    >>> with shown_in(units_of("mm")):
    ...     in_chosen_units(frame_of({"clearance": [0.004], "time_s": [1.0]}))
       clearance_mm  time_s
    0           4.0     1.0
    """
    if not units_are_chosen():
        return table
    found = table.copy()
    if "unit" in found:
        for unit in set(found["unit"]):
            quantity = shown_as(str(unit))
            rows = found["unit"] == unit
            numbers = [name for name in OF_A_VALUE if name in found]
            found.loc[rows, numbers] = quantity(found.loc[rows, numbers].astype(float))
            found.loc[rows, "unit"] = str(quantity)
        return found
    names = {}
    for column in map(str, table):
        name, unit, ending = _quantity_of(column, units)
        known = None if unit is None else shown_as(unit)
        if known is not None and known.chosen is not None:
            found[column] = known(found[column])
            names[column] = f"{name}_{_suffix(str(known))}{ending}"
    return found.rename(columns=names)


def in_readable_units(table: DataFrame) -> DataFrame:
    """A table of SI numbers in the units of a console, which stand behind the names of its columns:
    lengths in mm and accelerations in g unless others are chosen.

    >>> in_readable_units(frame_of({"clearance": [0.004], "hit_rate_low": [2.0], "pair": ["lid"]}))
       clearance (mm)  hit_rate_low (1/s) pair
    0             4.0                 2.0  lid
    """
    found, names = table.copy(), {}
    for column in map(str, table):
        name, unit, ending = _quantity_of(column, {})
        if unit not in (None, "1"):
            known = readable(unit)
            found[column] = known(found[column].astype(float))
            names[column] = known.heading(f"{name}{ending}")
    return found.rename(columns=names)


def _quantity_of(column: str, units: Mapping[str, str]) -> tuple[str, str | None, str]:
    """The name of a column without its unit, its SI unit where that is known, and its ending."""
    name, ending = _parts(column)
    if any(part in ROTATIONS for part in name.split(".")[:-1]):
        return name, None, ending
    name, stated = stated_unit(column)
    return name, stated or units.get(name) or _unit_of_name(name), ending


def _suffix(unit: str) -> str:
    """A unit in the name of a column: "in_s2" of in/s², "per_h" of 1/h."""
    plain = unit.replace("²", "2").replace("µ", "u").replace("1/", "per_")
    return re.sub(r"\W+", "_", plain).strip("_")


# ------------------------------------------------------------------------------
# The base of every answer: its JSON document, its table and its page for notebooks.
# ------------------------------------------------------------------------------


ERRORS = ("error", "bias", "upper_95", "limit")
"""Ends of the names of columns that hold numbers even where none is known."""


def frame_of(table: Any = (), columns: list[str] | None = None) -> DataFrame:
    """The table of columns by name, or of rows: mappings, named tuples, or dataclasses whose fields
    are the columns. It alone, and `stacked`, make tables. Numbers that no row knows are NaN.

    >>> frame_of([{"clearance": 0.004, "hit_rate": 2.0}]).columns.tolist()
    ['clearance', 'hit_rate']
    """
    import pandas as pd

    if not isinstance(table, Mapping):
        table = [vars(row) if is_dataclass(row) else row for row in table]
    found = pd.DataFrame(table, columns=columns)
    empty = [
        str(name) for name in found if found[name].dtype == object and found[name].isna().all()
    ]
    numbers = [name for name in empty if name.endswith(ERRORS) or unit_of_column(name)]
    return found.astype(dict.fromkeys(numbers, float))


def stacked(tables: Iterable[Any], columns: list[str] | None = None) -> DataFrame:
    """Tables, or columns by name, below one another as one table; empty without any.

    >>> stacked([{"of": "x", "speed": [1.0, 2.0]}, {"of": "y", "speed": [3.0]}])["of"].tolist()
    ['x', 'x', 'y']
    """
    import pandas as pd

    found = [frame_of(each) if isinstance(each, Mapping) else each for each in tables]
    return pd.concat(found, ignore_index=True) if found else frame_of(columns=columns)


def frame_by(parts: Iterable[Any], names: str, **own: Callable[[Any], Any]) -> DataFrame:
    """The table of parts of an answer, by the names of fields that are its columns.

    Columns of one's own follow, each with what makes its cell. What is not known is NaN.

    >>> frame_by([Estimate(value=2.0)], "value bias", twice=lambda each: 2.0 * each.value)
       value  bias  twice
    0    2.0   0.0    4.0
    """
    read = {name: attrgetter(name) for name in names.split()} | own
    cells = [{name: cell(part) for name, cell in read.items()} for part in parts]
    return frame_of({n: math.nan if x is None else x for n, x in row.items()} for row in cells)


class KeptTable:
    """A field of an answer for a table that is made a frame when it is asked for: an answer in a
    sentence does without pandas, whose import takes longer than many calculations."""

    def __init__(self, default: Any = MISSING) -> None:
        self.default = default

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = name

    def __get__(self, found: Any, kind: Any = None) -> Any:
        if found is None:
            if self.default is MISSING:
                raise AttributeError(self.name)  # the field has no default
            return self.default
        kept = vars(found)[self.name]
        if not (kept is None or hasattr(kept, "iloc")):
            kept = vars(found)[self.name] = frame_of(kept)
        return kept

    def __set__(self, found: Any, table: Any) -> None:
        vars(found)[self.name] = table


def rows_of(found: Any, name: str = "") -> list[dict[str, Any]]:
    """The rows of a table, or of that in a field of an answer, by the names of its columns."""
    table = vars(found)[name] if name else found
    if hasattr(table, "iloc"):
        table = table.to_dict("records")
    if isinstance(table, Mapping):
        return [dict(zip(table, row, strict=True)) for row in zip(*table.values(), strict=True)]
    return [dict(row) for row in table]


def kept_table(default: Any = MISSING) -> Any:
    """A field for a `KeptTable`."""
    return KeptTable(default)


MOST_NAMES = 12
"""Largest number of known names that the message on a wrong one lists."""


def unknown_name(name: object, known: Iterable[str]) -> KeyError:
    """The error for a wrong name, with the known ones, the nearest first.

    >>> unknown_name("stop", ["x", "stops", "stops.collision_rate"])
    KeyError('stop; known: stops, stops.collision_rate, x')
    """
    match = difflib.SequenceMatcher(b=str(name))

    def likeness(other: str) -> float:
        match.set_seq1(other)
        return match.ratio()

    ordered = sorted(known, key=likeness, reverse=True)
    more = [f"and {left} more"] if (left := len(ordered) - MOST_NAMES) > 0 else []
    return KeyError(f"{name}; known: {', '.join([*ordered[:MOST_NAMES], *more]) or 'none'}")


class Named(dict[str, Any]):
    """Parts of an answer by name, as attributes too; a wrong name is told with the known ones.

    >>> Named(clearance=0.004).clearance
    0.004
    """

    def __missing__(self, name: str) -> Any:
        raise unknown_name(name, self)

    def __getattr__(self, name: str) -> Any:
        if name not in self:
            raise AttributeError(*unknown_name(name, self).args)
        return self[name]

    def __dir__(self) -> Iterable[str]:
        return [*super().__dir__(), *self]


COMMON = ("warnings", "cost", "provenance", "interrupted")
"""Fields that every answer has; they come last in documents."""

MOST_ROWS = 60
"""Largest number of rows of a table that a notebook shows; a longer table is cut in the middle."""


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Result:
    """The answer of a calculation.

    A kind of answer is a frozen dataclass derived from this class. It defines `to_frame` and
    `summary`, a sentence on what was found; the rest follows from its fields.

    Parameters
    ----------
    warnings
        Warnings to read before believing the numbers, a sentence each.
    cost
        Time and number of paths that the answer took.
    provenance
        Data to compute the answer again: versions, processor, seed, the scene, and in `call` the
        function with its arguments, the date and, of a checkout, the commit. `budget_decided` is
        there where the clock ended a part: another run may then have other last digits.
    interrupted
        Whether Ctrl-C ended the calculation: the answer then holds the results up to that moment.
    """

    warnings: Sequence[str] = ()
    cost: Cost = field(default_factory=Cost)
    provenance: Mapping[str, Any] = field(default_factory=dict)
    interrupted: bool = False

    kind: ClassVar[str] = ""
    """What the document of an answer without a field `method` says under "method"."""

    in_document: ClassVar[Mapping[str, str]] = {}
    """Keys that a document begins with, each with the field, property or method that it holds, or
    the way to one: "resonance.free_amplitude"."""

    not_in_document: ClassVar[tuple[str, ...]] = ()
    """Fields of a kind of answer that its JSON document leaves out."""

    as_columns: ClassVar[tuple[str, ...]] = ()
    """Fields whose tables are columns in a document, and not rows. Parts of an answer may state
    this, what is in a document and what is not, too."""

    sometimes: ClassVar[tuple[str, ...]] = ()
    """Fields that only some documents of a kind have: those in which they hold something."""

    @property
    def omitted(self) -> Sequence[str]:
        """Those of them that the document of this answer leaves out."""
        return [name for name in self.sometimes if not len(getattr(self, name))]

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        check_methods(cls)

    def __repr__(self) -> str:
        return f"{type(self).__name__}: {self.summary()}"

    @property
    def quantities(self) -> Mapping[str, Any]:
        """The numbers of each coordinate, impact pair or event by its name, as sweeps name them."""
        return {**getattr(self, "coordinates", {}), **getattr(self, "impact_pairs", {})}

    @property
    def _parts(self) -> Mapping[str, Any]:
        """What `answer[name]` finds."""
        return self.quantities

    def _by_name(self) -> Named:
        """The parts by name, and every number that is known by the dotted name that it has in
        sweeps."""
        dotted = {
            f"{owner}.{name}": each
            for owner, part in self._parts.items()
            for name, each in (part if isinstance(part, Mapping) else vars(part)).items()
            if isinstance(each, Estimate | float)
        }
        return Named({**self._parts, **dotted})

    def __getitem__(self, name: str) -> Any:
        """The numbers of a coordinate or pair, `answer["stops"].collision_rate`, or one of them,
        `answer["stops.collision_rate"]`."""
        return self._by_name()[name]

    def __contains__(self, name: object) -> bool:
        return name in self._by_name()

    __iter__ = None  # an answer is no sequence

    def _ipython_key_completions_(self) -> list[str]:
        return list(self._by_name())

    def __eq__(self, other: object) -> bool:
        """Whether the other answer is of the same kind, and has the same JSON document but for its
        cost and the record of its call: one seed gives equal answers."""
        if type(other) is not type(self):
            return NotImplemented
        return bool(_lasting(self.to_dict()) == _lasting(other.to_dict()))

    __hash__ = None  # type: ignore[assignment]

    def summary(self) -> str:
        """The answer in a sentence; by default the name of the method."""
        return str(getattr(self, "method", type(self).__name__))

    def to_frame(self) -> DataFrame:
        """The answer as a tidy table."""
        raise NotImplementedError(f"{type(self).__name__} has no table")

    def in_units(self, units: str) -> DataFrame:
        """The table of the answer in units of one's choice.

        Parameters
        ----------
        units
            Units with commas between them, as "mm, g": one of each quantity at most. Numbers of
            other quantities stay in SI units.

        Returns
        -------
        pandas.DataFrame
            The table, with the chosen units in the names of its columns.

        See Also
        --------
        Result.to_frame : The table in SI units.
        """

        with shown_in(units_of(units)):
            return in_chosen_units(self.to_frame())

    def plot(
        self,
        ax: Axes | None = None,
        *,
        units: str = "",
        style: Literal["screen", "paper"] = "screen",
    ) -> Axes:
        """Draw the answer.

        Parameters
        ----------
        ax
            Axes to draw in; by default those of a new figure. They take the first panel of a
            picture of several.
        units
            Units of the picture with commas between them, as "in, g"; by default mm and g, or what
            reads well.
        style
            How it looks: "paper" is one column of a journal, without a title, and reads in grey.

        Returns
        -------
        matplotlib.axes.Axes
            The Axes that were drawn in, the first of several.
        """
        with shown_in(units_of(units)) if units else nullcontext():
            return drawn(self, ax, style)

    def to_dict(self) -> dict[str, Any]:
        """The JSON document: only plain types, never NaN or infinity. Its numbers are in SI units,
        its sentences in the usual units, whatever is shown elsewhere."""
        with shown_in(USUAL):
            return {name: plain(value) for name, value in self._document().items()}

    def with_provenance(self, **more: Any) -> Self:
        """The answer with more of its provenance."""
        found = copy.copy(self)
        vars(found)["provenance"] = {**self.provenance, **more}
        return found

    def _document(self) -> dict[str, Any]:
        """What the class says is in the document, then the other fields, those that are common to
        all answers last.

        A kind of answer whose keys depend on what was found overrides this.
        """
        found = ({"method": self.kind} if self.kind else {}) | _described(self)
        return {name: found[name] for name in sorted(found, key=COMMON.__contains__)}

    def _repr_html_(self) -> str:
        remarks = "".join(f"<br>{html.escape(each, quote=False)}" for each in self._remarks())
        table = self._shown().to_html(index=False, max_rows=MOST_ROWS)
        return f"<b>{html.escape(self.summary(), quote=False)}</b>{table}{remarks}"

    def _shown(self) -> DataFrame:
        """The table that a notebook shows: in three columns where `to_frame` has a row for each
        quantity."""
        table = self.to_frame()
        return frame_of(in_three_columns(table)) if {"value", "unit"} <= {*table} else table

    def _remarks(self) -> Sequence[str]:
        """Sentences below the table in a notebook."""
        return self.warnings


check_methods(Result)


def _described(found: Any) -> dict[str, Any]:
    """What the class of an answer, or of a part of one, says is in its document, then the other
    fields; tables that it names are columns."""
    kind: Any = type(found)
    stated = getattr(found, "in_document", {})
    left_out = {*getattr(found, "not_in_document", ()), *stated.values()}
    own = {key: _on_the_way(found, way) for key, way in stated.items()}
    own |= {name: getattr(found, name) for name in _names_of(kind) if name not in left_out}
    for name in getattr(found, "as_columns", ()):
        own[name] = None if own[name] is None else own[name].to_dict("list")
    omitted = getattr(found, "omitted", ())
    return {name: each for name, each in own.items() if name not in omitted}


def _on_the_way(part: Any, way: str) -> Any:
    """What a way such as "resonance.free_amplitude" leads to; None where a part of it is None."""
    for name in way.split("."):
        part = None if part is None else getattr(part, name)
    return part() if callable(part) else part


def _lasting(part: Any) -> Any:
    """A part of a document without what differs from run to run."""
    if isinstance(part, dict):
        return {name: _lasting(each) for name, each in part.items() if name not in ("cost", "call")}
    return [_lasting(each) for each in part] if isinstance(part, list) else part


def plain(value: Any) -> Any:
    """A value as plain types that JSON can hold; a number that is not finite becomes None.

    >>> plain({"speeds": np.array([1.0, np.nan]), "seen": np.bool_(True), "by": ("x", 2)})
    {'speeds': [1.0, None], 'seen': True, 'by': ['x', 2]}
    """
    if value is None or isinstance(value, bool | int | str):
        return value
    if callable(document := getattr(value, "document", None)):  # a scene
        return plain(document())
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if is_dataclass(value) and not isinstance(value, type | Mapping):
        if hasattr(value, "to_dict"):
            return value.to_dict()
        return {name: plain(each) for name, each in _described(value).items()}
    if hasattr(value, "_asdict"):
        value = value._asdict()
    if hasattr(value, "iloc"):  # a table
        value = value.to_dict("records")
    if isinstance(value, Mapping):
        return {str(name): plain(each) for name, each in value.items()}
    if isinstance(value, Iterable):
        return [plain(each) for each in value]
    raise TypeError(f"{type(value).__name__} has no form in JSON")


def total_cost(costs: Iterable[Cost]) -> Cost:
    """Cost of several answers together, calculated one after the other."""
    known = list(costs)
    return Cost(
        wall_time=sum(each.wall_time for each in known),
        compile_time=sum(each.compile_time for each in known),
        steps=sum(each.steps for each in known),
        impacts=sum(each.impacts for each in known),
        paths=sum(each.paths for each in known),
        threads=max((each.threads for each in known), default=1),
    )


# ------------------------------------------------------------------------------
# The stationary response of a scene: the one form in which every method answers.
# ------------------------------------------------------------------------------


Quantity = TypeVar("Quantity", covariant=True)


class Quantities(Mapping[str, Quantity]):
    """Quantities by name, as attributes and as a mapping; None if a method does not give one."""

    def __getitem__(self, name: str) -> Quantity:
        if name not in self._names():
            raise unknown_name(name, self._names())
        return cast("Quantity", getattr(self, name))

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any:
            raise AttributeError(*unknown_name(name, _names_of(type(self))).args)

    def __iter__(self) -> Iterator[str]:
        return iter(self._names())

    def __len__(self) -> int:
        return len(self._names())

    def _names(self) -> Sequence[str]:
        return _names_of(type(self))


@cache
def _names_of(kind: Any) -> tuple[str, ...]:
    """Names of the fields of a class."""
    return tuple(each.name for each in fields(kind))


@dataclass(frozen=True, kw_only=True)
class CoordinateResponse(Quantities[Estimate | None]):
    """The stationary motion of one coordinate.

    `response.coordinates["x"].displacement_std` and `response.coordinates["x"]["displacement_std"]`
    are the same.

    Parameters
    ----------
    displacement_mean, displacement_std, displacement_mean_square
        Moments of the displacement, m, m and m^2; positions are measured from the unloaded spring.
    velocity_std, velocity_mean_square
        Moments of the velocity, m/s and m^2/s^2.
    acceleration_std
        Standard deviation of the absolute acceleration, m/s^2; with rigid stops, of the motion
        between impacts. None where it is infinite or not known.
    upcrossing_rate
        Rate of upcrossings of the mean, 1/s.

    See Also
    --------
    stochvi.Response : The answer that holds it.
    """

    displacement_mean: Estimate | None = stated("mean displacement", "m")
    displacement_std: Estimate | None = stated("std. dev. of displ.", "m")
    displacement_mean_square: Estimate | None = stated("mean square displ.", "m^2")
    velocity_std: Estimate | None = stated("rms velocity", "m/s")
    velocity_mean_square: Estimate | None = stated("mean square velocity", "m^2/s^2")
    acceleration_std: Estimate | None = stated("std. dev. abs. accel.", "m/s^2")
    upcrossing_rate: Estimate | None = stated("up-crossings of mean", "1/s")


NEVER_ZERO = (
    "collision_rate", "collision_rate_lower", "collision_rate_upper", "impact_speed_rate",
    "impact_speed_square_rate", "contact_probability", "contact_force_lower", "contact_force_upper",
)  # fmt: skip
"""Quantities of a stop that are above 0 however far it is: where a formula gives 0, they are less
than the smallest number of double precision, which then is their bias."""


def _has_error(found: Estimate) -> bool:
    """Whether a number has an error or an upper limit, or one that is not known."""
    return bool(found.standard_error or found.bias is None or found.bias or found.upper_95)


@dataclass(frozen=True, kw_only=True)
class PairResponse(Quantities[Estimate | float | None]):
    """The impacts of one impact pair.

    Parameters
    ----------
    collision_rate, collision_rate_lower, collision_rate_upper
        Rates of impacts faster than `speed_threshold`, 1/s: of all impacts, and of those on the
        lower and the upper stop. For compliant stops, the rates at which contacts begin.
    impact_speed_mean
        F1 over the rate, m/s. F1 sums all impacts, the rate only those above `speed_threshold`: at
        the default threshold this exceeds the mean speed of the counted ones by less than 0.1 % at
        R >= 0.5. Where the mass rests at a stop of R = 0.1 it is 3 %.
    impact_speed_rate, impact_speed_square_rate
        Sums per second of the impact speeds, F1 in m/s^2, and of their squares, F2 in m^2/s^3.
    peak_force
        Mean over contacts of the largest force, N; for compliant stops only.
    contact_probability, contact_force_lower, contact_force_upper
        For compliant stops only: the share of time in contact, and the mean forces on the lower and
        the upper stop, N. A mass is in contact while it is beyond the stop, even if the stop does
        not push yet; contact with a stop that loses energy ends when its force returns to zero.
    relative_displacement_mean, relative_displacement_std, relative_velocity_std
        Motion of the gap, m and m/s. A pair of two coordinates has the motion of the first relative
        to the second; a place of a rigid body has its motion along the direction of the pair.
    speed_threshold
        The slowest impact that the rates count, m/s.

    See Also
    --------
    stochvi.Response : The answer that holds it.
    """

    collision_rate: Estimate | None = stated("impacts, all stops", "1/s")
    collision_rate_lower: Estimate | None = stated("impacts, lower stop", "1/s")
    collision_rate_upper: Estimate | None = stated("impacts, upper stop", "1/s")
    impact_speed_mean: Estimate | None = stated("mean impact speed", "m/s")
    impact_speed_rate: Estimate | None = stated("F1, sum of w per s", "m/s^2")
    impact_speed_square_rate: Estimate | None = stated("F2, sum of w^2 per s", "m^2/s^3")
    peak_force: Estimate | None = stated("mean peak force", "N")
    contact_probability: Estimate | None = stated("share of time in contact")
    contact_force_lower: Estimate | None = stated("mean force, lower stop", "N")
    contact_force_upper: Estimate | None = stated("mean force, upper stop", "N")
    relative_displacement_mean: Estimate | None = stated("mean relative displ.", "m")
    relative_displacement_std: Estimate | None = stated("std. dev. rel. displ.", "m")
    relative_velocity_std: Estimate | None = stated("rms relative velocity", "m/s")
    speed_threshold: float = 0.0

    def __post_init__(self) -> None:
        for name in NEVER_ZERO:
            found = getattr(self, name)
            if found is not None and found.value == 0.0 and not _has_error(found):
                # the attributes of a frozen class
                object.__setattr__(self, name, replace(found, bias=sys.float_info.min))

    def _names(self) -> Sequence[str]:
        """Names of the quantities, without the relative motion where the gap is a coordinate."""
        return [
            name
            for name in super()._names()
            if not (name.startswith("relative_") and getattr(self, name) is None)
        ]


RESPONSE_QUANTITIES = {**quantities_of(CoordinateResponse), **quantities_of(PairResponse)}
"""Words and units of all quantities of a coordinate, then of an impact pair."""


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Response(Result):
    """The stationary response of a scene by one method.

    `coordinates` and `impact_pairs` map the name of a coordinate or pair to its quantities, which
    may be given as any mapping from their names. `identities` holds the residuals of the energy,
    virial and force balances, which are zero for a correct answer. `statistics` holds the means of
    functions of one's own (`monte_carlo.Statistic`), in the units of the functions. `stop_powers`
    holds the mean power that the stops of each pair take in a simulation, W; it is no part of
    documents.

    See Also
    --------
    stochvi.simulate : The response by Monte Carlo.
    stochvi.check : Responses by several methods, compared.

    Examples
    --------
    >>> import stochvi
    >>> scene = stochvi.load_scene(stochvi.scenes.shipped_scene("oscillator-elastic"))
    >>> response = stochvi.exact(scene)
    >>> response["x"].velocity_std.value == response["x.velocity_std"].value
    True
    >>> round(response["x.velocity_std"].value, 3)
    1.0
    >>> response.to_frame().columns[:4].tolist()
    ['method', 'of', 'quantity', 'unit']
    """

    not_in_document = ("stop_powers",)
    sometimes = ("statistics",)

    method: str
    coordinates: Mapping[str, CoordinateResponse]
    impact_pairs: Mapping[str, PairResponse]
    identities: Mapping[str, Estimate] = field(default_factory=dict)
    statistics: Mapping[str, Estimate] = field(default_factory=dict)
    stop_powers: Mapping[str, Estimate] = field(default_factory=dict)
    effects: Sequence[str] = ()
    assumptions: Sequence[str] = ()

    def __post_init__(self) -> None:
        for name, record in (("coordinates", CoordinateResponse), ("impact_pairs", PairResponse)):
            group = {
                owner: each if isinstance(each, record) else record(**each)
                for owner, each in getattr(self, name).items()
            }
            object.__setattr__(self, name, Named(group))

    @property
    def quantities(self) -> Mapping[str, Any]:
        """Those of the coordinates and pairs, and the statistics of one's own."""
        own = {"statistics": Named(self.statistics)} if self.statistics else {}
        return {**super().quantities, **own}

    def estimates(self) -> dict[tuple[str, str], Estimate]:
        """Every estimate that exists, keyed by (coordinate or pair, quantity)."""
        return {
            (owner, name): each
            for owner, part in self.quantities.items()
            for name, each in part.items()
            if isinstance(each, Estimate)
        }

    def densities(self) -> Mapping[str, Any]:
        """Densities of the coordinate, or of every gap, of a simulation or of averaging, by name.

        They are calculated when this is called. Those of a simulation take some seconds at most,
        with the seed of the answer, and have 95 % bands. Those of averaging have bands from the
        atlas of its errors. There are none of other methods.

        Returns
        -------
        Mapping[str, BandedDensity or AveragedBins]
            Each with its `edges`, `density` and `bands()`; simulated ones with `standard_error`.

        Raises
        ------
        NotApplicable
            Where the answer comes from a file and its scene has a Python function, or a file that
            is not there any more.

        See Also
        --------
        stochvi.simulate : The simulation whose densities they are; its `plot` draws them.
        """
        known = self.method.partition(":")[0] in ("simulate", "average")
        return densities_of(self) if known else {}

    def changed(self, change: Callable[[str, Estimate], Estimate]) -> Self:
        """The response with every estimate replaced by `change(quantity, estimate)`."""

        def record(known: Any) -> Any:
            found = {
                name: change(name, each)
                for name, each in known.items()
                if isinstance(each, Estimate)
            }
            return replace(known, **found)

        return replace(
            self,
            coordinates={owner: record(each) for owner, each in self.coordinates.items()},
            impact_pairs={owner: record(each) for owner, each in self.impact_pairs.items()},
        )

    def to_frame(self) -> DataFrame:
        """A tidy table, one row per quantity."""
        return frame_of(
            {
                "method": self.method,
                "of": owner,
                "quantity": name,
                "unit": unit_of(owner, name),
                **estimate.to_dict(),
                "bias_error": estimate.bias_error,
            }
            for (owner, name), estimate in self.estimates().items()
        )

    @classmethod
    def from_dict(cls, document: Mapping[str, Any]) -> Self:
        """The response whose JSON document this is; a ValueError if it is not such a document."""

        def estimates(entries: Mapping[str, Any]) -> dict[str, Any]:
            return {
                name: Estimate(**item) if isinstance(item, dict) else item
                for name, item in entries.items()
            }

        parts = dict(document)
        try:
            for group in ("coordinates", "impact_pairs"):
                parts[group] = {owner: estimates(part) for owner, part in parts[group].items()}
            parts["identities"] = estimates(parts["identities"])
            parts["statistics"] = estimates(parts.get("statistics", {}))
            return cls(**parts | {"cost": Cost(**parts["cost"])})
        except (AttributeError, KeyError, TypeError) as error:
            raise ValueError(
                "expected the document of a response, as Response.to_dict makes it; a part of this "
                f"one is missing or has another name: {error}"
            ) from error

    def __repr__(self) -> str:
        lines = [f"<{self.method}"]
        for (owner, name), estimate in self.estimates().items():
            value = format_with_error(estimate.value, estimate.standard_error)
            unit = f" {known}" if (known := unit_of(owner, name)) else ""
            lines.append(f"  {owner}.{name} = {value}{unit}{estimate.bias_in_words}")
        return "\n".join(lines) + ">"
