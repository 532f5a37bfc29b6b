"""Plans of one oscillator under white noise. Chapters: rigid stops; springs that are functions
where a mass meets its stops."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from stochvi.engine.arithmetic import NO_LOG, NO_RECORD, Log
from stochvi.engine.impact_laws import ScatteredRestitution
from stochvi.mathematics.impact_rates import COLLAPSE_RESTITUTION, TruncatedNormal, gaussian_stop
from stochvi.mathematics.numerics import Vector, root_between
from stochvi.model.coverage import compliant
from stochvi.model.modal import LinearLaw
from stochvi.model.model import FunctionOfMotion, Model, Pair, Stop
from stochvi.model.scales import (
    SLOW_IMPACTS,
    Motion,
    PairScale,
    default_threshold,
    default_thresholds,
    fastest_rate,
    is_positive,
    motions_of,
    scales_of,
    with_affine,
)
from stochvi.motion.kernels.flight import (
    CORNER_SHARE,
    N_LOWER,
    SUMS,
    VV,
    Corner,
    Counting,
    Flow,
    Kick,
    Paths,
    RigidStop,
    ScatteredStop,
    run_white,
)
from stochvi.motion.kernels.random_numbers import (
    normal_pairs,
)
from stochvi.motion.plan import (
    RELAXATIONS,
    SUMS_OF_PAIR,
    WELL_RESOLVED_RESTITUTION,
    Histories,
    Layout,
    Plan,
    Records,
    Underway,
    bias_of_plain_step,
    bias_of_refined_step,
    losses_of,
    lossiest,
    normals_of_steps,
    streams_of,
)
from stochvi.results.errors import NotApplicable
from stochvi.sampling.calculations import stop_flag
from stochvi.scenes.characteristics import NODES, WEIGHTS, WIDEST, LinearForm, SpringForce

# ------------------------------------------------------------------------------
# Rigid stops under white noise: the plan of kick-flow-kick (its step, start and lengths).
# ------------------------------------------------------------------------------


LARGEST_ANGLE = 1.0
"""Largest omega h of a step (rad) between elastic stops, where any step is free of bias. It is kept
below pi / 2, where a mass could hit both stops in one step; between 0.9 and 1.1 a second of motion
takes the least time."""

LOSSY_ANGLE = 0.32
"""Largest omega h of a step (rad) where stops lose energy. At a restitution of 0.5 the measured
relative errors are 4e-4 in the standard deviations, 5e-4 in F2 and less in F1; they grow with the
square of h."""

LOSSY_DECAY = 0.07
"""Largest b h of a step where stops lose energy (dimensionless); b is the damping rate (1/s) that
includes the losses at impacts."""

MOST_LEVELS = 10
"""Largest number of times that a step is halved near a stop."""

GAP_PER_STEP = 0.35
"""Fraction of the gap between two stops that a mass crosses in a step at its rms speed. Two impacts
in one step are then rare."""

ELASTIC_GAP_PER_STEP = 0.5
"""The same share between elastic stops, where two impacts in a step cost time only: at 1 sigma 0.7
% of the steps then have two impacts."""

BOUNCE_PER_STEP = 4.0
"""Largest step of a mass that is pressed against a stop, in units of the rms speed over the
pressing acceleration: a step then holds a few bounces."""

LONGEST_BLOCK = 2.0**24
"""Largest number of steps of all paths of a block together: they take about 0.1 s, or more where
impacts are very frequent."""

FEWEST_LANES = 64
"""Smallest number of paths in a block, however long they are: a step of 64 paths takes 1.1 times as
long for each as one of 1024, a step of 8 paths three times. A block is cut in time."""

MOST_PATHS = 1024
"""Largest number of paths in a block."""

MOST_STEPS = 1e8
"""Largest number of steps of one path. A scene that needs more has time scales too far apart for a
stationary average by simulation, and is refused."""

DURATION = 5.0
"""Default counted length of a path in units of its burn-in."""

COARSE_SHARE = 0.25
"""Share of the paths that are simulated at twice the step too, with the same noise. The error of
the bias is then about that which all paths would give with noise of their own: for two stops at 1
sigma 1.2 times as large at R = 0.5, and 0.9 times at R = 0.2."""

ENOUGH_STEPS = 2.0**14
"""Default number of counted steps of a path that starts in the stationary state, where the usual
length would need more than MOST_STEPS."""

LONGEST_ANGLE = math.pi
"""omega h (rad) from which a mass may cross a stop and return within one step undetected."""

LONGEST_ANGLE_BETWEEN = math.pi / 2.0
"""omega h (rad) up to which a mass between two stops hits at most one of them before it turns."""

MOMENT_ANGLE = 0.8
"""omega times the time between two samples of the moments (rad). Closer samples are so correlated
that they hardly reduce the error."""


@dataclass(frozen=True, kw_only=True)
class WhitePlan(Plan):
    """Steps, start and lengths for one scene under white noise (SI units, per unit mass).

    `corner_share` is the length of refined steps near a stop, in units of the time in which noise
    changes the state (`kernels.flight.step_near_stop`). Steps that are `merged` take the noise of
    two steps of half their length.
    """

    speed: float
    threshold: float
    merged: bool = False
    slow_impacts: bool = False
    corner_share: float = CORNER_SHARE

    states = 2
    kicked = True
    record_width = 3

    @property
    def method(self) -> str:
        """Name of the scheme, for the assumptions of a response."""
        return "kick-flow-kick" + (", steps refined near stops" if self.slow_impacts else "")

    @property
    def excitation_known(self) -> bool:
        """Whether histories hold the excitation: refined steps draw normals as they need them."""
        return not self.slow_impacts

    @property
    def block(self) -> int:
        """Number of paths in a block, the unit of work, which takes some seconds at most."""
        return block_of(self.steps_per_path, LONGEST_BLOCK)

    @property
    def hits_in_a_cluster(self) -> float:
        """Number of natural periods in a relaxation time of the energy, at least 1: there is at
        most one impact on a stop in a period."""
        remembered = 2.0 * self.speed**2 / self.model.intensity
        return max(1.0, self.model.omega / (2.0 * math.pi) * remembered)

    @property
    def origin(self) -> float:
        """Expected mean position, m, from which the moments of x are taken."""
        return self.model.rest + self._law.mean

    @cached_property
    def layout(self) -> Layout:
        """Meaning of the rows of `averages`."""
        (name,) = self.model.coordinates
        pair = self.model.pairs[0].name if self.model.pairs else ""
        rows = [(name, what) for what in ("x", "xx", "vv")]
        rows += [(pair, what) for what in SUMS_OF_PAIR]
        # the noise of a step is independent of the state before it
        controls = {("", "noise x"): 0.0, ("", "noise v"): 0.0}
        return Layout(
            rows=(*rows, *controls), origins={name: self.origin},
            thresholds={pair: self.threshold}, controls=controls,
        )  # fmt: skip

    @property
    def coarse_share(self) -> float:
        """Share of the paths that are simulated at twice the step too, for their bias; refined
        steps draw normals as they need them and share no noise with longer steps."""
        return 1.0 if self.slow_impacts else COARSE_SHARE

    @property
    def elastic(self) -> bool:
        """Whether no stop loses energy, so that any step leaves the stationary state exact."""
        return self.model.elastic

    def step_bias(self, name: str, difference: float) -> float | None:
        """The bias that the step leaves in a quantity, from its difference to twice the step; None
        where that difference does not determine the bias (`step_bias`)."""
        if self.slow_impacts:
            return bias_of_refined_step(name, difference, lossiest(self.model))
        # a load presses the mass on stops that take nearly all of its speed; the error of F2 then
        # falls more slowly than its order: at R = 0 the difference is a third of the bias
        held = lossiest(self.model) <= COLLAPSE_RESTITUTION and self.model.load != 0.0
        if held and name == "impact_speed_square_rate":
            return None
        usual_threshold = self.elastic or self.threshold >= RESOLVED_SPEED * self.speed
        resolved = usual_threshold and pressing(self.model) == 0.0
        return bias_of_plain_step(name, difference, lossiest(self.model), resolved)

    def coarser(self) -> Self:
        """The same paths at twice the step and with the same noise, to measure what the step leaves
        as bias."""
        return replace(self, step=2.0 * self.step, merged=True)

    def finer(self) -> Self:
        """The same paths with less bias.

        Slow impacts are resolved where half the step would hardly reduce their bias, unless the
        mass leans on a stop and they are too many; else the step is halved.
        """
        refinable = not (self.slow_impacts or pressing(self.model) > 0.0) and self.model.rigid
        if lossiest(self.model) < WELL_RESOLVED_RESTITUTION and refinable:
            return replace(self, slow_impacts=True)
        return replace(self, step=self.step / 2.0)

    def with_step(self, step: float) -> Self:
        """The same paths at a chosen step, s; ValueError if it is too long to detect all
        impacts."""
        angle = self.model.omega * step
        if self.model.stops and angle >= LONGEST_ANGLE:
            longest = LONGEST_ANGLE / self.model.omega
            raise ValueError(
                f"step must be below {longest:.3g} s, half a natural period, where there are "
                f"stops, got {step:g} s"
            )
        return replace(self, step=step)

    @property
    def fastest(self) -> float:
        """Natural frequency, rad/s."""
        return self.model.omega

    @property
    def relaxation(self) -> float:
        """Relaxation time of the energy, s."""
        if self.burn_in <= self.step:
            raise NotApplicable("records", "the scene settles in more steps than a path can have")
        return self.burn_in / RELAXATIONS

    @property
    def speeds(self) -> tuple[float, ...]:
        """The expected rms speed, m/s."""
        return (self.speed,)

    def record(self, seed: int, path: int) -> dict[str, NDArray[np.float64]]:
        """One path from its start, by column."""
        record = np.zeros((self.steps, 1, self.record_width))
        self.averages(seed, path, 1, record)
        x, v, w = record[:, 0].T
        return {"displacement": x + self.model.rest, "velocity": v, "impact_speed": w}

    def histories(
        self, seed: int, first_path: int, paths: int, samples: int, log: Log | None = None
    ) -> Histories:
        """Settled records of the paths first_path, first_path + 1, ..."""
        kept = slice(self.settling, self.settling + samples)
        record = np.zeros((self.steps, paths, self.record_width))
        averages = self.averages(seed, first_path, paths, record, log)
        x, v, w = np.ascontiguousarray(record[kept].transpose(2, 1, 0))[:, None]
        known = None
        if self.excitation_known:
            known = np.ascontiguousarray(self._kicks(seed, first_path, paths)[kept].T)
        return Histories(
            displacement=x + self.model.rest, velocity=v, impact_speed=w, excitation=known,
            lost=losses_of(self.model, self.layout, averages, self.steps * self.step),
        )  # fmt: skip

    def drive(
        self, seed: int, path: int, samples: int, integrals: int
    ) -> NDArray[np.float64] | None:
        """The force of the noise (1, samples), N; None where it is not known, and of its integral,
        which is not stationary."""
        if integrals or not self.excitation_known:
            return None
        kept = slice(self.settling, self.settling + samples)
        return self.model.unit_mass * self._kicks(seed, path, 1)[kept].T

    def _kicks(self, seed: int, first_path: int, paths: int) -> Records:
        """White noise (samples, paths), as the mean over the step after each sample."""
        earlier = self._kick.earlier if self.merged else None
        drawn = normals_of_steps(seed, first_path, paths, self.steps, earlier)
        return math.sqrt(self.model.intensity / self.step) * drawn

    def begin(
        self, seed: int, first_path: int, paths: int, record: Records | None = None,
        log: Log | None = None, accelerations: Records | None = None,
    ) -> WhitePaths:  # fmt: skip
        """The paths of `averages` before their first step; rigid stops have no `accelerations`."""
        return WhitePaths(self, seed, first_path, paths, record, log)

    @property
    def _stride(self) -> int:
        fastest = max(self.model.omega, 1.0 / self.burn_in)
        return max(1, round(MOMENT_ANGLE / fastest / self.step))

    def _at_mid_kick(self, sums: NDArray[np.float64]) -> NDArray[np.float64]:
        """Sums with velocities in the middle of the kick, half of which follows the summed ones."""
        decay = math.exp(-self.model.damping_rate * self.step)
        sums[VV] = decay * sums[VV] + _kick_variance(self.model, self.step / 2.0)
        return sums

    @property
    def _kick(self) -> Kick:
        """The kick over a step."""
        kick = kick_over(self.model, self.step)
        # of two kicks in a row the first one decays by the time of the second
        decay = math.sqrt(kick.decay)
        return kick._replace(earlier=decay / math.hypot(1.0, decay)) if self.merged else kick

    def _kernel_constants(self) -> tuple[Any, ...]:
        model = self.model
        # below this rebound speed the mass may hit the same stop again within the step
        again = model.omega * math.tan(model.omega * self.step / 2.0)

        def constants(stop: Stop | None) -> RigidStop | ScatteredStop | None:
            if stop is None:
                return None
            shifted, law = stop.position - model.rest, stop.law.compiled()
            if isinstance(law, ScatteredRestitution):
                return ScatteredStop(shifted, stop.law.restitution, math.inf, law)
            return RigidStop(shifted, stop.law.restitution, -stop.side * shifted * again)

        return (
            self._kick,
            _flow(model, self.step),
            constants(model.lower),
            constants(model.upper),
            () if self._between else None,
            self._corner(),
        )

    def _corner(self) -> Corner | None:
        """Sub-steps near a stop, as short as slow impacts need; None if they are not resolved."""
        model, h = self.model, self.step
        if self.elastic or not self.slow_impacts:
            return None
        slowest = max(self.threshold, 1e-3 * self.speed) / 6.0
        levels = math.ceil(math.log2(max(model.intensity * h / slowest**2, 1.0)))
        ladder = [_flow(model, h / 2**level)[:3] for level in range(min(levels, MOST_LEVELS) + 1)]
        time = h / self.corner_share
        return Corner(
            width=math.sqrt(model.intensity * time**3),
            speed=math.sqrt(model.intensity * time),
            damping_rate=model.damping_rate,
            intensity=model.intensity,
            stiff=model.omega**2,
            ladder=np.array(ladder),
            share=self.corner_share,
        )

    @cached_property
    def _law(self) -> TruncatedNormal:
        """The Gibbs distribution at the expected speed, from the static equilibrium."""
        return _law(self.model, self.speed, about_rest=True)

    @property
    def _between(self) -> bool:
        """Whether the stops lie on either side of the rest position, for which there is a faster
        kernel."""
        if len(self.model.stops) < 2 or self.model.scattered:
            return False
        if self.model.omega * self.step > LONGEST_ANGLE_BETWEEN:
            return False
        lower, upper = self.model.lower_position, self.model.upper_position
        return self.model.omega == 0.0 or lower <= self.model.rest <= upper

    def _start(
        self, streams: NDArray[np.uint64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Independent draws of the Gibbs distribution at the expected speed, which is close to
        stationary."""
        first, second = np.empty((2, streams.shape[1]))
        normal_pairs(streams[0], streams[1], first, second)
        probability, position = self._start_law
        return np.interp(ndtr(first), probability, position), self.speed * second

    @cached_property
    def _start_law(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Distribution function of the start position, as a table."""
        law = self._law
        spread = 9.0 * math.sqrt(law.variance)
        low, high = law.mean - spread, law.mean + spread
        low = low if law.lower is None else max(law.lower, low)
        high = high if law.upper is None else min(law.upper, high)
        grid = np.linspace(low, high, 2001)
        density = law.density(grid)
        cumulative = np.concatenate([[0.0], np.cumsum((density[1:] + density[:-1]) / 2.0)])
        return cumulative / cumulative[-1], grid


class WhitePaths(Underway):
    """Paths of a `WhitePlan` under way; see `WhitePlan.averages`."""

    def __init__(
        self, plan: WhitePlan, seed: int, first_path: int, paths: int,
        record: Records | None = None, log: Log | None = None,
    ) -> None:  # fmt: skip
        burn_in = 0 if record is not None else plan.burn_in_steps
        super().__init__(burn_in + plan.steps, 1, burn_in)
        streams = streams_of(seed, first_path, paths)
        x, v = plan._start(streams)
        sums, noise = np.zeros((SUMS, paths)), np.zeros((2, paths))
        self.plan = plan
        # half a kick is owed to a path before its first step
        kept = np.outer(np.ones(paths), (0.5 * plan.step, 0.0))
        self.paths = Paths(x, v, streams, sums, noise, kept)
        self.constants = plan._kernel_constants()
        self.outputs = NO_RECORD if record is None else record, log or NO_LOG

    def advance(self, segment: int, first: int, last: int) -> None:
        """Make the steps first, first + 1, ... before `last`."""
        plan = self.plan
        counting = Counting(
            first=first - self.burn_in, last=last - self.burn_in, stride=plan._stride,
            origin=plan.origin - plan.model.rest, threshold=plan.threshold,
        )  # fmt: skip
        run_white(self.paths, *self.constants, counting, *self.outputs, stop_flag())

    def averages(self) -> NDArray[np.float64]:
        """Time averages over the counted steps so far."""
        plan, sums = self.plan, self.paths.sums.copy()
        sums[:N_LOWER] /= math.ceil(self.counted / plan._stride)
        sums[N_LOWER:] /= self.counted * plan.step
        return np.concatenate([plan._at_mid_kick(sums), self.paths.noise / self.counted])


def plan_white(
    model: Model,
    threshold: float | None,
    duration: float | None,
    slow_impacts: bool = False,
    corner_share: float = CORNER_SHARE,
) -> WhitePlan:
    """Choose step, burn-in and length for a scene with white noise alone."""
    unmet = compliant(model)
    if model.omega == 0.0 and model.load != 0.0:
        unmet.append("a constant load needs stiffness > 0, got 0")
    if model.omega == 0.0 and len(model.stops) < 2:
        unmet.append("without stiffness the mass needs a lower and an upper stop")
    if model.damping_rate == 0.0 and model.elastic:
        unmet.append("damping must be positive or a restitution below 1 (no stationary state)")
    if unmet:
        raise NotApplicable("simulate", unmet)
    speed = expected_speed(model)
    step = _step(model, speed)
    burn_in, length = lengths(model, step, _slowest_time(model, speed), duration)
    return WhitePlan(
        model=model,
        speed=speed,
        step=step,
        burn_in=burn_in,
        duration=length,
        threshold=threshold_of(model, speed) if threshold is None else threshold,
        slow_impacts=slow_impacts,
        corner_share=corner_share,
    )


def lengths(
    model: Model, step: float, slowest: float, duration: float | None
) -> tuple[float, float]:
    """Burn-in and counted seconds of a path, from its slowest time constant.

    Between elastic stops a path starts in the stationary state itself: one that would take too many
    steps need not forget its start, and may be short.
    """
    burn_in = RELAXATIONS * slowest
    length = DURATION * burn_in if duration is None else duration
    if burn_in + length <= MOST_STEPS * step:
        return burn_in, length
    short = ENOUGH_STEPS * step if duration is None else duration
    if model.elastic and short < MOST_STEPS * step:
        return step, short
    steps = (burn_in + length) / step if step > 0.0 else math.inf
    raise NotApplicable(
        "simulate",
        f"a path needs {steps:.2g} steps ({burn_in:.2g} s of burn-in and "
        f"{length:.2g} s, in steps of {step:.2g} s), at most {MOST_STEPS:.0g} are made: the "
        "times in which the scene hits, swings and settles lie too far apart",
    )


def block_of(steps_per_path: int, longest: float) -> int:
    """Number of paths in a block of about `longest` steps, a multiple of FEWEST_LANES: paths that
    do not fill the vectors of the processor take as long as four times as many."""
    fitting = min(MOST_PATHS, int(longest // steps_per_path))
    return max(FEWEST_LANES, fitting - fitting % FEWEST_LANES)


RESOLVED_SPEED = 0.999 * SLOW_IMPACTS
"""Speed from which on the usual steps resolve impacts, over the rms speed: the default threshold,
which is of the rms speed by a linear structure."""


def threshold_of(model: Model, speed: float) -> float:
    """The default threshold of one oscillator, m/s; by its rms speed where no linear structure is
    found."""
    known = default_thresholds(model)
    if known is None:
        return max(default_threshold(pair, speed) for pair in model.pairs)
    return max(known.values(), default=0.0)


def expected_speed(model: Model) -> float:
    """Rms speed s in m/s from the energy balance of a Gibbs distribution at temperature s^2.

    b s^2 + sum (1 - R^2) F2(s) / 2 = S0 / 2. It is an estimate for the choice of steps and starts
    only.
    """

    def excess(log_speed: float) -> float:
        s = math.exp(log_speed)
        law = _law(model, s)
        loss = model.damping_rate * s * s
        for stop in model.stops:
            hits = gaussian_stop(law.density_at(stop.position), s * s)
            loss += (1.0 - stop.law.restitution_mean_square) / 2.0 * hits.speed_square_rate
        return loss / (model.intensity / 2.0) - 1.0

    if model.damping_rate > 0.0:
        high = 0.5 * math.log(model.intensity / (2.0 * model.damping_rate))
    else:
        high = math.log(model.intensity) / 3.0
        while excess(high) < 0.0:
            high += 1.0
    if excess(high) <= 1e-12:
        return math.exp(high)
    low = high - 1.0
    while excess(low) > 0.0:
        low -= 2.0
    return math.exp(root_between(excess, low, high, 1e-6))


def _law(model: Model, speed: float, *, about_rest: bool = False) -> TruncatedNormal:
    """The Gibbs distribution between rigid stops at E v^2 = speed^2.

    Positions are those from the unloaded spring, or from the rest position under the load.
    """
    origin = model.rest if about_rest else 0.0
    return TruncatedNormal(
        slope=0.0 if about_rest else model.load / speed**2,
        curvature=(model.omega / speed) ** 2,
        lower=None if model.lower is None else model.lower.position - origin,
        upper=None if model.upper is None else model.upper.position - origin,
    )


def _kick_variance(model: Model, h: float) -> float:
    """Variance of the velocity that noise adds in a time h: S0 (1 - e^(-2 b h)) / (2 b),
    m^2/s^2."""
    b = model.damping_rate
    return model.intensity * (-math.expm1(-2.0 * b * h) / (2.0 * b) if b else h)


def kick_over(model: Model, h: float) -> Kick:
    """The kick over a time h, s."""
    return Kick(math.exp(-model.damping_rate * h), math.sqrt(_kick_variance(model, h)))


def _flow(model: Model, h: float) -> Flow:
    """The flow over a time h, s."""
    angle = model.omega * h
    sine = math.sin(angle) / model.omega if angle else h
    return Flow(h, math.cos(angle), sine, model.omega**2)


def _step(model: Model, speed: float) -> float:
    limits = []
    if model.omega > 0.0:
        limits.append((LARGEST_ANGLE if model.elastic else LOSSY_ANGLE) / model.omega)
    if len(model.stops) == 2:
        share = ELASTIC_GAP_PER_STEP if model.elastic else GAP_PER_STEP
        limits.append(share * (model.upper_position - model.lower_position) / speed)
    if not model.elastic:
        limits.append(LOSSY_DECAY * 2.0 * speed**2 / model.intensity)
    if pressing(model) > 0.0:
        limits.append(BOUNCE_PER_STEP * speed / pressing(model))
    return min(limits)


def pressing(model: Model) -> float:
    """The acceleration in m/s^2 that presses a mass onto a stop beyond which it would rest, or
    0."""
    return max([0.0, *pressing_onto(model)])


def pressing_onto(model: Model) -> list[float]:
    """Acceleration in m/s^2 with which the load presses a mass onto each stop; negative for a stop
    that a mass at rest does not touch."""
    return [stop.side * (model.load - model.omega**2 * stop.position) for stop in model.stops]


def _slowest_time(model: Model, speed: float) -> float:
    """Slowest time constant, s: of the energy, or of the position of an overdamped mass, of one
    that moves from stop to stop, or of one that is pressed on a stop."""
    rate = model.intensity / (2.0 * speed**2)
    positions = []
    if model.omega > 0.0:
        positions.append(max(1.0 / model.omega, model.damping_rate / model.omega**2))
    if len(model.stops) == 2:
        gap = model.upper_position - model.lower_position
        positions.append(max(gap / speed, gap**2 * rate / speed**2))
    if pressing(model) > 0.0:
        spread = math.sqrt(_law(model, speed).variance)
        positions.append(max(spread / speed, spread**2 * rate / speed**2))
    return max(1.0 / rate, min(positions))


# ------------------------------------------------------------------------------
# Springs that are functions, where a mass meets its stops: the step and the linear part that suit.
#
# A step of length h kicks by the force g (per unit mass) that the linear part leaves out: half at
# its start, half at its end. An impact at the time t of the step comes after the impulse g h / 2,
# where g t is right. Its speed is wrong by g (h / 2 - t). The impact turns this error, and at the
# end of the step the velocity is wrong by (1 + R) g (t - h / 2). All t are alike: the mean is 0,
# and the mean square (1 + R)^2 g^2 h^2 / 12. Half of it is energy that no force has brought.
# Between impacts the errors of the kicks cancel. Those of a damper cancel at a stop, where its
# force turns with the velocity.
# ------------------------------------------------------------------------------


STEPS_OF_A_THROW = 40.0
"""Fewest steps in which a force that drives takes its mass from stop to stop."""

KICK_ANGLE = 0.5
"""Largest rate times step of a spring or damper that is a function, at displacements and velocities
of four standard deviations. At 2 kicks are no longer stable, and paths at twice the step show what
the step leaves as bias."""

MOST_HEAT = 0.002
"""Largest relative rise of the energy by kicks at stops, by its estimate. For masses between two
wells that estimates put at 0.0022, 0.0038 and 0.0097, E v^2 was 0.011, 0.013 and 0.024 too high
(standard errors 0.004, 0.003 and 0.009), and F2 0.06 at most."""

REACH, PLACES = 8.0, 2001
"""Farthest place of a gap with one stop, in standard deviations beyond its mean, and the number of
places at which its density is taken."""

PARALLEL = 1e-9
"""Largest relative difference of a spring's direction from that of a gap along which it acts."""


def with_linear_part_at_stops(model: Model, statistical: Model) -> Model:
    """The model with linear parts of its functions that allow steps of the usual length at stops.

    They are those of the model by statistical linearisation, unless these shorten the step. A
    spring along a gap then has the linear part that meets its force at the stops, if that allows
    longer steps.
    """
    usual, at_stops = _longest_of(statistical)
    if at_stops >= usual:
        return statistical
    meeting = meeting_stops(model, statistical)
    return meeting if min(_longest_of(meeting)) > at_stops else statistical


def _longest_of(model: Model) -> tuple[float, float]:
    """Longest steps, s, of a model with linear parts: between stops, and by the kicks at them; 0
    without a stationary state."""
    planned = model.with_noise_of_drives
    known = scales_of(planned, planned.modal) if is_positive(model.stiffness) else None
    if known is None:
        return 0.0, 0.0
    law, pairs = known
    fastest = model.modal.fastest
    swing = LOSSY_ANGLE / fastest if fastest > 0.0 else math.inf
    between = longest_between_stops(model, law, pairs)
    return min(swing, between), longest_at_stops(model, law, pairs)


def longest_between_stops(model: Model, law: LinearLaw, pairs: Sequence[PairScale]) -> float:
    """Longest step, s, in which functions move their masses little."""
    plays = [pair.play for pair in model.pairs if pair.play is not None]
    throw = min(plays, default=math.inf)
    limits = [
        part.law.time_of_throw(part.mass / part.count, throw) / STEPS_OF_A_THROW
        for part in model.functions
    ]
    motions = list(zip(model.functions, motions_of(model, law), strict=True))
    for pair, scale in zip(model.pairs, pairs, strict=True):
        for part in _springs(model):
            if way := _way(part, pair):
                y, density = _density(model, pair, scale)
                y = way * y[density >= math.exp(-(WIDEST**2) / 2.0) * density.max()]
                width = float(np.ptp(y)) / (2.0 * WIDEST)
                visited = Motion(float(y[0] + y[-1]) / 2.0, width, abs(way) * scale.speed)
                motions += [(part, visited)] if width > 0.0 else []
    rates = [fastest_rate(part, motion) for part, motion in motions]
    limits += [KICK_ANGLE / rate for rate in rates if rate > 0.0]
    return min(limits, default=math.inf)


def longest_at_stops(model: Model, law: LinearLaw, pairs: Sequence[PairScale]) -> float:
    """Longest step, s, in which the kicks of springs at stops raise the energy by MOST_HEAT.

    The energy of a gap is that of its damper and of its impacts: it decays with the rate
    b + nu (1 - R^2), or with that of the whole structure where this is larger.
    """
    if not _springs(model):
        return math.inf
    heating = 0.0
    for pair, scale, gap in zip(model.pairs, pairs, model.modal.gaps, strict=True):
        _, density = _density(model, pair, scale)
        kicks, decay = 0.0, float(gap @ model.modal.damping @ gap) / float(gap @ gap)
        for stop in pair.stops:
            square = _square_of_kick(model, law, pair, stop, gap)
            at_stop = float(density[-1 if stop is pair.upper else 0])
            rate = at_stop * scale.speed / math.sqrt(2.0 * math.pi)
            kicks += rate * (1.0 + stop.law.restitution) ** 2 * square / 24.0
            decay += rate * (1.0 - stop.law.restitution_mean_square)
        heating += kicks / scale.speed**2 / max(decay, 1.0 / law.slowest)
    return math.sqrt(MOST_HEAT / heating) if heating > 0.0 else math.inf


def _springs(model: Model) -> list[FunctionOfMotion]:
    """The springs that are functions of the motion alone."""
    return [
        part
        for part in model.functions
        if isinstance(part.law, SpringForce) and not (part.law.remembers or part.law.drives)
    ]


def _square_of_kick(model: Model, law: LinearLaw, pair: Pair, stop: Stop, gap: Vector) -> float:
    """Mean square of the acceleration of a gap, m/s^2, at a stop, by what springs leave out."""
    modes, n = model.modal, model.modal.size
    variance = law.variances(gap, 0)
    away = stop.position - float(gap @ (modes.rest + law.mean))
    mean = spread = 0.0
    for part in _springs(model):
        row: Vector = part.direction @ modes.shapes
        shared = (law.variances(row + gap, 0) - law.variances(row - gap, 0)) / 4.0
        centre = float(row @ (modes.rest + law.mean)) + shared / variance * away
        left = law.variances(row, 0) - shared**2 / variance
        width = math.sqrt(max(left, 0.0))
        force = _mean_force(part, centre + width * NODES, math.sqrt(law.variances(row, n)))
        coupling = float(gap @ row)
        average = float(WEIGHTS @ force)
        mean += coupling * average
        spread += coupling**2 * float(WEIGHTS @ (force - average) ** 2)
    return mean**2 + spread


def _mean_force(part: FunctionOfMotion, places: Vector, speed: float) -> Vector:
    """Force, N, that the linear part leaves out at places (m), as a mean over normal speeds."""
    if part.law.needs == "displacement":
        return part.force_left_out(places, 0.0)
    return np.asarray(
        part.force_left_out(*np.broadcast_arrays(places[:, None], speed * NODES)) @ WEIGHTS
    )


def _way(part: FunctionOfMotion, pair: Pair) -> float:
    """Displacement of a spring per unit of a gap along which it acts; 0 of any other spring."""
    square = float(pair.direction @ pair.direction)
    way = float(part.direction @ pair.direction) / square
    rest = part.direction - way * pair.direction
    return way if np.max(np.abs(rest)) <= PARALLEL * math.sqrt(square) else 0.0


def _density(model: Model, pair: Pair, scale: PairScale) -> tuple[Vector, Vector]:
    """Places of a gap between its stops, m, and the density of Gibbs there, 1/m: that of the linear
    structure, with the whole force of springs along the gap."""
    away = REACH * scale.deviation
    centre = scale.slope / scale.curvature if scale.curvature > 0.0 else pair.stops[0].position
    nearest = [centre, *(stop.position for stop in pair.stops)]
    low = pair.lower.position if pair.lower else min(nearest) - away
    high = pair.upper.position if pair.upper else max(nearest) + away
    y = np.linspace(low, high, PLACES)
    exponent = scale.slope * y - scale.curvature * y**2 / 2.0
    for part in _springs(model):
        if way := _way(part, pair):
            force = way * _mean_force(part, way * y, abs(way) * scale.speed)
            energy = np.cumsum((force[1:] + force[:-1]) / 2.0 * (y[1] - y[0]))
            exponent[1:] -= energy / (pair.mass * scale.speed**2)
    density = np.exp(exponent - exponent.max())
    return y, density / (density.sum() * (y[1] - y[0]))


def meeting_stops(model: Model, usual: Model) -> Model:
    """The model whose springs along gaps have linear parts that meet their forces at the stops;
    the linear parts of all others are those of the `usual` model."""
    forms = []
    for part in usual.functions:
        stiffness, damping, offset = (part.mass * each for each in part.affine)
        places = _places_of_stops(part, usual) if part in _springs(usual) else []
        forces = [offset + stiffness * x + float(part.force_left_out(x, 0.0)) for x in places]
        if len(places) == 2:
            stiffness = (forces[1] - forces[0]) / (places[1] - places[0])
        if places:
            offset = forces[0] - stiffness * places[0]
        forms.append(LinearForm(offset, stiffness, damping))
    return with_affine(model, forms)


def _places_of_stops(part: FunctionOfMotion, model: Model) -> list[float]:
    """Displacements of a spring at which a gap along it meets its nearest stop on either side."""
    nearest: dict[bool, float] = {}
    for pair in model.pairs:
        way = _way(part, pair)
        for stop in pair.stops if way else ():
            place, above = way * stop.position, way * stop.side > 0.0
            pick = min if above else max
            nearest[above] = pick(place, nearest.get(above, place))
    return list(nearest.values())
