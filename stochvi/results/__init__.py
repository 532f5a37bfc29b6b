"""What every calculation returns: numbers with their errors, responses, messages, files."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
