"""Where the stops of a sizing lie, and the probability of any impact there.

This module reads the probability of even stops off the curve of risk against clearance, which
`risk_curve` makes. That of uneven stops is in the sizing, as their first crossings have it.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from stochvi.mathematics.arrays import Vector
from stochvi.model.model import Model, model_of

if TYPE_CHECKING:
    from stochvi.isolators.sizing.answer import Sizing
    from stochvi.scenes.scene import Scene


@dataclass(frozen=True, kw_only=True)
class StopPositions:
    """Where stops lie, m from the unloaded spring unless stated otherwise.

    Parameters
    ----------
    mean_position
        The static equilibrium: where the mass hangs under gravity and constant loads.
    recommended
        Place of the stop on each side, by "lower" and "upper", at the clearance to make (`made`);
        empty where that is not known.
    distances
        Clearance of each stop of the scene: its distance from the static equilibrium.
    probability
        Probability of any impact in the mission with the stops of the scene; None where it is not
        known, or the scene has no stops.
    """

    mean_position: float
    recommended: Mapping[str, float]
    distances: Mapping[str, float]
    probability: float | None


def gap_of(sizing: Sizing) -> StopPositions:
    """The stops of a sizing: at the clearance to make, and as the scene has them."""
    model = model_of(sizing.scene)
    rest, made = model.rest, sizing.made
    return StopPositions(
        mean_position=rest,
        recommended={side: made.position(rest, side) for side in sizing.sides if made},
        distances={name: abs(each) for name, each in distances_of_stops(sizing.scene).items()},
        probability=probability_of_stops(sizing),
    )


def probability_at(sizing: Sizing, clearance: float) -> float | None:
    """Probability of any impact in the mission at a clearance of the curve; None before its
    start."""
    if sizing.target.name == "probability" and clearance == sizing.clearance.value:
        return sizing.target.value
    found = _bursts_at(sizing, clearance)
    return None if found is None else -math.expm1(-found)


def probability_of_stops(sizing: Sizing) -> float | None:
    """Probability of any impact with the stops where the scene has them; None where it is
    not known, or a stop presses on the mass."""
    if sizing.probability_of_stops is not None:
        return sizing.probability_of_stops.value
    distances = distances_of_stops(sizing.scene)
    if not distances or min(distances.values()) <= 0.0 or are_uneven(distances.values()):
        return None
    return probability_at(sizing, min(distances.values()))


def distances_of_stops(scene: Scene) -> dict[str, float]:
    """Distance of each stop from the static equilibrium by "lower" and "upper", m; negative where
    it presses on the mass there."""
    model = model_of(scene)
    return {
        stop.name: model.rest - stop.position
        if stop.name == "lower"
        else stop.position - model.rest
        for stop in model.stops
    }


def mean_gaps(model: Model) -> Vector:
    """Means of all gaps, m; the static equilibrium of a mass that has no pair."""
    return model.mean_gaps if model.pairs else np.array([model.rest])


def are_uneven(distances: Collection[float]) -> bool:
    """Whether there are two stops at different distances.

    Their probability is not on the curve of even ones: a cluster may touch both stops, so that
    either has more than half of the clusters.
    """
    return len(distances) == 2 and not math.isclose(*distances)


def _bursts_at(sizing: Sizing, clearance: float) -> float | None:
    """-log(1 - P) at a clearance; None before the curve, whose end is followed beyond it.

    It falls nearly as a Gaussian: its logarithm over the square of the clearance is straight.
    """
    curve = sizing.curve
    squares, p = curve["clearance"].to_numpy() ** 2, curve["probability"].to_numpy()
    if clearance**2 < squares.min():
        return None
    logarithms = np.log(-np.log1p(-np.clip(p, LEAST, CERTAIN)))
    if clearance**2 <= squares.max():
        return math.exp(float(np.interp(clearance**2, squares, logarithms)))
    slope = float((logarithms[-1] - logarithms[-2]) / (squares[-1] - squares[-2]))
    end = float(logarithms[-1]) + slope * (clearance**2 - float(squares[-1]))
    return math.exp(max(end, math.log(LEAST)))


LEAST, CERTAIN = 1e-300, 1.0 - 1e-15
"""Smallest and largest probability of which a logarithm is taken; others are moved to these
limits."""


def two_sided(scene: Scene) -> bool:
    """Whether both sides are sized: the scene has two stops, or none yet."""
    return not scene.impact_pairs or len(scene.impact_pairs[0].stops()) == 2
