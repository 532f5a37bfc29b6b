"""Exceptions from outside that wait until a compiled function has returned.

numba makes Python objects of arguments and results, and does not look whether a signal handler or
another thread raised an exception meanwhile: the process may crash. `raise_late` therefore only
notes an exception for a thread that is in a compiled function; it is raised once this has returned.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import get_ident
from typing import Any

_inside: set[int] = set()
"""Threads that are in a compiled function."""

_noted: dict[int, type[BaseException]] = {}
"""The exception that waits for a thread."""


def raise_late(thread: int, error: type[BaseException]) -> bool:
    """Note an exception for a thread that is in a compiled function; False where it is in none."""
    if thread not in _inside:
        return False
    _noted[thread] = error
    return True


def undisturbed(call: Callable[..., Any], arguments: tuple[Any, ...], named: dict[str, Any]) -> Any:
    """Call a compiled function, and then raise what was noted for this thread meanwhile."""
    thread = get_ident()
    if thread in _inside:  # compiled code that calls Python that calls compiled code
        return call(*arguments, **named)
    _noted.pop(thread, None)  # what another thread noted too late
    _inside.add(thread)
    try:
        return call(*arguments, **named)
    finally:
        _inside.discard(thread)
        if _noted and (error := _noted.pop(thread, None)) is not None:
            raise error


@contextmanager
def disturbed() -> Iterator[None]:
    """Let exceptions come at once within the `with` block, also in the call of a compiled function:
    numba compiles there, for many seconds, in Python."""
    thread = get_ident()
    inside = thread in _inside
    _inside.discard(thread)
    try:
        yield
    finally:
        if inside:
            _inside.add(thread)
