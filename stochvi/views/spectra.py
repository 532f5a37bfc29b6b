"""Pictures of response spectra with their 95 % bands."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes

from stochvi.mathematics.shown_units import NUMBER, ShownQuantity, Size
from stochvi.views.axes import MOST_OF_SPECTRA, limit_decades
from stochvi.views.colours import BAND_ALPHA, OWNERS, TRANSFERS

if TYPE_CHECKING:
    from collections.abc import Mapping

    from stochvi.statistics.spectra import Curve, ResponseSpectrum

DENSITIES = {
    "displacement": (
        "displacement\nrelative to the base", ShownQuantity("length", Size("m²/Hz", 1.0), 2, "/Hz")
    ),
    "velocity": (
        "velocity\nrelative to the base", ShownQuantity("speed", Size("(m/s)²/Hz", 1.0), 2, "/Hz")
    ),
    "acceleration": (
        "acceleration\n{}", ShownQuantity("acceleration density", Size("(m/s²)²/Hz", 1.0))
    ),
}  # fmt: skip
"""Labels of the panels of densities, by quantity; the label of an acceleration is completed by the
kind of acceleration."""

TRANSFER_NAMES = {
    "transmissibility_h1": "H1, the linear part",
    "transmissibility_ratio": "root of the ratio of densities",
}
"""Names of the transmissibilities in the panel that compares with the excitation."""

TITLE = "spectra, one-sided per hertz, with 95 % bands"


def plot_curve(
    curve: Curve, ax: Axes, *, colour: str = OWNERS[0], label: str = "",
    quantity: ShownQuantity = NUMBER,
) -> Axes:  # fmt: skip
    """A curve with its 95 % band, both axes logarithmic; values that reach zero leave the view."""
    ax.fill_between(
        curve.frequency_hz, np.maximum(quantity(curve.lower), 1e-300), quantity(curve.upper),
        color=colour, alpha=BAND_ALPHA, linewidth=0,
    )  # fmt: skip
    ax.plot(curve.frequency_hz, quantity(curve.value), color=colour, linewidth=0.9, label=label)
    ax.set_xscale("log")
    ax.set_yscale("log")
    limit_decades(ax, MOST_OF_SPECTRA)
    return ax


MODAL = re.compile(r"mode \d+")
"""Names of modal coordinates, which are not drawn beside points."""


def draw_spectrum(found: ResponseSpectrum, title: str = "") -> Axes:
    """All spectra, one panel for each quantity; the last panel compares with the excitation."""
    shown = {owner: c for owner, c in found.curves.items() if not MODAL.fullmatch(owner)}
    shown = shown or dict(found.curves)
    present = [name for name in DENSITIES if any(name in c for c in shown.values())]
    transfer = next((c for c in found.curves.values() if "coherence" in c), None)
    rows = len(present) + (transfer is not None)
    figure, grid = plt.subplots(
        rows, 1, figsize=(7.2, 2.3 * rows + 0.6), sharex=True, squeeze=False, layout="constrained"
    )
    axes = grid[:, 0]
    for ax, name in zip(axes, present, strict=False):
        words, quantity = DENSITIES[name]
        for colour, (owner, curves) in zip(OWNERS, shown.items(), strict=False):
            if name in curves:
                plot_curve(curves[name], ax, colour=colour, label=owner, quantity=quantity)
        which, _, more = found.meanings.get(name, "").partition(", between impacts")
        label = words.format("absolute, between impacts" if more else which)
        ax.set_ylabel(f"{label}\n({quantity})")
        ax.grid(alpha=0.25)
    if len(shown) > 1:
        axes[0].legend(frameon=False, fontsize="small", loc="lower left")
    if transfer is not None:
        _draw_transfer(transfer, axes[-1])
    axes[-1].set_xlabel("frequency (Hz)")
    figure.suptitle(f"{title}\n{TITLE}" if title else TITLE, fontsize="medium")
    first: Axes = axes[0]
    return first


def _draw_transfer(transfer: Mapping[str, Curve], ax: Axes) -> None:
    """Transmissibilities, and the coherence on a linear axis at the right."""
    for name, label in TRANSFER_NAMES.items():
        plot_curve(transfer[name], ax, colour=TRANSFERS[name], label=label)
    values = np.concatenate([transfer[name].value for name in TRANSFER_NAMES])
    ax.set_ylim(0.5 * max(values.min(), 1e-3 * values.max()), 4.0 * values.max())
    ax.set_ylabel("transmissibility")
    ax.grid(alpha=0.25)
    right = ax.twinx()
    plot_curve(
        transfer["coherence"], right, colour=TRANSFERS["coherence"], label="coherence, right axis"
    )
    right.set_yscale("linear")
    right.set_ylim(0.0, 1.25)  # the legend stands above 1
    right.set_yticks(np.linspace(0.0, 1.0, 6))
    right.set_ylabel("coherence", color=TRANSFERS["coherence"])
    right.tick_params(axis="y", colors=TRANSFERS["coherence"])
    lines = [*ax.get_lines(), *right.get_lines()]
    ax.legend(handles=lines, frameon=False, fontsize="small", ncols=3, loc="upper left")
