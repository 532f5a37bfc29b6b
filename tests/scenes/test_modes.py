"""A structure by its natural modes: from numbers, a table, a UFF file, finite elements."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

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
from stochvi.model.model import model_of
from stochvi.scenes import Beam, Modes, shipped_scene

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
    tmp_path: Path,
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


@pytest.mark.parametrize(
    ("made", "sentence"),
    [
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
    ],
)
def test_modes_that_do_not_fit_are_refused(
    made: Callable[[Path], Modes], sentence: str, tmp_path: Path
) -> None:
    with pytest.raises(SceneError) as refused:
        made(tmp_path)
    assert sentence in str(refused.value)


@pytest.mark.parametrize(
    ("keys", "sentence"),
    [
        ({"on": "seat"}, "must be on 'tip' or 'mode 1' or 'mode 2', got 'seat'"),
        ({"weights": {"tip": 0.0}}, "must hold a weight other than 0"),
        ({"on": "tip", "weights": {"tip": 1.0}}, "takes one of on, between and weights"),
        ({"weights": {"tip": 1.0, "mode 1": -1.0, "mode 2": 1.0}}, "does not move"),
    ],
)
def test_a_pair_that_is_nowhere_is_refused(keys: dict[str, Any], sentence: str) -> None:
    with pytest.raises(SceneError) as refused:
        Scene(
            structure=Modes(**TWO), excitations=[WhiteNoise(on="tip", intensity=1.0)],
            impact_pairs=[ImpactPair(upper=1.0, law=SPRING, **keys)],
        )  # fmt: skip
    assert sentence in str(refused.value)


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
