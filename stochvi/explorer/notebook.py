"""The panel of `stochvi explore` in a notebook: the module of the page, with a kernel in the place
of the server."""

from __future__ import annotations
