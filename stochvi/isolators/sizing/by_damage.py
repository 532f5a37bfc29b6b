"""The smallest clearances at which stops multiply the damage of equipment by no more than a ratio.

Stops of several pairs are equally far in rms motions of their gaps. What stops add to the damage
falls with the clearance as their impacts do: the logarithm of the ratio less 1 is nearly straight
in the square of the clearance. Every clearance that is tried has the same random numbers.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple, Unpack

import numpy as np

from stochvi.isolators.moved_stops import at_clearances
from stochvi.isolators.record_verdict import record_verdict
from stochvi.isolators.sizing.answer import Clearance
from stochvi.isolators.sizing.damage_answer import DamageSizing
from stochvi.mathematics.arrays import Vector
from stochvi.model.calculations import calculation
from stochvi.model.coverage import modulated, nonlinear
from stochvi.model.free_motion import free_motion
from stochvi.model.model import model_of
from stochvi.results.deadline import partial_result
from stochvi.results.errors import NotApplicable
from stochvi.results.estimates import provenance
from stochvi.sampling.options import AccuracyOptions
from stochvi.sampling.run import Run, sampled
from stochvi.scenes.scene import Scene
from stochvi.statistics.damage import Damage, damage

FIRST_SIGMA, LEAST_SIGMA = 3.5, 0.5
"""The first clearance that is tried and the smallest one, in rms displacements."""

MOST_TRIALS = 12
"""Largest number of clearances that are tried."""

NEAR = 0.2
"""Logarithm of the added damage over the accepted one from which the clearance is extrapolated."""

LEAST_ADDED = 1e-6
"""Added damage that counts as none, over that without stops."""

LONGEST_STEP = 3.0
"""Largest change of the logarithm of the added damage that a step of the search aims at."""


class _Trial(NamedTuple):
    """Damage at a clearance, of several pairs that of the widest gap: the logarithm of what stops
    add over what they may, and half its 95 % interval."""

    clearance: float
    found: Damage
    excess: float
    half: float

    @property
    def worst(self) -> int:
        """Number of the frequency with the largest ratio."""
        assert self.found.damage_ratio is not None
        return int(np.argmax(self.found.damage_ratio.value))


@calculation
@sampled(rel_error=0.1)
def size_by_damage(
    scene: Scene,
    *,
    ratio: float = 2.0,
    mission: float = 3600.0,
    equipment: Sequence[float] | Vector = (20.0, 2000.0),
    q: float = 10.0,
    exponent: float = 6.0,
    at: str | None = None,
    **options: Unpack[AccuracyOptions],
) -> DamageSizing:
    """The smallest clearance at which stops keep the damage of equipment below a ratio.

    Parameters
    ----------
    scene
        A linear structure under stationary Gaussian noise between stops, whose laws are kept; their
        places are not. Several pairs get equal clearances in rms motions of their gaps.
    ratio
        Largest accepted damage with stops over that without, at all frequencies of the equipment.
    mission
        Duration, s.
    equipment, q, exponent, at
        As for `damage`.
    **options
        `AccuracyOptions`: `rel_error` is the median relative standard error of the damage at every
        clearance, by default 0.1.

    Returns
    -------
    DamageSizing
        The clearance of each pair, its interval, and the clearances that were tried.

    Raises
    ------
    NotApplicable
        If the scene is not covered, or any clearance keeps the ratio.
    NotConverged
        If time ends first.

    See Also
    --------
    stochvi.damage : The damage of a scene as it stands.
    stochvi.size : The clearance for a risk.

    Examples
    --------
    >>> from stochvi import ImpactPair, Isolator, TabulatedNoise, Viscoelastic
    >>> law = Viscoelastic(stiffness=2e5, damping_ratio=0.2)
    >>> truck = TabulatedNoise(profile="mil-std-810h-truck-vertical-5hz")
    >>> mount = Isolator(frequency_hz=12.0, zeta=0.1, mass=1.0)
    >>> stops = ImpactPair(lower=-4e-3, upper=4e-3, law=law)
    >>> scene = Scene(structure=mount, impact_pairs=[stops], excitations=[truck])
    >>> found = size_by_damage(scene, ratio=2.0, equipment=[100.0], rel_error=0.3)
    >>> bool(3.0 < found.clearance.value / found.sigma < 6.0)
    True
    """
    import pandas as pd

    if not 1.0 < ratio < math.inf:
        raise ValueError(f"ratio must be above 1, got {ratio}; stops add to the damage")
    model, run = model_of(scene), Run.of(options)
    unmet = modulated(model) + nonlinear(model)
    if model.signals:
        got = "a sine" if model.sines else "filtered noise"
        unmet.append(f"excitation must be white noise, a density or constant, got {got}")
    if not unmet and not model.pairs:
        unmet = ["damage_ratio needs an impact_pair, for its law"]
    if unmet:
        raise NotApplicable("size", unmet)
    names = [pair.name for pair in model.pairs]
    sigmas, _ = free_motion(model).deviations(np.array([pair.direction for pair in model.pairs]))
    if not sigmas.all():
        still = ", ".join(name for name, sigma in zip(names, sigmas, strict=True) if not sigma)
        raise NotApplicable("size", [f"excitation must move the gap of every pair, not of {still}"])
    sigma = float(sigmas.max())
    shares = sigmas / sigma

    def tried_at(place: float, number: int) -> _Trial:
        done = number / MOST_TRIALS
        share = run.deadline.share(1.0 / max(MOST_TRIALS // 2 - number, 2))
        part = run.part(done, done + 1.0 / MOST_TRIALS, f"{1e3 * place:.4g} mm", share)
        found: Damage = partial_result(
            damage, at_clearances(scene, place * shares), mission=mission, equipment=equipment, q=q,
            exponent=exponent, at=at, **part.options(rel_error=run.accuracy),
        )  # fmt: skip
        return _trial(place, found, ratio)

    trials, slope = _search(tried_at, sigma, run)
    nearest = min(trials, key=lambda trial: abs(trial.excess))
    per_metre = 2.0 * nearest.clearance * slope
    value = nearest.clearance - nearest.excess / per_metre
    half = nearest.half / abs(per_metre)
    rows = [
        {"clearance": each.clearance, "damage_ratio": ratios.value[each.worst],
         "standard_error": ratios.standard_error[each.worst],
         "frequency_hz": each.found.equipment_frequency_hz[each.worst], "by": each.found.way}
        for each in sorted(trials, key=lambda trial: trial.clearance)
        if (ratios := each.found.damage_ratio) is not None
    ]  # fmt: skip
    ends = np.outer(shares, [value, max(value - half, 0.0), value + half]).tolist()
    clearances = {
        name: Clearance(value=place, lower=low, upper=high)
        for name, (place, low, high) in zip(names, ends, strict=True)
    }
    answer = DamageSizing(
        scene=scene, ratio=ratio, mission=mission, sigma=sigma, clearances=clearances,
        tried=pd.DataFrame(rows), damage=nearest.found, record=record_verdict(scene),
        warnings=[*nearest.found.warnings, *scene.at_means()],
        cost=run.cost(), provenance=provenance(scene.document(), run.seed),
    )  # fmt: skip
    if abs(nearest.excess) > NEAR:
        raise run.deadline.fell_short(
            f"before a ratio near {ratio:g} was seen ({len(trials)} clearances tried)",
            "raise budget", answer,
        )  # fmt: skip
    return answer


def _trial(place: float, found: Damage, ratio: float) -> _Trial:
    ratios = found.damage_ratio
    if ratios is None:
        raise NotApplicable(
            "size", ["the motion without stops must be stationary, to compare the damage with"]
        )
    worst = max(ratios.estimates(), key=lambda each: each.value)
    added = max(worst.value - 1.0, LEAST_ADDED)
    return _Trial(place, found, math.log(added / (ratio - 1.0)), worst.half_width_95() / added)


def _search(tried_at: Any, sigma: float, run: Run) -> tuple[list[_Trial], float]:
    """The clearances that were tried, and the slope of the excess over the square of the
    clearance."""
    place, slope = FIRST_SIGMA * sigma, -1.0 / (2.0 * sigma**2)
    trials: list[_Trial] = []
    for number in range(MOST_TRIALS):
        if trials and run.deadline.passed():
            break
        trial = tried_at(place, number)
        trials.append(trial)
        above = [each for each in trials if each.excess > 0.0]
        below = [each for each in trials if each.excess <= 0.0]
        if above and below:
            low = max(above, key=lambda each: each.clearance)
            high = min(below, key=lambda each: each.clearance)
            if high.clearance > low.clearance and high.excess > math.log(LEAST_ADDED):
                slope = (high.excess - low.excess) / (high.clearance**2 - low.clearance**2)
        if abs(trial.excess) <= NEAR:
            break
        step = max(min(trial.excess, LONGEST_STEP), -LONGEST_STEP)
        square = max(place**2 - step / slope, (LEAST_SIGMA * sigma) ** 2)
        if above and below:
            ends = low.clearance**2, high.clearance**2
            square = min(max(square, 0.9 * ends[0] + 0.1 * ends[1]), 0.1 * ends[0] + 0.9 * ends[1])
        elif trial.excess < 0.0 and place <= LEAST_SIGMA * sigma * 1.01:
            raise NotApplicable(
                "size", [f"ratio must be smaller: {LEAST_SIGMA:g} rms displacements keep it"]
            )
        place = math.sqrt(square)
    return trials, slope
