"""Harmonic linearisation: its formulas by quadrature, the book's numbers, its error."""

from __future__ import annotations

import math

import numpy as np
import pytest

from stochvi import (
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


def test_the_third_subharmonic_of_the_book() -> None:
    """Section 9, l = 3: printed 4.43 mm exact; 3.17 has 4.57 mm at the printed frequency."""
    case = HarmonicResonance(
        omega=62.8, damping_rate=12.51, amplitude=40.0, frequency=236.1, restitution=0.5, periods=3
    )
    assert case.energy_boundary == pytest.approx(4.57e-3, rel=5e-3)
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
