"""Distributions of the tolerances of a mount and of its stops between the units of a production."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from scipy.stats import norm, truncnorm, uniform

from stochvi.isolators.sizing.changes import Tolerances
from stochvi.mathematics.arrays import Vector
from stochvi.scenes.scene import Scene
from stochvi.scenes.structures.rigid_body import RigidBody

SMALLEST_RATIO = 0.05
"""Smallest value of a relative quantity over its stated value: a normal distribution is truncated
there, because no mount has a frequency of 0."""

UNITS = {
    "frequency": ("%", 0.01), "damping": ("%", 0.01), "level": ("dB", 1.0), "centre": ("mm", 1e-3),
    "clearance": ("mm", 1e-3), "stiffness": ("%", 0.01), "restitution": ("", 1.0),
}  # fmt: skip
"""Quantities that may vary between units, each with the unit in which it is spoken of, and that
unit in SI units."""

RELATIVE = ("frequency", "damping", "stiffness")
"""Quantities whose amounts are relative to what the scene states."""


@dataclass(frozen=True, kw_only=True)
class Spread:
    """Distribution of one quantity over the units of a production, about what the scene states.

    The amounts are those of `Tolerances`: relative for frequency, damping and the stiffness of the
    stops, and dB for the level. The centre of mass and the clearance of each stop are off by m, the
    restitution by a plain number. A normal distribution of a relative amount is truncated at -95 %.

    Parameters
    ----------
    std
        Standard deviation of a normal distribution.
    half_width
        Instead: half of the width of a uniform distribution.
    mean
        Mean over the production, where it is off what the scene states.

    See Also
    --------
    stochvi.isolators.production : The risk of the production.

    Examples
    --------
    >>> from stochvi.isolators import Spread
    >>> Spread(std=0.05).in_words("frequency"), Spread(half_width=1e-4).in_words("clearance")
    ('natural frequency normal, std 5 %', 'clearance of each stop uniform, ± 0.1 mm')
    """

    std: float | None = None
    half_width: float | None = None
    mean: float = 0.0

    def __post_init__(self) -> None:
        given = [each for each in (self.std, self.half_width) if each is not None]
        if len(given) != 1:
            raise ValueError(
                f"a spread must have exactly one of std and half_width, got {len(given)}; "
                "std is for a normal distribution, half_width for a uniform one"
            )
        if not 0.0 < given[0] < math.inf or not math.isfinite(self.mean):
            raise ValueError(
                "std or half_width must be positive, and mean finite, got "
                f"{given[0]:g} and {self.mean:g}"
            )

    def distribution(self, quantity: str) -> Any:
        """The distribution of the amount of a quantity, as scipy has it."""
        if self.half_width is not None:
            return uniform(self.mean - self.half_width, 2.0 * self.half_width)
        assert self.std is not None
        if quantity not in RELATIVE:
            return norm(self.mean, self.std)
        least = (SMALLEST_RATIO - 1.0 - self.mean) / self.std
        return truncnorm(least, math.inf, self.mean, self.std)

    def nodes(self, quantity: str, number: int) -> tuple[Vector, Vector]:
        """Nodes and weights of Gauss quadrature over the amount of a quantity."""
        if self.half_width is not None:
            place, weight = np.polynomial.legendre.leggauss(number)
            return self.mean + self.half_width * place, 0.5 * weight
        assert self.std is not None
        place, weight = np.polynomial.hermite_e.hermegauss(number)
        amounts = self.mean + self.std * place
        if quantity in RELATIVE and amounts[0] < SMALLEST_RATIO - 1.0:
            raise ValueError(
                f"nodes of {quantity} must stay above -95 %, got {100.0 * amounts[0]:.3g} %; give "
                "fewer nodes, or a smaller std"
            )
        return amounts, weight / math.sqrt(2.0 * math.pi)

    def in_words(self, quantity: str) -> str:
        """The distribution of a quantity, in words."""
        unit, size = UNITS[quantity]

        def spoken(value: float, form: str = ".3g") -> str:
            return f"{value / size:{form}} {unit}".strip()

        mean = f", mean {spoken(self.mean, '+.3g')}" if self.mean else ""
        if self.half_width is not None:
            return f"{NAMES[quantity]} uniform, ± {spoken(self.half_width)}{mean}"
        assert self.std is not None
        return f"{NAMES[quantity]} normal, std {spoken(self.std)}{mean}"


NAMES = {
    "frequency": "natural frequency", "damping": "damping ratio", "level": "level",
    "centre": "centre of mass along each axis", "clearance": "clearance of each stop",
    "stiffness": "stiffness of the stops", "restitution": "restitution",
}  # fmt: skip
"""The quantities in words."""


def check_spreads(scene: Scene, spreads: Mapping[str, Spread]) -> None:
    """Raise `ValueError` for quantities that do not exist, or that the scene cannot vary."""
    for name, spread in spreads.items():
        if name not in UNITS:
            raise ValueError(f"spreads must be of {', '.join(UNITS)}, got {name!r}")
        if not isinstance(spread, Spread):
            raise ValueError(
                f"the spread of {name} must be a Spread, as Spread(std=0.05), got {spread!r}"
            )
        lowest, _ = spread.distribution(name).support()
        if name in RELATIVE and lowest <= -1.0:
            raise ValueError(
                f"the spread of {name} must stay above -100 %, got {100.0 * lowest:.3g} %; give a "
                "smaller half_width"
            )
    if "centre" in spreads and not isinstance(scene.structure, RigidBody):
        raise ValueError(
            f"the spread of centre is that of structure.kind = 'rigid-body', got "
            f"{scene.structure.kind!r}"
        )


def bands_beside(scene: Scene, spreads: Mapping[str, Spread], **stated: Any) -> Tolerances:
    """The tolerances of a scene, and those stated, but for the quantities that have a spread."""
    given = {KEYS.get(name, name) for name in spreads}
    known = {each.name for each in fields(Tolerances)}
    return Tolerances.of(scene, **stated | dict.fromkeys(given & known, 0.0))


KEYS = {"level": "level_db"}
"""Fields of `Tolerances` that are not named as the quantity."""


def in_words(spreads: Mapping[str, Spread]) -> str:
    """All spreads in words."""
    return "; ".join(spread.in_words(name) for name, spread in spreads.items())
