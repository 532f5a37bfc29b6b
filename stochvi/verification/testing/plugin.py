"""Plugin for pytest: the fixture `stochvi_judge`, for regression tests of integrators.

pytest finds it where stochvi is installed. A test of one's own is one line:

    def test_mine(stochvi_judge):
        stochvi_judge("linear", my_function_or_frame)

Nothing of stochvi is imported before a test asks for the fixture.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from pathlib import Path

    from stochvi.verification.testing.judging import Judgement


class Judge:
    """The object that the fixture gives: calling it judges, and fails the test unless the verdict
    is a pass."""

    def __call__(self, problem: str | Path, found: Any, **options: Any) -> Judgement:
        """Judge what an integrator finds for a problem.

        Parameters
        ----------
        problem
            Name of a problem (`stochvi problems` lists them), or a file that it wrote.
        found
            A function of (problem, seed); a DataFrame or a CSV file of statistics, of averages of
            each path or of records; or a mapping, as `stochvi.testing.judge` describes them.
        options
            allowed_percent, paths, relaxations and seed, as `stochvi.testing.judge` takes them.

        Raises
        ------
        AssertionError
            With the whole verdict and its hints.
        ValueError
            If what was found cannot be read.
        """
        __tracebackhide__ = True
        from stochvi.verification.testing.documents import judge_anything

        verdict = judge_anything(problem, found, **options)
        verdict.assert_passed()
        return verdict


@pytest.fixture(scope="session")
def stochvi_judge() -> Judge:
    """Judge an integrator by a known answer: stochvi_judge("linear", my_function_or_frame)."""
    return Judge()
