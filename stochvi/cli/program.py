"""The program `stochvi`: its group of commands, and how an error becomes a sentence and a code."""

from __future__ import annotations

import errno
import io
import os
import shlex
import sys
from typing import Any, NoReturn

import click

from stochvi.cli.output import echo, notes_of_warnings

FAILED = 1
"""Exit code if a check failed, an accuracy was not reached, or Ctrl-C ended the command."""

BAD_INPUT = 2
"""Exit code if the input is wrong, or the method does not apply to the scene."""

FULL = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO}
"""Errors of a disk, which are none of the input: it is full, or fails."""

COMMAND_LINE = "stochvi.command_line"
"""Key of the command line in the data (`meta`) that the contexts of click share."""


class Commands(click.Group):
    """A group that turns every expected error into one sentence on stderr and its exit code."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(self.commands)

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Keep the words of the command line, which reports state."""
        ctx.meta[COMMAND_LINE] = shlex.join(["stochvi", *args])
        return super().parse_args(ctx, args)

    def invoke(self, ctx: click.Context) -> Any:
        _prepare_streams()
        try:
            with notes_of_warnings():
                found = super().invoke(ctx)
            _end_output()
            return found
        except (Exception, KeyboardInterrupt) as error:
            _stop_for(error)


def _stop_for(error: BaseException) -> NoReturn:
    """End with the sentence and the exit code of an error; raise it again if it has none."""
    from stochvi.results.errors import NotConverged, StochviError, beyond_arithmetic, reason_of

    if isinstance(error, KeyboardInterrupt):
        stop(str(error) or "interrupted by Ctrl-C; nothing was kept", FAILED)
    if isinstance(error, NotConverged):
        stop(str(error), FAILED)
    if isinstance(error, ArithmeticError) and not isinstance(error, StochviError):
        stop(f"the scene {beyond_arithmetic(error)}", BAD_INPUT)
    if isinstance(error, StochviError | ValueError):
        stop(str(error), BAD_INPUT)
    if isinstance(error, MemoryError):
        stop(f"not enough memory ({error}); reduce paths or samples", BAD_INPUT)
    if isinstance(error, OSError):
        named = f"{error.filename}: " if error.filename else ""
        if error.errno in FULL:
            stop(f"{named}{reason_of(error)}; the answer was found, but this was not written; make "
                 "room, or name another place", FAILED)  # fmt: skip
        stop(f"{named}{reason_of(error)}", BAD_INPUT)
    raise error


def _prepare_streams() -> None:
    """Make standard output and error accept any character, and replace streams that are closed."""
    sys.stdout, sys.stderr = (
        open(os.devnull, "w", encoding="utf-8") if stream is None else stream  # noqa: SIM115
        for stream in (sys.stdout, sys.stderr)
    )
    for stream in (sys.stdout, sys.stderr):
        # a terminal of Windows may not know a character of a title: it gets a "?" then
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")


def _end_output() -> None:
    """Flush standard output, unless its reader has closed it."""
    from stochvi.views.files import silence

    try:
        sys.stdout.flush()
    except BrokenPipeError:
        silence(sys.stdout)


def stop(message: str, code: int) -> NoReturn:
    """End the program with a message on stderr and an exit code."""
    from stochvi.results.sizes import few_lines

    for line in few_lines(message.splitlines()).splitlines():
        echo(f"stochvi: {line.strip()}")
    sys.exit(code)


@click.group(cls=Commands, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="stochvi")
def main() -> None:
    """Stochastic vibration of systems that hit their stops.

    A scene file says what moves, where it hits and what shakes it. Each command answers one
    question about it. Start with: stochvi new scene.toml, then stochvi explain scene.toml.
    """
