"""Bifurcation diagrams: impact speeds of the motions that a slow sweep goes through."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stochvi.mathematics.arrays import Vector
from stochvi.methods.periodic.attractors import (
    BATCHES,
    SIGNIFICANT,
    TrackedPath,
    exponent,
    unit_perturbation,
    watch,
)
from stochvi.methods.periodic.basins import Place, rate_of
from stochvi.methods.periodic.branches import Finder
from stochvi.methods.periodic.contact_branches import ContactFinder
from stochvi.methods.periodic.family import Family
from stochvi.methods.periodic.function_branches import finder_of
from stochvi.methods.periodic.kernels import flights
from stochvi.methods.periodic.method import (
    SWEEPS,
    noise_left_out,
    too_slow,
    varied,
)
from stochvi.methods.periodic.states import States
from stochvi.model.calculations import calculation
from stochvi.model.model import model_of
from stochvi.results.base import Result
from stochvi.results.deadline import NEVER, Deadline, graceful_interrupt
from stochvi.results.errors import NotApplicable
from stochvi.results.estimates import Cost, Estimate, provenance
from stochvi.scenes.scene import Scene

if TYPE_CHECKING:
    import pandas as pd


MOST_DRAWN = 8
"""Largest number of impacts that are kept for each period that is watched; if there are more, the
last ones are kept."""


@dataclass(frozen=True, kw_only=True, eq=False)
class BifurcationSweep:
    """A slow sweep by simulation, from each value to the next.

    Parameters
    ----------
    upwards
        Whether the sweep goes up.
    value, frequency_hz
        The values of the varied number in the order of the sweep, and the frequency of the force.
    periods
        Periods of the force after which the motion repeats itself (0: it does not).
    impact_speed, stop
        Impact speeds (m/s) of the periods that were watched, and the stops, for each value.
    lyapunov, lyapunov_error
        Rate at which small perturbations grow, 1/s, with its standard error; -inf where they vanish
        by resting on a stop.

    See Also
    --------
    stochvi.methods.periodic.bifurcation : The answer that holds it.
    """

    upwards: bool
    value: Vector
    frequency_hz: Vector
    periods: NDArray[np.int64]
    impact_speed: tuple[Vector, ...]
    stop: tuple[tuple[str, ...], ...]
    lyapunov: Vector
    lyapunov_error: Vector


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Bifurcation(Result):
    """Motions that a structure between stops goes through as a number is varied slowly.

    Parameters
    ----------
    key
        The number that is varied: "frequency_hz", or a key of the scene.
    sweeps
        One sweep, or one up and one down.
    settling, watched
        Numbers of periods at each value that pass before its motion is watched, and in which it is
        watched.
    assumptions
        Assumptions, a sentence each.

    See Also
    --------
    stochvi.methods.periodic.bifurcation : The calculation.
    """

    key: str
    sweeps: tuple[BifurcationSweep, ...]
    settling: int
    watched: int
    assumptions: Sequence[str] = ()

    def to_frame(self) -> pd.DataFrame:
        """One row for each impact that was kept, and one of speed 0 for a value without impacts."""
        import pandas as pd

        tables = []
        for sweep in self.sweeps:
            for number, value in enumerate(sweep.value):
                speeds = sweep.impact_speed[number]
                tables.append(
                    pd.DataFrame(
                        {
                            "sweep": "up" if sweep.upwards else "down",
                            "value": value,
                            "frequency_hz": sweep.frequency_hz[number],
                            "periods": sweep.periods[number],
                            "lyapunov": sweep.lyapunov[number],
                            "lyapunov_error": sweep.lyapunov_error[number],
                            "stop": list(sweep.stop[number]) or [""],
                            "impact_speed": speeds if len(speeds) else [0.0],
                        }
                    )
                )
        return pd.concat(tables, ignore_index=True)

    def table(self) -> pd.DataFrame:
        """One row for each value of each sweep."""
        import pandas as pd

        tables = [
            pd.DataFrame(
                {
                    "sweep": "up" if sweep.upwards else "down",
                    "value": sweep.value,
                    "periods": sweep.periods,
                    "impacts per period": [len(each) / self.watched for each in sweep.impact_speed],
                    "impact_speed_max": [each.max(initial=0.0) for each in sweep.impact_speed],
                    "lyapunov": sweep.lyapunov,
                    "lyapunov_error": sweep.lyapunov_error,
                }
            )
            for sweep in self.sweeps
        ]
        return pd.concat(tables, ignore_index=True)

    def _shown(self) -> pd.DataFrame:
        return self.table()

    def _document(self) -> dict[str, Any]:
        return {"method": "bifurcation", **super()._document()}

    def summary(self) -> str:
        """How many values have motions that repeat themselves, and how many are chaotic."""
        table = self.table()
        regular = int((table["periods"] > 0).sum())
        growing = table["lyapunov"] > SIGNIFICANT * table["lyapunov_error"]
        chaotic = int((growing & (table["periods"] == 0) & (table["lyapunov"] > 0.0)).sum())
        return (
            f"of {len(table)} values of {self.key}, the motion repeats itself within "
            f"{self.watched // 2} periods at {regular}; small perturbations grow at {chaotic}"
        )


@calculation
def bifurcation(
    scene: Scene,
    frequency_hz: ArrayLike | None = None,
    *,
    vary: Mapping[str, Sequence[float]] | None = None,
    sweep: str = "up",
    settling: int = 300,
    watched: int = 128,
    start: Mapping[str, float] | None = None,
    budget: float | None = None,
) -> Bifurcation:
    """Motions through which a slow sweep goes: impact speeds and Lyapunov exponent at each value.

    The motion at each value goes on from that at the last one, from impact to impact, with the
    exact linear motion between them.

    Parameters
    ----------
    scene
        As for `harmonic_response`.
    frequency_hz
        Values of the frequency of the force.
    vary
        Instead: one key of the scene with its values.
    sweep
        "up", "down" or "both".
    settling
        Periods of the force that pass at each value before its motion is watched.
    watched
        Number of periods in which the motion is watched, at least 64.
    start
        The state before the first value, as {"velocity.x": 0.2}; by default at rest.
    budget
        Seconds of wall time, without that in which kernels are compiled.

    Returns
    -------
    Bifurcation
        The sweeps.

    Raises
    ------
    NotApplicable
        If the scene is not of that kind.
    NotConverged
        If the budget ends first; the error holds the values so far.

    See Also
    --------
    stochvi.harmonic_response : The regimes, stable or not, exactly.
    basins : What coexists at one value.

    Examples
    --------
    >>> import stochvi
    >>> from stochvi.scenes.datasets import shipped_scene
    >>> mount = stochvi.load_scene(shipped_scene("isolator-sine"))
    >>> found = bifurcation(mount, [90.0, 100.0, 110.0], start={"velocity.x": 0.2})
    >>> found.table()["periods"].tolist()
    [1, 1, 1]
    """
    began = time.perf_counter()
    if sweep not in SWEEPS or not SWEEPS[sweep]:
        raise ValueError(f"sweep must be 'up', 'down' or 'both', got {sweep!r}")
    if settling < 0 or watched < 64:
        raise ValueError(
            f"settling must be at least 0 and watched at least 64, got {settling} and {watched}"
        )
    deadline = Deadline.after(budget)
    key, values, scene_at = varied(scene, frequency_hz, vary)
    low, high = float(values[0]), float(values[-1])
    if low == high:
        raise ValueError(f"{key} must have at least two values, got {low:g}")
    family = Family.of(
        lambda value: model_of(scene_at(value)), low, high, None, with_functions=True
    )
    finder = finder_of(family, family.sigma(values), 1, deadline)
    if slow := too_slow(finder):
        raise NotApplicable("sine", [slow])
    with graceful_interrupt():
        sweeps = tuple(
            _swept(finder, upwards, settling, watched, States(model_of(scene), family, 0.5), start)
            for upwards in SWEEPS[sweep]
        )
    answer = Bifurcation(
        key=key,
        sweeps=sweeps,
        settling=settling,
        watched=watched,
        assumptions=scene.assumptions(),
        warnings=noise_left_out(model_of(scene)),
        cost=Cost(wall_time=time.perf_counter() - began),
        provenance=provenance(scene.document()),
    )
    if deadline.passed():
        raise deadline.fell_short("before the last value", "ask for fewer", answer)
    return answer


def _swept(
    finder: Finder, upwards: bool, settling: int, watched: int, states: States,
    start: Mapping[str, float] | None,
) -> BifurcationSweep:  # fmt: skip
    """One sweep; it ends where impacts come too fast to be followed."""
    family = finder.family
    state = _start_of(finder, states, start)
    sigmas, flown = [], list[TrackedPath]()
    for sigma in finder.grid if upwards else finder.grid[::-1]:
        flight = _watched(finder, float(sigma), state, settling, watched, MOST_DRAWN * watched)
        if flight is None or finder.deadline.passed():
            break
        sigmas.append(float(sigma))
        flown.append(flight)
    frequency = family.frequency_hz(np.array(sigmas))
    rates = np.array([exponent(each.growth, settling) for each in flown]).reshape(-1, 2)
    return BifurcationSweep(
        upwards=upwards,
        value=family.value(np.array(sigmas)),
        frequency_hz=frequency,
        periods=np.array([each.cycle() for each in flown], np.int64),
        impact_speed=tuple(family.speed * each.impacts[:, 2] for each in flown),
        stop=tuple(tuple(family.stops[int(stop)] for stop in each.impacts[:, 1]) for each in flown),
        lyapunov=rates[:, 0] * frequency,
        lyapunov_error=rates[:, 1] * frequency,
    )


def _start_of(finder: Finder, states: States, start: Mapping[str, float] | None) -> Vector:
    """The state that a user gives, where no hysteresis has a memory."""
    (state,) = states.starts(start or {})
    return np.pad(state, (0, finder.size - len(state)))


def _watched(
    finder: Finder, sigma: float, state: Vector, skipped: int, periods: int, most: int
) -> TrackedPath | None:
    """Simulate on from a state, which is replaced by the last one, and watch the last periods; at
    most `most` impacts are kept. None where impacts come too fast to be followed."""
    if not isinstance(finder, ContactFinder):
        course = flights.course_of(finder.motion(sigma), 0.0, 2.0 * math.pi)
        return watch(course, state, skipped, periods, most)
    perturbation = unit_perturbation(len(state))[:, 0]
    ends, growth = np.empty((periods, len(state))), np.empty(periods)
    impacts, leap = [np.empty((0, 3))], finder.followed_at_once
    leaps = [leap] * (skipped // leap) + ([skipped % leap] if skipped % leap else [])
    for period, flown in enumerate(leaps + [1] * periods, start=-len(leaps)):
        found = finder.perturbed(sigma, state, flown, perturbation)
        if found is None:
            return None
        motion, perturbation = found
        state[:] = motion.ends[-1]
        size = float(np.linalg.norm(perturbation))
        perturbation = perturbation / size
        if period >= 0:
            ends[period], growth[period] = state, math.log(size)
            impacts.append(motion.log[:, :3] + [2.0 * math.pi * period, 0.0, 0.0])
    return TrackedPath(ends, np.concatenate(impacts)[-most:], growth)


@calculation
def lyapunov_exponent(
    scene: Scene,
    start: Mapping[str, float] | None = None,
    *,
    settling: int = 1000,
    periods: int = 4000,
    budget: float | None = None,
) -> Estimate:
    """Rate at which a small perturbation of a motion under a sine grows, 1/s.

    Between impacts the linear motion turns the perturbation. At an impact its saltation matrix
    does, which knows that a perturbed motion is struck at another moment. The rate is above 0 where
    the motion is chaotic, and 0 where it has two frequencies. Where the motion approaches a stable
    regime, it is the logarithm of the largest multiplier per time.

    Parameters
    ----------
    scene
        As for `harmonic_response`.
    start
        The state at phase 0 of the force, as {"velocity.x": 0.2}; by default at rest.
    settling, periods
        Numbers of periods of the force that pass first, and over which the rate is then taken.
    budget
        Seconds after which `NotConverged` is raised; None for no limit.

    Returns
    -------
    Estimate
        The rate. Its standard error joins three parts: that of the means of 32 parts of the motion;
        the swing of the size of a perturbation that turns; and the effect of growth in proportion
        to the time. The last is ln(1 + periods / settling) over that time; no shorter motion can
        tell it from chaos.

    Raises
    ------
    NotApplicable
        If the scene is not of that kind, or its motion rests on a stop, where perturbations vanish.

    See Also
    --------
    bifurcation : The exponent over a range of values.

    Examples
    --------
    >>> import stochvi
    >>> from stochvi.scenes.datasets import shipped_scene
    >>> mount = stochvi.load_scene(shipped_scene("isolator-sine"))
    >>> round(float(lyapunov_exponent(mount)), 2)
    -6.28
    """
    if settling < 0 or periods < BATCHES:
        raise ValueError(
            f"settling must be at least 0 and periods at least {BATCHES}, got {settling} and "
            f"{periods}"
        )
    place = Place(scene, 1, NEVER, of_any_force=True)
    state = _start_of(place.finder, place.states, start)
    flight = _watched(place.finder, place.sigma, state, settling, periods, 1)
    if flight is None:
        raise NotApplicable(
            "sine",
            [
                "start must lead to impacts that can be followed one by one, got too many in a "
                "period; give another start or a larger clearance"
            ],
        )
    how = f"growth of a perturbation over {periods} periods"
    found = rate_of(*exponent(flight.growth, settling), place.period, how)
    if found is None:
        raise NotApplicable(
            "sine",
            [
                "start must lead to a motion without rests on a stop, got one in whose rests every "
                "perturbation ends: its exponent is minus infinity"
            ],
        )
    return found
