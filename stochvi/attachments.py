"""Loose masses in boxes: the short form of a structure that carries an impact absorber."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Self

import numpy as np
from pydantic import Field, field_validator, model_validator

from stochvi.checked import Checked, NonNegative, Number, Positive, given
from stochvi.contacts import Law
from stochvi.errors import SceneError
from stochvi.excitations import BASE
from stochvi.structures import Isolator, Matrices, Oscillator

CARRIER = "structure"
"""Name of the coordinate that carries the boxes, in the short form."""

MOST_UNITS = 64
"""Of one absorber; each is a coordinate of its own."""


class Absorber(Checked):
    """Masses that a structure carries in boxes, to take energy from it by their impacts.

    Either the names of their coordinates, beside a structure of kind `matrices` and its impact
    pairs, or, beside an oscillator or isolator, what is needed to build both.

    Parameters
    ----------
    mass_on
        Names of the coordinates that are absorber masses.
    mass
        Of all units together, kg; each has an equal share.
    play
        Total travel of a unit in its box, m, the box about its rest position. Instead `lower` and
        `upper`, the stops of the relative displacement, of which one may be left out.
    law
        Impact law of the walls.
    units
        Number of equal units, each in a box of its own.
    stiffness, damping
        Of the springs and dampers between the units and the structure, all units together, N/m
        and N s/m; 0 for loose masses.

    Examples
    --------
    >>> from stochvi.contacts import Restitution
    >>> loose = Absorber(mass=0.1, play=2.0, law=Restitution(coefficient=0.5), units=2)
    >>> loose.names
    ('absorber 1', 'absorber 2')
    """

    mass_on: tuple[str, ...] = ()
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
                    f"takes mass_on, beside matrices, or mass, play and law, got both ({described})"
                )
            return self
        if self.mass is None or self.law is None:
            raise ValueError(f"needs mass (kg), play (m) and law, got {described}")
        if (self.play is None) == (self.lower is None and self.upper is None):
            raise ValueError(f"needs play, or lower and upper, got {described}")
        if self.stiffness == 0.0 and self.play is None and None in (self.lower, self.upper):
            raise ValueError("needs both walls where no spring holds the mass, got one")
        return self

    @property
    def names(self) -> tuple[str, ...]:
        """Coordinates of the units."""
        if self.mass_on:
            return self.mass_on
        if self.units == 1:
            return ("absorber",)
        return tuple(f"absorber {number}" for number in range(1, self.units + 1))

    def structure(self, carrier: Oscillator) -> Matrices:
        """The oscillator with its units: mass, damping and stiffness matrices.

        Raises
        ------
        SceneError
            If the oscillator has no mass to compare with.
        """
        assert self.mass is not None
        if carrier.mass is None:
            raise SceneError([("structure.mass", "is needed beside an absorber, got none")])
        share = 1.0 / self.units
        link = np.zeros((self.units + 1, self.units + 1))
        link[0, 0] = 1.0
        link[0, 1:] = link[1:, 0] = -share
        link[1:, 1:] = share * np.eye(self.units)
        own = np.zeros_like(link)
        own[0, 0] = 1.0
        mass, damping, stiffness = (float(matrix[0, 0]) for matrix in carrier.matrices)
        return Matrices(
            coordinates=(CARRIER, *self.names),
            mass=np.diag([mass, *[self.mass * share] * self.units]),
            damping=damping * own + self.damping * link,
            stiffness=stiffness * own + self.stiffness * link,
        )

    def impact_pairs(self) -> list[dict[str, Any]]:
        """Keys of an impact pair for each unit; y is its position in the box."""
        half = None if self.play is None else self.play / 2.0
        stops = {
            "lower": self.lower if half is None else -half,
            "upper": self.upper if half is None else half,
        }
        return [
            {
                "name": name.replace("absorber", "box"),
                "between": (name, CARRIER),
                "law": self.law,
                **{side: stop for side, stop in stops.items() if stop is not None},
            }
            for name in self.names
        ]


def built(document: Mapping[str, Any]) -> Mapping[str, Any]:
    """Keys of a scene with its absorber's short form written out as matrices and impact pairs.

    What is not a short form, or not valid, is left as it is.
    """
    absorber, structure = document.get("absorber"), document.get("structure")
    if isinstance(absorber, Mapping):
        absorber = _at("absorber", Absorber, absorber)
    if isinstance(structure, Mapping) and structure.get("kind") in ("oscillator", "isolator"):
        kind = Isolator if structure["kind"] == "isolator" else Oscillator
        structure = _at("structure", kind, structure)
    if not isinstance(absorber, Absorber) or absorber.mass_on:
        return document
    if not isinstance(structure, Oscillator):
        raise SceneError(
            [("absorber", "of mass, play and law needs structure.kind 'oscillator' or 'isolator'; "
              "beside matrices, name its coordinates in mass_on")]
        )  # fmt: skip
    pairs = document.get("impact_pair", document.get("impact_pairs")) or ()
    excitations = document.get("excitation", document.get("excitations")) or ()
    if not isinstance(pairs, list | tuple) or not isinstance(excitations, list | tuple):
        return document
    rest = {
        key: value
        for key, value in document.items()
        if key not in ("impact_pair", "impact_pairs", "excitation", "excitations")
    }
    moving = isinstance(structure, Isolator)
    return {
        **rest,
        "structure": absorber.structure(structure),
        "impact_pair": [*(_on_carrier(pair) for pair in pairs), *absorber.impact_pairs()],
        "excitation": [_placed(excitation, moving) for excitation in excitations],
        "absorber": Absorber(mass_on=absorber.names),
    }


def _at(key: str, kind: type[Checked], entries: Mapping[str, Any]) -> Checked:
    """A part of a scene from its keys; what is wrong with them is said of `key`."""
    try:
        return kind(**entries)
    except SceneError as error:
        problems = [(f"{key}.{inner}".rstrip("."), text) for inner, text in error.problems]
        raise SceneError(problems) from None


def _entry(part: Any, name: str) -> Any:
    return part.get(name) if isinstance(part, Mapping) else getattr(part, name, None)


def _with(part: Any, **entries: Any) -> Any:
    return {**part, **entries} if isinstance(part, Mapping) else part.model_copy(update=entries)


def _on_carrier(pair: Any) -> Any:
    """An impact pair of the oscillator itself."""
    return _with(pair, on=CARRIER) if _entry(pair, "on") in (None, "x") else pair


def _placed(excitation: Any, moving_base: bool) -> Any:
    """An excitation that says where it acts, as it does on the oscillator alone."""
    place = _entry(excitation, "on")
    if place is None and _entry(excitation, "kind") == "constant":
        place = "x" if _entry(excitation, "acceleration") is None else BASE
    if place is None:
        place = BASE if moving_base else "x"
    return _with(excitation, on=CARRIER if place == "x" else place)
