"""Sentences of errors, whatever the locale of the user."""

from __future__ import annotations

import errno
import os

import pytest

from stochvi.results.errors import Interrupted, NotConverged, reason_of


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


@pytest.mark.parametrize("kind", [NotConverged, Interrupted])
def test_an_error_carries_what_was_found_and_answers_to_the_former_name(
    kind: type[NotConverged | Interrupted],
) -> None:
    assert kind("too late").partial is None
    error = kind("too late", "so far")
    assert (str(error), error.partial, error.response) == ("too late", "so far", "so far")
    error.response = "more"
    assert error.partial == "more"
