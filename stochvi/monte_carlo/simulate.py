"""Monte Carlo of a scene: what is asked for, what it would cost, and single paths of it."""

from __future__ import annotations

import math
import os
import time
from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from stochvi.assemblies import assemble
from stochvi.errors import NotConverged
from stochvi.estimates import Response
from stochvi.monte_carlo.modal import ModalPlan
from stochvi.monte_carlo.plans import Plan, make_plan, plan_several
from stochvi.monte_carlo.quantities import (
    Key,
)
from stochvi.monte_carlo.runs import FEWEST_PATHS, Progress, Run, relative_standard_errors, until
from stochvi.scenes import Scene

if TYPE_CHECKING:
    import pandas as pd


def simulate(
    scene: Scene,
    *,
    rel_error: float | None = None,
    paths: int | None = None,
    duration: float | None = None,
    seed: int = 0,
    threads: int | None = None,
    executor: Executor | None = None,
    speed_threshold: float | None = None,
    slow_impacts: bool = False,
    budget: float | None = 60.0,
    progress: Progress | None = None,
) -> Response:
    """Stationary response by Monte Carlo, with standard errors from independent paths.

    White noise is stepped by kick-flow-kick (impacts inside the step, no bias with elastic
    stops); for a tabulated density the response without stops is synthesised and the impacts are
    added. The bias of a finite step is measured by running the same paths at twice the step:
    |difference| / (2^order - 1). The order is 2, less where slow impacts on lossy stops under
    white noise are missed (see `white.extrapolated`); where it is not known the bias is None.

    Parameters
    ----------
    rel_error
        Run until mean squares, rate, F1 and F2 have this relative standard error (means:
        relative to the standard deviation). 0.01 if `paths` is not given either.
    paths, duration
        Instead: this many paths of this many seconds each, after burn-in.
    seed
        The streams of random numbers belong to (seed, path): same seed, same digits, on any
        number of threads.
    threads, executor
        Threads to start here, or any `concurrent.futures.Executor`.
    speed_threshold
        Impacts slower than this (m/s) are left out of the rates, never out of F1 and F2. By
        default 0, or 5 % of the rms velocity where a stop loses energy.
    slow_impacts
        Refine the steps near a stop until impacts at the threshold are resolved, for the rates
        under white noise at restitutions below 0.5. Ten or more times the cost; without it the
        bias of those rates is unknown (None). F1 and the moments need it only for small errors,
        and get it then by themselves.
    budget
        Seconds after which `NotConverged` is raised; None for no limit.
    progress
        Called with the fraction done and a sentence.

    Raises
    ------
    NotApplicable
        With every condition that the scene does not meet.
    NotConverged
        Carries the response so far.

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
    >>> deviation = simulate(scene, rel_error=0.01).coordinates["x"]["displacement_std"]
    >>> abs(deviation.value - 0.53956) < 4.5 * deviation.standard_error
    True
    """
    check_arguments(rel_error, paths, duration, seed, speed_threshold, budget, threads)
    plan = make_plan(scene, speed_threshold, duration, slow_impacts)
    workers = threads or len(os.sched_getaffinity(0))
    compile_time = _compile(plan)
    own = ThreadPoolExecutor(workers)
    run = Run(scene, plan, seed, executor or own, workers, progress, compile_time)
    try:
        if paths is None:
            until(run, 0.01 if rel_error is None else rel_error, budget)
        elif not run.add_paths(paths, math.inf if budget is None else budget):
            reached = (
                run.response(("not all paths were simulated",)) if run.fine.count > 1 else None
            )
            raise NotConverged(
                f"{run.fine.count} of {paths} paths were done in {budget:g} s; raise budget",
                reached,
            )
        return run.response()
    finally:
        own.shutdown(cancel_futures=True)


def record_path(
    scene: Scene, *, duration: float, seed: int = 0, path: int = 0, step: float | None = None
) -> pd.DataFrame:
    """One path, sample by sample: time (s), displacement, velocity and impact_speed (SI).

    `impact_speed` is the incident speed of an impact within the step that ends at `time`,
    positive at the upper stop, negative at the lower, 0 for none (several: their sum). The path
    is not stationary at its start: it begins at a guess of the stationary law. Where the scene
    has more than one oscillator under white or tabulated noise, the columns say of what they are,
    as in "displacement of absorber".

    Examples
    --------
    >>> from stochvi.excitations import WhiteNoise
    >>> from stochvi.structures import Oscillator
    >>> scene = Scene(
    ...     structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
    ...     excitations=[WhiteNoise(intensity=0.2)],
    ... )
    >>> list(record_path(scene, duration=10.0))
    ['time', 'displacement', 'velocity', 'impact_speed']
    """
    import pandas as pd

    check_arguments(None, None, duration, seed, None, None, None)
    _check_seconds(step=step)
    if not 0 <= path < 2**40:
        raise ValueError(f"path must be in [0, 2^40), got {path}")
    plan = make_plan(scene, None, duration)
    if step is not None:
        plan = plan.with_step(step)
    samples = plan.recorded_samples
    time = {"time": plan.step * np.arange(1, samples + 1)}
    if isinstance(plan, ModalPlan):
        record = np.zeros((samples, 1, plan.record_width))
        plan.averages(seed, path, 1, record)
        return pd.DataFrame(time | plan.recorded(record))
    record = np.zeros((samples, 1, 3))
    plan.averages(seed, path, 1, record)
    columns = {
        "displacement": record[:, 0, 0] + plan.rest,
        "velocity": record[:, 0, 1],
        "impact_speed": record[:, 0, 2],
    }
    return pd.DataFrame(time | columns)


def record_paths(
    scene: Scene, *, duration: float, paths: int, seed: int = 0
) -> tuple[float, list[pd.DataFrame]]:
    """Several paths of a scene of several coordinates at once, as `record_path` gives one.

    Returns the time, s, after which they have settled, and the records, `duration` longer.
    """
    import pandas as pd

    check_arguments(None, None, duration, seed, None, None, None)
    settling = plan_several(assemble(scene), None, duration).burn_in
    plan = plan_several(assemble(scene), None, settling + duration)
    record = np.zeros((plan.recorded_samples, paths, plan.record_width))
    plan.averages(seed, 0, paths, record)
    time = {"time": plan.step * np.arange(1, plan.recorded_samples + 1)}
    return settling, [
        pd.DataFrame(time | plan.recorded(record[:, [path]])) for path in range(paths)
    ]


@dataclass(frozen=True, kw_only=True)
class Prospect:
    """What a simulation would be like: its states and steps, and what they cost here and now.

    `nanoseconds_per_step` is wall time per step of one path, all threads at work; `seconds` maps
    relative errors to predicted wall time, None where no impact was seen to predict by.
    """

    method: str
    states: int
    step: float
    burn_in: float
    duration: float
    steps_per_path: int
    nanoseconds_per_step: float
    seconds: dict[float, float | None]
    governed_by: str


def prospect(scene: Scene, *, threads: int | None = None, seed: int = 0) -> Prospect:
    """Predict the cost of `simulate` from a pilot run of one block or two (well under a second).

    Standard errors fall with the square root of the scene time, so seconds(rel_error) =
    seconds(pilot) (pilot error / rel_error)^2, from the quantity that converges last.
    """
    plan = make_plan(scene, None, None)
    workers = threads or len(os.sched_getaffinity(0))
    compile_time = _compile(plan)
    with ThreadPoolExecutor(workers) as own:
        run = Run(scene, plan, seed, own, workers, None, compile_time)
        run.add_paths(max(2 * plan.block, FEWEST_PATHS))
        elapsed = run.elapsed
    relative = relative_standard_errors(run)
    slowest = max(relative, key=lambda key: relative[key])
    unseen = any((pair.name, "impact_speed_rate") not in relative for pair in scene.impact_pairs)
    return Prospect(
        method=plan.method,
        states=plan.states,
        step=plan.step,
        burn_in=plan.burn_in,
        duration=plan.duration,
        steps_per_path=plan.steps_per_path,
        nanoseconds_per_step=1e9 * elapsed / run.steps,
        seconds={
            target: None if unseen else elapsed * (relative[slowest] / target) ** 2
            for target in (0.01, 0.001)
        },
        governed_by="no impact was seen" if unseen else _spoken(scene, slowest),
    )


def _spoken(scene: Scene, key: Key) -> str:
    """A quantity in words; of whom, where the scene has several coordinates or pairs."""
    owner, name = key
    alone = len(scene.structure.coordinates) == 1 and len(scene.impact_pairs) < 2
    return name if alone else f"{name} of {owner}"


def check_arguments(
    rel_error: float | None,
    paths: int | None,
    duration: float | None,
    seed: int,
    speed_threshold: float | None,
    budget: float | None,
    threads: int | None,
) -> None:
    """ValueError for what makes no sense of what was asked for."""
    for name, number in (("paths", paths), ("threads", threads), ("seed", seed)):
        if number is not None and not isinstance(number, (int, np.integer)):
            raise ValueError(f"{name} must be a whole number, got {number!r}")
    if rel_error is not None and paths is not None:
        raise ValueError("give rel_error or paths, not both")
    if rel_error is not None and not 1e-6 <= rel_error < 1.0:
        raise ValueError(f"rel_error must be in [1e-6, 1), got {rel_error}")
    if paths is not None and paths < 2:
        raise ValueError(f"paths must be at least 2 for a standard error, got {paths}")
    if threads is not None and threads < 1:
        raise ValueError(f"threads must be at least 1, got {threads}")
    if not 0 <= seed < 2**63:
        raise ValueError(f"seed must be in [0, 2^63), got {seed}")
    _check_seconds(duration=duration, budget=budget)
    if speed_threshold is not None and not 0.0 <= speed_threshold < math.inf:
        raise ValueError(f"speed_threshold must be at least 0, got {speed_threshold}")


def _check_seconds(**times: float | None) -> None:
    for name, value in times.items():
        if value is not None and not 0.0 < value < math.inf:
            raise ValueError(f"{name} must be a positive number of seconds, got {value}")


def _compile(plan: Plan) -> float:
    """Run the kernels once on next to nothing; seconds it took (machine code is cached)."""
    start = time.perf_counter()
    plan.shortest().averages(0, 0, 2)
    return time.perf_counter() - start
