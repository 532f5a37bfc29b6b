from .array_closure import Linearised, linearise_many
from .one_form import (
    FORMS,
    VARIANTS,
    LinearisedOscillator,
    LinearisedStructure,
    linearise,
    linearise_all,
    linearised_oscillators,
    linearised_structures,
)

__all__ = [
    "FORMS",
    "VARIANTS",
    "Linearised",
    "LinearisedOscillator",
    "LinearisedStructure",
    "linearise",
    "linearise_all",
    "linearise_many",
    "linearised_oscillators",
    "linearised_structures",
]
