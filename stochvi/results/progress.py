"""Progress of a calculation: the function that is called with it, and its display in notebooks."""

from __future__ import annotations

import html
import math
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import Lock
from typing import Any

Progress = Callable[[float, str], None]
"""A function that is called with the fraction done (0 to 1) and a sentence about the progress."""

FIRST_SECONDS = 1.0
"""Seconds after which a notebook shows the progress of a calculation: in a shorter calculation the
display would only blink."""

NEXT_SECONDS = 0.2
"""Seconds between two updates of the display in a notebook."""

_CELL = Lock()
"""Lock that is held while a notebook shows the progress of a calculation. Calculations that it
calls then do not show theirs."""


def part_of(progress: Progress | None, low: float, high: float, words: str = "") -> Progress | None:
    """Progress of a part of a calculation, whose fraction goes from `low` to `high` while that of
    the part goes from 0 to 1; its sentences follow some words.

    >>> part_of(lambda done, text: print(f"{done:.2f} {text}"), 0.5, 0.7, "row 2")(0.5, "8 paths")
    0.60 row 2, 8 paths
    """
    if progress is None:
        return None

    def tell(done: float, text: str) -> None:
        progress(low + (high - low) * done, ", ".join(each for each in (words, text) if each))

    return tell


class Pace:
    """Progress as a sentence, with the time left.

    The time left follows from the rate at which the fraction has grown since the first report. The
    first report may come late, and of a resumed run its fraction may already be large.

    Examples
    --------
    >>> Pace("size")(0.25, "first crossings")
    'size: 25 %, first crossings'
    """

    def __init__(self, title: str) -> None:
        self.title = title
        self.first: tuple[float, float] | None = None

    def left(self, done: float) -> float:
        """Seconds that are left if the fraction `done` (0 to 1) is done; infinite if not known."""
        now = time.monotonic()
        began, before = self.first = self.first or (now, done)
        return (1.0 - done) * (now - began) / (done - before) if done > before else math.inf

    def __call__(self, done: float, text: str) -> str:
        left = self.left(done)
        words = f", {left:.0f} s left" if math.isfinite(left) else ""
        return f"{self.title}: {100.0 * done:.0f} %, {text}{words}"


_announcers: list[Callable[[str], None]] = []
"""Displays of the calculations under way, outermost first."""


@contextmanager
def showing(progress: Progress | None) -> Iterator[Progress | None]:
    """Show there, too, what is announced within the `with` block; None changes nothing.

    Yields what the calculation calls instead: it keeps the fraction that was done last.
    """
    if progress is None:
        yield None
        return
    last = [0.0]

    def show(done: float, text: str) -> None:
        last[0] = done
        progress(done, text)

    def say(text: str) -> None:
        progress(last[0], text)

    _announcers.append(say)
    try:
        yield show
    finally:
        _announcers.remove(say)


def announce(text: str) -> None:
    """Show a sentence where the innermost calculation under way shows its progress."""
    if _announcers:
        _announcers[-1](text)


@contextmanager
def shown_in_notebooks(title: str, progress: Progress | None) -> Iterator[Progress | None]:
    """Progress of a calculation in a notebook, if its argument `progress` was left out.

    Outside notebooks the calculation stays silent, as programs expect it.
    """
    display = _display_of_notebook()
    if display is None or progress or not _CELL.acquire(blocking=False):
        yield progress
        return
    bar = _Bar(title, display)
    try:
        yield bar
    finally:
        bar.clear()
        _CELL.release()


def _display_of_notebook() -> Callable[..., Any] | None:
    """The function `display` of the notebook that runs this process, None where there is none."""
    ipython = sys.modules.get("IPython")
    shell = ipython.get_ipython() if ipython else None
    if getattr(shell, "kernel", None) is None:
        return None
    # a notebook shows HTML without further packages; bars of rich and tqdm need ipywidgets
    from IPython.display import display

    shown: Callable[..., Any] = display
    return shown


class _Bar:
    """A bar and a sentence in the output of a cell, removed when the calculation ends."""

    def __init__(self, title: str, display: Callable[..., Any]) -> None:
        self.pace = Pace(title)
        self.display = display
        self.next = time.monotonic() + FIRST_SECONDS
        self.handle: Any = None

    def __call__(self, done: float, text: str) -> None:
        sentence = self.pace(done, text)
        if time.monotonic() < self.next:
            return
        self.next = time.monotonic() + NEXT_SECONDS
        page = f'<progress max="1" value="{done:.3f}"></progress> {html.escape(sentence)}'
        self._show({"text/html": page, "text/plain": sentence})

    def clear(self) -> None:
        """Remove the bar, so that the saved notebook does not hold it."""
        if self.handle:
            self._show({"text/html": "", "text/plain": ""})

    def _show(self, forms: dict[str, str]) -> None:
        if self.handle:
            self.handle.update(forms, raw=True)
        else:
            self.handle = self.display(forms, raw=True, display_id=True)
