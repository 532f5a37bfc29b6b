"""The drawing of a scene: mass, base, spring, stops, and the lengths between them.

Positions count from the unloaded spring, x = 0. Clearances count from the static equilibrium, where
the mass rests under gravity and constant loads. The drawing shows both, and is not to scale: its
levels keep their order at equal distances.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from stochvi.mathematics.shown_units import LENGTH
from stochvi.scenes.structures import Isolator, Oscillator
from stochvi.scenes.structures.rigid_body import RigidBody
from stochvi.views.axes import axes_or_new
from stochvi.views.colours import COLOURS, DRAWING
from stochvi.views.words import four_digits

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from stochvi.scenes.scene import ImpactPair, Scene

STEP = 1.25
"""Distance between neighbouring levels of a drawing, in its units."""

TONGUE, PAD = 0.09, 0.16
"""Half the thickness of the tongue that meets the stops, and the thickness of a stop."""

MOST_GAPS = 12
"""Largest number of gaps that a drawing lists; more would not fit a page."""


class Level(NamedTuple):
    """A height of the drawing: its position (m from the unloaded spring) and its words."""

    position: float
    words: str


class Words(NamedTuple):
    """How a drawing writes lengths: `length` of a number in m, `place` of a key and its number."""

    length: Callable[[str, float], str]
    place: Callable[[str, float], str]


NUMBERS = Words(
    length=lambda name, metres: f"{name}\n{_length(metres)}",
    place=lambda key, metres: f"{key} = {_length(metres)}",
)
"""Lengths with the numbers of the scene."""

SYMBOLS = Words(length=lambda name, metres: name, place=lambda key, metres: key)
"""Lengths by their names alone."""


def draw_problem(
    scene: Scene, rests: Mapping[str, float], *, symbols: bool = False, ax: Axes | None = None
) -> Axes:
    """Draw what moves, where it rests, and its stops.

    Parameters
    ----------
    scene
        The scene.
    rests
        Where each gap rests under gravity and constant loads, m from the unloaded spring, by the
        name of its pair; 0 for a pair that is missing.
    symbols
        Write the names of lengths without their numbers, and show the mass at a moment of its
        motion.
    ax
        Axes of one mass or of a list of gaps; by default those of a new figure.

    Returns
    -------
    matplotlib.axes.Axes
        The axes of the drawing.
    """
    expanded = scene.expanded
    if isinstance(expanded.structure, Oscillator) and len(expanded.impact_pairs) < 2:
        return _draw_mass(expanded, rests, symbols, ax)
    if isinstance(expanded.structure, RigidBody):
        from stochvi.views.box import draw_box

        return draw_box(expanded)
    return draw_gaps(expanded.impact_pairs, rests, ax)


def write_problem(scene: Scene, rests: Mapping[str, float], folder: Path) -> None:
    """Write the drawing as `scene.svg` into a folder, and the gaps of a rigid box as `gaps.svg`."""
    from stochvi.views.files import try_picture

    try_picture(lambda: draw_problem(scene, rests), folder / "scene.svg")
    if isinstance(scene.structure, RigidBody) and scene.impact_pairs:
        try_picture(lambda: draw_gaps(scene.impact_pairs, rests), folder / "gaps.svg")


# One mass ---------------------------------------------------------------------------------


def _draw_mass(scene: Scene, rests: Mapping[str, float], symbols: bool, ax: Axes | None) -> Axes:
    """A mass on its spring and damper, with its stops on a frame, and the axis of x beside it."""
    words = SYMBOLS if symbols else NUMBERS
    pair = scene.impact_pairs[0] if scene.impact_pairs else None
    rest = rests.get(pair.name, 0.0) if pair else next(iter(rests.values()), 0.0)
    levels = _levels(pair, rest, words)
    heights = {each.position: STEP * k for k, each in enumerate(levels)}
    bottom, top = -2.6, STEP * (len(levels) - 1) + 0.9
    ax = axes_or_new(ax, (7.6, 0.62 * (top - bottom) + 0.9))
    seat = _seat(pair, rest)
    ink = DRAWING["ink"]
    _draw_base(ax, scene, bottom, symbols)
    _draw_carrier(ax, scene, heights[seat], bottom, symbols)
    if rest:
        sign = 1.0 if rest > 0.0 else -1.0
        edge = heights[seat] + 0.55 * sign
        ax.annotate("", (-0.35, edge + 0.2 * sign), (-0.35, edge - 1.1 * sign),
                    arrowprops={"arrowstyle": "->", "color": ink, "linewidth": 1.6})  # fmt: skip
        ax.text(-0.45, heights[seat], "load", ha="right", va="center", fontsize="small")
    if pair is not None:
        _draw_stops(ax, pair, heights, bottom)
    moment = _moment(pair, heights, rest) if symbols else None
    if moment is not None:
        _draw_moment(ax, pair, heights, moment)
    # the axis of x, with a thin line from every level to its words
    ax.annotate("", (8.3, top), (8.3, bottom + 0.9), arrowprops={"arrowstyle": "->", "color": ink})
    ax.text(8.3, top + 0.08, "x", ha="center", va="bottom", style="italic")
    for each in levels:
        y = heights[each.position]
        ax.plot([4.4, 8.4], [y, y], color=DRAWING["line"], linewidth=0.6, zorder=0)
        ax.plot([8.22, 8.38], [y, y], color=ink, linewidth=1.0)
        ax.text(8.55, y, each.words, va="center", fontsize="small")
    _draw_lengths(ax, pair, heights, rest, words)
    ax.set_xlim(-1.2, 13.6)
    ax.set_ylim(bottom - 0.75, top + 0.5)
    ax.set_axis_off()
    return ax


def _levels(pair: ImpactPair | None, rest: float, words: Words) -> list[Level]:
    """The levels of a drawing in rising order, each position once."""
    found: dict[float, str] = {0.0: "x = 0: unloaded spring"}
    if rest:
        place = f"{words.place('x', rest)}: " if words is NUMBERS else ""
        found[rest] = f"{place}static equilibrium,\nwhere the mass rests under its load"
    else:
        found[0.0] += ",\nhere also the static equilibrium"
    for side in ("lower", "upper"):
        if pair is None or getattr(pair, side) is None:
            continue
        position: float = getattr(pair, side)
        law = "its law says what an impact does"
        if words is NUMBERS:
            law = _short(pair.law_of(side).phrase())
        text = f"{words.place(side, position)}: {side} stop,\n{law}"
        found[position] = f"{text}\n{found[position]}" if position in found else text
    return [Level(place, found[place]) for place in sorted(found)]


def _seat(pair: ImpactPair | None, rest: float) -> float:
    """Where the mass is drawn: at its static equilibrium, or on the stop that keeps it from it."""
    if pair is None:
        return rest
    lower = -np.inf if pair.lower is None else pair.lower
    upper = np.inf if pair.upper is None else pair.upper
    return float(np.clip(rest, lower, upper))


def _draw_base(ax: Axes, scene: Scene, bottom: float, symbols: bool) -> None:
    """The base, hatched, with what shakes it below."""
    from matplotlib.patches import Rectangle

    ink, moving = DRAWING["ink"], isinstance(scene.structure, Isolator)
    ax.add_patch(Rectangle((0.0, bottom), 5.6, 0.3, facecolor=DRAWING["base"], edgecolor=ink))
    for x in np.arange(0.15, 5.6, 0.35):
        ax.plot([x, x - 0.2], [bottom, bottom - 0.2], color=ink, linewidth=0.6)
    if moving:
        ax.annotate(
            "", (-0.55, bottom + 0.75), (-0.55, bottom - 0.45),
            arrowprops={"arrowstyle": "<->", "color": COLOURS["simulate"], "linewidth": 1.6},
        )  # fmt: skip
    ax.text(0.0, bottom - 0.32, "excitation" if symbols else _drives_in_words(scene), va="top",
            fontsize="small", color=COLOURS["simulate"])  # fmt: skip


def _drives_in_words(scene: Scene) -> str:
    """Excitations of the scene, without its constant loads: the effects that are no stops."""
    on_base: list[str] = []
    other: list[str] = []
    for each in scene.effects():
        if each.endswith(" stop lower") or each.endswith(" stop upper") or "load" in each:
            continue
        whole, on, _ = each.rpartition(" on base")
        (on_base if on else other).append(whole if on else each)
    moved = [f"base moves: {', '.join(on_base)}"] if on_base else []
    return "; ".join([*moved, *other])


def _draw_carrier(ax: Axes, scene: Scene, height: float, bottom: float, symbols: bool) -> None:
    """The mass with its tongue, its spring and its damper."""
    from matplotlib.patches import Rectangle

    ink, floor, mass = DRAWING["ink"], bottom + 0.3, height - 0.55
    ax.add_patch(
        Rectangle((0.5, mass), 2.6, 1.1, facecolor=DRAWING["mass"], edgecolor=ink, zorder=3)
    )
    ax.add_patch(
        Rectangle((3.1, height - TONGUE), 1.7, 2 * TONGUE, facecolor=DRAWING["mass"],
                  edgecolor=ink, zorder=3)
    )  # fmt: skip
    ax.text(1.8, height, "mass" if symbols else _mass_in_words(scene), ha="center",
            va="center", zorder=4, fontsize="small")  # fmt: skip
    turns = np.linspace(floor + 0.25, mass - 0.25, 12)
    sides = 1.1 + 0.22 * np.where(np.arange(12) % 2, 1.0, -1.0)
    ax.plot([1.1, 1.1, *sides, 1.1, 1.1], [floor, floor + 0.2, *turns, mass - 0.2, mass],
            color=ink, linewidth=1.2)  # fmt: skip
    middle = 0.5 * (floor + mass)
    ax.plot([2.4, 2.4], [floor, middle - 0.15], color=ink, linewidth=1.2)
    ax.plot([2.1, 2.1, 2.7, 2.7], [middle + 0.25, middle - 0.15, middle - 0.15, middle + 0.25],
            color=ink, linewidth=1.2)  # fmt: skip
    ax.plot([2.4, 2.4], [middle + 0.1, mass], color=ink, linewidth=1.2)
    ax.plot([2.18, 2.62], [middle + 0.1, middle + 0.1], color=ink, linewidth=2.0)
    known = ("frequency_hz", "zeta or Q") if symbols else _spring_in_words(scene)
    for x, text, side in zip((0.72, 2.85), known, ("right", "left"), strict=True):
        ax.text(x, middle, text, ha=side, va="center", fontsize="small")


def _mass_in_words(scene: Scene) -> str:
    mass = getattr(scene.structure, "mass", None)
    return "mass" if mass is None else f"{mass:.4g} kg"


def _spring_in_words(scene: Scene) -> tuple[str, str]:
    """Words beside the spring and beside the damper."""
    structure = scene.structure
    if not isinstance(structure, Oscillator):
        return "spring", "damper"
    if structure.frequency_hz is not None:
        return f"{structure.frequency_hz:g} Hz", _damper_in_words(structure)
    times = f"{structure.in_parallel} x " if structure.in_parallel > 1 else ""
    spring = f"{times}{structure.stiffness:g} N/m"
    if structure.damping is None:
        return spring, _damper_in_words(structure)
    return spring, f"{times}{structure.damping:g} N s/m"


def _damper_in_words(structure: Oscillator) -> str:
    """The damping of a natural frequency, by the key that states it."""
    if structure.loss_factor is not None:
        return f"loss factor {structure.loss_factor:g}"
    return f"zeta {structure.zeta:g}" if structure.Q is None else f"Q {structure.Q:g}"


def _draw_stops(ax: Axes, pair: ImpactPair, heights: Mapping[float, float], bottom: float) -> None:
    """The frame that the base carries, with an arm for each stop."""
    from matplotlib.patches import Rectangle

    ink, top = DRAWING["ink"], bottom + 0.3
    for side, _ in pair.stops():
        sign = -1.0 if side == "lower" else 1.0
        face = heights[getattr(pair, side)] + sign * TONGUE
        arm = face + sign * PAD
        ax.add_patch(
            Rectangle((3.9, min(face, arm)), 1.0, PAD, facecolor=COLOURS["stop"], edgecolor=ink,
                      linewidth=0.6)
        )  # fmt: skip
        ax.add_patch(
            Rectangle((3.8, min(arm, arm + sign * 0.14)), 1.6, 0.14, facecolor=DRAWING["base"],
                      edgecolor=ink, linewidth=0.6)
        )  # fmt: skip
        top = max(top, arm + 0.14)
    ax.add_patch(
        Rectangle((5.3, bottom + 0.3), 0.24, top - bottom - 0.3, facecolor=DRAWING["base"],
                  edgecolor=ink, linewidth=0.6, zorder=1)
    )  # fmt: skip


def _short(phrase: str) -> str:
    """A law without its remarks.

    >>> _short("rigid, restitution 0.5: speeds of impact but no peak acceleration")
    'rigid, restitution 0.5'
    """
    return phrase.partition(":")[0].partition(" (")[0]


def _moment(pair: ImpactPair | None, heights: Mapping[float, float], rest: float) -> float | None:
    """A height between the static equilibrium and the upper stop, to show the mass in motion."""
    if pair is None or pair.upper is None:
        return None
    return 0.45 * heights[rest] + 0.55 * heights[pair.upper]


def _draw_moment(
    ax: Axes, pair: ImpactPair | None, heights: Mapping[float, float], height: float
) -> None:
    """The tongue at a moment of the motion, and the gap that is left there."""
    from matplotlib.patches import Rectangle

    assert pair is not None and pair.upper is not None
    ax.add_patch(
        Rectangle((3.1, height - TONGUE), 1.7, 2 * TONGUE, facecolor="none", linestyle="--",
                  edgecolor=COLOURS["simulate"], zorder=2)
    )  # fmt: skip
    ax.text(3.2, height + 0.13, "x(t)", color=COLOURS["simulate"], fontsize="small", va="bottom")
    _arrow(ax, 4.35, height + TONGUE, heights[pair.upper] + TONGUE, COLOURS["simulate"])
    ax.text(4.42, 0.5 * (height + heights[pair.upper]) + TONGUE, "gap", va="center",
            fontsize="small", color=COLOURS["simulate"])  # fmt: skip


def _draw_lengths(
    ax: Axes, pair: ImpactPair | None, heights: Mapping[float, float], rest: float, words: Words
) -> None:
    """Arrows of the clearances, from the static equilibrium to each stop, and of the sag."""
    colour = DRAWING["length"]
    for side in ("lower", "upper"):
        place = None if pair is None else getattr(pair, side)
        if place is None:
            continue
        distance = place - rest if side == "upper" else rest - place
        _arrow(ax, 5.95, heights[rest], heights[place], colour)
        name = "clearance" if distance >= 0.0 else "preload of"
        ax.text(6.05, 0.5 * (heights[rest] + heights[place]),
                words.length(name, abs(distance)),
                va="center", fontsize="small", color=colour)  # fmt: skip
    if rest:
        _arrow(ax, 8.0, heights[0.0], heights[rest], DRAWING["ink"])
        ax.text(7.92, 0.5 * (heights[0.0] + heights[rest]), words.length("sag", abs(rest)),
                ha="right", va="center", fontsize="small")  # fmt: skip


def _arrow(ax: Axes, x: float, start: float, end: float, colour: str) -> None:
    ax.annotate(
        "", (x, start), (x, end),
        arrowprops={"arrowstyle": "<->", "color": colour, "shrinkA": 0, "shrinkB": 0},
    )  # fmt: skip


def _length(metres: float) -> str:
    """A length, without zeros at its end.

    >>> _length(0.004), _length(-0.0017249)
    ('4 mm', '-1.725 mm')
    """
    digits = four_digits(LENGTH(metres))
    return f"{digits.rstrip('0').rstrip('.') if '.' in digits else digits} {LENGTH}"


# Gaps of several coordinates --------------------------------------------------------------


def draw_gaps(pairs: Any, rests: Mapping[str, float], ax: Axes | None = None) -> Axes:
    """Draw a line for each gap: its stops as hatched blocks, the unloaded position, the
    equilibrium.

    Each line has a scale of its own, with the numbers in millimetres.
    """
    shown = list(pairs)[:MOST_GAPS]
    ax = axes_or_new(ax, (5.6, 0.9 + 0.5 * max(len(shown), 1)))
    for row, pair in enumerate(shown):
        _draw_gap(ax, pair, rests.get(pair.name, 0.0), -float(row))
    left = len(list(pairs)) - len(shown)
    ax.text(-0.36, -len(shown) + 0.35, "circle: unloaded position; dot: static equilibrium"
            + (f"; {left} more gaps" if left else ""), fontsize="small", va="top")  # fmt: skip
    ax.set_xlim(-1.0, 1.35)
    ax.set_ylim(-len(shown) - 0.1, 0.6)
    ax.set_axis_off()
    return ax


def _draw_gap(ax: Axes, pair: ImpactPair, rest: float, row: float) -> None:
    """One gap, from its lower to its upper stop."""
    known = [0.0, rest, *(each for each in (pair.lower, pair.upper) if each is not None)]
    low, high = min(known), max(known)
    span = high - low or 1.0

    def place(x: float) -> float:
        return 0.12 + 0.76 * (x - low) / span

    ax.plot([0.02, 0.98], [row, row], color=DRAWING["line"], linewidth=1.0, zorder=0)
    ax.text(-0.36, row, pair.name, ha="right", va="center", fontsize="small")
    for side, sign in (("lower", -1.0), ("upper", 1.0)):
        position = getattr(pair, side)
        if position is None:
            continue
        x = place(position)
        ax.fill_between([x, x + 0.04 * sign], row - 0.22, row + 0.22, color=COLOURS["stop"])
        ax.text(x + 0.05 * sign, row, f"{side} {_length(position)}", va="center",
                fontsize="x-small", ha="right" if sign < 0.0 else "left", color=DRAWING["ink"],
                bbox={"color": "white", "pad": 0.5})  # fmt: skip
        ax.text(0.5 * (x + place(rest)), row + 0.1, _length(abs(position - rest)), ha="center",
                va="bottom", fontsize="x-small", color=DRAWING["length"])  # fmt: skip
    ax.plot(place(0.0), row, "o", mfc="white", mec=DRAWING["ink"], markersize=7)
    ax.plot(place(rest), row, "o", color=DRAWING["ink"], markersize=3.5)
