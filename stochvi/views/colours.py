"""The colours of all pictures.

They are those of M. Okabe and K. Ito, which readers with any colour vision tell apart. In grey they
differ in lightness, and pictures that compare curves give each a marker or a line style as well.
"""

from __future__ import annotations

import numpy as np

COLOURS = {
    "exact": "#1b1b1b",
    "simulate": "#0072b2",
    "linearise:closure": "#d55e00",
    "linearise:motion": "#e69f00",
    "linearise:force": "#009e73",
    "fokker-planck": "#cc79a7",
    "stop": "#8a8f98",
}
"""One colour per method, the same in every picture."""

OWNERS = ("#0072b2", "#d55e00", "#009e73", "#e69f00", "#cc79a7", "#1b1b1b")
"""Colours of coordinates and impact pairs, in their order."""

BAND_ALPHA = 0.3
"""Opacity of a band of errors."""

GRID_COLOUR = "#dddddd"
"""Colour of the lines of a grid."""

DRAWING = {
    "ink": "#1b1b1b",
    "mass": "#dbe9f4",
    "base": "#e3e6ea",
    "line": "#c4c8ce",
    "length": "#a8480a",
}
"""Colours of the drawing of a scene: outlines, mass, base and frame, thin lines, and lengths."""

CLEARANCES = {
    "three_sigma": "#e69f00",
    "recommended": "#009e73",
    "record": "#a5222f",
}
"""Colours of the clearances that the pictures of a sizing mark: three standard deviations, the
answer, and what a record itself needs where it contradicts the sizing."""

TRANSFERS = {
    "transmissibility_h1": "#0072b2",
    "transmissibility_ratio": "#d55e00",
    "coherence": "#009e73",
}
"""Colours of what compares a response with its excitation, by quantity."""

BASINS = (
    "#9ecae8", "#f2a7a0", "#a9d8a5", "#f5d08a", "#c7b3e0", "#8fd3cf", "#e8b4d4", "#cfc29a",
)  # fmt: skip
"""Colours of basins, light enough for the marks of their regimes."""

CHAOTIC, UNDECIDED, BEYOND = "#4d4d4d", "#d0d0d0", "#ffffff"
"""Colours of starts that end in chaos, that are undecided, and that lie beyond a stop."""


def owner_colours(number: int) -> list[str]:
    """Colours of `number` coordinates or pairs: those of `OWNERS`, or shades where there are more
    of them."""
    if number <= len(OWNERS):
        return list(OWNERS[:number])
    from matplotlib import colormaps
    from matplotlib.colors import to_hex

    return [to_hex(colormaps["turbo"](share)) for share in np.linspace(0.03, 0.97, number)]
