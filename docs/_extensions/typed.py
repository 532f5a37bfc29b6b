"""Types in the API: signatures and lists of parameters with the annotations as they are written.

Sphinx would write out what an annotation stands for, such as the validators of a number. A reader
needs the name: `float`, `Scene`, `DataFrame`. Names with a page of their own link to it.
"""

from __future__ import annotations

import ast
import importlib
import inspect
import re
from functools import cache
from typing import Any

from docstrings import public_names
from sphinx.application import Sphinx

PLAIN = {
    "Number": "float", "Positive": "float", "NonNegative": "float", "Tolerance": "float",
    "Count": "int", "Numbers": "list[float]", "Matrix": "list[list[float]]",
    "Triple": "tuple[float, float, float]", "Law": "ImpactLaw", "Vector": "np.ndarray",
    "Text": "str", "Column": "list[float]", "ColumnName": "str | int", "Names": "list[str]",
    "DensityUnit": "str", "DensityOrLevelUnit": "str",
}  # fmt: skip
"""Names that the code gives to checked numbers and texts, in words of Python."""

ELSEWHERE = {
    "np.ndarray": "numpy.ndarray", "DataFrame": "pandas.DataFrame", "pd.Series": "pandas.Series",
    "Axes": "matplotlib.axes.Axes", "Path": "pathlib.Path", "Any": "typing.Any",
    "Callable": "collections.abc.Callable", "Iterable": "collections.abc.Iterable",
    "Mapping": "collections.abc.Mapping", "Sequence": "collections.abc.Sequence",
}  # fmt: skip
"""Names of other libraries, by how annotations write them."""


@cache
def homes() -> dict[str, str]:
    """Full names of the public classes by their last parts."""
    found: dict[str, str] = {}
    for full, each in public_names().items():
        if inspect.isclass(each):
            found.setdefault(full.rpartition(".")[2], full)
    return found


class WithoutValidators(ast.NodeTransformer):
    """Replaces each `Annotated[kind, ...]` in an annotation by its kind."""

    def visit_Subscript(self, node: ast.Subscript) -> ast.AST:
        self.generic_visit(node)
        checked = isinstance(node.value, ast.Name) and node.value.id == "Annotated"
        return node.slice.elts[0] if checked and isinstance(node.slice, ast.Tuple) else node


def plain(annotation: Any) -> str:
    """An annotation as a reader says it: the text in the source, checked numbers as `float`."""
    if annotation is inspect.Parameter.empty:
        return ""
    text = annotation if isinstance(annotation, str) else inspect.formatannotation(annotation)
    text = text.replace("np.bool_", "bool")  # docutils would take the end for a reference
    if "Annotated[" in text:
        text = ast.unparse(WithoutValidators().visit(ast.parse(text, mode="eval")))
    text = re.sub(r"\b(?:typing|collections\.abc)\.", "", text)
    return re.sub(r"\b[A-Z]\w*\b", lambda word: PLAIN.get(word[0], word[0]), text)


def linked(text: str) -> str:
    """The same with full names, of which Sphinx shows the last parts."""

    def full(word: re.Match[str]) -> str:
        known = ELSEWHERE.get(word[0]) or homes().get(word[0])
        return f"~{known}" if known else word[0]

    return re.sub(r"(?<![\w.'\"])(?:np\.|pd\.)?[A-Z]\w*\b|np\.ndarray", full, text)


def parameters_of(each: Any) -> dict[str, tuple[str, str]]:
    """Type and default of each parameter, in words; of a part of a scene its keys."""
    fields = getattr(each, "model_fields", None)
    if fields:
        written: dict[str, Any] = {}
        for base in reversed(each.__mro__):
            written |= inspect.get_annotations(base)
        return {
            name: (plain(written.get(name, "")), "" if field.is_required() else repr(field.default))
            for name, field in fields.items()
            if name != "kind"
        }
    try:
        signature = inspect.signature(each)
    except (TypeError, ValueError):
        return {}
    empty = inspect.Parameter.empty
    return {
        f"{'*' * (one.kind is one.VAR_POSITIONAL)}{'**' * (one.kind is one.VAR_KEYWORD)}{name}": (
            plain(one.annotation),
            "" if one.default is empty else default_in_words(one.default),
        )
        for name, one in signature.parameters.items()
        if name not in ("self", "cls")
    }


def default_in_words(default: Any) -> str:
    """A default as it is written; of one that is made anew, an ellipsis."""
    text = repr(default)
    return "..." if text.startswith("<") else text


def write_signature(
    app: Sphinx, what: str, name: str, each: Any, options: Any, signature: str | None, returned: Any
) -> tuple[str, str] | None:
    """The signature with types, for `autodoc-process-signature`."""
    if what not in ("class", "function", "method", "exception") or signature is None:
        return None
    parts, keywords = [], False
    kinds: dict[str, Any] = {}
    if not getattr(each, "model_fields", None):
        try:
            kinds = {key: one.kind for key, one in inspect.signature(each).parameters.items()}
        except (TypeError, ValueError):
            return None
    for key, (kind, default) in parameters_of(each).items():
        only = kinds.get(key, inspect.Parameter.KEYWORD_ONLY) is inspect.Parameter.KEYWORD_ONLY
        if only and not keywords and not key.startswith("*"):
            parts.append("*")
            keywords = True
        keywords |= key.startswith("*")
        typed = f"{key}: {linked(kind)}" if kind else key
        parts.append(f"{typed} = {default}" if default else typed)
    back = "" if what == "class" else plain(getattr(each, "__annotations__", {}).get("return", ""))
    return f"({', '.join(parts)})", linked(back)


def write_types(
    app: Sphinx, what: str, name: str, each: Any, options: Any, lines: list[str]
) -> None:
    """Add types to the list of parameters of a docstring, before numpydoc reads it."""
    if what not in ("class", "function", "method", "exception") or "Parameters" not in lines:
        return
    known = {key.lstrip("*"): kind for key, (kind, _) in parameters_of(each).items()}
    start = lines.index("Parameters") + 2
    for number in range(start, len(lines)):
        line = lines[number]
        if set(line) == {"-"}:
            break
        names = re.fullmatch(r"(\**\w+(?:, \**\w+)*)", line)
        kind = known.get(line.split(",")[0].strip("* "), "")
        if names and kind:
            lines[number] = f"{line} : {kind}"


def setup(app: Sphinx) -> dict[str, Any]:
    """Connect both."""
    importlib.import_module("stochvi")
    app.connect("autodoc-process-signature", write_signature)
    app.connect("autodoc-process-docstring", write_types, priority=400)  # before numpydoc
    return {"parallel_read_safe": True, "parallel_write_safe": True}
