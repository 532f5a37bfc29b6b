"""The table of who judges each number: `docs/judges.toml`, and the quantities of all answers."""

from __future__ import annotations

import ast
import tomllib
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any

from stochvi.cli.answer_schema import Definitions, answer_schema
from stochvi.isolators.sizing.review import Review
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


def table() -> Iterator[tuple[str, str, list[str] | str]]:
    """Class, key, and its judges; "asked" or "work" where none is needed."""
    document = tomllib.loads(TABLE.read_text("utf-8"))
    for group in ("asked", "work"):
        for name, keys in document[group].items():
            yield from ((name, key, group) for key in keys.split())
    for name, rows in document["judged"].items():
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
