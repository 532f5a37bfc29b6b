"""Every study can be made in short and elsewhere: `--quick` and `--out` are how it is tried out."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

from support import CHECKOUT

STUDIES = sorted((CHECKOUT / "studies").glob("*/run.py"))


def options_of(source: str) -> set[str]:
    """The options that a program gives to its parser of arguments."""
    return {
        argument.value
        for node in ast.walk(ast.parse(source))
        if isinstance(node, ast.Call)
        and isinstance(node.func, ast.Attribute)
        and node.func.attr == "add_argument"
        for argument in node.args
        if isinstance(argument, ast.Constant)
    }


@pytest.mark.parametrize("program", STUDIES, ids=lambda program: program.parent.name)
def test_a_study_takes_quick_and_out(program: Path) -> None:
    assert options_of(program.read_text("utf-8")) >= {"--quick", "--out"}


def test_a_study_that_only_names_an_option_does_not_take_it() -> None:
    source = 'parser.add_argument("--quick")\nprint("--out")\n'
    assert STUDIES and options_of(source) == {"--quick"}


@pytest.mark.parametrize("page", [program.with_name("README.md") for program in STUDIES],
                         ids=lambda page: page.parent.name)  # fmt: skip
def test_a_page_of_a_study_has_no_gap_to_fill(page: Path) -> None:
    assert gaps(page.read_text("utf-8")) == []


def test_a_gap_is_found() -> None:
    assert gaps("It holds.\n\nRESULT\n\nMILES, RICE\n") == ["RESULT"]


def gaps(text: str) -> list[str]:
    """Lines of a single word in capitals, which stand for what was to be written."""
    return [line for line in text.splitlines() if line.isalpha() and line.isupper()]
