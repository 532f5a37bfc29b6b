"""Plain paths of a structure with compliant stops, by kicks and midpoint steps."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]


@dataclass(frozen=True)
class PlainPair:
    """A gap row . q with a lower and an upper stop (m) that push with force(y, y') where that is
    positive, y the deflection. An infinite place is no stop."""

    row: Vector
    lower: float
    upper: float
    force: Callable[[Vector, Vector], Vector]


@dataclass(frozen=True)
class PlainSums:
    """Sums of each path (paths,): touches that are as fast as the threshold, the work of the force
    of the stops from these touches on, the work of all, and the time in which a stop pushes."""

    touches: Vector
    work: Vector
    all_work: Vector
    pushed: Vector


def plain_sums(
    mass: Vector, damping: Vector, stiffness: Vector, white: Sequence[float], load: Sequence[float],
    pairs: Sequence[PlainPair], *, step: float, burn_in: float, seconds: float, paths: int,
    seed: int, threshold: float,
) -> list[PlainSums]:  # fmt: skip
    """Sums of every pair under white noises of these intensities on the coordinates."""
    random, n = np.random.default_rng(seed), len(mass)
    inverse = np.linalg.inv(mass)
    kick = np.sqrt(np.asarray(white) * step)[:, None]
    constant = np.asarray(load, float)[:, None]
    sums = np.zeros((len(pairs), 4, paths))
    counts = np.zeros((len(pairs), 2, paths), bool)
    x, v = np.zeros((2, n, paths))
    stops = [
        (number, which, side, pair, place)
        for number, pair in enumerate(pairs)
        for which, (side, place) in enumerate(((-1.0, pair.lower), (1.0, pair.upper)))
        if math.isfinite(place)
    ]

    def pushes(x: Vector, v: Vector) -> list[tuple[Vector, Vector]]:
        found = []
        for _, _, side, pair, place in stops:
            y, rate = side * (pair.row @ x - place), side * (pair.row @ v)
            force = np.maximum(pair.force(np.maximum(y, 0.0), rate), 0.0) * (y > 0.0)
            found.append((force, rate))
        return found

    def bend(x: Vector, v: Vector, found: list[tuple[Vector, Vector]]) -> Vector:
        total = constant - stiffness @ x - damping @ v
        for (_, _, side, pair, _), (force, _) in zip(stops, found, strict=True):
            total = total - np.outer(pair.row, side * force)
        return inverse @ total

    for number in range(round((burn_in + seconds) / step)):
        counted = number * step >= burn_in
        v = v + inverse @ (kick * random.standard_normal((n, paths)))
        a = bend(x, v, pushes(x, v))
        middle, rate = x + 0.5 * step * v, v + 0.5 * step * a
        found = pushes(middle, rate)
        new_x, new_v = x + step * rate, v + step * bend(middle, rate, found)
        for (pair, which, side, own, place), (force, speed) in zip(stops, found, strict=True):
            before, after = (side * (own.row @ each - place) for each in (x, new_x))
            touched = (before <= 0.0) & (after > 0.0)
            if touched.any():
                at = before / np.where(touched, before - after, 1.0)
                fast = side * (own.row @ v) + at * side * (own.row @ (new_v - v)) >= threshold
                counts[pair, which] = np.where(touched, counted & fast, counts[pair, which])
                sums[pair, 0] += touched & counted & fast
            work = step * force * speed
            sums[pair, 1] += work * counts[pair, which]
            if counted:
                sums[pair, 2] += work
                sums[pair, 3] += step * (force > 0.0)
        x, v = new_x, new_v
    return [PlainSums(*each) for each in sums]
