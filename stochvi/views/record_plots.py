"""Pictures of what is made of records: spectra with their bands, impacts one by one."""

from __future__ import annotations

from typing import TYPE_CHECKING

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes

from stochvi.views.axes import COLOURS

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from stochvi.statistics.impacts import ImpactStatistics
    from stochvi.statistics.impacts.tallies import Histogram
    from stochvi.statistics.spectra import Curve, ResponseSpectrum

DENSITIES = {
    "displacement": "displacement\nrelative to the base\n(m²/Hz)",
    "velocity": "velocity\nrelative to the base\n((m/s)²/Hz)",
    "acceleration": "acceleration\n{}\n((m/s²)²/Hz)",
}
"""Panels of spectra, with their labels; that of an acceleration says which."""

TRANSFERS = {
    "transmissibility_h1": ("H1, the linear part", "#0b6fb8"),
    "transmissibility_ratio": ("root of the ratio of densities", "#d1495b"),
}
"""Lines of the panel of what refers to the excitation."""

COHERENCE = "#3a8f5c"
"""Colour of the coherence, which has an axis of its own."""

TITLE = "spectra, one-sided per hertz, with 95 % bands"

OWNERS = ("#0b6fb8", "#d1495b", "#3a8f5c", "#e0a030", "#7a4fa3", "#1b1b1b")
"""Colours of coordinates and pairs."""

BAND_ALPHA = 0.3


def plot_curve(curve: Curve, ax: Axes, *, colour: str = OWNERS[0], label: str = "") -> Axes:
    """A curve with its 95 % band, both axes logarithmic."""
    ax.fill_between(
        curve.frequency_hz, np.maximum(curve.lower, 1e-300), curve.upper,
        color=colour, alpha=BAND_ALPHA, linewidth=0,
    )  # fmt: skip
    ax.plot(curve.frequency_hz, curve.value, color=colour, linewidth=0.9, label=label)
    ax.set_xscale("log")
    ax.set_yscale("log")
    return ax


def draw_spectrum(
    found: ResponseSpectrum, title: str = "", references: Mapping[str, NDArray[np.float64]] = {}
) -> Axes:
    """All spectra, one panel a quantity; the last refers to the excitation.

    `references` are displacement densities at `found.frequency_hz` to draw beside, by label.
    """
    present = [name for name in DENSITIES if any(name in c for c in found.curves.values())]
    transfer = next((c for c in found.curves.values() if "coherence" in c), None)
    rows = len(present) + (transfer is not None)
    figure, grid = plt.subplots(
        rows, 1, figsize=(7.2, 2.3 * rows + 0.6), sharex=True, squeeze=False, layout="constrained"
    )
    axes = grid[:, 0]
    for ax, name in zip(axes, present, strict=False):
        for colour, (owner, curves) in zip(OWNERS, found.curves.items(), strict=False):
            if name in curves:
                plot_curve(curves[name], ax, colour=colour, label=owner)
        which, _, more = found.meanings.get(name, "").partition(", between impacts")
        ax.set_ylabel(DENSITIES[name].format("absolute, between impacts" if more else which))
        ax.grid(alpha=0.25)
    for label, density in references.items():
        axes[0].plot(found.frequency_hz, density, color=COLOURS["exact"], lw=0.9, label=label)
    if len(found.curves) > 1 or references:
        axes[0].legend(frameon=False, fontsize="small")
    if transfer is not None:
        _draw_transfer(transfer, axes[-1])
    axes[-1].set_xlabel("frequency (Hz)")
    figure.suptitle(f"{title}\n{TITLE}" if title else TITLE, fontsize="medium")
    first: Axes = axes[0]
    return first


def _draw_transfer(transfer: Mapping[str, Curve], ax: Axes) -> None:
    """Transmissibilities, and the coherence on a linear axis at the right."""
    for name, (label, colour) in TRANSFERS.items():
        plot_curve(transfer[name], ax, colour=colour, label=label)
    values = np.concatenate([transfer[name].value for name in TRANSFERS])
    ax.set_ylim(0.5 * max(values.min(), 1e-3 * values.max()), 4.0 * values.max())
    ax.set_ylabel("transmissibility")
    ax.grid(alpha=0.25)
    right = ax.twinx()
    plot_curve(transfer["coherence"], right, colour=COHERENCE, label="coherence, right axis")
    right.set_yscale("linear")
    right.set_ylim(0.0, 1.25)  # the legend stands above 1
    right.set_yticks(np.linspace(0.0, 1.0, 6))
    right.set_ylabel("coherence", color=COHERENCE)
    right.tick_params(axis="y", colors=COHERENCE)
    lines = [*ax.get_lines(), *right.get_lines()]
    ax.legend(handles=lines, frameon=False, fontsize="small", ncols=3, loc="upper left")


def plot_histogram(found: Histogram, ax: Axes, *, colour: str = OWNERS[0], label: str = "") -> Axes:
    """A density on logarithmic bins, with its standard errors; empty bins are left out."""
    seen = found.density > 0.0
    ax.errorbar(
        found.middles[seen], found.density[seen], found.standard_error[seen],
        fmt="o", markersize=3, color=colour, linewidth=0.9, label=label,
    )  # fmt: skip
    ax.set_xscale("log")
    ax.set_yscale("log")
    return ax


def draw_impacts(found: ImpactStatistics, title: str = "") -> Axes:
    """Densities of impact speeds, with Rayleigh's of the same rms speed and the power law of slow
    impacts, and of the times between impacts."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(9.6, 4.2), layout="constrained")
    for colour, (name, pair) in zip(OWNERS, found.pairs.items(), strict=False):
        if pair.speeds is None:
            continue
        plot_histogram(pair.speeds, left, colour=colour, label=name)
        w = pair.speeds.middles
        left.plot(w, pair.rayleigh(w), "--", color=colour, linewidth=1.0, label="Rayleigh")
        for side, exponent in pair.exponents.items():
            if exponent.theory is None:
                continue
            seen = np.flatnonzero(pair.speeds.density > 0.0)
            slow = w < 0.3 * pair.speed_rms.value if pair.speed_rms else w < 0.0
            start = pair.speeds.density[seen][:8].mean(), w[seen][:8].mean()
            power = start[0] * (w[slow] / start[1]) ** exponent.theory
            label = f"w^{exponent.theory:.2g}" + (f", {side}" if side != "both" else "")
            left.plot(w[slow], power, ":", color=colour, linewidth=1.6, label=label)
        if pair.intervals is not None:
            plot_histogram(pair.intervals, right, colour=colour, label=name)
            t, rate = pair.intervals.middles, pair.rates["both"].estimate.value
            with np.errstate(under="ignore"):
                poisson = rate * np.exp(-rate * t)
            right.plot(t, poisson, "--", color=colour, linewidth=1.0, label="Poisson")
    for ax, labels in (
        (left, ("impact speed (m/s)", "density (s/m)")),
        (right, ("time between impacts (s)", "density (1/s)")),
    ):
        heights = [float(y) for each in ax.containers for y in each[0].get_ydata()]
        ax.set_ylim(0.3 * min(heights, default=1e-3), 3.0 * max(heights, default=1.0))
        ax.set_xlabel(labels[0])
        ax.set_ylabel(labels[1])
        ax.grid(alpha=0.25)
        ax.legend(frameon=False, fontsize="small")
    figure.suptitle(title or "impacts")
    first: Axes = left
    return first
