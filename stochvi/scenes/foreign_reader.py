"""A program that reads one binary file of another program and writes its arrays to standard output.

`readers.py` starts it: a damaged file may crash a library that reads it, or fill the memory,
and takes down nothing but this. It imports nothing of stochvi, which would take longer than most
files, unless a package has the reader. First comes a line of JSON, an error or the arrays with
their names, then their numbers.
"""

from __future__ import annotations

import json
import math
import os
import sys
import warnings
from collections.abc import Callable, Iterator, Mapping
from typing import Any, BinaryIO

MOST_BYTES = 4_000_000_000
"""Largest address space, bytes."""

MOST_SECONDS = 60
"""Largest processor time, s: a file of 200 MB takes some seconds."""

MOST_NUMBERS = 100_000_000
"""Largest count of numbers in all arrays together, 800 MB."""

MOST_WRITTEN = 1000
"""Largest file that is written, bytes: some libraries open a file for what they may write."""

REAL = "fiu"
"""Kinds of the data types of numpy that hold real numbers."""

OF_MATLAB = {"double", "single"} | {f"{sign}int{2**n}" for sign in ("", "u") for n in range(3, 7)}
"""Classes of MATLAB that hold numbers."""


def main(kind: str, path: str, modules: str) -> None:
    """Read a file of a kind, with modules from the folders that a list in JSON names."""
    output = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what a library prints is no answer
    sys.dont_write_bytecode = True  # it would be cut at the limit, and kept
    limit()
    sys.path[:] = json.loads(modules)
    answer(kind, path, output)
    output.close()


def answer(kind: str, path: str, output: BinaryIO) -> None:
    """Write the arrays of a file, or why there are none."""
    warnings.simplefilter("ignore")
    try:
        arrays = list(within_limit(READERS[kind](path) if kind in READERS else own(kind, path)))
    except MemoryError:
        error = {"error": "memory"}
    except EOFError:
        error = {"error": "short"}
    except Exception as raised:  # libraries raise errors of many kinds when they parse
        error = {"error": "unreadable", "text": f"{type(raised).__name__}: {raised}"}
    else:
        write(output, arrays)
        return
    output.write(json.dumps(error).encode() + b"\n")


def limit() -> None:
    """Limit memory and time, where the system can."""
    try:
        import resource
    except ImportError:  # Windows
        return
    for what, most in (
        (resource.RLIMIT_AS, MOST_BYTES), (resource.RLIMIT_CPU, MOST_SECONDS),
        (resource.RLIMIT_CORE, 0), (resource.RLIMIT_FSIZE, MOST_WRITTEN),
    ):  # fmt: skip
        try:
            resource.setrlimit(what, (most, most))
        except (OSError, ValueError):  # a lower limit holds already
            continue


def within_limit(arrays: Iterator[dict[str, Any]]) -> Iterator[dict[str, Any]]:
    """The arrays, as long as they hold no more than `MOST_NUMBERS` together."""
    count = 0
    for each in arrays:
        count += sum(each[axis].size for axis in ("x", "y") if each[axis] is not None)
        if count > MOST_NUMBERS:
            raise MemoryError
        yield each


def write(output: BinaryIO, arrays: list[dict[str, Any]]) -> None:
    """Write facts and sizes of arrays as JSON, and their numbers after it."""
    facts = [
        each | {axis: None if each[axis] is None else each[axis].shape for axis in ("x", "y")}
        for each in arrays
    ]
    output.write(json.dumps({"arrays": facts}).encode() + b"\n")
    for each in arrays:
        for axis in ("x", "y"):
            if each[axis] is not None:
                output.write(each[axis].astype("<f8").tobytes())


def matlab(path: str) -> Iterator[dict[str, Any]]:
    """Arrays of numbers, vectors with one dimension, of complex ones the real parts; a field of a
    structure has a name such as "run.acc"."""
    from scipy.io import loadmat, whosmat

    # what the headers claim, before any of it is read
    claimed = (math.prod(shape) for _, shape, kind in whosmat(path) if kind in OF_MATLAB)
    if sum(claimed) > MOST_NUMBERS:
        raise MemoryError
    content = loadmat(path, simplify_cells=True)
    yield from numeric({name: value for name, value in content.items() if name[:2] != "__"})


def numeric(content: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    """The arrays of numbers among variables, and among fields of structures."""
    import numpy as np

    for name, value in content.items():
        if isinstance(value, Mapping):
            yield from numeric({f"{name}.{field}": inner for field, inner in value.items()})
            continue
        try:
            array = np.asarray(value)
        except ValueError:  # cells of different sizes
            continue
        if array.dtype.kind in f"{REAL}c" and array.size > 1:
            flat = array.ravel() if max(array.shape) == array.size else array
            turned = bool(np.any(np.imag(flat)))
            yield {"name": name, "complex": turned, "x": None, "y": np.real(flat).astype(float)}


def matlab_hdf5(path: str) -> Iterator[dict[str, Any]]:
    """The same of a file of version 7.3, whose arrays lie in it with their last index first."""
    import h5py

    def plain(array: Any) -> Any:
        return array["real"] + 1j * array["imag"] if array.dtype.names else array

    def of_numbers(group: Any) -> dict[str, Any]:
        fields = {name: each for name, each in group.items() if name[0] != "#"}
        return {
            name: of_numbers(each) if isinstance(each, h5py.Group) else plain(each[()].T)
            for name, each in fields.items()
            if isinstance(each, h5py.Group)
            or each.attrs.get("MATLAB_class", b"").decode() in OF_MATLAB
        }

    with h5py.File(path) as file:
        claimed: list[int] = []
        file.visititems(lambda _, each: claimed.append(getattr(each, "size", 0)))
        if sum(claimed) > MOST_NUMBERS:
            raise MemoryError
        yield from numeric(of_numbers(file))


def uff(path: str) -> Iterator[dict[str, Any]]:
    """The datasets 58, named by their numbers among all datasets, from 1."""
    import numpy as np
    import pyuff

    file = pyuff.UFF(path)
    for number, kind in enumerate(file.get_set_types()):
        if int(kind) != 58:
            continue
        entry = file.read_sets(number)
        held = int(entry["num_pts"])  # zeros or blanks may fill the last line
        x, y = np.asarray(entry["x"])[:held], np.asarray(entry["data"])[:held]
        if len(y) < held:
            raise EOFError
        turned = bool(np.iscomplexobj(y) and np.any(y.imag))
        facts = {key: str(entry.get(key) or "") for key in (*(f"id{n}" for n in range(1, 6)),)}
        yield {
            "name": str(number + 1), "type": int(entry["func_type"]), "complex": turned, **facts,
            "label": str(entry.get("ordinate_axis_lab") or ""),
            "unit": str(entry.get("ordinate_axis_units_lab") or ""),
            "x_unit": str(entry.get("abscissa_axis_units_lab") or ""),
            "x": x.real.astype(float), "y": y.real.astype(float),
        }  # fmt: skip


def uff_modes(path: str) -> Iterator[dict[str, Any]]:
    """The mode shapes in datasets 55, (nodes, directions) over the numbers of the nodes."""
    import numpy as np
    import pyuff

    file = pyuff.UFF(path)
    for number, kind in enumerate(file.get_set_types()):
        if int(kind) != 55:
            continue
        entry = file.read_sets(number)
        if int(entry["analysis_type"]) not in (2, 3, 7):  # normal or complex modes
            continue
        given = [np.asarray(entry[f"r{n}"]) for n in range(1, 7) if entry.get(f"r{n}") is not None]
        columns = [each for each in given if each.size]
        normal = int(entry["analysis_type"]) == 2
        yield {
            "name": str(number + 1),
            "complex": not normal or any(np.any(np.imag(each)) for each in columns),
            "frequency_hz": float(entry.get("freq") or 0.0) if normal else 0.0,
            "modal_mass": float(entry.get("modal_m") or 0.0) if normal else 0.0,
            "zeta": float(entry.get("modal_damp_vis") or 0.0) if normal else 0.0,
            "x": np.asarray(entry["node_nums"]).astype(float),
            "y": np.real(np.stack(columns, axis=1)).astype(float),
        }


def op2_tables(path: str) -> dict[str, list[Any]]:
    """The tables of modes of an OP2 file by the starts of their names. The others are passed over:
    the geometry of many files does not belong together as that of their superelements would."""
    from pyyeti.nastran import op2

    found: dict[str, list[Any]] = {"OUG": [], "BOPHIG": [], "LAMA": []}
    with op2.OP2(path) as file:
        file._fileh.seek(file._postheaderpos)
        while True:
            name, trailer, kind = file.rdop2nt()
            if name is None:
                return found
            start = next((each for each in found if name.startswith(each)), "")
            if kind > 0:
                file.rdop2matrix(trailer)
            elif not start:
                file.goto_next()
            elif start == "LAMA":
                found[start].append(file._rdop2lama())
            elif (table := file._rdop2ougv1(name)) is not None:  # None for other motions
                found[start].append(table)


def nastran_modes(path: str) -> Iterator[dict[str, Any]]:
    """The mode shapes in the tables OUG of an OP2 file of Nastran, or BOPHIG where there are none,
    as in `uff_modes`."""
    import numpy as np

    content = op2_tables(path)
    for case, table in enumerate(content["OUG"] or content["BOPHIG"]):
        nodes = np.unique(table["dof"][:, 0])
        place = np.searchsorted(nodes, table["dof"][:, 0]), np.maximum(table["dof"][:, 1] - 1, 0)
        roots = np.sqrt(np.abs(table["lambda"])) / (2.0 * np.pi)
        masses = np.zeros(len(roots))
        stated = content["LAMA"][case : case + 1]
        if stated and len(stated[0]) == len(roots):
            masses = stated[0][:, 5]  # number, order, eigenvalue, rad/s, Hz, mass, stiffness
        for number, shape in enumerate(table["ougv1"].T):
            motion = np.zeros((len(nodes), 6))
            motion[place] = np.real(shape)
            yield {
                "name": str(number + 1), "case": case, "complex": bool(np.any(np.imag(shape))),
                "frequency_hz": float(roots[number]), "modal_mass": float(masses[number]),
                "zeta": 0.0, "x": nodes.astype(float), "y": motion,
            }  # fmt: skip


def exodus_modes(path: str) -> Iterator[dict[str, Any]]:
    """The mode shapes in an Exodus file, whose times are the natural frequencies, as in
    `uff_modes`."""
    import netCDF4
    import numpy as np

    with netCDF4.Dataset(path) as file:
        file.set_auto_mask(False)
        names = [
            str(each).strip().lower() for each in netCDF4.chartostring(file["name_nod_var"][:])
        ]
        count = len(file.dimensions["num_nodes"])
        nodes = (
            file["node_num_map"][:] if "node_num_map" in file.variables else 1 + np.arange(count)
        )
        place = {
            axis + 3 * turned: names.index(name)
            for turned, start in enumerate(("disp", "rot"))
            for axis, end in enumerate("xyz")
            for name in names
            if name.startswith(start) and name.endswith(end)
        }
        for step, frequency in enumerate(np.atleast_1d(file["time_whole"][:])):
            motion = np.zeros((count, 6 if max(place, default=0) > 2 else 3))
            for column, variable in place.items():
                motion[:, column] = file[f"vals_nod_var{variable + 1}"][step]
            yield {
                "name": str(step + 1), "complex": False, "frequency_hz": abs(float(frequency)),
                "modal_mass": 0.0, "zeta": 0.0, "x": nodes.astype(float), "y": motion,
            }  # fmt: skip


def nastran_matrices(path: str) -> Iterator[dict[str, Any]]:
    """The real matrices of an OP4 file of Nastran."""
    from pyyeti.nastran import op4

    yield from numeric(op4.read(path, sparse=False))


def ide(path: str) -> Iterator[dict[str, Any]]:
    """The channels of acceleration of a logger, with their times in seconds."""
    import idelib

    with idelib.importFile(path) as recording:
        for channel in recording.channels.values():
            for each in channel.subchannels or ():
                if each.units[0] != "Acceleration":
                    continue
                times, values = each.getSession().arraySlice()
                yield {
                    "name": str(each.name), "of": str(channel.name), "unit": str(each.units[1]),
                    "x": 1e-6 * times, "y": values,
                }  # fmt: skip


def tdms(path: str) -> Iterator[dict[str, Any]]:
    """The channels of numbers of LabVIEW's binary files, with times where their step is stated."""
    import nptdms
    import numpy as np

    with nptdms.TdmsFile.open(path) as file:
        if file.file_status.incomplete_final_segment:
            raise EOFError
        for channel in (each for group in file.groups() for each in group.channels()):
            if channel.dtype.kind in REAL:
                y, about = channel[:].astype(float), channel.properties
                step, start = about.get("wf_increment"), about.get("wf_start_offset", 0.0)
                yield {
                    "name": channel.name, "of": channel.group_name,
                    "unit": str(about.get("unit_string", "")),
                    "x_unit": str(about.get("wf_xunit_string", "")),
                    "x_name": str(about.get("wf_xname", "")),
                    "x": start + step * np.arange(len(y)) if step else None, "y": y,
                }  # fmt: skip


def mf4(path: str) -> Iterator[dict[str, Any]]:
    """The channels of numbers of a measurement of version 4 (ASAM), each with its own times."""
    import asammdf

    with asammdf.MDF(path) as file:
        for signal in file.iter_channels():
            if signal.samples.dtype.kind in REAL and signal.samples.ndim == 1:
                group = file.groups[signal.group_index].channel_group
                _, of_time = signal.master_metadata or ("", 0)
                yield {
                    "name": signal.name, "of": group.acq_name or f"group {signal.group_index + 1}",
                    "unit": signal.unit, "x": signal.timestamps if of_time == 1 else None,
                    "y": signal.samples.astype(float),
                }  # fmt: skip


def wav(path: str) -> Iterator[dict[str, Any]]:
    """The channels of a sound file, as parts of full scale."""
    import numpy as np
    from scipy.io import wavfile

    warnings.filterwarnings("error", "Reached EOF prematurely")
    rate, samples = wavfile.read(path)
    if samples.dtype.kind != "f":
        full = 2.0 ** (8 * samples.dtype.itemsize - 1)
        samples = samples / full - (samples.dtype.kind == "u")  # 8 bits count from 0
    for number, channel in enumerate(np.atleast_2d(samples.T), start=1):
        yield {
            "name": str(number), "of": "the sound", "unit": "", "x": np.arange(len(channel)) / rate,
            "y": channel.astype(float),
        }  # fmt: skip


def excel(path: str) -> Iterator[dict[str, Any]]:
    """The sheets that hold anything, as text with tabs between cells."""
    import numpy as np
    import openpyxl

    for sheet in openpyxl.load_workbook(path, read_only=True, data_only=True).worksheets:
        rows = (
            "\t".join("" if cell is None else " ".join(str(cell).split()) for cell in row)
            for row in sheet.iter_rows(values_only=True)
        )
        if text := "\n".join(rows).rstrip():
            yield {"name": sheet.title, "text": text, "x": None, "y": np.empty(0)}


def own(ending: str, path: str) -> Iterator[dict[str, Any]]:
    """The table that a reader of another package makes of a file."""
    from pathlib import Path

    from stochvi.scenes import outside
    from stochvi.scenes.frames import Frame

    found = Frame.of(outside.READERS[ending](Path(path)))
    yield {
        "name": ending, "headings": found.names, "indexed": found.indexed, "x": None,
        "y": found.columns,
    }  # fmt: skip


READERS: dict[str, Callable[[str], Iterator[dict[str, Any]]]] = {
    "MATLAB": matlab,
    "MATLAB 7.3": matlab_hdf5,
    "UFF": uff,
    "UFF modes": uff_modes,
    "Nastran modes": nastran_modes,
    "Exodus modes": exodus_modes,
    "Nastran matrices": nastran_matrices,
    "IDE": ide,
    "TDMS": tdms,
    "MF4": mf4,
    "WAV": wav,
    "Excel": excel,
}
"""Name of a format -> its reader."""

if __name__ == "__main__":
    main(*sys.argv[1:])
