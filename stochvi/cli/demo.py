"""The main job, start to end: a textbook oscillator and a real isolator, by all methods."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pandas as pd
from rich.console import Console

from stochvi.isolators.screening import clearance_curve, predicted_curve, screen
from stochvi.methods.linearisation import linearise
from stochvi.scenes.datasets import shipped_scene
from stochvi.scenes.scene import Scene, load_scene
from stochvi.statistics.overview import overview
from stochvi.verification.check import Check, check
from stochvi.views.files import write_clearance, write_picture, write_table
from stochvi.views.overview import draw_overview
from stochvi.views.tables import (
    methods_table,
    print_check,
    print_clearance,
    print_frame,
    print_screening,
)

Report = Callable[[float, str], None]

TEXTBOOK = {"oscillator-elastic": "R = 1", "oscillator-lossy": "R = 0.8"}
CLEARANCES_IN_SIGMA = (1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0)


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
    write_picture(draw_overview(overview(scene), f"{scene.title}, {label}"), out / "overview.png")


def _show_isolator(
    scene: Scene, out: Path, console: Console, report: Report, seed: int, threads: int | None
) -> None:
    console.print(f"\n[bold]{scene.title}[/bold]")
    linear = screen(scene)
    print_screening(console, linear)
    write_table(linear.to_frame(), out / "screening.csv")
    curve = clearance_curve(
        scene,
        [multiple * linear.displacement_std for multiple in CLEARANCES_IN_SIGMA],
        seed=seed,
        threads=threads,
        progress=lambda done, text: report(0.35 + 0.55 * done, f"hit rate: {text}"),
    )
    print_clearance(console, curve)
    report(0.92, "pictures")
    write_clearance(curve, predicted_curve(scene, curve), scene.title, out)
    write_picture(draw_overview(overview(scene), scene.title), out / "overview.png")
