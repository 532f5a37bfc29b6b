"""Public calculations refuse what they cannot take in a sentence, before they begin."""

from __future__ import annotations

import importlib
import inspect
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

import stochvi
from stochvi.results.errors import SceneError
from support.known import oscillator

ROOMS = (
    "", ".statistics", ".isolators", ".absorbers", ".verification", ".testing", ".methods.periodic",
    ".methods.closed_form", ".methods.linearisation", ".methods.fokker_planck",
    ".methods.monte_carlo",
)  # fmt: skip


def functions() -> Iterator[Callable[..., Any]]:
    """Every public function."""
    for room in ROOMS:
        package = importlib.import_module(f"stochvi{room}")
        for name in package.__all__:
            if inspect.isfunction(each := getattr(package, name)):
                yield each


def of_a_scene() -> list[Callable[..., Any]]:
    """The public functions whose first argument is a scene."""
    found = {
        each
        for each in functions()
        for first in list(inspect.signature(each).parameters.values())[:1]
        if first.annotation == "Scene"
    }
    return sorted(found, key=lambda each: each.__name__)


@pytest.mark.parametrize("function", of_a_scene(), ids=lambda each: each.__name__)
@pytest.mark.parametrize("wrong", ["truck.toml", None, {"structure": {}}, 3])
def test_what_is_no_scene_is_refused(function: Callable[..., Any], wrong: Any) -> None:
    parameters = list(inspect.signature(function).parameters.values())
    needed = [each for each in parameters[1:] if each.default is inspect.Parameter.empty]
    by_place = [0.0 for each in needed if each.kind is each.POSITIONAL_OR_KEYWORD]
    by_name = {each.name: 1 for each in needed if each.kind is each.KEYWORD_ONLY}
    with pytest.raises(SceneError, match=r"must be a Scene, as load_scene\("):
        function(wrong, *by_place, **by_name)


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ({"budget": -1.0}, "budget must be a positive number of seconds, got -1.0"),
        ({"budget": float("nan")}, "budget must be a positive number of seconds, got nan"),
        ({"budget": "60"}, "budget must be a number, got '60'"),
        ({"budget": 10**400}, "budget must be a number, got 10000"),
        ({"seed": 10**29}, r"seed must be a whole number below 2\^63, got 10000"),
        ({"paths": 2.5}, "paths must be a whole number, got 2.5"),
        ({"rel_error": [0.1]}, r"rel_error must be a number, got \[0.1\]"),
        ({"threads": "x" * 500}, "threads must be a whole number, got 'xxx.*xxx...$"),
    ],
)
def test_what_is_no_number_is_refused(arguments: dict[str, Any], sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        stochvi.simulate(oscillator(-1.0, 1.0, 0.8), **arguments)


def test_a_very_long_budget_is_none() -> None:
    scene = oscillator(-1.0, 1.0, 0.8)
    found = stochvi.simulate(scene, paths=2, duration=1.0, budget=10**29, threads=1)
    same = stochvi.simulate(scene, paths=np.int64(2), duration=np.float32(1.0), threads=1)
    assert found.coordinates == same.coordinates
