"""Rates of rare impacts by a plain weighted ensemble: no code of the package.

The mass of an oscillator between two stops under white noise is followed by many paths with
weights. After every `PAUSE`, the paths in each band of energy are drawn anew, as many in a rare
band as in a common one, so that their weights keep all means (G. A. Huber, S. Kim 1996).
"""

from __future__ import annotations

import math

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

Vector = NDArray[np.float64]

STEP, PAUSE, BAND, BANDS, EACH = 2e-3, 0.1, 0.3, 40, 48
"""Step and time between two drawings, s; width of a band of energy, their number, and the number
of paths in each. At this step a fast impact is late or early by a per cent of its rate."""

BURN_IN, BATCHES = 40.0, 16


def rates_above(
    damping: float, intensity: float, stops: tuple[float, float], restitution: float,
    speeds: tuple[float, ...], duration: float, seed: int,
) -> tuple[Vector, Vector]:  # fmt: skip
    """Impacts per second faster than each of some speeds, of both stops together, and the standard
    errors; mass and stiffness are 1."""
    drift = np.array([[0.0, 1.0], [-1.0, -damping]])
    both = np.zeros((4, 4))
    both[:2, :2], both[:2, 2:], both[2:, 2:] = -drift, np.diag([0.0, intensity]), drift.T
    powers = expm(both * STEP)
    noise = np.linalg.cholesky(powers[2:, 2:].T @ powers[:2, 2:])
    found = _batches(expm(drift * STEP), noise, np.array(stops), restitution, np.array(speeds),
                     duration, np.random.default_rng(seed))  # fmt: skip
    return found.mean(axis=0), found.std(axis=0, ddof=1) / math.sqrt(BATCHES)


@numba.njit
def _batches(flow, noise, stops, restitution, speeds, duration, random):  # type: ignore[no-untyped-def]
    room = BANDS * EACH
    x, v, weight = np.zeros(room), np.zeros(room), np.zeros(room)
    x[:EACH] = min(max(0.0, stops[0] + 1e-3), stops[1] - 1e-3)
    weight[:EACH] = 1.0 / EACH
    paths = EACH
    band = np.zeros(room, np.int64)
    found = np.zeros((BATCHES, len(speeds)))
    steps = round(PAUSE / STEP)
    first = round(BURN_IN / PAUSE)
    per_batch = round(duration / PAUSE / BATCHES)
    for period in range(first + per_batch * BATCHES):
        batch = (period - first) // per_batch if period >= first else -1
        for k in range(paths):
            for _ in range(steps):
                one, two = random.standard_normal(), random.standard_normal()
                place = flow[0, 0] * x[k] + flow[0, 1] * v[k] + noise[0, 0] * one
                speed = flow[1, 0] * x[k] + flow[1, 1] * v[k] + noise[1, 0] * one
                speed += noise[1, 1] * two
                for side, stop in ((-1.0, stops[0]), (1.0, stops[1])):
                    if side * (place - stop) > 0.0:
                        part = min(max((stop - x[k]) / (place - x[k]), 0.0), 1.0)
                        hit = max(side * (v[k] + (speed - v[k]) * part), 0.0)
                        if batch >= 0:
                            for j in range(len(speeds)):
                                if hit > speeds[j]:
                                    found[batch, j] += weight[k]
                        speed = -side * restitution * hit + (speed - v[k]) * (1.0 - part)
                        place = stop - side * restitution * hit * (1.0 - part) * STEP
                x[k], v[k] = place, speed
        for k in range(paths):
            band[k] = min(int((x[k] ** 2 + v[k] ** 2) / 2.0 / BAND), BANDS - 1)
        paths = _drawn_anew(x, v, weight, band, paths, random)
    return found / (per_batch * PAUSE)


@numba.njit
def _drawn_anew(x, v, weight, band, paths, random):  # type: ignore[no-untyped-def]
    old_x, old_v, old_weight = x[:paths].copy(), v[:paths].copy(), weight[:paths].copy()
    count = 0
    for b in range(BANDS):
        total = 0.0
        for k in range(paths):
            if band[k] == b:
                total += old_weight[k]
        if total == 0.0:
            continue
        passed, point = 0.0, random.random() * total / EACH
        drawn = 0
        last = 0
        for k in range(paths):
            if band[k] == b:
                last = k
                passed += old_weight[k]
                while drawn < EACH and point < passed:
                    x[count], v[count], weight[count] = old_x[k], old_v[k], total / EACH
                    count, drawn, point = count + 1, drawn + 1, point + total / EACH
        while drawn < EACH:  # by rounding
            x[count], v[count], weight[count] = old_x[last], old_v[last], total / EACH
            count, drawn = count + 1, drawn + 1
    return count
