"""What a simulation averages, and its errors. Chapters: the quantities of a response
(`of_coordinate`, `of_pair`); statistics of independent paths; bias of the step; the protocol of a
plan; a statistic of one's own."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Any, Protocol, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import PrivateAttr, model_validator

from stochvi.engine.arithmetic import Log
from stochvi.engine.calls import NO_STATISTICS, Statistics, addresses_of
from stochvi.engine.impact_laws import NotCompiled, compiled_of, contents_of
from stochvi.mathematics.impact_rates import COLLAPSE_RESTITUTION, corner_exponent
from stochvi.mathematics.numerics import Matrix, Vector
from stochvi.model.build_response import power_of_stop
from stochvi.model.model import Model, Pair, Stop
from stochvi.motion.kernels.random_numbers import normal_rows, seed_streams
from stochvi.results.estimates import PathMoments, neighbours
from stochvi.sampling.calculations import check_flag
from stochvi.scenes.validation import Checked, Function, _name_of, arguments_fault

if TYPE_CHECKING:
    from stochvi.model.modal import ModalForm


# ------------------------------------------------------------------------------
# The quantities of a response, each as a function of the time averages of many paths.
# ------------------------------------------------------------------------------


Key = tuple[str, str]
"""Name of the owner (a coordinate or an impact pair), and name of the mean or quantity."""

Means = dict[Key, float]
"""Time averages by key, averaged over the paths (SI units)."""

Quantity = Callable[[Means], float]
"""A quantity of a response as a smooth function of the means."""

RATES = ("collision_rate", "collision_rate_lower", "collision_rate_upper", "impact_speed_mean")
"""Quantities that count impacts; where stops lose energy, only those above a speed threshold."""

EVENTS = (*RATES[:3], "impact_speed_rate", "impact_speed_square_rate")
"""Quantities that are sums over impacts, per second."""

GOVERNED = (
    "displacement_mean",
    "displacement_mean_square",
    "velocity_mean_square",
    "collision_rate",
    "impact_speed_rate",
    "impact_speed_square_rate",
)
"""Quantities of each coordinate and each impact pair whose errors `rel_error` governs."""


SUMS_OF_PAIR = tuple(f"{what}_{side}" for side in ("lower", "upper") for what in ("n", "f1", "f2"))
"""Names of the sums over the impacts of a pair: their number n, the sum f1 of the impact speeds and
the sum f2 of their squares, at either stop. There are ROWS_OF_PAIR of them."""

STATISTICS = "statistics"
"""Owner of the functions of the motion that are averaged."""


def of_coordinate(name: str) -> dict[str, Quantity]:
    """Quantities of a coordinate, from the means of x, x^2 and v^2."""
    return {
        "displacement_mean": lambda m: m[name, "x"],
        "displacement_std": lambda m: math.sqrt(m[name, "variance"]),
        "displacement_mean_square": lambda m: m[name, "xx"],
        "velocity_std": lambda m: math.sqrt(max(m[name, "vv"], 0.0)),
        "velocity_mean_square": lambda m: m[name, "vv"],
    }


def acceleration_std(name: str) -> Quantity:
    """Standard deviation of the absolute acceleration, from the means of a and a^2."""
    return lambda m: math.sqrt(max(m[name, "aa"] - m[name, "a"] ** 2, 0.0))


def of_pair(name: str) -> dict[str, Quantity]:
    """Quantities of an impact pair, from the sums of 1, w and w^2 over impacts, per second."""

    def total(what: str) -> Quantity:
        return lambda m: m[name, f"{what}_lower"] + m[name, f"{what}_upper"]

    return {
        "collision_rate": total("n"),
        "collision_rate_lower": lambda m: m[name, "n_lower"],
        "collision_rate_upper": lambda m: m[name, "n_upper"],
        "impact_speed_rate": total("f1"),
        "impact_speed_square_rate": total("f2"),
    }


def gap_of(pair: Pair) -> str:
    """Owner of the means of a pair's relative displacement and velocity."""
    return f"gap of {pair.name}"


def of_gap(pair: Pair) -> dict[str, Quantity]:
    """Quantities of the relative motion of a pair of two coordinates."""
    known = of_coordinate(gap_of(pair))
    return {
        f"relative_{name}": known[name]
        for name in ("displacement_mean", "displacement_std", "velocity_std")
    }


def of_compliant_pair(pair: Pair) -> dict[str, Quantity]:
    """Quantities of a pair with a compliant stop, from the sums over its contacts.

    The peak force is given only where all stops of the pair are compliant.
    """
    name, mass = pair.name, pair.mass
    sides = [stop.name for stop in pair.stops if not stop.rigid]
    found: dict[str, Quantity] = {
        f"contact_force_{side}": lambda m, side=side: mass * m[name, f"force_{side}"]  # type: ignore[misc]
        for side in sides
    }
    found["contact_probability"] = lambda m: sum(m[name, f"contact_{side}"] for side in sides)
    if len(sides) == len(pair.stops):
        found["peak_force"] = lambda m: _ratio(
            mass * sum(m[name, f"peak_{side}"] for side in sides),
            sum(m[name, f"ended_{side}"] for side in sides),
        )
    return found


def power_of_pair(pair: Pair) -> Quantity:
    """Mean power that the stops of a pair take, W."""
    return lambda m: sum(power_of_stop(pair, stop, m) for stop in pair.stops)


def key_of_statistic(name: str) -> Key:
    """The key of a function of the motion that is averaged."""
    return STATISTICS, name


def speed_mean(name: str) -> Quantity:
    """Mean impact speed, m/s: F1 over the rate of all counted impacts."""
    pair = of_pair(name)
    return lambda m: _ratio(pair["impact_speed_rate"](m), pair["collision_rate"](m))


def _ratio(above: float, below: float) -> float:
    """A mean per impact; NaN where there was no impact, of which nothing is known."""
    return above / below if below else math.nan


def governed(model: Model) -> dict[Key, Quantity]:
    """Quantities that `rel_error` governs, without the rates that would be infinite if all impacts
    were counted."""
    found: dict[Key, Quantity] = {}
    for coordinate in model.coordinates:
        known = of_coordinate(coordinate)
        found |= {(coordinate, name): known[name] for name in GOVERNED if name in known}
    for pair in model.pairs:
        known = of_pair(pair.name)
        for name in GOVERNED:
            if name in known and not (name in RATES and any(map(collapses, pair.stops))):
                found[pair.name, name] = known[name]
    return found


def collapses(stop: Stop) -> bool:
    """Whether the rate of all impacts on a stop is infinite under white noise."""
    return stop.rigid and stop.law.slow_restitution <= COLLAPSE_RESTITUTION


# ------------------------------------------------------------------------------
# Statistics of independent paths: merging of blocks, and estimates with standard errors.
# ------------------------------------------------------------------------------


Quantities = Callable[[Means], Sequence[float]]
"""Several quantities of a response that are computed together."""


@dataclass(frozen=True, kw_only=True)
class Layout:
    """Meaning of the rows of a table of time averages, and the origins of their positions.

    `rows` are keys of `Means`. For each coordinate in `origins`, the rows "x" and "xx" hold moments
    of x less its origin, m. `thresholds` hold for each pair the speed of the slowest impact that
    its rates count, m/s. `controls` are rows whose expected values are known.
    """

    rows: tuple[Key, ...]
    origins: Mapping[str, float]
    thresholds: Mapping[str, float]
    controls: Mapping[Key, float] = field(default_factory=dict)


FEWEST_SHARING = 50.0
"""Number of paths that must share in a control, (sum c)^2 / sum c^2, for it to be used: a
regression on the one or two passages that were seen would fit them without any error."""

PATHS_PER_CONTROL = 8
"""Number of paths for each control that is used, the first ones of the layout: a regression of n
paths on k controls costs 1 / (1 - k / n) of the variance that it leaves, at most 1.14."""

COLLINEAR = 1e-9
"""Eigenvalue of the correlation matrix of the controls, relative to the largest, below which a
combination of them is left out."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PathStatistics(PathMoments):
    """Count, mean vector and scatter matrix of the time averages of independent paths.

    The means and errors of quantities use the controls: with c the averages of rows whose expected
    values mu are known, the mean of any row m is m - B (c - mu), with B the regression of m on c
    over the paths. That has the same expected value up to 1 / paths of an error, and only the
    variance that is left beside the regression (S. S. Lavenberg, P. D. Welch 1981).
    """

    layout: Layout

    @classmethod
    def of(cls, averages: NDArray[np.float64], layout: Layout) -> PathStatistics:
        """Statistics of an array (rows, paths)."""
        mean = averages.mean(axis=1)
        centred = averages - mean[:, None]
        # einsum sums in a fixed order, where a threaded matrix product may not
        scatter = np.einsum("ip,jp->ij", centred, centred)
        return cls(count=averages.shape[1], mean=mean, scatter=scatter, layout=layout)

    @classmethod
    def none(cls, layout: Layout) -> PathStatistics:
        """Statistics of no paths."""
        size = len(layout.rows)
        return cls(count=0, mean=np.zeros(size), scatter=np.zeros((size, size)), layout=layout)

    def evaluate(self, quantity: Quantity) -> tuple[float, float]:
        """Value and standard error of a smooth function of the means (delta method)."""
        ((value, error),) = self.evaluate_all(lambda means: (quantity(means),))
        return value, error

    def evaluate_all(self, quantities: Quantities) -> list[tuple[float, float]]:
        """Values and standard errors of several functions of the means that are computed
        together."""
        gradient = self.gradient(quantities)
        _, covariance = self._controlled
        variances = np.maximum(np.sum(gradient * (covariance @ gradient), axis=0), 0.0)
        return list(zip(quantities(self.means()), np.sqrt(variances).tolist(), strict=True))

    def gradient(self, quantities: Quantities) -> Vector:
        """Derivatives (rows, quantities) of several functions of the means by each mean."""
        gradient = np.zeros((len(self.mean), len(quantities(self.means()))))
        if self._neighbours:
            rows, steps, above, below = zip(*self._neighbours, strict=True)
            higher, lower = ([quantities(means) for means in side] for side in (above, below))
            gradient[list(rows)] = np.subtract(higher, lower) / (2.0 * np.array(steps)[:, None])
        return gradient

    @cached_property
    def _neighbours(self) -> list[tuple[int, float, Means, Means]]:
        """Neighbouring means at which the delta method evaluates all quantities; see `neighbours`
        of `results.estimates`."""
        return [
            (row, float(step), self._named(above), self._named(below))
            for row, step, above, below in neighbours(*self._controlled)
        ]

    def means(self) -> Means:
        """The means by key."""
        return self._named(self._controlled[0])

    @property
    def uncontrolled(self) -> PathStatistics:
        """The same statistics as the paths have them, without the controls."""
        return replace(self, layout=replace(self.layout, controls={}))

    @cached_property
    def with_noise_alone(self) -> PathStatistics:
        """The same statistics with those controls alone whose expected value is 0: they are the
        same at any step."""
        controls = {key: value for key, value in self.layout.controls.items() if value == 0.0}
        return replace(self, layout=replace(self.layout, controls=controls))

    @cached_property
    def _controlled(self) -> tuple[Vector, Vector]:
        """The means, and the covariance of their errors, by the regression on the controls."""
        used, slopes, inverse = self.regression
        if not used:
            return self.mean, self.covariance
        off = self.mean[used] - [self.layout.controls[self.layout.rows[row]] for row in used]
        left = self.scatter - slopes @ self.scatter[used]
        freedom = self.count - 1 - len(used)
        covariance = left / freedom * (1.0 / self.count + off @ inverse @ off)
        # where the controls leave nothing, rounding may leave less
        covariance[np.diag_indices_from(covariance)] = np.maximum(np.diag(covariance), 0.0)
        return self.mean - slopes @ off, covariance

    @cached_property
    def regression(self) -> tuple[list[int], Vector, Vector]:
        """The rows of the controls that are used, the slopes of all rows on them, and the inverse
        of their scatter."""
        used = [row for row, key in enumerate(self.layout.rows) if self._usable(key, row)]
        used = used[: self.count // PATHS_PER_CONTROL]
        size = np.sqrt(np.diag(self.scatter)[used])
        within = self.scatter[np.ix_(used, used)] / np.outer(size, size)
        inverse = np.linalg.pinv(within, rcond=COLLINEAR, hermitian=True) / np.outer(size, size)
        return used, self.scatter[:, used] @ inverse, inverse

    def _usable(self, key: Key, row: int) -> bool:
        """Whether a row is a control in which many paths share; noise is shared by all."""
        mean, scatter = self.mean[row], self.scatter[row, row]
        if key not in self.layout.controls or scatter <= 0.0:
            return False
        if self.layout.controls[key] == 0.0:
            return self.count >= FEWEST_SHARING
        squares = scatter + self.count * mean**2
        return bool((self.count * mean) ** 2 >= FEWEST_SHARING * squares)

    def _named(self, mean: Vector) -> Means:
        """The means by key, positions from the unloaded springs; and the variance of each x, which
        is taken from its origin, as a far one would cost its digits."""
        named = dict(zip(self.layout.rows, mean.tolist(), strict=True))
        for coordinate, origin in self.layout.origins.items():
            offset, square = named[coordinate, "x"], named[coordinate, "xx"]
            named[coordinate, "x"] = origin + offset
            named[coordinate, "xx"] = max(origin * (origin + 2.0 * offset) + square, 0.0)
            named[coordinate, "variance"] = max(square - offset**2, 0.0)
        return named


@dataclass(frozen=True, kw_only=True, eq=False)
class StepPairs(PathMoments):
    """Moments of the time averages of paths that are simulated at the step and at twice the step:
    the rows of the layout at the step, then the same rows at twice the step."""

    layout: Layout

    @classmethod
    def of(cls, averages: NDArray[np.float64], layout: Layout) -> StepPairs:
        """Moments of an array (2 rows, paths)."""
        found = PathStatistics.of(averages, layout)
        return cls(count=found.count, mean=found.mean, scatter=found.scatter, layout=layout)

    @classmethod
    def none(cls, layout: Layout) -> StepPairs:
        """Moments of no paths."""
        size = 2 * len(layout.rows)
        return cls(count=0, mean=np.zeros(size), scatter=np.zeros((size, size)), layout=layout)

    def half(self, rows: slice) -> PathStatistics:
        """The paths at one of the steps, without controls."""
        return PathStatistics(
            count=self.count,
            mean=self.mean[rows],
            scatter=self.scatter[rows, rows],
            layout=self.layout,
        ).uncontrolled

    def differences(
        self, quantities: Quantities, whole: PathStatistics
    ) -> list[tuple[float, float]]:
        """Quantities at twice the step less those at the step, with the standard errors of the
        differences.

        These n paths are some of the N paths of `whole` at the step, which know the quantity
        better. With c, f and g the values at twice the step, at the step, and at the step of all N
        paths, the difference is c - beta f - (1 - beta) g, f - g being a control variate of zero
        mean. Its variance is least at beta = cov(c, f) / var(f), for paths that share their noise
        near 1 and for independent ones 0.
        """
        rows = len(self.layout.rows)
        fine, coarse, covariance = at_both_steps(self, whole)
        whole = whole.with_noise_alone
        of_fine, of_coarse = fine.gradient(quantities), coarse.gradient(quantities)

        def shared(left: Vector, right: Vector, block: Vector) -> Vector:
            return np.asarray(np.sum(left * (block @ right), axis=0))

        var_fine = shared(of_fine, of_fine, covariance[:rows, :rows])
        var_coarse = shared(of_coarse, of_coarse, covariance[rows:, rows:])
        both = shared(of_fine, of_coarse, covariance[:rows, rows:])
        beta = np.divide(both, var_fine, out=np.ones_like(both), where=var_fine > 0.0).clip(
            0.0, 1.0
        )
        here = var_coarse + beta**2 * var_fine - 2.0 * beta * both
        elsewhere = (1.0 - beta) * ((1.0 + beta) * var_fine - 2.0 * both)
        errors = np.sqrt(np.maximum(here / self.count + elsewhere / whole.count, 0.0))
        values = (
            np.array(quantities(coarse.means()))
            - beta * quantities(fine.means())
            - (1.0 - beta) * quantities(whole.means())
        )
        return list(zip(values.tolist(), errors.tolist(), strict=True))


@lru_cache(maxsize=2)
def at_both_steps(
    pairs: StepPairs, whole: PathStatistics
) -> tuple[PathStatistics, PathStatistics, Vector]:
    """Return the pairs at the step and at twice the step, and their covariance over the paths.

    The covariance has the shape (2 rows, 2 rows). The regression on noise takes the slopes of the
    `whole`, which knows them best.

    They are kept, as is what their derivatives need, since many quantities are asked for in a row.
    """
    rows = len(pairs.layout.rows)
    used, slopes, _ = whole.with_noise_alone.regression
    one = np.eye(rows)
    one[:, used] -= slopes
    both = np.kron(np.eye(2), one)
    found = replace(pairs, mean=both @ pairs.mean, scatter=both @ pairs.scatter @ both.T)
    covariance = found.scatter / max(pairs.count - 1, 1)
    return found.half(slice(rows)), found.half(slice(rows, None)), covariance


# ------------------------------------------------------------------------------
# The bias that a finite step leaves in a quantity, from the quantity's change with the step.
#
# Every plan simulates some of its paths at its step h and at 2 h. If a scheme is of order p, the
# bias at h is the difference of the two results over 2^p - 1. This module knows the order of each
# quantity, and the cases in which slow impacts on inelastic stops make the bias unknown.
# ------------------------------------------------------------------------------


WELL_RESOLVED_RESTITUTION = 0.5
"""Smallest coefficient of restitution (dimensionless) at which a plain step resolves the impacts
that are faster than the default speed threshold. Below it bounces are so slow that steps near a
stop must be refined before the bias of a rate is known."""

RESOLVED = 4.0
"""Speed over sqrt(S0 h), S0 the intensity of the noise on a gap, from which a plain step resolves
impacts on any inelastic stop. At R = 0 to 0.4 rates of faster impacts were 3 % off at most, at the
largest steps; those from 1 on were up to 22 % off."""

FEW_SLOW = 0.02
"""Largest share of impacts that may be slower, so that the bias of a rate is stated."""

SPEED_POWER = {
    "collision_rate": 0, "collision_rate_lower": 0, "collision_rate_upper": 0,
    "impact_speed_mean": 0, "impact_speed_square_rate": 2,
}  # fmt: skip
"""Power m of the impact speed w in a quantity that sums w^m over the impacts. Quantities that are
not named here depend on the impulses, and so have the power 1."""


def lossiest(model: Model) -> float:
    """The smallest coefficient of restitution among the stops, as slow impacts see it; 1 without
    stops."""
    return min((stop.law.slow_restitution for stop in model.stops), default=1.0)


def refines_near_stops(model: Model) -> bool:
    """Whether steps can be refined for slow impacts: on rigid stops, without tables and pulses of a
    shape."""
    return model.rigid and not (model.tables or model.drawn or model.sampled_modulations)


def bias_of_smooth_motion(difference: float) -> float:
    """Bias of a scheme of order 2, where no white noise acts or there are no stops."""
    return difference / 3.0


def bias_of_lasting_contact(difference: float) -> float:
    """Bias where a load presses a mass onto a stop, as no white noise acts.

    A mass at rest stays there to the next sample. Each halving of the step changed the rates of a
    mass on a truck by 1/2 to 1/3 of the change before; order 1 is on the safe side.
    """
    return difference


def bias_of_sticking(difference: float) -> float:
    """Bias where dry friction may hold a mass, as no white noise acts.

    What sticks creeps between kicks. The order is 1 at short steps, and lower at long ones; 1/2 is
    on the safe side: at steps of 0.02 to 0.2 of a radian the bias was 0.3 to 0.7 of this bound.
    """
    return difference / (math.sqrt(2.0) - 1.0)


def bias_of_plain_step(
    name: str, difference: float, restitution: float, rates_resolved: bool = True
) -> float | None:
    """Bias under white noise where the step is not refined near the stops.

    It is None for a rate if the step does not resolve the slow impacts that the rate counts: below
    WELL_RESOLVED_RESTITUTION, or where `rates_resolved` is False.
    """
    resolved = rates_resolved and restitution >= WELL_RESOLVED_RESTITUTION
    return extrapolated(name, difference, restitution) if resolved or name not in RATES else None


def bias_of_refined_step(name: str, difference: float, restitution: float) -> float | None:
    """Bias under white noise where the step is refined near the stops.

    A refined step resolves slow impacts with the velocity that noise brings in it, which grows with
    the square root of the step: the rates are of order 1/2. The bias of a rate is None where the
    rate of all impacts is infinite.
    """
    finite = restitution > COLLAPSE_RESTITUTION
    if name not in RATES and finite:  # where stops lose much, the order is about 1
        return difference if restitution < WELL_RESOLVED_RESTITUTION else difference / 3.0
    return difference / (math.sqrt(2.0) - 1.0) if finite or name not in RATES else None


def bias_of_fast_impacts(difference: float, slow: float) -> float:
    """Bias of a rate under white noise, of which no more than a part `slow` is unresolved.

    That part may be missed. The others have the order of slow ones that are resolved, 1/2, on the
    safe side.
    """
    return difference / (math.sqrt(2.0) - 1.0) + slow


def share_below(speed: float, mean: float, mean_square: float) -> float:
    """Largest share of speeds below one, by their mean and mean square (Cantelli's inequality).

    >>> round(share_below(1.0, 4.0, 16.25), 4)
    0.027
    """
    if speed >= mean:
        return 1.0
    variance = max(mean_square - mean**2, 0.0)
    return variance / (variance + (mean - speed) ** 2)


def extrapolated(name: str, difference: float, restitution: float) -> float:
    """Bias at a step from the difference to twice the step, difference / (2^order - 1).

    A step resolves impact speeds above about sqrt(S0 h). Their density is w^(1 - beta) near 0, so
    those below hold a share h^((2 + m - beta) / 2) of the sum of w^m over impacts; the scheme
    itself is of order 2.

    >>> [round(extrapolated("impact_speed_rate", 0.3, r), 3) for r in (0.8, 0.5, 0.2)]
    [0.192, 0.3, 0.643]
    """
    power = SPEED_POWER.get(name, 1)
    order = min(2.0, (2.0 + power - corner_exponent(restitution)) / 2.0)
    # at R <= exp(-pi / sqrt 3) the rate has no limit at all
    return difference / (2.0**order - 1.0) if order > 0.0 else math.inf


# ------------------------------------------------------------------------------
# The protocol of a plan: how the paths of one scene are simulated, and what is averaged.
#
# A plan knows the model, the step and the lengths of a path; it does not depend on the number of
# paths or on the use of the averages. The averages of a block of paths follow from the plan, the
# seed and the numbers of the paths alone. So any worker may compute them.
# ------------------------------------------------------------------------------


RELAXATIONS = 12.0
"""Length of the burn-in in units of the slowest time constant: the error of the start, which is
small already, decays to e^-12 of itself."""

Records = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Histories:
    """Stationary records of a block of paths at equal steps, SI units.

    Parameters
    ----------
    displacement, velocity
        (coordinates, paths, samples). Velocities are those before the kick of white noise that
        falls on a sample.
    impact_speed
        (pairs, paths, samples): sum of the incident speeds within the step that ends at a sample,
        negative at a lower stop.
    excitation
        (paths, samples), None where it is not known: f of x'' + b x' + omega^2 x = f + impacts,
        m/s^2; a base acceleration is -f. For white noise it is the mean over the next step.
    lost
        As `losses_of`, in the time of the log.
    """

    displacement: Records
    velocity: Records
    impact_speed: Records
    excitation: Records | None
    lost: Records


@dataclass(frozen=True, kw_only=True)
class Plan(Protocol):
    """Steps, start and lengths of the paths of one scene; SI units.

    Bodies are those of a plan whose step may be chosen and whose records include the burn-in.

    Parameters
    ----------
    model
        The model that is simulated.
    step, burn_in, duration
        Time step or sampling interval, length of the burn-in, and counted length of a path after
        it, s.
    """

    model: Model
    step: float
    burn_in: float
    duration: float

    @property
    def method(self) -> str:
        """Name of the scheme, for the assumptions of an answer."""

    @property
    def states(self) -> int:
        """Number of state variables of a path."""

    @property
    def block(self) -> int:
        """Number of paths that are simulated together: so many that the kernels reach their full
        speed and the arrays fit into the caches."""

    @property
    def elastic(self) -> bool:
        """Whether the stationary distribution is exact at any step, so that there is no bias."""

    @property
    def coarse_share(self) -> float:
        """Share of the paths that are simulated at twice the step as well, 1 over an integer."""

    @property
    def fastest(self) -> float:
        """Largest frequency of a mode or a signal, rad/s."""

    @property
    def hits_in_a_cluster(self) -> float:
        """Upper bound on the number of impacts on one stop within a relaxation time of the energy,
        which are not independent."""

    @property
    def relaxation(self) -> float:
        """Relaxation time of the energy including the losses at stops, s."""

    @property
    def speeds(self) -> tuple[float, ...]:
        """Rms speed of the gap of each impact pair, or of one oscillator without a pair, m/s."""

    @property
    def kicked(self) -> bool:
        """Whether there is white noise, which acts in kicks a step apart."""

    @property
    def layout(self) -> Layout:
        """Meaning of the rows of `averages`."""

    # The step, and what it leaves as bias --------------------------------------------------------

    @property
    def relative_bias(self) -> float:
        """Relative bias of all quantities that does not depend on the step."""
        return 0.0

    def step_bias(self, name: str, difference: float) -> float | None:
        """The bias that the step leaves in a quantity, from its difference to twice the step; None
        where that difference does not determine the bias."""

    def coarser(self) -> Self:
        """The plan at twice the step, for the same paths and as far as possible the same noise."""

    def finer(self) -> Self:
        """The plan with less bias: half the step, or slow impacts resolved."""

    def with_step(self, step: float) -> Self:
        """The plan at a chosen step, s; ValueError if it is too long to detect all impacts."""

    # The length of paths -------------------------------------------------------------------------

    @property
    def steps(self) -> int:
        """Counted steps of a path."""
        return max(2, math.ceil(self.duration / self.step))

    @property
    def burn_in_steps(self) -> int:
        """Steps of a path, or of each of its blocks, before counting starts."""
        return math.ceil(self.burn_in / self.step)

    @property
    def steps_per_path(self) -> int:
        """Number of steps of a path, burn-in included."""
        return self.steps + self.burn_in_steps

    def cut(self, steps: int) -> Self:
        """The plan whose paths end after so many counted steps, of which there is at least one."""
        return replace(self, duration=steps * self.step)

    def shortest(self, steps: int = 2) -> Self:
        """The plan with a few steps of the same kernels and hardly any burn-in: two are enough to
        compile them. A plan that synthesises paths has a few samples whatever `steps` is."""
        return replace(self, burn_in=self.step, duration=steps * self.step)

    def unbroken(self, duration: float) -> Self:
        """The plan with paths of `duration` seconds whose counted part has no jumps: a path that is
        synthesised in several blocks jumps between them."""
        return self

    # Averages ------------------------------------------------------------------------------------

    def begin(
        self, seed: int, first_path: int, paths: int, record: Records | None = None,
        log: Log | None = None, accelerations: Records | None = None,
    ) -> Underway:  # fmt: skip
        """The paths of `averages` before their first step, to be simulated piece by piece."""

    def averages(
        self, seed: int, first_path: int, paths: int, record: Records | None = None,
        log: Log | None = None, accelerations: Records | None = None,
    ) -> Records:  # fmt: skip
        """Time averages (rows of `layout`, paths) of the paths first_path, first_path + 1, ...

        A `record` gets the states of every step, a `log` every impact of the counted part, and
        `accelerations` the largest ones in contacts (`ModalPlan.follow`).
        """
        underway = self.begin(seed, first_path, paths, record, log, accelerations)
        underway.reach(underway.total)
        return underway.averages()

    # Records -------------------------------------------------------------------------------------

    def record(self, seed: int, path: int) -> Mapping[str, Vector]:
        """One path from its start, without burn-in, by column: displacements, velocities and the
        incident speeds of impacts within the step that ends at each sample."""

    def sampled(self, step: float, duration: float) -> Self:
        """The plan for `histories` of `duration` seconds at a sampling interval of at most `step`,
        s."""
        plan = self.with_step(min(step, self.step))
        # a step more, since burn-in and duration are both rounded up to whole steps
        steps = math.ceil((plan.burn_in + duration) / plan.step) + 1
        return replace(plan, duration=steps * plan.step)

    @property
    def settling(self) -> int:
        """Number of samples at the beginning of a record that `histories` leave out."""
        return self.burn_in_steps

    def history_samples(self, duration: float) -> int:
        """Number of samples of a history of `duration` seconds, for a plan from `sampled`."""
        return max(2, math.ceil(duration / self.step))

    @property
    def record_width(self) -> int:
        """Number of floats that are recorded per sample."""

    def record_size(self, samples: int) -> int:
        """Number of floats in the record of one path, from which a history of `samples` is made."""
        return self.record_width * (samples + self.settling)

    @property
    def excitation_known(self) -> bool:
        """Whether `histories` hold the excitation."""

    def histories(
        self, seed: int, first_path: int, paths: int, samples: int, log: Log | None = None
    ) -> Histories:
        """Stationary records of the paths first_path, first_path + 1, ..., each of `samples`
        samples.

        A `log` gets every impact; the first sample is at the time (settling + 1) * step of the log.
        """

    def drive(self, seed: int, path: int, samples: int, integrals: int) -> Records | None:
        """Forces (coordinates, samples) of noise and sines at the samples of `histories`, N,
        integrated over time `integrals` times.

        None where they are not known, or where the integral is not stationary. White noise is the
        mean over the next step.
        """


class Underway(ABC):
    """Paths of a plan under way, which go on from their state with their sums.

    Their averages depend on the steps that they have made, not on the pieces in which they made
    them. A path has `segments` of `length` steps each, of which the first `burn_in` ones are not
    counted.

    Parameters
    ----------
    length, segments, burn_in
        Lengths in steps, see above.
    """

    def __init__(self, length: int, segments: int, burn_in: int) -> None:
        self.length, self.segments, self.burn_in = length, segments, burn_in
        self.made = 0

    @property
    def total(self) -> int:
        """Number of steps of a path."""
        return self.length * self.segments

    @property
    def counted(self) -> int:
        """Number of counted steps that the paths have made."""
        whole, part = divmod(self.made, self.length)
        return whole * (self.length - self.burn_in) + max(0, part - self.burn_in)

    def reach(self, steps: int) -> None:
        """Simulate the paths on until they have made at least so many steps.

        Raises `GivenUp` if the flag of this thread is set; there are no averages then.
        """
        steps = min(steps, self.total)
        while self.made < steps:
            segment, first = divmod(self.made, self.length)
            last = min(first + steps - self.made, self.length)
            # two successive steps use a pair of normals
            last = min(last + last % 2, self.length)
            self.advance(segment, first, last)
            check_flag()
            self.made += last - first

    @abstractmethod
    def advance(self, segment: int, first: int, last: int) -> None:
        """Make the steps first, first + 1, ... before `last` of a segment."""

    @abstractmethod
    def averages(self) -> Records:
        """Time averages over the counted steps so far, as `Plan.averages` gives them."""


def streams_of(seed: int, first_path: int, paths: int) -> NDArray[np.uint64]:
    """Random streams (2, paths) of the paths first_path, first_path + 1, ..."""
    streams = np.empty((2, paths), np.uint64)
    seed_streams(np.uint64(seed), first_path, streams)
    return streams


def normals_of_steps(
    seed: int, first_path: int, paths: int, steps: int, earlier: float | None
) -> Records:
    """The normals of the kicks after each sample (steps, paths) of one mode, from the streams of
    the paths: a record begins at the end of the first step.

    The kernels use a pair for two successive steps, and the first pair for the start. A step that
    takes the noise of two weighs the earlier one by `earlier`.
    """
    streams = streams_of(seed, first_path, paths)
    rows = 1 + math.ceil((steps + 1) / (2 if earlier is None else 1))
    even, odd = np.empty((2, rows, paths))
    normal_rows(streams[0], streams[1], even, odd)
    if earlier is None:
        drawn = np.stack([even[1:], odd[1:]], axis=1).reshape(-1, paths)
    else:
        drawn = earlier * even[1:] + math.sqrt(1.0 - earlier**2) * odd[1:]
    return drawn[1 : steps + 1]


def losses_of(model: Model, layout: Layout, averages: Records, duration: float) -> Records:
    """Energy that the lower and the upper stop of each pair take in a path, (pairs, 2, paths), J,
    from the averages over so many seconds; 0 where it follows from the speeds of impacts."""
    found = np.zeros((len(model.pairs), 2, averages.shape[1]))
    place = {key: row for row, key in enumerate(layout.rows)}
    for number, pair in enumerate(model.pairs):
        for side, name in enumerate(("lower", "upper")):
            row = place.get((pair.name, f"loss_{name}"))
            if row is not None:
                found[number, side] = pair.mass * duration * averages[row]
    return found


# ------------------------------------------------------------------------------
# A statistic of one's own: the mean over time of a function of the motion.
# ------------------------------------------------------------------------------


class Statistic(Checked):
    """The mean over time of a function of displacement and velocity, E f(x, v).

    `simulate` compiles the function and averages its values over all paths, in the middle between
    two kicks of noise. A function that is 1 where something holds and 0 elsewhere gives the share
    of time in which it holds.

    Parameters
    ----------
    function
        A function (displacement, velocity) of two numbers in m and m/s that returns a number: plain
        Python with `math`, or compiled by numba.
    of
        The coordinate, the point or the impact pair whose displacement and velocity the function
        takes; that of a pair is its gap. By default the only coordinate of the scene.

    See Also
    --------
    stochvi.simulate : The simulation, by its argument `statistics`.
    stochvi.history : Paths as tables, for what depends on the past of a motion.

    Examples
    --------
    >>> import stochvi
    >>> scene = stochvi.load_scene(stochvi.scenes.shipped_scene("oscillator-elastic"))
    >>> deep = Statistic(function=lambda x, v: 1.0 if x > 0.5 else 0.0)
    >>> answer = stochvi.simulate(scene, statistics={"beyond 0.5 m": deep}, paths=256)
    >>> share = answer.statistics["beyond 0.5 m"]
    >>> abs(share.value - 0.2195) < 5.0 * share.standard_error
    True
    """

    function: Function
    of: str | None = None
    _contents: str = PrivateAttr(default="")
    """Digest of the instructions of the function and of the values that it uses."""

    @model_validator(mode="after")
    def _compiles(self) -> Self:
        if fault := arguments_fault(self.function):
            raise ValueError(
                f"needs function that takes a displacement (m) and a velocity (m/s), got {fault}"
            )
        try:
            compiled_of(self.function)
        except NotCompiled as error:
            raise ValueError(
                f"needs function that numba compiles, got {_name_of(self.function)}: {error}; "
                "write it with numbers, `if` and `math`, or compile it with numba.njit"
            ) from None
        self._contents = contents_of([self.function])
        return self

    def document(self) -> dict[str, Any]:
        """The name of the function, with a digest of its instructions, and the name `of`."""
        return {"function": f"{_name_of(self.function)} ({self._contents[:16]})", "of": self.of}

    def row_of(self, model: Model) -> Vector:
        """The row (n,) with displacement = row . q. ValueError where nothing has the name `of`."""
        rows: dict[str, Vector] = {pair.name: pair.direction for pair in model.pairs}
        rows |= zip(model.outputs, model.output_rows, strict=True)
        if self.of is None and len(model.coordinates) == 1:
            return rows[model.coordinates[0]]
        if self.of not in rows:
            raise ValueError(
                f"of must be a coordinate, a point or an impact pair of the scene "
                f"({', '.join(rows)}), got {self.of!r}"
            )
        return rows[self.of]


def check_statistics(statistics: Mapping[str, Statistic], model: Model) -> None:
    """Raise ValueError unless each is a `Statistic` of something in the model."""
    for name, each in statistics.items():
        if not isinstance(each, Statistic):
            raise ValueError(
                f"statistics must be a table of names and `Statistic`, got {name!r}: {each!r}; "
                "give each function anew, also to a run that goes on"
            )
        each.row_of(model)


def statistics_of(
    statistics: Mapping[str, Statistic], model: Model, half_kick: tuple[Matrix, Matrix]
) -> Statistics:
    """The functions for the kernel.

    `half_kick` is decay and noise of half a kick, from the sampled velocities of the modes.
    """
    if not statistics:
        return NO_STATISTICS
    modes: ModalForm = model.modal
    decay, brought = half_kick
    rows = np.array([each.row_of(model) for each in statistics.values()]) @ modes.shapes
    return Statistics(
        functions=addresses_of([each.function for each in statistics.values()]),
        displacements=np.ascontiguousarray(rows),
        rates=np.ascontiguousarray(rows @ decay),
        places=rows @ modes.rest,
        spreads=np.linalg.norm(rows @ brought, axis=1),
    )
