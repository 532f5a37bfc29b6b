"""Sections of a clearance report on its inputs: environment, isolator, gap and stops."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

from stochvi.isolators.sizing.answer import spoken_mission
from stochvi.mathematics.shown_units import ACCELERATION, SPEED
from stochvi.scenes.excitations import Excitation
from stochvi.scenes.excitations.base import BASE, DensityNoise
from stochvi.scenes.scene import Scene
from stochvi.scenes.structures import Isolator, Oscillator
from stochvi.views.report.pages import Fact, Section, shown
from stochvi.views.schematic import draw_problem
from stochvi.views.sizing import plot_input, plot_response
from stochvi.views.words import (
    chance_of_stops,
    equilibrium_in_words,
    spoken_length,
)

if TYPE_CHECKING:
    from stochvi.isolators.sizing.review import Review


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
