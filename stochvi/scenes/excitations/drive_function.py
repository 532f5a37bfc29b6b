"""A random excitation that is a function of one's own."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, ClassVar, Literal, Self

import numpy as np
from pydantic import PrivateAttr, field_serializer, model_validator

from stochvi.mathematics.units import power_ratio
from stochvi.results.errors import SceneError
from stochvi.scenes.excitations.base import BASE
from stochvi.scenes.excitations.drawn import DrawnExcitation
from stochvi.scenes.validation import Function, Positive, _name_of, arguments_fault

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
        from stochvi.engine.laws.force_function import contents_of

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
        from stochvi.engine.characteristics.drive_function import drive_part_of
        from stochvi.engine.laws.force_function import NotCompiled

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
