"""The risk of a production: in words and tables, and as a picture."""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING

import numpy as np

from stochvi.isolators.sizing.answer import spoken_mission, spoken_percent
from stochvi.mathematics.shown_units import LENGTH
from stochvi.results.estimates import Estimate
from stochvi.views.axes import PAGE, axes_or_new, length_unit
from stochvi.views.colours import CLEARANCES, COLOURS
from stochvi.views.tables import print_frame, print_line, value_with_error
from stochvi.views.words import four_digits, spoken_length

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from rich.console import Console

    from stochvi.isolators.production_risk.answer import Production

LABEL_WIDTH = 26
"""Largest number of letters in a line of a label."""

LEAST_PROBABILITY = 1e-9
"""Smallest probability that the picture shows."""

SHOWN_SHARES = (0.05, 0.5, 0.95, 0.99)
"""Shares of the units whose risk the tables show."""


def print_production(console: Console, found: Production) -> None:
    """Print the risk of a production, what its tolerances cost, and how the units differ."""
    for line in risk_in_words(found):
        print_line(console, line)
    print_frame(console, tolerances_in_rows(found), COSTS)
    print_frame(console, units_in_rows(found), units_heading(found))
    print_line(console, f"method of the production: {found.method}")


def risk_in_words(found: Production) -> list[str]:
    """The mean risk with its interval, that of a unit as stated, the share of units above the
    target, and the tolerance that costs most."""
    low, high = map(spoken_percent, found.interval)
    mean = f"mean over the production: {spoken_percent(found.probability.value)} ({low} to {high}, "
    lines = [
        f"{mean}95 %); a unit as stated has, with the same clearances, "
        f"{spoken_percent(found.probability_as_stated)}"
    ]
    if found.share_above is not None and found.target is not None:
        lines.append(
            f"{100.0 * found.share_above.value:.3g} % of the units have a probability above "
            f"{spoken_percent(found.target)}"
        )
    if found.target is not None:
        places = [
            f"{spoken_length(place.value)} ({four_digits(LENGTH(place.lower))} to "
            f"{spoken_length(place.upper)}, 95 %) instead of "
            f"{spoken_length(found.stated[name])}"
            + (f" for {name}" if len(found.clearances) > 1 else "")
            for name, place in found.clearances.items()
        ]
        lines.append(f"the production needs {', '.join(places)}")
    return [*lines, *filter(None, [found.dearest()])]


COSTS = "what each tolerance costs: clearance, and share of its variance between units"
"""Heading of the table of tolerances."""


def tolerances_in_rows(found: Production) -> pd.DataFrame:
    """A row per tolerance: the clearance that it costs (mm), and its shares of variance (%)."""
    import pandas as pd

    table = found.tolerances
    columns: dict[str, list[str]] = {
        "tolerance": list(table["tolerance"]),
        f"costs ({LENGTH})": [f"{LENGTH(each):.3g}" for each in table["clearance_cost"]],
    }
    for name, heading in (("first_order", "alone (%)"), ("total", "with others (%)")):
        pairs = zip(table[name], table[f"{name}_error"], strict=True)
        columns[heading] = [
            value_with_error(Estimate(value=100.0 * share, standard_error=100.0 * error))
            for share, error in pairs
        ]
    return pd.DataFrame(columns)


def units_heading(found: Production) -> str:
    """Heading of the table of units."""
    return f"units from the best to the worst: probability of any impact in {_mission(found)}"


def units_in_rows(found: Production) -> pd.DataFrame:
    """A row per share of the units: their largest risk, and what they would need themselves."""
    import pandas as pd

    table = found.units[found.units["share_of_units"].isin(SHOWN_SHARES)]
    return pd.DataFrame(
        {
            "share of units": [f"{100.0 * each:.3g} %" for each in table["share_of_units"]],
            "at most": [spoken_percent(each) for each in table["probability"]],
            f"would need ({LENGTH})": [four_digits(LENGTH(each)) for each in table["clearance"]],
        }
    )


def _mission(found: Production) -> str:
    return spoken_mission(found.mission)


def plot_production(found: Production, ax: Axes | None = None) -> Axes:
    """The units by their risk; beside them, in a figure of its own, what each tolerance costs."""
    if ax is None:
        import matplotlib.pyplot as plt

        ax, beside = plt.subplots(
            1, 2, width_ratios=[1.3, 1.0], figsize=(9.6, 4.0), layout="constrained"
        )[1]
        plot_costs(found, beside)
    return plot_units(found, ax)


def plot_units(found: Production, ax: Axes | None = None) -> Axes:
    """The share of the units below each probability of an impact, with the mean over the production
    and a unit as stated."""
    ax = axes_or_new(ax, PAGE)
    table = found.units[found.units["probability"] > LEAST_PROBABILITY]
    ax.plot(
        table["probability"], 100.0 * table["share_of_units"], "o-", markersize=4,
        color=COLOURS["simulate"],
    )  # fmt: skip
    marks = [
        ("mean over the production", found.probability.value, COLOURS["linearise:closure"], "-"),
        ("a unit as stated", found.probability_as_stated, CLEARANCES["recommended"], "--"),
    ]
    for words, chance, colour, style in marks:
        ax.axvline(
            chance, color=colour, linestyle=style, linewidth=1.4,
            label=f"{words}: {spoken_percent(chance)}",
        )  # fmt: skip
    ax.set_xscale("log")
    ax.set_ylim(0.0, 103.0)
    ax.set_xlabel(f"probability of any impact of a unit in {_mission(found)}")
    ax.set_ylabel("units with at most this probability (%)")
    ax.legend(
        facecolor="white", edgecolor="none", framealpha=1.0, fontsize="small", loc="upper left"
    )
    ax.grid(alpha=0.4)
    return ax


def plot_costs(found: Production, ax: Axes | None = None) -> Axes:
    """The clearance that each tolerance costs."""
    ax = axes_or_new(ax, PAGE)
    rows = found.tolerances[::-1]
    unit, name = length_unit(float(np.max(np.abs(rows["clearance_cost"]))))
    ax.barh(
        # a number stays with its sign and unit
        [textwrap.fill(each.replace("± ", "±"), LABEL_WIDTH) for each in rows["tolerance"]],
        rows["clearance_cost"] / unit, height=0.55, color=COLOURS["linearise:force"],
    )  # fmt: skip
    ax.tick_params(axis="y", labelsize="small")
    ax.set_xlabel(f"clearance that it costs ({name})")
    ax.margins(x=0.12)
    return ax
