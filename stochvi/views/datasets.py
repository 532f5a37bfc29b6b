"""Views of a sweep. Chapters: columns, and pictures over the first key; an xarray Dataset."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from stochvi.mathematics.units import NUMBER, ShownQuantity, readable, shown_as
from stochvi.results.base import (
    OF_A_VALUE,
    RESPONSE_QUANTITIES,
    DataFrame,
    Result,
    Stated,
    estimate_of,
    frame_of,
    rows_of,
    stated_unit,
    unit_of_column,
    with_unit,
)
from stochvi.results.estimates import (
    BIAS,
    BIAS_ERROR,
    ERROR,
    GAUSSIAN_95,
    LIMIT,
    plus_minus,
)
from stochvi.scenes.keys import KEY_UNITS
from stochvi.statistics.hardness import HARDNESS
from stochvi.views.axes import Chart, Scale, panels
from stochvi.views.files import try_picture, write_parquet, write_table
from stochvi.views.pages import Grid, Section, Told
from stochvi.views.tables import NEGLIGIBLE

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr
    from matplotlib.axes import Axes

    from stochvi.statistics.densities import BandedDensity


# ------------------------------------------------------------------------------
# Views of a sweep: the main columns of its table, and pictures over its first key.
# ------------------------------------------------------------------------------


SIZE = (7.2, 4.4)
"""Size of a figure, inches."""

MOST_IN_A_LEGEND = 12
"""Largest number of lines of a picture that a legend names; more would cover the picture."""

OF_ANSWERS = {
    "clearance": Stated("clearance per side", "m"), "three_sigma": Stated("3 sigma", "m"),
    "expected_hits": Stated("expected impacts", "1"),
    "hit": Stated("probability of any impact", "1"),
    "passage": Stated("probability of a passage", "1"),
    **{name: Stated(f"probability of {kind.too}", "1") for name, kind in HARDNESS.items()},
    "displacement_max": Stated("largest x", "m"), "displacement_min": Stated("smallest x", "m"),
    "acceleration_max": Stated("peak acceleration", "m/s^2"), "hits": Stated("impacts", ""),
    "impact_speed_max": Stated("largest impact speed", "m/s"),
}  # fmt: skip
"""Quantities of sizings, reliabilities and replays, in the order in which a terminal and a contact
sheet show them."""

GOVERNED = (
    "displacement_std", "acceleration_std", "collision_rate", "impact_speed_mean", "peak_force",
    *OF_ANSWERS,
)  # fmt: skip
ON_TERMINAL = {"displacement_std", "collision_rate", "impact_speed_rate", *OF_ANSWERS}
"""Quantities that matter most, which the contact sheet and the terminal show; files hold all."""

MOST_PANELS, PANEL = 12, (3.6, 2.9)
"""Largest number of pictures on a contact sheet, and the size of one, inches."""

WORDS = {name: each.words for name, each in (RESPONSE_QUANTITIES | OF_ANSWERS).items()}
UNITS = {
    **{name: each.unit or "1" for name, each in (RESPONSE_QUANTITIES | OF_ANSWERS).items()},
    "contact_time": "s", "rms_displacement": "m", "probability_at_three_sigma": "1",
}  # fmt: skip
"""Words and units of all quantities of a sweep."""

UNIT_ENDINGS = ("_hz", "_db", "_kmh")
"""Endings of keys that state their unit themselves."""


def quantities(table: DataFrame) -> list[str]:
    """Columns of a table that are quantities, in its order."""
    return [str(name) for name in table if f"{name}.{ERROR}" in table]


def terminal_table(table: DataFrame, keys: Sequence[str]) -> DataFrame:
    """The table as a terminal shows it: keys, and main quantities with standard errors."""

    found = frame_of(
        {
            quantity.heading(key): quantity(table[key])
            for key, quantity in zip(keys, map(_quantity_of_key, keys), strict=True)
        }
    )
    for quantity in quantities(table):
        if quantity.rsplit(".", 1)[1] in ON_TERMINAL:
            shown = _quantity(table, quantity)
            found[_named(table, quantity)] = [
                plus_minus(estimate_of(row, quantity), shown) for row in rows_of(table)
            ]
    return found


def sweep_told(table: DataFrame, keys: Sequence[str], method: str) -> Told:
    """The table as a terminal shows it."""
    return Told(sections=[Section(grids=Grid.of(method, terminal_table(table, keys), words=0))])


def unseen(table: DataFrame) -> pd.Series:
    """For each row, whether an event was never seen, so that only an upper limit is known."""
    limits = [name for name in table if str(name).endswith(f".{LIMIT}")]
    return table[limits].notna().any(axis=1)


def _shown(table: DataFrame, unit: str) -> ShownQuantity:
    """A unit as the method of a table shows it: responses are in SI units, answers on gaps in mm
    and g."""
    on_gaps = any(each.rsplit(".", 1)[1] in OF_ANSWERS for each in quantities(table))
    return readable(unit) if on_gaps else shown_as(unit)


def _quantity(table: DataFrame, name: str) -> ShownQuantity:
    return _shown(table, UNITS.get(name.rsplit(".", 1)[1], "1"))


def _named(table: DataFrame, quantity: str) -> str:
    """The name of a quantity with its unit, and with its owner where there are several owners."""
    owner, name = quantity.rsplit(".", 1)
    several = sum(other.endswith(f".{name}") for other in quantities(table)) > 1
    whose = f"{owner}: " if several else ""
    words = WORDS.get(name) or name.replace("_", " ")
    unit = str(_quantity(table, quantity))
    return f"{whose}{words}" if unit == "1" else f"{whose}{words} ({unit})"


def changes(table: DataFrame, quantity: str) -> bool:
    """Whether a quantity differs between rows by more than rounding."""
    owner, name = quantity.rsplit(".", 1)
    deviation = f"{owner}.{name.removesuffix('_mean')}_std"
    scale = table[deviation if deviation in table else quantity].abs().max()
    return bool(table[quantity].max() - table[quantity].min() > NEGLIGIBLE * scale)


def draw_sweep(
    table: DataFrame, keys: Sequence[str], quantity: str, title: str = "", ax: Axes | None = None
) -> Axes:
    """Draw a quantity against the first key, with one line for each combination of the others.

    Bars are 95 % intervals of the statistical error alone.
    """
    from matplotlib import colormaps

    alone, name = ax is None, quantity.rsplit(".", 1)[1]
    shown, key = _quantity(table, quantity), _shown(table, unit_of_key(keys[0]) or "")
    chart = Chart.on(ax, Scale(_last(keys[0]), key), Scale(name, shown), SIZE)
    ax = chart.ax
    groups = table.groupby(list(keys[1:]), sort=True) if keys[1:] else [((), table)]
    colours = map(tuple, colormaps["viridis"](np.linspace(0.0, 0.88, len(groups))))
    for colour, (values, group) in zip(colours, groups, strict=True):
        pairs = zip(keys[1:], values, strict=True)
        label = ", ".join(f"{_last(key)} {value:.4g}" for key, value in pairs)
        x, y = group[keys[0]], group[quantity]
        half = GAUSSIAN_95 * group[f"{quantity}.{ERROR}"]
        chart.points(x, y, label, colour, "o-", low=y - half, high=y + half, capsize=2)
        if (limit := f"{quantity}.{LIMIT}") in group:
            unseen = group[group[limit].notna()]
            chart.points(unseen[keys[0]], unseen[limit], "_never seen", colour, "v")
    if 1 < len(groups) <= MOST_IN_A_LEGEND:
        ax.legend(frameon=False, fontsize="small")
    ax.set(xlabel=chart.x.label, ylabel=_named(table, quantity))
    if _spans_decades(table[quantity]) or (
        name in OF_ANSWERS and OF_ANSWERS[name].unit == "1" and (table[quantity] > 0.0).all()
    ):
        ax.set_yscale("log")
    if alone:
        ax.set_title(_title(table, [quantity], title), fontsize="medium")
    for side in ("top", "right"):
        ax.spines[side].set_visible(False)
    return ax


LINEAR = 30.0
"""Largest ratio of positive values that a linear axis shows."""


def _spans_decades(values: pd.Series) -> bool:
    """Whether values, none of them negative, differ too much for a linear axis."""
    positive = values[values > 0.0]
    return not (values < 0.0).any() and bool(positive.max() > LINEAR * positive.min())


def _span(values: pd.Series) -> tuple[float, float]:
    """Ends of an axis that holds these values, the same in all pictures of a sheet."""
    low, high = float(values.min()), float(values.max())
    margin = 0.06 * (high - low) or 0.5 * abs(high) or 0.5
    return low - margin, high + margin


def _title(table: DataFrame, drawn: Sequence[str], title: str) -> str:
    """The title of a sweep, its method, and what bars mean where there are any."""
    how = ", ".join(dict.fromkeys(table["method"]))
    if any((table[f"{quantity}.{ERROR}"] > 0.0).any() for quantity in drawn):
        how += "; bars: 95 % intervals"
    return f"{title}\n{how}" if title else how


def _quantity_of_key(key: str) -> ShownQuantity:
    """The quantity of the values of a key; a number where its name states the unit."""
    unit = unit_of_key(key)
    return NUMBER if unit is None or key.endswith(UNIT_ENDINGS) else shown_as(unit)


def unit_of_key(key: str) -> str | None:
    """The unit of the values of a key; None for one without."""
    name = _last(key).rsplit(".", 1)[-1]
    return "m/s" if name == "speed_threshold" else KEY_UNITS.get(name)


def draw_sheet(table: DataFrame, keys: Sequence[str], title: str = "") -> Axes:
    """The quantities that matter most and that change, each in a small picture of one sheet."""
    chosen = [
        quantity
        for name in GOVERNED
        for quantity in quantities(table)
        if quantity.rsplit(".", 1)[1] == name and changes(table, quantity)
    ][:MOST_PANELS]
    if not chosen:
        chosen = quantities(table)[:1]
    ends = _span(_shown(table, unit_of_key(keys[0]) or "")(table[keys[0]]))

    def draw(quantity: str, ax: Axes) -> None:
        draw_sweep(table, keys, quantity, ax=ax).set_xlim(*ends)
        legend = ax.get_legend()
        if legend is not None and quantity != chosen[0]:
            legend.remove()

    columns = min(len(chosen), 3)
    size = max(columns, 2) * PANEL[0], -(-len(chosen) // columns) * PANEL[1]
    title = _title(table, chosen, title)
    each = [partial(draw, quantity) for quantity in chosen]
    return panels(None, each, size, title, columns, sharex=False)


def _last(key: str) -> str:
    """The last words of a key without its places in lists, such as "law.coefficient"."""
    words = [word for word in key.split(".") if not word.isdigit()]
    return ".".join(words[-2:])


def write_sweep_table(table: DataFrame, keys: Sequence[str], folder: Path) -> DataFrame:
    """Write `sweep.csv`, and return the table with units in the names of its columns."""
    written = with_units(table, keys)
    write_table(written, folder / "sweep.csv")
    return written


def write_sweep(table: DataFrame, keys: Sequence[str], folder: str | Path, title: str = "") -> None:
    """Write `sweep.csv`, `sweep.parquet` where pyarrow is installed, and the contact sheet
    `sweep.png`; the units stand in the names of the columns."""
    folder = Path(folder)
    written = write_sweep_table(table, keys, folder)
    write_parquet(written, folder / "sweep.parquet")
    if quantities(table):
        try_picture(partial(draw_sheet, table, keys, title), folder / "sweep.png")


ENDS = ("", *(f".{name}" for name in (ERROR, BIAS, BIAS_ERROR, LIMIT)))
"""Endings that the columns of a quantity may have behind its name."""


def with_units(table: DataFrame, keys: Sequence[str]) -> DataFrame:
    """The table with units in the names of its columns: "stops.collision_rate_per_s", and its
    "stops.collision_rate_per_s.standard_error"; spaces, as of a pair's name, become "_"."""
    names = {
        key: key if key.endswith(UNIT_ENDINGS) else with_unit(key, unit_of_key(key) or "")
        for key in keys
    }
    for quantity in quantities(table):
        named = with_unit(quantity, UNITS.get(quantity.rsplit(".", 1)[1], "1"))
        names |= {f"{quantity}{end}": f"{named}{end}" for end in ENDS}
    thresholds = [str(name) for name in table if str(name).endswith(".speed_threshold")]
    names |= {name: with_unit(name, "m/s") for name in thresholds}
    return table.rename(columns={old: "_".join(new.split()) for old, new in names.items()})


# ------------------------------------------------------------------------------
# The table of a sweep as an xarray Dataset: a grid with coordinates and units.
# ------------------------------------------------------------------------------


KEYS = "keys"
"""Attribute of the table of a sweep that names the keys that were varied."""

OTHER_UNITS = {"seconds": "s"}
"""Units of columns that are no quantities."""


MOST_BLANKS = 4
"""Most cells of the grid of an answer for each row of its table; of sparser ones rows are kept."""


def to_xarray(
    table: DataFrame | Result | BandedDensity, keys: Sequence[str] | None = None
) -> xr.Dataset:
    """Return the table of a sweep, or of any answer, as a Dataset with coordinates and units.

    Where the rows are all combinations of the values of the keys, each key is a dimension; answers
    may lack a few, which are NaN. Else, as for a table of samples, the one dimension is "sample",
    and the keys are coordinates along it. Variables have the names of the columns, and
    `attrs["units"]` in SI; where the units of rows differ, they are a coordinate. This needs
    xarray, which `pip install "stochvi[xarray]"` brings.

    Parameters
    ----------
    table
        What `stochvi.sweep` returned, or a part of its rows, or an answer: a history, a spectrum, a
        density of `simulate`, a map, basins.
    keys
        The columns that are coordinates; by default those that were varied, or the first of an
        answer that tell its rows apart. A table that was read from a file needs them.

    Raises
    ------
    ValueError
        If the keys are not known, or are no columns of the table.
    ImportError
        If xarray is not installed.

    See Also
    --------
    stochvi.sweep : What makes the table.

    Examples
    --------
    >>> import stochvi
    >>> scene = stochvi.load_scene(stochvi.scenes.shipped_scene("oscillator-elastic"))
    >>> values = {"impact_pair.0.upper": [1.0, 2.0], "structure.damping": [0.1, 0.2, 0.4]}
    >>> found = to_xarray(stochvi.sweep(scene, values, method="exact"))
    >>> dict(found.sizes)
    {'impact_pair.0.upper': 2, 'structure.damping': 3}
    >>> speed = found["x.velocity_std"]
    >>> speed.attrs["units"], float(speed.sel({"structure.damping": 0.1})[0])
    ('m/s', 1.0)
    """
    try:
        import xarray as xr
    except ImportError as error:
        raise ImportError('to_xarray needs xarray: pip install "stochvi[xarray]"') from error

    rows: Any = table
    most = 1
    if not hasattr(rows, "attrs") and hasattr(rows, "to_frame"):
        rows, most = rows.to_frame(), MOST_BLANKS
        columns = list(map(str, rows))
        firsts = (columns[: n + 1] for n in range(len(columns)))
        told = (first for first in firsts if not rows.duplicated(first).any())
        keys = next(told, columns[:1]) if keys is None else keys
    if not hasattr(rows, "attrs"):
        raise ValueError(
            f"table must be a table or an answer that is one, got a {type(rows).__name__}"
        )
    names = list(rows.attrs.get(KEYS, ()) if keys is None else keys)
    if not names or not set(names) <= set(rows):
        raise ValueError(
            f"keys must name columns of the table, got {names or 'none'}; give keys=[...] where "
            "the table was read from a file"
        )
    cells = math.prod(rows[name].nunique() for name in names)
    if cells <= most * len(rows) and not rows.duplicated(names).any():
        found = xr.Dataset.from_dataframe(rows.set_index(names))
    else:
        samples = rows.reset_index(drop=True).rename_axis("sample")
        found = xr.Dataset.from_dataframe(samples).set_coords(names)
    for name, unit in _units(rows, names).items():
        found[name].attrs["units"] = unit
    return _with_units_of_rows(found, rows) if "unit" in rows else found


def _with_units_of_rows(found: xr.Dataset, table: DataFrame) -> xr.Dataset:
    """The Dataset with the units that rows state: attributes of the values where all are the same,
    else a coordinate along quantities."""
    named = [str(each) for each in found.dims if each in table and table[each].dtype.kind == "O"]
    if table["unit"].nunique() == 1:
        for name in (each for each in OF_A_VALUE if each in found):
            found[name].attrs["units"] = table["unit"].iloc[0]
        return found.drop_vars("unit")
    if not named:
        return found.set_coords("unit")
    units = table.drop_duplicates(named).set_index(named)["unit"].to_xarray()
    return found.drop_vars("unit").assign_coords(unit=units)


def _unit_of_ending(name: str) -> str | None:
    """The unit of a frequency."""
    return "Hz" if name.endswith("_hz") else None


def _units(table: DataFrame, keys: Sequence[str]) -> dict[str, str]:
    """The SI units of the columns that have one."""
    found = {
        name: unit
        for name in map(str, table)
        if (unit := stated_unit(name)[1] or unit_of_column(name) or _unit_of_ending(name))
    }
    found |= {key: unit for key in keys if (unit := unit_of_key(key)) is not None}
    for quantity in quantities(table):
        unit = UNITS.get(quantity.rsplit(".", 1)[1], "1")
        found[quantity] = unit
        # its errors and limits have the unit of the quantity
        found |= {str(name): unit for name in table if str(name).startswith(f"{quantity}.")}
    found |= {str(name): "m/s" for name in table if str(name).endswith(".speed_threshold")}
    return found | {name: unit for name, unit in OTHER_UNITS.items() if name in table}
