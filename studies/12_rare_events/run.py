"""Probabilities of 1e-3, 1e-6 and 1e-9 in ten periods: splitting, crude counting, Fokker-Planck."""

import argparse
import math
from pathlib import Path

import matplotlib.pyplot as plt
import pandas as pd

import stochvi
from stochvi.methods.fokker_planck import fokker_planck_density
from stochvi.statistics import Chance
from stochvi.views.files import write_picture

MISSION = 20.0 * math.pi
OSCILLATOR = stochvi.Oscillator(mass=1.0, damping=0.1, stiffness=1.0)
NOISE = stochvi.WhiteNoise(intensity=0.2)
BARRIERS = {3: 4.25, 6: 5.645, 9: 6.75}  # in standard deviations: P is about 1e-3, 1e-6, 1e-9
SPEEDS = {1.0: {3: 4.0, 6: 5.5, 9: 6.6}, 0.8: {3: 2.7}}  # likewise, m/s by restitution
FREE = stochvi.Scene(structure=OSCILLATOR, excitations=[NOISE])


def passage(barrier: float, rtol: float) -> float:
    """P(abs(x) passes a barrier) from rest, without sampling."""
    known = stochvi.first_passage(FREE, -barrier, barrier, times=[MISSION], rtol=rtol)
    return known.probability[0].value


def between(restitution: float) -> stochvi.Scene:
    """The oscillator between stops at one standard deviation."""
    law = stochvi.Restitution(coefficient=restitution)
    pair = stochvi.ImpactPair(lower=-1.0, upper=1.0, law=law)
    return stochvi.Scene(structure=OSCILLATOR, excitations=[NOISE], impact_pairs=[pair])


def row(case: str, limit: float, chance: Chance, truth: float | None) -> dict[str, object]:
    """One probability by one way, and its price in CPU seconds; that of crude at the same error."""
    found, price = chance.estimate, chance.seconds_per_mission or 0.0
    return {
        "case": case, "limit": limit, "way": chance.way, "probability": found.value,
        "standard_error": found.standard_error, "lower": chance.lower, "upper": chance.upper,
        "bias": found.bias, "truth": truth,
        "z": None if truth is None else (found.value - truth) / found.standard_error,
        "levels": chance.levels, "trials": chance.trials, "seconds": chance.seconds,
        "crude_seconds": chance.crude_seconds, "microseconds_per_mission": 1e6 * price,
        "ratio": (chance.crude_seconds or 0.0) / chance.seconds,
    }  # fmt: skip


parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--quick", action="store_true", help="two barriers, coarser truth")
parser.add_argument("--out", type=Path, default=Path(__file__).parent)
options = parser.parse_args()
rtol, rows = 1e-2 if options.quick else 1e-4, []
ask = {"mission": MISSION, "start": "rest", "seed": 12, "threads": 1, "budget": 600.0}
for power in (3, 6) if options.quick else (3, 6, 9):
    truth = passage(BARRIERS[power], rtol)
    for way in ("splitting", "crude") if power == 3 else ("splitting",):
        found = stochvi.reliability(FREE, barrier=BARRIERS[power], way=way, **ask)
        rows.append(row("abs(x) passes", BARRIERS[power], found.chances["passage"], truth))
        for restitution, speeds in {} if options.quick else SPEEDS.items():
            if power in speeds:
                speed, scene = speeds[power], between(restitution)
                found = stochvi.reliability(scene, impact_speed=speed, way=way, **ask)
                chance = found.chances["impact_speed"]
                rows.append(row(f"impact speed, R = {restitution}", speed, chance, None))
                fast = fokker_planck_density(scene).rate_above("upper", speed)
                rows[-1]["at_most"] = 2.0 * MISSION * float(fast)
        pd.DataFrame(rows).to_csv(options.out / "result.csv", index=False)
table = pd.DataFrame(rows)
figure, ax = plt.subplots(figsize=(7.2, 4.6), layout="constrained")
for case, group in table[table["way"] == "splitting"].groupby("case", sort=False):
    (line,) = ax.plot(group["probability"], group["seconds"], "o-", label=f"splitting: {case}")
    ax.plot(group["probability"], group["crude_seconds"], "--", color=line.get_color())
for seconds, name in ((60.0, "a minute"), (86400.0, "a day"), (3.2e7, "a year")):
    ax.axhline(seconds, color="#d0d3d8", linewidth=0.8, zorder=0)
    ax.annotate(name, (1.0, seconds), xycoords=("axes fraction", "data"), ha="right", va="bottom")
ax.plot([], [], "--", color="#8a8f98", label="crude, priced from its measured missions")
ax.set(xscale="log", yscale="log", xlabel="P in ten periods, from rest", xlim=(5e-3, 2e-10))
ax.set_ylabel("CPU seconds for a relative error of some 5 %")
ax.legend(edgecolor="none", framealpha=1.0, fontsize="small")
write_picture(ax, options.out / "figure.png")
