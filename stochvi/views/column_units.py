"""Units in the names of the columns of CSV files: `clearance_m`, `impact_speed_m_s`."""

from __future__ import annotations

from typing import TYPE_CHECKING

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
    "clearance": "m",
    "sigma": "m",
    "impact_speed_mean": "m/s",
    "acceleration_rms": "m/s^2",
    "largest_acceleration": "m/s^2",
    "largest_acceleration_bias": "m/s^2",
    "rice_rate": "1/s",
    "first_hit_rate": "1/s",
    "hit_rate": "1/s",
    "exceedance_rate": "1/s",
}
"""Units of the columns of tables by their names."""

ENDINGS = ("_low", "_high", "_error")
"""Endings of columns that hold a bound or an error of another column; they stand behind its name
and unit."""


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


def _named(column: str) -> str:
    ending = next((end for end in ENDINGS if column.endswith(end)), "")
    name = column.removesuffix(ending)
    unit = COLUMN_UNITS.get(name)
    return column if unit is None else with_unit(name, unit) + ending
