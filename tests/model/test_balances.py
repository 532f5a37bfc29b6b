"""Balances of energy, virial and force, with moments that are known from elsewhere."""

import math
from dataclasses import replace

import pytest

from stochvi import Absorber, Oscillator, Restitution, Scene, WhiteNoise, exact
from stochvi.model.balances import residuals
from stochvi.model.model import model_of
from support.known import RIGID_STOPS, RigidStops, oscillator, values


def moments_of(found: dict[str, float]) -> dict[tuple[str, str], float]:
    """Of an oscillator between two stops at equal distances."""
    sides = {
        ("stops", f"{short}_{side}"): found[name] / 2.0
        for side in ("lower", "upper")
        for short, name in (("f1", "impact_speed_rate"), ("f2", "impact_speed_square_rate"))
    }
    return sides | {
        ("x", "x"): 0.0,
        ("x", "variance"): found["displacement_std"] ** 2,
        ("x", "vv"): found["velocity_std"] ** 2,
    }


@pytest.mark.parametrize("row", RIGID_STOPS, ids=lambda row: f"R={row.restitution:g}")
def test_near_exact_moments_balance_to_their_last_digits(row: RigidStops) -> None:
    model = model_of(oscillator(-1.0, 1.0, row.restitution))
    found = residuals(model, moments_of(row.values), (0.0,))
    assert set(found) == {"energy", "virial", "force"}
    # no term is larger than the one that a residual is relative to
    allowed = sum(2.0 * row.errors[name] / abs(row.values[name]) for name in row.errors)
    for name, value in found.items():
        assert abs(value) <= allowed + 1e-14, name


def test_another_restitution_does_not_balance() -> None:
    row = next(row for row in RIGID_STOPS if 0.0 < row.restitution < 1.0)
    model = model_of(oscillator(-1.0, 1.0, row.restitution - 0.01))
    found = residuals(model, moments_of(row.values), (0.0,))
    assert abs(found["energy"]) > 1e-3 and abs(found["virial"]) > 1e-3


@pytest.mark.parametrize("load", [0.0, 1.5])
def test_a_load_and_any_origin_balance(load: float) -> None:
    scene = oscillator(-0.7, 0.4, load=load)
    model, known = model_of(scene), values(exact(scene))
    square = known["velocity_mean_square"]
    moments = {
        ("x", "x"): known["displacement_mean"],
        ("x", "variance"): known["displacement_std"] ** 2,
        ("x", "vv"): square,
    }
    for side in ("lower", "upper"):
        # Rayleigh speeds: F1 = rate s sqrt(pi / 2), F2 = 2 rate s^2
        rate = known[f"collision_rate_{side}"]
        moments["stops", f"f1_{side}"] = rate * math.sqrt(math.pi * square / 2.0)
        moments["stops", f"f2_{side}"] = 2.0 * rate * square
    for origin in (0.0, 3.0, -0.2):
        for name, value in residuals(model, moments, (origin,)).items():
            assert value == pytest.approx(0.0, abs=1e-12), (name, origin)


def test_two_masses_and_a_box_that_loses_nothing_balance() -> None:
    """m E v^2 = theta = 1 of both masses, the relative position uniform and independent."""
    scene = Scene(
        structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
        absorber=Absorber(mass=0.1, play=2.0, law=Restitution(coefficient=1.0)),
        excitations=[WhiteNoise(intensity=0.2)],
    )
    model = model_of(scene)
    relative = math.sqrt(1.0 + 10.0)
    first, second = model.coordinates
    moments = {
        (first, "x"): 0.0, (first, "variance"): 1.0,
        (second, "x"): 0.0, (second, "variance"): 1.0 + 1.0 / 3.0,
        ("", "kinetic"): 2.0, ("", "potential"): 1.0, ("", "dissipation"): 0.1,
    }  # fmt: skip
    for side in ("lower", "upper"):
        moments["box", f"f1_{side}"] = 0.5 * relative**2 / 2.0
        moments["box", f"f2_{side}"] = 0.5 * relative**3 * math.sqrt(2.0 / math.pi)
    for name, value in residuals(model, moments, (0.0, 0.0)).items():
        assert value == pytest.approx(0.0, abs=1e-12), name
    # the reduced mass counts: a pair of another mass balances no virial
    (pair,) = model.pairs
    wrong = replace(model, pairs=(replace(pair, mass=1.1 * pair.mass),))
    assert abs(residuals(wrong, moments, (0.0, 0.0))["virial"]) > 0.01


def test_a_coordinate_at_rest_is_missed_by_nothing() -> None:
    """A box on its mounts over a stop below its centre, shaken along z: what rounding moves along y
    is no fault, but a force along y that is missing is one, however small beside those along z."""
    mounts = [
        {"at": [x, y, -0.06], "stiffness": [2.2e4, 2.2e4, 3.4e4], "damping": [9.0, 9.0, 14.0]}
        for x in (-0.2, 0.2)
        for y in (-0.15, 0.15)
    ]
    box = {"kind": "rigid-body", "mass": 12.0, "inertia": [0.2, 0.25, 0.15], "mount": mounts}
    stop = {
        "name": "s", "at": [0.0, 0.0, -0.08], "direction": [0, 0, 1], "lower": -8e-4,
        "law": {"kind": "restitution", "coefficient": 0.4},
    }  # fmt: skip
    shaken = {
        "kind": "psd",
        "axis": "z",
        "frequency_hz": [5.0, 500.0],
        "density": [0.1, 0.1],
        "unit": "(m/s2)2/Hz",
    }
    model = model_of(Scene(structure=box, impact_pair=[stop], excitation=[shaken]))  # type: ignore[call-arg]
    rate = 20.0

    def missed(**means: float) -> dict[str, float]:
        moments = {
            (name, moment): value
            for name in model.coordinates
            for moment, value in (("x", means.get(name, 3e-20)), ("variance", 1e-38))
        }
        moments |= {("z", "variance"): 1e-6, ("s", "f1_lower"): rate, ("s", "f2_lower"): 2.0}
        return residuals(model, moments, [0.0] * len(model.coordinates))

    lifted = 12.0 * 1.4 * rate / (4.0 * 3.4e4)
    found = missed(z=lifted)
    assert {name.removeprefix("force on ") for name in found} == set(model.coordinates)
    for name, value in found.items():
        assert abs(value) < 1e-12, name
    assert abs(missed(z=0.9 * lifted)["force on z"]) > 0.05
    assert abs(missed(z=lifted, y=1e-6 * lifted)["force on y"]) > 0.5
