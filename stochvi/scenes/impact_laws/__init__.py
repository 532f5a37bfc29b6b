"""Impact laws: what happens when the mass meets a stop. A law is a class in a file of this package,
which `Law` finds there."""

from __future__ import annotations

import pkgutil
from collections.abc import Iterator
from functools import reduce
from importlib import import_module
from operator import or_
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import BeforeValidator, Discriminator, Tag

from stochvi.scenes.impact_laws.compliant import (
    CompliantLaw,
    Elastic,
    ForceFunction,
    ForceTable,
    Hertz,
    ImpactLaw,
    PowerLaw,
    RigidLaw,
    Viscoelastic,
)
from stochvi.scenes.impact_laws.rigid import Restitution, SpeedRestitution

__all__ = [
    "CompliantLaw",
    "Elastic",
    "ForceFunction",
    "ForceTable",
    "Hertz",
    "ImpactLaw",
    "Law",
    "PowerLaw",
    "Restitution",
    "RigidLaw",
    "SpeedRestitution",
    "Viscoelastic",
]


def _kind(value: Any) -> str:
    """The kind that a law states; "restitution" if it states none."""
    kind = value.get("kind", "restitution") if isinstance(value, dict) else None
    return str(getattr(value, "kind", "restitution") if kind is None else kind)


def _no_function(value: Any) -> Any:
    if callable(value):
        name = getattr(value, "__name__", type(value).__name__)
        raise ValueError(f"must be an impact law, got the function {name}; {ImpactLaw.own}")
    return value


def _laws(base: type[ImpactLaw] = ImpactLaw) -> Iterator[type[ImpactLaw]]:
    """Every class of laws that says its kind."""
    for each in base.__subclasses__():
        yield from _laws(each)
        if isinstance(getattr(each.model_fields.get("kind"), "default", None), str):
            yield each


for _module in pkgutil.iter_modules(__path__, f"{__name__}."):
    import_module(_module.name)

if TYPE_CHECKING:
    Law = ImpactLaw
else:
    _tagged = [Annotated[each, Tag(each.model_fields["kind"].default)] for each in _laws()]
    Law = Annotated[reduce(or_, _tagged), Discriminator(_kind), BeforeValidator(_no_function)]
    """Every law that a stop may follow."""
