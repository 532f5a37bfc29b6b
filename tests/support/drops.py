"""Synthetic tests of stops: contacts by a Runge-Kutta method of its own."""

from __future__ import annotations

import numpy as np

G = 9.80665


def force(y: float, v: float, k: float, n: float, c: float, m: float) -> float:
    """A force max(k y^n + c y^m v, 0), without any code of the package."""
    return max(k * y**n + c * y**m * v, 0.0) if y > 0.0 else 0.0


def contact(
    k: float, n: float, c: float, m: float, *, mass: float, speed: float, gravity: float = 0.0,
    steps: int = 2000,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:  # fmt: skip
    """Times, deflections and speeds of one contact, by the classical method of fourth order."""
    deep = (0.5 * mass * speed**2 * (n + 1.0) / k) ** (1.0 / (n + 1.0))
    h = 4.0 * deep / speed / steps

    def rate(state: np.ndarray) -> np.ndarray:
        return np.array([state[1], gravity - force(*state, k, n, c, m) / mass])

    state, found = np.array([0.0, speed]), [np.array([0.0, speed])]
    while len(found) < 20 * steps:
        a = rate(state)
        b = rate(state + h / 2.0 * a)
        d = rate(state + h / 2.0 * b)
        e = rate(state + h * d)
        state = state + h / 6.0 * (a + 2.0 * b + 2.0 * d + e)
        found.append(state)
        if state[0] < 0.0:
            break
    y, v = np.array(found).T
    return h * np.arange(len(y)), y, v


def restitution(k: float, n: float, c: float, m: float, *, mass: float, speed: float) -> float:
    """Speed at which the mass leaves, over that of its approach."""
    return -contact(k, n, c, m, mass=mass, speed=speed)[2][-1] / speed


def record(
    k: float, n: float, c: float, m: float, *, mass: float, speed: float, fs: float,
    before: float = 5e-3, after: float = 5e-3, gravity: float = G,
) -> np.ndarray:  # fmt: skip
    """What an accelerometer on the mass shows, m/s^2: 0 but for the force of the stop."""
    t, y, v = contact(k, n, c, m, mass=mass, speed=speed, gravity=gravity)
    pushes = np.array([force(*each, k, n, c, m) for each in zip(y, v, strict=True)]) / mass
    samples = np.arange(round((before + t[-1] + after) * fs)) / fs - before
    inside = (samples > 0.0) & (samples < t[-1])
    return np.where(inside, np.interp(samples, t, pushes), 0.0)
