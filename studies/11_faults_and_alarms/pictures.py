"""The two tables of this study as one figure."""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

ALARM, POINTS, REST = "#d55e00", "#0072b2", "#8a8f98"


def draw(faults: pd.DataFrame | None, alarms: pd.DataFrame | None, z: float, path: Path) -> None:
    """How clearly each fault is seen; the largest score of every run with nothing wrong."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(10.4, 4.2), layout="constrained")
    if faults is not None:
        at = np.arange(len(faults))
        left.barh(at, faults["clearest_z"].abs(), color=POINTS, height=0.6)
        for place, row in zip(at, faults.itertuples(), strict=True):
            left.text(1.2, place, f"{row.caught} of {row.seeds}", va="center", color="white")
        left.set_yticks(at, faults["fault"])
        left.invert_yaxis()
        left.set_xscale("log")
        left.axvline(z, color=ALARM, linestyle="--")
        left.set_xlim(1.0, 60.0)
        left.set_xlabel("score of the clearest alarm (37 is the reporting limit)")
        left.set_title("faults put in, and how often caught")
    if alarms is not None:
        scores = np.sort(alarms["largest_score"].to_numpy())
        right.semilogy(
            scores, 1.0 - (np.arange(len(scores)) + 0.5) / len(scores), ".", color=POINTS
        )
        right.axvline(z, color=ALARM, linestyle="--")
        right.axhline(0.003, color=REST, linewidth=1.0)
        right.text(scores[0], 0.0033, "0.3 %, alarm rate of the family", color=REST)
        right.set_xlabel("largest score of a run")
        right.set_ylabel("share of runs above it")
        right.set_title(f"{len(scores)} short runs with nothing wrong")
    figure.savefig(path, dpi=130)
