"""Claims at two prices; the tolerances of statistical ones come from standard errors at either."""

from __future__ import annotations

from collections.abc import Container, Iterable, Sequence
from typing import Any

import pytest
from _pytest.mark.structures import ParameterSet


def rel_errors(quick: float, fine: float) -> pytest.MarkDecorator:
    """The `rel_error` of a test in `make test`, and the one in `make verify`."""
    return pytest.mark.parametrize(
        "rel_error", [quick, pytest.param(fine, marks=pytest.mark.verify)]
    )


def quick_cases(
    names: str | Sequence[str],
    cases: Iterable[Any],
    *,
    keep: Container[int],
    ids: Any = None,
) -> pytest.MarkDecorator:
    """Cases of which `make test` runs those with the numbers `keep`, and `make verify` the others.

    What is parametrised, and its `ids`, are written as for `pytest.mark.parametrize`.
    """
    several = "," in names if isinstance(names, str) else True
    marked = []
    for number, case in enumerate(cases):
        if not isinstance(case, ParameterSet):
            case = pytest.param(*case) if several else pytest.param(case)
        marks = case.marks if number in keep else (*case.marks, pytest.mark.verify)
        marked.append(pytest.param(*case.values, id=case.id, marks=marks))
    return pytest.mark.parametrize(names, marked, ids=ids)
