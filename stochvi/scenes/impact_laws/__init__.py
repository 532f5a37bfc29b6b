"""Impact laws: what happens when the mass meets a stop. A law is a class in `compliant.py`,
`rigid.py` or another file of this package; `Law` finds it there."""

from __future__ import annotations

import pkgutil
from collections.abc import Iterator
from importlib import import_module
from typing import Annotated, Any

from pydantic import BeforeValidator

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
from stochvi.scenes.validation import OneOf, kind_of

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


def _no_function(value: Any) -> Any:
    if callable(value):
        name = getattr(value, "__name__", type(value).__name__)
        raise ValueError(f"must be an impact law, got the function {name}; {ImpactLaw.own}")
    return value


def _laws(base: type[ImpactLaw] = ImpactLaw) -> Iterator[type[ImpactLaw]]:
    """Every class of laws that says its kind."""
    for each in base.__subclasses__():
        yield from _laws(each)
        if kind_of(each) is not None:
            yield each


for _module in pkgutil.iter_modules(__path__, f"{__name__}."):
    import_module(_module.name)

_one_of = OneOf(_laws(), "laws", (RigidLaw, CompliantLaw), usual="restitution")
Law = Annotated[ImpactLaw, _one_of, BeforeValidator(_no_function)]
"""Every law that a stop may follow."""
