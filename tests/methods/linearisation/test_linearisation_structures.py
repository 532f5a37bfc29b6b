"""Tables, and compliant stops, on several coordinates: the closure, its limits, its spectra."""

from __future__ import annotations

import csv
import importlib
import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import binom

from stochvi import (
    Absorber,
    Estimate,
    ImpactPair,
    Isolator,
    NotApplicable,
    Oscillator,
    Restitution,
    Scene,
    TabulatedNoise,
    WhiteNoise,
    exact,
    linearise,
    simulate,
)
from stochvi.absorbers.performance import linear_rms
from stochvi.mathematics.numerics import Vector
from stochvi.mathematics.units import STANDARD_GRAVITY
from stochvi.methods.linearisation import (
    linearise_all,
    linearised_structures,
    loose_mass,
    structure_closure,
)
from stochvi.model.build_response import MOST_ENERGY_CHANGE
from stochvi.model.coverage import free_motion
from stochvi.model.modal import linear_law
from stochvi.model.model import model_of
from stochvi.model.scales import scales_by
from stochvi.results.base import Response
from stochvi.scenes import Beam, RigidBody
from stochvi.scenes.datasets import data_folder
from stochvi.scenes.excitations import ConstantLoad, Excitation, FilteredNoise, Sine
from stochvi.scenes.impact_laws import Elastic, ForceTable, Hertz, Law, Viscoelastic
from stochvi.scenes.structures import Matrices, Modes
from stochvi.testing import assert_agrees
from stochvi.verification.testing.judging import Z
from support import CHECKOUT
from support.accuracies import quick_cases, rel_errors
from support.boxes import TABLES, box, direct_matrices, scene_with, tables

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


ENDS = [(-0.5, 0.9), (-1.0, 1.0), (None, 0.6), (-0.6, None), (None, -0.2)]


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
    white = WhiteNoise(intensity=0.2)
    cases = [(oscillator, [band], law, (-0.5, 0.9)), (isolator, [truck], stiff, (-1.5e-3, 2.7e-3))]
    for ends in ENDS if law.rigid else ENDS[:1]:
        cases.append((oscillator, [white, ConstantLoad(force=0.4)], law, ends))
        cases.append((oscillator, [white], law, ends))
    for structure, noise, hit, (lower, upper) in cases:
        matrix = Matrices(
            coordinates=["x"],
            mass=structure.matrices[0].tolist(),
            damping=structure.matrices[1].tolist(),
            stiffness=structure.matrices[2].tolist(),
        )
        stops = [ImpactPair(lower=lower, upper=upper, law=hit)]
        expected, found = (
            linearise(Scene(structure=each, impact_pairs=stops, excitations=noise)).estimates()
            for each in (structure, matrix)
        )
        deviation = expected["x", "displacement_std"].value
        for key in found.keys() & expected.keys():
            scale = deviation if key[1] == "displacement_mean" else abs(expected[key].value)
            # two quadratures over a table, each to some 1e-9
            near = 1e-8 * scale + 1e-14 if white in noise and law.rigid else 1e-7 * scale
            assert abs(found[key].value - expected[key].value) < near, key


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
    soft, hard = (
        scales_by(model, model.modal, "linearise", compliant=compliant)
        for compliant in (True, False)
    )
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


# ------------------------------------------------------------------------------
# A loose mass in a box, linearised at every amplitude: its table, its balances, its bounds.
# ------------------------------------------------------------------------------


CELL = {"mass": 0.03, "play": 2.5, "restitution": 0.45, "zeta": 0.015}


def scene(mass: float, play: float, restitution: float, zeta: float, size: float = 1.0) -> Scene:
    """A structure of unit rms; `size` makes it so many times heavier and slower."""
    return Scene(
        structure=Oscillator(mass=size, damping=2.0 * zeta, stiffness=1.0 / size),
        absorber=Absorber(mass=mass * size, play=play, law=Restitution(coefficient=restitution)),
        excitations=[WhiteNoise(intensity=4.0 * zeta / size)],
    )


def agree(simulated: Estimate, linear: Estimate) -> bool:
    assert simulated.bias is not None and linear.bias is not None
    allowed = Z * simulated.standard_error + simulated.bias + linear.bias
    return abs(simulated.value - linear.value) <= allowed


@pytest.mark.parametrize(("restitution", "play"), [(0.8, 5.0), (0.8, 8.0), (0.6, 6.0)])
def test_the_table_holds_the_exact_regime_of_two_impacts_a_period(
    restitution: float, play: float
) -> None:
    """Flights of speed u meet walls of speed -u (1 - R) / (1 + R), pi u / 2 apart from the middle:
    (pi u / 2 - play / 2)^2 + (u (1 - R) / (1 + R))^2 = 1, the larger root."""
    slow = (1.0 - restitution) / (1.0 + restitution)
    roots = np.roots([math.pi**2 / 4.0 + slow**2, -math.pi * play / 2.0, play**2 / 4.0 - 1.0])
    speed = float(np.max(roots.real))
    impact = 2.0 * speed / (1.0 + restitution)
    found = loose_mass.shaken_box(restitution, np.array([play]))
    exact = {
        "speed_rate": impact / math.pi,
        "speed_square_rate": impact**2 / math.pi,
        "velocity_square": speed**2,
        "displacement_square": (math.pi * speed / 2.0) ** 2 / 3.0,
    }
    # straight lines between logarithms at neighbouring plays, of a curve: their own spacing squared
    spacing = math.log(60.0 / 0.08) / 35.0
    for name, value in exact.items():
        assert found[name][0] == pytest.approx(value, rel=spacing**2), name


def test_a_mass_in_a_tight_box_that_takes_all_is_carried() -> None:
    """Its walls give it the momentum of cos t twice a period: (1 + R) F1 = 4 / (2 pi)."""
    rate = loose_mass.shaken_box(0.0, np.array([0.08]))["speed_rate"][0]
    # the table has five digits
    assert rate == pytest.approx(2.0 / math.pi, rel=1e-4)


def test_energy_balances_and_the_answer_has_no_unit() -> None:
    small, large = (linearise(scene(**CELL, size=size)) for size in (1.0, 1000.0))
    # the integral over amplitudes: trapezia of a fixed number
    spacing = math.log(loose_mass.LARGEST / loose_mass.SMALLEST) / loose_mass.AMPLITUDES
    assert abs(small.identities["energy"].value) < spacing**2
    for owner in ("structure", "absorber"):
        a, b = (each.coordinates[owner]["displacement_std"] for each in (small, large))
        assert b.value == pytest.approx(a.value, rel=1e-9)


def test_a_simulation_lies_within_the_stated_bounds() -> None:
    """Of a scene that is not in the atlas; not so within a tenth of them."""
    linear, simulated = linearise(scene(**CELL)), simulate(scene(**CELL), paths=64, duration=8e3)
    assert loose_mass.NOT_IN_ATLAS not in linear.warnings
    tight = 0
    for owner, name in (
        ("structure", "displacement_std"), ("structure", "velocity_mean_square"),
        ("absorber", "velocity_std"), ("box", "relative_velocity_std"),
        ("box", "impact_speed_rate"), ("box", "impact_speed_square_rate"),
    ):  # fmt: skip
        one, other = (
            (each.coordinates | each.impact_pairs)[owner][name] for each in (simulated, linear)
        )
        assert agree(one, other), (owner, name)
        exact = replace(one, standard_error=0.0, bias=0.0)
        tight += not agree(exact, replace(other, bias=0.1 * other.bias))
    assert tight > 0


def test_most_scenes_held_out_lie_within_the_bounds_of_their_neighbours() -> None:
    with (data_folder() / "absorber_box" / loose_mass.ATLAS).open(newline="") as file:
        rows = [row for row in csv.DictReader(file) if row["part"] == "held out"]
    assert len(rows) > 20
    inside = 0
    for row in rows:
        place = {name: float(row[name]) for name in ("restitution", "zeta")}
        cell = scene(float(row["mass_ratio"]), float(row["play_in_sigma"]), **place)
        box = loose_mass.box_of(model_of(cell))
        bounds = loose_mass.errors(box, loose_mass.moments(box)["velocity"])
        inside += float(row["displacement_off"]) <= bounds["displacement"]
    # the largest of n draws covers the next one with probability n / (n + 1)
    expected = loose_mass.NEIGHBOURS / (loose_mass.NEIGHBOURS + 1.0)
    spread = math.sqrt(expected * (1.0 - expected) / len(rows))
    assert inside / len(rows) >= expected - 2.0 * spread


@pytest.mark.parametrize(
    "changed", [{"mass": 0.3}, {"play": 0.4}, {"restitution": 0.99}, {"zeta": 0.1}]
)
def test_outside_the_atlas_the_error_is_not_known(changed: dict[str, float]) -> None:
    found = linearise(scene(**CELL | changed))
    assert found.coordinates["structure"]["displacement_std"].bias is None
    assert any("its atlas holds one mode" in warning for warning in found.warnings)


def test_a_box_that_loses_nothing_is_still_exact() -> None:
    found = linearise(scene(**CELL | {"restitution": 1.0}))
    deviation = found.coordinates["structure"]["displacement_std"]
    assert deviation.bias == 0.0 and deviation.value == pytest.approx(1.0, rel=1e-9)
    assert not any("atlas" in warning for warning in found.warnings)


# ------------------------------------------------------------------------------
# The moment closure of several coordinates: exact where it should be, its balances, its limits.
# ------------------------------------------------------------------------------


NOISE = WhiteNoise(on="structure", intensity=0.2)


def absorber_in_a_box(restitution: float, **attached: float) -> Scene:
    return Scene(
        structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
        absorber=Absorber(
            mass=0.1, play=2.0, law=Restitution(coefficient=restitution), **attached
        ),
        excitations=[WhiteNoise(intensity=0.2)],
    )  # fmt: skip


def value_of_several(response, owner: str, name: str) -> float:
    return response.estimates()[owner, name].value


def test_a_box_that_loses_nothing_is_answered_exactly() -> None:
    response = linearise(absorber_in_a_box(1.0))
    assert value_of_several(response, "box", "collision_rate") == pytest.approx(
        1.32314185710031, rel=1e-12
    )
    assert value_of_several(response, "structure", "displacement_std") == pytest.approx(
        1.0, rel=1e-12
    )
    assert value_of_several(response, "absorber", "velocity_mean_square") == pytest.approx(
        10.0, rel=1e-12
    )
    relative = value_of_several(response, "box", "relative_displacement_std")
    assert relative == pytest.approx(2.0 / math.sqrt(12.0), rel=1e-12)
    assert response.estimates()["box", "collision_rate"].bias == 0.0
    # with a loss its error is that of an atlas
    lossy = linearise(absorber_in_a_box(0.8)).estimates()
    assert lossy["structure", "displacement_std"].bias > 0.0


def random_scene(number: int) -> Scene:
    random = np.random.default_rng(number)
    count = int(random.integers(2, 5))
    spring = np.diag(random.uniform(0.5, 2.0, count))
    for i in range(count - 1):
        link = random.uniform(0.2, 1.0)
        spring[i, i] += link
        spring[i + 1, i + 1] += link
        spring[i, i + 1] -= link
        spring[i + 1, i] -= link
    names = [f"x{i}" for i in range(count)]
    pairs = [
        ImpactPair(
            name="first", on="x0", lower=-random.uniform(0.3, 2.0), upper=random.uniform(0.3, 2.0),
            law=Restitution(coefficient=random.uniform(0.5, 1.0)),
        ),
        ImpactPair(
            name="second", between=("x0", "x1"), upper=random.uniform(0.3, 2.0),
            law=Restitution(coefficient=random.uniform(0.5, 1.0)),
        ),
    ]  # fmt: skip
    return Scene(
        structure=Matrices(
            coordinates=names, mass=np.diag(random.uniform(0.5, 2.0, count)),
            damping=0.1 * spring, stiffness=spring,
        ),
        impact_pairs=pairs,
        excitations=[
            WhiteNoise(on=name, intensity=random.uniform(0.1, 0.4)) for name in names
        ],
    )  # fmt: skip


@pytest.mark.parametrize("number", range(8))
def test_the_balances_of_the_whole_hold(number: int) -> None:
    response = linearise(random_scene(number))
    assert {"energy", "virial", "force on x0"} <= set(response.identities)
    for name, residual in response.identities.items():
        assert abs(residual.value) < 1e-9, name
    rates = [value_of_several(response, pair, "collision_rate") for pair in ("first", "second")]
    assert min(rates) > 0.0


def test_without_stops_it_is_the_exact_linear_response() -> None:
    scene = Scene(
        structure=Matrices(
            coordinates=["a", "b"], mass=np.diag([1.0, 0.5]),
            damping=[[0.2, -0.1], [-0.1, 0.1]], stiffness=[[2.0, -1.0], [-1.0, 1.0]],
        ),
        excitations=[
            FilteredNoise(on="a", intensity=0.1, frequency_hz=0.3, zeta=0.2),
            Sine(on="b", amplitude=0.3, frequency_hz=0.1),
        ],
    )  # fmt: skip
    response = linearise(scene)
    displacement, velocity = linear_rms(scene)
    for name in ("a", "b"):
        assert value_of_several(response, name, "displacement_std") == pytest.approx(
            displacement[name]
        )
        assert value_of_several(response, name, "velocity_std") == pytest.approx(velocity[name])
        assert response.estimates()[name, "displacement_std"].bias == 0.0


def test_what_it_does_not_cover_is_said() -> None:
    loaded = absorber_in_a_box(0.5).model_copy(
        update={"excitations": (ConstantLoad(on="structure", force=1.0),)}
    )
    with pytest.raises(NotApplicable, match="noise or a sine, got a constant load alone"):
        linearise(loaded)
    with pytest.raises(NotApplicable, match=r"structure\.kind must be"):
        linearise(absorber_in_a_box(0.5), form="motion")


# ------------------------------------------------------------------------------
# A rigid box without stops: linear numbers against oscillators and a direct integration.
# ------------------------------------------------------------------------------


FAR = 3.0
"""Distance of a snubber, in standard deviations of its gap."""

QUANTITIES = ("displacement_std", "velocity_std", "acceleration_std")


def moments(response: Response, name: str) -> list[float]:
    return [float(response.coordinates[name][what]) for what in QUANTITIES]


def test_a_box_with_its_centre_amid_equal_mounts_is_an_oscillator_along_every_axis() -> None:
    places = [(x, y, z) for x in (-0.2, 0.2) for y in (-0.1, 0.1) for z in (-0.1, 0.1)]
    stiffness, damping = np.array([2e3, 3e3, 5e3]), np.array([5.0, 7.0, 9.0])
    mounts = [{"at": at, "stiffness": stiffness, "damping": damping} for at in places]
    symmetric = RigidBody(mass=9.0, inertia=[0.2, 0.25, 0.15], mount=mounts)
    found = linearise(scene_with(symmetric))
    for noise, axis, k, c in zip(tables(), "xyz", stiffness, damping, strict=True):
        alone = Isolator(mass=9.0, stiffness=8.0 * k, damping=8.0 * c)
        bare = noise.model_copy(update={"axis": None})
        expected = linearise(Scene(structure=alone, excitations=[bare]))
        assert moments(found, axis) == pytest.approx(moments(expected, "x"), rel=1e-10)
    for angle in ("rx", "ry", "rz"):
        assert moments(found, angle) == pytest.approx([0.0, 0.0, 0.0], abs=1e-11)


def direct(structure: RigidBody) -> dict[str, list[float]]:
    """Rms displacements, velocities and absolute accelerations, by a rule of many points over log
    frequency."""
    mass, damping, stiffness = direct_matrices(structure)
    total = np.zeros((3, 6))
    nodes, weights = np.polynomial.legendre.leggauss(40)
    for column, (frequency, density) in enumerate(TABLES.values()):
        # panels of equal ratio between breakpoints; the response is smooth on each
        edges = np.unique(
            np.concatenate([np.geomspace(frequency[0], frequency[-1], 60), frequency])
        )
        half, middle = np.diff(np.log(edges)) / 2.0, np.log(edges[1:] * edges[:-1]) / 2.0
        f = np.exp(middle[:, None] + half[:, None] * nodes).ravel()
        weight = (half[:, None] * weights).ravel() * f
        power = np.exp(np.interp(np.log(f), np.log(frequency), np.log(density)))
        w = 2.0 * math.pi * f[:, None, None]
        dynamic = stiffness - w**2 * mass + 1j * w * damping
        moved = np.linalg.solve(dynamic, np.broadcast_to(-mass[:, column, None], (len(f), 6, 1)))
        moved, w = moved[:, :, 0], w[:, :, 0]
        absolute = np.eye(6)[column] - w**2 * moved
        share = (power * weight * STANDARD_GRAVITY**2)[:, None]
        for row, motion in enumerate((moved, w * moved, absolute)):
            total[row] += (share * np.abs(motion) ** 2).sum(axis=0)
    names = ("x", "y", "z", "rx", "ry", "rz")
    return dict(zip(names, np.sqrt(total).T.tolist(), strict=True))


def test_a_box_without_symmetry_moves_as_a_direct_integration_over_frequency_says() -> None:
    found, expected = linearise(scene_with(box())), direct(box())
    for name in expected:
        assert moments(found, name) == pytest.approx(expected[name], rel=1e-8)


@rel_errors(0.1, 0.02)
def test_a_corner_hits_a_far_snubber_at_the_rate_of_rice(rel_error: float) -> None:
    pair = {"name": "corner", "at": [0.3, 0.2, -0.15], "direction": [1.0, 0.5, 2.0]}
    law = {"kind": "restitution", "coefficient": 0.5}

    def hanging(level: float) -> Scene:
        return scene_with(box(zeta=0.4), pairs=[pair | {"upper": level, "law": law}])

    model = model_of(hanging(1.0))
    free, gap = linear_law(model.modal), model.modal.gaps[0]
    assert free is not None
    sigma, speed = (math.sqrt(free.variances(gap, first)) for first in (0, model.modal.size))
    rate = speed / sigma / (2.0 * math.pi) * math.exp(-(FAR**2) / 2.0)
    found = simulate(hanging(FAR * sigma), rel_error=rel_error, seed=3, threads=1)
    hits = found.impact_pairs["corner"].collision_rate
    assert hits is not None
    # an excursion is hardly ever followed by another one within the memory of the motion
    assert_agrees(hits, rate)


def test_a_snubber_that_impacts_alone_would_move_is_no_obstacle() -> None:
    """A symmetric box shaken along z does not move sideways until its corner hits a stop."""
    corners = [(x, y, 0.0) for x in (-0.2, 0.2) for y in (-0.1, 0.1)]
    mounts = [{"at": at, "stiffness": [2e4, 2e4, 3e4], "zeta": 0.1} for at in corners]
    body = RigidBody(mass=10.0, inertia=[0.2, 0.2, 0.2], mount=mounts)
    law = {"kind": "restitution", "coefficient": 0.5}
    pairs = [
        {"name": name, "at": [0.2, 0.1, 0.1], "direction": to, "clearance": 0.003, "law": law}
        for name, to in (("up", [0, 0, 1]), ("side", [1, 0, 0]))
    ]
    scene = Scene(structure=body, impact_pair=pairs, excitations=[tables()[2]])
    found = linearise(scene)
    rates = {name: float(found.impact_pairs[name].collision_rate) for name in ("up", "side")}
    assert rates["up"] > 0.0 and 0.0 <= rates["side"] < rates["up"]


def test_rms_values_are_those_of_the_frequency_solver_of_pyyeti() -> None:
    with np.printoptions():  # pyYeti changes how numpy prints arrays
        solvers = pytest.importorskip("pyyeti.ode", reason="pyYeti is in the extra `fem`")
    structure = box()
    mass, damping, stiffness = structure.matrices
    solver = solvers.SolveUnc(mass, damping, stiffness)
    squares = np.zeros((3, 6))
    for column, (frequency, density) in enumerate(TABLES.values()):
        f = np.geomspace(frequency[0], frequency[-1], 4000)
        found = solver.fsolve(-np.outer(mass[:, column], np.ones(len(f))), f)
        power = np.exp(np.interp(np.log(f), np.log(frequency), np.log(density)))
        absolute = found.a + np.eye(6)[column][:, None]
        for row, motion in enumerate((found.d, found.v, absolute)):
            squares[row] += np.trapezoid(power * STANDARD_GRAVITY**2 * np.abs(motion) ** 2, f)
    expected = np.sqrt(squares)
    mine = linearise(scene_with(structure))
    for column, name in enumerate(structure.coordinates):
        assert moments(mine, name) == pytest.approx(expected[:, column].tolist(), rel=1e-3)


# ------------------------------------------------------------------------------
# Energy that impacts scatter among modes, in the closure of a structure.
# ------------------------------------------------------------------------------


@pytest.mark.parametrize("ratio", [0.0, 0.3, 1.0, 1.7, 4.4])
def test_the_spectrum_of_a_half_sine_is_that_of_its_integral(ratio: float) -> None:
    """Of sin t from 0 to pi about its middle, over its area of 2."""
    integral, _ = quad(lambda t: math.sin(t) * math.cos(ratio * (t - math.pi / 2.0)), 0.0, math.pi)
    assert structure_closure.half_sine(np.array([ratio]))[0] == pytest.approx(
        integral / 2.0, abs=1e-12
    )


def three_modes(law: Elastic | Restitution, raised: float = 1.0) -> Scene:
    """Modes in noise that matches their damping; `raised` is the noise of the third over that."""
    omega = np.array([60.0, 150.0, 230.0])
    own = {f"own{k}": row.tolist() for k, row in enumerate(np.diag(np.sqrt(0.1 * omega)))}
    return Scene(
        structure=Modes(
            frequency_hz=(omega / (2.0 * math.pi)).tolist(), zeta=0.05, modal_mass=1.0,
            shapes=own | {"tip": [1.0, -1.0, 1.0], "seat": [0.0, 0.0, 1.0]},
        ),
        impact_pairs=[ImpactPair(on="tip", lower=-0.02, upper=0.01, law=law)],
        excitations=[
            WhiteNoise(on=name, intensity=raised if name == "own2" else 1.0) for name in own
        ],
    )  # fmt: skip


@pytest.mark.parametrize("law", [Elastic(stiffness=4e4), Restitution(coefficient=1.0)])
def test_noise_and_damper_of_impacts_leave_the_gibbs_law(law: Elastic | Restitution) -> None:
    known, found = exact(three_modes(law)), linearise(three_modes(law))
    for name, motion in found.coordinates.items():
        truth = known.coordinates[name].displacement_std.value
        assert motion.displacement_std.value == pytest.approx(truth, rel=1e-8)
    stops = found.impact_pairs["stops"]
    truth = known.impact_pairs["stops"].collision_rate.value
    assert stops.collision_rate.value == pytest.approx(truth, rel=1e-8)
    assert stops.collision_rate.bias == 0.0


@pytest.mark.parametrize("law", [Elastic(stiffness=4e4), Restitution(coefficient=0.6)])
def test_the_noise_of_impacts_brings_no_energy(law: Elastic | Restitution) -> None:
    """The balance of energy holds where modes differ in temperature, too."""
    found = linearise(three_modes(law, raised=30.0))
    assert abs(found.identities["energy"].value) < 1e-8


def slapping_reed() -> Scene:
    """A steel reed on a base that moves at random, whose tip slaps against a stop."""
    return Scene(
        structure=Beam(
            length=0.2, width=0.02, height=0.002, young=2e11, density=7850.0, zeta=0.01, modes=3,
            points={"tip": 1.0},
        ),
        impact_pairs=[ImpactPair(on="tip", upper=0.001, law=Elastic(stiffness=2e4))],
        excitations=[WhiteNoise(on="base", density=0.01, unit="g2/Hz")],
    )  # fmt: skip


def test_a_slapping_reed_is_answered_better(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its impacts feed the higher modes: without that the closure has nearly twice the impacts."""
    truth = simulate(slapping_reed(), paths=16, duration=4.0, seed=7)
    mixed = linearise(slapping_reed())
    monkeypatch.setattr(structure_closure, "SCATTERED", 1e-12)
    alone = linearise(slapping_reed())
    for owner, quantity in (("tip", "displacement_std"), ("stops", "collision_rate")):
        known = truth.estimates()[owner, quantity]
        off, before = (
            abs(answer.estimates()[owner, quantity].value - known.value)
            for answer in (mixed, alone)
        )
        assert off + 4.5 * known.standard_error + (known.bias or 0.0) < before


# ------------------------------------------------------------------------------
# Stated error of the closure of a structure, against simulations of random structures.
# ------------------------------------------------------------------------------


random_structure = importlib.import_module(
    "studies.32_linearised_structures.cases"
).random_structure

CALIBRATED = 200
"""Structures with smaller numbers were used to choose the factors of the bounds."""

PROMISED = 0.99


def simulated() -> dict[int, list[tuple[str, str, float]]]:
    """Values by the number of a structure: owner, quantity, simulated value."""
    found: dict[int, list[tuple[str, str, float]]] = {}
    place = CHECKOUT / "data" / "linearisation_atlas" / "structures.csv"
    with place.open(encoding="utf-8") as file:
        for row in csv.DictReader(file):
            # a stated bias above 10 % says that the simulation knows no better
            if row["bias"] and float(row["bias"]) < 0.1 * float(row["value"]):
                entry = row["owner"], row["quantity"], float(row["value"])
                found.setdefault(int(row["number"]), []).append(entry)
    return found


@quick_cases("step", [20, 1], keep={0})
def test_bounds_hold_on_structures_that_were_not_used_to_choose_them(step: int) -> None:
    known, count, misses, halved = simulated(), 0, 0, 0
    for number in range(CALIBRATED, 400, step):
        found = linearise(random_structure(number)).estimates()
        for owner, quantity, value in known[number]:
            estimate = found[owner, quantity]
            if estimate.bias is not None:
                count += 1
                misses += abs(estimate.value - value) > estimate.bias
                halved += abs(estimate.value - value) > estimate.bias / 8.0
    assert count > 50
    # misses of one structure go together, which the factor of 2 allows for
    most = 2.0 * binom.ppf(0.999, count, 1.0 - PROMISED)
    assert misses <= most
    # an eighth of the bounds is too little, and that is noticed
    assert halved > most


def two_modes_of_structure_bounds(**changes: object) -> Scene:
    pair: dict[str, object] = {"on": "tip", "upper": 0.01, "law": Restitution(coefficient=0.7)}
    structure = {
        "frequency_hz": [10.0, 17.0], "zeta": 0.02, "modal_mass": 1.0,
        "shapes": {"tip": [1.0, 0.6], "seat": [0.5, -1.0]},
    }  # fmt: skip
    pair |= {key: value for key, value in changes.items() if key in {"upper", "law"}}
    structure |= {key: value for key, value in changes.items() if key in structure}
    return Scene(
        structure=Modes(**structure),
        impact_pairs=[ImpactPair(**pair)],
        excitations=[WhiteNoise(on="tip", intensity=1.0)],
    )


def test_a_structure_like_those_has_a_bound() -> None:
    answer = linearise(two_modes_of_structure_bounds())
    rate = answer.impact_pairs["stops"].collision_rate
    assert rate.bias is not None and 0.0 < rate.bias < rate.value
    assert "error bound from random structures" in rate.how
    assert answer.impact_pairs["stops"].impact_speed_mean.bias is None


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"zeta": 0.3}, "damping ratios"),
        ({"upper": 1.0}, "deviations of their gap"),
        ({"law": Restitution(coefficient=0.2)}, "rigid stops of R"),
        ({"law": Elastic(stiffness=100.0)}, "as stiff as the structure"),
        ({"law": Hertz(coefficient=1e7)}, "rigid stops of R"),
    ],
)
def test_other_structures_have_none_and_say_why(changes: dict[str, object], words: str) -> None:
    entry = linearise(two_modes_of_structure_bounds(**changes)).coordinates["tip"].displacement_std
    assert entry.bias is None
    assert "no error bound" in entry.how and words in entry.how


def test_gaps_that_move_together_have_none() -> None:
    scene = two_modes_of_structure_bounds()
    other = ImpactPair(name="other", on="tip", upper=0.012, law=Restitution(coefficient=0.7))
    both = scene.model_copy(update={"impact_pairs": [*scene.impact_pairs, other]})
    assert "move together" in structure_closure.outside(model_of(both))
    apart = other.model_copy(update={"on": "seat"})
    alone = scene.model_copy(update={"impact_pairs": [*scene.impact_pairs, apart]})
    assert structure_closure.outside(model_of(alone)) == ""


def test_stops_of_two_laws_are_answered_under_a_sine() -> None:
    """A sine has states of its own beside those of the motion."""
    stops = ImpactPair(
        lower=-3e-3,
        upper=3e-3,
        lower_law=Viscoelastic(stiffness=2e5, damping_ratio=0.3),
        upper_law=Elastic(stiffness=2e5),
    )
    mount = Isolator(mass=2.0, frequency_hz=12.0, zeta=0.1)
    sine = Sine(amplitude=8.0, frequency_hz=11.0)
    found = linearise(Scene(structure=mount, impact_pairs=[stops], excitations=[sine]))
    assert found.coordinates["x"].displacement_std.value > 1e-3
