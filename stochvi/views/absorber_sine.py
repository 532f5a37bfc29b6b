"""Tables and pictures of an absorber under a sine."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from stochvi.absorbers.sine import tuned_key
from stochvi.mathematics.arrays import Vector
from stochvi.mathematics.shown_units import LENGTH
from stochvi.views.axes import add_grid, plain_ticks
from stochvi.views.colours import COLOURS
from stochvi.views.tables import print_frame

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from rich.console import Console

    from stochvi.absorbers.sine import AbsorberSine, ResidualCurve

PANEL = (7.0, 3.2)
"""Width of a figure and height of each of its panels, inches."""

LABEL = "largest displacement\nwith / without absorber"

LOWEST = 1e-3
"""Smallest ratio that a picture shows."""


def print_absorber_sine(console: Console, found: AbsorberSine) -> None:
    """Print the vibration that is left over frequency, the best tuning, and the meanings of the
    columns."""
    console.print(found.summary(), style="bold", highlight=False)
    print_frame(console, ranges(found.frequency), f"motion of {found.carrier!r} over frequency")
    if found.tuning:
        print_frame(console, tunings(found), "best tuning at the frequency of the scene")
    for line in (
        "ratio: largest displacement with the absorber over that without; the least and the "
        "largest of the motions that may last",
        "regime: one with impacts is stable; idle: loose masses may rest in their boxes, and do "
        "nothing; clusters: no regime is reached, impacts come and go",
    ):
        console.print(line, style="dim", highlight=False)
    for warning in found.warnings:
        console.print(f"note: {warning}", style="yellow", highlight=False)


def ranges(curve: ResidualCurve) -> pd.DataFrame:
    """Ranges of values over which the same motions may last, with the ratios in each."""
    kinds = [_lasting(curve, number) for number in range(len(curve.value))]
    starts = [0, *(n for n in range(1, len(kinds)) if kinds[n] != kinds[n - 1]), len(kinds)]
    rows = []
    for first, end in pairwise(starts):
        part = slice(first, end)
        rows.append(
            {
                "from (Hz)": curve.value[first],
                "to (Hz)": curve.value[end - 1],
                "what may last": kinds[first],
                f"without ({LENGTH})": LENGTH(np.max(curve.without[part])),
                "least ratio": np.min(curve.best[part]),
                "largest ratio": np.max(curve.worst[part]),
            }
        )
    return pd.DataFrame(rows)


def tunings(found: AbsorberSine) -> pd.DataFrame:
    """A row for each number that is tuned: its best value and the ratio there."""
    rows = []
    for curve in found.tuning:
        at = curve.tuned
        rows.append(
            {
                "what": _name(curve),
                "best": _shown(curve)[at],
                "ratio": curve.worst[at],
                "first harmonics": curve.first_harmonic[at],
                "what may last": _lasting(curve, at),
            }
        )
    return pd.DataFrame(rows)


def _lasting(curve: ResidualCurve, number: int) -> str:
    seen = {
        "regime": curve.stable[number],
        "bursts": not curve.periodic[number],
        "idle": curve.idle[number],
    }
    return ", ".join(name for name, there in seen.items() if there) or "no impacts"


def _name(curve: ResidualCurve) -> str:
    """The name of the varied number, with its unit where that is known."""
    if curve.key == "frequency_hz":
        return "frequency (Hz)"
    name, quantity = tuned_key(curve.key)
    return quantity.heading(name)


def _shown(curve: ResidualCurve) -> Vector:
    """The varied numbers in the unit that is shown."""
    known = curve.key == "frequency_hz"
    shown: Vector = curve.value if known else tuned_key(curve.key)[1](curve.value)
    return shown


def draw_absorber_sine(found: AbsorberSine) -> Axes:
    """Draw the ratio that the absorber leaves over frequency, and over each number that is
    tuned."""
    import matplotlib.pyplot as plt

    curves = (found.frequency, *found.tuning)
    size = PANEL[0], PANEL[1] * len(curves)
    _, axes = plt.subplots(len(curves), 1, figsize=size, squeeze=False, layout="constrained")
    for ax, curve in zip(axes[:, 0], curves, strict=True):
        plot_residual(curve, ax)
    first: Axes = axes[0, 0]
    first.set_title(f"absorber of {100.0 * found.mass_ratio:.3g} % of the mass, {found.carrier}")
    return first


def plot_absorber_sine(found: AbsorberSine, ax: Axes | None = None) -> Axes:
    """The picture of an answer; in given axes, the panel over frequency alone."""
    return draw_absorber_sine(found) if ax is None else plot_residual(found.frequency, ax)


def plot_residual(curve: ResidualCurve, ax: Axes) -> Axes:
    """Least and largest ratio of the motions that may last, and that of the first harmonics."""
    x, best, worst = _shown(curve), curve.best, curve.worst
    marker = "o" if len(x) < 3 else ""
    ax.fill_between(x, best, worst, color=COLOURS["simulate"], alpha=0.25, linewidth=0)
    ax.semilogy(x, worst, f"-{marker}", color=COLOURS["simulate"], label="largest that may last")
    ax.semilogy(x, best, f"--{marker}", color=COLOURS["simulate"], label="least that may last")
    ax.semilogy(
        x, curve.first_harmonic, f":{marker}", color=COLOURS["exact"],
        label="first harmonics, stable regime",
    )  # fmt: skip
    bursts = ~curve.periodic
    ax.semilogy(
        x[bursts], worst[bursts], ".", color=COLOURS["linearise:closure"], label="bursts"
    )  # fmt: skip
    ax.axhline(1.0, color=COLOURS["stop"], linestyle="--", linewidth=1.0)
    if len(x) > 1 and x[0] > 0.0 and x[-1] / x[0] > 5.0:
        ax.set_xscale("log")
    ax.set_xlabel(_name(curve))
    ax.set_ylabel(LABEL)
    ax.set_ylim(bottom=max(LOWEST, ax.get_ylim()[0]))
    plain_ticks(ax)
    ax.legend(fontsize="small", frameon=False)
    add_grid(ax)
    return ax
