"""Nothing escapes and nothing is lost: names of users, targets of answers, readers that go away."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest

from support.accuracies import quick_cases
from support.commands import Run, refused

SCENE = """
title = 'TITLE'
[structure]
kind = "oscillator"
mass = 1.0
damping = 0.1
stiffness = 1.0
[[impact_pair]]
name = 'NAME'
lower = -1.0
upper = 1.0
law = { kind = "restitution", coefficient = 1.0 }
[[excitation]]
EXCITATION
"""
WHITE = 'kind = "white"\nintensity = 0.2'
TABLE = 'kind = "psd"\nfile = "spectrum.csv"\nunit = "N2/Hz"'
NASTY = ["../../escape", r"[/red] $\frac{$ :smile: <b>" + "a" * 300]
VARY = ("--vary", "structure.stiffness=1,2", "--method", "exact")


def scene_in(folder: Path, title: str = "", name: str = "stops", excitation: str = WHITE) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    text = SCENE.replace("TITLE", title).replace("NAME", name).replace("EXCITATION", excitation)
    (folder / "scene.toml").write_text(text, encoding="utf-8")
    (folder / "spectrum.csv").write_text("0.01,1\n10,1\n", encoding="utf-8")
    return folder / "scene.toml"


def files_below(folder: Path) -> set[Path]:
    return {path.relative_to(folder) for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize("name", NASTY)
def test_files_of_a_sweep_stay_in_its_folder_whatever_a_pair_is_called(
    stochvi: Run, tmp_path: Path, monkeypatch, name: str
):
    scene = scene_in(tmp_path / "a" / "b", title=name, name=name)
    before = files_below(tmp_path)
    out = tmp_path / "a" / "b" / "o1" / "o2"
    with monkeypatch.context() as change:
        change.setattr("stochvi.views.sweep.changes", lambda _, name: name.endswith("rate"))
        code, text, errors = stochvi("sweep", scene, *VARY, "--out", out)
    assert (code, errors) == (0, "")
    assert "impacts" in text
    written = files_below(tmp_path) - before
    assert all(path.is_relative_to(out.relative_to(tmp_path)) for path in written)
    assert sum(path.suffix == ".png" for path in written) > 0


@pytest.mark.slow
@pytest.mark.parametrize("name", NASTY)
def test_a_response_is_shown_and_drawn_whatever_its_names_are(
    stochvi: Run, tmp_path: Path, name: str
):
    scene = scene_in(tmp_path, title=name, name=name)
    code, text, errors = stochvi("exact", scene, "--out", tmp_path / "out")
    assert (code, errors) == (0, "")
    assert name in text
    names = {path.name for path in files_below(tmp_path / "out")}
    assert names == {"density.png", "response.csv", "response.json"}


def test_control_characters_do_nothing_to_a_terminal(stochvi: Run, tmp_path: Path):
    scene = scene_in(tmp_path)
    scene.write_text(scene.read_text("utf-8").replace("'stops'", '"a\\u001b[31mb\\u009b"'), "utf-8")
    code, text, errors = stochvi("exact", scene)
    assert code == 0
    assert r"a\x1b[31mb\x9b" in text and "\x1b" not in text + errors


def test_an_answer_does_not_replace_what_its_command_reads(stochvi: Run, tmp_path: Path):
    scene = scene_in(tmp_path, excitation=TABLE)
    table = tmp_path / "spectrum.csv"
    before = scene.read_bytes(), table.read_bytes()
    os.link(scene, tmp_path / "other name")
    (tmp_path / "response.csv").hardlink_to(table)
    for target in (scene, table, tmp_path / "other name"):
        assert f"would replace {tmp_path}" in refused(stochvi("linearise", scene, "--json", target))
        if target != table:
            words = refused(stochvi("simulate", scene, "--checkpoint", target))
            assert "--checkpoint" in words and "would replace" in words
    run = tmp_path / "run"
    words = refused(stochvi("simulate", scene, "--checkpoint", run, "--json", run))
    assert words == f"--json {run} and --checkpoint {run} are one file; give each its own name"
    code, text, errors = stochvi("linearise", scene, "--out", tmp_path)
    assert code == 2 and "linearise" in text  # the answer was printed before
    assert "is read by this command" in errors
    assert (scene.read_bytes(), table.read_bytes()) == before


@pytest.mark.parametrize(
    "arguments", [("--out", "file"), ("--out", "file/in"), ("--json", "."), ("--json", "file/in")]
)
def test_a_target_that_cannot_be_is_refused_before_the_work(
    stochvi: Run, tmp_path: Path, monkeypatch, arguments
):
    monkeypatch.chdir(tmp_path)
    Path("file").touch()
    # the scene is not even looked at
    assert arguments[0] in refused(stochvi("exact", "no such scene.toml", *arguments))


@pytest.mark.skipif(os.name == "nt", reason="Windows makes links for administrators alone")
@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no device that is full")
def test_a_disk_that_is_full_costs_the_file_and_not_the_answer(stochvi: Run, tmp_path: Path):
    scene = scene_in(tmp_path)
    code, text, errors = stochvi("exact", scene, "--json", "/dev/full")
    assert code == 1 and errors.startswith(
        "stochvi: /dev/full: no space left on device; the answer"
    )
    assert text.split("cost:")[0] == stochvi("exact", scene)[1].split("cost:")[0] != ""


@pytest.mark.skipif(os.name == "nt", reason="Windows makes links for administrators alone")
@pytest.mark.parametrize("depth", [1, 2])
def test_a_link_to_itself_is_refused_wherever_it_is_named(
    stochvi: Run, tmp_path: Path, depth: int
) -> None:
    """Also where two links lead to each other."""
    scene, loop = scene_in(tmp_path), tmp_path / "loop.toml"
    others = [tmp_path / f"loop{n}.toml" for n in range(1, depth)]
    for link, target in zip([loop, *others], [*others, loop], strict=True):
        link.symlink_to(target)
    for words in (
        ("exact", loop), ("explain", loop), ("new", loop), ("exact", scene, "--json", loop),
        ("exact", scene, "--out", loop), ("exact", scene, "--out", loop / "below"),
        ("simulate", scene, "--checkpoint", loop, "--json", loop),
    ):  # fmt: skip
        assert "loop" in refused(stochvi(*words))
    assert loop.is_symlink()


def test_keys_that_are_nested_too_deeply_are_refused(stochvi: Run, tmp_path: Path) -> None:
    deep = tmp_path / "deep.toml"
    for text in (".".join(["a"] * 2000) + " = 1\n", ".".join(["structure"] * 2000) + " = 1\n"):
        deep.write_text(text)
        assert "nested too deeply" in refused(stochvi("screen", deep))


def test_impact_rates_need_stops(stochvi: Run, tmp_path: Path) -> None:
    scene = scene_in(tmp_path)
    before, _, after = scene.read_text("utf-8").partition("[[impact_pair]]")
    scene.write_text(before + "[[excitation]]" + after.partition("[[excitation]]")[2], "utf-8")
    assert "the scene needs an impact_pair" in refused(stochvi("clearance", scene))


@pytest.mark.parametrize("where", ["title", "number", "option"])
def test_a_message_never_quotes_a_book(stochvi: Run, tmp_path: Path, where: str) -> None:
    """Both ends are kept: what is wrong stands in front, and what to do at the end."""
    scene, long = scene_in(tmp_path), "7" * 70_000
    if where != "option":
        text = scene.read_text("utf-8")
        key = f'{long} = "x"' if where == "title" else f"mass = '{long}'"
        scene.write_text(text.replace("mass = 1.0", key), "utf-8")
    words = ("--gaps", long + "x") if where == "option" else ()
    done = stochvi("clearance", scene, *words)
    assert done.code == 2 and max(map(len, done.err.splitlines())) < 2_100
    assert done.err.startswith("stochvi: ")


def test_a_sweep_does_not_follow_a_link_in_its_folder(stochvi: Run, tmp_path: Path):
    scene, out, outside = scene_in(tmp_path), tmp_path / "out", tmp_path / "outside"
    out.mkdir()
    outside.mkdir()
    (out / "rows").symlink_to(outside)
    assert "rows is a link" in refused(stochvi("sweep", scene, *VARY, "--out", out, "--quiet"))
    assert list(outside.iterdir()) == []


@pytest.mark.parametrize("columns", ["x", "²", "-5", "0", "9" * 5000, "1000000000000", " "])
def test_any_width_of_a_terminal_is_taken(stochvi: Run, tmp_path: Path, monkeypatch, columns):
    with monkeypatch.context() as terminal:  # pytest reads it, too
        terminal.setenv("COLUMNS", columns)
        code, text, errors = stochvi("exact", scene_in(tmp_path))
    assert (code, errors) == (0, "") and "std. dev. of displ." in text


def test_a_picture_that_fails_costs_a_note(stochvi: Run, tmp_path: Path, monkeypatch):
    from stochvi.views import density

    def fail(*_: object) -> None:
        raise RuntimeError("no such letter")

    monkeypatch.setattr(density, "draw_density", fail)
    out, answer = tmp_path / "out", tmp_path / "answer.json"
    code, _, errors = stochvi("exact", scene_in(tmp_path), "--out", out, "--json", answer)
    assert code == 0
    assert errors.startswith("note: density.png could not be drawn (no such letter)")
    assert json.loads(answer.read_text("utf-8"))["method"] == "exact"
    assert {path.name for path in files_below(out)} == {"response.csv", "response.json"}


@pytest.mark.skipif(os.name == "nt", reason="a pipe of Windows ends otherwise")
@quick_cases("more", [(), ("--json", "-")], keep=(1,))
def test_a_reader_that_goes_away_does_not_cost_the_files(tmp_path: Path, more: tuple[str, ...]):
    reading, writing = os.pipe()
    os.close(reading)
    words = ["linearise", str(scene_in(tmp_path)), "--out", str(tmp_path / "out"), *more]
    with open(writing, "wb") as closed:
        ended = subprocess.run(
            [sys.executable, "-m", "stochvi", *words], stdout=closed, stderr=subprocess.PIPE
        )
    assert ended.returncode == 0
    assert b"Traceback" not in ended.stderr and b"BrokenPipe" not in ended.stderr
    names = {path.name for path in files_below(tmp_path / "out")}
    assert names == {"response.csv", "response.json"}


@pytest.mark.skipif(os.name == "nt", reason="Windows has no such signal")
def test_ctrl_c_while_the_command_line_is_imported_is_one_sentence(tmp_path: Path):
    words = "import sys, os, signal; sys.argv = ['stochvi', 'profiles']\n"
    words += "class Press:\n def find_spec(self, name, *_):\n"
    words += "  if name == 'click': os.kill(os.getpid(), signal.SIGINT)\n"
    words += "sys.meta_path.insert(0, Press())\n"
    words += "from stochvi.__main__ import run; run()"
    ended = subprocess.run([sys.executable, "-c", words], capture_output=True, text=True)
    assert ended.returncode == 1
    assert ended.stderr == "stochvi: interrupted by Ctrl-C; nothing was kept\n"


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="the file system has no named pipes")
@pytest.mark.parametrize("where", ["scene", "table"])
def test_a_device_a_pipe_or_a_folder_is_no_input(stochvi: Run, tmp_path: Path, where: str):
    scene = scene_in(tmp_path, excitation=TABLE)
    replaced = scene if where == "scene" else tmp_path / "spectrum.csv"
    replaced.unlink()
    began = time.process_time()
    for make in (os.mkfifo, os.mkdir, lambda path: os.symlink("/dev/zero", path)):
        make(replaced)
        assert "expected a text file, got" in refused(stochvi("exact", scene))
        replaced.rmdir() if replaced.is_dir() else replaced.unlink()
    assert time.process_time() - began < 5.0


UNPRIVILEGED = ["setpriv", "--bounding-set=-dac_override,-dac_read_search"]
"""What takes from root the right to write where nobody may."""


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="Windows has other rights")
@pytest.mark.skipif(
    hasattr(os, "geteuid") and os.geteuid() == 0 and not shutil.which("setpriv"),
    reason="root may write everywhere",
)
def test_without_write_access_a_command_ends_in_a_sentence_before_it_works(tmp_path: Path):
    """`demo` worked for 12 s first, and a message began with a name and went on without a colon."""
    scene, closed = scene_in(tmp_path / "here"), tmp_path / "closed"
    closed.mkdir()
    closed.chmod(0o555)
    without = UNPRIVILEGED if os.geteuid() == 0 else []
    commands = [
        ("linearise", scene, "--out", closed / "answers"),
        ("linearise", scene, "--json", closed / "answer.json"),
        ("simulate", scene, "--checkpoint", closed / "kept"),
        ("sweep", scene, *VARY, "--out", closed),
        ("demo", "--out", closed / "answers"),
        ("new", closed / "scene.toml"),
    ]
    words = (
        "import resource, sys; from stochvi.cli import main;\n"
        "for each in eval(sys.argv[1]):\n"
        "    try: main(each)\n"
        "    except SystemExit as ended: print(ended.code, file=sys.stderr)\n"
        "print(resource.getrusage(resource.RUSAGE_SELF).ru_utime)"
    )
    asked = repr([[str(word) for word in command] for command in commands])
    ended = subprocess.run(
        [*without, sys.executable, "-c", words, asked], capture_output=True, text=True, check=True,
        env=os.environ | {"HOME": str(closed)},
    )  # fmt: skip
    said, codes = ended.stderr.splitlines()[::2], ended.stderr.splitlines()[1::2]
    assert codes == ["2"] * len(commands)
    for sentence in said:
        assert sentence.startswith("stochvi: ") and f"{closed} cannot be written to;" in sentence
    assert float(ended.stdout) < 4.0
    # the negative control: the same commands write where they may
    closed.chmod(0o755)
    asked = repr([[str(word) for word in command] for command in commands[:2]])
    subprocess.run([*without, sys.executable, "-c", words, asked], capture_output=True, check=True)
    assert len(files_below(closed)) == 3


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="Windows refuses a file that another program has open")
def test_two_writers_of_one_folder_leave_whole_answers_of_one_of_them(tmp_path: Path):
    scenes = [scene_in(tmp_path / title, title) for title in ("one", "two")]
    out = tmp_path / "out"
    words = "import sys; from stochvi.cli import main\nfor _ in range(20):\n"
    words += "    try: main(['linearise', sys.argv[1], '--out', sys.argv[2], '--quiet'])\n"
    words += "    except SystemExit as ended: assert ended.code in (0, None), ended.code\n"
    both = [
        subprocess.Popen([sys.executable, "-c", words, scene, out], stderr=subprocess.PIPE)
        for scene in scenes
    ]
    seen = set()
    while any(each.poll() is None for each in both):
        if (out / "response.json").exists():  # at any moment it is a whole document
            document = json.loads((out / "response.json").read_text("utf-8"))
            seen.add(document["provenance"]["scene"]["title"])
        time.sleep(1e-3)
    assert [each.returncode for each in both] == [0, 0], [each.stderr.read() for each in both]  # type: ignore[union-attr]
    assert seen == {"one", "two"}
    assert {path.name for path in files_below(out)} == {"response.csv", "response.json"}
