"""Rows of numbers of many paths: where they lie, what they share, and that they are kept."""

import gc

import numpy as np
import pytest

from stochvi.engine.compiling import kernel
from stochvi.methods.monte_carlo.kernels.lanes import LANES, ROW, aligned_rows, words_of


@kernel
def filled(rows):  # type: ignore[no-untyped-def]
    memory = aligned_rows(rows)
    words = words_of(memory)
    for row in range(rows):
        for lane in range(LANES):
            memory[row, lane] += row + 0.5 * lane
    return memory, words


@pytest.mark.parametrize("rows_of", [filled, filled.py_func])
def test_rows_begin_at_lines_of_the_cache_and_words_are_their_bits(rows_of) -> None:  # type: ignore[no-untyped-def]
    wanted = np.arange(3)[:, None] + 0.5 * np.arange(LANES)
    kept = []
    for _ in range(20):  # places of memory differ
        memory, words = rows_of(3)
        assert memory.ctypes.data % 64 == 0 and memory.strides == (8 * ROW, 8)
        kept.append((memory, words))
    del memory, words
    gc.collect()
    for memory, words in kept:
        assert memory.shape == words.shape == (3, ROW)
        np.testing.assert_array_equal(memory[:, :LANES], wanted)
        assert not memory[:, LANES:].any()
        np.testing.assert_array_equal(words, memory.view(np.uint64))


def test_words_keep_their_memory() -> None:
    words = filled(2)[1]
    before = words.copy()
    gc.collect()
    rest = [np.ones((2, ROW)) for _ in range(50)]  # would take the place, were it free
    np.testing.assert_array_equal(words, before)
    assert len(rest) == 50
