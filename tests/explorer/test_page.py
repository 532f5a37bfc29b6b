"""The page of `explore` in a real browser: Debian's Chromium, without a window."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
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
    """The page with its first turn sized; it asked nothing of other machines, without error."""
    context = browser.new_context(locale="en-US", viewport={"width": 1400, "height": 1000})
    page = context.new_page()
    page.set_default_timeout(PATIENCE)
    asked, faults = [], []
    page.on("request", lambda request: asked.append(request.url))
    page.on("pageerror", lambda fault: faults.append(str(fault)))
    page.on("console", lambda told: told.type == "error" and faults.append(told.text))
    page.goto(address)
    sized(page)
    yield page
    home = address.partition("#")[0]
    assert [url for url in asked if not url.startswith(home)] == []
    assert faults == []
    context.close()


def answered(page: Any) -> None:
    """Waits until all answers of a turn are there."""
    page.wait_for_selector("header .state:text-matches('all known')")


def sized(page: Any) -> None:
    """Waits until the sentence of a turn is there; its refinement follows."""
    page.wait_for_selector(".stochvi-explore:not(.stale) .answer:not(:empty)")


# ------------------------------------------------------------------------------
# What a turn shows.
# ------------------------------------------------------------------------------


def test_the_truck_needs_its_clearance(page: Any) -> None:
    assert "11.21 (11.20 to 11.21) mm" in page.inner_text("table.numbers")
    assert "Make 11.3 mm on each side" in page.inner_text(".answer")
    assert "Three sigma, 5.96 mm: hit almost surely" in page.inner_text(".facts")
    answered(page)
    assert page.locator(".pictures figure canvas").count() == 3  # risk, rates, spectra


def turned_by(page: Any, turn: Callable[[], None], wait: Callable[[Any], None] = sized) -> str:
    """The table of numbers after a turn."""
    turn()
    page.wait_for_selector(".stochvi-explore.stale")
    wait(page)
    return page.inner_text("table.numbers")


def test_every_knob_turns_by_the_keyboard(page: Any) -> None:
    for knob in page.locator("input[type=range]").all():
        answered(page)
        before = page.inner_text("table.numbers")

        def left(knob: Any = knob) -> None:
            knob.focus()
            for _ in range(20):
                page.keyboard.press("ArrowLeft")

        # the law of the stops and their place change no linear motion, but what is simulated
        assert turned_by(page, left, answered) != before, knob.get_attribute("id")


def test_everything_is_reached_by_the_tab_key_alone(page: Any) -> None:
    kinds = "select, input, button, summary, [role=slider]"
    wanted = page.locator(kinds).filter(visible=True).count()
    page.evaluate("document.body.focus()")
    reached = set()
    for _ in range(wanted):
        page.keyboard.press("Tab")
        # a notebook leaves the keys to what says so itself
        assert page.evaluate("document.activeElement.dataset.lmSuppressShortcuts") == "true"
        reached.add(page.evaluate(
            "(e => e.id || e.dataset.side || e.getAttribute('aria-label') || e.textContent)"
            "(document.activeElement)"
        ))  # fmt: skip
    assert len(reached) == wanted
    assert {"units", "profile", "clearance", "lower", "upper"} <= reached


def test_a_number_is_typed_and_units_switch(page: Any) -> None:
    typed = page.locator("input[aria-label='natural frequency, Hz, typed']")

    def type_number() -> None:
        typed.fill("20")
        page.keyboard.press("Tab")

    turned_by(page, type_number)
    page.select_option("#units", "in, g")
    assert " in" in page.inner_text("table.numbers")
    assert " in on each side" in page.inner_text(".answer")
    assert page.locator("label", has_text="clearance per side, in").count() == 1


def test_a_number_out_of_reach_is_told_where_it_ends(page: Any) -> None:
    page.fill("input[aria-label='natural frequency, Hz, typed']", "200")
    page.keyboard.press("Tab")
    assert page.inner_text(".side .state") == "natural frequency goes from 3 Hz to 48 Hz"
    assert page.input_value("input[aria-label='natural frequency, Hz, typed']") == "48"


def test_a_stop_is_dragged_in_the_drawing_and_moved_by_the_arrow_keys(page: Any) -> None:
    clearance = page.locator("input[aria-label^='clearance per side']")
    grip = page.locator("[data-side=upper] .grip").bounding_box()
    x, y = grip["x"] + grip["width"] / 2, grip["y"] + grip["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 60, y, steps=5)
    page.mouse.up()
    sized(page)
    dragged = float(clearance.input_value())
    assert 4.5 < dragged < 8.0
    page.focus("[data-side=upper]")
    page.keyboard.press("ArrowLeft")
    page.keyboard.press("ArrowLeft")
    sized(page)
    assert float(clearance.input_value()) < dragged
    assert page.evaluate("document.activeElement.dataset.side") == "upper"


def test_another_profile_needs_another_clearance(page: Any) -> None:
    before = page.inner_text(".answer")
    turned_by(page, lambda: page.select_option("#profile", "gevs-acceptance"))
    assert page.inner_text(".answer") != before


# ------------------------------------------------------------------------------
# The setting stays, and a design is pinned.
# ------------------------------------------------------------------------------


def set_frequency(page: Any, value: str) -> None:
    page.fill("#structure\\.frequency_hz ~ input", value)
    page.keyboard.press("Tab")


def frequency(page: Any) -> str:
    return page.input_value("#structure\\.frequency_hz ~ input")


def test_back_forward_and_a_reload_keep_the_setting(page: Any) -> None:
    begin = page.inner_text(".answer")
    page.wait_for_timeout(1100)
    turned_by(page, lambda: set_frequency(page, "16"))
    changed = page.inner_text(".answer")
    page.reload()
    sized(page)
    assert (frequency(page), page.inner_text(".answer")) == ("16", changed)
    turned_by(page, page.go_back)
    assert (frequency(page), page.inner_text(".answer")) == ("12", begin)
    turned_by(page, page.go_forward)
    assert frequency(page) == "16"
    turned_by(page, lambda: page.click("text=As in the scene"))
    assert frequency(page) == "12"


def test_a_pinned_design_is_compared_and_turned_back_to(page: Any) -> None:
    table = page.locator("table.differences")
    assert not table.is_visible()
    page.click("text=Pin this design")
    turned_by(page, lambda: set_frequency(page, "16"), answered)
    text = table.inner_text()
    assert re.search(r"natural frequency\s+12 Hz\s+16 Hz\s+\+33 %", text)
    assert re.search(r"required clearance\s+11.21 \(11.20 to 11.21\) mm\s+\d", text)
    assert "damping ratio" not in text
    assert page.locator(".legend >> text=pinned").count() >= 2
    page.reload()
    answered(page)
    assert table.inner_text() == text
    turned_by(page, lambda: page.click("text=Turn back to it"))
    assert frequency(page) == "12"
    page.click("text=Unpin")
    assert not table.is_visible()


def test_two_tabs_turn_apart(page: Any) -> None:
    begin = page.inner_text(".answer")
    other = page.context.new_page()
    other.set_default_timeout(PATIENCE)
    other.goto(page.url)
    sized(other)
    turned_by(other, lambda: set_frequency(other, "16"))
    assert (frequency(page), page.inner_text(".answer")) == ("12", begin)
    assert other.inner_text(".answer") != begin
    other.close()


# ------------------------------------------------------------------------------
# Scenes, tables and laws that are chosen.
# ------------------------------------------------------------------------------


def test_a_pasted_table_takes_the_place_of_the_profile_and_a_bad_one_does_not(page: Any) -> None:
    begin = page.inner_text(".answer")
    page.click("text=Paste a PSD")
    page.fill("#psd", "5 0.03\n40 0.03\n500 -0.0003")
    page.click("text=Use this PSD")
    page.wait_for_selector(".side .state:text-matches('line 4')")
    assert "positive" in page.inner_text(".side .state")
    assert page.inner_text(".answer") == begin
    page.fill("#psd", "5 0.03\n40 0.03\n500 0.0003")  # twice the profile: 3 dB
    turned_by(page, lambda: page.click("text=Use this PSD"))
    assert page.input_value("#profile") == "pasted table"
    assert "Make 15.9 mm" in page.inner_text(".answer")
    page.reload()
    sized(page)
    assert "Make 15.9 mm" in page.inner_text(".answer")
    turned_by(page, lambda: page.select_option("#profile", "mil-std-810h-truck-vertical-5hz"))
    assert page.inner_text(".answer") == begin


def test_tolerances_need_a_wider_clearance(page: Any) -> None:
    page.click("summary:has-text('Tolerances')")

    def allow() -> None:
        page.fill("#tolerances\\.frequency ~ input", "10")
        page.keyboard.press("Tab")

    assert "within tolerances" in turned_by(page, allow)
    assert "within natural frequency ± 10 %" in page.inner_text(".answer")


def test_another_law_has_other_knobs(page: Any) -> None:
    turned_by(page, lambda: page.select_option("#law", "viscoelastic"))
    told = page.locator("form label").all_inner_texts()
    assert {"stiffness, N/m", "damping ratio of stops"} <= {*told}
    assert "restitution" not in told


def test_a_box_is_drawn_with_the_risk_of_its_corners(page: Any) -> None:
    page.click("text=Page without Python")
    turned_by(page, lambda: page.select_option("#preset", "box on four mounts"))
    assert page.locator("fieldset").count() == 0  # it had the knobs of another scene
    assert page.locator("svg.box circle").count() == 3
    assert page.locator("svg.box rect").count() == 4
    assert "corner 2, 100 %" in page.text_content("svg.box")
    assert not page.locator("svg.motion").is_visible()


# ------------------------------------------------------------------------------
# What is confirmed, and taken away.
# ------------------------------------------------------------------------------


def test_a_pinned_design_is_confirmed(page: Any) -> None:
    page.click("text=Pin this design")
    page.click("text=Confirm by simulation")
    page.wait_for_selector("tr:has-text('simulated impact rate, confirmed')")
    page.wait_for_selector(".legend >> text=pinned, confirmed")
    assert page.locator("text=Confirm by simulation").is_visible()


def test_a_confirmation_is_cancelled(page: Any) -> None:
    page.click("text=Pin this design")
    # at the required clearance impacts are rare, and take long
    turned_by(page, lambda: set_clearance(page, "9"))
    page.click("text=Unpin")
    page.click("text=Pin this design")
    page.click("text=Confirm by simulation")
    page.click("button:has-text('Cancel')")
    page.wait_for_selector("text=Confirm by simulation >> visible=true")
    assert page.locator("tr:has-text('confirmed')").count() == 0


def set_clearance(page: Any, value: str) -> None:
    page.fill("#clearance ~ input", value)
    page.keyboard.press("Tab")


@pytest.mark.parametrize(
    ("button", "words"),
    [
        ("Scene file", "frequency_hz = 12.0"),
        ("Command line", "stochvi size design.toml --probability 0.01"),
        ("Python lines", "answer = stochvi.size(scene"),
    ],
)
def test_texts_are_taken_away(page: Any, button: str, words: str) -> None:
    page.click(f"text={button}")
    assert words in page.inner_text(".taken pre")
    with page.expect_download() as saved:
        page.click(".taken button:has-text('Save')")
    assert words in saved.value.path().read_text()


@pytest.mark.parametrize(
    ("button", "name", "words"),
    [("CSV", "design.csv", "clearance,"), ("Report", "report.html", "11.3")],
)
def test_files_are_taken_away(page: Any, button: str, name: str, words: str) -> None:
    with page.expect_download() as saved:
        page.click(f"text={button}")
    assert saved.value.suggested_filename == name
    assert words in saved.value.path().read_text()


def test_a_file_with_stored_turns_needs_no_server(page: Any, browser: Any, tmp_path: Path) -> None:
    page.click("text=Page without Python")
    price = page.locator(".taken .state")
    price.filter(has_text="125 designs: up to").wait_for()
    for words in ("level", "clearance per side"):
        page.uncheck(f".taken label:has-text('{words}') input")
    page.select_option("#steps", "3")
    price.filter(has_text=re.compile(r"^3 designs: up to .* MB$")).wait_for()
    with page.expect_download() as saved:
        page.click("text=Make the file")
    turned_by(page, lambda: set_frequency(page, "24"), answered)
    file = tmp_path / saved.value.suggested_filename
    saved.value.save_as(file)

    context = browser.new_context(locale="en-US", viewport={"width": 1280, "height": 900})
    alone, asked, faults = context.new_page(), list[str](), list[str]()
    alone.on("request", lambda request: asked.append(request.url))
    alone.on("pageerror", lambda fault: faults.append(str(fault)))
    alone.on("console", lambda told: told.type == "error" and faults.append(told.text))
    alone.goto(file.as_uri())
    alone.wait_for_selector("header .state:text-matches('this file holds 3 designs')")
    assert "Make 11.3 mm" in alone.inner_text(".answer")
    alone.focus("#structure\\.frequency_hz")
    alone.keyboard.press("ArrowRight")
    alone.wait_for_selector(".side .state:text-matches('stored design with natural frequency 24')")
    alone.wait_for_selector(".stochvi-explore:not(.stale)")
    for place in (".answer", ".facts", "table.numbers"):
        assert alone.inner_text(place) == page.inner_text(place)
    set_frequency(alone, "13")  # the nearest one is shown, and the page says so
    assert frequency(alone) == "12"
    assert alone.is_disabled("#clearance")
    axe = pytest.importorskip("axe_playwright_python.sync_playwright")
    found = axe.Axe().run(alone)
    assert found.violations_count == 0, found.generate_report()
    assert (asked, faults) == ([file.as_uri()], [])
    context.close()


# ------------------------------------------------------------------------------
# Who reads it, and on what.
# ------------------------------------------------------------------------------

SCREENS = {
    "wide": {"viewport": {"width": 1280, "height": 900}},
    "wide, dark": {"viewport": {"width": 1280, "height": 900}, "color_scheme": "dark"},
    "narrow": {"viewport": {"width": 390, "height": 800}},
    "narrow, dark": {"viewport": {"width": 390, "height": 800}, "color_scheme": "dark"},
    "200 %": {"viewport": {"width": 640, "height": 450}, "device_scale_factor": 2},
}


@pytest.mark.parametrize("screen", SCREENS)
def test_it_is_accessible_and_fits(browser: Any, address: str, screen: str) -> None:
    axe = pytest.importorskip("axe_playwright_python.sync_playwright")
    page = browser.new_page(locale="en-US", **SCREENS[screen])
    page.set_default_timeout(PATIENCE)
    page.goto(address)
    sized(page)
    page.click("text=Pin this design")
    turned_by(page, lambda: set_frequency(page, "14"), answered)  # until then all is pale
    found = axe.Axe().run(page)
    assert found.violations_count == 0, found.generate_report()
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
    page.close()


def test_the_mass_rests_where_motion_is_unwanted(browser: Any, address: str) -> None:
    page = browser.new_page(locale="en-US", reduced_motion="reduce")
    page.set_default_timeout(PATIENCE)
    page.goto(address)
    sized(page)
    page.wait_for_selector(".moving:not(.stale)")
    places = []
    for _ in range(2):
        page.wait_for_timeout(100)
        places.append(page.get_attribute(".mass", "transform"))
    assert places[0] == places[1]
    page.click("text=Move")
    page.wait_for_timeout(300)
    assert page.get_attribute(".mass", "transform") != places[0]
    page.close()


# ------------------------------------------------------------------------------
# What is refused.
# ------------------------------------------------------------------------------


def test_a_refused_turn_leaves_no_sentence_of_another(page: Any) -> None:
    assert page.inner_text(".answer")
    page.route("**/ask", lambda route: route.fulfill(
        status=200, content_type="application/x-ndjson",
        body='{"type": "refused", "sentence": "this scene is refused"}\n',
    ))  # fmt: skip
    set_frequency(page, "13")
    page.wait_for_selector("header .state:text-matches('this scene is refused')")
    assert page.inner_text(".answer") == ""
    assert page.locator(".stochvi-explore.stale").count() == 1


def test_without_its_token_the_page_says_what_to_open(browser: Any, address: str) -> None:
    page = browser.new_page(locale="en-US")
    page.goto(address.partition("#")[0])
    page.wait_for_selector(
        "header .state:text-matches('open the address that stochvi explore printed')"
    )
