"""For other people's integrators and their tests: scenes with known answers, a judge, and a kit.

`judge` takes any function that integrates a linear structure between rigid stops (SciPy, JAX, C
behind a wrapper). It says, quantity by quantity, whether the function agrees with the exact
answers. Where it does not, it says by how much, and names likely causes. `judge_file` does the same
with what another program wrote, for a problem that `stochvi problems` wrote as plain numbers.
`known_answers` returns the exact answers; `assert_agrees` compares one sampled number with one of
them. `stochvi.testing.samples` has assertions for the tests of any Monte Carlo.

In a test suite of one's own pytest knows two fixtures:

    def test_mine(stochvi_judge):
        stochvi_judge("linear", my_function_or_frame)

    def test_my_mean(stochvi_samples):
        stochvi_samples.assert_mean(my_samples, 1.0)

Names are imported when they are first used; the kit needs numpy alone.
"""

from importlib import import_module
from typing import Any

from stochvi.verification import testing as _judging

__all__ = [*_judging.__all__, "samples"]


def __getattr__(name: str) -> Any:
    if name == "samples":
        return import_module("stochvi.testing.samples")
    return getattr(_judging, name)


def __dir__() -> list[str]:
    return sorted(__all__)
