"""A constant load."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar, Literal, Self

from pydantic import model_validator

from stochvi.scenes.excitations.base import BASE, BaseExcitation
from stochvi.scenes.validation import Number, given


class ConstantLoad(BaseExcitation):
    """A constant force on the mass (N), or a constant acceleration of the base (m/s^2).

    Gravity that pulls towards negative x is `force = -m g`, or `acceleration = 9.80665` of the
    base. If clearances are measured from where the mass hangs, leave gravity out.

    Parameters
    ----------
    force
        Force on a mass, N.
    acceleration
        Acceleration of the base, m/s^2.

    See Also
    --------
    stochvi.Scene : The scene that holds it.

    Examples
    --------
    >>> ConstantLoad(force=-9.80665).magnitude
    -9.80665
    """

    effect_word: ClassVar[str] = "constant load"
    family: ClassVar[str] = "constant load"
    shakes: ClassVar[bool] = False

    kind: Literal["constant"] = "constant"
    on: str | None = None
    force: Number | None = None
    acceleration: Number | None = None

    @model_validator(mode="after")
    def _one_load(self) -> Self:
        if (self.force is None) == (self.acceleration is None):
            raise ValueError(
                "needs exactly one of force (N) and acceleration (m/s^2 of the base), "
                f"got {given(self, 'force', 'acceleration')}"
            )
        if self.on is not None and (self.on == BASE) != (self.acceleration is not None):
            raise ValueError(
                "takes force on a coordinate and acceleration with on = 'base', "
                f"got on = {self.on!r}"
            )
        return self

    @property
    def magnitude(self) -> float:
        """Newtons on a mass, or m/s^2 of the base."""
        value = self.force if self.force is not None else self.acceleration
        assert value is not None and math.isfinite(value)
        return value

    def louder(self, level_db: float) -> Self:
        return self

    def facts(self, where: str, numbers: Mapping[str, float]) -> list[tuple[str, ...]]:
        unit = "m/s²" if where == BASE else "N"
        return [(f"Constant load on {where}", f"{self.magnitude:.4g} {unit}")]
