"""Probabilities of sharp impacts on rubber stops, on every shipped profile."""

import argparse
import math
import time
from pathlib import Path

import pandas as pd

import stochvi
from stochvi.scenes.datasets import profiles

MISSION = 3600.0  # s
GAP = 4.0  # clearance per side, rms displacements without stops
WANTED = 1e-4  # probability of the limit, as if the first contact were a free mass's
STIFFNESS_RATIO, DAMPING_RATIO = 100.0, 0.2  # of the rubber, over the spring of the mount
BELOW = 15.0  # Hz; a table that starts above it is given the stiffer mount
FREQUENCIES = (12.0, 40.0)  # Hz, of the mounts, zeta = 0.1


def mounted(profile: str) -> tuple[stochvi.Scene, float]:
    """A mount within the table between rubber stops, and the limit, m/s^2."""
    noise = stochvi.TabulatedNoise(profile=profile)
    frequency = FREQUENCIES[profiles()[profile].frequency_hz[0] > BELOW]
    mount = stochvi.Isolator(mass=1.0, frequency_hz=frequency, zeta=0.1)
    linear = stochvi.screen(stochvi.Scene(structure=mount, excitations=[noise]))
    stiffness = (2.0 * math.pi * frequency) ** 2
    rubber = stochvi.Viscoelastic(
        stiffness=STIFFNESS_RATIO * stiffness, damping_ratio=DAMPING_RATIO
    )
    stops = stochvi.ImpactPair(clearance=GAP * linear.displacement_std, law=rubber)
    scene = stochvi.Scene(structure=mount, impact_pairs=[stops], excitations=[noise])
    # Rice: impacts faster than w come at the rate of all impacts times exp(-w^2 / (2 sigma_v^2))
    hits = MISSION * linear.rice_rate(GAP * linear.displacement_std)
    speed = linear.velocity_std * math.sqrt(2.0 * math.log(hits / WANTED))
    return scene, rubber.impact(speed, 1.0).peak_force


parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--quick", action="store_true", help="one profile")
parser.add_argument("--out", type=Path, default=Path(__file__).parent)
options = parser.parse_args()
rows = []
for name in list(profiles())[: 1 if options.quick else None]:
    scene, limit = mounted(name)
    began, wall = time.process_time(), time.perf_counter()
    found = stochvi.reliability(
        scene, mission=MISSION, peak_acceleration=limit, rel_error=0.1, seed=12, budget=120.0
    )
    chance = found.chances["peak_acceleration"]
    rows.append(
        {
            "profile": name, "frequency_hz": scene.structure.frequency_hz,
            "clearance_m": scene.impact_pairs[0].upper, "limit_g": limit / 9.80665,
            "probability": chance.estimate.value, "standard_error": chance.estimate.standard_error,
            "lower": chance.lower, "upper": chance.upper, "way": chance.way,
            "cpu_seconds": time.process_time() - began, "seconds": time.perf_counter() - wall,
        }
    )  # fmt: skip
    print(rows[-1], flush=True)
    pd.DataFrame(rows).to_csv(options.out / "profiles.csv", index=False)
