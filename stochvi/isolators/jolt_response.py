"""Jolts: whether a structure can be thrown into clatter, and how long that lasts."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import ClassVar, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.special import bdtrc

from stochvi.mathematics import numerics
from stochvi.mathematics.numerics import Matrix, Vector
from stochvi.mathematics.units import LENGTH
from stochvi.methods.periodic.attracted import Place, unmet_by_flights
from stochvi.methods.periodic.branches import move_inside
from stochvi.methods.periodic.continuation import unstruck
from stochvi.methods.periodic.kernels.flights import count_impacts, course_of
from stochvi.methods.periodic.resonance import HarmonicResonance
from stochvi.model.coverage import beyond_one_oscillator, functions, scattered
from stochvi.model.model import Model, model_of
from stochvi.motion.kernels.random_numbers import seed_streams
from stochvi.motion.modal import plan_modal
from stochvi.results.base import DataFrame, Result, frame_of
from stochvi.results.deadline import Deadline, Progress, graceful_interrupt
from stochvi.results.errors import MOST_NUMBERS, NotApplicable, NotConverged, check_size
from stochvi.results.estimates import (
    FEWEST_CLUSTERS,
    binomial_interval,
    poisson_interval,
    provenance,
)
from stochvi.sampling.calculations import GivenUp, Random, calculation, given_up_after
from stochvi.scenes.excitations import BASE, Sine
from stochvi.scenes.scene import Scene

# ------------------------------------------------------------------------------
# Jolts: whether a structure that does not hit its stops can be thrown into clatter, and how long it
# stays there.
# ------------------------------------------------------------------------------


WINDOW_PERIODS = 10
"""Length of a window in which impacts are counted, periods of the sine."""

SETTLING_WINDOWS = 10
"""Number of windows after a perturbation before a path counts as captured."""

CLATTER = 0.5
"""Number of impacts per period of the sine. A window counts as clatter from so many on both stops
together, as the resonant regime from so many on each. That regime has one impact on each stop per
period; occasional impacts are fewer."""

UNLIKELY = 0.05
"""Probability of as many departures in the first half of the time, at a constant rate, below which
they count as transients."""

AFTER_TRANSIENTS = 20
"""Smallest number of departures after transients from which a rate is told: of fewer ones it cannot
be seen whether they are transients, too."""


class EscapeRate(NamedTuple):
    """A rate, 1/s, with its 95 % interval."""

    value: float
    lower: float
    upper: float


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Jolts(Result):
    """How many perturbed paths were captured by clatter, and how long they stayed.

    Parameters
    ----------
    speeds
        Speeds of the perturbations, m/s: changes of the velocity relative to the base.
    captured, resonant
        Whether each path (perturbations, paths) is in clatter after 100 periods, and whether it is
        then in the resonant regime. That regime hits both stops; other paths rattle on one.
    left
        Whether each path was captured and later left the clatter.
    watched
        Seconds (perturbations, paths) in clatter after capture, until left or until the end.
    noise
        Whether noise beside the sine can throw paths out of a settled motion.
    duration
        Seconds for which every path was simulated.
    resonance
        Exact regimes and the energy boundary of the sine alone; None where the stops are not
        symmetric about the mean.
    clearance
        Clearance per side, m.

    See Also
    --------
    stochvi.isolators.perturbations : The calculation.
    """

    kind = "jolt"
    in_document: ClassVar = {
        "clearance": "clearance", "paths": "paths", "duration": "duration",
        "energy_boundary": "resonance.energy_boundary",
        "harmonic_boundary": "resonance.harmonic_boundary",
        "free_amplitude": "resonance.free_amplitude",
        "jolts": "to_frame", "escape_rate": "escape_rate",
    }  # fmt: skip
    not_in_document = (
        "speeds", "captured", "resonant", "left", "watched", "noise", "resonance",
        "cost", "provenance", "interrupted",
    )  # fmt: skip

    speeds: tuple[float, ...]
    captured: NDArray[np.bool_]
    resonant: NDArray[np.bool_]
    left: NDArray[np.bool_]
    watched: NDArray[np.float64]
    duration: float
    resonance: HarmonicResonance | None
    clearance: float
    noise: bool = True

    @property
    def paths(self) -> int:
        """Number of paths that were simulated for each perturbation."""
        return int(self.captured.shape[1])

    def escape_rate(self) -> EscapeRate:
        """Rate at which noise throws captured paths out of clatter, 1/s, with its exact 95 %
        interval (Poisson).

        At first transients leave as well, and these are no departures at a constant
        rate. So the time that all paths were watched is halved, by its order after the capture: a
        constant rate has as many departures in either half. Where the first half has more of them
        the rate is that of the second half, halved once more. Where that still has more at first,
        where there are fewer than five departures, or no noise, no rate is known: the answer is
        then (nan, 0, upper limit), or (0, 0, upper limit) without a departure. It is (nan, 0, inf)
        where no path was captured.
        """
        stayed = np.sort(self.watched[self.captured])
        gone = np.sort(self.watched[self.left])
        total = float(stayed.sum())
        if total == 0.0:
            return EscapeRate(math.nan, 0.0, math.inf)
        # paths that are watched longer than t, summed up to t: the time that was watched so far
        so_far = np.cumsum(np.diff(stayed, prepend=0.0) * np.arange(len(stayed), 0, -1))
        place = np.interp(gone, stayed, so_far) / total
        known = False
        for begun, needed in ((0.0, FEWEST_CLUSTERS), (0.5, AFTER_TRANSIENTS)):
            kept = place[place > begun]
            early = int(np.sum(kept <= 0.5 * (1.0 + begun)))
            steady = _chance_of_so_many(early, len(kept)) > UNLIKELY
            known = self.noise and len(kept) >= needed and steady
            if steady:
                break
        low, high = poisson_interval(len(kept), (1.0 - begun) * total)
        if known:
            return EscapeRate(len(kept) / ((1.0 - begun) * total), low, high)
        return EscapeRate(math.nan if len(kept) else 0.0, 0.0, high)

    def to_frame(self) -> DataFrame:
        """One row each: shares of paths captured, with the exact interval, and on both stops;
        share of the captured ones that left later."""
        rows = []
        for number, speed in enumerate(self.speeds):
            caught = int(self.captured[number].sum())
            low, high = binomial_interval(caught, self.paths)
            gone = int(self.left[number].sum())
            rows.append(
                {
                    "jolt": speed,
                    "captured": caught / self.paths,
                    "captured_low": low,
                    "captured_high": high,
                    "on_both_stops": float(self.resonant[number].mean()),
                    "left_later": gone / caught if caught else math.nan,
                }
            )
        return frame_of(rows)

    def summary(self) -> str:
        """Capture and escape, in sentences."""
        caught = bool(self.captured.any())
        found = "perturbations throw" if caught else "no perturbation throws"
        found += " the mount into clatter"
        known = self.resonance
        if known is not None:
            below = self.clearance <= known.energy_boundary
            found += (
                "; the sine alone can keep up the resonant regime to a clearance of "
                f"{LENGTH.text(known.energy_boundary)} (harmonic linearisation: "
                f"{LENGTH.text(known.harmonic_boundary)}), and the clearance here is "
                f"{LENGTH.text(self.clearance)}{'' if below else ', beyond it'}"
            )
        return found + (self._how_long() if caught else "")

    def _how_long(self) -> str:
        """How long clatter lasts, in words."""
        rate, low, high = self.escape_rate()
        gone, caught = int(self.left.sum()), int(self.captured.sum())
        if rate > 0.0:
            return (
                f"; it lasts {1.0 / rate:.3g} s on average ({1.0 / high:.3g} to {1.0 / low:.3g} s)"
            )
        if gone == caught:
            stayed = float(self.watched[self.captured].mean())
            return f"; all {caught} paths left it, {stayed:.3g} s after their capture on average"
        longer = f"longer than {1.0 / high:.3g} s on average (95 %)"
        if not gone:
            return f"; none left it: it lasts {longer}"
        why = "too few, or " * self.noise + "transients of the perturbation"
        return (
            f"; {gone} of {caught} captured paths left it within {self.duration:.3g} s ({why}); "
            f"for the others it lasts {longer}"
        )


@calculation
def perturbations(
    scene: Scene,
    speeds: Sequence[float],
    *,
    paths: int = 64,
    duration: float | None = None,
    seed: int = 0,
    rng: Random = None,
    budget: float | None = None,
    progress: Progress | None = None,
) -> Jolts:
    """Capture by clatter and escape from it, after perturbations of a mount free of impacts.

    Every path starts in its motion without stops, at a random phase of the sine. It receives the
    perturbation and is followed with its stops: from impact to impact by the exact linear motion
    where stops are rigid and there is no noise, else in steps.

    Parameters
    ----------
    scene
        A linear structure with one impact pair, one sine, any white or filtered noise and loads.
    speeds
        Sudden changes of the relative velocity, m/s; negative ones towards the lower stop.
        Where a base moves, it is the base that is perturbed, and all that it carries gets the speed
        relative to it; else an impulse on the pair changes the rate of its gap.
    paths
        Number of paths for each perturbation.
    duration
        Seconds after the perturbation; by default 100 windows of 10 periods.
    seed, rng
        Seed of the random numbers: the same seed gives the same digits. Or what draws one, a
        Generator of numpy.
    budget
        Seconds of wall time, without that in which kernels are compiled; None for no limit.
    progress
        Called now and then with the fraction done and a sentence.

    Returns
    -------
    Jolts
        Captures and escapes of each perturbation.

    Raises
    ------
    NotApplicable
        If the scene is not of that kind.
    NotConverged
        If the budget ends first, or `Interrupted` after Ctrl-C: it carries the answer for those
        perturbations that were simulated.

    See Also
    --------
    stochvi.isolators.clatter : How much of the time a mount clatters.
    stochvi.harmonic_response : The regimes themselves.

    Examples
    --------
    >>> from stochvi.scenes.impact_laws import Restitution
    >>> from stochvi.scenes.scene import ImpactPair
    >>> from stochvi.scenes.structures import Oscillator
    >>> mount = Scene(
    ...     structure=Oscillator(mass=1.0, damping=12.5, stiffness=62.8**2),
    ...     impact_pairs=[
    ...         ImpactPair(lower=-4e-4, upper=4e-4, law=Restitution(coefficient=0.5))
    ...     ],
    ...     excitations=[Sine(amplitude=1e-4 * 628.0**2, frequency_hz=628.0 / 6.283185307)],
    ... )
    >>> found = perturbations(mount, [0.0, 0.3], paths=16)
    >>> found.to_frame()["captured"].tolist()[0], bool(found.captured[1].any())
    (0.0, True)
    """
    deadline = Deadline.after(budget)
    sine = _check(scene, speeds, paths, duration)
    model = model_of(scene)
    window = WINDOW_PERIODS / sine.frequency_hz
    windows = 10 * SETTLING_WINDOWS if duration is None else numerics.ceil(duration / window)
    windows = max(windows, SETTLING_WINDOWS + 1)
    each = 2 * windows * len(speeds) + 4 * len(model.mass)
    check_size("paths", paths, MOST_NUMBERS // each, "ask for fewer, or for a shorter duration")
    exact = not model.noisy and model.rigid and not unmet_by_flights(model)
    hits_of: Throw = Flown(scene, deadline) if exact else Simulated(model, window)
    counted: list[NDArray[np.float64]] = []
    with graceful_interrupt(), given_up_after(deadline), suppress(GivenUp):
        for number, speed in enumerate(speeds):

            def report(done: float, number: int = number) -> None:
                if deadline.passed():
                    raise GivenUp
                if progress:
                    total = len(speeds)
                    progress((number + done) / total, f"perturbation {number + 1} of {total}")

            counted.append(hits_of(speed, paths, seed, windows, report))
    if not counted:
        raise deadline.fell_short("before the paths of a perturbation had ended", LESS_WORK)
    hits, resonance = np.array(counted), _resonance(scene, sine)
    clearance = _clearance(scene)
    found = hits.sum(axis=2) >= CLATTER * WINDOW_PERIODS
    captured = found[:, SETTLING_WINDOWS - 1]
    on_both = (hits[:, SETTLING_WINDOWS - 1] >= CLATTER * WINDOW_PERIODS).all(axis=1)
    later = found[:, SETTLING_WINDOWS:]
    left = captured & ~later.all(axis=1)
    stayed = np.where(later.all(axis=1), later.shape[1], np.argmin(later, axis=1) + 0.5)
    answer = Jolts(
        speeds=tuple(float(speed) for speed in speeds[: len(hits)]),
        captured=captured,
        resonant=captured & on_both,
        left=left,
        watched=np.where(captured, stayed * window, 0.0),
        duration=windows * window,
        resonance=resonance,
        clearance=clearance,
        noise=model.noisy,
        warnings=(*scene.at_means(), *([] if model.noisy else _rests(resonance, clearance))),
        provenance=provenance(scene.document(), seed),
    )
    if len(hits) < len(speeds):
        where = f"after {len(hits)} of {len(speeds)} perturbations"
        raise deadline.fell_short(where, LESS_WORK, answer)
    return answer


def _chance_of_so_many(early: int, events: int) -> float:
    """Probability that at least so many of the events lie in the first half.

    >>> _chance_of_so_many(5, 5)
    0.03125
    """
    return float(bdtrc(early - 1, events, 0.5)) if early else 1.0


LESS_WORK = "raise budget, or ask for fewer paths, fewer perturbations or a shorter duration"
"""Remedy where the budget ended before all perturbations were simulated."""


class Throw(Protocol):
    """Counts the impacts (windows, 2, paths) on the lower and the upper stop in each window.

    Every path is perturbed by that speed, m/s, at a random phase. `report` takes the share that is
    done, and may raise `GivenUp`.
    """

    def __call__(
        self, speed: float, paths: int, seed: int, windows: int, report: Callable[[float], None]
    ) -> NDArray[np.float64]: ...


class Simulated:
    """Paths that are simulated in steps, with or without noise, between stops of any kind."""

    def __init__(self, model: Model, window: float) -> None:
        plan = plan_modal(model, 0.0, None)
        self.steps = math.ceil(window / plan.step)
        self.plan = plan.with_step(window / self.steps)
        self.free = plan_modal(replace(model, pairs=()), 0.0, None)
        self.kick = plan.modes.shapes.T @ model.mass @ _kick(model)

    def __call__(
        self, speed: float, paths: int, seed: int, windows: int, report: Callable[[float], None]
    ) -> NDArray[np.float64]:
        streams, n = np.empty((2, paths), np.uint64), len(self.kick)
        seed_streams(np.uint64(seed), 0, streams)
        state = self.free.start(streams)
        state[n : 2 * n] += speed * self.kick[:, None]
        state = np.ascontiguousarray(self.plan.between_stops(state))
        counted = []
        for number in range(windows):
            report(number / windows)
            counted.append(self.plan.counts(state, streams, self.steps)[0])
        return np.array(counted)


class Flown:
    """Paths without noise between rigid stops, which are followed from impact to impact.

    All paths that have rested on a stop leave it at the same phase of the sine, and go on as one
    motion. Steps would have an error there, which grows from impact to impact and changes the fate
    of all of them at once.
    """

    def __init__(self, scene: Scene, deadline: Deadline) -> None:
        self.place = Place(scene, 1, deadline)
        self.motion = self.place.finder.motion(self.place.sigma)
        kick = _kick(self.place.model)
        (self.kick,) = self.place.states.scaled(np.concatenate([0.0 * kick, kick])[None])
        (pair,) = self.place.model.pairs
        self.sides = [int(stop is pair.upper) for stop in pair.stops]

    def __call__(
        self, speed: float, paths: int, seed: int, windows: int, report: Callable[[float], None]
    ) -> NDArray[np.float64]:
        hits, random = np.zeros((windows, 2, paths)), np.random.default_rng(seed)
        for path, phase in enumerate(random.uniform(0.0, 2.0 * math.pi, paths)):
            report(path / paths)
            hits[:, self.sides, path] = self.from_phase(phase, speed, windows)
        return hits

    def from_phase(self, phase: float, speed: float, windows: int) -> Matrix:
        """Impacts (windows, stops) of the path that is perturbed at a phase of the sine."""
        start = unstruck(self.motion, phase)
        if start is None:
            why = "the structure has no single motion without impacts"
            raise NotApplicable("perturbations", why)
        state, counts = start + speed * self.kick, np.zeros((windows, len(self.sides)))
        move_inside(self.motion, state, lambda: 1.0)
        course = course_of(self.motion, phase, 2.0 * math.pi)
        if not count_impacts(course, state, WINDOW_PERIODS, counts):
            raise NotConverged("impacts come too fast to be followed; add a little noise")
        return counts


def _kick(model: Model) -> Vector:
    """Change of the velocities by a perturbation of speed 1: all that a moving base carries gets it
    relative to the base. Else it is that of an impulse on the reduced mass of the gap."""
    if model.moving_base:
        return np.asarray(next(iter(model.base.values())), float)
    pair = model.pairs[0]
    return np.asarray(pair.mass * np.linalg.solve(model.mass, pair.direction), float)


def _check(scene: Scene, speeds: Sequence[float], paths: int, duration: float | None) -> Sine:
    if len(speeds) == 0 or not all(math.isfinite(speed) for speed in speeds):
        raise ValueError(f"speeds must be at least one finite number (m/s), got {list(speeds)}")
    if paths < 1:
        raise ValueError(f"paths must be at least 1, got {paths}")
    if duration is not None and not 0.0 < duration < math.inf:
        raise ValueError(f"duration must be a positive number of seconds, got {duration}")
    model = model_of(scene)
    unmet = [*functions(model), *scattered(model)]
    sines = [each for each in scene.excitations if isinstance(each, Sine)]
    if len(sines) != 1:
        unmet.append(f"the scene must have one sine, got {len(sines)}")
    if len(model.pairs) != 1:
        unmet.append(f"the scene must have one impact pair, got {len(model.pairs)}")
    if model.tables:
        unmet.append("noise must be white or filtered, got noise of a table or a record")
    if unmet:
        raise NotApplicable("perturbations", unmet)
    return sines[0]


def _clearance(scene: Scene) -> float:
    """The smaller distance from the mean position to a stop, m."""
    model = model_of(scene)
    mean = float(model.mean_gaps[0])
    return min(abs(stop.position - mean) for stop in model.stops)


def _rests(sine: HarmonicResonance | None, clearance: float) -> list[str]:
    """A sentence where a sine without noise can hold a mass on a rigid stop."""
    if sine is None or sine.amplitude <= sine.omega**2 * clearance:
        return []
    return [
        "the sine can hold the mass on a stop, and all paths that have rested there go on alike: a "
        "small change of the scene may change the shares at once; a little white noise in the "
        "scene gives those of real mounts"
    ]


def _resonance(scene: Scene, sine: Sine) -> HarmonicResonance | None:
    """Regimes of the sine alone of one mass, where both of its stops are alike, rigid, and evenly
    about the mean."""
    model = model_of(scene)
    one = not beyond_one_oscillator(model, with_filters=True, with_sines=True)
    if not (one and model.rigid) or model.lower is None or model.upper is None:
        return None
    laws = {stop.law.restitution for stop in model.stops}
    low, high = model.lower.position, model.upper.position
    middle = (low + high) / 2.0 - model.rest
    if len(laws) > 1 or abs(middle) > 1e-9 * (high - low):
        return None
    on_base = scene.place(sine) == BASE
    try:
        return HarmonicResonance(
            omega=model.omega,
            damping_rate=model.damping_rate,
            amplitude=sine.peak if on_base else sine.peak / model.unit_mass,
            frequency=2.0 * math.pi * sine.frequency_hz,
            restitution=laws.pop(),
        )
    except ValueError:
        return None
