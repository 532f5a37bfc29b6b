"""Impacts of several pairs of a structure in a mission: their number, and how hard the hardest is.

Where first impacts are rare, clusters are followed from first impacts on (`bursts`). Fast first
impacts are drawn more often where a limit asks for them. Where clusters follow without a pause,
pieces of the whole motion are simulated (`Windows`). Two shares then give the probability that a
limit is exceeded in a mission: of windows in which it is exceeded, and of windows in whose second
half it is exceeded for the first time.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple, Unpack

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from stochvi.engine.impact_log import COLUMNS, Log
from stochvi.mathematics.arrays import Vector
from stochvi.methods.monte_carlo.gap_response import with_tables
from stochvi.methods.monte_carlo.missions import NEEDS_FORCE
from stochvi.methods.monte_carlo.modal_tables import ModalTablesPlan, plan_modal_tables
from stochvi.model.free_motion import free_motion
from stochvi.model.modal import absolute_accelerations
from stochvi.model.model import Model, Pair, model_of
from stochvi.results.errors import NotApplicable
from stochvi.results.estimates import Estimate, of_events
from stochvi.results.hardness import is_speed
from stochvi.results.intervals import binomial_interval, jackknife_error, upper_limit_unseen
from stochvi.sampling.options import AccuracyOptions
from stochvi.sampling.run import Run, sampled
from stochvi.sampling.sampler import ListSampler
from stochvi.scenes.impact_laws import CompliantLaw
from stochvi.scenes.scene import Scene
from stochvi.scenes.structures.rigid_body import MOTIONS, RigidBody
from stochvi.statistics.bursts import Bursts, chance_of
from stochvi.statistics.cluster_paths import WINDOW_RELAXATIONS, WINDOWS
from stochvi.statistics.impact_counts import clusters_apart
from stochvi.statistics.pair_crossings import FirstCrossings, PairMotion
from stochvi.statistics.trial_splitting import risk_of_windows

TYPICAL_SPEED = 1.25
"""Speed of a usual first impact in rms velocities: about half of the first impacts are faster."""

WIDEST = 3.0
"""Largest factor on the speeds of first impacts; statistical weights grow with this factor."""

FEWEST_WINDOWS, MOST_WINDOWS = 64, 2**15
"""Smallest and largest number of windows of the whole motion."""

LOGGED = 2**16
"""Number of impacts for which the log of a block of windows has room at first."""


class Limit(NamedTuple):
    """The limit that an impact must not exceed.

    Parameters
    ----------
    event
        "impact_speed" (m/s) of any pair, or "peak_acceleration" (m/s^2) of any of the outputs.
    value
        The limit.
    outputs
        Coordinates and points whose acceleration counts; empty for a speed.
    """

    event: str
    value: float
    outputs: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Exceedance:
    """The probability that a limit is exceeded in a mission, with the interval from so many trials.

    Parameters
    ----------
    chance
        The probability; 0 with an upper limit where no trial exceeded the limit.
    by_output
        The probability of each output alone, of a limit of an acceleration.
    way
        "bursts" or "windows".
    degrees
        Number of independent paths less one.
    """

    chance: Estimate
    by_output: Mapping[str, Estimate]
    way: str
    trials: int
    degrees: int


def outputs_of(scene: Scene, at: str | None) -> tuple[str, ...]:
    """Names of the coordinates and points whose acceleration `at` asks after; by default of all
    that are lengths.

    Raises `ValueError` for a name that the scene does not have, and `NotApplicable` where no
    absolute acceleration is known.
    """
    model = model_of(scene)
    if not model.base_alone_moves:
        raise NotApplicable(
            "peak_acceleration",
            ["the base alone must move (an excitation of the base, on a structure with a base): "
             "where noise acts on a mass, the acceleration has no largest value"],
        )  # fmt: skip
    if at is None:
        turning = tuple(MOTIONS)[3:] if isinstance(scene.structure, RigidBody) else ()
        return tuple(name for name in model.outputs if name not in turning)
    found = tuple(name for name in model.outputs if at in (name, name.rpartition(".")[0]))
    if not found:
        raise ValueError(f"at must be one of {', '.join(model.outputs)}, got {at!r}")
    return found


def check_forces(model: Model) -> None:
    """NotApplicable where a stop has no force, so that its impacts have no acceleration."""
    rigid = [pair.name for pair in model.pairs if any(stop.rigid for stop in pair.stops)]
    if rigid:
        raise NotApplicable("peak_acceleration", [f"{NEEDS_FORCE} (stops of {', '.join(rigid)})"])


def exceedance(
    scene: Scene, limit: Limit, mission: float, overlap: float, run: Run,
    far_from: float | None = None,
) -> Exceedance:  # fmt: skip
    """The probability that any impact of the mission exceeds a limit; `overlap` as for
    `count_impacts`, and `far_from` a rate of exceedances as for `bursts`."""

    def rate(found: Bursts, outputs: tuple[str, ...] = limit.outputs) -> Estimate:
        return found.exceedance_rate(limit.event, limit.value, outputs)

    widening = widening_of(model_of(scene), limit)
    found = clusters_apart(scene, overlap, run, rate, widening=widening, far_from=far_from)
    if found is None:
        return windows(scene, limit, mission, **run.options(rel_error=run.rel_error))
    reach = found.window / WINDOW_RELAXATIONS / mission

    def chance(outputs: tuple[str, ...]) -> Estimate:
        return chance_of(found.limited(rate(found, outputs)), mission, reach)

    return Exceedance(
        chance=chance(limit.outputs),
        by_output={name: chance((name,)) for name in limit.outputs},
        way="bursts",
        trials=len(found.path),
        degrees=max(found.paths - 1, 1),
    )


def overlap_of(crossings: FirstCrossings) -> float:
    """Expected first impacts in the time for which a cluster is followed, at the first level."""
    return crossings.first_rate()[0].value * WINDOWS * crossings.horizon


def without_stops(model: Model, limit: Limit, mission: float) -> float:
    """Probability, at least, that the motion without stops alone exceeds the limit of an
    acceleration in a mission: by crossings of its noise at the slowest natural frequency (Rice)."""
    rows = model.output_rows[[model.outputs.index(name) for name in limit.outputs]]
    squares = absolute_accelerations(model.modal, free_motion(model.without_sines()).law, rows)
    slowest = math.sqrt(float(np.min(model.modal.squares))) / (2.0 * math.pi)
    levels = 0.5 * limit.value**2 / np.maximum(squares, np.finfo(float).tiny)
    return -math.expm1(-2.0 * slowest * mission * math.exp(-float(levels.min())))


def widening_of(model: Model, limit: Limit) -> float:
    """Factor on the speeds of the first impacts that are drawn, so that some impacts exceed a
    limit."""
    motion = PairMotion(model)
    speeds = motion.velocity_std
    if is_speed(limit.event):
        ratio = limit.value / float(speeds.max())
    else:
        rows = model.output_rows[[model.outputs.index(name) for name in limit.outputs]]
        ratio = min(
            _speed_to_reach(model, pair, rows, limit.value) / speed
            for pair, speed in zip(model.pairs, speeds, strict=True)
            if speed > 0.0
        )
    return min(max(ratio / TYPICAL_SPEED, 1.0), WIDEST)


def _speed_to_reach(model: Model, pair: Pair, rows: Vector, acceleration: float) -> float:
    """Speed of an impact on one pair (m/s) whose peak force alone gives any of the outputs an
    acceleration; infinite where the pair pushes none of them."""
    pushed = float(np.max(np.abs(rows @ np.linalg.solve(model.mass, pair.direction))))
    if not pushed:
        return math.inf
    force = acceleration / pushed
    found = []
    for stop in pair.stops:
        law = stop.law
        assert isinstance(law, CompliantLaw)

        def missing(logarithm: float, law: CompliantLaw = law) -> float:
            return law.impact(math.exp(logarithm), pair.mass).peak_force - force

        low, high = math.log(1e-9), math.log(1e6)
        reached = missing(low) < 0.0 < missing(high)
        found.append(math.exp(brentq(missing, low, high)) if reached else 1e6)
    return min(found)


# Windows of the whole motion ---------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class WindowSampler(ListSampler):
    """Windows of the motion with stops, each a path of its own of `plan`.

    A sample are arrays (parts, names, windows): the largest "impact_speed" (m/s), or
    "peak_acceleration" of each of the outputs, in each of these `parts` of a window from its start.
    """

    plan: ModalTablesPlan
    event: str
    outputs: tuple[str, ...]
    seed: int
    parts: tuple[float, ...] = (1.0,)

    @property
    def block(self) -> int:
        """Number of windows that are simulated together."""
        return self.plan.block

    @property
    def window(self) -> float:
        """Length of a window, s."""
        return self.plan.steps * self.plan.step

    def add_up(self, pieces: list[Vector]) -> list[Vector]:
        """The windows of a block."""
        return [np.concatenate(pieces, axis=2)]

    def paths(self, sample: list[Vector]) -> int:
        """Number of windows."""
        return sum(each.shape[2] for each in sample)

    def simulate(self, first_path: int, paths: int) -> Vector:
        """The largest of some windows."""
        if is_speed(self.event):
            found = np.zeros((len(self.parts), 1, paths))
            path, time, speed = self._impacts(first_path, paths)
            for part, largest in zip(self.parts, found, strict=True):
                early = time <= part * self.window
                np.maximum.at(largest[0], path[early], speed[early])
            return found
        names = self.plan.model.outputs
        rows = [names.index(name) for name in self.outputs]
        found = np.zeros((len(self.parts), paths, len(names)))
        for part, largest in zip(self.parts, found, strict=True):
            plan = self.plan if part == 1.0 else replace(self.plan, duration=part * self.window)
            plan.averages(self.seed, first_path, paths, accelerations=largest)
        return found[:, :, rows].swapaxes(1, 2)

    def _impacts(self, first: int, paths: int) -> tuple[NDArray[np.int64], Vector, Vector]:
        rows = LOGGED
        while True:
            log = Log(np.zeros((rows, COLUMNS)), np.zeros(1, np.int64), 0.0)
            self.plan.averages(self.seed, first, paths, log=log)
            if log.count[0] <= rows:
                break
            rows = int(log.count[0])
        path, _, time, speed = log.events[: log.count[0]].T
        return path.astype(np.int64), time, np.abs(speed)


@sampled(rel_error=0.05)
def windows(
    scene: Scene, limit: Limit, mission: float, **options: Unpack[AccuracyOptions]
) -> Exceedance:
    """The probability that a limit is exceeded in a mission, from windows of the motion with
    stops."""
    run = Run.of(options)
    plan = plan_modal_tables(with_tables(model_of(scene)), None, None)
    longest = plan.block_length - plan.burn_in
    plan = replace(plan, duration=max(min(longest, mission), 2.0 * plan.step))
    sampler = WindowSampler(plan, limit.event, limit.outputs, run.seed, parts=(0.5, 1.0))

    def chance_in(sample: list[Vector], name: int | None = None) -> Estimate:
        seen = np.concatenate(sample, axis=2) > limit.value
        chosen = seen.any(axis=1) if name is None else seen[:, name]
        return _of_windows(np.asarray(chosen), sampler.window, mission)

    def error(sample: list[Vector]) -> float:
        chance = chance_in(sample)
        if sampler.paths(sample) >= MOST_WINDOWS:
            return 0.0
        return chance.standard_error / chance.value if chance.value else math.inf

    taken = run.to_accuracy(sampler, max(plan.block, FEWEST_WINDOWS), error, run.accuracy)
    by_output = {name: chance_in(taken.sample, number) for number, name in enumerate(limit.outputs)}
    found = Exceedance(
        chance=chance_in(taken.sample), by_output=by_output, way="windows", trials=taken.paths,
        degrees=taken.paths - 1,
    )  # fmt: skip
    if run.deadline.interrupted:
        raise run.deadline.fell_short(f"after {taken.paths} windows", "", found)
    return found


def _of_windows(seen: NDArray[np.bool_], window: float, mission: float) -> Estimate:
    """The probability in a mission from exceedances (2, windows): in the first half of each window,
    and in the whole window."""
    count = seen.shape[1]
    early, whole = seen.astype(float)
    if not whole.any():
        most = upper_limit_unseen(count)
        upper = float(risk_of_windows(np.array(most), np.array(0.5 * most), window, mission))
        how = f"{count} windows without one"
        return Estimate(value=0.0, bias=None, how=how, upper_95=min(upper, 1.0))
    late = whole - early

    def risk(exceeded: Vector, late: Vector) -> Vector:
        return risk_of_windows(exceeded, late, window, mission)

    value = float(risk(whole.mean(), late.mean()))
    left_out = risk((whole.sum() - whole) / (count - 1), (late.sum() - late) / (count - 1))
    error = jackknife_error(left_out)
    if whole.all():  # the error then follows from the lower limit of the probability
        least = binomial_interval(count, count)[0]
        error = 0.5 * float(1.0 - risk(np.array(least), np.array(0.0)))
    found = Estimate(
        value=value, standard_error=error, bias=0.0, how=f"{count} windows of {window:.3g} s"
    )
    at_most = found if whole.all() else of_events(found, count)
    return replace(at_most, upper_95=at_most.upper_95 and min(at_most.upper_95, 1.0))
