"""Tables, and compliant stops, on several coordinates: the closure, its limits, its spectra."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from scipy.integrate import quad

from stochvi import (
    ImpactPair,
    Isolator,
    Oscillator,
    Restitution,
    Scene,
    TabulatedNoise,
    WhiteNoise,
    exact,
    linearise,
)
from stochvi.mathematics.arrays import Vector
from stochvi.methods.linearisation import linearise_all, linearised_structures
from stochvi.model.build_response import MOST_ENERGY_CHANGE
from stochvi.model.free_motion import free_motion
from stochvi.model.model import model_of
from stochvi.model.scales import scales_of
from stochvi.results.response import Response
from stochvi.scenes.excitations import ConstantLoad, Excitation, FilteredNoise, Sine
from stochvi.scenes.impact_laws import Elastic, ForceTable, Hertz, Law, Viscoelastic
from stochvi.scenes.structures import Matrices, Modes
from support.accuracies import quick_cases

DAMPING, STIFFNESS, MASS = (
    np.array([[0.3, -0.1], [-0.1, 0.1]]),
    np.array([[2.0, -1.0], [-1.0, 1.0]]),
    np.diag([1.0, 0.5]),
)
EDGES = [0.05, 0.3, 2.0]
TABLE = TabulatedNoise(on="base", frequency_hz=EDGES, density=[0.5, 0.8, 0.05], unit="(m/s2)2/Hz")
STEPS = ForceTable(deflection=[0.01, 0.1, 0.5], force=[0.5, 2.0, 60.0])
LOSSY = Viscoelastic(stiffness=60.0, damping_ratio=0.2)


def chain(pairs: list[ImpactPair], noise: list[Excitation]) -> Scene:
    """Two masses in a row; a carries b."""
    return Scene(
        structure=Matrices(
            coordinates=["a", "b"], mass=MASS.tolist(), damping=DAMPING.tolist(),
            stiffness=STIFFNESS.tolist(),
        ),
        impact_pairs=pairs,
        excitations=noise,
    )  # fmt: skip


def two_pairs(law: Law, noise: list[Excitation], other: Law | None = None) -> Scene:
    return chain(
        [
            ImpactPair(name="wall", on="a", lower=-0.8, upper=0.6, law=law),
            ImpactPair(name="link", between=("b", "a"), lower=-0.4, upper=0.4, law=other or law),
        ],
        noise,
    )


def value(response: Response, owner: str, name: str) -> float:
    return response.estimates()[owner, name].value


# Tables ---------------------------------------------------------------------------------------


def mean_square(
    row: list[float], density: float, stiffness: np.ndarray, damping: np.ndarray
) -> tuple[float, float]:
    """Of row . q and its rate under a base table, by adaptive quadrature of |H|^2 G."""
    force = -MASS.sum(axis=1)

    def shape(f: float) -> float:
        w = 2.0 * math.pi * f
        gain = np.array(row) @ np.linalg.solve(stiffness - w * w * MASS + 1j * w * damping, force)
        return float(abs(gain) ** 2 * density * TABLE.table(f))

    resonances = np.sqrt(np.linalg.eigvals(np.linalg.solve(MASS, stiffness)).real) / (2.0 * math.pi)
    edges = sorted({*EDGES, *(float(f) for f in resonances if EDGES[0] < f < EDGES[-1])})

    def integral(power: int) -> float:
        return sum(
            quad(lambda f: (2.0 * math.pi * f) ** power * shape(f), low, high, epsrel=1e-10)[0]
            for low, high in itertools.pairwise(edges)
        )

    return integral(0), integral(2)


def test_without_stops_a_table_is_answered_exactly() -> None:
    """Beside white noise, a filter, a sine and a load, each of which adds its own."""
    others = [
        WhiteNoise(on="a", intensity=0.1),
        FilteredNoise(on="b", intensity=0.1, frequency_hz=0.3, zeta=0.2),
        Sine(on="b", amplitude=0.3, frequency_hz=0.1),
    ]
    load = ConstantLoad(on="a", force=0.5)
    alone, rest = linearise(chain([], [TABLE, load])), linearise(chain([], [*others, load]))
    both = linearise(chain([], [TABLE, *others, load]))
    for name, row in (("a", [1.0, 0.0]), ("b", [0.0, 1.0])):
        expected = mean_square(row, 1.0, STIFFNESS, DAMPING)
        assert value(alone, name, "displacement_std") ** 2 == pytest.approx(expected[0], rel=1e-9)
        assert value(alone, name, "velocity_mean_square") == pytest.approx(expected[1], rel=1e-9)
        assert value(alone, name, "displacement_mean") == pytest.approx(0.5, rel=1e-12)
        assert value(both, name, "velocity_mean_square") == pytest.approx(
            expected[1] + value(rest, name, "velocity_mean_square"), rel=1e-9
        )
        assert alone.estimates()[name, "displacement_std"].bias == 0.0


def test_two_pairs_in_a_table_are_their_own_linearisation() -> None:
    """Springs and dampers from the reported rates alone give back the reported deviations."""
    restitution = 0.6
    response = linearise(two_pairs(Restitution(coefficient=restitution), [TABLE]))
    stiffness, damping = STIFFNESS.copy(), DAMPING.copy()
    pairs = {"wall": ([1.0, 0.0], (-0.8, 0.6)), "link": ([-1.0, 1.0], (-0.4, 0.4))}
    for name, (row, stops) in pairs.items():
        owner, kind = ("a", "") if name == "wall" else ("link", "relative_")
        mean = value(response, owner, f"{kind}displacement_mean")
        variance = value(response, owner, f"{kind}displacement_std") ** 2
        speed = value(response, owner, f"{kind}velocity_std")
        mass = 1.0 / float(np.array(row) @ np.linalg.solve(MASS, row))
        for side, stop in zip(("lower", "upper"), stops, strict=True):
            rate = value(response, name, f"collision_rate_{side}")
            push = (1.0 + restitution) * rate * math.sqrt(math.pi / 2.0) * speed
            shape = mass * np.outer(row, row)
            stiffness += push * abs(stop - mean) / variance * shape
            damping += (1.0 - restitution**2) * rate * shape
    for name, row in (("a", [1.0, 0.0]), ("b", [0.0, 1.0])):
        expected = mean_square(row, 1.0, stiffness, damping)
        assert value(response, name, "displacement_std") ** 2 == pytest.approx(
            expected[0], rel=1e-8
        )
        assert value(response, name, "velocity_mean_square") == pytest.approx(expected[1], rel=1e-8)
    assert response.estimates()["a", "displacement_std"].bias is None


@quick_cases("law", [Restitution(coefficient=0.7), LOSSY, Hertz(coefficient=60.0)], keep=(0, 1))
def test_one_mass_is_answered_as_an_oscillator(law: Law) -> None:
    """Also as an isolator on a shipped environment, in millimetres and kilograms."""
    oscillator = Oscillator(mass=2.0, damping=0.2, stiffness=3.0)
    isolator = Isolator(mass=2.5, frequency_hz=12.0, zeta=0.1)
    stiff = law
    if not isinstance(law, Restitution):
        stiff = Elastic(stiffness=4e5)
    band = TabulatedNoise(on="x", frequency_hz=[0.05, 2.0], density=[0.8, 0.4], unit="N2/Hz")
    truck = TabulatedNoise(on="base", profile="mil-std-810h-truck-vertical-5hz")
    for structure, noise, hit, unit in (
        (oscillator, [WhiteNoise(intensity=0.2), ConstantLoad(force=0.4)], law, 1.0),
        (oscillator, [band], law, 1.0),
        (isolator, [truck], stiff, 3e-3),
    ):
        matrix = Matrices(
            coordinates=["x"],
            mass=structure.matrices[0].tolist(),
            damping=structure.matrices[1].tolist(),
            stiffness=structure.matrices[2].tolist(),
        )
        stops = [ImpactPair(lower=-0.5 * unit, upper=0.9 * unit, law=hit)]
        expected, found = (
            linearise(Scene(structure=each, impact_pairs=stops, excitations=noise)).estimates()
            for each in (structure, matrix)
        )
        deviation = expected["x", "displacement_std"].value
        for key in found.keys() & expected.keys():
            scale = deviation if key[1] == "displacement_mean" else abs(expected[key].value)
            # two quadratures over the table, each to some 1e-9
            assert abs(found[key].value - expected[key].value) < 1e-7 * scale, key


# Compliant stops ---------------------------------------------------------------------------


def matched(law: Law, between: bool, load: float, theta: float = 1.0) -> Scene:
    """White noise that matches the damping, S = 2 theta C, and one pair."""
    stops = {"lower": -0.7, "upper": 0.3, "law": law}
    pair = ImpactPair(between=("b", "a"), **stops) if between else ImpactPair(on="a", **stops)
    return Scene(
        structure=Matrices(
            coordinates=["a", "b"], mass=MASS.tolist(), damping=[[0.2, 0.0], [0.0, 0.1]],
            stiffness=STIFFNESS.tolist(),
        ),
        impact_pairs=[pair],
        excitations=[
            WhiteNoise(on="a", intensity=0.4 * theta), WhiteNoise(on="b", intensity=0.2 * theta),
            ConstantLoad(on="a", force=load),
        ],
    )  # fmt: skip


@pytest.mark.parametrize(
    "law",
    [Elastic(stiffness=30.0), Hertz(coefficient=40.0), STEPS],
    ids=lambda law: law.kind,
)
@pytest.mark.parametrize(("between", "load"), [(False, 5.0), (True, 0.8)])
def test_one_elastic_pair_in_matching_noise_is_exact(law: Law, between: bool, load: float) -> None:
    scene = matched(law, between, load)
    found, truth = linearise(scene).estimates(), exact(scene).estimates()
    assert {key[1] for key in truth} >= {"contact_probability", "contact_force_upper"}
    for key, expected in truth.items():
        assert abs(found[key].value - expected.value) < 1e-9 * (abs(expected.value) + 1e-3), key
        assert found[key].bias == 0.0
    # negative control: a tenth more noise is far outside
    other = exact(matched(law, between, load, 1.1)).estimates()
    key = ("stops", "contact_probability")
    assert abs(found[key].value / other[key].value - 1.0) > 1e-3


def test_the_start_is_the_answer_where_it_is_exact() -> None:
    """And rigid stops in place of soft ones, which the steps of paths go by, are not."""
    scene = matched(Elastic(stiffness=30.0), True, 0.0)
    model = model_of(scene)
    truth = exact(scene).estimates()["stops", "relative_displacement_std"].value
    soft, hard = (scales_of(model, model.modal, compliant=compliant) for compliant in (True, False))
    assert soft is not None and hard is not None
    assert soft[1][0].deviation == pytest.approx(truth, rel=1e-9)
    assert hard[1][0].deviation < 0.95 * truth


def test_stiff_stops_tend_to_rigid_ones() -> None:
    """What is left falls as the duration of a contact, like 1 / sqrt(stiffness)."""
    noise: list[Excitation] = [WhiteNoise(on="a", intensity=0.3)]
    rigid = linearise(two_pairs(Restitution(coefficient=LOSSY.restitution), noise))

    def error(stiffness: float) -> float:
        soft = linearise(two_pairs(LOSSY.model_copy(update={"stiffness": stiffness}), noise))
        return value(soft, "b", "displacement_std") / value(rigid, "b", "displacement_std") - 1.0

    stiffest = error(1e10)
    assert abs(stiffest) < 1e-4
    assert stiffest == pytest.approx(error(1e8) / 10.0, rel=0.02)


def test_balances_hold_for_stops_of_all_laws() -> None:
    noise: list[Excitation] = [WhiteNoise(on="a", intensity=0.3), ConstantLoad(on="b", force=0.2)]
    hard = Restitution(coefficient=0.6)
    for law, other in ((LOSSY, LOSSY), (LOSSY, hard), (hard, STEPS)):
        response = linearise(two_pairs(law, noise, other))
        assert set(response.identities) == {"energy", "force on a", "force on b"}
        for name, residual in response.identities.items():
            assert abs(residual.value) < 1e-9, name
        assert any("Gaussian" in sentence for sentence in response.assumptions)
        assert response.estimates()["link", "impact_speed_rate"].bias is None


def test_a_rate_of_onsets_says_its_peak_force() -> None:
    """Of an elastic stop beside a coordinate that does not feel it: that of the oscillator."""
    stops = {"lower": -0.5, "upper": 0.5, "law": Elastic(stiffness=40.0)}
    alone = Scene(
        structure=Oscillator(mass=1.0, damping=0.05, stiffness=1.0),
        impact_pairs=[ImpactPair(**stops)],
        excitations=[WhiteNoise(intensity=0.1)],
    )
    apart = Scene(
        structure=Matrices(
            coordinates=["x", "y"], mass=np.eye(2).tolist(), damping=np.diag([0.05, 0.3]).tolist(),
            stiffness=np.diag([1.0, 7.0]).tolist(),
        ),
        impact_pairs=[ImpactPair(on="x", **stops)],
        excitations=[WhiteNoise(on="x", intensity=0.1), WhiteNoise(on="y", intensity=0.4)],
    )  # fmt: skip
    expected, found = linearise(alone).estimates(), linearise(apart).estimates()
    for name in ("peak_force", "contact_probability", "contact_force_lower", "collision_rate"):
        key = ("stops", name)
        assert found[key].value == pytest.approx(expected[key].value, rel=1e-9), name


def two_modes(stiffness: float) -> Scene:
    """Two light modes of a place that meets a stop."""
    return Scene(
        structure=Modes(
            frequency_hz=[42.6, 68.7], zeta=[0.003, 0.02], shapes={"u": [0.34, -0.88]},
            participation=[0.5, -0.5],
        ),
        impact_pairs=[
            ImpactPair(on="u", lower=-6e-4, upper=6e-4, law=Elastic(stiffness=stiffness))
        ],
        excitations=[WhiteNoise(on="base", intensity=1.0)],
    )  # fmt: skip


def peaks_of_touches(scene: Scene, count: int) -> Vector:
    """Largest forces of contacts of all modes over the mean speed of touches, from touches of the
    free Gaussian motion; noise and earlier contacts are left out."""
    model = model_of(scene)
    modes, n = model.modal, model.modal.size
    row, squares, damping = modes.gaps[0], modes.squares, np.diag(modes.damping)
    stop, law = model.pairs[0].stops[1], model.pairs[0].stops[1].law
    square = np.diag(free_motion(model).law.covariance)
    x2, v2 = square[:n], square[n:]
    random = np.random.default_rng(1)
    z = random.standard_normal((2 * n, count)) * np.sqrt(square)[:, None]
    speed = math.sqrt(float(row**2 @ v2)) * random.rayleigh(size=count)
    q = z[:n] + np.outer(x2 * row / (row**2 @ x2), np.ones(count)) * (stop.position - row @ z[:n])
    v = z[n:] + np.outer(v2 * row / (row**2 @ v2), np.ones(count)) * (speed - row @ z[n:])
    found, step = np.zeros(count), 2e-3 / math.sqrt(float(row @ row) * law.stiffness)
    for _ in range(2000):
        force = law.stiffness * np.maximum(row @ q - stop.position, 0.0)
        found = np.maximum(found, force)
        v = v + step * (-squares[:, None] * q - damping[:, None] * v - np.outer(row, force))
        q = q + step * v
    return found / speed.mean()


@pytest.mark.parametrize(("stiffness", "brief"), [(4e5, False), (4e8, True)])
def test_peak_forces_of_a_structure_are_told_where_other_modes_leave_them(
    stiffness: float, brief: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In a long contact the modes do not move as one oscillator."""
    scene = two_modes(stiffness)
    peaks = peaks_of_touches(scene, 4000)
    truth, error = peaks.mean(), peaks.std() / math.sqrt(len(peaks))
    told = linearise(scene).impact_pairs["stops"].peak_force
    monkeypatch.setattr("stochvi.model.build_response.MOST_ENERGY_CHANGE", math.inf)
    stops = linearise(scene).impact_pairs["stops"]
    alone = stops.peak_force.value / stops.impact_speed_mean.value
    away = abs(alone - truth) / alone
    if brief:
        assert told is not None and told.bias is None  # as that of the other numbers of the stop
        assert away < MOST_ENERGY_CHANGE + 3.0 * error / alone
    else:
        assert told is None
        assert away > MOST_ENERGY_CHANGE + 3.0 * error / alone


# Several solutions, and spectra -----------------------------------------------------------------


@pytest.mark.parametrize(
    "law", [Restitution(coefficient=0.9), Hertz(coefficient=60.0)], ids=lambda law: law.kind
)
def test_branches_of_one_mass_are_among_those_of_an_oscillator(law: Law) -> None:
    """At rest below the band, or held within it by stops; that in between is unstable."""
    band = TabulatedNoise(on="x", frequency_hz=[0.5, 5.0], density=[0.4, 0.4], unit="N2/Hz")
    alone = Scene(
        structure=Oscillator(mass=1.0, damping=0.02, stiffness=1.0),
        impact_pairs=[ImpactPair(lower=-0.2, upper=0.2, law=law)],
        excitations=[band],
    )
    matrix = Matrices(coordinates=["x"], mass=[[1.0]], damping=[[0.02]], stiffness=[[1.0]])
    expected, found = (
        [value(one, "x", "velocity_std") for one in linearise_all(each)]
        for each in (alone, alone.model_copy(update={"structure": matrix}))
    )
    assert len(expected) == 3 and len(found) >= 2
    assert found[0] == pytest.approx(expected[0], rel=1e-7)
    assert found[-1] == pytest.approx(max(expected), rel=1e-7)


def test_every_solution_that_starts_lead_to_is_told() -> None:
    """A resonance below the band: at rest there, or held within it by the stops."""
    scene = Scene(
        structure=Matrices(
            coordinates=["x", "y"], mass=np.diag([1.0, 0.2]).tolist(),
            damping=[[0.03, -0.01], [-0.01, 0.01]], stiffness=[[3.0, -2.0], [-2.0, 2.0]],
        ),
        impact_pairs=[
            ImpactPair(on="x", lower=-0.2, upper=0.2, law=Restitution(coefficient=0.9))
        ],
        excitations=[
            TabulatedNoise(on="x", frequency_hz=[0.62, 5.0], density=[0.5, 0.5], unit="N2/Hz")
        ],
    )  # fmt: skip
    found = linearise_all(scene)
    free = linearise(scene.model_copy(update={"impact_pairs": ()}))
    speeds = [value(one, "x", "velocity_std") for one in found]
    assert len(speeds) >= 2 and len({round(speed, 6) for speed in speeds}) == len(speeds)
    assert speeds[0] == min(speeds, key=lambda speed: abs(math.log(
        speed / value(free, "x", "velocity_std")
    )))  # fmt: skip
    for one in found:
        assert any(f"this form has {len(found)} solutions" in text for text in one.warnings)
    assert linearise(scene).estimates() == found[0].estimates()
    white = scene.model_copy(update={"excitations": (WhiteNoise(on="x", intensity=0.25),)})
    assert len(linearise_all(white)) == 1


def test_areas_under_the_densities_are_the_mean_squares() -> None:
    noise: list[Excitation] = [
        WhiteNoise(on="a", intensity=0.2),
        WhiteNoise(on="b", intensity=0.1),
        FilteredNoise(on="b", intensity=0.1, frequency_hz=0.4, zeta=0.3),
        TABLE,
    ]
    scene = two_pairs(Restitution(coefficient=0.6), noise)
    (found,) = linearised_structures(scene)
    response = linearise(scene)
    edges = [0.0, *np.geomspace(0.02, 20.0, 12), *EDGES, math.inf]
    for name in ("a", "b"):
        for density, quantity in (
            (found.displacement_density, "displacement_std"),
            (found.velocity_density, "velocity_std"),
        ):
            area = sum(
                quad(lambda f, d=density, n=name: float(d(n, f)), low, high, epsrel=1e-9)[0]
                for low, high in itertools.pairwise(sorted(edges))
            )
            assert area == pytest.approx(value(response, name, quantity) ** 2, rel=1e-8)
    assert found.stops["wall"].spring > 0.0 and found.stops["link"].damper > 0.0
    with pytest.raises(KeyError, match="coordinate must be one of a, b"):
        found.displacement_density("c", 1.0)


def test_filtered_noise_on_one_mass_keeps_the_warnings_of_its_scene() -> None:
    """A damping ratio in percent: every method warns of it, whatever shakes."""
    scene = Scene(
        structure=Oscillator(mass=1.0, stiffness=1.0, damping=10.0),
        impact_pairs=[ImpactPair(upper=0.2, law=Restitution(coefficient=0.8))],
        excitations=[FilteredNoise(intensity=1.0, frequency_hz=0.2, zeta=0.3)],
    )
    assert any("above critical" in warning for warning in linearise(scene).warnings)
