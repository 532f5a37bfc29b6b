"""Table and picture of the law of a stop that a test shows."""

from __future__ import annotations

from typing import TYPE_CHECKING

from matplotlib.axes import Axes

from stochvi.mathematics.shown_units import FORCE, LENGTH, MILLISECONDS, SPEED, shown_as
from stochvi.views.axes import add_grid
from stochvi.views.colours import COLOURS, OWNERS
from stochvi.views.tables import print_frame, value_with_error

if TYPE_CHECKING:
    import pandas as pd
    from rich.console import Console

    from stochvi.identification import Identification

PLACES = {
    "restitution": ("speed of approach", SPEED),
    "force": ("deflection", LENGTH),
    "acceleration": ("time", MILLISECONDS),
}
"""The abscissa by what was observed."""

STYLES = ("-", "--", "-.", ":")
"""Styles of the lines of laws, in their order."""

MOST_LINES = 4
"""Largest number of laws that a picture shows: those of the smallest criteria."""


def print_identification(console: Console, found: Identification) -> None:
    """Print the law to take, the line to copy, and all laws that were fitted."""
    console.print(found.summary(), style="bold", highlight=False)
    console.print(found.line, highlight=False, markup=False)
    print_frame(
        console, laws_table(found),
        "laws; rejected below 0.05: the probability of so bad a fit if the law were true",
    )  # fmt: skip
    for name, each in found.of_test.items():
        quantity = shown_as(found.test.start[name][1])
        console.print(f"{name}: {value_with_error(quantity(each))} {quantity}", highlight=False)
    for assumption in found.assumptions:
        console.print(f"assumed: {assumption}", highlight=False)
    for warning in found.warnings:
        console.print(f"note: {warning}", style="yellow", highlight=False)


def laws_table(found: Identification) -> pd.DataFrame:
    """One row per law, with its numbers as text."""
    import pandas as pd

    rows = [
        {
            "law": name,
            "numbers": ", ".join(
                f"{key} {value_with_error(each)} {fit.units[key]}".rstrip()
                for key, each in fit.numbers.items()
            ),
            "residual": fit.residual,
            "AICc": fit.criterion,
            "rejected": None if fit.rejected is None else f"{fit.rejected:.2g}",
        }
        for name, fit in found.fits.items()
    ]
    return pd.DataFrame(rows).fillna("-")


def plot_identification(found: Identification, ax: Axes | None = None) -> Axes:
    """What was observed with the laws that fit best, and below it the residuals of the law to take.

    The record of a drop also has its force over the deflection. Given axes get the first panel."""
    if ax is not None:
        return _draw_laws(found, ax)
    import matplotlib.pyplot as plt

    columns = 1 if found.loop is None else 2
    figure, axes = plt.subplots(
        2, columns, figsize=(5.6 * columns, 4.8), layout="constrained", squeeze=False,
    )  # fmt: skip
    _draw_laws(found, axes[0, 0])
    _draw_residuals(found, axes[1, 0])
    if found.loop is not None:
        for each in axes[:, 1]:
            each.remove()
        _draw_loop(found, figure.add_subplot(axes[0, 1].get_gridspec()[:, 1]))
    return axes[0, 0]  # type: ignore[no-any-return]


def _draw_laws(found: Identification, ax: Axes) -> Axes:
    (words_of_place, place), quantity = PLACES[found.test.word], shown_as(found.test.unit)
    table = found.curve.sort_values("place")
    ax.plot(place(table["place"]), quantity(table["observed"]), "o", markersize=3,
            color=COLOURS["exact"], label="measured")  # fmt: skip
    names = sorted(found.fits, key=lambda name: found.fits[name].criterion)[:MOST_LINES]
    if found.chosen not in names:
        names[-1] = found.chosen
    for name, colour, style in zip(names, OWNERS, STYLES, strict=False):
        words = f"{name} (to take)" if name == found.chosen else name
        ax.plot(place(table["place"]), quantity(table[name]), style, color=colour, label=words)
    ax.set_ylabel(quantity.heading(found.test.word))
    ax.set_xlabel(place.heading(words_of_place))
    if found.test.word == "restitution":
        ax.set_xscale("log")
    ax.legend(fontsize="small")
    add_grid(ax)
    return ax


def _draw_residuals(found: Identification, ax: Axes) -> None:
    words, place = PLACES[found.test.word]
    table = found.curve
    left = shown_as(found.test.unit)(table["observed"] - table[found.chosen])
    ax.plot(place(table["place"]), left, "o", markersize=3, color=COLOURS["simulate"])
    ax.axhline(0.0, color="black", linewidth=0.8)
    ax.set_ylabel("measured - law")
    ax.set_xlabel(place.heading(words))
    if found.test.word == "restitution":
        ax.set_xscale("log")
    add_grid(ax)


def _draw_loop(found: Identification, ax: Axes) -> None:
    loop = found.loop
    assert loop is not None
    ax.plot(LENGTH(loop["deflection"]), FORCE(loop["force"]), "o", markersize=3,
            color=COLOURS["exact"], label="record, integrated")  # fmt: skip
    ax.plot(LENGTH(loop["deflection"]), FORCE(loop["law"]), color=COLOURS["simulate"],
            label="law on that motion")  # fmt: skip
    ax.set_xlabel(f"deflection ({LENGTH})")
    ax.set_ylabel(f"force ({FORCE})")
    ax.legend(fontsize="small")
    add_grid(ax)
