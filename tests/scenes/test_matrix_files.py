"""A structure whose matrices come from a file, or whose damping is a ratio."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.linalg
from scipy.io import savemat

from stochvi import Matrices, SceneError, load_scene
from stochvi.scenes.schema import scene_schema

MASS = np.array([[2.0, 0.3], [0.3, 1.0]])
STIFFNESS = 1e4 * np.array([[2.0, -1.0], [-1.0, 1.0]])
DAMPING = np.array([[3.0, -1.0], [-1.0, 2.0]])
HELD = {"MAA": MASS, "KAA": STIFFNESS, "BAA": DAMPING}
NAMES = {"mass": "MAA", "stiffness": "kaa", "damping": "BAA"}


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


def test_files_of_others_leave_the_printing_of_numbers_alone(tmp_path: Path) -> None:
    write_op4(tmp_path / "model.op4")
    Matrices(file=str(tmp_path / "model.op4"), **NAMES)
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
        (NAMES | {"zeta": 0.1}, "needs exactly one of damping and zeta, got damping, zeta"),
        (NAMES | {"coordinates": ["tip"]}, "needs mass with 1 rows and columns"),
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
