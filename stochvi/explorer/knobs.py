"""The knobs of a scene: its numbers, by the keys that `sweep` varies, with words, unit and range.

Ranges come from the schema of scenes where it bounds a key, so that a new law has its knobs.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from functools import cache
from typing import Any, NamedTuple

from stochvi.results.errors import SceneError
from stochvi.scenes.datasets import profiles
from stochvi.scenes.keys import changed_scene, key_unit, scene_schema
from stochvi.scenes.scene import Scene

WORDS = {
    "frequency_hz": "natural frequency",
    "zeta": "damping ratio",
    "lower": "lower stop",
    "upper": "upper stop",
    "coefficient": "restitution",
    "level_db": "level",
    "stiffness": "stiffness",
}
"""What a knob is called, where its key says it in other words."""

UNITS = {"level_db": "dB"}

RANGES = {
    "level_db": (-12.0, 12.0),
    "coefficient": (0.05, 1.0),
    "mission": (60.0, 36_000.0),
    "probability": (1e-6, 0.5),
}
"""Ranges of numbers that have no scale of their own."""

REACH = 4.0
"""Factor by which a knob goes beyond the number of the scene, either way."""


class Knob(NamedTuple):
    """A number that can be turned, in SI units, between two ends."""

    key: str
    words: str
    unit: str
    value: float
    low: float
    high: float
    logarithmic: bool


MISSION = Knob("mission", "mission", "s", 3600.0, *RANGES["mission"], True)
PROBABILITY = Knob("probability", "accepted probability", "", 0.01, *RANGES["probability"], True)
TARGETS = (MISSION, PROBABILITY)
"""Knobs of the question, not of the scene."""


def knobs_of(scene: Scene) -> list[Knob]:
    """The knobs of a scene, in the order of its file."""
    document = scene.document(as_written=True)
    parts = [("structure", document["structure"])]
    for list_name in ("impact_pair", "excitation"):
        parts += [(f"{list_name}.{i}", part) for i, part in enumerate(document[list_name])]
        if list_name == "impact_pair":
            for i, pair in enumerate(document[list_name]):
                laws = [name for name in ("law", "lower_law", "upper_law") if name in pair]
                parts += [(f"{list_name}.{i}.{name}", pair[name]) for name in laws]
    return [knob for key, part in parts for knob in _of_part(document, key, part)]


def _of_part(document: Mapping[str, Any], key: str, part: Mapping[str, Any]) -> Iterator[Knob]:
    """The knobs of the numbers that stand directly in a part of a scene."""
    for name, value in part.items():
        number = isinstance(value, int | float) and not isinstance(value, bool)
        if not number or name.endswith("_tolerance") or not (value or name in RANGES):
            continue
        words = WORDS.get(name, name.replace("_", " "))
        unit = UNITS.get(name) or key_unit(document, part, name)
        low, high = _range(str(part.get("kind", "")), name, float(value))
        yield Knob(
            f"{key}.{name}", words, unit, float(value), low, high, low > 0.0 and name not in RANGES
        )


def _range(kind: str, name: str, value: float) -> tuple[float, float]:
    """The ends of a knob, both within what the schema allows."""
    least, most = _bounds().get((kind, name), (-math.inf, math.inf))
    if name in RANGES:
        return RANGES[name]
    if math.isfinite(least) and math.isfinite(most):
        return least, most
    low, high = sorted((value / REACH, value * REACH))
    return max(low, least), min(high, most)


@cache
def _bounds() -> dict[tuple[str, str], tuple[float, float]]:
    """Bounds of the schema, by the kind of a part and the name of a key."""
    found = {}
    for part in scene_schema()["$defs"].values():
        properties = part.get("properties", {})
        kind = properties.get("kind", {}).get("const", "")
        for name, each in properties.items():
            number = each if "type" in each else each.get("oneOf", [{}])[0]
            least = number.get("minimum", number.get("exclusiveMinimum", -math.inf))
            most = number.get("maximum", number.get("exclusiveMaximum", math.inf))
            found[kind, name] = (least, most)
    return found


def profile_of(scene: Scene) -> str | None:
    """The shipped profile that shakes a scene; None where it is not one alone."""
    excitations = scene.document()["excitation"]
    return excitations[0].get("profile") if len(excitations) == 1 else None


def turned(scene: Scene, values: Mapping[str, Any], profile: str | None = None) -> Scene:
    """A scene whose knobs stand at some values.

    Nothing else of it can be set, least of all the name of a file: values come from a browser.
    Raises `ValueError`, as `SceneError` where the scene refuses them together.
    """
    document = scene.document(as_written=True)
    if profile is not None:
        if profile_of(scene) is None or profile not in profiles():
            raise ValueError("profile must be one that ships, for a scene that has one")
        document["excitation"][0]["profile"] = profile
    known = {knob.key: knob for knob in knobs_of(scene)}
    change = tuple((key, checked(known.get(key), key, value)) for key, value in values.items())
    try:
        return changed_scene(document, change)
    except SceneError as reason:
        raise ValueError(str(reason).removeprefix("vary: ")) from None


def checked(knob: Knob | None, key: str, value: Any) -> float:
    """A value within the range of its knob; `ValueError` otherwise."""
    if knob is None:
        raise ValueError(f"values must name knobs of this scene, got {key[:60]!r}")
    number = isinstance(value, int | float) and not isinstance(value, bool)
    # a slider may miss the end of its range by a rounding
    slack = 1e-9 * max(abs(knob.low), abs(knob.high))
    if not number or not knob.low - slack <= value <= knob.high + slack:
        raise ValueError(
            f"{knob.words} must be in [{knob.low:g}, {knob.high:g}] {knob.unit}".rstrip()
        )
    return min(max(float(value), knob.low), knob.high)
