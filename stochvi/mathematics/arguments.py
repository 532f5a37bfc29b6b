"""Checks of plain arguments against their annotations: what is wrong is said in a sentence."""

from __future__ import annotations

import functools
import inspect
import numbers
import os
from collections.abc import Callable, Mapping, Sequence
from typing import Any, ParamSpec, TypeVar

import numpy as np

P = ParamSpec("P")
T = TypeVar("T")

MOST_SHOWN = 60
"""Largest number of characters of a wrong value that a message repeats."""

LARGEST_WHOLE = 2**63
"""Whole numbers below this one fit into the numbers of compiled code."""

LARGEST_NUMBER = 10**300
"""Whole numbers below this one can be converted to numbers of double precision."""


def shown(value: object) -> str:
    """A wrong value as a message repeats it: its beginning, whatever it is.

    >>> shown("x" * 100)[-8:], shown(10**5000)
    ('xxxxx...', 'something of type int')
    """
    try:
        text = "an array" if isinstance(value, np.ndarray) else " ".join(repr(value).split())
    except Exception:  # what cannot be shown is named
        text = f"something of type {type(value).__name__}"
    return text if len(text) <= MOST_SHOWN else text[: MOST_SHOWN - 3] + "..."


def _wrong(name: str, wanted: str, value: object) -> ValueError:
    return ValueError(f"{name} must be {wanted}, got {shown(value)}")


def _check_number(name: str, value: object) -> None:
    known = isinstance(value, numbers.Real)
    if not known or (isinstance(value, int) and abs(value) >= LARGEST_NUMBER):
        raise _wrong(name, "a number", value)


def _check_whole(name: str, value: object) -> None:
    if not isinstance(value, numbers.Integral):
        raise _wrong(name, "a whole number", value)
    if not -LARGEST_WHOLE <= int(value) < LARGEST_WHOLE:
        raise _wrong(name, "a whole number below 2^63", value)


def _check_numbers(name: str, value: object) -> None:
    try:
        array = np.asarray(value)
        known = array.dtype.kind in "biuf" or (array.dtype.kind == "O" and _all_real(array))
        if known:
            array.astype(float)
    except (TypeError, ValueError, OverflowError):  # ragged, or too large
        known = False
    if not known:
        raise _wrong(name, "numbers", value)


def _all_real(array: np.ndarray[Any, Any]) -> bool:
    return all(isinstance(each, numbers.Real) for each in array.ravel())


def _check_row(name: str, value: object) -> None:
    _check_numbers(name, value)
    if np.ndim(value) != 1:  # type: ignore[arg-type]
        raise _wrong(name, "a list of numbers", value)


def _check_rows(name: str, value: object) -> None:
    _check_numbers(name, value)
    if np.ndim(value) == 0:  # type: ignore[arg-type]
        raise _wrong(name, "a list of numbers", value)


def _check_texts(name: str, value: object) -> None:
    several = isinstance(value, Sequence) and not isinstance(value, str)
    if not several or not all(isinstance(each, str) for each in value):  # type: ignore[attr-defined]
        raise _wrong(name, "a list of texts", value)


def _is_a(kind: type | tuple[type, ...], wanted: str) -> Callable[[str, object], None]:
    def check(name: str, value: object) -> None:
        if not isinstance(value, kind):
            raise _wrong(name, wanted, value)

    return check


def _check_table(name: str, value: object) -> None:
    if not isinstance(value, Mapping):
        raise _wrong(name, "a table of names and values", value)
    for key, each in value.items():
        _check_row(f"{name} of {shown(key)}", each)


def _named(kind: str, said: str = "") -> Callable[[str, object], None]:
    """A check for a class that this room does not know, which messages may call otherwise."""
    said = said or kind
    wanted = f"an {said}" if said[0] in "AEIOU" else f"a {said}"

    def check(name: str, value: object) -> None:
        if kind not in [each.__name__ for each in type(value).__mro__]:
            raise _wrong(name, wanted, value)

    return check


def _check_callable(name: str, value: object) -> None:
    if not callable(value):
        raise _wrong(name, "a function", value)


CHECKS: dict[str, Callable[[str, Any], None]] = {
    "float": _check_number,
    "int": _check_whole,
    "str": _is_a(str, "a text"),
    "ArrayLike": _check_numbers,
    "Sequence[float]": _check_row,
    "Sequence[float] | Matrix": _check_rows,
    "Sequence[str]": _check_texts,
    "str | Path": _is_a((str, os.PathLike), "the name of a file"),
    "Progress": _check_callable,
    "Mapping[str, Sequence[float]]": _check_table,
    "Mapping[str, float]": _is_a(Mapping, "a table of names and numbers"),
    **{
        f"Mapping[str, {kind}]": _is_a(Mapping, f"a table of names and values of {kind}")
        for kind in ("Scene", "Spread", "Statistic")
    },
    **{kind: _named(kind) for kind in ("Sizing", "Problem", "Estimate", "Tolerances", "Axes")},
    "Excitation": _named("BaseExcitation", "Excitation"),
}
"""Checks of arguments by their annotation, which may also allow None."""

LEFT_OUT = " | None"
"""End of the annotation of an argument that may be left out."""


def _checks_of(function: Callable[..., Any]) -> dict[str, tuple[Callable[[str, Any], None], bool]]:
    """The check of each plain argument, and whether it may be None."""
    checks = {}
    for name, each in inspect.signature(function).parameters.items():
        kind = each.annotation
        kind = kind if isinstance(kind, str) else inspect.formatannotation(kind)
        plain = kind.removesuffix(LEFT_OUT)
        if plain.startswith("Callable["):
            plain = "Progress"
        if plain in CHECKS:
            checks[name] = CHECKS[plain], kind.endswith(LEFT_OUT)
    return checks


def argument_checker(function: Callable[..., Any]) -> Callable[..., inspect.BoundArguments]:
    """A function that checks the arguments of a call of `function`, and returns them.

    It raises ValueError, or TypeError where arguments are missing or unknown. Whole numbers too
    large for numpy are returned in double precision where any number is allowed.
    """
    signature, checks = inspect.signature(function), _checks_of(function)

    def check(*args: Any, **kwargs: Any) -> inspect.BoundArguments:
        bound = signature.bind(*args, **kwargs)
        given = bound.arguments
        for name, (raise_if_wrong, optional) in checks.items():
            if name in given and not (optional and given[name] is None):
                several = signature.parameters[name].kind is inspect.Parameter.VAR_POSITIONAL
                for each in given[name] if several else (given[name],):
                    raise_if_wrong(name, each)
                if isinstance(given[name], int) and abs(given[name]) >= LARGEST_WHOLE:
                    given[name] = float(given[name])
        return bound

    return check


def checked(function: Callable[P, T]) -> Callable[P, T]:
    """A function whose plain arguments are checked.

    >>> @checked
    ... def twice(number: float) -> float:
    ...     return 2.0 * number
    >>> twice("a")
    Traceback (most recent call last):
    ValueError: number must be a number, got 'a'
    """
    check = argument_checker(function)

    @functools.wraps(function)
    def run(*args: P.args, **kwargs: P.kwargs) -> T:
        bound = check(*args, **kwargs)
        return function(*bound.args, **bound.kwargs)

    return run


def check_methods(kind: type) -> None:
    """Let the public methods of a class check their plain arguments, as `checked` does.

    >>> class Scale:
    ...     def twice(self, number: float) -> float:
    ...         return 2.0 * number
    >>> check_methods(Scale)
    >>> Scale().twice([1.0])
    Traceback (most recent call last):
    ValueError: number must be a number, got [1.0]
    """
    for name, each in list(vars(kind).items()):
        if not name.startswith("_") and inspect.isfunction(each) and _checks_of(each):
            setattr(kind, name, checked(each))
