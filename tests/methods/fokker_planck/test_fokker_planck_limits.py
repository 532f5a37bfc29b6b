"""Where the stationary solver ends: stops hardly reached, wells apart, kinks, tails too heavy."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from stochvi import (
    ConstantLoad,
    Estimate,
    ImpactPair,
    NotApplicable,
    NotConverged,
    Oscillator,
    Restitution,
    Scene,
    WhiteNoise,
    exact,
    fokker_planck,
    transient,
)
from stochvi.methods.closed_form import exact_density
from stochvi.methods.fokker_planck import (
    fokker_planck_density,
    fokker_planck_many,
    refinement,
)
from stochvi.methods.fokker_planck.density import Averages, StripDensity
from stochvi.methods.fokker_planck.motion import Motion
from stochvi.methods.fokker_planck.scaled_motion import scaled_motion
from stochvi.model.model import model_of
from stochvi.results import NoExactSolution
from stochvi.scenes import NonlinearOscillator
from stochvi.testing import assert_agrees
from support.accuracies import quick_cases
from support.known import oscillator
from support.weighted_ensemble import rates_above

HITS = ("rate_upper", "speed_rate_upper", "speed_square_rate_upper")


# A mass that leans on an inelastic stop ----------------------------------------------------------


def leaning(upper: float, restitution: float = 0.3, zeta: float = 0.1) -> Motion:
    """A preload of 3 deviations on an inelastic stop; an elastic one above."""
    plain = oscillator(None, None, damping=2.0 * zeta, intensity=4.0 * zeta)
    pair = ImpactPair(
        lower=3.0,
        upper=upper,
        lower_law=Restitution(coefficient=restitution),
        upper_law=Restitution(coefficient=1.0),
    )
    scene = Scene(structure=plain.structure, impact_pairs=[pair], excitations=plain.excitations)
    return Motion(model=model_of(scene))


def solved(motion: Motion) -> Averages:
    return refinement.refine(motion, 1e-2, 0.0, ()).averages


def test_a_far_stop_is_hit_as_it_is_a_little_nearer() -> None:
    """3.25 is out of reach by the law exp(-energy / s^2), 3.24 is not; nothing jumps there."""
    places = [3.23, 3.24, 3.25, 3.26]
    reached = [scaled_motion(leaning(place)).reached for place in places]
    assert [len(stops) for stops in reached] == [2, 2, 1, 1]
    found = [solved(leaning(place)) for place in places]
    for name in HITS:
        slopes = np.diff(np.log([getattr(one, name) for one in found]))
        assert np.ptp(slopes) < 0.1 * abs(slopes[0])


def test_a_stop_that_is_left_out_is_bounded_by_what_is_found_beside_it() -> None:
    motion = leaning(3.25)
    whole = solved(motion)
    frame = scaled_motion(motion)
    patches = refinement.graded(frame, refinement.first_patches(frame), refinement.SLOWEST[0])
    strips = refinement.Strips().make(patches, refinement.FIRST_DEGREES)
    blind = refinement._field(frame, strips, refinement.SLOWEST[0])
    averages = blind.averages(0.0)
    assert averages.rate_upper == 0.0
    bounds = refinement._unreached(blind, averages.upcrossing_rate)
    square = motion.squares[0]
    rice = averages.upcrossing_rate * np.exp(-(3.25**2 - 9.0) / 2.0 / square)
    assert rice < 1e-3 * whole.rate_upper  # the law alone says too little
    for name in HITS:
        assert getattr(whole, name) < bounds[name] < 10.0 * getattr(whole, name)


def test_so_it_is_in_many_scenes_at_once() -> None:
    places = [3.4, 4.0]
    batch = fokker_planck_many(
        omega=1.0, damping_rate=0.2, intensity=0.4, lower=3.0, upper=places, restitution_lower=0.3
    )
    for k, place in enumerate(places):
        found = solved(leaning(place))
        for name in HITS:
            wrong = abs(getattr(batch.values, name)[k] - getattr(found, name))
            assert wrong < getattr(batch.errors, name)[k]


# Wells apart --------------------------------------------------------------------------------


def wells(theta: float, load: float = 0.0) -> Scene:
    """Two wells at -1 and 1, a barrier of 1/4 between them."""
    return spring(lambda x: x**3 - x, theta, load)


def spring(force: Callable[..., Any], theta: float, load: float = 0.0) -> Scene:
    loads = [ConstantLoad(force=load)] if load else []
    return Scene(
        structure=NonlinearOscillator(mass=1.0, damping=0.1, restoring_force=force),
        excitations=[WhiteNoise(intensity=0.2 * theta), *loads],
    )


def assert_as_exact(scene: Scene, rtol: float) -> None:
    found, known = fokker_planck(scene, rtol=rtol).estimates(), exact(scene).estimates()
    for name in ("displacement_mean", "displacement_std", "velocity_std"):
        assert_agrees(found["x", name], known["x", name].value)


@pytest.mark.parametrize(
    ("theta", "load"),
    [
        (0.02, 0.0012),
        pytest.param(0.005, 0.0, marks=pytest.mark.verify),
        pytest.param(0.012, 0.01, marks=pytest.mark.verify),
    ],
)
def test_both_wells_are_found_behind_a_high_barrier(theta: float, load: float) -> None:
    assert_as_exact(wells(theta, load), 0.01)


def test_wells_of_unequal_depth_behind_a_barrier_out_of_numbers_are_refused() -> None:
    with pytest.raises(NotConverged, match="double precision ends at 30"):
        fokker_planck(wells(0.005, 0.001))


def test_the_barrier_is_counted_from_the_shallower_well() -> None:
    frame = scaled_motion(Motion(model=model_of(wells(0.02, 0.05))))
    roots = np.sort(np.roots([1.0, 0.0, -1.0, -0.05]).real)
    shallow, top, deep = roots**4 / 4.0 - roots**2 / 2.0 - 0.05 * roots
    assert frame.barrier == pytest.approx((top - shallow) / 0.02, rel=1e-4)
    assert frame.rare_energy == pytest.approx((top - deep) / 0.02, rel=1e-4)


# Densities that fall as powers --------------------------------------------------------------


def student(power: float) -> Scene:
    """(1 + x^2)^(-power / 2), whose variance is 1 / (power - 3)."""
    return spring(lambda x: power * x / (1.0 + x**2), 1.0)


@quick_cases("power", [3.5, 4.5, 8.0], keep=(2,))
def test_the_closed_form_holds_all_of_a_heavy_tail(power: float) -> None:
    found = exact(student(power)).estimates()["x", "displacement_std"]
    assert found.value == pytest.approx((power - 3.0) ** -0.5, rel=1e-11)


@pytest.mark.parametrize("power", [4.5, 8.0])
def test_what_a_box_cuts_of_a_heavy_tail_is_in_the_bias(power: float) -> None:
    found = fokker_planck(student(power), rtol=0.01).estimates()["x", "displacement_std"]
    assert_agrees(found, (power - 3.0) ** -0.5)
    assert found.bias is not None
    assert found.bias < 3.0 * max(abs(found.value - (power - 3.0) ** -0.5), 1e-6)


def test_a_tail_that_no_box_holds_is_refused() -> None:
    with pytest.raises(NotConverged) as refusal:
        fokker_planck(student(3.5), rtol=0.01)
    assert_agrees(refusal.value.partial.estimates()["x", "displacement_std"], 2.0**0.5)
    assert fokker_planck(student(3.5), rtol=0.05)


@quick_cases("power", [1.5, 2.9], keep=(1,))
def test_an_infinite_variance_is_refused(power: float) -> None:
    with pytest.raises(NoExactSolution, match="finite variance"):
        exact(student(power))
    with pytest.raises(NotApplicable, match="finite variance"):
        fokker_planck(student(power))


def test_a_mesh_without_a_variance_is_refined(monkeypatch: pytest.MonkeyPatch) -> None:
    """Not taken for an answer, nor for the end."""
    averages, scene = StripDensity.averages, wells(0.1)
    known = exact(scene).estimates()["x", "displacement_std"].value
    calls = []

    def negative(self: StripDensity, slowest: float) -> Averages:
        calls.append(self)
        found = averages(self, slowest)
        return found._replace(variance=-1.0) if len(calls) <= 3 else found

    monkeypatch.setattr(StripDensity, "averages", negative)
    assert_agrees(fokker_planck(scene).estimates()["x", "displacement_std"], known)
    monkeypatch.setattr(refinement, "MOST_UNKNOWNS", 1)
    monkeypatch.setattr(
        StripDensity, "averages", lambda *all_: averages(*all_)._replace(variance=-1.0)
    )
    with pytest.raises(NotConverged, match="no density"):
        fokker_planck(scene)


# Scales too far apart -----------------------------------------------------------------------


def test_a_motion_below_the_digits_of_its_place_is_refused(recwarn: Any) -> None:
    """1e-17 m on a stop at 1 m."""
    scene = oscillator(None, 1.0, 0.5, load=1e6, intensity=1e-16)
    with pytest.raises(NotConverged, match="lost in rounding"):
        fokker_planck(scene)
    assert not recwarn.list


def test_a_transient_whose_mesh_would_not_fit_is_refused() -> None:
    scene = oscillator(None, -0.02, 0.4, load=-44.0, omega=0.003, damping=0.0, intensity=1e-14)
    with pytest.raises(NotConverged, match="too far apart"):
        transient(scene, [1.0], (-0.03, 0.0))


def test_a_transient_that_begins_below_the_lowest_place_of_the_box_has_a_scale() -> None:
    """Rounding may put the energy of a start at rest below that of the lowest place."""
    scene = Scene(
        structure=Oscillator(mass=0.021953218586657015, damping=0.0, stiffness=33.470982194902206),
        impact_pairs=[
            ImpactPair(
                lower=-0.00012969190525886332,
                upper=8.640386514902214e-05,
                lower_law=Restitution(coefficient=0.0),
                upper_law=Restitution(coefficient=1.0),
            )
        ],
        excitations=[
            WhiteNoise(intensity=6.322694659920297e-13),
            ConstantLoad(force=-0.5054179254609847),
        ],
    )
    with pytest.raises(ValueError, match="start must lie between the stops"):
        transient(scene, [1.0])


# Rates of impacts that are so fast that they are rare ---------------------------------------------


def test_rates_of_fast_impacts_between_elastic_stops() -> None:
    """Rayleigh's distribution of speeds is exact there: a rate is right, or 0 with a bound, however
    fast the impacts."""
    scene = oscillator(-1.0, 1.0)
    law = exact_density(scene)
    for speed, seen in ((2.0, True), (4.0, True), (6.0, True), (9.0, False), (20.0, False)):
        truth = float(law.rate_above("upper", speed))
        rate = (
            fokker_planck(scene, speed_threshold=speed).impact_pairs["stops"].collision_rate_upper
        )
        assert rate is not None and rate.bias is not None
        assert abs(rate.value - truth) <= rate.bias
        assert (rate.value > 0.0) == seen
        assert rate.bias > 0.0 and rate.bias < (0.1 * truth if seen else 1e-12)


def test_every_solution_bounds_the_rates_that_its_mesh_loses() -> None:
    scene = oscillator(-1.0, 1.0)
    law = exact_density(scene)
    speeds = np.array([0.5, 2.0, 5.0, 6.0, 9.0])
    truth = np.asarray(law.rate_above("upper", speeds))
    many = fokker_planck_many(
        omega=np.ones(5),
        damping_rate=0.1,
        intensity=0.2,
        lower=-1.0,
        upper=1.0,
        speed_threshold=speeds,
    )
    assert np.all(np.abs(many.values.rate_upper - truth) <= many.errors.rate_upper)
    assert np.all(many.errors.rate_upper > 0.0)
    for speed in (0.5, 6.0):
        late = transient(scene, [100.0], speed_threshold=speed)
        known = float(law.rate_above("upper", speed))
        assert abs(late.values.rate_upper[0] - known) <= late.errors.rate_upper[0] + 1e-3 * known


def test_a_density_says_how_little_lies_beyond_its_mesh() -> None:
    scene = oscillator(-1.0, 1.0)
    found, law = fokker_planck_density(scene), exact_density(scene)
    assert found.density(0.0, 30.0) == 0.0
    assert 0.0 < float(law.density(0.0, 9.0)) < float(found.density_error(0.0, 9.0)) < 1e-9
    assert math.isnan(float(found.rate_above("upper", 9.0)))
    farther = fokker_planck_density(scene, speed_threshold=6.0)
    assert float(farther.rate_above("upper", 6.0)) == pytest.approx(
        float(law.rate_above("upper", 6.0)), rel=1e-4
    )


RARE = {
    "two stops": ((0.1, 0.2), (-1.0, 1.0), 0.8, (2.0, 3.0, 3.5)),
    "pressed on one": ((0.1, 0.2), (-1e9, -1.0), 0.7, (2.0, 3.0, 3.5)),
    "light damping": ((0.02, 0.04), (-1.0, 1e9), 0.3, (1.0, 2.0, 2.5)),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", RARE)
def test_rates_of_fast_impacts_on_inelastic_stops(name: str) -> None:
    """Against a weighted ensemble, down to rates of 1e-9 a second; that of impacts that are 10 %
    faster does not pass."""
    (damping, intensity), stops, restitution, speeds = RARE[name]
    sampled, errors = rates_above(damping, intensity, stops, restitution, speeds, 160.0, 5)
    lower, upper = (None if abs(stop) > 1e8 else stop for stop in stops)
    scene = oscillator(lower, upper, restitution, damping=damping, intensity=intensity)
    for speed, value, error in zip(speeds, sampled, errors, strict=True):
        rate = fokker_planck(scene, speed_threshold=speed).impact_pairs["stops"].collision_rate
        assert rate is not None and rate.bias is not None and rate.bias > 0.0
        judge = Estimate(value=value, standard_error=error, bias=0.02 * value + rate.bias)
        assert_agrees(judge, rate.value)
    faster = fokker_planck(scene, speed_threshold=1.1 * speeds[1]).impact_pairs["stops"]
    assert faster.collision_rate is not None
    with pytest.raises(AssertionError):
        assert_agrees(
            Estimate(value=sampled[1], standard_error=errors[1], bias=0.02 * sampled[1]),
            faster.collision_rate.value,
        )


def test_no_mean_speed_that_the_counted_impacts_cannot_have() -> None:
    """F1 over the rate of the fastest impacts exceeds their rms speed by far."""
    scene = oscillator(-1.0, 1.0, 0.8)
    rare, usual = (fokker_planck(scene, speed_threshold=speed) for speed in (2.0, 0.05))
    assert rare.impact_pairs["stops"].impact_speed_mean is None
    assert [note for note in rare.warnings if note.startswith("no mean impact speed is given")]
    pair = usual.impact_pairs["stops"]
    assert pair.impact_speed_mean is not None and pair.collision_rate is not None
    assert pair.impact_speed_square_rate is not None
    square = pair.impact_speed_square_rate.value / pair.collision_rate.value
    assert pair.impact_speed_mean.value**2 < square
    assert not [note for note in usual.warnings if "no mean impact speed" in note]
