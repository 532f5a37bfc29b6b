"""Tables in the units that a reader has chosen."""

from __future__ import annotations

import pandas as pd
import pytest

from stochvi.mathematics.shown_units import shown_in, units_of
from stochvi.results.column_units import in_chosen_units

INCH, FOOT = 0.0254, 0.3048


def test_columns_are_converted_where_their_unit_is_known_and_chosen() -> None:
    table = pd.DataFrame(
        {
            "time_s": [1.0], "x.displacement_m": [INCH], "ry.displacement_m": [0.5],
            "x.acceleration_m_s2.standard_error": [FOOT], "hit_rate_low": [2.0],
            "corner 1": [INCH], "limit": [3.0], "clearance_in_sigma": [4.0], "note": ["m"],
        }
    )  # fmt: skip
    with shown_in(units_of("in, ft/s2, per min")):
        found = in_chosen_units(table, {"corner 1": "m"})
    assert list(found) == [
        "time_s", "x.displacement_in", "ry.displacement_m",
        "x.acceleration_ft_s2.standard_error", "hit_rate_per_min_low",
        "corner 1_in", "limit", "clearance_in_sigma", "note",
    ]  # fmt: skip
    # an angle is no length, and a ratio has no unit
    assert found.iloc[0].tolist() == pytest.approx([1.0, 1.0, 0.5, 1.0, 120.0, 1.0, 3.0, 4.0, "m"])


def test_rows_are_converted_where_they_state_a_unit_that_has_a_choice() -> None:
    table = pd.DataFrame(
        {
            "unit": ["m", "m^2", "rad", "1", "m/s"],
            "value": [INCH, INCH**2, 1.0, 1.0, 1.0],
            "standard_error": [2.0 * INCH, float("nan"), 1.0, 1.0, 1.0],
            "method": "exact",
        }
    )
    with shown_in(units_of("in")):
        found = in_chosen_units(table)
    assert found["unit"].tolist() == ["in", "in²", "rad", "1", "m/s"]
    assert found["value"].tolist() == pytest.approx([1.0, 1.0, 1.0, 1.0, 1.0])
    assert found["standard_error"].iloc[0] == pytest.approx(2.0)


def test_without_a_choice_a_table_is_as_it_was() -> None:
    table = pd.DataFrame({"clearance": [0.004], "unit": ["m"], "value": [1]})
    assert in_chosen_units(table) is table
