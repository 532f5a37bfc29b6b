"""Largest response of a mission, from the largest ones of many windows.

Let F be the distribution of a window's largest response r. Beyond a threshold u the expected number
of louder responses in a window is taken as

    -ln F(r) = L (1 + xi (r^2 - u^2) / beta)^(-1 / xi).

With xi = 0 that is the law of the crests of a Gaussian motion (Rice), and of responses that are
proportional to impact speeds with the distribution of Rayleigh. A motion about a sine has a lighter
tail, -0.1 < xi < 0: its crests are Gaussian about the amplitude of the sine, not about 0. A mixture
of levels or of calm and struck windows has a heavier one; that of an exponential law of r itself is
about 0.15 where r^2 has grown to a few beta. So the shape xi is not assumed: before the sample is
seen it is normal about 0 with the deviation `SHAPE`. L, beta and xi are averaged over all values
that the sample leaves likely (Bayes). A quantile of the mission's largest response holds the
uncertainty of all three, and lies therefore beyond that of the best estimate.

The threshold is the lowest one from which the scale beta no longer changes with the threshold by
more than its scatter (O. V. Lepski 1990; H. Drees and E. Kaufmann, Stoch. Process. Appl. 75 (1998)
149).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stochvi.mathematics.arrays import Vector
from stochvi.results.intervals import GAUSSIAN_95, jackknife_error

SHAPE = 0.15
"""Standard deviation of the shape xi before the sample is seen."""

SHAPES, SCALES = np.linspace(-0.42, 0.56, 15) + 0.01, 17
"""Shapes that are averaged over, none of them 0, and the number of scales beside each."""

FLAT = 1e-12
"""Smallest scale over the square of the largest response."""

SPREAD, MARGIN = 4.5, 0.1
"""Half the range of ln beta, in standard errors, and what is added to it."""

LEAST_TAIL, MOST_TAIL, NEXT_TAIL = 12, 200, 1.5
"""Smallest and largest number of windows beyond the threshold, and the ratio of two thresholds that
are tried one after the other."""

REACHED = 1.0
"""Expected number of responses of a mission beyond the first threshold that is tried, at least."""

STEADY = 1.5
"""Change of ln beta, in standard errors of the change, up to which a higher threshold agrees."""

ENOUGH_WINDOWS = 512
"""Number of windows from which the tail is known to some per cent: sampling goes on until then, if
time allows."""

UNLIKELY = 1e-5
"""Likelihood over the largest one, below which shapes and scales are left out."""

DENSE, LEVELS, BEYOND = 41, 150, 1e4
"""Points over the law of the largest, levels beyond the threshold, and the inverse of the
probability that a mission exceeds the last of them."""

FARTHEST = 50.0
"""Last level over the expected largest."""

GROUPS = 20
"""Number of groups of paths that the jackknife leaves out in turn."""

FEWEST_PATHS = 8
"""Number of paths from which the scatter between them shows whether their windows are alike."""

TAIL_SHARE, FEWEST_BEYOND, MOST_BEYOND = 0.1, 10, 50
"""Share of clusters from which `exceedance` takes a tail, and the limits of their number."""


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

    The bias is what the unknown shape of the tail adds to the interval.

    Parameters
    ----------
    peaks
        (paths, windows, equipment): largest response in windows of independent paths.
    probabilities
        Probabilities of levels, below which the largest response stays.
    """
    count = peaks.shape[2]
    value, errors, bias = np.empty((3, count))
    levels = np.empty((len(probabilities), count))
    for i in range(count):
        value[i], errors[i], bias[i], levels[:, i] = _largest(
            peaks[:, :, i], windows, probabilities
        )
    return LargestResponses(value, errors, bias, levels)


def _largest(
    sample: NDArray[np.float64], windows: float, probabilities: Sequence[float]
) -> tuple[float, float, float, Vector]:
    """Expected largest with its error and bias, and the levels of the probabilities."""
    order = np.argsort(sample, axis=None)
    known = sample.ravel()[order]
    number = len(known)
    if known[-1] <= known[0]:  # nothing moves, or nothing scatters
        return float(known[-1]), 0.0, 0.0, np.full(len(probabilities), known[-1])
    tail = _windows_beyond(known, windows)
    threshold = float(known[number - tail - 1])
    law = _tail_of(known, tail, _clumping(sample, threshold))
    body = known[: number - tail]
    below = np.arange(1, len(body) + 1) / number
    start, start_error = _up_to(order[: len(body)], body, sample.shape, windows)
    found = start + law.mean_beyond(threshold, windows)
    # one standard deviation of L either way, whose relative variance is 1 / k
    step = math.exp(1.0 / math.sqrt(law.seen))
    more, less = (law.mean_beyond(threshold, windows * each) for each in (step, 1.0 / step))
    value = float(law.chance @ found)
    whole = float(law.chance @ ((found - value) ** 2 + 0.25 * (more - less) ** 2))
    of_shape = np.array([
        (own.sum(), own @ (found[law.shape == shape] - value))
        for shape in np.unique(law.shape)
        if (own := law.chance[law.shape == shape]).sum() > 0.0
    ])  # fmt: skip
    between = float(np.sum(of_shape[:, 1] ** 2 / of_shape[:, 0]))
    error = math.sqrt(max(whole - between, 0.0) + start_error**2)
    bias = GAUSSIAN_95 * (math.sqrt(error**2 + between) - error)
    levels = law.levels(threshold, windows, FARTHEST * value)
    kept = np.concatenate([below**windows, law.stays_below(threshold, windows, levels)])
    quantiles = np.interp(probabilities, kept, np.concatenate([body, levels]))
    return value, error, bias, quantiles


def _windows_beyond(known: Vector, windows: float) -> int:
    """Number of windows beyond the threshold, of a sorted sample."""
    number = len(known)
    tried = [min(max(MOST_TAIL, math.ceil(REACHED * number / windows)), max(number // 2, 1))]
    while tried[-1] / NEXT_TAIL >= LEAST_TAIL:
        tried.append(int(tried[-1] / NEXT_TAIL))
    squares = known[::-1] ** 2
    gumbel = -np.log(-np.log1p(-(np.arange(1, number + 1) - 0.5) / number))
    logs = np.array([
        math.log(max(float(np.sum(squares[:k] - squares[k])), np.finfo(float).tiny)
                 / float(np.sum(gumbel[:k] - gumbel[k])))
        for k in tried
    ])  # fmt: skip
    shares = 1.0 / np.array(tried)
    for place, k in enumerate(tried):
        away = np.abs(logs[place + 1 :] - logs[place])
        if np.all(away <= STEADY * np.sqrt(shares[place + 1 :] - shares[place])):
            return k
    raise AssertionError("the highest threshold agrees with itself")


def _clumping(sample: NDArray[np.float64], threshold: float) -> float:
    """Factor by which windows beyond the threshold scatter more between paths than independent
    ones do, at least 1."""
    paths, windows = sample.shape
    counts: Vector = np.sum(sample > threshold, axis=1).astype(float)
    share = float(counts.mean()) / windows
    if paths < FEWEST_PATHS or not 0.0 < share < 1.0:
        return 1.0
    scatter = float(counts.var(ddof=1))
    factor = scatter / (windows * share * (1.0 - share))
    return max(1.0, float(factor))


def _up_to(
    order: NDArray[np.int64], body: Vector, shape: tuple[int, ...], windows: float
) -> tuple[float, float]:
    """Integral of 1 - F^n up to the threshold, the largest of the body, and its standard error;
    `order` are the places of the body in the sample."""
    paths, number = shape[0], shape[0] * shape[1]
    groups = min(GROUPS, paths)
    steps = np.diff(body)

    def integral(below: NDArray[np.float64]) -> Vector:
        return np.asarray(np.sum(below[:-1] ** windows * steps[:, None], axis=0))

    below = np.arange(1, len(body) + 1)[:, None] / number
    start = float(body[-1] - integral(below)[0])
    if groups < 2 or below[-1, 0] ** windows < UNLIKELY:
        return start, 0.0
    own = (order // shape[1]) * groups // paths
    counts = np.cumsum(own[:, None] == np.arange(groups), axis=0)
    sizes = np.bincount(np.arange(paths) * groups // paths, minlength=groups) * shape[1]
    left = np.maximum(below * number - counts, 0.0) / (number - sizes)
    return start, float(jackknife_error(integral(left)))


class _Tail(NamedTuple):
    """Likely shapes and scales of a tail (values,), the probability of each, and the expected
    number L of responses beyond the threshold in a window: of Gamma's distribution with the shape
    `seen` and the rate `exposure`."""

    shape: Vector
    scale: Vector
    chance: Vector
    seen: float
    exposure: Vector

    def mean_beyond(self, threshold: float, windows: float) -> Vector:
        """Integral of 1 - F^n beyond the threshold, by shape and scale."""
        expected = windows * self.seen / self.exposure
        # of ln E, where E = n L (1 + ...)^(-1 / xi) is exponential
        last = np.minimum(np.log(expected), 4.0)
        log = -14.0 + (last + 14.0)[:, None] * np.linspace(0.0, 1.0, DENSE)
        excess = np.expm1(self.shape[:, None] * (np.log(expected)[:, None] - log))
        squares = threshold**2 + self.scale[:, None] * excess / self.shape[:, None]
        density = np.exp(log - np.exp(log))
        beyond = np.sqrt(np.maximum(squares, threshold**2)) - threshold
        return np.asarray(np.trapezoid(beyond * density, log, axis=1))

    def levels(self, threshold: float, windows: float, last: float) -> Vector:
        """Levels beyond the threshold, up to one that a mission hardly exceeds, or `last`."""
        expected = np.maximum(windows * self.seen / self.exposure, 1.0)
        squares = self.scale * np.expm1(self.shape * np.log(BEYOND * expected)) / self.shape
        top = min(math.sqrt(threshold**2 + float(squares.max())), last)
        return np.linspace(threshold, max(top, threshold * (1.0 + 1e-9)), LEVELS)

    def stays_below(self, threshold: float, windows: float, levels: Vector) -> Vector:
        """Probability that a mission stays below levels beyond the threshold."""
        ratio = self.shape / self.scale
        inner = 1.0 + ratio[:, None] * (levels**2 - threshold**2)
        with np.errstate(divide="ignore"):
            louder = np.exp(-np.log(np.maximum(inner, 0.0)) / self.shape[:, None])
        louder[inner <= 0.0] = 0.0
        stays = np.exp(-self.seen * np.log1p(windows * louder / self.exposure[:, None]))
        return np.asarray(self.chance @ stays)


def _tail_of(known: Vector, tail: int, clumping: float) -> _Tail:
    """What the last `tail` values of a sorted sample say of its tail, where so many of them count
    as one."""
    excess = known[-tail:] ** 2 - known[-tail - 1] ** 2
    width = SPREAD * math.sqrt(clumping / tail) + MARGIN
    # the mean excess is beta / (1 - xi)
    mean = max(float(excess.mean()), FLAT * float(known[-1]) ** 2)
    middle = mean * np.maximum(1.0 - SHAPES, 0.3)
    scales = middle[:, None] * np.exp(np.linspace(-width, width, SCALES))
    shape, scale = np.repeat(SHAPES, SCALES), scales.ravel()
    inner = 1.0 + (shape / scale)[:, None] * excess
    logs = np.log(np.maximum(inner, np.finfo(float).tiny))
    # L has the weight 1 / L: its distribution is Gamma's, and the rest is
    exposure = len(known) - tail + np.exp(-logs / shape[:, None]).sum(axis=1)
    likely = -tail * np.log(exposure * scale) - (1.0 + 1.0 / shape) * logs.sum(axis=1)
    likely = likely / clumping - 0.5 * (shape / SHAPE) ** 2
    likely[np.any(inner <= 0.0, axis=1)] = -np.inf
    chance = np.exp(likely - likely.max())
    kept = chance > UNLIKELY
    chance = chance[kept] / chance[kept].sum()
    return _Tail(shape[kept], scale[kept], chance, tail / clumping, exposure[kept] / clumping)


def exceedance(peaks: Vector, weight: Vector, levels: Vector, square: bool) -> Vector:
    """Share of a weighted sample beyond each level; its tail is exponential in r^2 (`square`), or
    in r."""
    order = np.argsort(peaks)
    known, shares = peaks[order], weight[order] / weight.sum()
    beyond = np.concatenate([np.cumsum(shares[::-1])[::-1], [0.0]])
    found = beyond[np.searchsorted(known, levels, side="right")]
    tail = int(np.clip(TAIL_SHARE * len(known), min(FEWEST_BEYOND, len(known) // 2), MOST_BEYOND))
    threshold, own, share = known[-tail - 1], shares[-tail:], shares[-tail:].sum()
    power = 2 if square else 1
    scale = float(own @ (known[-tail:] ** power - threshold**power)) / share
    excess = (np.maximum(levels, threshold) ** power - threshold**power) / scale
    return np.where(levels > threshold, share * np.exp(-excess), found)
