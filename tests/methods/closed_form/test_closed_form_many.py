"""Closed forms of several coordinates: printed numbers, brute force, Monte Carlo, identities."""

from __future__ import annotations

import math

import numpy as np
import pytest

from stochvi.methods.closed_form import exact, unmet
from stochvi.methods.monte_carlo import simulate
from stochvi.model.model import model_of
from stochvi.results.errors import NoExactSolution
from stochvi.scenes.excitations import ConstantLoad, FilteredNoise, Sine, TabulatedNoise, WhiteNoise
from stochvi.scenes.impact_laws import Elastic, Hertz, Restitution
from stochvi.scenes.scene import ImpactPair, Scene
from stochvi.scenes.structures import Matrices, Oscillator
from stochvi.testing import assert_agrees
from support.accuracies import assert_differs

ROUNDING = 1e-12
RIGID = Restitution(coefficient=1.0)


def pair(first: str, second: str | None = None, low=-1.0, high=1.0, law=RIGID) -> ImpactPair:
    """Between two coordinates, or on one; named after the first."""
    where = {"on": first} if second is None else {"between": [first, second]}
    return ImpactPair(
        name=f"{first} stops" if second is None else f"{first}-{second} stops",
        lower=low,
        upper=high,
        law=law,
        **where,
    )


def scene(mass, damping, stiffness, pairs=(), loads=(), noise=None) -> Scene:
    """Coordinates a, b, ...; white noise on each, 2 theta times its damping with theta = 1."""
    names = "abcdefgh"[: len(mass)]
    intensities = 2.0 * np.diag(damping) if noise is None else noise
    white = [
        WhiteNoise(on=name, intensity=float(size))
        for name, size in zip(names, intensities, strict=True)
        if size
    ]
    return Scene(
        structure=Matrices(
            coordinates=list(names), mass=np.diag(mass), damping=damping, stiffness=stiffness
        ),
        impact_pairs=list(pairs),
        excitations=white + [ConstantLoad(on=name, force=force) for name, force in loads],
    )


def absorber(spring: float = 0.0, play: float = 2.0, law=RIGID, **changes) -> Scene:
    """A mass of 0.1 on one of 1, in a box of play 2 or on a spring between its stops."""
    given = {
        "mass": [1.0, 0.1],
        "damping": np.diag([0.1, 0.0]),
        "stiffness": [[1.0 + spring, -spring], [-spring, spring]],
        "pairs": [pair("b", "a", -play / 2, play / 2, law)],
    }
    return scene(**{**given, **changes})


def found(case: Scene) -> dict[tuple[str, str], float]:
    return {key: item.value for key, item in exact(case).estimates().items()}


# Printed and textbook values ----------------------------------------------------------------


def test_a_free_absorber_in_a_box_leaves_the_structure_as_it_was():
    """The paradox of B 17.39, and the printed rate sqrt(theta (1/m1 + 1/m2)) sqrt(2/pi) / d."""
    values = found(absorber())
    assert values["b-a stops", "collision_rate"] == pytest.approx(1.32314185710031, rel=1e-14)
    assert values["a", "displacement_mean_square"] == pytest.approx(1.0, rel=ROUNDING)
    assert 0.1 * values["b", "velocity_mean_square"] == pytest.approx(1.0, rel=ROUNDING)
    # the relative position is uniform on +-1 and independent of the structure
    assert values["b", "displacement_mean_square"] == pytest.approx(1.0 + 1.0 / 3.0, rel=ROUNDING)


def test_a_sprung_absorber_leaves_the_structure_and_is_cut_at_its_stops():
    values = found(absorber(spring=0.5, play=2.0))
    assert values["a", "displacement_mean_square"] == pytest.approx(1.0, rel=ROUNDING)
    # y = x2 - x1 is N(0, theta / k2) cut at +-1
    s = math.sqrt(1.0 / 0.5)
    shape = math.exp(-0.5 / s**2) / math.sqrt(2.0 * math.pi) / s
    mass = math.erf(1.0 / s / math.sqrt(2.0))
    rate = shape / mass * math.sqrt(11.0 / (2.0 * math.pi))
    assert values["b-a stops", "collision_rate_upper"] == pytest.approx(rate, rel=ROUNDING)
    variance = s**2 * (1.0 - 2.0 * shape / mass)
    assert values["b", "displacement_mean_square"] == pytest.approx(1.0 + variance, rel=ROUNDING)


def test_one_coordinate_as_a_matrix_is_the_oscillator():
    """The same scene written in matrices: rigid on one side, Hertz on the other, and a load."""
    ends = {"lower_law": RIGID, "upper_law": Hertz(coefficient=30.0), "lower": -0.6, "upper": 0.8}
    noise = [WhiteNoise(on="x", intensity=0.5), ConstantLoad(on="x", force=0.3)]
    alone = Scene(
        structure=Oscillator(mass=2.0, damping=0.2, stiffness=1.5),
        impact_pairs=[ImpactPair(**ends)],
        excitations=noise,
    )
    as_matrix = Scene(
        structure=Matrices(coordinates=["x"], mass=[[2.0]], damping=[[0.2]], stiffness=[[1.5]]),
        impact_pairs=[ImpactPair(**ends)],
        excitations=noise,
    )
    one, two = found(alone), found(as_matrix)
    assert two == pytest.approx(one, rel=ROUNDING)


# Against brute force ------------------------------------------------------------------------


def brute(case: Scene, nodes: int, reach: float = 9.0) -> dict[tuple[str, str], float]:
    """Moments and rates of exp(-U(q) / theta) on a grid of the coordinates themselves.

    Rigid stops are the limits of the grid in pair coordinates: q = T u with u the pairs', then
    as many of the others as make it square. Panels end at every stop.
    """
    model = model_of(case)
    rows = [pair.direction for pair in model.pairs]
    for row in np.eye(len(model.mass)):
        if np.linalg.matrix_rank(np.array([*rows, row])) > len(rows):
            rows.append(row)
    to_q = np.linalg.inv(np.array(rows))
    root, weight = np.polynomial.legendre.leggauss(nodes)
    axes, weights = [], []
    for number in range(len(rows)):
        edges = {-reach, reach}
        if number < len(model.pairs):
            for stop in model.pairs[number].stops:
                edges.add(stop.position)
                edges -= {stop.side * reach} if stop.rigid else set()
        ends = np.array(sorted(edges))
        half = np.diff(ends)[:, None] / 2.0
        axes.append(((ends[:-1, None] + ends[1:, None]) / 2.0 + half * root).ravel())
        weights.append((half * weight).ravel())

    def density(places):
        u = np.array(np.meshgrid(*places, indexing="ij"))
        q = np.einsum("ij,j...->i...", to_q, u)
        energy = 0.5 * np.einsum("i...,ij,j...->...", q, model.stiffness, q)
        energy = energy - np.einsum("i,i...->...", model.constant_force, q)
        for number, pair in enumerate(model.pairs):
            for stop in pair.stops:
                if not stop.rigid:
                    energy = energy + stop.law.potential_at(stop.deflection(u[number]))
        return q, np.exp(-energy / model.temperature)

    def total(of_weights, values):
        for weight_of in np.ix_(*of_weights):
            values = values * weight_of
        return float(values.sum())

    q, p = density(axes)
    mass = total(weights, p)
    values = {}
    for row, name in enumerate(model.coordinates):
        values[name, "displacement_mean"] = total(weights, p * q[row]) / mass
        values[name, "displacement_mean_square"] = total(weights, p * q[row] ** 2) / mass
    for number, pair in enumerate(model.pairs):
        speed = math.sqrt(model.temperature / pair.mass / (2.0 * math.pi))
        for stop in pair.stops:
            plane = [*axes[:number], np.array([stop.position]), *axes[number + 1 :]]
            thin = [*weights[:number], np.ones(1), *weights[number + 1 :]]
            hits = total(thin, density(plane)[1]) / mass * speed
            values[pair.name, f"collision_rate_{stop.name}"] = hits
    return values


CHAIN = np.array([[2.0, -0.7, 0.0], [-0.7, 1.8, -0.6], [0.0, -0.6, 1.2]])
DAMPING = np.diag([0.1, 0.2, 0.0])

CASES = {
    "sprung absorber, elastic stops": absorber(
        spring=0.3, law=Elastic(stiffness=5.0), loads=[("b", 0.4)]
    ),
    "chain of three, one pair": scene(
        [1.0, 0.5, 2.0], DAMPING, CHAIN, [pair("b", "a", -0.3, 0.9)], [("a", 0.5)]
    ),
    "two pairs that springs couple": scene(
        [1.0, 0.5], DAMPING[:2, :2], CHAIN[:2, :2],
        [pair("a", None, -0.4, 0.7), pair("b", None, -0.5, 1.0)], [("b", 0.3)],
    ),
    "two pairs, a rigid box and a spring": scene(
        [1.0, 0.5], DAMPING[:2, :2], CHAIN[:2, :2],
        [pair("a", None, None, 0.7), pair("b", "a", -0.5, 0.4, Elastic(stiffness=40.0))],
    ),
    "three pairs": scene(
        [1.0, 0.5, 2.0], DAMPING, CHAIN,
        [pair("a", None, -0.6, 0.6), pair("b", "a", -0.5, 0.8), pair("c", "b", None, 0.5)],
        [("c", 0.4)],
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_moments_and_rates_are_the_integrals_of_the_gibbs_density(name):
    case = CASES[name]
    few, many = (60, 90) if len(case.structure.coordinates) > 2 else (120, 160)
    coarse, fine = brute(case, few), brute(case, many)
    values = exact(case).estimates()
    for key, value in fine.items():
        error = abs(value - coarse[key]) + ROUNDING * (1.0 + abs(value))
        assert abs(values[key].value - value) <= error + values[key].bias, key
        # the brute force tells apart what a wrong formula would give
        assert error < 1e-6


@pytest.mark.parametrize("name", CASES)
def test_the_balances_vanish(name):
    balances = exact(CASES[name]).identities
    expected = {"energy", *(f"force on {row}" for row in CASES[name].structure.coordinates)}
    rigid = model_of(CASES[name]).rigid
    assert set(balances) == expected | ({"virial"} if rigid else set())
    for balance, residual in balances.items():
        assert abs(residual.value) <= residual.bias + 1e-11, balance


def test_pairs_that_nothing_couples_are_each_on_its_own():
    """A chain a - b - c whose springs and stops lie between the same neighbours: any number."""
    stiffness = np.array([[3.0, -1.0, 0, 0], [-1, 2, -1, 0], [0, -1, 2, -1], [0, 0, -1, 1]])
    stops = [pair(two, one, -0.4, 0.8) for one, two in ("ab", "bc", "cd")] + [pair("a")]
    case = scene([1.0] * 4, np.diag([0.1] * 4), stiffness, stops)
    values = found(case)
    # springs 2 to the ground and 1 in the chain: y is N(0, 1) cut at the stops
    low, high = -0.4, 0.8
    mass = (math.erf(high / math.sqrt(2)) - math.erf(low / math.sqrt(2))) / 2.0
    density = math.exp(-0.5 * high**2) / math.sqrt(2.0 * math.pi) / mass
    rate = density * math.sqrt(2.0 / (2.0 * math.pi))
    for name in ("b-a", "c-b", "d-c"):
        assert values[f"{name} stops", "collision_rate_upper"] == pytest.approx(rate, rel=ROUNDING)
    squares = [values[name, "displacement_std"] ** 2 for name in "abcd"]
    assert np.diff(squares) == pytest.approx([squares[1] - squares[0]] * 3, rel=1e-10)


# Against Monte Carlo ------------------------------------------------------------------------


def test_monte_carlo_agrees_and_would_not_with_the_wrong_play():
    case = CASES["two pairs that springs couple"]
    known = found(case)
    simulated = simulate(case, paths=1024, duration=100.0, seed=3).estimates()
    keys = [key for key in known if key in simulated and "_lower" not in key[1]]
    assert len(keys) > 12
    for key in keys:
        assert_agrees(simulated[key], known[key])
    wider = found(
        scene(
            [1.0, 0.5], DAMPING[:2, :2], CHAIN[:2, :2],
            [pair("a", None, -0.4, 0.8), pair("b", None, -0.5, 1.0)], [("b", 0.3)],
        )
    )  # fmt: skip
    assert_differs(simulated["a stops", "collision_rate"], wider["a stops", "collision_rate"])


# Without stops ------------------------------------------------------------------------------


def by_frequency(case: Scene) -> np.ndarray:
    """Covariance of the displacements as an integral over frequency."""
    model = model_of(case)
    total = np.zeros_like(model.mass)
    t = np.linspace(-22.0, 9.0, 6001)
    for x, step in zip(np.exp(t), np.exp(t) * (t[1] - t[0]), strict=True):
        gain = np.linalg.inv(model.stiffness - x**2 * model.mass + 1j * x * model.damping)
        density = model.white.astype(complex)
        for signal in model.signals:
            filtered = signal.omega**2 / (signal.omega**2 - x**2 + 1j * x * signal.damping_rate)
            force = signal.intensity * abs(filtered) ** 2
            density = density + force * np.outer(signal.direction, signal.direction)
        total += (gain @ density @ gain.conj().T).real * step / math.pi
    return total


def test_linear_structures_under_any_noise_that_is_not_matched():
    """Base noise and filtered noise, by the integral over frequency (trapezoids in log w)."""
    structure = Matrices(
        coordinates=["a", "b"], mass=[[1.0, 0.0], [0.0, 0.5]], damping=[[0.3, -0.1], [-0.1, 0.2]],
        stiffness=[[2.0, -0.7], [-0.7, 1.8]],
    )  # fmt: skip
    filtered = FilteredNoise(on="b", intensity=0.4, frequency_hz=0.2, zeta=0.3)
    excitations = [WhiteNoise(on="base", intensity=0.2), filtered, ConstantLoad(on="a", force=0.5)]
    case = Scene(structure=structure, excitations=excitations)
    values, covariance = found(case), by_frequency(case)
    mean = np.linalg.solve(model_of(case).stiffness, [0.5, 0.0])
    for row, name in enumerate("ab"):
        assert values[name, "displacement_std"] ** 2 == pytest.approx(
            covariance[row, row], rel=1e-7
        )
        assert values[name, "displacement_mean"] == pytest.approx(mean[row], rel=ROUNDING)
    one = Scene(structure=Oscillator(mass=1.0, damping=0.3, stiffness=2.0), excitations=[
        filtered.model_copy(update={"on": "x"})
    ])  # fmt: skip
    assert found(one)["x", "displacement_std"] ** 2 == pytest.approx(
        by_frequency(one)[0, 0], rel=1e-7
    )


# What is not covered ------------------------------------------------------------------------


def base_shaken() -> Scene:
    case = absorber()
    return case.model_copy(update={"excitations": (WhiteNoise(on="base", intensity=0.2),)})


FOUR = np.diag([2.0] * 4) - 0.5 * (np.eye(4, k=1) + np.eye(4, k=-1))
TWO = {"mass": [1.0, 1.0], "damping": np.diag([0.1, 0.1])}


@pytest.mark.parametrize(
    ("case", "words"),
    [
        (absorber(law=Restitution(coefficient=0.8)), "restitution must be 1 .* got 0.8 at the low"),
        (base_shaken(), "must match damping.*noise of the base"),
        (absorber(noise=[0.3, 0.1]), "must match damping"),
        (absorber(noise=[0.0, 0.0], loads=[("a", 1.0)]), "must contain noise"),
        (scene(**TWO, stiffness=np.diag([1.0, 0.0]), pairs=[pair("a")]), "stiffness must hold"),
        (
            scene(**TWO, stiffness=np.diag([1.0, 0.0]), pairs=[pair("b", "a", None, 1.0)]),
            "springs or stops must hold the pair 'b-a stops'",
        ),
        (scene(**TWO, stiffness=np.diag([1.0, 0.0])), "must hold every coordinate"),
        (
            scene([1.0] * 4, np.diag([0.1] * 4), FOUR, [pair(name) for name in "abcd"]),
            "at most 3 impact pairs .* got 4",
        ),
        (
            scene(**TWO, stiffness=np.eye(2), pairs=[pair("a"), pair("b"), pair("b", "a")]),
            "independent coordinates",
        ),
        (
            scene([1.0] * 3, np.diag([0.1, 0.0, 0.0]), np.eye(3), [pair("b", "a")]),
            "must reach every motion",
        ),
    ],
)
def test_every_scene_that_is_not_covered_says_why(case, words):
    with pytest.raises(NoExactSolution, match=words):
        exact(case)
    assert unmet(model_of(case))


def test_colour_and_sines_are_named():
    table = TabulatedNoise(on="a", frequency_hz=[0.1, 1.0], density=[1.0, 1.0], unit="N2/Hz")
    for extra, words in [
        (FilteredNoise(on="a", intensity=0.4, frequency_hz=0.2, zeta=0.3), "filtered noise"),
        (Sine(on="a", amplitude=1.0, frequency_hz=0.2), "got a sine"),
        (table, "tabulated density"),
    ]:
        case = absorber()
        case = case.model_copy(update={"excitations": (*case.excitations, extra)})
        with pytest.raises(NoExactSolution, match=words):
            exact(case)


def test_coupled_pairs_pressed_deep_into_stiff_stops_do_not_depend_on_units():
    """The search for the place of the largest density must not: it once stalled at the start."""

    def mean(unit: float) -> list[float]:
        law = Hertz(coefficient=1e8 / unit**0.5)
        case = Scene(
            structure=Matrices(
                coordinates=["a", "b"],
                mass=[[1.0, 0.0], [0.0, 0.5]],
                damping=[[0.1, 0.0], [0.0, 0.2]],
                stiffness=[[2.0, -0.7], [-0.7, 1.8]],
            ),
            impact_pairs=[
                pair("a", None, -40.0 * unit, 70.0 * unit, law),
                pair("b", None, None, 20.0 * unit, law),
            ],
            excitations=[
                WhiteNoise(on="a", intensity=0.2 * unit**2),
                WhiteNoise(on="b", intensity=0.4 * unit**2),
                ConstantLoad(on="b", force=3e4 * unit),
            ],
        )
        return [found(case)[name, "displacement_mean"] / unit for name in "ab"]

    metres = mean(1.0)
    # the balance of forces on a, which hits nothing
    assert metres[0] == pytest.approx(0.7 / 2.0 * metres[1], rel=1e-9)
    for unit in (1e-3, 1e-6):
        assert mean(unit) == pytest.approx(metres, rel=1e-9)


def test_many_stops_that_lose_energy_are_counted_in_one_condition() -> None:
    lossy = Restitution(coefficient=0.5)
    springs = 2.0 * np.eye(3) - np.eye(3, k=1) - np.eye(3, k=-1)
    for names, said in (("ab", 4), ("abc", 1)):
        chain = scene(np.ones(3), np.eye(3), springs, [pair(name, law=lossy) for name in names])
        found = [each for each in unmet(model_of(chain)) if "restitution must be 1" in each]
        assert len(found) == said
        assert all("lower stop of a stops" in each for each in found[:1])
    assert "at 6 stops" in found[0]
