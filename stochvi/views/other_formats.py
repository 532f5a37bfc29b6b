"""Tables for MATLAB and for programs of vibration tests (UFF), and reports as PDF."""

from __future__ import annotations

import io
import keyword
import re
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from stochvi.mathematics.arrays import Vector
from stochvi.results.column_units import unit_of_column

if TYPE_CHECKING:
    import pandas as pd

LONGEST_NAME = 63
"""Largest number of characters of a variable of MATLAB."""

MOST_LABEL = 80
"""Largest number of characters of a line of text in a UFF file."""

EVEN = 1e-9
"""Relative deviation up to which steps of a column count as equal."""


def matlab_name(column: str, taken: Mapping[str, Any]) -> str:
    """A name that MATLAB takes for a variable, and that none of `taken` has.

    >>> matlab_name("left stop.speed (m/s)", {}), matlab_name("2nd", {}), matlab_name("x", {"x": 0})
    ('left_stop_speed_m_s', 'c2nd', 'x_2')
    """
    name = re.sub(r"\W+", "_", column, flags=re.ASCII).strip("_") or "column"
    if not name[0].isalpha() or keyword.iskeyword(name):
        name = f"c{name}"
    found, number = name[:LONGEST_NAME], 1
    while found in taken:
        number += 1
        found = f"{name[: LONGEST_NAME - 4]}_{number}"
    return found


def mat_of(frame: pd.DataFrame) -> bytes:
    """A table as a file of MATLAB 5: a column of numbers as a vector, one of text as a cell array,
    under the names of the columns."""
    from scipy.io import savemat

    variables: dict[str, Any] = {}
    for column in frame.columns:
        values = frame[column]
        numeric = np.issubdtype(values.to_numpy().dtype, np.number)
        array = values.to_numpy() if numeric else values.astype(str).to_numpy(dtype=object)
        variables[matlab_name(str(column), variables)] = array
    memory = io.BytesIO()
    stream: Any = memory  # its annotation knows names of files only
    savemat(stream, variables, long_field_names=True, oned_as="column")
    return memory.getvalue()


class Axis(NamedTuple):
    """The column of a table that a function of a UFF file has as its abscissa."""

    column: str
    unit: str
    type_code: int
    """Its quantity in a dataset 58: 17 time, 18 frequency."""
    function_code: int
    """The sort of function over it: 1 of time, 0 general."""


AXES = (
    Axis("time_s", "s", 17, 1),
    Axis("frequency_hz", "Hz", 18, 0),
    Axis("equipment_frequency_hz", "Hz", 18, 0),
)
"""Columns over which a table holds functions."""

DENSITY = 9
"""Function type of a spectral density in a dataset 58."""

ORDINATES = {
    "_m": ("m", 8), "_m_s": ("m/s", 11), "_m_s2": ("m/s^2", 12), "_N": ("N", 13),
}  # fmt: skip
"""Unit and quantity, in a dataset 58, of a column by the end of its name."""

QUANTITIES = dict(ORDINATES.values())
"""Quantity of a unit in a dataset 58."""


def functions_of(frame: pd.DataFrame) -> Iterator[dict[str, Any]]:
    """The functions of time or frequency that a table holds, as datasets 58 of a UFF file.

    Rows of the same text are a function; the time or frequency must rise in them. A column of
    numbers that ends in a known unit has it.
    """
    axis = next((each for each in AXES if each.column in frame.columns), None)
    if axis is None:
        return
    columns = [str(each) for each in frame.select_dtypes("number") if each != axis.column]
    texts = list(frame.select_dtypes(exclude="number"))
    groups = frame.groupby(texts, sort=False, dropna=False) if texts else [((), frame)]
    for words, rows in groups:
        x = rows[axis.column].to_numpy(float)
        if len(x) < 2 or not np.all(np.diff(x) > 0.0):
            continue
        said = dict(zip(texts, words, strict=True))
        unit = str(said.pop("unit", ""))
        for column in columns:
            values = rows[column].to_numpy(float)
            yield _dataset(axis, x, values, [*map(str, said.values()), column], unit)


def _dataset(axis: Axis, x: Vector, y: Vector, words: Sequence[str], unit: str) -> dict[str, Any]:
    """A function as a dataset 58; its unit is that of its column, or the one that is given."""
    steps = np.diff(x)
    even = bool(np.ptp(steps) <= EVEN * x[-1])
    label = " ".join(words)[:MOST_LABEL]
    end = max((end for end in ORDINATES if words[-1].endswith(end)), key=len, default="")
    known = unit or unit_of_column(words[-1]) or "NONE"
    unit, quantity = ORDINATES.get(end, (known, QUANTITIES.get(known, 0)))
    code = DENSITY if unit.endswith("/Hz") else axis.function_code
    return {
        "type": 58, "binary": 0, "func_type": code, "data": y, "x": x,
        "id1": label, "id2": "stochvi", "id3": "NONE", "id4": "NONE", "id5": "NONE",
        "rsp_ent_name": "NONE", "rsp_node": 1, "rsp_dir": 0,
        "ref_ent_name": "NONE", "ref_node": 0, "ref_dir": 0,
        "ord_data_type": 4, "abscissa_spacing": int(even),
        "abscissa_min": x[0], "abscissa_inc": float(steps.mean()) if even else 0.0,
        "abscissa_spec_data_type": axis.type_code, "abscissa_axis_units_lab": axis.unit,
        "ordinate_spec_data_type": quantity, "ordinate_axis_units_lab": unit,
        "orddenom_spec_data_type": 0, "orddenom_axis_units_lab": "NONE",
        "z_axis_spec_data_type": 0, "z_axis_axis_units_lab": "NONE", "z_axis_value": 0.0,
        "ver_num": 0, "load_case_id": 0, "num_pts": len(x),
    } | {
        f"{each}_{exponent}_unit_exp": 0
        for each in ("abscissa", "ordinate", "orddenom", "z_axis")
        for exponent in ("len", "force", "temp")
    }  # fmt: skip


def uff_of(frame: pd.DataFrame) -> bytes | None:
    """A table as a UFF file of datasets 58; None where it holds no function of time or
    frequency."""
    import pyuff

    datasets = list(functions_of(frame))
    if not datasets:
        return None
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "table.uff"
        pyuff.UFF(str(file)).write_sets(datasets, "overwrite")
        return file.read_bytes()


def pdf_of(html: str) -> bytes:
    """A page of a report as PDF, by WeasyPrint."""
    import weasyprint

    written: bytes = weasyprint.HTML(string=html).write_pdf()
    return written


def missing_for_pdf() -> str:
    """Why no report can be made as PDF here; empty where it can."""
    try:
        import weasyprint  # noqa: F401
    except ImportError:
        return 'needs WeasyPrint, which is not installed: pip install "stochvi[pdf]"'
    except OSError as error:  # it is installed, but a library of the system is not
        return f"needs Pango, a library of the system, for WeasyPrint: {error}"
    return ""
