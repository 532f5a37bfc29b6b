"""Records for the tests of their verdict: Gaussian ones, and ones that are not."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]

FS = 400.0
"""Sampling rate, Hz."""


def gaussian(
    random: np.random.Generator, seconds: float, low: float = 4.0, high: float = 80.0
) -> Vector:
    """A stretch of stationary Gaussian noise in a band, 1 g rms."""
    length = 2 * int(seconds * FS)
    f = np.fft.rfftfreq(length, 1.0 / FS)
    inside = (f >= low) & (f <= high)
    spectrum = np.where(inside, random.normal(size=(2, len(f))), 0.0)
    a = np.fft.irfft(spectrum[0] + 1j * spectrum[1], length)[: length // 2]
    return np.asarray(a / a.std())


def spoilt(kind: str, random: np.random.Generator) -> Vector:
    """Gaussian noise of a minute with potholes, a sine, a change of level, or cut off; with none of
    these for any other word."""
    a = gaussian(random, 60.0)
    t = np.arange(len(a)) / FS
    if kind == "potholes":
        for start in (20.0, 41.0):
            inside = (t >= start) & (t < start + 0.04)
            a[inside] += 9.0 * np.sin(np.pi * (t[inside] - start) / 0.04)
    elif kind == "sine":
        a += 1.5 * np.sin(2.0 * np.pi * 12.0 * t)
    elif kind == "level":
        a *= np.where(t < 30.0, 1.0, 2.0)
    elif kind == "clipped":
        a = np.clip(a, -2.0, 2.0)
    return a
