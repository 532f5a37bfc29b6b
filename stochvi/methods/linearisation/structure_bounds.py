"""Stated error of the closure of a structure, calibrated on random structures.

Errors of ln(closure / simulation) were measured on 191 random structures of 2 to 10 modes. They
grow with the part that impacts scatter: with h, the difference of the logarithms of an answer and
of that without scattering. They also grow with the crossings of the mean per impact, n: tails err
most. The bound on the error of a logarithm is

    factor (0.1 + h) (1 + ln n)^(1/2),

without the last term for deviations. Factors are such that 99 % of the errors of these structures
are within. On 182 other structures 99.8 % were (`data/linearisation_atlas/structures.csv`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from stochvi.mathematics.arrays import Vector
from stochvi.methods.linearisation.candidate import ROOT_TWO_PI, Candidate
from stochvi.model.modal import LinearLaw, ModalForm, linear_law
from stochvi.model.model import Model, Pair, Stop
from stochvi.results.estimates import Estimate
from stochvi.results.response import Response
from stochvi.scenes.impact_laws import Elastic, Viscoelastic

FLOOR = 0.1
"""Error of a logarithm that the bound includes where impacts scatter nothing, over its factor."""

FACTORS = {
    "displacement_std": 1.0,
    "velocity_std": 1.2,
    "collision_rate": 1.5,
    "impact_speed_rate": 1.3,
    "impact_speed_square_rate": 1.9,
}
"""Factors of the bounds, by quantity."""

LARGEST = 2.0
"""Largest bound on a logarithm, a factor of 7, that is stated: a larger one would be useless."""

MODES, PAIRS, DAMPING_RATIO, DISTANCE = (2, 10), 2, (0.003, 0.17), (0.4, 3.0)
"""Ranges of the random structures: number of modes, most pairs, damping ratio of every mode, and
places of the stops in deviations of their gap without stops."""

LEAST_RESTITUTION, MOST_DAMPED, SOFTEST = 0.4, 0.3, 3.0
"""Ranges of their stops: restitution, damping ratio, and stiffness over that of the structure."""

TOGETHER = 0.95
"""Correlation of two gaps without stops up to which a bound is stated. The closure cuts each gap at
its own stops alone: above this, rates were up to 48 times too high."""

ROUNDING = 1e-9
"""Share by which a place may lie outside of a range, for rounding."""


def with_bounds(
    response: Response, plain: Response, model: Model, candidates: Sequence[Candidate]
) -> Response:
    """The response with its bounds as `bias`, from that without scattering, or the reason for none
    in `how`."""
    reason = outside(model)
    before = {key: entry.value for key, entry in plain.estimates().items()}
    tails = {
        pair.name: _log_crossings(candidate)
        for pair, candidate in zip(model.pairs, candidates, strict=True)
    }

    def explained(owner: str, name: str, entry: Estimate) -> Estimate:
        if entry.bias is not None:
            return entry
        if reason:
            return replace(entry, how=f"{entry.how}; no error bound: {reason}")
        quantity = name.removeprefix("relative_")
        size = _log_bound(quantity, entry.value, before.get((owner, name)), tails.get(owner, 0.0))
        if size is None:
            return replace(entry, how=f"{entry.how}; no error bound: not calibrated")
        bound = math.expm1(size) * abs(entry.value)
        return replace(entry, bias=bound, how=f"{entry.how}; error bound from random structures")

    def record(owner: str, known: Any) -> Any:
        found = {
            name: explained(owner, name, each)
            for name, each in known.items()
            if isinstance(each, Estimate)
        }
        return replace(known, **found)

    return replace(
        response,
        coordinates={name: record(name, each) for name, each in response.coordinates.items()},
        impact_pairs={name: record(name, each) for name, each in response.impact_pairs.items()},
    )


def _log_bound(name: str, value: float, before: float | None, tail: float) -> float | None:
    """Bound on the error of the logarithm of a quantity; None where none is known."""
    if name not in FACTORS or before is None or not (value > 0.0 and before > 0.0):
        return None
    far = 1.0 if name.endswith("_std") else math.sqrt(1.0 + tail)
    size = FACTORS[name] * (FLOOR + abs(math.log(value / before))) * far
    return size if size <= LARGEST else None


def _log_crossings(candidate: Candidate) -> float:
    """Logarithm of the crossings of the mean per impact, by a normal distribution; at least 0."""
    impacts = sum(hits.rate for hits in candidate.hits.values())
    speed = math.sqrt(candidate.velocity_mean_square / candidate.variance)
    crossings = len(candidate.hits) * speed / ROOT_TWO_PI**2
    return max(math.log(crossings / impacts), 0.0) if impacts > 0.0 else math.inf


def outside(model: Model) -> str:
    """Why a structure is none of those on which the bounds were calibrated; empty if it is one."""
    modes = model.modal
    free = linear_law(modes)
    if free is None or np.any(model.constant_force) or model.functions:
        return "structures that drift, with loads or with functions were not compared"
    if not MODES[0] <= modes.size <= MODES[1] or len(model.pairs) > PAIRS:
        return f"structures of {MODES[0]} to {MODES[1]} modes with 1 or {PAIRS} pairs were compared"
    ratios = np.diag(modes.damping) / (2.0 * np.sqrt(modes.squares))
    if not all(_within(float(ratio), DAMPING_RATIO) for ratio in ratios):
        low, high = DAMPING_RATIO
        return f"modes of damping ratios {low:g} to {high:g} were compared"
    for pair, row in zip(model.pairs, modes.gaps, strict=True):
        if reason := _outside_of_pairs(pair, row, modes, free):
            return reason
    if len(model.pairs) == PAIRS and _correlation(modes, free) > TOGETHER:
        return "the two gaps move together, and the closure cuts each at its own stops alone"
    return ""


def _outside_of_pairs(pair: Pair, row: Vector, modes: ModalForm, free: LinearLaw) -> str:
    deviation = math.sqrt(free.variances(row, 0))
    stiffness = 1.0 / float(row @ (row / modes.squares))
    for stop in pair.stops:
        if not _within(stop.distance / deviation, DISTANCE):
            return "stops at {:g} to {:g} deviations of their gap were compared".format(*DISTANCE)
        if not _compared(stop, stiffness):
            return (
                f"rigid stops of R from {LEAST_RESTITUTION:g} were compared, and linear ones of "
                f"damping ratios up to {MOST_DAMPED:g}, at least {SOFTEST:g} times as stiff as the "
                "structure at their place"
            )
    return ""


def _compared(stop: Stop, stiffness: float) -> bool:
    """Whether the law of a stop at a place of this static stiffness is one of those compared."""
    law = stop.law
    if law.friction_coefficient:
        return False
    if law.rigid:
        return stop.coefficient is not None and stop.coefficient >= LEAST_RESTITUTION
    ratio = law.damping_ratio if isinstance(law, Viscoelastic) else 0.0
    hard = isinstance(law, Elastic | Viscoelastic) and law.stiffness >= SOFTEST * stiffness
    return hard and ratio <= MOST_DAMPED


def _within(value: float, limits: tuple[float, float]) -> bool:
    return limits[0] * (1.0 - ROUNDING) <= value <= limits[1] * (1.0 + ROUNDING)


def _correlation(modes: ModalForm, free: LinearLaw) -> float:
    """Size of the correlation of the first two gaps without stops."""
    part = slice(0, modes.size)
    shared = modes.gaps[:2] @ free.covariance[part, part] @ modes.gaps[:2].T
    return float(abs(shared[0, 1]) / math.sqrt(shared[0, 0] * shared[1, 1]))
