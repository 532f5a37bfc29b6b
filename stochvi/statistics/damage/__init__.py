"""Response, fatigue and shocks of equipment at a place of a scene, with its stops and without."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
