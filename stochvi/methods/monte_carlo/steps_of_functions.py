"""Springs that are functions, where a mass meets its stops: the step and the linear part that suit.

A step of length h kicks by the force g (per unit mass) that the linear part leaves out: half at its
start, half at its end. An impact at the time t of the step comes after the impulse g h / 2, where
g t is right. Its speed is wrong by g (h / 2 - t). The impact turns this error, and at the end of
the step the velocity is wrong by (1 + R) g (t - h / 2). All t are alike: the mean is 0, and the
mean square (1 + R)^2 g^2 h^2 / 12. Half of it is energy that no force has brought. Between impacts
the errors of the kicks cancel. Those of a damper cancel at a stop, where its force turns with the
velocity.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from stochvi.mathematics.arrays import Vector
from stochvi.methods.monte_carlo.rigid_white import LOSSY_ANGLE
from stochvi.model.linear_part import (
    Motion,
    fastest_rate,
    is_positive,
    motions_of,
    with_affine,
    with_linear_part,
)
from stochvi.model.modal import LinearLaw
from stochvi.model.model import FunctionOfMotion, Model, Pair, Stop
from stochvi.model.scales import PairScale, scales_of
from stochvi.scenes.characteristics.base import NODES, WEIGHTS, WIDEST, LinearForm, SpringForce

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


def with_linear_part_at_stops(model: Model) -> Model:
    """The model with linear parts of its functions that allow steps of the usual length at stops.

    They are those of statistical linearisation, unless these shorten the step. A spring along a gap
    then has the linear part that meets its force at the stops, if that allows longer steps.
    """
    statistical = with_linear_part(model)
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
