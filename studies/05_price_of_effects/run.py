"""What each effect costs: CPU time of a step and of a second of scene time, one thread."""

import argparse
import time
from pathlib import Path

import by_hand
import matplotlib.pyplot as plt
import pandas as pd

import stochvi as sv
from scenes import SCENES, STEP


def engine(case: sv.Scene, steps: float) -> tuple[float, float, int]:
    """(ns per step, ns per second of scene, states): best of three runs of so many steps."""
    told, best = sv.explain(case, threads=1).simulation, float("inf")
    length = {"paths": 1024, "duration": told.step * steps / 1024}
    for _ in range(3):
        start = time.process_time()
        steps = sv.simulate(case, seed=1, threads=1, **length).cost.steps
        best = min(best, (time.process_time() - start) / steps)
    return 1e9 * best, 1e9 * best / told.step, told.states


def hand(function, steps: int, *arguments) -> float:
    """ns per step of a kernel of `by_hand`: best of five runs of 1024 paths."""
    function(by_hand.streams_of(256), 2, *arguments)
    best = float("inf")
    for _ in range(5):
        start = time.process_time()
        function(by_hand.streams_of(1024), steps, *arguments)
        best = min(best, (time.process_time() - start) / (1024 * steps))
    return 1e9 * best


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="shorter runs")
    parser.add_argument("--out", type=Path, default=Path(__file__).parent)
    options = parser.parse_args()
    size = 1 if options.quick else 8
    rows = [
        ("normals alone", 0, hand(by_hand.normals_alone, 2000 * size), None),
        ("by hand: white noise", 2, hand(by_hand.free, 2000 * size, STEP, 0.1, 0.2), None),
        ("by hand: one stop", 2, hand(by_hand.one_stop, 2000 * size, STEP, 0.1, 0.2, 1.0), None),
    ]
    for name, case in SCENES.items():
        step, second, states = engine(case, 1e7 * size)
        rows.append((name, states, step, second))
    columns = ["case", "states", "ns_per_step", "ns_per_second_of_scene"]
    table = pd.DataFrame(rows, columns=columns).assign(
        normals=lambda t: t["ns_per_step"] / t["ns_per_step"][0]
    )
    table.to_csv(options.out / "result.csv", index=False)
    figure, ax = plt.subplots(figsize=(7.2, 4.8), layout="constrained")
    ax.barh(table["case"], table["ns_per_step"], color=["#999999"] * 3 + ["#2a6f97"] * len(SCENES))
    ax.bar_label(ax.containers[0], fmt="%.1f", padding=3)
    ax.set(xlabel="CPU time of a step (ns)", xscale="log", xlim=(0.9, 150.0))
    ax.invert_yaxis()
    figure.savefig(options.out / "figure.png", dpi=130)
    print(table.to_string())
