"""The compiled code of the Monte Carlo: numbers and arrays in, numbers and arrays out.

Importing this package makes numba compile a kernel again after any kernel file has changed.
"""

from stochvi.methods.monte_carlo.kernels import cache

cache.watch_folder(cache.KERNELS)
