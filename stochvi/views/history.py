"""One realisation on a terminal, as a picture of its motion and impacts, and as an animation."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.animation import PillowWriter
from matplotlib.axes import Axes
from matplotlib.patches import Rectangle
from numpy.typing import NDArray

from stochvi.mathematics.arrays import Vector
from stochvi.mathematics.shown_units import ACCELERATION, SI_ACCELERATION, TIME, shown_as
from stochvi.results.quantity_units import ROTATIONS, in_angles
from stochvi.views.axes import add_grid, as_written, draw_stop_bands, length_unit, thinned
from stochvi.views.colours import COLOURS, OWNERS, owner_colours
from stochvi.views.files import write_bytes
from stochvi.views.tables import print_frame

if TYPE_CHECKING:
    import pandas as pd
    from rich.console import Console

    from stochvi.scenes.scene import ImpactPair, Scene
    from stochvi.statistics.histories import History


MOST_MARKS = 1000
"""Largest number of impacts of a pair that are marked. If there are more, the fastest in each of so
many equal intervals is marked."""

SMALLEST_MARK, MARK_GROWTH = 10.0, 50.0
"""Area of the mark of an impact at speed 0, and addition to it for the fastest impact, points^2."""

MOST_COLUMNS = 8
"""Largest number of names beside each other in a legend."""

FRAMES, FRAMES_PER_PERIOD, FRAMES_PER_SECOND = 120, 15, 20
"""Number of frames in an animation, in a mean period of the motion, and in a second of watching."""

FLASH = 2
"""Number of frames after an impact for which its stop is lit."""

BLOCK_WIDTH = 0.16
"""Width of a mass in an animation, in units of the farthest place that anything reaches."""

ANIMATION_DPI = 80
"""Resolution of an animation, dots per inch: a few megabytes at most."""

SHOWN = {
    "displacement_mean": ("mean displacement", "m"),
    "displacement_std": ("standard deviation of displacement", "m"),
    "displacement_min": ("smallest displacement", "m"),
    "displacement_max": ("largest displacement", "m"),
    "velocity_std": ("standard deviation of velocity", "m/s"),
    "acceleration_std": ("standard deviation of acceleration", "m/s^2"),
    "acceleration_max": ("largest size of the acceleration", "m/s^2"),
    "hits": ("impacts", ""),
    "hits_lower": ("impacts on the lower stop", ""),
    "hits_upper": ("impacts on the upper stop", ""),
    "impact_speed_max": ("largest impact speed", "m/s"),
}
"""Quantities that a terminal shows, in words, and their SI units."""


def print_history(console: Console, found: History) -> None:
    """Print the quantities of the history, and the meanings of the columns of its table."""
    import pandas as pd

    rows = []
    for group in (found.coordinates, found.impact_pairs):
        for owner, numbers in group.items():
            for name, value in numbers.items():
                words, unit = SHOWN[name]
                quantity = shown_as(in_angles(owner, unit))
                cell = f"{quantity(value):.5g}"
                rows.append({"of": owner, "quantity": quantity.heading(words), "value": cell})
    print_frame(console, pd.DataFrame(rows), "one realisation, which has no standard error")
    for name, meaning in found.meanings.items():
        console.print(f"{name}: {meaning}", style="dim", highlight=False, markup=False)
    console.print(found.summary(), highlight=False, markup=False)
    for warning in found.warnings:
        console.print(f"note: {warning}", style="yellow", highlight=False, markup=False)


class _Panel(NamedTuple):
    """Curves that are drawn over each other: columns by their labels, what they are, the pairs
    whose stops stand beside them, and whether they are angles."""

    columns: dict[str, str]
    words: str
    pairs: Sequence[ImpactPair] = ()
    turns: bool = False


def draw_history(found: History, scene: Scene, title: str = "") -> Axes:
    """Displacements and gaps with stops and impacts, and absolute accelerations below them.

    A coordinate between stops of its own has a panel of its own. The others share one for
    displacements, one for rotations, and one for each point of a body. Long histories are drawn by
    the smallest and largest values of neighbouring samples.
    """
    panels = [*_motion_panels(found, scene), *_acceleration_panels(found, scene)]
    rows = len(panels)
    figure, grid = plt.subplots(
        rows, 1, figsize=(9.6, 2.4 * rows + 0.8), sharex=True, squeeze=False, layout="constrained"
    )
    for panel, ax in zip(panels, grid[:, 0], strict=True):
        _plot_panel(found, panel, ax)
    grid[-1, 0].set_xlabel(f"time ({TIME})")
    grid[0, 0].margins(x=0.0)
    figure.suptitle(title or "one realisation", fontsize="medium")
    first: Axes = grid[0, 0]
    return first


def _motion_panels(found: History, scene: Scene) -> list[_Panel]:
    """Panels of the displacements, in the order of the table, and then of the gaps."""
    pairs, panels = scene.expanded.impact_pairs, []
    shared: dict[str, dict[str, str]] = {}
    for column in (str(name) for name in found.samples):
        prefix = column.rpartition(".")[0]
        if not _ends(column, "displacement_m") or prefix not in _shown(scene):
            continue
        name, usual = prefix or _only(scene), next(iter(scene.expanded.structure.places))
        own = [
            pair
            for pair in pairs
            if (not prefix or (pair.on or usual) == name) and not _gap_column(found, scene, pair)
        ]
        if own:
            panels.append(_Panel({name: column}, f"displacement of {name}", own))
        else:
            point = name.rpartition(".")[0]
            kind = f"displacement of {point}" if point else "displacement"
            shared.setdefault("rotation" if name in ROTATIONS else kind, {})[name] = column
    for words, columns in shared.items():
        alone = f" of {next(iter(columns))}" if len(columns) == 1 else ""
        panels.append(_Panel(columns, words + alone, turns=words == "rotation"))
    for pair in pairs:
        if column := _gap_column(found, scene, pair):
            words = " less ".join(pair.between) if pair.between else f"gap of {pair.name}"
            panels.append(_Panel({words: column}, words, [pair]))
    return panels


def _shown(scene: Scene) -> tuple[str, ...]:
    """Names of the displacements that are drawn; the one column of an oscillator has no name."""
    return ("", *scene.expanded.structure.shown)


def _gap_column(found: History, scene: Scene, pair: ImpactPair) -> str:
    """Column of a gap that is no displacement of one place; empty where there is none."""
    several = len(scene.expanded.impact_pairs) > 1
    column = f"{pair.name}.gap_m" if several else "gap_m"
    return column if _spans(pair) and column in found.samples else ""


def _only(scene: Scene) -> str:
    """Name of the one displacement of a scene that has one: of one mode, that of its gap."""
    whole = scene.expanded
    if not whole.structure.reported:
        return whole.moving[0]
    return whole.words_of(whole.impact_pairs[0]) if whole.impact_pairs else whole.structure.shown[0]


def _acceleration_panels(found: History, scene: Scene) -> list[_Panel]:
    """Panels of the absolute accelerations: of coordinates, and of rotations."""
    columns = {
        str(name).rpartition(".")[0]: str(name)
        for name in found.samples
        if _ends(str(name), "acceleration_m_s2") and str(name).rpartition(".")[0] in _shown(scene)
    }
    turning = {name: column for name, column in columns.items() if name in ROTATIONS}
    moving = {name: column for name, column in columns.items() if name not in turning}
    panels = [
        _Panel(moving, "absolute\nacceleration"),
        _Panel(turning, "angular\nacceleration", turns=True),
    ]
    return [panel for panel in panels if panel.columns]


def _spans(pair: ImpactPair) -> bool:
    """Whether the gap of a pair has a column of its own: between two masses, on a body, or a
    weighted sum."""
    return pair.between is not None or pair.at is not None or pair.weights is not None


def _ends(name: str, quantity: str) -> bool:
    """Whether a column holds a quantity of a coordinate (not of the base)."""
    return name.rpartition(".")[2] == quantity


def _plot_panel(found: History, panel: _Panel, ax: Axes) -> None:
    """Curves in a unit that reads well, and their stops, on which the impacts are marked."""
    time = found.samples["time_s"].to_numpy()
    curves = {label: found.samples[column].to_numpy() for label, column in panel.columns.items()}
    unit, unit_name = _unit(found, panel, max(float(np.abs(y).max()) for y in curves.values()))
    for (label, y), colour in zip(curves.items(), owner_colours(len(curves)), strict=True):
        name = label if len(curves) > 1 else None
        ax.plot(*thinned(TIME(time), y / unit), color=colour, linewidth=0.8, label=name)
    for pair in panel.pairs:
        hits = _fastest(found.impacts[found.impacts["pair"] == pair.name], found.duration)
        place = np.where(hits["side"] == "upper", pair.upper or 0.0, pair.lower or 0.0)
        ax.scatter(
            TIME(hits["time_s"]), place / unit,
            s=SMALLEST_MARK + MARK_GROWTH * hits["speed_m_s"] / found.impacts["speed_m_s"].max(),
            color=COLOURS["linearise:closure"], edgecolor="white", linewidth=0.5, zorder=3,
            label="impacts, larger = faster" if len(hits) else None,
        )  # fmt: skip
    draw_stop_bands(ax, panel.pairs, unit, vertical=False)
    join = " " if "\n" in panel.words else "\n"
    ax.set_ylabel(f"{panel.words}{join}({unit_name})")
    add_grid(ax)
    labels = ax.get_legend_handles_labels()[1]
    if labels:
        ax.legend(
            frameon=False, fontsize="small", loc="lower center", bbox_to_anchor=(0.5, 1.0),
            ncols=min(len(labels), MOST_COLUMNS),
        )  # fmt: skip


def _unit(found: History, panel: _Panel, largest: float) -> tuple[float, str]:
    """Unit of a panel, in SI, and its name: unless one is chosen, accelerations are in g where a
    base is shaken, and in m/s^2 where forces act."""
    if not _ends(next(iter(panel.columns.values())), "acceleration_m_s2"):
        return (1e-3, "mrad") if panel.turns else length_unit(largest)
    if panel.turns:
        return 1.0, "rad/s²"
    shaken = any(_ends(str(name), "base_acceleration_m_s2") for name in found.samples)
    name, size = (ACCELERATION if shaken else SI_ACCELERATION).shown
    return size, name


def _fastest(hits: pd.DataFrame, duration: float) -> pd.DataFrame:
    """The impacts to mark: all of them, or the fastest in each interval where there are more than
    `MOST_MARKS`."""
    if len(hits) <= MOST_MARKS:
        return hits
    interval = (hits["time_s"] * (MOST_MARKS / duration)).astype(int)
    return hits.loc[hits.groupby(interval)["speed_m_s"].idxmax()]


def write_animation(found: History, scene: Scene, path: Path, title: str = "") -> None:
    """A GIF of masses between their stops, slowed down, around the fastest impact.

    It shows about eight mean periods of the first coordinate; stops light up at impacts."""
    time = _frame_times(found)
    tracks = _tracks(found, scene, time)
    reach = max(float(np.abs(place).max()) for track in tracks for place in track.places)
    unit, name = length_unit(reach)
    width = BLOCK_WIDTH * reach / unit
    figure, ax = plt.subplots(figsize=(7.2, 1.6 + 0.9 * len(tracks)), layout="constrained")
    try:
        ax.set(xlim=(-1.25 * reach / unit, 1.25 * reach / unit), ylim=(-0.7, len(tracks) - 0.3))
        ax.set_yticks(range(len(tracks)), [track.name for track in tracks])
        ax.set_xlabel(f"displacement ({name})")
        slow = len(time) / FRAMES_PER_SECOND / (time[-1] - time[0])
        pace = f"{slow:.3g} times slower" if slow >= 1.0 else f"{1.0 / slow:.3g} times faster"
        heading = ax.set_title(f"{title or 'one realisation'}, {pace} than it is", fontsize="small")
        clock = ax.text(0.01, 0.97, "", transform=ax.transAxes, va="top", fontsize="small")
        blocks, walls = [], []
        for row, track in enumerate(tracks):
            block = Rectangle((0.0, row - 0.25), width, 0.5, color=OWNERS[0])
            ax.add_patch(block)
            blocks.append((block, track.mass / unit - width / 2.0))
            for wall in track.walls:
                # the block is as wide as it is drawn: its faces meet the stops
                edge = width / 2.0 if wall.side == "upper" else -width
                patch = Rectangle((0.0, row - 0.35), width / 2.0, 0.7)
                ax.add_patch(patch)
                walls.append((patch, wall.place / unit + edge, wall.lit))
        heading.set_parse_math(False)
        as_written(ax)
        figure.canvas.draw()
        figure.set_layout_engine("none")  # the layout of the first frame is kept in all frames
        writer = PillowWriter(fps=FRAMES_PER_SECOND)
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "animation.gif"
            with writer.saving(figure, str(file), ANIMATION_DPI):
                for frame, now in enumerate(time):
                    clock.set_text(f"{now:.4f} s")
                    for block, places in blocks:
                        block.set_x(places[frame])
                    for patch, places, lit in walls:
                        patch.set_x(places[frame])
                        patch.set_color(COLOURS["linearise:closure" if lit[frame] else "stop"])
                    writer.grab_frame()
            data = file.read_bytes()
    finally:
        plt.close(figure)
    write_bytes(data, path)


class Wall(NamedTuple):
    """A stop in an animation: its side, its place (m) and whether it is lit, at each frame."""

    side: str
    place: Vector
    lit: NDArray[np.bool_]


class Track(NamedTuple):
    """A row of an animation: its name, the place of a mass at each frame (m), and its stops."""

    name: str
    mass: Vector
    walls: tuple[Wall, ...]

    @property
    def places(self) -> tuple[Vector, ...]:
        """Places of the mass and of the stops."""
        return (self.mass, *(wall.place for wall in self.walls))


def _frame_times(found: History) -> Vector:
    """Times of the frames: equal steps of a mean period, around the fastest impact."""
    samples = found.samples
    column = next(str(name) for name in samples if _ends(str(name), "displacement_m"))
    x = samples[column].to_numpy() - samples[column].mean()
    end = float(samples["time_s"].iloc[-1])
    turns = max(1, int(np.count_nonzero(np.diff(np.sign(x)))) // 2)
    shown = min(end, FRAMES / FRAMES_PER_PERIOD * end / turns)
    hits = found.impacts
    middle = shown / 2.0
    if len(hits):
        middle = float(hits["time_s"].iloc[int(hits["speed_m_s"].argmax())])
    start = min(max(0.0, middle - shown / 2.0), end - shown)
    return np.linspace(start, start + shown, FRAMES)


def _tracks(found: History, scene: Scene, time: Vector) -> list[Track]:
    """A row for each pair, and for each coordinate that no pair begins with; the stops between two
    masses move with the second."""
    whole = scene.expanded
    several = "displacement_m" not in found.samples
    usual = next(iter(whole.structure.places))
    held = set(whole.structure.coordinates) - set(whole.moving)
    names = [name for name in whole.structure.shown if name not in held]
    names = names if several else [_only(scene)]
    sampled = found.samples["time_s"].to_numpy()

    def place(name: str) -> Vector:
        column = f"{name}.displacement_m" if several else "displacement_m"
        if name.startswith("gap of ") and several:
            owner = name.removeprefix("gap of ")
            column = f"{owner}.gap_m" if len(whole.impact_pairs) > 1 else "gap_m"
        elif name in whole.structure.coordinates and name not in whole.moving:
            return np.zeros_like(time)  # the other masses are shown relative to this one
        return np.asarray(np.interp(time, sampled, found.samples[column].to_numpy()))

    tracks, seen = [], set()
    for pair in whole.impact_pairs:
        first, second = pair.between or (pair.on or usual, "")
        if pair.at is not None or pair.weights is not None:
            first = f"gap of {pair.name}"
        apart = second and (several or second in whole.structure.coordinates)
        carrier = place(second) if apart else np.zeros_like(time)
        walls = tuple(
            Wall(side, carrier + stop, _lit(found, pair.name, side, time))
            for side, stop in (("lower", pair.lower), ("upper", pair.upper))
            if stop is not None
        )
        label = f"{first}\nin {second}" if second else first
        tracks.append(Track(label, place(first), walls))
        seen.add(first)
    return tracks + [Track(name, place(name), ()) for name in names if name not in seen]


def _lit(found: History, pair: str, side: str, time: Vector) -> NDArray[np.bool_]:
    """Whether a stop was hit within the last frames."""
    hits = found.impacts
    times = hits["time_s"][(hits["pair"] == pair) & (hits["side"] == side)].to_numpy()
    last = np.append(-np.inf, times)[np.searchsorted(times, time, side="right")]
    return np.asarray(time - last <= FLASH * (time[1] - time[0]))
