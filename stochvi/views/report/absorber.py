"""The report of an absorber: its performance, or the best box for its mass."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from stochvi.absorbers.design import AbsorberSine, BestBox, Design
from stochvi.absorbers.performance import AbsorberReport, Performance, TunedDamper
from stochvi.mathematics.units import ACCELERATION, FORCE, LENGTH
from stochvi.results.estimates import Cost, Estimate
from stochvi.results.files import Origin, origin_of
from stochvi.scenes.scene import Scene
from stochvi.views.absorbers import (
    CANDIDATES,
    draw_absorber_sine,
    draw_design,
    draw_levels,
    draw_plays,
    ranges,
    rivals_in_words,
    tuned_sentence,
    tunings,
    verdict,
)
from stochvi.views.pages import Fact, Grid, Page, Section, sentence, shown, write_page
from stochvi.views.tables import UNKNOWN, spoken_length, with_error, with_interval


def write_absorber_report(
    found: AbsorberReport | AbsorberSine | Design, folder: str | Path, origin: Origin | None = None
) -> Path:
    """Write `report.html`, a page that needs no other file, and `absorber.json`, its numbers;
    returns the path of the page."""
    origin = origin or origin_of(found.provenance)
    if isinstance(found, Design):
        page = design_page(found, origin)
    elif isinstance(found, AbsorberSine):
        page = sine_page(found, origin)
    else:
        page = performance_page(found, origin)
    return write_page(page, found.to_dict(), "absorber", Path(folder))


def performance_page(found: AbsorberReport, origin: Origin) -> Page:
    """The page of the performance of an absorber over levels."""
    central = found.central
    low, high = central.interval()
    return Page(
        title=found.scene.title or "Impact absorber",
        subtitle=f"Effect of loose masses in boxes on {found.carrier!r} under random excitation",
        verdict=sentence(verdict(found)),
        cards=[
            Fact(
                "rms displacement",
                f"{100.0 * central.ratio.value:.1f} %",
                f"of that without absorber; {100.0 * low:.1f} to {100.0 * high:.1f} % (95 %)",
            ),
            _tuned_card(found.tuned_damper),
            Fact("Mass", f"{100.0 * found.mass_ratio:.3g} %", "absorber over structure"),
            Fact(
                "Impacts",
                f"{central.impacts_per_period.value:.2g} per period",
                "of the structure's motion, all units together",
            ),
            Fact(
                "Absorbed",
                UNKNOWN
                if central.absorbed_share is None
                else f"{100.0 * central.absorbed_share.value:.0f} %",
                "of the power that the excitation supplies",
            ),
        ],
        warnings=list(found.warnings),
        sections=[
            _scene(found.scene),
            Section(
                title="Motion of the structure",
                lead="Displacements are rms about the mean; without the absorber they are exact, "
                "with it simulated. The 95 % interval of the ratio holds the bias of the step. The "
                "peak factor is the largest displacement from the mean in 100 periods, over the "
                "rms.",
                grids=[_motion(found)],
                pictures=[
                    shown(
                        lambda: draw_levels(found),
                        "The same over the level of the excitation, 95 %.",
                    )
                ],
            ),
            _plays(found),
            _tuned(found.tuned_damper),
            Section(
                title="Impacts",
                lead="Rates count impacts faster than the threshold that the warnings name; forces "
                "and powers count all. The stop force is the mean over time of its magnitude, all "
                "stops together. The peak of a contact is the mean over contacts of the largest "
                "force in each; the largest is that of 100 periods, as a force and as the "
                "acceleration that it alone gives the structure.",
                grids=[_impacts(found), *_wall_peaks(found)],
            ),
            _verification(found),
            _limits(
                "Stationary values of a linear structure.",
                "The peak force on a rigid stop is not known: it needs the stop's stiffness.",
                "The absorber is taken to move already: from exact rest in a wide box a mass lies "
                "idle until the structure first reaches it.",
            ),
        ],
        origin=origin,
        footer=_footer(found.cost),
    )


def sine_page(found: AbsorberSine, origin: Origin) -> Page:
    """The page of an absorber under a sine."""
    curve = found.frequency
    left = curve.worst * curve.without  # nan where nothing lasts
    return Page(
        title=found.scene.title or "Impact absorber under a sine",
        subtitle=f"Residual vibration of {found.carrier!r} with loose masses in boxes",
        verdict=sentence(found.summary()),
        cards=[
            Fact("Mass", f"{100.0 * found.mass_ratio:.3g} %", "absorber over structure"),
            Fact("Without", spoken_length(float(curve.without.max())), "largest displacement"),
            Fact(
                "With",
                UNKNOWN if np.isnan(left).all() else spoken_length(float(np.nanmax(left))),
                "the largest displacement that may last",
            ),
        ],
        warnings=list(found.warnings),
        sections=[
            _scene(found.scene),
            Section(
                title="Residual vibration",
                lead="A ratio is the largest displacement with the absorber over that without. It "
                "is that of exact periodic regimes; where none is reached, that of simulated "
                "sweeps, where the absorber works in clusters. A loose mass may also lie idle.",
                grids=[
                    Grid.of("over frequency", ranges(curve)),
                    *([Grid.of("best tuning", tunings(found))] if found.tuning else []),
                ],
                pictures=[
                    shown(
                        lambda: draw_absorber_sine(found),
                        "Largest and least ratio of the motions that may last.",
                    )
                ],
            ),
            _limits("Rigid stops, no friction; the noise of the scene is left out."),
        ],
        origin=origin,
        footer=[f"calculated in {found.cost.wall_time:.3g} s"],
    )


def design_page(found: Design, origin: Origin) -> Page:
    """The page of the best box for a mass."""
    best, robust = found.best, found.robust
    units = "one unit" if found.units == 1 else f"{found.units} units"
    return Page(
        title=found.scene.title or "Design of an impact absorber",
        subtitle=f"The best box for {found.mass:.4g} kg in all",
        verdict=f"{units}, restitution {found.restitution:g}, total play "
        f"{spoken_length(best.play)}: rms displacement {100.0 * best.ratio.value:.1f} % of that "
        "without absorber.",
        cards=[
            Fact(
                "Total play, stop to stop",
                spoken_length(best.play),
                f"{best.play / found.sigma:.2f} times the rms displacement without absorber",
            ),
            Fact(
                "As good within its error",
                LENGTH.span(best.low, best.high, ".3g"),
                "the optimum is broad: the box need not be built more exactly",
            ),
            Fact("rms displacement", f"{100.0 * best.ratio.value:.1f} %", "of that without"),
            _tuned_card(found.tuned_damper),
            Fact(
                f"For levels of ± {found.level_range_db:g} dB",
                spoken_length(robust.play),
                f"at worst {100.0 * robust.ratio.value:.1f} % of that without",
            ),
        ],
        sections=[
            _scene(found.scene),
            Section(
                title="Choice of the box",
                lead="Each point is a simulation with the same random numbers; the best play is "
                "that of the curve through the points, its interval that of curves drawn within "
                "their errors. One curve holds all levels: a level raised by 20 log r decibels "
                "acts like a play r times smaller.",
                grids=[_boxes(best, robust, found.level_range_db), _candidates(found)],
                notes=list(filter(None, [rivals_in_words(found)])),
                pictures=[
                    shown(lambda: draw_design(found), "rms ratio over play; bars: two errors.")
                ],
            ),
            _tuned(found.tuned_damper),
            _limits(
                "Stationary values of a linear structure and rigid stops, without friction and "
                "gravity."
            ),
        ],
        origin=origin,
        footer=_footer(found.cost),
    )


def _scene(scene: Scene) -> Section:
    masses, scene = scene.absorber_coordinates, scene.expanded
    coordinates = scene.structure.coordinates
    mass = scene.structure.matrices[0]
    facts = [
        Fact(name, f"{mass[row, row]:.4g} kg", "absorber" if name in masses else "structure")
        for row, name in enumerate(coordinates)
    ]
    for pair in scene.impact_pairs:
        stops = ", ".join(
            f"{side} stop at {LENGTH.text(getattr(pair, side), '+.4g')}, {law.phrase()}"
            for side, law in pair.stops()
        )
        facts.append(Fact(f"Box {pair.name!r}", stops, "relative displacement in the box"))
    facts += [Fact("Effect", effect) for effect in scene.effects() if "stop" not in effect]
    return Section(title="Scene", facts=facts)


def _motion(found: AbsorberReport) -> Grid:
    accelerated = any(each.acceleration_std is not None for each in found.performances)
    headings = [
        "level", "ratio", f"rms with ({LENGTH})", f"rms without ({LENGTH})", "peak factor",
        "peak factor without",
    ]  # fmt: skip
    rows = []
    for each in found.performances:
        low, high = each.interval()
        row = [
            f"{each.level_db:+g} dB",
            f"{each.ratio.value:.3f}\n{low:.3f} to {high:.3f}",
            with_interval(each.displacement_std, LENGTH),
            f"{LENGTH(each.displacement_std_without):.4g}",
            with_interval(each.peak_factor),
            with_interval(each.peak_factor_without),
        ]
        if accelerated:
            row += [
                with_interval(each.acceleration_std, ACCELERATION),
                f"{ACCELERATION(each.acceleration_std_without or 0.0):.4g}",
            ]
        rows.append(row)
    if accelerated:
        words = ("abs. acceleration", "abs. acceleration without")
        headings += [ACCELERATION.heading(each, " rms") for each in words]
    return Grid(caption="by level of the excitation", headings=headings, rows=rows)


def _impacts(found: AbsorberReport) -> Grid:
    def row(each: Performance) -> list[str]:
        return [
            f"{each.level_db:+g} dB",
            with_interval(each.impacts_per_period),
            with_interval(each.wall_force, FORCE),
            with_interval(each.impulse),
            with_interval(each.absorbed_share),
        ]

    return Grid(
        caption="by level of the excitation",
        headings=[
            "level",
            "impacts per period",
            f"stop force ({FORCE})",
            "impulse (N s)",
            "absorbed",
        ],
        rows=[row(each) for each in found.performances],
    )


def _wall_peaks(found: AbsorberReport) -> list[Grid]:
    """Peaks of contacts with compliant stops, by level; none where all stops are rigid."""
    rows = [
        [
            f"{each.level_db:+g} dB",
            with_interval(each.wall_force_peak, FORCE),
            with_interval(each.wall_force_largest, FORCE),
            with_interval(each.wall_acceleration_largest, ACCELERATION),
        ]
        for each in found.performances
        if each.wall_force_largest is not None
    ]
    headings = [
        "level",
        f"peak of a contact ({FORCE})",
        f"largest ({FORCE})",
        f"largest ({ACCELERATION} of the structure)",
    ]
    grid = Grid(caption="peaks at the stops", headings=headings, rows=rows)
    return [grid] if rows else []


def _plays(found: AbsorberReport) -> Section:
    """The rms ratio against play."""
    title = "Play of the box"
    if not found.play_curve:
        return Section(
            title=title,
            lead="The ratio at other plays does not follow from the levels: a load, or a stop "
            "whose stiffness depends on its deflection, sets a length of its own. `stochvi sweep "
            "--vary absorber.play=...` simulates other plays.",
        )
    rows = [
        [
            UNKNOWN if each.play is None else f"{LENGTH(each.play):.4g}",
            f"{each.play_factor:.3g}",
            f"{each.ratio.value:.3f}\n{each.low:.3f} to {each.high:.3f}",
        ]
        for each in found.play_curve
    ]
    return Section(
        title=title,
        lead="The motion scales: a level raised by 6 dB acts like half the play. The levels above "
        "therefore give the ratios of boxes of other plays at the level of the scene.",
        grids=[
            Grid(
                caption="at the level of the scene",
                headings=[f"play ({LENGTH})", "over this box's", "ratio"],
                rows=rows,
            )
        ],
        pictures=[shown(lambda: draw_plays(found), "rms ratio over the play of the box, 95 %.")],
    )


def _tuned_card(found: TunedDamper | None) -> Fact:
    """The ratio that a tuned damper of the same mass leaves."""
    if found is None:
        return Fact("Tuned damper", UNKNOWN, "for several coordinates under a sine")
    return Fact("Tuned damper", f"{100.0 * found.ratio:.1f} %", "with the same mass, instead")


def _tuned(found: TunedDamper | None) -> Section:
    """The tuned damper of the same mass."""
    title = "Tuned damper of the same mass"
    if found is None:
        return Section(title=title)
    return Section(
        title=title,
        lead=f"{tuned_sentence(found)} It is linear: it works at every level, but only at the "
        "frequency that it is tuned to.",
        facts=[
            Fact("Mass", f"{found.mass:.4g} kg"),
            Fact("Spring", f"{found.stiffness:.4g} N/m", f"{found.frequency_hz:.4g} Hz"),
            Fact("Dashpot", f"{found.damping:.4g} N s/m", f"damping ratio {found.zeta:.3g}"),
            Fact("Stroke", f"{spoken_length(found.stroke_std)} rms", "relative to the structure"),
        ],
    )


def _boxes(best: BestBox, robust: BestBox, range_db: float) -> Grid:
    def row(name: str, box: BestBox) -> list[str]:
        return [
            name,
            f"{LENGTH(box.play):.4g}\n{LENGTH(box.play_low):.4g} to {LENGTH(box.play_high):.4g}",
            with_interval(box.ratio),
            f"{LENGTH(box.low):.4g} to {LENGTH(box.high):.4g}",
        ]

    return Grid(
        caption="Best boxes, with 95 % intervals",
        headings=["for", f"play ({LENGTH})", "rms ratio", f"as good ({LENGTH})"],
        rows=[row("this level", best), row(f"the worst of ± {range_db:g} dB", robust)],
    )


def _candidates(found: Design) -> Grid:
    rows = [
        [
            f"{each['restitution']:g}",
            f"{each['units']:g}",
            f"{LENGTH(each['play']):.4g}",
            with_error(Estimate(value=each["rms_ratio"], standard_error=each["rms_ratio_error"])),
        ]
        for each in found.candidates.to_dict("records")
    ]
    return Grid(
        caption=f"{CANDIDATES[0].upper()}{CANDIDATES[1:]}",
        headings=["restitution", "units", f"play ({LENGTH})", "rms ratio"],
        rows=rows,
        words=0,
    )


def _verification(found: AbsorberReport) -> Section:
    central = found.central.response
    facts = [
        Fact(f"Balance of {name}", with_error(residual), "relative to its largest term; 0 is right")
        for name, residual in central.identities.items()
    ]
    return Section(
        title="Verification",
        facts=facts,
        notes=[f"assumed: {text}" for text in central.assumptions],
    )


def _limits(*notes: str) -> Section:
    return Section(title="Limits", notes=notes)


def _footer(cost: Cost) -> list[str]:
    return [f"{cost.paths} paths, {cost.steps:.3g} steps, {cost.wall_time:.3g} s of simulation"]
