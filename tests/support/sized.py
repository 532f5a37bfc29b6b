"""A sizing made by hand, for what shows one: cheap, with numbers of the right size."""

from __future__ import annotations

import math

import numpy as np
import pandas as pd

from stochvi import ImpactPair, Isolator, Scene, TabulatedNoise, screen, simulate
from stochvi.isolators.screening import at_clearances
from stochvi.isolators.sizing.answer import (
    Clearance,
    Sizing,
    Target,
    ThreeSigma,
    distances_of_stops,
)
from stochvi.results.estimates import Cost, Estimate, provenance
from stochvi.scenes.excitations import Excitation
from stochvi.scenes.impact_laws import Law, Viscoelastic

TRUCK = TabulatedNoise(profile="mil-std-810h-truck-vertical-5hz")
MOUNT = Isolator(
    mass=2.5, frequency_hz=12.0, zeta=0.1, gravity=True, frequency_tolerance=0.1
)  # fmt: skip
BUMPER = Viscoelastic(stiffness=1.4e6, damping_ratio=0.2)


def scene_between_stops(
    law: Law | None = BUMPER, noise: Excitation = TRUCK, structure: Isolator = MOUNT
) -> Scene:
    pairs = [] if law is None else [ImpactPair(lower=-9e-3, upper=5e-3, law=law)]
    title = "12 Hz isolator on a truck"
    return Scene(title=title, structure=structure, impact_pairs=pairs, excitations=[noise])


def sizing_of(scene: Scene, mission: float = 3600.0, paths: int = 256) -> Sizing:
    """Rice's crossings in the place of first hits, and short simulations."""
    linear = screen(scene)
    sigma = linear.displacement_std
    clearance = np.linspace(2.0, 7.0, 41) * sigma
    rice = np.array([linear.rice_rate(c) for c in clearance])
    curve = pd.DataFrame(
        {"clearance": clearance, "clearance_in_sigma": clearance / sigma, "rice_rate": rice}
    )
    for name, factor in (("", 0.55), ("_low", 0.52), ("_high", 0.58)):
        curve[f"first_hit_rate{name}"] = factor * rice
        curve[f"probability{name}"] = -np.expm1(-factor * rice * mission)
    chances = [0.1, 0.01, 0.001]
    needed = [sigma * math.sqrt(2.0 * math.log(0.55 * 24.0 * mission / p)) for p in chances]
    required = pd.DataFrame({"probability": chances, "clearance": needed})
    required["clearance_low"] = 0.995 * required["clearance"]
    required["clearance_high"] = 1.005 * required["clearance"]
    required["clearance_in_sigma"] = required["clearance"] / sigma
    evidence, simulated = {}, []
    if scene.impact_pairs:
        for name, place in (("three_sigma", 3.0 * sigma), ("recommended", needed[1])):
            answer = simulate(at_clearances(scene, place), paths=paths, duration=20.0, seed=1)
            evidence[name] = answer
            rate = answer.impact_pairs["stops"]["collision_rate"]
            assert isinstance(rate, Estimate)
            speed = answer.impact_pairs["stops"]["impact_speed_mean"]
            unseen = rate.upper_95 is not None
            half = 2.0 * rate.standard_error
            simulated.append(
                {
                    "clearance": place,
                    "clearance_in_sigma": place / sigma,
                    "hit_rate": np.nan if unseen else rate.value,
                    "hit_rate_low": rate.value - half,
                    "hit_rate_high": rate.upper_95 if unseen else rate.value + half,
                    "hits_per_first_hit": np.nan if unseen else 1.4,
                    "impact_speed_mean": speed.value if isinstance(speed, Estimate) else np.nan,
                    "by": "simulation",
                }
            )
    hits = linear.rice_rate(3.0 * sigma) * mission
    distances = distances_of_stops(scene)
    some = 0.5 * sum(0.55 * linear.rice_rate(each) * mission for each in distances.values())
    return Sizing(
        scene=scene,
        target=Target(name="probability", value=0.01, unit="1"),
        mission=mission,
        clearances={
            "stops": Clearance(value=needed[1], lower=0.995 * needed[1], upper=1.005 * needed[1])
        },
        pairs=pd.DataFrame(
            {
                "pair": ["stops"],
                "sigma": sigma,
                "lower": needed[1],
                "upper": needed[1],
                "clearance_in_sigma": needed[1] / sigma,
                "probability_alone": 0.01,
                "share_of_first_hits": 1.0,
            }
        ),
        curve=curve,
        three_sigma=ThreeSigma(
            clearance=3.0 * sigma,
            probability=Estimate(value=1.0 - 1e-12),
            first_hits=Estimate(value=0.55 * hits),
            rice_hits=hits,
            hits=None,
            impact_speed_mean=None,
        ),
        required=required,
        expected_hits=rate * mission if scene.impact_pairs else None,
        simulated=pd.DataFrame(simulated),
        evidence=evidence,
        screening=linear,
        method="made by hand",
        probability_of_stops=Estimate(value=-math.expm1(-some)) if distances else None,
        cost=Cost(wall_time=1.0, paths=2 * paths, threads=1),
        provenance=provenance(scene.document(), seed=1),
    )
