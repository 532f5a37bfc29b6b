"""The option --tolerances: limits of quantities, and distributions between units."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from stochvi.isolators.production_risk.spreads import Spread
    from stochvi.isolators.sizing.changes import Tolerances
    from stochvi.scenes.scene import Scene

WIDTHS = {"normal": "std", "uniform": "half_width"}
"""Distributions between units, each with the parameter of `Spread` for its width."""

WANTED = (
    "--tolerances must be usual, or frequency=10%,damping=30%,level=3dB,stiffness=20%,centre=5mm "
    "or some of these; or distributions, as frequency=normal:3%,clearance=uniform:0.1mm, with a "
    "mean as normal:3%:+1%"
)
"""What the option takes, in words."""


def tolerances_of(scene: Scene, text: str | None) -> tuple[Tolerances | None, dict[str, Spread]]:
    """Return the limits and the distributions that a text states, beside those of the scene.

    A text is "usual", or "frequency=normal:5%,level=2dB". Quantities that it leaves out keep the
    distributions that the scene states. None stands for a command without the option: there are no
    limits, and all distributions are those of the scene.
    """
    from stochvi.scenes.between_units import varied

    if text is None and not any(varied(scene)):
        return None, {}
    from stochvi.isolators.production_risk.spreads import (
        KEYS,
        UNITS,
        Spread,
        bands_beside,
        spreads_beside,
        spreads_of,
    )

    if text is None:
        return None, spreads_of(scene)
    limits: dict[str, float] = {}
    spreads: dict[str, Spread] = {}
    parts = [part.strip() for part in text.split(",")]
    for part in parts:
        if part == "usual":
            continue
        name, _, words = (each.strip() for each in part.partition("="))
        kind, *numbers = words.split(":") if ":" in words else ("", words)
        try:
            unit, size = UNITS[name]
            width, *mean = (size * float(each.strip().removesuffix(unit)) for each in numbers)
            if kind:
                (offset,) = mean or [0.0]
                spreads[name] = Spread(**{WIDTHS[kind.strip()]: width, "mean": offset})
            else:
                limits[KEYS.get(name, name)] = width
        except (KeyError, ValueError):
            raise ValueError(f"{WANTED}, got {part!r}") from None
    if beyond := limits.keys() & {"clearance", "restitution"}:
        raise ValueError(
            f"the tolerance of {min(beyond)} must be a distribution, as normal:0.1 or uniform:0.1; "
            "add a limit of the clearance to the answer"
        )
    spreads = spreads_beside(scene, spreads, limits)
    return bands_beside(scene, spreads, usual="usual" in parts, **limits), spreads
