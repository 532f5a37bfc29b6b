"""What a clearance report says of accelerations, where the stops have a stiffness."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pandas as pd

from stochvi.isolators.sizing.clatter import clatter
from stochvi.results.errors import NotApplicable
from stochvi.results.intervals import GAUSSIAN_95
from stochvi.views.report.pages import Grid, Section, shown
from stochvi.views.report.plots import plot_peaks
from stochvi.views.report.words import MM, G, four_digits

if TYPE_CHECKING:
    from stochvi.isolators.sizing.answer import Sizing

WINDOW = 18.0
"""Seconds of which the largest acceleration is taken: some hundred cycles of a usual mount."""

STIFFNESS_RATIOS = (10.0, 100.0, 1000.0)
"""Of stop and mount, for the picture: soft rubber, hard rubber, metal."""

MULTIPLES = (2.0, 2.5, 3.0, 3.5, 4.0, 5.0)
"""Clearances of the picture, in sigma."""

PEAK_ERROR, PEAK_SECONDS = 0.05, 3.0
"""Relative standard error of a peak, and the seconds that it may take."""


def peaks_of(sizing: Sizing, *, seed: int = 0) -> pd.DataFrame | None:
    """`clatter` at 3 sigma and as recommended, then for other stiffnesses where that means
    something; None where it does not apply, as for stops with a restitution alone."""
    places = [sizing.three_sigma.clearance, sizing.clearance.value]
    try:
        own = clatter(
            sizing.scene, places, window=WINDOW, rel_error=PEAK_ERROR, budget=PEAK_SECONDS,
            seed=seed,
        )  # fmt: skip
    except NotApplicable:
        return None
    try:
        others = clatter(
            sizing.scene,
            [multiple * sizing.sigma for multiple in MULTIPLES],
            stiffness_ratios=STIFFNESS_RATIOS,
            window=WINDOW,
            rel_error=PEAK_ERROR,
            budget=PEAK_SECONDS,
            seed=seed,
        )
    except NotApplicable:
        return own
    return pd.concat([own, others], ignore_index=True)


def peaks_section(table: pd.DataFrame | None) -> Section:
    """The table of `peaks_of`, and its picture; empty without one."""
    title = "Peak accelerations"
    if table is None:
        return Section(title=title)
    own = table[table["stiffness_ratio"].isna()]
    half = GAUSSIAN_95 * G
    rows = [
        [
            name,
            four_digits(MM * row["clearance"]),
            f"{G * row['acceleration_rms']:.4g}\n± {half * row['acceleration_rms_error']:.1g}",
            f"{row['rms_amplification']:.3f}",
            f"{G * row['largest_acceleration']:.3g}\n"
            f"± {half * row['largest_acceleration_error']:.1g}",
            f"{row['peak_amplification']:.3g}",
        ]
        for name, row in zip(("3 sigma", "recommended"), own.to_dict("records"), strict=True)
    ]
    grid = Grid(
        caption=f"Absolute acceleration with the forces of the stops; the largest of {WINDOW:g} s, "
        "its mean",
        headings=[
            "stops at",
            "clearance (mm)",
            "g rms",
            "times that without stops",
            "largest (g)",
            "times that without stops",
        ],
        rows=rows,
    )
    pictures = []
    if table["stiffness_ratio"].notna().any():
        pictures = [
            shown(
                plot_peaks(table, WINDOW),
                "Mean largest acceleration against clearance, for stops that many times as stiff "
                "as the mount; the stops of the scene as diamonds.",
            )
        ]
    return Section(
        title=title,
        lead="What an rms value hides: a few hits change it little, and multiply the peak.",
        grids=[grid],
        pictures=pictures,
    )
