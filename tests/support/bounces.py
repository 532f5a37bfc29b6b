"""A structure between rigid stops under sines, from impact to impact, by matrices of its own.

Nothing here is shared with the package but the model: modes are complex, forced motion is added
to them, and impacts are found by bracketing on a fine grid of time.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.linalg import expm
from scipy.optimize import brentq

from stochvi.model.model import Model, model_of
from stochvi.scenes.scene import Scene

Vector = np.ndarray


class Bounces:
    """x' = A x + forcing in physical coordinates (n displacements, n velocities)."""

    def __init__(self, scene: Scene, steps: int = 400) -> None:
        self.model: Model = model_of(scene)
        model, n = self.model, len(self.model.mass)
        inverse = np.linalg.inv(model.mass)
        sines = model.sines
        # displacements, velocities, the two states of each sine, and a constant
        size = 2 * n + 2 * len(sines) + 1
        a = np.zeros((size, size))
        a[:n, n : 2 * n] = np.eye(n)
        a[n : 2 * n, :n] = -inverse @ model.stiffness
        a[n : 2 * n, n : 2 * n] = -inverse @ model.damping
        a[n : 2 * n, -1] = inverse @ model.constant_force
        for number, sine in enumerate(sines):
            at = 2 * n + 2 * number
            a[n : 2 * n, at] = inverse @ sine.direction * sine.amplitude
            a[at, at + 1], a[at + 1, at] = -sine.omega, sine.omega
        self.a, self.n = a, n
        self.omega = min(sine.omega for sine in sines)
        self.stops = [(pair, stop) for pair in model.pairs for stop in pair.stops]
        fastest = math.sqrt(abs(np.linalg.eigvals(inverse @ model.stiffness)).max())
        self.h = 2.0 * math.pi / max(fastest, max(sine.omega for sine in sines)) / steps
        self.step = expm(self.h * a)

    def start(self, displacement: Vector, velocity: Vector, phase: float) -> Vector:
        """The whole state at a phase of the lowest sine."""
        waves = [
            part
            for sine in self.model.sines
            for angle in [sine.omega / self.omega * phase + sine.phase]
            for part in (math.cos(angle), math.sin(angle))
        ]
        return np.concatenate([displacement, velocity, waves, [1.0]])

    def gap(self, z: Vector, number: int) -> float:
        """How far a state is beyond a stop."""
        pair, stop = self.stops[number]
        return float(stop.side * (pair.direction @ z[: self.n]) - stop.distance)

    def speed(self, z: Vector, number: int) -> float:
        """The speed towards a stop."""
        pair, stop = self.stops[number]
        return float(stop.side * (pair.direction @ z[self.n : 2 * self.n]))

    def flown(self, z: Vector, time: float) -> Vector:
        """The state after a time without impacts, which may be negative."""
        return expm(time * self.a) @ z

    def struck(self, z: Vector, number: int) -> Vector:
        """The state after an impact."""
        pair, stop = self.stops[number]
        towards = np.linalg.solve(self.model.mass, pair.direction)
        rate = pair.direction @ z[self.n : 2 * self.n]
        after = z.copy()
        after[self.n : 2 * self.n] -= (
            (1.0 + stop.law.restitution) * rate / (pair.direction @ towards) * towards
        )
        return after

    def next_impact(self, z: Vector, longest: float) -> tuple[float, int, Vector] | None:
        """Time to the next impact, its stop and the state before it."""
        time = 0.0
        while time < longest:
            later = self.step @ z
            hits = []
            for s in range(len(self.stops)):
                end, beyond = self.h, self.gap(later, s)
                own = lambda tau, s=s, z=z: self.gap(self.flown(z, tau), s)  # noqa: E731
                if self.speed(z, s) > 0.0 > self.speed(later, s) and beyond <= 0.0:
                    # it turns back within the step: whether before the stop or beyond it
                    end = brentq(lambda tau, s=s, z=z: self.speed(self.flown(z, tau), s), 0.0, end)
                    beyond = own(end)
                if beyond <= 0.0:
                    continue
                # the stop that was just struck is left at once: its next impact is looked for
                low = 1e-3 * self.h if time == 0.0 and self.speed(z, s) < 0.0 else 0.0
                low = brentq(own, low, end, xtol=1e-17, rtol=1e-15) if own(low) < 0.0 else low
                hits.append((low, s))
            if hits:
                tau, s = min(hits)
                return time + tau, s, self.flown(z, tau)
            z, time = later, time + self.h
        return None

    def impacts(self, z: Vector, number: int, longest: float) -> list[tuple[float, int, Vector]]:
        """The next impacts: time, stop and the state before each; fewer where they end."""
        found, time = [], 0.0
        while len(found) < number:
            hit = self.next_impact(z, longest)
            if hit is None:
                break
            time += hit[0]
            found.append((time, hit[1], hit[2]))
            z = self.struck(hit[2], hit[1])
        return found
