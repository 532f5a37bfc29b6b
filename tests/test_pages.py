"""What the README and the manual show works as printed, from an empty folder.

Commands and scenes of every page, and the program of the README, are run here; the programs of the
manual are `{code-cell}` blocks, which `make docs` runs.
"""

from __future__ import annotations

import json
import os
import re
import shlex
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import click
import pandas as pd
import pytest

from stochvi.cli import main
from stochvi.scenes.datasets import shipped_scene
from stochvi.scenes.scene import scene_from
from support import CHECKOUT
from support.commands import Run

sys.path.insert(0, str(CHECKOUT / "docs" / "_extensions"))
import notebooks
import shown

README = CHECKOUT / "README.md"
MANUAL = sorted(
    (
        page
        for page in (CHECKOUT / "docs").rglob("*.md")
        if not {"_build", "generated"} & set(page.parts)
    ),
    key=lambda page: (page.stem != "start", page),
)
"""Pages of the manual. The commands of the first one write the scene of the others."""

FENCE = re.compile(r"^(```+)([^\n`]*)\n(.*?)^\1$", flags=re.DOTALL | re.MULTILINE)

LESS = {
    "size": ["--rel-error", "0.4"],
    "clearance": ["--rel-error", "0.2"],
    "reliability": ["--rel-error", "0.5"],
    "check": ["--rel-error", "0.1"],
    "cost": ["--budget", "0.5"],
    "simulate": ["--rel-error", "0.1"],
    "simulate, so many paths": ["--paths", "64", "--duration", "6"],
    "spectrum": ["--rel-error", "0.3"],
    "impacts": ["--paths", "16"],
    "damage": ["--rel-error", "0.5", "--equipment", "20:60"],
    "sweep, simulated": ["--rel-error", "0.2"],
    "sine": ["--points", "3"],
    "basins": ["--start", "displacement.x=0", "--start", "velocity.x=-0.1:0.1:3"],
    "bifurcation": ["--points", "3"],
}
"""Options that ask for less work, in the place of those of a command."""

FRAME = {
    "structure": {"kind": "isolator", "mass": 1.0, "frequency_hz": 12.0, "zeta": 0.1},
    "excitation": [{"kind": "white", "intensity": 1.0}],
}
"""What a scene has beside the part that a block of a page shows."""

SHOWN_ONLY = {"text", "json", "bibtex", "console", ""}
"""Languages of blocks of which nothing is run here; `console` blocks have a test of their own."""


class Block(NamedTuple):
    """A fenced block: its page, what stands behind the fence, and its text."""

    page: Path
    language: str
    text: str


def blocks(*languages: str) -> Iterator[Block]:
    for page in (README, *MANUAL):
        for _, language, text in FENCE.findall(page.read_text(encoding="utf-8")):
            if not languages or language in languages:
                yield Block(page, language, text)


def commands() -> list[list[str]]:
    """Every command line of the pages once, in their order, the README first."""
    lines = [line for block in blocks("sh") for line in block.text.splitlines() if line]
    assert len(lines) > 15
    return [shlex.split(line) for line in dict.fromkeys(lines)]


def shortened(arguments: list[str]) -> list[str]:
    name = arguments[0]
    if "--resume" in arguments:
        return arguments
    if "--paths" in arguments:
        name = "simulate, so many paths"
    if name == "sine":  # regimes are looked for over the whole range, however few values are drawn
        first = float(arguments[arguments.index("--from") + 1])
        return instead(arguments, [*LESS[name], "--to", f"{1.1 * first:g}"])
    if name == "sweep" and "--rel-error" in arguments:
        name = "sweep, simulated"
    return instead(arguments, LESS.get(name, []))


def instead(arguments: list[str], options: list[str]) -> list[str]:
    """The arguments with these options, each followed by its value, in the place of their own."""
    kept, own = [], iter(arguments)
    for word in own:
        if word in options[::2]:
            next(own)
        else:
            kept.append(word)
    return [*kept, *options]


def files_are_there(folder: Path) -> bool:
    pictures = {"response.csv", "response.json", "overview.png"}
    found = {path.name for path in (folder / "out").iterdir()}
    return (folder / "answer.json").is_file() and pictures <= found


@pytest.mark.slow
def test_the_program_of_the_readme_prints_what_the_readme_says(tmp_path: Path) -> None:
    script = "\n".join(block.text for block in blocks("python"))
    assert "simulate" in script
    printed = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True, cwd=tmp_path
    ).stdout
    text = README.read_text(encoding="utf-8")
    for number in ("1.99 mm", "3.22"):
        assert number in printed
        assert number in text


@pytest.mark.slow
@pytest.mark.usefixtures("short_review", "blank_pictures")
def test_commands_run_with_less_work(
    stochvi: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for program, *arguments in commands():
        assert program in ("stochvi", "make")
        if program == "stochvi":
            done = stochvi(*shortened(arguments))
            # `cost` ends by the clock, which a busy machine may not leave it enough of
            late = arguments[0] == "cost" and done.code == 1 and "raise --budget" in done.err
            assert done.code == 0 or late, (arguments, done.err)
    assert files_are_there(tmp_path)


@pytest.mark.verify
def test_commands_run_as_printed(tmp_path: Path) -> None:
    environment = os.environ | {
        "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    }
    for command in commands():
        if command[0] == "stochvi":
            done = subprocess.run(
                command, capture_output=True, text=True, cwd=tmp_path, env=environment
            )
            # as above
            late = command[1] == "cost" and done.returncode == 1 and "raise --budget" in done.stderr
            assert done.returncode == 0 or late, (command, done.stderr)
    assert files_are_there(tmp_path)


@pytest.mark.parametrize("block", list(blocks("toml")), ids=lambda block: block.page.stem)
def test_scenes_and_parts_of_scenes_are_valid(
    block: Block, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(CHECKOUT / "data" / "scenes")  # where the tables lie that they name
    part = tomllib.loads(block.text)
    if "cross_density" in part and "structure" not in part:  # of a body with several axes
        box = shipped_scene("rigid-box")
        scene_from(tomllib.loads(box.read_text(encoding="utf-8")) | part)
    else:
        scene_from(FRAME | part)


def test_commands_within_sentences_exist_with_their_options() -> None:
    seen = 0
    for page in (README, *MANUAL):
        prose = FENCE.sub("", page.read_text(encoding="utf-8"))
        for line in re.findall(r"`stochvi ([a-z][^`]*)`", prose):
            name, *words = shlex.split(line)
            command = main.get_command(click.Context(main), name)
            assert command, (page, line)
            known = {option for each in command.params for option in each.opts}
            used = {word for word in words if word.startswith("--")}
            assert used <= known, (page, line, used - known)
            seen += 1
    assert seen > 20


def test_every_block_of_a_page_is_run() -> None:
    """Here, or when the manual is built; the README has its own program, as no build runs that."""
    for block in blocks():
        run_here = {"sh", "toml"} | ({"python"} if block.page == README else set())
        directive = block.language.startswith("{")
        assert directive or block.language in run_here | SHOWN_ONLY, block


CONSOLE = [page for page in (README, *MANUAL) if "```console" in page.read_text(encoding="utf-8")]


@pytest.mark.slow
@pytest.mark.parametrize("page", CONSOLE, ids=lambda page: page.stem)
def test_commands_print_what_the_page_shows(page: Path, tmp_path: Path) -> None:
    found = shown.run_page(page, tmp_path)
    assert found
    for each, now in found:
        assert shown.differences(each.output, now) == [], each.command


def test_a_page_that_shows_something_else_is_noticed() -> None:
    said = "hits 607(20), 11.21 mm; cost: 3 s"
    assert shown.differences(said, "hits 611(20), 11.21 mm; cost: 3 s") == []
    assert shown.differences(said, "impacts 607(20), 11.21 mm; cost: 3 s")
    assert shown.differences(said, "hits 907(20), 11.21 mm; cost: 3 s")
    assert shown.differences("11.21 mm", "11.41 mm")
    bias = "30.2(1.2), 1.88(30)e-06+-6.9e-08"
    assert shown.differences(bias, "30.2(1.2)+-0.2, 1.88(30)e-06") == []
    assert shown.differences(bias, "30.2(1.2)+-1.3, 1.88(30)e-06")
    assert shown.differences(bias, "30.2(1.2), 1.88(30)e-05+-6.9e-08")
    assert shown.differences("6.251+-0.034", "6.251")
    half = "927 ± 110 impacts, level ± 3 dB"
    assert shown.differences(half, "841 ± 34 impacts, level ± 3 dB") == []
    assert shown.differences(half, "527 ± 110 impacts, level ± 3 dB")
    assert shown.differences(half, "927 ± 110 impacts, level ± 9 dB")
    long = "cost: 0.0979 s on 2 threads; a\ntenth of the errors: 9.8 s\nnote: hits 607(20)"
    assert shown.differences(long, "cost: 0.1 s; a tenth: 1 s\nnote: hits 611(20)") == []
    assert shown.differences(long, "cost: 0.1 s; a tenth: 1 s\nnote: impacts 607(20)")


def test_numbers_of_the_first_screen_are_those_of_the_studies() -> None:
    text = README.read_text(encoding="utf-8")
    rule = pd.read_csv(CHECKOUT / "studies" / "07_three_sigma_rule" / "result.csv")
    hits = rule["hits_per_hour"]
    low, high = (f"{each:,.0f}" for each in (round(hits.min(), -1), round(hits.max(), -4)))
    assert f"{low} to {high} times an hour".replace(",", " ") in text
    sigmas = rule["clearance_in_sigma"]
    assert f"{sigmas.min():.1f} to {sigmas.max():.1f} sigma" in text.replace("\n", " ")
    below = rule[rule["miles_over_rms"].isna()]
    ratio = below["hits_per_hour"] / below["hits_by_rice_per_hour"]
    assert f"{ratio.min():.0f} to {ratio.max():.0f} times Rice's count" in text
    records = pd.read_csv(CHECKOUT / "studies" / "17_records_of_the_field" / "result.csv")
    worst = records[records["kind"] == "two potholes, 9 g"].iloc[0]
    assert f"{worst['gaussian_mm']:.1f} mm" in text and f"{worst['needed_mm']:.1f} mm" in text
    boxes = pd.read_csv(CHECKOUT / "studies" / "19_box_against_one_axis" / "result.csv")
    assert f"up to {boxes['ratio'].max():.0f} times" in text


def test_numbers_of_the_gallery_stand_in_its_studies() -> None:
    tasks = tomllib.loads((CHECKOUT / "docs" / "tasks.toml").read_text(encoding="utf-8"))["task"]
    assert len(tasks) >= 10
    for task in tasks:
        study = CHECKOUT / "studies" / task["study"] / "README.md"
        numbers = set(re.findall(r"\d[\d.e-]*", study.read_text(encoding="utf-8")))
        for number in re.findall(r"\d[\d.e-]*", task["answer"]):
            assert number.rstrip(".") in {each.rstrip(".") for each in numbers}, (task, number)
        name, *_ = task["command"].split()[1:]
        assert main.get_command(click.Context(main), name), task
        shipped_scene(task["scene"])


def sentences_of_the_code() -> str:
    """The source of the package, in which texts that run over several lines are one."""
    sources = (path.read_text(encoding="utf-8") for path in (CHECKOUT / "stochvi").rglob("*.py"))
    return re.sub(r'"\s*\n\s*f?"', "", "\n".join(sources))


def test_messages_that_the_manual_explains_are_those_of_the_code() -> None:
    page = (CHECKOUT / "docs" / "howto" / "messages.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| (\*.*?) \|", page, flags=re.MULTILINE)
    messages = [message for row in rows for message in re.findall(r"\*([^*]+)\*", row)]
    assert len(messages) > 30
    code = sentences_of_the_code()
    for message in messages:
        for part in message.split("..."):
            assert part.strip(" ,;:") in code, message


def misread(text: str) -> list[str]:
    """What Markdown takes for something else: lines that begin with % are comments, and a list may
    begin within a formula."""
    plain = re.sub(r"`[^`]*`|<!--.*?-->", "", FENCE.sub("", text))
    found = [line for line in plain.splitlines() if line.lstrip().startswith("%")]
    parts = re.split(r"\n\s*\n|\n(?=\s*[-+*] )|\n(?=\|)", plain)
    return found + [part for part in parts if part.replace(r"\$", "").count("$") % 2]


def test_markdown_misreads_no_line() -> None:
    pages = [*MANUAL, *(CHECKOUT / "studies").glob("*/README.md"), *CHECKOUT.glob("*.md")]
    for page in pages:
        assert misread(page.read_text(encoding="utf-8")) == [], page


def test_what_markdown_misreads_is_found() -> None:
    assert misread("It is within 4\n% of the truth.") == ["% of the truth."]
    assert misread("So $a = b\n- c$ holds.") and not misread("So $a = b$\n- and $c$ hold.")


def test_the_readme_is_short_and_what_it_names_exists() -> None:
    text = README.read_text(encoding="utf-8")
    assert len(text.splitlines()) <= 90
    for target in re.findall(r"\]\(([^)]+)\)", text):
        assert (CHECKOUT / target).exists(), target
    makefile = (CHECKOUT / "Makefile").read_text(encoding="utf-8")
    for rule in ("demo", "test", "docs"):
        assert f"make {rule}" in text
        assert re.search(rf"^{rule}:", makefile, flags=re.MULTILINE)


# ------------------------------------------------------------------------------
# Every page that runs is offered as a notebook.
# ------------------------------------------------------------------------------


@pytest.mark.parametrize("page", [
    page for page in MANUAL if "{code-cell}" in page.read_text(encoding="utf-8")
], ids=lambda page: page.stem)  # fmt: skip
def test_a_page_that_runs_is_a_notebook(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    cells = json.loads(notebooks.notebook(text))["cells"]
    sources = {kind: [c["source"] for c in cells if c["cell_type"] == kind] for kind in KINDS}
    assert len(sources["code"]) == 1 + text.count("```{code-cell}")
    assert sources["markdown"][1].startswith("# ")
    for source in sources["code"]:
        assert source and not source.startswith((":", "---", "```"))
        if not source.startswith("%%"):
            compile(source, page.name, "exec")
    assert not any("{code-cell}" in source for source in sources["markdown"])


KINDS = ("markdown", "code")
"""Kinds of cells of a notebook."""
