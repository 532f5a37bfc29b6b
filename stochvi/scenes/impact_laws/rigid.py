"""Rigid stops: an impact is instantaneous, and its loss of energy follows from a restitution."""

from __future__ import annotations

from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from pydantic import field_validator

from stochvi.mathematics.arrays import Vector
from stochvi.scenes.impact_laws.base import Form, RigidLaw
from stochvi.scenes.validation import Function, Number, check_values, evaluated


class Restitution(RigidLaw):
    """Newton's law of impact on a rigid stop, v+ = -R v-, 0 <= R <= 1 (B section 1).

    Parameters
    ----------
    coefficient
        The restitution R; 1 loses nothing, 0 loses all of the normal velocity. The energy
        lost in one impact of incident speed w is (1 - R^2) m w^2 / 2.

    See Also
    --------
    stochvi.SpeedRestitution : A restitution that depends on the speed.
    stochvi.Viscoelastic : A compliant stop.

    Examples
    --------
    >>> Restitution(coefficient=0.8).coefficient
    0.8
    """

    kind: Literal["restitution"] = "restitution"
    coefficient: Number

    @field_validator("coefficient")
    @classmethod
    def _between_nothing_and_all(cls, value: float) -> float:
        if not 0.0 <= value <= 1.0:
            raise ValueError(f"must be in [0, 1], got {value:g}")
        return value

    @property
    def conservative(self) -> bool:
        """Whether an impact loses no energy."""
        return self.coefficient == 1.0

    @property
    def restitution(self) -> float:
        """Restitution R of an impact."""
        return self.coefficient

    def restitution_at(self, speed: ArrayLike) -> Vector:
        """R of impacts at the given speeds (m/s): the same for all."""
        return np.full(np.shape(speed), self.coefficient)

    def phrase(self) -> str:
        return f"rigid, restitution {self.coefficient:g}: speeds of impact but no peak acceleration"

    def compiled(self) -> NamedTuple:
        from stochvi.engine.laws.restitution import Restitution as Compiled

        return Compiled(self.coefficient)

    def form(self) -> Form:
        return Form("rigid", np.array([[self.coefficient]]))


class SpeedRestitution(RigidLaw):
    """A rigid stop whose restitution depends on the speed of the impact, v+ = -R(|v-|) v-.

    A function cannot be written in a scene file: this law is for Python only, and for methods that
    take functions.

    Parameters
    ----------
    coefficient
        R, in [0, 1], as a function of an array of incident speeds (m/s, above 0). It returns an
        array of the same shape, or one number for all.

    Raises
    ------
    SceneError
        If the function is not in [0, 1] at speeds from 1 um/s to 1 km/s.

    See Also
    --------
    stochvi.Restitution : One number for all speeds.

    Examples
    --------
    >>> steel = SpeedRestitution(coefficient=lambda w: 1.0 / (1.0 + 0.1 * w**0.25))
    >>> steel.restitution_at([1e-4, 1.0]).round(3).tolist()
    [0.99, 0.909]
    """

    kind: Literal["speed-restitution"] = "speed-restitution"
    coefficient: Function

    @field_validator("coefficient")
    @classmethod
    def _between_nothing_and_all(cls, function: Any) -> Any:
        values = check_values("coefficient", function, SAMPLE_SPEEDS)
        wrong = (values < 0.0) | (values > 1.0)
        if wrong.any():
            raise ValueError(
                f"must be in [0, 1], got {values[wrong][0]:g} at {SAMPLE_SPEEDS[wrong][0]:g} m/s"
            )
        return function

    @property
    def conservative(self) -> bool:
        """Whether no impact loses energy."""
        return bool(np.all(self.restitution_at(SAMPLE_SPEEDS) == 1.0))

    @property
    def restitution(self) -> float:
        """Raises a ValueError, because there is no single restitution."""
        raise ValueError("a restitution that is a function of speed has no single value")

    def restitution_at(self, speed: ArrayLike) -> Vector:
        """R of impacts at the given speeds, m/s."""
        return evaluated(self.coefficient, np.asarray(speed, dtype=float))

    def phrase(self) -> str:
        return "rigid, restitution a function of speed: speeds of impact but no peak acceleration"


SAMPLE_SPEEDS = np.geomspace(1e-6, 1e3, 181)
"""Speeds at which a restitution that depends on speed is checked, m/s: twenty per decade."""
