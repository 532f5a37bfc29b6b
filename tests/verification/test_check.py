"""`check`: methods that agree pass, a wrong one is caught, approximations are only shown."""

from dataclasses import replace

import pytest

from stochvi import (
    Estimate,
    ImpactPair,
    Isolator,
    Response,
    Restitution,
    Scene,
    TabulatedNoise,
    Viscoelastic,
    average,
    check,
    exact,
    fokker_planck,
    load_scene,
    simulate,
)
from stochvi.results.estimates import Cost
from stochvi.results.response import CoordinateResponse
from stochvi.scenes.datasets import shipped_scene
from stochvi.verification.check import (
    APPROXIMATE,
    BIAS_UNKNOWN,
    DISAGREES,
    OTHER_THRESHOLD,
    TOO_RARE,
    ZERO,
    compare,
)
from support.known import oscillator


@pytest.mark.parametrize("name", ["oscillator-elastic", "oscillator-lossy", "isolator-truck"])
def test_shipped_scenes_pass(name: str) -> None:
    verdict = check(load_scene(shipped_scene(name)), rel_error=0.005, seed=3)
    assert verdict.passed
    assert verdict.z > 2.9
    assert any(row.verdict == APPROXIMATE for row in verdict.comparisons)
    assert verdict.to_dict()["passed"] is True


def tampered(response: Response, quantity: str, factor: float) -> Response:
    def change(group: dict) -> dict:
        return {
            owner: {
                name: replace(item, value=item.value * factor)
                if name == quantity and isinstance(item, Estimate)
                else item
                for name, item in entries.items()
            }
            for owner, entries in group.items()
        }

    return replace(
        response,
        coordinates=change(dict(response.coordinates)),
        impact_pairs=change(dict(response.impact_pairs)),
    )


@pytest.mark.parametrize(
    "quantity", ["displacement_std", "velocity_std", "collision_rate", "impact_speed_square_rate"]
)
def test_a_tampered_quantity_is_the_only_one_that_disagrees(quantity: str) -> None:
    scene = oscillator(-1.0, 1.0, 1.0)
    truth, found = exact(scene), simulate(scene, rel_error=0.002, seed=5)
    assert compare([truth, found]).passed
    verdict = compare([truth, tampered(found, quantity, 1.02)])
    wrong = {row.quantity for row in verdict.comparisons if row.verdict == DISAGREES}
    assert wrong == {quantity}
    assert not verdict.passed


def test_a_lossy_scene_has_two_judges_and_a_tampered_one_is_caught() -> None:
    scene = oscillator(-1.0, 1.0, 0.8)
    verdict = check(scene, rel_error=0.002, seed=2)
    assert verdict.passed
    assert {row.method for row in verdict.comparisons} >= {"fokker-planck", "simulate"}
    solved, simulated = (
        next(response for response in verdict.responses if response.method == method)
        for method in ("fokker-planck", "simulate")
    )
    for quantity in ("displacement_std", "impact_speed_rate"):
        wrong = compare([tampered(solved, quantity, 1.02), simulated])
        found = {row.quantity for row in wrong.comparisons if row.verdict == DISAGREES}
        assert found == {quantity}


def test_an_estimate_of_unknown_bias_is_not_judged() -> None:
    solved = fokker_planck(oscillator(-1.0, 1.0, 0.8))
    other = tampered(solved, "velocity_std", 2.0)
    speed = other.coordinates["x"]["velocity_std"]
    assert isinstance(speed, Estimate)
    untold = {**other.coordinates["x"], "velocity_std": replace(speed, bias=None)}
    verdict = compare([solved, replace(other, coordinates={"x": untold})])
    assert verdict.passed
    found = {row.quantity for row in verdict.comparisons if row.verdict == BIAS_UNKNOWN}
    assert found == {"velocity_std"}


def test_a_broken_balance_disagrees() -> None:
    found = simulate(oscillator(-1.0, 1.0, 0.8), rel_error=0.005, seed=6)
    energy = replace(found.identities["energy"], value=0.05)
    verdict = compare([replace(found, identities={**found.identities, "energy": energy})])
    assert [row.quantity for row in verdict.comparisons if row.verdict == DISAGREES] == ["energy"]


def test_an_approximation_is_shown_and_not_failed() -> None:
    scene = oscillator(-1.0, 1.0, 1.0)
    verdict = compare([exact(scene)], [tampered(exact(scene), "velocity_std", 2.0)])
    assert verdict.passed
    errors = {row.quantity: row.relative for row in verdict.comparisons if row.of != "balance"}
    assert errors["velocity_std"] == pytest.approx(1.0)


def test_reasons_for_methods_left_out_are_listed() -> None:
    verdict = check(oscillator(-1.0, 1.0, 0.8), rel_error=0.02)
    assert any("restitution must be 1" in reason for reason in verdict.left_out)


def test_impacts_too_rare_to_judge_by_raise_no_alarm() -> None:
    verdict = check(oscillator(-6.0, 6.0, 1.0), rel_error=0.02)
    assert verdict.passed
    rates = [row for row in verdict.comparisons if row.quantity.startswith("collision")]
    assert {row.verdict for row in rates if row.method == "simulate"} == {TOO_RARE}


def test_a_scene_without_hits_names_what_finds_rare_ones() -> None:
    mount = Scene(
        structure=Isolator(mass=2.0, frequency_hz=12.0, zeta=0.1),
        impact_pairs=[ImpactPair(clearance=0.1, law=Viscoelastic(stiffness=1e5, loss_factor=0.3))],
        excitations=[TabulatedNoise(profile="mil-std-810h-truck-vertical-5hz")],
    )
    free = mount.replace(impact_pairs=[])
    found = [
        replace(simulate(each, paths=8, duration=2.0, threads=1), identities={})
        for each in (mount, free)
    ]
    assert ["no impact was seen" in compare([each]).summary() for each in found] == [True, False]


def test_nothing_to_judge_is_no_pass() -> None:
    verdict = check(oscillator(-1.0, 1.0, 1.0, damping=0.0), rel_error=0.02)
    assert not verdict.passed
    assert "nothing could be judged" in verdict.summary()


@pytest.mark.usefixtures("early_end")
def test_an_unfinished_simulation_is_no_pass_and_says_why() -> None:
    found = check(oscillator(-1.0, 1.0, 1.0), rel_error=1e-5)
    assert not found.passed
    assert found.summary().startswith("simulate stopped early")
    assert "raise budget" in found.summary()


@pytest.mark.parametrize("gap", [None, 1.0])
def test_a_number_that_is_zero_on_every_path_was_not_compared(gap: float | None) -> None:
    """The synthesis of a table has no mean, whatever the method does: no evidence for it."""
    pairs = [] if gap is None else [ImpactPair(upper=gap, law=Restitution(coefficient=0.8))]
    scene = Scene(
        structure=Isolator(frequency_hz=12.0, zeta=0.1),
        impact_pairs=pairs,
        excitations=[TabulatedNoise(profile="mil-std-810h-truck-vertical-5hz")],
    )
    verdict = check(scene, rel_error=0.1)
    rows = [row for row in verdict.comparisons if row.method == "simulate"]
    (force,) = (row for row in rows if (row.of, row.quantity) == ("balance", "force"))
    assert abs(force.value) < 1e-15
    assert (force.verdict, force.tolerance, force.score) == (ZERO, None, None)
    for row in rows:
        assert (row.verdict == ZERO) == (row.quantity in ("force", "displacement_mean"))


def test_a_mean_that_hits_push_away_is_compared() -> None:
    verdict = check(oscillator(-1.0, 1.0, 1.0), rel_error=0.05)
    assert ZERO not in {row.verdict for row in verdict.comparisons}


def test_rates_above_another_speed_are_not_compared() -> None:
    """Averaging counts all impacts, the reference those above a threshold; F1 counts all."""
    scene = oscillator(-1.0, 1.0, 0.8)
    verdict = compare([fokker_planck(scene)], [average(scene)])
    found = {
        row.quantity: row.verdict for row in verdict.comparisons if row.method[:7] == "average"
    }
    assert found["collision_rate"] == found["impact_speed_mean"] == OTHER_THRESHOLD
    assert found["impact_speed_rate"] == found["velocity_std"] == APPROXIMATE
    elastic = oscillator(-1.0, 1.0, 1.0)
    alike = compare([exact(elastic)], [average(elastic)])
    assert OTHER_THRESHOLD not in {row.verdict for row in alike.comparisons}


def test_a_coordinate_at_rest_agrees_whatever_rounding_leaves() -> None:
    """Rounding errors of one coordinate beside the motion of another are not compared; a motion
    that is small, but larger than that, is."""

    def answer(method: str, y: float) -> Response:
        coordinates = {
            name: CoordinateResponse(displacement_std=Estimate(value=value, how=method))
            for name, value in (("x", 1e-3), ("y", y))
        }
        return Response(
            method=method, coordinates=coordinates, impact_pairs={}, identities={}, effects=[],
            assumptions=[], warnings=[], cost=Cost(), provenance={},
        )  # fmt: skip

    for one, other, agrees in ((1e-19, 2e-19, True), (1e-9, 2e-9, False)):
        found = compare([answer("one", one), answer("other", other)])
        assert found.passed == agrees
