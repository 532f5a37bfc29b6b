"""Bars, beams and plates: frequencies, shapes, masses and compliances, each found a second way."""

from __future__ import annotations

import copy
import math
import struct
import tomllib
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import mpmath
import numpy as np
import pytest
import pyuff
import scipy.linalg
from scipy.io import netcdf_file

from stochvi import (
    ConstantLoad,
    Elastic,
    ForceTable,
    ImpactPair,
    Matrices,
    RecordedNoise,
    Restitution,
    Scene,
    SceneError,
    Viscoelastic,
    WhiteNoise,
    exact,
    linearise,
    load_scene,
    replay,
    screen,
)
from stochvi.mathematics.units import STANDARD_GRAVITY
from stochvi.model.model import model_of
from stochvi.scenes import Beam, Modes, RigidBody, shipped_scene
from stochvi.scenes.scene import scene_from
from stochvi.scenes.structures import Bar, Plate
from support.boxes import PLACES, box, direct_matrices, scene_with
from support.refusals import refusals

pytestmark = pytest.mark.usefixtures("read_here")

# ------------------------------------------------------------------------------
# A structure by its natural modes: from numbers, a table, a UFF file, finite elements.
# ------------------------------------------------------------------------------


TWO: dict[str, Any] = {"frequency_hz": [20.0, 125.0], "zeta": 0.01, "shapes": {"tip": [1.0, -1.0]}}
MASS = np.diag([2.0, 1.0, 1.5])
STIFFNESS = 4e4 * np.array([[2.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 1.0]])
SQUARES, SHAPES = scipy.linalg.eigh(STIFFNESS, MASS)
"""A chain of three masses, and its modes, Phi'M Phi = 1."""
FREQUENCIES = np.sqrt(SQUARES) / (2.0 * np.pi)
RATIOS = np.array([0.02, 0.03, 0.04])
DAMPING = MASS @ SHAPES @ np.diag(2.0 * RATIOS * np.sqrt(SQUARES)) @ SHAPES.T @ MASS
"""The damping matrix of these ratios."""


def by_matrices(**keys: Any) -> Scene:
    chain = Matrices(coordinates=["a", "b", "c"], mass=MASS, damping=DAMPING, stiffness=STIFFNESS)
    return Scene(structure=chain, **keys)


def by_modes(**keys: Any) -> Scene:
    modes = Modes(
        frequency_hz=FREQUENCIES.tolist(), zeta=RATIOS.tolist(),
        shapes={name: SHAPES[row].tolist() for row, name in enumerate("abc")},
        participation=(SHAPES.T @ MASS.sum(axis=1)).tolist(),
    )  # fmt: skip
    return Scene(structure=modes, **keys)


SPRING = Elastic(stiffness=3e4)
DRIVES: dict[str, WhiteNoise] = {
    "base": WhiteNoise(on="base", intensity=20.0),
    "point": WhiteNoise(on="c", intensity=3.0),
    "between": WhiteNoise(between=["a", "c"], intensity=3.0),
    "weights": WhiteNoise(weights={"a": 0.5, "b": -1.5, "c": 1.0}, intensity=3.0),
}
PAIRS: dict[str, list[ImpactPair]] = {
    "none": [],
    "point": [ImpactPair(on="c", upper=0.01, law=SPRING)],
    "between": [ImpactPair(between=["c", "a"], clearance=0.004, law=SPRING)],
    "weights": [ImpactPair(weights={"a": 0.5, "c": 0.5}, lower=-0.004, law=SPRING)],
}


def numbers(scene: Scene) -> dict[str, float]:
    """Every number of the points and pairs of a linearisation."""
    document = linearise(scene).to_dict()
    parts = {name: document["coordinates"][name] for name in "abc"} | document["impact_pairs"]
    return {
        f"{part}.{key}": value["value"]
        for part, values in parts.items()
        for key, value in values.items()
        if isinstance(value, dict) and not key.startswith("relative_")
    }


@pytest.mark.parametrize("pairs", PAIRS)
@pytest.mark.parametrize("drive", DRIVES)
def test_modes_give_the_numbers_of_their_matrices(drive: str, pairs: str) -> None:
    keys = {"impact_pairs": PAIRS[pairs], "excitations": [DRIVES[drive]]}
    wanted, found = numbers(by_matrices(**keys)), numbers(by_modes(**keys))
    assert wanted.keys() == found.keys() and len(found) >= 15
    assert [found[key] for key in wanted] == pytest.approx(list(wanted.values()), rel=1e-6)


def test_screening_reports_the_points() -> None:
    keys = {"impact_pairs": PAIRS["point"], "excitations": [DRIVES["base"]]}
    wanted, found = screen(by_matrices(**keys)), screen(by_modes(**keys))
    assert {"a", "b", "c", "mode 1"} <= set(found.coordinates)
    for name in "abc":
        own, other = asdict(wanted.coordinates[name]), asdict(found.coordinates[name])
        assert own.pop("sines") == other.pop("sines") == ()
        assert other == pytest.approx(own, rel=1e-9)


# Files ------------------------------------------------------------------------------------


def write_uff(path: Path, *, kind: int = 2) -> Path:
    """The chain as datasets 55, its motion along z at the nodes 11, 12 and 13."""
    file = pyuff.UFF(str(path))
    for k in range(3):
        normal: dict[str, Any] = {
            "freq": float(FREQUENCIES[k]), "modal_m": 1.0, "modal_damp_vis": float(RATIOS[k]),
            "modal_damp_his": 0.0,
        }  # fmt: skip
        turned = {"eig": 1j * np.sqrt(SQUARES[k]), "modal_a": 1j, "modal_b": 1j}
        still, turn = np.zeros(3), 1.0 if kind == 2 else 1j
        file.write_sets(
            pyuff.prepare_55(
                model_type=1, id1="chain", id2="", id3="", id4="", id5="", analysis_type=kind,
                data_ch=2, spec_data_type=8, data_type=2 if kind == 2 else 5, n_data_per_node=3,
                r1=turn * still, r2=turn * still, r3=turn * SHAPES[:, k],
                load_case=0, mode_n=k + 1, node_nums=[11, 12, 13],
                **(normal if kind == 2 else turned),
            ),
            "add",
        )  # fmt: skip
    return path


def write_table(path: Path) -> Path:
    rows = np.column_stack([FREQUENCIES, RATIOS, SHAPES.T])
    lines = [",".join(f"{each:.17g}" for each in row) for row in rows]
    path.write_text("\n".join(["frequency_hz,zeta,a,b,c", *lines]) + "\n", encoding="utf-8")
    return path


def write_op2(
    path: Path, *, masses: bool = True, cases: int = 1, name: str = "OUGV1", geometry: bool = False
) -> Path:
    """The chain as an OP2 file of Nastran: its modes along z at the nodes 11, 12 and 13, of twice
    their length, in the records that MSC documents (LAMA and OUGV1, 32 bit). Its `geometry` is that
    of other nodes."""

    def record(data: bytes) -> bytes:
        size = struct.pack("<i", len(data))
        return size + data + size

    def numbers(*each: int) -> bytes:
        return struct.pack(f"<{len(each)}i", *each)

    def block(name: str, records: list[bytes]) -> bytes:
        label = name.ljust(8).encode()
        found = record(numbers(2)) + record(label) + record(numbers(-1))
        found += record(numbers(7)) + record(numbers(101, 3, 0, 0, 0, 0, 1)) + record(numbers(-2))
        for count, data in enumerate([label, *records]):
            found += record(numbers(1)) + record(numbers(0)) + record(numbers(len(data) // 4))
            found += record(data) + record(numbers(-3 - count))
        return found + record(numbers(1)) + record(numbers(0)) + record(numbers(0))

    roots = np.sqrt(SQUARES)
    table = b"".join(
        numbers(k + 1, k + 1)
        + struct.pack("<5f", SQUARES[k], roots[k], FREQUENCIES[k], 4.0, 4.0 * SQUARES[k])
        for k in range(3)
    )
    shapes = []
    for k in range(3):
        head = struct.pack("<5if3i", 21, 7, 0, 1, k + 1, SQUARES[k], 0, 0, 1) + numbers(8)
        shapes.append(head.ljust(584, bytes(1)))
        rows = [
            numbers(10 * node + 1, 1) + struct.pack("<6f", 0, 0, 2.0 * SHAPES[row, k], 0, 0, 0)
            for row, node in enumerate((11, 12, 13))
        ]
        shapes.append(b"".join(rows))
    whole = b""
    if geometry:
        whole += block("EQEXIN", [numbers(11, 1, 12, 2), numbers(11, 101, 12, 201)])
        whole += block("BGPDT", [numbers(*range(12)), numbers(*range(14))])
    for _ in range(cases):
        if masses:
            whole += block("LAMA", [numbers(21, 6).ljust(584, bytes(1)), table])
        whole += block(name, shapes)
    path.write_bytes(whole + record(numbers(0)))
    return path


@pytest.mark.parametrize("name", ["OUGV1", "BOPHIG"])
def test_modes_are_read_beside_a_geometry_that_does_not_belong_to_them(
    tmp_path: Path, name: str
) -> None:
    path = write_op2(tmp_path / "chain.op2", name=name, geometry=True)
    found = Modes(file=str(path), points={"a": "11.z"}, zeta=0.01)
    np.testing.assert_allclose(found.frequency_hz, FREQUENCIES, rtol=1e-6)


def test_static_shapes_are_no_modes_of_0_hz(tmp_path: Path) -> None:
    path = tmp_path / "reduced.exo"
    with netcdf_file(str(path), "w") as file:
        for name, size in (("num_nodes", 1), ("num_nod_var", 1), ("len_name", 8), ("time", 9)):
            file.createDimension(name, size)
        file.createVariable("time_whole", "f8", ("time",))[:] = [0.0] * 7 + [20.0, 30.0]
        names = [list("DispZ".ljust(8, chr(0)))]
        file.createVariable("name_nod_var", "c", ("num_nod_var", "len_name"))[:] = names
        file.createVariable("vals_nod_var1", "f8", ("time", "num_nodes"))[:] = np.ones((9, 1))
    with pytest.raises(SceneError, match=r"got 7 shapes of 0 Hz, .* export the natural modes"):
        Modes(file=str(path), points={"a": "1.z"}, zeta=0.01)


@pytest.mark.parametrize(
    ("angles", "bends"),
    [
        ([[1.0, 1.0, 1.0], [0.0, 0.0, 0.0], [1.0, 1.0 + 1e-6, 1.0]], 0),
        ([[1.0, 1.0, 0.0], [1e-8, -1e-8, 0.0], [2.0, 2.0, 2.0]], 0),  # rounding; no rotations
        ([[1.0, 0.5, 0.2], [0.0, 0.0, 0.0], [1.0, 1.0, 1.0]], 1),
        ([[1.0, 0.5, 0.2], [0.3, 0.1, -0.3], [1.0, 1.0, 1.0]], 2),
    ],
)  # fmt: skip
def test_a_shape_of_0_hz_whose_nodes_turn_by_different_angles_is_static(
    tmp_path: Path, angles: list[list[float]], bends: int
) -> None:
    path = tmp_path / "reduced.exo"
    with netcdf_file(str(path), "w") as file:
        for name, size in (("num_nodes", 3), ("num_nod_var", 2), ("len_name", 8), ("time", 5)):
            file.createDimension(name, size)
        file.createVariable("time_whole", "f8", ("time",))[:] = [0.0] * 3 + [20.0, 30.0]
        names = [list(each.ljust(8, chr(0))) for each in ("DispZ", "RotX")]
        file.createVariable("name_nod_var", "c", ("num_nod_var", "len_name"))[:] = names
        file.createVariable("vals_nod_var1", "f8", ("time", "num_nodes"))[:] = np.ones((5, 3))
        turned = np.vstack([angles, [[1.0, 0.5, 0.0], [1.0, -1.0, 1.0]]])  # of modes they differ
        file.createVariable("vals_nod_var2", "f8", ("time", "num_nodes"))[:] = turned
    points = {"a": "1.z"}
    if not bends:
        assert Modes(file=str(path), points=points, zeta=0.01).frequency_hz[:3] == (0.0, 0.0, 0.0)
        return
    with pytest.raises(SceneError, match=rf"got 3 shapes of 0 Hz, {bends} of which bends? the str"):
        Modes(file=str(path), points=points, zeta=0.01)


def test_a_shape_of_0_hz_that_counts_as_a_free_motion_is_told(tmp_path: Path) -> None:
    nodes = {"a": "11.z"}
    free = Modes(file=str(write_exodus(tmp_path / "chain.exo")), points=nodes, zeta=0.01)
    (told,) = free.cautions(())
    assert told.startswith("1 of the shapes in chain.exo is of 0 Hz") and "Craig-Bampton" in told
    held = Modes(file=str(write_op2(tmp_path / "chain.op2")), points=nodes, zeta=0.01)
    assert held.cautions(()) == []


def write_exodus(path: Path) -> Path:
    """The chain as an Exodus file, its modes along z at the nodes 11, 12 and 13, after a motion
    that no spring holds."""
    with netcdf_file(str(path), "w") as file:
        for name, size in (("num_nodes", 3), ("num_nod_var", 2), ("len_name", 8), ("time", 4)):
            file.createDimension(name, size)
        file.createVariable("node_num_map", "i4", ("num_nodes",))[:] = [11, 12, 13]
        file.createVariable("time_whole", "f8", ("time",))[:] = [-1e-7, *FREQUENCIES]
        names = [list(each.ljust(8, chr(0))) for each in ("DispX", "DispZ")]
        file.createVariable("name_nod_var", "c", ("num_nod_var", "len_name"))[:] = names
        values = file.createVariable("vals_nod_var2", "f8", ("time", "num_nodes"))
        values[:] = np.vstack([np.ones(3), SHAPES.T])
        still = file.createVariable("vals_nod_var1", "f8", ("time", "num_nodes"))
        still[:] = np.zeros((4, 3))
    return path


def test_modes_of_finite_elements_are_those_of_the_chain(tmp_path: Path) -> None:
    nodes = {"a": "11.z", "c": "13.-z"}
    nastran = Modes(file=str(write_op2(tmp_path / "chain.op2")), points=nodes, zeta=0.01)
    exodus = Modes(file=str(write_exodus(tmp_path / "chain.exo")), points=nodes, zeta=0.01)
    assert exodus.natural_frequency_hz[0] == 0.0  # its small negative number is rounding
    for first, scale, found in ((0, 2.0, nastran), (1, 1.0, exodus)):
        table = found.table
        rows = slice(first, None)
        # an OP2 file holds numbers of 32 bits
        assert found.natural_frequency_hz[rows] == pytest.approx(FREQUENCIES, rel=1e-6)
        assert table.shapes["a"][rows] == pytest.approx(scale * SHAPES[0], rel=1e-6)
        assert table.shapes["c"][rows] == pytest.approx(-scale * SHAPES[2], rel=1e-6)
        assert table.mass[rows].tolist() == [scale**2] * 3
    bare = Modes(
        file=str(write_op2(tmp_path / "bare.op2", masses=False)), points=nodes, zeta=0.01,
        modal_mass=4.0,
    )  # fmt: skip
    assert bare.natural_frequency_hz == pytest.approx(FREQUENCIES, rel=1e-6)
    assert bare.table.mass.tolist() == [4.0] * 3


def test_modes_that_stand_still_leave_their_compliance() -> None:
    whole = by_modes(excitations=[DRIVES["point"]]).structure
    assert isinstance(whole, Modes)
    for way in ({"modes": 1}, {"max_frequency_hz": float(FREQUENCIES[:2].mean())}):
        one = whole.replace(**way)
        assert one.coordinates == ("mode 1",)
        # K^-1 is the sum of phi phi' / omega^2 over all modes
        flexibility = np.linalg.inv(STIFFNESS) - np.outer(SHAPES[:, 0], SHAPES[:, 0]) / SQUARES[0]
        for row, name in enumerate("abc"):
            assert one.compliance({name: 1.0}) == pytest.approx(flexibility[row, row], rel=1e-9)
        between = flexibility[0, 0] - 2.0 * flexibility[0, 2] + flexibility[2, 2]
        assert one.compliance({"a": 1.0, "c": -1.0}) == pytest.approx(between, rel=1e-9)
    assert whole.compliance({"c": 1.0}) == 0.0
    assert "1 of 3 modes" in one.assumptions()[0]


def test_a_finite_element_model_from_a_file_gives_the_numbers_of_its_matrices(
    tmp_path: Path, apart: None
) -> None:
    keys = {"impact_pairs": PAIRS["point"], "excitations": [DRIVES["weights"]]}
    wanted = numbers(by_matrices(**keys))
    nodes = {"a": "11.z", "b": "12.z", "c": "13.z"}
    for structure in (
        Modes(file=str(write_uff(tmp_path / "chain.uff")), points=nodes),
        Modes(file=str(write_table(tmp_path / "chain.csv"))),
        Modes(
            file=str(write_op2(tmp_path / "chain.op2")),
            zeta=RATIOS.tolist(),
            points=nodes,
        ),
    ):
        assert structure.source and structure.file is None
        found = numbers(Scene(structure=structure, **keys))
        # a dataset 55 holds six digits
        assert [found[key] for key in wanted] == pytest.approx(list(wanted.values()), rel=2e-5)


def test_a_scene_file_finds_the_modes_beside_it(tmp_path: Path) -> None:
    write_uff(tmp_path / "chain.uff")
    scene = tmp_path / "chain.toml"
    scene.write_text(
        '[structure]\nkind = "modes"\nfile = "chain.uff"\nzeta = 0.05\n'
        'points = { tip = "13.-z" }\n\n'
        '[[excitation]]\nkind = "white"\non = "tip"\nintensity = 1.0\n',
        encoding="utf-8",
    )
    structure = load_scene(scene).structure
    assert isinstance(structure, Modes)
    assert structure.table.zeta.tolist() == [0.05] * 3  # the scene goes before the file
    assert structure.table.shapes["tip"] == pytest.approx(-SHAPES[2], rel=1e-5)


test_modes_that_do_not_fit_are_refused = refusals(
    lambda tmp_path, made: made(tmp_path),
    (lambda _: Modes(**TWO | {"zeta": [0.1] * 3}), "zeta must hold 2 numbers, one for each"),
    (lambda _: Modes(**TWO | {"zeta": None}), "needs exactly one of zeta and Q, got none"),
    (lambda _: Modes(**TWO | {"shapes": {"tip": [1.0]}}), "shapes.tip must hold 2 numbers"),
    (lambda _: Modes(**TWO | {"shapes": {}}), "shapes must name one point at least"),
    (lambda _: Modes(**TWO | {"shapes": {"base": [1.0, 1.0]}}), "other than 'base'"),
    (
        lambda _: Modes(**TWO, residual_compliance={"seat": 1e-6}),
        "residual_compliance must name points of shapes, got 'seat'; known are tip",
    ),
    (lambda _: Modes(**TWO, points={"tip": "1.z"}), "points is for a file; give shapes"),
    (lambda p: Modes(file=str(write_uff(p / "a.uff"))), "needs points beside file"),
    (
        lambda p: Modes(file=str(write_uff(p / "a.uff")), points={"tip": "9.z"}),
        "has no motion '9.z' in mode 1: it has the nodes 11, 12, 13, along x, y, z",
    ),
    (
        lambda p: Modes(file=str(write_uff(p / "a.uff")), points={"tip": "tip"}),
        "points must be nodes with a direction, as '12.z'",
    ),
    (
        lambda p: Modes(file=str(write_uff(p / "a.uff", kind=3)), points={"tip": "11.z"}),
        "must hold real normal modes, got complex ones, the modes 1, 2, 3",
    ),
    (
        lambda p: Modes(file=str(write_table(p / "a.csv")), points={"tip": "d"}),
        "has no column 'd' for the point 'tip'",
    ),
    (
        lambda p: Modes(file=str(write_table(p / "a.csv")), frequency_hz=[1.0]),
        "takes frequency_hz from the file or from the scene, got both",
    ),
    (
        lambda p: Modes(file=str(write_op2(p / "a.op2", cases=2)), points={"tip": "11.z"}),
        "must hold the modes of one subcase, got 2; export one",
    ),
    (lambda _: Modes(**TWO, modes=3), "modes must be at most the 2 that are given, got 3"),
    (lambda _: Modes(**TWO, modes=1, max_frequency_hz=9.0), "at most one of modes and max_fr"),
    (lambda _: Modes(**TWO, max_frequency_hz=9.0), "must be above the lowest natural frequen"),
)


test_a_pair_that_is_nowhere_is_refused = refusals(
    lambda keys: Scene(
        structure=Modes(**TWO),
        excitations=[WhiteNoise(on="tip", intensity=1.0)],
        impact_pairs=[ImpactPair(upper=1.0, law=SPRING, **keys)],
    ),
    ({"on": "seat"}, "must be on 'tip' or 'mode 1' or 'mode 2', got 'seat'"),
    ({"weights": {"tip": 0.0}}, "must hold a weight other than 0"),
    ({"on": "tip", "weights": {"tip": 1.0}}, "takes one of on, between and weights"),
    ({"weights": {"tip": 1.0, "mode 1": -1.0, "mode 2": 1.0}}, "does not move"),
)


def test_a_base_moves_by_participation_alone() -> None:
    with pytest.raises(SceneError, match=r"acts on the base, which needs structure.participation"):
        Scene(structure=Modes(**TWO), excitations=[WhiteNoise(on="base", intensity=1.0)])


# What a stop sees -------------------------------------------------------------------------


def test_the_compliance_left_out_lies_in_series_with_the_stop() -> None:
    laws = [
        SPRING, Viscoelastic(stiffness=3e4, damping_ratio=0.1),
        ForceTable(deflection=[0.001, 0.002], force=[30.0, 90.0]),
    ]  # fmt: skip
    left = 2e-5
    for law in laws:
        softer = law.in_series(left)
        for force in (10.0, 60.0):
            deeper = float(law.deflection_at(force)) + left * force
            assert float(softer.deflection_at(force)) == pytest.approx(deeper, rel=1e-12)
    # a slow ramp y = v t: c (v - s f') + k (y - s f) = f ends on f' = k v / (1 + k s)
    law, speed, time = laws[1], 1e-4, 60.0
    c, k = law.damping(2.0), law.stiffness
    slope = k * speed / (1.0 + k * left)
    ramp = (k * speed * time + c * (speed - left * slope)) / (1.0 + k * left)
    softer = law.in_series(left)
    assert float(softer.force_at(speed * time, speed, 2.0)) == pytest.approx(ramp, rel=1e-12)
    modes = Modes(**TWO, residual_compliance={"tip": left})
    scene = Scene(
        structure=modes, excitations=[WhiteNoise(on="tip", intensity=1.0)],
        impact_pairs=[ImpactPair(on="tip", upper=0.1, law=SPRING)],
    )  # fmt: skip
    (stop,) = model_of(scene).stops
    assert stop.law == SPRING.in_series(left) and stop.law != SPRING


def test_rigid_stops_of_several_modes_are_warned_of() -> None:
    def warnings(modes: int, law: Any) -> str:
        reed = load_scene(shipped_scene("beam")).structure
        assert isinstance(reed, Beam)
        scene = Scene(
            structure=reed.replace(modes=modes),
            excitations=[WhiteNoise(on="base", intensity=0.5)],
            impact_pairs=[ImpactPair(on="tip", upper=0.001, law=law)],
        )
        return " ".join(linearise(scene).warnings)

    rigid = Restitution(coefficient=0.7)
    assert "the mass that rebounds falls with every mode" in warnings(3, rigid)
    assert "rebounds" not in warnings(1, rigid) and "rebounds" not in warnings(3, SPRING)


@pytest.mark.parametrize("point", ["tip", "middle"])
def test_one_mode_is_an_oscillator_at_its_gap(point: str) -> None:
    """Mass 1 / (phi^2 / m), base G phi: the exact law of an isolator with these numbers."""
    reed = load_scene(shipped_scene("beam")).structure
    assert isinstance(reed, Beam)
    one = reed.replace(modes=1)
    noise = WhiteNoise(on="base", intensity=0.48)
    pairs = [ImpactPair(on=point, upper=0.0004, law=Elastic(stiffness=1e3))]
    scene = Scene(structure=one, excitations=[noise], impact_pairs=pairs)
    share, mass = float(one.table.shapes[point][0]), float(one.table.mass[0])
    moved = float(one.table.participation[0]) * share  # type: ignore[index]
    stiffness = 1e3 / (1.0 + 1e3 * one.compliance({point: 1.0}))
    own = Scene(
        structure={
            "kind": "isolator", "frequency_hz": float(one.natural_frequency_hz[0]), "zeta": 0.01,
            "mass": mass / share**2,
        },
        excitations=[WhiteNoise(intensity=0.48 * moved**2)],
        impact_pairs=[ImpactPair(upper=0.0004, law=Elastic(stiffness=stiffness))],
    )  # fmt: skip
    wanted, found = exact(own), exact(scene)
    for name in ("collision_rate", "impact_speed_rate", "contact_force_upper"):
        one_value, two = wanted.impact_pairs["stops"][name], found.impact_pairs["stops"][name]
        assert two.value == pytest.approx(one_value.value, rel=1e-9), name
    for name in ("displacement_std", "velocity_std"):
        value = found.coordinates[point][name].value
        assert value == pytest.approx(wanted.coordinates["x"][name].value, rel=1e-9)


@pytest.mark.parametrize("place", [{"on": "c"}, {"on": "base"}, {"between": ["c", "a"]}])
def test_a_record_on_a_point_is_replayed_as_on_its_coordinate(
    place: dict[str, Any], tmp_path: Path
) -> None:
    values = np.random.default_rng(4).normal(size=2000)
    np.savetxt(tmp_path / "run.csv", values, header="force")
    unit = "m/s2" if place == {"on": "base"} else "N"
    shaken = [RecordedNoise(file=str(tmp_path / "run.csv"), fs=500.0, unit=unit, **place)]
    stops = [ImpactPair(on="c", clearance=2e-5, law=SPRING)]
    wanted = replay(by_matrices(impact_pairs=stops, excitations=shaken))
    found = replay(by_modes(impact_pairs=stops, excitations=shaken))
    hits = wanted.impact_pairs["stops"].hits.value
    assert found.impact_pairs["stops"].hits.value == hits > 10
    for name in "abc":
        largest = wanted.coordinates[name].displacement_max.value
        assert found.coordinates[name].displacement_max.value == pytest.approx(largest, rel=1e-6)


def test_other_points_of_one_mode_move_in_proportion_to_its_gap() -> None:
    """As they do where two pairs keep the coordinate of the mode."""
    keys: dict[str, Any] = {"frequency_hz": [20.0], "zeta": 0.05, "participation": [1.3]}
    blade = Modes(**keys, shapes={"tip": [1.0], "seat": [-0.4]})
    noise, load = WhiteNoise(on="base", intensity=20.0), ConstantLoad(on="tip", force=30.0)
    stop = ImpactPair(name="seat", on="seat", upper=0.001, law=SPRING)
    far = ImpactPair(name="far", on="tip", upper=1e3, law=SPRING)
    one, two = (
        linearise(Scene(structure=blade, impact_pairs=pairs, excitations=[noise, load]))
        for pairs in ([stop], [stop, far])
    )
    assert list(one.coordinates) == ["seat", "tip"]
    for name in ("tip", "seat"):
        for quantity in ("displacement_mean", "displacement_mean_square", "velocity_std"):
            value, wanted = (each.coordinates[name][quantity].value for each in (one, two))
            assert value == pytest.approx(wanted, rel=1e-6), (name, quantity)


def test_points_of_one_mode_are_reported_where_the_first_stands_still() -> None:
    keys: dict[str, Any] = {"frequency_hz": [20.0], "zeta": 0.05, "participation": [1.3]}
    blade = Modes(**keys, shapes={"foot": [0.0], "seat": [-0.4], "tip": [1.0]})
    noise = WhiteNoise(on="base", intensity=20.0)
    found = linearise(Scene(structure=blade, excitations=[noise])).coordinates
    stds = [found[name].displacement_std.value for name in ("foot", "seat", "tip")]
    # sigma^2 = S participation^2 / (4 zeta omega^3)
    tip = 1.3 * math.sqrt(20.0 / (4.0 * 0.05 * (40.0 * math.pi) ** 3))
    assert stds == pytest.approx([0.0, 0.4 * tip, tip], rel=1e-9)


# ------------------------------------------------------------------------------
# A rigid box on mounts: its matrices from first principles, its loads, and what is refused.
# ------------------------------------------------------------------------------


def test_matrices_are_second_derivatives_of_the_energy_of_springs_between_moved_points() -> None:
    structure = box()
    mass, damping, stiffness = structure.matrices
    for found, expected in zip((mass, damping, stiffness), direct_matrices(structure), strict=True):
        # differences of second order of an energy of rounding 1e-16 at steps of 1e-3
        np.testing.assert_allclose(found, expected, atol=1e-8 * np.abs(expected).max())


def test_a_ratio_of_every_mount_is_that_of_every_mode() -> None:
    for keys, ratio in (({"zeta": 0.07}, 0.07), ({"loss_factor": 0.3}, 0.15)):
        model = model_of(scene_with(box(**keys)))
        modes = model.modal
        np.testing.assert_allclose(
            modes.damping, np.diag(2.0 * ratio * np.sqrt(modes.squares)), atol=1e-9
        )


def test_ratios_that_differ_are_weighted_by_the_energy_that_each_mount_stores() -> None:
    ratios = np.linspace(0.02, 0.2, len(PLACES))
    keys = box().model_dump(by_alias=True, exclude_none=True)
    for mount, ratio in zip(keys["mount"], ratios, strict=True):
        del mount["damping"]
        mount["zeta"] = float(ratio)
    model = model_of(scene_with(RigidBody(**keys)))
    form = model.modal
    for square, shape, damping in zip(
        form.squares, form.shapes.T, np.diag(form.damping), strict=True
    ):
        stored = []
        for mount in keys["mount"]:
            moved = shape[:3] + np.cross(shape[3:], mount["at"])
            stored.append(float(np.sum(np.array(mount["stiffness"]) * moved**2)))
        assert np.sum(stored) == pytest.approx(square, rel=1e-9)
        mean = float(ratios @ stored) / square
        assert damping / (2.0 * math.sqrt(square)) == pytest.approx(mean, rel=1e-9)


def test_a_frequency_is_that_of_all_mounts_together_along_z() -> None:
    corners = [[x, y, 0.0] for x in (-0.2, 0.2) for y in (-0.1, 0.1)]
    keys = {
        "mass": 5.0, "inertia": [0.1, 0.1, 0.1],
        "mount": [{"at": at, "frequency_hz": 9.0, "zeta": 0.1} for at in corners],
    }  # fmt: skip
    structure = RigidBody(**keys)
    assert np.min(np.abs(structure.natural_frequency_hz - 9.0)) < 1e-9
    with pytest.raises(SceneError, match="mount needs one frequency_hz"):
        RigidBody(
            **keys | {"mount": [*keys["mount"][1:], {**keys["mount"][0], "frequency_hz": 8.0}]}
        )


def test_gravity_hangs_the_box_where_the_mounts_balance_weight_and_moments() -> None:
    structure = box(gravity="-z")
    scene = scene_with(structure)
    model = model_of(scene)
    rest = model.modal.shapes @ model.modal.rest
    forces = np.zeros(3)
    moments = np.zeros(3)
    for mount in structure.mounts:
        moved = rest[:3] + np.cross(rest[3:], mount.at)
        force = -np.array(mount.stiffness) * moved
        forces += force
        moments += np.cross(mount.at, force)
    weight = structure.mass * STANDARD_GRAVITY
    np.testing.assert_allclose(forces, [0.0, 0.0, weight], atol=1e-9 * weight)
    np.testing.assert_allclose(moments, 0.0, atol=1e-9 * weight)


def test_a_direction_counts_by_where_it_points_not_by_its_length() -> None:
    gaps = []
    for direction in ([0.0, 0.6, 0.8], [0.0, 3.0, 4.0]):
        pair = {"name": "a", "at": [0.1, 0.2, 0.3], "direction": direction, "clearance": 0.01}
        scene = scene_with(
            box(), pairs=[pair | {"law": {"kind": "restitution", "coefficient": 0.5}}]
        )
        gaps.append(model_of(scene).pairs[0].direction)
    np.testing.assert_allclose(*gaps, rtol=1e-15)
    motion = np.array([1.0, -2.0, 0.5, 0.01, 0.02, -0.03])
    moved = motion[:3] + np.cross(motion[3:], [0.1, 0.2, 0.3])
    assert gaps[0] @ motion == pytest.approx(moved @ [0.0, 0.6, 0.8], rel=1e-14)


# What is refused ---------------------------------------------------------------------------


def keys() -> dict:
    return tomllib.loads(shipped_scene("rigid-box").read_text("utf-8"))


def changed(place: str, value: object) -> dict:
    """The shipped box with one key changed; None takes it out."""
    found = part = copy.deepcopy(keys())
    *way, last = place.split(".")
    for word in way:
        part = part[int(word)] if isinstance(part, list) else part[word]
    if value is None:
        del part[last]
    else:
        part[int(last) if isinstance(part, list) else last] = value
    return found


@pytest.mark.parametrize(
    ("place", "value", "key"),
    [
        ("structure.inertia", [0.2, 0.25, 0.46], "structure.inertia"),
        ("structure.inertia", [0.2, -0.25, 0.15], "structure.inertia"),
        ("structure.inertia", [0.2, 0.25], "structure.inertia"),
        ("structure.inertia", [math.nan, 0.2, 0.2], "structure.inertia"),
        ("structure.inertia", [0.2, [0.2, 0.1, 0], 0.2], "structure.inertia"),
        ("structure.inertia", [[0.2, 0], [0, 0.2], [0, 0]], "structure.inertia"),
        ("structure.inertia", [[0.2, 0.1, 0], [0, 0.2, 0], [0, 0, 0.2]], "structure.inertia"),
        ("structure.inertia", [[0.2, 0.3, 0], [0.3, 0.2, 0], [0, 0, 0.2]], "structure.inertia"),
        ("structure.mount", [], "structure.mount"),
        ("structure.mount", keys()["structure"]["mount"][:1], "structure.mount"),
        ("structure.mount.1.stiffness", [1e4, 1e4], "structure.mount.1.stiffness.2"),
        ("structure.mount.1.stiffness", [1e4, 1e4, -1.0], "structure.mount.1.stiffness.2"),
        ("structure.mount.1.zeta", 0.1, "structure.mount.1"),
        ("structure.mount.1.loss_factor", None, "structure.mount.1"),
        ("structure.gravity", "down", "structure.gravity"),
        ("structure.points", {"a.b": [0, 0, 0]}, "structure.points"),
        ("impact_pair.0.direction", [0, 0, 0], "impact_pair.0.direction"),
        ("impact_pair.0.direction", None, "impact_pair.0"),
        ("impact_pair.0.at", None, "impact_pair.0"),
        ("impact_pair.0.on", "z", "impact_pair.0"),
        ("impact_pair.1.name", "corner 1", "impact_pair.1"),
        ("excitation.0.axis", None, "excitation.0"),
        ("excitation.0.axis", "rz", "excitation.0.axis"),
        ("excitation.0.on", "x", "excitation.0"),
    ],
)
def test_what_cannot_be_is_refused_in_a_sentence_that_names_the_key(place, value, key) -> None:
    with pytest.raises(SceneError) as caught:
        scene_from(changed(place, value))
    assert [name for name, _ in caught.value.problems] == [key], str(caught.value)


def test_the_motion_that_mounts_leave_free_is_named() -> None:
    line = [{"at": [x, 0.0, 0.0], "stiffness": [1e4, 1e4, 1e4], "zeta": 0.1} for x in (-0.2, 0.2)]
    with pytest.raises(SceneError, match=r"structure\.mount .*rx: the box rolls"):
        scene_from(changed("structure.mount", line))


@pytest.mark.parametrize("place", ["excitation.0.axis", "impact_pair.0.at"])
def test_keys_of_a_rigid_body_are_refused_elsewhere(place: str) -> None:
    found = changed("title", "an isolator")
    found["structure"] = {"kind": "isolator", "frequency_hz": 12.0, "zeta": 0.1}
    found["impact_pair"] = found["impact_pair"][:1]
    del found["excitation"][1:]
    if place.startswith("excitation"):
        found["impact_pair"] = []
    else:
        del found["excitation"][0]["axis"]
    with pytest.raises(SceneError, match="rigid-body"):
        scene_from(found)


def test_the_document_of_a_box_is_its_scene() -> None:
    scene = load_scene(shipped_scene("rigid-box"))
    again = scene_from(scene.document())
    assert again == scene and again.document() == scene.document()


# ------------------------------------------------------------------------------
# Bars, beams and plates:
# ------------------------------------------------------------------------------


STEEL: dict[str, Any] = {"young": 2.0e11, "density": 7850.0, "zeta": 0.01}
REED: dict[str, Any] = STEEL | {"length": 0.2, "width": 0.02, "height": 0.002}
ROD: dict[str, Any] = STEEL | {"length": 0.5, "area": 1e-4}
TIP = 0.7
"""Tip mass in units of that of the structure."""
SPRING_OF_SLENDER = 2.0
"""Tip spring, in units of EI / L^3 or EA / L."""

Equation = Callable[[Any], Any]

BEAMS: dict[str, tuple[dict[str, Any], Equation, list[float]]] = {
    "cantilever": (
        {"support": "cantilever"}, lambda b: mpmath.cos(b) * mpmath.cosh(b) + 1, [1.8751, 4.6941],
    ),
    "pinned": ({"support": "pinned"}, mpmath.sin, [3.1416, 6.2832]),
    "clamped": (
        {"support": "clamped"}, lambda b: mpmath.cos(b) * mpmath.cosh(b) - 1, [4.73, 7.8532],
    ),
    "clamped-pinned": (
        {"support": "clamped-pinned"}, lambda b: mpmath.tan(b) - mpmath.tanh(b), [3.9266, 7.0686],
    ),
    "free": (
        {"support": "free"}, lambda b: mpmath.cos(b) * mpmath.cosh(b) - 1, [0.0, 0.0, 4.73, 7.8532],
    ),
    "tip mass": (
        {"support": "cantilever", "tip_mass": TIP},
        lambda b: 1 + mpmath.cos(b) * mpmath.cosh(b)
        + TIP * b * (mpmath.cos(b) * mpmath.sinh(b) - mpmath.sin(b) * mpmath.cosh(b)),
        [1.33, 4.07],
    ),
    "tip spring": (
        {"support": "cantilever", "tip_spring": SPRING_OF_SLENDER},
        lambda b: b**3 * (1 + mpmath.cos(b) * mpmath.cosh(b))
        + SPRING_OF_SLENDER * (mpmath.sin(b) * mpmath.cosh(b) - mpmath.cos(b) * mpmath.sinh(b)),
        [2.15, 4.72],
    ),
}  # fmt: skip
"""Keys of a beam, its textbook frequency equation in beta L, and where its first roots are
(Blevins, Formulas for Natural Frequency and Mode Shape, tables 8-1 to 8-8)."""

BARS: dict[str, tuple[dict[str, Any], Equation, list[float]]] = {
    "fixed-free": ({"support": "cantilever"}, mpmath.cos, [1.5708, 4.7124]),
    "fixed-fixed": ({"support": "clamped"}, mpmath.sin, [3.1416, 6.2832]),
    "free-free": ({"support": "free"}, mpmath.sin, [0.0, 3.1416]),
    "tip mass": (
        {"support": "cantilever", "tip_mass": TIP},
        lambda z: z * mpmath.tan(z) - 1 / mpmath.mpf(TIP), [0.95, 3.5],
    ),
    "tip spring": (
        {"support": "cantilever", "tip_spring": SPRING_OF_SLENDER},
        lambda z: z * mpmath.cot(z) + SPRING_OF_SLENDER, [2.28893, 5.08699],
    ),
}  # fmt: skip
"""The same of a bar in omega L / c; the roots with a tip spring of 2 EA / L are those of
zeta cot zeta = -2 (B 15.22)."""


def roots(equation: Equation, starts: list[float]) -> list[float]:
    return [float(mpmath.findroot(equation, start)) if start else 0.0 for start in starts]


def in_si(keys: dict[str, Any], mass: float, stiffness: float) -> dict[str, Any]:
    """Tip mass and spring in kg and N/m."""
    units = {"tip_mass": mass, "tip_spring": stiffness}
    return {name: value * units[name] if name in units else value for name, value in keys.items()}


@pytest.mark.parametrize("case", BEAMS)
def test_a_beam_has_the_frequencies_of_the_textbook(case: str) -> None:
    keys, equation, starts = BEAMS[case]
    mass, bending = 7850.0 * 0.2 * 4e-5, 2.0e11 * 0.02 * 0.002**3 / 12.0
    beam = Beam(**REED, **in_si(keys, mass, bending / 0.2**3), modes=len(starts))
    wanted = [
        b**2 * math.sqrt(bending / (mass * 0.2**3)) / math.tau for b in roots(equation, starts)
    ]
    assert beam.natural_frequency_hz == pytest.approx(wanted, rel=1e-10)


@pytest.mark.parametrize("case", BARS)
def test_a_bar_has_the_frequencies_of_the_textbook(case: str) -> None:
    keys, equation, starts = BARS[case]
    mass, stiffness = 7850.0 * 0.5 * 1e-4, 2.0e11 * 1e-4 / 0.5
    bar = Bar(**ROD, **in_si(keys, mass, stiffness), modes=len(starts))
    wanted = [z * math.sqrt(stiffness / mass) / math.tau for z in roots(equation, starts)]
    assert bar.natural_frequency_hz == pytest.approx(wanted, rel=1e-10)


# Finite elements --------------------------------------------------------------------------


def assembled(element: np.ndarray, count: int, shared: int) -> np.ndarray:
    """A matrix of `count` equal elements, each of two nodes with `shared` coordinates."""
    whole = np.zeros((shared * (count + 1),) * 2)
    for k in range(count):
        part = slice(shared * k, shared * (k + 2))
        whole[part, part] += element
    return whole


def hermite(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Mass and stiffness of a beam of length, mass and EI of 1, in cubic elements."""
    h = 1.0 / count
    stiffness = np.array(
        [[12, 6 * h, -12, 6 * h], [6 * h, 4 * h**2, -6 * h, 2 * h**2],
         [-12, -6 * h, 12, -6 * h], [6 * h, 2 * h**2, -6 * h, 4 * h**2]]
    ) / h**3  # fmt: skip
    mass = np.array(
        [[156, 22 * h, 54, -13 * h], [22 * h, 4 * h**2, 13 * h, -3 * h**2],
         [54, 13 * h, 156, -22 * h], [-13 * h, -3 * h**2, -22 * h, 4 * h**2]]
    ) * h / 420.0  # fmt: skip
    return assembled(mass, count, 2), assembled(stiffness, count, 2)


def thick(count: int, rotary: float, shear: float) -> tuple[np.ndarray, np.ndarray]:
    """The same of a beam of Timoshenko: linear elements, shear taken at their middles."""
    h = 1.0 / count
    bend = np.array([[0, 0, 0, 0], [0, 1, 0, -1], [0, 0, 0, 0], [0, -1, 0, 1]]) / h
    row = np.array([-1.0 / h, -0.5, 1.0 / h, -0.5])
    inertia = np.array([[2.0, 1.0], [1.0, 2.0]]) * h / 6.0
    mass = np.zeros((4, 4))
    mass[0::2, 0::2], mass[1::2, 1::2] = inertia, rotary * inertia
    return assembled(mass, count, 2), assembled(bend + h * np.outer(row, row) / shear, count, 2)


HELD = {
    "cantilever": [0, 1], "pinned": [0, -2], "clamped": [0, 1, -2, -1],
    "clamped-pinned": [0, 1, -2], "free": [],
}  # fmt: skip
"""Coordinates that a support holds."""


def free_of(support: str, size: int) -> np.ndarray:
    return np.delete(np.arange(size), HELD[support])


@pytest.mark.parametrize("support", HELD)
def test_modes_of_a_beam_are_those_of_finite_elements(support: str) -> None:
    """Frequency, effective mass, and shape^2 / modal mass at a point, which no scale changes."""
    count = 60
    tip = {"tip_mass": 0.3, "tip_spring": 5.0} if support == "cantilever" else {}
    mass, stiffness = hermite(count)
    if tip:
        mass[-2, -2] += tip["tip_mass"]
        stiffness[-2, -2] += tip["tip_spring"]
    kept = free_of(support, len(mass))
    squares, shapes = scipy.linalg.eigh(stiffness[np.ix_(kept, kept)], mass[np.ix_(kept, kept)])
    whole = np.zeros((len(mass), len(kept)))
    whole[kept] = shapes
    beam = Beam(
        length=1.0, area=1.0, second_moment=1.0, young=1.0, density=1.0, support=support, modes=4,
        zeta=0.0, points={"near": 0.2, "end": 1.0}, **tip,
    )  # fmt: skip
    found = beam.table
    first = 2 if support == "free" else 0
    omega = np.sqrt(squares[first:4])
    assert found.omega[first:] == pytest.approx(omega, rel=3e-6)
    carried = mass @ np.tile([1.0, 0.0], count + 1)
    if support != "free":
        effective = (whole[:, :4].T @ carried) ** 2
        assert found.mass * found.participation**2 == pytest.approx(effective, rel=1e-5, abs=1e-9)
    for name, row in (("near", 2 * count // 5), ("end", -2)):
        own = found.shapes[name] ** 2 / found.mass
        wanted = whole[row, first:4] ** 2
        assert own[first:] == pytest.approx(wanted, rel=2e-5, abs=1e-9)
        if support == "free":  # the two rigid motions share one frequency
            assert own[:2].sum() == pytest.approx((whole[row, :2] ** 2).sum(), rel=1e-6)


@pytest.mark.parametrize("support", HELD)
def test_modes_of_a_thick_beam_are_those_of_finite_elements(support: str) -> None:
    ratio = 0.15  # height / length
    beam = Beam(
        length=1.0, width=1.0, height=ratio, young=1.0, density=1.0, support=support, modes=4,
        zeta=0.0, theory="timoshenko", points={"near": 0.25},
    )  # fmt: skip
    area, bending = ratio, ratio**3 / 12.0
    rotary = ratio**2 / 12.0
    shear = rotary * 2.0 * 1.3 / (5.0 / 6.0)
    errors = []
    for count in (80, 160):  # the error falls with the square of the length of an element
        mass, stiffness = thick(count, rotary, shear)
        kept = free_of(support, len(mass))
        squares = scipy.linalg.eigvalsh(
            stiffness[np.ix_(kept, kept)], mass[np.ix_(kept, kept)], subset_by_index=(0, 3)
        )
        errors.append(np.sqrt(np.maximum(squares, 0.0) * bending / area))
    first = 2 if support == "free" else 0
    omega = (4.0 * errors[1] - errors[0])[first:] / 3.0
    assert beam.table.omega[first:] == pytest.approx(omega, rel=3e-5)
    thin = beam.replace(theory="euler-bernoulli").table.omega[first:]
    assert np.all(np.abs(thin / omega - 1.0) > 0.01)  # the test would notice another theory


@pytest.mark.parametrize("theory", ["euler-bernoulli", "timoshenko"])
@pytest.mark.parametrize("support", ["cantilever", "pinned", "clamped", "clamped-pinned"])
def test_the_compliance_of_a_beam_is_that_of_finite_elements(support: str, theory: str) -> None:
    """Cubic elements are exact at their nodes; the error of linear ones falls with the square of
    their length, and is extrapolated."""
    thickness = 0.2 if theory == "timoshenko" else 0.01
    bending, rotary = thickness**3 / 12.0, thickness**2 / 12.0
    shear = rotary * 2.0 * 1.3 / (5.0 / 6.0)
    spring = {"tip_spring": 3.0 * bending} if support == "cantilever" else {}
    beam = Beam(
        length=1.0, width=1.0, height=thickness, young=1.0, density=1.0, support=support, modes=1,
        zeta=0.0, theory=theory, points={"a": 0.3, "b": 0.8}, **spring,
    )  # fmt: skip

    def by_elements(count: int) -> np.ndarray:
        thin = theory == "euler-bernoulli"
        _, stiffness = hermite(count) if thin else thick(count, rotary, shear)
        if spring:
            stiffness[-2, -2] += 3.0
        kept = free_of(support, len(stiffness))
        whole = np.zeros_like(stiffness)
        whole[np.ix_(kept, kept)] = np.linalg.inv(stiffness[np.ix_(kept, kept)])
        rows = [2 * (3 * count // 10), 2 * (8 * count // 10)]
        return whole[np.ix_(rows, rows)] / bending

    wanted = by_elements(10)
    if theory == "timoshenko":
        wanted = (4.0 * by_elements(160) - by_elements(80)) / 3.0
    found = [[beam.flexibility(one, two) for two in (0.3, 0.8)] for one in (0.3, 0.8)]
    assert np.array(found) == pytest.approx(wanted, rel=1e-7)


@pytest.mark.parametrize("kind", ["bar", "beam", "thick beam", "plate"])
def test_modes_and_the_compliance_they_leave_out_make_up_the_whole(kind: str) -> None:
    """The residual compliance falls with the number of modes, and the sum stays."""
    made: dict[str, Callable[[int], Bar | Beam | Plate]] = {
        "bar": lambda n: Bar(**ROD, tip_spring=4e7, modes=n, points={"a": 0.9}),
        "beam": lambda n: Beam(**REED, support="clamped", modes=n, points={"a": 0.4}),
        "thick beam": lambda n: Beam(
            **REED | {"height": 0.04}, theory="timoshenko", modes=n, points={"a": 1.0}
        ),
        "plate": lambda n: Plate(
            **STEEL, length=0.4, width=0.3, height=0.002, modes=n, points={"a": [0.3, 0.4]}
        ),
    }
    left = [made[kind](n).compliance({"a": 1.0}) for n in (1, 3, 6)]
    assert left[0] > left[1] > left[2] > 0.0
    whole = []
    for n, rest in zip((1, 3, 6), left, strict=True):
        table = made[kind](n).table
        whole.append(rest + np.sum(table.shapes["a"] ** 2 / (table.mass * table.omega**2)))
    assert whole == pytest.approx(
        [made[kind](1).flexibility(*[made[kind](1).places_of_points["a"]] * 2)] * 3
    )


def test_the_receptance_of_a_rod_is_that_of_its_closed_form() -> None:
    """Displacement of the free end per unit force there, L tan z / (EA z), z = omega L / c."""
    bar = Bar(**ROD, modes=40)
    table, z = bar.table, 0.9
    omega = z * math.sqrt(2.0e11 / 7850.0) / 0.5
    resonant = np.sum(1.0 / (table.mass * (table.omega**2 - omega**2)))
    closed = 0.5 / (2.0e11 * 1e-4) * math.tan(z) / z
    assert resonant + bar.compliance({"tip": 1.0}) == pytest.approx(closed, rel=1e-5)
    assert abs(resonant / closed - 1.0) > 1e-3  # the modes left out are seen


def by_wave(z: float, chi: float) -> complex:
    """Displacement of the free end of a bar per unit force there, in units of L / EA, where the
    absorption coefficient chi of the material makes its modulus young (1 + j chi / 2 pi)."""
    lossy = 1.0 + 1j * chi / math.tau
    wave = z / np.sqrt(lossy)
    return complex(np.tan(wave) / (lossy * wave))


def to_first_order(z: float, chi: float) -> complex:
    """The same to first order in chi (B 15.11)."""
    damped = chi / (4.0 * math.pi) * (z + 0.5 * math.sin(2.0 * z)) / math.cos(z) ** 2
    return (math.tan(z) - 1j * damped) / z


@pytest.mark.parametrize("z", [0.9, 2.0, 4.0])
def test_the_compliance_of_a_bar_summed_over_modes_is_that_of_its_wave(z: float) -> None:
    """B 6.63 at the free end is B 15.11, up to the square of the loss, and its own wave."""
    chi = 0.015
    bar = Bar(**ROD, modes=60)
    table, stiffness = bar.table, 2.0e11 * 1e-4 / 0.5
    lossy, omega = 1.0 + 1j * chi / math.tau, z * math.sqrt(2.0e11 / 7850.0) / 0.5
    shape = table.shapes["tip"] ** 2 / table.mass
    summed = np.sum(shape / (table.omega**2 * lossy - omega**2))
    summed += bar.compliance({"tip": 1.0}) / lossy
    rest = 2.0 * z**2 / (3.0 * math.pi**4 * (60.0 - 1.0) ** 3)  # of the modes beyond
    assert stiffness * summed == pytest.approx(by_wave(z, chi), abs=rest)
    errors = [abs(to_first_order(z, each) - by_wave(z, each)) for each in (chi, chi / 2.0)]
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.01)
    assert errors[0] < 0.02 * abs(by_wave(z, chi).imag)


def test_a_plate_has_the_modes_of_two_beams() -> None:
    """Galerkin with sines of its energy, integrated numerically, for one mode and a point."""
    plate = Plate(**STEEL, length=0.4, width=0.3, height=0.002, modes=6, points={"a": [0.25, 0.5]})
    rigidity = 2.0e11 * 0.002**3 / (12.0 * (1.0 - 0.3**2))
    x, y = ((np.arange(400) + 0.5) / 400 for _ in range(2))
    for k, (m, n) in enumerate([(1, 1), (2, 1), (1, 2)]):
        shape = np.outer(np.sin(m * np.pi * x), np.sin(n * np.pi * y))
        curvature = (m * np.pi / 0.4) ** 2 + (n * np.pi / 0.3) ** 2
        cell = 0.4 * 0.3 / 400**2
        kinetic = 7850.0 * 0.002 * np.sum(shape**2) * cell
        elastic = rigidity * np.sum((curvature * shape) ** 2) * cell
        assert plate.table.omega[k] == pytest.approx(math.sqrt(elastic / kinetic), rel=1e-9)
        assert plate.table.mass[k] == pytest.approx(kinetic, rel=1e-9)
        moved = 7850.0 * 0.002 * np.sum(shape) * cell / kinetic
        assert plate.table.participation[k] == pytest.approx(moved, rel=1e-4, abs=1e-9)
        at_a = math.sin(m * math.pi * 0.25) * math.sin(n * math.pi * 0.5)
        assert plate.table.shapes["a"][k] == pytest.approx(at_a, abs=1e-12)


def test_as_many_modes_as_a_frequency_needs() -> None:
    for structure in (
        Beam(**REED, max_frequency_hz=3000.0), Bar(**ROD, max_frequency_hz=3e4),
        Plate(**STEEL, length=0.4, width=0.3, height=0.002, max_frequency_hz=1000.0),
    ):  # fmt: skip
        assert structure.max_frequency_hz is not None
        more = structure.replace(max_frequency_hz=None, modes=len(structure.found) + 1)
        assert structure.natural_frequency_hz[-1] <= structure.max_frequency_hz
        assert more.natural_frequency_hz[-1] > structure.max_frequency_hz
        assert more.natural_frequency_hz[:-1] == pytest.approx(structure.natural_frequency_hz)


def test_many_modes_keep_their_digits() -> None:
    """A beam with sixty modes, whose hyperbolic functions would overflow 60 digits."""
    found = Beam(**REED, modes=60).table
    beta = (np.arange(1, 61) - 0.5) * np.pi
    scale = math.sqrt(2.0e11 * 0.002**2 / 12.0 / 7850.0) / 0.2**2
    assert found.omega[10:] == pytest.approx((beta**2 * scale)[10:], rel=1e-10)
    assert found.mass == pytest.approx(7850.0 * 0.2 * 4e-5 / 4.0, rel=1e-9)


test_what_is_no_structure_is_refused = refusals(
    lambda made: made(),
    (lambda: Beam(**STEEL, length=1.0, width=0.1, modes=2), "needs width and height, or area"),
    (lambda: Beam(**REED), "needs exactly one of modes and max_frequency_hz, got none"),
    (lambda: Beam(**REED | {"zeta": None}, modes=2), "exactly one of zeta and loss_factor"),
    (lambda: Beam(**REED, modes=2, support="pinned", tip_mass=1.0), "is at the free end"),
    (lambda: Beam(**REED, modes=2, points={"far": 1.2}), "points.far must be at most 1"),
    (lambda: Beam(**REED, max_frequency_hz=1.0), "must be above the lowest natural frequency"),
    (lambda: Bar(**ROD, modes=999), "modes must be at most 200, got 999"),
    (
        lambda: Beam(**REED | {"height": 0.1}, theory="timoshenko", modes=50),
        "higher modes lie above the frequency of shear",
    ),
    (lambda: Beam(**REED, modes=2, points={"base": 1.0}), "names other than 'base'"),
)
