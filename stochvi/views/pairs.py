"""Sizing of several pairs: tables in words, and pictures."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from stochvi.isolators.sizing.answer import spoken_mission, spoken_percent
from stochvi.mathematics.shown_units import LENGTH, SPEED
from stochvi.views.axes import add_grid, add_title, axes_or_new, legend_above, length_unit
from stochvi.views.colours import COLOURS, owner_colours
from stochvi.views.words import four_digits

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes

    from stochvi.isolators.screening import Screening
    from stochvi.isolators.sizing.answer import Probability, Sizing


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
