"""The law of a stop, fitted to a test. Chapters: laws as functions of numbers of the order of 1;
least squares, and which law fits better; the fitted laws, and the one to take; the calculation."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
import scipy

from stochvi.identification.measurements import (
    DropRecord,
    ForceCurve,
    Measurement,
    Rebounds,
    Scale,
)
from stochvi.mathematics.numerics import Matrix, Vector
from stochvi.results.base import DataFrame, Result, frame_of
from stochvi.results.estimates import (
    CONFIDENCE,
    GAUSSIAN_95,
    Cost,
    Estimate,
    provenance,
    student_quantile,
)
from stochvi.sampling.calculations import calculation
from stochvi.scenes.impact_laws import (
    CompliantLaw,
    Elastic,
    Hertz,
    ImpactLaw,
    PowerLaw,
    Restitution,
    RigidLaw,
    SpeedRestitution,
    Viscoelastic,
)
from stochvi.scenes.impact_laws.rigid import (
    LEAST,
    Body,
    hunt_crossley_restitution,
    viscoelastic_restitution,
    yielding_restitution,
)
from stochvi.scenes.validation import Scatter

# ------------------------------------------------------------------------------
# Laws that a stop may follow, as functions of numbers that are of the order of 1 in a test.
# ------------------------------------------------------------------------------


MOST_LOSS = 10.0
"""Largest force of a loss that is fitted, at the usual deflection and speed, over the usual force;
with it the mass hardly comes back."""

STEEPEST = 12.0
"""Largest exponent of a force that is fitted."""


@dataclass(frozen=True, kw_only=True)
class Candidate:
    """A law with free numbers.

    Parameters
    ----------
    name
        Name of the law.
    words
        Its formula.
    start, low, high
        First guess and limits of its numbers, in units of the test.
    numbers
        The numbers in SI units, by their names with units, from those in units of the test.
    law
        The law of those numbers in SI units.
    body
        The `body` of a restitution that depends on the speed, in a scene file.
    """

    name: str
    words: str
    start: Sequence[float]
    low: Sequence[float]
    high: Sequence[float]
    numbers: Callable[[Vector, Scale], dict[tuple[str, str], float]]
    law: Callable[[Vector, Scale], ImpactLaw]
    body: Body | None = None


def candidates_of(test: Measurement) -> list[Candidate]:
    """The laws that a test may tell apart, those of the fewest numbers first."""
    if isinstance(test, Rebounds):
        return RIGID
    dynamic = isinstance(test, DropRecord) or (
        isinstance(test, ForceCurve) and test.speed is not None
    )
    found = [*SPRINGS, *DAMPED] if dynamic else SPRINGS
    return sorted(found, key=lambda each: len(each.start))


# ---- rigid stops ----------------------------------------------------------------------------


def _by_speed(
    name: str, words: str, body: Body, key: tuple[str, str], start: float,
    number: Callable[[float, Scale], float], at: Callable[[float, Vector], Vector],
) -> Candidate:  # fmt: skip
    """A restitution that depends on the speed over that of the test, by one number."""
    return Candidate(
        name=name, words=words, start=(start,), low=(0.0,), high=(np.inf,),
        numbers=lambda p, scale: {key: number(float(p[0]), scale)},
        law=lambda p, scale: SpeedRestitution(
            coefficient=lambda w, p=float(p[0]), w0=scale.speed: at(p, w / w0)
        ),
        body=body,
    )  # fmt: skip


RIGID = [
    Candidate(
        name="constant", words="R",
        start=(0.5,), low=(0.0,), high=(1.0,),
        numbers=lambda p, scale: {("R", ""): float(p[0])},
        law=lambda p, scale: Restitution(coefficient=float(p[0])),
    ),
    _by_speed(
        "viscoelastic body", "1 - 1.15 b w^(1/5) + ..., Kuwabara and Kono", "viscoelastic",
        ("b", "(s/m)^(1/5)"), 0.3, lambda p, scale: p * scale.speed**-0.2,
        lambda p, ratio: viscoelastic_restitution(p * ratio**0.2),
    ),
    _by_speed(
        "Hunt and Crossley", "1 - (2/3) a w + ...", "hunt-crossley",
        ("a", "s/m"), 0.3, lambda p, scale: p / scale.speed,
        lambda p, ratio: hunt_crossley_restitution(p * ratio),
    ),
    _by_speed(
        "yielding body", "(w_y / w)^(1/4) above w_y", "yielding",
        ("w_y", "m/s"), 0.1, lambda p, scale: p * scale.speed,
        lambda p, ratio: yielding_restitution(ratio / max(p, 1e-12)),
    ),
    Candidate(
        name="power of the speed", words="R_0 (w / w_0)^q, w_0 the mean speed of the test",
        start=(0.5, 0.0), low=(0.0, -2.0), high=(1.0, 2.0),
        numbers=lambda p, scale: {
            ("R_0", ""): float(p[0]), ("q", ""): float(p[1])
        },
        law=lambda p, scale: SpeedRestitution(
            coefficient=lambda w, r=float(p[0]), q=float(p[1]), w0=scale.speed: np.clip(
                r * (w / w0) ** q, 0.0, 1.0
            )
        ),
        body="power",
    ),
]  # fmt: skip
"""Laws of the restitution over the speed w."""


# ---- compliant stops ------------------------------------------------------------------------


def _force(
    name: str, words: str, exponent: float | None, loss: float | str | None = None
) -> Candidate:
    """The force k y^n + c y^m y', with n free if it is None; `loss` is m, or "n" for m = n."""
    free, lossy = exponent is None, loss is not None

    def parts(p: Vector, scale: Scale) -> tuple[float, float, float, float]:
        n = float(p[1]) if exponent is None else exponent
        m = n if loss == "n" else float(loss or 0.0)
        deep, force, speed, _ = scale
        c = float(p[-1]) * force / (deep**m * speed) if lossy else 0.0
        return float(p[0]) * force / deep**n, n, c, m

    def numbers(p: Vector, scale: Scale) -> dict[tuple[str, str], float]:
        k, n, c, m = parts(p, scale)
        found = {("k", "N/m" if n == 1.0 else f"N/m^{n:.3g}"): k}
        if free:
            found = {("k", "N/m^n"): k, ("n", ""): n}
        if lossy:
            power = "n + 1" if free else f"{m + 1.0:g}"
            found["c", "N s/m" if power == "1" else f"N s/m^({power})"] = c
        return found

    def law(p: Vector, scale: Scale) -> PowerLaw:
        k, n, c, m = parts(p, scale)
        return PowerLaw(
            coefficient=max(k, 1e-300), exponent=n, loss=c, loss_exponent=m if lossy else n
        )

    return Candidate(
        name=name, words=words,
        start=(1.0, *((1.5,) if free else ()), *((0.2,) if lossy else ())),
        low=(1e-6, *((1.0,) if free else ()), *((0.0,) if lossy else ())),
        high=(np.inf, *((STEEPEST,) if free else ()), *((MOST_LOSS,) if lossy else ())),
        numbers=numbers, law=law,
    )  # fmt: skip


SPRINGS = [
    _force("elastic", "k y", 1.0),
    _force("Hertz", "k y^(3/2)", 1.5),
    _force("power", "k y^n", None),
]
"""Forces without a loss."""

DAMPED = [
    _force("Kelvin-Voigt", "k y + c y'", 1.0, 0.0),
    _force("Hunt and Crossley", "k y^(3/2) + c y^(3/2) y'", 1.5, 1.5),
    _force("viscoelastic body", "k y^(3/2) + c y^(1/2) y', Kuwabara and Kono", 1.5, 0.5),
    _force("power with a loss", "k y^n + c y^n y'", None, "n"),
]
"""Forces with a loss."""


def by_speed(law: RigidLaw, body: Body, exponent: float, speed: float) -> ImpactLaw:
    """The law of the same restitutions as scene files have it, by that at a speed, m/s."""
    value = float(law.restitution_at([speed])[0])
    if value < LEAST:
        return Restitution(coefficient=value)
    power = exponent if body == "power" else None
    return SpeedRestitution(coefficient=value, at_speed=speed, body=body, exponent=power)


def as_written(law: ImpactLaw, mass: float | None) -> ImpactLaw:
    """The law of the same force that scene files have a kind for; a damping ratio needs a mass."""
    if not isinstance(law, PowerLaw):
        return law
    if law.exponent == 1.0 and law.conservative:
        return Elastic(stiffness=law.coefficient)
    if law.exponent == 1.5 and law.conservative:
        return Hertz(coefficient=law.coefficient)
    if (law.exponent, law.loss_exponent) == (1.0, 0.0) and mass is not None:
        ratio = law.loss / (2.0 * (law.coefficient * mass) ** 0.5)
        return Viscoelastic(stiffness=law.coefficient, damping_ratio=ratio, mass=mass)
    return law


# ------------------------------------------------------------------------------
# Least squares of a law to a test, and whether one law fits significantly better than another.
# ------------------------------------------------------------------------------


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
        return np.asarray(scipy.linalg.solve_triangular(self.root, values, lower=True))

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
        inverse = scipy.linalg.pinvh(self.jacobian.T @ self.jacobian)
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
        return float(2.0 * scipy.stats.t.sf(t, degrees))


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
            scipy.optimize.least_squares(
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

    scatter = (
        scipy.optimize.brentq(excess, least, most) if excess(least) > 0.0 > excess(most) else least
    )
    return Errors(np.asarray(np.linalg.cholesky(known + scatter * one)), test.ordered)


def _sizes(test: Measurement) -> Vector:
    """Units of the numbers of the test itself: their first guesses."""
    return np.array([abs(value) or 1.0 for value, _ in test.start.values()])


# ------------------------------------------------------------------------------
# The laws that were fitted to a test of a stop, and the one to take.
# ------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class LawFit:
    """A law with the numbers at which it fits a test best.

    Parameters
    ----------
    formula
        The law as a formula.
    numbers
        Its numbers with their standard errors, SI units.
    units
        Units of the numbers.
    residual
        Standard deviation of what was observed about the law, in the unit of the test.
    criterion
        Akaike's criterion for small samples, less that of the law where it is smallest. A law that
        is worse by 10 has hardly any support.
    rejected
        Probability that the law, if it were true, would fit so much worse than the one of the
        smallest criterion; None for that one. Below 0.05 it is rejected.

    See Also
    --------
    stochvi.identification.Identification : All laws of a test.
    """

    formula: str
    numbers: Mapping[str, Estimate]
    units: Mapping[str, str]
    residual: float
    criterion: float
    rejected: float | None


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Identification(Result):
    """The law of a stop that a test shows.

    Parameters
    ----------
    test
        The test.
    fits
        The laws that were fitted, by name.
    chosen
        Name of the law to take: of those that are not rejected the one with the fewest numbers.
    law
        The law itself.
    line
        The law as a line of a scene file.
    of_test
        Numbers of the test itself that were fitted beside the law, such as the speed of approach.
    curve
        What was observed (`observed`) at which `place`, and what each law predicts there.
    loop
        Deflection (m), speed (m/s) and force (N) in the contact, from the integrated record of a
        drop. The force of the `law` on that motion stands beside them. None for other tests.
    assumptions
        What the test is taken to be, a sentence each.

    See Also
    --------
    stochvi.identify : The calculation.
    """

    kind = "identify"
    in_document: ClassVar = {"summary": "summary"}

    not_in_document = ("test", "law")

    test: Measurement
    fits: Mapping[str, LawFit]
    chosen: str
    law: ImpactLaw
    line: str
    of_test: Mapping[str, Estimate]
    curve: DataFrame
    loop: DataFrame | None = None
    assumptions: Sequence[str] = ()

    @property
    def best(self) -> LawFit:
        """The fit of the law to take."""
        return self.fits[self.chosen]

    def summary(self) -> str:
        """The law in a sentence."""
        numbers = ", ".join(
            f"{name} = {value} {self.best.units[name]}".rstrip()
            for name, value in self.best.numbers.items()
        )
        return f"{self.chosen}: {self.best.formula}; {numbers.replace(' [fit]', '')}"

    def to_frame(self) -> DataFrame:
        """One row per number of each law, with the law's misfit."""
        return frame_of(
                {
                    "law": name, "number": number, "value": each.value,
                    "standard_error": each.standard_error, "unit": fit.units[number],
                    "residual": fit.residual, "criterion": fit.criterion, "rejected": fit.rejected,
                }
                for name, fit in self.fits.items()
                for number, each in fit.numbers.items()
        )  # fmt: skip


# ------------------------------------------------------------------------------
# The law of a stop, fitted to a test.
# ------------------------------------------------------------------------------


LEVEL = 0.05
"""Probability below which a law is rejected."""

SPARE = 2
"""Number of observations that are needed beyond the numbers of a law, so that laws are compared;
the first law alone is fitted with one."""

CORRELATED = 3.0
"""Inflation of variances by correlated residuals from which a note tells of it."""


@calculation
def identify(test: Measurement, *, at_speed: float | None = None) -> Identification:
    """Fit the laws of a stop to a test of it, and tell which one the test supports.

    Each law is fitted by least squares. A law is rejected if the one of the smallest AICc (Hurvich
    and Tsai 1989) explains more of its residuals than scatter would: the P test of Davidson and
    MacKinnon (1981), at 5 %. The law with the fewest numbers is taken from those that are left. A
    law of more numbers than the test carries is not fitted.

    Parameters
    ----------
    test
        `Rebounds`, also those of times of impacts; a `ForceCurve`; or a `DropRecord`.
    at_speed
        Speed, m/s, by whose restitution one that depends on the speed is written into the line for
        a scene file; by default the mean speed of the test.

    Returns
    -------
    Identification
        The laws with their numbers and standard errors, and the line of a scene file.

    Raises
    ------
    ValueError
        If the test has too few rows for any law.

    See Also
    --------
    stochvi.identification.read_test : A test from a file.
    stochvi.Viscoelastic : A stop of rubber.

    Examples
    --------
    >>> from stochvi.identification import Rebounds
    >>> test = Rebounds(approach=[0.5, 1.0, 1.5, 2.0], rebound=[0.36, 0.69, 1.06, 1.39])
    >>> found = identify(test)
    >>> found.chosen, found.line
    ('constant', 'law = { kind = "restitution", coefficient = 0.703 }')
    """
    if not isinstance(test, Measurement):
        raise ValueError(
            f"test must be Rebounds, a ForceCurve or a DropRecord, got {type(test).__name__}"
        )
    if at_speed is not None and not 0.0 < at_speed < math.inf:
        raise ValueError(f"at_speed must be a positive speed (m/s), got {at_speed:g}")
    began = time.perf_counter()
    known, left_out = _carried(test)
    errors = errors_of(known[-1], test)
    fits = [fit(each, test, errors) for each in known]
    closest = min(fits, key=lambda each: float(each.residuals @ each.residuals))
    criteria = [each.aicc(closest.inflation) for each in fits]
    best = fits[int(np.argmin(criteria))]
    rejected = [None if each is best else each.rejected_by(best) for each in fits]
    kept = [
        (len(each.numbers), criterion, number)
        for number, (each, criterion, p) in enumerate(zip(fits, criteria, rejected, strict=True))
        if p is None or p >= LEVEL
    ]
    chosen = fits[min(kept)[-1]]
    mass = getattr(test, "mass", None)
    law, body = chosen.law, chosen.candidate.body
    if body is not None and isinstance(law, RigidLaw):
        exponent = float(chosen.numbers[chosen.own - 1])
        law = by_speed(law, body, exponent, at_speed or test.scale.speed)
    else:
        law = as_written(law, mass)
    least = min(criteria)
    told = {
        each.candidate.name: _told(each, criterion - least if least < math.inf else 0.0, p)
        for each, criterion, p in zip(fits, criteria, rejected, strict=True)
    }
    return Identification(
        test=test, fits=told, chosen=chosen.candidate.name, law=law,
        line=_line(law), of_test=_of_test(chosen), curve=_curve(test, fits),
        loop=_loop(test, chosen), assumptions=test.assumptions,
        warnings=_warnings(chosen, [fits[number] for *_, number in kept], left_out, law, test),
        cost=Cost(wall_time=time.perf_counter() - began), provenance=provenance({}),
    )  # fmt: skip


def _carried(test: Measurement) -> tuple[list[Candidate], list[Candidate]]:
    """The laws whose numbers a test carries, and those with too many numbers."""
    count, own = len(test.observed), len(test.start)
    distinct = len(np.unique(np.round(np.log(np.abs(test.place) + 1e-300), 6)))
    every = candidates_of(test)
    known = [
        each
        for each in every
        if len(each.start) + own + SPARE <= count and len(each.start) <= distinct
    ]
    if not known:
        known = [each for each in every[:1] if len(each.start) + own < count]
    if not known:
        raise ValueError(
            f"test must have at least {2 + own} observations, got {count}; measure more"
        )
    return known, [each for each in every if each not in known]


def _told(found: Fit, criterion: float, rejected: float | None) -> LawFit:
    si = found.candidate.numbers(found.numbers[: found.own], found.test.scale)
    errors = found.standard_errors()
    return LawFit(
        formula=found.candidate.words,
        numbers={
            name: Estimate(value=value, standard_error=float(error), how="fit")
            for ((name, _), value), error in zip(si.items(), errors, strict=False)
        },
        units=dict(list(si)),
        residual=float(np.std(found.test.observed - found.fitted)),
        criterion=criterion, rejected=rejected,
    )  # fmt: skip


def _of_test(found: Fit) -> Mapping[str, Estimate]:
    """Numbers of the test itself."""
    errors = found.standard_errors()[len(found.numbers) - len(found.test.start) :]
    values = found.extra
    return {
        name: Estimate(value=float(value), standard_error=float(error), how="fit")
        for name, value, error in zip(found.test.start, values, errors, strict=True)
    }


def _curve(test: Measurement, fits: list[Fit]) -> Any:
    columns = {"place": test.place, "observed": test.observed}
    columns |= {each.candidate.name: each.fitted for each in fits}
    return frame_of(columns)


def _loop(test: Measurement, found: Fit) -> Any:
    if not isinstance(test, DropRecord):
        return None
    law = found.law
    assert isinstance(law, CompliantLaw)
    y, v, force = test.motion(law, found.extra)
    return frame_of(
        {"deflection": y, "speed": v, "force": force, "law": law.force_at(y, v, test.mass)}
    )


def _line(law: ImpactLaw) -> str:
    """The law as a line of a scene file, with the digits that a test carries."""
    if isinstance(law, SpeedRestitution):
        power = "" if law.exponent is None else f", exponent = {law.exponent:.3g}"
        return (
            f'law = {{ kind = "{law.kind}", coefficient = {law.restitution:.3g}, at_speed = '
            f'{law.at_speed:.3g}, body = "{law.body}"{power} }}'
        )
    if isinstance(law, Restitution):
        return f'law = {{ kind = "restitution", coefficient = {law.restitution:.3g} }}'
    given = {
        name: value
        for name, value in law.model_dump(exclude_defaults=True).items()
        if isinstance(value, float)
    }
    if given.get("loss_exponent") == law.model_dump().get("exponent"):
        given.pop("loss_exponent", None)
    keys = "".join(f", {name} = {value:.4g}" for name, value in given.items())
    return f'law = {{ kind = "{law.kind}"{keys} }}'


def _warnings(
    chosen: Fit, kept: list[Fit], left_out: list[Candidate], law: ImpactLaw, test: Measurement
) -> tuple[str, ...]:
    notes = []
    others = [each for each in kept if each is not chosen]
    alike = [each.candidate.name for each in others if each.own <= chosen.own]
    larger = [each.candidate.name for each in others if each.own > chosen.own]
    if alike:
        notes.append(
            f"the test does not tell {chosen.candidate.name} from {', '.join(alike)}; a wider "
            f"range of {'speeds' if isinstance(test, Rebounds) else 'deflections'} would"
        )
    if larger:
        notes.append(
            f"{', '.join(larger)} fits no better: the test does not carry a further number"
        )
    if left_out:
        names = ", ".join(each.name for each in left_out)
        notes.append(
            f"{len(test.observed)} observations do not carry the numbers of {names}, which was "
            "not fitted"
        )
    if isinstance(test, Rebounds):
        notes += _of_rebounds(chosen, law)
    if isinstance(test, ForceCurve) and test.speed is None:
        notes.append("a slow press shows no loss: the line is that of a stop without one")
    if getattr(test, "mass", 1.0) is None and getattr(law, "loss_exponent", None) == 0.0:
        notes.append("with a mass the line is that of a viscoelastic stop and its damping ratio")
    if chosen.inflation > CORRELATED:
        notes.append(
            "neighbouring residuals are alike: the law is wrong in a part of the curve, or the "
            f"sensor is slow; standard errors are widened by {math.sqrt(chosen.inflation):.2g}"
        )
    return tuple(notes)


def _of_rebounds(chosen: Fit, law: ImpactLaw) -> list[str]:
    """Notes to a restitution: its dependence on the speed, and its scatter."""
    if isinstance(law, SpeedRestitution):
        return [
            "methods for a constant restitution take that of the speed in the line: "
            f'{{ kind = "restitution", coefficient = {law.restitution:.3g} }}'
        ]
    assert isinstance(law, Restitution)
    spread = float(np.std(chosen.test.observed - chosen.fitted, ddof=1))
    if chosen.errors.root is not None or not spread > 0.0:
        return []
    try:
        Restitution(coefficient=Scatter(mean=law.restitution, std=spread))
    except ValueError:
        return []
    return [
        f"impacts scatter by {spread:.2g}; if it is the stop that scatters, and not the "
        f"measurement: coefficient = {{ mean = {law.restitution:.3g}, std = {spread:.2g} }}"
    ]
