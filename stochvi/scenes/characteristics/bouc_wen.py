"""Hysteresis of Bouc and Wen: wire rope, joints that slip, metal that yields."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field

from stochvi.mathematics.arrays import Vector
from stochvi.mathematics.quadrature import gauss_panels
from stochvi.scenes.characteristics.base import LinearForm, SpringForce
from stochvi.scenes.validation import Number, Positive


class BoucWen(SpringForce):
    """A spring with hysteresis, F = stiffness length z, with the length the yield displacement.

    The memory z follows the displacement x,

        length dz/dx = 1 - (gamma + beta sign(z dx)) abs(z)^exponent,    gamma = 1 - beta,

    so that abs(z) stays below 1. The loop turns where the motion turns, whatever its speed. Beside
    a linear spring it is a wire-rope mount: stiff in small motions, soft in large ones.

    Parameters
    ----------
    stiffness
        Stiffness in small motions, N/m, which adds to that of the structure.
    yield_displacement
        Displacement at which the force of a straight line would reach its largest value, m.
    exponent
        How sharply the force bends; by default 1. A large one yields like metal.
    beta
        Share of the hysteresis, from above 0 to 1; by default 0.5. With 0.5 unloading begins with
        the full stiffness.
    on, between, axis
        Where it acts: on a coordinate or point, between two, or along an axis of the mounts of a
        box.

    See Also
    --------
    stochvi.scenes.Coulomb : Friction alone.

    Examples
    --------
    >>> rope = BoucWen(stiffness=1e4, yield_displacement=1e-3)
    >>> rope.largest_force
    10.0
    >>> [round(1e3 * rope.loop_loss(amplitude), 2) for amplitude in (1e-4, 1e-2)]
    [0.17, 349.9]
    """

    word: ClassVar[str] = "Bouc-Wen"
    remembers: ClassVar[bool] = True

    kind: Literal["bouc-wen"] = "bouc-wen"
    stiffness: Positive
    yield_displacement: Positive
    exponent: Annotated[Number, Field(ge=1, le=20)] = 1.0
    beta: Annotated[Number, Field(gt=0, le=1)] = 0.5

    @property
    def needs(self) -> str:
        return "both"

    @property
    def largest_force(self) -> float:
        """Largest force, N."""
        return self.stiffness * self.yield_displacement

    def force_at(self, displacement: ArrayLike, velocity: ArrayLike = 0.0) -> Vector:
        """Force on the first loading from rest, N; the force of later times depends on the past."""
        x = np.asarray(displacement, float)
        ways, branch = self.virgin_curve(float(np.max(np.abs(x), initial=0.0)))
        return np.asarray(self.largest_force * np.sign(x) * np.interp(np.abs(x), ways, branch))

    def virgin_curve(self, largest: float) -> tuple[Vector, Vector]:
        """Displacements from 0 to `largest`, m, and the memory z on the first loading."""
        ways = np.linspace(0.0, largest, LOOP_POINTS)
        return ways, self._along(0.0, ways)

    def _along(self, z: float, ways: Vector) -> Vector:
        """The memory along a way in the positive direction, m, by the method of Runge and Kutta."""
        n, beta, found = self.exponent, self.beta, [z]

        def slope(z: float) -> float:
            share = 1.0 if z > 0.0 else 1.0 - 2.0 * beta
            return float(1.0 - share * abs(z) ** n)

        for way in (np.diff(ways) / self.yield_displacement).tolist():
            count = math.ceil(way / LONGEST_WAY)
            step = way / max(count, 1)
            for _ in range(count):
                a = slope(z)
                b = slope(z + 0.5 * step * a)
                c = slope(z + 0.5 * step * b)
                z += step * (a + 2.0 * (b + c) + slope(z + step * c)) / 6.0
            found.append(z)
        return np.array(found)

    def loop_loss(self, amplitude: float) -> float:
        """Energy, J, that a cycle between -amplitude and amplitude (m) takes."""
        ways = np.linspace(-amplitude, amplitude, LOOP_POINTS)
        z = 0.0
        for _ in range(LOOPS):  # up and down are the same loop with the opposite sign
            z = -float(self._along(z, ways)[-1])
        branch = self._along(z, ways)
        area = float(np.sum((branch[1:] + branch[:-1]) / 2.0 * np.diff(ways)))
        return 2.0 * self.largest_force * area

    def linear_form(self, mean: float, deviation: float, speed: float) -> LinearForm:
        """The secant stiffness and the damper that take as much from a Gaussian motion, roughly:
        those of the loop of a cycle with the amplitude sqrt(2) deviation."""
        amplitude = math.sqrt(2.0) * deviation
        ways = np.linspace(-amplitude, amplitude, LOOP_POINTS)
        z = 0.0
        for _ in range(LOOPS):
            z = -float(self._along(z, ways)[-1])
        branch = self._along(z, ways)
        loss = float(np.sum((branch[1:] + branch[:-1]) / 2.0 * np.diff(ways)))
        # first harmonic of z over x = -a cos(t): in phase, and with the velocity
        phase = np.arccos(np.clip(-ways / amplitude, -1.0, 1.0))
        inner = branch * -np.cos(phase)
        secant = 2.0 / math.pi * float(np.sum((inner[1:] + inner[:-1]) / 2.0 * np.diff(phase)))
        frequency = speed / deviation
        stiffness = self.largest_force * secant / amplitude
        return LinearForm(
            0.0, stiffness, 2.0 * self.largest_force * loss / (math.pi * frequency * amplitude**2)
        )

    @property
    def widest_memory(self) -> float:
        """Standard deviation of a Gaussian memory whose mean of abs(z)^exponent is 1."""
        n = self.exponent
        moment = 2.0 ** (n / 2.0) * math.gamma((n + 1.0) / 2.0) / math.sqrt(math.pi)
        return float(moment ** (-1.0 / n))

    def wen_coefficients(
        self, speed: float, deviation: float, correlation: float
    ) -> tuple[float, float]:
        """Coefficients C, 1/m, and D, 1/s, of z' = C v + D z, statistically linearised in closed
        form (Wen, J. Appl. Mech. 47, 150, 1980).

        Parameters
        ----------
        speed, deviation, correlation
            Standard deviations of v, m/s, and of z, and their correlation.
        """
        n, length = self.exponent, self.yield_displacement
        lag = math.sqrt(1.0 - correlation**2)
        angles, weights = gauss_panels(np.array([math.atan2(lag, correlation), math.pi / 2.0]), 32)
        inner = 2.0 * float(weights @ np.sin(angles) ** n)
        odd = math.gamma(n / 2.0 + 1.0) * 2.0 ** (n / 2.0) / math.pi
        even = math.gamma((n + 1.0) / 2.0) * 2.0 ** (n / 2.0) / math.sqrt(math.pi)
        rate = n * speed / length * deviation ** (n - 1.0)
        gamma = 1.0 - self.beta
        with_v = 1.0 - deviation**n * (self.beta * odd * inner + gamma * even)
        with_z = self.beta * odd * (2.0 * lag ** (n + 1.0) / n + correlation * inner)
        return with_v / length, -rate * (with_z + gamma * even * correlation)

    def stiffest(self, mean: float, deviation: float) -> float:
        return self.stiffness

    def most_damping(self, mean: float, speed: float) -> float:
        return 0.0

    @property
    def strengths(self) -> Sequence[float]:
        return self.stiffness, self.yield_displacement

    def compiled(self, mass: float) -> Any:
        from stochvi.engine.characteristics.bouc_wen import BoucWen as Compiled

        return Compiled(
            self.largest_force / mass, self.yield_displacement, self.exponent, self.beta
        )


LOOP_POINTS, LOOPS = 81, 8
"""Points of half a loop, and half loops after which it closes."""

LONGEST_WAY = 0.5
"""Longest step along a loop, in yield displacements."""
