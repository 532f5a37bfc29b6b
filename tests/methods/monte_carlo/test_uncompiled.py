"""Kernels with the compiler off: the same numbers, so that a debugger sees what runs."""

import numpy as np
import pytest

from support.uncompiled import averages, averages_without_the_compiler


@pytest.mark.slow
def test_kernels_give_the_same_numbers_without_the_compiler() -> None:
    compiled, plain = averages(), averages_without_the_compiler()
    assert compiled.keys() == plain.keys()
    for name, expected in compiled.items():
        assert np.isfinite(expected).all()
        # rounding differs, and grows with each impact
        assert plain[name] == pytest.approx(expected, rel=1e-8, abs=1e-12), name
