"""Probability that a mass touches its stops at all: first crossings of a stationary Gaussian
process.

Before its first contact the mass moves as if there were no stops: linearly, and Gaussian where the
excitation is. The probability of any impact in a mission depends on no impact law, therefore, and
needs no impact. With nu Rice's rate of outcrossings and G(t) the probability that an outcrossing is
the first one for a time t,

    P(hit before T) = P(beyond a stop at 0) + nu integral_0^T G(t) dt

exactly, since the process is stationary. Around an outcrossing the process is Slepian's (see
`monte_carlo.kernels.crossings`), so G follows from records that look back from a given crossing. A
probability of 1e-9 costs no more than one of 0.1, and the same records serve any number of levels.
Beyond the memory of the process (`horizon`) the survivors are hit at a constant rate, the limiting
decay rate

    lambda = nu G(t) / P(no impact before t)

which thus needs no record as long as the mission.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.fft import irfft
from scipy.special import ndtr

from stochvi.mathematics.arrays import Vector
from stochvi.mathematics.impact_rates import rice_rate
from stochvi.methods.monte_carlo.kernels.crossings import outcrossing_ages
from stochvi.methods.monte_carlo.tabulated import (
    MOST_SAMPLES,
    WARM_UP_RELAXATIONS,
    TabulatedPlan,
    plan_tabulated,
)
from stochvi.model.calculations import calculation
from stochvi.model.coverage import beyond_one_oscillator, without_free_response, without_noise
from stochvi.model.model import model_of
from stochvi.results.errors import NotApplicable
from stochvi.sampling.options import AccuracyOptions
from stochvi.sampling.run import Run, sampled
from stochvi.scenes.scene import Scene
from stochvi.statistics.crossing_ages import STRIDES, CrossingAges, until_accurate

SAMPLES_PER_PERIOD = 40.0
"""Number of samples in a natural period. White noise leaves the path rough between samples: with
half as many (and zeta 0.05) the limiting rate is 1.2(4) % higher at 2 sigma, 0.18(5) % at 3,
0.03(2) % at 5."""

MEMORY_RELAXATIONS = 6.0
"""Horizon in time constants of the structure; in its second half the rate of first impacts is
constant."""

MEMORY_CORRELATIONS = 24.0
"""Horizon in integrals of the squared correlation; for a lightly damped resonance these are the
same 6 time constants."""

SLOPES = 0x5107E5
"""Number that keeps the random slopes apart from other uses of a seed."""


@dataclass(frozen=True, kw_only=True, eq=False)
class FirstCrossings(CrossingAges):
    """Ages of outcrossings of pairs of levels by one oscillator: they give its first impacts.

    Parameters
    ----------
    lower, upper
        (levels,) distances of the stops from the mean position, m; infinite for none.
    displacement_std, velocity_std
        Standard deviations of the process and of its rate, m and m/s.

    See Also
    --------
    stochvi.reliability : The probability of any impact in a mission.
    """

    lower: Vector
    upper: Vector
    displacement_std: float
    velocity_std: float


@calculation
@sampled(rel_error=0.05)
def first_crossings(
    scene: Scene,
    clearances: ArrayLike | None = None,
    *,
    lower: ArrayLike | None = None,
    upper: ArrayLike | None = None,
    mission: float = 3600.0,
    **options: Unpack[AccuracyOptions],
) -> FirstCrossings:
    """First impacts of stops at many clearances, from one set of records.

    Parameters
    ----------
    scene
        One oscillator under Gaussian noise (white, filtered, tabulated, any sum) and constant
        loads; its own stops do not matter.
    clearances
        Distances of two stops from the mean position, m.
    lower, upper
        Instead: distances of a lower and of an upper stop, pairwise; leave one out for one stop.
    **options
        `AccuracyOptions`: `rel_error` is that of the probability of an impact in `mission` seconds,
        at every level where that probability is below 1/2; at the end of the `budget` it ends with
        larger errors.

    Raises
    ------
    NotApplicable
        If the response without stops is not a stationary Gaussian process of one oscillator.

    Examples
    --------
    >>> from stochvi.scenes.excitations import WhiteNoise
    >>> from stochvi.scenes.structures import Oscillator
    >>> scene = Scene(
    ...     structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
    ...     excitations=[WhiteNoise(intensity=0.2)],
    ... )
    >>> rate = first_crossings(scene, [3.0]).first_rate()[0]
    >>> abs(rate.value - 0.0018091405) < 4.5 * rate.standard_error + rate.bias
    True
    """
    above, below = _levels(clearances, lower, upper)
    plan = crossing_plan(scene.model_copy(update={"impact_pairs": ()}))
    run = Run.of(options)
    return until_accurate(run, Records(plan, run.seed, below, above), mission, run.accuracy)


def _levels(
    clearances: ArrayLike | None, lower: ArrayLike | None, upper: ArrayLike | None
) -> tuple[Vector, Vector]:
    """(upper, lower) distances, infinite for no stop."""
    if (clearances is None) == (lower is None and upper is None):
        raise ValueError("give clearances, or lower and upper, not both")
    if clearances is not None:
        lower = upper = clearances
    size = max(0 if side is None else np.size(side) for side in (upper, lower))
    above, below = (
        np.full(size, math.inf) if side is None else np.atleast_1d(np.asarray(side, dtype=float))
        for side in (upper, lower)
    )
    if len(above) != len(below):
        raise ValueError(f"needs as many lower as upper stops, got {len(below)} and {len(above)}")
    if not (np.all(above > 0.0) and np.all(below > 0.0)):
        raise ValueError("distances of stops must be positive, m from the mean position")
    return above, below


def crossing_plan(scene: Scene, horizons: float = 1.0) -> TabulatedPlan:
    """Synthesis of the response without stops, sampled finely enough for its peaks.

    A block repeats itself: it is made so long that so many `horizons` of the response fit into half
    of it. A narrow response is remembered for longer than the structure says. The response then has
    the bandwidth of 12 bins at least (see `horizon_of`).

    Raises `NotApplicable` if it is not a stationary Gaussian process of one oscillator, or too
    narrow for any block.
    """
    model = model_of(scene)
    unmet = (
        beyond_one_oscillator(model, with_filters=True)
        or without_noise(model)
        or without_free_response(model)
    )
    if unmet:
        raise NotApplicable("first_crossings", unmet)
    plan = plan_tabulated(model, None, None)
    period = 2.0 * math.pi / plan.model.omega
    plan = plan.with_step(min(plan.step, period / SAMPLES_PER_PERIOD))
    while horizons * horizon_of(plan) > 0.5 * plan.block_length:
        if 2 * plan.samples > MOST_SAMPLES:
            raise NotApplicable(
                "first_crossings",
                [
                    "the input is too narrow to be resolved: its memory of "
                    f"{horizon_of(plan):.3g} s or more does not fit into half a block of "
                    f"{MOST_SAMPLES} samples"
                ],
            )
        plan = plan.with_block(2.0 * plan.block_length)
    return plan


def horizon_of(plan: TabulatedPlan) -> float:
    """Seconds after which the response of a plan has forgotten its past.

    It follows from the integral of the squared correlation. v_k are the variances of the bins of a
    block of length L. The integral is L / 4 times sum v_k^2 / (sum v_k)^2, one over the bandwidth
    in bins (Parseval).
    """
    variances = plan.amplitudes**2
    bins = float(np.sum(variances) ** 2 / np.sum(variances**2))
    relaxation = plan.warm_up / WARM_UP_RELAXATIONS
    return max(
        MEMORY_CORRELATIONS * plan.block_length / (4.0 * bins), MEMORY_RELAXATIONS * relaxation
    )


class Records:
    """Stationary records of a plan, and the crossings of levels that are put into them.

    `count` samples look back.
    """

    def __init__(self, plan: TabulatedPlan, seed: int, lower: Vector, upper: Vector) -> None:
        self.plan, self.seed = plan, seed
        self.lower, self.upper = lower, upper
        # the stop that is crossed, and the other one; sides that are alike are simulated once
        self.sides = [(upper, lower), (lower, upper)]
        alike = np.array_equal(lower, upper)
        if alike or np.all(np.isinf(lower)):
            self.sides = self.sides[:1]
        elif np.all(np.isinf(upper)):
            self.sides = self.sides[1:]
        self.crosses_upper = [near is upper for near, _ in self.sides]
        self.rates_per_side = 2.0 if alike else 1.0
        variance, _, curvature = self._correlation[0]
        self.displacement_std, self.velocity_std = math.sqrt(variance), math.sqrt(-curvature)
        # a multiple of every stride
        self.count = max(STRIDES) * math.ceil(horizon_of(plan) / plan.step / max(STRIDES))
        self.starts = np.arange(0, max(plan.samples - self.count, 1), self.count)

    @property
    def together(self) -> int:
        """Number of paths that are made together."""
        return self.plan.block

    @property
    def horizon(self) -> float:
        """Time for which records look back, s."""
        return self.count * self.plan.step

    @property
    def rice_rates(self) -> Vector:
        """(sides, levels), see `FirstCrossings`."""
        near = np.stack([near for near, _ in self.sides])
        return self.rates_per_side * rice_rate(near, self.displacement_std, self.velocity_std)

    def block(self, first_path: int) -> tuple[Vector, Vector]:
        """Records (paths, samples, 2) of x and x', and slopes (paths, starts) of unit Rayleigh
        law, of one block of paths."""
        plan, paths = self.plan, self.plan.block
        free = plan.free_response(self.seed, first_path, paths, 0)
        records = np.empty((paths, plan.samples, 2))
        records[:, :, 0] = free[:, 0::2].T
        records[:, :, 1] = plan.model.omega * free[:, 1::2].T
        random = np.random.default_rng([self.seed, SLOPES, first_path])
        return records, random.rayleigh(size=(paths, len(self.starts)))

    def look_back(self, records: Vector, slopes: Vector, side: int, stride: int = 1) -> Vector:
        """Ages (levels, paths, starts) of crossings at slopes (m/s) of the stop of one side."""
        near, far = self.sides[side]
        return self.ages_before(records, self.starts, slopes, stride, near, far)

    def ages_before(
        self, records: Vector, starts: NDArray[np.int64], slopes: Vector, stride: int,
        near: Vector, far: Vector,
    ) -> Vector:  # fmt: skip
        """Ages (levels, paths, starts) of crossings that are put at the samples `starts`."""
        ages = np.empty((len(near), *slopes.shape))
        outcrossing_ages(
            records, starts, slopes, self._looking_back, 0, self.plan.step, stride,
            near[:, None], far[:, None], ages,
        )  # fmt: skip
        return ages

    @cached_property
    def _correlation(self) -> Vector:
        """r, r' and r'' at every sample of a block."""
        return _correlation(self.plan)

    @cached_property
    def shape(self) -> Vector:
        """rho, rho', eta and eta' over a block, (samples, 4)."""
        r = self._correlation
        return np.asarray(r[:, [0, 1, 1, 2]] / r[0, [0, 0, 2, 2]])

    @cached_property
    def _looking_back(self) -> Vector:
        """`shape` at times before the crossing: rho and eta' are even in time, rho' and eta odd."""
        back = self.shape[: self.count + 1] * [1.0, -1.0, -1.0, 1.0]
        return back[None]

    def ages(self, first_path: int) -> NDArray[np.float32]:
        """Ages (strides, sides, levels, paths, starts) of the crossings in one block of paths."""
        return self.ages_in(*self.block(first_path))

    def ages_in(self, records: Vector, unit_slopes: Vector) -> NDArray[np.float32]:
        """The ages of the crossings in a block of records that has been made."""
        slopes = self.velocity_std * unit_slopes
        ages = [
            [self.look_back(records, slopes, side, stride) for side in range(len(self.sides))]
            for stride in STRIDES
        ]
        return np.array(ages, np.float32)

    def found(self, ages: NDArray[np.float32]) -> FirstCrossings:
        """The answer from the ages of all crossings so far."""
        s = self.displacement_std
        return FirstCrossings(
            outside=np.asarray(ndtr(-self.upper / s) + ndtr(-self.lower / s)),
            lower=self.lower,
            upper=self.upper,
            displacement_std=self.displacement_std,
            velocity_std=self.velocity_std,
            horizon=self.horizon,
            interval=self.plan.step,
            rice_rates=self.rice_rates,
            ages=ages,
        )


def deviations(scene: Scene) -> tuple[float, float]:
    """Standard deviations of x (m) and x' (m/s) without stops, white and filtered noise included.

    Examples
    --------
    >>> from stochvi.scenes.excitations import WhiteNoise
    >>> from stochvi.scenes.structures import Oscillator
    >>> scene = Scene(
    ...     structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
    ...     excitations=[WhiteNoise(intensity=0.2)],
    ... )
    >>> [round(deviation, 4) for deviation in deviations(scene)]
    [1.0, 1.0]
    """
    plan = crossing_plan(scene.model_copy(update={"impact_pairs": ()}))
    correlation = _correlation(plan)
    return math.sqrt(correlation[0, 0]), math.sqrt(-correlation[0, 2])


def _correlation(plan: TabulatedPlan) -> Vector:
    """r, r' and r'' at every sample of a block, from the variances of its bins."""
    variances = plan.amplitudes**2
    omega = 2.0 * math.pi / plan.block_length * np.arange(1, len(variances) + 1)
    spectrum = np.zeros((plan.samples // 2 + 1, 3), complex)
    spectrum[1 : len(variances) + 1] = variances[:, None] * (1j * omega[:, None]) ** [0, 1, 2]
    return np.asarray(irfft(spectrum, plan.samples, axis=0, norm="forward") / 2.0)
