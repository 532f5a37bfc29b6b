"""One mass on a spring or a damper that is a function, stepped in NumPy: plain missions, and a
splitting that follows the amplitude from one level to the next. Nothing here is shared with the
package."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
G = 9.80665


@dataclass(frozen=True)
class PlainMount:
    """m x'' + c x' + k x + spring(x) + F sign(x') + stiffness length z = - m a(t).

    Parameters
    ----------
    hysteresis
        Stiffness and yield displacement of a Bouc-Wen spring of exponent 1 and beta 0.5.
    intensity
        S of E a(t) a(t + tau) = S delta(tau), (m/s^2)^2 s; 0 where records shake the mass.
    """

    mass: float = 10.0
    stiffness: float = 0.0
    damping: float = 0.0
    spring: Callable[[Array], Array] | None = None
    hysteresis: tuple[float, float] | None = None
    friction: float = 0.0
    intensity: float = 0.0
    step: float = 5e-4

    def drifted(self, state: Array, time: float) -> Array:
        """Displacement, velocity and memory after a time at a steady velocity."""
        x, v, z = state
        if self.hysteresis is not None:
            way = np.abs(v) * time / self.hysteresis[1]
            z = np.sign(v) * z  # along the way
            back = np.minimum(way, np.maximum(-z, 0.0))  # of full stiffness until the force is 0
            z = z + back
            z = np.where(z < 0.0, z, 1.0 - (1.0 - z) * np.exp(back - way))
            z = np.sign(v) * z
        return np.stack([x + v * time, v, z])

    def stepped(
        self, state: Array, random: np.random.Generator, shaken: Array | float = 0.0
    ) -> Array:
        """The states (3, paths) a step later; `shaken` is the acceleration of the base, m/s^2."""
        h = self.step
        x, v, z = state = self.drifted(state, h / 2.0)
        force = -self.stiffness * x - self.damping * v
        if self.spring is not None:
            force -= self.spring(x)
        if self.hysteresis is not None:
            force -= self.hysteresis[0] * self.hysteresis[1] * z
        v = v + h * (force / self.mass - shaken)
        if self.intensity:
            v += np.sqrt(self.intensity * h) * random.standard_normal(v.shape)
        if self.friction:
            v = np.sign(v) * np.maximum(np.abs(v) - h * self.friction / self.mass, 0.0)
        state[1] = v
        return self.drifted(state, h / 2.0)

    def settled(self, paths: int, seconds: float, random: np.random.Generator) -> Array:
        """States of paths that began at rest so long ago."""
        state = np.zeros((3, paths))
        for _ in range(round(seconds / self.step)):
            state = self.stepped(state, random)
        return state

    def farthest(
        self, paths: int, mission: float, settling: float, seed: int,
        band: tuple[float, float, float] | None = None,
    ) -> Array:  # fmt: skip
        """Largest displacement of each path in a mission that begins in the settled motion.

        `band` shakes the base with noise between two frequencies, Hz, of a one-sided density,
        (m/s^2)^2/Hz.
        """
        random = np.random.default_rng(seed)
        first, last = (round(each / self.step) for each in (settling, settling + mission))
        base = self._records(paths, last, band, random) if band else np.zeros((last, 1))
        state, farthest = np.zeros((3, paths)), np.zeros(paths)
        for number in range(last):
            state = self.stepped(state, random, base[number])
            if number >= first:
                np.maximum(farthest, np.abs(state[0]), out=farthest)
        return farthest

    def _records(
        self, paths: int, samples: int, band: tuple[float, float, float],
        random: np.random.Generator,
    ) -> Array:  # fmt: skip
        """Noise (samples, paths) of twice the length that is used, so that its ends are apart."""
        low, high, density = band
        length = 2 * samples
        frequency = np.fft.rfftfreq(length, self.step)
        inside = (frequency >= low) & (frequency <= high)
        size = 0.5 * length * np.sqrt(density / (length * self.step)) * inside
        waves = random.standard_normal((2, len(frequency), paths))
        return np.fft.irfft(size[:, None] * (waves[0] + 1j * waves[1]), length, axis=0)[:samples]

    def rate(
        self, clearance: float, levels: list[float], omega: float, paths: int, seed: int,
        seconds: float = 20.0,
    ) -> float:  # fmt: skip
        """Rate of first contacts at a clearance, 1/s, from one splitting by levels of amplitude.

        The amplitude is sqrt(x^2 + (v / omega)^2). Paths that rise from the first level to the
        second are counted; some of them reach each further level before they fall below the first.
        """
        random = np.random.default_rng(seed)

        def amplitude(state: Array) -> Array:
            return np.hypot(state[0], state[1] / omega)

        state = self.settled(paths, 5.0, random)
        quiet, rising = amplitude(state) < levels[0], []
        for _ in range(round(seconds / self.step)):
            state = self.stepped(state, random)
            size = amplitude(state)
            crossed = quiet & (size >= levels[1])
            rising.append(state[:, crossed])
            quiet = (quiet & ~crossed) | (size < levels[0])
        begun = np.concatenate(rising, axis=1)
        rate = begun.shape[1] / (paths * seconds)
        for level in [*levels[2:], np.inf]:
            state = begun[:, random.integers(begun.shape[1], size=paths)]
            reached, rate_of = [], 0
            while state.shape[1]:
                state = self.stepped(state, random)
                size, hit = amplitude(state), np.abs(state[0]) >= clearance
                passed = (size >= level) if np.isfinite(level) else hit
                reached.append(state[:, passed])
                rate_of += int(passed.sum())
                state = state[:, ~passed & (size >= levels[0])]
            rate *= rate_of / paths
            begun = np.concatenate(reached, axis=1)
        return rate
