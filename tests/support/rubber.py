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


class OwnStop(NamedTuple):
    """A stop at row . x = place, on the side 1 or -1: rigid of a restitution, or k y + c y'."""

    row: Array
    side: float
    place: float
    restitution: float
    stiffness: float = 0.0
    damping: float = 0.0


SLOWEST = 1e-6
"""Speed of an impact on a rigid stop after which a mass that is pressed onto it rests there."""


class OwnPath:
    """The motion from rest under forces that are linear between samples, by Runge and Kutta's steps
    that end at every event: an impact, a touch, the end of a contact or of a rest."""

    def __init__(self, rubber: Rubber, stops: list[OwnStop]) -> None:
        self.a, _ = rubber.states()
        self.n, self.inverse = len(rubber.mass), np.linalg.inv(rubber.mass)
        self.rubber = rubber
        self.stops = stops
        self.touching = [False] * len(stops)
        self.impacts: list[tuple[float, int, float]] = []

    def afresh(self) -> OwnPath:
        """The same structure before the first impact."""
        again = OwnPath(self.rubber, self.stops)
        again.a = self.a
        return again

    def stop_relaxing(self) -> None:
        """Keep the branches from relaxing."""
        self.a = self.a.copy()
        self.a[2 * self.n :, 2 * self.n :] = 0.0

    def _of_stop(self, k: int, s: Array) -> tuple[float, float]:
        stop, n = self.stops[k], self.n
        y = stop.side * (stop.row @ s[:n] - stop.place)
        rate = stop.side * (stop.row @ s[n : 2 * n])
        return float(y), float(rate)

    def _event(self, k: int, s: Array, force: Array) -> float:
        """Below 0 as things are, above where they change."""
        y, rate = self._of_stop(k, s)
        stop = self.stops[k]
        push = stop.stiffness * y + stop.damping * rate
        if self.touching[k]:
            return -push if stop.stiffness else -self._pressed(k, s, force)
        return min(y, push) if stop.stiffness else y  # a mass may turn before it has left

    def _pressed(self, k: int, s: Array, force: Array) -> float:
        """Acceleration into a stop if it were not there."""
        free = (self.a @ s)[self.n : 2 * self.n] + self.inverse @ force
        return float(self.stops[k].side * (self.stops[k].row @ free))

    def _rates(self, s: Array, force: Array) -> Array:
        n = self.n
        for k, stop in enumerate(self.stops):
            if not self.touching[k]:
                continue
            y, rate = self._of_stop(k, s)
            push = stop.stiffness * y + stop.damping * rate
            if not stop.stiffness:
                push = self._pressed(k, s, force) / (stop.row @ self.inverse @ stop.row)
            force = force - stop.side * stop.row * push
        found = self.a @ s
        found[n : 2 * n] += self.inverse @ force
        return found

    def _step(self, s: Array, h: float, force: Array, slope: Array) -> Array:
        one = self._rates(s, force)
        two = self._rates(s + 0.5 * h * one, force + 0.5 * h * slope)
        three = self._rates(s + 0.5 * h * two, force + 0.5 * h * slope)
        four = self._rates(s + h * three, force + h * slope)
        return s + h / 6.0 * (one + 2.0 * (two + three) + four)

    def _on(self, s: Array, t: float, h: float, force: Array, slope: Array) -> Array:
        while h > 0.0:
            end = self._step(s, h, force, slope)
            first, which = h, -1
            for k in range(len(self.stops)):
                if self._event(k, end, force + h * slope) <= 0.0 or self._event(k, s, force) > 0.0:
                    continue
                low, high = 0.0, first
                for _ in range(60):
                    middle = 0.5 * (low + high)
                    there = self._step(s, middle, force, slope)
                    beyond = self._event(k, there, force + middle * slope) > 0.0
                    low, high = (low, middle) if beyond else (middle, high)
                if high < first:
                    first, which = high, k
            if which < 0:
                return end
            s = self._step(s, first, force, slope)
            force, t, h = force + first * slope, t + first, h - first
            s = self._change(which, s, t, force)
        return s

    def _change(self, k: int, s: Array, t: float, force: Array) -> Array:
        stop, n = self.stops[k], self.n
        _, rate = self._of_stop(k, s)
        if not self.touching[k]:
            self.impacts.append((t, k, rate))
        if stop.stiffness or self.touching[k]:
            self.touching[k] = not self.touching[k]
            return s
        self.touching[k] = rate < SLOWEST and self._pressed(k, s, force) > 0.0
        rebound = 0.0 if self.touching[k] else stop.restitution
        kick = self.inverse @ stop.row
        s = s.copy()
        s[n : 2 * n] -= stop.side * (1.0 + rebound) * rate * kick / (stop.row @ kick)
        s[:n] -= stop.side * max(self._of_stop(k, s)[0], 0.0) * kick / (stop.row @ kick)
        return s

    def follow(self, forces: Array, step: float, parts: int) -> Array:
        """Displacements (samples, n) at the samples of forces (samples, n)."""
        s, h = np.zeros(len(self.a)), step / parts
        found = [s[: self.n]]
        for number in range(len(forces) - 1):
            slope = (forces[number + 1] - forces[number]) / step
            for part in range(parts):
                force = forces[number] + part * h * slope
                s = self._on(s, number * step + part * h, h, force, slope)
            found.append(s[: self.n])
        return np.array(found)
