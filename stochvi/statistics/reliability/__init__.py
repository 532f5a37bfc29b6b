"""How likely a mission is to go wrong: crude Monte Carlo, splitting, or first crossings."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
