"""Statistics of impacts by Monte Carlo, from every impact of independent paths.

Slow impacts on a stop of restitution R under white noise have speeds of density w^(1 - beta), where
`impact_rates.corner_exponent` gives beta from R; Rayleigh's distribution at R = 1 has beta = 0.
They come in clusters, and so do impacts of a light resonance: counts scatter more than Poisson's,
and an interval from their number alone is too narrow. Intervals come from independent paths,
therefore, unless the dispersion of the counts allows Poisson's exact ones.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple, Unpack

import numpy as np
from numpy.typing import NDArray

from stochvi.mathematics.arrays import Matrix, Vector
from stochvi.mathematics.impact_rates import COLLAPSE_RESTITUTION, corner_exponent
from stochvi.methods.monte_carlo.impact_logs import ImpactPlan, plan_impacts
from stochvi.methods.monte_carlo.plan import Plan
from stochvi.methods.monte_carlo.prices import check_price
from stochvi.methods.monte_carlo.quantities import collapses
from stochvi.methods.monte_carlo.response_sampler import FEWEST_PAIRS, paths_at_both_steps
from stochvi.methods.monte_carlo.simulate import check_threshold
from stochvi.methods.monte_carlo.step_bias import lossiest, refines_near_stops
from stochvi.model.calculations import calculation
from stochvi.model.model import UPPER, Model, Pair, model_of
from stochvi.results.deadline import Deadline, partial_result
from stochvi.results.errors import NotApplicable, NotConverged
from stochvi.results.estimates import TOO_FEW, Estimate, provenance
from stochvi.results.intervals import mean_and_error, ratio_and_error
from stochvi.sampling.options import SamplingOptions
from stochvi.sampling.run import Run, sampled
from stochvi.sampling.sampler import ListSampler
from stochvi.scenes.scene import Scene
from stochvi.statistics.first_crossings import first_crossings
from stochvi.statistics.impacts.answer import Exponent, ImpactStatistics, PairStatistics
from stochvi.statistics.impacts.predictions import linear_gap, rice_rates, vanmarcke_rate
from stochvi.statistics.impacts.tallies import (
    BINS,
    WINDOWS,
    Grid,
    Rate,
    Tally,
    dispersion,
    fitted_exponent,
    histogram,
    merged,
    passes_for_poisson,
    rate,
)
from stochvi.statistics.pair_crossings import listed_under_first

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
            value, error = ratio_and_error(numbers, np.full(len(numbers), plan.duration))
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
    loss = ratio_and_error(tally.energies.sum(axis=1), numbers) if hits else None
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
    return [
        (
            f"impacts on the {side} stop of {name} were seen {TOO_FEW}: "
            if found.estimate.how.startswith(f"seen {TOO_FEW}")
            else f"no impact on the {side} stop of {name} in {exposure:.3g} s of motion: "
        )
        + "its rate has an upper limit only, rel_error does not govern it; more paths or a longer "
        "duration look further"
        for name, pair in pairs.items()
        for side, found in pair.rates.items()
        if side != "both" and found.estimate.value == 0.0
    ]


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


def _warnings(plan: ImpactPlan, model: Model) -> list[str]:
    found = []
    for pair in model.pairs:
        threshold = plan.thresholds[pair.name]
        if threshold > 0.0:
            found.append(f"{pair.name}: only impacts faster than {threshold:.3g} m/s count")
        if any(map(collapses, pair.stops)):
            found.append(
                f"{pair.name}: at a restitution up to {COLLAPSE_RESTITUTION:.4f} the rate of "
                "all impacts is infinite: all rates depend on the threshold"
            )
    return found
