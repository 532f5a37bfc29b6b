"""The main job, start to end: a textbook oscillator and a real isolator, by all methods."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from rich.console import Console

from stochvi.closed_form import exact, unmet_conditions
from stochvi.crosscheck import Check, check
from stochvi.datasets import shipped_scene
from stochvi.files import write_picture, write_table
from stochvi.isolators import Screening, clearance_curve, predicted_rates, screen
from stochvi.linearisation import linearise
from stochvi.monte_carlo import record_path
from stochvi.plots import (
    draw_clearance,
    plot_displacement_density,
    plot_record,
    plot_velocity_density,
)
from stochvi.scenes import Scene, load_scene
from stochvi.tables import methods_table, print_check, print_frame

Report = Callable[[float, str], None]

TEXTBOOK = {"oscillator-elastic": "R = 1", "oscillator-lossy": "R = 0.8"}
CLEARANCES_IN_SIGMA = (1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0)
DENSITY_PERIODS = 60_000.0
RECORD_PERIODS = 25.0
SEARCHED_PERIODS = 400.0


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
    table = methods_table([*verdict.responses, *forms])
    print_frame(console, table, "by all methods, SI units; standard errors in brackets")
    console.print(
        "closure, motion, force: statistical linearisation, approximate; book: as printed there",
        style="dim",
        highlight=False,
    )
    if not verdict.passed:
        print_check(console, verdict)
    console.print(verdict.summary(), highlight=False)
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
    without_stops = scene.model_copy(update={"impact_pairs": ()})
    linear = None
    if not unmet_conditions(without_stops):
        linear = exact(without_stops).estimates()["x", "displacement_std"].value
    figure, axes = plt.subplot_mosaic(
        [["x", "v"], ["record", "record"]], figsize=(9.6, 6.8), layout="constrained"
    )
    plot_displacement_density(scene, long, linear, axes["x"])
    plot_velocity_density(scene, long, axes["v"])
    plot_record(scene, _stretch_with_impacts(scene, period), axes["record"])
    figure.suptitle(f"{scene.title}, {label}" if label else scene.title)
    write_picture(axes["record"], path)


def _stretch_with_impacts(scene: Scene, period: float) -> pd.DataFrame:
    """Some periods of a finely stepped record, from shortly before an impact if there is one."""
    record = record_path(scene, duration=SEARCHED_PERIODS * period, seed=2, step=period / 80.0)
    settled = record[record["time"] > 0.1 * SEARCHED_PERIODS * period]
    hits = settled.loc[settled["impact_speed"] != 0.0, "time"]
    last = settled["time"].iloc[-1] - RECORD_PERIODS * period
    start = min(hits.iloc[0] - 2.0 * period if len(hits) else settled["time"].iloc[0], last)
    short = settled[settled["time"].between(start, start + RECORD_PERIODS * period)]
    return short.assign(time=short["time"] - short["time"].iloc[0])


def clearance_report(
    scene: Scene,
    clearances_in_sigma: Sequence[float],
    out: Path | None,
    console: Console,
    report: Report,
    *,
    rel_error: float = 0.02,
    seed: int = 0,
    threads: int | None = None,
    budget: float | None = 60.0,
) -> None:
    """Hit rate against clearance as a table, and with `out` as CSV and a picture."""
    sigma = screen(scene).displacement_std
    curve = clearance_curve(
        scene,
        [sigma * multiple for multiple in clearances_in_sigma],
        rel_error=rel_error,
        seed=seed,
        threads=threads,
        budget=budget,
        progress=report,
    )
    columns = {
        "clearance_in_sigma": "gap/sigma",
        "gap": "gap (mm)",
        "rice": "Rice (1/s)",
        "closure": "closure",
        "simulated": "Monte Carlo",
        "interval": "95 % interval",
        "impact_speed_mean": "speed (m/s)",
    }
    low, high = curve["simulated_low"], curve["simulated_high"]
    shown = curve.assign(
        gap=1e3 * curve["clearance"],
        interval=[f"{a:.3g} to {b:.3g}" for a, b in zip(low, high, strict=True)],
    )
    title = "hits per second on both stops, and mean impact speed"
    print_frame(console, shown[list(columns)].rename(columns=columns), title, {"gap/sigma": ".2f"})
    if out is not None:
        write_table(curve, out / "clearance.csv")
        grid = np.linspace(curve["clearance"].min(), curve["clearance"].max(), 61)
        ax = draw_clearance(curve, predicted_rates(scene, list(grid)), scene.title)
        write_picture(ax, out / "clearance.png")


def print_screening(console: Console, linear: Screening) -> None:
    """The linear screening of an isolator as a table, with its notes."""
    print_frame(console, linear.to_frame(), "linear screening, stops left out")
    for note in linear.notes:
        console.print(f"note: {note}", style="yellow", highlight=False)


def _show_isolator(
    scene: Scene, out: Path, console: Console, report: Report, seed: int, threads: int | None
) -> None:
    console.print(f"\n[bold]{scene.title}[/bold]")
    linear = screen(scene)
    print_screening(console, linear)
    write_table(linear.to_frame(), out / "screening.csv")
    clearance_report(
        scene,
        CLEARANCES_IN_SIGMA,
        out,
        console,
        lambda done, text: report(0.35 + 0.55 * done, f"hit rate: {text}"),
        seed=seed,
        threads=threads,
    )
    report(0.92, "pictures")
    draw_overview(scene, "", out / "overview.png")
