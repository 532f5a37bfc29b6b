from .fitting import Identification, LawFit, identify
from .measurements import DropRecord, ForceCurve, Rebounds, read_test
from .shocks import FoundShock, FoundShocks, shocks

__all__ = [
    "DropRecord",
    "ForceCurve",
    "FoundShock",
    "FoundShocks",
    "Identification",
    "LawFit",
    "Rebounds",
    "identify",
    "read_test",
    "shocks",
]
