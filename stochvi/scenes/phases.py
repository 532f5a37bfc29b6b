"""Phases of a mission: what shakes the scene for how long, and how its mounts are meanwhile."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Literal, Self

from pydantic import Field, model_validator

from stochvi.scenes.changed_mounts import changed_mount
from stochvi.scenes.excitations import BASE, Excitation, Excitations, RoadNoise, TabulatedNoise
from stochvi.scenes.validation import Checked, Number, Positive, Seconds

if TYPE_CHECKING:
    from stochvi.scenes.scene import Scene


class Phase(Checked):
    """A phase of a mission.

    A phase has the excitations of the scene unless it has its own, by `profile` or `excitation`.

    Parameters
    ----------
    name
        Its name.
    duration
        How long it lasts, s, or a text with a unit, "90 min".
    level_db
        Decibels by which everything that shakes is raised in this phase.
    profile
        Name of a density that ships, which shakes the base instead of what the scene states.
    axis
        Axis of the profile, "x", "y" or "z", where the structure is a rigid body.
    excitations
        Instead of a profile: excitations of this phase. `excitation` in a file. Cross densities of
        the scene do not act on them.
    stiffness_factor, damping_factor
        Factors of the stiffness and of the damping constants of the mounts, which are warm or cold
        in this phase.

    See Also
    --------
    stochvi.reliability : Probabilities of a mission of phases.

    Examples
    --------
    >>> road = Phase(name="road", duration="2 h", profile="mil-std-810h-truck-vertical-5hz")
    >>> road.duration, road.own_excitations[0].kind
    (7200.0, 'psd')
    """

    name: str
    duration: Seconds
    level_db: Number = 0.0
    profile: str | None = None
    axis: Literal["x", "y", "z"] | None = None
    excitations: Excitations = Field(default=(), alias="excitation")
    stiffness_factor: Positive = 1.0
    damping_factor: Positive = 1.0

    @model_validator(mode="after")
    def _shaken(self) -> Self:
        if self.axis is not None and self.profile is None:
            raise ValueError(f"has axis {self.axis!r} without a profile")
        if self.profile is not None and self.excitations:
            raise ValueError("has profile and excitation; give one of them")
        return self

    @property
    def own_excitations(self) -> tuple[Excitation, ...]:
        """What shakes the structure in this phase alone; empty for what the scene states."""
        if self.profile is None:
            return self.excitations
        on = None if self.axis else BASE
        return (TabulatedNoise(profile=self.profile, on=on, axis=self.axis),)

    def of(self, scene: Scene) -> Scene:
        """The scene as it is in this phase."""
        changes: dict[str, Any] = {"phases": ()}
        if own := self.own_excitations:
            changes |= {"excitations": own, "cross_densities": ()}
            if not any(isinstance(each, RoadNoise) for each in own):
                changes["vehicle"] = None
        found = scene.replace(**changes).at_level(self.level_db)
        if self.stiffness_factor == self.damping_factor == 1.0:
            return found
        frequency = math.sqrt(self.stiffness_factor)
        return changed_mount(found, frequency, self.damping_factor / frequency)
