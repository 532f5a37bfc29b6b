"""What is no question of the page, two thousand times: the server answers, and lives."""

from __future__ import annotations

import http.client
import json
import random
import re
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from stochvi.explorer import server

OPEN = {"type": "open", "id": 1, "tab": "a"}
ODD: list[Any] = [
    None, True, -1, 0, 1e308, -1e-320, 10**400, float("nan"), float("inf"), "", "a" * 5000,
    "\ud800", "\0", "../../etc/passwd", [], [[]], {}, {"": {}}, "5,0.01\n6,0.02",
    "f,a_g2_per_hz\n5,1\n6,2",
]  # fmt: skip
KEYS = [
    "type",
    "id",
    "tab",
    "values",
    "preset",
    "profile",
    "law",
    "psd",
    "what",
    "file",
    "__proto__",
]
TYPES = ["open", "turn", "confirm", "cancel", "take", "price", "page", "", "OPEN"]
ANSWERED = {200, 400, 403, 404, 405, 413}
GROWTH = 30_000
"""Largest growth of the memory after the first tenth of the requests, kB."""


@pytest.fixture
def served() -> Iterator[tuple[int, int, str]]:
    """The number of the process, the port and the token of a server."""
    words = [sys.executable, "-m", "stochvi", "explore", "--no-browser"]
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as run:
        assert run.stdout is not None and run.stderr is not None
        found = re.search(r"http://127.0.0.1:(\d+)/#(\S+)", run.stdout.readline())
        assert found is not None
        yield run.pid, int(found[1]), found[2]
        assert run.poll() is None  # it lives
        run.terminate()
        assert "Traceback" not in run.stderr.read()


def body_of(rng: random.Random) -> bytes:
    """A body: bytes, broken JSON, or a message whose parts are odd."""
    match rng.randrange(4):
        case 0:
            return rng.randbytes(rng.randrange(200))
        case 1:
            text = json.dumps(OPEN | {"values": {"structure.zeta": 0.1}})
            return text[: rng.randrange(len(text))].encode()
        case 2:
            return b"[" * rng.choice([10, 100_000, server.LARGEST + 1])
    message: dict[str, Any] = {"type": rng.choice(TYPES), "id": rng.choice([1, 2, *ODD])}
    for key in rng.sample(KEYS, 3):
        message.setdefault(key, rng.choice(ODD))
    if message["type"] in ("turn", "confirm", "take"):  # none that is worked for minutes
        message["values"] = {rng.choice(["structure.zeta", "x" * 100]): rng.choice(ODD)}
    return json.dumps(message).encode()


def memory(process: int) -> int:
    """Memory of a process, kB."""
    text = Path(f"/proc/{process}/status").read_text(encoding="utf-8")
    return int(re.findall(r"VmRSS:\s+(\d+)", text)[0])


def answers(port: int, token: str, message: Any) -> str:
    """The whole answer to a question of the page."""
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=300)
    connection.request("POST", "/ask", json.dumps(message), {server.TOKEN: token})
    return connection.getresponse().read().decode()


def ask(rng: random.Random, port: int, token: str) -> int | None:
    """The status that a request gets; None where the socket is closed before."""
    if rng.random() < 0.1:
        with socket.create_connection(("127.0.0.1", port), timeout=20) as raw:
            raw.sendall(b"POST /ask HTTP/1.1\r\nHost: 127.0.0.1:%d\r\n" % port + rng.randbytes(40))
        return None
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=60)
    headers = {server.TOKEN: rng.choice([token] * 9 + ["none"])}
    method = rng.choice(["POST"] * 9 + ["GET"])
    try:
        connection.request(method, rng.choice(["/ask"] * 9 + ["/none"]), body_of(rng), headers)
        if rng.random() < 0.1:
            return None
        reply = connection.getresponse()
        reply.read()  # whole, or it raises
        return reply.status
    except (BrokenPipeError, ConnectionResetError):  # it was refused before it was read
        return None
    finally:
        connection.close()


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="memory is read from /proc")
@pytest.mark.parametrize("number", [200, pytest.param(2000, marks=pytest.mark.verify)])
def test_what_is_no_question_is_answered_and_the_server_lives(
    served: tuple[int, int, str], number: int
) -> None:
    process, port, token = served
    rng, statuses = random.Random(7), set()
    answers(port, token, {"type": "turn", "id": 0, "tab": "b"})  # all is compiled then
    for count in range(number):
        statuses.add(ask(rng, port, token))
        if count == number // 10:
            early = memory(process)
    assert statuses - {None} <= ANSWERED
    assert {400, 403, 413} <= statuses
    assert memory(process) < early + GROWTH
    assert '"type": "knobs"' in answers(port, token, OPEN)
