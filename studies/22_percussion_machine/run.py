"""A percussion machine: where it strikes once a period, how hard, and what noise makes of that."""

import argparse
import math
import time
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

import stochvi as sv
from stochvi.methods.periodic import Branch, HarmonicResponse
from stochvi.scenes.datasets import shipped_scene
from stochvi.scenes.keys import changed_scene
from stochvi.views.files import write_picture

SHIPPED = sv.load_scene(shipped_scene("hammer"))
"""1 kg strikes with R = 0.3; 10 kg around it, 5 kN/m and 14 N s/m between, a crank of 50 mm."""

STRIKER, BODY, SPRING, CRANK, DAMPER, RESTITUTION = 1.0, 10.0, 5000.0, 0.05, 14.0, 0.3
NATURAL = math.sqrt(SPRING * (1.0 / STRIKER + 1.0 / BODY)) / (2.0 * math.pi)
"""Frequency of the two masses on their spring, Hz."""

FEED, FREQUENCY = "excitation.0.force", "excitation.1.frequency_hz"
SHOWN = 100.0
"""The feed of the curves over frequency, N."""

NOISES = (0.0, 20.0, 100.0)
"""Intensities of the noise between striker and body, N^2 s."""


def machine(feed: float, frequency: float, *, damper: float = DAMPER) -> sv.Scene:
    """The machine under its crank alone."""
    keys = [(FEED, feed), (FREQUENCY, frequency)]
    keys += [
        (f"structure.damping.{i}.{j}", damper if i == j else -damper)
        for i in range(2)
        for j in range(2)
    ]
    scene = changed_scene(SHIPPED.document(as_written=True), keys)
    return scene.model_copy(update={"excitations": scene.excitations[:2]})


def single(found: HarmonicResponse) -> list[Branch]:
    """Branches of one blow in each period."""
    return [each for each in found.branches if len(each.stops) == each.periods == 1]


def limit(ratio: float) -> float:
    """Greatest G / P with one blow a period without damping (B 4.21)."""
    lossy = (1.0 + RESTITUTION) / (1.0 - RESTITUTION)
    return lossy * ratio**2 / abs(1.0 - ratio**2) / math.pi


def fold(ratio: float) -> float:
    """G / P at which the exact branch of the machine without its damper turns back; NaN where it
    ends before, at a further blow in the period."""
    expected, force = limit(ratio), SPRING * CRANK
    feeds = force * expected * np.linspace(0.97, 1.03, 5)
    scene = machine(feeds[2], ratio * NATURAL, damper=0.0)
    found = sv.harmonic_response(scene, vary={FEED: feeds}, most_impacts=1)
    ends = [
        float(branch.value[branch.names.index("fold")]) / force
        for branch in single(found)
        if "fold" in branch.names
    ]
    return max(ends, default=math.nan)


def least_for_both(body: float) -> float:
    """G / P from which a second branch exists just above resonance, without damping and loss."""
    couple = np.array([[1.0, -1.0], [-1.0, 1.0]])
    book = (1.0 + body) / (2.0 * body)
    scene = sv.Scene(
        structure=sv.Matrices(
            coordinates=("striker", "body"), mass=np.diag([1.0, body]), damping=0.0 * couple,
            stiffness=couple,
        ),
        impact_pairs=[sv.ImpactPair(on="striker", upper=0.0, law=sv.Restitution(coefficient=1.0))],
        excitations=[
            sv.ConstantLoad(on="body", force=book),
            sv.Sine(
                between=("striker", "body"), amplitude=1.0,
                frequency_hz=1.0001 * math.sqrt(1.0 + 1.0 / body) / (2.0 * math.pi),
            ),
        ],
    )  # fmt: skip
    feeds = book * np.linspace(0.9, 1.1, 9)
    found = single(sv.harmonic_response(scene, vary={FEED: feeds}, most_impacts=1))
    return max(float(each.value[each.admissible].min()) for each in found)


def counted(frequency: float, feeds: np.ndarray) -> pd.DataFrame:
    """Numbers of regimes of one blow a period, and of the stable ones among them, over the feed."""
    found = sv.harmonic_response(machine(SHOWN, frequency), vary={FEED: feeds}, most_impacts=1)
    branches = single(found)
    there = [[(each, place) for each in branches for place in each.at(feed)] for feed in feeds]
    return pd.DataFrame(
        {
            "frequency_hz": frequency, "feed_N": feeds,
            "regimes": [len(each) for each in there],
            "stable": [sum(bool(branch.stable[k]) for branch, k in each) for each in there],
        }
    )  # fmt: skip


def simulated(frequency: float, noise: float, crank: bool, paths: int) -> dict[str, float]:
    """Blows under the crank, noise or both."""
    scene = machine(SHOWN, frequency)
    shaken = sv.WhiteNoise(between=("striker", "body"), intensity=noise or 1e-6)
    kept = scene.excitations if crank else scene.excitations[:1]
    scene = scene.model_copy(update={"excitations": (*kept, shaken)})
    found = sv.simulate(scene, paths=paths, duration=30.0, budget=None)
    tool = found.impact_pairs["tool"]
    mean, square = tool.impact_speed_rate, tool.impact_speed_square_rate
    rate, body = tool.collision_rate, found.coordinates["body"]["displacement_std"]
    return {
        "frequency_hz": frequency if crank else math.nan, "noise_N2s": noise,
        "blows_per_s": rate.value, "blows_error": rate.standard_error,
        "energy_J": 0.5 * STRIKER * square.value / rate.value,
        "energy_error": 0.5 * STRIKER * square.standard_error / rate.value,
        "power_W": 0.5 * (1.0 - RESTITUTION**2) * STRIKER * square.value,
        "body_rms_mm": 1e3 * body.value,
        "momentum_off": (1.0 + RESTITUTION) * STRIKER * mean.value / SHOWN - 1.0,
        "momentum_error": (1.0 + RESTITUTION) * STRIKER * mean.standard_error / SHOWN,
    }  # fmt: skip


def draw_map(panel: plt.Axes, table: pd.DataFrame) -> None:
    """Where one blow a period exists, and where it is stable."""
    force = SPRING * CRANK
    grid = table.pivot(index="feed_N", columns="frequency_hz", values="regimes")
    stable = table.pivot(index="feed_N", columns="frequency_hz", values="stable")
    across, up = grid.columns.to_numpy() / NATURAL, grid.index.to_numpy() / force
    shades = np.where(stable > 0, 2, np.minimum(grid, 1))
    colours = plt.matplotlib.colors.ListedColormap(["#ffffff", "#f3d9a4", "#4f9d69"])
    panel.pcolormesh(across, up, shades, cmap=colours, vmin=0, vmax=2, shading="nearest")
    two = np.ma.masked_where(grid.to_numpy() < 2, np.ones(grid.shape))
    panel.contourf(across, up, two, levels=[0.5, 1.5], colors="none", hatches=["///"])
    fine = np.linspace(across[0], across[-1], 400)
    panel.plot(fine, [limit(each) for each in fine], "k-", lw=1.3, label="limit (4.21), no damper")
    panel.axhline(
        (STRIKER + BODY) / (2.0 * BODY), color="k", ls=":", lw=1.2,
        label="both branches from here on (4.28), no damper",
    )  # fmt: skip
    for colour, label in (("#4f9d69", "stable"), ("#f3d9a4", "unstable")):
        panel.fill_between([], [], color=colour, label=f"one blow a period, {label}")
    panel.fill_between([], [], facecolor="none", edgecolor="k", hatch="///", label="two of them")
    panel.set_xlim(across[0], across[-1])
    panel.set_ylim(up[0], up[-1])
    panel.set_xlabel("frequency of the crank over that of the two masses")
    panel.set_ylabel("feed over amplitude of the crank's force, G / P")
    panel.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=1, fontsize="small")


def draw(maps: pd.DataFrame, exact: HarmonicResponse, runs: pd.DataFrame, file: Path) -> None:
    _, panels = plt.subplots(2, 2, figsize=(10.5, 9.5), layout="constrained")
    draw_map(panels[0, 0], maps)
    energy, rate, body = panels[0, 1], panels[1, 0], panels[1, 1]
    for branch in single(exact):
        for stable, style in ((True, "k-"), (False, "k--")):
            shown = np.where(branch.admissible & (branch.stable == stable), 1.0, np.nan)
            label = f"exact, one blow a period, {'stable' if stable else 'unstable'}"
            known = energy.get_legend_handles_labels()[1]
            if not np.all(np.isnan(shown)):
                value = 0.5 * STRIKER * branch.impact_speed[:, 0] ** 2
                energy.plot(
                    branch.frequency_hz, value * shown, style, lw=1.2,
                    label=None if label in known else label,
                )  # fmt: skip
    for number, noise in enumerate(NOISES):
        own = runs[(runs["noise_N2s"] == noise) & runs["frequency_hz"].notna()]
        style = {"fmt": "o", "ms": 4, "color": f"C{number}", "capsize": 2}
        label = f"crank and noise of {noise:g} N²s" if noise else "crank alone"
        for panel, value, error in (
            (energy, "energy_J", "energy_error"), (rate, "blows_per_s", "blows_error"),
        ):  # fmt: skip
            across, up, bars = own["frequency_hz"], own[value], own[error]
            panel.errorbar(across, up, yerr=bars, label=label, **style)
        body.plot(
            own["frequency_hz"], own["body_rms_mm"], "o", ms=4, color=f"C{number}", label=label
        )
    ends = np.array([runs["frequency_hz"].min(), runs["frequency_hz"].max()])
    rate.plot(ends, ends, "k-", lw=1.0, label="one blow a period")
    rate.plot(ends, 0.5 * ends, "k:", lw=1.0, label="one in two periods")
    energy.set_ylabel("energy of a blow (J)")
    rate.set_ylabel("blows (1/s)")
    body.set_ylabel("rms motion of the body (mm)")
    for panel in (energy, rate, body):
        panel.set_ylim(bottom=0.0)
        panel.set_xlabel("frequency of the crank (Hz)")
        panel.grid(color="#dddddd", linewidth=0.6)
        panel.legend(fontsize="small")
    energy.set_ylim(0.0, 55.0)
    write_picture(energy, file)


parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--quick", action="store_true", help="few places, frequencies and paths")
parser.add_argument("--out", type=Path, default=Path(__file__).parent)
options = parser.parse_args()
started = time.process_time()
columns, steps, points, paths = (4, 6, 4, 8) if options.quick else (33, 41, 23, 16)

ratios = (0.7, 1.5) if options.quick else (0.5, 0.7, 0.85, 1.1, 1.2, 1.5, 2.0)
folds = pd.DataFrame(
    {
        "ratio": ratios,
        "book": [limit(each) for each in ratios],
        "fold": [fold(each) for each in ratios],
    }
)
folds["off"] = folds["fold"] / folds["book"] - 1.0
print(folds.to_string())
for heavy in (2.0, 50.0):
    book = (1.0 + heavy) / (2.0 * heavy)
    print(f"both branches, body {heavy:g}: {least_for_both(heavy):.5f}, (4.28) has {book:.5f}")
feeds = SPRING * CRANK * np.linspace(0.05, 1.25, steps)
maps = pd.concat(
    [counted(each * NATURAL, feeds) for each in np.linspace(0.5, 1.6, columns)], ignore_index=True
)
places = np.linspace(7.0, 16.0, points)
exact = sv.harmonic_response(machine(SHOWN, 12.0), places, coordinate="body", most_impacts=1)
runs = pd.DataFrame(
    [simulated(each, noise, True, paths) for noise in NOISES for each in places]
    + [simulated(12.0, noise, False, paths) for noise in NOISES[1:]]
)
locked = [
    (row.energy_J, 0.5 * STRIKER * found.loc[found["stable"], "impact_speed_max"].to_numpy() ** 2)
    for row in runs[runs["noise_N2s"] == 0.0].dropna().itertuples()
    if (
        found := exact.at(row.frequency_hz).query("periods == 1 and impacts_per_period == 1")
    ).stable.any()
]
off = [abs(energy / known - 1.0).min() for energy, known in locked]
print(runs.to_string())
print(f"simulated energy off the exact stable regime: {np.median(off):.1e}, most {max(off):.1e}")
print(f"momentum: off by {runs['momentum_off'].abs().max():.1e} at most")
pd.concat([runs, maps, folds]).to_csv(options.out / "result.csv", index=False, float_format="%.6g")
draw(maps, exact, runs, options.out / "figure.png")
print(f"{time.process_time() - started:.0f} s of CPU")
