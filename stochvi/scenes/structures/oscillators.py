"""Structures by mass, stiffness and damping. Chapters: what every structure answers; one mass;
matrices from files; a linear structure by its matrices."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Self

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray
from pydantic import Field, WithJsonSchema, field_validator, model_validator

from stochvi.mathematics.numerics import Matrix, Vector
from stochvi.mathematics.units import STANDARD_GRAVITY
from stochvi.results.errors import SceneError
from stochvi.scenes.characteristics import Characteristic, Damper, Spring
from stochvi.scenes.readers import read_arrays
from stochvi.scenes.validation import (
    Checked,
    Count,
    Function,
    Mean,
    NonNegative,
    Positive,
    Tolerance,
    VariedNonNegative,
    VariedPositive,
    check_values,
    evaluated,
    given,
    integral_of,
    sentences_of,
)
from stochvi.scenes.validation import Matrix as MatrixKey

# ------------------------------------------------------------------------------
# What every structure answers: a scene and its model ask nothing else of it.
#
# A structure moves by coordinates q (n,). What acts on it or is measured on it is a linear
# functional of them, row . q: a coordinate itself, a named point, the difference of two, or a
# weighted sum.
# ------------------------------------------------------------------------------


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

    def slipped_units(self) -> list[str]:
        """A sentence on a stiffness or a mass that seems to be in another unit, such as N/mm."""
        return []

    def assumptions(self) -> list[str]:
        """Assumptions on the structure, in words."""
        return []


# ------------------------------------------------------------------------------
# One mass on a spring and a damper.
#
# Its motion is m x'' + c x' + k x = force. With a damping force c(x') and a restoring force g(x) it
# is m x'' + c + g = force.
# ------------------------------------------------------------------------------


DAMPING_RATIOS = ("zeta", "Q", "loss_factor")
"""Keys that state the damping of a natural frequency, of which exactly one is given."""


class Oscillator(AnyStructure):
    """A mass on a spring and a damper, x'' + b x' + omega^2 x = f(t).

    Give `mass` and `stiffness` with exactly one of `damping`, `zeta`, `Q` and `loss_factor`, or
    `frequency_hz` with one of the last three.

    Parameters
    ----------
    mass
        Mass, kg. With `frequency_hz` it may be left out if no force acts on it; it is then 1 kg.
    damping, stiffness
        Damper, N s/m, and spring, N/m.
    frequency_hz
        Undamped natural frequency, Hz, omega = 2 pi frequency_hz.
    zeta, Q, loss_factor
        Damping ratio, b = 2 zeta omega; quality factor, Q = 1 / (2 zeta); or loss factor at the
        natural frequency, 2 zeta. A natural frequency, a damping ratio or a damper may be a
        `BetweenUnits`, which differs between units.

    Raises
    ------
    SceneError
        If the two descriptions are mixed, or one is incomplete.

    See Also
    --------
    stochvi.Isolator : On a moving base.
    stochvi.Matrices : Several masses.

    Examples
    --------
    >>> mount = Oscillator(frequency_hz=12.0, Q=5.0)
    >>> round(mount.omega, 4), round(mount.damping_rate / (2 * mount.omega), 4)
    (75.3982, 0.1)
    """

    own: ClassVar[str] = "a spring or a damper of your own is a NonlinearOscillator"

    kind: Literal["oscillator"] = "oscillator"
    mass: Positive | None = None
    damping: VariedNonNegative | None = None
    stiffness: NonNegative | None = None
    frequency_hz: VariedPositive | None = None
    zeta: VariedNonNegative | None = None
    Q: Positive | None = None
    loss_factor: NonNegative | None = None

    @model_validator(mode="after")
    def _one_description(self) -> Self:
        physical = [name for name in ("damping", "stiffness") if getattr(self, name) is not None]
        ratios = [name for name in DAMPING_RATIOS if getattr(self, name) is not None]
        modal = ["frequency_hz", *ratios] if self.frequency_hz is not None else ratios
        if physical == ["stiffness"] and modal == ratios != []:  # as catalogues give a mount
            if self.mass is None:
                raise ValueError(f"needs the mass as well as the stiffness with {ratios[0]}")
            if len(ratios) > 1:
                raise ValueError(
                    f"needs exactly one of zeta, Q and loss_factor, got {', '.join(ratios)}"
                )
            return self
        if physical and modal:
            raise ValueError(
                "must be given by mass, stiffness and one of damping, zeta, Q and loss_factor or "
                "by frequency_hz with zeta, Q or loss_factor, got a mixture: "
                f"{', '.join(physical + modal)}"
            )
        if not modal and (len(physical) < 2 or self.mass is None):
            raise ValueError(
                "needs mass, stiffness and one of damping, zeta, Q and loss_factor, or "
                "frequency_hz with exactly one of zeta, Q and loss_factor, got "
                f"{given(self, 'mass', 'damping', 'stiffness')}"
            )
        if modal and (self.frequency_hz is None or len(ratios) != 1):
            raise ValueError(
                "needs frequency_hz with exactly one of zeta, Q and loss_factor, got "
                f"{', '.join(modal)}"
            )
        return self

    @property
    def coordinates(self) -> tuple[str, ...]:
        """The displacements that move: x alone."""
        return ("x",)

    @property
    def movable(self) -> bool:
        return self.on_mount

    @property
    def knows_mass(self) -> bool:
        return self.mass is not None

    @property
    def carried_mass(self) -> float | None:
        return self.mass

    @property
    def rates(self) -> tuple[float, float]:
        return self.omega, self.damping_rate

    def constant_forces(self) -> Iterator[tuple[float, Vector]]:
        if self.gravity_load:
            yield -self.gravity_load, -self.matrices[0].sum(axis=1)

    @property
    def matrices(self) -> tuple[NDArray[np.float64], ...]:
        """Mass, damping and stiffness as matrices of one row (1 kg where no mass is given)."""
        mass = self.mass or 1.0
        entries = (mass, mass * self.damping_rate, mass * (self.omega * self.omega))
        return tuple(np.array([[entry]]) for entry in entries)

    @property
    def omega(self) -> float:
        """Undamped natural frequency, rad/s; 0 without a spring."""
        if self.frequency_hz is not None:
            return 2.0 * math.pi * self.frequency_hz
        assert self.stiffness is not None and self.mass is not None
        return math.sqrt(self.in_parallel * self.stiffness / self.mass)

    @property
    def damping_rate(self) -> float:
        """b = c / m = 2 zeta omega, 1/s."""
        if self.damping is not None:
            assert self.mass is not None
            return self.in_parallel * self.damping / self.mass
        return 2.0 * self._damping_ratio * self.omega

    @property
    def _damping_ratio(self) -> float:
        if self.Q is not None:
            return 0.5 / self.Q
        if self.loss_factor is not None:
            return 0.5 * self.loss_factor
        assert self.zeta is not None
        return self.zeta


class Isolator(Oscillator):
    """An oscillator on a moving base; x is the displacement relative to the base.

    x'' + b x' + omega^2 x = -a_base(t); the absolute acceleration of the mass between
    impacts is -(b x' + omega^2 x).

    Parameters
    ----------
    mounts
        How many equal mounts carry the mass side by side, where `stiffness` and `damping` are
        those of one of them; a damping ratio, Q or loss factor is that of each and of all.
        `frequency_hz` is that of the mass on all mounts, and takes none.
    gravity
        Whether gravity pulls the mass towards negative x: it then hangs at -g / omega^2, and
        stops, which are measured from the unloaded spring, lie closer below than above. Leave it
        out where clearances are measured from where the mass hangs.
    frequency_tolerance, damping_tolerance
        Relative tolerances of the natural frequency and of the damping ratio, as 0.1 for 10 %:
        `size` keeps its target within them. No simulation depends on them.

    See Also
    --------
    stochvi.Oscillator : A mass on a spring that is fixed.
    stochvi.scenes.RigidBody : A box on several mounts.

    Examples
    --------
    >>> four = Isolator(mass=10.0, mounts=4, stiffness=14212.0, damping=37.7, gravity=True)
    >>> round(four.omega / (2 * math.pi), 3), round(1e3 * four.sag, 3), round(four.gravity_load, 3)
    (12.0, 1.725, -9.807)
    """

    on_mount: ClassVar[bool] = True

    kind: Literal["isolator"] = "isolator"  # type: ignore[assignment]
    mounts: Count | None = None
    gravity: Annotated[bool, Field(strict=True)] = False
    frequency_tolerance: Tolerance | None = None
    damping_tolerance: Tolerance | None = None

    @model_validator(mode="after")
    def _mounts_have_a_stiffness(self) -> Self:
        if self.mounts is not None and self.frequency_hz is not None:
            raise ValueError(
                "takes mounts with the mass, the stiffness of one mount, and its damping, zeta, Q "
                "or loss_factor, got frequency_hz, which belongs to all mounts together"
            )
        for name, keys in LIMITED.items():
            both = [key for key in keys if isinstance(getattr(self, key), Mean)]
            if both and getattr(self, name) is not None:
                raise ValueError(
                    f"takes {name}, or {both[0]} that differs between units, got both; leave out "
                    f"{name}"
                )
        if self.gravity and self.omega == 0.0 and not self.spring:
            raise ValueError("needs a stiffness that carries the mass under gravity, got 0")
        return self

    def slipped_units(self) -> list[str]:
        return slipped_units(self, self.stiffness)

    @property
    def in_parallel(self) -> int:
        return self.mounts or 1

    @property
    def gravity_load(self) -> float:
        return -STANDARD_GRAVITY if self.gravity else 0.0

    @property
    def sag(self) -> float:
        """Static deflection of the spring under the weight that it carries, g / omega^2, m.

        It is that of the dynamic stiffness; an elastomer is softer at rest, and creeps.
        """
        return STANDARD_GRAVITY / self.omega**2 if self.omega else math.inf


LIMITED = {"frequency_tolerance": ("frequency_hz",), "damping_tolerance": ("zeta", "damping")}
"""Keys of tolerances, each with the keys of the quantity that it limits."""


MOUNTED = (0.8, 500.0)
"""Natural frequencies, Hz, between which mounts of equipment lie: air springs begin at the first,
and above the second nothing that shakes a vehicle is isolated."""


def slipped_units(structure: AnyStructure, given: ArrayLike | None) -> list[str]:
    """The sentence on a structure on mounts whose stiffness is stated, in N/m, if it slipped."""
    if given is None or structure.functions:
        return []
    mass, _, stiffness = structure.matrices
    held = np.diag(stiffness)[:3] / np.diag(mass)[:3]
    lowest, highest = np.sqrt([held.min(), held.max()]) / (2.0 * math.pi)
    if lowest <= MOUNTED[1] and highest >= MOUNTED[0]:
        return []
    few = highest < MOUNTED[0]
    least = float(np.min(given))
    remedy = f": {least:g} N/mm are {1000.0 * least:g} N/m" if few else ""
    return [
        f"the natural frequency {highest if few else lowest:.3g} Hz lies outside those of "
        f"mounts of equipment ({MOUNTED[0]:g} to {MOUNTED[1]:g} Hz); stiffness is in N/m and "
        f"mass in kg{remedy}"
    ]


class NonlinearOscillator(AnyStructure):
    """A mass on a spring and a damper of any characteristic, m x'' + c(x') + g(x) = f(t).

    Functions cannot be written in a scene file: this structure is for Python only, and for
    methods that take functions. Each takes an array and returns one of the same shape.

    Parameters
    ----------
    mass
        Mass, kg.
    restoring_force
        g, N, as a function of displacement, m.
    damping, damping_force
        Exactly one: c of a linear damper, N s/m, or its force as a function of velocity, N.
    potential
        Energy of the spring as a function of displacement, J, up to a constant. By quadrature of
        `restoring_force` where it is not given.

    Raises
    ------
    SceneError
        If a function is not finite about 0, or cannot take an array.

    See Also
    --------
    stochvi.Oscillator : With a linear spring and damper.

    Examples
    --------
    >>> duffing = NonlinearOscillator(mass=2.0, damping=0.2, restoring_force=lambda x: x + x**3)
    >>> duffing.potential_at([0.0, 1.0]).round(12).tolist(), duffing.damping_rate
    ([0.0, 0.75], 0.1)
    """

    linear: ClassVar[bool] = False

    kind: Literal["nonlinear"] = "nonlinear"
    mass: Positive
    restoring_force: Function
    damping: NonNegative | None = None
    damping_force: Function | None = None
    potential: Function | None = None

    @model_validator(mode="after")
    def _functions(self) -> Self:
        if self.spring or self.damper:
            raise ValueError(
                "takes restoring_force and damping_force, got "
                f"{given(self, 'spring', 'damper')}; add the forces, or take an Oscillator"
            )
        if (self.damping is None) == (self.damping_force is None):
            raise ValueError(
                "needs exactly one of damping and damping_force, "
                f"got {given(self, 'damping', 'damping_force')}"
            )
        for name in ("restoring_force", "damping_force", "potential"):
            function = getattr(self, name)
            if function is not None:
                check_values(name, function, ABOUT_ZERO)
        return self

    @property
    def coordinates(self) -> tuple[str, ...]:
        """The displacement that moves, x."""
        return ("x",)

    @property
    def matrices(self) -> tuple[NDArray[np.float64], ...]:
        """The mass as a matrix of one row; there are no matrices of damping and stiffness."""
        return (np.array([[self.mass]]),)

    @property
    def movable(self) -> bool:
        return False

    @property
    def rates(self) -> tuple[float, float]:
        return 0.0, self.damping_rate or 0.0

    @property
    def damping_rate(self) -> float | None:
        """b = c / m, 1/s; None where damping is a function."""
        return None if self.damping is None else self.damping / self.mass

    def force_at(self, x: ArrayLike) -> Vector:
        """Restoring force at displacements x (m), N."""
        return evaluated(self.restoring_force, np.asarray(x, dtype=float))

    def damping_at(self, v: ArrayLike) -> Vector:
        """Damping force at velocities v (m/s), N."""
        velocity = np.asarray(v, dtype=float)
        if self.damping_force is not None:
            return evaluated(self.damping_force, velocity)
        assert self.damping is not None
        return np.asarray(self.damping * velocity, dtype=float)

    def potential_at(self, x: ArrayLike) -> Vector:
        """Energy of the spring at displacements x (m), less that at 0, J."""
        place = np.asarray(x, dtype=float)
        if self.potential is None:
            return integral_of(self.restoring_force, place)
        energy: Vector = evaluated(self.potential, np.append(place.ravel(), 0.0))
        return np.asarray(energy[:-1] - energy[-1]).reshape(place.shape)


ABOUT_ZERO = np.array([-1e-9, 0.0, 1e-9])
"""Displacements (m) or velocities (m/s) at which a function is evaluated once to check its values.

They are close to 0, because the scale of the motion is not known yet.
"""


# ------------------------------------------------------------------------------
# Matrices of a structure from a file: OP4 of Nastran, MATLAB, NumPy.
# ------------------------------------------------------------------------------


KINDS = {".op4": "Nastran matrices", ".mat": "MATLAB", ".npz": ""}
"""Ending of a file of matrices -> its kind; files of numpy are read here."""

NAMES_LISTED = 8
"""Number of matrices that a sentence lists."""


def read_matrices(file: str, names: Mapping[str, str], *, damped: bool) -> dict[str, Matrix]:
    """Mass, stiffness and damping from a file, whose ending tells its kind.

    Parameters
    ----------
    file
        Name of the file.
    names
        Names of "mass", "damping" and "stiffness" in the file where they differ from these; capital
        letters are as small ones.
    damped
        Whether the damping is wanted, too.

    Raises
    ------
    SceneError
        If the file does not hold these matrices.
    """
    path = Path(file)
    kind = KINDS.get(path.suffix.lower())
    if kind is None:
        raise SceneError(f"{path} must end in one of {', '.join(KINDS)}")
    arrays = read_arrays(path, kind)
    held = {name.lower(): array for name, array in arrays.items()}
    found = {}
    for key in ("mass", "stiffness", *["damping"] * damped):
        name = names.get(key, key)
        matrix = held.get(name.lower())
        if matrix is None:
            listed = ", ".join(list(arrays)[:NAMES_LISTED])
            raise SceneError(
                f"{path} has no matrix {name!r} for {key}: it has {listed or 'none'}; "
                f'write {key} = "NAME"'
                f"{', or zeta in the place of damping' if key == 'damping' else ''}"
            )
        if matrix.ndim != 2 or np.iscomplexobj(matrix):
            got = "a vector" if matrix.ndim != 2 else "a complex one"
            raise SceneError(f"{path} must hold a real square matrix {name!r}, got {got}")
        found[key] = matrix
    return found


# ------------------------------------------------------------------------------
# A linear structure by its matrices: M x'' + C x' + K x = force.
# ------------------------------------------------------------------------------


NamedMatrix = Annotated[
    MatrixKey,
    WithJsonSchema(
        {
            "anyOf": [
                {"type": "array", "items": {"type": "array", "items": {"type": "number"}}},
                {"type": "string"},
            ]
        }
    ),
]
"""A matrix, or its name in a file."""


class Matrices(AnyStructure):
    """A linear structure of several coordinates, M x'' + C x' + K x = force.

    Parameters
    ----------
    coordinates
        A name for each displacement, in the order of rows and columns; with a file "x1", "x2" and
        so on, unless others are given.
    mass, damping, stiffness
        Symmetric matrices, kg, N s/m and N/m; the mass positive definite, the others without
        negative eigenvalues. On a moving base, displacements are relative to it. With a file, the
        name of each matrix in it, by default "mass", "damping" and "stiffness".
    zeta
        Damping ratio of every natural mode, instead of a damping matrix:
        C = sum over modes of 2 zeta omega (M phi) (M phi)', phi' M phi = 1.
    file
        A file of the matrices: Nastran (.op4, with the extra `fem`), MATLAB (.mat) or NumPy (.npz).
    source
        Where the numbers come from; by default the name of the file.

    See Also
    --------
    stochvi.Oscillator : A single mass.
    stochvi.scenes.Modes : A structure by its natural modes, also from a file.
    stochvi.scenes.RigidBody : A box, whose matrices are built.

    Examples
    --------
    >>> loose = Matrices(
    ...     coordinates=["structure", "absorber"],
    ...     mass=[[1.0, 0.0], [0.0, 0.1]],
    ...     damping=[[0.1, 0.0], [0.0, 0.0]],
    ...     stiffness=[[1.0, 0.0], [0.0, 0.0]],
    ... )
    >>> loose.coordinates
    ('structure', 'absorber')
    """

    kind: Literal["matrices"] = "matrices"
    coordinates: tuple[str, ...]
    mass: NamedMatrix
    damping: NamedMatrix | None = None
    stiffness: NamedMatrix
    zeta: NonNegative | None = None
    file: str | None = None
    source: str | None = None

    @model_validator(mode="before")
    @classmethod
    def _from_file(cls, keys: Any) -> Any:
        """The keys with the matrices of the file instead of its name, if a file is given."""
        if not isinstance(keys, dict) or not isinstance(keys.get("file"), str):
            return keys
        names = {
            name: keys[name]
            for name in ("mass", "damping", "stiffness")
            if isinstance(keys.get(name), str)
        }
        damped = "damping" in names or keys.get("zeta") is None
        with sentences_of("file"):
            found = read_matrices(keys["file"], names, damped=damped)
        count = len(found["mass"])
        rest = {name: value for name, value in keys.items() if name not in (*names, "file")}
        numbered = {"coordinates": tuple(f"x{n}" for n in range(1, count + 1))}
        return {"source": Path(keys["file"]).name} | numbered | found | rest

    @field_validator("coordinates", mode="before")
    @classmethod
    def _names(cls, names: object) -> object:
        return tuple(names) if isinstance(names, list) else names

    @model_validator(mode="after")
    def _fit_together(self) -> Self:
        count = len(self.coordinates)
        taken = {"base", ""} & set(self.coordinates)
        if count == 0 or len(set(self.coordinates)) < count or taken:
            raise ValueError(
                "needs coordinates with different names, none of them empty or 'base', "
                f"got {list(self.coordinates)}"
            )
        if (self.damping is None) == (self.zeta is None):
            raise ValueError(
                f"needs exactly one of damping and zeta, got {given(self, 'damping', 'zeta')}"
            )
        for name in ("mass", "damping", "stiffness"):
            rows = getattr(self, name)
            if rows is None:
                continue
            if len(rows) != count or any(len(row) != count for row in rows):
                shape = " and ".join(str(len(row)) for row in rows)
                raise ValueError(
                    f"needs {name} with {count} rows and columns, one for each coordinate, got "
                    f"{len(rows)} rows of {shape}"
                )
            matrix = np.array(rows)
            larger = np.maximum(np.abs(matrix), np.abs(matrix.T))
            off = np.abs(matrix - matrix.T) - SYMMETRY * (larger + _sizes(matrix))
            if off.max() > 0.0:
                i, j = np.unravel_index(np.argmax(off), matrix.shape)
                raise ValueError(
                    f"needs a symmetric matrix {name}, got {matrix[i, j]:g} in row {i + 1}, column "
                    f"{j + 1} and {matrix[j, i]:g} in row {j + 1}, column {i + 1}"
                )
            smallest = _smallest_eigenvalue(matrix)
            if smallest < -SYMMETRY:
                raise ValueError(
                    f"needs a matrix {name} without negative eigenvalues (a spring or damper that "
                    "pushes); a zero on its diagonal needs zeros in its row"
                )
            if name == "mass" and smallest <= SYMMETRY:
                raise ValueError(
                    "needs a positive definite matrix mass: every coordinate needs a mass above 0"
                )
        return self

    @property
    def carried_mass(self) -> float:
        return float(self.matrices[0].sum())

    @property
    def matrices(self) -> tuple[NDArray[np.float64], ...]:
        """Mass, damping and stiffness."""
        mass, stiffness = _evened(self.mass), _evened(self.stiffness)
        if self.damping is not None:
            return mass, _evened(self.damping), stiffness
        squares, shapes = scipy.linalg.eigh(stiffness, mass)
        moved = mass @ shapes
        rates = 2.0 * (self.zeta or 0.0) * np.sqrt(np.maximum(squares, 0.0))
        return mass, (rates * moved) @ moved.T, stiffness

    def assumptions(self) -> list[str]:
        found = [] if self.source is None else [f"matrices: {self.source}"]
        return found if self.zeta is None else [*found, "the damping ratio is that of each mode"]


SYMMETRY = 1e-9
"""Largest difference of two opposite entries that counts as a rounding error, relative to them and
to what the diagonal allows. Programs leave rounding in place of zeros."""


def _sizes(matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    """The largest size that entries beside a diagonal have without negative eigenvalues."""
    size = np.sqrt(np.abs(np.diag(matrix)))
    return np.outer(size, size)


def _evened(rows: Sequence[Sequence[float]]) -> NDArray[np.float64]:
    """A matrix that is symmetric to the last digit."""
    matrix = np.array(rows)
    return np.asarray(0.5 * (matrix + matrix.T))


def _smallest_eigenvalue(matrix: NDArray[np.float64]) -> float:
    """Smallest eigenvalue of D^-1/2 A D^-1/2 with D the diagonal of A, which is free of units."""
    size = np.sqrt(np.abs(np.diag(matrix)))
    if np.any(matrix[size == 0.0]):
        return -1.0  # a zero on the diagonal of a matrix without negative eigenvalues is alone
    inverse = np.divide(1.0, size, out=np.zeros_like(size), where=size > 0.0)
    return float(np.linalg.eigvalsh(inverse[:, None] * matrix * inverse)[0])
