"""Motions of a whole structure that no spring, damper or stop feels: it drifts freely in them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import null_space

Matrix = NDArray[np.float64]

UNFELT = 1e-10
"""Share of its size up to which a force of springs, dampers or stops counts as none (rounding)."""


def drifts(felt: Matrix, rows: Matrix) -> tuple[list[int], Matrix]:
    """Motions that neither forces nor gaps feel, and coordinates that the others can be seen from.

    Parameters
    ----------
    felt
        Stiffness and damping, one below the other (2 n, n).
    rows
        Rows (pairs, n) of the gaps.

    Returns
    -------
    references, motions
        k places of coordinates, and the motions (n, k), of which each moves one of these by 1 and
        no other: x_i - motions[i] . x[references] does not drift.

    Examples
    --------
    A mass that strikes another one, both of them free:

    >>> references, motions = drifts(np.zeros((4, 2)), np.array([[1.0, -1.0]]))
    >>> references, motions.round(12).tolist()
    ([1], [[1.0], [1.0]])
    """
    size = np.linalg.norm(felt, axis=0).max(initial=0.0) or 1.0
    free = null_space(np.vstack([felt / size, rows]), rcond=UNFELT).T
    # what masses strike is the natural place to look from
    struck = np.sum(rows < 0.0, axis=0)
    references: list[int] = []
    for place in np.argsort(-struck, kind="stable").tolist():
        sizes = np.abs(free[:, place])
        if len(references) == len(free) or sizes[len(references) :].max() <= UNFELT:
            continue
        chosen = len(references) + int(np.argmax(sizes[len(references) :]))
        free[[len(references), chosen]] = free[[chosen, len(references)]]
        pivot = free[len(references)] / free[len(references), place]
        free = free - np.outer(free[:, place], pivot)
        free[len(references)] = pivot
        references.append(place)
    return references, free.T


def without_drift(mass: Matrix, references: Sequence[int], motions: Matrix) -> Matrix:
    """The matrix (n - k, n) that takes forces on all coordinates to those on the others, seen from
    the references, whose mass matrix is this times that of all, without the references."""
    kept = np.delete(np.arange(len(mass)), references)
    carried = mass @ motions
    whole = np.linalg.solve(motions.T @ carried, motions.T)
    return np.asarray((np.eye(len(mass)) - carried @ whole)[kept])
