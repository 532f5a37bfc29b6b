"""Results of blocks that a run keeps, so that it can go on later without doing them again.

The result of a block is a function of the work and the block alone. It is therefore kept under a
digest of the work and the block, and handed on when the same is asked for again: a run that
goes on takes the way of one that never stopped, and finds what it has done before.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from typing import Any

from stochvi.methods.monte_carlo.plain_values import digest_of, from_plain, to_plain

Block = tuple[int, int]
"""Number of the first path of a block, and number of its paths."""


@dataclass
class Entry:
    """Some successive blocks, and their results merged in their order into one value."""

    blocks: list[Block]
    value: Any


class BlockResults:
    """Results of blocks of all works of a run. `changed` is called after each new one, and `begins`
    before the first is asked for."""

    def __init__(
        self, begins: Callable[[], None] | None = None, changed: Callable[[], None] | None = None
    ) -> None:
        self.begins, self.changed = begins, changed
        self.entries: dict[str, dict[int, Entry]] = {}

    def of(self, work: Any) -> dict[int, Entry]:
        """What is known of a work, by the number of the first path."""
        if self.begins is not None:
            self.begins()
        return self.entries.setdefault(digest_of(work), {})

    def add(self, known: dict[int, Entry], entry: Entry) -> None:
        """Keep one more result of a work, of which so much is `known`."""
        known[entry.blocks[0][0]] = entry
        if self.changed is not None:
            self.changed()

    def document(self) -> dict[str, Any]:
        """The results as types that JSON can hold."""
        return {
            work: [
                {"blocks": [list(block) for block in entry.blocks], "value": to_plain(entry.value)}
                for entry in known.values()
            ]
            for work, known in self.entries.items()
        }

    def take(self, document: Mapping[str, Sequence[Mapping[str, Any]]]) -> None:
        """Know what a document holds. ValueError if it cannot be read."""
        for work, entries in document.items():
            self.entries[work] = {
                entry["blocks"][0][0]: Entry(
                    [(first, paths) for first, paths in entry["blocks"]],
                    from_plain(entry["value"]),
                )
                for entry in entries
            }


_kept: ContextVar[BlockResults | None] = ContextVar("kept", default=None)
"""Where the run under way keeps the results of its blocks; None for a run without a checkpoint."""


def kept_results() -> BlockResults | None:
    """Where the run under way keeps the results of its blocks; None if it does not."""
    return _kept.get()


@contextmanager
def keeping(results: BlockResults) -> Iterator[None]:
    """Within it, everything that is sampled keeps the results of its blocks there."""
    before = _kept.set(results)
    try:
        yield
    finally:
        _kept.reset(before)
