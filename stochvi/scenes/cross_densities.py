"""Cross densities between the motions of a base along its axes."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Literal, Self

import numpy as np
from numpy.typing import ArrayLike
from pydantic import model_validator

from stochvi.mathematics.arrays import Vector, Waves
from stochvi.mathematics.spectra import Table
from stochvi.mathematics.units import power_ratio, unit
from stochvi.results.errors import SceneError
from stochvi.scenes.excitations.base import DensityUnit, unit_name
from stochvi.scenes.validation import Checked, Column, Numbers

Axis = Literal["x", "y", "z"]

COHERENT = 1e-9
"""Size up to which a negative eigenvalue of the matrix of coherences counts as a rounding error."""


class CrossDensity(Checked):
    """The complex cross density of the accelerations of a base along two of its axes.

    It is one-sided per hertz, G_ab = 2 E conj(A) B / T for a, b = `between`, as
    scipy.signal.csd(a, b) estimates it. The complex coherence is the cross density over the root of
    the product of the two densities. Between breakpoints it is linear in the logarithm of the
    frequency; outside them, and where one of the densities is 0, it is 0.

    Parameters
    ----------
    between
        The two axes.
    frequency_hz, real, imaginary
        Breakpoints, Hz, and the real and imaginary parts of the cross density there.
    unit
        Unit of the cross density, the same as of an acceleration density.

    Examples
    --------
    >>> cross = CrossDensity(
    ...     between=["x", "z"], frequency_hz=[5.0, 500.0], real=[2e-3, 1e-4],
    ...     imaginary=[1e-3, 0.0], unit="g2/Hz",
    ... )
    >>> cross.between
    ('x', 'z')
    """

    between: tuple[Axis, Axis]
    frequency_hz: Column
    real: Numbers
    imaginary: Numbers
    unit: DensityUnit

    @model_validator(mode="before")
    @classmethod
    def _as_tuple(cls, keys: object) -> object:
        if isinstance(keys, dict) and isinstance(keys.get("between"), list):
            return keys | {"between": tuple(keys["between"])}
        return keys

    @model_validator(mode="after")
    def _columns_fit(self) -> Self:
        if self.between[0] == self.between[1]:
            raise SceneError(
                [("between", f"needs two different axes, got {self.between[0]!r} twice")]
            )
        unit_name(self.unit, "acceleration density")
        count = len(self.frequency_hz)
        if count < 2 or len(self.real) != count or len(self.imaginary) != count:
            raise ValueError(
                "needs at least 2 values of frequency_hz and as many of real and imaginary, got "
                f"{count}, {len(self.real)} and {len(self.imaginary)}"
            )
        if np.any(np.diff(self.frequency_hz) <= 0.0):
            raise SceneError([("frequency_hz", "must rise from each value to the next")])
        return self

    def coherence(self, tables: dict[str, Table], frequency_hz: ArrayLike) -> Waves:
        """Complex coherence E conj(A) B over the root of the product of the densities."""
        first, second = (tables[axis] for axis in self.between)
        places = np.array(self.frequency_hz)
        size = np.sqrt(first(places) * second(places))
        parts = unit(self.unit).to_si(np.array([self.real, self.imaginary]))
        relative = np.divide(parts, size, out=np.zeros_like(parts), where=size > 0.0)
        with np.errstate(divide="ignore"):
            log, where = np.log(np.asarray(frequency_hz, dtype=float)), np.log(places)
        real, imaginary = (np.interp(log, where, part, left=0.0, right=0.0) for part in relative)
        moved = (first(frequency_hz) > 0.0) & (second(frequency_hz) > 0.0)
        return np.asarray(np.where(moved, real + 1j * imaginary, 0.0))

    def louder(self, level_db: float) -> CrossDensity:
        """The cross density of both motions when they are raised by a level in dB."""
        factor = power_ratio(level_db)
        parts = {
            name: [factor * each for each in getattr(self, name)] for name in ("real", "imaginary")
        }
        return type(self)(**(self.model_dump() | parts))


def coherences(
    crosses: tuple[CrossDensity, ...], tables: dict[str, Table], frequency_hz: ArrayLike
) -> Waves:
    """Matrices (frequencies, k, k) of E A_a conj(A_b), divided by the roots of the two densities,
    for the axes in the order of `tables`."""
    axes = list(tables)
    f = np.asarray(frequency_hz, dtype=float)
    found = np.broadcast_to(np.eye(len(axes), dtype=complex), (len(f), len(axes), len(axes))).copy()
    for cross in crosses:
        a, b = (axes.index(axis) for axis in cross.between)
        share = cross.coherence(tables, f)
        found[:, b, a], found[:, a, b] = share, share.conj()
    return found


def independent_sources(
    crosses: tuple[CrossDensity, ...], tables: dict[str, Table]
) -> dict[str, Callable[[Vector], Waves]]:
    """Accelerations along all axes per unit of independent sources, one for each axis.

    The source of an axis has the density of that axis.

    Source j moves axis a by sqrt(G_aa / G_jj) L_aj, L the Cholesky factor of the coherences. The
    sources together then have the densities and cross densities of the scene.

    Returns
    -------
    dict
        Axis -> function of the frequencies (Hz) to complex (frequencies, axes).
    """

    def shares(column: int, frequency_hz: Vector) -> Waves:
        root = cholesky(coherences(crosses, tables, frequency_hz))[:, :, column]
        densities = np.array([table(frequency_hz) for table in tables.values()]).T
        own = densities[:, [column]]
        ratio = np.divide(densities, own, out=np.zeros_like(densities), where=own > 0.0)
        return np.asarray(root * np.sqrt(ratio))

    return {axis: partial(shares, column) for column, axis in enumerate(tables)}


def cholesky(matrices: Waves) -> Waves:
    """Lower triangular L (frequencies, k, k) with L L^H = matrices, which may be singular.

    >>> cholesky(np.array([[[1.0, -1.0j], [1.0j, 1.0]]])).round(6).tolist()
    [[[(1+0j), 0j], [1j, 0j]]]
    """
    found = np.zeros_like(matrices)
    size = matrices.shape[1]
    for j in range(size):
        left = matrices[:, :, j] - np.einsum("fik,fk->fi", found[:, :, :j], found[:, j, :j].conj())
        pivot = np.sqrt(np.maximum(left[:, j].real, 0.0))
        own = np.where(pivot > math.sqrt(COHERENT), pivot, 0.0)[:, None]
        found[:, j:, j] = np.divide(
            left[:, j:], own, out=np.zeros_like(left[:, j:]), where=own > 0.0
        )
    return found


def impossible(crosses: tuple[CrossDensity, ...], tables: dict[str, Table]) -> str:
    """Sentence on why no motion can have these densities and cross densities; empty if one can.

    The coherences are linear between breakpoints, so that it is enough to check the breakpoints.
    """
    places = np.unique(np.concatenate([each.frequency_hz for each in crosses]))
    smallest = np.linalg.eigvalsh(coherences(crosses, tables, places))[:, 0]
    row = int(np.argmin(smallest))
    if smallest[row] >= -COHERENT:
        return ""
    return (
        f"is more than the densities of these axes allow at {places[row]:g} Hz: the matrix of "
        "densities must have no negative eigenvalue (for two axes |G_ab|^2 <= G_aa G_bb)"
    )
