"""What all pictures share. Chapters: colours; styles; axes, units, stops, grid and legend; charts
with described scales."""

from __future__ import annotations

import itertools
import textwrap
from collections.abc import Callable, Collection, Iterator, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, Self

import numpy as np

from stochvi.mathematics.numerics import Vector
from stochvi.mathematics.units import LENGTH, NUMBER, TIME, ShownQuantity, Size
from stochvi.results.base import DataFrame
from stochvi.results.estimates import GAUSSIAN_95

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.text import Text

    from stochvi.scenes.scene import Scene


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
# The styles of pictures: that of a screen, as they are drawn, and that of a paper.
# ------------------------------------------------------------------------------


STYLES: dict[str, dict[Any, Any]] = {
    "screen": {},
    "paper": {
        "figure.dpi": 200.0, "font.size": 8.0, "axes.titlesize": 8.0, "axes.linewidth": 0.5,
        "xtick.labelsize": 7.0, "ytick.labelsize": 7.0, "xtick.major.width": 0.5,
        "ytick.major.width": 0.5, "xtick.minor.width": 0.3, "ytick.minor.width": 0.3,
        "legend.fontsize": 7.0, "legend.handlelength": 2.2, "legend.handletextpad": 0.5,
        "legend.columnspacing": 1.0, "legend.borderpad": 0.2, "legend.labelspacing": 0.3,
    },
}  # fmt: skip
"""Settings of matplotlib while a picture is drawn, by the name of its style."""

COLUMN, HEADROOM, THINNER = 3.35, 0.6, 0.6
"""Width of a column of a paper (85 mm) and height that its larger letters need, inches; lines and
marks of a paper by those on a screen."""

NO_BREAK = "\u00a0%"
"""What stands for per cent while lines are broken: its number stays with it."""

SPARE_LETTERS = 5
"""Letters by which a line of a broken label may be longer than the mean of its lines."""

DASHES: tuple[Any, ...] = ("-", "-.", ":", (0, (4, 1, 1, 1, 1, 1)), (0, (8, 2)), (0, (1, 3)))
"""Styles of lines that differ in colour, in a paper. Dashes of equal length are left to pictures,
which use them with a meaning."""


def in_style(style: str, draw: Callable[[], Axes], given: Axes | None = None) -> Axes:
    """What `draw` draws, in a style by its name. Of Axes that were given, what they held before
    stays as it is, and their figure keeps its size.

    >>> in_style("poster", lambda: axes_or_new(None))
    Traceback (most recent call last):
    ValueError: style must be 'screen' or 'paper', got 'poster'
    """
    if style not in STYLES:
        raise ValueError(f"style must be {' or '.join(map(repr, STYLES))}, got {style!r}")
    import matplotlib as mpl

    before = set() if given is None else set(given.get_children())
    with mpl.rc_context(STYLES[style]):
        ax = draw()
        if style == "paper" and given is None:
            figure: Any = ax.get_figure(root=True)
            _to_column(figure)
            _thin(figure.axes, before)
            figure.draw_without_rendering()
            for each in figure.axes:
                _wrap_labels(each)
        elif style == "paper":
            _thin([ax], before)
    return ax


def _to_column(figure: Figure) -> None:
    """Give a figure the width of one column of a paper, or of two where panels stand side by side;
    its title goes, and legends that are wider get one column."""
    width, height = figure.get_size_inches()
    specs = [each.get_subplotspec() for each in figure.axes]
    wide = COLUMN * min(2, max(each.get_gridspec().ncols for each in specs if each))
    figure.set_size_inches(wide, wide * height / width + HEADROOM)
    figure.suptitle("")
    for ax in figure.axes:
        legend = ax.get_legend()
        if legend is not None and legend.get_window_extent().width > figure.bbox.width:
            handles: Sequence[Any] = ax.get_legend_handles_labels()[0]
            words = legend.get_texts()
            if len(handles) != len(words):
                handles = legend.legend_handles
            legend_above(ax, 1, handles=handles, labels=[each.get_text() for each in words])


def _thin(panels: Sequence[Axes], before: Collection[Artist]) -> None:
    """Make lines and marks thin; lines that differ in colour differ in their dashes then too. Of
    one panel the title goes."""
    from matplotlib.colors import to_hex
    from matplotlib.lines import Line2D
    from matplotlib.patches import StepPatch

    if len(panels) == 1:
        panels[0].set_title("")
    figure: Any = panels[0].get_figure(root=True)
    legends = [each for each in [*figure.legends, *(p.get_legend() for p in panels)] if each]
    drawn = [part for each in panels for part in (*each.lines, *each.patches, *each.collections)]
    parts: list[Any] = [each for each in drawn if each not in before]
    for legend in legends:
        parts += legend.legend_handles
        legend.set_title(None)
    solid = {
        part: to_hex(part.get_color() if isinstance(part, Line2D) else part.get_edgecolor())
        for part in parts
        if isinstance(part, Line2D | StepPatch) and part.get_linestyle() in ("-", "solid")
    }
    named = [colour for part, colour in solid.items() if str(part.get_label())[:1] not in "_"]
    dashes = dict(zip(dict.fromkeys(named), itertools.cycle(DASHES)))
    for part, colour in solid.items():
        part.set_linestyle(dashes.get(colour, "-"))
    for part in parts:
        part.set_linewidth(THINNER * np.asarray(part.get_linewidth()))
        if isinstance(part, Line2D):
            part.set_markersize(THINNER * part.get_markersize())


def _wrap_labels(ax: Axes) -> None:
    """Break the labels and the title of Axes that are longer than these, into lines of about one
    length; other scales of theirs count too."""
    room = ax.get_window_extent()
    wide = [ax.title, *(each.xaxis.label for each in (ax, *ax.child_axes))]
    for text, side in (*((each, "width") for each in wide), (ax.yaxis.label, "height")):
        words, most = text.get_text(), getattr(room, side)
        length = getattr(text.get_window_extent(), side)
        if length > most:
            letters = max(8, int(max(map(len, words.splitlines())) * most / length))
            words = " ".join(words.split()).replace(" %", NO_BREAK)
            lines = -(-len(words) // letters)
            words = textwrap.fill(words, min(letters, len(words) // lines + SPARE_LETTERS))
            text.set_text(words.replace(NO_BREAK, " %"))


# ------------------------------------------------------------------------------
# Parts that all pictures share: axes, units of length, the stops, the grid and the legend.
#
# matplotlib is imported where the first picture is drawn: a report may have none.
# ------------------------------------------------------------------------------


LENGTH_UNITS = ((1.0, "m"), (1e-3, "mm"), (1e-6, "µm"))
"""Units of length that axes may have: length of the unit in metres, and its name."""

SCREEN, PAGE, TALL = (6.4, 4.0), (5.2, 3.5), (5.2, 4.0)
"""Sizes of figures in inches: for a screen, and two for half the width of a page, where letters of
10 points read well on a telephone too."""

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

LETTERS_OF_AN_INCH, LEAST_LETTERS = 14, 10
"""Number of letters in an inch of a label, of a usual size, and least number in its lines."""

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
    """Put a title above that of the figure that holds these axes."""
    figure = ax.get_figure(root=True)
    assert figure is not None
    figure.suptitle("\n".join(filter(None, (title, figure.get_suptitle()))), fontsize="medium")
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


def legend_above(ax: Axes, columns: int = 3, **more: Any) -> None:
    """The legend above Axes, where it hides nothing."""
    # above the label of a second scale, the distance is one of letters
    more |= {"borderaxespad": 5.0} if ax.child_axes else {}
    more |= {"frameon": False, "fontsize": "small", "loc": "lower center"}
    ax.legend(bbox_to_anchor=(0.5, 1.0), ncols=columns, **more)


# ------------------------------------------------------------------------------
# Charts: axes with described scales, on which everything is drawn in SI numbers.
# ------------------------------------------------------------------------------


class Scale(NamedTuple):
    """What an axis shows: the words and the quantity of a number, and whether it is logarithmic."""

    words: str
    quantity: ShownQuantity = NUMBER
    log: bool = False

    @property
    def label(self) -> str:
        """The words with the unit that is shown."""
        return self.quantity.heading(self.words)


FREQUENCY = Scale("frequency", ShownQuantity("frequency", Size("Hz", 1.0)), log=True)


def time_of(part: slice, time: Vector) -> Scale:
    """The scale of an excerpt of samples: which part of the whole it is."""
    start, end, _ = part.indices(len(time))
    whole = len(time) <= end - start
    return Scale("time" if whole else f"time, a part of {TIME.text(time[-1] - time[0])}", TIME)


def length_of(size: float) -> ShownQuantity:
    """Lengths of this size: in the chosen unit, or in one that reads well."""
    if LENGTH.chosen is not None:
        return LENGTH
    unit, name = next((each for each in LENGTH_UNITS if size >= 0.2 * each[0]), LENGTH_UNITS[-1])
    return ShownQuantity("length", Size(name, unit))


def density_of(quantity: ShownQuantity, *, log: bool = False) -> Scale:
    """The probability density of a quantity."""
    inverse = Size(quantity.inverse, 1.0 / quantity.shown.si)
    return Scale("probability density", ShownQuantity("density", inverse), log)


class Chart(NamedTuple):
    """Axes whose scales know their words and units.

    What is drawn is given in SI units, with a label for the legend and a colour, or the name of one
    in `COLOURS`. Bounds, where they are given, become a band of a curve and bars of points.
    """

    ax: Axes
    x: Scale
    y: Scale

    @classmethod
    def on(cls, ax: Axes | None, x: Scale, y: Scale, size: tuple[float, float] = SCREEN) -> Self:
        """A chart in the axes that are given, or in those of a new figure."""
        return cls(axes_or_new(ax, size), x, y)

    def curve(
        self, x: Any, y: Any, label: str | None = None, colour: Any = "simulate", style: Any = "-",
        *, low: Any = None, high: Any = None, **more: Any,
    ) -> None:  # fmt: skip
        """A line with a band between its bounds; a mark where it has one point alone."""
        colour, places = COLOURS.get(colour, colour), self.x.quantity(x)
        if low is not None:
            self.band(x, low, high, colour)
        if len(np.atleast_1d(places)) == 1:
            more.setdefault("marker", "o")
        self.ax.plot(places, self.y.quantity(y), ls=style, color=colour, label=label, **more)

    def band(self, x: Any, low: Any, high: Any, colour: Any, label: str | None = None) -> None:
        """The range between two curves."""
        self.ax.fill_between(
            self.x.quantity(x), self.y.quantity(low), self.y.quantity(high), linewidth=0,
            color=COLOURS.get(colour, colour), alpha=BAND_ALPHA, label=label,
        )  # fmt: skip

    def points(
        self, x: Any, y: Any, label: str | None = None, colour: Any = "simulate", form: str = "o",
        *, low: Any = None, high: Any = None, **more: Any,
    ) -> None:  # fmt: skip
        """Marks with bars between their bounds."""
        middle, bars = self.y.quantity(y), None
        if low is not None:
            reach = middle - self.y.quantity(low), self.y.quantity(high) - middle
            bars = np.maximum(reach, 0.0).reshape(2, -1)
        look = {"capsize": 3.0, "markersize": 4.5, "color": COLOURS.get(colour, colour)} | more
        self.ax.errorbar(self.x.quantity(x), middle, bars, fmt=form, label=label, **look)

    def column(
        self, table: DataFrame, x: str, y: str, label: str | None = None,
        colour: Any = "simulate", form: str = "-", **more: Any,
    ) -> None:  # fmt: skip
        """A column of a table over another one, with the bounds that stand in columns beside it: as
        marks where `form` is one of a mark, else as a curve."""
        marks = form.strip("-:.") != ""
        draw = self.points if marks else self.curve
        draw(table[x], table[y], label, colour, form, **bounds_of(table, y), **more)

    def stairs(
        self, edges: Any, heights: Any, label: str | None = None, colour: Any = "simulate",
        *, low: Any = 0.0, **more: Any,
    ) -> None:  # fmt: skip
        """Heights over bins, filled down to `low` where it is asked for."""
        of_bins = {"baseline": self.y.quantity(low), "color": COLOURS.get(colour, colour)}
        self.ax.stairs(
            self.y.quantity(heights), self.x.quantity(edges), label=label, **of_bins | more
        )

    def bar(
        self, row: float, low: float, high: float, label: str | None = None,
        colour: Any = "simulate", **more: Any,
    ) -> None:  # fmt: skip
        """A bar in a row of a list."""
        start, end = self.x.quantity(low), self.x.quantity(high)
        look = {"height": 0.5, "color": COLOURS.get(colour, colour)} | more
        self.ax.barh(row, end - start, left=start, label=label, **look)

    def across(
        self, row: float, value: float | None, low: float | None, high: float | None,
        label: str | None = None, colour: Any = "simulate",
    ) -> None:  # fmt: skip
        """A value with its interval in a row of a list; without a value an arrow at the one bound
        that is known."""
        look = {"color": COLOURS.get(colour, colour), "label": label}
        if value is None:
            limit, arrow = (low, ">") if high is None else (high, "<")
            self.ax.plot(self.x.quantity(limit), row, arrow, markersize=8, **look)
            return
        middle = self.x.quantity(value)
        ends = (value if low is None else low, value if high is None else high)
        bars = np.abs(self.x.quantity(ends) - middle).reshape(2, 1)
        self.ax.errorbar(middle, row, xerr=bars, fmt="o", capsize=3, **look)

    def stop(self, row: float, place: float) -> None:
        """A stop in a row of a list."""
        there = [self.x.quantity(place)] * 2
        self.ax.plot(there, [row - 0.4, row + 0.4], color=COLOURS["stop"], lw=4, label="stop")

    def at(
        self, place: float, label: str | None = None, colour: Any = "stop", style: Any = "-",
        **more: Any,
    ) -> None:  # fmt: skip
        """A vertical line."""
        look = {"color": COLOURS.get(colour, colour), "linestyle": style, "linewidth": 1.2} | more
        self.ax.axvline(self.x.quantity(place), label=label, **look)

    def level(
        self, height: float, label: str | None = None, colour: Any = "stop", style: Any = "-",
        **more: Any,
    ) -> None:  # fmt: skip
        """A horizontal line."""
        look = {"color": COLOURS.get(colour, colour), "linestyle": style, "linewidth": 1.0} | more
        self.ax.axhline(self.y.quantity(height), label=label, **look)

    def note(
        self, words: str, x: float, y: float, shift: tuple[float, float] = (4.0, 4.0), **look: Any
    ) -> None:
        """Words beside a point, so many points of print away."""
        place = self.x.quantity(x), self.y.quantity(y)
        look = {"textcoords": "offset points", "fontsize": "small"} | look
        self.ax.annotate(words, place, shift, **look)

    def walls(self, scene: Scene) -> None:
        """The stops of a scene as grey bands; the view is widened where it does not reach them."""
        stops = [
            (self.x.quantity(getattr(pair, side)), side)
            for pair in scene.expanded.impact_pairs
            for side, _ in pair.stops()
        ]
        low, high = self.ax.get_xlim()
        margin = 0.08 * (high - low)
        low = min([low, *(at - margin for at, side in stops if side == "lower")])
        high = max([high, *(at + margin for at, side in stops if side == "upper")])
        for at, side in stops:
            edges = (low, at) if side == "lower" else (at, high)
            self.ax.axvspan(*edges, color=COLOURS["stop"], alpha=0.35, linewidth=0)
        self.ax.set_xlim(low, high)

    def above(self, scale: Scale, factor: float) -> None:
        """A second scale above the axes: x in SI units, times a factor."""
        unit = self.x.quantity.shown.si * factor / scale.quantity.shown.si
        top = self.ax.secondary_xaxis(
            "top", functions=(lambda x: np.asarray(x) * unit, lambda x: np.asarray(x) / unit)
        )
        top.set_xlabel(scale.label)

    def finish(self, columns: int = LEGEND_COLUMNS, **legend: Any) -> Axes:
        """The axes with scales, labels, a grid, and a legend of what has a label, above, in so many
        columns; none without columns."""
        ax = self.ax
        ax.set(**{f"{axis}scale": "log" for axis in "xy" if getattr(self, axis).log})
        plain_ticks(ax)
        add_grid(ax)
        ax.set_axisbelow(True)
        ax.set_xlabel(self.x.label)
        letters = int(LETTERS_OF_AN_INCH * ax.get_window_extent().height / ax.figure.dpi)
        lines = [line.strip() for line in self.y.label.splitlines()]
        ax.set_ylabel("\n".join(textwrap.fill(each, max(letters, LEAST_LETTERS)) for each in lines))
        shown: dict[str, Any] = {}
        for handle, label in zip(*ax.get_legend_handles_labels(), strict=True):
            shown.setdefault(label, handle)
        if shown and columns:
            named = {"labels": [*shown], "handles": [*shown.values()]}
            legend_above(ax, columns, **named | legend)
        return ax


def bounds_of(table: DataFrame, name: str) -> dict[str, Any]:
    """The 95 % bounds of a column of a table, where other columns hold them or its standard
    error."""
    if f"{name}_low" in table:
        return {"low": table[f"{name}_low"], "high": table[f"{name}_high"]}
    if f"{name}_error" in table:
        half = GAUSSIAN_95 * table[f"{name}_error"]
        return {"low": table[name] - half, "high": table[name] + half}
    return {}


def listed(ax: Axes | None, names: Sequence[str], x: Scale, row: float = 0.3) -> Chart:
    """A chart with a named row for each entry, the first one above; `row` is a height, inches."""
    found = Chart.on(ax, x, Scale(""), (SCREEN[0], 1.4 + row * max(len(names), 1)))
    found.ax.set_yticks(range(len(names)), names, fontsize="small")
    found.ax.set_ylim(len(names) - 0.4, -0.6)
    return found


def panels(
    ax: Axes | None, draw: Sequence[Callable[[Axes], Any]], size: tuple[float, float],
    title: str = "", columns: int = 1, **how: Any,
) -> Axes:  # fmt: skip
    """Draw panels in rows of so many columns; one column shares its scale. In axes that are given,
    the first panel alone. Returns the first Axes."""
    if ax is not None:
        draw[0](ax)
        return ax
    import matplotlib.pyplot as plt

    how = {"sharex": columns == 1} | how
    figure, grid = plt.subplots(
        -(-len(draw) // columns), columns, figsize=size, squeeze=False, layout="constrained", **how
    )
    for number, panel in enumerate(grid.flat):
        if number >= len(draw):
            panel.remove()
            continue
        draw[number](panel)
        if how["sharex"] and number + columns < len(draw):
            panel.set_xlabel("")
        elif how["sharex"]:  # there may be none below that shows the numbers
            panel.tick_params(labelbottom=True)
        if how.get("sharey") and number % columns:
            panel.set_ylabel("")
    figure.suptitle(title, fontsize="medium")
    first: Axes = grid[0, 0]
    return first
