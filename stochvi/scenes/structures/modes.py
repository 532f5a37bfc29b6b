"""Structures by their natural modes: displacement at a point = sum of shape_k q_k, with

    m_k (q_k'' + 2 zeta_k omega_k q_k' + omega_k^2 q_k) = sum of shape_k force - m_k G_k a_base

for each mode k of modal mass m_k and participation factor G_k.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np
from pydantic import BeforeValidator, Field, WithJsonSchema, model_validator

from stochvi.mathematics.arrays import Matrix, Vector
from stochvi.results.errors import SceneError
from stochvi.scenes.modal_tables import read_modes
from stochvi.scenes.structures.base import AnyStructure
from stochvi.scenes.validation import (
    Column,
    Count,
    NonNegative,
    NonNegatives,
    Numbers,
    Positive,
    given,
    sentences_of,
)


@dataclass(frozen=True, eq=False)
class ModalTable:
    """The modes of a structure, n of them, and what of it they leave out.

    Parameters
    ----------
    omega, zeta, mass
        Natural frequencies (rad/s), damping ratios and modal masses (kg), (n,) each.
    shapes
        Displacements of named points in each mode, (n,).
    participation
        Participation factors (n,) of a base that moves; None where none is known.
    """

    omega: Vector
    zeta: Vector
    mass: Vector
    shapes: Mapping[str, Vector]
    participation: Vector | None

    def part(self, kept: slice) -> ModalTable:
        """Some of the modes."""
        return ModalTable(
            omega=self.omega[kept],
            zeta=self.zeta[kept],
            mass=self.mass[kept],
            shapes={name: shape[kept] for name, shape in self.shapes.items()},
            participation=None if self.participation is None else self.participation[kept],
        )


class ModalStructure(AnyStructure):
    """Base class of the structures that are made of natural modes."""

    needed_to_move: ClassVar[str] = (
        "structure.participation, a number for each mode: (shape' M 1) / modal_mass, got none"
    )

    @property
    @abstractmethod
    def table(self) -> ModalTable:
        """The modes."""

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Names of the modal coordinates."""
        return tuple(f"mode {k + 1}" for k in range(len(self.table.omega)))

    @property
    def matrices(self) -> tuple[Matrix, ...]:
        """Modal mass, damping and stiffness, which are diagonal."""
        omega, mass = self.table.omega, self.table.mass
        return tuple(
            np.diag(mass * each) for each in (1.0, 2.0 * self.table.zeta * omega, omega**2)
        )

    @property
    def natural_frequency_hz(self) -> Vector:
        """Undamped natural frequencies in rising order (n,), Hz."""
        return self.table.omega / (2.0 * math.pi)

    @property
    def places(self) -> Mapping[str, Vector]:
        """Rows (n,) of the points, then of the modal coordinates."""
        return {**self.table.shapes, **super().places}

    def cautions(self, rigid: Sequence[str]) -> list[str]:
        if not rigid or len(self.table.omega) == 1:
            return []
        return [
            f"rigid stops of {', '.join(rigid)}: the mass that rebounds falls with every mode, and "
            "with it the rate and the force of impacts change; compare with other numbers of "
            "modes, or give the stop its stiffness (law.kind = 'elastic' or 'hertz')"
        ]

    @property
    def reported(self) -> Mapping[str, Vector]:
        return self.table.shapes

    @property
    def shown(self) -> tuple[str, ...]:
        return tuple(self.table.shapes)

    @property
    def movable(self) -> bool:
        return self.table.participation is not None

    @property
    def carried(self) -> Mapping[str, Vector]:
        found = self.table.participation
        return {"": np.zeros(len(self.table.omega)) if found is None else found}


def _several(value: object) -> object:
    """A list as it is, one number as a list of one."""
    if isinstance(value, int | float) and not isinstance(value, bool):
        return (value,)
    return value


def _or_one(**limit: float) -> WithJsonSchema:
    """Schema of a list of numbers within a limit, or one such number."""
    number = {"type": "number", **limit}
    return WithJsonSchema({"anyOf": [number, {"type": "array", "items": number}]})


OneOrMore = Annotated[NonNegatives, BeforeValidator(_several), _or_one(minimum=0.0)]
"""A number for all modes, or one for each."""

Positives = Annotated[Column, BeforeValidator(_several), _or_one(exclusiveMinimum=0.0)]
"""A positive number for all modes, or one for each."""


class Modes(ModalStructure):
    """A linear structure by its natural modes, measured or from finite elements.

    Parameters
    ----------
    frequency_hz
        Natural frequency of each mode, Hz; 0 for a motion that no spring holds.
    zeta, Q
        Damping ratio or quality factor, one for all modes or one for each; exactly one of the two.
    modal_mass
        Modal mass, kg, one for all modes or one for each; 1 where the shapes are normalised to the
        mass.
    shapes
        Displacement of each named point in each mode, in the direction that counts there.
    participation
        Participation factor of each mode for a base that moves, (shape' M 1) / modal_mass; left
        out where the base stands still.
    residual_compliance
        Static compliance (m/N) at points by all modes that are not given; it lies in series with
        a compliant stop there.
    modes, max_frequency_hz
        Number of modes that move, from the lowest; or all up to a frequency, Hz. The others yield
        by their static compliance, which adds to `residual_compliance`.
    file
        Instead of these: a table (.csv) with a row for each mode and columns called frequency_hz,
        zeta or Q, modal_mass, participation and after the points; or mode shapes of a UFF file
        (datasets 55), of Nastran (.op2) or of Exodus (.exo, .e), with the extra `fem`.
    points
        With a file: a name for each point, and its column. Files of mode shapes take node and
        direction, as { tip = "12.z" } or "12.-z".
    source
        Where the numbers come from; by default the name of the file.

    Raises
    ------
    SceneError
        If lists differ in length, or a file does not hold what is needed.

    See Also
    --------
    stochvi.scenes.Beam : A beam, whose modes are computed.
    stochvi.Matrices : A structure by its matrices.

    Examples
    --------
    >>> blade = Modes(frequency_hz=[20.0, 125.0], zeta=0.01, shapes={"tip": [1.0, -1.0]})
    >>> blade.coordinates, blade.places["tip"].tolist()
    (('mode 1', 'mode 2'), [1.0, -1.0])
    """

    kind: Literal["modes"] = "modes"
    frequency_hz: NonNegatives = Field(min_length=1)
    zeta: OneOrMore | None = None
    Q: Positives | None = None
    modal_mass: Positives = (1.0,)
    shapes: dict[str, Numbers]
    participation: Numbers | None = None
    residual_compliance: dict[str, NonNegative] | None = None
    modes: Count | None = None
    max_frequency_hz: Positive | None = None
    file: str | None = None
    points: dict[str, str] | None = None
    source: str | None = None

    @model_validator(mode="before")
    @classmethod
    def _from_file(cls, keys: Any) -> Any:
        """The keys with the numbers of the file instead of its name, if a file is given."""
        if not isinstance(keys, dict) or not isinstance(keys.get("file"), str):
            return keys
        points = keys.get("points")
        if points is not None and not (
            isinstance(points, dict) and all(isinstance(each, str) for each in points.values())
        ):
            raise SceneError(
                [("points", f'must name columns or nodes, as {{ tip = "12.z" }}, got {points!r}')]
            )
        with sentences_of("file"):
            found = read_modes(keys["file"], points)
        kept = {name: value for name, value in keys.items() if name not in ("file", "points")}
        twice = sorted(found.keys() & kept.keys() - {"source"})
        if {"zeta", "Q"} & kept.keys():
            found = {name: value for name, value in found.items() if name not in ("zeta", "Q")}
        twice = [name for name in twice if name not in ("zeta", "Q", "modal_mass")]
        if twice:
            raise ValueError(f"takes {twice[0]} from the file or from the scene, got both")
        return found | kept

    @model_validator(mode="after")
    def _fit_together(self) -> Self:
        count = len(self.frequency_hz)
        problems = []
        if self.points is not None:
            problems.append(("points", "is for a file; give shapes"))
        if (self.zeta is None) == (self.Q is None):
            raise ValueError(f"needs exactly one of zeta and Q, got {given(self, 'zeta', 'Q')}")
        for name in ("zeta", "Q", "modal_mass", "participation"):
            values = getattr(self, name)
            if values is not None and len(values) != count and (
                len(values) != 1 or name == "participation"
            ):  # fmt: skip
                problems.append(
                    (name, f"must hold {count} numbers, one for each mode, got {len(values)}")
                )
        if self.modes is not None and self.max_frequency_hz is not None:
            raise ValueError("needs at most one of modes and max_frequency_hz, got both")
        if self.modes is not None and self.modes > count:
            problems.append(
                ("modes", f"must be at most the {count} that are given, got {self.modes}")
            )
        elif not self._moving:
            problems.append(
                ("max_frequency_hz", "must be above the lowest natural frequency, got "
                 f"{self.max_frequency_hz:g}; raise it, or give modes = 1")
            )  # fmt: skip
        if not self.shapes:
            problems.append(("shapes", "must name one point at least, got none"))
        for name, shape in self.shapes.items():
            if not name or name in ("base", *self.coordinates_of(count)):
                problems.append(
                    ("shapes", "must have names other than 'base' and those of modes, got "
                     f"{name!r}; choose another name")
                )  # fmt: skip
            elif len(shape) != count:
                problems.append(
                    (
                        f"shapes.{name}",
                        f"must hold {count} numbers, one for each mode, got {len(shape)}",
                    )
                )
        for name in self.residual_compliance or {}:
            if name not in self.shapes:
                problems.append(
                    ("residual_compliance", f"must name points of shapes, got {name!r}; known are "
                     f"{', '.join(self.shapes)}")
                )  # fmt: skip
        if problems:
            raise SceneError(problems)
        return self

    @staticmethod
    def coordinates_of(count: int) -> tuple[str, ...]:
        """Names of the modal coordinates of so many modes."""
        return tuple(f"mode {k + 1}" for k in range(count))

    @property
    def _moving(self) -> int:
        """Number of the modes that move."""
        if self.max_frequency_hz is not None:
            return sum(each <= self.max_frequency_hz for each in self.frequency_hz)
        return len(self.frequency_hz) if self.modes is None else self.modes

    @cached_property
    def given_modes(self) -> ModalTable:
        """All modes that are given, in rising order of their frequencies."""
        frequency = np.array(self.frequency_hz)
        order = np.argsort(frequency, kind="stable")
        zeta = np.array(self.zeta) if self.Q is None else 0.5 / np.array(self.Q)

        def each(values: Any) -> Vector:
            return np.broadcast_to(np.array(values, dtype=float), frequency.shape)[order]

        return ModalTable(
            omega=2.0 * math.pi * frequency[order],
            zeta=each(zeta),
            mass=each(self.modal_mass),
            shapes={name: each(shape) for name, shape in self.shapes.items()},
            participation=None if self.participation is None else each(self.participation),
        )

    @cached_property
    def table(self) -> ModalTable:
        """The modes that move, in rising order of their frequencies."""
        return self.given_modes.part(slice(self._moving))

    def compliance(self, weights: Mapping[str, float]) -> float:
        stated = self.residual_compliance or {}
        found = sum(weight**2 * stated.get(name, 0.0) for name, weight in weights.items())
        others = self.given_modes.part(slice(self._moving, None))
        if not set(weights) <= set(others.shapes):  # a modal coordinate has no point
            return found
        row = np.sum([weight * others.shapes[name] for name, weight in weights.items()], axis=0)
        return found + float(np.sum(row**2 / (others.mass * others.omega**2)))

    def assumptions(self) -> list[str]:
        found = [] if self.source is None else [f"modes: {self.source}"]
        moving, every = self._moving, len(self.frequency_hz)
        if moving == every:
            return [*found, f"the structure moves by {moving} modes"]
        return [
            *found,
            f"the structure moves by {moving} of {every} modes; the static compliance of the "
            "others lies in series with elastic, viscoelastic and tabulated stops",
        ]
