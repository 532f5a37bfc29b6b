"""Inelastic stops: solver, Monte Carlo and averaging, R = 0 to 1; exponent of the corner."""

import argparse
from pathlib import Path

import numpy as np
import pandas as pd
from corner import impact_speeds
from pictures import figure_of
from scipy.optimize import brentq

import stochvi as sv
from stochvi.mathematics.impact_rates import corner_exponent

QUANTITIES = ("displacement_std", "velocity_std", "impact_speed_rate", "impact_speed_square_rate")
SLOW, FAST, RUNS = 1e-3, 2e-2, 16  # m/s, where beta is measured, and runs for its standard error


def scene(restitution: float, damping: float) -> sv.Scene:
    """omega = 1, stops at +-1, theta = 1."""
    mount = sv.Oscillator(mass=1.0, damping=damping, stiffness=1.0)
    pair = sv.ImpactPair(lower=-1.0, upper=1.0, law=sv.Restitution(coefficient=restitution))
    noise = [sv.WhiteNoise(intensity=2.0 * damping)]
    return sv.Scene(structure=mount, impact_pairs=[pair], excitations=noise)


def moments(restitution: float, damping: float, rel_error: float) -> list[dict]:
    case = scene(restitution, damping)
    found = {"solver": sv.fokker_planck_density(case, rtol=1e-5).response}
    found["Monte Carlo"] = sv.simulate(case, rel_error=rel_error, seed=1, budget=None)
    for variant in ("finite jumps", "continuous", "unfolded"):
        found[variant] = sv.average(case, variant=variant)
    rows = []
    for method, response in found.items():
        values = {name: estimate for (_, name), estimate in response.estimates().items()}
        rows += [{"restitution": restitution, "damping": damping, "method": method, "quantity": q,
                  "value": values[q].value, "standard_error": values[q].standard_error,
                  "bias": values[q].bias} for q in QUANTITIES]  # fmt: skip
    return rows


def fitted(mean_log: float) -> float:
    """beta of a density w^(1 - beta) from SLOW to FAST with this mean of log w."""
    low, high = np.log(SLOW), np.log(FAST)

    def off(s: float) -> float:
        return high + (high - low) / np.expm1(s * (high - low)) - 1.0 / s - mean_log

    return 2.0 - brentq(off, -6.0, 6.0 + 1e-6)


def exponents(restitution: float, duration: float) -> dict:
    """beta by the formula, from the solver, and from paths, in the same window."""
    density = sv.fokker_planck_density(scene(restitution, 0.1), rtol=1e-6)
    w = np.geomspace(SLOW, FAST, 201)
    weight = w * density.impact_flux("upper", w)
    solver = fitted(np.trapezoid(weight * np.log(w), np.log(w)) / np.trapezoid(weight, np.log(w)))
    logs = [np.log(impact_speeds(restitution, 0.1, 0.2, 0.05, duration, 50.0, seed))
            for seed in range(RUNS)]  # fmt: skip
    logs = [part[(part > np.log(SLOW)) & (part < np.log(FAST))] for part in logs]
    whole = fitted(np.concatenate(logs).mean())
    left_out = [fitted(np.concatenate(logs[:k] + logs[k + 1 :]).mean()) for k in range(RUNS)]
    return {"restitution": restitution, "formula": corner_exponent(restitution), "solver": solver,
            "monte_carlo": whole, "standard_error": np.sqrt(RUNS - 1.0) * np.std(left_out),
            "impacts": sum(map(len, logs))}  # fmt: skip


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="fewer cases, larger errors")
    parser.add_argument("--out", type=Path, default=Path(__file__).parent)
    options = parser.parse_args()
    grid = (0.0, 0.5, 1.0) if options.quick else (0.0, 0.1, 0.2, 0.35, 0.5, 0.65, 0.8, 0.9, 1.0)
    error, duration = (0.02, 2e3) if options.quick else (0.003, 4e4)
    table = pd.DataFrame([row for b in (0.1, 0.01) for r in grid for row in moments(r, b, error)])
    table.to_csv(options.out / "result.csv", index=False)
    corners = (0.3, 0.5) if options.quick else (0.1, 0.2, 0.3, 0.4, 0.5, 0.65, 0.8)
    slopes = pd.DataFrame([exponents(r, duration) for r in corners])
    slopes.to_csv(options.out / "exponent.csv", index=False)
    figure_of(table, slopes, scene(0.5, 0.1)).savefig(options.out / "figure.png", dpi=150)
