"""First passage: when an oscillator under white noise first reaches a barrier, without sampling.

Let u(x, v, t) be the probability that a path from (x, v) meets a barrier before t. It obeys the
backward equation

    u_t = v u_x + (load - omega^2 x - b v) u_v + S0 / 2 u_vv,   u = 1 where a path leaves,

(Pontryagin, Andronov and Vitt 1933 for its mean; J. N. Yang, M. Shinozuka, J. Appl. Mech. 37 (1970)
1017). Small probabilities are sums of what is absorbed, never one minus a survival, and keep their
digits. With the slowest mode apart,

    u = c phi (1 - exp(-lambda t)) + y(t),   y(t) -> 1 - c phi,

where phi is the mode as a function, y follows by projection (`evolution`), and lambda is the
outflow of the mode over what it holds.
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stochvi.mathematics.arrays import Array
from stochvi.mathematics.impact_rates import rice_rate
from stochvi.methods.fokker_planck.conditions import (
    barriers,
    box_ends,
    check_rtol,
    turning_stops,
    unmet_by_first_passage,
)
from stochvi.methods.fokker_planck.crossing_bound import passages_at_most
from stochvi.methods.fokker_planck.error_margins import ErrorMargins
from stochvi.methods.fokker_planck.evolution import (
    SlowestMode,
    projections,
    slowest_mode,
    time_groups,
)
from stochvi.methods.fokker_planck.initial_states import (
    InitialState,
    Start,
    StartChoice,
    start_of,
)
from stochvi.methods.fokker_planck.meshes_in_time import (
    LEVELS,
    MOST_UNKNOWNS,
    Layout,
    Level,
    barrier_height,
    mesh,
    passage_layout,
)
from stochvi.methods.fokker_planck.operators import Operator
from stochvi.methods.fokker_planck.refinement import TIME_RATIO, accurate
from stochvi.model.calculations import calculation
from stochvi.model.model import Model, Stop, model_of
from stochvi.results.base import Result
from stochvi.results.deadline import Deadline
from stochvi.results.errors import NotApplicable, NotConverged
from stochvi.results.estimates import Cost, Estimate, format_with_error, provenance
from stochvi.scenes.scene import Scene

if TYPE_CHECKING:
    import pandas as pd

METHOD = "first-passage"
HOW = "half-range Galerkin in time"

MARGINS = ErrorMargins(safety=2.5, shared=0.3, floor=3e-08)
"""Margins of the error bounds: those of `fixed_meshes`, with a lower floor. The error that the
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

    def to_frame(self) -> pd.DataFrame:
        """A row per time: seconds, probability, bound on its error."""
        import pandas as pd

        return pd.DataFrame(
            {
                "time": self.times,
                "probability": [estimate.value for estimate in self.probability],
                "bias": [estimate.bias for estimate in self.probability],
            }
        )

    def _document(self) -> dict[str, Any]:
        found = super()._document()
        return {"barriers": {side: found.pop(side) for side in ("lower", "upper")}, **found}

    def __repr__(self) -> str:
        lines = [
            f"  P(before {time:g} s) = {format_with_error(estimate.value, 0.0)}"
            for time, estimate in zip(self.times, self.probability, strict=True)
        ]
        lines.append(f"  mean time = {self.mean_time.value:.9g} s")
        lines.append(f"  decay rate = {self.decay_rate.value:.9g} 1/s")
        return "\n".join([f"<{self.method}", *lines]) + ">"


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
        raise NotApplicable(METHOD, [sentence])
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
    coarse: tuple[_Values, Array] | None = None
    values = bounds = None
    took = 0.0
    for level in LEVELS:
        if values is not None and (
            mesh(layout, level).unknowns > MOST_UNKNOWNS or deadline.left <= TIME_RATIO * took
        ):
            break
        began = time.perf_counter()
        fine, doubt = _on_level(layout, level, start, lower, upper, times, most, rtol)
        if coarse is not None:
            allowed = rtol * fine.scale
            before, now = coarse[1] <= allowed, doubt <= allowed
            values, bounds = fine, _bounds(coarse[0], fine, doubt, before & now)
            # a finer mesh may have no modes that grow, but mends no other error of the projection
            if _worst(values, bounds) <= rtol or not (before | now).all():
                break
        coarse, took = (fine, doubt), time.perf_counter() - began
    assert values is not None
    assert bounds is not None
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
        probability=MARGINS.safety * np.abs(fine.probability - coarse.probability),
        mean_time=MARGINS.safety * abs(fine.mean_time - coarse.mean_time),
        rate=MARGINS.safety * abs(fine.rate - coarse.rate),
    )
    of_meshes = differences._replace(probability=differences.probability * projected)
    shared = MARGINS.shared * _worst(fine, of_meshes) + MARGINS.floor
    return fine._replace(
        probability=np.maximum(differences.probability + doubt, shared * fine.scale),
        mean_time=max(differences.mean_time, shared * fine.mean_time),
        rate=max(differences.rate, shared * fine.rate),
    )


def _on_level(
    layout: Layout, level: Level, start: Start, lower: float, upper: float, times: Array,
    most: Array, rtol: float,
) -> tuple[_Values, Array]:  # fmt: skip
    """The results on one mesh, and the error of the projection in time.

    `most` are probabilities that none can exceed.
    """
    operator = Operator(layout.box, mesh(layout, level), layout.walls)
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
