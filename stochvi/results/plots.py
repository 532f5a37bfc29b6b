"""The way from an answer to its picture.

Answers lie below the views that draw them, and do not know these. The root of the package, which
knows both rooms, registers who draws.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Draw = Callable[[Any, "Axes | None"], "Axes"]
"""Draws an answer in Axes, or in those of a new figure, and returns the Axes."""

_drawers: list[Draw] = []


def register(draw: Draw) -> None:
    """Let a function draw all answers from now on."""
    _drawers[:] = [draw]


def drawn(answer: Any, ax: Axes | None) -> Axes:
    """Draw an answer with the function that was registered last."""
    return _drawers[-1](answer, ax)
