"""Sizes beyond which something is refused before memory is taken for it."""

from __future__ import annotations

MOST_NUMBERS = 2**25
"""Largest number of floats that one calculation keeps at a time: 256 MB."""

MOST_RECORDED = 2**28
"""Largest number of floats in records that are kept for a moment: 2 GB."""

MOST_SPACED = 10**6
"""Largest number of values that are put between two ends: more than any calculation takes."""

MOST_LINES = 20
"""Largest number of lines of a message."""


def check_size(name: str, number: float, most: float, remedy: str) -> None:
    """Raise ValueError if there is more of something than there may be.

    >>> check_size("--points", 10**8, MOST_SPACED, "ask for fewer")
    Traceback (most recent call last):
    ValueError: --points must be at most 1000000, got 100000000; ask for fewer
    """
    if number > most:
        raise ValueError(f"{name} must be at most {most:.7g}, got {number:.9g}; {remedy}")


def spaced(name: str, first: float, last: float, number: int) -> list[float]:
    """So many evenly spaced numbers, both ends included.

    >>> spaced("--points", 0.0, 1.0, 3)
    [0.0, 0.5, 1.0]
    """
    import numpy as np  # every command loads this file, also for its help

    check_size(name, number, MOST_SPACED, "ask for fewer")
    found: list[float] = np.linspace(first, last, number).tolist()
    return found


MOST_LETTERS = 2000
"""Largest number of letters in a line of a message."""


def short_line(line: str) -> str:
    """A line of a message, without the middle of a long one: its end is the remedy.

    >>> len(short_line(70_000 * "9")), short_line(70_000 * "9")[1000:1022]
    (2022, ' (68000 letters more) ')
    """
    left_out = len(line) - MOST_LETTERS
    if left_out <= 0:
        return line
    half = MOST_LETTERS // 2
    return f"{line[:half]} ({left_out} letters more) {line[-half:]}"


def few_lines(lines: list[str]) -> str:
    """The lines of a message, or the first of them and how many are left out; of long lines the
    ends.

    >>> few_lines(["one"] * 30).splitlines()[-1]
    'and 11 more like these'
    """
    if len(lines) > MOST_LINES:
        lines = [*lines[: MOST_LINES - 1], f"and {len(lines) - MOST_LINES + 1} more like these"]
    return "\n".join(map(short_line, lines))
