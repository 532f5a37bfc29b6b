"""Linear screening of structures, against one oscillator after the other."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

from stochvi import (
    ConstantLoad,
    ImpactPair,
    Isolator,
    Matrices,
    NotApplicable,
    NotConverged,
    Oscillator,
    Restitution,
    Scene,
    Sine,
    TabulatedNoise,
    WhiteNoise,
    load_scene,
    screen,
    simulate,
)
from stochvi.isolators import clearance, clearance_curve
from stochvi.isolators.clearance import _closure_rates
from stochvi.isolators.moved_stops import at_clearances
from stochvi.methods.linearisation.structure_closure import solutions
from stochvi.model.model import model_of
from stochvi.results.deadline import Deadline
from stochvi.results.estimates import Estimate
from stochvi.scenes.datasets import shipped_scene
from stochvi.testing import assert_agrees
from support.commands import Run, one_document
from support.known import to_toml
from support.pairs import LAW, diagonal, pair, uncoupled

TRUCK = TabulatedNoise(profile="mil-std-810h-truck-vertical-5hz", on="base")
MOUNTS = {"a": (8.0, 0.05), "b": (12.0, 0.1), "c": (30.0, 0.2)}
"""Natural frequency in hertz, and damping ratio."""


def side_by_side() -> Scene:
    omega = [2.0 * math.pi * frequency for frequency, _ in MOUNTS.values()]
    rates = [2.0 * zeta * w for w, (_, zeta) in zip(omega, MOUNTS.values(), strict=True)]
    return Scene(
        structure=Matrices(
            coordinates=tuple(MOUNTS),
            mass=diagonal(1.0, 1.0, 1.0),
            damping=diagonal(*rates),
            stiffness=diagonal(*(w**2 for w in omega)),
        ),
        impact_pairs=[pair(name, name, 0.01) for name in MOUNTS],
        excitations=[TRUCK],
    )


def test_mounts_side_by_side_are_mounts_alone() -> None:
    found = screen(side_by_side())
    for name, (frequency, zeta) in MOUNTS.items():
        alone = screen(
            Scene(structure=Isolator(frequency_hz=frequency, zeta=zeta), excitations=[TRUCK])
        )
        own, gap = found.coordinates[name], found.impact_pairs[name]
        for quantity in ("displacement_std", "velocity_std", "acceleration_std"):
            assert getattr(own, quantity) == pytest.approx(getattr(alone, quantity), rel=1e-9)
        assert own.zero_crossing_rate == pytest.approx(alone.zero_crossing_rate, rel=1e-9)
        assert gap.displacement_std == own.displacement_std
        assert gap.rice_rate == pytest.approx(alone.rice_rate(0.01), rel=1e-6)
        assert gap.three_sigma_rate == pytest.approx(alone.rice_rate(gap.three_sigma), rel=1e-9)


def test_gaps_between_coordinates_and_loads() -> None:
    found = screen(uncoupled(pair("between", None, 3.0, ("x", "z"))))
    gap = found.impact_pairs["between"]
    assert gap.displacement_std == pytest.approx(math.sqrt(2.0), rel=1e-9)
    assert gap.velocity_std == pytest.approx(math.sqrt(5.0), rel=1e-9)
    assert gap.stops == {"lower": 3.0, "upper": 3.0}
    # noise on the masses themselves has no acceleration without it
    assert found.coordinates["x"].acceleration_std is None


def test_a_coordinate_at_rest_has_no_zero_crossings() -> None:
    scene = uncoupled(pair("z", "z", 3.0)).model_copy(
        update={"excitations": (WhiteNoise(intensity=0.2, on="x"),)}
    )
    found = screen(scene)
    assert found.coordinates["z"].displacement_std == 0.0
    assert found.coordinates["z"].zero_crossing_rate is None
    assert found.impact_pairs["z"].rice_rate == 0.0
    assert np.isfinite(found.coordinates["x"].displacement_std)


def test_one_mass_between_the_stops_of_two_pairs() -> None:
    """Two pairs with a stop each are one pair with both."""
    stops = {"lower": ImpactPair(name="near", lower=-0.3, law=LAW),
             "upper": ImpactPair(name="far", upper=25.0, law=LAW)}  # fmt: skip
    noise = WhiteNoise(intensity=0.2)
    unit = Oscillator(mass=1.0, damping=0.1, stiffness=1.0)
    found = screen(Scene(structure=unit, impact_pairs=[*stops.values()], excitations=[noise]))
    both = ImpactPair(lower=-0.3, upper=25.0, law=LAW)
    known = screen(Scene(structure=unit, impact_pairs=[both], excitations=[noise]))
    assert found.displacement_std == known.displacement_std
    total = sum(gap.rice_rate for gap in found.impact_pairs.values())
    assert total == pytest.approx(known.impact_pairs["stops"].rice_rate, rel=1e-12)
    assert found.notes == known.notes


def test_a_sine_is_refused() -> None:
    sine = Sine(amplitude=1.0, frequency_hz=1.0, on="x")
    with pytest.raises(NotApplicable, match="got a sine alone"):
        screen(uncoupled(pair("x", "x", 3.0)).model_copy(update={"excitations": (sine,)}))


def test_the_command_of_a_box(stochvi: Run, tmp_path: Path) -> None:
    scene = Path(__file__).parents[2] / "data" / "scenes" / "rigid-box.toml"
    done = stochvi("screen", scene, "--json", "-", "--out", tmp_path)
    assert done.code == 0
    document = one_document(done.out)
    assert document["coordinates"]["z"]["displacement_std"] > 0.0
    assert set(document["impact_pairs"]) == {"corner 1", "corner 2", "side"}
    assert "3 sigma (mm)" in done.err and "mrad rms" in done.err
    assert (tmp_path / "screening.csv").stat().st_size > 0
    assert json.loads(json.dumps(document)) == document


def test_hits_of_pairs_against_their_clearances() -> None:
    """Elastic stops leave the impacts of uncoupled pairs what Rice says, over what is left
    between the stops."""
    elastic = {"law": Restitution(coefficient=1.0)}
    scene = uncoupled(
        *(each.model_copy(update=elastic) for each in (pair("x", "x", 9.0), pair("z", "z", 9.0)))
    )
    curve = clearance_curve(scene, [[1.0, 1.5]], rel_error=0.1, seed=1)
    assert list(curve["pair"]) == ["x", "z"]
    assert curve["clearance"].tolist() == curve["clearance_in_sigma"].round(9).tolist()
    for _, row in curve.iterrows():
        inside = math.erf(row["clearance"] / math.sqrt(2.0))
        known = row["rice"] / inside
        assert row["closure"] == pytest.approx(known, rel=1e-6)
        half = 0.5 * (row["simulated_high"] - row["simulated_low"])
        assert_agrees(Estimate(value=row["simulated"], standard_error=half / 1.96), known)
        with pytest.raises(AssertionError):
            assert_agrees(Estimate(value=row["simulated"], standard_error=half / 1.96), row["rice"])
    with pytest.raises(ValueError, match="clearances must be positive"):
        clearance_curve(scene, [-1.0])


def test_clearances_of_pairs_are_measured_from_their_mean_gaps() -> None:
    load = ConstantLoad(force=0.5, on="x")
    scene = uncoupled(pair("x", "x", 3.0)).model_copy(
        update={"excitations": (*uncoupled().excitations, load)}
    )
    (moved,) = at_clearances(scene, np.array([2.0])).impact_pairs
    assert (moved.lower, moved.upper) == (pytest.approx(-1.5), pytest.approx(2.5))


def test_a_closure_that_takes_long_is_left_out_of_a_curve() -> None:
    """That of a box of six motions takes two seconds, which no budget counted."""
    scene = load_scene(shipped_scene("rigid-box"))
    with pytest.raises(NotConverged, match="before linearise:closure has converged"):
        solutions(model_of(scene), Deadline(0.0))
    late = Deadline.after(1e-3)
    assert _closure_rates(scene, late) == {}
    assert set(_closure_rates(uncoupled(pair("x", "x", 3.0)), Deadline.after(60.0))) == {"x"}


def test_the_command_of_clearances_of_pairs(stochvi: Run, tmp_path: Path) -> None:
    scene = tmp_path / "two.toml"
    document = uncoupled(pair("first", "x", 3.0), pair("second", "z", 2.0)).document()
    scene.write_text(to_toml(document), encoding="utf-8")
    done = stochvi(
        "clearance", scene, "--gaps", "1,1500mm", "--rel-error", "0.2", "--json", "-",
        "--out", tmp_path,
    )  # fmt: skip
    assert done.code == 0, done.err
    rows = one_document(done.out)["curve"]
    assert [row["pair"] for row in rows] == ["first", "second"] * 2
    assert [row["clearance_in_sigma"] for row in rows] == pytest.approx([1.0, 1.0, 1.5, 1.5])
    assert (tmp_path / "clearance.png").read_bytes().startswith(b"\x89PNG")
    assert "gap/sigma" in done.err


def test_a_budget_leaves_the_rows_of_pairs_that_are_known(monkeypatch: pytest.MonkeyPatch) -> None:
    """By paths of a fixed number, as a clock ends where the load of the machine has it end."""

    def ended(scene: Scene, **_: object) -> None:
        answer = simulate(scene, paths=64, seed=1, threads=1)
        raise NotConverged("the budget of 1 s ended after 64 paths; raise budget", answer)

    monkeypatch.setattr(clearance, "simulate", ended)
    with pytest.raises(NotConverged, match="before the impacts at 1000 mm were known") as late:
        clearance_curve(uncoupled(pair("x", "x", 3.0), pair("z", "z", 2.0)), [1.0], rel_error=0.01)
    curve = late.value.response
    assert list(curve["pair"]) == ["x", "z"]
    assert np.isfinite(curve[["rice", "simulated", "simulated_high"]].to_numpy()).all()
