"""Bars and beams: uniform straight members with exact natural modes."""

from __future__ import annotations

import math
from abc import abstractmethod
from functools import cached_property, lru_cache
from typing import Annotated, Literal, NamedTuple

import numpy as np
from pydantic import Field

from stochvi.mathematics.member_modes import Member, MemberModes, member_modes, static_compliance
from stochvi.results.errors import SceneError
from stochvi.scenes.modal_structures import ModalStructure, Modes, Points
from stochvi.scenes.validation import Count, NonNegative, Number, Positive, given

MOST_MODES = 200
"""Largest number of modes of a member or plate: a simulation of more would take hours."""


class Scales(NamedTuple):
    """Length (m), mass (kg) and squared angular frequency (rad^2/s^2) of a member by which its
    numbers without units become SI units."""

    length: float
    mass: float
    square: float


class UniformMember(ModalStructure):
    """Base of bars and beams.

    Parameters
    ----------
    length
        Length, m.
    area
        Area of the section, m^2.
    width, height
        Instead: sides of a rectangular section, m; a beam bends in the direction of its height.
    young, density
        Young's modulus, Pa, and mass per volume, kg/m^3.
    modes
        Number of modes, the lowest ones.
    max_frequency_hz
        Instead: all modes up to this frequency, Hz.
    points
        Named points by their share of the length, as `points = { tip = 1.0, middle = 0.5 }`.
    tip_mass, tip_stiffness
        Point mass, kg, and spring to the base, N/m, at the end `tip = 1.0`.
    """

    length: Positive
    area: Positive | None = None
    width: Positive | None = None
    height: Positive | None = None
    young: Positive
    density: Positive
    number_of_modes: Count | None = Field(default=None, alias="modes")
    max_frequency_hz: Positive | None = None
    points: Points
    tip_mass: NonNegative = 0.0
    tip_stiffness: NonNegative = 0.0

    @property
    @abstractmethod
    def _member(self) -> Member:
        """The member in its own units."""

    @property
    @abstractmethod
    def _scales(self) -> Scales:
        """What its own units are in SI units."""

    @property
    @abstractmethod
    def _tip_is_held(self) -> bool:
        """Whether the support holds the displacement of the tip."""

    def check_keys(self) -> None:
        section = given(self, "area", "width", "height")
        if section not in ("area", "width, height"):
            raise ValueError(f"needs width and height, or area, got {section}")
        named = given(self, "number_of_modes", "max_frequency_hz").replace("number_of_", "")
        if named == "none" or "," in named:
            raise ValueError(f"needs exactly one of modes and max_frequency_hz, got {named}")
        if (self.number_of_modes or 0) > MOST_MODES:
            raise SceneError(
                [("modes", f"must be at most {MOST_MODES}, got {self.number_of_modes}")]
            )
        for name in ("tip_mass", "tip_stiffness"):
            if getattr(self, name) and self._tip_is_held:
                raise SceneError(
                    [(name, "must be 0 where the support holds the tip, got "
                      f"{getattr(self, name):g}; choose another support")]
                )  # fmt: skip
        if not len(self._found.squares):
            lowest = float(_found(self._member, 1, None).squares[0])
            hertz = math.sqrt(lowest * self._scales.square) / (2.0 * math.pi)
            raise SceneError(
                [("max_frequency_hz", f"must be at least that of the first mode, {hertz:.4g} Hz, "
                  f"got {self.max_frequency_hz:g}")]
            )  # fmt: skip

    @property
    def _area(self) -> float:
        if self.area is not None:
            return self.area
        assert self.width is not None and self.height is not None
        return self.width * self.height

    @property
    def _found(self) -> MemberModes:
        highest = None
        if self.max_frequency_hz is not None:
            highest = (2.0 * math.pi * self.max_frequency_hz) ** 2 / self._scales.square
        return _found(self._member, self.number_of_modes, highest)

    @cached_property
    def modes(self) -> Modes:
        found, scales = self._found, self._scales
        places = np.array(list(self.points.values()))
        shapes = found.shapes(places)
        whole = static_compliance(self._member, places)
        left_out = None
        if whole is not None:
            kept = (shapes / (found.mass * found.squares)) @ shapes.T
            left_out = (whole - kept) / (scales.mass * scales.square)
        overlap = found.overlap * scales.length
        return Modes(
            omega=np.sqrt(found.squares * scales.square),
            mass=found.mass * scales.mass,
            shapes=dict(zip(self.points, shapes, strict=True)),
            participation=None if self.without_base else found.participation,
            spread=np.asarray(np.linalg.cholesky(overlap).T, dtype=float),
            left_out=left_out,
        )

    @property
    def _free(self) -> bool:
        return not any(self._member.held) and not any(self._member.springs)

    @property
    def without_base(self) -> str:
        return "acts on the base, on which a free structure does not stand" if self._free else ""


@lru_cache(maxsize=64)
def _found(member: Member, count: int | None, highest: float | None) -> MemberModes:
    found = member_modes(member, count, highest)
    if len(found.squares) > MOST_MODES:
        raise SceneError(
            [
                (
                    "max_frequency_hz",
                    f"takes {len(found.squares)} modes, expected at most {MOST_MODES}",
                )
            ]
        )
    return found


class Bar(UniformMember):
    """A uniform bar that moves along its length, rho A u'' = E A d2u/dx2.

    Parameters
    ----------
    support
        Which ends are held: "fixed-free" (x = 0 held), "fixed" (both) or "free" (none).

    Raises
    ------
    SceneError
        If keys contradict each other.

    See Also
    --------
    stochvi.scenes.Beam : A member that bends.

    Examples
    --------
    >>> steel = Bar(length=2.0, area=1e-4, young=2.0e11, density=8000.0, support="fixed-free",
    ...             zeta=0.01, modes=3, points={"tip": 1.0})
    >>> steel.natural_frequency_hz.round(6).tolist()
    [625.0, 1875.0, 3125.0]
    """

    kind: Literal["bar"] = "bar"
    support: Literal["fixed-free", "fixed", "free"]

    @property
    def _tip_is_held(self) -> bool:
        return self.support == "fixed"

    @property
    def _scales(self) -> Scales:
        square = self.young / (self.density * self.length**2)
        return Scales(self.length, self.density * self._area * self.length, square)

    @property
    def _member(self) -> Member:
        mass = self.density * self._area * self.length
        stiffness = self.young * self._area / self.length
        held = {"fixed-free": (True, False), "fixed": (True, True), "free": (False, False)}
        return Member(
            held[self.support], (self.tip_mass / mass,), (self.tip_stiffness / stiffness,)
        )


class Beam(UniformMember):
    """A uniform beam that bends, of Euler and Bernoulli or of Timoshenko.

    Between its ends E I w'''' + rho A w_tt = 0; the beam of Timoshenko also gives way to shear and
    has the inertia of its turning sections.

    Parameters
    ----------
    second_moment
        Second moment of area, m^4, with `area`.
    support
        "cantilever" (clamped at 0), "pinned", "clamped" (both ends), "clamped-pinned" or "free".
    theory
        "euler-bernoulli", or "timoshenko" for a beam that is short for its height.
    poisson
        Poisson's ratio of the beam of Timoshenko: its shear modulus is E / (2 (1 + poisson)).
    shear_coefficient
        Share of the area that carries shear; 5/6 of a rectangular section.
    tip_inertia, tip_rotational_stiffness
        Moment of inertia, kg m^2, and spring against rotation, N m/rad, at the end `tip = 1.0`.

    Raises
    ------
    SceneError
        If keys contradict each other.

    See Also
    --------
    stochvi.scenes.Bar : A member that moves along its length.
    stochvi.scenes.Plate : A rectangular plate.

    Examples
    --------
    >>> strip = Beam(length=0.5, width=0.02, height=0.003, young=2.1e11, density=7850.0,
    ...              support="cantilever", zeta=0.01, modes=3, points={"tip": 1.0})
    >>> strip.natural_frequency_hz.round(3).tolist()
    [10.026, 62.835, 175.938]
    """

    kind: Literal["beam"] = "beam"
    second_moment: Positive | None = None
    support: Literal["cantilever", "pinned", "clamped", "clamped-pinned", "free"]
    theory: Literal["euler-bernoulli", "timoshenko"] = "euler-bernoulli"
    poisson: Annotated[Number, Field(gt=-1, le=0.5)] | None = None
    shear_coefficient: Positive | None = None
    tip_inertia: NonNegative = 0.0
    tip_rotational_stiffness: NonNegative = 0.0

    def check_keys(self) -> None:
        if (self.second_moment is None) != (self.area is None):
            raise ValueError(
                "needs width and height, or area and second_moment, got "
                f"{given(self, 'width', 'height', 'area', 'second_moment')}"
            )
        shear = given(self, "poisson", "shear_coefficient")
        if self.theory == "euler-bernoulli" and shear != "none":
            raise ValueError(f"takes {shear} with theory = 'timoshenko', got {self.theory!r}")
        if self.theory == "timoshenko" and (
            self.poisson is None or (self.area is not None and self.shear_coefficient is None)
        ):
            raise ValueError(
                "needs poisson, and shear_coefficient unless the section is a rectangle, with "
                f"theory = 'timoshenko', got {shear}"
            )
        for name in ("tip_inertia", "tip_rotational_stiffness"):
            if (size := getattr(self, name)) and self.support == "clamped":
                raise SceneError([(name, f"must be 0 where the tip is clamped, got {size:g}")])
        super().check_keys()

    @property
    def _tip_is_held(self) -> bool:
        return self.support in ("pinned", "clamped", "clamped-pinned")

    @property
    def _second_moment(self) -> float:
        if self.second_moment is not None:
            return self.second_moment
        assert self.width is not None and self.height is not None
        return self.width * self.height**3 / 12.0

    @property
    def _scales(self) -> Scales:
        mass = self.density * self._area * self.length
        square = self.young * self._second_moment / (mass * self.length**3)
        return Scales(self.length, mass, square)

    @property
    def _member(self) -> Member:
        scales = self._scales
        bending = self.young * self._second_moment / self.length
        rotary = self._second_moment / (self._area * self.length**2)
        shear = 0.0
        if self.theory == "timoshenko":
            assert self.poisson is not None
            modulus = self.young / (2.0 * (1.0 + self.poisson))
            share = 5.0 / 6.0 if self.shear_coefficient is None else self.shear_coefficient
            shear = bending / (share * modulus * self._area * self.length)
        return Member(
            HELD[self.support],
            (self.tip_mass / scales.mass, self.tip_inertia / (scales.mass * self.length**2)),
            (
                self.tip_stiffness * self.length**2 / bending,
                self.tip_rotational_stiffness / bending,
            ),
            shear,
            rotary if self.theory == "timoshenko" else 0.0,
        )


HELD = {
    "cantilever": (True, True, False, False),
    "pinned": (True, False, True, False),
    "clamped": (True, True, True, True),
    "clamped-pinned": (True, True, True, False),
    "free": (False, False, False, False),
}
"""Whether displacement and slope are held at both ends, by the support of a beam."""
