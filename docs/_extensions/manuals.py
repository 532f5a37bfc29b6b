"""Put a built manual beside those of other versions: `python manuals.py BUILT SITE`.

A version has a folder of its own in the folder SITE. `versions.js` there lists all of them with
their pages, the newest first, for the choice in the sidebar of each; `index.html` leads to the
newest that is finished.
"""

from __future__ import annotations

import json
import shutil
import sys
from importlib.metadata import version as version_of
from pathlib import Path

from packaging.version import Version

FIRST_PAGE = """<!doctype html>
<html lang="en-GB">
<meta charset="utf-8">
<meta http-equiv="refresh" content="0; url={0}/index.html">
<title>stochvi</title>
<a href="{0}/index.html">The manual of {0}</a>
</html>
"""


def add(built: Path, site: Path, version: str) -> None:
    """Put a manual into the site, in the place of one of the same version, and list all again."""
    shutil.rmtree(site / version, ignore_errors=True)
    shutil.copytree(built, site / version)
    versions = sorted((each.parent.name for each in site.glob("*/index.html")), key=Version)
    listed = [
        {
            "version": each,
            "pages": sorted(
                page.relative_to(site / each).as_posix() for page in (site / each).rglob("*.html")
            ),
        }
        for each in reversed(versions)
    ]
    text = f"window.manualVersions = {json.dumps(listed)};\n"
    (site / "versions.js").write_text(text, encoding="utf-8")
    finished = [each for each in versions if not Version(each).is_prerelease] or versions
    (site / "index.html").write_text(FIRST_PAGE.format(finished[-1]), encoding="utf-8")


if __name__ == "__main__":
    add(Path(sys.argv[1]), Path(sys.argv[2]), version_of("stochvi"))
