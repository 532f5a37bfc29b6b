"""Drawings of scenes. Chapters: a rigid box; bars, beams and plates; the mass between its stops."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import combinations, product
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, cast

import numpy as np

from stochvi.mathematics.numerics import Matrix, Vector
from stochvi.mathematics.units import LENGTH, ShownQuantity
from stochvi.results.base import DataFrame
from stochvi.scenes.structures import Isolator, Oscillator
from stochvi.scenes.structures.modes import Span
from stochvi.scenes.structures.rigid_body import AXES, RigidBody
from stochvi.views.axes import (
    COLOURS,
    DRAWING,
    OWNERS,
    Chart,
    Scale,
    add_title,
    axes_or_new,
    length_of,
)
from stochvi.views.tables import four_digits

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from stochvi.isolators.sizing.answer import Sizing
    from stochvi.methods.replay.recorded_motion import ReplayAt
    from stochvi.results.base import Response
    from stochvi.scenes.scene import ImpactPair, Scene
    from stochvi.statistics.histories import History


# ------------------------------------------------------------------------------
# A rigid box: its modes and snubbers in tables, and its picture.
# ------------------------------------------------------------------------------


SMALLEST_CHANCE = 1e-6
"""Probability of an impact below which all snubbers have the same colour."""


def plot_box(sizing: Sizing) -> Axes:
    """Draw the box. The colour of a snubber is the probability that it alone is hit with the stops
    of the scene; several at one place take the largest."""
    assert sizing.box is not None
    table = sizing.box.pairs
    return draw_box(sizing.scene, dict(zip(table["pair"], table["chance_as_given"], strict=True)))


def draw_box(scene: Scene, chances: Mapping[str, float] | None = None) -> Axes:
    """Draw a rigid box from outside: mounts, centre of mass, and snubbers with their directions.

    Parameters
    ----------
    scene
        A scene of a rigid body.
    probabilities
        Probability of an impact by the name of the pair, which colours the snubbers; without it
        they have one colour.
    """
    import matplotlib.pyplot as plt

    body = scene.structure
    assert isinstance(body, RigidBody)
    pairs = [pair for pair in scene.impact_pairs if pair.at and pair.direction]
    mounts = np.array([mount.at for mount in body.mounts])
    places = np.array([pair.at for pair in pairs]).reshape(-1, 3)
    directions = np.array([pair.direction for pair in pairs]).reshape(-1, 3)
    directions = directions / np.linalg.norm(directions, axis=1)[:, None]
    figure = plt.figure(figsize=(6.8, 5.2), layout="constrained")
    ax: Any = figure.add_subplot(projection="3d")
    _draw_edges(ax, np.concatenate([mounts, places]))
    ax.scatter(*mounts.T, marker="s", s=40, color=COLOURS["stop"], label="mounts", depthshade=False)
    ax.scatter(0.0, 0.0, 0.0, marker="+", s=80, color="black", label="centre of mass")
    corners: dict[tuple[float, ...], list[str]] = {}
    for pair, place in zip(pairs, places.tolist(), strict=True):
        corners.setdefault(tuple(place), []).append(pair.name)
    length = 0.15 * float(np.ptp(np.concatenate([mounts, places]), axis=0).max())
    _draw_snubbers(ax, corners, chances)
    ax.quiver(*places.T, *(length * directions).T, color="black", linewidth=1.0)
    # the labels below their corners, and room for them at the sides
    for corner, names in corners.items():
        below = corner - np.array([0.0, 0.0, 0.5 * length])
        ax.text(*below, _together(names), fontsize="small", ha="center", va="top",
                bbox={"color": "white", "alpha": 0.7, "pad": 0.5})  # fmt: skip
    for get, put in ((ax.get_xlim, ax.set_xlim), (ax.get_ylim, ax.set_ylim)):
        low, high = get()
        put(low - length, high + length)
    for axis in AXES:
        getattr(ax, f"set_{axis}label")(f"{axis} (m)")
    ax.set_aspect("equal")
    ax.locator_params(nbins=4)
    ax.grid(visible=False)
    ax.legend(frameon=False, fontsize="small", loc="upper left")
    found: Axes = ax
    return found


def _draw_snubbers(
    ax: Any, corners: Mapping[tuple[float, ...], list[str]], chances: Mapping[str, float] | None
) -> None:
    """Draw a dot at each place of snubbers, coloured by the largest of their probabilities."""
    if not corners:
        return
    style = {"s": 90, "edgecolor": "black", "depthshade": False, "label": "snubbers"}
    places = np.array(list(corners)).T
    if chances is None:
        ax.scatter(*places, color=COLOURS["linearise:motion"], **style)
        return
    from matplotlib.colors import LogNorm

    risk = np.array([max(chances[name] for name in names) for names in corners.values()])
    seen = ax.scatter(
        *places, c=np.clip(risk, SMALLEST_CHANCE, 1.0), cmap="inferno_r",
        norm=LogNorm(SMALLEST_CHANCE, 1.0), **style,
    )  # fmt: skip
    ax.get_figure().colorbar(
        seen, ax=ax, shrink=0.7, label="probability of an impact, the largest of the snubbers there"
    )


def _together(names: list[str]) -> str:
    """Names of snubbers at one place; words with which all of them begin are written once.

    >>> _together(["corner 1 x", "corner 1 y"]), _together(["left", "right"])
    ('corner 1 x, y', 'left, right')
    """
    parts = [name.rpartition(" ") for name in names]
    if len({head for head, _, _ in parts}) > 1:
        return ", ".join(names)
    return "".join(parts[0][:2]) + ", ".join(tail for _, _, tail in parts)


def _draw_edges(ax: Any, places: np.ndarray) -> None:
    """The edges of the smallest box along the axes that holds all places."""
    ends = list(zip(places.min(axis=0), places.max(axis=0), strict=True))
    for one, other in combinations(product(*ends), 2):
        if sum(a != b for a, b in zip(one, other, strict=True)) == 1:
            ax.plot(*zip(one, other, strict=True), color="0.6", linewidth=0.8)


# ------------------------------------------------------------------------------
# Bars, beams and plates: their shape at the moments of impacts, and a map of their rms.
# ------------------------------------------------------------------------------


PLACES = 101
"""Number of places along a bar or a beam at which its shape is drawn."""

PLACES_ACROSS = 41
"""Number of places along each side of a plate."""

MOST_SHAPES = 60
"""Largest number of impacts whose shapes are drawn: the fastest ones."""

MAPPED = {
    "rms_without_stops_m": ("without stops", "--", OWNERS[5]),
    "rms_with_stops_m": ("with stops, linearised", "-", COLOURS["linearise:closure"]),
}
"""What a map shows: columns of `rms_along`, with words, line and colour."""

CLAMP = 0.025
"""Width of the block of a clamped end, as a share of the length."""


class Motion(NamedTuple):
    """Motion of the modes (samples, modes), m; first sample in each of the fastest impacts, the
    fastest first; moment (s) and speed (m/s) of that one."""

    modes: Matrix
    touches: Vector
    moment: float
    speed: float


def has_shape(found: History | ReplayAt, scene: Scene) -> bool:
    """Whether the structure is a bar, beam or plate that had an impact, and samples were kept."""
    kept = getattr(found, "histories", found) is not None
    return kept and has_places(scene) and len(found.impacts) > 0


def has_places(scene: Scene) -> bool:
    """Whether the structure has a shape at all its places: a bar, a beam or a plate."""
    return isinstance(scene.expanded.structure, Span)


def draw_shapes(found: History | ReplayAt, scene: Scene, title: str = "") -> Axes:
    """Deflections at the moments of the fastest impacts, with stops and rms, by modes; see
    `has_shape`."""
    structure = scene.expanded.structure
    motion = _motion_of(found, scene)
    assert isinstance(structure, Span)
    if len(structure.sides) > 1:
        return _draw_plate(motion, scene, structure, title)
    return _draw_span(motion, scene, structure, title)


def _modal(samples: DataFrame, scene: Scene, quantity: str) -> Matrix:
    """Displacements of the modes at the samples (samples, modes), m."""
    if quantity in samples:
        return np.asarray(samples[[quantity]].to_numpy() / _share_of_gap(scene))
    names = [f"{name}.{quantity}" for name in scene.expanded.structure.coordinates]
    return np.asarray(samples[names].to_numpy())


def _share_of_gap(scene: Scene) -> float:
    """Displacement of the gap per unit of the one mode: an answer on one mode is that of its
    gap."""
    whole = scene.expanded
    return float(whole.row_of(whole.impact_pairs[0])[0])


def _motion_of(found: History | ReplayAt, scene: Scene) -> Motion:
    """The motion of a realisation, or of a replay whose samples were kept."""
    quantity, moment, speed = "displacement_m", "time_s", "speed_m_s"
    if (replayed := getattr(found, "histories", None)) is not None:
        samples, quantity, moment, speed = replayed.to_frame(), "displacement", "time", "speed"
    else:
        samples = cast("History", found).samples
    modes = _modal(samples, scene, quantity)
    fastest = found.impacts.sort_values(speed, ascending=False)[:MOST_SHAPES]
    touches = np.minimum(np.searchsorted(samples[moment], fastest[moment]), len(modes) - 1)
    return Motion(modes, touches, float(fastest[moment].iloc[0]), float(fastest[speed].iloc[0]))


def _draw_span(motion: Motion, scene: Scene, span: Span, title: str) -> Axes:
    """Deflection across a beam, or displacement along a bar, over the distance from its end."""
    along, x = _shapes(span, PLACES), np.linspace(0.0, span.length, PLACES)
    touching = motion.modes[motion.touches] @ along.T
    moments = motion.modes.T @ motion.modes / len(motion.modes)
    rms = np.sqrt(np.einsum("pi,ij,pj->p", along, moments, along))
    stops = [abs(place) for *_, place in _stops_along(scene, span)]
    chart = _along(span, span.moves, max(float(np.abs(touching).max()), float(rms.max()), *stops))
    for shape in touching[1:]:
        chart.curve(x, shape, None, OWNERS[0], alpha=0.2, linewidth=0.8)
    fastest = "at impacts, the fastest in bold"
    chart.curve(x, touching[0], fastest, OWNERS[0], linewidth=2.0)
    chart.curve(x, rms, "rms of this realisation", OWNERS[5], "--")
    return _finish_span(chart, scene, span, title or "one realisation")


def _of_size(length: float) -> ShownQuantity:
    """Lengths along a structure of this length: below 1 m in mm."""
    return length_of(0.2 * length)


def _along(span: Span, words: str, reach: float) -> Chart:
    """A chart over the distance from the first end of a bar or a beam."""
    distance = Scale("distance from the first end", _of_size(span.length))
    return Chart.on(None, distance, Scale(words, length_of(reach)), (7.2, 4.2))


def _shapes(span: Span, count: int) -> Matrix:
    """Shapes of the modes (places, modes) at `with_places(count)`."""
    shapes = span.with_places(count).table.shapes
    return np.array([shape for name, shape in shapes.items() if name.startswith("place ")])


def _stops_along(scene: Scene, span: Span) -> list[tuple[float, str, float]]:
    """Share of the length, side and position (m) of each stop that one point alone can meet."""
    stops = _stops_on_points(scene.expanded.impact_pairs, scene)
    return [(span.places_of_points[point], side, place) for point, side, place in stops]


def _finish_span(chart: Chart, scene: Scene, span: Span, title: str) -> Axes:
    """Draw the stops and supports of a bar or beam, and name what is drawn."""
    for at, side, place in _stops_along(scene, span):
        caret = 7 if side == "upper" else 6
        there = at * span.length
        chart.points(there, place, "stops", "stop", "", marker=caret, markersize=12, ls="none")
    _draw_supports(chart.ax, span, chart.x.quantity(span.length))
    return add_title(chart.finish(3), title)


def draw_map(table: DataFrame, found: Response, scene: Scene) -> Axes:
    """The rms displacement over a structure, from `rms_along`, with its stops and without.

    An answer `found` of another method stands beside it as dots at the named points.
    """
    structure, title = scene.structure, scene.title or found.method
    assert isinstance(structure, Span)
    shown = {column: look for column, look in MAPPED.items() if column in table}
    if len(structure.sides) > 1:
        across = table["x_m"].nunique()
        maps = {shown[name][0]: table[name].to_numpy().reshape(across, -1) for name in shown}
        return _draw_plates(maps, scene, structure, f"rms {structure.moves}", title)
    largest = float(table["rms_without_stops_m"].max())
    chart = _along(structure, f"rms {structure.moves}", largest)
    for column, (words, style, colour) in shown.items():
        chart.curve(table["distance_m"], table[column], words, colour, style)
    for point, place in structure.places_of_points.items():
        each = found.coordinates.get(point)
        if each is None or not each.displacement_std or found.method.startswith("linearise"):
            continue
        low, high = each.displacement_std.interval()
        at, words = float(cast("float", place)) * structure.length, f"{found.method}, 95 %"
        chart.points(at, float(each.displacement_std), words, low=low, high=high, zorder=3)
    return _finish_span(chart, scene, structure, title)


def _draw_plates(
    maps: Mapping[str, Matrix], scene: Scene, plate: Span, words: str, title: str
) -> Axes:
    """Contours of lengths over a plate, a panel for each; in blue and red where they have signs."""
    import matplotlib.pyplot as plt
    from matplotlib.ticker import MaxNLocator

    size, top = _of_size(max(plate.sides)), max(float(np.abs(m).max()) for m in maps.values())
    length, signs = length_of(top), any(bool((m < 0.0).any()) for m in maps.values())
    figure, axes = plt.subplots(
        1, len(maps), figsize=(1.8 + 4.6 * len(maps), 4.2), layout="constrained", squeeze=False
    )
    ends = length((-top if signs else 0.0, top))
    levels = MaxNLocator(15, symmetric=signs).tick_values(*ends)
    for ax, (name, values) in zip(axes[0], maps.items(), strict=True):
        x, y = (
            np.linspace(0.0, size(side), count)
            for side, count in zip(plate.sides, values.shape, strict=True)
        )
        colours = "RdBu_r" if signs else "viridis"
        drawn = ax.contourf(x, y, length(values).T, levels=levels, cmap=colours)
        _draw_points_of_plate(ax, scene, plate, size.shown.si)
        ax.set(xlabel=size.heading("length"), ylabel=size.heading("width"), aspect="equal")
        ax.set_title(name, fontsize="medium")
    figure.colorbar(drawn, ax=axes, label=length.heading(words), format="{x:.2g}")
    return add_title(axes[0, 0], title)


def _draw_supports(ax: Axes, span: Span, length: float) -> None:
    """Blocks at clamped ends, and triangles at pinned ones."""
    ends = {"cantilever": "c ", "clamped": "cc", "pinned": "pp", "clamped-pinned": "cp"}
    for at, kind in zip((0.0, length), ends.get(span.support, "  "), strict=True):
        if kind == "c":
            outwards = -CLAMP * length if at == 0.0 else CLAMP * length
            ax.axvspan(*sorted((at, at + outwards)), color="#8c8c8c", linewidth=0)
        elif kind == "p":
            ax.plot([at], [0.0], marker=6, markersize=12, color="#8c8c8c")
    ax.set_xlim(-2.0 * CLAMP * length, (1.0 + 2.0 * CLAMP) * length)


def _stops_on_points(pairs: Sequence[ImpactPair], scene: Scene) -> list[tuple[str, str, float]]:
    """Point, side and position (m) of each stop that one point alone can meet."""
    found = []
    for pair in pairs:
        weights = scene.expanded.weights_of(pair)
        ((point, weight), *others) = weights.items()
        if others or weight != 1.0 or point.startswith("mode "):
            continue
        sides = (("lower", pair.lower), ("upper", pair.upper))
        found += [(point, side, place) for side, place in sides if place is not None]
    return found


def _draw_plate(motion: Motion, scene: Scene, plate: Span, title: str) -> Axes:
    """Deflection of a plate at its fastest impact, with its points, those at stops marked."""
    shapes = _shapes(plate, PLACES_ACROSS)
    deflection = (shapes @ motion.modes[motion.touches[0]]).reshape(PLACES_ACROSS, -1)
    heading = f"at the fastest impact, {motion.speed:.3g} m/s after {motion.moment:.3g} s"
    return _draw_plates({heading: deflection}, scene, plate, "deflection", title)


def _draw_points_of_plate(ax: Axes, scene: Scene, plate: Span, metres: float) -> None:
    """The named points of a plate, with those at stops marked."""
    stopped = {point for point, _, _ in _stops_on_points(scene.expanded.impact_pairs, scene)}
    for point, (u, v) in plate.places_of_points.items():
        place = (u * plate.sides[0] / metres, v * plate.sides[1] / metres)
        ax.plot(*place, "^" if point in stopped else "o", color="k")
        ax.annotate(
            f"{point}{', at stops' if point in stopped else ''}", place, (8, 0),
            textcoords="offset points", va="center", fontsize="small",
            bbox={"color": "white", "alpha": 0.8, "boxstyle": "round,pad=0.1"},
        )  # fmt: skip


# ------------------------------------------------------------------------------
# The drawing of a scene: mass, base, spring, stops, and the lengths between them.
#
# Positions count from the unloaded spring, x = 0. Clearances count from the static equilibrium,
# where the mass rests under gravity and constant loads. The drawing shows both, and is not to
# scale: its levels keep their order at equal distances.
# ------------------------------------------------------------------------------


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
        _say(ax, -0.45, heights[seat], "load", ha="right")
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
        _say(ax, 8.55, y, each.words)
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


def _block(
    ax: Axes, x: float, y: float, width: float, height: float, fill: str, **more: Any
) -> None:
    """A rectangle from its lower left corner."""
    from matplotlib.patches import Rectangle

    look = {"facecolor": DRAWING.get(fill, fill), "edgecolor": DRAWING["ink"]} | more
    ax.add_patch(Rectangle((x, y), width, height, **look))


def _say(ax: Axes, x: float, y: float, words: str, colour: str = "ink", **more: Any) -> None:
    """Words at a place."""
    look = {"va": "center", "fontsize": "small", "color": DRAWING.get(colour, colour)} | more
    ax.text(x, y, words, **look)


def _draw_base(ax: Axes, scene: Scene, bottom: float, symbols: bool) -> None:
    """The base, hatched, with what shakes it below."""
    _block(ax, 0.0, bottom, 5.6, 0.3, "base")
    for x in np.arange(0.15, 5.6, 0.35):
        ax.plot([x, x - 0.2], [bottom, bottom - 0.2], color=DRAWING["ink"], linewidth=0.6)
    if isinstance(scene.structure, Isolator):
        _arrow(ax, -0.55, bottom + 0.75, bottom - 0.45, COLOURS["simulate"], linewidth=1.6)
    words = "excitation" if symbols else _drives_in_words(scene)
    _say(ax, 0.0, bottom - 0.32, words, COLOURS["simulate"], va="top")


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
    ink, floor, mass = DRAWING["ink"], bottom + 0.3, height - 0.55
    _block(ax, 0.5, mass, 2.6, 1.1, "mass", zorder=3)
    _block(ax, 3.1, height - TONGUE, 1.7, 2 * TONGUE, "mass", zorder=3)
    words = "mass" if symbols else _mass_in_words(scene)
    _say(ax, 1.8, height, words, ha="center", zorder=4)
    turns = np.linspace(floor + 0.25, mass - 0.25, 12)
    sides = 1.1 + 0.22 * np.where(np.arange(12) % 2, 1.0, -1.0)
    middle = 0.5 * (floor + mass)
    low, high = middle - 0.15, middle + 0.25
    for x, y, width in (
        ([1.1, 1.1, *sides, 1.1, 1.1], [floor, floor + 0.2, *turns, mass - 0.2, mass], 1.2),
        ([2.4, 2.4], [floor, low], 1.2),
        ([2.1, 2.1, 2.7, 2.7], [high, low, low, high], 1.2),
        ([2.4, 2.4], [middle + 0.1, mass], 1.2),
        ([2.18, 2.62], [middle + 0.1, middle + 0.1], 2.0),
    ):
        ax.plot(x, y, color=ink, linewidth=width)
    known = ("frequency_hz", "zeta or Q") if symbols else _spring_in_words(scene)
    for place, text, side in zip((0.72, 2.85), known, ("right", "left"), strict=True):
        _say(ax, place, middle, text, ha=side)


def _mass_in_words(scene: Scene) -> str:
    mass = getattr(scene.structure, "mass", None)
    return "mass" if mass is None else f"{mass:.4g} kg"


def _spring_in_words(scene: Scene) -> tuple[str, str]:
    """Words beside the spring and beside the damper."""
    structure = scene.structure
    if not isinstance(structure, Oscillator):
        return "spring", "damper"
    spring, damper = mount_in_words(structure)
    if structure.in_parallel == 1:
        return spring, damper
    times = f"{structure.in_parallel} x "
    return times + spring, damper if structure.damping is None else times + damper


def mount_in_words(structure: Oscillator) -> tuple[str, str]:
    """The spring and the damper of one mount, each by the key that states it."""
    if structure.frequency_hz is not None:
        spring = f"{structure.frequency_hz:g} Hz"
    else:
        spring = f"{structure.stiffness:g} N/m"
    for value, words in (
        (structure.damping, "{:g} N s/m"),
        (structure.loss_factor, "loss factor {:g}"),
        (structure.Q, "Q {:g}"),
    ):
        if value is not None:
            return spring, words.format(value)
    return spring, f"zeta {structure.zeta:g}"


def _draw_stops(ax: Axes, pair: ImpactPair, heights: Mapping[float, float], bottom: float) -> None:
    """The frame that the base carries, with an arm for each stop."""
    top = bottom + 0.3
    for side, _ in pair.stops():
        sign = -1.0 if side == "lower" else 1.0
        face = heights[getattr(pair, side)] + sign * TONGUE
        arm = face + sign * PAD
        _block(ax, 3.9, min(face, arm), 1.0, PAD, COLOURS["stop"], linewidth=0.6)
        _block(ax, 3.8, min(arm, arm + sign * 0.14), 1.6, 0.14, "base", linewidth=0.6)
        top = max(top, arm + 0.14)
    _block(ax, 5.3, bottom + 0.3, 0.24, top - bottom - 0.3, "base", linewidth=0.6, zorder=1)


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
    assert pair is not None and pair.upper is not None
    blue, upper = COLOURS["simulate"], heights[pair.upper]
    low, look = height - TONGUE, {"linestyle": "--", "edgecolor": blue, "zorder": 2}
    _block(ax, 3.1, low, 1.7, 2 * TONGUE, "none", **look)
    _say(ax, 3.2, height + 0.13, "x(t)", blue, va="bottom")
    _arrow(ax, 4.35, height + TONGUE, upper + TONGUE, blue)
    _say(ax, 4.42, 0.5 * (height + upper) + TONGUE, "gap", blue)


def _draw_lengths(
    ax: Axes, pair: ImpactPair | None, heights: Mapping[float, float], rest: float, words: Words
) -> None:
    """Arrows of the clearances, from the static equilibrium to each stop, and of the sag."""
    for side in ("lower", "upper"):
        place = None if pair is None else getattr(pair, side)
        if place is None:
            continue
        distance = place - rest if side == "upper" else rest - place
        _arrow(ax, 5.95, heights[rest], heights[place], DRAWING["length"])
        name = words.length("clearance" if distance >= 0.0 else "preload of", abs(distance))
        _say(ax, 6.05, 0.5 * (heights[rest] + heights[place]), name, "length")
    if rest:
        _arrow(ax, 8.0, heights[0.0], heights[rest], DRAWING["ink"])
        sag = words.length("sag", abs(rest))
        _say(ax, 7.92, 0.5 * (heights[0.0] + heights[rest]), sag, ha="right")


def _arrow(ax: Axes, x: float, start: float, end: float, colour: str, **more: Any) -> None:
    look = {"arrowstyle": "<->", "color": colour, "shrinkA": 0, "shrinkB": 0} | more
    ax.annotate("", (x, start), (x, end), arrowprops=look)


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
    words = "circle: unloaded position; dot: static equilibrium"
    words += f"; {left} more gaps" if left else ""
    _say(ax, -0.36, -len(shown) + 0.35, words, va="top")
    ax.set(xlim=(-1.0, 1.35), ylim=(-len(shown) - 0.1, 0.6))
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
    _say(ax, -0.36, row, pair.name, ha="right")
    small: dict[str, Any] = {"fontsize": "x-small"}
    for side, sign, align in (("lower", -1.0, "right"), ("upper", 1.0, "left")):
        position = getattr(pair, side)
        if position is None:
            continue
        x, paper = place(position), {"color": "white", "pad": 0.5}
        ax.fill_between([x, x + 0.04 * sign], row - 0.22, row + 0.22, color=COLOURS["stop"])
        words, distance = f"{side} {_length(position)}", _length(abs(position - rest))
        _say(ax, x + 0.05 * sign, row, words, ha=align, bbox=paper, **small)
        middle = 0.5 * (x + place(rest))
        _say(ax, middle, row + 0.1, distance, "length", ha="center", va="bottom", **small)
    ax.plot(place(0.0), row, "o", mfc="white", mec=DRAWING["ink"], markersize=7)
    ax.plot(place(rest), row, "o", color=DRAWING["ink"], markersize=3.5)
