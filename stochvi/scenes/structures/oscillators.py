"""One mass on a spring and a damper.

Its motion is m x'' + c x' + k x = force. With a damping force c(x') and a restoring force g(x) it
is m x'' + c + g = force.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Annotated, ClassVar, Literal, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field, model_validator

from stochvi.mathematics.arrays import Vector
from stochvi.mathematics.units import STANDARD_GRAVITY
from stochvi.scenes.between_units import Mean, VariedNonNegative, VariedPositive
from stochvi.scenes.integrals import integral_of
from stochvi.scenes.structures.base import AnyStructure
from stochvi.scenes.validation import (
    Count,
    Function,
    NonNegative,
    Positive,
    Tolerance,
    check_values,
    evaluated,
    given,
)

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
