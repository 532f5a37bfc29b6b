"""What public calculations share: arguments are checked, progress is shown, a budget ends them, and
answers record their call."""

from __future__ import annotations

import functools
import inspect
import math
import numbers
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace
from typing import Any, ParamSpec, TypeVar

from stochvi.results.base import Result
from stochvi.results.deadline import ended_by, watched
from stochvi.results.errors import Interrupted, NotConverged, SceneError
from stochvi.results.origin import call_of
from stochvi.results.progress import showing, shown_in_notebooks
from stochvi.scenes.scene import Scene

P = ParamSpec("P")
T = TypeVar("T")

MOST_SHOWN = 60
"""Largest number of characters of a wrong value that a message repeats."""

LARGEST_WHOLE = 2**63
"""Whole numbers below this one fit into the numbers of compiled code."""


LARGEST_NUMBER = 10**300
"""Whole numbers below this one can be converted to numbers of double precision."""


def shown(value: object) -> str:
    """A wrong value as a message repeats it: its beginning, whatever it is."""
    try:
        text = repr(value)
    except Exception:  # what cannot be shown is named
        text = f"something of type {type(value).__name__}"
    text = " ".join(text.split())
    return text if len(text) <= MOST_SHOWN else text[: MOST_SHOWN - 3] + "..."


def _check_scene(name: str, value: object) -> None:
    if not isinstance(value, Scene):
        raise SceneError(
            f'{name} must be a Scene, as load_scene("FILE.toml") makes it, got {shown(value)}'
        )


def _check_number(name: str, value: object) -> None:
    known = isinstance(value, numbers.Real)
    if not known or (isinstance(value, int) and abs(value) >= LARGEST_NUMBER):
        raise ValueError(f"{name} must be a number, got {shown(value)}")


def _check_whole(name: str, value: object) -> None:
    if not isinstance(value, numbers.Integral):
        raise ValueError(f"{name} must be a whole number, got {shown(value)}")
    if not -LARGEST_WHOLE <= int(value) < LARGEST_WHOLE:
        raise ValueError(f"{name} must be a whole number below 2^63, got {shown(value)}")


def _check_text(name: str, value: object) -> None:
    if not isinstance(value, str):
        raise ValueError(f"{name} must be a text, got {shown(value)}")


CHECKS: dict[str, Callable[[str, Any], None]] = {
    "Scene": _check_scene, "float": _check_number, "int": _check_whole, "str": _check_text,
}  # fmt: skip
"""Checks of arguments by their annotation, which may also allow None."""

LEFT_OUT = " | None"
"""End of the annotation of an argument that may be left out."""


def calculation(function: Callable[P, T]) -> Callable[P, T]:
    """A public calculation.

    Before it begins, its scene and its plain arguments are checked against their annotations. Its
    progress is shown in a notebook, with the compiling of kernels. A `budget` that is long over
    ends it (see `ended_by`). An answer, also one that falls short, records the call in its
    provenance.
    """
    signature = inspect.signature(function)
    checks = {
        name: (CHECKS[kind], optional != "")
        for name, each in signature.parameters.items()
        for kind, optional in [str(each.annotation).partition(LEFT_OUT)[:2]]
        if kind in CHECKS
    }
    budget = signature.parameters.get("budget")

    @functools.wraps(function)
    def run(*args: P.args, **kwargs: P.kwargs) -> T:
        try:
            given = signature.bind(*args, **kwargs).arguments
        except TypeError:
            return function(*args, **kwargs)  # Python says which argument is missing
        for name, (check, optional) in checks.items():
            if name in given and not (optional and given[name] is None):
                check(name, given[name])
        with ExitStack() as around:
            if "progress" in signature.parameters:
                wanted = shown_in_notebooks(function.__name__, given.get("progress"))
                kwargs["progress"] = around.enter_context(showing(around.enter_context(wanted)))
            if budget is not None:
                seconds = given.get("budget", budget.default)
                if seconds is not None and not 0.0 < seconds < math.inf:
                    raise ValueError(
                        f"budget must be a positive number of seconds, got {shown(seconds)}"
                    )
                if not watched():
                    around.enter_context(ended_by(seconds))
            try:
                return recorded(function(*args, **kwargs), given)
            except (NotConverged, Interrupted) as error:
                error.response = recorded(error.response, given)
                raise

    def recorded(answer: Any, given: dict[str, Any]) -> Any:
        if not isinstance(answer, Result):
            return answer
        defaults = {
            name: each.default
            for name, each in signature.parameters.items()
            if each.default is not inspect.Parameter.empty
        }
        call = call_of(function.__name__, defaults | given)
        return replace(answer, provenance={**answer.provenance, "call": call})

    return run
