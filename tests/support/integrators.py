"""A plain integrator of one oscillator, as a user of another language would write it, with faults
that can be put in, and the three files that it may write."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

MOMENTS = ("displacement_mean", "displacement_mean_square", "velocity_mean_square")
RATES = ("collision_rate", "impact_speed_rate", "impact_speed_square_rate")


@dataclass
class Fault:
    """What an integrator does wrong; as it stands, nothing."""

    noise: float = 1.0
    damping: float = 1.0
    impact_energy: float = 1.0
    exchanged: bool = False
    burn_in: float = 1.0


@dataclass
class Found:
    """Averages of each path, and its records at every `stride`-th step after the burn-in."""

    averages: dict[str, NDArray[np.float64]]
    duration: float
    times: list[float] = field(default_factory=list)
    records: list[tuple[NDArray[np.float64], NDArray[np.float64]]] = field(default_factory=list)


def integrate(
    document: dict[str, Any], h: float, seed: int = 0, fault: Fault | None = None, stride: int = 0
) -> Found:
    """Integrate the problem of a JSON document: damping and noise exactly, kicks of the spring
    around straight flights, overshoots of a stop mirrored."""
    wrong = fault or Fault()
    mass, load = document["mass"], document["constant_force"][0] / document["mass"]
    (noise,) = document["noises"]
    b, square = wrong.damping * document["damping"] / mass, document["stiffness"] / mass
    unit = 1.0 if noise["on"] == "base" else mass
    theta = wrong.noise * noise["intensity"] / unit**2 / (2.0 * b)
    stops = {stop["side"]: stop for stop in document["stops"]}
    ends = [stops.get(side, {}).get("position", math.inf) for side in ("lower", "upper")]
    ends[0] = ends[0] if "lower" in stops else -math.inf
    losses = [stops.get(side, {}).get("restitution", 1.0) for side in ("lower", "upper")]
    losses = [r * math.sqrt(wrong.impact_energy) for r in losses]
    losses = losses[::-1] if wrong.exchanged else losses
    rng, paths = np.random.default_rng(seed), document["paths"]
    x = np.full(paths, document["start"]["displacement"][0])
    v = np.zeros(paths)
    sums = np.zeros((6, paths))
    kept = math.exp(-b * h)
    kick = math.sqrt(theta * (1.0 - kept**2))
    first = round(wrong.burn_in * document["burn_in"] / h)
    steps = round(document["duration"] / h)
    found = Found({}, steps * h)
    for step in range(first + steps):
        v += 0.5 * h * (load - square * x)
        speed = np.zeros(paths)
        for half in range(2):
            x += 0.5 * h * v
            for end, side, r in zip(ends, (-1, 1), losses, strict=True):
                hit = side * (x - end) > 0.0
                if hit.any():
                    speed[hit] += np.abs(v[hit])
                    x[hit] = end - r * (x[hit] - end)
                    v[hit] *= -r
            if half == 0:
                v = kept * v + kick * rng.standard_normal(paths)
        v += 0.5 * h * (load - square * x)
        if step >= first:
            hits = speed > document["speed_threshold"]
            sums += x, x**2, v**2, hits / h, speed / h, speed**2 / h
            if stride and (step - first) % stride == 0:
                found.times.append(step * h)
                found.records.append((x.copy(), v.copy()))
    names = MOMENTS + (RATES if stops else ())
    found.averages = dict(zip(names, sums[: len(names)] / steps, strict=True))
    return found


def write_rows(path: Path, header: Sequence[str], rows: Iterable[Sequence[Any]]) -> Path:
    with path.open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file)
        table.writerow(header)
        table.writerows(rows)
    return path


def write_averages(path: Path, found: Found) -> Path:
    rows = zip(*(column.tolist() for column in found.averages.values()), strict=True)
    return write_rows(path, list(found.averages), rows)


def write_statistics(path: Path, found: Found) -> Path:
    """Statistics with the standard errors of the delta method."""
    rows = []
    mean, square, speed = (found.averages[name] for name in MOMENTS)
    deviation = math.sqrt(square.mean() - mean.mean() ** 2)
    rows.append(("displacement_mean", mean.mean(), _error(mean)))
    change = (square - 2.0 * mean.mean() * mean) / (2.0 * deviation)
    rows.append(("displacement_std", deviation, _error(change)))
    rms = math.sqrt(speed.mean())
    rows.append(("velocity_std", rms, _error(speed) / (2.0 * rms)))
    for name, column in found.averages.items():
        if name in RATES:
            rows.append((name, column.mean(), _error(column)))
    return write_rows(path, ("quantity", "value", "standard_error"), rows)


def write_records(path: Path, found: Found) -> Path:
    rows = [
        (number, time, float(x[number]), float(v[number]))
        for number in range(len(found.records[0][0]))
        for time, (x, v) in zip(found.times, found.records, strict=True)
    ]
    return write_rows(path, ("path", "time", "x", "v"), rows)


def _error(column: NDArray[np.float64]) -> float:
    return float(column.std(ddof=1) / math.sqrt(len(column)))
