"""Axes of pictures as they are written."""

from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np

from stochvi.views.axes import as_written


def test_a_logarithmic_axis_shows_its_lines_and_not_the_zero_of_a_band() -> None:
    """Fatigue damage over two decades of frequency falls by fourteen."""
    frequency = np.geomspace(5.0, 500.0, 20)
    damage = np.geomspace(1e5, 1e-9, 20)
    _, ax = plt.subplots()
    ax.fill_between(frequency, 1e-300, 2.0 * damage)
    ax.plot(frequency, damage)
    ax.set_yscale("log")
    assert ax.get_ylim()[0] < 1e-100
    as_written(ax)
    low, high = ax.get_ylim()
    assert 1e-11 < low < 1e-9 and 1e5 < high < 1e7
