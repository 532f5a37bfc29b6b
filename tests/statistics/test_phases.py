"""Missions of several phases: their scenes, and their joint risk."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.stats import beta

from stochvi import Scene, SceneError, load_scene, reliability, simulate
from stochvi.results.estimates import Cost, Estimate
from stochvi.scenes import ImpactPair, Isolator, Restitution, WhiteNoise
from stochvi.statistics.reliability.answer import Chance, Reliability
from stochvi.statistics.reliability.phases import NEGLIGIBLE, _together, joint_chance

PROFILE = "mil-std-810h-truck-vertical-5hz"


def mission(phases: list[dict[str, Any]], clearance: float = 0.0135) -> Scene:
    return Scene(
        structure=Isolator(frequency_hz=12.0, zeta=0.1),
        impact_pairs=[ImpactPair(clearance=clearance, law=Restitution(coefficient=0.7))],
        excitations=[{"kind": "psd", "profile": PROFILE}],
        phase=phases,
    )


ROAD = {"name": "road", "duration": 7200.0}
ROUGH = {"name": "rough", "duration": "10 min", "level_db": 2.0}
COLD = {"name": "cold", "duration": 600.0, "level_db": 2.0, "stiffness_factor": 0.9}


def test_the_risk_of_a_mission_is_that_of_its_phases_together() -> None:
    scene = mission([ROAD, ROUGH, COLD])
    found = reliability(scene, rel_error=0.2, seed=4)
    assert list(found.phases) == ["road", "rough", "cold"] and found.mission == 8400.0
    alone = [
        reliability(scene.in_phase(each.name), mission=each.duration, rel_error=0.2, seed=4 + k)
        for k, each in enumerate(scene.phases)
    ]
    survived = math.prod(1.0 - each.chances["hit"].estimate.value for each in alone)
    assert found.chances["hit"].estimate.value == pytest.approx(1.0 - survived, rel=1e-12)
    assert found.hits is not None
    assert found.hits.value == pytest.approx(sum(float(each.hits or 0) for each in alone), rel=1e-9)
    assert found.chances["hit"].why.startswith("phase cold has ")


def test_impacts_that_were_not_seen_in_a_phase_do_not_count_as_none() -> None:
    """A phase is hit in one mission of three, but no impact was simulated in it: the mean of the
    mission is at least a third, or it is not told."""
    scene = mission([ROAD, ROUGH])
    one = reliability(scene.in_phase("rough"), mission=600.0, rel_error=0.5, seed=1)
    run = SimpleNamespace(cost=lambda **_: Cost(wall_time=0.0), seed=0)

    def together(limit: float) -> tuple[Reliability, dict[str, str]]:
        hit = one.chances["hit"]
        likely = replace(hit, estimate=Estimate(value=0.3), lower=0.3, upper=0.3)
        unseen = Estimate(value=0.0, bias=None, upper_95=limit)
        seen = Estimate(value=0.03, standard_error=0.001, bias=0.0)
        phases = {
            "road": replace(one, chances={"hit": likely}, hits=unseen, hits_interval=(0.0, limit)),
            "rough": replace(one, hits=seen, hits_interval=(0.028, 0.032)),
        }
        missing: dict[str, str] = {}
        return _together(scene, phases, missing, {}, run), missing

    found, missing = together(5.0)
    assert found.hits is None and found.hits_interval is None
    assert missing == {"road, expected_hits": "no impact was seen; raise budget"}
    # few impacts that were not seen are a bias
    found, missing = together(0.002)
    assert found.hits is not None and not missing
    assert found.hits.value == 0.03 and found.hits.bias == pytest.approx(0.002)
    assert found.hits_interval is not None and found.hits_interval[1] > 0.0325


def test_two_halves_are_one_mission() -> None:
    whole = reliability(mission([]), mission=7200.0, rel_error=0.05, seed=1).chances["hit"]
    half = {"duration": 3600.0}
    halves = reliability(
        mission([half | {"name": "first"}, half | {"name": "second"}]), rel_error=0.05, seed=2
    ).chances["hit"]
    one, other = whole.estimate, halves.estimate
    assert abs(one.value - other.value) < math.hypot(one.reach(4.5), other.reach(4.5))
    # a mission of one half is told apart
    first = halves.estimate.value / 2.0
    assert abs(one.value - first) > math.hypot(one.reach(4.5), other.reach(4.5) / 2.0)


def test_a_phase_without_hits_is_bounded_and_not_simulated() -> None:
    quiet = {"name": "air", "duration": 3600.0, "level_db": -3.0}
    found = reliability(mission([ROUGH, quiet]), impact_speed=0.1, rel_error=0.3, seed=1)
    hit = found.phases["air"].chances["hit"]
    assert hit.estimate.value == 0.0 and hit.way == "Rice"
    known = reliability(mission([]).at_level(-3.0), mission=3600.0, rel_error=0.3, seed=1)
    seen = known.chances["hit"].estimate
    assert 0.3 * hit.upper < seen.value < hit.upper + seen.reach(4.5)
    assert hit.upper < NEGLIGIBLE
    assert found.chances["impact_speed"].estimate.value > 0.0
    assert any("phase air are not counted" in each for each in found.assumptions)
    document = json.loads(json.dumps(found.to_dict(), allow_nan=False))
    assert document["phases"]["air"]["chances"]["hit"]["estimate"]["value"] == 0.0


def test_intervals_hold_the_joint_probability_as_often_as_they_say() -> None:
    """Binomial phases with intervals of Clopper and Pearson, which hold a little more often."""
    random, trials, truth, inside = np.random.default_rng(5), 400, (0.02, 0.1, 0.005), 0
    joint, repetitions = 1.0 - math.prod(1.0 - p for p in truth), 2000
    narrow = 0
    for _ in range(repetitions):
        chances = {}
        for name, p in zip("abc", truth, strict=True):
            k = int(random.binomial(trials, p))
            low = float(beta.ppf(0.025, k, trials - k + 1)) if k else 0.0
            high = float(beta.ppf(0.975, k + 1, trials - k))
            seen = Estimate(value=k / trials, standard_error=math.sqrt(k) / trials, bias=0.0)
            chances[name] = Chance(
                event="hit", limit=None, estimate=seen, lower=low, upper=high, confidence=0.95,
                rule="", way="", why="",
            )  # fmt: skip
        found = joint_chance(chances)
        inside += found.lower < joint < found.upper
        half = 0.5 * (found.upper - found.lower)
        narrow += abs(found.estimate.value - joint) < 0.5 * half
    error = math.sqrt(0.95 * 0.05 / repetitions)
    assert inside / repetitions > 0.95 - 4.5 * error
    assert inside / repetitions < 0.985
    assert narrow / repetitions < 0.95 - 4.5 * error  # half as wide would not


def test_a_warm_mount_is_softer_and_a_phase_has_its_own_noise() -> None:
    scene = mission(
        [
            ROAD | {"stiffness_factor": 1.44, "damping_factor": 1.2},
            {"name": "test", "duration": 60.0, "profile": "navmat-p-9492", "level_db": 3.0},
            {"name": "bench", "duration": 60.0, "excitation": [{"kind": "white", "density": 1e-3,
             "unit": "g2/Hz"}]},
        ]
    )  # fmt: skip
    warm = scene.in_phase("road").structure
    assert isinstance(warm, Isolator)
    assert warm.frequency_hz == pytest.approx(12.0 * 1.2)
    assert warm.zeta == pytest.approx(0.1)  # c = 2 zeta omega m
    tables = [each.in_phase("test").excitations[0].table for each in (scene, scene)]  # type: ignore[union-attr]
    plain = mission([]).replace(excitations=[{"kind": "psd", "profile": "navmat-p-9492"}])
    assert tables[0](100.0) == pytest.approx(10.0**0.3 * plain.excitations[0].table(100.0))  # type: ignore[union-attr]
    assert isinstance(scene.in_phase("bench").excitations[0], WhiteNoise)
    assert Scene.model_validate(json.loads(json.dumps(scene.document()))) == scene


def test_a_file_names_a_phase(tmp_path: Path) -> None:
    file = tmp_path / "scene.toml"
    file.write_text(
        '[structure]\nkind = "isolator"\nfrequency_hz = 12.0\nzeta = 0.1\n'
        '[[impact_pair]]\nclearance = 0.01\nlaw = { kind = "restitution", coefficient = 0.7 }\n'
        f'[[phase]]\nname = "road"\nduration = "2 h"\nprofile = "{PROFILE}"\n'
        '[[phase]]\nname = "own"\nduration = 60\n'
        '[[phase.excitation]]\nkind = "psd"\nfile = "own.csv"\nunit = "g2/Hz"\n',
        encoding="utf-8",
    )
    (tmp_path / "own.csv").write_text("5, 0.01\n500, 0.01\n", encoding="utf-8")
    scene = load_scene(file)
    assert scene.phases[0].duration == 7200.0 and not scene.excitations
    assert load_scene(f"{file}#own") == scene.in_phase("own")
    with pytest.raises(ValueError, match="phase must be one of road, own, got 'air'"):
        load_scene(f"{file}#air")
    with pytest.raises(SceneError, match=r"got 2 \(road, own\)"):
        simulate(scene, rel_error=0.1)


@pytest.mark.parametrize(
    ("phases", "words"),
    [
        ([ROAD, ROAD], "phase.1 needs a name of its own"),
        ([ROAD | {"duration": "2 m"}], "duration"),
        ([ROAD | {"axis": "z"}], "without a profile"),
        ([ROAD | {"profile": "moon"}], "moon"),
        ([ROAD | {"excitation": [{"kind": "white"}]}], "phase.0.excitation.0 needs exactly one"),
        ([ROAD | {"stiffness_factor": -1.0}], "phase.0.stiffness_factor"),
    ],
)
def test_what_is_no_phase_is_refused(phases: list[dict[str, Any]], words: str) -> None:
    with pytest.raises(SceneError, match=words):
        mission(phases)


def test_a_spring_that_is_a_function_has_no_factor_of_stiffness() -> None:
    mount = {"kind": "isolator", "mass": 1.0, "frequency_hz": 12.0, "zeta": 0.1}
    duffing = mount | {"spring": {"kind": "duffing", "cubic_stiffness": 1e6}}
    for structure in (mount, duffing):
        keys = {"structure": structure, "phase": [ROAD | {"stiffness_factor": 1.2}],
                "excitation": [{"kind": "psd", "profile": PROFILE}]}  # fmt: skip
        if structure is mount:
            assert Scene(**keys).in_phase("road").structure != Scene(**keys).structure
            continue
        with pytest.raises(SceneError, match=r"phase.0.structure must have linear springs"):
            Scene(**keys)


def test_a_mission_is_given_once() -> None:
    with pytest.raises(ValueError, match=r"mission must be left out .* of 7200 s together"):
        reliability(mission([ROAD]), mission=60.0)
    with pytest.raises(ValueError, match="mission must be given"):
        reliability(mission([]))
