"""Impulses at random times."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, ClassVar, Literal, Self

from stochvi.mathematics.units import power_ratio
from stochvi.scenes.excitations.base import BASE
from stochvi.scenes.excitations.drawn import DrawnExcitation
from stochvi.scenes.validation import Positive

MOST_IN_A_STEP = 100.0
"""Mean number of pulses in a step above which the step is shortened."""


class Pulses(DrawnExcitation):
    """Instantaneous impulses J at the times of a Poisson process, independent of each other.

    A mass m gains the velocity J / m at each. The force has the mean rate E J and, about it, the
    density of white noise of the intensity S0 = rate E J^2. The response of a linear structure has
    the cumulants kappa_n = rate E J^n int h(t)^n dt of its response h to a unit impulse (Campbell
    1909, Rice 1944).

    Parameters
    ----------
    rate
        Mean number of pulses per second.
    impulse
        Size of a pulse, N s on a mass, m/s of the base: of each, or the mean of exponential sizes,
        or the rms value of normal ones.
    sizes
        Distribution of the sizes: "equal", "normal" (absolute values of a normal number) or
        "exponential".
    two_sided
        Whether every pulse has either direction with equal probability; otherwise all act in the
        positive direction.

    See Also
    --------
    stochvi.WhiteNoise : The limit of many small pulses.

    Examples
    --------
    >>> gravel = Pulses(rate=20.0, impulse=0.1, sizes="exponential", two_sided=False)
    >>> round(gravel.mean, 12), round(gravel.si_intensity, 12)
    (2.0, 0.4)
    >>> [round(gravel.moment(n), 6) for n in (1, 2, 3, 4)]
    [0.1, 0.02, 0.006, 0.0024]
    """

    effect_word: ClassVar[str] = "pulses"
    family: ClassVar[str] = "pulses"
    white: ClassVar[bool] = True

    kind: Literal["pulses"] = "pulses"
    rate: Positive
    impulse: Positive
    sizes: Literal["equal", "normal", "exponential"] = "equal"
    two_sided: bool = True

    def moment(self, order: int) -> float:
        """Mean of the power `order` of a pulse, E J^n.

        Parameters
        ----------
        order
            n, from 1.

        Returns
        -------
        float
            (N s)^n, or (m/s)^n of the base.
        """
        if self.two_sided and order % 2:
            return 0.0
        n, relative = order, 1.0
        if self.sizes == "exponential":
            relative = math.gamma(n + 1.0)
        elif self.sizes == "normal":
            relative = 2.0 ** (n / 2.0) * math.gamma((n + 1.0) / 2.0) / math.sqrt(math.pi)
        return float(relative * self.impulse**n)

    @property
    def mean(self) -> float:
        """Mean force, rate E J, N, or acceleration of the base, m/s^2."""
        return self.rate * self.moment(1)

    @property
    def si_intensity(self) -> float:
        """S0 = rate E J^2, N^2 s or (m/s^2)^2 s."""
        return self.rate * self.moment(2)

    @property
    def fastest(self) -> float:
        return self.rate / MOST_IN_A_STEP

    @property
    def jump(self) -> float:
        return math.sqrt(self.moment(2))

    def compiled(self, mass: float) -> Any:
        from stochvi.engine.characteristics.pulses import (
            EqualPulses,
            ExponentialPulses,
            NormalPulses,
        )

        kinds = {"equal": EqualPulses, "normal": NormalPulses, "exponential": ExponentialPulses}
        return kinds[self.sizes](self.rate, self.impulse / mass, float(self.two_sided))

    def louder(self, level_db: float) -> Self:
        size = math.sqrt(power_ratio(level_db)) * self.impulse
        return self.model_copy(update={"impulse": size})

    def facts(self, where: str, numbers: Mapping[str, float]) -> list[tuple[str, ...]]:
        unit = "m/s" if where == BASE else "N s"
        sides = "in either direction" if self.two_sided else "in one direction"
        size = f"{self.rate:.4g} per second of {self.impulse:.4g} {unit}, {self.sizes} sizes"
        return [(f"Pulses on {where}", size, sides)]
