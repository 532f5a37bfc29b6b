"""The command line as a test sees it."""

from __future__ import annotations

import json
import subprocess
import sys
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


KILLED = """\
import os
from stochvi.__main__ import run
from stochvi.sampling.checkpoints import Checkpoint
write = Checkpoint.write
def write_and_die(checkpoint):
    write(checkpoint)
    if any(each.paths for each in checkpoint.samples.values()):
        os._exit(9)
Checkpoint.write = write_and_die
run()
"""


def killed_at_its_first_sample(*arguments: object) -> None:
    """A command that dies, as by `kill -9`, once its checkpoint holds paths: a kill from outside
    comes too late wherever this process waits for a core."""
    ended = subprocess.run([sys.executable, "-c", KILLED, *map(str, arguments)], check=False)
    assert ended.returncode == 9
