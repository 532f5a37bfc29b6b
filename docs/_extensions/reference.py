"""Pages that are written from the code and the studies before every build, into `generated/`."""

from __future__ import annotations

import importlib
import inspect
import itertools
import re
import sys
import tomllib
import zlib
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment
from sphinx.pycode import ModuleAnalyzer

import stochvi
from stochvi.methods import averaging, closed_form, fokker_planck
from stochvi.methods.linearisation import linearise
from stochvi.model.model import model_of
from stochvi.motion.choose_plan import make_plan
from stochvi.results.errors import NotApplicable, NotConverged
from stochvi.scenes.datasets import data_folder
from stochvi.scenes.keys import scene_schema

SUBJECTS = {
    "scenes": "Scenes, structures and stops",
    "scenes.excitations": "Excitations and records",
    "isolators": "Screening and sizing",
    "methods.replay": "Replay of records",
    "methods.monte_carlo": "Simulation",
    "statistics": "Impacts, spectra and rare events",
    "methods.closed_form": "Closed forms",
    "methods.fokker_planck": "Fokker-Planck equation and first passages",
    "methods.linearisation": "Linearisation",
    "methods.averaging": "Averaging",
    "methods.periodic": "Motion under a sine",
    "absorbers": "Impact absorbers",
    "identification": "The law of a stop from a test",
    "verification": "Checks, price and explanation",
    "testing": "Judges of other integrators",
    "testing.samples": "Tests of any Monte Carlo",
    "results": "Answers, estimates and errors",
    "views.density": "Pictures of densities",
}
"""Packages of public names and their subjects, in the order in which a reader needs them."""

HOMES = {
    "sweeps": "scenes",
    "verification.testing": "testing",
    "model": "results",
    "views": "views.density",
}
"""Subjects of names at the top of the package whose own package has no page."""


def write_pages(app: Sphinx) -> None:
    """Write every page, and remove those of an earlier build that are no more.

    A page that has not changed is left alone, so that it is not built again.
    """
    folder = Path(app.srcdir) / "generated"
    folder.mkdir(exist_ok=True)
    pages = dict(api_pages()) | {
        "scene-file.md": scene_file_page(), "coverage.md": coverage_page(),
        "judges.md": judges_page(Path(app.srcdir) / "judges.toml"),
    }  # fmt: skip
    pages |= study_pages()
    for old in folder.rglob("*"):
        if old.is_file() and old.relative_to(folder).as_posix() not in pages:
            old.unlink()
    for name, text in pages.items():
        path = folder / name
        path.parent.mkdir(exist_ok=True)
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")


def api_pages() -> Iterator[tuple[str, str]]:
    """A page for each subject: the names that its package offers, those at the top included."""
    top = [name for name in stochvi.__all__ if not inspect.ismodule(getattr(stochvi, name))]
    at_top = {id(getattr(stochvi, name)): name for name in top}
    for room, title in SUBJECTS.items():
        package = importlib.import_module(f"stochvi.{room}")
        names = list(getattr(package, "__all__", ())) or public_names(package)
        own = [
            f"stochvi.{room}.{name}" for name in names
            if id(getattr(package, name)) not in at_top
            and f"{room}.{name}" not in SUBJECTS
            and (room != "scenes" or home_of(getattr(package, name)) == room)
        ]  # fmt: skip
        if room == "scenes.excitations":
            scenes = importlib.import_module("stochvi.scenes")
            own = [
                f"stochvi.scenes.{name}" for name in scenes.__all__
                if home_of(getattr(scenes, name)) == room
                and id(getattr(scenes, name)) not in at_top
            ]  # fmt: skip
        first = [f"stochvi.{name}" for name in top if home_of(getattr(stochvi, name)) == room]
        yield f"api/{room}.rst", api_page(room, title, first, own)


def home_of(each: Any) -> str:
    """The subject of a public name, by the module that defines it."""
    module = getattr(each, "__module__", "").removeprefix("stochvi.")
    if module.startswith(("scenes.excitations", "scenes.record")):
        return "scenes.excitations"
    known = [room for room in (*SUBJECTS, *HOMES) if f"{module}.".startswith(f"{room}.")]
    found = max(known, key=len, default="results")
    return HOMES.get(found, found)


def public_names(module: Any) -> list[str]:
    """Functions and classes that a module without `__all__` defines."""
    return [
        name for name, each in vars(module).items()
        if not name.startswith("_") and getattr(each, "__module__", "") == module.__name__
    ]  # fmt: skip


def api_page(room: str, title: str, first: list[str], own: list[str]) -> str:
    """The page of a subject: what it is, and every name with its signature and docstring."""
    place = f"stochvi.{room}"
    module = importlib.import_module(place)
    summary = inspect.cleandoc(module.__doc__ or "").split("\n\n")[0].replace("\n", " ")
    parts = [title, "=" * len(title), "", re.sub(r"`([^`]+)`", r"``\1``", summary), ""]
    for heading, names in (("Names most programs use", first), (f"More in ``{place}``", own)):
        if not names:
            continue
        parts += [heading, "-" * len(heading), ""]
        for name in names:
            parts += directive_of(name)
    return "\n".join(parts)


def directive_of(name: str) -> list[str]:
    """The lines that let Sphinx document a name."""
    package, _, last = name.rpartition(".")
    each = getattr(importlib.import_module(package), last)
    if inspect.isclass(each):
        body = [
            f".. autoclass:: {name}",
            "   :members:",
            "   :exclude-members: model_config, model_post_init",
        ]
    elif callable(each):
        body = [f".. autofunction:: {name}"]
    else:
        body = [f".. py:data:: {name}", "", *(f"   {line}" for line in meaning_of(package, last))]
    return [*body, ""]


def meaning_of(package: str, constant: str) -> list[str]:
    """The lines below the assignment of a constant, in whichever module of ours it is."""
    value = getattr(sys.modules[package], constant)
    for name, module in list(sys.modules.items()):
        if name.startswith("stochvi.") and getattr(module, constant, None) is value:
            found = ModuleAnalyzer.for_module(name).find_attr_docs().get(("", constant))
            if found:
                return found
    raise LookupError(f"{package}.{constant} has no docstring below its assignment")


def scene_file_page() -> str:
    """Every key of a scene file, from its schema: type, default, and meaning."""
    schema = scene_schema()
    parts = schema["$defs"]
    text = [
        "# The scene file",
        "",
        "A scene file is TOML. The tables below list every key; they are written from the code, as "
        "is the schema that `stochvi schema` prints. `stochvi new` writes a scene with comments. "
        "Keys in bold must be there; others have the default that is stated, or are one of several "
        "ways to say the same.",
        "",
        "## The whole file",
        "",
        *table_of(schema),
    ]
    for heading, names in groups(parts).items():
        text += ["", f"## {heading}"]
        for name in names:
            kind = parts[name]["properties"].get("kind", {}).get("const")
            title = f'`kind = "{kind}"`' if kind else name_in_words(name)
            part = getattr(stochvi.scenes, name, None)
            if hasattr(part, "is_damper"):
                title += " (damper)" if part.is_damper else " (spring)"
            text += ["", f"### {title}", "", parts[name]["description"], "", *table_of(parts[name])]
    return "\n".join(text) + "\n"


def groups(parts: Mapping[str, Any]) -> dict[str, list[str]]:
    """The parts of a scene by what they are."""
    found: dict[str, list[str]] = {
        "Structures: `[structure]`": [], "Stops: `[[impact_pair]]`": ["ImpactPair"],
        "Impact laws: `law`": [], "Excitations: `[[excitation]]`": [],
        "Springs and dampers that are functions: `spring`, `damper`": [],
        "Absorbers, phases, vehicles and what else a scene may hold": [],
    }  # fmt: skip
    heads = list(found)
    for name in parts:
        kind = getattr(stochvi.scenes, name, None)
        home = "" if kind is None else kind.__module__
        if "structures" in home or ("rigid" in home and "impact_laws" not in home):
            found[heads[0]].append(name)
        elif "impact_laws" in home:
            found[heads[2]].append(name)
        elif "excitations" in home:
            found[heads[3]].append(name)
        elif "characteristics" in home:
            found[heads[4]].append(name)
        elif name != "ImpactPair":
            found[heads[0 if name == "Mount" else 5]].append(name)
    return found


def name_in_words(name: str) -> str:
    """The name of a class as words: ImpactPair, impact pair."""
    return re.sub(r"(?<!^)(?=[A-Z])", " ", name).capitalize()


def table_of(part: Mapping[str, Any]) -> list[str]:
    """Rows of the keys of a part, `kind` first; keys that share a meaning share a row."""
    rows = ["| key | value | default | meaning |", "|---|---|---|---|"]
    required = part.get("required", [])
    keys = sorted(part["properties"].items(), key=lambda item: item[0] != "kind")
    for meaning, group in itertools.groupby(keys, key=lambda item: item[1].get("description", "")):
        names, values, defaults = [], [], []
        for key, each in group:
            names.append(f"**`{key}`**" if key in required else f"`{key}`")
            values.append(type_of(each))
            default = each.get("default", "")
            if default not in ("", [], None) and key != "kind":
                shown = f"{default:.6g}" if isinstance(default, float) else str(default).lower()
                defaults.append(f"`{shown}`")
        if not meaning or len(set(values)) == 1:
            values = values[:1]
        said = meaning.replace("|", "\\|").replace("*", "\\*")
        rows.append(
            f"| {', '.join(names)} | {'; '.join(values)} | {', '.join(defaults)} | {said} |"
        )
    return rows


def type_of(schema: Mapping[str, Any]) -> str:
    """A schema in words."""
    if "const" in schema:
        return f'`"{schema["const"]}"`'
    if "enum" in schema:
        return ", ".join(f'`"{each}"`' for each in schema["enum"])
    if "$ref" in schema:
        return "a table of keys"
    for choice in ("anyOf", "oneOf"):
        if choice in schema:
            return " or ".join(dict.fromkeys(type_of(each) for each in schema[choice]))
    if schema.get("type") == "array":
        inner = schema.get("items") or (schema.get("prefixItems") or [{}])[0]
        return f"list of: {type_of(inner)}"
    limit = (
        ", above 0"
        if schema.get("exclusiveMinimum") == 0
        else (", 0 or above" if schema.get("minimum") == 0 else "")
    )
    names = {
        "number": "number",
        "integer": "whole number",
        "string": "text",
        "boolean": "true or false",
    }
    return names.get(schema.get("type", ""), "a table of names and values") + limit


DEVELOPERS = ("02", "05", "11", "13", "14", "15", "16", "23")
"""Studies of the package itself, which users do not need."""


def study_pages() -> dict[str, str]:
    """A page of each study, the gallery of tasks, and the lists of studies."""
    found: dict[str, str] = {}
    listed: dict[str, list[str]] = {"users": [], "developers": []}
    for readme in sorted(STUDIES.glob("*/README.md")):
        folder = readme.parent.name
        text = readme.read_text(encoding="utf-8")
        title = text.partition("\n")[0].removeprefix("# ")
        question = re.search(r"\*\*Question\.\*\* (.*?)\n\n", text, re.DOTALL)
        text = re.sub(r"\]\((\w+\.png)\)", rf"](../../../studies/{folder}/\1)", text)
        found[f"studies/{folder}.md"] = f"{text}\nThe study lies in `studies/{folder}`.\n"
        asked = " ".join(question[1].split()) if question else ""
        reader = "developers" if folder[:2] in DEVELOPERS else "users"
        listed[reader] += [f"## [{title}](studies/{folder}.md)", "", asked, ""]
    found["studies.md"] = "\n".join([
        "# Studies", "",
        "Each study is a question, an answer with its error, the command that makes it, and its "
        "numbers in `result.csv`. Times are those of a core or two of an AMD EPYC. `make studies` "
        "makes all of them again.", "",
        *listed["users"], *toctree(sorted(name for name in found if name[8:10] not in DEVELOPERS)),
    ])  # fmt: skip
    found["bench.md"] = "\n".join([
        "# Studies of the package itself", "",
        "Price, calibration, faults and budgets: for those who work on stochvi.", "",
        *listed["developers"], *toctree(sorted(
            name for name in found if name[8:10] in DEVELOPERS and name.startswith("studies/"))),
    ])  # fmt: skip
    found["gallery.md"] = gallery_page()
    return found


def toctree(names: list[str]) -> list[str]:
    """A hidden table of contents of pages."""
    return [
        "```{toctree}",
        ":hidden:",
        "",
        *(name.removesuffix(".md") for name in names),
        "```",
        "",
    ]


def gallery_page() -> str:
    """The gallery of tasks: scene file, picture, command, numbers and time of each."""
    source = Path(__file__).parents[1] / "tasks.toml"
    tasks = tomllib.loads(source.read_text(encoding="utf-8"))["task"]
    text = [
        "# Gallery of tasks",
        "",
        "Each task has a scene file to download, the command, the numbers of its study, and the "
        "time of the command on two cores. Tables that a scene names lie beside it in the package: "
        "`stochvi new` writes both.",
        "",
    ]
    for task in tasks:
        readme = (STUDIES / task["study"] / "README.md").read_text(encoding="utf-8")
        title = readme.partition("\n")[0].removeprefix("# ")
        text += [
            f"## {task['title']}", "",
            f"![{task['title']}: {title}](../../studies/{task['study']}/figure.png)", "",
            task["answer"], "",
            f"```\n{task['command']}\n```", "",
            f"{{download}}`{Path(task['scene']).name}.toml "
            f"<../../data/scenes/{task['scene']}.toml>` · {task['time']} · "
            f"study [{title}](studies/{task['study']}.md)", "",
        ]  # fmt: skip
    return "\n".join(text)


STUDIES = Path(__file__).parents[2] / "studies"
"""The folder of studies."""

METHODS: dict[str, Callable[[Any, Any], list[str]]] = {
    "exact": lambda scene, model: closed_form.unmet(model),
    "fokker_planck": lambda scene, model: fokker_planck.unmet(model),
    "first_passage": lambda scene, model: fokker_planck.unmet_by_first_passage(model, None, None),
    "transient": lambda scene, model: fokker_planck.unmet_by_transient(model),
    "average": lambda scene, model: averaging.unmet(model),
    "linearise": lambda scene, model: refusal(lambda: linearise(scene)),
    "simulate": lambda scene, model: refusal(lambda: make_plan(model)),
    "screen": lambda scene, model: refusal(lambda: stochvi.screen(scene)),
}
"""What each method says of a scene: the conditions that it does not meet."""


def judges_page(source: Path) -> str:
    """Every quantity of every answer, and the tests and studies that hold it against something that
    is known from elsewhere."""
    table = tomllib.loads(source.read_text(encoding="utf-8"))
    text = [
        "# Who judges each number",
        "",
        "Every quantity in the documents of answers, by the class that holds it "
        "([API](../reference/api.md)), with the tests and studies that hold it against something "
        "that shares no code with it: a closed form, another method, a plain integration, brute "
        "force. A quantity that is missing here, and a test that is not there, fail "
        "`tests/verification/test_every_kind.py`.",
    ]  # fmt: skip
    for group, heading in (
        ("judged", "| answer or part | quantities | judged by |"),
        ("tables", "| answer | further columns of its tables | judged by |"),
    ):
        text += ["", heading, "|---|---|---|"]
        for name, rows in table[group].items():
            for number, (keys, judges) in enumerate(rows.items()):
                words = ", ".join(f"`{key}`" for key in keys.split())
                known = judges == "asked"
                named = (
                    "the question, repeated" if known else ", ".join(map(_judge_in_words, judges))
                )
                text.append(f"| {'' if number else f'`{name}`'} | {words} | {named} |")
    for group, title in (
        ("asked", "What the question or the scene says, repeated"),
        ("work", "Time and work on the machine, counted or measured"),
    ):
        text += ["", f"## {title}", "", "| answer or part | quantities |", "|---|---|"]
        for name, keys in table[group].items():
            text.append(f"| `{name}` | {', '.join(f'`{key}`' for key in keys.split())} |")
    return "\n".join(text) + "\n"


def _judge_in_words(judge: str) -> str:
    """A test in words with its file, or the link to a study."""
    if judge.startswith("study "):
        number = judge.removeprefix("study ")
        (folder,) = STUDIES.glob(f"{number}_*")
        return f"[{judge}](studies/{folder.name}.md)"
    file, _, name = judge.partition("::")
    room, _, stem = file.rpartition("/")
    return f"{name.replace('_', ' ')} (`{room}/test_{stem}.py`)"


def refusal(run: Callable[[], Any]) -> list[str]:
    """The conditions by which a method refuses a scene."""
    try:
        run()
    except NotApplicable as error:
        return list(error.conditions)
    except NotConverged as error:
        return [str(error)]
    return []


def unmet_of(file: Path) -> dict[str, list[str]]:
    """The conditions of each method that the scene of a file does not meet."""
    scene = stochvi.load_scene(file)
    model = model_of(scene)
    return {name: ask(scene, model) for name, ask in METHODS.items()}


def coverage_page() -> str:
    """A table of the scenes that ship and the methods that cover them, and why others do not."""
    folder = data_folder() / "scenes"
    files = [*sorted(folder.glob("*.toml")), *sorted((folder / "zoo").glob("*.toml"))]
    alike: dict[tuple[str, ...], list[str]] = {}
    reasons: dict[str, dict[str, dict[str, None]]] = {name: {} for name in METHODS}
    with ProcessPoolExecutor() as processes:
        found = list(processes.map(unmet_of, files, chunksize=8))
    for file, unmet in zip(files, found, strict=True):
        for name, conditions in unmet.items():
            for each in conditions:
                reasons[name].setdefault(each.split(", got ")[0], {})[file.stem] = None
        covering = tuple(name for name, conditions in unmet.items() if not conditions)
        alike.setdefault(covering, []).append(file.stem)
    text = [
        "# Which method covers which scene",
        "",
        "Every scene that ships, and which methods cover it. The table is made from what the "
        "methods say of themselves; where a method is not named, it refuses the scene in one of "
        "the sentences below. `stochvi explain` says the same of a scene of your own. These "
        "methods answer for the stationary motion, except `first_passage` and `transient`. "
        "[Limits](../reference/limits.md) has `size`, `reliability`, `damage` and `replay`.",
        "",
        "| methods | scenes |",
        "|---|---|",
        *(
            f"| {', '.join(f'`{name}`' for name in methods)} | {', '.join(scenes)} |"
            for methods, scenes in sorted(alike.items(), key=lambda each: -len(each[0]))
        ),
        "",
        "## Why a method does not apply",
    ]
    for name, found in reasons.items():
        text += ["", f"### `{name}`", ""]
        text += [
            f"- {each.replace('*', chr(92) + '*')} ({', '.join(list(scenes)[:3])}"
            f"{f' and {len(scenes) - 3} more' if len(scenes) > 3 else ''})"
            for each, scenes in found.items()
        ] or ["It refuses none of these scenes."]  # fmt: skip
    return "\n".join(text) + "\n"


def escape_bars(
    app: Sphinx, what: str, name: str, each: Any, options: Any, lines: list[str]
) -> None:
    """Let sizes as |x| in docstrings be what they are: a substitution is not meant."""
    lines[:] = [
        line if line.lstrip().startswith((">>>", "..")) else re.sub(r"\|(?![^`]*`)", r"\\|", line)
        for line in lines
    ]  # fmt: skip


def spread(app: Sphinx, env: BuildEnvironment, docnames: list[str]) -> None:
    """Spread the pages that take long evenly: processes read parts of the list at the same time."""

    def mixed(name: str) -> int:
        """A number for an order that is the same each time, and not that of the alphabet."""
        return zlib.crc32(name.encode())

    slow = {
        name for name in docnames
        if name.startswith("generated/api") or "mystnb" in env.doc2path(name).read_text("utf-8")
    }  # fmt: skip
    placed = [
        ((place + 0.5) / len(names), name)
        for names in (sorted(slow, key=mixed), [name for name in docnames if name not in slow])
        for place, name in enumerate(names)
    ]
    docnames[:] = [name for _, name in sorted(placed)]


def setup(app: Sphinx) -> dict[str, Any]:
    """Write the pages when a build begins."""
    app.connect("builder-inited", write_pages)
    app.connect("env-before-read-docs", spread)
    app.connect("autodoc-process-docstring", escape_bars, priority=900)  # after numpydoc
    return {"parallel_read_safe": True, "parallel_write_safe": True}
