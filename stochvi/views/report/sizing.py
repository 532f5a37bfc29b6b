"""The report of a sizing. Chapters: motion with stops; the page and its files."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from stochvi.isolators.sizing.answer import two_sided
from stochvi.mathematics.units import (
    ACCELERATION,
    FORCE,
    LENGTH,
    PERCENT,
    RATE,
    SPEED,
    ShownQuantity,
    Size,
    spoken_mission,
)
from stochvi.results.base import DataFrame, Response, named_with_units, stacked
from stochvi.results.estimates import count_of, spoken_percent
from stochvi.results.files import Origin
from stochvi.statistics.hardness import hardness_of
from stochvi.views.axes import add_title
from stochvi.views.files import try_picture, write_table
from stochvi.views.isolator_tables import screening_section, sizing_told
from stochvi.views.pages import (
    Fact,
    Grid,
    Page,
    Picture,
    Section,
    page_of,
)
from stochvi.views.report.missions import phases_page
from stochvi.views.report.sections import (
    box_sections,
    clearance_cards,
    environment_section,
    excitations_section,
    gap_section,
    mount_section,
    pairs_cards,
    pairs_gap_section,
)
from stochvi.views.sizing import (
    plot_exceedances,
    plot_histogram,
    plot_hit_rate,
    plot_impact_speeds,
    plot_peaks,
    plot_sizing,
    plot_transmissibility,
)
from stochvi.views.tables import (
    OF_ONE_MOUNT,
    UNKNOWN,
    four_digits,
    names_of_places,
    spoken_length,
    with_interval,
)

if TYPE_CHECKING:
    from stochvi.isolators.sizing.answer import Sizing
    from stochvi.isolators.sizing.review import (
        Balance,
        Chance,
        MotionBetweenStops,
        Review,
    )


# ------------------------------------------------------------------------------
# Sections of a clearance report on the motion with stops: impacts, speeds, peak accelerations.
# ------------------------------------------------------------------------------


SMALLEST_CHANCE = 1e-6
"""Smallest probability of no impact that is stated as a number; smaller ones are stated to lie
below it."""

NOTABLE_CHANGE = 0.1
"""Relative change of the transmissibility by the stops from which on it is drawn."""


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
    notes = [
        f"Pictures and percentiles: a path of {motion.duration:.4g} s, {motion.hits} impacts; "
        f"kurtosis of its displacement {motion.kurtosis:.2f} (3 without stops).",
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
        grids=[_comparison_grid(review), *_percentiles(motion)],
        pictures=_pictures(review, motion),
        notes=notes,
    )


def _pictures(review: Review, motion: MotionBetweenStops) -> list[Picture]:
    found = [
        Picture(
            lambda: plot_histogram(review),
            "Relative displacement with stops at 3 sigma (grey), over the normal distribution "
            "without stops; logarithmic.",
        )
    ]
    if motion.faster_hits is not None:
        found.append(
            Picture(
                lambda: plot_impact_speeds(review),
                f"Impacts faster than a speed, per {RATE.time}, with stops at 3 sigma.",
            )
        )
    if (motion.transmissibility_change or 0.0) > NOTABLE_CHANGE:
        found.append(
            Picture(
                lambda: plot_transmissibility(review),
                "Transmissibility without stops, and the apparent one with stops at 3 sigma; "
                "forces of the stops are left out.",
            )
        )
    return found


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
    ]
    for found in review.comparisons:
        words, quantity, more = ROWS[found.quantity]
        linear = found.without_stops
        first = "" if linear is None else f"{quantity(linear):.4g}"
        cells = [with_interval(each, quantity) for each in (found.three_sigma, found.recommended)]
        rows.append([quantity.heading(words, more), first, *cells])
    return Grid(
        caption="without and with stops, a column for each clearance",
        headings=["", "no stops (linear)", *names_of_places(sizing).values()],
        rows=rows,
    )


def _no_hit(chance: Chance) -> str:
    if chance.no_hit is None:
        return UNKNOWN
    if chance.no_hit < SMALLEST_CHANCE:
        return f"under {100.0 * SMALLEST_CHANCE:g} %"
    return spoken_percent(chance.no_hit)


def _percentiles(motion: MotionBetweenStops) -> list[Grid]:
    """Percentiles of impact speed and, for compliant stops, the peaks that they cause."""
    if motion.impacts is None:
        return []
    compliant = "peak_acceleration" in motion.impacts
    peaks = "; peaks by mount and stop together, the base at rest meanwhile, harder side"
    felt = "; peak_acceleration {.3g}; deflection {m .3g}; contact = contact_time {ms .3g}"
    return Grid.of(
        f"impacts with stops at 3 sigma, {count_of(motion.hits)} of them{peaks * compliant}",
        motion.impacts,
        f"share of impacts slower than it = slower; impact_speed {{.3g}}{felt * compliant}",
        slower=lambda row: f"{row['percentile']:g} %",
    )


def hard_hits_section(review: Review) -> Section:
    """Probabilities that the hardest impact of the mission exceeds a limit, with their pictures."""
    title, table = "Hard impacts", review.exceedances
    if table is None or not len(table):
        return Section(title=title)
    kind = hardness_of(table["event"].iloc[0])
    what, quantity = kind.words, kind.quantity
    marked = table[table["mark"]].sort_values(["clearance", "limit"])
    cells = {
        (
            four_digits(LENGTH(row["clearance"])), f"above {quantity.text(row['limit'], '.3g')}",
        ): f"{spoken_percent(row['probability'])}\n"
        f"{spoken_percent(row['probability_low'])} to {spoken_percent(row['probability_high'])}"
        for row in marked.to_dict("records")
    }  # fmt: skip
    mission = spoken_mission(review.sizing.mission)
    return Section(
        title=title,
        lead=f"The probability that the {what} of any impact of the mission ({mission}) exceeds "
        "a limit, with the law of the stops; 95 % intervals below. "
        "Clusters of impacts were simulated with fast first impacts drawn more often and "
        "weighted; where clusters follow without a pause, the whole motion.",
        grids=Grid.across(
            f"probability in {mission} that the largest {what} exceeds a limit",
            f"clearance ({LENGTH})",
            cells,
        ),
        pictures=[
            Picture(
                lambda: plot_exceedances(review),
                f"Probability that the largest {what} of the mission exceeds a limit against "
                f"clearance, for {marked['limit'].nunique()} limits.",
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
    largest = f"largest in {review.peak_window:g} s"
    grids = Grid.of(
        "absolute acceleration with the forces of the stops. Largest: mean over windows "
        f"of {review.peak_window:g} s; probabilities of the largest of the mission stand above",
        zip(names, own.to_dict("records"), strict=True),
        "stops at = name; clearance {length}; rms = acceleration_rms; "
        f"rms over that without stops = rms_amplification; {largest} = largest_acceleration; "
        "largest over that without stops = peak_amplification",
    )
    missing = int((table["windows"] == 0.0).sum())
    pictures = []
    if table["stiffness_ratio"].notna().any():
        pictures = [
            Picture(
                lambda: plot_peaks(review),
                f"Mean of the largest acceleration in {review.peak_window:g} s against clearance, "
                "for stops that many times as stiff as the mount; the stops of the scene as "
                "diamonds.",
            )
        ]
    return Section(
        title=title,
        lead="An rms value hides impacts: a few change it little, and multiply the peak.",
        grids=grids,
        pictures=pictures,
        notes=[
            f"{missing} of {len(table)} cases of other stops were not simulated: the budget ended"
        ]
        if missing
        else [],
    )


# ------------------------------------------------------------------------------
# The report of a sizing of one mass or of several pairs: a page for a design review, with files of
# its tables and numbers.
# ------------------------------------------------------------------------------


def write_sizing_files(
    sizing: Sizing, folder: Path, review: Review | None = None,
    sensitivity: DataFrame | None = None,
) -> None:  # fmt: skip
    """Write the picture of the risk, and the tables of a page as CSV files; the names of their
    columns state SI units."""
    if sizing.scene.phases:
        return
    # this picture comes first, since those of the page may be left out for want of time
    title = sizing.scene.title or "clearance and risk"
    try_picture(lambda: add_title(plot_sizing(sizing), title), folder / "risk.png")
    several = sizing.several
    # all estimates of the simulations, each with the clearance to which it belongs
    evidence = [answer.to_frame().assign(at=name) for name, answer in sizing.evidence.items()]
    tables = {
        "risk": sizing.curve,
        "pairs": sizing.pairs if several else None,
        "required": sizing.required,
        "hits": sizing.simulated if len(sizing.simulated) or not several else None,
        "tolerances": sizing.tolerances if several else sizing.worst_case,
        "sensitivity": sensitivity,
        "exceedances": None if review is None else review.exceedances,
        "peaks": None if review is None else review.peaks,
        "evidence": stacked(evidence) if evidence else None,
    }
    lengths = dict.fromkeys([*sizing.clearances, "lower", "upper"], "m") if several else {}
    for name, table in tables.items():
        if table is not None:
            write_table(named_with_units(table), folder / f"{name}.csv", lengths)


def sizing_page(
    sizing: Sizing,
    origin: Origin,
    review: Review | None = None,
    sensitivity: DataFrame | None = None,
) -> Page:
    """The page of a sizing; that of one mass needs its review."""
    if sizing.scene.phases:
        return phases_page(sizing, origin)
    told, number = sizing_told(sizing, sensitivity), len(sizing.pairs)
    what = f"Clearances of {number} pairs" if sizing.several else "Clearance of an isolated mass"
    if review is None:
        cards = pairs_cards(sizing)
        sections = [
            screening_section(sizing.screening), excitations_section(sizing.scene),
            *box_sections(sizing), pairs_gap_section(sizing), _verification(sizing),
        ]  # fmt: skip
        limits = [*OF_PAIRS, *sizing.scene.assumptions()]
    else:
        told = replace(told, warnings=[*_failed_balances(review), *review.warnings])
        cards = _cards(review)
        sections = [
            stops_section(review), hard_hits_section(review), peaks_section(review),
            _screening(review), environment_section(review), mount_section(review),
            gap_section(review), _verification(sizing, review.balances),
        ]  # fmt: skip
        limits = [*OF_ONE_MOUNT, *review.assumptions]
    return page_of(
        replace(told, footer=()),
        sizing.scene.title or what,
        f"{what} between {'their' if sizing.several else 'its'} stops, for a mission of "
        f"{spoken_mission(sizing.mission)}",
        cards,
        origin,
        sections,
        [*limits, *STATIONARY],
        [
            "The folder of this page holds tables in SI units (CSV), with the units in the names "
            "of their columns; size.json holds all numbers of the page.",
        ],
    )


# Verdict ----------------------------------------------------------------------------------


def _failed_balances(review: Review) -> list[str]:
    names = names_of_places(review.sizing)
    return [
        f"the balance of {each.name} of the simulation at {names.get(each.place, each.place)} "
        "failed: do not use its numbers, and report the case"
        for each in review.balances
        if not each.passed
    ]


def _cards(review: Review) -> list[Fact]:
    sizing = review.sizing
    three = sizing.three_sigma
    hits = "as if impacts changed nothing" if three.hits is None else "with these stops"
    count = three.rice_hits if three.hits is None else three.hits.value
    return [
        *clearance_cards(sizing),
        _risk_card(review),
        Fact(
            "3 sigma",
            spoken_length(three.clearance),
            f"three times the linear rms; {count_of(count)} impacts expected in "
            f"{spoken_mission(sizing.mission)}, {hits}",
        ),
    ]


def _risk_card(review: Review) -> Fact:
    """The probability of exceeding the limit of the target or, without a limit, of any impact."""
    sizing = review.sizing
    target, mission = sizing.target, spoken_mission(sizing.mission)
    hits = review.hits["recommended"]
    count = UNKNOWN if hits is None or hits.expected is None else count_of(hits.expected)
    noise = "" if sizing.doubtful is None else ", for Gaussian noise alone"
    remark = f"at the calculated clearance{noise}; expected impacts there: {count}"
    if target.exceedance is None:
        chance = review.chances["recommended"].any_hit
        value = UNKNOWN if chance is None else spoken_percent(chance)
        return Fact(f"Probability of any impact in {mission}", value, remark)
    kept = target.accepted if sizing.kept_with is None else f"below {target.accepted}"
    return Fact(
        f"Probability of exceeding {target.limit} in {mission}",
        kept if sizing.shown_to_keep else "not known well enough",
        remark,
    )


# Linear screening and risk ----------------------------------------------------------------


def _screening(review: Review) -> Section:
    sizing, more = review.sizing, review.linear
    screened = screening_section(sizing.screening)
    sides = "both sides" if two_sided(sizing.scene) else "one side"
    facts = [
        Fact(
            "Impacts at 3 sigma by Rice",
            f"{RATE(more.rice_rate_at_three_sigma):.4g} per {RATE.time}",
            f"{sides}, as if impacts changed nothing",
        ),
        Fact(
            "Expected largest displacement",
            spoken_length(more.largest_displacement),
            f"in {spoken_mission(sizing.mission)}, either side, {more.largest_in_sigma:.3g} sigma "
            "(mean by Davenport's formula)",
        ),
    ]
    pictures = [
        Picture(
            lambda: plot_hit_rate(review),
            f"Impacts per {RATE.time} (of all stops) against clearance: by Rice, the rate of first "
            "impacts, and simulated with the stops.",
        ),
    ]
    sines = " A sine beside the noise counts by its rms alone."
    return replace(
        screened,
        lead="The rule of three sigma rests on the Gaussian response of the mount without stops. "
        f"Where zero up-crossings are far above the natural frequency, "
        f"{review.mount.natural_frequency_hz:.4g} Hz, a cluster follows each impact."
        + (sines if sizing.screening.only.sines else ""),
        grids=screened.grids[:1],
        facts=facts,
        pictures=pictures,
    )


# Verification, limits --------------------------------------------------------


def _verification(sizing: Sizing, balances: Sequence[Balance] = ()) -> Section:
    facts, names = [], names_of_places(sizing)
    for name, answer in sizing.evidence.items():
        cost = answer.cost
        facts.append(
            Fact(
                f"Simulation at {names.get(name, name)}",
                f"{cost.paths} paths",
                f"{count_of(float(cost.impacts))} impacts in {count_of(float(cost.steps))} steps, "
                f"{cost.wall_time:.3g} s; {_how(answer)}",
            )
        )
    for balance in balances:
        residual = balance.residual
        bias = "" if residual.bias is None else f", bias of the step {residual.bias:.1g}"
        facts.append(
            Fact(
                f"Balance of {balance.name}, {names.get(balance.place, balance.place)}",
                "passed" if balance.passed else "FAILED",
                f"residual {with_interval(residual).replace(chr(10), ' (95 %: ')})"
                f"{bias}; it passes within {balance.errors:g} standard errors and its bias",
            )
        )
    facts.append(
        Fact(
            "Records for the probability of any impact",
            f"{sizing.cost.paths}",
            f"the sizing took {sizing.cost.wall_time:.3g} s on {sizing.cost.threads} threads",
        )
    )
    return Section(title="Verification", lead=f"Method: {sizing.method}.", facts=facts)


def _how(answer: Response) -> str:
    return "; ".join(text for text in answer.assumptions if "step" in text)


STATIONARY = (
    "Stationary Gaussian shaking for the whole mission; single shocks, and resonances of what "
    "carries the mount, are not in it.",
)
OF_PAIRS = ("Clearances are measured from the static equilibrium.",)
"""Limits of a report: of every one, and of one on several pairs."""
