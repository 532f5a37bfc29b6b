"""What shakes the system: noise (white, filtered, of a density), a sine, a constant load.

Each excitation is a file; `Excitation` lists them.
"""

from __future__ import annotations

from typing import Annotated, get_args

from pydantic import BeforeValidator, Field

from stochvi.scenes.excitations.base import BASE, BaseExcitation, DensityNoise, check_unit
from stochvi.scenes.excitations.constant import ConstantLoad
from stochvi.scenes.excitations.drawn import DrawnExcitation
from stochvi.scenes.excitations.drive_function import DriveFunction
from stochvi.scenes.excitations.filtered import FilteredNoise
from stochvi.scenes.excitations.modulation import Modulation
from stochvi.scenes.excitations.pulses import Pulses
from stochvi.scenes.excitations.recorded import RecordedNoise
from stochvi.scenes.excitations.road import RoadNoise
from stochvi.scenes.excitations.shaped import (
    ShapedNoise,
    StateSpaceNoise,
    TransferFunctionNoise,
    kinds_of_filters,
)
from stochvi.scenes.excitations.sine import Sine
from stochvi.scenes.excitations.tabulated import TabulatedNoise
from stochvi.scenes.excitations.white import WhiteNoise

Excitation = (
    WhiteNoise
    | FilteredNoise
    | TransferFunctionNoise
    | StateSpaceNoise
    | TabulatedNoise
    | RoadNoise
    | RecordedNoise
    | Sine
    | ConstantLoad
    | Modulation
    | Pulses
    | DriveFunction
)
"""Every excitation that a scene may hold."""

Excitations = Annotated[
    tuple[Annotated[Excitation, Field(discriminator="kind")], ...],
    BeforeValidator(kinds_of_filters),
]
"""Excitations of a scene, or of a phase of its mission."""

EXCITATIONS: tuple[type[BaseExcitation], ...] = get_args(Excitation)
"""The classes of `Excitation`, in its order."""

DENSITY_KINDS: tuple[str, ...] = tuple(
    each.model_fields["kind"].default for each in EXCITATIONS if issubclass(each, DensityNoise)
)
"""The kinds of noise that a density describes."""

Disturbance = BaseExcitation
"""The name that `BaseExcitation` had; it goes with the next version."""

__all__ = [
    "BASE",
    "DENSITY_KINDS",
    "EXCITATIONS",
    "BaseExcitation",
    "ConstantLoad",
    "DensityNoise",
    "Disturbance",
    "DrawnExcitation",
    "DriveFunction",
    "Excitation",
    "Excitations",
    "FilteredNoise",
    "Modulation",
    "Pulses",
    "RecordedNoise",
    "RoadNoise",
    "ShapedNoise",
    "Sine",
    "StateSpaceNoise",
    "TabulatedNoise",
    "TransferFunctionNoise",
    "WhiteNoise",
    "check_unit",
]
