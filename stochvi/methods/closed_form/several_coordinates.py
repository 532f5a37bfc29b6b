"""Several coordinates: the Gibbs distribution exp(-H / theta), and Gaussian distributions without
stops.

The stops see y = D q alone, one entry per impact pair. Given y the rest is Gaussian, so that

    p(y) ~ exp(-(y' A y / 2 - h' y + sum_j V_j(y_j)) / theta),   q | y ~ N(base + G y, spread),

A and h what is left of stiffness and load after the other directions have settled. Pairs that A
does not couple are independent, each like one oscillator; coupled ones are integrated together.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import null_space
from scipy.sparse.csgraph import connected_components

from stochvi.mathematics.arrays import Matrix, Vector
from stochvi.mathematics.impact_rates import ContactStatistics, StopStatistics, gaussian_stop
from stochvi.mathematics.rounding import CANCELLATION
from stochvi.methods.closed_form.coupled_pairs import MOST_PAIRS, CoupledLaw, Intractable
from stochvi.methods.closed_form.one_coordinate import lossy
from stochvi.model.balances import residuals
from stochvi.model.build_response import build_response
from stochvi.model.coverage import functions, not_gaussian, without_energy, without_noise
from stochvi.model.gap import Gap
from stochvi.model.gibbs_law import GibbsLaw
from stochvi.model.modal import absolute_accelerations, linear_law
from stochvi.model.model import Model, Pair, model_of
from stochvi.results.estimates import Cost, Estimate
from stochvi.results.response import CoordinateResponse, PairResponse, Response
from stochvi.scenes.scene import Scene

MOST_NAMED = 4
"""Largest number of stops that a condition names one by one."""


class Split(NamedTuple):
    """The energy in the pairs' coordinates y, and the Gaussian distribution of q that is left given
    y.

    stiffness (p, p) and load (p,) are A and h; q | y has the mean base + gain y and the
    covariance `spread`.
    """

    stiffness: Matrix
    load: Vector
    gain: Matrix
    base: Vector
    spread: Matrix


class PairLaw(NamedTuple):
    """Impacts and contacts of one pair, per unit of its reduced mass, by the side of the stop."""

    stops: Mapping[str, StopStatistics]
    contacts: Mapping[str, ContactStatistics | None]


class Solution(NamedTuple):
    """Moments of all coordinates, and each pair; `error` is that of the quadrature, relative.

    `acceleration` holds the mean squares of the absolute accelerations of all outputs, where these
    are finite.
    """

    mean: Vector
    covariance: Matrix
    velocity: Matrix
    pairs: Sequence[PairLaw]
    error: float
    acceleration: Vector | None = None


def unmet(model: Model) -> list[str]:
    """The conditions of a closed form that a model of any structure does not meet."""
    found = functions(model) + not_gaussian(model)
    if found:
        return found
    if model.tables and model.pairs:
        found.append(
            "excitation must be white noise where there are stops, got a tabulated "
            "density; linearise and simulate take it"
        )
    if model.sines:
        found.append("excitation must be noise, got a sine")
    found.extend(without_noise(model))
    if not model.pairs:
        if not _settles(model):
            found.append(
                "stiffness and damping must hold every coordinate where there are no stops"
            )
        return found
    if any(signal.intensity for signal in model.signals):
        found.append("excitation must be white noise where there are stops, got filtered noise")
    found.extend(_losses(model))
    return found or without_energy(model) or _not_gibbs(model)


def _losses(model: Model) -> Iterator[str]:
    """Stops that lose energy, each by its name, or counted where they are many."""
    places: dict[str, list[str]] = {}
    for pair in model.pairs:
        for stop in pair.stops:
            if loss := lossy(stop.law):
                places.setdefault(loss, []).append(f"the {stop.name} stop of {pair.name}")
    for loss, at in places.items():
        if len(at) > MOST_NAMED:
            yield f"{loss} at {len(at)} stops, the first of which is {at[0]}"
        else:
            yield from (f"{loss} at {place}" for place in at)


def _not_gibbs(model: Model) -> list[str]:
    """The conditions of the Gibbs distribution that a model with elastic stops in white noise does
    not meet."""
    if model.temperature is None:
        return [
            "white noise must match damping, S = 2 theta C with one theta for all coordinates: "
            "noise of the base, or on a part of what is damped, does not; linearise and simulate "
            "take any noise"
        ]
    if not _reached(model):
        return ["damping and noise must reach every motion, directly or through springs and stops"]
    directions = np.array([pair.direction for pair in model.pairs])
    if np.linalg.matrix_rank(directions) < len(directions):
        return [
            f"impact pairs must act on independent coordinates, got {len(directions)} pairs on "
            f"{np.linalg.matrix_rank(directions)} of them"
        ]
    try:
        solve(model)
    except (Intractable, ValueError) as reason:
        return [str(reason)]
    return []


def response(scene: Scene, started: float) -> Response:
    """The answer for a scene without unmet conditions."""
    model = model_of(scene)
    found = solve(model) if model.pairs else _gaussian(model)
    free = "integral over frequency" if model.tables else "Lyapunov"
    how = "closed form" if model.pairs else f"closed form ({free})"
    return build_response(
        scene,
        "exact",
        coordinates={
            name: _coordinate(model, found, row, how) for row, name in enumerate(model.outputs)
        },
        impact_pairs={
            pair.name: PairResponse(
                **_pair(law, pair.mass, found.error, how),
                **_relative(found, pair, how),
                speed_threshold=0.0,
            )
            for pair, law in zip(model.pairs, found.pairs, strict=True)
        },
        cost=Cost(wall_time=time.perf_counter() - started),
        identities={
            name: Estimate(value=value, bias=10.0 * found.error, how=how)
            for name, value in residuals(model, _moments(model, found), found.mean.tolist()).items()
        },
    )


def _coordinate(model: Model, found: Solution, output: int, how: str) -> CoordinateResponse:
    row = model.output_rows[output]
    mean, velocity = row @ found.mean, row @ found.velocity @ row
    deviation = np.sqrt(row @ found.covariance @ row)
    values = {
        "displacement_mean": mean,
        "displacement_std": deviation,
        "displacement_mean_square": mean**2 + deviation**2,
        "velocity_std": np.sqrt(velocity),
        "velocity_mean_square": velocity,
    }
    if not model.pairs and deviation > 0.0:
        values["upcrossing_rate"] = np.sqrt(velocity) / deviation / (2.0 * np.pi)
    if found.acceleration is not None:
        values["acceleration_std"] = np.sqrt(found.acceleration[output])
    sizes = {**values, "displacement_mean": deviation}
    return CoordinateResponse(
        **{
            name: Estimate(value=float(value), bias=found.error * float(sizes[name]), how=how)
            for name, value in values.items()
        }
    )


def _relative(found: Solution, pair: Pair, how: str) -> dict[str, Estimate]:
    """Motion of a pair of two coordinates relative to each other."""
    d = pair.direction
    if not pair.relative:
        return {}
    deviation = float(np.sqrt(d @ found.covariance @ d))
    speed = float(np.sqrt(d @ found.velocity @ d))
    values = {
        "relative_displacement_mean": (float(d @ found.mean), deviation),
        "relative_displacement_std": (deviation, deviation),
        "relative_velocity_std": (speed, speed),
    }
    return {
        name: Estimate(value=value, bias=found.error * size, how=how)
        for name, (value, size) in values.items()
    }


def _pair(law: PairLaw, mass: float, error: float, how: str) -> dict[str, Estimate | None]:
    stops = [law.stops[side] for side in law.stops]
    rate, speed, square = (sum(column) for column in zip(*stops, strict=True))
    contacts = {side: contact for side, contact in law.contacts.items() if contact is not None}
    values: dict[str, float | None] = {
        "collision_rate": rate,
        "collision_rate_lower": law.stops["lower"].rate if "lower" in law.stops else None,
        "collision_rate_upper": law.stops["upper"].rate if "upper" in law.stops else None,
        "impact_speed_mean": speed / rate if rate else None,
        "impact_speed_rate": speed,
        "impact_speed_square_rate": square,
        "contact_probability": sum(item.probability for item in contacts.values()) or None,
        "contact_force_lower": mass * contacts["lower"].force if "lower" in contacts else None,
        "contact_force_upper": mass * contacts["upper"].force if "upper" in contacts else None,
    }
    return {
        name: None if value is None else Estimate(value=value, bias=error * abs(value), how=how)
        for name, value in values.items()
    }


def _moments(model: Model, found: Solution) -> dict[tuple[str, str], float]:
    """Moments from which the balances are calculated."""
    moments: dict[tuple[str, str], float] = {}
    for row, name in enumerate(model.coordinates):
        moments[name, "x"] = float(found.mean[row])
        moments[name, "variance"] = float(found.covariance[row, row])
        moments[name, "vv"] = float(found.velocity[row, row])
    for pair, law in zip(model.pairs, found.pairs, strict=True):
        for side, hits in law.stops.items():
            held = law.contacts[side]
            moments[pair.name, f"f1_{side}"] = hits.speed_rate
            moments[pair.name, f"f2_{side}"] = hits.speed_square_rate
            moments[pair.name, f"force_{side}"] = held.force if held else 0.0
            moments[pair.name, f"loss_{side}"] = 0.0
    moments["", "kinetic"] = float(np.trace(model.mass @ found.velocity))
    moments["", "potential"] = float(np.trace(model.stiffness @ found.covariance))
    moments["", "dissipation"] = float(np.trace(model.damping @ found.velocity))
    return moments


# The Gibbs distribution -------------------------------------------------------------------


def solve(model: Model) -> Solution:
    """Moments of exp(-H / theta).

    Raises
    ------
    ValueError, Intractable
        If a coordinate is held by nothing; if too many pairs depend on each other.
    """
    theta = model.temperature
    assert theta is not None
    split = _split(model, theta)
    size = np.sqrt(np.diag(split.stiffness))
    coupled = np.abs(split.stiffness) > CANCELLATION * np.outer(size, size)
    _, labels = connected_components(coupled, directed=False)
    count = len(model.pairs)
    mean, covariance = np.zeros(count), np.zeros((count, count))
    pairs: list[PairLaw | None] = [None] * count
    error = 0.0
    for label in np.unique(labels):
        block = np.flatnonzero(labels == label)
        part = _one_pair if len(block) == 1 else _coupled_pairs
        found = part(model, split, theta, block)
        mean[block] = found.mean
        covariance[np.ix_(block, block)] = found.covariance
        error = max(error, found.error)
        for place, pair in zip(block, found.pairs, strict=True):
            pairs[place] = pair
    return Solution(
        mean=split.base + split.gain @ mean,
        covariance=split.spread + split.gain @ covariance @ split.gain.T,
        velocity=np.asarray(theta * np.linalg.inv(model.mass), dtype=float),
        pairs=[pair for pair in pairs if pair is not None],
        error=error,
    )


def _split(model: Model, theta: float) -> Split:
    """q = along y + across z with D along = 1, D across = 0; z is Gaussian given y."""
    directions = np.array([pair.direction for pair in model.pairs])
    along, across = np.linalg.pinv(directions), null_space(directions)
    stiffness, load = model.stiffness, model.constant_force
    held = across.T @ stiffness @ across
    if held.size and not _positive(held):
        raise ValueError("stiffness must hold every coordinate that stops do not hold")
    inverse = across @ np.linalg.solve(held, across.T) if held.size else np.zeros_like(stiffness)
    gain = along - inverse @ stiffness @ along
    bare = along.T @ stiffness @ along
    left = along.T @ stiffness @ gain
    size = np.sqrt(np.diag(bare))
    left = np.where(np.abs(left) > CANCELLATION * np.outer(size, size), (left + left.T) / 2.0, 0.0)
    return Split(left, gain.T @ load, gain, inverse @ load, theta * inverse)


def _one_pair(model: Model, split: Split, theta: float, block: NDArray[np.intp]) -> Solution:
    """Law of a pair that no spring couples to others: that of an oscillator of its reduced mass."""
    row = int(block[0])
    pair = model.pairs[row]
    omega = float(np.sqrt(max(split.stiffness[row, row], 0.0) / pair.mass))
    load = float(split.load[row]) / pair.mass
    gap = Gap.of_pair(pair, omega=omega, damping_rate=0.0, load=load)
    try:
        law = GibbsLaw.of(gap, theta=theta / pair.mass)
    except ValueError:
        raise ValueError(f"springs or stops must hold the pair {pair.name!r}") from None
    found = PairLaw(
        {stop.name: gaussian_stop(law.density_at(stop.position), law.theta) for stop in gap.stops},
        {stop.name: law.contact(stop.name) for stop in gap.stops},
    )
    nothing = np.zeros((1, 1))
    return Solution(np.array([law.mean]), np.array([[law.variance]]), nothing, [found], 0.0)


def _coupled_pairs(model: Model, split: Split, theta: float, block: NDArray[np.intp]) -> Solution:
    """Laws of pairs that springs couple, by integrals over all of them."""
    pairs = tuple(model.pairs[row] for row in block)
    if len(block) > MOST_PAIRS:
        names = ", ".join(pair.name for pair in pairs)
        raise Intractable(
            f"at most {MOST_PAIRS} impact pairs may depend on each other through springs, got "
            f"{len(block)} ({names})"
        )
    law = CoupledLaw(
        theta=theta,
        stiffness=split.stiffness[np.ix_(block, block)],
        load=split.load[block],
        pairs=pairs,
    )
    found = [
        PairLaw(
            {
                stop.name: gaussian_stop(law.density_at(place, stop.position), theta / pair.mass)
                for stop in pair.stops
            },
            {stop.name: law.contact(place, stop.name) for stop in pair.stops},
        )
        for place, pair in enumerate(pairs)
    ]
    return Solution(law.mean, law.covariance, np.zeros((0, 0)), found, law.error)


# Without stops ----------------------------------------------------------------------------


def _gaussian(model: Model) -> Solution:
    """Response of a linear structure to Gaussian noise: a Gaussian distribution."""
    modes = model.modal
    law = linear_law(modes)
    assert law is not None
    n, shapes = modes.size, modes.shapes
    displacement, velocity = (
        shapes @ law.covariance[part, part] @ shapes.T for part in (slice(0, n), slice(n, 2 * n))
    )
    return Solution(
        mean=shapes @ (modes.rest + law.mean),
        covariance=displacement,
        velocity=velocity,
        pairs=[],
        error=0.0,
        acceleration=absolute_accelerations(modes, law, model.output_rows)
        if model.base_alone_moves
        else None,
    )


def _settles(model: Model) -> bool:
    """Whether a linear structure forgets how it started."""
    return linear_law(model.modal) is not None


def _positive(matrix: Matrix) -> bool:
    size = np.sqrt(np.maximum(np.diag(matrix), 0.0))
    if np.any(size == 0.0):
        return False
    return bool(np.linalg.eigvalsh(matrix / np.outer(size, size))[0] > CANCELLATION)


def _reached(model: Model) -> bool:
    """Whether damping acts in every mode, with a spring of some stiffness in place of each stop.

    The stiffnesses are of the structure's size and have no simple ratio. No symmetry of the springs
    can then hide a motion that impacts would reach.
    """
    stiffness = model.stiffness.copy()
    size = float(np.trace(stiffness)) or 1.0
    for number, pair in enumerate(model.pairs, start=2):
        stiffness += size * np.sqrt(number) * np.outer(pair.direction, pair.direction)
    root = np.linalg.inv(np.linalg.cholesky(model.mass))
    _, modes = np.linalg.eigh(root @ stiffness @ root.T)
    damped = np.einsum("ij,ij->j", modes, (root @ model.damping @ root.T) @ modes)
    return bool(np.all(damped > CANCELLATION * damped.max()))
