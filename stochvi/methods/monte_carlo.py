"""Monte Carlo of vibro-impact scenes: many paths at once, impacts inside the step. Chapters: a
simulation, when its paths are enough, and its response; the calculation, the prediction of its
cost, and single recorded paths."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Unpack

import numpy as np

from stochvi.mathematics.impact_rates import COLLAPSE_RESTITUTION, more_than_counted
from stochvi.model.build_response import NO_MEAN_SPEED, build_response, residuals
from stochvi.model.coverage import beyond_one_oscillator
from stochvi.model.model import Model, Pair, model_of
from stochvi.motion.choose_plan import (
    PathsOf,
    ResponseSampler,
    check_price,
    make_plan,
    plan_several,
    seconds_of_first_paths,
)
from stochvi.motion.modal import ModalPlan
from stochvi.motion.plan import (
    EVENTS,
    FEW_SLOW,
    RATES,
    RESOLVED,
    STATISTICS,
    Key,
    Layout,
    Means,
    PathStatistics,
    Plan,
    Quantity,
    Statistic,
    StepPairs,
    acceleration_std,
    bias_of_fast_impacts,
    collapses,
    governed,
    of_compliant_pair,
    of_coordinate,
    of_gap,
    of_pair,
    power_of_pair,
    refines_near_stops,
    share_below,
    speed_mean,
)
from stochvi.results.base import CoordinateResponse, DataFrame, PairResponse, Response, frame_of
from stochvi.results.deadline import Deadline, Overdue, Progress, stood_still
from stochvi.results.errors import MOST_RECORDED, Interrupted, NotConverged, check_size
from stochvi.results.estimates import (
    TOO_FEW,
    Cost,
    Estimate,
    events_suffice,
    of_events,
    student_factor,
    upper_limit_unseen,
    without_impact,
)
from stochvi.sampling.calculations import (
    FEWEST_AT_ONCE,
    FULL_LANES,
    Random,
    SamplingOptions,
    calculation,
    check_options,
    more_paths,
)
from stochvi.sampling.run import Run, sampled
from stochvi.sampling.workers import WorkersLost, machine, pool_of
from stochvi.scenes.scene import Scene

FEWEST_PATHS = 64
"""Smallest number of paths in the first round: with fewer, the standard error itself is too
uncertain."""

MOST_REFINEMENTS = 4
"""Largest number of refinements of a run: it halves its step, or begins to resolve slow impacts,
where the bias clearly exceeds the requested relative error."""

PILOT_SEED = 2**63
"""Seed of the pilot that chooses the scheme of a run, which no run can have: the scheme must not
depend on the luck of the paths that give the answer."""

PILOT_SHARE = 0.25
"""Largest number of paths of a pilot, as a share of those that the accuracy will take, or of two
blocks if these are more."""

PILOT_TIME = 0.25
"""Largest time of a pilot, as a share of the seconds that are left: the answer rests on the run."""

SIGNIFICANT = 2.0
"""Standard errors by which a bias must exceed `rel_error` to decide early, or to be refused."""

BETWEEN_IMPACTS = (
    "accelerations are those between impacts: without the impulses of rigid stops, which have none"
)
"""Assumption of an answer with accelerations where a stop is rigid."""


FARTHEST, PLACES = 8.0, 2000
"""Largest distance from the mean, in standard deviations, at which wells of a spring are looked
for, and number of places that are looked at."""

RARELY_PASSED = 2.0
"""Lowest barrier between two wells that is told, in units of m E v^2. Noise brings the mass over a
barrier of B units about B exp(-B) times in a relaxation time of the energy: three times in the
burn-in at B = 2."""


@dataclass
class Simulation:
    """Paths of a plan, and the response that they give.

    `refinements` is the number of times that the plan was refined, and `sample` what the paths have
    added up to so far; with `all_pairs` all of them are simulated at twice the step too. What is
    under way at the end of a budget is no part of it, unless there is nothing else.
    """

    scene: Scene
    plan: Plan
    run: Run
    compile_time: float
    seed: int
    all_pairs: bool = False
    refinements: int = field(default=0, init=False)
    sample: PathsOf | None = field(default=None, init=False)
    machines: tuple[str, ...] = field(default=(), init=False)

    def __post_init__(self) -> None:
        self.started = _clock()
        self.model = self.plan.model
        self.whole_duration = self.plan.duration

    @property
    def layout(self) -> Layout:
        """Meaning of the rows at the step of the plan, with what is expected of the controls."""
        return self.plan.layout

    @property
    def fine(self) -> PathStatistics:
        """Statistics of the paths at the step."""
        return PathStatistics.none(self.layout) if self.sample is None else self.sample.fine

    @property
    def pairs(self) -> StepPairs:
        """Statistics of the paths that were simulated at twice the step as well."""
        return StepPairs.none(self.layout) if self.sample is None else self.sample.pairs

    @property
    def steps(self) -> int:
        """Number of steps of all paths, those at twice the step included."""
        pairs = self.pairs.count
        coarse = pairs * self.plan.coarser().steps_per_path if pairs else 0
        return self.fine.count * self.plan.steps_per_path + coarse

    @property
    def exposure(self) -> float:
        """Counted seconds of motion of all paths together."""
        return self.fine.count * self.plan.duration

    @property
    def seconds(self) -> float:
        """Seconds since this process started or resumed the simulation."""
        return _clock() - self.started

    def cut(self) -> str:
        """Where the paths of the answer were cut, for a sentence; nothing where they are whole."""
        if self.plan.duration == self.whole_duration:
            return ""
        return f", cut after {self.plan.duration:.3g} of their {self.whole_duration:.3g} s"

    def add_paths(
        self, first: int, more: Callable[[], float] = lambda: 0, rel_error: float | None = None
    ) -> bool:
        """Simulate `first` paths, and `more` after each round; return False if the deadline passed
        first."""
        plans = [self.plan] if self.plan.elastic else [self.plan, self.plan.coarser()]
        deadline = self.run.deadline
        check_price(
            plans, self.seed, deadline, min(first, self.plan.block, FULL_LANES), whole=False
        )

        def wanted(sample: PathsOf) -> float:
            self.sample = sample
            return more()

        def tell(sample: PathsOf) -> tuple[float, str]:
            self.sample = sample
            return self._told(first, rel_error)

        sampler = ResponseSampler(self.plan, self.seed, self.all_pairs)
        found = self.run.until(sampler, first, wanted, tell=tell)
        self.sample, self.machines = found.sample, found.machines
        if found.sample.steps < self.plan.steps:
            self.plan = self.plan.cut(found.sample.steps)
        return found.enough

    def _told(self, goal: int, rel_error: float | None) -> tuple[float, str]:
        """The fraction done, and the rate of steps, the number of impacts, and the largest relative
        standard error."""
        errors = relative_standard_errors(self) if self.fine.count > 1 else {}
        largest, done = max(errors.values(), default=math.inf), self.fine.count / goal
        if rel_error is not None:
            known = self.fine.count >= FEWEST_PATHS
            done = (rel_error / max(largest, rel_error)) ** 2 if known else 0.0
        error = f", error {100.0 * largest:.2g} %" if errors else ""
        return done, f"{self.steps / self.seconds:.2g} steps/s, {self.impacts} impacts{error}"

    @property
    def impacts(self) -> int:
        """Number of impacts of all paths together."""
        return round(self._rate_of_all() * self.exposure)

    def refine(self) -> None:
        """Take a plan of less bias before the first path: half the step, or slow impacts
        resolved."""
        self.plan = self.plan.finer()
        self.whole_duration = self.plan.duration
        self.refinements += 1

    def estimate(self, quantity: Quantity, name: str = "") -> Estimate:
        """A quantity with its standard error and the bias that the step leaves in it."""
        return self._stated(name, self.fine.evaluate(quantity), lambda: self.difference(quantity))

    def difference(self, quantity: Quantity) -> tuple[float, float]:
        """A quantity at twice the step less that at the step, with its standard error."""
        ((difference, error),) = self.pairs.differences(lambda means: (quantity(means),), self.fine)
        return difference, error

    def _stated(
        self, name: str, fine: tuple[float, float], difference: Callable[[], tuple[float, float]]
    ) -> Estimate:
        """Return the estimate of a quantity from its value, standard error and bias.

        The difference to twice the step is calculated only where the scheme has a bias.
        """
        value, error = fine
        # of events, `of_events` sees to it together with their number
        error *= 1.0 if name in EVENTS else student_factor(self.fine.count)
        how = self._paths
        if value == 0.0 and (name in RATES or name.startswith("impact_speed")):
            limit = self._limit_unseen(name) if name.startswith("collision_rate") else None
            return Estimate(value=0.0, how=f"no impact seen, {how}", upper_95=limit)
        if self.plan.elastic:
            contacts = self.plan.relative_bias * abs(value)
            return Estimate(value=value, standard_error=error, bias=contacts, how=how)
        known = self._bias_of_model(name) * abs(value)
        change, change_error = difference()
        if math.isnan(change):  # no impact at twice the step, as may be if there are few at all
            return Estimate(
                value=value, standard_error=error, how=f"{how}; bias of the step unknown", bias=None
            )
        bias = self.plan.step_bias(name, abs(change))
        bias = None if bias is None else bias + known
        source = (
            "bias of the step unknown"
            if bias is None
            else f"bias from {self.pairs.count} paths at twice the step"
        )
        return Estimate(
            value=value,
            standard_error=error,
            bias=bias,
            how=f"{how}; {source}",
            bias_error=self.plan.step_bias(name, change_error) or 0.0,
        )

    def _bias_of_model(self, name: str) -> float:
        """Relative bias that springs that relax leave in a quantity: twice that of rms motions, and
        in impacts as the rate of crossings grows with them."""
        if not self.model.rms_bias:
            return 0.0
        assert isinstance(self.plan, ModalPlan)
        grown = 2.0
        if name in EVENTS or name in RATES or name.startswith("impact_speed"):
            grown += max(
                (stop.distance / scale.deviation) ** 2
                for pair, scale in zip(self.model.pairs, self.plan.pairs, strict=True)
                for stop in pair.stops
            )
        return grown * self.model.rms_bias

    @property
    def _paths(self) -> str:
        """The paths, in words."""
        return f"{self.fine.count} paths of {self.plan.duration:.4g} s"

    def _limit_unseen(self, name: str) -> float:
        """Upper 95 % limit in 1/s of a rate of impacts if none was seen.

        It is the limit of the rate of clusters times the largest number of impacts in a cluster, on
        one stop or on both.
        """
        stops = 2.0 if name == "collision_rate" else 1.0
        return stops * self.plan.hits_in_a_cluster * upper_limit_unseen(self.exposure)

    def response(self, warnings: tuple[str, ...] = (), interrupted: bool = False) -> Response:
        """The response from the paths simulated so far."""
        spent = self.seconds
        coordinates = {
            coordinate: CoordinateResponse(
                acceleration_std=self._acceleration(coordinate),
                **{name: self.estimate(each) for name, each in of_coordinate(coordinate).items()},
            )
            for coordinate in self.model.outputs
        }
        pairs = {pair.name: self._pair(pair) for pair in self.model.pairs}
        found = build_response(
            self.scene,
            "simulate",
            coordinates=coordinates,
            impact_pairs=pairs,
            assumptions=self._assumptions(),
            cost=Cost(
                wall_time=spent,
                compile_time=self.compile_time,
                steps=self.steps,
                impacts=self.impacts,
                paths=self.fine.count,
                threads=self.run.workers,
                tenfold_wall_time=100.0 * spent,
            ),
            warnings=[*warnings, *self._warnings()],
            identities=self._identities(),
        )
        made_by = {**found.provenance, "seed": self.seed, "machine": machine()}
        statistics = {
            name: self.estimate(lambda means, key=(owner, name): means[key])  # type: ignore[misc]
            for owner, name in self.layout.rows
            if owner == STATISTICS
        }
        powers = {pair.name: self.estimate(power_of_pair(pair)) for pair in self.model.pairs}
        return replace(
            found, provenance=made_by, interrupted=interrupted, statistics=statistics,
            stop_powers=powers,
        )  # fmt: skip

    def _pair(self, pair: Pair) -> PairResponse:
        known, sides = of_pair(pair.name), [stop.name for stop in pair.stops]
        found: dict[str, Estimate | None] = {
            name: None
            if name in ("collision_rate_lower", "collision_rate_upper")
            and name.removeprefix("collision_rate_") not in sides
            else self.estimate(quantity, name)
            for name, quantity in known.items()
        }
        hit = self.fine.evaluate(known["collision_rate"])[0] > 0.0
        found |= self._of_fast_impacts(pair, found)
        known_mean = hit and not self._mean_is_unknown(pair)
        found["impact_speed_mean"] = self._speed_mean(pair, found) if known_mean else None
        if pair.relative:
            for name, quantity in of_gap(pair).items():
                found[name] = self.estimate(quantity)
        if hit and not pair.rigid:
            pressed = {
                name: self.estimate(quantity, name)
                for name, quantity in of_compliant_pair(pair).items()
            }
            if "peak_force" in pressed:
                pressed["peak_force"] = _of_few_impacts(pressed["peak_force"], found)
            found |= _with_largest_bias(
                {name: each for name, each in pressed.items() if not math.isnan(each.value)}
            )
        found |= self._sums_unseen(pair, found)
        # last, as means per impact are made of the numbers as they were seen
        found |= {
            name: of_events(each, self.fine.count)
            for name, each in found.items()
            if name in EVENTS and each is not None
        }
        return PairResponse(**found, speed_threshold=self.layout.thresholds[pair.name])

    def _of_fast_impacts(
        self, pair: Pair, known: Mapping[str, Estimate | None]
    ) -> dict[str, Estimate | None]:
        """Rates with their bias where slow impacts would leave it unknown, but are few."""
        share = self._share_of_slow_impacts(pair)
        if share > FEW_SLOW:
            return {}
        found, rates = dict[str, Estimate | None](), of_pair(pair.name)
        slow = share * self.fine.evaluate(rates["collision_rate"])[0]
        for name, quantity in rates.items():
            each = known[name]
            if each is None or each.bias is not None:
                continue
            change, change_error = self.difference(quantity)
            found[name] = replace(
                each,
                bias=bias_of_fast_impacts(abs(change), slow),
                bias_error=bias_of_fast_impacts(change_error, 0.0),
                how=f"{self._paths}; bias from {self.pairs.count} paths at twice the step, and "
                f"from at most {100.0 * share:.2g} % slow impacts",
            )
        return found

    def _impacts(self, pair: Pair) -> tuple[float, float, float]:
        """Rate of the counted impacts of a pair, F1 and F2."""
        known = of_pair(pair.name)
        rate, first, second = (
            self.fine.evaluate(known[name])[0]
            for name in ("collision_rate", "impact_speed_rate", "impact_speed_square_rate")
        )
        return rate, first, second

    def _barrier(self) -> float:
        """Highest barrier between the wells that the spring of one oscillator and its load have
        between the stops, in units of m E v^2; 0 without one, or where the spring is no function.
        """
        if len(self.model.coordinates) > 1 or not self.model.functions:
            return 0.0
        model = model_of(self.scene)  # the model of a plan has lost the force of the spring
        if model.restoring is None:
            return 0.0
        known = of_coordinate(*model.coordinates)
        mean, std, square = (
            self.fine.evaluate(known[name])[0]
            for name in ("displacement_mean", "displacement_std", "velocity_mean_square")
        )
        low, high = mean - FARTHEST * std, mean + FARTHEST * std
        x = np.linspace(max(low, model.lower_position), min(high, model.upper_position), PLACES)
        energy = np.cumsum(model.restoring(x) - model.load) * (x[1] - x[0])
        before, after = (np.minimum.accumulate(each) for each in (energy, energy[::-1]))
        return float(np.max(energy - np.maximum(before, after[::-1]))) / square

    def _mean_is_unknown(self, pair: Pair) -> bool:
        """Whether F1 is more than the counted impacts have."""
        return more_than_counted(*self._impacts(pair))

    def _share_of_slow_impacts(self, pair: Pair) -> float:
        """Largest share of the impacts of a pair that twice the step may not resolve."""
        model = self.model
        if model.drives or any(part.white_modulation for part in model.functions):
            return 1.0
        rate, first, second = self._impacts(pair)
        if rate == 0.0:
            return 1.0
        row = pair.direction @ model.modal.shapes
        # without noise on the gap, rounding may leave a little below 0
        intensity = max(float(row @ model.modal.white @ row), 0.0)
        slow = RESOLVED * math.sqrt(2.0 * intensity * self.plan.step)
        return share_below(slow, first / rate, second / rate)

    def _sums_unseen(
        self, pair: Pair, known: Mapping[str, Estimate | None]
    ) -> dict[str, Estimate | None]:
        """F1 and F2 with upper limits where no impact was seen: the limit of the rate times the
        mean speed and its mean square, those of a Gaussian motion that crosses a level."""
        speed = self.plan.speeds[self.model.pairs.index(pair)]
        means = {
            "impact_speed_rate": math.sqrt(math.pi / 2.0) * speed,
            "impact_speed_square_rate": 2.0 * speed**2,
        }
        limit = self._limit_unseen("collision_rate")
        return {
            name: replace(each, upper_95=limit * means[name])
            for name, each in known.items()
            if name in means and each is not None and each.value == 0.0
        }

    def _speed_mean(self, pair: Pair, known: Mapping[str, Estimate | None]) -> Estimate:
        """Mean impact speed, m/s, which is F1 over the rate.

        The relative biases of F1 and the rate are added: they may cancel in the difference to twice
        the step without being zero.
        """
        mean = _of_few_impacts(self.estimate(speed_mean(pair.name), "impact_speed_mean"), known)
        parts = [known[name] for name in ("impact_speed_rate", "collision_rate")]
        relative = [
            None if part.bias is None else part.bias / part.value
            for part in parts
            if isinstance(part, Estimate)
        ]
        unseen = mean.bias is None and self.plan.step_bias("impact_speed_mean", 0.0) is not None
        if unseen or None in relative:
            return replace(mean, bias=None)
        bias = mean.value * sum(part for part in relative if part is not None)
        rate = known["collision_rate"]
        if mean.bias is not None or rate is None:
            return replace(mean, bias=bias)
        bias_error = mean.value * rate.bias_error / rate.value
        return replace(mean, bias=bias, bias_error=bias_error, how=rate.how)

    def _rate_of_all(self) -> float:
        """Impacts per second on all pairs together."""
        rates = (of_pair(pair.name)["collision_rate"] for pair in self.model.pairs)
        means = self.fine.uncontrolled.means()
        return sum(rate(means) for rate in rates)

    def _identities(self) -> dict[str, Estimate]:
        origin = [self.layout.origins[name] for name in self.model.coordinates]

        def balances(means: Means) -> list[float]:
            return list(residuals(self.model, means, origin).values())

        names = residuals(self.model, self.fine.means(), origin)
        fine = self.fine.evaluate_all(balances)
        changes = fine if self.plan.elastic else self.pairs.differences(balances, self.fine)
        return {
            name: self._stated("", one, lambda change=change: change)  # type: ignore[misc]
            for name, one, change in zip(names, fine, changes, strict=True)
        }

    def _acceleration(self, name: str) -> Estimate | None:
        """Absolute acceleration of a coordinate or point, between impacts on rigid stops."""
        model = self.model
        if (name, "aa") in self.layout.rows:
            return self.estimate(acceleration_std(name))
        if not all(pair.rigid for pair in model.pairs) or beyond_one_oscillator(model):
            return None
        # E x v = 0 also where impacts turn v, as they leave x where it is
        if not model.moving_base or model.noise_on_mass:
            return None
        (x,) = model.coordinates
        b, stiff = model.damping_rate, model.omega**2
        return self.estimate(lambda m: math.sqrt(b**2 * m[x, "vv"] + stiff**2 * m[x, "variance"]))

    def _assumptions(self) -> list[str]:
        plan = self.plan
        return [
            f"{plan.method}, step {plan.step:.3g} s, burn-in {plan.burn_in:.3g} s per path",
            "standard errors from independent paths (delta method)",
            *([BETWEEN_IMPACTS] if self._accelerates_at_rigid_stops else []),
        ]

    @property
    def _accelerates_at_rigid_stops(self) -> bool:
        """Whether accelerations are given that leave the impulses of rigid stops out."""
        rigid = any(stop.rigid for stop in self.model.stops)
        return rigid and self._acceleration(self.model.coordinates[0]) is not None

    def _warnings(self) -> Iterator[str]:
        if len(self.machines) > 1:
            yield (
                f"blocks were simulated on {len(self.machines)} kinds of machines: another "
                "run agrees within the standard errors, not in every digit ("
                + "; ".join(self.machines)
                + ")"
            )
        pairs = self.model.pairs
        if pairs and self.model.sines:
            yield (
                "a sine between stops may keep several regimes, which paths leave rarely: compare "
                "with a longer duration"
            )
        if self._barrier() > RARELY_PASSED:
            yield (
                "the spring has more than one well: passages between them are rare, the burn-in "
                "may not forget the start, and stated errors need not hold; compare with "
                "fokker-planck, or by check"
            )
        several = len(pairs) > 1
        unknown = not self.plan.elastic and self.plan.step_bias("collision_rate", 0.0) is None
        if unknown and any(
            stop.law.slow_restitution < 1.0 and not collapses(stop)
            for pair in pairs
            for stop in pair.stops
            if self._share_of_slow_impacts(pair) > FEW_SLOW
        ):
            remedy = (
                "--slow-impacts (slow_impacts=True) resolves them"
                if refines_near_stops(self.model)
                else "compare F1 and F2 instead"
            )
            yield (
                "slow impacts at these stops are not resolved: the bias of the rates is unknown, "
                f"that of F1, F2 and the moments is stated; {remedy}"
            )
        for name, residual in self._identities().items():
            if residual.bias is not None and _missed(residual):
                yield (
                    f"the balance of {name} is missed by {abs(residual.value):.2g} of its largest "
                    "term: do not use these numbers"
                )
        unseen = list[tuple[str, str]]()
        for pair in pairs:
            of = f" of {pair.name}" if several else ""
            threshold = self.layout.thresholds[pair.name]
            if threshold > 0.0:
                yield (
                    f"rates{of} count impacts faster than {threshold:.3g} m/s; F1 and F2 count "
                    "all; the mean impact speed is F1 over the rate"
                )
            if self._mean_is_unknown(pair):
                yield NO_MEAN_SPEED.replace(" is given", f"{of} is given")
            for stop in pair.stops:
                if collapses(stop):
                    yield (
                        f"{stop.slow_impacts_see} at the {stop.name} stop{of} is "
                        f"below {COLLAPSE_RESTITUTION:.4f}: the rate of all impacts is infinite "
                        "under white noise; rates above a speed threshold are given, rel_error "
                        "does not govern them"
                    )
                rate = of_pair(pair.name)[f"collision_rate_{stop.name}"]
                if self.fine.evaluate(rate)[0] == 0.0:
                    unseen.append((stop.name, pair.name))
            seen = self.fine.evaluate(of_pair(pair.name)["collision_rate"])
            if seen[0] > 0.0 and not events_suffice(*seen, self.fine.count):
                yield (
                    f"impacts{of} were seen {TOO_FEW}: their rates have upper limits only; more "
                    "paths or a longer duration tell more"
                )
        yield from without_impact(unseen, self.exposure)


def _of_few_impacts(mean: Estimate, known: Mapping[str, Estimate | None]) -> Estimate:
    """A mean per impact, with the error that the delta method does not see where few paths hit.

    To first order a single path with impacts has no spread at all. With the relative error e of the
    rate, as many impacts as 1 / e^2 independent ones are known. A mean over so few of them is
    not trusted to less than e^2 of itself: all of it for one, 1 % for a hundred.
    """
    rate = known["collision_rate"]
    assert rate is not None
    unseen = (rate.standard_error / rate.value) ** 2 * mean.value
    return replace(mean, standard_error=math.hypot(mean.standard_error, unseen))


def _with_largest_bias(group: Mapping[str, Estimate]) -> dict[str, Estimate]:
    """Return the same estimates, each with the largest relative bias among them.

    The difference of one quantity between the two steps may vanish by chance.
    """
    if any(each.bias is None for each in group.values()):
        return dict(group)
    relative = [(each.bias or 0.0) / abs(each.value) for each in group.values() if each.value]
    largest = max(relative, default=0.0)
    return {name: replace(each, bias=largest * abs(each.value)) for name, each in group.items()}


MISSED_BALANCE = 0.1
"""Residual of a balance from which on an answer says that it is wrong, if no error explains it."""


def _missed(residual: Estimate) -> bool:
    """Whether a balance does not hold, far beyond its errors."""
    explained = 4.5 * residual.standard_error + (residual.bias or 0.0)
    return abs(residual.value) > explained + MISSED_BALANCE


def run_until_accurate(simulation: Simulation, rel_error: float) -> None:
    """Add paths until every governed quantity has the relative error `rel_error`."""
    remaining, pilot = choose_step(simulation, rel_error)
    deadline = simulation.run.deadline
    if deadline.passed() and pilot is not None and pilot.fine.count > 1:
        raise deadline.fell_short(
            f"after {pilot.fine.count} paths of the pilot that chooses the step",
            "raise budget",
            pilot_answer(simulation, pilot),
        )
    short = ("the accuracy asked for was not reached",)

    def more() -> int:
        errors = max(relative_standard_errors(simulation).values())
        return more_paths(simulation.fine.count, errors, rel_error)

    simulation.add_paths(max(simulation.plan.block, FEWEST_PATHS), more, rel_error)
    if simulation.fine.count < 2:
        raise deadline.fell_short("before two paths were simulated", "raise budget")
    errors = max(relative_standard_errors(simulation).values())
    if errors > rel_error:
        needed = simulation.seconds * (errors / rel_error) ** 2
        raise deadline.fell_short(
            f"at a relative standard error of {errors:.2g}, asked for {rel_error:g}, which "
            f"takes about {needed:.0f} s of simulation",
            "raise budget or rel_error",
            simulation.response(short),
        )
    if simulation.fine.count < FEWEST_PATHS:
        raise deadline.fell_short(
            f"after {simulation.fine.count} paths, too few to know a standard error",
            "raise budget",
            simulation.response(short),
        )
    if remaining > rel_error:
        raise NotConverged(
            f"the shortest step leaves a relative bias of {remaining:.2g} by the step, "
            f"asked for {rel_error:g}; raise rel_error",
            simulation.response(short),
        )


def pilot_answer(simulation: Simulation, pilot: Simulation) -> Response:
    """What a pilot says, as the answer so far of a simulation that has no paths yet."""
    pilot.seed = simulation.seed
    interrupted = simulation.run.deadline.interrupted
    warning = f"these are the {pilot.fine.count} paths of the pilot that chooses the step"
    return pilot.response((warning,), interrupted)


def choose_step(simulation: Simulation, rel_error: float) -> tuple[float, Simulation | None]:
    """Refine the plan of a simulation, before its first path, as far as `rel_error` needs; returns
    the relative bias that is left, if it is larger, and the last pilot.

    A pilot of paths of its own (PILOT_SEED) is simulated at both steps, until its bias is clearly
    above or below `rel_error`, or it takes PILOT_SHARE of the paths of the run, when the estimate
    of the bias, less its standard error, decides: the largest of several estimates is as large as
    their errors where there is no bias. The choice is the same for every seed of the run. A run
    that resumes repeats it.
    """
    while not simulation.plan.elastic:
        last = simulation.refinements == MOST_REFINEMENTS
        pilot, bias = _pilot(simulation, rel_error, last)
        if bias <= rel_error:
            return 0.0, pilot
        if last:
            return largest_bias(pilot, SIGNIFICANT), pilot
        simulation.refine()
    return 0.0, None


def _pilot(simulation: Simulation, rel_error: float, last: bool) -> tuple[Simulation, float]:
    """A pilot at the step, with its relative bias; 0 where it is small enough, or its time ends.
    At the `last` step it does not end early for a large one."""
    speak = simulation.run.progress
    run = replace(
        simulation.run,
        progress=speak and partial(_say_pilot, speak),
        deadline=simulation.run.deadline.sooner(1.0 - PILOT_TIME),
    )
    pilot = Simulation(simulation.scene, simulation.plan, run, 0.0, PILOT_SEED, all_pairs=True)

    def judged() -> tuple[bool, float]:
        """Whether the paths suffice, and the bias."""
        errors = max(relative_standard_errors(pilot).values())
        most = pilot.fine.count * (errors / rel_error) ** 2
        suffice = pilot.fine.count >= PILOT_SHARE * max(most, 2.0 * pilot.plan.block)
        if largest_bias(pilot, -1.0) <= rel_error:
            return True, 0.0
        bias = largest_bias(pilot, 1.0 if suffice else SIGNIFICANT)
        return suffice or (bias > rel_error and not last), bias

    try:
        enough = pilot.add_paths(
            max(FEWEST_PATHS, pilot.plan.block // 4), lambda: 0 if judged()[0] else pilot.fine.count
        )
    except NotConverged:
        return pilot, 0.0  # the answer will say that the budget was too short
    except KeyboardInterrupt:
        simulation.run.latest = run.latest  # the paths of the pilot are an answer so far
        raise
    return pilot, judged()[1] if enough else 0.0


def _say_pilot(progress: Progress, done: float, sentence: str) -> None:
    """Report what a pilot does, at the beginning of its run."""
    progress(0.0, f"choosing the step, {sentence}")


def largest_bias(run: Simulation, errors: float) -> float:
    """Largest relative bias of a governed quantity, less so many of its standard errors."""
    biases = [0.0]
    for key, quantity, size in _with_sizes(run):
        # half the step would hardly improve the rates at inelastic stops: their bias is stated only
        if key[1] in RATES:
            continue
        change, change_error = run.difference(quantity)
        bias = run.plan.step_bias(key[1], max(0.0, abs(change) - errors * change_error))
        biases.append(bias / size if bias else 0.0)
    return max(biases)


def relative_standard_errors(run: Simulation) -> dict[Key, float]:
    """Relative standard errors of the governed quantities that are not zero."""
    return {key: run.fine.evaluate(quantity)[1] / size for key, quantity, size in _with_sizes(run)}


AT_REST = 1e-20
"""A coordinate is at rest, but for rounding, where its mean kinetic energy is below this share of
the largest of all coordinates."""


def _with_sizes(run: Simulation) -> Iterator[tuple[Key, Quantity, float]]:
    """Governed quantities, each with the size to which its error is relative: the quantity itself,
    or for a mean the standard deviation. Those that are 0 are left out, and those of coordinates at
    rest."""

    def size_of(quantity: Quantity) -> float:
        return abs(run.fine.evaluate(quantity)[0])

    energies = {
        name: mass * size_of(of_coordinate(name)["velocity_mean_square"])
        for name, mass in zip(run.model.coordinates, np.diag(run.model.mass), strict=True)
    }
    least = AT_REST * max(energies.values())
    for (owner, name), quantity in governed(run.model).items():
        deviates = name == "displacement_mean"
        size = size_of(of_coordinate(owner)["displacement_std"] if deviates else quantity)
        if size > 0.0 and energies.get(owner, least) >= least:
            yield (owner, name), quantity, size


# ------------------------------------------------------------------------------
# Monte Carlo of a scene: `simulate`, the prediction of its cost, and single recorded paths.
# ------------------------------------------------------------------------------


PILOT_SECONDS, LEAST_PILOT_SECONDS = 1.5, 0.2
"""Seconds that the pilot run of `prospect` takes at most, without compilation, and seconds that it
gets where no time is left."""

LARGEST_PRICE_IN_PILOT = 0.5
"""Share of the seconds of a pilot that its first two paths may take."""

FEWEST_IN_PILOT = 16
"""Fewest paths from which the pilot predicts a price: the price goes as the square of errors, which
16 paths give to 18 %, so that it is good to 40 %."""


@calculation
@sampled
def simulate(
    scene: Scene,
    *,
    speed_threshold: float | None = None,
    slow_impacts: bool = False,
    statistics: Mapping[str, Statistic] | None = None,
    **options: Unpack[SamplingOptions],
) -> Response:
    """Stationary response by Monte Carlo, with standard errors from independent paths.

    White noise is stepped by kick-flow-kick (impacts inside the step, no bias with elastic
    stops); for a tabulated density the response without stops is synthesised and the impacts are
    added. The bias of a finite step is measured by running some of the paths at twice the step,
    with the same noise: |difference| / (2^order - 1). The order is 2, less where slow impacts on
    inelastic stops in white noise are missed: *The bias of a step* in the manual has them. Where it
    is not known the bias is None.

    Parameters
    ----------
    scene
        The scene.
    speed_threshold
        Impacts slower than this (m/s) are left out of the rates, never out of F1 and F2. By
        default 0, or 5 % of the rms velocity where a stop loses energy, by the rule of all
        methods (*Conventions* in the manual).
    slow_impacts
        Refine the steps near a stop until impacts at the threshold are resolved, for the rates
        under white noise at restitutions below 0.5. With several coordinates all steps are a
        sixteenth of the usual ones. Ten or more times the cost; without it the
        bias of those rates is unknown (None). F1 and the moments need it only for small errors,
        and get it then by themselves.
    statistics
        Functions of the motion by name, see `Statistic`, of which the answer gives the means over
        time in `statistics`. `rel_error` does not govern them: their errors are stated.
    **options
        `SamplingOptions`: `rel_error` (0.01 if `paths` is not given either) is that of mean
        squares, rate, F1 and F2, and of means relative to the standard deviation; or `paths` of
        `duration` seconds each; `seed`, `threads`, `executor`, `budget`, `progress`,
        `checkpoint`, `resume`.

    Returns
    -------
    Response
        Moments, rates and their errors, SI units.

    Raises
    ------
    NotApplicable
        With every condition that the scene does not meet.
    NotConverged
        Carries the response so far; also if the executor loses its workers.
    CheckpointError
        If `resume` is damaged, or of another scene, seed, version or processor; or `checkpoint`
        cannot be written, or is a file of something else.
    Interrupted
        A KeyboardInterrupt that carries the response so far.

    See Also
    --------
    stochvi.check : Whether all methods agree.
    stochvi.cost : Error against time.

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
    >>> deviation = simulate(scene, rel_error=0.01).coordinates["x"]["displacement_std"]
    >>> abs(deviation.value - 0.53956) < 4.5 * deviation.standard_error
    True
    """
    check_threshold(speed_threshold)
    run = Run.of(options)
    try:
        plan = make_plan(
            model_of(scene), speed_threshold, run.duration, slow_impacts,
            deadline=run.deadline, statistics=statistics,
        )  # fmt: skip
        run.begin()
        simulation = Simulation(scene, plan, run, compiled(plan), run.seed)
    except KeyboardInterrupt as reason:
        where = "before any path was simulated"
        raise run.deadline.ended_by_exception(reason, where) from None
    try:
        if run.paths is None:
            run_until_accurate(simulation, 0.01 if run.rel_error is None else run.rel_error)
        elif not simulation.add_paths(run.paths):
            raise run.deadline.fell_short(
                f"after {simulation.fine.count} of {run.paths} paths{simulation.cut()}",
                "raise budget",
                _so_far(simulation, "not all paths were simulated"),
            )
    except WorkersLost as error:
        lost = _so_far(simulation, "not all paths were simulated, for want of workers")
        raise NotConverged(f"{error}, after {simulation.fine.count} paths", lost) from error
    except (NotConverged, Interrupted):
        raise
    except KeyboardInterrupt as reason:  # a second Ctrl-C, or one that a program raises
        by_clock = isinstance(reason, Overdue)
        why = "not all" if by_clock else "interrupted before all"
        answer = _so_far(simulation, f"{why} paths were simulated", not by_clock)
        raise run.deadline.ended_by_exception(reason, "on the way", answer) from None
    return simulation.response()


def _so_far(simulation: Simulation, warning: str, interrupted: bool = False) -> Response | None:
    """What the paths say that there are, if they say anything."""
    latest = simulation.run.latest
    if isinstance(latest, PathsOf):
        simulation.sample = latest
    if simulation.fine.count < 2:
        return None
    count = simulation.fine.count
    return simulation.response((f"{warning}: these are the first {count}",), interrupted)


@calculation
def record_path(
    scene: Scene,
    *,
    duration: float,
    seed: int = 0,
    rng: Random = None,
    path: int = 0,
    step: float | None = None,
    budget: float | None = None,
) -> DataFrame:
    """One path, sample by sample: time (s), displacement, velocity and impact_speed (SI).

    `impact_speed` is the incident speed of an impact within the step that ends at `time`,
    positive at the upper stop, negative at the lower, 0 for none (several: their sum). The path
    is not stationary at its start: it begins at a guess of the stationary distribution. With
    several coordinates each column names its own, as in "displacement of absorber".

    Parameters
    ----------
    scene
        The scene.
    duration
        Seconds of each path after burn-in.
    seed, rng
        Seed of the random numbers: the same seed gives the same digits. Or what draws one, a
        Generator of numpy.
    path
        Number of the path.
    step
        Time between two samples, s.
    budget
        Seconds after which `NotConverged` is raised; None for no limit.

    Returns
    -------
    DataFrame
        A row for each combination, or for each sample.

    See Also
    --------
    stochvi.history : Displacement, base, forces and impacts, as a table.

    Examples
    --------
    >>> from stochvi.scenes.excitations import WhiteNoise
    >>> from stochvi.scenes.structures import Oscillator
    >>> scene = Scene(
    ...     structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
    ...     excitations=[WhiteNoise(intensity=0.2)],
    ... )
    >>> list(record_path(scene, duration=10.0))
    ['time', 'displacement', 'velocity', 'impact_speed']
    """
    check_options({"duration": duration, "seed": seed})
    if step is not None and not 0.0 < step < math.inf:
        raise ValueError(f"step must be a positive number of seconds, got {step}")
    if not 0 <= path < 2**40:
        raise ValueError(f"path must be in [0, 2^40), got {path}")
    plan = make_plan(model_of(scene), None, duration)
    _check_record(plan, plan.step if step is None else step, 1)
    if step is not None:
        plan = plan.with_step(step)
    columns = plan.record(seed, path)
    samples = len(next(iter(columns.values())))
    return frame_of({"time": plan.step * np.arange(1, samples + 1), **columns})


def _check_record(plan: Plan, step: float, paths: int) -> None:
    """Raise ValueError where the records of so many paths would not fit into the memory."""
    if paths < 1:
        raise ValueError(f"paths must be at least 1, got {paths}")
    samples = min((plan.burn_in + plan.duration) / step, 2.0 * MOST_RECORDED)
    each = plan.record_size(math.ceil(samples))
    check_size(
        "numbers of all records", paths * each, MOST_RECORDED, "give a shorter duration or fewer "
        "paths, or a larger step"
    )  # fmt: skip


@calculation
def record_paths(
    scene: Scene,
    *,
    duration: float,
    paths: int,
    seed: int = 0,
    rng: Random = None,
    first_path: int = 0,
    budget: float | None = None,
) -> tuple[float, list[DataFrame]]:
    """Several paths of a scene of several coordinates at once, as `record_path` gives one.

    Returns the time, s, after which they have settled, and the records, `duration` longer.

    Parameters
    ----------
    scene
        The scene.
    duration
        Seconds of each path after burn-in.
    paths
        Number of paths.
    seed, rng
        Seed of the random numbers: the same seed gives the same digits. Or what draws one, a
        Generator of numpy.
    first_path
        Number of the first path.
    budget
        Seconds after which `NotConverged` is raised; None for no limit.

    Returns
    -------
    tuple[float, list[pd.DataFrame]]
        Burn-in, s, and a table for each path.

    See Also
    --------
    stochvi.history : One path, as a table.

    Examples
    --------
    >>> import stochvi
    >>> scene = stochvi.load_scene(stochvi.scenes.shipped_scene("absorber-in-a-box"))
    >>> burn_in, tables = record_paths(scene, paths=2, duration=1.0)
    >>> [bool(each["time"].iloc[-1] >= burn_in) for each in tables]
    [True, True]
    """
    check_options({"duration": duration, "seed": seed})
    model = model_of(scene)
    settling = plan_several(model, None, duration).burn_in
    plan = plan_several(model, None, settling + duration)
    _check_record(plan, plan.step, paths)
    record = np.zeros((plan.steps, paths, plan.record_width))
    plan.averages(seed, first_path, paths, record)
    time = {"time": plan.step * np.arange(1, plan.steps + 1)}
    return settling, [frame_of(time | plan.columns(record[:, [path]])) for path in range(paths)]


@dataclass(frozen=True, kw_only=True)
class Prospect:
    """What a simulation would be like: its states and steps, and what they cost here and now.

    `nanoseconds_per_step` is wall time per step of one path, all threads at work; `seconds` maps
    relative errors to predicted wall time, None where no impact was seen to predict by.
    `seconds_between` maps them to its least and largest value, which differ where this pilot does
    not decide how often a run would halve its step. Before that each run takes `start_seconds`: for
    its plan and the loading of its kernels, and of a command for the start of the process and the
    reading of the scene as well.

    See Also
    --------
    stochvi.methods.monte_carlo.prospect : The calculation.
    """

    method: str
    states: int
    step: float
    burn_in: float
    duration: float
    steps_per_path: int
    nanoseconds_per_step: float
    seconds: dict[float, float | None]
    governed_by: str
    seconds_between: dict[float, tuple[float, float]] = field(default_factory=dict)
    start_seconds: float = 0.0


@calculation
def prospect(
    scene: Scene,
    *,
    threads: int | None = None,
    seed: int = 0,
    rng: Random = None,
    budget: float | None = None,
) -> Prospect:
    """Predict the cost of `simulate` from a pilot run.

    Standard errors fall with the square root of the scene time: the pilot tells the time of a step
    and the errors of its paths, from which follow the rounds that the run would make, and those of
    the pilot that chooses its step. The quantity that converges last governs them.

    Parameters
    ----------
    scene
        The scene.
    threads
        Number of threads; by default all cores.
    seed, rng
        Seed of the random numbers: the same seed gives the same digits. Or what draws one, a
        Generator of numpy.
    budget
        Seconds that the pilot may take; `PILOT_SECONDS` at most.

    Returns
    -------
    Prospect
        States, steps and predicted times.

    See Also
    --------
    stochvi.simulate : The simulation itself.
    stochvi.cost : Error against time, measured.

    Examples
    --------
    >>> import stochvi
    >>> scene = stochvi.load_scene(stochvi.scenes.shipped_scene("oscillator-lossy"))
    >>> expected = prospect(scene, threads=1)
    >>> expected.states
    2
    """
    deadline, model = Deadline.after(budget), model_of(scene)
    began = _clock()
    plan = make_plan(model)
    compile_time = compiled(plan)
    if not plan.elastic:
        compiled(plan.coarser())
    start = _clock() - began
    seconds = max(min(PILOT_SECONDS, deadline.left), LEAST_PILOT_SECONDS)
    price = seconds_of_first_paths(plan, seed, Deadline.after(seconds))
    with pool_of(None, threads) as pool:
        run = Run(pool, Deadline.after(seconds))
        simulation = Simulation(scene, plan, run, compile_time, seed)
        pilot = PricedRounds(simulation)
        # a pilot of two or three paths would say nothing of errors
        with suppress(NotConverged):
            if price < LARGEST_PRICE_IN_PILOT * seconds:
                simulation.add_paths(pilot.first, pilot.more)
    step_seconds = (
        pilot.step_seconds if simulation.steps else price / (FEWEST_AT_ONCE * plan.steps_per_path)
    )
    relative = (
        relative_standard_errors(simulation) if simulation.fine.count >= FEWEST_IN_PILOT else {}
    )
    slowest = max(relative, key=lambda key: relative[key], default=None)
    unseen = any((pair.name, "impact_speed_rate") not in relative for pair in model.pairs)
    if slowest is None:
        governed_by = f"not even {FEWEST_IN_PILOT} paths were simulated in {seconds:.2g} s"
    else:
        governed_by = "no impact was seen" if unseen else _spoken(model, slowest)
    known = slowest is not None and not unseen
    targets = (0.01, 0.001)
    return Prospect(
        method=plan.method,
        states=plan.states,
        step=plan.step,
        burn_in=plan.burn_in,
        duration=plan.duration,
        steps_per_path=plan.steps_per_path,
        nanoseconds_per_step=1e9 * step_seconds,
        start_seconds=start,
        seconds={
            target: pilot.seconds_to(target, relative[slowest]) if known and slowest else None
            for target in targets
        },
        seconds_between={
            target: pilot.seconds_between(target, relative[slowest])
            for target in targets
            if known and slowest
        },
        governed_by=governed_by,
    )


KNOWN_ERROR, KNOWN_PATHS = 0.05, 256
"""Relative error and number of paths from which on a pilot knows errors well: an error of 5 % is
that of 400 independent events."""


SLOW_IMPACTS_PRICE = 10.0
"""Price of a path whose slow impacts are resolved, over that of one at the usual steps."""


def _clock() -> float:
    """Seconds on a clock that stands still while kernels are compiled."""
    return time.time() - stood_still()


class PricedRounds:
    """The rounds of a pilot with their times, and the price of a run that follows from them."""

    def __init__(self, simulation: Simulation) -> None:
        self.simulation, self.plan = simulation, simulation.plan
        self.first = max(self.plan.block, FEWEST_PATHS)
        self.began = _clock()
        self.ends: list[tuple[float, int]] = []

    def more(self) -> int:
        """The paths to add after a round: as many as there are until errors are known."""
        simulation = self.simulation
        count = simulation.fine.count
        self.ends.append((_clock() - self.began, simulation.steps))
        errors = max(relative_standard_errors(simulation).values(), default=math.inf)
        known = count >= KNOWN_PATHS and errors <= KNOWN_ERROR and len(self.ends) > 1
        return 0 if known else max(count, self.first * simulation.run.workers)

    @property
    def step_seconds(self) -> float:
        """Wall time of a step of one path, s, with all workers at work."""
        return self._of_worker / self.simulation.run.workers

    @property
    def _of_worker(self) -> float:
        """Time of a worker for a step of one path, s. The first round has a block alone, and the
        time in which the budget is compared with the price of the first paths."""
        simulation = self.simulation
        took, steps, blocks = _clock() - self.began, simulation.steps, 1.0
        if self.ends:
            took, steps = self.ends[-1]
        if len(self.ends) > 1:
            (before, made), *_ = self.ends
            blocks = (simulation.fine.count - self.first) / self.plan.block / (len(self.ends) - 1)
            took, steps = took - before, steps - made
        return took / steps * min(max(blocks, 1.0), simulation.run.workers)

    @property
    def _before_round(self) -> float:
        """Seconds by which the first round is longer than its steps: those of trials of the first
        paths."""
        if len(self.ends) < 2:
            return 0.0
        took, steps = self.ends[0]
        return max(0.0, took - steps * self._of_worker)

    def seconds_between(self, target: float, error: float) -> tuple[float, float]:
        """The least and the largest of `seconds_to` for biases within two of their errors."""
        found = [self.seconds_to(target, error, shift) for shift in (-2.0, 0.0, 2.0)]
        return min(found), max(found)

    def seconds_to(self, target: float, error: float, shift: float = 0.0) -> float:
        """Wall time of a run to a relative error, where the pilot has this one. A `shift` makes
        biases larger by so many of their standard errors."""
        simulation, plan = self.simulation, self.plan
        exposure = simulation.exposure / plan.duration
        error *= math.sqrt(exposure)  # of one whole path
        spent, halvings = (0.0, 0) if plan.elastic else self._of_pilots(target, error, shift)
        paths = self.first
        price, share = self._price_of(halvings)
        spent += self._before_round + price * self._of_round(paths, share)
        while more := more_paths(paths, error / math.sqrt(paths), target):
            spent += price * self._of_round(more, share)
            paths += math.ceil(more / plan.block) * plan.block
        return spent

    def _of_round(self, paths: int, share: float) -> float:
        """Wall time of a round of paths, of which a share is simulated at twice the step too."""
        blocks = paths / self.plan.block
        if blocks > 1.0:
            workers = self.simulation.run.workers
            blocks = (
                math.ceil(blocks / workers) if blocks < workers else math.ceil(blocks) / workers
            )
        each = self.plan.steps_per_path * (1.0 if self.plan.elastic else 1.0 + share / 2.0)
        return blocks * self.plan.block * each * self._of_worker

    def _price_of(self, halvings: int) -> tuple[float, float]:
        """The price of a path after so many refinements of the plan, over that of one before, and
        the share of the paths that are simulated at twice the step too."""
        if halvings and self.plan.finer().steps_per_path == self.plan.steps_per_path:
            return SLOW_IMPACTS_PRICE * 2.0 ** (halvings - 1), 1.0  # slow impacts are resolved
        return 2.0**halvings, self.plan.coarse_share

    def _of_pilots(self, target: float, error: float, shift: float) -> tuple[float, int]:
        """Wall time of the pilots that choose the step, and how often they halve it, as
        `choose_step` would: with the biases of this pilot, a quarter at half the step."""
        share = shift / math.sqrt(max(1, self.simulation.pairs.count))
        biases = [(max(0.0, bias + share * each), each) for bias, each in self._biases()]
        spent = 0.0
        enough = PILOT_SHARE * max((error / target) ** 2, 2.0 * self.plan.block)
        for halvings in range(MOST_REFINEMENTS + 1):
            last = halvings == MOST_REFINEMENTS
            scale = 0.25**halvings
            paths = max(FEWEST_PATHS, self.plan.block // 4)
            while True:
                suffice = paths >= enough
                low, high = (
                    max(
                        (scale * (bias + sign * each / math.sqrt(paths)) for bias, each in biases),
                        default=0.0,
                    )
                    for sign in (-1.0 if suffice else -SIGNIFICANT, 1.0)
                )
                if high <= target or suffice or (low > target and not last):
                    break
                paths += math.ceil(paths / self.plan.block) * self.plan.block
            price, _ = self._price_of(halvings)
            spent += self._before_round + price * self._of_round(paths, 1.0)
            if high <= target or low <= target or last:
                return spent, halvings
        raise AssertionError("the last step ends the search")

    def _biases(self) -> list[tuple[float, float]]:
        """Relative biases of the governed quantities at the step, and their standard errors from
        one path at both steps."""
        simulation, found = self.simulation, []
        pairs = simulation.pairs.count
        for key, quantity, size in _with_sizes(simulation) if pairs > 1 else ():
            change, error = simulation.difference(quantity)
            bias, spread = (self.plan.step_bias(key[1], each) for each in (abs(change), error))
            if key[1] not in RATES and bias is not None and spread is not None:
                found.append((bias / size, spread / size * math.sqrt(pairs)))
        return found


def _spoken(model: Model, key: Key) -> str:
    """Name of a quantity in words, with its coordinate or pair where the scene has several."""
    owner, name = key
    return name if model.single else f"{name} of {owner}"


def check_threshold(speed_threshold: float | None) -> None:
    """Raise ValueError for a speed threshold that is none."""
    if speed_threshold is not None and not 0.0 <= speed_threshold < math.inf:
        raise ValueError(f"speed_threshold must be at least 0, got {speed_threshold}")


def compile_kernels(scene: Scene) -> None:
    """Compile what a simulation of the scene runs, so that no budget pays for it."""
    compiled(make_plan(model_of(scene)))


def compiled(plan: Plan) -> float:
    """Run the kernels once on very short paths; returns the seconds this took (machine code is
    cached)."""
    start = time.perf_counter()
    plan.shortest().averages(0, 0, 2)
    return time.perf_counter() - start


__all__ = [
    "Prospect",
    "SamplingOptions",
    "Statistic",
    "prospect",
    "record_path",
    "record_paths",
    "simulate",
]
