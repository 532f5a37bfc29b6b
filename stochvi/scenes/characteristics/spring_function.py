"""A spring, with or without damping, whose force is a function of one's own."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any, ClassVar, Literal, Self

import numpy as np
from numpy.typing import ArrayLike
from pydantic import PrivateAttr, field_serializer, model_validator

from stochvi.mathematics.arrays import Vector
from stochvi.results.errors import SceneError
from stochvi.scenes.characteristics.base import SpringForce
from stochvi.scenes.integrals import integral_of
from stochvi.scenes.validation import Function, _name_of, arguments_fault, evaluated

SAMPLES = np.concatenate([-np.geomspace(1e-6, 1e-2, 9)[::-1], [0.0], np.geomspace(1e-6, 1e-2, 9)])
"""Displacements (m) and velocities (m/s) at which a force is checked."""


class SpringFunction(SpringForce):
    """A force of one's own, any function of the displacement and of the velocity.

    A function cannot be written in a scene file: this spring is for Python only. `simulate`
    compiles it. Answers, provenance and documents name the function, with a digest of its
    instructions and of the values that it uses. A checkpoint of another function is not gone on
    with. Another process finds the function by its name, in a module that it can import.

    Parameters
    ----------
    force
        Force against the displacement, N, a function (displacement, velocity) of two numbers in m
        and m/s: plain Python with `math`, or compiled by numba.
    energy
        Energy at a displacement, J, a function of one number, for a force that does not depend on
        the velocity; by quadrature of the force where it is not given.
    on, between, axis
        Where it acts: on a coordinate or point, between two, or along an axis of the mounts of a
        box.

    Raises
    ------
    SceneError
        If the function does not give a finite number.

    See Also
    --------
    stochvi.scenes.SpringTable : A measured force over the displacement.
    stochvi.ForceFunction : The same at a stop.

    Examples
    --------
    >>> rubber = SpringFunction(force=lambda x, v: 1e4 * x + 1e8 * x**3 + 20.0 * v)
    >>> rubber.force_at([0.0, 0.01], 0.1).tolist()
    [2.0, 202.0]
    """

    word: ClassVar[str] = "function"

    kind: Literal["function"] = "function"
    force: Function
    energy: Function | None = None
    _contents: str = PrivateAttr(default="")
    """Digest of the instructions of the functions and of the values that they use."""

    @model_validator(mode="after")
    def _gives_numbers(self) -> Self:
        from stochvi.engine.laws.force_function import contents_of

        if fault := arguments_fault(self.force):
            raise ValueError(
                f"needs force that takes a displacement (m) and a velocity (m/s), got {fault}"
            )
        try:
            values = self.force_at(SAMPLES, SAMPLES[::-1])
        except Exception as error:
            raise ValueError(
                "needs force that takes a displacement (m) and a velocity (m/s) and returns a "
                f"number, got {type(error).__name__}: {error}"
            ) from None
        if not np.isfinite(values).all():
            place = float(SAMPLES[~np.isfinite(values)][0])
            raise ValueError(f"needs force that is a finite number, got none at {place:g} m")
        functions = [each for each in (self.force, self.energy) if each is not None]
        self._contents = contents_of(functions)
        return self

    @field_serializer("force")
    def _named(self, function: Any) -> str:
        return f"{_name_of(function)} ({self._contents[:16]})"

    @cached_property
    def needs(self) -> str:
        """Whether the force depends on the velocity, at all that are checked."""
        x, v = np.meshgrid(SAMPLES, SAMPLES)
        same = np.array_equal(self.force_at(x, v), self.force_at(x))
        return "displacement" if same else "both"

    def force_at(self, displacement: ArrayLike, velocity: ArrayLike = 0.0) -> Vector:
        x, v = np.broadcast_arrays(displacement, np.asarray(velocity, float))
        places = zip(x.ravel().tolist(), v.ravel().tolist(), strict=True)
        found = [float(self.force(float(one), float(two))) for one, two in places]
        return np.array(found, float).reshape(x.shape)

    def potential_at(self, displacement: ArrayLike) -> Vector:
        if self.needs != "displacement":
            return super().potential_at(displacement)
        x = np.asarray(displacement, float)
        if self.energy is None:
            return integral_of(self.force_at, x)
        energy = self.energy
        found = evaluated(np.vectorize(lambda one: float(energy(one)), otypes=[float]), x.ravel())
        return np.asarray(found - float(energy(0.0))).reshape(x.shape)

    @property
    def strengths(self) -> Sequence[float]:
        return ()

    def compiled(self, mass: float) -> Any:
        from stochvi.engine.characteristics.function import part_of
        from stochvi.engine.laws.force_function import NotCompiled

        try:
            kind = part_of(self.force, self.needs == "both")
        except NotCompiled as error:
            raise SceneError(
                f"spring.force must be a function that numba compiles, got {_name_of(self.force)}: "
                f"{error}; write it with numbers, `if` and `math`, or compile it with numba.njit"
            ) from None
        return kind(1.0 / mass)
