"""The report of a sizing: a page for a design review, with files of its tables and numbers."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from stochvi.isolators.sizing.answer import spoken_mission, spoken_percent
from stochvi.isolators.sizing.chances import two_sided
from stochvi.results.response import Response
from stochvi.views.axes import PAGE, axes_or_new
from stochvi.views.files import to_json, try_picture, write_table, write_text
from stochvi.views.report.environment import environment_section, gap_section, mount_section
from stochvi.views.report.pages import Fact, Grid, Page, Section, shown
from stochvi.views.report.stops import NAMES, peaks_section, stops_section
from stochvi.views.sizing import (
    draw_sizing,
    plot_cumulative,
    plot_hit_rate,
    plot_risk,
    plot_sensitivity,
)
from stochvi.views.words import (
    MM,
    UNKNOWN,
    G,
    count_of,
    four_digits,
    limits_of,
    millimetres,
    with_interval,
)

if TYPE_CHECKING:
    import pandas as pd

    from stochvi.isolators.screening import Screening
    from stochvi.isolators.sizing.answer import Sizing
    from stochvi.isolators.sizing.review import LinearMotion, Review

NOTABLE_MILES_ERROR = 0.01
"""Relative error of Miles' equation from which on the report states it."""


def write_report(review: Review, folder: str | Path) -> Path:
    """Write `report.html`, and its numbers and tables as files; returns the path of the page.

    The page needs no other file: pictures and style are embedded, and nothing is fetched.
    `size.json` holds every number of the page, and the CSV files hold its tables, in SI units.

    Parameters
    ----------
    review
        The answer of `review`.
    folder
        Made if it is missing.
    """
    folder, sizing = Path(folder), review.sizing
    write_text(to_json(review.to_dict()) + "\n", folder / "size.json")
    tables = {
        "risk": sizing.curve,
        "required": sizing.required,
        "hits": sizing.simulated,
        "sensitivity": review.sensitivity,
        "peaks": review.peaks,
        "evidence": _evidence_table(sizing),
    }
    for name, table in tables.items():
        if table is not None:
            write_table(table, folder / f"{name}.csv")
    try_picture(lambda: draw_sizing(sizing, sizing.scene.title), folder / "risk.png")
    path = folder / "report.html"
    write_text(clearance_page(review).html(), path)
    return path


def _evidence_table(sizing: Sizing) -> pd.DataFrame | None:
    """All estimates of the simulations, with the clearance that each belongs to."""
    import pandas as pd

    frames = [answer.to_frame().assign(at=name) for name, answer in sizing.evidence.items()]
    return pd.concat(frames) if frames else None


def clearance_page(review: Review) -> Page:
    """The page of a sizing."""
    sizing = review.sizing
    return Page(
        title=sizing.scene.title or "Clearance of an isolator",
        subtitle=f"Clearance of an isolated mass between its stops, for a mission of "
        f"{spoken_mission(sizing.mission)}",
        verdict=f"{_verdict_start(sizing)}{sizing.verdict()}.",
        alarm=sizing.record is not None and sizing.record.contradicts,
        cards=_cards(review),
        warnings=review.warnings,
        sections=[
            environment_section(review),
            mount_section(review),
            gap_section(sizing),
            _screening(review),
            _risk(review),
            stops_section(review),
            peaks_section(review),
            _sensitivity(review.sensitivity),
            _verification(sizing),
            _limits(review),
        ],
        footer=_footer(sizing),
    )


# Verdict ----------------------------------------------------------------------------------


def _verdict_start(sizing: Sizing) -> str:
    """The word before a verdict; none before that of a record that contradicts it."""
    record = sizing.record
    return "" if record is not None and record.contradicts else "Clearance: "


def _record_card(sizing: Sizing) -> list[Fact]:
    """The clearance that a measured record itself needs, if there is one."""
    record = sizing.record
    if record is None:
        return []
    judged = "contradicts" if record.contradicts else "agrees with"
    return [
        Fact(
            "The record itself needs",
            millimetres(record.clearance),
            f"it moves {record.peak_in_sigma:.3g} sigma and {judged} Gaussian noise, which would "
            f"move {record.expected_peak_in_sigma:.3g} in its time; response kurtosis "
            f"{record.kurtosis:.3g}, 3 ± {record.kurtosis_error:.2g} for Gaussian noise",
        )
    ]


def _cards(review: Review) -> list[Fact]:
    sizing = review.sizing
    three = sizing.three_sigma
    hits = "as if hits changed nothing" if three.hits is None else "with these stops"
    count = three.rice_hits if three.hits is None else three.hits.value
    return [
        _clearance_card(sizing),
        *_record_card(sizing),
        _risk_card(review),
        Fact(
            "3 sigma would be",
            millimetres(three.clearance),
            "three times the linear rms, per side",
        ),
        Fact(
            "and would risk",
            f"{spoken_percent(three.probability.value)} of any hit",
            f"{count_of(count)} hits expected in {spoken_mission(sizing.mission)}, {hits}",
        ),
    ]


def _clearance_card(sizing: Sizing) -> Fact:
    c = sizing.clearance
    place = f"{c.value / sizing.sigma:.2f} sigma, from the mean position"
    if sizing.kept_with is not None:
        remark = f"the nearest stops that can be judged, {place}"
        return Fact("Clearance per side", f"at most {millimetres(c.value)}", remark)
    interval = f"{limits_of(c.lower, c.upper)} (95 % of the calculation)"
    return Fact("Clearance per side", millimetres(c.value), f"{interval}, {place}")


def _risk_card(review: Review) -> Fact:
    """The chance of exceeding the limit that is to be kept, or of any hit."""
    sizing = review.sizing
    target, mission = sizing.target, spoken_mission(sizing.mission)
    if target.exceedance is None:
        chance = _chance(review.chances["recommended"].any_hit)
        return Fact(f"Chance of any hit in {mission}", chance, "at that clearance")
    limit = target.in_g if target.name == "peak_acceleration" else target.limit
    below = "below " if sizing.kept_with is not None else ""
    return Fact(
        f"Chance of exceeding {limit} in {mission}",
        f"{below}{spoken_percent(target.exceedance)}",
        "at that clearance",
    )


def _chance(probability: float | None) -> str:
    return UNKNOWN if probability is None else spoken_percent(probability)


# Linear screening and risk ----------------------------------------------------------------


def _screening(review: Review) -> Section:
    sizing, linear, more = review.sizing, review.sizing.screening, review.linear
    if linear is None or more is None:
        return Section(title="Linear screening")
    three = sizing.three_sigma
    sides = "both sides" if two_sided(sizing.scene) else "one side"
    facts = [
        Fact(
            "Relative displacement, s_x",
            f"{millimetres(linear.displacement_std)} rms",
            "without stops",
        ),
        Fact("Relative velocity, s_v", f"{linear.velocity_std:.4g} m/s rms"),
        Fact("Absolute acceleration", f"{G * linear.acceleration_std:.4g} g rms"),
        Fact(
            "Zero up-crossings",
            f"{linear.zero_crossing_rate:.4g} Hz",
            f"natural frequency {review.mount.natural_frequency_hz:.4g} Hz; far above it one hit "
            "starts a burst",
        ),
        _miles(linear, more),
        Fact("3 sigma", millimetres(three.clearance), "per side, three times s_x"),
        Fact(
            "Hits at 3 sigma by Rice",
            f"{count_of(three.rice_hits)}",
            f"in {spoken_mission(sizing.mission)}, {sides}, as if hits changed nothing; "
            f"{more.rice_rate_at_three_sigma:.4g} per second",
        ),
        Fact(
            "Expected largest displacement",
            millimetres(more.largest_displacement),
            f"of {spoken_mission(sizing.mission)}, either side, {more.largest_in_sigma:.3g} sigma "
            "(Davenport)",
        ),
    ]
    pictures = []
    if review.environment.spectra is not None:
        pictures = [
            shown(
                plot_cumulative(review),
                "Where the response comes from: share of its mean "
                "square below each frequency, without stops.",
            ),
        ]
    return Section(
        title="Linear screening",
        lead="What the rule of three sigma rests on: the mount without stops, a Gaussian response.",
        facts=facts,
        pictures=pictures,
    )


def _miles(linear: Screening, more: LinearMotion) -> Fact:
    name = "Miles' equation for it"
    if linear.miles is None or more.miles_error is None:
        return Fact(
            name, "not valid", "the input is 0 at the natural frequency; the response is not"
        )
    return Fact(
        name,
        f"{G * linear.miles:.4g} g rms",
        f"{100.0 * more.miles_error:+.2g} % off the integral: the input is not flat"
        if abs(more.miles_error) > NOTABLE_MILES_ERROR
        else "agrees with the integral",
    )


def _risk(review: Review) -> Section:
    sizing = review.sizing
    rows = [
        [
            spoken_percent(row["probability"]),
            four_digits(MM * row["clearance"]),
            limits_of(row["clearance_low"], row["clearance_high"]),
            f"{row['clearance_in_sigma']:.3f}",
        ]
        for row in sizing.required.to_dict("records")
    ]
    grid = Grid(
        caption=f"Clearance per side by the chance of any hit in {spoken_mission(sizing.mission)}",
        headings=["chance of any hit", "clearance (mm)", "95 % of the calculation", "sigma"],
        rows=rows,
    )
    pictures = [
        shown(
            plot_risk(sizing, axes_or_new(None, PAGE)),
            "Chance of any hit in the mission against clearance. "
            "Dashed: Rice's crossings taken for independent hits.",
        ),
        shown(
            plot_hit_rate(review),
            "Hits per second (of all stops) against "
            "clearance: by Rice, the rate of first hits, and simulated with the stops.",
        ),
    ]
    return Section(
        title="Required clearance",
        lead="The chance of any hit depends on the motion without stops alone: nothing has been "
        "hit before the first hit. Intervals are those of the calculation; they do not hold what "
        "is unknown of the mount and the environment (see sensitivity).",
        grids=[grid],
        pictures=pictures,
    )


# Sensitivity, verification, limits --------------------------------------------------------


def _sensitivity(table: pd.DataFrame | None) -> Section:
    """Changed scenes: from `sensitivity`, with chances, or from `within_tolerances`, without."""
    title = "Sensitivity"
    if table is None:
        return Section(title=title)
    missing = "" if "note" not in table else "; ".join(table["change"][table["clearance"].isna()])
    table = table.dropna(subset=["clearance"])
    headings = ["change", "linear rms (mm)", "clearance (mm)", "by (%)"]
    lead = (
        "How the clearance moves if mount and environment are not as stated: by linear theory, at "
        "the Rice rate that the recommended clearance has now."
    )
    columns = [
        list(table["change"]),
        [four_digits(MM * value) for value in table["sigma"]],
        [four_digits(MM * value) for value in table["clearance"]],
        [f"{100.0 * value:+.3g}" for value in table["clearance_change"]],
    ]
    if "probability" in table:
        headings.append("chance of any hit as recommended")
        columns.append([spoken_percent(value) for value in table["probability"]])
        lead = (
            "The clearance for the same target if mount, environment or stops are not as stated, "
            "and the chance of any hit that the recommended clearance then has."
        )
    if missing:
        lead += f" Not found: {missing}."
    grid = Grid(
        caption="One thing changed at a time, the rest as stated",
        headings=headings,
        rows=list(zip(*columns, strict=True)),
    )
    bars = shown(plot_sensitivity(table), "Change of the clearance, per cent.")
    return Section(title=title, lead=lead, grids=[grid], pictures=[bars])


def _verification(sizing: Sizing) -> Section:
    facts = []
    for name, answer in sizing.evidence.items():
        cost = answer.cost
        facts.append(
            Fact(
                f"Simulation at {NAMES.get(name, name)}",
                f"{cost.paths} paths",
                f"{count_of(float(cost.impacts))} impacts in {count_of(float(cost.steps))} steps, "
                f"{cost.wall_time:.3g} s; {_how(answer)}",
            )
        )
        for identity, residual in answer.identities.items():
            facts.append(
                Fact(
                    f"Balance of {identity}, {NAMES.get(name, name)}",
                    with_interval(residual, 1.0),
                    f"0 for a right answer, SI units; bias of the step {residual.bias:.1g}"
                    if residual.bias is not None
                    else "0 for a right answer, SI units",
                )
            )
    facts.append(
        Fact(
            "Calculation",
            f"{sizing.cost.wall_time:.3g} s",
            f"{sizing.cost.paths} paths in all, threads: {sizing.cost.threads}; the same seed "
            "gives the same digits",
        )
    )
    return Section(
        title="Verification",
        lead=f"Method: {sizing.method}.",
        facts=facts,
    )


def _how(answer: Response) -> str:
    return "; ".join(text for text in answer.assumptions if "step" in text)


def _limits(review: Review) -> Section:
    return Section(
        title="Limits",
        lead="What this report takes for granted, and does not say.",
        notes=[
            *(text[0].upper() + text[1:] for text in review.assumptions),
            "One direction of motion; no rocking, and no coupling of directions.",
            "A linear spring and a viscous damper: an elastomer is stiffer at small amplitudes, "
            "and softer when warm.",
            "Stationary Gaussian shaking for the whole mission; single shocks, and resonances of "
            "what carries the mount, are not in it.",
            "The base does not feel the mass.",
        ],
    )


def _footer(sizing: Sizing) -> list[str]:
    made = sizing.provenance
    libraries = made.get("libraries") or {}
    versions = [f"{name} {version}" for name, version in libraries.items()]
    return [
        ", ".join([f"stochvi {made.get('version', '')}", f"seed {sizing.seed}", *versions]),
        "The folder of this page holds tables in SI units (CSV); size.json holds all numbers.",
    ]
