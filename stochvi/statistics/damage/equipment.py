"""Equipment on a vibrating place. Chapters: oscillators of one quality Q over a band; the answer of
`damage`; response to a Gaussian acceleration; the largest response of a mission."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any, ClassVar, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray
from scipy.special import gamma

from stochvi.mathematics.numerics import Matrix, Vector, gauss_legendre, gauss_panels
from stochvi.mathematics.spectra import Filter, Force, InputMatrix, eigenvalues, gains
from stochvi.mathematics.units import ACCELERATION, STANDARD_GRAVITY, density_from_intensity
from stochvi.mathematics.unsteady_noise import RandomLevel
from stochvi.model.coverage import free_motion
from stochvi.model.model import Model
from stochvi.motion.kernels.crossings_and_cycles import (
    BEFORE,
    LANES,
    equipment_response,
)
from stochvi.motion.kernels.crossings_and_cycles import NODES as KERNEL_NODES
from stochvi.results.base import DataFrame, Result, frame_of
from stochvi.results.estimates import (
    GAUSSIAN_95,
    TOO_FEW,
    Estimate,
    combined,
    format_with_error,
    jackknife_error,
    reach,
)
from stochvi.sampling.calculations import check_flag
from stochvi.statistics.clusters import GROUPS

Records = NDArray[np.float64]

SAMPLES_PER_PERIOD = 8.0
"""Smallest number of samples in a period of the fastest equipment. Accelerations at that frequency
then lose 0.1 % between samples, and peaks 0.06 %."""

MEMORY = 8.0
"""Time after which equipment has forgotten its start, in time constants 2 Q / w: it is exp(-8) of
what it was."""

OVERSHOOT = 1.02
"""Bound on peaks between samples that are not those of the free motion."""

HOLD_NODES = 12
"""Gauss-Legendre nodes by which the response to a polynomial over one step is integrated."""


class EquipmentRecords(NamedTuple):
    """Responses of equipment on records of acceleration.

    Parameters
    ----------
    squares
        (paths, equipment): mean square of the absolute acceleration of the equipment, (m/s^2)^2.
    damage, closing, halving
        (paths, equipment): damage of each record, (m/s)^exponent, with half cycles where the record
        does not close them (ASTM E1049); what it has more if the record repeats itself; and what
        its two halves, each repeated, have more than the whole.
    peaks
        (paths, windows, equipment): largest absolute acceleration in each window, m/s^2.
    """

    squares: Matrix
    damage: Matrix
    closing: Matrix
    halving: Matrix
    peaks: Records


@dataclass(frozen=True)
class Equipment:
    """Oscillators on a place that moves, z'' + (w / Q) z' + w^2 z = -a.

    Their response is the absolute acceleration y = a + z''; their stress is proportional to the
    pseudo-velocity w z.

    Parameters
    ----------
    frequency_hz
        Natural frequencies, Hz.
    quality
        Q, above 0.5.
    exponent
        Exponent b of Miner's sum over rainflow cycles, D = sum S^b with the amplitude S of the
        pseudo-velocity, m/s.

    Examples
    --------
    >>> found = Equipment((50.0, 100.0), 10.0, 6.0)
    >>> round(found.memory, 3), round(found.longest_step, 6)
    (0.509, 0.00125)
    """

    frequency_hz: tuple[float, ...]
    quality: float
    exponent: float

    @cached_property
    def omega(self) -> Vector:
        """Natural frequencies, rad/s."""
        return 2.0 * math.pi * np.array(self.frequency_hz)

    @property
    def memory(self) -> float:
        """Time after which the slowest equipment has forgotten its start, s."""
        return MEMORY * 2.0 * self.quality / float(self.omega.min())

    @property
    def longest_step(self) -> float:
        """Longest sampling interval that resolves the fastest equipment, s."""
        return 1.0 / (SAMPLES_PER_PERIOD * max(self.frequency_hz))

    def passes(self, step: float) -> Matrix:
        """Coefficients of a step for `equipment_response`, (20, equipment), time in steps."""
        w, decay = self.omega * step, self.omega * step / (2.0 * self.quality)
        ringing = np.sqrt(w**2 - decay**2)

        def free(time: float) -> tuple[Vector, Vector, Vector, Vector]:
            fall, cosine, sine = (
                np.exp(-decay * time), np.cos(ringing * time), np.sin(ringing * time) / ringing,
            )  # fmt: skip
            return (
                fall * (cosine + decay * sine), fall * sine,
                -fall * w**2 * sine, fall * (cosine - decay * sine),
            )  # fmt: skip

        nodes, weights = gauss_legendre(HOLD_NODES)
        places = np.arange(KERNEL_NODES) - BEFORE
        pushed = np.zeros((2, KERNEL_NODES, len(w)))
        for node, weight in zip(0.5 + 0.5 * nodes, 0.5 * weights, strict=True):
            _, moved, _, turned = free(1.0 - node)
            for number, place in enumerate(places):
                others = np.delete(places, number)
                share = float(np.prod((node - others) / (place - others)))
                pushed[:, number] -= weight * share * np.stack([moved, turned])
        margin = OVERSHOOT / np.cos(np.minimum(0.5 * w, 1.0))
        scales = np.stack([2.0 * decay, w**2, margin, self.omega * step**2])
        return np.concatenate([np.stack(free(1.0)), *pushed, scales])

    def respond(
        self, accelerations: Matrix, step: float, first: int, window: int, windows: int = 1,
        jumps: Matrix | None = None,
    ) -> EquipmentRecords:  # fmt: skip
        """Responses to records of acceleration (paths, samples), m/s^2, that begin at rest.

        Parameters
        ----------
        step
            Sampling interval, s.
        first, window, windows
            The response is counted from the sample `first` on, over so many windows of so many
            samples.
        jumps
            (paths, samples): sudden changes of the velocity of the place at the samples, m/s.
        """
        paths, count = len(accelerations), len(self.frequency_hz)
        needed = first + window * windows + KERNEL_NODES - BEFORE - 1
        if first < BEFORE or accelerations.shape[1] < needed:
            raise AssertionError(f"{accelerations.shape[1]} samples, {needed} are needed")
        groups = -(-count // LANES)
        passes = np.pad(self.passes(step), ((0, 0), (0, groups * LANES - count)), mode="edge")
        changes = None if jumps is None else np.ascontiguousarray(jumps) / step
        found: list[tuple[Records, ...]] = []
        for group in np.split(passes, groups, axis=1):
            sums, peaks = np.zeros((4, paths, LANES)), np.zeros((paths, windows, LANES))
            equipment_response(
                np.ascontiguousarray(accelerations), changes, first, window,
                np.ascontiguousarray(group), self.exponent, *sums, peaks,
            )  # fmt: skip
            check_flag()
            found.append((sums[0] / (window * windows), *sums[1:], peaks))
        return EquipmentRecords(
            *(np.concatenate(part, axis=-1)[..., :count] for part in zip(*found, strict=True))
        )


# ------------------------------------------------------------------------------
# The answer of `damage`: what equipment at a place goes through, with its stops and without.
# ------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True, eq=False)
class SpectrumValues:
    """A quantity at many frequencies or points: value, standard error and bias, of one shape.

    See Also
    --------
    stochvi.Estimate : The same of one number.
    """

    value: Vector
    standard_error: Vector
    bias: Vector

    @classmethod
    def of(cls, value: Vector, error: Any = 0.0, bias: Any = 0.0) -> SpectrumValues:
        """Values with errors of their own, or of all alike, by default none."""
        errors = [np.broadcast_to(np.asarray(each, float), value.shape) for each in (error, bias)]
        return cls(value=value, standard_error=errors[0], bias=errors[1])

    def half_width_95(self) -> Vector:
        """Half the width of the 95 % intervals, as that of an `Estimate`; NaN where the value is
        not known."""
        rows = zip(self.standard_error.flat, self.bias.flat, strict=True)
        found = np.array([reach(GAUSSIAN_95, [error], [bias]) for error, bias in rows])
        return np.where(np.isnan(self.value), np.nan, found.reshape(self.value.shape))

    def at(self, place: Any) -> Estimate:
        """The value at a place."""
        value, error, bias = (
            float(each[place]) for each in (self.value, self.standard_error, self.bias)
        )
        return Estimate(value=value, standard_error=error, bias=bias)

    def estimates(self) -> list[Estimate]:
        """The values one by one."""
        return [self.at(place) for place in np.ndindex(self.value.shape)]


def ratio_of(above: SpectrumValues, below: SpectrumValues) -> SpectrumValues:
    """Ratio of two independent quantities."""
    value = above.value / below.value
    return combined(value, [1.0 / below.value, value / below.value], [above, below])


@dataclass(frozen=True, kw_only=True, eq=False)
class EquipmentSpectra:
    """Spectra over the frequencies of the equipment, F of them.

    Parameters
    ----------
    response_rms
        Rms absolute acceleration of the equipment, m/s^2.
    extreme_response
        Extreme response spectrum: expected largest absolute acceleration in the mission, m/s^2.
    extreme_lower, extreme_upper
        (F,): the largest of a mission lies between them in 95 of 100 missions, m/s^2.
    fatigue_damage
        Fatigue damage spectrum of the mission: Miner's sum of S^b over rainflow cycles, with the
        amplitude S of the pseudo-velocity, (m/s)^b.
    cumulative_rms
        Rms acceleration of the place below each frequency, m/s^2.

    See Also
    --------
    stochvi.damage : The calculation.
    """

    response_rms: SpectrumValues
    extreme_response: SpectrumValues
    extreme_lower: Vector
    extreme_upper: Vector
    fatigue_damage: SpectrumValues
    cumulative_rms: SpectrumValues

    def document(self) -> dict[str, Any]:
        """Lists by quantity, with those of its errors beside it."""
        found: dict[str, Any] = {}
        for each in fields(self):
            found |= lists_of(each.name, getattr(self, each.name))
        return found


def lists_of(name: str, quantity: Any) -> dict[str, Any]:
    """A quantity as a list of values under its name, and the lists of its errors."""
    if not isinstance(quantity, SpectrumValues):
        return {name: quantity}
    errors = {f"{name}_standard_error": quantity.standard_error, f"{name}_bias": quantity.bias}
    return {name: quantity.value} | errors


@dataclass(frozen=True, kw_only=True, eq=False)
class Shocks:
    """Shock spectra of impacts: largest absolute acceleration of the equipment around each.

    Parameters
    ----------
    typical, worst
        (F,): the median of windows in which an impact begins, and the level that one in a hundred
        of them exceeds, m/s^2.
    window, windows
        Length of a window, s, and number of windows with an impact.

    See Also
    --------
    stochvi.damage : The calculation.
    """

    typical: Vector
    worst: Vector
    window: float
    windows: int


@dataclass(frozen=True, kw_only=True, eq=False)
class TailoredTest:
    """A random test of another duration that does the fatigue damage of the mission.

    Parameters
    ----------
    duration
        Of the test, s.
    frequency_hz, density
        Breakpoints of its profile, one-sided, (m/s^2)^2/Hz; straight in logarithms between them.
    rms
        Rms acceleration of the profile, m/s^2.
    exaggeration
        Factor of the rms for the other duration, (mission / duration)^(1 / b).
    equal_density
        (F,) density of equal damage in the duration, which the profile nowhere falls below.
    damage_ratio, damage_ratio_error
        (F,): damage of the profile without stops over that of the mission, and the relative error
        of the formula for the former.
    extreme_ratio, extreme_ratio_error
        (F,): expected largest response of the test over that of the mission, and its relative
        standard error, which is that of the mission. Below 1 the test has smaller shocks than the
        mission.

    See Also
    --------
    stochvi.damage : The calculation.
    """

    duration: float
    frequency_hz: Vector
    density: Vector
    rms: float
    exaggeration: float
    equal_density: SpectrumValues
    damage_ratio: Vector
    damage_ratio_error: Vector
    extreme_ratio: Vector
    extreme_ratio_error: Vector

    def to_frame(self) -> DataFrame:
        """The breakpoints as the columns of a file of a profile, in Hz and g^2/Hz."""
        return frame_of(
            {
                "frequency_hz": self.frequency_hz,
                "density_g2_per_hz": self.density / STANDARD_GRAVITY**2,
            }
        )

    def summary(self) -> str:
        """The profile in a sentence."""
        ratio = self.extreme_ratio
        least, most = _ends(ratio, ratio * self.extreme_ratio_error)
        return (
            f"{len(self.density)} breakpoints of {ACCELERATION.text(self.rms)} rms do at least the "
            f"fatigue damage of the mission, up to {float(self.damage_ratio.max()):.3g} times it; "
            f"their largest responses are {least} to {most} times those of the mission"
        )


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Damage(Result):
    """What a mission does to equipment at a place of a scene.

    Equipment is an oscillator z'' + (w / Q) z' + w^2 z = -a on the place, whose absolute
    acceleration is a. Spectra are functions of its natural frequency.

    Parameters
    ----------
    equipment_frequency_hz
        (F,) natural frequencies, Hz.
    quality, exponent
        Q of the equipment and exponent b of its fatigue.
    mission
        Duration, s.
    at
        The coordinate or point on which the equipment stands.
    with_stops, without_stops
        Spectra of the scene as it is, and with its stops left out; the second is None where there
        is no stationary motion without stops, and the first is the second in a scene without stops.
    damage_ratio
        Damage with stops over that without.
    equivalent_density
        One-sided density of a Gaussian acceleration of the place that does the same damage without
        stops, (m/s^2)^2/Hz. It is interpolated in logarithms.
    shocks
        Shock spectra of impacts; None where none was seen.
    impacts_per_hour
        Impacts on all stops, 1/h.
    contacts_above
        Contacts per hour with an acceleration of the place above each asked level, by the level in
        m/s^2. Rigid stops are left out: an impulse has no largest acceleration.
    impact_work_per_hour, impact_loss_per_hour
        Energy with which impacts arrive at all stops, m w^2 / 2, and what they lose of it, J/h.
    way, way_without
        How the spectra were found: "simulation", "clusters" or "density".
    scene_without_mass
        Whether the scene gives no mass; energies are then those of 1 kg.
    test
        The test of equal damage in the duration that was asked for; None where none was.

    See Also
    --------
    stochvi.damage : The calculation.
    """

    equipment_frequency_hz: Vector
    quality: float
    exponent: float
    mission: float
    at: str
    with_stops: EquipmentSpectra
    without_stops: EquipmentSpectra | None
    damage_ratio: SpectrumValues | None
    equivalent_density: SpectrumValues
    shocks: Shocks | None
    impacts_per_hour: Estimate | None
    contacts_above: Mapping[str, Estimate]
    impact_work_per_hour: Estimate | None
    impact_loss_per_hour: Estimate | None
    way: str
    way_without: str | None
    scene_without_mass: bool = False
    test: TailoredTest | None = None
    assumptions: Sequence[str] = ()

    @property
    def relative_error(self) -> float:
        """Median relative standard error of the fatigue damage."""
        damage = self.with_stops.fatigue_damage
        return float(np.median(damage.standard_error / damage.value))

    @property
    def unseen(self) -> bool:
        """Whether the scene has stops and impacts were not seen often enough for a number."""
        return self.impacts_per_hour is not None and self.impacts_per_hour.upper_95 is not None

    @property
    def unseen_in_words(self) -> str:
        """How seldom impacts were seen where their damage is not known, and the remedy."""
        assert self.impacts_per_hour is not None
        if TOO_FEW in self.impacts_per_hour.how:
            return f"impacts were seen {TOO_FEW}, so that their damage is not known; raise budget"
        return (
            "no impact was seen, so that the damage of impacts is not known; raise budget with a "
            "smaller rel_error, or ask reliability how rare they are"
        )

    def to_frame(self) -> DataFrame:
        """A row for each frequency of the equipment, with a column for every list of the
        document."""
        columns = {"equipment_frequency_hz": self.equipment_frequency_hz}
        columns |= self.with_stops.document()
        if self.without_stops is not None:
            columns |= {
                f"{name}_without_stops": values
                for name, values in self.without_stops.document().items()
            }
        for name in ("damage_ratio", "equivalent_density"):
            if getattr(self, name) is not None:
                columns |= lists_of(name, getattr(self, name))
        if self.shocks is not None:
            columns |= {"shock_typical": self.shocks.typical, "shock_worst": self.shocks.worst}
        return frame_of(columns)

    def _document(self) -> dict[str, Any]:
        found = super()._document()
        spectra, without = found.pop("with_stops"), found.pop("without_stops")
        head = {
            "method": f"damage:{self.way}",
            "equipment_frequency_hz": found.pop("equipment_frequency_hz"),
            **spectra.document(),
            "without_stops": None if without is None else without.document(),
        }
        for name in ("damage_ratio", "equivalent_density"):
            head |= lists_of(name, found.pop(name))
        return head | found

    def summary(self) -> str:
        """How much the stops add, in a sentence."""
        f = self.equipment_frequency_hz
        band = f"equipment from {f[0]:.4g} to {f[-1]:.4g} Hz at {self.at}, Q = {self.quality:g}"
        if self.damage_ratio is None:
            found = "no damage without stops to compare with"
        elif self.impacts_per_hour is None:
            found = "no stops"
        elif self.unseen:
            found = self.unseen_in_words
        else:
            ratio = self.damage_ratio
            low, high = _ends(ratio.value, ratio.standard_error)
            most = f[np.argmax(ratio.value)]
            found = f"stops multiply the damage by {low} to {high}, most at {most:.4g} Hz"
        return (
            f"{band}: {found}; median standard error {100.0 * self.relative_error:.2g} % "
            f"(by {self.way})"
        )


def _ends(value: Vector, standard_error: Vector) -> list[str]:
    """The smallest and the largest of some values, each with its standard error where it has
    one."""
    return [
        format_with_error(value[k], standard_error[k]) if standard_error[k] else f"{value[k]:.3g}"
        for k in (int(np.argmin(value)), int(np.argmax(value)))
    ]


# ------------------------------------------------------------------------------
# Response of equipment to a stationary Gaussian acceleration, from its density.
#
# Equipment is z'' + (w / Q) z' + w^2 z = -a. Let G be the density of a, one-sided per hertz. The
# moments of the pseudo-velocity w z and of the absolute acceleration y = a + z'' are
#
#     lambda_n = int (2 pi f)^n |H(f)|^2 G(f) df.
#
# The damage of a Gaussian stress is that of a narrow band times alpha_0.75^2 (D. Benasciutti and R.
# Tovo, Probab. Eng. Mech. 21 (2006) 287). Dirlik's formula (T. Dirlik, Warwick 1985) is a second
# opinion: the difference is a part of the bias. It errs by a third where equipment is much faster
# than its mount: the stress then has two bands. Extremes are those of clumps of crossings (E. H.
# Vanmarcke, J. Appl. Mech. 42 (1975) 215); their bias is the difference to independent crossings,
# or to clumps at the mean frequency of the motion.
#
# Where the level A of the noise varies slowly the damage is that of Gaussian noise times E A^b, and
# a level is exceeded with the probability of `RandomLevel`. What equipment and mount feel less, as
# they average the level over their memory, is a part of the bias.
# ------------------------------------------------------------------------------


Density = Callable[[Any], Vector]
"""A one-sided density at frequencies in hertz."""

NODES = 6
"""Gauss-Legendre nodes on a panel; panels narrow geometrically towards resonances."""

BEYOND, BELOW = 30.0, 1e-3
"""Ends of the integrals: the largest frequency of equipment or structure times the first, the
smallest times the second."""

LEVELS = np.linspace(0.0, 12.0, 4801)
"""Levels in standard deviations over which the distribution of an extreme is integrated."""

MARKS, LEAST_MARK, FAR = 32, 0.3, 6.0
"""Levels at which extremes under noise of varying level are known: their number, the lowest one in
standard deviations, and how many of them the highest one is at a level as far from its median."""

CERTAIN, LEAST_HAZARD = 1.0 - 1e-15, 1e-14
"""Largest probability and smallest hazard, beyond which rounding errors begin."""

FORMULA_ERROR, DIFFERENCES = 0.1, 2.5
"""The relative bias of the damage by formula is the first number. It is the second one times the
difference of the two formulas if that is larger. Against rainflow counting on all profiles that
ship, b = 6, it erred by 9 % at most up to 320 Hz, and by 21 % at 1500 Hz, where Dirlik's erred by
32 %."""

NARROW = 1.0 - 1e-9
"""Spectral width alpha_2 from which on a process is narrow-band."""


@dataclass(frozen=True)
class GaussianAcceleration:
    """Density of the absolute acceleration of a displacement row . q where nothing is hit.

    Raises `NotApplicable` where the motion is not stationary and Gaussian.
    """

    model: Model
    row: tuple[float, ...]

    def __post_init__(self) -> None:
        free_motion(self.model)

    def __call__(self, frequency_hz: Vector) -> Vector:
        """One-sided density, (m/s^2)^2/Hz."""
        modes = self.model.modal
        weights = np.array(self.row) @ modes.shapes
        squares = np.diag(modes.squares)
        omega = 2.0 * math.pi * frequency_hz
        total = np.zeros(len(frequency_hz))
        for density, force, direct in self._sources:
            moved = gains(frequency_hz, squares, modes.damping, force)
            carried = moved @ (squares @ weights) + 1j * omega * (moved @ (modes.damping @ weights))
            # forces on masses are a part of the acceleration; those of a base are not
            pushed: Any = 0.0
            if direct:
                pushed = weights @ (
                    force(frequency_hz).T if isinstance(force, InputMatrix) else force
                )
            total += density(frequency_hz) * np.abs(pushed - carried) ** 2
        return total

    @cached_property
    def _sources(self) -> list[tuple[Density, Force, bool]]:
        """Density of each noise, its modal forces per unit, and whether it pushes masses."""
        model, shapes = self.model, self.model.modal.shapes
        direct = not model.base_alone_moves
        found: list[tuple[Density, Force, bool]] = [
            (table, force, direct) for table, force in model.modal.tables
        ]
        for intensity, direction in model.whites:
            flat = density_from_intensity(intensity)
            found.append((_constant(flat), shapes.T @ direction, direct))
        for signal in model.signals:
            noise = Filter(signal.omega, signal.damping_rate, signal.intensity)
            found.append((noise.__call__, shapes.T @ signal.direction, direct))
        return found

    @cached_property
    def edges(self) -> Vector:
        """Frequencies (Hz) between which the density is smooth, and around its resonances."""
        modes = self.model.modal
        values = list(eigenvalues(np.diag(modes.squares), modes.damping))
        for signal in self.model.signals:
            fall = signal.damping_rate / 2.0
            values.append(complex(-fall, math.sqrt(max(signal.omega**2 - fall**2, 0.0))))
        cuts = [table.frequency_hz for table, _ in self.model.tables]
        cuts += [
            np.asarray(force.breaks) for _, force in modes.tables if isinstance(force, InputMatrix)
        ]
        for value in values:
            cuts.append(_around(abs(value.imag) / (2.0 * math.pi), abs(value.real) / math.pi / 2.0))
        return np.unique(np.concatenate(cuts))


def _constant(value: float) -> Density:
    """The density of white noise."""
    return lambda frequency_hz: np.full(len(frequency_hz), value)


def _around(centre: float, width: float) -> Vector:
    """Edges of panels that narrow towards a resonance, Hz."""
    width = max(width, 1e-6 * centre, 1e-9)
    offsets = width * 2.0 ** np.arange(-1.0, 24.0)
    found = np.concatenate([[centre], centre + offsets, centre - offsets])
    return found[(found > 0.0) & (found < 1e3 * max(centre, width))]


@dataclass(frozen=True, kw_only=True, eq=False)
class SpectralMoments:
    """Spectral moments lambda_n of the orders 0, 0.75, 1, 1.5, 2 and 4, (equipment,) each."""

    ORDERS: ClassVar[dict[str, float]] = {
        "order0": 0.0, "order075": 0.75, "order1": 1.0, "order150": 1.5, "order2": 2.0,
        "order4": 4.0,
    }  # fmt: skip

    order0: Vector
    order075: Vector
    order1: Vector
    order150: Vector
    order2: Vector
    order4: Vector

    @property
    def crossings(self) -> Vector:
        """Upcrossings of the mean, 1/s (S. O. Rice 1944)."""
        return np.asarray(np.sqrt(self.order2 / self.order0) / (2.0 * math.pi))


@dataclass(frozen=True, eq=False)
class GaussianEquipment:
    """Equipment on a Gaussian acceleration of a density, with frequencies (Hz) between which the
    density is smooth.

    The `level` of the noise may vary; `memory` (s) is that of the structure, over which it averages
    the level.
    """

    density: Density
    edges: Vector
    equipment: Equipment
    level: RandomLevel | None = None
    memory: float = 0.0

    @cached_property
    def _felt(self) -> list[RandomLevel]:
        """What each equipment feels of the level."""
        assert self.level is not None
        memories = self.memory + self.equipment.quality / self.equipment.omega
        return [self.level.felt(1.0 / float(each)) for each in memories]

    @cached_property
    def _grid(self) -> tuple[Vector, Vector, Vector]:
        """Frequencies (Hz), weights, and the density there."""
        frequencies = np.array(self.equipment.frequency_hz)
        ends = [float(frequencies.min()), float(frequencies.max())]
        inner = self.edges[self.edges > 0.0]
        if len(inner):
            ends = [min(ends[0], float(inner.min())), max(ends[1], float(inner.max()))]
        low, high = BELOW * ends[0], BEYOND * ends[1]
        wide = np.geomspace(low, high, 8 * math.ceil(math.log2(high / low)))
        rings = [_around(f, f / (2.0 * self.equipment.quality)) for f in frequencies]
        cuts = np.unique(np.concatenate([wide, inner, *rings]))
        cuts = cuts[(cuts >= low) & (cuts <= high)]
        f, weight = gauss_panels(cuts, NODES)
        return f, weight, self.density(f)

    def _moments(self, gain: Callable[[Vector], Matrix]) -> SpectralMoments:
        f, weight, density = self._grid
        omega = 2.0 * math.pi * f
        powered = gain(omega) * (density * weight)
        orders = SpectralMoments.ORDERS.items()
        return SpectralMoments(**{name: powered @ omega**order for name, order in orders})

    def _resonance(self, omega: Vector) -> Matrix:
        """|H|^2 of the relative displacement, (equipment, frequencies)."""
        w = self.equipment.omega[:, None]
        return np.asarray(
            1.0 / (((w - omega) * (w + omega)) ** 2 + (w * omega / self.equipment.quality) ** 2)
        )

    @cached_property
    def stress(self) -> SpectralMoments:
        """SpectralMoments of the pseudo-velocity w z."""
        return self._moments(
            lambda omega: self._resonance(omega) * self.equipment.omega[:, None] ** 2
        )

    @cached_property
    def response(self) -> SpectralMoments:
        """SpectralMoments of the absolute acceleration."""

        def gain(omega: Vector) -> Matrix:
            w = self.equipment.omega[:, None]
            return np.asarray(
                (w**4 + (w * omega / self.equipment.quality) ** 2) * self._resonance(omega)
            )

        return self._moments(gain)

    def cumulative_square(self) -> Vector:
        """Mean square of the acceleration of the place below each frequency of the equipment."""
        f, weight, density = self._grid
        total = np.concatenate([[0.0], np.cumsum(weight * density)])
        places = np.searchsorted(f, np.array(self.equipment.frequency_hz))
        return np.asarray(total[places])

    @property
    def rms(self) -> Vector:
        """Rms absolute acceleration of the equipment, m/s^2."""
        return np.asarray(np.sqrt(self.response.order0))

    def damage_rates(self) -> tuple[Vector, Vector]:
        """Damage per second, (m/s)^b/s, and a bound of the error of its formula."""
        wear, other = (
            formula(self.stress, self.equipment.exponent) for formula in (three_quarters, dirlik)
        )
        error = np.maximum(DIFFERENCES * np.abs(wear - other), FORMULA_ERROR * wear)
        if self.level is None:
            return wear, error
        power = self.equipment.exponent
        louder = self.level.moment(power)
        less = louder - np.array([each.moment(power) for each in self._felt])
        return louder * wear, louder * error + np.abs(less) * wear

    def exceedance_rates(self, levels: Vector) -> tuple[Vector, Vector]:
        """Rates, 1/s, at which |y| goes beyond `levels` standard deviations, (equipment, levels):
        of clumps, and of independent crossings."""
        m = self.response
        width = np.sqrt(np.maximum(1.0 - m.order1**2 / (m.order0 * m.order2), 0.0))[:, None]
        crossings = 2.0 * m.crossings[:, None] * np.exp(-0.5 * levels**2)
        beyond = -np.expm1(-0.5 * levels**2)
        clumps = -np.expm1(-math.sqrt(0.5 * math.pi) * width**1.2 * levels)
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = np.where(levels > 0.0, clumps / beyond, np.inf)
        return crossings * ratio, crossings

    def extremes(
        self, mission: float, probabilities: Sequence[float]
    ) -> tuple[Vector, Vector, Matrix]:
        """Expected largest |y| of a mission with its bias, m/s^2, and the levels below which it
        stays with the `probabilities`, (probabilities, equipment)."""
        clumps, crossings = self.exceedance_rates(LEVELS)
        m = self.response
        # a fast ripple on a slow motion crosses a level many times at one crest of that motion
        slow = (m.order1 / np.sqrt(m.order0 * m.order2))[:, None]

        def mean_of(rates: Vector) -> tuple[Vector, Vector]:
            below = np.exp(-np.minimum(rates * mission, 700.0))
            below[:, 0] = 0.0
            return (LEVELS[1] - LEVELS[0]) * (np.sum(1.0 - below, axis=1) - 0.5), below

        mean, below = mean_of(clumps)
        bias = np.max([np.abs(mean_of(each)[0] - mean) for each in (crossings, slow * clumps)], 0)
        levels = np.array([[np.interp(p, each, LEVELS) for each in below] for p in probabilities])
        if self.level is not None:
            still, marks, below = mean, *self._staying_below(mission, [self.level] * len(mean))
            mean = np.asarray(np.trapezoid(1.0 - below, marks))
            felt = np.trapezoid(1.0 - self._staying_below(mission, self._felt)[1], marks)
            bias = bias * mean / still + np.abs(felt - mean)
            levels = np.array(
                [[np.interp(p, each, marks) for each in below] for p in probabilities]
            )
        return mean * self.rms, bias * self.rms, levels * self.rms

    def _staying_below(self, mission: float, felt: list[RandomLevel]) -> tuple[Vector, Matrix]:
        """Levels in standard deviations, and the probability (equipment, levels) that |y| stays
        below each of them in a mission while the noise varies."""
        assert self.level is not None
        few = np.geomspace(LEAST_MARK, FAR * float(self.level.gain(np.array(FAR))), MARKS)
        places = few[:, None] / np.array([each.gains for each in felt])[:, None]
        hazards = np.empty((len(felt), MARKS))
        for row, level in enumerate(felt):
            rates = self.exceedance_rates(places[row].ravel())[0][row].reshape(MARKS, -1)
            chances = [level.probability(each, mission) for each in rates]
            hazards[row] = -np.log1p(-np.minimum(chances, CERTAIN))
        marks = np.linspace(0.0, few[-1], len(LEVELS))
        logs = scipy.interpolate.PchipInterpolator(
            np.log(few), np.log(np.maximum(hazards, LEAST_HAZARD)), axis=1
        )
        below = np.exp(-np.exp(logs(np.log(np.maximum(marks, few[0])))))
        below[:, 0] = 0.0
        return marks, below


def three_quarters(m: SpectralMoments, exponent: float) -> Vector:
    """Rainflow damage per second of a Gaussian stress with these moments, sum of amplitude^b.

    D = alpha^2 D_narrow, alpha = lambda_0.75 / sqrt(lambda_0 lambda_1.5),
    D_narrow = nu (2 lambda_0)^(b/2) Gamma(1 + b / 2).

    >>> one = np.ones(1)
    >>> narrow = SpectralMoments(**dict.fromkeys(SpectralMoments.ORDERS, one))
    >>> bool(np.isclose(2 * np.pi * three_quarters(narrow, 2.0)[0], 2.0))
    True
    """
    width = m.order075**2 / (m.order0 * m.order150)
    narrow = m.crossings * (2.0 * m.order0) ** (0.5 * exponent) * gamma(1.0 + 0.5 * exponent)
    return np.asarray(width * narrow)


def dirlik(m: SpectralMoments, exponent: float) -> Vector:
    """The same by Dirlik's density of rainflow amplitudes."""
    peaks = np.sqrt(m.order4 / m.order2) / (2.0 * math.pi)
    irregular = np.minimum(m.order2 / np.sqrt(m.order0 * m.order4), NARROW)
    mean = m.order1 / m.order0 * np.sqrt(m.order2 / m.order4)
    d1 = 2.0 * (mean - irregular**2) / (1.0 + irregular**2)
    r = (irregular - mean - d1**2) / (1.0 - irregular - d1 + d1**2)
    d2 = (1.0 - irregular - d1 + d1**2) / (1.0 - r)
    d3 = 1.0 - d1 - d2
    q = 1.25 * (irregular - d3 - d2 * r) / d1
    rayleigh = math.sqrt(2.0) ** exponent * gamma(1.0 + 0.5 * exponent)
    amplitudes = d1 * q**exponent * gamma(1.0 + exponent) + rayleigh * (
        d2 * np.abs(r) ** exponent + d3
    )
    return np.asarray(peaks * m.order0 ** (0.5 * exponent) * amplitudes)


# ------------------------------------------------------------------------------
# Largest response of a mission, from the largest ones of many windows.
#
# Let F be the distribution of a window's largest response r. Beyond a threshold u the expected
# number of louder responses in a window is taken as
#
#     -ln F(r) = L (1 + xi (r^2 - u^2) / beta)^(-1 / xi).
#
# With xi = 0 that is the law of the crests of a Gaussian motion (Rice), and of responses that are
# proportional to impact speeds with the distribution of Rayleigh. A motion about a sine has a
# lighter tail, -0.1 < xi < 0: its crests are Gaussian about the amplitude of the sine, not about 0.
# A mixture of levels or of calm and struck windows has a heavier one; that of an exponential law of
# r itself is about 0.15 where r^2 has grown to a few beta. So the shape xi is not assumed: before
# the sample is seen it is normal about 0 with the deviation `SHAPE`. L, beta and xi are averaged
# over all values that the sample leaves likely (Bayes). A quantile of the mission's largest
# response holds the uncertainty of all three, and lies therefore beyond that of the best estimate.
#
# The threshold is the lowest one from which the scale beta no longer changes with the threshold by
# more than its scatter (O. V. Lepski 1990; H. Drees and E. Kaufmann, Stoch. Process. Appl. 75
# (1998) 149).
# ------------------------------------------------------------------------------


SHAPE = 0.15
"""Standard deviation of the shape xi before the sample is seen."""

SHAPES, SCALES = np.linspace(-0.42, 0.56, 15) + 0.01, 17
"""Shapes that are averaged over, none of them 0, and the number of scales beside each."""

FLAT = 1e-12
"""Smallest scale over the square of the largest response."""

SPREAD, MARGIN = 4.5, 0.1
"""Half the range of ln beta, in standard errors, and what is added to it."""

LEAST_TAIL, MOST_TAIL, NEXT_TAIL = 12, 200, 1.5
"""Smallest and largest number of windows beyond the threshold, and the ratio of two thresholds that
are tried one after the other."""

REACHED = 1.0
"""Expected number of responses of a mission beyond the first threshold that is tried, at least."""

STEADY = 1.5
"""Change of ln beta, in standard errors of the change, up to which a higher threshold agrees."""

ENOUGH_WINDOWS = 512
"""Number of windows from which the tail is known to some per cent: sampling goes on until then, if
time allows."""

UNLIKELY = 1e-5
"""Likelihood over the largest one, below which shapes and scales are left out."""

DENSE, EXTREME_LEVELS, BEYOND_EXTREMES = 41, 150, 1e4
"""Points over the law of the largest, levels beyond the threshold, and the inverse of the
probability that a mission exceeds the last of them."""

FARTHEST = 50.0
"""Last level over the expected largest."""

FEWEST_PATHS = 8
"""Number of paths from which the scatter between them shows whether their windows are alike."""

TAIL_SHARE, FEWEST_BEYOND, MOST_BEYOND = 0.1, 10, 50
"""Share of clusters from which `exceedance` takes a tail, and the limits of their number."""


class LargestResponses(NamedTuple):
    """Expected largest response with its errors, and the levels of some probabilities
    (probabilities, equipment), m/s^2."""

    value: Vector
    standard_error: Vector
    bias: Vector
    levels: NDArray[np.float64]


def largest_of_mission(
    peaks: NDArray[np.float64], windows: float, probabilities: Sequence[float]
) -> LargestResponses:
    """The largest response of a mission of so many `windows`.

    The bias is what the unknown shape of the tail adds to the interval.

    Parameters
    ----------
    peaks
        (paths, windows, equipment): largest response in windows of independent paths.
    probabilities
        Probabilities of levels, below which the largest response stays.
    """
    count = peaks.shape[2]
    value, errors, bias = np.empty((3, count))
    levels = np.empty((len(probabilities), count))
    for i in range(count):
        value[i], errors[i], bias[i], levels[:, i] = _largest(
            peaks[:, :, i], windows, probabilities
        )
    return LargestResponses(value, errors, bias, levels)


def _largest(
    sample: NDArray[np.float64], windows: float, probabilities: Sequence[float]
) -> tuple[float, float, float, Vector]:
    """Expected largest with its error and bias, and the levels of the probabilities."""
    order = np.argsort(sample, axis=None)
    known = sample.ravel()[order]
    number = len(known)
    if known[-1] <= known[0]:  # nothing moves, or nothing scatters
        return float(known[-1]), 0.0, 0.0, np.full(len(probabilities), known[-1])
    tail = _windows_beyond(known, windows)
    threshold = float(known[number - tail - 1])
    law = _tail_of(known, tail, _clumping(sample, threshold))
    body = known[: number - tail]
    below = np.arange(1, len(body) + 1) / number
    start, start_error = _up_to(order[: len(body)], body, sample.shape, windows)
    found = start + law.mean_beyond(threshold, windows)
    # one standard deviation of L either way, whose relative variance is 1 / k
    step = math.exp(1.0 / math.sqrt(law.seen))
    more, less = (law.mean_beyond(threshold, windows * each) for each in (step, 1.0 / step))
    value = float(law.chance @ found)
    whole = float(law.chance @ ((found - value) ** 2 + 0.25 * (more - less) ** 2))
    of_shape = np.array([
        (own.sum(), own @ (found[law.shape == shape] - value))
        for shape in np.unique(law.shape)
        if (own := law.chance[law.shape == shape]).sum() > 0.0
    ])  # fmt: skip
    between = float(np.sum(of_shape[:, 1] ** 2 / of_shape[:, 0]))
    error = math.sqrt(max(whole - between, 0.0) + start_error**2)
    bias = GAUSSIAN_95 * (math.sqrt(error**2 + between) - error)
    levels = law.levels(threshold, windows, FARTHEST * value)
    kept = np.concatenate([below**windows, law.stays_below(threshold, windows, levels)])
    quantiles = np.interp(probabilities, kept, np.concatenate([body, levels]))
    return value, error, bias, quantiles


def _windows_beyond(known: Vector, windows: float) -> int:
    """Number of windows beyond the threshold, of a sorted sample."""
    number = len(known)
    tried = [min(max(MOST_TAIL, math.ceil(REACHED * number / windows)), max(number // 2, 1))]
    while tried[-1] / NEXT_TAIL >= LEAST_TAIL:
        tried.append(int(tried[-1] / NEXT_TAIL))
    squares = known[::-1] ** 2
    gumbel = -np.log(-np.log1p(-(np.arange(1, number + 1) - 0.5) / number))
    logs = np.array([
        math.log(max(float(np.sum(squares[:k] - squares[k])), np.finfo(float).tiny)
                 / float(np.sum(gumbel[:k] - gumbel[k])))
        for k in tried
    ])  # fmt: skip
    shares = 1.0 / np.array(tried)
    for place, k in enumerate(tried):
        away = np.abs(logs[place + 1 :] - logs[place])
        if np.all(away <= STEADY * np.sqrt(shares[place + 1 :] - shares[place])):
            return k
    raise AssertionError("the highest threshold agrees with itself")


def _clumping(sample: NDArray[np.float64], threshold: float) -> float:
    """Factor by which windows beyond the threshold scatter more between paths than independent
    ones do, at least 1."""
    paths, windows = sample.shape
    counts: Vector = np.sum(sample > threshold, axis=1).astype(float)
    share = float(counts.mean()) / windows
    if paths < FEWEST_PATHS or not 0.0 < share < 1.0:
        return 1.0
    scatter = float(counts.var(ddof=1))
    factor = scatter / (windows * share * (1.0 - share))
    return max(1.0, float(factor))


def _up_to(
    order: NDArray[np.int64], body: Vector, shape: tuple[int, ...], windows: float
) -> tuple[float, float]:
    """Integral of 1 - F^n up to the threshold, the largest of the body, and its standard error;
    `order` are the places of the body in the sample."""
    paths, number = shape[0], shape[0] * shape[1]
    groups = min(GROUPS, paths)
    steps = np.diff(body)

    def integral(below: NDArray[np.float64]) -> Vector:
        return np.asarray(np.sum(below[:-1] ** windows * steps[:, None], axis=0))

    below = np.arange(1, len(body) + 1)[:, None] / number
    start = float(body[-1] - integral(below)[0])
    if groups < 2 or below[-1, 0] ** windows < UNLIKELY:
        return start, 0.0
    own = (order // shape[1]) * groups // paths
    counts = np.cumsum(own[:, None] == np.arange(groups), axis=0)
    sizes = np.bincount(np.arange(paths) * groups // paths, minlength=groups) * shape[1]
    left = np.maximum(below * number - counts, 0.0) / (number - sizes)
    return start, float(jackknife_error(integral(left)))


class _Tail(NamedTuple):
    """Likely shapes and scales of a tail (values,), the probability of each, and the expected
    number L of responses beyond the threshold in a window: of Gamma's distribution with the shape
    `seen` and the rate `exposure`."""

    shape: Vector
    scale: Vector
    chance: Vector
    seen: float
    exposure: Vector

    def mean_beyond(self, threshold: float, windows: float) -> Vector:
        """Integral of 1 - F^n beyond the threshold, by shape and scale."""
        expected = windows * self.seen / self.exposure
        # of ln E, where E = n L (1 + ...)^(-1 / xi) is exponential
        last = np.minimum(np.log(expected), 4.0)
        log = -14.0 + (last + 14.0)[:, None] * np.linspace(0.0, 1.0, DENSE)
        excess = np.expm1(self.shape[:, None] * (np.log(expected)[:, None] - log))
        squares = threshold**2 + self.scale[:, None] * excess / self.shape[:, None]
        density = np.exp(log - np.exp(log))
        beyond = np.sqrt(np.maximum(squares, threshold**2)) - threshold
        return np.asarray(np.trapezoid(beyond * density, log, axis=1))

    def levels(self, threshold: float, windows: float, last: float) -> Vector:
        """Levels beyond the threshold, up to one that a mission hardly exceeds, or `last`."""
        expected = np.maximum(windows * self.seen / self.exposure, 1.0)
        squares = (
            self.scale * np.expm1(self.shape * np.log(BEYOND_EXTREMES * expected)) / self.shape
        )
        top = min(math.sqrt(threshold**2 + float(squares.max())), last)
        return np.linspace(threshold, max(top, threshold * (1.0 + 1e-9)), EXTREME_LEVELS)

    def stays_below(self, threshold: float, windows: float, levels: Vector) -> Vector:
        """Probability that a mission stays below levels beyond the threshold."""
        ratio = self.shape / self.scale
        inner = 1.0 + ratio[:, None] * (levels**2 - threshold**2)
        with np.errstate(divide="ignore"):
            louder = np.exp(-np.log(np.maximum(inner, 0.0)) / self.shape[:, None])
        louder[inner <= 0.0] = 0.0
        stays = np.exp(-self.seen * np.log1p(windows * louder / self.exposure[:, None]))
        return np.asarray(self.chance @ stays)


def _tail_of(known: Vector, tail: int, clumping: float) -> _Tail:
    """What the last `tail` values of a sorted sample say of its tail, where so many of them count
    as one."""
    excess = known[-tail:] ** 2 - known[-tail - 1] ** 2
    width = SPREAD * math.sqrt(clumping / tail) + MARGIN
    # the mean excess is beta / (1 - xi)
    mean = max(float(excess.mean()), FLAT * float(known[-1]) ** 2)
    middle = mean * np.maximum(1.0 - SHAPES, 0.3)
    scales = middle[:, None] * np.exp(np.linspace(-width, width, SCALES))
    shape, scale = np.repeat(SHAPES, SCALES), scales.ravel()
    inner = 1.0 + (shape / scale)[:, None] * excess
    logs = np.log(np.maximum(inner, np.finfo(float).tiny))
    # L has the weight 1 / L: its distribution is Gamma's, and the rest is
    exposure = len(known) - tail + np.exp(-logs / shape[:, None]).sum(axis=1)
    likely = -tail * np.log(exposure * scale) - (1.0 + 1.0 / shape) * logs.sum(axis=1)
    likely = likely / clumping - 0.5 * (shape / SHAPE) ** 2
    likely[np.any(inner <= 0.0, axis=1)] = -np.inf
    chance = np.exp(likely - likely.max())
    kept = chance > UNLIKELY
    chance = chance[kept] / chance[kept].sum()
    return _Tail(shape[kept], scale[kept], chance, tail / clumping, exposure[kept] / clumping)


def exceedance(peaks: Vector, weight: Vector, levels: Vector, square: bool) -> Vector:
    """Share of a weighted sample beyond each level; its tail is exponential in r^2 (`square`), or
    in r."""
    order = np.argsort(peaks)
    known, shares = peaks[order], weight[order] / weight.sum()
    beyond = np.concatenate([np.cumsum(shares[::-1])[::-1], [0.0]])
    found = beyond[np.searchsorted(known, levels, side="right")]
    tail = int(np.clip(TAIL_SHARE * len(known), min(FEWEST_BEYOND, len(known) // 2), MOST_BEYOND))
    threshold, own, share = known[-tail - 1], shares[-tail:], shares[-tail:].sum()
    power = 2 if square else 1
    scale = float(own @ (known[-tail:] ** power - threshold**power)) / share
    excess = (np.maximum(levels, threshold) ** power - threshold**power) / scale
    return np.where(levels > threshold, share * np.exp(-excess), found)
