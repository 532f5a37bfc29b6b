"""Averaging of the energy: exact where nothing is lost, and how its error falls elsewhere."""

from __future__ import annotations

import math

import matplotlib.pyplot as plt
import numpy as np
import pytest
from scipy.integrate import quad

from stochvi.methods.averaging import VARIANTS, AveragedDensity, average, average_density
from stochvi.methods.closed_form import exact, exact_density
from stochvi.methods.fokker_planck import fokker_planck, fokker_planck_density
from stochvi.methods.monte_carlo import simulate
from stochvi.model.energy_law import CONTINUOUS, FINITE_JUMPS, UNFOLDED, Well, barrier_of
from stochvi.results.base import Response
from stochvi.results.errors import NotApplicable
from stochvi.results.estimates import Estimate
from stochvi.scenes.excitations import WhiteNoise
from stochvi.scenes.impact_laws import Elastic, Restitution, SpeedRestitution
from stochvi.scenes.scene import ImpactPair, Scene
from stochvi.scenes.structures import Oscillator
from stochvi.testing import assert_agrees
from support.accuracies import quick_cases
from support.known import RIGID_STOPS, oscillator, values

LOSSLESS = {
    "symmetric": {"lower": -1.0, "upper": 1.0},
    "unequal, with a load": {"lower": -0.5, "upper": 1.0, "load": 0.3},
    "one stop": {"upper": 1.0},
    "preload": {"upper": -1.0},
    "preload from below, in a box": {"lower": 0.4, "upper": 1.0},
    "box": {"lower": -1.0, "upper": 2.0, "omega": 0.0},
    "box on its side": {"lower": -1.0, "upper": 2.0, "omega": 0.0, "load": -0.5},
    "weight on a floor": {"upper": 1.0, "omega": 0.0, "load": 0.5},
    "far stops": {"lower": -9.0, "upper": 8.0},
    "no stops": {},
}


@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize("name", LOSSLESS)
def test_without_losses_at_the_stops_averaging_is_exact(name, variant):
    scene = oscillator(**LOSSLESS[name])
    known, found = exact(scene).estimates(), average(scene, variant=variant).estimates()
    assert set(known) == set(found)
    for key, estimate in known.items():
        size = known["x", "displacement_std"].value if key[1] == "displacement_mean" else 0.0
        assert found[key].value == pytest.approx(estimate.value, rel=1e-9, abs=1e-9 * size), key


@pytest.mark.parametrize(
    "well",
    [
        Well(omega=1.3, load=0.4, lower=-0.7, upper=1.5),
        Well(omega=1.3, load=0.4, lower=-math.inf, upper=-0.2),
        Well(omega=0.0, load=0.4, lower=-0.7, upper=1.5),
        Well(omega=0.0, load=0.0, lower=-0.7, upper=1.5),
        Well(omega=0.0, load=-0.4, lower=-0.7, upper=math.inf),
    ],
)
def test_the_integrals_over_a_cycle_by_quadrature(well):
    """T, J and the integrals of y and y^2 over time; x = middle + half sin(angle)."""
    energies = np.array([0.05, 0.4, 2.5])
    found = well.orbits(energies)

    def potential(x):
        return well.energy(x)

    for row, energy in enumerate(energies):
        if well.omega:
            rest = well.load / well.omega**2
            reach = math.sqrt(2.0 * (energy - potential(rest))) / well.omega
            low, high = rest - reach, rest + reach
        else:
            turn = well.place - energy / well.load if well.load else math.inf
            low, high = (turn, math.inf) if well.load > 0.0 else (-math.inf, turn)
        low, high = max(low, well.lower), min(high, well.upper)
        middle, half = (low + high) / 2.0, (high - low) / 2.0

        def cycle(of, middle=middle, half=half, energy=energy):
            def integrand(angle):
                x = middle + half * math.sin(angle)
                v = math.sqrt(max(2.0 * (energy - potential(x)), 1e-300))
                return of(x, v) * half * math.cos(angle)

            return 2.0 * quad(integrand, -math.pi / 2, math.pi / 2, epsabs=1e-12, limit=400)[0]

        expected = [
            cycle(of)
            for of in (
                lambda x, v: 1.0 / v,
                lambda x, v: v,
                lambda x, v: (x - well.place) / v,
                lambda x, v: (x - well.place) ** 2 / v,
            )
        ]
        assert [column[row] for column in found] == pytest.approx(expected, rel=1e-6, abs=1e-8)


@pytest.mark.parametrize("variant", [CONTINUOUS, FINITE_JUMPS])
@pytest.mark.parametrize("restitution", [0.95, 0.163, 0.0])
@pytest.mark.parametrize("stops", [(-0.5, 1.2), (None, 1.0)], ids=str)
def test_the_balance_of_energy_holds_for_every_loss(stops, restitution, variant):
    """It follows from either equation for G by integration over the energy."""
    found = average(oscillator(*stops, restitution, load=0.2), variant=variant)
    # G bends where the first jumps land: the quadrature has eight digits there, else twelve
    assert abs(found.identities["energy"].value) < 1e-8


@pytest.mark.parametrize("variant", [CONTINUOUS, FINITE_JUMPS])
@pytest.mark.parametrize(
    ("damping", "restitution", "stop"), [(0.01, 0.5, -1.0), (0.01, 0.5, -2.0), (1e-3, 0.3, -4.0)]
)
def test_a_mass_pressed_hard_against_a_lossy_stop(damping, restitution, stop, variant):
    """It stays so close that a spring presses like a weight, and has little energy but a tail."""
    intensity = 2.0 * damping
    pressed = oscillator(upper=stop, restitution=restitution, damping=damping, intensity=intensity)
    found = average(pressed, variant=variant)
    assert abs(found.identities["energy"].value) < 1e-8
    spread = found.coordinates["x"]["displacement_std"].value
    weight = oscillator(
        upper=0.0, restitution=restitution, omega=0.0, load=-stop, damping=damping,
        intensity=intensity,
    )  # fmt: skip
    known = average(weight, variant=variant).coordinates["x"]["displacement_std"].value
    # the spring's force falls by y / stop on a way y, of which the fourth moment has a long tail
    assert spread == pytest.approx(known, rel=40.0 * spread / -stop)


@pytest.mark.parametrize("pressed", [{"upper": -2.0}, {"upper": 0.0, "omega": 0.0, "load": 1.0}])
def test_a_mass_pressed_against_a_plastic_stop_is_the_limit_of_lossy_ones(pressed):
    """Its energy starts at zero in every cycle, and cycles lose 1 - R^2 of theirs."""
    plastic, lossy = (average(oscillator(restitution=r, **pressed)) for r in (0.0, 1e-3))
    assert abs(plastic.identities["energy"].value) < 1e-8
    for name in ("displacement_std", "velocity_std"):
        known = lossy.coordinates["x"][name].value
        assert plastic.coordinates["x"][name].value == pytest.approx(known, rel=2e-6)


def off(scene: Scene, variant: str, names) -> dict[str, float]:
    """Relative errors against the Fokker-Planck equation."""
    known, found = values(fokker_planck(scene, speed_threshold=0.0)), None
    found = values(average(scene, variant=variant))
    return {name: abs(found[name] / known[name] - 1.0) for name in names}


SUMS = ("velocity_std", "impact_speed_rate", "impact_speed_square_rate")


def test_both_variants_approach_the_truth_as_all_losses_vanish():
    """b = 1 - R = e: both errors are of order e, up to what slow impacts add."""
    for variant in VARIANTS:
        errors = [
            off(oscillator(-1.0, 1.0, 1.0 - e, damping=e, intensity=2.0 * e), variant, SUMS)
            for e in (0.2, 0.02)
        ]
        for name in SUMS:
            assert errors[1][name] < errors[0][name] / 4.0, (variant, name)


def test_with_light_damping_finite_jumps_are_right_where_spread_losses_are_not():
    """R = 0.5 stays: only the variant with jumps has the truth as its limit."""
    scenes = [oscillator(-1.0, 1.0, 0.5, damping=b, intensity=2.0 * b) for b in (0.1, 0.001)]
    jumps = [off(scene, FINITE_JUMPS, SUMS) for scene in scenes]
    spread = [off(scene, CONTINUOUS, SUMS) for scene in scenes]
    for name in SUMS:
        assert jumps[1][name] < jumps[0][name] / 4.0
    assert jumps[1]["impact_speed_rate"] < 0.03  # 0.011, of which 0.009 the equation's own
    assert spread[1]["impact_speed_rate"] > 0.07  # 0.083: of the model, not of the damping


@pytest.mark.parametrize("row", RIGID_STOPS, ids=lambda row: f"R = {row.restitution}")
def test_against_the_reference_table_at_one_twentieth_of_critical_damping(row):
    """b / omega = 0.1 is not small: within b pi of the truth, more at more loss (stated)."""
    limits = {1.0: 1e-6, 0.95: 0.04, 0.8: 0.075, 0.5: 0.12}
    known = row.values
    for variant in (CONTINUOUS, FINITE_JUMPS):
        found = values(average(oscillator(-1.0, 1.0, row.restitution), variant=variant))
        for name in ("displacement_std", *SUMS):
            limit = limits.get(row.restitution)
            if limit is not None:
                assert found[name] == pytest.approx(known[name], rel=limit), (variant, name)


@pytest.mark.parametrize("restitution", [0.9, 0.5, 0.2])
def test_the_unfolded_motion_loses_two_over_one_plus_r_times_as_much(restitution):
    """Its energy balance is S0 / 2 = b E v^2 + (1 - R) F2, with a damper in place of a stop."""
    found = values(average(oscillator(-0.5, 1.2, restitution, load=0.2), variant=UNFOLDED))
    supplied = 0.1 * found["velocity_mean_square"]
    supplied += (1.0 - restitution) * found["impact_speed_square_rate"]
    assert supplied == pytest.approx(0.1, rel=1e-10)


def test_what_cannot_be_averaged_is_said():
    free = Oscillator(mass=1.0, damping=0.1, stiffness=1.0)
    noise = [WhiteNoise(intensity=0.2)]
    for law, words in [
        (Elastic(stiffness=9.0), "stops must be rigid"),
    ]:
        pairs = [ImpactPair(upper=1.0, law=law)]
        with pytest.raises(NotApplicable, match=words):
            average(Scene(structure=free, impact_pairs=pairs, excitations=noise))
    with pytest.raises(NotApplicable, match="damping must be positive"):
        average(oscillator(-1.0, 1.0, damping=0.0))
    with pytest.raises(NotApplicable, match="stiffness must be positive"):
        average(oscillator(None, 1.0, omega=0.0))
    with pytest.raises(ValueError, match="variant must be one of"):
        average(oscillator(-1.0, 1.0), variant="jumps")


def test_undamped_flight_between_lossy_stops_has_a_law():
    found = average(oscillator(-1.0, 1.0, 0.9, damping=0.0))
    estimate = found.coordinates["x"]["velocity_mean_square"]
    assert isinstance(estimate, Estimate) and estimate.bias is None
    assert_agrees(
        Estimate(value=found.identities["energy"].value, bias=1e-10),
        0.0,
    )


@pytest.mark.parametrize("variant", VARIANTS)
@quick_cases("restitution", [0.8, 0.9], keep=(0,))
def test_a_mass_that_rests_on_a_lossy_stop_is_warned_of_by_the_factor_it_is_off(
    variant, restitution
):
    """A weight that noise alone lifts off a floor, in units of its own."""
    scene = oscillator(upper=0.0, omega=0.0, load=1.0, restitution=restitution, damping=0.0)
    answer, truth = average(scene, variant=variant), fokker_planck(scene)
    (warning,) = answer.warnings
    said = float(warning.split("factor of up to ")[1].split(";")[0])
    spread = [one.estimates()["x", "displacement_std"] for one in (answer, truth)]
    assert spread[1].bias is not None
    slack = spread[1].bias / spread[1].value + 0.5 * 10.0 ** (math.floor(math.log10(said)) - 1)
    assert spread[0].value / spread[1].value == pytest.approx(said, abs=slack + 0.005 * said)


def test_a_mass_between_its_stops_is_not_said_to_rest_on_them():
    assert average(oscillator(-1.0, 1.0, 0.8)).warnings == []
    assert average(oscillator(-1.0, 1.0, 0.8, omega=0.0)).warnings == []


@pytest.mark.parametrize("variant", [FINITE_JUMPS, CONTINUOUS])
@pytest.mark.parametrize(
    "scene",
    [
        oscillator(upper=0.0, omega=0.0, load=1.0, restitution=0.8, damping=0.3),
        oscillator(upper=0.0, restitution=0.5, load=1.0),
        oscillator(upper=0.0, restitution=0.6),
    ],
    ids=["damper", "spring, damper and load", "spring and damper"],
)
def test_a_spring_or_a_damper_makes_averaging_better_than_warned(variant, scene):
    answer, truth = average(scene, variant=variant), fokker_planck(scene)
    said = float(answer.warnings[0].split("factor of up to ")[1].split(";")[0])
    spread = [one.estimates()["x", "displacement_std"].value for one in (answer, truth)]
    assert 1.0 < spread[0] / spread[1] < said


# Restitutions that depend on the speed

JUDGED = ("displacement_std", "velocity_std", "impact_speed_rate", "impact_speed_square_rate")


def lightly_damped(law: Restitution | SpeedRestitution, zeta: float = 0.02) -> Scene:
    """Uneven stops at about the standard deviation without them, 1 m."""
    return Scene(
        structure=Oscillator(mass=1.0, damping=2.0 * zeta, stiffness=1.0),
        impact_pairs=[ImpactPair(lower=-0.6, upper=0.9, law=law)],
        excitations=[WhiteNoise(intensity=2.0 * zeta)],
    )


def judged(response: Response) -> np.ndarray:
    known = {**response.coordinates["x"], **response.impact_pairs["stops"]}
    return np.array([known[name].value for name in JUDGED])


@pytest.mark.parametrize("variant", VARIANTS)
def test_a_restitution_that_is_the_same_at_every_speed_is_a_number(variant: str) -> None:
    number = average(lightly_damped(Restitution(coefficient=0.7)), variant=variant)
    by_speed = SpeedRestitution(speed=[0.1, 1.0], coefficient=[0.7, 0.7])
    found = average(lightly_damped(by_speed), variant=variant)
    assert judged(found) == pytest.approx(judged(number), rel=1e-12)
    if variant == FINITE_JUMPS:
        assert "do not depend on the speed" in found.coordinates["x"]["displacement_std"].how


@pytest.mark.slow
def test_the_error_of_a_restitution_by_speed_falls_with_the_losses() -> None:
    errors = []
    for restitution in (0.8, 0.95, 0.99):
        law = SpeedRestitution(coefficient=restitution, at_speed=0.8, body="hunt-crossley")
        scene = lightly_damped(law, zeta=0.01)
        errors.append(np.abs(judged(average(scene)) / judged(fokker_planck(scene)) - 1.0).max())
    assert errors[0] < 0.02
    assert errors[0] > errors[1] > errors[2]


FALLING = SpeedRestitution(speed=[0.1, 0.5, 2.0], coefficient=[0.95, 0.7, 0.3])
"""A restitution so steep that the fastest impacts rebound more slowly than slower ones."""


@pytest.mark.slow
def test_rebounds_that_slow_down_at_high_speeds_are_averaged() -> None:
    scene = lightly_damped(FALLING)
    known = judged(fokker_planck(scene))
    error = np.abs(judged(average(scene)) / known - 1.0).max()
    # that of one number, at the error of averaging for such a loss
    number = lightly_damped(Restitution(coefficient=0.7))
    usual = np.abs(judged(average(number)) / judged(fokker_planck(number)) - 1.0).max()
    assert error < 1.5 * usual
    # the control: the number at 1 m/s
    middle = Restitution(coefficient=float(FALLING.restitution_at([1.0])[0]))
    wrong = np.abs(judged(average(lightly_damped(middle))) / known - 1.0).max()
    assert wrong > 2.0 * error


def test_impacts_return_from_where_quadrature_finds_them() -> None:
    """The probability that an impact from a higher energy ends below one, by counting."""
    barrier = barrier_of(FALLING, 0.3)
    above = np.array([0.005, 0.05, 0.12, 0.2, 1.0])
    found = list(barrier.returns(above))
    assert len(found) >= 2
    energies = np.linspace(0.0, 30.0, 300_001)
    after = energies * FALLING.restitution_at(np.sqrt(2.0 * energies)) ** 2
    for k, energy in enumerate(above):
        ends_below = (energies > energy) & (after <= energy)
        counted = float(np.sum(np.exp(-energies[ends_below])) * 1e-4)
        exact_ = math.exp(-energy) + sum(
            each.weights[k] * math.exp(-each.starts[k]) for each in found
        )
        assert exact_ == pytest.approx(counted, abs=3e-4)


@pytest.mark.slow
def test_a_simulation_has_the_averages_of_a_restitution_by_speed() -> None:
    law = SpeedRestitution(coefficient=0.95, at_speed=0.8, body="viscoelastic")
    scene = lightly_damped(law, zeta=0.01)
    found, simulated = average(scene), simulate(scene, rel_error=0.01, seed=4)
    for name in JUDGED[:2]:
        estimate = simulated.coordinates["x"][name]
        value = found.coordinates["x"][name].value
        assert abs(value / estimate.value - 1.0) < 0.015 + 4.0 * estimate.standard_error / value


# ------------------------------------------------------------------------------
# The density of an averaged energy: against the closed form, its own averages, and its bands
# against the Fokker-Planck equation.
# ------------------------------------------------------------------------------


PRESSED = oscillator(-0.2, 1.0, 0.8, load=0.2)
X = np.linspace(-0.999, 0.999, 41)


def integrals(found: AveragedDensity, low: float, high: float) -> list[float]:
    """Area, mean and mean square of the density of the displacement."""
    x = np.linspace(low, high, 2001)
    p = found.displacement_density(x)
    return [float(np.trapezoid(p * x**k, x)) for k in range(3)]


def test_without_losses_it_is_exact() -> None:
    scene = oscillator(-1.0, 1.0, 1.0)
    found, known = average_density(scene), exact_density(scene)
    assert found.displacement_density(X) == pytest.approx(known.displacement_density(X), rel=1e-9)
    v = np.linspace(-3.0, 3.0, 7)
    assert found.density(X[:, None], v) == pytest.approx(known.density(X[:, None], v), rel=1e-8)
    assert found.velocity_density(v) == pytest.approx(known.velocity_density(v), rel=1e-4)
    assert found.impact_flux("upper", v[4:]) == pytest.approx(
        known.impact_flux("upper", v[4:]), rel=1e-8
    )
    low, high = found.bands(X)
    assert np.array_equal(low, high)


@pytest.mark.parametrize(
    ("scene", "low", "high"),
    [
        (oscillator(-1.0, 1.0, 0.8), -1.0, 1.0),
        (PRESSED, -0.2, 1.0),
        (oscillator(None, 0.5, 0.6), -9.0, 0.5),
    ],
)
@pytest.mark.parametrize("variant", ["finite jumps", "continuous"])
def test_its_integrals_are_the_averages(
    scene: Scene, low: float, high: float, variant: str
) -> None:
    found = average_density(scene, variant=variant)
    assert (
        found.response.to_dict()["coordinates"]
        == (average(scene, variant=variant).to_dict()["coordinates"])
    )
    area, mean, square = integrals(found, low, high)
    x = found.response.coordinates["x"]
    assert area == pytest.approx(1.0, abs=1e-4)
    assert mean == pytest.approx(float(x["displacement_mean"]), abs=1e-4)
    assert math.sqrt(square - mean**2) == pytest.approx(float(x["displacement_std"]), rel=1e-4)
    # the joint density over all velocities, by brute force
    v = np.linspace(-9.0, 9.0, 4001)
    place = 0.3 * low + 0.7 * high
    assert float(np.trapezoid(found.density(place, v), v)) == pytest.approx(
        float(found.displacement_density(place)), rel=1e-3
    )
    w = np.linspace(0.0, 9.0, 4001)
    rate = found.response.impact_pairs["stops"]["collision_rate_upper"]
    assert float(np.trapezoid(found.impact_flux("upper", w), w)) == pytest.approx(
        float(rate), rel=1e-3
    )
    levels = np.array([0.01, 0.5, 0.9])
    assert [integrals(found, low, float(q))[0] for q in found.quantiles(levels)] == pytest.approx(
        levels, abs=1e-3
    )


def places() -> list[Scene]:
    """Scenes off the nodes of the atlas, of both kinds of stops."""
    random = np.random.default_rng(8)
    found = []
    for number in range(8):
        gap, restitution = random.uniform(0.3, 2.5), random.uniform(0.1, 0.95)
        damping = 2.0 * math.exp(random.uniform(math.log(0.01), math.log(0.4)))
        lower = -gap if number % 2 else None
        found.append(oscillator(lower, gap, restitution, damping=damping, intensity=2.0 * damping))
    return found


@pytest.mark.slow
def test_the_bands_hold_the_density_of_the_fokker_planck_equation() -> None:
    held, of_others = [], []
    for scene in places():
        found, true = average_density(scene), fokker_planck_density(scene, rtol=1e-3)
        x = found.quantiles(np.linspace(0.01, 0.99, 21))
        low, high = found.bands(x)
        for factor, told in ((1.0, held), (1.5, of_others)):
            exact = factor * true.displacement_density(x)
            told += ((low <= exact) & (exact <= high)).tolist()
    assert np.mean(held) >= 0.99  # the share that the study finds
    assert np.mean(of_others) < 0.6


def test_no_band_is_given_where_none_is_known() -> None:
    symmetric = average_density(oscillator(-1.0, 1.0, 0.8))
    low, high = symmetric.bands([-0.9999, 0.0, 0.9999])
    assert np.isnan(low).tolist() == np.isnan(high).tolist() == [True, False, True]
    assert symmetric.how_bands.startswith("band from")
    turned = average_density(oscillator(-0.5, None, 0.5)).bands(np.linspace(-0.4, 2.0, 9))
    upper = average_density(oscillator(None, 0.5, 0.5)).bands(np.linspace(0.4, -2.0, 9))
    assert np.asarray(turned) == pytest.approx(np.asarray(upper), rel=1e-6, nan_ok=True)
    for found, why in (
        (average_density(PRESSED), "two like stops"),
        (average_density(oscillator(-1.0, 1.0, 0.8), variant="continuous"), "has no atlas"),
    ):
        assert why in found.how_bands
        assert np.isnan(found.bands(0.1)).all() and found.displacement_density(0.1) > 0.0


def test_an_answer_of_averaging_shows_its_density() -> None:
    answer = average(oscillator(-1.0, 1.0, 0.8))
    shown = answer.densities()["x"]
    assert shown.edges[[0, -1]].tolist() == [-1.0, 1.0]
    assert float(shown.density @ np.diff(shown.edges)) == pytest.approx(1.0, abs=1e-3)
    low, high = shown.bands()
    inside = np.isfinite(low)
    assert np.all(low[inside] < shown.density[inside]) and np.all(
        shown.density[inside] < high[inside]
    )
    ax = answer.plot()
    assert "bands of its error" in ax.get_ylabel() and len(ax.patches) == 2
    plt.close("all")
