"""A linear structure by its matrices: M x'' + C x' + K x = force."""

from __future__ import annotations

from typing import Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import field_validator, model_validator

from stochvi.scenes.structures.base import AnyStructure
from stochvi.scenes.validation import Matrix


class Matrices(AnyStructure):
    """A linear structure of several coordinates, M x'' + C x' + K x = force.

    Parameters
    ----------
    coordinates
        A name for each displacement, in the order of rows and columns.
    mass, damping, stiffness
        Symmetric matrices, kg, N s/m and N/m; the mass positive definite, the others without
        negative eigenvalues. On a moving base, displacements are relative to it.

    See Also
    --------
    stochvi.Oscillator : A single mass.
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
    mass: Matrix
    damping: Matrix
    stiffness: Matrix

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
        for name in ("mass", "damping", "stiffness"):
            rows = getattr(self, name)
            if len(rows) != count or any(len(row) != count for row in rows):
                shape = " and ".join(str(len(row)) for row in rows)
                raise ValueError(
                    f"needs {name} with {count} rows and columns, one for each coordinate, got "
                    f"{len(rows)} rows of {shape}"
                )
            matrix = np.array(rows)
            if not np.allclose(matrix, matrix.T, rtol=SYMMETRY, atol=0.0):
                i, j = np.unravel_index(np.argmax(np.abs(matrix - matrix.T)), matrix.shape)
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
        return tuple(np.array(rows) for rows in (self.mass, self.damping, self.stiffness))


SYMMETRY = 1e-9
"""Largest relative difference of two entries that counts as a rounding error when the symmetry of a
matrix is checked."""


def _smallest_eigenvalue(matrix: NDArray[np.float64]) -> float:
    """Smallest eigenvalue of D^-1/2 A D^-1/2 with D the diagonal of A, which is free of units."""
    size = np.sqrt(np.abs(np.diag(matrix)))
    if np.any(matrix[size == 0.0]):
        return -1.0  # a zero on the diagonal of a matrix without negative eigenvalues is alone
    inverse = np.divide(1.0, size, out=np.zeros_like(size), where=size > 0.0)
    return float(np.linalg.eigvalsh(inverse[:, None] * matrix * inverse)[0])
