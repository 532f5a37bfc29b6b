"""Screening of isolators, and impact rate against clearance."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.stats import norm

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
from stochvi.isolators import clearance_curve, screening, size
from stochvi.isolators.screening import (
    _closure_rates,
    at_clearances,
    clearance_notes,
    predicted_curve,
    predicted_rates,
    unseen_notes,
)
from stochvi.isolators.sizing.answer import box_overview
from stochvi.isolators.sizing.review import motion_between_stops
from stochvi.mathematics.units import STANDARD_GRAVITY
from stochvi.methods.linearisation.structure_closure import solutions
from stochvi.model.model import model_of
from stochvi.results.deadline import Deadline
from stochvi.results.errors import SceneError
from stochvi.results.estimates import Estimate
from stochvi.scenes import RigidBody
from stochvi.scenes.datasets import shipped_scene, zoo_files
from stochvi.testing import assert_agrees
from support.boxes import box, scene_with, tables
from support.commands import Run, one_document
from support.known import oscillator, to_toml
from support.pairs import LAW as LAW_OF_PAIRS
from support.pairs import diagonal, pair, uncoupled
from support.sized import scene_between_stops

STOPS = ImpactPair(lower=-1e-3, upper=2e-3, law=Restitution(coefficient=1.0))


def white_mount(frequency_hz: float, Q: float, density: float) -> Scene:
    return Scene(
        structure=Isolator(frequency_hz=frequency_hz, Q=Q),
        impact_pairs=[STOPS],
        excitations=[WhiteNoise(density=density, unit="g2/Hz")],
    )


def test_white_noise_gives_miles_and_the_exact_absolute_acceleration() -> None:
    linear = screen(white_mount(200.0, 20.0, 0.1))
    assert linear.miles is not None
    assert linear.miles / STANDARD_GRAVITY == pytest.approx(25.06628274631, rel=1e-12)
    factor = math.sqrt(1.0 + 1.0 / 20.0**2)
    assert linear.acceleration_std == pytest.approx(linear.miles * factor, rel=1e-12)
    relative = screen(white_mount(100.0, 10.0, 0.04)).displacement_std
    assert relative == pytest.approx(0.000196902338044968, rel=1e-12)


def test_ten_hertz_at_three_sigma_is_hit_eight_hundred_times_an_hour() -> None:
    linear = screen(white_mount(10.0, 10.0, 0.01))
    hits = 3600.0 * linear.rice_rate(3.0 * linear.displacement_std)
    assert hits == pytest.approx(2.0 * 36000.0 * math.exp(-4.5), rel=1e-12)


def test_a_curve_between_elastic_stops_in_white_noise_is_the_exact_one() -> None:
    scene = white_mount(10.0, 10.0, 0.01)
    sigma = screen(scene).displacement_std
    curve = clearance_curve(scene, [sigma, 2.0 * sigma], rel_error=0.005, seed=2)
    # closure is exact here, so its rate must lie within 4.5 / 1.96 half widths of the interval
    half = (curve["simulated_high"] - curve["simulated_low"]) / 2.0
    assert (abs(curve["simulated"] - curve["closure"]) < 4.5 / 1.96 * half).all()
    assert (curve["closure"] > curve["rice"]).all()
    again = predicted_rates(scene, list(curve["clearance"]))
    np.testing.assert_allclose(again["closure"], curve["closure"], rtol=1e-12)


def test_between_the_places_of_a_curve_the_closure_is_interpolated() -> None:
    scene = white_mount(10.0, 10.0, 0.01)
    places = screen(scene).displacement_std * np.array([1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0])
    smooth = predicted_curve(scene, predicted_rates(scene, list(places)))
    solved = predicted_rates(scene, list(smooth["clearance"]))
    np.testing.assert_allclose(smooth["closure"], solved["closure"], rtol=0.02)
    np.testing.assert_allclose(smooth["rice"], solved["rice"], rtol=1e-12)
    assert smooth["clearance_in_sigma"].iloc[0] == pytest.approx(1.0)


def test_a_closure_that_no_time_is_left_for_is_left_out() -> None:
    scene = white_mount(10.0, 10.0, 0.01)
    late = predicted_rates(scene, [2e-3, 3e-3], Deadline(0.0))
    assert late["closure"].isna().all()
    np.testing.assert_allclose(late["rice"], predicted_rates(scene, [2e-3, 3e-3])["rice"])


def test_clearances_share_a_budget_and_those_without_an_answer_are_named() -> None:
    scene = white_mount(10.0, 10.0, 0.01)
    with pytest.raises(
        NotConverged, match=r"the impacts at 2 mm, 3 mm were known to .* 0\.01"
    ) as late:
        clearance_curve(scene, [2e-3, 3e-3], rel_error=0.01, budget=1e-3)
    curve = late.value.partial
    assert list(curve["clearance"]) == [2e-3]  # the second was not begun
    # in so short a time impacts may not be seen: their rate is then below a limit
    assert 0.0 <= curve["simulated"][0] <= curve["simulated_high"][0] > 0.0


def test_clearance_is_measured_from_where_the_mass_hangs() -> None:
    scene = white_mount(10.0, 10.0, 0.01)
    hanging = scene.model_copy(
        update={"excitations": (*scene.excitations, ConstantLoad(acceleration=9.80665))}
    )
    sag = -9.80665 / hanging.structure.omega**2
    pair = at_clearances(hanging, 1e-3).impact_pairs[0]
    assert (pair.lower, pair.upper) == pytest.approx((sag - 1e-3, sag + 1e-3))


def test_what_screening_does_not_cover_says_why() -> None:
    undamped = oscillator(-1.0, 1.0, 1.0, damping=0.0)
    with pytest.raises(NotApplicable, match="there is no damping at"):
        screen(undamped)
    bare = Scene(
        structure=Isolator(frequency_hz=12.0, zeta=0.1),
        excitations=[TabulatedNoise(profile="navmat-p-9492")],
    )
    with pytest.raises(NotApplicable, match="needs an impact_pair"):
        clearance_curve(bare, [1e-3])
    with pytest.raises(ValueError, match="clearances must be positive"):
        clearance_curve(white_mount(10.0, 10.0, 0.01), [-1e-3])


def test_a_mass_that_noise_pushes_is_screened_without_the_acceleration_of_a_base() -> None:
    linear = screen(oscillator(-1.0, 3.0, 1.0))
    # theta = 1: sigma = s_v = 1
    assert (linear.displacement_std, linear.velocity_std) == pytest.approx((1.0, 1.0), rel=1e-12)
    assert linear.acceleration_std is linear.miles is linear.input_acceleration_std is None
    gap = linear.impact_pairs["stops"]
    hits = (math.exp(-0.5) + math.exp(-4.5)) / (2.0 * math.pi)
    assert gap.rice_rate == pytest.approx(hits, rel=1e-12)
    assert "absolute acceleration" not in list(linear.to_frame()["quantity"])


def test_a_mass_with_one_stop_is_hit_on_one_side() -> None:
    """One elastic stop in white noise: Rice's rate over the probability of what lies before it."""
    scene = oscillator(None, 5.0, 1.0)
    curve = clearance_curve(scene, [1.0], rel_error=0.02, seed=3)
    rice = math.exp(-0.5) / (2.0 * math.pi)
    known = rice / (0.5 + 0.5 * math.erf(math.sqrt(0.5)))
    (row,) = curve.to_dict("records")
    assert row["rice"] == pytest.approx(rice, rel=1e-12)
    half = 0.5 * (row["simulated_high"] - row["simulated_low"])
    assert abs(row["simulated"] - known) < 4.5 / 1.96 * half
    assert abs(row["simulated"] - 2.0 * known) > 4.5 / 1.96 * half


def test_a_load_that_moves_the_mass_further_than_a_gap_is_noted() -> None:
    scene = white_mount(10.0, 10.0, 0.01)
    gravity = ConstantLoad(acceleration=-STANDARD_GRAVITY)  # of the base, downwards
    loaded = scene.model_copy(update={"excitations": (*scene.excitations, gravity)})
    sag = STANDARD_GRAVITY / (20.0 * math.pi) ** 2
    linear = screen(loaded)
    (note,) = set(clearance_notes(linear, [0.9 * sag, 2.0 * sag])) - set(linear.notes)
    assert "+2.484 mm, more than the clearance of 2.236 mm" in note
    assert clearance_notes(linear, [1.1 * sag]) == linear.notes
    assert clearance_notes(screen(scene), [0.9 * sag]) == screen(scene).notes


def test_numbers_of_a_screening_are_sums_over_frequency() -> None:
    """A table by plain sums over many frequencies; Miles' formula at the resonance; gravity."""
    hertz, zeta, psd = 12.0, 0.1, [0.01, 0.04, 0.002]
    table = TabulatedNoise(frequency_hz=[5.0, 20.0, 200.0], density=psd, unit="g2/Hz")
    mount = Isolator(mass=1.0, stiffness=(2.0 * np.pi * hertz) ** 2,
                     damping=4.0 * np.pi * zeta * hertz, gravity=True)  # fmt: skip
    stops = ImpactPair(lower=-8e-3, upper=5e-3, law=Restitution(coefficient=0.5))
    scene = Scene(structure=mount, impact_pairs=[stops], excitations=[table])
    found = screen(scene)
    f = np.geomspace(5.0, 200.0, 400_001)
    density = np.exp(np.interp(np.log(f), np.log([5.0, 20.0, 200.0]), np.log(psd))) * 9.80665**2
    w, omega = 2.0 * np.pi * f, 2.0 * np.pi * hertz
    gain = np.abs(1.0 / (omega**2 - w**2 + 2j * zeta * omega * w)) ** 2
    felt = omega**4 + (2.0 * zeta * omega * w) ** 2

    def root(part: np.ndarray) -> float:
        return math.sqrt(np.trapezoid(part * density, f))

    assert found.displacement_std == pytest.approx(root(gain), rel=1e-6)
    assert found.velocity_std == pytest.approx(root(gain * w**2), rel=1e-6)
    assert found.acceleration_std == pytest.approx(root(gain * felt), rel=1e-6)
    assert found.input_acceleration_std == pytest.approx(root(np.ones_like(f)), rel=1e-6)
    crossings = root(gain * w**2) / root(gain) / (2.0 * math.pi)
    assert found.zero_crossing_rate == pytest.approx(crossings, rel=1e-6)
    there = float(np.interp(hertz, f, density))
    assert found.miles == pytest.approx(
        math.sqrt(0.5 * np.pi * hertz / (2.0 * zeta) * there), rel=1e-5
    )
    sized = size(scene, probability=0.5, mission=10.0, rel_error=0.3, seed=1)
    sag = 9.80665 / omega**2
    assert sized.sigma == pytest.approx(root(gain), rel=1e-6)
    gap = sized.to_dict()["gap"]
    assert gap["mean_position"] == pytest.approx(-sag, rel=1e-9)
    assert sorted(gap["distances"].values()) == pytest.approx(
        sorted((8e-3 - sag, 5e-3 + sag)), rel=1e-9
    )


def test_rates_that_were_hardly_seen_have_a_note_for_each() -> None:
    rows = [
        {"pair": "left", "clearance": 3e-3, "simulated": 0.2, "simulated_high": 0.22},
        {"pair": "left", "clearance": 5e-3, "simulated": 0.0, "simulated_high": 0.0123},
        {"pair": "right", "clearance": 5e-3, "simulated": 0.0, "simulated_high": 0.0},
    ]
    (note,) = unseen_notes(pd.DataFrame(rows))
    assert note.startswith("at 5 mm hardly any impact on left was seen: the rate is at most 0.0123")


# ------------------------------------------------------------------------------
# Linear screening of structures, against one oscillator after the other.
# ------------------------------------------------------------------------------


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
    stops = {"lower": ImpactPair(name="near", lower=-0.3, law=LAW_OF_PAIRS),
             "upper": ImpactPair(name="far", upper=25.0, law=LAW_OF_PAIRS)}  # fmt: skip
    noise = WhiteNoise(intensity=0.2)
    unit = Oscillator(mass=1.0, damping=0.1, stiffness=1.0)
    found = screen(Scene(structure=unit, impact_pairs=[*stops.values()], excitations=[noise]))
    both = ImpactPair(lower=-0.3, upper=25.0, law=LAW_OF_PAIRS)
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
    done = stochvi("screen", scene, "-v", "--json", "-", "--out", tmp_path)
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

    monkeypatch.setattr(screening, "simulate", ended)
    with pytest.raises(NotConverged, match="before the impacts at 1000 mm were known") as late:
        clearance_curve(uncoupled(pair("x", "x", 3.0), pair("z", "z", 2.0)), [1.0], rel_error=0.01)
    curve = late.value.response
    assert list(curve["pair"]) == ["x", "z"]
    assert np.isfinite(curve[["rice", "simulated", "simulated_high"]].to_numpy()).all()


# ------------------------------------------------------------------------------
# The page of a sizing under filtered noise, whose records name the oscillator of each column.
# ------------------------------------------------------------------------------


def test_the_motion_under_filtered_noise_is_described() -> None:
    scene = load_scene(zoo_files()["filtered-lossy"])
    sizing = size(scene, rate=0.1, mission=60.0, budget=2.0, rel_error=0.3, threads=1)
    assert motion_between_stops(sizing).hits > 0  # it ended in a KeyError


# ------------------------------------------------------------------------------
# What one oscillator along each axis would buy at the snubbers of a box, by hand.
# ------------------------------------------------------------------------------


MISSION = 3600.0
LAW = {"kind": "restitution", "coefficient": 0.5}


def snubber(name: str, direction: list[float], **stops: float) -> dict[str, object]:
    at = [0.2, 0.1, -0.05]
    return {"name": name, "at": at, "direction": direction, "law": LAW} | stops


def test_one_axis_is_an_oscillator_on_all_mounts_together() -> None:
    body = box(zeta=0.1, gravity="-z")
    towards = [1.0, 2.0, 2.0]
    pairs = [snubber("up", [0, 0, 1], clearance=0.02), snubber("slant", towards, upper=0.01)]
    found = box_overview(scene_with(body, pairs), MISSION)
    assert found is not None
    _, damping, stiffness = body.matrices
    alone = []
    for row, noise in enumerate(tables()):
        single = Isolator(mass=12.0, stiffness=stiffness[row, row], damping=damping[row, row])
        bare = noise.model_copy(update={"axis": None})
        alone.append(screen(Scene(structure=single, excitations=[bare])).displacement_std)
    shares = np.array(towards) / 3.0
    expected = [3.0 * alone[2], 3.0 * math.sqrt(np.sum((shares * alone) ** 2))]
    rows = found.pairs.set_index("pair")
    assert rows["one_axis_three_sigma"].tolist() == pytest.approx(expected, rel=1e-8)
    # a corner of this box moves otherwise than its centre
    moved = screen(scene_with(body, pairs)).impact_pairs
    for name, stops in (("up", 2.0), ("slant", 1.0)):
        sigma, speed = moved[name].displacement_std, moved[name].velocity_std
        level = rows.loc[name, "one_axis_three_sigma"] / sigma
        assert level != pytest.approx(3.0, rel=1e-3)
        hits = MISSION * stops * speed / sigma / (2.0 * math.pi) * math.exp(-(level**2) / 2.0)
        chance = rows.loc[name, "chance_at_one_axis"]
        assert chance == pytest.approx(-math.expm1(-hits), rel=1e-9)


def test_sines_beside_the_noise_raise_the_chances_of_a_box() -> None:
    body, pairs = box(zeta=0.1), [snubber("up", [0, 0, 1], upper=0.006)]
    quiet = scene_with(body, pairs)
    sine = Sine(on="base", axis="z", frequency_hz=9.0, amplitude=1.0, unit="g")
    loud = quiet.replace(excitations=[*quiet.excitations, sine])
    one, other = (box_overview(scene, MISSION).pairs.iloc[0] for scene in (quiet, loud))
    moved = screen(loud).impact_pairs["up"]
    assert moved.displacement_std > 1.2 * screen(quiet).impact_pairs["up"].displacement_std
    assert other["one_axis_three_sigma"] > 1.1 * one["one_axis_three_sigma"]
    # Rice's rate of a Gaussian process about a moving mean, by plain sums over the phase
    phases = 2.0 * math.pi * np.arange(20_000) / 20_000
    quiet_gap = screen(quiet).impact_pairs["up"]
    sigma, speed = quiet_gap.displacement_std, quiet_gap.velocity_std
    height = math.sqrt(2.0 * (moved.displacement_std**2 - sigma**2))
    mean, rate = height * np.cos(phases), -2.0 * math.pi * 9.0 * height * np.sin(phases)
    turn = rate / speed
    rises = norm.pdf(turn) + turn * norm.cdf(turn)
    hits = MISSION * np.mean(norm.pdf((0.006 - mean) / sigma) * speed / sigma * rises)
    assert other["chance_as_given"] == pytest.approx(-math.expm1(-hits), rel=1e-6)
    assert other["chance_as_given"] > 2.0 * one["chance_as_given"]


def test_a_stop_that_the_weight_presses_on_is_hit_for_certain() -> None:
    body = box(zeta=0.1, gravity="-z")
    found = box_overview(scene_with(body, [snubber("low", [0, 0, 1], lower=-1e-5)]), MISSION)
    assert found is not None and found.pairs["chance_as_given"].tolist() == [1.0]


def test_modes_are_those_of_the_body_and_their_masses_add_up() -> None:
    body = box()
    found = box_overview(scene_with(body, [snubber("up", [0, 0, 1], clearance=0.02)]), MISSION)
    assert found is not None and isinstance(body, RigidBody)
    assert [mode.frequency_hz for mode in found.modes] == pytest.approx(
        body.natural_frequency_hz.tolist(), rel=1e-9
    )
    for axis in ("x", "y", "z"):
        assert sum(mode.effective_mass[axis] for mode in found.modes) == pytest.approx(12.0)


def test_other_structures_are_no_boxes() -> None:
    assert box_overview(uncoupled(pair("x", "x", 4.0)), MISSION) is None


def test_stops_that_noise_never_reaches_are_practically_never_passed() -> None:
    """A rate of 1e-33 an hour says nothing of a mount: no noise is Gaussian as far as that."""
    quiet = scene_between_stops(noise=TRUCK.replace(level_db=-12.0))
    assert screen(quiet).stops_in_words() == ["Your stops: practically never passed (Rice)"]
    assert "times an hour" in screen(scene_between_stops()).stops_in_words()[0]


def test_a_phase_is_named_as_a_shell_takes_it() -> None:
    phases = [{"name": name, "duration": 60.0} for name in ("rough road", "plane")]
    with pytest.raises(SceneError, match=r"as in 'FILE\.toml#rough road' "):
        screen(scene_between_stops().replace(phases=phases))
