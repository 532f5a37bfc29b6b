"""The force by which a modulation changes a spring or a damper of a linear structure."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from stochvi.mathematics.arrays import Vector
from stochvi.results.errors import SceneError
from stochvi.scenes.characteristics.base import Characteristic, LinearForm
from stochvi.scenes.excitations.modulation import Modulation
from stochvi.scenes.structures import Isolator, Matrices, Oscillator, RigidBody
from stochvi.scenes.structures.base import AnyStructure
from stochvi.scenes.structures.rigid_body import AXES

WHITE_STEP = 2.0
"""Rate of the steps that resolve white noise of intensity S on a spring of the frequency omega, in
units of omega^2 S: the noise of a step is then small against a radian."""

ROUNDING = 1e-12
"""Size of a spring or damper, relative to all on its coordinate, up to which it is a rounding
error of their sum."""


class ForceOfExcitation(Characteristic):
    """A force that an excitation makes, in the place of a spring or damper of the structure."""

    @property
    def remembers(self) -> bool:  # type: ignore[override]
        """True, as the force does not follow from the motion."""
        return True

    @property
    def needs(self) -> str:
        return "both"


class ModulatedForce(ForceOfExcitation):
    """The force xi(t) (stiffness x + damping v), whose mean is in the linear structure.

    Parameters
    ----------
    stiffness, damping
        What is modulated, N/m and N s/m; one of them is 0.
    mass
        Reduced mass of the displacement, kg.
    modulation
        The relative change xi.
    """

    stiffness: float
    damping: float
    mass: float
    modulation: Modulation

    @property
    def effect(self) -> str:
        return self.modulation.effect_word

    def refusal(self, name: str) -> str:
        return f"structure.{self.modulation.of} must be constant, got a {self.effect}"

    @property
    def strengths(self) -> Sequence[float]:
        return [each for each in (self.stiffness, self.damping) if each]

    def force_at(self, displacement: ArrayLike, velocity: ArrayLike = 0.0) -> Vector:
        """The mean force, 0."""
        return np.zeros(np.broadcast(displacement, velocity).shape)

    def linear_form(self, mean: float, deviation: float, speed: float) -> LinearForm:
        """Nothing: the modulation is no part of the linear structure."""
        return LinearForm(0.0, 0.0, 0.0)

    def stiffest(self, mean: float, deviation: float) -> float:
        if self.modulation.source == "white noise":
            rate = WHITE_STEP * self.stiffness / self.mass * (self.modulation.intensity or 0.0)
            return self.mass * rate**2
        return self.stiffness * self._largest

    def most_damping(self, mean: float, speed: float) -> float:
        return 0.0 if self.modulation.source == "white noise" else self.damping * self._largest

    @property
    def _largest(self) -> float:
        return 3.0 * self.modulation.size

    def compiled(self, mass: float) -> Any:
        from stochvi.engine.characteristics.modulated import Modulated

        return Modulated(self.stiffness / mass, self.damping / mass)


class Changed(NamedTuple):
    """What a modulation changes: the displacement row . q, and its spring (N/m) or damper
    (N s/m)."""

    row: Vector
    strength: float


def changed_by(modulation: Modulation, structure: AnyStructure) -> Changed:
    """What a modulation of stiffness or damping changes in a structure.

    Raises
    ------
    SceneError
        If the structure has no such spring or damper.
    """
    of = modulation.of
    if isinstance(structure, RigidBody):
        return _of_mount(modulation, structure)
    if not isinstance(structure, Oscillator | Isolator | Matrices):
        raise SceneError(
            [("", f"of {of} takes structure.kind = 'oscillator', 'isolator', 'matrices' or "
              f"'rigid-body', got {getattr(structure, 'kind', '')!r}")]
        )  # fmt: skip
    if modulation.axis is not None:
        raise SceneError([("", "takes no axis, which is that of a mount of a box")])
    if not structure.knows_mass:
        raise SceneError([("", "changes a force, which needs structure.mass, got none")])
    matrix = structure.matrices[1 if of == "damping" else 2]
    known = structure.coordinates
    names = modulation.between or ((modulation.on,) if modulation.on else known[:1])
    listed = " or ".join(repr(name) for name in known)
    if modulation.on and modulation.between:
        raise SceneError([("", "takes on or between, got both")])
    if len(known) > 1 and not (modulation.on or modulation.between):
        raise SceneError([("", f"needs on or between, with names of {listed}, got none")])
    if unknown := [name for name in names if name not in known]:
        raise SceneError([("", f"must act on {listed}, got {unknown[0]!r}")])
    if len(set(names)) < len(names):
        raise SceneError([("", f"needs two different names in between, got {names[0]!r} twice")])
    places = [known.index(name) for name in names]
    row = np.zeros(len(known))
    row[places[0]] = 1.0
    strength = float(matrix[places[0]].sum())
    if len(places) > 1:
        row[places[1]] = -1.0
        strength = float(-matrix[places[0], places[1]])
    if not strength > ROUNDING * abs(float(matrix[places[0], places[0]])):
        part = "spring" if of == "stiffness" else "damper"
        where = " and ".join(names) if len(names) > 1 else f"{names[0]} and the ground"
        raise SceneError([("", f"needs a linear {part} between {where}, got {strength:g}")])
    return Changed(row, strength)


def _of_mount(modulation: Modulation, box: RigidBody) -> Changed:
    """What a modulation changes in a mount of a box, which it names by its number."""
    names = [f"mount {number}" for number, _ in enumerate(box.mounts, 1)]
    on, axis = modulation.on or "none", modulation.axis
    if on not in names or axis is None or modulation.between:
        listed = " or ".join(repr(name) for name in names)
        got = f"on = {on!r}, axis = {axis!r}"
        raise SceneError(
            [("", f"needs on = {listed} and axis = 'x', 'y' or 'z', got {got}")]
        )  # fmt: skip
    mount, along = box.mounts[names.index(on)], AXES.index(axis)
    if modulation.of == "stiffness":
        rates = box.mount_stiffness(mount)
    elif mount.damping is not None:
        rates = np.array(mount.damping)
    else:
        raise SceneError(
            [("", f"of damping needs damping (N s/m along x, y, z) of {on}, got none")]
        )
    if not rates[along] > 0.0:
        raise SceneError([("", f"needs {modulation.of} of {on} along {axis}, got 0")])
    return Changed(mount.rows[along], float(rates[along]))
