"""The report of a sizing: a page for a design review, with its tables and numbers beside it."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from stochvi.isolators.screening import predicted_rates
from stochvi.isolators.sizing.answer import spoken_mission, spoken_percent
from stochvi.isolators.sizing.chances import probability_at, two_sided
from stochvi.results.errors import NotApplicable
from stochvi.results.response import Response
from stochvi.scenes.excitations import DensityNoise
from stochvi.views.files import write_sizing, write_table, write_text
from stochvi.views.report.inputs import environment, gap, mount
from stochvi.views.report.pages import Fact, Grid, Page, Section, shown
from stochvi.views.report.peaks import peaks_of, peaks_section
from stochvi.views.report.plots import (
    new_axes,
    plot_cumulative,
    plot_hit_rate,
    plot_sensitivity,
)
from stochvi.views.report.stops import NAMES, seed_of, with_stops
from stochvi.views.report.tolerances import within_tolerances
from stochvi.views.report.words import (
    MM,
    UNKNOWN,
    G,
    count_of,
    four_digits,
    limits_of,
    millimetres,
    with_interval,
)
from stochvi.views.sizing import plot_risk

if TYPE_CHECKING:
    import pandas as pd

    from stochvi.isolators.sizing.answer import Sizing

CLOSURE_POINTS = 41


def write_report(
    sizing: Sizing, folder: str | Path, sensitivity: pd.DataFrame | None = None
) -> Path:
    """Write `report.html` beside what `write_sizing` writes; returns the path of the page.

    The page needs nothing beside it: pictures and style are embedded, and nothing is fetched.

    Parameters
    ----------
    sizing
        From `size`.
    sensitivity
        From `sensitivity`; by default linear theory within the tolerances of the isolator.
    folder
        Made if it is missing. `sensitivity.csv`, `peaks.csv` and `evidence.csv` hold the other
        tables of the page, in SI units.
    """
    folder = Path(folder)
    sensitivity = _sensitivity(sizing) if sensitivity is None else sensitivity
    write_sizing(sizing, folder, sensitivity)
    peaks = peaks_of(sizing, seed=seed_of(sizing))
    if peaks is not None:
        write_table(peaks, folder / "peaks.csv")
    if sizing.evidence:
        import pandas as pd

        frames = [answer.to_frame().assign(at=name) for name, answer in sizing.evidence.items()]
        write_table(pd.concat(frames), folder / "evidence.csv")
    path = folder / "report.html"
    write_text(clearance_page(sizing, sensitivity, peaks).html(), path)
    return path


def clearance_page(
    sizing: Sizing,
    sensitivity: pd.DataFrame | None = None,
    peaks: pd.DataFrame | None = None,
) -> Page:
    """The page of a sizing; `sensitivity` as for `write_report` and `peaks` from `peaks_of`, None
    for no such section."""
    return Page(
        title=sizing.scene.title or "Clearance of an isolator",
        subtitle=f"Clearance of an isolated mass between its stops, for a mission of "
        f"{spoken_mission(sizing.mission)}",
        verdict=f"Clearance: {sizing.verdict()}.",
        cards=_cards(sizing),
        warnings=_warnings(sizing),
        sections=[
            environment(sizing.scene),
            mount(sizing.scene),
            gap(sizing),
            _screening(sizing),
            _risk(sizing),
            with_stops(sizing),
            peaks_section(peaks),
            _sensitivity_section(sensitivity),
            _verification(sizing),
            _limits(sizing),
        ],
        footer=_footer(sizing),
    )


# Verdict ----------------------------------------------------------------------------------


def _cards(sizing: Sizing) -> list[Fact]:
    three = sizing.three_sigma
    hits = "as if hits changed nothing" if three.hits is None else "with these stops"
    count = three.rice_hits if three.hits is None else three.hits.value
    return [
        _clearance_card(sizing),
        _risk_card(sizing),
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


def _risk_card(sizing: Sizing) -> Fact:
    """Of the limit that is to be kept, or of any hit."""
    target, mission = sizing.target, spoken_mission(sizing.mission)
    if target.exceedance is None:
        chance = _chance(probability_at(sizing, sizing.clearance.value))
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


def _warnings(sizing: Sizing) -> tuple[str, ...]:
    """Of the sizing, of the screening and of measured records, each once."""
    found = list(sizing.warnings)
    if sizing.screening is not None:
        found += sizing.screening.notes
    system = sizing.scene.system()
    for excitation in sizing.scene.excitations:
        if isinstance(excitation, DensityNoise):
            found += excitation.cautions(system.omega, system.damping_rate)
    return tuple(dict.fromkeys(found))


# Linear screening and risk ----------------------------------------------------------------


def _screening(sizing: Sizing) -> Section:
    linear = sizing.screening
    if linear is None:
        return Section(title="Linear screening")
    three = sizing.three_sigma.clearance
    sides = "both sides" if two_sided(sizing.scene) else "one side"
    natural = sizing.scene.system().omega / (2.0 * math.pi)
    crossings = 2.0 * linear.zero_crossing_rate * sizing.mission
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
            f"natural frequency {natural:.4g} Hz; far above it one hit starts a burst",
        ),
        _miles(sizing),
        Fact("3 sigma", millimetres(three), "per side, three times s_x"),
        Fact(
            "Hits at 3 sigma by Rice",
            f"{count_of(sizing.three_sigma.rice_hits)}",
            f"in {spoken_mission(sizing.mission)}, {sides}, as if hits changed nothing; "
            f"{sizing.three_sigma.rice_hits / sizing.mission:.4g} per second",
        ),
        Fact(
            "Expected largest displacement",
            millimetres(_largest(crossings) * sizing.sigma),
            f"of {spoken_mission(sizing.mission)}, either side, {_largest(crossings):.3g} sigma "
            "(Davenport)",
        ),
    ]
    pictures = []
    if sizing.scene.system().moving_base:
        pictures = [
            shown(
                plot_cumulative(sizing.scene),
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


def _miles(sizing: Sizing) -> Fact:
    linear = sizing.screening
    assert linear is not None
    name = "Miles' equation for it"
    if linear.miles is None:
        return Fact(
            name, "not valid", "the input is 0 at the natural frequency; the response is not"
        )
    off = linear.miles / linear.acceleration_std - 1.0
    return Fact(
        name,
        f"{G * linear.miles:.4g} g rms",
        f"{100.0 * off:+.2g} % off the integral: the input is not flat"
        if abs(off) > 0.01
        else "agrees with the integral",
    )


def _largest(count: float) -> float:
    """Mean of the largest of `count` peaks in standard deviations (Davenport 1964).

    >>> round(_largest(600.0), 6)
    3.738226
    """
    root = math.sqrt(2.0 * math.log(max(count, math.e)))
    return root + float(np.euler_gamma) / root


def _risk(sizing: Sizing) -> Section:
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
            plot_risk(sizing, new_axes()),
            "Chance of any hit in the mission against clearance. "
            "Dashed: Rice's crossings taken for independent hits.",
        ),
        shown(
            plot_hit_rate(sizing, _closure(sizing)),
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


def _closure(sizing: Sizing) -> pd.DataFrame | None:
    """Hit rate by the moment closure, where the stops are rigid and no sine shakes."""
    scene, x = sizing.scene, sizing.curve["clearance"]
    pairs = scene.impact_pairs
    if sizing.screening is None or not pairs or not two_sided(scene):
        return None
    if not all(law.rigid for _, law in pairs[0].stops()):
        return None
    try:
        return predicted_rates(scene, list(np.linspace(x.min(), x.max(), CLOSURE_POINTS)))
    except NotApplicable:
        return None


# Sensitivity, verification, limits --------------------------------------------------------


def _sensitivity(sizing: Sizing) -> pd.DataFrame | None:
    if sizing.screening is None:
        return None
    return within_tolerances(sizing.scene, sizing.clearance.value)


def _sensitivity_section(table: pd.DataFrame | None) -> Section:
    """From `sensitivity`, which tells chances, or from `within_tolerances`, which does not."""
    title = "Sensitivity"
    if table is None:
        return Section(title=title)
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


def _limits(sizing: Sizing) -> Section:
    above = _warnings(sizing)
    own = [text for text in sizing.scene.assumptions() if text not in above]
    for answer in sizing.evidence.values():
        own += [
            text for text in [*answer.assumptions, *answer.warnings] if text not in [*own, *above]
        ]
    return Section(
        title="Limits",
        lead="What this report takes for granted, and does not say.",
        notes=[
            *(text[0].upper() + text[1:] for text in own),
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
        ", ".join([f"stochvi {made.get('version', '')}", f"seed {seed_of(sizing)}", *versions]),
        "Tables in SI units lie beside this page as CSV; size.json holds all numbers.",
    ]
