"""Whether a measured record moves a structure as Gaussian noise of its spectrum would. Chapters:
motion of gaps under a record without impacts; the verdict."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import scipy

from stochvi.mathematics.numerics import Matrix, Vector, Waves
from stochvi.mathematics.spectra import Force, InputMatrix
from stochvi.mathematics.units import LENGTH
from stochvi.model.coverage import nonlinear
from stochvi.model.model import Model, model_of
from stochvi.results.base import plain
from stochvi.scenes.excitations import RecordedNoise
from stochvi.scenes.records import cut_off
from stochvi.scenes.scene import Scene
from stochvi.scenes.structures.rigid_body import MOTIONS, RigidBody

if TYPE_CHECKING:
    from stochvi.methods.replay.recorded_motion import RecordOnStructure

# ------------------------------------------------------------------------------
# The motion of gaps of a linear structure under measured records, where nothing is hit.
#
# A structure q'' + B q' + K q = f has 2 n poles l_j, one or two for each mode, and
#
#     gap = sum_j c_j z_j,    z_j' = l_j z_j + e_j . f.
#
# Every z_j is moved in exact steps. Forces are linear between their samples.
# ------------------------------------------------------------------------------


LARGEST_ANGLE = 0.1
"""Fastest natural frequency times the longest step of a response, rad: the cubics between its
samples are off by less than this to the power 4 over 384, 3e-7 of the response."""

MOST_STEPS = 2**24
"""Largest number of steps of all modes. Where the angle would take more, steps are longer, of many
samples as long as their distance: of the fastest modes the cubics then miss more."""

CONDITION, SPLIT = 1e8, 1e-9
"""Condition number of the poles' shapes above which poles count as equal, as those of a critically
damped mode; and the share by which stiffnesses are then raised, so that poles lie apart. Motions
change by about this share."""

SHORT, TERMS = 0.5, 16
"""Size of a pole times a step up to which a series serves, and number of its terms."""


class FreeResponse(NamedTuple):
    """Displacement of a gap from its mean where nothing is hit (m): at the samples, and the
    extremes, between samples too."""

    displacement: Vector
    highest: float
    lowest: float


@dataclass(frozen=True, eq=False)
class GapPoles:
    """The poles of a structure, and how forces move its gaps.

    Parameters
    ----------
    poles
        (2 n,), 1/s.
    shapes
        (gaps, 2 n): c_j of each gap.
    entries
        (2 n, n): e_j, for forces on the coordinates.
    naturals, widths
        (n,): natural frequencies, and half-power bandwidths of the modes, rad/s; a bandwidth is at
        most the natural frequency.
    """

    poles: Waves
    shapes: Waves
    entries: Waves
    naturals: Vector
    widths: Vector

    @classmethod
    def of(cls, model: Model, directions: Matrix, least_damping: float = 0.0) -> GapPoles:
        """Those of a model for gaps along `directions` (gaps, n). With a `least_damping` ratio its
        modes are damped at least so, each alone.

        Raises
        ------
        numpy.linalg.LinAlgError
            If the shapes of the poles cannot be found.
        """
        modes = model.modal
        n, naturals, damping = modes.size, np.sqrt(modes.squares), modes.damping
        if least_damping:
            damping = np.diag(np.maximum(np.diag(damping), 2.0 * least_damping * naturals))
        poles, shapes = _eigen(modes.squares, damping, 1.0)
        if np.linalg.cond(shapes) > CONDITION:
            poles, shapes = _eigen(modes.squares, damping, 1.0 + SPLIT)
        pushed = np.linalg.inv(shapes)[:, n:]
        return cls(
            poles=poles,
            shapes=(directions @ modes.shapes) @ shapes[:n],
            entries=pushed @ modes.shapes.T,
            naturals=naturals,
            widths=np.minimum(np.diag(damping), naturals),
        )

    @property
    def settles(self) -> bool:
        """Whether springs and dampers hold the structure, so that every motion dies out."""
        return bool(np.all(self.poles.real < 0.0))

    def gain(self, frequency_hz: Vector, force: Force, gap: int) -> Waves:
        """Frequency response (frequencies,) of one gap to a force (n,) per unit of its source.

        It is the sum of c_j e_j / (i w - p_j). Far above the slowest pole its terms cancel, as an
        impulse moves nothing at once: the sum of all c_j e_j is 0. Less that sum over i w the terms
        are c_j e_j p_j / (i w (i w - p_j)), which do not.
        """
        pushed = force(frequency_hz) if isinstance(force, InputMatrix) else force[None]
        turning = 2j * math.pi * frequency_hz
        above = np.abs(turning) > np.min(np.abs(self.poles))
        found = np.zeros(len(frequency_hz), complex)
        for pole, shape, entry in zip(self.poles, self.shapes[gap], self.entries, strict=True):
            less = np.where(above, pole / np.where(above, turning, 1.0), 1.0)
            found += shape * (pushed @ entry) * less / (turning - pole)
        return found

    def response(self, forces: Matrix, step: float) -> list[FreeResponse]:
        """The motion of every gap from rest under forces (samples, n), N, `step` seconds apart.

        Between samples of a gap and its rate lie cubics. `replay` without stops is the same by
        another method, whose kernel has to be compiled first.
        """
        last = len(forces) - 1
        parts = math.ceil(self.naturals.max() * step / LARGEST_ANGLE)
        parts = max(min(parts, MOST_STEPS // (len(forces) * len(self.naturals))), 1)
        at = np.arange(parts * last + 1) / parts
        x, v = np.zeros((2, len(self.shapes), len(at)))
        for pole, shape, entry in zip(self.poles, self.shapes.T, self.entries, strict=True):
            if pole.imag < 0.0:
                continue
            pushed = forces @ entry
            fine = np.interp(at, np.arange(last + 1), pushed)
            z = _moved(pole, fine, step / parts)
            # the conjugate pole adds the conjugate motion
            weight = shape * (2.0 if pole.imag > 0.0 else 1.0)
            x += np.outer(weight.real, z.real) - np.outer(weight.imag, z.imag)
            weight = weight * pole
            v += np.outer(weight.real, z.real) - np.outer(weight.imag, z.imag)
        found = []
        for place, speed in zip(x, v, strict=True):
            reached = np.concatenate([place, _turning_points(place, speed, step / parts)])
            found.append(FreeResponse(place[::parts], float(reached.max()), float(reached.min())))
        return found


def _eigen(squares: Vector, damping: Matrix, stiffer: float) -> tuple[Waves, Waves]:
    """Poles, and their shapes as displacements and velocities (2 n, poles)."""
    n = len(damping)
    generator = np.block([[np.zeros((n, n)), np.eye(n)], [-stiffer * np.diag(squares), -damping]])
    poles, shapes = np.linalg.eig(generator)
    return poles.astype(complex), shapes.astype(complex)


def _moved(pole: complex, push: Waves, step: float) -> Waves:
    """z of z' = pole z + push from rest, the push linear between its samples."""
    early, late = _weights(pole * step)
    driven = np.zeros(len(push), complex)
    driven[1:] = step * ((early - late) * push[:-1] + late * push[1:])
    # a triangular band is solved from its first row on; a filter of scipy.signal would do the same,
    # but takes half a second to import
    band = np.ones((2, len(push)), complex)
    band[1] = -np.exp(pole * step)
    return np.asarray(scipy.linalg.lapack.ztbtrs(band, driven[:, None], uplo="L")[0][:, 0])


def _weights(turned: complex) -> tuple[complex, complex]:
    """phi_1 and phi_2 of a pole times a step: int_0^1 exp(p (1 - s)) ds, and the same times s.

    >>> early, late = _weights(0.0)
    >>> early.real, late.real
    (1.0, 0.5)
    """
    if abs(turned) > SHORT:
        early = (np.exp(turned) - 1.0) / turned
        return early, (early - 1.0) / turned
    early = sum(turned**k / math.factorial(k + 1) for k in range(TERMS))
    return complex(early), complex(sum(turned**k / math.factorial(k + 2) for k in range(TERMS)))


def _turning_points(x: Vector, v: Vector, h: float) -> Vector:
    """Extremes, between samples, of the cubics through x and x'."""
    turning = np.flatnonzero(v[:-1] * v[1:] < 0.0)
    x0, x1, v0, v1 = x[turning], x[turning + 1], h * v[turning], h * v[turning + 1]
    # x0 + v0 t + p t^2 + q t^3 for t from 0 to 1
    p, q = 3.0 * (x1 - x0) - 2.0 * v0 - v1, 2.0 * (x0 - x1) + v0 + v1
    # the root of v0 + 2 p t + 3 q t^2 between ends of different signs, without cancellation
    root = np.sqrt(np.maximum(p**2 - 3.0 * q * v0, 0.0))
    t = v0 / (-p + np.sign(v0) * root)
    return np.asarray(x0 + t * (v0 + t * (p + t * q)))


# ------------------------------------------------------------------------------
# Whether a measured record moves a structure as Gaussian noise of the same spectrum would.
# ------------------------------------------------------------------------------


FALSE_ALARMS = 0.005
"""Probability that the tests together, by Bonferroni's rule, contradict a Gaussian record: half of
the 1 % that is promised, because the distributions of their statistics are approximate."""

BLOCK_MEMORIES = 16.0
"""Length of the blocks whose mean squares are tested for a change of level, in int rho^2 dtau:
neighbouring ones are then nearly independent."""

FEWEST_BLOCKS = 16
"""Smallest number of blocks from which a change of level is judged: fewer cannot contradict a
steady one, because their cumulative sum has no room to."""

WELL_DAMPED = 0.7
"""Damping ratio of the modes of a second structure in which shocks are looked for. Its resonance
hides them less: noise moves it less, and a shock nearly as far. It has the natural frequencies of
the first, so that peaks too fast to move a mount are not felt there either."""

STEADY = 1.05
"""Ratio of two standard deviations within a record up to which its level counts as steady: a
clearance follows it in proportion."""

FEWEST = 20.0
"""Smallest number of independent values of the fourth power of the response from which its kurtosis
is judged: the distribution of Anscombe and Glynn (1983) holds from about there on."""

BEYOND = 1.0 + 1e-6
"""Clearance that a record needs over the largest distance that it reaches: the excess covers what
the cubics between samples may miss."""

LEVELS = (2.0, 3.0, 4.0)
"""Levels whose crossings are counted, in standard deviations of the response."""

POINTS_IN_BANDWIDTH = 16
"""Frequencies in the narrowest half-power bandwidth on which a response density is summed."""

BAND, OUTSIDE = 8.0, 1e-3
"""Highest frequency of that density, in natural frequencies: above it lies less than the second
number, a share, of the mean square displacement of a mount on a flat input. Where the record has
higher frequencies, the density is summed up to a frequency above which no more than that share
lies."""

MOST_POINTS = 2**20
"""Largest number of these frequencies."""

FASTER, START_LEFT = 1.5, 0.05
"""Ratio of the rate of mean crossings to the natural frequency above which the start from rest
moves the mount more than the stationary motion. The start is left out of the judgement until it has
died out to `START_LEFT` times the stationary motion."""


@dataclass(frozen=True, kw_only=True)
class Crossings:
    """Number of times that the response left the band of +-`level` (m), as seen and as expected by
    Rice."""

    level: float
    in_sigma: float
    seen: int
    expected: float


@dataclass(frozen=True, kw_only=True)
class RecordVerdict:
    """The response of a gap without stops to the record, against a Gaussian process of its
    spectrum.

    Parameters
    ----------
    contradicts
        Whether the record is not what a Gaussian process would show in its time.
    judged
        Whether peak and kurtosis could be tested; a record that is too short for one of them is not
        said to agree, but may contradict. A change of level needs a longer record.
    reasons
        What contradicts, a sentence each.
    displacement_max
        Largest distance from the static equilibrium, m.
    displacement_std
        Standard deviation of the response to the record, m.
    peak_in_sigma, expected_peak_in_sigma
        The largest distance over the standard deviation, and the median of it for a Gaussian
        process (Vanmarcke 1975); without the start, where that is left out.
    kurtosis, kurtosis_error
        Kurtosis of the response, and the standard error that it would have for a Gaussian process;
        without the start where that is left out.
    clearance
        The smallest distance of stops from the static equilibrium that the record does not reach,
        m, on the sides on which the scene has stops.
    clearance_lower, clearance_upper
        The same for each side alone; None where the scene has a stop on the other side only.
    p_values
        Probability that a stationary Gaussian process deviates as far, to either side, in its
        "peak", in its "kurtosis" and in its "level". "damped peak" and "damped kurtosis" are those
        of a structure whose modes are well damped. None where the record is too short to tell.
    level_ratio
        Standard deviation of the response after the moment of the largest change of its level, over
        that before it; None where the record is too short to tell.
    crossings
        Crossings of levels.
    clipped
        Whether the record is cut off at its largest or smallest value, as by a logger.
    lost_share
        Mean square displacement below the first line of the density over that of the density; 0
        where it is too small to matter.
    gap
        The pair whose gap is judged, or the coordinate where a structure has no pairs: the one that
        is least like a Gaussian process; None for one mass.
    others
        The verdicts on the other gaps of a structure, by their names.
    """

    contradicts: bool
    judged: bool
    reasons: tuple[str, ...]
    displacement_max: float
    displacement_std: float
    peak_in_sigma: float
    expected_peak_in_sigma: float
    kurtosis: float
    kurtosis_error: float
    clearance: float
    clearance_lower: float | None
    clearance_upper: float | None
    p_values: dict[str, float | None]
    level_ratio: float | None
    crossings: tuple[Crossings, ...]
    clipped: bool
    lost_share: float
    gap: str | None = None
    others: Mapping[str, RecordVerdict] = field(default_factory=dict)

    @property
    def agrees(self) -> bool:
        """Whether the record was judged, and nothing contradicts the Gaussian model."""
        return self.judged and not self.contradicts

    @property
    def gaps(self) -> tuple[RecordVerdict, ...]:
        """The verdicts on all gaps, this one first."""
        return (self, *self.others.values())

    def to_dict(self) -> dict[str, Any]:
        """The JSON document."""
        return {name: plain(getattr(self, name)) for name in self.__dataclass_fields__}

    @property
    def needed(self) -> str:
        """The clearance that the record itself needs, rounded up to a micrometre: the one number
        that words, pages and pictures state."""
        return _needed(self.clearance)

    @property
    def needed_by_side(self) -> str:
        """The clearances that the record needs below and above the static equilibrium, in words."""
        if self.clearance_lower is None or self.clearance_upper is None:
            return f"{self.needed} to its stop"
        below, above = map(_needed, (self.clearance_lower, self.clearance_upper))
        return f"{below} on each side" if below == above else f"{below} below and {above} above"

    def needs(self) -> str:
        """The clearance that the record itself needs, in words; that of each gap of a
        structure."""
        if self.gap is None:
            return f"the record itself needs {self.needed_by_side}"
        gaps = {self.gap: self, **self.others}
        places = ", ".join(f"{each.needed} at {name}" for name, each in gaps.items())
        return f"the record itself needs {places}, on each side"

    def headline(self, what: str = "this record") -> str:
        """The verdict in a few words on `what` is judged."""
        if self.contradicts:
            return f"{what} is not Gaussian noise"
        noise = "Gaussian noise of its spectrum"
        return f"{what} agrees with {noise}" if self.judged else f"{what} is too short to be judged"

    def agreement(self, what: str = "this record") -> str:
        """That `what` is judged agrees with Gaussian noise, and the largest clearance it needs."""
        most = max(self.gaps, key=lambda each: each.clearance)
        where = f" at {most.gap}" if most.gap else ""
        return f"{self.headline(what)}; the record itself needs {most.needed}{where}"

    def reason(self) -> str:
        """What contradicts Gaussian noise first, without its statistics; or why the record is too
        short to be judged."""
        if self.contradicts:
            return re.sub(r" \([^()]*\)", "", self.reasons[0])
        why = f"the kurtosis of the response is only known to ± {self.kurtosis_error:.2g}"
        if self.p_values["peak"] is None:
            why = (
                "the motion with which the mount starts from rest takes more than half of it to "
                "die out"
            )
        return f"{why}; take a longer record"

    def sentence(self) -> str:
        """The verdict in one sentence, with its numbers."""
        why = f"; {self.reason()}"
        if self.contradicts:
            why = f": {'; '.join(self.reasons)}"
        elif self.judged:
            why = (
                f": through the mount it moves {self.peak_in_sigma:.3g} sigma (expected "
                f"{self.expected_peak_in_sigma:.3g}) with a kurtosis of {self.kurtosis:.3g} "
                f"(3 ± {self.kurtosis_error:.2g})"
            )
        return f"{self.headline()}{why}; {self.needs()}"


def most_alarming(verdicts: Mapping[str, RecordVerdict]) -> str | None:
    """The name of the verdict of several that a reader must know first: one that contradicts, then
    one that was not judged, then the one that needs most; None without any."""

    def alarm(name: str) -> tuple[bool, bool, float]:
        found = verdicts[name]
        return found.contradicts, not found.agrees, max(each.clearance for each in found.gaps)

    return max(verdicts, key=alarm, default=None)


def judged_phase(scene: Scene) -> tuple[RecordVerdict | None, str]:
    """The verdict on the records of a scene, or of the phase whose records must be known first, and
    the name of this phase."""
    phases = {each.name: each.of(scene) for each in scene.phases} or {"": scene}
    verdicts = {
        name: verdict
        for name, each in phases.items()
        if (verdict := record_verdict(each)) is not None
    }
    where = most_alarming(verdicts)
    return (None, "") if where is None else (verdicts[where], where)


def record_verdict(scene: Scene) -> RecordVerdict | None:
    """Judge the records of a scene; None where there are none, or springs and dampers do not hold a
    linear structure.

    Exact steps give the response of every gap to the records without stops. It is compared with a
    Gaussian process of the same spectrum. The same is done with the damping ratio `WELL_DAMPED`,
    where shocks stand out. Other excitations are left out. The tests on all gaps share the
    probability `FALSE_ALARMS`. The largest distance from rest is held against Vanmarcke's
    distribution of first crossings (1975). The kurtosis is held against the distribution of
    Anscombe and Glynn (1983), for as many independent values as give it the variance
    24 int rho^4 dtau / T. `change_of_level` finds changes of the level. A record that is
    cut off contradicts as well, and so does one whose slow motion is absent from its density.
    Several records contradict where together they move a gap more than independent noises would.

    Examples
    --------
    >>> from stochvi import Isolator, WhiteNoise
    >>> noise = WhiteNoise(density=0.01, unit="g2/Hz")
    >>> scene = Scene(structure=Isolator(frequency_hz=10.0, zeta=0.1), excitations=[noise])
    >>> record_verdict(scene) is None
    True
    """
    if not any(isinstance(each, RecordedNoise) for each in scene.excitations):
        return None
    from stochvi.methods.replay.recorded_motion import records_of

    model = model_of(scene)
    if nonlinear(model) or not np.all(model.modal.squares > 0.0):
        return None
    gaps = _gaps_of(scene, model)
    directions = np.array([each.direction for each in gaps])
    poles = GapPoles.of(model, directions)
    if not poles.settles:
        return None
    damped = GapPoles.of(model, directions, WELL_DAMPED)
    together: dict[object, list[RecordOnStructure]] = {}
    for each in records_of(scene, model):
        if each.noise.kurtosis is not None:
            continue  # noise that is not Gaussian stands for it
        together.setdefault(each.noise.record.sampling, []).append(each)
    found = [
        verdict
        for records in together.values()
        for verdict in _verdicts(model, gaps, poles, damped, records)
    ]
    return _least_gaussian(found) if found else None


class _Gap(NamedTuple):
    """A gap whose motion is judged: its name, None for one mass; its combination of coordinates;
    the sides on which it has stops; and its name in a sentence."""

    name: str | None
    direction: Vector
    sides: frozenset[int]
    words: str = ""


def _gaps_of(scene: Scene, model: Model) -> list[_Gap]:
    """The gaps of the pairs, or the coordinates and points that are lengths where there are no
    pairs; for one mass its displacement."""
    both = frozenset({-1, 1})
    if len(model.coordinates) == 1 and len(model.pairs) < 2:
        return [_Gap(None, np.ones(1), frozenset(int(stop.side) for stop in model.stops) or both)]
    if model.pairs:
        return [
            _Gap(
                pair.name,
                pair.direction,
                frozenset(int(stop.side) for stop in pair.stops),
                f"the gap of {pair.name}",
            )
            for pair in model.pairs
        ]
    turning = tuple(MOTIONS)[3:] if isinstance(scene.structure, RigidBody) else ()
    rows = zip(model.outputs, model.output_rows, strict=True)
    return [_Gap(name, row, both, name) for name, row in rows if name not in turning]


STILL = 1e-9
"""Displacement of a gap, relative to the largest, below which its motion is a rounding error."""


def _verdicts(
    model: Model, gaps: Sequence[_Gap], poles: GapPoles, damped: GapPoles,
    records: Sequence[RecordOnStructure],
) -> list[RecordVerdict]:  # fmt: skip
    """The verdicts on the gaps that records of one sampling move; `damped` are the poles of the
    structure with more damping."""
    together, calmer = (_motions(model, each, records) for each in (poles, damped))
    reached = [max(max(each.highest, -each.lowest) for each in own) for own in together]
    moved = [number for number, each in enumerate(reached) if each > STILL * max(reached)]
    clipped = any(cut_off(each.noise.as_read.values) for each in records)
    lost = _lost(model, records)
    alone = [_motions(model, poles, [each]) for each in records] if len(records) > 1 else []
    rate = records[0].noise.record.fs
    found = []
    for number in moved:
        law, calm = (_law_of(each, number, records, poles.widths) for each in (poles, damped))
        motion = JudgedMotion.of(together[number], rate, law, poles)
        shocks = _Shape.of(JudgedMotion.of(calmer[number], rate, calm, damped), calm)
        apart = sum(JudgedMotion.of(each[number], rate, law, poles).x.var() for each in alone)
        verdict = _verdict(
            motion, gaps[number], law, shocks, clipped=clipped, lost=lost,
            tests=len(TESTS) * len(moved), apart=math.sqrt(apart),
        )  # fmt: skip
        found.append(verdict)
    return found


def _motions(
    model: Model, poles: GapPoles, records: Sequence[RecordOnStructure]
) -> list[tuple[FreeResponse, ...]]:
    """The motion of every gap in all segments of the records."""
    from stochvi.methods.replay.recorded_motion import shaking_of

    segments = [poles.response(each.forces, each.step) for each in shaking_of(records, model)]
    return list(zip(*segments, strict=True))


def _lost(model: Model, records: Sequence[RecordOnStructure]) -> list[tuple[float, str]]:
    """What the densities of the records leave out of the slowest mode, see `lost_below`."""
    slowest = int(np.argmin(model.modal.squares))
    omega = math.sqrt(float(model.modal.squares[slowest]))
    rate = float(model.modal.damping[slowest, slowest])
    alone = len(model.coordinates) == 1
    found = (each.noise.lost_below(omega, rate, alone=alone) for each in records)
    return [each for each in found if each is not None]


def _law_of(
    poles: GapPoles, gap: int, records: Sequence[RecordOnStructure], bandwidths: Vector
) -> ResponseLaw:
    """The law of one gap under independent noises of the densities of the records, summed in steps
    for modes of these bandwidths (rad/s)."""

    def density(f: Vector) -> Vector:
        total = np.zeros(len(f))
        for each in records:
            total += each.table(f) * np.abs(poles.gain(f, each.direction, gap)) ** 2
        return total

    top = max(float(each.table.frequency_hz[-1]) for each in records)
    hertz, widths = poles.naturals / (2.0 * math.pi), bandwidths / (2.0 * math.pi)
    within = widths[hertz <= top]
    return response_law(
        density, top=top, natural=float(hertz.min()),
        width=float(np.min(within if len(within) else widths)),
    )  # fmt: skip


def _least_gaussian(found: Sequence[RecordVerdict]) -> RecordVerdict:
    """The verdict that contradicts most, or is least sure, with those on the other gaps."""

    def order(each: RecordVerdict) -> tuple[bool, bool, float]:
        return each.contradicts, not each.judged, each.peak_in_sigma / each.expected_peak_in_sigma

    worst = max(found, key=order)
    others = {str(each.gap): each for each in found if each is not worst}
    return replace(worst, others=others)


@dataclass(frozen=True, kw_only=True)
class ResponseLaw:
    """The numbers of a response density on which the statistics of a Gaussian process depend.

    Parameters
    ----------
    crossing_rate
        Up-crossings of the mean per second.
    bandwidth
        Vanmarcke's q = sqrt(1 - m1^2 / (m0 m2)), m the moments of the density.
    memory, memory_of_squares
        int rho^4 dtau and int rho^2 dtau over all lags, s.
    """

    crossing_rate: float
    bandwidth: float
    memory: float
    memory_of_squares: float


def response_law(
    density_at: Callable[[Any], Vector], *, top: float, natural: float, width: float
) -> ResponseLaw:
    """The law of a motion from its one-sided density at frequencies up to `top` (Hz). The lowest
    natural frequency is `natural`, and the narrowest resonance `width` wide (Hz)."""
    natural, width = min(natural, top), min(width, top)  # a stiffer mount follows its base
    step = width / POINTS_IN_BANDWIDTH
    coarse = np.geomspace(0.1 * min(natural, top), top, 2000)
    below = np.cumsum(coarse * density_at(coarse))
    reached = float(coarse[np.searchsorted(below, (1.0 - OUTSIDE) * below[-1])])
    highest = max(BAND * natural, min(top, 1.01 * reached))
    step = max(step, highest / MOST_POINTS)
    f = step * np.arange(1, math.ceil(highest / step))
    density = density_at(f)
    zero, one, two = (float(np.sum(density * f**power)) for power in range(3))
    # density and its convolution with itself: int rho^4 dtau = sum of |F(rho^2)|^2, by Parseval
    rho = np.fft.irfft(np.concatenate([[0.0], density, np.zeros(len(density) + 1)]))
    rho /= rho[0]
    lag = 1.0 / (step * len(rho))
    return ResponseLaw(
        crossing_rate=math.sqrt(two / zero),
        bandwidth=math.sqrt(max(1.0 - one**2 / (zero * two), 1e-12)),
        memory=float(np.sum(rho**4) * lag),
        memory_of_squares=float(np.sum(rho**2) * lag),
    )


def settling_time(law: ResponseLaw, poles: GapPoles) -> float:
    """Seconds after which the motion with which a structure starts from rest no longer counts; 0
    where it never exceeds the stationary motion (see `FASTER`)."""
    faster = 2.0 * math.pi * law.crossing_rate / float(poles.naturals.min())
    if faster <= FASTER:
        return 0.0
    return math.log(faster / START_LEFT) / float(np.min(-poles.poles.real))


def peak_probability(largest: float, duration: float, law: ResponseLaw) -> float:
    """P(the largest |x| of a Gaussian process is below `largest` standard deviations), by the rate
    of first crossings of E. H. Vanmarcke, J. Appl. Mech. 42 (1975) 215, exponent 1.2."""
    if largest <= 0.0:
        return 0.0
    gauss = math.exp(-0.5 * largest**2)
    clumps = -math.expm1(-math.sqrt(math.pi / 2.0) * law.bandwidth**1.2 * largest)
    rate = 2.0 * law.crossing_rate * gauss * clumps / -math.expm1(-0.5 * largest**2)
    return -math.expm1(-0.5 * largest**2) * math.exp(-rate * duration)


def kurtosis_p_value(kurtosis: float, number: float) -> float | None:
    """Probability of a sample kurtosis as far off from that of `number` independent Gaussian
    values, on either side (F. J. Anscombe, W. J. Glynn, Biometrika 70 (1983) 227); None for few
    values."""
    n = number
    if n < FEWEST:
        return None
    mean = 3.0 * (n - 1.0) / (n + 1.0)
    variance = 24.0 * n * (n - 2.0) * (n - 3.0) / ((n + 1.0) ** 2 * (n + 3.0) * (n + 5.0))
    x = (kurtosis - mean) / math.sqrt(variance)
    skew = 6.0 * (n * n - 5.0 * n + 2.0) / ((n + 7.0) * (n + 9.0))
    skew *= math.sqrt(6.0 * (n + 3.0) * (n + 5.0) / (n * (n - 2.0) * (n - 3.0)))
    a = 6.0 + 8.0 / skew * (2.0 / skew + math.sqrt(1.0 + 4.0 / skew**2))
    below = 1.0 + x * math.sqrt(2.0 / (a - 4.0))
    if below <= 0.0:
        return 0.0
    z = (1.0 - 2.0 / (9.0 * a) - ((1.0 - 2.0 / a) / below) ** (1.0 / 3.0)) / math.sqrt(
        2.0 / (9.0 * a)
    )
    return math.erfc(abs(z) / math.sqrt(2.0))


class LevelChange(NamedTuple):
    """The largest change of the level of a response: the share of its time before the change, and
    the standard deviation after it over that before it. `p_value` is the probability of so large a
    change under a steady level.
    """

    share: float
    ratio: float
    p_value: float


def change_of_level(x: Vector, duration: float, law: ResponseLaw) -> LevelChange | None:
    """The largest change of the level of a response x about its mean; None in a short record.

    The logarithms of mean squares of blocks deviate from their mean. The cumulative sum of these
    deviations is a Brownian bridge if the level is steady (W. Ploberger and W. Kraemer,
    Econometrica 60 (1992) 271). That holds for any distribution of the blocks, so a record that is
    steady but not Gaussian is not accused of a change.

    Examples
    --------
    >>> noise = np.random.default_rng(1).normal(size=20_000)
    >>> law = ResponseLaw(crossing_rate=1.0, bandwidth=1.0, memory=1e-3, memory_of_squares=1e-3)
    >>> found = change_of_level(noise * np.repeat([1.0, 1.5], 10_000), 20.0, law)
    >>> found is not None and (round(found.share, 1), round(found.ratio, 1), found.p_value < 1e-9)
    (0.5, 1.5, True)
    """
    count = int(duration / (BLOCK_MEMORIES * law.memory_of_squares))
    if count < FEWEST_BLOCKS:
        return None
    # half a second to import, which only a record costs
    from statsmodels.stats.diagnostic import breaks_cusumolsresid

    squares = np.array([np.mean(block**2) for block in np.array_split(x, count)])
    levels = np.log(squares)
    off = levels - levels.mean()
    p_value = float(breaks_cusumolsresid(off, ddof=1)[1])
    before = 1 + int(np.argmax(np.abs(np.cumsum(off)[:-1])))
    ratio = math.sqrt(squares[before:].mean() / squares[:before].mean())
    return LevelChange(before / count, ratio, p_value)


def expected_peak(duration: float, law: ResponseLaw) -> float:
    """Median of the largest |x| of a Gaussian process, in standard deviations."""
    low, high = 0.0, 40.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        below = peak_probability(middle, duration, law) < 0.5
        low, high = (middle, high) if below else (low, middle)
    return low


class JudgedMotion(NamedTuple):
    """A response x (m, from rest) of a duration (s), whose largest distance is `settled`; `below`
    and `above` are the largest distances on either side, and `whole` the standard deviation, with
    the start. No test is made unless `judged`."""

    x: Vector
    duration: float
    below: float
    above: float
    whole: float
    settled: float
    judged: bool

    @classmethod
    def of(
        cls, segments: Sequence[FreeResponse], rate: float, law: ResponseLaw, poles: GapPoles
    ) -> JudgedMotion:
        """The motion of a gap in all segments of its records, sampled at a rate (Hz)."""
        start = math.ceil(rate * settling_time(law, poles))
        whole = np.concatenate([each.displacement for each in segments])
        settled = np.concatenate([each.displacement[start:] for each in segments])
        judged = 2 * len(settled) >= len(whole)
        x = settled if judged else whole
        above, below = max(each.highest for each in segments), -min(e.lowest for e in segments)
        far = float(np.max(np.abs(x))) if judged and start else max(above, below)
        return cls(x, len(x) / rate, below, above, float(whole.std()), far, judged)

    @property
    def largest(self) -> float:
        """The largest distance from rest, m."""
        return max(self.above, self.below)


TESTS = ("peak", "kurtosis", "level", "damped peak", "damped kurtosis")
"""Names of the tests of a motion."""


class _Shape(NamedTuple):
    """A motion about its mean: its standard deviation (m), and its largest distance in it with the
    median for a Gaussian process. Then its kurtosis with the standard error, and the p values of
    both; None where they cannot be tested."""

    sigma: float
    peak: float
    expected: float
    kurtosis: float
    error: float
    peak_p: float | None
    kurtosis_p: float | None

    @classmethod
    def of(cls, motion: JudgedMotion, law: ResponseLaw) -> _Shape:
        centred = motion.x - motion.x.mean()
        square = float(np.mean(centred**2))
        sigma, duration = math.sqrt(square), motion.duration
        peak, kurtosis = motion.settled / sigma, float(np.mean(centred**4)) / square**2
        below = peak_probability(peak, duration, law)
        tested = kurtosis_p_value(kurtosis, duration / law.memory) if motion.judged else None
        return cls(
            sigma, peak, expected_peak(duration, law), kurtosis,
            math.sqrt(24.0 * law.memory / duration),
            2.0 * min(below, 1.0 - below) if motion.judged else None, tested,
        )  # fmt: skip

    def told(self, limit: float, moves: str, of: str) -> list[str]:
        """What is less likely than a limit, a sentence each, of a gap in words."""
        found = []
        if self.peak_p is not None and self.peak_p < limit:
            found.append(
                f"{moves} {1e3 * self.peak * self.sigma:.4g} mm ({self.peak:.3g} sigma), where "
                f"Gaussian noise would move {1e3 * self.expected * self.sigma:.3g} mm "
                f"({self.expected:.3g} sigma; {p_value_in_words(self.peak_p)})"
            )
        if self.kurtosis_p is not None and self.kurtosis_p < limit:
            found.append(
                f"the kurtosis of {of} is {self.kurtosis:.3g}, where Gaussian noise would have "
                f"3 ± {self.error:.2g} ({p_value_in_words(self.kurtosis_p)})"
            )
        return found


def _verdict(
    motion: JudgedMotion, gap: _Gap, law: ResponseLaw, shocks: _Shape, *, clipped: bool,
    lost: Sequence[tuple[float, str]], tests: int, apart: float,
) -> RecordVerdict:  # fmt: skip
    """The verdict on a response, and on `shocks`, that of the well damped structure.

    `tests` share the probability of a false alarm. Where several records move the gap, it would
    have the standard deviation `apart` (m) if they were independent; else that is 0.
    """
    x, duration, judged = motion.x, motion.duration, motion.judged
    centred, shape = x - x.mean(), _Shape.of(motion, law)
    sigma = shape.sigma
    level = change_of_level(centred, duration, law) if judged else None
    found = shape.peak_p, shape.kurtosis_p, level and level.p_value
    p_values = dict(zip(TESTS, (*found, shocks.peak_p, shocks.kurtosis_p), strict=True))
    limit = FALSE_ALARMS / tests
    moves = "it moves" if gap.name is None else f"{gap.words} moves"
    through = "mount" if gap.name is None else "structure"
    of = "" if gap.name is None else f" of {gap.name}"
    reasons = [sentence for _, sentence in lost] if judged else []
    reasons += shape.told(limit, f"through the {through} {moves}", f"the response{of}")
    if level is not None and level.p_value < limit and not 1 / STEADY < level.ratio < STEADY:
        reasons.append(
            f"its level is not steady: after {level.share * duration:.3g} of {duration:.3g} s the "
            f"response{of} is {level.ratio:.3g} times what it was before "
            f"({p_value_in_words(level.p_value)})"
        )
    if apart and judged and _louder(sigma / apart, duration, law):
        reasons.append(
            f"the records together move{of or ' it'} {sigma / apart:.3g} times as far as "
            "independent ones would: state how they are correlated (cross_density)"
        )
    if clipped:
        reasons.append(
            "the record is cut off at its largest or smallest value, as by a logger at the end of "
            "its range: the motion under it is too small"
        )
    # what the motion itself shows is enough
    if judged and not reasons:
        calm = f"damped with {WELL_DAMPED:g}, where no resonance hides shocks"
        reasons += shocks.told(limit, f"{calm}, {moves}", f"the response{of} {calm},")
    lower = BEYOND * max(motion.below, 0.0) if -1 in gap.sides else None
    upper = BEYOND * max(motion.above, 0.0) if 1 in gap.sides else None
    return RecordVerdict(
        contradicts=bool(reasons),
        judged=shape.peak_p is not None and shape.kurtosis_p is not None,
        reasons=tuple(reasons),
        displacement_max=motion.largest,
        displacement_std=motion.whole,
        peak_in_sigma=shape.peak,
        expected_peak_in_sigma=shape.expected,
        kurtosis=shape.kurtosis,
        kurtosis_error=shape.error,
        clearance=max(lower or 0.0, upper or 0.0),
        clearance_lower=lower,
        clearance_upper=upper,
        p_values=p_values,
        level_ratio=level and level.ratio,
        crossings=tuple(_crossings(centred, sigma, level, duration, law) for level in LEVELS),
        clipped=clipped,
        lost_share=max((share for share, _ in lost), default=0.0),
        gap=gap.name,
    )


SEVERAL_ERRORS = 4.5
"""Standard errors by which several records must move a gap farther than independent ones."""


def _louder(ratio: float, duration: float, law: ResponseLaw) -> bool:
    """Whether a ratio of standard deviations is more than independent records have by chance.

    The covariance of two independent processes scatters by sqrt(int rho^2 dtau / T) of their
    variance. The standard deviation of their sum scatters by half as much.
    """
    error = 0.5 * math.sqrt(law.memory_of_squares / duration)
    return ratio - 1.0 > max(STEADY - 1.0, SEVERAL_ERRORS * error)


def _needed(clearance: float) -> str:
    """A clearance, rounded up to a micrometre."""
    return LENGTH.rounded_up(clearance, 1e-6)


def p_value_in_words(value: float) -> str:
    """A p value in words; one that no floating-point number resolves is below that resolution."""
    return f"p = {value:.1g}" if value > np.finfo(float).eps else "p below 1e-15"


def _crossings(
    x: Vector, sigma: float, in_sigma: float, duration: float, law: ResponseLaw
) -> Crossings:
    outside = np.abs(x) > in_sigma * sigma
    return Crossings(
        level=in_sigma * sigma,
        in_sigma=in_sigma,
        seen=int(np.sum(outside[1:] & ~outside[:-1])),
        expected=2.0 * law.crossing_rate * duration * math.exp(-0.5 * in_sigma**2),
    )
