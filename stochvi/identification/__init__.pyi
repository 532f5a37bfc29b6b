from .fitting import Identification, LawFit, identify
from .measurements import DropRecord, ForceCurve, Rebounds, read_test

__all__ = [
    "DropRecord",
    "ForceCurve",
    "Identification",
    "LawFit",
    "Rebounds",
    "identify",
    "read_test",
]
