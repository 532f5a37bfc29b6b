"""How wrong is the closure of a structure? Random structures against their simulations."""

import argparse
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from cases import random_structure

import stochvi as sv

TRUTH = Path(__file__).parents[2] / "data" / "linearisation_atlas" / "structures.csv"
QUANTITIES = {
    "displacement_std": "rms displacement", "velocity_std": "rms velocity",
    "collision_rate": "rate of impacts", "impact_speed_rate": "F1",
    "impact_speed_square_rate": "F2",
}  # fmt: skip


def simulated(numbers: range) -> pd.DataFrame:
    """The quantities of structures, simulated to 2 % of their mean squares and rates."""
    rows = []
    for number in numbers:
        found = sv.simulate(random_structure(number), rel_error=0.02, seed=1, budget=600.0)
        for (owner, quantity), each in found.estimates().items():
            known = each.value and each.standard_error and each.standard_error < 0.05 * each.value
            if owner[0] in "sp" and quantity in QUANTITIES and known:
                numbers_of = (each.value, each.standard_error, each.bias)
                rows.append((number, owner, quantity, *numbers_of))
    names = ["number", "owner", "quantity", "value", "standard_error", "bias"]
    return pd.DataFrame(rows, columns=names)


def errors(truth: pd.DataFrame) -> pd.DataFrame:
    """ln(closure / simulation) of all quantities, and the stated bound in the same measure."""
    rows = []
    for number, known in truth.groupby("number"):
        found = sv.linearise(random_structure(int(number))).estimates()
        for row in known.itertuples():
            each = found[row.owner, row.quantity]
            bound = None if each.bias is None else each.bias / each.value
            rows.append((*row[1:4], np.log(each.value / row.value), bound))
    names = ["number", "owner", "quantity", "error", "bound"]
    return pd.DataFrame(rows, columns=names)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="the first 10 structures alone")
    parser.add_argument("--truth", action="store_true", help="simulate again: an hour of one core")
    parser.add_argument("--out", type=Path, default=Path(__file__).parent, help="folder of results")
    asked = parser.parse_args()
    if asked.truth:
        simulated(range(10 if asked.quick else 400)).to_csv(
            asked.out / "structures.csv", index=False, float_format="%.6g"
        )
    truth = pd.read_csv(asked.out / "structures.csv" if asked.truth else TRUTH)
    found = errors(truth[truth["number"] < 10] if asked.quick else truth)
    sizes = found["error"].abs().groupby(found["quantity"])
    table = pd.DataFrame(
        {"count": sizes.size(), "median": sizes.median(), "90 %": sizes.quantile(0.9),
         "99 %": sizes.quantile(0.99), "largest": sizes.max()}
    ).loc[list(QUANTITIES)]  # fmt: skip
    table.to_csv(asked.out / "result.csv", float_format="%.4g")
    print(table.to_string())
    draw(found).savefig(asked.out / "figure.png", dpi=110)


def draw(found: pd.DataFrame) -> plt.Figure:
    figure, axes = plt.subplots(layout="constrained")
    for quantity, label in QUANTITIES.items():
        sizes = np.sort(found.loc[found["quantity"] == quantity, "error"].abs())
        axes.plot(sizes, 1.0 - np.arange(len(sizes)) / len(sizes), label=label)
    axes.set(
        xscale="log", yscale="log", xlim=(1e-3, None), xlabel="|ln(closure / simulation)|",
        ylabel="fraction of quantities with a larger error",
    )  # fmt: skip
    axes.legend()
    return figure


if __name__ == "__main__":
    main()
