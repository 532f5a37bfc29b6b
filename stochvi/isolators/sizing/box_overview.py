"""A rigid box for its page: its modes, and what sizing each axis as one oscillator would buy."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from stochvi.model.free_motion import free_motion
from stochvi.model.model import model_of
from stochvi.model.natural_modes import NaturalMode, natural_modes
from stochvi.scenes.scene import Scene
from stochvi.scenes.structures.rigid_body import AXES, RigidBody
from stochvi.statistics.pair_crossings import own_distances

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, kw_only=True)
class BoxOverview:
    """The numbers that the page of a box states besides its clearances.

    Parameters
    ----------
    modes
        Natural modes without stops.
    pairs
        One row per pair: its name `pair`, `one_axis_three_sigma`, `chance_at_one_axis` and
        `chance_as_given`. The second is three times the rms of the gap (m) if nothing turned: the
        centre of mass then moves along each axis as an oscillator of its own, on all mounts
        together. The others are probabilities of an impact of this pair alone in the mission. Its
        stops are at that distance from the mean gap, or as in the scene. Both use Rice's rate of
        crossings of the gap as it really moves.
    """

    modes: Sequence[NaturalMode]
    pairs: pd.DataFrame


def box_overview(scene: Scene, mission: float) -> BoxOverview | None:
    """The overview of a scene with a rigid body; None for any other.

    Parameters
    ----------
    mission
        Seconds of exposure.
    """
    import pandas as pd

    if not isinstance(scene.structure, RigidBody):
        return None
    model = model_of(scene)
    rows = np.array([pair.direction for pair in model.pairs])
    sigma, speed = free_motion(model).deviations(rows)
    alone = replace(
        model,
        mass=np.diag(np.diag(model.mass)),
        damping=np.diag(np.diag(model.damping)),
        stiffness=np.diag(np.diag(model.stiffness)),
    )
    straight = rows * (np.arange(rows.shape[1]) < len(AXES))
    three = 3.0 * free_motion(alone).deviations(straight)[0]
    stops = np.array(own_distances(model))
    there = np.where(np.isfinite(stops), three, math.inf)
    return BoxOverview(
        modes=natural_modes(model),
        pairs=pd.DataFrame(
            {
                "pair": [pair.name for pair in model.pairs],
                "one_axis_three_sigma": three,
                "chance_at_one_axis": _chances(sigma, speed, there, mission),
                "chance_as_given": _chances(sigma, speed, stops, mission),
            }
        ),
    )


def _chances(sigma: np.ndarray, speed: np.ndarray, stops: np.ndarray, mission: float) -> np.ndarray:
    """Probability that each pair is hit in the mission, stops (2, pairs) at distances from the
    mean, m: 1 where one of them lies beyond it."""
    moving = sigma > 0.0
    size = np.where(moving, sigma, 1.0)
    level = np.maximum(stops, 0.0) / size
    expected = mission * np.where(moving, speed / size, 0.0) / (2.0 * math.pi)
    crossings = (expected * np.exp(-0.5 * level**2)).sum(axis=0)
    return np.where(np.any(stops < 0.0, axis=0), 1.0, -np.expm1(-crossings))
