"""Sizes are refused before memory is taken for them."""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable
from typing import Any

import pytest

import stochvi
from stochvi.isolators import jolts
from stochvi.methods.monte_carlo import record_path
from stochvi.results.errors import SceneError, StochviError
from stochvi.scenes.datasets import shipped_scene
from support.commands import Run, refused
from support.known import oscillator

MOUNT, BUMPER = str(shipped_scene("isolator-sine")), str(shipped_scene("isolator-bumper"))

MANY, ENDS = "100000000", ("--from", "1", "--to", "20")

QUESTIONS = {
    "sine": ((MOUNT, *ENDS, "--points", MANY), "--points must be at most 1000000"),
    "bifurcation": ((MOUNT, *ENDS, "--points", MANY), "--points must be at most 1000000"),
    "basins": (
        (MOUNT, "--start", f"displacement.x=-1:1:{MANY}", "--start", f"velocity.x=-1:1:{MANY}"),
        "--start displacement.x must be at most 1000000",
    ),
    "history": ((BUMPER, "--duration", "1e6"), r"ask for about 1.2e\+04 s or less"),
    "jolt": ((MOUNT, "--speeds", "0.1", "--paths", MANY), "paths must be at most 1[0-9]{5}, got"),
}


@pytest.mark.parametrize("command", QUESTIONS)
def test_a_command_refuses_what_would_not_fit(stochvi: Run, command: str) -> None:
    words, sentence = QUESTIONS[command]
    tracemalloc.start()
    said = refused(stochvi(command, *words))
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert pytest.approx(0, abs=2e8) == peak  # it used to take gigabytes
    with pytest.raises(ValueError, match=sentence):
        raise ValueError(said)


@pytest.mark.parametrize(
    "ask",
    [
        lambda scene: record_path(scene, duration=10.0, step=1e-300),
        lambda scene: record_path(scene, duration=1e12),
        lambda scene: stochvi.history(scene, duration=10.0, rate=1e300),
        lambda scene: stochvi.history(scene, duration=1e12),
        lambda scene: jolts(stochvi.load_scene(MOUNT), [0.1], paths=10**9),
    ],
)
def test_a_function_refuses_what_would_not_fit(ask: Callable[[Any], Any]) -> None:
    with pytest.raises((StochviError, ValueError), match="at most"):
        ask(oscillator(-1.0, 1.0, 0.8))


def test_a_message_has_few_lines() -> None:
    error = SceneError([(f"key.{number}", "is wrong") for number in range(100_000)])
    lines = str(error).splitlines()
    assert len(lines) == 20 and lines[-1] == "and 99981 more like these"
    assert len(error.problems) == 100_000
