"""A restitution that scatters beside three constant ones that might stand for it."""

import argparse
import math
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import pandas as pd
from matplotlib import pyplot as plt

import stochvi as sv

QUANTITIES = {
    "displacement_std": "rms displacement",
    "velocity_std": "rms velocity",
    "impact_speed_rate": "F1",
    "impact_speed_square_rate": "F2",
    "collision_rate": "rate above 5 mm/s",
}
SLOWEST = 0.005  # m/s, of the impacts that are counted
COLOURS = {"mean": "#d55e00", "same energy": "#0072b2", "slow impacts": "#009e73"}


def scene(coefficient: float | dict[str, float]) -> sv.Scene:
    """omega = 1, b = 0.1, stops at +-1, an rms velocity of 1 without them."""
    return sv.Scene(
        structure=sv.Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
        impact_pairs=[
            sv.ImpactPair(lower=-1.0, upper=1.0, law=sv.Restitution(coefficient=coefficient))
        ],
        excitations=[sv.WhiteNoise(intensity=0.2)],
    )


def solved(coefficient: float | dict[str, float]) -> dict[str, float]:
    found = sv.fokker_planck(scene(coefficient), rtol=1e-5, speed_threshold=SLOWEST)
    return {name: each.value for (_, name), each in found.estimates().items()}


def rows(mean: float, share: float) -> list[dict]:
    """Errors of the constant restitutions, for a scatter of a share of the largest std."""
    std = share * math.sqrt(mean * (1.0 - mean))
    law = sv.Restitution(coefficient={"mean": mean, "std": std})
    truth = solved({"mean": mean, "std": std})
    constant = {
        "mean": mean,
        "same energy": math.sqrt(law.restitution_mean_square),
        "slow impacts": law.slow_restitution,
    }
    return [
        {"mean": mean, "std": std, "stands for it": name, "restitution": r, "quantity": words,
         "scattered": truth[quantity], "error": found[quantity] / truth[quantity] - 1.0}
        for name, r in constant.items()
        for found in [solved(r)]
        for quantity, words in QUANTITIES.items()
    ]  # fmt: skip


def figure_of(table: pd.DataFrame, mean: float) -> plt.Figure:
    figure, panels = plt.subplots(1, 4, figsize=(13, 3.4), sharex=True, constrained_layout=True)
    kept = ("rms velocity", "F1", "F2", "rate above 5 mm/s")
    for panel, quantity in zip(panels, kept, strict=True):
        part = table[(table["quantity"] == quantity) & (table["mean"] == mean)]
        for name, line in part.groupby("stands for it"):
            panel.plot(line["std"], 100.0 * line["error"], "o-", color=COLOURS[name], label=name)
        panel.axhline(0.0, color="0.6", lw=0.8)
        panel.set(title=quantity, xlabel="standard deviation of R")
    panels[0].set_ylabel("error of the constant restitution (%)")
    panels[0].legend(frameon=False, title=f"R of mean {mean:g} as its")
    return figure


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="fewer cases")
    parser.add_argument("--out", type=Path, default=Path(__file__).parent)
    options = parser.parse_args()
    means = (0.5,) if options.quick else (0.3, 0.5, 0.7, 0.9)
    shares = (0.2, 0.6) if options.quick else (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8)
    result = pd.DataFrame([row for mean in means for share in shares for row in rows(mean, share)])
    result.to_csv(options.out / "result.csv", index=False, float_format="%.6g")
    figure_of(result, 0.5).savefig(options.out / "figure.png", dpi=150)
