"""A scene answered again and again: over ranges of its keys, and over units that differ."""

from stochvi.sweeps.ranges import Job, once, sweep, values_of
from stochvi.sweeps.records import mean_over_records
from stochvi.sweeps.units import mean_over_units

__all__ = ["Job", "mean_over_records", "mean_over_units", "once", "sweep", "values_of"]
