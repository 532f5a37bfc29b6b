"""The table of who judges each number: `docs/judges.toml`, and the quantities of all answers."""

from __future__ import annotations

import ast
import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields, is_dataclass
from functools import cache
from pathlib import Path
from typing import Any

import pandas as pd
from pandas.api.types import is_bool_dtype, is_numeric_dtype

from stochvi.cli.answer_schema import Definitions, answer_schema
from stochvi.isolators.sizing.review import Review
from stochvi.results.base import Result
from support import CHECKOUT

TABLE = CHECKOUT / "docs" / "judges.toml"


def quantities() -> dict[str, set[str]]:
    """Numbers in the documents of all answers: the keys, by the class that holds them."""
    page = Definitions()  # the numbers of the page of a sizing, which its document holds as well
    page.reference(Review)
    parts = page.schemas | answer_schema()["$defs"]
    found = {
        name: {key for key, each in part["properties"].items() if _is_number(each)}
        for name, part in parts.items()
    }
    return {name: keys for name, keys in found.items() if keys}


def _is_number(schema: Mapping[str, Any]) -> bool:
    """Whether a key holds numbers itself; parts with a class of their own are listed there."""
    kinds = schema.get("type", [])
    kinds = kinds if isinstance(kinds, list) else [kinds]
    if {"number", "integer"} & set(kinds) or schema.get("$ref", "").endswith("/Estimate"):
        return True
    if "array" in kinds and not {"items", "prefixItems"} & schema.keys():
        return True  # an array of numpy
    inner = [schema.get("items"), schema.get("additionalProperties")]
    inner += [*schema.get("prefixItems", []), *schema.get("anyOf", [])]
    inner += schema.get("properties", {}).values()
    return any(isinstance(each, Mapping) and _is_number(each) for each in inner)


ERRORS = re.compile(r"_(?:standard_error|error|bias|low|high|lower|upper)(?=$|_without_stops$)")
"""Part of the name of a column that holds an error of another column, or an end of its interval."""


def columns_without_judge(answer: Result) -> list[str]:
    """Columns of numbers, in the tables of an answer, that are neither listed for its tables nor
    quantities of its parts."""
    kind = type(answer).__name__
    known = {key for name, key, _ in table() if name in _parts(kind)}
    known |= {key for name, key, _ in table("tables") if name == kind}
    found = {
        str(name).replace(" ", "_")
        for each in (*_tables(answer, []), answer.to_frame())
        for name in each
        if is_numeric_dtype(each[name]) and not is_bool_dtype(each[name])
    }
    return sorted(name for name in found if not {name, ERRORS.sub("", name)} & known)


def _tables(part: Any, seen: list[int]) -> Iterator[pd.DataFrame]:
    """The tables in an answer, and in its parts."""
    if isinstance(part, pd.DataFrame):
        yield part
    elif is_dataclass(part) and id(part) not in seen:
        seen.append(id(part))
        for each in fields(part):
            yield from _tables(getattr(part, each.name), seen)
    elif isinstance(part, Mapping):
        yield from _tables(list(part.values()), seen)
    elif isinstance(part, Sequence) and not isinstance(part, str):
        for each in part:
            yield from _tables(each, seen)


@cache
def _parts(kind: str) -> frozenset[str]:
    """The classes in the document of a kind of answer."""
    schemas, found, waiting = answer_schema()["$defs"], set[str](), [kind]
    while waiting:
        name = waiting.pop()
        if name in schemas and name not in found:
            found.add(name)
            waiting += re.findall(r"#/\$defs/(\w+)", str(schemas[name]))
    return frozenset(found)


def table(of: str = "judged") -> Iterator[tuple[str, str, list[str] | str]]:
    """Class, key, and its judges; "asked" or "work" where none is needed. Of "tables", the kind of
    answer, the column, and its judges."""
    document = tomllib.loads(TABLE.read_text("utf-8"))
    for group in ("asked", "work") if of == "judged" else ():
        for name, keys in document[group].items():
            yield from ((name, key, group) for key in keys.split())
    for name, rows in document[of].items():
        for keys, judges in rows.items():
            yield from ((name, key, judges) for key in keys.split())


def exists(judge: str) -> bool:
    """Whether a test, or a study, is there."""
    if judge.startswith("study "):
        return any((CHECKOUT / "studies").glob(f"{judge.removeprefix('study ')}_*/run.py"))
    file, _, name = judge.partition("::")
    return f"test_{name}" in _tests(CHECKOUT / "tests" / _with_prefix(file))


def _with_prefix(file: str) -> str:
    room, _, stem = file.rpartition("/")
    return f"{room}/test_{stem}.py"


@cache
def _tests(file: Path) -> set[str]:
    if not file.exists():
        return set()
    tree = ast.parse(file.read_text("utf-8"))
    return {each.name for each in tree.body if isinstance(each, ast.FunctionDef)}
