"""White noise: how a scene is laid out for kick-flow-kick, and one block of its paths."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.special import ndtr

from stochvi.mathematics.cut_normal import CutNormal
from stochvi.mathematics.impact_rates import COLLAPSE_RESTITUTION, corner_exponent, gaussian_stop
from stochvi.methods.monte_carlo.kernels.flight import CORNER_SHARE, run_white
from stochvi.methods.monte_carlo.kernels.impact_log import Log
from stochvi.methods.monte_carlo.kernels.random_numbers import normal_pairs, seed_streams
from stochvi.methods.monte_carlo.kernels.rows import N_LOWER, SUMS, VV
from stochvi.methods.monte_carlo.kernels.steps import Corner, Counting, Flow, Kick, RigidStop
from stochvi.methods.monte_carlo.quantities import RATES
from stochvi.results.errors import NotApplicable
from stochvi.scenes.scene import System

LARGEST_ANGLE = 0.8
"""omega h of a step where any step is free of bias (elastic stops); kept well below pi / 2."""

LOSSY_ANGLE = 0.32
"""omega h of a step where stops lose energy: at R = 0.5 errors of 4e-4 in the deviations, 5e-4 in
F2 and less in F1, growing as h^2."""

LOSSY_DECAY = 0.07
"""b h of such a step, b the damping rate including the losses at impacts."""

WELL_RESOLVED_RESTITUTION = 0.5
"""From here up a plain step resolves impacts faster than the default threshold; below, bounces
are so slow that steps near a stop have to be refined for the rates."""

MOST_LEVELS = 10
"""Halvings of a step near a stop."""

GAP_PER_STEP = 0.35
"""Share of the gap that the mass crosses in a step at its rms speed: few double impacts."""

BOUNCE_PER_STEP = 4.0
"""Time in which the pressing force takes back the rms speed, times this, bounds a step of a mass
pressed against a stop: some bounces a step."""

LONGEST_BLOCK = 2.0**24
"""Steps of all paths of a block together: a tenth of a second, more where the mass chatters."""

MOST_PATHS = 1024
"""Of a block."""

MOST_STEPS = 1e8
"""Of one path; a scene that asks for more has no sensible stationary average here."""

RELAXATIONS = 12.0
"""Burn-in in slowest time constants: the start is forgotten to e^-12 of its small error."""

DURATION = 5.0
"""Length of a path in burn-ins, where the caller does not choose."""

ENOUGH_STEPS = 2.0**14
"""Of a path that starts in the stationary law and is shorter than the memory of its energy."""

LONGEST_ANGLE = math.pi
"""omega h from which a mass may pass a stop and come back within a step unseen."""

LONGEST_ANGLE_BETWEEN = math.pi / 2.0
"""omega h up to which a mass between two stops meets at most one of them without turning."""

MOMENT_ANGLE = 0.8
"""omega times the time between samples of the moments; closer samples say little more."""


@dataclass(frozen=True, kw_only=True)
class WhitePlan:
    """Steps, start and lengths for one scene under white noise (SI units, per unit mass).

    `corner_share` is the length of refined steps near a stop, in the time in which noise changes
    the state altogether (`kernels.flight.fly_corner`).
    """

    system: System
    speed: float
    step: float
    burn_in: float
    duration: float
    threshold: float
    slow_impacts: bool = False
    corner_share: float = CORNER_SHARE

    rows = SUMS
    contacts = False
    states = 2
    _kernel = staticmethod(run_white)

    @property
    def method(self) -> str:
        """What is done, in words."""
        return "kick-flow-kick" + (", steps refined near stops" if self.slow_impacts else "")

    @property
    def block(self) -> int:
        """Paths to a block, the unit of work: some seconds at most."""
        return max(8, min(MOST_PATHS, int(LONGEST_BLOCK // self.steps_per_path)))

    @property
    def hits_in_a_cluster(self) -> float:
        """Periods in which the energy is remembered, at most one hit each on either stop."""
        remembered = 2.0 * self.speed**2 / self.system.intensity
        return max(1.0, self.system.omega / (2.0 * math.pi) * remembered)

    @property
    def rest(self) -> float:
        """Rest position under the load."""
        return self.system.load / self.system.omega**2 if self.system.load else 0.0

    @property
    def origin(self) -> float:
        """About where the mass stays: moments of x are taken from here."""
        return self.rest + self._law.mean

    @property
    def elastic(self) -> bool:
        """Whether no stop loses energy, so that any step leaves the stationary law exact."""
        return self.system.elastic

    def step_bias(self, name: str, difference: float) -> float | None:
        """What the step leaves in a quantity, from its difference to twice the step; None where
        that does not tell: rates of impacts too slow for a plain step.

        A refined step resolves slow impacts with the velocity that noise brings in it, which goes
        with its square root.
        """
        if not self.slow_impacts:
            usual = self.threshold >= default_threshold(self.elastic, self.speed)
            resolved = self._lossiest >= WELL_RESOLVED_RESTITUTION and usual and not self._pressed
            known = resolved or name not in RATES
            return extrapolated(name, difference, self._lossiest) if known else None
        known = self._lossiest > COLLAPSE_RESTITUTION
        if name not in RATES and known:  # an order of about 1 is left where stops lose much
            return difference if self._lossiest < WELL_RESOLVED_RESTITUTION else difference / 3.0
        known |= name not in RATES
        return difference / (math.sqrt(2.0) - 1.0) if known else None

    @property
    def _lossiest(self) -> float:
        """The smallest restitution of a stop, 1 where there is none."""
        return min((law.restitution for law in self.system.laws if law is not None), default=1.0)

    @property
    def _pressed(self) -> bool:
        """Whether the rest position lies beyond a stop, so that the mass leans on it."""
        return pressing(self.system) > 0.0

    @property
    def steps(self) -> int:
        """Counted steps of a path."""
        return max(2, math.ceil(self.duration / self.step))

    @property
    def steps_per_path(self) -> int:
        """All steps of a path, burn-in included."""
        return self.steps + self._burn_in_steps

    @property
    def _burn_in_steps(self) -> int:
        return math.ceil(self.burn_in / self.step)

    def coarser(self) -> WhitePlan:
        """The same paths at twice the step, to measure what the step leaves as bias."""
        return replace(self, step=2.0 * self.step)

    def finer(self) -> WhitePlan:
        """The same paths with less bias: slow impacts resolved, where half the step would do
        little for what they leave (of a mass that leans on a stop they are too many); else half
        the step."""
        refinable = not (self.system.not_rigid() or self.slow_impacts or self._pressed)
        if self._lossiest < WELL_RESOLVED_RESTITUTION and refinable:
            return replace(self, slow_impacts=True)
        return replace(self, step=self.step / 2.0)

    def with_step(self, step: float) -> WhitePlan:
        """The same paths at a chosen step, s; ValueError if impacts would go unseen in it."""
        angle = self.system.omega * step
        if self.system.laws != (None, None) and angle >= LONGEST_ANGLE:
            longest = LONGEST_ANGLE / self.system.omega
            raise ValueError(
                f"step must be below {longest:.3g} s, half a natural period, where there are "
                f"stops, got {step:g} s"
            )
        return replace(self, step=step)

    def shortest(self) -> WhitePlan:
        """Two steps: enough to have the kernels compiled."""
        return replace(self, burn_in=self.step, duration=2.0 * self.step)

    @property
    def recorded_samples(self) -> int:
        """Samples of a recorded path."""
        return self.steps

    def averages(
        self,
        seed: int,
        first_path: int,
        paths: int,
        record: NDArray[np.float64] | None = None,
        log: Log | None = None,
    ) -> NDArray[np.float64]:
        """Time averages (rows, paths) of the paths first_path, first_path + 1, ..., with positions
        from `origin`; a `log` takes every impact."""
        streams = np.empty((2, paths), np.uint64)
        seed_streams(np.uint64(seed), first_path, streams)
        x, v = self._start(streams)
        sums = np.zeros((self.rows, paths))
        burn_in = 0 if record is not None else self._burn_in_steps
        stride = self._stride
        self._kernel(
            x, v, streams, sums, *self._kernel_constants(),
            Counting(
                burn_in=burn_in, steps=self.steps, stride=stride, origin=self.origin - self.rest,
                threshold=self.threshold,
            ),
            record, log,
        )  # fmt: skip
        sums[:N_LOWER] /= math.ceil(self.steps / stride)
        sums[N_LOWER:] /= self.steps * self.step
        return self._at_mid_kick(sums)

    @property
    def _stride(self) -> int:
        fastest = max(self.system.omega, 1.0 / self.burn_in)
        return max(1, round(MOMENT_ANGLE / fastest / self.step))

    def _at_mid_kick(self, sums: NDArray[np.float64]) -> NDArray[np.float64]:
        """Velocities in the middle of the kick: half of it, over h / 2, after those summed."""
        decay = math.exp(-self.system.damping_rate * self.step)
        sums[VV] = decay * sums[VV] + _kick_variance(self.system, self.step / 2.0)
        return sums

    def _kernel_constants(self) -> tuple[Any, ...]:
        system = self.system
        # the same stop is met again within the step after leaving slower than this
        again = system.omega * math.tan(system.omega * self.step / 2.0)

        def stop(position: float | None, restitution: float | None, side: float) -> Any:
            if position is None or restitution is None:
                return None
            shifted = position - self.rest
            return RigidStop(shifted, restitution, -side * shifted * again)

        return (
            _kick(system, self.step),
            _flow(system, self.step),
            stop(system.lower, system.restitution_lower, -1.0),
            stop(system.upper, system.restitution_upper, +1.0),
            () if self._between else None,
            self._corner(),
        )

    def _corner(self) -> Corner | None:
        """Steps near a stop as short as slow impacts need, if they are asked for."""
        system, h = self.system, self.step
        if self.elastic or not self.slow_impacts:
            return None
        slowest = max(self.threshold, 1e-3 * self.speed) / 6.0
        levels = math.ceil(math.log2(max(system.intensity * h / slowest**2, 1.0)))
        ladder = [_flow(system, h / 2**level)[:3] for level in range(min(levels, MOST_LEVELS) + 1)]
        time = h / self.corner_share
        return Corner(
            width=math.sqrt(system.intensity * time**3),
            speed=math.sqrt(system.intensity * time),
            damping_rate=system.damping_rate,
            intensity=system.intensity,
            ladder=np.array(ladder),
            share=self.corner_share,
        )

    @cached_property
    def _law(self) -> CutNormal:
        """The Gibbs law at the expected speed, from the rest position."""
        rest, system = self.rest, self.system
        return CutNormal(
            slope=0.0,
            curvature=(system.omega / self.speed) ** 2,
            lower=None if system.lower is None else system.lower - rest,
            upper=None if system.upper is None else system.upper - rest,
        )

    @property
    def _between(self) -> bool:
        """Whether the stops lie on either side of the rest position, which is quicker to fly."""
        lower, upper = self.system.lower, self.system.upper
        if lower is None or upper is None:
            return False
        if self.system.omega * self.step > LONGEST_ANGLE_BETWEEN:
            return False
        return self.system.omega == 0.0 or lower <= self.rest <= upper

    def _start(
        self, streams: NDArray[np.uint64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Independent draws of the Gibbs law at the expected speed: close to stationary."""
        first, second = np.empty((2, streams.shape[1]))
        normal_pairs(streams[0], streams[1], first, second)
        probability, position = self._start_law
        return np.interp(ndtr(first), probability, position), self.speed * second

    @property
    def _walls(self) -> tuple[float, float]:
        """Positions of the rigid stops from rest; infinite where there is none."""
        law = self._law
        return (
            -math.inf if law.lower is None else law.lower,
            math.inf if law.upper is None else law.upper,
        )

    @cached_property
    def _start_law(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Distribution function of the start position, as a table."""
        law = self._law
        spread = 9.0 * math.sqrt(law.variance)
        lowest, highest = self._walls
        low, high = max(lowest, law.mean - spread), min(highest, law.mean + spread)
        grid = np.linspace(low, high, 2001)
        density = law.density(grid)
        cumulative = np.concatenate([[0.0], np.cumsum((density[1:] + density[:-1]) / 2.0)])
        return cumulative / cumulative[-1], grid


def plan_white(
    system: System, threshold: float | None, duration: float | None, slow_impacts: bool = False
) -> WhitePlan:
    """Choose step, burn-in and length for a scene with white noise alone."""
    unmet = system.not_rigid()
    if system.omega == 0.0 and system.load != 0.0:
        unmet.append("a constant load needs stiffness > 0, got 0")
    if system.omega == 0.0 and (system.lower is None or system.upper is None):
        unmet.append("without stiffness the mass needs a lower and an upper stop")
    if system.damping_rate == 0.0 and system.elastic:
        unmet.append("damping must be positive or a restitution below 1 (no stationary state)")
    if unmet:
        raise NotApplicable("simulate", unmet)
    speed = expected_speed(system)
    step = _step(system, speed)
    burn_in, length = lengths(system, step, _slowest_time(system, speed), duration)
    return WhitePlan(
        system=system,
        speed=speed,
        step=step,
        burn_in=burn_in,
        duration=length,
        threshold=default_threshold(system.elastic, speed) if threshold is None else threshold,
        slow_impacts=slow_impacts,
    )


def lengths(
    system: System, step: float, slowest: float, duration: float | None
) -> tuple[float, float]:
    """Burn-in and counted seconds of a path, from its slowest time constant.

    Between elastic stops a path starts in the stationary law itself: one that would take too many
    steps need not forget its start, and may be short.
    """
    burn_in = RELAXATIONS * slowest
    length = DURATION * burn_in if duration is None else duration
    if burn_in + length <= MOST_STEPS * step:
        return burn_in, length
    short = ENOUGH_STEPS * step if duration is None else duration
    if system.elastic and short < MOST_STEPS * step:
        return step, short
    raise NotApplicable(
        "simulate",
        [f"a path needs {(burn_in + length) / step:.2g} steps ({burn_in:.2g} s of burn-in and "
         f"{length:.2g} s, in steps of {step:.2g} s), at most {MOST_STEPS:.0g} are made: the "
         "times in which the scene hits, swings and settles lie too far apart"],
    )  # fmt: skip


SPEED_POWER = {
    "collision_rate": 0, "collision_rate_lower": 0, "collision_rate_upper": 0,
    "impact_speed_mean": 0, "impact_speed_square_rate": 2,
}  # fmt: skip
"""Power of the impact speed that a quantity adds up; all others hang on the impulses, power 1."""


def extrapolated(name: str, difference: float, restitution: float) -> float:
    """Bias at a step from the difference to twice the step, difference / (2^order - 1).

    A step resolves impact speeds above about sqrt(S0 h). Their density is w^(1 - beta) near 0, so
    those below hold a share h^((2 + m - beta) / 2) of the sum of w^m over impacts; the scheme
    itself is of order 2.

    >>> [round(extrapolated("impact_speed_rate", 0.3, r), 3) for r in (0.8, 0.5, 0.2)]
    [0.192, 0.3, 0.643]
    """
    power = SPEED_POWER.get(name, 1)
    order = min(2.0, (2.0 + power - corner_exponent(restitution)) / 2.0)
    # at R <= exp(-pi / sqrt 3) the rate has no limit at all
    return difference / (2.0**order - 1.0) if order > 0.0 else math.inf


def default_threshold(elastic: bool, speed: float) -> float:
    """Impacts slower than this are left out of the rates (never out of F1 and F2).

    At a stop that loses energy slow impacts come in bursts without end: their rate converges
    slowly with any resolution, and is infinite below R = exp(-pi / sqrt 3).
    """
    return 0.0 if elastic else 0.05 * speed


def expected_speed(system: System) -> float:
    """Velocity scale s from the energy balance, if the law were Gibbs at temperature s^2.

    b s^2 + sum (1 - R^2) F2(s) / 2 = S0 / 2. A guess, for steps and starts only.
    """

    def excess(log_speed: float) -> float:
        s = math.exp(log_speed)
        law = _law(system, s)
        loss = system.damping_rate * s * s
        for position, restitution in (
            (system.lower, system.restitution_lower),
            (system.upper, system.restitution_upper),
        ):
            if position is not None and restitution is not None:
                stop = gaussian_stop(law.density_at(position), s * s)
                loss += (1.0 - restitution**2) / 2.0 * stop.speed_square_rate
        return loss / (system.intensity / 2.0) - 1.0

    if system.damping_rate > 0.0:
        high = 0.5 * math.log(system.intensity / (2.0 * system.damping_rate))
    else:
        high = math.log(system.intensity) / 3.0
        while excess(high) < 0.0:
            high += 1.0
    if excess(high) <= 1e-12:
        return math.exp(high)
    low = high - 1.0
    while excess(low) > 0.0:
        low -= 2.0
    return math.exp(float(brentq(excess, low, high, xtol=1e-6)))


def _law(system: System, speed: float) -> CutNormal:
    return CutNormal(
        slope=system.load / speed**2,
        curvature=(system.omega / speed) ** 2,
        lower=system.lower,
        upper=system.upper,
    )


def _kick_variance(system: System, h: float) -> float:
    """Variance of the velocity that noise brings in over h: S0 (1 - e^(-2 b h)) / (2 b)."""
    b = system.damping_rate
    return system.intensity * (-math.expm1(-2.0 * b * h) / (2.0 * b) if b else h)


def _kick(system: System, h: float) -> Kick:
    """The kick over h."""
    return Kick(math.exp(-system.damping_rate * h), math.sqrt(_kick_variance(system, h)))


def _flow(system: System, h: float) -> Flow:
    """The flow over h."""
    angle = system.omega * h
    sine = math.sin(angle) / system.omega if angle else h
    return Flow(h, math.cos(angle), sine, system.omega**2)


def _step(system: System, speed: float) -> float:
    limits = []
    if system.omega > 0.0:
        limits.append((LARGEST_ANGLE if system.elastic else LOSSY_ANGLE) / system.omega)
    if system.lower is not None and system.upper is not None:
        limits.append(GAP_PER_STEP * (system.upper - system.lower) / speed)
    if not system.elastic:
        limits.append(LOSSY_DECAY * 2.0 * speed**2 / system.intensity)
    if pressing(system) > 0.0:
        limits.append(BOUNCE_PER_STEP * speed / pressing(system))
    return min(limits)


def pressing(system: System) -> float:
    """The acceleration that presses a mass onto a stop beyond which it would rest, or 0."""
    stops = ((system.lower, -1.0), (system.upper, 1.0))
    forces = [
        side * (system.load - system.omega**2 * stop) for stop, side in stops if stop is not None
    ]
    return max([0.0, *forces])


def _slowest_time(system: System, speed: float) -> float:
    """Relaxation of the energy, and of the position: overdamped, from stop to stop, or of a mass
    that leans on one."""
    rate = system.intensity / (2.0 * speed**2)
    positions = []
    if system.omega > 0.0:
        positions.append(max(1.0 / system.omega, system.damping_rate / system.omega**2))
    if system.lower is not None and system.upper is not None:
        gap = system.upper - system.lower
        positions.append(max(gap / speed, gap**2 * rate / speed**2))
    if pressing(system) > 0.0:
        spread = math.sqrt(_law(system, speed).variance)
        positions.append(max(spread / speed, spread**2 * rate / speed**2))
    return max(1.0 / rate, min(positions))
