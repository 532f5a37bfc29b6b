"""The page of `explore` in a real browser: Debian's Chromium, without a window."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from typing import Any

import pytest

sync_api = pytest.importorskip("playwright.sync_api", reason="playwright drives the browser")
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(CHROMIUM is None, reason="no Chromium on this machine"),
]

PATIENCE = 120_000  # ms: the first turn compiles


@pytest.fixture(scope="module")
def address() -> Iterator[str]:
    """The address that the command tells."""
    words = [sys.executable, "-m", "stochvi", "explore", "--no-browser"]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as server:
        assert server.stdout is not None
        yield re.search(r"http://\S+", server.stdout.readline()).group()
        server.terminate()


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with sync_api.sync_playwright() as play:
        found = play.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield found
        found.close()


@pytest.fixture
def page(browser: Any, address: str) -> Iterator[Any]:
    """The page with its first turn answered; it asked nothing of other machines, without error."""
    context = browser.new_context(locale="en-US", viewport={"width": 1400, "height": 1000})
    page = context.new_page()
    page.set_default_timeout(PATIENCE)
    asked, faults = [], []
    page.on("request", lambda request: asked.append(request.url))
    page.on("pageerror", lambda fault: faults.append(str(fault)))
    page.on("console", lambda told: told.type == "error" and faults.append(told.text))
    page.goto(address)
    answered(page)
    yield page
    home = address.partition("#")[0]
    assert [url for url in asked if not url.startswith(home)] == []
    assert faults == []
    context.close()


def answered(page: Any) -> str:
    """The sentence of a turn whose answers are all there."""
    page.wait_for_selector(".state:text-matches('all known')")
    return page.inner_text(".answer")


def test_the_truck_needs_its_clearance(page: Any) -> None:
    assert "11.21 (11.20 to 11.21) mm" in page.inner_text("table >> nth=-1")
    assert "mm" in page.inner_text(".answer")
    assert page.locator("figure canvas").count() == 3


def test_every_knob_turns_by_the_keyboard(page: Any) -> None:
    for knob in page.locator("input[type=range]").all():
        before = page.inner_text("table >> nth=-1")
        knob.focus()
        for _ in range(20):
            page.keyboard.press("ArrowLeft")
        page.wait_for_selector(".stochvi-explore.stale")
        answered(page)
        name = knob.get_attribute("id")
        # the law of the stops and their place change no linear motion, but what is simulated
        assert page.inner_text("table >> nth=-1") != before, name


def test_a_number_is_typed_and_units_switch(page: Any) -> None:
    page.fill("input[aria-label='natural frequency, Hz, typed']", "20")
    page.keyboard.press("Tab")
    page.wait_for_selector(".stochvi-explore.stale")
    answered(page)
    page.select_option("#units", "in")
    assert " in" in page.inner_text("table >> nth=-1")
    assert page.locator("label", has_text="clearance per side, in").count() == 1


def test_a_refused_turn_leaves_no_sentence_of_another(page: Any) -> None:
    assert page.inner_text(".answer")
    page.route("**/ask", lambda route: route.fulfill(
        status=200, content_type="application/x-ndjson",
        body='{"type": "refused", "sentence": "this scene is refused"}\n',
    ))  # fmt: skip
    page.select_option("#profile", "navmat-p-9492")
    page.wait_for_selector(".state:text-matches('this scene is refused')")
    assert page.inner_text(".answer") == ""
    assert page.locator(".stochvi-explore.stale").count() == 1


def test_without_its_token_the_page_says_what_to_open(browser: Any, address: str) -> None:
    page = browser.new_page(locale="en-US")
    page.goto(address.partition("#")[0])
    page.wait_for_selector(".state:text-matches('open the address that stochvi explore printed')")
