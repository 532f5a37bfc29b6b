"""The panel of `stochvi explore` in a notebook: the module of the page, with a kernel in the place
of the server. Answers are computed beside the kernel, so that it stays free for other cells."""

from __future__ import annotations

import threading
from typing import Any

from stochvi.explorer.onefile import module, style
from stochvi.explorer.turns import Explorer, told
from stochvi.mathematics.units import checked
from stochvi.results.errors import StochviError
from stochvi.scenes.datasets import shipped_scene
from stochvi.scenes.scene import Scene, load_scene


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

        _esm, _css = f"{module()}\nexport default {{ render }};", style()
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
