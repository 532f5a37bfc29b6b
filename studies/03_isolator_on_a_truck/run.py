"""Impacts per second of isolators against clearance: resonance inside and outside the table."""

import argparse
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes

import stochvi
from stochvi.isolators.screening import predicted_rates
from stochvi.views.files import write_picture
from stochvi.views.sizing import plot_clearance_curve

TRUCK, SCREEN = "mil-std-810h-truck-vertical-5hz", "navmat-p-9492"
CASES = [  # profile, natural frequency (Hz), restitution, clearances in sigma
    (TRUCK, 12.0, 0.2, np.arange(1.0, 4.01, 0.5)),
    (TRUCK, 12.0, 0.5, np.arange(1.0, 4.01, 0.5)),
    (TRUCK, 12.0, 0.8, np.arange(1.0, 4.01, 0.5)),
    (SCREEN, 8.0, 0.5, np.array([1.0, 2.0, 3.0, 4.0])),
]


def scene(profile: str, frequency_hz: float, restitution: float) -> stochvi.Scene:
    law = stochvi.Restitution(coefficient=restitution)
    return stochvi.Scene(
        structure=stochvi.Isolator(frequency_hz=frequency_hz, zeta=0.1),
        impact_pairs=[stochvi.ImpactPair(lower=-4e-3, upper=4e-3, law=law)],
        excitations=[stochvi.TabulatedNoise(profile=profile)],
    )


def draw(curves: dict[str, pd.DataFrame]) -> Axes:
    """Rates over clearance at R = 0.5: the resonance inside the table, and below it."""
    _, axes = plt.subplots(1, 2, figsize=(9.6, 4.6), layout="constrained")
    for ax, (title, curve) in zip(axes, curves.items(), strict=True):
        row = curve.iloc[0]
        case = scene(row["profile"], row["frequency_hz"], row["restitution"])
        ends = curve["clearance"].iloc[[0, -1]]
        plot_clearance_curve(curve, predicted_rates(case, list(np.linspace(*ends, 61))), ax)
        ax.set_title(title, fontsize="medium")
        ax.legend(frameon=False)
    return axes[0]


parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--quick", action="store_true", help="fewer clearances, larger errors")
parser.add_argument("--out", type=Path, default=Path(__file__).parent)
options = parser.parse_args()
tables = []
for profile, frequency_hz, restitution, multiples in CASES:
    case = scene(profile, frequency_hz, restitution)
    sigma = stochvi.screen(case).displacement_std
    curve = stochvi.isolators.clearance_curve(
        case,
        list(sigma * (multiples[:3:2] if options.quick else multiples)),
        rel_error=0.05 if options.quick else 0.01,
        budget=600.0,
        seed=1,
    )
    tables.append(curve.assign(profile=profile, frequency_hz=frequency_hz, restitution=restitution))
picture = draw({
    "12 Hz on the truck, inside its table": tables[1],
    "8 Hz on NAVMAT, below its table": tables[3],
})  # fmt: skip
write_picture(picture, options.out / "figure.png")
pd.concat(tables).to_csv(options.out / "result.csv", index=False)
