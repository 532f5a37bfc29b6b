"""The linear structure that moves between the stops: M x'' + C x' + K x = force."""

from __future__ import annotations

import math
from typing import Annotated, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, field_validator, model_validator

from stochvi.checked import Checked, Count, Matrix, NonNegative, Positive, given
from stochvi.conventions import STANDARD_GRAVITY

Tolerance = Annotated[NonNegative, Field(lt=1)]
"""A relative tolerance; at 1 the quantity could vanish."""


class Oscillator(Checked):
    """A mass on a spring and a damper, x'' + b x' + omega^2 x = f(t).

    Give `mass`, `damping` and `stiffness` (kg, N s/m, N/m), or `frequency_hz` with exactly
    one of `zeta` and `Q` (b = 2 zeta omega, Q = 1 / (2 zeta)). `mass` may be left out in the
    second form as long as no force acts on it; it is then 1 kg.

    Examples
    --------
    >>> mount = Oscillator(frequency_hz=12.0, Q=5.0)
    >>> round(mount.omega, 4), round(mount.damping_rate / (2 * mount.omega), 4)
    (75.3982, 0.1)
    """

    kind: Literal["oscillator"] = "oscillator"
    mass: Positive | None = None
    damping: NonNegative | None = None
    stiffness: NonNegative | None = None
    frequency_hz: Positive | None = None
    zeta: NonNegative | None = None
    Q: Positive | None = None

    @model_validator(mode="after")
    def _one_description(self) -> Self:
        physical = [name for name in ("damping", "stiffness") if getattr(self, name) is not None]
        modal = [name for name in ("frequency_hz", "zeta", "Q") if getattr(self, name) is not None]
        if physical and modal:
            raise ValueError(
                "must be given by mass, damping and stiffness or by frequency_hz with zeta or Q, "
                f"got a mixture: {', '.join(physical + modal)}"
            )
        if not modal and (len(physical) < 2 or self.mass is None):
            raise ValueError(
                "needs mass, damping and stiffness, or frequency_hz with exactly one of zeta and "
                f"Q, got {given(self, 'mass', 'damping', 'stiffness')}"
            )
        if modal and (self.frequency_hz is None or (self.zeta is None) == (self.Q is None)):
            raise ValueError(
                f"needs frequency_hz with exactly one of zeta and Q, got {', '.join(modal)}"
            )
        return self

    @property
    def in_parallel(self) -> int:
        """How many springs and dampers of the stated size carry the mass."""
        return 1

    @property
    def gravity_load(self) -> float:
        """Constant acceleration of gravity, m/s^2, where the scene counts it."""
        return 0.0

    @property
    def coordinates(self) -> tuple[str, ...]:
        """The displacements that move: of an oscillator, x."""
        return ("x",)

    @property
    def matrices(self) -> tuple[NDArray[np.float64], ...]:
        """Mass, damping and stiffness as matrices of one row (1 kg where no mass is given)."""
        mass = self.mass or 1.0
        entries = (mass, mass * self.damping_rate, mass * self.omega**2)
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
        zeta = self.zeta if self.Q is None else 0.5 / self.Q
        assert zeta is not None
        return 2.0 * zeta * self.omega


class Isolator(Oscillator):
    """An oscillator on a moving base; x is the displacement relative to the base.

    x'' + b x' + omega^2 x = -a_base(t); the absolute acceleration of the mass between
    impacts is -(b x' + omega^2 x).

    Parameters
    ----------
    mounts
        How many equal mounts carry the mass side by side; `stiffness` and `damping` are then those
        of one of them.
    gravity
        Whether gravity pulls the mass towards negative x: it then hangs at -g / omega^2, and
        stops, which are measured from the unloaded spring, lie closer below than above. Leave it
        out where clearances are measured from where the mass hangs.
    frequency_tolerance, damping_tolerance
        Relative tolerances of the natural frequency and of the damping ratio, as 0.1 for 10 %.
        Nothing simulated depends on them: they say how far a sensitivity reaches.

    Examples
    --------
    >>> four = Isolator(mass=10.0, mounts=4, stiffness=14212.0, damping=37.7, gravity=True)
    >>> round(four.omega / (2 * math.pi), 3), round(1e3 * four.sag, 3), round(four.gravity_load, 3)
    (12.0, 1.725, -9.807)
    """

    kind: Literal["isolator"] = "isolator"  # type: ignore[assignment]
    mounts: Count | None = None
    gravity: Annotated[bool, Field(strict=True)] = False
    frequency_tolerance: Tolerance | None = None
    damping_tolerance: Tolerance | None = None

    @model_validator(mode="after")
    def _mounts_have_a_stiffness(self) -> Self:
        if self.mounts is not None and self.frequency_hz is not None:
            raise ValueError(
                "takes mounts with the mass, and the stiffness and damping of one mount, got "
                "mounts with frequency_hz, which is that of all"
            )
        if self.gravity and self.omega == 0.0:
            raise ValueError("needs a stiffness that carries the mass under gravity, got 0")
        return self

    @property
    def in_parallel(self) -> int:
        return self.mounts or 1

    @property
    def gravity_load(self) -> float:
        return -STANDARD_GRAVITY if self.gravity else 0.0

    @property
    def sag(self) -> float:
        """How far a spring gives way under the weight it carries, g / omega^2, m.

        That of the dynamic stiffness; an elastomer is softer at rest, and creeps.
        """
        return STANDARD_GRAVITY / self.omega**2


class Matrices(Checked):
    """A linear structure of several coordinates, M x'' + C x' + K x = force.

    Parameters
    ----------
    coordinates
        A name for each displacement, in the order of rows and columns.
    mass, damping, stiffness
        Symmetric matrices, kg, N s/m and N/m; the mass positive definite, the others without
        negative eigenvalues. On a moving base, displacements are relative to it.

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
    mass: Matrix
    damping: Matrix
    stiffness: Matrix

    @field_validator("coordinates", mode="before")
    @classmethod
    def _names(cls, names: object) -> object:
        return tuple(names) if isinstance(names, list) else names

    @model_validator(mode="after")
    def _fit_together(self) -> Self:
        count = len(self.coordinates)
        if count == 0 or len(set(self.coordinates)) < count or "base" in self.coordinates:
            raise ValueError(
                "needs coordinates with different names, none of them 'base', "
                f"got {list(self.coordinates)}"
            )
        for name in ("mass", "damping", "stiffness"):
            rows = getattr(self, name)
            if len(rows) != count or any(len(row) != count for row in rows):
                shape = " and ".join(str(len(row)) for row in rows)
                raise ValueError(
                    f"needs {name} with {count} rows and columns, one for each coordinate, got "
                    f"{len(rows)} rows of {shape}"
                )
            matrix = np.array(rows)
            if not np.allclose(matrix, matrix.T, rtol=SYMMETRY, atol=0.0):
                i, j = np.unravel_index(np.argmax(np.abs(matrix - matrix.T)), matrix.shape)
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
    def matrices(self) -> tuple[NDArray[np.float64], ...]:
        """Mass, damping and stiffness."""
        return tuple(np.array(rows) for rows in (self.mass, self.damping, self.stiffness))


SYMMETRY = 1e-9
"""Relative rounding error that matrices are granted."""


def _smallest_eigenvalue(matrix: NDArray[np.float64]) -> float:
    """Of D^-1/2 A D^-1/2 with D the diagonal of A: coordinates of any size count alike."""
    size = np.sqrt(np.abs(np.diag(matrix)))
    if np.any(matrix[size == 0.0]):
        return -1.0  # a zero on the diagonal of a matrix without negative eigenvalues is alone
    inverse = np.divide(1.0, size, out=np.zeros_like(size), where=size > 0.0)
    return float(np.linalg.eigvalsh(inverse[:, None] * matrix * inverse)[0])


Structure = Oscillator | Isolator | Matrices
"""Every structure that a scene may hold."""
