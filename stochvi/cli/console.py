"""The console of the command line, which prints names from the user's files without markup."""

from __future__ import annotations

from typing import Any

from rich.console import Console
from rich.text import Text

from stochvi.cli.control_characters import visible
from stochvi.views.files import silence


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
