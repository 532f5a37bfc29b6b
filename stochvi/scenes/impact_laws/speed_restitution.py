"""A rigid stop whose restitution depends on the speed of the impact."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cached_property
from itertools import pairwise
from typing import Annotated, Any, Literal, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Discriminator, Tag, model_validator

from stochvi.mathematics.arrays import Vector
from stochvi.scenes.impact_laws.base import RigidLaw
from stochvi.scenes.impact_laws.bodies import (
    hunt_crossley_restitution,
    viscoelastic_restitution,
    yielding_restitution,
)
from stochvi.scenes.validation import (
    Column,
    Function,
    NonNegatives,
    Number,
    Positive,
    check_values,
    evaluated,
)


def _form(value: Any) -> str:
    """The form of a coefficient: a number, a list, or a function."""
    if isinstance(value, list | tuple | np.ndarray):
        return "[]"
    return "{}" if callable(value) else ""


Coefficient = Annotated[
    Annotated[Number, Tag("")]
    | Annotated[NonNegatives, Tag("[]")]
    | Annotated[Function, Tag("{}")],
    Discriminator(_form),
]
"""A restitution at one speed, at several, or as a function of an array of speeds."""

Body = Literal["viscoelastic", "hunt-crossley", "yielding", "power"]

LOSSES: dict[str, tuple[Callable[[ArrayLike], Vector], float]] = {
    "viscoelastic": (viscoelastic_restitution, 0.2),
    "hunt-crossley": (hunt_crossley_restitution, 1.0),
    "yielding": (yielding_restitution, 1.0),
}
"""Restitution of each body over a number that grows as a power of the speed, and that power."""

LEAST, MOST_LOSS = 0.01, 1e12
"""Smallest restitution of a body at `at_speed`, and the largest number that is searched for it."""

SLOWEST = 1e-9
"""Speed at which the limit of a restitution that depends on speed is read, m/s."""

SAMPLE_SPEEDS = np.geomspace(1e-6, 1e3, 181)
"""Speeds at which a function is checked, m/s: twenty per decade."""

COMPILED_SPEEDS = np.geomspace(1e-6, 1e3, 577)
"""Speeds between which a simulation takes a function to be linear, m/s: 64 in a decade. 1 - R is
off by 3e-5 of itself at most where it is a power of the speed, w^(1/5) or w^(-1/4)."""


class SpeedRestitution(RigidLaw):
    """A rigid stop whose restitution depends on the speed of the impact, v+ = -R(|v-|) v-.

    R is given at several speeds, or at one speed with the kind of the body. In slow impacts a
    viscous body has 1 - R proportional to w^(1/5) (Kuwabara and Kono 1987). By the force of Hunt
    and Crossley (1975) it is proportional to w. One that yields has R = (w_y / w)^(1/4) above a
    speed w_y (Johnson 1985, section 11.5).

    Parameters
    ----------
    coefficient
        R in [0, 1]: at each `speed`, or at `at_speed` where a `body` is given. In Python it may be
        a function of an array of speeds (m/s, above 0). It returns an array of the same shape, or
        one number for all.
    speed
        Increasing speeds of impact, m/s, where R is a list. R is linear between them, and constant
        below the first and above the last.
    body
        Where R is one number: "viscoelastic", "hunt-crossley", "yielding", or "power" for
        R (w / at_speed)^exponent, at most 1.
    exponent
        Exponent of the body "power".
    at_speed
        Speed of impact, m/s, at which a body has its R. In any case it is the speed whose
        restitution stands for that of all speeds where one number is needed, for steps and starts;
        1 by default.

    Raises
    ------
    SceneError
        If R is not in [0, 1]. A function is asked at speeds from 1 um/s to 1 km/s.

    See Also
    --------
    stochvi.Restitution : One number for all speeds.
    stochvi.identify : The law of a stop from a test of it.

    Examples
    --------
    >>> steel = SpeedRestitution(coefficient=0.8, at_speed=0.5, body="viscoelastic")
    >>> steel.restitution_at([0.05, 0.5, 5.0]).round(3).tolist()
    [0.867, 0.8, 0.709]
    >>> rubber = SpeedRestitution(speed=[0.1, 1.0, 4.0], coefficient=[0.7, 0.6, 0.4])
    >>> rubber.restitution_at([0.01, 2.5]).tolist()
    [0.7, 0.5]
    """

    kind: Literal["speed-restitution"] = "speed-restitution"
    coefficient: Coefficient
    speed: Column | None = None
    body: Body | None = None
    exponent: Number | None = None
    at_speed: Positive = 1.0

    @model_validator(mode="after")
    def _known_at_every_speed(self) -> Self:
        wanted = {"[]": ("speed",), "{}": (), "": ("body",)}[_form(self.coefficient)]
        for name in ("speed", "body"):
            if (getattr(self, name) is not None) != (name in wanted):
                words = "needs" if name in wanted else "takes no"
                what = {"[]": "a list", "{}": "a function", "": "one number"}
                raise ValueError(
                    f"{words} {name} where coefficient is {what[_form(self.coefficient)]}; give "
                    "lists of speed and coefficient, or one coefficient with body and at_speed"
                )
        if (self.exponent is not None) != (self.body == "power"):
            raise ValueError(
                "needs exponent with body = 'power' and with no other, got "
                f"{'none' if self.exponent is None else format(self.exponent, 'g')}"
            )
        if self.speed is not None:
            self._check_list(self.speed)
        elif self.body is not None:
            self._check_number()
        else:
            values = check_values("coefficient", self.coefficient, SAMPLE_SPEEDS)  # type: ignore[arg-type]
            wrong = (values < 0.0) | (values > 1.0)
            if wrong.any():
                raise ValueError(
                    f"needs coefficient in [0, 1], got {values[wrong][0]:g} at "
                    f"{SAMPLE_SPEEDS[wrong][0]:g} m/s"
                )
        return self

    def _check_list(self, speed: tuple[float, ...]) -> None:
        values = self.coefficient
        assert isinstance(values, tuple)
        if len(values) != len(speed) or len(speed) < 2:
            raise ValueError(
                "needs as many entries in coefficient as in speed, and at least 2, got "
                f"{len(values)} and {len(speed)}"
            )
        for one, two in pairwise(speed):
            if one >= two:
                raise ValueError(f"needs increasing speed, got {two:g} after {one:g}")
        for each in values:
            if each > 1.0:
                raise ValueError(f"needs coefficient in [0, 1], got {each:g}")

    def _check_number(self) -> None:
        value = self.coefficient
        assert isinstance(value, float)
        if not LEAST <= value <= 1.0:
            raise ValueError(f"needs coefficient in [{LEAST:g}, 1] with a body, got {value:g}")

    @cached_property
    def _at(self) -> Callable[[Vector], Vector]:
        """R as a function of an array of speeds, m/s."""
        value = self.coefficient
        if self.speed is not None:
            speeds, values = np.array(self.speed), np.array(value)
            return lambda w: np.interp(w, speeds, values)
        if self.body is None:
            assert callable(value)
            return lambda w: evaluated(value, w)
        assert isinstance(value, float)
        if self.body == "power":
            q = self.exponent
            assert q is not None
            return lambda w: np.clip(
                value * (np.maximum(w, SLOWEST) / self.at_speed) ** q, 0.0, 1.0
            )
        restitution, power = LOSSES[self.body]
        loss = _loss_at(restitution, value)
        return lambda w: restitution(loss * (w / self.at_speed) ** power)

    @property
    def remark(self) -> str:
        """That the restitution depends on the speed, and that the stop rubs, if it does."""
        return f", restitution by speed{super().remark}"

    @property
    def conservative(self) -> bool:
        """Whether no impact loses energy."""
        return bool(np.all(self._sampled[1] == 1.0)) and not self.friction

    @property
    def restitution(self) -> float:
        """R at `at_speed`, which stands for all speeds in steps and starts."""
        return float(self.restitution_at([self.at_speed])[0])

    @property
    def slow_restitution(self) -> float:
        """R in the limit of slow impacts, read at 1 nm/s."""
        return float(self.restitution_at([SLOWEST])[0])

    def restitution_at(self, speed: ArrayLike) -> Vector:
        """R of impacts at the given speeds, m/s."""
        return np.asarray(self._at(np.asarray(speed, dtype=float)))

    def strengths(self) -> tuple[float, ...]:
        return (self.at_speed, *(self.speed or ()))

    def in_words(self) -> str:
        value = self.coefficient
        if self.speed is not None:
            assert isinstance(value, tuple)
            words = (
                f"{value[0]:g} at {self.speed[0]:g} m/s to {value[-1]:g} at {self.speed[-1]:g} m/s"
            )
        elif self.body is not None:
            kind = f"{self.body} {self.exponent:g}" if self.body == "power" else self.body
            words = f"{value:g} at {self.at_speed:g} m/s (body: {kind})"
        else:
            words = "a function of speed"
        return f"rigid, restitution {words}"

    @cached_property
    def _sampled(self) -> tuple[Vector, Vector]:
        """Speeds, m/s, between which R is linear, and R there."""
        speeds = COMPILED_SPEEDS if self.speed is None else np.array(self.speed)
        return speeds, self.restitution_at(speeds)

    def compiled(self) -> NamedTuple:
        from stochvi.engine.laws.speed_restitution import SpeedRestitution as Compiled

        return Compiled.of(*self._sampled)


def _loss_at(restitution: Callable[[ArrayLike], Vector], value: float) -> float:
    """The number of a body at which it has a restitution."""
    from scipy.optimize import brentq

    if value == 1.0:
        return 0.0
    high = 1.0
    while float(restitution(high)) > value and high < MOST_LOSS:
        high *= 2.0
    found = brentq(lambda x: float(restitution(x)) - value, 0.0, high, xtol=1e-300, rtol=1e-14)
    return float(found) if math.isfinite(found) else 0.0
