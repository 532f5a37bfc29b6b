"""Answers on disk: whole or not at all, and never NaN."""

from __future__ import annotations

import csv
import errno
import io
import json
import math
import os
import signal
import sys
import warnings
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest
import pyuff
from click.testing import CliRunner
from pypdf import PdfReader
from scipy.io import loadmat

from stochvi.cli import main
from stochvi.results import files
from stochvi.results.deadline import Deadline, of_command
from stochvi.results.errors import Interrupted, NotConverged, TargetError
from stochvi.results.files import write_whole
from stochvi.scenes.datasets import data_folder
from stochvi.scenes.readers import read_columns
from stochvi.views.files import (
    also_written,
    folder_in,
    functions_of,
    kept_inputs,
    missing_for_pdf,
    to_json,
    try_picture,
    uff_of,
    write_json,
    write_picture,
    write_table,
    write_text,
)
from support.accuracies import quick_cases


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_json_refuses_what_is_not_a_number_and_leaves_no_file(tmp_path: Path, bad: float):
    with pytest.raises(ValueError, match="not JSON compliant"):
        write_json({"value": [bad]}, str(tmp_path / "answer.json"))
    assert list(tmp_path.iterdir()) == []


def test_json_reads_back_with_all_digits(tmp_path: Path):
    document = {"value": 0.1 + 0.2, "name": "Rück", "none": None}
    write_json(document, str(tmp_path / "new" / "answer.json"))
    assert json.loads((tmp_path / "new" / "answer.json").read_text("utf-8")) == document


def test_a_dash_means_standard_output(capsys: pytest.CaptureFixture[str]):
    write_json({"value": 1.5}, "-")
    out, err = capsys.readouterr()
    assert json.loads(out) == {"value": 1.5}
    assert err == ""


def test_a_stream_that_knows_few_characters_gets_escapes(monkeypatch):
    """The standard output of Windows is often cp1252."""
    narrow = io.TextIOWrapper(io.BytesIO(), encoding="cp1252")
    monkeypatch.setattr(sys, "stdout", narrow)
    document = {"title": "箱", "value": 0.1 + 0.2}
    write_json(document, "-")
    narrow.flush()
    assert json.loads(narrow.buffer.getvalue()) == document


def test_a_file_is_replaced_whole(tmp_path: Path):
    path = tmp_path / "table.csv"
    path.write_text("old and long", encoding="utf-8")
    write_text("new", path)
    assert path.read_text("utf-8") == "new"
    assert list(tmp_path.iterdir()) == [path]


def test_a_file_that_cannot_be_replaced_stays_as_it_was(tmp_path: Path, monkeypatch):
    path = tmp_path / "table.csv"
    path.write_text("old", encoding="utf-8")

    def fail(*names: str) -> None:
        raise OSError("disk full")

    monkeypatch.setattr(os, "replace", fail)
    with pytest.raises(OSError, match="disk full"):
        write_text("new", path)
    assert path.read_text("utf-8") == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_a_file_that_is_open_elsewhere_for_a_moment_is_replaced(tmp_path: Path, monkeypatch):
    """Windows refuses to replace a file that another program has open."""
    (tmp_path / "table.csv").touch()
    whole, refusals = os.replace, [PermissionError(errno.EACCES, "Access is denied")] * 2

    def refuse_twice(*names: str) -> None:
        if refusals:
            raise refusals.pop()
        whole(*names)

    monkeypatch.setattr(os, "replace", refuse_twice)
    monkeypatch.setattr(files, "REPLACE_PAUSE", 0.0)
    write_text("new", tmp_path / "table.csv")
    assert (tmp_path / "table.csv").read_text("utf-8") == "new"


def test_a_table_ends_its_lines_alike_on_every_system(tmp_path: Path, monkeypatch):
    monkeypatch.setattr(os, "linesep", "\r\n")
    write_table(pd.DataFrame({"value": [1.0, 2.0]}), tmp_path / "table.csv")
    assert (tmp_path / "table.csv").read_bytes() == b"value\n1.0\n2.0\n"


def test_an_error_names_the_file_that_was_asked_for(tmp_path: Path, monkeypatch):
    """Not the hidden one beside it, nor none."""

    def full(handle: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match=r"No space left on device.*run") as error:
        write_whole(b"new", tmp_path / "run", durable=True)
    assert error.value.filename == str(tmp_path / "run")
    assert list(tmp_path.iterdir()) == []


def test_a_text_that_cannot_be_encoded_leaves_no_file(tmp_path: Path):
    with pytest.raises(UnicodeEncodeError):
        write_text("\ud800", tmp_path / "table.csv")
    assert list(tmp_path.iterdir()) == []


def test_a_folder_is_not_a_file_to_write(tmp_path: Path):
    with pytest.raises(IsADirectoryError, match="expected a file name"):
        write_text("new", tmp_path)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("folder", ["file", "file/inner"])
def test_a_file_is_not_a_folder_to_write_in(tmp_path: Path, folder: str):
    (tmp_path / "file").touch()
    with pytest.raises(NotADirectoryError, match="expected a folder"):
        write_text("new", tmp_path / folder / "table.csv")


def test_a_file_is_as_readable_as_any_other(tmp_path: Path):
    (tmp_path / "other").touch()
    write_text("new", tmp_path / "table.csv")
    assert (tmp_path / "table.csv").stat().st_mode == (tmp_path / "other").stat().st_mode


def test_a_table_keeps_all_digits(tmp_path: Path):
    frame = pd.DataFrame({"name": ["a, b", "c"], "value": [0.1 + 0.2, 1e-300]})
    write_table(frame, tmp_path / "table.csv")
    again = pd.read_csv(tmp_path / "table.csv")
    pd.testing.assert_frame_equal(again, frame, check_exact=True)


def test_a_picture_is_a_png_and_its_figure_is_closed(tmp_path: Path):
    figure, ax = plt.subplots()
    write_picture(ax, tmp_path / "new" / "picture.png")
    assert (tmp_path / "new" / "picture.png").read_bytes().startswith(b"\x89PNG")
    assert not plt.fignum_exists(figure.number)


def test_the_text_of_json_is_one_document():
    assert json.loads(to_json({"a": {"b": [1, 2.5, None]}})) == {"a": {"b": [1, 2.5, None]}}


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="the file system has no links or pipes")
def test_a_link_or_pipe_in_a_folder_of_answers_is_replaced_not_followed(tmp_path: Path):
    outside, out = tmp_path / "outside", tmp_path / "out"
    outside.write_text("mine", encoding="utf-8")
    out.mkdir()
    for name in ("table.csv", "picture.png"):
        (out / name).symlink_to(outside)
    os.mkfifo(out / "text.txt")
    write_table(pd.DataFrame({"value": [1.0]}), out / "table.csv")
    write_picture(plt.subplots()[1], out / "picture.png")
    write_text("new", out / "text.txt")  # a pipe without a reader would wait for ever
    assert outside.read_text("utf-8") == "mine"
    assert all(path.is_file() and not path.is_symlink() for path in out.iterdir())


@pytest.mark.skipif(os.name == "nt", reason="Windows makes links for administrators alone")
def test_the_file_of_a_json_document_may_be_a_link_but_a_folder_of_answers_not(tmp_path: Path):
    (tmp_path / "latest").symlink_to(tmp_path / "run.json")
    write_json({"value": 1}, str(tmp_path / "latest"))
    assert (tmp_path / "latest").is_symlink()
    assert json.loads((tmp_path / "run.json").read_text("utf-8")) == {"value": 1}
    (tmp_path / "rows").symlink_to(tmp_path.parent)
    with pytest.raises(TargetError, match="rows is a link"):
        folder_in(tmp_path, "rows")
    assert folder_in(tmp_path, "others") == tmp_path / "others"


def test_what_a_command_reads_is_not_replaced_by_its_answer(tmp_path: Path):
    table, link = tmp_path / "spectrum.csv", tmp_path / "link.csv"
    table.write_text("mine", encoding="utf-8")
    os.link(table, link)
    with kept_inputs([table]):
        for path in (table, link):
            with pytest.raises(TargetError, match="is read by this command"):
                write_text("new", path)
        write_text("new", tmp_path / "other.csv")
    assert table.read_text("utf-8") == "mine"
    write_text("new", table)


def test_a_picture_that_cannot_be_drawn_costs_a_warning(tmp_path: Path):
    def fail() -> plt.Axes:
        plt.figure()
        raise RuntimeError("no such letter")

    before = plt.get_fignums()
    with pytest.warns(UserWarning, match="density.png could not be drawn"):
        try_picture(fail, tmp_path / "density.png")
    assert list(tmp_path.iterdir()) == [] and plt.get_fignums() == before


@quick_cases("name", [r"$\frac{$", "a" * 300, "$x$", "a$b", r"\$x$"], keep=(0, 4))
def test_names_in_pictures_are_shown_letter_by_letter(tmp_path: Path, name: str):
    figure, ax = plt.subplots(layout="constrained")
    ax.plot([1.0, 1e3], [1e-5, 1e5], label=name)
    ax.set(xlabel=name, ylabel=name, title=name, xscale="log", yscale="log")
    ax.legend()
    figure.suptitle(name)
    write_picture(ax, tmp_path / "picture.png")
    assert ax.get_title().replace("\n", "")[:60] == name[:60]
    assert not ax.title.get_parse_math()
    assert len(ax.get_title()) < 150
    assert "mathdefault" in ax.get_xticklabels()[0].get_text()
    assert ax.get_xticklabels()[0].get_parse_math()  # a power of ten stays one


@pytest.mark.parametrize("lowest", [0.0, 1e-300, 1e-5])
def test_a_band_that_touches_zero_does_not_stretch_a_logarithmic_axis(tmp_path: Path, lowest):
    _, ax = plt.subplots()
    x = np.array([1.0, 2.0, 3.0])
    ax.plot(x, [1e-3, 1e-2, 1e-4])
    ax.fill_between(x, np.maximum([lowest, 1e-3, lowest], 1e-300), 0.1)
    ax.set_yscale("log")
    write_picture(ax, tmp_path / "picture.png")
    low, high = ax.get_ylim()
    assert low < 1e-4 and high > 1e-2 and high < 1e12 * low


def test_a_long_table_is_not_written_beyond_the_budget_of_its_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("stochvi.results.deadline.OVERDUE_SECONDS", 0.06)
    frame = pd.DataFrame(np.random.default_rng(1).normal(size=(150_000, 3)), columns=list("abc"))
    with (
        of_command(Deadline.after(1e-3)),
        pytest.raises(NotConverged, match=r"ended before table\.csv was written; raise budget"),
    ):
        write_table(frame, tmp_path / "table.csv")
    assert not list(tmp_path.iterdir())
    with of_command(Deadline.after(600.0)):  # and within it, it is
        write_table(frame[:21_000], tmp_path / "table.csv")
    assert len((tmp_path / "table.csv").read_text().splitlines()) == 21_001


def test_a_long_table_is_not_written_to_its_end_after_ctrl_c(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a command without a budget; a table that takes no time is written."""

    def pressed(frame: pd.DataFrame, *_: object) -> pd.DataFrame:
        signal.raise_signal(signal.SIGINT)
        return frame

    monkeypatch.setattr("stochvi.results.deadline.OVERDUE_SECONDS", 0.06)
    monkeypatch.setattr("stochvi.views.files.in_chosen_units", pressed)
    frame = pd.DataFrame(np.random.default_rng(1).normal(size=(150_000, 3)), columns=list("abc"))
    with (
        of_command(Deadline.after(None)),
        pytest.raises(Interrupted, match=r"by Ctrl-C before table\.csv was written"),
    ):
        write_table(frame, tmp_path / "table.csv")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("end", ["\r", "\n", "\r\n", "\u2028", "\x0b"])
def test_a_name_with_a_line_end_stays_in_its_cell(tmp_path: Path, end: str) -> None:
    frame = pd.DataFrame({"pair": [f"{end}=1+1", f"a{end}=1+1"], "x": [1.0, 2.0]})
    write_table(frame, tmp_path / "table.csv")
    text = (tmp_path / "table.csv").read_bytes().decode()
    assert [row.split(",") for row in text.splitlines()] == [
        ["pair", "x"], ["' =1+1", "1.0"], ["a =1+1", "2.0"],
    ]  # fmt: skip


@pytest.mark.parametrize("cell", ["\uff1d1+1", "\uff0b1+1", "\uff0d1+1", "\uff20SUM(A1)", " =1+1",
                                  "\u00a0 =1+1", "  -1+cmd"])  # fmt: skip
def test_signs_of_full_width_and_blanks_do_not_hide_a_formula(tmp_path: Path, cell: str) -> None:
    write_table(pd.DataFrame({"pair": [cell]}), tmp_path / "table.csv")
    assert (tmp_path / "table.csv").read_text("utf-8") == f"pair\n'{cell}\n"


def test_no_text_of_a_table_is_a_formula_for_a_spreadsheet(tmp_path: Path) -> None:
    """Names of pairs and coordinates come from scenes that others write."""
    formulas = ["=HYPERLINK(1)", "+1+cmd", "-1+cmd", "@SUM(A1)", "\t=1"]
    frame = pd.DataFrame({"pair": [*formulas, "stops"], "value": np.arange(6.0) - 3.0})
    frame["=x (m)"] = ["-0.5", "-", "+", "1e-3", "", None]
    write_table(frame, tmp_path / "table.csv")
    with (tmp_path / "table.csv").open(newline="", encoding="utf-8") as file:
        header, *rows = csv.reader(file)
    assert header == ["pair", "value", "'=x (m)"]
    assert [row[0] for row in rows] == [*(f"'{each}" for each in formulas), "stops"]
    # numbers and signs alone stay as they are
    assert [row[2] for row in rows] == ["-0.5", "-", "+", "1e-3", "", ""]
    assert [float(row[1]) for row in rows] == [-3.0, -2.0, -1.0, 0.0, 1.0, 2.0]
    assert frame["pair"].tolist()[:5] == formulas


# ------------------------------------------------------------------------------
# Tables for MATLAB and as UFF, and reports as PDF: what was written is read again by others.
# ------------------------------------------------------------------------------


TRUCK = str(data_folder() / "scenes" / "isolator-truck.toml")
LOSSY = str(data_folder() / "scenes" / "oscillator-lossy.toml")


def run(*words: Any) -> tuple[int, str]:
    ended = CliRunner().invoke(main, [str(word) for word in words])
    return ended.exit_code, ended.output + str(ended.exception or "")


def test_a_time_history_is_the_same_in_all_forms(tmp_path: Path) -> None:
    words = ["history", LOSSY, "--duration", "3", "--rate", "64", "--out", tmp_path, "--quiet"]
    code, said = run(*words, "--formats", "mat,uff")
    assert code == 0, said
    table = next(
        path for path in tmp_path.glob("*.csv") if "displacement_m" in pd.read_csv(path).columns
    )
    expected = pd.read_csv(table)
    matlab = loadmat(table.with_suffix(".mat"))
    for column in expected:
        found = matlab[column.replace(".", "_")].ravel()
        np.testing.assert_array_equal(found, expected[column].to_numpy())
    sets = pyuff.UFF(str(table.with_suffix(".uff"))).read_sets()
    by_name = {each["id1"]: each for each in sets}
    assert set(by_name) == set(expected.columns) - {"time_s"}
    for column, each in by_name.items():
        np.testing.assert_allclose(each["x"], expected["time_s"], rtol=1e-6, atol=1e-12)
        np.testing.assert_allclose(each["data"], expected[column], rtol=1e-10, atol=1e-14)
    assert by_name["displacement_m"]["ordinate_axis_units_lab"] == "m"
    assert by_name["displacement_m"]["abscissa_axis_units_lab"] == "s"


def test_a_density_that_was_written_is_read_as_one(tmp_path: Path) -> None:
    frequency = np.array([5.0, 8.0, 20.0, 500.0])
    table = pd.DataFrame(
        {
            "of": "base", "quantity": "acceleration", "frequency_hz": frequency,
            "value": frequency**-0.5, "unit": "(m/s^2)^2/Hz",
        }
    )  # fmt: skip
    with also_written(["uff"]):
        write_table(table, tmp_path / "table.csv")
    found = read_columns(tmp_path / "table.uff", ("frequency_hz", "density"))
    np.testing.assert_allclose(found.x, frequency, rtol=1e-6)
    np.testing.assert_allclose(found.y, table["value"], rtol=1e-6)
    assert found.unit is not None and found.unit.name == "(m/s2)2/Hz"


def test_rows_of_one_text_are_a_function_and_others_are_none() -> None:
    rising = pd.DataFrame({"of": list("aabb"), "frequency_hz": [1.0, 2.0] * 2, "value": range(4)})
    assert uff_of(rising) is not None and uff_of(rising).count(b"    58") == 2
    assert uff_of(rising.drop(columns="of")) is None  # the frequency falls
    assert uff_of(rising.drop(columns="frequency_hz")) is None


def test_names_that_matlab_does_not_take_are_changed_and_none_is_lost(tmp_path: Path) -> None:
    columns = ["2nd (m)", "left.x", "left x", "a" * 80, "a" * 81]
    with also_written(["mat"]):
        write_table(pd.DataFrame([np.arange(5.0)], columns=columns), tmp_path / "table.csv")
    found = loadmat(tmp_path / "table.mat")
    names = [name for name in found if not name.startswith("__")]
    assert sorted(float(found[name].item()) for name in names) == [0.0, 1.0, 2.0, 3.0, 4.0]
    assert {"c2nd_m", "left_x", "left_x_2"} <= set(names) and max(map(len, names)) <= 63


def test_nothing_else_is_written_where_nothing_was_asked_for(tmp_path: Path) -> None:
    write_table(pd.DataFrame({"time_s": [0.0, 1.0], "x_m": [1.0, 2.0]}), tmp_path / "table.csv")
    assert [each.name for each in tmp_path.iterdir()] == ["table.csv"]


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["size", TRUCK, "--formats", "pdf"], "--formats needs --out"),
        (["simulate", TRUCK, "--out", "there", "--formats", "pdf"], "this one has none"),
        (["size", TRUCK, "--out", "there", "--formats", "xls"], "must be of mat, uff, pdf, got"),
    ],
)
def test_forms_that_cannot_be_written_are_refused_before_any_work(
    words: list[str], sentence: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    code, said = run(*words)
    assert code != 0 and sentence in said and not list(tmp_path.iterdir())


def test_a_report_as_pdf_has_pages(tmp_path: Path) -> None:
    if missing := missing_for_pdf():
        pytest.skip(missing)
    words = ["--probability", "10%", "--mission", "600", "--rel-error", "0.3", "--quiet"]
    code, said = run("size", TRUCK, *words, "--out", tmp_path, "--formats", "pdf")
    assert code == 0, said
    pages = PdfReader(tmp_path / "report.pdf").pages
    text = " ".join(" ".join(page.extract_text() for page in pages).split())
    made = json.loads((tmp_path / "size.json").read_text("utf-8"))["made"]["value"]
    assert len(pages) >= 3 and f"Make {1e3 * made:g}" in text.replace("\u00a0", " ")
    assert "Revision and signatures" in text
    front = " ".join(pages[0].extract_text().split())
    captions = "The scene with its stops", "any impact in the mission", "Approved"
    assert all(each in front for each in captions), "the sheet that is signed is whole"


def test_spectra_of_equipment_have_their_units() -> None:
    """The names of their columns state none: a file for programs does."""
    units = {
        "response_rms": "m/s^2", "extreme_response_bias": "m/s^2", "shock_worst": "m/s^2",
        "response_rms_standard_error_without_stops": "m/s^2", "fatigue_damage": "(m/s)^b",
        "equivalent_density": "(m/s^2)^2/Hz", "damage_ratio": "NONE",
    }  # fmt: skip
    table = pd.DataFrame({"equipment_frequency_hz": [10.0, 20.0]} | dict.fromkeys(units, 1.0))
    found = {each["id1"]: each for each in functions_of(table)}
    assert {name: each["ordinate_axis_units_lab"] for name, each in found.items()} == units
    assert found["response_rms"]["ordinate_spec_data_type"] == 12  # an acceleration
    assert found["equivalent_density"]["func_type"] == 9


def test_a_form_in_which_nothing_could_be_written_is_named(tmp_path: Path) -> None:
    numbers, rising = pd.DataFrame({"x_m": [1.0]}), pd.DataFrame({"time_s": [0.0, 1.0], "x_m": 1.0})
    with pytest.warns(UserWarning, match="no uff file was written"), also_written(["uff", "mat"]):
        write_table(numbers, tmp_path / "numbers.csv")
    with warnings.catch_warnings(), also_written(["uff"]):
        warnings.simplefilter("error")
        write_table(numbers, tmp_path / "numbers.csv")
        write_table(rising, tmp_path / "rising.csv")
    assert (tmp_path / "rising.uff").exists()
