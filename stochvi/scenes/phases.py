"""Phases of a mission. Chapters: mounts that are stiffer or softer; sweeps of narrow bands and
sines; what shakes the scene for how long."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from stochvi.results.errors import SceneError
from stochvi.scenes.excitations import (
    BASE,
    Excitation,
    Excitations,
    RoadNoise,
    Sine,
    TabulatedNoise,
)
from stochvi.scenes.excitations.base import LARGEST_LEVEL, DensityOrLevelUnit
from stochvi.scenes.structures import Structure
from stochvi.scenes.structures.rigid_body import Mount, RigidBody
from stochvi.scenes.validation import Checked, Count, Number, Positive, Seconds, given, times

if TYPE_CHECKING:
    from stochvi.scenes.scene import Scene


# ------------------------------------------------------------------------------
# A scene on mounts that are stiffer or softer, with more damping or less.
# ------------------------------------------------------------------------------


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
            "structure",
            "must have linear springs and dampers where its stiffness or damping "
            f"changes, got a {structure.functions[0].law.effect}; write a scene for each state",
        )
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


# ------------------------------------------------------------------------------
# Narrow bands of noise and sines whose frequency moves through a phase of a mission.
# ------------------------------------------------------------------------------


class MovingBand(Checked):
    """A narrow band of noise, or a sine, whose frequency moves from one end to the other.

    Parameters
    ----------
    from_hz, to_hz
        Frequency at the start and at the end of the phase, Hz; the middle of a band.
    width_hz, density, unit
        Width of the band, Hz, its one-sided density, and the unit of that.
    amplitude
        Instead: peak of a sine, N on a mass, m/s^2 of the base.
    on, axis
        What it acts on, as for any excitation.

    See Also
    --------
    stochvi.scenes.Phase : The phase that it belongs to.

    Examples
    --------
    >>> band = MovingBand(from_hz=20.0, to_hz=80.0, width_hz=4.0, density=0.1, unit="g2/Hz")
    >>> band.at(0.5, "logarithmic").frequency_hz
    (38.0, 42.0)
    """

    from_hz: Positive
    to_hz: Positive
    width_hz: Positive | None = None
    density: Number | None = None
    unit: DensityOrLevelUnit | None = None
    amplitude: Positive | None = None
    on: str | None = None
    axis: Literal["x", "y", "z"] | None = None

    @model_validator(mode="after")
    def _one_form(self) -> Self:
        band = given(self, "width_hz", "density", "unit")
        if (self.amplitude is None) == (band == "none"):
            raise ValueError(
                "needs width_hz, density and unit of a band, or amplitude of a sine, got "
                f"{given(self, 'width_hz', 'density', 'unit', 'amplitude')}"
            )
        if self.amplitude is None and len(band.split(", ")) < 3:
            raise ValueError(f"needs width_hz, density and unit together, got {band}")
        if self.width_hz is not None and self.width_hz >= 2.0 * min(self.from_hz, self.to_hz):
            raise ValueError(
                f"must have width_hz below twice its lowest frequency, got {self.width_hz:g}"
            )
        return self

    def frequency(self, share: float, spacing: Literal["logarithmic", "linear"]) -> float:
        """Frequency after a share of the phase, Hz."""
        if spacing == "linear":
            return self.from_hz + share * (self.to_hz - self.from_hz)
        return float(self.from_hz * (self.to_hz / self.from_hz) ** share)

    def hertz_per_second(self, share: float, spacing: Literal["logarithmic", "linear"]) -> float:
        """How fast the frequency moves after a share of a phase of one second, Hz/s."""
        if spacing == "linear":
            return abs(self.to_hz - self.from_hz)
        return self.frequency(share, spacing) * abs(math.log(self.to_hz / self.from_hz))

    def at(self, share: float, spacing: Literal["logarithmic", "linear"]) -> TabulatedNoise | Sine:
        """The band or sine where it stands after a share of the phase."""
        middle = self.frequency(share, spacing)
        if self.amplitude is not None:
            return Sine(amplitude=self.amplitude, frequency_hz=middle, on=self.on, axis=self.axis)
        assert self.width_hz is not None and self.density is not None
        ends = middle - 0.5 * self.width_hz, middle + 0.5 * self.width_hz
        return TabulatedNoise(
            frequency_hz=ends, density=(self.density, self.density), unit=self.unit, on=self.on,
            axis=self.axis,
        )  # fmt: skip

    def steps(self) -> int:
        """Least number of steps at which a band covers its way evenly, each a quarter of a width
        from the next; for a sine steps of a hundredth of its frequency."""
        if self.width_hz is not None:
            return math.ceil(4.0 * abs(self.to_hz - self.from_hz) / self.width_hz)
        return math.ceil(abs(math.log(self.to_hz / self.from_hz)) / SINE_STEP)


SINE_STEP = 0.01
"""Change of the logarithm of the frequency of a sine from step to step: a twentieth of the
half-power bandwidth of a mount with a damping ratio of 0.1."""


# ------------------------------------------------------------------------------
# Phases of a mission: what shakes the scene for how long, and how its mounts are meanwhile.
# ------------------------------------------------------------------------------


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
