"""What a page can take away of a design: its scene as a file, the command line and the lines of
Python that give the same answer, the report, and tables."""

from __future__ import annotations

import json
import re
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import asdict, replace
from typing import Any, NamedTuple

import numpy as np

from stochvi.absorbers.performance import absorber
from stochvi.explorer.knobs import Design, kind_of
from stochvi.isolators.sizing.answer import Sizing
from stochvi.isolators.sizing.review import ReviewSettings, review
from stochvi.isolators.sizing.size import risk_curve, size
from stochvi.isolators.tolerances import KEYS, UNITS, Tolerances
from stochvi.methods.periodic import harmonic_response
from stochvi.results.files import origin_of
from stochvi.scenes.scene import Scene
from stochvi.views.pictures import write_report

CommandLine = Callable[[str, str, Mapping[str, Any]], str]
"""The command line of a command, a file and arguments."""

SCENE = "design.toml"
"""Name of the scene file that the other files name."""

LEVELS_DB = (-6.0, 0.0, 6.0)
"""Levels at which an absorber is judged, dB about that of the scene."""

ABSORBED = 0.05
"""Relative error of what an absorber leaves."""

SPAN, SINES = 0.4, 25
"""Part by which frequencies reach beyond that of a sine, either way, and their odd number: its own
is among them."""

BUDGET = 60.0
"""Largest time of what is taken away, s."""


# ------------------------------------------------------------------------------
# The question that a design asks, as a command and as a call.
# ------------------------------------------------------------------------------


class Question(NamedTuple):
    """A command with its arguments, and a call of the package with its own."""

    command: str
    options: dict[str, Any]
    call: str
    arguments: dict[str, Any]


def question_of(design: Design, seed: int) -> Question:
    """The question of a design."""
    kind = kind_of(design.scene)
    if kind == "absorber":
        shares = {"rel_error": ABSORBED, "seed": seed}
        levels = ",".join(f"{each:g}" for each in LEVELS_DB)
        return Question("absorber", {"levels": levels, **shares}, "absorber",
                        {"levels_db": LEVELS_DB, **shares})  # fmt: skip
    if kind == "sine":
        start, end = (frequency_of(design.scene) * (1.0 + each) for each in (-SPAN, SPAN))
        return Question("sine", {"start": start, "end": end, "points": SINES}, "harmonic_response",
                        {"frequency_hz": np.linspace(start, end, SINES).tolist()})  # fmt: skip
    asked: dict[str, Any] = {"probability": design.probability, "mission": design.mission}
    options, allowed = dict(asked), design.tolerances
    if allowed != Tolerances():
        asked["tolerances"] = allowed
        options["tolerances"] = ",".join(_limit(each, asdict(allowed)) for each in UNITS
                                         if asdict(allowed).get(KEYS.get(each, each)))  # fmt: skip
    return Question("size", options | {"seed": seed}, "size", asked | {"seed": seed})


def frequency_of(scene: Scene) -> float:
    """The frequency of the sine that shakes a scene, Hz."""
    return float(scene.document()["excitation"][0]["frequency_hz"])


def _limit(quantity: str, limits: Mapping[str, float]) -> str:
    """A tolerance as the option has it."""
    unit, factor = UNITS[quantity]
    return f"{quantity}={limits[KEYS.get(quantity, quantity)] / factor:.12g}{unit}"


def lines_of(question: Question) -> str:
    """The lines of Python that ask a question."""
    given = ", ".join(f"{name}={value!r}" for name, value in question.arguments.items())
    needed = ["import stochvi"]
    if "tolerances" in question.arguments:
        needed.append("from stochvi.isolators.tolerances import Tolerances")
    return "\n".join([
        *needed, "", f'scene = stochvi.load_scene("{SCENE}")',
        f"answer = stochvi.{question.call}(scene, {given})", "print(answer)", "",
    ])  # fmt: skip


# ------------------------------------------------------------------------------
# Files.
# ------------------------------------------------------------------------------


def offers_of(scene: Scene, command: CommandLine | None) -> list[str]:
    """What a page of a scene can take away."""
    reported = ["report"] if kind_of(scene) in ("pair", "box", "absorber") else []
    return ["scene", *(["command"] if command else []), "python", "csv", *reported]


def taken(
    what: str, design: Design, seed: int, command: CommandLine | None
) -> tuple[str, str, str]:
    """Name, kind and text of a file."""
    question = question_of(design, seed)
    line = command(question.command, SCENE, question.options) if command else ""
    match what:
        case "scene":
            return SCENE, "application/toml", toml_of(design.scene.document(as_written=True))
        case "command":
            return "command.txt", "text/plain", line + "\n"
        case "python":
            return "design.py", "text/x-python", lines_of(question)
        case "csv":
            return "design.csv", "text/csv", _table(question, design).to_csv(index=False)
        case "report":
            return "report.html", "text/html", _report(question, design, line)
    raise ValueError(f"what must be one of {', '.join(offers_of(design.scene, command))}")


CALLS: dict[str, Callable[..., Any]] = {
    "size": size, "absorber": absorber, "harmonic_response": harmonic_response,
}  # fmt: skip


def _table(question: Question, design: Design) -> Any:
    """The risk over clearance, or the answer where nothing is sized."""
    if question.call == "size":
        return risk_curve(design.scene, budget=BUDGET, **question.arguments).curve
    found = CALLS[question.call](design.scene, budget=BUDGET, **question.arguments)
    return found.to_frame()


def _report(question: Question, design: Design, line: str) -> str:
    """The page that a command writes."""
    found = CALLS[question.call](design.scene, budget=BUDGET, **question.arguments)
    listing = toml_of(design.scene.document(as_written=True))
    origin = replace(origin_of(found.provenance), command=line, listing=listing)
    beside = {}
    if isinstance(found, Sizing) and not found.several:
        beside["review"] = review(found, settings=ReviewSettings(budget=BUDGET))
    with tempfile.TemporaryDirectory() as folder:
        return write_report(found, folder, origin, **beside).read_text(encoding="utf-8")


# ------------------------------------------------------------------------------
# A scene as a file.
# ------------------------------------------------------------------------------


def toml_of(document: Mapping[str, Any]) -> str:
    """A scene file of a document, with all the digits of its numbers.

    >>> print(toml_of({"title": "a", "structure": {"zeta": 0.1}, "excitation": [{"level_db": 3}]}))
    title = "a"
    <BLANKLINE>
    [structure]
    zeta = 0.1
    <BLANKLINE>
    [[excitation]]
    level_db = 3
    <BLANKLINE>
    """
    lines, parts = [], []
    for name, value in document.items():
        if isinstance(value, Mapping):
            parts += ["", f"[{name}]", *_keys(value)]
        elif isinstance(value, list) and all(isinstance(each, Mapping) for each in value):
            for each in value:
                parts += ["", f"[[{name}]]", *_keys(each)]
        else:
            lines.append(f"{name} = {_written(value)}")
    return "\n".join([*lines, *parts, ""])


def _keys(part: Mapping[str, Any]) -> list[str]:
    return [f"{_key(name)} = {_written(value)}" for name, value in part.items()]


def _key(name: str) -> str:
    return name if re.fullmatch(r"[\w-]+", name, re.ASCII) else _written(name)


def _written(value: Any) -> str:
    """A value as TOML has it; its texts are those of JSON but for one character."""
    if isinstance(value, Mapping):
        return f"{{ {', '.join(_keys(value))} }}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_written, value))}]"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    return json.dumps(value)
