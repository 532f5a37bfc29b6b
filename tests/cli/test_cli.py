"""The command line: exit codes, what goes to stdout and what to stderr, the JSON contract."""

from __future__ import annotations

import hashlib
import importlib
import json
import os
import resource
import shutil
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import click
import numba
import numpy as np
import pandas as pd
import pytest

from stochvi.cli import main, program
from stochvi.cli.options import Common, _each_once
from stochvi.isolators import screen
from stochvi.methods.closed_form import exact
from stochvi.model.model import model_of
from stochvi.results.errors import NotConverged
from stochvi.scenes.datasets import shipped_scene
from stochvi.scenes.scene import load_scene
from support.accuracies import quick_cases
from support.clocks import tick
from support.commands import ELASTIC, ISOLATOR, LOSSY, QUICK, Finished, Run, one_document, refused
from support.known import DOCUMENT, MISTAKES, changed, oscillator, to_toml

TICK = 5e-3
"""Time that a look at the clock takes, s, where a budget shall end at the same work everywhere."""

# Answers ----------------------------------------------------------------------------------

COORDINATE = {
    "displacement_mean", "displacement_std", "displacement_mean_square", "velocity_std",
    "velocity_mean_square", "acceleration_std",
}  # fmt: skip
PAIR = {
    "collision_rate", "collision_rate_lower", "collision_rate_upper", "impact_speed_mean",
    "impact_speed_rate", "impact_speed_square_rate", "peak_force",
}  # fmt: skip
COST = {"wall_time", "compile_time", "steps", "impacts", "paths", "threads", "tenfold_wall_time"}
ANSWERS = [
    (("exact", ELASTIC), "exact"),
    (("fokker-planck", LOSSY), "fokker-planck"),
    (("linearise", LOSSY), "linearise:closure"),
    (("average", LOSSY), "average:finite jumps"),
    (("average", LOSSY, "--variant", "continuous"), "average:continuous"),
    (("linearise", ISOLATOR, "--form", "motion", "--variant", "book"), "linearise:motion:book"),
    (("linearise", LOSSY, "--form", "force"), "linearise:force"),
    (("simulate", LOSSY, *QUICK), "simulate"),
    (("simulate", ISOLATOR, "--paths", "4", "--duration", "2", "--seed", "7"), "simulate"),
]


@pytest.mark.parametrize(
    ("arguments", "method"), ANSWERS, ids=[f"{method} {words[2:]}" for words, method in ANSWERS]
)
def test_the_json_on_stdout_is_one_document_with_the_keys_of_the_contract(
    stochvi: Run, arguments, method
):
    code, out, err = stochvi(*arguments, "--json", "-")
    assert code == 0
    assert method.split(":")[0] in err
    document = one_document(out)
    assert document["method"] == method
    assert set(document) >= {"effects", "assumptions", "warnings"}
    assert set(document["coordinates"]) == {"x"}
    assert set(document["impact_pairs"]) == {"stops"}
    pair = dict(document["impact_pairs"]["stops"])
    assert pair.pop("speed_threshold") >= 0.0
    for keys, quantities in [(COORDINATE, document["coordinates"]["x"]), (PAIR, pair)]:
        assert set(quantities) >= keys
        for estimate in quantities.values():
            assert estimate is None or {"value", "standard_error", "bias", "how"} <= set(estimate)
    assert set(document["cost"]) == COST
    assert {"version", "seed", "scene"} <= set(document["provenance"])
    assert document["provenance"]["scene"] == load_scene(arguments[1]).document()


def test_the_digits_of_the_json_are_those_of_python(stochvi: Run):
    document = one_document(stochvi("exact", ELASTIC, "--json", "-", "--quiet").out)
    expected = exact(oscillator(-1.0, 1.0))
    for (of, name), estimate in expected.estimates().items():
        group = document["coordinates" if of == "x" else "impact_pairs"]
        assert group[of][name] == estimate.to_dict()


@pytest.mark.parametrize("command", ["exact", "linearise", "simulate", "check"])
def test_quiet_is_silent(stochvi: Run, command):
    options = QUICK if command in ("simulate", "check") else ()
    assert stochvi(command, ELASTIC, "--quiet", *options) == Finished(0, "", "")


def test_the_table_goes_to_stdout_without_json(stochvi: Run):
    code, out, err = stochvi("exact", ELASTIC)
    assert (code, err) == (0, "")
    assert "impacts, all stops" in out
    assert "0.2828002" in out


def test_the_help_of_an_accuracy_names_the_error_and_that_of_a_condition_reads_on():
    helps = [
        (option.name, option.help or "")
        for command in main.commands.values()
        for option in command.params
        if isinstance(option, click.Option)
    ]
    errors = [words for name, words in helps if name == "rel_error"]
    assert len(errors) > 5
    assert all("elative standard error" in words for words in errors)
    conditions = [words for _, words in helps if words.startswith("With --")]
    assert conditions
    assert all(words.partition(": ")[2][0].islower() for words in conditions)


def test_tables_of_eighty_columns_cut_nothing_short(stochvi: Run, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    tick(monkeypatch, TICK)
    cost = ["cost", ISOLATOR, "--budget", "0.5"]
    for command in (["profiles"], ["check", ELASTIC, "--rel-error", "0.02"], cost):
        code, out, _ = stochvi(*command)
        assert code == 0
        assert "\N{HORIZONTAL ELLIPSIS}" not in out
        assert max(map(len, out.splitlines())) <= 80


def test_the_cost_of_accuracy_is_a_table_a_document_and_a_picture(
    stochvi: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tick(monkeypatch, TICK)
    code, out, err = stochvi("cost", LOSSY, "--budget", "0.5", "--json", "-", "--out", tmp_path)
    assert code == 0
    document = one_document(out)
    assert document["method"] == "cost"
    assert document["summary"] in " ".join(err.split())
    assert len(document["steps"]) == 3
    table = pd.read_csv(tmp_path / "cost.csv")
    assert len(table) == len(document["errors"]) + len(document["models"])
    assert (tmp_path / "cost.png").stat().st_size > 10_000
    assert stochvi("cost", LOSSY, "--budget", "0.3", "--quiet") == Finished(0, "", "")
    code, _, err = stochvi("cost", LOSSY, "--budget", "0")
    assert (code, "budget must be" in err) == (2, True)


def test_pairs_that_nothing_shakes_are_named(stochvi: Run, tmp_path: Path):
    two = {
        "structure": {
            "kind": "matrices", "coordinates": ["a", "b"], "mass": [[1.0, 0.0], [0.0, 1.0]],
            "damping": [[0.1, 0.0], [0.0, 0.1]], "stiffness": [[1.0, 0.0], [0.0, 1.0]],
        },
        "impact_pair": [
            {"name": name, "on": on, "lower": -1.0, "upper": 1.0,
             "law": {"kind": "restitution", "coefficient": 0.5}}
            for name, on in (("shaken", "a"), ("quiet", "b"))
        ],
        "excitation": [{"kind": "white", "on": "a", "intensity": 0.1}],
    }  # fmt: skip
    (tmp_path / "two.toml").write_text(to_toml(two), "utf-8")
    told = "nothing shakes pair quiet; remove it, or add an excitation with another axis"
    phases = [{"name": "road", "duration": 60.0}, {"name": "rough", "duration": 60.0}]
    (tmp_path / "phases.toml").write_text(to_toml(two | {"phase": phases}), "utf-8")
    size = ("--probability", "1%", "--quiet")
    assert told in refused(stochvi("clearance", tmp_path / "two.toml", "--quiet"))
    assert told in refused(stochvi("size", tmp_path / "two.toml", *size))
    assert told in refused(stochvi("size", tmp_path / "phases.toml", *size))
    by_damage = ("size", tmp_path / "two.toml", "--damage-ratio", "2", "--at", "b", "--quiet")
    assert told in refused(stochvi(*by_damage))
    two["impact_pair"].append(two["impact_pair"][1] | {"name": "calm"})
    (tmp_path / "two.toml").write_text(to_toml(two), "utf-8")
    assert "nothing shakes these pairs: quiet, calm; remove them, or" in refused(
        stochvi("size", tmp_path / "two.toml", *size)
    )


def test_an_isolator_is_screened_and_its_clearance_answered(stochvi: Run, tmp_path: Path):
    truck = shipped_scene("isolator-truck")
    code, out, _ = stochvi("screen", truck, "-v", "--json", tmp_path / "screen.json")
    assert code == 0
    assert "3 sigma clearance" in out
    linear = json.loads((tmp_path / "screen.json").read_text("utf-8"))
    assert linear["displacement_std"] == pytest.approx(1.99e-3, abs=5e-6)
    run = stochvi(
        "clearance", truck, "--gaps", "1,2", "--rel-error", "0.05", "--out", tmp_path, "--quiet"
    )
    assert run == Finished(0, "", "")
    curve = pd.read_csv(tmp_path / "clearance.csv")
    assert list(curve["clearance_in_sigma"]) == pytest.approx([1.0, 2.0])
    assert (curve["simulated_low"] < curve["simulated"]).all()
    assert (tmp_path / "clearance.png").stat().st_size > 10_000
    run = stochvi("clearance", truck, "--gaps", "1,2", "--rel-error", "0.05", "--json", "-")
    document = one_document(run.out)
    assert document["displacement_std"] == linear["displacement_std"]
    assert document["record"] is None and document["notes"] == linear["notes"]
    assert [row["simulated"] for row in document["curve"]] == pytest.approx(curve["simulated"])
    rare = stochvi("clearance", truck, "--gaps", "7", "--rel-error", "0.3", "--json", "-")
    assert rare.code == 1 and "upper limits alone are known of 1 " in rare.err
    assert any("hardly any impact was seen" in note for note in one_document(rare.out)["notes"])
    code, _, err = stochvi("clearance", truck, "--gaps", "1,x")
    assert (code, "--gaps must be a number" in err) == (2, True)


def test_explain_tells_what_is_simulated_and_what_not(stochvi: Run):
    code, out, err = stochvi("explain", ELASTIC, "--json", "-")
    document = one_document(out)
    assert code == 0
    assert document["effects"] == ["white noise on x", "rigid stop lower", "rigid stop upper"]
    assert document["absent"] == [
        "filtered noise", "tabulated noise", "sine", "constant load", "modulation", "pulses"
    ]  # fmt: skip
    assert document["simulation"]["steps_per_path"] > 2
    assert "not simulated: filtered noise; tabulated noise; sine; constant load" in err


def test_json_and_tables_go_to_the_files_that_are_named(stochvi: Run, tmp_path: Path):
    answer, folder = tmp_path / "new" / "answer.json", tmp_path / "out"
    run = stochvi("exact", ELASTIC, "--quiet", "--json", answer, "--out", folder)
    assert run == Finished(0, "", "")
    assert one_document(answer.read_text("utf-8"))["method"] == "exact"
    assert (folder / "response.json").read_text("utf-8") == answer.read_text("utf-8")
    table = pd.read_csv(folder / "response.csv").set_index("quantity")
    assert table.loc["displacement_std", "value"] == pytest.approx(0.539560093754897, rel=1e-14)


def test_simulate_draws_a_picture_beside_its_tables(stochvi: Run, tmp_path: Path):
    assert stochvi("simulate", ELASTIC, *QUICK, "--quiet", "--out", tmp_path).code == 0
    assert {path.name for path in tmp_path.iterdir()} == {
        "overview.png", "response.csv", "response.json",
    }  # fmt: skip


def test_the_same_seed_gives_the_same_digits_and_another_one_others(stochvi: Run):
    def numbers(seed: str) -> dict:
        size = ("--paths", "8", "--duration", "20", "--seed", seed)
        document = one_document(stochvi("simulate", LOSSY, *size, "--json", "-", "--quiet").out)
        assert document["provenance"]["seed"] == int(seed)
        return document["coordinates"]

    assert numbers("3") == numbers("3") != numbers("4")


def test_check_compares_the_methods(stochvi: Run, tmp_path: Path):
    code, out, err = stochvi("check", ELASTIC, *QUICK, "--json", "-", "--out", tmp_path)
    document = one_document(out)
    assert (code, document["method"], document["passed"]) == (0, "check", True)
    assert "agree" in err
    verdicts = {row["verdict"] for row in document["comparisons"]}
    assert verdicts == {"agrees", "approximate"}
    assert len(pd.read_csv(tmp_path / "check.csv")) == len(document["comparisons"])


def test_check_exits_with_1_if_a_method_is_wrong(stochvi: Run, monkeypatch):
    wrong = exact(oscillator(-1.1, 1.1))
    monkeypatch.setattr("stochvi.verification.check.exact", lambda scene: wrong)
    code, out, err = stochvi("check", ELASTIC, *QUICK, "--json", "-")
    assert (code, one_document(out)["passed"]) == (1, False)
    assert err.splitlines()[-1].startswith("stochvi: check failed: 15 of 32")


def test_simulate_exits_with_1_beyond_its_budget_and_still_writes_what_it_has(
    stochvi: Run, tmp_path: Path
):
    file = tmp_path / "answer.json"
    options = ("--rel-error", "1e-5", "--budget", "0.05", "--threads", "2", "--quiet")
    code, out, err = stochvi("simulate", ELASTIC, *options, "--json", file)
    assert (code, out) == (1, "")
    assert err.startswith("stochvi: the budget of 0.05 s ended at a relative standard error of ")
    assert len(err.splitlines()) == 1
    document = one_document(file.read_text("utf-8"))
    assert document["coordinates"]["x"]["displacement_mean_square"]["standard_error"] > 0.0
    assert document["cost"]["paths"] > 0


def test_profiles_lists_what_ships(stochvi: Run):
    code, out, err = stochvi("profiles")
    assert (code, err) == (0, "")
    assert "mil-std-810h-truck-vertical-5hz" in out and "1.078" in out


# Input that is refused --------------------------------------------------------------------


@pytest.mark.parametrize("mistake", MISTAKES.values(), ids=MISTAKES.keys())
def test_a_mistake_in_a_scene_file_is_one_sentence(stochvi: Run, tmp_path, monkeypatch, mistake):
    monkeypatch.chdir(tmp_path)
    Path("scene.toml").write_text(to_toml(mistake.document), encoding="utf-8")
    sentence = refused(stochvi("exact", "scene.toml", "--json", "-"))
    for words in (mistake.key, mistake.got, mistake.expected):
        assert words in sentence


@pytest.mark.parametrize("command", ["exact", "linearise", "simulate", "check"])
@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("nowhere.toml", "nowhere.toml cannot be read: no such file or directory"),
        ("folder", "folder cannot be read: expected a text file, got a folder"),
        ("binary.toml", "binary.toml is not text: expected UTF-8, got binary data"),
        ("invalid.toml", "invalid.toml is not valid TOML: "),
        ("large.toml", "large.toml holds 10000001 bytes, expected a text of at most 10000000"),
    ],
)
def test_a_file_that_is_no_scene_is_one_sentence_in_every_command(
    stochvi: Run, tmp_path, monkeypatch, command, name, words
):
    monkeypatch.chdir(tmp_path)
    Path("folder").mkdir()
    Path("binary.toml").write_bytes(b"\xff\xfe\x00")
    Path("invalid.toml").write_text("[structure", encoding="utf-8")
    Path("large.toml").write_bytes(b"#" * 10_000_001)
    assert refused(stochvi(command, name)).startswith(words)


def test_two_mistakes_are_two_sentences(stochvi: Run, tmp_path: Path):
    document = changed(["structure", "mass"], -1.0) | {"colour": "red"}
    (tmp_path / "scene.toml").write_text(to_toml(document), encoding="utf-8")
    run = stochvi("exact", tmp_path / "scene.toml")
    assert (run.code, run.out) == (2, "")
    first, second = run.err.splitlines()
    assert first == "stochvi: structure.mass must be greater than 0, got -1.0"
    assert second.startswith("stochvi: colour is not a known key; did you mean ")


def test_exact_names_the_restitution_that_it_does_not_cover(stochvi: Run):
    sentence = refused(stochvi("exact", LOSSY))
    assert "restitution must be 1 (an elastic stop), got 0.8 at the lower stop" in sentence
    assert "restitution must be 1 (an elastic stop), got 0.8 at the upper stop" in sentence


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (("--rel-error", "nan"), "--rel-error must be in [1e-6, 1), got nan"),
        (("--rel-error", "0"), "--rel-error must be in [1e-6, 1), got 0"),
        (("--rel-error", "inf"), "--rel-error must be in [1e-6, 1), got inf"),
        (("--paths", "1"), "paths must be at least 2 for a standard error, got 1"),
        (("--paths", "8", "--rel-error", "0.1"), "give --rel-error or --paths, not both"),
        (("--duration", "0"), "duration must be a positive number of seconds, got 0.0"),
        (
            ("--duration", "nan"),
            "--duration must be a number with a unit of time (s, ms, min, h; 1h 5min; 1:30:00), "
            "got 'nan'",
        ),
        (("--seed", "-1"), "seed must be in [0, 2^63), got -1"),
        (("--seed", str(2**63)), f"seed must be a whole number below 2^63, got {2**63}"),
        (("--threads", "0"), "threads must be at least 1, got 0"),
        (("--budget", "-5"), "budget must be a positive number of seconds, got -5.0"),
        (
            ("--speed-threshold", "nan"),
            "--speed-threshold must be a number with a unit of speed (m/s, mm/s), got 'nan'",
        ),
    ],
    ids=" ".join,
)
def test_an_option_of_simulate_out_of_range_is_one_sentence(stochvi: Run, arguments, sentence):
    assert refused(stochvi("simulate", ELASTIC, *arguments)) == sentence


@pytest.mark.parametrize(
    "command",
    [
        ("size", "--probability", "0.01"),
        ("clearance",),
        ("absorber",),
        ("reliability",),
        ("impacts",),
    ],
    ids=lambda words: words[0],
)
def test_no_command_takes_a_budget_of_nothing(stochvi: Run, command: tuple[str, ...]):
    name, *more = command
    mission = ("--mission", "60") if name == "reliability" else ()
    truck = shipped_scene("isolator-truck")
    sentence = refused(stochvi(name, truck, *more, *mission, "--budget", "0"))
    assert sentence == "budget must be a positive number of seconds, got 0.0"


@pytest.mark.parametrize(
    "arguments", [("--rel-error", "nan"), ("--seed", "-1"), ("--threads", "0"), ("--budget", "0")]
)
def test_an_option_of_check_out_of_range_is_one_sentence(stochvi: Run, arguments):
    option, value = arguments
    sentence = refused(stochvi("check", ELASTIC, *arguments))
    assert f"--{sentence.removeprefix('--')}".startswith(f"{option} must be ")
    assert f", got {float(value):g}" in sentence or f", got {float(value)}" in sentence


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (
            ["size", "--common", "one", "--common", "two", "--common=three"],
            "--common must be given once, got it 3 times; "
            "join its values by commas, as --common A,B",
        ),
        (
            ["simulate", "--seed", "1", "--quiet", "--seed=1", "--quiet"],
            "--seed must be given once, got it 2 times; keep one",
        ),
    ],
)
def test_an_option_that_is_given_twice_is_refused(
    stochvi: Run, arguments: list[str], sentence: str
):
    """Flags and options of many values may be: a start of each coordinate of `bifurcation`."""
    command, *options = arguments
    assert refused(stochvi(command, ELASTIC, *options)) == sentence
    starts = ("--start", "x=1", "--start", "velocity.x=1")
    left = refused(stochvi("bifurcation", ELASTIC, *starts, "--quiet", "--quiet"))
    assert left.startswith("--from and --to, or --vary, must say what is varied")


def test_the_closure_has_no_variant_of_the_book(stochvi: Run):
    sentence = refused(stochvi("linearise", LOSSY, "--form", "closure", "--variant", "book"))
    assert sentence.startswith("variant must be 'consistent' or 'box' for form 'closure'")
    assert sentence.endswith("'book' is of the forms 'motion' and 'force'")


@pytest.mark.parametrize(
    ("option", "target", "words"),
    [
        ("--json", "folder", "--json must name a file, but folder is a folder"),
        (
            "--json",
            "file/answer.json",
            "--json file/answer.json: file is a file, expected a folder",
        ),
        ("--out", "file", "--out must name a folder, but file is a file; name another folder"),
    ],
)
def test_a_place_that_cannot_be_written_to_is_one_sentence(
    stochvi: Run, tmp_path, monkeypatch, option, target, words
):
    monkeypatch.chdir(tmp_path)
    Path("folder").mkdir()
    Path("file").touch()
    assert refused(stochvi("exact", ELASTIC, "--quiet", option, target)) == words


@pytest.mark.parametrize(
    "arguments",
    [
        ("exact",),
        ("exakt", ELASTIC),
        ("exact", ELASTIC, "--jason", "-"),
        ("simulate", ELASTIC, "--paths", "many"),
        ("linearise", ELASTIC, "--form", "guess"),
    ],
    ids=lambda value: " ".join(value[:1] + value[2:]),
)
def test_a_command_line_that_is_not_understood_exits_with_2_and_says_how_to_use_it(
    stochvi: Run, arguments
):
    run = stochvi(*arguments)
    assert run.code == 2
    assert "Usage: stochvi" in run.err
    assert run.out == ""


# New scenes -------------------------------------------------------------------------------


def test_new_writes_a_scene_that_is_valid(stochvi: Run, tmp_path: Path):
    file = tmp_path / "deep" / "scene.toml"
    code, out, err = stochvi("new", file)
    assert (code, out) == (0, "")
    assert f"stochvi explain {file}" in err
    assert load_scene(file).effects() == (
        "tabulated noise on base", "rigid stop lower", "rigid stop upper",
    )  # fmt: skip


NUMBERS = ("--mass", "35kg", "--mounts", "6", "--stiffness", "35N/mm", "--zeta", "0.12")


@pytest.mark.parametrize(("kind", "answers"), [
    ("mission", 2), ("wire-rope", 1), ("box", 1),
])  # fmt: skip
def test_new_writes_a_scene_of_the_numbers_of_a_user(stochvi: Run, tmp_path: Path, kind, answers):
    file = tmp_path / "scene.toml"
    more = ("--size", "400mm,300mm,200mm") if kind == "box" else ()
    code, _, err = stochvi("new", file, "--kind", kind, *NUMBERS, *more)
    assert (code, "note" in err) == (0, False)
    scene = load_scene(file)
    assert len(scene.phases or [scene]) == answers
    mass, _, stiffness = scene.structure.matrices
    held = 6 * 35e3 * (0.25 if kind == "wire-rope" else 1.0)
    assert (mass[0, 0], stiffness[0, 0]) == pytest.approx((35.0, held))
    if kind == "wire-rope":
        (rope,) = scene.structure.functions
        assert rope.count * rope.law.largest_force == pytest.approx(6 * 35e3 * 0.75 * 5e-4)
    if kind == "box":
        assert np.diag(mass)[3:] == pytest.approx([0.3791667, 0.5833333, 0.7291667], rel=1e-3)
        assert scene.structure.mounts[0].at == (-0.2, -0.15, -0.1)
        directions = [pair.direction for pair in scene.impact_pairs]
        assert sorted(directions) == [(0, 0, 1), (0, 1, 0), (1, 0, 0)]
        for pair in screen(scene).impact_pairs.values():
            assert pair.stops["upper"] == pytest.approx(pair.three_sigma, rel=0.05)
    code, out, _ = stochvi("explain", file, "--budget", "1")
    assert code == 0 and "rms motions" not in out


def test_new_says_which_numbers_it_took_and_refuses_others(stochvi: Run, tmp_path: Path):
    file = tmp_path / "scene.toml"
    code, _, err = stochvi("new", file, "--kind", "mission", "--stiffness", "35")
    assert code == 0 and "note: --mass 12 kg was taken for the mass of the equipment" in err
    assert "35 N/mm are 35000 N/m" in err
    for arguments, words in (
        (("--mass", "3kg"), "--mass is for --kind mission, wire-rope, box; got --kind any"),
        (("--kind", "box", "--mounts", "5"), "an even number from 4 on, got 5"),
        (("--kind", "box", "--size", "1m"), "--size must be length, width and height"),
        (("--kind", "mission", "--mass", "3bar"), "--mass must be a number, plain or with a unit"),
        (("--kind", "mission", "--mounts", "1.5"), "--mounts must be a whole number"),
    ):
        told = stochvi("new", tmp_path / "other.toml", *arguments)
        assert told.code == 2 and words in told.err.splitlines()[-1], arguments


@pytest.mark.skipif(os.name == "nt", reason="needs a terminal of its own")
def test_new_asks_for_what_is_missing_in_a_terminal(tmp_path: Path):
    terminal, end = os.openpty()
    os.write(terminal, b"35 kg\n\n35 N/mm\n0.12\n")
    file = tmp_path / "scene.toml"
    done = subprocess.run(
        [sys.executable, "-m", "stochvi", "new", str(file), "--kind", "mission"],
        stdin=end, capture_output=True, text=True, check=True, timeout=60,
    )  # fmt: skip
    os.close(terminal)
    os.close(end)
    assert "Number of mounts [4]:" in done.stderr
    structure = load_scene(file).structure
    assert (structure.mass, structure.mounts, structure.stiffness) == (35.0, 4, 35e3)


def test_a_slipped_unit_is_told_before_anything_is_simulated(stochvi: Run, tmp_path: Path):
    file = tmp_path / "slipped.toml"
    stochvi("new", file, "--kind", "mission", *NUMBERS)
    file.write_text(file.read_text().replace("stiffness = 35000", "stiffness = 35"))
    told = stochvi("size", file, "--probability", "1%", "--rel-error", "0.4")
    note = "the natural frequency 0.39 Hz lies outside those of mounts of equipment"
    assert note in told.err.splitlines()[0]
    told = stochvi("screen", f"{file}#highway")
    assert told.err.count(note) == 1 and "of mounts of equipment" not in told.out.replace("\n", " ")
    document = one_document(stochvi("screen", f"{file}#highway", "--json", "-").out)
    assert any(note in each for each in document["notes"])
    assert "note" not in stochvi("screen", ISOLATOR).err


def test_new_refuses_to_overwrite(stochvi: Run, tmp_path: Path):
    file = tmp_path / "scene.toml"
    file.write_text("mine", encoding="utf-8")
    assert refused(stochvi("new", file)) == f"{file} exists already; choose another name"
    assert file.read_text("utf-8") == "mine"


@pytest.mark.parametrize(
    ("kind", "tables"),
    [
        ("bumper", {"bumper.csv"}),
        ("road", set()),
        ("record", {"truck-bed.csv"}),
        ("rigid-body", set()),
    ],
)
def test_new_writes_an_isolator_of_a_kind_with_its_tables(tmp_path, stochvi, kind, tables):
    file = tmp_path / "desk" / "mine.toml"
    code, _, err = stochvi("new", file, "--kind", kind)
    assert code == 0
    assert {path.name for path in file.parent.iterdir()} == {"mine.toml"} | tables
    assert all(name in err for name in {"mine.toml"} | tables)
    assert model_of(load_scene(file)).tables
    if tables:
        file.unlink()
        assert "exists already" in refused(stochvi("new", file, "--kind", kind))


@pytest.mark.verify
@pytest.mark.usefixtures("short_review", "blank_pictures")
def test_size_writes_a_report_of_a_record(tmp_path, stochvi):
    file = tmp_path / "mine.toml"
    stochvi("new", file, "--kind", "record")
    options = ("--probability", "0.1", "--mission", "600", "--rel-error", "0.2", "--quiet")
    assert stochvi("size", file, *options, "--out", tmp_path / "out").code == 0
    page = (tmp_path / "out" / "report.html").read_text("utf-8")
    assert "Kurtosis of the record" in page and "length adds a standard error" in page


# The installed command --------------------------------------------------------------------


def python(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, *arguments], capture_output=True, text=True, timeout=600, check=False
    )


HEAVY = {"numpy", "scipy", "numba", "pandas", "matplotlib", "pydantic", "rich"}


@pytest.mark.parametrize("program", ["stochvi --help", "stochvi simulate --help", "import stochvi"])
def test_nothing_heavy_is_imported_before_it_is_needed(program: str):
    start = "import stochvi, sys"
    if program.startswith("stochvi"):
        words = program.split()[1:]
        start = f"import sys; from stochvi.cli import main; main({words}, standalone_mode=False)"
    done = python("-c", f"{start}; print(sorted({HEAVY} & set(sys.modules)), file=sys.stderr)")
    assert (done.returncode, done.stderr) == (0, "[]\n")


MOST_LINES = 20
"""Largest number of lines that the help of the program gives to commands."""


def in_help(text: str) -> list[str]:
    """The commands that the help of the program names at the left, in its order."""
    lines = [line[2:].split("  ")[0] for line in text.splitlines() if line.startswith("  ")]
    return [name for line in lines for name in line.strip().split(", ") if name in main.commands]


def test_the_help_names_each_command_in_few_lines(stochvi: Run, monkeypatch: pytest.MonkeyPatch):
    after_sine = set(program.UNDER_SINE) - set(program.RENAMED)
    assert {*in_help(stochvi("--help").out)} | after_sine == {*main.commands}
    assert sum(map(len, program.HELP.values())) <= MOST_LINES
    monkeypatch.setitem(main.commands, "unnamed", main.commands["size"])
    assert "unnamed" not in in_help(stochvi("--help").out)


def test_motions_under_a_sine_are_also_asked_after_sine(
    stochvi: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.chdir(tmp_path)
    for name in program.UNDER_SINE:
        assert stochvi("sine", name, "--help") == stochvi(name, "--help")
    shutil.copy(shipped_scene("isolator-sine"), "basins")
    asked = ("--from", "60", "--to", "120", "--points", "3")
    assert stochvi("sine", "./basins", *asked).code == 0
    assert stochvi("sine", "basins", *asked).code == 2


@pytest.mark.parametrize(("old", "name"), program.RENAMED.items())
def test_a_command_is_found_by_its_earlier_name_with_a_note_on_stderr_alone(
    stochvi: Run, old: str, name: str
):
    asked = ("--help",)
    code, out, err = stochvi(old, *asked)
    assert (code, out) == stochvi(name, *asked)[:2]
    assert err == f"note: {old} is called {name} now; the next version drops it\n"
    assert stochvi(name, *asked)[2] == ""
    assert old not in main.commands and old not in in_help(stochvi("--help").out)


def test_python_m_stochvi_is_the_command():
    done = python("-m", "stochvi", "exact", ELASTIC, "--json", "-")
    assert done.returncode == 0
    assert one_document(done.stdout)["method"] == "exact"
    assert "exact" in done.stderr and "Traceback" not in done.stderr


def test_python_without_docstrings_is_refused_in_a_sentence():
    done = python("-OO", "-m", "stochvi", "--help")
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == "stochvi: commands need their docstrings; start Python without -OO\n"


def test_a_mistake_in_a_scene_file_ends_the_process_without_a_traceback(tmp_path: Path):
    scene = tmp_path / "scene.toml"
    scene.write_text(to_toml(DOCUMENT).replace("0.2", "-0.2"), encoding="utf-8")
    done = python("-m", "stochvi", "check", str(scene))
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == "stochvi: excitation.0.intensity must be greater than 0, got -0.2\n"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("command", "scene"),
    [
        ("exact", "oscillator-elastic"),
        ("fokker-planck", "oscillator-lossy"),
        ("average", "oscillator-lossy"),
    ],
)
def test_solutions_draw_their_density(
    stochvi: Run, command: str, scene: str, tmp_path: Path
) -> None:
    assert stochvi(command, shipped_scene(scene), "--out", tmp_path).code == 0
    assert (tmp_path / "density.png").stat().st_size > 10_000


def test_tables_are_whole_on_a_narrow_page(
    stochvi: Run, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """No digit and no heading is cut: a cropped number looks like another number."""
    arguments = ("clearance", ISOLATOR, "--gaps", "2", *QUICK)
    monkeypatch.setenv("COLUMNS", "300")
    wide = stochvi(*arguments).out
    monkeypatch.setenv("COLUMNS", "80")
    narrow = stochvi(*arguments).out
    assert narrow.split() == wide.split()


def test_an_absorber_scene_to_start_from(stochvi: Run, tmp_path: Path) -> None:
    file = tmp_path / "tower.toml"
    assert stochvi("new", file, "--kind", "absorber").code == 0
    assert load_scene(file).absorber is not None


def test_linearise_says_why_it_knows_no_bound(stochvi: Run) -> None:
    told = stochvi("linearise", ISOLATOR).out
    assert "no error bound: the atlas knows white noise alone" in told
    assert "no error bound" not in stochvi("linearise", LOSSY).out


@pytest.mark.parametrize("command", ["spectrum", "impacts"])
def test_what_is_simulated_is_printed_with_its_assumptions(stochvi: Run, command: str) -> None:
    told = stochvi(command, ISOLATOR, "--paths", "64", "--threads", "1")
    assert "assumptions: displacements are measured from" in told.out
    assert "J/kg" in told.out or command == "spectrum"


def test_a_part_that_stands_there_twice_is_a_list(stochvi: Run, tmp_path: Path) -> None:
    file = tmp_path / "scene.toml"
    file.write_text("[absorber]\nmass = 1.0\n[absorber]\nmass = 2.0\n")
    assert "for several, write each as [[absorber]]" in refused(stochvi("explain", file))


PHASES = {
    "structure": {"kind": "isolator", "mass": 2.0, "frequency_hz": 12.0, "zeta": 0.1},
    "impact_pair": [{"clearance": 0.004, "law": {"kind": "restitution", "coefficient": 0.5}}],
    "excitation": [{"kind": "record", "file": "record.csv", "unit": "g"}],
    "phase": [
        {"name": "road", "duration": 60.0},
        {"name": "rough road", "duration": 20.0, "level_db": 2.0},
    ],
}


SLOW = pytest.mark.slow


@pytest.fixture
def in_phases(tmp_path: Path) -> Path:
    """A scene with phases, all of them by one record."""
    t = np.arange(4000) / 400.0
    noise = np.random.default_rng(2).normal(size=t.size)
    np.savetxt(tmp_path / "record.csv", np.column_stack([t, noise]), delimiter=",")
    (tmp_path / "mission.toml").write_text(to_toml(PHASES), "utf-8")
    return tmp_path / "mission.toml"


@pytest.mark.usefixtures("blank_pictures")
@pytest.mark.parametrize(
    ("command", "more"),
    [
        ("explain", ()), ("screen", ()), ("replay", ()),
        pytest.param("reliability", ("--rel-error", "0.5", "--budget", "5"), marks=SLOW),
        pytest.param(
            "size", ("--probability", "5%", "--rel-error", "0.3", "--budget", "5"), marks=SLOW
        ),
    ],
)  # fmt: skip
def test_one_phase_of_a_file_gets_its_files_and_page(
    command: str, more: tuple[str, ...], in_phases: Path, tmp_path: Path, stochvi: Run
) -> None:
    """The report lists the file of the scene, and another phase is another question."""
    out = ("--out", tmp_path / "out", "--quiet")
    done = stochvi(command, f"{in_phases}#rough road", *more, *out)
    assert done.code in (0, 1) and "cannot be read" not in done.err
    assert list((tmp_path / "out").iterdir())
    page = tmp_path / "out" / "report.html"
    assert page.is_file() == (command in ("replay", "reliability", "size"))
    if page.is_file():
        text = page.read_text("utf-8")
        for file in ("mission.toml", "record.csv"):
            digest = hashlib.sha256((tmp_path / file).read_bytes()).hexdigest()
            assert digest in text, file
        assert "level_db = 2.0" in text
        other = stochvi(command, f"{in_phases}#road", *more, *out)
        assert "is the report of another scene or question" in refused(other)
    # nor is the file of the scene replaced by an answer
    over = stochvi(command, f"{in_phases}#road", *more, "--json", in_phases)
    assert "which this command reads" in refused(over)


def test_a_mission_is_explained_phase_by_phase(
    in_phases: Path, tmp_path: Path, stochvi: Run
) -> None:
    """As each of its phases is alone."""
    asked = ("--json", "-", "--budget", "1")
    whole = one_document(stochvi("explain", in_phases, *asked, "--out", tmp_path / "out").out)
    assert list(whole["phases"]) == ["road", "rough road"]
    for name, phase in whole["phases"].items():
        alone = one_document(stochvi("explain", f"{in_phases}#{name}", *asked).out)
        for key in ("effects", "methods", "natural_frequency_hz"):
            assert phase[key] == alone[key]
    told = stochvi("explain", in_phases, "--budget", "1").out
    assert "phase road\n" in told and "phase rough road\n" in told
    table = pd.read_csv(tmp_path / "out" / "methods.csv")
    assert set(table["phase"]) == set(whole["phases"])
    assert (tmp_path / "out" / "scene.svg").is_file()


# ------------------------------------------------------------------------------
# Nothing escapes and nothing is lost: names of users, targets of answers, readers that go away.
# ------------------------------------------------------------------------------


SCENE = """
title = 'TITLE'
[structure]
kind = "oscillator"
mass = 1.0
damping = 0.1
stiffness = 1.0
[[impact_pair]]
name = 'NAME'
lower = -1.0
upper = 1.0
law = { kind = "restitution", coefficient = 1.0 }
[[excitation]]
EXCITATION
"""
WHITE = 'kind = "white"\nintensity = 0.2'
TABLE = 'kind = "psd"\nfile = "spectrum.csv"\nunit = "N2/Hz"'
NASTY = ["../../escape", r"[/red] $\frac{$ :smile: <b>" + "a" * 300]
VARY = ("--vary", "structure.stiffness=1,2", "--method", "exact")


def scene_in(folder: Path, title: str = "", name: str = "stops", excitation: str = WHITE) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    text = SCENE.replace("TITLE", title).replace("NAME", name).replace("EXCITATION", excitation)
    (folder / "scene.toml").write_text(text, encoding="utf-8")
    (folder / "spectrum.csv").write_text("0.01,1\n10,1\n", encoding="utf-8")
    return folder / "scene.toml"


def files_below(folder: Path) -> set[Path]:
    return {path.relative_to(folder) for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize("name", NASTY)
def test_files_of_a_sweep_stay_in_its_folder_whatever_a_pair_is_called(
    stochvi: Run, tmp_path: Path, monkeypatch, name: str
):
    scene = scene_in(tmp_path / "a" / "b", title=name, name=name)
    before = files_below(tmp_path)
    out = tmp_path / "a" / "b" / "o1" / "o2"
    with monkeypatch.context() as change:
        change.setattr("stochvi.views.datasets.changes", lambda _, name: name.endswith("rate"))
        code, text, errors = stochvi("sweep", scene, *VARY, "--out", out)
    assert (code, errors) == (0, "")
    assert "impacts" in text
    written = files_below(tmp_path) - before
    assert all(path.is_relative_to(out.relative_to(tmp_path)) for path in written)
    assert sum(path.suffix == ".png" for path in written) > 0


@pytest.mark.slow
@pytest.mark.parametrize("name", NASTY)
def test_a_response_is_shown_and_drawn_whatever_its_names_are(
    stochvi: Run, tmp_path: Path, name: str
):
    scene = scene_in(tmp_path, title=name, name=name)
    code, text, errors = stochvi("exact", scene, "--out", tmp_path / "out")
    assert (code, errors) == (0, "")
    assert name in text
    names = {path.name for path in files_below(tmp_path / "out")}
    assert names == {"density.png", "response.csv", "response.json"}


def test_control_characters_do_nothing_to_a_terminal(stochvi: Run, tmp_path: Path):
    scene = scene_in(tmp_path)
    scene.write_text(scene.read_text("utf-8").replace("'stops'", '"a\\u001b[31mb\\u009b"'), "utf-8")
    code, text, errors = stochvi("exact", scene)
    assert code == 0
    assert r"a\x1b[31mb\x9b" in text and "\x1b" not in text + errors


def test_an_answer_does_not_replace_what_its_command_reads(stochvi: Run, tmp_path: Path):
    scene = scene_in(tmp_path, excitation=TABLE)
    table = tmp_path / "spectrum.csv"
    before = scene.read_bytes(), table.read_bytes()
    os.link(scene, tmp_path / "other name")
    (tmp_path / "response.csv").hardlink_to(table)
    for target in (scene, table, tmp_path / "other name"):
        assert f"would replace {tmp_path}" in refused(stochvi("linearise", scene, "--json", target))
        if target != table:
            words = refused(stochvi("simulate", scene, "--checkpoint", target))
            assert "--checkpoint" in words and "would replace" in words
    run = tmp_path / "run"
    words = refused(stochvi("simulate", scene, "--checkpoint", run, "--json", run))
    assert words == f"--json {run} and --checkpoint {run} are one file; give each its own name"
    code, text, errors = stochvi("linearise", scene, "--out", tmp_path)
    assert code == 2 and "linearise" in text  # the answer was printed before
    assert "is read by this command" in errors
    assert (scene.read_bytes(), table.read_bytes()) == before


@pytest.mark.parametrize(
    "arguments", [("--out", "file"), ("--out", "file/in"), ("--json", "."), ("--json", "file/in")]
)
def test_a_target_that_cannot_be_is_refused_before_the_work(
    stochvi: Run, tmp_path: Path, monkeypatch, arguments
):
    monkeypatch.chdir(tmp_path)
    Path("file").touch()
    # the scene is not even looked at
    assert arguments[0] in refused(stochvi("exact", "no such scene.toml", *arguments))


def test_what_many_kernels_announce_is_told_once(capsys: pytest.CaptureFixture[str]) -> None:
    """A sweep over frequencies compiled 17 of them, and said so 17 times."""
    for _ in range(2):  # the next command tells it again
        say = _each_once()
        for text in ("compiling", "compiling", "waiting", "compiling"):
            say(0.0, text)
    assert capsys.readouterr().err.split() == ["compiling", "waiting"] * 2


@pytest.mark.skipif(os.name == "nt", reason="Windows makes links for administrators alone")
@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no device that is full")
def test_a_disk_that_is_full_costs_the_file_and_not_the_answer(stochvi: Run, tmp_path: Path):
    scene = scene_in(tmp_path)
    code, text, errors = stochvi("exact", scene, "--json", "/dev/full")
    assert code == 1 and errors.startswith(
        "stochvi: /dev/full: no space left on device; the work is done"
    )
    assert text.split("cost:")[0] == stochvi("exact", scene)[1].split("cost:")[0] != ""


@pytest.mark.skipif(os.name == "nt", reason="Windows has no limit of the sizes of files")
def test_the_file_that_does_not_fit_is_named_and_not_its_source(stochvi: Run, tmp_path: Path):
    import resource

    usual = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, usual[1]))
    try:
        code, _, errors = stochvi("new", tmp_path / "box.toml", "--kind", "potholes")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, usual)
    table = tmp_path / "truck-potholes.csv"
    # the system says it in its own language
    assert code == 1 and errors.startswith(f"stochvi: {table}: ")
    assert "; the work is done, but this was not written" in errors
    assert not table.exists()


@pytest.mark.skipif(os.name == "nt", reason="Windows makes links for administrators alone")
@pytest.mark.parametrize("depth", [1, 2])
def test_a_link_to_itself_is_refused_wherever_it_is_named(
    stochvi: Run, tmp_path: Path, depth: int
) -> None:
    """Also where two links lead to each other."""
    scene, loop = scene_in(tmp_path), tmp_path / "loop.toml"
    others = [tmp_path / f"loop{n}.toml" for n in range(1, depth)]
    for link, target in zip([loop, *others], [*others, loop], strict=True):
        link.symlink_to(target)
    for words in (
        ("exact", loop), ("explain", loop), ("new", loop), ("exact", scene, "--json", loop),
        ("exact", scene, "--out", loop), ("exact", scene, "--out", loop / "below"),
        ("simulate", scene, "--checkpoint", loop, "--json", loop),
    ):  # fmt: skip
        assert "loop" in refused(stochvi(*words))
    assert loop.is_symlink()


def test_keys_that_are_nested_too_deeply_are_refused(stochvi: Run, tmp_path: Path) -> None:
    deep = tmp_path / "deep.toml"
    for text in (".".join(["a"] * 2000) + " = 1\n", ".".join(["structure"] * 2000) + " = 1\n"):
        deep.write_text(text)
        assert "nested too deeply" in refused(stochvi("screen", deep))


def test_impact_rates_need_stops(stochvi: Run, tmp_path: Path) -> None:
    scene = scene_in(tmp_path)
    before, _, after = scene.read_text("utf-8").partition("[[impact_pair]]")
    scene.write_text(before + "[[excitation]]" + after.partition("[[excitation]]")[2], "utf-8")
    assert "the scene needs an impact_pair" in refused(stochvi("clearance", scene))


@pytest.mark.parametrize("where", ["title", "number", "option"])
def test_a_message_never_quotes_a_book(stochvi: Run, tmp_path: Path, where: str) -> None:
    """Both ends are kept: what is wrong stands in front, and what to do at the end."""
    scene, long = scene_in(tmp_path), "7" * 70_000
    if where != "option":
        text = scene.read_text("utf-8")
        key = f'{long} = "x"' if where == "title" else f"mass = '{long}'"
        scene.write_text(text.replace("mass = 1.0", key), "utf-8")
    words = ("--gaps", long + "x") if where == "option" else ()
    done = stochvi("clearance", scene, *words)
    assert done.code == 2 and max(map(len, done.err.splitlines())) < 2_100
    assert done.err.startswith("stochvi: ")


def test_a_sweep_does_not_follow_a_link_in_its_folder(stochvi: Run, tmp_path: Path):
    scene, out, outside = scene_in(tmp_path), tmp_path / "out", tmp_path / "outside"
    out.mkdir()
    outside.mkdir()
    (out / "rows").symlink_to(outside)
    assert "rows is a link" in refused(stochvi("sweep", scene, *VARY, "--out", out, "--quiet"))
    assert list(outside.iterdir()) == []


@pytest.mark.parametrize("columns", ["x", "²", "-5", "0", "9" * 5000, "1000000000000", " "])
def test_any_width_of_a_terminal_is_taken(stochvi: Run, tmp_path: Path, monkeypatch, columns):
    with monkeypatch.context() as terminal:  # pytest reads it, too
        terminal.setenv("COLUMNS", columns)
        code, text, errors = stochvi("exact", scene_in(tmp_path))
    assert (code, errors) == (0, "") and "std. dev. of displ." in text


def test_a_picture_that_fails_costs_a_note(stochvi: Run, tmp_path: Path, monkeypatch):
    from stochvi.views import density

    def fail(*_: object) -> None:
        raise RuntimeError("no such letter")

    monkeypatch.setattr(density, "draw_density", fail)
    out, answer = tmp_path / "out", tmp_path / "answer.json"
    code, _, errors = stochvi("exact", scene_in(tmp_path), "--out", out, "--json", answer)
    assert code == 0
    assert errors.startswith("note: density.png could not be drawn (no such letter)")
    assert json.loads(answer.read_text("utf-8"))["method"] == "exact"
    assert {path.name for path in files_below(out)} == {"response.csv", "response.json"}


@pytest.mark.skipif(os.name == "nt", reason="a pipe of Windows ends otherwise")
@quick_cases("more", [(), ("--json", "-")], keep=(1,))
def test_a_reader_that_goes_away_does_not_cost_the_files(tmp_path: Path, more: tuple[str, ...]):
    reading, writing = os.pipe()
    os.close(reading)
    words = ["linearise", str(scene_in(tmp_path)), "--out", str(tmp_path / "out"), *more]
    with open(writing, "wb") as closed:
        ended = subprocess.run(
            [sys.executable, "-m", "stochvi", *words], stdout=closed, stderr=subprocess.PIPE
        )
    assert ended.returncode == 0
    assert b"Traceback" not in ended.stderr and b"BrokenPipe" not in ended.stderr
    names = {path.name for path in files_below(tmp_path / "out")}
    assert names == {"response.csv", "response.json"}


@pytest.mark.skipif(os.name == "nt", reason="Windows has no such signal")
def test_ctrl_c_while_the_command_line_is_imported_is_one_sentence(tmp_path: Path):
    words = "import sys, os, signal; sys.argv = ['stochvi', 'profiles']\n"
    words += "class Press:\n def find_spec(self, name, *_):\n"
    words += "  if name == 'click': os.kill(os.getpid(), signal.SIGINT)\n"
    words += "sys.meta_path.insert(0, Press())\n"
    words += "from stochvi.__main__ import run; run()"
    ended = subprocess.run([sys.executable, "-c", words], capture_output=True, text=True)
    assert ended.returncode == 1
    assert ended.stderr == "stochvi: interrupted by Ctrl-C; nothing was kept\n"


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="the file system has no named pipes")
@pytest.mark.parametrize("where", ["scene", "table"])
def test_a_device_a_pipe_or_a_folder_is_no_input(stochvi: Run, tmp_path: Path, where: str):
    scene = scene_in(tmp_path, excitation=TABLE)
    replaced = scene if where == "scene" else tmp_path / "spectrum.csv"
    replaced.unlink()
    began = time.process_time()
    for make in (os.mkfifo, os.mkdir, lambda path: os.symlink("/dev/zero", path)):
        make(replaced)
        assert "expected a text file, got" in refused(stochvi("exact", scene))
        replaced.rmdir() if replaced.is_dir() else replaced.unlink()
    assert time.process_time() - began < 5.0


UNPRIVILEGED = ["setpriv", "--bounding-set=-dac_override,-dac_read_search"]
"""What takes from root the right to write where nobody may."""


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="Windows has other rights")
@pytest.mark.skipif(
    hasattr(os, "geteuid") and os.geteuid() == 0 and not shutil.which("setpriv"),
    reason="root may write everywhere",
)
def test_without_write_access_a_command_ends_in_a_sentence_before_it_works(tmp_path: Path):
    """`demo` worked for 12 s first, and a message began with a name and went on without a colon."""
    scene, closed = scene_in(tmp_path / "here"), tmp_path / "closed"
    closed.mkdir()
    closed.chmod(0o555)
    without = UNPRIVILEGED if os.geteuid() == 0 else []
    commands = [
        ("linearise", scene, "--out", closed / "answers"),
        ("linearise", scene, "--json", closed / "answer.json"),
        ("simulate", scene, "--checkpoint", closed / "kept"),
        ("sweep", scene, *VARY, "--out", closed),
        ("demo", "--out", closed / "answers"),
        ("new", closed / "scene.toml"),
    ]
    words = (
        "import resource, sys; from stochvi.cli import main;\n"
        "for each in eval(sys.argv[1]):\n"
        "    try: main(each)\n"
        "    except SystemExit as ended: print(ended.code, file=sys.stderr)\n"
        "print(resource.getrusage(resource.RUSAGE_SELF).ru_utime)"
    )
    asked = repr([[str(word) for word in command] for command in commands])
    ended = subprocess.run(
        [*without, sys.executable, "-c", words, asked], capture_output=True, text=True, check=True,
        env=os.environ | {"HOME": str(closed)},
    )  # fmt: skip
    said, codes = ended.stderr.splitlines()[::2], ended.stderr.splitlines()[1::2]
    assert codes == ["2"] * len(commands)
    for sentence in said:
        assert sentence.startswith("stochvi: ") and f"{closed} cannot be written to;" in sentence
    assert float(ended.stdout) < 4.0
    # the negative control: the same commands write where they may
    closed.chmod(0o755)
    asked = repr([[str(word) for word in command] for command in commands[:2]])
    subprocess.run([*without, sys.executable, "-c", words, asked], capture_output=True, check=True)
    assert len(files_below(closed)) == 3


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="Windows refuses a file that another program has open")
def test_two_writers_of_one_folder_leave_whole_answers_of_one_of_them(tmp_path: Path):
    scenes = [scene_in(tmp_path / title, title) for title in ("one", "two")]
    out = tmp_path / "out"
    words = "import sys; from stochvi.cli import main\nfor _ in range(20):\n"
    words += "    try: main(['linearise', sys.argv[1], '--out', sys.argv[2], '--quiet'])\n"
    words += "    except SystemExit as ended: assert ended.code in (0, None), ended.code\n"
    both = [
        subprocess.Popen([sys.executable, "-c", words, scene, out], stderr=subprocess.PIPE)
        for scene in scenes
    ]
    seen = set()
    while any(each.poll() is None for each in both):
        if (out / "response.json").exists():  # at any moment it is a whole document
            document = json.loads((out / "response.json").read_text("utf-8"))
            seen.add(document["provenance"]["scene"]["title"])
        time.sleep(1e-3)
    assert [each.returncode for each in both] == [0, 0], [each.stderr.read() for each in both]  # type: ignore[union-attr]
    assert seen == {"one", "two"}
    assert {path.name for path in files_below(out)} == {"response.csv", "response.json"}


# ------------------------------------------------------------------------------
# The study of when commands end asks every command that has a budget.
# ------------------------------------------------------------------------------


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


def test_the_study_knows_when_a_kernel_was_compiled(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A command that compiled one is run again: of the time of the first, compiling is a part."""
    monkeypatch.setattr(numba.core.config, "CACHE_DIR", str(tmp_path))
    before = STUDY.last_compiled()
    (tmp_path / "engine").mkdir()
    kept = tmp_path / "engine" / "kernel.nbc"
    kept.touch()
    os.utime(kept, (before + 1e6,) * 2)
    assert STUDY.last_compiled() == pytest.approx(before + 1e6)


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
    "a heavy damper": ({"frequency_hz": 12.0, "Q": 0.02}, NOISE, "spectrum"),
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
    ("size --rate 0.01", "stochvi.isolators.sizing.size.size", ELASTIC),
    ("sine", "stochvi.methods.periodic.harmonic_response", MOUNT),
    ("basins", "stochvi.methods.periodic.basins", MOUNT),
    ("bifurcation --from 90 --to 100", "stochvi.methods.periodic.bifurcation", MOUNT),
    ("growth", "stochvi.statistics.stability.growth", ELASTIC),
    ("lifetimes", "stochvi.statistics.lifetimes.lifetimes", MOUNT),
    ("perturbations --speeds 0.3", "stochvi.isolators.jolt_response.perturbations", MOUNT),
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
    ("explain", "stochvi.verification.check.explain", ELASTIC),
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
