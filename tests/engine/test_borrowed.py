"""What is borrowed is what it was made from; owners are not counted, and tuples are addresses."""

from __future__ import annotations

import sys
from typing import Any, NamedTuple

import numba
import numpy as np
import pytest
from numba.core.errors import TypingError

from stochvi.engine.borrowed import borrowed, hold, type_of_borrowed
from stochvi.engine.compiling import kernel


class Inner(NamedTuple):
    """Arrays in a tuple of a tuple."""

    numbers: np.ndarray
    counts: np.ndarray
    absent: None


class Outer(NamedTuple):
    """A tuple that holds another one."""

    table: np.ndarray
    inner: Inner
    step: float


@kernel
def add(outer, text):
    """Change all arrays; returns what was given with them."""
    outer.table[1, 0] += outer.step
    outer.inner.numbers[2] -= 1.0
    outer.inner.counts[0] += 1
    return text


@kernel
def borrow_and_add(outer, text):
    """Borrow twice: a borrowed array is borrowed as it is."""
    again = borrowed(borrowed(outer))
    return add(again, borrowed(text))


@kernel
def ask_for_more(outer):
    """Ask a tuple for a member that it has not."""
    return borrowed(outer).inner.more


@kernel
def make_and_sum(size):
    """The sum of an array that is made, changed and given back here."""
    room = Inner(np.zeros(size), np.ones(size, np.int64), None)
    lent = borrowed(room)
    for i in range(size):
        lent.numbers[i] += lent.counts[i] + i
    total = lent.numbers.sum()
    hold(room)
    return total


def arrays() -> Outer:
    inner = Inner(np.arange(4.0), np.zeros(2, np.int64), None)
    return Outer(np.arange(6.0).reshape(3, 2), inner, 0.5)


def owners(outer: Outer) -> list[int]:
    each: tuple[Any, ...] = (outer.table, outer.inner.numbers, outer.inner.counts)
    return [sys.getrefcount(array) for array in each]


def test_what_is_borrowed_is_changed() -> None:
    outer, before = arrays(), None
    for _ in range(2):
        before = owners(outer)
        assert borrow_and_add(outer, "text") == "text"
    assert owners(outer) == before
    assert outer.table[1, 0] == 3.0
    assert outer.inner.numbers.tolist() == [0.0, 1.0, 0.0, 3.0]
    assert outer.inner.counts.tolist() == [2, 0]


def test_a_tuple_is_handed_on_by_its_address() -> None:
    kind, context = type_of_borrowed(None)(numba.typeof(arrays())), add.targetctx
    assert context.get_value_type(kind).is_pointer and kind.instance_class is Outer
    assert not context.get_value_type(kind.kind).is_pointer


def test_what_a_tuple_does_not_have_is_asked_for_in_vain() -> None:
    with pytest.raises(TypingError, match="Unknown attribute 'more'"):
        ask_for_more(arrays())


def test_an_array_lives_as_long_as_it_is_held() -> None:
    assert [make_and_sum(1000) for _ in range(100)] == [1000.0 + 499500.0] * 100
