"""Hard cases: does every scene at the edge end with an answer that meets its balances, and when?"""

import argparse
import time
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from cases import CASES, NO_STATE, oscillator

import stochvi
from stochvi.methods.monte_carlo import record_path

THRESHOLDS = np.geomspace(0.2, 0.002, 9)  # m/s, of some 0.65 m/s rms


def row(name: str, scene: stochvi.Scene, rel_error: float, budget: float) -> dict:
    start, verdict, response = time.perf_counter(), "answered", None
    try:
        response = stochvi.simulate(scene, rel_error=rel_error, seed=1, budget=budget)
    except stochvi.NotConverged as error:
        verdict, response = f"not converged: {error}", error.partial
    except stochvi.StochviError as error:
        verdict = f"refused: {error}"
    found = {"case": name, "seconds": round(time.perf_counter() - start, 2)}
    if response is None:
        return found | {"verdict": verdict}
    off, unmet = {}, []
    for balance, residual in response.identities.items():
        off[balance] = abs(residual.value) / residual.standard_error
        if abs(residual.value) > 4.5 * residual.standard_error + residual.bias:
            unmet.append(balance)
    worst = max(off, key=off.get)
    first = next(iter(response.coordinates.values()))
    rates = [pair["collision_rate"] for pair in response.impact_pairs.values()]
    return found | {
        "seconds": round(response.cost.wall_time, 2),
        "displacement_std_m": repr(first["displacement_std"]).split(" ")[0],
        "velocity_std_m_per_s": repr(first["velocity_std"]).split(" ")[0],
        "rates_per_s": " ".join(repr(rate).split(" ")[0] for rate in rates),
        "upper_95_per_s": max((rate.upper_95 or 0.0 for rate in rates), default=0.0),
        "balances": len(off),
        "worst_balance": worst,
        "standard_errors_off": round(off[worst], 1),
        "verdict": f"balances unmet: {unmet}" if unmet else verdict,
    }


def counted(restitution: float, step: float, paths: int) -> pd.DataFrame:
    """Rates of impacts above each threshold, from paths of 120 s less the first 20 s."""
    scene, rates = oscillator(-1.0, 1.0, restitution), []
    for path in range(paths):
        record = record_path(scene, duration=120.0, step=step, seed=2, path=path)
        speed = record["impact_speed"].abs().to_numpy()[record["time"].to_numpy() > 20.0]
        rates.append([np.count_nonzero(speed > threshold) / 100.0 for threshold in THRESHOLDS])
    columns = {"restitution": restitution, "step_s": step, "threshold_m_per_s": THRESHOLDS}
    error = np.std(rates, axis=0, ddof=1) / np.sqrt(paths)
    return pd.DataFrame(columns | {"rate_per_s": np.mean(rates, axis=0), "standard_error": error})


parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--quick", action="store_true", help="larger errors, fewer cases")
parser.add_argument("--out", type=Path, default=Path(__file__).parent)
options = parser.parse_args()
names = list({**CASES, **NO_STATE})[:: 4 if options.quick else 1]
every = [row(n, {**CASES, **NO_STATE}[n], *((0.1, 5.0) if options.quick else (0.05, 60.0)))
         for n in names]  # fmt: skip
pd.DataFrame(every).to_csv(options.out / "result.csv", index=False)
RUNS = [(0.0, 1e-2), (0.0, 1e-3), (0.0, 1e-4), (0.1, 1e-4), (0.163, 1e-4), (0.3, 1e-4)]
runs = RUNS[:2] if options.quick else RUNS
curves = pd.concat([counted(*run, paths=8 if options.quick else 64) for run in runs])
curves.to_csv(options.out / "collapse.csv", index=False)
figure, ax = plt.subplots(figsize=(6.4, 4.4), layout="constrained")
for (restitution, step), part in curves.groupby(["restitution", "step_s"]):
    x, y, error = (part[k] for k in ("threshold_m_per_s", "rate_per_s", "standard_error"))
    ax.errorbar(x, y, 2.0 * error, fmt="o-", label=f"R = {restitution:g}, step {step:g} s")
ax.set(xscale="log", yscale="log", xlabel="threshold, m/s", ylabel="impacts above it, 1/s")
ax.plot(THRESHOLDS, 0.35 * (THRESHOLDS / 0.01) ** -0.5, "k:", label="slope -1/2")
ax.legend(frameon=False)
figure.savefig(options.out / "figure.png", dpi=130)
