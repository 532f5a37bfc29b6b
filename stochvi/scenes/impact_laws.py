"""Impact laws: what happens when the mass meets a stop."""

from __future__ import annotations

import math
from collections.abc import Iterable
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Discriminator, Tag, field_validator, model_validator

from stochvi.mathematics.kelvin_voigt import Impact, half_contact, kelvin_voigt
from stochvi.results.errors import SceneError
from stochvi.scenes.datasets import read_table
from stochvi.scenes.validation import (
    Checked,
    Function,
    NonNegative,
    NonNegatives,
    Number,
    Positive,
    check_values,
    evaluated,
)

Vector = NDArray[np.float64]


class Restitution(Checked):
    """Newton's law of impact on a rigid stop, v+ = -R v-, 0 <= R <= 1 (B section 1).

    Parameters
    ----------
    coefficient
        The restitution R; 1 loses nothing, 0 loses all of the normal velocity. The energy
        lost in one impact of incident speed w is (1 - R^2) m w^2 / 2.

    Examples
    --------
    >>> Restitution(coefficient=0.8).coefficient
    0.8
    """

    word: ClassVar[str] = "rigid"
    rigid: ClassVar[bool] = True

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
        """R; of a stop that gives way, what a free mass sees."""
        return self.coefficient

    def restitution_at(self, speed: ArrayLike) -> Vector:
        """R of impacts at the given speeds (m/s): the same for all."""
        return np.full(np.shape(speed), self.coefficient)

    def per_unit_mass(self, mass: float) -> Self:
        """The same law: it knows no force."""
        return self

    def strengths(self) -> tuple[float, ...]:
        """Numbers with a unit that the law holds: none."""
        return ()


class SpeedRestitution(Checked):
    """A rigid stop whose restitution depends on the speed of the impact, v+ = -R(|v-|) v-.

    A function cannot be written in a scene file: this law is for Python only, and for methods that
    take functions.

    Parameters
    ----------
    coefficient
        R, in [0, 1], as a function of an array of incident speeds (m/s, above 0) that returns an
        array of the same shape, or one number for all.

    Raises
    ------
    SceneError
        If the function is not in [0, 1] at speeds from 1 um/s to 1 km/s.

    Examples
    --------
    >>> steel = SpeedRestitution(coefficient=lambda w: 1.0 / (1.0 + 0.1 * w**0.25))
    >>> steel.restitution_at([1e-4, 1.0]).round(3).tolist()
    [0.99, 0.909]
    """

    word: ClassVar[str] = "rigid"
    rigid: ClassVar[bool] = True

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
        """There is no single one."""
        raise ValueError("a restitution that is a function of speed has no single value")

    def restitution_at(self, speed: ArrayLike) -> Vector:
        """R of impacts at the given speeds, m/s."""
        return evaluated(self.coefficient, np.asarray(speed, dtype=float))

    def per_unit_mass(self, mass: float) -> Self:
        """The same law: it knows no force."""
        return self

    def strengths(self) -> tuple[float, ...]:
        """Numbers with a unit that the law holds: none that can be told."""
        return ()


SAMPLE_SPEEDS = np.geomspace(1e-6, 1e3, 181)
"""Where a restitution that depends on speed is looked at once, m/s: twenty speeds a decade."""


class CompliantLaw(Checked):
    """A stop that gives way: its force depends on the deflection y = x - stop and its rate.

    Forces and deflections are positive inwards the stop; there is none while y < 0.
    """

    word: ClassVar[str]
    rigid: ClassVar[bool] = False

    @property
    def conservative(self) -> bool:
        """Whether the force has a potential."""
        return True

    @property
    def restitution(self) -> float:
        """Restitution that a free mass sees, whatever its speed."""
        return 1.0

    def force_at(self, deflection: ArrayLike, rate: ArrayLike = 0.0) -> Vector:
        """Force on the stop, N, at deflections (m) and their rates (m/s)."""
        raise NotImplementedError

    def potential_at(self, deflection: ArrayLike) -> Vector:
        """Energy stored at a deflection, J."""
        raise NotImplementedError

    def slope_at(self, deflection: ArrayLike) -> Vector:
        """d force / d deflection, N/m."""
        raise NotImplementedError

    def deflection_at(self, force: ArrayLike) -> Vector:
        """Largest deflection (m) at which the force (N), at rest, is not above the one given;
        infinite where it never is."""
        raise NotImplementedError

    def impact(self, speed: float, mass: float) -> Impact:
        """The contact of a free mass (of a pair: its reduced mass, kg) that arrives at `speed`."""
        raise NotImplementedError

    def per_unit_mass(self, mass: float) -> Self:
        """The law for a force per unit mass, N/kg."""
        raise NotImplementedError

    def strengths(self) -> tuple[float, ...]:
        """Numbers with a unit that the law holds."""
        raise NotImplementedError


class Elastic(CompliantLaw):
    """A linear spring, force = stiffness * y.

    Examples
    --------
    >>> law = Elastic(stiffness=100.0)
    >>> float(law.force_at(0.1)), law.potential_at([0.0, 0.1]).tolist()
    (10.0, [0.0, 0.5000000000000001])
    >>> law.impact(speed=1.0, mass=1.0).peak_force
    10.0
    """

    word: ClassVar[str] = "elastic"

    kind: Literal["elastic"] = "elastic"
    stiffness: Positive

    def force_at(self, deflection: ArrayLike, rate: ArrayLike = 0.0) -> Vector:
        return self.stiffness * _inside(deflection)

    def potential_at(self, deflection: ArrayLike) -> Vector:
        return 0.5 * self.stiffness * _inside(deflection) ** 2

    def slope_at(self, deflection: ArrayLike) -> Vector:
        return np.where(_inside(deflection) > 0.0, self.stiffness, 0.0)

    def deflection_at(self, force: ArrayLike) -> Vector:
        return _inside(force) / self.stiffness

    def impact(self, speed: float, mass: float) -> Impact:
        return kelvin_voigt(self.stiffness, 0.0, speed, mass)

    def per_unit_mass(self, mass: float) -> Self:
        return self.model_copy(update={"stiffness": self.stiffness / mass})

    def strengths(self) -> tuple[float, ...]:
        return (self.stiffness,)


class Viscoelastic(CompliantLaw):
    """A spring and a damper side by side that can only push (Kelvin-Voigt, B App. I).

    force = max(K y + c y', 0), c = 2 z sqrt(K M), z the damping ratio and M the mass (of a pair:
    the reduced mass). A contact ends when the force returns to zero, which it does before the
    deflection does; the limiter, which has no mass, then recovers at once: it follows the mass
    without a force, and pushes again where K y + c y' becomes positive.

    Parameters
    ----------
    stiffness
        K, N/m.
    damping_ratio
        z, of any size. The restitution that a free mass sees is exp(-2 z arccos z / sqrt(1 - z^2)).

    Examples
    --------
    >>> law = Viscoelastic(stiffness=1.0, damping_ratio=0.2)
    >>> round(law.restitution, 12), round(law.impact(speed=1.0, mass=1.0).contact_time, 10)
    (0.571740027585, 2.7953544407)
    """

    word: ClassVar[str] = "viscoelastic"

    kind: Literal["viscoelastic"] = "viscoelastic"
    stiffness: Positive
    damping_ratio: NonNegative

    @property
    def conservative(self) -> bool:
        return self.damping_ratio == 0.0

    @property
    def restitution(self) -> float:
        """Restitution of a free mass, R = exp(-2 z arccos z / sqrt(1 - z^2)) (B App. I)."""
        return math.exp(-2.0 * self.damping_ratio * half_contact(self.damping_ratio))

    def damping(self, mass: float) -> float:
        """c = 2 z sqrt(K M), N s/m."""
        return 2.0 * self.damping_ratio * math.sqrt(self.stiffness * mass)

    def force_at(self, deflection: ArrayLike, rate: ArrayLike = 0.0, mass: float = 1.0) -> Vector:
        """Force on the stop, N; the mass that the damping ratio refers to, kg, by default 1."""
        y = np.asarray(deflection, dtype=float)
        push = self.stiffness * y + self.damping(mass) * np.asarray(rate, dtype=float)
        return np.where(y > 0.0, np.maximum(push, 0.0), 0.0)

    def potential_at(self, deflection: ArrayLike) -> Vector:
        """Energy in the spring alone, J."""
        return 0.5 * self.stiffness * _inside(deflection) ** 2

    def slope_at(self, deflection: ArrayLike) -> Vector:
        """Stiffness of the spring alone, N/m."""
        return np.where(_inside(deflection) > 0.0, self.stiffness, 0.0)

    def deflection_at(self, force: ArrayLike) -> Vector:
        return _inside(force) / self.stiffness

    def impact(self, speed: float, mass: float) -> Impact:
        return kelvin_voigt(self.stiffness, self.damping_ratio, speed, mass)

    def per_unit_mass(self, mass: float) -> Self:
        return self.model_copy(update={"stiffness": self.stiffness / mass})

    def strengths(self) -> tuple[float, ...]:
        return (self.stiffness,)


class Hertz(CompliantLaw):
    """Contact of two round bodies, force = coefficient * y^(3/2).

    A mass M that arrives at the speed w is stopped at y_m = (5 M w^2 / (4 k))^(2/5) and leaves
    after (4/5) (y_m / w) Gamma(2/5) Gamma(1/2) / Gamma(9/10) = 2.943 y_m / w.

    Examples
    --------
    >>> contact = Hertz(coefficient=1.25).impact(speed=1.0, mass=1.0)
    >>> contact.peak_deflection, round(contact.contact_time, 6)
    (1.0, 2.943275)
    """

    word: ClassVar[str] = "Hertz"

    kind: Literal["hertz"] = "hertz"
    coefficient: Positive

    def force_at(self, deflection: ArrayLike, rate: ArrayLike = 0.0) -> Vector:
        return self.coefficient * _inside(deflection) ** 1.5

    def potential_at(self, deflection: ArrayLike) -> Vector:
        return 0.4 * self.coefficient * _inside(deflection) ** 2.5

    def slope_at(self, deflection: ArrayLike) -> Vector:
        return 1.5 * self.coefficient * np.sqrt(_inside(deflection))

    def deflection_at(self, force: ArrayLike) -> Vector:
        return np.asarray((_inside(force) / self.coefficient) ** (2.0 / 3.0))

    def impact(self, speed: float, mass: float) -> Impact:
        deepest = (1.25 * mass * speed**2 / self.coefficient) ** 0.4
        time = 0.8 * deepest / speed * math.gamma(0.4) * math.gamma(0.5) / math.gamma(0.9)
        return Impact(time, time / 2.0, 1.0, deepest, self.coefficient * deepest**1.5)

    def per_unit_mass(self, mass: float) -> Self:
        return self.model_copy(update={"coefficient": self.coefficient / mass})

    def strengths(self) -> tuple[float, ...]:
        return (self.coefficient,)


class ForceTable(CompliantLaw):
    """A measured force over deflection, linear between its points.

    Beyond the last point the force goes on with the slope of the last piece; before the first it
    starts from (0, 0), which is put in front where it is not given.

    Parameters
    ----------
    deflection
        Increasing, m, from 0 on.
    force
        Never decreasing, N, 0 at the deflection 0.
    file, unit
        Instead of the two: a file of two columns, and their units, "m,N" or "mm,N".
    source
        Where the numbers come from; the name of the file, if they were read.

    Examples
    --------
    >>> law = ForceTable(deflection=[0.01, 0.02], force=[1.0, 4.0])
    >>> law.force_at([0.005, 0.015, 0.03]).round(12).tolist()
    [0.5, 2.5, 7.0]
    >>> round(float(law.potential_at(0.01)), 12)
    0.005
    """

    word: ClassVar[str] = "tabulated"

    kind: Literal["table"] = "table"
    deflection: NonNegatives
    force: NonNegatives
    file: str | None = None
    unit: Literal["m,N", "mm,N"] | None = None
    source: str | None = None

    @model_validator(mode="before")
    @classmethod
    def _from_file(cls, keys: Any) -> Any:
        """A law read from a file is one with the numbers in it: it needs the file no more."""
        if not isinstance(keys, dict) or not isinstance(keys.get("file"), str):
            return keys
        given = [name for name in ("deflection", "force") if keys.get(name) is not None]
        if given:
            raise ValueError(f"takes file, or deflection and force, got file and {given[0]}")
        unit = keys.get("unit")
        if not isinstance(unit, str) or unit not in DEFLECTION_UNITS:
            choices = " or ".join(repr(name) for name in DEFLECTION_UNITS)
            raise SceneError([("unit", f"must be {choices} for the columns of file, got {unit!r}")])
        try:
            deflection, force = read_table(Path(keys["file"]), ("deflection", "force"))
        except SceneError as error:
            raise SceneError([("file", str(error))]) from None
        kept = {name: value for name, value in keys.items() if name not in ("file", "unit")}
        return (
            {"source": Path(keys["file"]).name}
            | kept
            | {
                "deflection": (deflection * DEFLECTION_UNITS[unit]).tolist(),
                "force": force.tolist(),
            }
        )

    @model_validator(mode="after")
    def _grows(self) -> Self:
        if self.unit is not None:
            raise ValueError("takes unit with a file only: deflection is in m, force in N")
        if len(self.deflection) != len(self.force):
            raise ValueError(
                f"needs as many entries in force as in deflection, got {len(self.force)} and "
                f"{len(self.deflection)}"
            )
        if not self.deflection or self.deflection[-1] == 0.0:
            raise ValueError("needs at least one point with a deflection above 0")
        if self.deflection[0] == 0.0 and self.force[0] > 0.0:
            raise ValueError(f"needs force 0 at the deflection 0, got {self.force[0]:g}")
        for one, two in pairwise(self.deflection):
            if one >= two:
                raise ValueError(f"needs increasing deflection, got {two:g} after {one:g}")
        for one, two in pairwise(self.force):
            if one > two:
                raise ValueError(f"needs force that never decreases, got {two:g} after {one:g}")
        return self

    @property
    def pieces(self) -> Vector:
        """(3, pieces): deflection and force where a piece begins, and its slope; the last has no
        end."""
        y, f = np.array(self.deflection), np.array(self.force)
        if y[0] > 0.0:
            y, f = np.insert(y, 0, 0.0), np.insert(f, 0, 0.0)
        return np.stack([y[:-1], f[:-1], np.diff(f) / np.diff(y)])

    def _piece(self, deflection: ArrayLike) -> tuple[NDArray[np.intp], Vector, Vector, Vector]:
        """Of the piece at each deflection: its number, force and slope, and how far into it."""
        starts, forces, slopes = self.pieces
        y = _inside(deflection)
        number = np.searchsorted(starts, y, side="right") - 1
        return number, forces[number], slopes[number], y - starts[number]

    def force_at(self, deflection: ArrayLike, rate: ArrayLike = 0.0) -> Vector:
        _, force, slope, into = self._piece(deflection)
        return np.asarray(force + slope * into)

    def potential_at(self, deflection: ArrayLike) -> Vector:
        starts, forces, slopes = self.pieces
        lengths = np.diff(starts)
        areas = lengths * (forces[:-1] + 0.5 * slopes[:-1] * lengths)
        before = np.concatenate([[0.0], np.cumsum(areas)])
        number, force, slope, into = self._piece(deflection)
        return np.asarray(before[number] + into * (force + 0.5 * slope * into))

    def slope_at(self, deflection: ArrayLike) -> Vector:
        _, _, slope, _ = self._piece(deflection)
        return np.where(np.asarray(deflection) > 0.0, slope, 0.0)

    def deflection_at(self, force: ArrayLike) -> Vector:
        starts, forces, slopes = self.pieces
        given = _inside(force)
        number = np.searchsorted(forces, given, side="right") - 1
        with np.errstate(divide="ignore", invalid="ignore"):
            into = np.where(
                slopes[number] > 0.0, (given - forces[number]) / slopes[number], math.inf
            )
        return np.asarray(starts[number] + into)

    def impact(self, speed: float, mass: float) -> Impact:
        """Piece by piece, each a part of a harmonic motion.

        From the speed v_0 to v_1 over the distance d it takes (2 / W) arctan(W d / (v_0 + v_1)),
        W^2 = slope / mass.
        """
        starts, forces, slopes = self.pieces / np.array([[1.0], [mass], [mass]])
        ends = np.append(starts[1:], math.inf)
        time, left = 0.0, speed**2
        for start, end, force, slope in zip(starts, ends, forces, slopes, strict=True):
            # where left - 2 force d - slope d^2 = 0, written so that either may be 0
            push = force + math.sqrt(force**2 + slope * left)
            turn = left / push if push else math.inf
            distance = min(end - start, turn)
            y = start + distance
            rest = left - distance * (2.0 * force + slope * distance) if turn > distance else 0.0
            speeds, root = math.sqrt(left) + math.sqrt(rest), math.sqrt(slope)
            time += 2.0 * (
                math.atan(root * distance / speeds) / root if root else distance / speeds
            )
            left = rest
            if left == 0.0:
                break
        return Impact(2.0 * time, time, 1.0, y, float(self.force_at(y)))

    def per_unit_mass(self, mass: float) -> Self:
        return self.model_copy(update={"force": tuple(force / mass for force in self.force)})

    def strengths(self) -> tuple[float, ...]:
        return (*self.deflection, *self.force)


DEFLECTION_UNITS = {"m,N": 1.0, "mm,N": 1e-3}
"""Units of the columns of a file of forces: unit -> factor of the deflection to m."""


def _inside(deflection: ArrayLike) -> Vector:
    """The deflection, 0 for a mass that does not touch the stop."""
    return np.asarray(np.maximum(np.asarray(deflection, dtype=float), 0.0))


def _kind(value: Any) -> str:
    """The kind of a law by its key; restitution where it is left out."""
    kind = value.get("kind", "restitution") if isinstance(value, dict) else None
    return str(getattr(value, "kind", "restitution") if kind is None else kind)


def not_rigid(stops: Iterable[tuple[str, Law]]) -> list[str]:
    """What stands in the way of a method that needs rigid stops; `stops` are (side, law)."""
    return [
        f"stops must be rigid (law.kind = 'restitution'), got {law.kind!r} at the {side} stop"
        for side, law in stops
        if not law.rigid
    ]


Law = Annotated[
    Annotated[Restitution, Tag("restitution")]
    | Annotated[SpeedRestitution, Tag("speed-restitution")]
    | Annotated[Elastic, Tag("elastic")]
    | Annotated[Viscoelastic, Tag("viscoelastic")]
    | Annotated[Hertz, Tag("hertz")]
    | Annotated[ForceTable, Tag("table")],
    Discriminator(_kind),
]
"""Every law that a stop may follow."""
