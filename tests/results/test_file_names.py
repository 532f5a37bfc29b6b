"""File names made from names of users: inside their folder on every system, and never shared."""

from __future__ import annotations

import unicodedata
from pathlib import Path, PurePosixPath, PureWindowsPath

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from stochvi.results.file_names import LONGEST, RESERVED, file_names

NASTY = (
    "../../escape", "/etc/passwd", "..", ".", "", "C:\\up", "c:up", "a/b", "a\\b", "nul", "COM1.x",
    "a\0b", "a\nb", "x" * 300, "箱" * 200, "\u202egnp", "-rf", "~root", "a:b", "a ", "e\u0301", "é",
    "\ud800", "*?<>|", "$(id)",
)  # fmt: skip


def check(names: list[str], ending: str = ".png") -> None:
    found = file_names(names, ending)
    assert list(found) == list(dict.fromkeys(names))
    for name in found.values():
        for kind in (PurePosixPath, PureWindowsPath):
            assert (kind("out") / name).parent == kind("out")
            assert kind(name).name == name and not kind(name).drive
        assert len(name.encode()) <= LONGEST and name.endswith(ending)
        assert name[0] not in ".- " and name.split(".")[0].strip().casefold() not in RESERVED
        assert all(unicodedata.category(letter)[0] != "C" for letter in name)
    alike = [unicodedata.normalize("NFKC", name).casefold() for name in found.values()]
    assert len(set(alike)) == len(alike)


@settings(max_examples=40)
@given(st.lists(st.one_of(st.text(), st.sampled_from(NASTY)), max_size=6))
@example([*NASTY])
@example(["a/b", "a_b", "A_b", "a:b"])
def test_files_stay_in_their_folder_and_apart(names: list[str]):
    check(names)


def test_a_tidy_name_is_kept():
    tidy = ["stops.collision_rate", "Wände 2 (left).velocity_std", "箱.displacement_std"]
    assert list(file_names(tidy, ".png").values()) == [f"{name}.png" for name in tidy]


@pytest.mark.parametrize("name", NASTY)
def test_a_file_of_the_name_can_be_made_here(tmp_path: Path, name: str):
    (only,) = file_names([name], ".csv").values()
    (tmp_path / only).touch()
    assert [path.name for path in tmp_path.iterdir()] == [only]
