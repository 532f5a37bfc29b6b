"""Claims at two prices, whose tolerances come from standard errors at either; what agrees within
stated errors, and what must not; estimates from samples; the run of a part of a calculation."""

from __future__ import annotations

import math
from collections.abc import Container, Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
import pytest
from _pytest.mark.structures import ParameterSet

from stochvi.results.base import Response
from stochvi.results.deadline import Deadline
from stochvi.results.estimates import Estimate
from stochvi.sampling.run import Run
from stochvi.sampling.workers import pool_of
from stochvi.testing import assert_agrees


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


@contextmanager
def run_of(rel_error: float, seed: int = 0, budget: float | None = None) -> Iterator[Run]:
    """A run on one thread."""
    with pool_of(None, 1) as pool:
        yield Run(pool, Deadline.after(budget), seed=seed, rel_error=rel_error)


def estimate(sample: np.ndarray, bias: float = 0.0) -> Estimate:
    error = float(sample.std(ddof=1)) / math.sqrt(len(sample))
    return Estimate(value=float(sample.mean()), standard_error=error, bias=bias)


def apart(one: Estimate, two: Estimate) -> Estimate:
    """The difference of two independent estimates."""
    return Estimate(
        value=one.value - two.value,
        standard_error=math.hypot(one.standard_error or 0.0, two.standard_error or 0.0),
        bias=(one.bias or 0.0) + (two.bias or 0.0),
    )


def assert_same(one: Estimate, two: Estimate) -> None:
    """Two independent estimates agree within the errors that both state."""
    assert_agrees(apart(one, two), 0.0)


def assert_differs(estimate: Estimate, wrong: float) -> None:
    """A control: the estimate is sharp enough to tell a number that is wrong."""
    with pytest.raises(AssertionError, match="differs from"):
        assert_agrees(estimate, wrong)


def assert_balanced(response: Response) -> None:
    """All balances of an answer close."""
    for residual in response.identities.values():
        assert_agrees(residual, 0.0)
