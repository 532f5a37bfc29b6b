"""Missions of one oscillator under white noise: how a scene is laid out for them."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from stochvi.methods.monte_carlo.compliant_white import kernel_stops, plan_compliant
from stochvi.methods.monte_carlo.kernels.missions import (
    FORCE,
    HAPPENED,
    IMPACT,
    NOTHING,
    PASSAGE,
    fly_missions,
)
from stochvi.methods.monte_carlo.kernels.random_numbers import normal_pairs, seed_streams
from stochvi.methods.monte_carlo.rigid_white import (
    MOST_STEPS,
    RELAXATIONS,
    WhitePlan,
    _flow,
    _kick,
    plan_white,
)
from stochvi.model.model import LOWER, UPPER, Model
from stochvi.results.errors import NotApplicable
from stochvi.scenes.impact_laws import CompliantLaw

Vector = NDArray[np.float64]
Start = Literal["rest", "stationary"]

MISSION_ANGLE = 0.4
"""omega h of a step: P of a passage at 3 sigma (zeta 0.05, 10 periods) is then met within 0.2 %."""


CLIMB_RELAXATIONS = 6.0
"""Time constants of the energy that a stationary motion is flown before the mission, so that
splitting finds the states from which a mission soon fails, which are rare at its start."""

SHORT_CLIMB = 1.0
"""The same for missions shorter than that: what climbed long before has come down again by the time
such a mission begins, and levels that are reached early lead nowhere."""

GAP_PER_STEP = 0.25
"""Share of the gap that a mass at the limiting speed crosses in a step. A mass that rattles shows
its speed at every impact, but noise changes it once a step: at 0.6 of the gap P is 2.5 % low."""

LEAST_STEPS = 4
"""Of a mission, so that it can be flown at twice the step."""

NEEDS_FORCE = (
    "it needs stops that give way (law elastic, viscoelastic, hertz or table): a restitution alone "
    "does not give a force"
)
"""Why no acceleration is known in an impact."""

WALL = np.array([[1.0]])
"""Data of a barrier for the kernel."""


@dataclass(frozen=True, kw_only=True)
class Event:
    """What a mission is to be without.

    `kind` is one of the kernel's events; `limit` a speed (m/s), or forces per unit mass (m/s^2) of
    the lower and the upper stop.
    """

    kind: int
    limit: tuple[float, float] = (0.0, 0.0)


class Fleet(NamedTuple):
    """Paths on their way: state, steps left, largest energy, how it ended, impacts, streams."""

    x: Vector
    v: Vector
    left: Vector
    top: Vector
    how: NDArray[np.int64]
    hits: Vector
    streams: NDArray[np.uint64]

    @property
    def happened(self) -> NDArray[np.bool_]:
        """Which of them have seen the event."""
        return np.equal(self.how, HAPPENED)

    def chosen(self, paths: NDArray[Any]) -> Fleet:
        """A copy of some of them, once or more, by number or by mask."""
        return Fleet(
            x=self.x[paths],
            v=self.v[paths],
            left=self.left[paths],
            top=self.top[paths],
            how=self.how[paths],
            hits=self.hits[paths],
            streams=self.streams[:, paths],
        )


@dataclass(frozen=True, kw_only=True)
class MissionPlan:
    """Steps and start of missions of one scene (SI units, per unit mass).

    Parameters
    ----------
    base
        The plan of the engine that the scene calls for, without stops where barriers stand.
    lower, upper
        Stops or barriers for the kernel, from the rest position.
    counted, before
        Steps of a mission, and of the motion before it in which levels are climbed.
    settled
        Steps before those, in which a motion between lossy stops becomes stationary.
    """

    base: WhitePlan
    event: Event
    start: Start
    mission: float
    counted: int
    before: int
    settled: int
    lower: Any
    upper: Any

    @property
    def step(self) -> float:
        """Of the time, s."""
        return self.mission / self.counted

    @property
    def steps_per_path(self) -> int:
        """All of a path that nothing happens to."""
        return self.counted + self.before + self.settled

    def coarser(self) -> MissionPlan:
        """At twice the step, to measure what the step leaves as bias."""
        return replace(
            self,
            counted=max(1, round(self.counted / 2)),
            before=math.ceil(self.before / 2),
            settled=math.ceil(self.settled / 2),
        )

    def fleet(self, seed: int, first_path: int, paths: int) -> Fleet:
        """Paths at their start; their streams belong to (seed, path)."""
        streams = np.empty((2, paths), np.uint64)
        seed_streams(np.uint64(seed), first_path, streams)
        left = np.full(paths, float(self.counted + self.before))
        if self.start == "stationary":
            x, v = self.base._start(streams)
        else:
            # a step is half a kick, a flow and half a kick: the first half is for itself
            first, second = np.empty((2, paths))
            normal_pairs(streams[0], streams[1], first, second)
            _, spread = _kick(self.base.model, 0.5 * self.step)
            _, cosine, sine, _ = _flow(self.base.model, self.step)
            x, v = sine * spread * first, cosine * spread * first
            left -= 1.0
        fleet = _at(x, v, left, streams)
        if self.settled:
            fleet = fleet._replace(left=np.full(paths, float(self.settled)))
            self.fly(fleet, math.inf, AFTERWARDS)
            fleet = _at(fleet.x, fleet.v, left, streams)
        return fleet

    def fly(self, fleet: Fleet, level: float, event: Event | None = None) -> int:
        """Fly the paths that have steps left, in place, until event, level or the end; steps."""
        event = event or self.event
        return int(
            fly_missions(
                fleet, _kick(self.base.model, self.step), _flow(self.base.model, self.step),
                self.lower, self.upper, event.kind, event.limit, self.base.threshold,
                float(self.counted), level,
            )
        )  # fmt: skip


def _at(x: Vector, v: Vector, left: Vector, streams: NDArray[np.uint64]) -> Fleet:
    """Paths that nothing has happened to."""
    paths = len(x)
    return Fleet(
        x=x,
        v=v,
        left=left,
        top=np.zeros(paths),
        how=np.zeros(paths, np.int64),
        hits=np.zeros(paths),
        streams=streams,
    )


AFTERWARDS = Event(kind=NOTHING)
"""Nothing ends the flight: impacts are counted until the time is up."""


def passage_plan(
    model: Model, lower: float | None, upper: float | None, mission: float, start: Start
) -> MissionPlan:
    """First passage of barriers (m): they end a mission, whatever stands there."""
    base = plan_white(replace(model, pairs=()), None, None)
    ends = tuple(None if at is None else (at - model.rest, 0, WALL) for at in (lower, upper))
    return _plan(base, Event(kind=PASSAGE), start, mission, ends)


def impact_plan(
    model: Model, mission: float, start: Start, speed: float | None = None
) -> MissionPlan:
    """An impact at `speed` (m/s) or faster, by default at the least that rates count."""
    base = _base(model)
    limit = base.threshold if speed is None else speed
    event = Event(kind=IMPACT, limit=(limit, limit))
    return _plan(base, event, start, mission, kernel_stops(model), limit)


def acceleration_plan(
    model: Model, mission: float, start: Start, acceleration: float
) -> MissionPlan:
    """An absolute acceleration (m/s^2) above a limit in a contact, by stop and spring together.

    Where it is largest the mass is at rest, so that the damper takes no part.
    """
    base = _base(model)
    limits = {LOWER: math.inf, UPPER: math.inf}
    speeds = []
    for stop in model.stops_per_unit_mass:
        law = stop.law
        if not isinstance(law, CompliantLaw):
            raise NotApplicable("peak_acceleration", [NEEDS_FORCE])
        force = _force_at(law, stop.side * (stop.position - model.rest), model, acceleration)
        limits[stop.side] = force
        speeds.append(math.sqrt(2.0 * float(law.potential_at(law.deflection_at(force)))))
    speed = max(speeds)
    event = Event(kind=FORCE, limit=(limits[LOWER], limits[UPPER]))
    return _plan(base, event, start, mission, kernel_stops(model), speed)


def _force_at(law: CompliantLaw, distance: float, model: Model, acceleration: float) -> float:
    """Force of a stop, per unit mass, at which stop and spring bring an acceleration; `distance` is
    that of the stop from the rest position, m."""
    stiff = model.omega**2

    def excess(force: float) -> float:
        return force + stiff * (distance + float(law.deflection_at(force))) - acceleration

    most = acceleration + stiff * abs(distance)
    return float(brentq(excess, 0.0, most)) if excess(0.0) < 0.0 else 0.0


def _base(model: Model) -> WhitePlan:
    if not model.stops:
        raise NotApplicable("reliability", ["impacts need a stop, got a scene without impact_pair"])
    if model.not_rigid():
        return plan_compliant(model, None, None)
    return plan_white(model, None, None)


def settling_time(model: Model) -> float:
    """Seconds that a stationary motion with stops is flown before a mission."""
    return _settling(_base(model))


def _settling(base: WhitePlan) -> float:
    """What is not the stationary law itself at its start has to settle."""
    return CLIMB_RELAXATIONS / RELAXATIONS * base.burn_in if base.elastic else base.burn_in


def _plan(
    base: WhitePlan,
    event: Event,
    start: Start,
    mission: float,
    stops: tuple[Any, ...],
    speed: float = 0.0,
) -> MissionPlan:
    """Steps that divide the mission evenly, short enough for impacts at a speed (m/s)."""
    model = base.model
    step = min(base.step, MISSION_ANGLE / model.omega) if model.omega else base.step
    if speed > 0.0 and len(model.stops) == 2:
        step = min(step, GAP_PER_STEP * (model.upper_position - model.lower_position) / speed)
    if mission > MOST_STEPS * step:
        raise NotApplicable(
            "reliability",
            [f"a mission takes {mission / step:.2g} steps of {step:.2g} s, at most "
             f"{MOST_STEPS:.0g} are made: ask for a shorter mission"],
        )  # fmt: skip
    counted = max(LEAST_STEPS, math.ceil(mission / step))
    settling = climb = _settling(base) if start == "stationary" else 0.0
    if mission < settling:
        climb = min(settling, max(mission, SHORT_CLIMB / RELAXATIONS * base.burn_in))
    before = math.ceil(climb * counted / mission)
    # without losses at stops the start is drawn from the stationary law itself
    settled = 0 if base.elastic else math.ceil((settling - climb) * counted / mission)
    return MissionPlan(
        base=base,
        event=event,
        start=start,
        mission=mission,
        counted=counted,
        before=before,
        settled=settled,
        lower=stops[0],
        upper=stops[1],
    )
