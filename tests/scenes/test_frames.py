"""Arrays, series and frames in the place of files: they are read, and refused, as files are."""

from __future__ import annotations

import pickle
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pint
import pytest
import xarray as xr

from stochvi import (
    ForceTable,
    ImpactPair,
    Isolator,
    RecordedNoise,
    Restitution,
    Scene,
    SceneError,
    TabulatedNoise,
    sweep,
)
from stochvi.scenes import Modes, Pulses, RelaxationSpring, SpringTable
from stochvi.scenes.excitations import Modulation
from stochvi.scenes.scene import scene_from
from support.refusals import refusals

VALUES = np.random.default_rng(1).normal(size=4000)
TIMES = np.arange(4000) / 400.0
SINCE = pd.to_timedelta(TIMES, unit="s")
ALONG = {"dims": "time", "coords": {"time": TIMES}}


@pytest.mark.parametrize(
    "values",
    [
        pd.Series(VALUES, index=TIMES),
        pd.Series(VALUES, index=SINCE),
        pd.Series(VALUES, index=pd.Timestamp("2026-01-01", tz="UTC") + SINCE),
        pd.DataFrame({"acc": VALUES}, index=pd.Index(1e3 * TIMES, name="time (ms)")),
        pd.DataFrame({"time (s)": TIMES, "acc (g)": VALUES}),
        xr.DataArray(VALUES, **ALONG, attrs={"units": "g"}),
        xr.Dataset({"acc": xr.DataArray(VALUES, **ALONG)}),
        np.column_stack([TIMES, VALUES]),
        np.stack([TIMES, VALUES]),
        {"t_s": TIMES, "acc": VALUES},
    ],
    ids=lambda each: type(each).__name__,
)  # fmt: skip
def test_a_record_in_memory_is_that_of_its_file(values: Any, tmp_path: Path) -> None:
    file = tmp_path / "run.txt"
    np.savetxt(file, np.column_stack([TIMES, VALUES]), fmt="%.17g")
    wanted = RecordedNoise(file=str(file), unit="g").record
    found = RecordedNoise(values=values, unit="g").record
    assert found.fs == pytest.approx(wanted.fs, rel=1e-12)
    np.testing.assert_allclose(found.values, wanted.values, rtol=0.0, atol=1e-12)


def _record(changes: dict[str, Any]) -> RecordedNoise:
    return RecordedNoise(**{"values": VALUES, "fs": 400.0, "unit": "g"} | changes)


SERIES = pd.Series(VALUES, index=TIMES, name="acc (g)")

test_records_that_are_refused = refusals(
    _record,
    ({"unit": None}, "needs unit, one of g"),
    ({"fs": 1e-300}, "fs must be from 1e-06 to 1e+12 Hz, got 1e-300"),
    ({"fs": 1e300}, "fs must be from 1e-06 to 1e+12 Hz, got 1e+300"),
    ({"fs": None}, "give fs, the sampling rate in Hz, or a Series"),
    ({"values": SERIES, "unit": "m/s2", "fs": None}, "array says 'g'"),
    ({"values": SERIES, "fs": 500.0}, "the times of array give 400 Hz"),
    ({"values": SERIES.where(TIMES != 3.0)}, 'a gap (0.0025 s at 3 s); say gaps = "split"'),
    ({"values": SERIES.set_axis(1e3 * TIMES), "fs": None}, "in milliseconds 400 Hz"),
    ({"values": pd.DataFrame({"x": VALUES, "y": VALUES})}, "column must say which column"),
    ({"values": VALUES + 1j}, "columns of real numbers, got complex128"),
    ({"values": ["a", "b"]}, "columns of real numbers"),
    ({"values": {"t_s": [0.0, 1.0], "acc": [1.0, 2.0, 3.0]}}, "one length, got lengths [2, 3]"),
    ({"values": xr.DataArray(np.zeros((3, 4)))}, "must have one dimension, got ['dim_0'"),
    ({"values": VALUES[:100]}, "expected at least 256"),
    ({"values": None}, "exactly one of file and values, got none"),
    ({"file": "a.csv"}, "exactly one of file and values, got file, values"),
)


@pytest.mark.parametrize("units", ["mg", "milli-gee", "mm"])
def test_a_name_and_an_attribute_that_contradict_are_refused(units: str) -> None:
    array = xr.DataArray(VALUES, **ALONG, name="acc (g)", attrs={"units": units})
    told = f"'g' in the name 'acc \\(g\\)', but '{units}' in its attributes"
    with pytest.raises(SceneError, match=told):
        RecordedNoise(values=array)
    array.attrs["units"] = "m/s/s" if units == "mm" else "g"
    named = array.rename("acc (m/s2)") if units == "mm" else array
    assert RecordedNoise(values=named).as_read.fs == pytest.approx(400.0)


@pytest.mark.parametrize("spelling", ["g_0", "mm / s ** 2", "standard_gravity", "meter/second**2"])
def test_quantities_of_pint_keep_their_units(spelling: str) -> None:
    registry = pint.UnitRegistry()
    held = registry.Quantity(VALUES, spelling)
    factor = float(registry.Quantity(1.0, spelling).to("m/s**2").magnitude)
    for values in (held, {"acc": held}, xr.DataArray(held, dims="time")):
        found = RecordedNoise(values=values, fs=400.0).record
        assert found.peak == pytest.approx(factor * np.abs(VALUES - VALUES.mean()).max())
    for form in (str(held.units), f"{held.units:~}", f"{held.units:~P}", f"{held.units:C}"):
        named = pd.Series(VALUES, name="acc", index=TIMES)
        named.attrs["units"] = form
        assert RecordedNoise(values=named).record.peak == pytest.approx(found.peak)


def test_the_index_of_a_frame_is_no_column() -> None:
    frame = pd.DataFrame({"x": VALUES, "z": 2.0 * VALUES}, index=TIMES)
    for column, factor in ((1, 1.0), ("x", 1.0), (2, 2.0), ("2 z", 2.0)):
        found = RecordedNoise(values=frame, unit="m/s2", column=column).record
        np.testing.assert_allclose(found.values, factor * (VALUES - VALUES.mean()), atol=1e-12)
    with pytest.raises(SceneError, match=r"\(column = 'z' or column = 2\): it holds .* 1 x, 2 z"):
        RecordedNoise(values=frame, unit="g")
    with pytest.raises(SceneError, match="is 3, but array holds the columns 1 x, 2 z"):
        RecordedNoise(values=frame, unit="g", column=3)


def test_densities_curves_modes_and_pulses_become_numbers() -> None:
    psd = pd.Series([0.01, 0.01, 0.001], index=[10, 20, 500], name="psd (g2/Hz)")
    noise = TabulatedNoise(values=psd)
    assert noise == TabulatedNoise(frequency_hz=[10, 20, 500], density=psd.tolist(), unit="g2/Hz")
    curve = pd.Series([0.0, 1.0, 4.0], index=[0.0, 1.0, 2.0])
    for kind in (ForceTable, SpringTable):
        assert kind(values=curve, unit="mm,N").deflection == pytest.approx((0.0, 1e-3, 2e-3))
    table = pd.DataFrame({"frequency_hz": [20.0, 125.0], "zeta": [0.01, 0.02], "tip": [1.0, -1.0]})
    assert Modes(values=table).shapes == {"tip": (1.0, -1.0)}
    assert Modulation(of="stiffness", values=pd.Series([0.1, 0.1], index=[1.0, 2.0])).table
    f = np.geomspace(0.1, 100.0, 31)
    rubber = {"frequency_hz": f, "dynamic_stiffness": 0 * f + 1e5, "loss_factor": 0 * f}
    assert RelaxationSpring(values=rubber).stiffness == pytest.approx(1e5)
    half_sine = np.sin(np.linspace(0.0, np.pi, 50))
    pulse = Pulses(rate=1.0, values=half_sine, fs=1000.0, unit="g", on="base")
    assert pulse.shock is not None and pulse.shock.peak == pytest.approx(9.80665, rel=1e-3)


def _scene() -> Scene:
    stops = ImpactPair(clearance=4e-3, law=Restitution(coefficient=0.5))
    return Scene(
        structure=Isolator(frequency_hz=12.0, zeta=0.1), impact_pairs=[stops],
        excitations=[RecordedNoise(values=SERIES)],
    )  # fmt: skip


def test_documents_hold_the_digest_of_a_record_and_find_it_in_their_process() -> None:
    scene = _scene()
    (written,) = scene.document()["excitation"]
    assert written["values"].startswith("sha256:") and len(written["values"]) == 71
    assert scene_from(scene.document()) == scene == pickle.loads(pickle.dumps(scene))
    swept = sweep(scene, {"structure.frequency_hz": [10.0, 12.0]}, method="linearise")
    assert len(swept) == 2
    with pytest.raises(SceneError, match="the digest of numbers that only the process had"):
        RecordedNoise(values="sha256:" + 64 * "0", unit="g")


def test_arrays_load_no_package() -> None:
    asked = (
        "import sys, numpy as np\nfrom stochvi.scenes import frames\n"
        "frames.Frame.of(np.ones(9))\nassert not {'pandas', 'xarray'} & set(sys.modules)"
    )
    subprocess.run([sys.executable, "-c", asked], check=True)
