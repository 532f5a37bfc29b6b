"""A mass that a relay drives between its stops, by small steps with a buffer of the past."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, kw_only=True)
class RelayTwin:
    """Many paths of x'' + b x' + w^2 x = U s(t - t0) + g + white noise, per unit mass.

    The relay sees each path as it was the time `delay` ago. A stop is rigid, or a spring of the
    given stiffness.
    """

    force: float
    damping: float
    frequency: float = 0.0
    load: float = 0.0
    intensity: float = 0.0
    above: float = math.inf
    below: float = -math.inf
    delay: float = 0.0
    lower: float = -math.inf
    upper: float = math.inf
    restitution: float = 0.5
    stop_stiffness: float | None = None

    def averages(
        self, paths: int, settle: float, duration: float, step: float, seed: int = 0
    ) -> dict[str, tuple[float, float]]:
        """Means over time and paths, with standard errors: of x, x^2 and v^2, and of the rate of
        impacts, F1 and F2."""
        random = np.random.default_rng(seed)
        x, v = np.zeros(paths), np.full(paths, 1e-9)
        lag = round(self.delay / step)
        seen = np.ones((lag + 1, paths))
        inside = np.zeros(paths, bool)
        sums = np.zeros((6, paths))
        kick = math.sqrt(self.intensity * step)
        first = round(settle / step)
        steps = first + round(duration / step)
        for number in range(steps):
            up = np.where(x < self.above, 1.0, -1.0)
            down = np.where(x > self.below, -1.0, 1.0)
            seen[number % (lag + 1)] = np.where(v >= 0.0, up, down)
            side = seen[(number + 1) % (lag + 1)]
            a = self.force * side + self.load - self.damping * v - self.frequency**2 * x
            if self.stop_stiffness is not None:
                deep = np.maximum(x - self.upper, 0.0) + np.minimum(x - self.lower, 0.0)
                a = a - self.stop_stiffness * deep
            v = v + a * step + kick * random.standard_normal(paths)
            moved = x + v * step
            hit = (moved > self.upper) & (v > 0.0) | (moved < self.lower) & (v < 0.0)
            touched = hit & ~inside
            w = np.where(touched, np.abs(v), 0.0)
            if number >= first:
                sums[:3] += moved, moved**2, v**2
                sums[3:] += touched, w, w**2
            if self.stop_stiffness is None:
                stop = np.where(v > 0.0, self.upper, self.lower)
                with np.errstate(invalid="ignore", divide="ignore"):
                    early = np.where(hit, (moved - stop) / v, 0.0)
                v = np.where(hit, -self.restitution * v, v)
                moved = np.where(hit, stop + v * early, moved)
            else:
                inside = (moved > self.upper) | (moved < self.lower)
            x = moved
        per = np.array([1.0, 1.0, 1.0, 1.0 / step, 1.0 / step, 1.0 / step])
        found = sums * per[:, None] / (steps - first)
        names = ("x", "xx", "vv", "rate", "f1", "f2")
        return {
            name: (float(row.mean()), float(row.std(ddof=1) / math.sqrt(paths)))
            for name, row in zip(names, found, strict=True)
        }
