"""The files that CONTRIBUTING names exist, and so do the functions and classes in them."""

import ast
import re
import tomllib
from collections.abc import Iterable, Iterator
from datetime import date
from pathlib import Path

import pytest

HOUSE = Path(__file__).parents[1]
TEXT = (HOUSE / "CONTRIBUTING.md").read_text("utf-8")
FILES = sorted(set(re.findall(r"`(?:[\w/]+/)?\w+\.(?:pyi?|md|toml)(?=[`:])", TEXT)))


def test_a_citation_names_the_version_and_its_date() -> None:
    """Who cites a version must find which one; a release that forgets the file fails here."""
    text = (HOUSE / "CITATION.cff").read_text("utf-8")
    cited = dict(re.findall("^(version|date-released): (.+)$", text, re.MULTILINE))
    project = tomllib.loads((HOUSE / "pyproject.toml").read_text("utf-8"))["project"]
    assert cited["version"] == project["version"]
    assert date.fromisoformat(cited["date-released"].strip('"')) > date(2025, 1, 1)


def files_of(name: str) -> list[Path]:
    """The files of the repository whose path ends with a name."""
    parts = [HOUSE / room for room in ("stochvi", "tests", "docs", "studies", "data")]
    found = [path for part in parts for path in part.rglob(Path(name).name)]
    return [path for path in [*found, HOUSE / name] if path.as_posix().endswith(f"/{name}")]


@pytest.mark.parametrize("name", [each.strip("`") for each in FILES])
def test_a_file_that_is_named_exists(name: str) -> None:
    assert any(path.exists() for path in files_of(name))


NAMED = sorted(set(re.findall(r"`([\w/]+\.py): ([\w.]+)`", TEXT)))


def names_in(body: Iterable[ast.stmt], before: str = "") -> Iterator[str]:
    """Functions, and classes with their methods, that a file defines."""
    for each in body:
        if isinstance(each, ast.FunctionDef | ast.ClassDef):
            yield before + each.name
        if isinstance(each, ast.ClassDef):
            yield from names_in(each.body, f"{before}{each.name}.")


@pytest.mark.parametrize(("file", "name"), NAMED)
def test_what_is_named_is_in_its_file(file: str, name: str) -> None:
    files = [path for path in files_of(file) if path.exists()]
    assert any(name in names_in(ast.parse(path.read_text("utf-8")).body) for path in files)
