"""Basins: which of the motions that coexist under a sine a structure ends in, from many starts."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Unpack

import numpy as np

from stochvi.mathematics.arrays import Matrix, Vector, Whole
from stochvi.methods.periodic.attractors import (
    FRUITLESS,
    LAST,
    PERIODIC,
    UNDECIDED,
    WATCHED,
    Attractor,
    Attractors,
    KnownMotions,
    exponent,
)
from stochvi.methods.periodic.family import Family, unmet
from stochvi.methods.periodic.function_branches import finder_of
from stochvi.methods.periodic.kernels import flights, solver
from stochvi.methods.periodic.method import MARGIN, noise_left_out, too_slow, varied
from stochvi.methods.periodic.states import States
from stochvi.model.calculations import calculation
from stochvi.model.model import Model, model_of
from stochvi.results.base import Result
from stochvi.results.deadline import Deadline
from stochvi.results.errors import NotApplicable
from stochvi.results.estimates import Estimate, provenance
from stochvi.sampling.options import WorkOptions
from stochvi.sampling.plain_values import digest_of
from stochvi.sampling.run import Run, sampled
from stochvi.sampling.sampler import TrialSampler
from stochvi.scenes.scene import Scene

if TYPE_CHECKING:
    import pandas as pd


BEYOND = -2
"""Number in a map of basins of a start that lies beyond a stop."""

BLOCK = 256
"""Number of starts that are simulated together over FIRST periods, or fewer, between looks at the
clock: a tenth of a second or so. For more periods a block has fewer starts."""

ACROSS = 1.25
"""Half the width of a map that is not given, in multiples of the largest motion of a regime."""

NUMBER = 200
"""Number of values on each side of a map that is not given."""

FIRST = 50
"""Number of periods for which all starts are simulated before those that have reached no regime are
looked at."""

MOST_STARTS = 4_000_000
"""Largest number of starts of a map: 0.2 GB of states."""


@dataclass(frozen=True, kw_only=True, eq=False)
class BasinRegime:
    """A motion in which starts end.

    Parameters
    ----------
    name
        Name made of the impacts by pair and stop, with their number where it is above 1, and of the
        periods where there are several.
    kind
        "periodic", a stable regime as of `harmonic_response`; "other regular", a motion that
        repeats itself after many impacts or with rests on a stop, or one of two frequencies;
        "chaotic".
    periods, impacts
        Number of periods after which the motion repeats itself (0: never), and of impacts in these
        periods.
    multiplier
        Largest modulus of the factors by which perturbations change over its periods; None where it
        is not known exactly.
    lyapunov
        Rate at which small perturbations grow, 1/s: exact for a periodic regime, else of one long
        motion; None where they vanish at once, by resting on a stop.
    impact_speed_max
        Largest impact speed, m/s; 0 without impacts.
    displacement, velocity
        A state of the motion (coordinates,) at the phase of the starts, m and m/s.
    share
        Share of the starts between the stops that end in this motion.

    See Also
    --------
    stochvi.methods.periodic.basins : The answer that holds it.
    """

    name: str
    kind: str
    periods: int
    impacts: int
    multiplier: float | None
    lyapunov: Estimate | None
    impact_speed_max: float
    displacement: Vector
    velocity: Vector
    share: float


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Basins(Result):
    """The ends of motions from a plane of starts.

    Parameters
    ----------
    plane
        Names of the two numbers that are varied, as "displacement.x" and "velocity.x".
    across, up
        Values of these two numbers, m or m/s.
    phase_deg
        Phase of the force at which motions start, degrees.
    frequency_hz
        Frequency of the force.
    regimes
        The motions that are reached, the most frequent first.
    ends
        Number of the regime of each start (up, across); -1 where it is undecided, -2 beyond a stop.
    periods
        Largest number of periods for which a start was simulated.
    undecided
        Share of the starts between the stops whose end was not recognised.
    assumptions
        Assumptions, a sentence each.

    See Also
    --------
    stochvi.methods.periodic.basins : The calculation.
    """

    plane: tuple[str, str]
    across: Vector
    up: Vector
    phase_deg: float
    frequency_hz: float
    regimes: tuple[BasinRegime, ...]
    ends: Whole
    periods: int
    undecided: float
    assumptions: Sequence[str] = ()

    def at(self, across: float, up: float) -> BasinRegime | None:
        """The regime of the start that is nearest to a point of the plane; None without one."""
        column = int(np.argmin(np.abs(self.across - across)))
        row = int(np.argmin(np.abs(self.up - up)))
        number = int(self.ends[row, column])
        return None if number < 0 else self.regimes[number]

    def to_frame(self) -> pd.DataFrame:
        """One row for each start: its two numbers, and the motion in which it ends."""
        import pandas as pd

        up, across = np.meshgrid(self.up, self.across, indexing="ij")
        names = [*(regime.name for regime in self.regimes), "beyond a stop", "undecided"]
        return pd.DataFrame(
            {
                self.plane[0]: across.ravel(),
                self.plane[1]: up.ravel(),
                "regime": self.ends.ravel(),
                "name": [names[number] for number in self.ends.ravel()],
            }
        )

    def table(self) -> pd.DataFrame:
        """One row for each regime."""
        import pandas as pd

        rows = []
        for regime in self.regimes:
            rate = regime.lyapunov
            rows.append(
                {
                    "regime": regime.name,
                    "kind": regime.kind,
                    "share": regime.share,
                    "impact_speed_max": regime.impact_speed_max,
                    "multiplier": math.nan if regime.multiplier is None else regime.multiplier,
                    "lyapunov": -math.inf if rate is None else rate.value,
                    "lyapunov_error": 0.0 if rate is None else rate.standard_error,
                }
            )
        return pd.DataFrame(rows)

    def _shown(self) -> pd.DataFrame:
        return self.table()

    def _document(self) -> dict[str, Any]:
        return {"method": "basins", **super()._document()}

    def summary(self) -> str:
        """The motions that coexist, and the share of the starts of each."""
        found = ", ".join(f"{100.0 * each.share:.3g} % {each.name}" for each in self.regimes)
        rest = (
            f"; {100.0 * self.undecided:.3g} % undecided after {self.periods} periods"
            if self.undecided
            else ""
        )
        number = int(np.sum(self.ends != BEYOND))
        return f"of {number} starts end in: {found or 'no motion that was recognised'}{rest}"


@calculation
@sampled
def basins(
    scene: Scene,
    plane: Mapping[str, Sequence[float]] | None = None,
    *,
    phase_deg: float = 0.0,
    periods: int = 300,
    most_impacts: int = 3,
    **options: Unpack[WorkOptions],
) -> Basins:
    """Basins of the motions that coexist under a sine, over a plane of starts.

    Every initial state is followed from impact to impact, with the exact linear motion between
    them. It is followed until it reaches the surroundings of a stable regime of
    `harmonic_response`. Starts that reach none reveal further motions: one of them is followed over
    thousands of periods, and the others are compared with it.

    Parameters
    ----------
    scene
        As for `harmonic_response`, with rigid stops, and springs and dampers that are linear.
    plane
        Two numbers of a start with their values: "displacement.NAME" (m) or "velocity.NAME" (m/s)
        of a coordinate; all others are those at rest under the constant loads. By default the
        displacement and velocity of the first coordinate.
    phase_deg
        Phase of the force at the start, degrees of the lowest common multiple of the sines.
    periods
        Number of periods for which each start is simulated.
    most_impacts
        As for `harmonic_response`.
    **options
        `WorkOptions`: executor, budget, checkpoint and others.

    Returns
    -------
    Basins
        The regime of each start.

    Raises
    ------
    NotApplicable
        If the scene is not of that kind.
    NotConverged
        If the budget ends first; the starts that were not followed are undecided.

    See Also
    --------
    stochvi.harmonic_response : The regimes, stable or not, exactly.
    bifurcation : What a slow sweep goes through.

    Examples
    --------
    A mount that may clatter or stay clear of its stops:

    >>> import stochvi
    >>> from stochvi.scenes.datasets import shipped_scene
    >>> mount = stochvi.load_scene(shipped_scene("isolator-sine"))
    >>> starts = {"displacement.x": [-0.0004, 0.0], "velocity.x": [-0.3, 0.0]}
    >>> [each.name for each in basins(mount, starts).regimes]
    ['no impacts', 'stops lower, stops upper']
    """
    if periods < 1:
        raise ValueError(f"periods must be at least 1, got {periods}")
    run = Run.of(options)
    place = Place(scene, most_impacts, run.deadline)
    place.finder.find()
    known = Attractors(place.finder, place.sigma)
    names, sides = place.plane(plane, known)
    up, across = np.meshgrid(sides[1], sides[0], indexing="ij")
    starts = place.states.starts({names[0]: across.ravel(), names[1]: up.ravel()})
    phase = math.radians(phase_deg)
    run.begin()
    ends = BasinRun(run, known, starts, phase, periods).ends()
    order, shares = _shares(ends, len(known.found))
    renumbered = np.full(len(known.found) + 2, UNDECIDED)
    renumbered[order] = np.arange(len(order))
    renumbered[BEYOND] = BEYOND
    answer = Basins(
        plane=names,
        across=sides[0],
        up=sides[1],
        phase_deg=float(phase_deg),
        frequency_hz=float(place.family.frequency_hz(place.sigma)),
        regimes=place.described(known, order, shares, phase),
        ends=renumbered[ends].reshape(len(sides[1]), len(sides[0])),
        periods=periods,
        undecided=float(np.sum(ends == UNDECIDED)) / max(int(np.sum(ends != BEYOND)), 1),
        assumptions=(*scene.assumptions(), RECOGNISED),
        warnings=noise_left_out(place.model),
        cost=run.cost(paths=int(np.sum(ends != BEYOND))),
        provenance=provenance(scene.document()),
    )
    if run.deadline.passed():
        raise run.deadline.fell_short("before all starts were simulated", "ask for fewer", answer)
    return answer


INSTEAD = "; sine finds its regimes, and bifurcation follows a motion from a start"
"""Remedy where a map of basins does not follow forces."""

RECOGNISED = (
    "a motion ends in a regime where it enters surroundings from which the regime is approached: "
    "without impacts by its energy, else as found for 256 states around the regime"
)
"""Assumption of the recognition of regimes."""


def unmet_by_flights(model: Model, *, of_any_force: bool = False) -> list[str]:
    """Sentences on what flights from many starts do not follow, with a remedy where there is one;
    `of_any_force` as for `Place`."""
    conditions = unmet(model, compliant=of_any_force, with_functions=of_any_force)
    instead = "" if unmet(model, compliant=True, with_functions=True) else INSTEAD
    return [each + instead for each in conditions]


class Place:
    """A scene at its own values: its regimes, and the states from which motions can start.

    `of_any_force` says that stops may be compliant, and springs and dampers functions.
    """

    def __init__(
        self, scene: Scene, most_impacts: int, deadline: Deadline, *, of_any_force: bool = False
    ) -> None:
        self.model = model_of(scene)
        if conditions := unmet_by_flights(self.model, of_any_force=of_any_force):
            raise NotApplicable("sine" if of_any_force else "basins", conditions)
        _, values, scene_at = varied(scene, None, None)
        value = float(values[0])
        low, high = (1.0 - MARGIN) * value, (1.0 + MARGIN) * value
        self.family = Family.of(
            lambda each: model_of(scene_at(each)), low, high, None, with_functions=of_any_force
        )
        self.sigma = float(self.family.sigma(value))
        self.states = States(self.model, self.family, self.sigma)
        self.finder = finder_of(self.family, np.array([self.sigma]), most_impacts, deadline)
        if slow := too_slow(self.finder):
            raise NotApplicable("sine", [slow])

    @property
    def period(self) -> float:
        """Period of the force, s."""
        return 1.0 / float(self.family.frequency_hz(self.sigma))

    def plane(
        self, given: Mapping[str, Sequence[float]] | None, known: Attractors
    ) -> tuple[tuple[str, str], tuple[Vector, Vector]]:
        """The two numbers that are varied, and their values."""
        names = self.states.names
        if given is None:
            first = self.model.coordinates[0]
            return (f"displacement.{first}", f"velocity.{first}"), self._sides(known)
        chosen = tuple(given)
        if len(chosen) != 2 or not set(chosen) <= set(names):
            raise ValueError(
                f"plane must be two of {', '.join(names)} with their values, got "
                f"{', '.join(map(str, chosen)) or 'none'}"
            )
        sides = tuple(np.asarray(given[name], dtype=float).ravel() for name in chosen)
        for name, side in zip(chosen, sides, strict=True):
            if not len(side) or not np.all(np.isfinite(side)):
                raise ValueError(f"{name} must have finite values, at least one, got {len(side)}")
        if len(sides[0]) * len(sides[1]) > MOST_STARTS:
            raise ValueError(
                f"plane must have at most {MOST_STARTS} starts, got "
                f"{len(sides[0]) * len(sides[1])}; ask for fewer values"
            )
        return (chosen[0], chosen[1]), (sides[0], sides[1])

    def _sides(self, known: Attractors) -> tuple[Vector, Vector]:
        """Displacements between the stops of the first coordinate, or over the motions of all
        regimes, and speeds over those of all regimes."""
        speeds, places = [0.0], [0.0]
        for each in known.found:
            states = self.states.physical(each.points)
            n = len(self.model.mass)
            places += [float(np.abs(states[:, 0]).max())]
            speeds += [float(np.abs(states[:, n]).max())]
            if each.track is not None:
                places += [float(each.track.displacement[0]) * self.family.length]
                speeds += [float(each.track.speeds.max(initial=0.0)) * self.family.speed]
        reach = ACROSS * (max(places) or self.family.length)
        low, high = -reach, reach
        unit = np.eye(len(self.model.mass))[0]
        for pair in self.model.pairs:
            if np.allclose(pair.direction, unit):
                low = max(low, pair.lower.position) if pair.lower else low
                high = min(high, pair.upper.position) if pair.upper else high
        fastest = 1.5 * ACROSS * (max(speeds) or self.family.speed)
        return np.linspace(low, high, NUMBER), np.linspace(-fastest, fastest, NUMBER)

    def described(
        self, known: Attractors, order: Sequence[int], shares: Vector, phase: float
    ) -> tuple[BasinRegime, ...]:
        """The motions described for users, in the given order."""
        found: list[BasinRegime] = []
        for number in order:
            each = known.found[number]
            name = self._name(each)
            same = sum(other.name.partition(" (")[0] == name for other in found)
            found.append(
                self._described(
                    each, known, f"{name} ({same + 1})" if same else name, shares[number], phase
                )
            )
        return tuple(found)

    def _name(self, each: Attractor) -> str:
        if each.track is None:
            if not each.cycle:
                return each.kind
            return f"repeats after {each.cycle} period{'s' if each.cycle > 1 else ''}"
        struck = Counter(self.family.stops[stop] for stop in each.track.stops)
        stops = ", ".join(
            stop if number == 1 else f"{number} times {stop}"
            for stop, number in sorted(struck.items())
        )
        if each.track.periods == 1:
            return stops or "no impacts"
        return f"{stops} in {each.track.periods} periods"

    def _described(
        self, each: Attractor, known: Attractors, name: str, share: float, phase: float
    ) -> BasinRegime:
        state = each.points[-1].copy()
        lead = flights.course_of(known.motion, known.phase, (phase - known.phase) % (2.0 * math.pi))
        none = np.empty((len(state), 0))
        flights.fly(lead, state, solver.free_touch(), none, np.empty((0, 3)), 0)
        (there,) = self.states.physical(state[None])
        n = len(self.model.mass)
        if each.track is not None:
            multiplier = float(each.track.multiplier[0])
            periods, impacts = each.track.periods, len(each.track.stops)
            fastest = float(each.track.speeds.max(initial=0.0))
            # perturbations of a superstable regime vanish
            rate = math.log(multiplier) / periods if multiplier > 0.0 else -math.inf
            mean, error, how = rate, 0.0, "multipliers of the regime"
        else:
            assert each.growth is not None
            assert each.impacts is not None
            multiplier, periods = math.nan, each.cycle
            kept = each.impacts[:, 0] > 2.0 * math.pi * (len(each.growth) - periods) + known.phase
            impacts = int(np.sum(kept)) if periods else 0
            fastest = float(each.impacts[:, 2].max(initial=0.0))
            mean, error = exponent(each.growth, WATCHED)
            how = f"growth of a perturbation over {len(each.growth)} periods"
        return BasinRegime(
            name=name,
            kind=each.kind,
            periods=periods,
            impacts=impacts,
            multiplier=None if math.isnan(multiplier) else multiplier,
            lyapunov=rate_of(mean, error, self.period, how),
            impact_speed_max=fastest * self.family.speed,
            displacement=there[:n],
            velocity=there[n:],
            share=float(share),
        )


def rate_of(mean: float, error: float, period: float, how: str) -> Estimate | None:
    """The growth of perturbations per second from that per period; None where they vanish."""
    if not math.isfinite(mean):
        return None
    return Estimate(value=mean / period, standard_error=error / period, how=how)


@dataclass(frozen=True, eq=False)
class StartSampler(TrialSampler):
    """Blocks of starts, each of which brings its states. `origin` is a digest of the states of all
    starts, and `together` the number of those that are simulated together."""

    known: KnownMotions
    origin: str
    together: int

    @property
    def block(self) -> int:
        """Number of starts in a block."""
        return self.together

    @abstractmethod
    def fly(self, states: Matrix) -> tuple[Matrix, Whole]:
        """Later states of some starts, and numbers of motions or UNDECIDED."""

    def trial(
        self, first_path: int, paths: int, deadline: Deadline, states: Matrix | None = None
    ) -> tuple[Matrix, Whole]:
        """Later states and ends of a block, which brings its states."""
        assert states is not None
        return self.fly(states)

    def paths(self, sample: list[Any]) -> int:
        """Number of starts."""
        return sum(len(ends) for _, ends in sample)


@dataclass(frozen=True, eq=False)
class SettlingSampler(StartSampler):
    """Starts that are simulated over an angle and some periods, or to a periodic regime."""

    angle: float
    periods: int

    def fly(self, states: Matrix) -> tuple[Matrix, Whole]:
        """Last states, and numbers of motions."""
        states = states.copy()
        return states, self.known.settle(states, self.angle, self.periods)


@dataclass(frozen=True, eq=False)
class ComparingSampler(StartSampler):
    """Starts that may come to lie among the states of a motion of a number."""

    number: int

    def fly(self, states: Matrix) -> tuple[Matrix, Whole]:
        """The same states, and the number of the motion or UNDECIDED."""
        held = self.known.lie_in(self.number, states)
        return states, np.where(held, self.number, UNDECIDED)


class BasinRun:
    """Starts that are simulated up to the motions in which they end."""

    def __init__(
        self, run: Run, known: Attractors, starts: Matrix, phase: float, periods: int
    ) -> None:
        self.run, self.known, self.states, self.periods = run, known, starts, periods
        self.phase = phase

    def ends(self) -> Whole:
        """Number of the motion of each start, or UNDECIDED or BEYOND."""
        self.found = np.where(self.known.possible(self.states), UNDECIDED, BEYOND)
        if not np.any(self.found == UNDECIDED):
            raise ValueError(
                "plane must hold starts between the stops, got none; all its points lie beyond a "
                "stop"
            )
        first = min(self.periods, FIRST)
        self._settle((self.known.phase - self.phase) % (2.0 * math.pi), first)
        self._reveal(first)
        if self.periods > first:
            self._settle(0.0, self.periods - first)
            self._reveal(self.periods - first)
        return self.found

    def _reveal(self, periods: int) -> None:
        """Follow some of the undecided starts to the end, and compare the others with them."""
        known, fruitless = self.known, 0
        while fruitless < FRUITLESS and not self.run.deadline.passed():
            left = np.flatnonzero(self.found == UNDECIDED)
            if fruitless >= len(left):
                break
            before = len(known.found)
            # spread over the plane: neighbours tend to end alike
            chosen = left[(len(left) * (2 * fruitless + 1)) // (2 * FRUITLESS)]
            number = known.reveal(self.states[chosen])
            if number is not None:
                self.found[chosen] = number
            if len(known.found) == before:
                fruitless += 1
            elif known.found[-1].kind == PERIODIC:
                self._settle(0.0, periods)
            else:
                self._sample(ComparingSampler, LAST, len(known.found) - 1)
            self.run.tell(*self._ended(0))

    def _settle(self, angle: float, periods: int) -> None:
        """Simulate the undecided starts over an angle and some periods, or to a periodic regime."""
        self._sample(SettlingSampler, periods, angle, periods)

    def _sample(self, kind: Callable[..., StartSampler], periods: int, *fields: Any) -> None:
        """Take states and ends of the undecided starts from a sampler that simulates them over so
        many periods."""
        left = np.flatnonzero(self.found == UNDECIDED)
        if not len(left) or self.run.deadline.passed():
            return
        states = self.states[left]

        def tell(sample: list[tuple[Matrix, Whole]]) -> tuple[float, str]:
            return self._ended(sum(int(np.sum(ends != UNDECIDED)) for _, ends in sample))

        sampler = kind(self.known.known(), digest_of(states), block_of(periods), *fields)
        taken = self.run.until(
            sampler, len(left), tell=tell,
            start=lambda _, first, number: states[first : first + number],
        )  # fmt: skip
        done = left[: taken.paths]
        self.states[done] = np.concatenate([each for each, _ in taken.sample])
        self.found[done] = np.concatenate([each for _, each in taken.sample])

    def _ended(self, more: int) -> tuple[float, str]:
        """Share of the starts that have ended, with some more that are not noted yet, in words."""
        ended, number = int(np.sum(self.found != UNDECIDED)) + more, len(self.found)
        return ended / number, f"{ended} of {number} starts have ended"


def block_of(periods: int) -> int:
    """Number of starts in a block, which takes about the same time over any number of periods."""
    return max(1, BLOCK * FIRST // max(periods, FIRST))


def _shares(ends: Whole, number: int) -> tuple[list[int], Vector]:
    """Motions that are reached, the most frequent first, and the share of each."""
    counted = np.array([np.sum(ends == each) for each in range(number)], dtype=float)
    order = [int(each) for each in np.argsort(-counted, kind="stable") if counted[each] > 0.0]
    return order, counted / max(float(np.sum(ends != BEYOND)), 1.0)
