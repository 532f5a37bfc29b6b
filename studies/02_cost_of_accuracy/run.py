"""CPU time against bias of the impact rate: this engine and the usual code."""

import argparse
import math
import time
from pathlib import Path

import controls
import errors
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import peers
from cases import CASES, scene
from systems import system_of

import stochvi as sv

FOLDER = Path(__file__).parent

BURN_IN = 60.0  # seconds of scene time


STEPS = {  # steps h, paths, seconds of scene time per path, for a full run
    "NumPy Euler": ((0.2, 0.1, 0.05, peers.USUAL), 4096, 1200.0),
    "numba prange Euler": ((0.2, 0.1, 0.05, peers.USUAL), 4096, 2400.0),
    "scipy solve_ivp": ((1.0,), 16, 160.0),
    "diffrax Euler": ((0.2, 0.1, 0.05), 4096, 600.0),
    "torchsde Euler": ((0.2, 0.1, 0.05), 16384, 100.0),
}


def measured_peer(function, h: float, paths: int, duration: float, case: sv.Scene):
    """CPU ns per second of scene time, mean rate and its standard error."""
    system = system_of(case, "stops")
    averages, cpu = function(system, paths, math.ceil(BURN_IN / h), math.ceil(duration / h), h)
    rate, error = errors.answer_of_averages(averages)["collision_rate"]
    return 1e9 * cpu / (paths * (BURN_IN + duration)), rate, error


def measured_engine(case: sv.Scene, paths: int, duration: float):
    """The same at the usual step of `simulate`, without the second run at twice the step."""
    sv.simulate(case, paths=64, duration=10.0)
    step, start = sv.explain(case).simulation.step, time.process_time()
    response = sv.simulate(case, paths=paths, duration=duration, seed=1)
    cpu = time.process_time() - start
    rate = response.estimates()["stops", "collision_rate"]
    return 1e9 * cpu / response.cost.steps / step, rate.value, rate.standard_error


def measure(methods: dict, size: float) -> pd.DataFrame:
    """Costs and rates of one oscillator: of every case, and by the step between elastic stops."""
    rows = []
    for name, numbers in CASES.items():
        case = scene(*numbers)
        ours = measured_engine(case, math.ceil(8192 * size), 2000.0 * size)
        rows.append((errors.ENGINE, name, None, *ours))
        for peer, function in peers.PEERS.items():
            theirs = measured_peer(function, peers.USUAL, 2048, 400.0 * size, case)
            rows.append((peer, name, peers.USUAL, *theirs))
    elastic = scene(*CASES["1 sigma, R = 1"])
    for name, function in methods.items():
        steps, paths, duration = STEPS[name]
        for h in steps:
            found = measured_peer(function, h, math.ceil(paths * size), duration * size, elastic)
            rows.append((name, "1 sigma, R = 1, by step", h, *found))
    columns = ["method", "case", "step", "cpu_ns_per_second", "rate", "rate_error"]
    table = pd.DataFrame(rows, columns=columns)
    exact = sv.exact(elastic).estimates()["stops", "collision_rate"].value
    chosen = table["case"].str.startswith("1 sigma, R = 1")
    return table.assign(
        bias=(table["rate"] / exact - 1.0).where(chosen), bias_error=table["rate_error"] / exact
    )


def draw(table: pd.DataFrame, path: Path) -> None:
    figure, ax = plt.subplots(figsize=(6.8, 4.6), layout="constrained")
    for name, part in table[table["bias"].notna()].groupby("method", sort=False):
        size = np.maximum(np.abs(part["bias"]), part["bias_error"])
        ax.loglog(size, part["cpu_ns_per_second"], "o", label=name)
    ax.set_xlabel("bias of the impact rate (relative), or its standard error if larger")
    ax.set_ylabel("CPU ns per second of scene time")
    ax.grid(which="major", color="#dddddd", linewidth=0.6)
    ax.legend(frameon=False)
    figure.savefig(path, dpi=130)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="shorter runs, larger errors")
    parser.add_argument("--libraries", action="store_true", help="diffrax and torchsde as well")
    parser.add_argument("--out", type=Path, default=FOLDER)
    options = parser.parse_args()
    libraries = peers.LIBRARIES if options.libraries else {}
    one_oscillator = peers.PEERS | {"scipy solve_ivp": peers.scipy_events} | libraries
    result = measure(one_oscillator, 0.1 if options.quick else 1.0)
    result.to_csv(options.out / "result.csv", index=False)
    gains = controls.table(0.25 if options.quick else 1.0)
    gains.to_csv(options.out / "controls.csv", index=False, float_format="%.2f")
    draw(result, options.out / "figure.png")
    found = errors.measure(peers.PEERS, libraries, 0.01 if options.quick else 1.0)
    found.to_csv(options.out / "errors.csv", index=False, float_format="%.6g")
    errors.draw(found, options.out / "errors.png")
    if options.libraries and not options.quick and options.out == FOLDER:
        errors.write_into(FOLDER / "README.md", found)
    print(result.to_string(), gains.to_string(), sep="\n")
    print(errors.as_page(found), errors.as_checks(found), sep="\n\n")
