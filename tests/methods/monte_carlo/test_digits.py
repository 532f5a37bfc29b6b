"""One seed gives one set of digits: in the process that compiles, and in those that load."""

import importlib
import pkgutil
from pathlib import Path

import pytest
from numba.core.registry import CPUDispatcher

from stochvi.methods.monte_carlo import kernels
from support.digits import IMPACTS, STAGES, digits_of_a_process

CASES = [
    IMPACTS,
    "oscillator-elastic",
    "oscillator-lossy",
    "zoo/lossy-upper-stop",
    "zoo/linear",
    "zoo/spring-stops",
    "zoo/psd-truck-elastic",
    "zoo/psd-spring-stops",
    "absorber-on-a-tower",
    "zoo/chain-two-pairs",
    *STAGES,
]
"""A small kernel, and scenes that between them call for every plan of `make_plan`."""


@pytest.mark.verify
def test_processes_that_load_all_kernels_find_the_digits_of_the_one_that_compiled_them(
    tmp_path: Path,
) -> None:
    compiled = digits_of_a_process(CASES, tmp_path)
    assert digits_of_a_process(CASES, tmp_path) == compiled
    # which kernel is loaded first must not matter either
    assert digits_of_a_process(CASES[::-1], tmp_path) == compiled


def test_no_kernel_leaves_the_rounding_to_the_compiler() -> None:
    """Of a function that may be rounded in several ways, several copies with other digits exist."""
    found = []
    for module in pkgutil.iter_modules(kernels.__path__, f"{kernels.__name__}."):
        content = vars(importlib.import_module(module.name)).values()
        found += [each for each in content if isinstance(each, CPUDispatcher)]
    assert found
    assert [each.__name__ for each in found if each.targetoptions.get("fastmath")] == []
