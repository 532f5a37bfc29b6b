"""The probability of a first impact by counting missions of the motion without stops."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stochvi.mathematics.arrays import Matrix
from stochvi.methods.monte_carlo.history_plans import HistoryPlan, plan_histories
from stochvi.model.model import Model
from stochvi.results.errors import NotApplicable
from stochvi.results.estimates import Estimate
from stochvi.results.intervals import binomial_interval
from stochvi.sampling.sampler import ListSampler
from stochvi.scenes.scene import Scene
from stochvi.statistics.reliability.answer import Chance
from stochvi.statistics.reliability.choice import Jobs

SAMPLES_PER_PERIOD = 24.0
"""Samples in a period of the fastest motion: a peak between two of them may be 0.9 % higher, and is
found by a parabola."""

FEWEST_MISSIONS = 64
"""Smallest number of missions that are counted."""

MOST_SAMPLES = 2**20
"""Largest number of samples of a mission."""


@dataclass(frozen=True, eq=False)
class MissionsWithoutStops(ListSampler):
    """Missions without stops, and whether any gap of the pairs of `model` closes in them."""

    plan: HistoryPlan
    model: Model
    kept: tuple[str, ...]
    seed: int

    @property
    def block(self) -> int:
        """Number of missions that are made together."""
        return self.plan.block

    def simulate(self, first_path: int, paths: int) -> NDArray[np.bool_]:
        """Whether each mission is hit by its samples, and by every second of them (2, paths)."""
        moved = self.plan.histories(self.seed, first_path, paths).displacement
        hit = np.zeros((2, paths), bool)
        for pair in self.model.pairs:
            if pair.name in self.kept:
                gap = np.tensordot(pair.direction, moved, axes=1)
                for stop in pair.stops:
                    for row, stride in enumerate((1, 2)):
                        reached = highest(stop.side * gap[:, ::stride])
                        hit[row] |= reached > stop.side * stop.position
        return hit

    def add_up(self, pieces: list[NDArray[np.bool_]]) -> list[NDArray[np.bool_]]:
        """The pieces."""
        return pieces

    def paths(self, sample: list[NDArray[np.bool_]]) -> int:
        """Number of missions."""
        return sum(each.shape[1] for each in sample)


def highest(records: Matrix) -> NDArray[np.float64]:
    """Highest point of each record (paths, samples), by parabolas through its highest samples."""
    before, at, after = records[:, :-2], records[:, 1:-1], records[:, 2:]
    bend = np.maximum(2.0 * at - before - after, np.finfo(float).tiny)
    peak = np.where(
        (at >= before) & (at >= after), at + (after - before) ** 2 / (8.0 * bend), -np.inf
    )
    ends = np.maximum(records[:, 0], records[:, -1])
    return np.asarray(np.maximum(peak.max(axis=1, initial=-np.inf), ends))


def counted_hits(
    scene: Scene, model: Model, pairs: Sequence[str], mission: float, jobs: Jobs
) -> Chance:
    """P(any of the pairs is hit) in the stationary motion, by missions that are simulated."""
    started = time.process_time()
    plan = plan_histories(scene.replace(impact_pairs=()), jobs.deadline)
    step = 2.0 * math.pi / (SAMPLES_PER_PERIOD * plan.fastest)
    if mission / step > MOST_SAMPLES:
        raise NotApplicable(
            "reliability",
            [
                f"shocks that meet are counted in whole missions of at most {MOST_SAMPLES} "
                f"samples, got {mission / step:.3g}; ask for a mission of at most "
                f"{MOST_SAMPLES * step:.3g} s"
            ],
        )
    sampler = MissionsWithoutStops(
        plan.sampled(min(step, plan.step), mission), model, tuple(pairs), jobs.run.seed
    )
    plan.plan.shortest().histories(jobs.run.seed, 0, 2, samples=2)  # compiled, off the clock

    def counts(sample: list[NDArray[np.bool_]]) -> tuple[int, int, int]:
        both = np.concatenate(sample, axis=1)
        return both.shape[1], int(both[0].sum()), int(both[1].sum())

    def error(sample: list[NDArray[np.bool_]]) -> float:
        missions, hit, _ = counts(sample)
        return math.sqrt((1.0 - hit / missions) / hit) if hit else math.inf

    taken = jobs.run.to_accuracy(
        sampler, FEWEST_MISSIONS, error, jobs.rel_error, deadline=jobs.deadline, needed=2
    )
    missions, hit, seldom = counts(taken.sample)
    share = hit / missions
    lower, upper = binomial_interval(hit, missions, jobs.confidence)
    spread = math.sqrt(max(share * (1.0 - share), 1.0 / missions) / missions)
    how = f"{missions} missions without stops"
    return Chance(
        event="hit", limit=None,
        estimate=Estimate(
            value=share, standard_error=spread if hit else 0.0,
            bias=abs(hit - seldom) / missions if hit else None,
            upper_95=None if hit else upper, how=how,
        ),
        lower=lower, upper=upper, confidence=jobs.confidence,
        rule="exact binomial interval (Clopper and Pearson)", way="missions",
        why="shocks meet: each acts while the motion after the one before it is remembered",
        trials=missions, seconds=time.process_time() - started,
    )  # fmt: skip
