"""Harmonic linearisation: its formulas by quadrature, the book's numbers, its error."""

from __future__ import annotations

import math

import numpy as np
import pytest

from stochvi import (
    Absorber,
    ImpactPair,
    Matrices,
    NotApplicable,
    Oscillator,
    Restitution,
    Scene,
    Sine,
    harmonic_response,
)
from stochvi.methods.periodic.linearised import Harmonic, by_force, by_motion
from stochvi.methods.periodic.resonance import HarmonicResonance

ANGLES = 2.0 * math.pi * (np.arange(200_000) + 0.5) / 200_000


def oscillator(
    restitution: float, amplitude: float, ratio: float, damping: float = 0.05, **stops: float
) -> Scene:
    return Scene(
        structure=Oscillator(mass=1.0, damping=damping, stiffness=1.0),
        impact_pairs=[ImpactPair(law=Restitution(coefficient=restitution), **stops)],
        excitations=[Sine(amplitude=amplitude, frequency_hz=ratio / (2.0 * math.pi))],
    )


@pytest.mark.parametrize("gap", [0.4, 0.0, -0.4])
def test_one_stop_by_force_is_the_mean_of_the_inverse_characteristic(gap: float) -> None:
    """q = 2 E[x(F) cos] / a_F of x = min(F / omega^2, gap), by quadrature; a_x = q a_F."""
    case = Harmonic(1.3, 0.0, 1.0, 2.0, gap, 1.0, False)
    for s in (0.3, 2.0):
        amplitude, stiffness = by_force(case, s)
        force = amplitude * stiffness
        moved = np.minimum(force * np.cos(ANGLES) / 1.3**2, gap)
        compliance = 2.0 * np.mean(moved * np.cos(ANGLES)) / force
        assert 1.0 / stiffness == pytest.approx(compliance, rel=1e-8)


def test_the_frequency_without_a_gap_is_that_of_the_book() -> None:
    """1.73 by motion, 1.41 by force (9.21, 9.36); exactly twice the natural frequency (9.22)."""
    flush = Harmonic(1.0, 0.0, 1.0, 1.5, 0.0, 1.0, False)
    assert math.sqrt(by_motion(flush, 2.0)[1]) == pytest.approx(math.sqrt(3.0), rel=1e-12)
    assert math.sqrt(by_force(flush, 2.0)[1]) == pytest.approx(math.sqrt(2.0), rel=1e-12)
    ratios = np.linspace(1.98, 2.02, 41)
    scene = oscillator(1.0, 0.1, 2.0, damping=0.002, upper=0.0)
    found = harmonic_response(scene, ratios / (2.0 * math.pi), most_impacts=1)
    speeds = {
        float(frequency): float(speed.max())
        for branch in found.branches
        if branch.stops and branch.periods == 1
        for frequency, speed in zip(branch.frequency_hz, branch.impact_speed, strict=True)
    }
    assert 2.0 * math.pi * max(speeds, key=lambda f: speeds[f]) == pytest.approx(2.0, abs=2e-3)


def test_two_stops_end_at_the_boundary_of_the_book() -> None:
    """9.15 with 7.62 at the isolator of p. 135: 3.866e-4 m, where the book prints 3.24e-4."""
    drive = {"amplitude": 1e-4 * 628.0**2, "frequency_hz": 628.0 / (2.0 * math.pi)}
    for gap, expected in ((3.85e-4, 2), (3.88e-4, 0)):
        scene = Scene(
            structure=Oscillator(mass=1.0, damping=12.5, stiffness=62.8**2),
            impact_pairs=[ImpactPair(clearance=gap, law=Restitution(coefficient=0.5))],
            excitations=[Sine(**drive)],
        )
        found = harmonic_response(scene, form="motion")
        assert sum(bool(branch.stops) for branch in found.branches) == expected


def test_of_two_regimes_between_two_stops_that_of_the_harder_impacts_is_stable() -> None:
    """Exactly, and by force, where the amplitude grows with the stiffness of the impacts (10.8)."""
    scene = Scene(
        structure=Oscillator(mass=1.0, damping=12.5, stiffness=62.8**2),
        impact_pairs=[ImpactPair(clearance=3e-4, law=Restitution(coefficient=0.5))],
        excitations=[Sine(amplitude=1e-4 * 628.0**2, frequency_hz=628.0 / (2.0 * math.pi))],
    )
    for form in ("exact", "force"):
        soft, hard = sorted(
            (float(branch.impact_speed[0].mean()), bool(branch.stable[0]))
            for branch in harmonic_response(scene, form=form).branches
            if len(branch.stops) == 2 and branch.periods == 1
        )
        assert (soft[1], hard[1]) == (False, True)


@pytest.mark.parametrize("form", ["motion", "force"])
@pytest.mark.parametrize("stops", [{"clearance": 1.0}, {"upper": 0.5}, {"upper": -0.2}])
def test_one_stop_two_stops_and_a_preload_have_regimes_with_a_stated_error(
    form: str, stops: dict
) -> None:
    scene = oscillator(0.8, 0.6, 1.3, **stops)
    found = harmonic_response(scene, form=form)
    branches = [branch for branch in found.branches if branch.stops]
    assert branches and all(branch.form == form for branch in branches)
    assert found.model_error is not None and found.model_error.keys() == {
        "median", "largest", "without_exact"
    }  # fmt: skip
    if (median := found.model_error["median"]) is not None:
        assert f"off by {100.0 * median:.2g} %" in found.summary()
    assert harmonic_response(scene).model_error is None


@pytest.mark.parametrize("form", ["motion", "force"])
def test_the_stated_error_is_that_of_the_impact_speed(form: str) -> None:
    """Two stops at one frequency: against the fastest stable exact regime of a period."""
    scene = oscillator(0.8, 0.6, 1.5, clearance=1.0)
    found, exact = harmonic_response(scene, form=form), harmonic_response(scene)
    value = 1.5 / (2.0 * math.pi)
    fastest = max(
        branch.impact_speed[i].mean()
        for branch in exact.branches
        if len(branch.stops) == 2 and branch.periods == 1
        for i in branch.at(value)
        if branch.stable[i]
    )
    (speed,) = (
        branch.impact_speed[0, 0] for branch in found.branches if branch.stops and branch.stable[0]
    )
    assert found.model_error == {
        "median": pytest.approx(abs(speed / fastest - 1.0), rel=1e-9),
        "largest": pytest.approx(abs(speed / fastest - 1.0), rel=1e-9),
        "without_exact": 0.0,
    }


THIRD = {"omega": 62.8, "damping_rate": 12.51, "amplitude": 40.0, "restitution": 0.5, "periods": 3}
"""The third subharmonic of the book's section 9, printed at 236.1 rad/s."""


def series_of_the_book(frequency: float) -> tuple[float, float]:
    """Impulse and gap at the boundary by 9.62, with the simplification of 9.68: x' of antiperiodic
    impulses J is the force's, a w = J (loss of the damper + (1 - R) / 2 (1 + R))."""
    omega, b, r = THIRD["omega"], THIRD["damping_rate"], THIRD["restitution"]
    own = np.arange(1, 400_001, 2) * frequency / THIRD["periods"]
    size = 2.0 * frequency / (math.pi * THIRD["periods"])
    # without the damper in the response, and without the spring in all harmonics but the first
    response = np.where(own == own[0], 1.0 / (omega**2 - own**2), 1.0 / own**2)
    moved = abs(size * np.sum(1.0 / (omega**2 - own**2)))
    loss = size * b * np.sum((own * response) ** 2)
    free = THIRD["amplitude"] / math.hypot(omega**2 - frequency**2, b * frequency)
    impulse = free * frequency / (loss + (1.0 - r) / (2.0 * (1.0 + r)))
    return impulse, impulse * moved


def test_the_third_subharmonic_of_the_book_by_linearisation() -> None:
    """Printed: J = 0.189, x2(0) = -24.5e-3 (here -24.24e-3), and their product as 4.65 mm."""
    impulse, gap = series_of_the_book(236.1)
    assert impulse == pytest.approx(0.189, rel=0.01)
    assert gap / impulse == pytest.approx(24.5e-3, rel=0.012)
    assert gap == pytest.approx(4.65e-3, rel=0.01)


def test_the_third_subharmonic_of_the_book() -> None:
    """Printed a = 0.82 mm and 4.43 mm are those of 229.4 rad/s, to 1 %; at the printed 236.1 rad/s
    there are 0.771 mm and 4.56 mm, by the closed form and on the branch."""
    case = HarmonicResonance(frequency=236.1, **THIRD)
    assert case.free_amplitude == pytest.approx(0.771e-3, rel=1e-3)
    assert case.energy_boundary == pytest.approx(4.563e-3, rel=1e-3)
    other = HarmonicResonance(frequency=229.43, **THIRD)
    assert other.free_amplitude == pytest.approx(0.82e-3, rel=1e-3)
    assert other.energy_boundary == pytest.approx(4.43e-3, rel=0.01)
    scene = Scene(
        structure=Oscillator(mass=1.0, damping=12.51, stiffness=62.8**2),
        impact_pairs=[ImpactPair(clearance=4e-3, law=Restitution(coefficient=0.5))],
        excitations=[Sine(amplitude=40.0, frequency_hz=236.1 / (2.0 * math.pi))],
    )
    found = harmonic_response(scene, vary={"impact_pair.0.clearance": [4e-3, 5e-3]})
    folds = [
        point.value
        for point in found.special_points
        for branch in [found.branches[point.branch]]
        if point.name == "fold" and branch.periods == 3 and len(branch.stops) == 2
    ]
    assert any(fold == pytest.approx(case.energy_boundary, rel=1e-8) for fold in folds)


@pytest.mark.parametrize(("both", "printed"), [(True, 0.32), (False, 0.16)])
def test_the_loss_of_an_absorber_is_that_of_the_book(both: bool, printed: float) -> None:
    """17.13 prints p = 0.32 (1 - R^2) and 0.16 (1 - R^2): 1 / pi and 1 / 2 pi, rounded up."""
    case = Harmonic(1.0, 0.0, 1.0, 1.5, 1.0, 0.6, both)
    share = case.impact_damping / case.frequency / (1.0 - 0.6**2)
    assert share == pytest.approx(printed, abs=0.005)
    assert share * math.pi == pytest.approx(1.0 if both else 0.5, rel=1e-12)


def test_the_travel_of_a_loose_mass_is_that_of_straight_flights() -> None:
    """The book's square wave has 4 Delta / pi (17.17); exactly a light mass at R = 1 that cancels
    the force has 8 Delta / pi^2."""
    flush = Harmonic(0.0, 0.0, 1.0, 1.0, 1.0, 1.0, True)
    assert by_force(flush, 1.0)[0] == pytest.approx(4.0 / math.pi, rel=1e-12)
    mass = 1e-3
    scene = Scene(
        structure=Oscillator(mass=1.0, damping=0.02, stiffness=1.0),
        absorber=Absorber(mass=mass, play=2.0, law=Restitution(coefficient=1.0)),
        excitations=[Sine(amplitude=mass * 8.0 / math.pi**2 * 1.69, frequency_hz=0.65 / math.pi)],
    )
    found = harmonic_response(scene, coordinate="absorber", most_impacts=2)
    travels = [
        branch.amplitude[i]
        for branch in found.branches
        for i in np.flatnonzero(branch.admissible)
        if branch.impacts_per_period == 2 and branch.periods == 1
    ]
    assert any(travel == pytest.approx(8.0 / math.pi**2, rel=2e-3) for travel in travels)


def test_what_is_not_linearised_is_refused() -> None:
    scene = oscillator(0.8, 0.6, 1.7, lower=-1.0, upper=2.0)
    with pytest.raises(NotApplicable, match="two stops must lie evenly"):
        harmonic_response(scene, form="motion")
    with pytest.raises(ValueError, match="form must be one of exact, motion, force"):
        harmonic_response(scene, form="bok")
    pair = Matrices(
        coordinates=["a", "b"], mass=np.eye(2).tolist(), damping=np.eye(2).tolist(),
        stiffness=np.eye(2).tolist(),
    )  # fmt: skip
    several = Scene(
        structure=pair,
        impact_pairs=[ImpactPair(on="a", upper=1.0, law=Restitution(coefficient=0.5))],
        excitations=[Sine(on="a", amplitude=1.0, frequency_hz=1.0)],
    )
    with pytest.raises(NotApplicable, match="one impact pair, got 2 coordinates"):
        harmonic_response(several, form="force")
