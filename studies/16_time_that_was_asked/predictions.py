"""Predicted times after a tenth of a run, and the times that runs took, in CPU seconds."""

import math
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

time.time = time.monotonic = time.perf_counter = time.process_time

import pandas as pd  # noqa: E402
from cases import scenes  # noqa: E402

from stochvi import impacts, load_scene, reliability, simulate, spectrum  # noqa: E402
from stochvi.results.deadline import Pace  # noqa: E402

Solve = Callable[..., Any]
"""A function that takes `rel_error`, `budget` and `progress`."""

RUNS: tuple[tuple[str, Solve, str, float], ...] = (
    ("simulate", simulate, "absorber in a box", 1e-3),
    ("simulate", simulate, "white noise, lossy", 7e-4),
    ("simulate", simulate, "three masses", 1e-3),
    ("simulate", simulate, "truck, rubber stops", 2e-3),
    ("simulate", simulate, "record", 1e-2),
    ("simulate", simulate, "hammer", 4e-2),
    ("spectrum", spectrum, "truck, rubber stops", 2e-2),
    ("spectrum", spectrum, "absorber in a box", 3e-2),
    ("impacts", impacts, "white noise, lossy", 1.5e-3),
    ("impacts", impacts, "truck, rubber stops", 5e-3),
    ("reliability", partial(reliability, mission=3600.0), "truck, table stops", 1.2e-3),
    ("reliability", partial(reliability, mission=60.0, impact_speed=0.5), "truck, table stops",
     3e-2),
)  # fmt: skip
"""Command, function, scene and a relative error that takes some seconds to reach."""


def measured(solve: Solve, scene: str, rel_error: float) -> dict[str, float]:
    """CPU seconds of a run with compiled kernels, and those that its progress had predicted when a
    tenth of them had passed."""
    loaded, told = load_scene(scenes()[scene]), list[tuple[float, float]]()
    arguments: dict[str, Any] = {"rel_error": rel_error, "seed": 1, "threads": 1, "budget": 600.0}
    solve(loaded, **arguments | {"rel_error": 0.3})
    pace, began = Pace(""), time.process_time()

    def progress(done: float, _: str) -> None:
        told.append((time.process_time() - began, pace.left(done)))

    solve(loaded, **arguments, progress=progress)
    took = time.process_time() - began
    later = (each for each in told if each[0] >= 0.1 * took and math.isfinite(each[1]))
    moment, left = next(later, (math.nan, math.nan))
    return {
        "took": round(took, 2), "at": round(moment, 2), "predicted": round(moment + left, 2),
        "ratio": round((moment + left) / took, 2),
    }  # fmt: skip


rows = []
for command, solve, scene, rel_error in RUNS:
    asked = {"command": command, "scene": scene, "rel_error": rel_error}
    rows.append(asked | measured(solve, scene, rel_error))
    print(*rows[-1].values(), sep=" | ", flush=True)
    pd.DataFrame(rows).to_csv(Path(__file__).with_name("predictions.csv"), index=False)
