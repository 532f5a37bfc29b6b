"""Vehicles between a road and a mount: a quarter car as a linear filter of the road.

With the displacements x of body and wheel and z of the road, and the masses m of both

    M x'' + C x' + K x = (0, k_t z + c_t z')        H(w) = (K - w^2 M + i w C)^-1 (0, k_t + i w c_t)

so that the acceleration of body or wheel has the density |H|^2 times that of the road. The mount is
taken to weigh nothing against the body: it does not act back on the vehicle.
"""

from __future__ import annotations

import math
from typing import Literal, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import model_validator

from stochvi.mathematics.arrays import Matrix
from stochvi.mathematics.spectra import Table, refined_table
from stochvi.scenes.validation import Checked, NonNegative, Positive, given


class Preset(NamedTuple):
    """A quarter car per kilogram of its body (SI units), and where its numbers come from."""

    wheel_mass: float
    suspension_stiffness: float
    suspension_damping: float
    tyre_stiffness: float
    source: str


PRESETS = {
    "golden-car": Preset(
        0.15, 63.3, 6.0, 653.0,
        "the golden car of the International Roughness Index: Sayers, On the calculation of "
        "International Roughness Index from longitudinal road profile, Transportation Research "
        "Record 1501, 1995",
    ),
}  # fmt: skip
"""Known vehicles by name."""

OWN_KEYS = ("wheel_mass", "suspension_stiffness", "suspension_damping", "tyre_stiffness")
"""Keys that a vehicle without a preset needs in addition to `body_mass`."""


class VehicleMode(NamedTuple):
    """A mode of a quarter car: natural frequency, Hz, and damping ratio."""

    frequency_hz: float
    damping_ratio: float


class QuarterCar(Checked):
    """A quarter of a car between road and mount: body and wheel, suspension and tyre.

    The base of the mount is the body, or the wheel. The tyre touches the road in one point and
    never leaves it. The mount does not act back on the vehicle. This holds if the mounted mass is
    small against that of the body or wheel below it; otherwise model the mounted mass, body and
    wheel together as a structure of kind `matrices`.

    Parameters
    ----------
    kind
        "quarter-car".
    preset
        Name of a known vehicle (`PRESETS`); `body_mass` may be given beside it.
    body_mass, wheel_mass
        Masses, kg.
    suspension_stiffness, suspension_damping
        Spring (N/m) and damper (N s/m) between body and wheel.
    tyre_stiffness, tyre_damping
        Spring (N/m) and damper (N s/m) between wheel and road.
    mounted_on
        Part of the vehicle that is the base of the mount: "body" or "wheel".

    See Also
    --------
    stochvi.RoadNoise : What shakes the vehicle.

    Examples
    --------
    >>> golden = QuarterCar(preset="golden-car")
    >>> [round(mode.frequency_hz, 2) for mode in golden.modes]
    [1.24, 10.76]
    >>> round(float(np.abs(golden.gain(0.0))), 12)
    1.0
    """

    kind: Literal["quarter-car"] = "quarter-car"
    preset: Literal["golden-car"] | None = None
    body_mass: Positive | None = None
    wheel_mass: Positive | None = None
    suspension_stiffness: Positive | None = None
    suspension_damping: Positive | None = None
    tyre_stiffness: Positive | None = None
    tyre_damping: NonNegative | None = None
    mounted_on: Literal["body", "wheel"] = "body"

    @model_validator(mode="after")
    def _whole(self) -> Self:
        if self.preset is not None:
            if (extra := given(self, *OWN_KEYS, "tyre_damping")) != "none":
                raise ValueError(
                    f"takes a preset, or parameters of its own, got preset with {extra}; only "
                    "body_mass may stand beside a preset"
                )
        elif missing := [key for key in ("body_mass", *OWN_KEYS) if getattr(self, key) is None]:
            raise ValueError(
                f"needs {', '.join(missing)}, or preset = one of {', '.join(map(repr, PRESETS))}"
            )
        return self

    @property
    def matrices(self) -> tuple[Matrix, Matrix, Matrix]:
        """Mass, damping and stiffness of body and wheel (2, 2), relative to the road."""
        if self.preset is not None:
            known, body = PRESETS[self.preset], self.body_mass or 1.0
            wheel, k, c, tyre = (body * each for each in known[:4])
        else:
            values = (self.body_mass, *(getattr(self, key) for key in OWN_KEYS))
            body, wheel, k, c, tyre = (float(value or 0.0) for value in values)
        tyre_damping = self.tyre_damping or 0.0
        between = np.array([[1.0, -1.0], [-1.0, 1.0]])
        on_wheel = np.diag([0.0, 1.0])
        mass = np.diag([body, wheel])
        return mass, c * between + tyre_damping * on_wheel, k * between + tyre * on_wheel

    @property
    def modes(self) -> tuple[VehicleMode, VehicleMode]:
        """Body and wheel hop, by frequency: |s| / 2 pi and -Re s / |s| of the eigenvalues s of the
        damped motion; where two of them are real, of the geometric and the arithmetic mean."""
        mass, damping, stiffness = self.matrices
        inverse = np.linalg.inv(mass)
        zero, one = np.zeros((2, 2)), np.eye(2)
        values = np.linalg.eigvals(
            np.block([[zero, one], [-inverse @ stiffness, -inverse @ damping]])
        ).astype(complex)
        swinging = [(s.real, abs(s)) for s in values if s.imag > 0.0]
        creeping = np.sort([s.real for s in values if s.imag == 0.0])
        swinging += [
            ((fast + slow) / 2.0, math.sqrt(fast * slow)) for fast, slow in creeping.reshape(-1, 2)
        ]
        body, wheel = sorted(
            VehicleMode(float(size) / (2.0 * math.pi), float(-decay / size))
            for decay, size in swinging
        )
        return body, wheel

    def gain(self, frequency_hz: ArrayLike) -> NDArray[np.complex128]:
        """Complex ratio of the motion of body or wheel to that of the road, at frequencies in Hz;
        the same for displacements and accelerations."""
        mass, damping, stiffness = self.matrices
        s = 2j * np.pi * np.asarray(frequency_hz, dtype=float)
        (a, b), (_, d) = ((entry for entry in row) for row in _entries(s, mass, damping, stiffness))
        road = stiffness.sum() + s * damping.sum()  # what is left of both is the tyre
        moved = (-b if self.mounted_on == "body" else a) * road
        return np.asarray(moved / (a * d - b * b))

    def passed(self, road: Table) -> Table:
        """Density of the acceleration of body or wheel from that of the road, one-sided.

        The breakpoints lie so close that log-log interpolation is off by `TABLE_ERROR` at most.
        """
        return refined_table(lambda f: road(f) * np.abs(self.gain(f)) ** 2, road.frequency_hz)

    def assumptions(self) -> tuple[str, ...]:
        """The assumptions about the vehicle, in words."""
        body, wheel = self.modes
        which = "of its own parameters" if self.preset is None else PRESETS[self.preset].source
        return (
            f"the mount stands on the {self.mounted_on} of a quarter car ({which}): body at "
            f"{body.frequency_hz:.3g} Hz, damping ratio {body.damping_ratio:.2g}, wheel hop at "
            f"{wheel.frequency_hz:.3g} Hz, damping ratio {wheel.damping_ratio:.2g}; linear, the "
            "tyre touches the road in one point and never leaves it",
        )

    def reaction(self, mounted_mass: float | None) -> str:
        """The assumption that the mount does not act back on the vehicle, with the ratio of masses.

        Parameters
        ----------
        mounted_mass
            Mass of all that stands on the vehicle, kg; None if it is not known.
        """
        sentence = "the mount does not act back on the vehicle"
        carrier = float(self.matrices[0][0 if self.mounted_on == "body" else 1].sum())
        if mounted_mass is None or self.body_mass is None:
            return (
                f"{sentence}: its mass is taken to be small against that of the {self.mounted_on} "
                "(give structure.mass and vehicle.body_mass to see their ratio)"
            )
        return (
            f"{sentence}: its mass is {100.0 * mounted_mass / carrier:.2g} % of that of the "
            f"{self.mounted_on}"
        )


def _entries(
    s: NDArray[np.complex128], mass: Matrix, damping: Matrix, stiffness: Matrix
) -> list[list[NDArray[np.complex128]]]:
    """Entries of M s^2 + C s + K, each of the shape of s."""
    return [
        [mass[i, j] * s**2 + damping[i, j] * s + stiffness[i, j] for j in range(2)]
        for i in range(2)
    ]
