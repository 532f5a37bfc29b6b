"""Axes and names of the picture of regimes under a sine."""

from __future__ import annotations

import dataclasses

import matplotlib.pyplot as plt
import numpy as np
import pytest

from stochvi import ImpactPair, Isolator, Restitution, Scene, Sine, harmonic_response
from stochvi.views.sine import draw_sine


@pytest.mark.parametrize(("high", "scale"), [(200.0, "log"), (11.0, "linear")])
def test_axes_are_logarithmic_where_motions_of_all_sizes_are_drawn(high: float, scale: str) -> None:
    """The largest displacement falls by (200 / 5)^2 over the first range."""
    scene = Scene(
        structure=Isolator(mass=1.0, frequency_hz=14.0, zeta=0.5),
        impact_pairs=[ImpactPair(clearance=1.0, law=Restitution(coefficient=0.5))],
        excitations=[Sine(on="base", amplitude=9.81, frequency_hz=14.0)],
    )
    found = harmonic_response(scene, np.geomspace(5.0, high, 30), most_impacts=1)
    ax = draw_sine(found)
    assert (ax.get_yscale(), ax.get_xscale()) == (scale, scale)
    low, top = ax.get_ylim()
    drawn = ax.lines[0].get_ydata()
    assert top > np.nanmax(drawn) and (low < np.nanmin(drawn) if scale == "log" else low == 0.0)
    assert "no impacts" in ax.figure.legends[0].get_texts()[0].get_text()
    plt.close(ax.figure)


def test_no_picture_is_drawn_where_no_motion_was_found() -> None:
    scene = Scene(
        structure=Isolator(mass=1.0, frequency_hz=14.0, zeta=0.5),
        excitations=[Sine(on="base", amplitude=9.81, frequency_hz=14.0)],
    )
    found = harmonic_response(scene, [10.0, 20.0])
    plt.close(draw_sine(found).figure)
    with pytest.raises(ValueError, match="no motion was found"):
        draw_sine(dataclasses.replace(found, branches=()))
    plt.close("all")
