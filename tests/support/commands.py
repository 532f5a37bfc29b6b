"""The command line as a test sees it."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import NamedTuple

from stochvi.scenes.datasets import shipped_scene

ELASTIC = str(shipped_scene("oscillator-elastic"))
LOSSY = str(shipped_scene("oscillator-lossy"))
ISOLATOR = str(shipped_scene("isolator-truck"))
QUICK = ("--rel-error", "0.05", "--threads", "2")


class Finished(NamedTuple):
    code: int
    out: str
    err: str


Run = Callable[..., Finished]


def one_document(text: str) -> dict:
    """The JSON document that the text is, and nothing else; never NaN or infinity."""

    def refuse(name: str) -> None:
        raise AssertionError(f"{name} in JSON")

    return json.loads(text, parse_constant=refuse)


def refused(run: Finished) -> str:
    """The sentence on stderr: exit code 2, nothing on stdout, no traceback."""
    assert (run.code, run.out) == (2, "")
    (line,) = run.err.splitlines()
    assert line.startswith("stochvi: ")
    return line.removeprefix("stochvi: ")
