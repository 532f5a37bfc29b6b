"""Answers on disk: CSV tables, JSON documents, PNG pictures."""

from __future__ import annotations

import contextlib
import errno
import importlib.util
import io
import json
import os
import sys
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextvars import ContextVar
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, TextIO

from stochvi.results.atomic_files import write_whole
from stochvi.results.column_units import in_chosen_units
from stochvi.results.deadline import NEVER, Deadline, in_command
from stochvi.results.errors import Interrupted, NotConverged, TargetError
from stochvi.scenes.text_cells import as_text

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes

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


def write_table(frame: pd.DataFrame, path: Path, units: Mapping[str, str] = {}) -> None:
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


def _write_table(frame: pd.DataFrame, path: Path, units: Mapping[str, str]) -> None:
    harmless = in_chosen_units(frame, units).copy()
    for name in harmless.select_dtypes(exclude="number").columns:
        cells = harmless[name]
        harmless[name] = [as_text(each) if isinstance(each, str) else each for each in cells]
    harmless.columns = [as_text(str(name)) for name in harmless.columns]
    write_text(harmless.to_csv(index=False, lineterminator="\n"), path)
    if wanted := _formats.get() & set(TABLE_FORMATS):
        from stochvi.views import other_formats

        for name in sorted(wanted):
            made = getattr(other_formats, TABLE_FORMATS[name])(frame)
            if made is not None:
                write_bytes(made, path.with_suffix(f".{name}"))
            _written.get().setdefault(name, []).append(made is not None)


TABLE_FORMATS = {"mat": "mat_of", "uff": "uff_of"}
"""Forms in which tables are also written, and the functions of `other_formats` that make them."""

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
                    f"{name} file was written; CSV and mat hold the tables", stacklevel=2,
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
        warnings.warn("the PDF was not made, as no time was left; raise the budget", stacklevel=2)
        return
    from stochvi.views.other_formats import pdf_of

    write_bytes(pdf_of(html), path.with_suffix(".pdf"))


def write_parquet(frame: pd.DataFrame, path: Path) -> None:
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
    """Write the picture that `draw` returns; a picture that cannot be drawn gives a UserWarning and
    no error, so that the answer is kept. After Ctrl-C none is drawn."""
    if _pictures_until.get().interrupted:
        warnings.warn(f"{path.name} was not drawn, because of Ctrl-C", stacklevel=2)
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
            stacklevel=2,
        )
    finally:
        for number in set(plt.get_fignums()) - before:
            plt.close(number)


def write_clearance(curve: pd.DataFrame, predicted: pd.DataFrame, title: str, folder: Path) -> None:
    """Write the impact rate against clearance as `clearance.csv` and `clearance.png`.

    `curve` comes from `clearance_curve`, `predicted` from `predicted_curve`.
    """
    from stochvi.views.clearance import draw_clearance

    write_table(curve, folder / "clearance.csv")
    try_picture(lambda: draw_clearance(curve, predicted, title), folder / "clearance.png")
