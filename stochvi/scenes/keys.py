"""Keys of a scene file, such as "impact_pair.0.law.coefficient", and scenes with changed values.

A number in a key is the index of an entry in a list, from 0.
"""

from __future__ import annotations

import difflib
import json
import math
from collections.abc import Iterator, Mapping
from typing import Any

from stochvi.results.errors import SceneError
from stochvi.scenes.impact_laws.rubber_data import DAMPING, OF_RUBBER, PAD
from stochvi.scenes.scene import Scene, scene_from

Change = tuple[tuple[str, float], ...]
"""Keys of a scene file, each with its value."""


def written_key(key: str) -> str:
    """A key whose indices are written as plain numbers: 0 instead of 00."""
    words = str(key).split(".")
    return ".".join(str(int(word)) if is_place(word) else word for word in words)


def is_place(word: str) -> bool:
    return word.isascii() and word.isdigit()


def changed_scene(document: Mapping[str, Any], change: Change) -> Scene:
    """The scene of a document with some keys set to other values.

    Raises
    ------
    SceneError
        If there is no such key, with the nearest one that exists; or if the value is refused.
    """
    changed = json.loads(json.dumps(document))
    for key, value in change:
        _set(changed, key, value)
    try:
        return scene_from(changed)
    except SceneError as error:
        values = ", ".join(f"{key} = {value:g}" for key, value in change)
        raise SceneError(f"vary: with {values}, {error}") from None


def _set(document: Any, key: str, value: float) -> None:
    """Set a key of a part of the scene, which need not have a value so far.

    The scene itself has no keys for numbers; only its parts have.
    """
    part, last = holder_of(document, key)
    way = key.split(".")
    if last == "clearance" and way[:1] == ["impact_pair"] and isinstance(part, dict):
        _set_clearance(part, key, value)
    elif (
        isinstance(part, dict)
        and part.get("kind") in OF_RUBBER
        and last in (*DAMPING, *PAD, "stiffness")
        and not isinstance(part.get(last), dict)
    ):
        _set_rubber(part, last, value)
    elif isinstance(part, list) and is_place(last) and int(last) < len(part):
        part[int(last)] = value
    elif way[1:] and isinstance(part, dict) and not isinstance(part.get(last), dict | list | str):
        part[last] = value
    else:
        raise unknown_key(document, key)


def holder_of(document: Any, key: str) -> tuple[Any, str]:
    """The part of a document that holds a key, and the last word of the key."""
    *way, last = key.split(".")
    part = document
    for word in way:
        if isinstance(part, list) and is_place(word) and int(word) < len(part):
            part = part[int(word)]
        elif isinstance(part, dict) and isinstance(part.get(word), dict | list):
            part = part[word]
        else:
            raise unknown_key(document, key)
    return part, last


def _set_rubber(law: dict[str, Any], name: str, value: float) -> None:
    """Set a key of a law, and delete the other keys that would give the same number."""
    others: tuple[str, ...] = (*DAMPING, "at_speed")
    match name:
        case "restitution":
            others = DAMPING
        case "stiffness":
            others = PAD
        case _ if name in PAD:
            others = ("stiffness",)
    for other in others:
        law.pop(other, None)
    law[name] = value


def _set_clearance(pair: Any, key: str, value: float) -> None:
    """Set both stops of an impact pair whose stops are equally far from 0."""
    lower, upper = _places(pair)
    if not _equal_distances(pair):
        have = " and ".join(
            f"{name} = {stop:g}" for name, stop in (("lower", lower), ("upper", upper))
            if stop is not None
        )  # fmt: skip
        raise SceneError(
            f"vary: {key} needs two stops at equal distances, got {have}; vary these instead"
        )
    differs = pair.pop("upper")
    del pair["lower"]
    pair["clearance"] = {**differs, "mean": value} if isinstance(differs, dict) else value


def unknown_key(document: Any, key: str) -> SceneError:
    known = [*(name for name, _ in _numbers(document)), *_clearances(document)]
    within = [name for name in known if name.startswith(f"{key}.") or name.endswith(f".{key}")]
    near = within or difflib.get_close_matches(key, known, n=1, cutoff=0.0)
    return SceneError(
        f"vary: {key} is not a number of the scene; did you mean {near[0]!r}? "
        f"(it has {', '.join(known)})"
    )


def _clearances(document: Any) -> list[str]:
    """The keys `clearance` of the impact pairs whose two stops are equally far from 0."""
    pairs = document.get("impact_pair", [])
    return [f"impact_pair.{n}.clearance" for n, pair in enumerate(pairs) if _equal_distances(pair)]


def _equal_distances(pair: Any) -> bool:
    lower, upper = _places(pair)
    return lower is not None and upper is not None and math.isclose(-lower, upper)


def _places(pair: Any) -> list[Any]:
    """The lower and the upper stop of a pair; where these differ between units, their means."""
    stops = (pair.get("lower"), pair.get("upper"))
    return [each["mean"] if isinstance(each, dict) else each for each in stops]


def _numbers(part: Any, key: str = "") -> Iterator[tuple[str, float]]:
    """Every number of a document, with its key."""
    if isinstance(part, dict | list):
        items = part.items() if isinstance(part, dict) else enumerate(part)
        for name, value in items:
            yield from _numbers(value, f"{key}.{name}".lstrip("."))
    elif isinstance(part, int | float) and not isinstance(part, bool):
        yield key, part
