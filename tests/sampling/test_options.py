"""One set of options for everything that samples: in Python, on the command line, on the page."""

from __future__ import annotations

import ast
import re
from pathlib import Path

from stochvi.cli import options as command_line
from stochvi.sampling.options import BUDGET, DEFAULTS, SamplingOptions
from support import CHECKOUT

MOST_PARAMETERS = 8
"""Largest number of parameters of a function that users do not call."""

PUBLIC = {
    "size", "fokker_planck_many", "linearise_many", "reliability", "damage",
    "absorber",  # the command
}  # fmt: skip
"""Public calls, whose options users name."""


def test_the_page_has_the_names_and_defaults() -> None:
    page = (CHECKOUT / "docs/howto/long-runs.md").read_text(encoding="utf-8")
    table = re.findall(r"^\| `(\w+)` \| .* \| ([^|]*) \|$", page, re.MULTILINE)
    assert {name for name, _ in table} == set(DEFAULTS) == set(SamplingOptions.__annotations__)
    for name, default in table:
        known = DEFAULTS[name]
        said = "None" if known is None else f"{known:g}"
        assert default.partition(":")[0] == said or name == "rel_error", name


def test_the_command_line_has_the_same_default_budget() -> None:
    assert command_line.BUDGET == BUDGET


def long_signatures(file: Path) -> list[str]:
    """Functions with more parameters than MOST_PARAMETERS, `self` apart; those that are compiled
    into kernels are left out."""
    found = []
    for each in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if not isinstance(each, ast.FunctionDef):
            continue
        if any(ast.unparse(mark).startswith("kernel") for mark in each.decorator_list):
            continue
        asked = each.args
        named = [*asked.posonlyargs, *asked.args, *asked.kwonlyargs]
        number = len(named) + bool(asked.vararg) + bool(asked.kwarg)
        number -= bool(named) and named[0].arg in ("self", "cls")
        if number > MOST_PARAMETERS and each.name not in PUBLIC:
            found.append(f"{file.name}: {each.name} ({number})")
    return found


def test_functions_have_few_parameters() -> None:
    compiled = ("kernels", "kernel.py")
    files = CHECKOUT.glob("stochvi/**/*.py")
    assert [
        sentence
        for file in files
        if not set(compiled) & set(file.parts)
        for sentence in long_signatures(file)
    ] == []


def test_a_long_signature_is_found(tmp_path: Path) -> None:
    """Negative control."""
    file = tmp_path / "one.py"
    file.write_text("def f(a, b, c, d, e, f, g, h, i): ...\n")
    assert long_signatures(file) == ["one.py: f (9)"]
    file.write_text("@kernel\ndef f(a, b, c, d, e, f, g, h, i): ...\n")
    assert long_signatures(file) == []
