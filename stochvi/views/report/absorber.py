"""The report of an absorber."""

from stochvi.views.absorbers import write_absorber_report

__all__ = ["write_absorber_report"]
