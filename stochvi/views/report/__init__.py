"""Reports: one page that holds a verdict, its evidence and its limits."""

from stochvi.views.pictures import write_report

__all__ = ["write_report"]
