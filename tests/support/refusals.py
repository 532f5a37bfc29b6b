"""Refusals: what is asked, and the words of the sentence that answers it."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable
from typing import Any

import pytest

from stochvi import (
    average,
    damage,
    exact,
    first_passage,
    fokker_planck,
    harmonic_response,
    linearise,
    reliability,
    screen,
    size,
    transient,
)
from stochvi.isolators import bumper_map
from stochvi.results.errors import SceneError
from support.commands import Finished, refused

OTHER_METHODS: tuple[Callable[[Any], object], ...] = (
    exact, average, screen, fokker_planck, bumper_map,
    lambda scene: damage(scene, mission=10.0),
    lambda scene: linearise(scene, form="force"),
    lambda scene: transient(scene, [1.0, 2.0]),
    lambda scene: first_passage(scene, 10.0),
    lambda scene: reliability(scene, mission=10.0),
    lambda scene: size(scene, probability=0.01, mission=10.0),
    lambda scene: harmonic_response(scene, [0.1, 0.2]),
)  # fmt: skip
"""Calculations that take no drive which `simulate` alone follows."""


def refusals(
    call: Callable[..., object], *rows: tuple[Any, ...],
    error: type[Exception] | tuple[type[Exception], ...] = SceneError, pattern: bool = False,
) -> Callable[..., None]:  # fmt: skip
    """A test of a call, one case a row: its last arguments, then words that its sentence holds.

    One dictionary in a row gives the call its keywords where the call is a class. The arguments
    before those of the row are fixtures. The words may be a regular expression, a `pattern`. A
    command may be called as well: its sentence stands on stderr, and its exit code is 2.
    """
    keywords = inspect.isclass(call)
    taken = [] if keywords else inspect.signature(call).parameters.values()
    needed = [each.name for each in taken if each.default is each.empty and each.kind < 2]
    fixtures = needed[: max(0, len(needed) - len(rows[0]) + 1)]

    @pytest.mark.parametrize("row", rows, ids=lambda row: str(row[-1]))
    def is_refused(row: tuple[Any, ...], request: pytest.FixtureRequest) -> None:
        *arguments, words = row
        given = [request.getfixturevalue(name) for name in fixtures]
        with pytest.raises(error) as failure:
            _heard(call(**arguments[0]) if keywords else call(*given, *arguments))
        sentence = str(failure.value)
        assert re.search(words, sentence) if pattern else words in sentence

    return is_refused


def _heard(answer: object) -> None:
    """Raise what a command says as it refuses."""
    if isinstance(answer, Finished):
        raise SceneError(refused(answer))
