"""The program `stochvi`: its group of commands, and how an error becomes a sentence and a code."""

from __future__ import annotations

import io
import sys
from typing import Any, NoReturn

import click

FAILED = 1
"""Exit code if a check failed, an accuracy was not reached, or Ctrl-C ended the command."""

BAD_INPUT = 2
"""Exit code if the input is wrong, or the method does not apply to the scene."""


class Commands(click.Group):
    """A group that turns every expected error into one sentence on stderr and its exit code."""

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
    """End the program with a message on stderr and an exit code."""
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
