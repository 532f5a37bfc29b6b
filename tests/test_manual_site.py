"""Manuals of several versions beside each other: which the sidebar offers, and where it leads."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from support import CHECKOUT

sys.path.insert(0, str(CHECKOUT / "docs" / "_extensions"))
import manuals

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")

CONF = """
project = "stochvi"
html_theme = "furo"
html_static_path = [{static!r}]
html_js_files = [("versions.js", {{"defer": "defer"}})]
"""
"""What `docs/conf.py` has for the choice of a version."""


def test_a_site_lists_its_versions_and_leads_to_the_newest_that_is_finished(tmp_path: Path) -> None:
    built, site = tmp_path / "built", tmp_path / "site"
    (built / "howto").mkdir(parents=True)
    (built / "index.html").write_text("first")
    for version in ("0.10.0", "0.2.0", "1.0.0rc1"):
        manuals.add(built, site, version)
        (built / "howto" / "size.html").write_text("since 0.2.0 in the order of releases")
    (built / "index.html").write_text("again")
    manuals.add(built, site, "0.2.0")
    listed = json.loads((site / "versions.js").read_text().partition("=")[2].strip(" ;\n"))
    assert [each["version"] for each in listed] == ["1.0.0rc1", "0.10.0", "0.2.0"]
    assert [each["pages"] for each in listed[1:]] == [
        ["index.html"],
        ["howto/size.html", "index.html"],
    ]
    assert "url=0.10.0/index.html" in (site / "index.html").read_text()
    assert (site / "0.2.0" / "index.html").read_text() == "again"


def test_the_manual_is_built_with_the_choice_of_a_version() -> None:
    built_with = (CHECKOUT / "docs" / "conf.py").read_text().splitlines()
    needed = CONF.format(static="").strip().splitlines()
    assert {line for line in needed if "static" not in line} <= {*built_with}


@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium on this machine")
def test_a_reader_goes_to_the_same_page_of_another_version(tmp_path: Path) -> None:
    pytest.importorskip("furo", reason="the extra docs brings the theme")
    sync_api = pytest.importorskip("playwright.sync_api", reason="playwright drives the browser")
    source = tmp_path / "source"
    (source / "howto").mkdir(parents=True)
    static = str(CHECKOUT / "docs" / "_static")
    (source / "conf.py").write_text(CONF.format(static=static))
    (source / "index.rst").write_text("Start\n=====\n\n.. toctree::\n   :glob:\n\n   howto/*\n")
    for version, page in (("0.1.0", "size"), ("0.2.0", "explore")):
        for each in {"size", page}:
            (source / "howto" / f"{each}.rst").write_text(f"{each}\n{'=' * len(each)}\n")
        built = tmp_path / version
        words = ["-m", "sphinx", "-q", "-W", "-b", "html", str(source), str(built)]
        subprocess.run([sys.executable, *words], check=True)
        manuals.add(built, tmp_path / "site", version)
    with sync_api.sync_playwright() as play:
        browser = play.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        page = browser.new_page()
        page.goto((tmp_path / "0.1.0" / "index.html").as_uri())
        assert page.get_by_label("Version").count() == 0  # a manual that stands alone
        page.goto((tmp_path / "site" / "0.1.0" / "howto" / "size.html").as_uri())
        choice = page.get_by_label("Version")
        assert choice.input_value() == "0.1.0"
        assert choice.locator("option").all_text_contents() == ["0.2.0", "0.1.0"]
        choice.select_option("0.2.0")
        page.wait_for_url("**/site/0.2.0/howto/size.html")
        page.goto((tmp_path / "site" / "0.2.0" / "howto" / "explore.html").as_uri())
        page.get_by_label("Version").select_option("0.1.0")
        page.wait_for_url("**/site/0.1.0/index.html")
        browser.close()
