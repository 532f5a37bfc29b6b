"""A chain of masses, each between stops of its own: what coupling and number do to impacts."""

import argparse
import math
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

import stochvi as sv

DAMPING, INTENSITY = 0.1, 0.2  # N s/m and N^2 s of each mass of 1 kg on 1 N/m, so that theta = 1 J
COLOURS = {1.0: "#0072b2", 0.8: "#d55e00"}
LABELS = {"rate": "impacts of a mass (1/s)", "rms": "rms of a mass (m)"}


def chain(count: int, coupling: float, restitution: float) -> sv.Scene:
    """Masses in a row, each on its own spring, shaken alone, between stops at -1 and 1 m."""
    names = [f"mass {k + 1}" for k in range(count)]
    links = np.diff(np.eye(count), axis=0)
    structure = sv.Matrices(
        coordinates=names, mass=np.eye(count), damping=DAMPING * np.eye(count),
        stiffness=np.eye(count) + coupling * links.T @ links,
    )  # fmt: skip
    law = sv.Restitution(coefficient=restitution)
    return sv.Scene(
        structure=structure,
        impact_pairs=[sv.ImpactPair(name=each, on=each, clearance=1.0, law=law) for each in names],
        excitations=[sv.WhiteNoise(on=each, intensity=INTENSITY) for each in names],
    )


def numbers(scene: sv.Scene, rel_error: float | None) -> dict[str, float]:
    """Impacts and motion of the first mass and of one in the middle: exact where no error is given,
    else simulated."""
    found = (
        sv.exact(scene)
        if rel_error is None
        else sv.simulate(scene, rel_error=rel_error, seed=1, budget=3600.0)
    )
    names, row = list(found.impact_pairs), {}
    for place, name in (("end", names[0]), ("middle", names[len(names) // 2])):
        values = {"rate": found.impact_pairs[name].collision_rate,
                  "F1": found.impact_pairs[name].impact_speed_rate,
                  "rms": found.coordinates[name].displacement_std}  # fmt: skip
        for what, each in values.items():
            error = math.hypot(each.standard_error, each.bias or 0.0)
            row |= {f"{what} {place}": each.value, f"{what} {place} error": error}
    return row


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="larger errors, fewer masses")
    parser.add_argument("--out", type=Path, default=Path(__file__).parent, help="folder of results")
    quick, out = vars(parser.parse_args()).values()
    couplings = (0.0, 1.0) if quick else (0.0, 0.1, 0.3, 1.0, 3.0, 10.0)
    counts, error, size = ((1, 2), 0.1, 3) if quick else ((1, 2, 4, 8), 0.02, 8)
    cases = [(size, each) for each in couplings] + [(each, 1.0) for each in counts if each != size]
    rows = []
    for count, coupling in cases:
        for restitution in COLOURS:
            scene = chain(count, coupling, restitution)
            asked = {"simulate": error} | (
                {"exact": None} if restitution == 1.0 and count < 3 else {}
            )
            for by, accuracy in asked.items():
                row = {"by": by, "masses": count, "coupling": coupling, "restitution": restitution}
                rows.append(row | numbers(scene, accuracy))
    table = pd.DataFrame(rows)
    table.to_csv(out / "result.csv", index=False, float_format="%.5g")
    print(table.to_string())
    draw(table, size).savefig(out / "figure.png", dpi=110)


def draw(table: pd.DataFrame, size: int) -> plt.Figure:
    figure, axes = plt.subplots(1, 3, figsize=(12.5, 4.0), layout="constrained")
    whole = table[table["by"] == "simulate"]
    for restitution, colour in COLOURS.items():
        chains = whole[whole["restitution"] == restitution]
        for place, style in (("end", "o--"), ("middle", "o-")):
            part = chains[chains["masses"] == size].sort_values("coupling")
            for ax, what in zip(axes, LABELS, strict=False):
                bars = 1.96 * part[f"{what} {place} error"]
                ax.errorbar(part["coupling"], part[f"{what} {place}"], bars, fmt=style,
                            color=colour, label=f"R = {restitution:g}, {place}")  # fmt: skip
            part = chains[chains["coupling"] == 1.0].sort_values("masses")
            bars = 1.96 * part[f"rate {place} error"]
            axes[2].errorbar(part["masses"], part[f"rate {place}"], bars, fmt=style, color=colour)
    for ax, label in zip(axes, LABELS.values(), strict=False):
        ax.set(xlabel="stiffness of a link / that under a mass", ylabel=label, ylim=(0.0, None))
        ax.set_xscale("symlog", linthresh=0.1)
        ax.set_xlim(-0.02, 12.0)
        ax.set_xticks([0.0, 0.1, 1.0, 10.0], ["0", "0.1", "1", "10"])
        ax.set_title(f"{size} masses", fontsize="medium")
    axes[0].legend(fontsize="small")
    known = table[table["by"] == "exact"]
    axes[2].plot(known["masses"], known["rate middle"], "kx", markersize=9, label="exact, R = 1")
    axes[2].set(xscale="log", xlabel="masses", ylabel=LABELS["rate"], ylim=(0.0, None))
    axes[2].set_xticks(
        sorted(set(whole["masses"])), [str(each) for each in sorted(set(whole["masses"]))]
    )
    axes[2].minorticks_off()
    axes[2].set_title("links as stiff as the springs under the masses", fontsize="medium")
    axes[2].legend(fontsize="small")
    return figure


if __name__ == "__main__":
    main()
