"""Pictures of densities and paths. Chapters: first passage; the overview; one realisation; the
stationary density."""

from __future__ import annotations

import tempfile
from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stochvi.mathematics.impact_rates import corner_exponent, normal_density
from stochvi.mathematics.numerics import Vector
from stochvi.mathematics.units import (
    ACCELERATION,
    METRES,
    MILLIRADIANS,
    RATE,
    SI_ACCELERATION,
    SPEED,
    TIME,
    ShownQuantity,
    Size,
    shown_as,
)
from stochvi.results.base import ROTATIONS, DataFrame, Response, in_angles, quantities_of
from stochvi.results.estimates import Estimate, plus_minus
from stochvi.scenes.impact_laws import Restitution
from stochvi.views.axes import (
    COLOURS,
    OWNERS,
    SCREEN,
    Chart,
    Scale,
    around_shock,
    as_written,
    density_of,
    length_of,
    owner_colours,
    panels,
    thinned,
    time_of,
)
from stochvi.views.files import write_bytes
from stochvi.views.pages import Grid, Told, told_of
from stochvi.views.tables import effects_in_words

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from stochvi.methods.fokker_planck import FirstPassage
    from stochvi.scenes.scene import ImpactPair, Scene
    from stochvi.statistics.densities import Overview
    from stochvi.statistics.histories import History


# ------------------------------------------------------------------------------
# The picture of a first passage: its probability against time.
# ------------------------------------------------------------------------------


SINGLE_TIME_SPAN = 1000.0
"""Ratio of the ends of the time axis where the answer has a single time."""

MANY_TIMES = 15
"""Number of times above which their marks are drawn small."""

FAINTEST = 1e-8
"""Smallest probability that a picture shows, relative to its largest."""


def first_passage_told(found: FirstPassage) -> Told:
    """P(first passage before t) at each time, then its mean time and rates."""
    table = Grid.of(
        "P(first passage before t)",
        zip(found.times, found.probability, strict=True),
        "t = moment {s .6g}; probability = risk",
        0,
        moment=lambda moment, _: moment,
        risk=lambda _, risk: plus_minus(risk, digits=7),
    )
    ends = [METRES.text(x, "g") for x in (found.lower, found.upper) if x is not None]
    notes = [
        f"barriers at {' and '.join(ends)}; start: {found.start}",
        f"simulated effects: {effects_in_words(found.effects)}",
    ]
    cost = [f"cost: {found.cost.wall_time:.3g} s"]
    return told_of(found, table, notes, footer=cost)


def plot_first_passage(found: FirstPassage, ax: Axes | None = None) -> Axes:
    """P(first passage before t) against time, with the curve of constant rates.

    Both axes are logarithmic. `found` shows its own times as marks; the line between them is
    drawn where there are many.
    """
    times = np.array(found.times)
    chances = np.array([estimate.value for estimate in found.probability])
    order = np.argsort(times)
    shown = order[(times[order] > 0.0) & (chances[order] > 0.0)]
    if not len(shown):
        raise ValueError("a picture needs a time with a probability above 0")
    last = times[shown[-1]]
    first = times[shown[0]] if len(shown) > 1 else last / SINGLE_TIME_SPAN
    grid = np.geomspace(first, last, 201)
    chance = Scale("P(first passage before t)", log=True)
    chart = Chart.on(ax, Scale("time", TIME, log=True), chance)
    by_end = -np.expm1(-found.decay_rate.value * grid)
    chart.curve(grid, by_end, "rate in the end, from the first moment", "stop")
    if found.rice_rate is not None:
        chart.curve(grid, -np.expm1(-found.rice_rate.value * grid), "Rice, no memory", "stop", "--")
    size = 3.0 if len(shown) > MANY_TIMES else 5.5
    words = f"start: {found.start}"
    chart.curve(times[shown], chances[shown], words, "fokker-planck", marker="o", markersize=size)
    low = min(chances[shown].min(), by_end[0])
    # a probability is never above 1
    chart.ax.set_ylim(max(low / 2.0, FAINTEST * chances[shown].max()), 2.0)
    return chart.finish()


# ------------------------------------------------------------------------------
# Pictures of an overview: densities of displacement and velocity, and a short record.
# ------------------------------------------------------------------------------


CURVE_POINTS = 801
"""Number of points of the curve of a normal distribution."""


def plot_displacement_density(found: Overview, ax: Axes | None = None) -> Axes:
    """The histogram, the exact density where one is known, the law without stops, the stops."""
    edges, known = found.displacement.edges, found.exact_displacement
    length = length_of(float(np.abs(edges[[0, -1]]).max()))
    chart = Chart.on(ax, Scale("displacement", length), density_of(length))
    chart.stairs(edges, found.displacement.density, "Monte Carlo", fill=True, alpha=0.45)
    if known is not None:
        chart.curve(known["displacement"], known["density"], "exact", "exact", linewidth=1.8)
    if found.std_without_stops is not None:
        x = np.linspace(edges[0], edges[-1], CURVE_POINTS)
        density = normal_density(x, found.mean_without_stops, found.std_without_stops)
        chart.curve(x, density, "without stops", "stop", "--")
    chart.ax.set_ylim(bottom=0.0)
    chart.walls(found.scene)
    return chart.finish(3)


def plot_velocity_density(found: Overview, ax: Axes | None = None) -> Axes:
    """The histogram and a normal distribution: the exact one or, where none is known, that of its
    rms."""
    edges, known = found.velocity.edges, found.exact_velocity_std
    chart = Chart.on(ax, Scale("velocity", SPEED), density_of(SPEED))
    chart.stairs(edges, found.velocity.density, "Monte Carlo", fill=True, alpha=0.45)
    v = np.linspace(edges[0], edges[-1], CURVE_POINTS)
    density = normal_density(v, 0.0, found.velocity_rms if known is None else known)
    same = "normal distribution, same rms"
    chart.curve(v, density, *((same, "stop", "--") if known is None else ("exact", "exact")))
    return chart.finish(3)


def plot_record(scene: Scene, path: DataFrame, ax: Axes | None = None) -> Axes:
    """A short record with its impacts marked on the stops, sized by impact speed."""
    hits = path[path["impact_speed"] != 0.0]
    sides = np.where(hits["impact_speed"] > 0.0, "upper", "lower")
    hits = hits.assign(side=sides, speed=hits["impact_speed"].abs())
    hits["pair"] = next((pair.name for pair in scene.impact_pairs), "")
    time, x = path["time"].to_numpy(), path["displacement"].to_numpy()
    return draw_motion(ax, time, {"x": x}, stops_of(scene.impact_pairs), hits).finish()


def draw_overview(found: Overview, title: str) -> Axes:
    """Densities of x and v and a short record in one figure; returns the record's Axes."""
    import matplotlib.pyplot as plt

    figure, axes = plt.subplot_mosaic(
        [["x", "v"], ["record", "record"]], figsize=(9.6, 6.8), layout="constrained"
    )
    plot_displacement_density(found, axes["x"])
    plot_velocity_density(found, axes["v"])
    figure.suptitle(title)
    return plot_record(found.scene, found.record, axes["record"])


# ------------------------------------------------------------------------------
# Motions in time: of a realisation, of a replay and of an overview.
# ------------------------------------------------------------------------------


MOST_MARKS = 1000
"""Largest number of impacts that are marked. If there are more, the fastest in each of so many
equal intervals is marked."""

SMALLEST_MARK, MARK_GROWTH = 10.0, 50.0
"""Area of the mark of an impact at speed 0, and addition to it for the fastest impact, points^2."""


def draw_motion(
    ax: Axes | None, time: Vector, curves: Mapping[str, Vector], stops: Mapping[str, float],
    hits: DataFrame, part: slice = slice(None), y: Scale | None = None,
    size: tuple[float, float] = SCREEN,
) -> Chart:  # fmt: skip
    """A part of motions (m), rotations in mrad, between stops and with the impacts on them.

    Stops (m) are named by pair and side, "NAME SIDE". Impacts have the columns time, pair, side and
    speed; the mark of a faster one is larger.
    Long motions are drawn by the smallest and largest values of neighbouring samples.
    """
    mixed = y is None
    if y is None:
        moved = [float(np.abs(x[part]).max()) for n, x in curves.items() if n not in ROTATIONS]
        y = Scale("displacement", length_of(max(moved, default=1.0)))
    chart = Chart.on(ax, time_of(part, time), y, size)
    for colour, (name, x) in zip(owner_colours(len(curves)), curves.items(), strict=True):
        turns = mixed and name in ROTATIONS
        own = chart._replace(y=Scale(name, MILLIRADIANS)) if turns else chart
        words = None if len(curves) == 1 else own.y.label if turns else name
        style = "--" if turns else "-"
        own.curve(*thinned(time[part], x[part]), words, colour, style, linewidth=1.0)
    for wall in stops.values():
        chart.level(wall, "stops", linewidth=2.0)
    chart.ax.margins(x=0.0)
    names = hits["pair"].astype(str) + " " + hits["side"].astype(str)
    place = names.map(dict(stops)).astype(float)
    hits = hits.assign(place=place)[place.notna() & hits["time"].between(*time[part][[0, -1]])]
    if len(hits) > MOST_MARKS:
        interval = (hits["time"] * (MOST_MARKS / (time[-1] - time[0]))).astype(int)
        hits = hits.loc[hits.groupby(interval)["speed"].idxmax()]
    if len(hits):
        chart.ax.scatter(
            TIME(hits["time"]), y.quantity(hits["place"]), zorder=3,
            s=SMALLEST_MARK + MARK_GROWTH * hits["speed"] / hits["speed"].max(), linewidth=0.5,
            color=COLOURS["linearise:closure"], edgecolor="white", label=LARGER, clip_on=False,
        )  # fmt: skip
    return chart


LARGER = "impacts, larger = faster"


def stops_of(pairs: Iterable[ImpactPair]) -> dict[str, float]:
    """Positions of stops (m), by the name of their pair and their side."""
    return {
        f"{pair.name} {side}": float(getattr(pair, side))
        for pair in pairs
        for side, _ in pair.stops()
    }


def excerpt(time: Vector, x: Vector, hits: DataFrame) -> slice:
    """The part of a motion around its fastest impact."""
    speeds = hits["speed"].to_numpy()
    return around_shock(time, x, float(hits["time"].iloc[speeds.argmax()]) if len(hits) else None)


def hits_of(found: History) -> DataFrame:
    """The impacts of a realisation with the columns of those of a replay."""
    return found.impacts.rename(columns={"time_s": "time", "speed_m_s": "speed"})


# ------------------------------------------------------------------------------
# One realisation on a terminal, as a picture of its motion and impacts, and as an animation.
# ------------------------------------------------------------------------------


FRAMES, FRAMES_PER_PERIOD, FRAMES_PER_SECOND = 120, 15, 20
"""Number of frames in an animation, in a mean period of the motion, and in a second of watching."""

FLASH = 2
"""Number of frames after an impact for which its stop is lit."""

BLOCK_WIDTH = 0.16
"""Width of a mass in an animation, in units of the farthest place that anything reaches."""

ANIMATION_DPI = 80
"""Resolution of an animation, dots per inch: a few megabytes at most."""


def history_told(found: History) -> Told:
    """The quantities of the history, and the meanings of the columns of its table."""
    rows = [
        {"of": owner, "quantity": quantity.heading(known.words), "value": f"{quantity(value):.5g}"}
        for group in (found.coordinates, found.impact_pairs)
        for owner, numbers in group.items()
        for name, value in numbers.items()
        for known in [quantities_of(type(numbers))[name]]
        for quantity in [shown_as(in_angles(owner, known.unit))]
    ]
    table = Grid.of("one realisation, which has no standard error", rows, words=2)
    return told_of(found, table, [f"{name}: {words}" for name, words in found.meanings.items()])


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
    displacements, one for rotations, and one for each point of a body.
    """
    shown = [*_motion_panels(found, scene), *_acceleration_panels(found, scene)]
    draw = [partial(_draw_panel, found, panel) for panel in shown]
    return panels(None, draw, (9.6, 2.4 * len(draw) + 0.8), title or "one realisation")


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


def _draw_panel(found: History, panel: _Panel, ax: Axes) -> None:
    """Curves in a unit that reads well, and their stops, on which the impacts are marked."""
    curves = {label: found.samples[column].to_numpy() for label, column in panel.columns.items()}
    largest = max(float(np.abs(x).max()) for x in curves.values())
    words = panel.words if "\n" in panel.words else f"{panel.words}\n"
    y, time = Scale(words, _quantity(found, panel, largest)), found.samples["time_s"].to_numpy()
    chart = draw_motion(ax, time, curves, stops_of(panel.pairs), hits_of(found), y=y)
    chart.finish(len(curves) + 2)


def _quantity(found: History, panel: _Panel, largest: float) -> ShownQuantity:
    """The quantity of a panel: unless a unit is chosen, accelerations are in g where a base is
    shaken, and in m/s^2 where forces act."""
    if not _ends(next(iter(panel.columns.values())), "acceleration_m_s2"):
        return MILLIRADIANS if panel.turns else length_of(largest)
    if panel.turns:
        return ShownQuantity("angular acceleration", Size("rad/s²", 1.0))
    shaken = any(_ends(str(name), "base_acceleration_m_s2") for name in found.samples)
    return ACCELERATION if shaken else SI_ACCELERATION


def write_animation(found: History, scene: Scene, path: Path, title: str = "") -> None:
    """A GIF of masses between their stops, slowed down, around the fastest impact.

    It shows about eight mean periods of the first coordinate; stops light up at impacts."""
    import matplotlib.pyplot as plt
    from matplotlib.animation import PillowWriter
    from matplotlib.patches import Rectangle

    time = _frame_times(found)
    tracks = _tracks(found, scene, time)
    reach = max(float(np.abs(place).max()) for track in tracks for place in track.places)
    length = length_of(reach)
    unit = length.shown.si
    width = BLOCK_WIDTH * reach / unit
    figure, ax = plt.subplots(figsize=(7.2, 1.6 + 0.9 * len(tracks)), layout="constrained")
    try:
        ax.set(xlim=(-1.25 * reach / unit, 1.25 * reach / unit), ylim=(-0.7, len(tracks) - 0.3))
        ax.set_yticks(range(len(tracks)), [track.name for track in tracks])
        ax.set_xlabel(length.heading("displacement"))
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


# ------------------------------------------------------------------------------
# Pictures of a stationary density: its plane of x and v, impact speeds, marginals.
#
# Every function draws on the Axes it is given (or on new ones) and returns them. A density is what
# `exact_density` or `fokker_planck_density` return.
# ------------------------------------------------------------------------------


REACH = 3.5
"""Standard deviations of x and v that a picture shows, where no stop ends it before."""

DECADES = 4.0
"""Number of decades of the density that the picture of its plane spans."""

PLANE_POINTS, DENSITY_POINTS = 241, 401
"""Number of points along each side of a plane, and along a curve: odd, so that v = 0 is a point."""

SLIT = 0.04
"""Half the height of the slit in a stop at v = 0, relative to the height of the picture."""

MARGIN = 1.4
"""Factor by which the line that shows an exponent lies above the curve."""

SIZE = (6.4, 4.6)
"""Size of a figure of one picture, inches."""

SLOWEST, FASTEST = 1e-3, 5.0
"""Smallest and largest impact speed shown, in rms velocities."""


class Density(Protocol):
    """A stationary density that can be drawn."""

    @property
    def response(self) -> Response:
        """The stationary averages."""

    def density(self, x: ArrayLike, v: ArrayLike) -> Vector:
        """Joint density of displacement and velocity, s/m^2."""

    def displacement_density(self, x: ArrayLike) -> Vector:
        """Density of the displacement, 1/m."""

    def velocity_density(self, v: ArrayLike) -> Vector:
        """Density of the velocity, s/m."""

    def impact_flux(self, side: str, w: ArrayLike) -> Vector:
        """Impacts per second and unit of incident speed."""


def plot_plane(scene: Scene, found: Density, ax: Axes | None = None) -> Axes:
    """Density in the plane of displacement and velocity, logarithmic, with the stops.

    Stops are grey bands. At an inelastic rigid stop the density is infinite at v = 0, seen as a
    slit: a mass that comes at v > 0 leaves at -R v, nearer to 0."""
    from matplotlib.colors import LogNorm

    x, v, length = _range(scene, found)
    chart = Chart.on(ax, Scale("displacement", length), Scale("velocity", SPEED), SIZE)
    p = found.density(x[None, :], v[:, None]) * length.shown.si * SPEED.shown.si
    finite = p[np.isfinite(p) & (p > 0.0)]
    top = float(np.quantile(finite, 0.999))
    shown = np.where(np.isfinite(p), np.clip(p, top * 10.0**-DECADES, top), top)
    mesh = chart.ax.pcolormesh(
        length(x), SPEED(v), shown, shading="gouraud", cmap="viridis",
        norm=LogNorm(top * 10.0**-DECADES, top), rasterized=True,
    )  # fmt: skip
    chart.ax.figure.colorbar(mesh, ax=chart.ax, label=f"probability density (1/({length} {SPEED}))")
    chart.walls(scene)
    rigid = [stop for side, stop in _stops(scene) if scene.impact_pairs[0].law_of(side).rigid]
    for stop in rigid:
        for low, high in ((0.0, 0.5 - SLIT), (0.5 + SLIT, 1.0)):
            chart.at(stop, None, "black", ymin=low, ymax=high, linewidth=2.0)
    chart.ax.set_ylim(-SPEED(v[-1]), SPEED(v[-1]))
    return chart.finish()


def plot_impact_speeds(scene: Scene, found: Density, ax: Axes | None = None) -> Axes:
    """Impacts per second and unit of speed on each stop, log-log, with the exponent of the corner.

    Towards w = 0 the density of impact speeds goes as w^(1 - beta), with beta from
    `impact_rates.corner_exponent`: a dotted line at each rigid stop of a fixed restitution.
    """
    w = _value(found, "velocity_std") * np.geomspace(SLOWEST, FASTEST, DENSITY_POINTS)
    unit = Size(f"{RATE} per {SPEED}" if RATE.chosen or SPEED.chosen else "1/m", RATE.shown.si)
    unit = unit._replace(si=unit.si / SPEED.shown.si)
    flux_of = Scale("impact rate per speed", ShownQuantity("flux", unit), log=True)
    chart = Chart.on(ax, Scale("impact speed", SPEED, log=True), flux_of, SIZE)
    colours = {"lower": COLOURS["linearise:closure"], "upper": COLOURS["fokker-planck"]}
    largest = 0.0
    for line_style, (side, _) in zip(("-", "--"), _stops(scene), strict=False):
        flux = found.impact_flux(side, w)
        largest = max(largest, float(np.nanmax(flux)))
        shown = np.where(flux > 0.0, flux, np.nan)
        chart.curve(w, shown, f"{side} stop", colours[side], line_style)
        law = scene.impact_pairs[0].law_of(side)
        if isinstance(law, Restitution):
            beta = corner_exponent(law.slow_restitution)
            start, anchor = w[: DENSITY_POINTS // 2], DENSITY_POINTS // 4
            line = MARGIN * flux[anchor] * (start / w[anchor]) ** (1.0 - beta)
            text = f"w¹⁻ᵝ, β = {beta:.3g} (R = {law.coefficient})"
            told = text in chart.ax.get_legend_handles_labels()[1]
            chart.curve(start, line, None if told else text, colours[side], ":")
    chart.ax.set_ylim(chart.y.quantity((1e-6 * largest, 3.0 * largest)))
    return chart.finish()


def plot_marginals(
    scene: Scene, found: Density, axes: tuple[Axes, Axes] | None = None
) -> tuple[Axes, Axes]:
    """Densities of displacement and velocity, each with the normal distribution of the same rms."""
    import matplotlib.pyplot as plt

    left, right = axes or plt.subplots(1, 2, figsize=(9.0, 3.6), layout="constrained")[1]
    x, v, length = _range(scene, found)
    for ax, quantity, words, place, density, mean in (
        (left, length, "displacement", x, found.displacement_density(x),
         _value(found, "displacement_mean")),
        (right, SPEED, "velocity", v, found.velocity_density(v), 0.0),
    ):  # fmt: skip
        chart = Chart.on(ax, Scale(words, quantity), density_of(quantity))
        chart.curve(place, density, "density", "exact")
        normal = normal_density(place, mean, _value(found, f"{words}_std"))
        chart.curve(place, normal, "normal, same rms", "stop", "--")
        if ax is left and hasattr(found, "bands"):  # an averaged density is approximate
            low, high = found.bands(x)
            chart.band(x, low, high, "exact", "where the true one lies")
        ax.set_ylim(bottom=0.0)
        if ax is left:
            chart.walls(scene)
        chart.finish(3)
    return left, right


def draw_density(scene: Scene, found: Density) -> Axes:
    """The plane, the marginals and, where there are stops, the impact speeds in one figure."""
    import matplotlib.pyplot as plt

    figure, grid = plt.subplots(
        2, 2, figsize=(10.0, 7.6), layout="constrained", gridspec_kw={"height_ratios": (1.25, 1.0)}
    )
    plane: Axes = plot_plane(scene, found, grid[0, 0])
    if scene.impact_pairs:
        plot_impact_speeds(scene, found, grid[0, 1])
    else:
        grid[0, 1].set_axis_off()
    plot_marginals(scene, found, (grid[1, 0], grid[1, 1]))
    figure.suptitle(scene.title)
    return plane


def _stops(scene: Scene) -> list[tuple[str, float]]:
    """(side, position) of each stop; pictures are of scenes with at most one pair."""
    return [(name.rpartition(" ")[2], at) for name, at in stops_of(scene.impact_pairs).items()]


def _value(found: Density, quantity: str) -> float:
    (coordinate,) = found.response.coordinates.values()
    estimate = coordinate[quantity]
    assert isinstance(estimate, Estimate)
    return estimate.value


def _range(scene: Scene, found: Density) -> tuple[Vector, Vector, ShownQuantity]:
    """Displacements and velocities that a picture shows, which ends at rigid stops; and the unit of
    the displacements."""
    mean, deviation = _value(found, "displacement_mean"), _value(found, "displacement_std")
    low, high = mean - REACH * deviation, mean + REACH * deviation
    for side, law in (stop for pair in scene.impact_pairs for stop in pair.stops()):
        position = dict(_stops(scene))[side]
        if law.rigid:
            low, high = (
                (max(low, position), high) if side == "lower" else (low, min(high, position))
            )
    fast = REACH * _value(found, "velocity_std")
    x, v = np.linspace(low, high, PLANE_POINTS), np.linspace(-fast, fast, PLANE_POINTS)
    return x, v, length_of(float(np.abs(x).max()))
