"""Changes of a scene within the tolerances of its mount, its level and its stops."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import NamedTuple

from stochvi.scenes.changed_mounts import changed_mount
from stochvi.scenes.impact_laws import Law, Restitution
from stochvi.scenes.scene import Scene
from stochvi.scenes.structures.rigid_body import AXES, RigidBody

WORST = "worst within all tolerances"
"""Name of the row with the largest clearance of the whole region of the tolerances."""


@dataclass(frozen=True, kw_only=True)
class Tolerances:
    """How far the mount, the level and the stops may be from what the scene states: by default
    nothing is off.

    Parameters
    ----------
    frequency, damping
        Relative tolerances of natural frequency and damping ratio.
    level_db
        Tolerance of the level, dB up and down.
    stiffness
        Relative tolerance of the stiffness of the stops.
    centre
        How far the centre of mass of a rigid body may lie from its stated place along each axis, m.
    """

    frequency: float = 0.0
    damping: float = 0.0
    level_db: float = 0.0
    stiffness: float = 0.0
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
    def of(cls, scene: Scene, *, usual: bool = False, **stated: float) -> Tolerances:
        """The tolerances that were asked for: those stated as arguments, those of the scene, and,
        if `usual` is asked for, `USUAL` for the others."""
        own = {
            name: value
            for name in ("frequency", "damping", "centre")
            if (value := getattr(scene.structure, f"{name}_tolerance", None)) is not None
        }
        found = cls(**(asdict(USUAL) if usual else {}) | own | stated)
        if found.centre and not isinstance(scene.structure, RigidBody):
            raise ValueError(
                "the tolerance of centre is that of structure.kind = 'rigid-body', got "
                f"{scene.structure.kind!r}"
            )
        return found

    def felt(self, scene: Scene, *, by_hits: bool) -> Tolerances:
        """These tolerances without that of the stiffness of the stops where no answer depends on
        it: no impact is simulated, or a stop is rigid."""
        return self if by_hits and ends_of_stops(scene, self) else replace(self, stiffness=0.0)

    def limits(self) -> dict[str, float]:
        """The largest amount by which each quantity may be off either way, without those that are
        as stated; the stiffness of the stops is not among them."""
        known = {"frequency": self.frequency, "damping": self.damping, "level": self.level_db}
        known |= {f"{CENTRE}{axis}": self.centre for axis in AXES}
        return {quantity: limit for quantity, limit in known.items() if limit}

    def in_words(self) -> str:
        """The tolerances that are not zero, in words; empty where there is none."""
        words = {
            "natural frequency": (100.0 * self.frequency, "%"),
            "damping ratio": (100.0 * self.damping, "%"),
            "level": (self.level_db, "dB"),
            "centre of mass": (1e3 * self.centre, "mm along each axis"),
            "stiffness of the stops": (100.0 * self.stiffness, "%"),
        }
        return ", ".join(
            f"{name} ± {value:.3g} {unit}" for name, (value, unit) in words.items() if value
        )


USUAL = Tolerances(frequency=0.1, damping=0.3, level_db=3.0, stiffness=0.2)
"""Usual tolerances of elastomer mounts, of the level of vibration tests, and of the stiffness of
rubber within 5 degrees Shore A; applied where it is asked for."""

CENTRE = "centre "
"""Beginning of the name of a quantity that moves the centre of mass; the axis follows it."""


STIFFNESS = "stiffness "
"""Beginning of the name of a quantity that is the stiffness of one law. The name of its pair
follows it, behind the side where the law is that of one stop."""


class Change(NamedTuple):
    """One quantity that is off by an amount: relative, dB, m of a centre of mass, or a number that
    is added to the restitution."""

    quantity: str
    amount: float

    @property
    def words(self) -> str:
        """The change in words."""
        amount = self.amount
        match self.quantity:
            case "frequency":
                return f"natural frequency {100.0 * amount:+.3g} %"
            case "damping":
                return f"damping ratio {100.0 * amount:+.3g} %"
            case "level":
                return f"level {amount:+.3g} dB"
            case "stiffness":
                return f"stiffness of the stops {100.0 * amount:+.3g} %"
            case "restitution":
                return f"restitution {amount:+.3g}"
        if self.quantity.startswith(STIFFNESS):
            one = self.quantity.removeprefix(STIFFNESS)
            return f"stiffness of {one} {100.0 * amount:+.3g} %"
        axis = self.quantity.removeprefix(CENTRE)
        return f"centre of mass {1e3 * amount:+.3g} mm along {axis}"

    def applied(self, scene: Scene) -> Scene:
        """The scene with this change."""
        match self.quantity:
            case "frequency":
                return changed_mount(scene, 1.0 + self.amount, 1.0)
            case "damping":
                return changed_mount(scene, 1.0, 1.0 + self.amount)
            case "level":
                return scene.at_level(self.amount)
            case "stiffness":
                return changed_stops(scene, stiffness=1.0 + self.amount)
            case "restitution":
                return changed_stops(scene, restitution=self.amount)
        if self.quantity.startswith(STIFFNESS):
            one = self.quantity.removeprefix(STIFFNESS)
            return changed_stops(scene, stiffness=1.0 + self.amount, of=one)
        axis = self.quantity.removeprefix(CENTRE)
        return moved_centre(scene, [self.amount * (axis == each) for each in AXES])


def all_applied(changes: Sequence[Change], scene: Scene) -> Scene:
    """The scene with all of these changes."""
    for change in changes:
        scene = change.applied(scene)
    return scene


def worded(changes: Sequence[Change]) -> str:
    """Changes that come together, in words; those by nothing are left out."""
    return ", ".join(change.words for change in changes if change.amount)


def ends_of(tolerances: Tolerances) -> list[Change]:
    """Both ends of every tolerance of the mount and of the level that is not zero."""
    return [
        Change(quantity, sign * limit)
        for quantity, limit in tolerances.limits().items()
        for sign in (-1.0, 1.0)
    ]


def ends_of_stops(scene: Scene, tolerances: Tolerances) -> list[Change]:
    """Both ends of the stiffness of the stops, where all of them are compliant."""
    laws = [law for pair in scene.impact_pairs for _, law in pair.stops()]
    if not tolerances.stiffness or not laws or any(law.rigid for law in laws):
        return []
    return [Change("stiffness", sign * tolerances.stiffness) for sign in (-1.0, 1.0)]


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


def changed_stops(
    scene: Scene, *, stiffness: float = 1.0, restitution: float = 0.0, of: str | None = None
) -> Scene:
    """The scene with the stiffness of all compliant stops multiplied by a factor, and with a number
    added to the restitution of all rigid ones. Where that scatters, its mean is shifted. `of` names
    the law of one pair alone, as `STIFFNESS` says."""

    def changed(law: Law) -> Law:
        if isinstance(law, Restitution):
            return law.shifted(restitution)
        # more stiffness acts on a mass like the same law on a mass that is smaller by this factor
        return law if law.rigid else law.per_unit_mass(1.0 / stiffness)

    pairs = [
        pair.model_copy(
            update={
                name: changed(law)
                for name in ("law", "lower_law", "upper_law")
                if (law := getattr(pair, name)) is not None
                and of in (None, " ".join([*name.split("_")[:-1], pair.name]))
            }
        )
        for pair in scene.impact_pairs
    ]
    return scene.model_copy(update={"impact_pairs": tuple(pairs)})
