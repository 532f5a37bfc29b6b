"""The files that CONTRIBUTING names exist, and so do the functions."""

import re
from pathlib import Path

import pytest

HOUSE = Path(__file__).parents[1]
TEXT = (HOUSE / "CONTRIBUTING.md").read_text("utf-8")
FILES = sorted(set(re.findall(r"`(?:[\w/]+/)?\w+\.(?:pyi?|md|toml)(?=[`:])", TEXT)))


@pytest.mark.parametrize("name", [each.strip("`") for each in FILES])
def test_a_file_that_is_named_exists(name: str) -> None:
    assert any(path.as_posix().endswith(f"/{name}") for path in HOUSE.rglob(Path(name).name))


FUNCTIONS = sorted(set(re.findall(r"`([\w/]+\.py): (?:\w+\.)?(\w+)`", TEXT)))


@pytest.mark.parametrize(("name", "function"), FUNCTIONS)
def test_a_function_that_is_named_is_in_its_file(name: str, function: str) -> None:
    files = [p for p in HOUSE.rglob(Path(name).name) if p.as_posix().endswith(f"/{name}")]
    assert any(re.search(rf"(def|class) {function}\b", p.read_text("utf-8")) for p in files)
