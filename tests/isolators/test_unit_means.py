"""Means over units of any method's answer: against integrals, and brute force over many units."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import norm

from stochvi import (
    Elastic,
    ImpactPair,
    Oscillator,
    Restitution,
    Scene,
    Viscoelastic,
    WhiteNoise,
    exact,
    mean_over_units,
)
from stochvi.isolators import Spread
from stochvi.isolators.production_risk.units import Units
from stochvi.model.model import model_of
from stochvi.statistics.pair_crossings import own_distances
from stochvi.sweeps import sweep
from support.accuracies import quick_cases

RATE = "stops.collision_rate"


def between(law: Any, lower: float | None = -1.0, upper: float | None = 1.0) -> Scene:
    return Scene(
        structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
        impact_pairs=[ImpactPair(lower=lower, upper=upper, law=law)],
        excitations=[WhiteNoise(intensity=0.2)],
    )


def of(table: Any, quantity: str = RATE) -> dict[str, float]:
    found: dict[str, float] = table.set_index("quantity").loc[quantity].to_dict()
    return found


def test_the_mean_over_gaussian_clearances_is_an_integral() -> None:
    scene, std = between(Restitution(coefficient=1.0), lower=None), 0.2

    def rate(off: float) -> float:
        pair = scene.impact_pairs[0].model_copy(update={"upper": 1.0 + off})
        response = exact(scene.model_copy(update={"impact_pairs": (pair,)}))
        found: float = response.impact_pairs["stops"].collision_rate.value  # type: ignore[union-attr]
        return found

    moments = [
        quad(lambda x, k=k: rate(std * x) ** k * norm.pdf(x), -8.0, 8.0, epsrel=1e-8)[0]
        for k in (1, 2)
    ]
    found = of(mean_over_units(scene, {"clearance": Spread(std=std)}, method="exact", nodes=7))
    assert found["mean"] == pytest.approx(moments[0], rel=1e-6)
    between_units = math.sqrt(moments[1] - moments[0] ** 2)
    assert found["std_between_units"] == pytest.approx(between_units, rel=1e-4)
    # the control: the unit as stated has another rate
    assert abs(rate(0.0) - moments[0]) > 1e-3 * moments[0]


def test_what_few_nodes_leave_out_of_a_rare_mean_is_its_bias() -> None:
    """A stop at 4 rms displacements, which are 1 m, that is off by up to 0.8 of them between units:
    an elastic stop at u is hit exp(-u^2 / 2) / (2 pi Phi(u)) times a second."""
    place = 4.0
    scene = between(Restitution(coefficient=1.0), lower=None, upper=place)
    for std, nodes, fine in ((0.8, 3, False), (0.8, 5, False), (0.8, 15, True), (0.1, 5, True)):

        def part(x: float, std: float = std) -> float:
            u = place + std * x
            return float(math.exp(-0.5 * u**2) / (2.0 * math.pi * norm.cdf(u)) * norm.pdf(x))

        own = quad(part, -8.0, 8.0, epsrel=1e-9)[0]
        spreads = {"clearance": Spread(std=std)}
        found = of(mean_over_units(scene, spreads, method="exact", nodes=nodes))
        assert abs(found["mean"] - own) < found["bias"] + 1e-6 * own, (std, nodes)
        assert (found["bias"] < 0.02 * own) == fine, (std, nodes)


def test_statistical_errors_are_not_taken_for_differences_between_units() -> None:
    scene = between(Restitution(coefficient=1.0))
    spreads = {"damping": Spread(half_width=0.3)}
    # fewer paths than an answer would take: the errors are large beside what differs
    found = of(
        mean_over_units(
            scene, spreads, nodes=3, paths=64, duration=100.0, seed=5, threads=1
        )
    )  # fmt: skip
    truth = of(mean_over_units(scene, spreads, method="exact", nodes=3))
    error = 4.5 * found["standard_error"]
    assert found["mean"] == pytest.approx(truth["mean"], abs=error + found["bias"])
    assert found["standard_error"] > 0.0
    assert found["std_between_units"] == pytest.approx(
        truth["std_between_units"], abs=4.5 * math.sqrt(3.0) * found["standard_error"]
    )


SOFT = Viscoelastic(stiffness=40.0, damping_ratio=0.1)
LOSSY = Restitution(coefficient=0.6)
SPREAD = Spread(std=0.1)
CASES: list[tuple[str, Scene, dict[str, Spread]]] = [
    ("exact", between(Elastic(stiffness=30.0)), {"stiffness": Spread(std=0.2)}),
    ("closure", between(LOSSY), {"restitution": Spread(half_width=0.2), "clearance": SPREAD}),
    ("exact", between(Restitution(coefficient=1.0)), {"clearance": SPREAD}),
    ("exact", between(Restitution(coefficient=1.0)), {"frequency": SPREAD, "level": SPREAD}),
    ("exact", between(Elastic(stiffness=5.0)), {"clearance": Spread(half_width=0.3)}),
    ("exact", between(Elastic(stiffness=30.0), upper=None), {"damping": Spread(std=0.2)}),
    ("closure", between(SOFT), {"stiffness": Spread(half_width=0.5), "damping": SPREAD}),
    ("closure", between(LOSSY, upper=None), {"clearance": Spread(std=0.2)}),
    ("fokker-planck", between(LOSSY), {"restitution": Spread(half_width=0.2)}),
    ("fokker-planck", between(SOFT), {"stiffness": Spread(std=0.2)}),
    ("average", between(Restitution(coefficient=0.95)), {"level": Spread(std=1.0)}),
    ("average", between(Restitution(coefficient=0.95)), {"damping": Spread(std=0.15, mean=0.1)}),
]


@quick_cases(("method", "scene", "spreads"), CASES, keep=(0,))
def test_the_mean_is_that_of_many_units(
    method: str, scene: Scene, spreads: dict[str, Spread]
) -> None:
    table = mean_over_units(scene, spreads, method=method)
    stops = np.array(own_distances(model_of(scene)))
    units = Units(scene=scene, spreads=spreads, mean=model_of(scene).mean_gaps, stops=stops)
    points = np.random.default_rng(4).random((80, len(units.columns)))
    quantity = RATE if method != "average" else "x.velocity_mean_square"
    values = [
        float(sweep(units.built(row), {"structure.mass": [1.0]}, method=method)[quantity].iloc[0])
        for row in units.drawn(points)
    ]
    # the method errs alike in both; its bias may be unknown
    found, error = (
        of(table.fillna({"bias": 0.0}), quantity),
        float(np.std(values, ddof=1)) / math.sqrt(len(values)),
    )
    assert found["mean"] == pytest.approx(float(np.mean(values)), abs=4.5 * error + found["bias"])
    # the standard deviation of n values is known to 1 / sqrt(2 n), of a normal distribution
    known = 4.5 * float(np.std(values)) / math.sqrt(len(values))
    assert found["std_between_units"] == pytest.approx(
        float(np.std(values, ddof=1)), abs=known + found["bias"]
    )
    assert found["std_between_units"] > 4.5 * error / math.sqrt(len(values))


def test_spreads_that_have_no_nodes_are_refused() -> None:
    scene = between(LOSSY)
    with pytest.raises(ValueError, match="nodes of frequency must stay above -95 %"):
        mean_over_units(scene, {"frequency": Spread(std=0.4)}, method="closure", nodes=7)
    with pytest.raises(ValueError, match="at most 10000 combinations of nodes"):
        mean_over_units(scene, {"clearance": SPREAD, "level": SPREAD}, nodes=30)
    with pytest.raises(ValueError, match="method must be one of"):
        mean_over_units(scene, {"clearance": SPREAD}, method="guess")
