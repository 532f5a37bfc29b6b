"""CPU time against bias of the collision rate: this engine and what is written instead."""

import argparse
import math
import time
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import peers

import stochvi
from stochvi.datasets import shipped_scene

SCENE = stochvi.load_scene(shipped_scene("oscillator-elastic"))
EXACT = stochvi.exact(SCENE).estimates()["stops", "collision_rate"].value
BURN_IN = 60.0  # seconds of scene time
PEERS = {  # function, steps h, paths, seconds of scene time per path, both for a full run
    "NumPy Euler": (peers.numpy_euler, (0.2, 0.1, 0.05, 0.032), 4096, 1200.0),
    "numba prange Euler": (peers.numba_euler, (0.2, 0.1, 0.05, 0.032), 4096, 2400.0),
}
LIBRARIES = {
    "diffrax Euler": (peers.diffrax_euler, (0.2, 0.1, 0.05), 4096, 600.0),
    "torchsde Euler": (peers.torchsde_euler, (0.2, 0.1, 0.05), 16384, 100.0),
}


def measured_peer(function, h: float, paths: int, duration: float) -> tuple[float, float, float]:
    """CPU seconds per second of scene time, rate and its standard error."""
    rates, cpu = function(paths, math.ceil(BURN_IN / h), math.ceil(duration / h), h)
    return cpu / (paths * (BURN_IN + duration)), rates.mean(), rates.std() / math.sqrt(paths)


def measured_engine(rel_error: float) -> tuple[float, float, float]:
    stochvi.simulate(SCENE, paths=512, duration=10.0)
    start = time.process_time()
    response = stochvi.simulate(SCENE, rel_error=rel_error, seed=1)
    cpu = time.process_time() - start
    rate = response.estimates()["stops", "collision_rate"]
    duration = float(rate.how.split(" of ")[1].split()[0])
    burn_in = float(response.assumptions[-2].split("burn-in ")[1].split()[0])
    return cpu / (response.cost.paths * (duration + burn_in)), rate.value, rate.standard_error


def measure(methods: dict, quick: bool) -> pd.DataFrame:
    rows = [("stochvi", np.nan, *measured_engine(0.01 if quick else 0.0005))]
    for name, (function, steps, paths, duration) in methods.items():
        for h in steps[:2] if quick else steps:
            size = (paths // 8, duration / 8.0) if quick else (paths, duration)
            rows.append((name, h, *measured_peer(function, h, *size)))
    columns = ["method", "step", "cpu_per_second_of_scene", "rate", "rate_error"]
    table = pd.DataFrame(rows, columns=columns)
    return table.assign(bias=table["rate"] / EXACT - 1.0, bias_error=table["rate_error"] / EXACT)


def draw(table: pd.DataFrame, path: Path) -> None:
    figure, ax = plt.subplots(figsize=(6.8, 4.6), layout="constrained")
    for name, part in table.groupby("method", sort=False):
        size = np.maximum(np.abs(part["bias"]), part["bias_error"])
        ax.loglog(size, 1e9 * part["cpu_per_second_of_scene"], "o-", label=name)
    ax.set_xlabel("bias of the collision rate (relative), or its standard error if larger")
    ax.set_ylabel("CPU ns per unit of oscillator time")
    ax.grid(which="major", color="#dddddd", linewidth=0.6)
    ax.legend(frameon=False)
    figure.savefig(path, dpi=130)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="shorter runs, larger errors")
    parser.add_argument("--libraries", action="store_true", help="diffrax and torchsde as well")
    parser.add_argument("--out", type=Path, default=Path(__file__).parent)
    options = parser.parse_args()
    result = measure(PEERS | (LIBRARIES if options.libraries else {}), options.quick)
    result.to_csv(options.out / "result.csv", index=False)
    draw(result, options.out / "figure.png")
    print(result.to_string())
