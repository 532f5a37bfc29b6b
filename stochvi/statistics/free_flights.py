"""First contacts where no formula tells them: pieces of the motion without stops, of which a
splitting finds those that reach a stop. Chapters: pieces on springs and dampers that are functions,
which the steps of `simulate` follow; the pieces of a model."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy
from numpy.typing import NDArray

from stochvi.mathematics.numerics import Matrix, Vector
from stochvi.mathematics.spectra import bin_variances, gains
from stochvi.mathematics.unsteady_noise import FastPeaks, UnreachableKurtosis
from stochvi.model.coverage import functions_of_arrays, modulated, not_gaussian, without_noise
from stochvi.model.model import Model, with_dampers
from stochvi.model.scales import with_linear_part
from stochvi.motion.choose_plan import with_tables
from stochvi.motion.modal_tables import ModalTablesPlan, plan_modal_tables
from stochvi.results.errors import NotApplicable
from stochvi.statistics.crossings import pressed_pairs
from stochvi.statistics.trial_splitting import (
    OWN,
    FreeWindows,
    Trials,
    WindowSource,
    has_fast_peaks,
    without_peaks,
)

# ------------------------------------------------------------------------------
# Pieces of the motion on springs and dampers that are functions.
#
# The noise is a sum over bins of frequency with Gaussian coefficients, white and filtered noise as
# far as the structure responds to them. A trial is these numbers. The linear part of the mount
# answers them in closed form, and kicks make up for the rest of its forces, as under any table of
# `simulate`. In the first part of a piece, which does not count, the motion forgets that it began
# in that of the linear part. On mounts of all kinds the rate of first contacts was the same within
# its error, 2 %, for parts of 4 to 24 relaxation times before and of 4 to 12 in either half.
# ------------------------------------------------------------------------------

HALF, BEFORE = 4.0, 6.0
"""Length of either half of what counts of a piece, and of the part before it, in relaxation times
of the energy."""

TOGETHER = 128
"""Number of pieces that are followed together."""


def is_followed(model: Model) -> bool:
    """Whether pieces of the motion tell the first contacts of a model: under noise with fast peaks,
    or on springs and dampers that are functions."""
    return has_fast_peaks(model) or bool(model.functions)


def linearised(model: Model) -> Model:
    """The model with Gaussian noise alone, and with the linear parts of its springs and dampers."""
    found = without_peaks(model)
    if not found.functions:
        return found
    return replace(_with_linear_part(found), pairs=found.pairs, functions=())


def _with_linear_part(model: Model) -> Model:
    """The model without stops whose matrices hold the linear parts of its functions."""
    unmet = modulated(model, with_branches=True) + functions_of_arrays(model, with_branches=True)
    unmet += without_noise(model)
    if model.sines:
        unmet.append("sines must be left out beside a spring or damper that is a function")
    if unmet:
        raise NotApplicable("first contacts", unmet)
    free = with_dampers(replace(model, pairs=()))
    return with_linear_part(free, "first contacts") if free.functions else free


@dataclass(frozen=True, eq=False)
class FreeFlights(FreeWindows):
    """Pieces of the motion on springs and dampers that are functions."""

    @cached_property
    def plan(self) -> ModalTablesPlan:
        """The plan of a piece, in one block."""
        held = _with_linear_part(replace(without_peaks(self.model), drawn=()))
        usual = plan_modal_tables(with_tables(held), None, None)
        relaxation = usual.law.slowest
        before, half = BEFORE * relaxation, min(HALF * relaxation, self.longest / 2.0)
        plan = replace(usual, burn_in=before)
        # a whole number of steps, of twice the step too, in either half, and one before the piece
        return plan.with_block(before + 2.0 * half + 8.0 * usual.step)

    @cached_property
    def counted(self) -> int:
        """Steps in a piece: a multiple of four, for halves at twice the step."""
        plan = self.plan
        most = plan.samples - 1 - _steps_before(plan)
        return 4 * max(1, min(most // 4, round(self.longest / (4.0 * plan.step))))

    @property
    def window(self) -> float:
        """Length of a piece, s."""
        return self.counted * self.plan.step

    @cached_property
    def sources(self) -> list[WindowSource]:
        """All noises, by what displacements of the modes, and velocities over `scale`, they
        move."""
        plan, modes = self.plan, self.plan.modes
        bins = plan.samples // 2
        f = np.arange(1, bins) / plan.block_length
        turn = 2j * np.pi * f[:, None] / plan.scale
        waves = []
        for table, force in modes.tables:
            moved = gains(f, np.diag(modes.squares), modes.dynamic, force)
            moved *= np.sqrt(bin_variances(table, plan.block_length, bins))[:, None]
            waves.append(np.hstack([moved, turn * moved]))
        tables = [table for table, _ in modes.tables]
        return self.sources_of(tables, np.array(waves), plan.samples, plan.block_length)

    @cached_property
    def directions(self) -> Matrix:
        """Gaps (pairs, modes) per displacement of the modes."""
        return np.array([pair.direction for pair in self.model.pairs]) @ self.plan.modes.shapes

    @cached_property
    def moving(self) -> NDArray[np.int64]:
        """Numbers of the pairs whose gaps move."""
        moved = self.plan.law.covariance[: self.plan.modes.size, : self.plan.modes.size]
        variances = np.einsum("gm,mk,gk->g", self.directions, moved, self.directions)
        return np.flatnonzero(variances > 0.0)

    def scores(self, trials: Trials, *, half: bool = False, coarse: bool = False) -> Vector:
        """The farthest place in each trial at which a stop is reached."""
        steps = self.counted // (2 if half else 1) // (2 if coarse else 1)
        found = [
            self.closeness(self.flown(trials.records[first : first + TOGETHER], steps, coarse))
            for first in range(0, len(trials.records), TOGETHER)
        ]
        return np.concatenate(found) if found else np.zeros(0)

    def flown(
        self, numbers: NDArray[np.float64], steps: int, coarse: bool = False
    ) -> NDArray[np.float64]:
        """Gaps that move (steps, gaps, records), m from those of the linear part at rest, from
        Gaussian (records, numbers)."""
        plan = self.plan.coarser() if coarse else self.plan
        samples, modes, records = plan.samples, plan.modes.size, len(numbers)
        bins = self.transform(numbers, samples) * (samples / self.plan.samples)
        moved = scipy.fft.irfft(bins, samples, axis=0).reshape(samples, 2, modes, records)
        free = np.ascontiguousarray(moved.transpose(0, 2, 3, 1)).reshape(samples, modes, -1)
        record = np.zeros((steps, records, plan.record_width))
        plan.follow(free, None, burn_in=_steps_before(plan), counted=steps, record=record)
        own = self.directions[self.moving]
        return np.asarray(np.einsum("gm,spm->sgp", own, record[:, :, :modes]))

    def step_bias(self, difference: float) -> float | None:
        """The bias of the step."""
        return self.plan.step_bias("", difference)


def _steps_before(plan: ModalTablesPlan) -> int:
    """Steps of a piece that do not count."""
    return math.ceil(plan.burn_in / plan.step)


# ------------------------------------------------------------------------------
# The pieces of a model, of the kind that its springs and dampers ask for.
# ------------------------------------------------------------------------------


FARTHEST = 2.0
"""Share of the way to a stop up to which scores are told apart."""


def windows_of(
    model: Model, lower: Sequence[float], upper: Sequence[float], longest: float, seed: int
) -> FreeWindows:
    """Pieces of the motion of a model without stops, of at most so many seconds; their score is the
    largest share of the way to a stop. Raises `NotApplicable` as `windows_over` does."""
    stops = np.array([lower, upper])
    near = np.where(np.isfinite(stops), 0.0, math.inf)
    rows = np.stack([near, FARTHEST * stops])
    return windows_over(model, np.array([0.0, FARTHEST]), rows, longest, seed)


def windows_over(
    model: Model, places: Vector, rows: NDArray[np.float64], longest: float, seed: int
) -> FreeWindows:
    """Pieces of at most so many seconds, whose score is the place of the stops that they reach:
    distances (places, 2, pairs), m.

    Raises
    ------
    NotApplicable
        If the noise beside that with fast peaks is not Gaussian, if the motion without stops is not
        stationary, or if a stop presses.
    """
    others = tuple(each for each in model.drawn if not isinstance(each[0], FastPeaks))
    unmet = [
        *not_gaussian(replace(model, drawn=())),
        *(["pulses must be left out beside noise with fast peaks"] if others else []),
        *(["sines must be left out beside noise with fast peaks"] if model.sines else []),
    ]
    unmet = unmet or pressed_pairs(model, *rows[-1])
    if unmet:
        raise NotApplicable("first_crossings", unmet)
    for each, _ in model.drawn:
        try:
            assert isinstance(each, FastPeaks)
            each.cubic  # noqa: B018
        except UnreachableKurtosis as reason:
            raise NotApplicable("first_crossings", str(reason)) from reason
    own = int(np.random.SeedSequence([seed, OWN]).generate_state(1, np.uint64)[0] >> 1)
    table = tuple(tuple(tuple(map(float, side)) for side in row) for row in rows)
    kind = FreeFlights if model.functions else FreeWindows
    return kind(model, tuple(map(float, places)), table, longest, own)
