"""Statistics of what Monte Carlo samples: impacts, spectra, first crossings, clusters and risks."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
