"""The compiled code of the Monte Carlo: numbers and arrays in, numbers and arrays out.

Importing this package makes numba compile a kernel again after any kernel file has changed.
"""

from stochvi.methods.kernel_cache import watch_package

watch_package(__path__)
