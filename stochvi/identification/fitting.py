"""Least squares of a law to a test, and whether one law fits significantly better than another."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import linalg, optimize, stats

from stochvi.identification.candidates import Candidate
from stochvi.identification.measurements import Measurement
from stochvi.mathematics.arrays import Matrix, Vector
from stochvi.results.intervals import CONFIDENCE, GAUSSIAN_95, student_quantile
from stochvi.scenes.impact_laws import ImpactLaw

STEP = 1e-5
"""Relative step of the derivatives of what a law predicts: contacts are integrated to 1e-9."""

SAME = 1e-6
"""Difference of two predictions, relative to the residuals, below which they are one."""

MOST_CORRELATED = 0.98
"""Largest correlation of neighbouring residuals that is taken into account."""

STARTS = (1.0, 0.3, 3.0)
"""Factors of the first guess from which the search for the least squares begins."""


@dataclass(frozen=True, eq=False)
class Errors:
    """The errors of a test: their covariance but for its size.

    Parameters
    ----------
    root
        Lower Cholesky factor of the covariance; None for errors that are independent and alike.
    ordered
        Whether residuals follow each other in time, and may be correlated by a law that is wrong
        or by the sensor.
    """

    root: Matrix | None
    ordered: bool

    def whitened(self, values: Matrix) -> Matrix:
        """Residuals, or their derivatives, whose errors are independent and alike."""
        if self.root is None:
            return values
        return np.asarray(linalg.solve_triangular(self.root, values, lower=True))

    def inflation(self, residuals: Vector) -> float:
        """Variance of a mean of neighbours over that of independent numbers, (1 + r) / (1 - r),
        with the correlation r of neighbouring residuals; 1 where they are not ordered."""
        square = float(residuals @ residuals)
        if not self.ordered or square == 0.0:
            return 1.0
        r = min(max(float(residuals[1:] @ residuals[:-1]) / square, 0.0), MOST_CORRELATED)
        return (1.0 + r) / (1.0 - r)


@dataclass(frozen=True, eq=False)
class Fit:
    """A law that was fitted to a test.

    Parameters
    ----------
    candidate, test, errors
        What was fitted to what.
    numbers
        The numbers of the law in units of the test, and behind them those of the test itself.
    """

    candidate: Candidate
    test: Measurement
    errors: Errors
    numbers: Vector

    @property
    def own(self) -> int:
        """Number of numbers of the law."""
        return len(self.candidate.start)

    @property
    def law(self) -> ImpactLaw:
        """The law."""
        return self.candidate.law(self.numbers[: self.own], self.test.scale)

    @property
    def extra(self) -> Vector:
        """The numbers of the test itself, in SI units."""
        return self.numbers[self.own :] * _sizes(self.test)

    def predicted(self, numbers: Vector) -> Vector:
        """What numbers predict."""
        return self.test.predicted(
            self.candidate.law(numbers[: self.own], self.test.scale),
            numbers[self.own :] * _sizes(self.test),
        )

    @cached_property
    def fitted(self) -> Vector:
        """What the law predicts for the test."""
        return self.predicted(self.numbers)

    @cached_property
    def residuals(self) -> Vector:
        """Whitened differences of what was observed and what the law predicts."""
        return self.errors.whitened(self.test.observed - self.fitted)

    @cached_property
    def jacobian(self) -> Matrix:
        """Derivatives of the whitened predictions."""
        return self.errors.whitened(self._derivatives(self.predicted))

    @cached_property
    def inflation(self) -> float:
        """By how much correlated residuals raise variances."""
        return self.errors.inflation(self.residuals)

    @property
    def degrees(self) -> float:
        """Degrees of freedom of the residuals, fewer where neighbours are correlated."""
        return max(len(self.residuals) / self.inflation - len(self.numbers), 1.0)

    @property
    def variance(self) -> float:
        """Variance of a whitened residual."""
        return float(self.residuals @ self.residuals) / (len(self.residuals) - len(self.numbers))

    @cached_property
    def covariance(self) -> Matrix:
        """Covariance of the numbers in units of the test."""
        inverse = linalg.pinvh(self.jacobian.T @ self.jacobian)
        return np.asarray(self.variance * self.inflation * inverse)

    def standard_errors(self) -> Vector:
        """Standard errors of the numbers of the law in SI units, by their derivatives, and of those
        of the test itself behind them; they are widened so that their normal 95 % intervals are
        Student's."""
        turn = self._derivatives(self._in_si)
        widened = student_quantile(1.0 - CONFIDENCE, self.degrees) / GAUSSIAN_95
        return widened * np.sqrt(np.maximum(np.diag(turn @ self.covariance @ turn.T), 0.0))

    def _in_si(self, numbers: Vector) -> Vector:
        own = self.candidate.numbers(numbers[: self.own], self.test.scale).values()
        return np.array([*own, *(numbers[self.own :] * _sizes(self.test))])

    def _derivatives(self, function: Callable[[Vector], Vector]) -> Matrix:
        """Derivatives of a function of the numbers, by central differences within their limits."""
        low, high = limits(self.candidate, self.test)
        columns = []
        for place, number in enumerate(self.numbers):
            below, above = self.numbers.copy(), self.numbers.copy()
            step = STEP * max(abs(number), 0.1)
            below[place], above[place] = (
                max(number - step, low[place]),
                min(number + step, high[place]),
            )
            columns.append((function(above) - function(below)) / (above[place] - below[place]))
        return np.stack(columns, axis=1)

    def aicc(self, inflation: float) -> float:
        """Akaike's criterion for small samples (Hurvich and Tsai 1989), up to a constant that all
        laws share; `inflation` is that of the law that fits best."""
        n, p = len(self.residuals) / inflation, len(self.numbers) + 1
        mean_square = float(self.residuals @ self.residuals) / len(self.residuals)
        few = 2.0 * p * (p + 1) / (n - p - 1) if n - p > 1 else math.inf
        return n * math.log(max(mean_square, 1e-300)) + 2.0 * p + few

    def rejected_by(self, other: Fit) -> float:
        """Probability that residuals which this law leaves would point so far towards the other.

        It is the P test of Davidson and MacKinnon (1981): the difference of both predictions, as a
        further regressor of the residuals, has a Student's t. For a law within the other with one
        number fewer it is the F test.
        """
        difference = self.errors.whitened(other.fitted - self.fitted)
        basis = np.linalg.qr(self.jacobian)[0]
        left = difference - basis @ (basis.T @ difference)
        scale = math.sqrt(float(self.residuals @ self.residuals))
        size = math.sqrt(float(left @ left))
        if size <= SAME * scale:
            return 1.0
        direction, residuals = left / size, self.residuals - basis @ (basis.T @ self.residuals)
        along = float(direction @ residuals)
        rest = residuals - along * direction
        inflation = self.errors.inflation(rest)
        count = len(rest) - len(self.numbers) - 1
        if count < 1:
            return 1.0
        variance = float(rest @ rest) / count * inflation
        t = abs(along) / math.sqrt(max(variance, 1e-300))
        degrees = max(len(rest) / inflation - len(self.numbers) - 1, 1.0)
        return float(2.0 * stats.t.sf(t, degrees))


def fit(candidate: Candidate, test: Measurement, errors: Errors) -> Fit:
    """Fit a law by weighted least squares, from the best of some starts."""
    extra = np.array([value for value, _ in test.start.values()])
    guess = np.array([*candidate.start, *(extra / _sizes(test))])
    low, high = limits(candidate, test)
    blank = Fit(candidate, test, errors, guess)

    def residuals(numbers: Vector) -> Vector:
        left = test.observed - blank.predicted(numbers)
        return errors.whitened(left) / spread

    spread = float(np.linalg.norm(errors.whitened(test.observed))) or 1.0
    found = []
    for factor in STARTS[:1] if len(extra) else STARTS:
        start = guess.copy()
        start[0] = min(max(factor * start[0], low[0] + 1e-9), high[0] * (1.0 - 1e-9))
        found.append(
            optimize.least_squares(
                residuals,
                start,
                bounds=(low, high),
                x_scale="jac",
                diff_step=np.full(len(start), STEP),
                xtol=1e-10,
                ftol=1e-12,
                gtol=1e-12,
                max_nfev=200,
            )
        )
    best = min(found, key=lambda each: each.cost)
    return Fit(candidate, test, errors, np.asarray(best.x))


def limits(candidate: Candidate, test: Measurement) -> tuple[Vector, Vector]:
    """Least and largest numbers of a fit."""
    free = [np.inf] * len(test.start)
    return (
        np.array([*candidate.low, *(-each for each in free)]), np.array([*candidate.high, *free])
    )  # fmt: skip


def errors_of(candidate: Candidate, test: Measurement) -> Errors:
    """The errors of a test: those whose size is known, and a scatter of all numbers alike.

    The scatter is sized by a law of many numbers: with its variance the mean square of the weighted
    residuals is 1 (Paule and Mandel 1982).
    """
    known, plain = test.known_errors, Errors(None, test.ordered)
    if known is None:
        return plain
    left = test.observed - fit(candidate, test, plain).fitted
    count, one = len(left) - len(candidate.start), np.eye(len(known))
    least, most = 1e-9 * float(np.trace(known)), float(left @ left)

    def excess(scatter: float) -> float:
        return float(left @ np.linalg.solve(known + scatter * one, left)) - count

    scatter = optimize.brentq(excess, least, most) if excess(least) > 0.0 > excess(most) else least
    return Errors(np.asarray(np.linalg.cholesky(known + scatter * one)), test.ordered)


def _sizes(test: Measurement) -> Vector:
    """Units of the numbers of the test itself: their first guesses."""
    return np.array([abs(value) or 1.0 for value, _ in test.start.values()])
