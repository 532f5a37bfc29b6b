"""Every name that the package offers can be imported, and costs nothing before it is used."""

import importlib
import pkgutil
import re
import subprocess
import sys

import pytest

import stochvi
from stochvi.scenes.datasets import shipped_scene
from support import CHECKOUT
from support.accuracies import quick_cases
from support.commands import ELASTIC, ISOLATOR

ROOMS = (
    "absorbers", "identification", "isolators", "methods", "methods.periodic", "results",
    "scenes", "statistics", "testing", "verification",
)  # fmt: skip
HEAVY = {
    "jinja2", "matplotlib", "numba", "pandas", "pyuff", "rich", "scipy.optimize", "scipy.signal",
    "scipy.stats", "statsmodels",
}  # fmt: skip


def loaded_by(program: str) -> set[str]:
    """Heavy packages that a program of its own imports."""
    show = f"\nimport sys\nprint(*({HEAVY} & set(sys.modules)))"
    printed = subprocess.run(
        [sys.executable, "-c", program + show], capture_output=True, text=True, check=True
    ).stdout
    return set(printed.splitlines()[-1].split())


def test_every_public_name_resolves() -> None:
    for name in stochvi.__all__:
        assert getattr(stochvi, name) is not None
    with pytest.raises(AttributeError, match="no_such_name"):
        stochvi.no_such_name  # noqa: B018


@pytest.mark.parametrize("room", ROOMS)
def test_every_name_of_a_room_resolves(room: str) -> None:
    package = importlib.import_module(f"stochvi.{room}")
    assert package.__all__
    for name in package.__all__:
        assert getattr(package, name) is not None


def test_names_that_pages_name_resolve() -> None:
    pages = [CHECKOUT / "README.md", CHECKOUT / "CHANGELOG.md", *CHECKOUT.glob("docs/*/*.md")]
    text = "\n".join(page.read_text(encoding="utf-8") for page in pages)
    places = set(re.findall(r"\bstochvi((?:\.[a-z_]+)*\.[A-Za-z_]+)\b(?!\.md)", text))
    assert len(places) > 10
    for place in places:
        assert pkgutil.resolve_name(f"stochvi{place}") is not None


@pytest.mark.parametrize(
    ("room", "name"),
    [
        ("absorbers", "Design"),
        ("isolators", "clearance_curve"),
        ("mathematics.kelvin_voigt", "identify_viscoelastic"),
        ("methods.closed_form", "exact_density"),
        ("methods.fokker_planck", "Gaussian"),
        ("methods.linearisation", "linearise_many"),
        ("methods.monte_carlo", "record_path"),
        ("methods.periodic", "RandomResonance"),
        ("results", "Interrupted"),
        ("scenes", "RigidBody"),
        ("statistics", "Chance"),
        ("verification", "zoo"),
    ],
)
def test_programs_find_the_names_that_were_at_the_top_once(room: str, name: str) -> None:
    package = importlib.import_module(f"stochvi.{room}")
    assert getattr(stochvi, name) is getattr(package, name)
    assert name not in stochvi.__all__


@pytest.mark.slow
def test_importing_the_package_imports_nothing_heavy() -> None:
    assert loaded_by("import stochvi") == set()
    assert loaded_by("from stochvi import RigidBody, views") == set()
    assert loaded_by("from stochvi.methods import closed_form") > set()


@pytest.mark.slow
@quick_cases(
    ("command", "needed"),
    [
        ("--help", set()),
        ("exact", {"rich", "scipy.optimize"}),
        ("linearise", {"rich", "scipy.optimize"}),
        ("explain", {"rich", "scipy.optimize", "numba"}),
        ("simulate", {"rich", "numba"}),
        (
            "size --probability 0.05 --mission 60 --rel-error 0.2",
            {"rich", "scipy.optimize", "numba", "pandas"},
        ),
    ],
    keep=(0, 1, 3, 4, 5),
)
def test_a_command_imports_what_it_needs_and_nothing_else(command: str, needed: set[str]) -> None:
    scene = [] if command == "--help" else [ISOLATOR if command.startswith("size") else ELASTIC]
    words = command.split() + scene
    start = f"from stochvi.cli import main\nmain({words}, standalone_mode=False)"
    assert loaded_by(start) == needed


@pytest.mark.slow
def test_a_simulation_of_lossy_stops_loads_no_optimisation() -> None:
    words = ["simulate", str(shipped_scene("oscillator-lossy")), "--rel-error", "0.05"]
    start = f"from stochvi.cli import main\nmain({words}, standalone_mode=False)"
    assert loaded_by(start) == {"rich", "numba"}
