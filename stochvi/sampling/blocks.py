"""Blocks of paths, and the pieces into which a deadline cuts the work on one of them."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import Any, TypeVar

from stochvi.results.deadline import NEVER, Deadline
from stochvi.sampling.stop_flag import GivenUp, given_up_after

Piece = TypeVar("Piece")

Block = tuple[int, int]
"""Number of the first path of a block, and number of its paths."""

BegunBlock = tuple[int, int, *tuple[Any, ...]]
"""A block, followed by what its paths go on from where they do not begin."""

LANES = 16
"""A piece of a block with more paths than this has a multiple of it: the loops of the kernels over
paths fill vectors of 8 numbers."""

FULL_LANES = 64
"""Number of paths that take hardly longer per step of each than many paths do: at 64 a kernel takes
1.1 times as long, at 16 1.4 times, at 2 ten times (one oscillator, white noise, rigid stops)."""

FEWEST_AT_ONCE = 2
"""Number of paths in the first piece of a block, whose time says how large the next one may be: the
smallest that gives a standard error."""

MORE = 4
"""Factor by which a piece may be larger than the one before."""

PIECE_SECONDS = 0.25
"""Largest expected time in seconds of a piece of a block, so that a budget is overrun by no
more."""

SHORTEST = 1e-6
"""Time in seconds of a block or a path for which the clock measured zero."""


def blocks_of(first_path: int, end: float, size: int) -> Iterator[Block]:
    """Blocks of the paths from `first_path` up to `end`, which may be infinite, cut at the
    multiples of `size`.

    >>> list(blocks_of(5, 12, 4))
    [(5, 3), (8, 4)]
    """
    while first_path < end:
        count = int(min(size - first_path % size, end - first_path))
        yield first_path, count
        first_path += count


def in_pieces(
    make: Callable[[int, int], Piece], first_path: int, paths: int, deadline: Deadline
) -> list[Piece]:
    """Results of `make(first_path, paths)` for successive pieces of a block of paths.

    The deadline is checked between pieces. The remaining paths are left out once it has passed, or
    a path would take clearly longer than the time left. The first piece, of FEWEST_AT_ONCE paths,
    is never left out. A piece that takes longer all the same is given up (`stop_flag`), with
    `GivenUp` where it is the first. The paths do not depend on the pieces.
    """
    if deadline == NEVER:
        return [make(first_path, paths)]
    done: list[Piece] = []
    made, size, each = 0, FEWEST_AT_ONCE, 0.0
    try:
        with given_up_after(deadline):
            while made < paths and (not made or 0.0 < deadline.left > each - PIECE_SECONDS):
                size = min(size, paths - made)
                began = time.perf_counter()
                done.append(make(first_path + made, size))
                each = max((time.perf_counter() - began) / size, SHORTEST)
                made += size
                left = min(PIECE_SECONDS, deadline.left)
                # a few paths take hardly longer than two, so that their price is that of a piece
                more = min(MORE * size, FULL_LANES) if each * size < deadline.left else 1
                size = max(more, int(left / each))
                size -= size % LANES if size > LANES else 0
    except GivenUp:
        if not done:
            raise
    return done
