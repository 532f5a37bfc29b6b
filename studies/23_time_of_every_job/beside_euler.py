"""Structures beside a plain loop: CPU time of a second of a path, in units of Euler's for one mass.

`python beside_euler.py` prints and writes `beside_euler.csv`. The loop is what one writes at first:
a path after the other, semi-implicit Euler steps of 0.032 s, overshoot mirrored, NumPy's normals.
The structures are chains of masses of 1 kg on springs of 1 N/m, with dampers of 0.1 N s/m and white
noise on each, at the step that `simulate` takes. Times are those of plan and kernels on one thread.
"""

import argparse
import math
import time
from dataclasses import replace
from pathlib import Path

import numba
import numpy as np
import pandas as pd

import stochvi as sv
from stochvi.model.model import model_of
from stochvi.motion.choose_plan import make_plan

EULER_STEP = 0.032
LAWS = {
    "R = 1": sv.Restitution(coefficient=1.0),
    "R = 0.5": sv.Restitution(coefficient=0.5),
    "viscoelastic": sv.Viscoelastic(stiffness=1e4, damping_ratio=0.2),
    "Hertz": sv.scenes.Hertz(coefficient=1e4),
}


@numba.njit
def euler(paths, steps, h, sums):
    """One mass of 1 kg between elastic stops at 1 m on either side."""
    kick = math.sqrt(0.2 * h)
    for path in range(paths):
        x = v = 0.0
        for _ in range(steps):
            v += -h * (x + 0.1 * v) + kick * np.random.standard_normal()  # noqa: NPY002 - numba has this one
            x += h * v
            if abs(x) > 1.0:
                w = abs(v)
                x, v = math.copysign(2.0 - abs(x), x), -v
                sums[path, 3] += 1.0
                sums[path, 4] += w
            sums[path, 0] += x
            sums[path, 1] += x * x
            sums[path, 2] += v * v


def chain(masses: int, law: object) -> sv.Scene:
    """One pair on two masses; four pairs, two of them between neighbours, on six."""
    names = [f"m{k}" for k in range(masses)]
    places = [("p0", {"on": "m0"}, 1.0)]
    if masses == 6:
        places += [("p1", {"between": ["m2", "m1"]}, 0.8), ("p2", {"on": "m3"}, 1.2)]
        places += [("p3", {"between": ["m5", "m4"]}, 0.7)]
    stiffness = 2.0 * np.eye(masses) - np.eye(masses, k=1) - np.eye(masses, k=-1)
    return sv.Scene(
        structure=sv.Matrices(
            coordinates=names, mass=np.eye(masses).tolist(),
            damping=(0.1 * np.eye(masses)).tolist(), stiffness=stiffness.tolist(),
        ),
        impact_pairs=[
            sv.ImpactPair(name=name, lower=-gap, upper=gap, law=law, **where)
            for name, where, gap in places
        ],
        excitations=[sv.WhiteNoise(on=name, intensity=0.2) for name in names],
    )  # fmt: skip


def nanoseconds(run, steps: int, repeats: int) -> float:
    """CPU ns a step: what a run of three times as many steps takes more, the least of the
    repeats."""
    found = []
    for _ in range(repeats):
        times = []
        for many in (steps, 3 * steps):
            began = time.process_time()
            run(many)
            times.append(time.process_time() - began)
        found.append(1e9 * (times[1] - times[0]) / (2.0 * steps))
    return min(found)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--out", type=Path, default=Path(__file__).parent)
    options = parser.parse_args()
    total, repeats = (50_000, 1) if options.quick else (1_000_000, 3)
    sums = np.zeros((16, 5))
    euler(1, 1, EULER_STEP, sums)
    plain = nanoseconds(lambda n: euler(16, n // 16, EULER_STEP, sums), total, repeats)
    rows = []
    for masses in (2, 6):
        for name, law in LAWS.items():
            plan = make_plan(model_of(chain(masses, law)))
            plan.shortest().averages(1, 0, 4)

            def of_paths(paths: int, plan=plan) -> float:
                def run(steps: int) -> None:
                    length = max(2, steps // paths) * plan.step
                    replace(plan, burn_in=plan.step, duration=length).averages(1, 0, paths)

                return nanoseconds(run, total // (4 if paths < 64 else 1), repeats)

            many, few = of_paths(1024), of_paths(16)
            ratio = many / plan.step / (plain / EULER_STEP)
            rows.append((masses, len(plan.pairs), name, plan.step, many, few, few / many, ratio))
            print(*rows[-1], flush=True)
    columns = ["masses", "pairs", "law", "step, s", "1024 paths, ns", "16 paths, ns", "few / many"]
    found = pd.DataFrame(rows, columns=[*columns, "beside Euler"])
    found.to_csv(options.out / "beside_euler.csv", index=False, float_format="%.3g")
    print(f"Euler: {plain:.3g} ns a step, {plain / EULER_STEP:.3g} ns a second of a path")
