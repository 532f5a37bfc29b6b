"""Statistics of impacts one by one: rates, intervals, speeds, energy, clusters. Chapters: tallies
by path; the answer; rates by linear theory; the calculation."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import partial
from typing import Any, ClassVar, NamedTuple, Unpack

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtr

from stochvi.mathematics.impact_rates import COLLAPSE_RESTITUTION, corner_exponent
from stochvi.mathematics.numerics import Matrix, Vector
from stochvi.mathematics.spectra import Table, response_moments, squared_gain
from stochvi.mathematics.units import explain_methods
from stochvi.mathematics.unsteady_noise import MovingMean
from stochvi.methods.monte_carlo import check_threshold
from stochvi.model.coverage import beyond_one_oscillator, free_motion
from stochvi.model.modal import linear_law
from stochvi.model.model import UPPER, Model, Pair, model_of
from stochvi.motion.choose_plan import (
    FEWEST_PAIRS,
    ImpactLog,
    ImpactPlan,
    check_price,
    paths_at_both_steps,
    plan_impacts,
)
from stochvi.motion.plan import Plan, collapses, lossiest, refines_near_stops
from stochvi.results.base import (
    DataFrame,
    Named,
    Result,
    Stated,
    frame_of,
    quantities_of,
    stacked,
    stated,
)
from stochvi.results.deadline import Deadline, partial_result
from stochvi.results.errors import NotApplicable, NotConverged
from stochvi.results.estimates import (
    GAUSSIAN_95,
    LIMIT_ALONE,
    TOO_FEW,
    Estimate,
    jackknife_error,
    logarithmic_interval,
    mean_and_error,
    of_events,
    poisson_interval,
    provenance,
    ratio_and_error,
    reach,
    student_factor,
    upper_limit_unseen,
    without_impact,
)
from stochvi.sampling.calculations import ListSampler, SamplingOptions, calculation
from stochvi.sampling.run import Run, sampled
from stochvi.scenes.scene import Scene
from stochvi.statistics.crossings import first_crossings, listed_under_first

# ------------------------------------------------------------------------------
# Tallies of the impacts of each path, and estimates from independent paths.
# ------------------------------------------------------------------------------


WINDOWS = 8
"""Number of windows of a path in which impacts are counted for the dispersion."""

BINS = 40
"""Number of bins of a histogram, equally wide in the logarithm."""

LARGEST_DISPERSION = 1.25
"""Counts pass for Poisson's where the upper limit of their dispersion lies between the inverse of
this number and this number: an interval is then at most 12 % too narrow or too wide."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Grid:
    """The classes in which the impacts of a pair are counted. `speeds` (m/s) and `intervals` (s,
    shorter than a path) are edges of bins. `fits` are the two ranges of speeds, with one start, to
    which exponents are fitted. `window` is a length (s)."""

    speeds: Vector
    intervals: Vector
    fits: tuple[tuple[float, float], tuple[float, float]]
    window: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Tally:
    """Sums over the impacts of each path. The first axis are the paths, the second the lower and
    the upper stop.

    `fits` are numbers, sums of ln(w / start) and of w in both ranges, (paths, 2, 2 ranges, 3).

    `intervals` are weights. Take an interval of length t after an impact, in a stationary motion.
    It ends within a path of length T if the impact falls into the first T - t seconds: a share 1 -
    t / T of such intervals is seen. Each counts T / (T - t)-fold (D. G. Horvitz and D. J. Thompson,
    J. Am. Stat. Assoc. 47 (1952) 663). The weights of a bin then have the mean of the number of
    impacts that such an interval follows. This holds however short the paths are, and however
    intervals depend on each other.
    """

    numbers: Matrix
    squares: Matrix
    energies: Matrix
    fits: NDArray[np.float64]
    speeds: Matrix
    intervals: Matrix
    windows: Matrix

    @classmethod
    def of(cls, log: ImpactLog, paths: int, grid: Grid) -> Tally:
        """The tally of the impacts of a block of paths."""
        side = (log.speed > 0.0).astype(np.int64)
        speed = np.abs(log.speed)

        def total(weight: Vector, place: NDArray[np.int64], size: int) -> Matrix:
            flat = np.bincount(log.path * size + place, weights=weight, minlength=paths * size)
            return np.asarray(flat.reshape(paths, size), dtype=float)

        assert log.lost is not None
        one = np.ones_like(speed)
        fits = np.empty((paths, 2, 2, 3))
        for number, (low, high) in enumerate(grid.fits):
            inside = ((speed >= low) & (speed < high)).astype(float)
            fits[:, :, number, 0] = total(inside, side, 2)
            logs = inside * np.log(np.maximum(speed, low) / low)
            fits[:, :, number, 1] = total(logs, side, 2)
            fits[:, :, number, 2] = total(inside * speed, side, 2)
        window = np.minimum((log.time / grid.window).astype(np.int64), WINDOWS - 1)
        # between impacts of one path that follow each other
        waited, same = np.diff(log.time), np.diff(log.path) == 0
        same &= waited <= grid.intervals[-1]
        places = log.path[1:][same] * (BINS + 2) + np.searchsorted(grid.intervals, waited[same])
        weights = 1.0 / (1.0 - waited[same] / (WINDOWS * grid.window))
        intervals = np.bincount(places, weights, minlength=paths * (BINS + 2)).reshape(paths, -1)
        return cls(
            numbers=total(one, side, 2),
            squares=total(speed**2, side, 2),
            energies=total(log.lost, side, 2),
            fits=fits,
            speeds=total(one, np.searchsorted(grid.speeds, speed), BINS + 2),
            intervals=np.asarray(intervals, dtype=float),
            windows=total(one, window, WINDOWS),
        )

    def rows(self, first: int, paths: int) -> Tally:
        """The tally of some of the paths."""
        names = [each.name for each in fields(Tally)]
        return Tally(**{name: getattr(self, name)[first : first + paths] for name in names})


def merged(tallies: list[Tally]) -> Tally:
    """The tally of all paths together, in the order of the tallies."""
    names = [each.name for each in fields(Tally)]
    return Tally(**{name: np.concatenate([getattr(t, name) for t in tallies]) for name in names})


@dataclass(frozen=True, kw_only=True)
class Rate:
    """Impacts per second, and their 95 % interval, widened by the bias of the step if it is known.

    Parameters
    ----------
    estimate
        The rate, 1/s; the mean time between impacts is one over it.
    lower, upper
        Ends of the interval, 1/s.
    interval
        Its source: "Poisson" for counts that scatter like Poisson's, else "paths".

    See Also
    --------
    stochvi.statistics.PairStatistics : The statistics that hold it.
    """

    estimate: Estimate
    lower: float
    upper: float
    interval: str


def rate(
    counts: Vector, duration: float, poisson: bool, how: str, cluster: float = 1.0,
    bias: float | None = None, bias_error: float = 0.0,
) -> Rate:  # fmt: skip
    """The rate from counts of impacts in independent paths of `duration` seconds; where none was
    seen, with as many impacts in a `cluster` as there may be. A bias that is known widens the
    interval."""
    value, error = mean_and_error(counts / duration)
    seen = Estimate(value=value, standard_error=error, bias=bias, bias_error=bias_error, how=how)
    if value == 0.0:
        most = cluster * upper_limit_unseen(duration * len(counts))
        found, low, high = replace(seen, bias=None, bias_error=0.0, upper_95=most), 0.0, most
    elif poisson:
        found = seen
        low, high = poisson_interval(round(counts.sum()), duration * len(counts))
    else:
        found = of_events(seen, len(counts))
        low, high = logarithmic_interval(value, error, len(counts) - 1)
        low, high = (low, high) if found.upper_95 is None else (0.0, found.upper_95)
    if found.upper_95 is None:
        low = max(value - reach(1.0, [value - low, GAUSSIAN_95 * bias_error], [bias or 0.0]), 0.0)
        high = value + reach(1.0, [high - value, GAUSSIAN_95 * bias_error], [bias or 0.0])
    exact = poisson or value == 0.0
    return Rate(estimate=found, lower=low, upper=high, interval="Poisson" if exact else "paths")


def dispersion(windows: Matrix, window: float) -> Estimate:
    """Variance over mean of the counts (paths, windows); jackknife over paths.

    1 for Poisson's process, more for impacts that come in clusters, less for regular ones.
    """
    paths, count = windows.shape

    def index(sums: Vector, squares: Vector, size: int) -> Vector:
        mean = sums / size
        return np.asarray((squares - size * mean**2) / (size - 1) / mean)

    sums, squares = windows.sum(axis=1), (windows**2).sum(axis=1)
    value = float(index(sums.sum(), squares.sum(), paths * count))
    others = index(sums.sum() - sums, squares.sum() - squares, (paths - 1) * count)
    error = student_factor(paths) * jackknife_error(others)
    return Estimate(
        value=value, standard_error=error, how=f"{paths * count} windows of {window:.4g} s"
    )


def passes_for_poisson(found: Estimate | None) -> bool:
    """Whether counts of this dispersion may pass for those of Poisson's process; not where nothing
    is known of it, since a few impacts may be those of one cluster."""
    if found is None:
        return False
    low, high = (found.value + side * 2.0 * found.standard_error for side in (-1.0, 1.0))
    return low <= 1.0 and 1.0 / LARGEST_DISPERSION <= high <= LARGEST_DISPERSION


@dataclass(frozen=True, kw_only=True, eq=False)
class Histogram:
    """A density on bins with its standard error.

    Parameters
    ----------
    edges
        Edges of the bins (bins + 1,), m/s for speeds and s for times.
    density, standard_error
        Mean density in each bin and its standard error (bins,), per unit of the edges. The density
        of a bin has no bias but that of the step.
    outside
        Share of what lies beyond the bins.

    See Also
    --------
    stochvi.statistics.PairStatistics : The statistics that hold it.
    """

    edges: Vector
    density: Vector
    standard_error: Vector
    outside: float

    @property
    def middles(self) -> Vector:
        """Geometric means of the edges."""
        return np.asarray(np.sqrt(self.edges[1:] * self.edges[:-1]))


def histogram(counts: Matrix, edges: Vector, all_of: Vector) -> Histogram:
    """The histogram of counts (paths, BINS + 2), whose first and last columns lie outside of the
    bins, of `all_of` (paths,) that there are."""
    inside = counts[:, 1:-1]
    shares = [ratio_and_error(column, all_of) for column in inside.T]
    width = np.diff(edges)
    return Histogram(
        edges=edges,
        density=np.array([value for value, _ in shares]) / width,
        standard_error=np.array([error for _, error in shares]) / width,
        outside=max(1.0 - float(inside.sum() / all_of.sum()), 0.0),
    )


def fitted_exponent(fits: NDArray[np.float64], ranges: tuple[tuple[float, float], ...]) -> Estimate:
    """Exponent a of a density w^a by maximum likelihood, from impacts within a range of speeds.

    In u = ln(w / start), 0 <= u < L, the density is proportional to e^((a + 1) u). Its mean m(a) =
    L / (1 - e^(-(a + 1) L)) - 1 / (a + 1) is put equal to that seen; the error is that of the mean
    over independent paths. The density is a pure power only in the limit of slow impacts. The bias
    is the distance to that limit, if the fitted exponent changes in proportion to the mean speed of
    the impacts in the range. The second, shorter range shows this change.
    """
    (value, error), (other, _) = (
        _exponent(fits[:, number, 0], fits[:, number, 1], math.log(high / low))
        for number, (low, high) in enumerate(ranges)
    )
    low, high = ranges[0]
    long, short = (ratio_and_error(fits[:, k, 2], fits[:, k, 0])[0] for k in range(2))
    # where all impacts lie in the shorter range, the two fits do not differ
    bias = abs(value - other) * long / (long - short) if long > short else None
    return Estimate(
        value=value, standard_error=error, bias=bias,
        how=f"{fits[:, 0, 0].sum():.0f} impacts of {low:.3g} to {high:.3g} m/s; bias from "
        "the slower half of that",
    )  # fmt: skip


STEEPEST = 50.0
"""Largest magnitude of an exponent that is looked for."""

SMALL = 1e-6
"""Slope times range up to which the mean is taken as that of an even density, to first order."""


def _exponent(numbers: Vector, sums: Vector, length: float) -> tuple[float, float]:
    mean, error = ratio_and_error(sums, numbers)

    def centre(slope: float) -> float:
        t = slope * length
        if abs(t) < SMALL:
            return length * (0.5 + t / 12.0)
        return length * (1.0 / -math.expm1(-t) - 1.0 / t)

    slope = float(scipy.optimize.brentq(lambda s: centre(s) - mean, -STEEPEST, STEEPEST))
    step = 1e-4
    derivative = (centre(slope + step) - centre(slope - step)) / (2.0 * step)
    return slope - 1.0, error / derivative


# ------------------------------------------------------------------------------
# The answer of the statistics of impacts.
# ------------------------------------------------------------------------------


NOTABLE = 0.05
"""Difference of a variance over mean of counts from 1, that of Poisson's process, from which words
name it: rare impacts have one just below 1 in any windows."""


@dataclass(frozen=True, kw_only=True)
class Exponent:
    """Exponent 1 - beta of the density of impact speeds near 0, w^(1 - beta).

    Parameters
    ----------
    fitted
        From the slow impacts that were counted.
    theory
        beta solves R^(beta - 2) = 2 sin((1 + 2 beta) pi / 6), R the restitution; None where that
        does not hold: compliant stops, noise that is not white, several coordinates.

    See Also
    --------
    stochvi.statistics.PairStatistics : The statistics that hold it.
    """

    fitted: Estimate
    theory: float | None


@explain_methods
@dataclass(frozen=True, kw_only=True, eq=False)
class PairStatistics:
    """Impacts of one pair; numbers are None where nothing was hit.

    Parameters
    ----------
    speed_threshold
        The slowest impact that is counted, m/s.
    rates
        Rates of impacts on the "lower" and the "upper" stop, as far as the pair has them, and on
        "both".
    dispersion
        Variance over mean of counts in windows: 1 for Poisson's process, more for clusters.
    speeds, intervals
        Densities of impact speeds (s/m) and of times between impacts on either stop (1/s).
    speed_rms
        Root mean square impact speed, m/s. Its bias, and that of energies and rates, is that of the
        step, from some paths at twice the step; None where that does not tell it.
    exponents
        Exponents by side, or under "both" where both stops have the same restitution.
    energy, striking_energy
        Mean loss per impact, and mean m w^2 / 2 with which the reduced mass m arrives, in
        `energy_unit`: J, or J/kg where the scene gives no mass. A hammer strikes blows of it.
    rice_rates, clump_rate, first_hit_rate
        Rates without stops, 1/s: Rice's of crossings of each stop and of both; that of clumps of
        crossings (Vanmarcke); that of first impacts, from simulated first crossings, if they were
        asked for.

    See Also
    --------
    stochvi.impacts : The calculation.
    """

    speed_threshold: float
    rates: Mapping[str, Rate]
    dispersion: Estimate | None = stated("variance / mean of counts")
    speeds: Histogram | None
    intervals: Histogram | None
    speed_rms: Estimate | None = stated("rms impact speed", "m/s")
    exponents: Mapping[str, Exponent]
    energy: Estimate | None = stated("energy lost per impact", "J")
    striking_energy: Estimate | None = stated("striking energy, m w^2 / 2", "J")
    rice_rates: Mapping[str, float] | None
    clump_rate: float | None = stated("clumps without stops (Vanmarcke)", "1/s")
    first_hit_rate: Estimate | None = stated("first impacts without stops", "1/s")
    energy_unit: str = "J"

    def rayleigh(self, speed: ArrayLike) -> Vector:
        """Rayleigh's density with the mean square seen, s/m: that of elastic stops."""
        if self.speed_rms is None:
            raise ValueError("no impact was seen: no distribution of speeds can be fitted")
        square = self.speed_rms.value**2 / 2.0
        w = np.asarray(speed, dtype=float)
        return np.asarray(w / square * np.exp(-(w**2) / (2.0 * square)))


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class ImpactStatistics(Result):
    """Statistics of the impacts of every impact pair of a scene.

    `step` (s) is that of the motion, within which impacts are found. `duration` (s) is that of a
    path. `window` (s) is the time in which impacts are counted for the dispersion. `each` is always
    True: impacts are seen one by one, however close they are.

    See Also
    --------
    stochvi.impacts : The calculation.
    """

    kind = "impacts"
    in_document: ClassVar = {"impact_pairs": "pairs"}

    pairs: Mapping[str, PairStatistics]
    duration: float
    window: float
    step: float
    each: bool = True
    assumptions: Sequence[str] = ()

    @property
    def quantities(self) -> Mapping[str, Any]:
        """The fields of each pair, and its rates as a `Response` names them."""
        return {name: Named({**vars(pair), **_rates(pair)}) for name, pair in self.pairs.items()}

    def to_frame(self) -> DataFrame:
        """A tidy table of all numbers: one row per pair and quantity."""
        columns = [
            "of",
            "quantity",
            "value",
            "standard_error",
            "bias",
            "lower",
            "upper",
            "by",
            "unit",
        ]
        rows = (row for name, pair in self.pairs.items() for row in _rows(name, pair))
        return frame_of(rows).reindex(columns=columns)

    def histograms(self) -> DataFrame:
        """One row per pair, histogram ("speed" in m/s, "interval" in s) and bin."""
        return stacked(
            {
                "of": name,
                "histogram": kind,
                "low": found.edges[:-1],
                "high": found.edges[1:],
                "density": found.density,
                "standard_error": found.standard_error,
            }
            for name, pair in self.pairs.items()
            for kind, found in (("speed", pair.speeds), ("interval", pair.intervals))
            if found is not None
        )

    def summary(self) -> str:
        """How clustered the impacts are, in a sentence for each pair."""
        found = []
        for name, pair in self.pairs.items():
            spread = pair.dispersion
            if spread is None:
                seen = pair.speeds is not None
                few = "too few impacts were seen to judge whether they cluster"
                found.append(f"{name}: {few if seen else 'no impact was seen'}")
                continue
            low, high = (spread.value + side * 2.0 * spread.standard_error for side in (-1, 1))
            kind = "as scattered as Poisson's process"
            if low > 1.0 and spread.value > 1.0 + NOTABLE:
                kind = "in clusters: Poisson intervals would be too narrow by a factor of "
                kind += f"{math.sqrt(spread.value):.2g}"
            elif high < 1.0 and spread.value < 1.0 - NOTABLE:
                kind = "more regular than Poisson's process"
            found.append(
                f"{name}: impacts come {kind} (variance / mean of counts {spread.value:.3g} in "
                f"windows of {self.window:.3g} s)"
            )
        return "; ".join(found)


def _rates(pair: PairStatistics) -> dict[str, Estimate]:
    """Rates of impacts by the names that they have in a `Response`."""
    return {
        "collision_rate" + (f"_{side}" if side != "both" else ""): rate.estimate
        for side, rate in pair.rates.items()
    }


def _is_no_rate(stated: tuple[str, Stated]) -> bool:
    return stated[1].unit != "1/s"


def _rows(name: str, pair: PairStatistics) -> list[dict[str, Any]]:
    """Rows of `to_frame` for one pair."""
    rows: list[dict[str, Any]] = []

    def add(quantity: str, unit: str, estimate: Estimate | None, **more: Any) -> None:
        if estimate is not None:
            found: dict[str, Any] = {
                name: getattr(estimate, name) for name in ("value", "standard_error", "bias")
            }
            rows.append({"of": name, "quantity": quantity, "unit": unit, **found, **more})

    for side, each in pair.rates.items():
        bounds = {"lower": each.lower, "upper": each.upper}
        add(f"rate, {side}", "1/s", each.estimate, by=each.interval, **bounds)
        if pair.rice_rates is not None:
            add(f"Rice without stops, {side}", "1/s", Estimate(value=pair.rice_rates[side]))
    # rates stand together
    for field, known in sorted(quantities_of(PairStatistics).items(), key=_is_no_rate):
        found = getattr(pair, field)
        estimate = Estimate(value=found) if isinstance(found, float) else found
        add(known.words, known.unit.replace("J", pair.energy_unit), estimate)
    for side, exponent in pair.exponents.items():
        add(f"exponent of slow impacts, {side}", "1", exponent.fitted)
        if exponent.theory is not None:
            add(f"1 - beta by theory, {side}", "1", Estimate(value=exponent.theory))
    return rows


# ------------------------------------------------------------------------------
# Rates of impacts that linear theory predicts: Rice's, and with clumps (Vanmarcke).
# ------------------------------------------------------------------------------


CLUMPING = 1.2
"""Power of the bandwidth in E. H. Vanmarcke's rate (J. Appl. Mech. 42 (1975) 215)."""

NODES = 20_001
"""Number of nodes of the integral for the first moment of a spectrum."""


class LinearGap(NamedTuple):
    """Stationary gap of a pair without stops: mean, deviations of it and of its rate; `bandwidth`
    q = (1 - l1^2 / (l0 l2))^(1/2) of its spectrum, None where it is not computed; its noise and
    sines, None without sines."""

    mean: float
    displacement_std: float
    velocity_std: float
    bandwidth: float | None
    motion: MovingMean | None = None


def linear_gap(model: Model, pair: Pair) -> LinearGap | None:
    """None where noise and structure have no Gaussian stationary distribution, or a spring or a
    damper is a function."""
    if model.functions or model.level is not None or model.drawn:
        return None
    if model.sines:
        return _beside_sines(model, pair)
    if not model.tables:
        modes = replace(model, pairs=(pair,)).modal
        law = linear_law(modes)
        if law is None:
            return None
        gap, n = modes.gaps[0], modes.size
        x, v = (math.sqrt(law.variances(gap, first)) for first in (0, n))
        mean = float(gap @ (modes.rest + law.mean))
        single = model.rates is not None and not model.signals
        return LinearGap(mean, x, v, _white_bandwidth(model) if single else None)
    if model.signals or beyond_one_oscillator(model):
        return None
    omega, b = model.omega, model.damping_rate
    if omega == 0.0 or b == 0.0:
        return None
    tables = model.acceleration_tables
    moments, theta = response_moments(tables, omega, b), model.intensity / (2.0 * b)
    x2, v2 = moments.displacement + theta / omega**2, moments.velocity + theta
    bandwidth = None
    if theta == 0.0:
        first = sum(_first_moment(table, omega, b) for table in tables)
        bandwidth = math.sqrt(max(1.0 - first**2 / (x2 * v2), 0.0))
    return LinearGap(model.rest, math.sqrt(x2), math.sqrt(v2), bandwidth)


def _beside_sines(model: Model, pair: Pair) -> LinearGap | None:
    try:
        free = free_motion(model, with_sines=True)
    except NotApplicable:
        return None
    (motion,) = free.moving_means(pair.direction[None])
    if not motion.place:
        return None
    mean = float(pair.direction @ model.modal.shapes @ model.modal.rest)
    return LinearGap(mean, *motion.deviations, None, motion)


def _white_bandwidth(model: Model) -> float | None:
    """q of an oscillator under white noise, in closed form below critical damping."""
    zeta = model.damping_rate / (2.0 * model.omega) if model.omega else math.inf
    if not 0.0 < zeta < 1.0:
        return None
    root = math.sqrt(1.0 - zeta**2)
    shape = (1.0 - 2.0 / math.pi * math.atan(zeta / root)) / root
    return math.sqrt(1.0 - shape**2)


def _first_moment(table: Table, omega: float, damping_rate: float) -> float:
    """Integral of w |H|^2 G df over a table."""
    low, high = float(table.frequency_hz[0]), float(table.frequency_hz[-1])
    f = np.geomspace(low, high, NODES)
    density = 2.0 * np.pi * f * squared_gain(f, omega, damping_rate) * table(f)
    return float(np.trapezoid(density, f))


def rice_rates(gap: LinearGap, pair: Pair) -> dict[str, float]:
    """Rice's rate of crossings of each stop, 1/s, as if impacts changed nothing, and their sum
    under "both"."""
    motion = gap.motion or MovingMean.still(gap.displacement_std, gap.velocity_std)
    found = {stop.name: motion.rate(stop.side * (stop.position - gap.mean)) for stop in pair.stops}
    return found | {"both": sum(found.values())}


def vanmarcke_rate(gap: LinearGap, pair: Pair) -> float | None:
    """Rate of clumps of crossings, 1/s, of one stop or of two evenly about the mean.

    nu [1 - exp(-(pi / 2)^(1/2) q^1.2 r)] / [1 - exp(-r^2 / 2)] at r deviations for |x|, nu Rice's
    rate of both; for one stop (2 pi)^(1/2) stands for (pi / 2)^(1/2) and the share of time within
    it for the denominator (Vanmarcke 1975).

    >>> from stochvi.model.model import Stop
    >>> from stochvi.scenes.impact_laws import Restitution
    >>> gap = LinearGap(0.0, 1.0, 1.0, 0.2456120698613)
    >>> stops = [Stop(side, 2.0 * side, Restitution(coefficient=1.0)) for side in (-1, 1)]
    >>> two = Pair("", np.ones(1), 1.0, False, tuple(stops))
    >>> round(vanmarcke_rate(gap, two) / rice_rates(gap, two)["both"], 4)
    0.43
    """
    if gap.bandwidth is None:
        return None
    positions = [stop.position - gap.mean for stop in pair.stops]
    levels = [abs(position) / gap.displacement_std for position in positions]
    width, nu = gap.bandwidth**CLUMPING, rice_rates(gap, pair)["both"]
    if len(levels) == 1:
        if positions[0] * pair.stops[0].side <= 0.0:  # the stop lies beyond the mean position
            return None
        share = -math.expm1(-math.sqrt(2.0 * math.pi) * width * levels[0])
        return nu * share / float(ndtr(levels[0]))
    if abs(levels[0] - levels[1]) > 1e-9 * max(levels) or positions[0] * positions[1] >= 0.0:
        return None
    share = -math.expm1(-math.sqrt(math.pi / 2.0) * width * levels[0])
    return nu * share / -math.expm1(-0.5 * levels[0] ** 2)


# ------------------------------------------------------------------------------
# Statistics of impacts by Monte Carlo, from every impact of independent paths.
#
# Slow impacts on a stop of restitution R under white noise have speeds of density w^(1 - beta),
# where `impact_rates.corner_exponent` gives beta from R; Rayleigh's distribution at R = 1 has beta
# = 0. They come in clusters, and so do impacts of a light resonance: counts scatter more than
# Poisson's, and an interval from their number alone is too narrow. Intervals come from independent
# paths, therefore, unless the dispersion of the counts allows Poisson's exact ones.
# ------------------------------------------------------------------------------


SLOWEST_SHARE, FASTEST_SHARE = 0.01, 10.0
"""Slowest and fastest speed of a histogram, in rms speeds; it begins at the threshold if that is
faster."""

SHORTEST_ANGLE = 0.03
"""Shortest interval of a histogram, times the largest frequency of the motion, rad: a hundredth of
the usual time between impacts on two stops."""

LONGEST_SHARE = 0.8
"""Longest interval of a histogram, in durations of a path. One of that length is seen once in five
times; the weight that makes up for it doubles the error of the last bin."""

UNSEEN_INTERVALS = 0.05
"""Share of the times between impacts beyond a histogram from which on a warning states it."""

FIT_FROM, FIT_RANGE = 0.02, 6.0
"""Exponents are fitted to impacts from the threshold, or `FIT_FROM` rms speeds if that is faster.
The range ends at `FIT_RANGE` times that speed; a second fit ends at half of it."""

CORNER_SHARE = 0.06
"""Length of a step near a stop, where slow impacts are resolved. Its unit is the time in which
noise changes the speed of a slow mass. The share is the same at any speed, so steps shift the
exponent itself of the distribution of slow speeds. With a stop in the rest position, a share of
0.25 shifts it by +0.09 at R = 0.5 and +0.13 at 0.3; this share by +0.001(7) and +0.024(10)."""

SHIFT_PER_SHARE = 0.57
"""Shift of an exponent over the share of `CORNER_SHARE`, as measured at R = 0.3 and a share of
0.25; at smaller shares and larger R the shift is smaller, so that this number times the share
bounds it."""

SHIFT_KNOWN_FROM = 0.3
"""Smallest restitution at which that shift was measured."""

RESOLVED_EXPONENT = 0.8
"""Restitution from which on an exponent is free of the steps near a stop even at a share of 0.25:
it is shifted by less than 0.01."""

FEWEST_FITTED = 100
"""Smallest number of impacts in the shorter range of speeds from which an exponent is fitted."""

FEWEST_PATHS = 64
"""Smallest number of paths from which a standard error can be trusted."""

FEWEST_HITS = 30
"""Smallest number of impacts from which a dispersion is given; fewer cannot tell other counts from
Poisson's."""

REL_ERROR = 0.02
"""Relative standard error of the rates where neither an error nor a number of paths is asked
for."""

FOR_FIRST_HITS = 0.3
"""Share of the time that is kept for the rate of first impacts, if wanted."""

NO_FIRST_HITS = "no time was left for the rate of first impacts; raise budget"
"""Note where the deadline passed before the rate of first impacts was found."""

MOST_UNSEEN = 2**17
"""Number of paths without any impact after which the search for one ends, even if there is time
left."""


@calculation
@sampled
def impacts(
    scene: Scene,
    *,
    speed_threshold: float | None = None,
    slow_impacts: bool = False,
    first_hits: bool = False,
    **options: Unpack[SamplingOptions],
) -> ImpactStatistics:
    """Rates, intervals, speeds, energy and clusters of the impacts of every pair.

    Parameters
    ----------
    scene
        Any scene with an impact pair that `simulate` covers.
    speed_threshold
        Slowest impacts that count, m/s; by default 0, or 5 % of the rms speed where stops lose
        energy.
    slow_impacts
        Resolve impacts down to the threshold at inelastic stops, as in `simulate`.
    first_hits
        Simulate first crossings, too, for the rate of first impacts without stops (one oscillator
        under Gaussian noise, a pair about its mean).
    **options
        `SamplingOptions`: `rel_error` of every pair's rate, by default 0.02, or the number of
        `paths` and their counted `duration`, in eight windows for the dispersion; `seed`,
        `threads`, `executor`, `budget`, `progress`, `checkpoint`, `resume`. A pair that is never
        hit while others are does not count for the error.

    Returns
    -------
    ImpactStatistics
        Rates, densities and intervals of each pair.

    Raises
    ------
    NotApplicable
        If the scene has no impact pair, or is none that `simulate` covers.
    NotConverged
        If time ends first, or nothing is hit in `MOST_UNSEEN` paths; it carries the answer so far.
    ValueError
        If an argument is out of range.

    See Also
    --------
    stochvi.simulate : The same by Monte Carlo.
    stochvi.spectrum : Densities by frequency.

    Examples
    --------
    >>> from stochvi.scenes.impact_laws import Restitution
    >>> from stochvi.scenes.excitations import WhiteNoise
    >>> from stochvi.scenes.scene import ImpactPair
    >>> from stochvi.scenes.structures import Oscillator
    >>> scene = Scene(
    ...     structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
    ...     impact_pairs=[ImpactPair(lower=-1.0, upper=1.0, law=Restitution(coefficient=1.0))],
    ...     excitations=[WhiteNoise(intensity=0.2)],
    ... )
    >>> found = impacts(scene, paths=4096).pairs["stops"].rates["both"].estimate
    >>> abs(found.value - 0.2828) < 4.5 * found.standard_error + 1e-4
    True
    """
    check_threshold(speed_threshold)
    run = Run.of(options)
    asked = REL_ERROR if run.rel_error is None else run.rel_error
    deadline, paths, model = run.deadline, run.paths, model_of(scene)
    shares = {"corner_share": CORNER_SHARE} if lossiest(model) < RESOLVED_EXPONENT else {}
    plan = plan_impacts(
        scene, speed_threshold, run.duration, slow_impacts, deadline=deadline, **shares
    )
    sampler = ImpactSampler(plan, {pair.name: _grid(plan, pair) for pair in model.pairs}, run.seed)
    replace(plan, source=plan.source.shortest()).impacts(run.seed, 0, 2)
    check_price([plan.source], run.seed, deadline)
    sampling = deadline.sooner(FOR_FIRST_HITS) if first_hits else deadline

    def error_of(sample: list[Counted]) -> float:
        # equal counts on few paths are no error of zero
        few = sampler.paths(sample) < FEWEST_PATHS
        return math.inf if few else _largest_error([*joined(sample).fine.values()], plan)

    if paths is None:
        first = max(plan.block, FEWEST_PATHS)
        taken = run.to_accuracy(sampler, first, error_of, asked, MOST_UNSEEN, deadline=sampling)
    else:
        taken = run.until(sampler, paths, deadline=sampling)
    done, counted = taken.paths, joined(taken.sample)
    if done < 2:  # one path has no error
        raise sampling.fell_short("after one path", "raise budget")
    found = counted.fine
    twice = max((len(each.numbers) for each in counted.twice.values()), default=0)
    short = _fell_short(done, paths, _largest_error([*found.values()], plan), asked, sampling)
    late = deadline.passed()
    pairs = {
        pair.name: _pair(scene, pair, plan, sampler.grids[pair.name], counted)
        for pair in model.pairs
    }
    if first_hits and not late:
        pairs = {
            pair.name: replace(pairs[pair.name], first_hit_rate=_first_hits(scene, pair, run))
            for pair in model.pairs
        }
    answer = ImpactStatistics(
        pairs=pairs,
        duration=plan.duration,
        window=plan.duration / WINDOWS,
        step=plan.step,
        assumptions=scene.assumptions(),
        warnings=(
            *(["the accuracy asked for was not reached"] if short else []),
            *([NO_FIRST_HITS] if first_hits and late else []),
            *_unseen(pairs, done * plan.duration),
            *_long_intervals(pairs),
            *_warnings(plan, model),
            *_missed(model, pairs, slow_impacts),
            *listed_under_first(model),
        ),
        cost=run.cost(
            impacts=round(sum(tally.numbers.sum() for tally in found.values())),
            steps=round((done + 0.5 * twice) * plan.duration / plan.step),
            paths=done,
        ),
        provenance=provenance(scene.document(), run.seed),
    )
    if short:
        raise short(answer)
    return answer


def _reached(done: int, paths: int | None, error: float, asked: float) -> bool:
    """Whether the run has reached its number of paths, or its error. The counts of few paths may be
    equal by chance, which is no error of zero."""
    return done == paths if paths is not None else error <= asked and done >= FEWEST_PATHS


def _fell_short(
    done: int, paths: int | None, error: float, asked: float, deadline: Deadline
) -> Callable[[ImpactStatistics], BaseException] | None:
    """The error to raise with the answer, where the run ends before it has reached its paths or its
    accuracy. None where it has, or where more paths are to come."""
    if _reached(done, paths, error, asked):
        return None
    if paths is not None:
        return partial(deadline.fell_short, f"after {done} of {paths} paths", "raise budget")
    if (
        math.isinf(error)
        and not deadline.interrupted
        and (deadline.passed() or done >= MOST_UNSEEN)
    ):
        return partial(
            NotConverged,
            f"no impact was seen in {done} paths, so that no rate is known to {asked:g}; give "
            "paths and duration to look further, or ask reliability for the probability of an "
            "impact",
        )
    if deadline.passed():
        where = f"at a relative standard error of {error:.2g}, asked for {asked:g}"
        if done < FEWEST_PATHS:
            where = (
                f"after {done} paths, too few for a relative standard error of their rate, asked "
                f"for {asked:g}"
            )
        return partial(deadline.fell_short, where, "raise budget or rel_error")
    return None


@dataclass(frozen=True, eq=False)
class ImpactSampler(ListSampler):
    """Counts of the impacts of each path, for each pair."""

    plan: ImpactPlan
    grids: dict[str, Grid]
    seed: int

    @property
    def block(self) -> int:
        """Number of paths whose impacts are logged together."""
        return self.plan.block

    def simulate(self, first_path: int, paths: int) -> Counted:
        """The tallies of some paths; of some of them at twice the step as well."""
        fine = self._tallies(self.plan, first_path, paths)
        here: list[dict[str, Tally]] = []
        twice: list[dict[str, Tally]] = []
        for first, number in paths_at_both_steps(self.plan.source, first_path, paths):
            here.append({k: tally.rows(first - first_path, number) for k, tally in fine.items()})
            coarser = replace(self.plan, source=self.plan.source.coarser())
            twice.append(self._tallies(coarser, first, number))
        return Counted(fine, _together(here), _together(twice))

    def _tallies(self, plan: ImpactPlan, first_path: int, paths: int) -> dict[str, Tally]:
        logs = plan.impacts(self.seed, first_path, paths)
        return {name: Tally.of(log, paths, self.grids[name]) for name, log in logs.items()}

    def add_up(self, pieces: list[Counted]) -> list[Counted]:
        """The tallies of a block."""
        return [joined(pieces)]

    def paths(self, sample: list[Counted]) -> int:
        """Number of paths; all pairs have the same."""
        return sum(len(next(iter(each.fine.values())).numbers) for each in sample)


class Counted(NamedTuple):
    """Tallies of some paths by pair, and of those of them that were simulated at twice the step as
    well: at the step, and at twice the step."""

    fine: dict[str, Tally]
    here: dict[str, Tally]
    twice: dict[str, Tally]


def joined(parts: list[Counted]) -> Counted:
    """The tallies of all parts together, in their order."""
    return Counted(
        *(_together([each for each in kind if each]) for kind in zip(*parts, strict=True))
    )


def _together(parts: list[dict[str, Tally]]) -> dict[str, Tally]:
    return {name: merged([part[name] for part in parts]) for name in (parts[0] if parts else ())}


def _grid(plan: ImpactPlan, pair: Pair) -> Grid:
    rms, threshold = plan.speeds[pair.name], plan.thresholds[pair.name]
    slowest = max(threshold, SLOWEST_SHARE * rms)
    start = max(threshold, FIT_FROM * rms)
    longest = LONGEST_SHARE * plan.duration
    shortest = min(SHORTEST_ANGLE / plan.fastest, 0.1 * longest)
    return Grid(
        speeds=np.geomspace(slowest, FASTEST_SHARE * rms, BINS + 1),
        intervals=np.geomspace(shortest, longest, BINS + 1),
        fits=((start, start * FIT_RANGE), (start, start * FIT_RANGE / 2.0)),
        window=plan.duration / WINDOWS,
    )


def _largest_error(tallies: list[Tally], plan: ImpactPlan) -> float:
    """Relative standard error of the rates of the pairs that are hit; infinite if none is."""
    errors = []
    for tally in tallies:
        numbers = tally.numbers.sum(axis=1)
        if numbers.any():
            value, error = mean_and_error(numbers)
            errors.append(error / value)
    return max(errors, default=math.inf)


@dataclass(frozen=True)
class StepBias:
    """The bias that the step leaves in the sums of a pair, from paths that were simulated at twice
    the step as well; None where it is not known."""

    source: Plan
    here: Tally | None
    twice: Tally | None
    duration: float

    @property
    def how(self) -> str:
        """Paths that tell the bias, in words."""
        if self.source.elastic or self.twice is None:
            return ""
        return f"; {len(self.twice.numbers)} of them at twice the step as well"

    def of(self, name: str, sums: Callable[[Tally], Vector]) -> tuple[float | None, float]:
        """Bias of a sum (paths,) per second, and the standard error of it."""
        if self.source.elastic:
            return 0.0, 0.0
        if self.here is None or self.twice is None or len(self.here.numbers) < FEWEST_PAIRS:
            return None, 0.0
        change = (sums(self.twice) - sums(self.here)) / self.duration
        mean, error = mean_and_error(change)
        bias = self.source.step_bias(name, abs(mean))
        return bias, (0.0 if bias is None else self.source.step_bias(name, error) or 0.0)


def _pair(
    scene: Scene, pair: Pair, plan: ImpactPlan, grid: Grid, counted: Counted
) -> PairStatistics:
    """Statistics of the impacts of a pair from what its paths add up; the rate of first impacts
    needs other simulations."""
    tally = counted.fine[pair.name]
    step = StepBias(
        plan.source, counted.here.get(pair.name), counted.twice.get(pair.name), plan.duration
    )
    numbers = tally.numbers.sum(axis=1)
    hits = float(numbers.sum())
    how = f"{len(numbers)} paths of {plan.duration:.4g} s{step.how}"
    spread = dispersion(tally.windows, grid.window) if hits >= FEWEST_HITS else None
    if spread is not None and not plan.source.elastic:
        spread = replace(spread, bias=None)  # that of the step is not known
    poisson = passes_for_poisson(spread)
    cluster = plan.source.hits_in_a_cluster
    rates: dict[str, Rate] = {}
    for stop in pair.stops:
        column = int(stop.side == UPPER)
        bias = step.of(f"collision_rate_{stop.name}", partial(_on_stop, column))
        rates[stop.name] = rate(
            tally.numbers[:, column], plan.duration, poisson, how, cluster, *bias
        )
    bias = step.of("collision_rate", lambda one: one.numbers.sum(axis=1))
    clusters = len(pair.stops) * cluster
    rates["both"] = rate(numbers, plan.duration, poisson, how, clusters, *bias)
    of_squares = step.of("impact_speed_square_rate", lambda one: one.squares.sum(axis=1))
    relative = _relative_bias(of_squares[0], tally.squares, bias[0], tally.numbers, plan)
    of_losses = step.of("impact_speed_square_rate", lambda one: one.energies.sum(axis=1))
    of_loss = _relative_bias(of_losses[0], tally.energies, bias[0], tally.numbers, plan)
    gap = linear_gap(plan.source.model, pair)
    square = ratio_and_error(tally.squares.sum(axis=1), numbers) if hits else None
    whole = hits and not _rubs(pair)
    loss = ratio_and_error(tally.energies.sum(axis=1), numbers) if whole else None
    mass = pair.mass if scene.expanded.structure.knows_mass else 1.0
    blow = None if square is None else (mass / 2.0 * square[0], mass / 2.0 * square[1])
    return PairStatistics(
        speed_threshold=plan.thresholds[pair.name],
        rates=rates,
        dispersion=spread,
        speeds=histogram(tally.speeds, grid.speeds, tally.speeds.sum(axis=1)) if hits else None,
        intervals=histogram(tally.intervals, grid.intervals, numbers)
        if tally.intervals.any()
        else None,
        speed_rms=None if square is None else _root(square, how, relative),
        exponents=_exponents(pair, tally, grid, plan),
        energy=_ratio(loss, how, of_loss),
        striking_energy=_ratio(blow, how, relative),
        rice_rates=None if gap is None else rice_rates(gap, pair),
        clump_rate=None if gap is None else vanmarcke_rate(gap, pair),
        first_hit_rate=None,
        energy_unit="J" if scene.expanded.structure.knows_mass else "J/kg",
    )


def _on_stop(column: int, tally: Tally) -> Vector:
    """Numbers of impacts on one stop, by path."""
    return tally.numbers[:, column]


def _relative_bias(
    squares: float | None, sums: Matrix, hits: float | None, numbers: Matrix, plan: ImpactPlan
) -> float | None:
    """Relative bias of a mean square speed from those of its sum per second and of the rate: they
    are added, as they may cancel in the difference to twice the step."""
    if squares is None or hits is None or not numbers.any():
        return None
    exposure = len(numbers) * plan.duration
    of_sums = squares / float(sums.sum()) if squares else 0.0
    return (of_sums + hits / float(numbers.sum())) * exposure


def _ratio(found: tuple[float, float] | None, how: str, relative: float | None) -> Estimate | None:
    if found is None:
        return None
    bias = None if relative is None else relative * found[0]
    return Estimate(value=found[0], standard_error=found[1], bias=bias, how=how)


def _root(square: tuple[float, float], how: str, relative: float | None) -> Estimate:
    value = math.sqrt(square[0])
    bias = None if relative is None else 0.5 * relative * value
    return Estimate(value=value, standard_error=square[1] / (2.0 * value), bias=bias, how=how)


def _exponents(pair: Pair, tally: Tally, grid: Grid, plan: ImpactPlan) -> dict[str, Exponent]:
    """The exponent of both stops together where they have the same restitution, else that of
    each."""
    restitutions = {stop.name: stop.law.slow_restitution for stop in pair.stops}
    if len(set(restitutions.values())) == 1:
        groups = {"both": (tally.fits.sum(axis=1), next(iter(restitutions.values())))}
    else:
        groups = {
            side: (tally.fits[:, 0 if side == "lower" else 1], r)
            for side, r in restitutions.items()
        }
    model = plan.source.model
    white = len(model.coordinates) == 1 and np.any(model.white) and model.rigid
    return {
        side: Exponent(
            fitted=_fitted(fits, grid, _shift(plan, r) if white else 0.0),
            theory=1.0 - corner_exponent(r) if white else None,
        )
        for side, (fits, r) in groups.items()
        if fits[:, 1, 0].sum() >= FEWEST_FITTED
    }


def _shift(plan: ImpactPlan, restitution: float) -> float | None:
    """Largest shift of an exponent by the steps near a stop; None where that is not known."""
    if restitution >= RESOLVED_EXPONENT:
        return 0.0
    share = plan.corner_share
    return None if share is None or restitution < SHIFT_KNOWN_FROM else SHIFT_PER_SHARE * share


def _fitted(fits: NDArray[np.float64], grid: Grid, shift: float | None) -> Estimate:
    found = fitted_exponent(fits, grid.fits)
    if found.bias is None or shift is None:
        return replace(found, bias=None)
    return replace(found, bias=found.bias + shift)


def _first_hits(scene: Scene, pair: Pair, run: Run) -> Estimate | None:
    """Limiting rate of first crossings of the stops without them, as far as it is known by the
    deadline; None where it does not apply."""
    gap = linear_gap(model_of(scene), pair)
    if gap is None:
        return None
    lower = None if pair.lower is None else gap.mean - pair.lower.position
    upper = None if pair.upper is None else pair.upper.position - gap.mean
    try:
        found = partial_result(
            first_crossings, scene, lower=lower, upper=upper, **run.options(progress=None)
        )
    except (NotApplicable, ValueError):  # a scene, or stops, that it does not cover
        return None
    chance = found.probability(found.horizon)[0]
    # where hardly any motion outlasts the memory there is no limiting rate to be seen
    hardly = (chance.bias or 0.0) >= 1.0 - chance.value
    return None if hardly else found.first_rate()[0]


def _unseen(pairs: dict[str, PairStatistics], exposure: float) -> list[str]:
    """Notes on stops that were never hit, or hardly ever, in the words of `simulate`."""
    few, unseen = list[str](), list[tuple[str, str]]()
    for name, pair in pairs.items():
        for side, found in pair.rates.items():
            if side == "both" or found.estimate.value != 0.0:
                continue
            if found.estimate.how.startswith(f"seen {TOO_FEW}"):
                few.append(
                    f"impacts on the {side} stop of {name} were seen {TOO_FEW}: its rate "
                    f"{LIMIT_ALONE}"
                )
            else:
                unseen.append((side, name))
    return [*few, *without_impact(unseen, exposure)]


def _long_intervals(pairs: dict[str, PairStatistics]) -> list[str]:
    """Notes on times between impacts that are too long for the paths."""
    return [
        f"{name}: {100.0 * found.outside:.2g} % of the times between impacts lie outside the bins "
        f"of their density, {found.edges[0]:.2g} to {found.edges[-1]:.3g} s; a longer duration "
        "shows longer ones"
        for name, pair in pairs.items()
        if (found := pair.intervals) is not None and found.outside > UNSEEN_INTERVALS
    ]


def _missed(model: Model, pairs: dict[str, PairStatistics], resolved: bool) -> list[str]:
    """A sentence where the step misses slow impacts, and twice the step does not tell how
    many: under white noise, whose motion has more of them the slower they are."""
    restitution = lossiest(model)
    known = all(pair.rates["both"].estimate.bias is not None for pair in pairs.values())
    if restitution >= RESOLVED_EXPONENT or not model.whites or known:
        return []
    unknown = "the intervals do not include the bias of the step, which is not known"
    if resolved:
        return [f"{unknown}: rates were up to 4 % too low at a restitution of 0.1"]
    remedy = (
        "; --slow-impacts (slow_impacts=True) resolves them" if refines_near_stops(model) else ""
    )
    return [
        f"{unknown}: it misses slow impacts at stops of a restitution of {restitution:.3g}. Where "
        f"the mass rests at a stop these are up to 14 % of all at 0.3 and 18 % at 0.2{remedy}"
    ]


def _rubs(pair: Pair) -> bool:
    """Whether a stop rubs: friction takes energy as well, which tallies of impacts leave out."""
    return any(stop.law.friction_coefficient for stop in pair.stops)


def _warnings(plan: ImpactPlan, model: Model) -> list[str]:
    found = []
    for pair in model.pairs:
        if _rubs(pair):
            found.append(
                f"{pair.name}: energy lost per impact is left out, as friction takes a part of it"
            )
        threshold = plan.thresholds[pair.name]
        if threshold > 0.0:
            found.append(f"{pair.name}: only impacts faster than {threshold:.3g} m/s count")
        if any(map(collapses, pair.stops)):
            found.append(
                f"{pair.name}: at a restitution up to {COLLAPSE_RESTITUTION:.4f} the rate of "
                "all impacts is infinite: all rates depend on the threshold"
            )
    return found


__all__ = ["Exponent", "Histogram", "ImpactStatistics", "PairStatistics", "Rate", "impacts"]
