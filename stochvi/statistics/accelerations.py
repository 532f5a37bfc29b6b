"""Absolute accelerations of simulated records, from the forces that act.

    M a = loads - C v - K x - contacts

Impacts on rigid stops are impulses: sudden changes of velocity, which are kept apart.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stochvi.mathematics.arrays import Vector
from stochvi.methods.monte_carlo.history_plans import HistoryPlan
from stochvi.methods.monte_carlo.impact_logs import ImpactLog, logged_impacts, with_losses
from stochvi.model.model import Model, Pair
from stochvi.scenes.excitations import BASE
from stochvi.scenes.scene import Scene

Records = NDArray[np.float64]


class Accelerations(NamedTuple):
    """Records of one coordinate or point of a block of paths.

    Parameters
    ----------
    smooth
        (paths, samples): acceleration by springs, dampers and compliant stops, m/s^2.
    jumps
        (paths, samples): sudden changes of velocity by rigid stops, m/s, each at the sample next to
        it; None without rigid stops.
    impacts
        Impacts by pair with the energies that they take, slow ones on compliant stops too; their
        times are those of the samples, which begin at 0.
    forces
        Forces (paths, samples) of each pair with a compliant stop, N, positive on the upper one.
    """

    smooth: Records
    jumps: Records | None
    impacts: Mapping[str, ImpactLog]
    forces: Mapping[str, Records]


def places_shaken(scene: Scene) -> tuple[bool, bool]:
    """Whether something that varies in time acts on the base, and whether on a mass."""
    whole = scene.expanded
    places = [whole.place(each) for each in whole.excitations if each.shakes]
    return BASE in places, any(place != BASE for place in places)


def why_no_acceleration(model: Model, on_base: bool) -> str:
    """Why records hold no acceleration, where they do not."""
    if model.modulations:
        return "the force of a modulation is not kept by the simulation"
    if model.drives:
        return "the force of pulses, or of random numbers, is not kept by the simulation"
    if model.remembers:
        return "the force of a spring with hysteresis is not kept by the simulation"
    if model.whites:
        return "white noise on a mass has no finite acceleration"
    if on_base:
        return "forces on masses and the motion of the base cannot be told apart"
    return "the force of filtered noise on a mass is not kept by the simulation"


def pair_forces(model: Model, x: Records, v: Records) -> dict[str, Records]:
    """Forces of the pairs that have a compliant stop, N, from displacements and velocities
    (coordinates, ...)."""
    return {
        pair.name: pair.force(
            np.tensordot(pair.direction, x, axes=1), np.tensordot(pair.direction, v, axes=1)
        )
        for pair in model.pairs
        if not all(stop.rigid for stop in pair.stops)
    }


def carried_forces(
    model: Model, x: Records, v: Records, pushed: Mapping[str, Records], row: Vector | None = None
) -> Records:
    """Forces (coordinates, ...) of springs, dampers, loads and compliant stops, N; or the sum of
    them with the weights `row` (n,)."""
    weights = np.eye(len(model.mass)) if row is None else row
    constant = np.asarray(weights @ model.constant_force)
    total = constant[(..., *([None] * (x.ndim - 1)))] - np.tensordot(
        weights @ model.stiffness, x, axes=1
    )
    total -= np.tensordot(weights @ model.damping, v, axes=1)
    for pair in model.pairs:
        if pair.name in pushed:
            total -= np.multiply.outer(weights @ pair.direction, pushed[pair.name])
    for part in model.functions:
        gap, rate = (np.tensordot(part.direction, each, axes=1) for each in (x, v))
        total -= np.multiply.outer(weights @ part.direction, part.force_left_out(gap, rate))
    return np.asarray(total)


def accelerations(
    plan: HistoryPlan, row: Vector, seed: int, first_path: int, paths: int, driven: bool
) -> Accelerations:
    """Records of the displacement row . q of the paths first_path, first_path + 1, ...

    `driven` says whether tables shake masses, so that their force is a part of the acceleration.
    """
    model, samples = plan.model, plan.samples
    found, logged = logged_impacts(
        lambda log: plan.plan.histories(seed, first_path, paths, samples, log),
        [pair.name for pair in model.pairs],
        energies=True,
    )
    start = (plan.plan.settling + 1) * plan.step  # where the first sample stands in the logs
    impacts = {}
    for pair, lost in zip(model.pairs, found.lost, strict=True):
        log = with_losses(pair, logged[pair.name], lost)
        impacts[pair.name] = replace(log, time=log.time - start)
    weights: Vector = np.linalg.solve(model.mass, row).astype(
        float
    )  # row . M^-1, as M is symmetric
    forces = pair_forces(model, found.displacement, found.velocity)
    smooth = carried_forces(model, found.displacement, found.velocity, forces, weights)
    if driven:
        for path in range(paths):
            drive = plan.plan.drive(seed, first_path + path, samples, 0)
            assert drive is not None
            smooth[path] += weights @ drive
    jumps = None
    if any(stop.rigid for stop in model.stops):
        jumps = velocity_jumps(model, weights, impacts, found.impact_speed, plan.step)
    return Accelerations(smooth, jumps, impacts, forces)


def velocity_jumps(
    model: Model, weights: Vector, impacts: Mapping[str, ImpactLog], sums: Records, step: float
) -> Records:
    """Sudden changes of velocity (paths, samples) by rigid stops, m/s, each at the nearest sample.

    Parameters
    ----------
    weights
        Acceleration of the place per unit of force on each coordinate (n,), 1/kg.
    impacts
        Impacts by pair, whose times are those of the samples.
    sums
        (pairs, paths, samples): sum of the speeds of impacts in the step that ends at a sample.
    """
    jumps = np.zeros(sums.shape[1:])
    for pair, own in zip(model.pairs, sums, strict=True):
        change = -float(weights @ pair.direction) * pair.mass
        for lane, place, speed in _rigid_impacts(pair, impacts[pair.name], own, step):
            np.add.at(jumps, (lane, place), change * speed)
    return jumps


def _rigid_impacts(
    pair: Pair, log: ImpactLog, sums: Records, step: float
) -> Iterator[tuple[NDArray[np.int64], NDArray[np.int64], Vector]]:
    """Path, nearest sample, and change (1 + R) w of the speed of the gap by impacts on rigid stops.

    `sums` (paths, samples) are the speeds of all impacts within the step that ends at a sample.
    Slow ones that the log leaves out happen at the end of their step.
    """
    samples = sums.shape[1]
    place = np.rint(log.time / step).astype(int)
    inside = (place >= 0) & (place < samples)
    path, place, speed = log.path[inside], place[inside], log.speed[inside]
    left = sums.copy()
    for near in (-1, 0, 1):
        left[path, np.clip(place + near, 0, samples - 1)] = 0.0
    slow_path, slow_place = np.nonzero(left)
    path, place = np.concatenate([path, slow_path]), np.concatenate([place, slow_place])
    speed = np.concatenate([speed, left[slow_path, slow_place]])
    for stop in pair.stops:
        met = np.sign(speed) == stop.side
        if stop.rigid and np.any(met):
            kept = 1.0 + stop.restitution_at(np.abs(speed[met]))
            yield path[met], place[met], kept * speed[met]
