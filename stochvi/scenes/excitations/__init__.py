"""What shakes the system: noise (white, filtered, of a density), a sine, a constant load.

A class of `DrawnExcitation` is found in any file of this package; `Excitation` lists the others.
"""

from __future__ import annotations

import pkgutil
from importlib import import_module
from typing import Annotated, get_args

from pydantic import BeforeValidator

from stochvi.scenes.excitations.base import (
    BASE,
    BaseExcitation,
    ConstantLoad,
    DensityNoise,
    Sine,
    WhiteNoise,
    check_unit,
)
from stochvi.scenes.excitations.drawn import DrawnExcitation, DriveFunction, Pulses
from stochvi.scenes.excitations.noise import (
    FilteredNoise,
    Modulation,
    RoadNoise,
    ShapedNoise,
    StateSpaceNoise,
    TabulatedNoise,
    TransferFunctionNoise,
    kinds_of_filters,
)
from stochvi.scenes.excitations.recorded import RecordedNoise
from stochvi.scenes.validation import OneOf

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
"""Every excitation that a scene may hold, but those that `EXCITATIONS` finds by their class."""

for _module in pkgutil.iter_modules(__path__, f"{__name__}."):
    import_module(_module.name)

EXCITATIONS: tuple[type[BaseExcitation], ...] = tuple(
    dict.fromkeys([*get_args(Excitation), *DrawnExcitation.__subclasses__()])
)
"""The classes of excitations: those of `Excitation`, and all drives that a simulation draws."""

_one_of = OneOf(EXCITATIONS, "excitations", (DrawnExcitation, DensityNoise))
Excitations = Annotated[
    tuple[Annotated[Excitation, _one_of], ...], BeforeValidator(kinds_of_filters)
]
"""Excitations of a scene, or of a phase of its mission."""

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
