"""Imports go down the house; methods do not know each other; kernels import next to nothing."""

import ast
from pathlib import Path

import pytest

import stochvi

PACKAGE = Path(stochvi.__file__).parent
FLOORS = {
    0: ("conventions", "errors", "estimates", "datasets", "readers", "checked", "whole_files"),
    1: (
        "contacts",
        "kelvin_voigt",
        "structures",
        "excitations",
        "records",
        "roads",
        "spectra",
        "frequency_response",
        "state_space",
        "cut_normal",
        "gibbs_law",
        "attachments",
        "collisions",
        "resonance",
    ),
    2: (
        "scenes",
        "assemblies",
        "identities",
        "notes",
        "answers",
        "modes",
        "pair_scales",
        "energy_law",
    ),
    3: ("averaging", "closed_form", "galerkin", "linearisation", "monte_carlo"),
    4: (
        "accuracy",
        "crosscheck",
        "many_scenes",
        "testing",
        "explanation",
        "first_crossings",
        "bursts",
        "jolts",
        "failures",
        "response_spectra",
        "impact_statistics",
    ),
    5: (
        "isolators",
        "absorbers",
        "sizing",
        "sweeps",
        "files",
        "plots",
        "density_plots",
        "record_plots",
        "tables",
        "report",
        "demo",
    ),
    6: ("cli", "__main__", "__init__"),
}
METHODS = FLOORS[3]
FLOOR_OF = {room: floor for floor, rooms in FLOORS.items() for room in rooms}
FILES = sorted(PACKAGE.rglob("*.py"))


def room(path: Path) -> str:
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


def imported(path: Path) -> set[str]:
    """Full names of the modules that a file imports, wherever in it."""
    names = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            names.add(node.module or "")
    return names


def imported_rooms(path: Path) -> set[str]:
    return {name.split(".")[1] for name in imported(path) if name.startswith("stochvi.")}


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_imports_go_down_and_never_between_methods(path: Path) -> None:
    here = room(path)
    assert here in FLOOR_OF, f"{here} has no floor: give it one in this test"
    for other in imported_rooms(path) - {here}:
        assert FLOOR_OF[other] <= FLOOR_OF[here], f"{here} imports upwards from {other}"
        assert not (here in METHODS and other in METHODS), f"method {here} imports {other}"


def test_rooms_on_one_floor_import_without_circles() -> None:
    graph: dict[str, set[str]] = {}
    for path in FILES:
        graph.setdefault(room(path), set()).update(imported_rooms(path) - {room(path)})
    done: set[str] = set()
    while ready := {name for name in graph if name not in done and graph[name] <= done}:
        done |= ready
    assert done == set(graph), f"circular imports among {set(graph) - done}"


def test_kernels_import_only_numpy_math_and_numba() -> None:
    kernels = sorted((PACKAGE / "monte_carlo" / "kernels").glob("*.py"))
    assert len(kernels) > 2
    for path in kernels:
        own = {name for name in imported(path) if name.startswith("stochvi.monte_carlo.kernels")}
        assert imported(path) - own <= {"numpy", "math", "numba"}, path.name


def test_every_public_name_resolves() -> None:
    for name in stochvi.__all__:
        assert getattr(stochvi, name) is not None
    with pytest.raises(AttributeError, match="no_such_name"):
        stochvi.no_such_name  # noqa: B018
