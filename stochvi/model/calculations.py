"""What public calculations share: arguments are checked, progress is shown, a budget ends them, and
answers record their call."""

from __future__ import annotations

import functools
import inspect
import math
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import replace
from typing import Any, ParamSpec, TypeVar

import numpy as np

from stochvi.mathematics.arguments import CHECKS, argument_checker, shown
from stochvi.mathematics.shown_units import USUAL, shown_in
from stochvi.results.base import Result
from stochvi.results.deadline import asked_for, ended_by, watched
from stochvi.results.errors import (
    Interrupted,
    NotApplicable,
    NotConverged,
    SceneError,
    StochviError,
    beyond_arithmetic,
)
from stochvi.results.origin import call_of
from stochvi.results.progress import showing, shown_in_notebooks
from stochvi.scenes.scene import Scene

P = ParamSpec("P")
T = TypeVar("T")


def _check_scene(name: str, value: object) -> None:
    if not isinstance(value, Scene):
        raise SceneError(
            f'{name} must be a Scene, as load_scene("FILE.toml") makes it, got {shown(value)}'
        )


CHECKS["Scene"] = _check_scene


def calculation(function: Callable[P, T]) -> Callable[P, T]:
    """A public calculation.

    Before it begins, its scene and its plain arguments are checked against their annotations. Its
    progress is shown in a notebook, with the compiling of kernels. A `budget` that is long over
    ends it (see `ended_by`); messages name this budget also where a part of it has run out. An
    answer, also one that falls short, records the call in its provenance.
    """
    check, parameters = argument_checker(function), inspect.signature(function).parameters
    budget = parameters.get("budget")

    @functools.wraps(function)
    def run(*args: P.args, **kwargs: P.kwargs) -> T:
        bound = check(*args, **kwargs)
        given = bound.arguments
        with ExitStack() as around:
            # what an answer says of its calculation does not depend on who reads it
            around.enter_context(shown_in(USUAL))
            if "progress" in parameters:
                wanted = shown_in_notebooks(function.__name__, given.get("progress"))
                given["progress"] = around.enter_context(showing(around.enter_context(wanted)))
            if budget is not None:
                seconds = given.get("budget", budget.default)
                if seconds is not None and not 0.0 < seconds < math.inf:
                    raise ValueError(
                        f"budget must be a positive number of seconds, got {shown(seconds)}"
                    )
                around.enter_context(asked_for(seconds))
                if not watched():
                    around.enter_context(ended_by(seconds))
            try:
                answer: T = recorded(function(*bound.args, **bound.kwargs), given)
            except (NotConverged, Interrupted) as error:
                error.partial = recorded(error.partial, given)
                raise
            except (ArithmeticError, np.linalg.LinAlgError) as error:
                if isinstance(error, StochviError):
                    raise
                scenes = [each for each in given.values() if isinstance(each, Scene)]
                document = scenes[0].document(as_written=True) if scenes else None
                why = f"the scene {beyond_arithmetic(error, document)}"
                raise NotApplicable(function.__name__, [why]) from error
        return answer

    def recorded(answer: Any, given: Mapping[str, Any]) -> Any:
        if not isinstance(answer, Result):
            return answer
        defaults = {
            name: each.default
            for name, each in parameters.items()
            if each.default is not inspect.Parameter.empty
        }
        call = call_of(function.__name__, {**defaults, **given})
        return replace(answer, provenance={**answer.provenance, "call": call})

    return run
