"""Plugin for pytest: the fixtures `stochvi_judge`, for regression tests of integrators, and
`stochvi_samples`, for those of any Monte Carlo.

pytest finds them where stochvi is installed. A test of one's own is one line:

    def test_mine(stochvi_judge):
        stochvi_judge("linear", my_function_or_frame)

    def test_my_mean(stochvi_samples):
        stochvi_samples.assert_mean(my_samples, 1.0)

Nothing of stochvi is imported before a test asks for a fixture.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from pathlib import Path

    from stochvi.testing.samples import Suite
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
            allowed_percent, finds_percent, paths, relaxations and seed, as `stochvi.testing.judge`
            takes them.

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


def pytest_addoption(parser: pytest.Parser) -> None:
    """Settings of the suite in the configuration of pytest, or by `-o` on its command line."""
    parser.addini("stochvi_alarms", "probability that right samplers fail a run", default="0.001")
    parser.addini("stochvi_comparisons", "comparisons that share it", default="100")
    parser.addini("stochvi_seed", "seed of all samples", default="0")


@pytest.fixture(scope="session")
def _stochvi_suite(pytestconfig: pytest.Config) -> Suite:
    from stochvi.testing.samples import Suite

    return Suite(
        alarms=float(pytestconfig.getini("stochvi_alarms")),
        comparisons=int(pytestconfig.getini("stochvi_comparisons")),
        seed=int(pytestconfig.getini("stochvi_seed")),
    )


@pytest.fixture
def stochvi_samples(_stochvi_suite: Suite, request: pytest.FixtureRequest) -> Suite:
    """Compare samples with the truth: stochvi_samples.assert_mean(my_samples, 1.0)."""
    _stochvi_suite.name = request.node.nodeid
    return _stochvi_suite
