"""Shocks at random times beside noise: how they have moved displacements, and how probably.

Shocks come at the times of a Poisson process of the rate lambda. Each moves a displacement by
a r(t), with its size a and the response r to a shock of size 1. It has died out after a window. The
mean about which noise moves the displacement is then the sum over the shocks in the window. It
holds n of them with the probability of Poisson, at independent uniform times. Averages over shocks
are sums over n, and for each n over the points of a net of Sobol' in their ages and sizes. Half of
the ages are those at which a shock moves most.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.special import ndtri

from stochvi.mathematics.arrays import Matrix, Vector

ONE_SHOCK, SEVERAL_SHOCKS = 2**15, 2**13
"""Points of the net for one shock in the window, and for each larger number."""

LEFT_OUT = 1e-8
"""Probability of more shocks in the window than are looked at: what they may bring is a bias."""

MOST_IN_WINDOW = 2.0
"""Mean number of shocks in the window above which they are not apart."""

SIZES: dict[str, Callable[[Vector], Vector]] = {
    "equal": np.ones_like,
    "normal": lambda share: np.asarray(ndtri(0.5 + 0.5 * share)),
    "exponential": lambda share: np.asarray(-np.log1p(-share)),
}
"""Sizes of shocks at quantiles, by the names of their distributions."""


@dataclass(frozen=True, eq=False)
class Shocks:
    """Shocks that move displacements. A state of them is the ages (s) and sizes of the shocks in
    the window, in turn, (..., 2 most); a size of 0 stands for none.

    Parameters
    ----------
    rate
        Mean number of shocks per second.
    step
        Interval of the responses, s.
    responses
        (displacements, samples, 2): displacement and velocity after a shock of size 1, from its
        start on; none is left after the last sample.
    window
        Time for which shocks are remembered, s, at least the length of the responses.
    sizes, two_sided
        Distribution of the sizes, and whether each has either direction with equal probability.
    """

    rate: float
    step: float
    responses: Vector
    window: float
    sizes: str
    two_sided: bool

    @property
    def expected(self) -> float:
        """Mean number of shocks in the window."""
        return self.rate * self.window

    @cached_property
    def most(self) -> int:
        """Largest number of shocks in the window that is looked at."""
        from scipy.stats import poisson

        return max(1, int(poisson.isf(LEFT_OUT, self.expected)))

    @property
    def number(self) -> int:
        """Numbers of a state."""
        return 2 * self.most

    @property
    def left_out(self) -> float:
        """Probability of more shocks in the window."""
        from scipy.stats import poisson

        return float(poisson.sf(self.most, self.expected))

    @property
    def missed_rate(self) -> float:
        """Rate at which more shocks than are looked at come together, 1/s."""
        return self.left_out / self.window

    @property
    def symmetric(self) -> bool:
        """Whether the opposite motion is as likely."""
        return self.two_sided

    @cached_property
    def net(self) -> tuple[Matrix, Vector]:
        """States (points, 2 most) and their probabilities (points,)."""
        return self._net(1)

    @cached_property
    def coarse_net(self) -> tuple[Matrix, Vector]:
        """The same with half as many points."""
        return self._net(2)

    def _net(self, fewer: int) -> tuple[Matrix, Vector]:
        from scipy.stats import poisson, qmc

        states, weights = [np.zeros((1, self.number))], [np.array([math.exp(-self.expected)])]
        for count in range(1, self.most + 1):
            points = (ONE_SHOCK if count == 1 else SEVERAL_SHOCKS) // fewer
            net = qmc.Sobol(3 * count, scramble=False).random_base2(round(math.log2(points)))
            shares = np.asarray(net + 0.5 / points).reshape(points, count, 3)
            found = np.zeros((points, self.most, 2))
            found[:, :count, 0], rarity = self._ages(shares[..., 0])
            found[:, :count, 1] = SIZES[self.sizes](shares[..., 1])
            if self.two_sided:
                found[:, :count, 1] *= np.where(shares[..., 2] < 0.5, -1.0, 1.0)
            states.append(found.reshape(points, self.number))
            weights.append(poisson.pmf(count, self.expected) / points * rarity.prod(axis=1))
        return np.concatenate(states), np.concatenate(weights)

    def _ages(self, shares: Vector) -> tuple[Vector, Vector]:
        """Ages of shocks at quantiles of a density that is half even, and half in proportion to the
        squared motion at that age; and the even density over it."""
        ends = np.append(self.step * np.arange(self.responses.shape[1]), self.window)
        squares = np.sum((self.responses[..., 0] / self.reach[:, None]) ** 2, axis=0)
        squares = np.append(0.5 * (squares[1:] + squares[:-1]), 0.0)
        widths = np.diff(ends)
        parts = 0.5 * widths / self.window + 0.5 * squares * widths / (squares @ widths)
        ages = np.interp(shares, np.append(0.0, np.cumsum(parts)) / parts.sum(), ends)
        part = np.clip(np.searchsorted(ends, ages, side="right") - 1, 0, len(parts) - 1)
        return ages, (widths / self.window / parts)[part]

    def at(self, states: Matrix) -> tuple[Matrix, Matrix]:
        """Displacements and velocities (displacements, ...) in states (..., 2 most)."""
        shape = states.shape[:-1]
        flat = states.reshape(-1, self.most, 2)
        moved = np.zeros((2, len(self.responses), len(flat)))
        for shock in range(self.most):
            (struck,) = np.nonzero(flat[:, shock, 1])
            age, size = flat[struck, shock].T
            moved[:, :, struck] += size * self.response_at(age)
        place, speed = moved.reshape(2, len(self.responses), *shape)
        return place, speed

    def response_at(self, age: Vector) -> Vector:
        """(2, displacements, ages): displacements and velocities, by cubics between samples."""
        place = age / self.step
        first = np.clip(np.floor(place).astype(int), 0, self.responses.shape[1] - 2)
        s = place - first
        (x0, v0), (x1, v1) = (self.responses[:, first + k].transpose(2, 0, 1) for k in (0, 1))
        v0, v1 = self.step * v0, self.step * v1
        bent, turned = 3.0 * (x1 - x0) - 2.0 * v0 - v1, 2.0 * (x0 - x1) + v0 + v1
        found = np.stack(
            [x0 + s * (v0 + s * (bent + s * turned)),
             (v0 + s * (2.0 * bent + 3.0 * s * turned)) / self.step]
        )  # fmt: skip
        return np.asarray(np.where((s >= 0.0) & (s <= 1.0), found, 0.0))

    def of(self, rows: Matrix) -> Shocks:
        """The shocks of combinations (rows, displacements) of these displacements."""
        return replace(self, responses=np.tensordot(rows, self.responses, 1))

    @property
    def mean_squares(self) -> tuple[Vector, Vector]:
        """Variances (displacements,) of displacement and velocity (N. R. Campbell 1909)."""
        shares = (np.arange(SEVERAL_SHOCKS) + 0.5) / SEVERAL_SHOCKS
        square = self.rate * float(np.mean(SIZES[self.sizes](shares) ** 2)) * self.step
        place, speed = (square * np.sum(self.responses**2, axis=1)).T
        return place, speed

    @property
    def reach(self) -> Vector:
        """(displacements,): largest displacement after a shock of size 1, m."""
        return np.asarray(np.abs(self.responses[..., 0]).max(axis=1))
