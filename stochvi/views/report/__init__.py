"""Reports: one page that holds a verdict, its evidence and its limits."""

from stochvi.views.report.missions import write_clearance_report
from stochvi.views.report.sizing import write_report

__all__ = ["write_clearance_report", "write_report"]
