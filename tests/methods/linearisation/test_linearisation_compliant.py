"""Linearisation of compliant stops: exact laws, printed characteristics, limits, balances."""

from __future__ import annotations

import math
from typing import Any

import mpmath
import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq
from scipy.stats import norm

from stochvi.mathematics.spectra import Filter, stationary_covariance
from stochvi.methods.closed_form import exact
from stochvi.methods.fokker_planck import fokker_planck
from stochvi.methods.linearisation import linearise
from stochvi.methods.linearisation.forms import form_of, inverse
from stochvi.methods.linearisation.linear_system import Candidate
from stochvi.model.gap import Gap
from stochvi.model.model import UPPER, model_of
from stochvi.results.base import Response
from stochvi.results.estimates import Estimate
from stochvi.scenes.excitations import (
    ConstantLoad,
    Excitation,
    FilteredNoise,
    TabulatedNoise,
    WhiteNoise,
)
from stochvi.scenes.impact_laws import Elastic, ForceTable, Hertz, Law, Restitution, Viscoelastic
from stochvi.scenes.scene import ImpactPair, Scene
from stochvi.scenes.structures import Oscillator
from support.accuracies import quick_cases

WAYS = [
    ("closure", "consistent"),
    ("motion", "consistent"),
    ("motion", "book"),
    ("force", "consistent"),
    ("force", "book"),
]
TABLE = ForceTable(deflection=[0.01, 0.1, 0.5], force=[0.5, 2.0, 60.0])
LAWS = [Elastic(stiffness=40.0), Hertz(coefficient=40.0), TABLE]
PEAK = "peak_force"
QUANTITIES = (
    "displacement_std",
    "velocity_std",
    "collision_rate",
    "impact_speed_rate",
    "impact_speed_square_rate",
    "contact_probability",
)


def make_scene(
    law: Law,
    lower: float | None = -1.0,
    upper: float | None = 1.0,
    *,
    damping: float = 0.1,
    load: float = 0.0,
    noise: tuple[Excitation, ...] = (WhiteNoise(intensity=0.2),),
    mass: float = 1.0,
    stiffness: float = 1.0,
    **keys: Any,
) -> Scene:
    loads = (ConstantLoad(force=load),) if load else ()
    return Scene(
        structure=Oscillator(mass=mass, damping=damping, stiffness=stiffness),
        impact_pairs=[ImpactPair(lower=lower, upper=upper, law=law, **keys)],
        excitations=(*noise, *loads),
    )


def value(response: Response, name: str) -> float:
    groups = [*response.coordinates.values(), *response.impact_pairs.values()]
    found = next(group[name] for group in groups if name in group)
    assert isinstance(found, Estimate), name
    return found.value


def candidate_of(scene: Scene, form: str, unknowns: list[float]) -> Candidate:
    gap = Gap.of(model_of(scene))
    return form_of(form, "consistent", gap).candidate(gap, np.array(unknowns))


# The closure ------------------------------------------------------------------------------------


def random_lossless(rng: np.random.Generator) -> Scene:
    def law() -> Law:
        stiffness = 10.0 ** rng.uniform(-1.0, 6.0)
        knots = np.cumsum(rng.uniform(0.05, 0.5, 3))
        steps = np.cumsum(rng.uniform(0.0, 1.0, 3)) * stiffness * 0.1
        return [
            Elastic(stiffness=stiffness),
            Hertz(coefficient=stiffness),
            ForceTable(deflection=knots.tolist(), force=steps.tolist()),
            Restitution(coefficient=1.0),
        ][rng.integers(4)]

    near, far = 10.0 ** rng.uniform(-2.0, 0.7, 2)
    lower, upper = [(-near, far), (None, near), (None, -2.0 * near), (-near, None)][rng.integers(4)]
    damping = 10.0 ** rng.uniform(-2.0, 0.3)
    noise = WhiteNoise(intensity=2.0 * damping * 10.0 ** rng.uniform(-2.0, 2.0))
    keys = {} if lower is None else {"lower_law": law()}
    load = float(rng.choice([0.0, rng.uniform(-2.0, 2.0)]))
    return make_scene(law(), lower, upper, damping=damping, load=load, noise=(noise,), **keys)


def test_closure_is_exact_where_stops_lose_nothing() -> None:
    rng = np.random.default_rng(5)
    for _ in range(15):
        scene = random_lossless(rng)
        found, truth = linearise(scene), exact(scene)
        deviation = value(truth, "displacement_std")
        difference = value(found, "displacement_mean") - value(truth, "displacement_mean")
        assert abs(difference) < 1e-9 * deviation
        for name, expected in truth.estimates().items():
            quantity = name[1]
            if quantity in QUANTITIES and expected.value > 1e-30:
                assert value(found, quantity) == pytest.approx(expected.value, rel=1e-9), name
        assert all(
            entry.bias == 0.0 for name, entry in found.estimates().items() if name[1] != PEAK
        )


def test_mean_peak_force_is_that_of_the_exact_law() -> None:
    for law in LAWS:
        scene = make_scene(law, -0.5, 1.0)
        found, truth = linearise(scene), exact(scene)
        assert value(found, "peak_force") == pytest.approx(value(truth, "peak_force"), rel=1e-9)


def test_exactness_would_not_survive_another_stiffness() -> None:
    """Negative control."""
    found, other = (linearise(make_scene(Elastic(stiffness=k))) for k in (40.0, 44.0))
    ratio = value(found, "contact_probability") / value(other, "contact_probability")
    assert abs(ratio - 1.0) > 0.02


@pytest.mark.parametrize(("lower", "upper"), [(-1.0, 1.0), (-0.3, 0.8), (None, 0.5)])
@pytest.mark.parametrize("z", [0.0, 0.2, 1.3])
def test_stiff_stops_tend_to_rigid_ones(lower: float | None, upper: float, z: float) -> None:
    """What is left falls as the duration of a contact, like 1 / sqrt(stiffness)."""
    free = Viscoelastic(stiffness=1.0, damping_ratio=z).restitution
    rigid = linearise(make_scene(Restitution(coefficient=free), lower, upper))

    def error(stiffness: float) -> float:
        law = Viscoelastic(stiffness=stiffness, damping_ratio=z)
        soft = linearise(make_scene(law, lower, upper))
        return value(soft, "displacement_std") / value(rigid, "displacement_std") - 1.0

    stiffest = error(1e10)
    assert abs(stiffest) < 1e-4
    # the next order is one more factor 1 / sqrt(stiffness), of some ten times its size
    assert stiffest == pytest.approx(error(1e8) / 10.0, rel=0.02)


def test_a_mass_that_never_leaves_its_stop_is_linear() -> None:
    """Pressed far into a viscoelastic stop: E v^2 = S0 / (2 (b + c)), Var x = E v^2 / (1 + K)."""
    law = Viscoelastic(stiffness=3.0, damping_ratio=0.1)
    found = linearise(make_scene(law, None, 0.0, load=12.0))
    theta = 0.2 / (2.0 * (0.1 + law.damping(1.0)))
    assert value(found, "velocity_mean_square") == pytest.approx(theta, rel=1e-6)
    assert value(found, "displacement_std") ** 2 == pytest.approx(theta / 4.0, rel=1e-6)
    assert value(found, "displacement_mean") == pytest.approx(3.0, rel=1e-6)
    assert value(found, "contact_probability") == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize(("lower", "upper"), [(-0.4, 1.0), (None, 0.5)])
def test_closure_is_nearest_to_the_fokker_planck_equation(
    lower: float | None, upper: float
) -> None:
    scene = make_scene(Viscoelastic(stiffness=100.0, damping_ratio=0.1), lower, upper)
    truth = fokker_planck(scene, rtol=3e-2)
    errors = {}
    for form in ("closure", "motion", "force"):
        found = linearise(scene, form)
        errors[form] = max(
            abs(value(found, name) / value(truth, name) - 1.0)
            for name in ("displacement_std", "velocity_std", "impact_speed_rate")
        )
    assert min(errors, key=lambda form: errors[form]) == "closure"
    assert errors["closure"] < errors["force"] / 3.0


def test_balances_hold_for_stops_that_take_energy() -> None:
    hard = Restitution(coefficient=0.6)
    for keys in ({}, {"lower_law": hard}, {"lower_law": TABLE}):
        scene = make_scene(
            Viscoelastic(stiffness=50.0, damping_ratio=0.3), -0.7, 0.4, load=0.3, **keys
        )
        for form, variant in WAYS[:1]:
            found = linearise(scene, form, variant).identities
            assert set(found) == {"energy", "force"}
            assert all(abs(residual.value) < 1e-9 for residual in found.values())


@pytest.mark.parametrize(("gap", "load"), [(0.0, 1.0), (1.0, 0.0), (1.0, 0.5)])
@quick_cases(("stiffness", "z"), [(3.0, 0.2), (30.0, 0.6)], keep=(1,))
def test_says_where_lossy_stops_are_known_to_be_far_off(
    gap: float, load: float, stiffness: float, z: float
) -> None:
    """And the error that it names holds, against the Fokker-Planck equation."""
    scene = make_scene(Viscoelastic(stiffness=stiffness, damping_ratio=z), None, gap, load=load)
    answer, truth = linearise(scene), fokker_planck(scene, rtol=2e-2)
    words = answer.warnings[-1]  # after what may be said of leaning on the stop
    stated = float(words.split("may be ")[1].replace("off by ", "").split(" %")[0]) / 100.0
    pressed = load > gap
    assert ("a load presses the mass onto the upper stop" in words) == pressed
    name = "displacement_std" if pressed else "contact_probability"
    off = value(answer, name) / value(truth, name) - 1.0
    assert abs(off) < stated
    # negative control: a quarter of it is too little where the warning is about such a stop
    assert z == 0.2 or stated / 4.0 < abs(off)


def test_says_nothing_of_stops_that_lose_little() -> None:
    for law in (Viscoelastic(stiffness=3.0, damping_ratio=0.05), Elastic(stiffness=3.0)):
        assert linearise(make_scene(law, None, 0.0, load=1.0)).warnings == []
    # contacts that are short
    stiff = Viscoelastic(stiffness=1e5, damping_ratio=0.5)
    assert linearise(make_scene(stiff, None, 1.0)).warnings == []


# The characteristics of the form "motion" ----------------------------------------------------


@pytest.mark.parametrize("distance", [-40.0, -2.0, 0.0, 0.5, 3.0, 20.0])
def test_motion_characteristics_in_closed_form(distance: float) -> None:
    """(B 8.48, 8.49) for an elastic stop, parabolic cylinder functions for Hertz, kinks that add
    for a table; k is the derivative with respect to the mean. Far out in the tail as well."""
    deviation = 0.3
    mean = 1.0 - distance * deviation
    unknowns = [math.asinh(mean / deviation), math.log(deviation), 0.0]

    def moment(power: float, at: float = 0.0) -> float:
        """E ((x - 1 - at)+)^power."""
        u = mpmath.mpf(distance) + mpmath.mpf(at) / deviation
        scale = mpmath.mpf(deviation) ** power * mpmath.gamma(power + 1)
        shape = mpmath.pcfd(-power - 1, u) * mpmath.exp(-(u**2) / 4)
        return float(scale * shape / mpmath.sqrt(2 * mpmath.pi))

    def check(law: Law, force: float, slope: float) -> None:
        found = candidate_of(make_scene(law, None, 1.0), "motion", unknowns)
        assert found.stop_force == pytest.approx(force, rel=1e-11)
        assert found.stiffness == pytest.approx(slope, rel=1e-9)

    check(Elastic(stiffness=7.0), 7.0 * moment(1.0), 7.0 * norm.sf(distance))
    check(Hertz(coefficient=7.0), 7.0 * moment(1.5), 10.5 * moment(0.5))
    slopes = np.diff([0.0, 50.0, 1.5 / 0.09, 58.0 / 0.4]).tolist()
    knots = [0.0, 0.01, 0.1]
    check(
        TABLE,
        sum(slope * moment(1.0, knot) for slope, knot in zip(slopes, knots, strict=True)),
        sum(
            slope * norm.sf(distance + knot / deviation)
            for slope, knot in zip(slopes, knots, strict=True)
        ),
    )


def test_two_stops_add_in_the_form_motion() -> None:
    """(B 8.50, 8.51)."""
    unknowns = [math.asinh(0.4), math.log(0.8), 0.2]
    law = Elastic(stiffness=9.0)
    both, low, high = (
        candidate_of(make_scene(law, lower, upper), "motion", unknowns)
        for lower, upper in ((-0.5, 1.2), (-0.5, None), (None, 1.2))
    )
    assert both.stop_force == pytest.approx(low.stop_force + high.stop_force, rel=1e-12)
    assert both.stiffness == pytest.approx(low.stiffness + high.stiffness, rel=1e-12)


@pytest.mark.parametrize("other", [None, Restitution(coefficient=0.7), TABLE])
def test_motion_stiffness_is_the_slope_of_the_mean_force(other: Law | None) -> None:
    """k = d m_F / d m at fixed deviations, also beside a rigid stop that cuts the law."""
    keys = {} if other is None else {"lower_law": other}
    scene = make_scene(Hertz(coefficient=20.0), None if other is None else -0.5, 1.2, **keys)
    deviation, step = 0.6, 1e-5

    def at(mean: float) -> Candidate:
        return candidate_of(
            scene, "motion", [math.asinh(mean / deviation), math.log(deviation), 0.1]
        )

    slope = (at(0.3 + step).stop_force - at(0.3 - step).stop_force) / (2.0 * step)
    # central differences: error of order (step / s)^2, and rounding / step
    assert at(0.3).stiffness == pytest.approx(slope, rel=10.0 * (step / deviation) ** 2 + 1e-9)


@pytest.mark.parametrize("form", ["motion", "force"])
def test_losses_of_the_book_are_half_those_of_rayleigh_speeds(form: str) -> None:
    """(B 8.54): beta = (1 - R^2) f / 2 per stop, f the rate of crossings (B 8.55)."""
    bumper = Viscoelastic(stiffness=30.0, damping_ratio=0.2)
    gap = Gap.of(model_of(make_scene(bumper, None, 0.7)))
    unknowns = np.array([0.0, math.log(0.8), math.log(1.1)][-3 if form == "motion" else -2 :])
    ours, book = (form_of(form, v, gap).candidate(gap, unknowns) for v in ("consistent", "book"))
    restitution = bumper.restitution
    assert book.damping == pytest.approx((1.0 - restitution**2) / 2.0 * book.upper.rate, rel=1e-12)
    assert ours.damping == pytest.approx(2.0 * book.damping, rel=1e-12)
    if form == "motion":
        rate = 1.1 / (2.0 * math.pi * 0.8) * math.exp(-0.5 * (0.7 / 0.8) ** 2)
        assert book.upper.rate == pytest.approx(rate, rel=1e-12)


# The inverse characteristics of the form "force" ----------------------------------------------


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.kind)
@pytest.mark.parametrize("lower", [None, -0.5])
def test_inverse_characteristic_by_brute_force(law: Law, lower: float | None) -> None:
    """E X(F), E X'(F) = E X(F) (F - E F) / s_F^2, and E Phi, by quadrature over the force."""
    hard = Restitution(coefficient=0.5)
    keys = {} if lower is None else {"lower_law": hard}
    gap = Gap.of(model_of(make_scene(law, lower, 0.6, load=0.2, **keys)))
    deviation = 1.3

    def force(x: float) -> float:
        return x + float(law.force_at(x - 0.6))  # type: ignore[union-attr]

    def position(push: float) -> float:
        if lower is not None and push <= lower:
            return lower
        return float(brentq(lambda x: force(x) - push, -20.0, 20.0, xtol=1e-14))

    kinks = [force(0.6 + y) for y in (0.0, 0.01, 0.1)] + ([] if lower is None else [lower])

    def mean_of(function: Any) -> float:
        return quad(
            lambda push: function(push) * norm.pdf(push, 0.2, deviation),
            0.2 - 9.0 * deviation,
            0.2 + 9.0 * deviation,
            points=sorted(kinks),
            epsabs=1e-11,
            epsrel=1e-11,
            limit=200,
        )[0]

    found = inverse(gap, deviation)
    mean = mean_of(position)
    slope = mean_of(lambda push: position(push) * (push - 0.2)) / deviation**2
    contact = mean_of(lambda push: push - position(push) if position(push) > 0.6 else 0.0)
    # a kink of the square-root kind, where a Hertz stop begins, is hard for the brute force
    assert found.mean == pytest.approx(mean, abs=1e-7)
    assert math.exp(found.log_compliance) == pytest.approx(slope, rel=1e-7)
    assert found.contacts[UPPER][0] == pytest.approx(norm.sf(0.6, 0.2, deviation), rel=1e-12)
    assert found.contacts[UPPER][1] == pytest.approx(contact, rel=1e-6)


def test_inverse_characteristics_of_the_book() -> None:
    """(B 7.77, 7.78) with springs so stiff that they stand for rigid stops: (B 8.83, 8.85)."""
    stiff = Elastic(stiffness=1e12)
    between = inverse(Gap.of(model_of(make_scene(stiff, -0.8, 0.8, load=0.1))), 0.9)
    inside = norm.cdf(0.8, 0.1, 0.9) - norm.cdf(-0.8, 0.1, 0.9)
    assert math.exp(between.log_compliance) == pytest.approx(inside, rel=1e-9)
    # (B 7.76): no spring, x = upper where F > 0 and lower where F < 0
    free = make_scene(stiff, -0.8, 0.8, stiffness=0.0, load=0.1)
    found = inverse(Gap.of(model_of(free)), 0.9)
    assert math.exp(found.log_compliance) == pytest.approx(1.6 * norm.pdf(0.0, 0.1, 0.9), rel=1e-9)
    assert found.mean == pytest.approx(0.8 * math.erf(0.1 / (0.9 * math.sqrt(2.0))), rel=1e-9)


# Coloured noise ---------------------------------------------------------------------------------


def test_response_to_filtered_noise_in_closed_form() -> None:
    """Against the Lyapunov equation of filter and oscillator."""
    rng = np.random.default_rng(6)
    for _ in range(20):
        omega, damping, own, rate, intensity = 10.0 ** rng.uniform(-1.0, 1.0, 5)
        generator = np.array(
            [
                [0.0, 1.0, 0.0, 0.0],
                [-(omega**2), -damping, 1.0, 0.0],
                [0.0, 0.0, 0.0, 1.0],
                [0.0, 0.0, -(own**2), -rate],
            ]
        )
        noise = np.diag([0.0, 0.0, 0.0, own**4 * intensity])
        covariance = stationary_covariance(generator, noise)
        found = Filter(own, rate, intensity).response_moments(omega, damping)
        assert found == pytest.approx((covariance[0, 0], covariance[1, 1]), rel=1e-9)


@pytest.mark.parametrize(("form", "variant"), WAYS[::3])
def test_broad_noise_is_white(form: str, variant: str) -> None:
    law = Viscoelastic(stiffness=40.0, damping_ratio=0.2)
    white = linearise(make_scene(law), form, variant)

    def error(noise: Excitation) -> float:
        coloured = linearise(make_scene(law, noise=(noise,)), form, variant)
        known = {name[1] for name, entry in coloured.estimates().items() if entry.bias is not None}
        assert known <= {PEAK}
        return max(
            abs(value(coloured, name) / value(white, name) - 1.0)
            for name in ("displacement_std", "velocity_std", "collision_rate")
        )

    def filtered(frequency: float) -> Excitation:
        return FilteredNoise(intensity=0.2, frequency_hz=frequency, zeta=0.5)

    # what filter and table leave out falls with their frequency
    far = error(filtered(1e4))
    assert far < 1e-4
    assert far < 0.2 * error(filtered(1e3)) + 1e-9
    table = TabulatedNoise(on="x", frequency_hz=[1e-5, 1e5], density=[0.4] * 2, unit="N2/Hz")
    assert error(table) < 1e-4


def test_stiff_stops_in_filtered_noise_tend_to_the_closure_of_assemblies() -> None:
    noise = (FilteredNoise(intensity=0.2, frequency_hz=0.3, zeta=0.3),)
    rigid = linearise(make_scene(Restitution(coefficient=1.0), noise=noise))

    def error(stiffness: float) -> float:
        soft = linearise(make_scene(Elastic(stiffness=stiffness), noise=noise))
        return value(soft, "displacement_std") / value(rigid, "displacement_std") - 1.0

    stiffest = error(1e10)
    assert abs(stiffest) < 1e-4
    assert stiffest == pytest.approx(error(1e8) / 10.0, rel=0.02)


# Units and symmetry -----------------------------------------------------------------------------


@pytest.mark.parametrize(("form", "variant"), WAYS)
def test_scales_exactly_to_si(form: str, variant: str) -> None:
    """Lengths in mm, 12 Hz and 2.5 kg: the same numbers in other units."""
    length, omega, mass = 1.7e-3, 2.0 * math.pi * 12.0, 2.5
    force = mass * length * omega**2
    pairs = [
        (
            Viscoelastic(stiffness=40.0, damping_ratio=0.2),
            Viscoelastic(stiffness=40.0 * force / length, damping_ratio=0.2),
        ),
        (Hertz(coefficient=40.0), Hertz(coefficient=40.0 * force / length**1.5)),
        (
            TABLE,
            ForceTable(
                deflection=[y * length for y in TABLE.deflection],
                force=[f * force for f in TABLE.force],
            ),
        ),
    ]
    rigid = Restitution(coefficient=0.8)
    ends = [(None, 0.8), (None, -1.0)]
    cases = [(*each, -0.5, 1.0) for each in (*pairs, (rigid, rigid))]
    for plain_law, scaled_law, lower, upper in (*cases, *((rigid, rigid, *each) for each in ends)):
        plain = linearise(make_scene(plain_law, lower, upper, load=0.1), form, variant)
        scene = make_scene(
            scaled_law,
            None if lower is None else lower * length,
            upper * length,
            damping=0.1 * omega * mass,
            stiffness=omega**2 * mass,
            mass=mass,
            noise=(WhiteNoise(intensity=0.2 * length**2 * omega**3 * mass**2),),
            load=0.1 * force,
        )
        scaled = linearise(scene, form, variant)
        factors = {
            "displacement_mean": length,
            "displacement_std": length,
            "velocity_std": length * omega,
            "upcrossing_rate": omega,
            "collision_rate": omega,
            "impact_speed_square_rate": length**2 * omega**3,
            "contact_probability": 1.0,
            "contact_force_upper": force,
        }
        for name in factors.keys() & {each for _, each in plain.estimates()}:
            expected = pytest.approx(factors[name] * value(plain, name), rel=1e-9)
            assert value(scaled, name) == expected, name


@pytest.mark.parametrize(("form", "variant"), WAYS)
def test_mirrored_scene_gives_mirrored_answer(form: str, variant: str) -> None:
    soft = Viscoelastic(stiffness=30.0, damping_ratio=0.1), Elastic(stiffness=80.0)
    hard = Restitution(coefficient=0.7), Restitution(coefficient=0.9)
    for law, other in (soft, hard):
        for upper, load in ((0.7, 0.0), (0.7, -0.3), (-0.8, 0.0), (1.3, 0.2)):
            lower, more = (-0.4, {"lower_law": other}) if upper == 1.3 else (None, {})
            given = {"load": load} | more
            first = linearise(make_scene(law, lower, upper, **given), form, variant)
            turned = {"load": -load} | ({"lower_law": law} if more else {})
            ends = (-upper, None if lower is None else -lower)
            second = linearise(make_scene(other if more else law, *ends, **turned), form, variant)
            same = pytest.approx(-value(first, "displacement_mean"), rel=1e-9)
            assert value(second, "displacement_mean") == same
            names = {"displacement_std", "collision_rate", "contact_probability"}
            for name in names & {each for _, each in first.estimates()}:
                assert value(second, name) == pytest.approx(value(first, name), rel=1e-9)
            for name in {"collision_rate"} | ({"contact_force"} if law in soft else set()):
                known = pytest.approx(value(first, f"{name}_upper"), rel=1e-9)
                assert value(second, f"{name}_lower") == known


def test_a_table_that_ends_in_a_plateau_does_not_hold_a_mass_without_a_spring() -> None:
    plateau = ForceTable(deflection=[0.1, 0.2], force=[1.0, 1.0])
    scene = make_scene(plateau, None, 0.0, stiffness=0.0, load=2.0)
    with pytest.raises(Exception, match="stiffness must be positive where stops do not hold"):
        linearise(scene)
