"""Missions of one oscillator under white noise: the plan of their steps, start and end."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from stochvi.engine.laws.restitution import Restitution
from stochvi.mathematics.arrays import Vector
from stochvi.methods.monte_carlo.compliant_white import plan_compliant
from stochvi.methods.monte_carlo.kernels.missions import (
    FORCE,
    HAPPENED,
    IMPACT,
    NOTHING,
    PASSAGE,
    run_missions,
)
from stochvi.methods.monte_carlo.kernels.random_numbers import normal_pairs, seed_streams
from stochvi.methods.monte_carlo.mass_stops import StopsOfMass, stops_of_mass
from stochvi.methods.monte_carlo.plan import RELAXATIONS
from stochvi.methods.monte_carlo.rigid_white import (
    MOST_STEPS,
    WhitePlan,
    _flow,
    kick_over,
    plan_white,
)
from stochvi.model.model import LOWER, UPPER, Model
from stochvi.results.errors import NotApplicable
from stochvi.sampling.stop_flag import check_flag, stop_flag
from stochvi.scenes.impact_laws import CompliantLaw

Start = Literal["rest", "stationary"]
"""How a mission begins: at rest, or in the stationary motion."""

MISSION_ANGLE = 0.4
"""Largest omega h of a step (rad). The probability P of a passage of 3 standard deviations within
10 periods at a damping ratio of 0.05 then has a relative error below 0.2 %."""

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

LEAST_STEPS = 4
"""Smallest number of steps of a mission, so that it can be simulated at twice the step as well."""

NEEDS_FORCE = (
    "law must be elastic, viscoelastic, hertz or table: a restitution alone does not give a force"
)
"""The reason why a scene with rigid stops has no peak acceleration."""


@dataclass(frozen=True, kw_only=True)
class Event:
    """The event that ends a mission, a failure for example.

    `kind` is one of the kernel's events; `limit` a speed (m/s), or forces per unit mass (m/s^2) of
    the lower and the upper stop.
    """

    kind: int
    limit: tuple[float, float] = (0.0, 0.0)


class Fleet(NamedTuple):
    """Paths of missions: state, steps left, largest energy, how each ended, impacts, streams."""

    x: Vector
    v: Vector
    left: Vector
    top: Vector
    how: NDArray[np.int64]
    hits: Vector
    streams: NDArray[np.uint64]

    @property
    def happened(self) -> NDArray[np.bool_]:
        """Mask of the paths in which the event happened."""
        return np.equal(self.how, HAPPENED)

    def chosen(self, paths: NDArray[Any]) -> Fleet:
        """A copy of the paths with these numbers or under this mask; numbers may repeat."""
        return Fleet(
            x=self.x[paths],
            v=self.v[paths],
            left=self.left[paths],
            top=self.top[paths],
            how=self.how[paths],
            hits=self.hits[paths],
            streams=np.ascontiguousarray(self.streams[:, paths]),
        )


@dataclass(frozen=True, kw_only=True)
class MissionPlan:
    """Steps and start of missions of one scene (SI units, per unit mass).

    Parameters
    ----------
    base
        The plan for the scene, without stops where there are barriers.
    stops
        Stops or barriers for the kernel.
    counted, before
        Steps of a mission, and of the motion before it in which energies above a level count.
    settled
        Steps before these, in which a motion between inelastic stops becomes stationary.
    """

    base: WhitePlan
    event: Event
    start: Start
    mission: float
    counted: int
    before: int
    settled: int
    stops: StopsOfMass

    @property
    def step(self) -> float:
        """Time step, s."""
        return self.mission / self.counted

    @property
    def steps_per_path(self) -> int:
        """Number of steps of a path in which the event does not happen."""
        return self.counted + self.before + self.settled

    def coarser(self) -> MissionPlan:
        """The same missions at twice the step, to measure the bias of the step."""
        return replace(
            self,
            counted=max(1, round(self.counted / 2)),
            before=math.ceil(self.before / 2),
            settled=math.ceil(self.settled / 2),
        )

    def fleet(self, seed: int, first_path: int, paths: int) -> Fleet:
        """Paths at their start, whose streams depend on seed and path number alone."""
        streams = np.empty((2, paths), np.uint64)
        seed_streams(np.uint64(seed), first_path, streams)
        left = np.full(paths, float(self.counted + self.before))
        if self.start == "stationary":
            x, v = self.base._start(streams)
        else:
            # a step is half a kick, a flow and half a kick; the kernel begins with the second half
            first, second = np.empty((2, paths))
            normal_pairs(streams[0], streams[1], first, second)
            spread = kick_over(self.base.model, 0.5 * self.step).spread
            _, cosine, sine, _ = _flow(self.base.model, self.step)
            x, v = sine * spread * first, cosine * spread * first
            left -= 1.0
        fleet = _at(x, v, left, streams)
        if self.settled:
            fleet = fleet._replace(left=np.full(paths, float(self.settled)))
            self.advance(fleet, math.inf, NO_EVENT)
            fleet = _at(fleet.x, fleet.v, left, streams)
        return fleet

    def advance(self, fleet: Fleet, level: float, event: Event | None = None) -> int:
        """Simulate the paths that have steps left, in place, until their event, the level or their
        end; returns the number of steps made. `GivenUp` if the flag of this thread is set."""
        event = event or self.event
        steps = run_missions(
            fleet, kick_over(self.base.model, self.step), _flow(self.base.model, self.step),
            self.stops.for_kernel, event.kind, event.limit, self.base.threshold,
            float(self.counted), level, stop_flag(),
        )  # fmt: skip
        check_flag()
        return int(steps)


def _at(x: Vector, v: Vector, left: Vector, streams: NDArray[np.uint64]) -> Fleet:
    """Paths at their start, in which the event has not happened."""
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


NO_EVENT = Event(kind=NOTHING)
"""The event that never happens: impacts are counted until the time is over."""


def passage_plan(
    model: Model, lower: float | None, upper: float | None, mission: float, start: Start
) -> MissionPlan:
    """First passage of barriers (m), which replace the stops of the model and end a mission."""
    base = plan_white(replace(model, pairs=()), None, None)
    barriers = {
        which: (at - model.rest, Restitution(1.0))
        for which, at in enumerate((lower, upper))
        if at is not None
    }
    stops = StopsOfMass(laws=barriers, stiffness=model.omega**2, speed=1.0, longest=base.step)
    return _plan(base, Event(kind=PASSAGE), start, mission, stops)


def impact_plan(
    model: Model, mission: float, start: Start, speed: float | None = None
) -> MissionPlan:
    """The plan for impacts at `speed` (m/s) or faster, by default the speed threshold of the
    rates."""
    base = _base(model)
    limit = base.threshold if speed is None else speed
    event = Event(kind=IMPACT, limit=(limit, limit))
    return _plan(base, event, start, mission, speed=limit)


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
        if not isinstance(law, CompliantLaw):
            raise NotApplicable("peak_acceleration", [NEEDS_FORCE])
        force = _force_at(law, stop.side * (stop.position - model.rest), model, acceleration)
        limits[stop.side] = force
        speeds.append(math.sqrt(2.0 * float(law.potential_at(law.deflection_at(force)))))
    speed = max(speeds)
    event = Event(kind=FORCE, limit=(limits[LOWER], limits[UPPER]))
    return _plan(base, event, start, mission, speed=speed)


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
    if model.summed:
        return plan_compliant(model, None, None)
    return plan_white(model, None, None)


def settling_time(model: Model) -> float:
    """Seconds of stationary motion with stops that are simulated before a mission."""
    return _settling(_base(model))


def _settling(base: WhitePlan) -> float:
    """Seconds until a path that does not start in the stationary state itself is stationary."""
    return CLIMB_RELAXATIONS / RELAXATIONS * base.burn_in if base.elastic else base.burn_in


def _plan(
    base: WhitePlan,
    event: Event,
    start: Start,
    mission: float,
    stops: StopsOfMass | None = None,
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
    # without losses at stops the start is drawn from the stationary distribution
    settled = 0 if base.elastic else math.ceil((settling - climb) * counted / mission)
    return MissionPlan(
        base=base,
        event=event,
        start=start,
        mission=mission,
        counted=counted,
        before=before,
        settled=settled,
        stops=stops or stops_of_mass(model, base.speed, base.step),
    )
