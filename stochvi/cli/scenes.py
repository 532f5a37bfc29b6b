"""Commands to start from. Chapters: `demo`; a scene file, its schema, and the environments that
ship."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click

from stochvi.cli.declared import command
from stochvi.cli.options import Common
from stochvi.cli.program import BAD_INPUT, console_for, echo, main, stop

# ------------------------------------------------------------------------------
# The command `demo`: the truck is sized; or theory, a textbook oscillator by all methods.
# ------------------------------------------------------------------------------


THEORY = {
    "oscillator-elastic": ("check", "simulate"),
    "oscillator-lossy": ("check", "simulate"),
    "isolator-truck": ("screen", "clearance"),
}
"""Shipped scenes by which `demo --theory` shows the methods: a textbook oscillator at R = 1 and at
R = 0.8, and a mount; each with the commands that it is given to."""

MINUTES = 10.0
"""Budget of each of these commands, min: enough for a slow machine."""


@command("seed, threads, force, quiet, verbose", reads="")
def demo(options: Common, out: Path, theory: bool) -> None:
    """Size the box on a truck, and write its page.

    --out DIR (path) = out  Where the page, tables and pictures go.
    --theory  Instead: a textbook case and the truck's mount by all methods, which have to agree.
    """
    from stochvi.cli.program import check_folder_target
    from stochvi.scenes.datasets import shipped_scene
    from stochvi.views.files import folder_in

    check_folder_target(out)
    console = console_for(None)
    console.quiet = options.quiet

    def ask(name: str, scene: str, folder: Path, **asked: Any) -> None:
        """A command of a shipped scene, with the options of the demo that it has."""
        file = str(shipped_scene(scene))
        asked = vars(options) | {"scene": file, "scenes": (file,), "out": folder} | asked
        known = [str(each.name) for each in main.commands[name].params]
        given = {key: asked[key] for key in known if key in asked}
        click.get_current_context().invoke(main.commands[name], **given)

    if not theory:
        ask("size", "isolator-truck", out, probability=0.01, mission=3600.0)
        page = f"its page: {out / 'report.html'}; your own scene: stochvi new truck.toml"
        console.print(f"\n{page}", highlight=False, soft_wrap=True)
        return
    for scene, names in THEORY.items():
        for name in names:
            line = f"stochvi {name} {scene}.toml --budget {MINUTES:g}min"
            console.print(f"\n{line}", style="bold", highlight=False)
            ask(name, scene, folder_in(out, scene), budget=60.0 * MINUTES)
    console.print(f"\ntables and pictures are in {out}/", highlight=False)


# ------------------------------------------------------------------------------
# Commands to start from: a scene file, its schema, and the environments that ship.
# ------------------------------------------------------------------------------


KINDS = {
    "bumper": "isolator-bumper",
    "road": "isolator-road",
    "vehicle": "isolator-vehicle",
    "record": "isolator-record",
    "potholes": "isolator-potholes",
    "absorber": "absorber-on-a-tower",
    "sine": "isolator-sine",
    "rigid-body": "rigid-box",
    "beam": "beam",
    "modes": "blade",
    "hammer": "hammer",
}
"""Shipped scenes that `new` copies, by the kind that --kind names."""

MOUNTS = {
    "mass": ("Mass of the equipment", "kg", "12 kg"),
    "mounts": ("Number of mounts", "", "4"),
    "stiffness": ("Stiffness of one mount", "N/m", "17 N/mm"),
    "zeta": ("Damping ratio", "", "0.1"),
}
"""Numbers of equipment on its mounts: the question, the unit, and a usual value."""

OWN_NUMBERS = {
    "mission": MOUNTS,
    "wire-rope": MOUNTS | {"zeta": ("Damping ratio in large motions, beside the loop", "", "0.1")},
    "box": MOUNTS | {"size": ("Length, width and height", "m", "400mm,300mm,200mm")},
}
"""Kinds that `new` writes with numbers of the user, and these numbers."""

TEMPLATE = """\
title = "isolated box on a truck"

[structure]
kind = "isolator"            # "oscillator": on a fixed base, "isolator": on a moving one
frequency_hz = 12.0          # with exactly one of zeta, Q and loss_factor
zeta = 0.1
# mass = 2.5                 # kg; needed if a force acts on the mass
# or: mass (kg), stiffness (N/m) and one of damping (N s/m), zeta, Q and loss_factor; mounts = 4 if
# stiffness and damping are those of one of four
# springs and dampers that are functions add to these: spring = { kind = "duffing",
# cubic_stiffness = 1e9 } (N/m^3), or { kind = "polynomial", coefficients = [1e4, 0.0, 1e9] }
# (N/m, N/m^2, ...), or a measured force { kind = "table", file = "mount.csv", unit = "mm,N" }, or
# wire rope { kind = "bouc-wen", stiffness = 2e4, yield_displacement = 1e-3 } (N/m, m), or rubber
# { kind = "relaxation", stiffness = 2e5, branches = [[5e4, 0.01]] } (N/m; N/m, s);
# damper = { kind = "coulomb", force = 2.0 } (N), or { kind = "polynomial", coefficients =
# [5.0, 20.0] } (N s/m, N s^2/m^2), or { kind = "rayleigh", linear_damping = -5.0, cubic_damping =
# 50.0 } (N s/m, N s^3/m^3), or { kind = "van-der-pol", damping = 5.0, amplitude = 1e-3 } (N s/m,
# m); a drive along the motion: damper = { kind = "relay", force = 10.0, reverses_above = 0.4,
# delay = 0.02 } (N, m, s)
# gravity = true             # towards -x; left out, stops are measured from where the mass hangs
# differs between units: frequency_hz = { mean = 12.0, std = 0.4 }, or half_width = 0.6 (uniform)
# frequency_tolerance = 0.1  # relative, and damping_tolerance: `size` keeps its target within
# several masses: kind = "matrices", coordinates = ["box", "absorber"], mass = [[..], [..]],
# damping = .., stiffness = ..; every entry below then needs on = or between =;
# on = "base" is an acceleration of the base; between = ["box", "absorber"] is for a force and its
# reaction as well
# a percussion machine of such masses: stochvi new --kind hammer
# a box of six degrees of freedom on its mounts: stochvi new --kind rigid-body
# a bar, beam or plate: stochvi new --kind beam; natural modes, also from a file: --kind modes

[[impact_pair]]              # leave the section out for no stops
lower = -0.004               # m from the position of the unloaded spring; leave out for none
upper = 0.004                # both sides alike: clearance = 0.004 instead of lower and upper
law = { kind = "restitution", coefficient = 0.5 }    # lower_law / upper_law where they differ
# differs between units: upper = { mean = 0.004, std = 1e-4 }, and so a stiffness of a stop
# drawn anew at each impact (beta distribution): coefficient = { mean = 0.5, std = 0.1 }
# falls with the speed: { kind = "speed-restitution", coefficient = 0.5, at_speed = 0.3, body =
# "viscoelastic" } (m/s), or lists: speed = [0.1, 1.0], coefficient = [0.7, 0.4]
# compliant stops (N/m): { kind = "elastic", stiffness = 1e5 },
# { kind = "viscoelastic", stiffness = 1e5, damping_ratio = 0.2 } (or loss_factor = 0.4, or
# restitution = 0.6 with at_speed = 0.5 (m/s); instead of stiffness a rubber pad: shore_a = 60.0,
# area = 4e-4 (m^2) and thickness = 0.01 (m)), { kind = "hertz",
# coefficient = 1e6 }, { kind = "power", coefficient = 1e6, exponent = 1.5, loss = 1e5 } (max(k y^n
# + c y^n y', 0)), { kind = "table", deflection = [..], force = [..] } (m, N), or a measured
# one: { kind = "table", file = "bumper.csv", unit = "mm,N" }
# a law may have friction = 0.2 if the pair has tangent = "y", the motion along its stops
# on = "absorber", or between = ["absorber", "box"] (first minus second), or weights = { box = 1.0 }

[[excitation]]
kind = "psd"                 # or "white", "filtered", "sine", "constant"; several add up
profile = "mil-std-810h-truck-vertical-5hz"          # see: stochvi profiles
level_db = 0.0
# or: file = "my.csv" (text, .uff, .mat; column = "Z" or 3 where it has several; of a spectrum.csv
# that `stochvi spectrum --out` wrote: of = "body"), or
# frequency_hz = [..] and density = [..], with a unit, unless the heading of the file states it:
# unit = "g2/Hz"             # "(m/s2)2/Hz", "N2/Hz", "dB re 1 g2/Hz", ...; one-sided per hertz
# white: intensity = S0 of E[f(t) f(t+s)] = S0 delta(s), with a mean square displacement of
# S0 / (2 c k); S0 = 2 pi S of a two-sided density S per rad/s; or density = .. with unit = ..
# filtered: the same keys, for white noise that then passes a resonance of frequency_hz and zeta;
# at its peak this raises the density by the factor 1 / (4 zeta^2)
# filtered, of any order: numerator = [..] and denominator = [..], coefficients of s (rad/s), the
# highest power first (also kind "transfer-function"); or A, B and C (also kind "state-space")
# sine: frequency_hz and amplitude (N, or m/s^2 of the base);
# instead of amplitude: displacement (m) or velocity (m/s) of the base, or unbalance (kg m) of a
# rotor on the mass; phase_deg where several make one force
# road: road = "C" (ISO 8608) and speed_kmh; the mount stands on the road itself, or on a vehicle:
# [vehicle] with kind = "quarter-car" and preset = "golden-car" (see: stochvi new --kind vehicle)
# record: file = "run.csv" (time, acceleration) and unit = "g"; fs = 1000.0 (Hz) without times,
# column = "Z" where there are several, gaps = "split" where samples are missing
# modulation: of = "stiffness", "damping" or "clearance" changes by a share: amplitude and
# frequency_hz (a sine), intensity (s, white noise), intensity, frequency_hz and zeta (filtered), or
# a table: frequency_hz = [..] and density = [..] (1/Hz), or file = "current.csv"
# pulses: rate (1/s) and impulse (N s, or m/s of the base) at random times; sizes = "equal",
# "normal" or "exponential"; two_sided = false where all act in the positive direction
# constant: force (N) or acceleration (m/s^2, of the base; 9.80665 presses towards -x like gravity)

# [[phase]]                  # of a mission, for size, reliability and damage; FILE.toml#road is one
# name = "road"
# duration = "2 h"           # or seconds
# level_db = 3.0             # raises what shakes; or profile = ".." or [[phase.excitation]];
#                            # [[phase.added_excitation]] and [[phase.moving_band]] beside it
# stiffness_factor = 1.2     # and damping_factor: of mounts that are cold or warm
"""


@main.command()
def profiles() -> None:
    """List the tabulated environments that ship, and those of other packages."""
    from stochvi.mathematics.units import STANDARD_GRAVITY
    from stochvi.scenes.datasets import profiles as shipped
    from stochvi.scenes.excitations import TabulatedNoise
    from stochvi.views.pages import Grid, Section, Told, print_told

    rows = [
        {
            "profile": profile.name,
            "from Hz": profile.frequency_hz[0],
            "to Hz": profile.frequency_hz[-1],
            "stated g": profile.stated_g_rms,
            "g rms": TabulatedNoise(profile=profile.name).table.mean_square() ** 0.5
            / STANDARD_GRAVITY,
        }
        for profile in shipped().with_others().values()
    ]
    table = Grid.of("profiles, g rms as stated and recomputed", rows)
    print_told(console_for(None), Told(sections=[Section(grids=table)]))


@main.command()
@click.argument("file", type=click.Path(path_type=Path))
@click.option(
    "--kind", type=click.Choice(["any", *OWN_NUMBERS, *KINDS]), default="any",
    show_default=True,
    help="Kind of scene: any has every key, in comments; mission, wire-rope and box are of your "
    "numbers; bumper, road, vehicle, record, potholes and sine are isolators with their tables; "
    "rigid-body is a box on its mounts, hammer a percussion machine, modes a structure by its "
    "natural modes.",
)  # fmt: skip
@click.option("--mass", help="Mass, as 35kg, for mission, wire-rope or box.")
@click.option("--mounts", help="Number of mounts.")
@click.option("--stiffness", help="Stiffness of one mount, as 35N/mm.")
@click.option("--zeta", help="Damping ratio of the mounts.")
@click.option("--size", help="Length, width and height of the box, as 400mm,300mm,200mm.")
def new(file: Path, kind: str, **given: str | None) -> None:
    """Write a commented scene file to start from.

    Kinds with numbers of yours ask for those that are missing, if there is a terminal.
    """
    from stochvi.cli.program import check_file_target
    from stochvi.results.files import write_whole
    from stochvi.scenes.datasets import scene_files
    from stochvi.views.files import write_text

    asked = OWN_NUMBERS.get(kind, {})
    if unknown := [f"--{name}" for name, text in given.items() if text and name not in asked]:
        kinds = [each for each, names in OWN_NUMBERS.items() if unknown[0][2:] in names]
        stop(f"{unknown[0]} is for --kind {', '.join(kinds)}; got --kind {kind}", BAD_INPUT)
    shipped = [] if kind == "any" or asked else scene_files(KINDS[kind])
    tables = shipped[1:]
    for target in (file, *(file.parent / table.name for table in tables)):
        if target.exists():
            stop(f"{target} exists already; choose another name", BAD_INPUT)
        check_file_target("FILE", target, ())
    text = _with_numbers(kind, given) if asked else TEMPLATE
    write_text(shipped[0].read_text("utf-8") if shipped else text, file)
    for table in tables:
        write_whole(table.read_bytes(), file.parent / table.name)
    written = ", ".join(str(path) for path in (file, *(file.parent / t.name for t in tables)))
    try_it = {
        "any": f"explain {file}",
        "potholes": f"screen {file}",
        "absorber": f"absorber {file} --out out",
        "sine": f"sine {file} --from 60 --to 120 --out out",
        "beam": f"explain {file}, and stochvi simulate {file} --out out",
        "modes": f"explain {file}, and stochvi simulate {file} --out out",
        "hammer": f"sine {file} --from 8 --to 16 --out out, and stochvi impacts {file}",
    }.get(kind, f"size {file} --probability 1% --out out")
    if asked:
        from stochvi.scenes.scene import load_scene

        for told in load_scene(file).slipped_units():
            echo(f"note: {told}")
    click.echo(f"wrote {written}; try: stochvi {try_it}", err=True)


def _with_numbers(kind: str, given: dict[str, str | None]) -> str:
    """A scene of a kind with the numbers that are given, or asked for where there is a terminal."""
    from string import Template

    from stochvi.mathematics.units import measured_in
    from stochvi.scenes.datasets import data_folder

    numbers: dict[str, list[float]] = {}
    for name, (words, unit, usual) in OWN_NUMBERS[kind].items():
        text = given[name]
        if text is None and sys.stdin is not None and sys.stdin.isatty():
            text = click.prompt(words, default=usual, err=True)
        elif text is None:
            text = usual
            echo(f"note: --{name} {usual} was taken for the {words.lower()}")
        try:
            numbers[name] = [measured_in(each, unit) for each in text.split(",")]
        except ValueError as error:
            raise ValueError(f"--{name} {error}") from None
    fields = {name: f"{values[0]:.6g}" for name, values in numbers.items()}
    (mass, mounts, stiffness, zeta) = (numbers[name][0] for name in MOUNTS)
    if mounts < 1 or mounts != int(mounts):
        raise ValueError(f"--mounts must be a whole number from 1 on, got {mounts:g}")
    if not 0.0 < zeta < 1.0:
        raise ValueError(
            f"--zeta must be a ratio between 0 and 1, such as 0.12 or 12%, got {zeta:g}"
        )
    fields |= {"soft": f"{0.25 * stiffness:.6g}", "slips": f"{0.75 * stiffness:.6g}"}
    if kind == "box":
        fields |= _box(mass, int(mounts), stiffness, zeta, numbers["size"])
    path = data_folder() / "scenes" / "templates" / f"{kind}.txt"
    template = Template(path.read_text("utf-8"))
    if kind == "box":
        far = {f"{name}_stop": "1.0" for name in ("corner", "side", "end")}
        fields |= _stops_at_three_sigma(template.substitute(fields | far))
    return template.substitute(fields)


def _stops_at_three_sigma(text: str) -> dict[str, str]:
    """Clearances of three rms motions: a fixed one is far out of reach of stiff mounts."""
    import tomllib

    from stochvi.isolators import screen
    from stochvi.scenes.scene import Scene

    found = screen(Scene(**tomllib.loads(text))).impact_pairs
    return {f"{name}_stop": f"{gap.three_sigma:.2g}" for name, gap in found.items()}


def _box(
    mass: float, mounts: int, stiffness: float, zeta: float, size: list[float]
) -> dict[str, str]:
    """Inertia, corners and mounts of a uniform box, whose mounts stand in two rows below it."""
    if len(size) != 3:
        raise ValueError(
            f"--size must be length, width and height, as 400mm,300mm,200mm, got {size}"
        )
    if mounts < 4 or mounts % 2:
        raise ValueError(f"--mounts of a box must be an even number from 4 on, got {mounts}")
    x, y, z = (0.5 * each for each in size)
    inertia = [mass / 3.0 * pair for pair in (y * y + z * z, x * x + z * z, x * x + y * y)]
    steps = [2.0 * row / (mounts // 2 - 1) - 1.0 for row in range(mounts // 2)]
    sections = [
        f"[[structure.mount]]\nat = {_listed([x * step, y * side, -z])}   # m from the centre of "
        f"mass\nstiffness = {_listed([stiffness] * 3)}   # N/m along x, y, z, by catalogue\n"
        f"zeta = {zeta:g}\n"
        for step in steps
        for side in (-1.0, 1.0)
    ]
    return {
        "inertia": _listed(inertia), "size": " x ".join(f"{each:g}" for each in size),
        "corner": _listed([x, y, -z]), "top": _listed([x, y, z]),
        "sections": "\n".join(sections),
    }  # fmt: skip


def _listed(numbers: list[float]) -> str:
    return f"[{', '.join(f'{each:.4g}' for each in numbers)}]"


@main.command()
@click.argument(
    "of", type=click.Choice(["scene", "answer"]), default="scene", metavar="[scene|answer]"
)
def schema(of: str) -> None:
    """Print the JSON Schema of scene files or of answers.

    An editor completes and checks the keys of a scene file by it. Kinds that other packages add are
    not in it.
    """
    from stochvi.views.files import write_json

    if of == "scene":
        from stochvi.scenes.keys import scene_schema

        write_json(scene_schema(), "-")
    else:
        from stochvi.cli.answer_schema import answer_schema

        write_json(answer_schema(), "-")


@main.command()
@click.argument("scene", required=False)
@click.option("--no-browser", is_flag=True, help="Print the address, and open nothing.")
@click.option("--seed", type=int, default=0, show_default=True, help="Seed of the simulations.")
def explore(scene: str | None, no_browser: bool, seed: int) -> None:
    """Turn the knobs of a scene in the browser, and see what changes.

    The page is served on this machine alone and ends with its last tab, or with Ctrl-C. Without
    SCENE it begins with a box on a truck.
    """
    from stochvi.explorer.server import serve
    from stochvi.explorer.turns import Explorer
    from stochvi.scenes.datasets import shipped_scene
    from stochvi.scenes.scene import load_scene

    explorer = Explorer(load_scene(scene or shipped_scene("isolator-truck")), seed, line_of)

    def tell(address: str) -> None:
        click.echo(f"Open {address}\nIt ends with its last tab, or with Ctrl-C.")

    serve(explorer, tell, browser=not no_browser)


def line_of(name: str, file: str, asked: Mapping[str, Any]) -> str:
    """The command line of a command, by the options that it declares.

    >>> line_of("size", "truck.toml", {"probability": 0.01, "mission": 3600.0})
    'stochvi size truck.toml --probability 0.01 --mission 3600.0'
    """
    options = {str(each.name): each.opts[0] for each in main.commands[name].params}
    words = [word for key, value in asked.items() for word in (options[key], str(value))]
    return shlex.join(["stochvi", name, file, *words])
