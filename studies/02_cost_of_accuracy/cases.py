"""The scenes in which this engine and the others are timed."""

import math

import stochvi as sv

DAMPING, INTENSITY = 0.1, 0.2
"""Damping and intensity of an oscillator of unit mass and stiffness, whose sigma is then 1."""

CASES = {  # lower, upper, restitution, load; the others at their usual step
    f"{name}, R = {r:g}": (lower, upper, r, load)
    for name, lower, upper, load in [
        ("1 sigma", -1.0, 1.0, 0.0), ("2 sigma", -2.0, 2.0, 0.0), ("unequal", -0.5, 1.0, 0.0),
        ("preload", -math.inf, -1.0, 0.0), ("load", -1.0, 1.0, 1.0),
    ]
    for r in ((1.0, 0.8, 0.5, 0.2) if name == "1 sigma" else (1.0, 0.8))
}  # fmt: skip


def scene(lower: float, upper: float, restitution: float, load: float) -> sv.Scene:
    stops = {"upper": upper} | ({"lower": lower} if math.isfinite(lower) else {})
    pair = sv.ImpactPair(**stops, law=sv.Restitution(coefficient=restitution))
    loads = [sv.ConstantLoad(force=load)] if load else []
    return sv.Scene(
        structure=sv.Oscillator(mass=1.0, damping=DAMPING, stiffness=1.0),
        impact_pairs=[pair], excitations=[sv.WhiteNoise(intensity=INTENSITY), *loads],
    )  # fmt: skip
