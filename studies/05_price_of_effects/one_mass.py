"""One mass with rigid stops by its own kernel and by that for any structure: what 1 % costs."""

import argparse
import math
import time
from pathlib import Path

import numpy as np
import pandas as pd

import stochvi as sv
from stochvi.model.model import model_of
from stochvi.motion.choose_plan import make_plan, plan_several
from stochvi.motion.plan import Plan

LAWS = {
    "rigid, R = 0.5": sv.Restitution(coefficient=0.5),
    "rigid, R = 1": sv.Restitution(coefficient=1.0),
}
WHITE = sv.WhiteNoise(on="base", intensity=4.0)


def mount(law: object) -> sv.Scene:
    """1 kg at 12 Hz, zeta = 0.1, with stops at 4 mm below and 2 mm above."""
    pair = sv.ImpactPair(on="x", lower=-4e-3, upper=2e-3, law=law)
    structure = sv.Isolator(frequency_hz=12.0, zeta=0.1, mass=1.0)
    return sv.Scene(structure=structure, impact_pairs=[pair], excitations=[WHITE])


def rate(plan: Plan, seed: int, paths: int) -> tuple[float, float]:
    """Impacts per second on both stops together, and the standard error."""
    averages = plan.averages(seed, 0, paths)
    rows = [k for k, (_, what) in enumerate(plan.layout.rows) if what in ("n_lower", "n_upper")]
    hits = averages[rows].sum(axis=0)
    return float(hits.mean()), float(hits.std(ddof=1)) / math.sqrt(paths)


def measured(plan: Plan, paths: int, repeats: int = 3) -> tuple[float, float, float]:
    """The rate (1/s), its standard error, and CPU seconds for a standard error of 1 %."""
    rate(plan, 0, 8)  # compiles
    found, seconds = [], math.inf
    for seed in range(1, repeats + 1):
        start = time.process_time()
        found.append(rate(plan, seed, paths))
        seconds = min(seconds, time.process_time() - start)
    value, error = np.mean(found, axis=0)
    return value, error / math.sqrt(repeats), seconds * (error / value / 0.01) ** 2


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="fewer paths")
    parser.add_argument("--out", type=Path, default=Path(__file__).parent)
    options = parser.parse_args()
    rows = []
    for stops, law in LAWS.items():
        model = model_of(mount(law))
        plans = make_plan(model), plan_several(model, None, None)
        one, several = (measured(plan, 32 if options.quick else 256) for plan in plans)
        apart = (one[0] - several[0]) / math.hypot(one[1], several[1])
        rows.append((stops, one[0], apart, one[2], several[2], several[2] / one[2]))
    columns = ["stops", "rate", "apart", "one_mass", "any_structure", "ratio"]
    table = pd.DataFrame(rows, columns=columns)
    table.to_csv(options.out / "one_mass.csv", index=False)
    print(table.to_string())
