"""Regimes whose impacts are even in time: all of them, from the roots of a polynomial."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stochvi.mathematics.arrays import Matrix, Vector
from stochvi.methods.periodic.family import Numbers, amplitudes
from stochvi.methods.periodic.kernels import solver
from stochvi.methods.periodic.regimes import pattern_of

NEAR_CIRCLE = 1e-3
"""Distance from the unit circle up to which a root counts as a phase; at a grazing two roots meet
on it."""

TOLERANCE = 1e-9
"""Depth to which a regime may pass a stop, relative to the unit of length; rounding error stays
below it."""

NOTHING = 1e-13
"""Distance at the first impact, relative to the gap, up to which it counts as zero; rounding error
stays below it."""


MOST_STEPS = 20_000
"""Largest number of steps of a period, so that a regime takes fractions of a second."""


@dataclass(frozen=True, kw_only=True, eq=False)
class EvenRegime:
    """A periodic motion whose impacts are even in time (SI units).

    Parameters
    ----------
    phase
        Phases of the force at the impacts, rad.
    displacement, velocity
        The coordinates just before the first impact.
    impact_speed
        Incident speeds.
    amplitude
        Amplitude of the first harmonic of the output, m.
    multiplier
        Largest modulus of the factors of small perturbations over the period of the regime.
    admissible
        Whether it meets no stop besides these impacts.
    """

    phase: Vector
    displacement: Vector
    velocity: Vector
    impact_speed: Vector
    amplitude: float
    multiplier: float
    admissible: bool


def even_phases(motion: solver.Motion, stops: Sequence[int], periods: int) -> Matrix:
    """Phases (number, impacts) at which impacts evenly in time meet the first stop.

    The distance at the first impact is a sum of harmonics of its phase, so that all its roots are
    known: all regimes of one impact, and the symmetric ones of two between equal stops.
    """
    waves = _waves(motion, stops, periods)
    if not np.all(np.isfinite(waves)) or not np.any(waves[:-1]):
        return np.empty((0, len(stops)))
    roots = np.roots(waves)
    first = np.angle(roots[np.abs(np.abs(roots) - 1.0) < NEAR_CIRCLE])
    return np.asarray(first[:, None] + _apart(stops, periods))


def even_regimes(numbers: Numbers, stops: Sequence[int], periods: int = 1) -> list[EvenRegime]:
    """The regimes with impacts on the given stops, in this order and even in time, the fastest
    first. Those of several impacts are symmetric between equal stops."""
    units, length, duration = numbers.units()
    motion, shapes = numbers.motion(units), numbers.shapes / units.shapes
    steps = 2.0 * math.pi * periods / motion.omega / solver.step_of(motion)
    if not 0.0 < steps <= MOST_STEPS:
        raise ValueError(
            f"a period of omega must take at most {MOST_STEPS} steps, got {steps:.3g}; ask for a "
            "higher frequency"
        )
    pattern, speed, n = pattern_of(stops, periods), length / duration, len(shapes)
    states = np.empty((len(stops), 2 * n))
    found = []
    for theta in even_phases(motion, stops, periods):
        if not solver.settle(motion, pattern, theta, states):
            continue
        rows = motion.rows[pattern.stops]
        speeds = speed * np.einsum("ki,ki->k", rows, states[:, n:])
        if not speeds.min() > 0.0:
            continue
        margin, _, _, factors = solver.survey(motion, pattern, theta, states)
        (amplitude,) = amplitudes(
            numbers.flat[None], numbers.sizes, stops, periods, theta[None], speeds[None]
        )
        found.append(
            EvenRegime(
                phase=theta,
                displacement=length * shapes @ states[0, :n],
                velocity=speed * shapes @ states[0, n:],
                impact_speed=speeds,
                amplitude=float(amplitude),
                multiplier=float(np.abs(np.linalg.eigvals(factors)).max()),
                admissible=bool(margin >= -TOLERANCE),
            )
        )
    return sorted(found, key=lambda each: -float(each.impact_speed[0]))


def widest(numbers: Numbers, stops: Sequence[int], periods: int = 1) -> float:
    """Factor by which all gaps may grow until no phase of one sine is left for such impacts, where
    no constant force acts; infinite where nothing is lost."""
    units, length, _ = numbers.units()
    motion = numbers.motion(units)
    first, mean, _ = np.abs(_waves(motion, stops, periods))
    reach = float(np.max(np.abs(numbers.distances))) / length
    return float(2.0 * first / mean) if mean > NOTHING * reach else math.inf


def _apart(stops: Sequence[int], periods: int) -> Vector:
    """Phases between the first impact and each other one."""
    return np.asarray(2.0 * np.pi * periods / len(stops) * np.arange(len(stops)))


def _waves(motion: solver.Motion, stops: Sequence[int], periods: int) -> NDArray[np.complex128]:
    """Coefficients of e^(i k phase) of the distance at the first impact, from the highest k to the
    lowest; NaN where phases leave the motion undetermined."""
    count, n = len(stops), motion.rows.shape[1]
    samples = len(motion.generator) - 2 * n
    pattern, apart = pattern_of(stops, periods), _apart(stops, periods)
    states, left, none = np.empty((count, 2 * n)), np.empty(count), np.empty((0, 0))
    distances = np.full(samples, np.nan)
    for number in range(samples):
        theta = 2.0 * np.pi * number / samples + apart
        if not solver.residual(motion, pattern, theta, states, left, none):
            break
        distances[number] = left[0]
    return np.asarray(np.fft.fftshift(np.fft.fft(distances))[::-1] / samples)
