"""Numerical solution of the stationary Fokker-Planck equation between rigid stops."""

from stochvi.galerkin.method import Batch, fokker_planck, fokker_planck_many, unmet_conditions

__all__ = ["Batch", "fokker_planck", "fokker_planck_many", "unmet_conditions"]
