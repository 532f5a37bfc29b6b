"""Public calculations refuse what they cannot take in a sentence, before they begin."""

from __future__ import annotations

import importlib
import inspect
import re
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import stochvi
from stochvi.results.deadline import stood_still
from stochvi.results.errors import SceneError, StochviError
from support.calls import SECONDS, Caller, callables
from support.known import oscillator
from support.mutations import BARE

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
        ({"statistics": 3.0}, "statistics must be a table of names and values of Statistic, got 3"),
    ],
)
def test_what_is_no_number_is_refused(arguments: dict[str, Any], sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        stochvi.simulate(oscillator(-1.0, 1.0, 0.8), **arguments)


@pytest.mark.parametrize("function", [stochvi.production, stochvi.mean_over_units])
def test_spreads_are_a_table(function: Callable[..., Any]) -> None:
    with pytest.raises(ValueError, match="spreads must be a table of names and values of Spread"):
        function(oscillator(-1.0, 1.0, 0.8), 0.05)


def test_a_very_long_budget_is_none() -> None:
    scene = oscillator(-1.0, 1.0, 0.8)
    found = stochvi.simulate(scene, paths=2, duration=1.0, budget=10**29, threads=1)
    same = stochvi.simulate(scene, paths=np.int64(2), duration=np.float32(1.0), threads=1)
    assert found.coordinates == same.coordinates


OF_PYTHON = re.compile(r"missing .* required|unexpected keyword|positional argument|keywords only")
"""What Python says of arguments that are missing or unknown."""

LONGEST = 1.2 * SECONDS + 2.0
"""CPU seconds that a call may take, without the compiling of kernels."""


def call(seed: int) -> None:
    """One call, which answers or refuses in a sentence, in time."""
    caller = Caller(seed)
    began, stood = time.process_time(), stood_still()
    said = "an answer"
    try:
        caller()
    except (StochviError, ValueError, OSError) as error:
        said = str(error).split(", got ")[0].replace("must be finite", "")
    except TypeError as error:
        if not OF_PYTHON.search(str(error)):
            raise AssertionError(f"seed {seed}: {caller}") from error
    except BaseException as error:
        raise AssertionError(f"seed {seed}: {caller}") from error
    assert len(said) > 8 and not BARE.search(said), f"seed {seed}: {said}, {caller}"
    spent = time.process_time() - began - (stood_still() - stood)
    assert spent < LONGEST, f"seed {seed}: {spent:.1f} s, {caller}"


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
def test_calls_with_wrong_arguments_end_in_sentences(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for seed in range(len(callables())):
        call(seed)


@pytest.mark.verify
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("part", range(1, 31))
def test_thousands_of_calls_end_in_sentences(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, part: int
) -> None:
    monkeypatch.chdir(tmp_path)
    for seed in range(part * len(callables()), (part + 1) * len(callables())):
        call(seed)
