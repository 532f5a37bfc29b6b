"""Statistical linearisation in all forms: printed values, symmetries, extremes, what is said."""

from __future__ import annotations

import contextlib
import itertools
import math
import re
import warnings
from typing import Any

import numpy as np
import pytest
from scipy.integrate import quad

from stochvi import (
    ImpactPair,
    Isolator,
    Matrices,
    NotConverged,
    Oscillator,
    Restitution,
    TabulatedNoise,
    WhiteNoise,
    exact,
    simulate,
)
from stochvi.mathematics.spectra import response_moments
from stochvi.methods.fokker_planck import fokker_planck
from stochvi.methods.linearisation import (
    LinearisedOscillator,
    linearise,
    linearise_all,
    linearised_oscillators,
)
from stochvi.methods.linearisation.forms import form_of
from stochvi.model.build_response import residuals
from stochvi.model.gap import Gap
from stochvi.model.model import model_of
from stochvi.results.errors import NotApplicable
from stochvi.results.estimates import Estimate
from stochvi.scenes import BoucWen, FilteredNoise, VanDerPol
from stochvi.scenes.excitations import Excitation
from stochvi.scenes.impact_laws import Elastic, Law
from stochvi.scenes.scene import Scene
from support.accuracies import quick_cases
from support.linearised import WAYS, make_scene, random_scene, summary, value


@pytest.mark.parametrize(
    ("form", "variant", "restitution", "printed"),
    [
        ("motion", "book", 1.0, (0.8347, 1.0000, 0.2419)),
        ("motion", "book", 0.8, (0.7120, 0.7980, 0.1584)),
        ("motion", "book", 0.5, (0.6639, 0.7155, 0.1271)),
        ("force", "book", 1.0, (0.7320, 1.0000, 0.3326)),
        ("force", "book", 0.8, (0.6863, 0.8360, 0.2394)),
        ("force", "book", 0.5, (0.6555, 0.7606, 0.1943)),
        ("force", "consistent", 1.0, (0.7320, 1.0000, 0.3326)),
        ("force", "consistent", 0.8, (0.6575, 0.7649, 0.1970)),
        ("force", "consistent", 0.5, (0.6179, 0.6864, 0.1497)),
        ("closure", "consistent", 1.0, (0.5396, 1.0000, 0.2828)),
        ("closure", "consistent", 0.8, (0.5231, 0.7738, 0.1862)),
        ("closure", "consistent", 0.5, (0.5169, 0.6814, 0.1539)),
    ],
)
def test_reproduces_printed_values(
    form: str, variant: str, restitution: float, printed: tuple[float, float, float]
) -> None:
    response = linearise(make_scene(restitution=restitution), form, variant)
    assert tuple(round(number, 4) for number in summary(response)) == printed


@pytest.mark.parametrize(("form", "variant"), WAYS)
def test_a_far_stop_is_no_stop(form: str, variant: str) -> None:
    one = linearise(make_scene(None, 0.5), form, variant)
    two = linearise(make_scene(-50.0, 0.5), form, variant)
    for name in ("displacement_mean", "displacement_std", "velocity_std", "collision_rate"):
        assert value(two, name) == pytest.approx(value(one, name), rel=1e-9), name


@pytest.mark.parametrize(("form", "variant"), WAYS)
def test_without_stops_the_answer_is_the_linear_one(form: str, variant: str) -> None:
    response = linearise(make_scene(None, None, stiffness=2.0, load=0.6), form, variant)
    assert value(response, "displacement_mean") == pytest.approx(0.3, rel=1e-14)
    assert value(response, "displacement_std") == pytest.approx(math.sqrt(0.5), rel=1e-14)
    assert value(response, "velocity_std") == pytest.approx(1.0, rel=1e-14)
    assert value(response, "upcrossing_rate") == pytest.approx(
        math.sqrt(2.0) / (2.0 * math.pi), rel=1e-14
    )
    assert all(entry.bias == 0.0 for entry in response.estimates().values())


@pytest.mark.parametrize(
    ("form", "variant", "count"),
    [(*way, 80) for way in WAYS[:1]] + [(*way, 40) for way in WAYS[1:]],
)
def test_random_sweep_ends_in_finite_answers(form: str, variant: str, count: int) -> None:
    """Gaps of .001 to 1000 deviations, preload to 3, any R, also without damping.

    An `Estimate` refuses what is not finite.
    """
    rng = np.random.default_rng(4)
    for _ in range(count):
        scene, deviation = random_scene(rng)
        response = linearise(scene, form, variant)
        assert value(response, "displacement_std") > 0.0
        assert value(response, "velocity_std") > 0.0
        model = model_of(scene)
        if form == "closure":
            mean, slack = value(response, "displacement_mean"), 1e-9 * deviation
            assert mean > model.lower_position - slack
            assert mean < model.upper_position + slack


@pytest.mark.parametrize(("form", "variant"), WAYS)
def test_response_names_method_and_assumptions(form: str, variant: str) -> None:
    response = linearise(make_scene(), form, variant)
    assert response.method == f"linearise:{form}" + (":book" if variant == "book" else "")
    # of a pair that the atlas knows
    assert response.estimates()["x", "velocity_std"].bias
    assert any("Gaussian" in sentence for sentence in response.assumptions)
    response.to_dict()


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("spline",), "form must be one of closure, motion, force, clumps, got 'spline'"),
        (("force", "best"), "variant must be one of consistent, book, box, got 'best'"),
        (
            ("closure", "book"),
            "variant must be 'consistent' or 'box' for form 'closure', which is not in the book; "
            "'book' is of the forms 'motion' and 'force'",
        ),
    ],
)
def test_unknown_words_are_refused(words: tuple[str, ...], sentence: str) -> None:
    with pytest.raises(ValueError, match=f"^{re.escape(sentence)}$"):
        linearise(make_scene(), *words)


@pytest.mark.parametrize(
    ("scene", "form", "conditions"),
    [
        (
            make_scene(intensity=None, load=0.5, damping=0.0, restitution=1.0),
            "closure",
            (
                "excitation must contain noise, got a constant load alone",
                "damping must be positive where no stop takes energy, got 0",
            ),
        ),
        (
            make_scene(None, 1.0, stiffness=0.0),
            "closure",
            ("stiffness must be positive where stops do not hold the mass, got 0",),
        ),
        (
            make_scene(stiffness=0.0),
            "motion",
            ("stiffness must be positive for form 'motion', got 0",),
        ),
        (
            make_scene(None, 1.0, stiffness=0.0, load=0.5),
            "force",
            ("stiffness must be positive for form 'force' with one stop, got 0",),
        ),
    ],
)
def test_unmet_conditions_are_listed(scene: Scene, form: str, conditions: tuple[str, ...]) -> None:
    with pytest.raises(NotApplicable) as caught:
        linearise(scene, form)
    assert caught.value.conditions == conditions


# ------------------------------------------------------------------------------
# The forms of the book, motion and force: printed values, slopes, limits.
# ------------------------------------------------------------------------------


@pytest.mark.parametrize(("restitution", "printed"), [(1.0, 0.7101), (0.8, 0.6440), (0.5, 0.6177)])
def test_reproduces_printed_deviation_of_consistent_motion(
    restitution: float, printed: float
) -> None:
    response = linearise(make_scene(restitution=restitution), "motion")
    assert round(value(response, "displacement_std"), 4) == printed


@pytest.mark.parametrize("form", ["motion", "force"])
def test_dominant_frequency_of_the_book(form: str) -> None:
    """(B 13.20): s_v / (s_x erf(D / (s_x sqrt 2))); (B 13.32): sqrt(k), where s_v = sqrt(k) s_x."""
    response = linearise(make_scene(), form, "book")
    s_x, s_v, _ = summary(response)
    omega = s_v / s_x
    if form == "motion":
        omega /= math.erf(1.0 / (s_x * math.sqrt(2.0)))
    assert 2.0 * math.pi * value(response, "upcrossing_rate") == pytest.approx(omega, rel=1e-12)


def test_strong_noise_takes_the_force_form_to_its_own_limit() -> None:
    response = linearise(make_scene(restitution=1.0, intensity=1e8), "force")
    # s_x -> D sqrt(2 / pi), with a correction of order D omega / s_v
    limit = math.sqrt(2.0 / math.pi)
    assert value(response, "displacement_std") == pytest.approx(limit, rel=1.0 / math.sqrt(1e8))


@pytest.mark.parametrize("variant", ["consistent", "book"])
def test_motion_stiffness_is_the_slope_of_the_mean_force(variant: str) -> None:
    """k = d m_F / d m at fixed deviations."""
    gap = Gap.of(model_of(make_scene(-0.5, 1.2, restitution=0.6, restitution_lower=0.9)))
    form = form_of("motion", variant, gap)
    step = 1e-5
    for mean, log_deviation, log_speed in [(0.0, 0.0, 0.0), (0.4, -1.0, 0.3), (2.0, -0.5, -1.0)]:
        ahead, here, behind = (
            form.candidate(
                gap,
                np.array(
                    [
                        math.asinh((mean + shift) / math.exp(log_deviation)),
                        log_deviation,
                        log_speed,
                    ]
                ),
            )
            for shift in (step, 0.0, -step)
        )
        slope = (ahead.stop_force - behind.stop_force) / (2.0 * step)
        # central differences: error of order (step / s_x)^2, and rounding / step
        tolerance = (step / math.exp(log_deviation)) ** 2 + 1e-15 / step
        assert here.stiffness == pytest.approx(slope, rel=10.0 * tolerance)


def test_force_stiffness_is_the_slope_of_the_inverse_characteristic() -> None:
    """1 / k = E dx/dF, and E x, by adaptive quadrature over the Gaussian force."""
    gap = Gap.of(model_of(make_scene(-0.5, 1.2, load=0.3, stiffness=1.7)))
    form, deviation = form_of("force", "consistent", gap), 1.4
    candidate = form.candidate(gap, np.array([math.log(deviation), 0.0]))
    low, high = -0.5 * 1.7, 1.2 * 1.7

    def density(force: float) -> float:
        z = (force - gap.load) / deviation
        return math.exp(-0.5 * z * z) / (deviation * math.sqrt(2.0 * math.pi))

    inside = quad(density, low, high, epsabs=0.0, epsrel=1e-13)[0]
    mean = quad(
        lambda force: min(max(force, low), high) / 1.7 * density(force),
        -15.0,
        15.0,
        points=[low, high],
        epsrel=1e-13,
    )[0]
    assert candidate.stiffness + 1.7 == pytest.approx(1.7 / inside, rel=1e-12)
    assert candidate.mean == pytest.approx(mean, rel=1e-11)


def test_motion_says_when_its_mean_lies_beyond_a_stop() -> None:
    response = linearise(make_scene(None, -2.0), "motion")
    assert value(response, "displacement_mean") > -2.0
    assert response.warnings == ["the mean that this form gives lies beyond the upper stop"]


@pytest.mark.parametrize("variant", ["consistent", "book"])
def test_motion_in_narrow_gaps_far_from_rest(variant: str) -> None:
    """E v^2 obeys the balance of energy with p = 1 / (upper - lower) at either stop."""
    rng = np.random.default_rng(9)
    for _ in range(30):
        gap, restitution = 10.0 ** rng.uniform(-6.0, -2.0), float(rng.uniform())
        place = float(rng.choice([0.0, -1.0, 1.0])) * 10.0 ** rng.uniform(-1.0, 1.0)
        scene = make_scene(place - gap, place, restitution=restitution)
        square = value(linearise(scene, "motion", variant), "velocity_mean_square")
        lost = 2.0 * (1.0 - restitution**2) * square**1.5 / (gap * math.sqrt(2.0 * math.pi))
        # the law is not quite even: by the square of the force of the spring over s_v^2
        uneven = (gap * (abs(place) + 1.0) / square) ** 2
        assert 0.1 * square + lost == pytest.approx(0.1, rel=uneven + 1e-8)


@pytest.mark.parametrize("variant", ["consistent", "book"])
def test_motion_deep_within_a_stop(variant: str) -> None:
    """Preloads of 3 to 30 deviations. As they grow the balances become E v^2 p = omega^2 d, and so
    (1 - R^2) omega^2 d s_v = S0 sqrt(pi / 2) in s_v where impacts take nearly all energy."""
    rng = np.random.default_rng(8)
    for _ in range(30):
        preload = 10.0 ** rng.uniform(0.5, 1.5)
        restitution = float(rng.choice([0.0, rng.uniform()]))
        damping = 10.0 ** rng.uniform(-3.0, 0.0)
        scene = make_scene(
            None, -preload, restitution=restitution, damping=damping, intensity=2.0 * damping
        )
        speed = value(linearise(scene, "motion", variant), "velocity_std")
        lost = (1.0 - restitution**2) * preload
        # damping takes b s_v^2 besides
        own = damping * speed / (lost / math.sqrt(2.0 * math.pi) + damping * speed)
        expected = 2.0 * damping * math.sqrt(math.pi / 2.0) / lost * (1.0 - own)
        # the truncated distribution is exponential but for 1 / u^2, u = d (1 - A) / s_x from its
        # stop to m
        factor = (1.0 + restitution**2) / 4.0 if variant == "book" else (1.0 + restitution) / 2.0
        rest = (speed / preload) ** 2 / (1.0 - factor)
        assert speed == pytest.approx(expected, rel=2.0 * rest + 1e-9)


def test_force_of_the_book_has_no_law_of_impact_speeds() -> None:
    response = linearise(make_scene(), "force", "book")
    pair = response.impact_pairs["stops"]
    assert pair["impact_speed_rate"] is None and pair["impact_speed_mean"] is None
    expected = value(response, "collision_rate") * value(response, "velocity_mean_square")
    assert value(response, "impact_speed_square_rate") == pytest.approx(expected, rel=1e-12)


# ------------------------------------------------------------------------------
# The closure between rigid stops: exact densities, balances, preload, the variant of a box.
# ------------------------------------------------------------------------------


def gibbs_moments(scene: Scene) -> dict[str, float]:
    """Moments and rates from exp(-U / theta) by adaptive quadrature."""
    model = model_of(scene)
    theta = model.intensity / (2.0 * model.damping_rate)
    spread = math.sqrt(theta) / model.omega
    rest = model.rest
    low = model.lower_position
    high = model.upper_position
    nearest = min(max(rest, low), high)

    def log_density(x: float) -> float:
        return -(x - nearest) * (x + nearest - 2.0 * rest) / (2.0 * spread**2)

    # e^-50 of the largest density is as good as nothing
    steep = abs(nearest - rest) / spread
    reach = spread * 100.0 / (steep + math.hypot(steep, 10.0))
    start, end = max(low, nearest - reach), min(high, nearest + reach)

    def integral(power: int, about: float) -> float:
        options = {"epsabs": 0.0, "epsrel": 1e-12, "limit": 200}
        pieces = np.unique(
            np.linspace(start, nearest, 6).tolist() + np.linspace(nearest, end, 6).tolist()
        )
        return sum(
            quad(lambda x: (x - about) ** power * math.exp(log_density(x)), a, b, **options)[0]
            for a, b in itertools.pairwise(pieces.tolist())
        )

    mass = integral(0, 0.0)
    shift = integral(1, nearest) / mass
    rates = [
        0.0
        if stop is None
        else math.exp(log_density(stop.position)) / mass * math.sqrt(theta / (2.0 * math.pi))
        for stop in (model.lower, model.upper)
    ]
    return {
        "displacement_mean": nearest + shift,
        "displacement_std": math.sqrt(integral(2, nearest + shift) / mass),
        "velocity_std": math.sqrt(theta),
        **({} if model.lower is None else {"collision_rate_lower": rates[0]}),
        **({} if model.upper is None else {"collision_rate_upper": rates[1]}),
        "impact_speed_rate": sum(rates) * math.sqrt(math.pi * theta / 2.0),
        "impact_speed_square_rate": sum(rates) * 2.0 * theta,
    }


def test_reproduces_printed_asymmetric_closure() -> None:
    response = linearise(make_scene(-0.5, 1.0))
    names = ("displacement_mean", "displacement_mean_square", "velocity_mean_square")
    found = tuple(round(value(response, name), 5) for name in names)
    assert found == (0.16604, 0.19004, 0.49047)


def test_closure_is_nearer_to_the_truth_than_the_book() -> None:
    # near-exact values for R = .8: deviations and rate of impacts
    truth = (0.53209075, 0.78288187, 0.193109)
    errors = {
        way: max(
            abs(found / true - 1.0)
            for found, true in zip(summary(linearise(make_scene(), *way)), truth, strict=True)
        )
        for way in WAYS
    }
    assert min(errors, key=lambda way: errors[way]) == ("closure", "consistent")


def test_closure_is_exact_for_elastic_stops() -> None:
    rng = np.random.default_rng(1)
    for _ in range(50):
        scene, _ = random_scene(rng, elastic=True)
        response = linearise(scene)
        truth = gibbs_moments(scene)
        deviation = truth["displacement_std"]
        for name, expected in truth.items():
            # a mean may vanish by symmetry, a rate far out in the tail
            scale = deviation if name == "displacement_mean" else 0.0
            floor = 1e-9 * scale + 1e-30 * truth["velocity_std"] / deviation
            assert value(response, name) == pytest.approx(expected, rel=1e-9, abs=floor), name
        # a rate that is too small for a float is 0 within a bound
        assert all(
            entry.bias == 0.0 or entry.value == 0.0 < entry.bias < 1e-15
            for entry in response.estimates().values()
        )


def test_square_of_restitution_would_be_seen() -> None:
    """Negative control: R^2 put for R moves the answer far beyond every tolerance here."""
    right, wrong = linearise(make_scene(restitution=0.8)), linearise(make_scene(restitution=0.64))
    assert abs(value(right, "velocity_std") / value(wrong, "velocity_std") - 1.0) > 0.03


def test_closure_obeys_the_balances() -> None:
    rng = np.random.default_rng(2)
    for _ in range(50):
        scene, _ = random_scene(rng)
        found = linearise(scene).identities
        assert set(found) == {"energy", "virial", "force"}
        for name, residual in found.items():
            assert abs(residual.value) < 1e-9, (name, scene)


def test_balances_see_a_wrong_restitution() -> None:
    """Negative control: the answer for R does not balance as one for R^2."""
    response, wrong = linearise(make_scene(restitution=0.8)), make_scene(restitution=0.64)
    half = {name: value(response, f"impact_speed_{name}rate") / 2.0 for name in ("", "square_")}
    moments = {
        ("x", "x"): value(response, "displacement_mean"),
        ("x", "variance"): value(response, "displacement_std") ** 2,
        ("x", "vv"): value(response, "velocity_mean_square"),
    }
    for side in ("lower", "upper"):
        moments["stops", f"f1_{side}"] = half[""]
        moments["stops", f"f2_{side}"] = half["square_"]
    found = residuals(model_of(wrong), moments, (0.0,))
    assert abs(found["energy"]) > 0.01
    assert abs(found["virial"]) > 0.01


def test_deep_preload_joins_on_where_the_family_ends() -> None:
    """No jump where the law turns exponential: half the step in position, half in the answer."""

    def largest_step(count: int) -> float:
        positions = np.linspace(-0.5, -0.3, count + 1)
        found = [linearise(make_scene(None, float(c), restitution=0.5)) for c in positions]
        assert {bool(response.warnings) for response in found} == {False, True}
        return float(np.abs(np.diff([value(one, "displacement_std") for one in found])).max())

    assert largest_step(60) == pytest.approx(largest_step(30) / 2.0, rel=0.05)


def test_deep_preload_between_two_stops_tends_to_one_stop() -> None:
    """What the limit of kappa bends the law between stops 2 D apart falls as 1 / D^2."""
    one = linearise(make_scene(None, -0.9, restitution=0.5))

    def error(gap: float) -> float:
        two = linearise(make_scene(-gap, -0.9, restitution=0.5))
        return value(two, "displacement_std") / value(one, "displacement_std") - 1.0

    assert one.warnings
    assert error(1000.0) == pytest.approx(error(100.0) / 100.0, rel=0.05)


def test_free_mass_in_a_box() -> None:
    """No spring: between elastic stops x is uniform, (B 13.38) with U = 0."""
    response = linearise(make_scene(-1.0, 1.0, stiffness=0.0, restitution=1.0))
    assert value(response, "displacement_std") == pytest.approx(1.0 / math.sqrt(3.0), rel=1e-12)
    assert value(response, "collision_rate") == pytest.approx(1.0 / math.sqrt(2.0 * math.pi))
    assert summary(linearise(make_scene(-1.0, 1.0, stiffness=0.0), "force"))[2] > 0.0


def test_ball_on_a_table() -> None:
    """No spring, one stop, pressed on by a load: for R = 1 the height is exponential."""
    elastic = linearise(make_scene(None, 0.0, stiffness=0.0, restitution=1.0, load=2.0))
    assert value(elastic, "displacement_mean") == pytest.approx(-0.5, rel=1e-9)
    assert value(elastic, "displacement_std") == pytest.approx(0.5, rel=1e-9)
    inelastic = linearise(make_scene(None, 0.0, stiffness=0.0, restitution=0.7, load=2.0))
    # E v^2 = g E y, from the virial with stop and origin in one place
    assert value(inelastic, "velocity_mean_square") == pytest.approx(
        -2.0 * value(inelastic, "displacement_mean"), rel=1e-9
    )
    assert "lies closer to a stop" in inelastic.warnings[0]


def test_box_constants_solve_the_fokker_planck_equation_of_a_box() -> None:
    """s_x and s_v of a free mass in a box, between and at the tabulated restitutions."""
    for restitution in (0.0, 0.5, 0.75):
        scene = make_scene(stiffness=0.0, damping=0.0, restitution=restitution, intensity=1.0)
        truth = fokker_planck(scene, rtol=1e-3)
        found, plain = linearise(scene, variant="box"), linearise(scene)
        for name in ("displacement_std", "velocity_std", "impact_speed_rate"):
            # four digits of the table, and what interpolation leaves
            assert value(found, name) == pytest.approx(value(truth, name), rel=2e-3), name
            assert abs(value(plain, name) / value(truth, name) - 1.0) > 2e-3, name


def test_box_is_exact_for_elastic_stops() -> None:
    for lower, upper in [(-1.0, 1.0), (-0.2, 1.5)]:
        scene = make_scene(lower, upper, restitution=1.0, load=0.3)
        one, two = linearise(scene, variant="box"), linearise(scene)
        assert summary(one) == pytest.approx(summary(two), rel=1e-12)


@pytest.mark.parametrize(("damping", "restitution"), [(0.1, 0.5), (1.0, 0.2)])
def test_box_is_nearer_to_the_truth_than_the_plain_closure(
    damping: float, restitution: float
) -> None:
    """And within what is asked of it: 6 % between half a deviation and a whole one."""
    names = ("displacement_std", "velocity_std", "impact_speed_rate")
    errors: dict[str, list[float]] = {"box": [], "consistent": []}
    for gap in (0.2, 1.0):
        scene = make_scene(
            -gap, gap, restitution=restitution, damping=damping, intensity=2.0 * damping
        )
        truth = fokker_planck(scene, rtol=1e-3)
        for variant, found in errors.items():
            answer = linearise(scene, variant=variant)
            found += [abs(value(answer, name) / value(truth, name) - 1.0) for name in names]
            assert max(abs(one.value) for one in answer.identities.values()) < 1e-9
    assert max(errors["box"]) < 0.06
    assert np.mean(errors["box"]) < np.mean(errors["consistent"])


def test_box_needs_two_rigid_stops() -> None:
    with pytest.raises(NotApplicable, match="variant 'box' needs stops on both sides, got one"):
        linearise(make_scene(None, 1.0), variant="box")
    with pytest.raises(ValueError, match="for form 'force', got 'box'"):
        linearise(make_scene(), "force", "box")


# ------------------------------------------------------------------------------
# Linearised springs and dampers that are functions: closed forms, sampling, other methods.
# ------------------------------------------------------------------------------


ROPE = {"kind": "bouc-wen", "stiffness": 2.0, "yield_displacement": 0.3}
RIGID = [ImpactPair(lower=-1.0, upper=1.0, law=Restitution(coefficient=1.0))]


def scene_of(pairs: Any = (), excitation: Any = None, **keys: Any) -> Scene:
    """A mass of 2 kg with a spring of 1 N/m and a damper of 0.2 N s/m in noise of 0.4 N^2 s."""
    return Scene(
        structure=Oscillator(**{"mass": 2.0, "damping": 0.2, "stiffness": 1.0} | keys),
        impact_pairs=list(pairs),
        excitations=excitation or [WhiteNoise(intensity=0.4)],
    )


def values(scene: Scene) -> tuple[float, float]:
    found = linearise(scene).coordinates["x"]
    return found["displacement_std"].value, found["velocity_std"].value


@pytest.mark.parametrize(("linear", "intensity"), [(0.0, 0.4), (-2.0, 0.4), (-2.0, 0.04)])
def test_a_cubic_spring_has_the_known_equation(linear: float, intensity: float) -> None:
    """k s^2 + 3 k3 s^4 = theta, with theta = S / (2 c) (B 8), between two wells as well."""
    theta, k = intensity / 0.4, 1.0 + linear
    wanted = math.sqrt((-k + math.sqrt(k**2 + 12.0 * 2.0 * theta)) / (2.0 * 3.0 * 2.0))
    spring = {"kind": "duffing", "cubic_stiffness": 2.0, "linear_stiffness": linear}
    found, speed = values(scene_of(excitation=[WhiteNoise(intensity=intensity)], spring=spring))
    assert found == pytest.approx(wanted, rel=1e-8)
    assert speed == pytest.approx(math.sqrt(theta / 2.0), rel=1e-12)


def test_dry_friction_has_the_known_equation() -> None:
    """sqrt(2 / pi) F s_v = S / (2 m): the power of friction is that of the noise."""
    _, speed = values(scene_of(damping=0.0, damper={"kind": "coulomb", "force": 0.2}))
    assert speed == pytest.approx(0.1 / (math.sqrt(2.0 / math.pi) * 0.2), rel=1e-8)


def test_a_straight_line_is_linear() -> None:
    line = {"kind": "table", "deflection": [-1.0, 1.0], "force": [-0.6, 0.6]}
    for excitation in (None, [FilteredNoise(intensity=0.4, frequency_hz=0.1, zeta=0.2)]):
        wanted = values(scene_of(excitation=excitation))
        found = values(scene_of(excitation=excitation, stiffness=0.4, spring=line))
        assert found == pytest.approx(wanted, rel=1e-9)


def test_a_table_of_noise_shakes_a_function() -> None:
    """A wide band is white noise of half its one-sided density."""
    band = [TabulatedNoise(frequency_hz=[1e-3, 50.0], density=[0.8, 0.8], unit="N2/Hz", on="x")]
    spring = {"kind": "duffing", "cubic_stiffness": 2.0}
    wanted = values(scene_of(spring=spring))
    assert values(scene_of(excitation=band, spring=spring)) == pytest.approx(wanted, rel=0.01)


def test_a_hardening_spring_between_stops_is_near_the_truth() -> None:
    scene = scene_of(RIGID, spring={"kind": "duffing", "cubic_stiffness": 2.0})
    found, known = linearise(scene), exact(scene)
    for name in ("displacement_std", "velocity_std"):
        wanted = known.coordinates["x"][name].value
        assert found.coordinates["x"][name].value == pytest.approx(wanted, rel=0.06)
        assert found.coordinates["x"][name].bias is None
    # without the spring the closure is exact, and elsewhere
    assert values(scene_of(RIGID))[0] > 1.05 * found.coordinates["x"]["displacement_std"].value


@pytest.mark.parametrize(("exponent", "beta"), [(1.0, 0.5), (2.0, 0.8), (1.7, 1.0)])
def test_the_coefficients_of_wen_are_those_of_a_quadrature(exponent: float, beta: float) -> None:
    """E dh/dv and E dh/dz of h = v - beta abs(v) z abs(z)^(n-1) - gamma v abs(z)^n."""
    rope = BoucWen(stiffness=2.0, yield_displacement=0.3, exponent=exponent, beta=beta)
    speed, deviation, correlation = 0.4, 0.5, 0.6
    u, w = np.random.default_rng(2).standard_normal((2, 1_000_000))
    v = speed / 0.3 * u
    z = deviation * (correlation * u + math.sqrt(1.0 - correlation**2) * w)
    size = np.abs(z)
    with_v = 1.0 - beta * np.sign(v) * np.sign(z) * size**exponent - (1.0 - beta) * size**exponent
    with_z = (
        -exponent * size ** (exponent - 1.0) * (beta * np.abs(v) + (1.0 - beta) * v * np.sign(z))
    )
    found = rope.wen_coefficients(speed, deviation, correlation)
    for one, samples in zip(found, (with_v / 0.3, with_z), strict=True):
        assert abs(one - samples.mean()) <= 4.5 * samples.std() / 1000.0


def test_wire_rope_is_near_the_simulation() -> None:
    mount = Isolator(mass=2.0, damping=0.2, stiffness=1.0, spring=ROPE)
    scene = Scene(structure=mount, excitations=[WhiteNoise(intensity=0.1)])
    found, known = linearise(scene), simulate(scene, paths=256, duration=100.0, seed=1)
    for name in ("displacement_std", "velocity_std", "acceleration_std"):
        wanted = known.coordinates["x"][name].value
        assert found.coordinates["x"][name].value == pytest.approx(wanted, rel=0.08), name


def test_wire_rope_of_several_coordinates_is_that_of_one() -> None:
    """A frame that hardly moves, and a rope that hardly slips, which is a spring."""
    frame = Matrices(
        coordinates=["x", "frame"],
        mass=[[2.0, 0.0], [0.0, 1e7]],
        damping=[[0.2, -0.2], [-0.2, 1e6]],
        stiffness=[[1.0, -1.0], [-1.0, 1e6]],
        spring=ROPE | {"between": ["x", "frame"]},
    )
    scene = Scene(structure=frame, excitations=[WhiteNoise(intensity=0.4, on="x")])
    found = linearise(scene).coordinates["x"]["displacement_std"].value
    assert found == pytest.approx(values(scene_of(spring=ROPE))[0], rel=1e-4)
    stiff = scene_of(stiffness=0.4, spring=ROPE | {"stiffness": 0.6, "yield_displacement": 1e5})
    assert values(stiff)[0] == pytest.approx(values(scene_of())[0], rel=1e-3)


def test_what_hysteresis_does_not_take_is_named() -> None:
    with pytest.raises(NotApplicable, match="impact_pair must be left out where a spring has"):
        linearise(scene_of(RIGID, spring=ROPE))
    band = [TabulatedNoise(frequency_hz=[0.1, 1.0], density=[0.8, 0.8], unit="N2/Hz", on="x")]
    with pytest.raises(NotApplicable, match="excitation must be white, filtered or constant"):
        linearise(scene_of(excitation=band, spring=ROPE))
    with pytest.raises(NotApplicable, match=r"structure\.spring must be linear"):
        linearise(scene_of(spring=ROPE), form="force")


def test_a_search_that_ends_nowhere_gives_no_warnings() -> None:
    """A self-excited mass at a wall, from starts that describe no response."""
    scene = Scene(
        structure=Oscillator(
            mass=1.0, damping=0.0, stiffness=1.0, damper=VanDerPol(damping=0.1, amplitude=0.5)
        ),
        impact_pairs=[ImpactPair(upper=1.0, law=Restitution(coefficient=0.8))],
        excitations=[WhiteNoise(intensity=0.05)],
    )
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with contextlib.suppress(NotConverged, NotApplicable):
            linearise(scene)


# ------------------------------------------------------------------------------
# The linearised oscillator: its spectra, its frequencies, and scenes with several solutions.
# ------------------------------------------------------------------------------


def area(found: LinearisedOscillator, name: str, edges: list[float]) -> float:
    """Integral of a density over all frequencies, by adaptive quadrature."""
    density = getattr(found, name)
    resonance = found.resonance_hz
    points = sorted({0.0, resonance, 0.5 * resonance, 2.0 * resonance, *edges})
    pieces = [
        quad(lambda f: float(density(f)), low, high, epsabs=0.0, epsrel=1e-10, limit=200)[0]
        for low, high in zip(points, [*points[1:], math.inf], strict=True)
    ]
    return float(sum(pieces))


def boxed(noise: tuple[Excitation, ...], law: Law, gap: float = 1.0) -> Scene:
    return Scene(
        structure=Oscillator(mass=2.0, damping=0.2, stiffness=2.0),
        impact_pairs=[ImpactPair(lower=-gap, upper=gap, law=law)],
        excitations=noise,
    )


@pytest.mark.parametrize("form", ["closure", "motion", "force"])
def test_areas_under_the_densities_are_the_mean_squares(form: str) -> None:
    noise = (
        WhiteNoise(intensity=0.3),
        TabulatedNoise(on="x", frequency_hz=[0.1, 0.3, 2.0], density=[0.2, 0.9, 0.1], unit="N2/Hz"),
        FilteredNoise(intensity=0.4, frequency_hz=0.2, zeta=0.3),
    )
    (found,) = linearised_oscillators(boxed(noise, Elastic(stiffness=30.0)), form)
    displacement = area(found, "displacement_density", [0.1, 0.3, 2.0])
    velocity = area(found, "velocity_density", [0.1, 0.3, 2.0])
    assert displacement == pytest.approx(found.displacement_std**2, rel=1e-8)
    assert velocity == pytest.approx(found.velocity_std**2, rel=1e-8)


def test_absolute_acceleration_of_an_isolator() -> None:
    """Base noise: a = -(omega^2 + k) x - (b + beta) x', and x and x' are uncorrelated."""
    noise = TabulatedNoise(on="base", profile="mil-std-810h-truck-vertical-5hz")
    scene = Scene(
        structure=Isolator(frequency_hz=12.0, zeta=0.1),
        impact_pairs=[ImpactPair(lower=-3e-3, upper=3e-3, law=Restitution(coefficient=0.7))],
        excitations=[noise],
    )
    (found,) = linearised_oscillators(scene)
    edges = noise.table.frequency_hz.tolist()
    expected = (found.total_stiffness * found.displacement_std) ** 2
    expected += (found.total_damping * found.velocity_std) ** 2
    assert area(found, "acceleration_density", edges) == pytest.approx(expected, rel=1e-8)
    # a force on the mass moves it absolutely as much as relatively
    (pushed,) = linearised_oscillators(
        boxed((WhiteNoise(intensity=0.3),), Restitution(coefficient=0.7))
    )
    f = np.array([0.05, 0.2, 3.0])
    ratio = pushed.acceleration_density(f) / pushed.velocity_density(f)
    assert ratio == pytest.approx((2.0 * np.pi * f) ** 2, rel=1e-12)


@pytest.mark.parametrize("form", ["closure", "motion", "force"])
def test_dominant_frequency_is_the_rate_of_upcrossings(form: str) -> None:
    scene = boxed((WhiteNoise(intensity=0.8),), Restitution(coefficient=0.7))
    (found,) = linearised_oscillators(scene, form)
    rate = linearise(scene, form).coordinates["x"]["upcrossing_rate"]
    assert isinstance(rate, Estimate)
    assert found.dominant_frequency_hz == pytest.approx(rate.value, rel=1e-12)
    # white noise: the density of x is largest where that of a light oscillator has its peak
    peak = found.resonance_hz * math.sqrt(1.0 - 2.0 * found.damping_ratio**2)
    assert found.spectral_peak_hz() == pytest.approx(peak, rel=1e-6)


def test_every_solution_is_its_own_linearisation() -> None:
    """A resonance below the band: at rest there, or held within it by the stops."""
    band = TabulatedNoise(on="x", frequency_hz=[0.5, 5.0], density=[0.4, 0.4], unit="N2/Hz")
    scene = Scene(
        structure=Oscillator(mass=1.0, damping=0.02, stiffness=1.0),
        impact_pairs=[ImpactPair(lower=-0.2, upper=0.2, law=Restitution(coefficient=0.9))],
        excitations=[band],
    )
    responses, found = linearise_all(scene), linearised_oscillators(scene)
    assert len(responses) == len(found) == 3
    for one in found:
        moments = response_moments(
            model_of(scene).acceleration_tables, math.sqrt(one.total_stiffness), one.total_damping
        )
        assert moments.displacement == pytest.approx(one.displacement_std**2, rel=1e-8)
        assert moments.velocity == pytest.approx(one.velocity_std**2, rel=1e-8)
    for response in responses:
        assert any("this form has 3 solutions" in warning for warning in response.warnings)
    free = response_moments(model_of(scene).acceleration_tables, 1.0, 0.02)
    assert found[0].displacement_std == pytest.approx(math.sqrt(free.displacement), rel=1e-2)
    assert linearise(scene).to_dict()["coordinates"] == responses[0].to_dict()["coordinates"]


def test_white_noise_has_one_solution() -> None:
    for restitution in (0.0, 0.5, 1.0):
        scene = boxed((WhiteNoise(intensity=0.3),), Restitution(coefficient=restitution), 0.3)
        (response,) = linearise_all(scene)
        assert not any("solutions" in warning for warning in response.warnings)


# ------------------------------------------------------------------------------
# Linearisation of one oscillator in tabulated noise.
# ------------------------------------------------------------------------------


def flat(low: float, high: float, density: float = 0.4) -> TabulatedNoise:
    return TabulatedNoise(on="x", frequency_hz=[low, high], density=[density] * 2, unit="N2/Hz")


@pytest.mark.parametrize(("form", "variant"), WAYS)
@pytest.mark.parametrize(("lower", "upper"), [(-0.3, 1.2), (None, 0.5)])
def test_wide_flat_table_is_white(
    form: str, variant: str, lower: float | None, upper: float
) -> None:
    white = linearise(make_scene(lower, upper), form, variant)
    names = ("displacement_std", "velocity_std", "collision_rate")

    def error(decades: int) -> float:
        table = flat(10.0**-decades, 10.0**decades)
        coloured = linearise(
            make_scene(lower, upper, intensity=None, extra=(table,)), form, variant
        )
        return max(abs(value(coloured, name) / value(white, name) - 1.0) for name in names)

    # what the table leaves out falls as 1 / (its limits), so 100-fold over two decades
    near = error(5)
    assert near < 1e-4
    assert error(7) == pytest.approx(near / 100.0, rel=0.05)


@pytest.mark.parametrize("profile", ["mil-std-810h-truck-vertical-5hz", "navmat-p-9492"])
@pytest.mark.parametrize("extra", [(), (WhiteNoise(on="base", intensity=0.05),)])
def test_closure_of_an_isolator_is_its_own_linearisation(
    profile: str, extra: tuple[Excitation, ...]
) -> None:
    """k and beta from the reported rates alone give back the reported deviations."""
    table = TabulatedNoise(on="base", profile=profile)
    scene = Scene(
        structure=Isolator(frequency_hz=12.0, zeta=0.1),
        impact_pairs=[
            ImpactPair(
                lower=-1e-3,
                upper=2e-3,
                law=Restitution(coefficient=0.6),
                lower_law=Restitution(coefficient=0.9),
            )
        ],
        excitations=[table, *extra],
    )
    model, response = model_of(scene), linearise(scene)
    mean, speed = value(response, "displacement_mean"), value(response, "velocity_std")
    variance = value(response, "displacement_std") ** 2
    stiffness = damping = force = 0.0
    for side, sign, restitution in (("lower", -1.0, 0.9), ("upper", 1.0, 0.6)):
        rate = value(response, f"collision_rate_{side}")
        push = (1.0 + restitution) * rate * math.sqrt(math.pi / 2.0) * speed
        stiffness += push * abs(getattr(model, side).position - mean) / variance
        force += sign * push
        damping += (1.0 - restitution**2) * rate
    total = model.omega**2 + stiffness
    coloured = response_moments(
        model.acceleration_tables, math.sqrt(total), model.damping_rate + damping
    )
    white = model.intensity / (2.0 * (model.damping_rate + damping))
    assert variance == pytest.approx(coloured.displacement + white / total, rel=1e-8)
    assert speed**2 == pytest.approx(coloured.velocity + white, rel=1e-8)
    assert model.omega**2 * mean == pytest.approx(-force, rel=1e-8)
    assert all(entry.bias is None for entry in response.estimates().values())


@quick_cases(("form", "variant"), WAYS, keep=(0, 4))
def test_random_scenes_of_tabulated_noise(form: str, variant: str) -> None:
    rng = np.random.default_rng(3)
    for _ in range(10):
        frequency = 10.0 ** rng.uniform(0.0, 2.0)
        table = TabulatedNoise(on="base", profile="mil-std-810h-truck-vertical-5hz")
        structure = Isolator(frequency_hz=frequency, zeta=10.0 ** rng.uniform(-2.0, -0.3))
        free = response_moments([table.table], structure.omega, structure.damping_rate)
        gaps = math.sqrt(free.displacement) * 10.0 ** rng.uniform(-1.0, 1.0, 2)
        scene = Scene(
            structure=structure,
            impact_pairs=[
                ImpactPair(
                    lower=-float(gaps[0]) if rng.uniform() < 0.7 else None,
                    upper=float(gaps[1]),
                    law=Restitution(coefficient=float(rng.uniform())),
                )
            ],
            excitations=[table],
        )
        response = linearise(scene, form, variant)
        assert value(response, "displacement_std") > 0.0


def test_no_balance_is_said_in_a_sentence() -> None:
    """Noise of at most a hundredth of the preload does not lift the mass off its stop."""
    scene = make_scene(None, -1.0, intensity=None, extra=(flat(0.05, 0.3, 1e-4),))
    with pytest.raises(NotConverged, match="a preload holds the mass on a stop"):
        linearise(scene)
