"""Tests of stops from files: columns, units, and what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from stochvi.identification import DropRecord, ForceCurve, Rebounds, read_test
from stochvi.results.errors import SceneError
from support.drops import record


def written(folder: Path, text: str) -> Path:
    file = folder / "test.csv"
    file.write_text(text)
    return file


def test_speeds_come_with_their_units(tmp_path: Path) -> None:
    file = written(tmp_path, "approach (mm/s),rebound (m/s)\n500,0.3\n1000,0.6\n")
    test = read_test(file, "speeds")
    assert isinstance(test, Rebounds)
    assert test.approach.tolist() == [0.5, 1.0] and test.observed.tolist() == [0.6, 0.6]
    plain = written(tmp_path, "500,300\n1000,600\n")
    assert read_test(plain, "speeds", unit="mm/s,mm/s").place.tolist() == [0.5, 1.0]


def test_times_of_times_are_a_column(tmp_path: Path) -> None:
    file = written(tmp_path, "time (ms)\n0\n400\n600\n700\n")
    test = read_test(file, "times", height=0.3)
    assert test.observed[1:] == pytest.approx([0.5, 0.5]) and len(test.observed) == 3


def test_a_force_curve_has_a_speed_where_it_has_times(tmp_path: Path) -> None:
    t = np.linspace(0.0, 1.0, 11)
    rows = "\n".join(f"{a},{1.0 + 2.0 * a},{5.0 * a}" for a in t)
    file = written(tmp_path, "time (s),deflection (mm),force (N)\n" + rows)
    test = read_test(file, "force", mass=2.0)
    assert isinstance(test, ForceCurve)
    assert test.speed == pytest.approx(np.full(11, 2e-3)) and test.mass == 2.0
    still = written(tmp_path, "1,10\n2,20\n")
    assert read_test(still, "force", unit="mm,N").speed is None


def test_a_drop_is_a_record(tmp_path: Path) -> None:
    clean = record(1.2e6, 1.0, 300.0, 0.0, mass=2.3, speed=1.4, fs=20e3, before=0.01, after=0.01)
    rows = "\n".join(f"{n / 20e3:.6f},{a / 9.80665:.5f}" for n, a in enumerate(clean))
    file = written(tmp_path, "time (s),a (g)\n" + rows)
    test = read_test(file, "drop", mass=2.3)
    assert isinstance(test, DropRecord)
    # reading takes the mean off, and the test the offset before the impact
    assert test.observed.max() == pytest.approx(clean.max(), abs=1e-4 * clean.max())
    assert test.observed[0] == pytest.approx(0.0, abs=1e-3)
    assert read_test(file, "drop", mass=2.3, pendulum=True).gravity == 0.0


@pytest.mark.parametrize(
    "heading", ["deflection (mm),force (kN),remark", "Units: mm, kN", "# deflection; force in kN"]
)
def test_a_curve_is_not_read_in_other_units_than_its_heading_states(
    tmp_path: Path, heading: str
) -> None:
    file = tmp_path / "pad.csv"
    file.write_text(f"{heading}\n1,0.1\n2,0.21\n3,0.3\n")
    with pytest.raises(SceneError, match=r"unit is 'mm,N', but above column 2 of .* stands 'kN'"):
        read_test(file, "force", unit="mm,N")
    assert read_test(file, "force", unit="mm,kN").observed.tolist() == [100.0, 210.0, 300.0]


@pytest.mark.parametrize(
    ("text", "keys", "words"),
    [
        ("1,2\n3,4\n", {"kind": "speeds"}, "must be 'm/s,m/s', got none"),
        ("a (g),b (m/s)\n1,2\n3,4\n", {"kind": "speeds"}, "states the unit 'g' above column 1"),
        ("1,2\n3,4\n", {"kind": "speeds", "unit": "m/s"}, "must name 2 units, as 'm/s,m/s'"),
        ("1,2,3,4\n3,4,5,6\n", {"kind": "force"}, "expected two numbers"),
        ("0,1,2\n0,2,3\n1,2,3\n", {"kind": "force", "unit": "s,mm,N"}, "rising times"),
        ("approach (m/s),rebound (m/s)\n1,2\n", {"kind": "drop"}, "mass must be given for a drop"),
        ("1\n2\n", {"kind": "rebound"}, "kind must be"),
    ],
)
def test_what_is_no_file_of_a_test_is_refused(
    tmp_path: Path, text: str, keys: dict[str, str], words: str
) -> None:
    with pytest.raises((SceneError, ValueError), match=words):
        read_test(written(tmp_path, text), **keys)  # type: ignore[arg-type]
