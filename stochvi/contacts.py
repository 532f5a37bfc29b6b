"""Impact laws: what happens when the mass meets a stop."""

from __future__ import annotations

from typing import Literal

from pydantic import field_validator

from stochvi.checked import Checked, Number


class Restitution(Checked):
    """Newton's law of impact on a rigid stop, v+ = -R v-, 0 <= R <= 1 (B section 1).

    Parameters
    ----------
    coefficient
        The restitution R; 1 loses nothing, 0 loses all of the normal velocity. The energy
        lost in one impact of incident speed w is (1 - R^2) m w^2 / 2.

    Examples
    --------
    >>> Restitution(coefficient=0.8).coefficient
    0.8
    """

    kind: Literal["restitution"] = "restitution"
    coefficient: Number

    @field_validator("coefficient")
    @classmethod
    def _between_nothing_and_all(cls, value: float) -> float:
        if not 0.0 <= value <= 1.0:
            raise ValueError(f"must be in [0, 1], got {value:g}")
        return value


Law = Restitution
"""Every law that a stop may follow."""
