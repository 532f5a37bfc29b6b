"""The protocol of a plan: how the paths of one scene are simulated, and what is averaged.

A plan knows the model, the step and the lengths of a path, and nothing of how many paths there are,
who simulates them, or what they are needed for. A block of paths is a function of the plan, the
seed and the numbers of the paths alone, so that any worker may simulate it, twice if need be.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol, Self

import numpy as np
from numpy.typing import NDArray

from stochvi.methods.monte_carlo.kernels.impact_log import Log
from stochvi.methods.monte_carlo.statistics import Layout
from stochvi.model.model import Model

Vector = NDArray[np.float64]
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
        (pairs, paths, samples): incident speeds within the step that ends at a sample, added up,
        negative at a lower stop.
    excitation
        (paths, samples), None where it is not known: f of x'' + b x' + omega^2 x = f + impacts,
        m/s^2; a base acceleration is -f. White noise is the mean over the step that follows.
    """

    displacement: Records
    velocity: Records
    impact_speed: Records
    excitation: Records | None


class Plan(Protocol):
    """Steps, start and lengths of the paths of one scene; SI units."""

    @property
    def model(self) -> Model:
        """The model that is simulated."""

    @property
    def method(self) -> str:
        """The scheme, in words, for the assumptions of an answer."""

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
        """Paths that are best simulated together: the kernels' full speed, within the caches."""

    @property
    def steps_per_path(self) -> int:
        """Number of steps of a path, burn-in included."""

    @property
    def elastic(self) -> bool:
        """Whether any step leaves the stationary law exact, so that there is no bias."""

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

        A `record` takes up every step; a `log` takes up every impact of the counted part.
        """

    def step_bias(self, name: str, difference: float) -> float | None:
        """The bias that the step leaves in a quantity, from its difference to twice the step; None
        where that difference does not determine the bias."""

    def coarser(self) -> Self:
        """The same paths, by the same noise as far as possible, at twice the step."""

    def finer(self) -> Self:
        """The plan with less bias: half the step, or slow impacts resolved."""

    def with_step(self, step: float) -> Self:
        """The plan at a chosen step, s; ValueError if impacts would go unseen in it."""

    def shortest(self) -> Self:
        """A few steps of the same kernels: enough to have them compiled."""

    def record(self, seed: int, path: int) -> Mapping[str, Vector]:
        """One path from its start, without burn-in, by column: displacements, velocities and, for
        the step that ends at each sample, incident speeds of impacts."""

    @property
    def relaxation(self) -> float:
        """Relaxation time of the energy, losses at stops included, s."""

    @property
    def speeds(self) -> tuple[float, ...]:
        """Rms speed of the gap of each impact pair, or of one oscillator without a pair, m/s."""

    @property
    def kicked(self) -> bool:
        """Whether white noise acts, in kicks a step apart."""

    @property
    def excitation_known(self) -> bool:
        """Whether `histories` hold the excitation."""

    def sampled(self, step: float, duration: float) -> Self:
        """The plan for `histories` at a sampling interval of at most `step`, s, that are `duration`
        seconds long."""

    @property
    def settling(self) -> int:
        """Samples at the beginning of a record that `histories` leave out."""

    def history_samples(self, duration: float) -> int:
        """Samples of a history of so many seconds, by a plan that was `sampled` for it."""

    def record_size(self, samples: int) -> int:
        """Numbers that the record of one path takes while a history of so many samples is made."""

    def histories(
        self, seed: int, first_path: int, paths: int, samples: int, log: Log | None = None
    ) -> Histories:
        """Settled records of the paths first_path, first_path + 1, ...; `samples` of each.

        A `log` takes up every impact; the first sample stands in it at the time
        (settling + 1) * step.
        """

    def drive(self, seed: int, path: int, samples: int, integrals: int) -> Vector | None:
        """Forces (coordinates, samples) of noise and sines at the samples of `histories`, N.

        They are integrated over time so many times. None where they are not known, or where the
        integral is not stationary. White noise is the mean over the step that follows.
        """

    def unbroken(self, duration: float) -> Self:
        """The plan whose paths of `duration` seconds have no jumps in their counted part: what is
        synthesised in several blocks begins anew in each."""


def layout_of_one(
    model: Model, origin: float, threshold: float, sums_of_contacts: tuple[str, ...] = ()
) -> Layout:
    """Layout of one oscillator: moments of x from `origin`, then sums over impacts, then the named
    sums over contacts with stops that give way."""
    (name,) = model.coordinates
    pair = model.pairs[0].name if model.pairs else ""
    rows = [(name, "x"), (name, "xx"), (name, "vv")]
    rows += [(pair, f"{sum_}_{side}") for side in ("lower", "upper") for sum_ in ("n", "f1", "f2")]
    rows += [(pair, sum_) for sum_ in sums_of_contacts]
    return Layout(rows=tuple(rows), origins={name: origin}, thresholds={pair: threshold})


def columns_of_one(model: Model, record: Records) -> dict[str, Vector]:
    """Columns of one recorded path of one oscillator, (samples, 3) from the rest position."""
    return {
        "displacement": record[:, 0] + model.rest,
        "velocity": record[:, 1],
        "impact_speed": record[:, 2],
    }


def histories_of_one(model: Model, record: Records, excitation: Records | None) -> Histories:
    """Histories of one oscillator from records (samples, paths, 3), positions from the rest
    position, and the excitation (samples, paths)."""
    x, v, w = np.ascontiguousarray(record.transpose(2, 1, 0))[:, None]
    known = None if excitation is None else np.ascontiguousarray(excitation.T)
    return Histories(displacement=x + model.rest, velocity=v, impact_speed=w, excitation=known)
