"""The stationary density. Chapters: the density on strips in SI units, its averages, and the class
for users; its refinement until two answers agree."""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from stochvi.mathematics.impact_rates import COLLAPSE_RESTITUTION, corner_exponent
from stochvi.mathematics.numerics import Array, Booleans, Vector, gauss_panels
from stochvi.mathematics.units import explain_methods
from stochvi.methods.fokker_planck.basis import (
    EXTRA_NODES,
    ErrorMargins,
    Indices,
    VelocityCells,
    legendre,
)
from stochvi.methods.fokker_planck.motion import Motion, ScaledMotion, scaled_motion
from stochvi.methods.fokker_planck.strips import (
    UNSOLVED,
    Degrees,
    Patch,
    Solved,
    Strip,
    first_patches,
    graded,
    make_strips,
    refined,
    solve_strips,
)
from stochvi.model.model import Stop
from stochvi.results.base import Response
from stochvi.results.deadline import NEVER, Deadline
from stochvi.results.errors import NotConverged
from stochvi.results.estimates import Estimate
from stochvi.scenes.impact_laws import CompliantLaw

MARGINS = ErrorMargins(safety=1.5, shared=0.2, floor=1e-9)
"""Margins of the error bounds on refined strips."""


class Averages(NamedTuple):
    """Stationary averages, SI units per unit mass, or errors of them.

    Each stop has its impacts per second above the threshold, F1 and F2; a compliant one also has
    the share of time in contact, its mean force and the mean power that it takes.
    """

    mean: float
    variance: float
    velocity_mean_square: float
    upcrossing_rate: float
    rate_lower: float
    rate_upper: float
    speed_rate_lower: float
    speed_rate_upper: float
    speed_square_rate_lower: float
    speed_square_rate_upper: float
    contact_lower: float
    contact_upper: float
    force_lower: float
    force_upper: float
    power_lower: float
    power_upper: float


BORDER = 1e-12
"""Width of the border of two strips, in lengths of the box."""


class StripDensity:
    """A solution on strips in SI units; its mirror image is the other half of a symmetric scene.

    All arguments and results are in SI units; `slowest` is the speed of the slowest impacts that
    the mesh resolves.
    """

    def __init__(self, scaled: ScaledMotion, solved: Solved, slowest: float = 0.0) -> None:
        self.scaled, self.solved, self.slowest = scaled, solved, slowest
        self._share = 0.5 if scaled.halved else 1.0
        strips = solved.strips
        self._from_left = np.array([s.far for s in strips if s.anchor < 0.0])
        self._from_right = np.array([s.far for s in strips if s.anchor > 0.0])

    # At places ----------------------------------------------------------------------------------

    def _folded(self, x: Array) -> tuple[Array, Array]:
        """Places in the half that was solved, and the sign that this gives their velocities."""
        sign = np.ones_like(x)
        if self.scaled.halved:
            sign = np.where(x < self.scaled.left, -1.0, 1.0)
            x = np.where(x < self.scaled.left, 2.0 * self.scaled.left - x, x)
        return x, sign

    def _inside(self, x: Array) -> tuple[Indices, Array]:
        """The strip of each place (of a border, the one below), and where in it, from -1 to 1."""
        scaled = self.scaled
        above, below = (x - scaled.left) / scaled.length, (x - scaled.right) / scaled.length
        first = len(self._from_left)
        lower = np.searchsorted(self._from_left, above, side="left")
        upper = first + np.searchsorted(self._from_right, below, side="left")
        # strips that count from the left end may reach beyond the middle, as those before a stop do
        begin = self.solved.strips[first].near if len(self._from_right) else 0.0
        near_left = (above <= -below) | (below < begin - BORDER)
        place = np.where(near_left & (lower < first), lower, upper)
        place = np.clip(place, 0, len(self.solved.strips) - 1)
        near = np.array([s.near for s in self.solved.strips])[place]
        far = np.array([s.far for s in self.solved.strips])[place]
        anchored = np.array([s.anchor for s in self.solved.strips])[place] < 0.0
        local = 2.0 * (np.where(anchored, above, below) - near) / (far - near) - 1.0
        return place, np.clip(local, -1.0, 1.0)

    def _groups(self, x: Array) -> Iterator[tuple[Strip, Indices, Array]]:
        """For each strip, the indices of the places in it, and q at each of them: a function of
        velocity, with the weight of the place, per metre."""
        strips, local = self._inside(x)
        for e in np.unique(strips):
            some = np.flatnonzero(strips == e)
            strip = self.solved.strips[e]
            values, _ = legendre(strip.degree, local[some])
            yield strip, some, self._weight(x[some])[:, None] * (values @ self.solved.q[e])

    def _weight(self, x: Array) -> Array:
        energy = self.scaled.energy((x - self.scaled.centre) / self.scaled.length)
        found: Array = self._share / self.scaled.length * np.exp(math.log(self.solved.top) - energy)
        return found

    def density(self, x: ArrayLike, v: ArrayLike) -> Array:
        """p(x, v), 1/m * s/m, of places and velocities that are broadcast."""
        places, velocities = np.broadcast_arrays(
            np.asarray(x, dtype=float), np.asarray(v, dtype=float)
        )
        folded, sign = self._folded(places.ravel())
        u = sign * velocities.ravel() / self.scaled.speed
        found = np.zeros(folded.shape)
        for strip, some, q in self._groups(folded):
            shape = np.exp(-(u[some] ** 2) / 2.0) / self.scaled.speed
            found[some] = np.sum(q * strip.cells.values(u[some]), axis=1) * shape
        found[~self._within(folded)] = 0.0
        return found.reshape(places.shape)

    def displacement_density(self, x: ArrayLike) -> Array:
        """Density of the displacement, 1/m."""
        places = np.asarray(x, dtype=float)
        folded, _ = self._folded(places.ravel())
        found = np.zeros(folded.shape)
        for strip, some, q in self._groups(folded):
            found[some] = q @ _mass_of(strip.cells)
        found[~self._within(folded)] = 0.0
        return found.reshape(places.shape)

    def _within(self, x: Array) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
        found = (x >= self.scaled.left) & (x <= self.scaled.right)
        return np.asarray(found, dtype=bool)

    def flux(self, x: float, side: int, power: int, slowest: ArrayLike = 0.0) -> Array:
        """Integral of |v|^power p(x, v) over side * v > slowest, of the side that it comes from."""
        folded, sign = self._folded(np.array([x]))
        side = int(side * sign[0])
        strip, q = self._leaving(folded, side)
        speeds = np.asarray(slowest, dtype=float) / self.scaled.speed
        found = [strip.cells.above(float(u), power, side) @ q for u in speeds.ravel()]
        scale = self.scaled.speed**power
        return scale * np.array(found).reshape(speeds.shape)

    def flux_density(self, x: float, side: int, w: ArrayLike) -> Array:
        """Flux per unit of speed, w p(x, side w), 1/m."""
        folded, sign = self._folded(np.array([x]))
        side = int(side * sign[0])
        strip, q = self._leaving(folded, side)
        speeds = np.asarray(w, dtype=float)
        u = speeds.ravel() / self.scaled.speed
        shape = np.exp(-(u**2) / 2.0) * u * (u > 0.0)
        return ((strip.cells.values(side * u) @ q) * shape).reshape(speeds.shape)

    def _leaving(self, x: Array, side: int) -> tuple[Strip, Array]:
        """The strip through which a motion towards `side` reaches a place, and q there."""
        if self.scaled.left < x[0] < self.scaled.right:
            # at a border of two strips, the one before it
            x = x - side * BORDER * self.scaled.length
        ((strip, _, q),) = self._groups(x)
        return strip, q[0]

    # Over all places ----------------------------------------------------------------------------

    def _strips(self) -> Iterator[tuple[Strip, Array, Array, Array]]:
        """Each strip with the nodes in x, weights that include the weight of the density, and the
        values of q at the nodes."""
        for strip, q in zip(self.solved.strips, self.solved.q, strict=True):
            xi, weights, values, _ = strip.nodes
            x = self.scaled.centre + self.scaled.length * xi
            weights = weights * self.scaled.length * self._weight(x)
            yield strip, x, weights, values @ q

    def velocity_density(self, v: ArrayLike) -> Array:
        """Density of the velocity, s/m."""
        velocities = np.asarray(v, dtype=float)
        u = velocities.ravel() / self.scaled.speed
        found = np.zeros(u.shape)
        for strip, _, weights, q in self._strips():
            found += strip.cells.values(u) @ (weights @ q)
            if self.scaled.halved:
                found += strip.cells.values(-u) @ (weights @ q)
        return (found * np.exp(-(u**2) / 2.0) / self.scaled.speed).reshape(velocities.shape)

    def velocity_tail(self, v: ArrayLike) -> Array:
        """Probability of a velocity above v (m/s)."""
        velocities = np.asarray(v, dtype=float)
        u = velocities.ravel() / self.scaled.speed
        beyond = np.zeros(u.shape)
        sides = (1, -1) if self.scaled.halved else (1,)
        for strip, _, weights, q in self._strips():
            for k, slowest in enumerate(u):
                outward = 1 if slowest >= 0.0 else -1
                for side in sides:
                    beyond[k] += strip.cells.above(abs(slowest), 0, outward * side) @ (weights @ q)
        return np.where(u >= 0.0, beyond, 1.0 - beyond).reshape(velocities.shape)

    def tail(self, x: ArrayLike) -> Array:
        """P(displacement > x), from 1 to 0."""
        places = np.asarray(x, dtype=float)
        folded, sign = self._folded(places.ravel())
        masses = np.array([weights @ q @ _mass_of(s.cells) for s, _, weights, q in self._strips()])
        after = np.append(np.cumsum(masses[::-1])[::-1], 0.0)
        strips, local = self._inside(folded)
        beyond = np.zeros(folded.shape)
        for k, (e, where) in enumerate(zip(strips, local, strict=True)):
            strip = self.solved.strips[e]
            points, weights = gauss_panels([where, 1.0], strip.degree + EXTRA_NODES)
            offset = strip.near + (points + 1.0) / 2.0 * strip.length
            place = self.scaled.centre + self.scaled.length * (strip.anchor + offset)
            weights = weights * strip.length / 2.0 * self.scaled.length * self._weight(place)
            values, _ = legendre(strip.degree, points)
            beyond[k] = after[e + 1] + weights @ values @ self.solved.q[e] @ _mass_of(strip.cells)
        beyond = np.where(folded <= self.scaled.left, self._share, beyond)
        beyond = np.where(folded >= self.scaled.right, 0.0, beyond)
        return np.where(sign > 0.0, beyond, 1.0 - beyond).reshape(places.shape)

    def edge(self) -> float:
        """Probability next to where the box ends without a stop, within one unit of it."""
        found, reach = 0.0, self.scaled.reach
        for strip, _, weights, q in self._strips():
            ends = strip.cells.values(np.array([-reach, reach])) @ (weights @ q)
            found += float(np.abs(ends).sum()) * math.exp(-(reach**2) / 2.0)
        for _, x in self._open_ends():
            found += abs(float(self.displacement_density(x))) * self.scaled.length
        return found

    @property
    def fastest(self) -> float:
        """Largest velocity of the mesh, m/s."""
        return self.scaled.reach * self.scaled.speed

    def beyond(self, x: ArrayLike, v: ArrayLike) -> Booleans:
        """Whether places lie where the mesh ends without a stop, or velocities beyond its own."""
        places, speeds = np.broadcast_arrays(
            np.asarray(x, dtype=float), np.abs(np.asarray(v, dtype=float))
        )
        folded, _ = self._folded(places)
        found = speeds > self.fastest
        for side, end in self._open_ends():
            found = found | (side * (folded - end) > 0.0)
        return found

    def border(self) -> float:
        """Largest density where the mesh ends without a stop, 1/m * s/m."""
        v = self.fastest * np.linspace(-1.0, 1.0, BORDER_VELOCITIES)
        found = [self.density(x, self.fastest * side) for _, x, _, _ in self._strips()
                 for side in (-1.0, 1.0)]  # fmt: skip
        found += [self.density(end, v) for _, end in self._open_ends()]
        return float(max(np.abs(each).max() for each in found))

    def _open_ends(self) -> list[tuple[int, float]]:
        """Sides and places where the box ends without a stop and without a mirror image."""
        walls = {stop.side for stop in self.scaled.reached if stop.rigid}
        ends = ((-1, self.scaled.left), (1, self.scaled.right))
        mirror = -1 if self.scaled.halved else 0
        return [(side, end) for side, end in ends if side not in walls and side != mirror]

    def averages(self, slowest: float) -> Averages:
        """All averages; rates count impacts faster than `slowest`, m/s."""
        scaled = self.scaled
        parts = [(x, w * (q @ _mass_of(s.cells)), s, w @ q) for s, x, w, q in self._strips()]
        mean = scaled.left if scaled.halved else sum(float(x @ w) for x, w, _, _ in parts)
        both = 1.0 / self._share
        stops = {f"{name}_{side}": 0.0 for name in OF_STOPS for side in ("lower", "upper")}
        # in a symmetric scene the lower stop is like the upper one, which therefore comes first
        for stop in reversed(scaled.reached):
            if stop.side > 0 or not scaled.halved:
                found = self._stop(stop, slowest)
            stops |= {f"{name}_{stop.name}": value for name, value in found.items()}
        up, down = (float(self.flux(mean, side, 1)) for side in (1, -1))
        return Averages(
            mean=mean,
            variance=both * sum(float((x - mean) ** 2 @ w) for x, w, _, _ in parts),
            velocity_mean_square=both
            * scaled.speed**2
            * sum(float(q @ s.cells.functional(s.cells.u**2)) for _, _, s, q in parts),
            upcrossing_rate=(up + down) / 2.0,
            **stops,
        )

    def _stop(self, stop: Stop, slowest: float) -> dict[str, float]:
        found = dict.fromkeys(OF_STOPS, 0.0)
        for power, name in enumerate(("rate", "speed_rate", "speed_square_rate"), start=1):
            limit = slowest if power == 1 else 0.0
            # for a stop that is hardly ever hit it may come out below 0, within its error
            found[name] = max(float(self.flux(stop.position, stop.side, power, limit)), 0.0)
        if isinstance(stop.law, CompliantLaw):
            found |= self._contact(stop, stop.law)
        return found

    def _contact(self, stop: Stop, law: CompliantLaw) -> dict[str, float]:
        """Share of time in contact, mean force, and mean power that a stop takes.

        A mass is in contact while it is beyond the stop; contact with a stop that has a damper ends
        when the force returns to zero, which it does before the deflection.
        """
        share = force = power = 0.0
        ends_early = not law.conservative
        side = stop.side
        for strip, x, weights, q in self._strips():
            deflection = stop.deflection(x)
            if deflection.min() < 0.0:
                continue
            u, profile, values, _ = strip.cells.split(self._release(law, deflection, side))
            found = np.sum(values * q[:, strip.cells.places][:, :, None, :], axis=-1)
            density = weights[:, None, None] * profile * found
            rate = side * self.scaled.speed * u
            y = np.broadcast_to(deflection[:, None, None], u.shape)
            push = np.asarray(law.force_at(y, rate), dtype=float)
            touching = push > 0.0 if ends_early else np.ones(push.shape, dtype=bool)
            share += float(np.sum(density * touching))
            force += float(np.sum(density * push))
            power += float(np.sum(density * push * rate))
        return {"contact": share, "force": force, "power": power}

    def _release(self, law: CompliantLaw, deflection: Array, side: int) -> Array:
        """Velocities, in units of the box, at which a stop ceases to push."""
        if not law.conservative:
            return -side * law.force_at(deflection) / (law.damping(1.0) * self.scaled.speed)
        return np.full_like(deflection, math.inf)

    # Balances -----------------------------------------------------------------------------------

    def balances(self) -> dict[str, float]:
        """Residuals of the balances of energy, virial and force, relative to their largest term.

        S0 / 2 = E v drag(v) + loss in stops; E v^2 = E (x - m) (drag(v) - force(x)) + sum of |stop
        - m| push; E (force(x) - drag(v)) = push of the upper stop less that of the lower. Here m =
        E x; push and loss are those of rigid stops. The virial is left out where a damper in a stop
        adds to it.
        """
        scaled, motion = self.scaled, self.scaled.motion
        found = self.averages(0.0)
        half = 0.5 if scaled.halved else 1.0
        drag = work = pull = size = 0.0
        for strip, x, weights, q in self._strips():
            cells = strip.cells
            v = scaled.speed * cells.u
            power = cells.functional(v * motion.drag(v))
            held = q @ cells.functional(motion.drag(v))
            drag += float(weights @ q @ power) / half
            share = weights * (q @ _mass_of(cells)) / half
            spring = motion.spring(x)
            work += float(share @ ((x - found.mean) * motion.force(x)))
            work -= float((weights * (x - found.mean)) @ held) / half
            pull += float(share @ spring) - float(weights @ held) / half
            size += float(share @ np.abs(spring))
        energy, virial, net = [motion.power, -drag], [found.velocity_mean_square, work], [pull]
        for stop in scaled.reached:
            if isinstance(stop.law, CompliantLaw):
                energy.append(-getattr(found, f"power_{stop.name}"))
                net.append(-stop.side * getattr(found, f"force_{stop.name}"))
                continue
            loss, push = self._impulse(stop)
            energy.append(-loss)
            virial.append(-abs(stop.position - found.mean) * push)
            net.append(-stop.side * push)
        size = max(size, *map(abs, net))
        force = 0.0 if scaled.halved else sum(net) / size
        residuals = {"energy": sum(energy) / motion.power, "force": force}
        if all(stop.rigid or stop.law.conservative for stop in scaled.reached):
            residuals["virial"] = sum(virial) / found.velocity_mean_square
        return residuals

    def _impulse(self, stop: Stop) -> tuple[float, float]:
        """Mean power that a rigid stop takes and its mean push, per unit mass."""
        folded, sign = self._folded(np.array([stop.position]))
        side = int(stop.side * sign[0])
        strip, q = self._leaving(folded, side)
        u, weights = gauss_panels(np.unique(np.maximum(side * strip.cells.breaks, 0.0)), NODES)
        w = self.scaled.speed * u
        rate = self.scaled.speed * weights * u * np.exp(-(u**2) / 2.0) * strip.cells.at(side * u, q)
        return float(rate @ ((1.0 - stop.restitution_square_at(w)) * w**2)) / 2.0, float(
            rate @ ((1.0 + stop.restitution_at(w)) * w)
        )


BORDER_VELOCITIES = 65
"""Number of velocities at which the density is computed where a box ends without a stop."""

NODES = 24
"""Number of Gauss-Legendre nodes in each cell, for a restitution that depends on speed."""

OF_STOPS = ("rate", "speed_rate", "speed_square_rate", "contact", "force", "power")


def _mass_of(cells: VelocityCells) -> Array:
    """Integrals of g N_k, one for each function."""
    return cells.functional(np.ones_like(cells.u))


RESOLVED = 10.0
"""Multiple of the slowest impact speed that a mesh resolves, above which the density of impact
speeds is right."""


@explain_methods
@dataclass(frozen=True, kw_only=True, repr=False)
class StationaryDensity:
    """p(x, v) of the stationary response, and what follows from it, by `fokker_planck_density`.

    Arguments are in m and m/s, arrays are broadcast, and places beyond rigid stops have density 0.
    At a rigid stop with R < 1 the density is infinite at v = 0: p(stop, v) ~ |v|^-beta
    (`impact_rates.corner_exponent`).

    Parameters
    ----------
    response
        The averages, with bounds on their errors.
    fine, coarse
        The solutions on the last two meshes.

    See Also
    --------
    stochvi.methods.fokker_planck.fokker_planck_density : The calculation.
    """

    response: Response
    fine: StripDensity = field(compare=False)
    coarse: StripDensity = field(compare=False)

    def density(self, x: ArrayLike, v: ArrayLike) -> Vector:
        """Joint density of displacement and velocity, 1/m * s/m.

        Negative values are kept, so that integrals of the density are those of the solution. Where
        there is hardly any probability, or near the corner of an inelastic stop, the density may be
        slightly negative, sometimes by more than `density_error`. At that corner it is infinite:
        the finite value there is that of a polynomial, and means nothing.
        """
        return self.fine.density(x, v)

    def density_error(self, x: ArrayLike, v: ArrayLike) -> Vector:
        """Difference of the joint densities on the last two meshes, 1/m * s/m.

        Beyond the mesh `density` is 0, and this is the largest density where the mesh ends. A
        larger `speed_threshold` makes it reach farther.
        """
        change = np.abs(self.fine.density(x, v) - self.coarse.density(x, v))
        outside = self.fine.beyond(x, v)
        if not outside.any():
            return change
        most = max(self.fine.border(), self.coarse.border())
        return np.where(outside, MARGINS.safety * most, change)

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

        It is that of the impacts faster than the `speed_threshold` of the response, w p(stop, w)
        over their rate. At a rigid stop it goes as w^(1 - beta) towards w = 0.
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
        """Impacts on the "lower" or "upper" stop faster than `speed`, 1/s.

        NaN for speeds that the mesh does not reach: one made for a larger `speed_threshold` does.
        """
        stop = self._stop(side)
        if stop is None:
            return np.zeros(np.shape(speed))
        found = self.fine.flux(stop.position, stop.side, 1, speed)
        return np.where(np.asarray(speed, dtype=float) > self.fine.fastest, np.nan, found)

    def limit_rate(self, side: str) -> Estimate | None:
        """Impacts of any speed on a stop, 1/s; None where the rate has no limit.

        Below a speed w that is small against all others the density of impact speeds goes as w^(1 -
        beta). This adds w^2 p(stop, w) / (2 - beta) to the rate above w. `bias` is 1.5 times the
        difference of the two meshes, which resolve different speeds.
        """
        fine, coarse = self._all_impacts(self.fine, side), self._all_impacts(self.coarse, side)
        if fine is None or coarse is None:
            return None
        return Estimate(
            value=fine, bias=MARGINS.safety * abs(fine - coarse), how="refined Galerkin"
        )

    def slow_impact_exponent(self, side: str) -> Estimate:
        """Exponent beta of p(stop, v) ~ |v|^-beta at a rigid stop, read off the solution.

        From the slowest impacts that the mesh resolves; `bias` is 1.5 times the difference of
        the two meshes, which resolve different speeds. Its theoretical value is
        `impact_rates.corner_exponent`.
        """
        fine, coarse = self._exponent(self.fine, side), self._exponent(self.coarse, side)
        return Estimate(
            value=fine, bias=MARGINS.safety * abs(fine - coarse), how="refined Galerkin"
        )

    def _exponent(self, solution: StripDensity, side: str) -> float:
        stop = self._stop(side)
        if stop is None or not stop.rigid:
            raise ValueError(f"needs a rigid stop within reach, got none at the {side} side")
        w = RESOLVED * solution.slowest * np.array([1.0, 2.0])
        slower, faster = solution.flux_density(stop.position, stop.side, w) / w
        return float(math.log(slower / faster) / math.log(2.0))

    def _all_impacts(self, solution: StripDensity, side: str) -> float | None:
        stop = self._stop(side)
        if stop is None:
            return 0.0
        if not stop.rigid or stop.law.conservative:
            return float(solution.flux(stop.position, stop.side, 1))
        restitution = stop.law.slow_restitution
        if restitution <= COLLAPSE_RESTITUTION:
            return None
        slow = RESOLVED * solution.slowest
        counted = float(solution.flux(stop.position, stop.side, 1, slow))
        below = slow * float(solution.flux_density(stop.position, stop.side, slow))
        return counted + below / (2.0 - corner_exponent(restitution))

    def _stop(self, side: str) -> Stop | None:
        """A stop of the scene; None if it is out of reach."""
        scaled = self.fine.scaled
        if side not in (names := [stop.name for stop in scaled.motion.stops]):
            raise ValueError(f"side must be one with a stop ({', '.join(names)}), got {side!r}")
        return next((stop for stop in scaled.reached if stop.name == side), None)

    def __repr__(self) -> str:
        return f"<stationary density of {self.response!r}>"


# ------------------------------------------------------------------------------
# The density of one scene on strips, refined until two successive answers agree.
# ------------------------------------------------------------------------------


FIRST_DEGREES, LAST_DEGREES = Degrees(2, 4), Degrees(7, 9)
"""Degrees of the polynomials on the first mesh, and the highest degrees; both rise by one from mesh
to mesh."""

SLOWEST = (1e-2, 2e-3, 3e-4, 3e-5, 3e-6, 1e-6)
"""Speeds of the slowest impacts that the meshes resolve one after another, in units of the speed of
the weight."""

MOST_MESHES = 10
"""Largest number of successive meshes; `MOST_UNKNOWNS` usually ends the refinement before."""

MOST_UNKNOWNS = 800_000
"""Largest number of unknowns of a mesh: it takes some ten seconds and half a gigabyte."""

MIN_IMPACT_RATIO = 1e-12
"""Impacts on a stop per crossing of the mean from which on the stop counts as within reach:
less than the law exp(-energy / s^2) leaves there, which is right where the mass leans on no
stop."""

EDGE = 1e-8
"""Probability next to the ends of the box above which the box is made larger."""

STRETCH = 1.25
"""Factor on the largest velocity of a box that is too small."""

MOST_STRETCHES = 8
"""Largest number of times that the box is stretched."""

TIME_RATIO = 2.0
"""Ratio of the CPU time of a mesh to that of the one before (measured: 1.3 to 2)."""


T = TypeVar("T")


def accurate(
    found: T, reached: float, rtol: float, deadline: Deadline, started: float, method: str,
    remedy: str,
) -> T:  # fmt: skip
    """An answer; where its relative error is larger than `rtol`, `NotConverged` carries it."""
    if reached <= rtol:
        return found
    if deadline.left <= TIME_RATIO * (time.perf_counter() - started):
        raise deadline.fell_short(
            f"at a relative error of {reached:.2g} by {method}, asked for {rtol:g}",
            "raise budget or rtol",
            found,
        )
    raise NotConverged(
        f"{method} reached a relative error of {reached:.2g} on its finest mesh, not {rtol:g}; "
        f"{remedy}",
        found,
    )


def in_pairs(answers: Iterator[T], deadline: Deadline) -> Iterator[tuple[T, T]]:
    """Answers on finer and finer meshes, each with the one before, from the second on.

    From the third on, one is begun only if it can be expected to end before the deadline.
    """
    coarse, took = next(answers), 0.0
    for number in itertools.count(2):
        if number > 2 and deadline.left <= TIME_RATIO * took:
            return
        began = time.perf_counter()
        fine = next(answers, None)
        took = time.perf_counter() - began
        if fine is None:
            return
        yield coarse, fine
        coarse = fine


class Refinement(NamedTuple):
    """The density and averages on the last mesh, bounds on their errors, and the density before."""

    field: StripDensity
    averages: Averages
    errors: Averages
    coarser: StripDensity


def _answers(motion: Motion, threshold: float) -> Iterator[tuple[StripDensity, Averages]]:
    """Densities on finer and finer meshes, with their averages."""
    scaled, patches, field = _first(motion, threshold)
    for stage in range(1, MOST_MESHES + 1):
        yield field, field.averages(threshold)
        slowest = SLOWEST[min(stage, len(SLOWEST) - 1)]
        patches = graded(scaled, refined(scaled, field.solved, patches), slowest)
        strips = make_strips(patches, _degrees(stage))
        if stage > 1 and sum(strip.unknowns for strip in strips) > MOST_UNKNOWNS:
            return
        try:
            field = _field(scaled, strips, slowest)
        except np.linalg.LinAlgError:
            return


def refine(
    motion: Motion, rtol: float, threshold: float, rates: Collection[str] = ("lower", "upper"),
    deadline: Deadline = NEVER,
) -> Refinement:  # fmt: skip
    """Refine until the relative errors that `rtol` governs are small enough, or until no finer mesh
    improves the answer.

    `rates` are the sides whose rate of impacts faster than `threshold` is wanted, too.
    """
    refinement: Refinement | None = None
    for (coarser, before), (fine, found) in in_pairs(_answers(motion, threshold), deadline):
        scaled = fine.scaled
        if min(found.variance, found.velocity_mean_square) <= 0.0:
            refinement = None  # this mesh is too coarse for a density; a finer one may give one
            continue
        errors = _errors(fine, before, found)
        least = MIN_IMPACT_RATIO * found.upcrossing_rate
        if threshold > scaled.speed:
            # what rounding leaves of the digits of rare impacts
            names = [f"rate_{stop.name}" for stop in scaled.reached]
            rounded = {name: getattr(errors, name) + WORST_RATE * least for name in names}
            errors = errors._replace(**rounded)
        lost = _fast_impacts(fine, coarser, found, threshold)
        refinement = _with_bounds(Refinement(fine, found, errors, coarser), lost)
        if _cut(fine)["variance"] > 2.0 * rtol * found.variance:
            break  # what lies beyond the ends of the box does not shrink with the mesh
        vague = rates_not_resolved(found, errors) | {s for s, most in lost.items() if most > least}
        if worst_relative_error(found, errors) <= rtol and vague.isdisjoint(rates):
            break
    if refinement is None:
        raise NotConverged(UNSOLVED)
    return refinement


def _field(scaled: ScaledMotion, strips: tuple[Strip, ...], slowest: float) -> StripDensity:
    """The density on some strips; LinAlgError if there is none of finite numbers, or if a strip is
    so narrow that rounding leaves it no length."""
    if not all(strip.length > 0.0 for strip in strips):
        raise np.linalg.LinAlgError(UNSOLVED)
    solved = solve_strips(scaled, strips)
    if not all(np.isfinite(q).all() for q in solved.q):
        raise np.linalg.LinAlgError(UNSOLVED)
    return StripDensity(scaled, solved, scaled.speed * slowest)


def _degrees(stage: int) -> Degrees:
    place, velocity = (
        min(first + stage, last) for first, last in zip(FIRST_DEGREES, LAST_DEGREES, strict=True)
    )
    return Degrees(place, velocity)


def _first(
    motion: Motion, threshold: float
) -> tuple[ScaledMotion, tuple[Patch, ...], StripDensity]:
    """The coarsest mesh, of a box beyond which there is hardly any probability.

    A mass that is pressed onto an inelastic stop reaches farther than exp(-energy / s^2) says. A
    fast flight lasts longer than a slow one, so it loses less energy per unit of time.
    """
    stretch, hit = 1.0, set[Stop]()
    for _ in range(MOST_STRETCHES + len(motion.stops)):
        scaled = scaled_motion(motion, stretch, hit, threshold)
        patches = graded(scaled, first_patches(scaled), SLOWEST[0])
        try:
            field = _field(scaled, make_strips(patches, FIRST_DEGREES), SLOWEST[0])
        except np.linalg.LinAlgError:
            raise NotConverged(UNSOLVED) from None
        new, rare = _hit(field), math.exp(-scaled.rare_energy)
        if not new and field.edge() <= EDGE * rare:
            break
        hit |= new
        stretch *= 1.0 if new else STRETCH
    return scaled, patches, field


def _hit(field: StripDensity) -> set[Stop]:
    """Stops that count as out of reach, but lie in the box and are hit."""
    crossings = field.averages(0.0).upcrossing_rate
    return {
        stop
        for stop in _beyond(field.scaled)
        if _nearest(field.scaled, stop) == stop.position
        and float(field.flux(stop.position, stop.side, 1)) > MIN_IMPACT_RATIO * crossings
    }


def _beyond(scaled: ScaledMotion) -> list[Stop]:
    return [stop for stop in scaled.motion.stops if stop not in scaled.reached]


def _nearest(scaled: ScaledMotion, stop: Stop) -> float:
    """The place in the box, and its mirror image if that was left out, next to a stop."""
    left = 2.0 * scaled.left - scaled.right if scaled.halved else scaled.left
    return min(max(stop.position, left), scaled.right)


MOTION = ("mean", "variance", "velocity_mean_square")


def _errors(field: StripDensity, coarse: Averages, fine: Averages) -> Averages:
    """Bounds on the errors of `fine`, the averages of `field`."""
    sizes = fine._replace(mean=math.sqrt(fine.variance))
    change = Averages(*(abs(a - b) for a, b in zip(fine, coarse, strict=True)))
    shared = max(getattr(change, name) / getattr(sizes, name) for name in MOTION)
    bounds: dict[str, float] = {}
    for side in ("lower", "upper"):
        impacts = [f"{name}_{side}" for name in ("speed_rate", "speed_square_rate")]
        hits = max([shared, *(_ratio(change, sizes, name) for name in impacts)])
        for name in (name for name in Averages._fields if name.endswith(side)):
            bounds[name] = MARGINS.safety * max(
                getattr(change, name), MARGINS.shared * hits * getattr(sizes, name)
            )
        # the share of time in contact depends on slow contacts, as the rate of impacts does
        contact = f"contact_{side}"
        slow = max(hits, _ratio(change, sizes, f"rate_{side}"))
        bounds[contact] = max(
            bounds[contact], 2.0 * MARGINS.safety * slow * getattr(sizes, contact)
        )
    for name in (*MOTION, "upcrossing_rate"):
        bounds[name] = MARGINS.safety * max(
            getattr(change, name), MARGINS.shared * shared * getattr(sizes, name)
        )
    far = _unreached(field, fine.upcrossing_rate) | _rounding_between_wells(field.scaled)
    for name, cut in _cut(field).items():
        far[name] = far.get(name, 0.0) + cut
    return Averages(
        *(
            bounds[name] + MARGINS.floor * abs(getattr(sizes, name)) + far.get(name, 0.0)
            for name in Averages._fields
        )
    )


SPEEDS_TRIED = 32
"""Number of speeds up to the threshold at which the rate of faster impacts is compared between two
meshes."""

RARE = 1e-6
"""Impacts on a stop per crossing of the mean below which a rate that no mesh resolves is 0, with a
bound as its bias."""


def _fast_impacts(
    field: StripDensity, coarser: StripDensity, found: Averages, threshold: float
) -> dict[str, float]:
    """Bounds on the rates of impacts faster than a threshold, by side, where both meshes may have
    lost them: their difference then says nothing.

    The density falls at least as fast as it would with the damper alone. The rates of ever faster
    impacts are followed up to where both meshes no longer agree on them, or fall less than that.
    Where they agree nowhere, at most F2 / threshold^2 impacts are faster.
    """
    bounds = {}
    motion = field.scaled.motion
    hottest = motion.squares[1] if motion.model.drag is None else math.inf
    speeds = threshold * np.arange(1, SPEEDS_TRIED + 1) / SPEEDS_TRIED
    slower = (threshold**2 - speeds**2) / 2.0 / hottest
    for stop in field.scaled.reached if threshold > 0.0 else ():
        fine, coarse = (each.flux(stop.position, stop.side, 1, speeds) for each in (field, coarser))
        known = MARGINS.safety * np.abs(fine - coarse) <= WORST_RATE * fine
        known &= fine > MIN_IMPACT_RATIO * found.upcrossing_rate
        most = np.maximum(fine, 0.0) * np.exp(-slower)
        known[1:] &= ~known[:-1] | (most[1:] <= (1.0 + WORST_RATE) * most[:-1])
        ends = np.flatnonzero(known & ~np.append(known[1:], False))
        if len(ends) and ends[0] == SPEEDS_TRIED - 1:
            continue
        bound = getattr(found, f"speed_square_rate_{stop.name}") / threshold**2
        if len(ends):
            bound = min(bound, float(most[ends[0]]))
        bounds[stop.name] = MARGINS.safety * bound
    return bounds


def _with_bounds(refinement: Refinement, lost: Mapping[str, float]) -> Refinement:
    """A rate that the meshes have lost is 0 within its bound where that says that it is rare; else
    its error grows to the bound."""
    found, errors = refinement.averages, refinement.errors
    for side, bound in lost.items():
        name = f"rate_{side}"
        if bound <= RARE * found.upcrossing_rate:
            found, errors = found._replace(**{name: 0.0}), errors._replace(**{name: bound})
        else:
            errors = errors._replace(**{name: max(bound, getattr(errors, name))})
    return refinement._replace(averages=found, errors=errors)


def _ratio(change: Averages, sizes: Averages, name: str) -> float:
    size = getattr(sizes, name)
    return getattr(change, name) / size if size > 0.0 else 0.0


def _unreached(field: StripDensity, crossing_rate: float) -> dict[str, float]:
    """Bounds on the quantities of stops that count as out of reach.

    The bound is the larger of two. One is Rice's rate at the temperature of the distribution, with
    Rayleigh's speeds. The other is the flux of the solution at the place of the box next to the
    stop. Between that place and the stop the flux falls at least as fast as it would with the
    damper alone.
    """
    motion = field.scaled.motion
    square, hottest = motion.squares
    speed = math.sqrt(square)
    lowest = motion.lowest(square)
    rayleigh = (1.0, speed * math.sqrt(math.pi / 2.0), 2.0 * square)
    found = {}
    for stop in _beyond(field.scaled):
        nearest = _nearest(field.scaled, stop)
        height, seen = motion.energy(np.array([stop.position, nearest]))
        rice = crossing_rate * math.exp(-(height - lowest) / square)
        falls = math.exp(-max(height - seen, 0.0) / hottest)
        for power, (name, factor) in enumerate(zip(HITS, rayleigh, strict=True), start=1):
            flux = abs(float(field.flux(nearest, stop.side, power)))
            found[f"{name}_{stop.name}"] = MARGINS.safety * max(rice * factor, flux * falls)
        if not stop.rigid:
            # p s^2 / force beyond a place of the density p, and a force that turns the mass round
            pull = abs(float(motion.force(np.array(stop.position))))
            rate = found[f"rate_{stop.name}"]
            found[f"contact_{stop.name}"] = math.sqrt(2.0 * math.pi) * speed * rate / pull
            found[f"force_{stop.name}"] = 2.0 * found[f"speed_rate_{stop.name}"]
            found[f"power_{stop.name}"] = found[f"speed_square_rate_{stop.name}"] / 2.0
    return found


FALSE_CROSSING = 1e-15
"""Probability that rounding makes or takes each time that the mass would cross from well to well:
some five times the relative rounding error of a number."""


def _rounding_between_wells(scaled: ScaledMotion) -> dict[str, float]:
    """Errors of the averages that come from the probabilities of the wells.

    Where crossings of a high barrier are as rare as rounding errors are large, rounding moves
    probability from one well to another.
    """
    if scaled.barrier == 0.0:
        return {}
    share = min(FALSE_CROSSING * math.exp(scaled.barrier), 1.0)
    width = scaled.right - scaled.left
    return {"mean": share * width, "variance": share * width**2}


def _cut(field: StripDensity) -> dict[str, float]:
    """The parts of the first two moments beyond the ends of the box. They are x^2 p / (n - 2) and
    x^3 p / (n - 3), where the density p falls as x^-n."""
    scaled = field.scaled
    found = {"mean": 0.0, "variance": 0.0}
    if scaled.motion.model.restoring is None:
        return found
    for side, end, falls in scaled.motion.open_ends(scaled.left, scaled.right, scaled.speed**2):
        if scaled.halved and side < 0:
            continue
        x = abs(end - scaled.motion.start)
        density = MARGINS.safety * abs(float(field.displacement_density(end)))
        found["mean"] += 0.0 if scaled.halved else x**2 * density / (falls - 2.0)
        found["variance"] += (2.0 if scaled.halved else 1.0) * x**3 * density / (falls - 3.0)
    return found


HITS = ("rate", "speed_rate", "speed_square_rate")
"""Names of the averages over impacts of the powers 0, 1 and 2 of their speed, in this order."""


def worst_relative_error(found: Averages, bounds: Averages) -> float:
    """Largest relative error of what `rtol` governs: deviations, F1 and F2 of all stops.

    It is infinite where a mesh has found no density of finite and positive variances.
    """
    if not (found.variance > 0.0 and found.velocity_mean_square > 0.0):
        return math.inf
    ratios = [
        bounds.variance / found.variance / 2.0,
        bounds.velocity_mean_square / found.velocity_mean_square / 2.0,
    ]
    for name in ("speed_rate", "speed_square_rate"):
        total, bound = (
            getattr(group, f"{name}_lower") + getattr(group, f"{name}_upper")
            for group in (found, bounds)
        )
        if total > 0.0:
            ratios.append(bound / total)
    return max(ratios)


WORST_RATE = 0.1
"""Largest relative error of a rate that is given."""


def rates_not_resolved(found: Averages, bounds: Averages) -> set[str]:
    """Sides whose rate is not known well enough yet."""
    return {
        side
        for side in ("lower", "upper")
        if getattr(bounds, f"rate_{side}") > WORST_RATE * getattr(found, f"rate_{side}") > 0.0
    }
