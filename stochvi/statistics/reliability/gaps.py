"""Many gaps at once: which of them close in a mission, from crossings of Gaussian motion. Chapters:
crossings that follow each other; the probability of each gap, and of any, with bounds."""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray
from scipy.special import ndtr

from stochvi.mathematics.numerics import Matrix, Vector, gauss_legendre
from stochvi.mathematics.spectra import eigenvalues
from stochvi.mathematics.unsteady_noise import MovingMean
from stochvi.model.coverage import free_motion
from stochvi.model.model import Model
from stochvi.motion.choose_plan import GapResponse, with_tables
from stochvi.motion.synthesis import MOST_SAMPLES
from stochvi.results.errors import NotApplicable
from stochvi.results.estimates import Estimate, spoken_percent
from stochvi.statistics.crossings import memory_of, own_distances, pressed_pairs
from stochvi.statistics.hazards import CERTAIN
from stochvi.statistics.reliability.choice import Findings
from stochvi.statistics.reliability.missions import BOUND, Chance, GapRisk, crossings_of

# ------------------------------------------------------------------------------
# Crossings that follow each other.
#
# Each stop counts as a gap of its own that closes upwards, in standard deviations of the gap: u is
# its distance, w = s'/s the frequency of the gap, and p the slope of a crossing over w, of the unit
# Rayleigh distribution. Given a crossing of one stop, another gap and its rate are normal at any
# time t later, with the correlation r(t) of the two gaps and its derivatives. The crossings of its
# stop v follow at the rate
#
#     h(t) = density of the gap at v times E[max(rate, 0) | gap = v]
#
# (D. Slepian 1963). Clusters begin as often as they end: with Rice's rate nu times the share q of
# crossings that none follows. H is how many follow one, by stop and slope, beyond those that come
# anyway. If a crossing forgets all but its slope, q solves (1 + H) q = 1. First rates were then
# within some 10 % of those of counted missions.
#
# The lags are one grid: every sample at first, then one at random in each of pieces that grow, so
# that the mean of their sum is the integral.
# ------------------------------------------------------------------------------


ROOT_2_PI = math.sqrt(2.0 * math.pi)

NODES = 10
"""Slopes of crossings: nodes at which their distribution is even."""

SHARES = gauss_legendre(NODES)[1] / 2.0
SLOPES = np.sqrt(-2.0 * np.log(0.5 - 0.5 * gauss_legendre(NODES)[0]))
"""These slopes, over w, and their shares of all crossings."""

NARROWEST = 0.2
"""Smallest spread of a slope, over w, that nodes resolve."""

PER_PERIOD = 20.0
"""Samples in a mean period of the fastest gap."""

NEAR, FAR = 300, 600
"""Samples that are all taken, and pieces of those after them."""

MEMORY = 6.0
"""Time constants of the structure after which a motion is forgotten."""

ALIKE = 0.95
"""Correlation from which two stops count as one in the bound of all: samples are too far apart for
crossings that follow so closely, and such a bound may leave out any stop."""


class Stops(NamedTuple):
    """Stops of gaps that move: the number of the pair, the side, the distance from the mean gap in
    standard deviations, crossings per second, and the probability to be beyond."""

    gap: NDArray[np.int64]
    side: Vector
    height: Vector
    rate: Vector
    beyond: Vector

    def of(self, which: NDArray[np.int64]) -> Stops:
        """Some of them."""
        return Stops(self.gap[which], *(each[which] for each in self[1:]))

    def at(self, gaps: Iterable[int]) -> Stops:
        """Those that are crossed of some gaps, gap by gap."""
        own = [np.flatnonzero((self.gap == gap) & (self.rate > 0.0)) for gap in gaps]
        return self.of(np.concatenate(own))


class Following(NamedTuple):
    """Crossings of a stop per second after those of another stop with each of `SLOPES`, (NODES,
    lags). Their own slopes over w have this mean and spread."""

    rate: Matrix
    mean: Matrix
    spread: Matrix

    @classmethod
    def of(cls, u: float, v: float, w: float, own: float, r: Matrix) -> Following:
        """Those of v after u, from the correlation r and its first two derivatives (3, lags) of the
        two gaps at minus the lags; w and `own` are their frequencies."""
        level, turn, bend = r[0], r[1] / w, r[2] / w**2
        slope = SLOPES[:, None]
        place, speed = level * u + turn * slope, -turn * u - bend * slope
        variance = np.maximum(1.0 - level**2 - turn**2, 1e-9)
        both, ratio = turn * (level + bend), own / w
        rest = ratio**2 - turn**2 - bend**2 - both**2 / variance
        left = np.sqrt(np.maximum(rest, 1e-9 * ratio**2))
        away = v - place
        mean = speed + both / variance * away
        x = mean / left
        upward = w * left * (np.exp(-0.5 * x**2) / ROOT_2_PI + x * ndtr(x))
        density = np.exp(-0.5 * away**2 / variance) / np.sqrt(variance) / ROOT_2_PI
        spread = np.maximum(left / ratio, NARROWEST)
        return cls(density * upward, mean / ratio, spread)

    def by_slope(self, weight: Vector) -> Matrix:
        """Weighted sum over the lags, by the slopes of the first and of the second crossing."""
        slope = SLOPES[:, None, None]
        likely = np.exp(0.5 * slope**2 - 0.5 * ((slope - self.mean) / self.spread) ** 2)
        likely *= SHARES[:, None, None]
        share = self.rate * weight / np.maximum(likely.sum(axis=0), np.finfo(float).tiny)
        return np.asarray(np.einsum("qpl,pl->pq", likely, share))


class GapClusters:
    """Crossings that follow each other, of the stops of some gaps (numbers) of a model."""

    def __init__(self, model: Model, gaps: NDArray[np.int64], place: Vector, speed: Vector) -> None:
        rows = np.array([model.pairs[gap].direction for gap in gaps])
        self.number = {int(gap): number for number, gap in enumerate(gaps)}
        modes = model.modal._replace(gaps=rows @ model.modal.shapes)
        damped = eigenvalues(np.diag(modes.squares), modes.dynamic)
        relaxation = float(np.max(-1.0 / damped.real))
        fastest = float(np.max(speed / place))
        plan = GapResponse(
            modes=modes, tables=with_tables(model).modal.tables, velocities=speed**2,
            relaxation=relaxation, fastest=fastest, samples=2,
            block_length=2.0 * MEMORY * relaxation,
        ).with_step(2.0 * math.pi / PER_PERIOD / fastest)  # fmt: skip
        if plan.samples * len(gaps) > MOST_SAMPLES:
            raise NotApplicable("crossings", "fast motion and slow decay lie too far apart")
        if (memory := memory_of(plan)) > 0.5 * plan.block_length:
            plan = plan.with_block(2.0 * memory)
        self.samples, half = plan.samples, plan.samples // 2
        self.turn = 2j * np.pi / plan.block_length * np.arange(1, len(plan.amplitudes) + 1)
        squares = np.sum(np.abs(plan.amplitudes) ** 2, axis=2)
        self.waves = plan.amplitudes / np.sqrt(squares.sum(axis=0))[:, None]
        self.frequency = np.sqrt(np.abs(self.turn) ** 2 @ squares / squares.sum(axis=0))
        edges = np.arange(1, min(NEAR, half) + 1)
        if half > NEAR:
            edges = np.unique([*edges, *np.rint(np.geomspace(NEAR, half, FAR + 1)).astype(int)])
        inside = np.random.default_rng(0).random(len(edges) - 1)
        self.lags = edges[:-1] + (inside * np.diff(edges)).astype(int)
        self.times, self.widths = plan.step * self.lags, plan.step * np.diff(edges)
        self.horizon, self.known = plan.step * half, dict[tuple[int, int], Matrix]()

    def correlation(self, stops: Stops, one: int, two: int) -> Matrix:
        """r, r' and r'' (3, samples): of the first stop at t and the second one at 0."""
        key = self.number[int(stops.gap[one])], self.number[int(stops.gap[two])]
        if key not in self.known:
            cross = np.einsum("bt,bt->b", self.waves[:, key[0]], self.waves[:, key[1]].conj())
            spectrum = np.zeros((3, self.samples // 2 + 1), complex)
            spectrum[:, 1 : len(cross) + 1] = 0.5 * self.turn ** np.arange(3)[:, None] * cross
            self.known[key] = scipy.fft.irfft(spectrum, self.samples, norm="forward")
        return np.asarray(stops.side[one] * stops.side[two] * self.known[key])

    def after(self, stops: Stops, one: int, two: int) -> tuple[Following, Following]:
        """Crossings of the second stop after one of the first, and the other way round."""
        r = self.correlation(stops, one, two)
        u, v = stops.height[[one, two]]
        w, own = (self.frequency[self.number[int(stops.gap[each])]] for each in (one, two))
        back = r[:, self.lags] * np.array([[1.0], [-1.0], [1.0]])
        return Following.of(u, v, w, own, r[:, -self.lags]), Following.of(v, u, own, w, back)

    def apart(self, stops: Stops) -> Stops:
        """The stops without those that move as one before them does."""
        kept: list[int] = []
        for each in range(len(stops.gap)):
            if all(self.correlation(stops, each, one)[0].max() < ALIKE for one in kept):
                kept.append(each)
        return stops.of(np.array(kept))

    def counted(self, stops: Stops, mission: float) -> tuple[Matrix, Vector]:
        """E[N_i N_j] of the crossings of some stops in a mission, and the rates of those that none
        of them follows in it, 1/s."""
        count, rate = len(stops.gap), stops.rate
        weight = self.widths * np.maximum(mission - self.times, 0.0)
        later = max(mission - self.horizon, 0.0) ** 2 / 2.0
        both = np.diag(rate * mission)
        more = np.zeros((count, NODES, count, NODES))
        for i in range(count):
            for j in range(i + 1):
                for a, b, one in zip((i, j), (j, i), self.after(stops, i, j), strict=True):
                    met = rate[a] * (SHARES @ one.rate @ weight + later * rate[b])
                    both[a, b] += met
                    both[b, a] += met * (a != b)
                    own = SHARES * rate[b] * weight.sum()
                    more[a, :, b] = (one.by_slope(weight) - own) / mission
        size = count * NODES
        last = np.linalg.solve(np.eye(size) + more.reshape(size, size), np.ones(size))
        return both, rate * np.clip(last.reshape(count, NODES) @ SHARES, 0.0, 1.0)


def least(both: Matrix, number: Vector) -> float:
    """A lower bound of the probability of any crossing, from E[N_i N_j] and E[N_i].

    The sum N over the first one, two, ... stops has P(N > 0) >= E[N]^2 / E[N^2] (Cauchy-Schwarz).
    The largest of these bounds is taken.

    >>> least(np.array([[2.0, 1.0], [1.0, 2.0]]), np.array([1.0, 1.0])).__round__(3)
    0.667
    """
    squares = np.diag(np.cumsum(np.cumsum(both, axis=0), axis=1))
    return float(np.max(np.cumsum(number) ** 2 / squares, initial=0.0))


# ------------------------------------------------------------------------------
# The probability of each gap, and of any, with bounds.
#
# At most p + nu T: the probability p to be beyond at the start, and Rice's crossings. At least the
# larger of p and E[N]^2 / E[N^2]. Between them 1 - (1 - p) exp(-nu q T). The probability of any
# contact is at most the sum over all gaps, and at least that of the first ten together.
# ------------------------------------------------------------------------------


MANY = 16
"""Number of pairs above which gaps are ranked, and nothing is simulated that was not asked for."""

FIRST = 10
"""Number of gaps that are looked at together, and simulated where that is asked for."""

LOOKED, SELDOM = 20, 0.05
"""Gaps whose clusters are looked at, by Rice: so many at least, and all with this share of the
crossings of the tenth one. Clusters of the first ten would have to be larger for others."""

SURE = 0.99
"""Lower bound from which a contact is certain: nothing needs to be simulated."""


def ranked(model: Model, mission: float) -> tuple[dict[str, GapRisk], Chance]:
    """The gaps of a model in the order of the probability of a contact in a mission, s, and the
    probability of any.

    Clusters are looked at without sines alone. Raises `NotApplicable` where the motion without
    stops is not stationary and Gaussian, about means that sines may move.
    """
    started, count = time.process_time(), len(model.pairs)
    motion = free_motion(model, with_sines=True)
    moving = motion.moving_means(np.array([pair.direction for pair in model.pairs]))
    place, speed = np.array([each.deviations for each in moving]).T
    away = np.array(own_distances(model))
    stops = _stops(moving, away)
    rate, outside = (
        np.bincount(stops.gap, each, count).astype(float) for each in (stops.rate, stops.beyond)
    )
    looked = _looked_at(rate)
    clusters = None if model.sines else _clusters(model, looked, place, speed)
    first, low = rate.copy(), outside.copy()
    if clusters is not None:
        for each in looked:
            both, last = clusters.counted(own := stops.at([each]), mission)
            first[each] = last.sum()
            low[each] = max(low[each], least(both, own.rate * mission))
    hazard = first * mission - np.log1p(-np.minimum(outside, CERTAIN))
    high = np.minimum(outside + rate * mission, 1.0)
    value = np.clip(-np.expm1(-hazard), low, high)
    order = np.lexsort((-hazard, -value))
    near = np.argmin(away / np.maximum(place, np.finfo(float).tiny), axis=0)
    found = {
        model.pairs[gap].name: GapRisk(
            side=("lower", "upper")[near[gap]], clearance=float(away[near[gap], gap]),
            displacement_std=float(place[gap]), crossings=float(rate[gap] * mission),
            probability=float(value[gap]), at_least=float(low[gap]), at_most=float(high[gap]),
        )
        for gap in order
    }  # fmt: skip
    any_of_them, lower, upper = hazard.sum(), low.max(), min(high.sum(), 1.0)
    if clusters is not None:
        ten = np.intersect1d(order[:FIRST], looked)
        together = clusters.apart(stops.at(order[np.isin(order, ten)]))
        both, last = clusters.counted(together, mission)
        lower = max(lower, least(both, together.rate * mission))
        any_of_them += (last.sum() - first[ten].sum()) * mission
    chance = min(max(-math.expm1(-any_of_them), lower), upper)
    return found, _of_bounds(chance, lower, upper, time.process_time() - started)


def _looked_at(rate: Vector) -> NDArray[np.int64]:
    """Numbers of the gaps whose clusters are looked at, from Rice's rates, the highest first."""
    order = np.argsort(-rate, kind="stable")
    often = rate[order] > SELDOM * rate[order[:FIRST]][-1]
    return np.asarray(order[(often | (np.arange(len(order)) < LOOKED)) & (rate[order] > 0.0)])


def _stops(moving: Sequence[MovingMean], away: Matrix) -> Stops:
    """The stops of gaps that move, from their distances (sides, gaps) from the mean gaps, m."""
    found = [
        (gap, side, distance / each.place, one.rate(distance), one.beyond(distance))
        for gap, each in enumerate(moving)
        for side, distance in zip((-1.0, 1.0), away[:, gap], strict=True)
        if each.place and math.isfinite(distance)
        for one in [each.towards(side)]
    ]
    if not found:
        raise NotApplicable(
            "crossings", "excitation must move at least one gap, got none that moves; check its on"
        )
    gap, *others = np.array(found).T
    return Stops(gap.astype(int), *others)


def _clusters(
    model: Model, gaps: NDArray[np.int64], place: Vector, speed: Vector
) -> GapClusters | None:
    """The clusters of some gaps; None where times lie too far apart, so that bounds alone are
    known, or nothing is crossed."""
    try:
        return GapClusters(model, gaps, place[gaps], speed[gaps]) if len(gaps) else None
    except NotApplicable:
        return None


def _of_bounds(chance: float, lower: float, upper: float, seconds: float) -> Chance:
    """The probability of any contact between bounds."""
    how = "bounds: crossings of Gaussian motion (Rice), and of clusters of them by their squares"
    bias = float(max(upper - chance, chance - lower))
    return Chance(
        event="hit", limit=None, estimate=Estimate(value=float(chance), bias=bias, how=how),
        lower=float(lower), upper=float(upper), confidence=1.0, rule=how, way=BOUND,
        seconds=seconds,
        why="crossings: before the first impact the motion is Gaussian, and its crossings of each "
        "stop, and those that follow them, are known without simulation",
    )  # fmt: skip


def among(chance: Chance, gaps: Mapping[str, GapRisk], simulated: Sequence[str]) -> Chance:
    """The probability of an event on any gap, from that on those that were simulated: the bounds
    of the others are added to its bias and to its upper ends."""
    others = math.fsum(each.at_most for name, each in gaps.items() if name not in simulated)
    known = chance.estimate
    bias = None if known.bias is None else known.bias + min(others, 1.0 - known.value)
    most = None if known.upper_95 is None else min(known.upper_95 + others, 1.0)
    return replace(
        chance, estimate=replace(known, bias=bias, upper_95=most),
        upper=min(chance.upper + others, 1.0),
        why=f"{chance.why}; the first {len(simulated)} gaps alone, all others close in at most "
        f"{spoken_percent(min(others, 1.0))} of missions",
    )  # fmt: skip


def at_once(model: Model, mission: float) -> Findings | None:
    """What is known of many gaps, or of a contact that is certain, without simulation; None of the
    gaps that are better simulated."""
    many, pressed = len(model.pairs) > MANY, pressed_pairs(model, *own_distances(model))
    if not many and (pressed or crossings_of(model)(1.0)[0] * mission < 1.0 / (1.0 - SURE)):
        return None
    gaps, chance = ranked(model, mission)
    if not many and chance.lower < SURE:
        return None
    notes = [
        "before the first impact gaps move as if there were no stops; impacts after it are not "
        "counted, which simulate and impacts do"
    ]
    if many:
        notes.append(
            f"more than {MANY} pairs are ranked; --way first-crossings, or a limit of impacts, "
            f"simulates the first {FIRST} of them"
        )
    return Findings(chances={"hit": chance}, gaps=gaps, notes=notes, warnings=pressed)
