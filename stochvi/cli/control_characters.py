"""Control characters in names and files, which would act on a terminal."""

from __future__ import annotations

CONTROLS = {
    number: f"\\x{number:02x}"
    for number in (*range(0x20), *range(0x7F, 0xA0))
    if chr(number) not in "\n\t"
}
"""Control characters by their numbers, and how they are shown."""


def visible(text: str) -> str:
    """The text with control characters as escapes, which do nothing to a terminal.

    >>> visible("red \\x1b[31m")
    'red \\\\x1b[31m'
    """
    return text.translate(CONTROLS)
