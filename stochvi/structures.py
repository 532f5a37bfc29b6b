"""The linear structure that moves between the stops: m x'' + c x' + k x = force."""

from __future__ import annotations

import math
from typing import Literal, Self

from pydantic import model_validator

from stochvi.checked import Checked, NonNegative, Positive, given


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
    def omega(self) -> float:
        """Undamped natural frequency, rad/s; 0 without a spring."""
        if self.frequency_hz is not None:
            return 2.0 * math.pi * self.frequency_hz
        assert self.stiffness is not None and self.mass is not None
        return math.sqrt(self.stiffness / self.mass)

    @property
    def damping_rate(self) -> float:
        """b = c / m = 2 zeta omega, 1/s."""
        if self.damping is not None:
            assert self.mass is not None
            return self.damping / self.mass
        zeta = self.zeta if self.Q is None else 0.5 / self.Q
        assert zeta is not None
        return 2.0 * zeta * self.omega


class Isolator(Oscillator):
    """An oscillator on a moving base; x is the displacement relative to the base.

    x'' + b x' + omega^2 x = -a_base(t); the absolute acceleration of the mass between
    impacts is -(b x' + omega^2 x).

    Examples
    --------
    >>> Isolator(frequency_hz=12.0, zeta=0.1).kind
    'isolator'
    """

    kind: Literal["isolator"] = "isolator"  # type: ignore[assignment]


Structure = Oscillator | Isolator
"""Every structure that a scene may hold."""
