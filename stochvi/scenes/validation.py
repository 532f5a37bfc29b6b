"""Checks of the parts of a scene. Chapters: the base class, types of keys, and sentences for what
is wrong; a number that scatters; integrals of a function; a number that differs between units of a
production."""

from __future__ import annotations

import contextlib
import difflib
import inspect
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from types import NoneType, UnionType
from typing import (
    TYPE_CHECKING,
    Annotated,
    Any,
    ClassVar,
    Generic,
    Literal,
    Self,
    TypeVar,
    Union,
    get_args,
    get_origin,
)

import numpy as np
from numpy.typing import NDArray
from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Discriminator,
    Field,
    ModelWrapValidatorHandler,
    PlainSerializer,
    Tag,
    ValidationError,
    ValidationInfo,
    model_validator,
)
from pydantic_core import CoreSchema, PydanticKnownError
from pydantic_core.core_schema import tagged_union_schema, with_info_plain_validator_function

from stochvi.mathematics.numerics import Vector, gauss_legendre
from stochvi.mathematics.units import (
    explain_methods,
    measured,
    number_to_write,
    plain_number,
)
from stochvi.results.errors import SceneError, beyond_arithmetic
from stochvi.scenes.outside import Parts


def _plain_number(value: Any) -> Any:
    """A number of numpy as a number of Python, so that booleans and complex numbers are refused."""
    return value.item() if getattr(value, "shape", None) == () else value


Number = Annotated[float, BeforeValidator(_plain_number), Field(strict=True, allow_inf_nan=False)]
Positive = Annotated[Number, Field(gt=0)]
NonNegative = Annotated[Number, Field(ge=0)]


def _seconds(value: Any) -> Any:
    """A text with a unit of time, as "90 min", in seconds."""
    return measured(value, "time") if isinstance(value, str) else value


Seconds = Annotated[Positive, BeforeValidator(_seconds)]
"""A time, s, or a text with its unit."""


Tolerance = Annotated[NonNegative, Field(lt=1)]
"""A relative tolerance; at 1 the quantity could vanish."""


def plain_numbers(values: Any) -> Any:
    """An array or a frame as lists, which pydantic knows; anything else as it is."""
    if hasattr(values, "to_numpy"):
        return values.to_numpy().tolist()
    return values.tolist() if hasattr(values, "tolist") else values


Column = Annotated[tuple[Positive, ...], BeforeValidator(plain_numbers)]
"""A column of a table: positive numbers, from a sequence or an array."""

Numbers = Annotated[tuple[Number, ...], BeforeValidator(plain_numbers)]
"""A column of a table that may hold any number."""

NonNegatives = Annotated[tuple[NonNegative, ...], BeforeValidator(plain_numbers)]
"""A column of a table that may hold zeros."""


def _whole(value: Any) -> Any:
    """A whole number that is written as 2.0, as sweeps do, without its point."""
    value = plain_number(value)
    return int(value) if isinstance(value, float) and value.is_integer() else value


Count = Annotated[int, BeforeValidator(_whole), Field(strict=True, ge=1)]
"""A whole number from 1 on."""


def _column_name(value: Any) -> Any:
    if not isinstance(value, str | int) or isinstance(value, bool) or value == "":
        raise ValueError(f"must be the name of a column, or its number from 1, got {value!r}")
    return value


ColumnName = Annotated[str | int, BeforeValidator(_column_name)]
"""A column of a file, by its name or its number, from 1."""

Names = Annotated[tuple[str, ...], BeforeValidator(plain_numbers), Field(min_length=1)]
"""Names of variables in a file."""


def _rising(band: tuple[float, float]) -> tuple[float, float]:
    if band[0] >= band[1]:
        raise ValueError(f"must rise, got [{band[0]:g}, {band[1]:g}]")
    return band


Band = Annotated[tuple[Positive, Positive], BeforeValidator(plain_numbers), AfterValidator(_rising)]
"""A lowest and a highest frequency."""

Matrix = Annotated[tuple[tuple[Number, ...], ...], BeforeValidator(plain_numbers)]
"""A matrix, row by row."""


def _weighted(weights: dict[str, float]) -> dict[str, float]:
    if not any(weights.values()):
        raise ValueError(f"must hold a weight other than 0 of one place at least, got {weights}")
    return weights


Weights = Annotated[dict[str, Number], AfterValidator(_weighted)]
"""Weights of places by their names: a pair or a force acts on the weighted sum of their motions."""


def _name_of(function: Any) -> str:
    """Module and name of a function; for an object that can be called, those of its class."""
    named = function if hasattr(function, "__qualname__") else type(function)
    return f"{named.__module__}.{named.__qualname__}"


Function = Annotated[Callable[..., Any], PlainSerializer(_name_of, return_type=str)]
"""A function from an array to an array of the same shape, which only Python can give; in the
document of a scene it is its name."""


def arguments_fault(function: Any, numbers: int = 2) -> str:
    """Why a function does not take so many numbers, as far as Python knows its arguments, or ""."""
    try:
        inspect.signature(getattr(function, "py_func", function)).bind(*[0.0] * numbers)
    except TypeError as error:
        return str(error)
    except ValueError:  # a function of C
        return ""
    return ""


def evaluated(function: Callable[..., Any], places: NDArray[np.float64]) -> NDArray[np.float64]:
    """Values at `places`; if a function returns one number, this number at every place."""
    values = np.asarray(function(places), dtype=float)
    return np.array(np.broadcast_to(values, places.shape))


def check_values(
    name: str, function: Callable[..., Any], places: NDArray[np.float64]
) -> NDArray[np.float64]:
    """The values at `places` of the function that is given as the key `name`.

    Raises a ValueError unless they are finite numbers, one for each place.
    """
    try:
        values = evaluated(function, places)
    except Exception as error:
        raise ValueError(
            f"needs {name} that takes an array and returns one of the same shape, got "
            f"{type(error).__name__}: {error}"
        ) from None
    wrong = ~np.isfinite(values)
    if wrong.any():
        raise ValueError(
            f"needs {name} with finite values, got {values[wrong][0]:g} at {places[wrong][0]:g}"
        )
    return values


if TYPE_CHECKING:
    from pydantic._internal._model_construction import ModelMetaclass
else:
    ModelMetaclass = type(BaseModel)


class _Keyed(ModelMetaclass):
    """The class of classes of parts, whose signature is their keys as keywords, those that they
    need first. Pydantic's own tells every validator: that of `ImpactPair` has 8,705 letters."""

    @property
    def __signature__(cls: type[BaseModel]) -> inspect.Signature:  # type: ignore[misc]
        keys = [
            inspect.Parameter(
                name,
                inspect.Parameter.KEYWORD_ONLY,
                default=inspect.Parameter.empty if field.is_required() else field.default,
                annotation=Spelt(_spelling(field.annotation)),
            )
            for name, field in cls.model_fields.items()
            if name != "kind"
        ]
        return inspect.Signature(sorted(keys, key=lambda key: key.default is not key.empty))

    @__signature__.setter
    def __signature__(cls, signature: object) -> None:
        """Pydantic sets its own when it builds a class."""


class Spelt(str):
    """The words of an annotation, which `help` shows as they are."""

    __repr__ = str.__str__


def _spelling(annotation: Any) -> str:
    """An annotation without what checks its values, in names of classes."""
    kind, inner = get_origin(annotation), get_args(annotation)
    if kind is Annotated:
        return _spelling(inner[0])
    if kind is Literal:
        return " | ".join(map(repr, inner))
    if kind in (Union, UnionType):
        if len(inner) > MOST_KINDS:
            kinds: list[tuple[type, ...]] = [each.__mro__ for each in inner]
            return next(each.__name__ for each in kinds[0] if all(each in own for own in kinds))
        return " | ".join(dict.fromkeys(map(_spelling, inner)))
    if kind is tuple and inner[-1] is Ellipsis:
        return f"tuple[{_spelling(inner[0])}, ...]"
    if annotation is NoneType:
        return "None"
    name = getattr(kind or annotation, "__name__", str(annotation))
    return f"{name}[{', '.join(map(_spelling, inner))}]" if inner and kind in GENERIC else name


MOST_KINDS = 10
"""Most kinds of a part that an annotation lists; of more it tells the class that they share."""

GENERIC = (tuple, list, dict)
"""Classes whose values an annotation tells."""


class Checked(BaseModel, metaclass=_Keyed):
    """Base of every part of a scene: immutable, unknown keys refused, no silent conversion."""

    model_config = ConfigDict(
        frozen=True,
        extra="forbid",
        populate_by_name=True,
        hide_input_in_errors=True,
        defer_build=True,
    )

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        explain_methods(cls)

    own: ClassVar[str] = "give its keys"
    """The class that takes a user's own behaviour in place of a subclass, in words."""

    @model_validator(mode="wrap")  # the other modes do not see the class that a key asks for
    @classmethod
    def _of_this_class(cls, value: Any, validated: ModelWrapValidatorHandler[Self]) -> Self:
        cls.refuse_subclass(value)
        return validated(value)

    @classmethod
    def refuse_subclass(cls, value: Any) -> None:
        """Raise a ValueError for a part of a user's subclass of this class.

        Each method reads either the numbers or the functions of a part. An override in a subclass
        would act in some methods and not in others.
        """
        if isinstance(value, cls) and type(value) is not cls:
            raise ValueError(
                f"must be of the class {cls.__name__} itself, as methods would follow a subclass "
                f"only in part, got {type(value).__name__}; {cls.own}"
            )

    def __init__(self, *args: Any, **data: Any) -> None:
        if args:
            known = ", ".join(f"{name}=..." for name in type(self).model_fields if name != "kind")
            raise TypeError(f"{type(self).__name__} takes keywords only: {known}")
        try:
            super().__init__(**data)
        except ValidationError as error:
            raise SceneError(_problems(error, type(self))) from None
        except ArithmeticError as error:
            raise SceneError(beyond_arithmetic(error, data)) from None

    def __repr_args__(self) -> Iterator[tuple[str, Any]]:
        """The keys that were given: what a user writes to make the part."""
        for name, field in type(self).model_fields.items():
            value = getattr(self, name)
            if value is not None and (field.is_required() or value != field.default):
                yield name, value

    def __dir__(self) -> list[str]:
        """The names of the part, without those that pydantic gives to all its models."""
        ours = {name for each in type(self).__mro__ if each not in FOREIGN for name in vars(each)}
        ours = ours - vars(BaseModel).keys() | type(self).model_fields.keys()
        return sorted(name for name in ours if name[0] != "_")

    if not TYPE_CHECKING:  # where the values of frozen parts have no setters at all

        def __setattr__(self, name: str, value: Any) -> None:
            try:
                super().__setattr__(name, value)
            except ValidationError:
                remedy = f"replace({name}=...) makes a part with another value"
                raise SceneError(name, f"is frozen; {remedy}") from None

    def model_copy(self, *, update: Mapping[str, Any] | None = None, deep: bool = False) -> Self:
        """A copy with other values, which are not checked; `replace` checks them.

        What was calculated from the old values is calculated anew.
        """
        copy = super().model_copy(update=update, deep=deep)
        for calculated in set(copy.__dict__) - set(type(self).model_fields):
            del copy.__dict__[calculated]
        return copy

    def replace(self, **changes: Any) -> Self:
        """The part with other values of some keys, checked as a new one is.

        Parameters
        ----------
        **changes
            Keys and their new values; None takes a key out.

        Returns
        -------
        Self
            The new part; the old one stays as it is.

        Raises
        ------
        SceneError
            If the new part is not valid.

        Examples
        --------
        >>> from stochvi.scenes.structures import Isolator
        >>> mount = Isolator(frequency_hz=12.0, zeta=0.1)
        >>> mount.replace(frequency_hz=10.0).zeta, mount.replace(zeta=None, Q=5.0).Q
        (0.1, 5.0)
        """
        kept = {
            name: value
            for name, field in type(self).model_fields.items()
            if (value := getattr(self, name)) is not None and field.alias not in changes
        }
        return type(self)(**(kept | changes))


FOREIGN = (*BaseModel.__mro__, Generic)
"""Classes whose names are not those of a part."""


class OneOf:
    """One of several parts, which its key `kind` tells: only the part that is named is built.

    Pydantic's own union builds all of them, which takes longer than a short simulation.

    Parameters
    ----------
    kinds : classes with a default of their key `kind`.
    group : the entry points by which other packages add classes, as "laws".
    bases : classes that those of other packages, and of a user, are derived from.
    usual : the kind of a part that does not say it; None where it has to.
    """

    def __init__(
        self, kinds: Iterable[type[Checked]], group: str, bases: tuple[type[Checked], ...],
        usual: str | None = None,
    ) -> None:  # fmt: skip
        self.shipped = {str(kind_of(each)): each for each in kinds}
        self.kinds = Parts(group, self.shipped, self._own_class)
        self._bases = bases
        self._usual = usual

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> CoreSchema:
        return with_info_plain_validator_function(self._validated)

    def __get_pydantic_json_schema__(self, schema: Any, handler: Any) -> dict[str, Any]:
        for each in self.shipped.values():
            each.model_rebuild()
        built = {kind: each.__pydantic_core_schema__ for kind, each in self.shipped.items()}
        found: dict[str, Any] = handler(tagged_union_schema(built, "kind"))
        return found

    def _validated(self, value: Any, info: ValidationInfo) -> Checked:
        kind = value.get("kind") if isinstance(value, dict) else getattr(value, "kind", None)
        kind = self._usual if kind is None else kind
        if kind is None and type(value) is not dict and type(value).__module__ == "builtins":
            raise PydanticKnownError("model_attributes_type")
        if kind is None:
            raise PydanticKnownError("union_tag_not_found", {"discriminator": "'kind'"})
        if isinstance(value, self._bases) and kind not in self.shipped:
            self.kinds[kind] = self._own_class(kind, type(value))
        if not isinstance(kind, str) or kind not in self.kinds:
            expected = ", ".join(map(repr, self.kinds))
            raise PydanticKnownError(
                "union_tag_invalid",
                {"discriminator": "'kind'", "tag": str(kind), "expected_tags": expected},
            )
        named = self.kinds[kind]
        if isinstance(value, Checked) and not isinstance(value, named):
            raise ValueError(f"has kind {kind!r}, which is that of {named.__name__}; "
                             f"give {type(value).__name__} a kind of its own")  # fmt: skip
        found: Checked = named.__pydantic_validator__.validate_python(value, context=info.context)
        return found

    def _own_class(self, kind: str, part: Any) -> type[Checked]:
        """The class of a user's own kind of part, if methods can follow it."""
        bases = " or ".join(each.__name__ for each in self._bases)
        if not (isinstance(part, type) and issubclass(part, self._bases)):
            raise ValueError(f"must be a class derived from {bases}, got {part!r}")
        for each in self.shipped.values():
            if issubclass(part, each):
                raise ValueError(
                    f"must not be derived from {each.__name__}, as methods would follow "
                    f"{part.__name__} only in part; derive it from {bases}"
                )
        if kind_of(part) != kind:
            raise ValueError(f"must have kind: Literal[{kind!r}] = {kind!r}, got {kind_of(part)!r}")
        if lacking := sorted(part.__abstractmethods__):
            raise ValueError(f"must define {', '.join(lacking)}")
        return part


def kind_of(part: type[BaseModel]) -> str | None:
    """The kind that a class of parts states, None of one that states none."""
    found = getattr(part.model_fields.get("kind"), "default", None)
    return found if isinstance(found, str) else None


def _problems(error: ValidationError, model: type[BaseModel]) -> list[tuple[str, str]]:
    """The (key, sentence) pairs of a validation error, including those of inner errors."""
    problems: list[tuple[str, str]] = []
    for detail in error.errors(include_url=False):
        path = _path(detail["loc"])
        cause = detail.get("ctx", {}).get("error")
        if isinstance(cause, SceneError):
            problems += [(_key([*path, key]), text) for key, text in cause.problems]
        elif detail["type"] == "extra_forbidden":
            problems.append((_key(path), _unknown_key(str(path[-1]), model)))
        else:
            problems.append((_key(path), _sentence(detail)))
    return problems


PYTHON_ONLY = ("nonlinear", "function")
"""Kinds of parts that hold functions, which a scene file cannot express."""


def _path(location: Sequence[Any]) -> list[Any]:
    """The keys of a location; of lists of which one part needs no number, the first has none."""
    return [
        key
        for before, key in zip([None, *location], location, strict=False)
        if not (key == 0 and before in ("spring", "damper"))
    ]


UNNAMED = ("", "{}", "[]")
"""Parts of the path of an error that stand for the form of a value, and are no keys."""


def _key(path: Sequence[Any]) -> str:
    return ".".join(str(part) for part in path if part not in UNNAMED)


def _unknown_key(key: str, model: type[BaseModel]) -> str:
    known = [field.alias or name for name, field in model.model_fields.items()]
    in_small = {name.lower(): name for name in known}
    (nearest,) = difflib.get_close_matches(key.lower(), in_small, n=1, cutoff=0.0)
    near = next((name for name in SYMBOLS.get(key, ()) if name in known), in_small[nearest])
    remark = ANGULAR if key in ("omega", "w") and near == "frequency_hz" else ""
    return f"is not a known key; did you mean {near!r}{remark}? (known here: {', '.join(known)})"


SYMBOLS: dict[str, tuple[str, ...]] = {
    "S0": ("intensity",),
    "psd": ("density", "profile"),
    "omega": ("frequency_hz",),
    "w": ("frequency_hz",),
    "f": ("frequency_hz",),
    "m": ("mass", "modal_mass"),
    "E": ("young",),
    "rho": ("density",),
    "I": ("second_moment",),
    "A": ("area",),
    "M": ("mass",),
    "c": ("damping",),
    "C": ("damping",),
    "b": ("damping",),
    "k": ("stiffness", "coefficient"),
    "K": ("stiffness", "coefficient"),
    "z": ("zeta", "damping_ratio"),
    "zeta": ("damping_ratio",),
    "damping_ratio": ("zeta",),
    "stop": ("impact_pair",),
    "stops": ("impact_pair",),
    "R": ("coefficient", "restitution"),
    "e": ("coefficient", "restitution"),
    "restitution": ("coefficient",),
    "gap": ("clearance", "play"),
    "force": ("magnitude", "amplitude"),
}
"""Symbols and words of the field that are no keys, each with the keys that hold it, the likeliest
first; no spelling leads from one to the other."""

ANGULAR = " (omega / 2 pi)"
"""A frequency in hertz over the circular frequency."""


def _sentence(detail: Any) -> str:
    """One sentence for one pydantic error: what was expected, and what was got."""
    got = _short(detail.get("input"))
    limits = detail.get("ctx", {})
    match detail["type"]:
        case "missing":
            return "is missing"
        case "greater_than":
            return f"must be greater than {limits['gt']:g}, got {got}"
        case "greater_than_equal":
            return f"must be at least {limits['ge']:g}, got {got}"
        case "less_than":
            return f"must be less than {limits['lt']:g}, got {got}"
        case "less_than_equal":
            return f"must be at most {limits['le']:g}, got {got}"
        case "float_type" | "finite_number":
            return f"must be a finite number, got {got}{number_to_write(detail.get('input'))}"
        case "int_type":
            return f"must be a whole number, got {got}"
        case "bool_type":
            return f"must be true or false, got {got}"
        case "literal_error":
            return f"must be {limits['expected']}, got {got}"
        case "union_tag_invalid":
            tags = limits["expected_tags"].split(", ")
            kinds = ", ".join(tag for tag in tags if tag.strip("'") not in PYTHON_ONLY)
            return f"has kind {limits['tag']!r}, expected {kinds}"
        case "union_tag_not_found":
            return f"needs the key {limits['discriminator']}, got {got}"
        case "tuple_type" | "list_type":
            return f"must be a list, got {got}"
        case "model_type" | "dict_type" | "model_attributes_type":
            return f"must be a table of keys, got {got}"
        case "string_type":
            return f"must be a text, got {got}"
        case "callable_type":
            return f"must be a function, got {got}"
        case "value_error":
            if isinstance(limits["error"], np.linalg.LinAlgError):
                return beyond_arithmetic(limits["error"], detail.get("input"))
            return str(limits["error"])
        case _:
            return f"is not valid ({detail['msg']}), got {got}"


def given(part: BaseModel, *names: str) -> str:
    """Which of the keys `names` have a value, in words."""
    return ", ".join(name for name in names if getattr(part, name) is not None) or "none"


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


@contextlib.contextmanager
def sentences_of(key: str) -> Iterator[None]:
    """Give the key `key` to every problem in a SceneError that names no key."""
    try:
        yield
    except SceneError as error:
        raise SceneError([(name or key, text) for name, text in error.problems]) from None


# ------------------------------------------------------------------------------
# A number of a scene that scatters: its mean and its standard deviation.
# ------------------------------------------------------------------------------


class Scatter(Checked):
    """Mean and standard deviation of a number that scatters.

    The key that holds it says what its distribution is, and when it is drawn: a restitution at each
    impact, from a beta distribution.

    Parameters
    ----------
    mean
        Mean, in the unit of the key.
    std
        Standard deviation, in the same unit; 0 for a number that does not scatter.

    See Also
    --------
    stochvi.Restitution : A restitution that scatters from impact to impact.

    Examples
    --------
    >>> from stochvi import Restitution
    >>> law = Restitution(coefficient=Scatter(mean=0.7, std=0.1))
    >>> law.restitution, round(law.restitution_mean_square, 12)
    (0.7, 0.5)
    """

    mean: Number
    std: NonNegative

    def __str__(self) -> str:
        return f"{self.mean:g} ± {self.std:g}"


def _tag(value: Any) -> str:
    return "{}" if isinstance(value, dict | Scatter) else ""


Scattered = Annotated[
    Annotated[Number, Tag("")] | Annotated[Scatter, Tag("{}")], Discriminator(_tag)
]
"""A number, or one that scatters."""


# ------------------------------------------------------------------------------
# The integral of a function of one's own, such as the energy of a force.
# ------------------------------------------------------------------------------


NODES, WEIGHTS = gauss_legendre(16)
"""Nodes and weights of the Gauss-Legendre rule on each interval of an integral of a force."""

MOST_HALVINGS = 60
"""Largest number of times that an interval about a kink or a jump is halved."""

QUADRATURE_ERROR = 1e-14
"""Relative change of an integral, when an interval is halved, below which it counts as rounding."""


def integral_of(function: Function, ends: Vector) -> Vector:
    """Integral from 0 to each end: from one end to the next, halved where that changes anything."""
    places = np.unique(np.append(ends.ravel(), 0.0))
    starts, stops = places[:-1], places[1:]
    owner = np.arange(len(starts))
    parts = np.zeros(len(starts))
    for _ in range(MOST_HALVINGS):
        middle = (starts + stops) / 2.0
        whole, size = _panel(function, starts, stops)
        halves = _panel(function, starts, middle)[0] + _panel(function, middle, stops)[0]
        scale = np.maximum(np.abs(starts), np.abs(stops)) * size
        with np.errstate(invalid="ignore"):  # forces that are infinite are integrated as such
            open_ = np.abs(halves - whole) > QUADRATURE_ERROR * scale
        np.add.at(parts, owner[~open_], halves[~open_])
        if not np.any(open_):
            break
        starts, middle, stops, owner = starts[open_], middle[open_], stops[open_], owner[open_]
        last = halves[open_]
        starts, stops = np.concatenate([starts, middle]), np.concatenate([middle, stops])
        owner = np.concatenate([owner, owner])
    else:
        np.add.at(parts, owner[: len(last)], last)
    # added up outwards from 0: large energies far out take no digits from small ones
    zero = int(np.searchsorted(places, 0.0))
    left, right = -np.cumsum(parts[:zero][::-1])[::-1], np.cumsum(parts[zero:])
    energy = np.concatenate([left, [0.0], right])
    return np.asarray(energy[np.searchsorted(places, ends)])


def _panel(function: Function, starts: Vector, stops: Vector) -> tuple[Vector, Vector]:
    """Integral over each interval, and the largest value in it."""
    half = (stops - starts) / 2.0
    nodes = ((starts + stops) / 2.0)[:, None] + half[:, None] * NODES
    values = evaluated(function, nodes)
    return np.asarray(half * (values @ WEIGHTS)), np.abs(values).max(axis=1)


# ------------------------------------------------------------------------------
# A number of a scene that differs between the units of a production: its mean and its width.
# ------------------------------------------------------------------------------


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


def _spread_tag(value: Any) -> str:
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
    _choice, _dumped = Discriminator(_spread_tag), PlainSerializer(_written)

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
