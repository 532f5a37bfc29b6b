"""What measurements tell: the law of a stop from a test of it, and the shocks in a record."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
