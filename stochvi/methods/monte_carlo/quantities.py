"""The quantities of a response, each as a function of the time averages of many paths."""

from __future__ import annotations

import math
from collections.abc import Callable

from stochvi.mathematics.impact_rates import COLLAPSE_RESTITUTION
from stochvi.model.model import Model, Pair, Stop

Key = tuple[str, str]
"""Name of the owner (a coordinate or an impact pair), and name of the mean or quantity."""

Means = dict[Key, float]
"""Time averages by key, averaged over the paths (SI units)."""

Quantity = Callable[[Means], float]
"""A quantity of a response as a smooth function of the means."""

RATES = ("collision_rate", "collision_rate_lower", "collision_rate_upper", "impact_speed_mean")
"""Quantities that count impacts; where stops lose energy, only those above a speed threshold."""

EVENTS = (*RATES[:3], "impact_speed_rate", "impact_speed_square_rate")
"""Quantities that are sums over impacts, per second."""

GOVERNED = (
    "displacement_mean",
    "displacement_mean_square",
    "velocity_mean_square",
    "collision_rate",
    "impact_speed_rate",
    "impact_speed_square_rate",
)
"""Quantities of each coordinate and each impact pair whose errors `rel_error` governs."""


STATISTICS = "statistics"
"""Owner of the functions of the motion that are averaged."""


def of_coordinate(name: str) -> dict[str, Quantity]:
    """Quantities of a coordinate, from the means of x, x^2 and v^2."""
    return {
        "displacement_mean": lambda m: m[name, "x"],
        "displacement_std": lambda m: math.sqrt(m[name, "variance"]),
        "displacement_mean_square": lambda m: m[name, "xx"],
        "velocity_std": lambda m: math.sqrt(max(m[name, "vv"], 0.0)),
        "velocity_mean_square": lambda m: m[name, "vv"],
    }


def acceleration_std(name: str) -> Quantity:
    """Standard deviation of the absolute acceleration, from the means of a and a^2."""
    return lambda m: math.sqrt(max(m[name, "aa"] - m[name, "a"] ** 2, 0.0))


def of_pair(name: str) -> dict[str, Quantity]:
    """Quantities of an impact pair, from the sums of 1, w and w^2 over impacts, per second."""

    def total(what: str) -> Quantity:
        return lambda m: m[name, f"{what}_lower"] + m[name, f"{what}_upper"]

    return {
        "collision_rate": total("n"),
        "collision_rate_lower": lambda m: m[name, "n_lower"],
        "collision_rate_upper": lambda m: m[name, "n_upper"],
        "impact_speed_rate": total("f1"),
        "impact_speed_square_rate": total("f2"),
    }


def gap_of(pair: Pair) -> str:
    """Owner of the means of a pair's relative displacement and velocity."""
    return f"gap of {pair.name}"


def of_gap(pair: Pair) -> dict[str, Quantity]:
    """Quantities of the relative motion of a pair of two coordinates."""
    known = of_coordinate(gap_of(pair))
    return {
        f"relative_{name}": known[name]
        for name in ("displacement_mean", "displacement_std", "velocity_std")
    }


def of_compliant_pair(pair: Pair) -> dict[str, Quantity]:
    """Quantities of a pair with a compliant stop, from the sums over its contacts.

    The peak force is given only where all stops of the pair are compliant.
    """
    name, mass = pair.name, pair.mass
    sides = [stop.name for stop in pair.stops if not stop.rigid]
    found: dict[str, Quantity] = {
        f"contact_force_{side}": lambda m, side=side: mass * m[name, f"force_{side}"]  # type: ignore[misc]
        for side in sides
    }
    found["contact_probability"] = lambda m: sum(m[name, f"contact_{side}"] for side in sides)
    if len(sides) == len(pair.stops):
        found["peak_force"] = lambda m: _ratio(
            mass * sum(m[name, f"peak_{side}"] for side in sides),
            sum(m[name, f"ended_{side}"] for side in sides),
        )
    return found


def key_of_statistic(name: str) -> Key:
    """The key of a function of the motion that is averaged."""
    return STATISTICS, name


def speed_mean(name: str) -> Quantity:
    """Mean impact speed, m/s: F1 over the rate of all counted impacts."""
    pair = of_pair(name)
    return lambda m: _ratio(pair["impact_speed_rate"](m), pair["collision_rate"](m))


def _ratio(above: float, below: float) -> float:
    """A mean per impact; NaN where there was no impact, of which nothing is known."""
    return above / below if below else math.nan


def governed(model: Model) -> dict[Key, Quantity]:
    """Quantities that `rel_error` governs, without the rates that would be infinite if all impacts
    were counted."""
    found: dict[Key, Quantity] = {}
    for coordinate in model.coordinates:
        known = of_coordinate(coordinate)
        found |= {(coordinate, name): known[name] for name in GOVERNED if name in known}
    for pair in model.pairs:
        known = of_pair(pair.name)
        for name in GOVERNED:
            if name in known and not (name in RATES and any(map(collapses, pair.stops))):
                found[pair.name, name] = known[name]
    return found


def collapses(stop: Stop) -> bool:
    """Whether the rate of all impacts on a stop is infinite under white noise."""
    return stop.rigid and stop.law.slow_restitution <= COLLAPSE_RESTITUTION
