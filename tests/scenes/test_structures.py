"""Isolators: several mounts, gravity, tolerances."""

from __future__ import annotations

import math

import pytest

from stochvi import ConstantLoad, Isolator, Matrices, Scene, SceneError, WhiteNoise, exact
from stochvi.model.model import model_of
from stochvi.scenes.changed_mounts import changed_mount
from stochvi.scenes.impact_laws import Elastic
from stochvi.scenes.scene import ImpactPair


def shaken(structure: Isolator, *more: ConstantLoad) -> Scene:
    pair = ImpactPair(lower=-4e-3, upper=4e-3, law=Elastic(stiffness=1e5))
    noise = WhiteNoise(density=1e-3, unit="g2/Hz")
    return Scene(structure=structure, impact_pairs=[pair], excitations=[noise, *more])


def test_four_mounts_are_one_of_four_times_the_stiffness_and_damping() -> None:
    four = Isolator(mass=8.0, mounts=4, stiffness=1e4, damping=30.0)
    one = Isolator(mass=8.0, stiffness=4e4, damping=120.0)
    assert (four.omega, four.damping_rate) == (one.omega, one.damping_rate)
    for ours, theirs in zip(four.matrices, one.matrices, strict=True):
        assert ours == pytest.approx(theirs, rel=1e-15)
    ours, theirs = model_of(shaken(four)), model_of(shaken(one))
    assert (ours.omega, ours.damping_rate) == (theirs.omega, theirs.damping_rate)
    assert ours.intensity == theirs.intensity


def test_gravity_is_a_base_that_accelerates_upwards_at_g() -> None:
    mount = {"mass": 2.0, "frequency_hz": 12.0, "zeta": 0.1}
    with_key = shaken(Isolator(**mount, gravity=True))
    with_load = shaken(Isolator(**mount), ConstantLoad(acceleration=9.80665))
    assert model_of(with_key).load == model_of(with_load).load == -9.80665
    assert model_of(with_key).constant_force[0] == -2.0 * 9.80665
    mean, by_load = (
        exact(scene).coordinates["x"]["displacement_mean"] for scene in (with_key, with_load)
    )
    assert mean == by_load and mean is not None and mean.value < 0.0
    assert "constant load of gravity" in with_key.effects()


def test_sag_is_the_weight_over_the_stiffness() -> None:
    mount = Isolator(mass=2.0, stiffness=1e4, damping=1.0, gravity=True)
    assert mount.sag == pytest.approx(2.0 * 9.80665 / 1e4, rel=1e-15)
    free = shaken(mount).model_copy(update={"impact_pairs": ()})
    mean = exact(free).coordinates["x"]["displacement_mean"]
    assert mean is not None and mean.value == pytest.approx(-mount.sag, rel=1e-12)
    # g / (2 pi f)^2: the 25 cm of 1 Hz
    assert Isolator(frequency_hz=1.0, zeta=0.1).sag == pytest.approx(9.80665 / (4.0 * math.pi**2))


def test_tolerances_are_carried_and_change_nothing() -> None:
    plain = Isolator(frequency_hz=12.0, zeta=0.1)
    sloppy = Isolator(frequency_hz=12.0, zeta=0.1, frequency_tolerance=0.1, damping_tolerance=0.3)
    scene = Scene(structure=sloppy, excitations=[WhiteNoise(intensity=1.0)])
    assert (sloppy.omega, sloppy.damping_rate) == (plain.omega, plain.damping_rate)
    assert scene.document()["structure"]["frequency_tolerance"] == 0.1


@pytest.mark.parametrize(
    ("keys", "sentence"),
    [
        ({"mounts": 4, "frequency_hz": 12.0, "zeta": 0.1}, "takes mounts with the mass"),
        ({"mounts": 0, "mass": 1.0, "stiffness": 1.0, "damping": 1.0}, "mounts must be at least 1"),
        (
            {"mounts": 2.5, "mass": 1.0, "stiffness": 1.0, "damping": 1.0},
            "mounts must be a whole number, got 2.5",
        ),
        (
            {"gravity": 1, "frequency_hz": 12.0, "zeta": 0.1},
            "gravity must be true or false, got 1",
        ),
        (
            {"gravity": True, "mass": 1.0, "stiffness": 0.0, "damping": 1.0},
            "needs a stiffness that carries the mass under gravity, got 0",
        ),
        (
            {"frequency_tolerance": 1.0, "frequency_hz": 12.0, "zeta": 0.1},
            "frequency_tolerance must be less than 1, got 1.0",
        ),
    ],
)
def test_a_mistake_gives_a_sentence_with_its_key(keys, sentence: str) -> None:
    with pytest.raises(SceneError) as failure:
        Isolator(**keys)
    assert sentence in str(failure.value)


@pytest.mark.parametrize("names", [["", "b"], ["base", "b"], ["b", "b"]])
def test_coordinates_bear_names_of_their_own(names: list[str]) -> None:
    eye = [[1.0, 0.0], [0.0, 1.0]]
    with pytest.raises(SceneError, match="different names, none of them empty or 'base', got"):
        Matrices(coordinates=names, mass=eye, damping=eye, stiffness=eye)


@pytest.mark.parametrize(
    ("ratio", "zeta"), [({"zeta": 0.08}, 0.08), ({"Q": 5.0}, 0.1), ({"loss_factor": 0.3}, 0.15)]
)
def test_a_mount_is_taken_as_a_catalogue_gives_it(ratio: dict[str, float], zeta: float) -> None:
    """Six mounts of 9.3 kN/m each under 4.2 kg: mass, stiffness of one mount, and its damping."""
    mount = Isolator(mass=4.2, stiffness=9300.0, mounts=6, **ratio)  # type: ignore[arg-type]
    omega = math.sqrt(6.0 * 9300.0 / 4.2)
    mass, damping, stiffness = (float(each[0, 0]) for each in mount.matrices)
    assert mass == 4.2 and stiffness == pytest.approx(6.0 * 9300.0)
    assert damping == pytest.approx(2.0 * zeta * math.sqrt(6.0 * 9300.0 * 4.2))
    # a stiffer mount of the same rubber keeps its ratio
    scene = Scene(structure=mount, excitations=[WhiteNoise(density=0.01, unit="g2/Hz")])
    stiff = changed_mount(scene, 1.2, 1.0).structure
    assert isinstance(stiff, Isolator)
    assert stiff.omega == pytest.approx(1.2 * omega)
    assert stiff.damping_rate == pytest.approx(2.0 * zeta * 1.2 * omega)


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"stiffness": 9300.0, "zeta": 0.1}, "needs the mass as well as the stiffness with zeta"),
        ({"mass": 4.2, "stiffness": 9300.0, "zeta": 0.1, "Q": 5.0}, "exactly one of zeta, Q"),
        ({"mass": 4.2, "stiffness": 9300.0, "zeta": 0.1, "damping": 3.0}, "got a mixture"),
        ({"mass": 4.2, "stiffness": 9300.0, "frequency_hz": 9.0, "zeta": 0.1}, "got a mixture"),
        ({"mass": 4.2, "stiffness": 9300.0}, "one of damping, zeta, Q and loss_factor"),
    ],
)
def test_a_mount_that_says_too_little_or_too_much_is_refused(
    keys: dict[str, float], words: str
) -> None:
    with pytest.raises(SceneError, match=words):
        Isolator(**keys)  # type: ignore[arg-type]
