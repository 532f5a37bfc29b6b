"""Tables of isolators. Chapters: sizing of several pairs; the risk of a production; screening,
clearances and sizing; missions with phases, and ratios of damage."""

from __future__ import annotations

import math
import textwrap
from typing import TYPE_CHECKING

import numpy as np

from stochvi.isolators.sizing.answer import HITS_PER_FIRST_HIT, Probability
from stochvi.mathematics.units import LENGTH, RATE, SPEED, spoken_mission
from stochvi.results.estimates import GAUSSIAN_95, Estimate, spoken_percent
from stochvi.views.axes import (
    BAND_ALPHA,
    CLEARANCES,
    COLOURS,
    PAGE,
    add_grid,
    add_title,
    axes_or_new,
    legend_above,
    length_unit,
    owner_colours,
    plain_ticks,
)
from stochvi.views.statistics import print_damage
from stochvi.views.tables import (
    LAST_DIGITS,
    WITHOUT_TOLERANCES,
    Heading,
    chance_in_words,
    clearances_of_changes,
    four_digits,
    line_to_copy,
    new_table,
    places_of_stops,
    print_assumptions,
    print_frame,
    print_line,
    print_table,
    spoken_length,
    value_with_error,
    way_in_words,
    with_headings,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    import pandas as pd
    from matplotlib.axes import Axes
    from rich.console import Console

    from stochvi.isolators.jolt_response import Jolts
    from stochvi.isolators.production_risk import Production
    from stochvi.isolators.record_verdict import RecordVerdict
    from stochvi.isolators.screening import Screening
    from stochvi.isolators.sizing.answer import ClearanceAnswer, DamageSizing, MissionSizing, Sizing


# ------------------------------------------------------------------------------
# Sizing of several pairs: tables in words, and pictures.
# ------------------------------------------------------------------------------


def interval_in_words(chance: Probability) -> str:
    """The interval of a probability in per cent."""
    low = spoken_percent(chance.lower) if chance.lower > 0.0 else "0"
    return f"{low} to {spoken_percent(chance.upper)}"


def pairs_in_words(sizing: Sizing) -> pd.DataFrame:
    """A row per pair: its clearance with the interval, and its risk."""
    import pandas as pd

    rows = []
    for each in sizing.pairs.to_dict("records"):
        found = sizing.clearances.get(each["pair"])
        stops = [each[side] for side in ("lower", "upper") if each[side] == each[side]]
        rows.append(
            {
                "pair": each["pair"],
                f"clearance ({LENGTH})": " and ".join(
                    f"{LENGTH(d):.4g}" for d in dict.fromkeys(stops)
                ),
                "95 % interval": "fixed"
                if found is None
                else f"{LENGTH(found.lower):.4g} to {LENGTH(found.upper):.4g}",
                "in sigma": f"{each['clearance_in_sigma']:.3g}",
                f"3 sigma ({LENGTH})": f"{3.0 * LENGTH(each['sigma']):.4g}",
                "hit, if it alone had stops": spoken_percent(each["probability_alone"]),
                "of first impacts": f"{100.0 * each['share_of_first_hits']:.3g} %",
                "expected impacts": _known(each["expected_hits"]),
                f"mean speed ({SPEED})": _known(SPEED(each["impact_speed_mean"])),
            }
        )
    table = pd.DataFrame(rows)
    # columns without a known number are left out; a warning of the answer says why
    return table[[name for name in table if not (table[name] == UNSEEN).all()]]


def places_in_rows(sizing: Sizing) -> pd.DataFrame:
    """A row per sized pair: the clearance to make, and the stops as a scene file has them; these
    are left out where a record contradicts the noise for which they hold."""
    import pandas as pd

    table, made = sizing.placed(), sizing.rounded
    stops = {
        side: [f"{side} = {place:.9g}" if place == place else "none" for place in table[side]]
        for side in ("lower", "upper")
    }
    found = pd.DataFrame(
        {
            "pair": table["pair"],
            "clearance to make" if sizing.each_made else "clearance": [
                str(made[name]) for name in table["pair"]
            ],
            f"equilibrium ({LENGTH})": [
                f"{LENGTH(round(mean, NANOMETRES)) + 0.0:.4g}" for mean in table["mean_gap"]
            ],
            "in the scene file (m)": stops["lower"],
            "": stops["upper"],
        }
    )
    return found if sizing.each_made else found.iloc[:, :-2]


def places_heading(sizing: Sizing) -> str:
    """The heading of the table of places."""
    if sizing.doubtful is not None:
        return PLACES_FOR_NOISE
    return PLACES if sizing.each_made else PLACES_TRIED


NANOMETRES = 9
"""Number of digits behind the point of a mean gap in m; smaller digits are rounding error."""

PLACES = (
    "where the stops go: clearances count from the static equilibrium, rounded up; lower and "
    "upper, of a scene file, count from the unloaded mounts"
)
PLACES_FOR_NOISE = (
    "for Gaussian noise alone: clearances count from the static equilibrium, rounded up"
)
PLACES_TRIED = "tried, and not shown to keep the target"
"""Headings of the table of places: those to make; those for a record that does not agree with
Gaussian noise; those that are not shown to keep the target."""


UNSEEN = "unknown"
"""Cell of a table of pairs for a number that is not known."""


def _known(value: float) -> str:
    """A number with three digits; `UNSEEN` for NaN."""
    return f"{value:.3g}" if value == value else UNSEEN


def tolerances_in_rows(sizing: Sizing) -> pd.DataFrame:
    """A row per change: the clearance that each sized pair needs for the same risk (mm), and the
    probability of any impact at the calculated ones."""
    import pandas as pd

    table = sizing.tolerances
    return pd.DataFrame(
        {
            "change": table["change"],
            **{
                f"{name} ({LENGTH})": [four_digits(LENGTH(needed)) for needed in table[name]]
                for name in sizing.clearances
            },
            "probability of any impact": [
                spoken_percent(chance) for chance in table["probability"]
            ],
        }
    )


def worst_places(sizing: Sizing) -> list[str]:
    """Where within the tolerances each clearance is largest, pairs of one place together."""
    names: dict[str, list[str]] = {}
    for name, place in sizing.worst_at.items():
        names.setdefault(place, []).append(name)
    return [f"largest for {', '.join(each)}: {place}" for place, each in names.items()]


TOLERANCES = (
    "within the tolerances, by linear theory: clearances that each pair alone needs for the same "
    "risk; probability of any "
    "impact with those as stated; last, the largest of each column over the whole region"
)
"""Heading of the table of tolerances."""


def required_in_rows(sizing: Sizing) -> pd.DataFrame:
    """A row per sized pair: its clearance (mm) for other probabilities of any impact."""
    import pandas as pd

    asked = {
        f"{spoken_percent(row['probability'])} ({LENGTH})": row
        for row in sizing.required.to_dict("records")
    }
    names = list(sizing.clearances)
    return pd.DataFrame(
        {"pair": names}
        | {
            head: [four_digits(LENGTH(row[n])) if row[n] == row[n] else "none" for n in names]
            for head, row in asked.items()
        }
    )


def coordinates_in_rows(linear: Screening) -> pd.DataFrame:
    """A row per coordinate and point, with each number and its unit in one column; accelerations
    where they are known."""
    table = linear.to_frame()
    units = {
        "displacement": "unit",
        "velocity": "unit of velocity",
        "absolute acceleration": "unit of acceleration",
    }
    for name, unit in units.items():
        cells = zip(table[name].astype(float), table[unit], strict=True)
        table[name] = ["" if math.isnan(v) else f"{v:.4g} {words}" for v, words in cells]
    unknown = [name for name in units if not table[name].any()]
    return table.drop(columns=[*units.values(), *unknown])


def plot_pairs_risk(sizing: Sizing, ax: Axes | None = None) -> Axes:
    """Probability of any impact against the clearance of each pair, all of which change together.

    The dashed line takes the pairs for independent of each other.
    """
    ax = axes_or_new(ax, (6.8, 4.6))
    curve = sizing.curve
    unit, name = length_unit(max(each.value for each in sizing.clearances.values()))
    groups, any_hit = _alike(sizing), sizing.any_hit or math.nan
    for names, colour in zip(groups, owner_colours(len(groups)), strict=True):
        found, x = sizing.clearances[names[0]], curve[names[0]] / unit
        ax.fill_between(
            x, curve["probability_low"], curve["probability_high"], color=colour, alpha=0.2,
            linewidth=0,
        )  # fmt: skip
        ax.plot(
            x,
            curve["probability"],
            color=colour,
            label=f"{_joined(names)}: {found.value / unit:.4g} {name}",
        )
        ax.plot(x, curve["independent"], color=colour, linestyle="--", linewidth=0.9)
        ax.plot(found.value / unit, any_hit, "o", color=colour, zorder=3)
    ax.plot([], [], color="0.4", linestyle="--", linewidth=0.9, label="pairs taken for independent")
    ax.axhline(any_hit, color="0.5", linewidth=0.8)
    ax.set_yscale("log")
    ax.set_xlabel(f"clearance per side ({name})")
    ax.set_ylabel(f"probability of any impact in {spoken_mission(sizing.mission)}")
    add_grid(ax)
    ax.legend(
        frameon=False, fontsize="small", loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2
    )
    return ax


SAME_CURVE = 5e-3
"""Relative distance of two curves below which a picture shows them as one line."""

MOST_JOINED = 3
"""Largest number of names of pairs in one entry of a legend."""


def _alike(sizing: Sizing) -> list[list[str]]:
    """Names of the sized pairs, grouped where a picture cannot tell their curves apart."""
    groups: list[list[str]] = []
    for name in sizing.clearances:
        own = sizing.curve[name]
        for group in groups:
            if np.allclose(own, sizing.curve[group[0]], rtol=SAME_CURVE, atol=0.0):
                group.append(name)
                break
        else:
            groups.append([name])
    return groups


def _joined(names: list[str]) -> str:
    """Names in one entry of a legend, the last of many only counted."""
    if len(names) <= MOST_JOINED:
        return ", ".join(names)
    return f"{', '.join(names[: MOST_JOINED - 1])} and {len(names) - MOST_JOINED + 1} more"


def draw_pairs_risk(sizing: Sizing, title: str = "") -> Axes:
    """The risk against the clearances as a figure with a title."""
    return add_title(plot_pairs_risk(sizing), title or "clearances and risk")


def plot_pairs_clearances(sizing: Sizing, ax: Axes | None = None) -> Axes:
    """The clearance of each pair, the largest within the tolerances, and three sigma of its
    gap."""
    ax = axes_or_new(ax, (6.8, 0.9 + 0.42 * max(len(sizing.clearances), 3)))
    names = list(sizing.clearances)
    values = np.array([sizing.clearances[name].value for name in names])
    unit, unit_name = length_unit(float(values.max()))
    sigma = sizing.pairs.set_index("pair")["sigma"]
    rows = np.arange(len(names))
    worst = sizing.tolerances.iloc[-1]
    ax.barh(
        rows, values / unit, color=COLOURS["linearise:force"], height=0.5, label="as calculated"
    )
    if len(sizing.tolerances) > 1:
        more = [max(float(worst[n]) - v, 0.0) / unit for n, v in zip(names, values, strict=True)]
        ax.barh(
            rows, more, left=values / unit, color=COLOURS["linearise:force"], alpha=0.3,
            height=0.5, label="largest within the tolerances",
        )  # fmt: skip
    ax.plot(
        [3.0 * float(sigma[name]) / unit for name in names], rows, "o",
        color=COLOURS["linearise:closure"], label="3 sigma",
    )  # fmt: skip
    ax.set_yticks(rows, names)
    ax.invert_yaxis()
    ax.set_xlim(left=0.0)
    ax.set_xlabel(f"clearance per side ({unit_name})")
    legend_above(ax)
    return ax


# ------------------------------------------------------------------------------
# The risk of a production: in words and tables, and as a picture.
# ------------------------------------------------------------------------------


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
    print_frame(console, production_in_rows(found), COSTS)
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


def production_in_rows(found: Production) -> pd.DataFrame:
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


# ------------------------------------------------------------------------------
# Screening, clearances and sizing of isolators on a terminal.
# ------------------------------------------------------------------------------


def print_screening(console: Console, linear: Screening) -> None:
    """Print the verdict on a record, then the linear screening of coordinates and gaps with its
    notes."""
    print_record(console, linear.record)
    table = linear.to_frame() if len(linear.coordinates) == 1 else coordinates_in_rows(linear)
    print_frame(console, table, "linear screening, stops left out")
    if linear.impact_pairs:
        print_frame(console, linear.gaps_to_frame(), "gaps, and impacts by Rice")
    for note in linear.notes:
        console.print(f"note: {note}", style="yellow", highlight=False)


CONTRADICTED = "bold red"
"""Style of a verdict on a record that is not like Gaussian noise, or too short to tell."""


def print_record(console: Console, record: RecordVerdict | None, where: str = "") -> None:
    """Print whether a record moves the mount as Gaussian noise would; nothing without a record.

    `where` stands before it, such as the phase of the record.
    """
    if record is None:
        return
    style = None if record.agrees else CONTRADICTED
    console.print(f"{where}{record.sentence()}", style=style, highlight=False)


CLEARANCE_COLUMNS: dict[str, Heading] = {
    "pair": "pair",
    "clearance_in_sigma": "gap/sigma",
    "clearance": ("gap ()", LENGTH),
    "rice": ("Rice ()", RATE),
    "closure": ("closure", RATE),
    "simulated": ("Monte Carlo", RATE),
    "interval": "95 % interval",
    "impact_speed_mean": ("speed ()", SPEED),
}


def print_clearance(console: Console, curve: pd.DataFrame, notes: Sequence[str] = ()) -> None:
    """Print the impact rate against clearance, as `clearance_curve` returns it, and the notes on
    it."""
    limits = zip(curve["simulated_low"], curve["simulated_high"], strict=True)
    shown = curve.assign(interval=[f"{RATE(a):.3g} to {RATE(b):.3g}" for a, b in limits])
    print_frame(
        console,
        with_headings(shown, CLEARANCE_COLUMNS),
        f"impacts per {RATE.time} on both stops, and mean impact speed",
        {"gap/sigma": ".2f"},
    )
    for note in notes:
        console.print(f"note: {note}", style="yellow", highlight=False)


def print_sizing(console: Console, sizing: Sizing, sensitivity: pd.DataFrame | None = None) -> None:
    """Print the clearances to make first, then the numbers behind them, then what they rest on."""
    style = "bold" if sizing.doubtful is None else CONTRADICTED
    console.print(sizing.verdict(), style=style, highlight=False)
    if sizing.doubtful is None:
        print_record(console, sizing.record)
    if sizing.several:
        _print_pairs(console, sizing)
    else:
        _print_one(console, sizing)
    if sizing.production is not None:
        print_production(console, sizing.production)
    if sensitivity is not None:
        _print_changes(console, sensitivity, "one thing changed at a time")
    print_line(console, f"method: {sizing.method}")
    print_line(console, f"cost: {sizing.cost.wall_time:.3g} s on {sizing.cost.threads} threads")
    for warning in sizing.warnings:
        console.print(f"note: {warning}", style="yellow", highlight=False)


def _print_one(console: Console, sizing: Sizing) -> None:
    """Print where the stops go and the risk at three sigma, then the numbers behind both."""
    for line in places_of_stops(sizing).splitlines():
        print_line(console, line)
    print_line(console, sizing.calculated())
    _print_tolerances(console, sizing)
    if sizing.worst_case is not None:
        _print_changes(console, sizing.worst_case, "within the tolerances, each row sized anew")
    three, mission = sizing.three_sigma, spoken_mission(sizing.mission)
    table = new_table(
        f"at 3 sigma = {LENGTH.text(three.clearance)}, in {mission}", ["quantity", "value"]
    )
    table.add_row("probability of any impact", spoken_percent(three.probability.value))
    table.add_row("impacts by Rice", f"{three.rice_hits:.4g}")
    table.add_row("first impacts (clusters)", value_with_error(three.first_hits))
    if three.hits is not None:
        table.add_row("impacts, simulated", value_with_error(three.hits))
    if three.impact_speed_mean is not None:
        table.add_row(
            f"mean impact speed ({SPEED})", value_with_error(SPEED(three.impact_speed_mean))
        )
    print_table(console, table)
    print_line(console, LAST_DIGITS)
    limits = zip(sizing.required["clearance_low"], sizing.required["clearance_high"], strict=True)
    print_frame(
        console,
        with_headings(
            sizing.required.assign(
                probability=[spoken_percent(chance) for chance in sizing.required["probability"]],
                interval=[f"{LENGTH(low):.4g} to {LENGTH(high):.4g}" for low, high in limits],
            ),
            REQUIRED_COLUMNS,
        ),
        f"probability of any impact in {mission}",
    )
    _print_hits(console, sizing)


def _print_tolerances(console: Console, sizing: Sizing) -> None:
    """Say that nothing is taken to differ from the scene, where that is so."""
    if not sizing.varies:
        print_line(console, WITHOUT_TOLERANCES)


def _print_changes(console: Console, table: pd.DataFrame, title: str) -> None:
    """Print changed scenes with the clearance that each needs for the same target."""
    columns: dict[str, Heading] = {
        "change": "change",
        **clearances_of_changes(table),
        **CHANGE_COLUMNS,
    }
    shown = table.assign(
        clearance_change=[
            "not found" if math.isnan(c) else f"{100.0 * c:+.1f} %"
            for c in table["clearance_change"]
        ],
        probability=[
            "" if math.isnan(chance) else spoken_percent(chance) for chance in table["probability"]
        ],
    )
    print_frame(
        console,
        with_headings(shown, columns),
        f"{title}: clearance for the same target; probability with the clearance as stated",
    )
    for change, note in zip(table["change"], table["note"], strict=True):
        if note:
            print_line(console, f"{change}: {note}")


def _print_pairs(console: Console, sizing: Sizing) -> None:
    """Print where the stops of several pairs go, then the numbers behind them."""
    mission = spoken_mission(sizing.mission)
    print_frame(console, places_in_rows(sizing), places_heading(sizing))
    print_line(console, sizing.calculated())
    _print_tolerances(console, sizing)
    print_frame(console, pairs_in_words(sizing), f"pair by pair, as calculated, in {mission}")
    table = new_table(
        f"probability that any pair is hit in {mission}", ["stops", "probability", "95 % interval"]
    )
    known = {
        "as sized": sizing.probability,
        "3 sigma of every gap": Probability.of(sizing.three_sigma.probability),
        "of the scene": sizing.as_given,
    }
    for place, chance in known.items():
        if chance is not None:
            table.add_row(place, spoken_percent(chance.value), interval_in_words(chance))
    print_table(console, table)
    print_frame(
        console,
        required_in_rows(sizing),
        f"clearances for other probabilities of any impact in {mission}",
    )
    if len(sizing.tolerances) > 1:
        print_frame(console, tolerances_in_rows(sizing), TOLERANCES)
        for line in worst_places(sizing):
            print_line(console, line)


def _print_hits(console: Console, sizing: Sizing) -> None:
    """Print the impacts at 3 sigma and at the answer; other clearances were steps of the search."""
    if len(sizing.simulated):
        places = [sizing.three_sigma.clearance, sizing.clearance.value]
        table = sizing.simulated[sizing.simulated["clearance"].isin(places)]
        print_frame(
            console,
            with_headings(table.assign(by=table["by"].map(way_in_words)), HIT_COLUMNS),
            "impacts on all stops, with the stop law",
        )
        print_line(console, HITS_PER_FIRST_HIT)


REQUIRED_COLUMNS: dict[str, Heading] = {
    "probability": "probability",
    "clearance": ("clearance ()", LENGTH),
    "interval": "95 % interval",
    "clearance_in_sigma": "in sigma",
}


CHANGE_COLUMNS: dict[str, Heading] = {
    "clearance_change": "by",
    "probability": "probability of any impact",
}


HIT_COLUMNS: dict[str, Heading] = {
    "clearance": ("clearance ()", LENGTH),
    "clearance_in_sigma": "in sigma",
    "hit_rate": ("impacts ()", RATE),
    "hits_per_first_hit": "impacts per cluster",
    "impact_speed_mean": ("mean speed ()", SPEED),
    "by": "by",
}


JOLT_COLUMNS: dict[str, Heading] = {
    "jolt": ("jolt ()", SPEED),
    "captured": "captured",
    "captured_low": "95 % from",
    "captured_high": "to",
    "on_both_stops": "on both stops",
    "left_later": "left later",
}


def print_jolts(console: Console, found: Jolts) -> None:
    """Print whether jolts lead to clatter, and the shares of paths."""
    console.print(found.summary(), style="bold", highlight=False)
    title = f"shares of {found.paths} paths, watched for {found.duration:.3g} s"
    print_frame(console, with_headings(found.to_frame(), JOLT_COLUMNS), title)


# ------------------------------------------------------------------------------
# Clearances of missions with phases, and of a ratio of damage: tables and pictures.
# ------------------------------------------------------------------------------


def _print_clearance(console: Console, found: ClearanceAnswer) -> None:
    """Print the clearance to make, the line to copy, and the clearance that was calculated."""
    style = CONTRADICTED if found.doubtful else "bold"
    console.print(found.verdict(), style=style, highlight=False)
    if stops := found.stops_to_copy():
        print_line(console, line_to_copy(stops))
    print_line(console, found.calculated())
    print_line(console, WITHOUT_TOLERANCES)


def _mark(ax: Axes, found: ClearanceAnswer, label: str) -> None:
    """Mark the calculated clearance and, where a record does not agree with the noise for which it
    holds, what the record itself needs."""
    place, record = LENGTH(found.clearance.value), found.record
    if not found.doubtful or record is None:
        ax.axvline(place, color=CLEARANCES["recommended"], label=label)
        return
    ax.axvline(place, color=COLOURS["stop"], label=f"for Gaussian noise: {label}")
    largest = max(record.gaps, key=lambda each: each.clearance)
    ax.axvline(
        LENGTH(largest.clearance), color=CLEARANCES["record"],
        label=f"the record itself: {largest.needed}",
    )  # fmt: skip


def phases_table(found: MissionSizing) -> pd.DataFrame:
    """The phases in words."""
    table = found.phases.assign(
        duration=[spoken_mission(each) for each in found.phases["duration"]],
        probability=[chance_in_words(each) for each in found.phases["probability"]],
        share=[chance_in_words(each) for each in found.phases["share"]],
    )
    still = not found.phases["shift"].any()
    return with_headings(
        table, {k: v for k, v in PHASE_COLUMNS.items() if not (still and k == "shift")}
    )


PHASE_COLUMNS: dict[str, Heading] = {
    "phase": "phase", "duration": "duration", "displacement_std": ("rms ()", LENGTH),
    "shift": ("shift of rest ()", LENGTH), "probability": "probability there",
    "share": "part of the risk", "clearance": ("clearance alone ()", LENGTH),
}  # fmt: skip
TRIED_COLUMNS: dict[str, Heading] = {
    "clearance": ("clearance ()", LENGTH), "damage_ratio": "times the damage",
    "standard_error": "standard error", "frequency_hz": "at (Hz)", "by": "by",
}  # fmt: skip


def print_mission_sizing(console: Console, found: MissionSizing) -> None:
    """Print the clearance to make, the share of each phase in its risk, and what records say."""
    _print_clearance(console, found)
    print_frame(console, phases_table(found), "phases")
    for name, record in found.records.items():
        if record.agrees:
            print_line(console, f"phase {name}: {record.sentence()}")
    print_assumptions(console, found.assumptions)
    for warning in found.warnings:
        console.print(f"note: {warning}", style="yellow", highlight=False)


def plot_mission_sizing(found: MissionSizing, ax: Axes | None = None) -> Axes:
    """Probability of any impact in the mission against the clearance."""
    ax = axes_or_new(ax)
    curve = found.curve
    x = LENGTH(curve["clearance"])
    ax.fill_between(
        x, curve["probability_low"], curve["probability_high"], color=COLOURS["simulate"],
        alpha=BAND_ALPHA, linewidth=0,
    )  # fmt: skip
    ax.plot(
        x,
        curve["probability"],
        color=COLOURS["simulate"],
        label="all phases" if len(found.phases) > 1 else None,
    )
    _mark(
        ax, found,
        f"{LENGTH.text(found.clearance.value)} keeps {spoken_percent(found.target.value)}",
    )  # fmt: skip
    ax.set_yscale("log")
    ax.set_ylim(top=1.5)
    ax.set_xlabel(f"clearance per side{found.of_widest} ({LENGTH})")
    ax.set_ylabel(f"probability of an impact in {spoken_mission(found.mission)}")
    add_grid(ax)
    ax.legend(frameon=False)
    return ax


def damage_table(found: DamageSizing) -> pd.DataFrame:
    """The clearances that were tried."""
    return with_headings(found.tried, TRIED_COLUMNS)


def print_damage_sizing(console: Console, found: DamageSizing) -> None:
    """Print the clearance to make, the clearances that were tried, and the damage there."""
    _print_clearance(console, found)
    print_frame(console, damage_table(found), "clearances that were tried")
    print_damage(console, found.damage)


def plot_damage_sizing(found: DamageSizing, ax: Axes | None = None) -> Axes:
    """Largest ratio of damage, less 1, against the clearance."""
    ax = axes_or_new(ax)
    tried = found.tried
    added, half = tried["damage_ratio"] - 1.0, GAUSSIAN_95 * tried["standard_error"]
    low = np.minimum(half, 0.99 * added)
    ax.errorbar(
        LENGTH(tried["clearance"]), added, yerr=[low, half], fmt="o", capsize=3,
        color=COLOURS["simulate"], label="damage that stops add, 95 %",
    )  # fmt: skip
    ax.axhline(found.ratio - 1.0, color=COLOURS["stop"], linestyle="--", label="accepted")
    _mark(ax, found, LENGTH.text(found.clearance.value))
    ax.set_yscale("log")
    plain_ticks(ax)
    ax.set_xlabel(f"clearance per side{found.of_widest} ({LENGTH})")
    ax.set_ylabel("largest damage with stops over that without, less 1")
    add_grid(ax)
    ax.legend(frameon=False, fontsize="small")
    return ax
