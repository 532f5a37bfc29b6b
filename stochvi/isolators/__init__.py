"""Vibration isolators between stops: linear screening, required clearance, jolts."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
