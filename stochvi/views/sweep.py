"""A sweep for people: the main columns of its table, and pictures over its first key."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from stochvi.results.estimates import format_with_error
from stochvi.results.file_names import file_names
from stochvi.results.intervals import GAUSSIAN_95
from stochvi.results.response import QUANTITY_UNITS
from stochvi.views.axes import axes_or_new
from stochvi.views.files import try_picture, write_parquet, write_table
from stochvi.views.tables import NEGLIGIBLE, QUANTITY_NAMES

ERROR = "standard_error"
"""Ending of the columns of a table that hold the standard errors of a quantity."""

SIZE = (7.2, 4.4)
"""Size of a figure, inches."""

MOST_IN_A_LEGEND = 12
"""Largest number of lines of a picture that a legend names; more would cover the picture."""

GOVERNED = ("displacement_std", "velocity_std", "collision_rate", "impact_speed_rate")
"""Quantities that the table on the terminal shows; the files hold all of them."""

KEY_UNITS = {
    "lower": "m",
    "upper": "m",
    "play": "m",
    "mass": "kg",
    "damping": "N s/m",
    "stiffness": "N/m",
    "frequency_hz": "Hz",
    "level_db": "dB",
    "speed_kmh": "km/h",
}
"""Units of keys that have one unit wherever they stand in a scene file."""


def quantities(table: pd.DataFrame) -> list[str]:
    """Columns of a table that are quantities, in its order."""
    return [str(name) for name in table if f"{name} {ERROR}" in table]


def terminal_table(table: pd.DataFrame, keys: Sequence[str]) -> pd.DataFrame:
    """The table as a terminal shows it: keys, main quantities with standard errors, seconds."""

    def cell(value: float, error: float) -> str:
        return "-" if pd.isna(value) else format_with_error(value, error)

    found = table[list(keys)].copy()
    for quantity in quantities(table):
        if quantity.rsplit(".", 1)[1] in GOVERNED:
            pairs = zip(table[quantity], table[f"{quantity} {ERROR}"], strict=True)
            found[_named(table, quantity)] = [cell(value, error) for value, error in pairs]
    return found.assign(seconds=table["seconds"])


def _named(table: pd.DataFrame, quantity: str) -> str:
    """The name of a quantity with its unit, and with its owner where there are several owners."""
    owner, name = quantity.rsplit(".", 1)
    several = sum(other.endswith(f".{name}") for other in quantities(table)) > 1
    whose = f"{owner}: " if several else ""
    return f"{whose}{QUANTITY_NAMES[name]} ({QUANTITY_UNITS[name]})"


def changes(table: pd.DataFrame, quantity: str) -> bool:
    """Whether a quantity differs between rows by more than rounding."""
    owner, name = quantity.rsplit(".", 1)
    deviation = f"{owner}.{name.removesuffix('_mean')}_std"
    scale = table[deviation if deviation in table else quantity].abs().max()
    return bool(table[quantity].max() - table[quantity].min() > NEGLIGIBLE * scale)


def draw_sweep(table: pd.DataFrame, keys: Sequence[str], quantity: str, title: str = "") -> Axes:
    """Draw a quantity against the first key, with one line for each combination of the others.

    Bars are 95 % intervals of the statistical error alone.
    """
    ax = axes_or_new(None, SIZE)
    groups = table.groupby(list(keys[1:]), sort=True) if keys[1:] else [((), table)]
    colours = plt.get_cmap("viridis")(np.linspace(0.0, 0.88, len(groups)))
    for colour, (values, group) in zip(colours, groups, strict=True):
        pairs = zip(keys[1:], values, strict=True)
        label = ", ".join(f"{_last(key)} {value:.4g}" for key, value in pairs)
        ax.errorbar(
            group[keys[0]], group[quantity], GAUSSIAN_95 * group[f"{quantity} {ERROR}"],
            fmt="o-", markersize=4, capsize=2, color=colour, label=label,
        )  # fmt: skip
    if 1 < len(groups) <= MOST_IN_A_LEGEND:
        ax.legend(frameon=False, fontsize="small")
    unit = KEY_UNITS.get(_last(keys[0]).rsplit(".", 1)[-1])
    ax.set_xlabel(f"{keys[0]} ({unit})" if unit else keys[0])
    ax.set_ylabel(_named(table, quantity))
    how = ", ".join(dict.fromkeys(table["method"]))
    if (table[f"{quantity} {ERROR}"] > 0.0).any():
        how += "; bars: 95 % intervals"
    ax.set_title(f"{title}\n{how}" if title else how, fontsize="medium")
    for side in ("top", "right"):
        ax.spines[side].set_visible(False)
    return ax


def _last(key: str) -> str:
    """The last words of a key without its places in lists, such as "law.coefficient"."""
    words = [word for word in key.split(".") if not word.isdigit()]
    return ".".join(words[-2:])


def write_sweep(
    table: pd.DataFrame, keys: Sequence[str], folder: str | Path, title: str = ""
) -> None:
    """Write `sweep.csv`, `sweep.parquet` where pyarrow is installed, and a picture of each quantity
    that changes."""
    folder = Path(folder)
    write_table(table, folder / "sweep.csv")
    write_parquet(table, folder / "sweep.parquet")
    for quantity, name in file_names(quantities(table), ".png").items():
        if changes(table, quantity):
            try_picture(partial(draw_sweep, table, keys, quantity, title), folder / name)
