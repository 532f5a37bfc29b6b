"""Transients: the probability density in time, from any start, between rigid stops.

The equation is p_t = -v p_x + [(b v + omega^2 x - load) p]_v + S0 / 2 p_vv, with the term of the
stops of the stationary equation. It is solved by the same functions of displacement and velocity.
All times follow from one factorisation (`evolution`). A start at a point is a Gaussian distribution
until the stops can be felt; it is followed from there.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from stochvi.mathematics.arrays import Array
from stochvi.mathematics.state_space import step_covariance, transition
from stochvi.methods.fokker_planck.conditions import check_rtol, unmet_by_transient
from stochvi.methods.fokker_planck.error_margins import ErrorMargins
from stochvi.methods.fokker_planck.evolution import projections, time_groups
from stochvi.methods.fokker_planck.fixed_meshes import FASTEST
from stochvi.methods.fokker_planck.initial_states import (
    Gaussian,
    InitialState,
    Start,
    StartChoice,
    start_of,
)
from stochvi.methods.fokker_planck.linear_boxes import boxes_of, speed_scale
from stochvi.methods.fokker_planck.meshes_in_time import (
    LEVELS,
    MOST_UNKNOWNS,
    Layout,
    Level,
    mesh,
    restitutions,
    stops_layout,
)
from stochvi.methods.fokker_planck.method import SLOW_IMPACTS
from stochvi.methods.fokker_planck.operators import Factors, Operator
from stochvi.methods.fokker_planck.refinement import TIME_RATIO, accurate
from stochvi.model.calculations import calculation
from stochvi.model.model import Model, model_of
from stochvi.model.oscillator_arrays import OscillatorArrays
from stochvi.results.base import Result
from stochvi.results.deadline import Deadline
from stochvi.results.errors import NotApplicable
from stochvi.results.estimates import Cost, provenance
from stochvi.scenes.scene import Scene

if TYPE_CHECKING:
    import pandas as pd

METHOD = "transient"

MIN_STOP_DISTANCE = 5.5
"""Number of standard deviations that a distribution of displacement stays away from the stops while
they are left out: they would have been met with a probability below 2e-7."""

LONGEST_FLIGHT = 1.0
"""Longest flight of an initial point without stops, in natural periods over 2 pi."""

FLIGHT_STEPS = 60
"""Number of times up to LONGEST_FLIGHT at which it is checked whether the stops can be felt."""

MOST_BEYOND = 1e-6
"""Largest probability of an initial distribution beyond the stops; that part is left out."""

MARGINS = ErrorMargins(safety=2.5, shared=0.3, floor=1e-06)
"""Safety factors of the error bounds, the same as those of `fixed_meshes`."""

PROJECTION_SHARE = 0.1
"""Share of the allowed relative error that the projection in time may take."""


class Moments(NamedTuple):
    """Averages at each time, SI units; rates, F1 (`speed_rate`), F2 (`speed_square_rate`) of the
    stops, 0 where there is none. Rates count impacts above the speed threshold."""

    mean: Array
    variance: Array
    velocity_mean: Array
    velocity_mean_square: Array
    rate_lower: Array
    rate_upper: Array
    speed_rate_lower: Array
    speed_rate_upper: Array
    speed_square_rate_lower: Array
    speed_square_rate_upper: Array


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Transient(Result):
    """Averages of displacement and velocity while their density approaches the stationary one.

    Attributes
    ----------
    times
        Seconds.
    values, errors
        Averages at each time, and bounds on their errors from two meshes.
    speed_threshold
        Slowest impact that rates count, m/s.

    See Also
    --------
    stochvi.transient : The calculation.
    """

    not_in_document = ("_states",)

    times: tuple[float, ...]
    values: Moments
    errors: Moments
    speed_threshold: float
    method: str = METHOD
    effects: Sequence[str] = ()
    assumptions: Sequence[str] = ()
    _states: tuple[_State, ...] = field(default=())

    def density(self, x: ArrayLike, v: ArrayLike, index: int) -> Array:
        """Joint density at times[index], per m and m/s; x and v are broadcast to one shape."""
        places, speeds = np.broadcast_arrays(np.asarray(x, float), np.asarray(v, float))
        found = self._states[index].density(places.ravel(), speeds.ravel())
        return found.reshape(places.shape)

    def displacement_density(self, x: ArrayLike, index: int) -> Array:
        """Density of the displacement at times[index], per m."""
        places = np.asarray(x, float)
        return self._states[index].displacement_density(places.ravel()).reshape(places.shape)

    def to_frame(self) -> pd.DataFrame:
        """A row per time: every average, and its error as `<name>_bias`."""
        import pandas as pd

        columns: dict[str, Any] = {"time": self.times, **self.values._asdict()}
        columns |= {f"{name}_bias": column for name, column in self.errors._asdict().items()}
        return pd.DataFrame(columns)

    def __repr__(self) -> str:
        ends = ", ".join(f"{moment:g}" for moment in self.times[:3])
        more = ", ..." if len(self.times) > 3 else ""
        return f"<{self.method} at {ends}{more} s>"


class _State(NamedTuple):
    """A density on a mesh, or one that no stop has touched yet."""

    operator: Operator | None
    coefficients: Array | None
    law: Gaussian | None

    def density(self, x: Array, v: Array) -> Array:
        if self.law is not None:
            return self.law.density(x, v)
        assert self.operator is not None
        assert self.coefficients is not None
        return self.operator.density(self.coefficients, x, v)

    def displacement_density(self, x: Array) -> Array:
        if self.law is not None:
            deviation = self.law.deviations[0]
            scaled = (x - self.law.mean[0]) / deviation
            normal: Array = np.exp(-(scaled**2) / 2.0) / (deviation * math.sqrt(2.0 * math.pi))
            return normal
        assert self.operator is not None
        assert self.coefficients is not None
        return self.operator.displacement_density(self.coefficients, x)


@calculation
def transient(
    scene: Scene,
    times: ArrayLike,
    start: StartChoice = "rest",
    *,
    rtol: float = 1e-3,
    speed_threshold: float | None = None,
    budget: float | None = None,
) -> Transient:
    """The density of displacement and velocity in time, between rigid stops of any restitution.

    Parameters
    ----------
    scene
        One oscillator under white noise and any constant load, without stops or with rigid ones.
    times
        Seconds, all of them after 0.
    start
        "rest" where spring and load balance, a point (m, m/s), or a `Gaussian` between the stops.
    rtol
        Relative error to reach in the deviation of displacement, the rms velocity, F1 and F2:
        of each, relative to the largest value over the times.
    speed_threshold
        Slowest impact that rates count, m/s; default as in `fokker_planck`.
    budget
        Seconds after which `NotConverged` is raised; None for no limit.

    Returns
    -------
    Transient
        SI units, with bounds on the errors from the difference of the two finest meshes.

    Raises
    ------
    NotApplicable, NotConverged, ValueError
        With every condition that the scene does not meet; if the finest mesh does not reach rtol
        (`partial` holds what it reached); if an argument is out of range.

    See Also
    --------
    stochvi.first_passage : The probability of a first passage.
    stochvi.fokker_planck : The same from the Fokker-Planck equation.

    Examples
    --------
    >>> from stochvi.scenes.impact_laws import Restitution
    >>> from stochvi.scenes.excitations import WhiteNoise
    >>> from stochvi.scenes.scene import ImpactPair
    >>> from stochvi.scenes.structures import Oscillator
    >>> scene = Scene(
    ...     structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
    ...     impact_pairs=[ImpactPair(lower=-1.0, upper=1.0, law=Restitution(coefficient=0.8))],
    ...     excitations=[WhiteNoise(intensity=0.2)],
    ... )
    >>> found = transient(scene, [1.0, 3.0, 100.0])
    >>> [f"{variance:.3f}" for variance in found.values.variance]
    ['0.051', '0.204', '0.283']
    """
    started, deadline = time.perf_counter(), Deadline.after(budget)
    moments = np.asarray(times, dtype=float).reshape(-1)
    if not (len(moments) and np.isfinite(moments).all() and (moments > 0.0).all()):
        raise ValueError(
            f"times must be one or more finite numbers above 0 (s), got {moments.tolist()}"
        )
    check_rtol(rtol)
    model = model_of(scene)
    unmet = unmet_by_transient(model)
    if unmet:
        raise NotApplicable(METHOD, unmet)
    problem = _problem(model, moments, start, speed_threshold)
    values, errors, states = _refined(problem, rtol, deadline)
    found = Transient(
        times=tuple(moments.tolist()),
        values=values,
        errors=errors,
        speed_threshold=problem.threshold,
        effects=scene.effects(),
        assumptions=scene.assumptions(),
        cost=Cost(wall_time=time.perf_counter() - started),
        provenance=provenance(scene.document()),
        _states=states,
    )
    remedy = "raise rtol, or start from a wider law. A start close to a stop is the hardest case."
    return accurate(found, _worst(values, errors), rtol, deadline, started, METHOD, remedy)


class _Problem(NamedTuple):
    """The equations to be solved; the times `early` are those at which the law has not reached the
    stops."""

    model: Model
    layout: Layout
    law: Gaussian
    flight: float
    times: Array
    early: tuple[Gaussian | None, ...]
    threshold: float
    stops: tuple[bool, bool]


def _problem(model: Model, times: Array, given: StartChoice, threshold: float | None) -> _Problem:
    if isinstance(given, str) and given == "stationary":
        raise ValueError("start must be 'rest', a point or a Gaussian, got 'stationary'")
    start = start_of(given, model)
    oscillator = OscillatorArrays.of(model)
    lower, upper = oscillator.positions[:, 0].tolist()
    walls = restitutions(model.stops)
    own = speed_scale(oscillator)
    if threshold is None:
        threshold = 0.0 if model.elastic else SLOW_IMPACTS * float(own[0])
    speed = float(boxes_of(oscillator, own, 1.0).speed[0])
    layout = stops_layout(model, lower, upper, walls, speed, start)
    flight, law = _flight(model, start, lower, upper, layout)
    early = tuple(
        _law_after(model, start, moment)
        if isinstance(start, InitialState) and moment <= flight
        else None
        for moment in times
    )
    stops = math.isfinite(lower), math.isfinite(upper)
    return _Problem(model, layout, law, flight, times, early, threshold, stops)


def _law_after(model: Model, start: InitialState, seconds: float) -> Gaussian:
    """The law of a start from a point after some time without stops."""
    square = model.omega**2
    # the load as a third, constant state
    generator = np.array([[0.0, 1.0, 0.0], [-square, -model.damping_rate, 1.0], [0.0, 0.0, 0.0]])
    noise = np.diag([0.0, model.intensity, 0.0])
    step = transition(generator, seconds)
    spread = step_covariance(generator, noise, seconds)[:2, :2]
    mean = step @ np.array([*start, model.load])
    (xx, xv), (_, vv) = spread.tolist()
    return Gaussian(mean=(float(mean[0]), float(mean[1])), covariance=((xx, xv), (xv, vv)))


def _flight(
    model: Model, start: Start, lower: float, upper: float, layout: Layout
) -> tuple[float, Gaussian]:
    """Time until which a start is free of the stops, and its law then."""
    if isinstance(start, Gaussian):
        beyond = start.beyond(lower, upper)
        if beyond > MOST_BEYOND:
            raise ValueError(
                f"start must lie between the stops, got a distribution with {100.0 * beyond:.2g} % "
                "beyond them; give one that is narrower"
            )
        return 0.0, start
    if not lower < start.x < upper:
        raise ValueError(
            f"start must lie between the stops, {lower:g} and {upper:g} m, got {start.x:g} m; "
            "give start=(x, v)"
        )
    longest = LONGEST_FLIGHT * layout.box.time / layout.natural
    # quadratic: as fine early on, where a start near a stop has little time
    tried = longest * (np.arange(1, FLIGHT_STEPS + 1) / FLIGHT_STEPS) ** 2
    flight, law = tried[0] * FIRST_FLIGHT, None
    for seconds in tried:
        after = _law_after(model, start, float(seconds))
        room = MIN_STOP_DISTANCE * after.deviations[0]
        if not (lower + room <= after.mean[0] <= upper - room):
            break
        flight, law = float(seconds), after
    return flight, law or _law_after(model, start, flight)


FIRST_FLIGHT = 0.1
"""Flight of a start very close to a stop, as a part of the shortest flight that is checked."""


def _functionals(operator: Operator, problem: _Problem) -> Array:
    """Mass, mean, mean square, mean velocity and its square, rates, F1, F2: (11, n)."""
    velocity = operator.mesh.velocity
    threshold = np.array([problem.threshold / operator.box.speed])
    rows = [operator.moment(i, j) for i, j in ((0, 0), (1, 0), (2, 0), (0, 1), (0, 2))]
    counted = (
        (velocity.flux_above(threshold)[0], 1.0),
        (velocity.half_moments[2], operator.box.speed),
        (velocity.half_moments[3], operator.box.speed**2),
    )
    for half, unit in counted:
        for side, there in zip((-1, 1), problem.stops, strict=True):
            rows.append(unit * there * operator.arrivals(side, half))
    return np.array(rows)


def _averages(found: Array, problem: _Problem) -> Moments:
    """Averages from the functionals, (times, 11)."""
    mass, first, second = found[:, 0], found[:, 1], found[:, 2]
    mean = first / mass
    scaled = found[:, 3:] / mass[:, None]
    return Moments(
        problem.layout.box.centre + mean,
        second / mass - mean**2,
        *(column for column in scaled.T),
    )


def _with_early(values: Moments, problem: _Problem) -> Moments:
    """Averages completed by the exact ones of the times before the law reaches a stop."""
    columns = [column.copy() for column in values]
    for place, law in enumerate(problem.early):
        if law is not None:
            square = law.covariance[1][1] + law.mean[1] ** 2
            exact = (law.mean[0], law.covariance[0][0], law.mean[1], square)
            for column, value in zip(columns[:4], exact, strict=True):
                column[place] = value
            for column in columns[4:]:
                column[place] = 0.0
    return Moments(*columns)


def _on_level(
    problem: _Problem, level: Level, rtol: float
) -> tuple[Moments, Moments, Operator, Array]:
    """Averages, the error of the projection in time, and the coefficients, (times, n)."""
    layout, second = problem.layout, problem.layout.box.time
    operator = Operator(layout.box, mesh(layout, level), layout.walls)
    weights = operator.integrals(problem.law.density, *problem.law.grids())
    initial = Factors(operator.mass).solve(weights)
    rows = _functionals(operator, problem)
    source = operator.matrix @ initial
    later = np.maximum(problem.times - problem.flight, 0.0) / second
    states = np.tile(initial, (len(later), 1))
    gaps = [np.zeros(len(later)) for _ in Moments._fields]
    for places, shift in time_groups(later, layout.natural):
        shifted = operator.factorised(shift)
        before: Moments | None = None
        for projection in projections(operator.mass, shifted.solve, source, shift):
            passed = projection.accumulated(later[places])
            found = rows @ initial - passed @ (rows @ projection.basis).T
            values = _averages(found, problem)
            if before is not None:
                for gap, new, old in zip(gaps, values, before, strict=True):
                    gap[places] = np.where(np.isfinite(new - old), np.abs(new - old), np.inf)
                change = Moments(*(gap[places] for gap in gaps))
                if _worst(values, change) <= PROJECTION_SHARE * rtol:
                    break
            before = values
        states[places] = initial - passed @ projection.basis.T
    found = states @ rows.T
    return _averages(found, problem), Moments(*gaps), operator, states / found[:, :1]


def _refined(
    problem: _Problem, rtol: float, deadline: Deadline
) -> tuple[Moments, Moments, tuple[_State, ...]]:
    """Averages, bounds on their errors and densities, on the first level that reaches rtol."""
    coarse: Moments | None = None
    values = errors = operator = states = None
    took = 0.0
    for level in LEVELS:
        if values is not None and (
            mesh(problem.layout, level).unknowns > MOST_UNKNOWNS
            or deadline.left <= TIME_RATIO * took
        ):
            break
        began = time.perf_counter()
        fine, projected, operator, states = _on_level(problem, level, rtol)
        fine = _with_early(fine, problem)
        if coarse is not None:
            values, errors = fine, _bounds(coarse, fine, projected)
            errors = _with_lost_rates(values, errors, problem)
            if _worst(values, errors) <= rtol:
                break
        coarse, took = fine, time.perf_counter() - began
    assert values is not None
    assert errors is not None
    assert states is not None
    found = tuple(
        _State(operator, state, None) if law is None else _State(None, None, law)
        for state, law in zip(states, problem.early, strict=True)
    )
    return values, errors, found


def _with_lost_rates(values: Moments, errors: Moments, problem: _Problem) -> Moments:
    """Errors, where the rates count impacts faster than any that the meshes find: at most F2 over
    the squared threshold are faster."""
    if problem.threshold <= FASTEST * problem.layout.box.speed:
        return errors
    square = problem.threshold**2
    bounds = {
        f"rate_{side}": (
            np.abs(getattr(values, f"speed_square_rate_{side}"))
            + getattr(errors, f"speed_square_rate_{side}")
        )
        / square
        for side in ("lower", "upper")
    }
    return errors._replace(**bounds)


def _sizes(values: Moments) -> Moments:
    """Sizes to which errors are relative: the largest over the times and over both stops."""

    def largest(*columns: Array) -> Array:
        return np.full(len(values.mean), max(float(np.max(np.abs(c))) for c in columns))

    x, v = largest(np.sqrt(np.abs(values.variance))), largest(values.velocity_mean_square)
    return Moments(
        x, x**2, np.sqrt(v), v,
        *[largest(values.rate_lower, values.rate_upper)] * 2,
        *[largest(values.speed_rate_lower, values.speed_rate_upper)] * 2,
        *[largest(values.speed_square_rate_lower, values.speed_square_rate_upper)] * 2,
    )  # fmt: skip


GOVERNED = {
    "variance": 0.5,
    "velocity_mean_square": 0.5,
    "speed_rate_lower": 1.0,
    "speed_rate_upper": 1.0,
    "speed_square_rate_lower": 1.0,
    "speed_square_rate_upper": 1.0,
}
"""The averages that rtol governs, each with the part of its relative error that counts: a root
has half the relative error of its square."""


def _worst(values: Moments, errors: Moments) -> float:
    sizes = _sizes(values)
    ratios = [0.0]
    for name, part in GOVERNED.items():
        size = getattr(sizes, name)[0]
        error = float(np.max(getattr(errors, name)))
        if not math.isfinite(error):
            return math.inf
        if size > 0.0:
            ratios.append(part * error / size)
    return max(ratios)


def _bounds(coarse: Moments, fine: Moments, projected: Moments) -> Moments:
    differences = Moments(
        *(
            MARGINS.safety * np.abs(a - b) + c
            for a, b, c in zip(coarse, fine, projected, strict=True)
        )
    )
    shared = MARGINS.shared * _worst(fine, differences) + MARGINS.floor
    sizes = _sizes(fine)
    return Moments(*(np.maximum(d, shared * s) for d, s in zip(differences, sizes, strict=True)))
