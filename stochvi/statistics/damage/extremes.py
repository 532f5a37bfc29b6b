"""Largest response of a mission, from the largest ones of many windows.

Below the threshold that the largest windows exceed, the distribution of a window is that of the
sample. Beyond it the excess of r^2 is exponential: so are the crests of a Gaussian motion (Rice),
and so are responses that are proportional to impact speeds with the distribution of Rayleigh. What
an exponential excess of r itself would give more is stated as the bias.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stochvi.mathematics.arrays import Vector
from stochvi.results.intervals import jackknife_error

TAIL_SHARE, LEAST_TAIL, MOST_TAIL = 0.1, 10, 50
"""Share of the windows from which the tail is taken, and the limits of their number."""

GROUPS = 20
"""Number of groups of paths that the jackknife leaves out in turn."""

LEVELS, RANGE = 400, 40.0
"""Number of levels beyond the threshold, and the largest exponent up to which they reach."""


class LargestResponses(NamedTuple):
    """Expected largest response with its errors, and the levels of some probabilities
    (probabilities, equipment), m/s^2."""

    value: Vector
    standard_error: Vector
    bias: Vector
    levels: NDArray[np.float64]


def largest_of_mission(
    peaks: NDArray[np.float64], windows: float, probabilities: Sequence[float]
) -> LargestResponses:
    """The largest response of a mission of so many `windows`.

    Parameters
    ----------
    peaks
        (paths, windows, equipment): largest response in windows of independent paths.
    probabilities
        Probabilities of levels, below which the largest response stays.
    """
    paths, _, count = peaks.shape
    groups = np.array_split(np.arange(paths), min(GROUPS, paths))
    value, bias, levels = np.empty(count), np.empty(count), np.empty((len(probabilities), count))
    errors = np.empty(count)
    for i in range(count):
        own = peaks[:, :, i]
        value[i], linear, levels[:, i] = _largest(own.ravel(), windows, probabilities)
        bias[i] = abs(linear - value[i])
        left = [_largest(np.delete(own, group, axis=0).ravel(), windows, ())[0] for group in groups]
        errors[i] = jackknife_error(np.array(left)) if len(groups) > 1 else 0.0
    return LargestResponses(value, errors, bias, levels)


def _largest(
    sample: Vector, windows: float, probabilities: Sequence[float]
) -> tuple[float, float, Vector]:
    """Expected largest, the same with the other tail, and the levels of the probabilities."""
    known = np.sort(sample)
    tail = int(np.clip(TAIL_SHARE * len(known), min(LEAST_TAIL, len(known) // 2), MOST_TAIL))
    threshold, beyond = known[-tail - 1], known[-tail:]
    body = known[: len(known) - tail]
    below = np.arange(1, len(body) + 1) / len(known)
    share = tail / len(known)
    # largest of the body: the integral of 1 - F^n up to the threshold
    start = threshold - float(np.sum(below[:-1] ** windows * np.diff(body)))
    excess = np.linspace(0.0, RANGE + np.log(max(windows, 1.0)), LEVELS)
    chance = np.exp(windows * np.log1p(-share * np.exp(-excess)))  # of staying below a level
    found, quantiles = [], np.empty(0)
    for square in (True, False):
        if square:
            scale = float(np.mean(beyond**2 - threshold**2))
            levels = np.sqrt(threshold**2 + scale * excess)
        else:
            levels = threshold + float(np.mean(beyond - threshold)) * excess
        rest = 1.0 - 0.5 * (chance[1:] + chance[:-1])
        found.append(start + float(np.sum(rest * np.diff(levels))))
        if square:
            whole = np.concatenate([below**windows, chance])
            quantiles = np.interp(probabilities, whole, np.concatenate([body, levels]))
    return found[0], found[1], np.asarray(quantiles)


def exceedance(peaks: Vector, weight: Vector, levels: Vector, square: bool) -> Vector:
    """Share of a weighted sample beyond each level; its tail is exponential in r^2 (`square`), or
    in r."""
    order = np.argsort(peaks)
    known, shares = peaks[order], weight[order] / weight.sum()
    beyond = np.concatenate([np.cumsum(shares[::-1])[::-1], [0.0]])
    found = beyond[np.searchsorted(known, levels, side="right")]
    tail = int(np.clip(TAIL_SHARE * len(known), min(LEAST_TAIL, len(known) // 2), MOST_TAIL))
    threshold, own, share = known[-tail - 1], shares[-tail:], shares[-tail:].sum()
    power = 2 if square else 1
    scale = float(own @ (known[-tail:] ** power - threshold**power)) / share
    excess = (np.maximum(levels, threshold) ** power - threshold**power) / scale
    return np.where(levels > threshold, share * np.exp(-excess), found)
