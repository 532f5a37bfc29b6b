"""The figure of the study: errors of averaging, the exponent, and one density."""

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

import stochvi as sv
from stochvi.mathematics.impact_rates import corner_exponent
from stochvi.views.density import plot_impact_speeds, plot_plane

STYLES = {"finite jumps": "o-", "continuous": "s--", "unfolded": "^:"}
LABELS = {"velocity_std": "rms velocity", "impact_speed_rate": "F1"}


def errors(ax: plt.Axes, table: pd.DataFrame, quantity: str, damping: float) -> None:
    """Relative errors of each variant of averaging, and of Monte Carlo, against the solver."""
    part = table[(table["quantity"] == quantity) & (table["damping"] == damping)]
    wide = part.pivot(index="restitution", columns="method", values="value")
    for variant, style in STYLES.items():
        ax.plot(wide.index, 100.0 * (wide[variant] / wide["solver"] - 1.0), style, label=variant)
    spread = part.pivot(index="restitution", columns="method", values="standard_error")
    off = 100.0 * (wide["Monte Carlo"] / wide["solver"] - 1.0)
    ax.errorbar(
        wide.index, off, 200.0 * spread["Monte Carlo"] / wide["solver"], fmt="k.",
        label="Monte Carlo, 2 s.e.",
    )  # fmt: skip
    ax.axhline(0.0, color="0.7", linewidth=0.8)
    ax.set(xlabel="restitution R", ylabel=f"error of {LABELS[quantity]} (%)", ylim=(-40.0, 20.0))
    ax.set_title(f"{LABELS[quantity]}, b = {damping:g}", fontsize="medium")


def figure_of(table: pd.DataFrame, slopes: pd.DataFrame, case: sv.Scene) -> Figure:
    """All panels."""
    figure, panels = plt.subplots(2, 3, figsize=(13.0, 7.6), layout="constrained")
    errors(panels[0, 0], table, "velocity_std", 0.1)
    errors(panels[0, 1], table, "impact_speed_rate", 0.1)
    errors(panels[1, 1], table, "impact_speed_rate", 0.01)
    panels[0, 0].legend(frameon=False)
    ax = panels[1, 0]
    grid = np.linspace(0.02, 1.0, 200)
    ax.plot(grid, [corner_exponent(r) for r in grid], "k-", linewidth=1.0, label="formula")
    ax.plot(slopes["restitution"], slopes["solver"], "s", mfc="none", label="solver")
    ax.errorbar(
        slopes["restitution"], slopes["monte_carlo"], 2.0 * slopes["standard_error"], fmt="C3.",
        label="paths, 2 s.e.",
    )  # fmt: skip
    ax.axhline(2.0, color="0.7", linewidth=0.8)
    ax.set(xlabel="restitution R", ylabel=r"$\beta$ of p(stop, v) ~ $|v|^{-\beta}$")
    ax.legend(frameon=False)
    density = sv.fokker_planck_density(case, rtol=1e-6)
    plot_plane(case, density, panels[0, 2]).set_title("R = 0.5, b = 0.1", fontsize="medium")
    plot_impact_speeds(case, density, panels[1, 2])
    return figure
