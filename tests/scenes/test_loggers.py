"""Files of loggers and spreadsheets, each written by the library that has its format; and files of
other packages, read apart as these are."""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import wavfile

from stochvi import ForceTable, RecordedNoise, TabulatedNoise
from stochvi.identification import read_test
from stochvi.results.errors import SceneError
from stochvi.scenes import outside, read_record
from stochvi.scenes.pair_tables import read_pairs

pytestmark = pytest.mark.usefixtures("read_here")

FS = 200.0
TIME = np.arange(400) / FS
Z, X = np.random.default_rng(1).normal(size=(2, 400))


def write_tdms(path: Path, step: float = 1.0 / FS, unit: str = "g") -> None:
    nptdms = pytest.importorskip("nptdms")
    about = {"unit_string": unit} | ({"wf_increment": step} if step else {})
    words = np.array(["a", "b"], dtype=object)
    with nptdms.TdmsWriter(str(path)) as file:
        file.write_segment([
            nptdms.ChannelObject("road", "Z", Z, properties=about),
            nptdms.ChannelObject("road", "X", X, properties=about),
            nptdms.ChannelObject("road", "remarks", words),
        ])  # fmt: skip


def write_mf4(path: Path) -> None:
    asammdf = pytest.importorskip("asammdf")
    with asammdf.MDF(version="4.10") as file:
        file.append([
            asammdf.Signal(samples=values, timestamps=TIME, name=name, unit="g")
            for name, values in (("Z", Z), ("X", X))
        ])  # fmt: skip
        file.save(path, overwrite=True)


def write_matlab(path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, values in (("t_ms", 1e3 * TIME), ("run/Z_g", Z)):
            file[name] = values[None, :]
            file[name].attrs["MATLAB_class"] = np.bytes_("double")
        file["note"] = np.array([[82], [85]], "u2")
        file["note"].attrs["MATLAB_class"] = np.bytes_("char")
    content = path.read_bytes()
    path.write_bytes(b"MATLAB 7.3 MAT-file, by hand".ljust(128) + content[128:])


def write_excel(path: Path, *rows: tuple[Any, ...], sheets: int = 1) -> None:
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    for row in rows or [("run 7",), ("time [ms]", "Z [g]"), *zip(1e3 * TIME, Z, strict=True)]:
        book.active.append([float(each) if isinstance(each, float) else each for each in row])
    for number in range(1, sheets):
        book.create_sheet(f"more {number}").append([1, 2])
    book.create_sheet("empty")
    book.save(path)


def write_wav(path: Path) -> None:
    wavfile.write(path, int(FS), np.column_stack([Z, X]) / 8.0)


FORMATS: dict[str, tuple[Callable[[Path], None], dict[str, Any]]] = {
    "tdms": (write_tdms, {"column": "Z"}),
    "mf4": (write_mf4, {"column": "Z"}),
    "mat": (write_matlab, {}),
    "xlsx": (write_excel, {}),
    "wav": (write_wav, {"column": 1, "unit": "g", "full_scale": 8.0}),
}


@pytest.mark.parametrize("kind", FORMATS)
def test_a_file_is_the_record_that_was_written(kind: str, tmp_path: Path) -> None:
    write, keys = FORMATS[kind]
    write(tmp_path / f"run.{kind}")
    found = RecordedNoise(file=str(tmp_path / f"run.{kind}"), **keys)
    assert found.as_read.fs == pytest.approx(FS, rel=1e-9)
    np.testing.assert_allclose(found.as_read.values, Z - Z.mean(), atol=1e-12)
    assert found.density_unit == "g2/Hz"


@pytest.mark.usefixtures("apart")
@pytest.mark.slow
@pytest.mark.parametrize("kind", FORMATS)
def test_a_file_that_is_cut_or_none_is_refused_apart(kind: str, tmp_path: Path) -> None:
    write, keys = FORMATS[kind]
    path = tmp_path / f"run.{kind}"
    write(path)
    whole = path.read_bytes()
    assert len(RecordedNoise(file=str(path), **keys).as_read.values) == len(Z)
    for content in (whole[: len(whole) // 3], whole[: 9 * len(whole) // 10], b"no file " * 99):
        path.write_bytes(content)
        with pytest.raises(SceneError, match=rf"run\.{kind} (is not a|ends before)"):
            RecordedNoise(file=str(path), **keys)


@pytest.mark.parametrize(
    ("kind", "package", "extra"),
    [("tdms", "nptdms", "files"), ("mf4", "asammdf", "mf4"), ("xlsx", "openpyxl", "files"),
     ("mat", "h5py", "files")],
)  # fmt: skip
def test_a_library_that_is_missing_is_told_with_its_extra(
    kind: str, package: str, extra: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / f"run.{kind}"
    path.write_bytes(b"MATLAB 7.3 MAT-file")
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    words = rf"needs the package {package}: pip install 'stochvi\[{extra}\]'"
    with pytest.raises(SceneError, match=words):
        read_record(path)


def test_channels_are_listed_and_numbered(tmp_path: Path) -> None:
    path = tmp_path / "run.tdms"
    write_tdms(path)
    with pytest.raises(SceneError, match=r"one channel .*: 1 Z of road; 2 X of road"):
        read_record(path)
    for listed in ("X", "2 X of road", "X of road"):
        assert read_record(path, column=2)[0] == read_record(path, column=listed)[0]
    with pytest.raises(SceneError, match="holds channel Z over time, expected frequency_hz"):
        TabulatedNoise(file=str(path), column="Z", unit="g2/Hz")
    write_tdms(path, unit="mV")
    with pytest.raises(SceneError, match="expected no mV"):
        read_record(path, column="Z")


def test_channels_without_times_are_a_table(tmp_path: Path) -> None:
    nptdms = pytest.importorskip("nptdms")
    path = tmp_path / "run.tdms"
    write_tdms(path, step=0.0)
    for column in (None, "X", 1):
        with pytest.raises(SceneError, match=r"states no sampling rate, .*; give fs, in Hz; .*1 Z"):
            read_record(path, column=column)
    with pytest.raises(SceneError, match="holds the frequency in none of its channels; it holds"):
        TabulatedNoise(file=str(path), unit="g2/Hz")
    record, columns = read_record(path, column="X", fs=FS)
    assert record.values + record.mean == pytest.approx(X, abs=1e-12)
    assert columns.unit is not None and columns.unit.name == "g"
    assert read_record(path, column="X (g)", fs=FS)[0] == record
    with nptdms.TdmsWriter(str(path)) as file:
        file.write_segment([
            nptdms.ChannelObject("road", name, values, properties={"unit_string": unit})
            for name, values, unit in (("Time", 1e3 * TIME, "ms"), ("Z", Z, "g"))
        ])  # fmt: skip
    assert read_record(path)[0].fs == pytest.approx(FS)
    with nptdms.TdmsWriter(str(path)) as file:
        file.write_segment([nptdms.ChannelObject(of, "Z", Z) for of in ("front", "rear")])
    with pytest.raises(SceneError, match=r"one channel .*: 1 Z of front; 2 Z of rear"):
        read_record(path, column="Z", fs=FS)
    assert read_record(path, column="Z of rear", fs=FS)[0].fs == FS


def write_waveform(path: Path, step: float, over: str, **about: str) -> Path:
    nptdms = pytest.importorskip("nptdms")
    about = {"unit_string": "g", "wf_increment": step, "wf_xunit_string": over} | about
    with nptdms.TdmsWriter(str(path)) as file:
        file.write_segment([nptdms.ChannelObject("road", "Z", np.abs(Z), properties=about)])
    return path


@pytest.mark.parametrize(
    ("step", "over", "refused"),
    [
        (5.0, "ms", ""), (0.005, "s", ""), (0.005, "", ""), (0.005, "S", ""),
        (5.0, "Hz", "holds channel Z over frequency, expected time"),
        (1.0, "", "has a time every 1 in channel Z, without a unit"),
        (5.0, "turns", "over 'turns', which is not a known unit"),
    ],
)  # fmt: skip
def test_a_waveform_is_over_the_unit_that_its_file_states(tmp_path, step, over, refused) -> None:
    path = write_waveform(tmp_path / "run.tdms", step, over)
    if not refused:
        assert read_record(path)[0].fs == pytest.approx(FS)
        return
    with pytest.raises(SceneError, match=refused):
        read_record(path)


def test_a_waveform_over_frequency_is_a_density(tmp_path: Path) -> None:
    path = write_waveform(tmp_path / "run.tdms", 5.0, "Hz", unit_string="g^2/Hz")
    assert TabulatedNoise(file=str(path)).numbers()["highest_frequency_hz"] == 1995.0
    path = write_waveform(tmp_path / "run.tdms", 0.01, "", wf_xname="Frequency")
    with pytest.raises(SceneError, match="over frequency, expected time"):
        read_record(path)


def test_each_group_of_channels_has_its_own_clock(tmp_path: Path) -> None:
    nptdms = pytest.importorskip("nptdms")
    path = tmp_path / "run.tdms"
    groups = {"run1": (TIME, "a", Z), "run2": (2.0 * TIME, "b", X)}
    with nptdms.TdmsWriter(str(path)) as file:
        for of, (times, name, values) in groups.items():
            columns = (("time", times), (name, values))
            file.write_segment([nptdms.ChannelObject(of, *each) for each in columns])
    for column, rate in (("a", FS), ("b", FS / 2.0), (4, FS / 2.0), ("4 b of run2", FS / 2.0)):
        assert read_record(path, column=column)[0].fs == pytest.approx(rate)
    with pytest.raises(SceneError, match=r"one channel .*: 1 time of run1; 2 a of run1; 3 time"):
        read_record(path)


@pytest.mark.parametrize("kind", ["u1", "i2", "i4", "f4"])
def test_a_sound_is_a_part_of_full_scale(kind: str, tmp_path: Path) -> None:
    path, part = tmp_path / "run.wav", np.tile([0.5, -0.5, 0.25, -0.25], 100)
    full = {"u1": 128, "i2": 2**15, "i4": 2**31, "f4": 1.0}[kind]
    wavfile.write(path, int(FS), (part * full + 128 * (kind == "u1")).astype(kind))
    record, columns = read_record(path, full_scale=20.0)
    assert record.values + record.mean == pytest.approx(20.0 * part) and columns.unit is None
    with pytest.raises(SceneError, match="full_scale must say which value full scale stands for"):
        read_record(path)
    with pytest.raises(ValueError, match="needs unit"):
        RecordedNoise(file=str(path), full_scale=20.0)
    (tmp_path / "run.csv").write_text("1,2\n")
    with pytest.raises(SceneError, match=r"full_scale is for sound files \(.wav\)"):
        read_record(tmp_path / "run.csv", full_scale=20.0)


def test_a_spreadsheet_stands_in_the_place_of_any_table(tmp_path: Path) -> None:
    path = tmp_path / "table.xlsx"
    write_excel(path, ("deflection (mm)", "force (N)"), (1, 10.0), (2, 40.0))
    assert ForceTable(file=str(path)).force == (10.0, 40.0)
    assert read_test(path, "force").observed.tolist() == [10.0, 40.0]
    write_excel(path, ("Name", "upper (mm)"), ("left", 2.0), ("right", 3.0))
    assert [each["name"] for each in read_pairs(str(path))] == ["left", "right"]
    write_excel(path, ("f [Hz]", "PSD [g²/Hz]"), (10, 0.01), (100, 0.01))
    assert TabulatedNoise(file=str(path)).density_unit == "g2/Hz"
    write_excel(path, ("time", "Z"), (1, 0.1), (2, "broken"), (3, 0.1))
    with pytest.raises(SceneError, match=r"table\.xlsx, line 3: expected a number in column 2"):
        read_record(path)
    write_excel(path, sheets=2)
    with pytest.raises(SceneError, match="holds the sheets Sheet; more 1; write a file with the"):
        read_record(path)


OWN = """
import os, time
import numpy as np

def read(path):
    what = path.read_text()
    if what == "crash":
        os.kill(os.getpid(), 11)
    if what == "wait":
        time.sleep(60)
    if what == "wrong":
        raise ValueError("no head")
    return {"time (s)": np.arange(400) / 200.0, "Z (g)": np.cos(np.arange(400))}
"""


@pytest.fixture
def own(apart: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A file of an ending that an installed package reads."""
    about = tmp_path / "own_reader-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: own-reader\nVersion: 1.0\n")
    (about / "entry_points.txt").write_text("[stochvi.readers]\nown = own_reader:read\n")
    (tmp_path / "own_reader.py").write_text(OWN)
    monkeypatch.syspath_prepend(tmp_path)
    outside.entry_points.cache_clear()
    return tmp_path / "run.own"


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="needs signals")
def test_a_reader_of_another_package_runs_apart(own: Path) -> None:
    own.write_text("right")
    assert read_record(own)[0].fs == pytest.approx(200.0)
    for content, words in (
        ("crash", "its process ended"), ("wrong", "ValueError: no head"),
    ):  # fmt: skip
        own.write_text(content)
        told = rf"was not read by own-reader 1\.0, which reads \.own files: {words}"
        with pytest.raises(SceneError, match=told):
            read_record(own)
    own.write_text("wait")
    threading.Timer(3.0, os.kill, (os.getpid(), signal.SIGINT)).start()
    began = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        read_record(own)
    assert time.monotonic() - began < 20.0
