"""What ships with the package, and tables of numbers in text files."""

from __future__ import annotations

import csv
import math
import re
import tomllib
from pathlib import Path

import pytest

from stochvi.results.errors import SceneError
from stochvi.scenes.datasets import data_folder, profiles, shipped_scene
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
