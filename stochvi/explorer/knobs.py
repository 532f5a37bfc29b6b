"""The knobs of a scene: its numbers, by the keys that `sweep` varies, with words, unit and range;
and the parts of a scene that are chosen beside them: a preset, a profile or a table, a law.

Ranges come from the schema of scenes where it bounds a key, so that a new law has its knobs.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from stochvi.isolators.tolerances import KEYS, NAMES, Tolerances
from stochvi.model.model import model_of
from stochvi.results.errors import SceneError
from stochvi.scenes.datasets import profiles, shipped_scene
from stochvi.scenes.excitations import Sine, TabulatedNoise
from stochvi.scenes.keys import changed_scene, key_unit, scene_schema
from stochvi.scenes.scene import Scene, load_scene, scene_from
from stochvi.scenes.structures import RigidBody

# ------------------------------------------------------------------------------
# Knobs, and their ranges.
# ------------------------------------------------------------------------------


WORDS = {
    "frequency_hz": "natural frequency",
    "zeta": "damping ratio",
    "lower": "lower stop",
    "upper": "upper stop",
    "coefficient": "restitution",
    "level_db": "level",
    "young": "Young's modulus",
    "poisson": "Poisson's ratio",
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

REACH, REACH_OF_STOPS = 4.0, 30.0
"""Factor by which a knob goes beyond the number of the scene, either way; that of the stiffness of
a stop, which may be a pad or a bolt."""


class Knob(NamedTuple):
    """A number that can be turned, in SI units, between two ends. Its group is that of the scene,
    of the question or of the tolerances; `part` names the part of the scene that it belongs to."""

    key: str
    words: str
    unit: str
    value: float
    low: float
    high: float
    logarithmic: bool = False
    group: str = "scene"
    part: str = ""


MISSION = Knob("mission", "mission", "s", 3600.0, *RANGES["mission"], True, "question")
PROBABILITY = Knob(
    "probability", "accepted probability", "", 0.01, *RANGES["probability"], True, "question"
)

TOLERANCES = {
    "frequency": ("", 0.5), "damping": ("", 0.9), "level": ("dB", 6.0), "centre": ("m", 0.02),
}  # fmt: skip
"""Tolerances that a clearance depends on: the unit, and by how much it may be off at most."""


def knobs_of(scene: Scene) -> list[Knob]:
    """The knobs of a scene, in the order of its file."""
    document = scene.document(as_written=True)
    parts = [("structure", "the structure", document["structure"])]
    if "absorber" in document:
        parts += [("absorber", "the absorber", document["absorber"])]
        parts += [("absorber.law", "the absorber", each)
                  for each in [document["absorber"].get("law")] if each]  # fmt: skip
    pairs = [*enumerate(document["impact_pair"])]
    parts += [(f"impact_pair.{i}", pair["name"], pair) for i, pair in pairs]
    for i, pair in pairs:
        laws = [name for name in LAW_KEYS if name in pair]
        parts += [(f"impact_pair.{i}.{name}", pair["name"], pair[name]) for name in laws]
    for i, each in enumerate(document["excitation"]):
        along = f"the excitation along {each['axis']}" if "axis" in each else f"excitation {i + 1}"
        parts += [(f"excitation.{i}", along, each)]
    return [knob for key, name, part in parts for knob in _of_part(document, key, name, part)]


def _of_part(
    document: Mapping[str, Any], key: str, part_name: str, part: Mapping[str, Any]
) -> Iterator[Knob]:
    """The knobs of the numbers that stand directly in a part of a scene."""
    for name, value in part.items():
        # whole numbers count something: modes, units
        if not isinstance(value, float) or name.endswith("_tolerance"):
            continue
        if not (value or name in RANGES):
            continue
        words = WORDS.get(name, name.replace("_", " "))
        if key.startswith("excitation") and name == "frequency_hz":
            words = "frequency of the sine"
        unit = UNITS.get(name) or key_unit(document, part, name)
        reach = REACH_OF_STOPS if (key[:6], name) == ("impact", "stiffness") else REACH
        low, high = _range(str(part.get("kind", "")), name, float(value), reach)
        logarithmic = low > 0.0 and name not in RANGES
        yield Knob(
            f"{key}.{name}", words, unit, float(value), low, high, logarithmic, part=part_name
        )


def _range(kind: str, name: str, value: float, reach: float) -> tuple[float, float]:
    """The ends of a knob, both within what the schema allows."""
    least, most = _bounds().get((kind, name), (-math.inf, math.inf))
    if name in RANGES:
        return RANGES[name]
    if math.isfinite(least) and math.isfinite(most):
        return least, most
    low, high = sorted((value / reach, value * reach))
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


def questions_of(scene: Scene) -> list[Knob]:
    """The knobs of the question: mission, accepted probability, and tolerances. None for a scene
    that is not sized."""
    if kind_of(scene) not in SIZED:
        return []
    stated = asdict(Tolerances.of(scene))
    kept = [
        name for name in TOLERANCES if name != "centre" or isinstance(scene.structure, RigidBody)
    ]
    found = [MISSION, PROBABILITY]
    for name in kept:
        key, (unit, most) = KEYS.get(name, name), TOLERANCES[name]
        value = float(stated[key])
        found.append(
            Knob(f"tolerances.{key}", f"tolerance of the {NAMES[name]}", unit, value, 0.0,
                 max(most, value), group="tolerances")
        )  # fmt: skip
    return found


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


# ------------------------------------------------------------------------------
# The parts of a scene that are chosen: what a page has set, and the design that follows from it.
# ------------------------------------------------------------------------------


PRESETS = {
    "box on a truck": "isolator-truck",
    "box on four mounts": "rigid-box",
    "beam on a bumper": "beam",
    "impact absorber on a tower": "absorber-on-a-tower",
    "isolator under a sine": "isolator-sine",
}
"""Scenes that ship, by what the page calls them."""

LAW_KEYS = ("law", "lower_law", "upper_law")

LAWS: dict[str, dict[str, Any]] = {
    "restitution": {"coefficient": 0.5},
    "viscoelastic": {"damping_ratio": 0.2},
}
"""Laws that all stops of a scene may get, with the numbers that their knobs begin at."""

STIFFER = 100.0
"""Stiffness of a compliant stop at which its knob begins, over that of the mount."""

MOST_ROWS = 4096
"""Largest number of rows of a pasted table."""

LONGEST_CHOICE = 80
"""Letters of the longest name that a choice may have."""

PASTED = "pasted table"
"""What sentences call it, in the place of the name of a file."""


@dataclass(frozen=True)
class Setting:
    """What a page has set: values of knobs by their keys, and choices."""

    values: Mapping[str, Any]
    preset: str | None = None
    profile: str | None = None
    law: str | None = None
    psd: str | None = None

    @classmethod
    def of(cls, message: Mapping[str, Any]) -> Setting:
        """The setting of a message; `ValueError` for one of no known shape."""
        values = message.get("values", {})
        if not isinstance(values, dict) or len(values) > 200:
            raise ValueError("values must be numbers by their keys, at most 200")
        chosen = {name: message.get(name) for name in ("preset", "profile", "law", "psd")}
        for name, each in chosen.items():
            if each is not None and not isinstance(each, str):
                raise ValueError(f"{name} must be a text")
            if name != "psd" and len(each or "") > LONGEST_CHOICE:
                raise ValueError(f"{name} must have at most {LONGEST_CHOICE} letters")
        return cls(values, **chosen)


class Design(NamedTuple):
    """A scene with its knobs turned, and its question."""

    scene: Scene
    mission: float
    probability: float
    tolerances: Tolerances


SIZED = ("pair", "box")
"""Kinds of scenes that need a clearance."""


def kind_of(scene: Scene) -> str:
    """By what the page shows a scene: a pair, a box with several, an absorber, or a sine."""
    if scene.absorber is not None:
        return "absorber"
    if all(isinstance(each, Sine) for each in scene.excitations):
        return "sine"
    several = len(scene.expanded.impact_pairs) > 1 or isinstance(scene.structure, RigidBody)
    return "box" if several else "pair"


def profile_of(scene: Scene) -> str | None:
    """The shipped profile that shakes a scene; None where it is not one alone."""
    return scene.document()["excitation"][0].get("profile") if takes_table(scene) else None


def takes_table(scene: Scene) -> bool:
    """Whether another profile, or a table, can take the place of what shakes a scene."""
    return len(scene.excitations) == 1 and isinstance(scene.excitations[0], TabulatedNoise)


def laws_of(scene: Scene) -> list[str]:
    """Laws that the stops of a scene may have, that which it has first; none where its stops have
    several."""
    own = {pair[name]["kind"] for pair in _pairs(scene) for name in LAW_KEYS if name in pair}
    return [*dict.fromkeys([*own, *LAWS])] if len(own) == 1 else []


def _pairs(scene: Scene) -> list[dict[str, Any]]:
    return scene.document(as_written=True)["impact_pair"]  # type: ignore[no-any-return]


@cache
def preset(name: str) -> Scene:
    """A scene that ships; `ValueError` for another name."""
    if name not in PRESETS:
        raise ValueError(f"preset must be one of {', '.join(PRESETS)}")
    return load_scene(shipped_scene(PRESETS[name]))


def chosen(scene: Scene, setting: Setting) -> Scene:
    """The scene of the choices of a setting, before its knobs are turned."""
    if setting.preset is not None:
        scene = preset(setting.preset)
    document = scene.document(as_written=True)
    if setting.law is not None:
        _set_law(scene, document, setting.law)
    if setting.profile is not None:
        if profile_of(scene) is None or setting.profile not in profiles():
            raise ValueError("profile must be one that ships, for a scene that has one")
        document["excitation"][0]["profile"] = setting.profile
    if setting.psd is not None:
        if not takes_table(scene):
            raise ValueError("a table can be pasted where one table shakes the scene")
        kept = {name: document["excitation"][0][name] for name in ("on", "level_db", "axis")
                if name in document["excitation"][0]}  # fmt: skip
        document["excitation"][0] = kept | table_of(setting.psd)
    try:
        return scene_from(document)
    except SceneError as reason:
        raise ValueError(str(reason)) from None


def _set_law(scene: Scene, document: dict[str, Any], law: str) -> None:
    """Give all stops a law, unless they have it."""
    known = laws_of(scene)
    if law not in known:
        raise ValueError(f"law must be one of {', '.join(known) or 'those of the scene'}")
    if law == known[0]:
        return
    numbers = {"kind": law, **LAWS[law]}
    if law == "viscoelastic":
        if "frequency_hz" in document["structure"]:  # a scene per unit mass
            document["structure"].setdefault("mass", 1.0)
        numbers["stiffness"] = STIFFER * float(model_of(scene).stiffness[0, 0])
    for pair in document["impact_pair"]:
        for name in LAW_KEYS:
            pair.pop(name, None)
        pair["law"] = numbers


@cache
def table_of(text: str) -> dict[str, Any]:
    """The keys of noise whose density is a pasted table, in SI units, by the reader of files.

    Raises `ValueError` with the sentence of that reader where it cannot be read.
    """
    rows = text.count("\n") + 1
    if rows > MOST_ROWS:
        raise ValueError(f"{PASTED} must have at most {MOST_ROWS} rows, got {rows}")
    with tempfile.TemporaryDirectory() as folder:
        # the name is ours: nothing of a path comes from the page
        file = Path(folder) / "pasted.csv"
        file.write_text(text, encoding="utf-8")
        try:
            table = TabulatedNoise(file=str(file)).table
        except SceneError as reason:
            raise ValueError(str(reason).replace(str(file), PASTED)) from None
    return {
        "kind": "psd", "unit": "(m/s2)2/Hz",
        "frequency_hz": table.frequency_hz.tolist(), "density": table.density.tolist(),
    }  # fmt: skip


def design_of(scene: Scene, setting: Setting) -> Design:
    """The design of a setting.

    Nothing else of a scene can be set, least of all the name of a file: settings come from a
    browser. Raises `ValueError`, with the sentence of the scene where it refuses the values.
    """
    scene = chosen(scene, setting)
    asked = {knob.key: knob for knob in questions_of(scene)}
    known = asked | {knob.key: knob for knob in knobs_of(scene)}
    values = {key: checked(known.get(key), key, value) for key, value in setting.values.items()}
    change = tuple((key, value) for key, value in values.items() if key not in asked)
    try:
        turned = changed_scene(scene.document(as_written=True), change)
    except SceneError as reason:
        raise ValueError(str(reason).removeprefix("vary: ")) from None
    answered = {key: values.get(key, knob.value) for key, knob in asked.items()}
    prefix = "tolerances."
    allowed = {k.removeprefix(prefix): v for k, v in answered.items() if k.startswith(prefix)}
    return Design(
        turned, answered.get("mission", MISSION.value),
        answered.get("probability", PROBABILITY.value), Tolerances(**allowed),
    )  # fmt: skip
