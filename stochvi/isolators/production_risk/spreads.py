"""Distributions of the tolerances of a mount and of its stops between the units of a production."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from stochvi.isolators.sizing.changes import Tolerances
from stochvi.mathematics.arrays import Matrix, Vector
from stochvi.scenes.between_units import BetweenUnits, varied
from stochvi.scenes.scene import Scene
from stochvi.scenes.structures.rigid_body import RigidBody

SMALLEST_RATIO = 0.05
"""Smallest value of a frequency or stiffness over its stated value: a normal distribution is
truncated there, because no mount has a frequency of 0. That of a damping ratio is truncated at 0:
a mount with hardly any damping is hit, and counts."""

SEEN = -6.5
"""Standard deviations from which a truncation is told: the normal distribution has 4e-11 below."""

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
    restitution by a plain number. A normal distribution of a relative amount is truncated at -95 %,
    that of the damping at -100 %: there are no units beyond.

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
        from scipy.stats import norm, truncnorm, uniform

        if self.half_width is not None:
            return uniform(self.mean - self.half_width, 2.0 * self.half_width)
        assert self.std is not None
        if quantity_of(quantity) not in RELATIVE:
            return norm(self.mean, self.std)
        return truncnorm(self._least(quantity), math.inf, self.mean, self.std)

    def _least(self, quantity: str) -> float:
        """Where the distribution of a relative amount is truncated, in standard deviations."""
        smallest = 0.0 if quantity_of(quantity) == "damping" else SMALLEST_RATIO
        return (smallest - 1.0 - self.mean) / (self.std or math.inf)

    def nodes(self, quantity: str, number: int) -> tuple[Vector, Vector]:
        """Nodes and weights of Gauss quadrature over the amount of a quantity."""
        if self.half_width is not None:
            place, weight = np.polynomial.legendre.leggauss(number)
            return self.mean + self.half_width * place, 0.5 * weight
        assert self.std is not None
        place, weight = np.polynomial.hermite_e.hermegauss(number)
        amounts = self.mean + self.std * place
        if quantity_of(quantity) in RELATIVE and amounts[0] < SMALLEST_RATIO - 1.0:
            raise ValueError(
                f"nodes of {quantity} must stay above -95 %, got {100.0 * amounts[0]:.3g} %; give "
                "fewer nodes, or a smaller std"
            )
        return amounts, weight / math.sqrt(2.0 * math.pi)

    def polynomials(self, number: int) -> Matrix:
        """Orthonormal polynomials (degree, node) of the distribution at its `nodes`."""
        if self.half_width is not None:
            place, _ = np.polynomial.legendre.leggauss(number)
            size = [math.sqrt(2.0 * k + 1.0) for k in range(number)]
            return np.array(np.polynomial.legendre.legvander(place, number - 1) * size).T
        place, _ = np.polynomial.hermite_e.hermegauss(number)
        size = [1.0 / math.sqrt(math.factorial(k)) for k in range(number)]
        return np.array(np.polynomial.hermite_e.hermevander(place, number - 1) * size).T

    def in_words(self, quantity: str) -> str:
        """The distribution of a quantity, in words."""
        unit, size = UNITS[quantity_of(quantity)]

        def spoken(value: float, form: str = ".3g") -> str:
            return f"{value / size:{form}} {unit}".strip()

        mean = f", mean {spoken(self.mean, '+.3g')}" if self.mean else ""
        if self.half_width is not None:
            return f"{name_of(quantity)} uniform, ± {spoken(self.half_width)}{mean}"
        assert self.std is not None
        cut = ""
        if quantity_of(quantity) in RELATIVE and self._least(quantity) > SEEN:
            cut = ", truncated at "
            cut += "0" if quantity_of(quantity) == "damping" else f"{SMALLEST_RATIO:.0%} of it"
        return f"{name_of(quantity)} normal, std {spoken(self.std)}{mean}{cut}"


NAMES = {
    "frequency": "natural frequency", "damping": "damping ratio", "level": "level",
    "centre": "centre of mass along each axis", "clearance": "clearance of each stop",
    "stiffness": "stiffness of the stops", "restitution": "restitution",
}  # fmt: skip
"""The quantities in words."""


def quantity_of(name: str) -> str:
    """The quantity of a spread, which may be that of one stop or law alone.

    >>> quantity_of("clearance"), quantity_of("clearance upper stops")
    ('clearance', 'clearance')
    """
    return name.partition(" ")[0]


def name_of(name: str) -> str:
    """The quantity of a spread in words, with its stop or law where it is that of one alone."""
    quantity, _, place = name.partition(" ")
    return NAMES[name] if not place else f"{quantity} of {place}"


STATED_AS = {
    "frequency_hz": "frequency", "zeta": "damping", "damping": "damping", "lower": "clearance",
    "upper": "clearance", "stiffness": "stiffness",
}  # fmt: skip
"""Keys of a scene that may differ between units, each with the quantity that it states."""


def spreads_of(scene: Scene) -> dict[str, Spread]:
    """The distributions between units that a scene states, by quantity, and for a stop or a law by
    its name as well."""
    return {_name(scene, key): _spread(key, each) for key, each in varied(scene)}


def _name(scene: Scene, key: str) -> str:
    """Name of the spread of a key, such as "impact_pair.0.upper"."""
    way = key.split(".")
    quantity = STATED_AS[way[-1]]
    if way[0] != "impact_pair":
        return quantity
    pair = scene.impact_pairs[int(way[1])].name
    side = way[2].removesuffix("law").rstrip("_")  # a law without a side is that of both stops
    return " ".join(filter(None, [quantity, side, pair]))


def _spread(key: str, stated: BetweenUnits) -> Spread:
    name = STATED_AS[key.rpartition(".")[2]]
    unit = stated.mean if name in RELATIVE else 1.0
    width = "std" if stated.std is not None else "half_width"
    return Spread(**{width: getattr(stated, width) / unit})


def spreads_beside(
    scene: Scene, spreads: Mapping[str, Spread], limits: Iterable[str] = ()
) -> dict[str, Spread]:
    """The spreads of a scene and those stated, which take the place of the former where they are of
    the same quantity. So do limits of a quantity."""
    stated = {*map(quantity_of, spreads), *limits}
    own = spreads_of(scene).items()
    return {name: each for name, each in own if quantity_of(name) not in stated} | dict(spreads)


def check_spreads(scene: Scene, spreads: Mapping[str, Spread]) -> None:
    """Raise `ValueError` for quantities that do not exist, or that the scene cannot vary."""
    own = spreads_of(scene)
    for name, spread in spreads.items():
        if name not in UNITS and name not in own:
            raise ValueError(f"spreads must be of {', '.join(UNITS)}, got {name!r}")
        if not isinstance(spread, Spread):
            raise ValueError(
                f"the spread of {name} must be a Spread, as Spread(std=0.05), got {spread!r}"
            )
        lowest, _ = spread.distribution(name).support()
        uniform = spread.half_width is not None
        if quantity_of(name) in RELATIVE and uniform and lowest <= -1.0:
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
    given = {KEYS.get(name, name) for name in map(quantity_of, spreads)}
    known = {each.name for each in fields(Tolerances)}
    return Tolerances.of(scene, **stated | dict.fromkeys(given & known, 0.0))


KEYS = {"level": "level_db"}
"""Fields of `Tolerances` that are not named as the quantity."""


def in_words(spreads: Mapping[str, Spread]) -> str:
    """All spreads in words."""
    return "; ".join(spread.in_words(name) for name, spread in spreads.items())
