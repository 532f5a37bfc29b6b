"""A rigid box: its modes and snubbers in tables, and its picture."""

from __future__ import annotations

from itertools import combinations, product
from typing import TYPE_CHECKING, Any

import numpy as np

from stochvi.isolators.sizing.answer import spoken_percent
from stochvi.scenes.rigid_body import AXES, RigidBody
from stochvi.views.colours import COLOURS
from stochvi.views.words import MM, four_digits

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes

    from stochvi.isolators.sizing.box_overview import BoxOverview
    from stochvi.isolators.sizing.pairs_answer import PairsSizing

SMALLEST_CHANCE = 1e-6
"""Chance of a hit below which all snubbers have the same colour."""


def modes_in_rows(box: BoxOverview) -> pd.DataFrame:
    """A row per mode: frequency, damping, and the mass that it moves along each axis."""
    import pandas as pd

    return pd.DataFrame(
        [
            {
                "mode": number,
                "Hz": four_digits(mode.frequency_hz),
                "zeta": f"{mode.damping_ratio or 0.0:.3g}",
                **{f"kg along {a}": f"{mode.effective_mass[a]:.3g}" for a in mode.effective_mass},
                "motion": mode.motion,
            }
            for number, mode in enumerate(box.modes, start=1)
        ]
    )


def one_axis_in_rows(sizing: PairsSizing) -> pd.DataFrame:
    """A row per pair: its clearance, and what three sigma of one oscillator would buy there."""
    import pandas as pd

    assert sizing.box is not None
    return pd.DataFrame(
        [
            {
                "pair": row["pair"],
                "clearance (mm)": four_digits(MM * sizing.clearances[row["pair"]].value)
                if row["pair"] in sizing.clearances
                else "fixed",
                "3 sigma of one axis (mm)": four_digits(MM * row["one_axis_three_sigma"]),
                "hit there": spoken_percent(row["chance_at_one_axis"]),
                "hit as the scene stands": spoken_percent(row["chance_as_given"]),
            }
            for row in sizing.box.pairs.to_dict("records")
        ]
    )


def plot_box(sizing: PairsSizing) -> Axes:
    """The box from outside: mounts, centre of mass, and snubbers, coloured by the chance that each
    alone is hit with the stops of the scene; of several at one place, by the largest chance."""
    import matplotlib.pyplot as plt
    from matplotlib.colors import LogNorm

    body, box = sizing.scene.structure, sizing.box
    assert isinstance(body, RigidBody) and box is not None
    pairs = [pair for pair in sizing.scene.impact_pairs if pair.at and pair.direction]
    mounts = np.array([mount.at for mount in body.mounts])
    places = np.array([pair.at for pair in pairs])
    directions = np.array([pair.direction for pair in pairs])
    directions = directions / np.linalg.norm(directions, axis=1)[:, None]
    figure = plt.figure(figsize=(6.8, 5.2), layout="constrained")
    ax: Any = figure.add_subplot(projection="3d")
    _draw_edges(ax, np.concatenate([mounts, places]))
    ax.scatter(*mounts.T, marker="s", s=40, color=COLOURS["stop"], label="mounts", depthshade=False)
    ax.scatter(0.0, 0.0, 0.0, marker="+", s=80, color="black", label="centre of mass")
    corners: dict[tuple[float, ...], list[str]] = {}
    for pair, place in zip(pairs, places.tolist(), strict=True):
        corners.setdefault(tuple(place), []).append(pair.name)
    alone = box.pairs.set_index("pair")["chance_as_given"]
    chance = np.array([alone[names].max() for names in corners.values()])
    length = 0.15 * float(np.ptp(np.concatenate([mounts, places]), axis=0).max())
    seen = ax.scatter(
        *np.array(list(corners)).T, c=np.clip(chance, SMALLEST_CHANCE, 1.0), s=90,
        cmap="inferno_r", norm=LogNorm(SMALLEST_CHANCE, 1.0), edgecolor="black", depthshade=False,
        label="snubbers",
    )  # fmt: skip
    ax.quiver(*places.T, *(length * directions).T, color="black", linewidth=1.0)
    # the labels below their corners, and room for them at the sides
    for corner, names in corners.items():
        below = corner - np.array([0.0, 0.0, 0.5 * length])
        ax.text(*below, _together(names), fontsize="small", ha="center", va="top",
                bbox={"color": "white", "alpha": 0.7, "pad": 0.5})  # fmt: skip
    for get, put in ((ax.get_xlim, ax.set_xlim), (ax.get_ylim, ax.set_ylim)):
        low, high = get()
        put(low - length, high + length)
    for axis in AXES:
        getattr(ax, f"set_{axis}label")(f"{axis} (m)")
    ax.set_aspect("equal")
    ax.locator_params(nbins=4)
    ax.grid(visible=False)
    figure.colorbar(
        seen, ax=ax, shrink=0.7, label="chance of a hit, the largest of the snubbers there"
    )
    ax.legend(frameon=False, fontsize="small", loc="upper left")
    found: Axes = ax
    return found


def _together(names: list[str]) -> str:
    """Names of snubbers at one place; words with which all of them begin are written once.

    >>> _together(["corner 1 x", "corner 1 y"]), _together(["left", "right"])
    ('corner 1 x, y', 'left, right')
    """
    parts = [name.rpartition(" ") for name in names]
    if len({head for head, _, _ in parts}) > 1:
        return ", ".join(names)
    return "".join(parts[0][:2]) + ", ".join(tail for _, _, tail in parts)


def _draw_edges(ax: Any, places: np.ndarray) -> None:
    """The edges of the smallest box along the axes that holds all places."""
    ends = list(zip(places.min(axis=0), places.max(axis=0), strict=True))
    for one, other in combinations(product(*ends), 2):
        if sum(a != b for a, b in zip(one, other, strict=True)) == 1:
            ax.plot(*zip(one, other, strict=True), color="0.6", linewidth=0.8)
