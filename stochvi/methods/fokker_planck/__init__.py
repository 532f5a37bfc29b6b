"""Numerical solution of the Fokker-Planck equation: stationary, in time, until a first passage."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
