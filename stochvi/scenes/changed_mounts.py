"""A scene on mounts that are stiffer or softer, with more damping or less."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from stochvi.results.errors import SceneError
from stochvi.scenes.between_units import times
from stochvi.scenes.structures import Structure
from stochvi.scenes.structures.rigid_body import Mount, RigidBody

if TYPE_CHECKING:
    from stochvi.scenes.scene import Scene


def changed_mount(scene: Scene, frequency: float, damping: float) -> Scene:
    """The scene with its natural frequencies and damping ratios multiplied by two factors; those of
    a rigid body by those of all of its mounts.

    Raises
    ------
    SceneError
        If a spring or damper is a function, as a factor of a frequency does not say how it changes.
    """
    structure = scene.structure
    if structure.functions:
        raise SceneError(
            [("structure", "must have linear springs and dampers where its stiffness or damping "
              f"changes, got a {structure.functions[0].law.effect}; write a scene for each state")]
        )  # fmt: skip
    if isinstance(structure, RigidBody):
        mounts = tuple(type(each)(**_scaled(each, frequency, damping)) for each in structure.mounts)
        changed: Structure = structure.model_copy(update={"mounts": mounts})
    else:
        changed = type(structure)(**_scaled(structure, frequency, damping))
    return scene.model_copy(update={"structure": changed})


def _scaled(part: Structure | Mount, frequency: float, damping: float) -> dict[str, Any]:
    """The keys of a structure or a mount with springs and dampers for other natural frequencies and
    damping ratios."""
    factors = {
        "frequency_hz": frequency, "stiffness": frequency**2, "damping": frequency * damping,
        "zeta": damping, "loss_factor": damping, "Q": 1.0 / damping,
    }  # fmt: skip
    given = {name: getattr(part, name) for name in type(part).model_fields}
    return {
        key: _times(value, factors[key]) if key in factors else value
        for key, value in given.items()
        if value is not None
    }


def _times(value: Any, factor: float) -> Any:
    """A number, or the numbers of a matrix, multiplied by a factor."""
    return times(value, factor) if isinstance(value, float) else np.multiply(value, factor).tolist()
