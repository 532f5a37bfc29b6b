"""What a page says of a scene at rest: natural frequencies, damping, and where its gaps hang."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from stochvi.model.model import model_of
from stochvi.model.natural_modes import at_rest, natural_modes
from stochvi.scenes.scene import Scene


@dataclass(frozen=True, kw_only=True)
class SceneAtRest:
    """Numbers of a scene without noise.

    Parameters
    ----------
    natural_frequency_hz
        The frequency of each mode without stops, Hz.
    damping_ratio
        That of one mass on its spring; None for several coordinates, or without a spring.
    gaps
        Where each gap rests under gravity and constant loads, by the name of its pair, m from the
        unloaded spring; empty without a load.
    """

    natural_frequency_hz: tuple[float, ...]
    damping_ratio: float | None
    gaps: Mapping[str, float]


def scene_at_rest(scene: Scene) -> SceneAtRest:
    """Return the numbers of a scene without noise.

    Examples
    --------
    >>> import stochvi
    >>> mount = stochvi.Isolator(mass=1.0, frequency_hz=12.0, zeta=0.1, gravity=True)
    >>> stops = stochvi.ImpactPair(clearance=0.01, law=stochvi.Restitution(coefficient=0.5))
    >>> noise = stochvi.WhiteNoise(density=0.01, unit="g2/Hz")
    >>> scene = stochvi.Scene(structure=mount, impact_pairs=[stops], excitations=[noise])
    >>> found = scene_at_rest(scene)
    >>> round(found.damping_ratio, 9), round(1e3 * found.gaps["stops"], 3)
    (0.1, -1.725)
    """
    model = model_of(scene)
    modes = natural_modes(model)
    one_mass = model.rates is not None and model.omega > 0.0
    return SceneAtRest(
        natural_frequency_hz=tuple(mode.frequency_hz for mode in modes),
        damping_ratio=0.5 * model.damping_rate / model.omega if one_mass else None,
        gaps={name: gap.position for name, gap in at_rest(model)[1].items()},
    )
