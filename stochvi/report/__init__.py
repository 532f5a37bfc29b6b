"""The report of a sizing: one page that holds its verdict, its evidence and its limits."""

from stochvi.report.write import write_report

__all__ = ["write_report"]
