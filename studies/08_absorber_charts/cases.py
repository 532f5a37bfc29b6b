"""The structure of the charts, its absorbers, and the tuned mass damper beside them."""

import itertools
import math
import time

import numpy as np
import pandas as pd
from scipy.optimize import minimize

import stochvi as sv

PLAYS = (1.0, 2.0, 3.0, 4.0, 6.0, 9.0)
MASSES = (0.02, 0.05, 0.1)
RESTITUTIONS = (0.2, 0.5, 0.75)
BUDGET = 6.0
"""Seconds for a case."""

FEWEST_PATHS = 64
"""Of a case that the budget is too short for: its errors say what they tell."""

SMALLEST = 0.02
"""Mass ratio times play in sigma: light masses in tight boxes hit too often for their worth."""

BASIC = {"mass_ratio": 0.05, "restitution": 0.5, "zeta": 0.01, "noise": "white", "units": 1}


def structure(zeta: float, noise: str, squared_frequency: float = 1.0) -> sv.Scene:
    """1 kg at 1 rad/s; white noise, or noise through a resonance there that is 0.1 wide."""
    oscillator = sv.Oscillator(mass=1.0, damping=2.0 * zeta, stiffness=squared_frequency)
    shaking = sv.WhiteNoise(on="x", intensity=1.0)
    if noise == "narrow":
        frequency = 1.0 / (2.0 * math.pi)
        shaking = sv.FilteredNoise(on="x", intensity=1.0, frequency_hz=frequency, zeta=0.1)
    return sv.Scene(structure=oscillator, excitations=[shaking])


def rms(scene: sv.Scene) -> float:
    """Of the first coordinate, without stops: exact."""
    first = scene.structure.coordinates[0]
    return sv.linearise(scene).coordinates[first]["displacement_std"].value


def grid() -> list[dict]:
    """Every case of the charts."""
    axes = [
        {"mass_ratio": MASSES, "restitution": RESTITUTIONS},
        {"mass_ratio": (0.1,), "zeta": (0.005, 0.02, 0.05)},
        {"mass_ratio": (0.1,), "noise": ("narrow",)},
        {"mass_ratio": (0.1,), "units": (2, 4, 8)},
    ]
    found = []
    for axis in axes:
        for values in itertools.product(*axis.values(), PLAYS):
            found.append(BASIC | dict(zip((*axis, "play_in_sigma"), values, strict=True)))
    return [case for case in found if case["mass_ratio"] * case["play_in_sigma"] >= SMALLEST]


def ratio(case: dict, rel_error: float, squared_frequency: float = 1.0) -> dict:
    """The case with its rms ratio: simulated, and by the moment closure."""
    alone = structure(case["zeta"], case["noise"], squared_frequency)
    sigma = rms(structure(case["zeta"], case["noise"]))
    loose = sv.Absorber(
        mass=case["mass_ratio"], play=case["play_in_sigma"] * sigma, units=case["units"],
        law=sv.Restitution(coefficient=case["restitution"]),
    )  # fmt: skip
    scene = sv.Scene(structure=alone.structure, excitations=alone.excitations, absorber=loose)
    started = time.perf_counter()
    try:
        response = sv.simulate(scene, rel_error=rel_error, budget=BUDGET, threads=1)
    except sv.NotConverged as reached:  # its errors say what it has
        response = reached.response or sv.simulate(scene, paths=FEWEST_PATHS, budget=None)
    seconds = time.perf_counter() - started
    deviation = response.coordinates["structure"]["displacement_std"]
    try:
        closure = sv.linearise(scene).coordinates["structure"]["displacement_std"].value
    except sv.NotConverged:
        closure = math.nan
    own = rms(alone)
    return case | {
        "rms_ratio": deviation.value / own,
        "standard_error": deviation.standard_error / own,
        "bias": deviation.bias / own,
        "closure": closure / own,
        "seconds": seconds,
    }


def damper(mass: float, frequency: float, zeta: float, squared_frequency: float) -> float:
    """rms ratio of a tuned mass damper on the structure: exact."""
    alone = structure(0.01, "white", squared_frequency)
    spring, link = mass * frequency**2, 2.0 * zeta * mass * frequency
    tuned = sv.Matrices(
        coordinates=["structure", "damper"],
        mass=np.diag([1.0, mass]),
        damping=[[0.02 + link, -link], [-link, link]],
        stiffness=[[squared_frequency + spring, -spring], [-spring, spring]],
    )
    noise = sv.WhiteNoise(on="structure", intensity=1.0)
    return rms(sv.Scene(structure=tuned, excitations=[noise])) / rms(alone)


def against_dampers(rel_error: float) -> pd.DataFrame:
    """Best impact absorber and best tuned mass damper, tuned and 10 % off."""
    rows = []
    for mass in (0.02, 0.05, 0.1):
        best = minimize(
            lambda x, mass=mass: damper(mass, x[0], x[1], 1.0),
            (1.0 / (1.0 + mass), math.sqrt(mass) / 2.0), method="Nelder-Mead",
        ).x  # fmt: skip
        found = sv.design_absorber(
            structure(0.01, "white"), mass_budget=mass, restitutions=[0.2, 0.5], rel_error=rel_error
        )
        for off in (-0.1, 0.0, 0.1):
            squared = (1.0 + off) ** 2
            case = BASIC | {
                "mass_ratio": mass, "restitution": found.restitution,
                "play_in_sigma": found.best.play / found.sigma,
            }  # fmt: skip
            impact = ratio(case, rel_error, squared)
            rows.append(
                {
                    "mass_ratio": mass, "structure_frequency_off": off,
                    "tuned_mass_damper": damper(mass, *best, squared),
                    "impact_absorber": impact["rms_ratio"],
                    "standard_error": impact["standard_error"],
                    "play_in_sigma": case["play_in_sigma"], "restitution": found.restitution,
                }
            )  # fmt: skip
    return pd.DataFrame(rows)
