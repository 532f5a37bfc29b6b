"""A loose mass in a box that moves as cos t: its impacts and its motion, for all plays and R.

Run as `python shaken_box.py`; the table goes to data/absorber_box/shaken_box.csv.
"""

import math
from pathlib import Path

import numba
import numpy as np
import pandas as pd

PLAYS = np.geomspace(0.08, 60.0, 36)
"""Total plays, in amplitudes of the box."""

RESTITUTIONS = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.98)
STEPS = 240
"""Of a period."""

PERIODS = 200
SETTLING = 60
STARTS = 8
MOST_IMPACTS = 40
"""Largest number of impacts in a step, after which the mass is laid on the stop."""


@numba.njit(cache=True)
def averages(play: float, restitution: float, starts: np.ndarray) -> np.ndarray:
    """Sums of |w| and w^2 of impacts per unit time; means of v^2, x^2, y'^2 and y^2, where x is the
    place of the mass, v = x' and y = x - cos t."""
    h, wall = 2.0 * math.pi / STEPS, play / 2.0
    sums = np.zeros(6)
    for phase, place, v in starts:
        t = 2.0 * math.pi * phase
        x = math.cos(t) + (2.0 * place - 1.0) * wall
        for step in range(PERIODS * STEPS):
            counted = step >= SETTLING * STEPS
            left, y = h, x - math.cos(t)
            for impact in range(MOST_IMPACTS):
                onwards = x + v * left - math.cos(t + left)
                if abs(onwards) <= wall:
                    break
                side = math.copysign(1.0, onwards)
                part = min(max((side * wall - y) / (onwards - y), 0.0), 1.0)
                t += part * left
                left -= part * left
                x, y = math.cos(t) + side * wall, side * wall
                w = v + math.sin(t)
                if side * w <= 0.0 or impact == MOST_IMPACTS - 1:
                    # no impact but a wall that pushes: the mass goes with it for this step
                    v = -math.sin(t)
                    x += math.cos(t + left) - math.cos(t) - v * left
                    break
                v -= (1.0 + restitution) * w
                if counted:
                    sums[0] += abs(w)
                    sums[1] += w * w
            x += v * left
            t = (t + left) % (2.0 * math.pi)
            if counted:
                sums[2] += v * v * h
                sums[3] += x * x * h
                sums[4] += (v + math.sin(t)) ** 2 * h
                sums[5] += (x - math.cos(t)) ** 2 * h
    return sums / (len(starts) * (PERIODS - SETTLING) * 2.0 * math.pi)


if __name__ == "__main__":
    random = np.random.default_rng(1)
    starts = np.column_stack([random.random((STARTS, 2)), 2.0 * random.standard_normal(STARTS)])
    rows = []
    for restitution in RESTITUTIONS:
        for play in PLAYS:
            rows.append([restitution, play, *averages(play, restitution, starts)])
    names = [
        "restitution",
        "play",
        "speed_rate",
        "speed_square_rate",
        "velocity_square",
        "displacement_square",
        "relative_velocity_square",
        "relative_displacement_square",
    ]
    file = Path(__file__).parents[2] / "data" / "absorber_box" / "shaken_box.csv"
    pd.DataFrame(rows, columns=names).to_csv(file, index=False, float_format="%.5g")
