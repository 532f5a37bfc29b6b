"""JSON Schema of the documents that commands write, from the types of the fields of answers."""

from __future__ import annotations

import importlib
import inspect
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields, is_dataclass
from functools import cache
from types import UnionType
from typing import Any, ClassVar, Literal, NamedTuple, Union, get_args, get_origin

import numpy as np

from stochvi.isolators.production_risk import Production
from stochvi.isolators.record_verdict import RecordVerdict
from stochvi.isolators.sizing.answer import (
    Clearance,
    Probability,
    RoundedClearance,
    StopPositions,
    ThreeSigma,
)
from stochvi.results.base import DataFrame, Quantities, Result
from stochvi.scenes.keys import DIALECT
from stochvi.scenes.scene import Scene

Schema = dict[str, Any]

ROOMS = (
    "absorbers", "identification", "isolators", "methods.fokker_planck", "methods.periodic",
    "methods.replay", "results", "scenes", "statistics", "testing", "verification",
)  # fmt: skip
"""Packages whose public names hold every kind of answer."""

CELL: Schema = {"type": ["number", "string", "boolean", "null"]}
NUMBER: Schema = {"type": ["number", "null"]}  # null where it is not finite
ROWS: Schema = {"type": "array", "items": {"type": "object", "additionalProperties": CELL}}
COLUMNS: Schema = {
    "type": ["object", "null"], "additionalProperties": {"type": "array", "items": CELL}
}  # fmt: skip
PART: Schema = {"type": "object"}

PLAIN: dict[Any, Schema] = {
    Any: {}, dict: PART, None: {"type": "null"}, type(None): {"type": "null"},
    bool: {"type": "boolean"},
    int: {"type": "integer"}, float: NUMBER, str: {"type": "string"}, Scene: PART,
    DataFrame: ROWS, np.ndarray: {"type": "array"},
}  # fmt: skip
"""Schemas of types that need no definition of their own, by type."""


class Change(NamedTuple):
    """How the JSON document of an answer differs from its fields; types may be given as schemas.

    Parameters
    ----------
    added, optional
        Further keys that are always present, and those that are present only if they have a value.
    renamed
        Keys of fields whose key is not their name; None for fields that are left out.
    """

    added: Mapping[str, Any] = {}
    optional: Mapping[str, Any] = {}
    renamed: Mapping[str, str | None] = {}


LIST: Schema = {"type": "array", "items": NUMBER}
LIST_OR_NONE: Schema = {"anyOf": [LIST, {"type": "null"}]}


def lists_with_errors(*names: str) -> dict[str, Schema]:
    """Lists of values, each with those of its standard errors and biases beside it."""
    return {name + end: LIST for name in names for end in ("", "_standard_error", "_bias")}


LISTS = {"equipment_frequency_hz": LIST}
SPECTRA = {"extreme_lower": LIST, "extreme_upper": LIST} | lists_with_errors(
    "response_rms", "extreme_response", "fatigue_damage", "cumulative_rms"
)
EITHER: Schema = {
    "anyOf": [
        {
            "type": "object", "properties": SPECTRA, "required": list(SPECTRA),
            "additionalProperties": False,
        },
        {"type": "null"},
    ]
}  # fmt: skip
"""Schemas of the spectra of `damage`, with stops and without."""

METHOD = {"method": str}
RECORD = {"record": RecordVerdict}

ONE_OR_SEVERAL = Change(
    {"verdict": str, "made": RoundedClearance | None | Mapping[str, RoundedClearance]},
    {"clearance": Clearance, "clearances": Mapping[str, Clearance]},
    {"clearances": None},
)
"""Clearances of one pair, or of each of several."""

CHANGES = {
    "Damage": Change(
        METHOD | SPECTRA | LISTS | lists_with_errors("equivalent_density")
        | {"damage_ratio": LIST_OR_NONE, "without_stops": EITHER},
        {f"damage_ratio_{error}": LIST for error in ("standard_error", "bias")},
        {"with_stops": None},
    ),
    "DamageSizing": ONE_OR_SEVERAL,
    "History": Change(METHOD | {"columns": list[str], "samples": int}),
    "ResponseSpectrum": Change(
        {"spectra": Mapping[str, Mapping[str, dict[str, Any]]]}, renamed={"curves": None}
    ),
    "Reliability": Change(optional=RECORD | {"production": Production}),
    "Screening": Change(
        optional=dict.fromkeys(("displacement_std", "velocity_std"), float)
        | dict.fromkeys(("acceleration_std", "zero_crossing_rate"), float | None)
        | {"sines": Sequence[tuple[float, float]]}
    ),
    "Sizing": Change(
        {
            "verdict": str, "made": RoundedClearance | None | Mapping[str, RoundedClearance],
            "three_sigma": ThreeSigma | Probability,
        },
        dict(ONE_OR_SEVERAL.optional)
        | {"clearance_in_sigma": float, "sigma": float, "gap": StopPositions}
        | {"sensitivity": ROWS, "review": PART},
        {"clearances": None, "three_sigma": None},
    ),
}  # fmt: skip
"""How the JSON documents of answers differ from their fields, by the names of their classes."""


def answer_schema() -> Schema:
    """JSON Schema of the answers of all commands, draft 2020-12; each is one of its `anyOf`.

    Returns
    -------
    dict
        The schema, of plain types. Numbers in documents are in SI units, null where not finite.

    Examples
    --------
    >>> schema = answer_schema()
    >>> sorted(schema["$defs"]["Estimate"]["required"])
    ['bias', 'how', 'standard_error', 'value']
    """
    known = Definitions()
    answers = [known.reference(kind) for kind in sorted({*kinds()}, key=lambda kind: kind.__name__)]
    head = {"$schema": DIALECT, "title": "stochvi answer"}
    return head | {"anyOf": answers, "$defs": known.schemas}


@cache
def public() -> dict[str, Any]:
    """All public names of the rooms of answers, by which annotations name types that their modules
    import for type checking only."""
    packages = [importlib.import_module(f"stochvi.{room}") for room in ROOMS]
    return {name: getattr(package, name) for package in packages for name in package.__all__}


def kinds() -> Iterator[type[Result]]:
    """Every public kind of answer."""
    for kind in public().values():
        if inspect.isclass(kind) and issubclass(kind, Result):
            yield kind


class Definitions:
    """Schemas of the dataclasses that answers contain, by their names in the schema document."""

    def __init__(self) -> None:
        self.schemas: dict[str, Schema] = {}
        self._names: dict[type, str] = {}

    def reference(self, kind: type) -> Schema:
        """A reference to the schema of a dataclass, which is made when it is first met."""
        if kind not in self._names:
            name = kind.__name__
            if name in self.schemas:  # two rooms have parts of this name
                name = f"{name}_{kind.__module__.split('.')[1]}"
            self._names[kind] = name
            self.schemas[name] = {}
            self.schemas[name] = self._of_class(kind)
        return {"$ref": f"#/$defs/{self._names[kind]}"}

    def of_type(self, hint: Any) -> Schema:
        """The schema of the JSON form of a value of this type."""
        if isinstance(hint, Mapping):
            return dict(hint)  # a schema already
        kind, parts = get_origin(hint) or hint, get_args(hint)
        if kind in (Union, UnionType):
            return {"anyOf": [self.of_type(each) for each in parts]}
        if kind is Literal:
            return {"enum": list(parts)}
        if kind in PLAIN:
            return PLAIN[kind]
        if isinstance(kind, type) and is_dataclass(kind):
            return self.reference(kind)
        if hasattr(kind, "_fields"):  # a named tuple
            return _record({name: self.of_type(_hint(kind, name)) for name in kind._fields})
        if issubclass(kind, Mapping):
            return {"type": "object", "additionalProperties": self.of_type(parts[1])}
        if kind is tuple and parts[-1] is not Ellipsis:
            return {
                "type": "array", "prefixItems": [self.of_type(each) for each in parts],
                "minItems": len(parts), "maxItems": len(parts),
            }  # fmt: skip
        if issubclass(kind, Sequence):
            return {"type": "array", "items": self.of_type(parts[0])}
        raise TypeError(f"{hint} has no schema: give it one in PLAIN")

    def _of_class(self, kind: Any) -> Schema:
        change = CHANGES.get(kind.__name__, Change())
        stated = getattr(kind, "in_document", {})
        left_out = {*getattr(kind, "not_in_document", ()), *stated.values()}
        named = {each.name: change.renamed.get(each.name, each.name) for each in fields(kind)}
        found = {"method": PLAIN[str]} if getattr(kind, "kind", "") else {}
        found |= {key: self.of_type(_on_the_way(kind, way)) for key, way in stated.items()}
        found |= {
            key: self.of_type(_hint(kind, name))
            for name, key in named.items()
            if key is not None and name not in left_out
        }
        found |= dict.fromkeys(getattr(kind, "as_columns", ()), COLUMNS)
        found |= {key: self.of_type(each) for key, each in change.added.items()}
        optional = {key: self.of_type(each) for key, each in change.optional.items()}
        rare = tuple(found) if issubclass(kind, Quantities) else getattr(kind, "sometimes", ())
        optional |= {key: found.pop(key) for key in rare}
        summary = " ".join(inspect.cleandoc(kind.__doc__ or "").partition("\n\n")[0].split())
        return {"description": summary, **_record(found, optional)}


def _record(required: Schema, optional: Schema | None = None) -> Schema:
    return {
        "type": "object", "properties": required | (optional or {}), "required": list(required),
        "additionalProperties": False,
    }  # fmt: skip


def _on_the_way(kind: type, way: str) -> Any:
    """The type of what a way such as "resonance.free_amplitude" leads to, from a class."""
    first, _, rest = way.partition(".")
    hint = _hint(kind, first)
    if not rest:
        return hint
    (part,) = (each for each in get_args(hint) if each is not type(None))
    return _on_the_way(part, rest) | None


def _hint(kind: type, name: str) -> Any:
    """The type of a field, a property or what a method returns, even if its module imports that
    type for type checking only."""
    bases = kind.__mro__
    owner = next(base for base in bases if name in vars(base) | inspect.get_annotations(base))
    found = vars(owner).get(name)
    function = found.fget if isinstance(found, property) else found
    returns = inspect.isfunction(function)
    hint = inspect.get_annotations(function if returns else owner)["return" if returns else name]  # type: ignore[arg-type]
    hint = getattr(hint, "__forward_arg__", hint)  # as named tuples keep it
    known = vars(sys.modules[owner.__module__])
    hint = eval(hint, dict(public()), dict(known)) if isinstance(hint, str) else hint
    return get_args(hint)[0] if get_origin(hint) is ClassVar else hint
