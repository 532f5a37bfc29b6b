"""Changes of a scene within the tolerances of its mount, its level and its stops."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from stochvi.scenes.impact_laws import Law, Restitution
from stochvi.scenes.rigid_body import AXES, RigidBody
from stochvi.scenes.scene import Scene

COMBINED = "worst combination"
"""Name of the row in which all changes that ask for more clearance come together."""


@dataclass(frozen=True, kw_only=True)
class Tolerances:
    """How far the mount, the level and the stops may be from what the scene states.

    Parameters
    ----------
    frequency, damping
        Relative tolerances of natural frequency and damping ratio. The defaults are usual of
        elastomer mounts; `structure.frequency_tolerance` and `damping_tolerance` take their place.
    level_db
        Tolerance of the level, dB up and down: the usual one of vibration tests.
    stiffness
        Relative tolerance of the stiffness of the stops: that of rubber within 5 degrees Shore A.
    centre
        How far the centre of mass of a rigid body may lie from its stated place along each axis, m.
    """

    frequency: float = 0.1
    damping: float = 0.3
    level_db: float = 3.0
    stiffness: float = 0.2
    centre: float = 0.0

    def __post_init__(self) -> None:
        for name in ("frequency", "damping", "stiffness"):
            if not 0.0 <= getattr(self, name) < 1.0:
                raise ValueError(
                    f"the tolerance of {name} must be in [0, 1) (0 to 100 %), "
                    f"got {getattr(self, name):g}"
                )
        if not 0.0 <= self.centre < math.inf:
            raise ValueError(
                f"the tolerance of centre must be a length from 0 on (m), got {self.centre:g}"
            )
        if not 0.0 <= self.level_db < 60.0:
            raise ValueError(f"the tolerance of level must be in [0, 60) dB, got {self.level_db:g}")

    @classmethod
    def of(cls, scene: Scene, **stated: float) -> Tolerances:
        """The tolerances of a scene: those stated as arguments, else its own, else the defaults."""
        own = {
            name: value
            for name in ("frequency", "damping", "centre")
            if (value := getattr(scene.structure, f"{name}_tolerance", None)) is not None
        }
        found = cls(**(own | stated))
        if found.centre and not isinstance(scene.structure, RigidBody):
            raise ValueError(
                "the tolerance of centre is that of structure.kind = 'rigid-body', got "
                f"{scene.structure.kind!r}"
            )
        return found


CENTRE = "centre "
"""Beginning of the name of a quantity that moves the centre of mass; the axis follows it."""


class Change(NamedTuple):
    """One quantity at one end of its tolerance."""

    words: str
    quantity: str
    sign: float
    amount: float

    def applied(self, scene: Scene) -> Scene:
        """The scene with this change."""
        match self.quantity:
            case "frequency":
                return changed_mount(scene, 1.0 + self.amount, 1.0)
            case "damping":
                return changed_mount(scene, 1.0, 1.0 + self.amount)
            case "level":
                return scene.at_level(self.amount)
            case str(quantity) if quantity.startswith(CENTRE):
                axis = quantity.removeprefix(CENTRE)
                return moved_centre(scene, [self.amount * (axis == each) for each in AXES])
        return changed_stops(scene, 1.0 + self.amount)


def ends_of(tolerances: Tolerances) -> Iterator[Change]:
    """Both ends of every tolerance of the mount and of the level that is not zero."""
    for quantity, words, share in (
        ("frequency", "natural frequency", tolerances.frequency),
        ("damping", "damping ratio", tolerances.damping),
    ):
        yield from _both_ends(quantity, words, share)
    for sign in (-1.0, 1.0) if tolerances.level_db else ():
        amount = sign * tolerances.level_db
        yield Change(f"level {amount:+.3g} dB", "level", sign, amount)
    for axis in AXES if tolerances.centre else ():
        for sign in (-1.0, 1.0):
            amount = sign * tolerances.centre
            words = f"centre of mass {1e3 * amount:+.3g} mm along {axis}"
            yield Change(words, f"{CENTRE}{axis}", sign, amount)


def ends_of_stops(scene: Scene, tolerances: Tolerances) -> Iterator[Change]:
    """Both ends of the stiffness of the stops, where all of them give way."""
    if scene.impact_pairs and not any(
        law.rigid for pair in scene.impact_pairs for _, law in pair.stops()
    ):
        yield from _both_ends("stiffness", "stiffness of the stops", tolerances.stiffness)


def _both_ends(quantity: str, words: str, share: float) -> Iterator[Change]:
    for sign in (-1.0, 1.0) if share else ():
        yield Change(f"{words} {100.0 * sign * share:+.3g} %", quantity, sign, sign * share)


def changed_mount(scene: Scene, frequency: float, damping: float) -> Scene:
    """The scene with its natural frequency and damping ratio multiplied by two factors."""
    structure = scene.structure
    given: Mapping[str, Any] = structure.model_dump(exclude_none=True)
    if "frequency_hz" in given:
        changed = {"frequency_hz": given["frequency_hz"] * frequency}
        changed |= {"zeta": given["zeta"] * damping} if "zeta" in given else {}
        changed |= {"Q": given["Q"] / damping} if "Q" in given else {}
    else:
        changed = {
            "stiffness": given["stiffness"] * frequency**2,
            "damping": given["damping"] * frequency * damping,
        }
    return scene.model_copy(update={"structure": type(structure)(**(dict(given) | changed))})


def moved_centre(scene: Scene, shift: Sequence[float]) -> Scene:
    """A rigid body whose centre of mass lies elsewhere by `shift` (m along x, y, z), seen from
    which mounts, points and pairs are then placed. The inertia about the centre stays."""
    body = scene.structure
    assert isinstance(body, RigidBody)

    def seen(place: tuple[float, float, float]) -> tuple[float, ...]:
        return tuple(each - moved for each, moved in zip(place, shift, strict=True))

    mounts = tuple(each.model_copy(update={"at": seen(each.at)}) for each in body.mounts)
    points = {name: seen(place) for name, place in (body.points or {}).items()}
    pairs = tuple(
        each.model_copy(update={"at": seen(each.at)}) if each.at is not None else each
        for each in scene.impact_pairs
    )
    structure = body.model_copy(update={"mounts": mounts, "points": points})
    return scene.model_copy(update={"structure": structure, "impact_pairs": pairs})


def changed_stops(scene: Scene, amount: float) -> Scene:
    """The scene with the stiffness of its stops multiplied by `amount`, or, where a stop is rigid,
    with `amount` added to its restitution."""
    pair = scene.impact_pairs[0]
    laws = {
        name: _changed_law(law, amount)
        for name in ("law", "lower_law", "upper_law")
        if (law := getattr(pair, name)) is not None
    }
    return scene.model_copy(update={"impact_pairs": (pair.model_copy(update=laws),)})


def _changed_law(law: Law, amount: float) -> Law:
    if isinstance(law, Restitution):
        return Restitution(coefficient=min(max(law.coefficient + amount, 0.0), 1.0))
    # a larger stiffness acts on a mass like the same law on a mass that is smaller by this factor
    return law.per_unit_mass(1.0 / amount)
