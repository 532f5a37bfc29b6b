"""The density of an averaged energy: against the closed form, its own averages, and its bands
against the Fokker-Planck equation."""

from __future__ import annotations

import math

import matplotlib.pyplot as plt
import numpy as np
import pytest

from stochvi import Scene, average
from stochvi.methods.averaging import AveragedDensity, average_density
from stochvi.methods.closed_form import exact_density
from stochvi.methods.fokker_planck import fokker_planck_density
from support.known import oscillator

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
