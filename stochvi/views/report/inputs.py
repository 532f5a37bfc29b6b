"""What a clearance report says of its inputs: environment, isolator, gap and stops."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

from stochvi.isolators.sizing.answer import spoken_mission
from stochvi.isolators.sizing.chances import spoken_chance_of_stops
from stochvi.scenes.datasets import profiles
from stochvi.scenes.excitations import (
    ConstantLoad,
    DensityNoise,
    Excitation,
    FilteredNoise,
    RecordedNoise,
    RoadNoise,
    Sine,
    TabulatedNoise,
    WhiteNoise,
)
from stochvi.scenes.impact_laws import ForceTable, Law
from stochvi.scenes.structures import Isolator, Oscillator
from stochvi.views.report.pages import Fact, Section, shown
from stochvi.views.report.plots import plot_input, plot_response
from stochvi.views.report.words import G, millimetres

if TYPE_CHECKING:
    from stochvi.isolators.sizing.answer import Sizing
    from stochvi.scenes.scene import Scene

LAW_UNITS = {"stiffness": "N/m", "coefficient": "N/m^1.5"}


def environment(scene: Scene) -> Section:
    facts: list[Fact] = []
    for excitation in scene.excitations:
        facts += _excitation_facts(scene, excitation)
    system = scene.system()
    shaken_base = system.moving_base and not system.noise_on_mass
    if shaken_base and system.tables and not system.intensity:
        area = sum(table.mean_square() for table in system.tables)
        per = (2.0 * math.pi) ** 2
        velocity = sum(table.moment(-2.0) for table in system.tables) / per
        shift = sum(table.moment(-4.0) for table in system.tables) / per**2
        facts += [
            Fact(
                "Base acceleration, recomputed",
                f"{G * math.sqrt(area):.4g} g rms",
                "area under the density, log-log straight between breakpoints",
            ),
            Fact("Base velocity", f"{math.sqrt(velocity):.4g} m/s rms"),
            Fact(
                "Base displacement",
                f"{millimetres(math.sqrt(shift))} rms",
                "set by the lowest frequencies of the table",
            ),
        ]
    pictures = []
    if shaken_base and (system.tables or system.intensity):
        pictures = [
            shown(
                plot_input(scene),
                "Input: one-sided density of the base acceleration, with its "
                "breakpoints and a band of ±3 dB.",
            ),
            shown(
                plot_response(scene),
                "Absolute acceleration of the mass without stops, over the input.",
            ),
        ]
    return Section(
        title="Environment",
        lead="All densities are one-sided per hertz; accelerations are rms unless they are said "
        "to be peak. 1 g = 9.80665 m/s².",
        facts=facts,
        pictures=pictures,
    )


def _excitation_facts(scene: Scene, excitation: Excitation) -> list[Fact]:
    where = scene.place(excitation)
    level = getattr(excitation, "level_db", 0.0)
    raised = f", raised by {level:+g} dB" if level else ""
    match excitation:
        case TabulatedNoise() if excitation.profile is not None:
            known = profiles()[excitation.profile]
            return [
                Fact(
                    f"Tabulated noise on {where}",
                    excitation.profile + raised,
                    f"source: {known.source}",
                ),
                Fact("Stated by its source", f"{known.stated_g_rms:.4g} g rms", "at 0 dB"),
            ]
        case TabulatedNoise():
            source = "breakpoints in the scene" if excitation.file is None else excitation.file
            return [
                Fact(
                    f"Tabulated noise on {where}",
                    Path(source).name + raised,
                    f"{len(excitation.table.frequency_hz)} points in "
                    f"{excitation.density_unit}, {_band(excitation)}",
                )
            ]
        case RoadNoise():
            which = (
                f"class {excitation.road}"
                if excitation.road
                else (f"Gd(n0) = {excitation.roughness:g} m³")
            )
            return [
                Fact(
                    "Road of ISO 8608",
                    which + raised,
                    f"at {excitation.metres_per_second:.4g} m/s, {_band(excitation)}; no "
                    "vehicle between road and mount",
                )
            ]
        case RecordedNoise():
            return _record_facts(excitation, where, raised)
        case WhiteNoise() | FilteredNoise():
            words, remark = "White noise", "one-sided; intensity S0 is half of it"
            if isinstance(excitation, FilteredNoise):
                words = "Filtered noise"
                remark += (
                    f"; that is before a resonance at {excitation.frequency_hz:.4g} Hz with a "
                    f"damping ratio of {excitation.zeta:.3g}"
                )
            unit = "(m/s²)²/Hz" if where == "base" else "N²/Hz"
            strength = f"{2.0 * excitation.si_intensity:.4g} {unit}"
            return [Fact(f"{words} on {where}", strength, remark)]
        case Sine():
            unit = "m/s² peak" if where == "base" else "N peak"
            return [
                Fact(
                    f"Sine on {where}",
                    f"{excitation.amplitude:.4g} {unit}",
                    f"at {excitation.frequency_hz:g} Hz",
                )
            ]
        case ConstantLoad():
            unit = "m/s²" if where == "base" else "N"
            return [Fact(f"Constant load on {where}", f"{excitation.magnitude:.4g} {unit}")]
    return []


def _record_facts(excitation: RecordedNoise, where: str, raised: str) -> list[Fact]:
    record = excitation.record
    kurtosis, error = record.kurtosis()
    scale, unit = (G, "g") if where == "base" else (1.0, "N")
    return [
        Fact(
            f"Measured record on {where}",
            Path(excitation.file).name + raised,
            f"{record.duration:.4g} s at {record.fs:.4g} Hz; density by Welch's method",
        ),
        Fact(
            "Rms of the record",
            f"{scale * record.rms:.4g} {unit}",
            f"largest value {scale * record.peak:.4g} {unit} peak",
        ),
        Fact(
            "Kurtosis of the record",
            f"{kurtosis:.2f} ± {error:.2f}",
            "3 for Gaussian noise, which is what is simulated",
        ),
    ]


def _band(excitation: DensityNoise) -> str:
    f = excitation.table.frequency_hz
    return f"{f[0]:.4g} to {f[-1]:.4g} Hz"


def mount(scene: Scene) -> Section:
    structure = scene.structure
    assert isinstance(structure, Oscillator)
    zeta = structure.damping_rate / (2.0 * structure.omega)
    facts = [
        Fact(
            "Natural frequency",
            f"{structure.omega / (2.0 * math.pi):.4g} Hz",
            _tolerance(structure, "frequency"),
        ),
        Fact(
            "Damping ratio", f"{zeta:.4g}  (Q = {0.5 / zeta:.3g})", _tolerance(structure, "damping")
        ),
    ]
    if structure.mass is not None:
        facts.append(Fact("Mass", f"{structure.mass:.4g} kg"))
    if isinstance(structure, Isolator):
        if structure.mounts is not None:
            facts.append(
                Fact(
                    "Mounts side by side",
                    f"{structure.mounts}",
                    f"{structure.stiffness:g} N/m and {structure.damping:g} N s/m each",
                )
            )
        counted = (
            "counted: gravity pulls towards negative x, and stops lie from the unloaded spring"
            if structure.gravity
            else "for information: clearances here are from where the mass hangs"
        )
        facts.append(
            Fact(
                "Static sag under 1 g",
                millimetres(structure.sag),
                f"{counted}; g / ω², by the dynamic stiffness",
            )
        )
    return Section(title="Isolator", facts=facts)


def _tolerance(structure: Oscillator, what: str) -> str:
    stated = getattr(structure, f"{what}_tolerance", None)
    return "" if stated is None else f"± {100.0 * stated:.3g} %, see sensitivity"


def gap(sizing: Sizing) -> Section:
    scene, c = sizing.scene, sizing.clearance.value
    system = scene.system()
    rest = system.load / system.omega**2
    sides = ["lower", "upper"]
    if scene.impact_pairs:
        sides = [side for side, _ in scene.impact_pairs[0].stops()]
    places = {"lower": (rest - c, "below"), "upper": (rest + c, "above")}
    facts = [
        Fact(
            f"Recommended, {side} stop",
            millimetres(places[side][0]),
            f"{millimetres(c)} {places[side][1]} the mean position",
        )
        for side in sides
    ]
    if rest:
        facts.insert(
            0,
            Fact(
                "Mean position",
                millimetres(rest),
                "from the unloaded spring, by gravity and constant loads",
            ),
        )
    if scene.impact_pairs:
        pair = scene.impact_pairs[0]
        for side, law in pair.stops():
            place = getattr(pair, side)
            facts.append(
                Fact(
                    f"In the scene, {side} stop",
                    millimetres(place),
                    f"{millimetres(abs(place - rest))} from the mean position; {_law(law)}",
                )
            )
        facts.append(
            Fact(
                "Any hit with the stops of the scene",
                spoken_chance_of_stops(sizing),
                f"chance in {spoken_mission(sizing.mission)}, each side by its own distance",
            )
        )
    lead = "Clearances are relative displacements of mass and base, per side. The clearance does "
    lead += "not depend on the law of the stops as long as no hit is wanted; the hits do."
    return Section(title="Gap and stops", lead=lead, facts=facts)


def _law(law: Law) -> str:
    source = getattr(law, "source", None)
    tail = f" (source: {source})" if source else ""
    if law.rigid:
        return f"rigid, restitution {law.restitution:g}: speeds of impact but no peak acceleration"
    if isinstance(law, ForceTable):
        deepest, most = law.deflection[-1], law.force[-1]
        return f"force over deflection, {most:.4g} N at {millimetres(deepest)}{tail}"
    numbers = ", ".join(
        f"{name.replace('_', ' ')} {value:.4g} {LAW_UNITS.get(name, '')}".strip()
        for name, value in law.model_dump(exclude={"kind", "source"}).items()
        if isinstance(value, float)
    )
    return f"{law.word}, {numbers}{tail}"
