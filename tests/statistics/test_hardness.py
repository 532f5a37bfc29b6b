"""How hard an impact is: energies against the speeds that bring them, with the mass of each pair,
and against counting in plain paths; what is refused."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
import pytest
from numpy.typing import NDArray

from stochvi import (
    Estimate,
    ImpactPair,
    Isolator,
    Matrices,
    NotApplicable,
    Restitution,
    Scene,
    TabulatedNoise,
    WhiteNoise,
    history,
    reliability,
    size,
)
from stochvi.isolators.sizing.risk_curve import exceedances
from stochvi.model.model import model_of
from stochvi.motion.choose_plan import with_tables
from stochvi.motion.modal_tables import plan_modal_tables
from stochvi.statistics.clusters import bursts
from stochvi.statistics.hardness import Limit
from stochvi.statistics.rare_hits import (
    TYPICAL_SPEED,
    WindowSampler,
    kinds_of,
    rare_hits,
    widening_of,
)
from stochvi.testing import assert_agrees
from support.accuracies import rel_errors
from support.mounts import ten_hertz
from support.pairs import diagonal

LAW = Restitution(coefficient=0.6)
MASS = 4.0
WHITE = WhiteNoise(density=0.01, unit="g2/Hz")
TABLE = TabulatedNoise(profile="mil-std-810h-truck-vertical-5hz")
MASSES = {"z": 9.0, "apart": 0.9}
"""Reduced masses of the pairs of `two_masses`, kg."""


def mount(noise: WhiteNoise | TabulatedNoise, clearance: float) -> Scene:
    """A mass of 4 kg at 12 Hz."""
    return Scene(
        structure=Isolator(mass=MASS, frequency_hz=12.0, zeta=0.1),
        impact_pairs=[ImpactPair(clearance=clearance, law=LAW)],
        excitations=[noise],
    )


def two_masses(own: float, apart: float) -> Scene:
    """1 kg beside 9 kg, each of rms displacement 1: stops of the second, and between both."""
    return Scene(
        structure=Matrices(
            coordinates=("x", "z"), mass=diagonal(1, 9), damping=diagonal(0.6, 2.7),
            stiffness=diagonal(1, 2.25),
        ),
        impact_pairs=[
            ImpactPair(name="z", on="z", clearance=own, law=LAW),
            ImpactPair(name="apart", between=("x", "z"), clearance=apart, law=LAW),
        ],
        excitations=[WhiteNoise(intensity=1.2, on="x"), WhiteNoise(intensity=12.15, on="z")],
    )  # fmt: skip


OUT_OF_REACH = 1e3
ONE_PAIR = [("z", two_masses(2.6, OUT_OF_REACH)), ("apart", two_masses(OUT_OF_REACH, 3.2))]
"""Scenes of two pairs of which one alone is hit, with its name."""

one_pair = pytest.mark.parametrize(("name", "scene"), ONE_PAIR, ids=MASSES)


def chance(scene: Scene, mission: float, **asked: Any) -> Estimate:
    """The probability of the limit that is asked after first."""
    found = reliability(scene, mission=mission, rel_error=0.5, seed=3, threads=1, **asked)
    return found.chances[next(iter(asked))].estimate


@pytest.mark.parametrize(
    ("noise", "clearance", "speed", "mission", "asked"),
    [
        (WHITE, 6e-3, 0.2, 1.0, {"start": "rest", "way": "crude"}),
        pytest.param(TABLE, 8e-3, 0.3, 60.0, {}, marks=pytest.mark.slow),
    ],
    ids=["white", "table"],
)
def test_an_energy_of_one_mass_is_as_probable_as_its_speed(
    noise: WhiteNoise | TabulatedNoise, clearance: float, speed: float, mission: float,
    asked: dict[str, Any],
) -> None:  # fmt: skip
    scene, energy = mount(noise, clearance), MASS * speed**2 / 2.0
    found = chance(scene, mission, impact_energy=energy, **asked)
    assert found == chance(scene, mission, impact_speed=speed, **asked) and found.value > 0.0
    wrong = chance(scene, mission, impact_speed=math.sqrt(2.0 * energy), **asked)
    assert wrong.value < 0.9 * found.value


@pytest.mark.slow
@one_pair
def test_an_energy_of_a_pair_is_as_probable_as_its_speed(name: str, scene: Scene) -> None:
    energy = 1.0
    found = chance(scene, 20.0, impact_energy=energy)
    speed = math.sqrt(2.0 * energy / MASSES[name])
    assert found == chance(scene, 20.0, impact_speed=speed) and found.value > 0.0


@pytest.mark.slow
@one_pair
def test_a_pair_is_sized_by_an_energy_as_by_its_speed(name: str, scene: Scene) -> None:
    asked: Any = {"pair": name, "mission": 600.0, "exceedance": 0.1, "rel_error": 0.5, "seed": 4}
    energy = 0.5
    found = size(scene, impact_energy=energy, **asked)
    known = size(scene, impact_speed=math.sqrt(2.0 * energy / MASSES[name]), **asked)
    other = size(scene, impact_speed=math.sqrt(2.0 * energy), **asked)
    assert found.clearance == known.clearance != other.clearance


@one_pair
def test_trials_are_scored_by_energies_of_their_pairs(name: str, scene: Scene) -> None:
    """Of splitting, and windows of the whole motion."""
    found = []
    for event in ("impact_speed", "impact_energy"):
        _, whole = kinds_of(scene, event, 20.0, 0.5, 1, None)
        found.append(whole.scores(whole.fresh(0)))
        plan = replace(plan_modal_tables(with_tables(model_of(scene)), None, None), duration=200.0)
        found.append(WindowSampler(plan, event, (), 1).simulate(0, 8).ravel())
    for speeds, energies in (found[::2], found[1::2]):
        hit = speeds > 0.0
        assert hit.sum() > 3
        expected = MASSES[name] * speeds[hit] ** 2 / 2.0
        assert energies[hit] == pytest.approx(expected, rel=1e-12)
        assert (energies[~hit] == speeds[~hit]).all()


def test_the_hardest_impact_of_a_cluster_is_not_the_fastest() -> None:
    found = bursts(two_masses(4.2, 5.6), rel_error=0.5, seed=1)
    own, apart = found.fastest
    expected = np.maximum(4.5 * own**2, 0.45 * apart**2)
    assert found.largest("impact_energy") == pytest.approx(expected, rel=1e-12)
    heavy = 4.5 * own**2 > 0.45 * apart**2
    assert (heavy & (own < apart)).any() and not heavy.all()


def test_first_impacts_are_drawn_fast_enough_for_the_energy_of_any_pair() -> None:
    speeds = [math.sqrt(2.0 * 9.0 / mass) for mass in MASSES.values()]
    ratios = np.array(speeds) / [0.5, math.hypot(1.0, 0.5)]
    assert ratios[0] < 0.8 * ratios[1]
    found = widening_of(model_of(two_masses(2.6, 3.2)), Limit("impact_energy", 9.0))
    assert found == pytest.approx(ratios[0] / TYPICAL_SPEED)


def hardest(
    seen: Sequence[pd.DataFrame], mission: float, masses: dict[str, float]
) -> NDArray[np.float64]:
    """(paths, missions): energy of the hardest impact in each part of paths with such impacts."""
    found = np.zeros((len(seen), MISSIONS))
    for own, impacts in zip(found, seen, strict=True):
        energy = impacts["pair"].map(masses) * impacts["speed_m_s"] ** 2 / 2.0
        when = (impacts["time_s"] // mission).astype(int).clip(upper=MISSIONS - 1)
        np.maximum.at(own, when, energy)
    return found


MISSIONS = 60
"""Number of missions in a plain path."""


@pytest.mark.slow
@rel_errors(0.1, 0.02)
def test_energies_of_several_pairs_against_counting(rel_error: float) -> None:
    """Missions of 60 s in paths, whose motion forgets itself in 7 s."""
    scene, mission, limit = two_masses(3.0, 4.2), 60.0, 2.5
    found = reliability(
        scene, mission=mission, impact_energy=limit, rel_error=rel_error, seed=2, budget=None
    ).chances["impact_energy"]
    paths = round(1.0 / rel_error**2)
    seen = [
        history(scene, duration=MISSIONS * mission, seed=11, path=path, rate=0.5).impacts
        for path in range(paths)
    ]

    def counted(masses: dict[str, float]) -> tuple[Estimate, float]:
        shares = (hardest(seen, mission, masses) > limit).mean(axis=1)
        error = float(shares.std(ddof=1)) / math.sqrt(paths)
        both = math.hypot(found.estimate.standard_error, error)
        return replace(found.estimate, standard_error=both), float(shares.mean())

    known, share = counted(MASSES)
    print(known, share)
    assert_agrees(known, share)
    wrongs = [{"z": 0.9, "apart": 9.0}, {"z": 9.0, "apart": 9.0}]
    if rel_error < 0.1:
        wrongs.append({"z": 1.0, "apart": 1.0})
    for wrong in wrongs:
        with pytest.raises(AssertionError):
            assert_agrees(*counted(wrong))


UNSTATED = [
    ten_hertz(0.05, LAW),
    ten_hertz(0.05, LAW).replace(excitations=[TABLE]),
    ten_hertz(0.05).replace(
        impact_pairs=[
            ImpactPair(name=name, clearance=clearance, law=LAW)
            for name, clearance in (("near", 5e-3), ("far", 6e-3))
        ]
    ),
]


@pytest.mark.parametrize("scene", UNSTATED, ids=["white", "table", "pairs"])
def test_an_energy_needs_the_mass(scene: Scene) -> None:
    asked: Any = {"mission": 10.0, "impact_energy": 5.0}
    for ask in (
        lambda: reliability(scene, **asked),
        lambda: size(scene, **asked),
        lambda: rare_hits(scene, "impact_energy", 5.0, mission=10.0),
        lambda: exceedances(scene, [5e-3], 10.0, event="impact_energy"),
    ):
        with pytest.raises(NotApplicable, match=r"needs structure.mass .kg., got none; give it"):
            ask()
