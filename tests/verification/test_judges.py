"""No number without a judge: each quantity of each answer is held against something independent."""

from __future__ import annotations

import pytest

from support import judges


def test_every_quantity_of_every_answer_has_a_judge() -> None:
    """A new field needs a row in docs/judges.toml, and with it a test that could refute it."""
    listed = {(name, key) for name, key, _ in judges.table()}
    known = {(name, key) for name, keys in judges.quantities().items() for key in keys}
    assert sorted(known - listed) == [], "no judge"
    assert sorted(listed - known) == [], "no such quantity"


def test_no_quantity_is_listed_twice() -> None:
    listed = [(name, key) for name, key, _ in judges.table()]
    assert sorted({each for each in listed if listed.count(each) > 1}) == []


def test_every_judge_exists() -> None:
    rows = [*judges.table(), *judges.table("tables")]
    named = {judge for _, _, found in rows if isinstance(found, list) for judge in found}
    assert len(named) > 80
    assert sorted(judge for judge in named if not judges.exists(judge)) == []


@pytest.mark.parametrize(
    "judge", ["results/estimates::no_such_test", "results/no_file::any", "study 99"]
)
def test_a_judge_that_is_not_there_is_noticed(judge: str) -> None:
    assert not judges.exists(judge)


def test_numbers_of_an_answer_are_found() -> None:
    """The negative control: what lies in tables, lists and parts is a quantity as well."""
    found = judges.quantities()
    assert {"collision_rate", "peak_force"} <= found["PairResponse"]
    assert {"curve", "required", "sigma"} <= found["Sizing"]
    assert {"modes", "natural_frequency_hz"} <= found["Explanation"]
    assert not {"method", "warnings", "screening"} & found["Sizing"]
