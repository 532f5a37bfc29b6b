"""Chances of any hit read off the curve of a sizing."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from stochvi.isolators.sizing.answer import spoken_mission, spoken_percent

if TYPE_CHECKING:
    from stochvi.isolators.sizing.answer import Sizing
    from stochvi.scenes.scene import Scene


def probability_at(sizing: Sizing, clearance: float) -> float | None:
    """Chance of any hit in the mission at a clearance of the curve; None before its start."""
    if sizing.target.name == "probability" and clearance == sizing.clearance.value:
        return sizing.target.value
    found = _bursts_at(sizing, clearance)
    return None if found is None else -math.expm1(-found)


def probability_of_stops(sizing: Sizing) -> float | None:
    """Chance of any hit in the mission with the stops where the scene has them.

    A response as often above its mean as below brings half the bursts of equal distances to each
    side; bursts on the two sides are taken for independent.
    """
    scene = sizing.scene
    system = scene.system()
    rest = system.load / system.omega**2
    places = [place for place in (system.lower, system.upper) if place is not None]
    beyond = [place < rest for place in places] == [True, False]
    if not places or (len(places) == 2 and not beyond):
        return None
    found = [_bursts_at(sizing, abs(place - rest)) for place in places]
    if any(bursts is None for bursts in found):
        return None
    return -math.expm1(-sum(bursts for bursts in found if bursts) / len(places))


def spoken_chance_of_stops(sizing: Sizing) -> str:
    """The same in words; beyond the curve it is under the chance at its end."""
    chance = probability_of_stops(sizing)
    if chance is None:
        return "not known"
    if chance == 0.0:
        return f"under {spoken_percent(sizing.curve['probability'].iloc[-1])}"
    return spoken_percent(chance)


def spoken_places(sizing: Sizing) -> str:
    """Where the clearance is sought, and what the stops of the scene risk where they are.

    Clearances are equal distances from the mean position, which the stops of a scene need not be.
    """
    scene = sizing.scene
    if not scene.impact_pairs:
        return "clearance: equal distances of two stops from the mean position"
    system = scene.system()
    rest = system.load / system.omega**2
    places = {"lower": system.lower, "upper": system.upper}
    stops = {side: abs(place - rest) for side, place in places.items() if place is not None}
    told = (
        f"{' and '.join(f'{1e3 * distance:.4g}' for distance in stops.values())} mm from the mean: "
        f"{spoken_chance_of_stops(sizing)} in {spoken_mission(sizing.mission)} (any hit)"
    )
    if len(stops) == 1:
        (side,) = stops
        return (
            f"clearance: distance of the stop from the mean position ({side} side only); "
            f"stop of the scene, {told}"
        )
    return (
        "clearance: equal distances of both stops from the mean position; "
        f"stops of the scene, {told}"
    )


def _bursts_at(sizing: Sizing, clearance: float) -> float | None:
    """-log(1 - P) at a clearance; 0 beyond the curve, None before it."""
    curve = sizing.curve
    x, p = curve["clearance"].to_numpy(), curve["probability"].to_numpy()
    if clearance < x.min():
        return None
    if clearance > x.max():
        return 0.0
    # it falls nearly as a Gaussian: straight in its logarithm over the square of the clearance
    bursts = -np.log1p(-np.clip(p, LEAST, CERTAIN))
    return math.exp(float(np.interp(clearance**2, x**2, np.log(bursts))))


LEAST, CERTAIN = 1e-300, 1.0 - 1e-15
"""Of a chance whose logarithm is taken."""


def two_sided(scene: Scene) -> bool:
    """Whether both sides are sized: two stops, or none yet."""
    return not scene.impact_pairs or len(scene.impact_pairs[0].stops()) == 2
