"""Noise with fast peaks: its kurtosis and its density are those asked for; pyExSi and theorems
judge."""

from __future__ import annotations

import importlib.util
import math
from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.fft import irfft, rfft
from scipy.signal import welch

from stochvi import TabulatedNoise
from stochvi.mathematics.fast_peaks import (
    MOST_CUBIC,
    FastPeaks,
    Hermite,
    PeakedRecords,
    UnreachableKurtosis,
)
from stochvi.mathematics.spectra import Table

Array = NDArray[np.float64]

FLAT = Table(frequency_hz=np.array([20.0, 2000.0]), density=np.full(2, 1.0 / 1980.0))
BOUNDED = "mil-std-810h-truck-vertical-5hz", "navmat-p-9492", "gevs-qualification"


def kurtosis_of(records: Array) -> tuple[float, float]:
    """Kurtosis of records (samples, records), and its standard error."""
    each = np.mean(records**4, axis=0) / np.mean(records**2) ** 2
    return float(each.mean()), float(each.std(ddof=1) / math.sqrt(len(each)))


def test_the_cubic_of_a_gaussian_has_its_kurtosis() -> None:
    nodes, weights = np.polynomial.hermite_e.hermegauss(40)
    weights = weights / weights.sum()
    for kurtosis in (3.0, 3.5, 5.0, 9.0):
        x = Hermite.of(kurtosis)(nodes)
        assert weights @ x**2 == pytest.approx(1.0, rel=1e-10)
        assert weights @ x**4 == pytest.approx(kurtosis, rel=1e-10)


@pytest.mark.slow
@pytest.mark.parametrize("kurtosis", [3.5, 5.0, 8.0])
@pytest.mark.parametrize("profile", BOUNDED)
def test_kurtosis_in_is_kurtosis_out(profile: str, kurtosis: float) -> None:
    """Within 1 %, for records of another length than those from which the cubic was found. The
    same cubic before the filter, whose kurtosis is known, takes most of the noise off."""
    peaks = FastPeaks(TabulatedNoise(profile=profile).table, kurtosis)
    records, random = peaks.over(4.0), np.random.default_rng(7)
    before, after, plain = [], [], []
    for _ in range(10):
        u = records.gaussian(random, 8)
        raw = u + records.cubic * (u**3 - 3.0 * u)
        kept = irfft(records.filter[:, None] * rfft(raw, axis=0)[: records.count],
                     records.samples, axis=0)  # fmt: skip
        before += list(np.mean(raw**4, axis=0) / (1.0 + 6.0 * records.cubic**2) ** 2)
        after += list(np.mean(kept**4, axis=0) / records.variances.sum() ** 2)
        plain += list(np.mean(u**4, axis=0))
    slope = np.cov(before, after)[0, 1] / np.var(before, ddof=1)
    each = np.array(after) - slope * (np.array(before) - Hermite(records.cubic).kurtosis)
    error = each.std(ddof=1) / math.sqrt(len(each))
    assert error < 0.01 * kurtosis
    assert abs(each.mean() - kurtosis) < 0.01 * kurtosis + 3.0 * error
    # the control: noise without the cubic
    assert abs(np.mean(plain) - kurtosis) > 0.01 * kurtosis + 3.0 * error


@pytest.mark.slow
@pytest.mark.parametrize("profile", BOUNDED)
def test_the_density_is_that_of_the_table(profile: str) -> None:
    """Within 2 % in every tenth of the band, by Welch's method; a cubic alone has other ones."""
    table = TabulatedNoise(profile=profile).table
    peaks, high = FastPeaks(table, 8.0), float(table.frequency_hz[-1])
    records = peaks.over(4096.0 / high)
    fs = records.samples / records.length

    def ratios(signal: Array) -> Array:
        f, density = welch(signal, fs, nperseg=4096, axis=0)
        edges = np.linspace(table.frequency_hz[0] * 1.05, 0.98 * high, 11)
        bands = [(f > a) & (f < b) for a, b in pairwise(edges)]
        return np.array([density[band].sum(axis=0) / table(f[band]).sum() for band in bands])

    random = np.random.default_rng(3)
    raw, kept = [], []
    for _ in range(20):
        u = records.gaussian(random, 8)
        bins = rfft(u + records.cubic * (u**3 - 3.0 * u), axis=0)[: records.count]
        grown = math.sqrt(records.variances.sum() / (1.0 + 6.0 * records.cubic**2))
        raw.append(ratios(irfft(grown * bins, records.samples, axis=0)))
        kept.append(ratios(irfft(records.filter[:, None] * bins, records.samples, axis=0)))
    found, control = np.concatenate(kept, axis=1), np.concatenate(raw, axis=1)
    error = found.std(axis=1, ddof=1) / math.sqrt(found.shape[1])
    assert np.all(np.abs(found.mean(axis=1) - 1.0) < 0.02 + 4.5 * error)
    assert np.any(np.abs(control.mean(axis=1) - 1.0) > 0.02 + 4.5 * error)


def test_pyexsi_makes_the_same_noise_but_for_the_filter() -> None:
    """Kurtosis of a mount's response to its cubic, with the same filter and without; pyExSi leaves
    the density changed, and its kurtosis is that of an approximate formula."""
    if importlib.util.find_spec("pyExSi") is None:
        pytest.skip("pyExSi is not installed (pip install 'stochvi[bench]')")
    import pyExSi

    h, length, number = 1.0 / 18.0, 8.192, 160
    kurtosis = 3.0 + ((18.0 * h + 1.0) ** 2 - 1.0) / 1.5  # pyExSi then takes the cubic h
    own = PeakedRecords(FLAT, length, h)
    fs, samples = 8000.0, round(8000.0 * length)
    f = np.arange(samples // 2 + 1) / length
    random = np.random.default_rng(11)
    theirs = np.array([
        pyExSi.stationary_nongaussian_signal(
            samples, pyExSi.get_psd(f, 20.0, 2000.0), fs, k_u=kurtosis, rg=random
        )
        for _ in range(number)
    ]).T  # fmt: skip
    w = 2.0 * math.pi * f
    mount = 1.0 / (200.0**2 * math.pi**2 - w**2 + 0.6j * 200.0 * math.pi * w)
    band = np.zeros(len(f))
    band[: own.count] = own.filter
    moved = irfft((mount * band)[:, None] * rfft(theirs, axis=0), samples, axis=0)
    ours = irfft(mount[: own.count, None] * own.bins(random, number), own.samples, axis=0)
    (kept, error), (found, own_error) = kurtosis_of(moved), kurtosis_of(ours)
    assert abs(found - kept) < 4.5 * math.hypot(error, own_error)
    assert found - 3.0 > 3.0 * own_error
    # the noise itself keeps 5.2 of pyExSi before the filter, 4.25 behind it
    known, its_error = kurtosis_of(theirs)
    assert abs(known - Hermite(h).kurtosis) < 4.5 * its_error
    both = kurtosis_of(irfft(band[:, None] * rfft(theirs, axis=0), samples, axis=0))
    alike = kurtosis_of(irfft(own.bins(random, number), own.samples, axis=0))
    assert abs(both[0] - alike[0]) < 4.5 * math.hypot(both[1], alike[1])
    assert known - both[0] > 0.8


def test_a_kurtosis_that_no_cubic_reaches_is_refused() -> None:
    narrow = Table(frequency_hz=np.array([50.0, 52.0]), density=np.ones(2))
    assert 0.0 < FastPeaks(FLAT, 8.0).cubic < MOST_CUBIC
    with pytest.raises(UnreachableKurtosis, match="kurtosis must be at most"):
        _ = FastPeaks(narrow, 20.0).cubic
