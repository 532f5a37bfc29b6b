"""Impact pairs from a table: what it says, with units, and the sentence where it says nothing."""

from __future__ import annotations

from pathlib import Path

import pytest

from stochvi import ImpactPair, Matrices, Restitution, Scene, SceneError, WhiteNoise, load_scene
from stochvi.scenes.pair_tables import read_pairs
from support.commands import Run

SCENE = """
pairs = {pairs}
[structure]
kind = "matrices"
coordinates = ["tip", "seat"]
mass = [[1, 0], [0, 1]]
damping = [[0.1, 0], [0, 0.1]]
stiffness = [[1, 0], [0, 1]]
[[excitation]]
kind = "white"
intensity = 0.2
on = "tip"
"""

TABLE = """# gaps of the assembly
name,on,between,lower (mm),upper (mm),tolerance (mm)
latch,tip,,-2.5,1.5,0.1
rail,,tip seat,,3,
,seat,,-4,,0.5
"""


def written(folder: Path, table: str, pairs: str = '"gaps.csv"') -> Path:
    (folder / "gaps.csv").write_text(table, encoding="utf-8")
    (folder / "scene.toml").write_text(SCENE.format(pairs=pairs))
    return folder / "scene.toml"


def test_a_table_is_the_pairs_that_it_lists(tmp_path: Path) -> None:
    scene = load_scene(written(tmp_path, TABLE))
    latch, rail, third = scene.impact_pairs
    assert (latch.name, latch.on, latch.between) == ("latch", "tip", None)
    assert (latch.lower, latch.upper) == pytest.approx((-0.0024, 0.0014), rel=1e-12)
    assert (rail.between, rail.lower, rail.upper) == (("tip", "seat"), None, 0.003)
    assert third.name == "gaps line 5"
    assert third.lower == pytest.approx(-0.0035, rel=1e-12)
    assert latch.law == Restitution(coefficient=0.5)
    again = Scene(**scene.document())
    assert again.impact_pairs == scene.impact_pairs


@pytest.mark.parametrize(
    ("heading", "row"),
    [
        ("name;on;upper [mm];tolerance [mm]", "latch;tip;1,5;0,1"),
        ("upper_mm,on,name,tolerance_mm", "1.5,tip,latch,0.1"),
        ("name\ton\tupper (in)\ttolerance (mil)", "latch\ttip\t0.0590551181102\t3.93700787402"),
        ("Name,On,Upper (m),Tolerance (um)", "latch,tip,0.0015,100"),
    ],
)
def test_units_and_signs_are_read_as_in_any_table(tmp_path: Path, heading: str, row: str) -> None:
    (tmp_path / "gaps.csv").write_text(f"{heading}\n{row}\n", encoding="utf-8")
    (found,) = read_pairs(str(tmp_path / "gaps.csv"))
    assert (found["name"], found["on"]) == ("latch", "tip")
    assert (found["upper"], found["tolerance"]) == pytest.approx((1.5e-3, 1e-4), rel=1e-9)


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ("name,on,upper\nlatch,tip,1.5\n", "needs the unit of a length in the heading of upper"),
        ("name,on,upper (Hz)\nlatch,tip,1.5\n", "needs the unit of a length"),
        ("name,on,uper (mm)\nlatch,tip,1.5\n", "has a column 'uper (mm)', expected name, on"),
        ("name,on,tolerance (mm)\nlatch,tip,1.5\n", "needs lower or upper"),
        ("name,upper (mm),upper (mm)\nlatch,1.5,1.5\n", "each column once"),
        (
            "name,between,upper (mm)\na,tip seat,1\nlatch,tip seat rail,1.5\n",
            "line 3: between must hold two names, as 'tip seat', got 'tip seat rail'",
        ),
        ("name,on,upper (mm)\na,tip,1\nb,tip,x\n", "line 3: expected a number in column 3"),
        ("name,on,upper (mm)\na,tip,1\nb,tip,1,2\n", "line 3: expected 3 numbers"),
        ("name,on,upper (mm)\na,tip,1\na,tip,2\n", "needs a name of its own"),
        ("name,on,upper (mm)\na,rail,1\n", "must be on 'tip' or 'seat', got 'rail'"),
        ("name,on,upper (mm)\n", "holds no rows"),
    ],
)
def test_a_table_that_is_not_understood_is_refused(tmp_path: Path, table: str, words: str) -> None:
    with pytest.raises(SceneError) as refusal:
        load_scene(written(tmp_path, table))
    assert words in str(refusal.value)


def test_pairs_of_a_table_share_what_the_scene_says_and_stand_behind_others(
    tmp_path: Path, stochvi: Run
) -> None:
    law = '{ kind = "restitution", coefficient = 0.8 }'
    file = written(tmp_path, TABLE, f'{{ file = "gaps.csv", law = {law} }}')
    file.write_text(
        file.read_text() + f'[[impact_pair]]\nname = "own"\non = "tip"\nupper = 1\nlaw = {law}\n'
    )
    names = [pair.name for pair in load_scene(file).impact_pairs]
    assert names == ["own", "latch", "rail", "gaps line 5"]
    assert {pair.law for pair in load_scene(file).impact_pairs} == {Restitution(coefficient=0.8)}
    assert stochvi("screen", file).code == 0
    for wrong in ("3", "{ law = 3 }"):
        with pytest.raises(SceneError, match="pairs must be the name of a table"):
            load_scene(written(tmp_path, TABLE, wrong))


def test_a_tolerance_puts_stops_nearer() -> None:
    pair = ImpactPair(lower=-2.0, upper=3.0, tolerance=0.5, law=Restitution(coefficient=0.5))
    assert (pair.lower, pair.upper, pair.tolerance) == (-1.5, 2.5, None)
    assert pair.replace(name="again").upper == 2.5
    both = ImpactPair(clearance=2.0, tolerance=0.5, law=Restitution(coefficient=0.5))
    assert (both.lower, both.upper) == (-1.5, 1.5)
    with pytest.raises(SceneError, match="needs lower < upper"):
        ImpactPair(clearance=0.2, tolerance=0.3, law=Restitution(coefficient=0.5))
    with pytest.raises(SceneError, match="differs between units"):
        ImpactPair(upper={"mean": 1.0, "std": 0.1}, tolerance=0.1, law=Restitution(coefficient=0.5))


def test_a_table_is_read_from_python_too(tmp_path: Path) -> None:
    written(tmp_path, TABLE)
    eye = [[1.0, 0.0], [0.0, 1.0]]
    scene = Scene(
        structure=Matrices(coordinates=("tip", "seat"), mass=eye, damping=eye, stiffness=eye),
        pairs=str(tmp_path / "gaps.csv"),
        excitations=[WhiteNoise(intensity=0.2, on="tip")],
    )
    assert scene.pairs is None
    assert scene.impact_pairs == load_scene(tmp_path / "scene.toml").impact_pairs
