"""A drive is two files of its own: what a user writes and what kernels call."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import stochvi

WRITTEN = """
from typing import ClassVar, Literal
from stochvi.scenes.excitations.drawn import DrawnExcitation

class Knocks(DrawnExcitation):
    effect_word: ClassVar[str] = "knocks"
    family: ClassVar[str] = "knocks"
    white: ClassVar[bool] = True
    kind: Literal["knocks"] = "knocks"
    rate: float
    impulse: float

    @property
    def mean(self):
        return 0.0

    @property
    def si_intensity(self):
        return self.rate * self.impulse**2

    @property
    def fastest(self):
        return 10.0 * self.rate

    @property
    def jump(self):
        return self.impulse

    def compiled(self, mass):
        from stochvi.engine.characteristics.knocks import RandomKnocks

        return RandomKnocks(self.rate, self.impulse / mass)

    def louder(self, level_db):
        return self

    def facts(self, where, numbers):
        return [(f"Knocks on {where}", f"{self.rate:.4g} per second")]
"""

CALLED = """
import math
from typing import NamedTuple
from stochvi.engine.characteristic import kicked, pull, read, remembers
from stochvi.engine.drive import drawn, draws, kept
from stochvi.engine.uniform_numbers import uniform_of

class RandomKnocks(NamedTuple):
    rate: float
    size: float

@pull.of(RandomKnocks)
def _(part, x, v, z):
    return 0.0

@kicked.of(RandomKnocks)
def _(part, x, v, z, push, damping, h):
    return v + push * h + z

@remembers.of(RandomKnocks)
def _(part):
    return True

@draws.of(RandomKnocks)
def _(part):
    return True

@kept.of(RandomKnocks)
def _(part, z):
    return 0.0

@drawn.of(RandomKnocks)
def _(part, z, word, event, h):
    count, time = 0, -math.log(uniform_of(word, event)) / part.rate
    while time < h and count < 3:
        z += part.size if uniform_of(word, event + 2 * count + 1) < 0.5 else -part.size
        count += 1
        time -= math.log(uniform_of(word, event + 2 * count)) / part.rate
    return z

@read.of(RandomKnocks)
def _(part, numbers, row):
    return RandomKnocks(numbers[row, 0], numbers[row, 1])
"""

ASKED = """
import numpy as np
from stochvi.engine.drive import FIRST_DRAW, changes_of
from stochvi.model.model import model_of
from stochvi.scenes.scene import scene_from
scene = scene_from({
    "structure": {"kind": "oscillator", "mass": 2.0, "stiffness": 2.0, "damping": 0.4},
    "excitation": [{"kind": "knocks", "rate": 0.5, "impulse": 0.8}],
})
(part,) = model_of(scene).drives
changes = np.empty(40_000)
changes_of(part.law.compiled(part.mass), np.uint64(3), FIRST_DRAW, 0.1, changes)
print(part.mass**2 * np.mean(changes**2), part.mass**2 * np.std(changes**2) / 200.0)
"""


@pytest.mark.slow
def test_a_drive_of_the_package_is_two_files_of_its_own(tmp_path: Path) -> None:
    """No list has to name it. The mean square of its impulse in a step h is rate h J^2."""
    package = tmp_path / "stochvi"
    shutil.copytree(
        Path(stochvi.__file__).parent, package, ignore=shutil.ignore_patterns("__pycache__")
    )
    (package / "scenes/excitations/knocks.py").write_text(WRITTEN)
    (package / "engine/characteristics/knocks.py").write_text(CALLED)
    place = os.environ | {"PYTHONPATH": str(tmp_path), "NUMBA_CACHE_DIR": str(tmp_path / "kept")}
    done = subprocess.run(
        [sys.executable, "-c", ASKED], cwd=tmp_path, env=place, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    square, error = map(float, done.stdout.split())
    exact = 0.5 * 0.1 * 0.8**2
    assert abs(square - exact) < 4.5 * error < 0.2 * exact
