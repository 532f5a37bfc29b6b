"""A scene of any structure as matrices: M q'' + C q' + K q = forces, and where it can hit."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stochvi.mathematics.spectra import Table
from stochvi.model.modal import ModalForm, modal_form
from stochvi.model.model import LOWER, UPPER, Pair, Signal, Stop
from stochvi.scenes.excitations import (
    BASE,
    ConstantLoad,
    DensityNoise,
    Excitation,
    FilteredNoise,
    Sine,
    WhiteNoise,
)
from stochvi.scenes.impact_laws import Law, not_rigid
from stochvi.scenes.scene import ImpactPair, Scene
from stochvi.scenes.structures import NonlinearOscillator, Oscillator

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]


class Contact(NamedTuple):
    """An impact pair: y = direction . q is what hits the stops.

    `mass` is the reduced mass 1 / (direction . M^-1 direction), kg.
    """

    name: str
    direction: Vector
    mass: float
    lower: float | None
    upper: float | None
    law_lower: Law | None
    law_upper: Law | None

    @property
    def stops(self) -> tuple[tuple[str, float, Law], ...]:
        """(side, position, law) of each stop that exists."""
        found = []
        if self.lower is not None and self.law_lower is not None:
            found.append(("lower", self.lower, self.law_lower))
        if self.upper is not None and self.law_upper is not None:
            found.append(("upper", self.upper, self.law_upper))
        return tuple(found)


class Assembly(NamedTuple):
    """A scene as numbers, in SI units: n coordinates, its excitations as forces on them.

    `white` (n, n) is the intensity matrix of white forces, `load` (n,) the constant ones;
    `tables` pairs one-sided densities with the forces per unit of what they describe.
    """

    coordinates: tuple[str, ...]
    mass: Matrix
    damping: Matrix
    stiffness: Matrix
    white: Matrix
    load: Vector
    signals: tuple[Signal, ...]
    tables: tuple[tuple[Table, Vector], ...]
    contacts: tuple[Contact, ...]

    @property
    def pairs(self) -> tuple[Pair, ...]:
        return tuple(
            Pair(
                name=contact.name,
                direction=contact.direction,
                mass=contact.mass,
                relative=int((contact.direction != 0.0).sum()) > 1,
                stops=tuple(
                    Stop(UPPER if side == "upper" else LOWER, position, law)
                    for side, position, law in contact.stops
                ),
            )
            for contact in self.contacts
        )

    @property
    def constant_force(self) -> Vector:
        return self.load

    @property
    def elastic(self) -> bool:
        """Whether no stop loses energy."""
        return all(law.conservative for contact in self.contacts for _, _, law in contact.stops)

    def not_rigid(self) -> list[str]:
        """What stands in the way of a method that needs rigid stops."""
        return not_rigid((side, law) for contact in self.contacts for side, _, law in contact.stops)

    @property
    def temperature(self) -> float | None:
        """theta with white = 2 theta damping, an energy (J), where white noise alone shakes and
        matches the damping: then elastic stops leave the Gibbs law exp(-H / theta)."""
        if self.signals or self.tables or not np.any(self.damping):
            return None
        theta = float(np.trace(self.white) / np.trace(self.damping) / 2.0)
        wanted = 2.0 * theta * self.damping
        # every coordinate by its own measure: a light one has little noise and little damping
        size = np.sqrt(np.maximum(np.diag(self.white), np.diag(wanted)))
        matched = np.all(np.abs(self.white - wanted) <= MATCHED * np.outer(size, size))
        return theta if matched and theta > 0.0 else None


MATCHED = 1e-12
"""Relative difference from which noise and damping are not said to match."""


def assemble(scene: Scene) -> Assembly:
    """The matrices of any scene that says everything in numbers (`Scene.beyond_numbers`).

    Examples
    --------
    >>> from stochvi.scenes.structures import Oscillator
    >>> from stochvi.scenes.excitations import WhiteNoise
    >>> shaken = Scene(
    ...     structure=Oscillator(mass=2.0, damping=0.1, stiffness=1.0),
    ...     excitations=[WhiteNoise(intensity=0.2)],
    ... )
    >>> assemble(shaken).white, assemble(shaken).temperature
    (array([[0.2]]), 1.0)
    """
    scene = scene.expanded
    assert not isinstance(scene.structure, NonlinearOscillator)
    mass, damping, stiffness = scene.structure.matrices
    white, load = np.zeros_like(mass), np.zeros(len(mass))
    signals: list[Signal] = []
    tables: list[tuple[Table, Vector]] = []
    if isinstance(scene.structure, Oscillator):
        load += scene.structure.gravity_load * mass[0]
    for excitation in scene.excitations:
        direction = _direction(scene, excitation, mass)
        match excitation:
            case WhiteNoise():
                white += excitation.si_intensity * np.outer(direction, direction)
            case ConstantLoad():
                load += excitation.magnitude * direction
            case FilteredNoise():
                decay = 2.0 * excitation.zeta * excitation.omega
                noise = excitation.si_intensity
                signals.append(Signal(excitation.omega, decay, noise, 0.0, direction))
            case Sine():
                omega = 2.0 * math.pi * excitation.frequency_hz
                signals.append(Signal(omega, 0.0, 0.0, excitation.amplitude, direction))
            case DensityNoise():
                tables.append((scene.table_of(excitation), direction))
    return Assembly(
        coordinates=scene.structure.coordinates,
        mass=mass,
        damping=damping,
        stiffness=stiffness,
        white=white,
        load=load,
        signals=tuple(signals),
        tables=tuple(tables),
        contacts=tuple(_contact(scene, pair, mass) for pair in scene.impact_pairs),
    )


def _direction(scene: Scene, excitation: Excitation, mass: Matrix) -> Vector:
    """Forces on the coordinates, per newton or per m/s^2 of the base."""
    place = scene.place(excitation)
    if place == BASE:
        inertia: Vector = -mass.sum(axis=1)
        return inertia
    return _unit(scene, place)


def _unit(scene: Scene, coordinate: str) -> Vector:
    return np.array([float(name == coordinate) for name in scene.structure.coordinates])


def _contact(scene: Scene, pair: ImpactPair, mass: Matrix) -> Contact:
    if pair.between is not None:
        direction = _unit(scene, pair.between[0]) - _unit(scene, pair.between[1])
    else:
        direction = _unit(scene, pair.on or scene.structure.coordinates[0])
    return Contact(
        name=pair.name,
        direction=direction,
        mass=float(1.0 / (direction @ np.linalg.solve(mass, direction))),
        lower=pair.lower,
        upper=pair.upper,
        law_lower=None if pair.lower is None else pair.law_of("lower"),
        law_upper=None if pair.upper is None else pair.law_of("upper"),
    )


def modes_of(assembly: Assembly) -> ModalForm:
    """Modal coordinates of an assembly."""
    return modal_form(assembly)  # type: ignore[arg-type]
