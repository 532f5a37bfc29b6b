"""Modulations by tabulated noise: equations of moments, filtered and white noise judge them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stochvi import (
    ImpactPair,
    Matrices,
    Restitution,
    Scene,
    SceneError,
    history,
    simulate,
    spectrum,
    stability,
)
from stochvi.mathematics.frequency_response import bin_variances
from stochvi.mathematics.moment_growth import FilteredChange
from stochvi.methods.monte_carlo.choose_plan import make_plan
from stochvi.model.model import model_of
from stochvi.scenes import Modulation
from stochvi.scenes.scene import scene_from
from stochvi.testing import assert_agrees
from support.modulated import S0, B, M, W, scene_of

FILTERED: dict[str, Any] = {"intensity": 0.08, "frequency_hz": 0.6, "zeta": 0.4}
STOPS = [ImpactPair(lower=-0.8, upper=1.0, law=Restitution(coefficient=0.7))]


def table_of(of: str, intensity: float, frequency_hz: float, zeta: float) -> Modulation:
    """The density of filtered noise, 2 S / ((1 - r^2)^2 + (2 zeta r)^2), as a table."""
    f = np.geomspace(frequency_hz / 300.0, 20.0 * frequency_hz, 300)
    r = f / frequency_hz
    density = 2.0 * intensity / ((1.0 - r**2) ** 2 + (2.0 * zeta * r) ** 2)
    return Modulation(of=of, frequency_hz=f, density=density)


def flat(of: str, intensity: float, highest: float) -> Modulation:
    density = 2.0 * intensity
    return Modulation(of=of, frequency_hz=[1e-3, highest], density=[density, density])


def mean_squares(of: str) -> tuple[float, float]:
    """E x^2 and E v^2 under filtered noise, by moments times Hermite polynomials of the filter."""
    modulation = Modulation(of=of, **FILTERED)
    assert modulation.filter is not None
    system = np.array([[0.0, 2.0, 0.0], [-(W**2), -B, 1.0], [0.0, -2.0 * W**2, -2.0 * B]])
    change = np.zeros((3, 3))
    if of == "stiffness":
        change[1, 0], change[2, 1] = -(W**2), -2.0 * W**2
    else:
        change[1, 1], change[2, 2] = -B, -2.0 * B
    generator, size = FilteredChange(change, *modulation.filter).operators(24)
    whole = (
        np.kron(np.eye(len(size)), system) + np.kron(size.T, change)
        + np.kron(generator.T, np.eye(3))
    )  # fmt: skip
    source = np.zeros(len(whole))
    source[2] = S0 / M**2
    found = np.linalg.solve(whole, -source)
    return float(found[0]), float(found[2])


@pytest.mark.slow
@pytest.mark.parametrize("of", ["stiffness", "damping"])
def test_a_table_of_filtered_noise_has_the_mean_squares_of_its_equations(of: str) -> None:
    known = mean_squares(of)
    found = simulate(scene_of(table_of(of, **FILTERED)), paths=512, duration=200.0, seed=5)
    for balance in found.identities.values():
        assert_agrees(balance, 0.0)
    for name, value in zip(
        ("displacement_mean_square", "velocity_mean_square"), known, strict=True
    ):
        assert_agrees(found.coordinates["x"][name], value)
    if of == "stiffness":
        with pytest.raises(AssertionError):  # the motion without the modulation
            assert_agrees(found.coordinates["x"]["velocity_mean_square"], S0 / M**2 / (2.0 * B))


@pytest.mark.slow
def test_stops_are_hit_as_under_filtered_noise() -> None:
    options: dict[str, Any] = {"paths": 512, "duration": 100.0, "seed": 3}
    table, filtered, still = (
        simulate(scene_of(*each, pairs=STOPS), **options)
        for each in (
            [table_of("stiffness", 0.3, 0.6, 0.4)],
            [Modulation(of="stiffness", intensity=0.3, frequency_hz=0.6, zeta=0.4)],
            [],
        )
    )
    for name in ("collision_rate", "impact_speed_square_rate"):
        one, other, none = (each.impact_pairs["stops"][name] for each in (table, filtered, still))
        error = 4.5 * float(np.hypot(one.standard_error, other.standard_error))
        error += (one.bias or 0.0) + (other.bias or 0.0)
        assert one.value == pytest.approx(other.value, abs=error)
        assert abs(none.value - one.value) > error  # the control


@pytest.mark.slow
def test_growth_is_that_under_filtered_noise_and_under_white_noise_of_a_wide_table() -> None:
    def exponent(modulation: Modulation) -> Any:
        found = stability(scene_of(modulation, noise=0.0), rel_error=0.02, seed=2)
        return found.lyapunov_exponent

    for table, other in (
        (table_of("stiffness", 0.1, 0.6, 0.4),
         Modulation(of="stiffness", intensity=0.1, frequency_hz=0.6, zeta=0.4)),
        (flat("stiffness", 0.1, 8.0), Modulation(of="stiffness", intensity=0.1)),
    ):  # fmt: skip
        one, two = exponent(table), exponent(other)
        error = 4.5 * float(np.hypot(one.standard_error, two.standard_error))
        error += (one.bias or 0.0) + (two.bias or 0.0)
        assert one.value == pytest.approx(two.value, abs=error)
        assert abs(one.value + B / 2.0) > error  # the decay without a modulation
    # a table that ends below twice the natural frequency has nothing to drive the motion with
    below = exponent(flat("stiffness", 0.1, 0.5))
    assert below.value < one.value - 4.5 * float(np.hypot(below.standard_error, 0.0))


def test_mean_squares_of_a_wide_table_tend_to_those_of_white_noise() -> None:
    """E v^2 = S0 / (m^2 (2 b - W^2 S)); a table up to 40 natural frequencies is nearly white."""
    intensity = 0.06
    known = S0 / M**2 / (2.0 * B - W**2 * intensity)
    found = simulate(
        scene_of(flat("stiffness", intensity, 12.0)), paths=512, duration=200.0, seed=4
    )
    assert_agrees(found.coordinates["x"]["velocity_mean_square"], known)
    narrow = simulate(
        scene_of(flat("stiffness", intensity, 0.4)), paths=512, duration=200.0, seed=4
    )
    with pytest.raises(AssertionError):
        assert_agrees(narrow.coordinates["x"]["velocity_mean_square"], known)


def test_bins_of_a_table_hold_all_of_its_variance() -> None:
    table = table_of("stiffness", **FILTERED).table
    assert table is not None
    highest = float(table.frequency_hz[-1])
    variances = bin_variances(table, 40.0, round(1.1 * highest * 40.0))
    assert variances.sum() == pytest.approx(table.mean_square(), rel=1e-6)
    # W S / (4 zeta), less what lies below the table
    known = 2.0 * np.pi * 0.6 * 0.08 / (4.0 * 0.4) - 2.0 * 0.08 * 0.6 / 300.0
    assert table.mean_square() == pytest.approx(known, rel=1e-3)


def test_samples_of_a_modulation_have_its_variance_and_nothing_shakes_the_modes() -> None:
    plan: Any = make_plan(model_of(scene_of(table_of("stiffness", **FILTERED))))
    free = plan.free_response(1, 0, 64, 0)
    assert free.shape[1] == 2 and not free[:, 0].any()
    values = free[:, 1, 0::2]
    squares = np.mean(values**2, axis=0)
    error = 4.5 * squares.std(ddof=1) / np.sqrt(len(squares))
    assert squares.mean() == pytest.approx(2.0 * np.pi * 0.6 * 0.08 / 1.6, abs=error)


@pytest.mark.slow
def test_other_tables_several_coordinates_records_and_spectra_go_beside_it() -> None:
    base = {"kind": "psd", "on": "a", "unit": "N2/Hz", "frequency_hz": [0.05, 2.0]}
    scene = Scene(
        structure=Matrices(
            coordinates=["a", "b"], mass=[[2.0, 0.0], [0.0, 1.0]],
            damping=[[0.8, -0.2], [-0.2, 0.4]], stiffness=[[12.0, -4.0], [-4.0, 8.0]],
        ),
        impact_pairs=[
            ImpactPair(on="b", lower=-0.8, upper=0.8, law=Restitution(coefficient=0.7))
        ],
        excitations=[
            base | {"density": [0.5, 0.5]},
            Modulation(of="stiffness", between=("a", "b"), frequency_hz=[0.1, 3.0],
                       density=[0.05, 0.05]),
            Modulation(of="damping", on="a", intensity=0.02, frequency_hz=0.5, zeta=0.3),
            Modulation(of="damping", between=("a", "b"), frequency_hz=[0.1, 1.0],
                       density=[0.1, 0.1]),
        ],
    )  # fmt: skip
    found = simulate(scene, paths=64, duration=100.0, seed=1)
    for balance in found.identities.values():
        assert_agrees(balance, 0.0)
    record = history(scene, duration=20.0, seed=1)
    assert np.isfinite(record.to_frame().to_numpy()).all()
    assert spectrum(scene, rel_error=0.3).to_dict()["method"] == "spectrum:welch"


def test_a_table_from_a_file_is_the_same_one(tmp_path: Path) -> None:
    rows = ["frequency_hz,density", "0.5,0.01", "2.0,0.04", "8.0,0.01"]
    (tmp_path / "current.csv").write_text("\n".join(rows))
    document = {
        "structure": {"kind": "oscillator", "mass": 1.0, "damping": 0.1, "stiffness": 4.0},
        "excitation": [{"kind": "modulation", "of": "stiffness", "file": "current.csv"}],
    }
    scene = scene_from(document, folder=tmp_path)
    (read,) = scene.modulations
    written = Modulation(of="stiffness", frequency_hz=[0.5, 2.0, 8.0], density=[0.01, 0.04, 0.01])
    assert read.table == written.table and read.source == "tabulated noise"
    assert "0.5 to 8 Hz" in read.facts("x", {})[0][1]
    again = scene_from(json.loads(json.dumps(scene.document())))
    assert again.modulations[0].table == read.table
    (tmp_path / "current.csv").write_text("f (Hz),density (g2/Hz)\n0.5,0.01\n2,0.04\n")
    with pytest.raises(SceneError, match="must hold the density of a relative change"):
        scene_from(document, folder=tmp_path)


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"frequency_hz": [1.0, 2.0]}, "lists of frequency_hz and density or a file (a table)"),
        ({"frequency_hz": 1.0, "density": [1.0, 2.0]}, "got frequency_hz, density"),
        ({"amplitude": 0.1, "frequency_hz": [1.0, 2.0]}, "got amplitude, frequency_hz"),
        ({"frequency_hz": [1.0, 2.0], "density": [1.0]}, "needs as many densities as frequencies"),
        ({"frequency_hz": [2.0, 1.0], "density": [1.0, 1.0]}, "needs increasing frequency_hz"),
        ({"frequency_hz": [1.0, 0.0], "density": [1.0, 1.0]}, "frequency_hz.1 must be greater"),
    ],
)  # fmt: skip
def test_what_is_no_table_is_refused_in_a_sentence(keys: Any, words: str) -> None:
    with pytest.raises(SceneError) as failure:
        Modulation(**({"of": "stiffness"} | keys))
    assert words in str(failure.value)
