"""Descriptions of absorbers. Chapters: performance over levels; the best box for a mass; absorbers
under a sine; pages; pictures."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from stochvi.absorbers.design import AbsorberSine, Design, tuned_key
from stochvi.mathematics.units import LENGTH
from stochvi.results.estimates import plus_minus
from stochvi.results.files import Origin
from stochvi.views.axes import BAND_ALPHA, COLOURS, FREQUENCY, Chart, Scale, length_of, panels
from stochvi.views.pages import (
    Fact,
    Grid,
    Page,
    Picture,
    Section,
    Told,
    page_of,
    told_of,
)  # fmt: skip
from stochvi.views.tables import UNKNOWN, spoken_length

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from stochvi.absorbers.design import ResidualCurve
    from stochvi.absorbers.performance import AbsorberReport, TunedDamper
    from stochvi.results.estimates import Cost
    from stochvi.scenes.scene import Scene


SIZE = (7.0, 4.2)
"""Size of a figure, inches."""

RATIO = Scale("rms displacement with / without absorber")


# ------------------------------------------------------------------------------
# Performance over levels.
# ------------------------------------------------------------------------------


def absorber_told(found: AbsorberReport) -> Told:
    """The effect of an absorber by level and by play, and that of a tuned damper."""
    sections = [_motion(found), _plays(found), *_tuned(found.tuned_damper), _impacts(found)]
    return told_of(found, (), (), *sections, footer=_footer(found.cost))


def tuned_sentence(found: TunedDamper) -> str:
    """The effect of the same mass as a tuned damper, with its tuning, in a sentence."""
    return (
        f"The same mass on a tuned spring and dashpot ({found.tuning}: {found.frequency_hz:.4g} "
        f"Hz, damping ratio {found.zeta:.3g}) would leave {found.ratio:.3f} of the rms "
        f"displacement, at every level; it would move {spoken_length(found.stroke_std)} rms "
        "relative to the structure."
    )


OF_MOTION = (
    "ratio; displacement_std; displacement_std_without; peak_factor; peak_factor_without; "
    "acceleration_std; acceleration_std_without"
)
OF_IMPACTS = (
    "impacts_per_period; wall_force; impulse; absorbed_share; wall_force_peak; "
    "wall_force_largest; wall_acceleration_largest"
)
"""Fields of a level that the tables of motion and of impacts show."""


def _motion(found: AbsorberReport) -> Section:
    """The motion of the structure by level, with and without the absorber."""
    return Section(
        title="Motion of the structure",
        grids=_by_level(found, f"motion of {found.carrier!r}", OF_MOTION),
        notes=[
            "Ratio: rms displacement about the mean with the absorber, simulated, over that "
            "without, which is exact; its 95 % interval holds the bias of the step.",
            "Peak factor: largest displacement from the mean in 100 periods, over the rms. "
            "± is half of a 95 % interval.",
        ],
        pictures=[Picture(lambda: plot_absorber(found), "The same over the level, 95 %.")],
    )


def _by_level(found: AbsorberReport, caption: str, names: str) -> list[Grid]:
    """A table with a row for each level."""
    caption = f"{caption}, by level of the excitation"
    return Grid.of(caption, found.performances, f"level_db; {names}", 0)


def _impacts(found: AbsorberReport) -> Section:
    """Impacts, forces and powers by level; the peaks of contacts where stops are compliant."""
    return Section(
        title="Impacts",
        grids=_by_level(found, "impacts", OF_IMPACTS),
        notes=[
            "Impacts on all units together, faster than the threshold that the warnings name; "
            "forces and powers count all. Stop force: mean over time of its magnitude, all stops. "
            "Absorbed: share of the supplied power that impacts take.",
            "Peak force: mean over contacts of the largest force in each. Largest: of 100 periods, "
            "as a force and as the acceleration that it alone gives the structure. Rigid stops "
            "have neither: it needs the stop's stiffness.",
        ],
    )


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
    return Section(
        title=title,
        lead="The motion scales: a level raised by 6 dB acts like half the play. The levels above "
        "therefore give the ratios of boxes of other plays at the level of the scene.",
        grids=Grid.of(
            "boxes of other plays, at the level of the scene",
            found.play_curve,
            "play {m}; over this box's = play_factor {.3g}; ratio",
            0,
        ),
        pictures=[Picture(lambda: draw_plays(found), "rms ratio over the play of the box, 95 %.")],
    )


def _tuned(found: TunedDamper | None) -> list[Section]:
    """The tuned damper of the same mass, where it is known."""
    if found is None:
        return []
    return [
        Section(
            title="Tuned damper of the same mass",
            facts=[
                Fact("Mass", f"{found.mass:.4g} kg"),
                Fact("Spring", f"{found.stiffness:.4g} N/m", f"{found.frequency_hz:.4g} Hz"),
                Fact("Dashpot", f"{found.damping:.4g} N s/m", f"damping ratio {found.zeta:.3g}"),
                Fact(
                    "Stroke", f"{spoken_length(found.stroke_std)} rms", "relative to the structure"
                ),
            ],
            notes=[
                f"{tuned_sentence(found)} It is linear: it works at every level, but only at the "
                "frequency that it is tuned to."
            ],
        )
    ]


# ------------------------------------------------------------------------------
# The best box for a mass.
# ------------------------------------------------------------------------------


def design_told(found: Design) -> Told:
    """The best box, the best box for a range of levels, and the candidates."""
    return told_of(
        found,
        sections=[
            Section(
                title="Choice of the box",
                lead="Each point is a simulation with the same random numbers; the best play is "
                "that of the curve through the points, its interval that of curves drawn within "
                "their errors. One curve holds all levels: a level raised by 20 log r decibels "
                "acts like a play r times smaller.",
                grids=[*_boxes(found), *_candidates(found)],
                notes=[
                    *rivals_in_words(found),
                    f"Sigma = {spoken_length(found.sigma)}, the rms displacement without absorber; "
                    "play is total, from stop to stop.",
                ],
                pictures=[
                    Picture(lambda: plot_design(found), "rms ratio over play; bars: two errors.")
                ],
            ),
            *_tuned(found.tuned_damper),
        ],
        footer=_footer(found.cost),
    )


def _count(number: int, words: str) -> str:
    return f"one {words}" if number == 1 else f"{number} {words}s"


def _boxes(found: Design) -> list[Grid]:
    return Grid.of(
        "best boxes",
        [("this level", found.best), (f"the worst of ± {found.level_range_db:g} dB", found.robust)],
        "for = name; play {m}; 95 % interval = interval; as good within its error = as_good; "
        "rms ratio = ratio",
        interval=lambda _, box: _span(box.play_low, box.play_high),
        as_good=lambda _, box: _span(box.low, box.high),
    )


def _span(low: float, high: float) -> str:
    return f"{LENGTH(low):.4g} to {LENGTH(high):.4g}"


def _candidates(found: Design) -> list[Grid]:
    return Grid.of(
        "candidates: the best one after a second, closer search, the others after the first one",
        found.candidates,
        "restitution; units; play; play/sigma = play_in_sigma; rms ratio = rms_ratio",
        0,
    )


def rivals_in_words(found: Design) -> list[str]:
    """The candidates about as good as the best one, in a sentence; none without any."""
    best = found.best.ratio
    near = [
        f"restitution {each['restitution']:g} with {_count(int(each['units']), 'unit')}"
        for each in found.candidates.iloc[1:].to_dict("records")
        if each["rms_ratio"] - best.value
        < SIGNIFICANT * math.hypot(each["rms_ratio_error"], best.standard_error)
    ]
    return [f"As good within their errors: {', '.join(near)}."] if near else []


SIGNIFICANT = 2.0
"""Number of standard errors of a difference above which two candidates differ clearly."""


# ------------------------------------------------------------------------------
# An absorber under a sine.
# ------------------------------------------------------------------------------


def absorber_sine_told(found: AbsorberSine) -> Told:
    """The vibration that is left over frequency, and the best tuning."""
    return told_of(
        found,
        sections=[
            Section(
                title="Residual vibration",
                grids=[*_ranges(found), *_tunings(found)],
                notes=[
                    "Ratio: largest displacement with the absorber over that without; the least "
                    "and the largest of the motions that may last.",
                    "Regime: one with impacts is stable. Idle: loose masses may rest in their "
                    "boxes, and do nothing. Clusters: no regime is reached, impacts come and go; "
                    "their ratio is that of simulated sweeps, the others are exact.",
                ],
                pictures=[
                    Picture(
                        lambda: plot_absorber_sine(found),
                        "Largest and least ratio of the motions that may last.",
                    )
                ],
            ),
        ],
        footer=[f"calculated in {found.cost.wall_time:.3g} s"],
    )


def _ranges(found: AbsorberSine) -> list[Grid]:
    """Ranges of frequency over which the same motions may last, with the ratios in each."""
    curve = found.frequency
    kinds = [_lasting(curve, number) for number in range(len(curve.value))]
    starts = [0, *(n for n in range(1, len(kinds)) if kinds[n] != kinds[n - 1]), len(kinds)]
    ranges = [
        {
            "what may last": kinds[a], "from (Hz)": curve.value[a], "to (Hz)": curve.value[b - 1],
            "without": np.max(curve.without[a:b]), "least ratio": np.min(curve.best[a:b]),
            "largest ratio": np.max(curve.worst[a:b]),
        }
        for a, b in pairwise(starts)
    ]  # fmt: skip
    return Grid.of(f"motion of {found.carrier!r} over frequency", ranges)


def _tunings(found: AbsorberSine) -> list[Grid]:
    """A row for each number that is tuned: its best value and the ratio there."""
    tuned = [
        {
            "what": _over(curve).label, "what may last": _lasting(curve, at),
            "best": _over(curve).quantity(curve.value)[at],
            "ratio": curve.worst[at], "first harmonics": curve.first_harmonic[at],
        }
        for curve in found.tuning
        for at in [curve.tuned]
    ]  # fmt: skip
    return Grid.of("best tuning at the frequency of the scene", tuned, words=2)


def _lasting(curve: ResidualCurve, number: int) -> str:
    seen = {
        "regime": curve.stable[number],
        "clusters": not curve.periodic[number],
        "idle": curve.idle[number],
    }
    return ", ".join(name for name, there in seen.items() if there) or "no impacts"


def _over(curve: ResidualCurve) -> Scale:
    """The varied number in words, with its unit where that is known."""
    if curve.key == "frequency_hz":
        return FREQUENCY._replace(log=False)
    return Scale(*tuned_key(curve.key))


# ------------------------------------------------------------------------------
# Pages.
# ------------------------------------------------------------------------------


def performance_page(found: AbsorberReport, origin: Origin) -> Page:
    """The page of the performance of an absorber over levels."""
    central = found.central
    low, high = central.interval()
    absorbed = central.absorbed_share
    return page_of(
        absorber_told(found),
        found.scene.title or "Impact absorber",
        f"Effect of loose masses in boxes on {found.carrier!r} under random excitation",
        [
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
                UNKNOWN if absorbed is None else f"{100.0 * absorbed.value:.0f} %",
                "of the power that the excitation supplies",
            ),
        ],
        origin,
        [_scene(found.scene), _verification(found)],
        [
            *central.response.assumptions,
            "Stationary values of a linear structure.",
            "The absorber is taken to move already: from exact rest in a wide box a mass lies "
            "idle until the structure first reaches it.",
        ],
    )


def sine_page(found: AbsorberSine, origin: Origin) -> Page:
    """The page of an absorber under a sine."""
    curve = found.frequency
    left = curve.worst * curve.without  # nan where nothing lasts
    return page_of(
        absorber_sine_told(found),
        found.scene.title or "Impact absorber under a sine",
        f"Residual vibration of {found.carrier!r} with loose masses in boxes",
        [
            Fact("Mass", f"{100.0 * found.mass_ratio:.3g} %", "absorber over structure"),
            Fact("Without", spoken_length(float(curve.without.max())), "largest displacement"),
            Fact(
                "With",
                UNKNOWN if np.isnan(left).all() else spoken_length(float(np.nanmax(left))),
                "the largest displacement that may last",
            ),
        ],
        origin,
        [_scene(found.scene)],
        ["Rigid stops, no friction; the noise of the scene is left out."],
    )


def design_page(found: Design, origin: Origin) -> Page:
    """The page of the best box for a mass."""
    best, robust = found.best, found.robust
    return page_of(
        design_told(found),
        found.scene.title or "Design of an impact absorber",
        f"The best box for {found.mass:.4g} kg in all",
        [
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
        origin,
        [_scene(found.scene)],
        ["Stationary values of a linear structure and rigid stops, without friction and gravity."],
    )


def _tuned_card(found: TunedDamper | None) -> Fact:
    """The ratio that a tuned damper of the same mass leaves."""
    if found is None:
        return Fact("Tuned damper", UNKNOWN, "for several coordinates under a sine")
    return Fact("Tuned damper", f"{100.0 * found.ratio:.1f} %", "with the same mass, instead")


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


def _verification(found: AbsorberReport) -> Section:
    central = found.central.response
    facts = [
        Fact(f"Balance of {name}", plus_minus(residual), "relative to its largest term; 0 is right")
        for name, residual in central.identities.items()
    ]
    return Section(title="Verification", facts=facts)


def _footer(cost: Cost) -> list[str]:
    return [f"{cost.paths} paths, {cost.steps:.3g} steps, {cost.wall_time:.3g} s of simulation"]


# ------------------------------------------------------------------------------
# Pictures.
# ------------------------------------------------------------------------------


def plot_absorber(found: AbsorberReport, ax: Axes | None = None) -> Axes:
    """rms ratio against level, with 95 % intervals."""
    levels = [each.level_db for each in found.performances]
    limits = [(each.ratio.value, *each.interval()) for each in found.performances]
    chart = Chart.on(ax, Scale("level of the excitation (dB)"), RATIO, SIZE)
    return _draw_ratios(chart, found, levels, limits)


def draw_plays(found: AbsorberReport, ax: Axes | None = None) -> Axes:
    """rms ratio against the total play of the box, with 95 % intervals; the scene's own play and
    the tuned damper of the same mass are marked."""
    curve = found.play_curve
    known = [each.play for each in curve if each.play is not None]
    of = Scale("play over that of the scene")
    if known:
        of = Scale("total play of the box", length_of(max(known)))
    plays = known or [each.play_factor for each in curve]
    chart = Chart.on(ax, of, RATIO, SIZE)
    own = float(np.interp(1.0, [each.play_factor for each in curve], plays))
    chart.at(own, "this box", style=":")
    return _draw_ratios(
        chart, found, plays, [(each.ratio.value, each.low, each.high) for each in curve]
    )


def _draw_ratios(
    chart: Chart, found: AbsorberReport, x: Sequence[float],
    limits: Sequence[tuple[float, float, float]],
) -> Axes:  # fmt: skip
    """Ratios with their 95 % limits, beside those without absorber and of a tuned damper."""
    ratios, low, high = np.array(limits).T
    words = f"absorber of {100.0 * found.mass_ratio:.3g} % of the mass"
    chart.points(x, ratios, words, form="o-", low=low, high=high)
    chart.level(1.0, "no absorber", style="--")
    _draw_tuned(chart, found.tuned_damper)
    chart.ax.set_ylim(0.0, max(1.1, 1.05 * float(high.max())))
    return chart.finish()


def _draw_tuned(chart: Chart, found: TunedDamper | None) -> None:
    """Draw the ratio of the tuned damper of the same mass as a horizontal line."""
    if found is not None:
        chart.level(found.ratio, "tuned damper of the same mass", "exact", "-.")


def plot_design(found: Design, ax: Axes | None = None) -> Axes:
    """rms ratio against play for every candidate, and the best box with its interval."""
    from matplotlib import colormaps

    best = found.best
    play = Scale("total play of the box", length_of(best.play), log=True)
    chart = Chart.on(ax, play, RATIO, SIZE)
    laws, splits = (sorted(found.curve[name].unique()) for name in ("restitution", "units"))
    for (restitution, units), rows in found.curve.groupby(["restitution", "units"]):
        points = rows.sort_values("play")
        shade = colormaps["viridis"](0.85 * laws.index(restitution) / max(len(laws) - 1, 1))
        style = ("-", "--", ":", "-.")[splits.index(units) % 4]
        words = f"R = {restitution:g}" + ("" if units == 1 else f", {units} units")
        chart.column(points, "play", "rms_ratio", words, shade, f"o{style}", capsize=2)
    low, high = (play.quantity(each) for each in (best.low, best.high))
    words = "as good as the best"
    chart.ax.axvspan(low, high, color=COLOURS["stop"], alpha=BAND_ALPHA, linewidth=0, label=words)
    _draw_tuned(chart, found.tuned_damper)
    chart.ax.set_ylim(0.0, 1.05)
    return chart.finish(3)


PANEL = (7.0, 3.2)
"""Width of a figure and height of each of its panels, inches."""

LEFT = Scale("largest displacement\nwith / without absorber", log=True)

LOWEST = 1e-3
"""Smallest ratio that a picture shows."""


def plot_absorber_sine(found: AbsorberSine, ax: Axes | None = None) -> Axes:
    """Draw the ratio that the absorber leaves over frequency, and over each number that is
    tuned; given Axes get that over frequency alone."""
    draw = [partial(_draw_residual, curve) for curve in (found.frequency, *found.tuning)]
    title = f"absorber of {100.0 * found.mass_ratio:.3g} % of the mass, {found.carrier}"
    return panels(ax, draw, (PANEL[0], PANEL[1] * len(draw)), title, sharex=False)


def _draw_residual(curve: ResidualCurve, ax: Axes) -> None:
    """Least and largest ratio of the motions that may last, and that of the first harmonics."""
    x, best, worst = curve.value, curve.best, curve.worst
    over = _over(curve)._replace(log=len(x) > 1 and x[-1] > 5.0 * x[0] > 0.0)
    chart = Chart(ax, over, LEFT)
    chart.curve(x, worst, "largest that may last", low=best, high=worst)
    chart.curve(x, best, "least that may last", style="--")
    chart.curve(x, curve.first_harmonic, "first harmonics, stable regime", "exact", ":")
    clusters = ~curve.periodic
    chart.points(x[clusters], worst[clusters], "clusters", "linearise:closure", ".")
    chart.level(1.0, None, style="--")
    chart.finish()
    ax.set_ylim(bottom=max(LOWEST, ax.get_ylim()[0]))
