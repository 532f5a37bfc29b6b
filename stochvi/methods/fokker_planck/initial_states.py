"""Initial states of an oscillator: a point, or a Gaussian distribution of displacement and
velocity."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from scipy.special import ndtr

from stochvi.mathematics.arrays import Array
from stochvi.model.model import Model

TAIL = 8.5
"""Number of standard deviations beyond which a Gaussian distribution has less than 2e-17 of its
probability."""

GRID = np.linspace(-TAIL, TAIL, 18)
"""Ends, in standard deviations, of Gauss-Legendre panels that resolve a Gaussian distribution."""


class InitialState(NamedTuple):
    """A displacement (m) and a velocity (m/s)."""

    x: float
    v: float


@dataclass(frozen=True, kw_only=True)
class Gaussian:
    """A Gaussian distribution of displacement (m) and velocity (m/s).

    Parameters
    ----------
    mean
        Means of displacement (m) and velocity (m/s).
    covariance
        Symmetric and positive definite, ((m^2, m^2/s), (m^2/s, m^2/s^2)).

    See Also
    --------
    stochvi.transient : Transients, which may start from it.

    Examples
    --------
    >>> Gaussian(mean=(0.0, 0.0), covariance=((1.0, 0.0), (0.0, 4.0))).deviations
    (1.0, 2.0)
    """

    mean: tuple[float, float]
    covariance: tuple[tuple[float, float], tuple[float, float]]

    def __post_init__(self) -> None:
        mean, matrix = np.asarray(self.mean, dtype=float), np.asarray(self.covariance, dtype=float)
        if mean.shape != (2,) or matrix.shape != (2, 2):
            raise ValueError(
                "mean must be (m, m/s) and covariance 2 by 2, got shapes "
                f"{mean.shape} and {matrix.shape}"
            )
        determinant = matrix[0, 0] * matrix[1, 1] - matrix[0, 1] * matrix[1, 0]
        good = np.isfinite(mean).all() and np.isfinite(matrix).all()
        good = good and math.isclose(matrix[0, 1], matrix[1, 0], rel_tol=ALIKE)
        if not (good and matrix[0, 0] > 0.0 and matrix[1, 1] > 0.0 and determinant > 0.0):
            raise ValueError(
                f"covariance must be finite, symmetric and positive definite, got {self.covariance}"
            )

    @property
    def deviations(self) -> tuple[float, float]:
        """Standard deviations of displacement and velocity."""
        return math.sqrt(self.covariance[0][0]), math.sqrt(self.covariance[1][1])

    def density(self, x: Array, v: Array) -> Array:
        """Joint density per metre and per metre a second; the arguments are broadcast."""
        (xx, xv), (_, vv) = self.covariance
        determinant = xx * vv - xv * xv
        a, b = x - self.mean[0], v - self.mean[1]
        exponent = (vv * a**2 - 2.0 * xv * a * b + xx * b**2) / determinant
        density: Array = np.exp(-exponent / 2.0) / (2.0 * math.pi * math.sqrt(determinant))
        return density

    def grids(self) -> tuple[Array, Array]:
        """Displacements and velocities between which the density is smooth.

        The grids are as fine as the law of either given the other.
        """
        (xx, xv), (_, vv) = self.covariance
        narrow = math.sqrt(1.0 - xv**2 / (xx * vv))
        steps = min(math.ceil((len(GRID) - 1) / narrow), MOST_STEPS)
        scaled = np.linspace(-TAIL, TAIL, steps + 1)
        return tuple(  # type: ignore[return-value]
            centre + deviation * scaled
            for centre, deviation in zip(self.mean, self.deviations, strict=True)
        )

    def beyond(self, lower: float, upper: float) -> float:
        """Probability of displacements outside the barriers."""
        deviation = self.deviations[0]
        below = ndtr((lower - self.mean[0]) / deviation)
        above = ndtr((self.mean[0] - upper) / deviation)
        return float(below + above)


MOST_STEPS = 200
"""Largest number of panels for a Gaussian distribution whose displacement and velocity are nearly
dependent."""

ALIKE = 1e-9
"""Largest relative difference of the two covariances of a matrix that counts as symmetric, because
rounding may leave so much."""

Start = InitialState | Gaussian
StartChoice = Literal["rest", "stationary"] | tuple[float, float] | Gaussian
"""The forms in which a user may give a start: at rest where spring and load balance, the stationary
law without barriers and stops, a point (m, m/s), a law."""


def start_of(given: StartChoice, model: Model) -> Start:
    """The initial state from any of the forms in which a user may give it.

    Raises
    ------
    ValueError
        If it is not one of the words, or the motion has no place of rest or no stationary
        distribution.
    """
    if isinstance(given, Gaussian):
        return given
    if not isinstance(given, str):
        point = np.asarray(given, dtype=float)
        if point.shape != (2,) or not np.isfinite(point).all():
            raise ValueError(f"start must be a finite (displacement, velocity), got {given!r}")
        return InitialState(float(point[0]), float(point[1]))
    if given not in ("rest", "stationary"):
        raise ValueError(
            f"start must be 'rest', 'stationary', a point or a Gaussian, got {given!r}"
        )
    if model.omega == 0.0 and model.load != 0.0:
        raise ValueError(
            f"start must be a point or a Gaussian where no spring balances the load, got {given!r}"
        )
    if given == "rest":
        return InitialState(model.rest, 0.0)
    if model.omega == 0.0 or model.damping_rate == 0.0:
        raise ValueError(
            "start = 'stationary' needs a stiffness and a damping above 0, got 0 for one of them; "
            "start from a point or a Gaussian"
        )
    square = model.intensity / 2.0 / model.damping_rate
    return Gaussian(
        mean=(model.rest, 0.0), covariance=((square / model.omega**2, 0.0), (0.0, square))
    )
