"""Monte Carlo of a scene: rounds of independent paths until the errors are what was asked for."""

from __future__ import annotations

import math
import os
import time
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from stochvi.assemblies import Contact, assemble
from stochvi.collisions import COLLAPSE_RESTITUTION, upper_limit_unseen
from stochvi.errors import NotApplicable, NotConverged
from stochvi.estimates import Cost, Estimate, Response, provenance
from stochvi.identities import residuals
from stochvi.monte_carlo.compliant import CONTACT_ROWS, plan_compliant
from stochvi.monte_carlo.modal import ModalPlan, plan_modal
from stochvi.monte_carlo.quantities import (
    CONTACT_QUANTITIES,
    RATES,
    Key,
    Means,
    Quantity,
    governed,
    of_compliant_pair,
    of_coordinate,
    of_pair,
    restitutions,
    speed_mean,
)
from stochvi.monte_carlo.statistics import Layout, PathStatistics
from stochvi.monte_carlo.tabulated import TabulatedPlan, plan_tabulated
from stochvi.monte_carlo.white import WhitePlan, plan_white
from stochvi.notes import scene_notes
from stochvi.scenes import Scene

if TYPE_CHECKING:
    import pandas as pd

Plan = WhitePlan | TabulatedPlan | ModalPlan
Progress = Callable[[float, str], None]

FIRST_BLOCKS = 1
"""Blocks of paths in the first round."""

FEWEST_PATHS = 64
"""Paths in the first round, for an honest standard error."""

WINDOW = 4
"""Blocks per thread that may wait to be merged in order: bounds memory, hides stragglers."""

MOST_REFINEMENTS = 4
"""How often the step is halved when its bias, beyond doubt, exceeds what was asked for."""


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
    _check_arguments(rel_error, paths, duration, seed, speed_threshold, budget, threads)
    plan = make_plan(scene, speed_threshold, duration, slow_impacts)
    workers = threads or len(os.sched_getaffinity(0))
    compile_time = _compile(plan)
    own = ThreadPoolExecutor(workers)
    run = _Run(scene, plan, seed, executor or own, workers, progress, compile_time)
    try:
        if paths is None:
            _until(run, 0.01 if rel_error is None else rel_error, budget)
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

    _check_arguments(None, None, duration, seed, None, None, None)
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
        run = _Run(scene, plan, seed, own, workers, None, compile_time)
        run.add_paths(max(2 * plan.block, FEWEST_PATHS))
        elapsed = run.elapsed
    relative = _relative_standard_errors(run)
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


def make_plan(
    scene: Scene,
    speed_threshold: float | None,
    duration: float | None,
    slow_impacts: bool = False,
) -> Plan:
    """Choose the method that the scene's excitation calls for, its step and its lengths."""
    assembly = assemble(scene)
    single = len(assembly.coordinates) == 1 and len(assembly.contacts) <= 1
    coloured = any(signal.intensity > 0.0 for signal in assembly.signals)
    noisy = coloured or bool(np.any(assembly.white))
    # where a stop gives way, signals are tables and sines beside them
    giving_way = bool(assembly.signals) and noisy and bool(assembly.not_rigid())
    if single and (assembly.tables or giving_way):
        return plan_tabulated(scene, speed_threshold, duration)
    if scene.beyond_one_oscillator():
        return plan_modal(assembly, speed_threshold, duration)
    system = scene.system()
    if system.intensity == 0.0:
        raise NotApplicable(
            "simulate", ["excitation must contain noise, got a constant load alone"]
        )
    if system.not_rigid():
        return plan_compliant(system, speed_threshold, duration, slow_impacts)
    return plan_white(system, speed_threshold, duration, slow_impacts)


def layout_of(scene: Scene, plan: Plan) -> Layout:
    """What the averages of a plan are."""
    if isinstance(plan, ModalPlan):
        return plan.layout
    pair = scene.impact_pairs[0].name if scene.impact_pairs else ""
    rows = [("x", "x"), ("x", "xx"), ("x", "vv")]
    rows += [(pair, f"{sum_}_{side}") for side in ("lower", "upper") for sum_ in ("n", "f1", "f2")]
    if plan.contacts:
        rows += [(pair, name) for name in CONTACT_ROWS]
    return Layout(rows=tuple(rows), origins={"x": plan.origin}, thresholds={pair: plan.threshold})


def _check_arguments(
    rel_error: float | None,
    paths: int | None,
    duration: float | None,
    seed: int,
    speed_threshold: float | None,
    budget: float | None,
    threads: int | None,
) -> None:
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


def _block_averages(
    plan: Plan, layout: Layout, seed: int, first_path: int, paths: int
) -> PathStatistics:
    """One task: a function of its arguments alone, so any worker may do it, twice if need be."""
    return PathStatistics.of(plan.averages(seed, first_path, paths), layout)


@dataclass
class _Run:
    """Paths simulated so far, at the step and (unless that is free of bias) at twice the step."""

    scene: Scene
    plan: Plan
    seed: int
    executor: Executor
    threads: int
    progress: Progress | None
    compile_time: float

    def __post_init__(self) -> None:
        self.started = time.perf_counter()
        self.assembly = assemble(self.scene)
        self.layout = layout_of(self.scene, self.plan)
        self.fine = PathStatistics.none(self.layout)
        self.coarse = PathStatistics.none(self.layout)
        self.steps = 0
        self.expected_paths = 1.0
        self.shown = 0.0

    @property
    def exposure(self) -> float:
        """Counted seconds of motion, all paths together."""
        return self.fine.count * self.plan.duration

    @property
    def elapsed(self) -> float:
        return time.perf_counter() - self.started

    def add_paths(self, paths: int, deadline: float = math.inf) -> bool:
        """Simulate more paths, merged in the order of their numbers; False if time ran out."""
        plans = [self.plan] if self.plan.elastic else [self.plan, self.plan.coarser()]
        first, goal = self.fine.count, self.fine.count + paths
        self.expected_paths = max(self.expected_paths, goal)
        waiting: deque[list[Future[PathStatistics]]] = deque()
        for block in _blocks(first, paths, self.plan.block):
            if self.elapsed > deadline:
                break
            waiting.append(
                [
                    self.executor.submit(_block_averages, plan, self.layout, self.seed, *block)
                    for plan in plans
                ]
            )
            if len(waiting) >= WINDOW * self.threads:
                self._merge(waiting.popleft())
        while waiting:
            late = self.elapsed > deadline
            # what has not begun when time is up is not begun
            if late and waiting[0][-1].cancel():
                break
            self._merge(waiting.popleft())
        for block_futures in waiting:
            for future in block_futures:
                future.cancel()
        self.steps += (self.fine.count - first) * sum(plan.steps_per_path for plan in plans)
        return self.fine.count == goal

    def _merge(self, block: list[Future[PathStatistics]]) -> None:
        self.fine = self.fine.merge(block[0].result())
        if len(block) == 2:
            self.coarse = self.coarse.merge(block[1].result())
        if self.progress:
            # what is expected may grow, but a bar never goes back
            self.shown = max(self.shown, min(1.0, self.fine.count / self.expected_paths))
            self.progress(self.shown, f"{self.fine.count} paths")

    def refine(self) -> None:
        """Start again with less bias: at half the step, or with slow impacts resolved."""
        self.plan = self.plan.finer()
        self.fine = self.coarse = PathStatistics.none(self.layout)

    def estimate(self, quantity: Quantity, name: str = "") -> Estimate:
        """A function of the means with its standard error and the bias left by the step."""
        value, error = self.fine.evaluate(quantity)
        how = f"{self.fine.count} paths of {self.plan.duration:.4g} s"
        if value == 0.0 and (name in RATES or name.startswith("impact_speed")):
            limit = self._limit_unseen(name) if name.startswith("collision_rate") else None
            return Estimate(value=0.0, how=f"no impact seen, {how}", upper_95=limit)
        if self.plan.elastic:
            return Estimate(value=value, standard_error=error, how=how)
        difference = abs(self.coarse.evaluate(quantity)[0] - value)
        return Estimate(
            value=value,
            standard_error=error,
            bias=self.plan.step_bias(name, difference),
            how=f"{how}; bias from twice the step",
        )

    def _limit_unseen(self, name: str) -> float:
        """Upper limit of a rate of which nothing was seen: that of clusters of hits, times the
        most hits in a cluster, on one stop or on both."""
        stops = 2.0 if name == "collision_rate" else 1.0
        return stops * self.plan.hits_in_a_cluster * upper_limit_unseen(self.exposure)

    def response(self, warnings: tuple[str, ...] = ()) -> Response:
        """Everything that the paths so far say."""
        coordinates: dict[str, dict[str, Estimate | None]] = {}
        for coordinate in self.assembly.coordinates:
            coordinates[coordinate] = {
                "acceleration_std": self._acceleration(),
                "upcrossing_rate": None,
            }
            for name, quantity in of_coordinate(coordinate).items():
                coordinates[coordinate][name] = self.estimate(quantity)
        pairs = {contact.name: self._pair(contact) for contact in self.assembly.contacts}
        return Response(
            method="simulate",
            coordinates=coordinates,
            impact_pairs=pairs,
            effects=self.scene.effects(),
            assumptions=[*self.scene.assumptions(), *self._assumptions()],
            cost=Cost(
                wall_time=self.elapsed,
                compile_time=self.compile_time,
                steps=self.steps,
                impacts=round(self._rate_of_all() * self.exposure),
                paths=self.fine.count,
                threads=self.threads,
                tenfold_wall_time=100.0 * self.elapsed,
            ),
            warnings=[*warnings, *self._warnings()],
            provenance=provenance(self.scene.document(), self.seed),
            identities=self._identities(),
        )

    def _pair(self, contact: Contact) -> dict[str, Estimate | float | None]:
        known, sides = of_pair(contact.name), [side for side, _, _ in contact.stops]
        found: dict[str, Estimate | float | None] = {
            name: None
            if name in ("collision_rate_lower", "collision_rate_upper")
            and name.removeprefix("collision_rate_") not in sides
            else self.estimate(quantity, name)
            for name, quantity in known.items()
        }
        hit = self.fine.evaluate(known["collision_rate"])[0] > 0.0
        found["impact_speed_mean"] = (
            self.estimate(speed_mean(contact.name), "impact_speed_mean") if hit else None
        )
        threshold = self.layout.thresholds[contact.name]
        found |= dict.fromkeys(CONTACT_QUANTITIES)
        if hit and self.plan.contacts:
            for name, quantity in of_compliant_pair(contact).items():
                found[name] = self.estimate(quantity, name)
        return found | {"speed_threshold": threshold}

    def _rate_of_all(self) -> float:
        """Impacts per second, all pairs together."""
        rates = (of_pair(contact.name)["collision_rate"] for contact in self.assembly.contacts)
        return sum(self.fine.evaluate(rate)[0] for rate in rates)

    def _identities(self) -> dict[str, Estimate]:
        origin = [self.layout.origins[name] for name in self.assembly.coordinates]

        def of(means: Means) -> dict[str, float]:
            return residuals(self.assembly, means, origin)

        names = of(self.fine.means())
        return {name: self.estimate(lambda means, name=name: of(means)[name]) for name in names}  # type: ignore[misc]

    def _acceleration(self) -> Estimate | None:
        """Absolute acceleration between impacts, -(b x' + w0^2 x): finite without rigid stops."""
        if self.scene.impact_pairs or self.scene.beyond_one_oscillator():
            return None
        system = self.scene.system()
        if not system.moving_base or system.noise_on_mass:
            return None
        b, stiff = system.damping_rate, system.omega**2
        return self.estimate(
            lambda m: math.sqrt(b**2 * m["x", "vv"] + stiff**2 * m["x", "variance"])
        )

    def _assumptions(self) -> list[str]:
        plan = self.plan
        return [
            f"{plan.method}, step {plan.step:.3g} s, burn-in {plan.burn_in:.3g} s per path",
            "standard errors from independent paths (delta method)",
        ]

    def _warnings(self) -> Iterator[str]:
        if not self.scene.beyond_one_oscillator():
            yield from scene_notes(self.scene.system())
        contacts = self.assembly.contacts
        several = len(contacts) > 1
        unresolved = not self.plan.elastic and self.plan.step_bias("collision_rate", 0.0) is None
        if unresolved and any(
            COLLAPSE_RESTITUTION < r < 1.0 for pair in contacts for r in restitutions(pair)
        ):
            yield (
                "slow impacts at these stops are not resolved: the bias of the rates is unknown "
                "(F1, F2 and the moments are not concerned); slow_impacts resolves them"
            )
        for contact in contacts:
            of = f" of {contact.name}" if several else ""
            threshold = self.layout.thresholds[contact.name]
            if threshold > 0.0:
                yield (
                    f"rates{of} count impacts faster than {threshold:.3g} m/s; F1 and F2 count all"
                )
            for side, _, law in contact.stops:
                if law.rigid and law.restitution <= COLLAPSE_RESTITUTION:
                    yield (
                        f"restitution {law.restitution:g} at the {side} stop{of} is below "
                        f"{COLLAPSE_RESTITUTION:.4f}: the rate of all impacts is infinite under "
                        "white noise; rates above a speed threshold are given, rel_error does not "
                        "govern them"
                    )
                unseen = of_pair(contact.name)[f"collision_rate_{side}"]
                if self.fine.evaluate(unseen)[0] == 0.0:
                    yield (
                        f"no impact on the {side} stop{of} in {self.exposure:.3g} s of motion: its "
                        "rate has an upper limit only, rel_error does not govern it; more paths "
                        "or a longer duration look further"
                    )


def _blocks(first_path: int, paths: int, size: int) -> Iterator[tuple[int, int]]:
    """(first path, number of paths) of blocks that start at multiples of `size` where they can."""
    end = first_path + paths
    while first_path < end:
        count = min(size - first_path % size, end - first_path)
        yield first_path, count
        first_path += count


def _until(run: _Run, rel_error: float, budget: float | None) -> None:
    """Double the number of paths until every governed quantity is as accurate as asked."""
    deadline = math.inf if budget is None else budget
    refinements = 0
    paths = max(FIRST_BLOCKS * run.plan.block, FEWEST_PATHS)
    run.expected_paths = 4.0 * paths  # until the first errors are known
    while True:
        in_time = run.add_paths(paths, deadline)
        if run.fine.count < 2:
            raise NotConverged(f"budget of {budget:g} s was too short for a single block of paths")
        errors, bias = _relative_errors(run)
        if errors <= rel_error:
            if bias <= rel_error:
                return
            if not in_time or refinements == MOST_REFINEMENTS:
                raise NotConverged(
                    f"the step still leaves a relative bias of {bias:.2g}, asked for "
                    f"{rel_error:g}; raise rel_error" + ("" if in_time else " or budget"),
                    run.response(("the accuracy asked for was not reached",)),
                )
            run.refine()
            refinements += 1
            continue
        needed = run.elapsed * (errors / rel_error) ** 2
        if not in_time or run.elapsed > deadline:
            raise NotConverged(
                f"relative standard error {errors:.2g} after {run.elapsed:.1f} s, asked for "
                f"{rel_error:g}, which takes about {needed:.0f} s; raise budget or rel_error",
                run.response(("the accuracy asked for was not reached",)),
            )
        run.expected_paths = 1.1 * run.fine.count * (errors / rel_error) ** 2
        growth = (errors / rel_error) ** 2 - 1.0
        paths = math.ceil(run.fine.count * min(max(1.1 * growth, 0.1), 3.0))
        paths = math.ceil(paths / run.plan.block) * run.plan.block


def _relative_errors(run: _Run) -> tuple[float, float]:
    """Largest relative standard error, and largest relative bias that is beyond its own noise."""
    biases = [0.0]
    if not run.plan.elastic:
        for key, quantity in governed(run.assembly).items():
            # halving the step would do little for the rates at lossy stops: it is only stated
            if key[1] in RATES:
                continue
            value, error = run.fine.evaluate(quantity)
            coarse, coarse_error = run.coarse.evaluate(quantity)
            excess = abs(coarse - value) - 2.0 * math.hypot(error, coarse_error)
            size = _size(run, key, value)
            bias = run.plan.step_bias(key[1], max(0.0, excess))
            biases.append(bias / size if bias and size else 0.0)
    return max(_relative_standard_errors(run).values()), max(biases)


def _relative_standard_errors(run: _Run) -> dict[Key, float]:
    """Of each governed quantity that is not zero."""
    found = {}
    for key, quantity in governed(run.assembly).items():
        value, error = run.fine.evaluate(quantity)
        size = _size(run, key, value)
        if size > 0.0:
            found[key] = error / size
    return found


def _size(run: _Run, key: Key, value: float) -> float:
    """What a quantity is measured by: itself, but a mean by the standard deviation."""
    owner, name = key
    if name == "displacement_mean":
        return run.fine.evaluate(of_coordinate(owner)["displacement_std"])[0]
    return abs(value)
