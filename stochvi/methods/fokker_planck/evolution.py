"""Functions of the Fokker-Planck operator: states at any time from one factorisation.

mass dy/dt = -matrix y + source is projected on the Krylov space of (matrix + shift mass)^-1 (I.
Moret and P. Novati, BIT 44 (2004) 595; V. Druskin, L. Knizhnerman, SIAM J. Matrix Anal. Appl. 19
(1998) 755). The slow modes are found first; they alone are left at long times. The fastest hardly
enter, which a stiff solver in time would have to damp. Some dozens of solutions with one
factorisation give all times at once. The change from one size of the space to a larger one measures
the error of the projection.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm
from scipy.sparse import csc_array

from stochvi.mathematics.arrays import Array
from stochvi.methods.fokker_planck.operators import Factors, Operator

SIZES = (16, 24, 34, 46, 62, 84, 112, 150, 200, 260)
"""Dimensions of the Krylov space at which its answer is compared with the one before."""

Solve = Callable[[Array], Array]


class Projection(NamedTuple):
    """The operator and a source on a Krylov space.

    `basis` (n, k) is orthonormal under the mass matrix, `operator` (k, k) and `source` (k,) are
    those of dy/dt = -operator y + source in its coordinates.
    """

    basis: Array
    operator: Array
    source: Array

    def accumulated(self, times: Array) -> Array:
        """y(t) from y(0) = 0, that is int_0^t exp(-operator s) source ds, (times, k).

        NaN where modes that grow have grown beyond `GROWN`.
        """
        size = len(self.source)
        whole = np.zeros((size + 1, size + 1))
        whole[:size, :size], whole[:size, size] = -self.operator, self.source
        with np.errstate(over="ignore", invalid="ignore"):
            found = np.array([expm(whole * time)[:size, size] for time in times]).reshape(-1, size)
        # sums of NaN raise no warning, unlike sums of infinite or very large numbers
        found[~(np.abs(found) < GROWN).all(axis=1)] = np.nan
        return found


GROWN = 1e100
"""Size of a state above which it must be a mode of the mesh that grows without bound."""


def projections(mass: csc_array, solve: Solve, source: Array, shift: float) -> Iterator[Projection]:
    """Projections of growing size, by Arnoldi's iteration.

    Parameters
    ----------
    solve
        b -> (matrix + shift mass)^-1 b, or of the transpose.
    source
        The right side of mass dy/dt = -matrix y + source, (n,).
    """
    first = solve(source)
    size = float(np.sqrt(first @ (mass @ first)))
    most = SIZES[-1]
    basis = np.empty((len(first), most + 1), order="F")
    hessenberg = np.zeros((most + 1, most))
    basis[:, 0] = first / size
    for k in range(most):
        new = solve(mass @ basis[:, k])
        for _ in range(2):  # twice is enough for orthogonality to rounding
            overlap = basis[:, : k + 1].T @ (mass @ new)
            new -= basis[:, : k + 1] @ overlap
            hessenberg[: k + 1, k] += overlap
        length = float(np.sqrt(max(new @ (mass @ new), 0.0)))
        hessenberg[k + 1, k] = length
        done = length <= KRYLOV_END * abs(hessenberg[: k + 1, k]).max()
        if k + 1 in SIZES or done:
            yield _projection(basis[:, : k + 1], hessenberg[: k + 1, : k + 1], size, shift)
        if done:
            return
        basis[:, k + 1] = new / length


KRYLOV_END = 1e-14
"""Relative size below which the part of a vector outside the Krylov space is a rounding error."""


def _projection(basis: Array, hessenberg: Array, size: float, shift: float) -> Projection:
    inverse = np.asarray(np.linalg.inv(hessenberg), dtype=np.float64)
    # the first vector is (operator + shift)^-1 source
    return Projection(basis, inverse - shift * np.eye(len(inverse)), size * inverse[:, 0])


@dataclass(frozen=True, kw_only=True)
class TimeGroups:
    """Which times share a Krylov space, and the poles of the spaces.

    The phase of a time is the time multiplied by the rate of the inner dynamics. The numbers were
    found best by trial at damping ratios from 0.005 to 0.5.

    Parameters
    ----------
    late
        Phase from which on only the slowest modes matter: all later times are one group.
    ratio
        Ratio of the latest to the earliest time of any group before that.
    faster
        Ratio of the poles of the spaces of neighbouring groups: short times call for faster modes.
    most
        Largest number of groups. Phases shorter than late / ratio^most share the fastest pole.
    """

    late: float = 25.0
    ratio: float = 8.0
    faster: float = 5.0
    most: int = 6


GROUPS = TimeGroups()
"""Settings of the groups of times of all transients."""


def time_groups(times: Array, natural: float) -> Iterator[tuple[NDArray[np.intp], float]]:
    """Groups of times that share a Krylov space, as indices, each with the pole of its space.

    `natural` is the rate of the inner dynamics, and `GROUPS` holds the settings.
    """
    phase = np.maximum(times * natural, GROUPS.late / GROUPS.ratio**GROUPS.most)
    number = np.ceil(np.maximum(np.log(GROUPS.late / phase) / np.log(GROUPS.ratio), 0.0)).astype(
        int
    )
    for group in np.unique(number):
        yield np.flatnonzero(number == group), natural * GROUPS.faster**group


class SlowestMode(NamedTuple):
    """The mode that decays last where paths are absorbed: `forward` is it as a density, `backward`
    as a function of the start.

    matrix forward = rate mass forward, and the transpose for `backward`; `forward` holds the mass
    1, and `backward` is scaled so that a path that starts at z survives with probability
    backward(z) exp(-rate t) in the end. Times are those of the box.
    """

    rate: float
    forward: Array
    backward: Array


MOST_ITERATIONS = 200
"""Largest number of inverse iterations."""

SETTLED = 1e-12
"""Relative change of the rate in one inverse iteration at which the iteration ends."""


def slowest_mode(operator: Operator, factors: Factors) -> SlowestMode:
    """Slowest mode by inverse iteration, with the factors of the matrix itself.

    The rate is the outflow of the mode over its mass. Unlike a Rayleigh quotient, which is the
    difference of numbers of the size of the inner dynamics, this keeps its digits however small
    the rate.
    """
    mass, outflow = operator.mass, operator.outflow
    held = mass @ operator.unity
    ahead, back = operator.unity, operator.unity
    rate = 0.0
    for _ in range(MOST_ITERATIONS):
        ahead, back = factors.solve(mass @ ahead), factors.solve_transposed(mass @ back)
        ahead, back = ahead / (held @ ahead), back / np.sqrt(back @ (mass @ back))
        before, rate = rate, float(outflow @ ahead)
        if abs(rate - before) <= SETTLED * rate:
            break
    # the part of the function 1 along the mode: (ahead, 1) = 1 = (ahead, mass back) scale
    return SlowestMode(rate, ahead, back / (ahead @ (mass @ back)))
