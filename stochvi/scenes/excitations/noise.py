"""Excitations by noise, and modulation. Chapters: filters of any order; one resonance; roads by ISO
8608; vehicles on a road; a base that follows a road; saved spectra; tabulated densities; strengths
and clearances that change in time."""

from __future__ import annotations

import csv
import math
import warnings
from abc import abstractmethod
from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import BeforeValidator, Discriminator, PrivateAttr, Tag, model_validator

from stochvi.mathematics.numerics import Matrix as FloatMatrix
from stochvi.mathematics.numerics import Vector, Waves
from stochvi.mathematics.spectra import Filter, Table, refined_table
from stochvi.mathematics.units import DENSITIES, STANDARD_GRAVITY, Unit, power_ratio, unit
from stochvi.notices import InputWarning
from stochvi.results.errors import SceneError
from stochvi.scenes.datasets import profiles
from stochvi.scenes.excitations.base import (
    BASE,
    BaseExcitation,
    Density,
    DensityNoise,
    DensityOrLevelUnit,
    StrengthNoise,
    agreed_unit,
    band_of,
    unread_unit,
)
from stochvi.scenes.frames import Frame, Values, source_of
from stochvi.scenes.readers import LARGEST_DATA_FILE, Columns, read_columns
from stochvi.scenes.text_tables import as_text, decoded, out_of_order
from stochvi.scenes.validation import (
    Band,
    Checked,
    Column,
    ColumnName,
    Count,
    Matrix,
    Names,
    NonNegative,
    Numbers,
    Positive,
    given,
    plain_numbers,
    sentences_of,
)

# ------------------------------------------------------------------------------
# White noise through a filter of any order: of a transfer function, or in state space.
#
# Both have the one-sided density 2 S0 |H(i w)|^2 of the white noise of intensity S0 that passes
# them. Methods read it as a table, which is as dense as its interpolation needs.
# ------------------------------------------------------------------------------


BELOW, ABOVE = 1e-6, 1e3
"""Ends of the density: as shares of the slowest pole below, and of the fastest one above."""

FAINTEST = 1e-14
"""Share of its largest value at which a density ends; a notch goes down to it."""

STABLE = 1e-12
"""A pole counts as stable if its decay rate is above this share of the fastest pole."""


class ShapedNoise(DensityNoise, StrengthNoise):
    """Base of white noise that has passed a linear filter H(s) of any order.

    The one-sided density is 2 S0 |H(i w)|^2, w = 2 pi f. The filter has no unit: a gain of 1 keeps
    the strength, which is given as for `WhiteNoise`.

    Parameters
    ----------
    intensity, density, unit
        Strength of the white noise before the filter.
    """

    effect_word: ClassVar[str] = "noise shaped by a filter"

    @property
    @abstractmethod
    def poles(self) -> Waves:
        """Poles of the filter, rad/s, complex."""

    @abstractmethod
    def squared_gain(self, frequency_hz: Vector) -> Vector:
        """|H|^2 at the given frequencies."""

    @model_validator(mode="after")
    def _shape(self) -> Self:
        self._checked()
        sizes = np.abs(self.poles)
        unstable = self.poles[self.poles.real >= -STABLE * sizes.max()]
        if len(unstable):
            raise ValueError(
                "needs a stable filter, every pole with a negative real part, got the pole "
                f"{unstable[0]:.4g} rad/s"
            )
        ends = BELOW * sizes.min(), ABOVE * sizes.max()
        resonances = np.abs(self.poles.imag)
        places = np.sort(np.append(np.geomspace(*ends, 200), resonances[resonances > ends[0]]))
        frequency_hz = places / (2.0 * np.pi)
        gains = self.squared_gain(frequency_hz)
        faintest = FAINTEST * float(gains.max())
        if not faintest > 0.0:
            raise ValueError("needs a filter that lets noise pass, got H = 0 at every frequency")
        heard = np.flatnonzero(gains > faintest)
        strength = 2.0 * self.si_intensity * power_ratio(self.level_db)
        self._table = refined_table(
            lambda f: strength * np.maximum(self.squared_gain(f), faintest),
            frequency_hz[heard[0] : heard[-1] + 1],
        )
        return self

    def _checked(self) -> None:
        """Raise a ValueError where the numbers of the filter do not fit together."""

    @property
    def density_unit(self) -> str | None:
        return self.unit

    @property
    def order(self) -> int:
        """Number of poles."""
        return len(self.poles)

    def assumptions(self, omega: float = 0.0, damping_rate: float = 0.0) -> tuple[str, ...]:
        low, high = self.table.frequency_hz[[0, -1]]
        return (
            f"the noise of a filter of order {self.order} is followed by its density from "
            f"{low:.3g} to {high:.3g} Hz",
        )

    def facts(self, where: str, numbers: Mapping[str, float]) -> list[tuple[str, ...]]:
        name = f"{self.effect_word.capitalize()} on {where}"
        return [(name, f"order {self.order}{self.raised}", band_of(numbers))]


class TransferFunctionNoise(ShapedNoise):
    """White noise w through the transfer function of a filter of any order.

    The force or acceleration is f = H w with

        H(s) = (b_m s^m + ... + b_0) / (a_n s^n + ... + a_0),    m < n,

    and its one-sided density is 2 S0 |H(2 pi i f)|^2. In a scene file it may also be written as
    `kind = "filtered"` with these two keys.

    Parameters
    ----------
    numerator, denominator
        Coefficients b and a, the highest power of s first, as in `scipy.signal`; s in rad/s.
    intensity, density, unit
        Strength of the white noise before the filter, as for `WhiteNoise`.

    Raises
    ------
    SceneError
        If a pole has no negative real part, or the numerator is of no lower degree.

    See Also
    --------
    stochvi.FilteredNoise : A resonance, which simulations follow as a filter.
    stochvi.StateSpaceNoise : The same by matrices.

    Examples
    --------
    White noise through a filter of first order, with its corner at 10 rad/s; E f^2 = 10 S0 / 2:

    >>> wind = TransferFunctionNoise(intensity=2.0, numerator=[10.0], denominator=[1.0, 10.0])
    >>> round(float(wind.table(1e-3)), 4), round(wind.table.mean_square(), 2)
    (4.0, 9.99)
    """

    kind: Literal["transfer-function"] = "transfer-function"
    numerator: Numbers
    denominator: Numbers

    @property
    def poles(self) -> Waves:
        return np.roots(self.denominator).astype(np.complex128)

    def squared_gain(self, frequency_hz: Vector) -> Vector:
        s = 2j * np.pi * frequency_hz
        ratio = np.polyval(self.numerator, s) / np.polyval(self.denominator, s)
        return np.asarray(np.abs(ratio) ** 2)

    def _checked(self) -> None:
        above, below = np.trim_zeros(self.numerator, "f"), self.denominator
        if len(below) < 2 or below[0] == 0.0:
            raise ValueError(
                "needs a denominator of degree 1 at least, with a highest coefficient other than "
                f"0, got {list(below)}"
            )
        if not len(above) < len(below):
            raise ValueError(
                "needs a numerator of a lower degree than the denominator, got degrees "
                f"{len(above) - 1} and {len(below) - 1}; add white noise for a part without filter"
            )


LISTS = (list, tuple, np.ndarray)
"""What holds numbers one after another."""


def _column(value: Any) -> Any:
    """A vector as a matrix of one column; what is neither is left to the check of the key."""
    is_vector = isinstance(value, LISTS) and not any(isinstance(each, LISTS) for each in value)
    return [[each] for each in value] if is_vector else plain_numbers(value)


def _row(value: Any) -> Any:
    """A matrix of one row as a vector; what is neither is left to the check of the key."""
    is_matrix = isinstance(value, LISTS) and len(value) == 1 and isinstance(value[0], LISTS)
    return plain_numbers(value[0] if is_matrix else value)


class StateSpaceNoise(ShapedNoise):
    """White noise through a filter in state space.

    The force or acceleration is f = C z, with states z of

        z' = A z + B w(t),

    and independent white noises w, all of the same intensity S0. Its one-sided density is the sum
    of 2 S0 |C (i w - A)^-1 B|^2 over the columns of B.

    Parameters
    ----------
    A
        Matrix (n, n), 1/s; all of its eigenvalues have a negative real part.
    B
        Vector (n,) or matrix (n, noises).
    C
        Vector (n,).
    intensity, density, unit
        Strength of each white noise, as for `WhiteNoise`.

    Raises
    ------
    SceneError
        If shapes do not fit together, or the filter is unstable.

    See Also
    --------
    stochvi.TransferFunctionNoise : The same by the coefficients of a transfer function.

    Examples
    --------
    >>> wind = StateSpaceNoise(intensity=2.0, A=[[-10.0]], B=[10.0], C=[1.0])
    >>> round(float(wind.table(1e-3)), 4)
    4.0
    """

    kind: Literal["state-space"] = "state-space"
    A: Matrix
    B: Annotated[Matrix, BeforeValidator(_column)]
    C: Annotated[Numbers, BeforeValidator(_row)]

    @property
    def poles(self) -> Waves:
        return np.linalg.eigvals(np.array(self.A)).astype(np.complex128)

    def squared_gain(self, frequency_hz: Vector) -> Vector:
        matrix, columns, row = np.array(self.A), np.array(self.B), np.array(self.C)
        s = 2j * np.pi * frequency_hz[:, None, None]
        states = np.linalg.solve(s * np.eye(len(matrix)) - matrix, columns.astype(complex))
        return np.asarray(np.sum(np.abs(row @ states) ** 2, axis=-1))

    def _checked(self) -> None:
        n = len(self.A)
        if not n or {len(row) for row in self.A} != {n}:
            raise ValueError(f"needs a square matrix A, got rows of {[len(r) for r in self.A]}")
        if len(self.B) != n or len({len(row) for row in self.B}) != 1:
            raise ValueError(f"needs B with {n} rows of equal length, as A has, got {len(self.B)}")
        if len(self.C) != n:
            raise ValueError(f"needs C with {n} numbers, as A has rows, got {len(self.C)}")


def kinds_of_filters(parts: Any) -> Any:
    """Excitations, those of kind `filtered` by the kind that their keys stand for."""
    return [_kind_of(each) for each in parts] if isinstance(parts, list | tuple) else parts


def _kind_of(part: Any) -> Any:
    if isinstance(part, dict) and part.get("kind") == "filtered":
        for kind, key in (("transfer-function", "denominator"), ("state-space", "A")):
            if key in part:
                return part | {"kind": kind}
    return part


# ------------------------------------------------------------------------------
# White noise that has passed through a resonance.
# ------------------------------------------------------------------------------


class FilteredNoise(StrengthNoise):
    """White noise that has passed through a resonance.

    It follows from white noise w of intensity S0 by

        f'' + 2 zeta w_f f' + w_f^2 f = w_f^2 w(t),    w_f = 2 pi frequency_hz,

    so that far below the resonance its density is that of w, and E f^2 = w_f S0 / (4 zeta). The
    noise is narrow-band for a small `zeta`. The strength of w is given as for `WhiteNoise`.

    Parameters
    ----------
    frequency_hz
        Frequency of the resonance, Hz.
    zeta
        Damping ratio of the resonance.

    See Also
    --------
    stochvi.WhiteNoise : Noise that no filter has shaped.
    stochvi.TabulatedNoise : Noise by its density.

    Examples
    --------
    >>> sea = FilteredNoise(intensity=2.0, frequency_hz=0.1, zeta=0.05)
    >>> round(sea.variance, 4)
    6.2832
    """

    effect_word: ClassVar[str] = "filtered noise"
    family: ClassVar[str] = "filtered noise"

    kind: Literal["filtered"] = "filtered"
    frequency_hz: Positive
    zeta: Positive

    @property
    def omega(self) -> float:
        """Resonance w_f of the filter, rad/s."""
        return 2.0 * math.pi * self.frequency_hz

    @property
    def variance(self) -> float:
        """E f^2, in N^2 or (m/s^2)^2."""
        return self.omega * self.si_intensity / (4.0 * self.zeta)

    @cached_property
    def with_density(self) -> TransferFunctionNoise:
        """The same noise by its density, as a cross density needs it."""
        square = self.omega**2
        keys = self.model_dump(exclude={"kind", "frequency_hz", "zeta"}, exclude_none=True)
        denominator = [1.0, 2.0 * self.zeta * self.omega, square]
        return TransferFunctionNoise(**keys, numerator=[square], denominator=denominator)

    def density_for(self, omega: float, damping_rate: float) -> Density:
        return Filter(self.omega, 2.0 * self.zeta * self.omega, self.si_intensity).__call__

    def _remark(self) -> str:
        return (
            f"{super()._remark()}; both are before the filter, a resonance at "
            f"{self.frequency_hz:.4g} Hz with a damping ratio of {self.zeta:.3g}"
        )


# ------------------------------------------------------------------------------
# Roads by the classes of ISO 8608, driven at a constant speed.
# ------------------------------------------------------------------------------


REFERENCE_WAVENUMBER = 0.1
"""Reference wavenumber n0 of ISO 8608, cycles/m."""

ROUGHNESS = {
    "A": 16e-6,
    "B": 64e-6,
    "C": 256e-6,
    "D": 1024e-6,
    "E": 4096e-6,
    "F": 16384e-6,
    "G": 65536e-6,
    "H": 262144e-6,
}
"""Geometric mean of Gd(n0) in each class, m^3: each is four times that of the class before. A class
reaches from half to twice its mean (A has no lower limit, H no upper one). The numbers come from
secondary sources that quote ISO 8608:1995; they were not compared with the standard itself."""

WAVENUMBERS = (0.01, 10.0)
"""Range of wavenumbers, cycles/m, in which a road is taken to be rough. By ISO 8608:2016,
wavenumbers below the first need not be measured on roads; the tyre filters out those above the
second. (Quoted from public previews of the standard.)"""


def velocity_density(roughness: float, speed: float) -> float:
    """One-sided density per hertz, (m/s)^2/Hz, of the vertical velocity of a point that follows
    the road: (2 pi)^2 Gd(n0) n0^2 v at every frequency.

    It follows from Gd(n) = Gd(n0) (n / n0)^-2 (ISO 8608, fitted) with f = n v: the displacement
    has the density Gd(f / v) / v = Gd(n0) n0^2 v / f^2.

    Parameters
    ----------
    roughness
        Gd(n0), m^3.
    speed
        v, m/s.

    Examples
    --------
    >>> round(velocity_density(ROUGHNESS["C"], 20.0), 8)
    0.00202129
    """
    return (2.0 * math.pi * REFERENCE_WAVENUMBER) ** 2 * roughness * speed


def road_table(roughness: float, speed: float, band_hz: tuple[float, float]) -> Table:
    """Density of the vertical acceleration, (m/s^2)^2/Hz: (2 pi f)^2 times that of the velocity."""
    f = np.array(band_hz)
    return Table(
        frequency_hz=f, density=(2.0 * math.pi * f) ** 2 * velocity_density(roughness, speed)
    )


# ------------------------------------------------------------------------------
# Vehicles between a road and a mount: a quarter car as a linear filter of the road.
#
# With the displacements x of body and wheel and z of the road, and the masses m of both
#
#     M x'' + C x' + K x = (0, k_t z + c_t z')        H(w) = (K - w^2 M + i w C)^-1 (0, k_t + i w
#     c_t)
#
# so that the acceleration of body or wheel has the density |H|^2 times that of the road. The mount
# is taken to weigh nothing against the body: it does not act back on the vehicle.
# ------------------------------------------------------------------------------


class Preset(NamedTuple):
    """A quarter car per kilogram of its body (SI units), and where its numbers come from."""

    wheel_mass: float
    suspension_stiffness: float
    suspension_damping: float
    tyre_stiffness: float
    source: str


PRESETS = {
    "golden-car": Preset(
        0.15, 63.3, 6.0, 653.0,
        "the golden car of the International Roughness Index: Sayers, On the calculation of "
        "International Roughness Index from longitudinal road profile, Transportation Research "
        "Record 1501, 1995",
    ),
}  # fmt: skip
"""Known vehicles by name."""

OWN_KEYS = ("wheel_mass", "suspension_stiffness", "suspension_damping", "tyre_stiffness")
"""Keys that a vehicle without a preset needs in addition to `body_mass`."""


class VehicleMode(NamedTuple):
    """A mode of a quarter car: natural frequency, Hz, and damping ratio."""

    frequency_hz: float
    damping_ratio: float


class QuarterCar(Checked):
    """A quarter of a car between road and mount: body and wheel, suspension and tyre.

    The base of the mount is the body, or the wheel. The tyre touches the road in one point and
    never leaves it. The mount does not act back on the vehicle. This holds if the mounted mass is
    small against that of the body or wheel below it; otherwise model the mounted mass, body and
    wheel together as a structure of kind `matrices`.

    Parameters
    ----------
    kind
        "quarter-car".
    preset
        Name of a known vehicle (`PRESETS`); `body_mass` may be given beside it.
    body_mass, wheel_mass
        Masses, kg.
    suspension_stiffness, suspension_damping
        Spring (N/m) and damper (N s/m) between body and wheel.
    tyre_stiffness, tyre_damping
        Spring (N/m) and damper (N s/m) between wheel and road.
    mounted_on
        Part of the vehicle that is the base of the mount: "body" or "wheel".

    See Also
    --------
    stochvi.RoadNoise : What shakes the vehicle.

    Examples
    --------
    >>> golden = QuarterCar(preset="golden-car")
    >>> [round(mode.frequency_hz, 2) for mode in golden.modes]
    [1.24, 10.76]
    >>> round(float(np.abs(golden.gain(0.0))), 12)
    1.0
    """

    kind: Literal["quarter-car"] = "quarter-car"
    preset: Literal["golden-car"] | None = None
    body_mass: Positive | None = None
    wheel_mass: Positive | None = None
    suspension_stiffness: Positive | None = None
    suspension_damping: Positive | None = None
    tyre_stiffness: Positive | None = None
    tyre_damping: NonNegative | None = None
    mounted_on: Literal["body", "wheel"] = "body"

    @model_validator(mode="after")
    def _whole(self) -> Self:
        if self.preset is not None:
            if (extra := given(self, *OWN_KEYS, "tyre_damping")) != "none":
                raise ValueError(
                    f"takes a preset, or parameters of its own, got preset with {extra}; only "
                    "body_mass may stand beside a preset"
                )
        elif missing := [key for key in ("body_mass", *OWN_KEYS) if getattr(self, key) is None]:
            raise ValueError(
                f"needs {', '.join(missing)}, or preset = one of {', '.join(map(repr, PRESETS))}"
            )
        return self

    @property
    def matrices(self) -> tuple[FloatMatrix, FloatMatrix, FloatMatrix]:
        """Mass, damping and stiffness of body and wheel (2, 2), relative to the road."""
        if self.preset is not None:
            known, body = PRESETS[self.preset], self.body_mass or 1.0
            wheel, k, c, tyre = (body * each for each in known[:4])
        else:
            values = (self.body_mass, *(getattr(self, key) for key in OWN_KEYS))
            body, wheel, k, c, tyre = (float(value or 0.0) for value in values)
        tyre_damping = self.tyre_damping or 0.0
        between = np.array([[1.0, -1.0], [-1.0, 1.0]])
        on_wheel = np.diag([0.0, 1.0])
        mass = np.diag([body, wheel])
        return mass, c * between + tyre_damping * on_wheel, k * between + tyre * on_wheel

    @property
    def modes(self) -> tuple[VehicleMode, VehicleMode]:
        """Body and wheel hop, by frequency: |s| / 2 pi and -Re s / |s| of the eigenvalues s of the
        damped motion; where two of them are real, of the geometric and the arithmetic mean."""
        mass, damping, stiffness = self.matrices
        inverse = np.linalg.inv(mass)
        zero, one = np.zeros((2, 2)), np.eye(2)
        values = np.linalg.eigvals(
            np.block([[zero, one], [-inverse @ stiffness, -inverse @ damping]])
        ).astype(complex)
        swinging = [(s.real, abs(s)) for s in values if s.imag > 0.0]
        creeping = np.sort([s.real for s in values if s.imag == 0.0])
        swinging += [
            ((fast + slow) / 2.0, math.sqrt(fast * slow)) for fast, slow in creeping.reshape(-1, 2)
        ]
        body, wheel = sorted(
            VehicleMode(float(size) / (2.0 * math.pi), float(-decay / size))
            for decay, size in swinging
        )
        return body, wheel

    def gain(self, frequency_hz: ArrayLike) -> NDArray[np.complex128]:
        """Complex ratio of the motion of body or wheel to that of the road, at frequencies in Hz;
        the same for displacements and accelerations."""
        mass, damping, stiffness = self.matrices
        s = 2j * np.pi * np.asarray(frequency_hz, dtype=float)
        (a, b), (_, d) = ((entry for entry in row) for row in _entries(s, mass, damping, stiffness))
        road = stiffness.sum() + s * damping.sum()  # what is left of both is the tyre
        moved = (-b if self.mounted_on == "body" else a) * road
        return np.asarray(moved / (a * d - b * b))

    def passed(self, road: Table) -> Table:
        """Density of the acceleration of body or wheel from that of the road, one-sided.

        The breakpoints lie so close that log-log interpolation is off by `TABLE_ERROR` at most.
        """
        return refined_table(lambda f: road(f) * np.abs(self.gain(f)) ** 2, road.frequency_hz)

    def assumptions(self) -> tuple[str, ...]:
        """The assumptions about the vehicle, in words."""
        body, wheel = self.modes
        which = "of its own parameters" if self.preset is None else PRESETS[self.preset].source
        return (
            f"the mount stands on the {self.mounted_on} of a quarter car ({which}): body at "
            f"{body.frequency_hz:.3g} Hz, damping ratio {body.damping_ratio:.2g}, wheel hop at "
            f"{wheel.frequency_hz:.3g} Hz, damping ratio {wheel.damping_ratio:.2g}; linear, the "
            "tyre touches the road in one point and never leaves it",
        )

    def reaction(self, mounted_mass: float | None) -> str:
        """The assumption that the mount does not act back on the vehicle, with the ratio of masses.

        Parameters
        ----------
        mounted_mass
            Mass of all that stands on the vehicle, kg; None if it is not known.
        """
        sentence = "the mount does not act back on the vehicle"
        carrier = float(self.matrices[0][0 if self.mounted_on == "body" else 1].sum())
        if mounted_mass is None or self.body_mass is None:
            return (
                f"{sentence}: its mass is taken to be small against that of the {self.mounted_on} "
                "(give structure.mass and vehicle.body_mass to see their ratio)"
            )
        return (
            f"{sentence}: its mass is {100.0 * mounted_mass / carrier:.2g} % of that of the "
            f"{self.mounted_on}"
        )


def _entries(
    s: NDArray[np.complex128], mass: FloatMatrix, damping: FloatMatrix, stiffness: FloatMatrix
) -> list[list[NDArray[np.complex128]]]:
    """Entries of M s^2 + C s + K, each of the shape of s."""
    return [
        [mass[i, j] * s**2 + damping[i, j] * s + stiffness[i, j] for j in range(2)]
        for i in range(2)
    ]


# ------------------------------------------------------------------------------
# A base that follows a road.
# ------------------------------------------------------------------------------


class RoadNoise(DensityNoise):
    """A base that follows a road of ISO 8608 at a constant speed (see `road_table`).

    Within `band_hz` the density of its vertical velocity is constant, and that of its acceleration
    rises as f^2. The mount stands on the road itself, or on the vehicle of the scene.

    Parameters
    ----------
    road, roughness
        Exactly one: a class, "A" (smooth) to "H", by its geometric mean, or Gd(n0) in m^3.
    speed, speed_kmh
        Exactly one: m/s or km/h.
    band_hz
        Lowest and highest frequency, Hz; by default 0.01 and 10 cycles per metre times the speed.

    See Also
    --------
    stochvi.scenes.QuarterCar : A vehicle between the road and the mount.

    Examples
    --------
    >>> road = RoadNoise(road="C", speed_kmh=72.0, band_hz=[0.5, 50.0])
    >>> round(float(road.table(10.0)), 3), road.table.frequency_hz.tolist()
    (7.98, [0.5, 50.0])
    """

    effect_word: ClassVar[str] = "tabulated noise of a road"

    kind: Literal["road"] = "road"
    on: str | None = BASE
    road: Literal["A", "B", "C", "D", "E", "F", "G", "H"] | None = None
    roughness: Positive | None = None
    speed: Positive | None = None
    speed_kmh: Positive | None = None
    band_hz: Band | None = None
    _road: Table = PrivateAttr()
    _vehicle: QuarterCar | None = PrivateAttr(default=None)

    @model_validator(mode="after")
    def _drive(self) -> Self:
        for names in (("road", "roughness"), ("speed", "speed_kmh")):
            if given(self, *names) not in names:
                raise ValueError(
                    f"needs exactly one of {names[0]} and {names[1]}, got {given(self, *names)}"
                )
        if self.on != BASE:
            raise ValueError(f"moves the base, on = 'base', got on = {self.on!r}")
        low, high = self.band_hz or tuple(n * self.metres_per_second for n in WAVENUMBERS)
        roughness = ROUGHNESS[self.road] if self.road is not None else self.roughness
        assert roughness is not None
        table = road_table(roughness, self.metres_per_second, (low, high))
        self._road = table.scaled(power_ratio(self.level_db))
        self._reach_the_base()  # a scene that takes a road of another one checks it again
        return self

    def _reach_the_base(self) -> None:
        through = self._vehicle
        self._table = self._road if through is None else through.passed(self._road)

    @property
    def metres_per_second(self) -> float:
        """Speed, m/s."""
        if self.speed is not None:
            return self.speed
        assert self.speed_kmh is not None
        return self.speed_kmh / KMH_PER_METRE_PER_SECOND

    def behind(self, vehicle: QuarterCar | None) -> Self:
        """The same road with a vehicle between it and the base; None for no vehicle."""
        found = self.model_copy()
        found._vehicle = vehicle
        found._reach_the_base()
        return found

    def louder(self, level_db: float) -> Self:
        return super().louder(level_db).behind(self._vehicle)

    @property
    def density_unit(self) -> str | None:
        return "(m/s2)2/Hz"

    def assumptions(self, omega: float = 0.0, damping_rate: float = 0.0) -> tuple[str, ...]:
        low, high = self._table.frequency_hz[[0, -1]]
        which = f"class {self.road}" if self.road else f"Gd(n0) = {self.roughness:g} m^3"
        subject = "the base follows" if self._vehicle is None else "the vehicle drives on"
        suspension = ", without a suspension" if self._vehicle is None else ""
        return (
            f"{subject} a road of ISO 8608, {which}, at {self.metres_per_second:.4g} m/s, "
            f"from {low:.3g} to {high:.3g} Hz{suspension}; class table from secondary sources",
            *(() if self._vehicle is None else self._vehicle.assumptions()),
        )

    def cautions(self, omega: float, damping_rate: float, *, alone: bool = True) -> tuple[str, ...]:
        """A warning if the mount stands on the road itself, which shakes it more than any vehicle
        would."""
        if not omega or self.band_hz is not None or self._vehicle is not None:
            return ()
        if not alone and omega < 2.0 * math.pi * SLOWEST_MOUNT:
            return ()
        rms = math.sqrt(self._table.mean_square()) / STANDARD_GRAVITY
        return (
            f"the mount stands on the road itself, with no vehicle between them: {rms:.3g} g rms "
            f"up to {self._table.frequency_hz[-1]:.3g} Hz; tyres and springs pass on little above "
            'some 20 Hz: put a [vehicle] between them (preset = "golden-car", or parameters of its '
            "own), or band_hz around what reaches the mount",
        )

    def facts(self, where: str, numbers: Mapping[str, float]) -> list[tuple[str, ...]]:
        which = f"class {self.road}" if self.road else f"Gd(n0) = {self.roughness:g} m³"
        remark = f"at {self.metres_per_second:.4g} m/s, {band_of(numbers)}"
        if self._vehicle is None:
            remark += "; no vehicle between road and mount"
            return [("Road of ISO 8608", which + self.raised, remark)]
        body, wheel = self._vehicle.modes
        return [
            ("Road of ISO 8608", which + self.raised, remark),
            (
                f"Vehicle, mount on its {self._vehicle.mounted_on}",
                f"quarter car, {self._vehicle.preset or 'parameters of its own'}",
                f"body {body.frequency_hz:.3g} Hz, damping ratio {body.damping_ratio:.2g}; wheel "
                f"hop {wheel.frequency_hz:.3g} Hz, damping ratio {wheel.damping_ratio:.2g}",
            ),
        ]


KMH_PER_METRE_PER_SECOND = 3.6
"""Speed of 1 m/s in km/h."""


SLOWEST_MOUNT = 4.0
"""Lowest natural frequency from which on a structure holds no vehicle, Hz: bodies of vehicles move
on their springs at 1 to 2 Hz."""


# ------------------------------------------------------------------------------
# Spectra that `stochvi spectrum --out` wrote, as the excitation of another scene.
# ------------------------------------------------------------------------------


HEADING = ("of", "quantity", "frequency_hz", "value", "standard_error", "unit")
"""Names of the columns of a `spectrum.csv` that are read; the file has more columns."""

QUANTITY = "acceleration"
"""Quantity in the file that excites a mount on a mass: the absolute acceleration of the mass."""


class EstimatedDensity(NamedTuple):
    """A density that was estimated by simulation, and a sentence about its error."""

    columns: Columns
    error: str


def is_response_spectrum(path: Path) -> bool:
    """Whether a file begins as a `spectrum.csv` does; False for what cannot be read."""
    if not path.is_file():  # reading a pipe would wait for its writer
        return False
    try:
        with path.open(encoding="utf-8-sig") as file:
            cells = next(csv.reader([file.readline(1000)]), [])
    except (OSError, ValueError, csv.Error):
        return False
    return set(HEADING) <= set(cells)


def read_response_spectrum(path: Path, of: str | None) -> EstimatedDensity:
    """The density of the absolute acceleration of a coordinate, (m/s^2)^2/Hz.

    Parameters
    ----------
    path
        A `spectrum.csv`.
    of
        Name of the coordinate; None if the file holds only one.

    Raises
    ------
    SceneError
        If the file is no such table, or does not hold the acceleration of that coordinate.
    """
    if not is_response_spectrum(path):
        raise SceneError(
            "of",
            f"chooses a coordinate of a spectrum.csv that `stochvi spectrum --out` wrote, "
            f"got {path.name} without its columns {', '.join(HEADING)}; column = chooses one of "
            "another table",
        )
    try:
        table = list(csv.DictReader(decoded(path, LARGEST_DATA_FILE).splitlines()))
    except csv.Error as reason:
        raise SceneError("file", f"{path} cannot be read: {reason}; write it again") from None
    owners = list(dict.fromkeys(row["of"] for row in table if row["quantity"] == QUANTITY))
    if not owners:
        raise SceneError(
            "file",
            f"{path} holds no absolute acceleration: the spectra of a scene have none "
            "where a force acts on a mass; use the spectra of a scene whose base alone moves",
        )
    of = None if of is None else as_text(of)
    if of is None and len(owners) > 1:
        raise SceneError("of", f"must say whose acceleration is meant: {_listed(owners)}")
    if of is not None and of not in owners:
        raise SceneError("of", f"must be {_listed(owners)}, got {of!r}")
    chosen = [
        row for row in table if row["of"] == (of or owners[0]) and row["quantity"] == QUANTITY
    ]
    try:
        frequency, density, error = (
            np.array([float(row[name]) for row in chosen])
            for name in ("frequency_hz", "value", "standard_error")
        )
        stated = unit(chosen[0]["unit"])
    except (TypeError, ValueError) as reason:
        raise SceneError(
            "file", f"{path} holds a row with a text in place of a number: {reason}"
        ) from None
    known = density > 0.0
    relative = 100.0 * float(np.median(error[known] / density[known])) if known.any() else 0.0
    whole = 100.0 * float(error.sum() / density.sum()) if known.any() else 0.0
    return EstimatedDensity(
        Columns(x=frequency, y=density, unit=stated, stated_in=path.name),
        f"it is the acceleration of {of or owners[0]}, estimated by simulation: {relative:.2g} % "
        f"standard error at a frequency (median), less than {whole:.2g} % of the mean square; the "
        "intervals of results computed from it do not include that, nor a motion that is not "
        "Gaussian",
    )


def _listed(names: list[str]) -> str:
    return " or ".join(repr(name) for name in names)


# ------------------------------------------------------------------------------
# Noise of a tabulated density.
# ------------------------------------------------------------------------------


class TabulatedNoise(DensityNoise):
    """Gaussian noise with a tabulated one-sided density per hertz, zero outside the table.

    Between breakpoints log density is linear in log frequency; a frequency that stands twice is a
    step. Give one of `profile`, `file` and `frequency_hz` with `density`.

    Parameters
    ----------
    profile
        Name of a table that ships (`stochvi profiles`), in g^2/Hz.
    file
        A text file, a UFF file with a dataset 58, or a MATLAB or NumPy file. It may also be the
        `spectrum.csv` that `stochvi spectrum --out` wrote for another scene.
    values
        Instead of a file, in Python: a Series or frame with frequencies as its index, or columns in
        an array or a dictionary. It becomes `frequency_hz` and `density`.
    column
        Name of the column of densities in a text file or in `values`, or its number from 1, if
        there are more than two columns.
    of
        For a `spectrum.csv`: the coordinate of the other scene whose absolute acceleration is used.
    variables
        Names of the two vectors of a MATLAB or NumPy file, or of its matrix of two columns, if
        several fit.
    dataset
        Number of the dataset of a UFF file, from 1, if several fit.
    frequency_hz
        Breakpoints, increasing, Hz.
    density
        One-sided density at each breakpoint, in `unit`; straight between them on logarithmic axes,
        and zero outside the table.
    unit
        Unit of the densities: "g2/Hz" or "(m/s2)2/Hz" on the base, "N2/Hz" on a mass, in any
        spelling, or decibels, as "dB re 1 g2/Hz". It may be left out if the file states the unit;
        if both are given, they must agree.

    Raises
    ------
    SceneError
        If the table cannot be read, its unit is missing or contradicted, or a density is negative.

    See Also
    --------
    stochvi.scenes.profiles : The densities that ship.
    stochvi.RecordedNoise : Noise of a measured record.

    Examples
    --------
    >>> truck = TabulatedNoise(on="base", profile="mil-std-810h-truck-vertical-5hz")
    >>> round(truck.table.mean_square() ** 0.5 / 9.80665, 4)
    1.0783
    """

    effect_word: ClassVar[str] = "tabulated noise"

    kind: Literal["psd"] = "psd"
    profile: str | None = None
    file: str | None = None
    values: Values | None = None
    column: ColumnName | None = None
    of: str | None = None
    variables: Names | None = None
    dataset: Count | None = None
    frequency_hz: Column | None = None
    density: Numbers | None = None
    unit: DensityOrLevelUnit | None = None
    _unit: Unit = PrivateAttr()
    _notes: tuple[str, ...] = PrivateAttr(default=())
    _doubts: tuple[str, ...] = PrivateAttr(default=())

    @model_validator(mode="before")
    @classmethod
    def _from_values(cls, keys: Any) -> Any:
        return with_breakpoints(keys, DENSITIES)

    @model_validator(mode="after")
    def _read(self) -> Self:
        inline = self.frequency_hz is not None or self.density is not None
        if (self.profile is not None) + (self.file is not None) + inline != 1:
            raise ValueError(
                "needs exactly one of profile, file, and frequency_hz with density, "
                f"got {given(self, 'profile', 'file', 'frequency_hz', 'density')}"
            )
        choices = given(self, "column", "of", "variables", "dataset")
        if self.file is None and choices != "none":
            raise ValueError(f"has {choices} without a file")
        if self.profile is not None and self.unit not in (None, "g2/Hz"):
            raise ValueError(f"has unit {self.unit!r}, but shipped profiles are in 'g2/Hz'")
        columns = self._columns()
        self._unit = agreed_unit(self.unit, columns, DENSITIES)
        self._doubts += unread_unit(columns, self._unit)
        if self.file is not None:
            with sentences_of("file"):
                columns, notes = cleaned(columns, Path(self.file), self._unit.decibels)
            stated = f"its unit, {self._unit.name}, is the one that {columns.stated_in} states"
            self._notes = ((stated,) if columns.unit and not self.unit else ()) + notes
        elif not self._unit.decibels and self.density is not None:
            for row, value in enumerate(self.density):
                if value <= 0.0:
                    sentence = f"must be greater than 0, got {value!r}"
                    raise SceneError(f"density.{row}", sentence)
        assert columns.x is not None
        try:
            density = self._unit.to_si(columns.y) * power_ratio(self.level_db)
            self._table = Table(frequency_hz=columns.x, density=density)
        except ValueError as error:
            where = "" if self.file is None else f"{self.file} "
            raise SceneError("" if self.file is None else "file", f"{where}{error}") from None
        return self

    def _columns(self) -> Columns:
        """Frequencies, densities, and the unit that their source states."""
        if self.profile is not None:
            if self.profile not in profiles():
                raise ValueError(
                    f"has the unknown profile {self.profile!r}; known: {', '.join(profiles())}"
                )
            shipped = profiles()[self.profile]
            return Columns(
                x=np.array(shipped.frequency_hz), y=np.array(shipped.density), unit=unit("g2/Hz")
            )
        if self.file is not None:
            with sentences_of("file"):
                if self.of is not None or is_response_spectrum(Path(self.file)):
                    found = read_response_spectrum(Path(self.file), self.of)
                    self._doubts = (found.error,)
                    return found.columns
                return read_columns(
                    Path(self.file), ("frequency_hz", "density"), column=self.column,
                    variables=self.variables, dataset=self.dataset,
                )  # fmt: skip
        if self.frequency_hz is None or self.density is None:
            raise ValueError(
                "needs frequency_hz and density together, got "
                f"{given(self, 'frequency_hz', 'density')}"
            )
        return Columns(x=np.array(self.frequency_hz), y=np.array(self.density))

    @property
    def density_unit(self) -> str | None:
        return self._unit.name

    def assumptions(self, omega: float = 0.0, damping_rate: float = 0.0) -> tuple[str, ...]:
        """Notes on what was read from the file besides the numbers, and on rows left out."""
        name = Path(self.file or "").name
        return tuple(f"table {name}: {note}" for note in self._notes)

    def cautions(self, omega: float, damping_rate: float, *, alone: bool = True) -> tuple[str, ...]:
        """Warnings on the error of a density that was estimated by simulation, and on a text that
        looks like a unit but is unknown."""
        return tuple(f"table {Path(self.file or '').name}: {note}" for note in self._doubts)

    def numbers(self) -> dict[str, float]:
        stated = {}
        if self.profile is not None:
            stated["stated_g_rms"] = profiles()[self.profile].stated_g_rms
        return stated | super().numbers()

    def facts(self, where: str, numbers: Mapping[str, float]) -> list[tuple[str, ...]]:
        name = f"Tabulated noise on {where}"
        if self.profile is not None:
            source = f"source: {profiles()[self.profile].source}"
            return [
                (name, self.profile + self.raised, source),
                ("Stated by its source", f"{numbers['stated_g_rms']:.4g} g rms", "at 0 dB"),
            ]
        source = "breakpoints in the scene" if self.file is None else self.file
        points = f"{numbers['points']:g} points in {self.density_unit}, {band_of(numbers)}"
        return [(name, Path(source).name + self.raised, points)]


def with_breakpoints(keys: Any, quantities: tuple[str, ...]) -> Any:
    """The keys of a density with the breakpoints of its `values` in their place.

    `quantities` are those of its unit, none for the density of a relative change.
    """
    if not isinstance(keys, dict) or keys.get("values") is None:
        return keys
    for other in ("profile", "file", "frequency_hz", "density"):
        if keys.get(other) is not None:
            raise ValueError(f"takes values or {other}, got both")
    _, frame = source_of(keys) or ("", Path())
    kept = {name: value for name, value in keys.items() if name not in ("values", "column")}
    with sentences_of("values"):
        columns = read_columns(frame, ("frequency_hz", "density"), column=keys.get("column"))
        known = agreed_unit(keys.get("unit"), columns, quantities) if quantities else None
        if columns.unit is not None and known is None:
            raise SceneError(OF_CHANGE.format(frame, columns.unit.name))
        for doubt in () if known is None else unread_unit(columns, known):
            warnings.warn(f"values: {doubt}", InputWarning, stacklevel=2)
        columns, _ = cleaned(columns, frame, known is not None and known.decibels)
    stated = {} if known is None else {"unit": known.name}
    return kept | stated | {"frequency_hz": columns.x, "density": columns.y}


OF_CHANGE = (
    "{} must hold the density of a relative change (1/Hz), got {}; leave the unit out of its "
    "heading if it is none"
)
"""The refusal of a density with a unit."""


def cleaned(
    columns: Columns, path: Path | Frame, decibels: bool
) -> tuple[Columns, tuple[str, ...]]:
    """Rows of a file as a table needs them, and notes on what was changed.

    Rows in descending order are reversed. Rows with the density 0 at either end are left out. From
    a row at 0 Hz a straight line leads to the next one. Where that row is so high that it is the
    offset of a sensor, it is left out. One of two equal rows is dropped.

    Raises
    ------
    SceneError
        If a value is missing, negative or out of order, or a density between others is 0. The
        message names the line.
    """
    assert columns.x is not None
    frequency, density, order = columns.x, columns.y, np.arange(len(columns.y))
    notes = []

    def refuse(row: int, sentence: str) -> SceneError:
        return SceneError(f"{path}, {columns.place(int(order[row]))}: {sentence}")

    for name, values in (("frequency_hz", frequency), ("density", density)):
        if not np.all(np.isfinite(values)):
            row = int(np.argmin(np.isfinite(values)))
            raise refuse(
                row, f"needs positive finite values of {name}, got nan; fill it in or take it out"
            )
    if np.all(np.diff(frequency) <= 0.0) and frequency[0] > frequency[-1]:
        order = order[::-1]
        notes.append("its rows are in descending order and were reversed")
    frequency, density = frequency[order], density[order]
    if np.any(np.diff(frequency) < 0.0):
        row, remedy = out_of_order(frequency, "keep one table")
        raise refuse(
            row,
            "needs increasing frequency_hz (twice the same for a step), got "
            f"{frequency[row - 1]:g} before {frequency[row]:g}; {remedy}",
        )
    for name, values, remedy in (
        ("frequency_hz", frequency, "take out the line"),
        ("density", density, "say unit = 'dB re 1 g2/Hz', with their reference, if it is a level"),
    ):
        wrong = (values < 0.0) & (name == "frequency_hz" or not decibels)
        if wrong.any():
            row = int(np.argmax(wrong))
            got = f"needs positive finite values of {name}, got {values[row]:g}"
            raise refuse(row, f"{got}; {remedy}")
    if line := _from_zero(frequency, density, decibels):
        notes.append(
            f"between 0 and {frequency[1]:g} Hz its density is a straight line on linear axes"
        )
        places, heights = line
        frequency = np.concatenate([places, frequency[1:]])
        density = np.concatenate([heights, density[1:]])
        order = np.concatenate([np.full(len(places), order[0]), order[1:]])
    held = (frequency > 0.0) & (decibels | (density > 0.0))
    if not held.any():
        raise SceneError(f"{path} needs positive finite values of density, got none")
    first, last = int(np.argmax(held)), len(held) - 1 - int(np.argmax(held[::-1]))
    if not held[first : last + 1].all():
        row = first + int(np.argmin(held[first : last + 1]))
        raise refuse(
            row,
            f"the density is 0 at {frequency[row]:g} Hz, between others above 0: a table is "
            "interpolated in logarithms, which never reach 0; give the parts as two excitations",
        )
    if left := len(held) - (last + 1 - first):
        notes.append(
            f"{left} {'row' if left == 1 else 'rows'} without density or frequency at its ends "
            f"{'was' if left == 1 else 'were'} left out: it reaches from {frequency[first]:g} to "
            f"{frequency[last]:g} Hz"
        )
    kept = np.arange(first, last + 1)
    same = (np.diff(frequency[kept]) == 0.0) & (np.diff(density[kept]) == 0.0)
    kept = kept[np.append(True, ~same)]
    thrice = frequency[kept[2:]] == frequency[kept[:-2]]
    if thrice.any():
        row = int(kept[2:][np.argmax(thrice)])
        raise refuse(
            row,
            f"{frequency[row]:g} Hz appears three times, expected at most twice, for the densities "
            "below and above a step; take out the row between",
        )
    steps = frequency[kept[1:]][np.diff(frequency[kept]) == 0.0]
    if len(steps):
        notes.append(f"it has a step at {', '.join(f'{step:g}' for step in steps)} Hz")
    found = Columns(
        x=frequency[kept], y=density[kept], unit=columns.unit, stated_in=columns.stated_in
    )
    return found, tuple(notes)


def _from_zero(frequency: Vector, density: Vector, decibels: bool) -> tuple[Vector, Vector] | None:
    """Breakpoints of a straight line from a row at 0 Hz to the next one, which a table on
    logarithmic axes cannot begin with; None where there is no such row, or it is an offset."""
    if len(frequency) < 2 or frequency[0] != 0.0 or frequency[1] == 0.0:
        return None
    first, following = 10.0 ** (density[:2] / 10.0) if decibels else density[:2]
    if not 0.0 <= first <= OFFSET * following or not following:
        return None
    share = np.geomspace(NEAR_ZERO, 1.0, POINTS_FROM_ZERO)[:-1]
    heights = first + share * (following - first)
    return share * frequency[1], 10.0 * np.log10(heights) if decibels else heights


NEAR_ZERO, POINTS_FROM_ZERO = 1e-3, 101
"""Where the line from 0 Hz begins, by the next frequency, and number of points on it: a thousandth
of its area is left out, and pieces on logarithmic axes follow it to 2e-4 between the points."""

OFFSET = 10.0
"""Ratio of the density at 0 Hz to the next one from which it is the square of an offset, and not
motion."""


# ------------------------------------------------------------------------------
# A stiffness, a damping or a clearance that changes in time.
# ------------------------------------------------------------------------------


WIDEST = 0.2
"""Largest standard deviation of the relative change of a clearance, which stays above 0."""


def _form(value: Any) -> str:
    return "[]" if np.ndim(value) else ""


FrequencyOrColumn = Annotated[
    Annotated[Positive, Tag("")] | Annotated[Column, Tag("[]")], Discriminator(_form)
]
"""One frequency, or those of a table, Hz."""


class Modulation(BaseExcitation):
    """A relative change xi(t) of a stiffness, damping or clearance, as k (1 + xi(t)).

    It is a sine of `amplitude` and `frequency_hz`; white noise of `intensity`; with `frequency_hz`
    and `zeta` as well, that noise after a resonance, as `FilteredNoise` has it; or Gaussian noise
    of a tabulated density, as `TabulatedNoise` has it.

    White noise is meant in the sense of Stratonovich: it is the limit of noise of a wide band. For
    a stiffness, Ito means the same. For a damping c he has c + c^2 intensity / (2 m) in the mean,
    where Stratonovich has c.

    Parameters
    ----------
    of
        What changes: "stiffness" or "damping" of the linear structure, or "clearance": the stops
        move, and their distance from the unloaded spring changes.
    on, between
        Where there are several coordinates: the one whose spring and damper to the ground change,
        or the two between which they act. Mounts of a box are "mount 1", "mount 2" and so on, in
        their order. For a clearance `on` is the name of the impact pair, where there are several.
    axis
        Axis of the mount of a box along which its spring or damper changes.
    amplitude
        Peak of xi of a sine, whose phase is random in each path.
    frequency_hz
        Frequency of the sine, or of the resonance, Hz; or the breakpoints of a table.
    intensity
        S of E xi(t) xi(t + tau) = S delta(tau), s; half of a one-sided density in 1/Hz.
    zeta
        Damping ratio of the resonance.
    density
        One-sided density of xi at each breakpoint, 1/Hz; straight between them on logarithmic axes,
        and zero outside the table.
    file, values
        Instead of `frequency_hz` and `density`: a file with these two columns, or in Python the
        numbers, as `stochvi.TabulatedNoise` takes them.

    See Also
    --------
    stochvi.growth : Whether the motion without stops grows.

    Examples
    --------
    >>> Modulation(of="stiffness", amplitude=0.3, frequency_hz=2.0).source
    'a sine'
    >>> slow = Modulation(of="stiffness", intensity=0.01, frequency_hz=2.0, zeta=0.5)
    >>> slow.source, round(slow.size, 3)
    ('filtered noise', 0.251)
    """

    family: ClassVar[str] = "modulation"
    shakes: ClassVar[bool] = False

    kind: Literal["modulation"] = "modulation"
    of: Literal["stiffness", "damping", "clearance"]
    on: str | None = None
    amplitude: Positive | None = None
    frequency_hz: FrequencyOrColumn | None = None
    intensity: Positive | None = None
    zeta: Positive | None = None
    density: Column | None = None
    file: str | None = None
    values: Values | None = None
    _table: Table | None = PrivateAttr(default=None)

    @model_validator(mode="before")
    @classmethod
    def _from_values(cls, keys: Any) -> Any:
        return with_breakpoints(keys, ())

    @model_validator(mode="after")
    def _one_source(self) -> Self:
        keys = given(self, *KEYS)
        if keys not in SOURCES or isinstance(self.frequency_hz, tuple) != (
            self.density is not None
        ):
            raise ValueError(
                "needs amplitude and frequency_hz (a sine), intensity (white noise), lists of "
                "frequency_hz and density or a file (a table), or intensity, frequency_hz and zeta "
                f"(filtered noise), got {keys}"
            )
        self._table = self._read()
        if given(self, "weights", "name") != "none":
            raise ValueError(f"takes no {given(self, 'weights', 'name')}")
        if self.of == "clearance" and given(self, "between", "axis") != "none":
            got = given(self, "between", "axis")
            raise ValueError(f"takes the name of the pair in on for a clearance, got {got}")
        if self.of == "clearance" and not self.size <= WIDEST:
            raise ValueError(
                "needs frequency_hz and a standard deviation of at most "
                f"{WIDEST:g} for a clearance, got {self.source} of {self.size:.3g}"
            )
        return self

    def _read(self) -> Table | None:
        """The table of the density; None without one."""
        if self.file is None:
            if self.density is None:
                return None
            try:
                return Table(
                    frequency_hz=np.array(self.frequency_hz), density=np.array(self.density)
                )
            except ValueError as error:
                raise SceneError(str(error)) from None
        path = Path(self.file)
        with sentences_of("file"):
            columns, _ = cleaned(read_columns(path, ("frequency_hz", "density")), path, False)
            if columns.unit is not None:
                raise SceneError(OF_CHANGE.format(path, columns.unit.name))
        assert columns.x is not None
        return Table(frequency_hz=columns.x, density=columns.y)

    @property
    def table(self) -> Table | None:
        """One-sided density of the relative change, 1/Hz; None if it is no table."""
        return self._table

    @property
    def source(self) -> str:
        """What the relative change is, in words."""
        return SOURCES[given(self, *KEYS)]

    @property
    def effect_word(self) -> str:  # type: ignore[override]
        """Name of the modulation in the effects of a scene."""
        return f"modulation of {self.of} by {self.source}"

    @property
    def omega(self) -> float:
        """Frequency of the sine or of the resonance, rad/s; 0 of white noise and of a table."""
        return 2.0 * math.pi * (self.frequency_hz if isinstance(self.frequency_hz, float) else 0.0)

    @property
    def filter(self) -> Filter | None:
        """The resonance; None of a sine, and of white noise."""
        if self.zeta is None or self.intensity is None:
            return None
        return Filter(self.omega, 2.0 * self.zeta * self.omega, self.intensity)

    @property
    def size(self) -> float:
        """Standard deviation of the relative change; infinite of white noise."""
        if self.amplitude is not None:
            return self.amplitude / math.sqrt(2.0)
        if self.table is not None:
            return math.sqrt(self.table.mean_square())
        if self.zeta is None or self.intensity is None:
            return math.inf
        return math.sqrt(self.omega * self.intensity / (4.0 * self.zeta))

    def louder(self, level_db: float) -> Self:
        """The same modulation, which belongs to the structure and not to what shakes it."""
        return self

    def facts(self, where: str, numbers: Mapping[str, float]) -> list[tuple[str, ...]]:
        keys = ("amplitude", "intensity", "frequency_hz", "zeta")
        numbers_of = {key: value for key in keys if isinstance(value := getattr(self, key), float)}
        stated = [f"{key} {value:g}" for key, value in numbers_of.items()]
        if self.table is not None:
            low, high = self.table.frequency_hz[[0, -1]]
            stated = [f"{low:g} to {high:g} Hz, standard deviation {self.size:.4g}"]
        name = self.effect_word
        return [(f"{name[0].upper()}{name[1:]} on {where}", ", ".join(stated), "relative change")]


KEYS = ("amplitude", "frequency_hz", "intensity", "zeta", "density", "file")
"""Keys that say what a relative change is."""

SOURCES = {
    "amplitude, frequency_hz": "a sine",
    "intensity": "white noise",
    "frequency_hz, intensity, zeta": "filtered noise",
    "frequency_hz, density": "tabulated noise",
    "file": "tabulated noise",
}
"""Words for what a relative change is, by the keys that are given."""
