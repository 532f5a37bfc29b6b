"""Whether a structure whose springs and dampers are modulated comes to rest without its stops."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import MISSING, dataclass, replace
from functools import cached_property
from typing import Unpack

import numpy as np
from numpy.typing import NDArray

from stochvi.mathematics.numerics import Matrix, Vector
from stochvi.mathematics.spectra import square_root
from stochvi.mathematics.units import RATE
from stochvi.model.coverage import functions_of_arrays, linear_system
from stochvi.model.coverage import growth as growth_of_moments
from stochvi.model.model import Model, model_of
from stochvi.motion.kernels.random_numbers import seed_streams
from stochvi.motion.modal import INDEPENDENT, Aloft, Flight, ModalPlan, plan_modal
from stochvi.motion.modal_tables import ModalTablesPlan, plan_modal_tables
from stochvi.results.base import DataFrame, Result, frame_of, quantities_of, stated
from stochvi.results.errors import NotApplicable
from stochvi.results.estimates import Estimate, provenance
from stochvi.sampling.calculations import AccuracyOptions, Sampler, calculation
from stochvi.sampling.run import Run, sampled
from stochvi.scenes.scene import Scene

BETWEEN_NORMS = 64
"""Number of steps after which the motion of a path is scaled to the norm 1: a multiple of 4, as
paths at twice the step take an even number as well."""

RELAXATIONS = 40.0
"""Length of a path in relaxation times of the structure without modulations, and in periods."""

BURN_IN = 0.1
"""Share of a path before growth is counted, in which its direction forgets its start."""

BLOCK = 256
"""Number of paths that are simulated together."""

EXACT = "equations of the moments, exact"


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Stability(Result):
    """How the motion of a modulated structure grows without its stops and what shakes it.

    Parameters
    ----------
    lyapunov_exponent
        Rate, 1/s, at which almost every motion grows in the long run; rest is stable below 0.
    mean_growth, mean_square_growth
        Rates, 1/s, at which the mean motion and the mean squares grow; None where the equations of
        the moments are too many. Mean squares may grow by rare large motions where almost every
        motion decays.
    assumptions
        Assumptions, a sentence each.

    See Also
    --------
    stochvi.growth : The calculation.
    """

    kind = "stability"

    lyapunov_exponent: Estimate = stated("almost every motion", "1/s", MISSING)
    mean_growth: Estimate | None = stated("mean", "1/s", MISSING)
    mean_square_growth: Estimate | None = stated("mean squares", "1/s", MISSING)
    assumptions: Sequence[str] = ()

    def summary(self) -> str:
        """Whether rest is stable."""
        found = self.lyapunov_exponent
        low, high = found.interval()
        if low > 0.0:
            return f"unstable: almost every motion grows, at {RATE.text(found.value)}"
        if high >= 0.0:
            return "on the boundary of stability, within the error"
        squares = self.mean_square_growth
        if squares is not None and squares.value >= 0.0:
            return (
                f"stable, but mean squares grow at {RATE.text(squares.value)} by rare large motions"
            )
        return f"stable: almost every motion decays, at {RATE.text(-found.value)}"

    @property
    def rates(self) -> dict[str, Estimate]:
        """Rates that are known, by name."""
        found = {name: getattr(self, name) for name in quantities_of(Stability)}
        return {name: each for name, each in found.items() if each is not None}

    def to_frame(self) -> DataFrame:
        """One row per rate."""
        return frame_of(
                {"quantity": name, "value": each.value, "unit": "1/s",
                 "standard_error": each.standard_error, "bias": each.bias, "how": each.how}
                for name, each in self.rates.items()
        )  # fmt: skip


@calculation
@sampled(rel_error=0.02)
def growth(scene: Scene, **options: Unpack[AccuracyOptions]) -> Stability:
    """Find whether the motion of a modulated structure grows without its stops.

    Of x'' + b (1 + xi) x' + W^2 (1 + eta) x = 0, and alike for several coordinates, the Lyapunov
    exponent is the limit of ln|x| / t. It is simulated with motions that are scaled to norm 1 again
    and again. Under sines alone it follows from the multipliers of Floquet; at twice the natural
    frequency a small amplitude h gives h W / 4 - b / 2 (B 11.44). Rates of the means and
    the mean squares are eigenvalues of the equations of the moments. What shakes the structure, and
    its stops, are left out.

    Parameters
    ----------
    scene
        The scene, with a modulation of stiffness or damping.
    **options
        `AccuracyOptions`: rel_error, seed, budget and others. The error of the exponent is relative
        to its size, or to the decay without modulations if that is larger; 0.02 if left out.

    Returns
    -------
    Stability
        The rates, 1/s.

    Raises
    ------
    NotApplicable
        If nothing is modulated, or springs and dampers are functions of the motion.
    NotConverged
        If the budget ended before the accuracy was reached; the error holds what is known.

    See Also
    --------
    stochvi.simulate : The stationary motion that stops or noise maintain.

    Examples
    --------
    >>> import math
    >>> from stochvi import Oscillator
    >>> from stochvi.scenes import Modulation
    >>> shaft = Scene(
    ...     structure=Oscillator(mass=1.0, damping=0.02, stiffness=1.0),
    ...     excitations=[
    ...         Modulation(of="stiffness", amplitude=0.2, frequency_hz=1.0 / math.pi)
    ...     ],
    ... )
    >>> growth(shaft).summary()
    'unstable: almost every motion grows, at 0.03994 1/s'
    """
    run = Run.of(options)
    model = model_of(scene)
    conditions = [
        *functions_of_arrays(model),
        *(p.law.refusal(p.name) for p in model.functions if p.modulation is None),
    ]
    if not model.modulations:
        conditions.append("excitation must modulate stiffness or damping, got nothing that does")
    if conditions:
        raise NotApplicable("growth", conditions)
    means, squares = (_exact(growth_of_moments(model, power)) for power in (1, 2))
    sines = all(part.modulation.amplitude for part in model.modulations if part.modulation)
    taken = None
    if sines and means is not None:
        exponent = replace(means, how="multipliers of Floquet, exact")
    else:
        sampler = GrowthSampler(_alone(model), run.seed)
        decay = float(np.min(-np.linalg.eigvals(linear_system(model)).real))

        def error(sample: NDArray[np.float64]) -> float:
            found = sampler.exponent(sample)
            return found.standard_error / max(abs(found.value), abs(decay))

        taken = run.to_accuracy(sampler, BLOCK, error, run.accuracy)
        exponent = sampler.exponent(taken.sample)
    answer = Stability(
        lyapunov_exponent=exponent,
        mean_growth=means,
        mean_square_growth=squares,
        assumptions=(*scene.assumptions(), LEFT_OUT),
        cost=run.cost() if taken is None else run.cost(
            paths=taken.paths, steps=taken.paths * sampler.plan.steps_per_path
        ),
        provenance=provenance(scene.document(), run.seed),
    )  # fmt: skip
    if taken is not None and not taken.enough:
        raise run.deadline.fell_short(
            "before the exponent was accurate enough", "raise it, or rel_error", answer
        )
    return answer


LEFT_OUT = "stability is that of rest: stops and all that shakes the structure are left out"
"""Assumption of a stability."""


def _size(weights: Vector, state: Matrix) -> Vector:
    """Norm of the displacements and velocities of each path, row by row: it is the same in a block
    of any size."""
    total = np.zeros(state.shape[1])
    for weight, row in zip(weights, state, strict=False):
        total += (weight * row) ** 2
    return np.sqrt(total)


def _exact(rate: float | None) -> Estimate | None:
    return None if rate is None else Estimate(value=rate, how=EXACT)


def _alone(model: Model) -> ModalPlan:
    """The plan of a structure that modulations alone move, without stops."""
    still = replace(
        model, pairs=(), whites=(), constants=(), tables=(),
        signals=tuple(replace(s, direction=np.zeros_like(s.direction)) for s in model.signals),
    )  # fmt: skip
    # motion that is scaled again and again settles as without modulations, also where it grows
    planned = plan_modal_tables if model.sampled_modulations else plan_modal
    plan = planned(still, None, None, settling=lambda _, slowest: slowest)
    period = 2.0 * math.pi / max(plan.fastest, 1e-300)
    length = RELAXATIONS * max(plan.law.slowest, period)
    return replace(plan, burn_in=BURN_IN * length, duration=length)


@dataclass(frozen=True, eq=False)
class GrowthSampler(Sampler[NDArray[np.float64], NDArray[np.float64]]):
    """Growth rates of paths whose motion is scaled to norm 1 again and again.

    Parameters
    ----------
    plan
        Plan of the structure that modulations alone move.
    seed
        Seed of the random numbers.
    """

    plan: ModalPlan
    seed: int

    @property
    def block(self) -> int:
        """Number of paths that one call simulates together."""
        return self.plan.block if isinstance(self.plan, ModalTablesPlan) else BLOCK

    @cached_property
    def rounds(self) -> tuple[int, int]:
        """Number of scalings before growth is counted, and number of those after."""
        steps = BETWEEN_NORMS * self.plan.step
        return math.ceil(self.plan.burn_in / steps), math.ceil(self.plan.duration / steps)

    def simulate(self, first_path: int, paths: int) -> NDArray[np.float64]:
        """Growth rate of each path, 1/s, at the step and at its double (paths, 2)."""
        fine = self._growth(self.plan, BETWEEN_NORMS, first_path, paths)
        coarse = self._growth(self.plan.coarser(), BETWEEN_NORMS // 2, first_path, paths)
        return np.stack([fine, coarse], axis=1)

    def _growth(
        self, plan: ModalPlan, steps: int, first_path: int, paths: int
    ) -> NDArray[np.float64]:
        n, frequencies = plan.modes.size, np.sqrt(np.maximum(plan.modes.squares, 1e-300))
        weights = np.concatenate([frequencies, np.ones(n)])
        streams = np.empty((2, paths), np.uint64)
        seed_streams(np.uint64(self.seed), first_path, streams)
        root = square_root(plan.law.covariance, INDEPENDENT)
        state, total = plan.start(streams, root), np.zeros(paths)
        path = Flight(plan, Aloft(state, streams, state[: 2 * n]), self.seed, first_path)
        before, counted = self.rounds
        for number in range(before + counted):
            if number == before:
                total[:] = 0.0
            path.scale(1.0 / _size(weights, path.motion))
            total += np.log(_size(weights, path.on(steps)))
        return np.asarray(total / (counted * steps * plan.step))

    def add_up(self, pieces: list[NDArray[np.float64]]) -> NDArray[np.float64]:
        """The rates of all paths."""
        return np.concatenate(pieces)

    def merge(self, sample: NDArray[np.float64], more: NDArray[np.float64]) -> NDArray[np.float64]:
        """The rates of both groups of paths."""
        return np.concatenate([sample, more])

    def paths(self, sample: NDArray[np.float64]) -> int:
        """Number of paths."""
        return len(sample)

    def exponent(self, sample: NDArray[np.float64]) -> Estimate:
        """The Lyapunov exponent, 1/s."""
        count, changed = len(sample), sample[:, 0] - sample[:, 1]
        if count < 2:
            return Estimate(value=float(sample[0, 0]), bias=None, how="one path")
        root = math.sqrt(count)
        return Estimate(
            value=float(sample[:, 0].mean()),
            standard_error=float(sample[:, 0].std(ddof=1)) / root,
            bias=abs(float(changed.mean())) / 3.0,
            bias_error=float(changed.std(ddof=1)) / root / 3.0,
            how=f"{count} paths, scaled again and again",
        )
