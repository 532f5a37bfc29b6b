"""The files that CONTRIBUTING names exist, and so do the functions and classes in them."""

from __future__ import annotations

import ast
import builtins
import importlib
import inspect
import keyword
import os
import pkgutil
import re
import subprocess
import sys
import sysconfig
import tomllib
import venv
import zipfile
from collections import defaultdict
from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path

import pytest
from hatchling.build import build_wheel

import stochvi
from stochvi.results.base import Result
from stochvi.results.errors import RENAMED
from stochvi.scenes.datasets import shipped_scene
from support import CHECKOUT, words
from support.accuracies import quick_cases
from support.commands import ELASTIC, ISOLATOR

HOUSE = Path(__file__).parents[1]
TEXT = (HOUSE / "CONTRIBUTING.md").read_text("utf-8")
FILES = sorted(set(re.findall(r"`(?:[\w/]+/)?\w+\.(?:pyi?|md|toml)(?=[`:])", TEXT)))


def test_a_citation_names_the_version_and_its_date() -> None:
    """Who cites a version must find which one, and what is not released has no date; a release that
    forgets the file fails here."""
    text = (HOUSE / "CITATION.cff").read_text("utf-8")
    cited = dict(re.findall("^(version|date-released): (.+)$", text, re.MULTILINE))
    project = tomllib.loads((HOUSE / "pyproject.toml").read_text("utf-8"))["project"]
    assert cited["version"] == project["version"]
    changes = (HOUSE / "CHANGELOG.md").read_text("utf-8")
    latest = re.findall("^## (.+)$", changes, re.MULTILINE)[0]
    assert project["version"] in latest
    day = cited.get("date-released", "Unreleased").strip('"')
    assert day in latest


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


def test_the_table_of_places_is_short() -> None:
    """Who looks for something reads it as a whole."""
    table = TEXT.partition("## Where things are")[2].partition("\n\n##")[0]
    assert 20 < len(re.findall(r"^\| (?!looked for)", table, re.MULTILINE)) <= 25


# ------------------------------------------------------------------------------
# What docstrings and comments of the package name exists: files, modules, and what is in them.
# ------------------------------------------------------------------------------


OTHERS = {
    "__pycache__", "anyOf", "fastmath", "intrinsic", "mpi4py",
    "clearance_m", "f1_lower", "f1_upper", "first_order_error", "impact_speed_m_s", "loss_lower",
    "loss_upper", "total_error",
}  # fmt: skip
"""Names of other programs that no code of the package has, and keys that it puts together."""


def words_and_names(text: str) -> tuple[set[str], set[str]]:
    """The words of the code of a file, and the names in backticks in its docstrings and comments.

    Parts of a class are words of the file, and so are those of its strings: keys of answers.
    """
    code, texts = [], re.findall(r"^ *# .*|  # .*", text, re.MULTILINE)
    docstrings = set()
    for each in ast.walk(ast.parse(text)):  # a statement comes before its parts
        if isinstance(each, ast.Expr) and isinstance(each.value, ast.Constant):
            docstrings.add(each.value)
        for key in ("id", "attr", "arg", "name", "asname", "module", "value"):
            if isinstance(word := getattr(each, key, None), str):
                (texts if each in docstrings else code).append(word)
    names = re.findall(r"(?<!`)`([\w/]+(?:\.\w+)*)(?:\(\))?`", "\n".join(texts))
    return set(re.findall(r"\w+", "\n".join(code))), set(names)


@cache
def modules() -> tuple[dict[str, set[str]], dict[str, set[str]]]:
    """Words by module, those of a stub with it, and names by file of the package."""
    words_of: dict[str, set[str]] = defaultdict(set)
    names_of = {}
    for path in [*(HOUSE / "stochvi").rglob("*.py"), *(HOUSE / "stochvi").rglob("*.pyi")]:
        place = path.relative_to(HOUSE)
        found, names_of[str(place)] = words_and_names(path.read_text("utf-8"))
        words_of[".".join(place.with_suffix("").parts).removesuffix(".__init__")] |= found
    return words_of, names_of


def is_there(name: str) -> bool:
    """Whether a name is that of a file, of a module or something in it, or of anything else."""
    first, *others = name.split(".")
    if "NAME" in name:
        return True
    if "/" in name or others[-1:] == ["py"]:
        return any(
            f"/{path.relative_to(HOUSE).as_posix()}".endswith("/" + name.rstrip("/"))
            for room in ("stochvi", "data", "tests")
            for path in [HOUSE / room, *(HOUSE / room).rglob(Path(name).name)]
        )
    words_of, _ = modules()
    parts = {part for module in words_of for part in module.split(".")}
    if first not in parts or others[-1:] in (["svg"], ["csv"], ["png"], ["json"], ["html"]):
        known = parts.union(OTHERS, sys.stdlib_module_names, dir(builtins), *words_of.values())
        return first in known or keyword.iskeyword(first)
    return not others or any(
        f".{module}".endswith(".".join(["", first, *others[:k]])) and {*others[k : k + 1]} <= words
        for module, words in words_of.items()
        for k in range(len(others) + 1)
    )


@pytest.mark.slow
def test_what_docstrings_and_comments_name_is_there() -> None:
    _, names_of = modules()
    there = {name: is_there(name) for name in set().union(*names_of.values())}
    gone = {place: {name for name in names if not there[name]} for place, names in names_of.items()}
    assert {place: names for place, names in gone.items() if names} == {}


@pytest.mark.slow
def test_a_name_that_is_gone_is_found() -> None:
    text = '"""See `text_cells.py`, `engine.law_calls`, `plan.no_one`, `rubber_data`."""\n'
    _, named = words_and_names(text + "# `laws.Hertz`, `plan.of_pair`, `stochvi.scenes.keys`\n")
    gone = {"text_cells.py", "engine.law_calls", "plan.no_one", "rubber_data"}
    assert len(named) == 7 and {name for name in named if not is_there(name)} == gone


# ------------------------------------------------------------------------------
# Every name that the package offers can be imported, and costs nothing before it is used.
# ------------------------------------------------------------------------------


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


WITHOUT_ROOMS = """
import sys

class Missing:
    def find_spec(self, name, *_):
        if name.startswith(ROOMS):
            raise ImportError(name)

sys.meta_path.insert(0, Missing())
import stochvi.cli

for words in COMMANDS:
    stochvi.cli.main(words.split(), standalone_mode=False)
"""
"""A program to which some rooms are missing."""


def test_the_core_works_without_the_rooms_of_their_own(tmp_path: Path) -> None:
    """Regimes under sines, absorbers, identification, and the judge of integrators."""
    rooms = (
        "stochvi.absorbers", "stochvi.identification", "stochvi.methods.periodic",
        "stochvi.verification.testing", "stochvi.statistics.lifetimes",
        "stochvi.isolators.jolt_response",
    )  # fmt: skip

    def done(*commands: str) -> subprocess.CompletedProcess[str]:
        program = WITHOUT_ROOMS.replace("ROOMS", repr(rooms)).replace("COMMANDS", repr(commands))
        return subprocess.run(
            [sys.executable, "-c", program], capture_output=True, text=True, cwd=tmp_path
        )

    found = done(
        "new a.toml", "screen a.toml", "explain a.toml", "size a.toml --probability 1% --out out"
    )
    assert found.returncode == 0, found.stderr
    assert "Make 11." in found.stdout
    missing = done("sine a.toml --from 5 --to 6 --points 3")
    assert missing.returncode != 0 and "ImportError" in missing.stderr


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
        ("methods.periodic", "StructureResonance"),
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
    assert name in dir(stochvi)


@pytest.mark.parametrize(("old", "name"), RENAMED.items())
def test_a_name_of_an_earlier_version_is_found_with_a_warning(old: str, name: str) -> None:
    for place in (stochvi, *([stochvi.isolators] if old == "jolts" else [])):
        with pytest.warns(DeprecationWarning, match=f"^{old} is called {name} now") as told:
            found = getattr(place, old)
        assert found is getattr(stochvi, name)
        assert [Path(each.filename).name for each in told] == [Path(__file__).name]
        assert old not in dir(place)


def test_every_name_that_is_listed_is_found() -> None:
    assert {*stochvi.__all__, "Duffing", "Pulses", "Statistic", "judge"} <= {*dir(stochvi)}
    for name in dir(stochvi):
        assert getattr(stochvi, name) is not None


LONGEST_SIGNATURE, LONGEST_OF_ANSWER = 720, 1220
"""Letters of the signature with which the help on a public name begins: nine lines of a terminal.
Answers have more fields, and users make none: that of a size holds one gap, several, and phases."""


@pytest.mark.parametrize("name", sorted(dir(stochvi)))
def test_help_begins_with_a_signature_that_fits_on_a_screen(name: str) -> None:
    public = getattr(stochvi, name)
    own = vars(public) if isinstance(public, type) else {}
    for each in [public, *(function for key, function in own.items() if key[0] != "_")]:
        kind = each if isinstance(each, type) else object
        if callable(each) and not issubclass(kind, Exception | dict):  # Python tells none of these
            of_answer = issubclass(kind, Result)
            signature = str(inspect.signature(each))
            assert len(signature) < (LONGEST_OF_ANSWER if of_answer else LONGEST_SIGNATURE)
            assert "Validator" not in signature


@pytest.mark.slow
def test_importing_the_package_imports_nothing_heavy() -> None:
    assert loaded_by("import stochvi") == set()
    assert loaded_by("from stochvi import RigidBody, views") == set()
    assert loaded_by("from stochvi.methods import monte_carlo") > set()


@pytest.mark.slow
@quick_cases(
    ("command", "needed"),
    [
        ("--help", set()),
        ("exact", {"rich"}),
        ("linearise", {"rich", "scipy.optimize"}),
        ("explain", {"rich", "scipy.optimize", "numba"}),
        ("simulate", {"rich", "numba"}),
        (
            "size --probability 0.05 --mission 60 --rel-error 0.2",
            {"rich", "scipy.optimize", "numba"},
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


# ------------------------------------------------------------------------------
# The walls of the house, as far as `lint-imports` does not hold them.
# ------------------------------------------------------------------------------


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
    named = ("fem", "files", "ide", "mf4", "distributed", "test")
    lines = [*project["dependencies"], *(line for extra in named for line in extras[extra])]
    declared = {re.split(r"[^\w-]", line)[0].lower().replace("-", "_") for line in lines}
    imported = set().union(*(third_party(file) for file in CHECKOUT.glob("stochvi/**/*.py")))
    # a notebook brings IPython, dask[distributed] distributed, anywidget traitlets, and pydantic
    # its core
    brought = {"ipython", "distributed", "traitlets", "pydantic_core"}
    assert {each.lower() for each in imported} - declared - brought == set()


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


# ------------------------------------------------------------------------------
# The wheel carries the data: installed into a fresh environment it finds its profiles.
# ------------------------------------------------------------------------------


PROBE = """
import stochvi, stochvi.scenes.datasets as d
print(stochvi.__file__)
print(len(d.profiles()), d.shipped_scene("isolator-truck").is_file(), d.data_folder())
from stochvi.views.pages import Page
from stochvi.results.files import Origin
page = Page(
    title="t", subtitle="s", verdict="v", cards=[], sections=[],
    origin=Origin(time="2000-01-01", version="0"),
)
print("<html" in page.html(), len(d.scene_files("isolator-bumper")))
"""


@pytest.mark.slow
def test_wheel_in_a_fresh_environment_finds_its_data(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(CHECKOUT)
    wheel = tmp_path / build_wheel(str(tmp_path))
    fresh = tmp_path / "fresh"
    venv.create(fresh, with_pip=False)
    python = fresh / "bin" / "python"
    # a wheel without compiled code is installed by unpacking it, which is all that pip would do
    (packages,) = fresh.rglob("site-packages")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(packages)
    # the dependencies are borrowed; the package is not: a path entry ignores editable installs
    borrowed = os.environ | {"PYTHONPATH": sysconfig.get_path("purelib")}
    told = subprocess.run(
        [str(python), "-c", PROBE], check=True, capture_output=True, text=True, env=borrowed,
        cwd=tmp_path,
    ).stdout.splitlines()  # fmt: skip
    assert Path(told[0]).is_relative_to(fresh)
    assert told[1].startswith("8 True")
    assert str(fresh) in told[1]
    assert told[2] == "True 2"


# ------------------------------------------------------------------------------
# One term for each thing: variants that are not used any more become fewer in every room.
# ------------------------------------------------------------------------------


KEPT = tomllib.loads(words.COUNTS.read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def now() -> dict[str, dict[str, int]]:
    return words.counts()


def test_no_room_says_a_variant_more_often(now: dict[str, dict[str, int]]) -> None:
    more = [
        f"{room}: {name}: {number}, at most {KEPT.get(room, {}).get(name, 0)}"
        for room, here in now.items()
        for name, number in here.items()
        if number > KEPT.get(room, {}).get(name, 0)
    ]
    assert more == [], "use the words of docs/explanation/glossary.md"


def test_variants_are_found_and_code_is_not() -> None:
    text = words.prose("The chance of a hit is `chance`; {chance} blows, $hits$, --first-hits.")
    found = {name for name, pattern in words.TERMS.items() if words.re.search(pattern, text)}
    assert found == {"chance, say probability", "a hit, say an impact", "blow, say impact"}


def test_a_long_sentence_is_found() -> None:
    assert words.long_sentences(f"Short. {'word ' * 26}.") == 1
    assert words.long_sentences(f"Short. {'word ' * 25}.") == 0


# ------------------------------------------------------------------------------
# Every study can be made in short and elsewhere: `--quick` and `--out` are how it is tried out.
# ------------------------------------------------------------------------------


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
