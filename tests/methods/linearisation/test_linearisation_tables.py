"""Linearisation of one oscillator in tabulated noise."""

from __future__ import annotations

import math

import numpy as np
import pytest

from stochvi.mathematics.spectra import response_moments
from stochvi.methods.linearisation import linearise
from stochvi.model.model import model_of
from stochvi.results.errors import NotConverged
from stochvi.scenes.excitations import Excitation, TabulatedNoise, WhiteNoise
from stochvi.scenes.impact_laws import Restitution
from stochvi.scenes.scene import ImpactPair, Scene
from stochvi.scenes.structures import Isolator
from support.accuracies import quick_cases
from support.linearised import WAYS, make_scene, value


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
