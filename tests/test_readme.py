"""What the README shows works as printed, from an empty folder."""

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from support import CHECKOUT
from support.commands import Run

README = (CHECKOUT / "README.md").read_text(encoding="utf-8")

LESS = {
    "size": ["--rel-error", "0.2"],
    "clearance": ["--rel-error", "0.2"],
    "reliability": ["--rel-error", "0.5"],
    "check": ["--rel-error", "0.1"],
    "cost": ["--budget", "0.5"],
    "simulate": ["--rel-error", "0.1"],
    "simulate, so many paths": ["--paths", "64", "--duration", "6"],
    "spectrum": ["--rel-error", "0.3"],
    "impacts": ["--paths", "64"],
    "sweep, simulated": ["--rel-error", "0.2"],
}
"""Options after those of a command, where the later of two counts, that ask for less work."""


def blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", README, flags=re.DOTALL | re.MULTILINE)


def commands() -> list[list[str]]:
    lines = [line for block in blocks("sh") for line in block.splitlines() if line]
    assert len(lines) > 3
    return [shlex.split(line) for line in lines]


def shortened(arguments: list[str]) -> list[str]:
    name = arguments[0]
    if "--resume" in arguments:
        return arguments
    if "--paths" in arguments:
        name = "simulate, so many paths"
    if name == "sweep" and "--rel-error" in arguments:
        name = "sweep, simulated"
    return [*arguments, *LESS.get(name, [])]


def files_are_there(folder: Path) -> bool:
    pictures = {"response.csv", "response.json", "overview.png"}
    found = {path.name for path in (folder / "out").iterdir()}
    return (folder / "answer.json").is_file() and pictures <= found


def test_python_blocks_run_and_print_what_is_said(tmp_path: Path) -> None:
    script = "\n".join(blocks("python"))
    assert "simulate" in script
    told = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True, cwd=tmp_path
    ).stdout
    assert "1.99 mm rms without stops" in told
    assert "3.22 hits per second" in told
    assert "1.99 mm" in README
    assert "3.22" in README


def test_commands_run_with_less_work(
    stochvi: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for program, *arguments in commands():
        assert program == "stochvi"
        done = stochvi(*shortened(arguments))
        assert done.code == 0, (arguments, done.err)
    assert files_are_there(tmp_path)


@pytest.mark.verify
def test_commands_run_as_printed(tmp_path: Path) -> None:
    environment = os.environ | {
        "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    }
    for command in commands():
        subprocess.run(command, capture_output=True, check=True, cwd=tmp_path, env=environment)
    assert files_are_there(tmp_path)


def test_files_that_the_readme_names_exist() -> None:
    for target in re.findall(r"\]\(([^)]+)\)", README):
        assert (CHECKOUT / target).exists(), target
    for target in ("make demo", "make test"):
        assert target in README
        rule = target.split()[1]
        makefile = (CHECKOUT / "Makefile").read_text(encoding="utf-8")
        assert re.search(rf"^{rule}:", makefile, flags=re.MULTILINE)
