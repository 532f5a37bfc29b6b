"""A linear structure by its matrices: M x'' + C x' + K x = force."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
import scipy.linalg
from numpy.typing import NDArray
from pydantic import WithJsonSchema, field_validator, model_validator

from stochvi.scenes.matrix_files import read_matrices
from stochvi.scenes.structures.base import AnyStructure
from stochvi.scenes.validation import Matrix, NonNegative, given, sentences_of

NamedMatrix = Annotated[
    Matrix,
    WithJsonSchema(
        {
            "anyOf": [
                {"type": "array", "items": {"type": "array", "items": {"type": "number"}}},
                {"type": "string"},
            ]
        }
    ),
]
"""A matrix, or its name in a file."""


class Matrices(AnyStructure):
    """A linear structure of several coordinates, M x'' + C x' + K x = force.

    Parameters
    ----------
    coordinates
        A name for each displacement, in the order of rows and columns; with a file "x1", "x2" and
        so on, unless others are given.
    mass, damping, stiffness
        Symmetric matrices, kg, N s/m and N/m; the mass positive definite, the others without
        negative eigenvalues. On a moving base, displacements are relative to it. With a file, the
        name of each matrix in it, by default "mass", "damping" and "stiffness".
    zeta
        Damping ratio of every natural mode, instead of a damping matrix:
        C = sum over modes of 2 zeta omega (M phi) (M phi)', phi' M phi = 1.
    file
        A file of the matrices: Nastran (.op4, with the extra `fem`), MATLAB (.mat) or NumPy (.npz).
    source
        Where the numbers come from; by default the name of the file.

    See Also
    --------
    stochvi.Oscillator : A single mass.
    stochvi.scenes.Modes : A structure by its natural modes, also from a file.
    stochvi.scenes.RigidBody : A box, whose matrices are built.

    Examples
    --------
    >>> loose = Matrices(
    ...     coordinates=["structure", "absorber"],
    ...     mass=[[1.0, 0.0], [0.0, 0.1]],
    ...     damping=[[0.1, 0.0], [0.0, 0.0]],
    ...     stiffness=[[1.0, 0.0], [0.0, 0.0]],
    ... )
    >>> loose.coordinates
    ('structure', 'absorber')
    """

    kind: Literal["matrices"] = "matrices"
    coordinates: tuple[str, ...]
    mass: NamedMatrix
    damping: NamedMatrix | None = None
    stiffness: NamedMatrix
    zeta: NonNegative | None = None
    file: str | None = None
    source: str | None = None

    @model_validator(mode="before")
    @classmethod
    def _from_file(cls, keys: Any) -> Any:
        """The keys with the matrices of the file instead of its name, if a file is given."""
        if not isinstance(keys, dict) or not isinstance(keys.get("file"), str):
            return keys
        names = {
            name: keys[name]
            for name in ("mass", "damping", "stiffness")
            if isinstance(keys.get(name), str)
        }
        damped = "damping" in names or keys.get("zeta") is None
        with sentences_of("file"):
            found = read_matrices(keys["file"], names, damped=damped)
        count = len(found["mass"])
        rest = {name: value for name, value in keys.items() if name not in (*names, "file")}
        numbered = {"coordinates": tuple(f"x{n}" for n in range(1, count + 1))}
        return {"source": Path(keys["file"]).name} | numbered | found | rest

    @field_validator("coordinates", mode="before")
    @classmethod
    def _names(cls, names: object) -> object:
        return tuple(names) if isinstance(names, list) else names

    @model_validator(mode="after")
    def _fit_together(self) -> Self:
        count = len(self.coordinates)
        taken = {"base", ""} & set(self.coordinates)
        if count == 0 or len(set(self.coordinates)) < count or taken:
            raise ValueError(
                "needs coordinates with different names, none of them empty or 'base', "
                f"got {list(self.coordinates)}"
            )
        if (self.damping is None) == (self.zeta is None):
            raise ValueError(
                f"needs exactly one of damping and zeta, got {given(self, 'damping', 'zeta')}"
            )
        for name in ("mass", "damping", "stiffness"):
            rows = getattr(self, name)
            if rows is None:
                continue
            if len(rows) != count or any(len(row) != count for row in rows):
                shape = " and ".join(str(len(row)) for row in rows)
                raise ValueError(
                    f"needs {name} with {count} rows and columns, one for each coordinate, got "
                    f"{len(rows)} rows of {shape}"
                )
            matrix = np.array(rows)
            larger = np.maximum(np.abs(matrix), np.abs(matrix.T))
            off = np.abs(matrix - matrix.T) - SYMMETRY * (larger + _sizes(matrix))
            if off.max() > 0.0:
                i, j = np.unravel_index(np.argmax(off), matrix.shape)
                raise ValueError(
                    f"needs a symmetric matrix {name}, got {matrix[i, j]:g} in row {i + 1}, column "
                    f"{j + 1} and {matrix[j, i]:g} in row {j + 1}, column {i + 1}"
                )
            smallest = _smallest_eigenvalue(matrix)
            if smallest < -SYMMETRY:
                raise ValueError(
                    f"needs a matrix {name} without negative eigenvalues (a spring or damper that "
                    "pushes); a zero on its diagonal needs zeros in its row"
                )
            if name == "mass" and smallest <= SYMMETRY:
                raise ValueError(
                    "needs a positive definite matrix mass: every coordinate needs a mass above 0"
                )
        return self

    @property
    def carried_mass(self) -> float:
        return float(self.matrices[0].sum())

    @property
    def matrices(self) -> tuple[NDArray[np.float64], ...]:
        """Mass, damping and stiffness."""
        mass, stiffness = _evened(self.mass), _evened(self.stiffness)
        if self.damping is not None:
            return mass, _evened(self.damping), stiffness
        squares, shapes = scipy.linalg.eigh(stiffness, mass)
        moved = mass @ shapes
        rates = 2.0 * (self.zeta or 0.0) * np.sqrt(np.maximum(squares, 0.0))
        return mass, (rates * moved) @ moved.T, stiffness

    def assumptions(self) -> list[str]:
        found = [] if self.source is None else [f"matrices: {self.source}"]
        return found if self.zeta is None else [*found, "the damping ratio is that of each mode"]


SYMMETRY = 1e-9
"""Largest difference of two opposite entries that counts as a rounding error, relative to them and
to what the diagonal allows. Programs leave rounding in place of zeros."""


def _sizes(matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    """The largest size that entries beside a diagonal have without negative eigenvalues."""
    size = np.sqrt(np.abs(np.diag(matrix)))
    return np.outer(size, size)


def _evened(rows: Sequence[Sequence[float]]) -> NDArray[np.float64]:
    """A matrix that is symmetric to the last digit."""
    matrix = np.array(rows)
    return np.asarray(0.5 * (matrix + matrix.T))


def _smallest_eigenvalue(matrix: NDArray[np.float64]) -> float:
    """Smallest eigenvalue of D^-1/2 A D^-1/2 with D the diagonal of A, which is free of units."""
    size = np.sqrt(np.abs(np.diag(matrix)))
    if np.any(matrix[size == 0.0]):
        return -1.0  # a zero on the diagonal of a matrix without negative eigenvalues is alone
    inverse = np.divide(1.0, size, out=np.zeros_like(size), where=size > 0.0)
    return float(np.linalg.eigvalsh(inverse[:, None] * matrix * inverse)[0])
