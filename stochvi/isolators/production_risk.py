"""The risk of a production, whose units differ within their tolerances. Chapters: the answer; the
scene about which units vary; units by linear theory; units drawn where the risk is; the risk of
any impact, and the clearance that keeps it."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Any, ClassVar, NamedTuple, Unpack

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray
from scipy.special import logsumexp, ndtr, ndtri

from stochvi.isolators.screening import check_movable
from stochvi.isolators.sizing.answer import (
    Clearance,
    Question,
    RoundedClearance,
    Sizing,
    Target,
    places_in_words,
    sides_in_words,
)
from stochvi.isolators.sizing.pairs import check_names, nominal_sizing
from stochvi.isolators.sizing.risk_curve import CERTAIN, chance_of_stops
from stochvi.isolators.sizing.sensitivity import LEAST_SECONDS
from stochvi.isolators.tolerances import (
    CENTRE,
    PER_RESONANCE,
    Change,
    Changes,
    Region,
    Spread,
    Tolerances,
    all_applied,
    bands_beside,
    check_spreads,
    in_words,
    quantity_of,
    spreads_of,
)
from stochvi.mathematics.numerics import Matrix, Vector
from stochvi.mathematics.units import LENGTH, outside_of_share, spoken_mission
from stochvi.model.model import model_of
from stochvi.results.base import DataFrame, Result, frame_of
from stochvi.results.deadline import Deadline
from stochvi.results.errors import Interrupted, NotApplicable, NotConverged
from stochvi.results.estimates import (
    GAUSSIAN_95,
    Estimate,
    mean_and_error,
    provenance,
    spoken_percent,
    student_factor,
)
from stochvi.sampling.calculations import AccuracyOptions, calculation
from stochvi.sampling.run import Run, sampled
from stochvi.scenes.scene import Scene
from stochvi.scenes.structures.rigid_body import AXES
from stochvi.scenes.validation import mean_unit
from stochvi.statistics.crossings import own_distances
from stochvi.statistics.hazards import KNOWN

# ------------------------------------------------------------------------------
# The risk of a production, and the clearance that keeps it.
# ------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Production(Result):
    """The probability of any impact over a production, and what its tolerances cost.

    Parameters
    ----------
    scene
        The scene about which the units vary, as it was given.
    spreads
        The distribution of each quantity over the units.
    mission
        Seconds of exposure of each unit.
    target
        Probability of any impact in the mission that the production must keep; None for a question
        about the stops of the scene.
    clearances
        By pair, the clearance that keeps the target, m per side from the mean gap as stated, with
        its 95 % interval. The stops of the scene where there is no target.
    stated
        By pair, the clearance that keeps the target for every unit exactly as stated, m.
    probability
        Mean over the units of the probability of any impact in a mission, at these clearances.
    interval
        Its 95 % interval.
    probability_as_stated
        The same for a unit exactly as stated, at the same clearances.
    share_above
        Share of the units whose own probability is above the target; None without a target.
    correction
        Mean probability by simulated first crossings over that by linear theory, by which the
        latter was multiplied.
    units
        Quantiles over the units: `share_of_units`, and the `probability` of an impact that this
        share does not exceed. `clearance` is where such units would have the target themselves (m,
        the largest of the sized pairs).
    tolerances
        One row per spread quantity and per tolerance of `allowed`, `tolerance` in words. Where it
        is as its mean, or as stated, the production needs less by `clearance_cost` for the same
        mean risk: m, the largest of the sized pairs; NaN where the budget ended before.
        `first_order` and `total` are its shares of the variance of the clearance that a unit needs,
        with their standard errors `first_order_error` and `total_error`; NaN for `allowed`, in
        which units do not differ.
    simulated
        One row per unit that was simulated: its amounts, its probability by linear theory
        (`linear`), and by first crossings (`probability`, `standard_error`).
    allowed
        Tolerances that are no distribution; the units vary about the worst place within them.
    method
        How the numbers were found, in words.

    See Also
    --------
    stochvi.isolators.production : The calculation.
    """

    kind = "production"
    in_document: ClassVar = {"summary": "summary", "made": "made", "by": "method"}

    not_in_document = ("scene",)  # it is in the provenance

    scene: Scene
    spreads: Mapping[str, Spread]
    mission: float
    target: float | None
    clearances: Mapping[str, Clearance]
    stated: Mapping[str, float]
    probability: Estimate
    interval: tuple[float, float]
    probability_as_stated: float
    share_above: Estimate | None
    correction: Estimate
    units: DataFrame
    tolerances: DataFrame
    simulated: DataFrame
    method: str
    allowed: Tolerances = field(default_factory=Tolerances)

    @property
    def made(self) -> dict[str, RoundedClearance]:
        """The clearance to make of each pair: the calculated one, rounded up."""
        return {name: RoundedClearance.of(each.value) for name, each in self.clearances.items()}

    def summary(self) -> str:
        """The clearance to make, or the risk of the production, in one sentence."""
        mission = spoken_mission(self.mission)
        over = f"over the production ({in_words(self.spreads)}"
        over += f"; {self.allowed.in_words()})" if self.allowed != Tolerances() else ")"
        if self.target is None:
            low, high = map(spoken_percent, self.interval)
            return (
                f"an impact in {mission} {over}: {spoken_percent(self.probability.value)} likely "
                f"({low} to {high}, 95 %)"
            )
        made = self.made
        places = (
            places_in_words(made, self.clearances)
            if len(made) > 1
            else str(next(iter(made.values())))
        )
        return (
            f"Make {places} {sides_in_words(self.scene, made)}. An impact in {mission}: less than "
            f"{spoken_percent(self.target)} likely {over}."
        )

    def dearest(self) -> str:
        """The tolerance that costs the most clearance, in a sentence; empty where none costs any:
        there are none, nearly every unit is hit, or the cost of one is not known."""
        if not len(self.tolerances) or not np.max(self.tolerances["clearance_cost"]) > 0.0:
            return ""
        row = self.tolerances.iloc[int(self.tolerances["clearance_cost"].argmax())]
        cost = f"{row['tolerance']} costs the most clearance: "
        cost += LENGTH.text(row["clearance_cost"], ".3g")
        if math.isnan(row["total"]):
            return cost
        return f"{cost}, and {100.0 * row['total']:.3g} % of the variance between units"

    def to_frame(self) -> DataFrame:
        """The tolerances, and the clearance that each costs."""
        return self.tolerances


# ------------------------------------------------------------------------------
# The scene about which the units of a production vary, its stops and its risk.
# ------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class Start:
    """The scene as stated.

    Its stops are (2, pairs) m from the mean gaps, infinite for none, with the probability of an
    impact there. Pairs are named by their numbers: those whose stops may be moved to keep a target,
    and those with one clearance in common."""

    scene: Scene
    mission: float
    stops: Matrix
    chance: float
    target: float | None = None
    sized: Sequence[int] = ()
    common: Sequence[int] = ()

    @classmethod
    def of_scene(cls, scene: Scene, mission: float, pair: str | None, run: Run) -> Start:
        """The stops of the scene, or those of one of its pairs."""
        model = model_of(scene)
        if not model.pairs:
            raise NotApplicable(
                "production", "the scene needs an impact_pair, or the question a probability"
            )
        stops = np.array(own_distances(model))
        if pair is not None:
            stops[:, [each.name != pair for each in model.pairs]] = math.inf
        if stops.min() <= 0.0:
            raise NotApplicable(
                "production", "mean gaps must lie between the stops; move the stops outwards"
            )
        chance = chance_of_stops(scene, stops, mission, run).value
        return cls(scene=scene, mission=mission, stops=stops, chance=chance)

    @classmethod
    def of_target(
        cls, scene: Scene, target: Target, mission: float, pair: str | None, run: Run
    ) -> Start:
        """The stops that keep a probability of any impact; no impact is simulated."""
        asked = Question(
            target=target, mission=mission, run=run, pair=pair, tolerances=Tolerances(),
            impacts=False,
        )  # fmt: skip
        return cls.of_sizing(nominal_sizing(scene, asked))

    @classmethod
    def of_sizing(cls, found: Sizing) -> Start:
        """The clearances of a sizing for a probability of any impact."""
        if found.target.name != "probability":
            raise NotApplicable(
                "production",
                f"the target must be a probability of any impact, got {found.target.name}; give "
                "tolerances without a distribution for it",
            )
        names = [each.name for each in model_of(found.scene).pairs]
        return cls(
            scene=found.scene, mission=found.mission, stops=found.stops,
            chance=found.any_hit or found.target.value, target=found.target.value,
            sized=found.sized_pairs, common=[names.index(each) for each in found.common],
        )  # fmt: skip

    @property
    def names(self) -> list[str]:
        """Names of the pairs; that of its coordinate for a mass without one."""
        model = model_of(self.scene)
        return [each.name for each in model.pairs] or list(model.coordinates)


# ------------------------------------------------------------------------------
# Units of a production: how each moves and where its stops are, and its risk by linear theory.
#
# A unit is a row of amounts, one for each quantity that varies. Its gaps are Gaussian, with the
# rms, the rate and the mean that `Region.gaps` finds on a grid of mounts; level and clearances need
# no new solution. The risk of a unit is that of the scene as stated, times the ratio of Rice's
# rates of all of their stops.
# ------------------------------------------------------------------------------


CENTRES = tuple(f"{CENTRE}{axis}" for axis in AXES)
"""Names of the amounts by which a centre of mass is off."""

NODES, MOST_NODES = 7, 121
"""Smallest and largest number of amounts of a quantity at which the linear motion is solved."""

RARE = 1e-6
"""Share of the units at either end whose motion is taken from the end of the grid, at most."""

MOVING = ("frequency", "damping", *CENTRES)
"""Names of the amounts that change how the gaps of a unit move, beyond their size."""

LEAST_DAMPING = 1e-3
"""Damping over that stated below which the motion of a unit is taken from there."""

LOG_STEP = 0.4
"""Largest step of the logarithm of a damping ratio from one node to the next."""

STILL = 1e-300
"""rms and rate that take the place of 0, of which a logarithm is taken."""

NEPERS_PER_DB = math.log(10.0) / 20.0
"""Logarithm of the factor on an rms by one decibel."""

FARTHEST = 1e3
"""Largest distance of a stop in standard deviations; none farther is ever crossed."""


class UnitGaps(NamedTuple):
    """The gaps of many units.

    rms (m) and crossings per second of the mean are (units, pairs) each. `farther` is how much
    farther each stop is from the mean gap than stated, (units, 2, pairs), m.
    """

    sigma: Matrix
    rate: Matrix
    farther: Vector

    def rice(self, stops: Vector) -> Vector:
        """(units,): crossings per second of all stops (Rice), at distances from the stated mean gap
        of (2, pairs), or of (units, 2, pairs), m. A stop that presses is crossed as the mean is."""
        distance = np.maximum(stops + self.farther, 0.0)
        level = np.minimum(distance, FARTHEST * self.sigma[:, None, :]) / self.sigma[:, None, :]
        return np.asarray(np.sum(self.rate[:, None, :] * np.exp(-0.5 * level**2), axis=(1, 2)))

    def nearest(self, stops: Vector) -> NDArray[np.int64]:
        """(units,): number of the stop that is nearest in standard deviations."""
        level = (stops + self.farther) / self.sigma[:, None, :]
        return np.asarray(np.argmin(level.reshape(len(level), -1), axis=1))


@dataclass(frozen=True, kw_only=True)
class Units:
    """The units of a production.

    Parameters
    ----------
    scene
        The scene about which the units vary.
    spreads
        The distribution of each quantity.
    mean
        (pairs,): the mean gaps from which the distances of the stops are measured, m.
    stops
        (2, pairs): distances of the stops as stated, m, infinite for none.
    rare
        Share of the units at either end whose motion is taken from the end of the grid.
    """

    scene: Scene
    spreads: Mapping[str, Spread]
    mean: Vector
    stops: Matrix
    rare: float = RARE
    surfaces: list[tuple[list[str], scipy.interpolate.RegularGridInterpolator]] = field(
        default_factory=list
    )

    @cached_property
    def columns(self) -> list[tuple[str, str]]:
        """The tolerance and the name of each amount of a unit. The clearance of each stop and the
        centre of mass along each axis are amounts of their own."""
        found = []
        for name in self.spreads:
            match name:
                case "centre":
                    own = list(CENTRES)
                case "clearance":
                    own = [each for each in self.places if each not in self.spreads]
                case _:
                    own = [name]
            found += [(name, each) for each in own]
        return found

    @cached_property
    def places(self) -> dict[str, tuple[int, int]]:
        """Row and column of the stop to which each amount of a clearance belongs, by its name."""
        model = model_of(self.scene)
        names = [pair.name for pair in model.pairs] or list(model.coordinates)
        return {
            f"clearance {side} {name}": (row, column)
            for column, name in enumerate(names)
            for row, side in enumerate(("lower", "upper"))
            if math.isfinite(self.stops[row, column])
        }

    def drawn(self, points: Matrix) -> Matrix:
        """Amounts (units, columns) at points of the unit cube."""
        return np.stack(
            [
                self.spreads[tolerance].distribution(tolerance).ppf(points[:, k])
                for k, (tolerance, _) in enumerate(self.columns)
            ],
            axis=1,
        )

    def changes(self, amounts: Vector) -> list[Change]:
        """The changes of mount, level and laws of one unit."""
        return [
            Change(name, float(amount))
            for (tolerance, name), amount in zip(self.columns, amounts, strict=True)
            if quantity_of(tolerance) != "clearance"
        ]

    def unit(self, amounts: Vector) -> Scene:
        """The scene of one unit, its stops not moved; nothing in it differs between units."""
        return all_applied(self.changes(amounts), mean_unit(self.scene))

    def built(self, amounts: Vector) -> Scene:
        """The scene of one unit with its stops where they are, each off by its own amount."""
        off = np.zeros(self.stops.shape)
        for (tolerance, name), amount in zip(self.columns, amounts, strict=True):
            if quantity_of(tolerance) == "clearance":
                off[self.places[name]] = amount
        whole = self.unit(amounts).expanded
        pairs = [
            pair.model_copy(
                update={
                    "lower": None if pair.lower is None else pair.lower - float(below),
                    "upper": None if pair.upper is None else pair.upper + float(above),
                }
            )
            for pair, below, above in zip(whole.impact_pairs, off[0], off[1], strict=True)
        ]
        return whole.model_copy(update={"impact_pairs": tuple(pairs)})

    def gaps(self, amounts: Matrix) -> UnitGaps:
        """The gaps of units, from their amounts (units, columns)."""
        names = [name for _, name in self.columns]
        motion = np.broadcast_to(self._stated, (len(amounts), self._stated.size))
        for group, surface in self.surfaces:
            places = np.column_stack(
                [_place(name, amounts[:, names.index(name)]) for name in group]
            )
            ends = [(grid[0], grid[-1]) for grid in surface.grid]
            motion = motion + surface(np.clip(places, *np.transpose(ends))) - self._stated
        log_sigma, log_rate, mean = np.split(motion, 3, axis=1)
        farther = np.stack([mean - self.mean, self.mean - mean], axis=1)
        for k, (tolerance, name) in enumerate(self.columns):
            if tolerance == "level":
                log_sigma = log_sigma + amounts[:, k, None] * NEPERS_PER_DB
            elif quantity_of(tolerance) == "clearance":
                side, pair = self.places[name]
                farther[:, side, pair] += amounts[:, k]
        return UnitGaps(np.exp(log_sigma), np.exp(log_rate), farther)

    @cached_property
    def _region(self) -> Region:
        return Region(self.scene, Tolerances())

    @cached_property
    def _stated(self) -> Vector:
        return self._motion(())

    def _motion(self, changes: Sequence[Change]) -> Vector:
        """Logarithms of rms and rate, and mean, of all gaps in a row."""
        gaps = self._region.gaps(changes)
        self._region.models.clear()  # of centres of mass, which are many
        logs = [np.log(np.maximum(each, STILL)) for each in (gaps.sigma, gaps.rate)]
        return np.concatenate([*logs, gaps.mean])

    def solve(self, deadline: Deadline) -> None:
        """Solve the linear motion on a grid of mounts, and on one of centres of mass. Between their
        places it is interpolated; the logarithms of both effects add up."""
        for group in (("frequency", "damping"), CENTRES):
            own = [name for _, name in self.columns if name in group]
            if not own:
                continue
            grids = [self._grid(name) for name in own]
            values = list[Vector]()
            for place in itertools.product(*grids):
                if deadline.passed():
                    raise deadline.fell_short(
                        f"after the motion of {len(values)} mounts was solved", "raise budget"
                    )
                values.append(self._motion(list(map(Change, own, place))))
            shape = (*map(len, grids), self._stated.size)
            places = [_place(name, grid) for name, grid in zip(own, grids, strict=True)]
            surface = scipy.interpolate.RegularGridInterpolator(
                places, np.reshape(values, shape), method="cubic"
            )
            self.surfaces.append((own, surface))

    def _grid(self, name: str) -> Vector:
        """Amounts of a quantity at which the motion is solved."""
        tolerance = "centre" if name in CENTRES else name
        low, high = (
            self.spreads[tolerance].distribution(tolerance).ppf([self.rare, 1.0 - self.rare])
        )
        nodes = NODES
        if name == "frequency":
            half_width = self._region.narrowest()
            nodes = math.ceil(PER_RESONANCE * (high - low) / half_width)
        nodes = min(max(nodes, NODES), MOST_NODES)
        if name == "damping":  # sigma^2 of a mount without much damping is as its inverse
            first, last = math.log(max(1.0 + low, LEAST_DAMPING)), math.log1p(high)
            nodes = max(nodes, math.ceil((last - first) / LOG_STEP) + 1)
            return np.asarray(np.expm1(np.linspace(first, last, nodes)))
        return np.linspace(low, high, nodes)


def _place(name: str, amounts: Vector) -> Vector:
    """Amounts as the coordinate in which the motion is interpolated."""
    return np.log(np.maximum(1.0 + amounts, LEAST_DAMPING)) if name == "damping" else amounts


# ------------------------------------------------------------------------------
# Points of units that are drawn more often where their risk is, each with its weight.
#
# A rare mean is that of a few units: of 4096 units of even probability two may carry a mean of
# 1e-4. So a share of the units is drawn from Gaussian distributions of their normal scores. The
# scores are the points of the unit cube as quantiles of a normal distribution. Each stop that most
# units with a risk hit has one such distribution. The distributions are fitted in rounds
# (cross-entropy method): each draws from the last, with the risk to a power that rises to 1, so
# that no round hangs on a few units. Weights are those of the mixture with the units of even
# probability (balance heuristic), which keeps them bounded.
#
# References
# ----------
# .. [1] R. Y. Rubinstein and D. P. Kroese, The Cross-Entropy Method, Springer (2004), chapter 3.
# .. [2] A. Owen and Y. Zhou, Safe and effective importance sampling, J. Am. Stat. Assoc. 95,
# 135-143
#    (2000).
# ------------------------------------------------------------------------------


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
    return float(scipy.optimize.brentq(excess, 1e-6, 1.0, xtol=1e-4))


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


# ------------------------------------------------------------------------------
# The risk of any impact over a production, and the clearance that keeps it.
#
# Each unit has its probability of an impact by linear theory (`Units`), and Sobol' points give the
# mean over all units. Where few of them carry that mean, as many more are drawn where the risk is
# (`fitted`). The theory leaves out that impacts of another mount cluster otherwise. Units that need
# little, a usual and much clearance are simulated, and what they are off by is interpolated over
# that need. Then a few units are drawn in proportion to their risk, and simulated. The mean of
# their true probability over the one so far is the factor by which the whole mean is off
# (importance sampling).
# ------------------------------------------------------------------------------


POINTS = 256
"""Points of a Sobol' sequence; each gives the amounts of two units."""

SEQUENCES, MOST_SEQUENCES = 8, 32
"""Sequences, each scrambled for itself, from whose scatter the error of the quadrature follows:
their number at first, and at most."""

CARRIED = 0.1
"""Share of the units of even probability that must count, as (sum p)^2 / sum p^2, so that none are
drawn where the risk is."""

ROUNDS = 12
"""Largest number of rounds in which the distributions of such units are fitted."""

SETTLED = 0.05
"""Largest change of the logarithm of the risk in the last round."""

LEAST_EFFECTIVE = 100.0
"""Effective number of units below which the error of their mean is at least its inverse root."""

PROBES = (0.02, 0.5, 0.98)
"""Shares of the units that need less than those by which the theory is corrected unit by unit. In
the middle of the risk there is one more."""

SURE_HITS = 1e3
"""Impacts by linear theory beyond which a unit is not simulated: even those of a mount that rings
for hundreds of periods make several clusters."""

QUADRATURE_SHARE = 0.5
"""Error of the quadrature over that asked for, above which the sequences are doubled."""

SIMULATED, FEWEST_SIMULATED = 12, 4
"""Units that are simulated, and the smallest number from which a standard error can be found."""

UNIT_ERROR = 2.0
"""Relative error of the probability of a simulated unit, over that asked for: the mean of all has
less."""

SHARE_OF_NOMINAL, SHARE_OF_QUADRATURE = 0.4, 0.3
"""Share of the budget for the scene as stated, and share of the rest for the quadrature."""

RINGING = 1e3
"""The shift from which units with a risk are first drawn where no shift keeps the target yet: only
those of a mount with ten times the rms have any."""

FARTHEST_SHIFT = 1e5
"""Largest shift of the logarithm of a risk in the search for a clearance."""

HALVINGS = 60
"""Halvings of that interval in the search for the clearance of each unit."""

QUANTILES = (0.01, 0.05, *np.linspace(0.1, 0.9, 9).tolist(), 0.95, 0.99, 0.999)
"""Shares of the units whose risk is listed."""

MISSED = 1.3
"""Error of the answer over that asked for, above which a warning states it."""

METHOD = (
    "mean over units by Sobol' points, where few carry it of units that are drawn where the risk "
    "is; each unit by Rice's rate of its linear motion, corrected by first crossings of some units "
    "and of those that were drawn in proportion to their risk; no impact law enters"
)

UNFELT = ("stiffness", "restitution")
"""Quantities of stops on which the probability of any impact does not depend."""


@calculation
@sampled(rel_error=0.05)
def production(
    scene: Scene,
    spreads: Mapping[str, Spread] | None = None,
    *,
    mission: float = 3600.0,
    probability: float | None = None,
    pair: str | None = None,
    tolerances: Tolerances | None = None,
    **options: Unpack[AccuracyOptions],
) -> Production:
    """Probability of any impact over a production, and the clearance that keeps a target.

    Mount, level and stops of each unit are drawn once, by

        P = E[P_unit],    P_unit = 1 - exp(-H nu_unit / nu)

    nu is Rice's rate of crossings of all stops, and H = -ln(1 - P) of the scene as stated. First
    crossings of units in proportion to their risk correct the mean, see `Production.correction`.

    Parameters
    ----------
    scene
        A linear scene under stationary Gaussian noise, as for `size`.
    spreads
        Distribution of each quantity that varies between units: "frequency", "damping", "level",
        "centre", and "clearance" of each stop. The probability of any impact does not depend on
        "stiffness" and "restitution" of the stops, which are left out. By default what the scene
        states (`stochvi.BetweenUnits`).
    mission
        Seconds of exposure of each unit, from a stationary start.
    probability
        The target of the mean over the units. Without it, the stops stay where the scene has them.
    pair
        The one of several pairs whose clearance is searched for, as for `size`; without a target
        the pair whose impacts count.
    tolerances
        Tolerances that are no distribution; the units vary about the place within them where the
        risk is largest by linear theory. By default those that the scene states.
    **options
        `AccuracyOptions`: `rel_error` is that of the mean probability, by default 0.05.

    Returns
    -------
    Production
        The clearances with their intervals, the mean and the spread of the risk, and the clearance
        that each tolerance costs.

    Raises
    ------
    NotApplicable
        If the scene is not covered, or the scene as stated is hit at once.
    NotConverged
        If the budget ends before the units are known.

    See Also
    --------
    stochvi.size : The clearance of a unit as stated, or the worst within tolerances.

    Examples
    --------
    >>> from stochvi.isolators import Spread
    >>> from stochvi.scenes.excitations import WhiteNoise
    >>> from stochvi.scenes.structures import Isolator
    >>> scene = Scene(
    ...     structure=Isolator(frequency_hz=10.0, zeta=0.05),
    ...     excitations=[WhiteNoise(density=0.01, unit="g2/Hz")],
    ... )
    >>> found = production(scene, {"frequency": Spread(std=0.03)}, probability=0.01)
    >>> found.clearances["x"].value > found.stated["x"]
    True
    """
    if not 0.0 < mission < math.inf:
        raise ValueError(f"mission must be a positive number of seconds, got {mission}")
    if probability is not None:
        check_movable(scene)
        if not 0.0 < probability <= CERTAIN:
            raise outside_of_share("probability", f"in (0, {CERTAIN:g}]", probability)
    if conditions := unmet(scene):
        raise NotApplicable("production", conditions)
    spreads = spreads_of(scene) if spreads is None else spreads
    check_spreads(scene, spreads)
    check_names(scene, "pair", [pair] if pair is not None else [])
    run = Run.of(options)
    first = run.part(0.0, 0.4, "as stated", run.deadline.share(SHARE_OF_NOMINAL))
    if probability is None:
        start = Start.of_scene(scene, mission, pair, first)
    else:
        target = Target(name="probability", value=probability, unit="1")
        start = Start.of_target(scene, target, mission, pair, first)
    return about(start, spreads, tolerances or bands_beside(scene, spreads), run.part(0.4, 1.0))


def unmet(scene: Scene) -> list[str]:
    """The conditions of the mean over units that a scene does not meet, in sentences."""
    if scene.phases:
        return ["the scene must have no phases; ask for each, as FILE.toml#PHASE"]
    if model_of(scene).sines:
        return [
            "excitation must be noise or constant, got a sine: the gaps of units are compared as "
            "Gaussian ones; give tolerances without a distribution, or take mean_over_units"
        ]
    return []


def about(
    start: Start, spreads: Mapping[str, Spread], tolerances: Tolerances, run: Run
) -> Production:
    """The production about a scene as stated."""
    if conditions := unmet(start.scene):
        raise NotApplicable("production", conditions)
    felt = {name: each for name, each in spreads.items() if quantity_of(name) not in UNFELT}
    if not felt:
        raise ValueError(
            'spreads must hold what varies between units, as {"frequency": Spread(std=0.03)}, got '
            f"{', '.join(spreads) or 'none'}"
        )
    return _Job(
        start=start, spreads=felt, tolerances=tolerances.felt(start.scene, by_hits=False), run=run
    ).answer()


@dataclass(kw_only=True)
class _Job:
    """The calculation of one production."""

    start: Start
    spreads: Mapping[str, Spread]
    tolerances: Tolerances
    run: Run

    def __post_init__(self) -> None:
        scene = self.start.scene
        self.nominal = Region(scene, self.tolerances)
        self.stated = self._one(self.nominal.nominal)
        self.worst: Changes = ()
        if self.tolerances != Tolerances():
            ((_, self.worst),) = self.nominal.worst(
                lambda gaps: self._one(gaps).rice(self.start.stops), self.run.deadline
            )
        base = all_applied(self.worst, scene)
        aim = self.start.chance if self.start.target is None else self.start.target
        self.units = Units(
            scene=base, spreads=self.spreads, mean=self.nominal.nominal.mean,
            stops=self.start.stops, rare=min(RARE, 1e-3 * aim),
        )  # fmt: skip
        hazard = -math.log1p(-min(self.start.chance, KNOWN))
        self.clusters = hazard / float(self.stated.rice(self.start.stops)[0])

    def _one(self, gaps: Any) -> UnitGaps:
        """The gaps of one unit."""
        shift = gaps.mean - self.nominal.nominal.mean
        return UnitGaps(gaps.sigma[None], gaps.rate[None], np.array([[shift, -shift]]))

    @property
    def moved(self) -> list[int]:
        """Numbers of the pairs whose stops may be moved: all of them without a target."""
        sized = self.start.target is not None
        return list(self.start.sized if sized else range(len(self.start.names)))

    def stops(self, shift: ArrayLike) -> Vector:
        """(..., 2, pairs): the stops at which the logarithm of the risk of each movable one is
        smaller by `shift` (...), by Rice's rate of the scene as stated."""
        sigma, found = self.stated.sigma[0], np.array(self.start.stops)
        found = np.broadcast_to(found, (*np.shape(shift), *found.shape)).copy()
        for k in self.moved:
            if sigma[k] > 0.0:
                square = found[..., k] ** 2 + 2.0 * sigma[k] ** 2 * np.asarray(shift)[..., None]
                found[..., k] = np.sqrt(np.maximum(square, 0.0))
        if self.start.common:
            shared = found[..., list(self.start.common)]
            most = np.where(np.isfinite(shared), shared, 0.0).max(axis=(-2, -1), keepdims=True)
            found[..., list(self.start.common)] = np.where(np.isfinite(shared), most, math.inf)
        return found

    def chances(self, gaps: UnitGaps, shift: ArrayLike, lift: ArrayLike = 0.0) -> Vector:
        """(units,): probability of any impact of each unit, with the stops moved by one shift, or
        by one for each unit; `lift` is the logarithm of what the theory leaves out."""
        hits = self.clusters * np.exp(lift) * gaps.rice(self.stops(shift))
        return np.asarray(-np.expm1(-hits))

    # --- the quadrature ---------------------------------------------------------------------

    def quadrature(self) -> None:
        """Draw the units: sequences of Sobol' points, until the error is small enough."""
        deadline = self.run.deadline.share(SHARE_OF_QUADRATURE)
        self.units.solve(self.run.deadline)
        self.sequences: list[_Sequence] = []
        self.parts: list[Gaussian] = []
        self.knots: tuple[Vector, Vector] | None = None
        self._draw(SEQUENCES)
        self._fit()
        while True:
            error = self._relative(self.placed(1.0))
            fine = error <= QUADRATURE_SHARE * self.run.accuracy
            if fine or deadline.passed() or len(self.sequences) >= MOST_SEQUENCES:
                return
            self._draw(2 * len(self.sequences))

    def _draw(self, number: int) -> None:
        """Have so many sequences, with units of the parts."""
        columns = len(self.units.columns)
        for each in range(number):
            random = np.random.default_rng([self.run.seed, each])
            even = scipy.stats.qmc.Sobol(2 * columns, seed=random).random(POINTS)
            pair = even[:, :columns], even[:, columns:]
            points = np.concatenate(pair)
            if self.parts:
                more = scipy.stats.qmc.Sobol(columns + 1, seed=random).random(2 * POINTS)
                points = np.concatenate([points, drawn_from(self.parts, more)])
            weight = weights_of(self.parts, points, 2 * POINTS, len(points) - 2 * POINTS)
            amounts = self.units.drawn(points)
            drawn = _Sequence(points, amounts, self._gaps(amounts), weight)
            self.sequences[each : each + 1] = [drawn]
        self._join()

    def _join(self) -> None:
        """All units that were drawn, in one."""
        each = self.sequences
        self.pool = UnitGaps(*map(np.concatenate, zip(*(s.gaps for s in each), strict=True)))
        self.amounts = np.concatenate([s.amounts for s in each])
        self.weight = np.concatenate([s.weight for s in each]) / len(each)
        self.lifts = self.lifted(self.pool)

    def _fit(self) -> None:
        """Fit the distributions from which units are drawn where the risk is, in rounds."""
        before = math.nan
        for _ in range(ROUNDS):
            shift = self._first_place()
            risk = self.chances(self.pool, shift)
            if not self.parts and effective_number(risk) > CARRIED * len(risk):
                return
            power = power_of(self.weight, risk)
            now = math.log(float(self.weight @ risk)) if self.start.target is None else shift
            if self.parts and power == 1.0 and abs(now - before) < SETTLED:
                return
            before = now
            points = np.concatenate([each.points for each in self.sequences])
            label = self.pool.nearest(self.stops(shift))
            self.parts = fitted(points, self.weight, risk**power, label)
            self._draw(len(self.sequences))

    def _first_place(self) -> float:
        """The shift so far. Until units are drawn where the risk is, one unit may weigh more than
        the target. The stops are then as far as they may be."""
        try:
            return self.placed(1.0)
        except NotApplicable:
            return RINGING

    def _means(self, shift: float) -> list[float]:
        """Mean probability of each sequence."""
        parts = self.weight * self.chances(self.pool, shift, self.lifts)
        return [
            float(each.sum()) for each in np.split(parts * len(self.sequences), len(self.sequences))
        ]

    def _relative(self, shift: float) -> float:
        """Relative error of the mean: by the scatter of the sequences, and by the number of units
        that carry it where that is small."""
        number = effective_number(self.weight * self.chances(self.pool, shift, self.lifts))
        few = 1.0 / math.sqrt(max(number, 1.0)) if number < LEAST_EFFECTIVE else 0.0
        return math.hypot(_relative(self._means(shift)), few)

    def lifted(self, pool: UnitGaps) -> Vector:
        """(units,): logarithm of the factor on the theory of each unit, by the clearance that it
        needs."""
        if self.knots is None:
            return np.zeros(len(pool.sigma))
        return np.asarray(np.interp(self.needed(pool, self.aim), *self.knots))

    def placed(self, correction: float) -> float:
        """The shift of the stops of the answer; 0 without a target."""
        if self.start.target is None:
            return 0.0
        return self.solved(correction, self.pool, self.lifts, self.start.target)

    def solved(self, correction: float, pool: UnitGaps, lifts: Vector, chance: float) -> float:
        """The shift at which the mean probability of units, times a correction, has a value."""
        wanted = min(chance / correction, KNOWN)

        def excess(shift: float) -> float:
            mean = float(self.weight @ self.chances(pool, shift, lifts))
            return math.log(max(mean, 1e-300) / wanted)

        if excess(FARTHEST_SHIFT) > 0.0:
            raise NotApplicable(
                "production",
                f"no clearance keeps the probability of any impact at {chance:g}: "
                "units have stops that press, or the other stops are hit more often; give smaller "
                "spreads",
            )
        if excess(-FARTHEST_SHIFT) < 0.0:
            return -FARTHEST_SHIFT
        return float(scipy.optimize.brentq(excess, -FARTHEST_SHIFT, FARTHEST_SHIFT, xtol=1e-9))

    @property
    def kept(self) -> float:
        """The target, or the mean probability of the production without one."""
        if self.start.target is not None:
            return self.start.target
        return self.mean

    def needed(self, pool: UnitGaps, chance: float, lift: ArrayLike = 0.0) -> Vector:
        """(units,): the shift at which each unit alone has a probability; what its theory is off
        by is `lift`."""
        rate = -math.log1p(-min(chance, KNOWN)) / self.clusters / np.exp(lift)
        low, high = (
            np.full(len(pool.sigma), -FARTHEST_SHIFT),
            np.full(len(pool.sigma), FARTHEST_SHIFT),
        )
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            above = pool.rice(self.stops(middle)) > rate
            low, high = np.where(above, middle, low), np.where(above, high, middle)
        return np.asarray(0.5 * (low + high))

    def largest(self, shift: ArrayLike) -> Vector:
        """The largest clearance of the movable pairs at a shift, m."""
        places = self.stops(shift)[..., self.moved]
        return np.asarray(np.where(np.isfinite(places), places, -math.inf).max(axis=(-2, -1)))

    # --- units that are simulated -----------------------------------------------------------

    @property
    def _probed(self) -> int:
        """Number of units by which the theory is corrected unit by unit: none where only levels and
        clearances differ, for a unit that needs more is then the same as one that needs less."""
        moving = any(name in MOVING for _, name in self.units.columns)
        return len(PROBES) + 1 if moving else 0

    def probe(self, shift: float) -> None:
        """Correct the theory unit by unit: simulate some, each at the clearance that it needs."""
        self.aim = self.start.target or float(np.mean(self._means(0.0)))
        if not self._probed:
            return
        needs = self.needed(self.pool, self.aim)
        order = np.argsort(needs)
        risk = self.weight * self.chances(self.pool, shift)
        chosen = [
            order[np.searchsorted(np.cumsum(weight[order]) / weight.sum(), place)]
            for weight, place in [*((self.weight, each) for each in PROBES), (risk, 0.5)]
        ]
        knots = []
        for number, k in enumerate(chosen):
            if abs(needs[k]) >= FARTHEST_SHIFT:
                continue
            chance = self._simulated(k, float(needs[k]), number)
            hits, theory = (-math.log1p(-min(each, KNOWN)) for each in (chance.value, self.aim))
            knots.append((float(needs[k]), math.log(hits / theory) if hits else 0.0))
        if knots:
            needed, lift = np.array(sorted(knots)).T
            self.knots = needed, lift
        self._join()

    def _simulated(self, k: int, shift: float, number: int) -> Estimate:
        """Probability of any impact of a unit with the stops moved by a shift, by first crossings;
        the `number` counts the simulations."""
        place = self.stops(shift) + self.pool.farther[k]
        hits = self.clusters * float(self.pool.rice(self.stops(shift))[k])
        if hits > SURE_HITS or place.min() <= 0.0:
            return Estimate(value=1.0, how="hit surely")
        whole = self._probed + SIMULATED
        part = self.run.part(
            0.3 + 0.7 * number / whole, 0.3 + 0.7 * (number + 1) / whole,
            f"unit {number + 1} of {whole}",
            self.run.deadline.share(1.0 / (whole - number)).in_no_less_than(LEAST_SECONDS),
            seed=self.run.seed + 1 + number, rel_error=min(UNIT_ERROR * self.run.accuracy, 0.5),
        )  # fmt: skip
        return chance_of_stops(self.units.unit(self.amounts[k]), place, self.start.mission, part)

    def simulate(self, shift: float) -> None:
        """Find the correction, by first crossings of units that are drawn in proportion to their
        risk."""
        theory = self.chances(self.pool, shift, self.lifts)
        risk = self.weight * theory
        random = np.random.default_rng([self.run.seed, MOST_SEQUENCES])
        places = (np.arange(SIMULATED) + random.random()) / SIMULATED
        # in random order, so that the first few are a sample as well
        chosen = random.permutation(np.searchsorted(np.cumsum(risk) / risk.sum(), places))
        rows, found = [], []
        for done, k in enumerate(chosen):
            late = self.run.deadline.passed()
            if late and done >= FEWEST_SIMULATED:
                break
            chance = self._simulated(k, shift, self._probed + done)
            found.append(chance.value / theory[k])
            names = [name for _, name in self.units.columns]
            rows.append(
                dict(zip(names, self.amounts[k].tolist(), strict=True))
                | {"linear": float(theory[k]), "probability": chance.value,
                   "standard_error": chance.standard_error, "bias": chance.bias or 0.0}
            )  # fmt: skip
        self.rows = rows
        self.correction = Estimate(
            value=float(np.mean(found)), standard_error=_deviation(found),
            bias=float(np.mean([row["bias"] / row["linear"] for row in rows])),
            how=f"{len(found)} units, drawn in proportion to their risk",
        )  # fmt: skip

    # --- the answer -------------------------------------------------------------------------

    def answer(self) -> Production:
        """Find the shift of the stops, the correction and what each tolerance costs."""
        self.run.tell(0.0, "units by linear theory")
        self.quadrature()
        self.probe(self.placed(1.0))
        self.simulate(self.placed(1.0))
        factor, start = self.correction.value, self.start
        shift = self.placed(factor)
        self.mean = factor * float(np.mean(self._means(shift)))
        quadrature = self._relative(shift)
        relative = math.hypot(quadrature, self.correction.standard_error / factor)
        bias = (self.correction.bias or 0.0) / factor
        half = GAUSSIAN_95 * relative + bias
        slope = (
            -math.log(
                float(np.mean(self._means(shift + 0.05)))
                / float(np.mean(self._means(shift - 0.05)))
            )
            / 0.1
        )
        low, high = shift - half / slope, shift + half / slope
        needed = self.needed(self.pool, self.kept / factor, self.lifts)
        return Production(
            scene=start.scene,
            spreads=self.spreads,
            mission=start.mission,
            target=start.target,
            clearances=self._clearances(low, shift, high),
            stated={name: each.value for name, each in self._clearances(0.0, 0.0, 0.0).items()},
            probability=Estimate(
                value=self.mean, standard_error=self.mean * relative, bias=self.mean * bias,
                how=f"{len(self.amounts)} units by linear theory, {self.correction.how} simulated",
            ),
            interval=(self.mean * max(1.0 - half, 0.0), min(self.mean * (1.0 + half), 1.0)),
            probability_as_stated=float(self.chances(self.stated, shift)[0]),
            share_above=self._share_above(needed, shift),
            correction=self.correction,
            units=self._quantiles(needed, shift),
            tolerances=self._costs(shift),
            simulated=frame_of(self.rows),
            method=METHOD,
            allowed=self.tolerances,
            warnings=self._warnings(relative),
            cost=self.run.cost(),
            provenance=provenance(start.scene.document(), self.run.seed),
        )  # fmt: skip

    def _clearances(self, low: float, shift: float, high: float) -> dict[str, Clearance]:
        """The nearer stop of each pair that may be moved, or of each pair."""
        places = [self.stops(np.asarray(each)).min(axis=0) for each in (low, shift, high)]
        return {
            self.start.names[k]: Clearance(
                value=float(places[1][k]), lower=float(places[0][k]), upper=float(places[2][k])
            )
            for k in self.moved
        }

    def _share_above(self, needed: Vector, shift: float) -> Estimate | None:
        """The share of the units that need more than the production gets."""
        if self.start.target is None:
            return None
        above = (self.weight * (needed > shift)).reshape(len(self.sequences), -1).sum(axis=1)
        shares = above * len(self.sequences)
        return Estimate(
            value=float(shares.mean()), standard_error=_deviation(shares.tolist()),
            how="by linear theory, with its corrections",
        )  # fmt: skip

    def _quantiles(self, needed: Vector, shift: float) -> DataFrame:
        lift = self.lifts + math.log(self.correction.value)
        chances = self.chances(self.pool, shift, lift)
        return frame_of(
            {
                "share_of_units": QUANTILES,
                "probability": _quantiles(chances, self.weight),
                "clearance": _quantiles(self.largest(needed), self.weight),
            }
        )

    def _costs(self, shift: float) -> DataFrame:
        """The table that `Production.tolerances` describes."""
        if not self.spreads:
            return frame_of()
        columns = [tolerance for tolerance, _ in self.units.columns]
        words, without, mixed = list[str](), list[float](), []
        for name, spread in self.spreads.items():
            own = np.array([each == name for each in columns])
            mean = float(spread.distribution(name).mean())
            words.append(spread.in_words(name))
            without.append(self._enough(self._gaps(np.where(own, mean, self.amounts))))
            mixed.append([self._needs(np.where(own, b, a)) for a, b in map(_pair, self.sequences)])
        for limit, pool in self._without_limits():
            words.append(limit)
            without.append(math.nan if pool is None else self._enough(pool))
        most = float(self.largest(shift))
        table = {"tolerance": words, "clearance_cost": [most - each for each in without]}
        # (sequences, spreads) of either kind of share
        found = [self._shares(number, each) for number, each in enumerate(zip(*mixed, strict=True))]
        unknown = [math.nan] * (len(words) - len(self.spreads))
        for name, shares in zip(("first_order", "total"), np.swapaxes(found, 0, 1), strict=True):
            table |= {
                name: shares.mean(axis=0).tolist() + unknown,
                f"{name}_error": [_deviation(each) for each in shares.T] + unknown,
            }
        return frame_of(table)

    def _enough(self, pool: UnitGaps) -> float:
        """The clearance that other units need for the same mean risk, m."""
        kept = self.solved(self.correction.value, pool, self.lifted(pool), self.kept)
        return float(self.largest(kept))

    def _without_limits(self) -> Iterator[tuple[str, UnitGaps | None]]:
        """Each tolerance that is no distribution, in words, and the units where it alone is as
        stated; None where the budget ended before their motion was solved."""
        for each in fields(self.tolerances):
            if not (limit := getattr(self.tolerances, each.name)):
                continue
            one = Tolerances(**{each.name: limit})
            others = [change for change in self.worst if change.quantity not in one.limits()]
            scene = all_applied(others, self.start.scene)
            units = replace(self.units, scene=scene, surfaces=[])
            try:
                units.solve(self.run.deadline)
            except (Interrupted, NotConverged):
                yield one.in_words(), None
            else:
                yield one.in_words(), units.gaps(self.amounts)

    def _shares(self, number: int, mixed: Sequence[Vector]) -> tuple[Vector, Vector]:
        """Shares of each spread quantity in the variance of the clearance that a unit needs, alone
        and with the others, by one sequence (Sobol' indices)."""
        if len(self.spreads) == 1:
            return np.ones(1), np.ones(1)
        plain = [self._needs(each)[None] for each in _pair(self.sequences[number])]
        outputs: Any = {"f_A": plain[0], "f_B": plain[1], "f_AB": np.array(mixed)[:, None]}
        found = scipy.stats.sobol_indices(func=outputs, n=POINTS)
        return np.ravel(found.first_order), np.ravel(found.total_order)

    def _gaps(self, amounts: Matrix) -> UnitGaps:
        return self.units.gaps(amounts)

    def _needs(self, amounts: Matrix) -> Vector:
        """(units,): the clearance that each unit needs for itself, m."""
        gaps = self._gaps(amounts)
        kept = self.kept / self.correction.value
        return self.largest(self.needed(gaps, kept, self.lifted(gaps)))

    def _warnings(self, relative: float) -> tuple[str, ...]:
        if relative <= MISSED * self.run.accuracy:
            return ()
        return (
            f"the mean probability is known to a relative error of {relative:.3g} only; raise "
            "budget, or give smaller spreads",
        )


class _Sequence(NamedTuple):
    """Units of one sequence: points of the unit cube, first 2 POINTS of even probability, then
    those drawn where the risk is; amounts, gaps, and weights that sum to about 1."""

    points: Matrix
    amounts: Matrix
    gaps: UnitGaps
    weight: Vector


def _pair(drawn: _Sequence) -> tuple[Matrix, Matrix]:
    """The two halves of the units of even probability."""
    return drawn.amounts[:POINTS], drawn.amounts[POINTS : 2 * POINTS]


def _quantiles(values: Vector, weight: Vector) -> Vector:
    """Quantiles of weighted values at the shares QUANTILES."""
    order = np.argsort(values)
    below = np.cumsum(weight[order]) - 0.5 * weight[order]
    return np.asarray(np.interp(QUANTILES, below / weight.sum(), values[order]))


def _deviation(values: Sequence[float]) -> float:
    """Standard error of the mean of independent values, which is Student's where they are few."""
    return student_factor(len(values)) * mean_and_error(np.asarray(values))[1]


def _relative(values: Sequence[float]) -> float:
    """Relative standard error of the mean of independent values."""
    return _deviation(values) / float(np.mean(values))


__all__ = ["Production", "Spread", "production"]
