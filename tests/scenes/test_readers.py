"""Files of instruments: what is read, and the sentence for what leaves a choice or is broken."""

from __future__ import annotations

import csv
import inspect
import json
import math
import re
import subprocess
import sys
import time
import tomllib
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import scipy.linalg
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.io import savemat

from stochvi import Matrices, load_scene
from stochvi.mathematics.spectra import gains
from stochvi.mathematics.units import STANDARD_GRAVITY, unit
from stochvi.methods.closed_form import exact
from stochvi.results.errors import SceneError
from stochvi.results.estimates import Estimate
from stochvi.scenes import foreign_reader, readers, text_tables
from stochvi.scenes.datasets import data_folder, profiles, shipped_scene
from stochvi.scenes.excitations import RecordedNoise, TabulatedNoise
from stochvi.scenes.keys import scene_schema
from stochvi.scenes.readers import (
    SPECTRAL_DENSITY,
    TIME_RESPONSE,
    read_columns,
    read_foreign,
    read_numpy,
)
from stochvi.scenes.scene import Scene
from stochvi.scenes.structures import Isolator
from stochvi.statistics.spectra import spectrum
from stochvi.testing import assert_agrees
from stochvi.views.files import write_table
from support.records import write_uff
from support.refusals import refusals

pytestmark = pytest.mark.usefixtures("read_here")

FREQUENCY = np.array([5.0, 40.0, 500.0])
DENSITY = np.array([0.015, 0.015, 0.00015])
NAMES = ("frequency_hz", "density")


PSD = (9, "floor, vertical", FREQUENCY, DENSITY, "g^2/Hz")
OTHER = (9, "roof", FREQUENCY, 2.0 * DENSITY, "")
SPECTRUM = (2, "auto spectrum", FREQUENCY, DENSITY, "g^2")


def test_a_uff_file_with_one_density_needs_nothing_more(tmp_path: Path) -> None:
    path = write_uff(tmp_path / "run.uff", SPECTRUM, PSD)
    noise = TabulatedNoise(file=str(path))
    in_csv = TabulatedNoise(frequency_hz=FREQUENCY, density=DENSITY, unit="g2/Hz")
    np.testing.assert_allclose(noise.table.density, in_csv.table.density, rtol=1e-6)
    np.testing.assert_allclose(noise.table.frequency_hz, FREQUENCY, rtol=1e-6)
    assert noise.density_unit == "g2/Hz"


def test_a_uff_file_that_leaves_a_choice_is_answered_with_it(tmp_path: Path) -> None:
    path = write_uff(tmp_path / "run.uff", PSD, OTHER)
    with pytest.raises(SceneError) as failure:
        TabulatedNoise(file=str(path))
    ((key, sentence),) = failure.value.problems
    assert key == "dataset"
    assert "dataset = 1: floor, vertical" in sentence and "dataset = 2: roof" in sentence
    with pytest.raises(SceneError, match=r"needs unit, one of g2/Hz, .* got none"):
        TabulatedNoise(file=str(path), dataset=2)
    roof = TabulatedNoise(file=str(path), dataset=2, unit="(m/s2)2/Hz").table
    np.testing.assert_allclose(roof.density, 2.0 * DENSITY, rtol=1e-6)
    with pytest.raises(SceneError, match=r"dataset must be one of .*, got 7"):
        TabulatedNoise(file=str(path), dataset=7)
    with pytest.raises(SceneError, match=r"unit is 'N2/Hz', but dataset 1 of .* says 'g2/Hz'"):
        TabulatedNoise(file=str(path), dataset=1, unit="N2/Hz")


def padded(kind: int, count: int, unit: str, over: str, step: float) -> str:
    """A dataset 58 of 1, 2, 3 ... over even steps from 5, with zeros that fill its last line."""
    head = [
        "run 7", *["NONE"] * 4,
        f"{kind:5d}{0:10d}{0:5d}{0:10d} {'NONE':10s}{1:10d}{3:4d} {'NONE':10s}{0:10d}{0:4d}",
        f"{2:10d}{count:10d}{1:10d}{5.0:13.5e}{step:13.5e}{0.0:13.5e}",
        f"{17 if kind == TIME_RESPONSE else 18:10d}{0:5d}{0:5d}{0:5d} {'x':20s} {over:20s}",
        f"{12:10d}{0:5d}{0:5d}{0:5d} {'acceleration':20s} {unit:20s}",
        *[f"{0:10d}{0:5d}{0:5d}{0:5d} {'NONE':20s} {'NONE':20s}"] * 2,
    ]  # fmt: skip
    values = [float(n) for n in range(1, count + 1)] + [0.0] * (-count % 6)
    rows = ["".join(f"{v:13.5e}" for v in values[n : n + 6]) for n in range(0, len(values), 6)]
    return "\n".join([f"{-1:6d}", f"{58:6d}", *head, *rows, f"{-1:6d}\n"])


@pytest.mark.parametrize("kind", [TIME_RESPONSE, 9])
def test_numbers_that_fill_the_last_line_of_a_uff_file_are_no_samples(
    tmp_path: Path, kind: int
) -> None:
    path = tmp_path / "run.uff"
    path.write_text(padded(kind, 13, "g", "s" if kind == TIME_RESPONSE else "Hz", 0.5))
    columns = read_columns(path, NAMES, function_type=kind)
    assert columns.y.tolist() == list(range(1, 14))
    assert columns.x is not None and columns.x.tolist() == [5.0 + 0.5 * n for n in range(13)]
    path.write_text(padded(kind, 13, "g", "", 0.5).replace(f"{13:10d}{1:10d}", f"{19:10d}{1:10d}"))
    with pytest.raises(SceneError, match=r"run\.uff ends before the numbers that it claims"):
        read_columns(path, NAMES, function_type=kind)


def test_times_and_frequencies_of_a_uff_file_are_in_the_unit_that_it_states(tmp_path: Path) -> None:
    path = tmp_path / "run.uff"
    for kind, over, factor in ((TIME_RESPONSE, "ms", 1e-3), (9, "kHz", 1e3), (9, "NONE", 1.0)):
        path.write_text(padded(kind, 12, "g", over, 1.0))
        found = read_columns(path, NAMES, function_type=kind).x
        assert found is not None and found.tolist() == [factor * (5.0 + n) for n in range(12)]
    path.write_text(padded(9, 12, "g", "s", 1.0))
    with pytest.raises(SceneError, match=r"dataset 1 of \S+ is over s, expected frequency"):
        read_columns(path, NAMES)


def test_an_auto_spectrum_is_no_density_unless_it_is_asked_for(tmp_path: Path) -> None:
    path = write_uff(tmp_path / "run.unv", SPECTRUM)
    with pytest.raises(SceneError, match=r"dataset must say .* auto spectrum \(function type 2\)"):
        read_columns(path, NAMES)
    np.testing.assert_allclose(read_columns(path, NAMES, dataset=1).y, DENSITY, rtol=1e-6)
    with pytest.raises(SceneError, match=r"must say which of .* is a record"):
        read_columns(path, ("time", "acceleration"), function_type=TIME_RESPONSE)


def test_the_one_sensible_pair_of_a_matlab_file_is_found(tmp_path: Path) -> None:
    path = tmp_path / "run.mat"
    savemat(path, {"G": DENSITY, "f": FREQUENCY, "fs": 1000.0, "note": "floor"})
    columns = read_columns(path, NAMES)
    assert columns.x is not None
    assert columns.x.tolist() == FREQUENCY.tolist() and columns.y.tolist() == DENSITY.tolist()
    savemat(path, {"spec": np.column_stack([FREQUENCY, DENSITY])})
    assert read_columns(path, NAMES).y.tolist() == DENSITY.tolist()
    assert read_columns(path, NAMES, variables=["spec"]).y.tolist() == DENSITY.tolist()


def test_a_matlab_file_that_leaves_a_choice_is_answered_with_what_it_holds(tmp_path: Path) -> None:
    path = tmp_path / "run.mat"
    savemat(path, {"f": FREQUENCY, "floor": DENSITY, "roof": DENSITY, "long": np.ones(7)})
    with pytest.raises(SceneError) as failure:
        read_columns(path, NAMES)
    assert failure.value.problems[0][0] == "variables"
    for words in ('["frequency_hz", "density"]', "f (3)", "roof (3)", "long (7)"):
        assert words in str(failure.value)
    assert read_columns(path, NAMES, variables=["f", "roof"]).y.tolist() == DENSITY.tolist()
    for variables, words in (
        (["f", "wall"], "names 'wall', but"),
        (["f", "long"], "must have one length, got f (3); long (7)"),
        (["f"], "must name vectors"),
    ):
        with pytest.raises(SceneError) as failure:
            read_columns(path, NAMES, variables=variables)
        assert words in str(failure.value)
    with pytest.raises(SceneError, match="must name a vector"):
        read_columns(path, ("acceleration",), variables=["f", "floor"])


def test_keys_for_one_kind_of_file_are_refused_for_another(tmp_path: Path) -> None:
    (tmp_path / "run.csv").write_text("1,2\n3,4\n")
    with pytest.raises(
        SceneError, match=r"variables is for MATLAB and NumPy files \(.mat, .npz\), got run"
    ):
        read_columns(tmp_path / "run.csv", NAMES, variables=["f", "G"])
    with pytest.raises(SceneError, match=r"dataset is for UFF files .* got run.csv"):
        read_columns(tmp_path / "run.csv", NAMES, dataset=1)
    with pytest.raises(SceneError, match="has variables, dataset without a file"):
        TabulatedNoise(profile="navmat-p-9492", variables=["f", "G"], dataset=1)


@pytest.mark.parametrize("heading", ["Nr;Freq [Hz];PSD [g²/Hz]", "No.;Frequency;PSD"])
def test_a_column_that_counts_the_rows_is_not_taken_for_frequency(tmp_path, heading: str) -> None:
    rows = "".join(
        f"{n};{f};{g}\n" for n, (f, g) in enumerate(zip(FREQUENCY, DENSITY, strict=True))
    )
    path = tmp_path / "run.csv"
    path.write_text(f"{heading}\n{rows}", encoding="utf-8")
    columns = read_columns(path, NAMES, column=3)
    assert columns.x is not None
    assert columns.x.tolist() == FREQUENCY.tolist() and columns.y.tolist() == DENSITY.tolist()
    with pytest.raises(SceneError, match=r"column is number 2 of .* which holds the frequency"):
        read_columns(path, NAMES, column=2)
    path.write_text(f"f [Hz];Peak f [Hz];PSD [g²/Hz]\n{rows}", encoding="utf-8")
    found = read_columns(path, NAMES, column=3).x
    assert found is not None and found.tolist() == [0.0, 1.0, 2.0]


def test_the_column_that_a_refusal_proposes_is_of_a_quantity_that_fits(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    path.write_text("f [Hz];Control [g²/Hz];Drive [V²/Hz]\n5;0.1;2\n9;0.2;2\n", encoding="utf-8")
    with pytest.raises(SceneError, match=r"column = 'Control \[g²/Hz\]' or column = 2"):
        read_columns(path, NAMES)


def test_the_fields_of_a_matlab_structure_are_read(tmp_path: Path) -> None:
    path = tmp_path / "run.mat"
    savemat(path, {"bed": {"f": FREQUENCY, "G": DENSITY, "name": "floor"}, "gain": 2.0})
    found = read_columns(path, NAMES)
    assert found.x is not None
    assert found.x.tolist() == FREQUENCY.tolist() and found.y.tolist() == DENSITY.tolist()
    chosen = read_columns(path, NAMES, variables=["bed.f", "bed.G"])
    assert chosen.y.tolist() == DENSITY.tolist()


@pytest.mark.parametrize("suffix", [".psd", ".txt", ".csv", ""])
def test_text_is_read_whatever_its_name(tmp_path: Path, suffix: str) -> None:
    (tmp_path / f"run{suffix}").write_text("5 0.015\n40 0.015\n500 0.00015\n")
    noise = TabulatedNoise(file=str(tmp_path / f"run{suffix}"), unit="g2/Hz")
    assert noise.table.frequency_hz.tolist() == FREQUENCY.tolist()


ANYTHING = st.binary(max_size=400) | st.text("-158 \n0123456789.", max_size=400).map(str.encode)
"""Bytes of a file."""


@settings(max_examples=60, deadline=None)
@given(content=ANYTHING)
def test_any_text_gives_columns_or_a_sentence(tmp_path_factory, content) -> None:
    columns_or_a_sentence(tmp_path_factory, content, ".csv")


# each of these is read by a process of its own; `make verify` has hundreds of damaged files
@pytest.mark.usefixtures("apart")
@pytest.mark.slow
@settings(max_examples=12, deadline=None)
@given(content=ANYTHING, suffix=st.sampled_from([".uff", ".mat", ".unv"]))
def test_any_file_gives_columns_or_a_sentence(tmp_path_factory, content, suffix) -> None:
    columns_or_a_sentence(tmp_path_factory, content, suffix)


def columns_or_a_sentence(tmp_path_factory, content: bytes, suffix: str) -> None:
    path = tmp_path_factory.getbasetemp() / f"anything{suffix}"
    path.write_bytes(content)
    sentences = [str(path)]
    try:
        columns = read_columns(path, NAMES)
        assert columns.x is not None and len(columns.x) == len(columns.y)
    except SceneError as error:
        sentences = [text for _, text in error.problems]
    assert all(str(path) in text and "\n" not in text for text in sentences)


@settings(max_examples=40, deadline=None)
@given(
    rows=st.lists(
        st.tuples(st.floats(0.01, 1e4), st.floats(1e-12, 1e3)), min_size=2, max_size=20,
        unique_by=lambda row: row[0],
    ),
    parted=st.sampled_from([",", ";", "\t", "  ", ", "]),
    header=st.sampled_from(["", "f,G\n", "# floor\n", "Hz N^2/Hz\n"]),
    end=st.sampled_from(["\n", "\r\n"]),
)  # fmt: skip
def test_any_table_comes_back_from_its_text(tmp_path_factory, rows, parted, header, end) -> None:
    rows = sorted(rows)
    path = tmp_path_factory.getbasetemp() / "table.csv"
    text = header + end.join(f"{f!r}{parted}{g!r}" for f, g in rows) + end
    path.write_bytes(text.encode())
    table = TabulatedNoise(file=str(path), unit="N2/Hz").table
    assert list(zip(table.frequency_hz.tolist(), table.density.tolist(), strict=True)) == rows


@pytest.mark.usefixtures("apart")
@pytest.mark.slow
@pytest.mark.parametrize("suffix", [".uff", ".mat"])
def test_a_truncated_file_gives_a_sentence(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"run{suffix}"
    if suffix == ".uff":
        write_uff(path, PSD)
    else:
        savemat(path, {"f": FREQUENCY, "G": DENSITY})
    whole = path.read_bytes()
    for share in (0.2, 0.5, 0.8):
        path.write_bytes(whole[: int(share * len(whole))])
        with pytest.raises(SceneError, match=str(path)):
            read_columns(path, NAMES)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    for name in ("run.uff", "run.mat", "run.csv"):
        with pytest.raises(SceneError, match=rf"{name} cannot be read: no such file"):
            read_columns(tmp_path / name, NAMES)


# Exports as they come from the programs of a laboratory -----------------------------------


def labview() -> str:
    """A record as LabVIEW writes it: units far above, a column of comments that stays empty."""
    rows = [f"{n / 500:.6f}\t{np.sin(n):.6f}\t{0.5 * np.sin(n):.6f}\t" for n in range(1000)]
    return "\n".join(
        [
            "LabVIEW Measurement\t", "Separator\tTab", "Date\t2025/03/12", "***End_of_Header***\t",
            "\t", "Channels\t2\t\t", "Samples\t1000\t1000\t", "Y_Unit_Label\tg\tm/s^2\t",
            "X_Dimension\tTime\tTime\t", "Delta_X\t2.0E-3\t2.0E-3\t", "***End_of_Header***\t\t\t",
            "X_Value\tBase Z\tTop Z\tComment", *rows,
        ]
    )  # fmt: skip


def test_a_labview_record_has_its_names_and_its_units(tmp_path: Path) -> None:
    path = tmp_path / "run.lvm"
    path.write_text(labview())
    base = RecordedNoise(file=str(path), column="Base Z").record
    top = RecordedNoise(file=str(path), column="Top Z").record
    assert base.fs == pytest.approx(500.0)
    assert base.rms == pytest.approx(2.0 * STANDARD_GRAVITY * top.rms, rel=1e-5)
    with pytest.raises(SceneError, match="1 X_Value, 2 Base Z, 3 Top Z"):
        RecordedNoise(file=str(path))
    with pytest.raises(SceneError, match=r"line 8 of .* says 'm/s2'"):
        RecordedNoise(file=str(path), column="Top Z", unit="g")


def labview_in_packets(kind: str, channels: int = 1) -> str:
    """1000 samples at 500 Hz in four packets, each with a header of its own."""
    names, units = ["Base Z", "Top Z"][:channels], ["g", "V"][:channels]
    lines = [
        "LabVIEW Measurement\t", f"X_Columns\t{'No' if kind == 'no times' else 'One'}",
        "***End_of_Header***\t", "\t",
    ]  # fmt: skip
    for first in range(0, 1000, 250):
        started = 59.2 + (first / 500 if kind == "anew" else 0.0)
        lines += [
            f"Channels\t{channels}\t", "Date" + "\t2025/03/12" * channels + "\t",
            "Time" + f"\t23:59:{started:.7f}" * channels + "\t",
            "Y_Unit_Label\t" + "\t".join(units) + "\t", f"X0\t{first / 500}\t",
            "Delta_X" + "\t2.0E-3" * channels + "\t", "***End_of_Header***\t\t\t",
            "\t".join(["X_Value", *names, "Comment"]),
        ]  # fmt: skip
        for n in range(first, first + 250):
            time = (n - first * (kind == "anew")) / 500
            values = [f"{np.sin(n):.6f}", f"{0.5 * np.sin(n):.6f}"][:channels]
            row = ["" if kind == "no times" else f"{time:.6f}", *values]
            lines.append("\t".join(row + ["begun"] * (kind == "remarks" and n == first)))
    return "\n".join(lines)


@pytest.mark.parametrize("channels", [1, 2])
@pytest.mark.parametrize("kind", ["in turn", "anew", "no times", "remarks"])
def test_labview_packets_are_one_record(tmp_path: Path, kind: str, channels: int) -> None:
    path = tmp_path / "run.lvm"
    path.write_text(labview_in_packets(kind, channels))
    found = RecordedNoise(file=str(path), column="Base Z").record
    values = STANDARD_GRAVITY * np.round(np.sin(np.arange(1000.0)), 6)
    assert found.fs == pytest.approx(500.0) and not found.gaps
    np.testing.assert_allclose(found.values, values - values.mean(), atol=1e-12)


def test_labview_packets_that_were_apart_have_gaps_between_them(tmp_path: Path) -> None:
    """The last one begins 5.8 s after the first, beyond midnight, and the third ends at 1.5 s."""
    path = tmp_path / "run.lvm"
    stamp = "Date\t2025/03/1{}\t\nTime\t{}\t"
    text = labview_in_packets("anew")
    changed = text.replace(stamp.format(2, "23:59:60.7000000"), stamp.format(3, "00:00:05.0"))
    assert changed != text
    path.write_text(changed)
    with pytest.raises(SceneError, match=r"a gap \(4\.3 s at 1\.5 s\)"):
        RecordedNoise(file=str(path), column="Base Z")


def test_values_below_a_header_in_words(tmp_path: Path) -> None:
    path = tmp_path / "run.dat"
    values = [f"{np.sin(n):+.4e}" for n in range(400)]
    path.write_text("\n".join(["Sampling rate: 400 Hz", "Unit: g", "Range: 50 g", *values]))
    found = RecordedNoise(file=str(path), fs=400.0)
    assert found.record.rms == pytest.approx(STANDARD_GRAVITY / np.sqrt(2.0), rel=1e-2)
    with pytest.raises(SceneError, match="for values without times give fs"):
        RecordedNoise(file=str(path))


def test_a_logger_names_an_axis_before_the_unit(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    rows = [f"{n / 200},{np.cos(n):.5f},{np.sin(n):.5f},21.5" for n in range(400)]
    path.write_text("\n".join(["time_s,accel_x_g,accel_z_g,temp_degC", *rows]))
    found = RecordedNoise(file=str(path), column="accel_z_g")
    assert found.record.rms == pytest.approx(STANDARD_GRAVITY / np.sqrt(2.0), rel=1e-2)
    with pytest.raises(SceneError, match="column = 'accel_z_g' or column = 3"):
        RecordedNoise(file=str(path))


def test_names_stand_above_a_line_of_units_of_which_one_is_not_known(tmp_path: Path) -> None:
    path = tmp_path / "table.csv"
    path.write_text("Frequenz;Dichte;Grenze\nHz;g²/Hz;dB\n10;0,01;3\n20;0,02;3\n", "utf-8")
    assert TabulatedNoise(file=str(path), column="Dichte").density_unit == "g2/Hz"
    with pytest.raises(SceneError, match="1 Frequenz, 2 Dichte, 3 Grenze"):
        TabulatedNoise(file=str(path))


# ------------------------------------------------------------------------------
# Binary files of other programs, damaged and whole: a crash or a bomb there is a sentence here.
# ------------------------------------------------------------------------------


TIME = np.arange(400) / 200.0
VALUES = np.random.default_rng(1).normal(size=400)
RECORD = ("time", "acceleration")


def of_record(path: Path, **keys: object) -> RecordedNoise:
    return RecordedNoise(file=str(path), **keys)


@pytest.mark.usefixtures("apart")
@pytest.mark.skipif(sys.platform == "win32", reason="needs signals")
def test_a_byte_that_makes_the_reader_crash_is_a_sentence(tmp_path: Path) -> None:
    path = tmp_path / "run.mat"
    savemat(path, {"a": np.arange(300.0)})
    content = bytearray(path.read_bytes())
    content[176] = 0x7F  # the type of the name: the reader of scipy follows a wild pointer
    path.write_bytes(content)
    here = [sys.executable, "-c", f"from scipy.io import loadmat; loadmat({str(path)!r})"]
    assert subprocess.run(here, stderr=subprocess.DEVNULL, check=False).returncode != 0
    with pytest.raises(SceneError, match=r"run\.mat is not a MATLAB file that can be read"):
        of_record(path, unit="g", fs=100.0)


@pytest.mark.usefixtures("apart")
@pytest.mark.slow
@pytest.mark.parametrize("kind", ["mat", "uff", "npy", "npz"])
def test_damaged_files_are_refused_in_a_sentence_or_read(tmp_path: Path, kind: str) -> None:
    path = tmp_path / f"run.{kind}"
    if kind == "mat":
        savemat(path, {"t": TIME, "a": VALUES})
    elif kind == "uff":
        write_uff(path, (TIME_RESPONSE, "floor", TIME, VALUES, "g"))
    elif kind == "npy":
        np.save(path, np.column_stack([TIME, VALUES]))
    else:
        np.savez_compressed(path, t=TIME, a=VALUES)
    content = path.read_bytes()
    random, read, told = np.random.default_rng(4), 0, []
    for number in range(6 if kind in ("mat", "uff") else 200):
        changed = bytearray(content)
        if number % 3:
            changed[random.integers(min(len(content), 400))] = random.integers(256)
        else:
            del changed[random.integers(len(content)) :]
        path.write_bytes(changed)
        try:
            of_record(path, **({} if kind == "uff" else {"unit": "g"}))
            read += 1
        except SceneError as error:
            told.append(str(error))
    assert all(len(each) < 1000 and "\n" not in each for each in told)
    assert read  # some damage is in what is not looked at


def test_a_file_that_claims_more_than_it_may_hold_takes_no_memory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(readers, "MOST_NUMBERS", 100_000)
    bomb = tmp_path / "bomb.npz"
    with zipfile.ZipFile(bomb, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("a.npy", bytes(900_000))
    assert bomb.stat().st_size < 2_000
    with pytest.raises(SceneError, match="holds more than 1e"):
        read_numpy(bomb)
    claimed = tmp_path / "claimed.npy"
    np.save(claimed, np.zeros(3))
    head = claimed.read_bytes().replace(b"(3,), }", b"(9999999999999,), }")
    claimed.write_bytes(head)
    with pytest.raises(SceneError, match="is not a NumPy file that can be read"):
        read_numpy(claimed)
    objects = tmp_path / "objects.npy"
    np.save(objects, np.array([{}], dtype=object), allow_pickle=True)
    with pytest.raises(SceneError, match="is not a NumPy file that can be read"):
        read_numpy(objects)


@pytest.fixture
def read_by(apart: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[str], None]:
    """Has files read by another program in place of the reader."""

    def other(program: str) -> None:
        path = tmp_path / "reader.py"
        path.write_text(program, encoding="utf-8")
        monkeypatch.setattr(foreign_reader, "__file__", str(path))
        readers._read_apart.cache_clear()

    return other


@pytest.mark.parametrize(
    ("reader", "sentence"),
    [
        ("import os; os.kill(os.getpid(), 11)", "is not a MATLAB file that can be read"),
        ("import resource; resource.setrlimit(7, (9, 9)); open('/x' * 9)", "is not a MATLAB file"),
        ("bytearray(10**10)", "holds more than 1e"),
        ("import os; os.kill(os.getpid(), 24)", "takes more than 60 s to be read"),
        ("print('noise'); raise KeyError", "is not a MATLAB file that can be read"),
    ],
    ids=["crash", "other error", "memory", "time", "noise"],
)
@pytest.mark.skipif(sys.platform == "win32", reason="needs limits and signals")
def test_whatever_a_reader_does_is_a_sentence(
    tmp_path: Path, read_by: Callable[[str], None], reader: str, sentence: str
) -> None:
    program = Path(foreign_reader.__file__).read_text(encoding="utf-8")
    read_by(program.replace("    content = loadmat(", f"    {reader}\n    content = loadmat("))
    path = tmp_path / "run.mat"
    savemat(path, {"a": VALUES})
    with pytest.raises(SceneError, match=sentence):
        read_foreign(path, "MATLAB")


@pytest.mark.skipif(sys.platform == "win32", reason="needs limits and signals")
def test_a_matlab_file_that_claims_too_much_is_not_begun(
    tmp_path: Path, read_by: Callable[[str], None]
) -> None:
    """A compressed gigabyte took 20 s to be refused."""
    program = Path(foreign_reader.__file__).read_text(encoding="utf-8")
    program = program.replace(
        "    content = loadmat(", "    raise KeyError\n    content = loadmat("
    )
    path = tmp_path / "run.mat"
    savemat(path, {"a": VALUES, "note": "x" * 1000}, do_compression=True)
    for most, sentence in ((399, "holds more than 1e"), (400, "not a MATLAB file that can be")):
        read_by(program.replace("MOST_NUMBERS = 100_000_000", f"MOST_NUMBERS = {most}"))
        with pytest.raises(SceneError, match=sentence):
            read_foreign(path, "MATLAB")


def test_a_matlab_file_of_many_vectors_is_listed_in_short_and_at_once(tmp_path: Path) -> None:
    path = tmp_path / "run.mat"
    savemat(path, {f"a{n}": np.arange(4.0) for n in range(1500)})
    with pytest.raises(SceneError, match=r"a19 \(4\); and 1480 more"):
        of_record(path, unit="g")


def test_numpy_files_are_records_too(tmp_path: Path) -> None:
    np.save(tmp_path / "two.npy", np.column_stack([TIME, VALUES]))
    np.save(tmp_path / "one.npy", VALUES.astype("f4"))
    np.savez_compressed(tmp_path / "run.npz", t_ms=1e3 * TIME, acc_g=VALUES, note=np.array("x"))
    centred = VALUES - VALUES.mean()
    two = of_record(tmp_path / "two.npy", unit="m/s2")
    one = of_record(tmp_path / "one.npy", unit="m/s2", fs=200.0)
    named = of_record(tmp_path / "run.npz")
    assert two.record.fs == one.record.fs == named.record.fs == 200.0
    np.testing.assert_allclose(two.record.values, centred, atol=1e-12)
    np.testing.assert_allclose(one.record.values, centred, atol=1e-6)
    np.testing.assert_allclose(named.record.values, 9.80665 * centred, atol=1e-12)


def test_names_of_variables_state_units_and_a_file_without_times_says_how_to_go_on(
    tmp_path: Path,
) -> None:
    path = tmp_path / "run.mat"
    savemat(path, {"t_ms": 1e3 * TIME, "acc_g": VALUES})
    found = of_record(path)
    assert found.record.fs == 200.0 and found.density_unit == "g2/Hz"
    with pytest.raises(SceneError, match=r"is 'm/s2', but the name acc_g in .* says 'g'"):
        of_record(path, unit="m/s2")
    savemat(path, {"t": 1e3 * TIME, "acc_g": VALUES})
    with pytest.raises(SceneError, match="has a time every 5 in the variable t"):
        of_record(path)
    savemat(path, {"acc_g": VALUES})
    with pytest.raises(SceneError, match=r'give fs, and variables = \["acc_g"\]'):
        of_record(path)
    assert of_record(path, fs=200.0, variables=["acc_g"]).density_unit == "g2/Hz"


@pytest.mark.parametrize("suffix", [".npy", ".npz", ".mat"])
@pytest.mark.parametrize("along", [1e3 * TIME, np.arange(len(TIME))], ids=["ms", "rows"])
def test_a_matrix_whose_first_column_may_not_be_seconds_is_refused(tmp_path, suffix, along) -> None:
    path, matrix = tmp_path / f"run{suffix}", np.column_stack([along, VALUES])
    write = {".npy": np.save, ".npz": lambda path, a: np.savez(path, a=a)}
    write.get(suffix, lambda path, a: savemat(path, {"a": a}))(path, matrix)
    with pytest.raises(SceneError, match=r"has a time every .* without a unit"):
        of_record(path, unit="g")
    np.savez(tmp_path / "of.npz", run_mg=np.column_stack([TIME, VALUES]))
    with pytest.raises(SceneError, match=r"is 'm/s2', but the name run_mg in .* says 'mg'"):
        of_record(tmp_path / "of.npz", unit="m/s2")


def test_times_of_a_uff_file_without_a_unit_may_be_milliseconds(tmp_path: Path) -> None:
    path = write_uff(tmp_path / "run.uff", (TIME_RESPONSE, "floor", 1e3 * TIME, VALUES, "g"))
    with pytest.raises(SceneError, match="has a time every 5 in dataset 1, without a unit"):
        of_record(path)


@pytest.mark.parametrize("suffix", [".npz", ".mat"])
def test_complex_values_are_listed_and_never_replaced_by_the_times(tmp_path, suffix) -> None:
    write = savemat if suffix == ".mat" else lambda path, held: np.savez(path, **held)
    path = tmp_path / f"run{suffix}"
    write(path, {"t": TIME, "acc_g": VALUES + 1j})
    with pytest.raises(SceneError, match=r"acc_g \(\d+, complex\)$"):
        of_record(path)
    with pytest.raises(SceneError, match="names 'acc_g', which is complex in"):
        of_record(path, variables=["t", "acc_g"])
    write(path, {"t": TIME, "acc_g": VALUES + 0j})
    assert of_record(path).record.fs == 200.0


def test_a_complex_density_without_imaginary_parts_is_real(tmp_path: Path) -> None:
    import pyuff

    keys = list(inspect.signature(pyuff.prepare_58).parameters)
    entry = {key: "" if key.endswith(("name", "lab")) else 0 for key in keys[1:41]}
    entry |= {f"id{n}": "floor" for n in range(1, 6)}
    entry |= {
        "type": 58, "binary": 0, "func_type": 9, "ord_data_type": 6, "num_pts": 5,
        "data": np.full(5, 0.1 + 0j), "x": np.arange(5) * 10.0, "abscissa_spacing": 1,
        "abscissa_inc": 10.0, "ordinate_axis_units_lab": "g^2/Hz",
    }  # fmt: skip
    for imaginary, real in ((0.0, True), (1e-3, False)):
        path = tmp_path / f"density{imaginary}.uff"
        pyuff.UFF(str(path)).write_sets(entry | {"data": entry["data"] + 1j * imaginary}, "add")
        if real:
            found = read_columns(path, ("frequency_hz", "density"), function_type=SPECTRAL_DENSITY)
            np.testing.assert_allclose(found.y, 0.1)
        else:
            with pytest.raises(SceneError, match="is complex, expected the real column density"):
                read_columns(path, ("frequency_hz", "density"), function_type=SPECTRAL_DENSITY)


def test_a_record_of_another_quantity_is_told_by_what_the_file_says(tmp_path: Path) -> None:
    path = write_uff(tmp_path / "run.uff", (TIME_RESPONSE, "floor", TIME, VALUES, "Pa"))
    with pytest.raises(SceneError, match=r"unit must be one of g, m/s2, N, but dataset 1 .*'Pa'"):
        of_record(path)
    assert any("'Pa'" in each for each in of_record(path, unit="g").cautions(0.0, 0.0))


def test_a_loggers_recording_is_read_by_its_channels(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "run.ide"
    path.write_bytes(b"\x1a\x45\xdf\xa3 no recording")
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(SceneError, match=r"needs the package idelib: pip install 'stochvi\[ide\]'"):
        of_record(path)
    monkeypatch.setattr("importlib.util.find_spec", lambda name: name)
    channels = [
        readers.Foreign(name, TIME, VALUES, {"of": "40g DC", "unit": "g"})
        for name in ("X (40g)", "Y (40g)")
    ]
    monkeypatch.setattr("stochvi.scenes.readers.read_foreign", lambda *_: tuple(channels))
    with pytest.raises(SceneError, match=r"1 X \(40g\) of 40g DC; 2 Y \(40g\) of 40g DC"):
        of_record(path)
    assert of_record(path, column=2).record == of_record(path, column="Y (40g)").record
    assert of_record(path, column=1).density_unit == "g2/Hz"


def test_a_channel_of_a_logger_is_read_in_seconds(tmp_path: Path) -> None:
    class Session:
        def arraySlice(self) -> np.ndarray:
            return np.array([1e6 * TIME, VALUES])

    class Part:
        name, units = "X", ("Acceleration", "g")

        def getSession(self) -> Session:
            return Session()

    class Recording:
        def __init__(self) -> None:
            parts = {"name": "40g", "subchannels": [Part(), Part()]}
            self.channels = {8: type("Channel", (), parts)()}

        def __enter__(self) -> Recording:
            return self

        def __exit__(self, *_: object) -> None: ...

    module = type(sys)("idelib")
    module.importFile = lambda path: Recording()  # type: ignore[attr-defined]
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(sys.modules, "idelib", module)
        one, two = foreign_reader.ide("run.ide")
    np.testing.assert_allclose(one["x"], TIME)
    assert json.dumps({**one, "x": 0, "y": 0}) and two["of"] == "40g"


@pytest.mark.parametrize("spelling", ["m**9**9**9**9", "((((h**9)**9)**9)**9)", "km^9^9^9"])
def test_a_unit_of_towering_powers_is_no_unit(spelling: str) -> None:
    with pytest.raises(ValueError, match="is not a known unit"):
        unit(spelling)


def test_a_quoted_cell_without_end_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    rows = "".join(f"{n / 100},{n % 3}\n" for n in range(300))
    path.write_text(rows + '3.01,"' + "1" * 140_000 + "\n")
    with pytest.raises(SceneError, match="line 301: expected a number in column 2"):
        read_columns(path, RECORD, function_type=TIME_RESPONSE)


@pytest.mark.parametrize("delimiter", [",", ";", "\t", "  "])
def test_a_million_columns_are_refused_before_their_cells_are_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, delimiter: str
) -> None:
    """Each of three million cells was looked at five times, for 17 s."""
    path = tmp_path / "run.csv"
    path.write_text((("1" + delimiter) * 100_000 + "1\n") * 3)
    with monkeypatch.context() as patch:
        patch.setattr(text_tables, "count_values", lambda _: pytest.fail("a cell was read"))
        with pytest.raises(SceneError, match="columns, got 100001;"):
            read_columns(path, RECORD, function_type=TIME_RESPONSE)
    # the negative control: thousands of columns are read, cell by cell
    path.write_text(
        "".join(f"{n / 100}{delimiter}" + f"{n % 3}{delimiter}" * 5_000 + "1\n" for n in range(3))
    )
    found = read_columns(path, RECORD, column=4_000, function_type=TIME_RESPONSE)
    assert found.y.tolist() == [0.0, 1.0, 2.0]


@pytest.mark.parametrize("word", ["m/s2 ", "m/s2*", "(", " "])
def test_a_towering_heading_is_neither_searched_nor_repeated(tmp_path: Path, word: str) -> None:
    """Of 40,000 words each was taken for the start of a unit that ends with the last: minutes."""
    path = tmp_path / "run.csv"
    rows = "".join(f"{n / 200:g},{value}\n" for n, value in enumerate(VALUES))
    for heading in (f"t (s),a ({word * 40_000}m)", f"t ({word * 40_000}s),a (g)"):
        path.write_text(f"{heading}\n{rows}")
        for keys in ({}, {"unit": "g"}):
            began = time.process_time()
            try:
                told = " ".join(of_record(path, **keys).cautions(0.0, 0.0))
            except SceneError as error:
                told = str(error)
            assert time.process_time() - began < 3.0 and len(told) < 800 + 3 * len(str(path))


@pytest.mark.parametrize(
    "secret", ["root:x:0:0:root", "-----BEGIN PRIVATE KEY-----", "password 1 hunter2"]
)
def test_a_refusal_shows_no_text_of_a_file_that_is_no_table(tmp_path: Path, secret: str) -> None:
    """A scene of somebody else may name any file that its reader may read."""
    path = tmp_path / "secret"
    path.write_text(f"{secret}\n{secret}\n")
    for names in (RECORD, ("acceleration",), ("deflection", "force")):
        with pytest.raises(SceneError) as failure:
            read_columns(path, names, function_type=TIME_RESPONSE)
        told = str(failure.value).replace(str(path), "")
        assert not any(word in told for word in (secret, "hunter2", "PRIVATE", "root"))


# ------------------------------------------------------------------------------
# A structure whose matrices come from a file, or whose damping is a ratio.
# ------------------------------------------------------------------------------


MASS = np.array([[2.0, 0.3], [0.3, 1.0]])
STIFFNESS = 1e4 * np.array([[2.0, -1.0], [-1.0, 1.0]])
DAMPING = np.array([[3.0, -1.0], [-1.0, 2.0]])
HELD = {"MAA": MASS, "KAA": STIFFNESS, "BAA": DAMPING}
NAMES_OF_MATRIX_FILES = {"mass": "MAA", "stiffness": "kaa", "damping": "BAA"}


def write_npz(path: Path) -> None:
    np.savez(path, **HELD)


def write_mat(path: Path) -> None:
    savemat(path, HELD)


def write_op4(path: Path, *, binary: bool = True) -> None:
    # pyYeti changes how numpy prints all arrays of its process, and a table then loses digits
    with np.printoptions():
        from pyyeti.nastran import op4

        op4.write(str(path), HELD, binary=binary)


def write_text(path: Path) -> None:
    write_op4(path, binary=False)


@pytest.mark.usefixtures("apart")
def test_files_of_others_leave_the_printing_of_numbers_alone(tmp_path: Path) -> None:
    write_op4(tmp_path / "model.op4")
    Matrices(file=str(tmp_path / "model.op4"), **NAMES_OF_MATRIX_FILES)
    assert np.get_printoptions()["legacy"] is False and repr(np.ones(1)) == "array([1.])"


WRITERS = {".npz": write_npz, ".mat": write_mat, ".op4": write_op4}


@pytest.mark.parametrize("write", [write_npz, write_mat, write_op4, write_text])
def test_a_file_gives_the_matrices_that_were_written(
    write: Callable[[Path], None], tmp_path: Path
) -> None:
    ending = next((end for end, each in WRITERS.items() if each is write), ".op4")
    write(tmp_path / f"model{ending}")
    scene = tmp_path / "scene.toml"
    scene.write_text(
        f'[structure]\nkind = "matrices"\nfile = "model{ending}"\nmass = "MAA"\n'
        'stiffness = "KAA"\ndamping = "BAA"\n\n'
        '[[excitation]]\nkind = "white"\non = "x2"\nintensity = 1.0\n',
        encoding="utf-8",
    )
    found = load_scene(scene).structure
    assert isinstance(found, Matrices)
    assert found.coordinates == ("x1", "x2") and found.source == f"model{ending}"
    for own, matrix in zip((MASS, DAMPING, STIFFNESS), found.matrices, strict=True):
        np.testing.assert_allclose(matrix, own, rtol=1e-15)


def test_a_damping_ratio_is_that_of_every_mode(tmp_path: Path) -> None:
    write_npz(tmp_path / "model.npz")
    found = Matrices(
        file=str(tmp_path / "model.npz"), mass="MAA", stiffness="KAA", zeta=0.03,
        coordinates=["seat", "tip"],
    )  # fmt: skip
    mass, damping, stiffness = found.matrices
    first = np.block(
        [[np.zeros((2, 2)), np.eye(2)],
         [-np.linalg.solve(mass, stiffness), -np.linalg.solve(mass, damping)]]
    )  # fmt: skip
    poles = np.linalg.eigvals(first)
    assert found.coordinates == ("seat", "tip")
    np.testing.assert_allclose(-poles.real / np.abs(poles), 0.03, rtol=1e-10)
    omega = np.sqrt(scipy.linalg.eigh(STIFFNESS, MASS, eigvals_only=True))
    np.testing.assert_allclose(np.sort(np.abs(poles))[::2], omega, rtol=1e-10)


@pytest.mark.parametrize(
    ("keys", "sentence"),
    [
        ({}, "has no matrix 'mass' for mass: it has MAA, KAA, BAA; write mass = \"NAME\""),
        ({"mass": "MAA", "stiffness": "KAA"}, "or zeta in the place of damping"),
        (
            NAMES_OF_MATRIX_FILES | {"zeta": 0.1},
            "needs exactly one of damping and zeta, got damping, zeta",
        ),
        (NAMES_OF_MATRIX_FILES | {"coordinates": ["tip"]}, "needs mass with 1 rows and columns"),
    ],
)
def test_a_file_without_what_is_needed_is_refused(
    keys: dict[str, Any], sentence: str, tmp_path: Path
) -> None:
    write_npz(tmp_path / "model.npz")
    with pytest.raises(SceneError) as refused:
        Matrices(file=str(tmp_path / "model.npz"), **keys)
    assert sentence in str(refused.value)


@pytest.mark.parametrize("ending", [".txt", ".op4"])
def test_a_file_of_another_kind_is_refused(ending: str, tmp_path: Path) -> None:
    path = tmp_path / f"model{ending}"
    path.write_bytes(b"no matrices")
    with pytest.raises(SceneError, match=r"must end in one of|is not a Nastran matrices file"):
        Matrices(file=str(path))


def test_the_schema_takes_a_file_or_matrices() -> None:
    found = scene_schema()["$defs"]["Matrices"]
    assert found["required"] == ["kind"] and {"required": ["file"]} in found["anyOf"]


def test_rounding_in_place_of_zeros_is_symmetric() -> None:
    """As of a reduction; the judge is the same structure with its zeros."""
    keys = {"coordinates": ["a", "b", "c"], "zeta": 0.02}
    stiffness = [[3e4, -1e4, 0.0], [-1e4, 2e4, -5e3], [0.0, -5e3, 1.7e4]]
    mass = np.array([[2.0, 0.0, 0.1], [0.0, 1.0, 0.2], [0.1, 0.2, 0.8]])
    plain = Matrices(**keys, mass=mass.tolist(), stiffness=stiffness)
    mass[0, 1], mass[1, 0] = 1.2e-17, -3.1e-17
    rounded = Matrices(**keys, mass=mass.tolist(), stiffness=stiffness)
    for one, other in zip(plain.matrices, rounded.matrices, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-12, atol=1e-12)
        assert np.abs(other - other.T).max() <= 1e-12 * np.abs(other).max()
    assert (rounded.matrices[0] == rounded.matrices[0].T).all()
    mass[0, 1] = 1e-6
    with pytest.raises(SceneError, match=r"symmetric matrix mass, got 1e-06 in row 1, column 2"):
        Matrices(**keys, mass=mass.tolist(), stiffness=stiffness)


# ------------------------------------------------------------------------------
# What ships with the package, and tables of numbers in text files.
# ------------------------------------------------------------------------------


def test_every_profile_file_is_in_the_index_and_every_entry_has_its_file():
    folder = data_folder() / "psd_profiles"
    files = {path.stem for path in folder.glob("*.csv")} - {"index"}
    assert files == set(profiles())


@pytest.mark.parametrize("profile", profiles().values(), ids=profiles().keys())
def test_a_profile_is_a_table_with_a_source_in_the_unit_that_its_header_says(profile):
    header = (data_folder() / "psd_profiles" / f"{profile.name}.csv").read_text("utf-8")
    assert header.splitlines()[0] == "frequency_hz,density_g2_per_hz"
    assert list(profile.frequency_hz) == sorted(set(profile.frequency_hz))
    assert len(profile.frequency_hz) == len(profile.density) >= 2
    assert min(profile.density) > 0.0
    assert profile.source


def test_the_motion_of_the_tower_that_its_comment_states():
    path = shipped_scene("absorber-on-a-tower")
    stated = re.search(r"rms displacement without absorber about (\S+) m", path.read_text("utf-8"))
    given = tomllib.loads(path.read_text("utf-8"))
    mass, omega = given["structure"]["mass"], 2.0 * math.pi * given["structure"]["frequency_hz"]
    damping = 2.0 * given["structure"]["zeta"] * omega * mass
    intensity = given["excitation"][0]["intensity"]
    rms = math.sqrt(intensity / (2.0 * damping * mass * omega**2))
    assert float(f"{rms:.1g}") == float(stated[1])


def test_a_scene_that_does_not_ship_is_answered_with_those_that_do():
    with pytest.raises(SceneError, match=r"'oscillator' does not ship; known: .*lossy"):
        shipped_scene("oscillator")


def test_the_reference_table_says_what_it_holds_and_in_which_units():
    lines = (data_folder() / "reference" / "rigid_stops.csv").read_text("utf-8").splitlines()
    assert lines[0].startswith("# omega 1, b 0.1, S0 0.2, stops at -1 and 1")
    widths = {len(row) for row in csv.reader(lines[1:])}
    assert len(widths) == 1


# ------------------------------------------------------------------------------
# The spectrum of one scene as the excitation of another.
# ------------------------------------------------------------------------------


CARRIER = Matrices(
    coordinates=["body", "wheel"],
    mass=[[300.0, 0.0], [0.0, 40.0]],
    damping=[[1500.0, -1500.0], [-1500.0, 2500.0]],
    stiffness=[[2e4, -2e4], [-2e4, 2e5]],
)
SHAKEN = TabulatedNoise(on="base", frequency_hz=[0.3, 40.0], density=[1.0, 1.0], unit="(m/s2)2/Hz")
BOX = Isolator(frequency_hz=6.0, zeta=0.2)


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("spectra") / "spectrum.csv"
    found = spectrum(Scene(structure=CARRIER, excitations=[SHAKEN]), paths=64, highest=30.0)
    write_table(found.to_frame(), path)
    return path


def through_both(coordinate: str) -> float:
    """Mean square stroke of the box on a coordinate of the carrier, m^2: by frequency responses."""
    mass, damping, stiffness = CARRIER.matrices
    f = np.linspace(0.3, 30.0, 60_001)
    inverse = np.linalg.inv(mass)
    moved = gains(f, inverse @ stiffness, inverse @ damping, -np.ones(2))
    w = 2.0 * np.pi * f
    absolute = 1.0 - w**2 * moved[:, CARRIER.coordinates.index(coordinate)]
    stroke = absolute / (BOX.omega**2 - w**2 + 1j * w * BOX.damping_rate)
    return float(np.trapezoid(np.abs(stroke) ** 2, f))


def estimated(path: Path, of: str) -> Estimate:
    """Mean square stroke of the box under the table, with its error from those of the bins."""
    noise = TabulatedNoise(on="base", file=str(path), of=of)
    scene = Scene(structure=BOX, excitations=[noise])
    table = pd.read_csv(path)
    table = table[(table["of"] == of) & (table["quantity"] == "acceleration")]
    w = 2.0 * np.pi * table["frequency_hz"].to_numpy()
    weight = np.gradient(w / (2.0 * np.pi))
    weight /= np.abs(BOX.omega**2 - w**2 + 1j * w * BOX.damping_rate) ** 2
    return Estimate(
        value=exact(scene).coordinates["x"]["displacement_mean_square"].value,
        # Hann's window ties neighbours: correlations of 4/9 and 1/36, on either side
        standard_error=float(np.sqrt(1.95 * np.sum((weight * table["standard_error"]) ** 2))),
        bias=float(np.sum(weight * table["bias"])),
    )


@pytest.mark.parametrize("of", ["body", "wheel"])
def test_a_box_on_a_coordinate_moves_as_through_both_gains(written: Path, of: str) -> None:
    found, other = estimated(written, of), {"body": "wheel", "wheel": "body"}[of]
    assert_agrees(found, through_both(of))
    assert found.standard_error < 0.05 * found.value
    with pytest.raises(AssertionError, match="standard errors"):
        assert_agrees(found, through_both(other))


def test_the_error_of_the_estimate_is_told(written: Path) -> None:
    noise = TabulatedNoise(on="base", file=str(written), of="body")
    (said,) = noise.cautions(1.0, 0.1)
    assert "acceleration of body, estimated by simulation" in said
    assert noise.density_unit == "(m/s2)2/Hz"
    plain = TabulatedNoise(on="base", profile="mil-std-810h-truck-vertical-5hz")
    assert not plain.cautions(1.0, 0.1)


def test_a_scene_file_names_the_spectrum_in_its_folder(written: Path) -> None:
    scene = written.parent / "box.toml"
    scene.write_text(
        '[structure]\nkind = "isolator"\nfrequency_hz = 6.0\nzeta = 0.2\n'
        '[[excitation]]\nkind = "psd"\nfile = "spectrum.csv"\nof = "body"\n',
        encoding="utf-8",
    )
    loaded = load_scene(scene)
    again = Scene(**loaded.document())
    assert loaded.excitations[0].table == again.excitations[0].table
    (louder,) = loaded.at_level(10.0).excitations
    np.testing.assert_allclose(louder.table.density, 10.0 * loaded.excitations[0].table.density)


test_a_choice_that_is_not_there_is_refused = refusals(
    lambda written, keys: TabulatedNoise(on="base", file=str(written), **keys),
    ({}, "must say whose acceleration is meant: 'body' or 'wheel'"),
    ({"of": "boot"}, "must be 'body' or 'wheel', got 'boot'"),
    ({"of": "body", "unit": "g2/Hz"}, "take out the one that is wrong"),
)


def test_of_is_refused_for_other_tables(tmp_path: Path) -> None:
    table = tmp_path / "table.csv"
    table.write_text("frequency_hz,density\n1,2\n3,4\n", encoding="utf-8")
    with pytest.raises(SceneError, match=r"of chooses a coordinate of a spectrum\.csv"):
        TabulatedNoise(on="base", file=str(table), of="body", unit="g2/Hz")
    with pytest.raises(SceneError, match="has of"):
        TabulatedNoise(on="base", frequency_hz=[1.0, 2.0], density=[1.0, 1.0], unit="g2/Hz", of="x")


def test_the_only_coordinate_of_a_file_need_not_be_named(written: Path, tmp_path: Path) -> None:
    lines = written.read_text(encoding="utf-8").splitlines()
    path = tmp_path / "spectrum.csv"
    path.write_text("\n".join(each for each in lines if "wheel" not in each), encoding="utf-8")
    whole = TabulatedNoise(on="base", file=str(written), of="body")
    assert TabulatedNoise(on="base", file=str(path)).table == whole.table


def test_a_spectrum_without_acceleration_is_refused(written: Path, tmp_path: Path) -> None:
    lines = written.read_text(encoding="utf-8").splitlines()
    path = tmp_path / "spectrum.csv"
    kept = [line for line in lines if ",acceleration," not in line]
    path.write_text("\n".join(kept), encoding="utf-8")
    with pytest.raises(SceneError, match="holds no absolute acceleration"):
        TabulatedNoise(on="base", file=str(path), of="body")
