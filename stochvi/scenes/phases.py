"""Phases of a mission: what shakes the scene for how long, and how its mounts are meanwhile."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal, Self

from pydantic import Field, model_validator

from stochvi.scenes.changed_mounts import changed_mount
from stochvi.scenes.excitations import BASE, Excitation, Excitations, RoadNoise, TabulatedNoise
from stochvi.scenes.excitations.base import LARGEST_LEVEL
from stochvi.scenes.moving_bands import MovingBand
from stochvi.scenes.validation import Checked, Count, Number, Positive, Seconds

if TYPE_CHECKING:
    from stochvi.scenes.scene import Scene


def steps_of_bands(phases: Sequence[Phase]) -> list[list[str]]:
    """Names of the phases that are steps of one moving band, for each band, in their order."""
    bands = dict.fromkeys(phase.step_of for phase in phases if phase.step_of is not None)
    return [[phase.name for phase in phases if phase.step_of == band] for band in bands]


def bias_of_steps(
    steps: Sequence[Sequence[str]], hazards: Mapping[str, float],
    lags: Mapping[str, float] | None = None,
) -> float:  # fmt: skip
    """What half as many steps of moving bands change in the sum of hazards, over 3: a sum over the
    middles of steps errs in second order of their length. In each step the hazard of what moves may
    be too large by its share `lags`.

    >>> round(bias_of_steps([["a", "b"]], {"a": 1.0, "b": 1.0}), 12)
    0.0
    >>> round(bias_of_steps([["a", "b"]], {"a": 1.0, "b": 1.3}), 12)
    0.1
    """
    total = sum(hazards[name] * lag for name, lag in (lags or {}).items())
    for names in steps:
        own = [hazards[name] for name in names]
        if len(own) > 1:
            halves = (sum(part) * len(own) / len(part) for part in (own[::2], own[1::2]))
            total += max(abs(half - sum(own)) for half in halves) / 3.0
    return total


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
    added
        Excitations that act beside those of the scene or of the phase. `added_excitation` in a
        file.
    moving
        Narrow bands or sines whose frequency moves through the phase, beside all else.
        `moving_band` in a file. The phase becomes `steps` phases, in each of which they stand
        still; they must therefore move slowly.
    steps
        Number of these phases; by default a band moves by a quarter of its width from one to the
        next, and a sine by a hundredth of its frequency.
    sweep
        Whether frequencies move in a constant ratio ("logarithmic"), or by a constant difference
        ("linear"), in a time.
    step_of
        Name of the phase through which a band moves, of which this one is a step; it need not be
        given.
    sweep_rate
        How fast what moves passes in this step, Hz/s; it need not be given.
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
    added: Excitations = Field(default=(), alias="added_excitation")
    moving: tuple[MovingBand, ...] = Field(default=(), alias="moving_band")
    steps: Count | None = None
    sweep: Literal["logarithmic", "linear"] = "logarithmic"
    step_of: str | None = None
    sweep_rate: Number = 0.0
    stiffness_factor: Positive = 1.0
    damping_factor: Positive = 1.0

    @model_validator(mode="after")
    def _shaken(self) -> Self:
        if abs(self.level_db) > LARGEST_LEVEL:
            raise ValueError(f"has level_db outside -200..200, got {self.level_db:g}")
        if self.axis is not None and self.profile is None:
            raise ValueError(f"has axis {self.axis!r} without a profile")
        if self.profile is not None and self.excitations:
            raise ValueError("has profile and excitation; give one of them")
        if self.steps is not None and not self.moving:
            raise ValueError(f"has steps = {self.steps} without a moving_band")
        return self

    @property
    def standing(self) -> tuple[Phase, ...]:
        """The phases in which nothing moves: this one, or one for each step of what moves."""
        if not self.moving:
            return (self,)
        count = self.steps or max(each.steps() for each in self.moving) or 1
        shares = [(step + 0.5) / count for step in range(count)]
        return tuple(
            self.replace(
                name=f"{self.name}, {self.moving[0].frequency(share, self.sweep):.4g} Hz",
                duration=self.duration / count, moving=(), steps=None, step_of=self.name,
                added=(*self.added, *(each.at(share, self.sweep) for each in self.moving)),
                sweep_rate=max(
                    each.hertz_per_second(share, self.sweep) / self.duration
                    for each in self.moving
                ),
            )
            for share in shares
        )  # fmt: skip

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
        own = self.own_excitations
        if own or self.added:
            changes["excitations"] = (*(own or scene.excitations), *self.added)
        if own:
            changes["cross_densities"] = ()
            if not any(isinstance(each, RoadNoise) for each in own):
                changes["vehicle"] = None
        found = scene.replace(**changes).at_level(self.level_db)
        if self.stiffness_factor == self.damping_factor == 1.0:
            return found
        frequency = math.sqrt(self.stiffness_factor)
        return changed_mount(found, frequency, self.damping_factor / frequency)
