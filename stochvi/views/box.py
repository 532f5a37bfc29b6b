"""A rigid box: its modes and snubbers in tables, and its picture."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations, product
from typing import TYPE_CHECKING, Any

import numpy as np

from stochvi.mathematics.shown_units import LENGTH
from stochvi.scenes.structures.rigid_body import AXES, RigidBody
from stochvi.views.colours import COLOURS
from stochvi.views.words import chance_in_words, four_digits

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes

    from stochvi.isolators.sizing.answer import Sizing
    from stochvi.isolators.sizing.box_overview import BoxOverview
    from stochvi.scenes.scene import Scene

SMALLEST_CHANCE = 1e-6
"""Probability of an impact below which all snubbers have the same colour."""


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


def one_axis_in_rows(sizing: Sizing) -> pd.DataFrame:
    """A row per pair: its clearance, and what three sigma of one oscillator would buy there."""
    import pandas as pd

    assert sizing.box is not None
    return pd.DataFrame(
        [
            {
                "pair": row["pair"],
                f"clearance ({LENGTH})": four_digits(LENGTH(sizing.clearances[row["pair"]].value))
                if row["pair"] in sizing.clearances
                else "fixed",
                f"3 sigma of one axis ({LENGTH})": four_digits(LENGTH(row["one_axis_three_sigma"])),
                "hit there": chance_in_words(row["chance_at_one_axis"]),
                "hit as the scene stands": chance_in_words(row["chance_as_given"]),
            }
            for row in sizing.box.pairs.to_dict("records")
        ]
    )


def plot_box(sizing: Sizing) -> Axes:
    """Draw the box. The colour of a snubber is the probability that it alone is hit with the stops
    of the scene; several at one place take the largest."""
    assert sizing.box is not None
    table = sizing.box.pairs
    return draw_box(sizing.scene, dict(zip(table["pair"], table["chance_as_given"], strict=True)))


def draw_box(scene: Scene, chances: Mapping[str, float] | None = None) -> Axes:
    """Draw a rigid box from outside: mounts, centre of mass, and snubbers with their directions.

    Parameters
    ----------
    scene
        A scene of a rigid body.
    probabilities
        Probability of an impact by the name of the pair, which colours the snubbers; without it
        they have one colour.
    """
    import matplotlib.pyplot as plt

    body = scene.structure
    assert isinstance(body, RigidBody)
    pairs = [pair for pair in scene.impact_pairs if pair.at and pair.direction]
    mounts = np.array([mount.at for mount in body.mounts])
    places = np.array([pair.at for pair in pairs]).reshape(-1, 3)
    directions = np.array([pair.direction for pair in pairs]).reshape(-1, 3)
    directions = directions / np.linalg.norm(directions, axis=1)[:, None]
    figure = plt.figure(figsize=(6.8, 5.2), layout="constrained")
    ax: Any = figure.add_subplot(projection="3d")
    _draw_edges(ax, np.concatenate([mounts, places]))
    ax.scatter(*mounts.T, marker="s", s=40, color=COLOURS["stop"], label="mounts", depthshade=False)
    ax.scatter(0.0, 0.0, 0.0, marker="+", s=80, color="black", label="centre of mass")
    corners: dict[tuple[float, ...], list[str]] = {}
    for pair, place in zip(pairs, places.tolist(), strict=True):
        corners.setdefault(tuple(place), []).append(pair.name)
    length = 0.15 * float(np.ptp(np.concatenate([mounts, places]), axis=0).max())
    _draw_snubbers(ax, corners, chances)
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
    ax.legend(frameon=False, fontsize="small", loc="upper left")
    found: Axes = ax
    return found


def _draw_snubbers(
    ax: Any, corners: Mapping[tuple[float, ...], list[str]], chances: Mapping[str, float] | None
) -> None:
    """Draw a dot at each place of snubbers, coloured by the largest of their probabilities."""
    if not corners:
        return
    style = {"s": 90, "edgecolor": "black", "depthshade": False, "label": "snubbers"}
    places = np.array(list(corners)).T
    if chances is None:
        ax.scatter(*places, color=COLOURS["linearise:motion"], **style)
        return
    from matplotlib.colors import LogNorm

    risk = np.array([max(chances[name] for name in names) for names in corners.values()])
    seen = ax.scatter(
        *places, c=np.clip(risk, SMALLEST_CHANCE, 1.0), cmap="inferno_r",
        norm=LogNorm(SMALLEST_CHANCE, 1.0), **style,
    )  # fmt: skip
    ax.get_figure().colorbar(
        seen, ax=ax, shrink=0.7, label="probability of an impact, the largest of the snubbers there"
    )


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
