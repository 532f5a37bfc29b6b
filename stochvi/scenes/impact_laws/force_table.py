"""A measured force over the deflection of a stop."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Any, ClassVar, Literal, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import model_validator

from stochvi.mathematics.arrays import Vector
from stochvi.mathematics.kelvin_voigt import ContactSolution
from stochvi.results.errors import SceneError
from stochvi.scenes.impact_laws.base import CompliantLaw, Form, inside
from stochvi.scenes.si_columns import si_columns
from stochvi.scenes.text_tables import all_columns, read_text_table
from stochvi.scenes.validation import NonNegatives, sentences_of


@dataclass(frozen=True, eq=False)
class Pieces:
    """A table as linear pieces: deflection (m), force (N) and potential (J) at the start of each
    piece, and its slope (N/m)."""

    starts: Vector
    forces: Vector
    slopes: Vector
    potentials: Vector


class ForceTable(CompliantLaw):
    """A measured force over deflection, linear between its points.

    Beyond the last point the force continues with the slope of the last piece. The point (0, 0) is
    added in front if it is not given.

    Parameters
    ----------
    deflection
        Increasing, m, from 0 on; beyond the last one the last slope goes on.
    force
        Never decreasing, N, 0 at the deflection 0.
    file, unit
        Instead of the two: a file of two columns, and their units, "m,N" or "mm,N". The units may
        also stand in the headings of the columns, in any spelling.
    source
        Where the numbers come from; by default the name of the file from which they were read.

    See Also
    --------
    stochvi.Elastic : A straight line.
    stochvi.ImpactPair : Where the stop is.

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
        return with_columns(keys)

    @model_validator(mode="after")
    def _grows(self) -> Self:
        check_columns(self.unit, self.deflection, self.force)
        if not self.deflection or self.deflection[-1] == 0.0:
            raise ValueError("needs at least one point with a deflection above 0")
        if self.deflection[0] == 0.0 and self.force[0] > 0.0:
            raise ValueError(f"needs force 0 at the deflection 0, got {self.force[0]:g}")
        return self

    @cached_property
    def arrays(self) -> Pieces:
        """The table as pieces, made once because a closure asks for it some 100,000 times."""
        y, f = np.array(self.deflection), np.array(self.force)
        if y[0] > 0.0:
            y, f = np.insert(y, 0, 0.0), np.insert(f, 0, 0.0)
        starts, forces, slopes = y[:-1], f[:-1], np.diff(f) / np.diff(y)
        lengths = np.diff(starts)
        areas = lengths * (forces[:-1] + 0.5 * slopes[:-1] * lengths)
        return Pieces(starts, forces, slopes, np.concatenate([[0.0], np.cumsum(areas)]))

    @property
    def pieces(self) -> Vector:
        """Array (3, pieces): deflection and force at the start of each piece, and its slope. The
        last piece has no end."""
        return np.stack([self.arrays.starts, self.arrays.forces, self.arrays.slopes])

    def _piece(self, deflection: ArrayLike) -> tuple[NDArray[np.intp], Vector, Vector, Vector]:
        """For each deflection: number of the piece, force at its start, its slope, and the distance
        from its start."""
        table, y = self.arrays, inside(deflection)
        number = np.searchsorted(table.starts, y, side="right") - 1
        return number, table.forces[number], table.slopes[number], y - table.starts[number]

    def damping(self, mass: float) -> float:
        return 0.0

    def force_at(self, deflection: ArrayLike, rate: ArrayLike = 0.0, mass: float = 1.0) -> Vector:
        _, force, slope, into = self._piece(deflection)
        return np.asarray(force + slope * into)

    def potential_at(self, deflection: ArrayLike) -> Vector:
        number, force, slope, into = self._piece(deflection)
        before = self.arrays.potentials[number]
        return np.asarray(before + into * (force + 0.5 * slope * into))

    def slope_at(self, deflection: ArrayLike) -> Vector:
        _, _, slope, _ = self._piece(deflection)
        return np.where(np.asarray(deflection) > 0.0, slope, 0.0)

    def deflection_at(self, force: ArrayLike) -> Vector:
        forces, slopes, starts = self.arrays.forces, self.arrays.slopes, self.arrays.starts
        given = inside(force)
        number = np.searchsorted(forces, given, side="right") - 1
        with np.errstate(divide="ignore", invalid="ignore"):
            into = np.where(
                slopes[number] > 0.0, (given - forces[number]) / slopes[number], math.inf
            )
        return np.asarray(starts[number] + into)

    def impact(self, speed: float, mass: float) -> ContactSolution:
        """The contact of a free mass, whose motion within each piece is part of a harmonic one.

        From the speed v_0 to v_1 over the distance d it takes the time
        (2 / W) arctan(W d / (v_0 + v_1)), W^2 = slope / mass.
        """
        starts, forces, slopes = self.pieces / np.array([[1.0], [mass], [mass]])
        ends = np.append(starts[1:], math.inf)
        time, left = 0.0, speed**2
        for start, end, force, slope in zip(starts, ends, forces, slopes, strict=True):
            # root of left - 2 force d - slope d^2 = 0, written so that force or slope may be 0
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
        return ContactSolution(2.0 * time, time, 1.0, y, float(self.force_at(y)))

    def per_unit_mass(self, mass: float) -> Self:
        return self.model_copy(update={"force": tuple(force / mass for force in self.force)})

    def strengths(self) -> tuple[float, ...]:
        return (*self.deflection, *self.force)

    def scaled(self, length: float, time: float) -> Self:
        deflection = tuple(y / length for y in self.deflection)
        force = tuple(push * time**2 / length for push in self.force)
        return self.model_copy(update={"deflection": deflection, "force": force})

    def in_series(self, compliance: float) -> Self:
        deeper = tuple(
            y + compliance * push for y, push in zip(self.deflection, self.force, strict=True)
        )
        return self.model_copy(update={"deflection": deeper})

    def in_words(self) -> str:
        tail = f" (source: {self.source})" if self.source else ""
        deepest, most = f"{1e3 * self.deflection[-1]:#.4g}".rstrip("."), self.force[-1]
        return f"force over deflection, {most:.4g} N at {deepest} mm{tail}"

    def compiled(self) -> NamedTuple:
        from stochvi.engine.laws.force_table import ForceTable as Compiled

        return Compiled.of(self.pieces.T)

    def form(self) -> Form:
        return Form("pieces", np.ascontiguousarray(self.pieces.T))

    def knots(self) -> Vector:
        return np.asarray(self.pieces[0])

    @property
    def largest_force(self) -> float:
        return self.force[-1] if self.pieces[2, -1] == 0.0 else math.inf


def check_columns(unit: str | None, deflection: Sequence[float], force: Sequence[float]) -> None:
    """Raise `ValueError` where a table of deflection and force is none, or its force falls."""
    if unit is not None:
        raise ValueError("takes unit with a file only: deflection is in m, force in N")
    if len(deflection) != len(force):
        raise ValueError(
            f"needs as many entries in force as in deflection, got {len(force)} and "
            f"{len(deflection)}"
        )
    for one, two in pairwise(deflection):
        if one >= two:
            raise ValueError(f"needs increasing deflection, got {two:g} after {one:g}")
    for one, two in pairwise(force):
        if one > two:
            raise ValueError(f"needs force that never decreases, got {two:g} after {one:g}")


def with_columns(keys: Any) -> Any:
    """The keys with the numbers of the file instead of its name, if a file is given."""
    if not isinstance(keys, dict) or not isinstance(keys.get("file"), str):
        return keys
    given = [name for name in ("deflection", "force") if keys.get(name) is not None]
    if given:
        raise ValueError(f"takes file, or deflection and force, got file and {given[0]}")
    given_unit = keys.get("unit")
    if given_unit is not None and given_unit not in tuple(COLUMN_UNITS):
        raise SceneError([("unit", f"must be {CHOICES}, got {given_unit!r}")])
    names = ("deflection", "force")
    with sentences_of("file"):
        table = read_text_table(Path(keys["file"]), names)
        columns = all_columns(table, names)
    units = COLUMN_UNITS[given_unit] if given_unit else None
    deflection, force = si_columns(table, columns, ("length", "force"), units, CHOICES)
    kept = {name: value for name, value in keys.items() if name not in ("file", "unit")}
    return (
        {"source": Path(keys["file"]).name}
        | kept
        | {
            "deflection": deflection.tolist(),
            "force": force.tolist(),
        }
    )


COLUMN_UNITS = {"m,N": ("m", "N"), "mm,N": ("mm", "N")}
"""Units of the columns of deflection and force by the text that names both in the key `unit`."""

CHOICES = " or ".join(repr(name) for name in COLUMN_UNITS)
