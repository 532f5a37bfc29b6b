"""The base of all structures: what a scene and its model ask a structure for."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from stochvi.mathematics.arrays import Matrix, Vector
from stochvi.scenes.impact_laws import Law
from stochvi.scenes.validation import Checked


class BaseStructure(Checked):
    """Base class of every structure, M q'' + C q' + K q = forces.

    A place of a structure is a named linear functional of its coordinates, a row: its displacement
    is row . q, and a force F on it is the force F row on the coordinates.
    """

    base_axes: ClassVar[tuple[str, ...]] = ("",)
    """Axes along which the base can move: one without a name, or x, y and z."""

    stands_on_base: ClassVar[bool] = False
    """Whether an excitation that does not say where it acts moves the base."""

    if TYPE_CHECKING:

        @property
        def coordinates(self) -> tuple[str, ...]:
            """Names of the coordinates q, n of them."""

        @property
        def matrices(self) -> tuple[Matrix, ...]:
            """Mass, damping and stiffness (n, n)."""

    @property
    def rates(self) -> tuple[float, float] | None:
        """omega (rad/s) and b (1/s) of one oscillator; None for any other structure."""
        return None

    @property
    def knows_mass(self) -> bool:
        """Whether the mass is given, so that forces can act."""
        return True

    @property
    def moving_mass(self) -> float | None:
        """Mass that follows the base, kg; None where it is not known."""
        mass, along = self.matrices[0], self.influence[self.base_axes[-1]]
        return float(along @ mass @ along) if self.knows_mass else None

    @property
    def places(self) -> Mapping[str, Vector]:
        """Rows (n,) of the places that impact pairs and forces can name."""
        return dict(zip(self.coordinates, np.eye(len(self.coordinates)), strict=True))

    @property
    def reported(self) -> Mapping[str, Vector]:
        """Rows (n,) of displacements that are reported besides the coordinates."""
        return {}

    @property
    def without_base(self) -> str:
        """Why no base moves the structure, in words; empty if one can."""
        return ""

    @property
    def influence(self) -> Mapping[str, Vector]:
        """Accelerations (n,) of the coordinates that follow the base, by its axes."""
        return {"": np.ones(len(self.coordinates))}

    @property
    def spread(self) -> Matrix | None:
        """Rows (k, n) of forces whose independent white noises together are noise that is white
        along the structure too, of unit intensity per metre (or square metre); None of a structure
        that has no such extent."""
        return None

    @property
    def weight(self) -> tuple[float, Vector] | None:
        """An acceleration, m/s^2, and the forces (n,) on the coordinates per unit of it by which
        gravity pulls; None where it is left out."""
        return None

    def compliance_left_out(self, row: Mapping[str, float]) -> float:
        """Static compliance, m/N, at a weighted sum of places, of motions that the coordinates do
        not have."""
        return 0.0

    def cautions(self, laws: Collection[Law]) -> list[str]:
        """Warnings on the structure between stops with these laws, in words."""
        return []

    def assumptions(self) -> list[str]:
        """What is taken for granted of the structure, in words."""
        return []


EVERYWHERE = "everywhere"
"""The place of noise that acts on all of a structure, independently from place to place."""
