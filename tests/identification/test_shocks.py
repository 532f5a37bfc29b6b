"""Shocks that were put into ten kinds of record are found, and no others, as often as is stated."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
from scipy.ndimage import binary_dilation
from scipy.signal import lfilter
from scipy.stats import binom, poisson

import stochvi
from stochvi.identification.shocks import (
    Search,
    local_level,
    noise_memory,
    share_beyond,
    smallest_found,
)
from stochvi.results.errors import SceneError
from stochvi.scenes.records import Record

FS, SECONDS, LENGTH = 200.0, 40.0, 0.05
"""Sampling rate (Hz) and length (s) of the records, and length of a shock (s)."""

RARE = 1e-4
"""Probability with which a test of counts may fail by chance."""

CASES = pytest.mark.parametrize("cases", [12, pytest.param(200, marks=pytest.mark.verify)])
"""Number of records of a kind, in `make test` and in `make verify`."""

Vector = np.ndarray


def noise(random: np.random.Generator, seconds: float = SECONDS) -> Vector:
    """Gaussian noise from 3 to 70 Hz, falling with the frequency, of standard deviation 1."""
    count = round(seconds * FS)
    f = np.fft.rfftfreq(count, 1.0 / FS)
    size = np.where((f > 3.0) & (f < 70.0), np.maximum(f, 1.0) ** -0.25, 0.0)
    lines = size * (random.normal(size=len(f)) + 1j * random.normal(size=len(f)))
    values = np.fft.irfft(lines, count)
    return np.asarray(values / values.std())


def put_in(values: Vector, starts: Sequence[float], heights: Sequence[float]) -> Vector:
    """Half sines of `LENGTH` on a record."""
    time = np.arange(len(values)) / FS
    values = values.copy()
    for start, height in zip(starts, heights, strict=True):
        inside = (time >= start) & (time < start + LENGTH)
        values[inside] += height * np.sin(np.pi * (time[inside] - start) / LENGTH)
    return values


def places(random: np.random.Generator, number: int, apart: float = 1.0) -> list[float]:
    """Times of so many shocks that are apart."""
    room = SECONDS - 2.0 - apart * number
    return [1.0 + apart * k + each for k, each in enumerate(sorted(room * random.random(number)))]


def found_and_false(found: Search, starts: Sequence[float]) -> tuple[int, int]:
    """Number of shocks that were put in and are found, and number of events where there is none."""
    spans = [(each.first / FS - LENGTH, each.last / FS + LENGTH) for each in found.events]
    hit = [any(a <= start + 0.5 * LENGTH <= b for a, b in spans) for start in starts]
    false = [not any(a <= start + 0.5 * LENGTH <= b for start in starts) for a, b in spans]
    return sum(hit), sum(false)


def counted(
    make: Callable[[np.random.Generator], tuple[Vector, Sequence[float]]], cases: int,
    natural_frequency: float | None = None, false_alarms: float = 0.05,
) -> tuple[int, int, int]:  # fmt: skip
    """Shocks that were put into so many records, that are found, and that are false."""
    numbers = []
    for seed in range(cases):
        values, starts = make(np.random.default_rng(seed))
        found = Search(Record(values=values, fs=FS), natural_frequency, false_alarms)
        numbers.append((len(starts), *found_and_false(found, starts)))
    put, hit, false = np.sum(numbers, axis=0)
    return int(put), int(hit), int(false)


def few_false(false: int, cases: int, false_alarms: float = 0.05) -> bool:
    """Whether false shocks are no more than stated."""
    return false <= poisson.isf(RARE, false_alarms * cases)


# ---- what the threshold rests on --------------------------------------------------------------


def test_the_local_level_is_that_of_plain_windows() -> None:
    random = np.random.default_rng(3)
    values, quiet, window = random.normal(size=300), random.random(300) > 0.2, 40
    found = local_level(values, quiet, window)
    for here in (0, 5, 150, 299):
        sides = (slice(max(here - window, 0), here), slice(here + 1, here + 1 + window))
        rms = [np.sqrt(np.mean(values[s][quiet[s]] ** 2)) for s in sides if quiet[s].sum() >= 10]
        assert found[here] == pytest.approx(max(rms), rel=1e-12)


def test_the_memory_is_that_of_an_exponential_correlation() -> None:
    random, r, fs = np.random.default_rng(4), 0.8, 50.0
    exact = (1.0 + r**2) / (1.0 - r**2) / fs
    noises = random.normal(size=(40, 2**16))
    found = np.array([noise_memory(lfilter([1.0], [1.0, -r], each), fs) for each in noises])
    mean, error = found.mean(), found.std(ddof=1) / np.sqrt(len(found))
    assert mean == pytest.approx(exact, abs=4.0 * error)
    of_lags = (1.0 + r) / (1.0 - r) / fs  # without the square
    assert mean != pytest.approx(of_lags, abs=4.0 * error)


@pytest.mark.parametrize("windows", [1, 2])
def test_noise_is_beyond_a_threshold_as_often_as_stated(windows: int) -> None:
    """Pairs of neighbours of correlation 0.6, over the largest rms of independent windows."""
    random, r, degrees, threshold, count = np.random.default_rng(5), 0.6, 30, 2.5, 400_000
    first, other = random.normal(size=(2, count))
    second = r * first + np.sqrt(1.0 - r**2) * other
    level = np.sqrt(random.chisquare(degrees, size=(windows, count)).max(axis=0) / degrees)
    passed = (np.abs(first) <= threshold * level) & (np.abs(second) > threshold * level)
    # a swing through both thresholds within one step counts once here, and once there
    seen = int(np.sum(passed))
    expected = count * share_beyond(threshold, r, degrees, windows)
    low, high = poisson.ppf([RARE, 1.0 - RARE], expected)
    assert low <= seen <= high
    # the negative control: a level that is known would be passed less often
    known = count * share_beyond(threshold, r, 1e9, windows)
    assert (windows == 2) or seen > poisson.isf(RARE, known)


def test_a_shock_is_cut_with_ends_that_leave_no_step() -> None:
    values = put_in(3.0 + np.zeros(1000), [2.0], [8.0])
    found = Search(Record(values=values + noise(np.random.default_rng(1), 5.0), fs=FS), None, 0.05)
    (event,) = found.events
    part = found.cut(event)
    assert part[0] == part[-1] == 0.0 and np.max(np.abs(np.diff(part[[0, 1, -2, -1]]))) < 1.0
    inside = found.views[0].values[event.first : event.last + 1]
    margin = (len(part) - len(inside)) // 2
    assert np.array_equal(part[margin : margin + len(inside)], inside)  # its mean is kept


# ---- ten kinds of record ----------------------------------------------------------------------


@pytest.mark.slow
@CASES
@pytest.mark.parametrize("natural_frequency", [None, 12.0])
def test_noise_alone_has_as_few_shocks_as_stated(
    cases: int, natural_frequency: float | None
) -> None:
    """Without shocks. The number that is stated is a bound: the views share their alarms."""
    cases, stated = 3 * cases, 1.0
    _, _, false = counted(lambda random: (noise(random), []), cases, natural_frequency, stated)
    assert few_false(false, cases, stated)
    assert false >= poisson.ppf(RARE, 0.25 * stated * cases)  # and no blind one


@pytest.mark.slow
@CASES
@pytest.mark.parametrize("natural_frequency", [None, 12.0])
def test_nine_of_ten_of_the_smallest_shocks_are_found(
    cases: int, natural_frequency: float | None
) -> None:
    """With shocks, of the height that the answer names for their length; half of it is not seen."""
    known = Search(Record(values=noise(np.random.default_rng(99)), fs=FS), natural_frequency, 0.05)
    rows = [*smallest_found(known)]
    height = np.interp(LENGTH, *zip(*((r["length"], r["height"]) for r in rows), strict=True))

    def made(share: float) -> Callable[[np.random.Generator], tuple[Vector, list[float]]]:
        def make(random: np.random.Generator) -> tuple[Vector, list[float]]:
            starts = places(random, 5)
            return put_in(noise(random), starts, [share * height] * 5), starts

        return make

    put, hit, false = counted(made(1.0), cases, natural_frequency)
    assert hit >= binom.ppf(RARE, put, 0.85)  # the level of one record is not that of the next
    assert few_false(false, cases)
    put, hit, _ = counted(made(0.5), cases, natural_frequency)
    assert hit <= binom.isf(RARE, put, 0.3)


def few(random: np.random.Generator) -> tuple[Vector, Sequence[float]]:
    starts = places(random, 1)
    return put_in(noise(random), starts, [9.0]), starts


def many(random: np.random.Generator) -> tuple[Vector, Sequence[float]]:
    starts = places(random, 30)
    return put_in(noise(random), starts, random.choice([-9.0, 9.0], 30)), starts


def drifting(random: np.random.Generator) -> tuple[Vector, Sequence[float]]:
    values, starts = few(random)
    time = np.arange(len(values)) / FS
    return values + 5.0 * np.sin(2.0 * np.pi * 0.04 * time) + 0.3 * time, starts


def steps(random: np.random.Generator) -> tuple[Vector, Sequence[float]]:
    """Steps of the mean, which are no shocks, and of the level of the noise."""
    values, starts = noise(random), [8.0]
    values[len(values) // 2 :] *= 3.0
    values = put_in(values, starts, [9.0])
    values[round(14.0 * FS) :] += 12.0
    return values, starts


def two_heights(random: np.random.Generator) -> tuple[Vector, Sequence[float]]:
    starts = places(random, 10)
    return put_in(noise(random), starts, [8.0, 16.0] * 5), starts


def of_varying_level(random: np.random.Generator) -> tuple[Vector, Sequence[float]]:
    values = noise(random)
    time = np.arange(len(values)) / FS
    level = np.exp(0.7 * np.sin(2.0 * np.pi * time / 13.0 + 6.0 * random.random()))
    starts = places(random, 4)
    return put_in(level * values, starts, [18.0] * 4), starts


def clipped(random: np.random.Generator) -> tuple[Vector, Sequence[float]]:
    starts = places(random, 5)
    return np.clip(put_in(noise(random), starts, [12.0] * 5), -6.0, 6.0), starts


@pytest.mark.slow
@CASES
@pytest.mark.parametrize(
    "make", [few, many, drifting, steps, two_heights, of_varying_level, clipped]
)
def test_shocks_that_stand_out_are_all_found(
    make: Callable[[np.random.Generator], tuple[Vector, Sequence[float]]], cases: int
) -> None:
    put, hit, false = counted(make, cases)
    # one in a hundred may hide behind a swing of the noise
    assert put - hit <= binom.isf(RARE, put, 0.01) if cases > 100 else hit == put
    # as is assumed: the level grows fourfold within seven seconds
    assert few_false(false, cases, 0.2 if make is of_varying_level else 0.05)


def test_one_threshold_for_all_times_would_take_loud_noise_for_shocks() -> None:
    """The negative control of noise of varying level."""
    false = 0
    for seed in range(5):
        values, starts = of_varying_level(np.random.default_rng(seed))
        view = Search(Record(values=values, fs=FS), None, 0.05).views[0]
        loud = np.abs(values) > view.threshold * np.median(view.level)
        near = binary_dilation(loud, iterations=20).astype(int)
        false += int(np.sum(np.diff(near) == 1)) - len(starts)
    assert not few_false(false, 5)


@pytest.mark.parametrize(("natural_frequency", "number"), [(None, 6), (12.0, 6), (90.0, 12)])
def test_shocks_that_the_mount_feels_together_are_one(
    natural_frequency: float | None, number: int
) -> None:
    """Clusters: two axles of a truck, 0.12 s apart."""
    random = np.random.default_rng(6)
    starts = places(random, 6, 3.0)
    values = put_in(noise(random), [s + d for s in starts for d in (0.0, 0.12)], [12.0] * 12)
    if natural_frequency == 90.0:
        natural_frequency = 0.25 * FS
    found = Search(Record(values=values, fs=FS), natural_frequency, 0.05)
    assert len(found.events) == number


# ---- the answer -------------------------------------------------------------------------------


def written(path: Path, values: Vector, heading: str = "time (s),acceleration (g)") -> Path:
    rows = np.column_stack([np.arange(len(values)) / FS, values])
    np.savetxt(path, rows, delimiter=",", header=heading, comments="", fmt=["%.4f", "%.5f"])
    return path


def test_heights_rate_and_samples_are_those_of_the_record(tmp_path: Path) -> None:
    random = np.random.default_rng(7)
    values, starts = two_heights(random)
    found = stochvi.shocks(written(tmp_path / "road.csv", values))
    g = 9.80665
    heights = np.array([each.height for each in found.shocks]) / g
    assert len(heights) == 10
    assert np.all(np.abs(heights - [8.0, 16.0] * 5) < 4.0)  # the noise on them, of rms 1
    assert [round(each.start, 1) for each in found.shocks] == pytest.approx(starts, abs=0.3)
    low, high = stochvi.results.estimates.poisson_interval(10, SECONDS)
    assert (found.rate.value, found.rate_lower, found.rate_upper) == (10 / SECONDS, low, high)
    assert found.rate.standard_error == pytest.approx(np.sqrt(10.0) / SECONDS)
    assert found.noise / g == pytest.approx(1.0, abs=4.0 / np.sqrt(2.0 * 100.0 * SECONDS) + 0.02)
    assert found.hardest is not None and heights[found.hardest] > 12.0
    expected = found.peaks_expected
    assert poisson.ppf(RARE, expected) <= found.peaks <= poisson.isf(RARE, 2.0 * expected)
    # quiet samples are those of the record, without the shocks
    quiet = found.quiet.to_numpy() / [1.0, g]
    assert np.allclose(quiet[:, 1], values[np.rint(FS * quiet[:, 0]).astype(int)], atol=1e-5)
    assert np.abs(quiet[:, 1]).max() < 5.0 < np.abs(values).max()
    lengths = sum(len(each) for each in found.cuts)
    assert len(quiet) + lengths == len(values)
    assert found.cuts[found.hardest].iloc[:, 1].abs().max() == pytest.approx(
        abs(found.shocks[found.hardest].height), rel=1e-9
    )


def test_what_makes_a_count_doubtful_is_told(tmp_path: Path) -> None:
    def told(make: Callable[[np.random.Generator], tuple[Vector, Sequence[float]]]) -> str:
        values, _ = make(np.random.default_rng(2))
        return " ".join(stochvi.shocks(written(tmp_path / "run.csv", values)).warnings)

    assert told(few) == ""
    assert "wanders by" in told(drifting)
    assert "s: that is a step, and no shock" in told(steps)
    assert "cut off" in told(clipped)

    def rough(random: np.random.Generator) -> tuple[Vector, Sequence[float]]:
        return noise(random) * np.repeat(np.exp(0.6 * random.normal(size=400)), 20), []

    assert "its level changes within seconds" in told(rough)


def test_a_scene_leaves_out_a_drift(tmp_path: Path) -> None:
    values, _ = drifting(np.random.default_rng(2))
    found = stochvi.shocks(written(tmp_path / "run.csv", values))
    assert found.band_hz == (0.5, 0.5 * FS)
    found.quiet.to_csv(tmp_path / "quiet.csv", index=False)
    found.cuts[0].to_csv(tmp_path / "shock-1.csv", index=False)
    scene = tmp_path / "with-shocks.toml"
    scene.write_text(found.scene_text())
    noise_alone, pulses = stochvi.load_scene(scene).excitations
    assert isinstance(noise_alone, stochvi.RecordedNoise) and isinstance(pulses, stochvi.Pulses)
    # the drift is gone but for what the ends of segments keep of it
    assert noise_alone.as_read.rms > 3.0 * found.noise > 2.0 * noise_alone.record.rms
    assert pulses.rate == pytest.approx(found.rate.value, rel=1e-3)
    assert pulses.shock is not None
    assert pulses.shock.peak == pytest.approx(abs(found.shocks[0].height), rel=1e-9)
    kept = found.scene_text('[structure]\nkind = "isolator"\n\n[[excitation]]\nkind = "record"\n')
    assert kept.count('"record"') == 1 and kept.startswith("[structure]")


def test_a_record_without_shocks_bounds_their_rate(tmp_path: Path) -> None:
    found = stochvi.shocks(written(tmp_path / "calm.csv", noise(np.random.default_rng(8))))
    assert not found.shocks and found.rate.value == 0.0 and found.hardest is None
    assert found.rate.upper_95 == found.rate_upper == pytest.approx(-np.log(0.05) / SECONDS)
    assert "No shock in 40 s of calm.csv: at most 270 an hour" in found.summary()
    with pytest.raises(ValueError, match=r"no shock was found in calm\.csv"):
        found.scene_text()


def test_samples_that_are_missing_leave_gaps_in_the_times(tmp_path: Path) -> None:
    values, _ = two_heights(np.random.default_rng(7))
    rows = np.column_stack([np.arange(len(values)) / FS, values])
    kept = np.delete(rows, slice(400, 600), axis=0)
    file = tmp_path / "gap.csv"
    np.savetxt(file, kept, delimiter=",", header="time (s),a (g)", comments="", fmt="%.6f")
    whole = stochvi.shocks(written(tmp_path / "whole.csv", values))
    found = stochvi.shocks(file, gaps="split")
    assert np.allclose(found.samples.iloc[:, 0], kept[:, 0], atol=1e-6)
    assert [each.start for each in found.shocks] == pytest.approx(
        [each.start for each in whole.shocks], abs=0.2
    )
    with pytest.raises(SceneError, match="gap"):
        stochvi.shocks(file)


def test_what_is_no_record_with_noise_is_refused(tmp_path: Path) -> None:
    values = noise(np.random.default_rng(1))
    nameless = written(tmp_path / "none.csv", values, "time (s),channel 1")
    with pytest.raises(SceneError, match="unit"):
        stochvi.shocks(nameless)
    assert stochvi.shocks(nameless, unit="N").unit == "N"
    short = written(tmp_path / "short.csv", values[:300])
    with pytest.raises(SceneError, match=r"short\.csv is 1\.5 s long, expected at least"):
        stochvi.shocks(short, natural_frequency=4.0)
    file = written(tmp_path / "run.csv", values)
    with pytest.raises(ValueError, match="and at most a quarter of the sampling rate"):
        stochvi.shocks(file, natural_frequency=150.0)
    with pytest.raises(ValueError, match=r"false_alarms must be in \(0, 1\], got 0"):
        stochvi.shocks(file, false_alarms=0.0)
    still = np.zeros(8000)
    still[4000:4010] = 5.0
    with pytest.raises(SceneError, match="at rest between its shocks"):
        stochvi.shocks(written(tmp_path / "still.csv", still))


@pytest.mark.slow
@pytest.mark.parametrize("cases", [40, pytest.param(400, marks=pytest.mark.verify)])
def test_the_interval_of_the_rate_holds_the_true_one(cases: int, tmp_path: Path) -> None:
    rate, held = 0.15, 0
    for seed in range(cases):
        random = np.random.default_rng(seed)
        count = int(random.poisson(rate * SECONDS))
        starts = 0.5 + (SECONDS - 1.0) * random.random(count)
        values = put_in(noise(random), starts, [12.0] * count)
        found = Search(Record(values=values, fs=FS), 25.0, 0.05)
        low, high = stochvi.results.estimates.poisson_interval(len(found.events), SECONDS)
        held += low <= rate <= high
    assert held >= binom.ppf(RARE, cases, 0.94)  # shocks within 0.12 s are one
