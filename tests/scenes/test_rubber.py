"""Stops given by loss factor, restitution or hardness, against contacts that are integrated."""

from __future__ import annotations

import math

import pytest
from scipy.integrate import solve_ivp

from stochvi import (
    Elastic,
    ImpactPair,
    Isolator,
    Scene,
    SceneError,
    Viscoelastic,
    WhiteNoise,
    linearise,
    load_scene,
)
from stochvi.mathematics.kelvin_voigt import damping_ratio_of
from stochvi.model.model import model_of
from stochvi.scenes.datasets import shipped_scene
from stochvi.scenes.impact_laws.rubber_data import youngs_modulus

STIFFNESS, MASS = 2.0e5, 1.7


def rebound(law: Viscoelastic, speed: float) -> float:
    """Restitution of a free mass: M y'' = -(K y + c y') integrated until the force ends."""
    damping = law.damping(MASS)

    def push(t: float, state: list[float]) -> float:
        return law.stiffness * state[0] + damping * state[1]

    def motion(t: float, state: list[float]) -> list[float]:
        return [state[1], -push(t, state) / MASS]

    push.terminal, push.direction = True, -1.0  # type: ignore[attr-defined]
    period = 2.0 * math.pi * math.sqrt(MASS / law.stiffness)
    found = solve_ivp(
        motion, (0.0, 20.0 * period), [0.0, speed], events=push, rtol=1e-11, atol=1e-15 * speed
    )
    return float(-found.y[1, -1] / speed)


@pytest.mark.parametrize("restitution", [0.95, 0.6, 0.3, 0.1])
@pytest.mark.parametrize("speed", [0.05, 3.0])
def test_a_free_mass_leaves_with_the_restitution_that_was_measured(
    restitution: float, speed: float
) -> None:
    law = Viscoelastic(stiffness=STIFFNESS, restitution=restitution, at_speed=speed)
    assert rebound(law, speed) == pytest.approx(restitution, rel=1e-8)
    assert law.restitution == pytest.approx(restitution, rel=1e-12)
    # half a period of the free oscillation is longer than the contact: its decay is another law
    logarithmic = -math.log(restitution) / math.hypot(math.pi, math.log(restitution))
    other = Viscoelastic(stiffness=STIFFNESS, damping_ratio=logarithmic)
    assert rebound(other, speed) != pytest.approx(restitution, rel=1e-8)


@pytest.mark.parametrize("restitution", [1e-200, 1e-6, 0.1, 0.5, 1.0 - 1e-9, 1.0])
def test_the_damping_ratio_of_any_restitution(restitution: float) -> None:
    law = Viscoelastic(stiffness=1.0, damping_ratio=damping_ratio_of(restitution))
    # the exponent, not the restitution, is known to twelve digits
    exponent = math.log(law.restitution)
    assert exponent == pytest.approx(math.log(restitution), rel=1e-12, abs=1e-13)


def test_a_loss_factor_is_the_energy_lost_over_that_stored() -> None:
    """In a cycle of amplitude Y at W = sqrt(K / M) a damper takes pi c W Y^2, and the spring stores
    K Y^2 / 2: their ratio is 2 pi times the loss factor."""
    law = Viscoelastic(stiffness=STIFFNESS, loss_factor=0.3)
    frequency = math.sqrt(STIFFNESS / MASS)
    lost, stored = math.pi * law.damping(MASS) * frequency, STIFFNESS / 2.0
    assert lost / stored / (2.0 * math.pi) == pytest.approx(0.3, rel=1e-12)


def test_the_modulus_of_a_hardness() -> None:
    # values of the relation as they are tabulated for rubber, MPa
    for hardness, modulus in ((30.0, 1.14), (50.0, 2.46), (60.0, 3.61), (70.0, 5.52)):
        assert youngs_modulus(hardness) / 1e6 == pytest.approx(modulus, abs=0.005)
    pad = Elastic(shore_a=60.0, area=4e-4, thickness=0.01)
    assert pad.stiffness == pytest.approx(youngs_modulus(60.0) * 0.04)
    assert pad.stiffness == Viscoelastic(
        shore_a=60.0, area=4e-4, thickness=0.01, loss_factor=0.1
    ).stiffness  # fmt: skip


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"stiffness": 1.0}, "damping_ratio is missing"),
        ({"stiffness": 1.0, "damping_rato": 0.1}, "did you mean 'damping_ratio'"),
        ({"stiffness": 1.0, "damping_ratio": 0.1, "loss_factor": 0.2}, "needs exactly one of"),
        ({"stiffness": 1.0, "loss_factor": 0.2, "at_speed": 1.0}, "needs exactly one of"),
        ({"stiffness": 1.0, "restitution": 1.2}, "restitution must be in (0, 1], got 1.2"),
        ({"stiffness": 1.0, "restitution": 0.0}, "restitution must be greater than 0, got 0.0"),
        ({"stiffness": 1.0, "loss_factor": "high"}, "loss_factor must be a finite number, got"),
        ({"stiffness": 1.0, "restitution": 0.5, "at_speed": -1.0}, "at_speed must be greater"),
        ({"shore_a": 60.0, "loss_factor": 0.1}, "takes stiffness, or shore_a with area"),
        (
            {"shore_a": 90.0, "area": 1.0, "thickness": 1.0, "loss_factor": 0.1},
            "shore_a must be from 20 to 80 Shore A, got 90",
        ),
        (
            {"shore_a": 60.0, "area": 1.0, "thickness": 1.0, "stiffness": 1.0, "loss_factor": 0.1},
            "takes stiffness, or shore_a with area",
        ),
    ],
)
def test_what_says_too_little_too_much_or_the_impossible_is_refused(keys, words: str) -> None:
    with pytest.raises(SceneError) as failure:
        Viscoelastic(**keys)
    assert words in str(failure.value)


def test_the_conversion_is_stated_and_the_document_needs_it_no_more() -> None:
    law = Viscoelastic(shore_a=60.0, area=4e-4, thickness=0.01, restitution=0.6, at_speed=0.5)
    scene = Scene(
        structure=Isolator(mass=1.0, stiffness=1e3, damping=1.0),
        impact_pairs=[ImpactPair(clearance=0.01, law=law)],
        excitations=[WhiteNoise(intensity=0.1)],
    )
    told = " ".join(scene.assumptions())
    for words in ("60 Shore A", "Gent 1958", "4 cm²", "restitution 0.6, measured at 0.5 m/s"):
        assert told.count(words) == 1
    keys = scene.document()["impact_pair"][0]["law"]
    assert Viscoelastic(**keys) == law and "restitution" not in keys
    assert Viscoelastic(**keys).restitution == pytest.approx(0.6, rel=1e-12)


@pytest.mark.parametrize("asked", [{"damping_ratio": 0.2}, {"loss_factor": 0.4}])
def test_a_ratio_of_a_tested_mass_keeps_its_damper_whatever_hits_the_stop(asked) -> None:
    tested = Viscoelastic(stiffness=STIFFNESS, mass=0.5, **asked)
    damper = 2.0 * 0.2 * math.sqrt(STIFFNESS * 0.5)
    speed = 0.7
    for mass in (0.5, MASS, 40.0):
        assert tested.damping(mass) == pytest.approx(damper, rel=1e-14)
        own = Viscoelastic(
            stiffness=STIFFNESS, damping_ratio=damper / 2.0 / (STIFFNESS * mass) ** 0.5
        )
        assert tested.impact(speed, mass) == pytest.approx(own.impact(speed, mass), rel=1e-12)
        structure = Isolator(mass=mass, stiffness=1e3 * mass, damping=10.0 * mass)
        found = [
            linearise(
                Scene(
                    structure=structure, excitations=[WhiteNoise(intensity=0.1 * mass**2)],
                    impact_pairs=[ImpactPair(clearance=0.004, law=law)],
                )
            ).to_dict()["coordinates"]["x"]
            for law in (tested, own, Viscoelastic(stiffness=STIFFNESS, **asked))
        ]  # fmt: skip
        sigma = [each["displacement_std"]["value"] for each in found]
        assert sigma[0] == pytest.approx(sigma[1], rel=1e-12)
        if mass != 0.5:  # without the mass of the test the damper is another one
            assert sigma[0] != pytest.approx(sigma[2], rel=1e-4)


def test_the_damper_of_a_test_is_that_of_every_number_of_modes() -> None:
    reed = load_scene(shipped_scene("beam"))
    tested = Viscoelastic(stiffness=2e4, damping_ratio=0.1, mass=0.5)
    for modes in (1, 4):
        structure = reed.structure.replace(modes=modes)
        pair = reed.impact_pairs[0].replace(law=tested)
        model = model_of(reed.replace(structure=structure, impact_pairs=[pair]))
        law, mass = model.stops[0].law, model.pairs[0].mass
        softer = 1.0 + 2e4 * structure.compliance({pair.on: 1.0})
        wanted = 2.0 * 0.1 * math.sqrt(2e4 * 0.5) / softer**2
        assert law.damping(mass) == pytest.approx(wanted, rel=1e-12)
