"""A rigid box on its mounts: six coordinates, small angles.

The point at p (m from the centre of mass) moves by u = r + theta x p. r = (x, y, z) is the motion
of the centre of mass relative to the base, theta = (rx, ry, rz) the rotation. A mount at p with the
stiffnesses k along x, y, z stores u'diag(k)u / 2, so that with u = B q

    M = diag(mass, mass, mass, inertia),   K = sum B' diag(k) B,   C = sum B' diag(c) B
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import BeforeValidator, Field, field_validator, model_validator

from stochvi.mathematics.numerics import Matrix, Vector
from stochvi.mathematics.units import STANDARD_GRAVITY
from stochvi.results.errors import SceneError
from stochvi.scenes.characteristics import Damper, Spring
from stochvi.scenes.structures.oscillators import AnyStructure, Placed, slipped_units
from stochvi.scenes.validation import (
    Checked,
    NonNegative,
    Number,
    Positive,
    Tolerance,
    given,
)

AXES = ("x", "y", "z")
"""Axes of the base, along which it moves, and of the box, which turns by small angles only."""

MOTIONS = {
    "x": ("surge", "surges"),
    "y": ("sway", "sways"),
    "z": ("bounce", "bounces"),
    "rx": ("roll", "rolls"),
    "ry": ("pitch", "pitches"),
    "rz": ("yaw", "yaws"),
}
"""Coordinates of a rigid body, and the usual words for its motion along or about an axis."""

SYMMETRY = 1e-9
"""Largest relative difference that counts as a rounding error when an inertia tensor is checked."""

HELD = 1e-12
"""Smallest ratio of the lowest to the highest squared natural frequency at which the body counts as
held in all directions."""


def _plain(values: object) -> object:
    return values.tolist() if hasattr(values, "tolist") else values


def _finite(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


Triple = Annotated[tuple[Number, Number, Number], BeforeValidator(_plain)]
"""Three numbers, along x, y and z."""

NonNegativeTriple = Annotated[tuple[NonNegative, NonNegative, NonNegative], BeforeValidator(_plain)]
"""Three numbers from 0 on, along x, y and z."""


class Mount(Checked):
    """A mount between the base and a rigid body.

    Parameters
    ----------
    at
        Place where the mount holds the body, m from its centre of mass.
    stiffness
        Stiffness along x, y and z, N/m.
    frequency_hz
        Instead of the stiffness: natural frequency, Hz, of the body on all mounts together along z.
        All mounts have the same stiffness, which is equal along x, y and z.
    damping
        Damping along x, y and z, N s/m.
    zeta, loss_factor
        Instead of the damping: the damping ratio that the mount gives to a mode whose whole energy
        it stores, or its loss factor, which is twice that.
    spring, damper
        Springs and dampers that are functions, each along its `axis`; they add to the others.

    See Also
    --------
    stochvi.scenes.RigidBody : The box that stands on it.

    Examples
    --------
    >>> mount = Mount(at=[0.2, 0.15, -0.05], stiffness=[2e4, 2e4, 4e4], loss_factor=0.2)
    >>> mount.ratio
    0.1
    """

    at: Triple
    stiffness: NonNegativeTriple | None = None
    frequency_hz: Positive | None = None
    damping: NonNegativeTriple | None = None
    zeta: NonNegative | None = None
    loss_factor: NonNegative | None = None
    spring: Spring | None = None
    damper: Damper | None = None

    @model_validator(mode="after")
    def _along_an_axis(self) -> Self:
        for key in ("spring", "damper"):
            for law in getattr(self, key) or ():
                if law.axis is None or law.on is not None or law.between is not None:
                    got = given(law, "on", "between")
                    raise ValueError(
                        f"needs axis = 'x', 'y' or 'z' in {key}, and no other place, got {got}"
                    )
        return self

    @model_validator(mode="after")
    def _one_description(self) -> Self:
        if (self.stiffness is None) == (self.frequency_hz is None):
            raise ValueError(
                "needs exactly one of stiffness (N/m along x, y, z) and frequency_hz (of all "
                f"mounts together along z), got {given(self, 'stiffness', 'frequency_hz')}"
            )
        damped = [each for each in (self.damping, self.zeta, self.loss_factor) if each is not None]
        if len(damped) != 1:
            raise ValueError(
                "needs exactly one of damping (N s/m along x, y, z), zeta and loss_factor, got "
                f"{given(self, 'damping', 'zeta', 'loss_factor')}"
            )
        return self

    @property
    def ratio(self) -> float | None:
        """Damping ratio of a mode that this mount alone holds; None where dampers are given."""
        return self.zeta if self.loss_factor is None else 0.5 * self.loss_factor

    @property
    def rows(self) -> Matrix:
        """Displacement (3, 6) of the mount per unit of each coordinate."""
        return rows_at(self.at)


class RigidBody(AnyStructure):
    """A rigid box on mounts, on a base that moves along x, y and z.

    The coordinates are those of the centre of mass relative to the base: x, y, z (m) and the small
    angles rx, ry, rz (rad).

    Parameters
    ----------
    mass
        Mass, kg.
    inertia
        Moments of inertia about the centre of mass, kg m^2: three principal ones about x, y and z,
        or the symmetric tensor, 3 x 3, with -int x y dm beside its diagonal.
    mounts
        The mounts; `[[structure.mount]]` in a scene file.
    gravity
        Direction in which gravity pulls, as "-z". The box then hangs below the position of the
        unloaded mounts, from which stops are measured. Leave gravity out if clearances are measured
        from where the box hangs.
    points
        Places, m from the centre of mass, whose motion is reported, by their names.
    frequency_tolerance, damping_tolerance, centre_tolerance
        Relative tolerances of the natural frequencies and of the damping ratios, as 0.1 for 10 %.
        The last is how far the centre of mass may lie from its stated place along each axis, m.
        `size` keeps its target within them. No simulation depends on them.

    Raises
    ------
    SceneError
        If no body has this inertia, or if the mounts leave a motion free.

    See Also
    --------
    stochvi.scenes.Mount : One of its mounts. stochvi.explain : Its modes, in words.

    Examples
    --------
    >>> corners = [(x, y, -0.05) for x in (-0.2, 0.2) for y in (-0.15, 0.15)]
    >>> box = RigidBody(
    ...     mass=12.0, inertia=[0.20, 0.25, 0.15], gravity="-z",
    ...     mounts=[Mount(at=at, stiffness=[2e4, 2e4, 4e4], zeta=0.1) for at in corners],
    ... )
    >>> box.natural_frequency_hz.round(2).tolist()
    [12.48, 12.73, 18.38, 22.24, 25.99, 29.06]
    """

    kind: Literal["rigid-body"] = "rigid-body"
    mass: Positive
    inertia: Annotated[
        tuple[Number, Number, Number] | tuple[Triple, Triple, Triple], BeforeValidator(_plain)
    ]
    mounts: tuple[Mount, ...] = Field(alias="mount")
    gravity: Literal["x", "+x", "-x", "y", "+y", "-y", "z", "+z", "-z"] | None = None
    points: dict[str, Triple] | None = None
    frequency_tolerance: Tolerance | None = None
    damping_tolerance: Tolerance | None = None
    centre_tolerance: NonNegative | None = None

    @field_validator("inertia", mode="before")
    @classmethod
    def _three_or_nine(cls, value: object) -> object:
        value = _plain(value)
        if not isinstance(value, list | tuple) or len(value) != 3:
            raise ValueError(
                "must be three moments of inertia (kg m^2) or a matrix of three rows, got "
                f"{str(value)[:60]}"
            )
        rows = [row if isinstance(row, list | tuple) else [row] for row in value]
        entries = [each for row in rows for each in row]
        if {len(row) for row in rows} not in ({1}, {3}) or not all(map(_finite, entries)):
            raise ValueError(
                "must hold three finite moments of inertia (kg m^2), or three rows of three, got "
                f"{str(value)[:60]}"
            )
        return tuple(tuple(row) if isinstance(row, list) else row for row in value)

    @model_validator(mode="after")
    def _is_a_body_that_is_held(self) -> Self:
        problems = [("inertia", sentence) for sentence in _impossible(self.tensor)]
        if not self.mounts:
            problems.append(("mount", "needs at least one [[structure.mount]], got none"))
        frequencies = {mount.frequency_hz for mount in self.mounts}
        if len(frequencies) > 1:
            listed = ", ".join("none" if f is None else f"{f:g}" for f in frequencies)
            problems.append(
                ("mount", "needs one frequency_hz, that of all mounts together along z, at every "
                 f"mount, or at none of them, got {listed}")
            )  # fmt: skip
        for name in self.points or {}:
            if not name or not name.replace("_", "").replace("-", "").replace(" ", "").isalnum():
                problems.append(
                    ("points", f"needs names of letters, digits, blanks, - and _, got {name!r}")
                )
        if not problems and (free := self._free_motion()):
            problems.append(("mount", f"leaves a motion of the body free: {free}; add stiffness"))
        if problems:
            raise SceneError(problems)
        return self

    def slipped_units(self) -> list[str]:
        stated = (each.stiffness for each in self.mounts)
        return slipped_units(self, next((each for each in stated if each is not None), None))

    @property
    def coordinates(self) -> tuple[str, ...]:
        """The displacements and rotations of the centre of mass."""
        return tuple(MOTIONS)

    @property
    def tensor(self) -> Matrix:
        """Inertia about the centre of mass (3, 3), kg m^2."""
        given_ = np.array(self.inertia, dtype=float)
        return np.diag(given_) if given_.ndim == 1 else given_

    @property
    def matrices(self) -> tuple[Matrix, ...]:
        """Mass, damping and stiffness (6, 6)."""
        mass = self._mass
        stiffness = sum(self._stiffnesses, start=np.zeros((6, 6)))
        return mass, self._damping(mass, stiffness), stiffness

    @property
    def natural_frequency_hz(self) -> Vector:
        """Undamped natural frequencies in rising order (6,), Hz."""
        mass, _, stiffness = self.matrices
        return np.asarray(np.sqrt(modes_of(mass, stiffness)[0]) / (2.0 * math.pi))

    @property
    def carried(self) -> Mapping[str, Vector]:
        return dict(zip(AXES, np.eye(6), strict=False))

    @property
    def carried_mass(self) -> float:
        return self.mass

    @property
    def reported(self) -> Mapping[str, Vector]:
        return {
            f"{name}.{axis}": row
            for name, place in (self.points or {}).items()
            for axis, row in zip(AXES, rows_at(place), strict=True)
        }

    @property
    def functions(self) -> tuple[Placed, ...]:
        found = list(super().functions)
        for number, mount in enumerate(self.mounts, 1):
            for key, laws in (("spring", mount.spring), ("damper", mount.damper)):
                for law in laws or ():
                    row = mount.rows[AXES.index(law.axis or "x")]
                    found.append(Placed(f"{key} of mount {number} along {law.axis}", row, law))
        return tuple(found)

    def constant_forces(self) -> Iterator[tuple[float, Vector]]:
        if self.gravity:
            yield 1.0, self._mass @ self.load_of_gravity

    @property
    def load_of_gravity(self) -> Vector:
        """Acceleration of each coordinate (6,) by gravity, m/s^2; zeros where it is left out."""
        pull = np.zeros(6)
        if self.gravity is not None:
            sign = -1.0 if self.gravity[0] == "-" else 1.0
            pull[AXES.index(self.gravity[-1])] = sign * STANDARD_GRAVITY
        return pull

    def assumptions(self) -> list[str]:
        """Assumptions on the body and its mounts, in words."""
        found = [
            "the box is rigid and turns by small angles; mounts push along x, y and z where they "
            "hold it, and do not resist its rotation there"
        ]
        if any(mount.ratio for mount in self.mounts):
            found.append(
                "damping by zeta or loss_factor is stated as viscous at the natural frequency of "
                "each mode"
            )
        if any(mount.frequency_hz for mount in self.mounts):
            found.append(
                "mounts given by frequency_hz are equally stiff along x, y and z, and equal to "
                "each other"
            )
        if self.gravity:
            found.append(
                "gravity moves the box to where it hangs; its own small stiffness against tilting, "
                "weight times the height of the centre of mass, is left out"
            )
        return found

    def mount_stiffness(self, mount: Mount) -> Vector:
        """Stiffness of a mount along x, y and z (3,), N/m."""
        if mount.stiffness is not None:
            return np.array(mount.stiffness)
        assert mount.frequency_hz is not None
        whole = self.mass * (2.0 * math.pi * mount.frequency_hz) ** 2
        return np.full(3, whole / len(self.mounts))

    @property
    def _mass(self) -> Matrix:
        mass = np.diag([self.mass] * 3 + [0.0] * 3)
        mass[3:, 3:] = self.tensor
        return mass

    @property
    def _stiffnesses(self) -> list[Matrix]:
        """Contribution of each mount to the stiffness (6, 6)."""
        return [(mount.rows.T * self.mount_stiffness(mount)) @ mount.rows for mount in self.mounts]

    def _damping(self, mass: Matrix, stiffness: Matrix) -> Matrix:
        """Damping matrix (6, 6) of dampers, and of damping ratios as viscous damping of each mode.

        K_i is the part of a mount in the stiffness, zeta its ratio. It damps the modes phi of the
        frequencies w by 2 zeta phi_r'K_i phi_s / sqrt(w_r w_s). Each mode then gets the mean of the
        ratios, weighted by the energy that each mount stores.
        """
        total = np.zeros((6, 6))
        squares, shapes = modes_of(mass, stiffness)
        reach = mass @ shapes / squares**0.25
        for mount, own in zip(self.mounts, self._stiffnesses, strict=True):
            if mount.damping is not None:
                total += (mount.rows.T * np.array(mount.damping)) @ mount.rows
            elif mount.ratio:
                total += 2.0 * mount.ratio * reach @ (shapes.T @ own @ shapes) @ reach.T
        return total

    def _free_motion(self) -> str:
        """A motion that no mount resists, in words; empty if there is none."""
        stiffness = sum(self._stiffnesses, start=np.zeros((6, 6)))
        squares, shapes = modes_of(self._mass, stiffness)
        if squares[0] > HELD * squares[-1]:
            return ""
        return motion_in_words(shapes[:, 0], self._mass)


def rows_at(place: tuple[float, float, float]) -> Matrix:
    """Displacement (3, 6) of the point `place` (m) of a body per unit of each of its coordinates.

    Examples
    --------
    >>> rows_at((0.0, 0.0, 2.0))[0].tolist()
    [1.0, 0.0, 0.0, 0.0, 2.0, -0.0]
    """
    x, y, z = place
    turned = np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]])
    return np.hstack([np.eye(3), turned])


def modes_of(mass: Matrix, stiffness: Matrix) -> tuple[Vector, Matrix]:
    """Modes of M q'' + K q = 0: squares of the angular frequencies (n,) in rising order, and shapes
    as columns (n, n) with Phi'M Phi = 1."""
    inverse = np.linalg.inv(np.linalg.cholesky(mass))
    squares, turned = np.linalg.eigh(inverse @ stiffness @ inverse.T)
    return squares, inverse.T @ turned


def motion_in_words(shape: Vector, mass: Matrix) -> str:
    """A mode shape of a rigid body in words, with the coordinates by falling share of the energy.

    Parameters
    ----------
    shape
        Displacements and rotations (6,) of the coordinates.
    mass
        Mass matrix (6, 6).

    Examples
    --------
    >>> motion_in_words(np.array([0.0, 0.0, 1.0, 0.0, 0.8, 0.0]), np.eye(6))
    'z with ry: the box bounces and pitches'
    """
    shares = energy_shares(shape, mass)
    order = [int(k) for k in np.argsort(-shares, kind="stable") if shares[k] >= LEAST_SHARE]
    names = [tuple(MOTIONS)[k] for k in order]
    verbs = [MOTIONS[name][1] for name in names]
    doing = verbs[0] if len(verbs) == 1 else f"{', '.join(verbs[:-1])} and {verbs[-1]}"
    with_ = f" with {', '.join(names[1:])}" if names[1:] else ""
    return f"{names[0]}{with_}: the box {doing}"


LEAST_SHARE = 0.03
"""Smallest share of a mode's kinetic energy with which a coordinate is named in its description."""


def energy_shares(shape: Vector, mass: Matrix) -> Vector:
    """Share of each coordinate in the kinetic energy of a mode (n,), without the terms of products
    of inertia."""
    own = shape**2 * np.diag(mass)
    return np.asarray(own / own.sum())


def _impossible(inertia: Matrix) -> list[str]:
    """Sentences on why no body can have this inertia; empty if a body can."""
    size = float(np.abs(inertia).max())
    if float(np.abs(inertia - inertia.T).max()) > SYMMETRY * size:
        return [f"must be a symmetric matrix (kg m^2), got {inertia.tolist()}"]
    principal = np.linalg.eigvalsh(inertia)
    listed = ", ".join(f"{each:.4g}" for each in principal)
    if not principal[0] > SYMMETRY * size:
        return [
            "must be positive definite: every moment of inertia of a body is above 0, got the "
            f"principal moments {listed} kg m^2"
        ]
    if principal[2] > (1.0 + SYMMETRY) * (principal[0] + principal[1]):
        return [
            "is that of no body: the largest principal moment of inertia is at most the sum of the "
            f"other two, got {listed} kg m^2"
        ]
    return []
