"""Parts of other packages: found by their names, checked, and never in the way of what ships."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import warnings
from importlib.metadata import EntryPoint
from pathlib import Path
from types import ModuleType
from typing import Any, ClassVar, Literal, NamedTuple

import numpy as np
import pytest
from click.testing import CliRunner

import stochvi
from stochvi import (
    ImpactPair,
    PartWarning,
    Restitution,
    SceneError,
    SpeedRestitution,
    WhiteNoise,
    load_scene,
)
from stochvi.cli import main
from stochvi.scenes import TabulatedNoise, outside, read_record, shipped_scene
from stochvi.scenes.excitations import BaseExcitation
from stochvi.scenes.impact_laws import CompliantLaw, Hertz, RigidLaw
from stochvi.scenes.outside import Parts
from stochvi.scenes.validation import OneOf, Positive

PLUGIN = Path(__file__).parents[2] / "docs" / "plugin"


class Half(RigidLaw):
    """A rigid stop of half the speed, with a key of its own."""

    kind: Literal["half"] = "half"
    factor: Positive = 0.5

    conservative: ClassVar[bool] = False  # type: ignore[misc]
    restitution: ClassVar[float] = 0.5  # type: ignore[misc]

    def restitution_at(self, speed: Any) -> Any:
        return self.factor + 0.0 * np.asarray(speed)

    def in_words(self) -> str:
        return f"rigid, restitution {self.factor:g}"


SHIPPED = SpeedRestitution(coefficient=0.6, at_speed=1.0, body="viscoelastic")
"""A restitution that depends on the speed."""


class Alike(Half):
    """The same restitutions as a law of a user."""

    kind: Literal["alike"] = "alike"  # type: ignore[assignment]
    conservative: ClassVar[bool] = False  # type: ignore[misc]
    restitution: ClassVar[float] = SHIPPED.restitution  # type: ignore[misc]

    def restitution_at(self, speed: Any) -> Any:
        return SHIPPED.restitution_at(speed)

    def compiled(self) -> Any:
        return SHIPPED.compiled()


class Bare(NamedTuple):
    """A law of kernels for which no function has a body."""

    factor: float


class WithoutBodies(Half):
    kind: Literal["without-bodies"] = "without-bodies"  # type: ignore[assignment]

    def compiled(self) -> Any:
        return Bare(self.factor)


class Unfinished(CompliantLaw):
    kind: Literal["unfinished"] = "unfinished"


class Softer(Hertz):
    kind: Literal["softer"] = "softer"  # type: ignore[assignment]


class Taken(Half):
    kind: Literal["hertz"] = "hertz"  # type: ignore[assignment]
    word: ClassVar[str] = "own"


@pytest.fixture
def named(monkeypatch: pytest.MonkeyPatch):
    """Give entry points of a group, of a module `others`."""

    def give(group: str, **values: Any) -> None:
        module = ModuleType("others")
        vars(module).update(values)
        monkeypatch.setitem(sys.modules, "others", module)
        found = [EntryPoint(name, f"others:{name}", f"stochvi.{group}") for name in values]
        broken = EntryPoint("broken", "nowhere:part", f"stochvi.{group}")
        monkeypatch.setattr(
            outside, "entry_points", lambda of: [*found, broken] if of == broken.group else []
        )

    return give


def laws() -> OneOf:
    """A table of laws that no other test sees."""
    return OneOf([Restitution, Hertz], "laws", (RigidLaw, CompliantLaw))


def test_what_ships_is_found_without_a_look_at_other_packages(monkeypatch, tmp_path) -> None:
    def fail(group: str) -> None:
        raise AssertionError(f"looked for {group}")

    monkeypatch.setattr(outside, "entry_points", fail)
    assert load_scene(shipped_scene("isolator-truck")).excitations
    assert CliRunner().invoke(main, ["profiles"]).exception is not None  # a list of all
    told = CliRunner().invoke(main, ["new", str(tmp_path / "scene.toml")])
    assert told.exit_code == 0, told.output


def test_a_part_of_another_package_is_found_by_its_name(named) -> None:
    named("laws", half=Half)
    assert laws().kinds["half"] is Half
    assert outside.PACKAGES.pop("others") == "others"


def test_a_part_that_fails_costs_one_warning(named) -> None:
    named("laws")
    kinds = laws().kinds
    with pytest.warns(
        PartWarning, match=r"broken of nowhere \(stochvi.laws\) was left out: Module"
    ):
        assert "broken" not in kinds
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert "broken" not in kinds and "unknown" not in kinds


def test_a_part_of_another_package_cannot_take_the_name_of_one_that_ships(named) -> None:
    named("laws", hertz=Half)
    table = laws()
    with pytest.warns(PartWarning, match="hertz of others .* another part has this name"):
        table.kinds.with_others()
    assert table.kinds["hertz"] is Hertz


@pytest.mark.parametrize(
    ("name", "part", "words"),
    [
        ("softer", Softer, "must not be derived from Hertz.*derive it from RigidLaw or Compliant"),
        ("unfinished", Unfinished, "must define damping, force_at, in_words"),
        ("other", Half, r"must have kind: Literal\['other'\] = 'other', got 'half'"),
        ("number", 3, "must be a class derived from RigidLaw or CompliantLaw, got 3"),
    ],
)
def test_a_class_that_methods_cannot_follow_is_left_out(named, name, part, words) -> None:
    named("laws", **{name: part})
    with pytest.warns(PartWarning, match=words):
        assert name not in laws().kinds


def test_a_law_of_a_script_needs_no_package() -> None:
    pair = ImpactPair(clearance=0.01, law=Half(factor=0.4))
    assert pair.law_of("upper").restitution_at(1.0) == 0.4
    again = ImpactPair(clearance=0.01, law={"kind": "half", "factor": 0.3})
    assert isinstance(again.law, Half)


def test_methods_take_a_law_of_a_user_as_one_that_ships() -> None:
    """Those that follow a restitution by the speed do, and the others refuse it in a sentence."""
    scene = load_scene(shipped_scene("oscillator-lossy"))
    own, shipped = (
        scene.replace(impact_pairs=[ImpactPair(clearance=1.0, law=law)])
        for law in (Alike(), SHIPPED)
    )
    for method in (stochvi.average, stochvi.fokker_planck):
        found = [method(each).coordinates["x"].displacement_std.value for each in (own, shipped)]
        assert found[0] == pytest.approx(found[1], rel=1e-12)
    sampled = [stochvi.simulate(each, paths=4, duration=50.0, seed=1) for each in (own, shipped)]
    assert len({each.coordinates["x"].displacement_std.value for each in sampled}) == 1
    for method in (stochvi.exact, stochvi.linearise):
        with pytest.raises(stochvi.NotApplicable, match="got a function of speed"):
            method(own)


def test_a_law_whose_kernels_have_no_bodies_is_refused_with_the_way_out() -> None:
    """It was followed as a stop without a force."""
    scene = load_scene(shipped_scene("oscillator-lossy"))
    own = scene.replace(impact_pairs=[ImpactPair(clearance=1.0, law=WithoutBodies())])
    with pytest.raises(stochvi.NotApplicable, match=r"write @force\.of\(Bare\)"):
        stochvi.simulate(own, paths=4, duration=50.0)


def test_subclasses_of_shipped_laws_are_refused_with_the_way_out() -> None:
    class Mine(Restitution):
        pass

    for law, words in (
        (Mine(coefficient=0.5), "a law with keys of its own is derived from CompliantLaw or Rigid"),
        (Softer(coefficient=1e6), "must not be derived from Hertz"),
        (Taken(), "has kind 'hertz', which is that of Hertz; give Taken a kind of its own"),
    ):
        with pytest.raises(SceneError, match=words):
            ImpactPair(clearance=0.01, law=law)


def test_a_class_that_is_defined_again_replaces_its_earlier_self() -> None:
    def define(value: float) -> type[Half]:
        class Again(Half):
            kind: Literal["again"] = "again"  # type: ignore[assignment]
            restitution: ClassVar[float] = value  # type: ignore[misc]

        return Again

    for value in (0.2, 0.3):
        pair = ImpactPair(clearance=0.01, law=define(value)())
        assert pair.law is not None and pair.law.restitution == value


def test_the_answer_says_whose_part_it_is() -> None:
    scene = load_scene(shipped_scene("oscillator-lossy"))
    own = scene.replace(impact_pairs=[ImpactPair(clearance=1.0, law=Half())])
    whose = [sentence for sentence in own.assumptions() if "'half' is a part of" in sentence]
    assert len(whose) == 1 and not any("a part of" in each for each in scene.assumptions())


@pytest.mark.usefixtures("read_here")
def test_profiles_and_readers_of_other_packages(named, tmp_path) -> None:
    named("profiles", wrong=3)
    for name in ("broken", "wrong"):
        told = pytest.warns(PartWarning, match=f"{name} of .*was left out")
        with pytest.raises(SceneError, match=f"unknown profile '{name}'"), told:
            TabulatedNoise(profile=name)
    file = tmp_path / "run.own"
    file.write_bytes(b"\1\2")
    times = np.arange(400) / 100.0
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("stochvi.scenes.outside.READERS", Parts("readers", {
            "own": lambda path: {"time (ms)": 1e3 * times, "Z (g)": np.cos(times)},
        }, lambda name, part: part))  # fmt: skip
        record, columns = read_record(file)
    assert (round(record.fs), columns.unit.name) == (100, "g")


@pytest.mark.usefixtures("read_here")
def test_a_reader_that_fails_is_named(named, tmp_path) -> None:
    def bad(path: Path) -> None:
        raise KeyError("head")

    file = tmp_path / "run.bad"
    file.write_bytes(b"\1\2")
    with pytest.MonkeyPatch.context() as patch:
        parts = Parts("readers", {"bad": bad}, lambda name, part: part)
        patch.setattr("stochvi.scenes.outside.READERS", parts)
        with pytest.raises(
            SceneError, match=r"was not read by .*which reads \.bad files: KeyError"
        ):
            read_record(file)


def test_entry_points_are_looked_for_where_a_package_names_the_group(tmp_path, monkeypatch) -> None:
    """Nothing is imported for packages that name none, and all that is there is found."""
    outside.entry_points.cache_clear()
    monkeypatch.setattr(sys, "path", [str(tmp_path / "nowhere"), str(tmp_path)])
    assert not outside._named_anywhere("stochvi.laws")
    known = tmp_path / "bumpers-0.1.dist-info"
    known.mkdir()
    (known / "METADATA").write_text("Metadata-Version: 2.1\nName: bumpers\nVersion: 0.1\n")
    (known / "entry_points.txt").write_text("[stochvi.laws]\nhard = bumpers:Hard")
    assert outside._named_anywhere("stochvi.laws")
    assert not outside._named_anywhere("stochvi.readers")
    (found,) = outside.entry_points("stochvi.laws")
    outside.entry_points.cache_clear()
    assert (found.name, found.value) == ("hard", "bumpers:Hard")
    archive = tmp_path / "packages.zip"
    archive.write_bytes(b"")
    monkeypatch.setattr(sys, "path", [str(archive)])
    assert outside._named_anywhere("stochvi.readers"), "importlib.metadata looks into archives"


def test_help_lists_commands_of_other_packages_and_outlives_those_that_fail(named) -> None:
    import click

    before = dict(main.commands)
    named("commands", drop=click.Command("drop", help="Drop it."), size=3, odd=4)
    try:
        told = CliRunner().invoke(main, ["--help"])
        assert told.exit_code == 0
        for words in ("Of other packages", "Drop it.", "broken of nowhere", "odd of others"):
            assert words in told.output
        assert main.commands["size"] is before["size"]
    finally:
        main.commands.clear()
        main.commands.update(before)


@pytest.mark.slow
def test_a_change_of_the_source_of_a_foreign_law_compiles_kernels_anew(tmp_path) -> None:
    """Kernels on the disk are kept under a digest of the bodies of the law, wherever these lie."""
    source = tmp_path / "stochvi_bumpers.py"
    shutil.copy(PLUGIN / source.name, source)
    known = tmp_path / "stochvi_bumpers-0.1.dist-info"
    known.mkdir()
    (known / "METADATA").write_text("Metadata-Version: 2.1\nName: stochvi-bumpers\nVersion: 0.1\n")
    (known / "entry_points.txt").write_text("[stochvi.laws]\nhardening = stochvi_bumpers:Hardening")
    program = (
        "import stochvi, sys\n"
        "scene = stochvi.load_scene(sys.argv[1])\n"
        "law = {'kind': 'hardening', 'stiffness': 50.0, 'cubic_stiffness': 900.0}\n"
        "scene = scene.replace(impact_pairs=[dict(clearance=0.5, law=law)])\n"
        "found = stochvi.simulate(scene, paths=4, duration=60.0, seed=1)\n"
        "print(repr(found.coordinates['x'].displacement_mean_square.value))\n"
    )

    def answer() -> float:
        path = os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")])
        done = subprocess.run(
            [sys.executable, "-c", program, str(shipped_scene("oscillator-lossy"))],
            env=os.environ | {"PYTHONPATH": path, "PYTHONDONTWRITEBYTECODE": "1"},
            check=True, capture_output=True, text=True,
        )  # fmt: skip
        return float(done.stdout)

    first = answer()
    assert answer() == first
    text = source.read_text()
    body = "return law.stiffness * y + law"
    assert body in text
    source.write_text(text.replace(body, f"return 9 * {body.removeprefix('return ')}"))
    assert answer() != first
    source.write_text(text)
    assert answer() == first


def test_excitations_are_checked_too() -> None:
    class Odd(BaseExcitation):
        kind: Literal["odd"] = "odd"

        def facts(self, *args: Any) -> Any: ...

        def louder(self, *args: Any) -> Any: ...

    noise = WhiteNoise(intensity=1.0)
    scene = load_scene(shipped_scene("isolator-truck"))
    with pytest.raises(SceneError, match="has kind 'odd', expected 'white'"):
        scene.replace(excitations=[noise, Odd()])
