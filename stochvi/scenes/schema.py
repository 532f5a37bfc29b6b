"""JSON Schema of scene files, from the parts of a scene: an editor completes and checks keys by it.

A schema cannot say that exactly one of two keys is given, or that a table rises. Such rules are
checked when the file is read.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator
from typing import Any

from pydantic import BaseModel
from pydantic.json_schema import GenerateJsonSchema

from stochvi.scenes.characteristics import SpringTable
from stochvi.scenes.impact_laws import Elastic, ForceTable, Viscoelastic
from stochvi.scenes.impact_laws.rubber_data import DAMPING, PAD
from stochvi.scenes.scene import Scene
from stochvi.scenes.structures import Matrices, Modes
from stochvi.scenes.validation import PYTHON_ONLY, Checked

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
