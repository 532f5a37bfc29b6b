"""Probability that a mass touches its stops at all: first crossings of a stationary Gaussian
process.

Before its first contact the mass moves as if there were no stops: linearly, and Gaussian where the
excitation is. The probability of any impact in a mission depends on no impact law, therefore, and
needs no impact. Around an outcrossing of a stop the process is Slepian's (see
`monte_carlo.kernels.crossings`), so the records of `pair_crossings` look back from a given crossing
of one gap. A probability of 1e-9 costs no more than one of 0.1, and the same records serve any
number of levels. `crossing_ages` has the formulas.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

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
from stochvi.statistics.crossing_ages import FirstCrossings, until_accurate
from stochvi.statistics.pair_crossings import GapRecords, PairMotion


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
    """First impacts of stops at many clearances, from one set of records.

    Parameters
    ----------
    scene
        One oscillator under Gaussian noise (white, filtered, tabulated, any sum), sines or shocks
        of a shape beside it and constant loads; its own stops do not matter.
    clearances
        Distances of two stops from the mean position, m.
    lower, upper
        Instead: distances of a lower and of an upper stop, pairwise; leave one out for one stop.
    **options
        `AccuracyOptions`: `rel_error` is that of the probability of an impact in `mission` seconds,
        at every level where that probability is below 1/2; at the end of the `budget` it ends with
        larger errors.

    Raises
    ------
    NotApplicable
        If the response without stops is not that of one oscillator: a stationary Gaussian process,
        beside sines about a mean that moves.

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
    """
    above, below = _levels(clearances, lower, upper)
    run = Run.of(options)
    motion = PairMotion.under_shocks(one_gap(model_of(scene)))
    records = GapRecords(motion, run.seed, below[:, None], above[:, None])
    return until_accurate(run, _OfOneGap(records), mission, run.accuracy)


@dataclass(frozen=True, eq=False)
class _OfOneGap:
    """Records of one gap, from which its own crossings are found."""

    records: GapRecords

    @property
    def together(self) -> int:
        return self.records.together

    def ages(self, first_path: int) -> NDArray[np.float32]:
        return self.records.ages(first_path)

    def found(self, ages: NDArray[np.float32]) -> FirstCrossings:
        return self.records.found(ages).of_one(0)


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
    """(upper, lower) distances, infinite for no stop."""
    if (clearances is None) == (lower is None and upper is None):
        raise ValueError("give clearances, or lower and upper, not both")
    if clearances is not None:
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
    return above, below
