"""Check the built manual: `python docs/_extensions/links.py FOLDER`.

Every link within it leads to a page and an anchor that exist, and no page loads anything from
elsewhere. Links to other sites are followed by readers alone, and are not checked here.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

LOADED = {"img": "src", "script": "src", "link": "href", "iframe": "src", "source": "src"}
"""Elements that a browser loads by itself, and the attribute that says from where."""


class Page(HTMLParser):
    """Anchors, links and loaded files of a page."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.anchors: set[str] = set()
        self.links: list[str] = []
        self.loaded: list[str] = []
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Keep what an element names."""
        known = {name: value for name, value in attrs if value}
        self.anchors |= {known[name] for name in ("id", "name") if name in known}
        if tag == "a" and "href" in known:
            self.links.append(known["href"])
        if (
            known.get("rel") not in ("canonical", "index", "search", "next", "prev")
            and LOADED.get(tag, "") in known
        ):
            self.loaded.append(known[LOADED[tag]])


def faults(folder: Path) -> Iterator[str]:
    """A sentence for every link that leads nowhere, and for every file from elsewhere."""
    pages = {path.resolve(): Page(path) for path in folder.rglob("*.html")}
    for path, page in pages.items():
        for target in page.loaded:
            parts = urlsplit(target)
            if parts.scheme in ("http", "https") or parts.netloc:
                yield f"{path.name} loads {target} from elsewhere"
            elif parts.scheme != "data" and not (path.parent / unquote(parts.path)).exists():
                yield f"{path.name} loads {target}, which is not there"
        for target in page.links:
            parts = urlsplit(target)
            if parts.scheme or parts.netloc:
                continue
            place = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            if not place.exists():
                yield f"{path.name} links to {target}, which is not there"
            elif place in pages and unquote(parts.fragment) not in pages[place].anchors | {""}:
                yield f"{path.name} links to {target}, an anchor that is not there"


if __name__ == "__main__":
    found = sorted(set(faults(Path(sys.argv[1]))))
    print("\n".join(found) or "every link within the manual leads somewhere")
    sys.exit(bool(found))
