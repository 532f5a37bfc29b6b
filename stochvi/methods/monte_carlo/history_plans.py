"""Stationary records of many paths, a block at a time, with the excitation where it is known.

Statistics of records (spectra, for example) ask for the `Histories` of a block of paths and keep
only what they compute from them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from stochvi.methods.monte_carlo.choose_plan import make_plan
from stochvi.methods.monte_carlo.plan import Histories, Plan
from stochvi.model.model import Model, model_of
from stochvi.results.deadline import NEVER, Deadline
from stochvi.scenes.scene import Scene

BLOCK_NUMBERS = 2**23
"""Largest number of floats in the records of a block of paths: 64 MB, and a few times as much while
the records are reduced."""

MOST_PATHS = 256
"""Largest number of paths in a block of histories."""


@dataclass(frozen=True, kw_only=True)
class HistoryPlan:
    """The plan by which records of a scene are made.

    `fastest`, rad/s, is the largest frequency of: modes, signals, motions from stop to stop, and
    falls of an unrestrained mass back to its stop. `speed`, m/s, is the largest rms speed of a gap.
    """

    plan: Plan
    duration: float
    slowest: float
    fastest: float
    speed: float

    @property
    def model(self) -> Model:
        """The model that is simulated."""
        return self.plan.model

    @property
    def step(self) -> float:
        """Sampling interval, s."""
        return self.plan.step

    @property
    def samples(self) -> int:
        """Samples of a record."""
        return self.plan.history_samples(self.duration)

    @property
    def block(self) -> int:
        """Number of paths that are recorded together."""
        return max(1, min(MOST_PATHS, BLOCK_NUMBERS // self.plan.record_size(self.samples)))

    def sampled(self, step: float, duration: float) -> HistoryPlan:
        """The plan at a sampling interval of at most `step`, in records of `duration` seconds."""
        return replace(self, plan=self.plan.sampled(step, duration), duration=duration)

    def histories(self, seed: int, first_path: int, paths: int) -> Histories:
        """Records of the paths first_path, first_path + 1, ...: a function of its arguments."""
        found = self.plan.histories(seed, first_path, paths, self.samples)
        # a shorter record would give wrong averages over the time of `samples`
        made = found.displacement.shape[2]
        if made != self.samples:
            raise AssertionError(f"a record has {made} samples, {self.samples} were promised")
        return found


def plan_histories(scene: Scene, deadline: Deadline = NEVER) -> HistoryPlan:
    """The plan of records for any scene that `simulate` covers.

    Examples
    --------
    >>> from stochvi.scenes.excitations import WhiteNoise
    >>> from stochvi.scenes.structures import Oscillator
    >>> scene = Scene(
    ...     structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
    ...     excitations=[WhiteNoise(intensity=0.2)],
    ... )
    >>> plan = plan_histories(scene).sampled(step=0.1, duration=50.0)
    >>> plan.histories(seed=1, first_path=0, paths=3).displacement.shape
    (1, 3, 500)
    """
    return histories_of(make_plan(model_of(scene), deadline=deadline))


def histories_of(plan: Plan) -> HistoryPlan:
    """The plan of records by a plan of paths of the usual length."""
    model = plan.model
    speed = max(plan.speeds, default=0.0)
    gaps = [pair.play for pair in model.pairs if pair.play is not None]
    frequencies = [model.modal.fastest, *(math.pi * speed / gap for gap in gaps)]
    if len(model.coordinates) == 1 and model.omega == 0.0 and speed > 0.0:
        frequencies.append(math.pi * abs(model.load) / speed)  # back after 2 speed / load
    return HistoryPlan(
        plan=plan,
        duration=plan.duration,
        slowest=plan.relaxation,
        fastest=max(frequencies),
        speed=speed,
    )
