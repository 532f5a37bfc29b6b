"""Reports: one page that holds a verdict, its evidence and its limits."""

from stochvi.report.absorber import write_absorber_report
from stochvi.report.write import write_report

__all__ = ["write_absorber_report", "write_report"]
