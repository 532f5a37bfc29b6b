"""Bars, beams and plates: their shape at the moments of impacts, and a map of their rms."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple, cast

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from stochvi.mathematics.arrays import Matrix, Vector
from stochvi.scenes.structures.spans import Span
from stochvi.views.axes import add_grid, length_unit
from stochvi.views.colours import COLOURS, OWNERS

if TYPE_CHECKING:
    import pandas as pd

    from stochvi.methods.replay.answer import Histories, ReplayAt
    from stochvi.results.response import Response
    from stochvi.scenes.scene import ImpactPair, Scene
    from stochvi.statistics.histories import History

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

INTERVAL = 1.96
"""Half the width of a 95 % interval, in standard errors."""

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


def _unit_of_length(length: float) -> tuple[float, str]:
    """Unit in which the length of a structure reads well: (metres, name)."""
    return (1.0, "m") if length >= 1.0 else (1e-3, "mm")


def _modal(found: History, scene: Scene) -> Matrix:
    """Displacements of the modes at the samples (samples, modes), m."""
    if "displacement_m" in found.samples:
        return np.asarray(found.samples[["displacement_m"]].to_numpy() / _share_of_gap(scene))
    names = [f"{name}.displacement_m" for name in scene.expanded.structure.coordinates]
    return np.asarray(found.samples[names].to_numpy())


def _of_replay(found: Histories, scene: Scene) -> Matrix:
    """The same of a replay."""
    if len(found.displacement) == 1:
        return np.column_stack(list(found.displacement.values())) / _share_of_gap(scene)
    return np.column_stack(
        [found.displacement[name] for name in scene.expanded.structure.coordinates]
    )


def _share_of_gap(scene: Scene) -> float:
    """Displacement of the gap per unit of the one mode: an answer on one mode is that of its
    gap."""
    whole = scene.expanded
    return float(whole.row_of(whole.impact_pairs[0])[0])


def _motion_of(found: History | ReplayAt, scene: Scene) -> Motion:
    """The motion of a realisation, or of a replay whose samples were kept."""
    replayed = getattr(found, "histories", None)
    if replayed is not None:
        modes, time, moment, speed = _of_replay(replayed, scene), replayed.time, "time", "speed"
    else:
        kept = cast("History", found)
        modes, time = _modal(kept, scene), kept.samples["time_s"]
        moment, speed = "time_s", "speed_m_s"
    fastest = found.impacts.sort_values(speed, ascending=False)[:MOST_SHAPES]
    touches = np.minimum(np.searchsorted(time, fastest[moment]), len(modes) - 1)
    return Motion(modes, touches, float(fastest[moment].iloc[0]), float(fastest[speed].iloc[0]))


def _draw_span(motion: Motion, scene: Scene, span: Span, title: str) -> Axes:
    """Deflection across a beam, or displacement along a bar, over the distance from its end."""
    share = np.linspace(0.0, 1.0, PLACES)
    along = _shapes(span, PLACES)
    touching = motion.modes[motion.touches] @ along.T
    moments = motion.modes.T @ motion.modes / len(motion.modes)
    rms = np.sqrt(np.einsum("pi,ij,pj->p", along, moments, along))
    stops = _stops_along(scene, span)
    reach = max(float(np.abs(touching).max()), float(rms.max()), *(abs(s[2]) for s in stops), 0.0)
    unit, name = length_unit(reach)
    metres, _ = _unit_of_length(span.length)
    x = share * span.length / metres
    _, ax = plt.subplots(figsize=(7.2, 4.2), layout="constrained")
    for shape in touching[1:]:
        ax.plot(x, shape / unit, color=OWNERS[0], alpha=0.2, linewidth=0.8)
    ax.plot(x, touching[0] / unit, color=OWNERS[0], label="at impacts, the fastest in bold",
            linewidth=2.0)  # fmt: skip
    ax.plot(x, rms / unit, "--", color=OWNERS[5], label="rms of this realisation")
    _finish_span(ax, scene, span, unit, name)
    ax.set_title(title or "one realisation", fontsize="medium")
    return ax


def _shapes(span: Span, count: int) -> Matrix:
    """Shapes of the modes (places, modes) at `with_places(count)`."""
    shapes = span.with_places(count).table.shapes
    return np.array([shape for name, shape in shapes.items() if name.startswith("place ")])


def _stops_along(scene: Scene, span: Span) -> list[tuple[float, str, float]]:
    """Share of the length, side and position (m) of each stop that one point alone can meet."""
    stops = _stops_on_points(scene.expanded.impact_pairs, scene)
    return [(span.places_of_points[point], side, place) for point, side, place in stops]


def _finish_span(
    ax: Axes, scene: Scene, span: Span, unit: float, name: str, word: str = ""
) -> None:
    """Draw the stops and supports of a bar or beam, and name the axes; `word` stands before what is
    drawn across, in this unit of length."""
    metres, of_length = _unit_of_length(span.length)
    for number, (at, side, place) in enumerate(_stops_along(scene, span)):
        ax.plot(
            [at * span.length / metres], [place / unit], marker=7 if side == "upper" else 6,
            markersize=12, color=COLOURS["stop"], linestyle="none",
            label="stops" if number == 0 else None,
        )  # fmt: skip
    _draw_supports(ax, span, span.length / metres)
    ax.set(
        xlabel=f"distance from the first end ({of_length})", ylabel=f"{word}{span.moves} ({name})"
    )
    add_grid(ax)
    ax.legend(frameon=False, fontsize="small")


def draw_map(table: pd.DataFrame, found: Response, scene: Scene) -> Axes:
    """The rms displacement over a structure, from `rms_along`, with its stops and without.

    An answer `found` of another method stands beside it as dots at the named points.
    """
    structure = scene.structure
    assert isinstance(structure, Span)
    if len(structure.sides) > 1:
        return _map_of_plate(table, scene, structure)
    unit, name = length_unit(float(table["rms_without_stops_m"].max()))
    metres, _ = _unit_of_length(structure.length)
    _, ax = plt.subplots(figsize=(7.2, 4.2), layout="constrained")
    for column, (words, style, colour) in MAPPED.items():
        if column in table:
            ax.plot(table["distance_m"] / metres, table[column] / unit, style, color=colour,
                    label=words)  # fmt: skip
    if not found.method.startswith("linearise"):
        _draw_points(ax, found, structure, unit, metres)
    _finish_span(ax, scene, structure, unit, name, "rms ")
    ax.set_title(scene.title or found.method, fontsize="medium")
    return ax


def _draw_points(ax: Axes, found: Response, span: Span, unit: float, metres: float) -> None:
    """The standard deviations of an answer at the named points, with 95 % intervals."""
    rows = [
        (place, each.displacement_std)
        for point, place in span.places_of_points.items()
        if (each := found.coordinates.get(point)) is not None and each.displacement_std
    ]
    ax.errorbar(
        [place * span.length / metres for place, _ in rows], [std.value / unit for _, std in rows],
        [INTERVAL * (std.standard_error or 0.0) / unit for _, std in rows], fmt="o",
        color=COLOURS["simulate"], label=f"{found.method}, 95 %", zorder=3,
    )  # fmt: skip


def _map_of_plate(table: pd.DataFrame, scene: Scene, plate: Span) -> Axes:
    """The rms over a plate, a panel each without stops and with them."""
    shown = {column: words for column, (words, *_) in MAPPED.items() if column in table}
    unit, name = length_unit(float(table["rms_without_stops_m"].max()))
    metres, of_length = _unit_of_length(max(plate.sides))
    figure, axes = plt.subplots(
        1, len(shown), figsize=(1.0 + 4.6 * len(shown), 4.2), layout="constrained", squeeze=False
    )  # fmt: skip
    x, y = (np.unique(table[each]) / metres for each in ("x_m", "y_m"))
    top = max(float(table[column].max()) for column in shown) / unit
    levels = MaxNLocator(15).tick_values(0.0, top)
    for ax, (column, words) in zip(axes[0], shown.items(), strict=True):
        rms = np.asarray(table[column]).reshape(len(x), -1) / unit
        drawn = ax.contourf(x, y, rms.T, levels=levels, cmap="viridis")
        _draw_points_of_plate(ax, scene, plate, metres)
        ax.set(xlabel=f"length ({of_length})", ylabel=f"width ({of_length})", aspect="equal")
        ax.set_title(words, fontsize="medium")
    figure.colorbar(drawn, ax=axes, label=f"rms deflection ({name})", format="{x:.2g}")
    first: Axes = axes[0, 0]
    return first


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
    share = np.linspace(0.0, 1.0, PLACES_ACROSS)
    shapes = _shapes(plate, PLACES_ACROSS)
    deflection = (shapes @ motion.modes[motion.touches[0]]).reshape(PLACES_ACROSS, -1)
    reach = float(np.abs(deflection).max())
    unit, name = length_unit(reach)
    length, width = plate.sides
    metres, of_length = _unit_of_length(max(plate.sides))
    x, y = share * length / metres, share * width / metres
    figure, ax = plt.subplots(figsize=(6.4, 4.8), layout="constrained")
    levels = MaxNLocator(15, symmetric=True).tick_values(-reach / unit, reach / unit)
    drawn = ax.contourf(x, y, deflection.T / unit, levels=levels, cmap="RdBu_r")
    figure.colorbar(drawn, ax=ax, label=f"deflection ({name})", format="{x:.2g}")
    _draw_points_of_plate(ax, scene, plate, metres)
    ax.set(xlabel=f"length ({of_length})", ylabel=f"width ({of_length})", aspect="equal")
    heading = f"at the fastest impact, {motion.speed:.3g} m/s after {motion.moment:.3g} s"
    ax.set_title(f"{title}\n{heading}" if title else heading, fontsize="medium")
    return ax


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
