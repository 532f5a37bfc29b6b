"""Sections of reports. Chapters: cards of measured records; sections on changed scenes, on inputs,
and on several pairs."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

from stochvi.isolators.sizing.answer import MOST_NAMED, places_in_words
from stochvi.isolators.tolerances import in_words
from stochvi.mathematics.units import ACCELERATION, LENGTH, SPEED, spoken_mission
from stochvi.results.estimates import spoken_percent
from stochvi.scenes.excitations import Excitation
from stochvi.scenes.excitations.base import BASE, DensityNoise
from stochvi.scenes.scene import Scene
from stochvi.scenes.structures import Isolator, Oscillator
from stochvi.views.isolator_tables import (
    COSTS,
    TOLERANCES,
    coordinates_in_rows,
    interval_in_words,
    pairs_in_words,
    places_heading,
    places_in_rows,
    plot_costs,
    plot_pairs_clearances,
    plot_pairs_risk,
    plot_units,
    production_in_rows,
    required_in_rows,
    risk_in_words,
    units_heading,
    units_in_rows,
    worst_places,
)
from stochvi.views.isolator_tables import tolerances_in_rows as pairs_in_rows
from stochvi.views.pages import Fact, Grid, Picture, Section, sentence, shown
from stochvi.views.schematic import (
    draw_gaps,
    draw_problem,
    modes_in_rows,
    one_axis_in_rows,
    plot_box,
)
from stochvi.views.sizing import plot_input, plot_response, plot_sensitivity
from stochvi.views.tables import (
    UNKNOWN,
    Heading,
    chance_of_stops,
    clearances_of_changes,
    equilibrium_in_words,
    four_digits,
    spoken_length,
    with_headings,
)

if TYPE_CHECKING:
    import pandas as pd

    from stochvi.isolators.production_risk import Production
    from stochvi.isolators.record_verdict import RecordVerdict
    from stochvi.isolators.screening import Screening
    from stochvi.isolators.sizing.answer import Sizing
    from stochvi.isolators.sizing.review import Review


# ------------------------------------------------------------------------------
# The cards of a page on what measured records need.
# ------------------------------------------------------------------------------


def record_cards(
    record: RecordVerdict | None, phases: Mapping[str, RecordVerdict] | None = None
) -> list[Fact]:
    """The clearance that a measured record itself needs, at each gap of a structure and in each of
    the `phases`; where these are many, the largest. Empty without a record."""
    if record is None:
        return []
    named = {f" in phase {name}": each for name, each in (phases or {}).items()} or {"": record}
    every = [
        (f"{f' at {gap.gap}' if gap.gap else ''}{phase}", gap)
        for phase, verdict in named.items()
        for gap in verdict.gaps
    ]
    shown = sorted(every, key=lambda each: -each[1].clearance)
    more = ""
    if len(shown) > MOST_NAMED:
        more = f"; the largest of {len(shown)}"
        shown = shown[:1]
    return [_card(where, verdict, more) for where, verdict in shown]


def _card(where: str, record: RecordVerdict, more: str) -> Fact:
    judged = (
        "contradicts"
        if record.contradicts
        else "agrees with"
        if record.agrees
        else "is too short to be judged against"
    )
    sides = record.needed_on_each_side or "per side"
    return Fact(
        f"The record itself needs{where}",
        record.needed,
        f"{sides}, from the static equilibrium; it moves {record.peak_in_sigma:.3g} sigma and "
        f"{judged} Gaussian noise, which would "
        f"move {record.expected_peak_in_sigma:.3g} in its time; response kurtosis "
        f"{record.kurtosis:.3g}, 3 ± {record.kurtosis_error:.2g} for Gaussian noise{more}",
    )


# ------------------------------------------------------------------------------
# Sections of a clearance report on changed scenes: tolerances, production and sensitivity.
# ------------------------------------------------------------------------------


def worst_case_section(review: Review) -> Section:
    """Each tolerance at its ends, and the worst within all of them; empty without tolerances."""
    table = review.worst_case
    if table is None:
        return Section(title="Tolerances")
    return Section(
        title="Tolerances",
        lead="The clearance for the same target, from the static equilibrium of the mount as "
        "stated, and the probability of any impact that then remains: "
        f"{review.tolerances.in_words()}. Each is at its ends first. Last is the largest "
        "requirement within all of them: the response of the mount is searched over the whole "
        "region, and the scene that is found there is sized.",
        grids=[_changes_grid(table, "Each row is sized anew")],
        pictures=_change_bars(table),
        notes=_notes_of(table),
    )


def production_section(found: Production | None) -> Section:
    """The risk of the production; empty without distributions of tolerances."""
    if found is None:
        return Section(title="Production")
    return Section(
        title="Production",
        lead=f"Units differ: {in_words(found.spreads)}. "
        + " ".join(sentence(line) for line in risk_in_words(found)),
        grids=[
            Grid.of(COSTS, production_in_rows(found)),
            Grid.of(units_heading(found), units_in_rows(found)),
        ],
        pictures=[
            shown(lambda: plot_units(found), "Units by their probability of any impact."),
            shown(lambda: plot_costs(found), "Clearance that each tolerance costs."),
        ],
        notes=[sentence(found.method)],
    )


def sensitivity_section(table: pd.DataFrame | None) -> Section:
    """The changed scenes of `sensitivity`."""
    if table is None:
        return Section(title="Sensitivity")
    return Section(
        title="Sensitivity",
        lead="The clearance for the same target if mount, environment or stops are not as stated, "
        "and the probability of any impact that then remains.",
        grids=[_changes_grid(table, "One thing changed at a time, the rest as stated")],
        pictures=_change_bars(table),
        notes=_notes_of(table),
    )


def _changes_grid(table: pd.DataFrame, caption: str) -> Grid:
    def number(value: float, text: Callable[[float], str]) -> str:
        return UNKNOWN if math.isnan(value) else text(value)

    lengths: dict[str, Heading] = {"sigma": ("linear rms ()", LENGTH)} if "sigma" in table else {}
    lengths |= clearances_of_changes(table)
    shown = with_headings(table, lengths)
    return Grid(
        caption=caption,
        headings=["change", *shown, "by (%)", "any impact, clearance as stated"],
        rows=[
            [
                row["change"],
                *(number(each, four_digits) for each in places),
                number(row["clearance_change"], lambda x: f"{100.0 * x:+.3g}"),
                number(row["probability"], spoken_percent),
            ]
            for row, places in zip(table.to_dict("records"), shown.to_numpy(), strict=True)
        ],
    )


def _change_bars(table: pd.DataFrame) -> list[Picture]:
    known = table.dropna(subset=["clearance_change"])
    if len(known) < 2:
        return []
    return [shown(lambda: plot_sensitivity(known), "Change of the clearance, per cent.")]


def _notes_of(table: pd.DataFrame) -> list[str]:
    return [f"{row['change']}: {row['note']}" for row in table.to_dict("records") if row["note"]]


# ------------------------------------------------------------------------------
# Sections of a clearance report on its inputs: environment, isolator, gap and stops.
# ------------------------------------------------------------------------------


UNITS_IN_WORDS = (
    "All densities are one-sided per hertz; accelerations are rms unless they are stated to be "
    "peak. 1 g = 9.80665 m/s²."
)
"""What the numbers of an environment are."""

AREA_IN_WORDS = "area under the density, log-log straight between breakpoints"
"""How an rms acceleration is recomputed."""


def excitation_facts(
    scene: Scene, excitation: Excitation, numbers: Mapping[str, float]
) -> list[Fact]:
    """What an excitation is, and along which axis it acts, by its `numbers`."""
    place, words = scene.place(excitation), scene.place_in_words(excitation)
    (name, *told), *others = excitation.facts(place, numbers)
    return [Fact(name.replace(f" on {place}", f" on {words}"), *told), *(Fact(*r) for r in others)]


def environment_section(review: Review) -> Section:
    """The section on the excitations and the motion of the base."""
    scene, found = review.sizing.scene, review.environment
    facts = [
        fact
        for excitation, numbers in zip(scene.excitations, found.excitations, strict=True)
        for fact in excitation_facts(scene, excitation, numbers)
    ]
    if found.base is not None:
        facts += [
            Fact(
                "Base acceleration, recomputed",
                f"{ACCELERATION.text(found.base.acceleration_std)} rms",
                AREA_IN_WORDS,
            ),
            Fact("Base velocity", f"{SPEED.text(found.base.velocity_std)} rms"),
            Fact(
                "Base displacement",
                f"{spoken_length(found.base.displacement_std)} rms",
                "set by the lowest frequencies of the table",
            ),
        ]
    pictures = []
    if found.spectra is not None:
        pictures = [
            shown(
                lambda: plot_input(review),
                "Input: one-sided density of the base acceleration, with its "
                "breakpoints and a band of ±3 dB.",
            ),
            shown(
                lambda: plot_response(review),
                "Absolute acceleration of the mass without stops, over the input.",
            ),
        ]
    return Section(title="Environment", lead=UNITS_IN_WORDS, facts=facts, pictures=pictures)


def excitations_section(scene: Scene) -> Section:
    """The section on the excitations of a scene of any structure."""
    facts = []
    for excitation in scene.excitations:
        facts += excitation_facts(scene, excitation, excitation.numbers())
        if isinstance(excitation, DensityNoise) and scene.place(excitation) == BASE:
            rms = math.sqrt(excitation.table.mean_square())
            facts.append(
                Fact("Acceleration, recomputed", f"{ACCELERATION.text(rms)} rms", AREA_IN_WORDS)
            )
    return Section(title="Environment", lead=UNITS_IN_WORDS, facts=facts)


def mount_section(review: Review) -> Section:
    """The section on the isolator."""
    structure, found = review.sizing.scene.structure, review.mount
    assert isinstance(structure, Oscillator)
    quality = "" if found.quality_factor is None else f"  (Q = {found.quality_factor:.3g})"
    facts = [
        Fact(
            "Natural frequency",
            f"{found.natural_frequency_hz:.4g} Hz",
            _tolerance(structure, "frequency"),
        ),
        Fact(
            "Damping ratio",
            f"{found.damping_ratio:.4g}{quality}",
            _tolerance(structure, "damping"),
        ),
    ]
    if structure.mass is not None:
        facts.append(Fact("Mass", f"{structure.mass:.4g} kg"))
    if isinstance(structure, Isolator) and found.static_sag is not None:
        if structure.mounts is not None:
            facts.append(
                Fact(
                    "Mounts side by side",
                    f"{structure.mounts}",
                    f"{structure.stiffness:g} N/m and {structure.damping:g} N s/m each",
                )
            )
        counted = (
            "counted: gravity pulls towards negative x"
            if structure.gravity
            else "for information: it does not move the equilibrium of the scene"
        )
        facts.append(
            Fact(
                "Static sag under 1 g",
                spoken_length(found.static_sag),
                f"{counted}; g / ω², by the dynamic stiffness",
            )
        )
    return Section(title="Isolator", facts=facts)


def _tolerance(structure: Oscillator, what: str) -> str:
    stated = getattr(structure, f"{what}_tolerance", None)
    return "" if stated is None else f"± {100.0 * stated:.3g} %, see Tolerances"


def gap_section(review: Review) -> Section:
    """The section on the stops to make and on those of the scene: clearances from the static
    equilibrium, positions of a scene file from the unloaded spring."""
    sizing = review.sizing
    scene, found = sizing.scene, sizing.gap
    facts = [
        Fact(
            f"Clearance of the {side} stop, to make",
            str(sizing.widest),
            f"in the scene file {side} = {place:.9g} (m)",
        )
        for side, place in found.recommended.items()
        if sizing.stops_to_copy()
    ]
    if scene.impact_pairs:
        pair = scene.impact_pairs[0]
        for side, law in pair.stops():
            facts.append(
                Fact(
                    f"Clearance of the {side} stop of the scene",
                    spoken_length(found.distances[side]),
                    f"in the scene file {side} = {getattr(pair, side):.6g} (m); {law.phrase()}",
                )
            )
        facts.append(
            Fact(
                "Any impact with the stops of the scene",
                chance_of_stops(sizing),
                f"probability in {spoken_mission(sizing.mission)}, each side by its own distance",
            )
        )
    rest = (
        f"{equilibrium_in_words(sizing)} under gravity and constant loads"
        if found.mean_position
        else "without gravity or a load, that is where the mass hangs"
    )
    names = [pair.name for pair in scene.impact_pairs] or ["stops"]
    drawn, where = scene, "as the scene file states them"
    if scene.impact_pairs and sizing.stops_to_copy():
        made = scene.impact_pairs[0].replace(**found.recommended)
        drawn, where = scene.replace(impact_pairs=[made]), "at the clearance to make"
    return Section(
        title="Gap and stops",
        lead="A clearance is the distance of a stop from the static equilibrium, where the mass "
        "hangs, relative to the base. Positions in a scene file (lower, upper) count from the "
        f"unloaded spring; {rest}. The probability of any impact does not depend on the law of the "
        "stops; what the impacts do depends on it.",
        facts=facts,
        pictures=[
            shown(
                lambda: draw_problem(drawn, dict.fromkeys(names, found.mean_position)),
                f"The scene with its stops {where}; not to scale.",
                wide=True,
            )
        ],
    )


# ------------------------------------------------------------------------------
# Sections of a clearance report on several pairs: clearance by clearance, and the box.
# ------------------------------------------------------------------------------


def pairs_cards(sizing: Sizing) -> list[Fact]:
    """The clearances to make, and the risk with them and at 3 sigma of every gap."""
    mission, own, gaussian = (
        spoken_mission(sizing.mission), record_cards(sizing.record), _clearance_cards(sizing),
    )  # fmt: skip
    three, any_hit = sizing.three_sigma.probability.value, sizing.probability
    assert any_hit is not None
    return [
        *(own + gaussian if sizing.doubtful else gaussian + own),
        Fact(
            "Probability of any impact",
            spoken_percent(any_hit.value),
            f"{interval_in_words(any_hit)}, 95 %; as calculated"
            + ("" if sizing.doubtful is None else ", for Gaussian noise alone"),
        ),
        *(
            [Fact("Expected impacts", sizing.expected_in_words(), f"in {mission}")]
            if sizing.expected_hits is not None
            else []
        ),
        Fact("At 3 sigma of every gap", spoken_percent(three), mission),
    ]


def pairs_section(sizing: Sizing) -> Section:
    """Where the stops of each pair go, its risk, and the clearances for other risks."""
    return Section(
        title="Pair by pair",
        lead=_shared(sizing),
        grids=[
            Grid.of(places_heading(sizing), places_in_rows(sizing)),
            Grid.of("Clearances and risk as calculated", pairs_in_words(sizing)),
            Grid.of(
                "Clearances for other probabilities of any impact, as calculated",
                required_in_rows(sizing),
            ),
        ],
        pictures=[
            shown(
                lambda: draw_gaps(sizing.as_made().impact_pairs, sizing.rests),
                f"Stops {_where(sizing)}, from the unloaded mounts.",
            ),
            shown(lambda: plot_pairs_clearances(sizing), "Clearances and the rule of three sigma."),
            shown(
                lambda: plot_pairs_risk(sizing),
                "Probability of any impact as all clearances change.",
            ),
        ],
    )


def _where(sizing: Sizing) -> str:
    """Where the stops of the drawing stand."""
    if not sizing.each_made:
        return "as the scene file states them"
    return "at the clearances to make, as a scene file has them"


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


def gaps_screening_section(linear: Screening) -> Section:
    """The motion without stops, of coordinates, points and gaps."""
    return Section(
        title="Linear screening",
        lead="The rule of three sigma rests on the Gaussian response of the structure without "
        "stops. Impacts are counted as Rice's crossings, as if impacts changed nothing.",
        grids=[
            Grid.of("Coordinates and points", coordinates_in_rows(linear)),
            Grid.of("Gaps and stops of the scene", linear.gaps_to_frame()),
        ],
    )


def pairs_tolerances_section(sizing: Sizing) -> Section:
    """What changes within the tolerances ask for; empty without tolerances."""
    if len(sizing.tolerances) < 2:
        return Section(title="Tolerances")
    return Section(
        title="Tolerances",
        lead=f"{sizing.allowed.in_words()}.",
        grids=[Grid.of(f"{TOLERANCES[0].upper()}{TOLERANCES[1:]}", pairs_in_rows(sizing))],
        notes=[f"{line[0].upper()}{line[1:]}." for line in worst_places(sizing)],
    )


def _clearance_cards(sizing: Sizing) -> list[Fact]:
    """The clearance of each pair to make; for many pairs the smallest and the largest."""
    made = sizing.rounded
    purpose = "to make" if sizing.doubtful is None else "for Gaussian noise alone"
    tried = "" if sizing.shown_to_keep else " were tried, and not shown to keep the target"
    if not made or tried:
        text = f"{places_in_words(made)}{tried}" if made else "none was found within the tolerances"
        return [Fact(f"Clearances {purpose}", UNKNOWN, f"{text}; raise the budget")]
    named = list(sizing.clearances)
    if len(named) > MOST_NAMED:
        by_size = sorted(made, key=lambda name: made[name].value)
        named = [by_size[0], by_size[-1]]
    cards = []
    for name in named:
        each = sizing.clearances[name]
        cards.append(
            Fact(
                f"Clearance of {name} {purpose}",
                str(made[name]),
                f"per side, from the static equilibrium; calculated {LENGTH.text(each.value)}, "
                f"{LENGTH.span(each.lower, each.upper)}, 95 %",
            )
        )
    return cards


def box_sections(sizing: Sizing) -> list[Section]:
    """The section on a rigid box: its picture, its modes, and the rule of three sigma by axis."""
    if sizing.box is None:
        return []
    return [
        Section(
            title="The box",
            lead="Three sigma of one axis is the clearance that sizing the box as one oscillator "
            "along each axis would give. The probability there is that of an impact on this "
            "snubber alone, by Rice's rate for its gap on the real box.",
            grids=[
                Grid.of("Snubber by snubber, against one oscillator", one_axis_in_rows(sizing)),
                Grid.of("Natural modes without stops", modes_in_rows(sizing.box)),
            ],
            pictures=[
                shown(
                    lambda: plot_box(sizing),
                    "The box, its mounts and its snubbers, by their risk with the stops of the "
                    "scene.",
                )
            ],
        )
    ]
