"""The stationary density of an oscillator with stops, as an object that answers questions."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stochvi.mathematics.impact_rates import COLLAPSE_RESTITUTION, corner_exponent
from stochvi.methods.fokker_planck.accurate import SAFETY
from stochvi.methods.fokker_planck.field import Field
from stochvi.model.model import Stop
from stochvi.results.estimates import Estimate
from stochvi.results.response import Response

Vector = NDArray[np.float64]

RESOLVED = 10.0
"""Of the slowest impacts that a mesh resolves, those that it has the right density of."""


@dataclass(frozen=True, kw_only=True, repr=False)
class StationaryDensity:
    """p(x, v) of the stationary response, and what follows from it, by `fokker_planck_density`.

    Arguments are in m and m/s, arrays are broadcast, and places beyond rigid stops have density 0.
    At a rigid stop with R < 1 the density is infinite at v = 0: p(stop, v) ~ |v|^-beta
    (`collisions.corner_exponent`).

    Parameters
    ----------
    response
        The averages, with bounds on their errors.
    fine, coarse
        The solutions on the last two meshes.
    """

    response: Response
    fine: Field = field(compare=False)
    coarse: Field = field(compare=False)

    def density(self, x: ArrayLike, v: ArrayLike) -> Vector:
        """Joint density of displacement and velocity, 1/m * s/m.

        Not cut at 0, so that its integrals are those of the solution: where next to nothing is, or
        beside the corner of a lossy stop, it may be a little negative, now and then by more than
        `density_error`.
        """
        return self.fine.density(x, v)

    def density_error(self, x: ArrayLike, v: ArrayLike) -> Vector:
        """By how much the last two meshes differ in the joint density, 1/m * s/m."""
        return np.abs(self.fine.density(x, v) - self.coarse.density(x, v))

    def displacement_density(self, x: ArrayLike) -> Vector:
        """Density of the displacement, 1/m."""
        return self.fine.displacement_density(x)

    def velocity_density(self, v: ArrayLike) -> Vector:
        """Density of the velocity, s/m."""
        return self.fine.velocity_density(v)

    def tail(self, x: ArrayLike) -> Vector:
        """Probability of a displacement above x."""
        return self.fine.tail(x)

    def velocity_tail(self, v: ArrayLike) -> Vector:
        """Probability of a velocity above v."""
        return self.fine.velocity_tail(v)

    def impact_speed_density(self, side: str, w: ArrayLike) -> Vector:
        """Density of the speeds (m/s) of impacts on the "lower" or "upper" stop, s/m.

        Of those faster than the `speed_threshold` of the response: w p(stop, w) over their rate. At
        a rigid stop it goes as w^(1 - beta) towards w = 0.
        """
        threshold = self._threshold()
        rate = float(self.rate_above(side, threshold))
        counted = np.asarray(w, dtype=float) > threshold
        if rate == 0.0:
            return np.zeros(counted.shape)
        return np.where(counted, self.impact_flux(side, w) / rate, 0.0)

    def _threshold(self) -> float:
        for pair in self.response.impact_pairs.values():
            threshold = pair["speed_threshold"]
            if isinstance(threshold, float):
                return threshold
        return 0.0

    def impact_flux(self, side: str, w: ArrayLike) -> Vector:
        """Impacts on a stop per second and per unit of incident speed, w p(stop, w), in 1/m.

        Its integral above a speed is `rate_above`, finite or not at 0.
        """
        stop = self._stop(side)
        if stop is None:
            return np.zeros(np.shape(w))
        return self.fine.flux_density(stop.position, stop.side, w)

    def rate_above(self, side: str, speed: ArrayLike) -> Vector:
        """Impacts on the "lower" or "upper" stop faster than `speed`, 1/s."""
        stop = self._stop(side)
        if stop is None:
            return np.zeros(np.shape(speed))
        return self.fine.flux(stop.position, stop.side, 1, speed)

    def limit_rate(self, side: str) -> Estimate | None:
        """Impacts of any speed on a stop, 1/s; None where the rate has no limit.

        Below a speed w that is small to everything else the density of impact speeds goes as
        w^(1 - beta), which adds w^2 p(stop, w) / (2 - beta) to the rate above w. `bias` is SAFETY
        times the difference of the two meshes, which resolve different speeds.
        """
        fine, coarse = self._all_impacts(self.fine, side), self._all_impacts(self.coarse, side)
        if fine is None or coarse is None:
            return None
        return Estimate(value=fine, bias=SAFETY * abs(fine - coarse), how="refined Galerkin")

    def slow_impact_exponent(self, side: str) -> Estimate:
        """beta of p(stop, v) ~ |v|^-beta at a rigid stop, as the solution has it.

        From the slowest impacts that the mesh resolves; `bias` is SAFETY times the difference of
        the two meshes, which resolve different speeds. What it should be is
        `collisions.corner_exponent`.
        """
        fine, coarse = self._exponent(self.fine, side), self._exponent(self.coarse, side)
        return Estimate(value=fine, bias=SAFETY * abs(fine - coarse), how="refined Galerkin")

    def _exponent(self, solution: Field, side: str) -> float:
        stop = self._stop(side)
        if stop is None or not stop.rigid:
            raise ValueError(f"needs a rigid stop within reach, got none at the {side} side")
        w = RESOLVED * solution.slowest * np.array([1.0, 2.0])
        slower, faster = solution.flux_density(stop.position, stop.side, w) / w
        return float(math.log(slower / faster) / math.log(2.0))

    def _all_impacts(self, solution: Field, side: str) -> float | None:
        stop = self._stop(side)
        if stop is None:
            return 0.0
        if not stop.rigid or stop.law.conservative:
            return float(solution.flux(stop.position, stop.side, 1))
        restitution = float(stop.restitution_at([SLOWEST])[0])
        if restitution <= COLLAPSE_RESTITUTION:
            return None
        slow = RESOLVED * solution.slowest
        counted = float(solution.flux(stop.position, stop.side, 1, slow))
        below = slow * float(solution.flux_density(stop.position, stop.side, slow))
        return counted + below / (2.0 - corner_exponent(restitution))

    def _stop(self, side: str) -> Stop | None:
        """A stop of the scene; None if it is out of reach."""
        scaled = self.fine.scaled
        if side not in {stop.name for stop in scaled.motion.stops}:
            raise ValueError(f"side must be that of a stop of the scene, got {side!r}")
        return next((stop for stop in scaled.reached if stop.name == side), None)

    def __repr__(self) -> str:
        return f"<stationary density of {self.response!r}>"


SLOWEST = 1e-9
"""Speed at which a restitution that depends on it is asked for its limit, m/s."""
