"""The output of commands (console, progress, notes), and the cluster that does their work."""

from __future__ import annotations

import contextlib
import os
import sys
import time
import warnings
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, TextIO

import click

from stochvi.cli.control_characters import visible
from stochvi.results.progress import Pace, Progress

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from rich.console import Console

LINE_SECONDS = 2.0
"""Time between two lines of progress if standard error is not a terminal, s."""

PLAIN_WIDTH, NARROWEST, WIDEST = 100, 80, 10_000
"""Width, in characters, of a table that does not go to a terminal, unless the variable COLUMNS
states another. The others are the smallest and largest value of that variable."""


def console_for(json_file: str | None) -> Console:
    """Standard output, or standard error where the JSON document has the output to itself."""
    return new_console(sys.stderr if json_file == "-" else sys.stdout)


def new_console(stream: TextIO) -> Console:
    """A console on this stream, as wide as its terminal or the variable COLUMNS says."""
    from stochvi.cli.console import PlainConsole

    unknown = None if stream.isatty() else PLAIN_WIDTH
    # rich reads COLUMNS itself, and fails if it is "²"
    environment = {
        name: os.environ[name] for name in os.environ if name not in ("COLUMNS", "LINES")
    }
    return PlainConsole(file=stream, width=_columns() or unknown, _environ=environment)


def _columns() -> int | None:
    """The variable COLUMNS within its limits, None where it is not a plain number."""
    text = os.environ.get("COLUMNS", "")
    if not (text.isascii() and text.isdigit()):
        return None
    return max(NARROWEST, min(int(text[:9]), WIDEST))


@contextlib.contextmanager
def progress_bar(quiet: bool, title: str, console: Console | None = None) -> Iterator[Progress]:
    """A bar on a terminal, elsewhere a line every few seconds."""
    from rich import progress
    from rich.markup import escape

    if quiet:
        yield lambda done, text: None
        return
    if not sys.stderr.isatty():
        yield _progress_in_lines(title)
        return
    terminal = console if console and console.is_terminal else new_console(sys.stderr)
    with progress.Progress(console=terminal, transient=True) as bar:
        task = bar.add_task(title, total=1.0)
        yield lambda done, text: bar.update(
            task, completed=done, description=escape(visible(f"{title}: {text}"))
        )


def _progress_in_lines(title: str) -> Progress:
    """Progress in plain lines, the first after some seconds, and none twice in a row."""
    pace = Pace(title)
    last, said = time.monotonic(), ""

    def line(done: float, text: str) -> None:
        nonlocal last, said
        sentence, now = pace(done, text), time.monotonic()
        if sentence != said and now - last >= LINE_SECONDS:
            last, said = now, sentence
            echo(sentence)

    return line


def echo(line: str) -> None:
    """Print a line on standard error, if that stream is still open."""
    with contextlib.suppress(BrokenPipeError):
        click.echo(visible(line), err=True)


@contextlib.contextmanager
def notes_of_warnings() -> Iterator[None]:
    """Print the warnings of the code inside as notes on standard error, each on a line.

    Warnings of libraries, such as an overflow in numpy, are for programmers. They are left out
    unless Python was started with -W or PYTHONWARNINGS.
    """

    def note(message: Warning | str, category: type[Warning], *where: Any, **more: Any) -> None:
        if issubclass(category, UserWarning) and "missing from font" not in str(message):
            echo(f"note: {message}")

    with warnings.catch_warnings():
        if not sys.warnoptions:
            warnings.simplefilter("always", UserWarning)
            warnings.showwarning = note
        yield


@contextlib.contextmanager
def executor_at(address: str | None) -> Iterator[Executor | None]:
    """The executor of the Dask cluster at an address, None where there is no address."""
    if address is None:
        yield None
        return
    from stochvi.methods.monte_carlo.clusters import dask_executor

    with dask_executor(address) as executor:
        yield executor
