"""The compiled code of periodic regimes.

`solver` holds rigid stops, `contact_flow` stops that give way, `hertz_flow` what those of Hertz's
law add, and `flights` many starts at once.

Importing this package makes numba compile a kernel again after any kernel file has changed.
"""

from stochvi.methods.kernel_cache import watch_package

watch_package(__path__)
