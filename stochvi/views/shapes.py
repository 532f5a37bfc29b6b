"""The shape of a bar, a beam or a plate at the moments of its impacts."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from stochvi.mathematics.arrays import Matrix, Vector
from stochvi.scenes.structures import Bar, Beam, Plate
from stochvi.views.axes import add_grid, length_unit
from stochvi.views.colours import COLOURS, OWNERS

if TYPE_CHECKING:
    from stochvi.scenes.scene import ImpactPair, Scene
    from stochvi.statistics.histories import History

PLACES = 101
"""Number of places along a bar or a beam at which its shape is drawn."""

PLACES_ACROSS = 41
"""Number of places along each side of a plate."""

MOST_SHAPES = 60
"""Largest number of impacts whose shapes are drawn: the fastest ones."""

CLAMP = 0.025
"""Width of the block of a clamped end, as a share of the length."""


def has_shape(found: History, scene: Scene) -> bool:
    """Whether the structure is a bar, beam or plate that had an impact."""
    return isinstance(scene.expanded.structure, Bar | Beam | Plate) and len(found.impacts) > 0


def draw_shapes(found: History, scene: Scene, title: str = "") -> Axes:
    """Deflections at the moments of the fastest impacts, with stops and rms, by modes; see
    `has_shape`."""
    structure = scene.expanded.structure
    if isinstance(structure, Plate):
        return _draw_plate(found, scene, structure, title)
    assert isinstance(structure, Bar | Beam)
    return _draw_span(found, scene, structure, title)


def _unit_of_length(length: float) -> tuple[float, str]:
    """Unit in which the length of a structure reads well: (metres, name)."""
    return (1.0, "m") if length >= 1.0 else (1e-3, "mm")


def _modal(found: History, scene: Scene) -> Matrix:
    """Displacements of the modes at the samples (samples, modes), m."""
    whole = scene.expanded
    if "displacement_m" in found.samples:  # one mode, whose displacement is that of its gap
        share = float(whole.row_of(whole.impact_pairs[0])[0])
        return np.asarray(found.samples[["displacement_m"]].to_numpy() / share)
    names = [f"{name}.displacement_m" for name in whole.structure.coordinates]
    return np.asarray(found.samples[names].to_numpy())


def _samples_at_impacts(found: History) -> Vector:
    """Number of the first sample in each of the fastest impacts, the fastest first."""
    fastest = found.impacts.sort_values("speed_m_s", ascending=False)[:MOST_SHAPES]
    place = np.searchsorted(found.samples["time_s"], fastest["time_s"])
    return np.minimum(place, len(found.samples) - 1)


def _draw_span(found: History, scene: Scene, span: Bar | Beam, title: str) -> Axes:
    """Deflection across a beam, or displacement along a bar, over the distance from its end."""
    share = np.linspace(0.0, 1.0, PLACES)
    fine = span.replace(points={f"{k}": float(each) for k, each in enumerate(share)})
    along = np.array(list(fine.table.shapes.values()))
    motion = _modal(found, scene)
    touching = motion[_samples_at_impacts(found)] @ along.T
    moments = motion.T @ motion / len(motion)
    rms = np.sqrt(np.einsum("pi,ij,pj->p", along, moments, along))
    stops = [
        (span.places_of_points[point], side, place)
        for point, side, place in _stops_on_points(scene.expanded.impact_pairs, scene)
    ]
    reach = max(float(np.abs(touching).max()), float(rms.max()), *(abs(s[2]) for s in stops), 0.0)
    unit, name = length_unit(reach)
    metres, of_length = _unit_of_length(span.length)
    x = share * span.length / metres
    _, ax = plt.subplots(figsize=(7.2, 4.2), layout="constrained")
    for shape in touching[1:]:
        ax.plot(x, shape / unit, color=OWNERS[0], alpha=0.2, linewidth=0.8)
    ax.plot(x, touching[0] / unit, color=OWNERS[0], label="at impacts, the fastest in bold",
            linewidth=2.0)  # fmt: skip
    ax.plot(x, rms / unit, "--", color=OWNERS[5], label="rms of this realisation")
    for number, (at, side, place) in enumerate(stops):
        ax.plot(
            [at * span.length / metres], [place / unit], marker=7 if side == "upper" else 6,
            markersize=12, color=COLOURS["linearise:closure"], linestyle="none",
            label="stops" if number == 0 else None,
        )  # fmt: skip
    _draw_supports(ax, span, x[-1])
    across = "deflection" if isinstance(span, Beam) else "displacement along the bar"
    ax.set(xlabel=f"distance from the first end ({of_length})", ylabel=f"{across} ({name})")
    ax.set_title(title or "one realisation", fontsize="medium")
    add_grid(ax)
    ax.legend(frameon=False, fontsize="small")
    return ax


def _draw_supports(ax: Axes, span: Bar | Beam, length: float) -> None:
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


def _draw_plate(found: History, scene: Scene, plate: Plate, title: str) -> Axes:
    """Deflection of a plate at its fastest impact, with its points, those at stops marked."""
    share = np.linspace(0.0, 1.0, PLACES_ACROSS)
    grid = {
        f"{i} {j}": [float(u), float(v)] for i, u in enumerate(share) for j, v in enumerate(share)
    }
    shapes = np.array(list(plate.replace(points=grid).table.shapes.values()))
    at = int(_samples_at_impacts(found)[0])
    deflection = (shapes @ _modal(found, scene)[at]).reshape(PLACES_ACROSS, -1)
    reach = float(np.abs(deflection).max())
    unit, name = length_unit(reach)
    metres, of_length = _unit_of_length(max(plate.length, plate.width))
    x, y = share * plate.length / metres, share * plate.width / metres
    figure, ax = plt.subplots(figsize=(6.4, 4.8), layout="constrained")
    levels = MaxNLocator(15, symmetric=True).tick_values(-reach / unit, reach / unit)
    drawn = ax.contourf(x, y, deflection.T / unit, levels=levels, cmap="RdBu_r")
    figure.colorbar(drawn, ax=ax, label=f"deflection ({name})", format="{x:.2g}")
    stopped = {point for point, _, _ in _stops_on_points(scene.expanded.impact_pairs, scene)}
    for point, (u, v) in plate.places_of_points.items():
        place = (u * plate.length / metres, v * plate.width / metres)
        ax.plot(*place, "^" if point in stopped else "o", color="k")
        ax.annotate(
            f"{point}{', at stops' if point in stopped else ''}", place, (8, 0),
            textcoords="offset points", va="center", fontsize="small",
            bbox={"color": "white", "alpha": 0.8, "boxstyle": "round,pad=0.1"},
        )  # fmt: skip
    ax.set(xlabel=f"length ({of_length})", ylabel=f"width ({of_length})", aspect="equal")
    speed, time = (float(found.impacts[name].iloc[int(found.impacts["speed_m_s"].argmax())])
                   for name in ("speed_m_s", "time_s"))  # fmt: skip
    heading = f"at the fastest impact, {speed:.3g} m/s after {time:.3g} s"
    ax.set_title(f"{title}\n{heading}" if title else heading, fontsize="medium")
    return ax
