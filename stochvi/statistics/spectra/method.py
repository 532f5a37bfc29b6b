"""Spectra of the stationary response by Monte Carlo, each with its band, bias and resolution.

Densities are one-sided per hertz. Records are made a block of paths at a time, cut into segments,
tapered, transformed, averaged and let go; what is kept are the means over paths of all products
X_i* X_j and their scatter, from which everything else follows at each frequency:

    velocity       G_v = w^2 G_x                       acceleration  A = -M^-1 (K + i w C) X - F / M
    transmissibility |G_fa| / G_ff (H1), (G_aa / G_ff)^(1/2)     coherence  |G_fa|^2 / (G_ff G_aa)

Standard errors come from independent paths. Two biases are stated beside them. The taper W smears a
spectrum, G * |W|^2. The size of this bias follows from the estimate smeared once more and smeared
twice more: most of the noise is averaged out in their difference. And white noise acts in kicks a
step h apart, sampled with the response. The tail 1/w^2 of an impulse becomes h^2 / (4 sin^2 (w h /
2)) with all its aliases. The density is then off by (w h)^2 / 6, relative and to leading order.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, Unpack

import numpy as np
from numpy.typing import NDArray

from stochvi.methods.monte_carlo.history_plans import HistoryPlan, plan_histories
from stochvi.methods.monte_carlo.prices import check_price
from stochvi.model.calculations import calculation
from stochvi.model.model import Model
from stochvi.results.deadline import Deadline
from stochvi.results.errors import NotApplicable
from stochvi.results.estimates import provenance
from stochvi.results.intervals import CONFIDENCE, PathMoments, delta_method, student_quantile
from stochvi.sampling.options import AccuracyOptions
from stochvi.sampling.run import Run, sampled
from stochvi.sampling.sampler import Sampler
from stochvi.scenes.impact_laws import CompliantLaw
from stochvi.scenes.scene import Scene
from stochvi.statistics.spectra.answer import UNITS, Curve, ResponseSpectrum
from stochvi.statistics.spectra.quantities import channels_of, quantities_of
from stochvi.statistics.spectra.segments import (
    KERNEL_BINS,
    TIME_HALF_BANDWIDTH,
    Layout,
    layout_of,
    moments_of,
    products,
)

SEGMENT_BANDWIDTHS = 21.0
"""Length of a segment times the half-power bandwidth. Hann's kernel has the variance 1 / (3 T^2), a
resonance the curvature -8 / B^2 at its peak, which is thus lowered by 4 / (3 (B T)^2): 0.3 %."""

MOST_LENGTHS, FEWEST_LENGTHS, LONG_PATH = 4.0, 2.0, 2.0**17
"""Length of a path in segments, by Welch's method: four, but as few as two where a path would have
more samples than this."""

STEP_BIAS = 0.01
"""Largest relative bias by the step, (w h)^2 / 6, at the highest frequency."""

HIGHEST = 4.0
"""Highest frequency of a spectrum, over that of the fastest mode or flight between two stops."""

MOST_SAMPLES = 2**22
"""Largest number of samples of a path."""

CONTACT_SAMPLES = 8.0
"""Number of samples in a contact with a compliant stop."""

FEWEST_PATHS = 64
"""Smallest number of paths from which a standard error can be trusted."""

SINE_IS_A_LINE = "a sine is a line: its height here is that of its power over a bin"
"""Warning of every spectrum whose scene has a sine."""

REL_ERROR = 0.05
"""Median relative standard error to reach, where neither an error nor a number of paths is asked
for."""

EXCITED = 1e-3
"""Density of an excitation, relative to its largest value, below which an estimate may consist of
leakage of the tapers alone: transmissibility and coherence are given only where the density is
higher."""


@calculation
@sampled
def spectrum(
    scene: Scene,
    *,
    paths: int | None = None,
    method: Literal["welch", "multitaper"] = "welch",
    highest: float | None = None,
    segment: float | None = None,
    **options: Unpack[AccuracyOptions],
) -> ResponseSpectrum:
    """Power spectral densities of the stationary response, one-sided per hertz, with 95 % bands.

    Every coordinate has spectra of its relative displacement and its velocity; on a moving base
    also of its absolute acceleration. With rigid stops that acceleration leaves out the impulses:
    it is the one by springs and dampers between impacts. One oscillator also has its apparent
    transmissibility and its coherence with the excitation, a base acceleration or a force. Both
    count what springs, dampers and compliant stops transmit. The transmissibility has two forms. H1
    takes the part of the response that is linear in the input; the square root of the ratio of the
    densities takes all of it. Without stops the two are equal.

    Parameters
    ----------
    scene
        Any scene that `simulate` covers.
    paths
        Number of paths, instead of a relative error.
    method
        Welch's: Hann segments that overlap by half. Or Thomson's multitapers over whole paths.
    highest
        Frequency up to which to estimate, Hz; by default four times that of the fastest mode.
    segment
        Length of a segment, s; by default 21 over the narrowest half-power bandwidth.
    **options
        `AccuracyOptions`: `rel_error` is the median relative standard error to reach, by default
        0.05; `seed`, `threads`, `executor`, `budget`, `progress`, `checkpoint`, `resume`.

    Returns
    -------
    ResponseSpectrum
        Densities with bands of each coordinate.

    Raises
    ------
    NotApplicable
        If `simulate` does not cover the scene, or its shortest and longest times lie too far apart
        for one record.
    NotConverged
        If time ends first; it carries the answer so far.
    ValueError
        If an argument is out of range.

    See Also
    --------
    stochvi.impacts : Statistics of impacts.
    stochvi.history : One realisation in time.

    Examples
    --------
    >>> from stochvi.scenes.excitations import WhiteNoise
    >>> from stochvi.scenes.structures import Oscillator
    >>> scene = Scene(
    ...     structure=Oscillator(mass=1.0, damping=0.2, stiffness=1.0),
    ...     excitations=[WhiteNoise(intensity=0.2)],
    ... )
    >>> found = spectrum(scene, paths=64)
    >>> below = found.curves["x"]["displacement"].value[0]  # 2 S0 / omega^4 = 0.4
    >>> bool(0.3 < below < 0.5)
    True
    """
    _check_options(method, highest, segment)
    run = Run.of(options)
    asked = REL_ERROR if run.rel_error is None else run.rel_error
    plan, layout, bandwidth = _planned(scene, method, highest, segment, run.deadline)
    plan.plan.shortest().histories(run.seed, 0, 2, samples=2)
    check_price([plan.plan], run.seed, run.deadline)
    sampler = SpectrumSampler(plan, layout, run.seed)
    if paths is None:
        found = run.to_accuracy(sampler, FEWEST_PATHS, _median_error, asked)
    else:
        found = run.until(sampler, paths)
    moments = found.sample
    short = remedy = ""
    if not found.enough and paths is not None:
        short, remedy = f"after {moments.count} of {paths} paths", "raise budget"
    elif not found.enough:
        error = _median_error(moments)
        short = f"at a median relative standard error of {error:.2g}, asked for {asked:g}"
        remedy = "raise budget or rel_error"
    curves, meanings = _curves(scene, plan, layout, moments, method)
    motion = next(iter(curves.values()))["displacement"]
    answer = ResponseSpectrum(
        frequency_hz=layout.frequency_hz[_inside(layout, method)],
        curves=curves,
        method=method,
        segment=layout.size * layout.step,
        step=layout.step,
        bandwidth=bandwidth,
        degrees_of_freedom=float(2.0 * np.median((motion.value / motion.standard_error) ** 2)),
        meanings=meanings,
        assumptions=scene.assumptions(),
        warnings=(
            *(["the accuracy asked for was not reached"] if short else []),
            *([SINE_IS_A_LINE] if plan.model.sines else []),
        ),
        cost=run.cost(
            steps=moments.count * (plan.samples + plan.plan.settling), paths=moments.count
        ),
        provenance=provenance(scene.document(), run.seed),
    )
    if short:
        raise run.deadline.fell_short(short, remedy, answer)
    return answer


def _check_options(method: str, highest: float | None, segment: float | None) -> None:
    if method not in KERNEL_BINS:
        raise ValueError(f"method must be 'welch' or 'multitaper', got {method!r}")
    for name, number in (("highest", highest), ("segment", segment)):
        if number is not None and not 0.0 < number < math.inf:
            raise ValueError(f"{name} must be a positive number, got {number}")


def _planned(
    scene: Scene, method: str, highest: float | None, segment: float | None, deadline: Deadline
) -> tuple[HistoryPlan, Layout, float]:
    """The plan of the records, their layout in segments, and the bandwidth that they resolve."""
    plan = plan_histories(scene, deadline)
    bandwidth = 1.0 / (2.0 * math.pi * plan.slowest)
    length = SEGMENT_BANDWIDTHS / bandwidth if segment is None else segment
    top = HIGHEST * plan.fastest / (2.0 * math.pi) if highest is None else highest
    step = math.sqrt(6.0 * STEP_BIAS) / (2.0 * math.pi * max(top, plan.fastest / (2.0 * math.pi)))
    step = min(step, plan.step, _contact_time(plan) / CONTACT_SAMPLES)
    duration = length * TIME_HALF_BANDWIDTH
    if method == "welch":
        duration = length * min(max(LONG_PATH * step / length, FEWEST_LENGTHS), MOST_LENGTHS)
    if duration / step > MOST_SAMPLES:
        raise NotApplicable(
            "spectrum",
            [
                f"a path needs {duration / step:.2g} samples, at most {MOST_SAMPLES} are made; "
                "give a lower highest frequency (highest) or a shorter segment"
            ],
        )
    if length * top < 4.0 * KERNEL_BINS[method]:
        raise ValueError(
            f"segment must be at least {4.0 * KERNEL_BINS[method] / top:.3g} s to resolve the band "
            f"up to {top:.3g} Hz, got {length:.3g} s"
        )
    plan = plan.sampled(step, duration)
    return plan, layout_of(plan, method, length, top), bandwidth


def _contact_time(plan: HistoryPlan) -> float:
    """Shortest contact of a compliant stop, s; infinite without one."""
    times = [
        stop.law.impact(plan.speed, pair.mass).contact_time
        for pair in plan.model.pairs
        for stop in pair.stops
        if isinstance(stop.law, CompliantLaw)
    ]
    return min(times, default=math.inf)


def _jumps(model: Model) -> list[float]:
    """Frequencies at which the density of the excitation jumps, Hz.

    Within a main lobe of a jump, power leaks into a bin from both sides, with the gain of the
    structure at each. A density that is smeared by the kernel does not describe that.
    """
    ends = (table.frequency_hz[[0, -1]] for table in model.acceleration_tables)
    return [float(end) for pair in ends for end in pair]


@dataclass(frozen=True, eq=False)
class SpectrumSampler(Sampler[NDArray[np.float64], PathMoments]):
    """Products of the transforms of records, averaged over paths."""

    plan: HistoryPlan
    layout: Layout
    seed: int

    @property
    def block(self) -> int:
        """Number of paths that are recorded together."""
        return self.plan.block

    def simulate(self, first_path: int, paths: int) -> NDArray[np.float64]:
        """Products of each path, (paths, rows, bins)."""
        records = self.plan.histories(self.seed, first_path, paths)
        return products(channels_of(self.plan, records), self.layout)

    def add_up(self, pieces: list[NDArray[np.float64]]) -> PathMoments:
        """Their moments."""
        return moments_of(np.concatenate(pieces))

    def merge(self, sample: PathMoments, more: PathMoments) -> PathMoments:
        """The moments of both groups of paths."""
        return sample.merge(more)

    def paths(self, sample: PathMoments) -> int:
        """Number of paths."""
        return sample.count


def _median_error(moments: PathMoments) -> float:
    """Median relative standard error of the displacement of the first coordinate."""
    error = np.sqrt(moments.covariance[0, 0])
    return float(np.median(error / moments.mean[0]))


def _inside(layout: Layout, method: str) -> NDArray[np.bool_]:
    """Which frequencies have on both sides all that smears the spectrum at them."""
    edge = 2 * KERNEL_BINS[method]
    found = np.zeros(len(layout.frequency_hz), bool)
    found[edge:-edge] = True
    return found


def _curves(
    scene: Scene, plan: HistoryPlan, layout: Layout, moments: PathMoments, method: str
) -> tuple[dict[str, dict[str, Curve]], dict[str, str]]:
    """Curves by owner and quantity, with their errors, and the meaning of each quantity."""
    f, inside = layout.frequency_hz, _inside(layout, method)
    once = np.apply_along_axis(np.convolve, 1, moments.mean, layout.kernel, "same")
    twice = np.apply_along_axis(np.convolve, 1, once, layout.kernel, "same")
    omega = 2.0 * math.pi * f
    kicked = np.maximum(omega, plan.fastest) * layout.step
    by_step = kicked**2 / 6.0 if plan.plan.kicked else np.zeros_like(f)
    quantile = student_quantile(1.0 - CONFIDENCE, moments.count - 1)
    curves: dict[str, dict[str, Curve]] = {}
    quantities, meanings = quantities_of(scene, plan, omega)
    for (owner, name), quantity in quantities.items():
        value, error = delta_method(quantity, moments.mean, moments.covariance)
        bias = np.abs(quantity(twice) - quantity(once))
        if name.startswith("transmissibility"):
            bias += by_step * value / 2.0
        elif UNITS[name] != "1":
            bias += by_step * value
        if name == "coherence":
            segments = moments.count * len(layout.starts) * len(layout.tapers)
            bias += (1.0 - value) ** 2 / segments
        # a coordinate that nothing moves has no error either
        relative = np.divide(error, value, out=np.zeros_like(error), where=value > 0.0)
        with np.errstate(over="ignore"):  # a density that is rounding error has no finite band
            spread = np.exp(quantile * relative)
        known = inside
        if UNITS[name] == "1":
            into = quantities[owner, "excitation"](moments.mean)
            known = inside & (into > EXCITED * np.max(into[inside]))
            for jump in _jumps(plan.model):
                known &= np.abs(f - jump) > KERNEL_BINS[method] * (f[1] - f[0])
        curves.setdefault(owner, {})[name] = Curve(
            frequency_hz=f[known],
            value=value[known],
            standard_error=error[known],
            bias=bias[known],
            lower=np.maximum(value / spread - bias, 0.0)[known],
            upper=(value * spread + bias)[known],
        )
    return curves, meanings
