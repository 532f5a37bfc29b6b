"""Rectangular plates on simple supports, with exact natural modes."""

from __future__ import annotations

import math
from functools import cached_property
from typing import Annotated, Literal

import numpy as np
from pydantic import AfterValidator, BeforeValidator, Field

from stochvi.mathematics.arrays import Matrix, Vector, Whole
from stochvi.results.errors import SceneError
from stochvi.scenes.members import MOST_MODES
from stochvi.scenes.modal_structures import ModalStructure, Modes, _place_names
from stochvi.scenes.validation import Count, Number, Positive, given

FURTHER = 400
"""Half waves along each side up to which the static compliance of left-out modes is added up."""


def _plain(values: object) -> object:
    return values.tolist() if hasattr(values, "tolist") else values


Share = Annotated[Number, Field(ge=0, le=1)]
PlatePoints = Annotated[
    dict[str, Annotated[tuple[Share, Share], BeforeValidator(_plain)]],
    Field(min_length=1),
    AfterValidator(_place_names),
]
"""Named points of a plate, by their shares of length and width."""


class Plate(ModalStructure):
    """A thin rectangular plate whose four edges are simply supported.

    Its modes are sin(m pi x / a) sin(n pi y / b), with the angular frequencies
    pi^2 (m^2 / a^2 + n^2 / b^2) sqrt(D / (rho h)), D = E h^3 / (12 (1 - nu^2)) (Kirchhoff).

    Parameters
    ----------
    length, width, thickness
        Sides a and b, and thickness h, m.
    young, density, poisson
        Young's modulus, Pa, mass per volume, kg/m^3, and Poisson's ratio.
    modes
        Number of modes, the lowest ones.
    max_frequency_hz
        Instead: all modes up to this frequency, Hz.
    points
        Named points by their shares of length and width, as `points = { middle = [0.5, 0.5] }`.

    Raises
    ------
    SceneError
        If keys contradict each other.

    See Also
    --------
    stochvi.scenes.Beam : A beam.

    Examples
    --------
    >>> sheet = Plate(length=0.4, width=0.3, thickness=0.002, young=7.0e10, density=2700.0,
    ...               poisson=0.33, zeta=0.01, modes=3, points={"middle": [0.5, 0.5]})
    >>> sheet.natural_frequency_hz.round(2).tolist()
    [84.93, 176.65, 247.98]
    """

    kind: Literal["plate"] = "plate"
    length: Positive
    width: Positive
    thickness: Positive
    young: Positive
    density: Positive
    poisson: Annotated[Number, Field(gt=-1, le=0.5)]
    number_of_modes: Count | None = Field(default=None, alias="modes")
    max_frequency_hz: Positive | None = None
    points: PlatePoints

    def check_keys(self) -> None:
        named = given(self, "number_of_modes", "max_frequency_hz").replace("number_of_", "")
        if named == "none" or "," in named:
            raise ValueError(f"needs exactly one of modes and max_frequency_hz, got {named}")
        key = "modes" if self.max_frequency_hz is None else "max_frequency_hz"
        if (self.number_of_modes or 0) > MOST_MODES or len(self._half_waves) > MOST_MODES:
            raise SceneError(
                [(key, f"takes {self.number_of_modes or len(self._half_waves)} modes, expected at "
                  f"most {MOST_MODES}")]
            )  # fmt: skip
        if not len(self._half_waves):
            lowest = float(self._omega(np.array([[1, 1]]))[0]) / (2.0 * math.pi)
            raise SceneError(
                [("max_frequency_hz", f"must be at least that of the first mode, {lowest:.4g} Hz, "
                  f"got {self.max_frequency_hz:g}")]
            )  # fmt: skip

    def _omega(self, half_waves: Whole) -> Vector:
        stiffness = self.young * self.thickness**3 / (12.0 * (1.0 - self.poisson**2))
        numbers = (half_waves * math.pi / np.array([self.length, self.width])) ** 2
        return np.asarray(
            numbers.sum(axis=1) * math.sqrt(stiffness / (self.density * self.thickness))
        )

    @property
    def _half_waves(self) -> Whole:
        """Half waves (n, 2) along length and width of the modes, by rising frequency."""
        if self.max_frequency_hz is None:
            assert self.number_of_modes is not None
            most = min(self.number_of_modes, MOST_MODES)
            both = _grid(most, most)
            return both[np.argsort(self._omega(both), kind="stable")[: self.number_of_modes]]
        top = 2.0 * math.pi * self.max_frequency_hz
        scale = math.sqrt(top / float(self._omega(np.array([[1, 0]]))[0]))
        across = math.sqrt(top / float(self._omega(np.array([[0, 1]]))[0]))
        both = _grid(min(int(scale), 10 * MOST_MODES), min(int(across), 10 * MOST_MODES))
        both = both[np.argsort(self._omega(both), kind="stable")]
        return both[self._omega(both) <= top]

    def _shapes(self, half_waves: Whole) -> Matrix:
        """Displacements (points, n) of the named points."""
        places = np.array(list(self.points.values()))
        waves = np.sin(math.pi * places[:, None, :] * half_waves)
        waves[np.abs(waves) < ROUNDING] = 0.0
        return np.asarray(waves.prod(axis=2))

    @cached_property
    def modes(self) -> Modes:
        half_waves = self._half_waves
        omega, surface = self._omega(half_waves), self.length * self.width
        mass = np.full(len(omega), self.density * self.thickness * surface / 4.0)
        shapes = self._shapes(half_waves)
        further = _grid(FURTHER, FURTHER)
        further = further[np.sort(np.argsort(self._omega(further), kind="stable")[len(omega) :])]
        others = self._shapes(further)
        odd = (half_waves % 2 == 1).all(axis=1)
        factors = np.where(odd, 16.0 / (math.pi**2 * half_waves.prod(axis=1)), 0.0)
        return Modes(
            omega=omega,
            mass=mass,
            shapes=dict(zip(self.points, shapes, strict=True)),
            participation=factors,
            spread=np.diag(np.full(len(omega), math.sqrt(surface / 4.0))),
            left_out=(others / (mass[0] * self._omega(further) ** 2)) @ others.T,
        )


ROUNDING = 1e-14
"""Sine of a multiple of pi that is a rounding error."""


def _grid(along: int, across: int) -> Whole:
    """All pairs of half waves up to these numbers."""
    both = np.meshgrid(np.arange(1, along + 1), np.arange(1, across + 1), indexing="ij")
    return np.stack(both, axis=-1).reshape(-1, 2)
