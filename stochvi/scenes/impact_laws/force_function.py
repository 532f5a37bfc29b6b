"""A force that is a function of the deflection of a stop and of its speed."""

from __future__ import annotations

from functools import cached_property
from typing import Any, ClassVar, Literal, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike
from pydantic import PrivateAttr, field_serializer, model_validator

from stochvi.mathematics.arrays import Vector
from stochvi.mathematics.kelvin_voigt import ContactSolution
from stochvi.results.errors import SceneError
from stochvi.scenes.impact_laws.base import SLOW_SHARE, CompliantLaw, inside
from stochvi.scenes.validation import Function, Positive, _name_of, arguments_fault

SAMPLES = np.geomspace(1e-9, 1e-3, 25), np.array([-1.0, -0.1, 0.0, 0.1, 1.0])
"""Deflections (m) and speeds (m/s) at which a force is checked."""


class ForceFunction(CompliantLaw):
    """A force of one's own, any function of the deflection of the stop and of its speed.

    A function cannot be written in a scene file: this law is for Python only. `simulate` and
    `replay` compile the function, and the stop only pushes: where the function is negative, it has
    no force. Answers, provenance and documents name the function, with a digest of its instructions
    and of the values that it uses. A checkpoint of another function is not gone on with. Another
    process finds the function by its name, in a module that it can import.

    Parameters
    ----------
    force
        Force on the stop, N, a function (deflection, speed) of two numbers in m and m/s: plain
        Python with `math`, or compiled by numba. The speed is positive into the stop.
    energy
        Energy stored at a deflection, J, a function of one number. Methods that need it say so by
        name: exact laws, linearisation, Fokker-Planck.
    at_speed
        Speed of impact, m/s, whose restitution stands for that of all speeds where one number is
        needed, for steps and starts; 1 by default. Give the usual speed of the impacts.

    Raises
    ------
    SceneError
        If the function does not give a number, or if the stop pulls at rest.

    See Also
    --------
    stochvi.ForceTable : A measured force over the deflection.
    stochvi.SpeedRestitution : A rigid stop whose restitution is a function.

    Examples
    --------
    >>> rubber = ForceFunction(force=lambda y, v: 1e6 * y**1.5 * (1.0 + 0.3 * v))
    >>> rubber.force_at(0.01, [-1.0, 0.0, 1.0]).round(9).tolist()
    [700.0, 1000.0, 1300.0]
    >>> round(rubber.impact(speed=1.0, mass=2.0).restitution, 4)
    0.8329
    """

    word: ClassVar[str] = "function"

    kind: Literal["function"] = "function"
    force: Function
    energy: Function | None = None
    at_speed: Positive = 1.0
    _units: tuple[float, float, float] = PrivateAttr(default=(1.0, 1.0, 1.0))
    """Factors of the force, of the deflection and of its rate: of another unit of each."""
    _contents: str = PrivateAttr(default="")
    """Digest of the instructions of the functions and of the values that they use."""

    @model_validator(mode="after")
    def _pushes(self) -> Self:
        from stochvi.engine.laws.force_function import contents_of

        if fault := arguments_fault(self.force):
            raise ValueError(
                f"needs force that takes a deflection (m) and a speed (m/s), got {fault}"
            )
        deflections, speeds = (axis.ravel() for axis in np.meshgrid(*SAMPLES))
        try:
            values = np.array(
                [float(self.force(y, v)) for y, v in zip(deflections, speeds, strict=True)]
            )
        except Exception as error:
            raise ValueError(
                "needs force that takes a deflection (m) and a speed (m/s) and returns a number, "
                f"got {type(error).__name__}: {error}"
            ) from None
        wrong = ~np.isfinite(values) | ((values < 0.0) & (speeds == 0.0))
        if wrong.any():
            raise ValueError(
                f"needs force that is a finite number, and not negative at rest, got "
                f"{values[wrong][0]:g} at {deflections[wrong][0]:g} m and {speeds[wrong][0]:g} m/s"
            )
        functions = [each for each in (self.force, self.energy) if each is not None]
        self._contents = contents_of(functions)
        return self

    @field_serializer("force")
    def _named(self, function: Any) -> str:
        return f"{_name_of(function)} ({self._contents[:16]})"

    @cached_property
    def conservative(self) -> bool:
        """Whether the force does not depend on the speed, at all speeds that are checked."""
        y, v = np.meshgrid(np.geomspace(1e-9, 1e-1, 17), SAMPLES[1])
        return bool(np.array_equal(self.force_at(y, v), self.force_at(y)))

    @property
    def restitution(self) -> float:
        """Restitution that a free mass of 1 kg sees at the speed `at_speed`."""
        return self.impact(self.at_speed / self._units[2], 1.0).restitution

    @property
    def slow_restitution(self) -> float:
        """R of impacts that are a thousand times slower than `at_speed`."""
        return self.impact(SLOW_SHARE * self.at_speed / self._units[2], 1.0).restitution

    @property
    def has_linear_damper(self) -> bool:
        """Whether the force does not depend on the speed."""
        return self.conservative

    def damping(self, mass: float) -> float:
        """0 of a force that does not depend on the speed; ValueError for others."""
        if not self.conservative:
            raise ValueError("a force that is a function of the speed has no linear damper")
        return 0.0

    def force_at(self, deflection: ArrayLike, rate: ArrayLike = 0.0, mass: float = 1.0) -> Vector:
        factor, length, speed = self._units
        y, v = np.broadcast_arrays(inside(deflection), np.asarray(rate, float))
        found = [
            factor * max(float(self.force(length * one, speed * two)), 0.0) if one > 0.0 else 0.0
            for one, two in zip(y.ravel().tolist(), v.ravel().tolist(), strict=True)
        ]
        return np.array(found).reshape(y.shape)

    def potential_at(self, deflection: ArrayLike) -> Vector:
        """Energy stored at a deflection, J; ValueError without `energy`."""
        energy, y = self.energy, inside(deflection)
        if energy is None:
            raise ValueError("law.energy must be given for this, a function of the deflection")
        factor, length, _ = self._units
        stored = [float(energy(length * each)) - float(energy(0.0)) for each in y.ravel().tolist()]
        return factor / length * np.array(stored).reshape(y.shape)

    @property
    def has_energy(self) -> bool:
        """Whether the stored energy is given."""
        return self.energy is not None

    def impact(self, speed: float, mass: float) -> ContactSolution:
        if (speed, mass) not in self._contacts:
            self._contacts[speed, mass] = super().impact(speed, mass)
        return self._contacts[speed, mass]

    def per_unit_mass(self, mass: float) -> Self:
        return self._in_units(1.0 / mass, 1.0, 1.0)

    def scaled(self, length: float, time: float) -> Self:
        return self._in_units(time**2 / length, length, length / time)

    def _in_units(self, force: float, length: float, speed: float) -> Self:
        other = self.model_copy()
        factor, unit, rate = self._units
        other._units = (factor * force, unit * length, rate * speed)
        return other

    @cached_property
    def _contacts(self) -> dict[tuple[float, float], ContactSolution]:
        """Contacts that were integrated, by speed and mass."""
        return {}

    def strengths(self) -> tuple[float, ...]:
        return (self._units[0],)

    def in_words(self) -> str:
        return f"{self.word}, force {_name_of(self.force)}"

    def compiled(self) -> NamedTuple:
        from stochvi.engine.laws.force_function import NotCompiled, law_of

        try:
            kind = law_of(self.force, not self.conservative)
        except NotCompiled as error:
            raise SceneError(
                f"law.force must be a function that numba compiles, got {_name_of(self.force)}: "
                f"{error}; write it with numbers, `if` and `math`, or compile it with numba.njit"
            ) from None
        found: NamedTuple = kind(*self._units)
        return found
