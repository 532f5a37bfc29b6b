"""Answers on disk. Chapters: MATLAB, UFF and PDF; CSV, JSON and PNG; the console."""

from __future__ import annotations

import contextlib
import errno
import importlib.util
import io
import json
import keyword
import os
import re
import sys
import tempfile
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextvars import ContextVar
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, NamedTuple, TextIO

import numpy as np
import scipy
from rich.console import Console
from rich.text import Text

from stochvi.mathematics.numerics import Vector
from stochvi.notices import OutputWarning
from stochvi.results.base import DataFrame, in_chosen_units, unit_of_column
from stochvi.results.deadline import NEVER, Deadline, in_command
from stochvi.results.errors import Interrupted, NotConverged, TargetError, visible
from stochvi.results.files import write_whole
from stochvi.scenes.text_tables import as_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes


# ------------------------------------------------------------------------------
# Tables for MATLAB and for programs of vibration tests (UFF), and reports as PDF.
# ------------------------------------------------------------------------------


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


def mat_of(frame: DataFrame) -> bytes:
    """A table as a file of MATLAB 5: a column of numbers as a vector, one of text as a cell array,
    under the names of the columns."""
    variables: dict[str, Any] = {}
    for column in frame.columns:
        values = frame[column]
        numeric = np.issubdtype(values.to_numpy().dtype, np.number)
        array = values.to_numpy() if numeric else values.astype(str).to_numpy(dtype=object)
        variables[matlab_name(str(column), variables)] = array
    memory = io.BytesIO()
    stream: Any = memory  # its annotation knows names of files only
    scipy.io.savemat(stream, variables, long_field_names=True, oned_as="column")
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


def functions_of(frame: DataFrame) -> Iterator[dict[str, Any]]:
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


def uff_of(frame: DataFrame) -> bytes | None:
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


# ------------------------------------------------------------------------------
# Answers on disk: CSV tables, JSON documents, PNG pictures.
# ------------------------------------------------------------------------------


DOTS_PER_INCH = 150
"""Resolution of pictures, dots per inch."""


def to_json(document: Mapping[str, Any]) -> str:
    """The text of a JSON document; refuses NaN and infinity."""
    return json.dumps(document, indent=2, allow_nan=False, ensure_ascii=False)


def write_json(document: Mapping[str, Any], target: str) -> None:
    """Write a document to a file, or to standard output where `target` is "-".

    A link is followed; a pipe or a device is written to.
    """
    path, text = Path(target), to_json(document)
    if target == "-":
        _write_to_output(_for_stream(text, sys.stdout) + "\n")
    elif path.exists() and not path.is_file() and not path.is_dir():
        try:
            path.write_text(text + "\n", encoding="utf-8", newline="\n")
        except OSError as error:  # it would name no file
            raise OSError(error.errno, error.strerror or str(error), str(path)) from error
    else:
        write_text(text + "\n", Path(os.path.realpath(path)) if path.is_symlink() else path)


def _write_to_output(text: str) -> None:
    """Write to standard output; a reader that has closed it, as `head` does, is no error."""
    try:
        sys.stdout.write(text)
        sys.stdout.flush()
    except BrokenPipeError:
        silence(sys.stdout)


def silence(stream: IO[str]) -> None:
    """Let everything that is written to a stream from now on disappear."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, stream.fileno())
    os.close(nowhere)


def _for_stream(text: str, stream: TextIO) -> str:
    """The same JSON document in characters that the stream can encode, the others as \\u escapes.

    The standard output of Windows is often not UTF-8.
    """
    try:
        text.encode(stream.encoding or "ascii")
        return text
    except UnicodeEncodeError:
        return json.dumps(json.loads(text), indent=2)


def write_text(text: str, path: Path) -> None:
    """Write a file whole or not at all; it takes the place of a link, which is not followed."""
    write_bytes(text.encode(), path)


def write_bytes(data: bytes, path: Path) -> None:
    """Write a file whole or not at all; it takes the place of a link, which is not followed.

    Raises
    ------
    TargetError
        If the file is one of those that the current command reads, see `kept_inputs`.
    """
    for read in _inputs.get():
        if path.exists() and os.path.samefile(path, read):
            raise TargetError(
                f"{path} is read by this command, so it was not replaced by an answer; "
                "name another folder or file for the answer"
            )
    _make_folder(path.parent)
    write_whole(data, path, follow=False)


_inputs: ContextVar[Sequence[Path]] = ContextVar("inputs", default=())


@contextlib.contextmanager
def kept_inputs(files: Sequence[Path]) -> Iterator[None]:
    """Within this context no answer replaces one of these files, not even through a link."""
    before = _inputs.set([file for file in files if file.exists()])
    try:
        yield
    finally:
        _inputs.reset(before)


def _make_folder(path: Path) -> None:
    try:
        path.mkdir(parents=True, exist_ok=True)
    except (FileExistsError, NotADirectoryError):
        raise NotADirectoryError(errno.ENOTDIR, "Is a file, expected a folder", str(path)) from None


def folder_in(folder: Path, name: str) -> Path:
    """A folder inside a folder of answers; refused if it is a link, which could lead out of it."""
    found = folder / name
    if found.is_symlink():
        raise TargetError(
            f"{found} is a link, expected a folder of its own in {folder}; remove the link or name "
            "another folder"
        )
    return found


def write_table(frame: DataFrame, path: Path, units: Mapping[str, str] = {}) -> None:
    """A CSV table with all the digits of its numbers, in the units that a reader has chosen; no
    text in it is run as a formula. Other forms of the table are in SI units, and `units` are those
    of columns whose name does not tell."""
    with _heeding_the_command(path) if len(frame) > LONG_TABLE else contextlib.nullcontext():
        _write_table(frame, path, units)


LONG_TABLE = 20_000
"""Number of rows of a table from which its writing heeds the budget and Ctrl-C: a million take
seconds."""


@contextlib.contextmanager
def _heeding_the_command(path: Path) -> Iterator[None]:
    """End the writing of a file once the budget of the command, or Ctrl-C, is long over."""
    try:
        with in_command():
            yield
    except (NotConverged, Interrupted) as reason:
        told = str(reason).replace("there was an answer", f"{path.name} was written")
        raise type(reason)(told, None) from None


def _write_table(frame: DataFrame, path: Path, units: Mapping[str, str]) -> None:
    harmless = in_chosen_units(frame, units).copy()
    for name in harmless.select_dtypes(exclude="number").columns:
        cells = harmless[name]
        harmless[name] = [as_text(each) if isinstance(each, str) else each for each in cells]
    harmless.columns = [as_text(str(name)) for name in harmless.columns]
    write_text(harmless.to_csv(index=False, lineterminator="\n"), path)
    if wanted := _formats.get() & set(TABLE_FORMATS):
        for name in sorted(wanted):
            made = TABLE_FORMATS[name](frame)
            if made is not None:
                write_bytes(made, path.with_suffix(f".{name}"))
            _written.get().setdefault(name, []).append(made is not None)


TABLE_FORMATS = {"mat": mat_of, "uff": uff_of}
"""Forms in which tables are also written, and the functions that make them."""

FORMATS = (*TABLE_FORMATS, "pdf")
"""All forms in which answers are also written; "pdf" is that of reports."""

_formats: ContextVar[frozenset[str]] = ContextVar("formats", default=frozenset())
_written: ContextVar[dict[str, list[bool]]] = ContextVar("written", default={})  # noqa: B039


@contextlib.contextmanager
def also_written(formats: Iterable[str]) -> Iterator[None]:
    """Within this context tables and reports are also written in these of the `FORMATS`."""
    before, written = _formats.set(frozenset(formats)), _written.set({})
    try:
        yield
        for name, each in sorted(_written.get().items()):
            if not any(each):
                warnings.warn(
                    f"no table of this answer is a function of time or frequency, so that no "
                    f"{name} file was written; CSV and mat hold the tables",
                    OutputWarning, stacklevel=2,
                )  # fmt: skip
    finally:
        _formats.reset(before)
        _written.reset(written)


def write_report_page(html: str, path: Path) -> None:
    """Write the page of a report, and beside it the same as PDF where that is wanted."""
    write_text(html, path)
    if "pdf" not in _formats.get():
        return
    if not time_for_pictures():
        reason = "the PDF was not made, as no time was left; raise the budget"
        warnings.warn(reason, OutputWarning, stacklevel=2)
        return

    write_bytes(pdf_of(html), path.with_suffix(".pdf"))


def write_parquet(frame: DataFrame, path: Path) -> None:
    """The same table as Parquet, where pyarrow is installed."""
    if importlib.util.find_spec("pyarrow") is not None:
        memory = io.BytesIO()
        with _heeding_the_command(path):
            frame.to_parquet(memory, index=False)
            write_bytes(memory.getvalue(), path)


def write_picture(ax: Axes, path: Path) -> None:
    """Write the figure that holds these Axes as PNG, or as SVG where the file is named so.

    The figure is closed. An SVG has its letters as outlines, and the same bytes for the same
    figure.
    """
    import matplotlib.pyplot as plt

    from stochvi.views.axes import as_written

    memory, figure = io.BytesIO(), as_written(ax)
    try:
        if path.suffix == ".svg":
            with plt.rc_context({"svg.fonttype": "path", "svg.hashsalt": "stochvi"}):
                figure.savefig(memory, format="svg", metadata={"Date": None, "Creator": None})
        else:
            figure.savefig(memory, dpi=DOTS_PER_INCH, format="png")
    finally:
        plt.close(figure)
    write_bytes(memory.getvalue(), path)


_pictures_until: ContextVar[Deadline] = ContextVar("pictures_until", default=NEVER)


@contextlib.contextmanager
def pictures_until(deadline: Deadline) -> Iterator[None]:
    """Within this context pages leave out the pictures that are not begun by the deadline (see
    `time_for_pictures`); after Ctrl-C no picture is drawn at all."""
    before = _pictures_until.set(deadline)
    try:
        yield
    finally:
        _pictures_until.reset(before)


def time_for_pictures() -> bool:
    """Whether there is still time for one more picture of a page."""
    return not _pictures_until.get().passed()


def try_picture(draw: Callable[[], Axes], path: Path) -> None:
    """Write the picture that `draw` returns; one that cannot be drawn gives an OutputWarning and no
    error, so that the answer is kept. After Ctrl-C none is drawn."""
    if _pictures_until.get().interrupted:
        warnings.warn(f"{path.name} was not drawn, because of Ctrl-C", OutputWarning, stacklevel=2)
        return
    import matplotlib.pyplot as plt

    before = set(plt.get_fignums())
    try:
        write_picture(draw(), path)
    except (OSError, TargetError):
        raise
    except Exception as error:
        warnings.warn(
            f"{path.name} could not be drawn ({error}); the answer was kept without it",
            OutputWarning,
            stacklevel=2,
        )
    finally:
        for number in set(plt.get_fignums()) - before:
            plt.close(number)


# ------------------------------------------------------------------------------
# The console of the command line, which prints names from the user's files without markup.
# ------------------------------------------------------------------------------


class PlainConsole(Console):
    """A console that prints text as it is, and that outlives its reader.

    Brackets and colons in names are not markup, and control characters are shown as "\\x1b". The
    command goes on if its reader closes the stream, as `head` does."""

    def __init__(self, **how: Any) -> None:
        super().__init__(markup=False, emoji=False, **how)

    def render_str(self, text: str, **how: Any) -> Text:
        """The text in the style that is asked for, without control characters."""
        return super().render_str(visible(text), **how)

    def on_broken_pipe(self) -> None:
        """Print nothing from now on; rich would end the program."""
        self.quiet = True
        silence(self.file)
