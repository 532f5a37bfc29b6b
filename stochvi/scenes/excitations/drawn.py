"""Excitations whose values a simulation draws in the course of a path. Chapters: the base class;
pulses at random times; a function of one's own."""

from __future__ import annotations

import math
import warnings
from abc import abstractmethod
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np
from pydantic import AfterValidator, BeforeValidator, PrivateAttr, field_serializer, model_validator

from stochvi.mathematics.numerics import Vector
from stochvi.mathematics.spectra import Table
from stochvi.mathematics.units import ACCELERATION, FORCE, Unit, power_ratio, shown
from stochvi.mathematics.units import unit as unit_of
from stochvi.mathematics.unsteady_noise import SHAPES, PulseShape
from stochvi.notices import InputWarning
from stochvi.results.errors import SceneError
from stochvi.scenes.excitations.base import (
    BASE,
    BaseExcitation,
    Density,
    agreed_unit,
    unit_name,
    unread_unit,
)
from stochvi.scenes.frames import Frame, Values
from stochvi.scenes.records import read_record
from stochvi.scenes.validation import (
    ColumnName,
    Function,
    Positive,
    Seconds,
    _name_of,
    arguments_fault,
    given,
    sentences_of,
)


class DrawnExcitation(BaseExcitation):
    """Base of random excitations that are not Gaussian. A simulation draws their values.

    Step, burn-in and start of a simulation are those of white noise of the same mean and of the
    intensity `si_intensity`.
    """

    white: ClassVar[bool] = False
    """Whether values at different times are independent of each other."""

    kind: Any
    on: str | None = None

    @property
    @abstractmethod
    def mean(self) -> float:
        """Mean force, N, or mean acceleration of the base, m/s^2."""

    @property
    @abstractmethod
    def si_intensity(self) -> float:
        """Intensity S0 of white noise that shakes as much, N^2 s or (m/s^2)^2 s."""

    @property
    @abstractmethod
    def fastest(self) -> float:
        """Fastest rate that steps must resolve, 1/s; 0 for none."""

    @property
    def jump(self) -> float:
        """Rms size of sudden changes of momentum, N s, or of the speed of the base, m/s; 0 for a
        force that is finite."""
        return 0.0

    @abstractmethod
    def compiled(self, mass: float) -> Any:
        """The drive of kernels, a class of `engine.characteristics`, per unit of a mass, kg."""

    def density_for(self, omega: float, damping_rate: float) -> Density:
        return lambda frequency_hz: np.full(np.shape(frequency_hz), 2.0 * self.si_intensity)


# ------------------------------------------------------------------------------
# Pulses at random times: impulses, or shocks of a shape.
# ------------------------------------------------------------------------------


MOST_IN_A_STEP = 100.0
"""Mean number of pulses in a step above which the step is shortened."""

PER_HOUR = "/h"
"""End of a text that is a number of pulses per hour."""

LINES, LEAST = 2000, 1e-12
"""Lines of the density of shaped pulses, and its smallest value over the largest one."""

FEWEST_SAMPLES = 4
"""Smallest number of samples of a measured pulse."""

VALUES = "acceleration", "force"
"""Quantities of a measured pulse."""


SELDOM = 0.1
"""Rate of pulses, 1/s, below which they are told by the hour."""


def _per_second(value: Any) -> Any:
    """A text such as "12/h", pulses per hour, as pulses per second."""
    if not isinstance(value, str):
        return value
    try:
        number = float(value.strip().removesuffix(PER_HOUR))
    except ValueError:
        raise ValueError(f'must be a number per second, or as "12/h", got {shown(value)}') from None
    return number / 3600.0 if value.strip().endswith(PER_HOUR) else value


def _value_unit(name: str) -> str:
    return unit_name(name, *VALUES)


class Pulses(DrawnExcitation):
    """Impulses J, or shocks of a shape, at the independent times of a Poisson process.

    A mass m gains the velocity J / m at each impulse. The force has the mean rate E J and, about
    it, the density of white noise of the intensity S0 = rate E J^2. The response of a linear
    structure has the cumulants kappa_n = rate E J^n int h(t)^n dt of its response h to a unit
    impulse (Campbell 1909, Rice 1944). For shocks a stands for J, their peak, and the response to a
    shock of unit peak for h.

    Parameters
    ----------
    rate
        Mean number of pulses per second, or a text, "12/h".
    impulse
        Size of an impulse, N s on a mass, m/s of the base: of each, or the mean of exponential
        sizes, or the rms value of normal ones.
    shape, duration
        Instead of impulses, shocks: "half-sine", "saw-tooth" (which ends at its peak) or
        "trapezoid" (with ramps of a tenth), and their length, s, or a text, "11 ms".
    file, values, fs, column
        Instead of a shape: a measured pulse, in a file, or in Python as numbers, as
        `stochvi.RecordedNoise` takes them. Its sampling rate if it has no times; its column if it
        has several.
    unit
        Unit of the values of a file, or of the amplitude of a shape, as "g"; there by default SI.
    amplitude
        Peak of a shock, N on a mass, m/s^2 of the base, with the distribution of `sizes`. It may be
        left out with a file, whose own peak it then is.
    sizes
        Distribution of the sizes: "equal", "normal" (absolute values of a normal number) or
        "exponential".
    two_sided
        Whether every pulse has either direction with equal probability; otherwise all act in the
        positive direction, or as measured.

    See Also
    --------
    stochvi.WhiteNoise : The limit of many small pulses.
    stochvi.replay : One shock, as measured.

    Examples
    --------
    >>> gravel = Pulses(rate=20.0, impulse=0.1, sizes="exponential", two_sided=False)
    >>> round(gravel.mean, 12), round(gravel.si_intensity, 12)
    (2.0, 0.4)
    >>> [round(gravel.moment(n), 6) for n in (1, 2, 3, 4)]
    [0.1, 0.02, 0.006, 0.0024]
    >>> shocks = Pulses(rate="12/h", shape="half-sine", duration="11 ms", amplitude=200.0)
    >>> round(shocks.rate, 5), round(shocks.shock.area, 5)
    (0.00333, 0.007)
    """

    effect_word: ClassVar[str] = "pulses"
    family: ClassVar[str] = "pulses"
    white: ClassVar[bool] = True

    kind: Literal["pulses"] = "pulses"
    rate: Annotated[Positive, BeforeValidator(_per_second)]
    impulse: Positive | None = None
    shape: Literal["half-sine", "saw-tooth", "trapezoid"] | None = None
    duration: Seconds | None = None
    file: str | None = None
    values: Values | None = None
    unit: Annotated[str, AfterValidator(_value_unit)] | None = None
    fs: Positive | None = None
    column: ColumnName | None = None
    amplitude: Positive | None = None
    sizes: Literal["equal", "normal", "exponential"] = "equal"
    two_sided: bool = True
    _shock: PulseShape | None = PrivateAttr(default=None)
    _unit: Unit | None = PrivateAttr(default=None)

    @model_validator(mode="after")
    def _one_form(self) -> Self:
        form = given(self, "impulse", "shape", "file", "values")
        if form not in ("impulse", "shape", "file", "values"):
            raise ValueError(f"needs exactly one of impulse, shape, file and values, got {form}")
        of_form = {
            "impulse": (), "shape": ("duration", "amplitude", "unit"),
            "file": ("amplitude", "unit", "fs", "column"),
            "values": ("amplitude", "unit", "fs", "column"),
        }  # fmt: skip
        keys = given(self, "duration", "amplitude", "unit", "fs", "column").split(", ")
        if wrong := [key for key in keys if key not in (*of_form[form], "none")]:
            raise ValueError(f"has {wrong[0]}, which does not go with {form}")
        if self.shape is not None:
            if self.duration is None or self.amplitude is None:
                raise ValueError(
                    "needs duration and amplitude with shape, got "
                    f"{given(self, 'duration', 'amplitude')}"
                )
            self._shock = PulseShape(SHAPES[self.shape], self.duration)
            self._unit = None if self.unit is None else unit_of(self.unit)
        elif self.impulse is None:
            self._read(form, self.values or Path(str(self.file)))
        return self

    def _read(self, key: str, source: Path | Frame) -> None:
        """Take the pulse from its file or values, with a sample of 0 before it and after it."""
        with sentences_of(key):
            record, columns = read_record(
                source, fs=self.fs, column=self.column, fewest=FEWEST_SAMPLES
            )
            self._unit = agreed_unit(self.unit, columns, VALUES)
            for doubt in unread_unit(columns, self._unit):
                warnings.warn(f"pulse of {source}: {doubt}", InputWarning, stacklevel=2)
        known = self._unit.factor * (record.values + record.mean)
        values = np.concatenate([[0.0], known, [0.0]])
        self._shock = PulseShape(values, (len(values) - 1) / record.fs)

    @property
    def density_unit(self) -> str | None:
        """The unit of a density that belongs to the values of a file; None without one."""
        if self._unit is None:
            return None
        return "N2/Hz" if self._unit.quantity == "force" else "(m/s2)2/Hz"

    @property
    def _amplitude_factor(self) -> float:
        """The amplitude in SI units over the number that is given, which is 1 with a file."""
        return 1.0 if self.shape is None or self._unit is None else self._unit.factor

    @property
    def shock(self) -> PulseShape | None:
        """The shape of a shock, whose values are over `size`; None for impulses."""
        return self._shock

    @property
    def of_its_rate(self) -> str:
        """What answers take the rate of shocks for, in a sentence; empty for impulses."""
        if self._shock is None:
            return ""
        return (
            f"shocks come at {3600.0 * self.rate:.3g} an hour, which is taken as exact: intervals "
            "leave out how well it is known"
        )

    @property
    def size(self) -> float:
        """What the size of a pulse is over: its impulse, or the peak of a shock over that of its
        shape."""
        if self.impulse is not None:
            return self.impulse
        assert self._shock is not None
        if self.amplitude is None:
            return 1.0
        return self._amplitude_factor * self.amplitude / self._shock.peak

    def moment(self, order: int) -> float:
        """Mean of the power `order` of a pulse, E J^n, or of the peak of a shock, E a^n.

        Parameters
        ----------
        order
            n, from 1.

        Returns
        -------
        float
            (N s)^n, or (m/s)^n of the base; N^n, or (m/s^2)^n of shocks.
        """
        peak = 1.0 if self._shock is None else self._shock.peak
        return self.relative_moment(order) * (self.size * peak) ** order

    def relative_moment(self, order: int) -> float:
        """Mean of the power `order` of the size of a pulse over `size`."""
        if self.two_sided and order % 2:
            return 0.0
        n = order
        if self.sizes == "exponential":
            return math.gamma(n + 1.0)
        if self.sizes == "normal":
            return float(2.0 ** (n / 2.0) * math.gamma((n + 1.0) / 2.0) / math.sqrt(math.pi))
        return 1.0

    def drawn_sizes(self, count: int, random: np.random.Generator) -> Vector:
        """Sizes of so many pulses over `size`, with their directions."""
        drawn: Vector = np.ones(count)
        if self.sizes == "normal":
            drawn = np.abs(random.standard_normal(count))
        elif self.sizes == "exponential":
            drawn = random.standard_exponential(count)
        directions = random.choice([-1.0, 1.0], count) if self.two_sided else 1.0
        return np.asarray(drawn * directions)

    @property
    def _area(self) -> float:
        """Integral of a pulse over its size, s; 1 for impulses."""
        return 1.0 if self._shock is None else self._shock.area

    @property
    def mean(self) -> float:
        """Mean force, rate E J, N, or acceleration of the base, m/s^2."""
        return self.rate * self.relative_moment(1) * self.size * self._area

    @property
    def si_intensity(self) -> float:
        """S0 = rate E J^2 at low frequencies, N^2 s or (m/s^2)^2 s."""
        return self.rate * self.relative_moment(2) * (self.size * self._area) ** 2

    @property
    def fastest(self) -> float:
        return self.rate / MOST_IN_A_STEP

    @property
    def jump(self) -> float:
        return 0.0 if self._shock is not None else math.sqrt(self.moment(2))

    @property
    def table(self) -> Table:
        """The density of shocks about their mean force, 2 rate E a^2 abs(S)^2, one-sided; it is
        held above 0."""
        assert self._shock is not None
        ends = 1e-4 / self._shock.duration, 0.5 / self._shock.interval
        f = np.geomspace(*ends, LINES)
        power = np.abs(self.size * self._shock.transform(2.0 * math.pi * f)) ** 2
        density = 2.0 * self.rate * self.relative_moment(2) * power
        return Table(frequency_hz=f, density=np.maximum(density, LEAST * density.max()))

    def density_for(self, omega: float, damping_rate: float) -> Density:
        return super().density_for(omega, damping_rate) if self._shock is None else self.table

    def compiled(self, mass: float) -> Any:
        from stochvi.engine.characteristics import SIZES, RandomPulses

        sizes = float(SIZES.index(self.sizes))
        return RandomPulses(self.rate, self.size / mass, float(self.two_sided), sizes)

    def louder(self, level_db: float) -> Self:
        gain = math.sqrt(power_ratio(level_db))
        if self.impulse is not None:
            return self.replace(impulse=gain * self.impulse)
        assert self._shock is not None
        return self.replace(amplitude=gain * self.size * self._shock.peak / self._amplitude_factor)

    def facts(self, where: str, numbers: Mapping[str, float]) -> list[tuple[str, ...]]:
        sides = "in either direction" if self.two_sided else "in one direction"
        often = f"{self.rate:.4g} per second"
        if self.rate < SELDOM:
            often = f"{3600.0 * self.rate:.4g} per hour"
        if self._shock is None:
            unit = "m/s" if where == BASE else "N s"
            size = f"{often} of {self.size:.4g} {unit}, {self.sizes} sizes"
            return [(f"Pulses on {where}", size, sides)]
        quantity = ACCELERATION if where == BASE else FORCE
        shape = self.shape or (self.values.name if self.values else Path(self.file or "").name)
        peak = quantity.text(self.size * self._shock.peak)
        size = f"{often}, {shape} of {peak} in {self._shock.duration:.4g} s, {self.sizes} sizes"
        return [(f"Pulses on {where}", size, sides)]


# ------------------------------------------------------------------------------
# A random excitation that is a function of one's own.
# ------------------------------------------------------------------------------


TRIED, TIME_PER_RATE = 2**16, 0.25
"""Number of values of a drive that are drawn to know its strength, and the time between them in
units of 1 / rate."""


class DriveFunction(DrawnExcitation):
    """A random force of one's own, whose next value is any function of the last one.

    The force is `amplitude` times a value z. `simulate` compiles the function and asks it for the
    next z before each half step. It describes a Markov process of one state that one uniform random
    number drives: a switch that changes at random, or shots that decay. It is for Python only.
    Answers, provenance and documents name the function, with a digest of its instructions and of
    the values that it uses.

    Parameters
    ----------
    function
        z after a time, a function (z, time, uniform) of the last z and the time that passes, s. The
        number `uniform` is uniform in (0, 1) and new in each call. The function is plain Python
        with `math`, or compiled by numba. The first z is 0. The burn-in must suffice to forget it.
    rate
        Fastest rate at which the function changes, 1/s; the steps resolve it.
    amplitude
        Force, N, or acceleration of the base, m/s^2, of z = 1.

    Raises
    ------
    SceneError
        If the function does not give finite numbers.

    See Also
    --------
    stochvi.scenes.Pulses : Impulses at random times.

    Examples
    --------
    >>> import math
    >>> def switch(z, time, uniform):
    ...     last = 1.0 if z >= 0.0 else -1.0
    ...     return -last if uniform < 0.5 * (1.0 - math.exp(-2.0 * 3.0 * time)) else last
    >>> DriveFunction(function=switch, rate=3.0, amplitude=2.0).effect_word
    'function of random numbers'
    """

    effect_word: ClassVar[str] = "function of random numbers"
    family: ClassVar[str] = "function of random numbers"

    kind: Literal["function"] = "function"
    function: Function
    rate: Positive
    amplitude: Positive = 1.0
    _contents: str = PrivateAttr(default="")
    """Digest of the instructions of the function and of the values that it uses."""
    _strength: tuple[float, float] = PrivateAttr(default=(0.0, 0.0))
    """Mean and intensity of z."""

    @model_validator(mode="after")
    def _gives_numbers(self) -> Self:
        from stochvi.engine.impact_laws import contents_of

        wanted = "needs function that takes a value, a time (s) and a uniform number"
        if fault := arguments_fault(self.function, 3):
            raise ValueError(f"{wanted}, got {fault}")
        time, z = TIME_PER_RATE / self.rate, 0.0
        values = np.empty(TRIED)
        try:
            for k, uniform in enumerate(np.random.default_rng(0).random(TRIED).tolist()):
                values[k] = z = float(self.function(z, time, uniform))
        except Exception as error:
            raise ValueError(
                f"{wanted}, and returns a number, got {type(error).__name__}: {error}"
            ) from None
        if not np.isfinite(values).all():
            raise ValueError(f"needs function that gives finite numbers, got {z:g}")
        if not np.ptp(values):
            raise ValueError(f"needs function that changes, got {z:g} for {TRIED} values")
        self._contents = contents_of([self.function])
        self._strength = strength_of(values, time)
        return self

    @field_serializer("function")
    def _named(self, function: Any) -> str:
        return f"{_name_of(function)} ({self._contents[:16]})"

    @property
    def mean(self) -> float:
        """Mean force, N, or acceleration of the base, m/s^2, of a trial of 65536 values."""
        return self.amplitude * self._strength[0]

    @property
    def si_intensity(self) -> float:
        """Largest intensity of white noise with the variance of a mean over any time, N^2 s."""
        return self.amplitude**2 * self._strength[1]

    @property
    def fastest(self) -> float:
        return self.rate

    def compiled(self, mass: float) -> Any:
        from stochvi.engine.characteristics import drive_part_of
        from stochvi.engine.impact_laws import NotCompiled

        try:
            kind = drive_part_of(self.function)
        except NotCompiled as error:
            raise SceneError(
                f"excitation.function must be a function that numba compiles, got "
                f"{_name_of(self.function)}: {error}; write it with numbers, `if` and `math`, or "
                "compile it with numba.njit"
            ) from None
        return kind(self.amplitude / mass)

    def louder(self, level_db: float) -> Self:
        size = math.sqrt(power_ratio(level_db)) * self.amplitude
        return self.model_copy(update={"amplitude": size})

    def facts(self, where: str, numbers: Mapping[str, float]) -> list[tuple[str, ...]]:
        unit = "m/s²" if where == BASE else "N"
        return [
            (f"Force of one's own on {where}", f"{self.amplitude:.4g} {unit} times a function",
             f"changes at {self.rate:.4g} 1/s at most")
        ]  # fmt: skip


def strength_of(values: np.ndarray, time: float) -> tuple[float, float]:
    """Mean of values that are `time` apart, s, and the intensity of their changes: the largest of
    T Var(mean over T)."""
    largest, mean, over = 0.0, float(values.mean()), values
    while len(over) >= 64:
        largest = max(largest, time * float(over.var()))
        over, time = 0.5 * (over[0::2] + over[1::2]), 2.0 * time
    return mean, largest
