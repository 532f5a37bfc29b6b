"""The quantities that are made from products of channels: densities, transmissibilities,
coherence."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from stochvi.mathematics.arrays import Matrix, Vector
from stochvi.methods.monte_carlo.history_plans import HistoryPlan
from stochvi.methods.monte_carlo.plan import Histories
from stochvi.methods.monte_carlo.quantities import gap_of
from stochvi.model.model import FunctionOfMotion, Model, Pair
from stochvi.scenes.excitations import BASE
from stochvi.scenes.scene import Scene
from stochvi.statistics.spectra.segments import Quantity

Weights = NDArray[np.complex128]
"""Complex weights of channels at each frequency (channels, bins)."""


def channels_of(plan: HistoryPlan, histories: Histories) -> NDArray[np.float64]:
    """(channels, paths, samples): displacements, forces of pairs with compliant stops, of springs
    and dampers that are functions, N, and the excitation if it is known."""
    found = [*histories.displacement]
    for pair in _soft_pairs(plan.model):
        gap, rate = (
            np.tensordot(pair.direction, motion, axes=1)
            for motion in (histories.displacement, histories.velocity)
        )
        found.append(pair.force(gap, rate))
    for part in _functions(plan.model):
        y, rate = (
            np.tensordot(part.direction, motion, axes=1)
            for motion in (histories.displacement, histories.velocity)
        )
        found.append(part.force_left_out(y, rate))
    if histories.excitation is not None:
        found.append(histories.excitation)
    return np.stack(found)


def _soft_pairs(model: Model) -> list[Pair]:
    """The pairs with a compliant stop; a rigid one beside it has no force."""
    return [pair for pair in model.pairs if not pair.rigid]


def _functions(model: Model) -> tuple[FunctionOfMotion, ...]:
    """The springs and dampers that are functions, unless the force of one follows from its past."""
    return () if model.remembers else model.functions


def quantities_of(
    scene: Scene, plan: HistoryPlan, omega: Vector
) -> tuple[dict[tuple[str, str], Quantity], dict[str, str]]:
    """The quantities as functions of the rows of `products`, by owner and name; and their meanings
    in this scene."""
    model = plan.model
    n, soft = len(model.coordinates), _soft_pairs(model)
    known = plan.plan.excitation_known
    functions = _functions(model)
    channels = n + len(soft) + len(functions) + known
    found: dict[tuple[str, str], Quantity] = {}
    owners = dict(zip(model.outputs, model.output_rows, strict=True))
    owners |= {gap_of(pair): pair.direction for pair in model.pairs if pair.relative}
    for owner, direction in owners.items():
        weights: Weights = np.zeros((channels, len(omega)), complex)
        weights[:n] = direction[:, None]
        found[owner, "displacement"] = _density(weights)
        found[owner, "velocity"] = _density(weights * (1j * omega))
    # forces of springs, dampers and stops, per unit mass of each coordinate
    pulled = np.linalg.solve(
        model.mass[None], model.stiffness + 1j * omega[:, None, None] * model.damping
    )
    carried = np.zeros((n, channels, len(omega)), complex)
    carried[:, :n] = -np.moveaxis(pulled, 0, -1)
    directions = [each.direction for each in soft] + [each.direction for each in functions]
    for channel, direction in enumerate(directions, start=n):
        carried[:, channel] = -np.linalg.solve(model.mass, direction)[:, None]
    meanings = _meanings(scene, plan)
    if "acceleration" in _present(scene) and not model.remembers:
        for owner, row in zip(model.outputs, model.output_rows, strict=True):
            found[owner, "acceleration"] = _density(np.tensordot(row, carried, axes=1))
    if known:
        (owner,) = model.coordinates
        shaken = np.zeros((channels, len(omega)), complex)
        shaken[-1] = 1.0
        out, cross, into = _density(carried[0]), _cross(shaken, carried[0]), _density(shaken)
        found[owner, "excitation"] = into
        if not np.any(carried[0]):  # neither spring, damper nor a compliant stop
            for name in ("coherence", "transmissibility_h1", "transmissibility_ratio"):
                meanings[name] = "left out: nothing but impacts acts on the mass"
            return found, meanings
        found[owner, "transmissibility_h1"] = lambda m: np.abs(cross(m)) / into(m)
        # outside the band of the excitation the delta method may step to a density below zero
        found[owner, "transmissibility_ratio"] = lambda m: np.sqrt(
            np.maximum(out(m) / into(m), 0.0)
        )
        found[owner, "coherence"] = lambda m: np.abs(cross(m)) ** 2 / (into(m) * out(m))
    return found, meanings


def _present(scene: Scene) -> list[str]:
    """Whether all that shakes acts on a base, so that what springs carry is all of M x''."""
    shaking = [each for each in scene.excitations if each.shakes]
    return ["acceleration"] if all(scene.place(each) == BASE for each in shaking) else []


def _meanings(scene: Scene, plan: HistoryPlan) -> dict[str, str]:
    rigid = any(stop.rigid for stop in plan.model.stops)
    if plan.model.modulations:
        acceleration = "left out: the force of a modulation is not kept"
    elif plan.model.remembers:
        acceleration = "left out: the force of a spring with hysteresis is not kept"
    elif not _present(scene):
        acceleration = "left out: a force acts on a mass, and is part of its acceleration"
    elif rigid:
        acceleration = "absolute, between impacts: by springs and dampers, without the impulses"
    else:
        acceleration = "absolute"
    meanings = {
        "displacement": "relative to the base, less its mean",
        "velocity": "(2 pi f)^2 times that of the displacement",
        "acceleration": acceleration,
    }
    if plan.plan.excitation_known:
        of = "base acceleration to absolute acceleration" if _present(scene) else "force to support"
        meanings["transmissibility_h1"] = f"{of}, the part that is linear in the excitation"
        meanings["transmissibility_ratio"] = f"{of}, root of the ratio of densities"
        meanings["coherence"] = "between the transmitted motion or force and the excitation"
        if plan.model.tables:
            meanings["coherence"] += "; like transmissibilities, left out at the ends of a table"
    else:
        meanings["coherence"] = (
            "left out, like transmissibilities: the excitation is known for one oscillator under "
            "white or tabulated noise without sines alone"
        )
    return meanings


def _density(weights: Weights) -> Quantity:
    """Density of sum_i weights_i X_i from the rows of `products`."""
    cross = _cross(weights, weights)
    return lambda rows: np.asarray(cross(rows).real)


def _cross(first: Weights, second: Weights) -> Callable[[Matrix], Weights]:
    """Cross density of two weighted sums of channels, conj(first X) (second X)."""
    channels = len(first)
    pairs = [(i, j) for i in range(channels) for j in range(i + 1, channels)]

    def of(rows: Matrix) -> Weights:
        total = np.zeros(rows.shape[1], complex)
        for i in range(channels):
            total += np.conj(first[i]) * second[i] * rows[i]
        for k, (i, j) in enumerate(pairs):
            product = rows[channels + 2 * k] + 1j * rows[channels + 2 * k + 1]
            total += np.conj(first[i]) * second[j] * product
            total += np.conj(first[j]) * second[i] * np.conj(product)
        return total

    return of
