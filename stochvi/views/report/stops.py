"""Sections of a clearance report on the motion with stops: impacts, speeds, peak accelerations."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

from stochvi.isolators.sizing.answer import HITS_PER_FIRST_HIT, spoken_mission, spoken_percent
from stochvi.isolators.sizing.chance_at_stops import two_sided
from stochvi.mathematics.shown_units import (
    ACCELERATION,
    FORCE,
    LENGTH,
    MILLISECONDS,
    PERCENT,
    RATE,
    SPEED,
    ShownQuantity,
    Size,
)
from stochvi.results.hardness import is_speed
from stochvi.results.intervals import GAUSSIAN_95
from stochvi.views.report.pages import Grid, Picture, Section, shown
from stochvi.views.sizing import (
    plot_exceedances,
    plot_exceedances_over_clearance,
    plot_histogram,
    plot_impact_speeds,
    plot_peaks,
    plot_transmissibility,
)
from stochvi.views.words import (
    UNKNOWN,
    count_of,
    four_digits,
    names_of_places,
    way_in_words,
    with_article,
    with_interval,
)

if TYPE_CHECKING:
    import pandas as pd

    from stochvi.isolators.sizing.answer import Target
    from stochvi.isolators.sizing.motion import MotionBetweenStops
    from stochvi.isolators.sizing.review import Chance, Exceeding, HitsAt, Review

SMALLEST_CHANCE = 1e-6
"""Smallest probability of no impact that is stated as a number; smaller ones are stated to lie
below it."""

NOTABLE_CHANGE = 0.1
"""Relative change of the transmissibility by the stops from which on it is drawn."""

NO_HIT = "no impact seen"


class _Row(NamedTuple):
    """A quantity in words, and what stands behind its unit."""

    words: str
    quantity: ShownQuantity
    more: str = ""


ROWS = {
    "displacement_std": _Row("relative displacement", LENGTH, " rms about its mean"),
    "velocity_std": _Row("relative velocity", SPEED, " rms"),
    "acceleration_std": _Row("absolute acceleration", ACCELERATION, " rms"),
    "peak_force": _Row("mean of the peak forces", FORCE),
    "stop_acceleration": _Row("mean of the peaks by the stop", ACCELERATION),
    "contact_probability": _Row("share of time in contact", PERCENT),
    "lost_power": _Row(
        "energy lost to stops", ShownQuantity("power per mass", Size("mW per kg", 1e-3))
    ),
}
"""The quantities of `Review.comparisons`."""


def stops_section(review: Review) -> Section:
    """Impacts at 3 sigma and at the recommended clearance; empty where the scene has no stops."""
    title, motion = "With stops", review.motion
    if motion is None:
        return Section(title=title)
    grids = [_comparison_grid(review)]
    if motion.impacts is not None:
        grids.append(_impacts_grid(motion, motion.impacts))
    notes = [
        f"Pictures and percentiles: a path of {motion.duration:.4g} s, {motion.hits} impacts; "
        f"kurtosis of its displacement {motion.kurtosis:.2f} (3 without stops).",
        f"{HITS_PER_FIRST_HIT[0].upper()}{HITS_PER_FIRST_HIT[1:]}.",
    ]
    change = motion.transmissibility_change
    if change is not None and change <= NOTABLE_CHANGE:
        notes.append(
            "The transmissibility with stops is not drawn: in bands of a third of an octave it "
            f"differs by at most {100.0 * change:.2g} % from that without."
        )
    if any(law.rigid for pair in motion.scene.impact_pairs for _, law in pair.stops()):
        notes.append(
            "A restitution gives the speeds of impact, not the peak acceleration: for that the "
            "stop needs a stiffness, or a measured force over deflection."
        )
    return Section(
        title=title,
        lead="Simulated with the law of the stops; 95 % intervals below the values. Rms "
        "values hide impacts; speeds and peaks show them.",
        grids=grids,
        pictures=_pictures(review, motion),
        notes=notes,
    )


def _pictures(review: Review, motion: MotionBetweenStops) -> list[Picture]:
    found = [
        shown(
            lambda: plot_histogram(review),
            "Relative displacement with stops at 3 sigma (grey), over the normal distribution "
            "without stops; logarithmic.",
        )
    ]
    if motion.faster_hits is not None:
        found.append(
            shown(
                lambda: plot_impact_speeds(review),
                f"Impacts faster than a speed, per {RATE.time}, with stops at 3 sigma.",
            )
        )
    if (motion.transmissibility_change or 0.0) > NOTABLE_CHANGE:
        found.append(
            shown(
                lambda: plot_transmissibility(review),
                "Transmissibility without stops, and the apparent one with stops at 3 sigma; "
                "forces of the stops are left out.",
            )
        )
    return found


def _hit_rows(review: Review) -> list[list[str]]:
    """Rows of the table of impacts: one for each quantity, a column for each clearance."""

    def row(words: str, text: Callable[[HitsAt], str]) -> list[str]:
        return [words, "", *(UNKNOWN if hits is None else text(hits) for hits in found)]

    found = review.hits.values()
    return [
        row(
            f"impacts per {RATE.time}",
            lambda hits: _count(*map(RATE, (hits.rate, hits.rate_low, hits.rate_high))),
        ),
        row(
            "impacts in the mission",
            lambda hits: _count(hits.expected, hits.expected_low, hits.expected_high),
        ),
        row("impacts per cluster", lambda hits: _seen(hits.hits_per_first_hit)),
        row(f"mean impact speed ({SPEED})", lambda hits: _seen(SPEED(hits.impact_speed_mean))),
        row("impacts found by", lambda hits: way_in_words(hits.by)),
    ]


def _count(value: float | None, low: float, high: float) -> str:
    return NO_HIT if value is None else f"{count_of(value)}\n{count_of(low)} to {count_of(high)}"


def _seen(value: float | None) -> str:
    return NO_HIT if value is None else f"{value:.3g}"


def _comparison_grid(review: Review) -> Grid:
    sizing = review.sizing
    places = {"three_sigma": sizing.three_sigma.clearance, "recommended": sizing.clearance.value}
    rows = [
        [
            f"clearance per side ({LENGTH})",
            "none",
            *(f"{LENGTH(place):.4g}" for place in places.values()),
        ],
        ["no impact in the mission", "", *(_no_hit(review.chances[name]) for name in places)],
        *_hit_rows(review),
    ]
    for found in review.comparisons:
        words, quantity, more = ROWS[found.quantity]
        linear = found.without_stops
        first = "" if linear is None else f"{quantity(linear):.4g}"
        cells = [with_interval(each, quantity) for each in (found.three_sigma, found.recommended)]
        rows.append([quantity.heading(words, more), first, *cells])
    sides = "both sides together" if two_sided(sizing.scene) else "one stop"
    return Grid(
        caption=f"Without and with stops, a column for each clearance; impacts on {sides}",
        headings=["", "no stops (linear)", *names_of_places(sizing).values()],
        rows=rows,
    )


def _no_hit(chance: Chance) -> str:
    if chance.no_hit is None:
        return UNKNOWN
    if chance.no_hit < SMALLEST_CHANCE:
        return f"under {100.0 * SMALLEST_CHANCE:g} %"
    return spoken_percent(chance.no_hit)


def _impacts_grid(motion: MotionBetweenStops, impacts: pd.DataFrame) -> Grid:
    """Percentiles of impact speed and, for compliant stops, the peaks that they cause."""
    headings = ["share of impacts slower than it", f"impact speed ({SPEED})"]
    caption = f"Impacts with stops at 3 sigma, {count_of(motion.hits)} of them"
    columns = [
        [f"{percentile:g} %" for percentile in impacts["percentile"]],
        [f"{speed:.3g}" for speed in SPEED(impacts["impact_speed"])],
    ]
    if "peak_acceleration" in impacts:
        caption += "; peaks by mount and stop together, the base at rest meanwhile, harder side"
        for words, name, quantity in (
            ("peak acceleration", "peak_acceleration", ACCELERATION),
            ("deflection", "deflection", LENGTH),
            ("contact", "contact_time", MILLISECONDS),
        ):
            headings.append(quantity.heading(words))
            columns.append([f"{quantity(value):.3g}" for value in impacts[name]])
    return Grid(caption=caption, headings=headings, rows=list(zip(*columns, strict=True)))


def limit_in_words(target: Target) -> str:
    """The limit of a target: an acceleration in g, a speed in m/s, unless units are chosen."""
    limited = target.exceedance is not None
    return target.in_g if limited and not is_speed(target.name) else target.limit


def exceeding_in_words(found: Exceeding | None) -> str:
    """A probability of exceeding a limit with its 95 % interval."""
    if found is None or found.probability is None or found.low is None or found.high is None:
        return UNKNOWN
    interval = f"{spoken_percent(found.low)} to {spoken_percent(found.high)}, 95 %"
    return f"{spoken_percent(found.probability)} ({interval})"


def hard_hits_section(review: Review) -> Section:
    """Probabilities that the hardest impact of the mission exceeds a limit, with their pictures."""
    title, table = "Hard impacts", review.exceedances
    if table is None or not len(table):
        return Section(title=title)
    peak = not is_speed(table["event"].iloc[0])
    what, quantity = ("peak acceleration", ACCELERATION) if peak else ("impact speed", SPEED)
    marks = sorted(set(table.loc[table["mark"], "limit"]))
    rows = []
    for clearance in sorted(set(table["clearance"])):
        found = table[table["clearance"] == clearance]
        chances = {
            row["limit"]: f"{spoken_percent(row['probability'])}\n"
            f"{spoken_percent(row['probability_low'])} to {spoken_percent(row['probability_high'])}"
            for row in found[found["mark"]].to_dict("records")
        }
        rows.append(
            [four_digits(LENGTH(clearance)), *(chances.get(mark, UNKNOWN) for mark in marks)]
        )
    mission = spoken_mission(review.sizing.mission)
    return Section(
        title=title,
        lead=f"The probability that any impact of the mission ({mission}) has "
        f"{with_article(what)} above a limit, with the law of the stops; 95 % intervals below. "
        "Clusters of impacts were simulated with fast first impacts drawn more often and "
        "weighted; where clusters follow without a pause, the whole motion.",
        grids=[
            Grid(
                caption=f"Probability in {mission} that the largest {what} exceeds a limit",
                headings=[
                    f"clearance ({LENGTH})",
                    *(f"above {quantity.text(mark, '.3g')}" for mark in marks),
                ],
                rows=rows,
            )
        ],
        pictures=[
            shown(
                lambda: plot_exceedances(review),
                f"Probability that the largest {what} of the mission exceeds a limit, at three "
                "clearances.",
            ),
            shown(
                lambda: plot_exceedances_over_clearance(review),
                f"The same against clearance, for {len(marks)} limits.",
            ),
        ],
    )


def peaks_section(review: Review) -> Section:
    """Peak accelerations and their picture; empty where the stops have no stiffness."""
    title, table = "Peak accelerations", review.peaks
    if table is None:
        return Section(title=title)
    own = table[table["stiffness_ratio"].isna()]
    names = names_of_places(review.sizing).values()
    rows = [
        [
            name,
            four_digits(LENGTH(row["clearance"])),
            f"{ACCELERATION(row['acceleration_rms']):.4g}\n"
            f"± {_half(row['acceleration_rms_error'])}",
            f"{row['rms_amplification']:.3f}",
            f"{ACCELERATION(row['largest_acceleration']):.3g}\n"
            f"± {_half(row['largest_acceleration_error'])}",
            f"{row['peak_amplification']:.3g}",
        ]
        for name, row in zip(names, own.to_dict("records"), strict=True)
    ]
    grid = Grid(
        caption="Absolute acceleration with the forces of the stops. Largest: mean over windows "
        f"of {review.peak_window:g} s; probabilities of the largest of the mission stand above",
        headings=[
            "stops at",
            f"clearance ({LENGTH})",
            f"{ACCELERATION} rms",
            "ratio to no stops",
            f"largest in {review.peak_window:g} s, mean ({ACCELERATION})",
            "ratio to no stops",
        ],
        rows=rows,
    )
    missing = int((table["windows"] == 0.0).sum())
    pictures = []
    if table["stiffness_ratio"].notna().any():
        pictures = [
            shown(
                lambda: plot_peaks(review),
                f"Mean of the largest acceleration in {review.peak_window:g} s against clearance, "
                "for stops that many times as stiff as the mount; the stops of the scene as "
                "diamonds.",
            )
        ]
    return Section(
        title=title,
        lead="An rms value hides impacts: a few change it little, and multiply the peak.",
        grids=[grid],
        pictures=pictures,
        notes=[
            f"{missing} of {len(table)} cases of other stops were not simulated: the budget ended"
        ]
        if missing
        else [],
    )


def _half(standard_error: float) -> str:
    """Half of the 95 % interval of an acceleration."""
    return f"{ACCELERATION(GAUSSIAN_95 * standard_error):.1g}"
