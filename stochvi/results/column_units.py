"""Units in the names of the columns of CSV files, `clearance_m` and `impact_speed_m_s`, and tables
in the units that a reader has chosen."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import TYPE_CHECKING

from stochvi.mathematics.shown_units import ShownQuantity, shown_as, units_are_chosen
from stochvi.results.estimates import BIAS, BIAS_ERROR, ERROR, LIMIT
from stochvi.results.quantity_units import QUANTITY_UNITS, ROTATIONS

if TYPE_CHECKING:
    import pandas as pd

SUFFIXES = {
    "m": "m", "m^2": "m2", "m/s": "m_s", "m/s^2": "m_s2", "m^2/s^2": "m2_s2", "m^2/s^3": "m2_s3",
    "1/s": "per_s", "s": "s", "N": "N", "Hz": "Hz", "kg": "kg", "dB": "dB", "km/h": "km_h",
    "N s/m": "N_s_m", "N/m": "N_m", "g": "g", "mm": "mm",
}  # fmt: skip
"""Spelling of units in the names of columns; a unit that is not listed, such as 1, is left out of
the name."""

COLUMN_UNITS = {
    **QUANTITY_UNITS,
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
}  # fmt: skip
"""Units of the columns of tables by their names."""

DENSITY_UNITS = {"equivalent_density": "(m/s^2)^2/Hz", "fatigue_damage": "(m/s)^b"}
"""Units that files for programs state and names of columns do not."""

ENDING = re.compile(
    r"(?:_(?:low|high|error|standard_error|bias|without_stops|without))*"
    rf"(?:\.(?:{ERROR}|{BIAS}|{BIAS_ERROR}|{LIMIT}))?$"
)
"""Pattern of the end of a column that holds a bound or an error of another column; it stands behind
its name and unit."""

OF_A_VALUE = ("value", ERROR, BIAS, BIAS_ERROR, LIMIT, "lower", "upper", "95 % from", "to")
"""Columns of the unit that a row states."""


def with_unit(name: str, unit: str) -> str:
    """The name of a column with its unit.

    >>> with_unit("stops.impact_speed_mean", "m/s"), with_unit("hits", "1")
    ('stops.impact_speed_mean_m_s', 'hits')
    """
    suffix = SUFFIXES.get(unit)
    return f"{name}_{suffix}" if suffix else name


def named_with_units(table: pd.DataFrame) -> pd.DataFrame:
    """A table in SI units with the units of its columns in their names.

    >>> import pandas as pd
    >>> list(named_with_units(pd.DataFrame(columns=["clearance", "hit_rate_low", "note"])))
    ['clearance_m', 'hit_rate_per_s_low', 'note']
    """
    return table.rename(columns={str(name): _named(str(name)) for name in table})


def unit_of_column(column: str) -> str | None:
    """The SI unit of a column whose name does not state it; None where it is not known.

    >>> unit_of_column("extreme_response_bias_without_stops"), unit_of_column("equivalent_density")
    ('m/s^2', '(m/s^2)^2/Hz')
    """
    name, _ = _parts(column)
    return {**COLUMN_UNITS, **DENSITY_UNITS}.get(name)


def _parts(column: str) -> tuple[str, str]:
    """The name of a column, and its ending."""
    ending = ENDING.search(column)
    assert ending is not None
    return column[: ending.start()], ending[0]


def _named(column: str) -> str:
    name, ending = _parts(column)
    unit = COLUMN_UNITS.get(name)
    return column if unit is None else with_unit(name, unit) + ending


def in_chosen_units(table: pd.DataFrame, units: Mapping[str, str] = {}) -> pd.DataFrame:
    """A table of SI numbers in the units that a reader has chosen; without a choice, as it is.

    `units` are SI units of columns whose name does not tell.

    A column is converted if its unit is known, by its name or by its row, and a unit of its
    quantity is chosen. Its name, or the `unit` of the row, then states that unit. All others stay
    in SI units.

    >>> import pandas as pd
    >>> from stochvi.mathematics.shown_units import shown_in, units_of
    >>> with shown_in(units_of("mm")):
    ...     in_chosen_units(pd.DataFrame({"clearance": [0.004], "time_s": [1.0]}))
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
        name, known, ending = _quantity_of(column, units)
        if known is not None and known.chosen is not None:
            found[column] = known(found[column])
            names[column] = f"{name}_{_suffix(str(known))}{ending}"
    return found.rename(columns=names)


def _quantity_of(column: str, units: Mapping[str, str]) -> tuple[str, ShownQuantity | None, str]:
    """The name of a column without its unit, its quantity where that is known, and its ending."""
    name, ending = _parts(column)
    if any(part in ROTATIONS for part in name.split(".")[:-1]):
        return name, None, ending
    for known, suffix in sorted(SUFFIXES.items(), key=lambda each: -len(each[1])):
        if name.endswith(f"_{suffix}"):
            return name.removesuffix(f"_{suffix}"), shown_as(known), ending
    unit = units.get(name) or COLUMN_UNITS.get(name)
    return name, None if unit is None else shown_as(unit), ending


def _suffix(unit: str) -> str:
    """A unit in the name of a column: "in_s2" of in/s², "per_h" of 1/h."""
    plain = unit.replace("²", "2").replace("µ", "u").replace("1/", "per_")
    return re.sub(r"\W+", "_", plain).strip("_")
