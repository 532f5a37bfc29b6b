"""The panel of `stochvi explore` in a notebook: the module of the page, with a kernel in the place
of the server. Answers are computed beside the kernel, so that it stays free for other cells."""

from __future__ import annotations

import re
import threading
from pathlib import Path
from typing import Any

from stochvi.explorer.turns import Explorer, told
from stochvi.mathematics.units import checked
from stochvi.results.errors import StochviError
from stochvi.scenes.datasets import shipped_scene
from stochvi.scenes.scene import Scene, load_scene

STATIC = Path(__file__).parent / "static"

CHARTS = "uPlot.iife.min.js"
"""The vendored library, which the page loads as a script, and a notebook with the module."""

STYLES = ("uPlot.min.css", "explore.css")
"""Style sheets, in their order."""

IMPORT = re.compile(r'^import (\{[^}]*\}) from "\./(\w+)\.js";$', re.MULTILINE)
"""An import of the module: names, and the file that has them."""

EXPORT = re.compile(r"^export (?=(?:const|function|class) (\w+))", re.MULTILINE)
"""An export of one name."""


def module() -> str:
    """The module of the page as one text: a notebook cannot load a second file.

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

    whole = read("explore")
    charts = (STATIC / CHARTS).read_text(encoding="utf-8")
    return "\n".join([charts, *texts.values(), whole])


def style() -> str:
    """The style sheets of the page as one text."""
    return "\n".join((STATIC / name).read_text(encoding="utf-8") for name in STYLES)


@checked
def explore(scene: Scene | None = None, *, seed: int = 0) -> Any:
    """A panel in a notebook whose knobs are turned: the page of `stochvi explore`.

    Parameters
    ----------
    scene
        One with stops and without phases; by default a box on a truck.
    seed
        Seed of the simulations.

    Returns
    -------
    anywidget.AnyWidget
        The panel, which a notebook shows.

    Raises
    ------
    ValueError
        If the page does not show such a scene.
    StochviError
        Without anywidget, which the extra `notebook` brings.

    See Also
    --------
    stochvi.size : The clearance alone.

    Examples
    --------
    >>> import stochvi
    >>> panel = stochvi.explore()  # doctest: +SKIP
    """
    explorer = Explorer(
        load_scene(shipped_scene("isolator-truck")) if scene is None else scene, seed
    )
    try:
        import anywidget
        import traitlets
    except ImportError:
        remedy = 'pip install "stochvi[notebook]"'
        raise StochviError(f"explore needs anywidget in a notebook: {remedy}") from None

    class Panel(anywidget.AnyWidget):
        """The module of the page, and what it remembers."""

        _esm, _css = module(), style()
        setting = traitlets.Dict(allow_none=True, default_value=None).tag(sync=True)
        pinned = traitlets.Dict(allow_none=True, default_value=None).tag(sync=True)

    panel = Panel()

    def answer(message: Any) -> None:
        try:
            for each in told(explorer.answers(message)):
                panel.send(each)
        except (ValueError, RecursionError) as reason:
            panel.send({"type": "refused", "sentence": f"no message: {reason}"[:300]})

    def heard(_: Any, message: Any, __: Any) -> None:
        threading.Thread(target=answer, args=(message,), daemon=True).start()

    panel.on_msg(heard)
    return panel
