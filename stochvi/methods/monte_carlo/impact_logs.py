"""Every impact of a block of paths, one by one: when, on which pair, how fast."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from stochvi.methods.monte_carlo.compliant import CompliantPlan
from stochvi.methods.monte_carlo.histories import HistoryPlan, plan_histories
from stochvi.methods.monte_carlo.modal import ModalPlan
from stochvi.methods.monte_carlo.plans import layout_of, make_plan
from stochvi.methods.monte_carlo.white import WhitePlan
from stochvi.results.errors import NotApplicable
from stochvi.scenes.scene import Scene

Vector = NDArray[np.float64]

FIRST_ROWS = 2**14
"""Impacts there is room for at first; where there are more the block is flown again."""


@dataclass(frozen=True, kw_only=True)
class ImpactLog:
    """Impacts of one pair in a block of paths, by path and then by time.

    `path` counts from the first of the block; `time` is the end of the step of the impact, s from
    the start of what is counted; `speed` is negative at the lower stop, m/s.
    """

    path: NDArray[np.int64]
    time: Vector
    speed: Vector


@dataclass(frozen=True, kw_only=True)
class ImpactPlan:
    """How impacts are had. Of one oscillator under white noise with rigid stops the kernel writes
    each down; else they are read from records, in which those of one step are one."""

    source: WhitePlan | HistoryPlan
    thresholds: dict[str, float]
    relaxation: float
    speeds: dict[str, float]

    @property
    def each(self) -> bool:
        """Whether every impact is seen, however soon after another."""
        return isinstance(self.source, WhitePlan)

    @property
    def corner_share(self) -> float | None:
        """That of `WhitePlan`, where slow impacts are resolved; else None."""
        if isinstance(self.source, WhitePlan) and self.source.slow_impacts:
            return self.source.corner_share
        return None

    @property
    def duration(self) -> float:
        """Counted seconds of a path."""
        if isinstance(self.source, WhitePlan):
            return self.source.steps * self.source.step
        return self.source.samples * self.source.step

    @property
    def step(self) -> float:
        """To which times are known, s."""
        return self.source.step

    @property
    def block(self) -> int:
        """Paths flown together."""
        return self.source.block

    def impacts(self, seed: int, first_path: int, paths: int) -> dict[str, ImpactLog]:
        """Those of the paths first_path, first_path + 1, ..., by pair."""
        if isinstance(self.source, WhitePlan):
            (name,) = self.thresholds
            return {name: self._logged(self.source, seed, first_path, paths)}
        found = {}
        histories = self.source.histories(seed, first_path, paths)
        for (name, threshold), speed in zip(
            self.thresholds.items(), histories.impact_speed, strict=True
        ):
            path, sample = np.nonzero((speed != 0.0) & (np.abs(speed) >= threshold))
            found[name] = ImpactLog(
                path=path,
                time=np.asarray(self.step * (sample + 1.0), dtype=float),
                speed=speed[path, sample],
            )
        return found

    def _logged(self, plan: WhitePlan, seed: int, first_path: int, paths: int) -> ImpactLog:
        rows, count = FIRST_ROWS, np.zeros(1, np.int64)
        while True:
            events = np.empty((rows, 3))
            count[0] = 0
            plan.averages(seed, first_path, paths, log=(events, count))
            if count[0] <= rows:
                break
            rows = int(count[0])
        events = events[: count[0]]
        # paths take turns from step to step: within one the order is that of time
        events = events[np.argsort(events[:, 0], kind="stable")]
        return ImpactLog(
            path=events[:, 0].astype(np.int64),
            time=np.asarray((events[:, 1] + 1.0) * self.step),
            speed=events[:, 2],
        )


def plan_impacts(
    scene: Scene,
    speed_threshold: float | None = None,
    duration: float | None = None,
    slow_impacts: bool = False,
    corner_share: float | None = None,
) -> ImpactPlan:
    """How impacts of a scene would be had; any scene with an impact pair that `simulate` covers.

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
    if not scene.expanded.impact_pairs:
        raise NotApplicable("impacts", ["the scene must have an impact pair, got none"])
    plan = make_plan(scene, speed_threshold, duration, slow_impacts)
    thresholds = dict(layout_of(scene, plan).thresholds)
    histories = plan_histories(scene)
    pairs = plan.pairs if isinstance(plan, ModalPlan) else ()
    rms = [pair.speed for pair in pairs] or [histories.speed]
    speeds = dict(zip(thresholds, rms, strict=True))
    if isinstance(plan, WhitePlan) and not isinstance(plan, CompliantPlan):
        source: WhitePlan | HistoryPlan = (
            plan if corner_share is None else replace(plan, corner_share=corner_share)
        )
    else:
        length = histories.duration if duration is None else duration
        source = histories.sampled(math.inf, length)
    return ImpactPlan(
        source=source, thresholds=thresholds, relaxation=histories.slowest, speeds=speeds
    )
