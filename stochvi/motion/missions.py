"""Missions of one oscillator under white noise. Chapters: the plan of their steps, start and end;
rare events by splitting."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from stochvi.mathematics.numerics import Matrix, Vector
from stochvi.model.model import LOWER, UPPER, Model, Pair, Stop
from stochvi.motion.choose_plan import plan_several
from stochvi.motion.modal import ModalPlan
from stochvi.motion.plan import RELAXATIONS, streams_of
from stochvi.motion.white import MOST_STEPS
from stochvi.results.deadline import NEVER, Deadline
from stochvi.results.errors import NotApplicable, NotConverged
from stochvi.results.estimates import binomial_interval, logarithmic_interval, mean_and_error
from stochvi.results.files import thread_seconds
from stochvi.sampling.calculations import LANES, GivenUp, given_up_after
from stochvi.scenes.impact_laws import CompliantLaw, Restitution

Start = Literal["rest", "stationary"]
"""How a mission begins: at rest, or in the stationary motion."""

OVER, AT_LEVEL, HAPPENED = range(3)
"""How a path ended: its time is over, it reached the level, or the event happened."""

Kind = Literal["passage", "impact", "force", "nothing"]
"""Events: the mass passes a barrier; it hits a stop at a given speed or faster; the force of a stop
exceeds its limit; there is no event."""

MISSION_ANGLE = 0.4
"""Largest omega h of a step (rad). The probability P of a passage of 3 standard deviations within
10 periods at a damping ratio of 0.05 then has a relative error below 0.2 %."""

TOGETHER = 64
"""Largest number of steps that paths make before those that have ended make room for others."""

CLIMB_RELAXATIONS = 6.0
"""Length of the stationary motion that is simulated before a mission, in time constants of the
energy. In it, splitting finds the rare states from which a mission fails soon after its start."""

SHORT_CLIMB = 1.0
"""The same length for missions shorter than CLIMB_RELAXATIONS: paths that reached a high energy
much earlier have lost it when such a mission begins, so that levels reached early do not help."""

GAP_PER_STEP = 0.25
"""Largest share of the gap between two stops that a mass at the limiting speed crosses in a step.
The limit is checked at every impact, but noise changes the speed only once a step: at a share of
0.6 the probability is 2.5 % too low."""

RARE_BIAS, BIAS_OF_SHARE = 0.02, 0.068
"""Relative bias of the step that a probability of fast impacts on inelastic stops may have, and
that bias over (v h / s T)^2, with v the limiting speed, s the rms speed, h the step and T the time
of a flight between two impacts. The kicks of a step spread evenly over T have that much more of the
most likely noise. At R = 0.8, v = 4.5 s and h = T / 4 the probability was 8 % too high (standard
error 2 %), at h = T / 2 39 % (7 %)."""

LEAST_STEPS = 4
"""Smallest number of steps of a mission, so that it can be simulated at twice the step as well."""


@dataclass(frozen=True, kw_only=True)
class Event:
    """The event that ends a mission, a failure for example; `limit` are the forces per unit mass
    (m/s^2) of the lower and the upper stop that one of the `kind` "force" exceeds."""

    kind: Kind
    limit: tuple[float, float] = (0.0, 0.0)


class Fleet(NamedTuple):
    """Paths of missions.

    Parameters
    ----------
    state, streams
        State of the plan (states, paths), and random streams (2, paths).
    left, hits
        (paths,): steps left; impacts in the counted steps.
    top
        (paths,): largest E2 so far, which is twice the energy in modal coordinates without that
        stored in a stop; infinite where the event happened.
    how
        (paths,): OVER, AT_LEVEL or HAPPENED.
    """

    state: Matrix
    streams: NDArray[np.uint64]
    left: NDArray[np.int64]
    top: Vector
    how: NDArray[np.int64]
    hits: Vector

    @classmethod
    def at(cls, state: Matrix, streams: NDArray[np.uint64], left: int) -> Fleet:
        """Paths at their start, in which the event has not happened."""
        paths = state.shape[1]
        how, top, hits = np.full(paths, OVER), np.zeros(paths), np.zeros(paths)
        return cls(state, streams, np.full(paths, left), top, how, hits)

    @property
    def happened(self) -> NDArray[np.bool_]:
        """Mask of the paths in which the event happened."""
        return np.equal(self.how, HAPPENED)

    def chosen(self, paths: NDArray[Any]) -> Fleet:
        """A copy of the paths with these numbers or under this mask; numbers may repeat."""
        fields: list[Any] = [np.ascontiguousarray(each[..., paths]) for each in self]
        return Fleet(*fields)

    def put(self, paths: NDArray[np.intp], others: Fleet) -> None:
        """Write others in the place of the paths with these numbers."""
        for own, new in zip(self, others, strict=True):
            own[..., paths] = new


@dataclass(frozen=True, kw_only=True)
class MissionPlan:
    """Steps and start of missions of one scene (SI units).

    Parameters
    ----------
    base
        The plan for the scene, whose speed threshold is that of the impacts that count. Barriers
        are rigid stops.
    counted, before
        Steps of a mission, and of the motion before it in which energies above a level count.
    settled
        Steps before these, in which a motion between stops becomes stationary.
    """

    base: ModalPlan
    event: Event
    start: Start
    mission: float
    counted: int
    before: int
    settled: int

    @property
    def step(self) -> float:
        """Time step, s."""
        return self.mission / self.counted

    @cached_property
    def plan(self) -> ModalPlan:
        """The plan of the counted steps."""
        return self.base.with_step(self.step)

    @cached_property
    def plan_before(self) -> ModalPlan:
        """The plan of the steps before: barriers act in the counted steps only."""
        if self.event.kind != "passage":
            return self.plan
        free = replace(self.base.model, pairs=())
        return replace(self.plan, model=free, pairs=())

    @property
    def steps_per_path(self) -> int:
        """Number of steps of a path in which the event does not happen."""
        return self.counted + self.before + self.settled

    def coarser(self) -> MissionPlan:
        """The same missions at twice the step, to measure the bias of the step."""
        counted = max(1, round(self.counted / 2))
        before, settled = math.ceil(self.before / 2), math.ceil(self.settled / 2)
        return replace(self, counted=counted, before=before, settled=settled)

    def fleet(self, seed: int, first_path: int, paths: int) -> Fleet:
        """Paths at their start, whose streams depend on seed and path number alone."""
        streams = streams_of(seed, first_path, paths)
        left = self.counted + self.before
        if self.start == "rest":
            return Fleet.at(self.plan.after_first_step(streams), streams, left - 1)
        fleet = Fleet.at(self.plan_before.start(streams), streams, self.settled)
        if self.settled:
            self.advance(fleet, math.inf, NO_EVENT)
        return Fleet.at(fleet.state, streams, left)

    def advance(self, fleet: Fleet, level: float, event: Event | None = None) -> int:
        """Simulate the paths that have steps left, in place, until their event, the level or their
        end; returns the number of steps made. `GivenUp` if the flag of this thread is set."""
        event, steps = event or self.event, 0
        on = np.flatnonzero(fleet.left > 0)
        flying = fleet.chosen(on)
        flying.hits[:] = 0.0
        flying.top[:] = self._energy(flying.state)
        flying.how[:] = np.where(flying.top >= level, AT_LEVEL, OVER)
        ended = flying.top >= level
        while True:
            if ended.any():
                fleet.put(on[ended], flying.chosen(ended))
                on, flying = on[~ended], flying.chosen(~ended)
            if not len(on):
                return steps
            counts = flying.left <= self.counted
            if counts.all() or not counts.any():
                steps += self._fly(flying, level, event, bool(counts[0]))
            else:
                for which in (False, True):
                    paths = np.flatnonzero(counts == which)
                    part = flying.chosen(paths)
                    steps += self._fly(part, level, event, which)
                    flying.put(paths, part)
            ended = (flying.how != OVER) | (flying.left == 0)

    def _fly(self, part: Fleet, level: float, event: Event, counts: bool) -> int:
        """Simulate paths on, in place, for TOGETHER steps at most, all of which are counted or
        before those that are; returns the number of steps made."""
        plan = self.plan if counts else self.plan_before
        most = part.left - (0 if counts else self.counted)
        beyond = np.zeros(len(part.left), bool)
        if event.kind == "passage" and counts:
            y, (lower, upper) = self.plan.gaps_of(part.state)[0], self.plan.places[0]
            beyond = (y < lower) | (y > upper)
        end = plan.fly_until(
            part.state, part.streams, np.minimum(most, TOGETHER), level,
            impacts=counts and event.kind in ("passage", "impact"),
            forces=event.limit if counts and event.kind == "force" else None,
        )  # fmt: skip
        happened = beyond | end.happened
        part.state[:], part.streams[:] = end.state, end.streams
        part.left[:] -= end.steps
        part.hits[:] += end.seen if counts else 0.0
        part.top[:] = np.where(happened, math.inf, np.maximum(part.top, end.top))
        reached = self._energy(end.state) >= level
        part.how[:] = np.where(happened, HAPPENED, np.where(reached, AT_LEVEL, OVER))
        return int(end.steps.sum())

    def _energy(self, state: Matrix) -> Vector:
        """E2 of states."""
        n, squares = self.base.modes.size, self.base.modes.squares
        found: Vector = np.sum(state[n : 2 * n] ** 2, axis=0) + squares @ state[:n] ** 2
        return found


NO_EVENT = Event(kind="nothing")
"""The event that never happens: impacts are counted until the time is over."""


def passage_plan(
    model: Model, lower: float | None, upper: float | None, mission: float, start: Start
) -> MissionPlan:
    """First passage of barriers (m), which replace the stops of the model and end a mission."""
    ends = ((LOWER, lower), (UPPER, upper))
    law = Restitution(coefficient=1.0)
    stops = tuple(Stop(side, at, law) for side, at in ends if at is not None)
    pair = Pair("barrier", np.ones(1), model.unit_mass, False, stops)
    base = plan_several(replace(model, pairs=(pair,)), 0.0, None)
    free = plan_several(replace(model, pairs=()), None, None)
    base = replace(base, law=free.law, burn_in=free.burn_in, step=min(base.step, free.step))
    return _plan(base, Event(kind="passage"), start, mission)


def impact_plan(
    model: Model, mission: float, start: Start, speed: float | None = None
) -> MissionPlan:
    """The plan for impacts at `speed` (m/s) or faster, by default the speed threshold of the
    rates."""
    base = _base(model, speed)
    (limit,) = base.layout.thresholds.values()
    return _plan(base, Event(kind="impact"), start, mission, speed=limit)


def acceleration_plan(
    model: Model, mission: float, start: Start, acceleration: float
) -> MissionPlan:
    """The plan for an absolute acceleration (m/s^2) above a limit in a contact, by stop and spring.

    The acceleration is largest where the mass is at rest, so that the damper adds nothing.
    """
    base = _base(model)
    limits = {LOWER: math.inf, UPPER: math.inf}
    speeds = []
    for stop in model.stops_per_unit_mass:
        law = stop.law
        assert isinstance(law, CompliantLaw)
        force = _force_at(law, stop.side * (stop.position - model.rest), model, acceleration)
        limits[stop.side] = force
        speeds.append(math.sqrt(2.0 * float(law.potential_at(law.deflection_at(force)))))
    event = Event(kind="force", limit=(limits[LOWER], limits[UPPER]))
    return _plan(base, event, start, mission, speed=max(speeds))


def _force_at(law: CompliantLaw, distance: float, model: Model, acceleration: float) -> float:
    """Force of a stop, per unit mass, at which stop and spring bring an acceleration; `distance` is
    that of the stop from the rest position, m."""
    stiff = model.omega**2

    def excess(force: float) -> float:
        return force + stiff * (distance + float(law.deflection_at(force))) - acceleration

    most = acceleration + stiff * abs(distance)
    return float(scipy.optimize.brentq(excess, 0.0, most)) if excess(0.0) < 0.0 else 0.0


def _base(model: Model, speed: float | None = None) -> ModalPlan:
    """The plan of the motion between the stops; `speed` is that of the slowest impact that counts,
    m/s."""
    if not model.stops:
        raise NotApplicable("reliability", "impacts need a stop, got a scene without impact_pair")
    return plan_several(model, speed, None)


def settling_time(model: Model) -> float:
    """Seconds of stationary motion with stops that are simulated before a mission."""
    return _base(model).burn_in


def _plan(
    base: ModalPlan, event: Event, start: Start, mission: float, speed: float = 0.0
) -> MissionPlan:
    """Steps that divide the mission evenly, short enough for impacts at a speed (m/s)."""
    model = base.model
    step = min(base.step, MISSION_ANGLE / model.omega)
    if speed > 0.0:
        step = min(step, _longest_for_speed(base, speed))
    if mission > MOST_STEPS * step:
        raise NotApplicable(
            "reliability",
            f"a mission takes {mission / step:.2g} steps of {step:.2g} s, at most "
            f"{MOST_STEPS:.0g} are made: ask for a shorter mission",
        )
    counted = max(LEAST_STEPS, math.ceil(mission / step))
    climb = settling = 0.0
    if start == "stationary":
        relaxation = base.burn_in / RELAXATIONS
        climb = min(CLIMB_RELAXATIONS * relaxation, max(mission, SHORT_CLIMB * relaxation))
        # without stops the start is drawn from the stationary distribution
        settling = 0.0 if event.kind == "passage" else base.burn_in - climb
    before = math.ceil(climb * counted / mission)
    return MissionPlan(
        base=base, event=event, start=start, mission=mission, counted=counted, before=before,
        settled=math.ceil(settling * counted / mission),
    )  # fmt: skip


def _longest_for_speed(base: ModalPlan, speed: float) -> float:
    """Longest step, s, for impacts at a speed (m/s)."""
    model = base.model
    longest, flight = math.inf, math.pi / model.omega
    if len(model.stops) == 2:
        flight = (model.upper_position - model.lower_position) / speed
        longest = GAP_PER_STEP * flight
    if base.elastic:
        return longest
    share = math.sqrt(RARE_BIAS / BIAS_OF_SHARE) * base.pairs[0].speed / speed
    return min(longest, share * flight)


# ------------------------------------------------------------------------------
# Rare events by splitting: paths that come close are copied, and count for less.
#
# A mission that fails passes through states of higher and higher energy. With levels of energy E_1
# < ... < E_m and the event F,
#
#     P(F) = P(E_1 reached) P(E_2 reached | E_1 reached) ... P(F | E_m reached),
#
# and each factor, some 0.2, is a share of N paths that start where earlier ones reached the level
# before: splitting with fixed effort (P. Glasserman, P. Heidelberger, P. Shahabuddin and T. Zajic,
# Oper. Res. 47 (1999) 585; M. Garvels, thesis, Twente 2000). Each survivor is copied as often as
# any other, once more or less by lot, so that the product is unbiased for levels fixed beforehand;
# paths with common ancestors are not independent, so that the error comes from independent
# repetitions of the whole. The energy is the right measure of closeness for light damping: a
# vibration forgets its phase in a period, its energy in many.
#
# Levels are the quantiles of the largest energies of a pilot (adaptive multilevel splitting: F.
# Cerou and A. Guyader, Stoch. Anal. Appl. 25 (2007) 417), whose own biased result is not used.
# ------------------------------------------------------------------------------


SHARE = 0.2
"""Share p of the paths that should reach the next level. The work at a given error is proportional
to (1 - p) / (p log(p)^2), which is flat about its minimum near there."""

PARTICLES = 1024
"""Number of paths in each stage of a repetition."""

MOST_LEVELS = 64
"""Largest number of levels: probabilities below 0.2^64 = 2e-45 are not sought."""

BLOCK_STEPS = 2.0**23
"""Number of steps of all crude missions in one task, which take about 0.1 s."""


class Trial(NamedTuple):
    """One repetition of a splitting, or one block of crude missions.

    `chance` estimates P of the event, and `hits` the expected number of impacts, without bias.
    """

    missions: int
    chance: float
    hits: float
    hits_square: float
    steps: int
    seconds: float


@dataclass(frozen=True, kw_only=True)
class Interval:
    """A confidence interval at `confidence`, and the name of the rule that gave it."""

    lower: float
    upper: float
    confidence: float
    rule: str


def crude(
    plan: MissionPlan,
    seed: int,
    hits: bool,
    first_path: int,
    missions: int,
    deadline: Deadline = NEVER,
) -> Trial:
    """Estimate by independent missions of equal weight (crude Monte Carlo).

    After a deadline all of them are given up (`GivenUp`), never a part of them, since those that
    have failed by then would be over-represented.
    """
    started = thread_seconds()
    with given_up_after(deadline):
        fleet = plan.fleet(seed, first_path, missions)
        steps = plan.settled * missions + plan.advance(fleet, math.inf)
        happened = fleet.happened
        numbers = np.zeros(1)
        if hits:
            numbers, more = _hits_of(plan, fleet)
            steps += more
    return Trial(
        missions=missions,
        chance=float(happened.mean()),
        hits=float(numbers.sum() / missions),
        hits_square=float(np.sum(numbers**2) / missions),
        steps=steps,
        seconds=thread_seconds() - started,
    )


def crude_block(plan: MissionPlan) -> int:
    """Number of missions in one task."""
    return int(min(max(BLOCK_STEPS // plan.steps_per_path, LANES), 2**16))


def repetition(
    plan: MissionPlan,
    levels: tuple[float, ...],
    seed: int,
    hits: bool,
    first_path: int,
    particles: int,
    deadline: Deadline = NEVER,
) -> Trial:
    """One splitting with fixed levels and `particles` paths in each stage.

    Raises `GivenUp` if the deadline passes before it ends.
    """
    with given_up_after(deadline):
        return _repetition(plan, levels, seed, hits, first_path, particles, deadline)


def _repetition(
    plan: MissionPlan, levels: tuple[float, ...], seed: int, hits: bool, first_path: int,
    particles: int, deadline: Deadline,
) -> Trial:  # fmt: skip
    started, index = thread_seconds(), first_path // particles
    fleet = plan.fleet(seed, _first_path(index, 0, particles), particles)
    random = np.random.default_rng([seed, index])
    chance, steps = 1.0, plan.settled * particles
    for stage, level in enumerate((*levels, math.inf)):
        if deadline.passed():
            raise GivenUp
        steps += plan.advance(fleet, level)
        reached = np.flatnonzero(fleet.top >= level)
        chance *= len(reached) / particles
        if chance == 0.0 or level == math.inf:
            break
        fleet = copies(fleet, reached, random, seed, _first_path(index, stage + 1, particles))
    number = 0.0
    if hits and chance > 0.0:
        numbers, more = _hits_of(plan, fleet)
        number, steps = float(numbers.mean()), steps + more
    return Trial(
        missions=particles,
        chance=chance,
        hits=chance * number,
        hits_square=0.0,
        steps=steps,
        seconds=thread_seconds() - started,
    )


def copies(
    fleet: Fleet, reached: NDArray[np.intp], random: np.random.Generator, seed: int, first_path: int
) -> Fleet:
    """The same number of paths, copied from those that reached the level, each with a new
    stream."""
    paths, survivors = len(fleet.left), len(reached)
    extra = random.permutation(reached)[: paths % survivors]
    chosen = np.concatenate([np.repeat(reached, paths // survivors), extra])
    streams = streams_of(seed, first_path, paths)
    # a path in which the event happened stops; its steps left are kept to count its impacts
    left = np.where(fleet.happened, -np.abs(fleet.left), fleet.left)
    return fleet._replace(left=left).chosen(chosen)._replace(streams=streams)


def _hits_of(plan: MissionPlan, fleet: Fleet) -> tuple[Vector, int]:
    """Number of impacts in the whole mission of each path in which the event happened, and the
    number of steps made."""
    chosen = fleet.happened
    rest = fleet.chosen(chosen)
    rest = rest._replace(left=np.abs(rest.left), hits=np.zeros(len(rest.left)))
    steps = plan.advance(rest, math.inf, NO_EVENT)
    return fleet.hits[chosen] + rest.hits, steps


def _first_path(index: int, stage: int, particles: int) -> int:
    return (index * (MOST_LEVELS + 1) + stage) * particles


class Levels(NamedTuple):
    """Levels of twice the energy, the probability that the pilot estimated, and its steps and CPU
    seconds."""

    levels: tuple[float, ...]
    chance: float
    steps: int
    seconds: float


def pilot_levels(
    plan: MissionPlan,
    seed: int,
    first_path: int = 0,
    particles: int = PARTICLES,
    deadline: Deadline = NEVER,
) -> Levels:
    """Levels that a share of about SHARE of the paths reach from the level before.

    Every stage is simulated twice: to its end, for the largest energies, and up to the level.
    Raises `GivenUp` if the deadline passes before it ends.
    """
    with given_up_after(deadline):
        return _pilot_levels(plan, seed, first_path, particles, deadline)


def _pilot_levels(
    plan: MissionPlan, seed: int, first_path: int, particles: int, deadline: Deadline
) -> Levels:
    started = thread_seconds()
    fleet = plan.fleet(seed, first_path, particles)
    random = np.random.default_rng(seed)
    levels: list[float] = []
    chance, steps = 1.0, plan.settled * particles
    while True:
        if deadline.passed():
            raise GivenUp
        again = fleet.chosen(np.arange(particles))
        steps += plan.advance(fleet, math.inf)
        happened = float(fleet.happened.mean())
        if happened >= SHARE:
            seconds = thread_seconds() - started
            return Levels(tuple(levels), chance * happened, steps, seconds)
        level = float(np.quantile(fleet.top, 1.0 - SHARE, method="lower"))
        last = levels[-1] if levels else 0.0
        if not level > last:  # most paths are copies of one, and none reached a higher energy
            level = float(np.min(fleet.top[fleet.top > last], initial=math.inf))
        if len(levels) == MOST_LEVELS or level == math.inf:
            raise NotConverged(
                f"splitting found no way to the event: {len(levels)} levels of energy were reached "
                f"with a chance of {chance:.2g}, and no higher one; the limit is out of reach, or "
                "the stops take so much energy in an impact that it is no guide: ask for less"
            )
        steps += plan.advance(again, level)
        reached = np.flatnonzero(again.top >= level)
        levels.append(level)
        chance *= len(reached) / particles
        fleet = copies(again, reached, random, seed, _first_path(0, len(levels), particles))


@dataclass(frozen=True, kw_only=True)
class Sample:
    """The estimate from all independent trials together.

    Parameters
    ----------
    chance, error
        Mean of the trials, and its standard error.
    hits, hits_error
        Mean number of impacts in a mission over the trials, and its standard error.
    missions
        Number of missions of all trials together.
    steps, seconds
        Number of steps of all trials together, and the CPU time they took, s.
    """

    trials: int
    missions: int
    chance: float
    error: float
    hits: float
    hits_error: float
    steps: int
    seconds: float

    @property
    def relative_error(self) -> float:
        """Standard error over value; infinite where nothing was seen."""
        return self.error / self.chance if self.chance > 0.0 else math.inf

    def interval(self, confidence: float) -> Interval:
        """Student's interval of the logarithm of the mean over repetitions."""
        lower, upper = logarithmic_interval(self.chance, self.error, self.trials - 1, confidence)
        rule = f"Student's, of the logarithm of the mean of {self.trials} repetitions"
        return Interval(lower=lower, upper=min(upper, 1.0), confidence=confidence, rule=rule)


def of_repetitions(trials: list[Trial]) -> Sample:
    """The mean over repetitions of a splitting, with errors from their scatter."""
    count = len(trials)
    chances, hits = np.array([[trial.chance, trial.hits] for trial in trials]).T
    (chance, error), (number, number_error) = mean_and_error(chances), mean_and_error(hits)
    return Sample(
        trials=count,
        missions=sum(trial.missions for trial in trials),
        chance=chance,
        error=error,
        hits=number,
        hits_error=number_error,
        steps=sum(trial.steps for trial in trials),
        seconds=sum(trial.seconds for trial in trials),
    )


@dataclass(frozen=True, kw_only=True)
class Counted(Sample):
    """The estimate from crude missions: the number of failures follows the binomial law."""

    @property
    def failed(self) -> int:
        """Number of missions in which the event happened."""
        return round(self.chance * self.missions)

    def interval(self, confidence: float) -> Interval:
        """Clopper and Pearson's interval, whose coverage is at least `confidence`."""
        return self._binomial("clopper-pearson", "Clopper and Pearson", confidence)

    def wilson(self, confidence: float) -> Interval:
        """Wilson's interval, whose coverage is about `confidence`."""
        return self._binomial("wilson", "Wilson", confidence)

    def _binomial(
        self, rule: Literal["clopper-pearson", "wilson"], name: str, confidence: float
    ) -> Interval:
        lower, upper = binomial_interval(self.failed, self.missions, confidence, rule)
        words = f"{name}, {self.failed} of {self.missions} missions"
        return Interval(lower=lower, upper=upper, confidence=confidence, rule=words)


def of_missions(trials: list[Trial]) -> Counted:
    """The estimate from blocks of crude missions, with errors from the binomial law."""
    missions = sum(trial.missions for trial in trials)
    chance = sum(trial.chance * trial.missions for trial in trials) / missions
    hits = sum(trial.hits * trial.missions for trial in trials) / missions
    square = sum(trial.hits_square * trial.missions for trial in trials) / missions
    return Counted(
        trials=missions,
        missions=missions,
        chance=chance,
        error=math.sqrt(chance * (1.0 - chance) / missions),
        hits=hits,
        hits_error=math.sqrt(max(square - hits**2, 0.0) / missions),
        steps=sum(trial.steps for trial in trials),
        seconds=sum(trial.seconds for trial in trials),
    )
