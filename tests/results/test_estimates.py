"""Numbers with their errors: how they print, and the forms that a response takes."""

from __future__ import annotations

import json
import math
import operator
import re
from collections.abc import Callable, Iterable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from stochvi import Elastic, ImpactPair, Oscillator, Restitution, Scene, WhiteNoise, average
from stochvi.isolators.sizing.answer import Clearance
from stochvi.methods.closed_form import exact
from stochvi.methods.fokker_planck import fokker_planck
from stochvi.methods.linearisation import linearise
from stochvi.methods.monte_carlo import simulate
from stochvi.results.base import (
    NEVER_ZERO,
    RESPONSE_QUANTITIES,
    CoordinateResponse,
    PairResponse,
    Response,
)
from stochvi.results.estimates import (
    GAUSSIAN_95,
    Estimate,
    PathMoments,
    binomial_interval,
    delta_method,
    events_suffice,
    format_with_error,
    jackknife_error,
    jackknife_ratio,
    logarithmic_interval,
    mean_and_error,
    most_events,
    normal_quantile,
    plus_minus,
    poisson_interval,
    ratio_and_error,
    satterthwaite_degrees,
    student_factor,
    student_quantile,
    total,
    upper_limit_unseen,
)
from stochvi.scenes.datasets import shipped_scene
from stochvi.scenes.excitations import FilteredNoise
from stochvi.scenes.scene import load_scene
from stochvi.testing import assert_agrees
from stochvi.views.files import to_json
from support.accuracies import assert_differs
from support.known import oscillator


@pytest.mark.parametrize("limit", [0.01, 3.0])
def test_a_sum_beside_what_was_not_seen_is_no_better_known_than_its_parts(limit: float) -> None:
    unseen = Estimate(value=0.0, bias=None, upper_95=limit)
    known = total([Estimate(value=1.0, standard_error=0.1, bias=0.2), unseen])
    if limit < 1.0:
        assert (known.value, known.bias, known.upper_95) == (1.0, pytest.approx(0.2 + limit), None)
    else:
        assert known.value == 0.0 and known.upper_95 == pytest.approx(4.2 + 0.1 * GAUSSIAN_95)
    vague = total([Estimate(value=1.0, standard_error=0.1, bias=None), unseen])
    assert (vague.value, vague.bias, vague.upper_95) == (1.0, None, None)


@pytest.mark.parametrize(
    ("value", "error", "text"),
    [
        (0.28281234, 0.00041, "0.28281(41)"),
        (0.28281234, 0.00996, "0.2828(100)"),
        (0.28281234, 0.0996, "0.283(100)"),
        (-0.5, 0.1, "-0.50(10)"),
        (12.3456, 1.234, "12.3(1.2)"),
        (1234.5, 210.0, "1230(210)"),
        (0.0, 0.02, "0.000(20)"),
        (3.21e-07, 4.5e-09, "3.210(45)e-07"),
        (1.5e8, 2.5e6, "1.500(25)e+08"),
        (1e-9, 1.0, "0.0(1.0)"),
        (0.5395600937, 0.0, "0.539560094"),
        (0.5395600937, math.inf, "0.539560094"),
    ],
)
def test_two_digits_of_the_error_stand_in_brackets(value, error, text):
    assert format_with_error(value, error) == text


@given(
    value=st.floats(-1e12, 1e12).filter(lambda x: x == 0.0 or abs(x) > 1e-12),
    error=st.floats(1e-12, 1e12),
)
def test_the_text_reads_back_as_the_value_and_the_error(value, error):
    """Both within half a unit of the error's second digit, that is 5 % of the error."""
    text = format_with_error(value, error)
    whole, fraction, bracket, power = re.fullmatch(
        r"(-?\d+)(?:\.(\d+))?\(([\d.]+)\)(e[+-]\d+)?", text
    ).groups(default="")
    scale = float(f"1{power}")
    unit = 1.0 if "." in bracket else 10.0 ** -len(fraction)
    assert float(bracket) * unit * scale == pytest.approx(error, rel=0.05 + 1e-9)
    read = float(f"{whole}.{fraction or 0}") * scale
    assert abs(read - value) <= 0.05 * error * (1.0 + 1e-9) + 1e-15 * abs(value)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("name", ["value", "standard_error", "bias", "upper_95"])
def test_an_estimate_is_finite(name, bad):
    with pytest.raises(ValueError, match=f"{name} must be finite, got {bad}"):
        Estimate(**({"value": 1.0} | {name: bad}))


@pytest.mark.parametrize("name", ["standard_error", "bias"])
def test_an_error_is_not_negative(name):
    with pytest.raises(ValueError, match=f"{name} must be at least 0, got -0.1"):
        Estimate(**{"value": 1.0, name: -0.1})


def test_the_json_of_an_estimate_has_the_keys_of_the_contract():
    keys = {"value", "standard_error", "bias", "how"}
    assert set(Estimate(value=1.0).to_dict()) == keys
    unseen = Estimate(value=0.0, upper_95=0.3)
    assert set(unseen.to_dict()) == keys | {"upper_95"}
    assert Estimate(value=1.0, bias=None).to_dict()["bias"] is None
    # how well a sampled bias is known is no secret: without it the bias looks certain
    assert Estimate(value=1.0, bias=0.1, bias_error=0.2).to_dict()["bias_error"] == 0.2


def test_what_a_simulation_knows_of_its_bias_is_in_its_document_and_in_its_frame():
    response = simulate(oscillator(-1.0, 1.0, 0.8), paths=16, duration=20.0, threads=1)
    estimate = response.coordinates["x"]["velocity_std"]
    assert estimate.bias_error > 0.0
    document = response.to_dict()["coordinates"]["x"]["velocity_std"]
    assert document["bias_error"] == estimate.bias_error
    row = response.to_frame().set_index(["of", "quantity"]).loc[("x", "velocity_std")]
    assert row["bias_error"] == estimate.bias_error


KNOWN = Estimate(
    value=2.0, standard_error=0.3, bias=0.1, how="16 paths", bias_error=0.05, upper_95=4.0
)


def test_all_errors_of_an_estimate_go_with_a_plain_factor():
    for found in (KNOWN * 3600, 3600.0 * KNOWN, np.float64(3600.0) * KNOWN, KNOWN / (1.0 / 3600)):
        assert (found.value, found.standard_error, found.bias) == pytest.approx((7200, 1080, 360))
        assert (found.bias_error, found.upper_95) == pytest.approx((180, 14400))
        assert found.how == "16 paths"


def test_a_negative_factor_leaves_errors_positive():
    found = -Estimate(value=2.0, standard_error=0.3, bias=0.1, bias_error=0.05)
    assert (found.value, found.standard_error, found.bias, found.bias_error) == (-2, 0.3, 0.1, 0.05)
    assert (Estimate(value=1.0, bias=None) * -2.0).bias is None


def test_a_shift_moves_the_value_and_its_limit_alone():
    for found in (KNOWN + 1, 1.0 + KNOWN, KNOWN - -1):
        assert found == replace(KNOWN, value=3.0, upper_95=5.0)
    chance = Estimate(value=0.25, standard_error=0.1)
    assert 1.0 - chance == replace(chance, value=0.75)


def test_what_was_never_seen_has_no_lower_limit_and_so_no_negative():
    for operation in (lambda e: -e, lambda e: e * 0.0, lambda e: 1.0 - e):
        with pytest.raises(ValueError, match="never seen"):
            operation(Estimate(value=0.0, upper_95=0.3))


@pytest.mark.parametrize("operation", [operator.add, operator.sub, operator.mul, operator.truediv])
def test_two_estimates_are_not_combined(operation):
    with pytest.raises(TypeError, match="correlated"):
        operation(KNOWN, KNOWN)
    for other in ("2", None, True, np.array([1.0, 2.0])):
        with pytest.raises(TypeError):
            operation(KNOWN, other)


def test_an_estimate_is_a_number_for_python_and_numpy():
    assert float(KNOWN) == 2.0
    assert np.array([KNOWN, KNOWN], float).tolist() == [2.0, 2.0]
    assert math.sqrt(KNOWN * 2) == 2.0
    assert Estimate(value=1.0) != 1.0 and Estimate(value=1.0) == Estimate(value=1.0)
    assert len({Estimate(value=1.0), Estimate(value=1.0)}) == 1


def test_an_estimate_is_rounded_formatted_and_ordered_by_its_value():
    found = Estimate(value=2.34567, standard_error=0.3, how="16 paths")
    assert (f"{found:.3f}", f"{found:10.1e}", f"{found}") == ("2.346", "   2.3e+00", str(found))
    assert (round(found, 3), round(found)) == (2.346, 2)
    assert found < 2.4 and found <= 3 and found > np.float64(2.3) and found >= 2
    assert found < 2.4 and not found > 2.4 and not found < 2.34567 and max(found, 2.0) is found
    for other in (found, "2", None):
        with pytest.raises(TypeError):
            operator.lt(found, other)


def test_a_clearance_is_a_number_by_its_value():
    found = Clearance(value=4.9e-3, lower=4.8e-3, upper=5e-3)
    assert (f"{found:.4f}", f"{found}", float(found)) == ("0.0049", str(found), 4.9e-3)
    assert found < 5e-3 and not found < 4.8e-3 and round(found, 3) == 5e-3


def test_all_errors_make_one_interval():
    """The two standard errors are independent; the bias is added whole."""
    known = Estimate(value=2.0, standard_error=0.3, bias=0.1, bias_error=0.4)
    half = GAUSSIAN_95 * 0.5 + 0.1
    assert known.interval() == pytest.approx((2.0 - half, 2.0 + half), rel=1e-12)
    assert known.half_width_95() == pytest.approx(half, rel=1e-12)
    assert Estimate(value=0.0, upper_95=0.3).interval() == (0.0, 0.3)
    with pytest.raises(ValueError, match=r"bias not known .* has no interval"):
        Estimate(value=2.0, standard_error=0.3, bias=None).interval()
    # 2.5758 is the quantile of 99 %
    half = 2.575829303549 * math.hypot(known.standard_error, known.bias_error) + known.bias
    assert known.interval(0.99) == pytest.approx((2.0 - half, 2.0 + half), rel=1e-10)
    for wrong in (0.0, 1.0, 95.0):
        with pytest.raises(ValueError, match=r"confidence must be in \(0, 1\)"):
            known.interval(wrong)
    with pytest.raises(ValueError, match=r"confidence must be 0\.95"):
        Estimate(value=0.0, upper_95=0.3).interval(0.99)


def test_a_truth_is_judged_by_the_interval_of_all_errors():
    known = Estimate(value=1.0, standard_error=0.03, bias=0.1, bias_error=0.04)
    assert_agrees(known, 1.1 + 4.49 * 0.05)
    for certain in (replace(known, bias_error=0.0), replace(known, bias=0.0)):
        assert_differs(certain, 1.1 + 4.49 * 0.05)


def test_a_bias_is_told_where_it_widens_the_interval():
    known = Estimate(value=0.5, standard_error=0.01, bias=0.0019)
    assert (str(known), plus_minus(known)) == ("0.500(10) []", "0.500 ± 0.021")
    biased = replace(known, bias=0.0021)
    assert biased.half_width_95() > 1.1 * replace(known, bias=0.0).half_width_95()
    assert str(biased) == "0.500(10), bias up to 0.0021 []"
    assert plus_minus(biased) == "0.500 ± 0.022"
    unknown = replace(known, bias=None)
    assert (str(unknown), plus_minus(unknown)) == ("0.500(10), bias not known []", "0.500 ± 0.020")


def test_a_number_without_scatter_has_the_digits_that_are_known():
    solved = Estimate(value=0.237441599, bias=0.0053)
    assert plus_minus(solved, digits=7) == "0.2374 ± 0.0053"
    for bias, told in ((1e-6, "0.23744"), (1e-8, "0.2374416"), (0.0, "0.2374416")):
        assert plus_minus(replace(solved, bias=bias), digits=7) == told
        assert plus_minus(replace(solved, bias=bias)) == "0.2374"


def test_a_response_that_was_read_back_is_the_same():
    response = simulate(oscillator(-1.0, 1.0, 0.8), paths=16, duration=20.0, threads=1)
    document = json.loads(to_json(response.to_dict()))
    assert Response.from_dict(document) == response
    assert replace(response, warnings=["something"]) != response
    assert replace(response, method="other") != response
    assert response != document


def test_the_json_of_a_response_reads_back_and_holds_null_for_what_is_not_known():
    response = exact(oscillator(-1.0, 1.0))
    document = json.loads(to_json(response.to_dict()))
    assert document == response.to_dict()
    assert Response.from_dict(document).to_dict() == document
    assert document["coordinates"]["x"]["acceleration_std"] is None
    assert document["impact_pairs"]["stops"]["peak_force"] is None
    assert document["impact_pairs"]["stops"]["speed_threshold"] == 0.0
    assert document["provenance"]["scene"]["structure"]["damping"] == 0.1


@pytest.mark.parametrize("key", ["method", "coordinates", "cost", "identities"])
def test_a_document_that_lacks_a_part_is_not_a_response(key: str):
    document = simulate(oscillator(-1.0, 1.0, 1.0), paths=8, duration=5.0).to_dict()
    del document[key]
    with pytest.raises(ValueError, match="the document of a response"):
        Response.from_dict(document)


def test_the_frame_of_a_response_has_a_row_for_each_estimate_and_a_column_for_each_fact():
    response = exact(oscillator(-1.0, 1.0))
    frame = response.to_frame()
    assert list(frame.columns) == [
        "method", "of", "quantity", "unit", "value", "standard_error", "bias", "how", "bias_error",
    ]  # fmt: skip
    assert len(frame) == len(response.estimates())
    assert not frame[["of", "quantity"]].duplicated().any()
    assert set(frame["of"]) == {"x", "stops"}
    for name, unit in zip(frame["quantity"], frame["unit"], strict=True):
        assert unit == RESPONSE_QUANTITIES[name].unit
    rate = frame.set_index("quantity").loc["collision_rate", "value"]
    assert rate == response.impact_pairs["stops"]["collision_rate"].value
    assert "displacement_std" in response._repr_html_()


def test_every_quantity_has_a_unit_and_a_place_in_a_response():
    response = exact(oscillator(-1.0, 1.0))
    named = {*response.coordinates["x"], *response.impact_pairs["stops"]} - {"speed_threshold"}
    relative = {name for name in RESPONSE_QUANTITIES if name.startswith("relative_")}
    assert named == set(RESPONSE_QUANTITIES) - relative
    # those are of a pair between two coordinates
    box = simulate(load_scene(shipped_scene("absorber-in-a-box")), paths=2, duration=20.0)
    assert relative < set(box.impact_pairs["box"])


# Records -----------------------------------------------------------------------------------


def test_a_quantity_is_an_attribute_and_an_entry():
    response = exact(oscillator(-1.0, 1.0))
    motion, pair = response.coordinates["x"], response.impact_pairs["stops"]
    assert motion.displacement_std is motion["displacement_std"]
    assert dict(pair.items())["collision_rate"] is pair.collision_rate
    assert pair.get("peak_force", 1.0) is None  # rigid stops have none
    assert pair.get("relative_velocity_std", 1.0) == 1.0  # nor has a pair of one coordinate this
    with pytest.raises(KeyError, match="displacement_sdt; known: displacement_std"):
        motion["displacement_sdt"]


def test_a_response_takes_any_mapping_of_known_quantities():
    speed = Estimate(value=1.0)
    response = Response(
        method="mine",
        coordinates={"x": {"velocity_std": speed}},
        impact_pairs={"stops": {"collision_rate": speed, "speed_threshold": 0.1}},
    )
    assert response.coordinates == {"x": CoordinateResponse(velocity_std=speed)}
    pair = PairResponse(collision_rate=speed, speed_threshold=0.1)
    assert response.impact_pairs == {"stops": pair}
    with pytest.raises(TypeError, match="velocity_sdt"):
        Response(method="mine", coordinates={"x": {"velocity_sdt": speed}}, impact_pairs={})


def test_a_change_of_all_estimates_leaves_the_rest():
    response = exact(oscillator(-1.0, 1.0))
    doubled = response.changed(lambda name, estimate: estimate * 2.0)
    assert doubled.coordinates["x"].velocity_std == response.coordinates["x"].velocity_std * 2.0
    assert doubled.impact_pairs["stops"].peak_force is None
    assert doubled.estimates().keys() == response.estimates().keys()
    assert doubled.cost == response.cost


def test_every_method_answers_with_the_same_quantities_and_the_notes_of_the_scene():
    """An overdamped oscillator, of which every method must warn; filtered noise takes `exact` the
    way of several coordinates."""
    white = oscillator(-1.0, 1.0, damping=4.0)
    filtered = white.model_copy(
        update={
            "impact_pairs": (),
            "excitations": (FilteredNoise(intensity=0.2, frequency_hz=0.2, zeta=0.5),),
        }
    )
    responses = [
        exact(white), linearise(white), fokker_planck(white), exact(filtered),
        simulate(white, paths=4, duration=5.0), simulate(filtered, paths=4, duration=5.0),
    ]  # fmt: skip
    for response in responses:
        assert any("above critical" in warning for warning in response.warnings), response.method
        assert response.effects and response.provenance["scene"]
        assert list(response.coordinates["x"]) == list(responses[0].coordinates["x"])


def test_the_box_of_a_loose_mass_says_what_it_does_not_know():
    response = linearise(load_scene(shipped_scene("absorber-in-a-box")))
    assert response.impact_pairs["box"].collision_rate is None
    assert any("rates" in warning for warning in response.warnings)


def test_a_response_shows_the_bias_that_its_digits_do_not_hold() -> None:
    scene = load_scene(shipped_scene("oscillator-lossy"))
    line = next(each for each in repr(linearise(scene)).splitlines() if "x.velocity_std" in each)
    bias = linearise(scene).coordinates["x"]["velocity_std"].bias
    assert bias is not None
    assert line.endswith(f"m/s, bias up to {bias:.2g}")
    assert "bias" not in repr(exact(oscillator()))


# ------------------------------------------------------------------------------
# Intervals and standard errors: how often they cover, and what they are for known laws.
# ------------------------------------------------------------------------------


REPEATS = 4000


def covers_95(held: np.ndarray) -> bool:
    """Whether intervals that held so often may be 95 % ones: three standard errors of the count."""
    return abs(held.mean() - 0.95) < 3.0 * math.sqrt(0.95 * 0.05 / len(held))


def test_quantiles_of_95_percent() -> None:
    assert normal_quantile(0.05) == pytest.approx(GAUSSIAN_95, rel=1e-12)
    assert student_quantile(0.05, 4.0) == pytest.approx(stats.t.ppf(0.975, 4.0), rel=1e-12)


def test_a_logarithmic_interval_of_nothing_is_everything() -> None:
    assert logarithmic_interval(0.0, 0.0, 5, 0.95) == (0.0, math.inf)


@pytest.mark.parametrize("events", [0, 1, 7])
def test_the_ends_of_an_interval_of_a_rate_are_seen_with_the_chance_of_its_tails(
    events: int,
) -> None:
    low, high = poisson_interval(events, 2.0)
    assert stats.poisson.cdf(events, 2.0 * high) == pytest.approx(0.025)
    if events:
        assert stats.poisson.sf(events - 1, 2.0 * low) == pytest.approx(0.025)
    else:
        assert low == 0.0


@pytest.mark.parametrize(("events", "trials"), [(0, 9), (3, 9), (9, 9)])
def test_clopper_and_pearsons_ends_are_seen_with_the_chance_of_their_tails(
    events: int, trials: int
) -> None:
    low, high = binomial_interval(events, trials)
    assert high == 1.0 or stats.binom.cdf(events, trials, high) == pytest.approx(0.025)
    assert low == 0.0 or stats.binom.sf(events - 1, trials, low) == pytest.approx(0.025)


def test_wilsons_ends_lie_at_the_normal_quantile() -> None:
    for end in binomial_interval(3, 40, rule="wilson"):
        score = (3 / 40 - end) / math.sqrt(end * (1.0 - end) / 40)
        assert abs(score) == pytest.approx(GAUSSIAN_95)


def test_nothing_is_seen_at_the_upper_limit_with_a_chance_of_5_percent() -> None:
    assert stats.poisson.pmf(0, 3.0 * upper_limit_unseen(3.0)) == pytest.approx(0.05)


def test_the_jackknife_of_a_mean_is_its_standard_error() -> None:
    samples = np.random.default_rng(2).standard_normal((3, 20))
    left_out = (samples.sum(axis=1, keepdims=True) - samples) / 19
    expected = [mean_and_error(row)[1] for row in samples]
    assert jackknife_error(left_out) == pytest.approx(expected)
    assert jackknife_error(left_out[0]) == pytest.approx(expected[0])


def test_errors_of_a_ratio_cover_what_it_scatters_by() -> None:
    """Ratios of correlated sums; by the jackknife and to first order."""
    random = np.random.default_rng(3)
    below = 1.0 + 0.3 * random.standard_normal((REPEATS, 200))
    above = 2.0 * below + 0.2 * random.standard_normal(below.shape)
    quantile = student_quantile(0.05, 199.0)
    for method in (jackknife_ratio, ratio_and_error):
        found = np.array([method(*pair) for pair in zip(above, below, strict=True)])
        assert covers_95(np.abs(found[:, 0] - 2.0) < quantile * found[:, 1])


@pytest.mark.parametrize("samples", [3, 4, 8])
def test_errors_of_a_ratio_of_few_samples_are_those_of_student(samples: int) -> None:
    """Energies over numbers of impacts of a few paths."""
    random = np.random.default_rng(samples)
    below = 1.0 + 0.1 * random.standard_normal((REPEATS, samples))
    above = 2.0 * below + 0.2 * random.standard_normal(below.shape)
    found = np.array([ratio_and_error(*pair) for pair in zip(above, below, strict=True)])
    away = np.abs(found[:, 0] - 2.0)
    assert covers_95(away < GAUSSIAN_95 * found[:, 1])
    assert not covers_95(away < GAUSSIAN_95 / student_factor(samples) * found[:, 1])


def test_the_delta_method_and_the_jackknife_agree_to_first_order() -> None:
    samples = 1.0 + 0.01 * np.random.default_rng(4).standard_normal((2, 100))
    covariance = np.cov(samples) / samples.shape[1]
    value, error = delta_method(lambda m: m[0] / m[1], samples.mean(axis=1), covariance)
    other, other_error = jackknife_ratio(*samples)
    assert value == pytest.approx(other)
    # to first order in the scatter of the samples: what is left is smaller by that factor
    assert error == pytest.approx(other_error, rel=0.01)


def test_a_variance_that_is_negative_by_rounding_adds_no_error() -> None:
    covariance = np.array([[4e-4, 0.0], [0.0, -1e-24]])
    value, error = delta_method(lambda m: m[0] * m[1], np.array([2.0, 3.0]), covariance)
    assert (value, error) == (6.0, pytest.approx(3.0 * 0.02, rel=1e-6))


def test_the_delta_method_takes_functions_at_many_places_at_once() -> None:
    random = np.random.default_rng(5)
    products = 1.0 + 0.1 * random.standard_normal((50, 2, 3))
    away = products - products.mean(axis=0)
    moments = PathMoments(
        count=50, mean=products.mean(axis=0), scatter=np.einsum("prf,psf->rsf", away, away)
    )
    together = delta_method(lambda m: m[0] * m[1], moments.mean, moments.covariance)
    for place in range(3):
        alone = delta_method(
            lambda m: m[0] * m[1], moments.mean[:, place], moments.covariance[:, :, place]
        )
        assert [each[place] for each in together] == pytest.approx(list(alone))


def test_merged_moments_are_those_of_all_paths() -> None:
    samples = np.random.default_rng(6).standard_normal((30, 2))

    def moments(part: np.ndarray) -> PathMoments:
        away = part - part.mean(axis=0)
        return PathMoments(count=len(part), mean=part.mean(axis=0), scatter=away.T @ away)

    merged = moments(samples[:7]).merge(moments(samples[7:]))
    assert merged.count == 30
    assert merged.mean == pytest.approx(moments(samples).mean)
    assert merged.scatter == pytest.approx(moments(samples).scatter)


def test_degrees_of_freedom_of_a_sum_are_those_of_satterthwaite() -> None:
    """Never fewer than those of the least known term, and fewer than of all samples together."""
    found = satterthwaite_degrees([0.1, 0.3], [11, 41])
    assert found == pytest.approx((0.01 + 0.09) ** 2 / (0.01**2 / 10.0 + 0.09**2 / 40.0))
    assert satterthwaite_degrees([1e-9, 0.3], [11, 41]) == pytest.approx(40.0)
    assert satterthwaite_degrees([0.0, 0.3], [11, 41]) == 40.0


@pytest.mark.parametrize("samples", [2, 4, 8, 64])
@pytest.mark.parametrize("single", [True, False])
def test_a_rate_of_clusters_is_within_its_interval_or_limit(samples: int, single: bool) -> None:
    """Clusters of one event, or of an exponential number, from one of them to hundreds."""
    random = np.random.default_rng(4)
    for mean in (1.0, 6.0, 20.0, 300.0):
        counts = random.poisson(mean / samples, (1000, samples)).astype(float)
        if not single:
            counts = np.where(counts > 0.0, random.gamma(np.maximum(counts, 1.0)), 0.0)
        held, plain = [], []
        for row in counts[counts.any(axis=1)]:
            value, error = mean_and_error(row)
            low, high = 0.0, most_events(value, error, samples)
            if events_suffice(value, error, samples):
                low, high = logarithmic_interval(value, error, samples - 1)
            held.append(low <= mean / samples <= high)
            plain.append(abs(value - mean / samples) <= GAUSSIAN_95 * error)
        assert np.mean(held) > 0.95 - 4.5 * math.sqrt(0.05 * 0.95 / len(held))
        # the negative control: two standard errors, of few samples or clusters
        if samples == 2 or (mean == 1.0 and not single):
            assert np.mean(plain) < 0.87


def test_few_samples_widen_a_standard_error_to_students() -> None:
    assert student_factor(5) == pytest.approx(stats.t.ppf(0.975, 4) / GAUSSIAN_95)
    assert student_factor(1) == math.inf and student_factor(10**6) == 1.0


# ------------------------------------------------------------------------------
# The comparison of a sampled number with the truth passes and fails where it should.
# ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("within", "beyond", "error", "bias"),
    [(1.44, 1.46, 0.1, 0.0), (0.56, 0.54, 0.1, 0.0), (1.64, 1.66, 0.1, 0.2), (1.2, 1.3, 0.0, 0.25),
     (1.0, 1 + 1e-15, 0.0, 0.0)],
)  # fmt: skip
def test_a_truth_is_accepted_within_the_stated_errors_alone(within, beyond, error, bias):
    assert_agrees(Estimate(value=within, standard_error=error, bias=bias), 1.0)
    assert_differs(Estimate(value=beyond, standard_error=error, bias=bias), 1.0)


def test_z_narrows_the_tolerance():
    estimate = Estimate(value=1.3, standard_error=0.1)
    assert_agrees(estimate, 1.0, z=3.1)
    with pytest.raises(AssertionError):
        assert_agrees(estimate, 1.0, z=2.9)


def test_an_estimate_of_unknown_bias_cannot_be_compared():
    with pytest.raises(ValueError, match="states no bias"):
        assert_agrees(Estimate(value=1.0, bias=None), 1.0)


def test_the_message_holds_the_value_the_truth_and_the_standard_errors_between():
    with pytest.raises(AssertionError, match=re.escape("2.00(10)")) as failure:
        assert_agrees(Estimate(value=2.0, standard_error=0.1), 1.25)
    assert "1.25" in str(failure.value)
    assert "7.5 standard errors" in str(failure.value)


# ------------------------------------------------------------------------------
# A rate is never 0 without an error: it is rare, and an answer says how rare at most.
# ------------------------------------------------------------------------------


METHODS: dict[str, Callable[[Scene], Response]] = {
    "exact": exact,
    "average": average,
    **{f"linearise {form}": lambda scene, form=form: linearise(scene, form=form)  # type: ignore[misc]
       for form in ("closure", "motion", "force", "clumps")},
    "fokker-planck": fokker_planck,
    "simulate": lambda scene: simulate(scene, paths=16, duration=20.0, seed=1),
}  # fmt: skip

ELASTIC = ("exact", "linearise closure", "linearise motion", "linearise force", "fokker-planck",
           "simulate")  # fmt: skip


def far(distance: float, law: Restitution | Elastic) -> Scene:
    """Stops at so many standard deviations."""
    return Scene(
        structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
        impact_pairs=[ImpactPair(lower=-distance, upper=distance, law=law)],
        excitations=[WhiteNoise(intensity=0.2)],
    )


def stated(found: Iterable[Estimate | float | None]) -> bool:
    """Whether each number that is 0 has an error, a limit, or no interval at all."""
    return all(
        each.value != 0.0 or each.bias is None or each.upper_95 or each.half_width_95() > 0.0
        for each in found
        if isinstance(each, Estimate)
    )


@pytest.mark.parametrize("distance", [9.0, 60.0])
@pytest.mark.parametrize("method", METHODS)
def test_no_method_says_a_rate_of_exactly_zero(method: str, distance: float) -> None:
    """exp(-1800) is 0 for a computer, and exp(-40) is less than what a mesh or a sample sees."""
    law = Restitution(coefficient=1.0)
    pair = METHODS[method](far(distance, law)).impact_pairs["stops"]
    assert stated(pair[name] for name in NEVER_ZERO)
    if method in ELASTIC:
        pair = METHODS[method](far(distance, Elastic(stiffness=50.0))).impact_pairs["stops"]
        assert stated(pair[name] for name in NEVER_ZERO)


def test_zeros_that_are_right_stay_as_they_are() -> None:
    plain, limited = Estimate(value=0.0), Estimate(value=0.0, upper_95=0.1)
    pair = PairResponse(
        collision_rate=plain, collision_rate_upper=limited, relative_displacement_mean=plain
    )
    assert not stated([plain]) and stated([pair.collision_rate])
    assert pair.collision_rate_upper == limited and pair.relative_displacement_mean == plain
