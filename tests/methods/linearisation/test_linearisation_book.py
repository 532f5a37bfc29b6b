"""The forms of the book, motion and force: printed values, slopes, limits."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import quad

from stochvi.methods.linearisation import linearise
from stochvi.methods.linearisation.forms import form_of
from stochvi.model.gap import Gap
from stochvi.model.model import model_of
from support.linearised import make_scene, summary, value


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
