"""Answers on disk: whole or not at all, and never NaN."""

from __future__ import annotations

import csv
import errno
import io
import json
import math
import os
import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest

from stochvi.results import atomic_files
from stochvi.results.atomic_files import write_whole
from stochvi.results.deadline import Deadline, of_command
from stochvi.results.errors import NotConverged, TargetError
from stochvi.views.files import (
    folder_in,
    kept_inputs,
    to_json,
    try_picture,
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
    monkeypatch.setattr(atomic_files, "REPLACE_PAUSE", 0.0)
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
