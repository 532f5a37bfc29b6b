"""Power spectral densities of the response by Monte Carlo. Chapters: tapered segments and their
products; densities, transmissibilities and coherence; the answer; the calculation, with its biases.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal, Unpack

import numpy as np
import scipy
from numpy.typing import NDArray

from stochvi.mathematics import numerics
from stochvi.mathematics.numerics import Matrix, Vector
from stochvi.model.model import FunctionOfMotion, Model, Pair
from stochvi.motion.choose_plan import HistoryPlan, check_price, plan_histories
from stochvi.motion.plan import Histories, gap_of
from stochvi.results.base import DataFrame, Result, frame_of, in_angles, in_chosen_units, stacked
from stochvi.results.deadline import Deadline
from stochvi.results.errors import NotApplicable
from stochvi.results.estimates import (
    CONFIDENCE,
    PathMoments,
    delta_method,
    provenance,
    student_quantile,
)
from stochvi.sampling.calculations import AccuracyOptions, Sampler, calculation
from stochvi.sampling.run import Run, sampled
from stochvi.scenes.excitations import BASE
from stochvi.scenes.impact_laws import CompliantLaw
from stochvi.scenes.scene import Scene

# ------------------------------------------------------------------------------
# Records cut into tapered segments and transformed; their products, averaged over paths.
# ------------------------------------------------------------------------------


Quantity = Callable[[Matrix], Vector]

OVERLAP = 0.5
"""Share by which Hann segments overlap: more overlap hardly lowers the error."""

TIME_HALF_BANDWIDTH = 4.0
"""NW of the multitapers (D. J. Thomson 1982). Their kernel is as wide as that of a Hann segment
NW times shorter, which is the whole path here."""

TAPERS = 7
"""Number of multitapers, 2 NW - 1: the ones that leak little."""

KERNEL_BINS = {"welch": 2, "multitaper": 8}
"""Half width, in bins, of a kernel |W|^2; beyond it the kernel is neglected."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Layout:
    """The cut of records into segments of a `size` by a method: starts of segments, kept bins."""

    method: str
    size: int
    starts: tuple[int, ...]
    step: float
    bins: slice

    @cached_property
    def tapers(self) -> Matrix:
        """(tapers, samples of a segment)."""
        if self.method == "welch":
            turn = 2.0 * np.pi * np.arange(self.size)[None] / self.size
            tapers = 0.5 - 0.5 * np.cos(turn)
        else:
            tapers = scipy.signal.windows.dpss(self.size, TIME_HALF_BANDWIDTH, TAPERS, sym=False)
        return np.asarray(tapers / np.sqrt(np.sum(tapers**2, axis=1, keepdims=True)))

    @cached_property
    def kernel(self) -> Vector:
        """|W|^2 at whole bins, which add up to one."""
        half = KERNEL_BINS[self.method]
        near = np.arange(-half, half + 1)
        turns = np.exp(-2j * np.pi / self.size * np.outer(near, np.arange(self.size)))
        kernel = np.mean(np.abs(self.tapers @ turns.T) ** 2, axis=0)
        return np.asarray(kernel / kernel.sum())

    @property
    def frequency_hz(self) -> Vector:
        """Frequencies of the kept bins, Hz."""
        df = 1.0 / (self.size * self.step)
        return np.asarray(df * np.arange(self.bins.start, self.bins.stop))


def moments_of(products: NDArray[np.float64]) -> PathMoments:
    """Moments of the products of each path, (paths, rows, bins)."""
    mean = products.mean(axis=0)
    away = products - mean
    return PathMoments(
        count=len(products), mean=mean, scatter=np.einsum("prf,psf->rsf", away, away)
    )


def layout_of(plan: HistoryPlan, method: str, length: float, top: float) -> Layout:
    samples, starts = plan.samples, (0,)
    size = samples
    if method == "welch":
        size = min(samples, scipy.fft.prev_fast_len(round(length / plan.step)))
        hop = max(1, round(size * (1.0 - OVERLAP)))
        starts = (*range(0, samples - size + 1, hop),)
    beside = 2 * KERNEL_BINS[method]
    last = min(numerics.ceil(top * size * plan.step), size // 2 - beside)
    bins = slice(1, last + beside + 1)
    return Layout(method=method, size=size, starts=starts, step=plan.step, bins=bins)


def products(records: NDArray[np.float64], layout: Layout) -> NDArray[np.float64]:
    """Densities of records (channels, paths, samples): (paths, rows, bins), one-sided per hertz.

    Rows are the densities of the channels, then real and imaginary part of each pair i < j of
    conj(X_i) X_j, in turn; means over segments and tapers, each segment less its mean.
    """
    size = layout.size
    channels, paths, _ = records.shape
    pairs = [(i, j) for i in range(channels) for j in range(i + 1, channels)]
    bins = layout.bins.stop - layout.bins.start
    found = np.zeros((paths, channels + 2 * len(pairs), bins))
    for start in layout.starts:
        piece = records[:, :, start : start + size]
        piece = piece - piece.mean(axis=-1, keepdims=True)
        for taper in layout.tapers:
            z = scipy.fft.rfft(piece * taper, axis=-1)[:, :, layout.bins]
            for i in range(channels):
                found[:, i] += np.abs(z[i]) ** 2
            for k, (i, j) in enumerate(pairs):
                product = np.conj(z[i]) * z[j]
                found[:, channels + 2 * k] += product.real
                found[:, channels + 2 * k + 1] += product.imag
    found *= 2.0 * layout.step / (len(layout.starts) * len(layout.tapers))
    return found


# ------------------------------------------------------------------------------
# The quantities that are made from products of channels: densities, transmissibilities, coherence.
# ------------------------------------------------------------------------------


Weights = NDArray[np.complex128]
"""Complex weights of channels at each frequency (channels, bins)."""


def channels_of(plan: HistoryPlan, histories: Histories) -> NDArray[np.float64]:
    """(channels, paths, samples): displacements, forces of pairs with compliant stops, of springs
    and dampers that are functions, N, and the excitation if it is known."""
    found = [*histories.displacement]
    for pair in _soft_pairs(plan.model):
        gap, rate = (
            np.tensordot(pair.direction, motion, axes=1)
            for motion in (histories.displacement, histories.velocity)
        )
        found.append(pair.force(gap, rate))
    for part in _functions(plan.model):
        y, rate = (
            np.tensordot(part.direction, motion, axes=1)
            for motion in (histories.displacement, histories.velocity)
        )
        found.append(part.force_left_out(y, rate))
    if histories.excitation is not None:
        found.append(histories.excitation)
    return np.stack(found)


def _soft_pairs(model: Model) -> list[Pair]:
    """The pairs with a compliant stop; a rigid one beside it has no force."""
    return [pair for pair in model.pairs if not pair.rigid]


def _functions(model: Model) -> tuple[FunctionOfMotion, ...]:
    """The springs and dampers that are functions, unless the force of one follows from its past."""
    return () if model.remembers else model.functions


def quantities_of(
    scene: Scene, plan: HistoryPlan, omega: Vector
) -> tuple[dict[tuple[str, str], Quantity], dict[str, str]]:
    """The quantities as functions of the rows of `products`, by owner and name; and their meanings
    in this scene."""
    model = plan.model
    n, soft = len(model.coordinates), _soft_pairs(model)
    known = plan.plan.excitation_known
    functions = _functions(model)
    channels = n + len(soft) + len(functions) + known
    found: dict[tuple[str, str], Quantity] = {}
    owners = dict(zip(model.outputs, model.output_rows, strict=True))
    owners |= {gap_of(pair): pair.direction for pair in model.pairs if pair.relative}
    for owner, direction in owners.items():
        weights: Weights = np.zeros((channels, len(omega)), complex)
        weights[:n] = direction[:, None]
        found[owner, "displacement"] = _density(weights)
        found[owner, "velocity"] = _density(weights * (1j * omega))
    # forces of springs, dampers and stops, per unit mass of each coordinate
    pulled = np.linalg.solve(
        model.mass[None], model.stiffness + 1j * omega[:, None, None] * model.damping
    )
    carried = np.zeros((n, channels, len(omega)), complex)
    carried[:, :n] = -np.moveaxis(pulled, 0, -1)
    directions = [each.direction for each in soft] + [each.direction for each in functions]
    for channel, direction in enumerate(directions, start=n):
        carried[:, channel] = -np.linalg.solve(model.mass, direction)[:, None]
    meanings = _meanings(scene, plan)
    if "acceleration" in _present(scene) and not model.remembers:
        for owner, row in zip(model.outputs, model.output_rows, strict=True):
            found[owner, "acceleration"] = _density(np.tensordot(row, carried, axes=1))
    if known:
        (owner,) = model.coordinates
        shaken = np.zeros((channels, len(omega)), complex)
        shaken[-1] = 1.0
        out, cross, into = _density(carried[0]), _cross(shaken, carried[0]), _density(shaken)
        found[owner, "excitation"] = into
        if not np.any(carried[0]):  # neither spring, damper nor a compliant stop
            for name in ("coherence", "transmissibility_h1", "transmissibility_ratio"):
                meanings[name] = "left out: nothing but impacts acts on the mass"
            return found, meanings
        found[owner, "transmissibility_h1"] = lambda m: np.abs(cross(m)) / into(m)
        # outside the band of the excitation the delta method may step to a density below zero
        found[owner, "transmissibility_ratio"] = lambda m: np.sqrt(
            np.maximum(out(m) / into(m), 0.0)
        )
        found[owner, "coherence"] = lambda m: np.abs(cross(m)) ** 2 / (into(m) * out(m))
    return found, meanings


def _present(scene: Scene) -> list[str]:
    """Whether all that shakes acts on a base, so that what springs carry is all of M x''."""
    shaking = [each for each in scene.excitations if each.shakes]
    return ["acceleration"] if all(scene.place(each) == BASE for each in shaking) else []


def _meanings(scene: Scene, plan: HistoryPlan) -> dict[str, str]:
    rigid = any(stop.rigid for stop in plan.model.stops)
    if plan.model.modulations:
        acceleration = "left out: the force of a modulation is not kept"
    elif plan.model.remembers:
        acceleration = "left out: the force of a spring with hysteresis is not kept"
    elif not _present(scene):
        acceleration = "left out: a force acts on a mass, and is part of its acceleration"
    elif rigid:
        acceleration = "absolute, between impacts: by springs and dampers, without the impulses"
    else:
        acceleration = "absolute"
    meanings = {
        "displacement": "relative to the base, less its mean",
        "velocity": "(2 pi f)^2 times that of the displacement",
        "acceleration": acceleration,
    }
    if plan.plan.excitation_known:
        of = "base acceleration to absolute acceleration" if _present(scene) else "force to support"
        meanings["transmissibility_h1"] = f"{of}, the part that is linear in the excitation"
        meanings["transmissibility_ratio"] = f"{of}, root of the ratio of densities"
        meanings["coherence"] = "between the transmitted motion or force and the excitation"
        if plan.model.tables:
            meanings["coherence"] += "; like transmissibilities, left out at the ends of a table"
    else:
        meanings["coherence"] = (
            "left out, like transmissibilities: the excitation is known for one oscillator under "
            "white or tabulated noise without sines alone"
        )
    return meanings


def _density(weights: Weights) -> Quantity:
    """Density of sum_i weights_i X_i from the rows of `products`."""
    cross = _cross(weights, weights)
    return lambda rows: np.asarray(cross(rows).real)


def _cross(first: Weights, second: Weights) -> Callable[[Matrix], Weights]:
    """Cross density of two weighted sums of channels, conj(first X) (second X)."""
    channels = len(first)
    pairs = [(i, j) for i in range(channels) for j in range(i + 1, channels)]

    def of(rows: Matrix) -> Weights:
        total = np.zeros(rows.shape[1], complex)
        for i in range(channels):
            total += np.conj(first[i]) * second[i] * rows[i]
        for k, (i, j) in enumerate(pairs):
            product = rows[channels + 2 * k] + 1j * rows[channels + 2 * k + 1]
            total += np.conj(first[i]) * second[j] * product
            total += np.conj(first[j]) * second[i] * np.conj(product)
        return total

    return of


# ------------------------------------------------------------------------------
# The answer of `spectrum`: curves with their errors.
# ------------------------------------------------------------------------------


UNITS = {
    "displacement": "m^2/Hz",
    "velocity": "(m/s)^2/Hz",
    "acceleration": "(m/s^2)^2/Hz",
    "excitation": "(m/s^2)^2/Hz",
    "transmissibility_h1": "1",
    "transmissibility_ratio": "1",
    "coherence": "1",
}
"""Units of the quantities of a spectrum."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Curve:
    """A quantity at every frequency: value, standard error, bias, and its 95 % band.

    The band is that of Student's t for the logarithm, widened by the bias. Quantities that refer to
    the excitation are given at the frequencies of its density.
    """

    frequency_hz: Vector
    value: Vector
    standard_error: Vector
    bias: Vector
    lower: Vector
    upper: Vector

    def holds(self, truth: Vector) -> NDArray[np.bool_]:
        """Whether each value of `truth` lies within the band."""
        return np.asarray((self.lower <= truth) & (truth <= self.upper))


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class ResponseSpectrum(Result):
    """Spectra of a scene with their errors.

    Parameters
    ----------
    frequency_hz
        (F,) bins, from the lowest that is resolved; a curve may have fewer.
    curves
        By owner (a coordinate, the gap of a pair of two coordinates) and quantity (`UNITS`).
    method, segment, step
        "welch" or "multitaper"; seconds of a segment and of a sampling interval.
    bandwidth
        Narrowest half-power bandwidth expected, Hz, by which the segment was chosen.
    degrees_of_freedom
        Degrees of freedom of a chi-square distribution with the scatter of the paths; median over
        the bins of the first displacement.
    meanings
        The meaning of each quantity in this scene, in words, or why it is left out.

    See Also
    --------
    stochvi.spectrum : The calculation.
    """

    not_in_document = ("frequency_hz",)  # it is in every curve

    frequency_hz: Vector
    curves: Mapping[str, Mapping[str, Curve]]
    method: str
    segment: float
    step: float
    bandwidth: float
    degrees_of_freedom: float
    meanings: Mapping[str, str]
    assumptions: Sequence[str] = ()

    @property
    def relative_error(self) -> float:
        """Median relative standard error of the displacement spectra."""
        return max(
            float(np.median(curves["displacement"].standard_error / curves["displacement"].value))
            for curves in self.curves.values()
        )

    def to_frame(self) -> DataFrame:
        """A tidy table: one row per owner, quantity and frequency."""
        return stacked(
            {"of": owner, "quantity": name, **vars(curve), "unit": in_angles(owner, UNITS[name])}
            for owner, curves in self.curves.items()
            for name, curve in curves.items()
        )

    def peaks(self) -> DataFrame:
        """A short table for reading: the largest value of each density, with its frequency and
        band, in the units that are shown."""
        rows = []
        for owner, curves in self.curves.items():
            for name, curve in curves.items():
                k = int(np.argmax(curve.value))
                rows.append(
                    {
                        "of": owner,
                        "quantity": name.replace("_", " "),
                        "frequency (Hz)": curve.frequency_hz[k],
                        "value": curve.value[k],
                        "95 % from": curve.lower[k],
                        "to": curve.upper[k],
                        "unit": in_angles(owner, UNITS[name]),
                    }
                )
        return in_chosen_units(frame_of(rows))

    def _shown(self) -> DataFrame:
        return self.peaks()

    def _document(self) -> dict[str, Any]:
        found = super()._document()
        spectra = {
            owner: {
                name: {"unit": in_angles(owner, UNITS[name]), **vars(curve)}
                for name, curve in curves.items()
            }
            for owner, curves in found.pop("curves").items()
        }
        return found | {"method": f"spectrum:{self.method}", "spectra": spectra}

    def summary(self) -> str:
        """How the spectra were estimated, in a sentence."""
        shown = next(iter(self.curves.values()))["displacement"]
        peak, last = (float((shown.bias / shown.value)[k]) for k in (np.argmax(shown.value), -1))
        return (
            f"{self.method}, segments of {self.segment:.4g} s ({self.segment * self.bandwidth:.3g} "
            f"half-power bandwidths of {self.bandwidth:.3g} Hz), {self.cost.paths} paths: standard "
            f"error {100.0 * self.relative_error:.2g} %, bias {100.0 * peak:.2g} % at the "
            f"peak, {100.0 * last:.2g} % at the highest frequency"
        )


# ------------------------------------------------------------------------------
# Spectra of the stationary response by Monte Carlo, each with its band, bias and resolution.
#
# Densities are one-sided per hertz. Records are made a block of paths at a time, cut into segments,
# tapered, transformed, averaged and let go; what is kept are the means over paths of all products
# X_i* X_j and their scatter, from which everything else follows at each frequency:
#
#     velocity       G_v = w^2 G_x                       acceleration  A = -M^-1 (K + i w C) X - F /
#     M
#     transmissibility |G_fa| / G_ff (H1), (G_aa / G_ff)^(1/2)     coherence  |G_fa|^2 / (G_ff G_aa)
#
# Standard errors come from independent paths. Two biases are stated beside them. The taper W smears
# a spectrum, G * |W|^2. The size of this bias follows from the estimate smeared once more and
# smeared twice more: most of the noise is averaged out in their difference. And white noise acts in
# kicks a step h apart, sampled with the response. The tail 1/w^2 of an impulse becomes h^2 / (4
# sin^2 (w h / 2)) with all its aliases. The density is then off by (w h)^2 / 6, relative and to
# leading order.
# ------------------------------------------------------------------------------


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
            f"a path needs {duration / step:.2g} samples, at most {MOST_SAMPLES} are made; "
            "give a lower highest frequency (highest) or a shorter segment",
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


__all__ = ["Curve", "ResponseSpectrum", "spectrum"]
