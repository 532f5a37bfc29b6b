"""Reports: one page that holds a verdict, its evidence and its limits."""

from stochvi.views.absorbers import write_absorber_report
from stochvi.views.report.missions import (
    write_clearance_report,
    write_reliability_report,
    write_replay_report,
)
from stochvi.views.report.sizing import write_report

__all__ = [
    "write_absorber_report",
    "write_clearance_report",
    "write_reliability_report",
    "write_replay_report",
    "write_report",
]
