"""Tables for MATLAB and as UFF, and reports as PDF: what was written is read again by others."""

from __future__ import annotations

import json
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import pyuff
from click.testing import CliRunner
from pypdf import PdfReader
from scipy.io import loadmat

from stochvi.cli import main
from stochvi.scenes.datasets import data_folder
from stochvi.scenes.readers import read_columns
from stochvi.views.files import also_written, write_table
from stochvi.views.other_formats import functions_of, missing_for_pdf, uff_of

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
    assert len(pages) >= 3 and f"Clearance: {1e3 * made:g}" in text.replace("\u00a0", " ")
    assert "Revision and signatures" in text


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
