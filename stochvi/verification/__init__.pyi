from .check import Check, Comparison
from .check_of_many import Checks, check_many, zoo
from .cost import WorkPrecision
from .explain import Explanation

__all__ = [
    "Check",
    "Checks",
    "Comparison",
    "Explanation",
    "WorkPrecision",
    "check_many",
    "zoo",
]
