"""Matrices of a structure from a file: OP4 of Nastran, MATLAB, NumPy."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from stochvi.mathematics.arrays import Matrix
from stochvi.results.errors import SceneError
from stochvi.scenes.foreign_files import read_foreign, read_numpy

KINDS = {".op4": "Nastran matrices", ".mat": "MATLAB", ".npz": ""}
"""Ending of a file of matrices -> its kind; files of numpy are read here."""

NAMES_LISTED = 8
"""Number of matrices that a sentence lists."""


def read_matrices(file: str, names: Mapping[str, str], *, damped: bool) -> dict[str, Matrix]:
    """Mass, stiffness and damping from a file, whose ending tells its kind.

    Parameters
    ----------
    file
        Name of the file.
    names
        Names of "mass", "damping" and "stiffness" in the file where they differ from these; capital
        letters are as small ones.
    damped
        Whether the damping is wanted, too.

    Raises
    ------
    SceneError
        If the file does not hold these matrices.
    """
    path = Path(file)
    kind = KINDS.get(path.suffix.lower())
    if kind is None:
        raise SceneError(f"{path} must end in one of {', '.join(KINDS)}")
    arrays = {each.name: each.y for each in read_foreign(path, kind)} if kind else read_numpy(path)
    held = {name.lower(): array for name, array in arrays.items()}
    found = {}
    for key in ("mass", "stiffness", *["damping"] * damped):
        name = names.get(key, key)
        matrix = held.get(name.lower())
        if matrix is None:
            listed = ", ".join(list(arrays)[:NAMES_LISTED])
            raise SceneError(
                f"{path} has no matrix {name!r} for {key}: it has {listed or 'none'}; "
                f'write {key} = "NAME"'
                f"{', or zeta in the place of damping' if key == 'damping' else ''}"
            )
        if matrix.ndim != 2:
            raise SceneError(f"{path} must hold a square matrix {name!r}, got a vector")
        found[key] = matrix
    return found
