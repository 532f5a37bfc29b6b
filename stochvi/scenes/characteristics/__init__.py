"""Springs and dampers that are functions. Each kind is a class in a file of this package, which
`Spring` and `Damper` find there."""

from __future__ import annotations

import pkgutil
from collections.abc import Iterator
from functools import reduce
from importlib import import_module
from operator import or_
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import BeforeValidator, Field

from stochvi.scenes.characteristics.base import Characteristic, DamperForce, SpringForce
from stochvi.scenes.characteristics.bouc_wen import BoucWen
from stochvi.scenes.characteristics.coulomb import Coulomb
from stochvi.scenes.characteristics.duffing import Duffing
from stochvi.scenes.characteristics.polynomials import PolynomialDamper, PolynomialSpring
from stochvi.scenes.characteristics.rayleigh import Rayleigh
from stochvi.scenes.characteristics.relay import Relay
from stochvi.scenes.characteristics.spring_function import SpringFunction
from stochvi.scenes.characteristics.spring_table import SpringTable
from stochvi.scenes.characteristics.van_der_pol import VanDerPol

__all__ = [
    "BoucWen",
    "Characteristic",
    "Coulomb",
    "Damper",
    "Duffing",
    "PolynomialDamper",
    "PolynomialSpring",
    "Rayleigh",
    "Relay",
    "Spring",
    "SpringFunction",
    "SpringTable",
    "VanDerPol",
]


def _kinds(base: type[Characteristic]) -> Iterator[type[Characteristic]]:
    """Every class that says its kind."""
    for each in base.__subclasses__():
        yield from _kinds(each)
        if isinstance(getattr(each.model_fields.get("kind"), "default", None), str):
            yield each


def _listed(value: Any) -> Any:
    """One part as a list of one; a plain function as a `SpringFunction`."""
    values = value if isinstance(value, list | tuple) else [value]
    return tuple(SpringFunction(force=each) if callable(each) else each for each in values)


for _module in pkgutil.iter_modules(__path__, f"{__name__}."):
    import_module(_module.name)

if TYPE_CHECKING:
    Spring = tuple[Characteristic, ...]
    Damper = tuple[Characteristic, ...]
else:

    def _any_of(base: type[Characteristic]) -> Any:
        one = Annotated[reduce(or_, _kinds(base)), Field(discriminator="kind")]
        return Annotated[tuple[one, ...], BeforeValidator(_listed), Field(min_length=1)]

    Spring = _any_of(SpringForce)
    """Springs that are functions: one of them, or a list."""

    Damper = _any_of(DamperForce)
    """Dampers that are functions: one of them, or a list."""
