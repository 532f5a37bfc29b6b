"""The stops of a scene, moved to given clearances."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from stochvi.model.model import model_of
from stochvi.scenes.between_units import moved
from stochvi.scenes.scene import Scene


def at_clearances(scene: Scene, clearances: ArrayLike) -> Scene:
    """The scene with its stops moved to distances from the mean gaps, the laws of the stops kept.

    Parameters
    ----------
    clearances
        Metres: one number for all stops, one for each pair (pairs,), or those of the lower and of
        the upper stops (2, pairs). Infinite ones belong to stops that the
        scene does not have.
    """
    model, whole = model_of(scene), scene.expanded
    means = model.mean_gaps
    lower, upper = np.broadcast_to(np.asarray(clearances, dtype=float), (2, len(means))).tolist()
    pairs = [
        pair.model_copy(
            update={
                "lower": None if pair.lower is None else moved(pair.lower, mean - below),
                "upper": None if pair.upper is None else moved(pair.upper, mean + above),
            }
        )
        for pair, mean, below, above in zip(
            whole.impact_pairs, means.tolist(), lower, upper, strict=True
        )
    ]
    return whole.model_copy(update={"impact_pairs": tuple(pairs)})
