"""Check the docstrings of public names by numpydoc: `python docs/_extensions/docstrings.py`.

The checks stand in `pyproject.toml`, under `tool.numpydoc_validation`: those of every public name,
those of functions, and those of classes at the top of the package, which users make themselves.
Parameters of classes are their fields, which are checked where the schemas are made. Examples are
run by the test suite.
"""

import importlib
import inspect
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

from numpydoc.validate import validate

ROOMS = (
    "absorbers", "isolators", "methods.averaging", "methods.closed_form", "methods.fokker_planck",
    "methods.linearisation", "methods.monte_carlo", "methods.periodic", "methods.replay", "results",
    "scenes", "statistics", "testing", "verification",
)  # fmt: skip
"""Packages with public names."""


def faults() -> Iterator[str]:
    """Name, code and sentence of every check that a docstring does not pass."""
    text = (Path(__file__).parents[2] / "pyproject.toml").read_text(encoding="utf-8")
    chosen = tomllib.loads(text)["tool"]["numpydoc_validation"]
    seen = set()
    for place in ("stochvi", *(f"stochvi.{room}" for room in ROOMS)):
        package = importlib.import_module(place)
        for name in getattr(package, "__all__", ()):
            each = getattr(package, name)
            if inspect.ismodule(each) or not callable(each) or each in seen:
                continue
            seen.add(each)
            checks = set(chosen["checks"])
            if inspect.isfunction(each):
                checks |= set(chosen["functions"])
            elif place == "stochvi" and not issubclass(each, BaseException):
                checks |= set(chosen["top"])
            for code, sentence in validate(f"{place}.{name}")["errors"]:
                if code in checks:
                    yield f"{place}.{name}: {code} {sentence}"


if __name__ == "__main__":
    found = list(faults())
    print("\n".join(found) or "docstrings of all public names pass")
    sys.exit(bool(found))
