"""For other people's integrators: scenes with known answers, and a judge of what a code finds.

`judge` takes any function that integrates a linear structure between rigid stops (SciPy, JAX, C
behind a wrapper). It says, quantity by quantity, whether the function agrees with the exact
answers. Where it does not, it says by how much, and names likely causes. `judge_file` does the same
with what another program wrote, for a problem that `stochvi problems` wrote as plain numbers.
`known_answers` returns the exact answers; `assert_agrees` compares one sampled number with one of
them.

In a test suite of one's own pytest knows the fixture `stochvi_judge`:

    def test_mine(stochvi_judge):
        stochvi_judge("linear", my_function_or_frame)
"""

from stochvi.verification.testing.documents import judge_file, read_problem
from stochvi.verification.testing.judging import (
    Finding,
    Judgement,
    as_response,
    assert_agrees,
    judge,
)
from stochvi.verification.testing.problems import Problem, known_answers, problem_of

__all__ = [
    "Finding",
    "Judgement",
    "Problem",
    "as_response",
    "assert_agrees",
    "judge",
    "judge_file",
    "known_answers",
    "problem_of",
    "read_problem",
]
