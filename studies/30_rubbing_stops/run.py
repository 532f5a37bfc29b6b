"""An impact absorber whose mass rubs on its stops: what it takes from the motion along them."""

import argparse
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import pandas as pd
from matplotlib import pyplot as plt

import stochvi as sv

# damping, mass ratio, frequencies of the loose mass and of the structure along the stops
ZETA, RATIO, HOLD, ALONG = 0.01, 0.1, 0.05, 1.1
COLOURS = {1.0: "#0072b2", 2.0: "#d55e00", 4.0: "#009e73"}


def scene(clearance: float, friction: float) -> sv.Scene:
    """A structure that moves across (x) and along (y) the stops of a box with a loose mass (u, v),
    omega = 1 and 1.1; white noise gives it a deviation of 1 across without the mass."""
    held = RATIO * HOLD**2
    rubs = {"tangent": {"v": 1.0, "y": -1.0}} if friction else {}
    law = sv.Restitution(coefficient=0.6, friction=friction)
    return sv.Scene(
        structure=sv.Matrices(
            coordinates=["x", "y", "u", "v"],
            mass=[[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, RATIO, 0], [0, 0, 0, RATIO]],
            damping=[
                [2 * ZETA, 0, 0, 0], [0, 2 * ZETA * ALONG + 0.2 * held, 0, -0.2 * held],
                [0, 0, 0, 0], [0, -0.2 * held, 0, 0.2 * held],
            ],
            stiffness=[
                [1, 0, 0, 0], [0, ALONG**2 + held, 0, -held], [0, 0, 0, 0], [0, -held, 0, held],
            ],
        ),
        impact_pairs=[
            sv.ImpactPair(name="stops", between=("u", "x"), clearance=clearance, law=law, **rubs)
        ],
        excitations=[sv.WhiteNoise(intensity=4 * ZETA, on=name) for name in ("x", "y")],
    )  # fmt: skip


def row(clearance: float, friction: float, error: float) -> dict:
    found = sv.simulate(scene(clearance, friction), rel_error=error, seed=1)
    across, along = (found.coordinates[name]["displacement_std"] for name in "xy")
    alone = ALONG**-1.5  # deviation along without the loose mass
    return {
        "clearance": clearance, "friction": friction,
        "across": across.value, "error across": across.standard_error + across.bias,
        "along": along.value / alone, "error along": (along.standard_error + along.bias) / alone,
        "impacts per second": found.impact_pairs["stops"]["collision_rate"].value,
    }  # fmt: skip


def figure_of(table: pd.DataFrame) -> plt.Figure:
    figure, panels = plt.subplots(1, 2, figsize=(8, 3.4), sharey=True, constrained_layout=True)
    for panel, way in zip(panels, ("across", "along"), strict=True):
        for clearance, line in table.groupby("clearance"):
            look = {"color": COLOURS[clearance], "label": f"{clearance:g}", "capsize": 2}
            panel.errorbar(line["friction"], line[way], line[f"error {way}"], fmt="o-", **look)
        panel.axhline(1.0, color="0.6", lw=0.8)
        panel.set(title=f"motion {way} the stops", xlabel="coefficient of friction")
    panels[0].set_ylabel("rms displacement, of that without the mass")
    panels[1].legend(frameon=False, title="clearance")
    return figure


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="fewer, rougher cases")
    parser.add_argument("--out", type=Path, default=Path(__file__).parent)
    options = parser.parse_args()
    clearances = (2.0,) if options.quick else (1.0, 2.0, 4.0)
    frictions = (0.0, 0.2) if options.quick else (0.0, 0.05, 0.1, 0.2, 0.4, 0.8)
    error = 0.1 if options.quick else 0.02
    result = pd.DataFrame([row(c, mu, error) for c in clearances for mu in frictions])
    result.to_csv(options.out / "result.csv", index=False, float_format="%.6g")
    figure_of(result).savefig(options.out / "figure.png", dpi=150)
