"""The picture of the study: errors of averaging, the exponent, and one density."""

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

import stochvi as sv
from stochvi.mathematics.impact_rates import corner_exponent
from stochvi.views.axes import COLOURS, OWNERS
from stochvi.views.density import plot_impact_speeds, plot_plane

STYLES = {"finite jumps": "o-", "continuous": "s--", "unfolded": "^:"}
NAMES = {
    "finite jumps": "finite jumps",
    "continuous": "spread over a cycle",
    "unfolded": "unfolded",
}
LABELS = {"velocity_std": "rms velocity", "impact_speed_rate": "F1"}


def errors(ax: plt.Axes, table: pd.DataFrame, quantity: str, damping: float) -> None:
    """Relative errors of each variant of averaging, and of Monte Carlo, against the solver."""
    part = table[(table["quantity"] == quantity) & (table["damping"] == damping)]
    wide = part.pivot(index="restitution", columns="method", values="value")
    for (variant, style), colour in zip(STYLES.items(), OWNERS, strict=False):
        error = 100.0 * (wide[variant] / wide["solver"] - 1.0)
        ax.plot(wide.index, error, style, color=colour, label=NAMES[variant])
    spread = part.pivot(index="restitution", columns="method", values="standard_error")
    off = 100.0 * (wide["Monte Carlo"] / wide["solver"] - 1.0)
    ax.errorbar(
        wide.index, off, 200.0 * spread["Monte Carlo"] / wide["solver"], fmt="k.",
        label="Monte Carlo, 2 standard errors",
    )  # fmt: skip
    ax.axhline(0.0, color="0.7", linewidth=0.8)
    ax.set(xlabel="restitution R", ylabel=f"error of {LABELS[quantity]} (%)", ylim=(-40.0, 20.0))
    ax.set_title(f"averaging: {LABELS[quantity]}, b = {damping:g}")


def exponents(ax: plt.Axes, slopes: pd.DataFrame) -> None:
    """Exponent of the density at a stop and zero speed, by formula, solver and paths."""
    grid = np.linspace(0.02, 1.0, 200)
    ax.plot(grid, [corner_exponent(r) for r in grid], color=COLOURS["exact"], label="formula")
    solver = {"color": COLOURS["fokker-planck"], "markerfacecolor": "none", "label": "solver"}
    ax.plot(slopes["restitution"], slopes["solver"], "s", **solver)
    ax.errorbar(
        slopes["restitution"], slopes["monte_carlo"], 2.0 * slopes["standard_error"], fmt=".",
        color=COLOURS["simulate"], label="paths, 2 standard errors",
    )  # fmt: skip
    ax.axhline(2.0, color="0.7", linewidth=0.8)
    ax.set(xlabel="restitution R", ylabel=r"exponent $\beta$ of the density $|v|^{-\beta}$")
    ax.set_title("density at a stop and zero speed, b = 0.1")
    ax.legend(frameon=False)


def figure_of(table: pd.DataFrame, slopes: pd.DataFrame, case: sv.Scene) -> Figure:
    """All panels."""
    figure = plt.figure(figsize=(9.0, 11.0), layout="constrained")
    rows = [row.subplots(1, 2) for row in figure.subfigures(3, 1)]
    errors(rows[0][0], table, "velocity_std", 0.1)
    errors(rows[0][1], table, "impact_speed_rate", 0.1)
    errors(rows[1][0], table, "impact_speed_rate", 0.01)
    rows[0][0].legend(frameon=False)
    exponents(rows[1][1], slopes)
    density = sv.fokker_planck_density(case, rtol=1e-6)
    plot_plane(case, density, rows[2][0]).set_title("density, R = 0.5, b = 0.1")
    speeds = plot_impact_speeds(case, density, rows[2][1])
    speeds.set(title="impact speeds, R = 0.5, b = 0.1", ylabel="impacts per second and m/s (1/m)")
    speeds.legend(frameon=False)
    return figure
