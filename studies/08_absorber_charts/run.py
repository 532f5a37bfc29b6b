"""What loose masses in boxes do to a lightly damped structure under random excitation."""

import argparse
from pathlib import Path

import cases
import matplotlib.pyplot as plt
import pandas as pd

CHARTS = Path(__file__).parents[2] / "data" / "absorber_charts" / "charts.csv"
PANELS = (
    ("mass_ratio", {}, "mass ratio {:g}", "R = 0.5, one unit"),
    ("restitution", {"mass_ratio": 0.1}, "R = {:g}", "mass ratio 0.1"),
    ("zeta", {"mass_ratio": 0.1}, "zeta = {:g}", "mass ratio 0.1, R = 0.5"),
    ("units", {"mass_ratio": 0.1}, "{:g} units", "mass ratio 0.1, R = 0.5"),
    ("noise", {"mass_ratio": 0.1}, "{} noise", "mass ratio 0.1, R = 0.5"),
)


def draw(ax: plt.Axes, charts: pd.DataFrame, along: str, other: dict, label: str) -> None:
    """rms ratio against play, one line for each value of one parameter."""
    fixed = {name: value for name, value in (cases.BASIC | other).items() if name != along}
    for name, value in fixed.items():
        charts = charts[charts[name] == value]
    groups = list(charts.groupby(along))
    for number, (value, rows) in enumerate(groups):
        colour = plt.get_cmap("viridis")(0.85 * number / max(len(groups) - 1, 1))
        errors = 2.0 * rows["standard_error"] + rows["bias"]
        ax.errorbar(
            rows["play_in_sigma"], rows["rms_ratio"], yerr=errors, marker="o", markersize=3,
            linewidth=1.2, color=colour, label=label.format(value),
        )  # fmt: skip


def draw_dampers(ax: plt.Axes, rows: pd.DataFrame) -> None:
    """Impact absorber and tuned mass damper over the detuning, by mass ratio."""
    for number, (mass, own) in enumerate(rows.groupby("mass_ratio")):
        colour = plt.get_cmap("viridis")(0.42 * number)
        off = 100.0 * own["structure_frequency_off"]
        ax.plot(off, own["tuned_mass_damper"], "s--", color=colour, label=f"damper, {mass:g}")
        ax.errorbar(
            off, own["impact_absorber"], yerr=2.0 * own["standard_error"], fmt="o-", color=colour,
            label=f"impacts, {mass:g}",
        )  # fmt: skip
    ax.set(xlabel="frequency of the structure off by (%)", title="against a tuned mass damper")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="a few cases, larger errors")
    parser.add_argument("--out", type=Path, default=Path(__file__).parent)
    options = parser.parse_args()
    rel_error = 0.05 if options.quick else 0.03
    chosen = cases.grid()[::97] if options.quick else cases.grid()
    charts = pd.DataFrame([cases.ratio(case, rel_error) for case in chosen])
    charts.to_csv(options.out / "result.csv", index=False)
    if not options.quick:
        charts.drop(columns="seconds").round(5).to_csv(CHARTS, index=False)
        dampers = cases.against_dampers(rel_error)
        dampers.to_csv(options.out / "dampers.csv", index=False)
        figure, panels = plt.subplots(2, 3, figsize=(12.0, 7.2), layout="constrained", sharey=True)
        for ax, (along, other, label, title) in zip(panels.flat, PANELS, strict=False):
            draw(ax, charts, along, other, label)
            ax.set(xscale="log", title=title, ylim=(0.0, 1.05), xlabel="total play / rms without")
            ax.set_xticks([0.5, 1, 2, 4, 9], ["0.5", "1", "2", "4", "9"])
            ax.minorticks_off()
            ax.legend(fontsize=8, frameon=False)
        draw_dampers(panels.flat[5], dampers)
        panels.flat[5].legend(fontsize=8, frameon=False)
        for ax in panels[:, 0]:
            ax.set_ylabel("rms with / without absorber")
        figure.savefig(options.out / "figure.png", dpi=130)
    print(charts.to_string())
