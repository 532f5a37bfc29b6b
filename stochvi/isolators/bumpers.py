"""The bumper map: what impacts do to a mass, over the clearance and the stiffness of its stops.
Chapters: contacts of an isolated mass with a stop; the answer; impacts on stops of many
stiffnesses from the same motions; the calculation."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, NamedTuple, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stochvi.engine.sub_steps import CONTACT_ANGLE
from stochvi.isolators.screening import at_clearances, check_movable
from stochvi.isolators.sizing.risk_curve import ACCEPTED
from stochvi.isolators.tolerances import Tolerances, changed_stops
from stochvi.mathematics.numerics import Matrix, Vector
from stochvi.mathematics.units import (
    ACCELERATION,
    LENGTH,
    STIFFNESS,
    outside_of_share,
    shown,
    spoken_mission,
)
from stochvi.model.coverage import beyond_one_oscillator, free_motion
from stochvi.model.model import Model, model_of
from stochvi.results.base import DataFrame, Result, frame_of
from stochvi.results.deadline import Deadline
from stochvi.results.errors import NotApplicable, check_size
from stochvi.results.estimates import jackknife_error, provenance, spoken_percent
from stochvi.sampling.calculations import AccuracyOptions, TrialSampler, calculation, given_up_after
from stochvi.sampling.run import Run, sampled
from stochvi.scenes.impact_laws import CompliantLaw
from stochvi.scenes.impact_laws.compliant import LinearLaw
from stochvi.scenes.scene import Scene
from stochvi.statistics.clusters import UNFINISHED, WINDOWS, ClusterPaths, ClustersSoFar
from stochvi.statistics.damage import SpectrumValues
from stochvi.statistics.damage.equipment import exceedance
from stochvi.statistics.damage.simulated import PAST_LARGEST
from stochvi.statistics.hardness import PeakAcceleration

# ------------------------------------------------------------------------------
# Contacts of an isolated mass with a stop, mount and stop together.
# ------------------------------------------------------------------------------


CONTACT_STEPS = 200.0
"""Number of time steps in a contact; its peak is then read off with a relative error of 1e-4."""

TOUCHED = 1e-9
"""Deflection at which a contact begins, in ways of one step: the force of a damper begins with the
contact, and not before it."""


class Contact(NamedTuple):
    """Peak absolute acceleration (m/s^2), deflection of the stop (m), duration (s) and peak force
    per unit mass (N/kg)."""

    peak_acceleration: Vector
    deflection: Vector
    contact_time: Vector
    peak_force: Vector


def contact_on_mount(
    model: Model, law: CompliantLaw, distance: ArrayLike, speed: ArrayLike
) -> Contact:
    """Masses that meet stops `distance` from their mean position at `speed`, the base at rest.

    y'' = -(b y' + omega^2 (distance + y)) - F(y, y') from y = 0, y' = speed until the mass is
    back at y = 0; `law` gives F per unit mass. The peak is that of |y''|, mount and stop together.
    """
    b, stiff = model.damping_rate, model.omega**2
    distance, speed = np.broadcast_arrays(
        np.asarray(distance, dtype=float), np.asarray(speed, dtype=float)
    )
    alone = [law.impact(float(w), 1.0).contact_time for w in (speed.min(), speed.max())]
    # a mount can only shorten a contact, so that none lasts longer than this
    longest = 1.1 * max(alone) + math.pi / model.omega
    step = min(*alone, 1.0 / model.omega) / CONTACT_STEPS

    def total(y: Vector, v: Vector) -> tuple[Vector, Vector]:
        force = law.force_at(y, v)
        return b * v + stiff * (distance + y) + force, force

    y, v = TOUCHED * step * speed, speed.copy()
    inside = np.ones(speed.shape, bool)
    peak, force = total(y, v)
    found = [np.abs(peak), y, np.zeros(speed.shape), force]
    for number in range(math.ceil(longest / step)):
        k1 = -total(y, v)[0]
        k2 = -total(y + 0.5 * step * v, v + 0.5 * step * k1)[0]
        k3 = -total(y + 0.5 * step * v + 0.25 * step**2 * k1, v + 0.5 * step * k2)[0]
        k4 = -total(y + step * v + 0.5 * step**2 * k2, v + step * k3)[0]
        y = y + step * v + step**2 / 6.0 * (k1 + k2 + k3)
        v = v + step / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        inside &= y > 0.0
        if not inside.any():
            break
        y, v = np.where(inside, y, 0.0), np.where(inside, v, 0.0)  # what is back stays back
        all_forces, force = total(y, v)
        # the force ends within the next step
        pushed = np.where(inside & (force > 0.0), (number + 1.5) * step, 0.0)
        new = (np.abs(all_forces), y, pushed, force)
        found = [
            np.maximum(old, np.where(inside, each, 0.0))
            for old, each in zip(found, new, strict=True)
        ]
    return Contact(*found)


def hardest_contact(
    model: Model, stops: Sequence[tuple[CompliantLaw, ArrayLike]], speed: ArrayLike
) -> Contact:
    """The contact with the largest acceleration among those with several stops, each with its law
    and distance, as `contact_on_mount`."""
    first = stops[0]
    alike = all(law == first[0] and np.array_equal(place, first[1]) for law, place in stops)
    several = [first] if alike else stops
    contacts = [contact_on_mount(model, law, distance, speed) for law, distance in several]
    order = np.argmax([each.peak_acceleration for each in contacts], axis=0)
    return Contact(*(np.choose(order, each) for each in zip(*contacts, strict=True)))


# ------------------------------------------------------------------------------
# The answer of `bumper_map`.
# ------------------------------------------------------------------------------


QUANTITIES = (
    "peak_acceleration", "pad_force", "rattle_space", "impact_speed", "energy_per_hit",
    "impacts_per_hour",
)  # fmt: skip
"""The quantities of a map, each with its errors."""


class MapPoint(NamedTuple):
    """A point of a map: clearance (m), factor of the stiffness, and both numbers in the map."""

    clearance: float
    stiffness_factor: float
    row: int
    column: int


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class BumperMap(Result):
    """What impacts do to a mass over clearance and stiffness of its stops.

    Quantities are arrays (clearances, stiffnesses) of values with their errors. The first four are
    exceeded in the mission with the probability `exceedance`. Where no stop is touched at that
    probability, they are those of the motion without stops: force and speed are then 0.

    Parameters
    ----------
    clearance
        Metres per side from the static equilibrium, (clearances,).
    stiffness_factor
        Stiffness of the stops over that of the scene, (stiffnesses,).
    stiffness
        The same in N/m, where the law of the stops is a linear spring; else None.
    mission, exceedance
        Duration, s, and accepted probability.
    sigma
        Rms displacement without stops, m.
    peak_acceleration
        Largest absolute acceleration of the mass in a contact, m/s^2.
    pad_force
        Largest force on a stop, N; per kg where the scene has no mass.
    rattle_space
        Travel: largest distance of the mass from its static equilibrium, m. It is the clearance and
        the deflection; where the stops are not reached, it is below the clearance.
    impact_speed
        Largest speed of an impact, m/s.
    energy_per_hit
        Mean energy m w^2 / 2 with which impacts arrive, J; per kg where the scene has no mass.
    impacts_per_hour
        Impacts on all stops, 1/h.
    limits
        Largest accepted values by name of the quantity.
    ways
        Way in which each row was found: "clusters" or "records".
    scene_without_mass
        Whether the scene gives no mass.
    left_out
        The tolerances that the scene states, in words: no point of a map includes any.

    See Also
    --------
    stochvi.isolators.bumper_map : The calculation.
    """

    kind = "size:map"
    in_document: ClassVar = {name: name for name in ("feasible", "exceeded", "best")}

    clearance: Vector
    stiffness_factor: Vector
    stiffness: Vector | None
    mission: float
    exceedance: float
    sigma: float
    peak_acceleration: SpectrumValues
    pad_force: SpectrumValues
    rattle_space: SpectrumValues
    impact_speed: SpectrumValues
    energy_per_hit: SpectrumValues
    impacts_per_hour: SpectrumValues
    limits: Mapping[str, float]
    ways: Sequence[str]
    scene_without_mass: bool = False
    left_out: str = ""
    assumptions: Sequence[str] = ()

    @property
    def feasible(self) -> NDArray[np.bool_]:
        """(clearances, stiffnesses): whether all limits are shown to be kept: their quantities lie
        below them with their 95 % intervals."""
        found = np.ones(self.peak_acceleration.value.shape, bool)
        for name, most in self.limits.items():
            values = getattr(self, name)
            found &= values.value + values.half_width_95() <= most
        return found

    @property
    def exceeded(self) -> NDArray[np.bool_]:
        """(clearances, stiffnesses): whether any limit is shown to be exceeded. Points that neither
        keep all limits nor exceed one are not known well enough."""
        found = np.zeros(self.peak_acceleration.value.shape, bool)
        for name, most in self.limits.items():
            values = getattr(self, name)
            found |= values.value - values.half_width_95() > most
        return found

    @property
    def best(self) -> MapPoint | None:
        """The point with the least travel among those shown to keep all limits; None where
        there is none, or no limit was given."""
        if not self.limits or not self.feasible.any():
            return None
        rattle = np.where(self.feasible, self.rattle_space.value, np.inf)
        row, column = np.unravel_index(int(np.argmin(rattle)), rattle.shape)
        return MapPoint(
            float(self.clearance[row]), float(self.stiffness_factor[column]), int(row), int(column)
        )

    @property
    def relative_error(self) -> float:
        """Median relative standard error of the peak acceleration, where a stop is touched."""
        peak = self.peak_acceleration
        touched = self.impact_speed.value > 0.0
        if not touched.any():
            return 0.0
        return float(np.median(peak.standard_error[touched] / peak.value[touched]))

    def to_frame(self) -> DataFrame:
        """A row for each point of the map, with the standard error and the bias of each
        quantity."""
        shape = self.peak_acceleration.value.shape
        columns: dict[str, Any] = {
            "clearance": np.repeat(self.clearance, shape[1]),
            "stiffness_factor": np.tile(self.stiffness_factor, shape[0]),
        }
        if self.stiffness is not None:
            columns["stiffness"] = np.tile(self.stiffness, shape[0])
        for name in QUANTITIES:
            values = getattr(self, name)
            columns |= {
                name: values.value.ravel(), f"{name}_standard_error": values.standard_error.ravel(),
                f"{name}_bias": values.bias.ravel(),
            }  # fmt: skip
        judged = {"feasible": self.feasible.ravel(), "exceeded": self.exceeded.ravel()}
        return frame_of(columns | judged)

    def stop_in_words(self, column: int) -> str:
        """The stiffness of a column, in words."""
        if self.stiffness is not None:
            return STIFFNESS.text(self.stiffness[column], ".3g")
        return f"{self.stiffness_factor[column]:.3g} times the stiffness of the scene's stops"

    def summary(self) -> str:
        """The best design that keeps the limits, in a sentence."""
        points = self.feasible.size
        mission = spoken_mission(self.mission)
        chance = f"in all but {spoken_percent(self.exceedance)} of missions of {mission}"
        if not self.limits:
            return f"{points} designs of stops; limits would mark those that keep them"
        best, unknown = self.best, int(np.count_nonzero(~(self.feasible | self.exceeded)))
        more = f" ({unknown} not known well enough)" if unknown else ""
        if best is None:
            return f"none of {points} designs of stops is shown to keep all limits {chance}{more}"
        at = best.row, best.column
        return (
            f"{np.count_nonzero(self.feasible)} of {points} designs keep all limits {chance}"
            f"{more}; the least travel is {LENGTH.text(self.rattle_space.value[at], '.3g')}, at a "
            f"clearance of {LENGTH.text(best.clearance, '.3g')} with "
            f"{self.stop_in_words(best.column)}: "
            f"{ACCELERATION.text(self.peak_acceleration.value[at], '.3g')}"
        )


# ------------------------------------------------------------------------------
# Impacts at one clearance on stops of many stiffnesses, from the same motions.
#
# Where first impacts are rare, a trial is a cluster from its first impact on; fast first impacts
# are drawn more often, and weighted. Where they are not, it is a record of the whole motion. The
# motion without stops is made once, and what stops of each stiffness make of it is simulated.
# ------------------------------------------------------------------------------


WIDENING = 2.5
"""Factor on the speeds of every second first impact, so that rare hard impacts are seen as well."""

LEVELS = 400
"""Number of speeds at which the rate of trials with a faster impact is known."""

FEWEST = 5
"""Smallest number of trials with an impact from which a speed is found."""

TINY = 1e-9
"""Smallest speed of an impact over the largest one of a `Curve`."""

NEVER = 1e-300
"""Rate of events that are not seen, 1/s, so that its logarithm is finite."""


class Curve(NamedTuple):
    """Speeds of impacts that rise from 0, m/s, and a quantity of the contacts that would follow on
    a base at rest."""

    speed: Vector
    value: Vector


ROWS = 7
"""Number of quantities of a trial, see `TrialPart`."""


class TrialPart(NamedTuple):
    """What one block of paths gives.

    Parameters
    ----------
    ages
        Ages of its crossings, see `clusters.Part`.
    path, weight
        (trials,): path of each trial, and its weight, as in `Bursts`; 1 of records.
    fastest, sharpest, hardest, deepest
        (stiffnesses, trials): fastest impact, m/s; and the largest absolute acceleration (m/s^2),
        force (N) and deflection (m) in contacts; 0 without a contact.
    hits, late, squares
        (stiffnesses, trials): number of impacts, and of those in the second half of the trial; and
        the sum of the squares of their speeds, m^2/s^2.
    """

    ages: NDArray[np.float32]
    path: NDArray[np.int64]
    weight: Vector
    fastest: Matrix
    sharpest: Matrix
    hardest: Matrix
    deepest: Matrix
    hits: Matrix
    late: Matrix
    squares: Matrix


@dataclass(frozen=True, eq=False)
class ClearanceTrials(TrialSampler):
    """Trials at one clearance, with the stops of all `models`, which are at the same places."""

    clusters: ClusterPaths
    models: tuple[Model, ...]

    @cached_property
    def apart(self) -> bool:
        """Whether trials are clusters, because Rice's crossings in one are few."""
        records = self.clusters.records
        return float(records.rice_rates.sum()) * WINDOWS * records.horizon < UNFINISHED

    @property
    def block(self) -> int:
        """Number of paths that are made together."""
        return self.clusters.together

    @cached_property
    def seconds(self) -> float:
        """Length of a trial, s."""
        motion = self.clusters.motion
        return (motion.window if self.apart else motion.response.samples) * motion.response.step

    @cached_property
    def _between(self) -> list[ClusterPaths]:
        return [self.clusters.between(model) for model in self.models]

    def trial(self, first_path: int, paths: int, deadline: Deadline) -> TrialPart:
        """The part of one block of paths; `GivenUp` where it outlasts the budget.

        The first block of a clearance is needed, and may outlast the share of that clearance.
        """
        with given_up_after(deadline.sooner_by(-(deadline.budget or 0.0))):
            return self._part(first_path)

    def _part(self, first_path: int) -> TrialPart:
        clusters = self.clusters
        free = clusters.free(first_path)
        if not self.apart:
            plan, motion = clusters.plans[1], clusters.whole(free)
            burn_in = min(math.ceil(plan.burn_in / plan.step), len(motion) - 1)
            found = self._followed(motion, burn_in, len(motion))
            none = np.zeros((1, 0, 1, len(free), 0), np.float32)
            return TrialPart(none, first_path + np.arange(len(free)), np.ones(len(free)), *found)
        path, weight = [np.zeros(0, np.int64)], [np.zeros(0)]
        columns = [np.zeros((ROWS, len(self.models), 0))]
        ages, motions = clusters.after_first_impacts(free, first_path, WIDENING)
        for one, motion in motions:
            columns.append(self._followed(motion))
            path.append(first_path + one.path)
            weight.append(one.weight)
        return TrialPart(
            ages, np.concatenate(path), np.concatenate(weight), *np.concatenate(columns, axis=2)
        )

    def _followed(
        self, motion: NDArray[np.float64], burn_in: int = 0, counted: int | None = None
    ) -> NDArray[np.float64]:
        """The last rows of a part, (ROWS, stiffnesses, trials)."""
        trials = motion.shape[2] // 2
        found = np.zeros((ROWS, len(self.models), trials))
        for row, clusters in enumerate(self._between):
            impacts, sums, *extremes = clusters.follow(
                motion, accelerations=True, burn_in=burn_in, counted=counted
            )
            of = {name: k for k, name in enumerate(clusters.plans[1].sums_of_pair)}
            (pair,) = sums
            late = impacts[0, impacts[2] > 0.5 * self.seconds].astype(int)
            found[:, row] = (
                clusters.fastest(impacts, trials)[0], *(each[:, 0] for each in extremes),
                pair[of["n_lower"]] + pair[of["n_upper"]], np.bincount(late, minlength=trials),
                pair[of["f2_lower"]] + pair[of["f2_upper"]],
            )  # fmt: skip
        return found


@dataclass(frozen=True, kw_only=True, eq=False)
class Trials(ClustersSoFar):
    """All trials so far at one clearance and stiffness, and what follows from them."""

    sampler: ClearanceTrials
    part: TrialPart
    row: int

    @property
    def unfinished(self) -> float:
        """Share of the impacts in the second half of clusters, without those of new ones."""
        return self.late(self.part.hits[self.row], self.part.late[self.row])

    def level(
        self, largest: Matrix, wanted: float, curve: Curve | None = None
    ) -> tuple[float, float, float]:
        """Value that the `largest` ones (stiffnesses, trials) exceed `wanted` times a second, its
        standard error, and its bias; 0 where impacts are rarer. NaN where too few were seen.

        Speeds are extrapolated, and what is no speed as the speed that would give it by `curve`.
        """
        everything, own = np.arange(len(self.part.path)), largest[self.row]
        if np.count_nonzero(own) < FEWEST:
            return math.nan, math.nan, math.nan
        if curve is not None:
            least = TINY * curve.speed[-1]
            own = np.where(own > 0.0, np.interp(own, curve.value, curve.speed).clip(least), 0.0)
        levels = np.linspace(0.0, PAST_LARGEST * float(own.max()), LEVELS)

        def at(kept: NDArray[np.int64], rate: float = wanted, square: bool = True) -> float:
            rates = np.maximum(self._rates(own, kept, levels, square), NEVER)
            if rates[0] < rate:
                return 0.0
            speed = float(np.interp(-math.log(rate), -np.log(rates), levels))
            return speed if curve is None else float(np.interp(speed, curve.speed, curve.value))

        value = at(everything)
        error = float(jackknife_error(np.array([at(kept) for kept in self.without_groups])))
        bias = abs(at(everything, square=False) - value)
        if self.first_rate is not None:
            factor = 1.0 + self.relative_error
            factor = factor if value else 1.0 / factor
            error = math.hypot(error, value - at(everything, wanted * factor))
            bias += value - at(everything, wanted * (1.0 + self.overlap))
        return value, error, bias

    def _rates(self, own: Vector, kept: NDArray[np.int64], levels: Vector, square: bool) -> Vector:
        """Trials per second in which the largest one, of those in `own`, is beyond each level."""
        weight, largest = self.weight[kept], own[kept]
        struck = largest > 0.0
        share = exceedance(largest[struck], weight[struck], levels, square)
        share *= weight[struck].sum() / weight.sum()
        if self.first_rate is None:
            return -np.log1p(-np.minimum(share, 1.0 - 1e-12)) / self.sampler.seconds
        return self.per_second * share

    def hit_rate(self) -> tuple[float, float]:
        """Impacts per second, and their standard error."""
        mean, error = self.ratio(self.part.hits[self.row], np.ones(len(self.path)))
        error = math.hypot(error, self.relative_error * mean)
        return self.per_second * mean, self.per_second * error

    def mean_square_speed(self) -> tuple[float, float]:
        """Mean square of the impact speeds, m^2/s^2, and its standard error."""
        hits = self.part.hits[self.row]
        if not hits.any():
            return math.nan, math.nan
        return self.ratio(self.part.squares[self.row], hits)


def trials_of(sampler: ClearanceTrials, parts: Sequence[TrialPart]) -> list[Trials]:
    """The trials so far, stiffness by stiffness."""
    ages = np.concatenate([part.ages for part in parts], axis=3)
    rate = sampler.clusters.found(ages).first_rate()[0] if sampler.apart else None
    joined = [np.concatenate(each, axis=-1) for each in zip(*(p[1:] for p in parts), strict=True)]
    whole = TrialPart(ages, *joined)
    return [
        Trials(
            sampler=sampler, part=whole, row=row, first_rate=rate, window=sampler.seconds,
            path=whole.path, weight=whole.weight,
        )
        for row in range(len(sampler.models))
    ]  # fmt: skip


# ------------------------------------------------------------------------------
# What impacts do to a mass over the clearance and the stiffness of its stops.
#
# At each clearance, impacts on the stops of all stiffnesses follow from the same motions
# (`TrialPart`). Mount, base and stops move the mass in a contact, and the largest acceleration,
# force and deflection are those of that motion.
# ------------------------------------------------------------------------------


POINTS, MOST_POINTS = 20, 100
"""Number of clearances, and of stiffnesses, by default; and the largest number."""

NEAREST_SIGMA, SPREAD = 1.5, 10.0
"""By default the smallest clearance, in rms displacements, and the factor of the stiffness either
way."""

SPEEDS = np.concatenate([[1e-6], np.linspace(0.0, 2.0 * PAST_LARGEST, 65)[1:]])
"""Speeds at which the contacts of a law are known, over the fastest impact that was seen."""

HOUR = 3600.0

BETWEEN_SUB_STEPS = CONTACT_ANGLE**2 / 24.0
"""Mean share of a peak acceleration that is lost between two sub-steps of a contact. A cosine that
is read every a rad lies by a^2 / 24 of its amplitude below its peak on average."""

FIRST_PATHS, MOST_UNSEEN = 64, 1024
"""Number of paths of the first look; and that after which a clearance is given up at which hardly
an impact was seen."""


@calculation
@sampled(rel_error=0.1)
def bumper_map(
    scene: Scene,
    *,
    mission: float = 3600.0,
    exceedance: float = ACCEPTED,
    clearances: Sequence[float] | None = None,
    stiffness_factors: Sequence[float] | None = None,
    limits: Mapping[str, float] | None = None,
    **options: Unpack[AccuracyOptions],
) -> BumperMap:
    """What impacts do to a mass over the clearance and the stiffness of its stops.

    Parameters
    ----------
    scene
        One oscillator under stationary Gaussian noise with compliant stops, whose laws are kept;
        their places are not.
    mission
        Duration, s.
    exceedance
        Probability with which peak acceleration, force, rattle space and speed are exceeded in the
        mission.
    clearances
        Metres per side from the static equilibrium; by default 20, from 1.5 rms displacements to
        where stops are touched no more.
    stiffness_factors
        Stiffness of the stops over that of the scene; by default 20, from 0.1 to 10.
    limits
        Largest accepted values by quantity: "peak_acceleration" (m/s^2), "pad_force" (N),
        "rattle_space" (m), "energy_per_hit" (J), "impacts_per_hour".
    **options
        `AccuracyOptions`: `rel_error` is the median relative standard error of the impact speed at
        each clearance, by default 0.1.

    Returns
    -------
    BumperMap
        The quantities at all points, and which of them keep the limits.

    Raises
    ------
    NotApplicable
        If the scene is not covered, or a stop has no stiffness.
    NotConverged
        If time ends first; it carries the map so far.

    See Also
    --------
    stochvi.size : The clearance for one limit.
    stochvi.damage : What equipment on the mass goes through.

    Examples
    --------
    >>> from stochvi import Elastic, ImpactPair, Isolator, TabulatedNoise
    >>> stops = ImpactPair(lower=-4e-3, upper=4e-3, law=Elastic(stiffness=2e5))
    >>> truck = TabulatedNoise(profile="mil-std-810h-truck-vertical-5hz")
    >>> mount = Isolator(frequency_hz=12.0, zeta=0.1, mass=1.0)
    >>> scene = Scene(structure=mount, impact_pairs=[stops], excitations=[truck])
    >>> found = bumper_map(scene, clearances=[7e-3], stiffness_factors=[0.1, 1.0], rel_error=0.2)
    >>> soft, hard = found.peak_acceleration.value[0] / 9.81
    >>> bool(2.0 < hard / soft < 4.0)
    True
    """
    check_movable(scene)
    _check(scene, mission, exceedance)
    limits = _limits(limits or {})
    usual = np.geomspace(1.0 / SPREAD, SPREAD, POINTS)
    factors = _rising("stiffness_factors", stiffness_factors, usual)
    motion = free_motion(model_of(scene))
    (sigma,), (speed,) = motion.deviations(np.eye(1))
    calm = _calm(float(sigma), float(speed), mission, exceedance, len(model_of(scene).stops))
    nearest = min(NEAREST_SIGMA * sigma, 0.5 * calm)
    places = _rising("clearances", clearances, np.linspace(nearest, 1.02 * calm, POINTS))
    run = Run.of(options)
    scenes = [changed_stops(scene, stiffness=float(factor)) for factor in factors]
    wanted = -math.log1p(-exceedance) / mission
    rows: list[list[Trials]] = []
    short: list[str] = []
    paths = 0
    for number, place in enumerate(places):
        models = tuple(model_of(at_clearances(each, float(place))) for each in scenes)
        sampler = ClearanceTrials(ClusterPaths(models[0], run.seed), models)
        part = run.part(
            number / len(places), (number + 1) / len(places), f"{1e3 * place:.3g} mm",
            run.deadline.share(1.0 / (len(places) - number)),
        )  # fmt: skip

        def error_of(parts: list[TrialPart], sampler: ClearanceTrials = sampler) -> float:
            return _median_error(trials_of(sampler, parts), wanted)

        taken = part.to_accuracy(
            sampler, FIRST_PATHS, error_of, run.accuracy, MOST_UNSEEN, needed=max(sampler.block, 2)
        )
        paths += taken.paths
        rows.append(trials_of(sampler, taken.sample))
        if not taken.enough:
            short.append(f"{1e3 * place:.3g} mm")
    peak, force, rattle, fastest, energy, hourly = _map(
        model_of(scene), places, rows, wanted, calm, float(speed / sigma)
    )
    own = stiffness_of(scene)
    answer = BumperMap(
        clearance=places, stiffness_factor=factors,
        stiffness=None if own is None else own * factors, mission=mission, exceedance=exceedance,
        sigma=float(sigma), limits=limits,
        peak_acceleration=peak, pad_force=force, rattle_space=rattle, impact_speed=fastest,
        energy_per_hit=energy, impacts_per_hour=hourly,
        ways=["clusters" if row[0].sampler.apart else "records" for row in rows],
        scene_without_mass=not scene.expanded.structure.knows_mass,
        left_out=Tolerances.of(scene).in_words(), assumptions=scene.assumptions(),
        warnings=_warnings(rows, short), cost=run.cost(paths=paths),
        provenance=provenance(scene.document(), run.seed),
    )  # fmt: skip
    if short:
        raise run.deadline.fell_short(
            f"at a relative error of {run.accuracy:g} of the impact speed at all clearances",
            "raise budget or rel_error", answer,
        )  # fmt: skip
    return answer


def _map(
    model: Model, places: Vector, rows: Sequence[Sequence[Trials]], wanted: float, calm: float,
    speed_ratio: float,
) -> list[SpectrumValues]:  # fmt: skip
    """The quantities of a map, in the order of its fields.

    Where no stop is reached, the largest displacement is `calm`, or the clearance where that is
    less. The mount then gives omega^2 x + b v, where v has `speed_ratio` times the rms of x.
    """
    mass = float(model.mass[0, 0])
    levels = np.array([_levels(places, column, wanted) for column in zip(*rows, strict=True)])
    speed, peak, force, depth = levels.transpose(2, 3, 1, 0)
    reached = (speed[0] > 0.0) | np.isnan(speed[0])
    calm_places = np.minimum(calm, places)[:, None]
    pull = math.hypot(model.omega**2, model.damping_rate * speed_ratio)
    peak = np.where(reached, peak, [pull * calm_places, 0.0 * calm_places, 0.0 * calm_places])
    peak[2] += np.where(reached, BETWEEN_SUB_STEPS * peak[0], 0.0)
    rattle = depth + np.array([1.0, 0.0, 0.0])[:, None, None] * np.where(
        reached, places[:, None], calm_places
    )
    energy = 0.5 * mass * np.array([[each.mean_square_speed() for each in row] for row in rows])
    hourly = HOUR * np.array([[each.hit_rate() for each in row] for row in rows])
    overlap = np.array([[each.overlap for each in row] for row in rows])
    meeting = np.stack([energy[..., 0] * overlap, hourly[..., 0] * overlap])
    return [
        SpectrumValues.of(value, error, np.abs(bias))
        for value, error, bias in (
            peak, force, rattle, speed, [energy[..., 0], energy[..., 1], meeting[0]],
            [hourly[..., 0], hourly[..., 1], meeting[1]],
        )
    ]  # fmt: skip


def _levels(
    places: Vector, column: Sequence[Trials], wanted: float
) -> list[list[tuple[float, float, float]]]:
    """Speed, acceleration, force and deflection that are exceeded `wanted` times a second, at all
    clearances (clearances, quantities) with stops of one stiffness.

    The square of a speed is exponential beyond what was seen. For the others the law of the stop
    says what that means: they are taken as speeds of contacts on a base at rest.
    """
    model = column[0].sampler.models[column[0].row]
    fastest = np.array([each.part.fastest[each.row].max() for each in column])
    speed = SPEEDS[:, None] * np.where(fastest > 0.0, fastest, 1.0)
    laws = [stop.law for stop in model.stops_per_unit_mass if isinstance(stop.law, CompliantLaw)]
    contact = hardest_contact(model, [(law, places) for law in laws], speed)
    values = (
        contact.peak_acceleration,
        float(model.mass[0, 0]) * contact.peak_force,
        contact.deflection,
    )
    found = []
    for k, trials in enumerate(column):
        part = trials.part
        largest = (part.sharpest, part.hardest, part.deepest)
        curves = [Curve(speed[:, k], np.maximum.accumulate(each[:, k])) for each in values]
        found.append(
            [trials.level(part.fastest, wanted)]
            + [trials.level(*each) for each in zip(largest, 3 * [wanted], curves, strict=True)]
        )
    return found


def _median_error(trials: Sequence[Trials], wanted: float) -> float:
    """Median relative standard error of the impact speed; 0 where impacts are rarer than wanted."""
    found = [each.level(each.part.fastest, wanted) for each in trials]
    errors = [
        math.inf if math.isnan(value) else error / value
        for value, error, _ in found
        if value > 0.0 or math.isnan(value)
    ]
    return float(np.median(errors)) if errors else 0.0


def _calm(sigma: float, speed: float, mission: float, exceedance: float, sides: int) -> float:
    """Displacement that is exceeded in the mission with a probability, by Rice's crossings of one
    side or both, m."""
    crossings = sides * speed / sigma / (2.0 * math.pi) * mission / -math.log1p(-exceedance)
    return sigma * math.sqrt(2.0 * math.log(max(crossings, math.e)))


def stiffness_of(scene: Scene) -> float | None:
    """The stiffness of the stops, N/m, where they are linear springs that are alike."""
    laws = [law for pair in scene.impact_pairs for _, law in pair.stops()]
    known = {law.stiffness if isinstance(law, LinearLaw) else None for law in laws}
    return known.pop() if len(known) == 1 else None


def _warnings(rows: Sequence[Sequence[Trials]], short: Sequence[str]) -> list[str]:
    found = []
    if short:
        found.append(f"not as accurate as asked for at clearances of {', '.join(short)}")
    if any(each.unfinished > UNFINISHED for row in rows for each in row):
        found.append(
            "clusters of impacts do not end at some points: stops pump the mount, and harder "
            "impacts than these may follow; ask simulate or reliability there"
        )
    return found


LIMITED = ("peak_acceleration", "pad_force", "rattle_space", "energy_per_hit", "impacts_per_hour")


def _limits(limits: Mapping[str, float]) -> dict[str, float]:
    for name, most in limits.items():
        if name not in LIMITED:
            raise ValueError(f"limits must be of {', '.join(LIMITED)}, got {name!r}")
        if not 0.0 < most < math.inf:
            raise ValueError(f"the limit of {name} must be positive, got {most}")
    return dict(limits)


def _rising(name: str, given: Sequence[float] | None, usual: Vector) -> Vector:
    """Values of an axis."""
    found = usual if given is None else np.asarray(given, dtype=float).ravel()
    if not len(found) or not found[0] > 0.0 or not np.all(np.diff(found) > 0.0):
        raise ValueError(f"{name} must be positive rising numbers, got {shown(given)}")
    check_size(f"the number of {name}", len(found), MOST_POINTS, "ask for fewer")
    return found


def _check(scene: Scene, mission: float, exceedance: float) -> None:
    if not 0.0 < mission < math.inf:
        raise ValueError(f"mission must be a positive number of seconds, got {mission}")
    if not 0.0 < exceedance < 1.0:
        raise outside_of_share("exceedance", "in (0, 1)", exceedance)
    if conditions := beyond_one_oscillator(model_of(scene)):
        why = (
            "a map is of one linear mass; sweep by size or reliability over "
            "impact_pair.0.law.stiffness instead"
        )
        raise NotApplicable("bumper map", [*conditions[:-1], f"{conditions[-1]}; {why}"])
    if not scene.impact_pairs:
        raise NotApplicable("bumper map", "the scene needs an impact_pair, for its law")
    PeakAcceleration().check(model_of(scene))


__all__ = ["BumperMap", "bumper_map"]
