"""What a page can set and take away: choices, tables, laws, tolerances, presets, files."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest

from stochvi.cli.scenes import line_of
from stochvi.explorer import turns
from stochvi.explorer.knobs import (
    MOST_ROWS,
    PRESETS,
    Setting,
    design_of,
    kind_of,
    knobs_of,
    preset,
    questions_of,
)
from stochvi.explorer.takeaways import toml_of
from stochvi.explorer.turns import Explorer, Refused, Turn
from stochvi.isolators.tolerances import Tolerances
from stochvi.results.errors import NotConverged
from stochvi.scenes.datasets import shipped_scene
from stochvi.scenes.excitations import TabulatedNoise
from stochvi.scenes.scene import load_scene
from support.commands import Run

TRUCK = load_scene(shipped_scene("isolator-truck"))
TABLE = "frequency_hz,density_g2_per_hz\n5,0.01\n50,0.02\n"


def asked(explorer: Explorer, **message: Any) -> list[dict[str, Any]]:
    """The answers to a message, each as JSON holds it."""
    answers = explorer.answers({"id": 1, "tab": "a", **message})
    return [json.loads(json.dumps(each, allow_nan=False)) for each in answers]


# ------------------------------------------------------------------------------
# Choices: a preset, a law, a table, tolerances.
# ------------------------------------------------------------------------------


@pytest.mark.parametrize("name", PRESETS)
def test_a_preset_begins_with_its_own_knobs(name: str) -> None:
    (opened,) = asked(Explorer(TRUCK), type="open", preset=name)
    scene = preset(name)
    assert opened["kind"] == kind_of(scene)
    known = [*knobs_of(scene), *questions_of(scene)]
    told = [*opened["knobs"], *opened["tolerances"]]
    assert [each["key"] for each in told] == [each.key for each in known]
    assert all(each.low <= each.value <= each.high for each in known)
    assert design_of(TRUCK, Setting({}, preset=name)).scene == scene


def test_a_scene_that_is_not_sized_has_no_question() -> None:
    for name in ("impact absorber on a tower", "isolator under a sine"):
        assert questions_of(preset(name)) == []
    boxed = {each.key for each in questions_of(preset("box on four mounts"))}
    assert boxed - {each.key for each in questions_of(TRUCK)} == {"tolerances.centre"}


def test_a_law_brings_its_own_knobs() -> None:
    (opened,) = asked(Explorer(TRUCK), type="open", law="viscoelastic")
    assert opened["laws"] == ["restitution", "viscoelastic"]
    assert opened["law"] == "viscoelastic"
    keys = {each["key"] for each in opened["knobs"]}
    assert "impact_pair.0.law.coefficient" not in keys
    values = {"impact_pair.0.law.stiffness": 3e5, "impact_pair.0.law.damping_ratio": 0.1}
    found = design_of(TRUCK, Setting(values, law="viscoelastic")).scene
    (pair,) = found.impact_pairs
    assert {k: vars(pair.law)[k] for k in ("stiffness", "damping_ratio")} == {
        "stiffness": 3e5, "damping_ratio": 0.1,
    }  # fmt: skip
    assert design_of(TRUCK, Setting({}, law="restitution")).scene == TRUCK


def test_a_pasted_table_is_read_as_a_file_is(tmp_path: Path) -> None:
    (tmp_path / "own.csv").write_text(TABLE, encoding="utf-8")
    expected = TabulatedNoise(file=str(tmp_path / "own.csv"), level_db=3.0)
    values = {"excitation.0.level_db": 3.0}
    (found,) = design_of(TRUCK, Setting(values, psd=TABLE)).scene.excitations
    assert isinstance(found, TabulatedNoise)
    assert found.table.density.tolist() == pytest.approx(expected.table.density.tolist(), 1e-12)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("hello", "pasted table holds no rows of two numbers"),
        ("5,1\n4,2", "needs unit, one of g2/Hz"),
        ("frequency_hz,density_g2_per_hz\n5,0.01\n6,many", "pasted table"),
        ("frequency_hz,density_g2_per_hz\n5,-0.01\n6,0.02", "pasted table"),
        ("5,1\n" * MOST_ROWS, f"at most {MOST_ROWS} rows"),
    ],
)
def test_a_bad_table_is_refused_in_the_sentence_of_the_reader(text: str, sentence: str) -> None:
    with pytest.raises(Refused) as told:
        asked(Explorer(TRUCK), type="turn", psd=text)
    assert sentence in str(told.value)
    assert "/tmp" not in str(told.value) and ".csv" not in str(told.value)


@pytest.mark.parametrize(
    ("choice", "sentence"),
    [
        ({"preset": "../scene"}, "preset must be one of"),
        ({"law": "hertz"}, "law must be one of restitution, viscoelastic"),
        ({"preset": "beam on a bumper", "psd": TABLE}, "where one table shakes the scene"),
        ({"values": {"tolerances.centre": 0.001}}, "values must name knobs"),
        ({"values": {"tolerances.frequency": 2.0}}, "tolerance of the natural frequency must be"),
    ],
    ids=str,
)
def test_a_choice_that_is_none_is_refused(choice: dict[str, Any], sentence: str) -> None:
    with pytest.raises(Refused, match=sentence):
        asked(Explorer(TRUCK), type="turn", **choice)


def test_tolerances_are_those_of_the_question() -> None:
    values = {"tolerances.frequency": 0.1, "tolerances.level_db": 3.0}
    found = design_of(TRUCK, Setting(values)).tolerances
    assert found == Tolerances(frequency=0.1, level_db=3.0)


# ------------------------------------------------------------------------------
# What is simulated in the background, with progress, and its end.
# ------------------------------------------------------------------------------


def test_what_is_confirmed_is_simulated_beside_turns(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(turns, "CONFIRMED", 0.2)
    explorer = Explorer(TRUCK)
    with explorer.work:  # a turn is at work
        *progress, found, done = asked(explorer, type="confirm")
    assert {each["type"] for each in progress} == {"progress"}
    assert progress[-1]["done"] == 1.0
    assert found["part"] == "confirmed"
    assert found["clearance"] == 0.004
    rate = found["numbers"][0]
    assert rate["low"] < rate["value"] < rate["high"]
    assert done == {"type": "done", "id": 1}


def test_what_is_cancelled_ends_at_its_next_report(monkeypatch: pytest.MonkeyPatch) -> None:
    ended = []

    def confirmed(turn: Turn, progress: Any) -> dict[str, Any]:
        try:
            while True:
                progress(0.5, "half")
        except turns.Stale:
            ended.append(turn.id)
            raise

    monkeypatch.setattr(Turn, "confirmed", confirmed)
    explorer = Explorer(TRUCK)
    answers = explorer.answers({"type": "confirm", "id": 3, "tab": "a"})
    assert next(answers)["type"] == "progress"
    assert asked(explorer, type="cancel", tab="b") == [{"type": "done", "id": 1}]
    assert next(answers)["type"] == "progress"
    asked(explorer, type="cancel")
    assert [each for each in answers if each["type"] != "progress"] == [{"type": "done", "id": 3}]
    assert ended == [3]


# ------------------------------------------------------------------------------
# What falls short of its accuracy is shown as far as it got.
# ------------------------------------------------------------------------------


SHORT = "Shown as far as it got: the budget ended."


def falls_short(monkeypatch: pytest.MonkeyPatch, name: str, **less: Any) -> None:
    """Let a calculation of a turn end before it is as exact as was asked."""
    calculate = getattr(turns, name)

    def short(scene: Any, **named: Any) -> Any:
        raise NotConverged("the budget ended; raise budget", calculate(scene, **{**named, **less}))

    monkeypatch.setattr(turns, name, short)


def test_an_absorber_that_is_not_known_well_is_shown_with_its_interval_and_why(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    falls_short(monkeypatch, "absorber", levels_db=(-6.0,), rel_error=0.5)
    message = {"type": "turn", "preset": "impact absorber on a tower"}
    found, done = asked(Explorer(TRUCK), **message)
    assert done["type"] == "done"
    assert found["short"] == SHORT
    (number,) = found["numbers"]
    assert 0.0 < number["low"] < number["value"] < number["high"]
    assert found["sentence"].endswith("of the rms motion at -6 dB.")

    def nothing(*_: Any, **__: Any) -> Any:
        raise NotConverged("before any level was simulated", None)

    monkeypatch.setattr(turns, "absorber", nothing)
    found, done = asked(Explorer(TRUCK), **message)
    assert found["missing"] == "before any level was simulated" and "short" not in found


def test_a_confirmation_that_is_not_known_well_is_shown_with_why(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    falls_short(monkeypatch, "simulate", rel_error=0.2)
    *_, found, done = asked(Explorer(TRUCK), type="confirm")
    assert (found["part"], found["short"]) == ("confirmed", SHORT)
    assert found["numbers"][0]["low"] < found["numbers"][0]["value"]
    assert done == {"type": "done", "id": 1}


# ------------------------------------------------------------------------------
# What is taken away gives the same answer.
# ------------------------------------------------------------------------------


SET = {
    "values": {"structure.frequency_hz": 14.5, "probability": 0.05, "mission": 600.0},
    "law": "viscoelastic",
    "psd": TABLE,
}


def file_of(explorer: Explorer, what: str, **setting: Any) -> str:
    (found,) = asked(explorer, type="take", what=what, **setting)
    assert (found["type"], found["id"]) == ("file", 1)
    return str(found["text"])


@pytest.mark.parametrize("name", PRESETS)
def test_a_scene_file_holds_the_design(tmp_path: Path, name: str) -> None:
    text = file_of(Explorer(TRUCK), "scene", preset=name)
    (tmp_path / "design.toml").write_text(text, encoding="utf-8")
    assert load_scene(tmp_path / "design.toml") == preset(name)


def test_odd_texts_survive_in_a_scene_file(tmp_path: Path) -> None:
    odd = TRUCK.replace(title='a "quote", a \\, é, \x7f and\na line')
    (tmp_path / "odd.toml").write_text(toml_of(odd.document()), encoding="utf-8")
    assert load_scene(tmp_path / "odd.toml").title == odd.title


@pytest.fixture(scope="module")
def offered() -> dict[str, str]:
    """What is taken away of one design."""
    explorer = Explorer(TRUCK, 3, line_of)
    (opened,) = asked(explorer, type="open", **SET)
    return {each: file_of(explorer, each, **SET) for each in opened["offers"]
            if each not in ("report", "html")}  # fmt: skip


@pytest.mark.slow
def test_the_command_and_the_lines_of_python_give_the_answer_of_the_page(
    offered: dict[str, str], stochvi: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    (tmp_path / "design.toml").write_text(offered["scene"], encoding="utf-8")
    risk = Turn(design_of(TRUCK, Setting(**SET)), 3, 1).risk()
    shown = risk["numbers"][0]
    program, *words = offered["command"].split()
    assert program == "stochvi"
    told = json.loads(stochvi(*words, "--json", "-").out)
    assert told["clearance"]["value"] == shown["value"]
    assert told["verdict"] == risk["sentence"]
    space: dict[str, Any] = {}
    exec(offered["python"], space)
    assert space["answer"].clearance.value == shown["value"]
    assert capsys.readouterr().out
    first = offered["csv"].splitlines()[1].split(",")
    assert float(first[0]) == risk["curve"]["clearance"][0]


@pytest.mark.slow
def test_the_report_is_that_of_the_command() -> None:
    page = file_of(Explorer(TRUCK, 0, line_of), "report", **SET)
    assert "stochvi size design.toml --probability 0.05" in page
    assert re.findall(r"(?:src|href)=.https?:", page) == []


def test_tolerances_are_taken_away_as_the_options_have_them() -> None:
    values = {"tolerances.frequency": 0.1, "tolerances.level_db": 3.0}
    explorer = Explorer(TRUCK, 0, line_of)
    line = file_of(explorer, "command", values=values)
    assert line.endswith("--tolerances frequency=10%,level=3dB --seed 0\n")
    assert "Tolerances(frequency=0.1, damping=0.0, level_db=3.0" in file_of(
        explorer, "python", values=values
    )


def test_a_kind_is_asked_by_its_own_command() -> None:
    explorer = Explorer(TRUCK, 0, line_of)
    for name, word in (
        ("impact absorber on a tower", "absorber design.toml --levels -6,0,6 --rel-error 0.05"),
        ("isolator under a sine", "sine design.toml --from 60"),
    ):
        assert f"stochvi {word}" in file_of(explorer, "command", preset=name)
    assert "report" not in asked(explorer, type="open", preset="isolator under a sine")[0]["offers"]


def test_without_a_command_line_none_is_offered() -> None:
    (opened,) = asked(Explorer(TRUCK), type="open")
    assert "command" not in opened["offers"]
    with pytest.raises(Refused, match="what must be one of scene, python"):
        asked(Explorer(TRUCK), type="take", what="nothing")
