"""Pages of a reliability, with the probabilities of a mission, and of a replay, with the motion
under a record."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from stochvi.isolators.sizing.answer import NEAR_ONE, spoken_mission, spoken_percent
from stochvi.mathematics.shown_units import ACCELERATION, SPEED, readable
from stochvi.results.base import plain
from stochvi.results.hardness import unit_of_limit
from stochvi.results.origin import Origin, origin_of
from stochvi.results.quantity_units import of_angle
from stochvi.scenes.structures import Isolator
from stochvi.views.axes import PAGE, axes_or_new, label_for_page
from stochvi.views.colours import COLOURS
from stochvi.views.replay import ROWS, headline, plot_clearances, plot_history, plot_waterfall
from stochvi.views.report.changes import production_section
from stochvi.views.report.environment import excitation_facts
from stochvi.views.report.pages import Fact, Grid, Page, Picture, Section, shown, write_page
from stochvi.views.report.records import record_cards
from stochvi.views.schematic import draw_problem
from stochvi.views.shapes import draw_shapes, has_shape
from stochvi.views.statistics_tables import SURELY
from stochvi.views.tables import effects_in_words
from stochvi.views.words import (
    OF_ONE_MOUNT,
    UNKNOWN,
    count_of,
    spoken_length,
    way_in_words,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from stochvi.isolators.production_risk.answer import Production
    from stochvi.isolators.record_verdict import RecordVerdict
    from stochvi.isolators.scene_at_rest import SceneAtRest
    from stochvi.methods.replay import Replay
    from stochvi.results.estimates import Estimate
    from stochvi.scenes.scene import Scene
    from stochvi.statistics.reliability import Chance, Reliability

EVENTS = {
    "hit": "any impact",
    "passage": "any passage of the barrier",
    "impact_speed": "an impact faster than",
    "peak_acceleration": "a peak acceleration above",
}
"""Events of a mission in words."""

SMALLEST_DRAWN = 1e-9
"""Share of the largest probability below which the probability of a phase is left out of the
picture."""

# Reliability ------------------------------------------------------------------------------


def write_reliability_report(
    found: Reliability,
    scene: Scene,
    hung: SceneAtRest,
    record: RecordVerdict | None,
    folder: str | Path,
    origin: Origin | None = None,
    production: Production | None = None,
) -> Path:
    """Write `report.html` and `reliability.json`, its numbers; returns the path of the page. The
    risk of a production whose units differ may stand beside."""
    origin = origin or origin_of(found.provenance)
    page = reliability_page(found, scene, hung, record, origin, production)
    beside = {"record": record, "production": production}
    document = found.to_dict() | {k: plain(each) for k, each in beside.items() if each is not None}
    return write_page(page, document, "reliability", Path(folder))


def reliability_page(
    found: Reliability, scene: Scene, hung: SceneAtRest, record: RecordVerdict | None,
    origin: Origin, production: Production | None = None,
) -> Page:  # fmt: skip
    """The page of the probabilities of a mission."""
    mission = spoken_mission(found.mission)
    chances = list(found.chances.values())
    sentences = [f"{_event(each)}: {_chance(each)}" for each in chances]
    missing = []
    for name, why in found.missing.items():
        what = "not accurate" if name in found.chances else "not found"
        missing.append(f"{name.replace('_', ' ')}: {what}, {why}")
    doubtful = record is not None and not record.agrees
    first = f"{record.sentence()}. " if record is not None and doubtful else ""
    noise = "; for Gaussian noise alone" if doubtful else ""
    return Page(
        title=scene.title or "Reliability of a mission",
        subtitle=f"Probabilities in a mission of {mission}, {_start(found)}",
        verdict=f"{first}Probability in {mission} of " + "; of ".join([*sentences, *missing]) + ".",
        alarm=doubtful or bool(found.missing),
        statements=[]
        if found.hits is None
        else [f"Expected impacts in {mission}: {_hits(found)}."],
        cards=[
            *(record_cards(record) if doubtful else []),
            *(
                Fact(f"Probability of {_event(each)}", _value(each), f"{_interval(each)}{noise}")
                for each in chances
            ),
            Fact(
                "Expected impacts", UNKNOWN if found.hits is None else _hits(found), f"in {mission}"
            ),
        ],
        warnings=list(found.warnings),
        sections=[
            Section(
                title="Probabilities",
                lead=f"Intervals at {100.0 * found.confidence:g} % hold the statistical errors "
                "alone; a probability that was never seen has an upper limit.",
                grids=[
                    _chances_grid(found),
                    *([_phases_grid(found)] if found.phases else []),
                    *([_pairs_grid(found)] if found.pairs else []),
                    *([_outputs_grid(found)] if found.outputs else []),
                ],
                pictures=[
                    shown(
                        lambda: plot_chances(found), f"Probabilities in {mission}, with intervals."
                    )
                ]
                if chances
                else [],
                notes=[f"{_event(each)}: {each.why}" for each in chances],
            ),
            production_section(production),
            _scene_section(scene, hung),
            Section(
                title="Limits",
                lead="Assumptions of this report.",
                notes=[
                    *(f"{text[0].upper()}{text[1:]}." for text in found.assumptions),
                    *(OF_ONE_MOUNT if isinstance(scene.structure, Isolator) else ()),
                ],
            ),
        ],
        origin=origin,
        footer=[f"calculated in {found.cost.wall_time:.3g} s on {found.cost.threads} threads"],
    )


def _start(found: Reliability) -> str:
    return "from rest" if found.start == "rest" else "from the stationary motion"


def _event(chance: Chance) -> str:
    words = EVENTS[chance.event]
    if chance.limit is None:
        return words
    return f"{words} {readable(unit_of_limit(chance.event)).text(chance.limit)}"


def _value(chance: Chance) -> str:
    if chance.estimate.value > NEAR_ONE and chance.lower < SURELY:
        return "hardly known"
    if chance.estimate.value > 0.0:
        return spoken_percent(chance.estimate.value)
    return _below(chance.upper)


def _below(upper: float) -> str:
    """An upper limit of a probability in words; unknown where that limit is nearly 1."""
    return UNKNOWN if upper > NEAR_ONE else f"below {spoken_percent(upper)}"


def _interval(chance: Chance) -> str:
    low = spoken_percent(chance.lower) if chance.lower > 0.0 else "0"
    return f"{low} to {spoken_percent(chance.upper)}, {100.0 * chance.confidence:g} %"


def _chance(chance: Chance) -> str:
    return f"{_value(chance)} ({_interval(chance)})"


def _hits(found: Reliability) -> str:
    assert found.hits is not None
    if found.hits_interval is None:
        return count_of(found.hits.value)
    low, high = found.hits_interval
    return f"{count_of(found.hits.value)} ({count_of(low)} to {count_of(high)})"


def _chances_grid(found: Reliability) -> Grid:
    return Grid(
        caption="How each probability was found",
        headings=[
            "event", "way", "probability", "interval", "bias of the step",
            "missions, records or repetitions", "CPU s",
        ],
        rows=[
            [
                _event(each),
                way_in_words(each.way),
                _value(each),
                _interval(each),
                UNKNOWN if each.estimate.bias is None else spoken_percent(each.estimate.bias),
                count_of(float(each.trials)),
                f"{each.seconds:.2g}",
            ]
            for each in found.chances.values()
        ],
        words=2,
    )  # fmt: skip


def _phases_grid(found: Reliability) -> Grid:
    """The phases of a mission, each with its probabilities and expected impacts."""
    return Grid(
        caption="Phase by phase",
        headings=["phase", "duration", *(_event(each) for each in found.chances.values()),
                  "expected impacts"],
        rows=[
            [
                name,
                spoken_mission(phase.mission),
                *(_value(phase.chances[event]) for event in found.chances),
                UNKNOWN if phase.hits is None else count_of(phase.hits.value),
            ]
            for name, phase in found.phases.items()
        ],
        words=1,
    )  # fmt: skip


def _pairs_grid(found: Reliability) -> Grid:
    return Grid(
        caption="Pair by pair: the probability of an impact if this pair alone had stops, and "
        "its share of the first impacts of a mission; its expected impacts there and their mean "
        "speed, with all stops where they are",
        headings=[
            "pair",
            "probability alone",
            "of first impacts",
            "expected impacts",
            f"mean speed ({SPEED})",
        ],
        rows=[
            [
                name,
                spoken_percent(risk.probability.value),
                spoken_percent(risk.share_of_first_hits),
                _known(risk.expected_hits),
                _known(SPEED(risk.impact_speed_mean)),
            ]
            for name, risk in found.pairs.items()
        ],
        words=1,
    )


def _known(estimate: Estimate | None) -> str:
    """A number with its 95 % half width."""
    if estimate is None:
        return UNKNOWN
    if estimate.upper_95 is not None:
        return f"below {estimate.upper_95:.3g}"
    return f"{estimate.value:.3g} ± {estimate.half_width_95():.2g}"


def _outputs_grid(found: Reliability) -> Grid:
    limit = found.chances["peak_acceleration"].limit or 0.0
    return Grid(
        caption=f"Where an acceleration above {ACCELERATION.text(limit)} occurs while a stop is "
        "touched",
        headings=["coordinate or point", "probability"],
        rows=[
            [
                name,
                spoken_percent(chance.value)
                if chance.upper_95 is None
                else _below(chance.upper_95),
            ]
            for name, chance in found.outputs.items()
        ],
        words=1,
    )


def plot_chances(found: Reliability, ax: Axes | None = None) -> Axes:
    """Each probability with its interval on a logarithmic axis; an upper limit as an arrow. Those
    of phases stand below those of the whole mission."""
    ax = axes_or_new(ax, PAGE)
    drawn = [(_event(chance), chance) for chance in found.chances.values()]
    least = SMALLEST_DRAWN * max((chance.upper for _, chance in drawn), default=0.0)
    for name, phase in found.phases.items():
        drawn += [
            (f"{name}, {_event(chance)}", chance)
            for chance in phase.chances.values()
            if chance.upper > least
        ]
    for place, (words, chance) in enumerate(reversed(drawn)):
        value, low, high = chance.estimate.value, chance.lower, chance.upper
        if value > 0.0:
            bars = [[value - low], [max(high - value, 0.0)]]
            ax.errorbar([value], [place], xerr=bars, fmt="o", capsize=4, color=COLOURS["simulate"])
        else:
            ax.plot([high], [place], marker="<", markersize=9, color=COLOURS["simulate"])
        # at the left edge, as a long text about its point would leave the picture
        ax.annotate(
            f"{words}: {_value(chance)}", (0.01, place), xytext=(0, 9), fontsize="small",
            xycoords=ax.get_yaxis_transform(), textcoords="offset points",
        )  # fmt: skip
    ax.set_xscale("log")
    ax.margins(x=0.2)
    ax.set_ylim(-0.6, len(drawn) - 0.2)
    ax.set_yticks([])
    label_for_page(ax, f"probability in {spoken_mission(found.mission)}", "", legend=False)
    return ax


def _scene_section(scene: Scene, hung: SceneAtRest) -> Section:
    """What shakes what, and where it hits, with the drawing of the scene."""
    frequencies = [f"{each:.4g}" for each in hung.natural_frequency_hz]
    facts = []
    if frequencies:
        name = "Natural frequency" if len(frequencies) == 1 else "Natural frequencies"
        damping = "" if hung.damping_ratio is None else f"damping ratio {hung.damping_ratio:.4g}"
        facts.append(Fact(name, f"{', '.join(frequencies)} Hz", damping))
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
    return Section(
        title="Scene",
        facts=facts,
        pictures=[
            shown(
                lambda: draw_problem(drawn, hung.gaps),
                "The scene with its stops as the scene file states them; not to scale.",
                wide=True,
            )
        ],
    )


# Replay -----------------------------------------------------------------------------------


def write_replay_report(
    found: Replay,
    scene: Scene,
    hung: SceneAtRest,
    record: RecordVerdict | None,
    folder: str | Path,
    origin: Origin | None = None,
) -> Path:
    """Write `report.html` and `replay.json`, its numbers; returns the path of the page."""
    page = replay_page(found, scene, hung, record, origin or origin_of(found.provenance))
    document = found.to_dict() | ({} if record is None else {"record": plain(record)})
    return write_page(page, document, "replay", Path(folder))


def replay_page(
    found: Replay, scene: Scene, hung: SceneAtRest, record: RecordVerdict | None, origin: Origin
) -> Page:
    """The page of the motion of a structure between its stops under a record."""
    summary = headline(found, record)
    return Page(
        title=scene.title or "Replay of a record",
        subtitle=f"The record itself through the structure and its stops, {found.duration:.4g} s",
        verdict=f"{summary[0].upper()}{summary[1:]}.",
        statements=[] if record is None else [f"{record.sentence()}."],
        alarm=any(
            float(pair.hits) > 0.0
            for each in found.clearances
            for pair in each.impact_pairs.values()
        ),
        cards=[*record_cards(record), *_replay_cards(found)],
        warnings=list(found.warnings),
        sections=[
            Section(
                title="Motion and impacts",
                lead="One record, one answer: nothing is sampled, every impact is located in time.",
                grids=[_replay_grid(found)],
                pictures=_replay_pictures(found, scene),
            ),
            _scene_section(scene, hung),
            Section(
                title="Limits",
                lead="Assumptions of this report.",
                notes=[
                    *(f"{text[0].upper()}{text[1:].rstrip('.')}." for text in found.assumptions),
                    "Another record of the same kind does something else: the peaks of one record "
                    "are no probability.",
                ],
            ),
        ],
        origin=origin,
        footer=[f"calculated in {found.cost.wall_time:.3g} s"],
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
    ]
    cards += [
        Fact(f"Impacts on {name}", f"{float(each.hits):.0f}", f"in {found.duration:.4g} s")
        for name, each in found.impact_pairs.items()
    ]
    return cards


def _replay_grid(found: Replay) -> Grid:
    """A row per quantity, a column per clearance."""
    rows = []
    first = found.clearances[0]
    for group in ("coordinates", "impact_pairs"):
        for owner, quantities in getattr(first, group).items():
            for name, _ in quantities.items():
                if name not in ROWS:
                    continue
                words, quantity = ROWS[name][0], of_angle(owner, ROWS[name][1])
                values = [getattr(each, group)[owner][name] for each in found.clearances]
                if all(value is None for value in values):
                    continue  # the speed of no impact, the force of a rigid stop
                texts = ["none" if v is None else f"{quantity(float(v)):.4g}" for v in values]
                rows.append([f"{owner}: {quantity.heading(words)}", *texts])
    headings = [
        "as in the scene" if each.clearance is None else f"at {spoken_length(each.clearance)}"
        for each in found.clearances
    ]
    return Grid(caption="The record itself", headings=["", *headings], rows=rows)


def _replay_pictures(found: Replay, scene: Scene) -> list[Picture]:
    single = found.only
    if single is None:
        return [
            shown(
                lambda: plot_clearances(found, axes_or_new(None, PAGE)),
                "Impacts and the largest speed against clearance.",
            )
        ]
    if found.histories is None:
        return []
    shape = (
        shown(
            lambda: draw_shapes(single, scene, "under the record"),
            "The structure with its stops: its shape at impacts, and its rms where it is a line.",
        )
        if has_shape(single, scene)
        else None
    )
    return [
        *([] if shape is None else [shape]),
        shown(
            lambda: plot_history(single, axes_or_new(None, PAGE)),
            "The motion with its stops and impacts.",
        ),
        shown(
            lambda: plot_waterfall(single, axes_or_new(None, PAGE)),
            "Waterfall: short-time spectra of the absolute acceleration, impacts marked above.",
        ),
    ]
