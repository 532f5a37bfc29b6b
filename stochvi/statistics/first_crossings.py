"""Probability that any stop is touched at all: first crossings of a stationary Gaussian process.

Before the first contact the gaps move as if there were no stops: linearly, and Gaussian where the
excitation is. The probability of any impact in a mission depends on no impact law, therefore, and
needs no impact. Around an outcrossing of a stop the process is Slepian's (see
`monte_carlo.kernels.crossings`), so the records of `pair_crossings` look back from a given crossing
of one gap. A probability of 1e-9 costs no more than one of 0.1, and the same records serve any
number of levels. `crossing_ages` has the formulas.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Unpack

import numpy as np
from numpy.typing import ArrayLike

from stochvi.mathematics.arrays import Vector
from stochvi.model.calculations import calculation
from stochvi.model.coverage import (
    beyond_one_oscillator,
    not_gaussian,
    without_free_response,
    without_noise,
)
from stochvi.model.model import Model, Pair, model_of
from stochvi.results.errors import NotApplicable
from stochvi.sampling.options import AccuracyOptions
from stochvi.sampling.run import Run, sampled
from stochvi.scenes.scene import Scene
from stochvi.statistics.pair_crossings import FirstCrossings, PairMotion


@calculation
@sampled(rel_error=0.05)
def first_crossings(
    scene: Scene,
    clearances: ArrayLike | None = None,
    *,
    lower: ArrayLike | None = None,
    upper: ArrayLike | None = None,
    mission: float = 3600.0,
    **options: Unpack[AccuracyOptions],
) -> FirstCrossings:
    """First impacts of one oscillator, or of any pair of a structure, from one set of records.

    Parameters
    ----------
    scene
        A linear structure with impact pairs under Gaussian noise of any kind and constant loads,
        and sines or shocks of a shape beside it. The stops of one oscillator do not matter where
        distances are given.
    clearances
        (levels,): distances of two stops of one oscillator from its mean position, m.
    lower, upper
        Instead: (levels,), distances of its lower and of its upper stop; leave one out for one
        stop. Or (levels, pairs), distances of the stops of pairs from their mean gaps, m, infinite
        for none; by default those of the scene, at one level.
    **options
        `AccuracyOptions`: `rel_error` is that of the probability of an impact in `mission` seconds,
        at every level where that probability is below 1/2; at the end of the `budget` it ends with
        larger errors.

    Raises
    ------
    NotApplicable
        If the motion without stops is not a stationary Gaussian process, beside sines about a mean
        that moves.

    Examples
    --------
    >>> from stochvi.scenes.excitations import WhiteNoise
    >>> from stochvi.scenes.structures import Oscillator
    >>> scene = Scene(
    ...     structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
    ...     excitations=[WhiteNoise(intensity=0.2)],
    ... )
    >>> rate = first_crossings(scene, [3.0]).first_rate()[0]
    >>> abs(rate.value - 0.0018091405) < 4.5 * rate.standard_error + rate.bias
    True

    Two rods between the same two masses are hit together, and count once.

    >>> from stochvi import ImpactPair, Matrices, Restitution
    >>> stops = {"lower": -3.0, "upper": 3.0, "law": Restitution(coefficient=0.5)}
    >>> scene = Scene(
    ...     structure=Matrices(
    ...         coordinates=("x", "z"), mass=[[1, 0], [0, 1]],
    ...         damping=[[0.1, 0], [0, 0.1]], stiffness=[[1, 0], [0, 1]],
    ...     ),
    ...     impact_pairs=[ImpactPair(name=name, on="x", **stops) for name in ("left", "right")],
    ...     excitations=[WhiteNoise(intensity=0.2, on="x")],
    ... )
    >>> rate = first_crossings(scene).first_rate()[0]
    >>> abs(rate.value - 0.0018091405) < 4.5 * rate.standard_error + rate.bias
    True
    """
    run, model = Run.of(options), model_of(scene)
    given = [np.ndim(each) for each in (clearances, lower, upper) if each is not None]
    if given and max(given) < 2:
        below, above = _levels(clearances, lower, upper)
        lower, upper, model = below[:, None], above[:, None], one_gap(model)
    return PairMotion.under_shocks(model).crossings(lower, upper, mission, run)


def one_gap(model: Model) -> Model:
    """One oscillator whose displacement is a gap, with no stops of its own.

    Raises `NotApplicable` if its motion is not a stationary Gaussian process of one oscillator,
    shocks beside it left out.
    """
    free = replace(model, pairs=())
    unmet = (
        beyond_one_oscillator(free, with_filters=True, with_sines=True)
        or without_noise(free)
        or without_free_response(free)
        or not_gaussian(replace(free, drawn=()))
    )
    if unmet:
        raise NotApplicable("first_crossings", unmet)
    gap = Pair(
        name=model.coordinates[0], direction=np.ones(1), mass=model.unit_mass, relative=False,
        stops=(),
    )  # fmt: skip
    return replace(free, pairs=(gap,))


def _levels(
    clearances: ArrayLike | None, lower: ArrayLike | None, upper: ArrayLike | None
) -> tuple[Vector, Vector]:
    """(levels,): distances below and above, infinite for no stop."""
    if clearances is not None:
        if lower is not None or upper is not None:
            raise ValueError("give clearances, or lower and upper, not both")
        lower = upper = clearances
    size = max(0 if side is None else np.size(side) for side in (upper, lower))
    above, below = (
        np.full(size, math.inf) if side is None else np.atleast_1d(np.asarray(side, dtype=float))
        for side in (upper, lower)
    )
    if len(above) != len(below):
        raise ValueError(f"needs as many lower as upper stops, got {len(below)} and {len(above)}")
    if not (np.all(above > 0.0) and np.all(below > 0.0)):
        raise ValueError("distances of stops must be positive, m from the mean position")
    return below, above
