"""The study of when commands end asks every command that has a budget."""

from __future__ import annotations

import importlib
import subprocess
import sys
from pathlib import Path

import click
import pandas as pd
import pytest

from stochvi.cli import main

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
