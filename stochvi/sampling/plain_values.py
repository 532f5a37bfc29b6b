"""Results of blocks as types that JSON can hold, and back with every digit; digests of works.

Arrays are written by their bytes, records (dataclasses and named tuples of this package) by their
class and their fields.
"""

from __future__ import annotations

import base64
import hashlib
import math
from collections.abc import Iterable, Mapping
from dataclasses import fields, is_dataclass
from functools import cached_property, partial
from types import BuiltinFunctionType, FunctionType, MethodType
from typing import Any

import numpy as np
from pydantic import BaseModel

from stochvi.results.kinds import kind_of, name_of


def to_plain(value: Any) -> Any:
    """A value as types that JSON can hold. TypeError for what no result of a block consists of."""
    if value is None or isinstance(value, bool | int | str):
        return value
    if isinstance(value, float) and not isinstance(value, np.generic):
        return value if math.isfinite(value) else {"float": repr(value)}
    if isinstance(value, np.ndarray | np.generic):
        array = np.asarray(value)
        if array.dtype.kind not in "biuf":
            raise TypeError(f"an array of {array.dtype} cannot be kept in a checkpoint")
        return {
            "array": base64.b64encode(array.tobytes()).decode(),
            "dtype": array.dtype.str,
            "shape": list(array.shape),
        }
    names = _fields_of(type(value))
    if names is not None:
        plain = {name: to_plain(getattr(value, name)) for name in names}
        return {"record": name_of(type(value)), "fields": plain}
    if isinstance(value, list):
        return [to_plain(each) for each in value]
    if isinstance(value, tuple):
        return {"tuple": [to_plain(each) for each in value]}
    if isinstance(value, dict):
        return {"dict": [[to_plain(key), to_plain(each)] for key, each in value.items()]}
    raise TypeError(f"a {type(value).__name__} cannot be kept in a checkpoint")


def from_plain(plain: Any) -> Any:
    """The value of a document of `to_plain`. ValueError if it is none."""
    try:
        return _from_plain(plain)
    except (AttributeError, ImportError, KeyError, TypeError) as error:
        raise ValueError(f"{type(error).__name__}: {error}") from error


def _from_plain(plain: Any) -> Any:
    if isinstance(plain, list):
        return [_from_plain(each) for each in plain]
    if not isinstance(plain, dict):
        return plain
    if "float" in plain:
        return float(plain["float"])
    if "array" in plain:
        array = np.frombuffer(base64.b64decode(plain["array"]), np.dtype(plain["dtype"]))
        array = array.reshape(plain["shape"]).copy()
        return array if array.ndim else array[()]
    if "tuple" in plain:
        return tuple(_from_plain(each) for each in plain["tuple"])
    if "dict" in plain:
        return {_from_plain(key): _from_plain(each) for key, each in plain["dict"]}
    kind = kind_of(plain["record"])
    if _fields_of(kind) is None:
        raise ValueError(f"{plain['record']} is no record")
    return kind(**{key: _from_plain(each) for key, each in plain["fields"].items()})


def _fields_of(kind: Any) -> list[str] | None:
    """Names of the fields of a dataclass or a named tuple; None for other types."""
    if isinstance(kind, type) and is_dataclass(kind):
        return [field.name for field in fields(kind)]
    if isinstance(kind, type) and issubclass(kind, tuple) and hasattr(kind, "_fields"):
        return list(kind._fields)
    return None


def digest_of(value: Any) -> str:
    """Digest of all that a function and its arguments consist of: the same in every process.

    What an object has calculated from its fields and kept (`cached_property`) does not enter.

    Examples
    --------
    >>> digest_of(partial(max, 1.0)) == digest_of(partial(max, 1.0))
    True
    >>> digest_of(partial(max, 1.0)) == digest_of(partial(max, 1.5))
    False
    """
    digest = hashlib.sha256()
    for piece in _pieces(value, ()):
        digest.update(len(piece).to_bytes(8, "little") + piece)
    return digest.hexdigest()


def _pieces(value: Any, within: tuple[int, ...]) -> Iterable[bytes]:
    """Bytes that determine a value; `within` are the objects that it is a part of."""
    if value is None or isinstance(value, bool | int | float | complex | str | bytes):
        yield f"{type(value).__name__} {value!r}".encode()
        return
    if id(value) in within:
        yield f"object {within.index(id(value))}".encode()
        return
    within = (*within, id(value))
    kind = type(value)
    if isinstance(value, np.ndarray) and value.dtype != object:
        yield f"array {value.dtype.str} {value.shape}".encode()
        yield np.ascontiguousarray(value).tobytes()
        return
    if isinstance(value, type | FunctionType | BuiltinFunctionType | np.ufunc):
        name = getattr(value, "__qualname__", "") or value.__name__
        yield f"{getattr(value, '__module__', '')} {name}".encode()
        cells = getattr(value, "__closure__", None) or ()
        parts: Iterable[Any] = [cell.cell_contents for cell in cells]
    elif isinstance(value, MethodType):
        parts = [value.__func__, value.__self__]
    elif isinstance(value, partial):
        parts = [value.func, value.args, value.keywords]
    elif hasattr(value, "py_func"):  # compiled by numba
        parts = [value.py_func]
    else:
        yield f"{kind.__module__} {kind.__qualname__}".encode()
        parts = _parts(value)
    for part in parts:
        yield from _pieces(part, within)
    yield b"end"


def _parts(value: Any) -> Iterable[Any]:
    """The values of which an object consists, in an order that is the same in every process."""
    if isinstance(value, Mapping):
        return [each for item in value.items() for each in item]
    if isinstance(value, set | frozenset):
        return sorted(value, key=repr)
    if isinstance(value, list | tuple):
        return value
    if isinstance(value, BaseModel):
        known = {name: getattr(value, name) for name in type(value).model_fields}
        return [known, value.__pydantic_private__]
    names = _fields_of(type(value))
    if names is not None:
        return [getattr(value, name) for name in names]
    reduced: Any = value.__reduce_ex__(2)  # as copying and pickling take it apart
    if isinstance(reduced, str):
        return [reduced]
    arguments, state = (*reduced, None)[1:3]
    if isinstance(state, dict):
        kind = type(value)
        cached = [each for each in state if isinstance(getattr(kind, each, None), cached_property)]
        state = {name: each for name, each in state.items() if name not in cached}
    return [arguments, state]
