"""Random absorbers, simulated and by the moment closure: the error of the closure."""

import math

import cases
import numpy as np
from scipy.stats import qmc

import stochvi as sv

RANGES = {
    "mass_ratio": (0.005, 0.2), "play_in_sigma": (0.5, 12.0), "zeta": (0.005, 0.05),
}  # fmt: skip
POINTS = 64
HELD_OUT = 32
QUANTITIES = {
    "structure_displacement_std": ("structure", "displacement_std"),
    "structure_velocity_std": ("structure", "velocity_std"),
    "absorber_velocity_std": ("absorber", "velocity_std"),
    "relative_displacement_std": ("box", "relative_displacement_std"),
    "relative_velocity_std": ("box", "relative_velocity_std"),
    "impact_speed_rate": ("box", "impact_speed_rate"),
    "impact_speed_square_rate": ("box", "impact_speed_square_rate"),
}


def cells(number: int, seed: int) -> list[dict]:
    """Scenes that fill the ranges evenly: logarithms of mass, play and damping, restitution."""
    found = []
    for point in qmc.Sobol(4, rng=np.random.default_rng(seed)).random(number).tolist():
        cell = dict(cases.BASIC)
        for place, (name, (low, high)) in zip(point, RANGES.items(), strict=False):
            cell[name] = round(math.exp(math.log(low) + place * math.log(high / low)), 6)
        found.append(cell | {"restitution": round(point[3], 4)})
    return found


def everything() -> list[tuple[str, dict]]:
    """The atlas, and what it is tried on."""
    return [
        (part, cell)
        for seed, (part, number) in enumerate((("atlas", POINTS), ("held out", HELD_OUT)))
        for cell in cells(number, seed)
    ]


def row(part: str, cell: dict) -> dict:
    """Every quantity: simulated, its error, and the closure's."""
    response, seconds = cases.simulated(cell)
    try:
        linear = sv.linearise(cases.boxed(cell))
    except sv.NotConverged:
        linear = None
    found = {"part": part} | cell | {"cpu_seconds": round(seconds, 2)}
    for name, (owner, quantity) in QUANTITIES.items():
        groups = [
            None if each is None else (each.coordinates | each.impact_pairs)[owner][quantity]
            for each in (response, linear)
        ]
        simulated, closure = groups
        found |= {
            name: float(f"{simulated.value:.6g}"),
            f"{name}_error": float(f"{simulated.standard_error:.3g}"),
            f"{name}_bias": float(f"{simulated.bias:.3g}"),
            f"{name}_closure": math.nan if closure is None else float(f"{closure.value:.6g}"),
        }
    return found
