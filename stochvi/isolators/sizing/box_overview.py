"""A rigid box for its page: its modes, and what sizing each axis as one oscillator would buy."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from stochvi.mathematics.arrays import Matrix, Vector
from stochvi.mathematics.moving_means import MovingMean
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
    moved = free_motion(model, with_sines=True).moving_means(rows)
    alone = replace(
        model,
        mass=np.diag(np.diag(model.mass)),
        damping=np.diag(np.diag(model.damping)),
        stiffness=np.diag(np.diag(model.stiffness)),
    )
    straight = rows * (np.arange(rows.shape[1]) < len(AXES))
    apart = free_motion(alone, with_sines=True).moving_means(straight)
    three = np.array([3.0 * each.deviations[0] for each in apart])
    stops = np.array(own_distances(model))
    there = np.where(np.isfinite(stops), three, math.inf)
    return BoxOverview(
        modes=natural_modes(model),
        pairs=pd.DataFrame(
            {
                "pair": [pair.name for pair in model.pairs],
                "one_axis_three_sigma": three,
                "chance_at_one_axis": _chances(moved, there, mission),
                "chance_as_given": _chances(moved, stops, mission),
            }
        ),
    )


def _chances(moved: Sequence[MovingMean], stops: Matrix, mission: float) -> Vector:
    """Probability that each pair is hit in the mission, stops (2, pairs) at distances from the
    mean, m: 1 where one of them lies beyond it."""
    crossings = [
        mission * sum(motion.rate(max(float(each), 0.0)) for each in own) if motion.place else 0.0
        for motion, own in zip(moved, stops.T, strict=True)
    ]
    return np.where(np.any(stops < 0.0, axis=0), 1.0, -np.expm1(-np.array(crossings)))
