"""The picture of the charts."""

import cases
import matplotlib.pyplot as plt
import pandas as pd

PANELS = (
    ("mass_ratio", "{:.3g}", "mass ratio; R = 0.5"),
    ("restitution", "R = {:g}", "restitution; mass ratio 0.05"),
    ("zeta", "zeta = {:g}", "damping of the structure; mass ratio 0.05"),
    ("units", "units: {:g}", "number of units; mass ratio 0.05 in all"),
)


def curve(ax: plt.Axes, rows: pd.DataFrame, along: str, colour: tuple, label: str) -> None:
    rows = rows.sort_values(along)
    errors = 2.0 * rows["standard_error"] + rows["bias"]
    look = {"marker": "o", "markersize": 3.5, "linewidth": 1.4, "color": colour, "label": label}
    ax.errorbar(rows[along], rows["rms_ratio"], yerr=errors, **look)


def draw(charts: pd.DataFrame, dampers: pd.DataFrame) -> plt.Figure:
    figure, panels = plt.subplots(3, 2, figsize=(9.0, 11.5), layout="constrained", sharey=True)
    shades = plt.get_cmap("viridis")
    for ax, (along, label, title) in zip(panels.flat, PANELS, strict=False):
        groups = list(cases.select(charts, **{along: None}).groupby(along))
        for number, (value, group) in enumerate(groups):
            colour = shades(0.88 * number / max(len(groups) - 1, 1))
            curve(ax, group, "play_in_sigma", colour, label.format(value))
        ax.set(xscale="log", title=title, xlabel="play / rms without absorber")
        ax.set_xticks(cases.PLAYS, [f"{play:g}" for play in cases.PLAYS], minor=False)
        ax.minorticks_off()
    narrow = cases.select(charts, noise="narrow")
    curve(panels.flat[3], narrow, "play_in_sigma", "#c0504d", "1, narrow-band noise")
    detuned, best = panels.flat[4:]
    tuned = dampers[dampers["tuning"] == "white_noise"]
    for number, mass in enumerate((0.02, 0.05, 0.1)):
        own = tuned[tuned["mass_ratio"] == mass]
        detuned.plot(own["frequency_ratio"], own["rms_ratio"], "--", color=shades(0.44 * number))
        rows = cases.select(charts, mass_ratio=mass, frequency_ratio=None, play_in_sigma=3.0)
        curve(detuned, rows, "frequency_ratio", shades(0.44 * number), f"mass ratio {mass:g}")
    detuned.plot([], [], "k--", label="tuned mass damper")
    detuned.set(
        xlabel="frequency of the structure / designed for",
        title="off tune: boxes of 3 rms, R = 0.5",
    )
    detuned.set_xticks([0.9, 0.95, 1.0, 1.05, 1.1])
    rows = cases.select(charts, mass_ratio=None).sort_values("rms_ratio")
    curve(best, rows.drop_duplicates("mass_ratio"), "mass_ratio", "#1f4e79", "box, best play")
    own = tuned.groupby("mass_ratio")["rms_ratio"]
    best.plot(own.min(), "s--", color="#c0504d", markersize=3.5, label="tuned mass damper")
    best.plot(own.max(), ":", color="#c0504d", label="damper, at worst 10 % off")
    best.set(xscale="log", xlabel="mass ratio", title="against a tuned mass damper")
    best.set_xticks(cases.FAMILIES["mass_ratio"], [f"{m:g}" for m in cases.FAMILIES["mass_ratio"]])
    best.minorticks_off()
    for number, ax in enumerate(panels.flat):
        ax.set_ylim(0.15, 1.04)
        ax.grid(alpha=0.25)
        ax.legend(frameon=False, ncols=2 + (number < 2), columnspacing=1.0, handlelength=1.5)
        ax.set_ylabel("rms with / without" if ax in panels[:, 0] else "")
    return figure
