"""The map of a mount between two stops: regimes that coexist, their basins, life times in noise."""

import argparse
import math
import time
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

import stochvi
from stochvi.methods.periodic import basins, bifurcation
from stochvi.results import NotConverged
from stochvi.scenes.datasets import shipped_scene
from stochvi.statistics import lifetimes
from stochvi.views.files import write_picture
from stochvi.views.sine import plot_basins

MOUNT = stochvi.load_scene(shipped_scene("isolator-sine"))
"""A 10 Hz isolator, zeta 0.1, whose base moves by 0.1 mm at 100 Hz; stops of restitution 0.5."""

KEY, CLEARANCE = "impact_pair.0.clearance", 4e-4
MARGIN = 3e-4
"""Distance from the motion without impacts to a stop at the clearance of 0.4 mm, m."""

FASTEST = 0.6
"""Largest speed of a start, m/s."""

LIVES = {
    "no impacts": (4.0e-4, (0.0025, 0.004, 0.006, 0.01, 0.02)),
    "stops lower, stops upper": (4.2e-4, (0.016, 0.02, 0.026, 0.035, 0.05)),
}
"""Clearance, m, and intensities of the noise of the base, m^2/s^3, for the life of each regime."""

COLOURS = {"no impacts": "#0072b2", "stops lower, stops upper": "#d55e00", "other": "#009e73",
           "undecided": "#d0d0d0"}  # fmt: skip


def mount(clearance: float, intensity: float = 0.0) -> stochvi.Scene:
    """The mount with another clearance, and with noise of the base."""
    pair = stochvi.ImpactPair(clearance=clearance, law=stochvi.Restitution(coefficient=0.5))
    noise = [stochvi.WhiteNoise(intensity=intensity, on="base")] if intensity else []
    return MOUNT.model_copy(
        update={"impact_pairs": (pair,), "excitations": (*MOUNT.excitations, *noise)}
    )


def starts(clearance: float, number: int) -> dict[str, np.ndarray]:
    """A plane of starts between the stops."""
    return {
        "displacement.x": np.linspace(-clearance, clearance, number),
        "velocity.x": np.linspace(-FASTEST, FASTEST, number),
    }


def shares(clearance: float, number: int) -> dict[str, float]:
    """Shares of starts by regime; motions that rest on a stop now and then count together."""
    found = basins(mount(clearance), starts(clearance, number))
    row = dict.fromkeys(COLOURS, 0.0) | {"undecided": found.undecided}
    for regime in found.regimes:
        row[regime.name if regime.name in COLOURS else "other"] += regime.share
    return {"clearance_mm": 1e3 * clearance, **row}


def life(regime: str, clearance: float, intensity: float, rel_error: float) -> dict[str, float]:
    """Mean life time of a regime in noise."""
    scene = mount(clearance, intensity)
    try:
        found = lifetimes(scene, [regime], rel_error=rel_error, budget=120.0)
    except NotConverged as short:
        found = short.partial
    (each,) = found.regimes
    return {
        "regime": regime, "clearance_mm": 1e3 * clearance, "intensity": intensity,
        "life_time": each.life_time or math.nan, "low": each.life_time_low,
        "high": each.life_time_high or math.inf, "left": each.left,
        "to": each.destinations[0].regime if each.destinations else "",
        "share": each.destinations[0].share if each.destinations else math.nan,
        "warnings": len(found.warnings),
    }  # fmt: skip


parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--quick", action="store_true", help="few starts and paths")
parser.add_argument("--out", type=Path, default=Path(__file__).parent)
options = parser.parse_args()
started = time.process_time()
side, coarse, gaps, rel_error = (80, 20, 6, 0.4) if options.quick else (320, 40, 33, 0.1)

clearances = np.linspace(2e-4, 6e-4, 25 if options.quick else 201)
exact = stochvi.harmonic_response(mount(CLEARANCE), vary={KEY: clearances})
swept = bifurcation(
    mount(CLEARANCE), vary={KEY: clearances}, sweep="up", start={"velocity.x": -0.3}
)
begun = time.process_time()
mapped = basins(mount(CLEARANCE), starts(CLEARANCE, side))
print(
    f"{side**2} starts: {time.process_time() - begun:.1f} s of CPU, {mapped.cost.wall_time:.1f} s"
)
taken = pd.DataFrame([shares(each, coarse) for each in np.linspace(2e-4, 6e-4, gaps)])
lives = pd.DataFrame(
    [
        life(regime, gap, each, rel_error)
        for regime, (gap, intensities) in LIVES.items()
        for each in (intensities[2:] if options.quick else intensities)
    ]
)
pd.concat([taken, lives]).to_csv(options.out / "result.csv", index=False, float_format="%.6g")
print(mapped.table().to_string(), taken.round(3).to_string(), lives.to_string(), sep="\n")
print("folds at", [1e3 * each.value for each in exact.special_points if each.name == "fold"], "mm")

figure, panels = plt.subplots(2, 2, figsize=(10.5, 9.0), layout="constrained")
(speeds, plane), (areas, decay) = panels
(sweep,) = swept.sweeps
values = np.repeat(1e3 * sweep.value, [len(each) for each in sweep.impact_speed])
dots = {"color": "#8a8f98", "markersize": 2.0, "label": "a slow sweep up"}
speeds.plot(values, np.concatenate(sweep.impact_speed), ".", **dots)
seen = set[int]()
for branch in exact.branches:
    if not branch.stops:
        continue
    top = branch.impact_speed.max(axis=1)
    for stable, style in ((True, "-"), (False, "--")):
        shown = np.where(branch.admissible & (branch.stable == stable), top, np.nan)
        label = f"repeats in {branch.periods} period{'s' if branch.periods > 1 else ''}"
        label = None if branch.periods in seen else label
        seen.add(branch.periods)
        colour = f"C{branch.periods % 10}"
        speeds.plot(1e3 * branch.value, shown, style, color=colour, linewidth=1.4, label=label)
speeds.legend(fontsize="small")
speeds.set_ylim(bottom=0.0)
speeds.set_ylabel("impact speed (m/s)")
speeds.set_title("exact regimes: stable full, unstable dashed", fontsize="medium")
plot_basins(mapped, plane)
names = {"no impacts": "no impacts", "stops lower, stops upper": "clatter on both stops",
         "other": "motions that rest on a stop", "undecided": "undecided"}  # fmt: skip
low, width = np.zeros(len(taken)), 0.9 * np.diff(taken["clearance_mm"])[0]
for name, label in names.items():
    areas.bar(taken["clearance_mm"], taken[name], width, low, color=COLOURS[name], label=label)
    low = low + taken[name].to_numpy()
areas.set_ylim(0.0, 1.0)
areas.set_ylabel("share of starts")
areas.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2, fontsize="small")
for panel in (speeds, areas):
    panel.set_xlabel("clearance per side (mm)")
    panel.set_xlim(0.19, 0.61)
for regime, own in lives.groupby("regime"):
    inverse = 1.0 / own["intensity"]
    slope, level = np.polyfit(inverse, np.log(own["life_time"]), 1, w=np.sqrt(own["left"]))
    error = math.sqrt(1.0 / np.sum(own["left"] * (inverse - inverse.mean()) ** 2))
    print(f"{regime}: ln T grows by {slope:.3g} +- {error:.1g} m^2/s^3 over the intensity")
    bars = [own["life_time"] - own["low"], own["high"] - own["life_time"]]
    decay.errorbar(
        inverse, own["life_time"], yerr=bars, fmt="o", capsize=3, color=COLOURS[regime],
        label=f"{names[regime]}, {own['clearance_mm'].iloc[0]:g} mm",
    )  # fmt: skip
    decay.plot(inverse, np.exp(level + slope * inverse), color=COLOURS[regime], linewidth=1.0)
natural, rate = 20.0 * math.pi, 4.0 * math.pi
print(f"reaching a stop: {rate * (natural * MARGIN) ** 2:.3g} m^2/s^3")
decay.set_yscale("log")
decay.set_xlabel("1 / intensity of the noise (s³/m²)")
decay.set_ylabel("mean life time (s)")
decay.legend(fontsize="small")
for panel in (speeds, decay):
    panel.grid(color="#dddddd", linewidth=0.6)
write_picture(speeds, options.out / "figure.png")
print(f"{time.process_time() - started:.0f} s of CPU")
