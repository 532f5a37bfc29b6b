"""Who is answered by the server of `explore`, and what its messages say."""

from __future__ import annotations

import asyncio
import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from starlette.testclient import TestClient

from stochvi.explorer import server
from stochvi.explorer.knobs import Design, Setting, knobs_of
from stochvi.explorer.takeaways import toml_of
from stochvi.explorer.turns import WARM_UP, Explorer, Turn, of, stated
from stochvi.isolators.screening import screen
from stochvi.isolators.sizing import Sizing, size
from stochvi.isolators.tolerances import Tolerances
from stochvi.methods.monte_carlo import simulate
from stochvi.results.estimates import Estimate
from stochvi.scenes.datasets import shipped_scene
from stochvi.scenes.keys import changed_scene
from stochvi.scenes.scene import load_scene
from support.commands import Run
from support.mounts import isolator

PORT, TOKEN = 4711, "a-token-of-a-test"
HERE = f"http://127.0.0.1:{PORT}"
TRUCK = load_scene(shipped_scene("isolator-truck"))
OPEN = {"type": "open"}


def turn_of(values: dict[str, Any], **others: Any) -> dict[str, Any]:
    return {"type": "turn", "id": 1, "tab": "a", "values": values, **others}


@pytest.fixture
def client(monkeypatch: pytest.MonkeyPatch) -> TestClient:
    """A browser on this machine that knows no token. A turn ends after its closed forms."""

    monkeypatch.setattr(Turn, "parts", lambda turn: iter([("closed", turn.linear)]))
    app = server.app_of(Explorer(TRUCK), PORT, TOKEN, lambda: None)
    return TestClient(app, base_url=HERE)


def ask(client: TestClient, message: Any, **headers: str) -> Any:
    body = message if isinstance(message, bytes) else json.dumps(message).encode()
    return client.post("/ask", content=body, headers={server.TOKEN: TOKEN, **headers})


def lines(reply: Any) -> list[dict[str, Any]]:
    assert reply.status_code == 200
    return [json.loads(line) for line in reply.text.splitlines()]


# ------------------------------------------------------------------------------
# Who is answered.
# ------------------------------------------------------------------------------


@pytest.mark.parametrize("path", server.FILES)
def test_the_page_and_its_files_need_no_token_and_load_nothing_from_elsewhere(
    client: TestClient, path: str
) -> None:
    reply = client.get(path)
    assert reply.status_code == 200
    assert "default-src 'self'" in reply.headers["content-security-policy"]
    assert "access-control-allow-origin" not in reply.headers
    if not path.startswith("/uPlot"):
        assert re.findall(r"https?://(?!www.w3.org/2000/svg)", reply.text) == []


def test_the_page_is_answered_with_its_token(client: TestClient) -> None:
    (knobs,) = lines(ask(client, OPEN))
    assert knobs["type"] == "knobs"
    assert knobs["title"] == TRUCK.title
    assert {each["key"] for each in knobs["knobs"]} >= {"structure.frequency_hz", "probability"}


@pytest.mark.parametrize(
    "headers",
    [
        {server.TOKEN: ""},
        {server.TOKEN: TOKEN + "a"},
        {"host": f"rebound.example:{PORT}"},
        {"host": "127.0.0.1:1"},
        {"host": "127.0.0.1"},
        {"origin": "http://rebound.example"},
        {"origin": f"https://127.0.0.1:{PORT}"},
        {"origin": "null"},
    ],
    ids=str,
)
def test_others_are_forbidden(client: TestClient, headers: dict[str, str]) -> None:
    reply = ask(client, OPEN, **headers)
    assert (reply.status_code, reply.text) == (403, "forbidden")


@pytest.mark.parametrize("path", ["/ask", "/alive", "/nothing", "/../pyproject.toml", "/static/"])
def test_what_is_no_file_of_the_page_is_forbidden_without_the_token(
    client: TestClient, path: str
) -> None:
    assert client.get(path).status_code == 403


def test_the_page_is_forbidden_under_the_name_of_another_host(client: TestClient) -> None:
    assert client.get("/", headers={"host": "rebound.example"}).status_code == 403


def test_its_own_origin_is_allowed(client: TestClient) -> None:
    assert ask(client, OPEN, origin=HERE).status_code == 200


# ------------------------------------------------------------------------------
# What is refused, in a sentence.
# ------------------------------------------------------------------------------


def test_a_body_too_large_is_refused(client: TestClient) -> None:
    reply = ask(client, b" " * (server.LARGEST + 1))
    assert reply.status_code == 413
    assert "256 kB" in reply.text


@pytest.mark.parametrize(
    "body",
    [
        b"", b"{", b"\xff", b"[" * 100_000, b"[]", b"1", b'{"type": "close"}', b'{"type": []}',
        b'{"type": "turn", "values": 3}', b'{"type": "turn", "id": 1, "values": {}, "tab": 3}',
        b'{"type": "turn", "id": true, "values": {}, "tab": "a"}', b'{"type": "open", "law": {}}',
        b'{"type": "take", "id": -1}', b'{"type": "open", "preset": "' + b"a" * 100 + b'"}',
        b'{"type": "turn", "id": 1, "values": {}, "tab": "a", "profile": 3}',
        b'{"type": "turn", "id": ' + b"9" * 5000 + b"}",
    ],
    ids=lambda body: body[:30].decode(errors="replace"),
)  # fmt: skip
def test_what_is_no_message_is_told_so(client: TestClient, body: bytes) -> None:
    reply = ask(client, body)
    assert reply.status_code == 400
    assert "Traceback" not in reply.text
    assert reply.text.startswith("no message: ")
    assert len(reply.text) <= 300


@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        ({"structure.frequency_hz": 1e300}, "natural frequency must be in"),
        ({"structure.frequency_hz": "12"}, "natural frequency must be in"),
        ({"structure.frequency_hz": float("nan")}, "natural frequency must be in"),
        ({"structure.zeta": True}, "damping ratio must be in"),
        ({"excitation.0.file": 1.0}, "values must name knobs of this scene"),
        ({"title": 3.0}, "values must name knobs"),
        ({"probability": 0.0}, "accepted probability must be in"),
    ],
)  # fmt: skip
def test_a_value_out_of_reach_is_refused(
    client: TestClient, values: dict[str, Any], sentence: str
) -> None:
    (refused,) = lines(ask(client, turn_of(values)))
    assert refused["type"] == "refused"
    assert refused["id"] == 1
    assert sentence in refused["sentence"]


def test_a_profile_is_one_that_ships_and_never_a_file(client: TestClient) -> None:
    (refused,) = lines(ask(client, turn_of({}, profile="../../etc/passwd")))
    assert refused["sentence"] == "profile must be one that ships, for a scene that has one"
    found = lines(ask(client, turn_of({}, profile="navmat-p-9492")))
    assert found[-1]["type"] == "done"


# ------------------------------------------------------------------------------
# Numbers are those of the calls.
# ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "values",
    [{}, {"structure.frequency_hz": 9.5, "structure.zeta": 0.2}, {"impact_pair.0.lower": -0.002}],
    ids=str,
)
def test_the_linear_numbers_are_those_of_screen(client: TestClient, values: dict[str, Any]) -> None:
    linear, done = lines(ask(client, turn_of(values)))
    assert done["type"] == "done"
    expected = screen(changed_scene(TRUCK.document(as_written=True), tuple(values.items())))
    (gap,) = expected.impact_pairs.values()
    shown = {each["name"]: each["value"] for each in linear["numbers"]}
    assert shown == {
        "rms displacement": gap.displacement_std,
        "usual rule: three sigma": gap.three_sigma,
        "usual rule: impact rate by Rice": gap.rice_rate,
    }


@pytest.mark.slow
@pytest.mark.parametrize("frequency", [12.0, 15.5])
def test_sized_and_simulated_numbers_are_those_of_the_calls(frequency: float) -> None:
    values = {"structure.frequency_hz": frequency}
    scene = changed_scene(TRUCK.document(as_written=True), tuple(values.items()))
    turn = Turn(Design(scene, 3600.0, 0.01, Tolerances()), seed=3, id=1)
    sized = size(scene, probability=0.01, mission=3600.0, seed=3)
    assert isinstance(sized, Sizing)
    risk = turn.risk()
    (required,) = risk["numbers"]
    assert required["value"] == sized.clearance.value
    assert (required["low"], required["high"]) == (sized.clearance.lower, sized.clearance.upper)
    assert risk["curve"]["probability"] == sized.curve["probability"].tolist()
    rate = simulate(scene, paths=64, seed=3).impact_pairs["stops"].collision_rate
    shown = turn.rate()["numbers"][0]
    assert shown["value"] == rate.value
    assert shown["high"] - shown["value"] == pytest.approx(rate.half_width_95())


# ------------------------------------------------------------------------------
# Knobs, and turns that follow each other.
# ------------------------------------------------------------------------------


def test_knobs_stand_within_their_ranges_at_the_numbers_of_the_scene() -> None:
    knobs = knobs_of(TRUCK)
    assert all(each.low <= each.value <= each.high for each in knobs)
    assert {each.key: each.value for each in knobs}["impact_pair.0.upper"] == 0.004


def test_a_turn_makes_the_one_before_it_of_the_same_tab_stale(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(Turn, "rate", lambda _: {"part": "rate"})
    explorer = Explorer(TRUCK)
    first = explorer.answers(turn_of({}))
    other = explorer.answers(turn_of({}, tab="b"))
    assert next(first)["part"] == next(other)["part"] == "linear"
    assert next(explorer.answers(turn_of({}, id=2)))["id"] == 2
    assert list(first) == []
    assert [next(other)["part"] for _ in range(2)] == ["spectra", "rate"]


def test_a_turn_that_is_overtaken_on_its_way_does_not_end_the_later_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(Turn, "rate", lambda _: {"part": "rate"})
    explorer = Explorer(TRUCK)
    early, late = (explorer.answers({**turn_of({}), "id": number}) for number in (1, 2))
    assert next(late)["part"] == "linear"
    assert list(early) == []
    assert [next(late)["part"] for _ in range(2)] == ["spectra", "rate"]


def test_closed_forms_wait_for_no_kernel_of_another_turn() -> None:
    explorer = Explorer(TRUCK)
    turn = explorer.answers(turn_of({}))
    with explorer.work:  # as long as it compiles
        assert [next(turn)["part"] for _ in range(2)] == ["linear", "spectra"]


def test_another_stiffness_compiles_beside_the_turns_of_others(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    explorer = Explorer(TRUCK)
    waited = []
    monkeypatch.setattr(Turn, "stiffness", lambda _: waited.append(explorer.work.locked()) or {})
    Turn.stiffness.__name__ = "stiffness"
    monkeypatch.setattr(Turn, "parts", lambda turn: iter([("refined", turn.stiffness)]))
    assert [each["type"] for each in explorer.answers(turn_of({}))] == ["answer", "done"]
    assert waited == [False]


def test_a_scene_that_the_page_does_not_show_is_refused(stochvi: Run, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="scenes with stops: give the scene an"):
        Explorer(isolator(None))
    (tmp_path / "free.toml").write_text(toml_of(isolator(None).document()), encoding="utf-8")
    told = stochvi("explore", str(tmp_path / "free.toml"), "--no-browser")
    assert told.code == 2
    assert "scenes with stops" in told.err


def test_the_server_ends_a_while_after_its_last_tab_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(server, "LEFT_SECONDS", 0.2)
    ended = []

    async def three_tabs() -> None:
        tabs = server.Tabs(lambda: ended.append("ended"))
        for _ in range(3):  # each opens before the server ends for the one before it
            tab = tabs.beats()
            await anext(tab)
            await asyncio.sleep(0.15)
            await tab.aclose()
            await asyncio.sleep(0.1)
            assert not ended
        await asyncio.sleep(0.2)

    asyncio.run(three_tabs())
    assert ended == ["ended"]


def test_a_number_without_a_known_bias_has_no_interval() -> None:
    known = Estimate(value=2.0, standard_error=0.1, bias=0.1)
    low, high = known.interval()
    assert of("rate", known, "1/s") == stated("rate", 2.0, "1/s", "") | {"low": low, "high": high}
    unknown = of("rate", replace(known, bias=None), "1/s")
    assert unknown is not None and "low" not in unknown and "no interval" in unknown["method"]


def test_the_first_turn_of_a_page_ends_the_warm_up() -> None:
    explorer = Explorer(TRUCK)
    ahead = explorer._started("turn", Setting({}), 0, WARM_UP)
    answers = explorer.answers({"type": "turn", "id": 1, "tab": "a"})
    assert next(answers)["part"] == "linear" and ahead.stale.is_set()
    with pytest.raises(ValueError, match="at most"):
        explorer.answers({"type": "turn", "id": 1, "tab": WARM_UP})
