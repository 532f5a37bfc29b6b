"""Sections of reports. Chapters: cards of measured records; sections on changed scenes, on inputs,
and on several pairs."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

from stochvi.isolators.sizing.answer import (
    MOST_NAMED,
    ClearanceAnswer,
    Sizing,
    places_in_words,
    sides_in_words,
)
from stochvi.mathematics.units import ACCELERATION, LENGTH, SPEED, spoken_mission
from stochvi.results.base import rows_of
from stochvi.results.estimates import spoken_percent
from stochvi.scenes.excitations import Excitation
from stochvi.scenes.excitations.base import BASE, DensityNoise
from stochvi.scenes.scene import Scene
from stochvi.scenes.structures import Isolator, Oscillator
from stochvi.views.isolator_tables import (
    interval_in_words,
)
from stochvi.views.pages import Fact, Grid, Picture, Section
from stochvi.views.schematic import (
    draw_gaps,
    draw_problem,
    mount_in_words,
    plot_box,
)
from stochvi.views.sizing import plot_input
from stochvi.views.tables import (
    UNKNOWN,
    equilibrium_in_words,
    hit_in_words,
    limits_of,
    modes_in_rows,
    spoken_length,
)

if TYPE_CHECKING:
    from stochvi.isolators.record_verdict import RecordVerdict
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
    """What a record needs; why it is no Gaussian noise, where it is none."""
    evidence = (
        f": it moves {record.peak_in_sigma:.3g} sigma, where Gaussian noise would move "
        f"{record.expected_peak_in_sigma:.3g} in its time; response kurtosis "
        f"{record.kurtosis:.3g}, 3 ± {record.kurtosis_error:.2g} for Gaussian noise"
    )
    return Fact(
        f"The record itself needs{where}",
        record.needed,
        f"{record.needed_by_side}; {record.headline()}{'' if record.agrees else evidence}{more}",
    )


# ------------------------------------------------------------------------------
# The cards of every clearance: the number to sign stands first.
# ------------------------------------------------------------------------------


def clearance_cards(found: ClearanceAnswer) -> list[Fact]:
    """The clearance to make, of several pairs that of each, and what a record itself needs. The
    record stands first where it does not agree with the noise."""
    own = record_cards(found.record, getattr(found, "records", None))
    cards = _places(found) if found.several else _place(found)
    return own + cards if found.doubtful else cards + own


def _purpose(found: ClearanceAnswer) -> str:
    return "for Gaussian noise alone" if found.doubtful else "to make"


def _place(found: ClearanceAnswer) -> list[Fact]:
    """The clearance of the only pair to make, and as calculated."""
    made, c, name = found.widest, found.clearance, f"Clearance {_purpose(found)}"
    sides = sides_in_words(found.hanging, found.clearances)
    enough = within = stated = sigmas = ""
    interval = f"{limits_of(c.lower, c.upper)} (95 % of the calculation)"
    if isinstance(found, Sizing) and found.within:
        within, stated = f"{found.within.lstrip()}; ", "without tolerances; "
    if isinstance(found, Sizing) and not found.scene.phases:
        sigmas = f", {c.value / found.sigma:.2f} sigma"
        if found.kept_with is not None:
            enough, interval = "enough, and less may be; ", "the nearest stops that can be judged"
    if made is None:
        first = Fact(name, UNKNOWN, "what the target needs within the tolerances was not found")
    elif not found.shown_to_keep:
        why = f"{made} was not shown to keep the target; raise the budget"
        first = Fact(name, UNKNOWN, why)
    else:
        rests = f"{enough}{sides}; {within}"
        first = Fact(name, str(made), f"{rests}rounded up to {LENGTH.step_of(made.step)}")
    calculated = f"{stated}{interval}{sigmas}"
    return [first, Fact("Calculated as stated", spoken_length(c.value), calculated)]


def _places(found: ClearanceAnswer) -> list[Fact]:
    """The clearance of each pair to make; for many pairs the smallest and the largest."""
    made = found.rounded
    tried = "" if found.shown_to_keep else " were tried, and not shown to keep the target"
    if not made or tried:
        text = (
            f"{places_in_words(made, found.clearances)}{tried}"
            if made
            else "none was found within the tolerances"
        )
        return [Fact(f"Clearances {_purpose(found)}", UNKNOWN, f"{text}; raise the budget")]
    named = list(found.clearances)
    if len(named) > MOST_NAMED:
        named = [*found.extremes()]
    cards = []
    for name in named:
        each = found.clearances[name]
        cards.append(
            Fact(
                f"Clearance of {name} {_purpose(found)}",
                str(made[name]),
                f"{sides_in_words(found.hanging, [name])}; calculated {LENGTH.text(each.value)}, "
                f"{LENGTH.span(each.lower, each.upper)}, 95 %",
            )
        )
    return cards


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
            Picture(
                lambda: plot_input(review),
                "One-sided densities: the base acceleration with its breakpoints and a band of "
                "±3 dB, and the absolute acceleration of the mass without stops.",
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
            each = " and ".join(mount_in_words(structure))
            facts.append(Fact("Mounts side by side", f"{structure.mounts}", f"{each} each"))
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
                "Stops of the scene",
                hit_in_words(sizing.gap.probability),
                f"in {spoken_mission(sizing.mission)}, each side by its own distance",
            )
        )
    rest = (
        f"{equilibrium_in_words(sizing)} under gravity and constant loads"
        if found.mean_position
        else "without gravity or a load, that is where the mass hangs"
    )
    names = [pair.name for pair in scene.impact_pairs] or ["stops"]
    drawn, where = scene, AS_STATED
    if scene.impact_pairs and sizing.stops_to_copy():
        made = scene.impact_pairs[0].replace(**found.recommended)
        drawn, where = scene.replace(impact_pairs=[made]), "at the clearance to make"
    return Section(
        title="Gap and stops",
        lead=f"{OF_CLEARANCES}; {rest}. The probability of any impact does not depend on the law "
        "of the stops; what the impacts do depends on it.",
        facts=facts,
        pictures=scene_drawn(drawn, dict.fromkeys(names, found.mean_position), where, front=True),
    )


AS_STATED = "as the scene file states them"
OF_CLEARANCES = (
    "A clearance is the distance of a stop from the static equilibrium, where the mass hangs, "
    "relative to the base. Positions in a scene file (lower, upper) count from the unloaded spring"
)
"""Where stops are drawn, and from where their places count."""


def scene_drawn(
    scene: Scene, rests: Mapping[str, float], where: str = AS_STATED, *, front: bool = False
) -> list[Picture]:
    """The drawing of a scene, whose gaps rest at these places (m from the unloaded spring)."""
    words = f"The scene with its stops {where}; not to scale."
    return [Picture(lambda: draw_problem(scene, rests), words, wide=True, front=front)]


# ------------------------------------------------------------------------------
# Sections of a clearance report on several pairs: clearance by clearance, and the box.
# ------------------------------------------------------------------------------


def pairs_cards(sizing: Sizing) -> list[Fact]:
    """The clearances to make, and the risk with them and at 3 sigma of every gap."""
    mission = spoken_mission(sizing.mission)
    three, any_hit = sizing.three_sigma.probability.value, sizing.probability
    assert any_hit is not None
    return [
        *clearance_cards(sizing),
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


def pairs_gap_section(found: ClearanceAnswer) -> Section:
    """The section on the stops of several pairs."""
    made = "at the clearances to make, as a scene file has them"
    where = made if found.each_made else AS_STATED
    return Section(
        title="Gaps and stops",
        pictures=[
            Picture(
                lambda: draw_gaps(found.as_made().impact_pairs, found.rests),
                f"Stops {where}, from the unloaded mounts.",
                front=True,
            )
        ],
    )


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
                *Grid.of(
                    "Snubber by snubber, against one oscillator",
                    rows_of(sizing.box, "pairs"),
                    "pair; clearance = made {length}; hit there = chance_at_one_axis {likely}; "
                    "3 sigma of one axis = one_axis_three_sigma {length}; "
                    "hit as the scene stands = chance_as_given {likely}",
                    made=lambda row: getattr(sizing.clearances.get(row["pair"]), "value", "fixed"),
                ),
                *Grid.of("Natural modes without stops", modes_in_rows(sizing.box.modes), words=0),
            ],
            pictures=[
                Picture(
                    lambda: plot_box(sizing),
                    "The box, its mounts and its snubbers, by their risk with the stops of the "
                    "scene.",
                )
            ],
        )
    ]
