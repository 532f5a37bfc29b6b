"""Tables on a terminal: what stands where, and what stands for a number that is not there."""

import io

import pandas as pd
from rich.console import Console

from stochvi.views.tables import print_frame


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
    print_frame(Console(file=written, width=100), frame, "hits")
    _, *lines = written.getvalue().splitlines()
    assert [line.rstrip() for line in lines] == [
        "  gap  hits found  speed found  how",
        "6.000           4          0.5  by counting",
        "10.00           -            -  -",
    ]
