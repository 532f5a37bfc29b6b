"""The protocol of a plan: how the paths of one scene are simulated, and what is averaged.

A plan knows the model, the step and the lengths of a path; it does not depend on the number of
paths or on the use of the averages. The averages of a block of paths follow from the plan, the
seed and the numbers of the paths alone. So any worker may compute them.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Protocol, Self

import numpy as np
from numpy.typing import NDArray

from stochvi.engine.impact_log import Log
from stochvi.mathematics.arrays import Vector
from stochvi.methods.monte_carlo.path_statistics import Layout
from stochvi.model.model import Model
from stochvi.sampling.stop_flag import check_flag

RELAXATIONS = 12.0
"""Length of the burn-in in units of the slowest time constant: the error of the start, which is
small already, decays to e^-12 of itself."""

Records = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Histories:
    """Stationary records of a block of paths at equal steps, SI units.

    Parameters
    ----------
    displacement, velocity
        (coordinates, paths, samples). Velocities are those before the kick of white noise that
        falls on a sample.
    impact_speed
        (pairs, paths, samples): sum of the incident speeds within the step that ends at a sample,
        negative at a lower stop.
    excitation
        (paths, samples), None where it is not known: f of x'' + b x' + omega^2 x = f + impacts,
        m/s^2; a base acceleration is -f. For white noise it is the mean over the next step.
    lost
        As `losses_of`, in the time of the log.
    """

    displacement: Records
    velocity: Records
    impact_speed: Records
    excitation: Records | None
    lost: Records


class Plan(Protocol):
    """Steps, start and lengths of the paths of one scene; SI units."""

    @property
    def model(self) -> Model:
        """The model that is simulated."""

    @property
    def method(self) -> str:
        """Name of the scheme, for the assumptions of an answer."""

    @property
    def states(self) -> int:
        """Number of state variables of a path."""

    @property
    def step(self) -> float:
        """Time step or sampling interval, s."""

    @property
    def burn_in(self) -> float:
        """Seconds of a path that are simulated before counting starts."""

    @property
    def duration(self) -> float:
        """Counted seconds of a path."""

    @property
    def block(self) -> int:
        """Number of paths that are simulated together: so many that the kernels reach their full
        speed and the arrays fit into the caches."""

    @property
    def steps_per_path(self) -> int:
        """Number of steps of a path, burn-in included."""

    @property
    def elastic(self) -> bool:
        """Whether the stationary distribution is exact at any step, so that there is no bias."""

    @property
    def coarse_share(self) -> float:
        """Share of the paths that are simulated at twice the step as well, 1 over an integer."""

    @property
    def fastest(self) -> float:
        """Largest frequency of a mode or a signal, rad/s."""

    @property
    def hits_in_a_cluster(self) -> float:
        """Upper bound on the number of impacts on one stop within a relaxation time of the energy,
        which are not independent."""

    @property
    def layout(self) -> Layout:
        """Meaning of the rows of `averages`."""

    @property
    def steps(self) -> int:
        """Counted steps of a path."""

    def averages(
        self,
        seed: int,
        first_path: int,
        paths: int,
        record: Records | None = None,
        *,
        log: Log | None = None,
    ) -> Records:
        """Time averages (rows of `layout`, paths) of the paths first_path, first_path + 1, ...

        A `record` gets the states of every step, a `log` every impact of the counted part.
        """

    def begin(self, seed: int, first_path: int, paths: int) -> Underway:
        """The same paths before their first step, to be simulated piece by piece."""

    def cut(self, steps: int) -> Self:
        """The plan whose paths end after so many counted steps, of which there is at least one."""

    @property
    def relative_bias(self) -> float:
        """Relative bias of all quantities that does not depend on the step."""

    def step_bias(self, name: str, difference: float) -> float | None:
        """The bias that the step leaves in a quantity, from its difference to twice the step; None
        where that difference does not determine the bias."""

    def coarser(self) -> Self:
        """The plan at twice the step, for the same paths and as far as possible the same noise."""

    def finer(self) -> Self:
        """The plan with less bias: half the step, or slow impacts resolved."""

    def with_step(self, step: float) -> Self:
        """The plan at a chosen step, s; ValueError if it is too long to detect all impacts."""

    def shortest(self, steps: int = 2) -> Self:
        """The plan with a few steps of the same kernels and hardly any burn-in: two are enough to
        compile them. A plan that synthesises paths has a few samples whatever `steps` is."""

    def record(self, seed: int, path: int) -> Mapping[str, Vector]:
        """One path from its start, without burn-in, by column: displacements, velocities and the
        incident speeds of impacts within the step that ends at each sample."""

    @property
    def relaxation(self) -> float:
        """Relaxation time of the energy including the losses at stops, s."""

    @property
    def speeds(self) -> tuple[float, ...]:
        """Rms speed of the gap of each impact pair, or of one oscillator without a pair, m/s."""

    @property
    def kicked(self) -> bool:
        """Whether there is white noise, which acts in kicks a step apart."""

    @property
    def excitation_known(self) -> bool:
        """Whether `histories` hold the excitation."""

    def sampled(self, step: float, duration: float) -> Self:
        """The plan for `histories` of `duration` seconds at a sampling interval of at most `step`,
        s."""

    @property
    def settling(self) -> int:
        """Number of samples at the beginning of a record that `histories` leave out."""

    def history_samples(self, duration: float) -> int:
        """Number of samples of a history of `duration` seconds, for a plan from `sampled`."""

    def record_size(self, samples: int) -> int:
        """Number of floats in the record of one path, from which a history of `samples` is made."""

    def histories(
        self, seed: int, first_path: int, paths: int, samples: int, log: Log | None = None
    ) -> Histories:
        """Stationary records of the paths first_path, first_path + 1, ..., each of `samples`
        samples.

        A `log` gets every impact; the first sample is at the time (settling + 1) * step of the log.
        """

    def drive(self, seed: int, path: int, samples: int, integrals: int) -> Vector | None:
        """Forces (coordinates, samples) of noise and sines at the samples of `histories`, N,
        integrated over time `integrals` times.

        None where they are not known, or where the integral is not stationary. White noise is the
        mean over the next step.
        """

    def unbroken(self, duration: float) -> Self:
        """The plan with paths of `duration` seconds whose counted part has no jumps: a path that is
        synthesised in several blocks jumps between them."""


class Underway(ABC):
    """Paths of a plan under way, which go on from their state with their sums.

    Their averages depend on the steps that they have made, not on the pieces in which they made
    them. A path has `segments` of `length` steps each, of which the first `burn_in` ones are not
    counted.

    Parameters
    ----------
    length, segments, burn_in
        Lengths in steps, see above.
    """

    def __init__(self, length: int, segments: int, burn_in: int) -> None:
        self.length, self.segments, self.burn_in = length, segments, burn_in
        self.made = 0

    @property
    def total(self) -> int:
        """Number of steps of a path."""
        return self.length * self.segments

    @property
    def counted(self) -> int:
        """Number of counted steps that the paths have made."""
        whole, part = divmod(self.made, self.length)
        return whole * (self.length - self.burn_in) + max(0, part - self.burn_in)

    def reach(self, steps: int) -> None:
        """Simulate the paths on until they have made at least so many steps.

        Raises `GivenUp` if the flag of this thread is set; there are no averages then.
        """
        steps = min(steps, self.total)
        while self.made < steps:
            segment, first = divmod(self.made, self.length)
            last = min(first + steps - self.made, self.length)
            # two successive steps use a pair of normals
            last = min(last + last % 2, self.length)
            self.advance(segment, first, last)
            check_flag()
            self.made += last - first

    @abstractmethod
    def advance(self, segment: int, first: int, last: int) -> None:
        """Make the steps first, first + 1, ... before `last` of a segment."""

    @abstractmethod
    def averages(self) -> Records:
        """Time averages over the counted steps so far, as `Plan.averages` gives them."""


@dataclass(frozen=True, kw_only=True)
class SteppedPlan:
    """Parts that those plans share whose step may be chosen and whose records include the burn-in.

    Parameters
    ----------
    model
        The model that is simulated.
    step, burn_in, duration
        Step, length of the burn-in, and counted length of a path after it, s.
    """

    model: Model
    step: float
    burn_in: float
    duration: float

    @property
    def relative_bias(self) -> float:
        """None but that of the step."""
        return 0.0

    def with_step(self, step: float) -> Self:
        """The plan at a chosen step, s."""
        raise NotImplementedError

    def sampled(self, step: float, duration: float) -> Self:
        """The plan for histories at a step of at most `step`, that last `duration` seconds."""
        plan = self.with_step(min(step, self.step))
        # a step more, since burn-in and duration are both rounded up to whole steps
        steps = math.ceil((plan.burn_in + duration) / plan.step) + 1
        return replace(plan, duration=steps * plan.step)

    def history_samples(self, duration: float) -> int:
        """Number of samples of a history of `duration` seconds, at least 2."""
        return max(2, math.ceil(duration / self.step))

    def unbroken(self, duration: float) -> Self:
        """The plan itself, as its paths do not jump."""
        return self

    def cut(self, steps: int) -> Self:
        """The plan whose paths end after so many counted steps."""
        return replace(self, duration=steps * self.step)


def layout_of_one(
    model: Model,
    origin: float,
    threshold: float,
    sums_of_contacts: tuple[str, ...] = (),
    controls: Mapping[str, float] | None = None,
) -> Layout:
    """Layout of one oscillator: moments of x from `origin`, sums over impacts, the named sums over
    contacts with compliant stops, and controls by name with their expected values."""
    (name,) = model.coordinates
    pair = model.pairs[0].name if model.pairs else ""
    rows = [(name, "x"), (name, "xx"), (name, "vv")]
    rows += [(pair, f"{sum_}_{side}") for side in ("lower", "upper") for sum_ in ("n", "f1", "f2")]
    rows += [(pair, sum_) for sum_ in sums_of_contacts]
    expected = {("", what): value for what, value in (controls or {}).items()}
    return Layout(
        rows=(*rows, *expected),
        origins={name: origin},
        thresholds={pair: threshold},
        controls=expected,
    )


def losses_of(model: Model, layout: Layout, averages: Records, duration: float) -> Records:
    """Energy that the lower and the upper stop of each pair take in a path, (pairs, 2, paths), J,
    from the averages over so many seconds; 0 where it follows from the speeds of impacts."""
    found = np.zeros((len(model.pairs), 2, averages.shape[1]))
    place = {key: row for row, key in enumerate(layout.rows)}
    for number, pair in enumerate(model.pairs):
        for side, name in enumerate(("lower", "upper")):
            row = place.get((pair.name, f"loss_{name}"))
            if row is not None:
                found[number, side] = pair.mass * duration * averages[row]
    return found


def columns_of_one(model: Model, record: Records) -> dict[str, Vector]:
    """Columns of one recorded path of one oscillator, (samples, 3) from the rest position."""
    return {
        "displacement": record[:, 0] + model.rest,
        "velocity": record[:, 1],
        "impact_speed": record[:, 2],
    }


def histories_of_one(
    model: Model, record: Records, excitation: Records | None, lost: Records
) -> Histories:
    """Histories of one oscillator from records (samples, paths, 3), positions from the rest
    position, the excitation (samples, paths), and `losses_of`."""
    x, v, w = np.ascontiguousarray(record.transpose(2, 1, 0))[:, None]
    known = None if excitation is None else np.ascontiguousarray(excitation.T)
    return Histories(
        displacement=x + model.rest, velocity=v, impact_speed=w, excitation=known, lost=lost
    )
