"""A reed of finite elements that slaps against a spring stop, step by step (Newmark's rule)."""

import math

import numpy as np
import scipy
from numba import njit


def matrices(length: float, bending: float, mass_per_length: float, count: int):
    """Mass, stiffness and load of a moving base, of a cantilever of elements with cubic shapes."""
    h = length / count
    k = np.array([[12, 6 * h, -12, 6 * h], [6 * h, 4 * h**2, -6 * h, 2 * h**2],
                  [-12, -6 * h, 12, -6 * h], [6 * h, 2 * h**2, -6 * h, 4 * h**2]])  # fmt: skip
    m = np.array([[156, 22 * h, 54, -13 * h], [22 * h, 4 * h**2, 13 * h, -3 * h**2],
                  [54, 13 * h, 156, -22 * h], [-13 * h, -3 * h**2, -22 * h, 4 * h**2]])  # fmt: skip
    mass, stiffness = np.zeros((2, 2 * count + 2, 2 * count + 2))
    for first in range(0, 2 * count, 2):
        mass[first : first + 4, first : first + 4] += mass_per_length * h / 420.0 * m
        stiffness[first : first + 4, first : first + 4] += bending / h**3 * k
    follow = mass @ np.tile([1.0, 0.0], count + 1)
    return mass[2:, 2:], stiffness[2:, 2:], follow[2:]


def bands(matrix: np.ndarray) -> np.ndarray:
    """The diagonal and the three below it, one a row."""
    return np.array([np.pad(np.diag(matrix, -k), (0, k)) for k in range(4)])


@njit
def times(band: np.ndarray, x: np.ndarray, out: np.ndarray) -> None:
    """Product of a symmetric band matrix with many columns."""
    for i in range(x.shape[0]):
        for lane in range(x.shape[1]):
            out[i, lane] = band[0, i] * x[i, lane]
        for k in range(1, 4):
            if i >= k:
                for lane in range(x.shape[1]):
                    out[i, lane] += band[k, i - k] * x[i - k, lane]
            if i + k < x.shape[0]:
                for lane in range(x.shape[1]):
                    out[i, lane] += band[k, i] * x[i + k, lane]


@njit
def solve(factor: np.ndarray, x: np.ndarray) -> None:
    """Solve with a Cholesky factor in bands, in the place of the right-hand sides."""
    n = x.shape[0]
    for i in range(n):
        for k in range(1, min(i, 3) + 1):
            for lane in range(x.shape[1]):
                x[i, lane] -= factor[k, i - k] * x[i - k, lane]
        for lane in range(x.shape[1]):
            x[i, lane] /= factor[0, i]
    for i in range(n - 1, -1, -1):
        for k in range(1, min(n - 1 - i, 3) + 1):
            for lane in range(x.shape[1]):
                x[i, lane] -= factor[k, i] * x[i + k, lane]
        for lane in range(x.shape[1]):
            x[i, lane] /= factor[0, i]


@njit
def slap(mass, stiffness, factor, column, follow, damping, stop, rng, steps, skipped):
    """Sums of each path: touches, their speeds, the peak forces of contacts, squares of the tip."""
    clearance, spring, deviation, h = stop
    n, lanes = mass.shape[1], 64
    x, v, a = np.zeros((n, lanes)), np.zeros((n, lanes)), np.zeros((n, lanes))
    ahead, faster, rhs, part = np.zeros((4, n, lanes))
    sums, peak, inside = np.zeros((4, lanes)), np.zeros(lanes), np.zeros(lanes)
    own = h * h / 4.0 * spring
    for step in range(-skipped, steps):
        for i in range(n):
            for lane in range(lanes):
                ahead[i, lane] = x[i, lane] + h * v[i, lane] + h * h / 4.0 * a[i, lane]
                faster[i, lane] = v[i, lane] + h / 2.0 * a[i, lane]
        times(stiffness, ahead, rhs)
        times(mass, faster, part)
        for lane in range(lanes):
            base = deviation * rng.standard_normal()
            for i in range(n):
                rhs[i, lane] = -rhs[i, lane] - damping * part[i, lane] - follow[i] * base
        solve(factor, rhs)
        for lane in range(lanes):
            beyond = ahead[n - 2, lane] + h * h / 4.0 * rhs[n - 2, lane] - clearance
            push = spring * beyond / (1.0 + own * column[n - 2]) if beyond > 0.0 else 0.0
            speed = faster[n - 2, lane] + h / 2.0 * (rhs[n - 2, lane] - push * column[n - 2])
            if step >= 0:
                if beyond > 0.0 and inside[lane] == 0.0 and speed > 0.0:
                    sums[0, lane] += 1.0
                    sums[1, lane] += speed
                if beyond <= 0.0 and inside[lane] > 0.0:
                    sums[2, lane] += peak[lane]
                sums[3, lane] += x[n - 2, lane] ** 2
            peak[lane] = max(peak[lane], push) if beyond > 0.0 else 0.0
            inside[lane] = 1.0 if beyond > 0.0 else 0.0
            if push > 0.0:
                for i in range(n):
                    rhs[i, lane] -= column[i] * push
        for i in range(n):
            for lane in range(lanes):
                a[i, lane] = rhs[i, lane]
                x[i, lane] = ahead[i, lane] + h * h / 4.0 * a[i, lane]
                v[i, lane] = faster[i, lane] + h / 2.0 * a[i, lane]
    return sums


def slapping(beam, damping, stop, duration, step, count=100, seed=1):
    """Hit rate, F1, mean peak force and rms of the tip, each with its standard error, of 64 paths.

    `beam` is length, bending stiffness and mass per length; `damping` the rate of C = damping M;
    `stop` clearance, stiffness and intensity of the acceleration of the base.
    """
    mass, stiffness, follow = matrices(*beam, count)
    whole = (1.0 + damping * step / 2.0) * mass + step**2 / 4.0 * stiffness
    column = np.linalg.solve(whole, np.eye(len(mass))[-2])
    factor = scipy.linalg.cholesky_banded(bands(whole), lower=True)
    clearance, spring, intensity = stop
    skipped = int(6.0 / damping / step)
    found = slap(
        bands(mass), bands(stiffness), factor, column, follow, damping,
        (clearance, spring, math.sqrt(intensity / step), step), np.random.default_rng(seed),
        int(duration / step), skipped,
    )  # fmt: skip
    hits, speeds, peaks, squares = found
    rows = {"rate": hits / duration, "F1": speeds / duration}
    out = {name: (row.mean(), row.std() / math.sqrt(len(row) - 1)) for name, row in rows.items()}
    ratio = peaks.sum() / hits.sum()
    out["peak force"] = (ratio, (peaks - ratio * hits).std() / math.sqrt(len(hits)) / hits.mean())
    square = squares * step / duration
    rms = math.sqrt(square.mean())
    out["rms of the tip"] = (rms, square.std() / math.sqrt(len(square)) / (2.0 * rms))
    return out
