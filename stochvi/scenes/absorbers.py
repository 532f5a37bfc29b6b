"""Loose masses in boxes: the short form of a structure that carries an impact absorber."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Self

import numpy as np
from pydantic import Field, WithJsonSchema, field_validator, model_validator

from stochvi.results.errors import SceneError
from stochvi.scenes.excitations import BASE
from stochvi.scenes.impact_laws import Law
from stochvi.scenes.structures import Isolator, Matrices, Oscillator, Structure
from stochvi.scenes.validation import Checked, NonNegative, Number, Positive, given

CARRIER = "structure"
"""Name of the coordinate of the structure that carries the boxes, in the short form."""

MOST_UNITS = 64
"""Largest number of units of one absorber; each unit is a coordinate of its own."""

ONE_OR_MORE_NAMES = {
    "anyOf": [{"type": "string"}, {"type": "array", "items": {"type": "string"}}]
}  # fmt: skip
"""JSON Schema of a list of names; a single name may be given without brackets."""


class Absorber(Checked):
    """Masses that a structure carries in boxes, to take energy from it by their impacts.

    A scene with a structure of kind `matrices` has the coordinates and impact pairs already, and
    the absorber names the coordinates in `mass_on`. In a scene with an oscillator or isolator the
    absorber gives mass, play and law, and coordinates and pairs are built from these. Units that
    differ are given as several absorbers: `absorber=[...]` in Python, `[[absorber]]` in a file.

    Parameters
    ----------
    mass_on
        Names of the coordinates that are absorber masses, or the name of one.
    mass
        Mass of all units together, kg; each has an equal share.
    play
        Total travel of a unit in its box, m; the box is centred about its rest position.
    lower, upper
        Instead of the play: the stops of the relative displacement, m. A mass on a spring may have
        only one.
    law
        Impact law of the stops.
    units
        Number of equal units, each in a box of its own.
    stiffness, damping
        Stiffness (N/m) and damping (N s/m) between the structure and all units together; 0 for
        loose masses.

    See Also
    --------
    stochvi.absorber : Its effect on the structure that carries it.
    stochvi.absorbers.design_absorber : The best box for a mass.

    Examples
    --------
    >>> from stochvi.scenes.impact_laws import Restitution
    >>> loose = Absorber(mass=0.1, play=2.0, law=Restitution(coefficient=0.5), units=2)
    >>> loose.names
    ('absorber 1', 'absorber 2')
    """

    mass_on: Annotated[tuple[str, ...], WithJsonSchema(ONE_OR_MORE_NAMES)] = ()
    mass: Positive | None = None
    play: Positive | None = None
    lower: Number | None = None
    upper: Number | None = None
    law: Law | None = None
    units: Annotated[int, Field(strict=True, ge=1, le=MOST_UNITS)] = 1
    stiffness: NonNegative = 0.0
    damping: NonNegative = 0.0

    @field_validator("mass_on", mode="before")
    @classmethod
    def _names(cls, names: Any) -> Any:
        if isinstance(names, str):
            return (names,)
        return tuple(names) if isinstance(names, list) else names

    @model_validator(mode="after")
    def _one_form(self) -> Self:
        described = given(self, "mass", "play", "lower", "upper", "law")
        if self.mass_on:
            if described != "none":
                raise ValueError(
                    f"takes either mass_on, or mass, play and law, got mass_on and {described}"
                )
            if len(set(self.mass_on)) < len(self.mass_on):
                raise ValueError(
                    f"needs different coordinates in mass_on, got {list(self.mass_on)}"
                )
            return self
        if self.mass is None or self.law is None:
            raise ValueError(f"needs mass (kg), play (m) and law, got {described}")
        if (self.play is None) == (self.lower is None and self.upper is None):
            raise ValueError(f"needs play, or lower and upper, got {described}")
        if self.stiffness == 0.0 and self.play is None and None in (self.lower, self.upper):
            raise ValueError(
                "needs both stops where no spring holds the mass, got one; give play, or lower and "
                "upper, or a stiffness"
            )
        return self

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the coordinates of the units."""
        if self.mass_on:
            return self.mass_on
        return unit_names(self.units)

    @property
    def unit(self) -> Absorber:
        """One of the equal units, as an absorber of its own."""
        assert self.mass is not None
        return self.model_copy(
            update={
                "mass": self.mass / self.units,
                "stiffness": self.stiffness / self.units,
                "damping": self.damping / self.units,
                "units": 1,
            }
        )

    def impact_pair(self, name: str) -> dict[str, Any]:
        """Keys of the impact pair of a unit; y is its position in the box."""
        half = None if self.play is None else self.play / 2.0
        stops = {
            "lower": self.lower if half is None else -half,
            "upper": self.upper if half is None else half,
        }
        return {
            "name": name.replace("absorber", "box"),
            "between": (name, CARRIER),
            "law": self.law,
            **{side: stop for side, stop in stops.items() if stop is not None},
        }


def unit_names(units: int) -> tuple[str, ...]:
    """Names of the coordinates of the units on a structure.

    >>> unit_names(2)
    ('absorber 1', 'absorber 2')
    """
    if units == 1:
        return ("absorber",)
    return tuple(f"absorber {number}" for number in range(1, units + 1))


def carrying(carrier: Oscillator, units: Sequence[Absorber]) -> Matrices:
    """An oscillator with units of absorbers on it: mass, damping and stiffness matrices.

    Raises
    ------
    SceneError
        If the mass of the oscillator is not given.
    """
    if carrier.mass is None:
        raise SceneError("structure.mass", "is needed where the scene has an absorber, got none")
    mass, damping, stiffness = (float(matrix[0, 0]) for matrix in carrier.matrices)
    return Matrices(
        coordinates=(CARRIER, *unit_names(len(units))),
        mass=np.diag([mass, *(unit.mass for unit in units if unit.mass is not None)]),
        damping=_linked(damping, [unit.damping for unit in units]),
        stiffness=_linked(stiffness, [unit.stiffness for unit in units]),
    )


def _linked(own: float, links: Sequence[float]) -> np.ndarray:
    """The matrix of a first coordinate held by `own`, to which others are linked."""
    matrix = np.diag([own + sum(links), *links])
    matrix[0, 1:] = matrix[1:, 0] = np.negative(links)
    return matrix


def on_oscillator(
    absorbers: Sequence[Absorber],
    carrier: Structure,
    pairs: Sequence[Any],
    excitations: Sequence[Any],
) -> dict[str, Any]:
    """Keys of a scene of kind `matrices`: an oscillator and the units of its absorbers.

    Parameters
    ----------
    absorbers
        Absorbers given by mass, play and law; each of their units becomes a coordinate with an
        impact pair.
    carrier
        The oscillator or isolator that carries them.
    pairs, excitations
        Impact pairs and excitations of the carrier.

    Raises
    ------
    SceneError
        If the carrier is something else, or there are too many units.
    """
    if not isinstance(carrier, Oscillator):
        raise SceneError(
            "absorber",
            "given by mass, play and law needs structure.kind 'oscillator' or "
            f"'isolator', got {carrier.kind!r}; for matrices give mass_on, the names of the "
            "coordinates that are its masses",
        )
    if carrier.spring or carrier.damper:
        raise SceneError(
            "absorber",
            "given by mass, play and law needs a linear structure, got structure."
            f"{'spring' if carrier.spring else 'damper'}; write the structure as matrices, with "
            "the absorber as a coordinate",
        )
    units = [each.unit for each in absorbers for _ in range(each.units)]
    if len(units) > MOST_UNITS:
        raise SceneError("absorber", f"takes at most {MOST_UNITS} units, got {len(units)}")
    names = unit_names(len(units))
    moving = isinstance(carrier, Isolator)
    return {
        "structure": carrying(carrier, units),
        "impact_pair": [
            *(_on_carrier(pair) for pair in pairs),
            *(unit.impact_pair(name) for unit, name in zip(units, names, strict=True)),
        ],
        "excitation": [_placed(excitation, moving) for excitation in excitations],
        "absorber": Absorber(mass_on=names),
    }


def absorbers_of(given: Any) -> list[Absorber]:
    """One absorber or a list of them, from their keys.

    Raises
    ------
    SceneError
        If `given` is neither, the list is empty, or one of several absorbers names coordinates.
    """
    if not isinstance(given, list | tuple):
        return [_at("absorber", given)]
    entries = [_at(f"absorber.{number}", each) for number, each in enumerate(given)]
    for number, each in enumerate(entries):
        if each.mass_on:
            raise SceneError(
                f"absorber.{number}",
                "in a list needs mass, play and law; for matrices, name "
                "all coordinates in the mass_on of one [absorber]",
            )
    if not entries:
        raise SceneError("absorber", "needs at least one entry, got none")
    return entries


def _at(key: str, given: Any) -> Absorber:
    """An absorber, or that of its keys; an error names the keys as parts of `key`."""
    try:
        if isinstance(given, Mapping):
            return Absorber(**given)
        Absorber.refuse_subclass(given)
    except SceneError as error:
        problems = [(f"{key}.{inner}".rstrip("."), text) for inner, text in error.problems]
        raise SceneError(problems) from None
    except ValueError as error:
        raise SceneError(key, str(error)) from None
    if not isinstance(given, Absorber):
        raise SceneError(key, f"must be a table of keys, got {given!r}")
    return given


def _on_carrier(pair: Any) -> Any:
    """An impact pair of the oscillator itself."""
    return pair.model_copy(update={"on": CARRIER}) if pair.on in (None, "x") else pair


def _placed(excitation: Any, moving_base: bool) -> Any:
    """An excitation that says where it acts, as it does on the oscillator alone."""
    place = excitation.on
    if place is None and excitation.kind == "constant":
        place = "x" if excitation.acceleration is None else BASE
    if place is None:
        place = BASE if moving_base else "x"
    return excitation.model_copy(update={"on": CARRIER if place == "x" else place})
