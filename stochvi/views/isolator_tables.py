"""Descriptions of isolators. Chapters: changed scenes and productions; a sizing; missions with
phases, and ratios of damage; screening, clearances and perturbations; pictures of missions."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

from stochvi.isolators.sizing.answer import (
    HITS_PER_FIRST_HIT,
    DamageSizing,
    MissionSizing,
    Probability,
)
from stochvi.isolators.tolerances import in_words
from stochvi.mathematics.units import LENGTH, RATE, SPEED, spoken_mission
from stochvi.results.base import DataFrame, rows_of
from stochvi.results.estimates import (
    Estimate,
    capital,
    count_of,
    plus_minus,
    spoken_percent,
)
from stochvi.views.axes import (
    TALL,
    axes_or_new,
)
from stochvi.views.pages import (
    Grid,
    Section,
    Told,
    records,
    sentence,
    shown,
)
from stochvi.views.sizing import (
    plot_costs,
    plot_damage_sizing,
    plot_mission_sizing,
    plot_pairs_risk,
    plot_risk,
    plot_units,
)
from stochvi.views.statistics import damage_told, plot_damage
from stochvi.views.tables import (
    WITHOUT_TOLERANCES,
    chance_in_words,
    four_digits,
    limits_of,
    of_less_risk,
    of_three_sigma,
    of_your_stops,
    spoken_length,
    to_copy,
    way_in_words,
)

if TYPE_CHECKING:
    from stochvi.isolators.jolt_response import Jolts
    from stochvi.isolators.production_risk import Production
    from stochvi.isolators.record_verdict import RecordVerdict
    from stochvi.isolators.screening import Screening
    from stochvi.isolators.sizing.answer import ClearanceAnswer, Sizing

Row = Mapping[str, Any]
"""A row of a table by the names of its columns."""


# ------------------------------------------------------------------------------
# Changed scenes: tolerances, sensitivity and production.
# ------------------------------------------------------------------------------


def length_of(name: str) -> Callable[[Row], str | None]:
    """The cell with the length of a column, in four digits and the unit that is shown."""
    return lambda row: None if math.isnan(row[name]) else four_digits(LENGTH(row[name]))


def _chance_of(name: str) -> Callable[[Row], str | None]:
    """The cell with the probability of a column in per cent."""
    return lambda row: None if math.isnan(row[name]) else chance_in_words(row[name])


def worst_case_section(sizing: Sizing) -> Section:
    """Each tolerance at its ends, and the worst within all of them; empty without tolerances."""
    return _changes_section(
        "Tolerances",
        "The clearance for the same target, from the static equilibrium of the mount as "
        "stated, and the probability of any impact that then remains: "
        f"{sizing.allowed.in_words()}. Each is at its ends first. Last is the largest "
        "requirement within all of them: the response of the mount is searched over the whole "
        "region, and the scene that is found there is sized.",
        "within the tolerances, each row sized anew",
        sizing.worst_case,
    )


def sensitivity_section(table: DataFrame | None) -> Section:
    """The changed scenes of `sensitivity`; empty without them."""
    return _changes_section(
        "Sensitivity",
        "The clearance for the same target if mount, environment or stops are not as stated, "
        "and the probability of any impact that then remains.",
        "one thing changed at a time, the rest as stated",
        table,
    )


def _changes_section(title: str, lead: str, caption: str, table: DataFrame | None) -> Section:
    """Changed scenes with the clearance that each needs for the same target: of one mass, or of
    each sized pair of several."""
    if table is None:
        return Section(title=title)
    own = {"change", "sigma", "clearance_change", "probability", "note"}
    names = [str(name) for name in table if name not in own]
    return Section(
        title=title,
        lead=lead,
        grids=Grid.by(
            caption,
            {
                "change": lambda row: row["change"],
                **({f"linear rms ({LENGTH})": length_of("sigma")} if "sigma" in table else {}),
                **{f"{name} ({LENGTH})": length_of(name) for name in names},
                "by (%)": lambda row: (
                    None
                    if math.isnan(row["clearance_change"])
                    else f"{100.0 * row['clearance_change']:+.1f}"
                ),
                "any impact, clearance as stated": _chance_of("probability"),
            },
            records(table),
        ),
        notes=[f"{row['change']}: {row['note']}" for (row,) in records(table) if row["note"]],
    )


def production_section(found: Production | None) -> Section:
    """The risk of a production, what its tolerances cost, and how the units differ; empty without
    distributions of tolerances."""
    if found is None:
        return Section(title="Production")
    units = found.units[found.units["share_of_units"].isin(SHOWN_SHARES)]
    return Section(
        title="Production",
        lead=f"Units differ: {in_words(found.spreads)}.",
        grids=[
            *Grid.by(
                "what each tolerance costs: clearance, and share of its variance between units",
                {
                    "tolerance": lambda row: row["tolerance"],
                    f"costs ({LENGTH})": lambda row: f"{LENGTH(row['clearance_cost']):.3g}",
                    "alone (%)": lambda row: _share(row, "first_order"),
                    "with others (%)": lambda row: _share(row, "total"),
                },
                records(found.tolerances),
            ),
            *Grid.by(
                "units from the best to the worst: probability of any impact in "
                f"{spoken_mission(found.mission)}",
                {
                    "share of units": lambda row: f"{100.0 * row['share_of_units']:.3g} %",
                    "at most": lambda row: spoken_percent(row["probability"]),
                    f"would need ({LENGTH})": length_of("clearance"),
                },
                records(units),
            ),
        ],
        pictures=[
            shown(lambda: plot_units(found), "Units by their probability of any impact."),
            shown(lambda: plot_costs(found), "Clearance that each tolerance costs."),
        ],
        notes=[*map(sentence, risk_in_words(found)), f"Method of the production: {found.method}."],
    )


def _share(row: Row, name: str) -> str:
    """A share of a variance in per cent."""
    share, error = 100.0 * row[name], 100.0 * row[f"{name}_error"]
    return plus_minus(Estimate(value=share, standard_error=error))


def production_told(found: Production) -> Told:
    """The risk of a production, what its tolerances cost, and how the units differ."""
    return Told(
        verdict=capital(found.summary()),
        statements=[*map(sentence, risk_in_words(found))],
        sections=[production_section(found)],
        brief=True,
    )


SHOWN_SHARES = (0.05, 0.5, 0.95, 0.99)
"""Shares of the units whose risk the tables show."""


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


# ------------------------------------------------------------------------------
# A sizing of one mass or of several pairs.
# ------------------------------------------------------------------------------


def sizing_told(sizing: Sizing, sensitivity: DataFrame | None = None) -> Told:
    """The clearances to make, then the numbers behind them, then what they rest on."""
    lines = [*of_your_stops(sizing), of_three_sigma(sizing), *of_less_risk(sizing)]
    lines += [] if sizing.varies or not sizing.shown_to_keep else [WITHOUT_TOLERANCES]
    if sizing.production is not None:
        lines = [*map(sentence, risk_in_words(sizing.production)[-2:])]
    return _told(
        sizing,
        lines,
        [
            *(_several(sizing) if sizing.several else _one(sizing)),
            production_section(sizing.production),
            replace(sensitivity_section(sensitivity), asked=True),
        ],
        footer=[
            f"method: {sizing.method}",
            f"cost: {sizing.cost.wall_time:.3g} s on {sizing.cost.threads} threads",
        ],
    )


def _told(
    found: ClearanceAnswer, lines: Sequence[str], sections: Sequence[Section], **more: Any
) -> Told:
    """An answer in a few lines: what to make, the `lines` and what to copy; the calculated
    clearance and the sections stand behind it. Where a record does not agree with the noise of the
    sizing, it says why, and what the record itself needs."""
    doubtful, named = found.doubtful, getattr(found, "records", {}) if found.scene.phases else {}
    judged = found.record
    name = next((each for each in named if named[each] is judged), "")
    notes = [f"for Gaussian noise: {found.for_noise()}"] if doubtful else []
    notes += [found.calculated()] + ([judged.sentence()] if judged and not named else [])
    own = []
    if judged is not None:
        own = [f"Records that agree with Gaussian noise: {', '.join(named)}"]
        own = own if len(named) > 1 else [capital(judged.agreement())]
    statements = [*filter(None, [*own, found.decides()]), *lines, *to_copy(found)]
    told = record_told(judged, name) if doubtful else Told(statements=statements, brief=True)
    behind = [*map(sentence, notes), *sections[0].notes]
    return replace(
        told,
        verdict=found.verdict(),
        sections=[replace(sections[0], notes=behind), *sections[1:]],
        warnings=list(dict.fromkeys(found.warnings)),
        **more,
    )


def _one(sizing: Sizing) -> list[Section]:
    """The clearances of one mass for other risks, the rule of three sigma, and the tolerances."""
    mission, limited = spoken_mission(sizing.mission), sizing.target.exceedance is not None
    return [
        Section(
            title="Required clearance",
            lead="The probability of any impact depends on the motion without stops alone: "
            "nothing has been hit before the first impact. Intervals are those of the calculation; "
            "they leave out what is unknown about the mount and the environment: tolerances are "
            "for that.",
            grids=[
                *Grid.by(
                    f"clearance per side by the probability of any impact in {mission}",
                    {
                        "probability of any impact": _chance_of("probability"),
                        f"clearance ({LENGTH})": length_of("clearance"),
                        "95 % interval": lambda row: limits_of(
                            row["clearance_low"], row["clearance_high"]
                        ),
                        "in sigma": lambda row: row["clearance_in_sigma"],
                    },
                    records(sizing, "required"),
                ),
                *_three_sigma(sizing),
                *_impacts(sizing),
            ],
            pictures=[
                shown(
                    lambda: plot_risk(sizing, axes_or_new(None, TALL)),
                    "Probability in the mission that an impact exceeds the limit, against "
                    "clearance, as simulated with the stops; grey: that of any impact."
                    if limited
                    else "Probability of any impact in the mission against clearance. "
                    "Dashed: Rice's crossings taken for independent impacts.",
                    front=True,
                )
            ],
            notes=[capital(f"{HITS_PER_FIRST_HIT}.")] if len(rows_of(sizing, "simulated")) else [],
        ),
        worst_case_section(sizing),
    ]


def _three_sigma(sizing: Sizing) -> list[Grid]:
    """Risk and impacts at three times the linear rms; what is not simulated is left out."""
    three = sizing.three_sigma
    grids = Grid.by(
        f"at 3 sigma = {spoken_length(three.clearance)}, in {spoken_mission(sizing.mission)}",
        {
            "any impact": lambda: spoken_percent(three.probability.value),
            "impacts by Rice": lambda: count_of(three.rice_hits),
            "first impacts (clusters)": lambda: plus_minus(three.first_hits),
            "impacts, simulated": lambda: plus_minus(three.hits),
            f"mean impact speed ({SPEED})": lambda: plus_minus(three.impact_speed_mean, SPEED),
        },
        [()],
        0,
    )
    return [grid.known() for grid in grids]


def _impacts(sizing: Sizing) -> list[Grid]:
    """Impacts at 3 sigma and at the answer; other clearances were steps of the search."""
    places = [sizing.three_sigma.clearance, sizing.clearance.value]
    return Grid.by(
        "impacts on all stops, with the stop law",
        {
            f"clearance ({LENGTH})": length_of("clearance"),
            "in sigma": lambda row: row["clearance_in_sigma"],
            f"impacts ({RATE})": lambda row: RATE(row["hit_rate"]),
            "95 % interval": lambda row: _rates(row["hit_rate_low"], row["hit_rate_high"]),
            "impacts per cluster": lambda row: row["hits_per_first_hit"],
            f"mean speed ({SPEED})": lambda row: SPEED(row["impact_speed_mean"]),
            "by": lambda row: way_in_words(row["by"]),
        },
        [each for each in records(sizing, "simulated") if each[0]["clearance"] in places],
        ["by"],
    )


def _rates(low: float, high: float) -> str:
    """The interval of a rate of impacts."""
    return f"{RATE(low):.3g} to {RATE(high):.3g}"


def _several(sizing: Sizing) -> list[Section]:
    """Where the stops of several pairs go, their risk, and what the tolerances ask for."""
    mission = spoken_mission(sizing.mission)
    return [
        Section(
            title="Pair by pair",
            lead=_shared(sizing),
            grids=[
                *_places(sizing),
                *pairs_grids(sizing),
                *_risks(sizing),
                *Grid.by(
                    f"clearances for other probabilities of any impact in {mission}",
                    {
                        "pair": lambda name: name,
                        **{
                            f"{spoken_percent(row['probability'])} ({LENGTH})": partial(_cell, row)
                            for (row,) in records(sizing, "required")
                        },
                    },
                    [(name,) for name in sizing.clearances],
                ),
            ],
            pictures=[
                shown(
                    lambda: plot_pairs_risk(sizing),
                    "Probability of any impact as all clearances change.",
                    front=True,
                ),
            ],
        ),
        _pairs_tolerances(sizing),
    ]


def _cell(row: Row, name: str) -> str | None:
    """The length of a pair in a row."""
    return length_of(name)(row)


def _places(found: ClearanceAnswer) -> list[Grid]:
    """The clearance of each of several pairs to make, and its stops as a scene file has them; the
    stops are left out where a record contradicts the noise for which they hold."""
    made, done = found.rounded, bool(found.each_made)
    stops: dict[str, Callable[[Row], str | None]] = {
        f"{side}, in the scene file (m)": partial(_place, side) for side in ("lower", "upper")
    }
    columns = {
        "pair": lambda row: row["pair"],
        "clearance to make" if done else "clearance": lambda row: str(made[row["pair"]]),
        f"equilibrium ({LENGTH})": lambda row: LENGTH(round(row["mean_gap"], NANOMETRES)) + 0.0,
    }
    rows = records(found.rows_of_places() if found.several else [])
    return Grid.by(places_heading(found), columns | (stops if done else {}), rows)


def _place(side: str, row: Row) -> str | None:
    """The position of a stop, which takes all its digits; None where there is none."""
    return None if math.isnan(row[side]) else f"{row[side]:.9g}"


def places_heading(found: ClearanceAnswer) -> str:
    """The heading of the table of places."""
    if found.doubtful:
        return PLACES_FOR_NOISE
    return PLACES if found.each_made else PLACES_TRIED


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


def pairs_grids(sizing: Sizing) -> list[Grid]:
    """A row per pair: its clearance with the interval, and its risk. Columns without a known number
    are left out; a warning of the answer says why."""
    grids = Grid.by(
        f"pair by pair, as calculated, in {spoken_mission(sizing.mission)}",
        {
            "pair": lambda row: row["pair"],
            f"clearance ({LENGTH})": lambda row: " and ".join(
                dict.fromkeys(
                    f"{LENGTH(row[side]):.4g}"
                    for side in ("lower", "upper")
                    if not math.isnan(row[side])
                )
            ),
            "95 % interval": lambda row: (
                limits_of(each.lower, each.upper)
                if (each := sizing.clearances.get(row["pair"]))
                else "fixed"
            ),
            "in sigma": lambda row: f"{row['clearance_in_sigma']:.3g}",
            f"3 sigma ({LENGTH})": lambda row: 3.0 * LENGTH(row["sigma"]),
            "hit, if it alone had stops": _chance_of("probability_alone"),
            "of first impacts": lambda row: f"{100.0 * row['share_of_first_hits']:.3g} %",
            "expected impacts": lambda row: _known(row["expected_hits"]),
            f"mean speed ({SPEED})": lambda row: _known(SPEED(row["impact_speed_mean"])),
        },
        records(sizing, "pairs"),
    )
    return [grid.known() for grid in grids]


def _known(value: float) -> str | None:
    """A number with three digits; None where it is not known."""
    return None if math.isnan(value) else f"{value:.3g}"


def _risks(sizing: Sizing) -> list[Grid]:
    """The probability that any pair is hit, as sized, at 3 sigma, and with the stops of the
    scene."""
    chances = {
        "as sized": sizing.probability,
        "3 sigma of every gap": Probability.of(sizing.three_sigma.probability),
        "of the scene": sizing.as_given,
    }
    return Grid.by(
        f"probability that any pair is hit in {spoken_mission(sizing.mission)}",
        {
            "stops": lambda name, _: name,
            "probability": lambda _, chance: spoken_percent(chance.value),
            "95 % interval": lambda _, chance: interval_in_words(chance),
        },
        [(name, chance) for name, chance in chances.items() if chance is not None],
    )


def interval_in_words(chance: Probability) -> str:
    """The interval of a probability in per cent."""
    low = spoken_percent(chance.lower) if chance.lower > 0.0 else "0"
    return f"{low} to {spoken_percent(chance.upper)}"


def _pairs_tolerances(sizing: Sizing) -> Section:
    """The clearance that each sized pair needs for the same risk with each change, and where within
    the tolerances each is largest; empty without tolerances."""
    if len(rows := records(sizing, "tolerances")) < 2:
        return Section(title="Tolerances")
    largest: dict[str, list[str]] = {}
    for name, place in sizing.worst_at.items():
        largest.setdefault(place, []).append(name)
    return Section(
        title="Tolerances",
        lead=f"{sizing.allowed.in_words()}.",
        grids=Grid.by(
            "within the tolerances, by linear theory: clearances that each pair alone needs for "
            "the same risk; probability of any impact with those as stated; last, the largest of "
            "each column over the whole region",
            {
                "change": lambda row: row["change"],
                **{f"{name} ({LENGTH})": length_of(name) for name in sizing.clearances},
                "probability of any impact": _chance_of("probability"),
            },
            rows,
        ),
        notes=[f"Largest for {', '.join(each)}: {place}." for place, each in largest.items()],
    )


def _shared(sizing: Sizing) -> str:
    """How the pairs share the risk, in sentences."""
    if sizing.pair is not None:
        return "One pair is sized; the stops of the others stay where the scene has them."
    equally = "share the risk equally: each alone would be hit with the same probability."
    if not sizing.common:
        return f"Pairs {equally}"
    common = f"{', '.join(sizing.common)} have one clearance in common, so that their risks differ."
    rest = "" if set(sizing.common) == set(sizing.clearances) else f" The other pairs {equally}"
    return common + rest


# ------------------------------------------------------------------------------
# Clearances of missions with phases, and of a ratio of damage.
# ------------------------------------------------------------------------------


def clearance_told(found: ClearanceAnswer) -> Told:
    """The clearance to make, the line to copy, and what decides."""
    if isinstance(found, MissionSizing):
        return _told(
            found, [WITHOUT_TOLERANCES], [_phases(found)], assumptions=found.assumptions
        )  # fmt: skip
    assert isinstance(found, DamageSizing)
    return _told(found, [WITHOUT_TOLERANCES], [_damage(found)])


def _phases(found: MissionSizing) -> Section:
    """The share of each phase in the risk, and what its record says."""
    moved = found.phases["shift"].any()
    grids = Grid.by(
        "phases at the calculated clearance, and the clearance that each alone would need",
        {
            "phase": lambda row: row["phase"],
            "duration": lambda row: spoken_mission(row["duration"]),
            f"rms ({LENGTH})": lambda row: LENGTH(row["displacement_std"]),
            f"shift of rest ({LENGTH})": lambda row: LENGTH(row["shift"]) if moved else None,
            "probability there": _chance_of("probability"),
            "part of the risk": _chance_of("share"),
            f"clearance alone ({LENGTH})": length_of("clearance"),
        },
        records(found.phases),
        ["phase", "duration"],
    )
    return Section(
        title="Phase by phase",
        lead="Phases are independent, and each starts in its own stationary motion. So the "
        "probability of no impact in the mission is the product of those of its phases."
        if len(found.phases) > 1
        else "The mission starts in its stationary motion.",
        grids=[*_places(found), *(grid.known() for grid in grids)],
        pictures=[
            shown(
                lambda: plot_mission_sizing(found),
                "Probability of any impact in the mission against the clearance, 95 %.",
                front=True,
            )
        ],
        notes=[
            f"Phase {name}: {record.sentence()}."
            for name, record in found.records.items()
            if record.agrees
        ],
    )


def _damage(found: DamageSizing) -> Section:
    """The clearances that were tried."""
    return Section(
        title="Damage of equipment",
        lead="Equipment is a resonator on the mass, of each natural frequency and one Q. Its "
        "damage is that of its pseudo-velocity, by rainflow cycles and Miner's sum.",
        grids=[
            *_places(found),
            *Grid.by(
                "clearances that were tried",
                {
                    f"clearance ({LENGTH})": length_of("clearance"),
                    "times the damage": lambda row: plus_minus(
                        Estimate(value=row["damage_ratio"], standard_error=row["standard_error"])
                    ),
                    "at (Hz)": lambda row: row["frequency_hz"],
                    "by": lambda row: way_in_words(row["by"]),
                },
                records(found.tried),
                ["by"],
            ),
        ],
        pictures=[
            shown(
                lambda: plot_damage_sizing(found),
                "What stops add to the damage, less 1.",
                front=True,
            ),
            shown(
                lambda: plot_damage(found.damage),
                "Spectra at the clearance that is nearest to the calculated one.",
            ),
        ],
    )


def damage_sizing_told(found: DamageSizing) -> Told:
    """The clearance to make, the clearances that were tried, and the damage there."""
    told, there = clearance_told(found), damage_told(found.damage)
    spectra = Section(notes=[there.verdict, *there.statements])
    return replace(
        told, sections=[*told.sections, spectra, *there.sections], assumptions=there.assumptions,
        warnings=list(dict.fromkeys([*told.warnings, *there.warnings])),
    )  # fmt: skip


# ------------------------------------------------------------------------------
# Screening, clearances and perturbations.
# ------------------------------------------------------------------------------


def screening_told(linear: Screening) -> Told:
    """The verdict on a record, then the linear screening of coordinates and gaps."""
    told = record_told(linear.record)
    lines = [f"Without stops: {linear.motion_in_words()}", *linear.stops_in_words()]
    return replace(
        told,
        verdict=told.verdict or lines.pop(0),
        statements=[*told.statements, *lines],
        sections=[*told.sections, screening_section(linear)],
        warnings=linear.notes,
        brief=True,
    )


def screening_section(linear: Screening) -> Section:
    """The motion without stops, of coordinates, points and gaps."""
    caption = "linear screening, stops left out"
    if len(linear.coordinates) == 1:
        motion = [Grid.of(caption, linear.rows(), ["quantity", "unit"])]
    else:
        motion = [grid.known() for grid in _coordinates(caption, linear)]
    gaps = [Grid.of("gaps, and impacts by Rice", linear.rows_of_gaps(), ["pair"])]
    return Section(
        title="Linear screening",
        lead="The rule of three sigma rests on the Gaussian response of the structure without "
        "stops. Impacts are counted as Rice's crossings, as if impacts changed nothing.",
        grids=[*motion, *(gaps if linear.impact_pairs else [])],
    )


def _coordinates(caption: str, linear: Screening) -> list[Grid]:
    """A row per coordinate and point, with each number and its unit in one column."""

    def cell(name: str, unit: str) -> Callable[[Row], str | None]:
        return lambda row: None if row[name] is None else f"{row[name]:.4g} {row[unit]}"

    return Grid.by(
        caption,
        {
            "coordinate": lambda row: row["coordinate"],
            "displacement": cell("displacement", "unit"),
            "velocity": cell("velocity", "unit of velocity"),
            "absolute acceleration": cell("absolute acceleration", "unit of acceleration"),
            "zero up-crossings (Hz)": lambda row: row["zero up-crossings (Hz)"],
        },
        records(linear.rows()),
    )


def record_told(record: RecordVerdict | None, phase: str = "") -> Told:
    """Whether a record, of a phase where that is named, moves the mount as Gaussian noise would;
    nothing without a record."""
    if record is None:
        return Told()
    what = f"the record of phase {phase}" if phase else "this record"
    verdict = record.agreement(what)
    if not record.agrees:
        verdict = f"do not judge by the spectrum: {record.headline(what)}."
    return Told(
        verdict=capital(verdict),
        alarm=not record.agrees,
        statements=[] if record.agrees else [*map(capital, (record.reason(), record.needs()))],
        sections=[Section(notes=[sentence(record.sentence())])],
        brief=True,
        next=() if record.agrees else (*REPLAYED, f"#{phase}" * bool(phase)),
    )


REPLAYED = ("the clearance that this record needs", "replay")
"""What is next where a record is no Gaussian noise: in words, and the command."""


def curve_told(curve: DataFrame, notes: Sequence[str] = ()) -> Told:
    """The impact rate against clearance, as `clearance_curve` returns it, and the notes on it."""
    pair = {"pair": lambda row: row["pair"]} if "pair" in curve else {}
    grids = Grid.by(
        f"impacts per {RATE.time} on both stops, and mean impact speed",
        {
            **pair,
            "gap/sigma": lambda row: f"{row['clearance_in_sigma']:.2f}",
            f"gap ({LENGTH})": lambda row: LENGTH(row["clearance"]),
            f"Rice ({RATE})": lambda row: RATE(row["rice"]),
            f"closure ({RATE})": lambda row: RATE(row["closure"]),
            f"simulated ({RATE})": lambda row: RATE(row["simulated"]),
            "95 % interval": lambda row: _rates(row["simulated_low"], row["simulated_high"]),
            f"mean speed ({SPEED})": lambda row: SPEED(row["impact_speed_mean"]),
        },
        records(curve),
        len(pair),
    )
    return Told(sections=[Section(grids=grids)], warnings=notes)


def jolts_told(found: Jolts) -> Told:
    """Whether perturbations lead to clatter, and the shares of paths."""
    grids = Grid.by(
        f"shares of {found.paths} paths, watched for {found.duration:.3g} s",
        {
            f"perturbation ({SPEED})": lambda row: SPEED(row["jolt"]),
            "captured": lambda row: row["captured"],
            "95 % interval": lambda row: f"{row['captured_low']:.3g} to {row['captured_high']:.3g}",
            "on both stops": lambda row: row["on_both_stops"],
            "left later": lambda row: row["left_later"],
        },
        records(found.to_frame()),
        0,
    )
    return Told(verdict=found.summary(), sections=[Section(grids=grids)])
