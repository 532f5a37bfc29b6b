"""Babitsky's figures 13.2 and 13.3 (elastic stops) with the moment closure and Monte Carlo."""

import argparse
from functools import partial
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

import stochvi
from stochvi.methods.monte_carlo import record_path
from stochvi.scenes.datasets import shipped_scene

TEXTBOOK = stochvi.load_scene(shipped_scene("oscillator-elastic"))
DEVIATIONS = np.geomspace(0.1, 3.0, 25)  # sigma_x0 / D, the linear response over the clearance
METHODS = (  # name, form, variant, line, colour, width
    ("exact", "", "", "-", "#1b1b1b", 2.6),
    ("motion (book)", "motion", "book", "--", "#e69f00", 1.6),
    ("force (book)", "force", "book", "-.", "#009e73", 1.6),
    ("closure", "closure", "consistent", ":", "#d55e00", 2.6),
)
PANELS = {
    "sigma_x_over_D": r"$\sigma_x / D$",
    "omega_0_over_omega": r"$\omega_0 / \Omega$",
    "f_D_over_sigma_v0": r"$f\,D / (\Omega\,\sigma_{x0})$",
}


def scene(deviation: float) -> stochvi.Scene:
    """Omega = 1, stops at +-1, R = 1, b = 0.1, and the intensity that makes sigma_x0."""
    noise = stochvi.WhiteNoise(intensity=0.2 * deviation**2)
    return TEXTBOOK.model_copy(update={"excitations": (noise,)})


def row(method: str, deviation: float, response: stochvi.Response, upcrossing: float = 0.0) -> dict:
    found = response.estimates()
    spread, rate = found["x", "displacement_std"], found["stops", "collision_rate"]
    return {
        "method": method,
        "sigma_x0_over_D": deviation,
        "sigma_x_over_D": spread.value,
        "sigma_x_error": spread.standard_error,
        "omega_0_over_omega": 2.0 * np.pi * (upcrossing or found["x", "upcrossing_rate"].value),
        "f_D_over_sigma_v0": rate.value / deviation,
        "f_error": rate.standard_error / deviation,
    }


def simulated_upcrossings(case: stochvi.Scene, periods: float) -> float:
    path = record_path(case, duration=2.0 * np.pi * periods, step=0.02)
    below = path["displacement"].to_numpy() < 0.0
    return np.count_nonzero(below[:-1] & ~below[1:]) / path["time"].iloc[-1]


def compute(quick: bool) -> pd.DataFrame:
    rows = []
    for deviation in DEVIATIONS[:: 4 if quick else 1]:
        for name, form, variant, *_ in METHODS:
            solve = (
                partial(stochvi.linearise, form=form, variant=variant) if form else stochvi.exact
            )
            rows.append(row(name, deviation, solve(scene(deviation))))
    for deviation in DEVIATIONS[8 :: 8 if quick else 2]:
        found = stochvi.simulate(scene(deviation), rel_error=0.02 if quick else 0.005, seed=1)
        upcrossings = simulated_upcrossings(scene(deviation), 1e3 if quick else 2e4)
        rows.append(row("Monte Carlo", deviation, found, upcrossings))
    return pd.DataFrame(rows)


parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--quick", action="store_true", help="fewer points, larger errors")
parser.add_argument("--out", type=Path, default=Path(__file__).parent)
options = parser.parse_args()
table = compute(options.quick)
table.to_csv(options.out / "result.csv", index=False)
figure, axes = plt.subplots(1, 3, figsize=(12.6, 4.3), layout="constrained")
for ax, (column, label) in zip(axes, PANELS.items(), strict=True):
    for name, _, _, line, colour, width in (*METHODS, ("Monte Carlo", "", "", "o", "#0072b2", 1)):
        part = table[table["method"] == name]
        ax.plot(part["sigma_x0_over_D"], part[column], line, c=colour, lw=width, ms=5, label=name)
    ax.set(xlabel=r"$\sigma_{x0} / D$", ylabel=label, xlim=(0.0, 3.05), ylim=(0.0, None))
axes[0].legend(frameon=False)
figure.savefig(options.out / "figure.png", dpi=130)
