"""Periodic motions under a sine. Chapters: the answer; harmonic linearisation of rigid stops; slow
sweeps; the calculation, over frequency or any key."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar, NamedTuple, Protocol

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from stochvi.mathematics.numerics import Vector
from stochvi.mathematics.units import explain_methods, with_checks
from stochvi.methods.periodic.branches import (
    DEFAULT_IMPACTS,
    LOOKS,
    MOST_PATIENCE,
    Finder,
    Scattered,
)
from stochvi.methods.periodic.contact_branches import finder_of
from stochvi.methods.periodic.continuation import (
    FOLD,
    NODE,
    POINT,
    REPEATS,
    ROOT_STEPS,
    SETTLING,
    FinalMotion,
    OnBranch,
    Track,
)
from stochvi.methods.periodic.family import Family, unmet
from stochvi.methods.periodic.kernels import solver
from stochvi.model.model import Model, model_of
from stochvi.results.base import DataFrame, Result, stacked
from stochvi.results.deadline import Deadline, graceful_interrupt
from stochvi.results.errors import NotApplicable
from stochvi.results.estimates import Cost, provenance
from stochvi.sampling.calculations import calculation
from stochvi.scenes.excitations import Sine
from stochvi.scenes.keys import changed_scene
from stochvi.scenes.scene import Scene

# ------------------------------------------------------------------------------
# The answer on a structure between stops under a sine: branches of regimes, and jumps.
# ------------------------------------------------------------------------------


@explain_methods
@dataclass(frozen=True, kw_only=True, eq=False)
class Branch:
    """Periodic regimes that follow from each other as a number is varied.

    Parameters
    ----------
    form
        Method by which the regimes were found: "exact", or harmonic linearisation by "motion" or by
        "force", which gives neither phases nor multipliers (NaN).
    stops
        "pair side" of each impact of a regime, in their order; none of motion without impacts.
        Successive impacts on one stop count as one where the motion rests on a stop.
    sticking
        "pair side" of the stops on which the motion rests for a part of the period.
    periods
        Periods of the force after which the motion repeats itself.
    value, frequency_hz
        The number that is varied, and the frequency of the force, at each point.
    displacement_max, acceleration_max
        Largest displacement from the unloaded position (m), and largest absolute acceleration
        between impacts (m/s^2), of the coordinate that was asked for.
    amplitude
        Amplitude of the first harmonic of that displacement, m.
    phase
        Phases of the force at the impacts (points, impacts), rad.
    displacement, velocity
        The coordinates (points, coordinates) just before the first impact, or at the phase 0 of
        motion without impacts or with rests, m and m/s.
    impact_speed
        Incident speeds (points, impacts), m/s; the largest of successive impacts that count as one.
    multiplier
        Largest modulus of the factors by which small perturbations change over the regime; infinite
        where an impact of speed 0 leaves none (null in JSON).
    stable, admissible
        Whether perturbations die away; whether the motion meets no stop besides these impacts.
    names
        "fold", "grazing", "period doubling", "symmetry breaking", "torus" or "sticking", where
        rests on a stop begin or end, at a special point, else empty.

    See Also
    --------
    stochvi.harmonic_response : The calculation.
    """

    in_document: ClassVar = {"impacts_per_period": "impacts_per_period", "value": "varied"}
    not_in_document = (
        "stops", "value", "amplitude", "acceleration_max", "phase", "displacement", "velocity",
        "names",
    )  # fmt: skip
    sometimes = ("value",)

    @property
    def omitted(self) -> Sequence[str]:
        """What the document of this branch leaves out."""
        return () if len(self.varied) else self.sometimes

    form: str
    stops: tuple[str, ...]
    sticking: tuple[str, ...]
    periods: int
    value: Vector
    frequency_hz: Vector
    displacement_max: Vector
    amplitude: Vector
    acceleration_max: Vector
    phase: Vector
    displacement: Vector
    velocity: Vector
    impact_speed: Vector
    multiplier: Vector
    stable: NDArray[np.bool_]
    admissible: NDArray[np.bool_]
    names: tuple[str, ...]

    @property
    def impacts_per_period(self) -> float:
        """Number of impacts over the number of periods of the force."""
        share = len(self.stops) / self.periods
        return int(share) if share.is_integer() else share

    @property
    def varied(self) -> Vector:
        """The number that is varied; empty where that is the frequency of the force."""
        same = np.allclose(self.value, self.frequency_hz, rtol=1e-9, atol=0.0)
        return self.value[:0] if same else self.value

    def at(self, value: float) -> list[int]:
        """The admissible points at a value that was asked for."""
        near = np.abs(self.value - value) <= 1e-9 * max(abs(value), 1e-300)
        return [int(i) for i in np.flatnonzero(near & self.admissible) if not self.names[i]]


COLUMNS = (
    "branch", "form", "impacts", "sticking", "impacts_per_period", "periods", "value",
    "frequency_hz", "displacement_max", "amplitude", "acceleration_max", "impact_speed_max",
    "multiplier", "stable", "admissible", "name",
)  # fmt: skip
"""Columns of a table of regimes."""


@dataclass(frozen=True, kw_only=True)
class SpecialPoint:
    """A place where regimes appear, vanish or change their stability.

    Parameters
    ----------
    name
        As in `Branch.names`.
    branch
        Number of the branch.
    value, frequency_hz
        Value of the number that is varied, and frequency of the force.

    See Also
    --------
    stochvi.harmonic_response : The answer that holds it.
    """

    name: str
    branch: int
    value: float
    frequency_hz: float


@dataclass(frozen=True, kw_only=True)
class Jump:
    """A sudden change of a slow sweep.

    Parameters
    ----------
    upwards
        Whether the sweep goes up.
    value, frequency_hz
        Value and frequency at which the regime ends from which the motion jumps.
    displacement_max, impact_speed
        Largest displacement (m) and impact speed (m/s, 0 without impacts), before and after.

    See Also
    --------
    stochvi.harmonic_response : The answer that holds it.
    """

    upwards: bool
    value: float
    frequency_hz: float
    displacement_max: tuple[float, float]
    impact_speed: tuple[float, float]

    @property
    def changes(self) -> tuple[float, float]:
        """Changes of the largest displacement (m) and of the impact speed (m/s)."""
        lengths, speeds = self.displacement_max, self.impact_speed
        return abs(lengths[1] - lengths[0]), abs(speeds[1] - speeds[0])


@with_checks
@dataclass(frozen=True, kw_only=True)
class RandomStarts:
    """Ends of motions from random starts.

    Parameters
    ----------
    number, listed
        Number of random starts, spread over the range. `listed` of them ended in a regime of a
        branch.
    elsewhere
        Smallest and largest value at which a start or a slow sweep ended in none: in motion that
        does not repeat itself within 8 periods, or has more than 24 impacts in its period; None
        where there is none.

    See Also
    --------
    stochvi.harmonic_response : The answer that holds it.
    """

    number: int
    listed: int
    elsewhere: tuple[float, float] | None

    @property
    def all_listed(self) -> bool:
        """Whether every start, and every slow sweep at every value, ended on a branch."""
        return self.listed == self.number and self.elsewhere is None

    @property
    def sentence(self) -> str:
        """The share of starts that ended on a branch."""
        return f"{self.listed} of {self.number} random starts ended in a listed regime"

    @property
    def warning(self) -> str:
        """Where starts or sweeps ended on no branch; empty if none did."""
        if self.elsewhere is None:
            return ""
        low, high = (f"{value:.4g}" for value in self.elsewhere)
        where = f"at {low}" if low == high else f"from {low} to {high}"
        return (
            f"possibly chaotic motion {where}: some random starts or slow sweeps end in no listed "
            "regime there"
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class SimulatedSweep:
    """A slow sweep by simulation from impact to impact, from each value to the next.

    Parameters
    ----------
    upwards
        Whether the sweep goes up.
    value
        The values of the varied number, in the order of the sweep.
    displacement_max, impact_speed_max
        Largest displacement (m) and impact speed (m/s; 0 without impacts) over the period of the
        motion, or over 100 periods of the force where it does not repeat itself.
    periods
        Periods of the force after which the motion repeats itself; 0 where it does not.

    See Also
    --------
    stochvi.harmonic_response : The answer that holds it.
    """

    upwards: bool
    value: Vector
    displacement_max: Vector
    impact_speed_max: Vector
    periods: NDArray[np.int64]


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class HarmonicResponse(Result):
    """Regimes of a structure under a sine or a sum of sines.

    `response.at(20.0)` holds the regimes at a frequency; `branches` all of them.

    Parameters
    ----------
    key
        The number that is varied: "frequency_hz", or a key of the scene.
    coordinate
        The coordinate or point whose displacement and acceleration are given.
    branches
        The branches; the first is the motion without impacts, where there is one.
    special_points
        Folds, grazings and changes of stability, in the order of their values.
    jumps
        Jumps of a slow sweep up and one down where the regime that they follow ends. Each sweep
        starts at an end of the range, at rest under the constant loads.
    starts
        Ends of random starts; None for harmonic linearisation.
    model_error
        Errors of harmonic linearisation: "median" and "largest" relative difference of its impact
        speeds from those of the fastest exact stable regime of a period; "without_exact", the share
        of its stable regimes without such an exact one. None for exact regimes.
    simulated
        Sweeps by simulation that were asked for.
    assumptions
        Assumptions, a sentence each.

    See Also
    --------
    stochvi.harmonic_response : The calculation.
    """

    kind = "sine"
    in_document: ClassVar = {"jumps": "largest_jumps", "all_jumps": "jumps"}

    key: str
    coordinate: str
    branches: tuple[Branch, ...]
    special_points: tuple[SpecialPoint, ...] = ()
    jumps: tuple[Jump, ...] = ()
    starts: RandomStarts | None = None
    simulated: tuple[SimulatedSweep, ...] = ()
    assumptions: Sequence[str] = ()
    model_error: Mapping[str, float | None] | None = None

    def at(self, value: float) -> DataFrame:
        """The regimes at one of the values that were asked for, the most stable first."""
        table = self.to_frame()
        near = np.abs(table["value"] - value) <= 1e-9 * max(abs(value), 1e-300)
        chosen: DataFrame = table[near & table["admissible"] & (table["name"] == "")]
        return chosen.sort_values("multiplier").reset_index(drop=True)

    def to_frame(self) -> DataFrame:
        """One row for each point of each branch, SI units."""
        return stacked(
            (
                {name: getattr(branch, name, None) for name in COLUMNS}
                | {
                    "branch": number,
                    "impacts": " ".join(stop.replace(" ", "-") for stop in branch.stops),
                    "sticking": " ".join(stop.replace(" ", "-") for stop in branch.sticking),
                    "impact_speed_max": branch.impact_speed.max(axis=1, initial=0.0),
                    "name": list(branch.names),
                }
                for number, branch in enumerate(self.branches)
            ),
            list(COLUMNS),
        )

    def jump_at(self, *, upwards: bool) -> float | None:
        """Frequency (hertz) of the largest jump of a slow sweep; None where there is none.

        It is the one that changes displacement or impact speed the most, each relative to the
        largest change of all jumps: where impacts set in, the speed grows from zero, yet little.
        """
        largest = np.max([jump.changes for jump in self.jumps], axis=0, initial=0.0)
        scale = np.where(largest > 0.0, largest, 1.0)
        found = [jump for jump in self.jumps if jump.upwards == upwards]
        most = max(found, key=lambda jump: max(jump.changes / scale), default=None)
        return None if most is None else most.frequency_hz

    @property
    def largest_jumps(self) -> Mapping[str, float | None]:
        """The largest jump of a slow sweep up, and of one down, Hz."""
        return {"up_hz": self.jump_at(upwards=True), "down_hz": self.jump_at(upwards=False)}

    def summary(self) -> str:
        """The numbers of branches, stable ones and jumps that were found, in a sentence."""
        stable = sum(bool((each.stable & each.admissible).any()) for each in self.branches)
        found = (
            f"{len(self.branches)} branches of periodic regimes, {stable} of them stable somewhere"
        )
        for upwards, word in ((True, "up"), (False, "down")):
            frequency = self.jump_at(upwards=upwards)
            number = sum(jump.upwards == upwards for jump in self.jumps)
            if frequency is not None:
                places = "at" if number == 1 else f"at {number} places, most at"
                found += f"; a slow sweep {word} jumps {places} {frequency:.5g} Hz"
        if self.model_error is not None and (median := self.model_error["median"]) is not None:
            found += (
                f"; impact speeds are off by {100.0 * median:.2g} % from the exact regimes "
                f"(median; up to {100.0 * (self.model_error['largest'] or 0.0):.2g} %)"
            )
        if self.starts is not None:
            found += f"; {self.starts.sentence}"
        return found


# ------------------------------------------------------------------------------
# Harmonic linearisation of rigid stops under a sine, by motion and by force.
# ------------------------------------------------------------------------------


SMALLEST, LARGEST = 1e-9, 1e4
"""With one stop, smallest and largest excess of the amplitude of a harmonic regime over the gap.
Its unit is the larger of the gap and the amplitude that the sine would give a mass without a
spring. With two stops, smallest and largest stiffness of the impacts in units of the squared
frequency."""

SAMPLES = 400
"""Number of amplitudes at which the balance of a regime is looked at for a change of its sign."""

EVEN = 1e-9
"""Largest difference of two gaps, relative to their sum, that counts as none."""

FORMS = ("exact", "motion", "force")
"""How periodic regimes are found: exactly, or by harmonic linearisation."""


@dataclass(frozen=True)
class Harmonic:
    """One oscillator between rigid stops under one sine, per unit mass.

    Parameters
    ----------
    omega, damping_rate
        Natural frequency (rad/s) and b (1/s).
    peak, frequency
        a_p, m/s^2, and w, rad/s.
    gap
        Distance of the stops from the position of rest under the load, m; below 0 for a preload.
    restitution
        R of the stops.
    both_sides
        Whether there are two stops, evenly about the position of rest.
    """

    omega: float
    damping_rate: float
    peak: float
    frequency: float
    gap: float
    restitution: float
    both_sides: bool

    @property
    def impact_damping(self) -> float:
        """beta, 1/s, of the loss at speeds w a_x: (1 - R^2) w / 2 pi of one stop (B 7.61), twice
        that of two (B 7.62)."""
        share = 1.0 if self.both_sides else 0.5
        return share * (1.0 - self.restitution**2) * self.frequency / math.pi

    def balance(self, amplitude: float, stiffness: float) -> float:
        """Force that an amplitude needs, less the force that acts (B 9.13)."""
        w = self.frequency
        loss = (self.damping_rate + self.impact_damping) * w
        return amplitude * math.hypot(stiffness - w**2, loss) - self.peak

    @property
    def boundary(self) -> float:
        """Amplitude a_p / ((b + beta) w) that no regime exceeds (B 9.15), m.

        Stops only add stiffness, so that below resonance it does not vanish, and the amplitude is
        a_p / |omega^2 - w^2 + i (b + beta) w|.
        """
        loss = (self.damping_rate + self.impact_damping) * self.frequency
        stiffness = max(self.omega**2 - self.frequency**2, 0.0)
        return self.peak / math.hypot(stiffness, loss) if stiffness or loss else math.inf


class Law(Protocol):
    """Amplitude (m) and total stiffness (1/s^2) of a regime, by a number that grows from 0."""

    def __call__(self, case: Harmonic, s: float) -> tuple[float, float]: ...


def by_motion(case: Harmonic, s: float) -> tuple[float, float]:
    """Linearisation by motion: the largest displacement of x = m_x + a_x cos reaches the stop.

    One stop: omega_0^2 = omega^2 (3 - 2 gap / a_x) (B 9.19), so that it is sqrt(3) omega without a
    gap (B 9.21). Two stops: a_x is the gap, whatever the stiffness.

    >>> flush = Harmonic(1.0, 0.0, 1.0, 1.5, 0.0, 1.0, False)
    >>> round(math.sqrt(by_motion(flush, 1.0)[1]), 3)
    1.732
    """
    if case.both_sides:
        return case.gap, case.omega**2 + s * case.frequency**2
    amplitude = max(case.gap, 0.0) + s * _unit(case)
    return amplitude, case.omega**2 * (3.0 - 2.0 * case.gap / amplitude)


def by_force(case: Harmonic, s: float) -> tuple[float, float]:
    """Linearisation by force: x of the spring and the stops as a function of F = m_F + a_F cos.

    One stop: q = (1/2 + (asin u + u sqrt(1 - u^2)) / pi) / omega^2, u = omega^2 gap / a_F
    (B 7.87), so that omega_0 is sqrt(2) omega without a gap (B 9.36). Two stops: a_x / gap =
    4 / pi - (omega / omega_0)^2 (4 / pi - 1) (B 9.39).

    >>> flush = Harmonic(1.0, 0.0, 1.0, 1.5, 0.0, 1.0, False)
    >>> round(math.sqrt(by_force(flush, 1.0)[1]), 3)
    1.414
    """
    c = case.omega**2
    if case.both_sides:
        stiffness = c + s * case.frequency**2
        return case.gap * (4.0 / math.pi - c / stiffness * (4.0 / math.pi - 1.0)), stiffness
    force = c * (abs(case.gap) + s * _unit(case))
    u = c * case.gap / force
    compliance = (0.5 + (math.asin(u) + u * math.sqrt(1.0 - u * u)) / math.pi) / c
    return compliance * force, 1.0 / compliance


LAWS: dict[str, Law] = {"motion": by_motion, "force": by_force}


def _unit(case: Harmonic) -> float:
    return max(case.peak / case.frequency**2, abs(case.gap))


def regimes(case: Harmonic, form: str) -> Iterator[tuple[float, bool]]:
    """Amplitude (m) of each regime with impacts, and whether it is stable.

    A regime is stable where a larger amplitude needs a larger force than the one that acts; between
    two stops, where a larger stiffness does (B 10.8).
    """
    law = LAWS[form]

    def balance(s: float) -> float:
        return case.balance(*law(case, s))

    places = np.geomspace(SMALLEST, LARGEST, SAMPLES)
    values = [balance(float(s)) for s in places]
    for low, high, before, after in zip(places, places[1:], values, values[1:], strict=False):
        if before * after < 0.0:
            s = float(scipy.optimize.brentq(balance, low, high, xtol=1e-15, rtol=1e-13))
            yield law(case, s)[0], after > 0.0


def not_covered(model: Model) -> list[str]:
    """The conditions of harmonic linearisation that a model does not meet, in sentences."""
    found = unmet(model)
    if not model.single or not model.pairs:
        found.append(
            "structure.kind must be 'oscillator' or 'isolator' with one impact pair, got "
            f"{len(model.coordinates)} coordinates and {len(model.pairs)} impact pairs"
        )
    if len(model.sines) > 1:
        found.append(f"the scene must have one sine, got {len(model.sines)}")
    if found:
        return found
    if not model.omega:
        found.append("structure.stiffness must be above 0, got 0")
    elif model.lower is not None and model.upper is not None:
        gaps = [_gap(model, side) for side in (-1, 1)]
        if gaps[0] + gaps[1] <= 0.0 or abs(gaps[1] - gaps[0]) > EVEN * (gaps[0] + gaps[1]):
            found.append(
                "two stops must lie evenly about the position of rest, got gaps of "
                f"{gaps[0]:g} and {gaps[1]:g} m"
            )
        if model.lower.coefficient != model.upper.coefficient:
            found.append(
                f"law.coefficient must be the same at both stops, got {model.lower.coefficient:g} "
                f"and {model.upper.coefficient:g}"
            )
    return found


def _gap(model: Model, side: int) -> float:
    stop = model.upper if side > 0 else model.lower
    assert stop is not None
    return stop.distance - side * model.rest


def case_of(model: Model) -> Harmonic:
    """The oscillator of a model that is covered."""
    (sine,) = model.sines
    stops = model.stops_per_unit_mass
    coefficient = stops[0].coefficient
    assert coefficient is not None
    return Harmonic(
        omega=model.omega,
        damping_rate=model.damping_rate,
        peak=sine.amplitude * abs(float(sine.direction[0])) / model.unit_mass,
        frequency=sine.omega,
        gap=_gap(model, stops[-1].side),
        restitution=coefficient,
        both_sides=len(stops) == 2,
    )


def linearised(model_at: Callable[[float], Model], values: Vector, form: str) -> tuple[Branch, ...]:
    """The branches of harmonic regimes: one of the stable ones, and one of the unstable ones."""
    found: dict[tuple[bool, int], list[tuple[float, Harmonic, float, Model]]] = {}
    for value in values:
        model = model_at(float(value))
        case = case_of(model)
        counts = {True: 0, False: 0}
        for amplitude, stable in regimes(case, form):
            found.setdefault((stable, counts[stable]), []).append(
                (float(value), case, amplitude, model)
            )
            counts[stable] += 1
    return tuple(
        _branch(rows, form, stable) for (stable, _), rows in sorted(found.items(), reverse=True)
    )


def _branch(
    rows: Sequence[tuple[float, Harmonic, float, Model]], form: str, stable: bool
) -> Branch:
    cases = [case for _, case, _, _ in rows]
    amplitude = np.array([each for _, _, each, _ in rows])
    frequency = np.array([case.frequency for case in cases])
    (pair,) = rows[0][3].pairs
    stops = tuple(f"{pair.name} {stop.name}" for stop in pair.stops)
    unknown = np.full((len(rows), len(stops)), np.nan)
    springs = np.array([math.hypot(c.omega**2, c.damping_rate * c.frequency) for c in cases])
    based = rows[0][3].sines[0].on_base
    return Branch(
        form=form,
        stops=stops,
        sticking=(),
        periods=1,
        value=np.array([value for value, _, _, _ in rows]),
        frequency_hz=frequency / (2.0 * math.pi),
        displacement_max=np.array([_largest(*row[1:], form) for row in rows]),
        amplitude=amplitude,
        acceleration_max=amplitude * (springs if based else frequency**2),
        phase=unknown,
        displacement=unknown[:, :1],
        velocity=unknown[:, :1],
        impact_speed=np.repeat((frequency * amplitude)[:, None], len(stops), axis=1),
        multiplier=unknown[:, 0],
        stable=np.full(len(rows), stable),
        admissible=np.ones(len(rows), bool),
        names=("",) * len(rows),
    )


def _largest(case: Harmonic, amplitude: float, model: Model, form: str) -> float:
    """Largest displacement from the unloaded position, by the middle of the harmonic motion."""
    if case.both_sides:
        return amplitude + abs(model.rest)
    # the motion turns at the stop; its other end lies two amplitudes away
    (stop,) = model.stops_per_unit_mass
    return max(abs(stop.distance), abs(2.0 * amplitude - stop.distance))


# ------------------------------------------------------------------------------
# Slow sweeps: along the branches that they reach, from one to the next by flights, and from value
# to value over motions that do not repeat themselves.
# ------------------------------------------------------------------------------


SMALLEST_STEP = 0.02
"""Relative change of displacement or impact speed from which on a change is a jump if it does not
go back with the value. Changes of speed are relative to the speed of the vibration where that is
larger: that of a first contact grows from 0."""

ABRUPT = 0.1
"""Relative change right after the end of a branch from which on it is a jump in any case. The speed
of first contacts grows as the root of the distance from the end. At the first distance of BEYOND it
is still smaller than this."""

LEAP = 0.2
"""Relative change from which on a motion on no branch has jumped: where it does not repeat itself
its largest values are those of a finite time, and differ by more than ABRUPT now and then."""

BEYOND = (1e-6, 1e-4)
"""Relative distances of the varied number from the end of a regime at which flights go on from it,
one after the other: near a fold a motion takes long to leave."""

PUSH, PUSHED = 1e-3, 6
"""A motion that stays at a regime which no longer attracts it is pushed: it loses this share of its
velocity, and is then followed for so many flights. Nothing else would perturb it, and just beyond a
change of stability perturbations grow by some 0.1 % in a period."""

MEMORIES = 10
"""Time after which the motion at a value of a simulated sweep is read. Its unit is the time in
which free motion decays by a factor e."""

STRIDE = 4e-3
"""Relative distance of the varied number between two flights where a motion is on no branch."""

WANDERING = 4
"""Number of looks at a flight that goes on from a motion on no branch."""

HALVINGS = 8
"""Number of halvings by which a jump is located where the motion before it is on no branch."""

UNSETTLED = 100
"""Number of periods over which the largest displacement of a motion is taken that does not repeat
itself."""


class SweepState(NamedTuple):
    """A motion that a sweep has reached: a state at a phase of the force, the largest displacement
    and impact speed, and its place on a branch, if it is on one."""

    sigma: float
    state: Vector
    phase: float
    displacement: float
    speed: float
    place: OnBranch | None


class Sweep:
    """A slow sweep over the range of a finder, upwards or downwards.

    Branches that the finder does not have yet are added to it. `elsewhere` takes the places at
    which the sweep was on no branch.
    """

    def __init__(self, finder: Finder, *, upwards: bool) -> None:
        self.finder, self.direction = finder, 1.0 if upwards else -1.0
        self.upwards, self.elsewhere = upwards, list[float]()

    def jumps(self) -> Iterator[Jump]:
        """The jumps, in the order of the sweep."""
        start = 0.0 if self.upwards else 1.0
        here = self._reached(start, self.finder.at_rest(start), 0.0)
        while here is not None and not self.finder.deadline.passed():
            if here.place is not None:
                here = self._end(here, here.place)
                if self._left(here) < 1e-9:
                    return
                jump, here = self._beyond(here)
                if jump is not None:
                    yield jump
                continue
            self.elsewhere.append(here.sigma)
            if self._left(here) < 1e-9:
                return
            there = self._from(here, min(STRIDE / self.finder.family.span, self._left(here)))
            if there is not None and self._change(here, there) > LEAP:
                yield from self._located(here, there)
            here = there

    def simulated(self) -> Iterator[tuple[float, float, float, int]]:
        """For each value, its place, largest displacement and impact speed, and the number of
        periods after which the motion repeats itself, or 0. Each motion starts from the last."""
        grid = self.finder.grid if self.upwards else self.finder.grid[::-1]
        state = self.finder.at_rest(float(grid[0]))
        for sigma in grid.tolist():
            settling = min(MEMORIES * self.finder.memory(sigma), MOST_PATIENCE)
            settled = self.finder.simulate(sigma, state, periods=max(SETTLING, int(settling)))
            sized = None if settled is None else self._sized(sigma, settled, 0)
            if settled is None or sized is None or self.finder.deadline.passed():
                return
            displacement, speed, state = sized
            yield sigma, displacement, speed, settled.period(REPEATS)

    def _left(self, here: SweepState) -> float:
        """How far the end of the range is away."""
        return 1.0 - here.sigma if self.upwards else here.sigma

    def _reached(
        self, sigma: float, state: Vector, phase: float, looks: int = LOOKS
    ) -> SweepState | None:
        """The motion that a state leads to; None where impacts come too fast to be followed."""
        ended = self.finder.ended(sigma, state, phase, looks, patient=looks == LOOKS)
        if ended is None:
            return None
        place = ended.place
        # where damping is light the motion is still on its way to the regime
        if place is not None and (regime := self.finder.regime_at(place, sigma)) is not None:
            return self._on(regime, 0, place)
        periods = 0 if place is None else place.track.periods
        sized = self._sized(sigma, ended.settled, periods)
        if sized is None:
            return None
        displacement, speed, state = sized
        return SweepState(sigma, state, phase, displacement, speed, place)

    def _on(self, track: Track, number: int, place: OnBranch) -> SweepState:
        """The regime at one of the points of a branch."""
        state, phase = track.state(number)
        speed = float(track.speeds[number].max(initial=0.0))
        displacement = float(track.displacement[number])
        return SweepState(float(track.sigma[number]), state, phase, displacement, speed, place)

    def _sized(
        self, sigma: float, settled: FinalMotion, periods: int
    ) -> tuple[float, float, Vector] | None:
        """Largest displacement and impact speed of a motion, over its periods or, where they are 0
        and it does not repeat itself, over many; and its last state."""
        periods = periods or settled.period(REPEATS) or UNSETTLED
        state, sizes = settled.state, list[tuple[float, float]]()
        # an impact that comes now before, now after the phase at which periods end is in one of two
        for _ in range(periods + 1):
            more = self.finder.simulate(sigma, state, settled.phase, periods=1)
            if more is None:
                return None
            speeds = more.impacts(1)[:, 2]
            sizes.append((more.displacement, float(speeds.max(initial=0.0))))
            state = more.state
        displacement, speed = np.max(sizes, axis=0).tolist()
        return displacement, speed, state

    def _from(
        self, here: SweepState, distance: float, *, slowly: bool = False
    ) -> SweepState | None:
        """The motion at a distance further on; behind, where it is below 0. It may leave a branch
        `slowly`."""
        sigma = here.sigma + self.direction * distance
        looks = LOOKS if slowly or here.place is not None else WANDERING
        return self._reached(min(max(sigma, 0.0), 1.0), here.state, here.phase, looks)

    # Branches

    def _end(self, here: SweepState, place: OnBranch) -> SweepState:
        """The last regime of a branch that can be reached from one without a jump."""
        track = place.track
        first = self._ahead(track, here.sigma, (place.number, place.number + 1))
        if first is None:
            return here
        while first is not None:
            number = first
            first = self._ahead(track, track.sigma[number], (number - 1, number + 1))
        return self._on(track, number, place)

    def _ahead(self, track: Track, sigma: float, numbers: tuple[int, int]) -> int | None:
        """Which of two points is a lasting regime further on in the sweep; None where neither."""
        for number in numbers:
            inside = 0 <= number < len(track.points) and track.lasting[number]
            if inside and (track.sigma[number] - sigma) * self.direction > 0.0:
                return number
        return None

    # Jumps

    def _jump(self, before: SweepState, after: SweepState) -> Jump:
        family = self.finder.family
        return Jump(
            upwards=self.upwards,
            value=float(family.value(before.sigma)),
            frequency_hz=float(family.frequency_hz(before.sigma)),
            displacement_max=(
                before.displacement * family.length,
                after.displacement * family.length,
            ),
            impact_speed=(before.speed * family.speed, after.speed * family.speed),
        )

    def _beyond(self, end: SweepState) -> tuple[Jump | None, SweepState | None]:
        """The jump at the end of a branch, if there is one, and the motion a little further on."""
        near, far = (distance / self.finder.family.span for distance in BEYOND)
        first = self._from(end, near)
        there = first and self._from(first, far, slowly=self._turns(end))
        if first is None or there is None:
            return None, there
        if there.place is None and self._change(end, there) <= SMALLEST_STEP:
            # it may grow gradually, too, and go back too slowly to be seen
            there = self._pushed(end, there)
            return (self._jump(end, there) if self._change(end, there) > LEAP else None), there
        jumped = (
            self._change(end, first) > ABRUPT
            or (self._turns(end) and self._change(end, there) > SMALLEST_STEP)
            or self._has_jumped(end, there)
        )
        return (self._jump(end, there) if jumped else None), there

    def _turns(self, end: SweepState) -> bool:
        """Whether a branch turns back at its end: chaos beyond it may leave no second motion."""
        if end.place is None:
            return False
        track, near = end.place.track, BEYOND[1] / self.finder.family.span
        folds = track.sigma[[name == FOLD for name in track.names]]
        return bool(np.any(np.abs(folds - end.sigma) < near))

    def _pushed(self, end: SweepState, there: SweepState) -> SweepState:
        """The motion to which a perturbation leads from the end of a branch."""
        state = there.state.copy()
        state[len(state) // 2 :] *= 1.0 - PUSH
        for _ in range(PUSHED):
            further = self._reached(there.sigma, state, there.phase)
            if further is None:
                break
            there, state = further, further.state
            if there.place is not None or self._change(end, there) > LEAP:
                break
        return there

    def _has_jumped(self, before: SweepState, after: SweepState) -> bool:
        """Whether a motion has changed by much, and does not go back with the value."""
        if self._change(before, after) <= SMALLEST_STEP:
            return False
        behind = BEYOND[0] / self.finder.family.span + abs(after.sigma - before.sigma)
        back = self._from(after, -behind)
        return back is None or self._change(before, back) > SMALLEST_STEP

    def _change(self, before: SweepState, after: SweepState) -> float:
        """The larger one of the relative changes of displacement and speed."""
        omega = self.finder.motion(before.sigma).omega
        displacement = max(before.displacement, after.displacement)
        speed = max(before.speed, after.speed, omega * displacement)
        if displacement == 0.0:
            return 0.0
        return max(
            abs(after.displacement - before.displacement) / displacement,
            abs(after.speed - before.speed) / speed,
        )

    def _located(self, before: SweepState, after: SweepState) -> Iterator[Jump]:
        """The jump between two values of the sweep, if it still is one at its place."""
        for _ in range(HALVINGS):
            there = self._from(before, 0.5 * abs(after.sigma - before.sigma))
            if there is None:
                break
            if self._change(before, there) > LEAP:
                after = there
            else:
                before = there
        if self._change(before, after) > LEAP:
            yield self._jump(before, after)


# ------------------------------------------------------------------------------
# Periodic regimes of a scene under its sines: over frequency, or over any key of the scene.
# ------------------------------------------------------------------------------


FREQUENCY = "frequency_hz"
"""Name of the varied number where it is the frequency of the sine itself."""

MARGIN = 1e-3
"""Share of its value by which a single value is widened to a range."""

WIDEST = 1e5
"""Largest ratio of the frequencies of one range: up to it, the series of the numbers of a scene
give the lowest ones to 1e-8."""

MOST_VALUES = 100_000
"""Largest number of values of the varied number."""


@calculation
def harmonic_response(
    scene: Scene,
    frequency_hz: ArrayLike | None = None,
    *,
    form: str = "exact",
    vary: Mapping[str, Sequence[float]] | None = None,
    coordinate: str | None = None,
    most_impacts: int = DEFAULT_IMPACTS,
    sweep: str | None = None,
    budget: float | None = None,
) -> HarmonicResponse:
    """The periodic regimes of a structure with stops under a sine or a sum of sines.

    Between impacts the motion is linear and exact. Newton's iteration finds regimes with a given
    order of impacts in a number of periods from the phases of the impacts. Branches are followed by
    length of arc, through folds. The multipliers are those of the map over a period, in which an
    impact turns a perturbation by its saltation matrix.

    In contact with a compliant stop the motion is linear, too, or linear piece by piece. Regimes
    are then states at the phase 0 that the flow takes back to themselves. Flights from several
    states and from random ones look for them, slow sweeps up and down, and Newton's iteration. All
    search over the range of the values; the values say only where branches are drawn. Chatter that
    ends at rest on a rigid stop is followed by flights. With Hertz's law, and where springs or
    dampers are functions, motion is integrated by extrapolation of order 8, which ends at each
    kink. Friction holds a mass at rest, and hysteresis keeps its memory.

    Percussion machines, free bodies under a feed, are among the structures: their impact speed (B
    4.20), the range of their regimes (B 4.21) and of both branches (B 4.12, 4.28).

    Parameters
    ----------
    scene
        A structure under constant loads and sines whose frequencies are multiples of one; its
        springs and dampers may be functions of the motion.
        Its stops may have any law whose numbers are given, and any gap or preload. Noise is left
        out, with a warning.
    frequency_hz
        Frequencies of the lowest common multiple of the sines, at which regimes are wanted; by
        default that of the scene.
    form
        "exact"; or harmonic linearisation of one oscillator by "motion" or by "force" (B 9.13),
        beside the exact motion without impacts and with its error against the exact regimes.
    vary
        Instead: one key of the scene with its values.
    coordinate
        The coordinate or point whose displacement and acceleration are given. By default that is
        the first point of a structure that is made of modes, else the first coordinate.
    most_impacts
        Largest number of impacts per period of the regimes that Newton's iteration looks for;
        regimes of more impacts are found only where simulations settle to them, and a warning says
        so where there are more stops than that.
    sweep
        "up", "down" or "both": simulate such a slow sweep as well, 300 periods at each value.
    budget
        Seconds of wall time, without the minute or so in which kernels are compiled, once on each
        machine.

    Returns
    -------
    HarmonicResponse
        Every regime that was found, its stability, and what was simulated.

    Raises
    ------
    NotApplicable
        If the scene is not of that kind.
    NotConverged
        If the budget ends first; the error holds the branches so far.

    See Also
    --------
    stochvi.simulate : The motion under noise, with or without a sine.

    Examples
    --------
    An isolator that may clatter between its stops where its motion without impacts fits:

    >>> from stochvi import ImpactPair, Oscillator, Restitution, Sine
    >>> mount = Scene(
    ...     structure=Oscillator(mass=1.0, damping=12.5, stiffness=62.8**2),
    ...     impact_pairs=[
    ...         ImpactPair(lower=-4e-4, upper=4e-4, law=Restitution(coefficient=0.5))
    ...     ],
    ...     excitations=[Sine(amplitude=1e-4 * 628.0**2, frequency_hz=628.0 / 6.283185307179586)],
    ... )
    >>> found = harmonic_response(mount).at(628.0 / 6.283185307179586)
    >>> found[found["periods"] == 1][["impact_speed_max", "stable"]].round(4).values.tolist()
    [[0.2246, True], [0.0, True], [0.1771, False]]
    """
    began = time.perf_counter()
    if form not in FORMS:
        raise ValueError(f"form must be one of {', '.join(FORMS)}, got {form!r}")
    if sweep not in SWEEPS:
        raise ValueError(f"sweep must be 'up', 'down' or 'both', got {sweep!r}")
    if most_impacts < 1:
        raise ValueError(f"most_impacts must be at least 1, got {most_impacts}")
    deadline = Deadline.after(budget)
    key, values, scene_at = varied(scene, frequency_hz, vary)
    model = model_of(scene_at(float(values[0])))
    if conditions := unmet(model, any_force=True) if form == "exact" else not_covered(model):
        raise NotApplicable("sine" if form == "exact" else f"sine:{form}", conditions)
    low, high = float(values[0]), float(values[-1])
    if key == FREQUENCY and high > WIDEST * low:
        raise ValueError(
            f"frequency_hz must span at most a factor of {WIDEST:g}, got {low:g} to {high:g} Hz; "
            "ask for narrower ranges one by one"
        )
    if low == high:
        wide = MARGIN * (abs(low) or 1.0)
        low, high = low - wide, high + wide
    shown = (each for each in scene.expanded.structure.shown if each in model.outputs)
    coordinate = coordinate or next(shown, model.outputs[0])
    finder = searching(scene_at, (low, high), values, coordinate, most_impacts, deadline)
    jumps, starts = list[Jump](), None
    with graceful_interrupt():
        finder.find()
        sweeps = [Sweep(finder, upwards=upwards) for upwards in (True, False) if len(values) > 1]
        for each in sweeps:
            jumps += each.jumps()
        if form == "exact":
            starts = _starts(
                finder, finder.scattered(), [s for each in sweeps for s in each.elsewhere]
            )
        simulated = tuple(_simulated(finder, values, upwards) for upwards in SWEEPS[sweep])
    tracks = [*finder.tracks, *finder.rests.tracks]
    branches = tuple(_branch_of_regimes(finder, values, track) for track in tracks)
    error = None
    if form != "exact":
        found = linearised(lambda value: model_of(scene_at(value)), values, form)
        error = _error(found, branches)
        branches = (*(each for each in branches if not each.stops), *found)
    how, few = finder.looked_for
    answer = HarmonicResponse(
        key=key,
        coordinate=coordinate,
        branches=branches,
        special_points=_special_points(branches) if form == "exact" else (),
        jumps=tuple(jumps),
        starts=starts,
        simulated=simulated,
        model_error=error,
        assumptions=(*scene.assumptions(), how if form == "exact" else HARMONIC),
        warnings=(
            *noise_left_out(model),
            *([few] if few and form == "exact" else []),
            *([starts.warning] if starts and starts.warning else []),
        ),
        cost=Cost(wall_time=time.perf_counter() - began),
        provenance=provenance(scene.document()),
    )
    if deadline.passed():
        raise deadline.fell_short("before all regimes were looked for", "ask for fewer", answer)
    return answer


HARMONIC = (
    "the motion is taken for a mean and one harmonic, and impacts for a spring and a damper; the "
    "speed of impacts is that of the harmonic, frequency times amplitude"
)
"""Assumption of harmonic linearisation."""

SWEEPS: dict[str | None, tuple[bool, ...]] = {
    None: (), "up": (True,), "down": (False,), "both": (True, False)
}  # fmt: skip
"""Whether each sweep by simulation goes upwards, by the value of `sweep`."""


def varied(
    scene: Scene, frequency_hz: ArrayLike | None, vary: Mapping[str, Sequence[float]] | None
) -> tuple[str, Vector, Callable[[float], Scene]]:
    """Name and rising values of the varied number, and a function that gives the scene at a
    value."""
    if vary is not None:
        if frequency_hz is not None or len(vary) != 1:
            raise ValueError(
                "vary must be one key of the scene with its values, without frequency_hz, got "
                f"{', '.join(vary) or 'none'}"
            )
        ((key, given),) = vary.items()
        document = scene.document(as_written=True)
        return key, _checked(key, given), lambda value: changed_scene(document, ((key, value),))
    sines = [each.frequency_hz for each in scene.excitations if isinstance(each, Sine)]
    if not sines:
        raise NotApplicable("sine", unmet(model_of(scene), any_force=True))
    lowest = min(sines)
    values = _checked(FREQUENCY, [lowest] if frequency_hz is None else frequency_hz)
    if not values[0] > 0.0:
        raise ValueError(f"frequency_hz must be greater than 0, got {values[0]:g}")
    return FREQUENCY, values, lambda value: at_frequency(scene, value / lowest)


def _checked(key: str, given: ArrayLike) -> Vector:
    values = np.unique(np.atleast_1d(np.asarray(given, dtype=float)))
    if not 0 < len(values) <= MOST_VALUES or not np.all(np.isfinite(values)):
        raise ValueError(
            f"{key} must have from 1 to {MOST_VALUES} finite values, got {len(values)}"
        )
    return values


def searching(
    scene_at: Callable[[float], Scene], ends: tuple[float, float], values: Vector,
    coordinate: str | None, most_impacts: int, deadline: Deadline,
) -> Finder:  # fmt: skip
    """The finder of the regimes of scenes between the ends of a range."""
    family = Family.of(lambda value: model_of(scene_at(value)), *ends, coordinate)
    finder = finder_of(family, family.sigma(values), most_impacts, deadline)
    if slow := too_slow(finder):
        raise NotApplicable("sine", slow)
    return finder


def too_slow(finder: Finder) -> str:
    """Why periods of the force hold too many steps at an end of the range; empty if they do not."""
    for sigma in (0.0, 1.0):
        motion = finder.motion(sigma)
        steps = 2.0 * np.pi / motion.omega / solver.step_of(motion)
        if not 0.0 < steps <= ROOT_STEPS:
            return (
                f"a period of the force must take at most {ROOT_STEPS} steps, got {steps:.3g} at "
                f"{float(finder.family.frequency_hz(sigma)):.3g} Hz; ask for higher frequencies"
            )
    return ""


def at_frequency(scene: Scene, factor: float) -> Scene:
    """The scene with the frequencies of its sines multiplied."""
    changed = tuple(
        each.model_copy(update={"frequency_hz": factor * each.frequency_hz})
        if isinstance(each, Sine)
        else each
        for each in scene.excitations
    )
    return scene.model_copy(update={"excitations": changed})


def _branch_of_regimes(finder: Finder, values: Vector, track: Track) -> Branch:
    # points between the values that were asked for show where there is no other
    named = np.array([name != NODE for name in track.names])
    shown = named if np.any(named & track.admissible) else np.ones(len(named), bool)
    track = track.part(shown)
    family, sigma, multiplier = finder.family, track.sigma, track.multiplier
    drawn = np.array([name == POINT for name in track.names])
    value = np.where(drawn, _asked(finder, values, sigma), family.value(sigma))
    frequency = family.frequency_hz(sigma)
    return Branch(
        form="exact",
        stops=tuple(family.stops[stop] for stop in track.stops),
        sticking=tuple(family.stops[stop] for stop in track.rests),
        periods=track.periods,
        value=value,
        frequency_hz=np.where(np.isclose(value, frequency, rtol=1e-9, atol=0.0), value, frequency),
        displacement_max=track.displacement * family.length,
        amplitude=family.length * finder.amplitude(track),
        acceleration_max=track.acceleration * family.length / family.time**2,
        phase=track.phases,
        **family.states(track.starts, sigma),
        impact_speed=track.speeds * family.speed,
        multiplier=multiplier,
        stable=multiplier < finder.stable,
        admissible=track.admissible,
        names=tuple(POINT if name == NODE else name for name in track.names),
    )


def _asked(finder: Finder, values: Vector, sigma: Vector) -> Vector:
    """The nearest values that were asked for, to the last digit."""
    return np.asarray(values[np.argmin(np.abs(finder.grid - sigma[:, None]), axis=1)])


def _starts(finder: Finder, scattered: Scattered, swept: Sequence[float]) -> RandomStarts:
    """Ends of random starts, and where they or slow sweeps ended on no branch."""
    places = np.concatenate([scattered.sigma[~scattered.listed], swept])
    values = finder.family.value(places)
    return RandomStarts(
        number=len(scattered.listed),
        listed=int(scattered.listed.sum()),
        elsewhere=(float(values.min()), float(values.max())) if len(values) else None,
    )


def _special_points(branches: Sequence[Branch]) -> tuple[SpecialPoint, ...]:
    found = [
        SpecialPoint(
            name=name,
            branch=number,
            value=float(branch.value[place]),
            frequency_hz=float(branch.frequency_hz[place]),
        )
        for number, branch in enumerate(branches)
        for place, name in enumerate(branch.names)
        if name and branch.admissible[place]
    ]
    return tuple(sorted(found, key=lambda point: (point.value, point.branch)))


def _error(found: Sequence[Branch], exact: Sequence[Branch]) -> dict[str, float | None]:
    """Distance of stable harmonic regimes from the fastest exact stable ones at the same values."""
    differences, missing = list[float](), 0
    for branch in found:
        if not branch.stable.any():
            continue
        for value, speed in zip(branch.value, branch.impact_speed[:, 0], strict=True):
            known = [
                float(each.impact_speed[place].mean())
                for each in exact
                for place in each.at(float(value))
                if each.stable[place] and each.periods == 1 and each.impacts_per_period
                and len(each.stops) == len(branch.stops)
            ]  # fmt: skip
            missing += not known
            differences += [abs(float(speed) / max(known) - 1.0)] if known else []
    total = len(differences) + missing
    return {
        "median": float(np.median(differences)) if differences else None,
        "largest": max(differences, default=None),
        "without_exact": missing / total if total else None,
    }


def _simulated(finder: Finder, values: Vector, upwards: bool) -> SimulatedSweep:
    rows = np.array(list(Sweep(finder, upwards=upwards).simulated())).reshape(-1, 4)
    return SimulatedSweep(
        upwards=upwards,
        value=_asked(finder, values, rows[:, 0]),
        displacement_max=finder.family.length * rows[:, 1],
        impact_speed_max=finder.family.speed * rows[:, 2],
        periods=rows[:, 3].astype(np.int64),
    )


def noise_left_out(model: Model) -> tuple[str, ...]:
    if not model.noisy:
        return ()
    return ("the noise of the scene is left out: these are regimes of its sines alone",)
