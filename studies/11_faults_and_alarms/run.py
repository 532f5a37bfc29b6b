"""Faults put in on purpose, and who raises the alarm; false alarms where nothing is wrong."""

import argparse
import csv
from pathlib import Path

import pandas as pd
from faults import injected, truth
from pictures import draw
from statsmodels.stats.proportion import proportion_confint

import stochvi
from stochvi.results.estimates import normal_quantile
from stochvi.verification.check import MethodResponses, compare_many, seeds_of, single_alarm_rate

SHORT = ("linear", "elastic-unequal-gaps", "lossy-unequal-gaps", "spring-stops", "psd-truck-linear")
PATHS = 64


def false_alarms(seeds: int, file: Path) -> pd.DataFrame:
    """Short runs with nothing wrong; every seed is written as it is done."""
    scenes = stochvi.verification.zoo(*SHORT)
    known = {name: truth(name) for name in scenes}
    times = {name: 10.0 if "isolator" in scene.structure.kind else 200.0
             for name, scene in scenes.items()}  # fmt: skip
    with file.open("w", newline="", encoding="utf-8") as table:
        rows = csv.writer(table, lineterminator="\n")
        rows.writerow(["seed", "comparisons", "alarms", "largest_score"])
        for seed in range(seeds):
            own = dict(zip(scenes, seeds_of(seed, len(scenes)), strict=True))
            found = compare_many({
                name: MethodResponses(responses=[known[name], stochvi.simulate(
                    scene, paths=PATHS, duration=times[name], seed=own[name], threads=1)])
                for name, scene in scenes.items()
            })  # fmt: skip
            largest = max(
                abs(row.score or 0.0)
                for each in found.checks.values()
                for row in each.comparisons
                if row.verdict in ("agrees", "DISAGREES")
            )
            rows.writerow([seed, found.judged, len(found.alarms), f"{largest:.4f}"])
            table.flush()
    return pd.read_csv(file)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="few seeds")
    parser.add_argument("--out", type=Path, default=Path(__file__).parent)
    options = parser.parse_args()
    faults = injected(2 if options.quick else 20, 0.005)
    faults.to_csv(options.out / "result.csv", index=False, float_format="%.4g")
    print(faults.to_string())
    alarms = false_alarms(10 if options.quick else 1000, options.out / "alarms.csv")
    seen, count = int((alarms["alarms"] > 0).sum()), len(alarms)
    most = proportion_confint(seen, count, 0.1, "beta")[1]
    print(f"{seen} of {count} seeds: at most {most:.2%}")
    z = normal_quantile(single_alarm_rate(int(alarms["comparisons"].iloc[0])))
    draw(faults, alarms, z, options.out / "figure.png")
