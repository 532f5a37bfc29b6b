from .documents import judge_file, read_problem
from .judging import Finding, Judgement, as_response, assert_agrees, judge
from .problems import Problem, known_answers, problem_of

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
