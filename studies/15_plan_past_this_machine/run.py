"""What 10^12 steps take on 1 to 10^4 cores, and what a thousand bad workers do to the merge."""

import argparse
import time
from pathlib import Path

import matplotlib.pyplot as plt
import pandas as pd
from cluster import Cluster, block_costs, plan_for

import stochvi
from stochvi.sampling.workers import SENDING_SECONDS
from stochvi.views.files import write_picture

PRICE = 0.04
"""Of a core hour, a round figure: put that of your cluster here."""

LONG_BLOCK = 2.0
"""Seconds of a block in a study of a week, of paths of some 10^7 steps."""

CLUSTERS = ((0.0, 0.0), (0.01, 0.0), (0.01, 0.001), (0.1, 0.01))
"""Share of tasks that take ten times as long, and of those that are lost."""

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--quick", action="store_true", help="fewer blocks")
parser.add_argument("--out", type=Path, default=Path(__file__).parent)
options = parser.parse_args()
stops = stochvi.ImpactPair(lower=-1.0, upper=1.0, law=stochvi.Restitution(coefficient=0.8))
scene = stochvi.Scene(
    structure=stochvi.Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
    impact_pairs=[stops],
    excitations=[stochvi.WhiteNoise(intensity=0.2)],
)
number = 10_000 if options.quick else 100_000

# the digits do not show who did the work, nor what was lost and done again
small = {"paths": 40 * 1024, "duration": 20.0, "seed": 1}
bad = Cluster(7, block_seconds=0.1, sending=0.0, late=0.1, lost=0.5, real=True)
there = stochvi.simulate(scene, executor=bad, threads=7, **small)
assert there.to_frame().equals(stochvi.simulate(scene, **small).to_frame()) and bad.again > 0

costs = [block_costs(scene, duration, number) for duration in (400.0, 4000.0)]
plans = pd.DataFrame([plan_for(c, 1e12, n) for c in costs for n in (1, 100, 10_000)])
plans["price"] = plans["cores"] * plans["wall_s"] / 3600.0 * PRICE

rows = []
for late, lost in CLUSTERS:
    cluster = Cluster(1000, block_seconds=LONG_BLOCK, sending=SENDING_SECONDS, late=late, lost=lost)
    start = time.process_time()
    stochvi.simulate(
        scene, paths=1024 * number, duration=400.0, budget=None, executor=cluster,
        threads=1000,
    )  # fmt: skip
    rows.append({
        "late": late, "lost": lost, "tasks": cluster.tasks,
        "begun_again": cluster.again, "most_blocks_waiting": cluster.most_open_blocks,
        "cpu_here_s": time.process_time() - start, "work_s": number * LONG_BLOCK / 1000,
        "wall_s": cluster.now,
    })  # fmt: skip
clusters = pd.DataFrame(rows)
clusters["busy"] = clusters["work_s"] / clusters["wall_s"]
print(plans.to_string(), clusters.to_string(), sep="\n")
parts = [plans.assign(part="plan"), clusters.assign(part="cluster")]
pd.concat(parts).to_csv(options.out / "result.csv", index=False)

figure, (left, right) = plt.subplots(1, 2, figsize=(9.6, 4.0), layout="constrained")
for (duration, group), style in zip(plans.groupby("duration"), ("o--", "o-"), strict=True):
    for name, colour in (("work", "#30607a"), ("sending", "#c26a3d"), ("merging", "#7a7a30")):
        times = group.loc[group[f"{name}_s"] > 0.0]
        label = f"{name}, paths of {duration:.0f} s"
        left.loglog(times["cores"], times[f"{name}_s"], style, color=colour, label=label)
left.set(xlabel="cores", ylabel="seconds for 10^12 steps")
left.legend(frameon=False, fontsize="small")
names = [f"{100 * r.late:g} % late,\n{100 * r.lost:g} % lost" for r in clusters.itertuples()]
right.barh(names, 100.0 * clusters["busy"], color="#30607a")
right.set(xlabel="work in the time of 1,000 workers (%)", xlim=(0, 100))
right.invert_yaxis()
write_picture(right, options.out / "figure.png")
