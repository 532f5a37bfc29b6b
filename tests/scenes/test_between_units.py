"""Numbers of a scene that differ between units: what is accepted, kept, and taken by whom."""

from __future__ import annotations

import copy
import json
import math
import pickle
from typing import Any

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import norm

from stochvi import (
    Absorber,
    BetweenUnits,
    Elastic,
    ImpactPair,
    Isolator,
    NotApplicable,
    Oscillator,
    Restitution,
    Scene,
    SceneError,
    Sine,
    Viscoelastic,
    WhiteNoise,
    absorber,
    exact,
    load_answer,
    mean_over_units,
    save_answer,
    screen,
    simulate,
    size,
    sweep,
)
from stochvi.cli.tolerances import tolerances_of
from stochvi.isolators import Spread, production
from stochvi.isolators.jolt_response import jolts
from stochvi.isolators.moved_stops import at_clearances
from stochvi.isolators.production_risk.spreads import spreads_of
from stochvi.isolators.production_risk.units import Units
from stochvi.isolators.sizing.changes import Tolerances
from stochvi.isolators.sizing.tolerance_region import Region
from stochvi.model.model import model_of
from stochvi.results.deadline import NEVER
from stochvi.scenes.between_units import mean_unit, varied
from stochvi.scenes.keys import changed_scene
from stochvi.scenes.phases import Phase
from stochvi.scenes.scene import scene_from
from stochvi.scenes.schema import scene_schema
from stochvi.statistics.pair_crossings import own_distances

NOISE = [WhiteNoise(density=0.01, unit="g2/Hz")]
MOUNT = {"kind": "isolator", "mass": 2.0, "zeta": {"mean": 0.05, "half_width": 0.01},
         "frequency_hz": {"mean": 10.0, "std": 0.3}}  # fmt: skip
STOPS = {"lower": {"mean": -0.011, "half_width": 2e-4}, "upper": {"mean": 0.01, "std": 1e-4}}
SOFT = {"kind": "viscoelastic", "stiffness": {"mean": 1e5, "std": 2e4}, "damping_ratio": 0.1}
DOCUMENT: dict[str, Any] = {
    "structure": MOUNT,
    "impact_pair": [STOPS | {"law": SOFT}],
    "excitation": [{"kind": "white", "density": 0.01, "unit": "g2/Hz"}],
}


def pair(**keys: Any) -> ImpactPair:
    return ImpactPair(**({"law": Restitution(coefficient=0.5)} | keys))


def scene_of(*pairs: ImpactPair, **mount: Any) -> Scene:
    structure = Isolator(**({"mass": 2.0, "frequency_hz": 10.0, "zeta": 0.05} | mount))
    return Scene(structure=structure, impact_pairs=pairs, excitations=NOISE)


def test_a_document_a_copy_and_a_saved_answer_keep_what_differs(tmp_path: Any) -> None:
    scene = scene_from(DOCUMENT)
    differing = dict(varied(scene))
    assert list(differing) == [
        "structure.frequency_hz", "structure.zeta", "impact_pair.0.lower", "impact_pair.0.upper",
        "impact_pair.0.law.stiffness",
    ]  # fmt: skip
    written = scene.document()
    assert written["structure"]["zeta"] == {"mean": 0.05, "half_width": 0.01}
    assert scene_from(json.loads(json.dumps(written))).document() == written
    for again in (pickle.loads(pickle.dumps(scene)), copy.deepcopy(scene)):
        assert dict(varied(again)) == differing
    save_answer(screen(scene), tmp_path / "answer.json")
    saved = load_answer(tmp_path / "answer.json").provenance["scene"]
    assert saved["impact_pair"][0]["law"]["stiffness"] == {"mean": 1e5, "std": 2e4}
    # the control: a mean unit differs in nothing else, and in its document
    assert not dict(varied(mean_unit(scene))) and mean_unit(scene).document() != written


@pytest.mark.parametrize(
    ("value", "words"),
    [
        ({"mean": 1.0}, "needs exactly one of std (normal) and half_width (uniform), got none"),
        ({"mean": 1.0, "std": 0.1, "half_width": 0.1}, "got std, half_width"),
        ({"mean": 1.0, "std": 0.0}, "frequency_hz.std must be greater than 0, got 0"),
        ({"mean": 0.1, "half_width": 0.1}, "must be greater than 0 in every unit, got 0"),
        ({"mean": -1.0, "std": 0.1}, "must be greater than 0 in every unit, got -1"),
        ({"mean": 1.0, "sd": 2}, "frequency_hz.sd is not a known key; did you mean 'std'?"),
        ("x", "frequency_hz must be a finite number, got 'x'"),
        (0.0, "frequency_hz must be greater than 0, got 0"),
    ],
)
def test_what_cannot_differ_so_is_refused_in_a_sentence(value: Any, words: str) -> None:
    with pytest.raises(SceneError) as failure:
        Isolator(frequency_hz=value, zeta=0.1)
    assert words in str(failure.value)


def test_a_limit_beside_a_distribution_of_the_same_quantity_is_refused() -> None:
    with pytest.raises(SceneError, match="takes damping_tolerance, or zeta that differs"):
        Isolator(frequency_hz=10.0, zeta={"mean": 0.1, "std": 0.01}, damping_tolerance=0.1)
    assert Isolator(
        frequency_hz=10.0, zeta={"mean": 0.1, "std": 0.01}, frequency_tolerance=0.1
    ).frequency_tolerance == 0.1  # fmt: skip


def test_one_clearance_stands_for_two_stops_with_errors_of_their_own() -> None:
    both = pair(clearance=BetweenUnits(mean=0.004, std=1e-4))
    assert both.lower == place(-0.004, std=1e-4) and both.symmetric
    spreads = spreads_of(scene_of(both))
    assert spreads == dict.fromkeys(
        ["clearance lower stops", "clearance upper stops"], Spread(std=1e-4)
    )


def place(mean: float, **width: float) -> float:
    found = pair(upper=BetweenUnits(mean=mean, **width)).upper
    assert found is not None
    return found


def test_the_schema_and_the_keys_know_what_differs_by_its_class() -> None:
    parts = scene_schema()["$defs"]
    choices = parts["ImpactPair"]["properties"]["upper"]["oneOf"]
    assert {"$ref": "#/$defs/BetweenUnits"} in choices
    assert parts["BetweenUnits"]["required"] == ["mean"]
    document = scene_from(DOCUMENT).document()
    wider = changed_scene(document, (("impact_pair.0.upper.std", 3e-4),))
    assert dict(varied(wider))["impact_pair.0.upper"].std == 3e-4
    with pytest.raises(SceneError, match=r"did you mean 'impact_pair.0.law.stiffness.mean'\?"):
        changed_scene(document, (("impact_pair.0.law.stiffness", 2e5),))
    even = scene_of(pair(clearance={"mean": 0.01, "std": 1e-4})).document()
    moved = changed_scene(even, (("impact_pair.0.clearance", 0.02),))
    assert moved.impact_pairs[0].upper == place(0.02, std=1e-4)


def test_every_other_method_answers_for_the_mean_unit_and_says_so() -> None:
    scene = scene_from(DOCUMENT)
    plain = mean_unit(scene)
    found, alone = (
        simulate(each, paths=8, duration=2.0, seed=1, threads=1) for each in (scene, plain)
    )
    for name, value in found.coordinates["x"].items():
        assert value == alone.coordinates["x"][name]
    (own,) = set(found.assumptions) - set(alone.assumptions)
    assert own.startswith("numbers that differ between units are at their means")
    assert "structure.zeta (0.05 ± 0.01), impact_pair.0.lower (-0.011 ± 0.0002)" in own
    assert own in screen(scene).notes


def test_what_is_not_told_of_units_is_told_of_their_mean() -> None:
    """Answers without assumptions carry the sentence among their warnings."""
    shaken = [Sine(amplitude=10.0, frequency_hz=40.0)]
    stiff = {"kind": "restitution", "coefficient": 0.5}
    mount = {
        "kind": "isolator",
        "mass": 1.0,
        "zeta": 0.01,
        "frequency_hz": {"mean": 0.16, "std": 0.002},
    }
    loose = Scene(
        structure=mount, excitations=[WhiteNoise(intensity=0.04, on="base")],
        absorber=Absorber(mass=0.1, play=2.0, law=stiff),
    )  # fmt: skip
    jolted = Scene(
        structure=Oscillator(mass=1.0, damping=1.0, stiffness=4e3), excitations=shaken,
        impact_pairs=[ImpactPair(clearance={"mean": 0.01, "std": 1e-4}, law=stiff)],
    )  # fmt: skip
    answers = [
        absorber(loose, levels_db=[0.0], rel_error=0.3), jolts(jolted, [0.3], paths=2, duration=4.0)
    ]  # fmt: skip
    for found in answers:
        (told,) = (each for each in found.warnings if "differ between units" in each)
        assert told.startswith("numbers that differ between units are at their means")
    plain = jolted.replace(impact_pairs=[ImpactPair(clearance=0.01, law=stiff)])
    assert not any("units" in each for each in jolts(plain, [0.3], paths=2, duration=4.0).warnings)


def test_a_warm_mount_and_stops_that_move_differ_as_before() -> None:
    scene = scene_from(DOCUMENT)
    warm = Phase(name="warm", duration=60.0, stiffness_factor=4.0).of(scene)
    differing = dict(varied(warm))
    assert differing["structure.frequency_hz"] == BetweenUnits(mean=20.0, std=0.6)
    moved = at_clearances(scene, [[0.02], [0.03]])
    assert dict(varied(moved))["impact_pair.0.upper"] == BetweenUnits(mean=0.03, std=1e-4)


def test_gaps_over_stops_with_own_distributions_have_the_closed_mean() -> None:
    scene = scene_of(pair(lower=-0.011, upper=0.01))
    sigma = float(Region(scene, Tolerances()).nominal.sigma[0])
    std, half = 0.3 * sigma, 0.5 * sigma
    differing = scene_of(
        pair(lower={"mean": -0.011, "half_width": half}, upper={"mean": 0.01, "std": std})
    )
    stops = np.array(own_distances(model_of(differing)))
    units = Units(scene=differing, spreads=spreads_of(differing), mean=np.zeros(1), stops=stops)
    units.solve(NEVER)
    ticks = (np.arange(4000) + 0.5) / 4000
    points = np.stack([ticks, np.random.default_rng(1).permutation(ticks)], axis=1)
    gaps = units.gaps(units.drawn(points))
    both = sigma**2 + std**2
    upper = sigma / math.sqrt(both) * math.exp(-0.5 * 0.01**2 / both)
    ends = norm.cdf([(0.011 - half) / sigma, (0.011 + half) / sigma])
    lower = math.sqrt(2.0 * math.pi) * sigma * float(np.diff(ends)[0]) / (2.0 * half)
    assert gaps.rice(stops).mean() == pytest.approx(gaps.rate[0, 0] * (upper + lower), rel=1e-3)
    # the control: the two distributions exchanged
    exchanged = gaps.rice(stops[::-1]).mean()
    assert exchanged != pytest.approx(gaps.rate[0, 0] * (upper + lower), rel=1e-2)


def test_the_risk_is_that_of_the_same_tolerances_on_the_command_line() -> None:
    scene = scene_from(DOCUMENT | {"impact_pair": [{"clearance": {"mean": 0.0121, "std": 1.5e-4}}
                                                   | {"law": SOFT}]})  # fmt: skip
    asked = {"mission": 60.0, "rel_error": 0.3, "seed": 2, "threads": 1}
    _, stated = tolerances_of(
        mean_unit(scene), "frequency=normal:3%,damping=uniform:20%,clearance=normal:0.15mm"
    )
    own, same = production(scene, **asked), production(mean_unit(scene), stated, **asked)
    assert own.probability.value == pytest.approx(same.probability.value, rel=1e-9)
    sized = size(scene, probability=0.01, **asked)
    assert sized.production is not None
    assert "upper = { mean = " in sized.stops_to_copy() and "std = 0.00015 }" in (
        sized.stops_to_copy()
    )
    # an option takes the place of what the scene states; none of it is left with limits alone
    limits, spreads = tolerances_of(scene, "clearance=uniform:1mm, frequency=5%")
    assert spreads["clearance"] == Spread(half_width=1e-3)
    assert list(spreads) == ["damping", "stiffness stops", "clearance"]
    assert limits == Tolerances(frequency=0.05)
    with pytest.raises(NotApplicable, match="leave out what differs between units in the scene"):
        size(scene, rate=0.1)
    phases = scene.replace(phases=[Phase(name="road", duration=60.0)])
    with pytest.raises(NotApplicable, match="nothing may differ between units where the scene has"):
        size(phases, probability=0.01)


def test_the_mean_over_the_stiffness_of_one_stop_is_an_integral() -> None:
    def stops(stiffness: Any) -> Scene:
        laws = {"lower_law": Elastic(stiffness=20.0), "upper_law": Elastic(stiffness=stiffness)}
        return Scene(
            structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
            impact_pairs=[ImpactPair(lower=-1.0, upper=1.0, **laws)],
            excitations=[WhiteNoise(intensity=0.2)],
        )

    def rate(stiffness: float) -> float:
        answer = exact(stops(stiffness)).impact_pairs["stops"]
        return float(answer.collision_rate.value)  # type: ignore[union-attr]

    scene = stops({"mean": 4.0, "half_width": 3.0})
    assert list(spreads_of(scene)) == ["stiffness upper stops"]
    table = mean_over_units(scene, method="exact", nodes=7).set_index("quantity")
    found = table.loc["stops.collision_rate"]
    integral = quad(rate, 1.0, 7.0)[0] / 6.0
    assert found["mean"] == pytest.approx(integral, rel=1e-6)
    assert abs(rate(4.0) - integral) > 1e-4 * integral  # the control: the mean unit


def test_a_width_can_be_swept_with_its_unit(tmp_path: Any) -> None:
    scene = scene_from(DOCUMENT)
    table = sweep(scene, {"impact_pair.0.upper.std": [1e-4, 2e-4]}, method="linearise")
    assert table["x.displacement_std"].iloc[0] == table["x.displacement_std"].iloc[1]
    assert Viscoelastic(**SOFT).per_unit_mass(2.0).stiffness == 5e4
