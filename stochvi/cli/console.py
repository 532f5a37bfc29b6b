"""The console of the command line, which shows the names of a user as they are."""

from __future__ import annotations

from typing import Any

from rich.console import Console
from rich.text import Text

from stochvi.cli.output import visible
from stochvi.views.files import silence


class PlainConsole(Console):
    """A console that shows words letter by letter, and that goes on without its reader.

    Brackets and colons in names are no markup, control characters are shown as "\\x1b", and a
    reader that closes the stream, as `head` does, does not end the command.
    """

    def __init__(self, **how: Any) -> None:
        super().__init__(markup=False, emoji=False, **how)

    def render_str(self, text: str, **how: Any) -> Text:
        """The text in the style that is asked for, without control characters."""
        return super().render_str(visible(text), **how)

    def on_broken_pipe(self) -> None:
        """Print nothing from now on; rich would end the program."""
        self.quiet = True
        silence(self.file)
