"""The density C exp(-U(x) / theta) of a mass on a spring between stops that give way.

U(x) = omega^2 x^2 / 2 - load x + V_u(x - upper) + V_l(lower - x), all per unit mass; a rigid stop
cuts the density instead. U is convex, so the density has one peak, and everything is computed
relative to it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import brentq

from stochvi.collisions import ContactStatistics
from stochvi.contacts import CompliantLaw, ForceTable, Law
from stochvi.cut_normal import CUT, NODES, WEIGHTS

Vector = NDArray[np.float64]

MOST_DOUBLINGS = 2000
"""Of a bracket: from any length that a floating-point number holds to any other."""


@dataclass(frozen=True, kw_only=True)
class GibbsLaw:
    """Density of x where v is N(0, theta) and independent of it (B 13.38).

    Parameters
    ----------
    theta
        E v^2, m^2/s^2.
    omega, load
        Natural frequency, rad/s, and constant load per unit mass, m/s^2.
    stop_lower, stop_upper
        Positions of the stops, m; None for none.
    law_lower, law_upper
        Their laws for forces per unit mass; of a viscoelastic stop the spring alone counts.

    Raises
    ------
    ValueError
        Where nothing holds the mass on one side.

    Examples
    --------
    >>> from stochvi.contacts import Elastic
    >>> law = GibbsLaw(theta=1.0, omega=1.0, stop_upper=1.0, law_upper=Elastic(stiffness=100.0))
    >>> round(law.mean, 12), round(law.contact("upper").probability, 12)
    (-0.243802368138, 0.032121450803)
    """

    theta: float
    omega: float
    load: float = 0.0
    stop_lower: float | None = None
    stop_upper: float | None = None
    law_lower: Law | None = None
    law_upper: Law | None = None

    def __post_init__(self) -> None:
        if not self.holds("lower") or not self.holds("upper"):
            raise ValueError("neither spring nor stops hold the mass")

    @property
    def lower(self) -> float | None:
        """Where a rigid lower stop cuts the density."""
        return None if self._compliant("lower") else self.stop_lower

    @property
    def upper(self) -> float | None:
        """Where a rigid upper stop cuts the density."""
        return None if self._compliant("upper") else self.stop_upper

    def _compliant(self, side: str) -> CompliantLaw | None:
        law = getattr(self, f"law_{side}")
        return law if isinstance(law, CompliantLaw) else None

    def holds(self, side: str) -> bool:
        """Whether the mass cannot be lost on this side."""
        if self.omega > 0.0:
            return True
        outward = self.load if side == "upper" else -self.load
        if getattr(self, f"stop_{side}") is None:
            return outward < 0.0
        law = self._compliant(side)
        if isinstance(law, ForceTable) and law.pieces[2, -1] == 0.0:
            return law.force[-1] > outward
        return True

    # The potential ------------------------------------------------------------------------

    def _deflections(self, x: ArrayLike) -> list[tuple[CompliantLaw, float, Vector]]:
        """(law, side, deflection) of each stop that gives way; side is +1 for the upper."""
        x = np.asarray(x, dtype=float)
        found = []
        for side, sign in (("lower", -1.0), ("upper", 1.0)):
            law, stop = self._compliant(side), getattr(self, f"stop_{side}")
            if law is not None:
                found.append((law, sign, sign * (x - stop)))
        return found

    def _pull(self, x: ArrayLike) -> Vector:
        """U'(x)."""
        spring = self.omega**2 * np.asarray(x, dtype=float) - self.load
        stops = [sign * law.force_at(y) for law, sign, y in self._deflections(x)]
        return np.asarray(sum(stops, spring))

    def _rise(self, offset: ArrayLike, origin: float) -> Vector:
        """U(origin + offset) - U(origin)."""
        offset = np.asarray(offset, dtype=float)
        spring = offset * (self.omega**2 * (origin + offset / 2.0) - self.load)
        there, here = self._deflections(origin + offset), self._deflections(origin)
        stops = [
            law.potential_at(y) - law.potential_at(before)
            for (law, _, y), (_, _, before) in zip(there, here, strict=True)
        ]
        return np.asarray(sum(stops, spring))

    @cached_property
    def _scale(self) -> float:
        """A length to start a search from: no larger than any on which the density changes."""
        speed = math.sqrt(self.theta)
        lengths = [law.impact(speed, 1.0).peak_deflection for law, _, _ in self._deflections(0.0)]
        if self.omega > 0.0:
            lengths.append(speed / self.omega)
        if self.load:
            lengths.append(self.theta / abs(self.load))
        if self.stop_lower is not None and self.stop_upper is not None:
            lengths.append(self.stop_upper - self.stop_lower)
        return min(length for length in lengths if length > 0.0)

    @cached_property
    def peak(self) -> float:
        """Where the density is largest: U' = 0, or a rigid stop."""
        start = self.load / self.omega**2 if self.omega else 0.0
        stops = [stop for stop in (self.stop_lower, self.stop_upper) if stop is not None]
        if self.omega == 0.0 or any(float(self._pull(stop)) == 0.0 for stop in stops):
            start = stops[0]
        low = -math.inf if self.lower is None else self.lower
        high = math.inf if self.upper is None else self.upper
        start = min(max(start, low), high)
        slope = float(self._pull(start))
        if slope == 0.0:
            return start
        away = -math.copysign(1.0, slope)
        end = high if away > 0.0 else low
        distance = self._first(lambda d: away * float(self._pull(start + away * d)), start, away)
        if distance >= abs(end - start):
            return end
        return start + away * distance

    def _first(self, function: Callable[[float], float], origin: float, away: float) -> float:
        """Distance at which a function that starts below 0 comes to 0; up to a rigid stop."""
        end = self.upper if away > 0.0 else self.lower
        most = math.inf if end is None else abs(end - origin)
        near, far = 0.0, self._scale
        for _ in range(MOST_DOUBLINGS):
            if far >= most:
                far = most
                if most == 0.0 or function(far) < 0.0:
                    return most
                break
            if function(far) >= 0.0:
                break
            near, far = far, 2.0 * far
        return float(brentq(function, near, far, xtol=1e-14 * far, rtol=1e-14))

    # Quadrature ---------------------------------------------------------------------------

    def _edges(self, start: float, end: float) -> list[float]:
        """Places from `start` to `end` between which the potential is smooth."""
        places = {start, end}
        for law, sign, _ in self._deflections(0.0):
            stop = self.stop_upper if sign > 0.0 else self.stop_lower
            assert stop is not None
            knots = law.pieces[0] if isinstance(law, ForceTable) else np.zeros(1)
            places |= {float(stop + sign * knot) for knot in knots}
        return sorted(place for place in places if start <= place <= end)

    def _nodes(self, edges: list[float]) -> tuple[Vector, Vector]:
        """Places and weights of quadrature panel by panel.

        Within a stop the deflection is the square of the variable, in which a Hertz force is a
        polynomial.
        """
        places, weights = [np.zeros(0)], [np.zeros(0)]
        for start, end in pairwise(edges):
            origin, sign = self._origin(start, end)
            if origin is None:
                half = (end - start) / 2.0
                places.append((start + end) / 2.0 + half * NODES)
                weights.append(half * WEIGHTS)
                continue
            a, b = (math.sqrt(abs(edge - origin)) for edge in (start, end))
            s, half = (a + b) / 2.0 + (b - a) / 2.0 * NODES, abs(b - a) / 2.0
            places.append(origin + sign * s**2)
            weights.append(2.0 * s * half * WEIGHTS)
        return np.concatenate(places), np.concatenate(weights)

    def _origin(self, start: float, end: float) -> tuple[float | None, float]:
        """The stop within which a panel lies, and on which side that stop is."""
        if self._compliant("upper") and self.stop_upper is not None and start >= self.stop_upper:
            return self.stop_upper, 1.0
        if self._compliant("lower") and self.stop_lower is not None and end <= self.stop_lower:
            return self.stop_lower, -1.0
        return None, 1.0

    def _reach(self, origin: float, away: float) -> float:
        """How far from `origin`, where the potential rises, the density has fallen by e^-CUT."""
        return self._first(
            lambda d: float(self._rise(away * d, origin)) - CUT * self.theta, origin, away
        )

    @cached_property
    def _quadrature(self) -> tuple[Vector, Vector]:
        """Offsets from the peak, and weights that hold the density there."""
        left = self.peak - self._reach(self.peak, -1.0)
        right = self.peak + self._reach(self.peak, 1.0)
        edges = sorted({*self._edges(left, right), self.peak})
        places, weights = self._nodes(edges)
        offset = places - self.peak
        return offset, weights * np.exp(-self._rise(offset, self.peak) / self.theta)

    @cached_property
    def _mass(self) -> float:
        return float(self._quadrature[1].sum())

    def expect(self, values: Vector) -> float:
        """Mean of `values`, given at the nodes."""
        return float(values @ self._quadrature[1]) / self._mass

    # What is asked of it ------------------------------------------------------------------

    @cached_property
    def mean(self) -> float:
        """E x, m."""
        return self.peak + self.expect(self._quadrature[0])

    @cached_property
    def variance(self) -> float:
        """Variance of x, m^2."""
        offset = self._quadrature[0]
        return self.expect((offset - self.expect(offset)) ** 2)

    def density(self, x: ArrayLike) -> Vector:
        """Probability density at x, 1/m; zero beyond rigid stops."""
        x = np.asarray(x, dtype=float)
        low = -math.inf if self.lower is None else self.lower
        high = math.inf if self.upper is None else self.upper
        inside = (x >= low) & (x <= high)
        offset = np.where(inside, x, self.peak) - self.peak
        with np.errstate(under="ignore"):
            relative = np.exp(-self._rise(offset, self.peak) / self.theta)
        return np.where(inside, relative / self._mass, 0.0)

    def density_at(self, x: float | None) -> float:
        """Density at one place; 0 for the place of a stop that does not exist."""
        return 0.0 if x is None else float(self.density(x))

    def contact(self, side: str) -> ContactStatistics | None:
        """Contact with one stop that gives way; None for one that does not, or is not there."""
        law = self._compliant(side)
        if law is None:
            return None
        sign = 1.0 if side == "upper" else -1.0
        y = sign * (self.peak + self._quadrature[0] - getattr(self, f"stop_{side}"))
        return ContactStatistics(
            probability=self.expect(np.where(y > 0.0, 1.0, 0.0)),
            force=self.expect(law.force_at(y)),
            peak_force=self._peak_force(side, law, sign),
        )

    def _peak_force(self, side: str, law: CompliantLaw, sign: float) -> float:
        """Mean of the largest force of a contact without noise and damping while it lasts.

        The force F turns a mass that came with the speed w where U = U(stop) + w^2 / 2. Over the
        Rayleigh law of w that is F(y_0) + int F'(y) exp(-(U - U(stop)) / theta) dy, from y_0 on,
        where w = 0: the stop itself, unless the mass is pressed into it.
        """
        stop = getattr(self, f"stop_{side}")
        start = stop
        if sign * float(self._pull(stop)) < 0.0:
            bottom = sign * (self.peak - stop)
            start = stop + sign * (bottom + self._first(
                lambda d: float(self._rise(sign * (bottom + d), stop)), self.peak, sign
            ))  # fmt: skip
        end = start + sign * self._first(
            lambda d: float(self._rise(start + sign * d - stop, stop)) - CUT * self.theta,
            start,
            sign,
        )
        edges = self._edges(min(start, end), max(start, end))
        places, weights = self._nodes(edges)
        shape = np.exp(-self._rise(places - stop, stop) / self.theta)
        y = sign * (places - stop)
        first = float(law.force_at(sign * (start - stop)))
        return first + float((law.slope_at(y) * shape) @ weights)
