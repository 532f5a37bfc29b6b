"""Binary files of other programs, damaged and whole: a crash or a bomb there is a sentence here."""

from __future__ import annotations

import inspect
import json
import subprocess
import sys
import time
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

from stochvi import RecordedNoise, SceneError
from stochvi.mathematics.units import unit
from stochvi.scenes import foreign_files, foreign_reader, text_tables
from stochvi.scenes.foreign_files import read_foreign, read_numpy
from stochvi.scenes.readers import SPECTRAL_DENSITY, TIME_RESPONSE, read_columns
from support.uff import write_uff

TIME = np.arange(400) / 200.0
VALUES = np.random.default_rng(1).normal(size=400)
RECORD = ("time", "acceleration")


def of_record(path: Path, **keys: object) -> RecordedNoise:
    return RecordedNoise(file=str(path), **keys)


@pytest.mark.skipif(sys.platform == "win32", reason="needs signals")
def test_a_byte_that_makes_the_reader_crash_is_a_sentence(tmp_path: Path) -> None:
    path = tmp_path / "run.mat"
    savemat(path, {"a": np.arange(300.0)})
    content = bytearray(path.read_bytes())
    content[176] = 0x7F  # the type of the name: the reader of scipy follows a wild pointer
    path.write_bytes(content)
    here = [sys.executable, "-c", f"from scipy.io import loadmat; loadmat({str(path)!r})"]
    assert subprocess.run(here, stderr=subprocess.DEVNULL, check=False).returncode != 0
    with pytest.raises(SceneError, match=r"run\.mat is not a MATLAB file that can be read"):
        of_record(path, unit="g", fs=100.0)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["mat", "uff", "npy", "npz"])
def test_damaged_files_are_refused_in_a_sentence_or_read(tmp_path: Path, kind: str) -> None:
    path = tmp_path / f"run.{kind}"
    if kind == "mat":
        savemat(path, {"t": TIME, "a": VALUES})
    elif kind == "uff":
        write_uff(path, (TIME_RESPONSE, "floor", TIME, VALUES, "g"))
    elif kind == "npy":
        np.save(path, np.column_stack([TIME, VALUES]))
    else:
        np.savez_compressed(path, t=TIME, a=VALUES)
    content = path.read_bytes()
    random, read, told = np.random.default_rng(4), 0, []
    for number in range(6 if kind in ("mat", "uff") else 200):
        changed = bytearray(content)
        if number % 3:
            changed[random.integers(min(len(content), 400))] = random.integers(256)
        else:
            del changed[random.integers(len(content)) :]
        path.write_bytes(changed)
        try:
            of_record(path, **({} if kind == "uff" else {"unit": "g"}))
            read += 1
        except SceneError as error:
            told.append(str(error))
    assert all(len(each) < 1000 and "\n" not in each for each in told)
    assert read  # some damage is in what is not looked at


def test_a_file_that_claims_more_than_it_may_hold_takes_no_memory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(foreign_files, "MOST_NUMBERS", 100_000)
    bomb = tmp_path / "bomb.npz"
    with zipfile.ZipFile(bomb, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("a.npy", bytes(900_000))
    assert bomb.stat().st_size < 2_000
    with pytest.raises(SceneError, match="holds more than 1e"):
        read_numpy(bomb)
    claimed = tmp_path / "claimed.npy"
    np.save(claimed, np.zeros(3))
    head = claimed.read_bytes().replace(b"(3,), }", b"(9999999999999,), }")
    claimed.write_bytes(head)
    with pytest.raises(SceneError, match="is not a NumPy file that can be read"):
        read_numpy(claimed)
    objects = tmp_path / "objects.npy"
    np.save(objects, np.array([{}], dtype=object), allow_pickle=True)
    with pytest.raises(SceneError, match="is not a NumPy file that can be read"):
        read_numpy(objects)


@pytest.fixture
def read_by(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[str], None]:
    """Has files read by another program in place of the reader."""

    def other(program: str) -> None:
        path = tmp_path / "reader.py"
        path.write_text(program, encoding="utf-8")
        monkeypatch.setattr(foreign_reader, "__file__", str(path))
        foreign_files._read_apart.cache_clear()

    return other


@pytest.mark.parametrize(
    ("reader", "sentence"),
    [
        ("import os; os.kill(os.getpid(), 11)", "is not a MATLAB file that can be read"),
        ("import resource; resource.setrlimit(7, (9, 9)); open('/x' * 9)", "is not a MATLAB file"),
        ("bytearray(10**10)", "holds more than 1e"),
        ("raise NotImplementedError", "is of MATLAB 7.3; save it with the option -v7"),
        ("import os; os.kill(os.getpid(), 24)", "takes more than 60 s to be read"),
        ("print('noise'); raise KeyError", "is not a MATLAB file that can be read"),
    ],
    ids=["crash", "other error", "memory", "version", "time", "noise"],
)
@pytest.mark.skipif(sys.platform == "win32", reason="needs limits and signals")
def test_whatever_a_reader_does_is_a_sentence(
    tmp_path: Path, read_by: Callable[[str], None], reader: str, sentence: str
) -> None:
    program = Path(foreign_reader.__file__).read_text(encoding="utf-8")
    read_by(program.replace("    content = loadmat(", f"    {reader}\n    content = loadmat("))
    path = tmp_path / "run.mat"
    savemat(path, {"a": VALUES})
    with pytest.raises(SceneError, match=sentence):
        read_foreign(path, "MATLAB")


@pytest.mark.skipif(sys.platform == "win32", reason="needs limits and signals")
def test_a_matlab_file_that_claims_too_much_is_not_begun(
    tmp_path: Path, read_by: Callable[[str], None]
) -> None:
    """A compressed gigabyte took 20 s to be refused."""
    program = Path(foreign_reader.__file__).read_text(encoding="utf-8")
    program = program.replace(
        "    content = loadmat(", "    raise KeyError\n    content = loadmat("
    )
    path = tmp_path / "run.mat"
    savemat(path, {"a": VALUES, "note": "x" * 1000}, do_compression=True)
    for most, sentence in ((399, "holds more than 1e"), (400, "not a MATLAB file that can be")):
        read_by(program.replace("MOST_NUMBERS = 100_000_000", f"MOST_NUMBERS = {most}"))
        with pytest.raises(SceneError, match=sentence):
            read_foreign(path, "MATLAB")


def test_a_matlab_file_of_many_vectors_is_listed_in_short_and_at_once(tmp_path: Path) -> None:
    path = tmp_path / "run.mat"
    savemat(path, {f"a{n}": np.arange(4.0) for n in range(1500)})
    with pytest.raises(SceneError, match=r"a19 \(4\); and 1480 more"):
        of_record(path, unit="g")


def test_numpy_files_are_records_too(tmp_path: Path) -> None:
    np.save(tmp_path / "two.npy", np.column_stack([TIME, VALUES]))
    np.save(tmp_path / "one.npy", VALUES.astype("f4"))
    np.savez_compressed(tmp_path / "run.npz", t_ms=1e3 * TIME, acc_g=VALUES, note=np.array("x"))
    centred = VALUES - VALUES.mean()
    two = of_record(tmp_path / "two.npy", unit="m/s2")
    one = of_record(tmp_path / "one.npy", unit="m/s2", fs=200.0)
    named = of_record(tmp_path / "run.npz")
    assert two.record.fs == one.record.fs == named.record.fs == 200.0
    np.testing.assert_allclose(two.record.values, centred, atol=1e-12)
    np.testing.assert_allclose(one.record.values, centred, atol=1e-6)
    np.testing.assert_allclose(named.record.values, 9.80665 * centred, atol=1e-12)


def test_names_of_variables_state_units_and_a_file_without_times_says_how_to_go_on(
    tmp_path: Path,
) -> None:
    path = tmp_path / "run.mat"
    savemat(path, {"t_ms": 1e3 * TIME, "acc_g": VALUES})
    found = of_record(path)
    assert found.record.fs == 200.0 and found.density_unit == "g2/Hz"
    with pytest.raises(SceneError, match=r"is 'm/s2', but the name acc_g in .* says 'g'"):
        of_record(path, unit="m/s2")
    savemat(path, {"t": 1e3 * TIME, "acc_g": VALUES})
    with pytest.raises(SceneError, match="has a time every 5 in the variable t"):
        of_record(path)
    savemat(path, {"acc_g": VALUES})
    with pytest.raises(SceneError, match=r'give fs, and variables = \["acc_g"\]'):
        of_record(path)
    assert of_record(path, fs=200.0, variables=["acc_g"]).density_unit == "g2/Hz"


def test_a_complex_density_without_imaginary_parts_is_real(tmp_path: Path) -> None:
    import pyuff

    keys = list(inspect.signature(pyuff.prepare_58).parameters)
    entry = {key: "" if key.endswith(("name", "lab")) else 0 for key in keys[1:41]}
    entry |= {f"id{n}": "floor" for n in range(1, 6)}
    entry |= {
        "type": 58, "binary": 0, "func_type": 9, "ord_data_type": 6, "num_pts": 5,
        "data": np.full(5, 0.1 + 0j), "x": np.arange(5) * 10.0, "abscissa_spacing": 1,
        "abscissa_inc": 10.0, "ordinate_axis_units_lab": "g^2/Hz",
    }  # fmt: skip
    for imaginary, real in ((0.0, True), (1e-3, False)):
        path = tmp_path / f"density{imaginary}.uff"
        pyuff.UFF(str(path)).write_sets(entry | {"data": entry["data"] + 1j * imaginary}, "add")
        if real:
            found = read_columns(path, ("frequency_hz", "density"), function_type=SPECTRAL_DENSITY)
            np.testing.assert_allclose(found.y, 0.1)
        else:
            with pytest.raises(SceneError, match="is complex, expected the real column density"):
                read_columns(path, ("frequency_hz", "density"), function_type=SPECTRAL_DENSITY)


def test_a_record_of_another_quantity_is_told_by_what_the_file_says(tmp_path: Path) -> None:
    path = write_uff(tmp_path / "run.uff", (TIME_RESPONSE, "floor", TIME, VALUES, "Pa"))
    with pytest.raises(SceneError, match=r"unit must be one of g, m/s2, N, but dataset 1 .*'Pa'"):
        of_record(path)
    assert any("'Pa'" in each for each in of_record(path, unit="g").cautions(0.0, 0.0))


def test_a_loggers_recording_is_read_by_its_channels(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "run.ide"
    path.write_bytes(b"\x1a\x45\xdf\xa3 no recording")
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(SceneError, match=r"needs the package idelib: pip install 'stochvi\[ide\]'"):
        of_record(path)
    monkeypatch.setattr("importlib.util.find_spec", lambda name: name)
    channels = [
        foreign_files.Foreign(name, TIME, VALUES, {"of": "40g DC", "unit": "g"})
        for name in ("X (40g)", "Y (40g)")
    ]
    monkeypatch.setattr("stochvi.scenes.readers.read_foreign", lambda *_: tuple(channels))
    with pytest.raises(SceneError, match=r"1 X \(40g\) of 40g DC; 2 Y \(40g\) of 40g DC"):
        of_record(path)
    assert of_record(path, column=2).record == of_record(path, column="Y (40g)").record
    assert of_record(path, column=1).density_unit == "g2/Hz"


def test_a_channel_of_a_logger_is_read_in_seconds(tmp_path: Path) -> None:
    class Session:
        def arraySlice(self) -> np.ndarray:
            return np.array([1e6 * TIME, VALUES])

    class Part:
        name, units = "X", ("Acceleration", "g")

        def getSession(self) -> Session:
            return Session()

    class Recording:
        def __init__(self) -> None:
            parts = {"name": "40g", "subchannels": [Part(), Part()]}
            self.channels = {8: type("Channel", (), parts)()}

        def __enter__(self) -> Recording:
            return self

        def __exit__(self, *_: object) -> None: ...

    module = type(sys)("idelib")
    module.importFile = lambda path: Recording()  # type: ignore[attr-defined]
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(sys.modules, "idelib", module)
        one, two = foreign_reader.ide("run.ide")
    np.testing.assert_allclose(one["x"], TIME)
    assert json.dumps({**one, "x": 0, "y": 0}) and two["of"] == "40g"


@pytest.mark.parametrize("spelling", ["m**9**9**9**9", "((((h**9)**9)**9)**9)", "km^9^9^9"])
def test_a_unit_of_towering_powers_is_no_unit(spelling: str) -> None:
    with pytest.raises(ValueError, match="is not a known unit"):
        unit(spelling)


def test_a_quoted_cell_without_end_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    rows = "".join(f"{n / 100},{n % 3}\n" for n in range(300))
    path.write_text(rows + '3.01,"' + "1" * 140_000 + "\n")
    with pytest.raises(SceneError, match="line 301: expected a number in column 2"):
        read_columns(path, RECORD, function_type=TIME_RESPONSE)


@pytest.mark.parametrize("delimiter", [",", ";", "\t", "  "])
def test_a_million_columns_are_refused_before_their_cells_are_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, delimiter: str
) -> None:
    """Each of three million cells was looked at five times, for 17 s."""
    path = tmp_path / "run.csv"
    path.write_text((("1" + delimiter) * 100_000 + "1\n") * 3)
    with monkeypatch.context() as patch:
        patch.setattr(text_tables, "count_values", lambda _: pytest.fail("a cell was read"))
        with pytest.raises(SceneError, match="columns, got 100001;"):
            read_columns(path, RECORD, function_type=TIME_RESPONSE)
    # the negative control: thousands of columns are read, cell by cell
    path.write_text(
        "".join(f"{n / 100}{delimiter}" + f"{n % 3}{delimiter}" * 5_000 + "1\n" for n in range(3))
    )
    found = read_columns(path, RECORD, column=4_000, function_type=TIME_RESPONSE)
    assert found.y.tolist() == [0.0, 1.0, 2.0]


@pytest.mark.parametrize("word", ["m/s2 ", "m/s2*", "(", " "])
def test_a_towering_heading_is_neither_searched_nor_repeated(tmp_path: Path, word: str) -> None:
    """Of 40,000 words each was taken for the start of a unit that ends with the last: minutes."""
    path = tmp_path / "run.csv"
    rows = "".join(f"{n / 200:g},{value}\n" for n, value in enumerate(VALUES))
    for heading in (f"t (s),a ({word * 40_000}m)", f"t ({word * 40_000}s),a (g)"):
        path.write_text(f"{heading}\n{rows}")
        for keys in ({}, {"unit": "g"}):
            began = time.process_time()
            try:
                told = " ".join(of_record(path, **keys).cautions(0.0, 0.0))
            except SceneError as error:
                told = str(error)
            assert time.process_time() - began < 3.0 and len(told) < 800 + 3 * len(str(path))


@pytest.mark.parametrize("secret", ["root:x:0:0:root", "-----BEGIN PRIVATE KEY-----", "1 hunter2"])
def test_a_refusal_shows_no_text_of_a_file_that_is_no_table(tmp_path: Path, secret: str) -> None:
    """A scene of somebody else may name any file that its reader may read."""
    path = tmp_path / "secret"
    path.write_text(f"{secret}\n{secret}\n")
    for names in (RECORD, ("acceleration",), ("deflection", "force")):
        with pytest.raises(SceneError) as failure:
            read_columns(path, names, function_type=TIME_RESPONSE)
        told = str(failure.value).replace(str(path), "")
        assert not any(word in told for word in (secret, "hunter2", "PRIVATE", "root"))
