"""A number of a scene that differs between the units of a production: its mean and its width."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Any, Self, TypeVar

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    Discriminator,
    PlainSerializer,
    Tag,
    model_validator,
)

from stochvi.scenes.validation import Checked, NonNegative, Number, Positive, given

Part = TypeVar("Part", bound=BaseModel)


class BetweenUnits(Checked):
    """A number that differs between the units of a production.

    Each unit has one value, which is drawn once and stays. `size`, `isolators.production` and
    `mean_over_units` take the mean over the units, and `stochvi reliability` does beside its
    answer. All other answers are those of the mean unit.

    Parameters
    ----------
    mean
        Mean over the units, in the unit of the key.
    std
        Standard deviation of a normal distribution, in the same unit. That of a number that must be
        positive is truncated at a twentieth of its mean, that of a damping at 0.
    half_width
        Instead: half of the width of a uniform distribution, in the same unit.

    See Also
    --------
    stochvi.Scatter : A restitution that is drawn anew at each impact.
    stochvi.mean_over_units : Any answer as a mean over the units.

    Examples
    --------
    >>> from stochvi import ImpactPair, Restitution
    >>> place = BetweenUnits(mean=0.01, std=0.0005)
    >>> pair = ImpactPair(upper=place, law=Restitution(coefficient=0.6))
    >>> pair.upper, pair.upper.between_units.std
    (0.01, 0.0005)
    """

    mean: Number
    std: Positive | None = None
    half_width: Positive | None = None

    @model_validator(mode="after")
    def _one_width(self) -> Self:
        if (self.std is None) == (self.half_width is None):
            raise ValueError(
                "needs exactly one of std (normal) and half_width (uniform), got "
                f"{given(self, 'std', 'half_width')}"
            )
        return self

    def __str__(self) -> str:
        if self.std is not None:
            return f"{self.mean:g}, std {self.std:g}"
        return f"{self.mean:g} ± {self.half_width:g}"


class Mean(float):
    """The mean of a number that differs between units: a number for all that take the mean unit."""

    between_units: BetweenUnits

    def __new__(cls, between_units: BetweenUnits) -> Self:
        found = super().__new__(cls, between_units.mean)
        found.between_units = between_units
        return found

    def __getnewargs__(self) -> Any:
        return (self.between_units,)

    def __neg__(self) -> float:
        return moved(self, -float(self))

    def __eq__(self, other: object) -> bool:
        if isinstance(other, Mean):
            return self.between_units == other.between_units
        return float(self) == other

    __hash__ = float.__hash__


def moved(value: float, mean: float) -> float:
    """Another mean; where the value differs between units, with the same width."""
    if not isinstance(value, Mean):
        return mean
    return Mean(value.between_units.model_copy(update={"mean": mean}))


def times(value: float, factor: float) -> float:
    """A value multiplied by a factor, with its width where it differs between units."""
    if not isinstance(value, Mean):
        return factor * value
    own = value.between_units.model_dump(exclude_none=True)
    return Mean(BetweenUnits(**{key: factor * each for key, each in own.items()}))


def in_toml(value: float) -> str:
    """A number as a scene file has it, with what it differs by between units.

    >>> in_toml(0.0121), in_toml(Mean(BetweenUnits(mean=0.01, std=0.0005)))
    ('0.0121', '{ mean = 0.01, std = 0.0005 }')
    """
    keys = _written(value)
    if not isinstance(keys, dict):
        return f"{value:.9g}"
    return f"{{ {', '.join(f'{key} = {each:.9g}' for key, each in keys.items())} }}"


def _tag(value: Any) -> str:
    return "{}" if isinstance(value, dict | BetweenUnits | Mean) else ""


def _table(value: Any) -> Any:
    return value.between_units if isinstance(value, Mean) else value


def _mean(value: Any) -> Any:
    return Mean(value) if isinstance(value, BetweenUnits) else value


def _from_zero(value: Any) -> Any:
    """The same value, if no unit can have 0 or less."""
    if isinstance(value, BetweenUnits) and (least := value.mean - (value.half_width or 0.0)) <= 0.0:
        raise ValueError(
            f"must be greater than 0 in every unit, got {least:g}; give a larger mean, or a "
            "smaller half_width"
        )
    return value


def _written(value: Any) -> Any:
    if isinstance(value, Mean):
        return value.between_units.model_dump(exclude_none=True)
    return value


if TYPE_CHECKING:
    VariedNumber = float
    VariedPositive = float
    VariedNonNegative = float
else:
    _Table = Annotated[BetweenUnits, BeforeValidator(_table), Tag("{}")]
    _choice, _dumped = Discriminator(_tag), PlainSerializer(_written)

    VariedNumber = Annotated[
        Annotated[Number, Tag("")] | _Table, _choice, AfterValidator(_mean), _dumped
    ]
    """A number, or one that differs between units."""

    VariedPositive = Annotated[
        Annotated[Positive, Tag("")] | _Table,
        _choice, AfterValidator(_from_zero), AfterValidator(_mean), _dumped,
    ]  # fmt: skip
    """A number above 0, in every unit."""

    VariedNonNegative = Annotated[
        Annotated[NonNegative, Tag("")] | _Table,
        _choice, AfterValidator(_from_zero), AfterValidator(_mean), _dumped,
    ]  # fmt: skip
    """A number from 0 on, above 0 in every unit where it differs."""


def varied(part: Any, key: str = "") -> Iterator[tuple[str, BetweenUnits]]:
    """Each key of a scene or a part whose number differs between units, with its distribution."""
    if isinstance(part, Mean):
        yield key, part.between_units
    elif isinstance(part, BaseModel):
        for name, field in type(part).model_fields.items():
            value = getattr(part, name)
            if isinstance(value, Mean | BaseModel | tuple):  # most values are plain
                yield from varied(value, f"{key}.{field.alias or name}".lstrip("."))
    elif isinstance(part, tuple):
        for number, each in enumerate(part):
            yield from varied(each, f"{key}.{number}")


def mean_unit(part: Part) -> Part:
    """A scene or a part in which nothing differs between units: all numbers are at their means."""
    own = {name: getattr(part, name) for name in type(part).model_fields}
    plain = {name: _at_mean(value) for name, value in own.items() if any(varied(value))}
    return part.model_copy(update=plain) if plain else part


def _at_mean(value: Any) -> Any:
    if isinstance(value, Mean):
        return float(value)
    if isinstance(value, tuple):
        return tuple(map(_at_mean, value))
    return mean_unit(value) if isinstance(value, BaseModel) else value
