"""`stochvi/EQUATIONS.md` names every equation of the book that the package cites, and no other."""

from __future__ import annotations

import importlib
import inspect
import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest

import stochvi

PACKAGE = Path(stochvi.__file__).parent
ONE = r"\d+\.\d+(?:-\d+\.\d+)?"
CITED = re.compile(rf"\bB (App\. I|{ONE}(?:, {ONE})*)")
APPENDIX = "App. I"

Span = tuple[tuple[int, ...], tuple[int, ...]]


class Row(NamedTuple):
    """A row of the table: its equations, and the files that its names are from."""

    equations: list[str]
    files: set[str]


def span_of(entry: str) -> Span:
    """First and last equation of an entry; the appendix stands before the chapters."""
    if entry == APPENDIX:
        return (0,), (0,)
    first, last = (entry.split("-") * 2)[:2]
    return tuple(map(int, first.split("."))), tuple(map(int, last.split(".")))


def holds(outer: str, inner: str) -> bool:
    (low, high), (first, last) = span_of(outer), span_of(inner)
    return low <= first and last <= high


def file_of(name: str) -> str:
    """The file of a name after `stochvi.`; whatever does not exist is an error."""
    parts = name.split(".")
    for count in range(len(parts), 0, -1):
        try:
            module = importlib.import_module(".".join(["stochvi", *parts[:count]]))
        except ModuleNotFoundError:
            continue
        found = module
        for part in parts[count:]:
            found = getattr(found, part)
        home = module if not hasattr(found, "__module__") else found
        path = inspect.getsourcefile(inspect.unwrap(home))  # type: ignore[arg-type]
        assert path is not None, name
        return Path(path).relative_to(PACKAGE).as_posix()
    raise AssertionError(f"there is no stochvi.{name}")


def rows() -> Iterator[Row]:
    for line in (PACKAGE / "EQUATIONS.md").read_text(encoding="utf-8").splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if len(cells) == 3 and re.match(r"\d|App", cells[0]):
            yield Row(cells[0].split(", "), {file_of(n) for n in re.findall("`(.+?)`", cells[2])})


def citations() -> Iterator[tuple[str, str]]:
    """File and entry of every citation, also one that runs over the end of a line."""
    for path in sorted(PACKAGE.rglob("*.py")):
        text = re.sub(r"\s*\n\s*#?\s*", " ", path.read_text(encoding="utf-8"))
        for found in CITED.findall(text):
            for entry in found.split(", "):
                yield path.relative_to(PACKAGE).as_posix(), entry


def test_every_citation_is_in_the_table() -> None:
    table, cited = list(rows()), set(citations())
    assert len(cited) > 60
    for file, entry in sorted(cited):
        assert any(
            file in row.files and any(holds(own, entry) for own in row.equations) for row in table
        ), f"{file} cites (B {entry}): give it a row with a name of that file in EQUATIONS.md"


def test_every_row_is_cited_by_a_file_that_it_names() -> None:
    cited = set(citations())
    for row in rows():
        for own in row.equations:
            assert any(file in row.files and holds(own, entry) for file, entry in cited), own
        for file in row.files:
            assert any(
                other == file and any(holds(own, entry) for own in row.equations)
                for other, entry in cited
            ), f"{file} cites nothing of {row.equations}"


def test_a_name_that_does_not_exist_is_seen() -> None:
    """Negative control."""
    with pytest.raises(AttributeError):
        file_of("methods.linearisation.force.no_such_name")
