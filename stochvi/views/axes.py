"""What all pictures share. Chapters: colours; axes, units of length, stops, grid and legend."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING

import numpy as np

from stochvi.mathematics.numerics import Vector
from stochvi.mathematics.units import LENGTH, TIME

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.text import Text

    from stochvi.scenes.scene import ImpactPair, Scene


# ------------------------------------------------------------------------------
# The colours of all pictures.
#
# They are those of M. Okabe and K. Ito, which readers with any colour vision tell apart. In grey
# they differ in lightness, and pictures that compare curves give each a marker or a line style as
# well.
# ------------------------------------------------------------------------------


COLOURS = {
    "exact": "#1b1b1b",
    "simulate": "#0072b2",
    "linearise:closure": "#d55e00",
    "linearise:motion": "#e69f00",
    "linearise:force": "#009e73",
    "fokker-planck": "#cc79a7",
    "stop": "#8a8f98",
}
"""One colour per method, the same in every picture."""

OWNERS = ("#0072b2", "#d55e00", "#009e73", "#e69f00", "#cc79a7", "#1b1b1b")
"""Colours of coordinates and impact pairs, in their order."""

BAND_ALPHA = 0.3
"""Opacity of a band of errors."""

GRID_COLOUR = "#dddddd"
"""Colour of the lines of a grid."""

DRAWING = {
    "ink": "#1b1b1b",
    "mass": "#dbe9f4",
    "base": "#e3e6ea",
    "line": "#c4c8ce",
    "length": "#a8480a",
}
"""Colours of the drawing of a scene: outlines, mass, base and frame, thin lines, and lengths."""

CLEARANCES = {
    "three_sigma": "#e69f00",
    "recommended": "#009e73",
    "record": "#a5222f",
}
"""Colours of the clearances that the pictures of a sizing mark: three standard deviations, the
answer, and what a record itself needs where it contradicts the sizing."""

TRANSFERS = {
    "transmissibility_h1": "#0072b2",
    "transmissibility_ratio": "#d55e00",
    "coherence": "#009e73",
}
"""Colours of what compares a response with its excitation, by quantity."""

BASINS = (
    "#9ecae8", "#f2a7a0", "#a9d8a5", "#f5d08a", "#c7b3e0", "#8fd3cf", "#e8b4d4", "#cfc29a",
)  # fmt: skip
"""Colours of basins, light enough for the marks of their regimes."""

CHAOTIC, UNDECIDED, BEYOND = "#4d4d4d", "#d0d0d0", "#ffffff"
"""Colours of starts that end in chaos, that are undecided, and that lie beyond a stop."""


def owner_colours(number: int) -> list[str]:
    """Colours of `number` coordinates or pairs: those of `OWNERS`, or shades where there are more
    of them."""
    if number <= len(OWNERS):
        return list(OWNERS[:number])
    from matplotlib import colormaps
    from matplotlib.colors import to_hex

    return [to_hex(colormaps["turbo"](share)) for share in np.linspace(0.03, 0.97, number)]


# ------------------------------------------------------------------------------
# Parts that all pictures share: axes, units of length, the stops, the grid and the legend.
#
# matplotlib is imported where the first picture is drawn: a report may have none.
# ------------------------------------------------------------------------------


LENGTH_UNITS = ((1.0, "m"), (1e-3, "mm"), (1e-6, "µm"))
"""Units of length that axes may have: length of the unit in metres, and its name."""

SCREEN, PAGE = (6.4, 4.0), (5.2, 3.5)
"""Sizes of figures in inches: for a screen, and for half the width of a page, where letters of 10
points read well on a telephone too."""

PLAIN_NUMBERS = (1e-4, 2e4)
"""A logarithmic axis within these limits is labelled by numbers, another one by powers of ten."""

FEW_DECADES = 300.0
"""Ratio of the ends of a logarithmic axis below which 2 and 5 times a power of ten are labelled
too."""

LESS_THAN_A_DECADE, FEW_TICKS = 8.0, 6
"""Ratio of the ends of a logarithmic axis below which labels at 1, 2 and 5 alone are too few.
Labels then stand at equal distances, and the second number is the most of them."""

MOST_DECADES, MOST_OF_SPECTRA, MARGIN = 20, 10, 3.0
"""Largest number of decades of a logarithmic axis, as of fatigue damage over two decades of
frequency, and that of densities over frequency; and factor by which it reaches beyond its lines."""

LONGEST_LINE, MOST_LINES = 70, 2
"""Largest number of characters in a line of text in a picture, and of lines to which a longer text
is wrapped: more would leave no room for the picture."""

MOST_POINTS = 4000
"""Number of points above which a curve is drawn by the smallest and largest values of
neighbours."""

EXCERPT_PERIODS = 20
"""Mean periods of a motion around its shock that a picture shows: in many more, x(t) is a comb."""

LEGEND_COLUMNS = 2
"""Number of columns of a legend: more do not fit above a picture of half a page."""


def axes_or_new(ax: Axes | None, size: tuple[float, float] = SCREEN) -> Axes:
    """The axes that are given, or those of a new figure of this size in inches."""
    if ax is not None:
        return ax
    import matplotlib.pyplot as plt

    made: Axes = plt.subplots(figsize=size, layout="constrained")[1]
    return made


def add_title(ax: Axes, title: str) -> Axes:
    """Set the title of the figure that holds these axes."""
    figure = ax.get_figure(root=True)
    assert figure is not None
    figure.suptitle(title)
    return ax


def as_written(ax: Axes) -> Figure:
    """The figure that holds these axes, its words letter by letter, long lines wrapped and cut.

    Names and titles are those of a user: a "$" in them begins no formula. Labels of ticks and what
    belongs to them keep their powers of ten.
    """
    figure = ax.get_figure(root=True)
    assert figure is not None
    for each in figure.axes:
        low, high = sorted(each.get_ylim())
        if each.get_yscale() == "log" and not high < 10.0 ** (MOST_OF_SPECTRA + 2) * low:
            limit_decades(each)
    for text in _words(figure):
        text.set_parse_math(False)
        text.set_text("\n".join(map(_shortened, text.get_text().splitlines())))
    return figure


def _words(artist: Artist) -> Iterator[Text]:
    """The texts of an artist and its parts. An axis counts with its label alone, not with the texts
    of its scale."""
    from matplotlib.axis import Axis
    from matplotlib.text import Text

    if isinstance(artist, Text):
        yield artist
    # the ticks of an axis are made when they are asked for, which takes as long as to draw them
    for part in [artist.label] if isinstance(artist, Axis) else artist.get_children():
        yield from _words(part)


def _shortened(line: str) -> str:
    if len(line) <= LONGEST_LINE:
        return line
    return "\n".join(textwrap.wrap(line, LONGEST_LINE, max_lines=MOST_LINES, placeholder=" …"))


def limit_decades(ax: Axes, most: int = MOST_DECADES) -> None:
    """Limit a logarithmic y axis to what its lines reach, and to so many decades.

    The lower end of a band of errors may be zero, which a logarithmic axis draws 300 decades below.
    """
    drawn = [np.asarray(line.get_ydata(), float) for line in ax.get_lines()]
    heights = np.concatenate([np.zeros(0), *drawn])
    heights = heights[np.isfinite(heights) & (heights > 0.0)]
    if heights.size:
        low, high = float(heights.min()), float(heights.max())
        ax.set_ylim(max(low / MARGIN, high / 10.0**most), MARGIN * high)


def add_grid(ax: Axes) -> None:
    """Draw thin lines at the labelled values."""
    ax.grid(which="major", color=GRID_COLOUR, linewidth=0.6)


def length_unit(size: float) -> tuple[float, str]:
    """Unit of lengths of this size, (metres, name): the chosen one, or one that reads well."""
    if LENGTH.chosen is not None:
        return LENGTH.chosen.si, LENGTH.chosen.name
    return next((unit for unit in LENGTH_UNITS if size >= 0.2 * unit[0]), LENGTH_UNITS[-1])


def draw_stops(ax: Axes, scene: Scene, unit: float, *, vertical: bool) -> None:
    """Draw the stops as grey bands; the view is widened where it does not reach them."""
    draw_stop_bands(ax, scene.expanded.impact_pairs, unit, vertical=vertical)


def draw_stop_bands(ax: Axes, pairs: Iterable[ImpactPair], unit: float, *, vertical: bool) -> None:
    """Draw the stops of these pairs as grey bands, at their positions (m) divided by `unit`."""
    limits, span, set_limits = (
        (ax.get_xlim, ax.axvspan, ax.set_xlim)
        if vertical
        else (ax.get_ylim, ax.axhspan, ax.set_ylim)
    )
    stops = [
        (position / unit, side)
        for pair in pairs
        for position, side in ((pair.lower, -1.0), (pair.upper, 1.0))
        if position is not None
    ]
    low, high = limits()
    margin = 0.08 * (high - low)
    for place, side in stops:
        low = min(low, place - margin) if side < 0.0 else low
        high = max(high, place + margin) if side > 0.0 else high
    for place, side in stops:
        edges = (low, place) if side < 0.0 else (place, high)
        span(*edges, color=COLOURS["stop"], alpha=0.35, linewidth=0)
    set_limits(low, high)


def thinned(t: Vector, x: Vector, most: int = MOST_POINTS) -> tuple[Vector, Vector]:
    """A curve of at most about `most` points that reaches as far up and down as the whole one.

    A longer curve is divided into groups of neighbours. The smallest and the largest value of each
    group are drawn in the order of time, so no peak is lost.

    >>> x = np.zeros(10_000)
    >>> x[1234] = 7.0
    >>> times, values = thinned(np.arange(10_000.0), x, most=100)
    >>> len(values), float(values.max()), float(times[values.argmax()])
    (100, 7.0, 1234.0)
    """
    group = -(-len(x) // (most // 2))
    if group <= 2:
        return t, x
    whole = len(x) // group * group
    blocks = x[:whole].reshape(-1, group)
    ends = np.sort(np.stack([blocks.argmin(axis=1), blocks.argmax(axis=1)], axis=1), axis=1)
    places = (ends + np.arange(0, whole, group)[:, None]).ravel()
    if whole < len(x):
        rest = x[whole:]
        places = np.append(places, whole + np.sort([rest.argmin(), rest.argmax()]))
    return t[places], x[places]


def around_shock(time: Vector, x: Vector, shock: float | None) -> slice:
    """The samples to draw of a motion (m) that would be a comb as a whole: some mean periods around
    its shock, at the time `shock` (s), or around its largest size where that is None.

    >>> t = np.arange(10_000) / 100.0
    >>> part = around_shock(t, np.sin(2.0 * np.pi * t), 50.0)
    >>> float(t[part][0].round(1)), float(t[part][-1].round(1))
    (39.9, 60.1)
    """
    away = x - x.mean()
    turns = max(1, int(np.count_nonzero(np.diff(np.signbit(away)))) // 2)
    number = min(len(x), -(-EXCERPT_PERIODS * len(x) // turns))
    middle = int(np.argmax(np.abs(away)) if shock is None else np.searchsorted(time, shock))
    first = min(max(0, middle - number // 2), len(x) - number)
    return slice(first, first + number)


def seconds_of(part: slice, time: Vector) -> str:
    """Label of the axis of time of an excerpt of samples: which part of the whole it is."""
    whole = len(time) <= part.stop - part.start
    return (
        f"time ({TIME})" if whole else f"time ({TIME}), a part of {TIME.text(time[-1] - time[0])}"
    )


def plain_ticks(ax: Axes) -> None:
    """Label logarithmic axes by plain numbers, few enough that they do not collide."""
    from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter

    for axis in (ax.xaxis, ax.yaxis):
        low, high = sorted(axis.get_view_interval())
        if axis.get_scale() == "log" and low >= PLAIN_NUMBERS[0] and high <= PLAIN_NUMBERS[1]:
            axis.set_major_formatter("{x:g}")
            axis.set_minor_formatter(NullFormatter())
            if high < LESS_THAN_A_DECADE * low:
                axis.set_major_locator(MaxNLocator(FEW_TICKS))
            elif high < FEW_DECADES * low:
                axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))


def label_for_page(ax: Axes, x: str, y: str, *, legend: bool = True) -> None:
    """Label the axes of a picture on a page, with a grid and a legend above the picture."""
    plain_ticks(ax)
    ax.set_xlabel(x)
    ax.set_ylabel(y)
    add_grid(ax)
    ax.set_axisbelow(True)
    if legend:
        ax.legend(frameon=False, fontsize="small", loc="lower center", bbox_to_anchor=(0.5, 1.0),
                  ncols=LEGEND_COLUMNS)  # fmt: skip


def legend_above(ax: Axes) -> None:
    """The legend above the Axes of bars, where it hides none of them."""
    ax.legend(
        frameon=False, fontsize="small", loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3
    )
