"""Modes from text files and universal files are those that were written."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import pyuff
import scipy

from stochvi.results.errors import SceneError
from stochvi.scenes import GivenModes, load_scene

TEXT = """mode,frequency_hz,zeta,participation,tip,seat
1,12.5,0.01,0.8,1.0,0.25
2,40.0,0.02,-0.3,-1.5,0.5
"""


@pytest.fixture
def text(tmp_path: Path) -> Path:
    path = tmp_path / "modes.csv"
    path.write_text(TEXT.replace("mode,", "").replace("\n1,", "\n").replace("\n2,", "\n"))
    return path


def test_a_row_of_a_text_file_is_a_mode(text: Path) -> None:
    found = GivenModes(file=str(text))
    assert found.frequency_hz == (12.5, 40.0) and found.zeta == (0.01, 0.02)
    assert found.participation == (0.8, -0.3) and found.file is None
    assert found.shapes == {"tip": (1.0, -1.5), "seat": (0.25, 0.5)}
    renamed = GivenModes(file=str(text), shapes={"edge": "seat"}, Q=50.0)
    assert renamed.shapes == {"edge": (0.25, 0.5)} and renamed.zeta is None


def test_a_file_is_looked_for_beside_the_scene(text: Path) -> None:
    scene = text.parent / "scene.toml"
    scene.write_text(
        '[structure]\nkind = "modes"\nfile = "modes.csv"\n'
        '[[excitation]]\nkind = "white"\non = "base"\nintensity = 1.0\n'
    )
    assert load_scene(scene).structure.frequency_hz == (12.5, 40.0)


def finite_elements() -> tuple[np.ndarray, np.ndarray]:
    """Mass and stiffness of a chain of four masses, the first one held by a spring."""
    stiffness = 100.0 * (np.diag([2.0, 2.0, 2.0, 1.0]) - np.eye(4, k=1) - np.eye(4, k=-1))
    return np.diag([1.0, 2.0, 1.0, 0.5]), stiffness


def universal_file(path: Path) -> Path:
    mass, stiffness = finite_elements()
    squares, shapes = scipy.linalg.eigh(stiffness, mass)
    for number, (square, shape) in enumerate(zip(squares, shapes.T, strict=True), start=1):
        entry = pyuff.prepare_55(
            model_type=1, id1="NONE", id2="NONE", id3="NONE", id4="NONE", id5="NONE",
            analysis_type=2, data_ch=2, spec_data_type=8, data_type=2, load_case=1,
            mode_n=number, freq=math.sqrt(square) / (2.0 * math.pi), modal_m=1.0,
            modal_damp_vis=0.01 * number, modal_damp_his=0.0, node_nums=np.array([11, 12, 13, 14]),
            r1=np.zeros(4), r2=np.zeros(4), r3=shape,
        )  # fmt: skip
        pyuff.UFF(str(path)).write_sets(entry, "overwrite" if number == 1 else "add")
    return path


def test_a_finite_element_model_in_a_universal_file_is_that_of_its_matrices(tmp_path: Path) -> None:
    path = universal_file(tmp_path / "model.unv")
    found = GivenModes(file=str(path), shapes={"end": "14 z", "second": "12 z"})
    squares, shapes = scipy.linalg.eigh(*finite_elements()[::-1])
    # a universal file holds six digits
    assert found.modes.omega == pytest.approx(np.sqrt(squares), rel=1e-5)
    assert found.zeta == pytest.approx((0.01, 0.02, 0.03, 0.04)) and found.modal_mass == (1.0,) * 4
    assert found.shapes["end"] == pytest.approx(shapes[3], rel=1e-5)
    assert found.shapes["second"] == pytest.approx(shapes[1], rel=1e-5)
    compliance = np.sum(np.array(found.shapes["end"]) ** 2 / found.modes.omega**2)
    assert compliance == pytest.approx(np.linalg.inv(finite_elements()[1])[3, 3], rel=1e-4)


def test_what_a_file_does_not_hold_is_said(text: Path, tmp_path: Path) -> None:
    path = universal_file(tmp_path / "model.unv")
    other = tmp_path / "other.csv"
    other.write_text("zeta,tip\n0.1,1.0\n0.1,2.0\n")
    for keys, sentence in (
        ({"file": str(text), "shapes": {"a": "top"}}, "shapes.a must be a column of"),
        ({"file": str(text), "shapes": {"a": [1.0]}}, "shapes must say by texts"),
        ({"file": str(text), "frequency_hz": [1.0]}, "takes file or frequency_hz, got both"),
        ({"file": str(other)}, "must have a column frequency_hz, got zeta, tip"),
        ({"file": str(path)}, "shapes must name points by nodes of the file"),
        ({"file": str(path), "shapes": {"a": "15 z"}}, "a node of"),
        ({"file": str(path), "shapes": {"a": "14"}}, "as '11 z', got '14'"),
        ({"file": str(tmp_path / "none.csv")}, "none.csv"),
    ):
        with pytest.raises(SceneError) as refused:
            GivenModes(**keys)
        assert sentence in str(refused.value), str(refused.value)
