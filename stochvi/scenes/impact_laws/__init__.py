"""Impact laws: what happens when the mass meets a stop. Each law is a file; `Law` lists them."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated, Any

from pydantic import BeforeValidator, Discriminator, Tag

from stochvi.scenes.impact_laws.base import CompliantLaw, ImpactLaw
from stochvi.scenes.impact_laws.force_table import ForceTable
from stochvi.scenes.impact_laws.hertz import Hertz
from stochvi.scenes.impact_laws.rigid import Restitution, SpeedRestitution
from stochvi.scenes.impact_laws.viscoelastic import Elastic, Viscoelastic

__all__ = [
    "CompliantLaw",
    "Elastic",
    "ForceTable",
    "Hertz",
    "Law",
    "Restitution",
    "SpeedRestitution",
    "Viscoelastic",
    "not_rigid",
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


def not_rigid(stops: Iterable[tuple[str, Law]]) -> list[str]:
    """The unmet conditions of a method that needs rigid stops; `stops` are pairs (side, law)."""
    return [
        f"stops must be rigid (law.kind = 'restitution'), got {law.kind!r} at the {side} stop"
        for side, law in stops
        if not law.rigid
    ]


Law = Annotated[
    Annotated[Restitution, Tag("restitution")]
    | Annotated[SpeedRestitution, Tag("speed-restitution")]
    | Annotated[Elastic, Tag("elastic")]
    | Annotated[Viscoelastic, Tag("viscoelastic")]
    | Annotated[Hertz, Tag("hertz")]
    | Annotated[ForceTable, Tag("table")],
    Discriminator(_kind),
    BeforeValidator(_no_function),
]
"""Every law that a stop may follow."""
