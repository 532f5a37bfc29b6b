"""Motion in time without sampling. Chapters: bounds on passages; first passage of a barrier;
transients of the density from any start."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stochvi.mathematics.impact_rates import rice_rate
from stochvi.mathematics.numerics import Array
from stochvi.mathematics.spectra import step_covariance, transition
from stochvi.mathematics.units import RATE, TIME
from stochvi.methods.fokker_planck.basis import ErrorMargins, Mesh, boxes_of
from stochvi.methods.fokker_planck.density import accurate, in_pairs
from stochvi.methods.fokker_planck.in_time import (
    Factors,
    Gaussian,
    InitialState,
    Layout,
    Operator,
    SlowestMode,
    Start,
    StartChoice,
    barrier_height,
    meshes,
    passage_layout,
    projections,
    restitutions,
    slowest_mode,
    start_of,
    stops_layout,
    time_groups,
)
from stochvi.methods.fokker_planck.motion import (
    barriers,
    box_ends,
    check_rtol,
    turning_stops,
    unmet_by_first_passage,
    unmet_by_transient,
)
from stochvi.methods.fokker_planck.stationary import FASTEST
from stochvi.model.gap import OscillatorArrays
from stochvi.model.model import Model, Stop, model_of
from stochvi.model.scales import SLOW_IMPACTS, default_thresholds
from stochvi.results.base import DataFrame, Result, frame_of
from stochvi.results.deadline import Deadline
from stochvi.results.errors import NotApplicable, NotConverged
from stochvi.results.estimates import Cost, Estimate, plus_minus, provenance
from stochvi.sampling.calculations import calculation
from stochvi.scenes.scene import Scene

# ------------------------------------------------------------------------------
# How many passages there can be at most, before any equation is solved.
#
# A path that passes before t crosses a barrier outwards at least once. Its probability is therefore
# at most the mean number of such crossings. Sources: S. O. Rice, Bell Syst. Tech. J. 24 (1945) 46;
# for a distribution that changes in time M. R. Leadbetter and H. Cramer, Stationary and Related
# Stochastic Processes, 1967, ch. 13.
# ------------------------------------------------------------------------------


PANELS = 64
"""Number of panels into which a time is divided; the bound holds for any number, and decreases with
it."""

FALLING = math.sqrt(2.0)
"""Number of standard deviations from where on z^2 exp(-z^2 / 2), and with it the bound, falls
with z."""


def passages_at_most(model: Model, start: Start, lower: float, upper: float, times: Array) -> Array:
    """A bound on P(a barrier is passed before t) of an oscillator that starts at a point.

    The crossings of x = B per unit time, p_x(B) E[max(v, 0) | x = B], are at most

        exp(-z^2 / 2) / (sqrt(2 pi) s_x) (r + (1 + z) s_v),    z = (d - r / omega) / s_x >= sqrt 2,

    where d is the distance of B from the position of rest. r^2 = v^2 + omega^2 x^2 of the mean
    motion never grows; the standard deviations s_x, s_v of a path from a point never fall. Each
    panel of time takes r from where it begins and the deviations from where it ends.

    Parameters
    ----------
    times
        Seconds, at least 0, (n,).

    Returns
    -------
    ndarray
        (n,), at most 1; 1 where nothing is known: other starts, no spring, barriers in reach.

    Examples
    --------
    >>> from stochvi.model.model import model_of
    >>> from stochvi.scenes.excitations import WhiteNoise
    >>> from stochvi.scenes.scene import Scene
    >>> from stochvi.scenes.structures import Oscillator
    >>> scene = Scene(
    ...     structure=Oscillator(mass=1.0, damping=0.02, stiffness=1.0),
    ...     excitations=[WhiteNoise(intensity=0.04)],
    ... )
    >>> times = np.array([6.28, 1e6])
    >>> bound = passages_at_most(model_of(scene), InitialState(0.0, 0.0), -5.0, 5.0, times)
    >>> [f"{value:.0e}" for value in bound]
    ['6e-46', '1e+00']
    """
    if model.omega == 0.0 or not isinstance(start, InitialState):
        return np.ones(len(times))
    rest = model.rest
    distances = np.array([rest - lower, upper - rest])
    state = np.array([start.x - rest, start.v])
    crossings = [_crossings(model, state, distances[np.isfinite(distances)], t) for t in times]
    return np.minimum(crossings, 1.0)


def _crossings(model: Model, state: Array, distances: Array, duration: float) -> float:
    """Bound on the crossings of all barriers together; infinite where there is no bound."""
    step = duration / PANELS
    generator = np.array([[0.0, 1.0], [-(model.omega**2), -model.damping_rate]])
    move = transition(generator, step)
    noise = step_covariance(generator, np.diag([0.0, model.intensity]), step)
    spread = np.zeros((2, 2))
    total = 0.0
    for _ in range(PANELS if duration > 0.0 else 0):
        spread = move @ spread @ move.T + noise
        fastest = math.hypot(model.omega * state[0], state[1])
        s_x, s_v = np.sqrt(np.diag(spread))
        z = (distances - fastest / model.omega) / s_x
        if (z < FALLING).any():
            return math.inf
        density = np.exp(-(z**2) / 2.0) / (math.sqrt(2.0 * math.pi) * s_x)
        total += step * float(np.sum(density * (fastest + (1.0 + z) * s_v)))
        state = move @ state
    return total


# ------------------------------------------------------------------------------
# First passage: when an oscillator under white noise first reaches a barrier, without sampling.
#
# Let u(x, v, t) be the probability that a path from (x, v) meets a barrier before t. It obeys the
# backward equation
#
#     u_t = v u_x + (load - omega^2 x - b v) u_v + S0 / 2 u_vv,   u = 1 where a path leaves,
#
# (Pontryagin, Andronov and Vitt 1933 for its mean; J. N. Yang, M. Shinozuka, J. Appl. Mech. 37
# (1970) 1017). Small probabilities are sums of what is absorbed, never one minus a survival, and
# keep their digits. With the slowest mode apart,
#
#     u = c phi (1 - exp(-lambda t)) + y(t),   y(t) -> 1 - c phi,
#
# where phi is the mode as a function, y follows by projection (`in_time`), and lambda is the
# outflow of the mode over what it holds.
# ------------------------------------------------------------------------------


METHOD = "first-passage"
HOW = "half-range Galerkin in time"

PASSAGE_MARGINS = ErrorMargins(safety=2.5, shared=0.3, floor=3e-08)
"""Margins of the error bounds: those of `stationary`, with a lower floor. The error that the
projection in time leaves at one time is not shared with the other times."""

PROJECTION_SHARE = 0.2
"""Share of the allowed relative error that the projection in time may take."""

HIGHEST = 10.0
"""Largest height of a barrier in standard deviations. A higher one is met at less than 1e-22 of the
natural frequency, where rounding would decide."""

MOST_BEYOND = 1e-9
"""Largest probability that a start has beyond a stop, where there is nothing to solve for."""

PLAUSIBLE = 10.0
"""Computed probability above which it comes from a mode of the mesh that grows, not from a mere
error."""


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class FirstPassage(Result):
    """First passage of a barrier: probabilities, mean time and decay rate.

    Attributes
    ----------
    times, probability
        Seconds, and P(first passage before each of them).
    mean_time
        Mean time to the first passage, s; starts beyond a barrier count as 0.
    decay_rate
        lambda of P(no passage before t) -> c exp(-lambda t), 1/s.
    rice_rate
        Mean rate of leaving through the barriers if nothing were stopped there (S. O. Rice 1945),
        1/s; None without a stationary distribution. A stationary start has passed before t with at
        most P(beyond a barrier) + rice_rate t. None where a stop turns paths back.
    lower, upper
        The barriers, m; None where there is none.

    See Also
    --------
    stochvi.first_passage : The calculation.
    """

    in_document: ClassVar = {"barriers": "barriers"}
    not_in_document = ("lower", "upper")

    times: tuple[float, ...]
    probability: tuple[Estimate, ...]
    mean_time: Estimate
    decay_rate: Estimate
    rice_rate: Estimate | None
    lower: float | None
    upper: float | None
    start: str
    method: str = METHOD
    effects: Sequence[str] = ()
    assumptions: Sequence[str] = ()

    def to_frame(self) -> DataFrame:
        """A row per time: seconds, probability, bound on its error."""
        return frame_of(
            {
                "time": self.times,
                "probability": [estimate.value for estimate in self.probability],
                "bias": [estimate.bias for estimate in self.probability],
            }
        )

    @property
    def barriers(self) -> Mapping[str, float | None]:
        """The barriers by their sides, m."""
        return {"lower": self.lower, "upper": self.upper}

    def summary(self) -> str:
        """The mean time to the passage, and its rates."""
        told = [
            f"mean time to the first passage {plus_minus(self.mean_time, TIME, 7)} {TIME}",
            f"rate in the end {plus_minus(self.decay_rate, RATE, 7)} {RATE}",
        ]
        known = [] if self.rice_rate is None else [f"Rice {RATE.text(self.rice_rate.value)}"]
        return "; ".join([*told, *known])


@calculation
def first_passage(
    scene: Scene,
    lower: float | None = None,
    upper: float | None = None,
    *,
    times: ArrayLike = (),
    start: StartChoice = "rest",
    rtol: float = 1e-4,
    budget: float | None = None,
) -> FirstPassage:
    """P(a barrier is reached before t), its mean time and its decay rate, for one oscillator.

    The probability u of a passage before t, from (x, v), obeys the equation adjoint to (B 13.34):
    u_t = v u_x - (b v + omega^2 x - load) u_v + S0 / 2 u_vv. It is 1 at the
    barriers. Meshes are refined until two of them agree.

    Parameters
    ----------
    scene
        One oscillator under white noise and any constant load. Its stops are the barriers
        where none are given, whatever their law: the first passage is the first impact. Given
        barriers must not lie beyond a stop. A rigid stop on the side without a barrier turns paths
        back.
    lower, upper
        Barriers, m from the position of the unloaded spring; one or both.
    times
        Seconds, in any order.
    start
        "rest" where spring and load balance; "stationary", the distribution without barriers and
        stops, whose part beyond a barrier counts as passed; a point (m, m/s); or a `Gaussian`.
        It must lie between a stop that turns paths back and the barrier.
    rtol
        Relative error to reach in every number, however small it is. At early times a probability
        P(t) may be smaller than 1 - exp(-lambda (t + three natural periods)); its error is then
        allowed to be rtol of that larger number. Where the probability is known to be smaller than
        the allowed error (`passages_at_most`), the bound on it is given as both value and bias.
    budget
        Seconds after which `NotConverged` is raised; None for no limit.

    Returns
    -------
    FirstPassage
        SI units; `bias` bounds each error by the difference of the two finest meshes.

    Raises
    ------
    NotApplicable, NotConverged, ValueError
        With every condition that the scene does not meet; if the finest mesh does not reach
        rtol (`partial` holds what it reached); if an argument is out of range.

    See Also
    --------
    stochvi.reliability : The probability that a mission goes wrong.
    stochvi.transient : Density and moments in time.

    Examples
    --------
    >>> from stochvi.scenes.excitations import WhiteNoise
    >>> from stochvi.scenes.structures import Oscillator
    >>> scene = Scene(
    ...     structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
    ...     excitations=[WhiteNoise(intensity=0.2)],
    ... )
    >>> found = first_passage(scene, -3.0, 3.0, times=[62.83])
    >>> print(f"{found.probability[0].value:.4f} in ten periods, on average {found.mean_time.value:.1f} s")
    0.0785 in ten periods, on average 570.4 s
    """  # noqa: E501
    started, deadline = time.perf_counter(), Deadline.after(budget)
    check_rtol(rtol)
    moments = np.asarray(times, dtype=float).reshape(-1)
    if not (np.isfinite(moments).all() and (moments >= 0.0).all()):
        raise ValueError(f"times must be finite and at least 0 s, got {moments.tolist()}")
    model = model_of(scene)
    unmet = unmet_by_first_passage(model, lower, upper)
    if len(model.coordinates) > 1:
        unmet.append("reliability finds the probability of impacts of any structure")
    if unmet:
        raise NotApplicable(METHOD, unmet)
    low, high = barriers(model, lower, upper)
    height = barrier_height(model, low, high)
    if height > HIGHEST:
        sentence = f"barriers must be within {HIGHEST:g} standard deviations, got {height:.3g}"
        raise NotApplicable(METHOD, sentence)
    begin, turning = start_of(start, model), turning_stops(model, low, high)
    _check_start(begin, *box_ends(model, low, high), turning)
    layout = passage_layout(model, low, high, begin)
    # impacts may bring a path to the barrier sooner
    free = passages_at_most(model, begin, low, high, moments)
    most = np.ones(len(moments)) if turning else free
    values, bounds = _refined(layout, begin, low, high, moments, most, rtol, deadline)
    numbers = [values.mean_time, values.rate, bounds.mean_time, bounds.rate]
    if not np.isfinite([*numbers, *values.probability, *bounds.probability]).all():
        raise NotConverged(
            f"{METHOD} found no finite answer on its meshes: the scales of spring, damping, noise "
            "and barriers are too far apart; simulate this scene"
        )
    found = FirstPassage(
        times=tuple(moments.tolist()),
        probability=tuple(
            Estimate(value=value, bias=bound, how=HOW)
            for value, bound in zip(
                np.clip(values.probability, 0.0, 1.0).tolist(),
                bounds.probability.tolist(),
                strict=True,
            )
        ),
        mean_time=Estimate(value=values.mean_time, bias=bounds.mean_time, how=HOW),
        decay_rate=Estimate(value=values.rate, bias=bounds.rate, how=HOW),
        rice_rate=None if turning else _rice_rate(model, low, high),
        lower=low if math.isfinite(low) else None,
        upper=high if math.isfinite(high) else None,
        start=start if isinstance(start, str) else str(begin),
        effects=[each for each in scene.effects() if turning or " stop " not in each],
        assumptions=_assumptions(scene, start, turning),
        cost=Cost(wall_time=time.perf_counter() - started),
        provenance=provenance(scene.document()),
    )
    remedy = "raise rtol. Very light damping and starts close to a barrier are the hardest cases."
    return accurate(found, _worst(values, bounds), rtol, deadline, started, METHOD, remedy)


def _assumptions(scene: Scene, start: StartChoice, turning: Sequence[Stop]) -> list[str]:
    found = ["displacements are measured from the position of the unloaded spring"]
    if not scene.structure.knows_mass:
        found.append("mass is not given: 1 kg, which nothing here depends on")
    found.append(
        f"the {turning[0].name} stop turns paths back, the first passage of the barrier ends them"
        if turning
        else "the first passage ends a path: what a stop does afterwards does not matter"
    )
    if start == "stationary":
        found.append(
            "starts in the stationary motion without barriers; a start beyond one counts as passed"
        )
    return [*found, *scene.at_means()]


def _rice_rate(model: Model, lower: float, upper: float) -> Estimate | None:
    """Rice's rate of both barriers together, 1/s."""
    if model.omega == 0.0 or model.damping_rate == 0.0:
        return None
    deviation = math.sqrt(model.intensity / 2.0 / model.damping_rate) / model.omega
    rate = sum(
        rice_rate(barrier - model.rest, deviation, model.omega * deviation)
        for barrier in (lower, upper)
    )
    # a rate that comes out as 0 is only less than the smallest number
    return Estimate(value=rate, bias=0.0 if rate else sys.float_info.min, how="Rice")


def _check_start(start: Start, lower: float, upper: float, turning: Sequence[Stop]) -> None:
    if isinstance(start, InitialState) and not lower < start.x < upper:
        what = "a stop and the barrier" if turning else "the barriers"
        raise ValueError(
            f"start must lie between {what}, {lower:g} and {upper:g} m, got {start.x:g} m"
        )
    if isinstance(start, InitialState):
        return
    for stop in turning:
        ends = (lower, math.inf) if stop.side < 0 else (-math.inf, upper)
        if (beyond := start.beyond(*ends)) > MOST_BEYOND:
            raise ValueError(
                f"start must lie between the {stop.name} stop and the barrier, got a probability "
                f"of {beyond:.2g} beyond the stop; start from rest, or in Python at an "
                "InitialState"
            )


class _Values(NamedTuple):
    """The numbers of an answer, or their errors; seconds. Errors of probabilities are relative to
    `scale`: themselves, or what the settled rate would give a little later."""

    probability: Array
    mean_time: float
    rate: float
    scale: Array


EARLY = 20.0
"""Errors are relative to a probability in which the settled rate has acted for this delay: a phase
of the inner dynamics, three natural periods."""


def _refined(
    layout: Layout, start: Start, lower: float, upper: float, times: Array, most: Array,
    rtol: float, deadline: Deadline,
) -> tuple[_Values, _Values]:  # fmt: skip
    """Values and bounds on their errors, on the first level that reaches rtol or the last."""
    answers = (
        _on_mesh(layout, mesh, start, lower, upper, times, most, rtol) for mesh in meshes(layout)
    )
    for (coarse, vague), (values, doubt) in in_pairs(answers, deadline):
        allowed = rtol * values.scale
        before, now = vague <= allowed, doubt <= allowed
        bounds = _bounds(coarse, values, doubt, before & now)
        # a finer mesh may have no modes that grow, but mends no other error of the projection
        if _worst(values, bounds) <= rtol or not (before | now).all():
            break
    return values, bounds


def _worst(values: _Values, errors: _Values) -> float:
    """The largest relative error."""
    if not (values.rate > 0.0 and values.mean_time > 0.0):
        return math.inf
    ends = max(errors.mean_time / values.mean_time, errors.rate / values.rate)
    return max(ends, float(np.max(errors.probability / values.scale, initial=0.0)))


def _bounds(coarse: _Values, fine: _Values, doubt: Array, projected: NDArray[np.bool_]) -> _Values:
    """Bounds on the errors; `projected` are the probabilities in which the meshes differ."""
    differences = fine._replace(
        probability=PASSAGE_MARGINS.safety * np.abs(fine.probability - coarse.probability),
        mean_time=PASSAGE_MARGINS.safety * abs(fine.mean_time - coarse.mean_time),
        rate=PASSAGE_MARGINS.safety * abs(fine.rate - coarse.rate),
    )
    of_meshes = differences._replace(probability=differences.probability * projected)
    shared = PASSAGE_MARGINS.shared * _worst(fine, of_meshes) + PASSAGE_MARGINS.floor
    return fine._replace(
        probability=np.maximum(differences.probability + doubt, shared * fine.scale),
        mean_time=max(differences.mean_time, shared * fine.mean_time),
        rate=max(differences.rate, shared * fine.rate),
    )


def _on_mesh(
    layout: Layout, mesh: Mesh, start: Start, lower: float, upper: float, times: Array,
    most: Array, rtol: float,
) -> tuple[_Values, Array]:  # fmt: skip
    """The results on one mesh, and the error of the projection in time.

    `most` are probabilities that none can exceed.
    """
    operator = Operator(layout.box, mesh, layout.walls)
    second = layout.box.time
    factors = operator.factorised(0.0)
    mode = slowest_mode(operator, factors)
    weights, passed = _start_functional(operator, layout, start, lower, upper)
    settled = float(weights @ mode.backward)
    slow = -np.expm1(-mode.rate * times / second) * settled
    left = operator.mass @ (operator.unity - mode.backward)
    rest = factors.solve_transposed(left)
    rest = rest - mode.backward * float(mode.forward @ (operator.mass @ rest))
    mean_time = (settled / mode.rate + float(weights @ rest)) * second
    later = -np.expm1(-mode.rate * (times / second + EARLY / layout.natural))
    allowed = PROJECTION_SHARE * rtol * np.maximum(passed, later)
    # where the bound leaves less than the error allowed, nothing is solved and it is the answer
    doubt = most - passed
    chances = most.copy()
    wanted = np.flatnonzero(doubt > allowed)
    fast, left_over = _projected(
        operator, layout.natural, mode, weights, times[wanted] / second, allowed[wanted]
    )
    chances[wanted] = np.clip(passed + slow[wanted] + fast, passed, most[wanted])
    doubt[wanted] = np.minimum(left_over, doubt[wanted])
    return _Values(chances, mean_time, mode.rate / second, np.maximum(chances, later)), doubt


def _projected(
    operator: Operator, natural: float, mode: SlowestMode, weights: Array, times: Array,
    allowed: Array,
) -> tuple[Array, Array]:  # fmt: skip
    """Functional y(t) of the start at times of the box, and the error of the projection."""
    source = operator.outflow - mode.rate * (operator.mass @ mode.backward)
    fast, change, doubt = np.zeros((3, len(times)))
    for places, shift in time_groups(times, natural):
        shifted = operator.factorised(shift)
        for projection in projections(operator.mass, shifted.solve_transposed, source, shift):
            found = projection.accumulated(times[places]) @ (projection.basis.T @ weights)
            # a space that is too small may have modes that grow
            good = np.abs(found) < PLAUSIBLE
            before = change[places]
            change[places] = np.where(good, np.abs(found - fast[places]), 1.0)
            # two sizes may agree by chance, three do not
            doubt[places] = np.maximum(change[places], before)
            fast[places] = np.where(good, found, fast[places])
            if (doubt[places] <= allowed[places]).all():
                break
    return fast, doubt


def _start_functional(
    operator: Operator, layout: Layout, start: Start, lower: float, upper: float
) -> tuple[Array, float]:
    """The mean over the start of a backward function, and the part that has passed already.

    In a halved box a path on the left counts as its mirror image on the right.
    """
    mirror = layout.box.centre - layout.box.half_length
    if isinstance(start, InitialState):
        point = start
        if layout.halved and start.x < mirror:
            point = InitialState(2.0 * mirror - start.x, -start.v)
        return operator.at(*point), 0.0
    x_grid, v_grid = start.grids()
    density = start.density
    if layout.halved:
        x_grid = np.union1d(x_grid, 2.0 * mirror - x_grid)
        v_grid = np.union1d(v_grid, -v_grid)

        def density(x: Array, v: Array) -> Array:
            return start.density(x, v) + start.density(2.0 * mirror - x, -v)

    weights = operator.integrals(density, x_grid, v_grid)
    return weights, start.beyond(lower, upper)


# ------------------------------------------------------------------------------
# Transients: the probability density in time, from any start, between rigid stops.
#
# The equation is p_t = -v p_x + [(b v + omega^2 x - load) p]_v + S0 / 2 p_vv, with the term of the
# stops of the stationary equation. It is solved by the same functions of displacement and velocity.
# All times follow from one factorisation (`in_time`). A start at a point is a Gaussian distribution
# until the stops can be felt; it is followed from there.
# ------------------------------------------------------------------------------


TRANSIENT = "transient"

MIN_STOP_DISTANCE = 5.5
"""Number of standard deviations that a distribution of displacement stays away from the stops while
they are left out: they would have been met with a probability below 2e-7."""

LONGEST_FLIGHT = 1.0
"""Longest flight of an initial point without stops, in natural periods over 2 pi."""

FLIGHT_STEPS = 60
"""Number of times up to LONGEST_FLIGHT at which it is checked whether the stops can be felt."""

TRANSIENT_MOST_BEYOND = 1e-6
"""Largest probability of an initial distribution beyond the stops; that part is left out."""

TRANSIENT_MARGINS = ErrorMargins(safety=2.5, shared=0.3, floor=1e-06)
"""Safety factors of the error bounds, the same as those of `stationary`."""

TRANSIENT_PROJECTION_SHARE = 0.1
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
    method: str = TRANSIENT
    effects: Sequence[str] = ()
    assumptions: Sequence[str] = ()
    _states: tuple[_OnMesh | Gaussian, ...] = field(default=())

    def density(self, x: ArrayLike, v: ArrayLike, index: int) -> Array:
        """Joint density at times[index], per m and m/s; x and v are broadcast to one shape."""
        places, speeds = np.broadcast_arrays(np.asarray(x, float), np.asarray(v, float))
        found = self._states[index].density(places.ravel(), speeds.ravel())
        return found.reshape(places.shape)

    def displacement_density(self, x: ArrayLike, index: int) -> Array:
        """Density of the displacement at times[index], per m."""
        places = np.asarray(x, float)
        return self._states[index].displacement_density(places.ravel()).reshape(places.shape)

    def to_frame(self) -> DataFrame:
        """A row per time: every average, and its error as `<name>_bias`."""
        columns: dict[str, Any] = {"time": self.times, **self.values._asdict()}
        columns |= {f"{name}_bias": column for name, column in self.errors._asdict().items()}
        return frame_of(columns)

    def summary(self) -> str:
        """The times."""
        return f"{len(self.times)} times from {TIME.span(min(self.times), max(self.times))}"


class _OnMesh(NamedTuple):
    """A density on a mesh."""

    operator: Operator
    coefficients: Array

    def density(self, x: Array, v: Array) -> Array:
        return self.operator.density(self.coefficients, x, v)

    def displacement_density(self, x: Array) -> Array:
        return self.operator.displacement_density(self.coefficients, x)


class _State(_OnMesh):
    """What older files call a density, with the law of one that no stop has touched yet."""

    def __new__(cls, operator: Any, coefficients: Any, law: Gaussian | None = None) -> Any:
        return law or _OnMesh(operator, coefficients)


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
        raise NotApplicable(TRANSIENT, unmet)
    problem = _problem(model, moments, start, speed_threshold)
    values, errors, states = _refined_transient(problem, rtol, deadline)
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
    return accurate(
        found, _worst_transient(values, errors), rtol, deadline, started, TRANSIENT, remedy
    )


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
    own = oscillator.speed_scale()
    if threshold is None:
        known = default_thresholds(model)
        threshold = (
            SLOW_IMPACTS * float(own[0]) if known is None else max(known.values(), default=0.0)
        )
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
        if beyond > TRANSIENT_MOST_BEYOND:
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
    unit = operator.box.speed
    rows = [operator.moment(i, j) for i, j in ((0, 0), (1, 0), (2, 0), (0, 1), (0, 2))]
    for power in range(3):
        for side, there in zip((-1, 1), problem.stops, strict=True):
            slowest = 0.0 if power else problem.threshold / unit
            speeds = velocity.above(slowest, power + 1, side)
            rows.append(unit**power * there * operator.arrivals(side, speeds))
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


def _transient_on_mesh(
    problem: _Problem, mesh: Mesh, rtol: float
) -> tuple[Moments, Moments, Operator, Array]:
    """Averages, the error of the projection in time, and the coefficients, (times, n)."""
    layout, second = problem.layout, problem.layout.box.time
    operator = Operator(layout.box, mesh, layout.walls)
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
                if _worst_transient(values, change) <= TRANSIENT_PROJECTION_SHARE * rtol:
                    break
            before = values
        states[places] = initial - passed @ projection.basis.T
    found = states @ rows.T
    values = _with_early(_averages(found, problem), problem)
    return values, Moments(*gaps), operator, states / found[:, :1]


def _refined_transient(
    problem: _Problem, rtol: float, deadline: Deadline
) -> tuple[Moments, Moments, tuple[_OnMesh | Gaussian, ...]]:
    """Averages, bounds on their errors and densities, on the first level that reaches rtol."""
    answers = (_transient_on_mesh(problem, mesh, rtol) for mesh in meshes(problem.layout))
    for (coarse, *_), fine in in_pairs(answers, deadline):
        values, projected, operator, states = fine
        errors = _transient_bounds(coarse, values, projected)
        errors = _with_lost_rates(values, errors, problem)
        if _worst_transient(values, errors) <= rtol:
            break
    found = tuple(
        law or _OnMesh(operator, state)  # a law that no stop has touched yet
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


def _worst_transient(values: Moments, errors: Moments) -> float:
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


def _transient_bounds(coarse: Moments, fine: Moments, projected: Moments) -> Moments:
    differences = Moments(
        *(
            TRANSIENT_MARGINS.safety * np.abs(a - b) + c
            for a, b, c in zip(coarse, fine, projected, strict=True)
        )
    )
    shared = (
        TRANSIENT_MARGINS.shared * _worst_transient(fine, differences) + TRANSIENT_MARGINS.floor
    )
    sizes = _sizes(fine)
    return Moments(*(np.maximum(d, shared * s) for d, s in zip(differences, sizes, strict=True)))
