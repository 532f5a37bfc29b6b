"""For other people's integrators: scenes with known answers, and a judge of what a code finds."""

from stochvi.verification.testing import (
    Finding,
    Judgement,
    Problem,
    as_response,
    assert_agrees,
    judge,
    known_answers,
    problem_of,
)

__all__ = [
    "Finding",
    "Judgement",
    "Problem",
    "as_response",
    "assert_agrees",
    "judge",
    "known_answers",
    "problem_of",
]
