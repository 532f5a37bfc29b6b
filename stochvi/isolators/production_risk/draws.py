"""Points of units that are drawn more often where their risk is, each with its weight.

A rare mean is that of a few units: of 4096 units of even probability two may carry a mean of 1e-4.
So a share of the units is drawn from Gaussian distributions of their normal scores. The scores are
the points of the unit cube as quantiles of a normal distribution. Each stop that most units with a
risk hit has one such distribution. The distributions are fitted in rounds (cross-entropy method):
each draws from the last, with the risk to a power that rises to 1, so that no round hangs on a few
units. Weights are those of the mixture with the units of even probability (balance heuristic),
which keeps them bounded.

References
----------
.. [1] R. Y. Rubinstein and D. P. Kroese, The Cross-Entropy Method, Springer (2004), chapter 3.
.. [2] A. Owen and Y. Zhou, Safe and effective importance sampling, J. Am. Stat. Assoc. 95, 135-143
   (2000).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.special import logsumexp, ndtr, ndtri

from stochvi.mathematics.arrays import Matrix, Vector

EDGE = 1e-15
"""Least distance of a point from the faces of the unit cube."""

EFFECTIVE = 0.05
"""Share of the units that count in a round, as (sum p)^2 / sum p^2: the power of the risk is as
large as leaves so many."""

LEAST_PART = 0.02
"""Smallest share of the risk at a stop for which a Gaussian of its own is fitted."""

WIDER = 1.3
"""Factor on the fitted variances: weights of a distribution that is too narrow are unbounded."""

PER_AMOUNT = 4.0
"""Effective number of units for each amount at which correlations count half."""


class Gaussian(NamedTuple):
    """Mean and factor of the covariance (L L') of normal scores, and the share of its units."""

    mean: Vector
    factor: Matrix
    share: float

    def log_density(self, scores: Matrix) -> Vector:
        """(units,): logarithm of the density, without the factor (2 pi)^(-amounts / 2)."""
        away = np.linalg.solve(self.factor, (scores - self.mean).T)
        volume = float(np.log(np.diag(self.factor)).sum())
        return np.asarray(-0.5 * np.sum(away**2, axis=0) - volume)


def scores_of(points: Matrix) -> Matrix:
    """Normal scores of points of the unit cube."""
    return np.asarray(ndtri(np.clip(points, EDGE, 1.0 - EDGE)))


def drawn_from(parts: Sequence[Gaussian], points: Matrix) -> Matrix:
    """Points of units (units, amounts) from those of an even sequence (units, amounts + 1), whose
    first coordinate chooses the part."""
    bounds = np.cumsum([part.share for part in parts])[:-1]
    which = np.searchsorted(bounds, points[:, 0])
    scores = scores_of(points[:, 1:])
    found = np.empty_like(scores)
    for number, part in enumerate(parts):
        chosen = which == number
        found[chosen] = part.mean + scores[chosen] @ part.factor.T
    return np.asarray(np.clip(ndtr(found), EDGE, 1.0 - EDGE))


def weights_of(parts: Sequence[Gaussian], points: Matrix, even: int, drawn: int) -> Vector:
    """(units,): weights of `even` units of even probability and `drawn` ones of the parts together;
    they sum to about 1."""
    if not drawn:
        return np.full(len(points), 1.0 / len(points))
    scores = scores_of(points)
    plain = -0.5 * np.sum(scores**2, axis=1)
    own = [math.log(part.share) + part.log_density(scores) for part in parts]
    mixed = np.logaddexp(math.log(even) + plain, math.log(drawn) + logsumexp(own, axis=0))
    return np.asarray(np.exp(plain - mixed))


def effective_number(parts: Vector) -> float:
    """How many equal parts would make a sum as uncertain: (sum p)^2 / sum p^2."""
    square = float(np.sum(parts**2))
    return float(np.sum(parts)) ** 2 / square if square else 0.0


def power_of(weight: Vector, risk: Vector) -> float:
    """The largest power of the risk, up to 1, that leaves the share EFFECTIVE of the units."""
    with np.errstate(divide="ignore"):
        log_weight, log_risk = np.log(weight), np.log(risk)
    log_risk = log_risk - log_risk.max()
    wanted = EFFECTIVE * len(weight)

    def excess(power: float) -> float:
        with np.errstate(invalid="ignore"):
            parts = np.exp(log_weight - log_weight.max() + power * log_risk)
        return effective_number(parts) - wanted

    if excess(1.0) >= 0.0 or excess(1e-6) <= 0.0:
        return 1.0 if excess(1.0) >= 0.0 else 1e-6
    return float(brentq(excess, 1e-6, 1.0, xtol=1e-4))


def fitted(
    points: Matrix, weight: Vector, risk: Vector, label: NDArray[np.int64]
) -> list[Gaussian]:
    """Gaussians of the scores of units, one for each label, weighted with risk and weight."""
    scores, parts = scores_of(points), weight * risk
    whole, found = parts.sum(), []
    for each in np.unique(label):
        own = parts * (label == each)
        if own.sum() < LEAST_PART * whole:
            continue
        own /= own.sum()
        mean = own @ scores
        away = scores - mean
        covariance = (own[:, None] * away).T @ away
        number = effective_number(own)
        kept = number / (number + PER_AMOUNT * len(mean))
        diagonal = np.diag(np.diag(covariance))
        covariance = kept * covariance + (1.0 - kept) * diagonal
        # few units say little of the width: that of all units takes its place
        covariance = kept * covariance + (1.0 - kept) * np.eye(len(mean))
        factor = np.linalg.cholesky(WIDER * covariance + 1e-6 * np.eye(len(mean)))
        found.append(Gaussian(mean, factor, float(parts[label == each].sum())))
    total = sum(part.share for part in found)
    return [part._replace(share=part.share / total) for part in found]
