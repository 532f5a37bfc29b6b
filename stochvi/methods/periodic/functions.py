"""Springs and dampers that are functions, over a family of scenes, as kernels take them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from stochvi.engine.characteristic import Affine
from stochvi.engine.characteristic_calls import Characteristics
from stochvi.engine.compiled_laws import row_of_numbers
from stochvi.mathematics.arrays import Matrix, Vector
from stochvi.methods.periodic.kernels import function_flow
from stochvi.model.coverage import functions_of_arrays, modulated
from stochvi.model.model import FunctionOfMotion, Model

STEADY = 1e-12
"""Relative change over the range up to which a number is the same everywhere: kernels read counts
from numbers, which the rounding of a series must not change."""


def not_followed(model: Model) -> list[str]:
    """The sentences of functions that regimes under a sine do not follow."""
    found = functions_of_arrays(model) + modulated(model)
    found += [
        f"structure.damper must not drive the structure, got kind {part.law.kind!r} ({part.name}), "
        "whose motion has a frequency of its own; simulate follows it"
        for part in model.functions
        if part.law.drives
    ]
    held = [part.name for part in model.functions if part.law.sticks and not part.law.drives]
    if len(held) > 1:
        found.append(
            "structure.damper must be one that sticks, at most, as which of several slip together "
            f"is not decided, got {', '.join(held)}; simulate follows them"
        )
    return found


def numbers_of_functions(
    model: Model, whitening: Matrix, unit: float, time: float, widths: tuple[int, int]
) -> Vector:
    """Numbers of all functions, one after another: displacement and acceleration per unit of each
    coordinate of the kernels and of its force, the numbers of the part, and its knots.

    Parameters
    ----------
    model
        The model.
    whitening
        Matrix to coordinates with unit masses.
    unit, time
        Unit of these coordinates in the kernels, and unit of time, s.
    widths
        Numbers of the longest part, and of knots.
    """
    found = list[Vector]()
    for part in model.functions:
        row = whitening @ part.direction
        own, knots = np.zeros(widths[0]), np.full(widths[1], function_flow.FAR)
        numbers, kinks = row_of_numbers(compiled(part)), part.law.knots()
        own[: len(numbers)], knots[: len(kinks)] = numbers, kinks
        found += [unit * row, row / (row @ row) * time**2 / unit, own, knots]
    return np.concatenate([np.zeros(0), *found])


def compiled(part: FunctionOfMotion) -> Any:
    """The part as kernels know it, for forces per unit of its reduced mass."""
    return part.law.compiled(part.mass / part.count)


def widths_of(model: Model) -> tuple[int, int]:
    """Numbers of the longest part, and of knots."""
    return (
        max((len(row_of_numbers(compiled(part))) for part in model.functions), default=0),
        max((len(part.law.knots()) for part in model.functions), default=0),
    )


def _kind(part: FunctionOfMotion) -> int:
    if part.law.sticks:
        return function_flow.STICKS
    turns = part.law.remembers or part.law.is_damper
    return function_flow.TURNS if turns else function_flow.SMOOTH


@dataclass(frozen=True, eq=False)
class FunctionsOfFamily:
    """The functions of the scenes of a family.

    Parameters
    ----------
    parts
        Those of one model, of which kernels read the classes.
    kinds, memories
        What each does where its rate passes 0, and the number of its memory, below 0 for none.
    numbers, series
        Numbers of one model, and Chebyshev coefficients (terms, numbers) over the range.
    sizes
        Numbers of coordinates, numbers of the longest part, and knots.
    pace
        1/s, the unit of rates.
    """

    parts: tuple[Any, ...]
    kinds: tuple[int, ...]
    memories: tuple[int, ...]
    numbers: Vector
    series: Matrix
    sizes: tuple[int, int, int]
    pace: float

    @classmethod
    def of(
        cls, model: Model, numbers: Vector, series: Matrix, widths: tuple[int, int], time: float
    ) -> FunctionsOfFamily:
        """The functions of a family, from one of its models, the numbers of that model and those
        over the range."""
        remembers = np.array([part.law.remembers for part in model.functions], bool)
        memories = np.where(remembers, np.cumsum(remembers) - 1, -1)
        return cls(
            parts=tuple(compiled(part) for part in model.functions),
            kinds=tuple(_kind(part) for part in model.functions),
            memories=tuple(memories.tolist()),
            numbers=numbers,
            series=series,
            sizes=(len(model.mass), *widths),
            pace=1.0 / time,
        )

    @property
    def remembering(self) -> int:
        """Number of memories."""
        return max(self.memories, default=-1) + 1

    def at(self, sigma: float) -> function_flow.Functions:
        """The functions at a place of the range."""
        found = np.polynomial.chebyshev.chebval(2.0 * sigma - 1.0, self.series)
        change = np.abs(self.series[1:]).sum(axis=0)
        numbers = np.where(change <= STEADY * np.abs(self.numbers), self.numbers, found)
        n, width, _ = self.sizes
        rows = np.reshape(numbers, (len(self.parts), -1))
        moved, changes = rows[:, :n].copy(), rows[:, n : 2 * n].copy()
        calls = Characteristics.of(
            list(self.parts), [Affine(0.0, 0.0, 0.0)] * len(self.parts), moved, changes,
            np.zeros(len(self.parts)), list(self.memories),
        )._replace(numbers=rows[:, 2 * n : 2 * n + width].copy())  # fmt: skip
        knots = rows[:, 2 * n + width :].copy()
        return function_flow.Functions(
            calls, self.pace, np.linalg.norm(moved, axis=1), knots, np.array(self.kinds, np.int64)
        )
