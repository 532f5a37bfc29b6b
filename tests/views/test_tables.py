"""Tables on a terminal: what stands where, and what stands for a number that is not there."""

from __future__ import annotations

import io
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from types import SimpleNamespace
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest
from matplotlib.axes import Axes
from rich.console import Console

from stochvi import Response, Scene, average, check, explain, fokker_planck, linearise, load_scene
from stochvi.isolators.sizing.answer import Probability
from stochvi.mathematics.units import LENGTH, RATE, TIME, shown_in, units_of
from stochvi.results.base import stated
from stochvi.results.estimates import Estimate
from stochvi.scenes.datasets import shipped_scene
from stochvi.views.axes import Chart, Scale, as_written, bounds_of, panels
from stochvi.views.pages import Grid, Section, Told, print_told
from stochvi.views.pictures import VIEWS, function_of, response_told, view_of
from stochvi.views.tables import of_your_stops
from stochvi.views.verification import check_told, explanation_told


def test_numbers_stand_to_the_right_whether_they_are_text_or_not() -> None:
    frame = pd.DataFrame(
        {
            "gap": ["6.000", "10.00"],
            "hits found": ["4", "-"],
            "speed found": [0.5, float("nan")],
            "how": ["by counting", "-"],
        }
    )
    written = io.StringIO()
    told = Told(sections=[Section(grids=Grid.of("hits", frame, words=("how",)))])
    print_told(Console(file=written, width=100), told)
    assert written.getvalue().splitlines() == [
        "",
        "hits",
        "  gap  hits found  speed found  how",
        "6.000           4          0.5  by counting",
        "10.00           -            -  -",
    ]


def test_a_caption_takes_the_width_of_the_terminal_not_that_of_its_table() -> None:
    written = io.StringIO()
    caption = "impacts of a mission, by the clearance of the stops on either side"
    grid = Grid(caption=caption, headings=["mm", ""], rows=[["1", "two\nlines"]], words=0)
    print_told(Console(file=written, width=70), Told(sections=[Section(grids=[grid])]))
    lines = written.getvalue().splitlines()
    assert lines == ["", caption, "mm", " 1    two", "    lines"]


def test_nothing_is_relative_to_a_mean_that_is_rounding_error() -> None:
    """Its bias over it was printed as 5.7e+14."""
    written = io.StringIO()
    found = average(load_scene(shipped_scene("oscillator-lossy")))
    mean = found.coordinates["x"]["displacement_mean"]
    assert 0.0 < abs(mean.value) < 1e-12 and mean.bias
    print_told(Console(file=written, width=100), response_told(found))
    (row,) = (line for line in written.getvalue().splitlines() if "mean displacement" in line)
    assert row.split() == ["x", "mean", "displacement", "0", "m"]


@pytest.mark.parametrize("method", [average, linearise, fokker_planck])
def test_methods_say_which_impacts_their_rates_count(method: Callable[[Scene], Response]) -> None:
    """Where slow impacts are many, rates of all and of fast ones are different numbers."""
    lossy = method(load_scene(shipped_scene("oscillator-lossy")))
    (pair,) = lossy.impact_pairs.values()
    above = pair["speed_threshold"]
    counted = f"faster than {above:.3g} m/s" if above else "of all speeds"
    assert f"rates count impacts {counted}" in lossy.assumptions
    assert bool(above) is (method is fokker_planck)
    elastic = method(load_scene(shipped_scene("oscillator-elastic")))
    assert not any("rates count" in each for each in elastic.assumptions)


@pytest.mark.usefixtures("early_end")
def test_a_simulation_that_stopped_early_is_not_called_left_out() -> None:
    """It was judged by what it reached; methods that were not judged at all are left out."""
    found = check(load_scene(shipped_scene("oscillator-lossy")), rel_error=1e-5)
    written = io.StringIO()
    print_told(Console(file=written, width=500), check_told(found))
    lines = [line.rstrip() for line in written.getvalue().splitlines()]
    (early,) = (line for line in lines if "early" in line)
    assert early.startswith("simulate stopped early")
    assert any(line.startswith("left out: exact does not apply") for line in lines)


def test_the_modes_of_a_box_are_not_cut_to_the_width_of_the_terminal() -> None:
    found = explain(load_scene(shipped_scene("rigid-box")), threads=1)
    written = io.StringIO()
    print_told(Console(file=written, width=60), explanation_told(found))
    lines = [line.rstrip() for line in written.getvalue().splitlines()]
    for mode in found.modes:
        assert any(line.endswith(mode.motion) for line in lines)
    assert any("zeta  along x (kg)  along y (kg)  along z (kg)" in line for line in lines)


def test_a_number_that_is_not_known_is_a_dash() -> None:
    """Where a budget ended before impacts were counted, a table of a sizing ended in a
    traceback."""
    frame = pd.DataFrame({"hits": pd.Series([2.5, None, float("nan")], dtype=object)})
    (found,) = Grid.of("hits", frame.assign(speed=math.nan))
    assert (found.headings, found.rows) == (["hits"], [["2.5"], ["-"], ["-"]])


# ------------------------------------------------------------------------------
# Axes of pictures as they are written.
# ------------------------------------------------------------------------------


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


def test_a_chart_shows_si_numbers_in_the_units_of_its_scales_with_their_bounds() -> None:
    table = pd.DataFrame(
        {"clearance": [0.0127, 0.0254], "hit_rate": [2.0, 1.0], "hit_rate_low": [1.5, 0.5],
         "hit_rate_high": [4.0, 3.0], "rice_rate": [3.0, 2.0]}
    )  # fmt: skip
    with shown_in(units_of("in, 1/h")):
        chart = Chart.on(None, Scale("clearance", LENGTH), Scale("impacts", RATE, log=True))
        chart.column(table, "clearance", "hit_rate", "simulated")
        chart.column(table, "clearance", "hit_rate", "simulated", form="o")
        chart.column(table, "clearance", "rice_rate", "by Rice")
        ax = chart.finish()
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("clearance (in)", "impacts (1/h)")
    assert (ax.get_xscale(), ax.get_yscale()) == ("linear", "log")
    line, marks, rice = ax.get_lines()[0], ax.containers[0], ax.get_lines()[-1]
    for each in (line, marks.lines[0]):  # type: ignore[attr-defined]
        assert each.get_xdata() == pytest.approx([0.5, 1.0])
        assert each.get_ydata() == pytest.approx([7200.0, 3600.0])
    assert rice.get_ydata() == pytest.approx([10800.0, 7200.0])
    band, bars = ax.collections  # a column without bounds has neither
    ends = band.get_paths()[0].get_extents()
    assert [ends.y0, ends.y1] == pytest.approx([1800.0, 14400.0])
    assert bars.get_segments()[0][:, 1] == pytest.approx([5400.0, 14400.0])  # type: ignore[attr-defined]
    legend = ax.get_legend()
    assert legend is not None
    assert [text.get_text() for text in legend.get_texts()] == ["simulated", "by Rice"]
    plt.close("all")


def test_bounds_of_a_column_come_from_its_standard_error_too() -> None:
    table = pd.DataFrame({"share": [0.5], "share_error": [0.1], "other": [1.0]})
    bounds = bounds_of(table, "share")
    assert [float(bounds[end][0]) for end in ("low", "high")] == pytest.approx([0.304, 0.696], 1e-3)
    assert bounds_of(table, "other") == {}


def test_panels_share_the_scale_of_their_column_and_given_axes_get_the_first() -> None:
    def draw(words: str, ax: Axes) -> None:
        chart = Chart(ax, Scale("time", TIME), Scale(words, LENGTH))
        chart.curve([0.0, 1.0], [0.0, 1.0])
        chart.finish()

    both = [partial(draw, words) for words in ("above", "below")]
    figure: Any = panels(None, both, (4.0, 4.0), "two").figure
    assert [ax.get_ylabel() for ax in figure.axes] == ["above (mm)", "below (mm)"]
    assert [ax.get_xlabel() for ax in figure.axes] == ["", "time (s)"]
    given = plt.subplots()[1]
    assert panels(given, both, (4.0, 4.0)) is given
    assert given.get_ylabel() == "above (mm)" and len(given.lines) == 1
    plt.close("all")


@pytest.mark.parametrize("name", VIEWS)
def test_what_the_view_of_an_answer_names_is_there(name: str) -> None:
    view = VIEWS[name]
    assert callable(view.plots)
    for place in filter(None, (view.drawn, view.page, view.beside)):
        assert callable(function_of(view.room, place))
    if name != "Transient":  # of no command
        assert callable(function_of(view.room, f"{view.name}_told"))
    assert bool(view.page) == bool(view.numbers)


def test_a_part_of_an_answer_states_the_headings_and_units_of_its_table() -> None:
    @dataclass(frozen=True)
    class Shown:
        stop: str = stated("stop", "")
        paths: int = stated("paths")
        reach: Estimate | None = stated("reach", "m")
        speed: float | None = stated("speed", "m/s")
        untold: float = 0.0

    rows = [(Shown("upper", 12345, Estimate(value=0.004, standard_error=1e-4), 2.5),)]
    (found,) = Grid.of("stops", rows)
    assert found.headings == ["stop", "paths", "reach (mm)", "speed (m/s)"]
    assert found.rows == [["upper", "12345", "4.00 ± 0.20", "2.5"]]
    with shown_in(units_of("in, in/s")):
        (found,) = Grid.of("stops", rows, "speed; reach {.1g}")
    assert found.headings == ["speed (in/s)", "reach (in)"]
    assert found.rows == [["98.43", "0.1575 ± 0.0077"]]
    assert Grid.of("stops", [(Shown("lower", 1),)])[0].rows == [["lower", "1"]]
    assert Grid.of("stops", []) == []


def test_columns_are_described_by_heading_name_and_form() -> None:
    rows = [{"clearance": 0.004, "share": 0.25, "by": "bursts", "gap": "fixed", "rate": None}]
    columns = "place = clearance {length}; share {percent}; by {way}; gap {length}; twice {1/h}"
    (found,) = Grid.of("places", rows, f"{columns}; rate", twice=lambda row: row["share"])
    assert found.headings == ["place (mm)", "share", "by", "gap (mm)", "twice (1/h)"]
    assert found.rows == [["4.000", "25 %", "clusters", "fixed", "900"]]
    with pytest.raises(AttributeError, match="no part of a row has speed"):
        Grid.of("places", rows, "speed")


def test_a_number_of_a_table_has_the_error_that_stands_beside_it() -> None:
    rows = [{"ratio": 0.5, "ratio_error": 0.01}, {"ratio": -math.inf, "ratio_error": 0.0}]
    (found,) = Grid.of("of", rows, "ratio")
    assert found.rows == [["0.500 ± 0.020"], ["-inf"]]
    (alone,) = Grid.of("of", [{"ratio": 0.5, "other_error": 0.01}], "ratio")
    assert alone.rows == [["0.5"]]


def test_a_view_of_nothing_is_noticed() -> None:
    with pytest.raises(KeyError):
        function_of("pictures", "nothing_told")
    with pytest.raises(NotImplementedError, match="no picture of int"):
        view_of(1)


def test_a_chance_that_may_be_certain_is_a_lower_limit() -> None:
    """Stops that are hit 30 times a second were "94.7 % likely to be hit" where time was short."""

    def said(value: float, lower: float, upper: float) -> list[str]:
        given = Probability(value=value, lower=lower, upper=upper)
        return of_your_stops(SimpleNamespace(several=True, as_given=given))  # type: ignore[arg-type]

    assert said(0.947, 0.894, 1.0) == ["Your stops: over 89.4 % likely to be hit"]
    assert said(0.947, 0.94, 0.955) == ["Your stops: 94.7 % likely to be hit"]
    assert said(1.0, 1.0, 1.0) == ["Your stops: hit almost surely"]
