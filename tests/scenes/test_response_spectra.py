"""The spectrum of one scene as the excitation of another."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from stochvi.mathematics.frequency_response import gains
from stochvi.methods.closed_form import exact
from stochvi.results.errors import SceneError
from stochvi.results.estimates import Estimate
from stochvi.scenes.excitations import TabulatedNoise
from stochvi.scenes.scene import Scene, load_scene
from stochvi.scenes.structures import Isolator, Matrices
from stochvi.statistics.spectra import spectrum
from stochvi.testing import assert_agrees
from stochvi.views.files import write_table

CARRIER = Matrices(
    coordinates=["body", "wheel"],
    mass=[[300.0, 0.0], [0.0, 40.0]],
    damping=[[1500.0, -1500.0], [-1500.0, 2500.0]],
    stiffness=[[2e4, -2e4], [-2e4, 2e5]],
)
SHAKEN = TabulatedNoise(on="base", frequency_hz=[0.3, 40.0], density=[1.0, 1.0], unit="(m/s2)2/Hz")
BOX = Isolator(frequency_hz=6.0, zeta=0.2)


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("spectra") / "spectrum.csv"
    found = spectrum(Scene(structure=CARRIER, excitations=[SHAKEN]), paths=64, highest=30.0)
    write_table(found.to_frame(), path)
    return path


def through_both(coordinate: str) -> float:
    """Mean square stroke of the box on a coordinate of the carrier, m^2: by frequency responses."""
    mass, damping, stiffness = CARRIER.matrices
    f = np.linspace(0.3, 30.0, 60_001)
    inverse = np.linalg.inv(mass)
    moved = gains(f, inverse @ stiffness, inverse @ damping, -np.ones(2))
    w = 2.0 * np.pi * f
    absolute = 1.0 - w**2 * moved[:, CARRIER.coordinates.index(coordinate)]
    stroke = absolute / (BOX.omega**2 - w**2 + 1j * w * BOX.damping_rate)
    return float(np.trapezoid(np.abs(stroke) ** 2, f))


def estimated(path: Path, of: str) -> Estimate:
    """Mean square stroke of the box under the table, with its error from those of the bins."""
    noise = TabulatedNoise(on="base", file=str(path), of=of)
    scene = Scene(structure=BOX, excitations=[noise])
    table = pd.read_csv(path)
    table = table[(table["of"] == of) & (table["quantity"] == "acceleration")]
    w = 2.0 * np.pi * table["frequency_hz"].to_numpy()
    weight = np.gradient(w / (2.0 * np.pi))
    weight /= np.abs(BOX.omega**2 - w**2 + 1j * w * BOX.damping_rate) ** 2
    return Estimate(
        value=exact(scene).coordinates["x"]["displacement_mean_square"].value,
        # Hann's window ties neighbours: correlations of 4/9 and 1/36, on either side
        standard_error=float(np.sqrt(1.95 * np.sum((weight * table["standard_error"]) ** 2))),
        bias=float(np.sum(weight * table["bias"])),
    )


@pytest.mark.parametrize("of", ["body", "wheel"])
def test_a_box_on_a_coordinate_moves_as_through_both_gains(written: Path, of: str) -> None:
    found, other = estimated(written, of), {"body": "wheel", "wheel": "body"}[of]
    assert_agrees(found, through_both(of))
    assert found.standard_error < 0.05 * found.value
    with pytest.raises(AssertionError, match="standard errors"):
        assert_agrees(found, through_both(other))


def test_the_error_of_the_estimate_is_told(written: Path) -> None:
    noise = TabulatedNoise(on="base", file=str(written), of="body")
    (said,) = noise.cautions(1.0, 0.1)
    assert "acceleration of body, estimated by simulation" in said
    assert noise.density_unit == "(m/s2)2/Hz"
    plain = TabulatedNoise(on="base", profile="mil-std-810h-truck-vertical-5hz")
    assert not plain.cautions(1.0, 0.1)


def test_a_scene_file_names_the_spectrum_in_its_folder(written: Path) -> None:
    scene = written.parent / "box.toml"
    scene.write_text(
        '[structure]\nkind = "isolator"\nfrequency_hz = 6.0\nzeta = 0.2\n'
        '[[excitation]]\nkind = "psd"\nfile = "spectrum.csv"\nof = "body"\n',
        encoding="utf-8",
    )
    loaded = load_scene(scene)
    again = Scene(**loaded.document())
    assert loaded.excitations[0].table == again.excitations[0].table
    (louder,) = loaded.at_level(10.0).excitations
    np.testing.assert_allclose(louder.table.density, 10.0 * loaded.excitations[0].table.density)


@pytest.mark.parametrize(
    ("keys", "sentence"),
    [
        ({}, "must say whose acceleration is meant: 'body' or 'wheel'"),
        ({"of": "boot"}, "must be 'body' or 'wheel', got 'boot'"),
        ({"of": "body", "unit": "g2/Hz"}, "take out the one that is wrong"),
    ],
)
def test_a_choice_that_is_not_there_is_refused(written: Path, keys: dict, sentence: str) -> None:
    with pytest.raises(SceneError, match=sentence):
        TabulatedNoise(on="base", file=str(written), **keys)


def test_of_is_refused_for_other_tables(tmp_path: Path) -> None:
    table = tmp_path / "table.csv"
    table.write_text("frequency_hz,density\n1,2\n3,4\n", encoding="utf-8")
    with pytest.raises(SceneError, match=r"of chooses a coordinate of a spectrum\.csv"):
        TabulatedNoise(on="base", file=str(table), of="body", unit="g2/Hz")
    with pytest.raises(SceneError, match="has of"):
        TabulatedNoise(on="base", frequency_hz=[1.0, 2.0], density=[1.0, 1.0], unit="g2/Hz", of="x")


def test_the_only_coordinate_of_a_file_need_not_be_named(written: Path, tmp_path: Path) -> None:
    lines = written.read_text(encoding="utf-8").splitlines()
    path = tmp_path / "spectrum.csv"
    path.write_text("\n".join(each for each in lines if "wheel" not in each), encoding="utf-8")
    whole = TabulatedNoise(on="base", file=str(written), of="body")
    assert TabulatedNoise(on="base", file=str(path)).table == whole.table


def test_a_spectrum_without_acceleration_is_refused(written: Path, tmp_path: Path) -> None:
    lines = written.read_text(encoding="utf-8").splitlines()
    path = tmp_path / "spectrum.csv"
    kept = [line for line in lines if ",acceleration," not in line]
    path.write_text("\n".join(kept), encoding="utf-8")
    with pytest.raises(SceneError, match="holds no absolute acceleration"):
        TabulatedNoise(on="base", file=str(path), of="body")
