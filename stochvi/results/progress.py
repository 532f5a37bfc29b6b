"""Progress of a calculation: the function that is called with it, and its display in notebooks."""

from __future__ import annotations

import functools
import html
import math
import sys
import time
from collections.abc import Callable
from threading import Lock
from typing import Any, ParamSpec, TypeVar

Progress = Callable[[float, str], None]
"""A function that is called with the fraction done (0 to 1) and a sentence about the progress."""

P = ParamSpec("P")
T = TypeVar("T")

FIRST_SECONDS = 1.0
"""Seconds after which a notebook shows the progress of a calculation: in a shorter calculation the
display would only blink."""

NEXT_SECONDS = 0.2
"""Seconds between two changes of what a notebook shows."""

_CELL = Lock()
"""Lock that is held while a notebook shows the progress of a calculation, so that the calculations
which this one calls do not show theirs."""


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


def shown_in_notebooks(function: Callable[P, T]) -> Callable[P, T]:
    """Let a function show its progress in a notebook, if its argument `progress` is left out.

    Outside notebooks the function stays silent, as programs expect it.
    """

    @functools.wraps(function)
    def run(*args: P.args, **kwargs: P.kwargs) -> T:
        display = _display_of_notebook()
        if display is None or kwargs.get("progress") or not _CELL.acquire(blocking=False):
            return function(*args, **kwargs)
        bar = _Bar(function.__name__, display)
        kwargs["progress"] = bar
        try:
            return function(*args, **kwargs)
        finally:
            bar.clear()
            _CELL.release()

    return run


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
