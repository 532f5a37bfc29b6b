from .check import Check, Checks, Comparison, Explanation, check_many, zoo
from .cost import WorkPrecision

__all__ = [
    "Check",
    "Checks",
    "Comparison",
    "Explanation",
    "WorkPrecision",
    "check_many",
    "zoo",
]
