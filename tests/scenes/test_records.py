"""Measured records: their density, its worth for a mount, and what may be wrong with them."""

from __future__ import annotations

import math
import re
import signal
import time
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.io import savemat

from stochvi import (
    RecordedNoise,
    SceneError,
    Sine,
    TabulatedNoise,
    damage,
    history,
    linearise,
    replay,
    screen,
)
from stochvi.cli import main
from stochvi.mathematics.spectra import MOST_BREAKPOINTS, response_moments
from stochvi.results.deadline import Deadline, of_command
from stochvi.results.errors import Interrupted, NotConverged
from stochvi.results.estimates import Estimate
from stochvi.scenes.readers import TIME_RESPONSE
from stochvi.scenes.records import Record, read_record, response_error, wanted_resolution
from stochvi.scenes.scene import load_scene
from stochvi.testing import assert_agrees
from support.accuracies import assert_differs
from support.records import write_uff

pytestmark = pytest.mark.usefixtures("read_here")

FS, DENSITY = 400.0, 0.5
OMEGA = 2.0 * math.pi * 12.0
DAMPING_RATE = 0.2 * OMEGA


def white_record(seconds: float, seed: int = 1) -> Record:
    """Of one-sided density DENSITY up to half the sampling rate."""
    count = round(seconds * FS)
    values = np.random.default_rng(seed).normal(0.0, math.sqrt(DENSITY * FS / 2.0), count)
    return Record(values=values - values.mean(), fs=FS)


def write_text(path: Path, record: Record, times: bool = True) -> Path:
    columns = [np.arange(len(record.values)) / record.fs] if times else []
    np.savetxt(path, np.column_stack([*columns, record.values]), delimiter=",")
    return path


def test_the_area_of_the_density_is_the_mean_square() -> None:
    record = white_record(120.0)
    area = record.density(0.5).table.mean_square()
    # the mean square of a white record scatters by sqrt(2 / N)
    truth = DENSITY * FS / 2.0
    error = truth * math.sqrt(2.0 / len(record.values))
    assert_agrees(Estimate(value=record.rms**2, standard_error=error), truth)
    # the first half bin and the logarithms between scattered bins take a little
    estimate = record.density(0.5)
    lost = 0.5 * estimate.resolution_hz / (FS / 2.0) + estimate.relative_error**2 / 6.0
    assert_agrees(Estimate(value=area, standard_error=error, bias=2.0 * lost * truth), truth)


def test_a_fitted_rate_that_is_off_by_rounding_gives_the_same_segments() -> None:
    values = np.random.default_rng(3).normal(size=8000)
    exact = Record(values=values, fs=200.0).density(0.4)
    for factor in (1.0 - 1e-9, 1.0 + 1e-9):
        fitted = Record(values=values, fs=200.0 * factor).density(0.4)
        assert fitted.segments == exact.segments == 31
        np.testing.assert_allclose(fitted.table.density, exact.table.density, rtol=1e-6)


def test_the_mean_density_is_the_true_one_and_twice_it_is_refused() -> None:
    estimate = white_record(120.0, seed=2).density(0.5)
    values = estimate.table.density[:-1]
    # Hann bins are correlated over one neighbour: 1.5 bins count as one
    error = DENSITY * estimate.relative_error * math.sqrt(1.5 / len(values))
    found = Estimate(value=float(values.mean()), standard_error=error)
    assert_agrees(found, DENSITY)
    assert_differs(found, 2.0 * DENSITY)


def test_one_bin_scatters_as_is_stated() -> None:
    bins = [white_record(30.0, seed).density(0.5) for seed in range(40)]
    values = np.array([estimate.table.density[5:-5] for estimate in bins])
    scatter = values.std(axis=0, ddof=1).mean() / DENSITY
    # of a standard deviation over 40 records, averaged over the bins that are independent
    error = scatter / math.sqrt(2.0 * 39.0 * values.shape[1] / 1.5)
    assert_agrees(
        Estimate(value=scatter, standard_error=error, bias=0.02 * scatter), bins[0].relative_error
    )


def test_the_response_error_is_what_the_scatter_of_records_is() -> None:
    bins = white_record(60.0).resolution(OMEGA, DAMPING_RATE)
    squares, stated = [], []
    for seed in range(60):
        record = white_record(60.0, seed)
        table = record.density(bins).table
        squares.append(response_moments([table], OMEGA, DAMPING_RATE).displacement)
        stated.append(response_error(record, bins, OMEGA, DAMPING_RATE)[0])
    truth = DENSITY / (4.0 * DAMPING_RATE * OMEGA**2)
    scatter = np.std(squares, ddof=1) / truth
    error = scatter / math.sqrt(2.0 * 59.0)
    assert_agrees(Estimate(value=float(scatter), standard_error=error), float(np.mean(stated)))
    mean = Estimate(
        value=float(np.mean(squares)), standard_error=float(np.std(squares) / math.sqrt(60.0)),
        # what lies outside the table, and the logarithms between scattered bins
        bias=truth * (1.0 / (6.0 * 40.0)),
    )  # fmt: skip
    assert_agrees(mean, truth)


def test_a_fine_enough_window_has_no_bias_that_matters_and_a_coarse_one_does() -> None:
    """A record with a sharp peak: coarse bins flatten it."""
    record = white_record(200.0, seed=3)
    frequency = np.fft.rfftfreq(len(record.values), 1.0 / FS)
    gain = 1.0 / np.abs(1.0 - (frequency / 12.0) ** 2 + 2j * 0.02 * frequency / 12.0)
    peaked = Record(values=np.fft.irfft(np.fft.rfft(record.values) * gain), fs=FS)
    wanted = wanted_resolution(OMEGA, 0.02 * OMEGA)
    area = {
        bins: response_moments([peaked.density(bins).table], OMEGA, 0.02 * OMEGA).displacement
        for bins in (0.25 * wanted, wanted, 8.0 * wanted)
    }
    finest, fine, coarse = area.values()
    error, bias = response_error(peaked, wanted, OMEGA, 0.02 * OMEGA)
    assert abs(fine / finest - 1.0) < error and abs(bias) < error
    stated = response_error(peaked, 8.0 * wanted, OMEGA, 0.02 * OMEGA)[1]
    assert coarse / finest - 1.0 < -error
    # what is flat already loses less when it is smeared once more
    assert coarse / finest - 1.0 < stated < -abs(bias)


def test_segments_suit_the_mount_where_the_record_is_long_enough() -> None:
    long, short = white_record(600.0), white_record(5.0)
    bandwidth = DAMPING_RATE / (2.0 * math.pi)
    assert long.resolution(OMEGA, DAMPING_RATE) == pytest.approx(bandwidth / 6.0)
    assert short.resolution(OMEGA, DAMPING_RATE) == pytest.approx(8.0 / 5.0)
    assert long.resolution() == pytest.approx(8.0 / 600.0)


def test_kurtosis_tells_gaussian_from_bursts() -> None:
    record = white_record(60.0)
    assert_agrees(Estimate(value=record.kurtosis()[0], standard_error=record.kurtosis()[1]), 3.0)
    bursts = record.values * np.where(np.arange(len(record.values)) % 4000 < 400, 4.0, 1.0)
    value, error = Record(values=bursts, fs=FS).kurtosis()
    # amplitudes 4 and 1 in the ratio 1 : 9
    truth = 3.0 * (0.1 * 256.0 + 0.9) / (0.1 * 16.0 + 0.9) ** 2
    assert_agrees(Estimate(value=value, standard_error=error), truth)
    assert_differs(Estimate(value=value, standard_error=error), 3.0)


@pytest.mark.parametrize("kind", ["times", "fs", "uff", "mat"])
def test_a_record_is_the_same_from_every_file(tmp_path: Path, kind: str) -> None:
    record = white_record(10.0)
    keys: dict[str, object] = {"unit": "m/s2"}
    path = tmp_path / f"run.{kind if kind in ('uff', 'mat') else 'csv'}"
    time = np.arange(len(record.values)) / FS
    if kind == "uff":
        write_uff(path, (TIME_RESPONSE, "floor", time, record.values, "m/s^2"))
        keys = {}
    elif kind == "mat":
        savemat(path, {"t": time, "a": record.values})
    else:
        write_text(path, record, times=kind == "times")
        keys |= {"fs": FS} if kind == "fs" else {}
    found = RecordedNoise(file=str(path), **keys)
    np.testing.assert_allclose(found.record.values, record.values, atol=1e-9 * record.rms)
    # a UFF file prints its uneven abscissa with six digits
    assert found.record.fs == pytest.approx(FS, rel=1e-6)
    assert found.density_unit == "(m/s2)2/Hz"


def test_a_record_in_a_scene_file_shakes_the_mount(tmp_path: Path) -> None:
    record = white_record(120.0, seed=4)
    write_text(tmp_path / "run.csv", Record(values=record.values / 9.80665, fs=FS))
    (tmp_path / "scene.toml").write_text(
        '[structure]\nkind = "isolator"\nfrequency_hz = 12.0\nzeta = 0.1\n'
        '[[excitation]]\nkind = "record"\nfile = "run.csv"\nunit = "g"\nlevel_db = 6.0\n'
    )
    scene = load_scene(tmp_path / "scene.toml")
    error, _ = response_error(record, 0.4, OMEGA, DAMPING_RATE)
    found = screen(scene).displacement_std ** 2
    truth = 10.0**0.6 * DENSITY / (4.0 * DAMPING_RATE * OMEGA**2)
    assert_agrees(Estimate(value=found, standard_error=error * truth, bias=0.005 * truth), truth)
    told = " ".join(scene.assumptions())
    for words in ("120 s at 400 Hz", "kurtosis", "segments"):
        assert words in told
    (caution,) = screen(scene).notes
    assert f"a standard error of {50.0 * error:.2g} % to" in caution
    assert "larger peaks" not in told and "short for this mount" not in told
    assert scene.effects() == ("measured record on base",)


def test_a_record_says_where_it_is_short_or_has_large_peaks(tmp_path: Path) -> None:
    record = white_record(5.0)
    values = record.values * np.where(np.arange(len(record.values)) % 500 < 50, 5.0, 1.0)
    write_text(tmp_path / "run.csv", Record(values=values, fs=FS))
    noise = RecordedNoise(file=str(tmp_path / "run.csv"), unit="m/s2")
    told = " ".join(noise.cautions(OMEGA, DAMPING_RATE))
    assert "larger peaks" in told and "the record is short for this mount" in told


def test_a_record_that_is_sampled_far_below_the_resonance_says_so(tmp_path: Path) -> None:
    """As that of a table of a density that is taken for a record: a window of the mount would have
    no sample."""
    np.savetxt(tmp_path / "run.csv", white_record(20.0).values)
    noise = RecordedNoise(file=str(tmp_path / "run.csv"), unit="m/s2", fs=1.0)
    assert noise.table_for(OMEGA, DAMPING_RATE).frequency_hz[-1] == 0.5
    told = " ".join(noise.cautions(OMEGA, DAMPING_RATE))
    assert "sampled at 1 Hz and holds nothing at the natural frequency, 12 Hz" in told


def test_a_record_is_not_read_again_for_another_level(tmp_path: Path) -> None:
    """The cases of a sizing are of five levels, and a record may take seconds to read."""
    file = write_text(tmp_path / "record.csv", white_record(20.0))
    quiet = RecordedNoise(file=str(file), unit="m/s2", level_db=1.0)
    read_again = RecordedNoise(file=str(file), unit="m/s2", level_db=7.0)
    file.unlink()
    loud = quiet.louder(6.0)
    assert loud == read_again and loud.level_db == 7.0
    np.testing.assert_array_equal(loud.table.density, read_again.table.density)
    np.testing.assert_array_equal(loud.record.values, read_again.record.values)
    assert quiet.record.rms < loud.record.rms


@pytest.mark.parametrize("interval", [0.1, 0.3, 0.007, 1.0 / 3.0])
@pytest.mark.parametrize("rate", [100.0, 200.0, 400.0, 819.2, 1000.0, 44100.0, 51200.0])
def test_times_that_hold_a_rate_give_exactly_it(tmp_path, rate, interval) -> None:
    # a fit by dot products is off in its last digits, in others on another processor
    start, count = interval * rate, min(round(4.0 * rate), 10_000)
    times = start + np.arange(count) / rate
    values = np.random.default_rng(2).normal(size=count)
    path = tmp_path / "run.csv"
    np.savetxt(path, np.column_stack([times, values]), delimiter=",")
    record, _ = read_record(path)
    assert record.fs == rate


def test_a_rate_without_a_short_number_stays_as_fitted(tmp_path: Path) -> None:
    rate = 1234.56789
    times = np.arange(4000) / rate
    np.savetxt(tmp_path / "run.csv", np.column_stack([times, np.sin(times)]), delimiter=",")
    record, _ = read_record(tmp_path / "run.csv")
    assert record.fs == pytest.approx(rate, rel=1e-12)


def test_variables_of_a_file_may_be_named_in_any_sequence(tmp_path: Path) -> None:
    """As its message writes them, in brackets."""
    values = np.sin(np.arange(300.0))
    savemat(tmp_path / "run.mat", {"t": np.arange(300.0) / 100.0, "a": values, "b": 2.0 * values})
    for names in (["t", "b"], ("t", "b")):
        record, _ = read_record(tmp_path / "run.mat", variables=names)
        assert record.peak == pytest.approx(2.0 * np.abs(values - values.mean()).max(), rel=1e-3)
    for keys, message in (
        ({"variables": np.zeros((2, 2))}, "variables must be a list of texts, got an array"),
        ({"column": [1]}, r"column must be a name or a whole number, got \[1\]"),
    ):
        with pytest.raises(ValueError, match=message):
            read_record(tmp_path / "run.mat", **keys)


def test_a_band_cuts_the_density(tmp_path: Path) -> None:
    path = str(write_text(tmp_path / "run.csv", white_record(10.0)))
    noise = RecordedNoise(file=path, unit="m/s2", band_hz=[5.0, 50.0], resolution_hz=1.0)
    assert noise.table.frequency_hz.tolist() == [float(f) for f in range(5, 51)]
    with pytest.raises(SceneError, match=r"has band_hz = \[500, 600\], but the record reaches"):
        RecordedNoise(file=path, unit="m/s2", band_hz=[500.0, 600.0])
    with pytest.raises(SceneError, match=r"band_hz must rise, got \[50, 5\]"):
        RecordedNoise(file=path, unit="m/s2", band_hz=[50.0, 5.0])


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (lambda t, a: (t, a[:100]), "holds 100 samples, expected at least 256"),
        (lambda t, a: (t, np.where(t == t[7], np.nan, a)), "has a gap (0.0025 s at 0.0175 s)"),
        (lambda t, a: (t, 0.0 * a + 3.0), "holds a record whose values are all equal"),
        (lambda t, a: (t[::-1], a), "must have rising times in its first column"),
        (lambda t, a: (np.delete(t, 500), np.delete(a, 500)), "has a gap (0.0025 s at 1.25 s)"),
        (
            lambda t, a: (np.where(t == t[7], t[6], t), a),
            "line 8: times of an uneven clock must rise, got 0.015 s twice",
        ),
    ],
    ids=["short", "nan", "still", "backwards", "a sample missing", "one time twice"],
)
def test_a_bad_record_gives_a_sentence(tmp_path: Path, change, sentence: str) -> None:
    record = white_record(10.0)
    time, values = change(np.arange(len(record.values)) / FS, record.values)
    time = time[: len(values)]
    np.savetxt(tmp_path / "run.csv", np.column_stack([time, values]))
    with pytest.raises(SceneError) as failure:
        RecordedNoise(file=str(tmp_path / "run.csv"), unit="m/s2")
    ((key, text),) = failure.value.problems
    assert key == "file" and sentence in text and "run.csv" in text


def test_a_record_without_a_unit_is_asked_for_one(tmp_path: Path) -> None:
    path = str(write_text(tmp_path / "run.csv", white_record(10.0)))
    with pytest.raises(SceneError, match="needs unit, one of g, m/s2, N, got none"):
        RecordedNoise(file=path)
    with pytest.raises(SceneError, match=r"= 1000, expected 0\.1 to 25 Hz"):
        RecordedNoise(file=path, unit="g", resolution_hz=1000.0)


def test_every_answer_from_a_record_that_is_cut_off_says_so(tmp_path: Path) -> None:
    values = white_record(60.0).values
    text = (
        '[structure]\nkind = "isolator"\nfrequency_hz = 12.0\nzeta = 0.1\n'
        '[[excitation]]\nkind = "record"\nfile = "run.csv"\nunit = "m/s2"\nfs = 400.0\n'
    )
    (tmp_path / "scene.toml").write_text(text)
    for limit in (2.0 * values.std(), math.inf):
        np.savetxt(tmp_path / "run.csv", np.clip(values, -limit, limit))
        scene = load_scene(tmp_path / "scene.toml")
        beside = scene.replace(
            excitations=[*scene.excitations, Sine(on="base", amplitude=1.0, frequency_hz=30.0)]
        )
        for notes in (
            screen(scene).notes,
            replay(scene).warnings,
            linearise(scene).warnings,
            linearise(beside).warnings,
            damage(scene, equipment=np.array([30.0]), way="record").warnings,
            history(scene, duration=1.0).warnings,
        ):
            assert any("is cut off at its largest" in note for note in notes) == (limit < 1e9)
        ask = ["sweep", str(tmp_path / "scene.toml"), "--vary", "structure.zeta=0.1:0.2:2"]
        done = CliRunner().invoke(main, [*ask, "--method", "replay"])
        assert done.exit_code == 0 and ("is cut off at its" in done.stderr) == (limit < 1e9)


# files of loggers ---------------------------------------------------------------------------


def write_rows(path: Path, times: list[str], *columns: np.ndarray, heading: str = "") -> str:
    rows = zip(times, *columns, strict=True)
    path.write_text(heading + "".join(",".join(map(str, row)) + "\n" for row in rows))
    return str(path)


@pytest.mark.parametrize("rounding", [np.round, np.floor], ids=["rounded", "cut off"])
@pytest.mark.parametrize("rate", [400.0, 512.0, 1000.0, 1997.0, 3000.0])
def test_the_rate_is_found_from_times_of_whole_milliseconds(tmp_path, rate, rounding) -> None:
    record = white_record(10.0)
    exact = np.arange(len(record.values)) / rate
    times = [f"{time / 1e3:.3f}" for time in rounding(1e3 * exact + 1e-9)]
    path = write_rows(tmp_path / "run.csv", times, record.values)
    found = RecordedNoise(file=path, unit="g").record
    # the slope of N times that are off by up to 0.5 ms, at worst one half early, one half late
    assert abs(found.fs / rate - 1.0) < 1.5e-3 / exact[-1]
    assert found.segments[0] is not found.values and len(found.segments) == 1


@pytest.mark.parametrize("start", [9.0, 99.0, 999.5])
def test_six_digits_in_all_are_no_gaps_where_times_pass_a_power_of_ten(tmp_path, start) -> None:
    record = white_record(5.0)
    rate = 800.0
    exact = start + np.arange(len(record.values)) / rate
    path = write_rows(tmp_path / "run.csv", [f"{t:.6g}" for t in exact], record.values)
    found = RecordedNoise(file=path, unit="m/s2").record
    assert found.gaps == () and not found.interpolated
    assert len(found.values) == len(record.values)
    coarsest = 10.0 ** (math.floor(math.log10(exact[-1])) - 5)
    assert abs(found.fs / rate - 1.0) < 1.5 * coarsest / np.ptp(exact)
    split = RecordedNoise(file=path, unit="m/s2", gaps="split").record
    assert split.gaps == () and len(split.segments) == 1
    # samples that are missing are gaps as before: more than the digits of their times can hide
    lost = slice(300, 300 + math.ceil(3.0 * coarsest * rate) + 3)
    times = np.delete(exact, lost)
    path = write_rows(
        tmp_path / "run.csv", [f"{t:.6g}" for t in times], np.delete(record.values, lost)
    )
    with pytest.raises(SceneError, match=r"has a gap|times of an uneven clock"):
        RecordedNoise(file=path, unit="m/s2")


@pytest.mark.parametrize("form", [lambda t: f"{t:.6f}", str, lambda t: f"{t:.9g}"])
@pytest.mark.parametrize("start", [0.0, 1000.0, 50_000.0])
def test_times_in_single_precision_give_the_rate(tmp_path: Path, start: float, form) -> None:
    record = white_record(10.0)
    exact = start + np.arange(len(record.values)) / 800.0
    times = [form(t) for t in exact.astype(np.float32)]
    found = RecordedNoise(
        file=write_rows(tmp_path / "run.csv", times, record.values), unit="m/s2"
    ).record
    assert found.gaps == () and not found.interpolated
    assert len(found.values) == len(record.values)
    spacing = float(np.spacing(np.float32(exact[-1])))
    assert abs(found.fs / 800.0 - 1.0) < 1.5 * spacing / np.ptp(exact) + 1e-6


def clock_of_a_logger(kind: str) -> np.ndarray:
    """25 s at 400 Hz: times to a microsecond, with what real clocks do to them."""
    even = np.arange(10_000) / FS
    if kind == "jitter":
        return even + np.random.default_rng(3).uniform(-0.2, 0.2, len(even)) / FS
    if kind == "packets":  # the first step of each packet is a quarter too short
        return even - 0.25 / FS * (np.arange(len(even)) // 250)
    # ten samples off an even grid
    return even + 10.0 / FS * np.sin(np.pi * even / even[-1]) ** 2


def test_an_uneven_clock_gives_the_record_on_an_even_grid(tmp_path: Path) -> None:
    def moved(t: np.ndarray) -> np.ndarray:
        return sum(np.sin(2.0 * np.pi * f * t + f) for f in (3.0, 12.0, 31.0))

    for kind in ("jitter", "packets", "drift"):
        times = clock_of_a_logger(kind)
        path = write_rows(tmp_path / "run.csv", [f"{t:.6f}" for t in times], moved(times))
        noise = RecordedNoise(file=path, unit="m/s2")
        found = noise.record
        grid = np.arange(len(found.values)) / found.fs
        truth = moved(grid + times[0])
        # h^4 / 384 of the fourth derivative, and half a microsecond times the slope
        step = np.diff(times).max()
        wrong = step**4 / 384.0 * (2.0 * np.pi * 31.0) ** 4 * 3.0 + 0.5e-6 * 2.0 * np.pi * 46.0
        inside = slice(100, -100)  # the ends of a spline are less good
        off = np.abs(found.values - (truth - truth.mean()))[inside]
        assert off.max() < 2.0 * wrong, kind
        # the same values, taken as even, are not the record
        ignored = np.interp(grid, np.arange(len(times)) / found.fs, moved(times))
        assert np.abs(ignored - truth)[inside].max() > 20.0 * wrong
        assert len(found.segments) == 1 and abs(grid[-1] - (times[-1] - times[0])) < 1.0 / FS
        # a note of every answer, thus in the terminal too
        assert any("off an even grid" in each for each in noise.cautions(0.0, 0.0))


@pytest.mark.parametrize("share", [0.2, 0.5, 0.8])
@pytest.mark.parametrize("rates", [(400.0, 200.0), (200.0, 400.0), (1000.0, 700.0)])
@pytest.mark.parametrize("decimals", [3, 9])
@pytest.mark.parametrize("gaps", ["refuse", "split"])
def test_a_rate_that_changes_is_told_and_refused(tmp_path, share, rates, decimals, gaps) -> None:
    count = int(6000 * share)
    before = np.arange(count) / rates[0]
    times = np.append(before, before[-1] + np.arange(1, 6001 - count) / rates[1])
    values = np.random.default_rng(1).normal(size=6000)
    np.savetxt(tmp_path / "run.csv", np.column_stack([np.round(times, decimals), values]))
    with pytest.raises(SceneError, match=r"changes its sampling rate, from \S+ to") as refused:
        read_record(tmp_path / "run.csv", gaps=gaps)
    found = [float(each) for each in re.findall(r"[\d.e+]+(?= to| Hz| s;)", str(refused.value))]
    np.testing.assert_allclose(found, [*rates, before[-1]], rtol=0.02, atol=0.05)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("kind", ["jitter", "steps", "drift", "lost", "bursts"])
def test_a_clock_that_is_not_even_keeps_one_rate(tmp_path, kind: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    times, kept = np.arange(20_000) / 400.0, np.full(20_000, True)
    if kind == "jitter":
        times = times + 0.0025 * rng.uniform(-0.4, 0.4, len(times))
    elif kind == "steps":
        times = np.cumsum(0.0025 * rng.uniform(0.6, 1.4, len(times)))
    elif kind == "drift":
        times = times * (1.0 + 3e-4 * times)
    elif kind == "lost":
        kept = rng.random(len(times)) > 0.1
    else:  # a part that lost half of its samples, one by one
        kept[5000:9000] = rng.random(4000) > 0.4
    np.savetxt(tmp_path / "run.csv", np.column_stack([times, rng.normal(size=len(times))])[kept])
    assert read_record(tmp_path / "run.csv", gaps="split")[0].fs == pytest.approx(400.0, rel=0.04)


def test_gaps_of_an_uneven_clock_are_split_and_each_part_is_interpolated(tmp_path: Path) -> None:
    times = clock_of_a_logger("packets")
    values = np.sin(2.0 * np.pi * 7.0 * times)
    kept = np.ones(len(times), bool)
    kept[3000:3100] = False
    values[6000:6003] = np.nan
    path = write_rows(tmp_path / "run.csv", [f"{t:.6f}" for t in times[kept]], values[kept])
    with pytest.raises(SceneError, match=r"has 2 gaps \(0\.2494 s at 7\.49312 s"):
        RecordedNoise(file=path, unit="g")
    record = RecordedNoise(file=path, unit="m/s2", gaps="split").record
    for part, begin in zip(record.segments, (0, 3100, 6003), strict=True):
        grid = times[begin] + np.arange(len(part)) / record.fs
        truth = np.sin(2.0 * np.pi * 7.0 * grid)
        off = part - truth
        assert np.ptp(off[50:-50]) < 1e-4


def test_times_that_go_back_are_refused_with_the_place(tmp_path: Path) -> None:
    record = white_record(10.0)
    exact = np.arange(len(record.values)) / FS
    path = write_rows(tmp_path / "run.csv", [f"{t:.3f}" for t in exact % 5.0], record.values)
    with pytest.raises(SceneError, match=r"line 2001: times must rise, got 0 s after 4.99"):
        RecordedNoise(file=path, unit="g")
    path = write_rows(tmp_path / "run.csv", [f"{t:.4f}" for t in exact[::-1]], record.values)
    values = white_record(1.0).values
    run = np.column_stack([np.arange(len(values)) / FS, values])
    np.savetxt(tmp_path / "two.csv", np.concatenate([run, run]))
    with pytest.raises(SceneError, match=r"; cut the record there, as a second one seems to beg"):
        read_record(tmp_path / "two.csv")
    with pytest.raises(SceneError, match="sort the rows by time"):
        RecordedNoise(file=path, unit="g")
    # seconds since 1970 have more digits than a thousandth of a second
    path = write_rows(tmp_path / "u.csv", [f"{t:.6f}" for t in 1.7e9 + exact], record.values)
    assert not any(
        "last digit" in note for note in RecordedNoise(file=path, unit="g").assumptions()
    )


@pytest.mark.parametrize(
    "stamp",
    ["2024-05-01T12:{:02d}:{:09.6f}Z", "20240501T12{:02d}{:09.6f}Z",
     "2024-05-01 12:{:02d}:{:09.6f}", "2024-05-01T12:{:02d}:{:06.3f}+05:30"],
)  # fmt: skip
def test_times_may_be_stamps(tmp_path: Path, stamp: str) -> None:
    record = white_record(40.0)
    seconds = 30.0 + np.arange(len(record.values)) / FS
    times = [stamp.format(int(second // 60), second % 60.0) for second in seconds]
    path = write_rows(tmp_path / "run.csv", times, record.values, heading="time,a (m/s^2)\n")
    found = RecordedNoise(file=path)
    assert found.record.fs == pytest.approx(FS, rel=1e-5) and found.density_unit == "(m/s2)2/Hz"
    path = write_rows(tmp_path / "run.csv", [*times[:-1], "2024-05-01T25:00:00"], record.values)
    with pytest.raises(SceneError, match=r"line 16000: expected a time stamp .*25:00"):
        RecordedNoise(file=path, unit="g")


@pytest.mark.parametrize("column", ["Y", "y (g)", 3])
def test_one_of_several_columns_is_chosen(tmp_path: Path, column: str | int) -> None:
    values = [white_record(10.0, seed).values for seed in (1, 2, 3)]
    times = [f"{1e3 * row / FS:.1f}" for row in range(len(values[0]))]
    heading = "Time (ms),X (g),Y (g),Z (g)\n"
    path = write_rows(tmp_path / "run.csv", times, *values, heading=heading)
    noise = RecordedNoise(file=path, column=column)
    np.testing.assert_allclose(noise.record.values, 9.80665 * values[1], rtol=1e-12, atol=1e-9)
    assert noise.record.fs == pytest.approx(FS, rel=1e-9)
    told = " ".join(noise.assumptions())
    assert "its unit, g, is the one that line 1" in told
    for wrong, words in (
        (None, "must say which column"), ("W", "has no column with this name"),
        (5, "is 5, but"), (1, "which holds the time"), (True, "must be the name of a column"),
    ):  # fmt: skip
        with pytest.raises(SceneError, match=words) as failure:
            RecordedNoise(file=path, column=wrong)
        assert failure.value.problems[0][0] == "column"
    with pytest.raises(SceneError, match=r"unit is 'm/s2', but line 1 of .* says 'g'"):
        RecordedNoise(file=path, column=column, unit="m/s2")
    assert RecordedNoise(file=path, column=column, unit="gn").density_unit == "g2/Hz"


def test_columns_are_listed_by_their_names_not_by_the_units_below(tmp_path: Path) -> None:
    path = tmp_path / "lab.csv"
    heading = "Frequenz;PSD;Phase\n[Hz];[(m/s²)²/Hz];[°]\n"
    path.write_text(f"{heading}5,0;0,5;0\n10,0;1,9;0\n20,0;1,9;0\n", encoding="utf-8")
    with pytest.raises(SceneError, match="column = 'PSD'") as failure:
        TabulatedNoise(file=str(path))
    assert "2 PSD" in str(failure.value)
    assert TabulatedNoise(file=str(path), column="PSD").density_unit == "(m/s2)2/Hz"


def test_words_of_a_heading_between_blanks_belong_to_the_unit_that_follows(tmp_path: Path) -> None:
    path = tmp_path / "spec.txt"
    path.write_text("# shaker, grms=2.1\nFreq(Hz)  Level dB(m/s^2)^2/Hz\n5 -10\n50 -3\n")
    assert TabulatedNoise(file=str(path)).table.density[0] == 0.1
    path.write_text("Frequency [kHz]  PSD of run 3 [g^2/Hz]\n0.005 0.1\n0.05 0.2\n")
    assert TabulatedNoise(file=str(path)).table.frequency_hz.tolist() == [5.0, 50.0]


def test_fs_agrees_with_times_or_is_refused_and_stands_for_them(tmp_path: Path) -> None:
    record = white_record(10.0)
    path = str(write_text(tmp_path / "run.csv", record))
    assert RecordedNoise(file=path, unit="g", fs=FS).record.fs == pytest.approx(FS)
    with pytest.raises(SceneError, match=r"fs is 200 Hz, but the times of .* give 400 Hz"):
        RecordedNoise(file=path, unit="g", fs=200.0)
    columns = np.column_stack([record.values, record.values[::-1]])
    np.savetxt(tmp_path / "two.csv", columns, delimiter=";", header="X;Y", comments="")
    noise = RecordedNoise(file=str(tmp_path / "two.csv"), unit="g", fs=200.0, column="Y")
    np.testing.assert_allclose(noise.record.values[::-1], 9.80665 * record.values)
    with pytest.raises(SceneError, match="column must say which column"):
        RecordedNoise(file=str(tmp_path / "two.csv"), unit="g", fs=200.0)


@pytest.mark.parametrize("kind", ["values", "rows", "values without times"])
def test_gaps_are_refused_or_split_and_never_bridged(tmp_path: Path, kind: str) -> None:
    record = white_record(60.0)
    time = np.arange(len(record.values)) / FS
    lost = (time >= 20.0) & (time < 22.5)
    # what is on either side differs by a step, which a bridge would take for a slow motion
    values = record.values + np.where(time > 22.0, 500.0, 0.0)
    keys: dict[str, object] = {"unit": "m/s2"}
    if kind == "rows":
        np.savetxt(tmp_path / "run.csv", np.column_stack([time, values])[~lost])
    else:
        columns = np.column_stack([time, np.where(lost, np.nan, values)])
        with_times = kind == "values"
        np.savetxt(tmp_path / "run.csv", columns if with_times else columns[:, 1])
        keys |= {} if with_times else {"fs": FS}
    path = str(tmp_path / "run.csv")
    with pytest.raises(SceneError, match=r"has a gap \(2.5 s at 20 s\); say gaps = \"split\""):
        RecordedNoise(file=path, **keys)
    noise = RecordedNoise(file=path, gaps="split", **keys)
    found = noise.record
    assert found.lengths == (8000, 15000) and [len(part) for part in found.segments] == [
        8000,
        15000,
    ]
    assert found.gaps == (pytest.approx((20.0, 2.5), rel=1e-6),)
    assert found.duration == pytest.approx(57.5)
    assert "split at a gap (2.5 s at 20 s)" in " ".join(noise.assumptions())
    whole = record.density(0.4).table.density.mean()
    apart = found.density(0.4)
    # windows of 1000 samples, half overlapping, in either segment
    assert apart.segments == 15 + 29
    error = whole * apart.relative_error * math.sqrt(1.5 / len(apart.table.density))
    inner = apart.table.density[2:]  # a window's mean is taken off: the first bins hold the rest
    assert_agrees(Estimate(value=float(inner.mean()), standard_error=1.5 * error), DENSITY)
    bridged = Record(values=found.values, fs=FS).density(0.4).table.density[2:]
    assert_differs(Estimate(value=float(bridged.mean()), standard_error=1.5 * error), DENSITY)


@pytest.mark.parametrize(
    ("heading", "words"),
    [
        ("time,acc (g)\n", "without a unit; in seconds the rate would be 1 Hz"),
        ("Sample,acc (g)\n", "has 'Sample' in its first column, expected the time"),
        ("", "without a unit"),
        ("Time (ticks),acc (g)\n", "'ticks' is not a known unit; write s, ms, min, h there"),
        ("X (g),Y (g)\n", "for values without times give fs and column"),
    ],
)
def test_numbers_of_samples_and_milliseconds_are_not_read_as_seconds(
    tmp_path: Path, heading: str, words: str
) -> None:
    values = white_record(10.0).values
    count = [str(row) for row in range(len(values))]
    path = write_rows(tmp_path / "run.csv", count, values, heading=heading)
    with pytest.raises(SceneError, match=words):
        RecordedNoise(file=path, unit="g")
    stated = write_rows(tmp_path / "s.csv", count, values, heading="t (s),acc (g)\n")
    assert RecordedNoise(file=stated).record.fs == pytest.approx(1.0)


@pytest.mark.parametrize(("interval", "taken"), [(0.5, False), (0.1, False), (0.05, True)])
def test_times_that_may_be_milliseconds_need_their_unit(
    tmp_path: Path, interval: float, taken: bool
) -> None:
    values = white_record(2.0).values
    times = [f"{row * interval:.6g}" for row in range(len(values))]
    path = write_rows(tmp_path / "run.csv", times, values, heading="time,acc (g)\n")
    if taken:
        assert RecordedNoise(file=path).record.fs == pytest.approx(1.0 / interval)
    else:
        with pytest.raises(SceneError, match=f"in milliseconds {1e3 / interval:g} Hz"):
            RecordedNoise(file=path)
        # a stated rate settles it
        assert RecordedNoise(file=path, fs=1.0 / interval).record.duration > 1.0
    stated = write_rows(tmp_path / "ms.csv", times, values, heading="time (ms),acc (g)\n")
    assert RecordedNoise(file=stated).record.fs == pytest.approx(1e3 / interval)


def test_times_are_read_from_the_column_that_says_so(tmp_path: Path) -> None:
    values = white_record(10.0).values
    rows = [f"{row},{row / FS:.4f}" for row in range(len(values))]
    path = write_rows(tmp_path / "run.csv", rows, values, heading="Sample,Time (s),acc (g)\n")
    assert RecordedNoise(file=path, column="acc").record.fs == pytest.approx(FS)
    with pytest.raises(SceneError, match="which holds the time"):
        RecordedNoise(file=path, column=2)


def test_an_hour_of_a_fast_logger_has_a_density_that_a_table_can_hold(tmp_path: Path):
    """The finest density of 3.6 million samples would have 225,000 lines."""
    samples = np.random.default_rng(4).normal(size=3_600_000)
    np.save(tmp_path / "hour.npy", samples)
    noise = RecordedNoise(file=str(tmp_path / "hour.npy"), unit="m/s2", fs=1000.0)
    lines = len(noise.table.frequency_hz)
    assert 0.9 * MOST_BREAKPOINTS < lines <= MOST_BREAKPOINTS
    # white noise of variance 1 between 0 and 500 Hz
    assert float(noise.table.density.mean()) == pytest.approx(2e-3, rel=4.5 / lines**0.5)
    # the same lines asked for by hand are refused with those that there can be
    with pytest.raises(ValueError, match=r"expected 0\.00526 to"):
        RecordedNoise(file=str(tmp_path / "hour.npy"), unit="m/s2", fs=1000.0, resolution_hz=1e-3)


@pytest.mark.parametrize("ended_by", ["budget", "Ctrl-C"])
def test_a_record_is_read_no_longer_than_the_budget_of_its_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, ended_by: str
) -> None:
    """Nor after Ctrl-C; also after its lines were read: its clock and its gaps take as long."""

    def endless(*_: object) -> None:
        if ended_by == "Ctrl-C":
            signal.raise_signal(signal.SIGINT)
        while True:
            time.sleep(0.01)

    file = tmp_path / "run.csv"
    file.write_text("".join(f"{n / 100:.2f},{n % 7}\n" for n in range(300)))
    monkeypatch.setattr("stochvi.scenes.records._sampling", endless)
    deadline = Deadline.after(1e-3 if ended_by == "budget" else None)
    error, words = (
        (NotConverged, "raise budget") if ended_by == "budget" else (Interrupted, "by Ctrl-C")
    )
    with of_command(deadline), pytest.raises(error, match=words):
        read_record(file)
