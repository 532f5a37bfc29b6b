"""Rigid stops: an impact takes no time, and its loss follows from a restitution. Chapters:
restitution by laws of one number; constant or scattering restitution; restitution that depends on
the speed."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache, cached_property
from itertools import pairwise
from typing import Annotated, Any, Literal, NamedTuple, Self

import numpy as np
import scipy
from numpy.typing import ArrayLike
from pydantic import Discriminator, Tag, field_validator, model_validator

from stochvi.mathematics.impact_rates import BetaDistribution, equivalent_restitution
from stochvi.mathematics.numerics import Vector
from stochvi.scenes.impact_laws.compliant import Form, PowerLaw, RigidLaw
from stochvi.scenes.validation import (
    Column,
    Function,
    NonNegatives,
    Number,
    Positive,
    Scatter,
    Scattered,
    check_values,
    evaluated,
)

# ------------------------------------------------------------------------------
# Restitution of a free mass that arrives at a speed, by laws that have one number.
# ------------------------------------------------------------------------------


MOST_LOSS, POINTS = 40.0, 41
"""Largest loss X of a viscoelastic body in the table, at which 0.3 % of the speed are left, and
number of its points."""

SERIES = 1e-4
"""Loss a w below which the series of Hunt and Crossley's law is used."""


def viscoelastic_restitution(loss: ArrayLike) -> Vector:
    """Restitution of a round viscoelastic body, 1 - 1.15345 X + 0.79827 X^2 + ... (Kuwabara and
    Kono 1987; Schwager and Poeschel 2008).

    Parameters
    ----------
    loss
        X = (c / k) (k / M)^(2/5) w^(1/5) of the force k y^(3/2) + c y^(1/2) y' and the mass M.

    Examples
    --------
    >>> viscoelastic_restitution([0.0, 0.1]).round(4).tolist()
    [1.0, 0.8929]
    """
    x = np.asarray(loss, dtype=float)
    return np.asarray(_curve()(np.sqrt(np.clip(x, 0.0, MOST_LOSS))))


@cache
def _curve() -> Any:
    """The restitution over the root of the loss, from contacts of a unit mass at unit speed."""
    roots = np.linspace(0.0, MOST_LOSS**0.5, POINTS)
    found = [
        PowerLaw(coefficient=1.0, loss=root**2, loss_exponent=0.5).impact(1.0, 1.0).restitution
        for root in roots[1:]
    ]
    return scipy.interpolate.CubicSpline(roots, [1.0, *found])


def hunt_crossley_restitution(loss: ArrayLike) -> Vector:
    """Restitution R by the force k y^n (1 + a y'), whatever n, of the loss a w (Hunt and Crossley
    1975).

        a w - ln(1 + a w) = -a R w - ln(1 - a R w)

    Examples
    --------
    >>> hunt_crossley_restitution([0.0, 0.1]).round(4).tolist()
    [1.0, 0.9375]
    """
    from scipy.special import lambertw

    x = np.asarray(loss, dtype=float)
    safe = np.maximum(x, SERIES)
    found = 1.0 + lambertw(-(1.0 + safe) * np.exp(-1.0 - safe), 0).real
    return np.where(x < SERIES, 1.0 - 2.0 / 3.0 * x, found / safe)


def yielding_restitution(ratio: ArrayLike) -> Vector:
    """Restitution of a body that yields, (w_y / w)^(1/4) above the speed w_y (Johnson 1985, section
    11.5), of the ratio w / w_y.

    Examples
    --------
    >>> yielding_restitution([0.5, 16.0]).tolist()
    [1.0, 0.5]
    """
    return np.asarray(np.maximum(np.asarray(ratio, dtype=float), 1.0) ** -0.25)


# ------------------------------------------------------------------------------
# Rigid stops: an impact is instantaneous, and its loss of energy follows from a restitution.
# ------------------------------------------------------------------------------


class Restitution(RigidLaw):
    """Newton's law of impact on a rigid stop, v+ = -R v-, 0 <= R <= 1 (B section 1).

    Parameters
    ----------
    coefficient
        The restitution R; 1 loses nothing, 0 loses all of the normal velocity. The energy
        lost in one impact of incident speed w is (1 - R^2) m w^2 / 2. A `Scatter`, or a table of
        mean and std, is drawn anew at each impact from a beta distribution on [0, 1], independent
        of the speed. Its std must be below sqrt(mean (1 - mean)).

    See Also
    --------
    stochvi.Scatter : A restitution that scatters from impact to impact.
    stochvi.SpeedRestitution : A restitution that depends on the speed.
    stochvi.Viscoelastic : A compliant stop.

    Examples
    --------
    >>> Restitution(coefficient=0.8).coefficient
    0.8
    >>> round(Restitution(coefficient={"mean": 0.7, "std": 0.1}).restitution_mean_square, 12)
    0.5
    """

    kind: Literal["restitution"] = "restitution"
    coefficient: Scattered

    @field_validator("coefficient")
    @classmethod
    def _between_nothing_and_all(cls, value: float | Scatter) -> float | Scatter:
        mean, std = (value.mean, value.std) if isinstance(value, Scatter) else (value, 0.0)
        if not 0.0 <= mean <= 1.0:
            raise ValueError(f"must be in [0, 1], got {mean:g}")
        if std and not std < (largest := math.sqrt(mean * (1.0 - mean))):
            raise ValueError(
                f"must have std below sqrt(mean (1 - mean)) = {largest:.4g}, got {std:g}; give a "
                "smaller std"
            )
        return value

    @cached_property
    def scatter(self) -> BetaDistribution | None:
        """The distribution from which R is drawn at each impact; None where R does not scatter."""
        value = self.coefficient
        if isinstance(value, Scatter) and value.std > 0.0:
            return BetaDistribution(value.mean, value.std)
        return None

    @property
    def remark(self) -> str:
        """That the restitution scatters, and that the stop rubs, if it does."""
        drawn = "" if self.scatter is None else ", restitution drawn at each impact"
        return drawn + super().remark

    @property
    def conservative(self) -> bool:
        """Whether an impact loses no energy."""
        return self.restitution == 1.0 and not self.friction

    @cached_property
    def restitution(self) -> float:
        """Restitution R of an impact; its mean where R scatters."""
        value = self.coefficient
        return value.mean if isinstance(value, Scatter) else value

    @cached_property
    def restitution_mean_square(self) -> float:
        """E R^2: an impact takes (1 - E R^2) m w^2 / 2 in the mean."""
        law = self.scatter
        return self.restitution**2 + (0.0 if law is None else law.std**2)

    @property
    def slow_restitution(self) -> float:
        """The constant restitution that leaves slow impacts under white noise the same density,
        where R scatters (`mathematics.impact_rates.equivalent_restitution`); else R."""
        law = self.scatter
        return self.restitution if law is None else equivalent_restitution(law)

    def shifted(self, amount: float) -> Restitution:
        """The law with a number added to R, or to its mean, as far as [0, 1] and its std let it."""
        law = self.scatter
        if law is None:
            return self.replace(coefficient=min(max(self.restitution + amount, 0.0), 1.0))
        # mean (1 - mean) > std^2, with a margin that keeps a distribution
        half = MOST_SHIFTED * math.sqrt(max(0.25 - law.std**2, 0.0))
        mean = min(max(law.mean + amount, 0.5 - half), 0.5 + half)
        return self.replace(coefficient=Scatter(mean=mean, std=law.std))

    def restitution_at(self, speed: ArrayLike) -> Vector:
        """R of impacts at the given speeds (m/s): the same for all; its mean where R scatters."""
        return np.full(np.shape(speed), self.restitution)

    def in_words(self) -> str:
        drawn = "" if self.scatter is None else f" ± {self.scatter.std:g}, drawn at each impact"
        return f"rigid, restitution {self.restitution:g}{drawn}"

    def compiled(self) -> NamedTuple:
        from stochvi.engine.impact_laws import Restitution as Compiled
        from stochvi.engine.impact_laws import ScatteredRestitution

        law = self.scatter
        return Compiled(self.restitution) if law is None else ScatteredRestitution.of(law)

    def form(self) -> Form | None:
        if self.scatter is not None:
            return None
        return Form("rigid", np.array([[self.restitution]]))


MOST_SHIFTED = 0.98
"""How far from 0.5 the mean of a restitution is shifted, as a share of the way to where its std
leaves no distribution."""


# ------------------------------------------------------------------------------
# A rigid stop whose restitution depends on the speed of the impact.
# ------------------------------------------------------------------------------


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

LEAST, LARGEST_LOSS = 0.01, 1e12
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
        from stochvi.engine.impact_laws import SpeedRestitution as Compiled

        return Compiled.of(*self._sampled)


def _loss_at(restitution: Callable[[ArrayLike], Vector], value: float) -> float:
    """The number of a body at which it has a restitution."""
    if value == 1.0:
        return 0.0
    high = 1.0
    while float(restitution(high)) > value and high < LARGEST_LOSS:
        high *= 2.0
    found = scipy.optimize.brentq(
        lambda x: float(restitution(x)) - value, 0.0, high, xtol=1e-300, rtol=1e-14
    )
    return float(found) if math.isfinite(found) else 0.0
