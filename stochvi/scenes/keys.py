"""Keys of a scene file, such as "impact_pair.0.law.coefficient". Chapters: units by key; scenes
with changed values; JSON Schema of scene files."""

from __future__ import annotations

import difflib
import inspect
import json
import math
import re
from collections.abc import Iterator, Mapping
from typing import Any

from pydantic import BaseModel
from pydantic.json_schema import GenerateJsonSchema

from stochvi.results.errors import SceneError
from stochvi.scenes.characteristics import SpringTable
from stochvi.scenes.impact_laws import Elastic, ForceTable, Viscoelastic
from stochvi.scenes.impact_laws.compliant import DAMPING, OF_RUBBER, PAD
from stochvi.scenes.scene import Scene, scene_from
from stochvi.scenes.structures import Matrices, Modes
from stochvi.scenes.validation import PYTHON_ONLY, Checked

# ------------------------------------------------------------------------------
# Units of the numbers in a scene file, by key.
# ------------------------------------------------------------------------------


KEY_UNITS = {
    "lower": "m",
    "upper": "m",
    "clearance": "m",
    "tolerance": "m",
    "at": "m",
    "inertia": "kg m2",
    "centre_tolerance": "m",
    "play": "m",
    "deflection": "m",
    "thickness": "m",
    "length": "m",
    "width": "m",
    "height": "m",
    "second_moment": "m4",
    "young": "Pa",
    "tip_mass": "kg",
    "tip_spring": "N/m",
    "modal_mass": "kg",
    "residual_compliance": "m/N",
    "max_frequency_hz": "Hz",
    "area": "m2",
    "mass": "kg",
    "body_mass": "kg",
    "wheel_mass": "kg",
    "damping": "N s/m",
    "suspension_damping": "N s/m",
    "tyre_damping": "N s/m",
    "stiffness": "N/m",
    "suspension_stiffness": "N/m",
    "tyre_stiffness": "N/m",
    "force": "N",
    "acceleration": "m/s2",
    "frequency_hz": "Hz",
    "band_hz": "Hz",
    "resolution_hz": "Hz",
    "fs": "Hz",
    "level_db": "dB",
    "level_time": "s",
    "duration": "s",
    "from_hz": "Hz",
    "to_hz": "Hz",
    "width_hz": "Hz",
    "speed": "m/s",
    "rate": "1/s",
    "at_speed": "m/s",
    "displacement": "m",
    "velocity": "m/s",
    "speed_kmh": "km/h",
    "roughness": "m3",
    "yield_displacement": "m",
    "linear_stiffness": "N/m",
    "cubic_stiffness": "N/m3",
    "linear_damping": "N s/m",
    "cubic_damping": "N s3/m3",
    "reverses_above": "m",
    "reverses_below": "m",
    "delay": "s",
}
"""Units of the keys that have the same unit everywhere in a scene file."""


def key_unit(document: Mapping[str, Any], part: Mapping[str, Any], name: str) -> str:
    """The unit of the key `name` of a part of a scene; empty for a number without a unit.

    Examples
    --------
    >>> key_unit({}, {"kind": "isolator"}, "frequency_hz")
    'Hz'
    >>> key_unit({}, {"kind": "white", "unit": "g2/Hz"}, "density")
    'g2/Hz'
    """
    match part.get("kind"), name:
        case "bar" | "beam" | "plate", "density":
            return "kg/m3"
        case "modulation", "intensity" | "density":
            return "s"
        case _, "density":
            return str(part.get("unit", ""))
        case "hertz", "coefficient":
            return "N/m^1.5"
        case "power", "coefficient":
            return f"N/m^{part.get('exponent', 1.5):g}"
        case "power", "loss":
            power = part.get("loss_exponent") or part.get("exponent", 1.5)
            return f"N s/m^{power + 1.0:g}"
        case "van-der-pol", "amplitude":
            return "m"
        case ("sine" | "function" | "pulses", "amplitude") | ("pulses", "impulse"):
            on_mount = document["structure"]["kind"] == "isolator"
            on_base = part.get("on", "base" if on_mount else "") == "base"
            units = ("m/s", "N s") if name == "impulse" else ("m/s2", "N")
            return str(part.get("unit") or units[0 if on_base else 1])
    return KEY_UNITS.get(name, "")


# ------------------------------------------------------------------------------
# Keys of a scene file, such as "impact_pair.0.law.coefficient", and scenes with changed values.
#
# A number in a key is the index of an entry in a list, from 0.
# ------------------------------------------------------------------------------


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


# ------------------------------------------------------------------------------
# JSON Schema of scene files, from the parts of a scene: an editor completes and checks keys by it.
#
# A schema cannot say that exactly one of two keys is given, or that a table rises. Such rules are
# checked when the file is read.
# ------------------------------------------------------------------------------


DIALECT = "https://json-schema.org/draft/2020-12/schema"
"""The version of JSON Schema that the schemas are written in."""

LIMITS = {"gt": "exclusiveMinimum", "ge": "minimum", "lt": "exclusiveMaximum", "le": "maximum"}
"""Keywords of JSON Schema by pydantic's names of the same limits, which it leaves as they are where
a number is also converted."""

POSITIVE = {"type": "number", "exclusiveMinimum": 0}
"""Schema of a number above 0."""

RUBBER = {
    "shore_a": "Shore A hardness of a rubber pad, 20 to 80, from which stiffness follows by Gent's "
    "relation; with area and thickness.",
    "area": "Area of the rubber pad, m^2.",
    "thickness": "Thickness of the rubber pad, m.",
    "loss_factor": "Loss factor of the rubber at the frequency of the contact, instead of "
    "damping_ratio, of which it is twice.",
    "restitution": "Restitution of a free mass, instead of damping_ratio.",
    "at_speed": "Speed at which the restitution was measured, m/s.",
}
"""Keys of linear stops that are converted before the law is made, and what they mean."""

KIND_MAY_BE_LEFT_OUT = ("Restitution", "QuarterCar")
"""Parts that a file may write without their kind."""


def scene_schema() -> dict[str, Any]:
    """JSON Schema of a scene file, draft 2020-12.

    It describes what `tomllib.load` finds in the file. Parts that hold functions, which only
    Python can give, are left out.

    Returns
    -------
    dict
        The schema, of plain types.

    See Also
    --------
    stochvi.load_scene : Read a scene file, and check what a schema cannot say.

    Examples
    --------
    >>> schema = scene_schema()
    >>> schema["required"], schema["$defs"]["Hertz"]["properties"]["coefficient"]["type"]
    (['structure', 'excitation'], 'number')
    """
    whole = Scene.model_json_schema(by_alias=True, schema_generator=_Generator)
    parts = whole.pop("$defs")
    models = {model.__name__: model for model in _subclasses(Checked)}
    left_out = {name for name, part in parts.items() if _kind(part) in PYTHON_ONLY}
    described = {
        name: _described(_tidy(part, left_out), models[name])
        for name, part in parts.items()
        if name not in left_out
    }
    for name, part in described.items():
        if _kind(part) is not None and name not in KIND_MAY_BE_LEFT_OUT:
            part["required"] = ["kind", *part["required"]]
    _take_rubber(described[Elastic.__name__], PAD)
    _take_rubber(described[Viscoelastic.__name__], (*PAD, *DAMPING[1:], "at_speed"))
    for name in (ForceTable.__name__, SpringTable.__name__):
        table = described[name]
        table["required"] = ["kind"]
        table["anyOf"] = [{"required": ["file"]}, {"required": ["deflection", "force"]}]
    modes = described[Modes.__name__]
    modes["required"] = ["kind"]
    modes["anyOf"] = [{"required": ["file"]}, {"required": ["frequency_hz", "shapes"]}]
    matrices = described[Matrices.__name__]
    matrices["required"] = ["kind"]
    matrices["anyOf"] = [{"required": ["file"]}, {"required": ["coordinates", "mass", "stiffness"]}]
    head = {"$schema": DIALECT, "title": "stochvi scene"}
    return head | _described(_tidy(whole, left_out), Scene) | {"$defs": described}


def parameters_of(kind: type) -> dict[str, str]:
    """Descriptions of each parameter, from the docstrings of a class and its bases.

    Examples
    --------
    >>> from stochvi.scenes.impact_laws import ForceTable
    >>> parameters_of(ForceTable)["force"]
    'Never decreasing, N, 0 at the deflection 0.'
    """
    found: dict[str, str] = {}
    for each in reversed(kind.__mro__):
        text = inspect.cleandoc(each.__dict__.get("__doc__") or "")
        section = re.search(r"^Parameters\n-+\n(.*?)(?=^\S[^\n]*\n-{3,}$|\Z)", text, FLAGS)
        entries = re.findall(
            r"^(\S[^\n]*)\n((?:[ ]+[^\n]*\n?|\n)+)", section[1] if section else "", FLAGS
        )
        for names, words in entries:
            found |= dict.fromkeys(names.split(", "), " ".join(words.split()))
    return found


FLAGS = re.MULTILINE | re.DOTALL
"""How docstrings are searched: line by line, and over several lines."""


class _Generator(GenerateJsonSchema):
    """Pydantic's generator, which has no schema for a function: those parts are taken out later."""

    def callable_schema(self, schema: Any) -> dict[str, Any]:
        return {}


def _subclasses(kind: type[BaseModel]) -> Iterator[type[BaseModel]]:
    for each in kind.__subclasses__():
        yield each
        yield from _subclasses(each)


def _kind(part: dict[str, Any]) -> str | None:
    """The kind that a part says it is, if it says one."""
    found: str | None = part["properties"].get("kind", {}).get("const")
    return found


def _tidy(schema: Any, left_out: set[str]) -> Any:
    """A schema for files: no null, which TOML does not have, and no titles that repeat the keys."""
    if isinstance(schema, list):
        return [_tidy(each, left_out) for each in schema if not _is_left_out(each, left_out)]
    if not isinstance(schema, dict):
        return schema
    found = {
        LIMITS.get(key, key): _tidy(value, left_out)
        for key, value in schema.items()
        if key not in ("title", "discriminator") and not (key == "default" and value is None)
    }
    if "properties" in schema:  # keys of a file may be called as keywords of a schema are
        found["properties"] = {k: _tidy(v, left_out) for k, v in schema["properties"].items()}
    choices = found.get("anyOf", [])
    if len(choices) == 1:  # the other was null
        found |= found.pop("anyOf")[0]
    return found


def _is_left_out(schema: Any, names: set[str]) -> bool:
    if not isinstance(schema, dict):
        return False
    return schema.get("type") == "null" or schema.get("$ref", "").rpartition("/")[2] in names


def _described(schema: dict[str, Any], model: type[BaseModel]) -> dict[str, Any]:
    """The schema of a part with what docstrings say of the part and of each of its keys."""
    known = {"kind": "Which kind of part this is."} | parameters_of(model)
    names = {field.alias or name: name for name, field in model.model_fields.items()}
    properties = {
        key: {"description": known[names[key]], **each} if names[key] in known else each
        for key, each in schema["properties"].items()
    }
    summary = " ".join(inspect.cleandoc(model.__doc__ or "").partition("\n\n")[0].split())
    return {
        **schema, "description": summary, "properties": properties,
        "required": schema.get("required", []),
    }  # fmt: skip


def _take_rubber(law: dict[str, Any], keys: tuple[str, ...]) -> None:
    """Let the schema of a linear stop take keys of its rubber instead of its own numbers."""
    law["properties"] |= {key: {"description": RUBBER[key], **POSITIVE} for key in keys}
    law["required"] = [key for key in law["required"] if key not in ("stiffness", *DAMPING)]
