"""Where a command writes: the console, progress, notes; and where it has work done."""

from __future__ import annotations

import contextlib
import os
import sys
import time
import warnings
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from rich.console import Console

Report = Callable[[float, str], None]
"""A function of the fraction of the work that is done and of the name of the current step."""

LINE_SECONDS = 2.0
"""Seconds between two lines of progress, where standard error is not a terminal."""

PLAIN_WIDTH = 100
"""Columns of a table that does not go to a terminal, unless the variable COLUMNS says otherwise."""


def console_for(json_file: str | None) -> Console:
    """Standard output, or standard error where the JSON document has the output to itself."""
    from rich.console import Console

    stream = sys.stderr if json_file == "-" else sys.stdout
    plain = int(os.environ.get("COLUMNS") or PLAIN_WIDTH)
    return Console(file=stream, width=None if stream.isatty() else max(plain, 80))


@contextlib.contextmanager
def progress_bar(quiet: bool, title: str, console: Console | None = None) -> Iterator[Report]:
    """A bar on a terminal, elsewhere a line every few seconds."""
    from rich.console import Console
    from rich.progress import Progress

    if quiet:
        yield lambda done, text: None
        return
    if not sys.stderr.isatty():
        yield _progress_in_lines(title)
        return
    terminal = console if console and console.is_terminal else Console(stderr=True)
    with Progress(console=terminal, transient=True) as bar:
        task = bar.add_task(title, total=1.0)
        yield lambda done, text: bar.update(task, completed=done, description=f"{title}: {text}")


def _progress_in_lines(title: str) -> Report:
    """Progress in plain lines, the first after some seconds.

    The time left follows from the rate at which the fraction has grown since the first report.
    """
    start = last = time.monotonic()
    first: float | None = None

    def line(done: float, text: str) -> None:
        nonlocal first, last
        first, now = done if first is None else first, time.monotonic()
        if now - last < LINE_SECONDS:
            return
        last = now
        grown = done - first
        left = f", {(1.0 - done) * (now - start) / grown:.0f} s left" if grown > 0.0 else ""
        click.echo(f"{title}: {100.0 * done:.0f} %, {text}{left}", err=True)

    return line


@contextlib.contextmanager
def notes_of_warnings() -> Iterator[None]:
    """Print the warnings of the code inside as notes on standard error, each on a line."""
    with warnings.catch_warnings(record=True) as seen:
        warnings.simplefilter("always", UserWarning)
        try:
            yield
        finally:
            for warning in seen:
                click.echo(f"note: {warning.message}", err=True)


@contextlib.contextmanager
def executor_at(address: str | None) -> Iterator[Executor | None]:
    """The executor of the Dask cluster at an address, None where there is no address."""
    if address is None:
        yield None
        return
    from stochvi.methods.monte_carlo.clusters import dask_executor

    with dask_executor(address) as executor:
        yield executor
