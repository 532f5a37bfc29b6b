"""The table of a sweep as an xarray Dataset: a grid with coordinates and units."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from stochvi.views.sweep import UNITS, quantities, unit_of_key

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

KEYS = "keys"
"""Attribute of the table of a sweep that names the keys that were varied."""

OTHER_UNITS = {"seconds": "s"}
"""Units of columns that are no quantities."""


def to_xarray(table: pd.DataFrame, keys: Sequence[str] | None = None) -> xr.Dataset:
    """Return the table of a sweep as a Dataset with coordinates and units.

    Where the rows are all combinations of the values of the keys, each key is a dimension. Else, as
    for a table of samples, the one dimension is "sample", and the keys are coordinates along it.
    Variables have the names of the columns, and `attrs["units"]` in SI. This needs xarray, which
    `pip install "stochvi[xarray]"` brings.

    Parameters
    ----------
    table
        What `stochvi.sweep` returned, or a part of its rows.
    keys
        The columns that are coordinates; by default those that were varied. A table that was read
        from a file needs them.

    Raises
    ------
    ValueError
        If the keys are not known, or are no columns of the table.

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
    import xarray as xr

    names = list(table.attrs.get(KEYS, ()) if keys is None else keys)
    if not names or not set(names) <= set(table):
        raise ValueError(
            f"keys must name columns of the table, got {names or 'none'}; give keys=[...] where "
            "the table was read from a file"
        )
    numbers = [table[name].nunique() for name in names]
    whole = math.prod(numbers) == len(table) and not table.duplicated(names).any()
    if whole:
        found = xr.Dataset.from_dataframe(table.set_index(names))
    else:
        rows = table.reset_index(drop=True).rename_axis("sample")
        found = xr.Dataset.from_dataframe(rows).set_coords(names)
    for name, unit in _units(table, names).items():
        found[name].attrs["units"] = unit
    return found


def _units(table: pd.DataFrame, keys: Sequence[str]) -> dict[str, str]:
    """The SI units of the columns that have one."""
    found = {key: unit for key in keys if (unit := unit_of_key(key)) is not None}
    for quantity in quantities(table):
        unit = UNITS.get(quantity.rsplit(".", 1)[1], "1")
        found[quantity] = unit
        # its errors and limits have the unit of the quantity
        found |= {str(name): unit for name in table if str(name).startswith(f"{quantity}.")}
    found |= {str(name): "m/s" for name in table if str(name).endswith(".speed_threshold")}
    return found | {name: unit for name, unit in OTHER_UNITS.items() if name in table}
