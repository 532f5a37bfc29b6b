"""Answers of calculations in files, and from them again with every number, table and part.

The file is JSON. Its "document" is the JSON document of the answer, as the commands write it, for
other programs. "answer" holds what the document leaves out, too: parts with their kinds, arrays bit
by bit. Only dataclasses, named tuples and models of this package are made from it, so that reading
a file runs nothing else.
"""

from __future__ import annotations

import base64
import dataclasses
import json
import math
from collections.abc import Callable, Mapping
from inspect import signature
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel

from stochvi.mathematics.units import checked
from stochvi.results.base import Result, frame_of
from stochvi.results.errors import SceneError, not_json
from stochvi.results.estimates import version_of
from stochvi.results.files import kind_of, name_of, now, write_whole
from stochvi.scenes.scene import Scene, scene_from
from stochvi.scenes.text_tables import read_text

PACKAGE = "stochvi"

KIND, ARRAY, TABLE, TUPLE, MAPPING, NUMBER, COMPLEX, SCENE, MODEL = (
    "$kind", "$array", "$table", "$tuple", "$mapping", "$number", "$complex", "$scene", "$model",
)  # fmt: skip
"""Keys that mark what JSON has no type for."""

LARGEST = 2**32
"""Size in bytes above which a file is no saved answer."""

UNREADABLE = (AttributeError, ImportError, LookupError, RecursionError, TypeError, ValueError)
"""What comes of making an answer from something else."""

FROM_DOCUMENT = "stochvi.Response.from_dict(json.load(open(FILE))) makes the response from it"
"""What reads the document of a response."""


@checked
def save_answer(answer: Result, path: str | Path) -> Path:
    """Write an answer to a file, from which `load_answer` makes it again.

    The file replaces an older one only when it is whole. The provenance of the answer, with the
    call, its arguments, the date and the version, is in it.

    Parameters
    ----------
    answer
        What any calculation returned.
    path
        The file; its name usually ends in `.json`.

    Returns
    -------
    pathlib.Path
        The path of the file.

    See Also
    --------
    load_answer : The other way.

    Examples
    --------
    >>> import stochvi, tempfile
    >>> scene = stochvi.load_scene(stochvi.scenes.shipped_scene("isolator-truck"))
    >>> found = stochvi.screen(scene)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     again = load_answer(save_answer(found, f"{folder}/screening.json"))
    >>> again == found, again.provenance["call"]["function"]
    (True, 'screen')
    """
    if not isinstance(answer, Result):
        raise ValueError(f"answer must be what a calculation returned, got {answer!r}")
    content = {
        "stochvi": version_of(PACKAGE),
        "saved": now(),
        "document": answer.to_dict(),
        "answer": _encoded(answer),
    }
    text = json.dumps(content, allow_nan=False, ensure_ascii=False)
    write_whole(text.encode(), Path(path))
    return Path(path)


@checked
def load_answer(path: str | Path) -> Result:
    """Read an answer that `save_answer` wrote.

    Parameters
    ----------
    path
        The file.

    Returns
    -------
    Result
        The answer: equal to the one that was saved.

    Raises
    ------
    ValueError
        If the file is missing, holds no answer, or one of another version of this package whose
        parts have changed.

    See Also
    --------
    save_answer : What writes the file.

    Examples
    --------
    >>> load_answer("no-such-file.json")  # doctest: +ELLIPSIS
    Traceback (most recent call last):
    stochvi.results.errors.SceneError: no-such-file.json cannot be read: no such file or ...
    """
    text = read_text(Path(path), LARGEST)
    version, content = "an unknown version", None
    try:
        content = json.loads(text)
        version = content["stochvi"]
        answer = _decoded(content["answer"])
    except UNREADABLE as error:
        if isinstance(content, dict) and "provenance" in content:
            raise ValueError(
                f"{path} is the JSON document of an answer, as --json writes it; "
                + (FROM_DOCUMENT if "identities" in content else "load a file of save_answer")
            ) from None
        raise ValueError(
            f"{path} must be a file that save_answer wrote; it {_fault(error, content)}, "
            f"and names {version} where this is {version_of(PACKAGE)}"
        ) from error
    if not isinstance(answer, Result):
        raise ValueError(f"{path} must hold an answer, got {type(answer).__name__}")
    return answer


def _fault(error: Exception, content: Any) -> str:
    """What is wrong with a file whose content is no answer."""
    if content is None or isinstance(error, RecursionError):
        return not_json(error)
    for key in ("stochvi", "answer"):
        if not isinstance(content, dict) or key not in content:
            return f"has no key {key!r}"
    if isinstance(error, SceneError):
        return f"cannot be read as one ({error})"
    return "has a part that answers do not have"


def _encoded(value: Any) -> Any:
    """A value as plain types that JSON can hold, with marks from which it can be made again."""
    if value is None or isinstance(value, bool | str):
        return value
    if isinstance(value, np.generic):
        return _encoded(value.item())
    if isinstance(value, int):
        return int(value)
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else {NUMBER: str(value)}
    if isinstance(value, complex):
        return {COMPLEX: [_encoded(value.real), _encoded(value.imag)]}
    if isinstance(value, np.ndarray):
        return {ARRAY: _array(value)}
    if isinstance(value, Scene):
        return {SCENE: value.document()}
    if isinstance(value, BaseModel):
        return {MODEL: name_of(type(value)), "keys": _encoded(value.model_dump(exclude_unset=True))}
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        parts = {each.name: getattr(value, each.name) for each in _stored(type(value))}
        return {KIND: name_of(type(value)), "parts": {k: _encoded(v) for k, v in parts.items()}}
    if hasattr(value, "_asdict"):
        parts = value._asdict()
        return {KIND: name_of(type(value)), "parts": {k: _encoded(v) for k, v in parts.items()}}
    if hasattr(value, "iloc"):
        return {TABLE: _columns(value)}
    if isinstance(value, Mapping):
        return _mapping(value)
    if isinstance(value, tuple):
        return {TUPLE: [_encoded(each) for each in value]}
    if isinstance(value, list):
        return [_encoded(each) for each in value]
    raise TypeError(f"an answer with a part of type {type(value).__name__} cannot be saved")


def _array(values: np.ndarray) -> dict[str, Any]:
    """An array: its bytes, or the entries of one of objects."""
    head = {"type": values.dtype.str, "shape": list(values.shape)}
    if values.dtype.hasobject:
        return {**head, "entries": [_encoded(each) for each in values.ravel().tolist()]}
    data = np.ascontiguousarray(values).tobytes()
    return {**head, "bytes": base64.b64encode(data).decode("ascii")}


def _columns(table: Any) -> list[list[Any]]:
    """The columns of a table by name, the index first."""
    index = [None, _array(table.index.to_numpy())]
    return [index, *([str(name), _array(table[name].to_numpy())] for name in table.columns)]


def _mapping(value: Mapping[Any, Any]) -> Any:
    """A mapping as an object of JSON where its keys are plain words, else as pairs."""
    if all(isinstance(key, str) and not key.startswith("$") for key in value):
        return {key: _encoded(each) for key, each in value.items()}
    return {MAPPING: [[_encoded(key), _encoded(each)] for key, each in value.items()]}


def _stored(kind: type) -> list[dataclasses.Field[Any]]:
    return [each for each in dataclasses.fields(kind) if each.init]


def _decoded(value: Any) -> Any:
    """The value that `_encoded` was given."""
    if isinstance(value, list):
        return [_decoded(each) for each in value]
    if not isinstance(value, dict):
        return value
    mark = next((key for key in value if key in MADE), None)
    if mark is None:
        return {key: _decoded(each) for key, each in value.items()}
    return MADE[mark](value)


def _kind(name: str) -> Any:
    """A dataclass, named tuple or model of this package, by its name."""
    kind = kind_of(name)
    known = isinstance(kind, type) and (
        dataclasses.is_dataclass(kind) or hasattr(kind, "_fields") or issubclass(kind, BaseModel)
    )
    if not known:
        raise SceneError(f"{name} is no kind of part that answers have")
    return kind


def _made_part(found: dict[str, Any]) -> Any:
    """A dataclass or named tuple, of parts that it has in this version."""
    kind, parts = _kind(found[KIND]), _decoded(found["parts"])
    try:
        return kind(**parts)
    except TypeError:
        for part in set(parts) - set(signature(kind).parameters):
            raise SceneError(f"{found[KIND]} has no part {part}") from None
        raise


def _made_array(found: dict[str, Any]) -> np.ndarray:
    kind, shape = np.dtype(found["type"]), found["shape"]
    if "entries" in found:
        values = np.empty(len(found["entries"]), dtype=object)
        values[:] = [_decoded(each) for each in found["entries"]]
        return values.reshape(shape)
    return np.frombuffer(base64.b64decode(found["bytes"]), kind).reshape(shape).copy()


def _made_table(columns: list[list[Any]]) -> Any:
    (_, index), *rest = columns
    table = frame_of({name: _made_array(each) for name, each in rest})
    places = _made_array(index)
    return table if np.array_equal(places, np.arange(len(table))) else table.set_axis(places)


MADE: dict[str, Callable[[dict[str, Any]], Any]] = {
    KIND: _made_part,
    MODEL: lambda found: _kind(found[MODEL])(**_decoded(found["keys"])),
    ARRAY: lambda found: _made_array(found[ARRAY]),
    TABLE: lambda found: _made_table(found[TABLE]),
    TUPLE: lambda found: tuple(_decoded(each) for each in found[TUPLE]),
    MAPPING: lambda found: {_decoded(key): _decoded(each) for key, each in found[MAPPING]},
    NUMBER: lambda found: float(found[NUMBER]),
    COMPLEX: lambda found: complex(*map(_decoded, found[COMPLEX])),
    SCENE: lambda found: scene_from(found[SCENE]),
}
"""Makers of values, by the mark of their form."""
