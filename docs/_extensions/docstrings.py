"""Check the docstrings of public names by numpydoc: `python docs/_extensions/docstrings.py`.

The checks stand in `pyproject.toml`, under `tool.numpydoc_validation`: those of every public name,
those of functions, and those of classes at the top of the package, which users make themselves.
Parameters of classes are their fields, which are checked where the schemas are made. Examples are
run by the test suite. What a docstring says to look at next must have a page.
"""

import importlib
import inspect
import sys
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from numpydoc.docscrape import NumpyDocString
from numpydoc.validate import validate

ROOMS = (
    "absorbers", "identification", "isolators", "methods.averaging", "methods.closed_form",
    "methods.fokker_planck", "methods.linearisation", "methods.monte_carlo", "methods.periodic",
    "methods.replay", "results", "scenes", "statistics", "testing", "testing.samples",
    "verification",
)  # fmt: skip
"""Packages with public names."""


def faults() -> Iterator[str]:
    """Name, code and sentence of every check that a docstring does not pass."""
    text = (Path(__file__).parents[2] / "pyproject.toml").read_text(encoding="utf-8")
    chosen = tomllib.loads(text)["tool"]["numpydoc_validation"]
    public = public_names()
    for full, each in public.items():
        place = full.rpartition(".")[0]
        checks = set(chosen["checks"])
        if inspect.isfunction(each):
            checks |= set(chosen["functions"])
        elif place == "stochvi" and not issubclass(each, BaseException):
            checks |= set(chosen["top"])
        with signature_as_written(each):
            errors = validate(full)["errors"]
        for code, sentence in errors:
            if code in checks:
                yield f"{full}: {code} {sentence}"
        for targets, _ in NumpyDocString(inspect.getdoc(each) or "")["See Also"]:
            for target, _ in targets:
                if not {target, f"{place}.{target}"} & public.keys():
                    yield f"{full}: See Also names {target!r}, which has no page of its own"


@contextmanager
def signature_as_written(function: Any) -> Iterator[None]:
    """Within it a function has `**options`, and not one by one what its signature shows for them,
    which `SamplingOptions` documents once for all."""
    shown = []
    while function is not None and inspect.isfunction(function):
        if "__signature__" in vars(function):
            shown.append((function, vars(function).pop("__signature__")))
        function = getattr(function, "__wrapped__", None)
    try:
        yield
    finally:
        for each, signature in shown:
            each.__signature__ = signature


def public_names() -> dict[str, Any]:
    """Every public function and class by the name under which the manual has it."""
    found: dict[str, Any] = {}
    for place in ("stochvi", *(f"stochvi.{room}" for room in ROOMS)):
        package = importlib.import_module(place)
        for name in getattr(package, "__all__", ()):
            each = getattr(package, name)
            if callable(each) and not inspect.ismodule(each) and each not in found.values():
                found[f"{place}.{name}"] = each
    return found


if __name__ == "__main__":
    found = list(faults())
    print("\n".join(found) or "docstrings of all public names pass")
    sys.exit(bool(found))
