"""Statistics of impacts by Monte Carlo, from every impact of independent paths.

Slow impacts on a stop of restitution R under white noise have speeds of density w^(1 - beta), beta
from R (`collisions.corner_exponent`), Rayleigh's law at R = 1 being the case beta = 0. They come in
bursts, and so do impacts of a light resonance: counts scatter more than Poisson's, and an interval
from their number alone is too narrow. Intervals come from independent paths, therefore, unless the
dispersion of the counts allows Poisson's exact ones.
"""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from stochvi.assemblies import Assembly, Contact, assemble
from stochvi.collisions import COLLAPSE_RESTITUTION, corner_exponent
from stochvi.errors import NotApplicable
from stochvi.estimates import Cost, Estimate, provenance
from stochvi.first_crossings import first_crossings
from stochvi.impact_statistics.answer import Exponent, ImpactStatistics, PairStatistics
from stochvi.impact_statistics.predictions import linear_gap, rice_rates, vanmarcke_rate
from stochvi.impact_statistics.tallies import (
    BINS,
    WINDOWS,
    Grid,
    Rate,
    Tally,
    dispersion,
    fitted_exponent,
    histogram,
    merged,
    passes_for_poisson,
    rate,
    ratio,
)
from stochvi.monte_carlo.impact_logs import ImpactPlan, plan_impacts
from stochvi.monte_carlo.runs import compiling
from stochvi.scenes import Scene

Vector = NDArray[np.float64]
Progress = Callable[[float, str], None]

SLOWEST_SHARE, FASTEST_SHARE = 0.01, 10.0
"""Speeds that a histogram holds, in rms speeds; from the threshold if that is more."""

FIT_FROM, FIT_RANGE = 0.02, 6.0
"""Exponents are fitted from the threshold, at least this share of the rms speed, to speeds so many
times as large, and to half of that."""

RESOLVED_EXPONENT = 0.8
"""Restitution from which on an exponent is free of the steps near a stop. These are a share of the
time in which noise changes a slow mass, at any speed, so that they shift the power itself: at a
stop in the rest position by +0.09 at R = 0.5 and +0.13 at 0.3, by less than 0.01 at 0.8. (At steps
a quarter as long it was 0.001(7) at R = 0.5.)"""

FEWEST_FITTED = 100
"""Impacts in the shorter range for an exponent to be fitted."""

FEWEST_PATHS = 64
"""For an honest standard error."""

FEWEST_HITS = 30
"""For a dispersion; with fewer the counts tell nothing against Poisson."""


def impacts(
    scene: Scene,
    *,
    rel_error: float = 0.02,
    paths: int | None = None,
    duration: float | None = None,
    speed_threshold: float | None = None,
    slow_impacts: bool = False,
    first_hits: bool = False,
    seed: int = 0,
    threads: int | None = None,
    budget: float | None = 60.0,
    progress: Progress | None = None,
) -> ImpactStatistics:
    """Rates, intervals, speeds, energy and clusters of the impacts of every pair.

    Parameters
    ----------
    scene
        Any scene with an impact pair that `simulate` covers.
    rel_error, paths
        Relative standard error of every pair's rate to reach, or instead the number of paths.
    duration
        Seconds counted of a path, in eight windows for the dispersion.
    speed_threshold
        Slowest impacts that count, m/s; by default 0, or 5 % of the rms speed where stops lose
        energy.
    slow_impacts
        Resolve impacts down to the threshold at lossy stops, as in `simulate`.
    first_hits
        Simulate first crossings, too, for the rate of first hits without stops (one oscillator
        under Gaussian noise, a pair about its mean).
    budget
        Seconds after which it ends with larger errors and a warning.

    Raises
    ------
    NotApplicable
        If the scene has no impact pair, or is none that `simulate` covers.

    Examples
    --------
    >>> from stochvi.contacts import Restitution
    >>> from stochvi.excitations import WhiteNoise
    >>> from stochvi.scenes import ImpactPair
    >>> from stochvi.structures import Oscillator
    >>> scene = Scene(
    ...     structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
    ...     impact_pairs=[ImpactPair(lower=-1.0, upper=1.0, law=Restitution(coefficient=1.0))],
    ...     excitations=[WhiteNoise(intensity=0.2)],
    ... )
    >>> found = impacts(scene).pairs["stops"].rates["both"].estimate
    >>> abs(found.value - 0.2828) < 4.5 * found.standard_error + 1e-4
    True
    """
    _check_arguments(rel_error, paths, seed, threads, budget)
    started = time.perf_counter()
    plan = plan_impacts(scene, speed_threshold, duration, slow_impacts)
    assembly = assemble(scene)
    grids = {
        contact.name: _grid(plan, contact, contact.name) for contact in assembly.contacts
    }  # fmt: skip
    with compiling(progress):
        plan.impacts(seed, 0, 1)
    workers = threads or len(os.sched_getaffinity(0))
    found: dict[str, list[Tally]] = {name: [] for name in grids}
    warnings: list[str] = []
    done, target = 0, max(plan.block, FEWEST_PATHS) if paths is None else paths
    with ThreadPoolExecutor(workers) as pool:
        while True:
            blocks = [
                (first, min(plan.block, target - first))
                for first in range(done, target, plan.block)
            ]
            # a round is cut where the clock is looked at: after each thread has done one block
            for k in range(0, len(blocks), workers):
                if done >= FEWEST_PATHS and _late(started, budget):
                    break
                for tallies in pool.map(
                    lambda block: _block(plan, grids, seed, *block), blocks[k : k + workers]
                ):
                    for name, tally in tallies.items():
                        found[name].append(tally)
                        # all pairs have the same paths
                done = sum(len(tally.numbers) for tally in next(iter(found.values())))
            error = max(_rate_error(merged(tallies), plan) for tallies in found.values())
            if progress:
                progress(min(1.0, (rel_error / error) ** 2), f"{done} paths")
            if paths is not None or error <= rel_error:
                break
            if _late(started, budget):
                warnings.append(f"ended by the budget of {budget:g} s at a relative {error:.2g}")
                break
            target = done + math.ceil(done * min(1.1 * (error / rel_error) ** 2 - 1.0, 3.0))
            target = math.ceil(target / plan.block) * plan.block
    pairs = {
        contact.name: _pair(
            scene, assembly, contact, plan, grids[contact.name], merged(found[contact.name]),
            first_hits, seed, threads,
        )
        for contact in assembly.contacts
    }  # fmt: skip
    return ImpactStatistics(
        pairs=pairs,
        duration=plan.duration,
        window=plan.duration / WINDOWS,
        step=plan.step,
        each=plan.each,
        energy_unit="J" if scene.structure.mass is not None else "J/kg",
        assumptions=scene.assumptions(),
        warnings=(*warnings, *_warnings(plan, assembly)),
        cost=Cost(
            wall_time=time.perf_counter() - started,
            impacts=round(sum(t.numbers.sum() for tallies in found.values() for t in tallies)),
            steps=round(done * plan.duration / plan.step),
            paths=done,
            threads=workers,
        ),
        provenance=provenance(scene.document(), seed),
    )


def _check_arguments(
    rel_error: float, paths: int | None, seed: int, threads: int | None, budget: float | None
) -> None:
    if not 1e-6 <= rel_error < 1.0:
        raise ValueError(f"rel_error must be in [1e-6, 1), got {rel_error}")
    if paths is not None and paths < 2:
        raise ValueError(f"paths must be at least 2 for a standard error, got {paths}")
    if threads is not None and threads < 1:
        raise ValueError(f"threads must be at least 1, got {threads}")
    if not 0 <= seed < 2**63:
        raise ValueError(f"seed must be in [0, 2^63), got {seed}")
    if budget is not None and not 0.0 < budget < math.inf:
        raise ValueError(f"budget must be a positive number of seconds, got {budget}")


def _late(started: float, budget: float | None) -> bool:
    return budget is not None and time.perf_counter() - started > budget


def _block(
    plan: ImpactPlan, grids: dict[str, Grid], seed: int, first: int, paths: int
) -> dict[str, Tally]:
    """One task: the impacts of some paths, counted and let go."""
    logs = plan.impacts(seed, first, paths)
    return {name: Tally.of(log, paths, grids[name]) for name, log in logs.items()}


def _grid(plan: ImpactPlan, contact: Contact, name: str) -> Grid:
    rms, threshold = plan.speeds[name], plan.thresholds[name]
    slowest = max(threshold, SLOWEST_SHARE * rms)
    start = max(threshold, FIT_FROM * rms)
    shortest = max(2.0 * plan.step, 1e-3 * plan.relaxation)
    losses = dict.fromkeys(("lower", "upper"), 0.0) | {
        side: 0.5 * contact.mass * (1.0 - law.restitution**2) for side, _, law in contact.stops
    }
    return Grid(
        speeds=np.geomspace(slowest, FASTEST_SHARE * rms, BINS + 1),
        intervals=np.geomspace(shortest, max(plan.duration, 10.0 * shortest), BINS + 1),
        fits=((start, start * FIT_RANGE), (start, start * FIT_RANGE / 2.0)),
        window=plan.duration / WINDOWS,
        losses=(losses["lower"], losses["upper"]),
    )


def _rate_error(tally: Tally, plan: ImpactPlan) -> float:
    """Relative standard error of the rate of both stops; that of what is hardly hit is not
    governed."""
    numbers = tally.numbers.sum(axis=1)
    if numbers.sum() == 0.0:
        return 0.0
    value, error = ratio(numbers, np.full(len(numbers), plan.duration))
    return error / value


def _pair(
    scene: Scene, assembly: Assembly, contact: Contact, plan: ImpactPlan, grid: Grid,
    tally: Tally, first_hits: bool, seed: int, threads: int | None,
) -> PairStatistics:  # fmt: skip
    numbers = tally.numbers.sum(axis=1)
    hits = float(numbers.sum())
    how = f"{len(numbers)} paths of {plan.duration:.4g} s"
    spread = dispersion(tally.windows, grid.window) if hits >= FEWEST_HITS else None
    poisson = passes_for_poisson(spread)
    rates: dict[str, Rate] = {
        side: rate(tally.numbers[:, 0 if side == "lower" else 1], plan.duration, poisson, how)
        for side, _, _ in contact.stops
    }
    rates["both"] = rate(numbers, plan.duration, poisson, how)
    gap = linear_gap(scene, assembly, contact)
    square = ratio(tally.squares.sum(axis=1), numbers) if hits else None
    loss = ratio(tally.energies.sum(axis=1), numbers) if hits else None
    return PairStatistics(
        speed_threshold=plan.thresholds[contact.name],
        rates=rates,
        dispersion=spread,
        speeds=histogram(tally.speeds, grid.speeds) if hits else None,
        intervals=histogram(tally.intervals, grid.intervals) if tally.intervals.any() else None,
        speed_rms=None if square is None else _root(square, how),
        exponents=_exponents(assembly, contact, tally, grid),
        energy=None
        if loss is None
        else Estimate(value=loss[0], standard_error=loss[1], bias=None, how=how),
        rice_rates=None if gap is None else rice_rates(gap, contact),
        clump_rate=None if gap is None else vanmarcke_rate(gap, contact),
        first_hit_rate=_first_hits(scene, contact, gap.mean, seed, threads)
        if first_hits and gap is not None
        else None,
    )


def _root(square: tuple[float, float], how: str) -> Estimate:
    value = math.sqrt(square[0])
    return Estimate(value=value, standard_error=square[1] / (2.0 * value), bias=None, how=how)


def _exponents(
    assembly: Assembly, contact: Contact, tally: Tally, grid: Grid
) -> dict[str, Exponent]:
    """Of both stops together where they have one restitution, else of each."""
    restitutions = {side: law.restitution for side, _, law in contact.stops}
    if len(set(restitutions.values())) == 1:
        groups = {"both": (tally.fits.sum(axis=1), next(iter(restitutions.values())))}
    else:
        groups = {
            side: (tally.fits[:, 0 if side == "lower" else 1], r)
            for side, r in restitutions.items()
        }
    white = len(assembly.coordinates) == 1 and np.any(assembly.white) and not assembly.not_rigid()
    return {
        side: Exponent(
            fitted=_fitted(fits, grid, resolved=r >= RESOLVED_EXPONENT or not white),
            theory=1.0 - corner_exponent(r) if white else None,
        )
        for side, (fits, r) in groups.items()
        if fits[:, 1, 0].sum() >= FEWEST_FITTED
    }


def _fitted(fits: NDArray[np.float64], grid: Grid, resolved: bool) -> Estimate:
    found = fitted_exponent(fits, grid.fits)
    return found if resolved else replace(found, bias=None)


def _first_hits(
    scene: Scene, contact: Contact, mean: float, seed: int, threads: int | None
) -> Estimate | None:
    """Limiting rate of first crossings of the stops without them; None where it does not apply."""
    lower = None if contact.lower is None else mean - contact.lower
    upper = None if contact.upper is None else contact.upper - mean
    try:
        found = first_crossings(scene, lower=lower, upper=upper, seed=seed, threads=threads)
    except (NotApplicable, ValueError):  # a scene, or stops, that it does not cover
        return None
    chance = found.probability(found.horizon)[0]
    # where hardly any motion outlasts the memory there is no limiting rate to be seen
    hardly = (chance.bias or 0.0) >= 1.0 - chance.value
    return None if hardly else found.first_rate()[0]


def _warnings(plan: ImpactPlan, assembly: Assembly) -> list[str]:
    found = []
    if not plan.each:
        found.append(
            f"impacts within one step of {plan.step:.3g} s count as one, at their summed speed"
        )
    for contact in assembly.contacts:
        threshold = plan.thresholds[contact.name]
        if threshold > 0.0:
            found.append(f"{contact.name}: only impacts faster than {threshold:.3g} m/s count")
        if any(law.rigid and law.restitution <= COLLAPSE_RESTITUTION
               for _, _, law in contact.stops):  # fmt: skip
            found.append(
                f"{contact.name}: at a restitution up to {COLLAPSE_RESTITUTION:.4f} the rate of "
                "all impacts is infinite: everything here hangs on the threshold"
            )
    return found
