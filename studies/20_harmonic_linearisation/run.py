"""Resonance curves between stops: exact branches, simulated sweeps, and harmonic linearisation."""

import argparse
import math
import time
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

import stochvi as sv
from stochvi.methods.periodic import HarmonicResponse
from stochvi.views.sine import plot_branches

HERE = Path(__file__).parent
STOPS = {
    "two stops": {"clearance": 1.0},
    "one stop, gap": {"upper": 1.0},
    "one stop, no gap": {"upper": 0.0},
    "one stop, preload": {"upper": -0.5},
}
RESTITUTIONS = (0.3, 0.5, 0.7, 0.9)
SHOWN = 0.7
RANGE = {"two stops": (0.6, 3.0), "one stop, gap": (0.6, 3.0),
         "one stop, no gap": (1.2, 4.0), "one stop, preload": (1.6, 5.0)}  # fmt: skip
FREE = 0.02  # smallest share of the fastest speed that counts as an impact


def scene(case: str, restitution: float, damping: float) -> sv.Scene:
    """Mass 1, spring 1, a force of amplitude 0.6."""
    law = sv.Restitution(coefficient=restitution)
    return sv.Scene(
        structure=sv.Oscillator(mass=1.0, damping=damping, stiffness=1.0),
        impact_pairs=[sv.ImpactPair(law=law, **STOPS[case])],
        excitations=[sv.Sine(amplitude=0.6, frequency_hz=0.2)],
    )


def frequencies(case: str, points: int) -> np.ndarray:
    return np.linspace(*RANGE[case], points) / (2.0 * math.pi)


def swept(found: HarmonicResponse) -> tuple[int, int, float]:
    """Simulated points that repeat themselves, those on a stable exact branch, and the largest
    relative difference of impact speeds there."""
    seen, on, away = 0, 0, 0.0
    for sweep in found.simulated:
        rows = zip(sweep.value, sweep.impact_speed_max, sweep.periods, strict=True)
        for value, speed, periods in rows:
            known = [
                branch.impact_speed[i].max(initial=0.0)
                for branch in found.branches
                for i in branch.at(float(value))
                if branch.stable[i]
            ]
            if not periods:
                continue
            seen += 1
            off = min((abs(speed - each) / max(each, FREE) for each in known), default=math.inf)
            if off < 1e-3:
                on, away = on + 1, max(away, off)
    return seen, on, away


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="a third of the frequencies")
    parser.add_argument("--out", type=Path, default=HERE, help="folder of the figure and the table")
    options = parser.parse_args()
    points = 40 if options.quick else 121
    began = time.process_time()
    rows = []
    for case in STOPS:
        for restitution in RESTITUTIONS:
            for damping in (0.02, 0.2):
                given, at = scene(case, restitution, damping), frequencies(case, points)
                row = {"case": case, "restitution": restitution, "damping": damping}
                for form in ("motion", "force"):
                    error = sv.harmonic_response(given, at, form=form, most_impacts=2).model_error
                    row |= {f"{form}_{name}": value for name, value in error.items()}
                rows.append(row)
                print(row, f"{time.process_time() - began:.0f} s", flush=True)
    figure, axes = plt.subplots(3, 2, figsize=(11.0, 11.0), layout="constrained")
    for ax, case in zip(axes.flat, STOPS, strict=False):
        given, at = scene(case, SHOWN, 0.2), frequencies(case, points)
        exact = sv.harmonic_response(given, at, sweep="both")
        seen, on, away = swept(exact)
        rows.append({"case": case, "restitution": SHOWN, "damping": 0.2, "simulated": seen,
                     "on_a_branch": on, "farthest": away})  # fmt: skip
        print(rows[-1], flush=True)
        plot_branches(exact, ax, "impact_speed_max")
        for form, colour in (("motion", "#e69f00"), ("force", "#009e73")):
            for branch in sv.harmonic_response(given, at, form=form, most_impacts=2).branches:
                if branch.stops:
                    label = f"by {form}" if branch.stable[0] else None
                    speed = branch.impact_speed[:, 0]
                    ax.plot(branch.value, speed, ":", color=colour, linewidth=2.0, label=label)
        ax.legend(fontsize="small")
        ax.set_title(f"{case}, R = {SHOWN}")
    table = pd.DataFrame(rows)
    for ax, form in zip(axes[2], ("motion", "force"), strict=True):
        errors = table.dropna(subset=[f"{form}_median"])
        for (case, damping), part in errors.groupby(["case", "damping"], sort=False):
            style = "-" if damping < 0.1 else "--"
            colour = f"C{list(STOPS).index(case)}"
            ax.plot(part["restitution"], 100.0 * part[f"{form}_median"], f"o{style}", color=colour,
                    label=f"{case}, b = {damping:g}")  # fmt: skip
        ax.set_xlabel("restitution")
        ax.set_ylabel("median error of impact speeds (%)")
        ax.set_ylim(bottom=0.0)
        ax.set_title(f"linearisation by {form}")
    lines = axes[2, 1].get_legend_handles_labels()
    figure.legend(*lines, loc="outside lower center", ncols=4, fontsize="small")
    figure.savefig(options.out / "figure.png", dpi=110)
    table.to_csv(options.out / "result.csv", index=False, float_format="%.5g")
    print(f"{time.process_time() - began:.0f} s of CPU")


if __name__ == "__main__":
    main()
