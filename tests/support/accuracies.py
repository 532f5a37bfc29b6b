"""Statistical claims at two prices: tolerances come from standard errors at either."""

from __future__ import annotations

import pytest


def rel_errors(quick: float, fine: float) -> pytest.MarkDecorator:
    """The `rel_error` of a test in `make test`, and the one in `make verify`."""
    return pytest.mark.parametrize(
        "rel_error", [quick, pytest.param(fine, marks=pytest.mark.verify)]
    )
