"""What ships with the package, and tables of numbers in text files."""

from __future__ import annotations

import csv
import math
import re
import tomllib
from pathlib import Path

import pytest

from stochvi.results.errors import SceneError
from stochvi.scenes.datasets import data_folder, profiles, read_table, read_text, shipped_scene
from stochvi.scenes.scene import load_scene


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


@pytest.mark.parametrize("path", sorted((data_folder() / "scenes").glob("*.toml")))
def test_every_shipped_scene_is_valid_and_found_by_its_name(path: Path):
    assert shipped_scene(path.stem) == path
    assert load_scene(path).title


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


@pytest.mark.parametrize(
    "text",
    [
        "1,10\n2,20.5\n",
        "1 10\n2 20.5",
        "1\t10\r\n2\t20.5\r\n",
        "1;10\n2; 20.5\n",
        "frequency_hz,density\n1,10\n2,20.5\n",
        "# a comment\n\nHz g2/Hz\n1,10 # the first\n\n2,20.5\n",
        "\ufefff,G\n1,1e1\n2,2.05E+1\n",
    ],
    ids=["commas", "spaces", "tabs", "semicolons", "header", "comments", "byte-order mark"],
)
def test_a_table_of_two_columns_is_read_however_they_are_parted(tmp_path: Path, text: str):
    (tmp_path / "table.csv").write_text(text, encoding="utf-8", newline="")
    frequency, density = read_table(tmp_path / "table.csv")
    assert frequency.tolist() == [1.0, 2.0]
    assert density.tolist() == [10.0, 20.5]


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("1,O.1\n2,1\n", 1),
        ("5;0,01\n", 1),
        ("1,2,3\n", 1),
        ("f,G\n1;2;3\n1,1\n", 2),
        ("1,1\n2\n", 2),
        ("1,1\nend,0\n", 2),
    ],
    ids=[
        "typing error",
        "decimal commas",
        "three columns",
        "numbers in a header",
        "one cell",
        "a word",
    ],
)
def test_a_line_that_is_not_two_numbers_is_never_passed_over(tmp_path: Path, text, line):
    (tmp_path / "table.csv").write_text(text, encoding="utf-8")
    with pytest.raises(SceneError, match=rf"table\.csv, line {line}: expected two numbers"):
        read_table(tmp_path / "table.csv")


def test_a_file_of_the_largest_size_is_read_and_one_byte_more_is_not(tmp_path: Path, monkeypatch):
    monkeypatch.setattr("stochvi.scenes.datasets.LARGEST_TEXT_FILE", 8)
    (tmp_path / "fits").write_text("12345678", encoding="utf-8")
    (tmp_path / "does not").write_text("123456789", encoding="utf-8")
    assert read_text(tmp_path / "fits") == "12345678"
    with pytest.raises(SceneError, match="holds 9 bytes, expected a text of at most 8"):
        read_text(tmp_path / "does not")


def test_columns_in_another_order_than_their_heading_says_are_refused(tmp_path: Path) -> None:
    file = tmp_path / "swapped.csv"
    file.write_text("density,frequency_hz\n0.01,10\n0.02,100\n")
    with pytest.raises(SceneError, match="has the columns density, frequency_hz; expected"):
        read_table(file)
    file.write_text("frequency_hz density\n10 0.01\n100 0.02\n")
    frequency, _ = read_table(file)
    assert frequency.tolist() == [10.0, 100.0]
