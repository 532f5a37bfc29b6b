"""The judge of other people's integrators; `stochvi.testing` holds its public names.

They are imported when they are first used, so that the plugin for pytest costs nothing before.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
