"""Agreement of the methods, the cost of accuracy, and the judging of other integrators."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
