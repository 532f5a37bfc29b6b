"""How wrong linearisation is everywhere, whether the bounds that it states hold, and its speed."""

import argparse
import time
from pathlib import Path

import numpy as np
import pandas as pd
from forms import ENERGY, FORMS, coverage, summary, write_atlas
from maps import figure_of

import stochvi as sv
from stochvi.scenes.datasets import data_folder

HERE, SHIPPED = Path(__file__).parent, data_folder() / "linearisation_atlas"


def speed(count: int) -> pd.DataFrame:
    """Oscillators linearised per second of processor time, three kinds of stops."""
    rng = np.random.default_rng(0)
    near, far = 10.0 ** rng.uniform(-0.7, 0.7, (2, count))
    one, two = rng.uniform(size=(2, count))
    zeta = 10.0 ** rng.uniform(-2.3, -0.3, count)
    kinds = {
        "symmetric": (-near, near, one, one),
        "one stop": (-np.inf, near, 1.0, one),
        "unlike": (-far, near, two, one),
    }
    rows = []
    for kind, (lower, upper, r_lower, r_upper) in kinds.items():
        started = time.process_time()
        found = sv.linearise_many(
            omega=1.0, damping_rate=2.0 * zeta, intensity=4.0 * zeta, lower=lower, upper=upper,
            restitution_lower=r_lower, restitution_upper=r_upper,
        )  # fmt: skip
        rate = count / (time.process_time() - started)
        rows.append({"what": "per second", "of": kind, "value": rate})
        rows.append({"what": "unanswered", "of": kind, "value": (~found.converged).sum()})
    return pd.DataFrame(rows)


def long(table: pd.DataFrame, what: str, columns: list[str]) -> pd.DataFrame:
    """One row per number."""
    label = table["form"] + " " + table["quantity"]
    parts = [pd.DataFrame({"what": f"{what} {c}", "of": label, "value": table[c]}) for c in columns]
    return pd.concat(parts)


parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--quick", action="store_true", help="every 20th scene, the closure alone")
parser.add_argument("--atlas", action="store_true", help="renew the shipped errors of the forms")
parser.add_argument("--energy", action="store_true", help="renew those of clumps and averaging")
parser.add_argument("--out", type=Path, default=HERE)
options = parser.parse_args()
for wanted, ways in ((options.atlas, FORMS), (options.energy, ENERGY)):
    if wanted:
        write_atlas(SHIPPED / "truth.csv", SHIPPED, ways)
ways = {"closure": FORMS["closure"]} if options.quick else FORMS
found = [speed(20_000 if options.quick else 200_000)]
found.append(long(summary(SHIPPED, [*FORMS, *ENERGY]), "target range", ["median", "largest"]))
for kind, name in (("like", "held_out.csv"), ("unlike", "held_out_asymmetric.csv")):
    held = [coverage(HERE / name, ways, every=20 if options.quick else 1)]
    if not options.quick:  # the law of the energy takes its time
        held.append(coverage(HERE / name, {"clumps": ENERGY["clumps"]}, every=5))
    held = pd.concat(held)
    for form, part in held.groupby("form", sort=False):
        total = (part["bounds"] * part["hold"]).sum() / part["bounds"].sum()
        scenes = part["scenes"].max()
        print(f"{form}, {kind} stops, {scenes} scenes: {100 * total:.2f} % of the bounds hold")
    found.append(long(held, f"{kind} stops, bounds:", ["bounds", "hold", "wider"]))
table = pd.concat(found)
table.to_csv(options.out / "result.csv", index=False, float_format="%.4g")
print(table[~table["what"].str.contains("bounds")].to_string(index=False))
figure_of(SHIPPED).savefig(options.out / "figure.png", dpi=110)
