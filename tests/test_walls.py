"""The walls of the house, as far as `lint-imports` does not hold them."""

from __future__ import annotations

import ast
import re
import sys
import tomllib
from pathlib import Path

import pytest

from support import CHECKOUT


def third_party(file: Path) -> set[str]:
    """Top-level names that a file imports, but for those of Python and of the package."""
    found = set()
    for each in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(each, ast.Import):
            found |= {alias.name.partition(".")[0] for alias in each.names}
        elif isinstance(each, ast.ImportFrom) and each.module and not each.level:
            found.add(each.module.partition(".")[0])
    return found - set(sys.stdlib_module_names) - {"stochvi"}


def test_every_package_that_is_imported_is_declared() -> None:
    project = tomllib.loads((CHECKOUT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = project["optional-dependencies"]
    lines = [
        *project["dependencies"],
        *(line for extra in ("fem", "ide", "distributed", "test") for line in extras[extra]),
    ]
    declared = {re.split(r"[^\w-]", line)[0].lower().replace("-", "_") for line in lines}
    imported = set().union(*(third_party(file) for file in CHECKOUT.glob("stochvi/**/*.py")))
    # a notebook brings IPython, and dask[distributed] brings distributed
    assert {each.lower() for each in imported} - declared - {"ipython", "distributed"} == set()


def test_a_circle_through_a_name_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The negative control of the contract: one that sees import statements alone is kept."""
    contracts = pytest.importorskip("support.import_contracts")
    package = tmp_path / "stochvi"
    package.mkdir()
    (package / "__init__.py").write_text("")
    (package / "answers.py").write_text("def plot():\n    import_module('stochvi.views')\n")
    (package / "views.py").write_text("import stochvi.answers\n")
    monkeypatch.setattr(contracts, "PACKAGE", package)
    statements = {"stochvi.views": {"stochvi.answers"}, "stochvi.answers": set()}
    assert contracts.circles(statements) == []
    for importer, imported in contracts.lazy_imports(package):
        statements[importer].add(imported)
    assert contracts.circles(statements) == [["stochvi.answers", "stochvi.views"]]
