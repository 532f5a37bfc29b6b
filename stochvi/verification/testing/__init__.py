"""For other people's integrators: scenes with known answers, and a judge of what a code finds.

`judge` takes any function that integrates an oscillator between stops (SciPy, JAX, C behind a
wrapper) and says, quantity by quantity, whether it agrees with the exact answers, by how much it
is off where it does not, and what that looks like. `known_answers` are those answers,
`assert_agrees` the comparison of one sampled number with one of them.
"""

from stochvi.verification.testing.agreement import assert_agrees
from stochvi.verification.testing.answers import known_answers
from stochvi.verification.testing.judging import Finding, Judgement, as_response, judge
from stochvi.verification.testing.problems import Problem, problem_of

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
