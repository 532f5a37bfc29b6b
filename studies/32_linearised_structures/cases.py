"""Random structures of 2 to 10 modes with one or two pairs, in white noise."""

from typing import Any

import numpy as np

import stochvi as sv
from stochvi.scenes.structures import Modes

PLACES = ("p0", "p1", "force", "seat")


def random_structure(number: int) -> sv.Scene:
    """A structure by its number.

    Neighbouring frequencies are 1.05 to 1.6 times apart (to 2.2 below six modes), shapes and
    participation are normal numbers, zeta is 0.005 to 0.1. A point, two points or the base are
    shaken. Stops are at 0.4 to 3 deviations of their gap without stops, on one side or both.
    """
    rng = np.random.default_rng([33, number])
    size, pairs = int(rng.integers(2, 11)), int(rng.integers(1, 3))
    apart = np.exp(rng.uniform(np.log(1.05), np.log(2.2 if size < 6 else 1.6), size - 1))
    frequencies = np.cumprod([1.0, *apart])
    zeta = log_uniform(rng, 0.005, 0.1) * np.exp(rng.uniform(-0.5, 0.5, size))
    shapes = {name: rng.standard_normal(size) for name in PLACES}
    drive = ("point", "base", "two")[int(rng.integers(0, 3))]
    structure = Modes(
        frequency_hz=frequencies.tolist(), zeta=zeta.tolist(), modal_mass=[1.0] * size,
        shapes={name: shape.tolist() for name, shape in shapes.items()},
        participation=rng.standard_normal(size).tolist(),
    )  # fmt: skip
    noise = [sv.WhiteNoise(on="base" if drive == "base" else "force", intensity=1.0)]
    if drive == "two":
        noise.append(sv.WhiteNoise(on="p0", intensity=float(np.exp(rng.uniform(-1.0, 1.0)))))
    free = sv.linearise(sv.Scene(structure=structure, excitations=noise)).coordinates
    kind, stops = int(rng.integers(0, 4)), []
    for place in PLACES[:pairs]:
        compliance = float(np.sum((shapes[place] / (2.0 * np.pi * frequencies)) ** 2))
        gap = log_uniform(rng, 0.4, 3.0) * free[place].displacement_std.value
        both = bool(rng.integers(0, 2))
        stops.append(
            sv.ImpactPair(
                name=f"stops of {place}", on=place, upper=gap, lower=-gap if both else None,
                law=drawn_law(rng, kind, compliance),
            )
        )  # fmt: skip
    return sv.Scene(structure=structure, excitations=noise, impact_pairs=stops)


def drawn_law(rng: np.random.Generator, kind: int, compliance: float) -> Any:
    """A rigid stop of R 0.4 to 1, or one 3 to 300 times as stiff as the structure at its place."""
    stiffness = log_uniform(rng, 3.0, 300.0) / compliance
    restitution, ratio = float(rng.uniform(0.4, 1.0)), float(rng.uniform(0.02, 0.3))
    if kind == 0:
        return sv.Restitution(coefficient=restitution)
    if kind == 1:
        return sv.Elastic(stiffness=stiffness)
    return sv.Viscoelastic(stiffness=stiffness, damping_ratio=ratio)


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))
