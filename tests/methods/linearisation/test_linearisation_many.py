"""Arrays of oscillators linearised at once: against `linearise`, exact laws and the balances."""

from __future__ import annotations

import math

import numpy as np
import pytest

from stochvi.mathematics.truncated_normal import TruncatedNormal
from stochvi.methods.closed_form import exact
from stochvi.methods.linearisation import linearise, linearise_many
from stochvi.methods.linearisation.array_closure import Linearised
from stochvi.methods.linearisation.truncated_normal_arrays import cut_laws
from stochvi.results.errors import NotApplicable
from stochvi.results.estimates import Estimate
from stochvi.results.response import Response
from stochvi.scenes.excitations import ConstantLoad, WhiteNoise
from stochvi.scenes.impact_laws import Restitution
from stochvi.scenes.scene import ImpactPair, Scene
from stochvi.scenes.structures import Oscillator
from support.linearised import make_scene

Columns = dict[str, np.ndarray]


def random_columns(rng: np.random.Generator, size: int, *, elastic: bool = False) -> Columns:
    """Any rigid stops: gaps of 1e-6 to 1e3 deviations, any R, preload, load, S0 over 20 decades."""
    omega = 10.0 ** rng.uniform(-2.0, 3.0, size)
    damping = 2.0 * omega * 10.0 ** rng.uniform(-4.0, 0.5, size)
    intensity = 10.0 ** rng.uniform(-12.0, 8.0, size)
    deviation = np.sqrt(intensity / (2.0 * damping)) / omega
    near, far = 10.0 ** rng.uniform(-6.0, 3.0, (2, size))
    preload = rng.uniform(0.0, 3.0, size)
    kind = rng.integers(0, 6, size)
    kinds = [kind == k for k in range(5)]
    nothing = np.full(size, np.inf)
    lower = np.select(kinds, [-near, -near, -nothing, -nothing, -near], -preload - near)
    upper = np.select(kinds, [near, far, near, -preload, nothing], -preload)
    one, two = rng.uniform(size=(2, size))
    one = np.where(rng.uniform(size=size) < 0.1, 0.0, one)
    two = np.where(rng.uniform(size=size) < 0.3, one, two)
    two = np.where(rng.uniform(size=size) < 0.05, 1.0, two)
    if elastic:
        one = two = np.ones(size)
    pressed = rng.uniform(size=size) < 0.5
    return {
        "omega": omega,
        "damping_rate": damping,
        "intensity": intensity,
        "load": np.where(pressed, rng.uniform(-3.0, 3.0, size), 0.0) * deviation * omega**2,
        "lower": lower * deviation,
        "upper": upper * deviation,
        "restitution_lower": one,
        "restitution_upper": two,
    }


def scene_of(columns: Columns, k: int) -> Scene:
    row = {name: float(column[k]) for name, column in columns.items()}
    laws = {
        side: None if math.isinf(row[side]) else Restitution(coefficient=row[f"restitution_{side}"])
        for side in ("lower", "upper")
    }
    pair = ImpactPair(
        lower=row["lower"] if laws["lower"] else None,
        upper=row["upper"] if laws["upper"] else None,
        law=laws["upper"] or laws["lower"],
        lower_law=laws["lower"] if laws["upper"] else None,
    )
    load = [ConstantLoad(force=row["load"])] if row["load"] else []
    return Scene(
        structure=Oscillator(mass=1.0, damping=row["damping_rate"], stiffness=row["omega"] ** 2),
        impact_pairs=[pair],
        excitations=[WhiteNoise(intensity=row["intensity"]), *load],
    )


def value(response: Response, name: str) -> float:
    groups = [*response.coordinates.values(), *response.impact_pairs.values()]
    found = next(group[name] for group in groups if name in group)
    assert isinstance(found, Estimate)
    return found.value


def differences(found: Linearised, k: int, other: Response) -> dict[str, float]:
    """Relative; of the mean in deviations; rates also to 1e-30 of the least time there is."""
    deviation = math.sqrt(found.variance[k])
    speed = math.sqrt(found.velocity_mean_square[k])
    mine = {
        "displacement_std": deviation,
        "velocity_std": speed,
        "collision_rate": found.rate_lower[k] + found.rate_upper[k],
        "impact_speed_rate": found.speed_rate_lower[k] + found.speed_rate_upper[k],
        "impact_speed_square_rate": found.speed_square_rate_lower[k]
        + found.speed_square_rate_upper[k],
    }
    floors = {"collision_rate": 1.0, "impact_speed_rate": speed, "impact_speed_square_rate": 1.0}
    apart = {}
    for name, number in mine.items():
        floor = 1e-30 * floors.get(name, 0.0) * speed / deviation * max(1.0, speed**2)
        apart[name] = abs(number - value(other, name)) / (value(other, name) + floor)
    apart["mean"] = abs(found.mean[k] - value(other, "displacement_mean")) / deviation
    return apart


def test_laws_agree_with_those_of_one_scene() -> None:
    rng = np.random.default_rng(0)
    size = 200
    lower, upper = -(10.0 ** rng.uniform(-3, 2, size)), 10.0 ** rng.uniform(-3, 2, size)
    curvature = rng.normal(size=size) * 10.0 ** rng.uniform(-3, 3, size) / (upper - lower) ** 2
    slope = rng.normal(size=size) * 10.0 ** rng.uniform(-3, 2, size) / (upper - lower)
    found = cut_laws(slope, curvature, lower, upper)
    for k in range(size):
        law = TruncatedNormal(
            slope=slope[k], curvature=curvature[k], lower=float(lower[k]), upper=float(upper[k])
        )
        centred = law._quadrature[0] - (law.mean - law.peak)
        deviation = math.sqrt(law.variance)
        assert found.mean[k] == pytest.approx(law.mean, abs=1e-10 * deviation)
        assert found.variance[k] == pytest.approx(law.variance, rel=1e-10)
        assert found.third[k] == pytest.approx(law.expect(centred**3), abs=1e-9 * deviation**3)
        assert found.fourth[k] == pytest.approx(law.expect(centred**4), rel=1e-9)
        for stop, density in ((upper[k], found.upper[k]), (lower[k], found.lower[k])):
            assert density == pytest.approx(law.density_at(float(stop)), rel=1e-9, abs=1e-290)


def test_agrees_with_linearise() -> None:
    columns = random_columns(np.random.default_rng(1), 60)
    found = linearise_many(**columns)
    for k in range(60):
        apart = differences(found, k, linearise(scene_of(columns, k)))
        assert max(apart.values()) < 1e-9, (k, apart)


def test_exact_for_elastic_stops() -> None:
    columns = random_columns(np.random.default_rng(2), 100, elastic=True)
    found = linearise_many(**columns)
    for k in range(100):
        apart = differences(found, k, exact(scene_of(columns, k)))
        assert max(apart.values()) < 1e-10, (k, apart)


def test_another_restitution_would_be_seen() -> None:
    """Negative control: R = .999 in place of 1 is far outside of the tolerance above."""
    columns = random_columns(np.random.default_rng(2), 200, elastic=True)
    wrong = linearise_many(**columns | {"restitution_upper": 0.999})
    hits = wrong.rate_upper * np.sqrt(columns["intensity"]) > 1e-3
    theta = columns["intensity"] / (2.0 * columns["damping_rate"])
    assert (np.abs(wrong.velocity_mean_square / theta - 1.0) > 1e-10).sum() > hits.sum() / 2 > 10


def balances(columns: Columns, found: Linearised) -> np.ndarray:
    """Residuals of energy, virial and force, relative to their largest terms."""
    c = columns
    lower = np.where(np.isfinite(c["lower"]), c["lower"], 0.0)
    upper = np.where(np.isfinite(c["upper"]), c["upper"], 0.0)
    low, high = 1.0 + c["restitution_lower"], 1.0 + c["restitution_upper"]
    square = found.velocity_mean_square
    loss = (1.0 - c["restitution_lower"] ** 2) * found.speed_square_rate_lower
    loss = loss + (1.0 - c["restitution_upper"] ** 2) * found.speed_square_rate_upper
    push, pull = low * found.speed_rate_lower, high * found.speed_rate_upper
    spring = c["omega"] ** 2
    away = spring * found.mean - c["load"]
    virial = spring * found.variance + push * (found.mean - lower) + pull * (upper - found.mean)
    return np.array(
        [
            (c["damping_rate"] * square + loss / 2.0) / (c["intensity"] / 2.0) - 1.0,
            virial / square - 1.0,
            (away + pull - push) / (np.abs(away) + pull + push + spring * np.sqrt(found.variance)),
        ]
    )


def test_every_one_of_many_thousand_is_answered() -> None:
    columns = random_columns(np.random.default_rng(3), 40_000)
    found = linearise_many(**columns)
    assert found.converged.all()
    assert all(np.isfinite(column).all() for column in found)
    assert (found.variance > 0.0).all()
    assert (found.rate_lower >= 0.0).all() and (found.rate_upper >= 0.0).all()
    # the distance from a stop is known to the rounding of the stop's place
    place = np.nan_to_num(
        np.maximum(np.abs(columns["lower"]), np.abs(columns["upper"])), posinf=0.0
    )
    place = np.maximum(place, np.abs(found.mean))
    rounding = 8.0 * np.finfo(float).eps * place / np.sqrt(found.variance)
    assert (np.abs(balances(columns, found)) < 1e-9 + rounding).all()
    wrong = columns | {"restitution_upper": columns["restitution_upper"] ** 2}
    assert np.abs(balances(wrong, found)).max() > 1e-2


def test_without_spring_or_damper() -> None:
    columns = {
        "omega": np.array([0.0, 0.0, 1.0, 0.0]),
        "damping_rate": np.array([0.1, 0.0, 0.0, 0.0]),
        "intensity": 0.2,
        "load": np.array([0.0, 0.0, 0.0, 1.0]),
        "lower": np.array([-1.0, -1.0, -np.inf, -np.inf]),
        "upper": 1.0,
        "restitution_lower": 0.5,
        "restitution_upper": 0.5,
    }
    found = linearise_many(**columns)
    assert found.converged.all()
    assert np.abs(balances(columns, found)).max() < 1e-9


def test_a_rate_of_1e_300_is_a_number() -> None:
    found = linearise_many(
        omega=1.0, damping_rate=0.1, intensity=0.2, lower=[-37.0], upper=37.0,
        restitution_lower=0.5, restitution_upper=0.5,
    )  # fmt: skip
    expected = 2.0 * math.exp(-(37.0**2) / 2.0) / (2.0 * math.pi)
    assert found.rate_lower[0] + found.rate_upper[0] == pytest.approx(expected, rel=1e-9)
    assert expected < 1e-297


def test_broadcasts_and_keeps_the_shape() -> None:
    gap = np.array([0.5, 1.0, 2.0])[:, None]
    found = linearise_many(
        omega=1.0, damping_rate=0.1, intensity=0.2, lower=-gap, upper=gap,
        restitution_lower=[0.2, 0.8], restitution_upper=[0.2, 0.8],
    )  # fmt: skip
    assert {column.shape for column in found} == {(3, 2)}
    alone = linearise_many(
        omega=1.0, damping_rate=0.1, intensity=0.2, lower=-2.0, upper=2.0,
        restitution_lower=0.8, restitution_upper=0.8,
    )  # fmt: skip
    assert found.variance[2, 1] == pytest.approx(float(alone.variance), rel=1e-12)


@pytest.mark.parametrize(
    ("change", "error", "words"),
    [
        ({"omega": np.nan}, ValueError, "omega must be numbers"),
        ({"intensity": -1.0}, ValueError, "intensity must be at least 0"),
        ({"intensity": 0.0}, NotApplicable, "intensity must be positive"),
        ({"restitution_upper": 1.2}, ValueError, "restitution_upper must be in"),
        ({"lower": 2.0}, ValueError, "lower must be below upper"),
        ({"omega": np.inf}, ValueError, "omega must be finite"),
        ({"omega": 0.0, "lower": -np.inf}, NotApplicable, "omega must be positive"),
        (
            {"damping_rate": 0.0, "restitution_upper": 1.0, "restitution_lower": 1.0},
            NotApplicable,
            "damping_rate must be positive",
        ),
    ],
)
def test_refuses_in_words(change: dict[str, float], error: type[Exception], words: str) -> None:
    right = {
        "omega": 1.0, "damping_rate": 0.1, "intensity": 0.2, "lower": -1.0, "upper": 1.0,
        "restitution_lower": 0.8, "restitution_upper": 0.8,
    }  # fmt: skip
    with pytest.raises(error, match=words):
        linearise_many(**right | change)


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize("damping", [0.0, 0.3])
@pytest.mark.parametrize("restitution", [0.5, 0.9])
def test_a_weight_on_a_lossy_stop_is_answered_alone_as_in_an_array(
    side: float, damping: float, restitution: float
) -> None:
    """Neither spring nor damper sets a speed: only the load and the noise do."""
    ends = (None, 0.3) if side > 0.0 else (-0.3, None)
    alone = linearise(
        make_scene(*ends, restitution=restitution, stiffness=0.0, damping=damping, load=side)
    )
    array = linearise_many(
        omega=0.0,
        damping_rate=damping,
        intensity=0.2,
        load=1.0,
        upper=0.3,
        restitution_upper=restitution,
    )
    x, stops = alone.coordinates["x"], alone.impact_pairs["stops"]
    assert x["displacement_mean"].value == pytest.approx(side * float(array.mean), rel=1e-9)
    assert x["displacement_std"].value ** 2 == pytest.approx(float(array.variance), rel=1e-9)
    assert stops["collision_rate"].value == pytest.approx(float(array.rate_upper), rel=1e-9)
