"""Random absorbers, simulated and linearised: the error of the linearisation, as an atlas.

Run as `python atlas.py`; simulated rows are appended to simulated.csv, so that an interrupted run
goes on, and the errors go to data/absorber_box/atlas.csv.
"""

import csv
import math
from pathlib import Path

import cases
import numpy as np
import pandas as pd
from scipy.stats import qmc

from stochvi.methods.linearisation import loose_mass
from stochvi.model.model import model_of

POINTS, HELD_OUT = 64, 32
SURE = 2.0
"""Standard errors of the simulation that an error of the linearisation is enlarged by."""

QUANTITIES = {
    "displacement": ("structure", "displacement_std"),
    "velocity": ("structure", "velocity_std"),
    "loose_velocity": ("absorber", "velocity_std"),
    "relative_displacement": ("box", "relative_displacement_std"),
    "relative_velocity": ("box", "relative_velocity_std"),
    "f1": ("box", "impact_speed_rate"),
    "f2": ("box", "impact_speed_square_rate"),
}
HERE, DATA = Path(__file__).parent, Path(__file__).parents[2] / "data" / "absorber_box"


def cells(number: int, seed: int) -> list[dict]:
    """Scenes that fill the ranges evenly: logarithms of mass, play and damping, restitution."""
    found = []
    for point in qmc.Sobol(4, rng=np.random.default_rng(seed)).random(number).tolist():
        cell = dict(cases.BASIC)
        for place, (name, (low, high)) in zip(point, loose_mass.RANGES.items(), strict=False):
            cell[name] = round(math.exp(math.log(low) + place * math.log(high / low)), 6)
        found.append(cell | {"restitution": round(point[3], 4)})
    return found


def simulated(part: str, cell: dict) -> dict:
    """Every quantity with its error and bias."""
    response, seconds = cases.simulated(cell)
    found = {"part": part} | cell | {"cpu_seconds": round(seconds, 2)}
    for name, (owner, quantity) in QUANTITIES.items():
        each = (response.coordinates | response.impact_pairs)[owner][quantity]
        found |= {
            name: float(f"{each.value:.6g}"),
            f"{name}_error": float(f"{each.standard_error:.3g}"),
            f"{name}_bias": float(f"{each.bias:.3g}"),
        }
    return found


def compared(row: dict) -> dict:
    """Errors of the linearisation, enlarged by those of the simulation."""
    cell = {name: row[name] for name in cases.BASIC}
    box = loose_mass.box_of(model_of(cases.boxed(cell)))
    if box is None:
        return {}
    own = loose_mass.moments(box)
    found = {name: row[name] for name in ("part", "mass_ratio", "play_in_sigma", "zeta")}
    found |= {
        "restitution": row["restitution"],
        "gain": round(loose_mass.gain(box, own["velocity"]), 4),
    }
    for name in QUANTITIES:
        value = own[name] if name in ("f1", "f2") else math.sqrt(own[name])
        unsure = SURE * row[f"{name}_error"] + row[f"{name}_bias"]
        found[f"{name}_off"] = round((abs(row[name] - value) + unsure) / value, 4)
    return found


def covered(errors: pd.DataFrame) -> pd.DataFrame:
    """Of the scenes held out: shares within their stated bounds, and the bounds."""
    held_out = errors[errors["part"] == "held out"]
    rows = []
    for _, row in held_out.iterrows():
        cell = cases.BASIC | {name: row[name] for name in (*loose_mass.RANGES, "restitution")}
        box = loose_mass.box_of(model_of(cases.boxed(cell)))
        bounds = loose_mass.errors(box, loose_mass.moments(box)["velocity"])
        rows.append({name: (row[f"{name}_off"], bounds[name]) for name in QUANTITIES})
    return pd.DataFrame(
        {name: {"covered": np.mean([row[name][0] <= row[name][1] for row in rows]),
                "median error": np.median([row[name][0] for row in rows]),
                "median bound": np.median([row[name][1] for row in rows]),
                "largest bound": max(row[name][1] for row in rows)}
         for name in QUANTITIES}
    ).T  # fmt: skip


if __name__ == "__main__":
    file = HERE / "simulated.csv"
    parts = (("atlas", POINTS), ("held out", HELD_OUT))
    wanted = [(part, cell) for seed, (part, n) in enumerate(parts) for cell in cells(n, seed)]
    done = list(csv.DictReader(file.open(newline=""))) if file.exists() else []
    left = list(cases.missing([cell for _, cell in wanted], done))
    for part, cell in wanted:
        if cell in left:
            row = pd.DataFrame([simulated(part, cell)])
            row.to_csv(file, mode="a", header=not file.exists(), index=False)
    rows = [compared(row) for row in pd.read_csv(file).to_dict("records")]
    errors = pd.DataFrame([row for row in rows if row])
    errors.to_csv(DATA / "atlas.csv", index=False)
    print(covered(errors).round(3).to_string())
