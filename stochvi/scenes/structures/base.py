"""What every structure answers: a scene and its model ask nothing else of it.

A structure moves by coordinates q (n,). What acts on it or is measured on it is a linear functional
of them, row . q: a coordinate itself, a named point, the difference of two, or a weighted sum.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from stochvi.mathematics.arrays import Matrix, Vector
from stochvi.scenes.characteristics import Characteristic, Damper, Spring
from stochvi.scenes.validation import Checked


@dataclass(frozen=True, eq=False)
class Placed:
    """A spring or damper that is a function, where it acts.

    Parameters
    ----------
    name
        Its name in answers.
    row
        Its displacement row . q (n,).
    law
        Its force.
    count
        Number of equal ones side by side.
    """

    name: str
    row: Vector
    law: Characteristic
    count: int = 1


class AnyStructure(Checked):
    """Base class of every structure, M q'' + C q' + K q = force.

    Parameters
    ----------
    spring, damper
        Springs and dampers that are functions, one or a list: the kinds of "springs and dampers".
        Their forces add to those of stiffness and damping.
    """

    spring: Spring | None = None
    damper: Damper | None = None

    linear: ClassVar[bool] = True
    """Whether springs and dampers are linear, so that `matrices` hold all of them."""

    needed_to_move: ClassVar[str] = (
        "structure.kind = 'isolator' or one of several coordinates, got {kind!r}"
    )
    """What a structure lacks whose base may not move, with a place for its kind."""

    on_mount: ClassVar[bool] = False
    """Whether an excitation that does not say where it acts moves the base."""

    if TYPE_CHECKING:  # some structures compute them, and of some they are a key

        @property
        def coordinates(self) -> tuple[str, ...]:
            """Names of the coordinates, n of them."""

    @property
    @abstractmethod
    def matrices(self) -> tuple[Matrix, ...]:
        """Mass, damping and stiffness, (n, n) each."""

    @property
    def places(self) -> Mapping[str, Vector]:
        """Rows (n,) of the places on which a pair or a force may act, by name."""
        return dict(zip(self.coordinates, np.eye(len(self.coordinates)), strict=True))

    @property
    def reported(self) -> Mapping[str, Vector]:
        """Rows (n,) of the displacements that are reported besides the coordinates, by name."""
        return {}

    @property
    def functions(self) -> tuple[Placed, ...]:
        """Springs and dampers that are functions, with their places."""
        found = []
        for key, laws in (("spring", self.spring), ("damper", self.damper)):
            for number, law in enumerate(laws or (), 1):
                name = key if len(laws or ()) == 1 else f"{key} {number}"
                found.append(Placed(name, self.row_of_function(law), law, self.in_parallel))
        return tuple(found)

    @property
    def in_parallel(self) -> int:
        """Number of equal springs and dampers, each with the stated values, that carry the mass."""
        return 1

    def row_of_function(self, law: Characteristic) -> Vector:
        """Displacement row . q (n,) of a spring or damper that is a function."""
        known = self.places
        if law.between is not None:
            one, other = law.between
            return np.asarray(known[one] - known[other])
        return np.asarray(known[law.on or next(iter(known))])

    def misplaced_functions(self) -> list[tuple[str, str]]:
        """Key and fault of each spring or damper that is a function and does not say where it
        acts."""
        found = []
        for key, laws in (("spring", self.spring), ("damper", self.damper)):
            for law in laws or ():
                if fault := self._misplaced(law):
                    found.append((f"structure.{key}", fault))
        return found

    def _misplaced(self, law: Characteristic) -> str:
        names = [*(law.between or ()), *((law.on,) if law.on is not None else ())]
        known = list(self.places)
        listed = " or ".join(repr(name) for name in known)
        if law.axis is not None:
            return "takes axis in a [[structure.mount]] only, got one of the structure"
        if law.on is not None and law.between is not None:
            return "takes on or between, got both"
        if not names and len(known) > 1:
            return f"needs on or between, with names of {listed}, got none"
        if unknown := [name for name in names if name not in known]:
            return f"must be on {listed}, got {unknown[0]!r}"
        if len(set(names)) < len(names):
            return f"needs two different places in between, got {names[0]!r} twice"
        if not self.knows_mass:
            return "is a force, which needs structure.mass, got none"
        return ""

    @property
    def shown(self) -> tuple[str, ...]:
        """Names of the displacements that pictures show, the first where one alone is shown."""
        return (*self.coordinates, *self.reported)

    @property
    def carried(self) -> Mapping[str, Vector]:
        """Accelerations of the coordinates (n,) per unit of that of a base that they follow, by
        axis of the base; the axis is "" where the base has only one."""
        return {"": np.ones(len(self.coordinates))}

    @property
    def movable(self) -> bool:
        """Whether the base may move."""
        return True

    @property
    def gravity_load(self) -> float:
        """Constant acceleration of gravity along x, m/s^2; 0 if the scene leaves gravity out."""
        return 0.0

    @property
    def knows_mass(self) -> bool:
        """Whether the mass is stated, on which forces depend."""
        return True

    @property
    def carried_mass(self) -> float | None:
        """Mass that a base carries, kg; None where it is not known."""
        return None

    @property
    def rates(self) -> tuple[float, float] | None:
        """omega (rad/s) and b (1/s) of a structure of one coordinate; None for several."""
        mass, damping, stiffness = self.matrices
        if len(mass) > 1:
            return None
        return math.sqrt(stiffness[0, 0] / mass[0, 0]), float(damping[0, 0] / mass[0, 0])

    def compliance(self, weights: Mapping[str, float]) -> float:
        """Static compliance (m/N) of the motion that the coordinates leave out, seen by a force on
        the places of `weights`, times these weights."""
        return 0.0

    def constant_forces(self) -> Iterator[tuple[float, Vector]]:
        """Strength and direction (n,) of each constant force that the structure brings along."""
        yield from ()

    def cautions(self, rigid: Sequence[str]) -> list[str]:
        """Sentences on what makes answers doubtful where the pairs of these names are rigid."""
        return []

    def assumptions(self) -> list[str]:
        """Assumptions on the structure, in words."""
        return []
