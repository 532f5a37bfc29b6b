"""What the README shows works as printed, from an empty folder."""

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

from support import CHECKOUT

README = (CHECKOUT / "README.md").read_text(encoding="utf-8")


def blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", README, flags=re.DOTALL | re.MULTILINE)


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


def test_commands_run(tmp_path: Path) -> None:
    environment = os.environ | {
        "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    }
    commands = [line for block in blocks("sh") for line in block.splitlines() if line]
    assert len(commands) > 3
    for command in commands:
        subprocess.run(
            shlex.split(command), capture_output=True, check=True, cwd=tmp_path, env=environment
        )
    assert (tmp_path / "answer.json").is_file()
    assert {"response.csv", "response.json", "overview.png"} <= {
        path.name for path in (tmp_path / "out").iterdir()
    }


def test_files_that_the_readme_names_exist() -> None:
    for target in re.findall(r"\]\(([^)]+)\)", README):
        assert (CHECKOUT / target).exists(), target
    for target in ("make demo", "make test"):
        assert target in README
        rule = target.split()[1]
        assert re.search(rf"^{rule}:", (CHECKOUT / "Makefile").read_text(), flags=re.MULTILINE)
