"""`cost`: statistical error per CPU second, bias of the step, and error of models, each stated
apart."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, Unpack

import numpy as np

from stochvi.mathematics.numerics import Vector
from stochvi.methods.closed_form import exact
from stochvi.methods.fokker_planck import fokker_planck
from stochvi.methods.monte_carlo import FEWEST_PATHS
from stochvi.model.model import model_of
from stochvi.motion.choose_plan import check_price, make_plan
from stochvi.motion.plan import (
    RATES,
    Key,
    Layout,
    Means,
    PathStatistics,
    Plan,
    Quantity,
    governed,
    of_coordinate,
)
from stochvi.motion.white import LARGEST_ANGLE
from stochvi.results.base import DataFrame, Response, Result, frame_of
from stochvi.results.deadline import Deadline
from stochvi.results.errors import Interrupted, NoExactSolution, NotApplicable, NotConverged
from stochvi.results.estimates import Estimate, provenance
from stochvi.results.files import thread_seconds
from stochvi.sampling.calculations import RunOptions, Sampler, calculation
from stochvi.sampling.run import ENDLESS, Run, sampled
from stochvi.scenes.scene import Scene
from stochvi.verification.check import (
    DETERMINISTIC_ERROR,
    FOR_SOLVER,
    approximations,
    counts_others,
    threshold_of,
)

FACTORS = (2.0, 1.0, 0.5)
"""Steps at which the same paths are simulated, in units of the step that `simulate` takes."""

TARGETS = (1e-2, 1e-3, 1e-4)
"""Relative errors for which the CPU time is predicted: 1, 0.1 and 0.01 %."""

NOISE = 3.0
"""Number of standard errors up to which a measured bias may be nothing but noise."""

MOST_HALVINGS = 10
"""Largest number of times that the finest step is halved on paper to find a small enough bias."""

REFERENCE_RTOL = 1e-6
"""Relative error asked of the Fokker-Planck equation: far below what any simulation resolves, for a
tenth of a second."""

LARGEST_BLOCK = 256
"""Largest number of paths in a block: enough for full speed, few enough that a block ends in
time."""

FOKKER_PLANCK = "fokker-planck"
"""Beginning of the name of the method in a response."""

UNCERTAIN = 2.0
"""Ratio of the largest to the smallest price that the measurements allow, from which on both are
stated."""

LEAST_SECONDS = 0.3
"""Seconds that the simulation gets, however long everything before it took."""

DAY, YEAR = 86400.0, 365.25 * 86400.0
"""Seconds of a day and of a year."""

LONG_SECONDS = DAY
"""CPU seconds from which on a price is stated with the quantity that makes it high."""


@dataclass(frozen=True, kw_only=True)
class StepError:
    """One governed quantity at one step of the Monte Carlo; errors are relative to `size`.

    `cpu_seconds` is what `simulate` takes for the same paths at this step, all threads together:
    with those paths that it makes at twice the step as well, to know the bias. `size` is the
    quantity itself, for a mean displacement the standard deviation. `error_of_a_second` is the
    standard error after one CPU second; it falls with the square root of the time. `step_bias` is
    measured, and `step_bias_error` is its standard error; `reference_bias` is the bias that the
    reference states of itself. The bias is at most `step_bias_limit`, which is None where no limit
    is known. It falls with the power `order` of the step.
    """

    step: float
    of: str
    quantity: str
    value: float
    size: float
    standard_error: float
    cpu_seconds: float
    error_of_a_second: float
    step_bias: float
    step_bias_error: float
    step_bias_limit: float | None
    order: float | None
    reference_bias: float = 0.0

    @property
    def bias_is_seen(self) -> bool:
        """Whether the measured bias is more than noise."""
        return self.least_bias > DETERMINISTIC_ERROR

    @property
    def least_bias(self) -> float:
        """The smallest bias that the measurement at this step alone allows."""
        unknown = NOISE * self.step_bias_error + self.reference_bias
        return max(0.0, abs(self.step_bias) - unknown)

    @property
    def largest_bias(self) -> float:
        """The largest bias that the measurement at this step alone allows."""
        return abs(self.step_bias) + NOISE * self.step_bias_error + self.reference_bias

    def seconds(self, target: float) -> float | None:
        """CPU seconds until statistical error and bias are both below a relative error; None
        where the bias at this step is not known to be below it."""
        if self.step_bias_limit is None or self.step_bias_limit > target:
            return None
        return float((self.error_of_a_second / target) ** 2)

    def at_least(self) -> StepError:
        """The same quantity with the smallest bias that the measurement allows."""
        limit = None if self.step_bias_limit is None else min(self.least_bias, self.step_bias_limit)
        return replace(self, step_bias_limit=limit)

    def halved(self, times: int) -> StepError:
        """The same quantity, predicted for the step after some halvings: each halving doubles the
        CPU time, and lowers the bias by its order."""
        limit = self.step_bias_limit
        if limit is not None and self.order is not None:
            limit *= 2.0 ** (-times * self.order)
        return replace(
            self,
            step=self.step / 2.0**times,
            error_of_a_second=self.error_of_a_second * 2.0 ** (times / 2.0),
            step_bias_limit=limit,
        )


@dataclass(frozen=True, kw_only=True)
class ModelError:
    """One quantity by a method that draws no random numbers; errors are relative.

    `model_error` is the difference to the reference of the answer; that of a method that is the
    reference itself is the difference to the limit of the two finest steps of the simulation.
    `model_error_error` is its standard error, joined for a limit with the change of the limit if
    the bias were of order 2. `stated_bias` is the bias that the method states.
    """

    method: str
    of: str
    quantity: str
    value: float
    cpu_seconds: float
    model_error: float
    model_error_error: float
    stated_bias: float | None


@dataclass(frozen=True, kw_only=True)
class Prediction:
    """The cheapest step for a relative error, and its CPU seconds on one core.

    `governed_by` is the quantity that takes longest. `simulated` says whether the step was
    simulated, or is predicted from the finest one by the order of the bias. `least_seconds` is the
    price if every bias were the smallest that the measurements allow: where it is far below
    `seconds`, more paths would tell.
    """

    target: float
    step: float
    seconds: float
    governed_by: tuple[str, str]
    simulated: bool
    least_seconds: float = 0.0


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class WorkPrecision(Result):
    """Errors of the Monte Carlo of one scene at several steps, and what they cost.

    `reference` says what biases are measured against. Quantities in `left_out` did not occur in the
    time given, so that their price is unknown.

    See Also
    --------
    stochvi.cost : The calculation.
    """

    kind = "cost"
    in_document: ClassVar = {
        "summary": "summary", "simulated_by": "method", "free_of_bias": "elastic",
        "targets": "targets", "predictions": "predictions", "cost": "price",
    }  # fmt: skip
    not_in_document = ("cost", "interrupted")
    targets: ClassVar[Sequence[float]] = TARGETS

    errors: Sequence[StepError]
    models: Sequence[ModelError]
    reference: str
    elastic: bool
    method: str
    steps: Sequence[float]
    default_step: float
    left_out: Sequence[str]

    def of_step(self, step: float, *, rates: bool = False) -> list[StepError]:
        """The governed quantities at a step: rates, or moments, F1 and F2."""
        return [row for row in self.errors if row.step == step and (row.quantity in RATES) == rates]

    def cheapest(self, target: float, *, rates: bool = False) -> Prediction | None:
        """The cheapest step at which statistical errors and biases are below `target`.

        Where the bias is too large at the finest step that was simulated, that step is halved on
        paper, by the order of the bias. The answer is None where that does not help, or is not
        known to help. Rates of impacts are kept apart from the other quantities: where stops lose
        energy their bias falls so slowly with the step that a shorter step hardly helps them.
        """
        if self.left_out:
            return None
        found = self._cheapest(target, [self.of_step(step, rates=rates) for step in self.steps])
        if found is None:
            return None
        at_least = [
            [row.at_least() for row in self.of_step(step, rates=rates)] for step in self.steps
        ]
        least = self._cheapest(target, at_least)
        return replace(found, least_seconds=min(found.seconds, least.seconds if least else 0.0))

    def _cheapest(self, target: float, ladder: list[list[StepError]]) -> Prediction | None:
        """The cheapest of the steps, each with the rows of its quantities, longest first."""
        finest = ladder[-1]
        found = [self._priced(rows, target) for rows in ladder]
        for times in range(1, MOST_HALVINGS + 1):
            if any(found):
                break
            halved = self._priced([row.halved(times) for row in finest], target)
            found.append(replace(halved, simulated=False) if halved else None)
        return min((one for one in found if one), key=lambda one: one.seconds, default=None)

    def _priced(self, rows: Sequence[StepError], target: float) -> Prediction | None:
        """The price at one step: that of the slowest quantity."""
        prices = [(row.seconds(target), row) for row in rows]
        known = [(price, row) for price, row in prices if price is not None]
        if not known or len(known) < len(prices):
            return None
        seconds, slowest = max(known, key=lambda pair: pair[0])
        return Prediction(
            target=target,
            step=slowest.step,
            seconds=seconds,
            governed_by=(slowest.of, slowest.quantity),
            simulated=True,
        )

    def summary(self) -> str:
        """Price of each accuracy, in a sentence."""
        if self.left_out:
            return f"the price is unknown: {'; '.join(self.left_out)}"
        text = f"CPU time of one core: {self._spoken(rates=False)}"
        if self.of_step(self.steps[0], rates=True):
            text += f"; impacts: {self._spoken(rates=True)}"
        return text

    def _spoken(self, *, rates: bool) -> str:
        """The price and the step of each accuracy."""
        parts = []
        for target in TARGETS:
            found = self.cheapest(target, rates=rates)
            if found is None:
                parts.append(f"{100.0 * target:g} % out of known reach")
                continue
            reckoned = "" if found.simulated else ", predicted"
            reason = self._reason(found) if found.seconds > LONG_SECONDS else ""
            price = f"{spoken_time(found.seconds)} (step {found.step:.3g} s{reckoned}{reason})"
            if found.seconds > UNCERTAIN * found.least_seconds:
                price = f"{spoken_time(found.least_seconds)} to {price}, more paths narrow it"
            parts.append(f"{100.0 * target:g} % takes {price}")
        return ", ".join(parts)

    def _reason(self, found: Prediction) -> str:
        """The quantity that makes a price high, and how well it is known."""
        of, quantity = found.governed_by
        error = next(
            row.standard_error
            for row in self.errors
            if (row.step, row.of, row.quantity) == (min(self.steps), of, quantity)
        )
        return (
            f"; {quantity} of {of} takes longest, its standard error here is {100.0 * error:.2g} %"
        )

    def to_frame(self) -> DataFrame:
        """One row per step and quantity, then one per model and quantity; errors are relative.

        Statistical error, bias of the step and error of a model are columns of their own.
        """
        rows = [
            {"method": "simulate", **vars(row)}
            | {f"cpu_seconds_{target:g}": row.seconds(target) for target in TARGETS}
            for row in self.errors
        ]
        return frame_of([*rows, *self.models])

    @property
    def predictions(self) -> Mapping[str, list[Prediction]]:
        """The cheapest step for each accuracy that is within reach, of moments and of rates."""
        return {
            name: [found for t in TARGETS if (found := self.cheapest(t, rates=rates))]
            for name, rates in (("moments_F1_F2", False), ("hits", True))
        }

    @property
    def price(self) -> Mapping[str, float]:
        """What the measurement itself took."""
        return {name: getattr(self.cost, name) for name in ("wall_time", "paths", "threads")}


def spoken_time(seconds: float) -> str:
    """A time to two digits, in the unit that reads best; beyond a century no digits are given.

    >>> spoken_time(0.0213), spoken_time(540.0), spoken_time(9000.0), spoken_time(1e6)
    ('0.021 s', '9 min', '2.5 h', '12 days')
    >>> spoken_time(8.63e8), spoken_time(1e12)
    ('27 years', 'more than 100 years')
    """
    if seconds > 100.0 * YEAR:
        return "more than 100 years"
    for unit, name in ((YEAR, "years"), (DAY, "days"), (3600.0, "h"), (60.0, "min"), (1.0, "s")):
        if seconds >= 2.0 * unit or name == "s":
            break
    amount = seconds / unit
    return f"{amount:.2g} {name}" if amount < 100.0 else f"{amount:.0f} {name}"


@calculation
@sampled
def cost(scene: Scene, *, paths: int | None = None, **options: Unpack[RunOptions]) -> WorkPrecision:
    """Time that accuracy costs, for this scene on this machine: a work-precision table.

    The same paths are simulated at several steps. For every quantity that `simulate(rel_error=)`
    governs this gives the standard error s of one CPU second, and the bias of each step h. The
    reference is the closed form where there is one. Otherwise it is the Fokker-Planck equation,
    where it covers the scene and states a smaller error, or else the limit

        f(0) = f(h) + (f(h) - f(r h)) / (r^p - 1)

    of the two finest steps (L. F. Richardson 1911), p the order of the bias. Standard errors of
    all differences come from the covariance of the paths. A relative error e then takes
    (s / e)^2 seconds, at a step whose bias is below e as well, with NOISE standard errors to
    spare: as measured there, or at a longer step and brought down by its order. Where few paths
    leave open how large the bias is, the least and the largest price are both stated.
    Deterministic methods cost next to nothing, and more time does not improve them: they are stated
    apart.

    Parameters
    ----------
    scene
        The scene.
    paths
        Number of paths instead of a budget, for digits that depend on the seed alone (times apart).
    **options
        `RunOptions`: `budget` are the seconds of wall time to spend, and how many paths that gives
        depends on the machine.

    Returns
    -------
    WorkPrecision
        Errors, biases and prices.

    Raises
    ------
    NotApplicable
        With every condition of `simulate` that the scene does not meet.
    NotConverged
        If the budget is over before there are enough paths for a standard error.

    See Also
    --------
    stochvi.simulate : The same by Monte Carlo.
    stochvi.explain : What will be simulated, and which methods apply.

    Examples
    --------
    >>> from stochvi.scenes.excitations import WhiteNoise
    >>> from stochvi.scenes.structures import Oscillator
    >>> scene = Scene(
    ...     structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
    ...     excitations=[WhiteNoise(intensity=0.2)],
    ... )
    >>> found = cost(scene, paths=256)
    >>> [round(step, 3) for step in found.steps], found.reference
    ([1.0, 0.5], 'exact')
    """
    if paths is not None and paths < FEWEST_PATHS:
        raise ValueError(
            f"paths must be at least {FEWEST_PATHS} for honest standard errors, got {paths}"
        )
    run = Run.of(options)
    deadline = run.deadline if paths is None else Deadline.after(None)
    plan = make_plan(model_of(scene), deadline=deadline)
    plans = ladder(plan)
    for rung in plans:  # kernels are loaded where they are called first
        rung.shortest().averages(0, 0, 2)
    # the approximations have no budget of their own; the simulation gets the time that they leave
    free = _timed(lambda: approximations(scene, []))
    sampling = deadline.sooner(FOR_SOLVER).in_no_less_than(LEAST_SECONDS)
    statistics, cpu = _simulate(plans, sampling, paths, run)
    rows: list[StepError] = []
    models: list[ModelError] = []
    left_out = []
    free += _timed(lambda: _solved(scene, plan, deadline))
    known, solved = _known(scene, plan, free)
    used = set[str]()
    rungs = [*zip(plans, _with_bias_run(plan, cpu), strict=True)]
    for key, quantity in governed(plan.model).items():
        size_of = quantity
        if key[1] == "displacement_mean":
            size_of = of_coordinate(key[0])["displacement_std"]
        size = abs(statistics.evaluate(_at_rung(size_of, len(plans) - 1))[0])
        if size == 0.0:
            left_out.append(f"no impact was seen: {key[1]} of {key[0]}")
            continue
        order = step_order(plan, key)
        truth, taken, bias = _reference(quantity, plans, order, known.get(key), solved, statistics)
        used.add(taken)
        steps = _errors_of(key, quantity, truth, size, order, rungs, statistics, bias / size)
        rows += steps
        limit = _limit_of_steps(quantity, plans, order)
        for answer in free:
            counted = plan.layout.thresholds.get(key[0], 0.0)
            if counts_others(key[1], counted, threshold_of(answer[0], key[0])):
                continue
            # a method is not its own judge
            others = taken == FOKKER_PLANCK and not answer[0].method.startswith(taken)
            by_truth = others or taken == "exact"
            judges = (truth, truth) if by_truth else (limit, _limit_of_steps(quantity, plans, 2.0))
            models += _model_of(key, judges, size, answer, statistics)
    found = WorkPrecision(
        errors=sorted(rows, key=lambda row: -row.step),
        models=models,
        reference=", ".join(sorted(used)) or solved,
        elastic=plan.elastic,
        method=plan.method,
        steps=tuple(rung.step for rung in plans),
        default_step=plan.step,
        left_out=tuple(left_out),
        cost=run.cost(paths=statistics.count),
        provenance=provenance(scene.document(), run.seed),
    )
    if deadline.interrupted:
        raise deadline.fell_short(f"after {statistics.count} paths", "", found)
    return found


def ladder(plan: Plan) -> list[Plan]:
    """The plan at `FACTORS` of its step, longest first; none turns the fastest motion by more
    than `LARGEST_ANGLE` (rad), where kicks and flights become too coarse."""
    found: list[Plan] = []
    for factor in FACTORS:
        # a default step may be at the limit, up to rounding
        if factor <= 1.0 or plan.fastest * factor * plan.step <= LARGEST_ANGLE * (1.0 + 1e-9):
            found.append(plan if factor == 1.0 else plan.with_step(factor * plan.step))
    return found


def step_order(plan: Plan, key: Key) -> float | None:
    """Order of the bias of a quantity in the step, as the plan assumes it when it compares a step
    with twice the step; None where there is no bias, or where its order is unknown."""
    share = None if plan.elastic else plan.step_bias(key[1], 1.0)
    if share is None or math.isinf(share):
        return None
    # bias = difference / (2^order - 1)
    return math.log2(1.0 + 1.0 / share)


@dataclass(frozen=True)
class AtEveryStep:
    """Joint statistics of the same paths at every step, and the CPU seconds of each step."""

    statistics: PathStatistics
    seconds: Vector


@dataclass(frozen=True, eq=False)
class LadderSampler(Sampler[tuple[Vector, Vector], AtEveryStep]):
    """The same paths by several plans."""

    plans: tuple[Plan, ...]
    seed: int

    @property
    def block(self) -> int:
        """Number of paths that are simulated together."""
        return min(LARGEST_BLOCK, *(plan.block for plan in self.plans))

    def simulate(self, first_path: int, paths: int) -> tuple[Vector, Vector]:
        """Averages of the paths at every step, and the CPU seconds of each step."""
        averages, seconds = [], []
        for plan in self.plans:
            start = thread_seconds()
            averages.append(plan.averages(self.seed, first_path, paths))
            seconds.append(thread_seconds() - start)
        return np.concatenate(averages), np.array(seconds)

    def add_up(self, pieces: list[tuple[Vector, Vector]]) -> AtEveryStep:
        """Statistics of a block; the time that they take is that of all steps together."""
        began = thread_seconds()
        averages = np.concatenate([piece for piece, _ in pieces], axis=1)
        found = PathStatistics.of(averages, _joint_layout(self.plans))
        seconds = np.sum([spent for _, spent in pieces], axis=0)
        return AtEveryStep(found, seconds + (thread_seconds() - began) / len(self.plans))

    def merge(self, sample: AtEveryStep, more: AtEveryStep) -> AtEveryStep:
        """The statistics of both groups of paths."""
        return AtEveryStep(sample.statistics.merge(more.statistics), sample.seconds + more.seconds)

    def paths(self, sample: AtEveryStep) -> int:
        """Number of paths."""
        return sample.statistics.count


def _simulate(
    plans: Sequence[Plan], deadline: Deadline, paths: int | None, run: Run
) -> tuple[PathStatistics, list[float]]:
    """Simulate until `paths` are done or time is up; the statistics of the paths, and the CPU
    seconds of each step, of all threads together."""
    check_price(plans, run.seed, deadline)
    started, began = time.perf_counter(), thread_seconds()
    sampler = LadderSampler(tuple(plans), run.seed)

    def tell(sample: AtEveryStep) -> tuple[float, str]:
        elapsed = time.perf_counter() - started
        there = elapsed / (elapsed + deadline.left)
        share = there if paths is None else sampler.paths(sample) / paths
        return share, sampler.describe(sample)

    endless = ENDLESS if paths is None else paths
    found = run.until(sampler, endless, deadline=deadline, needed=0, tell=tell)
    if found.paths < FEWEST_PATHS:
        raise deadline.fell_short(
            f"after {found.paths} paths, of at least {FEWEST_PATHS}", "raise budget"
        )
    merging = (thread_seconds() - began) / len(plans)
    return found.sample.statistics, [float(spent) + merging for spent in found.sample.seconds]


def _with_bias_run(plan: Plan, cpu: Sequence[float]) -> list[float]:
    """CPU seconds of `simulate` at each step, longest first, from those of the same paths at each
    step alone: a share of them is simulated at twice the step too, which is the step before."""
    if plan.elastic:
        return list(cpu)
    at_twice = [0.5 * cpu[0], *cpu[:-1]]
    return [own + plan.coarse_share * more for own, more in zip(cpu, at_twice, strict=True)]


def _timed(solve: Callable[[], list[Response]]) -> list[tuple[Response, float]]:
    """Responses with their shares of the CPU seconds that all threads took for them: in proportion
    to their wall time."""
    began = time.process_time()
    found = solve()
    used = time.process_time() - began
    all_of_them = sum(each.cost.wall_time for each in found)
    return [(each, used * each.cost.wall_time / all_of_them) for each in found]


def _joint_layout(plans: Sequence[Plan]) -> Layout:
    """Rows of all steps, one under the other: the owner carries the number of the step."""
    layouts = [plan.layout for plan in plans]
    return Layout(
        rows=tuple(
            (f"{k}/{owner}", what) for k, one in enumerate(layouts) for owner, what in one.rows
        ),
        origins={
            f"{k}/{owner}": origin
            for k, one in enumerate(layouts)
            for owner, origin in one.origins.items()
        },
        thresholds={},
        controls={
            (f"{k}/{owner}", what): expected
            for k, one in enumerate(layouts)
            for (owner, what), expected in one.controls.items()
        },
    )


def _at_rung(quantity: Quantity, rung: int) -> Quantity:
    """A quantity of one step, as a function of the means of all steps."""
    mark = f"{rung}/"

    def of_all(means: Means) -> float:
        own = {
            (owner[len(mark) :], what): mean
            for (owner, what), mean in means.items()
            if owner.startswith(mark)
        }
        return quantity(own)

    return of_all


def _known(
    scene: Scene, plan: Plan, free: Sequence[tuple[Response, float]]
) -> tuple[dict[Key, Estimate], str]:
    """Values by the closed form or else the Fokker-Planck equation, with the bias that they state;
    and the name of the method."""
    try:
        return exact(scene).estimates(), "exact"
    except NoExactSolution:
        pass
    for response, _ in free:
        if response.method.startswith(FOKKER_PLANCK):
            known = {k: e for k, e in response.estimates().items() if e.bias is not None}
            return known, FOKKER_PLANCK
    return {}, _of_steps(plan)


def _of_steps(plan: Plan) -> str:
    """Words for a reference that is made of the simulation itself."""
    return "finest step" if plan.elastic else "limit of the two finest steps"


def _solved(scene: Scene, plan: Plan, deadline: Deadline) -> list[Response]:
    """The response by the Fokker-Planck equation on a mesh that the deadline allows. Its rates
    count the same impacts as those of the simulation."""
    threshold = next(iter(plan.layout.thresholds.values()), None)
    try:
        return [
            fokker_planck(
                scene, speed_threshold=threshold, rtol=REFERENCE_RTOL, budget=deadline.rest
            )
        ]
    except NotApplicable:
        return []
    except (NotConverged, Interrupted) as reason:
        # its bias states the accuracy that it has reached
        return [] if reason.partial is None else [reason.partial]


def _reference(
    quantity: Quantity, plans: Sequence[Plan], order: float | None, known: Estimate | None,
    method: str, statistics: PathStatistics,
) -> tuple[Quantity, str, float]:  # fmt: skip
    """The value of a quantity without bias, as a function of the means of all steps; what it is,
    and the bias that it has itself.

    A known value is taken unless its bias is larger than what the limit of the steps leaves open.
    """
    own, left = _limit_of_steps(quantity, plans, order), math.inf
    if order is not None:
        finest = _at_rung(quantity, len(plans) - 1)
        left = NOISE * statistics.evaluate(lambda means: finest(means) - own(means))[1]
    if known is not None and (known.bias or 0.0) <= left:
        value = known.value
        return lambda means: value, method, known.bias or 0.0
    return own, _of_steps(plans[-1]), 0.0


def _limit_of_steps(quantity: Quantity, plans: Sequence[Plan], order: float | None) -> Quantity:
    """The limit of a quantity from the two finest steps, or its value at the finest one where its
    bias has no order."""
    last = len(plans) - 1
    finest = _at_rung(quantity, last)
    if order is None:
        return finest
    coarser = _at_rung(quantity, last - 1)
    weight = 1.0 / ((plans[last - 1].step / plans[last].step) ** order - 1.0)
    return lambda means: (1.0 + weight) * finest(means) - weight * coarser(means)


def _errors_of(
    key: Key,
    quantity: Quantity,
    truth: Quantity,
    size: float,
    order: float | None,
    rungs: Sequence[tuple[Plan, float]],
    statistics: PathStatistics,
    reference_bias: float,
) -> list[StepError]:
    """One quantity at every step, from the longest to the finest: a plan and its CPU seconds."""
    rows: list[StepError] = []
    for rung, (plan, seconds) in enumerate(rungs):
        own = _at_rung(quantity, rung)
        value, error = statistics.evaluate(own)
        bias, bias_error = statistics.evaluate(lambda m, own=own: own(m) - truth(m))  # type: ignore[misc]
        row = StepError(
            step=plan.step,
            of=key[0],
            quantity=key[1],
            value=value,
            size=size,
            standard_error=error / size,
            cpu_seconds=seconds,
            error_of_a_second=error / size * math.sqrt(seconds),
            step_bias=bias / size,
            step_bias_error=bias_error / size,
            step_bias_limit=0.0 if plan.elastic else None,
            order=order,
            reference_bias=reference_bias,
        )
        if not plan.elastic and order is not None:
            row = replace(row, step_bias_limit=_limit(row, rows[-1] if rows else None, order))
        rows.append(row)
    return rows


def _limit(row: StepError, longer: StepError | None, order: float) -> float:
    """The largest bias that the measurements at this step and at the next longer one allow.

    The bias at the longer step is larger, and so known better. Scaled by the order it limits the
    bias at this step, unless the bias that is measured here beyond noise contradicts it.
    """
    if longer is None or longer.step_bias_limit is None:
        return row.largest_bias
    scaled = longer.step_bias_limit * (row.step / longer.step) ** order
    return row.largest_bias if row.least_bias > scaled else min(row.largest_bias, scaled)


def _model_of(
    key: Key,
    judges: tuple[Quantity, Quantity],
    size: float,
    answer: tuple[Response, float],
    statistics: PathStatistics,
) -> list[ModelError]:
    """One quantity by a method that draws no random numbers, if it knows it. What the judge leaves
    open is its standard error, and how far the other judge lies from it."""
    response, seconds = answer
    found = response.estimates().get(key)
    if found is None:
        return []
    (value, error), (other, _) = (statistics.evaluate(judge) for judge in judges)
    return [
        ModelError(
            method=response.method,
            of=key[0],
            quantity=key[1],
            value=found.value,
            cpu_seconds=seconds,
            model_error=(found.value - value) / size,
            model_error_error=math.hypot(error, other - value) / size,
            stated_bias=None if found.bias is None else found.bias / size,
        )
    ]
