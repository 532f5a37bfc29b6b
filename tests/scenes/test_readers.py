"""Files of instruments: what is read, and the sentence for what leaves a choice or is broken."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.io import savemat

from stochvi.mathematics.units import STANDARD_GRAVITY
from stochvi.results.errors import SceneError
from stochvi.scenes.excitations import RecordedNoise, TabulatedNoise
from stochvi.scenes.readers import TIME_RESPONSE, read_columns
from support.uff import write_uff

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
