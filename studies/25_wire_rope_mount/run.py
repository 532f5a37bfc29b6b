"""Motion of a box on wire rope: simulated, and as linear mounts give it."""

import argparse
import math
from pathlib import Path

import matplotlib.pyplot as plt
import pandas as pd

from stochvi import ImpactPair, Isolator, Restitution, Scene, WhiteNoise, linearise, simulate
from stochvi.scenes import BoucWen
from stochvi.views.files import write_picture

MOUNT = {"mass": 10.0, "stiffness": 2e4, "damping": 20.0}  # kg, N/m and N s/m beside the rope
ROPE = BoucWen(stiffness=6e4, yield_displacement=5e-4)
LEVELS = (1e-4, 3e-4, 1e-3, 3e-3, 1e-2, 3e-2, 1e-1)  # one-sided, g^2/Hz, of white base noise
TESTED = 1e-2  # level at which the linear mount of a test was identified
FAR = 3.5  # distance of the stops of the last columns, in simulated standard deviations
TITLES = {"displacement_std": "displacement (rms)", "acceleration_std": "acceleration (rms)"}
LABELS = {
    "wen": ("linearised at each level", "#0072b2"),
    "tested": ("tested at 0.01 g²/Hz", "#d55e00"),
    "small": ("small motions", "#009e73"),
}


def scene_of(level: float, mount: Isolator, stop: float | None = None) -> Scene:
    """The box at a level, perhaps between stops."""
    pairs = [ImpactPair(clearance=stop, law=Restitution(coefficient=0.5))] if stop else []
    white = [WhiteNoise(density=level, unit="g2/Hz")]
    return Scene(structure=mount, impact_pairs=pairs, excitations=white)


def mounts() -> dict[str, Isolator]:
    """The rope; the linear mount of its deviations at the tested level; that of small motions."""
    rope, mass = Isolator(**MOUNT, spring=ROPE), MOUNT["mass"]
    found = linearise(scene_of(TESTED, rope)).coordinates["x"]
    x, v = found["displacement_std"].value, found["velocity_std"].value
    damping = mass * TESTED * 9.80665**2 / (4.0 * v**2)
    tested = Isolator(mass=mass, stiffness=mass * (v / x) ** 2, damping=damping)
    small = Isolator(**MOUNT | {"stiffness": MOUNT["stiffness"] + ROPE.stiffness})
    return {"wen": rope, "tested": tested, "small": small}


def measure(quick: bool) -> pd.DataFrame:
    """A row for each level: deviations by each mount, and impacts per second on far stops."""
    known, rows = mounts(), []
    much = {"paths": 64 if quick else 2048, "duration": 5.0 if quick else 20.0}
    for level in LEVELS[::3] if quick else LEVELS:
        true = simulate(scene_of(level, known["wen"]), **much).coordinates["x"]
        row = {"level_g2_hz": level}
        for name in TITLES:
            row |= {f"{name} simulated": true[name].value, f"{name} bias": true[name].bias}
            for words, mount in known.items():
                linear = linearise(scene_of(level, mount)).coordinates["x"][name]
                row[f"{name} {words}"] = linear.value
        x, v = true["displacement_std"].value, true["velocity_std"].value
        far = simulate(scene_of(level, known["wen"], FAR * x), **much).impact_pairs["stops"]
        row["far_rate"] = far["collision_rate"].value
        row["far_rate_gaussian"] = v / x / math.pi * math.exp(-(FAR**2) / 2.0)
        rows.append(row)
    return pd.DataFrame(rows)


def draw(table: pd.DataFrame, path: Path) -> None:
    """Deviations of the linear mounts over the simulated ones, by level."""
    _, axes = plt.subplots(1, 2, figsize=(9.0, 3.6), layout="constrained", sharey=True)
    for ax, (name, title) in zip(axes, TITLES.items(), strict=True):
        for words, (label, colour) in LABELS.items():
            ratio = table[f"{name} {words}"] / table[f"{name} simulated"]
            ax.plot(table["level_g2_hz"], ratio, "o-", color=colour, label=label)
        ax.axhline(1.0, color="0.6", linewidth=0.8)
        ax.set(xscale="log", yscale="log", xlabel="base acceleration (g²/Hz)", title=title)
        ax.set_yticks([0.5, 1.0, 2.0, 4.0], ["0.5", "1", "2", "4"], minor=False)
        ax.minorticks_off()
    axes[0].set_ylabel("linear over simulated")
    axes[0].legend(fontsize=8)
    write_picture(axes[0], path)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="three levels, few paths")
    parser.add_argument("--out", type=Path, default=Path(__file__).parent)
    options = parser.parse_args()
    result = measure(options.quick)
    result.to_csv(options.out / "result.csv", index=False, float_format="%.5g")
    draw(result, options.out / "figure.png")
