from .answer import Identification, LawFit
from .measurements import DropRecord, ForceCurve, Rebounds
from .method import identify
from .reading import read_test

__all__ = [
    "DropRecord",
    "ForceCurve",
    "Identification",
    "LawFit",
    "Rebounds",
    "identify",
    "read_test",
]
