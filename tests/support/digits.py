"""Digits of kernels in a process of its own; `python -m support.digits CASE ...` prints them."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
from pathlib import Path

import numpy as np

from stochvi import Restitution, Viscoelastic, load_scene
from stochvi.engine.calls import functions_of, stops_of
from stochvi.engine.compliant_contacts import make_workspace
from stochvi.engine.sub_steps import responses_of
from stochvi.engine.together import NOT_KNOWN, Ends, Scene, finish_together
from stochvi.model.model import model_of
from stochvi.motion.choose_plan import make_plan
from support import CHECKOUT
from support.mounts import two_stages

SCENES = CHECKOUT / "data" / "scenes"

IMPACTS = "impacts"
"""The case of one small kernel, which takes seconds to compile; every other case is a scene."""

RIGID, SOFT = Restitution(coefficient=0.5), Viscoelastic(stiffness=4e5, damping_ratio=0.3)

STAGES = {"two rigid stages": two_stages(RIGID, RIGID), "two soft stages": two_stages(SOFT, SOFT)}
"""Scenes of several coordinates under a table, by the name of the case."""


def impacts() -> np.ndarray:
    """Ends of a step in which each lane may hit one stop, by `finish_together`."""
    lanes, terms, states, step = 400, 8, 2, 0.25
    random = np.random.default_rng(1)
    y0, v0, a0 = random.uniform(-0.2, 0.9, lanes), random.uniform(0.5, 4.0, lanes), -np.ones(lanes)
    y1, v1, a1 = y0 + step * v0 - 0.5 * step**2, v0 - step, random.uniform(-1.5, -0.5, lanes)
    ends = Ends(*(row.reshape(1, lanes).copy() for row in (y0, v0, a0, y1, v1, a1)))
    places, law = np.array([[-9.0, 1.0]]), RIGID.compiled()
    stops, laws = stops_of(places, np.zeros(1), {(0, 0): law, (0, 1): law})
    series = random.uniform(0.5, 1.0, (5, terms)) / 10.0 ** np.arange(terms)
    responses = responses_of(series[None, 3:], 1, series[None, None, :3], np.zeros((1, 0, terms)))
    new, sums = random.normal(size=(states, lanes)), np.zeros((1, 6, lanes))
    scene = Scene(
        step, stops, functions_of(laws, lanes=True), responses, NOT_KNOWN,
        make_workspace(1, states, terms), ends, new, sums, np.zeros((lanes, 1, 2)),
        np.zeros(lanes, np.uint64), None, 0, 0, None,
    )  # fmt: skip
    index = np.flatnonzero(y1 > 1.0)
    finish_together(index, scene, None)
    assert sums[0, 3].sum() > index.size // 2
    return np.concatenate([new, ends.y1, sums[0]])


def sums_of(scene: str) -> np.ndarray:
    """Averages of a few paths of a scene: one of STAGES, or the name of a scene file."""
    found = STAGES[scene] if scene in STAGES else load_scene(SCENES / f"{scene}.toml")
    return make_plan(model_of(found)).averages(3, 0, 8)


def digits(case: str) -> str:
    """A digest of all digits of a case."""
    found = impacts() if case == IMPACTS else sums_of(case)
    assert np.isfinite(found).all()
    return hashlib.sha256(np.ascontiguousarray(found).tobytes()).hexdigest()


def digits_of_a_process(cases: list[str], cache: Path) -> dict[str, str]:
    """The digits of the cases, in this order, in a process that keeps its kernels in `cache`."""
    paths = os.pathsep.join(str(folder) for folder in (CHECKOUT, CHECKOUT / "tests"))
    printed = subprocess.run(
        [sys.executable, "-m", "support.digits", *cases],
        capture_output=True,
        text=True,
        check=True,
        env=os.environ | {"PYTHONPATH": paths, "NUMBA_CACHE_DIR": str(cache)},
    ).stdout.split()
    return dict(zip(cases, printed, strict=True))


if __name__ == "__main__":
    for case in sys.argv[1:]:
        print(digits(case))
