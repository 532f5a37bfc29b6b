"""A statistic of one's own: the mean over time of a function of the motion."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from pydantic import PrivateAttr, model_validator

from stochvi.engine.laws.force_function import NotCompiled, compiled_of, contents_of
from stochvi.engine.statistic_calls import NO_STATISTICS, Statistics, addresses_of
from stochvi.mathematics.arrays import Matrix, Vector
from stochvi.model.model import Model
from stochvi.scenes.validation import Checked, Function, _name_of, arguments_fault

if TYPE_CHECKING:
    from stochvi.model.modal import ModalForm


class Statistic(Checked):
    """The mean over time of a function of displacement and velocity, E f(x, v).

    `simulate` compiles the function and averages its values over all paths, in the middle between
    two kicks of noise. A function that is 1 where something holds and 0 elsewhere gives the share
    of time in which it holds.

    Parameters
    ----------
    function
        A function (displacement, velocity) of two numbers in m and m/s that returns a number: plain
        Python with `math`, or compiled by numba.
    of
        The coordinate, the point or the impact pair whose displacement and velocity the function
        takes; that of a pair is its gap. By default the only coordinate of the scene.

    See Also
    --------
    stochvi.simulate : The simulation, by its argument `statistics`.
    stochvi.history : Paths as tables, for what depends on the past of a motion.

    Examples
    --------
    >>> import stochvi
    >>> scene = stochvi.load_scene(stochvi.scenes.shipped_scene("oscillator-elastic"))
    >>> deep = Statistic(function=lambda x, v: 1.0 if x > 0.5 else 0.0)
    >>> answer = stochvi.simulate(scene, statistics={"beyond 0.5 m": deep}, paths=256)
    >>> share = answer.statistics["beyond 0.5 m"]
    >>> abs(share.value - 0.2195) < 5.0 * share.standard_error
    True
    """

    function: Function
    of: str | None = None
    _contents: str = PrivateAttr(default="")
    """Digest of the instructions of the function and of the values that it uses."""

    @model_validator(mode="after")
    def _compiles(self) -> Self:
        if fault := arguments_fault(self.function):
            raise ValueError(
                f"needs function that takes a displacement (m) and a velocity (m/s), got {fault}"
            )
        try:
            compiled_of(self.function)
        except NotCompiled as error:
            raise ValueError(
                f"needs function that numba compiles, got {_name_of(self.function)}: {error}; "
                "write it with numbers, `if` and `math`, or compile it with numba.njit"
            ) from None
        self._contents = contents_of([self.function])
        return self

    def document(self) -> dict[str, Any]:
        """The name of the function, with a digest of its instructions, and the name `of`."""
        return {"function": f"{_name_of(self.function)} ({self._contents[:16]})", "of": self.of}

    def row_of(self, model: Model) -> Vector:
        """The row (n,) with displacement = row . q. ValueError where nothing has the name `of`."""
        rows: dict[str, Vector] = {pair.name: pair.direction for pair in model.pairs}
        rows |= zip(model.outputs, model.output_rows, strict=True)
        if self.of is None and len(model.coordinates) == 1:
            return rows[model.coordinates[0]]
        if self.of not in rows:
            raise ValueError(
                f"of must be a coordinate, a point or an impact pair of the scene "
                f"({', '.join(rows)}), got {self.of!r}"
            )
        return rows[self.of]


def check_statistics(statistics: Mapping[str, Statistic], model: Model) -> None:
    """Raise ValueError unless each is a `Statistic` of something in the model."""
    for name, each in statistics.items():
        if not isinstance(each, Statistic):
            raise ValueError(
                f"statistics must be a table of names and `Statistic`, got {name!r}: {each!r}; "
                "give each function anew, also to a run that goes on"
            )
        each.row_of(model)


def statistics_of(
    statistics: Mapping[str, Statistic], model: Model, half_kick: tuple[Matrix, Matrix]
) -> Statistics:
    """The functions for the kernel.

    `half_kick` is decay and noise of half a kick, from the sampled velocities of the modes.
    """
    if not statistics:
        return NO_STATISTICS
    modes: ModalForm = model.modal
    decay, brought = half_kick
    rows = np.array([each.row_of(model) for each in statistics.values()]) @ modes.shapes
    return Statistics(
        functions=addresses_of([each.function for each in statistics.values()]),
        displacements=np.ascontiguousarray(rows),
        rates=np.ascontiguousarray(rows @ decay),
        places=rows @ modes.rest,
        spreads=np.linalg.norm(rows @ brought, axis=1),
    )
