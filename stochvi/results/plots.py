"""The way from an answer to its picture, and to what is simulated for the picture alone.

Answers lie below the views that draw them, and below what simulates, and do not know these. The
root of the package, which knows all rooms, registers who draws and who simulates.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Draw = Callable[[Any, "Axes | None", str], "Axes"]
"""Draws an answer in Axes, or in those of a new figure, in a style, and returns the Axes."""

_drawers: list[Draw] = []
_simulated: list[Callable[[Any], Mapping[str, Any]]] = []


def register(draw: Draw, densities: Callable[[Any], Mapping[str, Any]]) -> None:
    """Let a function draw all answers from now on, and one find densities of simulations."""
    _drawers[:], _simulated[:] = [draw], [densities]


def densities_of(answer: Any) -> Mapping[str, Any]:
    """Densities of the motions of a simulation, by the function that was registered last."""
    return _simulated[-1](answer)


def drawn(answer: Any, ax: Axes | None, style: str) -> Axes:
    """Draw an answer with the function that was registered last."""
    return _drawers[-1](answer, ax, style)
