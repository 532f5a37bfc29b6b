"""What the commands share: the group, common options, how answers and errors leave."""

from __future__ import annotations

import contextlib
import io
import os
import sys
import time
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import click

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from rich.console import Console

    from stochvi.results.response import Response

FAILED, BAD_INPUT = 1, 2
"""Exit codes."""

BUDGET = 60.0
"""Seconds for what is to reach an accuracy, if nothing is said."""

LINE_SECONDS = 2.0
"""Between lines of progress that are not written to a terminal."""

PLAIN_WIDTH = 100
"""Columns of a table that is not written to a terminal, unless COLUMNS says otherwise."""


class Commands(click.Group):
    """Turns every expected error into one sentence on stderr and its exit code."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(self.commands)

    def invoke(self, ctx: click.Context) -> Any:
        from stochvi.results.errors import NotConverged, StochviError

        for stream in (sys.stdout, sys.stderr):
            # a terminal of Windows may not know a character of a title: it gets a "?" then
            if isinstance(stream, io.TextIOWrapper):
                stream.reconfigure(errors="replace")
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt:
            stop("interrupted by Ctrl-C; nothing was kept", FAILED)
        except NotConverged as error:
            stop(str(error), FAILED)
        except (StochviError, ValueError, ArithmeticError) as error:
            stop(str(error), BAD_INPUT)
        except OSError as error:
            stop(f"{error.filename or ''} {(error.strerror or str(error)).lower()}", BAD_INPUT)


def stop(message: str, code: int) -> NoReturn:
    for line in message.splitlines():
        click.echo(f"stochvi: {line.strip()}", err=True)
    sys.exit(code)


@click.group(cls=Commands, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="stochvi")
def main() -> None:
    """Stochastic vibration of systems that hit their stops.

    A scene file says what moves, where it hits and what shakes it; each command answers one
    question about it. Start with: stochvi new scene.toml, then stochvi check scene.toml.
    """


class Folder(click.Path):
    """Name of a folder: an empty one would be the current folder."""

    def convert(self, value: Any, param: Any, ctx: Any) -> Any:
        if value == "":
            raise ValueError("--out must name a folder, got ''")
        return super().convert(value, param, ctx)


def options(*names: str) -> Callable[[Any], Any]:
    """The options that several commands share."""
    known = {
        "json": click.option(
            "--json", "json_file", metavar="FILE|-", help="Write the answer as JSON (- : stdout)."
        ),
        "out": click.option(
            "--out", type=Folder(path_type=Path), metavar="DIR",
            help="Write tables and pictures here.",
        ),
        "seed": click.option("--seed", type=int, default=0, help="Same seed, same digits."),
        "threads": click.option("--threads", type=int, help="Default: all cores."),
        "budget": click.option(
            "--budget", type=float, default=60.0, show_default=True, metavar="SECONDS",
            help="Give up (exit 1) if the accuracy takes longer.",
        ),
        "open budget": click.option(
            "--budget", type=float, metavar="SECONDS",
            help=f"Give up (exit 1) after this [{BUDGET:g}; none with --paths].",
        ),
        "quiet": click.option("--quiet", is_flag=True, help="No tables, no progress."),
    }  # fmt: skip

    def decorate(command: Any) -> Any:
        for name in reversed(names):
            command = known[name](command)
        return command

    return decorate


def numbers(option: str, text: str) -> list[float]:
    """A list of numbers with commas between them."""
    try:
        return [float(word) for word in text.split(",")]
    except ValueError:
        raise ValueError(f"{option} must be numbers with commas, got {text!r}") from None


def finish(response: Response, json_file: str | None, out: Path | None, quiet: bool) -> None:
    """Print, and write what was asked for."""
    from stochvi.views.files import to_json, write_json, write_table, write_text
    from stochvi.views.tables import print_response

    if not quiet:
        print_response(console_for(json_file), response)
    if json_file is not None:
        write_json(response.to_dict(), json_file)
    if out is not None:
        write_table(response.to_frame(), out / "response.csv")
        write_text(to_json(response.to_dict()) + "\n", out / "response.json")


def console_for(json_file: str | None) -> Console:
    """Standard output, or standard error where the JSON document has the output to itself."""
    from rich.console import Console

    stream = sys.stderr if json_file == "-" else sys.stdout
    plain = int(os.environ.get("COLUMNS") or PLAIN_WIDTH)
    return Console(file=stream, width=None if stream.isatty() else max(plain, 80))


@contextlib.contextmanager
def progress_bar(
    quiet: bool, title: str, console: Console | None = None
) -> Iterator[Callable[[float, str], None]]:
    """A bar on a terminal, elsewhere a line every few seconds."""
    from rich.console import Console
    from rich.progress import Progress

    if quiet:
        yield lambda done, text: None
        return
    if not sys.stderr.isatty():
        yield _lines(title)
        return
    terminal = console if console and console.is_terminal else Console(stderr=True)
    with Progress(console=terminal, transient=True) as bar:
        task = bar.add_task(title, total=1.0)
        yield lambda done, text: bar.update(task, completed=done, description=f"{title}: {text}")


def _lines(title: str) -> Callable[[float, str], None]:
    """Progress in plain lines, the first after some seconds; the time left is by the rate at which
    the fraction has grown since the first report."""
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
    """What is warned of in here, as notes on standard error, each a line."""
    with warnings.catch_warnings(record=True) as seen:
        warnings.simplefilter("always", UserWarning)
        try:
            yield
        finally:
            for warning in seen:
                click.echo(f"note: {warning.message}", err=True)


@contextlib.contextmanager
def executor_at(address: str | None) -> Iterator[Executor | None]:
    """Executor of a Dask cluster, None where there is no address."""
    if address is None:
        yield None
        return
    from stochvi.methods.monte_carlo.clusters import dask_executor

    with dask_executor(address) as executor:
        yield executor
