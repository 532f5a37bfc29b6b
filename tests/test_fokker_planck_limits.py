"""Where the stationary solver ends: stops hardly reached, wells apart, kinks, tails too heavy."""

from __future__ import annotations

import numpy as np
from known import oscillator

from stochvi import ImpactPair, Restitution, Scene, fokker_planck_many
from stochvi.galerkin import accurate
from stochvi.galerkin.field import Averages
from stochvi.galerkin.motion import Motion, make_frame

HITS = ("rate_upper", "speed_rate_upper", "speed_square_rate_upper")


# A mass that leans on a lossy stop ----------------------------------------------------------


def leaning(upper: float, restitution: float = 0.3, zeta: float = 0.1) -> Motion:
    """A preload of 3 deviations on a lossy stop; an elastic one above."""
    plain = oscillator(None, None, damping=2.0 * zeta, intensity=4.0 * zeta)
    pair = ImpactPair(
        lower=3.0,
        upper=upper,
        lower_law=Restitution(coefficient=restitution),
        upper_law=Restitution(coefficient=1.0),
    )
    scene = Scene(structure=plain.structure, impact_pairs=[pair], excitations=plain.excitations)
    return Motion(system=scene.system())


def solved(motion: Motion) -> Averages:
    return accurate.solve_accurately(motion, 1e-2, 0.0, ()).averages


def test_a_far_stop_is_hit_as_it_is_a_little_nearer() -> None:
    """3.25 is out of reach by the law exp(-energy / s^2), 3.24 is not; nothing jumps there."""
    places = [3.23, 3.24, 3.25, 3.26]
    reached = [make_frame(leaning(place)).reached for place in places]
    assert [len(stops) for stops in reached] == [2, 2, 1, 1]
    found = [solved(leaning(place)) for place in places]
    for name in HITS:
        slopes = np.diff(np.log([getattr(one, name) for one in found]))
        assert np.ptp(slopes) < 0.1 * abs(slopes[0])


def test_a_stop_that_is_left_out_is_bounded_by_what_is_found_beside_it() -> None:
    motion = leaning(3.25)
    whole = solved(motion)
    frame = make_frame(motion)
    patches = accurate.graded(frame, accurate.first_patches(frame), accurate.SLOWEST[0])
    strips = accurate.Strips().make(patches, accurate.FIRST_DEGREES)
    blind = accurate._field(frame, strips, accurate.SLOWEST[0])
    averages = blind.averages(0.0)
    assert averages.rate_upper == 0.0
    bounds = accurate._unreached(blind, averages.upcrossing_rate)
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
            assert 0.0 < wrong < getattr(batch.errors, name)[k]
