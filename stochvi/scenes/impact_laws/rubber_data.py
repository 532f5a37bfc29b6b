"""Numbers of a linear stop from what is known of its rubber: hardness, loss factor, restitution.

The laws themselves are in `viscoelastic.py`.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Mapping
from typing import Any, Self

from pydantic import (
    ModelWrapValidatorHandler,
    PrivateAttr,
    SerializationInfo,
    SerializerFunctionWrapHandler,
    model_serializer,
    model_validator,
)

from stochvi.mathematics.kelvin_voigt import damping_ratio_of
from stochvi.results.errors import SceneError
from stochvi.scenes.impact_laws.base import CompliantLaw

SOFTEST, HARDEST = 20.0, 80.0
"""Range of Shore A hardness in which Gent's relation is used; durometers resolve little outside."""

PAD = ("shore_a", "area", "thickness")
"""Keys of a rubber pad, from which its stiffness follows."""

DAMPING = ("damping_ratio", "loss_factor", "restitution")
"""Keys that state the energy loss of a stop; exactly one of them must be given."""

OF_RUBBER = ("elastic", "viscoelastic")
"""Kinds of laws whose numbers may follow from data of the rubber."""

AS_WRITTEN = {"as_written": True}
"""Context for pydantic's dump with which a law of rubber keeps the keys by which it was given."""


class RubberLaw(CompliantLaw):
    """A linear law whose numbers may be calculated from data of its rubber.

    It has the calculated numbers, and keeps the keys from which they were calculated.
    """

    _written: dict[str, Any] | None = PrivateAttr(default=None)

    @classmethod
    @abstractmethod
    def converted(cls, keys: Mapping[str, Any]) -> dict[str, Any]:
        """The keys of the law with its own numbers in place of the data of the rubber."""

    @model_validator(mode="wrap")
    @classmethod
    def _from_rubber(cls, keys: Any, handler: ModelWrapValidatorHandler[Self]) -> Self:
        if not isinstance(keys, dict):
            return handler(keys)
        numbers = cls.converted(keys)
        law = handler(numbers)
        if numbers != keys:
            law._written = {name: value for name, value in keys.items() if value is not None}
        return law

    @model_serializer(mode="wrap")
    def _keys(
        self, handler: SerializerFunctionWrapHandler, info: SerializationInfo
    ) -> dict[str, Any]:
        found: dict[str, Any] = handler(self)
        # the keys as written no longer hold for a copy with another stiffness
        if info.context == AS_WRITTEN and self._written and type(self)(**self._written) == self:
            return {"kind": found["kind"]} | self._written
        return found

    def __eq__(self, other: object) -> bool:
        """Two laws with the same numbers are equal, whatever keys they were given by."""
        return type(other) is type(self) and other.__dict__ == self.__dict__


def youngs_modulus(shore_a: float) -> float:
    """Young's modulus of rubber, Pa, from its Shore A hardness S,

        E = 0.0981 MPa (56 + 7.62336 S) / (0.137505 (254 - 2.54 S))

    (A. N. Gent, Rubber Chemistry and Technology 31 (1958) 896-906), for a spherical-ended indenter
    on an incompressible half-space. It is accurate to some 20 %.

    Examples
    --------
    >>> round(youngs_modulus(60.0) / 1e6, 2)
    3.61
    """
    if not SOFTEST <= shore_a <= HARDEST:
        raise ValueError(f"must be from {SOFTEST:g} to {HARDEST:g} Shore A, got {shore_a:g}")
    return 0.0981e6 * (56.0 + 7.62336 * shore_a) / (0.137505 * (254.0 - 2.54 * shore_a))


def with_stiffness(keys: Mapping[str, Any]) -> dict[str, Any]:
    """The keys of a law with the stiffness E area / thickness of a pad instead of the pad."""
    given = [name for name in PAD if name in keys]
    if not given:
        return dict(keys)
    if len(given) < len(PAD) or keys.get("stiffness") is not None:
        raise ValueError(
            "takes stiffness, or shore_a with area (m^2) and thickness (m), got "
            f"{', '.join([*given, *(['stiffness'] if keys.get('stiffness') is not None else [])])}"
        )
    hardness, area, thickness = (_positive(keys, name) for name in PAD)
    try:
        modulus = youngs_modulus(hardness)
    except ValueError as error:
        raise SceneError([("shore_a", str(error))]) from None
    stiffness = modulus * area / thickness
    conversion = (
        f"stiffness {stiffness:.4g} N/m of a pad of {1e4 * area:.4g} cm² and {1e3 * thickness:.4g} "
        f"mm, free to bulge, with E = {modulus / 1e6:.3g} MPa at {hardness:g} Shore A (Gent 1958, "
        "good to some 20 %)"
    )
    return _converted(keys, PAD, conversion) | {"stiffness": stiffness}


def with_damping_ratio(keys: Mapping[str, Any]) -> dict[str, Any]:
    """The keys of a law with the damping ratio that follows from a loss factor or restitution."""
    given = [name for name in DAMPING if keys.get(name) is not None]
    speed = keys.get("at_speed")
    if not given and speed is None:
        return dict(keys)  # the check of the law refuses a missing damping_ratio
    if len(given) != 1 or (speed is not None and given != ["restitution"]):
        also = ["at_speed"] if speed is not None else []
        raise ValueError(
            "needs exactly one of damping_ratio, loss_factor and restitution (which may say "
            f"at_speed, m/s), got {', '.join(given + also) or 'none'}"
        )
    if given == ["damping_ratio"]:
        return dict(keys)
    (name,) = given
    value = _positive(keys, name)
    if name == "loss_factor":
        ratio = value / 2.0
        conversion = (
            f"damping ratio {ratio:.4g}, half the loss factor {value:g} at the frequency of the "
            "contact, sqrt(stiffness / mass)"
        )
    else:
        try:
            ratio = damping_ratio_of(value)
        except ValueError as error:
            raise SceneError([(name, str(error))]) from None
        at = "" if speed is None else f", measured at {_positive(keys, 'at_speed'):g} m/s"
        conversion = (
            f"damping ratio {ratio:.4g}, at which a free mass has the restitution {value:g}{at}; "
            "this law has it at every speed"
        )
    return _converted(keys, (name, "at_speed"), conversion) | {"damping_ratio": ratio}


def _converted(
    keys: Mapping[str, Any], replaced: tuple[str, ...], conversion: str
) -> dict[str, Any]:
    """The keys without the replaced ones, and with the conversion added to `source`."""
    kept = {name: value for name, value in keys.items() if name not in replaced}
    before = f"{kept['source']}; " if kept.get("source") else ""
    return kept | {"source": before + conversion}


def _positive(keys: Mapping[str, Any], name: str) -> float:
    value = keys[name]
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise SceneError([(name, f"must be a finite number, got {value!r}")])
    if value <= 0.0:
        raise SceneError([(name, f"must be greater than 0, got {value!r}")])
    return float(value)
