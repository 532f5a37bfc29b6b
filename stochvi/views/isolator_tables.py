"""Descriptions of isolators. Chapters: changed scenes and productions; a sizing; missions with
phases, and ratios of damage; screening, clearances and perturbations; pictures of missions."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from stochvi.isolators.sizing.answer import (
    HITS_PER_FIRST_HIT,
    DamageSizing,
    Probability,
)
from stochvi.isolators.tolerances import Tolerances, in_words
from stochvi.mathematics.units import LENGTH, RATE, spoken_mission
from stochvi.results.base import DataFrame, rows_of
from stochvi.results.estimates import (
    Estimate,
    capital,
    spoken_percent,
)
from stochvi.views.axes import (
    TALL,
    axes_or_new,
)
from stochvi.views.pages import (
    Grid,
    Picture,
    Section,
    Told,
    sentence,
)
from stochvi.views.sizing import (
    plot_costs,
    plot_damage_sizing,
    plot_pairs_risk,
    plot_risk,
    plot_sizing,
    plot_units,
)
from stochvi.views.statistics import damage_told, plot_damage
from stochvi.views.tables import (
    WITHOUT_TOLERANCES,
    four_digits,
    limits_of,
    never_tolerances,
    of_less_risk,
    of_three_sigma,
    of_your_stops,
    spoken_length,
    to_copy,
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
        grids=Grid.of(
            caption,
            table,
            [
                "change",
                *["linear rms = sigma {length}"] * ("sigma" in table),
                *((name, name, "length") for name in names),
                "by = clearance_change {% +.1f}",
                "any impact, clearance as stated = probability {likely}",
            ],
        ),
        notes=[f"{row['change']}: {row['note']}" for row in rows_of(table) if row["note"]],
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
            *Grid.of(
                "what each tolerance costs: clearance, and share of its variance between units",
                found.tolerances,
                "tolerance; costs = clearance_cost {.3g}; alone = first_order {%}; "
                "with others = total {%}",
            ),
            *Grid.of(
                "units from the best to the worst: probability of any impact in "
                f"{spoken_mission(found.mission)}",
                units,
                "share_of_units {percent}; at most = probability {likely}; "
                "would need = clearance {length}",
            ),
        ],
        pictures=[
            Picture(lambda: plot_units(found), "Units by their probability of any impact."),
            Picture(lambda: plot_costs(found), "Clearance that each tolerance costs."),
        ],
        notes=[*map(sentence, risk_in_words(found)), f"Method of the production: {found.method}."],
    )


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
    if sizing.scene.phases:
        lines = [] if sizing.varies else [WITHOUT_TOLERANCES]
        sections = [_phases(sizing), _linear_tolerances(sizing)]
        return _told(sizing, lines, sections, assumptions=sizing.assumptions)
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
                *Grid.of(
                    f"clearance per side by the probability of any impact in {mission}",
                    rows_of(sizing, "required"),
                    "probability of any impact = probability {likely}; clearance {length}; "
                    "95 % interval = limits; in sigma = clearance_in_sigma",
                    limits=lambda row: limits_of(row["clearance_low"], row["clearance_high"]),
                ),
                *_three_sigma(sizing),
                *_impacts(sizing),
            ],
            pictures=[
                Picture(
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
    return Grid.of(
        f"at 3 sigma = {spoken_length(three.clearance)}, in {spoken_mission(sizing.mission)}",
        [three],
        "any impact = risk {likely}; impacts by Rice = rice_hits {count}; "
        "first impacts (clusters) = first_hits; impacts, simulated = simulated; "
        "mean impact speed = impact_speed_mean",
        0,
        risk=lambda three: three.probability.value,
        simulated=lambda three: three.hits,
    )


def _impacts(sizing: Sizing) -> list[Grid]:
    """Impacts at 3 sigma and at the answer; other clearances were steps of the search."""
    places = [sizing.three_sigma.clearance, sizing.clearance.value]
    return Grid.of(
        "impacts on all stops, with the stop law",
        [row for row in rows_of(sizing, "simulated") if row["clearance"] in places],
        "clearance {length}; in sigma = clearance_in_sigma; impacts = hit_rate; "
        "95 % interval = rates; impacts per cluster = hits_per_first_hit; "
        "mean speed = impact_speed_mean; by {way}",
        ["by"],
        rates=lambda row: _rates(row["hit_rate_low"], row["hit_rate_high"]),
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
                *Grid.across(
                    f"clearances for other probabilities of any impact in {mission} ({LENGTH})",
                    "pair",
                    {
                        (name, spoken_percent(row["probability"])): four_digits(LENGTH(row[name]))
                        for name in sizing.clearances
                        for row in rows_of(sizing, "required")
                        if not math.isnan(row[name])
                    },
                ),
            ],
            pictures=[
                Picture(
                    lambda: plot_pairs_risk(sizing),
                    "Probability of any impact as all clearances change.",
                    front=True,
                ),
            ],
        ),
        _linear_tolerances(sizing),
    ]


def _places(found: ClearanceAnswer) -> list[Grid]:
    """The clearance of each of several pairs to make, and its stops as a scene file has them; the
    stops are left out where a record contradicts the noise for which they hold."""
    made, done = found.rounded, bool(found.each_made)
    stops = [(f"{side}, in the scene file (m)", side, "1 .9g") for side in ("lower", "upper")]
    return Grid.of(
        places_heading(found),
        found.rows_of_places() if found.several else [],
        [
            "pair",
            f"clearance{' to make' * done} = made",
            "equilibrium = rest {m}",
            *(stops if done else []),
        ],
        made=lambda row: made[row["pair"]],
        rest=lambda row: round(row["mean_gap"], NANOMETRES) + 0.0,
    )


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

    def places(row: Row) -> str:
        known = [LENGTH(row[side]) for side in ("lower", "upper") if not math.isnan(row[side])]
        return " and ".join(dict.fromkeys(f"{each:.4g}" for each in known))

    def limits(row: Row) -> str:
        each = sizing.clearances.get(row["pair"])
        return "fixed" if each is None else limits_of(each.lower, each.upper)

    return Grid.of(
        f"pair by pair, as calculated, in {spoken_mission(sizing.mission)}",
        rows_of(sizing, "pairs"),
        "pair; clearance = places {m}; 95 % interval = limits; in sigma = clearance_in_sigma "
        "{.3g}; 3 sigma = three {m}; hit, if it alone had stops = probability_alone {likely}; "
        "of first impacts = share_of_first_hits {percent}; expected impacts = expected_hits {.3g}; "
        "mean speed = impact_speed_mean {.3g}",
        places=places,
        limits=limits,
        three=lambda row: 3.0 * row["sigma"],
    )


def _risks(sizing: Sizing) -> list[Grid]:
    """The probability that any pair is hit, as sized, at 3 sigma, and with the stops of the
    scene."""
    chances = {
        "as sized": sizing.probability,
        "3 sigma of every gap": Probability.of(sizing.three_sigma.probability),
        "of the scene": sizing.as_given,
    }
    return Grid.of(
        f"probability that any pair is hit in {spoken_mission(sizing.mission)}",
        [(name, chance) for name, chance in chances.items() if chance is not None],
        "stops = name; probability = value {likely}; 95 % interval = interval",
        interval=lambda _, chance: interval_in_words(chance),
    )


def interval_in_words(chance: Probability) -> str:
    """The interval of a probability in per cent."""
    low = spoken_percent(chance.lower) if chance.lower > 0.0 else "0"
    return f"{low} to {spoken_percent(chance.upper)}"


def _linear_tolerances(sizing: Sizing) -> Section:
    """The clearance that each sized pair needs for the same risk with each change, and where within
    the tolerances each is largest; empty without tolerances."""
    if len(rows := rows_of(sizing, "tolerances")) < 2:
        return Section(title="Tolerances")
    alone, largest = "", dict[str, list[str]]()
    if sizing.scene.phases:
        last = "the largest over the whole region, where the mission is simulated"
    else:
        alone, last = " that each pair alone needs", "the largest of each column over the region"
        for name, place in sizing.worst_at.items():
            largest.setdefault(place, []).append(name)
    return Section(
        title="Tolerances",
        lead=f"{sizing.allowed.in_words()}.",
        grids=Grid.of(
            f"within the tolerances, by linear theory: clearances{alone} for the same risk; "
            f"probability of any impact with those as stated; last, {last}",
            rows,
            [
                "change",
                *((name, name, "length") for name in sizing.clearances),
                "probability of any impact = probability {likely}",
            ],
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


def _phases(found: Sizing) -> Section:
    """The share of each phase in the risk, and what its record says."""
    moved = bool(found.phases["shift"].any())
    grids = Grid.of(
        "phases at the calculated clearance, and the clearance that each alone would need",
        found.phases,
        f"phase; duration {{mission}}; rms = displacement_std; {'shift of rest = shift;' * moved} "
        "probability there = probability {likely}; part of the risk = share {likely}; "
        "clearance alone = clearance {length}",
        ["phase", "duration"],
    )
    return Section(
        title="Phase by phase",
        lead="Phases are independent, and each starts in its own stationary motion. So the "
        "probability of no impact in the mission is the product of those of its phases."
        if len(found.phases) > 1
        else "The mission starts in its stationary motion.",
        grids=[*_places(found), *grids],
        pictures=[
            Picture(
                lambda: plot_sizing(found),
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
            *Grid.of(
                "clearances that were tried",
                found.tried,
                "clearance {length}; times the damage = times; at = frequency_hz {Hz}; by {way}",
                ["by"],
                times=lambda row: Estimate(
                    value=row["damage_ratio"], standard_error=row["standard_error"]
                ),
            ),
        ],
        pictures=[
            Picture(
                lambda: plot_damage_sizing(found),
                "What stops add to the damage, less 1.",
                front=True,
            ),
            Picture(
                lambda: plot_damage(found.damage),
                "Spectra at the clearance that is nearest to the calculated one.",
            ),
        ],
    )


def damage_ratio_told(found: DamageSizing) -> Told:
    """The clearance to make, and the clearances that were tried."""
    lines = [never_tolerances(Tolerances.of(found.scene).in_words())]
    return _told(found, lines, [_damage(found)])


def damage_sizing_told(found: DamageSizing) -> Told:
    """The same, and the damage there."""
    told, there = damage_ratio_told(found), damage_told(found.damage)
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
        motion = Grid.of(caption, linear.rows(), words=["quantity", "unit"])
    else:
        motion = _coordinates(caption, linear)
    gaps = Grid.of("gaps, and impacts by Rice", linear.rows_of_gaps())
    return Section(
        title="Linear screening",
        lead="The rule of three sigma rests on the Gaussian response of the structure without "
        "stops. Impacts are counted as Rice's crossings, as if impacts changed nothing.",
        grids=[*motion, *gaps],
    )


def _coordinates(caption: str, linear: Screening) -> list[Grid]:
    """A row per coordinate and point, with each number and its unit in one column."""

    parts = {
        "displacement": "unit", "velocity": "unit of velocity",
        "absolute acceleration": "unit of acceleration",
    }  # fmt: skip

    def spoken(row: dict[str, Any]) -> dict[str, Any]:
        known = {name: unit for name, unit in parts.items() if row[name] is not None}
        words = {name: f"{row[name]:.4g} {row[unit]}" for name, unit in known.items()}
        return {n: e for n, e in (row | words).items() if n not in parts.values()}

    rows = [spoken(row) for row in linear.rows()]
    return Grid.of(caption, rows, [(name, name, "1") for name in rows[0]])


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
    grids = Grid.of(
        f"impacts per {RATE.time} on both stops, and mean impact speed",
        curve,
        "pair; " * ("pair" in curve) + "gap/sigma = clearance_in_sigma {.2f}; gap = clearance; "
        "Rice = rice; closure; simulated; 95 % interval = rates; mean speed = impact_speed_mean",
        ["pair"],
        rates=lambda row: _rates(row["simulated_low"], row["simulated_high"]),
    )
    return Told(sections=[Section(grids=grids)], warnings=notes)


def jolts_told(found: Jolts) -> Told:
    """Whether perturbations lead to clatter, and the shares of paths."""
    grids = Grid.of(
        f"shares of {found.paths} paths, watched for {found.duration:.3g} s",
        found.to_frame(),
        "perturbation = jolt; captured; from = captured_low {.3g}; to = captured_high {.3g}; "
        "on_both_stops; left_later",
        0,
    )
    return Told(
        verdict=found.summary(), sections=[Section(grids=grids)], warnings=list(found.warnings)
    )
