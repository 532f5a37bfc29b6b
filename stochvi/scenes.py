"""A scene: a structure, where it can hit, and what shakes it."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, NamedTuple, Self

from pydantic import Field, ValidationInfo, field_validator, model_validator

from stochvi.checked import Checked, Number
from stochvi.contacts import Law
from stochvi.datasets import read_text
from stochvi.errors import SceneError
from stochvi.excitations import ConstantLoad, Excitation, TabulatedNoise, WhiteNoise, check_unit
from stochvi.spectra import Table
from stochvi.structures import Isolator, Structure


class ImpactPair(Checked):
    """Where the mass can hit: a lower stop, an upper stop, or both.

    Parameters
    ----------
    lower, upper
        Position of the stops, m from the position of the unloaded spring; leave out for none.
        A stop beyond it (an upper stop below 0) is a preload.
    law, lower_law, upper_law
        The impact law of both stops, or of one where they differ.

    Examples
    --------
    >>> from stochvi.contacts import Restitution
    >>> pair = ImpactPair(lower=-1.0, upper=2.0, law=Restitution(coefficient=0.8))
    >>> pair.law_of("upper").coefficient
    0.8
    """

    name: str = "stops"
    on: str = "x"
    lower: Number | None = None
    upper: Number | None = None
    law: Law | None = None
    lower_law: Law | None = None
    upper_law: Law | None = None

    @model_validator(mode="after")
    def _stops(self) -> Self:
        if self.on != "x":
            raise ValueError(f"must be on 'x', the only coordinate of this scene, got {self.on!r}")
        if self.lower is None and self.upper is None:
            raise ValueError("needs at least one of lower and upper (m from rest)")
        if self.lower is not None and self.upper is not None and self.lower >= self.upper:
            raise ValueError(f"needs lower < upper, got {self.lower:g} and {self.upper:g}")
        for side in ("lower", "upper"):
            own = getattr(self, f"{side}_law")
            if getattr(self, side) is None:
                if own is not None:
                    raise ValueError(f"has {side}_law but no {side} stop")
            elif own is None and self.law is None:
                raise ValueError(
                    'needs law, for example law = { kind = "restitution", coefficient = 0.8 }'
                )
        return self

    def law_of(self, side: str) -> Law:
        """The law that holds at the "lower" or "upper" stop."""
        law = getattr(self, f"{side}_law") or self.law
        assert law is not None
        return law


class System(NamedTuple):
    """A scene as numbers, per unit mass: x'' + b x' + omega^2 x = f(t) + load, stops in metres.

    `intensity` is S0 of the white part of f; `tables` are one-sided acceleration densities.
    What the scene does not have is None or empty.
    """

    mass: float
    omega: float
    damping_rate: float
    moving_base: bool
    noise_on_mass: bool
    intensity: float
    tables: tuple[Table, ...]
    load: float
    lower: float | None
    upper: float | None
    restitution_lower: float | None
    restitution_upper: float | None

    @property
    def elastic(self) -> bool:
        """Whether no stop loses energy."""
        return all(r in (None, 1.0) for r in (self.restitution_lower, self.restitution_upper))


class Scene(Checked):
    """Everything a method needs to know, checked once.

    Examples
    --------
    >>> from stochvi.contacts import Restitution
    >>> from stochvi.structures import Oscillator
    >>> scene = Scene(
    ...     structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
    ...     impact_pairs=[ImpactPair(lower=-1.0, upper=1.0, law=Restitution(coefficient=0.8))],
    ...     excitations=[WhiteNoise(intensity=0.2)],
    ... )
    >>> scene.effects()
    ('white noise on x', 'rigid stop lower', 'rigid stop upper')
    """

    title: str = ""
    structure: Annotated[Structure, Field(discriminator="kind")]
    impact_pairs: tuple[ImpactPair, ...] = Field(default=(), alias="impact_pair")
    excitations: tuple[Annotated[Excitation, Field(discriminator="kind")], ...] = Field(
        alias="excitation"
    )

    @field_validator("impact_pairs", "excitations", mode="before")
    @classmethod
    def _several(cls, value: Any, info: ValidationInfo) -> Any:
        key = str(cls.model_fields[str(info.field_name)].alias)
        if isinstance(value, Checked):
            raise ValueError(f"must be a list, got one {type(value).__name__}; write [...]")
        if isinstance(value, dict):
            keys = ", ".join(f"{name} = {entry!r}" for name, entry in value.items())
            raise ValueError(f"must be a list, got one table ({keys}); write [[{key}]]")
        return value

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        problems: list[tuple[str, str]] = []
        if not self.excitations:
            problems.append(("excitation", "needs at least one entry, got none"))
        if len(self.impact_pairs) > 1:
            problems.append(
                (
                    "impact_pair",
                    f"takes one entry on a single coordinate, got {len(self.impact_pairs)}",
                )
            )
        for index, excitation in enumerate(self.excitations):
            sentence = self._misfit(excitation)
            if sentence:
                problems.append((f"excitation.{index}", sentence))
        if problems := problems or self._out_of_range():
            raise SceneError(problems)
        return self

    def _out_of_range(self) -> list[tuple[str, str]]:
        """Numbers whose products and squares would not fit a floating-point number."""
        mass = self.structure.mass
        if mass is not None and not _fits(mass):
            return [("structure", _range_sentence("the mass (kg)", mass))]
        system = self.system()
        numbers = [
            ("structure", "the natural frequency (rad/s)", system.omega),
            ("structure", "the damping per unit mass (1/s)", system.damping_rate),
            ("excitation", "the intensity per unit mass squared", system.intensity),
            ("excitation", "the load per unit mass (m/s^2)", system.load),
            ("impact_pair", "the lower stop (m)", system.lower),
            ("impact_pair", "the upper stop (m)", system.upper),
        ]
        for table in system.tables:
            for column in (table.frequency_hz, table.density):
                extremes = float(column.min()), float(column.max())
                numbers += [("excitation", "the table per unit mass", size) for size in extremes]
        return [
            (key, _range_sentence(name, value))
            for key, name, value in numbers
            if value is not None and not _fits(value)
        ]

    def _misfit(self, excitation: Excitation) -> str:
        where = self.place(excitation)
        if where == "base" and not isinstance(self.structure, Isolator):
            return "acts on the base, which needs structure.kind = 'isolator', got 'oscillator'"
        if where == "x" and self.structure.mass is None:
            return "is a force, which needs structure.mass, got none"
        if not isinstance(excitation, ConstantLoad):
            unit = "g2/Hz" if getattr(excitation, "profile", None) else excitation.unit
            try:
                if unit is not None:
                    check_unit(unit, where)
            except ValueError as error:
                return str(error)
        return ""

    def place(self, excitation: Excitation) -> str:
        """Where an excitation acts, "x" or "base", by its own word or by the structure's kind."""
        return excitation.on or ("base" if isinstance(self.structure, Isolator) else "x")

    def effects(self) -> tuple[str, ...]:
        """The effects this scene calls for; nothing else is simulated."""
        found = [
            {
                "white": "white noise on {}",
                "psd": "tabulated noise on {}",
                "constant": "constant load on {}",
            }[excitation.kind].format(self.place(excitation))
            for excitation in self.excitations
        ]
        for pair in self.impact_pairs:
            found += [
                f"rigid stop {side}"
                for side in ("lower", "upper")
                if getattr(pair, side) is not None
            ]
        return tuple(found)

    def assumptions(self) -> tuple[str, ...]:
        """What the scene takes for granted, in words."""
        found = ["displacements are measured from the position of the unloaded spring"]
        if self.structure.mass is None:
            found.append("mass is not given: 1 kg, which only forces would depend on")
        if self.impact_pairs:
            found.append("stops are rigid; an impact is instantaneous (Newton's restitution)")
        return tuple(found)

    def system(self) -> System:
        """The scene per unit mass, as numbers that a method computes with."""
        mass = self.structure.mass or 1.0
        intensity, load, tables, noise_on_mass = 0.0, 0.0, [], False
        for excitation in self.excitations:
            on_mass = self.place(excitation) == "x"
            noise_on_mass |= on_mass and not isinstance(excitation, ConstantLoad)
            match excitation:
                case WhiteNoise():
                    intensity += excitation.si_intensity / (mass**2 if on_mass else 1.0)
                case TabulatedNoise():
                    tables.append(excitation.table.scaled(mass**-2 if on_mass else 1.0))
                case ConstantLoad():
                    load += excitation.magnitude / mass if on_mass else -excitation.magnitude
        pair = self.impact_pairs[0] if self.impact_pairs else None
        lower, upper = (pair.lower, pair.upper) if pair else (None, None)
        return System(
            mass=mass,
            omega=self.structure.omega,
            damping_rate=self.structure.damping_rate,
            moving_base=isinstance(self.structure, Isolator),
            noise_on_mass=noise_on_mass,
            intensity=intensity,
            tables=tuple(tables),
            load=load,
            lower=lower,
            upper=upper,
            restitution_lower=pair.law_of("lower").coefficient
            if pair and lower is not None
            else None,
            restitution_upper=pair.law_of("upper").coefficient
            if pair and upper is not None
            else None,
        )

    def document(self) -> dict[str, Any]:
        """The scene as plain types, in the keys of a scene file."""
        return self.model_dump(mode="json", by_alias=True, exclude_none=True)


LARGEST_NUMBER = 1e50
"""Of anything in a scene, per unit mass, and the inverse of the smallest: squares stay finite."""


def _fits(value: float) -> bool:
    return value == 0.0 or 1.0 / LARGEST_NUMBER <= abs(value) <= LARGEST_NUMBER


def _range_sentence(name: str, value: float) -> str:
    return (
        f"gives {name} the value {value:g}, expected 0 or a size from "
        f"{1.0 / LARGEST_NUMBER:g} to {LARGEST_NUMBER:g}"
    )


def load_scene(path: str | Path) -> Scene:
    """Read a scene file (TOML); tables that it names are looked for beside it.

    Raises
    ------
    SceneError
        In one sentence per problem: the key, what was got, what was expected.
    """
    path = Path(path)
    text = read_text(path)
    try:
        document = tomllib.loads(text)
    except ValueError as error:  # also an integer of thousands of digits
        raise SceneError(f"{path} is not valid TOML: {error}") from None
    except RecursionError:
        raise SceneError(f"{path} is not a scene: its brackets are nested too deeply") from None
    return scene_from(document, folder=path.parent)


def scene_from(document: Mapping[str, Any], folder: Path = Path()) -> Scene:
    """A scene from the keys of a scene file; relative file names start at `folder`."""
    for name, field in Scene.model_fields.items():
        if field.alias is not None and name in document:
            raise SceneError([(name, f"is not a known key; did you mean {field.alias!r}?")])
    entries = document.get("excitation")
    if isinstance(entries, list):
        entries = [
            entry | {"file": str(folder / entry["file"])}
            if isinstance(entry, dict) and isinstance(entry.get("file"), str)
            else entry
            for entry in entries
        ]
        document = {**document, "excitation": entries}
    return Scene(**document)
