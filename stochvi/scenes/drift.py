"""Free drifts: motions of a whole structure that no spring, damper or stop resists."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.linalg import null_space

from stochvi.mathematics.arrays import Matrix

FORCE_TOLERANCE = 1e-10
"""Relative size up to which a force of springs, dampers or stops counts as a rounding error."""


def drifts(felt: Matrix, rows: Matrix) -> tuple[list[int], Matrix]:
    """Free drifts, and the reference coordinates relative to which the others do not drift.

    Parameters
    ----------
    felt
        Damping and stiffness matrices, one below the other (2 n, n).
    rows
        Rows (pairs, n) of the gaps.

    Returns
    -------
    references, motions
        Indices of k reference coordinates, and the drifts (n, k). Each drift moves one reference
        by 1 and no other, so that x_i - motions[i] . x[references] does not drift.

    Examples
    --------
    A mass that strikes another one, both of them free:

    >>> references, motions = drifts(np.zeros((4, 2)), np.array([[1.0, -1.0]]))
    >>> references, motions.round(12).tolist()
    ([1], [[1.0], [1.0]])
    """
    size = np.linalg.norm(felt, axis=0).max(initial=0.0) or 1.0
    free = null_space(np.vstack([felt / size, rows]), rcond=FORCE_TOLERANCE).T
    # a coordinate that other masses strike is preferred as a reference
    struck = np.sum(rows < 0.0, axis=0)
    references: list[int] = []
    for place in np.argsort(-struck, kind="stable").tolist():
        sizes = np.abs(free[:, place])
        if len(references) == len(free) or sizes[len(references) :].max() <= FORCE_TOLERANCE:
            continue
        chosen = len(references) + int(np.argmax(sizes[len(references) :]))
        free[[len(references), chosen]] = free[[chosen, len(references)]]
        pivot = free[len(references)] / free[len(references), place]
        free = free - np.outer(free[:, place], pivot)
        free[len(references)] = pivot
        references.append(place)
    return references, free.T


def without_drift(mass: Matrix, references: Sequence[int], motions: Matrix) -> Matrix:
    """Matrix (n - k, n) from forces on all coordinates to forces on the relative coordinates.

    The relative coordinates are the others, measured from the references. Their mass matrix is this
    matrix times the mass matrix of all coordinates, without the columns of the references.
    """
    kept = np.delete(np.arange(len(mass)), references)
    carried = mass @ motions
    whole = np.linalg.solve(motions.T @ carried, motions.T)
    return np.asarray((np.eye(len(mass)) - carried @ whole)[kept])
