"""Do 95 % intervals hold the truth 95 times in a hundred? Ten thousand small answers of each."""

import argparse
import time
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from cases import P_AT_3, P_AT_4, counted, simulated, split
from statsmodels.stats.proportion import proportion_confint

from stochvi.views.files import write_picture

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--quick", action="store_true", help="200 answers of each kind")
parser.add_argument("--out", type=Path, default=Path(__file__).parent)
options = parser.parse_args()
answers = 200 if options.quick else 10_000
started, rows = time.process_time(), []
for kinds in (
    simulated(answers, 8),
    simulated(answers, 64),
    counted(answers, 3.0, P_AT_3, 200),
    counted(answers, 4.0, P_AT_4, 1000),
    split(answers, 20, 64),
):
    for kind, what, size, number, covered in kinds:
        lower, upper = proportion_confint(covered, number, method="wilson")
        rows.append(
            {"interval": kind, "of": what, "size": size, "answers": number,
             "coverage": covered / number, "lower": lower, "upper": upper}
        )  # fmt: skip
    table = pd.DataFrame(rows)
    table.to_csv(options.out / "result.csv", index=False)
print(table.to_string(), f"\n{time.process_time() - started:.0f} s of CPU")
names = (
    table["interval"] + ": " + table["of"].str.replace("_", " ") + ", " + table["size"].astype(str)
)
figure, ax = plt.subplots(figsize=(8.0, 7.6), layout="constrained")
places = np.arange(len(table))[::-1]
spread = np.abs(table[["lower", "upper"]].to_numpy().T - table["coverage"].to_numpy())
ax.errorbar(100.0 * table["coverage"], places, xerr=100.0 * spread, fmt="o", markersize=4)
ax.axvspan(94.0, 96.0, color="#e3e6ea", zorder=0)
ax.set_yticks(places, names, fontsize="small")
ax.set_xlabel("truth inside a 95 % interval (% of the answers; bars: 95 %)")
write_picture(ax, options.out / "figure.png")
