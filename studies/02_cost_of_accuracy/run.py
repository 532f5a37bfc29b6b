"""CPU time against bias of the collision rate: this engine and what is written instead."""

import argparse
import math
import time
from pathlib import Path

import controls
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import peers
from cases import CASES, scene

import stochvi as sv

BURN_IN = 60.0  # seconds of scene time


def measured_peer(function, h: float, paths: int, duration: float, *case):
    """CPU ns per second of scene time, mean rate and its standard error."""
    rates, cpu = function(paths, math.ceil(BURN_IN / h), math.ceil(duration / h), h, *case)
    scale = 1e9 / (paths * (BURN_IN + duration))
    return cpu * scale, rates.mean(), rates.std() / math.sqrt(paths)


def measured_engine(case: sv.Scene, paths: int, duration: float):
    """The same at the usual step of `simulate`, without the second run at twice the step."""
    sv.simulate(case, paths=64, duration=10.0)
    step, start = sv.explain(case).simulation.step, time.process_time()
    response = sv.simulate(case, paths=paths, duration=duration, seed=1)
    cpu = time.process_time() - start
    rate = response.estimates()["stops", "collision_rate"]
    return 1e9 * cpu / response.cost.steps / step, rate.value, rate.standard_error


def measure(methods: dict, size: float) -> pd.DataFrame:
    rows = []
    for name, case in CASES.items():
        ours = measured_engine(scene(*case), math.ceil(8192 * size), 2000.0 * size)
        rows.append(("stochvi", name, None, *ours))
        for peer in ("NumPy Euler", "numba prange Euler"):
            theirs = measured_peer(peers.PEERS[peer][0], peers.USUAL, 2048, 400.0 * size, case)
            rows.append((peer, name, peers.USUAL, *theirs))
    for name, (function, steps, paths, duration) in methods.items():
        for h in steps:
            found = measured_peer(function, h, math.ceil(paths * size), duration * size)
            rows.append((name, "1 sigma, R = 1, by step", h, *found))
    columns = ["method", "case", "step", "cpu_ns_per_second", "rate", "rate_error"]
    table = pd.DataFrame(rows, columns=columns)
    exact = sv.exact(scene(*CASES["1 sigma, R = 1"])).estimates()["stops", "collision_rate"].value
    elastic = table["case"].str.startswith("1 sigma, R = 1")
    return table.assign(
        bias=(table["rate"] / exact - 1.0).where(elastic), bias_error=table["rate_error"] / exact
    )


def draw(table: pd.DataFrame, path: Path) -> None:
    figure, ax = plt.subplots(figsize=(6.8, 4.6), layout="constrained")
    for name, part in table[table["bias"].notna()].groupby("method", sort=False):
        size = np.maximum(np.abs(part["bias"]), part["bias_error"])
        ax.loglog(size, part["cpu_ns_per_second"], "o", label=name)
    ax.set_xlabel("bias of the collision rate (relative), or its standard error if larger")
    ax.set_ylabel("CPU ns per second of scene time")
    ax.grid(which="major", color="#dddddd", linewidth=0.6)
    ax.legend(frameon=False)
    figure.savefig(path, dpi=130)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="shorter runs, larger errors")
    parser.add_argument("--libraries", action="store_true", help="diffrax and torchsde as well")
    parser.add_argument("--out", type=Path, default=Path(__file__).parent)
    options = parser.parse_args()
    chosen = peers.PEERS | (peers.LIBRARIES if options.libraries else {})
    result = measure(chosen, 0.1 if options.quick else 1.0)
    result.to_csv(options.out / "result.csv", index=False)
    gains = controls.table(0.25 if options.quick else 1.0)
    gains.to_csv(options.out / "controls.csv", index=False, float_format="%.2f")
    draw(result, options.out / "figure.png")
    print(result.to_string())
    print(gains.to_string())
