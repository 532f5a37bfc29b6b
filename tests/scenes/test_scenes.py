"""Scene files and scenes in Python: what is read, and the sentence for whatever is wrong."""

from __future__ import annotations

import copy
import inspect
import math
import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import BaseModel

from stochvi import Matrices, exact, screen
from stochvi.model.model import model_of
from stochvi.results.errors import SceneError
from stochvi.scenes.datasets import data_folder, shipped_scene
from stochvi.scenes.excitations import ConstantLoad, RoadNoise, Sine, TabulatedNoise, WhiteNoise
from stochvi.scenes.impact_laws import Elastic, ForceTable, Restitution
from stochvi.scenes.phases import changed_mount
from stochvi.scenes.scene import ImpactPair, Scene, load_scene, scene_from
from stochvi.scenes.structures import Beam, Isolator, Oscillator
from stochvi.scenes.validation import Checked
from support.known import DOCUMENT, MISTAKES, NOTHING, changed, oscillator, to_toml
from support.refusals import refusals

# What is read -----------------------------------------------------------------------------

RIGID = Restitution(coefficient=0.5)


def test_a_scene_file_says_what_the_same_scene_says_in_python(tmp_path: Path):
    file = tmp_path / "scene.toml"
    file.write_text(to_toml(DOCUMENT), encoding="utf-8")
    loaded = load_scene(file)
    assert loaded.title == "a valid scene"
    assert loaded == oscillator(-1.0, 1.0).model_copy(update={"title": "a valid scene"})


SHIPPED = sorted((data_folder() / "scenes").glob("*.toml"))


def parts_of(kind: type[Checked]) -> Iterator[type[Checked]]:
    """Every class of a part in the rooms of scenes."""
    for each in kind.__subclasses__():
        if each.__module__.startswith("stochvi.scenes"):
            yield from (each, *parts_of(each))


PARTS = sorted(set(parts_of(Checked)), key=lambda kind: kind.__name__)


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_a_shipped_scene_is_its_document_and_the_python_that_makes_it(path: Path) -> None:
    assert shipped_scene(path.stem) == path
    scene = load_scene(path)
    again = scene_from(scene.document())
    assert again == scene and again.effects() == scene.effects() and scene.title
    assert again != scene.model_copy(update={"title": "another"})
    # with nothing replaced each part is the same
    assert scene.replace() == scene and scene.structure.replace() == scene.structure
    assert all(pair.replace() == pair for pair in scene.impact_pairs)
    assert eval(repr(scene), {each.__name__: each for each in PARTS}) == scene
    assert "None" not in repr(scene)


@pytest.mark.parametrize("kind", PARTS, ids=lambda kind: kind.__name__)
def test_the_signature_of_a_part_is_its_keys_on_ten_lines(kind: type[Checked]) -> None:
    signature = inspect.signature(kind)
    assert set(signature.parameters) == set(kind.model_fields) - {"kind"}
    assert len(str(signature)) < 10 * 80
    assert "Annotated" not in str(signature) and "Validator" not in str(signature)


@pytest.mark.parametrize(
    "kind", [each for each in PARTS if not inspect.isabstract(each)], ids=lambda kind: kind.__name__
)
def test_a_part_lists_names_of_its_own_alone(kind: type[Checked]) -> None:
    listed = set(dir(kind.model_construct()))
    assert {"replace", *kind.model_fields} <= listed
    assert not set(dir(BaseModel)) & listed
    assert not {name for name in listed if name.startswith(("model_", "parse_", "_"))}


def test_what_pydantic_gives_to_a_part_works_and_is_not_listed() -> None:
    mount = Isolator(frequency_hz=12.0, zeta=0.1)
    assert mount.model_copy() == Isolator.model_validate(mount.model_dump()) == mount
    assert "omega" in dir(mount) and "model_copy" not in dir(mount)


def test_what_is_replaced_is_checked():
    scene = oscillator(-1.0, 1.0)
    pair = ImpactPair(clearance=2.0, law=RIGID)
    assert scene.replace(impact_pairs=[pair]).impact_pairs == (pair,)
    assert scene.replace(impact_pair=[pair]).impact_pairs == (pair,)
    assert scene.replace(impact_pairs=[]).effects() != scene.effects()
    with pytest.raises(SceneError, match="did you mean 'structure'"):
        scene.replace(strukture=Oscillator(mass=1.0, damping=0.1, stiffness=1.0))
    with pytest.raises(SceneError, match="exactly one of zeta, Q and loss_factor"):
        Isolator(frequency_hz=12.0, Q=5.0).replace(zeta=0.1)


def test_stops_of_a_pair_are_replaced_by_a_clearance_and_back():
    pair = ImpactPair(clearance=0.005, law=RIGID)
    narrow = pair.replace(clearance=0.0022)
    assert (narrow.lower, narrow.upper) == (-0.0022, 0.0022)
    assert (pair.replace(upper=0.007).lower, pair.replace(upper=0.007).upper) == (-0.005, 0.007)
    assert pair.replace(lower=None).stops() == [("upper", RIGID)]
    # stops at unequal distances are not moved without a word
    with pytest.raises(SceneError, match="clearance"):
        pair.replace(upper=0.007).replace(clearance=0.0022)


def test_a_valid_document_with_integers_is_the_same_scene():
    whole = changed(
        ["structure"], {"kind": "oscillator", "mass": 1, "damping": 0.1, "stiffness": 1}
    )
    assert scene_from(whole) == scene_from(DOCUMENT)


def test_a_table_beside_the_scene_file_is_found_from_anywhere(tmp_path: Path, monkeypatch):
    (tmp_path / "tables").mkdir()
    (tmp_path / "tables" / "force.csv").write_text("1,2\n10,4\n", encoding="utf-8")
    noise = {"kind": "psd", "file": "tables/force.csv", "unit": "N2/Hz"}
    (tmp_path / "scene.toml").write_text(to_toml(changed(["excitation"], [noise])))
    monkeypatch.chdir(tmp_path / "tables")
    (table,) = model_of(load_scene(tmp_path / "scene.toml")).acceleration_tables
    assert table.frequency_hz.tolist() == [1.0, 10.0]
    assert table.density.tolist() == [2.0, 4.0]


def test_a_scene_without_stops_is_valid():
    scene = scene_from(changed(["impact_pair"], NOTHING))
    assert scene.effects() == ("white noise on x",)
    assert model_of(scene).stops == ()


def test_a_scene_becomes_numbers_per_unit_mass():
    """c / m, k / m, S0 / m^2, G / m^2 and F / m; a base acceleration as it is, with its sign."""
    scene = Scene(
        structure=Isolator(mass=2.0, damping=0.4, stiffness=8.0),
        impact_pairs=[
            ImpactPair(
                lower=-0.5, upper=-0.1, lower_law={"coefficient": 0.2}, law={"coefficient": 0.9}
            )
        ],
        excitations=[
            WhiteNoise(on="x", intensity=0.4),
            WhiteNoise(intensity=0.3),
            TabulatedNoise(on="x", frequency_hz=[1.0, 2.0], density=[4.0, 8.0], unit="N2/Hz"),
            ConstantLoad(force=3.0),
            ConstantLoad(acceleration=1.0),
        ],
    )
    model = model_of(scene)
    assert (model.unit_mass, model.omega, model.damping_rate) == (2.0, 2.0, 0.2)
    assert model.intensity == pytest.approx(0.4 / 4.0 + 0.3, rel=1e-15)
    assert model.load == 3.0 / 2.0 - 1.0
    assert model.acceleration_tables[0].density.tolist() == [1.0, 2.0]
    assert [stop.position for stop in model.stops] == [-0.5, -0.1]
    assert [stop.coefficient for stop in model.stops] == [0.2, 0.9]
    assert model.moving_base and model.noise_on_mass
    assert scene.effects() == (
        "white noise on x",
        "white noise on base",
        "tabulated noise on x",
        "constant load on x",
        "constant load on base",
        "rigid stop lower",
        "rigid stop upper",
    )


def test_q_zeta_and_the_loss_factor_say_the_same():
    by_q, by_zeta = Oscillator(frequency_hz=12.0, Q=5.0), Oscillator(frequency_hz=12.0, zeta=0.1)
    by_loss = Isolator(frequency_hz=12.0, loss_factor=0.2)
    assert by_q.omega == by_zeta.omega == by_loss.omega == 2.0 * math.pi * 12.0
    assert by_q.damping_rate == pytest.approx(by_zeta.damping_rate, rel=1e-15)
    assert by_loss.damping_rate == pytest.approx(by_zeta.damping_rate, rel=1e-15)
    with pytest.raises(SceneError, match="got frequency_hz, zeta, loss_factor"):
        Isolator(frequency_hz=12.0, zeta=0.1, loss_factor=0.2)


def test_a_level_in_decibels_raises_the_whole_table():
    plain = TabulatedNoise(profile="navmat-p-9492").table
    raised = TabulatedNoise(profile="navmat-p-9492", level_db=-20.0).table
    assert raised.density == pytest.approx(plain.density / 100.0, rel=1e-15)


# What is refused --------------------------------------------------------------------------


@pytest.mark.parametrize("mistake", MISTAKES.values(), ids=MISTAKES.keys())
def test_a_mistake_gives_one_sentence_with_the_key_what_was_got_and_what_was_expected(mistake):
    with pytest.raises(SceneError) as failure:
        scene_from(mistake.document)
    sentence = str(failure.value)
    assert "\n" not in sentence
    assert sentence.startswith(f"{mistake.key} ")
    assert mistake.got in sentence
    assert mistake.expected in sentence


def test_every_mistake_is_reported_at_once():
    document = changed(["structure", "mass"], -1.0)
    document["excitation"][0]["intensity"] = "0.2"
    document["colour"] = "red"
    with pytest.raises(SceneError) as failure:
        scene_from(document)
    assert [key for key, _ in failure.value.problems] == [
        "structure.mass",
        "excitation.0.intensity",
        "colour",
    ]
    assert len(str(failure.value).splitlines()) == 3


def write(path: Path, content: bytes | None) -> None:
    if content is None:
        path.mkdir()
    else:
        path.write_bytes(content)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"[structure\nkind = 1", "is not valid TOML"),
        (b"a = 1\na = 2", "is not valid TOML"),
        (b"a = " + b"[" * 100_000, "nested too deeply"),
        (b"\x00\x01\x02", "is not valid TOML"),
        (b"title = '\xff\xfe'", "got binary data"),
        (b"#" * 10_000_001, "10000001 bytes, expected a text of at most 10000000"),
        (None, "expected a text file, got a folder"),
    ],
    ids=["invalid", "twice", "deep", "zeros", "not UTF-8", "too large", "folder"],
)
def test_a_file_that_is_not_a_scene_file_gives_a_sentence_with_its_name(tmp_path, content, words):
    path = tmp_path / "scene.toml"
    write(path, content)
    with pytest.raises(SceneError) as failure:
        load_scene(path)
    assert str(path) in str(failure.value)
    assert words in str(failure.value)


@pytest.mark.parametrize("name", ["nowhere.toml", "no\0where.toml", "x" * 300])
def test_a_file_that_cannot_be_read_gives_a_sentence_with_its_name(tmp_path, name):
    with pytest.raises(SceneError, match="cannot be read") as failure:
        load_scene(tmp_path / name)
    assert repr(name).strip("'") in str(failure.value)


def test_an_empty_file_lacks_its_sections(tmp_path):
    (tmp_path / "scene.toml").touch()
    with pytest.raises(SceneError) as failure:
        load_scene(tmp_path / "scene.toml")
    assert failure.value.problems == [("structure", "is missing"), ("excitation", "is missing")]


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "no rows of two numbers"),
        (b"frequency_hz,density\n", "no rows of two numbers"),
        (b"1,2\n", "at least 2 breakpoints, got 1"),
        (b"1,1\n2,1,3\n", "line 2: expected two numbers as in the lines above it, got '2,1,3'"),
        (b"Hz,N2/Hz\n2,x\n", "line 2: expected two numbers"),
        (b"\xff\xfe\x00", "got binary data"),
        (b"#" * 10_000_001, "10000001 bytes, expected a text of at most 10000000"),
        (None, "expected a text file, got a folder"),
    ],
)
def test_a_bad_table_file_gives_a_sentence_with_the_key_and_its_name(tmp_path, content, words):
    write(tmp_path / "force.csv", content)
    noise = {"kind": "psd", "file": "force.csv", "unit": "N2/Hz"}
    with pytest.raises(SceneError) as failure:
        scene_from(changed(["excitation"], [noise]), folder=tmp_path)
    ((key, sentence),) = failure.value.problems
    assert key == "excitation.0.file"
    assert str(tmp_path / "force.csv") in sentence
    assert words in sentence


# Python -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("build", "sentence"),
    [
        (lambda: Restitution(coefficient=1.2), "coefficient must be in [0, 1], got 1.2"),
        (lambda: Restitution(), "coefficient is missing"),
        (lambda: Restitution(coefficient=True), "coefficient must be a finite number, got True"),
        (
            lambda: ImpactPair(clearance="6,5 mm", law=Restitution(coefficient=0.5)),
            "clearance must be a finite number, got '6,5 mm'; write 0.0065 (m), without quotes",
        ),
        (
            lambda: RoadNoise(road="C", speed_kmh="60 km/h"),
            "speed_kmh must be a finite number, got '60 km/h'; write a plain number "
            "in the unit of the key, without quotes",
        ),
        (
            lambda: Restitution(coefficient="0.5"),
            "coefficient must be a finite number, got '0.5'; write 0.5, without quotes",
        ),
        (
            lambda: Restitution(coefficient=np.bool_(True)),
            "coefficient must be a finite number, got True",
        ),
        (
            lambda: Restitution(coefficient=np.complex128(1)),
            "coefficient must be a finite number, got (1+0j)",
        ),
        (
            lambda: TabulatedNoise(frequency_hz=np.float64(1.0), density=[1.0, 1.0]),
            "frequency_hz must be a list, got 1.0",
        ),
        (lambda: Oscillator(mass=-1.0), "mass must be greater than 0, got -1.0"),
        (
            lambda: Oscillator(frequency_hz=1.0),
            "needs frequency_hz with exactly one of zeta, Q and loss_factor, got frequency_hz",
        ),
        (lambda: ImpactPair(lower=1.0, upper=0.0), "needs lower < upper, got 1 and 0"),
        (
            lambda: ImpactPair(clearance=0.1, upper=0.1, law=RIGID),
            "takes clearance, or lower and upper, got clearance with upper",
        ),
        (
            lambda: ImpactPair(clearance=-0.1, law=RIGID),
            "clearance must be greater than 0, got -0.1",
        ),
        (
            lambda: ConstantLoad(force=1.0, on="base"),
            "takes force on a coordinate and acceleration with on = 'base', got on = 'base'",
        ),
        (lambda: Scene(), "structure is missing\nexcitation is missing"),
        (
            lambda: TabulatedNoise(frequency_hz=np.array([[1.0], [2.0]]), density=[1.0, 1.0]),
            "frequency_hz.0 must be a finite number, got [1.0]\n"
            "frequency_hz.1 must be a finite number, got [2.0]",
        ),
    ],
)
def test_a_part_built_in_python_gives_the_same_sentences(build, sentence):
    with pytest.raises(SceneError) as failure:
        build()
    assert str(failure.value) == sentence


def test_a_table_may_be_arrays():
    noise = TabulatedNoise(
        frequency_hz=np.array([1.0, 2.0]), density=np.array([3.0, 4.0]), unit="N2/Hz"
    )
    assert noise.table.density.tolist() == [3.0, 4.0]


@pytest.mark.parametrize(
    ("part", "key"),
    [
        (oscillator(-1.0, 1.0), "title"),
        (oscillator(-1.0, 1.0).structure, "mass"),
        (oscillator(-1.0, 1.0).impact_pairs[0], "lower"),
        (oscillator(-1.0, 1.0).impact_pairs[0].law, "coefficient"),
        (oscillator(-1.0, 1.0).excitations[0], "intensity"),
    ],
    ids=lambda value: value if isinstance(value, str) else type(value).__name__,
)
def test_a_part_of_a_scene_cannot_be_changed(part: Checked, key: str):
    before = getattr(part, key)
    with pytest.raises(SceneError, match=rf"{key} is frozen; replace\({key}=\.\.\.\)"):
        setattr(part, key, 0.5)
    assert getattr(part, key) == before


def test_the_lists_of_a_scene_cannot_be_changed_either():
    excitations = [WhiteNoise(intensity=0.2)]
    scene = Scene(structure=DOCUMENT["structure"], excitations=excitations)
    excitations.append(WhiteNoise(intensity=0.3))
    assert model_of(scene).intensity == 0.2
    assert isinstance(scene.excitations, tuple) and isinstance(scene.impact_pairs, tuple)


# Anything at all --------------------------------------------------------------------------

KEYS = ["structure", "excitation", "impact_pair", "kind", "mass", "Q", "zeta", "on", "law", "white"]
KEYS += ["coefficient", "lower", "upper", "frequency_hz", "density", "unit", "file", "title", "psd"]
SCALARS = st.one_of(
    st.floats(),
    st.integers(),
    st.booleans(),
    st.text(max_size=5),
    st.sampled_from(["oscillator", "isolator", "white", "psd", "constant", "base", "x", "g2/Hz"]),
    st.none(),
)
VALUES = st.recursive(
    SCALARS,
    lambda inner: st.one_of(
        st.lists(inner, max_size=3), st.dictionaries(st.sampled_from(KEYS), inner, max_size=3)
    ),
    max_leaves=6,
)
TABLE = {"kind": "psd", "frequency_hz": [1.0, 2.0], "density": [1.0, 1.0], "unit": "N2/Hz"}
RICH = changed(["excitation"], [*DOCUMENT["excitation"], TABLE, {"kind": "constant", "force": 1.0}])


def places(node: Any, path: tuple[str | int, ...] = ()) -> list[tuple[str | int, ...]]:
    """The path of every value in a document, and of a new key in every section of it."""
    found = [path]
    if isinstance(node, dict):
        found += [(*path, key) for key in KEYS if key not in node]
        found += [deep for key, value in node.items() for deep in places(value, (*path, key))]
    elif isinstance(node, list):
        found += [deep for n, value in enumerate(node) for deep in places(value, (*path, n))]
    return found


PLACES = [path for path in places(RICH) if path]


@settings(max_examples=200, deadline=None)
@given(st.lists(st.tuples(st.sampled_from(PLACES), VALUES), min_size=1, max_size=3))
def test_any_change_to_a_document_gives_a_scene_or_sentences(changes):
    document = copy.deepcopy(RICH)
    for path, value in changes:
        place: Any = document
        try:
            for part in path[:-1]:
                place = place[part]
            place[path[-1]] = value
        except (TypeError, KeyError, IndexError):
            continue  # an earlier change took this place away
    sentences, numbers = ["a scene has none"], (0.0,)
    try:
        model = model_of(scene_from(document))
        numbers = model.omega, model.damping_rate, model.intensity, model.load
    except SceneError as error:
        sentences = [text for _, text in error.problems]
    assert sentences and all(text and "\n" not in text for text in sentences)
    assert all(map(math.isfinite, numbers))


@settings(max_examples=200, deadline=None)
@given(st.binary(max_size=60) | st.text(max_size=60).map(str.encode))
def test_any_file_gives_a_scene_or_sentences(tmp_path_factory, content):
    path = tmp_path_factory.getbasetemp() / "anything.toml"
    path.write_bytes(content)
    with pytest.raises(SceneError):
        load_scene(path)


def test_the_writer_of_these_tests_writes_what_it_is_given():
    assert tomllib.loads(to_toml(RICH)) == RICH


def test_a_clearance_is_two_stops_at_equal_distances() -> None:
    pair = ImpactPair(clearance=4e-3, law=RIGID)
    assert pair == ImpactPair(lower=-4e-3, upper=4e-3, law=RIGID)
    assert [side for side, _ in pair.stops()] == ["lower", "upper"]
    keys = pair.model_dump(mode="json", exclude_none=True)
    assert "clearance" not in keys and ImpactPair(**keys) == pair


def spring(deflection: float) -> float:
    return deflection


test_symbols_of_the_field_lead_to_their_keys = refusals(
    lambda make: make(),
    (lambda: WhiteNoise(S0=0.2), r"^S0 is not a known key; did you mean 'intensity'\?"),
    (lambda: Oscillator(omega=1.0), r"did you mean 'frequency_hz' \(omega / 2 pi\)\?"),
    (lambda: Oscillator(m=1.0, c=0.1, k=1.0), "(?s)mean 'mass'.*'damping'.*'stiffness'\\?"),
    (lambda: Restitution(R=0.5), "did you mean 'coefficient'"),
    (lambda: ImpactPair(gap=0.5), "did you mean 'clearance'"),
    (lambda: Isolator(frequency_hz=12.0, damping_ratio=0.1), "did you mean 'zeta'"),
    (
        lambda: scene_from({**DOCUMENT, "stops": {}}),
        r"^stops is not a known key; did you mean 'impact_pair'",
    ),
    (
        lambda: ImpactPair(upper=1.0, law=spring),
        "^law must be an impact law, got the function spring; a force of your own is a Force",
    ),
    (
        lambda: Scene(
            structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
            excitations=[{"kind": "white", "S0": 1.0}],
        ),
        r"^excitations\.0\.S0 is not a known key; did you mean 'intensity'",
    ),
    pattern=True,
)


@pytest.mark.parametrize(
    ("part", "changes", "told"),
    [
        (
            TabulatedNoise(profile="mil-std-810h-truck-vertical-5hz"), {"level_db": 6.0},
            lambda noise: noise.table.mean_square(),
        ),
        (RoadNoise(road="C", speed=20.0), {"speed": 10.0}, lambda road: road.table.mean_square()),
        (
            ForceTable(deflection=(0.0, 1.0, 2.0), force=(0.0, 1.0, 3.0)),
            {"force": (0.0, 2.0, 6.0)}, lambda law: law.potential_at(1.5),
        ),
        (
            Beam(
                length=0.2, width=0.02, height=2e-3, young=2e11, density=7850.0, zeta=0.02, modes=2,
                points={"tip": 1.0},
            ),
            {"modes": 5}, lambda beam: len(beam.table.omega),
        ),
    ],
    ids=lambda each: type(each).__name__,
)  # fmt: skip
def test_a_copy_with_other_values_calculates_them_anew(
    part: Any, changes: dict[str, Any], told: Callable[[Any], float]
) -> None:
    before = told(part)  # calculated, and kept
    copy, anew = part.model_copy(update=changes), part.replace(**changes)
    assert told(copy) == told(anew) != before == told(part)
    assert told(part.model_copy(deep=True)) == before


# Units of sines ---------------------------------------------------------------------------


NOISE = [WhiteNoise(density=0.01, unit="g2/Hz")]


def test_a_sine_of_a_base_may_be_in_g() -> None:
    told = {"on": "base", "frequency_hz": 17.0}
    in_g, in_si = Sine(amplitude=0.5, unit="g", **told), Sine(amplitude=4.903325, **told)
    assert in_g.peak == pytest.approx(in_si.peak, rel=1e-15)
    mount = Isolator(frequency_hz=12.0, zeta=0.1, mass=1.0)
    one, other = (
        screen(Scene(structure=mount, excitations=[*NOISE, sine])) for sine in (in_g, in_si)
    )
    assert one.displacement_std == pytest.approx(other.displacement_std, rel=1e-12)
    assert in_g.louder(20.0).peak == pytest.approx(10.0 * in_g.peak)


def under_a_sine(keys: dict[str, object]) -> Scene:
    mount = Isolator(frequency_hz=12.0, zeta=0.1, mass=1.0)
    return Scene(structure=mount, excitations=[*NOISE, Sine(frequency_hz=5.0, **keys)])


test_a_unit_that_does_not_fit_a_sine_is_refused = refusals(
    under_a_sine,
    ({"on": "base", "amplitude": 1.0, "unit": "mm"}, "unit must be one of g, m/s2, N, got 'mm'"),
    ({"on": "base", "velocity": 1.0, "unit": "g"}, "unit is that of amplitude, got none"),
    ({"on": "base", "amplitude": 1.0, "unit": "N"}, "on 'base'; expected one of g, m/s2"),
    ({"on": "x", "amplitude": 1.0, "unit": "g"}, "on 'x'; expected one of N"),
)


def test_a_key_is_given_in_one_spelling() -> None:
    noise = [WhiteNoise(intensity=0.2)]
    with pytest.raises(SceneError, match="excitations must be left out beside excitation"):
        Scene(
            structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
            excitation=noise, excitations=noise,
        )  # fmt: skip


# ------------------------------------------------------------------------------
# Isolators: several mounts, gravity, tolerances.
# ------------------------------------------------------------------------------


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


test_a_mistake_gives_a_sentence_with_its_key = refusals(
    Isolator,
    ({"mounts": 4, "frequency_hz": 12.0, "zeta": 0.1}, "takes mounts with the mass"),
    ({"mounts": 0, "mass": 1.0, "stiffness": 1.0, "damping": 1.0}, "mounts must be at least 1"),
    (
        {"mounts": 2.5, "mass": 1.0, "stiffness": 1.0, "damping": 1.0},
        "mounts must be a whole number, got 2.5",
    ),
    ({"gravity": 1, "frequency_hz": 12.0, "zeta": 0.1}, "gravity must be true or false, got 1"),
    (
        {"gravity": True, "mass": 1.0, "stiffness": 0.0, "damping": 1.0},
        "needs a stiffness that carries the mass under gravity, got 0",
    ),
    (
        {"frequency_tolerance": 1.0, "frequency_hz": 12.0, "zeta": 0.1},
        "frequency_tolerance must be less than 1, got 1.0",
    ),
)


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


test_a_mount_that_says_too_little_or_too_much_is_refused = refusals(
    Isolator,
    ({"stiffness": 9300.0, "zeta": 0.1}, "needs the mass as well as the stiffness with zeta"),
    ({"mass": 4.2, "stiffness": 9300.0, "zeta": 0.1, "Q": 5.0}, "exactly one of zeta, Q"),
    ({"mass": 4.2, "stiffness": 9300.0, "zeta": 0.1, "damping": 3.0}, "got a mixture"),
    ({"mass": 4.2, "stiffness": 9300.0, "frequency_hz": 9.0, "zeta": 0.1}, "got a mixture"),
    ({"mass": 4.2, "stiffness": 9300.0}, "one of damping, zeta, Q and loss_factor"),
)
