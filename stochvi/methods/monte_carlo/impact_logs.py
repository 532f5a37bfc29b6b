"""Logs of every impact in a block of paths: its time, its pair and its speed."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from stochvi.engine.impact_log import COLUMNS, Log
from stochvi.mathematics.arrays import Matrix, Vector
from stochvi.methods.monte_carlo.choose_plan import make_plan
from stochvi.methods.monte_carlo.history_plans import histories_of
from stochvi.methods.monte_carlo.kernels.flight import CORNER_SHARE
from stochvi.methods.monte_carlo.plan import Plan, losses_of
from stochvi.model.model import UPPER, Pair, model_of
from stochvi.results.deadline import NEVER, Deadline
from stochvi.results.errors import NotApplicable
from stochvi.scenes.impact_laws import RigidLaw
from stochvi.scenes.scene import Scene

Made = TypeVar("Made")

FIRST_ROWS = 2**20
"""Number of impacts that the first log of a block holds; if there are more, the block is simulated
again with a log of the right size."""


@dataclass(frozen=True, kw_only=True)
class ImpactLog:
    """Impacts of one pair in a block of paths, by path and then by time.

    `path` is the number of the path within the block; `time` is in seconds from the start of the
    counted part; `speed`, m/s, is negative at the lower stop. On a compliant stop an impact is
    the first touch. `lost` is the energy that each one takes, J, where it was asked for: on a
    compliant stop the work of its force.
    """

    path: NDArray[np.int64]
    time: Vector
    speed: Vector
    lost: Vector | None = None

    def kept(self, which: NDArray[Any]) -> ImpactLog:
        """Some of the impacts."""
        lost = None if self.lost is None else self.lost[which]
        return ImpactLog(
            path=self.path[which], time=self.time[which], speed=self.speed[which], lost=lost
        )


@dataclass(frozen=True, kw_only=True)
class ImpactPlan:
    """The plan by which the impacts of a scene are logged one by one.

    `relaxation` is the relaxation time of the energy, s; `fastest` the largest frequency of the
    motion, rad/s; `speeds` are the rms speeds of the pairs, m/s; `corner_share` is that of
    `rigid_white.WhitePlan` where slow impacts are resolved, else None.
    """

    source: Plan
    thresholds: dict[str, float]
    relaxation: float
    fastest: float
    speeds: dict[str, float]
    corner_share: float | None

    @property
    def duration(self) -> float:
        """Counted seconds of a path."""
        return self.source.steps * self.source.step

    @property
    def step(self) -> float:
        """Step of the motion, s; impacts are found within it."""
        return self.source.step

    @property
    def block(self) -> int:
        """Number of paths that are simulated together."""
        return self.source.block

    def impacts(self, seed: int, first_path: int, paths: int) -> dict[str, ImpactLog]:
        """Impacts of the paths first_path, first_path + 1, ..., by pair, with what they take."""
        source = self.source
        averages, logs = logged_impacts(
            lambda log: source.averages(seed, first_path, paths, log=log),
            self.thresholds,
            energies=True,
        )
        whole, found = losses_of(source.model, source.layout, averages, self.duration), {}
        for pair, lost in zip(source.model.pairs, whole, strict=True):
            every = with_losses(pair, logs[pair.name], lost)
            found[pair.name] = every.kept(np.abs(every.speed) >= self.thresholds[pair.name])
        return found


def with_losses(pair: Pair, log: ImpactLog, whole: Matrix) -> ImpactLog:
    """The impacts of a pair, in a log with `energies`, with the energy that each of them takes.

    The stops take the energies `whole` (2, paths) in the paths, J.
    """
    assert log.lost is not None
    for stop in pair.stops:
        own = np.flatnonzero(np.sign(log.speed) == stop.side)
        speed, path = np.abs(log.speed[own]), log.path[own]
        if isinstance(stop.law, RigidLaw):
            kept = stop.restitution_square_at(speed)
            log.lost[own] = 0.5 * pair.mass * (1.0 - kept) * speed**2
            continue
        # what the stop has taken until the next impact on it
        before, after = pair.mass * log.lost[own], whole[int(stop.side == UPPER)][path]
        follows = np.flatnonzero(np.diff(path) == 0)
        after[follows] = before[follows + 1]
        log.lost[own] = after - before
    return log


def logged_impacts(
    simulate: Callable[[Log], Made], pairs: Iterable[str], *, energies: bool = False
) -> tuple[Made, dict[str, ImpactLog]]:
    """Result of `simulate` with a log that is long enough, and the impacts in it by pair.

    Parameters
    ----------
    simulate
        Simulates the same paths in every call, and writes their impacts into the log.
    pairs
        Names of all pairs, in their order.
    energies
        Whether `lost` gets the energy that a compliant stop has taken before each impact, per unit
        of the reduced mass. Slow impacts on such stops are then logged as well.
    """
    rows = FIRST_ROWS
    while True:
        taken = np.zeros(rows if energies else 0)
        log = Log(np.empty((rows, COLUMNS)), np.zeros(1, np.int64), 0.0, taken)
        made = simulate(log)
        count = int(log.count[0])
        if count <= rows:
            break
        rows = count
    # the log holds all paths step by step: a stable sort keeps the order in time of each
    order = np.argsort(log.events[:count, 0], kind="stable")
    path, number, time, speed = log.events[order].T
    every = ImpactLog(
        path=path.astype(np.int64), time=time, speed=speed, lost=taken[order] if energies else None
    )
    found = {name: every.kept(number == pair) for pair, name in enumerate(pairs)}
    return made, found


def plan_impacts(
    scene: Scene,
    speed_threshold: float | None = None,
    duration: float | None = None,
    slow_impacts: bool = False,
    corner_share: float = CORNER_SHARE,
    deadline: Deadline = NEVER,
) -> ImpactPlan:
    """The plan to log the impacts of a scene with an impact pair that `simulate` covers.

    `corner_share` is that of `WhitePlan`, where `slow_impacts` are resolved.

    Examples
    --------
    >>> from stochvi.scenes.impact_laws import Restitution
    >>> from stochvi.scenes.excitations import WhiteNoise
    >>> from stochvi.scenes.scene import ImpactPair
    >>> from stochvi.scenes.structures import Oscillator
    >>> scene = Scene(
    ...     structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
    ...     impact_pairs=[ImpactPair(upper=1.0, law=Restitution(coefficient=0.8))],
    ...     excitations=[WhiteNoise(intensity=0.2)],
    ... )
    >>> log = plan_impacts(scene).impacts(seed=1, first_path=0, paths=2)["stops"]
    >>> bool((log.speed > 0.0).all())  # an upper stop alone
    True
    """
    model = model_of(scene)
    if not model.pairs:
        raise NotApplicable("impacts", ["the scene must have an impact pair, got none"])
    plan = make_plan(model, speed_threshold, duration, slow_impacts, corner_share, deadline)
    # whether no threshold, length or slow impacts are asked for
    usual = speed_threshold is None and duration is None and not slow_impacts
    histories = histories_of(plan if usual else make_plan(model, deadline=deadline))
    thresholds = dict(plan.layout.thresholds)
    return ImpactPlan(
        source=plan.unbroken(histories.duration if duration is None else duration),
        thresholds=thresholds,
        relaxation=histories.slowest,
        fastest=histories.fastest,
        speeds=dict(zip(thresholds, plan.speeds, strict=True)),
        corner_share=corner_share if slow_impacts else None,
    )
