"""Answers on disk: CSV tables, JSON documents, PNG pictures."""

from __future__ import annotations

import errno
import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

from stochvi.results.atomic_files import write_whole

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes


def to_json(document: Mapping[str, Any]) -> str:
    """The text of a JSON document; refuses NaN and infinity."""
    return json.dumps(document, indent=2, allow_nan=False, ensure_ascii=False)


def write_json(document: Mapping[str, Any], target: str) -> None:
    """Write a document to a file, or to standard output where `target` is "-"."""
    if target == "-":
        sys.stdout.write(_for_stream(to_json(document), sys.stdout) + "\n")
    else:
        write_text(to_json(document) + "\n", Path(target))


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
    """Write a file whole or not at all; a link is followed, a pipe or device is written to."""
    if path.exists() and not path.is_file() and not path.is_dir():
        path.write_text(text, encoding="utf-8", newline="\n")
        return
    # the folder of what a link names, and otherwise the one that was asked for
    _make_folder(path.resolve().parent if path.is_symlink() else path.parent)
    write_whole(text.encode(), path)


def _make_folder(path: Path) -> None:
    try:
        path.mkdir(parents=True, exist_ok=True)
    except (FileExistsError, NotADirectoryError):
        raise NotADirectoryError(errno.ENOTDIR, "Is a file, expected a folder", str(path)) from None


def write_table(frame: pd.DataFrame, path: Path) -> None:
    """A CSV table with all the digits of its numbers."""
    write_text(frame.to_csv(index=False, lineterminator="\n"), path)


def write_picture(ax: Axes, path: Path) -> None:
    """A PNG of the figure that holds these Axes; the figure is closed."""
    import matplotlib.pyplot as plt

    _make_folder(path.parent)
    figure = ax.get_figure(root=True)
    assert figure is not None
    figure.savefig(path, dpi=150)
    plt.close(figure)


def write_clearance(curve: pd.DataFrame, predicted: pd.DataFrame, title: str, folder: Path) -> None:
    """Hit rate against clearance as `clearance.csv` and `clearance.png`.

    `curve` comes from `clearance_curve`, `predicted` from `predicted_curve`.
    """
    from stochvi.views.clearance import draw_clearance

    write_table(curve, folder / "clearance.csv")
    write_picture(draw_clearance(curve, predicted, title), folder / "clearance.png")
