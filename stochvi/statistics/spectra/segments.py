"""Records cut into tapered segments and transformed; their products, averaged over paths."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.fft import prev_fast_len, rfft

from stochvi.mathematics import rounding
from stochvi.mathematics.arrays import Matrix, Vector
from stochvi.methods.monte_carlo.history_plans import HistoryPlan
from stochvi.results.intervals import PathMoments

Quantity = Callable[[Matrix], Vector]

OVERLAP = 0.5
"""Share by which Hann segments overlap: more overlap hardly lowers the error."""

TIME_HALF_BANDWIDTH = 4.0
"""NW of the multitapers (D. J. Thomson 1982). Their kernel is as wide as that of a Hann segment
NW times shorter, which is the whole path here."""

TAPERS = 7
"""Number of multitapers, 2 NW - 1: the ones that leak little."""

KERNEL_BINS = {"welch": 2, "multitaper": 8}
"""Half width, in bins, of a kernel |W|^2; beyond it the kernel is neglected."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Layout:
    """The cut of records into segments of a `size` by a method: starts of segments, kept bins."""

    method: str
    size: int
    starts: tuple[int, ...]
    step: float
    bins: slice

    @cached_property
    def tapers(self) -> Matrix:
        """(tapers, samples of a segment)."""
        if self.method == "welch":
            turn = 2.0 * np.pi * np.arange(self.size)[None] / self.size
            tapers = 0.5 - 0.5 * np.cos(turn)
        else:
            from scipy.signal.windows import dpss  # half a second to import

            tapers = dpss(self.size, TIME_HALF_BANDWIDTH, TAPERS, sym=False)
        return np.asarray(tapers / np.sqrt(np.sum(tapers**2, axis=1, keepdims=True)))

    @cached_property
    def kernel(self) -> Vector:
        """|W|^2 at whole bins, which add up to one."""
        half = KERNEL_BINS[self.method]
        near = np.arange(-half, half + 1)
        turns = np.exp(-2j * np.pi / self.size * np.outer(near, np.arange(self.size)))
        kernel = np.mean(np.abs(self.tapers @ turns.T) ** 2, axis=0)
        return np.asarray(kernel / kernel.sum())

    @property
    def frequency_hz(self) -> Vector:
        """Frequencies of the kept bins, Hz."""
        df = 1.0 / (self.size * self.step)
        return np.asarray(df * np.arange(self.bins.start, self.bins.stop))


def moments_of(products: NDArray[np.float64]) -> PathMoments:
    """Moments of the products of each path, (paths, rows, bins)."""
    mean = products.mean(axis=0)
    away = products - mean
    return PathMoments(
        count=len(products), mean=mean, scatter=np.einsum("prf,psf->rsf", away, away)
    )


def layout_of(plan: HistoryPlan, method: str, length: float, top: float) -> Layout:
    samples, starts = plan.samples, (0,)
    size = samples
    if method == "welch":
        size = min(samples, prev_fast_len(round(length / plan.step)))
        hop = max(1, round(size * (1.0 - OVERLAP)))
        starts = (*range(0, samples - size + 1, hop),)
    beside = 2 * KERNEL_BINS[method]
    last = min(rounding.ceil(top * size * plan.step), size // 2 - beside)
    bins = slice(1, last + beside + 1)
    return Layout(method=method, size=size, starts=starts, step=plan.step, bins=bins)


def products(records: NDArray[np.float64], layout: Layout) -> NDArray[np.float64]:
    """Densities of records (channels, paths, samples): (paths, rows, bins), one-sided per hertz.

    Rows are the densities of the channels, then real and imaginary part of each pair i < j of
    conj(X_i) X_j, in turn; means over segments and tapers, each segment less its mean.
    """
    size = layout.size
    channels, paths, _ = records.shape
    pairs = [(i, j) for i in range(channels) for j in range(i + 1, channels)]
    bins = layout.bins.stop - layout.bins.start
    found = np.zeros((paths, channels + 2 * len(pairs), bins))
    for start in layout.starts:
        piece = records[:, :, start : start + size]
        piece = piece - piece.mean(axis=-1, keepdims=True)
        for taper in layout.tapers:
            z = rfft(piece * taper, axis=-1)[:, :, layout.bins]
            for i in range(channels):
                found[:, i] += np.abs(z[i]) ** 2
            for k, (i, j) in enumerate(pairs):
                product = np.conj(z[i]) * z[j]
                found[:, channels + 2 * k] += product.real
                found[:, channels + 2 * k + 1] += product.imag
    found *= 2.0 * layout.step / (len(layout.starts) * len(layout.tapers))
    return found
