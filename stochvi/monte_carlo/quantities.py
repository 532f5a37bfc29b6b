"""What is asked of the means of many paths: each quantity as a function of them."""

from __future__ import annotations

import math
from collections.abc import Callable

from stochvi.collisions import COLLAPSE_RESTITUTION
from stochvi.scenes import System

Means = dict[str, float]
Quantity = Callable[[Means], float]


def speed_mean(means: Means) -> float:
    """Mean impact speed, F1 over the rate."""
    return IMPACTS["impact_speed_rate"](means) / IMPACTS["collision_rate"](means)


MEANS = ("x", "variance", "vv", "f1_lower", "f1_upper", "f2_lower", "f2_upper")
"""Names that the balances need."""

COORDINATE: dict[str, Quantity] = {
    "displacement_mean": lambda m: m["x"],
    "displacement_std": lambda m: math.sqrt(m["variance"]),
    "displacement_mean_square": lambda m: m["xx"],
    "velocity_std": lambda m: math.sqrt(max(m["vv"], 0.0)),
    "velocity_mean_square": lambda m: m["vv"],
}

IMPACTS: dict[str, Quantity] = {
    "collision_rate": lambda m: m["n_lower"] + m["n_upper"],
    "collision_rate_lower": lambda m: m["n_lower"],
    "collision_rate_upper": lambda m: m["n_upper"],
    "impact_speed_rate": lambda m: m["f1_lower"] + m["f1_upper"],
    "impact_speed_square_rate": lambda m: m["f2_lower"] + m["f2_upper"],
}

RATES = tuple(quantity for name, quantity in IMPACTS.items() if name.startswith("collision"))

GOVERNED = (
    "displacement_mean",
    "displacement_mean_square",
    "velocity_mean_square",
    "collision_rate",
    "impact_speed_rate",
    "impact_speed_square_rate",
)


def governed(system: System) -> dict[str, Quantity]:
    """What `rel_error` governs: a rate that has no limit as slow impacts are counted does not."""
    quantities = COORDINATE | IMPACTS
    return {
        name: quantities[name]
        for name in GOVERNED
        if not (name == "collision_rate" and collapses(system))
    }


def collapses(system: System) -> bool:
    restitutions = (system.restitution_lower, system.restitution_upper)
    return any(r is not None and r <= COLLAPSE_RESTITUTION for r in restitutions)
