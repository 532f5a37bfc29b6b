"""Impact absorbers: effect of a loose mass in a box on its structure, and the best box."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
