"""Parts that meet for the first time: an answer, or a refusal in a sentence, and no word of Python.

Pairs of kinds go through the commands that take them, with tiny budgets: two laws of stops, a
spring or damper with stops and without, a phase or a mission with `--out`, a sweep by each
method, each structure under each two excitations. The product is far too large to be run as a
whole: each run draws cases of it by a seed.
"""

from __future__ import annotations

import json
import random
import re
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from support.commands import Finished, Run

LAWS = {
    "elastic impact": 'kind = "restitution", coefficient = 1.0',
    "restitution": 'kind = "restitution", coefficient = 0.5',
    "scatter": 'kind = "restitution", coefficient = { mean = 0.5, std = 0.1 }',
    "plastic": 'kind = "restitution", coefficient = 0.0',
    "speed": 'kind = "speed-restitution", speed = [0.1, 1.0], coefficient = [0.8, 0.5]',
    "elastic": 'kind = "elastic", stiffness = 2e5',
    "viscoelastic": 'kind = "viscoelastic", stiffness = 2e5, damping_ratio = 0.3',
    "hertz": 'kind = "hertz", coefficient = 2e6',
    "power": 'kind = "power", coefficient = 4e7, exponent = 1.5, loss = 3e7',
    "table": 'kind = "table", deflection = [1e-4, 1e-3], force = [10.0, 400.0]',
}
FORCES = {
    "linear": "",
    "duffing": 'spring = { kind = "duffing", cubic_stiffness = 1e9 }',
    "polynomial spring": 'spring = { kind = "polynomial", coefficients = [1e3, 0.0, 1e9] }',
    "table": 'spring = { kind = "table", deflection = [-1e-2, 0.0, 1e-2], force = [-90, 0, 50] }',
    "bouc-wen": 'spring = { kind = "bouc-wen", stiffness = 2e4, yield_displacement = 1e-3 }',
    "coulomb": 'damper = { kind = "coulomb", force = 2.0 }',
    "polynomial damper": 'damper = { kind = "polynomial", coefficients = [5.0, 20.0] }',
    "rayleigh": 'damper = { kind = "rayleigh", linear_damping = -30.0, cubic_damping = 50.0 }',
    "van der pol": 'damper = { kind = "van-der-pol", damping = 30.0, amplitude = 1e-3 }',
    "relay": 'damper = { kind = "relay", force = 10.0, reverses_above = 0.4, delay = 0.02 }',
    "two": 'spring = { kind = "duffing", cubic_stiffness = 1e9 }\n'
    'damper = { kind = "coulomb", force = 2.0 }',
}
ISOLATOR = '[structure]\nkind = "isolator"\nmass = 2.0\nfrequency_hz = 12.0\nzeta = 0.1\n'
BOX = """[structure]
kind = "rigid-body"
mass = 12.0
inertia = [0.2, 0.25, 0.15]
gravity = "-z"
""" + "".join(
    f"[[structure.mount]]\nat = [{x}, {y}, -0.06]\nstiffness = [2.2e4, 2.2e4, 3.4e4]\n"
    "loss_factor = 0.3\n"
    for x in (-0.2, 0.2)
    for y in (-0.15, 0.15)
)
STRUCTURES = {
    "isolator": (ISOLATOR, "", ""),
    "hanging": (ISOLATOR + "gravity = true\n", "", ""),
    "masses": (
        '[structure]\nkind = "matrices"\ncoordinates = ["a", "b"]\nmass = [[2.0, 0], [0, 1.0]]\n'
        "damping = [[40.0, -10.0], [-10.0, 20.0]]\nstiffness = [[2e4, -5e3], [-5e3, 9e3]]\n",
        'between = ["a", "b"]', 'on = "base"',
    ),
    "box": (BOX, "at = [0.24, 0.18, -0.08]\ndirection = [0, 0, 1]", 'axis = "z"'),
    "reed": (
        '[structure]\nkind = "beam"\nlength = 0.2\nwidth = 0.02\nheight = 0.002\nyoung = 2e11\n'
        'density = 7850.0\nsupport = "cantilever"\nzeta = 0.02\nmodes = 2\n'
        "points = { tip = 1.0 }\n",
        'on = "tip"', 'on = "base"',
    ),
    "bar": (
        '[structure]\nkind = "bar"\nlength = 2.0\narea = 1e-4\nyoung = 2e9\ndensity = 1000.0\n'
        'support = "cantilever"\nzeta = 0.02\nmodes = 2\npoints = { tip = 1.0 }\n',
        'on = "tip"', 'on = "base"',
    ),
    "modes": (
        '[structure]\nkind = "modes"\nfrequency_hz = [41.0, 256.0]\nzeta = 0.02\n'
        "modal_mass = 0.0157\nshapes = { tip = [1.0, -1.0] }\nparticipation = [1.566, -0.868]\n",
        'on = "tip"', 'on = "base"',
    ),
}  # fmt: skip
"""Each structure, where a pair of stops acts on it, and where the base does."""

EXCITATIONS = {
    "white": 'kind = "white"\ndensity = 0.005\nunit = "g2/Hz"',
    "psd": 'kind = "psd"\nfrequency_hz = [5.0, 100.0]\ndensity = [0.01, 0.005]\nunit = "g2/Hz"',
    "filtered": 'kind = "filtered"\ndensity = 0.005\nunit = "g2/Hz"\nfrequency_hz = 15\nzeta = 0.2',
    "transfer": 'kind = "transfer-function"\nintensity = 0.5\nnumerator = [60.0]\n'
    "denominator = [1.0, 60.0]",
    "road": 'kind = "road"\nroad = "C"\nspeed = 20.0',
    "record": 'kind = "record"\nfile = "record.csv"\nunit = "g"',
    "sine": 'kind = "sine"\nfrequency_hz = 11.0\namplitude = 8.0',
    "loud": 'kind = "psd"\nfrequency_hz = [5.0, 100.0]\ndensity = [0.01, 0.005]\nunit = "g2/Hz"\n'
    "kurtosis = 5.0\nlevel_time = 30.0",
    "pulses": 'kind = "pulses"\nrate = 5.0\nimpulse = 0.02',
    "still": 'kind = "constant"\nacceleration = 0.3',
}
QUICK = ("--budget", "0.6")
COMMANDS: dict[str, tuple[str, ...]] = {
    "exact": (), "fokker-planck": ("--budget", "2"), "linearise": (), "average": (),
    "first-passage": ("--times", "1", "--budget", "2"),
    "simulate": ("--paths", "2", "--duration", "2"),
    "spectrum": ("--paths", "2"), "impacts": ("--paths", "2", "--duration", "2"),
    "damage": ("--mission", "5", "--equipment", "20:80:3", *QUICK),
    "history": ("--duration", "1"), "explain": QUICK, "screen": (),
    "reliability": ("--mission", "5", "--rel-error", "0.5", *QUICK),
    "clearance": ("--gaps", "2", "--rel-error", "0.5", *QUICK),
    "size": ("--probability", "10%", "--mission", "60", "--rel-error", "0.5", *QUICK),
    "size by speed": ("--impact-speed", "0.2", "--mission", "60", "--rel-error", "0.5", *QUICK),
    "size by damage": ("--damage-ratio", "2", "--mission", "5", "--equipment", "20:80:3", *QUICK),
    "size as a map": ("--map", "clearance=2mm:4mm:2,stiffness=1e5:2e5:2", "--mission", "5", *QUICK),
    "perturbations": ("--speeds", "0.1", "--paths", "2", "--duration", "1"), "replay": QUICK,
    "damage of the record": ("--way", "record", "--equipment", "20:80:3", *QUICK),
    "sine": ("--from", "8", "--to", "14", "--points", "2", *QUICK),
    "lifetimes": QUICK,
    "bifurcation": (
        "--from", "10", "--to", "12", "--points", "2", "--settling", "5", "--watched", "5", *QUICK
    ),
    "basins": ("--periods", "20", *QUICK), "growth": QUICK,
    "check": ("--rel-error", "0.5", *QUICK),
    "cost": ("--budget", "1"), "absorber": QUICK,
}  # fmt: skip
"""The commands by their names, of which the first word is the command, with options that end them
soon."""

SWEEPS = {
    method: ("--method", method, *more, "--vary", "structure.zeta=0.08,0.12")
    for method, more in {
        "simulate": ("--paths", "2", "--duration", "2"), "exact": (), "closure": (),
        "fokker-planck": (), "average": (), "replay": (),
        "size": ("--probability", "10%", "--rel-error", "0.5", *QUICK),
        "reliability": ("--mission", "5", "--rel-error", "0.5", *QUICK),
    }.items()
}  # fmt: skip
RAW = re.compile(
    r"Traceback|Error\b|inhomogeneous|float division|division by zero|NoneType|has no attribute|"
    r"operand|subscript|not iterable|out of bounds|broadcast|zero-size|not supported|dtype|unpack|"
    r"unexpected keyword|math domain|positional argument|empty sequence|not aligned|ufunc|numba|"
    r"must have the same sign|invalid value|argm(ax|in)|array|object at 0x|overflow|\bself\b|"
    r"singular matrix|must be real number|shape \(|index \d|\bnan\b|\bNone\b"
)
"""What Python and its libraries say, and no refusal does."""


class Case(NamedTuple):
    """A scene file, and what is asked of it."""

    name: str
    scene: str
    words: tuple[str, ...]


def pair(where: str, law: str, upper: str | None = None) -> str:
    laws = f"law = {{ {law} }}" if upper is None else (
        f"lower_law = {{ {law} }}\nupper_law = {{ {upper} }}"
    )  # fmt: skip
    return f"[[impact_pair]]\n{where}\nlower = -0.003\nupper = 0.003\n{laws}\n"


def shaken(where: str, keys: str) -> str:
    return f"[[excitation]]\n{where}\n{keys}\n"


def asked(name: str) -> tuple[str, ...]:
    return (name.split()[0], "SCENE", *COMMANDS[name])


def two_laws() -> Iterator[Case]:
    for one, lower in LAWS.items():
        for other, upper in LAWS.items():
            for drive in ("record", "white", "psd", "sine"):
                scene = ISOLATOR + pair("", lower, upper) + shaken("", EXCITATIONS[drive])
                for command in COMMANDS:
                    yield Case(f"{one} below, {other} above, {drive}", scene, asked(command))


def forces_without_stops() -> Iterator[Case]:
    for name, force in FORCES.items():
        for drive, keys in EXCITATIONS.items():
            for stops in ("", pair("", LAWS["restitution"]), pair("", LAWS["elastic"])):
                scene = ISOLATOR + force + "\n" + stops + shaken("", keys)
                for command in COMMANDS:
                    told = "stops" if stops else "no stops"
                    yield Case(f"{name}, {drive}, {told}", scene, asked(command))


PHASES = (
    '[[phase]]\nname = "road"\nduration = 20.0\n'
    '[[phase]]\nname = "rough road"\nduration = 5.0\nlevel_db = 2.0\nstiffness_factor = 0.9\n'
)


def without_mission(words: tuple[str, ...]) -> tuple[str, ...]:
    """Options without the mission, which a scene with phases has itself."""
    if "--mission" not in words:
        return words
    place = words.index("--mission")
    return (*words[:place], *words[place + 2 :])


def phases() -> Iterator[Case]:
    for structure, (keys, where, base) in STRUCTURES.items():
        for drive in EXCITATIONS:
            for law in ("restitution", "viscoelastic", "none"):
                stops = pair(where, LAWS[law]) if law in LAWS else ""
                scene = keys + stops + shaken(base, EXCITATIONS[drive]) + PHASES
                for command, more in COMMANDS.items():
                    plain = without_mission(more)
                    for place in ("SCENE#rough road", "SCENE"):
                        words = (command.split()[0], place, *(plain if place == "SCENE" else more))
                        yield Case(f"{structure}, {law}, {drive}, {place}", scene, words)


def sweeps() -> Iterator[Case]:
    for method, words in SWEEPS.items():
        for structure, (keys, where, base) in STRUCTURES.items():
            for drive in EXCITATIONS:
                for law in (*LAWS, "none"):
                    stops = pair(where, LAWS[law]) if law in LAWS else ""
                    for end in ("", PHASES):
                        scene = keys + stops + shaken(base, EXCITATIONS[drive]) + end
                        told = f"{structure}, {law}, {drive}{', phases' if end else ''}, {method}"
                        yield Case(told, scene, ("sweep", "SCENE", *words))


def structures() -> Iterator[Case]:
    for structure, (keys, where, base) in STRUCTURES.items():
        for first, second in ((a, b) for a in EXCITATIONS for b in (*EXCITATIONS, "") if a != b):
            for law in (*LAWS, "none"):
                stops = pair(where, LAWS[law]) if law in LAWS else ""
                more = shaken(base, EXCITATIONS[second]) if second else ""
                scene = keys + stops + shaken(base, EXCITATIONS[first]) + more
                for command in COMMANDS:
                    yield Case(f"{structure}, {law}, {first} {second}", scene, asked(command))


FAMILIES = {
    "laws": two_laws, "forces": forces_without_stops, "phases": phases, "sweeps": sweeps,
    "structures": structures,
}  # fmt: skip
SEED, FEW, SOME, VERIFIED = 20, 2, 4, 400
"""Seed of the order of the cases; how many of each family run always, as slow tests, and are
verified."""

WITHOUT_KERNELS = ("exact", "screen", "average")
"""Commands of the cases that run always: kernels take seconds to be compiled."""


def chosen(family: str) -> list[Case]:
    """The cases of a family, in an order of their own."""
    cases = list(FAMILIES[family]())
    random.Random(SEED).shuffle(cases)
    return cases


def complaint(case: Case, folder: Path, stochvi: Run) -> str:
    """What is wrong with the end of a command; empty where it is an answer or a refusal."""
    folder.mkdir()
    (folder / "scene.toml").write_text(case.scene, "utf-8")
    t = np.arange(400) / 200.0
    noise = np.random.default_rng(2).normal(size=t.size)
    np.savetxt(folder / "record.csv", np.column_stack([t, 0.5 * noise]), delimiter=",")
    words = [word.replace("SCENE", str(folder / "scene.toml")) for word in case.words]
    own = () if words[0] == "sweep" else ("--json", folder / "answer.json")
    words[2:2] = ["--out", str(folder / "out"), *map(str, own)]
    try:
        done = stochvi(*words)
    except Exception as error:  # whatever it is, no user should see it
        return f"{type(error).__name__}: {error}"
    said = [line for line in done.err.splitlines() if re.match("stochvi: |note: ", line)]
    if done.code not in (0, 1, 2):
        return f"exit code {done.code}"
    if done.code and not any(line.startswith("stochvi: ") for line in said):
        return f"exit code {done.code} without a reason: {done.err[-300:]}"
    shown = [line for line in [*said, *done.out.splitlines()] if not line.startswith("cost")]
    if raw := [line for line in shown if RAW.search(line)]:
        return raw[0]
    if (folder / "answer.json").exists():
        json.loads((folder / "answer.json").read_text("utf-8"), parse_constant=float.fromhex)
    return ""


def hold(cases: list[Case], tmp_path: Path, stochvi: Run) -> None:
    wrong = {}
    for number, case in enumerate(cases):
        if said := complaint(case, tmp_path / str(number), stochvi):
            wrong[f"{case.name}: {' '.join(case.words)}"] = said
    assert wrong == {}


@pytest.fixture
def quiet(blank_pictures: None) -> Iterator[None]:
    """Pictures are left blank, and what Python warns of is no error here."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield


@pytest.mark.usefixtures("quiet")
@pytest.mark.parametrize("family", ["laws", "forces", "phases", "structures"])
def test_a_few_parts_that_meet_give_an_answer_or_a_refusal(
    family: str, tmp_path: Path, stochvi: Run
) -> None:
    cases = [each for each in chosen(family) if each.words[0] in WITHOUT_KERNELS]
    hold(cases[:FEW], tmp_path, stochvi)


@pytest.mark.slow
@pytest.mark.usefixtures("quiet")
@pytest.mark.parametrize("family", FAMILIES)
def test_parts_that_meet_give_an_answer_or_a_refusal(
    family: str, tmp_path: Path, stochvi: Run
) -> None:
    hold(chosen(family)[:SOME], tmp_path, stochvi)


@pytest.mark.verify
@pytest.mark.usefixtures("quiet")
@pytest.mark.parametrize("family", FAMILIES)
def test_many_parts_that_meet_give_an_answer_or_a_refusal(
    family: str, tmp_path: Path, stochvi: Run
) -> None:
    hold(chosen(family)[SOME : SOME + VERIFIED], tmp_path, stochvi)


@pytest.mark.parametrize(
    "said",
    [
        "stochvi: cannot reshape array of size 0 into shape (0)", "stochvi: float division by zero",
        "stochvi: setting an array element with a sequence. inhomogeneous shape", "Usage: stochvi",
        "note: no picture: 'NoneType' object has no attribute 'x'", "",
    ],
)  # fmt: skip
def test_a_word_of_python_is_noticed(tmp_path: Path, said: str) -> None:
    """The negative control, beside a refusal that is fine and an exception that nothing catches."""
    case = Case("", ISOLATOR, ("exact", "SCENE"))
    assert complaint(case, tmp_path / "said", lambda *_: Finished(2, "", said))
    fine = "stochvi: exact does not apply: excitation must be white noise, got a sine."
    assert complaint(case, tmp_path / "fine", lambda *_: Finished(2, "", fine)) == ""

    def failing(*_: object) -> Finished:
        raise AttributeError("three_sigma")

    assert "AttributeError" in complaint(case, tmp_path / "raised", failing)
