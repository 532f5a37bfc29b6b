"""Sentences of errors, whatever the locale of the user."""

from __future__ import annotations

import errno
import os

import pytest

from stochvi.results.errors import reason_of


@pytest.mark.parametrize(
    ("number", "reason"),
    [(errno.ENOENT, "no such file or directory"), (errno.ECONNRESET, "in der sprache des systems")],
)
def test_the_reason_of_a_system_is_said_in_english_where_it_is_known(
    monkeypatch: pytest.MonkeyPatch, number: int, reason: str
) -> None:
    monkeypatch.setattr(os, "strerror", lambda _: "In der Sprache des Systems")
    assert reason_of(OSError(number, "In der Sprache des Systems")) == reason
    assert reason_of(OSError(number, "Our own reason")) == "our own reason"
