"""Stops that give way on several coordinates: exact laws, balances, other engines, brute force."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from stochvi import (
    Elastic,
    ForceTable,
    ImpactPair,
    NotApplicable,
    Oscillator,
    Restitution,
    Scene,
    Viscoelastic,
    WhiteNoise,
    exact,
    simulate,
)
from stochvi.engine.mass_contacts import KINK_ERROR
from stochvi.methods.monte_carlo.choose_plan import make_plan
from stochvi.methods.monte_carlo.kernels.random_numbers import seed_streams
from stochvi.methods.monte_carlo.modal_contacts import CONTACT_ENERGY, plan_modal_contacts
from stochvi.methods.monte_carlo.modal_tables import ModalTablesPlan
from stochvi.methods.monte_carlo.path_statistics import PathStatistics
from stochvi.model.balances import residuals
from stochvi.model.model import model_of
from stochvi.scenes import Hertz
from stochvi.scenes.absorbers import Absorber
from stochvi.scenes.excitations import ConstantLoad, FilteredNoise, Sine
from stochvi.scenes.impact_laws import ForceFunction, Law
from stochvi.scenes.structures import Matrices
from stochvi.testing import assert_agrees
from support.accuracies import quick_cases
from support.mounts import truck, two_stages
from support.samples import apart


def absorber(law: Law, **more: object) -> Scene:
    """A loose mass in a box on an oscillator with omega = 1, b = 0.1, S0 = 0.2."""
    return Scene(
        structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
        absorber=Absorber(mass=0.1, play=2.0, law=law, **more),
        excitations=[WhiteNoise(intensity=0.2)],
    )


ELASTIC = {
    "elastic": Elastic(stiffness=5.0),
    "Hertz": Hertz(coefficient=20.0),
    "tabulated": ForceTable(deflection=[0.1, 0.3], force=[0.2, 3.0]),
}


def matched(law: Law) -> Scene:
    """Two masses, one between stops and a gap between both; noise that matches the damping."""
    return Scene(
        structure=Matrices(
            coordinates=["a", "b"],
            mass=np.diag([1.0, 0.4]),
            damping=np.diag([0.3, 0.5]),
            stiffness=[[2.0, -1.0], [-1.0, 2.0]],
        ),
        impact_pairs=[
            ImpactPair(name="stops", on="a", lower=-0.7, upper=0.9, law=law),
            ImpactPair(name="gap", between=["a", "b"], lower=-0.5, upper=1.0, law=law),
        ],
        excitations=[WhiteNoise(on="a", intensity=0.6), WhiteNoise(on="b", intensity=1.0)],
    )


@quick_cases("law", ELASTIC.values(), ids=ELASTIC.keys(), keep=(1,))
def test_stops_that_lose_nothing_leave_the_gibbs_law(law: Law) -> None:
    scene = matched(law)
    truth, found = exact(scene).estimates(), simulate(scene, paths=96, duration=100.0, seed=3)
    stated = make_plan(model_of(scene)).relative_bias
    names = {name for _, name in truth}
    assert {"contact_probability", "contact_force_lower", "collision_rate_upper"} <= names
    for key, estimate in found.estimates().items():
        if key in truth:
            assert_agrees(estimate, truth[key].value)
            # of sums and ratios, the biases are added
            assert 0.0 < estimate.bias <= 2.1 * stated * abs(estimate.value) and stated < 1e-5
    for residual in found.identities.values():
        assert_agrees(residual, 0.0)


def undamped(law: Law, damping: float) -> Scene:
    """Two masses between stops, with noise that matches a damping."""
    stops = [
        ImpactPair(name="one", on="x", lower=-0.8, upper=0.8, law=law),
        ImpactPair(name="other", on="z", upper=0.9, law=law),
    ]
    return Scene(
        structure=Matrices(
            coordinates=("x", "z"), mass=np.eye(2).tolist(), damping=(damping * np.eye(2)).tolist(),
            stiffness=[[2.0, -1.0], [-1.0, 1.5]],
        ),
        impact_pairs=stops,
        excitations=[WhiteNoise(on=each, intensity=2.0 * damping) for each in ("x", "z")],
    )  # fmt: skip


@pytest.mark.parametrize(
    "law", [*ELASTIC.values(), Elastic(stiffness=20.0), Elastic(stiffness=1e3)], ids=repr
)
def test_contacts_without_losses_keep_the_energy_to_what_is_stated(law: Law) -> None:
    """Hundreds of contacts of paths that nothing damps and nothing drives."""
    plan = plan_modal_contacts(model_of(undamped(law, 0.1)), None, 10.0)
    quiet = replace(plan, model=model_of(undamped(law, 1e-16)))
    streams = np.empty((2, 512), np.uint64)
    seed_streams(np.uint64(3), 0, streams)
    state = plan.start(streams)

    def energy() -> np.ndarray:
        modes = quiet.modes
        found = 0.5 * np.sum(state[2:4] ** 2 + modes.squares[:, None] * state[:2] ** 2, axis=0)
        for pair, y in zip(quiet.model.pairs, modes.gaps @ state[:2], strict=True):
            for stop in pair.stops:
                found += stop.law.potential_at(stop.side * (y - stop.position))
        return found

    before = energy()
    hits = quiet.counts(state, streams, 1000).sum(axis=(0, 1))
    often = hits > 10  # others have too little energy to reach a stop
    lost = (energy() / before - 1.0)[often] / hits[often]
    assert np.sum(often) > 320
    assert abs(lost.mean()) < CONTACT_ENERGY
    # a friction as small as that would be seen
    assert lost.std() / np.sqrt(len(lost)) < 0.25 * CONTACT_ENERGY
    slow = replace(plan, law=plan.law._replace(slowest=1e4))
    assert slow.relative_bias == pytest.approx(CONTACT_ENERGY * slow.hits_in_a_cluster)


def test_another_law_is_told_from_it() -> None:
    """The negative control of the comparison above: stops softer by a fifth."""
    truth = exact(matched(Elastic(stiffness=4.0))).impact_pairs["gap"]["contact_probability"]
    found = simulate(matched(Elastic(stiffness=5.0)), paths=96, duration=100.0, seed=3)
    with pytest.raises(AssertionError):
        assert_agrees(found.impact_pairs["gap"]["contact_probability"], truth.value)


def one_mass(law: Law, upper: float = 0.5, lower: float = -1.0) -> Scene:
    return Scene(
        structure=Oscillator(mass=2.0, damping=0.2, stiffness=2.0),
        impact_pairs=[ImpactPair(name="stops", on="x", lower=lower, upper=upper, law=law)],
        excitations=[WhiteNoise(on="x", intensity=0.4)],
    )


def by_modes(scene: Scene, far: float) -> Scene:
    """The same scene with a second pair beyond reach, which the modal engine simulates."""
    out_of_reach = ImpactPair(name="far", on="x", upper=far, law=Restitution(coefficient=1.0))
    return scene.model_copy(update={"impact_pairs": (*scene.impact_pairs, out_of_reach)})


@pytest.mark.parametrize("upper", [0.5, -0.4], ids=["gap", "pressed"])
def test_one_coordinate_is_as_by_the_engine_for_one_oscillator(upper: float) -> None:
    """There the contact with a viscoelastic stop is flown exactly."""
    law = Viscoelastic(stiffness=100.0, damping_ratio=0.2)
    scene = one_mass(law, upper)
    ours, other = (
        simulate(each, paths=128, duration=60.0, seed=seed)
        for seed, each in ((6, by_modes(scene, 20.0)), (5, scene))
    )
    assert "modal" in " ".join(ours.assumptions)
    twin = other.estimates()
    for key, estimate in ours.estimates().items():
        if estimate.bias is not None and key in twin:
            assert_agrees(apart(estimate, twin[key]), 0.0)
    assert ("stops", "peak_force") in twin
    for residual in ours.identities.values():
        assert_agrees(residual, 0.0)


def test_stiff_walls_throw_back_as_restitution_says() -> None:
    """R = exp(-2 z arccos z / sqrt(1 - z^2)); the soft ones do not (negative control)."""
    law = Viscoelastic(stiffness=1e4, damping_ratio=0.2)
    rigid = simulate(absorber(Restitution(coefficient=law.restitution)), paths=64, duration=60.0)
    stiff = simulate(absorber(law), paths=64, duration=60.0, seed=7)
    soft = simulate(
        absorber(Viscoelastic(stiffness=1.0, damping_ratio=0.2)), paths=64, duration=60.0, seed=8
    )
    for name in ("impact_speed_rate", "impact_speed_square_rate", "relative_displacement_std"):
        ours, truth = stiff.impact_pairs["box"][name], rigid.impact_pairs["box"][name]
        assert_agrees(apart(ours, truth), 0.0)
    name = "relative_displacement_std"
    with pytest.raises(AssertionError):
        assert_agrees(apart(soft.impact_pairs["box"][name], rigid.impact_pairs["box"][name]), 0.0)


def random_scene(seed: int) -> Scene:
    """Two or three coordinates, two pairs of any laws, white or filtered noise, a load, a sine."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(2, 4))
    names = [f"m{k}" for k in range(count)]
    tri = 2.0 * np.eye(count) - np.eye(count, k=1) - np.eye(count, k=-1)

    def law() -> Law:
        stiffness = float(10.0 ** rng.uniform(0.5, 3.0))
        return [
            Viscoelastic(stiffness=stiffness, damping_ratio=float(rng.uniform(0.05, 1.2))),
            Elastic(stiffness=stiffness),
            Hertz(coefficient=stiffness),
            ForceTable(deflection=[0.1, 0.3], force=[0.05 * stiffness, 0.4 * stiffness]),
            Restitution(coefficient=float(rng.uniform(0.4, 1.0))),
        ][int(rng.integers(5))]

    shaken = [
        WhiteNoise(on="m0", intensity=0.2),
        FilteredNoise(on="m0", intensity=0.2, frequency_hz=0.2, zeta=0.3),
    ]
    return Scene(
        structure=Matrices(
            coordinates=names,
            mass=np.diag(rng.uniform(0.3, 2.0, count)),
            damping=0.1 * tri,
            stiffness=tri,
        ),
        impact_pairs=[
            ImpactPair(
                name="stops", on="m0", lower=-0.6, upper=0.8, lower_law=law(),
                upper_law=Viscoelastic(stiffness=50.0, damping_ratio=0.3),
            ),
            ImpactPair(name="gap", between=names[-2:], lower=-0.5, upper=0.4, law=law()),
        ],
        excitations=[
            shaken[seed % 2],
            ConstantLoad(on="m1", force=0.2),
            *([Sine(on="m1", amplitude=0.3, frequency_hz=0.17)] if seed % 3 == 0 else []),
        ],
    )  # fmt: skip


@pytest.mark.parametrize(
    "seed", [*range(3), *(pytest.param(seed, marks=pytest.mark.verify) for seed in range(3, 10))]
)
def test_balances_hold_for_random_scenes(seed: int) -> None:
    response = simulate(random_scene(seed), paths=32, duration=60.0, seed=seed)
    white = seed % 2 == 0 and seed % 3
    assert ("energy" in response.identities) == bool(white)
    assert any(name.startswith("force on") for name in response.identities)
    for residual in response.identities.values():
        assert_agrees(residual, 0.0)


def test_a_wrong_damper_breaks_the_energy_balance() -> None:
    """What the stops take, judged as 1.2 times as much."""
    scene = matched(Viscoelastic(stiffness=20.0, damping_ratio=0.3))
    plan = make_plan(model_of(scene), None, 100.0)
    found = PathStatistics.of(plan.averages(4, 0, 192), plan.layout)
    model = model_of(scene)
    origin = [plan.layout.origins[name] for name in model.coordinates]

    def energy(means: dict) -> float:
        wrong = {
            key: 1.2 * value if key[1].startswith("loss") else value for key, value in means.items()
        }
        return residuals(model, wrong, origin)["energy"]

    value, error = found.evaluate(energy)
    assert abs(value) > 4.5 * error
    value, error = found.evaluate(lambda means: residuals(model, means, origin)["energy"])
    assert abs(value) < 4.5 * error


# ---- brute force -----------------------------------------------------------------------------

ROUND = ForceFunction(force=lambda y, v: 1.2e7 * y**1.5 * (1.0 + 0.5 * v))
"""A force of one's own, that of round bodies with a loss."""

SCENES = {
    "viscoelastic and Hertz": two_stages(
        Viscoelastic(stiffness=4e5, damping_ratio=0.3), Hertz(coefficient=4e6)
    ),
    "tabulated and elastic": two_stages(
        ForceTable(deflection=[1e-3, 2e-3], force=[100.0, 900.0]), Elastic(stiffness=3e5)
    ),
    "a function and viscoelastic": two_stages(
        ROUND, Viscoelastic(stiffness=3e5, damping_ratio=0.1)
    ),
    "one mass, a function": truck(ForceFunction(force=lambda y, v: 1e6 * y**1.5 * (1.0 + v))),
}


@pytest.mark.slow
@pytest.mark.parametrize("scene", SCENES.values(), ids=SCENES.keys())
def test_a_path_is_that_of_brute_force(scene: Scene) -> None:
    """Masses on a truck, all gaps narrow: the same smooth input, integrated naively."""
    plan = make_plan(model_of(scene), None, 1.0)
    assert isinstance(plan, ModalTablesPlan)
    plan = replace(plan, burn_in=0.05)
    record = np.zeros((plan.steps, 1, plan.record_width))
    plan.averages(1, 0, 1, record)
    free = plan.free_response(1, 0, 1, 0)
    n, h, count = plan.modes.size, plan.step, 100
    value, slope = free[:, :, 0], plan.scale * free[:, :, 1]

    def smooth(t: float) -> np.ndarray:
        """Modal displacements and velocities by the cubic through two samples."""
        k = min(int(t / h), count - 1)
        s = t / h - k
        y0, y1, v0, v1 = value[k], value[k + 1], h * slope[k], h * slope[k + 1]
        c2, c3 = 3.0 * (y1 - y0) - 2.0 * v0 - v1, v0 + v1 - 2.0 * (y1 - y0)
        return np.concatenate(
            [y0 + s * (v0 + s * (c2 + s * c3)), (v0 + s * (2.0 * c2 + 3.0 * s * c3)) / h]
        )

    pairs = model_of(scene).pairs
    touched = [0] * len(pairs)

    def rate(t: float, e: np.ndarray) -> np.ndarray:
        total = smooth(t) + e
        pull = -plan.modes.squares * e[:n] - plan.modes.damping @ e[n:]
        for j, pair in enumerate(pairs):
            y, v = plan.modes.gaps[j] @ total[:n], plan.modes.gaps[j] @ total[n:]
            for stop in pair.stops:
                more = {"mass": pair.mass} if isinstance(stop.law, Viscoelastic) else {}
                force = float(stop.law.force_at(stop.deflection(y), stop.side * v, **more))
                touched[j] += force > 0.0
                pull -= stop.side * force * plan.modes.gaps[j]
        return np.concatenate([e[n:], pull])

    # from the end of the first counted step, at sample 0
    start = record[0, 0, : 2 * n] - np.concatenate([value[0], slope[0]])
    times = h * np.arange(count)
    solved = solve_ivp(
        rate, (0.0, times[-1]), start, t_eval=times, rtol=1e-8, atol=1e-12, max_step=h / 8.0
    )
    brute = solved.y.T + np.hstack([value[:count], slope[:count]])
    assert min(touched) > 100
    size = np.abs(brute).max(axis=0)
    # what a sub-step leaves of a contact whose force has kinks, over several of them
    tolerance = 3.0 * KINK_ERROR
    np.testing.assert_allclose(
        record[:count, 0, : 2 * n] / size, brute / size, rtol=0, atol=tolerance
    )


# ---- the contract ----------------------------------------------------------------------------


def test_digits_do_not_depend_on_blocks_or_threads() -> None:
    scene = absorber(Viscoelastic(stiffness=20.0, damping_ratio=0.2))
    plan = make_plan(model_of(scene), None, 30.0)
    whole = plan.averages(1, 0, 40)
    np.testing.assert_array_equal(whole[:, 30:], plan.averages(1, 30, 10))
    one, two = (simulate(scene, paths=70, duration=20.0, threads=n) for n in (1, 2))
    assert one.to_frame().equals(two.to_frame())


def test_rigid_and_soft_pairs_answer_for_themselves() -> None:
    scene = two_stages(Viscoelastic(stiffness=4e5, damping_ratio=0.3), Restitution(coefficient=0.6))
    response = simulate(scene, paths=16, duration=10.0)
    soft, rigid = response.impact_pairs["bumpers"], response.impact_pairs["box stops"]
    assert soft["peak_force"].value > 0.0 and soft["contact_probability"].value > 0.0
    assert rigid["peak_force"] is None and rigid["contact_probability"] is None
    assert {"viscoelastic stop lower of bumpers", "rigid stop upper of box stops"} <= set(
        response.effects
    )


def test_a_mass_that_lies_on_a_stop_too_stiff_is_refused() -> None:
    scene = by_modes(one_mass(Elastic(stiffness=1e12), upper=-3.0, lower=-9.0), 20.0)
    with pytest.raises(NotApplicable, match="upper stop of stops"):
        simulate(scene)
