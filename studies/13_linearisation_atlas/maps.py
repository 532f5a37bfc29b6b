"""Maps of the errors of F1 and sigma_x: gap against zeta, one panel per form."""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.colors import BoundaryNorm
from matplotlib.figure import Figure

RESTITUTION = 0.8
PANELS = (
    ("closure", "two", "f1"), ("clumps", "two", "f1"), ("force", "two", "f1"),
    ("average", "two", "f1"), ("closure", "two", "sigma_x"), ("clumps", "two", "sigma_x"),
    ("closure-box", "two", "sigma_x"), ("clumps", "one", "f1"),
)  # fmt: skip
LEVELS = (-50, -20, -10, -5, -2, -1, 1, 2, 5, 10, 20, 50, 100)
WORDS = {"f1": "F1", "sigma_x": "sigma_x"}
STOPS = {"two": "stops at -gap and gap", "one": "one stop"}


def figure_of(folder: Path) -> Figure:
    """Relative errors in per cent at one restitution, as numbers on colours."""
    figure, axes = plt.subplots(2, 4, figsize=(15.0, 7.6), layout="constrained")
    norm = BoundaryNorm(LEVELS, 256, extend="both")
    for ax, (form, stops, quantity) in zip(axes.flat, PANELS, strict=True):
        d = pd.read_csv(folder / f"{form}.csv")
        d = d[(d["stops"] == stops) & (d["restitution"] == RESTITUTION)]
        errors = 100.0 * np.expm1(d.pivot(index="zeta", columns="gap", values=quantity))
        image = ax.imshow(errors, cmap="RdBu_r", norm=norm, origin="lower", aspect="auto")
        for row, zeta in enumerate(errors.index):
            for column, gap in enumerate(errors.columns):
                number = errors.loc[zeta, gap]
                strong = number > 20.0 or number < -20.0
                text = f"{number:.1f}" if abs(number) < 9.95 else f"{number:.0f}"
                text = "0.0" if text == "-0.0" else text
                ax.text(column, row, text, ha="center", va="center", fontsize=7,
                        color="white" if strong else "#222222")  # fmt: skip
        ax.set_xticks(
            range(len(errors.columns)), [f"{gap:g}" for gap in errors.columns], fontsize=8
        )
        ax.set_yticks(range(len(errors.index)), [f"{zeta:g}" for zeta in errors.index], fontsize=8)
        ax.set_title(f"{form}: {WORDS[quantity]}, {STOPS[stops]}", fontsize=10)
        ax.set_xlabel("gap / sigma without stops")
        ax.set_ylabel("zeta")
    figure.colorbar(image, ax=axes, label="error (%)", shrink=0.7, ticks=LEVELS)
    figure.suptitle(f"errors of linearisation and averaging in per cent, R = {RESTITUTION:g}")
    return figure
