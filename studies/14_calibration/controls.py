"""Intervals of 64 paths with control variates and without: do they cover, and what do they gain?"""

import argparse
import time
from pathlib import Path

import numpy as np
import pandas as pd

from stochvi.model.model import model_of
from stochvi.motion.choose_plan import make_plan
from stochvi.motion.plan import PathStatistics, governed
from stochvi.scenes.scene import load_scene

HERE = Path(__file__).parent
ZOO = HERE.parents[1] / "data" / "scenes" / "zoo"
PATHS, AT_ONCE = 64, 1024
STUDENT = 1.998
"""Student's quantile for 95 % and 63 degrees of freedom."""


def rows_of(name: str, seconds: float) -> list[dict[str, object]]:
    """Coverage of the intervals of each quantity, from as many answers as some CPU seconds give."""
    model = model_of(load_scene(ZOO / f"{name}.toml"))
    plan = make_plan(model)
    whole, answers, began = PathStatistics.none(plan.layout), [], time.process_time()
    while time.process_time() - began < seconds:
        averages = plan.averages(7, whole.count, AT_ONCE)
        whole = whole.merge(PathStatistics.of(averages, plan.layout))
        parts = np.split(averages, AT_ONCE // PATHS, axis=1)
        answers += [PathStatistics.of(part, plan.layout) for part in parts]
    rows = []
    for (_, quantity), function in governed(model).items():
        truth, _ = whole.evaluate(function)
        row: dict[str, object] = {"scene": name, "quantity": quantity, "answers": len(answers)}
        for way, chosen in (
            ("plain", [answer.uncontrolled for answer in answers]),
            ("controlled", answers),
        ):
            values, errors = np.array([answer.evaluate(function) for answer in chosen]).T
            row[f"{way}_coverage"] = float(np.mean(np.abs(values - truth) < STUDENT * errors))
            row[f"{way}_spread"] = float(values.std())
            row[f"{way}_bias_in_spreads"] = float((values.mean() - truth) / values.std())
        rows.append(row)
    return rows


parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--seconds", type=float, default=1.5, help="of CPU for the paths of a scene")
parser.add_argument("--out", type=Path, default=HERE)
options = parser.parse_args()
table = pd.DataFrame(
    row
    for name in ("lossy-three-sigma", "lossy-preload", "lossy-0.5", "elastic-two-sigma")
    for row in rows_of(name, options.seconds)
)
print(table.to_string())
table.to_csv(options.out / "controls.csv", index=False, float_format="%.4g")
