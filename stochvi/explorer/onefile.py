"""The page as one text: a module for notebooks, and an HTML file with stored turns, which needs no
Python: a grid of designs is answered before, and the knobs move from one to the next."""

from __future__ import annotations

import base64
import gzip
import hashlib
import html
import json
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import chain, product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from stochvi.explorer.knobs import PASTED, Knob, Setting, checked

STATIC = Path(__file__).parent / "static"

CHARTS = "uPlot.iife.min.js"
"""The vendored library, which the page loads as a script, and one text has in itself."""

STYLES = ("uPlot.min.css", "explore.css")
"""Style sheets, in their order."""

IMPORT = re.compile(r'^import (\{[^}]*\}) from "\./(\w+)\.js";$', re.MULTILINE)
"""An import of the module: names, and the file that has them."""

EXPORT = re.compile(r"^export (?=(?:const|function|class) (\w+))", re.MULTILINE)
"""An export of one name."""


def module(name: str = "explore") -> str:
    """A module of the page, and all that it imports, as one text.

    Each file that is imported becomes a constant with the names that it exports.
    """
    texts: dict[str, str] = {}

    def read(name: str) -> str:
        text = (STATIC / f"{name}.js").read_text(encoding="utf-8")
        for _, other in IMPORT.findall(text):
            if other not in texts:
                own = read(other)
                names = ", ".join(EXPORT.findall(own))
                inner = EXPORT.sub("", own)
                texts[other] = (
                    f"const {other}_js = (() => {{\n{inner}\nreturn {{ {names} }};\n}})();"
                )
        return IMPORT.sub(r"const \1 = \2_js;", text)

    whole = read(name)
    charts = (STATIC / CHARTS).read_text(encoding="utf-8")
    return "\n".join([charts, *texts.values(), whole])


def style() -> str:
    """The style sheets of the page as one text."""
    return "\n".join((STATIC / name).read_text(encoding="utf-8") for name in STYLES)


# ------------------------------------------------------------------------------
# The designs that are stored.
# ------------------------------------------------------------------------------

MOST_AXES, STEPS = 3, (3, 5, 7, 9)
"""Largest number of knobs that move in a file, and the numbers of values that each may have."""

REACH = 2.0
"""Factor by which a file goes beyond the design, either way. Where no factor turns a knob, it goes
by a quarter of the range."""


class Axis(NamedTuple):
    """Knobs that move together, and their values at each place."""

    keys: list[str]
    places: list[tuple[float, ...]]


class Grid(NamedTuple):
    """The designs of a file: a setting, and the axes along which it is changed."""

    setting: Setting
    axes: list[Axis]

    @classmethod
    def of(cls, setting: Setting, knobs: Mapping[str, Knob], asked: Any) -> Grid:
        """The grid about a setting that a page asks for; `ValueError` for one that is none."""
        asked = asked if isinstance(asked, dict) else {}
        groups, steps = asked.get("knobs"), asked.get("steps")
        if type(steps) is not int or steps not in STEPS:
            raise ValueError(f"steps must be one of {', '.join(map(str, STEPS))}")
        if not isinstance(groups, list) or not 1 <= len(groups) <= MOST_AXES:
            raise ValueError(f"1 to {MOST_AXES} knobs can move in a file; choose as many")
        axes = []
        for keys in groups:
            if not isinstance(keys, list) or not keys or not all(isinstance(k, str) for k in keys):
                raise ValueError("knobs must be lists of keys")
            rows = [_places(knobs.get(key), key, setting.values.get(key), steps) for key in keys]
            if len({len(each) for each in rows}) > 1:
                raise ValueError(f"{' and '.join(keys)} cannot move together"[:200])
            axes.append(Axis(keys, [*zip(*rows, strict=True)]))
        moved = [key for axis in axes for key in axis.keys]
        if len({*moved}) < len(moved):
            raise ValueError("each knob can move along one axis alone")
        return cls(setting, axes)

    @property
    def size(self) -> int:
        """The number of its designs."""
        return math.prod(len(axis.places) for axis in self.axes)

    def settings(self) -> list[Setting]:
        """The settings of its designs, by the places along the axes; the last one moves first."""
        keys = [key for axis in self.axes for key in axis.keys]
        grid = product(*(axis.places for axis in self.axes))
        changes = (dict(zip(keys, chain(*places), strict=True)) for places in grid)
        return [replace(self.setting, values={**self.setting.values, **each}) for each in changes]


def _places(knob: Knob | None, key: str, value: Any, steps: int) -> list[float]:
    """Values of a knob about its own, which is among them, within its range."""
    now = checked(knob, key, knob.value if knob is not None and value is None else value)
    assert knob is not None
    reach = np.linspace(-1.0, 1.0, steps)
    by_factors = knob.logarithmic or knob.high < 0.0  # a lower stop
    found = now * REACH**reach if by_factors else now + reach * (knob.high - knob.low) / 4.0
    return [*dict.fromkeys(np.clip(found, knob.low, knob.high).tolist())]


# ------------------------------------------------------------------------------
# The file.
# ------------------------------------------------------------------------------

DIGITS = 5
"""Digits of the curves in a file. Single numbers and their intervals have all of theirs."""


def stored(message: Mapping[str, Any]) -> str:
    """A message of a turn as the file has it."""
    return json.dumps({name: _shortened(each) for name, each in message.items()}, allow_nan=False)


def _shortened(value: Any) -> Any:
    """Rows of numbers with fewer digits."""
    if isinstance(value, Mapping):
        return {name: _shortened(each) for name, each in value.items()}
    if isinstance(value, list):
        return [float(f"{x:.{DIGITS}g}") if isinstance(x, float) else x for x in value]
    return value


def fixed(opened: Mapping[str, Any], grid: Grid) -> dict[str, Any]:
    """What a page begins with, where nothing can be chosen and knobs have stored values alone."""
    rows = {
        key: [place[k] for place in axis.places]
        for axis in grid.axes
        for k, key in enumerate(axis.keys)
    }

    def held(knob: Mapping[str, Any]) -> dict[str, Any]:
        now = grid.setting.values.get(knob["key"], knob["value"])
        values = sorted(rows.get(knob["key"], [now]))
        return {**knob, "value": now, "low": values[0], "high": values[-1], "stored": values}

    profile = PASTED if grid.setting.psd else opened["profile"]
    return {
        **opened, "profile": profile, "profiles": [profile] if opened["profiles"] else [],
        "takes_table": False, "laws": [], "presets": [], "offers": [], "designs": grid.size,
        **{name: [held(knob) for knob in opened[name]] for name in ("knobs", "tolerances")},
    }  # fmt: skip


def page_of(opened: Mapping[str, Any], grid: Grid, turns: Sequence[str]) -> str:
    """The file: a page whose policy allows its own script and style, and no request."""
    first = {"opened": fixed(opened, grid), "axes": [each._asdict() for each in grid.axes]}
    data = f'{json.dumps(first)[:-1]}, "turns": [{", ".join(turns)}]}}'
    script, look = module("stored"), style()
    allowed = "; ".join(f"{name}-src '{_digest(text)}'" for name, text in
                        (("script", script), ("style", look)))  # fmt: skip
    policy = f"default-src 'none'; {allowed}; base-uri 'none'; form-action 'none'"
    return f"""<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="{policy}">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{html.escape(opened["title"] or "stochvi explore")}</title>
<style>{look}</style>
</head>
<body><div id="explore"></div><noscript>The page needs JavaScript.</noscript>
<script type="text/plain" id="stored">{_base64(gzip.compress(data.encode(), mtime=0))}</script>
<script type="module">{script}</script>
</body>
</html>
"""


def _base64(content: bytes) -> str:
    return base64.b64encode(content).decode()


def _digest(text: str) -> str:
    """A text as a policy names it."""
    return f"sha256-{_base64(hashlib.sha256(text.encode()).digest())}"
