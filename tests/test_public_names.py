"""Every name that the package offers can be imported."""

import pytest

import stochvi


def test_every_public_name_resolves() -> None:
    for name in stochvi.__all__:
        assert getattr(stochvi, name) is not None
    with pytest.raises(AttributeError, match="no_such_name"):
        stochvi.no_such_name  # noqa: B018
