"""Screening of isolators, and impact rate against clearance."""

import math

import numpy as np
import pandas as pd
import pytest

from stochvi import (
    ConstantLoad,
    ImpactPair,
    Isolator,
    NotApplicable,
    NotConverged,
    Restitution,
    Scene,
    TabulatedNoise,
    WhiteNoise,
    screen,
)
from stochvi.isolators import clearance_curve, size
from stochvi.isolators.clearance import (
    clearance_notes,
    predicted_curve,
    predicted_rates,
    unseen_notes,
)
from stochvi.isolators.moved_stops import at_clearances
from stochvi.mathematics.units import STANDARD_GRAVITY
from stochvi.results.deadline import Deadline
from support.known import oscillator

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
