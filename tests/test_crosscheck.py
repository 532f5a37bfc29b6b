"""`check`: methods that agree pass, a wrong one is caught, approximations are only shown."""

from dataclasses import replace

import pytest
from known import oscillator

from stochvi import Estimate, Response, check, exact, load_scene, simulate
from stochvi.crosscheck import APPROXIMATE, DISAGREES, TOO_RARE, compare
from stochvi.datasets import shipped_scene


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


def test_nothing_to_judge_is_no_pass() -> None:
    verdict = check(oscillator(-1.0, 1.0, 1.0, damping=0.0), rel_error=0.02)
    assert not verdict.passed
    assert "nothing could be judged" in verdict.summary()
