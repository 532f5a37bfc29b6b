"""The colours of all pictures."""

from __future__ import annotations

import numpy as np

COLOURS = {
    "exact": "#1b1b1b",
    "simulate": "#0b6fb8",
    "linearise:closure": "#d1495b",
    "linearise:motion": "#e0a030",
    "linearise:force": "#3a8f5c",
    "fokker-planck": "#7a4fa3",
    "stop": "#8a8f98",
}
"""One colour per method, the same in every picture."""

OWNERS = ("#0b6fb8", "#d1495b", "#3a8f5c", "#e0a030", "#7a4fa3", "#1b1b1b")
"""Colours of coordinates and impact pairs, in their order."""

BAND_ALPHA = 0.3
"""Opacity of a band of errors."""

GRID_COLOUR = "#dddddd"
"""Colour of the lines of a grid."""

CLEARANCES = {
    "three_sigma": "#e0a030",
    "recommended": "#3a8f5c",
    "record": "#c0392b",
}
"""Colours of the clearances that the pictures of a sizing mark: three standard deviations, the
answer, and what a record itself needs where it contradicts the sizing."""

TRANSFERS = {
    "transmissibility_h1": "#0b6fb8",
    "transmissibility_ratio": "#d1495b",
    "coherence": "#3a8f5c",
}
"""Colours of what compares a response with its excitation, by quantity."""

BASINS = (
    "#9ecae8", "#f2a7a0", "#a9d8a5", "#f5d08a", "#c7b3e0", "#8fd3cf", "#e8b4d4", "#cfc29a",
)  # fmt: skip
"""Colours of basins, light enough for the marks of their regimes."""

CHAOTIC, UNDECIDED, BEYOND = "#4d4d4d", "#d0d0d0", "#ffffff"
"""Colours of starts that end in chaos, of those that are undecided, and of those beyond a stop."""


def owner_colours(number: int) -> list[str]:
    """Colours of `number` coordinates or pairs: those of `OWNERS`, or shades where there are more
    of them."""
    if number <= len(OWNERS):
        return list(OWNERS[:number])
    from matplotlib import colormaps
    from matplotlib.colors import to_hex

    return [to_hex(colormaps["turbo"](share)) for share in np.linspace(0.03, 0.97, number)]
