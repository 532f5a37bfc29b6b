"""The main job, start to end: a textbook oscillator and a real isolator, by all methods."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from rich.console import Console

from stochvi.closed_form import exact, unmet_conditions
from stochvi.crosscheck import Check, check
from stochvi.datasets import shipped_scene
from stochvi.files import write_picture, write_table
from stochvi.isolators import clearance_curve, screen
from stochvi.linearisation import linearise
from stochvi.monte_carlo import record_path
from stochvi.plots import (
    plot_clearance_curve,
    plot_clearance_ratio,
    plot_displacement_density,
    plot_record,
    plot_velocity_density,
)
from stochvi.scenes import Scene, load_scene
from stochvi.tables import methods_table, print_check, print_frame

Report = Callable[[float, str], None]

TEXTBOOK = {"oscillator-elastic": "R = 1", "oscillator-lossy": "R = 0.8"}
CLEARANCES_IN_SIGMA = np.arange(1.0, 4.01, 0.5)
QUANTITIES = (
    "displacement_std",
    "velocity_std",
    "collision_rate",
    "impact_speed_rate",
    "impact_speed_square_rate",
)
DENSITY_PERIODS = 60_000.0
RECORD_PERIODS = 25.0


def run_demo(
    out: Path, console: Console, report: Report, *, seed: int = 0, threads: int | None = None
) -> bool:
    """Run the demo, print its tables, write them with pictures to `out`; True if all agree."""
    agreed = True
    for number, (name, label) in enumerate(TEXTBOOK.items()):
        report(0.15 * number, f"oscillator between stops, {label}")
        scene = load_scene(shipped_scene(name))
        verdict = check(scene, rel_error=0.002, seed=seed, threads=threads)
        agreed &= verdict.passed
        _show_textbook(scene, verdict, label, out / name, console)
    report(0.3, "isolator: linear screening")
    isolator = load_scene(shipped_scene("isolator-truck"))
    _show_isolator(isolator, out / "isolator-truck", console, report, seed, threads)
    report(1.0, "done")
    return agreed


def _show_textbook(scene: Scene, verdict: Check, label: str, out: Path, console: Console) -> None:
    console.print(f"\n[bold]Oscillator between stops at 1 sigma, {label}[/bold]")
    forms = [linearise(scene, form=form, variant="book") for form in ("motion", "force")]
    table = methods_table([*verdict.responses, *forms], QUANTITIES)
    print_frame(console, table, "all methods (standard error in brackets; SI units)", {})
    if not verdict.passed:
        print_check(console, verdict)
    judged = sum(row.tolerance is not None for row in verdict.comparisons)
    console.print(
        f"{judged} comparisons (methods and balances): "
        + ("all agree within their errors" if verdict.passed else "[bold red]some DISAGREE"),
        highlight=False,
    )
    write_table(verdict.to_frame(), out / "check.csv")
    write_table(
        pd.concat([response.to_frame() for response in [*verdict.responses, *forms]]),
        out / "methods.csv",
    )
    draw_overview(scene, label, out / "overview.png")


def draw_overview(scene: Scene, label: str, path: Path) -> None:
    """Densities of x and v and a short record, side by side, as a PNG."""
    period = 2.0 * np.pi / scene.structure.omega
    long = record_path(scene, duration=DENSITY_PERIODS * period, seed=1)
    short = record_path(scene, duration=2.0 * RECORD_PERIODS * period, seed=2, step=period / 80.0)
    short = short[short["time"] > RECORD_PERIODS * period]
    short = short.assign(time=short["time"] - short["time"].iloc[0])
    without_stops = scene.model_copy(update={"impact_pairs": ()})
    linear = None
    if not unmet_conditions(without_stops):
        linear = exact(without_stops).estimates()["x", "displacement_std"].value
    figure, axes = plt.subplot_mosaic(
        [["x", "v"], ["record", "record"]], figsize=(9.6, 6.8), layout="constrained"
    )
    plot_displacement_density(scene, long, linear, axes["x"])
    plot_velocity_density(scene, long, axes["v"])
    plot_record(scene, short, axes["record"])
    figure.suptitle(f"{scene.title}, {label}" if label else scene.title)
    write_picture(axes["record"], path)


def _show_isolator(
    scene: Scene, out: Path, console: Console, report: Report, seed: int, threads: int | None
) -> None:
    console.print(f"\n[bold]{scene.title}[/bold]")
    linear = screen(scene)
    print_frame(console, linear.to_frame(), "linear screening, stops left out", {})
    curve = clearance_curve(
        scene,
        list(CLEARANCES_IN_SIGMA * linear.displacement_std),
        rel_error=0.02,
        seed=seed,
        threads=threads,
        progress=lambda done, text: report(0.35 + 0.55 * done, f"hit rate: {text}"),
    )
    shown = curve.assign(
        clearance=1e3 * curve["clearance"], displacement_std=1e3 * curve["displacement_std"]
    ).rename(
        columns={
            "clearance": "gap (mm)",
            "clearance_in_sigma": "gap / sigma",
            "simulated_low": "low 95 %",
            "simulated_high": "high 95 %",
            "displacement_std": "rms x (mm)",
            "impact_speed_mean": "impact speed (m/s)",
        }
    )
    print_frame(
        console, shown, "hits per second on both stops against clearance", {"gap / sigma": ".1f"}
    )
    write_table(linear.to_frame(), out / "screening.csv")
    write_table(curve, out / "clearance.csv")
    report(0.92, "pictures")
    figure, (above, below) = plt.subplots(
        2, 1, figsize=(6.8, 6.4), height_ratios=(2.2, 1.0), layout="constrained", sharex=True
    )
    plot_clearance_curve(curve, above).set_xlabel("")
    plot_clearance_ratio(curve, below)
    figure.suptitle(scene.title)
    write_picture(above, out / "clearance.png")
    draw_overview(scene, "", out / "overview.png")
