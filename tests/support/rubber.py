"""Structures on springs that relax, by matrices of their own: random scenes, their state space,
transfer functions and stationary covariances, and an integrator with the inner state."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Rubber(NamedTuple):
    """M x'' + C x' + K x + sum g r = f with r' = k g'x' - r / tau, and intensities S of f."""

    mass: Array
    damping: Array
    stiffness: Array
    rows: Array
    strengths: Array
    times: Array
    noise: Array

    def stiffness_at(self, omega: float) -> NDArray[np.complex128]:
        """Dynamic stiffness at a frequency, rad/s."""
        turn = 1j * omega * self.times
        relaxing = (self.rows.T * (self.strengths * turn / (1.0 + turn))) @ self.rows
        return self.stiffness + 1j * omega * self.damping - omega**2 * self.mass + relaxing

    def states(self) -> tuple[Array, Array]:
        """A and the intensities of s' = A s + noise for s = (x, x', r)."""
        n, b = len(self.mass), len(self.times)
        inverse = np.linalg.inv(self.mass)
        a, q = np.zeros((2, 2 * n + b, 2 * n + b))
        a[:n, n : 2 * n] = np.eye(n)
        a[n : 2 * n, :n] = -inverse @ self.stiffness
        a[n : 2 * n, n : 2 * n] = -inverse @ self.damping
        a[n : 2 * n, 2 * n :] = -inverse @ self.rows.T
        a[2 * n :, n : 2 * n] = self.strengths[:, None] * self.rows
        a[2 * n :, 2 * n :] = -np.diag(1.0 / self.times)
        q[n : 2 * n, n : 2 * n] = inverse @ self.noise @ inverse
        return a, q

    def covariance(self) -> Array:
        """Stationary covariance of the states under white noise, from A P + P A' + Q = 0."""
        a, q = self.states()
        one = np.eye(len(a))
        both = np.kron(a, one) + np.kron(one, a)
        return np.linalg.solve(both, -q.ravel()).reshape(a.shape)


def random_rubber(seed: int, most: int = 4) -> tuple[Rubber, dict[str, Any]]:
    """Matrices, and the keys of a structure with them, of 1 to `most` coordinates."""
    draw = np.random.default_rng(seed)
    n = int(draw.integers(1, most + 1))

    def positive(size: float) -> Array:
        root = draw.normal(size=(n, n))
        return size * (root @ root.T / n + 0.3 * np.eye(n))

    mass, stiffness = positive(1.0), positive(4.0)
    damping = positive(10.0 ** draw.uniform(-2.0, -0.5))
    names = [f"x{k}" for k in range(n)]
    rows, strengths, times, springs = [], [], [], []
    static = stiffness.copy()
    for _ in range(int(draw.integers(1, 4))):
        row, place = np.zeros(n), {}
        if n > 1 and draw.random() < 0.5:
            one, two = draw.choice(n, 2, replace=False)
            row[one], row[two] = 1.0, -1.0
            place = {"between": [names[one], names[two]]}
        else:
            one = int(draw.integers(n))
            row[one] = 1.0
            place = {"on": names[one]}
        own = float(draw.uniform(0.0, 2.0))
        static += own * np.outer(row, row)
        branches = []
        for _ in range(int(draw.integers(1, 4))):
            k, tau = float(draw.uniform(0.1, 4.0)), float(10.0 ** draw.uniform(-1.5, 1.0))
            branches.append([k, tau])
            rows.append(row)
            strengths.append(k)
            times.append(tau)
        springs.append({"kind": "relaxation", "stiffness": own, "branches": branches, **place})
    noise = np.zeros((n, n))
    noise[0, 0] = 0.7
    keys = {
        "coordinates": names, "mass": mass.tolist(), "damping": damping.tolist(),
        "stiffness": stiffness.tolist(), "spring": springs,
    }  # fmt: skip
    own_matrices = np.array(rows), np.array(strengths), np.array(times)
    return Rubber(mass, damping, static, *own_matrices, noise), keys
