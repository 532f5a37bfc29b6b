"""The study of when commands end asks every command that has a budget."""

from __future__ import annotations

import importlib
import resource
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import click
import pandas as pd
import pytest

from stochvi.cli import main
from stochvi.cli.options import Common
from stochvi.results.errors import NotConverged
from stochvi.scenes.datasets import shipped_scene
from support.accuracies import quick_cases
from support.commands import ELASTIC, Run
from support.known import to_toml

scene_room = importlib.import_module("stochvi.scenes.scene")
STUDY = importlib.import_module("studies.16_time_that_was_asked.cases")


def test_every_command_with_a_budget_is_asked_something() -> None:
    asked = {case.command for case in STUDY.cases() if case.budgeted}
    has_budget = {
        name
        for name, command in main.commands.items()
        if any(option.name == "budget" for option in command.params)
    }
    assert asked == has_budget


def test_a_command_without_a_question_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(main.commands, "foretell", click.Command("foretell"))
    with pytest.raises(RuntimeError, match="foretell has no question"):
        list(STUDY.cases())


def test_the_scenes_of_the_study_are_files() -> None:
    assert all(file.is_file() for file in STUDY.scenes().values())


@pytest.mark.verify
def test_commands_end_in_their_cpu_time(tmp_path: Path) -> None:
    """A part of the study, by CPU time: a busy machine takes nothing from a budget."""
    run = Path(STUDY.__file__).with_name("run.py")
    asked = ["--quick", "--cpu-clock", "--only", "simulate,spectrum,reliability,explain"]
    subprocess.run([sys.executable, run, *asked, "--out", tmp_path], check=True)
    table = pd.read_csv(tmp_path / "result.csv")
    judged = table[(table["exit_code"] != 2) & table["limit"].notna()]
    assert len(judged) >= 10
    # the caches that others share make CPU times a quarter longer
    late = judged[judged["wall"] > 1.25 * judged["limit"]]
    assert not len(late), late[["command", "scene", "ended_by", "wall", "limit"]].to_string()


NOISE = {"kind": "psd", "unit": "g2/Hz", "frequency_hz": [5.0, 500.0], "density": [1e-3, 1e-3]}
STOPS = {"lower": -0.02, "upper": 0.02, "law": {"kind": "restitution", "coefficient": 0.7}}
ROAD = {"kind": "road", "road": "D", "speed_kmh": 50.0, "band_hz": [0.5, 30.0]}

HARD = {
    "a light damper": ({"frequency_hz": 12.0, "zeta": 1e-3}, NOISE, "reliability --mission 3600"),
    "a heavy damper": ({"frequency_hz": 12.0, "Q": 5e-3}, NOISE, "spectrum"),
    "a slow mount": ({"frequency_hz": 2.5e-3, "zeta": 0.15}, ROAD, "simulate"),
    "a box, clearance": (None, None, "clearance"),
    "a box, size": (None, None, "size --probability 0.01 --mission 600"),
    "a box, cost": (None, None, "cost"),
    "a box, check": (None, None, "check"),
}
"""Questions of which one step used to take 10 to 40 s: structure and noise of an isolator, or a
rigid box."""


def cpu_seconds(command: list[Any]) -> tuple[subprocess.CompletedProcess[str], float]:
    """A process as it ended, and the CPU seconds that it used."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return ended, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


@pytest.mark.slow
@quick_cases("question", HARD, keep=(4,))
def test_a_short_budget_is_kept_where_a_step_takes_long(tmp_path: Path, question: str) -> None:
    mount, noise, words = HARD[question]
    scene = shipped_scene("rigid-box")
    if mount is not None:
        document = {"structure": {"kind": "isolator"} | mount, "excitation": [noise]}
        scene = tmp_path / "scene.toml"
        scene.write_text(to_toml(document | {"impact_pair": [STOPS]}), encoding="utf-8")
    clock = Path(STUDY.__file__).with_name("on_cpu_clock.py")
    command, *more = words.split()
    asked = [sys.executable, clock, "0", command, scene, *more, "--threads", "1", "--budget", "0.7"]
    # in the first run kernels may be compiled
    subprocess.run(asked, capture_output=True, check=False)
    ended, spent = cpu_seconds(asked)
    assert ended.returncode in (0, 1) and "Traceback" not in ended.stderr
    # the rule allows 2 s for what is no calculation; a slow machine takes longer to import
    _, start = cpu_seconds([sys.executable, clock, "0", "screen", scene])
    # the caches that others share make CPU times a quarter longer
    assert spent < 1.25 * (1.2 * 0.7 + max(2.0, start)), ended.stderr


MOUNT, BOX = str(shipped_scene("isolator-sine")), str(shipped_scene("absorber-in-a-box"))

HANDED_ON = [
    ("simulate", "stochvi.methods.monte_carlo.simulate", ELASTIC),
    ("spectrum", "stochvi.statistics.spectra.spectrum", ELASTIC),
    ("impacts", "stochvi.statistics.impacts.impacts", ELASTIC),
    ("damage --mission 60", "stochvi.statistics.damage.damage", ELASTIC),
    ("check", "stochvi.verification.check.check", ELASTIC),
    ("cost", "stochvi.verification.cost.cost", ELASTIC),
    ("reliability --mission 60", "stochvi.statistics.reliability.reliability", ELASTIC),
    ("size --rate 0.01", "stochvi.isolators.sizing.method.size", ELASTIC),
    ("sine", "stochvi.methods.periodic.harmonic_response", MOUNT),
    ("basins", "stochvi.methods.periodic.basins", MOUNT),
    ("bifurcation --from 90 --to 100", "stochvi.methods.periodic.bifurcation", MOUNT),
    ("stability", "stochvi.statistics.stability.stability", ELASTIC),
    ("lifetimes", "stochvi.statistics.lifetimes.lifetimes", MOUNT),
    ("jolt --speeds 0.3", "stochvi.isolators.jolt_response.jolts", MOUNT),
    ("absorber --sine", "stochvi.absorbers.absorber_sine", BOX),
    ("sweep --vary structure.stiffness=1,2", "stochvi.sweeps.sweep", ELASTIC),
    ("exact", "stochvi.methods.closed_form.exact", ELASTIC),
    ("linearise", "stochvi.methods.linearisation.linearise", ELASTIC),
    ("average", "stochvi.methods.averaging.average", ELASTIC),
    ("fokker-planck", "stochvi.methods.fokker_planck.fokker_planck", ELASTIC),
    ("first-passage --times 10", "stochvi.methods.fokker_planck.first_passage", ELASTIC),
    ("history --duration 10", "stochvi.statistics.histories.history", ELASTIC),
    ("replay", "stochvi.methods.replay.replay", str(shipped_scene("isolator-record"))),
    ("screen", "stochvi.isolators.screening.screen", ELASTIC),
    ("explain", "stochvi.verification.explain.explain", ELASTIC),
]  # fmt: skip
"""Commands, and the functions that they call."""


@pytest.mark.parametrize(("command", "function", "scene"), HANDED_ON, ids=lambda word: word[:20])
def test_the_start_of_a_command_is_a_part_of_its_budget(
    monkeypatch: pytest.MonkeyPatch, stochvi: Run, command: str, function: str, scene: str
) -> None:
    """Imports, and a scene that is long in reading, leave less to the calculation."""
    clock, late, given = time.time, [0.0], []
    monkeypatch.setattr(time, "time", lambda: clock() + late[0])

    def loaded(name: str, load: Any = scene_room.load_scene) -> Any:
        late[0] += 6.0
        return load(name)

    def solve(*_: Any, budget: float, **__: Any) -> None:
        given.append(budget)
        raise NotConverged("a stub")

    monkeypatch.setattr(scene_room, "load_scene", loaded)
    module, _, name = function.rpartition(".")
    monkeypatch.setattr(importlib.import_module(module), name, solve)
    assert stochvi(*command.split()[:1], scene, *command.split()[1:], "--budget", "10").code == 1
    rows = 2 if command.startswith("sweep") else 1
    (left,) = given
    assert 0.0 < left * rows <= rows * 10.0 - 6.0


def test_every_command_with_a_budget_hands_it_on() -> None:
    tried = {command.split()[0] for command, *_ in HANDED_ON}
    # clearance hands on the same arguments as reliability
    assert tried | {"clearance"} == {case.command for case in STUDY.cases() if case.budgeted}


def test_what_takes_long_in_drawing_is_left_time_for(tmp_path: Path) -> None:
    plain, written = Common(), Common(out=tmp_path)
    assert plain.until(3.0, 3.5).left == pytest.approx(3.0, abs=0.2)
    # a fifth of the budget may pass after it, and a second or so
    assert written.until(3.0, 3.5).left == pytest.approx(3.0 - (3.5 - 1.3 - 0.6), abs=0.2)
    assert written.until(60.0, 3.5).left == pytest.approx(60.0, abs=0.2)
    assert written.until(1.0, 3.5).left == pytest.approx(0.3, abs=0.1)  # it gets a little always


def test_the_end_of_the_program_looks_through_nothing() -> None:
    """Python looked for cycles among all objects as it ended, for half a second of each command."""
    words = (
        "import atexit, gc; atexit.register(lambda: print(gc.get_freeze_count()));"
        "from stochvi.__main__ import run; run()"
    )
    ended = subprocess.run(
        [sys.executable, "-c", words, "--version"], capture_output=True, text=True, check=True
    )
    assert int(ended.stdout.split()[-1]) > 10_000
