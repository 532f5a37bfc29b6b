"""White noise through a filter of any order: of a transfer function, or in state space.

Both have the one-sided density 2 S0 |H(i w)|^2 of the white noise of intensity S0 that passes them.
Methods read it as a table, which is as dense as its interpolation needs.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np
from pydantic import BeforeValidator, model_validator

from stochvi.mathematics.arrays import Vector, Waves
from stochvi.mathematics.spectra import refined_table
from stochvi.mathematics.units import power_ratio
from stochvi.scenes.excitations.base import DensityNoise, StrengthNoise, band_of
from stochvi.scenes.validation import Matrix, Numbers, plain_numbers

BELOW, ABOVE = 1e-6, 1e3
"""Ends of the density: as shares of the slowest pole below, and of the fastest one above."""

FAINTEST = 1e-14
"""Share of its largest value at which a density ends; a notch goes down to it."""

STABLE = 1e-12
"""A pole counts as stable if its decay rate is above this share of the fastest pole."""


class ShapedNoise(DensityNoise, StrengthNoise):
    """Base of white noise that has passed a linear filter H(s) of any order.

    The one-sided density is 2 S0 |H(i w)|^2, w = 2 pi f. The filter has no unit: a gain of 1 keeps
    the strength, which is given as for `WhiteNoise`.

    Parameters
    ----------
    intensity, density, unit
        Strength of the white noise before the filter.
    """

    effect_word: ClassVar[str] = "noise shaped by a filter"

    @property
    @abstractmethod
    def poles(self) -> Waves:
        """Poles of the filter, rad/s, complex."""

    @abstractmethod
    def squared_gain(self, frequency_hz: Vector) -> Vector:
        """|H|^2 at the given frequencies."""

    @model_validator(mode="after")
    def _shape(self) -> Self:
        self._checked()
        sizes = np.abs(self.poles)
        unstable = self.poles[self.poles.real >= -STABLE * sizes.max()]
        if len(unstable):
            raise ValueError(
                "needs a stable filter, every pole with a negative real part, got the pole "
                f"{unstable[0]:.4g} rad/s"
            )
        ends = BELOW * sizes.min(), ABOVE * sizes.max()
        resonances = np.abs(self.poles.imag)
        places = np.sort(np.append(np.geomspace(*ends, 200), resonances[resonances > ends[0]]))
        frequency_hz = places / (2.0 * np.pi)
        gains = self.squared_gain(frequency_hz)
        faintest = FAINTEST * float(gains.max())
        if not faintest > 0.0:
            raise ValueError("needs a filter that lets noise pass, got H = 0 at every frequency")
        heard = np.flatnonzero(gains > faintest)
        strength = 2.0 * self.si_intensity * power_ratio(self.level_db)
        self._table = refined_table(
            lambda f: strength * np.maximum(self.squared_gain(f), faintest),
            frequency_hz[heard[0] : heard[-1] + 1],
        )
        return self

    def _checked(self) -> None:
        """Raise a ValueError where the numbers of the filter do not fit together."""

    @property
    def density_unit(self) -> str | None:
        return self.unit

    @property
    def order(self) -> int:
        """Number of poles."""
        return len(self.poles)

    def assumptions(self, omega: float = 0.0, damping_rate: float = 0.0) -> tuple[str, ...]:
        low, high = self.table.frequency_hz[[0, -1]]
        return (
            f"the noise of a filter of order {self.order} is followed by its density from "
            f"{low:.3g} to {high:.3g} Hz",
        )

    def facts(self, where: str, numbers: Mapping[str, float]) -> list[tuple[str, ...]]:
        name = f"{self.effect_word.capitalize()} on {where}"
        return [(name, f"order {self.order}{self.raised}", band_of(numbers))]


class TransferFunctionNoise(ShapedNoise):
    """White noise w through the transfer function of a filter of any order.

    The force or acceleration is f = H w with

        H(s) = (b_m s^m + ... + b_0) / (a_n s^n + ... + a_0),    m < n,

    and its one-sided density is 2 S0 |H(2 pi i f)|^2. In a scene file it may also be written as
    `kind = "filtered"` with these two keys.

    Parameters
    ----------
    numerator, denominator
        Coefficients b and a, the highest power of s first, as in `scipy.signal`; s in rad/s.
    intensity, density, unit
        Strength of the white noise before the filter, as for `WhiteNoise`.

    Raises
    ------
    SceneError
        If a pole has no negative real part, or the numerator is of no lower degree.

    See Also
    --------
    stochvi.FilteredNoise : A resonance, which simulations follow as a filter.
    stochvi.StateSpaceNoise : The same by matrices.

    Examples
    --------
    White noise through a filter of first order, with its corner at 10 rad/s; E f^2 = 10 S0 / 2:

    >>> wind = TransferFunctionNoise(intensity=2.0, numerator=[10.0], denominator=[1.0, 10.0])
    >>> round(float(wind.table(1e-3)), 4), round(wind.table.mean_square(), 2)
    (4.0, 9.99)
    """

    kind: Literal["transfer-function"] = "transfer-function"
    numerator: Numbers
    denominator: Numbers

    @property
    def poles(self) -> Waves:
        return np.roots(self.denominator).astype(np.complex128)

    def squared_gain(self, frequency_hz: Vector) -> Vector:
        s = 2j * np.pi * frequency_hz
        ratio = np.polyval(self.numerator, s) / np.polyval(self.denominator, s)
        return np.asarray(np.abs(ratio) ** 2)

    def _checked(self) -> None:
        above, below = np.trim_zeros(self.numerator, "f"), self.denominator
        if len(below) < 2 or below[0] == 0.0:
            raise ValueError(
                "needs a denominator of degree 1 at least, with a highest coefficient other than "
                f"0, got {list(below)}"
            )
        if not len(above) < len(below):
            raise ValueError(
                "needs a numerator of a lower degree than the denominator, got degrees "
                f"{len(above) - 1} and {len(below) - 1}; add white noise for a part without filter"
            )


LISTS = (list, tuple, np.ndarray)
"""What holds numbers one after another."""


def _column(value: Any) -> Any:
    """A vector as a matrix of one column; what is neither is left to the check of the key."""
    is_vector = isinstance(value, LISTS) and not any(isinstance(each, LISTS) for each in value)
    return [[each] for each in value] if is_vector else plain_numbers(value)


def _row(value: Any) -> Any:
    """A matrix of one row as a vector; what is neither is left to the check of the key."""
    is_matrix = isinstance(value, LISTS) and len(value) == 1 and isinstance(value[0], LISTS)
    return plain_numbers(value[0] if is_matrix else value)


class StateSpaceNoise(ShapedNoise):
    """White noise through a filter in state space.

    The force or acceleration is f = C z, with states z of

        z' = A z + B w(t),

    and independent white noises w, all of the same intensity S0. Its one-sided density is the sum
    of 2 S0 |C (i w - A)^-1 B|^2 over the columns of B.

    Parameters
    ----------
    A
        Matrix (n, n), 1/s; all of its eigenvalues have a negative real part.
    B
        Vector (n,) or matrix (n, noises).
    C
        Vector (n,).
    intensity, density, unit
        Strength of each white noise, as for `WhiteNoise`.

    Raises
    ------
    SceneError
        If shapes do not fit together, or the filter is unstable.

    See Also
    --------
    stochvi.TransferFunctionNoise : The same by the coefficients of a transfer function.

    Examples
    --------
    >>> wind = StateSpaceNoise(intensity=2.0, A=[[-10.0]], B=[10.0], C=[1.0])
    >>> round(float(wind.table(1e-3)), 4)
    4.0
    """

    kind: Literal["state-space"] = "state-space"
    A: Matrix
    B: Annotated[Matrix, BeforeValidator(_column)]
    C: Annotated[Numbers, BeforeValidator(_row)]

    @property
    def poles(self) -> Waves:
        return np.linalg.eigvals(np.array(self.A)).astype(np.complex128)

    def squared_gain(self, frequency_hz: Vector) -> Vector:
        matrix, columns, row = np.array(self.A), np.array(self.B), np.array(self.C)
        s = 2j * np.pi * frequency_hz[:, None, None]
        states = np.linalg.solve(s * np.eye(len(matrix)) - matrix, columns.astype(complex))
        return np.asarray(np.sum(np.abs(row @ states) ** 2, axis=-1))

    def _checked(self) -> None:
        n = len(self.A)
        if not n or {len(row) for row in self.A} != {n}:
            raise ValueError(f"needs a square matrix A, got rows of {[len(r) for r in self.A]}")
        if len(self.B) != n or len({len(row) for row in self.B}) != 1:
            raise ValueError(f"needs B with {n} rows of equal length, as A has, got {len(self.B)}")
        if len(self.C) != n:
            raise ValueError(f"needs C with {n} numbers, as A has rows, got {len(self.C)}")


def kinds_of_filters(parts: Any) -> Any:
    """Excitations, those of kind `filtered` by the kind that their keys stand for."""
    return [_kind_of(each) for each in parts] if isinstance(parts, list | tuple) else parts


def _kind_of(part: Any) -> Any:
    if isinstance(part, dict) and part.get("kind") == "filtered":
        for kind, key in (("transfer-function", "denominator"), ("state-space", "A")):
            if key in part:
                return part | {"kind": kind}
    return part
