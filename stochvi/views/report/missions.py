"""Reports of missions. Chapters: a clearance for all phases, or for a ratio of damage; reliability
and replay."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from stochvi.isolators.sizing.answer import ClearanceAnswer, DamageSizing, Sizing
from stochvi.mathematics.spectra import Table
from stochvi.mathematics.units import ACCELERATION, DENSITY, spoken_mission
from stochvi.results.estimates import spoken_percent
from stochvi.results.files import Origin
from stochvi.scenes.excitations.base import DensityNoise
from stochvi.scenes.phases import Phase
from stochvi.scenes.scene import Scene
from stochvi.scenes.structures import Isolator
from stochvi.views.axes import (
    FREQUENCY,
    PAGE,
    Chart,
    Scale,
    axes_or_new,
    owner_colours,
)
from stochvi.views.isolator_tables import (
    damage_ratio_told,
    production_section,
    record_told,
    sizing_told,
)
from stochvi.views.pages import (
    Fact,
    Page,
    Picture,
    Section,
    Told,
    page_of,
)
from stochvi.views.report.sections import (
    AS_STATED,
    OF_CLEARANCES,
    clearance_cards,
    excitation_facts,
    pairs_gap_section,
    record_cards,
    scene_drawn,
)
from stochvi.views.schematic import draw_shapes, has_shape
from stochvi.views.statistics import (
    FIRST_GAPS,
    STARTS,
    reliability_told,
)
from stochvi.views.tables import (
    OF_ONE_MOUNT,
    effects_in_words,
    spoken_length,
)
from stochvi.views.verification import plot_clearances, plot_history, plot_waterfall, replay_told

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from stochvi.isolators.production_risk import Production
    from stochvi.isolators.record_verdict import RecordVerdict
    from stochvi.isolators.screening import SceneAtRest
    from stochvi.methods.replay import Replay
    from stochvi.statistics.reliability import Reliability


# ------------------------------------------------------------------------------
# The report of a clearance for all phases of a mission, or for a ratio of damage.
# ------------------------------------------------------------------------------


def phases_page(found: Sizing, origin: Origin) -> Page:
    """The page of the clearance for all phases: what to make, what decides, where the stops
    stand."""
    mission, number = spoken_mission(found.mission), len(found.phases)
    worst = found.phases.iloc[int(np.argmax(found.phases["share"]))]
    noise = ", for Gaussian noise alone" if found.doubtful else ""
    cards = [
        Fact(
            "Probability of any impact", spoken_percent(found.target.value),
            f"at the calculated clearance{noise}, in the whole mission of {mission}",
        ),
        Fact(
            "Phase that decides", str(worst["phase"]),
            f"{spoken_percent(worst['share'])} of the risk in {spoken_mission(worst['duration'])}",
        ),
    ]  # fmt: skip
    of = f"for a mission of {mission} in {number} {'phases' if number > 1 else 'phase'}"
    return _clearance_page(found, sizing_told(found), of, cards, [_environment(found)], origin)


def damage_page(found: DamageSizing, origin: Origin) -> Page:
    """The page of the clearance for a ratio of damage."""
    cards = [
        Fact("Accepted damage", f"{found.ratio:.4g} times", "that without stops"),
        Fact(
            "Q and exponent", f"{found.damage.quality:g}, {found.damage.exponent:g}", "of equipment"
        ),
    ]
    of = f"by the damage of equipment in {spoken_mission(found.mission)}"
    return _clearance_page(found, damage_ratio_told(found), of, cards, [], origin)


def _clearance_page(
    found: ClearanceAnswer, told: Told, of: str, cards: Sequence[Fact],
    sections: Sequence[Section], origin: Origin,
) -> Page:  # fmt: skip
    what = "Clearances" if found.several else "Clearance of an isolated mass"
    return page_of(
        told,
        found.scene.title or "Clearance",
        f"{what} {of}",
        [*clearance_cards(found), *cards],
        origin,
        [*sections, _stops(found)],
        found.hanging.assumptions(),
        [f"Calculated in {found.cost.wall_time:.3g} s. size.json holds all numbers."],
    )


def _environment(found: Sizing) -> Section:
    """What shakes in each phase."""
    scene = found.scene
    scenes = {phase.name: phase.of(scene) for phase in scene.phases}
    densities = {name: _by_axis(scenes[name], each) for name, each in found.densities().items()}
    beside = "; without its shocks" if any(each.has_shocks for each in scenes.values()) else ""
    return Section(
        title="Environment",
        lead="Densities are one-sided per hertz. 1 g = 9.80665 m/s².",
        facts=[
            Fact(
                f"{phase.name}, {spoken_mission(phase.duration)}",
                "; ".join(
                    _rms(table, ".4g") + along for along, table in densities[phase.name].items()
                )
                + (" without its shocks" if scenes[phase.name].has_shocks else "")
                or "-",
                "; ".join([*_sources(scenes[phase.name]), *_mounts(phase)]),
            )
            for phase in scene.phases
        ],
        pictures=[
            Picture(
                lambda: plot_densities(densities),
                f"One-sided density of the acceleration of the base in each phase{beside}.",
            )
        ],
    )


def _by_axis(scene: Scene, tables: Sequence[Table]) -> dict[str, Table]:
    """The densities of a phase, by the axis along which each moves the base, in words."""
    noises = [each for each in scene.excitations if isinstance(each, DensityNoise)]
    axes = [f" along {each.axis}" if each.axis else "" for each in noises]
    if len({*axes}) < len(axes) or len(axes) != len(tables):
        axes = [f" ({number})" for number in range(1, len(tables) + 1)]
    return dict(zip(axes if len(tables) > 1 else [""], tables, strict=False))


def _rms(table: Table, form: str) -> str:
    return f"{ACCELERATION.text(math.sqrt(table.mean_square()), form)} rms"


def _sources(scene: Scene) -> list[str]:
    """The excitations in words."""
    facts = [excitation_facts(scene, each, each.numbers())[0] for each in scene.excitations]
    return [f"{fact.name}: {fact.value}" for fact in facts]


def _mounts(phase: Phase) -> list[str]:
    """What is changed at the mounts in a phase, in words."""
    factors = {"stiffness": phase.stiffness_factor, "damping": phase.damping_factor}
    return [f"{name} of the mount times {each:g}" for name, each in factors.items() if each != 1.0]


def plot_densities(densities: Mapping[str, Mapping[str, Table]], ax: Axes | None = None) -> Axes:
    """Acceleration density against frequency, a colour for each phase and axis."""
    chart = Chart.on(ax, FREQUENCY, Scale("one-sided density", DENSITY, log=True))
    curves = [
        (f"{name}{along}, {_rms(table, '.3g')}", table, STYLES[number % len(STYLES)])
        for number, (name, tables) in enumerate(densities.items())
        for along, table in tables.items()
    ]
    for (words, table, style), colour in zip(curves, owner_colours(len(curves)), strict=True):
        chart.curve(table.frequency_hz, table.density, words, colour, style)
    return chart.finish()


STYLES = ("-", "--", ":")
"""Styles of curves that follow each other: phases may have the same density."""


def _stops(found: ClearanceAnswer) -> Section:
    """Where the stops stand, with the drawing of the scene: at the clearance to make, or as the
    scene has them where there is none."""
    if found.several:
        return pairs_gap_section(found)
    made = found.as_made()
    where = "at the clearance to make" if found.each_made else AS_STATED
    return Section(
        title="Gap and stops",
        lead=f"{OF_CLEARANCES}.",
        facts=[
            *_frequencies(found.resting),
            *(
                Fact(
                    f"{side.capitalize()} stop",
                    spoken_length(getattr(pair, side)),
                    f"{'' if found.each_made else 'of the scene; '}from the unloaded spring; "
                    f"{law.phrase()}",
                )
                for pair in made.impact_pairs
                for side, law in pair.stops()
            ),
        ],
        pictures=scene_drawn(made, found.rests, where, front=True),
    )  # fmt: skip


# ------------------------------------------------------------------------------
# Pages of a reliability, with the probabilities of a mission, and of a replay, with the motion
# under a record.
# ------------------------------------------------------------------------------


# Reliability ------------------------------------------------------------------------------


def reliability_page(
    found: Reliability, scene: Scene, hung: SceneAtRest, record: RecordVerdict | None,
    origin: Origin, production: Production | None = None,
) -> Page:  # fmt: skip
    """The page of the probabilities of a mission."""
    told, mission = reliability_told(found), spoken_mission(found.mission)
    noise, own = "", []
    if record is not None and not record.agrees:
        noise, own = "; for Gaussian noise alone", record_cards(record)
        alarm = record_told(record)
        lines = [*alarm.statements, record.sentence(), told.verdict, *told.statements]
        told = replace(told, verdict=alarm.verdict, statements=lines, alarm=True)
    cards = [
        Fact(f"Probability of {c.words}", c.likely, f"{c.interval}{noise}")
        for c in found.chances.values()
    ]
    first = [*found.gaps][:FIRST_GAPS]
    if len(found.gaps) > len(first):
        shown = sorted(scene.impact_pairs, key=lambda pair: [*found.gaps].index(pair.name))
        scene = scene.model_copy(update={"impact_pairs": tuple(shown[: len(first)])})
    return page_of(
        told,
        scene.title or "Reliability of a mission",
        f"Probabilities in a mission of {mission}, from {STARTS[found.start]}",
        [*own, *cards, Fact("Expected impacts", found.hits_in_words(), f"in {mission}")],
        origin,
        [production_section(production), _scene_section(scene, hung)],
        OF_ONE_MOUNT if isinstance(scene.structure, Isolator) else (),
    )


def _frequencies(hung: SceneAtRest) -> list[Fact]:
    """The natural frequencies, and the damping ratio of one mass."""
    if not hung.natural_frequency_hz:
        return []
    name = "Natural frequency" if len(hung.natural_frequency_hz) == 1 else "Natural frequencies"
    values = ", ".join(f"{each:.4g}" for each in hung.natural_frequency_hz)
    damping = "" if hung.damping_ratio is None else f"damping ratio {hung.damping_ratio:.4g}"
    return [Fact(name, f"{values} Hz", damping)]


def _scene_section(scene: Scene, hung: SceneAtRest) -> Section:
    """What shakes what, and where it hits, with the drawing of the scene."""
    facts = _frequencies(hung)
    for pair in scene.impact_pairs:
        for side, law in pair.stops():
            place = getattr(pair, side)
            distance = abs(place - hung.gaps.get(pair.name, 0.0))
            facts.append(
                Fact(
                    f"Clearance of {pair.name!r}, {side}",
                    spoken_length(distance),
                    f"from the static equilibrium; {side} = {place:.6g} (m) from the unloaded "
                    f"spring; {law.phrase()}",
                )
            )
    parts: dict[str, list[str]] = {}
    for phase in scene.phases:
        parts.setdefault(phase.step_of or phase.name, []).append(phase.name)
    drawn = scene.in_phase(scene.phases[0].name) if parts else scene
    for name, steps in (parts or {"": [""]}).items():
        part = scene.in_phase(steps[0]) if name else scene
        if name:
            told = f"the first of {len(steps)} steps" if len(steps) > 1 else ""
            facts.append(Fact("Phase", name, told))
        for excitation in part.excitations:
            facts += excitation_facts(part, excitation, excitation.numbers())
        facts.append(Fact("Simulated", effects_in_words(part.effects())))
    return Section(title="Scene", facts=facts, pictures=scene_drawn(drawn, hung.gaps))


# Replay -----------------------------------------------------------------------------------


def replay_page(
    found: Replay, scene: Scene, hung: SceneAtRest, record: RecordVerdict | None, origin: Origin
) -> Page:
    """The page of the motion of a structure between its stops under a record."""
    told = replay_told(found, record)
    (motion,) = told.sections
    told = replace(told, sections=[replace(motion, pictures=_replay_pictures(found, scene))])
    if record is not None:
        told = replace(told, statements=[*told.statements, record.sentence()])
    other = (
        "Another record of the same kind does something else: the peaks of one record are no "
        "probability"
    )
    return page_of(
        told,
        scene.title or "Replay of a record",
        f"The record itself through the structure and its stops, {found.duration:.4g} s",
        [*record_cards(record), *_replay_cards(found)],
        origin,
        [_scene_section(scene, hung)],
        [other],
    )


def _replay_cards(found: Replay) -> list[Fact]:
    if found.only is None:
        return []
    cards = [
        Fact(
            f"Motion of {name}",
            each.reach(name),
            "from the unloaded spring",
        )
        for name, each in found.coordinates.items()
        if name not in found.only.still
    ]
    within, unhit = f"in {found.duration:.4g} s", found.only.unhit
    cards += [
        Fact(f"Impacts on {name}", f"{float(each.hits):.0f}", within)
        for name, each in found.impact_pairs.items()
        if len(unhit) < 2 or name not in unhit
    ]
    if len(unhit) > 1:
        cards.append(Fact(f"Impacts on {len(unhit)} pairs", "0", f"{within}: {', '.join(unhit)}"))
    return cards


def _replay_pictures(found: Replay, scene: Scene) -> list[Picture]:
    single = found.only
    if single is None:
        return [
            Picture(
                lambda: plot_clearances(found, axes_or_new(None, PAGE)),
                "Impacts and the largest speed against clearance.",
            )
        ]
    if found.histories is None:
        return []
    shape = (
        Picture(
            lambda: draw_shapes(single, scene, "under the record"),
            "The structure with its stops: its shape at impacts, and its rms where it is a line.",
        )
        if has_shape(single, scene)
        else None
    )
    return [
        *([] if shape is None else [shape]),
        Picture(
            lambda: plot_history(single, axes_or_new(None, PAGE)),
            "The motion with its stops and impacts.",
        ),
        Picture(
            lambda: plot_waterfall(single, axes_or_new(None, PAGE)),
            "Waterfall: short-time spectra of the absolute acceleration, impacts marked above.",
        ),
    ]
