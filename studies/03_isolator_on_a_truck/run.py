"""Hits per second of a 12 Hz isolator on a truck against clearance, for three restitutions."""

import argparse
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

import stochvi
from stochvi.plots import plot_clearance_curve, plot_clearance_ratio

RESTITUTIONS = (0.2, 0.5, 0.8)


def scene(restitution: float) -> stochvi.Scene:
    law = stochvi.Restitution(coefficient=restitution)
    return stochvi.Scene(
        structure=stochvi.Isolator(frequency_hz=12.0, zeta=0.1),
        impact_pairs=[stochvi.ImpactPair(lower=-4e-3, upper=4e-3, law=law)],
        excitations=[stochvi.TabulatedNoise(profile="mil-std-810h-truck-vertical-5hz")],
    )


parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--quick", action="store_true", help="fewer clearances, larger errors")
parser.add_argument("--out", type=Path, default=Path(__file__).parent)
options = parser.parse_args()
sigma = stochvi.screen(scene(0.5)).displacement_std
clearances = sigma * (np.array([1.0, 2.0]) if options.quick else np.arange(1.0, 4.01, 0.5))
curves = {
    restitution: stochvi.clearance_curve(
        scene(restitution),
        list(clearances),
        rel_error=0.05 if options.quick else 0.01,
        budget=600.0,
        seed=1,
    )
    for restitution in RESTITUTIONS
}
table = pd.concat([curve.assign(restitution=r) for r, curve in curves.items()])
table.to_csv(options.out / "result.csv", index=False)
figure, (above, below) = plt.subplots(
    2, 1, figsize=(6.8, 6.6), height_ratios=(2.0, 1.0), layout="constrained", sharex=True
)
plot_clearance_curve(curves[0.5], above).set_xlabel("")
plot_clearance_ratio(curves[0.5], below)
figure.suptitle("12 Hz isolator on a truck, stops with R = 0.5")
figure.savefig(options.out / "figure.png", dpi=130)
