"""Settled records of many paths, a block at a time, with the input where it is known.

What is made of records (spectra, ...) stands above the methods and knows no plan: it asks for
`Histories` of a block of paths, reduces them, and lets them go.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft, rfft

from stochvi.methods.monte_carlo.kernels.random_numbers import normal_rows, seed_streams
from stochvi.methods.monte_carlo.kernels.rows import Sums
from stochvi.methods.monte_carlo.modal import ModalPlan
from stochvi.methods.monte_carlo.modal_tables import ModalTablesPlan
from stochvi.methods.monte_carlo.plans import Plan, make_plan
from stochvi.methods.monte_carlo.tabulated import WARM_UP_RELAXATIONS, TabulatedPlan
from stochvi.methods.monte_carlo.white import RELAXATIONS, WhitePlan
from stochvi.model.assembly import Assembly, assemble, modes_of
from stochvi.results.errors import NotApplicable
from stochvi.scenes.scene import Scene

Records = NDArray[np.float64]

BLOCK_NUMBERS = 2**23
"""Numbers recorded of a block of paths: 64 MB, and some times that while they are reduced."""


@dataclass(frozen=True, kw_only=True)
class Histories:
    """Stationary records of a block of paths at equal steps, SI units.

    Parameters
    ----------
    displacement, velocity
        (coordinates, paths, samples). Velocities are those before the kick of white noise that
        falls on a sample.
    impact_speed
        (pairs, paths, samples): incident speeds within the step that ends at a sample, added up,
        negative at a lower stop.
    excitation
        (paths, samples), None where it is not known: f of x'' + b x' + omega^2 x = f + impacts,
        m/s^2; a base acceleration is -f. White noise is the mean over the step that follows.
    """

    displacement: Records
    velocity: Records
    impact_speed: Records
    excitation: Records | None


@dataclass(frozen=True, kw_only=True)
class HistoryPlan:
    """How records of a scene are made.

    `slowest` is the relaxation time of the energy (s), losses at stops included; `fastest` the
    largest frequency of a mode, a signal or the flight between two stops, rad/s; `speed` the
    largest rms speed of a gap, m/s.
    """

    plan: Plan
    assembly: Assembly
    duration: float
    slowest: float
    fastest: float
    speed: float

    @property
    def kicked(self) -> bool:
        """Whether white noise acts, in kicks a step apart."""
        if isinstance(self.plan, TabulatedPlan):
            return False
        return not isinstance(self.plan, ModalPlan) or self.plan.modes.kicked

    @property
    def excitation_known(self) -> bool:
        """Whether histories hold it."""
        if isinstance(self.plan, TabulatedPlan):
            return not self.plan.waves
        return not isinstance(self.plan, ModalPlan)

    @property
    def step(self) -> float:
        """Sampling interval, s."""
        return self.plan.step

    @property
    def samples(self) -> int:
        """Of a record."""
        if isinstance(self.plan, TabulatedPlan | ModalTablesPlan):
            return self.plan.recorded_samples
        return max(2, math.ceil(self.duration / self.step))

    @property
    def settling(self) -> int:
        """Steps at the beginning of what a plan records that are not kept."""
        # synthesised paths are flown in before they are recorded
        if isinstance(self.plan, TabulatedPlan | ModalTablesPlan):
            return 0
        return math.ceil(self.plan.burn_in / self.step)

    @property
    def block(self) -> int:
        """Paths made together."""
        width = self.plan.record_width if isinstance(self.plan, ModalPlan) else 3
        samples = self.samples + self.settling
        if isinstance(self.plan, ModalTablesPlan):
            samples = max(samples, self.plan.samples)
        return max(1, min(256, BLOCK_NUMBERS // (width * samples)))

    def sampled(self, step: float, duration: float) -> HistoryPlan:
        """The same at a sampling interval of at most `step`, in records of `duration` seconds."""
        plan = self.plan
        if isinstance(plan, TabulatedPlan):
            # a block repeats itself, but with a sine, which is not counted in what is flown first
            length = duration + (plan.warm_up if plan.waves else 0.0)
            if length > plan.block_length:
                plan = plan.with_block(length)
            plan = plan.with_step(min(step, plan.step))
            plan = replace(plan, counted=duration, blocks_per_path=1)
            return replace(self, plan=plan, duration=duration)
        if isinstance(plan, ModalTablesPlan):
            # one block that repeats itself neither in the record nor in what is flown before
            length = max(plan.block_length, duration + plan.burn_in)
            plan = plan.with_block(length).with_step(min(step, plan.step))
            return replace(self, plan=replace(plan, duration=duration), duration=duration)
        plan = plan.with_step(min(step, plan.step))
        # one step more than settling and record need: both are rounded up
        steps = math.ceil((plan.burn_in + duration) / plan.step) + 1
        plan = replace(plan, duration=steps * plan.step)
        return replace(self, plan=plan, duration=duration)

    def histories(self, seed: int, first_path: int, paths: int) -> Histories:
        """Records of the paths first_path, first_path + 1, ...: a function of its arguments."""
        found = self._made(seed, first_path, paths)
        # one that ends early is taken for one of `samples` by whoever divides by their time
        made = found.displacement.shape[2]
        if made != self.samples:
            raise AssertionError(f"a record has {made} samples, {self.samples} were promised")
        return found

    def _made(self, seed: int, first_path: int, paths: int) -> Histories:
        if isinstance(self.plan, TabulatedPlan):
            return self._synthesised(self.plan, seed, first_path, paths)
        if isinstance(self.plan, ModalPlan):
            return self._modal(self.plan, seed, first_path, paths)
        record = np.zeros((self.plan.recorded_samples, paths, 3))
        self.plan.averages(seed, first_path, paths, record)
        excitation = _kicks(self.plan, seed, first_path, paths)
        return _single(self._settled(record), self.plan.rest, self._settled(excitation))

    def _settled(self, record: Records) -> Records:
        return record[self.settling : self.settling + self.samples]

    def _modal(self, plan: ModalPlan, seed: int, first_path: int, paths: int) -> Histories:
        record = np.zeros((plan.recorded_samples, paths, plan.record_width))
        plan.averages(seed, first_path, paths, record)
        kept, n, shapes = self._settled(record), plan.modes.size, plan.modes.shapes
        rest = shapes @ plan.modes.rest
        return Histories(
            displacement=_mixed(shapes, kept[:, :, :n]) + rest[:, None, None],
            velocity=_mixed(shapes, kept[:, :, n : 2 * n]),
            impact_speed=np.ascontiguousarray(kept[:, :, 2 * n :].transpose(2, 1, 0)),
            excitation=None,
        )

    def _synthesised(
        self, plan: TabulatedPlan, seed: int, first_path: int, paths: int
    ) -> Histories:
        free = plan.free_response(seed, first_path, paths, 0)
        excitation = None if plan.waves else _input_of(plan, free)[: self.samples]
        record = np.zeros((plan.recorded_samples, paths, 3))
        sums = Sums.zeros(paths, plan.contacts).table
        plan.fly(free, plan.warm_up_samples, plan.recorded_samples, sums, record)
        return _single(record, plan.rest, excitation)


def _mixed(shapes: Records, modal: Records) -> Records:
    """(coordinates, paths, samples) from (samples, paths, modes)."""
    return np.ascontiguousarray(np.einsum("im,kpm->ipk", shapes, modal))


def _single(record: Records, rest: float, excitation: Records | None) -> Histories:
    """Of one oscillator, from (samples, paths, 3) and (samples, paths)."""
    x, v, w = np.ascontiguousarray(record.transpose(2, 1, 0))[:, None]
    known = None if excitation is None else np.ascontiguousarray(excitation.T)
    return Histories(displacement=x + rest, velocity=v, impact_speed=w, excitation=known)


def _kicks(plan: WhitePlan, seed: int, first_path: int, paths: int) -> Records:
    """White noise (samples, paths) that acts from each sample on, from the paths' own streams.

    The kernels draw a pair of normals for two steps in turn; the first pair is the start's.
    """
    steps = plan.recorded_samples
    streams = np.empty((2, paths), np.uint64)
    seed_streams(np.uint64(seed), first_path, streams)
    rows = 1 + math.ceil((steps + 1) / 2)
    even, odd = np.empty((2, rows, paths))
    normal_rows(streams[0], streams[1], even, odd)
    drawn = np.stack([even[1:], odd[1:]], axis=1).reshape(-1, paths)
    # a record begins at the end of the first step
    return math.sqrt(plan.system.intensity / plan.step) * drawn[1 : steps + 1]


def _input_of(plan: TabulatedPlan, free: Records) -> Records:
    """What shakes a synthesised response (samples, 2 paths): bin by bin, f = y / H."""
    omega, b = plan.system.omega, plan.system.damping_rate
    bins = rfft(free[:, 0::2], axis=0)
    w = 2.0 * math.pi / plan.block_length * np.arange(len(bins))
    bins *= ((omega - w) * (omega + w) + 1j * b * w)[:, None]
    return np.asarray(irfft(bins, plan.samples, axis=0))


def plan_histories(scene: Scene) -> HistoryPlan:
    """How records of a scene would be made; any scene that `simulate` covers.

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
    plan, assembly = make_plan(scene, None, None), assemble(scene)
    if isinstance(plan, TabulatedPlan):
        relaxation, speeds = plan.warm_up / WARM_UP_RELAXATIONS / 2.0, [plan.speed]
    elif isinstance(plan, ModalPlan):
        relaxation, speeds = plan.law.slowest, [pair.speed for pair in plan.pairs]
    else:
        if plan.burn_in <= plan.step:
            raise NotApplicable("records", ["the scene settles in more steps than a path can have"])
        relaxation, speeds = plan.burn_in / RELAXATIONS, [plan.speed]
    gaps = [
        contact.upper - contact.lower
        for contact in assembly.contacts
        if contact.lower is not None and contact.upper is not None
    ]
    flights = [math.pi * max(speeds) / gap for gap in gaps]
    return HistoryPlan(
        plan=plan,
        assembly=assembly,
        duration=plan.duration,
        slowest=relaxation,
        fastest=max([modes_of(assembly).fastest, *flights]),
        speed=max(speeds, default=0.0),
    )
